/* SPDX-License-Identifier: BSD-3-Clause */
/* The faults of a simulated plant, as an instructor sees them: in its store is which ones somebody started or stopped. */
#include "experiment.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "files/files.h"
#include "operate/operate.h"

#define LATEST (366 * 86400.0)

static const char *const setting[] = {"size", "jump", "low", "high", "duration", "at"};
static const char *const relation[] = {"", "<", "<=", ">", ">="}; /* enum fault_if */

/* As somebody started it last, or as the experiment has it. */
static double number_of(const struct faults *f, size_t i, enum fault_number k)
{
    const struct apc_sample *number = &f->number[i * FAULT_NUMBERS + k];
    const struct experiment_fault fault = experiment_fault(&f->e, i);
    if (number->seq > 0)
        return number->value;
    if (k <= FAULT_HIGH && fault.number[k])
        return *fault.number[k];
    return k == FAULT_DURATION ? apc_ns_to_s(*fault.duration) : 0;
}

static int make_rows(struct faults *f)
{
    f->row = calloc(f->n + 1, sizeof *f->row);
    f->number = calloc(f->n + 1, FAULT_NUMBERS * sizeof *f->number);
    for (size_t i = 0; f->row && f->number && i < f->n; i++) {
        const struct experiment_fault fault = experiment_fault(&f->e, i);
        f->row[i] = (struct apc_sample){.table = APC_OPMODE, .id = fault.row};
        for (int k = 0; k < FAULT_NUMBERS;
             k++) /* without numbers of its own: of no variable, which is never there */
            f->number[i * FAULT_NUMBERS + (size_t)k] = (struct apc_sample){
                .table = APC_TUNING,
                .id = fault.numbers ? fault.numbers + k : LOOPS_FAULT_NUMBER(LOOPS_FAULT_MOST, k)};
    }
    return f->row && f->number ? 0 : APC_ENOMEM;
}

/* With its plant, whose disturbances and parameters have names; not with one of the user's own, which would be loaded. */
static int read_faulty_experiment(struct experiment *e, struct apc_store *store, struct apc_error *why)
{
    struct experiment described = {.file = ""};
    int64_t revision;
    int rc = experiment_stored(e, store, &revision, why);
    if (rc <= 0 || e->plant.external || is_of_user(e->plant.name))
        return rc;
    rc = experiment_parse(&described, &(struct experiment_source){.file = e->file, .text = e->text},
                          EXPERIMENT_MODEL, NULL, why);
    experiment_free(e);
    *e = described;
    return rc < 0 ? rc : 1;
}

int faults_open(struct faults *f, struct apc_store *store, struct apc_error *why)
{
    *f = (struct faults){.n = 0};
    int rc = read_faulty_experiment(&f->e, store, why);
    while (rc > 0 && experiment_fault(&f->e, f->n).kind)
        f->n++;
    if (rc >= 0 && make_rows(f) < 0)
        return apc_fail(why, APC_ENOMEM, "out of memory");
    if (rc >= 0 && ((rc = apc_store_read(store, f->row, f->n)) < 0 ||
                    (rc = apc_store_read(store, f->number, f->n * FAULT_NUMBERS)) < 0))
        apc_fail(why, rc, "%s", apc_store_error(store));
    for (size_t i = 0; i < f->n && rc >= 0; i++) /* since when it is as it is */
        if (f->row[i].value != 0 && number_of(f, i, FAULT_BECAME) > 0)
            f->row[i].time = f->number[i * FAULT_NUMBERS + FAULT_BECAME].time;
    return rc < 0 ? rc : 0;
}

void faults_close(struct faults *f)
{
    experiment_free(&f->e);
    free(f->row);
    free(f->number);
}

bool faults_listed(const struct faults *f, size_t i)
{
    return f->row[i].seq > 0 || experiment_fault(&f->e, i).of_file;
}

enum fault_state faults_state(const struct faults *f, size_t i)
{
    if (f->row[i].seq > 0 && f->row[i].value == 0)
        return FAULT_STOPPED;
    if (f->row[i].seq > 0 && number_of(f, i, FAULT_BECAME) == FAULT_HELD)
        return FAULT_AT_LIMIT;
    if (f->row[i].seq > 0)
        return (number_of(f, i, FAULT_IF) > 0 || number_of(f, i, FAULT_AT) > 0) &&
                       number_of(f, i, FAULT_BECAME) <= 0
                   ? FAULT_WAITS
                   : FAULT_STARTED;
    return *experiment_fault(&f->e, i).at == FAULT_NEVER ? FAULT_WAITS : FAULT_TIMED;
}

const char *fault_state_name(enum fault_state state)
{
    static const char *const names[] = {"waits", "timed", "started", "stopped", "held"};
    return names[state];
}

/* ---- In words ------------------------------------------------------------------------------- */

/* What is at that place of the experiment; NULL: nothing. */
static const char *name_variable(const struct experiment *e, enum apc_table table, int id)
{
    const size_t at = (size_t)id - 1;
    if (table == APC_ALARM)
        return at < e->n_alarms ? e->alarm[at].name : NULL;
    if (table == APC_SENSOR)
        return at < e->dim.ny + e->n_signals ? e->y[at].tag.name : NULL;
    if (table == APC_SETPOINT)
        return at < e->dim.nz ? e->z[at].tag.name : NULL;
    return table == APC_ACTUATOR && at < e->dim.nu ? e->u[at].tag.name : NULL;
}

const char *faults_words(const struct faults *f, size_t i, char text[FAULT_TEXT])
{
    const struct experiment_fault fault = experiment_fault(&f->e, i);
    const double condition = number_of(f, i, FAULT_IF);
    size_t n = 0;
    text[0] = '\0';
    for (int k = FAULT_SIZE; k <= FAULT_AT && fault.numbers; k++)
        if (k <= FAULT_HIGH ? (fault.takes & 1U << k) != 0 : number_of(f, i, (enum fault_number)k) > 0)
            n += (size_t)snprintf(text + n, FAULT_TEXT - n, "%s%s=%.15g", n ? " " : "", setting[k],
                                  number_of(f, i, (enum fault_number)k));
    if (condition > 0 && condition <= FAULT_IF_ALARM) {
        const char *name = name_variable(&f->e, (enum apc_table)number_of(f, i, FAULT_IF_TABLE),
                                         (int)number_of(f, i, FAULT_IF_ID));
        if (condition >= FAULT_IF_ALARM)
            snprintf(text + n, FAULT_TEXT - n, "%swhen=alarm %s", n ? " " : "", name ? name : "");
        else
            snprintf(text + n, FAULT_TEXT - n, "%swhen=%s %s %.15g", n ? " " : "", name ? name : "",
                     relation[(int)condition], number_of(f, i, FAULT_IF_LIMIT));
    }
    return text;
}

void faults_json(const struct faults *f, struct text *t)
{
    char with[FAULT_TEXT];
    json_add(t, "{faults:[");
    for (size_t i = 0; i < f->n; i++) {
        if (!faults_listed(f, i))
            continue;
        const struct experiment_fault fault = experiment_fault(&f->e, i);
        const apc_ns since = f->row[i].seq > 0 ? f->row[i].time : JSON_NONE;
        json_add(t, "{number:%zu, signal:%s, kind:%s, settings:%s, state:%s, since:%.6jd}", i + 1,
                 fault.signal, fault.kind, faults_words(f, i, with), fault_state_name(faults_state(f, i)),
                 (intmax_t)since);
    }
    json_add(t, "]}");
}

/* ---- Found ---------------------------------------------------------------------------------- */

/* The next word of *@p text, which goes behind it. "": there is none. */
static const char *take_fault_word(const char **text, char word[FAULT_TEXT])
{
    const char *from = *text + strspn(*text, " ");
    const size_t n = strcspn(from, " ");
    snprintf(word, FAULT_TEXT, "%.*s", (int)n, from);
    *text = from + n;
    return word;
}

/* Among those of table @p table: number, 0: none is called so. */
static int find_faulty(const struct experiment *e, enum apc_table table, const char *name)
{
    int id = 1;
    const char *at;
    while ((at = name_variable(e, table, id)) && strcmp(at, name) != 0)
        id++;
    return at ? id : 0;
}

static int read_fault_condition(const struct experiment *e, const char *text, double number[FAULT_NUMBERS],
                                struct apc_error *why)
{
    static const enum apc_table tables[] = {APC_SENSOR, APC_SETPOINT, APC_ACTUATOR};
    char name[FAULT_TEXT], sign[FAULT_TEXT], value[FAULT_TEXT];
    const char *rest = text;
    take_fault_word(&rest, name);
    const bool alarm = !strcmp(name, "alarm");
    take_fault_word(&rest, alarm ? name : sign);
    int id = alarm ? find_faulty(e, APC_ALARM, name) : 0, is = alarm ? FAULT_IF_ALARM : FAULT_IF_NOT_BELOW;
    enum apc_table table = APC_ALARM;
    for (size_t i = 0; i < sizeof tables / sizeof *tables && !alarm && id == 0; i++)
        id = find_faulty(e, table = tables[i], name);
    while (!alarm && is > 0 && strcmp(relation[is], sign) != 0)
        is--;
    if (is == 0 || (!alarm && apc_number_parse(take_fault_word(&rest, value), &number[FAULT_IF_LIMIT]) < 0) ||
        rest[strspn(rest, " ")])
        return apc_fail(why, APC_EINVAL, "when=\"%.80s\": expected SIGNAL < NUMBER, <=, >, >=, or alarm NAME",
                        text);
    if (fabs(number[FAULT_IF_LIMIT]) >= APC_VALUE_MAX)
        return apc_fail(why, APC_EINVAL, "when=\"%.80s\": the number must be below %g", text, APC_VALUE_MAX);
    if (id == 0)
        return apc_fail(why, APC_ENOTFOUND, "when=\"%.80s\": there is no %s \"%s\"", text,
                        alarm ? "alarm" : "signal", name);
    number[FAULT_IF] = is;
    number[FAULT_IF_TABLE] = table;
    number[FAULT_IF_ID] = id;
    return 0;
}

/* A number of it has to be within these. */
static int check_fault_number(const struct experiment *e, const struct experiment_fault *fault, int k,
                              double value, struct apc_error *why)
{
    const bool output = fault->of == FAULT_OF_ACTUATOR;
    double low = -APC_VALUE_MAX / 2, high = APC_VALUE_MAX / 2;
    if (k >= FAULT_DURATION) {
        low = 0;
        high = LATEST;
    } else if (k >= FAULT_LOW) { /* of outputs alone */
        low = e->u[fault->k].tag.low;
        high = e->u[fault->k].tag.high;
    } else if (output || !strcmp(fault->kind, "noise")) {
        low = 0;
    }
    return value >= low && value <= high
               ? 0
               : apc_fail(why, APC_EINVAL, "%s=%.15g: must be %.15g to %.15g", setting[k], value, low, high);
}

/* "size=2": which, and checked. */
static int read_fault_setting(const struct experiment *e, const struct experiment_fault *fault,
                              const char *word, double number[FAULT_NUMBERS], unsigned *given,
                              struct apc_error *why)
{
    const char *equals = strchr(word, '=');
    const size_t n = equals ? (size_t)(equals - word) : strlen(word);
    int k = FAULT_AT;
    while (k >= 0 && (strlen(setting[k]) != n || strncmp(setting[k], word, n) != 0))
        k--;
    if (k < 0 || (k <= FAULT_HIGH && !(fault->takes & 1U << k)))
        return apc_fail(why, APC_EINVAL, "a fault of kind \"%s\" has no %.*s", fault->kind, (int)n, word);
    if (!equals || apc_number_parse(equals + 1, &number[k]) < 0)
        return apc_fail(why, APC_EINVAL, "\"%s\": expected %s=NUMBER", word, setting[k]);
    *given |= 1U << k;
    return check_fault_number(e, fault, k, number[k], why);
}

static int read_fault_settings(const struct experiment *e, const struct experiment_fault *fault,
                               const char *text, double number[FAULT_NUMBERS], struct apc_error *why)
{
    unsigned given = 0;
    char word[FAULT_TEXT];
    int rc = 0;
    for (text += strspn(text, " "); *text && rc == 0; text += strspn(text, " ")) {
        if (!strncmp(text, "when=", 5))
            return fault->takes & ~given
                       ? apc_fail(why, APC_EINVAL, "expected size and the like before when=")
                       : read_fault_condition(e, text + 5, number, why);
        take_fault_word(&text, word);
        rc = read_fault_setting(e, fault, word, number, &given, why);
    }
    for (int k = FAULT_SIZE; k <= FAULT_HIGH && rc == 0; k++)
        if (fault->takes & ~given & 1U << k)
            rc = apc_fail(why, APC_EINVAL, "a fault of kind \"%s\" needs %s=NUMBER", fault->kind, setting[k]);
    if (rc == 0 && number[FAULT_HIGH] < number[FAULT_LOW])
        rc = apc_fail(why, APC_EINVAL, "low=%.15g: must be at most high=%.15g", number[FAULT_LOW],
                      number[FAULT_HIGH]);
    return rc;
}

/* What there is of that signal, or which signals there are. */
static int refuse_fault(const struct faults *f, const char *signal, const char *kind, struct apc_error *why)
{
    char kinds[160] = "";
    size_t n = 0;
    struct nearest nearest = {.wanted = signal};
    for (size_t i = 0; i < f->n; i++) {
        const struct experiment_fault fault = experiment_fault(&f->e, i);
        nearest_look(&nearest, fault.signal);
        if (fault.numbers && !strcmp(fault.signal, signal) && n < sizeof kinds)
            n += (size_t)snprintf(kinds + n, sizeof kinds - n, "%s%s", n ? ", " : "", fault.kind);
    }
    if (n > 0)
        return apc_fail(why, APC_ENOTFOUND, "%s has no fault \"%s\": there are %s", signal, kind, kinds);
    return apc_fail(why, APC_ENOTFOUND,
                    "there is no measurement, output, controller, disturbance or parameter \"%s\"%s%s%s",
                    signal, nearest.name ? ": did you mean " : "", nearest.name ? nearest.name : "",
                    nearest.name ? "?" : "");
}

static int find_listed_fault(const struct faults *f, double number, struct fault_order *order,
                             struct apc_error *why)
{
    const bool there = number >= 1 && number <= (double)f->n && number == (double)(size_t)number;
    if (!there || !faults_listed(f, (size_t)number - 1))
        return apc_fail(why, APC_ENOTFOUND, "there is no fault %.15g in the list", number);
    order->i = (size_t)number - 1;
    for (int k = 0; k < FAULT_BECAME && experiment_fault(&f->e, order->i).numbers; k++)
        order->number[k] = number_of(f, order->i, (enum fault_number)k);
    return 0;
}

int faults_find(const struct faults *f, const char *text, bool start, struct fault_order *order,
                struct apc_error *why)
{
    char signal[FAULT_TEXT], kind[FAULT_TEXT];
    const char *rest = text;
    double number;
    *order = (struct fault_order){.i = 0};
    if (apc_number_parse(text, &number) == 0)
        return find_listed_fault(f, number, order, why);
    if (strlen(text) >= FAULT_TEXT) /* so that no word is cut */
        return apc_fail(why, APC_EINVAL, "a fault of %zu bytes: at most %d", strlen(text), FAULT_TEXT - 1);
    take_fault_word(&rest, signal);
    take_fault_word(&rest, kind);
    if (!strcmp(signal, "plant") && !strcmp(kind, "power") && !rest[strspn(rest, " ")]) {
        order->i = SIZE_MAX;
        return 0;
    }
    for (size_t i = 0; i < f->n; i++) {
        const struct experiment_fault fault = experiment_fault(&f->e, i);
        if (!fault.numbers || strcmp(fault.signal, signal) != 0 || strcmp(fault.kind, kind) != 0)
            continue;
        order->i = i;
        if (!strcmp(kind, "reverse") &&
            !(f->e.u[fault.k].tag.low > -APC_VALUE_MAX && f->e.u[fault.k].tag.high < APC_VALUE_MAX))
            return apc_fail(why, APC_EINVAL,
                            "a fault of kind \"reverse\" swaps the limits: output %s has none", signal);
        return start ? read_fault_settings(&f->e, &fault, rest, order->number, why) : 0;
    }
    return refuse_fault(f, signal, kind, why);
}

/* ---- Written -------------------------------------------------------------------------------- */

static bool is_power(const struct experiment_fault *fault)
{
    return fault->numbers &&
           (fault->of == FAULT_OF_SENSOR ? !strcmp(fault->kind, "dropout")
                                         : fault->of == FAULT_OF_ACTUATOR && !strcmp(fault->kind, "power"));
}

int faults_order(const struct faults *f, struct apc_store *store, const struct fault_order *order, bool start,
                 const char *who)
{
    const int author = apc_store_author(store, who);
    const struct apc_sample any = {.table = APC_OPMODE,
                                   .seq = APC_SEQ_ANY,
                                   .author = author > 0 ? (uint32_t)author : 0,
                                   .time = apc_clock_utc(NULL)};
    struct apc_sample *rows = author < 0 ? NULL : calloc(f->n + 1, (1 + FAULT_NUMBERS) * sizeof *rows);
    size_t n = 0;
    for (size_t i = 0; rows && i < f->n; i++) {
        const struct experiment_fault fault = experiment_fault(&f->e, i);
        if (order->i == SIZE_MAX ? !is_power(&fault) : i != order->i)
            continue;
        for (int k = 0; start && fault.numbers && k < FAULT_NUMBERS; k++) {
            rows[n] = any;
            rows[n].table = APC_TUNING;
            rows[n].id = fault.numbers + k;
            rows[n++].value = order->number[k];
        }
        rows[n] = any;
        rows[n].id = fault.row;
        rows[n++].value = start;
    }
    const int rc = author < 0 ? author : rows ? apc_store_put(store, rows, n) : APC_ENOMEM;
    free(rows);
    return rc;
}

/* SPDX-License-Identifier: BSD-3-Clause */
/* Expectations as text: a word after the other, names by the experiment's. */
#include "check_internal.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "figures/figures.h"
#include "files/files.h"

#define WORDS    24
#define ITS_TIME (-1) /* until: its time after it begins */

struct word {
    char text[APC_TAG_LEN * 2];
    bool quoted; /* it is a name */
};

struct expectation_text {
    const struct experiment *e;
    struct check_sources *sources;
    struct word word[WORDS];
    size_t n, at;
    apc_ns duration;
    struct apc_error *why;
    int rc;
};

/* ---- Words ---------------------------------------------------------------------------------- */

static void refuse_words(struct expectation_text *t, const char *fmt, ...) APC_PRINTF(2, 3);
static void refuse_words(struct expectation_text *t, const char *fmt, ...)
{
    char text[300];
    va_list args;
    if (t->rc < 0)
        return;
    va_start(args, fmt);
    vsnprintf(text, sizeof text, fmt, args);
    va_end(args);
    t->rc = apc_fail(t->why, APC_EINVAL, "%s", text);
}

/* How long the word at @p from is; blanks and relations are between words, a name may stand in quotes. */
static size_t length_of_word(const char *from)
{
    const char *end = *from == '\'' ? strchr(from + 1, '\'') : NULL;
    if (end)
        return (size_t)(end - from) + 1;
    if (*from == '<' || *from == '>')
        return from[1] == '=' ? 2 : 1;
    return strcspn(from, " \t\r\n<>");
}

static void split_words(struct expectation_text *t, const char *text)
{
    for (text += strspn(text, " \t\r\n"); *text; text += strspn(text, " \t\r\n")) {
        const size_t n = length_of_word(text);
        struct word *word = &t->word[t->n];
        if (t->n == WORDS || n >= sizeof word->text) {
            refuse_words(t, "has too many words, or too long ones");
            return;
        }
        word->quoted = *text == '\'' && n > 1;
        snprintf(word->text, sizeof word->text, "%.*s", (int)(word->quoted ? n - 2 : n), text + word->quoted);
        t->n++;
        text += n;
    }
}

static const char *present_word(const struct expectation_text *t)
{
    return t->at < t->n ? t->word[t->at].text : "";
}

static bool take_word(struct expectation_text *t, const char *word)
{
    const bool is = t->at < t->n && !t->word[t->at].quoted && !strcmp(t->word[t->at].text, word);
    t->at += is;
    return is;
}

/* What stands there is none of what may. */
static void expect_words(struct expectation_text *t, const char *wanted)
{
    if (t->at < t->n)
        refuse_words(t, "expected %s, not \"%s\"", wanted, present_word(t));
    else
        refuse_words(t, "expected %s at its end", wanted);
}

static void need_word(struct expectation_text *t, const char *word)
{
    char wanted[40];
    snprintf(wanted, sizeof wanted, "\"%s\"", word);
    if (t->rc == 0 && !take_word(t, word))
        expect_words(t, wanted);
}

static const char *take_name(struct expectation_text *t, const char *what)
{
    if (t->rc == 0 && t->at == t->n)
        expect_words(t, what);
    return t->rc == 0 ? t->word[t->at++].text : "";
}

/* A number, and in @p unit what stands behind it in the same word. */
static double take_number(struct expectation_text *t, const char *what, char unit[8])
{
    char number[APC_TAG_LEN * 2];
    double value = 0;
    const char *word = present_word(t);
    const size_t n = strspn(word, "+-.0123456789"), exponent = strspn(word + n, "eE"),
                 digits = exponent ? strspn(word + n + exponent, "+-0123456789") : 0,
                 length = digits ? n + exponent + digits : n;
    snprintf(number, sizeof number, "%.*s", (int)length, word);
    if (apc_number_parse(number, &value) < 0 || strlen(word + length) >= 8) {
        expect_words(t, what);
        return 0;
    }
    snprintf(unit, 8, "%s", word + length);
    t->at++;
    return value;
}

/* s, min or h, by itself or right behind the number. */
static apc_ns take_time(struct expectation_text *t)
{
    static const char wanted[] = "a time, as 10 s, 5 min or 2 h";
    char unit[8] = "";
    apc_ns ns = 0;
    const size_t at = t->at;
    const double value = t->rc == 0 ? take_number(t, wanted, unit) : 0;
    if (t->rc == 0 && !*unit && t->at < t->n)
        snprintf(unit, sizeof unit, "%.7s", t->word[t->at++].text);
    const double factor = !strcmp(unit, "s") ? 1 : !strcmp(unit, "min") ? 60 : !strcmp(unit, "h") ? 3600 : 0;
    if (t->rc == 0 && (factor == 0 || value < 0 || apc_ns_from_s(value * factor, &ns) < 0)) {
        t->at = at;
        expect_words(t, wanted);
    }
    return ns;
}

/* ---- Names ---------------------------------------------------------------------------------- */

static size_t add_source(struct expectation_text *t, const struct check_source *source)
{
    struct check_sources *all = t->sources;
    for (size_t i = 0; i < all->n; i++)
        if (all->at[i].table == source->table && all->at[i].id == source->id &&
            all->at[i].plant == source->plant)
            return i;
    if (all->n == all->room) {
        const size_t room = all->room ? 2 * all->room : 16;
        struct check_source *at = reallocarray(all->at, room, sizeof *at);
        if (!at) {
            t->rc = t->rc < 0 ? t->rc : apc_fail(t->why, APC_ENOMEM, "out of memory");
            return 0;
        }
        all->at = at;
        all->room = room;
    }
    all->at[all->n] = *source;
    return all->n++;
}

static bool is_signal_called(const struct apc_tag *tag, const char *name)
{
    char address[48];
    snprintf(address, sizeof address, "%s.%d", apc_table_name(tag->table), tag->id);
    return !strcmp(tag->name, name) || !strcmp(address, name);
}

static void refuse_name(struct expectation_text *t, const char *what, const struct nearest *nearest)
{
    refuse_words(t, "there is no %s \"%s\"%s%s%s", what, nearest->wanted,
                 nearest->name ? ": did you mean \"" : "", nearest->name ? nearest->name : "",
                 nearest->name ? "\"?" : "");
}

/* A measurement, an output, a setpoint; of the plant itself only what it has. */
static const struct signal *find_check_signal(struct expectation_text *t, const char *name, bool plant,
                                              const char *what)
{
    const struct experiment *e = t->e;
    const struct {
        const struct signal *at;
        size_t n;
    } lists[] = {
        {e->y, e->dim.ny + (plant ? 0 : e->n_signals)}, {e->u, e->dim.nu}, {e->z, plant ? 0 : e->dim.nz}};
    struct nearest nearest = {.wanted = name};
    for (size_t k = 0; k < sizeof lists / sizeof *lists && t->rc == 0; k++)
        for (size_t i = 0; i < lists[k].n; i++) {
            if (is_signal_called(&lists[k].at[i].tag, name))
                return &lists[k].at[i];
            nearest_look(&nearest, lists[k].at[i].tag.name);
        }
    refuse_name(t, what, &nearest);
    return NULL;
}

/* The times of the record are those of the wall clock. */
static void refuse_stepping_clock(struct expectation_text *t)
{
    if (t->e->models.n_clock > 0)
        refuse_words(t, "the wall clock steps in this experiment, and the record goes by it: only what the "
                        "plant itself does can be judged, as plant y");
}

static size_t source_of_signal(struct expectation_text *t, const struct signal *signal, bool plant)
{
    const struct apc_tag *tag = &signal->tag;
    struct check_source source = {.table = tag->table, .id = tag->id, .plant = plant};
    snprintf(source.name, sizeof source.name, "%s", tag->name);
    snprintf(source.unit, sizeof source.unit, "%s", tag->unit);
    if (tag->table == APC_SENSOR && !plant)
        source.horizon = module_horizon(t->e, (struct wire){tag->table, (size_t)tag->id - 1});
    if (!plant)
        refuse_stepping_clock(t);
    return add_source(t, &source);
}

static void read_check_mode(struct expectation_text *t, struct expectation *x, const char *name)
{
    const struct experiment *e = t->e;
    struct nearest nearest = {.wanted = name};
    struct check_source source = {.table = APC_ACTUAL};
    bool below = false;
    for (size_t i = 0; i < controllers_loops(e) && !source.id && t->rc == 0; i++) {
        const struct controller_loop loop = controllers_loop(e, i);
        const struct apc_tag *output = controllers_output(e, loop);
        char own[APC_TAG_LEN];
        controllers_loop_name(e, loop, own);
        if (!strcmp(own, name) || (output->table != APC_SETPOINT && !strcmp(output->name, name)))
            source.id = apc_variable_number(APC_OPMODE, controllers_loop_id(loop));
        below = controllers_is_below(e, loop);
        nearest_look(&nearest, output->name);
    }
    if (!source.id)
        refuse_name(t, "loop", &nearest);
    need_word(t, "is");
    const char *wanted = take_name(t, "a mode: Man, Auto, Cas or OOS,");
    int mode = APC_MODE_MAN;
    while (t->rc == 0 && apc_mode_name(mode) && strcmp(apc_mode_name(mode), wanted) != 0)
        mode++;
    if (t->rc == 0 && !apc_mode_name(mode))
        refuse_words(t, "there is no mode \"%s\": Man, Auto, Cas, OOS, IMan and LO are", wanted);
    if (mode == APC_MODE_CAS && !below)
        refuse_words(t, "%.60s cannot be in Cas: no controller moves its setpoint", name);
    refuse_stepping_clock(t);
    snprintf(source.name, sizeof source.name, "mode %.50s", name);
    x->kind = CHECK_MODE;
    x->number = mode;
    x->trajectory = add_source(t, &source);
}

static size_t source_of_alarm(struct expectation_text *t, size_t i)
{
    struct check_source source = {.table = APC_ALARM, .id = (int)i + 1};
    snprintf(source.name, sizeof source.name, "%s", t->e->alarm[i].name);
    refuse_stepping_clock(t);
    return add_source(t, &source);
}

static size_t read_check_alarm(struct expectation_text *t)
{
    struct nearest nearest = {.wanted = take_name(t, "the name of an alarm")};
    for (size_t i = 0; i < t->e->n_alarms && t->rc == 0; i++) {
        if (!strcmp(t->e->alarm[i].name, nearest.wanted))
            return source_of_alarm(t, i);
        nearest_look(&nearest, t->e->alarm[i].name);
    }
    if (t->rc == 0 && t->e->n_alarms == 0)
        refuse_words(t, "there is no alarm \"%s\": the experiment has none", nearest.wanted);
    refuse_name(t, "alarm", &nearest);
    return 0;
}

/* ---- Conditions ----------------------------------------------------------------------------- */

/* at fault value, at safe value. */
static void read_special_value(struct expectation_text *t, struct expectation *x, const struct signal *signal)
{
    const bool fault = take_word(t, "fault");
    if (!fault && !take_word(t, "safe"))
        expect_words(t, "\"fault value\" or \"safe value\"");
    need_word(t, "value");
    if (t->rc == 0 && signal->tag.table != APC_ACTUATOR)
        refuse_words(t, "%s is no output: only those have a fault value and a safe one", signal->tag.name);
    if (t->rc < 0)
        return;
    x->kind = fault ? CHECK_FAULT : CHECK_SAFE;
    x->number = fault ? signal->fault : signal->safe;
    x->trajectory = source_of_signal(t, signal, !fault);
}

static bool is_special_value(const struct expectation_text *t)
{
    return t->at + 1 < t->n && !strcmp(t->word[t->at].text, "at") &&
           (!strcmp(t->word[t->at + 1].text, "fault") || !strcmp(t->word[t->at + 1].text, "safe"));
}

static void read_comparison(struct expectation_text *t, struct expectation *x)
{
    static const char *const relation[] = {
        [CHECK_BELOW] = "<", [CHECK_AT_MOST] = "<=", [CHECK_ABOVE] = ">", [CHECK_AT_LEAST] = ">="};
    char unit[8] = "";
    const bool plant = take_word(t, "plant");
    const struct signal *signal = find_check_signal(t, take_name(t, "the name of a signal"), plant,
                                                    plant ? "measurement or output" : "signal");
    if (!signal)
        return;
    if (is_special_value(t)) {
        t->at++;
        read_special_value(t, x, signal);
        return;
    }
    for (int kind = CHECK_BELOW; kind <= CHECK_AT_LEAST && !x->kind; kind++)
        if (take_word(t, relation[kind]))
            x->kind = (enum check_kind)kind;
    if (!x->kind)
        expect_words(t, "<, <=, >, >=, \"at fault value\" or \"at safe value\"");
    x->number = t->rc == 0 ? take_number(t, "a number", unit) : 0;
    if (t->rc == 0 && *unit)
        refuse_words(t, "\"%s\" behind a number: it is in the unit of %s%s%s, without saying so", unit,
                     signal->tag.name, *signal->tag.unit ? ", " : "", signal->tag.unit);
    if (t->rc == 0)
        x->trajectory = source_of_signal(t, signal, plant);
}

static void read_condition(struct expectation_text *t, struct expectation *x)
{
    if (take_word(t, "alarm")) {
        x->kind = CHECK_ALARM;
        x->trajectory = read_check_alarm(t);
    } else if (take_word(t, "mode")) {
        read_check_mode(t, x, take_name(t, "the name of a loop"));
    } else {
        read_comparison(t, x);
    }
}

/* ---- Forms ---------------------------------------------------------------------------------- */

/* The setpoint that the laws pair a measurement with. */
static size_t check_setpoint_of(struct expectation_text *t, const struct signal *y)
{
    struct loop *loop = calloc(controllers_loops(t->e) + 1, sizeof *loop);
    const int n = loop ? metrics_loops(t->e, loop) : APC_ENOMEM;
    size_t trajectory = SIZE_MAX;
    for (int i = 0; i < n && trajectory == SIZE_MAX; i++)
        if (y->tag.table == APC_SENSOR && loop[i].y + 1 == (size_t)y->tag.id)
            trajectory = source_of_signal(t, &t->e->z[loop[i].z], false);
    free(loop);
    if (n < 0)
        t->rc = apc_fail(t->why, APC_ENOMEM, "out of memory");
    else if (trajectory == SIZE_MAX)
        refuse_words(t, "%s is the measurement of no loop: it has no setpoint to settle at", y->tag.name);
    return trajectory;
}

static void read_settling(struct expectation_text *t, struct expectation *x)
{
    char unit[8] = "";
    const bool plant = take_word(t, "plant");
    const struct signal *y =
        find_check_signal(t, take_name(t, "the name of a measurement"), plant, "measurement");
    need_word(t, "within");
    x->number = t->rc == 0 ? take_number(t, "a number", unit) : 0;
    x->percent = !strcmp(unit, "%") || take_word(t, "%");
    if (t->rc == 0 && (!(x->number > 0) || (*unit && !x->percent)))
        refuse_words(t, "expected a number above 0 behind \"within\", in the unit of %s or in %%",
                     y->tag.name);
    need_word(t, "in");
    x->time = take_time(t);
    if (t->rc == 0)
        x->setpoint = check_setpoint_of(t, y);
    if (t->rc == 0)
        x->trajectory = source_of_signal(t, y, plant);
}

static void read_acknowledging(struct expectation_text *t, struct expectation *x)
{
    need_word(t, "acknowledges");
    x->kind = CHECK_ALARM;
    if (t->rc == 0 && t->e->n_alarms == 0)
        refuse_words(t, "the experiment has no alarms to acknowledge");
    if (take_word(t, "within")) {
        t->at--;
        x->all = true;
        for (size_t i = 0; i < t->e->n_alarms && t->rc == 0; i++)
            x->trajectory = source_of_alarm(t, i);
    } else {
        x->trajectory = read_check_alarm(t);
    }
    need_word(t, "within");
    x->time = take_time(t);
}

static void read_check_form(struct expectation_text *t, struct expectation *x)
{
    if (take_word(t, "never") || take_word(t, "always")) {
        x->form = !strcmp(t->word[t->at - 1].text, "never") ? CHECK_NEVER : CHECK_ALWAYS;
        read_condition(t, x);
    } else if (take_word(t, "within")) {
        x->form = CHECK_WITHIN;
        x->time = take_time(t);
        x->until = ITS_TIME;
        read_condition(t, x);
    } else if (take_word(t, "settles")) {
        x->form = CHECK_SETTLES;
        read_settling(t, x);
    } else if (take_word(t, "operator")) {
        x->form = CHECK_ACKNOWLEDGES;
        read_acknowledging(t, x);
    } else {
        x->form = CHECK_AT;
        read_condition(t, x);
        if (take_word(t, "by")) {
            x->form = CHECK_WITHIN;
            x->until = take_time(t);
        } else if (take_word(t, "at")) {
            x->until = take_time(t);
        }
    }
}

/* from TIME, until TIME: what is looked at. */
static void read_window(struct expectation_text *t, struct expectation *x)
{
    const bool open = x->form != CHECK_AT && x->form != CHECK_WITHIN;
    while (t->rc == 0 && t->at < t->n) {
        if (x->form != CHECK_AT && take_word(t, "from"))
            x->from = take_time(t);
        else if (open && take_word(t, "until"))
            x->until = take_time(t);
        else
            expect_words(t, x->form == CHECK_AT ? "nothing more"
                            : open              ? "\"from\", \"until\" or nothing more"
                                                : "\"from\" or nothing more");
    }
    if (x->until == ITS_TIME)
        x->until = x->from + x->time;
    const apc_ns done = open ? x->from + x->time : 0, latest = done > x->until ? done : x->until;
    if (t->rc == 0 && (latest > t->duration || x->from >= t->duration))
        refuse_words(t, "can never be judged: the run ends at %.10g s, before %.10g s",
                     apc_ns_to_s(t->duration), apc_ns_to_s(latest > x->from ? latest : x->from));
    if (t->rc == 0 && x->until < x->from)
        refuse_words(t, "can never be judged: it ends at %.10g s, before it begins at %.10g s",
                     apc_ns_to_s(x->until), apc_ns_to_s(x->from));
}

/* @p condition: it is one alone, called @p text; NULL: @p text says all. */
static int parse_expectation(struct expectation *x, const char *text, const char *condition,
                             const struct experiment *e, struct check_sources *sources, struct apc_error *why)
{
    struct apc_error of_words = {""};
    struct expectation_text t = {.e = e, .sources = sources, .why = &of_words};
    *x = (struct expectation){.form = CHECK_WITHIN};
    snprintf(x->text, sizeof x->text, "%s", text);
    (void)apc_ns_from_s(e->duration, &t.duration);
    x->until = t.duration;
    if (strlen(text) >= sizeof x->text)
        refuse_words(&t, "is longer than %d bytes", CHECK_TEXT - 1);
    split_words(&t, condition ? condition : text);
    if (t.rc == 0 && condition)
        read_condition(&t, x);
    else if (t.rc == 0)
        read_check_form(&t, x);
    if (t.rc == 0 && condition && t.at < t.n)
        expect_words(&t, "nothing more");
    else if (t.rc == 0)
        read_window(&t, x);
    return t.rc < 0 ? apc_fail(why, t.rc, "\"%.80s\": %s", condition ? condition : text, of_words.text) : 0;
}

int check_parse(struct expectation *x, const char *text, const struct experiment *e,
                struct check_sources *sources, struct apc_error *why)
{
    return parse_expectation(x, text, NULL, e, sources, why);
}

int check_parse_when(struct expectation *x, const char *text, const char *condition,
                     const struct experiment *e, struct check_sources *sources, struct apc_error *why)
{
    return parse_expectation(x, text, condition, e, sources, why);
}

/* SPDX-License-Identifier: BSD-3-Clause */
/* Records from files: first the values of each signal by their times, then a grid laid over them. */
#include "identify.h"

#include <errno.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>

#define COLUMNS_MOST 256
#define SAMPLES_MOST 1000000
#define PARTS        10   /* of the median interval that are tried as the period */
#define ALIKE        0.25 /* of a period is how far a sample may be from the grid */

struct series {
    const char *name; /* NULL: not given */
    char own[APC_TAG_LEN];
    double *t, *value; /* NAN: Bad */
    size_t n, room;
};

struct reading {
    const char *file;
    const struct identify_wish *wish;
    struct series input[IDENTIFY_SIGNALS], output[IDENTIFY_SIGNALS];
    size_t inputs, outputs;
    struct apc_error *why;
};

static bool grow(double **at, size_t room)
{
    double *more = reallocarray(*at, room, sizeof **at);

    if (more)
        *at = more;
    return more != NULL;
}

static int add(struct reading *r, struct series *s, double t, double value)
{
    if (s->n == s->room) {
        const size_t room = s->room ? 2 * s->room : 1024;

        if (!grow(&s->t, room) || !grow(&s->value, room))
            return apc_fail(r->why, APC_ENOMEM, "out of memory");
        s->room = room;
    }
    s->t[s->n] = t;
    s->value[s->n++] = value;
    return 0;
}

/* The next field of a line, without quotes and blanks around it. */
static char *field(char **rest)
{
    char *at = strsep(rest, ",");

    if (!at)
        return NULL;
    at += strspn(at, " \t\"");
    at[strcspn(at, "\"\r\n")] = '\0';
    for (size_t n = strlen(at); n > 0 && strchr(" \t", at[n - 1]); n--)
        at[n - 1] = '\0';
    return at;
}

static FILE *open_file(struct reading *r, const char *path)
{
    FILE *in = fopen(path, "re");

    if (!in)
        apc_fail(r->why, errno == ENOENT ? APC_ENOTFOUND : APC_ESYS, "%s: %s", path, strerror(errno));
    return in;
}

static bool within(const struct reading *r, double t)
{
    return t >= r->wish->from && (r->wish->to <= 0.0 || t <= r->wish->to);
}

/* ---- CSV with names -------------------------------------------------------------------------------- */

static int name_columns(struct reading *r, char *line, struct series **column, size_t *time)
{
    char *rest = line, *name;
    size_t n = 0;

    *time = COLUMNS_MOST;
    for (; (name = field(&rest)); n++) {
        if (n == COLUMNS_MOST)
            return apc_fail(r->why, APC_EINVAL, "%s:1: more than %d columns", r->file, COLUMNS_MOST);
        column[n] = NULL;
        if (!strcmp(name, "time") || !strcmp(name, "t"))
            *time = n;
        for (size_t i = 0; i < r->inputs; i++)
            column[n] = !strcmp(name, r->input[i].name) ? &r->input[i] : column[n];
        for (size_t i = 0; i < r->outputs; i++)
            column[n] = !strcmp(name, r->output[i].name) ? &r->output[i] : column[n];
    }
    for (size_t i = 0; i < r->inputs + r->outputs; i++) {
        const struct series *s = i < r->inputs ? &r->input[i] : &r->output[i - r->inputs];
        size_t c = 0;

        while (c < n && column[c] != s)
            c++;
        if (c == n)
            return apc_fail(r->why, APC_ENOTFOUND, "%s:1: there is no column \"%s\"", r->file, s->name);
    }
    if (*time == COLUMNS_MOST && r->wish->period <= 0.0)
        return apc_fail(r->why, APC_EINVAL,
                        "%s:1: there is no column \"time\", in s: --period S says how far apart the rows are",
                        r->file);
    return 0;
}

static int read_row(struct reading *r, char *line, struct series **column, size_t time, size_t row)
{
    double t = (double)row * r->wish->period, value[COLUMNS_MOST];
    char *rest = line, *text;
    size_t n = 0;
    int rc = 0;

    for (; n < COLUMNS_MOST && (text = field(&rest)); n++) {
        value[n] = (double)NAN;
        if ((column[n] || n == time) && apc_number_parse(text, &value[n]) < 0) {
            if (n == time || (*text && strcasecmp(text, "nan") != 0))
                return apc_fail(r->why, APC_EPROTO,
                                "%s:%zu: \"%.40s\" is no number; what is missing is empty or NaN", r->file,
                                row + 2, text);
            value[n] = (double)NAN;
        }
    }
    if (time < n)
        t = value[time];
    for (size_t i = 0; i < n && rc == 0; i++) {
        struct series *s = column[i];

        if (s && s->n > 0 && !(t > s->t[s->n - 1]))
            return apc_fail(r->why, APC_EPROTO, "%s:%zu: the time %g s is not after that of the row before",
                            r->file, row + 2, t);
        if (s && within(r, t))
            rc = add(r, s, t, value[i]);
    }
    return rc;
}

static int read_csv(struct reading *r)
{
    struct series *column[COLUMNS_MOST];
    char *line = NULL;
    size_t size = 0, time = COLUMNS_MOST, row = 0;
    FILE *in = open_file(r, r->file);
    int rc = 0;

    if (!in)
        return APC_ENOTFOUND;
    if (r->inputs == 0 || r->outputs == 0)
        rc = apc_fail(r->why, APC_EINVAL, "%s: --inputs and --outputs must name columns", r->file);
    else if (getline(&line, &size, in) < 0)
        rc = apc_fail(r->why, APC_EPROTO, "%s: it is empty", r->file);
    else
        rc = name_columns(r, line, column, &time);
    while (rc == 0 && getline(&line, &size, in) >= 0) {
        if (line[strspn(line, " \t\r\n")])
            rc = read_row(r, line, column, time, row);
        row++;
    }
    free(line);
    fclose(in);
    return rc;
}

/* ---- Run folders ----------------------------------------------------------------------------------- */

/* What a table and an id of the run are to us: the wished-for signals of that name, or all of the table. */
struct known {
    enum apc_table table;
    int id;
    char name[APC_TAG_LEN];
};

static int read_known(struct reading *r, struct known *known, size_t *n)
{
    char path[600], *line = NULL;
    size_t size = 0;
    FILE *in;

    *n = 0;
    snprintf(path, sizeof path, "%.560s/signals.csv", r->file);
    in = open_file(r, path);
    if (!in)
        return APC_ENOTFOUND;
    while (*n < COLUMNS_MOST && getline(&line, &size, in) >= 0) {
        char *rest = line, *table = field(&rest), *id = field(&rest), *name = field(&rest);

        if (!name || !apc_table_parse(table) || strlen(name) >= APC_TAG_LEN)
            continue;
        known[*n].table = apc_table_parse(table);
        known[*n].id = (int)strtol(id, NULL, 10);
        snprintf(known[(*n)++].name, sizeof known->name, "%s", name);
    }
    free(line);
    fclose(in);
    return 0;
}

/* Of one name an actuator goes before a setpoint, and that before a measurement. */
static int rank(enum apc_table table)
{
    return table == APC_ACTUATOR ? 3 : table == APC_SETPOINT ? 2 : table == APC_SENSOR ? 1 : 0;
}

static int choose(struct reading *r, struct series *s, const struct known *known, size_t n, bool input,
                  struct series **of)
{
    size_t found = n;

    for (size_t i = 0; i < n; i++) {
        if (!strcmp(known[i].name, s->name) &&
            (input ? rank(known[i].table) > 0 : known[i].table == APC_SENSOR) &&
            (found == n || rank(known[i].table) > rank(known[found].table)))
            found = i;
    }
    if (found == n)
        return apc_fail(r->why, APC_ENOTFOUND, "%s: there is no %s \"%s\"; signals.csv has what there is",
                        r->file, input ? "output, setpoint or measurement" : "measurement", s->name);
    if (of[found])
        return apc_fail(r->why, APC_EINVAL, "%s: \"%s\" is named twice", r->file, s->name);
    of[found] = s;
    return 0;
}

/* All of a table where none is named. */
static void take_all(struct series *series, size_t *n, const struct known *known, size_t n_known,
                     enum apc_table table)
{
    for (size_t i = 0; i < n_known && *n < IDENTIFY_SIGNALS; i++) {
        if (known[i].table != table)
            continue;
        snprintf(series[*n].own, sizeof series->own, "%s", known[i].name);
        series[*n].name = series[*n].own;
        ++*n;
    }
}

static int read_sample(struct reading *r, char *line, const struct known *known, size_t n, struct series **of,
                       size_t number)
{
    char *rest = line, *t = field(&rest), *table = field(&rest), *id = field(&rest), *status = field(&rest),
         *value = field(&rest);
    double time, number_of = (double)NAN;
    apc_status code;

    if (!value || apc_number_parse(t, &time) < 0 || apc_status_parse(status, &code) < 0 ||
        apc_number_parse(value, &number_of) < 0)
        return apc_fail(r->why, APC_EPROTO, "%s/samples.csv:%zu: expected time,table,id,status,value",
                        r->file, number);
    for (size_t i = 0; i < n; i++) {
        if (of[i] && known[i].table == apc_table_parse(table) && known[i].id == strtol(id, NULL, 10) &&
            within(r, time))
            return add(r, of[i], time, apc_status_severity(code) == APC_BAD ? (double)NAN : number_of);
    }
    return 0;
}

static int read_run(struct reading *r)
{
    struct known *known = calloc(COLUMNS_MOST, sizeof *known);
    struct series *of[COLUMNS_MOST] = {NULL};
    char path[600], *line = NULL;
    size_t n = 0, size = 0, number = 1;
    FILE *in = NULL;
    int rc = known ? read_known(r, known, &n) : apc_fail(r->why, APC_ENOMEM, "out of memory");

    if (rc == 0 && r->inputs == 0)
        take_all(r->input, &r->inputs, known, n, APC_ACTUATOR);
    if (rc == 0 && r->outputs == 0)
        take_all(r->output, &r->outputs, known, n, APC_SENSOR);
    for (size_t i = 0; i < r->inputs && rc == 0; i++)
        rc = choose(r, &r->input[i], known, n, true, of);
    for (size_t i = 0; i < r->outputs && rc == 0; i++)
        rc = choose(r, &r->output[i], known, n, false, of);
    snprintf(path, sizeof path, "%.560s/samples.csv", r->file);
    if (rc == 0 && !(in = open_file(r, path)))
        rc = APC_ENOTFOUND;
    while (rc == 0 && getline(&line, &size, in) >= 0) {
        if (number++ > 1)
            rc = read_sample(r, line, known, n, of, number - 1);
    }
    if (in)
        fclose(in);
    free(line);
    free(known);
    return rc;
}

/* ---- The grid -------------------------------------------------------------------------------------- */

static int by_size(const void *a, const void *b)
{
    const double x = *(const double *)a, y = *(const double *)b;

    return (x > y) - (x < y);
}

/* How many samples of a series are near a grid that begins with it. */
static size_t near_grid(const struct series *s, double Ts)
{
    size_t n = 0;

    for (size_t k = 0; k < s->n; k++) {
        const double periods = (s->t[k] - s->t[0]) / Ts;

        n += fabs(periods - round(periods)) <= ALIKE;
    }
    return n;
}

/* The median interval, or a part of it where samples are 2, 3, 2, 3, ... periods apart, to the microsecond;
 * so that it fits the whole series. */
static int find_period(struct reading *r, const struct series *s, double *Ts)
{
    double *apart = calloc(s->n + 1, sizeof *apart), span, median;
    size_t near = 0;

    *Ts = r->wish->period;
    if (!apart)
        return apc_fail(r->why, APC_ENOMEM, "out of memory");
    for (size_t k = 0; k + 1 < s->n; k++)
        apart[k] = s->t[k + 1] - s->t[k];
    if (s->n > 2)
        qsort(apart, s->n - 1, sizeof *apart, by_size);
    median = s->n > 2 ? apart[(s->n - 1) / 2] : 0.0;
    free(apart);
    if (s->n < 3)
        return apc_fail(r->why, APC_EINVAL,
                        "%s: %zu samples of \"%s\" in that time: there is nothing to tell from", r->file,
                        s->n, s->name);
    span = s->t[s->n - 1] - s->t[0];
    for (int part = 1; part <= PARTS && *Ts <= 0.0; part++) {
        double period = span / round(span / median * part);

        period = period > 1e-3 ? round(period * 1e6) / 1e6 : period;
        if (part == 1)
            near = near_grid(s, period);
        if ((double)near_grid(s, period) >= 0.9 * (double)s->n)
            *Ts = period;
    }
    return *Ts > 0.0
               ? 0
               : apc_fail(r->why, APC_EINVAL,
                          "%s: the sample times of \"%s\" change: of %zu samples %zu are on a grid of %g s. "
                          "Record at one period, or name one by --period",
                          r->file, s->name, s->n, near, median);
}

/* Of a series what is near each time of the grid. */
static void lay(const struct series *s, const struct identify_data *d, size_t stride, double *to)
{
    size_t i = 0;

    for (size_t k = 0; k < d->record.n; k++) {
        const double t = d->begin + (double)k * d->record.Ts;

        while (i + 1 < s->n && fabs(s->t[i + 1] - t) <= fabs(s->t[i] - t))
            i++;
        to[k * stride] = s->n > 0 && fabs(s->t[i] - t) <= ALIKE * d->record.Ts ? s->value[i] : (double)NAN;
    }
}

/* What was in force at each time of the grid. */
static void hold(const struct series *s, const struct identify_data *d, size_t stride, double *to)
{
    double held = (double)NAN;
    size_t i = 0;

    for (size_t k = 0; k < d->record.n; k++) {
        for (; i < s->n && s->t[i] <= d->begin + ((double)k + 1e-3) * d->record.Ts; i++)
            held = isfinite(s->value[i]) ? s->value[i] : held;
        to[k * stride] = held;
    }
}

static void count_gaps(struct identify_data *d)
{
    for (size_t i = 0; i < d->record.ny; i++) {
        size_t gap = 0;

        for (size_t k = 0; k < d->record.n; k++) {
            gap = isfinite(d->record.y[k * d->record.ny + i]) ? 0 : gap + 1;
            d->gaps[i].missing += gap > 0;
            d->gaps[i].longest = gap > d->gaps[i].longest ? gap : d->gaps[i].longest;
        }
    }
}

static double first_of(const struct series *s)
{
    size_t i = 0;

    while (i < s->n && !isfinite(s->value[i]))
        i++;
    return i < s->n ? s->t[i] : HUGE_VAL;
}

static int sample(struct reading *r, struct identify_data *d)
{
    const struct series *first = &r->output[0];
    const double *time = first->t;
    double Ts, end, *u, *y;
    int rc = find_period(r, first, &Ts);

    if (rc < 0 || !time)
        return rc;
    d->begin = time[0];
    for (size_t i = 0; i < r->inputs; i++) {
        const double begin = first_of(&r->input[i]);

        if (begin == HUGE_VAL)
            return apc_fail(r->why, APC_EINVAL, "%s: there is no value of \"%s\" in that time", r->file,
                            r->input[i].name);
        if (begin > d->begin) /* on the grid of the first output */
            d->begin = time[0] + ceil((begin - time[0]) / Ts - 1e-3) * Ts;
    }
    end = time[first->n - 1];
    if (!(end > d->begin) || (end - d->begin) / Ts > SAMPLES_MOST)
        return apc_fail(r->why, APC_EINVAL, "%s: %g samples of %g s: must be 2 to %d", r->file,
                        fmax((end - d->begin) / Ts, 0.0), Ts, SAMPLES_MOST);
    d->record = (struct apc_record){.size = sizeof d->record,
                                    .Ts = Ts,
                                    .n = (size_t)((end - d->begin) / Ts + ALIKE) + 1,
                                    .nu = r->inputs - r->wish->disturbances,
                                    .nd = r->wish->disturbances,
                                    .ny = r->outputs};
    u = d->memory = calloc(d->record.n * (r->inputs + r->outputs), sizeof *u);
    if (!u)
        return apc_fail(r->why, APC_ENOMEM, "out of memory");
    d->record.u = u;
    d->record.y = y = u + d->record.n * r->inputs;
    for (size_t i = 0; i < r->inputs; i++)
        hold(&r->input[i], d, r->inputs, u + i);
    for (size_t i = 0; i < r->outputs; i++)
        lay(&r->output[i], d, r->outputs, y + i);
    count_gaps(d);
    return 0;
}

/* ---- All of it ------------------------------------------------------------------------------------- */

static void close_reading(struct reading *r)
{
    for (size_t i = 0; i < IDENTIFY_SIGNALS; i++) {
        free(r->input[i].t);
        free(r->input[i].value);
        free(r->output[i].t);
        free(r->output[i].value);
    }
    free(r);
}

int identify_read(struct identify_data *data, const char *file, const struct identify_wish *wish,
                  struct apc_error *why)
{
    struct reading *r = calloc(1, sizeof *r);
    struct stat what;
    int rc;

    *data = (struct identify_data){.memory = NULL};
    if (!r)
        return apc_fail(why, APC_ENOMEM, "out of memory");
    r->file = file;
    r->wish = wish;
    r->why = why;
    r->inputs = wish->inputs;
    r->outputs = wish->outputs;
    for (size_t i = 0; i < wish->inputs; i++)
        r->input[i].name = wish->input[i];
    for (size_t i = 0; i < wish->outputs; i++)
        r->output[i].name = wish->output[i];
    rc = stat(file, &what) == 0 && S_ISDIR(what.st_mode) ? read_run(r) : read_csv(r);
    if (rc == 0)
        rc = sample(r, data);
    for (size_t i = 0; i < r->inputs && rc == 0; i++)
        snprintf(data->input[i], APC_TAG_LEN, "%s", r->input[i].name);
    for (size_t i = 0; i < r->outputs && rc == 0; i++)
        snprintf(data->output[i], APC_TAG_LEN, "%s", r->output[i].name);
    close_reading(r);
    return rc;
}

void identify_data_free(struct identify_data *data)
{
    free(data->memory);
    data->memory = NULL;
}

/* SPDX-License-Identifier: BSD-3-Clause */
/* Records from files: CSV with names, and run folders. */
#include "identify.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>
#include <strings.h>
#include <sys/stat.h>

#include "files/files.h"
#include "record/record.h"

/* ---- CSV with names -------------------------------------------------------------------------------- */

#define NO_TIME SIZE_MAX

/* A file, and what its columns are. */
struct table {
    struct csv *csv;
    struct series **of; /* [columns] NULL: nobody asks */
    size_t time;        /* the column; NO_TIME: rows are a period apart */
    size_t rows;
    apc_ns begin; /* of dates: the first row's */
    bool dates, zone;
};

/* "time", in any case, with or without its unit, or "t", which is not the temperature T. */
static bool is_time(const char *name)
{
    if (!strcmp(name, "t"))
        return true;
    if (strncasecmp(name, "time", 4) != 0)
        return false;
    name += 4;
    name += strspn(name, " ");
    return !*name || !strcmp(name, "(s)") || !strcmp(name, "[s]");
}

static int take_column(struct reading *r, struct table *t, size_t i)
{
    const char *const name = csv_name(t->csv, i);

    for (size_t k = 0; k < r->inputs + r->outputs; k++) {
        struct series *const s = k < r->inputs ? &r->input[k] : &r->output[k - r->inputs];

        if (strcmp(name, s->name) != 0)
            continue;
        for (size_t before = 0; before < i; before++)
            if (t->of[before] == s)
                return csv_refuse(t->csv, r->why, "there are two columns \"%.80s\"", name);
        t->of[i] = s;
    }
    if (t->of[i] || !is_time(name))
        return 0;
    if (t->time != NO_TIME)
        return csv_refuse(t->csv, r->why,
                          "columns \"%.80s\" and \"%.80s\" are both a time: leave one of them out",
                          csv_name(t->csv, t->time), name);
    t->time = i;
    return 0;
}

/* As samples.csv, and apc history --csv. */
static bool is_long(const struct csv *csv)
{
    static const char *const names[] = {"time", "table", "id"};
    const size_t n = sizeof names / sizeof *names;
    size_t i = 0;

    while (i < n && i < csv_columns(csv) && !strcmp(csv_name(csv, i), names[i]))
        i++;
    return i == n;
}

static int name_columns(struct reading *r, struct table *t)
{
    const size_t n = csv_columns(t->csv);
    int rc = 0;

    t->of = calloc(n, sizeof(void *));
    if (!t->of)
        return apc_fail(r->why, APC_ENOMEM, "out of memory");
    for (size_t i = 0; i < n && rc == 0; i++)
        rc = take_column(r, t, i);
    for (size_t k = 0; k < r->inputs + r->outputs && rc == 0; k++) {
        const struct series *s = k < r->inputs ? &r->input[k] : &r->output[k - r->inputs];
        size_t i = 0;

        while (i < n && t->of[i] != s)
            i++;
        if (i == n)
            rc = apc_fail(r->why, APC_ENOTFOUND, "%s:%zu: there is no column \"%s\"%s", r->file,
                          csv_line(t->csv), s->name,
                          is_long(t->csv) ? "; it has a row for each sample: give the run's folder or store"
                                          : "");
    }
    if (rc == 0 && t->time == NO_TIME && r->selection->period <= 0.0)
        rc = csv_refuse(
            t->csv, r->why,
            "there is no column \"time\", in s or as dates of ISO 8601; without one --period S says "
            "how far apart the rows are");
    return rc;
}

/* A date of ISO 8601, in seconds since the first of them. */
static int take_date(struct reading *r, struct table *t, const char *text, apc_ns date, double *seconds)
{
    const char *const clock = strchr(text, ':');
    const bool zone = clock && strpbrk(clock, "Z+-");

    if (t->rows == 0) {
        t->begin = date;
        t->zone = zone;
    }
    if (zone != t->zone)
        return csv_refuse_field(
            t->csv, t->time, r->why,
            "\"%.40s\" %s a time zone, those before it %s: how far apart they are is in doubt", text,
            zone ? "has" : "has not", zone ? "have not" : "have");
    *seconds = apc_ns_to_s(date - t->begin);
    return 0;
}

static int take_csv_time(struct reading *r, struct table *t, double *seconds)
{
    apc_ns date;

    if (t->time == NO_TIME) {
        *seconds = (double)t->rows * r->selection->period;
        return csv_passed(t->csv) == 0
                   ? 0
                   : csv_refuse(
                         t->csv, r->why,
                         "the row before it is empty, and no column tells the time: is a sample missing?");
    }
    const char *const text = csv_text(t->csv, t->time);
    const bool is_date = apc_time_parse(text, &date) == 0;

    if (t->rows == 0)
        t->dates = is_date;
    if (is_date && t->dates)
        return take_date(r, t, text, date, seconds);
    if (is_date || t->dates)
        return csv_refuse_field(t->csv, t->time, r->why, "\"%.40s\" is %s date, those before it are %s", text,
                                is_date ? "a" : "no", is_date ? "numbers" : "dates");
    return csv_number(t->csv, t->time, seconds, r->why);
}

static int read_row(struct reading *r, struct table *t)
{
    double seconds = 0.0;
    int rc = take_csv_time(r, t, &seconds);

    for (size_t i = 0; i < csv_columns(t->csv) && rc == 0; i++) {
        struct series *const s = t->of[i];
        double value = (double)NAN;

        if (!s)
            continue;
        if (s->n > 0 && !(seconds > s->t[s->n - 1]))
            return csv_refuse(t->csv, r->why, "the time %s is not after that of the row before",
                              t->time == NO_TIME ? "" : csv_text(t->csv, t->time));
        if (!csv_missing(t->csv, i))
            rc = csv_number(t->csv, i, &value, r->why);
        if (rc == 0)
            rc = series_add(r, s, seconds, value);
    }
    t->rows++;
    return rc;
}

static int read_csv(struct reading *r)
{
    struct table t = {.time = NO_TIME};
    int rc;

    rc = csv_open(&t.csv, r->file, r->why);
    if (rc == 0 && (r->inputs == 0 || r->outputs == 0))
        rc =
            apc_fail(r->why, APC_EINVAL,
                     "%s: --inputs and --outputs must name columns, as --inputs u1 --outputs y1,y2", r->file);
    if (rc == 0)
        rc = name_columns(r, &t);
    while (rc == 0 && (rc = csv_next(t.csv, r->why)) > 0)
        rc = read_row(r, &t);
    csv_close(t.csv);
    free(t.of);
    return rc;
}

/* ---- Run folders ----------------------------------------------------------------------------------- */

static int read_known_columns(struct reading *r, struct known *known, size_t *n)
{
    struct csv *csv;
    char path[600];
    int rc;

    *n = 0;
    snprintf(path, sizeof path, "%.560s/signals.csv", r->file);
    rc = csv_open(&csv, path, r->why);
    if (rc == APC_ENOTFOUND)
        return samples_missing(r->file, "signals.csv", r->why);
    if (rc == 0 && csv_columns(csv) < 4)
        rc = csv_refuse(csv, r->why, "expected the columns table,id,name,unit");
    while (rc == 0 && *n < COLUMNS_MOST && (rc = csv_next(csv, r->why)) > 0) {
        struct known *const k = &known[*n];
        double id;

        k->table = apc_table_parse(csv_text(csv, 0));
        rc = csv_number(csv, 1, &id, r->why);
        if (rc < 0 || !k->table || strlen(csv_text(csv, 2)) >= APC_TAG_LEN)
            continue;
        k->id = (int)id;
        snprintf(k->name, sizeof k->name, "%s", csv_text(csv, 2));
        snprintf(k->unit, sizeof k->unit, "%.63s", csv_text(csv, 3));
        ++*n;
    }
    csv_close(csv);
    return rc;
}

/* Where the rows of a run go. */
struct sorting {
    struct reading *r;
    const struct known *known; /* [n] */
    struct series **of;        /* [n] NULL: nobody asks */
    size_t n;
};

static int sort_row(void *ctx, double t, const struct apc_sample *row)
{
    const struct sorting *const z = ctx;

    for (size_t i = 0; i < z->n; i++)
        if (z->of[i] && z->known[i].table == row->table && z->known[i].id == row->id)
            return series_add(z->r, z->of[i], t,
                              apc_status_severity(row->status) == APC_SEVERITY_BAD ? (double)NAN
                                                                                   : row->value);
    return 0;
}

static int read_run(struct reading *r)
{
    struct known *known = calloc(COLUMNS_MOST, sizeof *known);
    struct series *of[COLUMNS_MOST] = {NULL};
    struct sorting sorting = {r, known, of, 0};
    char path[600];
    int rc = known ? read_known_columns(r, known, &sorting.n) : apc_fail(r->why, APC_ENOMEM, "out of memory");

    if (rc == 0)
        rc = series_choose(r, known, sorting.n, of);
    snprintf(path, sizeof path, "%.560s/samples.csv", r->file);
    if (rc == 0)
        rc = samples_each(path, sort_row, &sorting, r->why);
    free(known);
    return rc;
}

int identify_read_files(struct reading *r)
{
    struct stat what;

    return stat(r->file, &what) == 0 && S_ISDIR(what.st_mode) ? read_run(r) : read_csv(r);
}

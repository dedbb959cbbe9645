/* SPDX-License-Identifier: BSD-3-Clause */
/* Records from files: CSV with names, and run folders. */
#include "identify_series.h"

#include <errno.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>

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
    double t = (double)row * r->wish->period, value[COLUMNS_MOST] = {0};
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
        if (s)
            rc = series_add(r, s, t, value[i]);
    }
    return rc;
}

static int read_csv(struct reading *r)
{
    struct series *column[COLUMNS_MOST] = {NULL};
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
        char *rest = line, *table = field(&rest), *id = field(&rest), *name = field(&rest),
             *unit = field(&rest);

        if (!name || !apc_table_parse(table) || strlen(name) >= APC_TAG_LEN)
            continue;
        known[*n].table = apc_table_parse(table);
        known[*n].id = (int)strtol(id, NULL, 10);
        snprintf(known[*n].unit, sizeof known->unit, "%.63s", unit ? unit : "");
        snprintf(known[(*n)++].name, sizeof known->name, "%s", name);
    }
    free(line);
    fclose(in);
    return 0;
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
        if (of[i] && known[i].table == apc_table_parse(table) && known[i].id == strtol(id, NULL, 10))
            return series_add(r, of[i], time,
                              apc_status_severity(code) == APC_SEVERITY_BAD ? (double)NAN : number_of);
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

    if (rc == 0)
        rc = series_choose(r, known, n, of);
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

int identify_read_files(struct reading *r)
{
    struct stat what;

    return stat(r->file, &what) == 0 && S_ISDIR(what.st_mode) ? read_run(r) : read_csv(r);
}

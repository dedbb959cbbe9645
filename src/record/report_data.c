/* SPDX-License-Identifier: BSD-3-Clause */
#include "record.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "files/files.h"
#include "operate/operate.h"

#define MAX_COLUMNS   12
#define ID_MAX        8192    /* a module has no more variables of one kind */
#define PUBLISHED_MAX 1048576 /* of all laws */

/* A file of the run folder: its name, its columns, and what takes one row of it. */
struct form {
    const char *name;
    const char *columns;
    /* Returns 0, APC_ENOMEM, or 1 + the index of the field that is not understood. */
    int (*row)(struct report_data *data, size_t line, char const *const *field);
    bool optional; /* folders of older runs have none */
};

/* ---- Fields ------------------------------------------------------------------------------- */

/* A whole number; doubles hold nanoseconds exactly up to 104 days. */
static bool parse_whole_number(const char *text, double low, double high, double *value)
{
    return apc_number_parse(text, value) == 0 && *value >= low && *value <= high && *value == floor(*value);
}

static bool parse_count(const char *text, uint64_t *count)
{
    double value;

    if (!parse_whole_number(text, 0.0, 9e15, &value))
        return false;
    *count = (uint64_t)value;
    return true;
}

static bool parse_ns(const char *text, apc_ns *ns)
{
    double value;

    if (!parse_whole_number(text, -9e15, 9e15, &value))
        return false;
    *ns = (apc_ns)value;
    return true;
}

/* Room for one more element of @p size bytes in *items. */
static int reserve_item(void **items, size_t n, size_t *capacity, size_t size)
{
    size_t wanted = *capacity > 0 ? 2 * *capacity : 64;
    void *grown;

    if (n < *capacity)
        return 0;
    grown = reallocarray(*items, wanted, size);
    if (!grown)
        return APC_ENOMEM;
    *items = grown;
    *capacity = wanted;
    return 0;
}

struct report_jitter *report_jitter_of(const struct report_data *data, const char *task)
{
    for (size_t i = 0; i < data->n_jitter; i++)
        if (strcmp(task, data->jitter[i].task) == 0)
            return &data->jitter[i];
    return NULL;
}

/* The task that a row of the timing files is about. NULL: out of memory. */
static struct report_jitter *find_jitter(struct report_data *data, const char *task)
{
    struct report_jitter *known = report_jitter_of(data, task);
    if (known)
        return known;
    struct report_jitter *grown = reallocarray(data->jitter, data->n_jitter + 1, sizeof *grown);
    if (!grown)
        return NULL;
    data->jitter = grown;
    known = &grown[data->n_jitter++];
    *known = (struct report_jitter){0};
    snprintf(known->task, sizeof known->task, "%s", task);
    return known;
}

/* ---- Rows --------------------------------------------------------------------------------- */

static bool widen_group(struct report_group *group, size_t n)
{
    struct report_series *series = reallocarray(group->series, n, sizeof *series);

    if (!series)
        return false;
    memset(series + group->n, 0, (n - group->n) * sizeof *series);
    group->series = series;
    group->n = n;
    return true;
}

static int take_report_point(struct report_group *group, size_t id, const struct report_point *point)
{
    if (id > group->n && !widen_group(group, id))
        return APC_ENOMEM;
    struct report_series *series = &group->series[id - 1];
    void *items = series->points;
    if (reserve_item(&items, series->n, &series->capacity, sizeof *point) != 0)
        return APC_ENOMEM;
    series->points = items;
    series->points[series->n++] = *point;
    return 0;
}

/* All of a row but its table. Returns 0 or 1 + the index of the field that is not understood. */
static int parse_point(char const *const *field, struct report_point *point, double id_max, double *id)
{
    apc_status status;
    if (apc_number_parse(field[0], &point->t) != 0)
        return 1;
    if (!parse_whole_number(field[2], 1, id_max, id))
        return 3;
    if (apc_status_parse(field[3], &status) != 0)
        return 4;
    if (apc_number_parse(field[4], &point->value) != 0 || fabs(point->value) > APC_VALUE_MAX)
        return 5;
    point->severity = apc_status_severity(status);
    point->limited = strstr(field[3], "Limited") != NULL;
    return 0;
}

static int sample_row(struct report_data *data, size_t line, char const *const *field)
{
    struct report_point point = {.line = line};
    struct report_group *group;
    double id;

    switch (apc_table_parse(field[1])) {
    case APC_SENSOR:
        group = &data->y;
        break;
    case APC_SETPOINT:
        group = &data->z;
        break;
    case APC_ACTUATOR:
        group = &data->u;
        break;
    default:
        return 2;
    }
    int bad = parse_point(field, &point, ID_MAX, &id);
    if (bad)
        return bad;
    data->end = fmax(data->end, point.t);
    return take_report_point(group, (size_t)id, &point);
}

/* Of the operation only the actual modes are drawn. */
static int operation_row(struct report_data *data, size_t line, char const *const *field)
{
    struct report_point point = {.line = line};
    const int step = apc_variable_number(APC_OPMODE, 1) - apc_variable_number(APC_OPMODE, 0);
    const bool actual = apc_table_parse(field[1]) == APC_ACTUAL;
    double id;
    int bad = parse_point(field, &point, actual ? step * ID_MAX : LOOPS_RATE(ID_MAX), &id);
    if (!actual || bad)
        return bad;
    const int loop = (int)id / step;
    return loop > 0 && (int)id == apc_variable_number(APC_OPMODE, loop)
               ? take_report_point(&data->mode, (size_t)loop, &point)
               : 0;
}

static int published_row(struct report_data *data, size_t line, char const *const *field)
{
    struct report_point point = {.line = line};
    double id;
    int bad = parse_point(field, &point, PUBLISHED_MAX, &id);
    if (apc_table_parse(field[1]) != APC_ESTIMATE || bad)
        return bad ? bad : 2;
    return take_report_point(&data->published, (size_t)id, &point);
}

static int bin_timing_row(struct report_data *data, size_t line, char const *const *field)
{
    struct report_jitter *jitter;
    struct apc_bin bin;
    void *items;

    (void)line;
    if (!parse_ns(field[3], &bin.low))
        return 4;
    if (!parse_ns(field[4], &bin.high) || bin.high < bin.low)
        return 5;
    if (!parse_count(field[5], &bin.count))
        return 6;
    if (strcmp(field[1], "jitter") != 0 || bin.count == 0)
        return 0;
    jitter = find_jitter(data, field[0]);
    if (!jitter)
        return APC_ENOMEM;
    items = jitter->bins;
    if (reserve_item(&items, jitter->n_bins, &jitter->capacity, sizeof bin) != 0)
        return APC_ENOMEM;
    jitter->bins = items;
    jitter->bins[jitter->n_bins++] = bin;
    return 0;
}

static int summary_row(struct report_data *data, size_t line, char const *const *field)
{
    struct report_jitter *jitter;

    (void)line;
    if (strcmp(field[1], "jitter") != 0)
        return 0;
    jitter = find_jitter(data, field[0]);
    if (!jitter)
        return APC_ENOMEM;
    if (!parse_whole_number(field[2], 1, 366 * 86400e9, &jitter->period))
        return 3;
    if (!parse_count(field[3], &jitter->count))
        return 4;
    if (!parse_count(field[4], &jitter->missed))
        return 5;
    if (apc_number_parse(field[5], &jitter->mean) != 0)
        return 6;
    if (apc_number_parse(field[6], &jitter->sd) != 0)
        return 7;
    return 0;
}

static const struct form files[] = {
    {"samples.csv", "time,table,id,status,value", sample_row, false},
    {"operation.csv", "time,table,id,status,value", operation_row, true},
    {"published.csv", "time,table,id,status,value", published_row, true},
    {"timing.csv", "task,quantity,period_ns,low_ns,high_ns,count", bin_timing_row, false},
    {"timing-summary.csv",
     "task,quantity,period_ns,count,missed,mean_ns,sd_ns,min_ns,p50_ns,p99_ns,p999_ns,max_ns", summary_row,
     false},
};

/* ---- Files -------------------------------------------------------------------------------- */

static int read_report_row(struct csv *csv, const struct form *form, struct report_data *data,
                           struct apc_error *why)
{
    char const *field[MAX_COLUMNS];

    for (size_t i = 0; i < csv_columns(csv); i++)
        field[i] = csv_text(csv, i);
    const int bad = form->row(data, csv_line(csv), field);
    return bad > 0   ? csv_refuse_field(csv, (size_t)bad - 1, why, "cannot be \"%.40s\"", field[bad - 1])
           : bad < 0 ? apc_fail(why, bad, "%s: out of memory", form->name)
                     : 0;
}

static int read_report_file(const char *dir, const struct form *form, struct report_data *data,
                            struct apc_error *why)
{
    struct csv *csv;
    char *path;

    if (asprintf(&path, "%s/%s", dir, form->name) < 0)
        return apc_fail(why, APC_ENOMEM, "%s: out of memory", form->name);
    int rc = csv_open(&csv, path, why);
    free(path);
    if (rc == APC_ENOTFOUND && form->optional)
        return 0;
    if (rc == 0)
        rc = csv_expect(csv, form->columns, why);
    while (rc == 0 && (rc = csv_next(csv, why)) > 0)
        rc = read_report_row(csv, form, data, why);
    csv_close(csv);
    return rc;
}

static int by_report_time(const void *a, const void *b)
{
    const struct report_point *p = a, *q = b;

    if (p->t != q->t)
        return p->t < q->t ? -1 : 1;
    return (p->line > q->line) - (p->line < q->line);
}

static void sort_group(struct report_group *group)
{
    for (size_t i = 0; i < group->n; i++) {
        struct report_series *series = &group->series[i];
        if (series->n > 1)
            qsort(series->points, series->n, sizeof *series->points, by_report_time);
    }
}

/* Of warnings and alarms. */
static int event_row(struct report_data *data, size_t line, char const *const *field)
{
    struct report_event event = {.alarm = !strcmp(field[1], "alarm")};
    void *items = data->event;

    (void)line;
    if (apc_number_parse(field[0], &event.t) < 0)
        return 1;
    if (event.t < 0 || (!event.alarm && strcmp(field[1], "warning") != 0))
        return 0;
    snprintf(event.kind, sizeof event.kind, "%s", field[3]);
    if (reserve_item(&items, data->n_events, &data->events_room, sizeof event) != 0)
        return APC_ENOMEM;
    data->event = items;
    data->event[data->n_events++] = event;
    return 0;
}

static const struct form events = {"events.csv", "time,severity,source,kind,text", event_row, true};

int report_read(struct report_data *data, const char *dir, struct apc_error *why)
{
    *data = (struct report_data){0};
    for (size_t i = 0; i < sizeof files / sizeof *files; i++) {
        int rc = read_report_file(dir, &files[i], data, why);
        if (rc < 0)
            return rc;
    }
    sort_group(&data->y);
    sort_group(&data->z);
    sort_group(&data->u);
    sort_group(&data->mode);
    sort_group(&data->published);
    return read_report_file(dir, &events, data, why);
}

static void clip_group(struct report_group *group, double begin, double end)
{
    for (size_t i = 0; i < group->n; i++) {
        struct report_series *s = &group->series[i];
        size_t first = 0;
        while (s->n > 0 && s->points[s->n - 1].t > end)
            s->n--;
        while (first + 1 < s->n && s->points[first + 1].t <= begin)
            first++;
        s->n -= first;
        if (first > 0) /* where there never was a point there is no room either */
            memmove(s->points, s->points + first, s->n * sizeof *s->points);
    }
}

void report_clip(struct report_data *data, double begin, double end)
{
    size_t n = 0;
    clip_group(&data->y, begin, end);
    clip_group(&data->z, begin, end);
    clip_group(&data->u, begin, end);
    clip_group(&data->mode, begin, end);
    clip_group(&data->published, begin, end);
    for (size_t i = 0; i < data->n_events; i++)
        if (data->event[i].t >= begin && data->event[i].t <= end)
            data->event[n++] = data->event[i];
    data->n_events = n;
    data->begin = begin;
    data->end = fmin(data->end, end);
}

static void free_group(struct report_group *group)
{
    for (size_t i = 0; i < group->n; i++)
        free(group->series[i].points);
    free(group->series);
}

void report_free(struct report_data *data)
{
    free_group(&data->y);
    free_group(&data->z);
    free_group(&data->u);
    free_group(&data->mode);
    free_group(&data->published);
    free(data->event);
    for (size_t i = 0; i < data->n_jitter; i++)
        free(data->jitter[i].bins);
    free(data->jitter);
}

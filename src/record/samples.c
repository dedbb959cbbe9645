/* SPDX-License-Identifier: BSD-3-Clause */
#include "record.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "files/files.h"
#include "operate/operate.h"

#define HEADER "time,table,id,status,value"

int samples_add(struct samples *s, const struct apc_sample *sample)
{
    if (s->n == s->room) {
        size_t room = s->room ? 2 * s->room : 4096;
        struct apc_sample *at = reallocarray(s->at, room, sizeof *at);
        if (!at)
            return APC_ENOMEM;
        s->at = at;
        s->room = room;
    }
    s->at[s->n++] = *sample;
    return 0;
}

int samples_append(struct samples *s, const struct samples *more)
{
    int rc = 0;
    for (size_t i = 0; i < more->n && rc == 0; i++)
        rc = samples_add(s, &more->at[i]);
    return rc;
}

void samples_free(struct samples *s)
{
    free(s->at);
    *s = (struct samples){0};
}

static int by_sample_time(const void *left, const void *right)
{
    static const int rank[APC_TABLE_END] = {
        [APC_SETPOINT] = 1, [APC_SENSOR] = 2, [APC_ACTUATOR] = 3, [APC_OPMODE] = 4,
        [APC_ACTUAL] = 5,   [APC_TUNING] = 6, [APC_MANUAL] = 7,   [APC_ESTIMATE] = 8};
    const struct apc_sample *a = left, *b = right;
    if (a->time != b->time)
        return a->time < b->time ? -1 : 1;
    if (a->table != b->table)
        return rank[a->table] - rank[b->table];
    if (a->id != b->id)
        return a->id - b->id;
    return a->seq < b->seq ? -1 : a->seq > b->seq;
}

static int collect_sample(void *ctx, const struct apc_sample *sample)
{
    return samples_add(ctx, sample);
}

/* n variables of a table, from id @first on. */
struct part {
    enum apc_table table;
    int first;
    size_t n;
};

static int collect_part(struct samples *samples, struct apc_store *store, const struct part *part,
                        const struct apc_range *range)
{
    for (size_t i = 0; i < part->n; i++) {
        size_t before = samples->n;
        int rc = apc_store_history(store, part->table, part->first + (int)i, range, collect_sample, samples);
        if (rc < 0)
            return rc;
        if (samples->n - before < (size_t)rc)
            return APC_ENOMEM;
    }
    return 0;
}

int samples_collect_one(struct samples *samples, struct apc_store *store, enum apc_table table, int id,
                        const struct apc_range *range)
{
    return collect_part(samples, store, &(struct part){table, id, 1}, range);
}

void samples_sort(struct samples *samples)
{
    if (samples->n > 0)
        qsort(samples->at, samples->n, sizeof *samples->at, by_sample_time);
}

int samples_collect(struct samples *samples, struct apc_store *store, const struct experiment *e,
                    const struct apc_range *range)
{
    const struct part of[] = {{APC_SETPOINT, 1, e->dim.nz},
                              {APC_SENSOR, 1, e->dim.ny + e->n_signals},
                              {APC_ACTUATOR, 1, e->dim.nu}};
    int rc = 0;
    for (size_t t = 0; t < sizeof of / sizeof *of && rc == 0; t++)
        rc = collect_part(samples, store, &of[t], range);
    samples_sort(samples);
    return rc;
}

static int collect_actual_modes(struct samples *samples, struct apc_store *store, size_t loops,
                                const struct apc_range *range)
{
    int rc = 0;
    for (size_t i = 1; i <= loops && rc == 0; i++)
        rc = collect_part(samples, store,
                          &(struct part){APC_ACTUAL, apc_variable_number(APC_OPMODE, (int)i), 1}, range);
    return rc;
}

int samples_collect_operation(struct samples *samples, struct apc_store *store, const struct experiment *e,
                              const struct apc_range *range)
{
    const struct controller *last = &e->controllers[e->n_controllers - 1];
    const size_t loops = controllers_loops(e);
    const struct part of[] = {{APC_OPMODE, 1, loops},
                              {APC_TUNING, 1, (size_t)last->first_tuning - 1 + controllers_parameters(last)},
                              {APC_MANUAL, 1, loops},
                              {APC_SETPOINT, LOOPS_RAMP(1), e->dim.nz},
                              {APC_SETPOINT, LOOPS_RATE(1), e->dim.nz}};
    const struct apc_range before = {.until = range->since, .last = 1};
    int rc = 0;
    for (size_t t = 0; t < sizeof of / sizeof *of && rc == 0; t++) {
        if (range->since > 0)
            rc = collect_part(samples, store, &of[t], &before);
        if (rc == 0)
            rc = collect_part(samples, store, &of[t], range);
    }
    if (rc == 0 && range->since > 0)
        rc = collect_actual_modes(samples, store, loops, &before);
    if (rc == 0)
        rc = collect_actual_modes(samples, store, loops, range);
    samples_sort(samples);
    return rc;
}

int samples_collect_published(struct samples *samples, struct apc_store *store, const struct experiment *e,
                              const struct apc_range *range)
{
    size_t n;
    struct apc_tag *tag = provision_tags(e, &n);
    int rc = tag ? 0 : APC_ENOMEM;
    for (size_t i = 0; tag && i < n && rc == 0; i++)
        if (tag[i].table == APC_ESTIMATE)
            rc = collect_part(samples, store, &(struct part){APC_ESTIMATE, tag[i].id, 1}, range);
    free(tag);
    samples_sort(samples);
    return rc;
}

void samples_write(const struct samples *s, apc_ns start, FILE *out)
{
    fputs(HEADER "\n", out);
    samples_write_rows(s, start, out);
}

void samples_write_rows(const struct samples *s, apc_ns start, FILE *out)
{
    for (size_t i = 0; i < s->n; i++) {
        const struct apc_sample *at = &s->at[i];
        char status[APC_STATUS_NAME_LEN], value[40];
        apc_number_format(at->value, value, sizeof value);
        fprintf(out, "%.6f,%s,%d,%s,%s\n", apc_ns_to_s(at->time - start), apc_table_name(at->table), at->id,
                apc_status_format(at->status, status), value);
    }
}

/* ---- Reading ------------------------------------------------------------------------------ */

static int take_sample_row(struct csv *csv, double *t, struct apc_sample *sample, struct apc_error *why)
{
    double id = 0.0;
    int rc = csv_number(csv, 0, t, why);

    if (rc == 0 && apc_ns_from_s(*t, &sample->time) < 0)
        return csv_refuse_field(csv, 0, why, "\"%.40s\" is no time of a run", csv_text(csv, 0));
    if (rc == 0 && !(sample->table = apc_table_parse(csv_text(csv, 1))))
        return csv_refuse_field(csv, 1, why, "\"%.40s\" is no table", csv_text(csv, 1));
    if (rc == 0)
        rc = csv_number(csv, 2, &id, why);
    if (rc == 0 && !(id >= 0 && id <= 1e6 && id == floor(id)))
        return csv_refuse_field(csv, 2, why, "\"%.40s\" must be a whole number from 0 to 1000000",
                                csv_text(csv, 2));
    if (rc == 0 && apc_status_parse(csv_text(csv, 3), &sample->status) < 0)
        return csv_refuse_field(csv, 3, why, "\"%.40s\" is no status", csv_text(csv, 3));
    if (rc == 0)
        rc = csv_number(csv, 4, &sample->value, why);
    sample->id = (int)id;
    return rc;
}

int samples_each(const char *path, int (*take)(void *ctx, double t, const struct apc_sample *sample),
                 void *ctx, struct apc_error *why)
{
    struct csv *csv;
    int rc = csv_open(&csv, path, why);

    if (rc < 0)
        return rc;
    rc = csv_expect(csv, HEADER, why);
    while (rc == 0 && (rc = csv_next(csv, why)) > 0) {
        struct apc_sample sample = {0};
        double t;

        rc = take_sample_row(csv, &t, &sample, why);
        if (rc == 0 && (rc = take(ctx, t, &sample)) < 0)
            rc = apc_fail(why, rc, "%s: %s", path, apc_err_text(rc));
    }
    if (rc == 0 && !csv_ended(csv))
        rc = csv_refuse(csv, why, "ends in the middle of a line: the file is not whole");
    csv_close(csv);
    return rc;
}

static int add_sample_line(void *ctx, double t, const struct apc_sample *sample)
{
    (void)t;
    return samples_add(ctx, sample);
}

static int count_seqs(struct samples *s)
{
    int64_t *seq = NULL;
    size_t ids = 0;
    for (size_t i = 0; i < s->n; i++)
        ids = (size_t)s->at[i].id >= ids ? (size_t)s->at[i].id + 1 : ids;
    seq = calloc(ids * APC_TABLE_END + 1, sizeof *seq);
    if (!seq)
        return APC_ENOMEM;
    for (size_t i = 0; i < s->n; i++)
        s->at[i].seq = ++seq[(size_t)s->at[i].table * ids + (size_t)s->at[i].id];
    free(seq);
    return 0;
}

int samples_missing(const char *dir, const char *name, struct apc_error *why)
{
    return apc_fail(
        why, APC_ENOTFOUND,
        "%.300s/%.50s: No such file; of a run that goes on, or was killed, first: apc report %.300s", dir,
        name, dir);
}

int samples_read(struct samples *s, const char *dir, const char *name, struct apc_error *why)
{
    char path[600];

    *s = (struct samples){0};
    snprintf(path, sizeof path, "%.540s/%.50s", dir, name);
    const int rc = samples_each(path, add_sample_line, s, why);
    if (rc == APC_ENOTFOUND && !strcmp(name, "samples.csv"))
        return samples_missing(dir, name, why);
    return rc == 0 && count_seqs(s) < 0 ? apc_fail(why, APC_ENOMEM, "out of memory") : rc;
}

/* SPDX-License-Identifier: BSD-3-Clause */
#include "record.h"

#include <errno.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#define BATCH 5000 /* samples of one append */
#define ROWS  500  /* vectors of one append */

#define PATIENCE (60 * APC_NS_PER_S)

/* ---- Into the folder ----------------------------------------------------------------------- */

struct copy {
    struct apc_store *from, *to;
    const struct apc_range *range;
    struct apc_sample *sample; /* [BATCH], of which n */
    struct apc_vector *vector; /* [ROWS], of which n_vectors; their values are copies */
    size_t n, n_vectors;
    int failed; /* of the store that is written */
};

static int flush(struct copy *c)
{
    const struct apc_rows rows = {.size = sizeof rows, .vector = c->vector, .n_vectors = c->n_vectors};
    int rc = apc_store_append(c->to, c->sample, c->n);
    if (rc >= 0)
        rc = apc_store_append_rows(c->to, &rows);
    for (size_t i = 0; c->vector && i < c->n_vectors; i++)
        free(c->vector[i].value);
    c->n = c->n_vectors = 0;
    return c->failed = rc < 0 ? rc : 0;
}

static int keep_sample(void *ctx, const struct apc_sample *sample)
{
    struct copy *c = ctx;
    c->sample[c->n++] = *sample;
    return c->n == BATCH ? flush(c) : 0;
}

static int keep_vector(void *ctx, const struct apc_vector *vector)
{
    struct copy *c = ctx;
    struct apc_vector *to = &c->vector[c->n_vectors];
    *to = *vector;
    to->room = to->n;
    to->value = calloc(to->n + 1, sizeof *to->value);
    if (!to->value)
        return c->failed = APC_ENOMEM;
    memcpy(to->value, vector->value, to->n * sizeof *to->value);
    return ++c->n_vectors == ROWS ? flush(c) : 0;
}

/* What was in force when the range begins, and all in it. */
static int copy_variable_rows(struct copy *c, enum apc_table table, int id)
{
    const struct apc_range before = {.until = c->range->since, .last = 1};
    int rc = 0;
    if (c->range->since > 0)
        rc = apc_store_history(c->from, table, id, &before, keep_sample, c);
    if (rc >= 0 && !c->failed)
        rc = apc_store_history(c->from, table, id, c->range, keep_sample, c);
    return c->failed ? c->failed : rc;
}

static int copy_vectors(struct copy *c, enum apc_table table, int id)
{
    const struct apc_range before = {.until = c->range->since, .last = 1};
    int rc = 0;
    if (table == APC_PLAN && c->range->since > 0) /* it may be what was in force */
        rc = apc_store_vectors(c->from, table, id, &before, keep_vector, c);
    if (rc >= 0 && !c->failed)
        rc = apc_store_vectors(c->from, table, id, c->range, keep_vector, c);
    return c->failed ? c->failed : rc;
}

bool ticks_name(enum apc_table table)
{
    return table == APC_SETPOINT || table == APC_OPMODE || table == APC_MANUAL || table == APC_TUNING ||
           table == APC_ACTUAL || table == APC_ESTIMATE;
}

static int copy_named(struct copy *c)
{
    int n = apc_store_variables(c->from, NULL, 0);
    struct apc_sample *variable = n < 0 ? NULL : calloc((size_t)n + 1, sizeof *variable);
    if (!variable)
        return n < 0 ? n : APC_ENOMEM;
    int rc = apc_store_variables(c->from, variable, (size_t)n);
    n = rc < n ? rc : n;
    for (int i = 0; i < n && rc >= 0; i++)
        if (ticks_name(variable[i].table))
            rc = copy_variable_rows(c, variable[i].table, variable[i].id);
        else if (variable[i].table == APC_PREDICTION || variable[i].table == APC_PLAN)
            rc = copy_vectors(c, variable[i].table, variable[i].id);
    free(variable);
    return rc;
}

static int copy_all(struct copy *c, const struct experiment *e)
{
    c->sample = calloc(BATCH, sizeof *c->sample);
    c->vector = calloc(ROWS, sizeof *c->vector);
    int rc = c->sample && c->vector ? apc_store_init(c->to) : APC_ENOMEM;
    if (rc >= 0)
        rc = copy_named(c);
    for (size_t i = 0; i < e->n_controllers && rc >= 0; i++)
        rc = copy_vectors(c, APC_TICK, e->controllers[i].number);
    if (rc >= 0)
        rc = flush(c);
    for (size_t i = 0; c->vector && i < c->n_vectors; i++)
        free(c->vector[i].value);
    free(c->vector);
    free(c->sample);
    return rc;
}

int ticks_open(struct apc_store **ticks, const char *file, struct apc_error *why)
{
    const struct apc_store_options options = {.size = sizeof options, .name = "apc", .timeout = PATIENCE};
    char uri[660];

    snprintf(uri, sizeof uri, "sqlite:%s", file);
    return apc_store_open(ticks, uri, &options, why);
}

int ticks_keep(const char *dir, struct apc_store *from, const struct experiment *e,
               const struct apc_range *range, struct apc_error *why)
{
    char path[600], part[620], journal[640];
    struct copy c = {.from = from, .range = range};
    snprintf(path, sizeof path, "%.580s/" TICKS_FILE, dir);
    snprintf(part, sizeof part, "%s.new", path);
    snprintf(journal, sizeof journal, "%s-journal", part); /* outlives its file */
    if (unlink(part) < 0 && errno != ENOENT)
        return apc_fail(why, APC_ESYS, "%s: %s", part, strerror(errno));
    int rc = ticks_open(&c.to, part, why);
    if (rc < 0)
        return rc;
    rc = copy_all(&c, e);
    if (rc < 0)
        apc_fail(why, rc, "%s: %s", path,
                 rc == APC_ENOMEM ? apc_err_text(rc) : apc_store_error(c.failed ? c.to : from));
    apc_store_close(c.to);
    unlink(journal);
    if (rc >= 0 && rename(part, path) < 0)
        rc = apc_fail(why, APC_ESYS, "%s: cannot be written: %s", path, strerror(errno));
    if (rc < 0)
        unlink(part);
    return rc < 0 ? rc : 0;
}

/* ---- Out of it ------------------------------------------------------------------------------ */

static void *grow_room(void *at, size_t needed, size_t *room, size_t size)
{
    size_t wanted = *room ? *room : 1024;
    while (wanted < needed)
        wanted *= 2;
    void *grown = wanted > *room ? reallocarray(at, wanted, size) : at;
    *room = grown ? wanted : *room;
    return grown;
}

static int take_tick_row(void *ctx, const struct apc_vector *row)
{
    struct ticks *t = ctx;
    if (t->end > 0 && row->seq > t->end)
        return 1;
    struct tick_row *at = grow_room(t->at, t->n + 1, &t->room, sizeof *at);
    t->at = at ? at : t->at;
    double *value = grow_room(t->value, t->n_values + row->n, &t->values_room, sizeof *value);
    t->value = value ? value : t->value;
    t->full = !at || !value;
    if (t->full)
        return 1;
    t->at[t->n++] = (struct tick_row){row->seq, row->time, row->n, t->n_values};
    memcpy(value + t->n_values, row->value, row->n * sizeof *value);
    t->n_values += row->n;
    return row->seq == t->end;
}

int ticks_add(struct ticks *ticks, struct apc_store *store, enum apc_table table, int id,
              const struct apc_range *range)
{
    const int rc = apc_store_vectors(store, table, id, range, take_tick_row, ticks);
    return rc < 0 ? rc : ticks->full ? APC_ENOMEM : 0;
}

static int order_ticks(const void *left, const void *right)
{
    const struct tick_row *a = left, *b = right;
    return a->seq < b->seq ? -1 : a->seq > b->seq;
}

int ticks_fill(struct ticks *ticks, struct apc_store *store, enum apc_table table, int id, size_t most,
               bool first)
{
    const size_t n = ticks->n;
    int rc = 0;
    for (size_t k = first ? 0 : 1; k < n && rc == 0; k++) {
        const int64_t before = k > 0 ? ticks->at[k - 1].seq : 0,
                      nearest = ticks->at[k].seq - 1 - (int64_t)most;
        const struct apc_range hole = {.after = before > nearest ? before : nearest};
        ticks->end = ticks->at[k].seq - 1;
        if (before < ticks->end)
            rc = ticks_add(ticks, store, table, id, &hole);
    }
    ticks->end = 0;
    if (ticks->n > n)
        qsort(ticks->at, ticks->n, sizeof *ticks->at, order_ticks);
    return rc;
}

int ticks_load(struct ticks *ticks, struct apc_store *store, enum apc_table table, int id, apc_ns since)
{
    *ticks = (struct ticks){0};
    return ticks_add(ticks, store, table, id, &(struct apc_range){.since = since});
}

void ticks_free(struct ticks *ticks)
{
    free(ticks->at);
    free(ticks->value);
    *ticks = (struct ticks){0};
}

const struct tick_row *ticks_find(const struct ticks *ticks, int64_t seq)
{
    size_t low = 0, high = ticks->n;
    while (low < high) {
        const size_t middle = low + (high - low) / 2;
        if (ticks->at[middle].seq < seq)
            low = middle + 1;
        else
            high = middle;
    }
    return low < ticks->n && ticks->at[low].seq == seq ? &ticks->at[low] : NULL;
}

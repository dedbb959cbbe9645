/* SPDX-License-Identifier: BSD-3-Clause */
#include "record.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

static const double none = (double)NAN;

/* ---- Which variable is expected ----------------------------------------------------------- */

const struct apc_tag *prediction_variable(const struct apc_tag *published, const char *end,
                                          enum apc_table table, const struct apc_tag *tag, size_t n)
{
    const size_t own = strlen(published->controller), tail = strlen(end);
    const char *name = published->name;
    if (own > 0 && !strncmp(name, published->controller, own) && name[own] == '.')
        name += own + 1;
    const size_t length = strlen(name);
    if (length <= tail || strcmp(name + length - tail, end) != 0)
        return NULL;
    for (size_t i = 0; i < n; i++)
        if (tag[i].table == table && strlen(tag[i].name) == length - tail &&
            !strncmp(tag[i].name, name, length - tail))
            return &tag[i];
    return NULL;
}

static const struct apc_tag *expected_variable(const struct apc_tag *published, const struct apc_tag *tag,
                                               size_t n, bool *planned)
{
    const struct apc_tag *variable = prediction_variable(published, ".prediction", APC_SENSOR, tag, n);
    *planned = !variable;
    if (!variable)
        variable = prediction_variable(published, ".plan", APC_ACTUATOR, tag, n);
    return variable ? variable : prediction_variable(published, ".plan", APC_SETPOINT, tag, n);
}

/* ---- Reading ------------------------------------------------------------------------------ */

struct reading {
    struct prediction *o;
    struct prediction_trajectory next;
    apc_ns at, offset;
    int failed;
};

static int take_prediction_row(void *ctx, const struct apc_vector *row)
{
    struct reading *r = ctx;
    struct prediction_trajectory *c = &r->next;
    c->made = row->time - r->offset;
    if (row->n == 0 || c->made + c->first + c->step * (apc_ns)row->n <= r->at)
        return 0;
    c->n = row->n;
    c->expected = calloc(2 * c->n, sizeof *c->expected);
    if (!c->expected)
        return r->failed = APC_ENOMEM;
    c->came = c->expected + c->n;
    memcpy(c->expected, row->value, c->n * sizeof *c->expected);
    for (size_t k = 0; k < c->n; k++)
        c->came[k] = none;
    r->o->trajectory[r->o->n++] = *c;
    return 0;
}

static int load_trajectory(struct reading *r, struct apc_store *store, const struct apc_tag *published,
                           const struct apc_tag *variable, bool planned)
{
    const struct apc_range newest = {.until = r->at + r->offset + 1, .last = 1};
    apc_ns period = 0;
    r->next = (struct prediction_trajectory){
        .table = variable->table, .id = variable->id, .prediction = published->id};
    memcpy(r->next.name, variable->name, sizeof r->next.name);
    memcpy(r->next.unit, variable->unit, sizeof r->next.unit);
    (void)apc_ns_from_s(published->step, &r->next.step);
    (void)apc_ns_from_s(variable->period, &period);
    r->next.first = planned ? 0 : r->next.step;
    r->next.patience = planned ? INT64_MAX : 3 * period + 100 * APC_NS_PER_MS;
    const int rc = apc_store_vectors(store, APC_PREDICTION, published->id, &newest, take_prediction_row, r);
    return r->failed ? r->failed : rc < 0 ? rc : 0;
}

int prediction_load(struct prediction *o, struct apc_store *published, const struct apc_tag *tag, size_t n,
                    apc_ns at, apc_ns offset)
{
    struct reading r = {.o = o, .at = at, .offset = offset};
    int rc = 0;
    *o = (struct prediction){.trajectory = calloc(n + 1, sizeof *o->trajectory)};
    if (!o->trajectory)
        return APC_ENOMEM;
    for (size_t i = 0; i < n && rc == 0; i++) {
        bool planned = false;
        const struct apc_tag *variable = tag[i].table == APC_PREDICTION && tag[i].step > 0
                                             ? expected_variable(&tag[i], tag, n, &planned)
                                             : NULL;
        if (variable)
            rc = load_trajectory(&r, published, &tag[i], variable, planned);
    }
    return rc;
}

void prediction_free(struct prediction *o)
{
    for (size_t i = 0; i < o->n; i++)
        free(o->trajectory[i].expected);
    free(o->trajectory);
    *o = (struct prediction){0};
}

/* ---- What came ---------------------------------------------------------------------------- */

/* A move is looked at in the middle of its step: its row is written when the law has computed. */
static apc_ns looked_at(const struct prediction_trajectory *c, size_t k)
{
    return c->made + c->first + c->step * (apc_ns)k + (c->first == 0 ? c->step / 2 : 0);
}

/* @p row stands from its time to @p until. */
static void fill_with_row(struct prediction_trajectory *c, const struct apc_sample *row, apc_ns from,
                          apc_ns until)
{
    const bool bad = row->table == APC_SENSOR && apc_status_severity(row->status) == APC_SEVERITY_BAD;
    for (size_t k = 0; k < c->n; k++) {
        const apc_ns t = looked_at(c, k);
        if (t >= from && t < until && t - from <= c->patience)
            c->came[k] = bad ? none : row->value;
    }
}

static void take_trajectory(struct prediction_trajectory *c, const struct apc_sample *rows, size_t n,
                            apc_ns end)
{
    const struct apc_sample *before = NULL;
    for (size_t i = 0; i < n; i++) {
        if (rows[i].table != c->table || rows[i].id != c->id)
            continue;
        if (before)
            fill_with_row(c, before, before->time, rows[i].time);
        before = &rows[i];
    }
    if (before)
        fill_with_row(c, before, before->time, end);
}

void prediction_take(struct prediction *o, const struct apc_sample *rows, size_t n)
{
    for (size_t i = 0; i < o->n; i++)
        take_trajectory(&o->trajectory[i], rows, n, n > 0 ? rows[n - 1].time + 1 : 0);
}

static int take_outcome_history(struct prediction_trajectory *c, struct apc_store *store, apc_ns now)
{
    struct samples rows = {0};
    const apc_ns end = looked_at(c, c->n - 1) + 1;
    const struct apc_range before = {.until = c->made, .last = 1}, range = {.since = c->made, .until = end};
    int rc = samples_collect_one(&rows, store, c->table, c->id, &before);
    if (rc == 0)
        rc = samples_collect_one(&rows, store, c->table, c->id, &range);
    if (rc == 0)
        take_trajectory(c, rows.at, rows.n, end < now ? end : now);
    samples_free(&rows);
    return rc;
}

int prediction_take_store(struct prediction *o, struct apc_store *store, apc_ns now)
{
    int rc = 0;
    for (size_t i = 0; i < o->n && rc == 0; i++)
        rc = take_outcome_history(&o->trajectory[i], store, now);
    return rc;
}

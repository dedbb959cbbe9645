/* SPDX-License-Identifier: BSD-3-Clause */
/*
 * A recorded run in closed loop under another law. Its plant is simulated with the outputs on record: what the
 * measurements were beside that is what acted on the plant, and what the model leaves out. Added to each
 * measurement of a simulation whose controllers act, it gives the run on record under the law that ran, and what
 * would have been under another one. Setpoints and modes are those that were written then.
 */
#include "simulation_internal.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

/* ---- What was measured beside the model ----------------------------------------------------- */

static int by_variable_and_time(const void *left, const void *right)
{
    const struct apc_sample *a = left, *b = right;
    if (a->id != b->id)
        return a->id < b->id ? -1 : 1;
    return a->time < b->time ? -1 : a->time > b->time;
}

/* That of the measurement next to its time; NULL: there is none. */
static const struct apc_sample *next_in_time(const struct samples *s, const struct apc_sample *wanted)
{
    size_t low = 0, high = s->n;
    while (low < high) {
        const size_t middle = low + (high - low) / 2;
        if (by_variable_and_time(&s->at[middle], wanted) < 0)
            low = middle + 1;
        else
            high = middle;
    }
    const bool after = low < s->n && s->at[low].id == wanted->id,
               before = low > 0 && s->at[low - 1].id == wanted->id;
    if (after && before && wanted->time - s->at[low - 1].time < s->at[low].time - wanted->time)
        return &s->at[low - 1];
    return after ? &s->at[low] : before ? &s->at[low - 1] : NULL;
}

static void note_spread(struct closed_spread *s, double value)
{
    const double apart = value - s->mean;
    s->mean += apart / (double)++s->n;
    s->squares += apart * (value - s->mean);
}

/* Of a simulation with the outputs on record. A measurement that was Bad then is so again. */
static void note_left_out(void *ctx, struct apc_sample *y, size_t n)
{
    struct closed *c = ctx;
    for (size_t i = 0; i < n; i++) {
        const struct apc_sample *was = next_in_time(&c->recorded, &y[i]);
        struct apc_sample left = y[i];
        if (!was)
            continue;
        const bool bad = apc_status_severity(was->status) == APC_SEVERITY_BAD;
        left.status = was->status;
        left.value = bad ? was->value : was->value - y[i].value;
        struct closed_model *model = &c->model[y[i].id - 1];
        if (!bad) {
            note_spread(&model->measured, was->value);
            note_spread(&model->modelled, y[i].value);
            note_spread(&model->left, left.value);
        }
        c->failed = samples_add(&c->left, &left) < 0 || c->failed;
    }
}

static void add_left_out(void *ctx, struct apc_sample *y, size_t n)
{
    const struct closed *c = ctx;
    for (size_t i = 0; i < n; i++) {
        const struct apc_sample *left = next_in_time(&c->left, &y[i]);
        if (!left)
            continue;
        const bool bad = apc_status_severity(left->status) == APC_SEVERITY_BAD;
        y[i].value = bad ? left->value : y[i].value + left->value;
        y[i].status = left->status;
    }
}

/* ---- What was written ----------------------------------------------------------------------- */

static bool is_for_people(enum apc_table table)
{
    return table == APC_SETPOINT || table == APC_OPMODE || table == APC_MANUAL || table == APC_TUNING;
}

static bool is_first_of(const struct apc_sample *first, size_t n, const struct apc_sample *row)
{
    for (size_t i = 0; i < n; i++)
        if (first[i].table == row->table && first[i].id == row->id)
            return first[i].value >= row->value && first[i].value <= row->value;
    return false;
}

/* By people, or by whomever before the run began, where the experiment has something else. */
static int take_writes(struct samples *to, const struct closed *c, const struct experiment *e, bool tuning)
{
    size_t n = 0;
    struct apc_sample *first = module_first(e, SIMULATION_BEGIN, &n);
    int rc = first ? 0 : APC_ENOMEM;
    for (size_t i = 0; i < c->written.n && rc == 0; i++) {
        struct apc_sample row = c->written.at[i];
        if ((row.table == APC_TUNING && !tuning) ||
            (row.time < SIMULATION_BEGIN ? is_first_of(first, n, &row) : row.author == 0))
            continue;
        row.time = row.time > SIMULATION_BEGIN ? row.time : SIMULATION_BEGIN;
        rc = samples_add(to, &row);
    }
    free(first);
    return rc;
}

static int load_closed_writes(struct closed *c, const struct playback *played)
{
    int n = apc_store_variables(played->ticks, NULL, 0);
    struct apc_sample *variable = n < 0 ? NULL : calloc((size_t)n + 1, sizeof *variable);
    if (!variable)
        return n < 0 ? n : APC_ENOMEM;
    const struct apc_range all = {0};
    int rc = apc_store_variables(played->ticks, variable, (size_t)n);
    n = rc < n ? rc : n;
    for (int i = 0; i < n && rc >= 0; i++)
        if (is_for_people(variable[i].table))
            rc = samples_collect_one(&c->written, played->ticks, variable[i].table, variable[i].id, &all);
    for (size_t i = 0; i < c->written.n; i++)
        c->written.at[i].time += SIMULATION_BEGIN - played->start;
    samples_sort(&c->written);
    free(variable);
    return rc < 0 ? rc : 0;
}

/* ---- The run -------------------------------------------------------------------------------- */

static int load_recorded(struct closed *c, const char *dir, struct apc_error *why)
{
    struct samples *s = &c->recorded;
    const int rc = samples_read(&c->all, dir, "samples.csv", why);
    if (rc < 0)
        return rc;
    for (size_t i = 0; i < c->all.n; i++) {
        struct apc_sample row = c->all.at[i];
        c->end = row.time > c->end ? row.time : c->end;
        row.time += SIMULATION_BEGIN;
        if (row.table == APC_SENSOR && (size_t)row.id <= c->was.dim.ny && samples_add(s, &row) < 0)
            return apc_fail(why, APC_ENOMEM, "out of memory");
    }
    if (s->n == 0)
        return apc_fail(why, APC_ENOTFOUND, "%s has no measurements on record", dir);
    qsort(s->at, s->n, sizeof *s->at, by_variable_and_time);
    return 0;
}

static double closed_duration(const struct closed *c)
{
    return c->was.start || !(c->was.duration > 0) ? apc_ns_to_s(c->end) : c->was.duration;
}

static int estimate_left_out(struct closed *c, const struct playback *played, struct apc_error *why)
{
    struct simulation s;
    int rc = simulation_create_after(&s, &c->was, c->was.seed, played, why);
    s.measured = note_left_out;
    s.measured_ctx = c;
    if (rc == 0 && (rc = simulation_stream(&s, closed_duration(c), NULL, NULL)) < 0)
        apc_fail(why, rc, "the model with the outputs on record: %s", s.why.text);
    simulation_destroy(&s);
    if (rc == 0 && c->failed)
        rc = apc_fail(why, APC_ENOMEM, "out of memory");
    if (c->left.n > 0)
        qsort(c->left.at, c->left.n, sizeof *c->left.at, by_variable_and_time);
    return rc;
}

int closed_load(struct closed *c, const char *dir, struct apc_error *why)
{
    struct playback played = {.ticks = NULL};
    *c = (struct closed){.end = 0};
    int rc = experiment_load(&c->was, dir, EXPERIMENT_MODEL | EXPERIMENT_LAW, NULL, why);
    if (rc == 0 && !c->was.plant.model)
        rc = apc_fail(why, APC_EINVAL, "%s names no model of its plant: there is nothing to simulate", dir);
    c->model = rc == 0 ? calloc(c->was.dim.ny + 1, sizeof *c->model) : NULL;
    if (rc == 0 && !c->model)
        rc = apc_fail(why, APC_ENOMEM, "out of memory");
    if (rc == 0)
        rc = load_recorded(c, dir, why);
    if (rc == 0)
        rc = playback_load(&played, dir, &c->was, c->end + 1, why);
    if (rc == 0 && (rc = load_closed_writes(c, &played)) < 0)
        apc_fail(why, rc, "%s: %s", dir, rc == APC_ENOMEM ? "out of memory" : apc_store_error(played.ticks));
    if (rc == 0)
        rc = estimate_left_out(c, &played, why);
    playback_free(&played);
    return rc;
}

static int take_closed_rows(void *to, const struct samples *rows)
{
    return samples_append(to, rows);
}

/* What people did is among what was written. */
static int run_closed(struct closed *c, struct experiment *e, const struct samples *writes,
                      struct samples *made, struct apc_error *why)
{
    struct simulation s;
    size_t n = 0;
    for (size_t i = 0; i < e->n_actions; i++)
        if (e->action[i].kind != ACTION_WRITE)
            e->action[n++] = e->action[i];
    e->n_actions = n;
    int rc = simulation_create(&s, e, c->was.seed, why);
    s.measured = add_left_out;
    s.measured_ctx = c;
    if (rc == 0 && (rc = simulation_repeat_writes(&s, writes)) < 0)
        apc_fail(why, rc, "out of memory");
    if (rc == 0 && (rc = simulation_stream(&s, closed_duration(c), take_closed_rows, made)) < 0)
        *why = s.why;
    simulation_destroy(&s);
    for (size_t i = 0; i < made->n; i++)
        made->at[i].time -= SIMULATION_BEGIN;
    return rc;
}

int closed_run(struct closed *c, const char *dir, const struct experiment_overrides *overrides,
               struct samples *made, struct apc_error *why)
{
    struct experiment e;
    struct samples writes = {0};
    int rc = experiment_load(&e, dir, EXPERIMENT_MODEL | EXPERIMENT_LAW, overrides, why);
    if (rc == 0 && (rc = take_writes(&writes, c, &e, !overrides)) < 0)
        apc_fail(why, rc, "out of memory");
    if (rc == 0)
        rc = run_closed(c, &e, &writes, made, why);
    samples_free(&writes);
    experiment_free(&e);
    return rc;
}

double closed_left_out(const struct closed *c, size_t k)
{
    const struct closed_model *m = &c->model[k];
    const double most = fmax(m->measured.squares, m->modelled.squares);
    return most > 0 ? sqrt(m->left.squares / most) : 0;
}

void closed_free(struct closed *c)
{
    samples_free(&c->all);
    samples_free(&c->recorded);
    samples_free(&c->left);
    samples_free(&c->written);
    free(c->model);
    experiment_free(&c->was);
}

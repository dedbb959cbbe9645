/* SPDX-License-Identifier: BSD-3-Clause */
/*
 * A recorded run in closed loop under another law. Its plant is simulated with the outputs on record: what the
 * measurements were beside that is what acted on the plant, and what the model leaves out. Added to each
 * measurement of a simulation whose controllers act, it gives the run on record under the law that ran, and what
 * would have been under another one. Setpoints and modes are those that were written then. A part of a record goes
 * on from what was in force when it begins, as a plant whose controllers are started again does.
 */
#include "closed_internal.h"

#include <math.h>
#include <stdlib.h>

#include "simulation_internal.h"

/* ---- What was measured beside the model ----------------------------------------------------- */

int closed_by_variable_and_time(const void *left, const void *right)
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
        if (closed_by_variable_and_time(&s->at[middle], wanted) < 0)
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

static bool was_bad(const struct apc_sample *row)
{
    return apc_status_severity(row->status) == APC_SEVERITY_BAD;
}

/* Of a simulation with the outputs on record. */
static void note_modelled(void *ctx, struct apc_sample *y, size_t n)
{
    struct closed *c = ctx;
    for (size_t i = 0; i < n; i++) {
        const struct apc_sample *was = next_in_time(&c->recorded, &y[i]);
        struct closed_model *model = &c->model[y[i].id - 1];
        if (was && !was_bad(was) && y[i].time >= SIMULATION_BEGIN + c->since) {
            note_spread(&model->measured, was->value);
            note_spread(&model->modelled, y[i].value);
            note_spread(&model->left, was->value - y[i].value);
        }
        c->failed = samples_add(&c->modelled, &y[i]) < 0 || c->failed;
    }
}

/* A measurement that was Bad then is so again; where the model does what it did, so is what was measured. */
static void add_left_out(void *ctx, struct apc_sample *y, size_t n)
{
    const struct closed *c = ctx;
    for (size_t i = 0; i < n; i++) {
        const struct apc_sample *was = next_in_time(&c->recorded, &y[i]),
                                *modelled = next_in_time(&c->modelled, &y[i]);
        if (!was || !modelled)
            continue;
        const double moved = y[i].value - modelled->value;
        y[i].value = was_bad(was) ? was->value : was->value + moved;
        y[i].status = was->status;
    }
}

/* ---- What was written ----------------------------------------------------------------------- */

static bool is_first_of(const struct apc_sample *first, size_t n, const struct apc_sample *row)
{
    for (size_t i = 0; i < n; i++)
        if (first[i].table == row->table && first[i].id == row->id)
            return first[i].value >= row->value && first[i].value <= row->value;
    return false;
}

/* By people, or by whomever before the run began, where the experiment has something else. */
static bool is_repeated_in_run(const struct apc_sample *row, const struct apc_sample *first, size_t n)
{
    return row->time < SIMULATION_BEGIN ? !is_first_of(first, n, row) : row->author > 0;
}

static bool is_moved_by_loop(const struct experiment *e, int setpoint)
{
    for (size_t i = 0; i < e->n_controllers; i++)
        for (size_t k = 0; k < e->controllers[i].dim.nu; k++)
            if (e->controllers[i].u[k].table == APC_SETPOINT &&
                (int)e->controllers[i].u[k].at + 1 == setpoint)
                return true;
    return false;
}

/* By people and the scheduler, since then. */
static bool is_repeated_in_part(const struct closed *c, const struct apc_sample *row)
{
    const bool scheduled =
        row->table == APC_SETPOINT && (size_t)row->id <= c->was.dim.nz && !is_moved_by_loop(&c->was, row->id);
    return row->time >= SIMULATION_BEGIN + c->since && (row->author > 0 || scheduled);
}

/* In a part the tuning of its own is in force from its beginning on. */
static int take_writes(struct samples *to, const struct closed *c, const struct experiment *e, bool tuning)
{
    size_t n = 0;
    struct apc_sample *first = module_first(e, SIMULATION_BEGIN, &n);
    int rc = first ? 0 : APC_ENOMEM;
    for (size_t i = 0; i < n && c->since > 0 && !tuning && rc == 0; i++) {
        first[i].time = SIMULATION_BEGIN + c->since;
        rc = first[i].table == APC_TUNING ? samples_add(to, &first[i]) : 0;
    }
    for (size_t i = 0; i < c->written.n && rc == 0; i++) {
        struct apc_sample row = c->written.at[i];
        if ((row.table == APC_TUNING && !tuning) ||
            !(c->since > 0 ? is_repeated_in_part(c, &row) : is_repeated_in_run(&row, first, n)))
            continue;
        row.time = row.time > SIMULATION_BEGIN ? row.time : SIMULATION_BEGIN;
        rc = samples_add(to, &row);
    }
    free(first);
    return rc;
}

/* ---- The run -------------------------------------------------------------------------------- */

static double closed_duration(const struct closed *c)
{
    return c->gaps_known || !(c->was.duration > 0) ? apc_ns_to_s(c->end) : c->was.duration;
}

int closed_estimate(struct closed *c, struct apc_error *why)
{
    struct simulation s;
    int rc = simulation_create_after(&s, &c->was, c->was.seed, &c->played, why);
    s.measured = note_modelled;
    s.measured_ctx = c;
    if (rc == 0 && (rc = simulation_stream(&s, closed_duration(c), NULL, NULL)) < 0)
        apc_fail(why, rc, "the model with the outputs on record: %s", s.why.text);
    simulation_destroy(&s);
    if (rc == 0 && c->failed)
        rc = apc_fail(why, APC_ENOMEM, "out of memory");
    if (c->modelled.n > 0)
        qsort(c->modelled.at, c->modelled.n, sizeof *c->modelled.at, closed_by_variable_and_time);
    return rc;
}

/* What people did is among what was written, and when a controller was away among its gaps. */
static int take_actions(const struct closed *c, struct experiment *e)
{
    const struct action *from = c->gaps_known ? c->gap : e->action;
    const size_t all = c->gaps_known ? c->n_gaps : e->n_actions;
    struct action *taken = calloc(all + 1, sizeof *taken);
    size_t n = 0;
    for (size_t i = 0; i < all && taken; i++)
        if (from[i].kind != ACTION_WRITE)
            taken[n++] = from[i];
    if (!taken)
        return APC_ENOMEM;
    free(e->action);
    e->action = taken;
    e->n_actions = n;
    return 0;
}

static int take_closed_rows(void *made, const struct samples *rows)
{
    return samples_append(made, rows);
}

/* Until the part begins it is as it was. */
static int begin_part(struct simulation *s, struct playback *before, struct closed *c,
                      const struct experiment *e, struct apc_error *why)
{
    *before = c->played;
    before->end = c->start + c->since;
    for (before->rows.n = 0; before->rows.n < c->played.rows.n &&
                             before->rows.at[before->rows.n].time < SIMULATION_BEGIN + c->since;)
        before->rows.n++;
    int rc = simulation_create_after(s, &c->was, c->was.seed, before, why);
    s->measured = add_left_out;
    s->measured_ctx = c;
    if (rc == 0 && (rc = simulation_run(s, apc_ns_to_s(c->since))) < 0)
        *why = s->why;
    return rc < 0 ? rc : simulation_branch(s, e, why);
}

static int run_closed(struct closed *c, struct experiment *e, const struct samples *writes,
                      struct samples *made, struct apc_error *why)
{
    struct simulation s;
    struct playback before;
    int rc = take_actions(c, e) < 0 ? apc_fail(why, APC_ENOMEM, "out of memory") : 0;
    if (rc < 0)
        return rc;
    rc = c->since > 0 ? begin_part(&s, &before, c, e, why) : simulation_create(&s, e, c->was.seed, why);
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

int closed_run(struct closed *c, const struct experiment_overrides *overrides, struct samples *made,
               struct apc_error *why)
{
    struct experiment e;
    struct samples writes = {0};
    int rc = closed_experiment(c, &e, overrides, why);
    if (rc == 0)
        rc = closed_shift_scheduler(c, &e, why);
    if (rc == 0 && (rc = take_writes(&writes, c, &e, !overrides)) < 0)
        apc_fail(why, rc, "out of memory");
    if (rc == 0)
        rc = run_closed(c, &e, &writes, made, why);
    samples_free(&writes);
    experiment_free(&e);
    return rc;
}

int closed_promote(struct closed *c, const struct controller *to)
{
    const struct apc_sample acts = {.table = APC_OPMODE,
                                    .id = to->acting,
                                    .time = SIMULATION_BEGIN + c->since,
                                    .value = to->number,
                                    .status = APC_GOOD,
                                    .author = 1};
    size_t n = 0;
    for (size_t i = 0; i < c->written.n; i++) {
        const struct apc_sample *row = &c->written.at[i];
        if (row->table != APC_OPMODE || row->id != acts.id || row->time < acts.time)
            c->written.at[n++] = *row;
    }
    c->written.n = n;
    const int rc = samples_add(&c->written, &acts);
    samples_sort(&c->written);
    return rc;
}

double closed_left_out(const struct closed *c, size_t k)
{
    const struct closed_model *m = &c->model[k];
    const double most = fmax(m->measured.squares, m->modelled.squares);
    return most > 0 ? sqrt(m->left.squares / most) : 0;
}

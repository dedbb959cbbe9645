/* SPDX-License-Identifier: BSD-3-Clause */
/*
 * Each step is a swap: whoever writes meanwhile has the last word, and what he wrote is not the row that the ramp
 * left, which ends it. Only a mover that has begun anew does not know that row. Then it is the one that the ramp
 * began with, or a later one under no name, as movers write.
 */
#include "operate.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>

#define STEP_MOST                                                                                            \
    APC_NS_PER_S /* of time that one step makes up for: a mover that was held up does not jump */

/* ---- Which there are ----------------------------------------------------------------------- */

static bool is_taken_by(const struct plant_view *plant, const struct apc_tag *tag,
                        const struct loops_controller *of)
{
    const struct loops_controller *by = loops_controller(plant->loops, tag->controller);
    return (tag->table == APC_SETPOINT || tag->table == APC_MANUAL) && by &&
           (!of || by == of || (tag->table == APC_SETPOINT && by->choice && by->choice == of->choice));
}

static struct ramp name_ramp(const struct plant_view *plant, const struct apc_tag *tag)
{
    const struct loops_loop *loop =
        tag->table == APC_MANUAL ? loops_of(plant->loops, APC_MANUAL, tag->id) : NULL;
    return (struct ramp){.tag = tag,
                         .rate = {.table = tag->table, .id = LOOPS_RATE(tag->id)},
                         .target = {.table = tag->table, .id = LOOPS_RAMP(tag->id)},
                         .now = {.table = tag->table, .id = tag->id},
                         .mode = {.table = loop ? APC_OPMODE : 0, .id = loop ? loop->id : 0}};
}

int ramps_init(struct ramps *r, const struct plant_view *plant, const struct loops_controller *of)
{
    *r = (struct ramps){.plant = plant,
                        .at = calloc(plant->n + 1, sizeof *r->at),
                        .row = calloc(3 * plant->n + 1, sizeof *r->row),
                        .choice = of ? of->choice : 0,
                        .number = of ? of->number : 0,
                        .acts = !of || of->acts};
    for (size_t i = 0; i < plant->n && r->at; i++)
        if (is_taken_by(plant, &plant->tag[i], of))
            r->at[r->n++] = name_ramp(plant, &plant->tag[i]);
    return r->at && r->row ? 0 : APC_ENOMEM;
}

void ramps_free(struct ramps *r)
{
    free(r->at);
    free(r->row);
    *r = (struct ramps){0};
}

/* ---- Where they are ------------------------------------------------------------------------ */

static bool is_on_its_way(const struct ramp *ramp)
{
    return ramp->rate.seq > 0 && ramp->rate.value > 0;
}

/* Of those on their way the rest. */
static int read_ways(struct ramps *r, struct apc_store *store)
{
    size_t n = 0;
    for (size_t i = 0; i < r->n; i++) {
        if (!is_on_its_way(&r->at[i]))
            continue;
        r->row[n++] = r->at[i].target;
        r->row[n++] = r->at[i].now;
        if (r->at[i].mode.table)
            r->row[n++] = r->at[i].mode;
    }
    const int rc = apc_store_read(store, r->row, n);
    n = 0;
    for (size_t i = 0; i < r->n && rc >= 0; i++) {
        if (!is_on_its_way(&r->at[i]))
            continue;
        r->at[i].target = r->row[n++];
        r->at[i].now = r->row[n++];
        if (r->at[i].mode.table)
            r->at[i].mode = r->row[n++];
    }
    return rc;
}

int ramps_read(struct ramps *r, struct apc_store *store)
{
    const bool shares = r->choice > 0;
    int n = 0;
    if (r->n == 0)
        return 0;
    for (size_t i = 0; i < r->n; i++)
        r->row[i] = r->at[i].rate;
    r->row[r->n] = (struct apc_sample){.table = APC_OPMODE, .id = r->choice};
    int rc = apc_store_read(store, r->row, r->n + shares);
    const struct apc_sample *choice = &r->row[r->n];
    const bool acts = !shares || choice->seq == 0 ? r->acts : choice->value == (double)r->number;
    for (size_t i = 0; i < r->n && rc >= 0; i++) {
        r->at[i].rate = r->row[i];
        if (!acts && r->at[i].now.table == APC_SETPOINT)
            r->at[i].rate.value = 0; /* another one moves it */
        n += is_on_its_way(&r->at[i]);
    }
    if (rc >= 0 && n > 0)
        rc = read_ways(r, store);
    return rc < 0 ? rc : n;
}

double ramp_to_go(const struct ramp *ramp)
{
    return is_on_its_way(ramp) ? fabs(ramp->target.value - ramp->now.value) / ramp->rate.value : 0;
}

/* ---- Moving -------------------------------------------------------------------------------- */

static bool is_own(const struct ramp *ramp)
{
    const struct apc_sample *now = &ramp->now, *rate = &ramp->rate;
    return ramp->moved > 0
               ? now->seq == ramp->moved
               : now->seq > 0 && now->time >= rate->time && (now->author == 0 || now->time == rate->time);
}

/* A setpoint may move in any mode. */
static bool is_in_man(const struct ramp *ramp)
{
    const struct apc_sample *mode = &ramp->mode;
    return !mode->table || (mode->seq > 0 && mode->value == (double)APC_MODE_MAN);
}

/* To four digits of the step, for people who read them. */
static double rounded_by_step(double value, double step)
{
    double places = 1;
    while (step * places < 1000 && places < 1e15)
        places *= 10;
    return round(value * places) / places;
}

static double value_after(const struct ramp *ramp, apc_ns mono)
{
    const apc_ns since = ramp->moved > 0 ? mono - ramp->last : 0;
    const double reach = ramp->rate.value * apc_ns_to_s(since < STEP_MOST ? since : STEP_MOST);
    const double from = ramp->now.value, to = ramp->target.value;
    return reach > 0 ? fabs(to - from) <= reach * (1 + 1e-9)
                           ? to
                           : rounded_by_step(from + copysign(reach, to - from), reach)
                     : from;
}

/* "r: the ramp arrived at 50", with what stands behind it. */
static void tell_of_ramp(const struct ramps *r, const struct ramp *ramp, enum apc_event_severity severity,
                         const char *what, const char *behind, const struct ramp_told *told)
{
    char text[192], value[DECIMAL_LEN];
    struct change_target to;
    struct change_fault why;
    const bool known = change_at(r->plant, ramp->tag->table, ramp->tag->id, &to, &why) == 0;
    snprintf(text, sizeof text, "%.60s: the ramp %s %s%.80s", known ? to.name : ramp->tag->name, what,
             decimal_shortest(ramp->now.value, 6, value), behind);
    told->say(told->ctx, severity, text);
}

/* A store that is away keeps all of them where they are, and its user says so; one that refuses is told of for
 * each, once. */
static bool keeps_all_ramps(int rc)
{
    return rc == APC_ECONN || rc == APC_ETIMEDOUT;
}

static void tell_of_refusal(const struct ramps *r, struct ramp *ramp, struct apc_store *store, int rc,
                            const struct ramp_told *told)
{
    char behind[96];
    snprintf(behind, sizeof behind, ": %s", apc_store_error(store));
    if (rc != ramp->refused)
        tell_of_ramp(r, ramp, APC_EVENT_WARNING, "stands still at", behind, told);
    ramp->refused = rc;
}

/* Returns 1: it goes on, 0: it has ended, or the store's error. */
static int move_ramp(const struct ramps *r, struct ramp *ramp, struct apc_store *store, struct apc_now now,
                     const struct ramp_told *told)
{
    const bool own = is_own(ramp), goes_on = own && is_in_man(ramp);
    const double value = goes_on ? value_after(ramp, now.mono) : 0;
    const bool arrives = goes_on && value == ramp->target.value, moves = goes_on && value != ramp->now.value;
    struct apc_sample row[2];
    size_t n = 0;

    if (moves)
        row[n++] = (struct apc_sample){.table = ramp->now.table,
                                       .id = ramp->now.id,
                                       .seq = ramp->now.seq,
                                       .time = now.utc,
                                       .value = value};
    if (!goes_on || arrives)
        row[n++] = (struct apc_sample){
            .table = ramp->rate.table, .id = ramp->rate.id, .seq = ramp->rate.seq, .time = now.utc};
    const int rc = n > 0 ? apc_store_swap(store, row, n) : 0;
    if (rc < 0)
        return rc == APC_ECONFLICT ? 1 : rc; /* the next look says what came */
    if (moves) {
        ramp->now = row[0];
        if (told->moved)
            told->moved(told->ctx, row);
    }
    ramp->moved = goes_on ? ramp->now.seq : 0;
    ramp->last = now.mono;
    ramp->refused = 0;
    if (!goes_on)
        tell_of_ramp(r, ramp, APC_EVENT_INFO, own ? "ended, as its loop is not in Man, at" : "ended: it is",
                     "", told);
    else if (arrives)
        tell_of_ramp(r, ramp, APC_EVENT_INFO, "arrived at", "", told);
    return goes_on && !arrives;
}

int ramps_step(struct ramps *r, struct apc_store *store, struct apc_now now, const struct ramp_told *told)
{
    int rc = ramps_read(r, store), n = 0;
    for (size_t i = 0; i < r->n && rc >= 0; i++) {
        struct ramp *ramp = &r->at[i];
        if (!is_on_its_way(ramp)) {
            ramp->moved = 0;
            ramp->refused = 0;
            continue;
        }
        const int moved = move_ramp(r, ramp, store, now, told);
        if (keeps_all_ramps(moved))
            rc = moved;
        else if (moved < 0)
            tell_of_refusal(r, ramp, store, moved, told);
        n += moved != 0;
    }
    return rc < 0 ? rc : n;
}

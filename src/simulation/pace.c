/* SPDX-License-Identifier: BSD-3-Clause */
/*
 * A simulation that people look on at and operate, so many times as fast as time. Between two ticks of the plant its
 * store is everybody's, and the plant's time stands still; during a tick it is the simulation's alone. Only the waiting
 * between them knows of real time: nothing that is computed does.
 */
#include <math.h>
#include <stdlib.h>
#include <time.h>

#include "simulation_internal.h"

#define LOOK   (20 * APC_NS_PER_MS)
#define BEHIND (250 * APC_NS_PER_MS) /* what it is late beyond that it does not make up for */
#define WINDOW APC_NS_PER_S          /* over which the reached speed is taken */
#define TICKS  10                    /* after so many there is a first one */

struct pacer {
    struct simulation *s;
    const struct pace_watch *watch;
    apc_ns looked;
    double asked;       /* which holds since then: */
    apc_ns wall, plant; /* monotonic, and since t = 0 */
    double reached;     /* measured from then on: */
    apc_ns window_wall, window_plant;
    bool young;          /* the first such window, which counts as it grows */
    struct samples seen; /* of what people may write to: the newest when they last did, or at the start */
    size_t told;         /* of what they wrote */
};

/* ---- What others wrote ---------------------------------------------------------------------- */

static bool is_peoples(enum apc_table table)
{
    return table == APC_SETPOINT || table == APC_OPMODE || table == APC_TUNING || table == APC_MANUAL;
}

/* Of each variable that people may write to what there is of it: table, id and seq. */
static int list_written(struct apc_store *store, struct samples *list)
{
    const int n = apc_store_variables(store, NULL, 0);
    struct apc_sample *at = n < 0 ? NULL : calloc((size_t)n + 1, sizeof *at);
    int rc = n < 0 ? n : at ? apc_store_variables(store, at, (size_t)n) : APC_ENOMEM;
    for (int i = 0; i < n && rc >= 0; i++)
        if (is_peoples(at[i].table))
            rc = samples_add(list, &at[i]);
    if (rc >= 0)
        rc = apc_store_read(store, list->at, list->n);
    free(at);
    return rc < 0 ? rc : 0;
}

static int64_t seq_among(const struct samples *list, const struct apc_sample *variable)
{
    size_t i = 0;
    while (i < list->n && (list->at[i].table != variable->table || list->at[i].id != variable->id))
        i++;
    return i < list->n ? list->at[i].seq : 0;
}

/* At @t, to which it comes next: the clock stands just before, or, where something has happened then, there. */
static apc_ns utc_at(const struct simulation *s, apc_ns t)
{
    return apc_clock_utc(s->clock) + s->zero + t - apc_clock_mono(s->clock);
}

/* What the modules write in a tick is older than what comes after it. Of its variable it comes after what was there
 * when the one before was kept, or at the start: who writes may have a clock of his own. */
static int keep_written(struct pacer *p, apc_ns t)
{
    struct simulation *s = p->s;
    struct samples now = {0};
    const size_t had = s->written.n;
    int rc = list_written(s->store, &now);
    for (size_t i = 0; i < now.n && rc == 0; i++) {
        const struct apc_range range = {.since = t > 0 ? utc_at(s, t) : 0,
                                        .after = seq_among(&p->seen, &now.at[i])};
        rc = samples_collect_one(&s->written, s->store, now.at[i].table, now.at[i].id, &range);
    }
    for (size_t i = had; i < s->written.n; i++)
        s->written.at[i].time = SIMULATION_BEGIN + t;
    samples_free(&p->seen);
    p->seen = now;
    return rc;
}

static void on_written(void *ctx)
{
    simulation_see_writes(ctx);
}

/* ---- A tick --------------------------------------------------------------------------------- */

apc_ns simulation_next_tick(const struct simulation *s, apc_ns t)
{
    const struct rhythm *r = &s->e->plant.rhythm;
    return t < r->phase ? r->phase : r->phase + ((t - r->phase) / r->period + 1) * r->period;
}

apc_ns simulation_nearest_tick(const struct experiment *e, apc_ns t)
{
    const struct rhythm *r = &e->plant.rhythm;
    return t < r->phase / 2 ? 0 : r->phase + (t - r->phase + r->period / 2) / r->period * r->period;
}

/* Before the tick at which it takes effect; what is repeated, within a tick, after it. */
static void tell_written(struct pacer *p)
{
    const size_t from = p->told;
    p->told = p->s->written.n;
    if (p->told > from)
        p->watch->written(p->watch->ctx, from);
}

static int make_paced_tick(struct pacer *p, apc_ns t, apc_ns end)
{
    struct simulation *s = p->s;
    const apc_ns next = simulation_next_tick(s, t);
    const int64_t written = apc_store_begin_tick(s->store);
    simulation_stop_at_store(s, written < 0 ? (int)written : written > 0 ? keep_written(p, t) : 0);
    if (written > 0)
        simulation_happen(s, on_written, s);
    tell_written(p);
    simulation_run(s, apc_ns_to_s(next < end ? next : end));
    const apc_ns now =
        s->rc == 0 && !s->interrupted ? utc_at(s, next < end ? next : end) : apc_clock_utc(s->clock) + 1;
    simulation_stop_at_store(s, apc_store_end_tick(s->store, now, p->watch->repeats ? -1 : p->reached));
    return s->rc;
}

/* ---- Waiting -------------------------------------------------------------------------------- */

static void begin_at_speed(struct pacer *p, double asked, apc_ns wall, apc_ns plant)
{
    p->asked = asked;
    p->wall = wall;
    p->plant = plant;
}

static void measure_speed(struct pacer *p, apc_ns wall, apc_ns plant)
{
    const apc_ns took = wall - p->window_wall;
    const bool early =
        p->young && took >= APC_NS_PER_MS && plant - p->window_plant >= TICKS * p->s->e->plant.rhythm.period;
    if (took >= WINDOW || early)
        p->reached = (double)(plant - p->window_plant) / (double)took;
    if (took < WINDOW)
        return;
    p->young = false;
    p->window_wall = wall;
    p->window_plant = plant;
}

static void sleep_paced(apc_ns t)
{
    t = t < LOOK ? t : LOOK;
    nanosleep(&(struct timespec){.tv_nsec = (long)t}, NULL);
}

/* Until the next tick, at @t, is due. False: somebody has ended it, or it is to go back. */
static bool wait_for_turn(struct pacer *p, apc_ns t)
{
    for (;;) {
        struct apc_store_clock clock = {.size = sizeof clock};
        const int rc = apc_store_clock(p->s->store, &clock);
        const apc_ns wall = apc_clock_mono(NULL);
        simulation_stop_at_store(p->s, rc);
        if (rc < 0 || clock.rewind > 0)
            return false;
        if (wall - p->looked >= LOOK) {
            p->looked = wall;
            if (p->watch->look(p->watch->ctx))
                return false;
        }
        measure_speed(p, wall, t);
        if (clock.asked != p->asked) {
            p->reached = 0;
            p->young = true;
            p->window_wall = wall;
            p->window_plant = t;
        }
        if (clock.asked != p->asked || clock.asked == 0)
            begin_at_speed(p, clock.asked, wall, t);
        if (clock.asked == 0 && clock.steps == 0) {
            sleep_paced(LOOK);
            continue;
        }
        if (clock.asked == 0 || isinf(clock.asked))
            return true;
        const apc_ns due = p->wall + (apc_ns)((double)(t - p->plant) / clock.asked);
        if (due <= wall) {
            if (wall - due > BEHIND)
                begin_at_speed(p, clock.asked, wall, t);
            return true;
        }
        sleep_paced(due - wall);
    }
}

int simulation_pace(struct simulation *s, double until, const struct pace_watch *watch)
{
    const apc_ns wall = apc_clock_mono(NULL);
    struct pacer p = {.s = s, .watch = watch, .window_wall = wall, .young = true, .told = s->written.n};
    apc_ns t = 0, end;
    if (apc_ns_from_s(until, &end) < 0 || end <= 0)
        return s->rc = apc_fail(&s->why, APC_EINVAL, "a duration of %g s: must be above 0", until);
    (void)apc_ns_from_s(s->ended, &t);
    begin_at_speed(&p, 0, wall, t);
    p.window_plant = t;
    simulation_stop_at_store(s, list_written(s->store, &p.seen));
    simulation_stop_at_store(s, apc_store_end_tick(s->store, utc_at(s, t), watch->repeats ? -1 : 0));
    while (s->rc == 0 && !s->interrupted && t < end && wait_for_turn(&p, t)) {
        make_paced_tick(&p, t, end);
        (void)apc_ns_from_s(s->ended, &t);
    }
    tell_written(&p);
    samples_free(&p.seen);
    return s->rc;
}

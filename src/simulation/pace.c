/* SPDX-License-Identifier: BSD-3-Clause */
/*
 * A simulation that people look on at and operate, so many times as fast as time. Between two ticks of the plant its
 * store is everybody's, and the plant's time stands still; during a tick it is the simulation's alone. Only the waiting
 * between them knows of real time: nothing that is computed does.
 */
#include <math.h>
#include <time.h>

#include "simulation_internal.h"

#define LOOK   (20 * APC_NS_PER_MS)
#define BEHIND (250 * APC_NS_PER_MS) /* what it is late beyond that it does not make up for */
#define WINDOW APC_NS_PER_S          /* over which the reached speed is taken */
#define TICKS  10                    /* after so many there is a first one */

struct pacer {
    struct simulation *s;
    bool (*look)(void *ctx);
    void *ctx;
    apc_ns looked;
    double asked;       /* which holds since then: */
    apc_ns wall, plant; /* monotonic, and since t = 0 */
    double reached;     /* measured from then on: */
    apc_ns window_wall, window_plant;
    bool young; /* the first such window, which counts as it grows */
};

/* ---- What others wrote ---------------------------------------------------------------------- */

static void take_written_setpoints(struct simulation *s)
{
    for (size_t k = 0; k < s->e->dim.nz; k++) {
        struct apc_sample newest = {.table = APC_SETPOINT, .id = (int)k + 1};
        simulation_stop_at_store(s, apc_store_read(s->store, &newest, 1));
        if (newest.seq > 0)
            trajectory_change(&s->trajectory, &s->trajectory.setpoint[k], simulation_time(s), newest.value);
    }
}

static void on_written(void *ctx)
{
    struct simulation *s = ctx;
    take_written_setpoints(s);
    if (s->schedules)
        simulation_look(s);
}

/* ---- A tick --------------------------------------------------------------------------------- */

/* t of the plant's next tick. */
static apc_ns next_plant_tick(const struct simulation *s, apc_ns t)
{
    const struct rhythm *r = &s->e->plant.rhythm;
    return t < r->phase ? r->phase : r->phase + ((t - r->phase) / r->period + 1) * r->period;
}

static int make_paced_tick(struct pacer *p, apc_ns t, apc_ns end)
{
    struct simulation *s = p->s;
    const apc_ns next = next_plant_tick(s, t);
    const int64_t written = apc_store_begin_tick(s->store);
    simulation_stop_at_store(s, written < 0 ? (int)written : 0);
    if (written > 0)
        simulation_happen(s, on_written, s);
    simulation_run(s, apc_ns_to_s(next < end ? next : end));
    simulation_stop_at_store(s, apc_store_end_tick(s->store, apc_clock_utc(s->clock) + 1, p->reached));
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

/* Until the next tick, at @t, is due. False: somebody has ended it. */
static bool wait_for_turn(struct pacer *p, apc_ns t)
{
    for (;;) {
        struct apc_store_clock clock = {.size = sizeof clock};
        const int rc = apc_store_clock(p->s->store, &clock);
        const apc_ns wall = apc_clock_mono(NULL);
        simulation_stop_at_store(p->s, rc);
        if (rc < 0)
            return false;
        if (wall - p->looked >= LOOK) {
            p->looked = wall;
            if (p->look(p->ctx))
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

int simulation_pace(struct simulation *s, double until, bool (*look)(void *ctx), void *ctx)
{
    const apc_ns wall = apc_clock_mono(NULL);
    struct pacer p = {.s = s, .look = look, .ctx = ctx, .window_wall = wall, .young = true};
    apc_ns t = 0, end;
    if (apc_ns_from_s(until, &end) < 0 || end <= 0)
        return s->rc = apc_fail(&s->why, APC_EINVAL, "a duration of %g s: must be above 0", until);
    (void)apc_ns_from_s(s->ended, &t);
    begin_at_speed(&p, 0, wall, t);
    p.window_plant = t;
    while (s->rc == 0 && !s->interrupted && t < end && wait_for_turn(&p, t)) {
        make_paced_tick(&p, t, end);
        (void)apc_ns_from_s(s->ended, &t);
    }
    return s->rc;
}

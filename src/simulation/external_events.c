/* SPDX-License-Identifier: BSD-3-Clause */
/* What happens in a simulation that is no module's: the wall clock steps, an operator acts, a past is
 * repeated. */
#include "simulation_internal.h"

#include <stdio.h>
#include <stdlib.h>
#include <unistd.h>

struct clock_step {
    struct simulation *s;
    const struct clock_change *change;
};

struct action_step {
    struct simulation *s;
    const struct action *action;
};

/* ---- The wall clock ----------------------------------------------------------------------- */

static void on_clock(void *ctx)
{
    struct clock_step *step = ctx;
    const struct clock_change *c = step->change;
    apc_virtual_set_clock(step->s->executive, c->step, c->drift);
    if (c->step != 0)
        simulation_tell(step->s, "apc-simulate", APC_EVENT_WARNING, "clock",
                        "the wall clock stepped by %+.3f s; periods are not affected", apc_ns_to_s(c->step));
}

int simulation_schedule_clock(struct simulation *s)
{
    const struct models *m = &s->e->models;
    s->clock_steps = calloc(m->n_clock + 1, sizeof *s->clock_steps);
    if (!s->clock_steps)
        return APC_ENOMEM;
    for (size_t i = 0; i < m->n_clock; i++) {
        s->clock_steps[i] = (struct clock_step){s, &m->clock[i]};
        if (apc_virtual_at(s->executive, s->zero + m->clock[i].at, RANK_CLOCK, on_clock, &s->clock_steps[i]) <
            0)
            return APC_ENOMEM;
    }
    return 0;
}

/* ---- The operator -------------------------------------------------------------------------- */

static void write_as_operator(struct simulation *s, const struct action *action, const char *who)
{
    simulation_stop_at_store(
        s, action_do(s->store, &s->loops, s->tags, s->n_tags, action, apc_clock_utc(s->clock), who));
    if (action->to.table == APC_SETPOINT)
        trajectory_change(&s->trajectory, &s->trajectory.setpoint[action->to.id - 1], simulation_time(s),
                          action->to.value);
    if (s->schedules) /* it sees at once whose its setpoints are */
        simulation_look(s);
}

void simulation_do(struct simulation *s, const struct action *action, const char *who)
{
    struct simulated *c = &s->controller[action->controller];
    struct apc_error why;
    if (action->kind == ACTION_WRITE) {
        write_as_operator(s, action, who);
        return;
    }
    const bool start = action->kind == ACTION_START;
    if (start && simulation_start(c, &why) < 0)
        simulation_stop(s, APC_ESTATE, "at t = %g s: %s", simulation_time(s), why.text);
    else if (!start)
        simulation_kill(c);
    simulation_tell(s, who, APC_EVENT_INFO, start ? "start" : "stop", "%s %s", c->of->name,
                    start ? "started" : "killed");
}

static void on_call(void *ctx)
{
    struct simulation *s = ctx;
    simulation_do(s, s->call, "operator");
}

/* An event of its own, at the very instant that the run has come to: what else happens then comes after it. */
int simulation_happen(struct simulation *s, apc_virtual_fn event, void *ctx)
{
    apc_ns t;
    if (s->rc < 0 || s->interrupted)
        return s->rc;
    apc_ns_from_s(s->ended, &t);
    if (apc_virtual_at(s->executive, s->zero + t, RANK_OPERATOR, event, ctx) < 0)
        return s->rc = apc_fail(&s->why, APC_ENOMEM, "out of memory");
    s->handled += apc_virtual_run(s->executive, s->zero + t);
    return s->rc;
}

int simulation_operate(struct simulation *s, const struct action *action)
{
    s->call = action;
    return simulation_happen(s, on_call, s);
}

static void on_action(void *ctx)
{
    const struct action_step *step = ctx;
    simulation_do(step->s, step->action, "apc-simulate");
}

int simulation_schedule_actions(struct simulation *s, apc_ns from)
{
    const struct experiment *e = s->e;
    loops_free(&s->loops);
    free(s->tags);
    free(s->action_steps); /* those of another experiment have been done */
    s->tags = provision_tags(e, &s->n_tags);
    s->action_steps = calloc(e->n_actions + 1, sizeof *s->action_steps);
    if (!s->tags || !s->action_steps || controllers_describe(e, &s->loops) < 0)
        return APC_ENOMEM;
    for (size_t i = 0; i < e->n_actions && !s->playback; i++) { /* they are among its rows */
        s->action_steps[i] = (struct action_step){s, &e->action[i]};
        if (e->action[i].at >= from && apc_virtual_at(s->executive, s->zero + e->action[i].at, RANK_OPERATOR,
                                                      on_action, &s->action_steps[i]) < 0)
            return APC_ENOMEM;
    }
    return 0;
}

/* ---- Who waits for something ---------------------------------------------------------------- */

static void on_watch(void *ctx);

static int watch_at(struct simulation *s, apc_ns t)
{
    return apc_virtual_at(s->executive, s->zero + t, RANK_OPERATOR, on_watch, s);
}

static void on_watch(void *ctx)
{
    struct simulation *s = ctx;
    const apc_ns t = apc_clock_mono(s->clock) - s->zero;
    s->watch(s->watch_ctx, t);
    if (watch_at(s, t + s->e->plant.rhythm.period) < 0)
        simulation_stop(s, APC_ENOMEM, "out of memory");
}

int simulation_watch(struct simulation *s, void (*watch)(void *ctx, apc_ns t), void *ctx)
{
    s->watch = watch;
    s->watch_ctx = ctx;
    return watch_at(s, s->e->plant.rhythm.phase) < 0 ? APC_ENOMEM : 0;
}

/* ---- Ramps ---------------------------------------------------------------------------------- */

static void say_of_simulated_ramp(void *ctx, enum apc_event_severity severity, const char *text)
{
    const struct simulated *c = ctx;
    char source[APC_TAG_LEN];
    controllers_program(c->s->e, c->of, source);
    simulation_tell(c->s, source, severity, "ramp", "%s", text);
}

static void on_ramp_moved(void *ctx, const struct apc_sample *row)
{
    const struct simulated *c = ctx;
    struct trajectory *of = &c->s->trajectory;
    if (row->table == APC_SETPOINT)
        trajectory_change(of, &of->setpoint[row->id - 1], simulation_time(c->s), row->value);
}

static int open_simulated_ramps(struct simulated *c)
{
    struct simulation *s = c->s;
    s->view = (struct plant_view){.tag = s->tags, .n = s->n_tags, .loops = &s->loops};
    return c->ramps.at ? 0 : ramps_init(&c->ramps, &s->view, loops_controller(&s->loops, c->of->name));
}

/* A controller that was killed moves none. */
static int step_ramps(struct simulated *c)
{
    const struct ramp_told told = {.ctx = c, .say = say_of_simulated_ramp, .moved = on_ramp_moved};
    const struct apc_now now = {.mono = apc_clock_mono(c->s->clock), .utc = apc_clock_utc(c->s->clock)};
    return c->core ? ramps_step(&c->ramps, c->s->store, now, &told) : 0;
}

/* As often as the plant ticks, but for slow ones: a step makes up for a second at most. */
static void on_ramps(void *ctx)
{
    struct simulation *s = ctx;
    const apc_ns period = s->e->plant.rhythm.period;
    int moving = 0;
    for (size_t i = 0; i < s->e->n_controllers; i++) {
        const int n = step_ramps(&s->controller[i]);
        simulation_stop_at_store(s, n < 0 ? n : 0);
        moving += n > 0;
    }
    s->on_ramps = moving > 0;
    const apc_ns next = apc_clock_mono(s->clock) + (period < APC_NS_PER_S ? period : APC_NS_PER_S);
    if (moving > 0 && apc_virtual_at(s->executive, next, RANK_RAMPS, on_ramps, s) < 0)
        simulation_stop(s, APC_ENOMEM, "out of memory");
}

static void look_for_ramps(struct simulation *s)
{
    int rc = 0;
    if (s->on_ramps)
        return;
    for (size_t i = 0; i < s->e->n_controllers && rc == 0; i++)
        rc = open_simulated_ramps(&s->controller[i]);
    if (rc == 0)
        rc = apc_virtual_at(s->executive, apc_clock_mono(s->clock), RANK_RAMPS, on_ramps, s);
    s->on_ramps = true;
    if (rc < 0)
        simulation_stop(s, APC_ENOMEM, "out of memory");
}

/* ---- What is repeated ----------------------------------------------------------------------- */

void simulation_see_writes(struct simulation *s)
{
    simulation_see_faults(s);
    for (size_t k = 0; k < s->e->dim.nz; k++) {
        struct apc_sample newest = {.table = APC_SETPOINT, .id = (int)k + 1};
        simulation_stop_at_store(s, apc_store_read(s->store, &newest, 1));
        if (newest.seq > 0)
            trajectory_change(&s->trajectory, &s->trajectory.setpoint[k], simulation_time(s), newest.value);
    }
    if (s->schedules)
        simulation_look(s);
    look_for_ramps(s);
}

/* A past is as it was recorded; what people wrote comes after what is there. */
static int repeat_recorded_row(struct simulation *s, const struct apc_sample *row)
{
    struct apc_sample put = *row;
    if (s->playback)
        return apc_store_append(s->store, row, 1);
    const int author = apc_store_author(s->store, "apc-simulate");
    put.seq = APC_SEQ_ANY;
    put.author = author > 0 ? (uint32_t)author : 0;
    const int rc = author < 0 ? author : samples_add(&s->written, row);
    return rc < 0 ? rc : apc_store_put(s->store, &put, 1);
}

void simulation_repeat(void *ctx)
{
    struct simulation *s = ctx;
    const struct samples *rows = s->repeats;
    const apc_ns now = apc_clock_utc(s->clock);
    const size_t before = s->repeated;
    for (; s->repeated < rows->n && rows->at[s->repeated].time <= now; s->repeated++) {
        const struct apc_sample *row = &rows->at[s->repeated];
        simulation_stop_at_store(s, repeat_recorded_row(s, row));
        if (s->playback && row->table == APC_SETPOINT)
            trajectory_change(&s->trajectory, &s->trajectory.setpoint[row->id - 1], simulation_time(s),
                              row->value);
    }
    if (!s->playback) {
        simulation_tell(s, "apc-simulate", APC_EVENT_INFO, "operator",
                        "values written again, as in the run that is repeated: %zu", s->repeated - before);
        simulation_see_writes(s);
    }
    if (s->repeated < rows->n &&
        apc_virtual_at(s->executive, s->zero + rows->at[s->repeated].time - SIMULATION_BEGIN, RANK_OPERATOR,
                       simulation_repeat, s) < 0)
        simulation_stop(s, APC_ENOMEM, "out of memory");
}

int simulation_written(const struct experiment *e, struct samples *rows, struct apc_error *why)
{
    char dir[EXPERIMENT_PATH], path[EXPERIMENT_PATH + sizeof WRITTEN_FILE];
    *rows = (struct samples){0};
    if (!experiment_run_dir(e, dir))
        return 0;
    snprintf(path, sizeof path, "%s/" WRITTEN_FILE, dir);
    if (access(path, F_OK) != 0)
        return 0;
    const int rc = samples_read(rows, dir, WRITTEN_FILE, why);
    for (size_t i = 0; i < rows->n; i++) /* the file has whole microseconds */
        rows->at[i].time = SIMULATION_BEGIN + simulation_nearest_tick(e, rows->at[i].time);
    return rc < 0 ? rc : 1;
}

int simulation_repeat_writes(struct simulation *s, const struct samples *rows)
{
    if (s->past && !s->past->over) { /* people wrote behind it */
        s->past->written = rows;
        return 0;
    }
    s->repeats = rows;
    s->repeated = 0;
    return rows->n == 0 || apc_virtual_at(s->executive, s->zero + rows->at[0].time - SIMULATION_BEGIN,
                                          RANK_OPERATOR, simulation_repeat, s) >= 0
               ? 0
               : APC_ENOMEM;
}

/* SPDX-License-Identifier: BSD-3-Clause */
/*
 * The shells of the modules in virtual time. Each does what its daemon does around the same core: what the
 * daemon reads, it reads when its tick begins; what the daemon writes or sends, it writes or sends when the
 * execution time is over.
 */
#include "base/parts.h"
#include "simulation_internal.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#define DIVERGED 1e100 /* no state of a plant is as large as that */

static struct apc_now simulated_now(const struct simulation *s)
{
    return (struct apc_now){.mono = apc_clock_mono(s->clock), .utc = apc_clock_utc(s->clock)};
}

double simulation_time(const struct simulation *s)
{
    return apc_ns_to_s(apc_clock_mono(s->clock) - s->zero);
}

/* ---- What is told ------------------------------------------------------------------------- */

void simulation_stop(struct simulation *s, int rc, const char *fmt, ...)
{
    va_list args;
    if (s->rc < 0)
        return;
    s->rc = rc;
    va_start(args, fmt);
    vsnprintf(s->why.text, sizeof s->why.text, fmt, args);
    va_end(args);
    apc_virtual_stop(s->executive);
}

static void stop_at_failure(struct simulation *s, int rc)
{
    if (rc < 0)
        simulation_stop(s, rc, "at t = %g s: %s", simulation_time(s), apc_err_text(rc));
}

void simulation_stop_at_store(struct simulation *s, int rc)
{
    if (rc < 0)
        simulation_stop(s, rc, "at t = %g s: %s", simulation_time(s),
                        rc == APC_ENOMEM ? apc_err_text(rc) : apc_store_error(s->store));
}

static void record_simulated_event(struct simulation *s, const char *source, struct apc_event *event)
{
    event->time += apc_clock_utc(s->clock);
    snprintf(event->source, sizeof event->source, "%s", source);
    simulation_stop_at_store(s, apc_store_append_events(s->store, event, 1));
}

void simulation_tell(struct simulation *s, const char *source, enum apc_event_severity severity,
                     const char *kind, const char *fmt, ...)
{
    struct apc_event event = {.severity = severity};
    va_list args;
    va_start(args, fmt);
    vsnprintf(event.text, sizeof event.text, fmt, args);
    va_end(args);
    snprintf(event.kind, sizeof event.kind, "%s", kind);
    record_simulated_event(s, source, &event);
}

static void tell_notice(struct simulation *s, const char *source, const struct apc_notice *notice)
{
    struct apc_event event;
    if (notice->kind == APC_NOTICE_NONE) /* as nearly always */
        return;
    event = (struct apc_event){0};
    notice_event(notice, &event);
    if (notice->kind == APC_NOTICE_TRIP) /* between two ticks */
        event.time = apc_plantserver_watchdog(s->server)->tripped - apc_clock_mono(s->clock);
    record_simulated_event(s, source, &event);
}

/* ---- Scheduler ---------------------------------------------------------------------------- */

static int scheduler_tick(void *ctx, const struct apc_tick *tick)
{
    struct simulation *s = ctx;
    s->step = tick->index;
    s->step_began = tick->scheduled;
    s->schedules = true;
    simulation_stop_at_store(s, apc_store_read_rows(s->store, apc_scheduler_in(s->scheduler)));
    return 0;
}

/* What is due of what was read. Returns false where somebody was faster. */
static bool schedule(struct simulation *s)
{
    struct apc_rows *out = apc_scheduler_out(s->scheduler);
    struct apc_notice notice;
    const struct apc_now now = simulated_now(s);
    int rc = apc_scheduler_compute(s->scheduler, now, s->step, now.mono - s->step_began, &notice);
    tell_notice(s, "apc-scheduler", &notice);
    if (rc > 0)
        simulation_stop_at_store(s, rc = apc_store_append_rows(s->store, out));
    for (size_t i = 0; i < out->n_samples && rc >= 0; i++)
        if (out->sample[i].seq > 0)
            trajectory_change(&s->trajectory, &s->trajectory.setpoint[out->sample[i].id - 1],
                              simulation_time(s), out->sample[i].value);
    return apc_scheduler_update(s->scheduler, rc >= 0) || s->rc < 0;
}

void simulation_look(struct simulation *s)
{
    do
        simulation_stop_at_store(s, apc_store_read_rows(s->store, apc_scheduler_in(s->scheduler)));
    while (s->rc == 0 && !schedule(s));
}

static void scheduler_finish(void *ctx)
{
    const struct simulation *s = ctx;
    if (!s->playback && !schedule(ctx))
        simulation_look(ctx);
}

/* ---- Plant -------------------------------------------------------------------------------- */

static void describe_state(const struct simulation *s, char *text, size_t size)
{
    const struct apc_model *model = s->e->plant.model;
    const double *x = apc_plant_state(s->plant);
    size_t used = 0;
    for (size_t i = 0; i < model->nx && used < size; i++) {
        const char *name = model->state ? model->state[i].name : NULL;
        used +=
            (size_t)(name ? snprintf(text + used, size - used, "%s%s = %g", i ? ", " : "", name, x[i])
                          : snprintf(text + used, size - used, "%sx%zu = %g", i ? ", " : "", i + 1, x[i]));
    }
}

static bool diverged(const struct simulation *s)
{
    const double *x = apc_plant_state(s->plant);
    for (size_t i = 0; i < s->e->plant.model->nx; i++)
        if (!(fabs(x[i]) < DIVERGED))
            return true;
    return false;
}

void simulation_interrupt(struct simulation *s)
{
    s->interrupt = 1;
}

static int tick_plant(void *ctx, const struct apc_tick *tick)
{
    struct simulation *s = ctx;
    if (s->interrupt) {
        s->interrupted = true;
        apc_virtual_stop(s->executive);
    }
    s->plant_now = (struct apc_now){.mono = tick->scheduled, .utc = tick->utc};
    return 0;
}

static bool any_holds(const struct simulation *s)
{
    for (size_t i = 0; i < s->e->n_controllers; i++)
        if (s->controller[i].holds)
            return true;
    return false;
}

static void record_plant(struct simulation *s)
{
    struct trajectory *c = &s->trajectory;
    const double t = apc_ns_to_s(s->plant_now.mono - s->zero);
    double *input = s->now;
    const double *output = apc_plantserver_output(s->server);
    bool safe = apc_plantserver_input(s->server, input);
    for (size_t i = 0; i < c->dim.ny; i++)
        trajectory_add(c, &c->output[i], t, output[i]);
    for (size_t i = 0; i < c->dim.nu; i++)
        trajectory_change(c, &c->input[i], t, input[i]);
    trajectory_change(c, &c->without, t, safe || any_holds(s));
    if (c->failed)
        simulation_stop(s, APC_ENOMEM, "at t = %g s: out of memory", t);
}

static void plant_finish(void *ctx)
{
    struct simulation *s = ctx;
    struct apc_notice notice;
    char state[300];
    int rc = apc_plantserver_tick(s->server, s->plant_now, &notice);

    s->answered = s->plant_now.utc < s->answered ? s->plant_now.utc : s->answered;
    tell_notice(s, "apc-plant", &notice);
    s->trajectory.diverged = rc < 0 || diverged(s);
    if (rc < 0) {
        simulation_stop(s, APC_ESOLVER, "the plant cannot be solved at t = %g s: %s", simulation_time(s),
                        apc_plant_error(s->plant));
    } else if (s->trajectory.diverged) {
        describe_state(s, state, sizeof state);
        simulation_stop(s, APC_ESOLVER, "the plant diverged at t = %g s, %s: beyond %g", simulation_time(s),
                        state, DIVERGED);
    } else {
        record_plant(s);
        simulation_break_plant(s);
    }
}

static int serve_simulated_plant(void *ctx, uint64_t connection, const char *request, size_t length,
                                 char *reply, size_t size)
{
    struct simulation *s = ctx;
    struct apc_notice notice;
    if (s->link_lost)
        return APC_ECONN;
    int rc = apc_plantserver_request(s->server, simulated_now(s), connection, request, length, reply, size,
                                     &notice);
    tell_notice(s, "apc-plant", &notice);
    return rc;
}

/* ---- Client ------------------------------------------------------------------------------- */

static int client_tick(void *ctx, const struct apc_tick *tick)
{
    struct simulation *s = ctx;
    const struct apc_now now = {.mono = tick->started, .utc = tick->utc};
    simulation_stop_at_store(s, apc_store_read(s->store, s->u, s->e->dim.nu));
    apc_client_command(s->client, now, s->u, s->command);
    return 0;
}

static void report_link(struct simulation *s, bool down, const char *why)
{
    if (s->link_down != down)
        simulation_tell(s, "apc-client", down ? APC_EVENT_WARNING : APC_EVENT_INFO, "link", "plant %s%s",
                        down ? "lost, trying again: " : "connected", why);
    s->link_down = down;
}

static void report_simulated_range(struct simulation *s, const struct apc_sample *y)
{
    bool *said = &s->outside[y->id - 1];
    struct apc_event event = {0};
    if (*said == apc_client_outside(s->client, (size_t)y->id - 1))
        return;
    *said = !*said;
    notice_range(&s->e->y[y->id - 1].tag, *said, y->value, &event);
    record_simulated_event(s, "apc-client", &event);
}

static void on_exchanged(void *ctx)
{
    struct simulation *s = ctx;
    int rc = apc_exchange_finish(s->exchange, s->answer);

    report_link(s, rc < 0, apc_exchange_error(s->exchange));
    s->in_vain += rc < 0;
    if (rc < 0)
        return;
    apc_histogram_record(s->round_trip, apc_clock_mono(s->clock) - s->sent_at);
    size_t n = apc_client_measurements(s->client, s->answer, s->y);
    if (s->measured)
        s->measured(s->measured_ctx, s->y, n);
    for (size_t i = 0; i < n; i++)
        report_simulated_range(s, &s->y[i]);
    simulation_stop_at_store(s, apc_store_append(s->store, s->y, n));
}

static void client_finish(void *ctx)
{
    struct simulation *s = ctx;
    apc_ns now = apc_clock_mono(s->clock);
    int rc = apc_exchange_begin(s->exchange, s->command, now + module_patience(s->e));
    if (rc == 0) {
        s->sent_at = now;
        s->answered = apc_plantserver_oldest(s->server);
    }
    s->in_vain += rc == APC_EBUSY;
    if (rc == APC_EBUSY) /* its execution time has eaten the patience of the one before */
        report_link(s, true, apc_exchange_error(s->exchange));
    else
        stop_at_failure(s, rc);
}

/* ---- Controllers -------------------------------------------------------------------------- */

static void tell_of(const struct simulated *c, const struct apc_notice *notice)
{
    char source[APC_TAG_LEN];
    if (notice->kind == APC_NOTICE_NONE)
        return;
    controllers_program(c->s->e, c->of, source);
    tell_notice(c->s, source, notice);
}

static int controller_tick(void *ctx, const struct apc_tick *tick)
{
    struct simulated *c = ctx;
    struct apc_notice notice;
    if (!c->core || c->hangs)
        return 0;
    simulation_stop_at_store(c->s, apc_store_read_rows(c->s->store, apc_controller_in(c->core)));
    const uint64_t before = c->s->before > 0 ? (uint64_t)(c->s->before / c->of->rhythm.period) : 0;
    apc_controller_compute(c->core, simulated_now(c->s), before + tick->index, true, &notice);
    do
        tell_of(c, &notice);
    while (apc_controller_noticed(c->core, &notice));
    c->ticks = true;
    return 0;
}

/* Is some output for the plant not the law's? */
static bool is_held(const struct apc_rows *out)
{
    for (size_t i = 0; i < out->n_samples; i++)
        if (out->sample[i].table == APC_ACTUATOR &&
            apc_status_severity(out->sample[i].status) != APC_SEVERITY_GOOD)
            return true;
    return false;
}

/* The other one may still have the outputs. */
static void take_simulated_turns(struct simulated *c)
{
    const int rc = module_take_turns(c->of, c->core, c->store, &c->claimed);
    if (rc < 0 && rc != APC_EBUSY)
        simulation_stop(c->s, rc, "at t = %g s: %s", simulation_time(c->s), apc_store_error(c->store));
}

static void controller_finish(void *ctx)
{
    struct simulated *c = ctx;
    struct simulation *s = c->s;
    if (!c->ticks)
        return;
    c->ticks = false;
    struct apc_rows *out = apc_controller_out(c->core);
    int rc = apc_store_append_rows(c->store ? c->store : s->store, out);
    simulation_stop_at_store(s, rc);
    c->holds = is_held(out);
    c->held += c->holds;
    for (size_t i = 0; i < out->n_samples && rc >= 0; i++) {
        const struct apc_sample *row = &out->sample[i];
        if (row->table == APC_SETPOINT && row->seq > 0) /* else somebody was faster */
            trajectory_change(&s->trajectory, &s->trajectory.setpoint[row->id - 1], simulation_time(s),
                              row->value);
    }
    apc_controller_update(c->core, rc >= 0);
    take_simulated_turns(c);
}

uint64_t simulated_failures(const struct simulated *c)
{
    return c->failures + (c->core ? apc_controller_failures(c->core) : 0);
}

/* As a daemon that is killed, whatever it is doing. */
void simulation_kill(struct simulated *c)
{
    c->failures = simulated_failures(c);
    apc_controller_destroy(c->core);
    apc_store_close(c->store);
    c->core = NULL;
    c->store = NULL;
    c->ticks = c->holds = c->claimed = false;
}

/* And one that is started: it goes on from its newest tick row, if there is one. */
int simulation_start(struct simulated *c, struct apc_error *why)
{
    if (c->core)
        return 0;
    int rc = module_controller(c->s->e, c->of, false, &c->core, why);
    if (rc == 0 && (rc = apc_store_read_rows(c->s->store, apc_controller_former(c->core))) < 0)
        apc_fail(why, rc, "%s", apc_store_error(c->s->store));
    if (rc == 0)
        apc_controller_resume(c->core, SIMULATION_BEGIN - 1);
    if (rc == 0 && c->of->acting)
        rc = apc_store_open(&c->store, c->s->uri, NULL, why);
    if (rc == 0 && c->of->acting) {
        simulation_stop_at_store(c->s, apc_store_read_rows(c->s->store, apc_controller_in(c->core)));
        take_simulated_turns(c);
    }
    return rc;
}

uint64_t simulation_held(const struct simulation *s)
{
    uint64_t n = 0;
    for (size_t i = 0; i < s->e->n_controllers; i++)
        n += s->controller[i].held;
    return n;
}

uint64_t simulation_failures(const struct simulation *s)
{
    uint64_t n = 0;
    for (size_t i = 0; i < s->e->n_controllers; i++)
        n += simulated_failures(&s->controller[i]);
    return n;
}

/* ---- Alarms ------------------------------------------------------------------------------- */

static int alarms_tick(void *ctx, const struct apc_tick *tick)
{
    struct simulation *s = ctx;
    struct apc_notice notice;
    (void)tick;
    if (s->playback)
        return 0;
    simulation_stop_at_store(s, apc_store_read_rows(s->store, apc_alarms_in(s->alarms)));
    apc_alarms_compute(s->alarms, simulated_now(s), &notice);
    tell_notice(s, "apc-alarms", &notice);
    return 0;
}

static void alarms_finish(void *ctx)
{
    struct simulation *s = ctx;
    const struct apc_rows *out = apc_alarms_out(s->alarms);
    struct apc_event event;
    if (s->playback)
        return;
    simulation_stop_at_store(s, apc_store_append_rows(s->store, out));
    for (size_t i = 0; i < out->n_samples; i++)
        if (alarm_event(s->e, &out->sample[i], &event))
            record_simulated_event(s, "apc-alarms", &event);
    apc_alarms_stored(s->alarms);
}

static int make_simulated_alarms(struct simulation *s, struct apc_error *why)
{
    const int rc = s->e->n_alarms > 0 ? module_alarms(s->e, &s->alarms, why) : 0;
    if (s->alarms)
        apc_alarms_resume(s->alarms);
    return rc;
}

/* ---- Making one --------------------------------------------------------------------------- */

struct task_plan {
    const char *name;
    const struct rhythm *rhythm;
    int rank;
    apc_task_fn tick;
    apc_virtual_fn finish;
    void *ctx;
};

static int make_task(struct simulation *s, const struct task_plan *plan, uint64_t seed, struct apc_error *why)
{
    struct simulation_task *t = &s->task[s->n_tasks++];
    const struct apc_task_options options = {.size = sizeof options,
                                             .name = plan->name,
                                             .period = plan->rhythm->period,
                                             .start = SIMULATION_BEGIN + plan->rhythm->phase,
                                             .aligned = true,
                                             .overrun = plan->rhythm->overrun};
    const struct apc_virtual_model model = {.size = sizeof model,
                                            .rank = plan->rank,
                                            .jitter = plan->rhythm->model.jitter,
                                            .execution = plan->rhythm->model.execution,
                                            .seed = seed,
                                            .finish = plan->finish};
    *t = (struct simulation_task){.name = plan->name, .period = plan->rhythm->period};
    int rc = apc_task_create(s->executive, &options, plan->tick, plan->ctx, &t->task, why);
    if (rc == 0)
        rc = apc_virtual_set_model(t->task, &model, why);
    return rc < 0 ? rc : apc_task_start(t->task, why);
}

static int make_tasks(struct simulation *s, uint64_t seed, struct apc_error *why)
{
    const struct experiment *e = s->e;
    const struct task_plan plan[] = {
        {"scheduler", &e->scheduler.rhythm, RANK_SCHEDULER, scheduler_tick, scheduler_finish, s},
        {"plant", &e->plant.rhythm, RANK_PLANT, tick_plant, plant_finish, s},
        {"client", &e->client.rhythm, RANK_CLIENT, client_tick, client_finish, s}};
    const size_t first = e->scheduler.steps > 0 ? 0 : 1, n = sizeof plan / sizeof *plan;
    int rc = 0;
    s->task = calloc(n + e->n_controllers + 1, sizeof *s->task);
    if (!s->task)
        return apc_fail(why, APC_ENOMEM, "out of memory");
    for (size_t i = first; i < n && rc == 0; i++)
        rc = make_task(s, &plan[i], seed, why);
    for (size_t i = 0; i < e->n_controllers && rc == 0; i++) {
        const struct controller *c = &e->controllers[i];
        rc = make_task(s,
                       &(struct task_plan){c->name, &c->rhythm, RANK_CONTROLLERS + (int)c->depth,
                                           controller_tick, controller_finish, &s->controller[i]},
                       seed, why);
    }
    if (rc == 0 && s->alarms)
        rc = make_task(
            s, &(struct task_plan){"alarms", &e->alarms.rhythm, RANK_ALARMS, alarms_tick, alarms_finish, s},
            seed, why);
    return rc;
}

static int make_controllers(struct simulation *s, struct apc_error *why)
{
    int rc = 0;
    s->controller = calloc(s->e->n_controllers, sizeof *s->controller);
    if (!s->controller)
        return apc_fail(why, APC_ENOMEM, "out of memory");
    for (size_t i = 0; i < s->e->n_controllers && rc == 0; i++) {
        s->controller[i] = (struct simulated){.s = s, .of = &s->e->controllers[i]};
        rc = s->playback ? 0 : simulation_start(&s->controller[i], why);
    }
    return rc;
}

static int make_exchange(struct simulation *s, uint64_t seed, struct apc_error *why)
{
    const struct network_model *network = &s->e->models.network;
    struct apc_inproc_options inproc = {.size = sizeof inproc,
                                        .executive = s->executive,
                                        .request_rank = RANK_LINK,
                                        .reply_rank = RANK_LINK,
                                        .network = network->options,
                                        .serve = serve_simulated_plant,
                                        .serve_ctx = s,
                                        .done = on_exchanged,
                                        .done_ctx = s};
    const struct apc_exchange_options options = {
        .size = sizeof options, .nu = s->e->dim.nu, .ny = s->e->dim.ny, .inproc = &inproc};
    size_t n = network->options.n_outages;
    struct apc_outage *outages = calloc(n + 1, sizeof *outages);
    if (!outages)
        return apc_fail(why, APC_ENOMEM, "out of memory");
    for (size_t i = 0; i < n; i++)
        outages[i] =
            (struct apc_outage){s->zero + network->outages[i].from, s->zero + network->outages[i].until};
    inproc.network.outages = outages;
    inproc.network.seed = seed;
    int rc = apc_exchange_open(&s->exchange, "inproc:", &options, why);
    free(outages);
    return rc;
}

static int make_simulated_room(struct simulation *s)
{
    const struct apc_dim *dim = &s->e->dim;
    const struct apc_part parts[] = {APC_PART(s->u, dim->nu),
                                     APC_PART(s->y, dim->ny),
                                     APC_PART(s->command, dim->nu),
                                     APC_PART(s->answer, dim->ny),
                                     APC_PART(s->outside, dim->ny),
                                     APC_PART(s->now, dim->nu),
                                     APC_PART(s->plant_fault, s->e->plant.n_faults)};
    s->memory = apc_parts_allocate(parts, sizeof parts / sizeof *parts);
    if (!s->memory || trajectory_create(&s->trajectory, dim) < 0 || apc_histogram_create(&s->round_trip) < 0)
        return APC_ENOMEM;
    for (size_t i = 0; i < dim->nu; i++)
        s->u[i] = (struct apc_sample){.table = APC_ACTUATOR, .id = (int)i + 1};
    return simulation_take_faults(s, s->e);
}

/* As `apc run` does before it starts the daemons. */
static int make_store(struct simulation *s, struct apc_error *why)
{
    size_t n;
    struct apc_sample *first = module_first(s->e, SIMULATION_BEGIN, &n);
    int rc =
        first ? apc_store_open(&s->store, s->uri, NULL, why) : apc_fail(why, APC_ENOMEM, "out of memory");

    if (rc == 0 && ((rc = apc_store_init(s->store)) < 0 ||
                    (!s->playback && !s->shared && (rc = apc_store_put(s->store, first, n)) < 0)))
        apc_fail(why, rc, "%s", apc_store_error(s->store));
    for (size_t i = 0; i < n && rc >= 0 && !s->playback; i++)
        if (first[i].table == APC_SETPOINT)
            trajectory_change(&s->trajectory, &s->trajectory.setpoint[first[i].id - 1], 0, first[i].value);
    free(first);
    return rc < 0 ? rc : 0;
}

/* What it is apart from its store and its past is in @p s. */
static int make_simulation(struct simulation *s, struct apc_error *why)
{
    const struct apc_executive_options options = {.size = sizeof options, .begin = SIMULATION_BEGIN};
    const struct experiment *e = s->e;
    const uint64_t seed = s->seed;
    int rc;

    if ((rc = apc_executive_create(&s->executive, "virtual", &options, why)) < 0)
        return rc;
    s->clock = apc_executive_clock(s->executive);
    s->zero = apc_clock_mono(s->clock);
    struct experiment seeded = *e;
    seeded.seed = seed;
    if ((rc = module_plant(&seeded, &s->plant, &s->server, why)) < 0 ||
        (rc = module_client(e, NULL, SIMULATION_BEGIN, &s->client, why)) < 0 ||
        (e->scheduler.steps > 0 && (rc = module_scheduler(e, &s->scheduler, why)) < 0) ||
        (rc = make_exchange(s, seed, why)) < 0)
        return rc;
    if (make_simulated_room(s) < 0 || simulation_schedule_clock(s) < 0 ||
        simulation_schedule_actions(s, 0) < 0)
        return apc_fail(why, APC_ENOMEM, "out of memory");
    if ((rc = make_store(s, why)) < 0 || (rc = make_controllers(s, why)) < 0 ||
        (rc = make_simulated_alarms(s, why)) < 0)
        return rc;
    if (s->playback) {
        s->repeats = &s->playback->rows;
        simulation_repeat(s);
    }
    return make_tasks(s, seed, why);
}

/* Until its past has ended it is what was. */
static int make_simulation_of(struct simulation *s, const struct experiment *e, uint64_t seed,
                              struct apc_error *why)
{
    s->e = e;
    s->seed = seed;
    const int rc = e->past > 0 ? simulation_take_past(s, why) : 0;
    return rc < 0 ? rc : make_simulation(s, why);
}

int simulation_create(struct simulation *s, const struct experiment *e, uint64_t seed, struct apc_error *why)
{
    *s = (struct simulation){.shared = false};
    snprintf(s->uri, sizeof s->uri, "mem:apc-simulate-%p", (void *)s);
    return make_simulation_of(s, e, seed, why);
}

int simulation_create_after(struct simulation *s, const struct experiment *e, uint64_t seed,
                            const struct playback *playback, struct apc_error *why)
{
    *s = (struct simulation){
        .e = e, .seed = seed, .playback = playback, .before = playback ? playback->before : 0};
    snprintf(s->uri, sizeof s->uri, "mem:apc-simulate-%p", (void *)s);
    return make_simulation(s, why);
}

int simulation_create_shared(struct simulation *s, const struct experiment *e, uint64_t seed, const char *uri,
                             struct apc_error *why)
{
    *s = (struct simulation){.shared = true};
    snprintf(s->uri, sizeof s->uri, "%s", uri);
    return make_simulation_of(s, e, seed, why);
}

static int run_simulation_until(struct simulation *s, double until)
{
    apc_ns length;
    if (s->rc < 0 || s->interrupted)
        return s->rc;
    if (apc_ns_from_s(until, &length) < 0 || length <= 0)
        return s->rc = apc_fail(&s->why, APC_EINVAL, "a duration of %g s: must be above 0", until);
    if (until <= s->ended)
        return 0;
    s->handled += apc_virtual_run(s->executive, s->zero + length - 1);
    s->ended = s->trajectory.end = s->rc < 0 || s->interrupted ? simulation_time(s) : until;
    return s->rc;
}

int simulation_run(struct simulation *s, double until)
{
    if (s->past && !s->past->over && until >= s->past->at && run_simulation_until(s, s->past->at) == 0 &&
        !s->interrupted)
        simulation_end_past(s);
    return run_simulation_until(s, until);
}

void simulation_destroy(struct simulation *s)
{
    for (size_t i = 0; i < s->n_tasks; i++)
        apc_task_destroy(s->task[i].task);
    apc_exchange_close(s->exchange);
    apc_executive_destroy(s->executive);
    apc_client_destroy(s->client);
    apc_scheduler_destroy(s->scheduler);
    apc_alarms_destroy(s->alarms);
    for (size_t i = 0; s->controller && i < s->e->n_controllers; i++) {
        apc_controller_destroy(s->controller[i].core);
        apc_store_close(s->controller[i].store);
        ramps_free(&s->controller[i].ramps);
    }
    apc_plantserver_destroy(s->server);
    apc_plant_destroy(s->plant);
    apc_store_close(s->store);
    trajectory_free(&s->trajectory);
    apc_histogram_destroy(s->round_trip);
    free(s->task);
    free(s->controller);
    simulation_drop_faults(s, s->e);
    free(s->memory);
    free(s->clock_steps);
    free(s->action_steps);
    free(s->tags);
    loops_free(&s->loops);
    samples_free(&s->written);
    simulation_free_past(s->past);
}

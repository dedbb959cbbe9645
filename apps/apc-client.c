/* SPDX-License-Identifier: BSD-3-Clause */
/*
 * apc-client: moves the newest actuator samples to the plant and the plant's measurements into the
 * shared data, once a period.
 *
 * The task talks to the plant and never to the store: that is a thread of its own, which the task asks for
 * the newest u and waits for no longer than a part of the period. So a store that stalls, however long, does
 * not keep a frame from the plant: meanwhile the last known u goes on being sent, and the core stops it when
 * it is too old. What the plant answers is queued for that thread. Between the two there is one mutex, of
 * which nobody does anything that could wait.
 */
#include <pthread.h>
#include <semaphore.h>
#include <stdatomic.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include <apcexchange.h>

#include "base/parts.h"
#include "daemon/credentials.h"
#include "daemon/daemon.h"
#include "daemon/recorder.h"
#include "daemon/self_monitor.h"
#include "experiment/experiment.h"

#define QUEUED         (10 * APC_NS_PER_S) /* of measurements, for a store that takes its time */
#define STORE_PRIORITY 79                  /* the task's is 80 */
#define REASONS        3                   /* that are said of one loss */

/* Of the plant, or of a part of it. */
struct loss {
    struct state_watch state;                         /* up: it is connected */
    char reason[sizeof((struct apc_event *)0)->text]; /* for which it is lost, as it was said last */
    unsigned reasons;                                 /* said so far; 0: it is connected */
};

struct own_options {
    const char *link, *identity;
};

static const struct option_spec own_options[] = {
    {"link", 'l', "URI",
     "Address of the plant, instead of the file's, e.g. tcp:127.0.0.1:43051, or tls:plant:43051", OPTION_TEXT,
     .to = offsetof(struct own_options, link)},
    {"identity", 0, "FILE", "Identity of this client on tls:, made by `apc cert client` [APC_IDENTITY]",
     OPTION_TEXT, .to = offsetof(struct own_options, identity)},
    {0},
};

static const struct program program = {
    .name = "apc-client",
    .doc = "Move data between the plant and the shared data.",
    .task = "client",
    .spools = "measurements",
    .extra = own_options,
};

#define LEAVE_TIME APC_NS_PER_S /* for the plant's safe values: no tick waits for them */

struct shell {
    struct daemon *d;
    struct credentials credentials;
    struct apc_exchange *plant;
    struct apc_client *core;
    apc_ns patience;      /* for one exchange */
    apc_ns budget;        /* for the store's answer */
    void *memory;         /* of the arrays */
    struct apc_sample *u; /* newest known, the task's */
    bool know_u;
    struct apc_value *command, *measured; /* [nu], [ny] of this tick */
    struct apc_sample *y;                 /* [ny] */
    struct loss plant_loss, part_loss;
    struct state_watch output_state;
    struct state_watch *range_state; /* [ny] up: within */
    struct apc_dating *dating;       /* [ny] */
    struct state_watch clock_state;  /* up: the plant's clock is right */
    struct apc_watchdog watchdog;    /* of the plant, as far as it can be seen from here */
    struct apc_histogram *round_trip;
    _Atomic uint64_t failed; /* exchanges */

    pthread_mutex_t mutex; /* of all up to the next gap */
    pthread_cond_t answer;
    uint64_t asked, answered;  /* for u */
    struct apc_sample *newest; /* u */
    bool have_u;
    uint64_t claim;           /* by which the store gave it */
    struct apc_sample *queue; /* ring: y that the store has not been given yet */
    size_t room, first, count;
    uint64_t dropped; /* y for which there was no room */
    int result;       /* of the store, that ends the daemon; or 0 */
    bool closing;
    bool leaving, looked; /* spared is wanted; is known */
    bool *spared;         /* [nu] outputs that are not for this client to make safe */

    sem_t work;
    pthread_t thread; /* the store's; it alone has what follows */
    bool running;
    struct apc_store *store;
    struct apc_sample *read, *batch;
    uint64_t lost;
    struct state_watch store_state;
};

static void report_client_state(struct shell *s, struct state_watch *state, bool up, const char *kind,
                                const char *what, const char *why)
{
    enum state_change change = state_watch_look(state, up, apc_clock_mono(NULL));
    if (change == CHANGE_ONE)
        daemon_event(s->d, up ? APC_EVENT_INFO : APC_EVENT_WARNING, kind, "%s %s%s%s", what,
                     up ? "connected" : "lost, trying again", *why ? ": " : "", why);
    else if (change == CHANGE_MANY)
        daemon_event(s->d, up ? APC_EVENT_INFO : APC_EVENT_WARNING, kind,
                     "%s came and went, %u changes meanwhile; now %s%s%s", what, state->count,
                     up ? "connected" : "lost", *why ? ": " : "", why);
}

/* Whether an external plant is commanded nobody else can say; one of ours says it itself, by the same
 * watchdog. Each change is told: apc run judges by them. */
static void report_command(struct shell *s, bool given)
{
    const apc_ns now = apc_clock_mono(NULL);
    struct apc_watchdog *w = &s->watchdog;
    apc_ns stamp = s->command[0].time;
    for (size_t i = 1; i < s->d->experiment.dim.nu; i++)
        stamp = s->command[i].time > stamp ? s->command[i].time : stamp;
    if (apc_watchdog_trips(w, now) && s->d->experiment.plant.external)
        daemon_event_at(s->d, w->tripped, APC_EVENT_WARNING, "command",
                        "the plant is given no command: not every output is fresh and good, or it is not "
                        "reached, does not take them, or has others");
    const bool before = w->commanded;
    if (given)
        apc_watchdog_take(w, now, stamp);
    if (w->commanded && !before && s->d->experiment.plant.external)
        daemon_event(s->d, APC_EVENT_INFO, "command", "the plant is given its commands");
}

/* @why it is lost; "": it is not. That may come out later than that it is: a handshake outlasts a tick. */
static void report_loss(struct shell *s, struct loss *l, const char *what, const char *why)
{
    report_client_state(s, &l->state, !*why, "link", what, why);
    if (!*why) {
        l->reasons = 0;
        l->reason[0] = '\0';
    } else if (l->reasons < REASONS && strncmp(why, l->reason, sizeof l->reason - 1) != 0) {
        if (l->reasons++ > 0)
            daemon_event(s->d, APC_EVENT_WARNING, "link", "%s still lost: %s", what, why);
        snprintf(l->reason, sizeof l->reason, "%s", why);
    }
}

/* Has the plant other outputs than it was given? */
static bool outputs_stand(struct shell *s)
{
    const struct experiment *e = &s->d->experiment;
    char why[200] = "", name[APC_STATUS_NAME_LEN];
    for (size_t i = 0; i < e->dim.nu && !why[0]; i++) {
        double value = 0.0;
        const apc_status status = apc_exchange_read_back(s->plant, i, &value);
        if (apc_status_severity(status) == APC_SEVERITY_BAD)
            snprintf(why, sizeof why, "%.100s could not be read back: %s", e->u[i].tag.name,
                     apc_status_format(status, name));
        else if (status != APC_GOOD)
            snprintf(why, sizeof why, "%.100s stood at %.6g, which is not what it was given",
                     e->u[i].tag.name, value);
    }
    enum state_change change = state_watch_look(&s->output_state, !why[0], apc_clock_mono(NULL));
    if (change == CHANGE_ONE)
        daemon_event(s->d, why[0] ? APC_EVENT_WARNING : APC_EVENT_INFO, "readback", "%s",
                     why[0] ? why : "the plant has the outputs that it was given again");
    else if (change == CHANGE_MANY)
        daemon_event(s->d, why[0] ? APC_EVENT_WARNING : APC_EVENT_INFO, "readback",
                     "what stands in the plant changed %u times meanwhile; now %s", s->output_state.count,
                     why[0] ? why : "it has the outputs that it was given");
    return !why[0];
}

/* A sensor that shows more than it can. */
static void report_sensor_range(struct shell *s, const struct apc_sample *y)
{
    const size_t i = (size_t)y->id - 1;
    struct state_watch *state = &s->range_state[i];
    const bool within = !apc_client_outside(s->core, i);
    const enum state_change change = state_watch_look(state, within, apc_clock_mono(NULL));
    struct apc_event event = {0};
    if (change == CHANGE_NONE)
        return;
    notice_range(&s->d->experiment.y[i].tag, !within, y->value, &event);
    if (change == CHANGE_ONE)
        daemon_event(s->d, event.severity, event.kind, "%s", event.text);
    else
        daemon_event(s->d, event.severity, event.kind,
                     "%.60s left its range and came back, %u changes meanwhile; now %.100s",
                     s->d->experiment.y[i].tag.name, state->count, event.text);
}

/* What has a time that cannot be is recorded by when it came. */
static void date(struct shell *s, size_t n)
{
    const apc_ns now = apc_clock_utc(NULL);
    const size_t ny = s->d->experiment.dim.ny;
    size_t i = 0;
    for (size_t k = 0; k < n; k++)
        s->y[k].time = apc_dating_look(&s->dating[s->y[k].id - 1], s->y[k].time, now, s->d->start);
    while (i < ny && s->dating[i].looks < APC_DATING_SURE)
        i++;
    const enum state_change change = state_watch_look(&s->clock_state, i == ny, apc_clock_mono(NULL));
    if (change != CHANGE_NONE && i < ny)
        daemon_event(s->d, APC_EVENT_WARNING, "clock",
                     "the plant's clock is wrong: of %.60s the source time is %+.0f s off; measurements are "
                     "recorded by when they came",
                     s->d->experiment.y[i].tag.name, apc_ns_to_s(s->dating[i].off));
    else if (change != CHANGE_NONE)
        daemon_event(s->d, APC_EVENT_INFO, "clock", "the plant's clock is right");
}

/* A command that has not gone out with the tick it belongs to never does: who slept in between moves nothing. */
static apc_ns exchange_until(const struct shell *s, const struct apc_tick *tick, apc_ns begun)
{
    const apc_ns end = tick->started + s->d->experiment.client.rhythm.period;
    return begun + s->patience < end ? begun + s->patience : end;
}

/* Returns how many measurements came. */
static size_t exchange(struct shell *s, const struct apc_tick *tick, const struct apc_sample *u)
{
    const struct apc_now now = {.mono = tick->started, .utc = tick->utc};
    const bool all = apc_client_command(s->core, now, u, s->command) == s->d->experiment.dim.nu;
    const apc_ns begun = apc_clock_mono(NULL);
    int rc = apc_exchange_begin(s->plant, s->command, exchange_until(s, tick, begun));
    if (rc == 0)
        rc = apc_exchange_finish(s->plant, s->measured);
    const bool stand = rc < 0 || outputs_stand(s);
    report_command(s, all && rc == 0 && stand && apc_exchange_taken(s->plant));
    if (rc < 0) {
        atomic_fetch_add(&s->failed, 1);
        report_loss(s, &s->plant_loss, "plant", apc_exchange_error(s->plant));
        s->part_loss.state.up = true; /* if it is still lost when the plant is back, that is said then */
        s->part_loss.reasons = 0;
        return 0;
    }
    apc_histogram_record(s->round_trip, apc_clock_mono(NULL) - begun);
    report_loss(s, &s->plant_loss, "plant", "");
    report_loss(s, &s->part_loss, "part of the plant", apc_exchange_error(s->plant));
    const size_t n = apc_client_measurements(s->core, s->measured, s->y);
    date(s, n);
    for (size_t i = 0; i < n; i++)
        report_sensor_range(s, &s->y[i]);
    return n;
}

/* ---- The store's thread -------------------------------------------------------------------- */

/* The store, or else the spool, takes them, or they are lost: a measurement belongs to its instant. */
static int append_measurements(struct shell *s, size_t n)
{
    int rc = apc_store_append(s->store, s->batch, n);
    if (rc == APC_EBUSY || rc == APC_ECONFLICT || rc == APC_ESCHEMA) /* the end, which says why */
        return rc;
    if (rc < 0) {
        if (s->lost == 0)
            daemon_event(s->d, APC_EVENT_ALARM, "store", "measurements are being lost: %.150s",
                         apc_store_error(s->store));
        s->lost += n;
        return rc;
    }
    if (s->lost > 0)
        daemon_event(s->d, APC_EVENT_ALARM, "store", "%llu measurements were lost",
                     (unsigned long long)s->lost);
    s->lost = 0;
    return (size_t)rc == n ? 0 : APC_ECONFLICT; /* none was sent before: those there are somebody else's */
}

static int read_u(struct shell *s)
{
    const size_t nu = s->d->experiment.dim.nu;
    pthread_mutex_lock(&s->mutex);
    const uint64_t asked = s->asked;
    bool ask = asked != s->answered;
    pthread_mutex_unlock(&s->mutex);
    if (!ask)
        return 0;
    bool connected = apc_store_connected(s->store);
    int rc = connected ? apc_store_read(s->store, s->read, nu) : apc_store_connect(s->store);
    pthread_mutex_lock(&s->mutex);
    if (rc >= 0 && connected) {
        memcpy(s->newest, s->read, nu * sizeof *s->newest);
        s->have_u = true;
        s->claim = apc_store_claimed(s->store);
    }
    s->answered = asked;
    pthread_cond_signal(&s->answer);
    pthread_mutex_unlock(&s->mutex);
    return rc;
}

static int write_y(struct shell *s)
{
    pthread_mutex_lock(&s->mutex);
    const size_t n = s->count;
    for (size_t i = 0; i < n; i++)
        s->batch[i] = s->queue[(s->first + i) % s->room];
    s->first = (s->first + n) % s->room;
    s->count = 0;
    s->lost += s->dropped;
    s->dropped = 0;
    pthread_mutex_unlock(&s->mutex);
    return n > 0 ? append_measurements(s, n) : 0;
}

/* What is another client's by now, and what somebody took out of service: that the plant has as they want it.
 * Who cannot be asked is not waited for: then it is what this client has commanded that it makes safe. */
static void look_for_rivals(struct shell *s)
{
    const struct experiment *e = &s->d->experiment;
    const size_t loops = controllers_loops(e);
    const struct apc_sample y = {.table = APC_SENSOR, .id = 1};
    uint64_t holder = 0;
    pthread_mutex_lock(&s->mutex);
    const bool ask = s->leaving && !s->looked;
    pthread_mutex_unlock(&s->mutex);
    struct apc_sample *mode = ask ? calloc(loops, sizeof *mode) : NULL;
    bool *serves = ask ? calloc(e->dim.nu, sizeof *serves) : NULL;
    if (mode && serves) {
        const bool theirs = apc_store_holder(s->store, &y, &holder) == 0 && holder > 0 &&
                            holder != apc_store_claimed(s->store);
        for (size_t i = 0; i < loops; i++)
            mode[i] = (struct apc_sample){.table = APC_OPMODE, .id = (int)i + 1};
        const bool known = apc_store_read(s->store, mode, loops) >= 0;
        for (size_t i = 0; i < loops; i++) {
            const struct controller_loop loop = controllers_loop(e, i);
            const struct wire *to = &loop.of->u[loop.u];
            if (to->table == APC_ACTUATOR)
                serves[to->at] |= !known || mode[i].seq == 0 || mode[i].value != (double)APC_MODE_OOS;
        }
        pthread_mutex_lock(&s->mutex);
        for (size_t i = 0; i < e->dim.nu; i++)
            s->spared[i] = theirs || !serves[i];
        s->looked = true;
        pthread_cond_signal(&s->answer);
        pthread_mutex_unlock(&s->mutex);
    }
    free(mode);
    free(serves);
}

static bool more(struct shell *s)
{
    pthread_mutex_lock(&s->mutex);
    bool is = !s->closing || s->count > 0;
    pthread_mutex_unlock(&s->mutex);
    return is;
}

static void *serve_store(void *arg)
{
    struct shell *s = arg;
    const struct sched_param param = {.sched_priority = STORE_PRIORITY};

    pthread_setname_np(pthread_self(), "store");
    pthread_setschedparam(pthread_self(), SCHED_FIFO, &param); /* where the task may, it waits for no less */
    while (more(s)) {
        while (sem_wait(&s->work) < 0)
            ;
        int rc = read_u(s), wrote = write_y(s);
        look_for_rivals(s);
        bool up = rc >= 0 && wrote >= 0 && apc_store_connected(s->store);
        report_client_state(s, &s->store_state, up, "store", "store", up ? "" : apc_store_error(s->store));
        daemon_spool(s->d, s->store);
        rc = daemon_fatal(s->d, s->store, wrote < 0 ? wrote : rc);
        pthread_mutex_lock(&s->mutex);
        s->result = rc;
        pthread_mutex_unlock(&s->mutex);
        if (rc != 0)
            break;
    }
    return NULL;
}

/* ---- The task ------------------------------------------------------------------------------ */

/* Ask for the newest u, and wait for it unless the one before is still being waited for: the store stalls
 * then. */
static int ask_u(struct shell *s)
{
    const apc_ns until = apc_clock_mono(NULL) + s->budget;
    const struct timespec t = {until / APC_NS_PER_S, until % APC_NS_PER_S};
    int late = 0;

    pthread_mutex_lock(&s->mutex);
    bool stalls = s->asked != s->answered;
    s->asked++;
    sem_post(&s->work);
    while (!stalls && s->asked != s->answered && s->result == 0 && late == 0)
        late = pthread_cond_clockwait(&s->answer, &s->mutex, CLOCK_MONOTONIC, &t);
    if (s->have_u)
        memcpy(s->u, s->newest, s->d->experiment.dim.nu * sizeof *s->u);
    s->know_u = s->have_u;
    apc_exchange_claim(s->plant, s->claim);
    int result = s->result;
    pthread_mutex_unlock(&s->mutex);
    return result;
}

static void queue_y(struct shell *s, size_t n)
{
    pthread_mutex_lock(&s->mutex);
    if (n > s->room - s->count)
        s->dropped += n;
    else
        for (size_t i = 0; i < n; i++)
            s->queue[(s->first + s->count++) % s->room] = s->y[i];
    sem_post(&s->work);
    pthread_mutex_unlock(&s->mutex);
}

static int on_client_tick(void *ctx, const struct apc_tick *tick)
{
    struct shell *s = ctx;
    int rc = ask_u(s);
    size_t n = exchange(s, tick, s->know_u ? s->u : NULL);
    if (n > 0)
        queue_y(s, n);
    return rc;
}

/* ---- Set-up -------------------------------------------------------------------------------- */

static int start_store(struct shell *s, int64_t *last)
{
    const size_t ny = s->d->experiment.dim.ny;
    for (size_t i = 0; i < ny; i++)
        s->y[i] = (struct apc_sample){.table = APC_SENSOR, .id = (int)i + 1};
    int rc = daemon_store(s->d, &s->store, s->y, ny);
    if (rc != 0)
        return rc;
    for (size_t i = 0; i < ny; i++)
        last[i] = s->y[i].seq;
    if (pthread_create(&s->thread, NULL, serve_store, s))
        return daemon_error(s->d, APC_ESYS, "the store's thread could not be started");
    s->running = true;
    return 0;
}

static void stop_store(struct shell *s)
{
    if (s->running) {
        pthread_mutex_lock(&s->mutex);
        s->closing = true;
        pthread_mutex_unlock(&s->mutex);
        sem_post(&s->work);
        pthread_join(s->thread, NULL);
    }
    apc_store_close(s->store);
}

static int allocate_client(struct shell *s)
{
    const struct experiment *e = &s->d->experiment;
    const size_t ticks = (size_t)(QUEUED / e->client.rhythm.period) + 2;

    s->room = ticks * e->dim.ny;
    const struct apc_part parts[] = {
        APC_PART(s->u, e->dim.nu),       APC_PART(s->newest, e->dim.nu),      APC_PART(s->read, e->dim.nu),
        APC_PART(s->command, e->dim.nu), APC_PART(s->measured, e->dim.ny),    APC_PART(s->y, e->dim.ny),
        APC_PART(s->spared, e->dim.nu),  APC_PART(s->range_state, e->dim.ny), APC_PART(s->dating, e->dim.ny),
        APC_PART(s->queue, s->room),     APC_PART(s->batch, s->room)};
    s->memory = apc_parts_allocate(parts, sizeof parts / sizeof *parts);
    if (!s->memory)
        return APC_ENOMEM;
    for (size_t i = 0; i < e->dim.ny; i++)
        s->range_state[i].up = true; /* as long as it is so, nothing is said */
    for (size_t i = 0; i < e->dim.nu; i++)
        s->read[i] = (struct apc_sample){.table = APC_ACTUATOR, .id = (int)i + 1};
    return apc_histogram_create(&s->round_trip);
}

static int open_plant(struct shell *s, const struct own_options *own)
{
    const struct experiment *e = &s->d->experiment;
    const char *link = own->link ? own->link : e->client.link;
    int rc =
        credentials_open(&s->credentials, s->d, link, own->identity ? own->identity : e->client.identity);
    if (rc < 0)
        return rc;
    double *safe = calloc(e->dim.nu, sizeof *safe);
    const struct apc_exchange_options options = {.size = sizeof options,
                                                 .nu = e->dim.nu,
                                                 .ny = e->dim.ny,
                                                 .modbus = e->client.modbus.size ? &e->client.modbus : NULL,
                                                 .safe = safe,
                                                 .identity = s->credentials.identity};
    struct apc_error why;
    if (!safe)
        return daemon_error(s->d, APC_ENOMEM, "out of memory");
    for (size_t i = 0; i < e->dim.nu; i++)
        safe[i] = e->u[i].safe;
    rc = apc_exchange_open(&s->plant, link, &options, &why);
    free(safe);
    return rc < 0 ? daemon_error(s->d, rc, "%s", why.text) : 0;
}

static int open_client(struct shell *s, const struct own_options *own)
{
    const struct experiment *e = &s->d->experiment;
    struct apc_error why;
    int64_t *last = calloc(e->dim.ny, sizeof *last);

    s->watchdog = apc_watchdog_make(e->client.rhythm.period, module_command_period(e));
    s->patience = module_patience(e);
    s->budget = s->patience / 2;
    s->d->store_pause = e->controllers->rhythm.period;
    int rc = last ? allocate_client(s) : APC_ENOMEM;
    if (rc < 0)
        daemon_error(s->d, rc, "%s", apc_err_text(rc));
    if (rc == 0) {
        recorder_measure(s->d->recorder, TASK_EXCHANGE, s->round_trip, &s->failed);
        rc = open_plant(s, own);
    }
    if (rc == 0)
        rc = start_store(s, last);
    if (rc == 0 && (rc = module_client(e, last, s->d->start, &s->core, &why)) < 0)
        daemon_error(s->d, rc, "%s", why.text);
    free(last);
    return rc;
}

/* Outputs that this client has commanded and nobody else does: whoever was refused the measurements never
 * comes here. */
static void leave_safe(struct shell *s)
{
    const apc_ns now = apc_clock_mono(NULL), until = now + LEAVE_TIME, look = now + LEAVE_TIME / 4;
    const struct timespec t = {look / APC_NS_PER_S, look % APC_NS_PER_S};
    int rc = 0;
    pthread_mutex_lock(&s->mutex);
    s->leaving = true;
    sem_post(&s->work);
    while (!s->looked && s->result == 0 && rc == 0)
        rc = pthread_cond_clockwait(&s->answer, &s->mutex, CLOCK_MONOTONIC, &t);
    if (!s->looked) /* and from now on it is left alone */
        s->leaving = false;
    const bool theirs = s->result == APC_EBUSY;
    pthread_mutex_unlock(&s->mutex);
    if (theirs)
        return;
    while ((rc = apc_exchange_safe(s->plant, s->spared, until)) < 0 && apc_clock_mono(NULL) < until)
        nanosleep(&(struct timespec){.tv_nsec = 20 * APC_NS_PER_MS}, NULL);
    if (rc < 0)
        daemon_event(s->d, APC_EVENT_ALARM, "link", "the plant could not be given its safe values: %.150s",
                     apc_exchange_error(s->plant));
}

static void close_client(struct shell *s)
{
    stop_store(s);
    apc_client_destroy(s->core);
    apc_exchange_close(s->plant);
    credentials_close(&s->credentials);
    apc_histogram_destroy(s->round_trip);
    free(s->memory);
    sem_destroy(&s->work);
    pthread_cond_destroy(&s->answer);
    pthread_mutex_destroy(&s->mutex);
}

int main(int argc, char **argv)
{
    struct daemon d;
    struct own_options own = {0};
    struct shell s = {.d = &d,
                      .store_state = {.up = true},
                      .plant_loss.state.up = true,
                      .part_loss.state.up = true,
                      .output_state = {.up = true},
                      .clock_state = {.up = true}};
    int rc = apc_mutex_init(&s.mutex);
    pthread_cond_init(&s.answer, NULL);
    sem_init(&s.work, 0, 0);
    if (rc == 0)
        rc = daemon_open(&d, &program, &own, argc, argv);
    if (rc == 0)
        rc = open_client(&s, &own);
    if (rc == 0 && (rc = daemon_run(&d, d.experiment.client.rhythm, on_client_tick, &s)) == 0)
        leave_safe(&s);
    close_client(&s);
    return daemon_close(&d, rc);
}

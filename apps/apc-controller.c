/* SPDX-License-Identifier: BSD-3-Clause */
/*
 * apc-controller: the control module. Each tick costs two round trips to the store: one reads all that
 * the law needs, one writes all that it made. Its main thread moves the ramps of what the controller takes.
 */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "base/text.h"
#include "common/exitcode.h"
#include "daemon/daemon.h"
#include "experiment/experiment.h"
#include "operate/operate.h"

#define PLACE_MAX 8 /* characters of its name */

struct shell {
    struct daemon d;
    const char *name;  /* NULL: not given */
    const char *place; /* --standby; NULL: it is the only one */
    const struct controller *of;
    struct apc_store *store;
    struct apc_controller *core;
    bool store_up;
    bool claimed, told; /* its outputs, where it takes turns; that it waits for them */
    struct standby standby;
    bool following; /* another one acts */
    bool refused;   /* the place of that one, which was said */
    struct known_plant plant;
    struct ramps ramps; /* the main thread's */
    int unread;         /* the error with which ramps were last not read, which was said */
};

#define AT(member) .to = offsetof(struct shell, member)
static const struct option_spec own_options[] = {
    {"name", 'n', "NAME", "The controller of the file to run; required if there are several", OPTION_TEXT,
     AT(name)},
    {"law", 'l', "NAME",
     "Control law instead of the file's: built in, ./file.so or ./file.py; its own tuning applies. Of "
     "several "
     "controllers: CONTROLLER=NAME",
     OPTION_TEXT, AT(d.options.overrides.law), .once = "only one law at a time"},
    {"standby", 0, "NAME",
     "Run as one of several instances of this controller: one acts, the others follow it, and one of them "
     "takes over within three periods when it stops ticking. NAME tells them apart, such as a and b",
     OPTION_TEXT, AT(place)},
    {0},
};

/* ---- Which one ---------------------------------------------------------------------------- */

static void list_names(const struct experiment *e, char *text, size_t size)
{
    size_t n = 0;
    for (size_t i = 0; i < e->n_controllers && n < size; i++)
        n += (size_t)snprintf(text + n, size - n, "%s%s", i ? ", " : "", e->controllers[i].name);
}

static void choose_controller(struct daemon *d)
{
    struct shell *s = d->options.own;
    const struct experiment *e = &d->experiment;
    char all[256];

    if (!s->name && e->n_controllers == 1)
        s->of = e->controllers;
    for (size_t i = 0; s->name && i < e->n_controllers; i++)
        if (!strcmp(e->controllers[i].name, s->name))
            s->of = &e->controllers[i];
    list_names(e, all, sizeof all);
    if (!s->of && !s->name)
        daemon_error(d, 0, "%s has several controllers: say with --name which one this is: %s", e->file, all);
    else if (!s->of)
        daemon_error(d, 0, "--name \"%s\": %s has no such controller, but %s", s->name, e->file, all);
    if (!s->of)
        exit(EXIT_USAGE);
    controllers_program(e, s->of, d->name);
    d->task_name = s->of->name;
    if (!s->place)
        return;
    if (!*s->place || strlen(s->place) > PLACE_MAX || strchr(s->place, ' ')) {
        daemon_error(d, 0, "--standby \"%s\": must be a word of at most %d characters, such as a", s->place,
                     PLACE_MAX);
        exit(EXIT_USAGE);
    }
    snprintf(d->name, sizeof d->name, "apc-controller %.30s %.8s", s->of->name, s->place);
}

static const struct program program = {
    .name = "apc-controller",
    .doc = "Run a controller's law on the shared data.",
    .task = "controller",
    .parts = EXPERIMENT_LAW,
    .extra = own_options,
    .choose = choose_controller,
};

/* ---- The store ----------------------------------------------------------------------------- */

static void report_controller_store(struct shell *s, int rc)
{
    if (rc < 0 && s->store_up)
        daemon_event(&s->d, APC_EVENT_WARNING, "store", "store lost, trying again: %s",
                     apc_store_error(s->store));
    if (rc >= 0 && !s->store_up)
        daemon_event(&s->d, APC_EVENT_INFO, "store", "store connected again");
    s->store_up = rc >= 0;
}

/* The controller never repeats a row: one that is there already is somebody else's. But a setpoint that
 * somebody wrote meanwhile is left out, by itself: then its seq is 0. */
static int append_tick(struct shell *s, int n)
{
    const struct apc_rows *out = apc_controller_out(s->core);
    int rc = apc_store_append_rows(s->store, out);
    for (size_t i = 0; rc >= 0 && i < out->n_samples; i++)
        n -= out->sample[i].seq == 0;
    return rc < 0 || rc == n ? rc : APC_ECONFLICT;
}

/* Whoever is to act takes the outputs as soon as the other one has given them back. */
static int take_turn_of_outputs(struct shell *s)
{
    int rc = module_take_turns(s->of, s->core, s->store, &s->claimed);
    if (rc == APC_EBUSY && !s->told)
        daemon_event(&s->d, APC_EVENT_INFO, "start", "waits for the outputs: %s", apc_store_error(s->store));
    s->told = rc == APC_EBUSY;
    return s->told ? 0 : rc;
}

/* ---- Whose place it is --------------------------------------------------------------------- */

/* Of its outputs, where it does not take them by turns, and of its tick row, which comes last. */
static int fence_former_controller(struct shell *s)
{
    const size_t nu = s->of->acting ? 0 : s->of->dim.nu;
    struct apc_sample *mine = calloc(nu + 1, sizeof *mine);
    if (!mine)
        return daemon_error(&s->d, APC_ENOMEM, "out of memory");
    for (size_t i = 0; i < nu; i++)
        mine[i] = (struct apc_sample){.table = s->of->u[i].table, .id = (int)s->of->u[i].at + 1};
    mine[nu] = (struct apc_sample){.table = APC_TICK, .id = s->of->number};
    s->standby = (struct standby){.mine = mine, .n = nu + 1, .period = s->of->rhythm.period};
    return 0;
}

/* Go on where the last controller of this run stopped, if there was one. */
static int resume(struct shell *s)
{
    int rc = apc_store_read_rows(s->store, apc_controller_former(s->core));
    if (rc < 0)
        return rc;
    if (apc_controller_resume(s->core, s->d.start) == 1)
        daemon_event(&s->d, APC_EVENT_INFO, "start", "resuming from the stored state");
    if (s->of->acting && (rc = apc_store_read_rows(s->store, apc_controller_in(s->core))) >= 0)
        rc = take_turn_of_outputs(s);
    return rc;
}

/* With a core that knows nothing yet. */
static int follow_acting(struct shell *s)
{
    struct apc_error why;
    apc_controller_destroy(s->core);
    s->core = NULL;
    s->claimed = false;
    const int rc = module_controller(&s->d.experiment, s->of, true, &s->core, &why);
    if (rc < 0)
        return daemon_error(&s->d, rc, "%s", why.text);
    standby_follow(&s->standby);
    s->following = true;
    s->refused = false;
    atomic_store(&s->d.idle, true);
    return 0;
}

/* Another one writes what this one wrote, which was too slow for a time. */
static int step_back(struct shell *s)
{
    daemon_event(&s->d, APC_EVENT_ALARM, "standby", "follows from now on: %s", apc_store_error(s->store));
    const int rc = apc_store_release(s->store, s->standby.mine, s->standby.n);
    return rc == APC_EBUSY || rc >= 0 ? follow_acting(s) : rc;
}

/* Returns 1 where this one acts from this tick on. */
static int stand_by(struct shell *s)
{
    int rc = standby_look(&s->standby, s->store, apc_controller_former(s->core), apc_clock_mono(NULL));
    if (rc <= 0)
        return rc;
    if ((rc = resume(s)) < 0)
        return rc; /* the place is ours: the next look says so again */
    daemon_event(&s->d, APC_EVENT_ALARM, "standby",
                 "acts from now on: the controller that it followed has stopped ticking");
    s->following = false;
    atomic_store(&s->d.idle, false);
    return 1;
}

/* Where the server does not let this one end the other one's session, the store is there all the same. */
static void report_looking(struct shell *s, int rc)
{
    if (rc == APC_EPERM && !s->refused)
        daemon_event(
            &s->d, APC_EVENT_ALARM, "standby",
            "may not take the place of the one that has stopped ticking; let both log in as the same role: "
            "%.90s",
            apc_store_error(s->store));
    s->refused = s->refused || rc == APC_EPERM;
    if (rc != APC_EPERM)
        report_controller_store(s, rc);
}

/* ---- Ticks -------------------------------------------------------------------------------- */

static int on_controller_tick(void *ctx, const struct apc_tick *tick)
{
    struct shell *s = ctx;
    struct apc_notice notice = {0};
    if (s->following) {
        const int rc = stand_by(s);
        if (rc <= 0) {
            report_looking(s, rc);
            return daemon_fatal(&s->d, s->store, rc);
        }
    }
    int rc = apc_store_read_rows(s->store, apc_controller_in(s->core)), written = 0;
    const struct apc_now now = {.mono = apc_clock_mono(NULL), .utc = apc_clock_utc(NULL)};

    int n = apc_controller_compute(s->core, now, tick->index, rc >= 0, &notice);
    if (rc >= 0) {
        rc = append_tick(s, n);
        written = rc >= 0 ? 1 : rc == APC_ECONN || rc == APC_ETIMEDOUT ? -1 : 0;
    }
    apc_controller_update(s->core, written);
    do
        daemon_notice(&s->d, &notice);
    while (apc_controller_noticed(s->core, &notice));
    if (rc >= 0)
        rc = take_turn_of_outputs(s);
    report_controller_store(s, rc);
    return rc == APC_EBUSY && s->place ? step_back(s) : daemon_fatal(&s->d, s->store, rc);
}

/* ---- Ramps --------------------------------------------------------------------------------- */

static void say_of_ramp(void *ctx, enum apc_event_severity severity, const char *text)
{
    daemon_event(ctx, severity, "ramp", "%s", text);
}

/* A store that is away is told of elsewhere; one that cannot be read for another reason here. */
static apc_ns move_ramps(void *ctx)
{
    struct shell *s = ctx;
    const struct ramp_told told = {.ctx = &s->d, .say = say_of_ramp};
    const struct apc_now now = {.mono = apc_clock_mono(NULL), .utc = apc_clock_utc(NULL)};
    if (atomic_load(&s->d.idle))
        return APC_NS_PER_S;
    const int rc = ramps_step(&s->ramps, daemon_records(&s->d), now, &told);
    if (rc < 0 && rc != s->unread && rc != APC_ECONN && rc != APC_ETIMEDOUT)
        daemon_event(&s->d, APC_EVENT_WARNING, "ramp", "ramps cannot be read: %s",
                     apc_store_error(daemon_records(&s->d)));
    s->unread = rc < 0 ? rc : 0;
    return rc != 0 ? APC_NS_PER_S / 4 : APC_NS_PER_S;
}

static int open_ramps(struct shell *s)
{
    const struct experiment *e = &s->d.experiment;
    struct known_plant *p = &s->plant;
    p->tag = provision_tags(e, &p->view.n);
    int rc = p->tag ? controllers_describe(e, &p->loops) : APC_ENOMEM;
    p->view.tag = p->tag;
    p->view.loops = &p->loops;
    if (rc == 0)
        rc = ramps_init(&s->ramps, &p->view, loops_controller(&p->loops, s->of->name));
    s->d.look = move_ramps;
    s->d.look_ctx = s;
    return rc < 0 ? daemon_error(&s->d, rc, "out of memory") : 0;
}

/* ---- Set-up ------------------------------------------------------------------------------- */

static void say_what_it_cannot(struct shell *s)
{
    uint64_t holder;
    if (apc_store_holder(s->store, &s->standby.mine[s->standby.n - 1], &holder) == APC_EINVAL)
        daemon_event(&s->d, APC_EVENT_WARNING, "standby",
                     "takes the place of a controller that has ended, not of one that hangs: %s",
                     apc_store_error(s->store));
}

/* Act, or follow the one that does. */
static int begin_acting(struct shell *s)
{
    int rc = daemon_store(&s->d, &s->store, s->standby.mine, s->place ? 0 : s->standby.n);
    if (rc != 0 || !s->place)
        return rc;
    say_what_it_cannot(s);
    rc = apc_store_claim_set(s->store, s->standby.mine, s->standby.n);
    if (rc < 0 && rc != APC_EBUSY)
        return daemon_error(&s->d, rc, "%s", apc_store_error(s->store));
    if (rc == APC_EBUSY) {
        daemon_event(&s->d, APC_EVENT_INFO, "standby", "stands by: %s", apc_store_error(s->store));
        return follow_acting(s);
    }
    return 0;
}

static int open_controller(struct shell *s)
{
    struct apc_error why;
    int rc = module_controller(&s->d.experiment, s->of, true, &s->core, &why);
    if (rc < 0)
        return daemon_error(&s->d, rc, "%s", why.text);
    s->d.store_timeout = daemon_timeout(s->of->rhythm.period);
    s->d.store_pause = s->of->rhythm.period;
    rc = fence_former_controller(s);
    if (rc == 0)
        rc = begin_acting(s);
    if (rc == 0 && !s->following && (rc = resume(s)) < 0)
        daemon_error(&s->d, rc, "%s", apc_store_error(s->store));
    return rc;
}

int main(int argc, char **argv)
{
    struct shell s = {.store_up = true};
    int rc = daemon_open(&s.d, &program, &s, argc, argv);
    if (rc == 0)
        rc = open_controller(&s);
    if (rc == 0)
        rc = open_ramps(&s);
    if (rc == 0)
        rc = daemon_run(&s.d, s.of->rhythm, on_controller_tick, &s);
    if (s.core && apc_controller_failures(s.core) > 0)
        daemon_event(&s.d, APC_EVENT_WARNING, "rejected",
                     "law %s gave no usable output at %llu tick%s of this run", s.of->law->name,
                     (unsigned long long)apc_controller_failures(s.core),
                     PLURAL(apc_controller_failures(s.core)));
    apc_controller_destroy(s.core);
    ramps_free(&s.ramps);
    known_free(&s.plant);
    free(s.standby.mine);
    apc_store_close(s.store);
    return daemon_close(&s.d, rc);
}

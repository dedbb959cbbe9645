/* SPDX-License-Identifier: BSD-3-Clause */
/* What there is instead of the daemons of `apc run --speed`: this process simulates them, and keeps the record. */
#include <math.h>
#include <stdio.h>
#include <unistd.h>

#include "apc/common/speed.h"
#include "apc/folder/folder.h"
#include "common/storeuri.h"
#include "run.h"
#include "simulation/simulation.h"

#define SAY_EVERY    (5 * APC_NS_PER_S) /* where stdout is no terminal */
#define RECORD_EVERY (APC_NS_PER_S / 2)
#define RECORD_SHARE 4 /* of what the store in memory holds */

struct simulated_run {
    struct run *r;
    const sigset_t *signals;
    struct simulation s;
    struct apc_store *history;
    struct apc_replication *record;
    apc_ns said, checked, recorded; /* monotonic */
    double recorded_t;
    bool terminal, ended; /* by a signal */
};

static bool fail_simulated(struct simulated_run *v, int rc, const char *what, const char *why)
{
    apc_fail(&v->r->failure, rc, "%s%s", what, why);
    return true;
}

static void say_time(const struct simulated_run *v)
{
    struct apc_store_clock clock = {.size = sizeof clock};
    char asked[SPEED_TEXT];
    (void)apc_store_clock(v->s.store, &clock);
    printf("%s%9.1f s  simulation: asked %s, reached %.1f x%s", v->terminal ? "\r" : "", v->s.ended,
           speed_text(clock.asked, asked), fmax(clock.reached, 0), v->terminal ? "      " : "\n");
    fflush(stdout);
}

/* The store in memory forgets: what is to be forgotten is in the record before. True: it cannot be kept. */
static bool keep_record(struct simulated_run *v, apc_ns now)
{
    const double share = v->r->segment.held / RECORD_SHARE;
    if (now - v->recorded < RECORD_EVERY && v->s.ended - v->recorded_t < share)
        return false;
    const int rc = apc_replication_step(v->record, RECORD_EVERY);
    v->recorded = now;
    v->recorded_t = v->s.ended;
    return rc < 0 && fail_simulated(v, rc, "the record cannot be kept: ", apc_replication_error(v->record));
}

static bool look_after(void *ctx)
{
    static const struct timespec at_once = {0, 0};
    struct simulated_run *v = ctx;
    struct run *r = v->r;
    const apc_ns now = apc_clock_mono(NULL);
    struct apc_error why;
    const int signal = sigtimedwait(v->signals, NULL, &at_once);
    if (signal > 0) {
        printf("%sstopping (%s)\n", v->terminal ? "\n" : "", signal == SIGINT ? "Ctrl-C" : "signal");
        v->ended = true;
        return true;
    }
    if (r->parent > 0 && getppid() != r->parent) {
        printf("stopping (the run beside which it was started has ended)\n");
        v->ended = true;
        return true;
    }
    if (now - v->checked >= SUPERVISOR_LOOK) {
        v->checked = now;
        (void)supervisor_check(&r->daemons, &why); /* the page alone, which stands aside */
        run_look_aside();
    }
    if (now - v->said >= (v->terminal ? SUPERVISOR_LOOK : SAY_EVERY)) {
        v->said = now;
        say_time(v);
    }
    return keep_record(v, now);
}

/* Should the process be killed, the folder has what people did. */
static void add_written(void *ctx, size_t from)
{
    struct simulated_run *v = ctx;
    struct apc_error why;
    const int rc = folder_add_written(v->r->dir, &v->s.written, from, SIMULATION_BEGIN, &why);
    if (rc < 0 && !v->r->failure.text[0])
        fail_simulated(v, rc, "", why.text);
}

static int open_record(struct simulated_run *v, struct apc_error *why)
{
    int rc = store_open(&v->history, v->r->history, NULL, why);
    return rc < 0 ? rc : apc_replication_create(&v->record, v->s.store, v->history, why);
}

/* To where people go on, at the speed that they asked for. Returns 1, 0: it was ended before, or an
 * error. */
static int repeat_until_then(struct simulated_run *v, struct pace_watch watch)
{
    const struct run *r = v->r;
    watch.repeats = true;
    if (!(r->options.from > 0))
        return 1;
    int rc = simulation_repeat_writes(&v->s, &r->written);
    if (rc == 0)
        rc = simulation_pace(&v->s, r->options.from, &watch);
    if (rc == 0)
        rc = apc_store_set_speed(v->s.store, r->options.speed, 0);
    return rc < 0 ? rc : v->s.ended >= r->options.from;
}

static void simulate_for_people(struct simulated_run *v)
{
    struct run *r = v->r;
    const struct pace_watch watch = {.look = look_after, .written = add_written, .ctx = v};
    struct apc_store_clock clock = {.size = sizeof clock};
    struct apc_error why;
    int rc = folder_put_written(r->dir, &v->s.written, SIMULATION_BEGIN, &why);
    if (rc < 0)
        r->failure = why;
    else
        rc = repeat_until_then(v, watch);
    if (rc > 0)
        rc = simulation_pace(&v->s, r->e.duration > 0 ? r->e.duration : YEAR, &watch);
    if (rc < 0 && !r->failure.text[0])
        r->failure = v->s.why;
    say_time(v);
    if (!v->ended && apc_store_clock(v->s.store, &clock) > 0)
        r->rewind = clock.rewind;
    rc = folder_put_written(r->dir, &v->s.written, SIMULATION_BEGIN, &why);
    if (rc < 0 && !r->failure.text[0])
        r->failure = why;
}

void run_simulated(struct run *r, const sigset_t *signals)
{
    struct simulated_run v = {.r = r, .signals = signals, .terminal = isatty(STDOUT_FILENO)};
    struct apc_error why;
    int rc = simulation_create_shared(&v.s, &r->e, r->e.seed, r->cli.store, &why);
    if (rc == 0)
        rc = open_record(&v, &why);
    if (rc < 0)
        fail_simulated(&v, rc, "", why.text);
    else
        simulate_for_people(&v);
    (void)apc_ns_from_s(v.s.ended, &r->stopped);
    if (v.terminal)
        putchar('\n');
    apc_replication_destroy(v.record);
    apc_store_close(v.history);
    simulation_destroy(&v.s);
}

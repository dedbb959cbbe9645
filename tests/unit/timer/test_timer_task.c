/* SPDX-License-Identifier: BSD-3-Clause */
/* One table of what every real-time executive must do, run for each of them. */
#include "apctimer.h"
#include "check.h"
#include "timer_test.h"

#include <pthread.h>
#include <sched.h>
#include <signal.h>
#include <stdatomic.h>
#include <string.h>

#define MS    APC_NS_PER_MS
#define CALLS 64

/* What a callback saw, and what it is told to do. Read it only after `ticked`, or when the task is stopped. */
struct record {
    struct apc_tick tick[CALLS];
    unsigned calls;
    unsigned hold; /* number of the call (from 1) that waits for `release` */
    unsigned end;  /* number of the call that returns `result` */
    int result;
    struct apc_task *task; /* to be stopped and waited for from inside */
    int stopped, waited;
    int policy, priority, cpu; /* the highest */
    bool sigint_blocked;
    atomic_int inside, overlaps;
    sem_t ticked, entered, release;
};

static int on_tick(void *ctx, const struct apc_tick *tick)
{
    struct record *r = ctx;
    sigset_t mask;

    if (atomic_fetch_add(&r->inside, 1) > 0)
        atomic_fetch_add(&r->overlaps, 1);
    if (r->calls < CALLS)
        r->tick[r->calls] = *tick;
    unsigned number = ++r->calls;
    if (r->task) {
        r->stopped = apc_task_stop(r->task);
        r->waited = apc_task_wait(r->task, 0, NULL);
        apc_task_destroy(r->task);
    }
    r->policy = sched_getscheduler(0);
    struct sched_param param;
    if (sched_getparam(0, &param) == 0)
        r->priority = param.sched_priority;
    if (sched_getcpu() > r->cpu)
        r->cpu = sched_getcpu();
    r->sigint_blocked = pthread_sigmask(SIG_BLOCK, NULL, &mask) == 0 && sigismember(&mask, SIGINT) == 1;
    if (number == r->hold) {
        sem_post(&r->entered);
        posted(&r->release);
    }
    atomic_fetch_sub(&r->inside, 1);
    sem_post(&r->ticked);
    return number == r->end ? r->result : 0;
}

struct bench {
    struct apc_executive *executive;
    struct apc_task *task;
    struct record r;
};

static void make_executive(struct apc_executive **executive, const char *name, const struct apc_clock *clock)
{
    const struct apc_executive_options options = {.size = sizeof options, .clock = clock};
    struct apc_error why = {""};
    if (apc_executive_create(executive, name, &options, &why) != 0)
        fail_msg("%s", why.text);
}

static struct bench *set_up(const char *name, struct apc_task_options options, const struct apc_clock *clock)
{
    struct bench *b = calloc(1, sizeof *b);
    struct apc_error why = {""};
    assert_non_null(b);
    sem_init(&b->r.ticked, 0, 0);
    sem_init(&b->r.entered, 0, 0);
    sem_init(&b->r.release, 0, 0);
    make_executive(&b->executive, name, clock);
    options.size = sizeof options;
    if (apc_task_create(b->executive, &options, on_tick, &b->r, &b->task, &why) != 0)
        fail_msg("%s", why.text);
    return b;
}

static void start(struct bench *b)
{
    struct apc_error why = {""};
    if (apc_task_start(b->task, &why) != 0)
        fail_msg("%s", why.text);
}

static void ticks(struct bench *b, unsigned n)
{
    for (unsigned i = 0; i < n; i++)
        assert_true(posted(&b->r.ticked));
}

static void tear_down(struct bench *b)
{
    apc_task_destroy(b->task);
    assert_int_equal(apc_executive_destroy(b->executive), 0);
    assert_int_equal(atomic_load(&b->r.overlaps), 0);
    free(b);
}

/* ---- The table ---- */

static void calls_lie_on_the_grid_and_the_numbers_add_up(void **state)
{
    struct bench *b = set_up(*state, (struct apc_task_options){.period = 2 * MS}, NULL);
    const struct record *r = &b->r;
    struct apc_timing timing = {.size = sizeof timing};
    uint64_t followed = 0, missed = 0;

    start(b);
    ticks(b, 40);
    assert_int_equal(apc_task_stop(b->task), 0);
    apc_ns origin = r->tick[0].scheduled - (apc_ns)r->tick[0].index * 2 * MS;
    for (unsigned i = 0; i < r->calls && i < CALLS; i++) {
        const struct apc_tick *t = &r->tick[i];
        assert_true(t->scheduled == apc_grid_time(origin, 2 * MS, t->index));
        assert_true(t->started >= t->scheduled && t->started < t->scheduled + 2 * MS);
        assert_true(t->index == t->missed + (i > 0 ? r->tick[i - 1].index + 1 : 0));
        missed += t->missed;
        followed += t->index > 0 && t->missed == 0;
    }
    apc_task_timing(b->task, &timing);
    assert_int_equal(timing.ticks, r->calls);
    assert_int_equal(timing.lateness.count, r->calls);
    assert_int_equal(timing.run.count, r->calls);
    assert_true(timing.missed >= missed && timing.missed == apc_task_missed(b->task));
    if (r->calls <= CALLS)
        assert_int_equal(timing.jitter.count, followed);
    assert_true(timing.lateness.min >= 0 && timing.run.min >= 0);
    assert_non_null(apc_task_histogram(b->task, APC_LATENESS));
    assert_non_null(apc_task_histogram(b->task, APC_JITTER));
    assert_non_null(apc_task_histogram(b->task, APC_RUN));
    assert_null(apc_task_histogram(b->task, (enum apc_task_histogram)0));
    tear_down(b);
}

/*
 * Promise(run/callbacks-never-overlap): Callbacks never overlap or run after stop; every missed tick is
 *   counted, also of a daemon that was not there.
 */
static void a_task_never_overlaps_itself_and_counts_what_it_missed(void **state)
{
    struct bench *b = set_up(*state, (struct apc_task_options){.period = 5 * MS}, NULL);
    const struct record *r = &b->r;

    b->r.hold = 2;
    start(b);
    assert_true(posted(&b->r.entered));
    apc_ns held = r->tick[1].scheduled;
    assert_true(passed(held + 30 * MS)); /* five instants went by in the callback, */
    apc_ns before = apc_clock_mono(NULL);
    uint64_t missed = apc_task_missed(b->task) - r->tick[1].missed - r->tick[0].missed;
    uint64_t in_a_row = apc_task_overruns(b->task, NULL) - r->tick[1].missed - r->tick[0].missed;
    apc_ns after = apc_clock_mono(NULL);
    assert_true(missed >=
                (uint64_t)((before - held - 1) / (5 * MS))); /* known although it has not returned */
    assert_true(missed <= (uint64_t)((after - held - 1) / (5 * MS)));
    assert_true(in_a_row >= missed && in_a_row <= (uint64_t)((after - held - 1) / (5 * MS)));
    apc_ns released = apc_clock_mono(NULL);
    sem_post(&b->r.release);
    ticks(b, 4);
    assert_int_equal(apc_task_stop(b->task), 0);
    assert_true(r->tick[2].missed >= 5);
    assert_true(r->tick[2].index == r->tick[1].index + 1 + r->tick[2].missed);
    assert_true(r->tick[2].scheduled > released); /* back on the grid, not late for what is past */
    assert_true(apc_task_missed(b->task) >= r->tick[2].missed);
    tear_down(b);
}

static void ten_ticks_missed_in_a_row_are_an_alarm_seen_while_it_lasts(void **state)
{
    struct bench *b = set_up(*state, (struct apc_task_options){.period = 5 * MS}, NULL);
    uint64_t before, after;

    assert_int_equal(apc_task_overruns(b->task, NULL), 0);
    b->r.hold = 2;
    start(b);
    assert_true(posted(&b->r.entered));
    assert_true(passed(b->r.tick[1].scheduled + (APC_OVERRUN_ALARM + 1) * 5 * MS));
    assert_true(apc_task_overruns(b->task, &before) >= APC_OVERRUN_ALARM); /* the callback is still held */
    sem_post(&b->r.release);
    do
        ticks(b, 1);
    while (apc_task_overruns(b->task, NULL) > 0);
    apc_task_overruns(b->task, &after);
    assert_true(after > before);
    assert_int_equal(apc_task_stop(b->task), 0);
    assert_int_equal(apc_task_overruns(b->task, NULL), 0);
    tear_down(b);
}

/* Promise(simulation/tasks) */
static void burst_runs_every_tick_in_turn(void **state)
{
    struct bench *b =
        set_up(*state, (struct apc_task_options){.period = 5 * MS, .overrun = APC_OVERRUN_BURST}, NULL);
    const struct record *r = &b->r;

    b->r.hold = 1;
    start(b);
    assert_true(posted(&b->r.entered));
    assert_true(passed(r->tick[0].scheduled + 50 * MS));
    assert_int_equal(apc_task_missed(b->task), 0);
    sem_post(&b->r.release);
    ticks(b, 20);
    assert_int_equal(apc_task_stop(b->task), 0);
    for (unsigned i = 0; i < 20; i++) {
        assert_int_equal(r->tick[i].index, i);
        assert_int_equal(r->tick[i].missed, 0);
    }
    tear_down(b);
}

/* What the task has ended with. */
static int result_of(struct apc_task *task, apc_ns timeout)
{
    int result = 0;
    assert_int_equal(apc_task_wait(task, timeout, &result), 0);
    return result;
}

static void the_stop_policy_ends_the_task_at_the_first_overrun(void **state)
{
    struct bench *b =
        set_up(*state, (struct apc_task_options){.period = 400 * MS, .overrun = APC_OVERRUN_STOP}, NULL);

    b->r.hold = 1;
    start(b);
    assert_true(posted(&b->r.entered));
    assert_true(passed(b->r.tick[0].scheduled + 800 * MS + 1));
    assert_true(apc_task_missed(b->task) >= 1); /* nobody needs to wait for the callback to see it */
    sem_post(&b->r.release);
    ticks(b, 1);
    assert_int_equal(result_of(b->task, PATIENCE), APC_EOVERRUN);
    assert_int_equal(apc_task_stop(b->task), 0);
    assert_int_equal(b->r.calls, 1);
    assert_true(apc_task_missed(b->task) >= 1);
    assert_int_equal(apc_task_overruns(b->task, NULL), 0); /* it has ended */
    tear_down(b);
}

static void what_the_callback_returns_ends_the_task_and_is_its_result(void **state)
{
    static const int results[] = {42, APC_ETIMEDOUT, APC_ESTATE}; /* also one that a wait could fail with */
    for (size_t i = 0; i < 3; i++) {
        struct bench *b = set_up(*state, (struct apc_task_options){.period = 2 * MS}, NULL);
        int untouched = 5;
        b->r.end = 3;
        b->r.result = results[i];
        assert_int_equal(apc_task_wait(b->task, 0, &untouched), APC_ESTATE);
        assert_int_equal(untouched, 5);
        start(b);
        assert_int_equal(result_of(b->task, PATIENCE), results[i]);
        assert_int_equal(apc_task_stop(b->task), 0);
        assert_int_equal(b->r.calls, 3);
        assert_int_equal(result_of(b->task, 0), results[i]);
        assert_int_equal(apc_task_start(b->task, NULL), APC_ESTATE);
        tear_down(b);
    }
}

static void stop_interrupts_a_long_period_and_may_be_repeated(void **state)
{
    struct bench *b = set_up(*state, (struct apc_task_options){.period = 150 * APC_NS_PER_S}, NULL);

    assert_int_equal(apc_task_stop(b->task), 0); /* before the start: nothing to do */
    start(b);
    ticks(b, 1);
    assert_int_equal(apc_task_wait(b->task, 0, NULL), APC_ETIMEDOUT);
    assert_int_equal(apc_task_stop(b->task), 0);
    assert_int_equal(apc_task_stop(b->task), 0);
    assert_int_equal(result_of(b->task, 0), 0);
    assert_int_equal(b->r.calls, 1);
    assert_int_equal(apc_task_missed(b->task), 0);
    tear_down(b);
}

/* Promise(experiment/schedule-keeps-last) */
static void a_start_in_the_future_is_the_instant_of_tick_0(void **state)
{
    apc_ns at = apc_clock_mono(NULL) + 300 * MS;
    struct bench *b =
        set_up(*state, (struct apc_task_options){.period = APC_NS_PER_S * 60, .start = at}, NULL);

    start(b);
    ticks(b, 1);
    assert_int_equal(b->r.tick[0].index, 0);
    assert_true(b->r.tick[0].scheduled == at);
    assert_true(b->r.tick[0].started >= at);
    tear_down(b);
}

static void a_start_in_the_past_is_refused(void **state)
{
    apc_ns at = apc_clock_mono(NULL) - 1;
    struct bench *b = set_up(*state, (struct apc_task_options){.period = MS, .start = at}, NULL);
    struct apc_error why = {""};

    assert_int_equal(apc_task_start(b->task, &why), APC_EINVAL);
    assert_non_null(strstr(why.text, "past"));
    assert_int_equal(apc_task_wait(b->task, 0, NULL), APC_ESTATE);
    assert_int_equal(apc_task_stop(b->task), 0);
    assert_int_equal(b->r.calls, 0);
    tear_down(b);
}

/* An executive takes the monotonic time from the system, not from an injected clock. */
static apc_ns never_asked(void *ctx)
{
    (void)ctx;
    return INT64_MIN;
}

/* The wall clock of a machine that was switched on some time ago. */
static apc_ns steady_utc(void *ctx)
{
    return apc_clock_mono(NULL) + *(const apc_ns *)ctx;
}

/* Promise(experiment/schedule-keeps-last) */
static void aligned_tasks_tick_on_the_wall_clocks_grid_and_agree_on_the_index(void **state)
{
    const apc_ns period = 50 * MS, phase = 7 * MS, tolerance = 5 * MS;
    apc_ns ahead = 1800000000 * APC_NS_PER_S + 123456789;
    const struct apc_clock clock = {never_asked, steady_utc, &ahead};
    struct bench *b =
        set_up(*state, (struct apc_task_options){.period = period, .start = phase, .aligned = true}, &clock);
    apc_ns from = apc_clock_mono(NULL);
    struct apc_timing timing = {.size = sizeof timing};

    start(b);
    ticks(b, 3);
    assert_int_equal(apc_task_stop(b->task), 0);
    for (int i = 0; i < 3; i++) {
        const struct apc_tick *t = &b->r.tick[i];
        apc_ns utc = t->scheduled + ahead;
        assert_true(t->scheduled >= from);
        assert_true(utc - apc_grid_time(phase, period, t->index) < tolerance);
        assert_true(utc - apc_grid_time(phase, period, t->index) > -tolerance);
    }
    assert_true(b->r.tick[0].missed < 1000); /* those of a few seconds, not those since 1970 */
    apc_task_timing(b->task, &timing);
    assert_true(timing.jitter.count < timing.ticks); /* the first has no predecessor, whatever its index */
    tear_down(b);
}

static void an_aligned_start_may_lie_ahead(void **state)
{
    const apc_ns tolerance = 5 * MS;
    apc_ns ahead = 1800000000 * APC_NS_PER_S;
    const struct apc_clock clock = {never_asked, steady_utc, &ahead};
    apc_ns at = apc_clock_mono(NULL) + 300 * MS;
    struct bench *b = set_up(
        *state, (struct apc_task_options){.period = 60 * APC_NS_PER_S, .start = at + ahead, .aligned = true},
        &clock);

    start(b);
    ticks(b, 1);
    assert_int_equal(b->r.tick[0].index, 0);
    assert_true(b->r.tick[0].scheduled > at - tolerance && b->r.tick[0].scheduled < at + tolerance);
    tear_down(b);
}

static void a_callback_cannot_stop_wait_for_or_destroy_its_own_task(void **state)
{
    struct bench *b = set_up(*state, (struct apc_task_options){.period = 2 * MS}, NULL);

    b->r.task = b->task;
    start(b);
    ticks(b, 3); /* still alive after each attempt */
    assert_int_equal(apc_task_stop(b->task), 0);
    assert_int_equal(b->r.stopped, APC_ESTATE);
    assert_int_equal(b->r.waited, APC_ESTATE);
    tear_down(b);
}

static void *stop_it(void *task)
{
    return apc_task_stop(task) == 0 ? NULL : task;
}

static void every_one_of_several_stops_at_once_joins(void **state)
{
    struct bench *b = set_up(*state, (struct apc_task_options){.period = MS}, NULL);
    pthread_t thread[4];
    void *result;

    b->r.hold = 2;
    start(b);
    assert_true(posted(&b->r.entered));
    for (int i = 0; i < 4; i++)
        assert_int_equal(pthread_create(&thread[i], NULL, stop_it, b->task), 0);
    sem_post(&b->r.release);
    assert_int_equal(result_of(b->task, PATIENCE), 0); /* stopping wakes a waiter */
    for (int i = 0; i < 4; i++) {
        assert_int_equal(pthread_join(thread[i], &result), 0);
        assert_null(result);
    }
    assert_int_equal(atomic_load(&b->r.inside), 0);
    tear_down(b);
}

static void an_executive_with_tasks_is_not_destroyed(void **state)
{
    struct bench *b = set_up(*state, (struct apc_task_options){.period = MS}, NULL);
    assert_int_equal(apc_executive_destroy(b->executive), APC_ESTATE);
    tear_down(b);
}

/* A wall clock that is stepped at the third reading. */
struct stepping {
    apc_ns now, step;
    unsigned readings;
};

static apc_ns stepping_utc(void *ctx)
{
    struct stepping *s = ctx;
    s->now += ++s->readings == 3 ? s->step : 1;
    return s->now;
}

static void a_step_of_the_wall_clock_shows_in_utc_and_nowhere_else(void **state)
{
    const apc_ns steps[] = {-3600 * APC_NS_PER_S, 3600 * APC_NS_PER_S};
    for (size_t n = 0; n < 2; n++) {
        struct stepping wall = {.now = 1800000000 * APC_NS_PER_S, .step = steps[n]};
        const struct apc_clock clock = {never_asked, stepping_utc, &wall};
        struct bench *b = set_up(*state, (struct apc_task_options){.period = 2 * MS}, &clock);
        const struct apc_tick *t = b->r.tick;

        start(b);
        ticks(b, 6);
        assert_int_equal(apc_task_stop(b->task), 0);
        for (int i = 0; i < 5; i++) {
            assert_true(t[i + 1].utc - t[i].utc == (i == 1 ? steps[n] : 1));
            assert_true(t[i + 1].scheduled - t[i].scheduled ==
                        (apc_ns)(t[i + 1].index - t[i].index) * 2 * MS);
        }
        tear_down(b);
    }
}

static void a_callback_runs_where_and_as_it_was_asked_to(void **state)
{
    struct bench *b = set_up(*state, (struct apc_task_options){.period = MS, .priority = -1, .cpu = 1}, NULL);
    start(b);
    ticks(b, 40);
    assert_int_equal(apc_task_stop(b->task), 0);
    assert_int_equal(b->r.policy, SCHED_OTHER);
    assert_int_equal(b->r.cpu, 0);
    assert_true(b->r.sigint_blocked);
    tear_down(b);
}

/* Every priority that there is, where this process may have one. */
static void a_callback_has_the_priority_it_was_asked_for(void **state)
{
    static const int priorities[] = {1, 2, 98, 99};
    const struct sched_param lowest = {.sched_priority = 1}, none = {0};

    if (sched_setscheduler(0, SCHED_FIFO, &lowest) < 0 || sched_setscheduler(0, SCHED_OTHER, &none) < 0)
        skip();
    for (size_t i = 0; i < sizeof priorities / sizeof *priorities; i++) {
        struct bench *b =
            set_up(*state, (struct apc_task_options){.period = MS, .priority = priorities[i]}, NULL);
        start(b);
        ticks(b, 2);
        assert_int_equal(apc_task_stop(b->task), 0);
        assert_int_equal(b->r.policy, SCHED_FIFO);
        assert_int_equal(b->r.priority, priorities[i]);
        tear_down(b);
    }
}

static void seventy_tasks_share_an_executive(void **state)
{
    enum { TASKS = 70 };
    const struct apc_task_options options = {.size = sizeof options, .period = 20 * MS};
    struct apc_executive *executive;
    struct apc_task *task[TASKS];
    struct record *r = calloc(TASKS, sizeof *r);

    assert_non_null(r);
    make_executive(&executive, *state, NULL);
    for (int i = 0; i < TASKS; i++) {
        sem_init(&r[i].ticked, 0, 0);
        assert_int_equal(apc_task_create(executive, &options, on_tick, &r[i], &task[i], NULL), 0);
        assert_int_equal(apc_task_start(task[i], NULL), 0);
    }
    for (int i = 0; i < TASKS; i++)
        assert_true(posted(&r[i].ticked) && posted(&r[i].ticked));
    for (int i = 0; i < TASKS; i++)
        apc_task_destroy(task[i]);
    assert_int_equal(apc_executive_destroy(executive), 0);
    for (int i = 0; i < TASKS; i++)
        assert_int_equal(atomic_load(&r[i].overlaps), 0);
    free(r);
}

/* Promise(run): A spinning task keeps its grid and its share of a CPU. */
static void a_spinning_task_keeps_its_grid_and_its_bounds(void **state)
{
    const apc_ns periods[] = {20 * APC_NS_PER_US, MS, 20 * MS};
    (void)state;
    for (size_t i = 0; i < sizeof periods / sizeof *periods; i++) {
        struct bench *b =
            set_up("deadline", (struct apc_task_options){.period = periods[i], .spin = true}, NULL);
        struct apc_timing timing = {.size = sizeof timing};
        start(b);
        ticks(b, 20);
        assert_int_equal(apc_task_stop(b->task), 0);
        for (unsigned k = 0; k < 20; k++) {
            const struct apc_tick *t = &b->r.tick[k];
            assert_true(t->scheduled ==
                        apc_grid_time(b->r.tick[0].scheduled, periods[i], t->index - b->r.tick[0].index));
            assert_true(t->started >= t->scheduled); /* early is only the sleep's end */
        }
        apc_task_timing(b->task, &timing);
        assert_true(timing.spin_margin > 0 && timing.spin_margin <= periods[i] / 8);
        assert_true(timing.spin_share >= 0 && timing.spin_share < 1);
        tear_down(b);
    }
}

static void a_task_that_does_not_spin_says_so(void **state)
{
    struct bench *b = set_up(*state, (struct apc_task_options){.period = MS}, NULL);
    struct apc_timing timing = {.size = sizeof timing};
    start(b);
    ticks(b, 3);
    apc_task_timing(b->task, &timing);
    assert_int_equal(timing.spin_margin, 0);
    assert_near(timing.spin_share, 0, 0);
    tear_down(b);
}

static void only_the_deadline_executive_spins(void **state)
{
    const struct apc_task_options options = {.size = sizeof options, .period = MS, .spin = true};
    struct apc_executive *executive;
    struct apc_task *task;
    struct apc_error why = {""};
    (void)state;
    make_executive(&executive, "posix", NULL);
    assert_int_equal(apc_task_create(executive, &options, on_tick, NULL, &task, &why), APC_EINVAL);
    assert_non_null(strstr(why.text, "spin"));
    assert_int_equal(apc_executive_destroy(executive), 0);
}

struct race {
    sem_t ticked;
    atomic_bool stopped;
    atomic_uint late;
};

static int race(void *ctx, const struct apc_tick *tick)
{
    struct race *r = ctx;
    (void)tick;
    if (atomic_load(&r->stopped))
        atomic_fetch_add(&r->late, 1);
    sem_post(&r->ticked);
    return 0;
}

/* APC_TEST_STOPS=100000 for a long run. */
/* Promise(run/callbacks-never-overlap) */
static void no_callback_runs_after_stop_whenever_it_comes(void **state)
{
    const char *given = getenv("APC_TEST_STOPS");
    size_t n = given ? strtoul(given, NULL, 10) : 2000;
    struct apc_task_options options = {.size = sizeof options, .period = 100 * APC_NS_PER_US};
    struct race *r = calloc(n, sizeof *r); /* all outlive the last stop, to catch a late callback */
    struct apc_executive *executive;
    struct apc_task *task;
    uint64_t random = seed();
    unsigned late = 0;

    assert_non_null(r);
    make_executive(&executive, *state, NULL);
    for (size_t i = 0; i < n; i++) {
        options.spin = *state == deadline_name && i % 2 == 1; /* stop then comes during the spinning too */
        sem_init(&r[i].ticked, 0, 0);
        assert_int_equal(apc_task_create(executive, &options, race, &r[i], &task, NULL), 0);
        assert_int_equal(apc_task_start(task, NULL), 0);
        for (uint64_t before = xorshift(&random) % 4; before > 0; before--)
            assert_true(posted(&r[i].ticked));
        assert_int_equal(apc_task_stop(task), 0);
        atomic_store(&r[i].stopped, true);
        apc_task_destroy(task);
    }
    assert_int_equal(apc_executive_destroy(executive), 0);
    for (size_t i = 0; i < n; i++)
        late += atomic_load(&r[i].late);
    assert_int_equal(late, 0);
    free(r);
}

/* ---- What does not depend on the executive ---- */

static void an_unknown_executive_or_option_is_refused_with_a_reason(void **state)
{
    struct {
        struct apc_executive_options known;
        int unknown;
    } newer = {.known = {.size = sizeof newer}};
    struct apc_executive_options options = {.size = sizeof options};
    struct apc_executive *executive = (void *)&options;
    struct apc_error why = {""};
    (void)state;

    assert_int_equal(apc_executive_create(&executive, "sundial", &options, &why), APC_EINVAL);
    assert_null(executive);
    assert_non_null(strstr(why.text, "sundial"));
    assert_int_equal(apc_executive_create(&executive, NULL, NULL, NULL), APC_EINVAL);
    assert_int_equal(apc_executive_create(NULL, "deadline", NULL, &why), APC_EINVAL);
    assert_int_equal(apc_executive_create(&executive, "deadline", NULL, NULL), 0);
    assert_int_equal(apc_executive_destroy(executive), 0);

    assert_int_equal(apc_executive_create(&executive, "deadline", &newer.known, &why), 0);
    assert_int_equal(apc_executive_destroy(executive), 0);
    newer.unknown = 1;
    assert_int_equal(apc_executive_create(&executive, "deadline", &newer.known, &why), APC_EINVAL);
    for (options.size = 0; options.size < sizeof options.size; options.size++)
        assert_int_equal(apc_executive_create(&executive, "deadline", &options, &why), APC_EINVAL);
    options.size = SIZE_MAX;
    assert_int_equal(apc_executive_create(&executive, "deadline", &options, &why), APC_EINVAL);
    assert_int_equal(apc_executive_destroy(NULL), 0);
}

static void bad_task_options_are_refused_with_a_reason(void **state)
{
    const apc_ns year = INT64_C(366) * 86400 * APC_NS_PER_S;
    const size_t size = sizeof(struct apc_task_options);
    const int cpus = (int)sysconf(_SC_NPROCESSORS_CONF);
    const struct apc_task_options bad[] = {
        {.size = size},
        {.size = size, .period = -1},
        {.size = size, .period = INT64_MIN},
        {.size = size, .period = 9 * APC_NS_PER_US},
        {.size = size, .period = 10 * APC_NS_PER_US - 1},
        {.size = size, .period = year + APC_NS_PER_S},
        {.size = size, .period = INT64_MAX},
        {.size = 0, .period = MS},
        {.size = sizeof(size_t) - 1, .period = MS},
        {.size = SIZE_MAX, .period = MS},
        {.size = size, .period = MS, .start = -1},
        {.size = size, .period = MS, .start = -1, .aligned = true},
        {.size = size, .period = MS, .priority = 100},
        {.size = size, .period = MS, .priority = -2},
        {.size = size, .period = MS, .cpu = -1},
        {.size = size, .period = MS, .cpu = cpus + 1},
        {.size = size, .period = MS, .cpu = 1000000},
        {.size = size, .period = MS, .overrun = (enum apc_overrun)4},
        {.size = size, .period = MS, .name = "sixteen bytes is"},
    };
    const struct apc_task_options good[] = {
        {.size = size, .period = 10 * APC_NS_PER_US, .name = "fifteen bytes -"},
        {.size = size, .period = year, .priority = 99},
        {.size = size, .period = MS, .priority = 1, .cpu = cpus},
        {.size = size, .period = MS, .priority = -1, .cpu = 1},
    };
    struct apc_executive *executive;
    struct apc_task *task;
    (void)state;

    make_executive(&executive, "deadline", NULL);
    for (size_t i = 0; i < sizeof bad / sizeof *bad; i++) {
        struct apc_error why = {""};
        task = (void *)&why;
        if (apc_task_create(executive, &bad[i], on_tick, NULL, &task, &why) != APC_EINVAL || task ||
            !*why.text)
            fail_msg("case %zu", i);
    }
    assert_int_equal(apc_task_create(executive, &good[0], NULL, NULL, &task, NULL), APC_EINVAL);
    assert_int_equal(apc_task_create(executive, NULL, on_tick, NULL, &task, NULL), APC_EINVAL);
    assert_int_equal(apc_task_create(NULL, &good[0], on_tick, NULL, &task, NULL), APC_EINVAL);
    assert_int_equal(apc_task_create(executive, &good[0], on_tick, NULL, NULL, NULL), APC_EINVAL);
    for (size_t i = 0; i < sizeof good / sizeof *good; i++) {
        assert_int_equal(apc_task_create(executive, &good[i], on_tick, NULL, &task, NULL), 0);
        apc_task_destroy(task);
    }
    assert_int_equal(apc_task_stop(NULL), APC_EINVAL);
    assert_int_equal(apc_task_start(NULL, NULL), APC_EINVAL);
    assert_int_equal(apc_task_wait(NULL, 0, NULL), APC_EINVAL);
    apc_task_destroy(NULL);
    assert_int_equal(apc_executive_destroy(executive), 0);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(an_unknown_executive_or_option_is_refused_with_a_reason),
        cmocka_unit_test(bad_task_options_are_refused_with_a_reason),
        EACH(calls_lie_on_the_grid_and_the_numbers_add_up),
        EACH(a_task_never_overlaps_itself_and_counts_what_it_missed),
        EACH(ten_ticks_missed_in_a_row_are_an_alarm_seen_while_it_lasts),
        EACH(burst_runs_every_tick_in_turn),
        EACH(the_stop_policy_ends_the_task_at_the_first_overrun),
        EACH(what_the_callback_returns_ends_the_task_and_is_its_result),
        EACH(stop_interrupts_a_long_period_and_may_be_repeated),
        EACH(a_start_in_the_future_is_the_instant_of_tick_0),
        EACH(a_start_in_the_past_is_refused),
        EACH(aligned_tasks_tick_on_the_wall_clocks_grid_and_agree_on_the_index),
        EACH(an_aligned_start_may_lie_ahead),
        EACH(a_callback_cannot_stop_wait_for_or_destroy_its_own_task),
        EACH(every_one_of_several_stops_at_once_joins),
        EACH(an_executive_with_tasks_is_not_destroyed),
        EACH(a_step_of_the_wall_clock_shows_in_utc_and_nowhere_else),
        EACH(a_callback_runs_where_and_as_it_was_asked_to),
        EACH(a_callback_has_the_priority_it_was_asked_for),
        EACH(seventy_tasks_share_an_executive),
        cmocka_unit_test(a_spinning_task_keeps_its_grid_and_its_bounds),
        EACH(a_task_that_does_not_spin_says_so),
        cmocka_unit_test(only_the_deadline_executive_spins),
        EACH(no_callback_runs_after_stop_whenever_it_comes),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}

/* SPDX-License-Identifier: BSD-3-Clause */
/* The executive "virtual": order, overruns, jitter, execution times, steps and drift of the clock. */
#include "check.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include <apctimer.h>

#define MS    APC_NS_PER_MS
#define S     APC_NS_PER_S
#define BEGIN (INT64_C(1700000000) * S)
#define TRACE 4096

static char trace[TRACE]; /* what happened, in order */

static void note(const char *fmt, ...) APC_PRINTF(1, 2);
static void note(const char *fmt, ...)
{
    size_t used = strlen(trace);
    va_list args;
    va_start(args, fmt);
    vsnprintf(trace + used, sizeof trace - used, fmt, args);
    va_end(args);
}

static struct apc_executive *make(void)
{
    const struct apc_executive_options options = {.size = sizeof options, .begin = BEGIN};
    struct apc_executive *e = NULL;
    trace[0] = '\0';
    assert_int_equal(apc_executive_create(&e, "virtual", &options, NULL), 0);
    return e;
}

static apc_ns now(struct apc_executive *e)
{
    return apc_clock_mono(apc_executive_clock(e));
}

/* A task that notes each call, and its end. */
struct unit {
    struct apc_executive *e;
    const char *name;
    apc_ns zero;
    struct apc_task *task;
    int end_at; /* end at that tick with result 7; 0: never */
};

static int on_tick(void *ctx, const struct apc_tick *tick)
{
    struct unit *u = ctx;
    note("%s%d@%g ", u->name, (int)tick->index, apc_ns_to_s(tick->started - u->zero));
    if (tick->missed)
        note("(%d missed) ", (int)tick->missed);
    assert_int_equal(tick->started, now(u->e));
    return u->end_at && (int)tick->index == u->end_at ? 7 : 0;
}

static void on_finish(void *ctx)
{
    struct unit *u = ctx;
    note("/%s@%g ", u->name, apc_ns_to_s(now(u->e) - u->zero));
}

static void begin(struct unit *u, struct apc_executive *e, const char *name, struct apc_task_options options,
                  const struct apc_virtual_model *model)
{
    struct apc_error why = {""};
    u->e = e;
    u->name = name;
    u->zero = now(e);
    options.size = sizeof options;
    options.name = name;
    assert_int_equal(apc_task_create(e, &options, on_tick, u, &u->task, &why), 0);
    if (model) {
        struct apc_virtual_model m = *model;
        m.size = sizeof m;
        if (apc_virtual_set_model(u->task, &m, &why) < 0)
            fail_msg("%s", why.text);
    }
    assert_int_equal(apc_task_start(u->task, &why), 0);
}

static struct apc_distribution constant(double value)
{
    return (struct apc_distribution){.kind = APC_CONSTANT, .a = value};
}

/* ---- Order ---- */

static void coinciding_ticks_come_by_rank(void **state)
{
    struct apc_executive *e = make();
    struct unit u[3] = {0};
    (void)state;
    begin(&u[0], e, "c", (struct apc_task_options){.period = 2 * S}, &(struct apc_virtual_model){.rank = 4});
    begin(&u[1], e, "p", (struct apc_task_options){.period = 1 * S}, &(struct apc_virtual_model){.rank = 2});
    begin(&u[2], e, "s", (struct apc_task_options){.period = 3 * S}, &(struct apc_virtual_model){.rank = 1});
    assert_int_equal(apc_virtual_run(e, now(e) + 6 * S), 4 + 7 + 3);
    assert_string_equal(trace, "s0@0 p0@0 c0@0 p1@1 p2@2 c1@2 s1@3 p3@3 p4@4 c2@4 p5@5 s2@6 p6@6 c3@6 ");
    for (int i = 0; i < 3; i++)
        apc_task_destroy(u[i].task);
    assert_int_equal(apc_executive_destroy(e), 0);
}

static void ticks_lie_on_the_grid_of_the_wall_clock(void **state)
{
    struct apc_executive *e = make();
    struct unit u = {0};
    (void)state;
    begin(&u, e, "a",
          (struct apc_task_options){.period = 2 * S, .start = BEGIN - 5 * S + 10 * MS, .aligned = true},
          NULL);
    apc_virtual_run(e, now(e) + 4 * S);
    assert_string_equal(trace, "a3@1.01 a4@3.01 ");
    apc_task_destroy(u.task);
    apc_executive_destroy(e);
}

struct item {
    struct apc_executive *e;
    apc_ns at;
    int rank, number;
};

static struct item *before;
static int seen;

static void in_order(void *ctx)
{
    struct item *i = ctx;
    assert_int_equal(now(i->e), i->at);
    if (before && before->at == i->at)
        assert_true(before->rank < i->rank || (before->rank == i->rank && before->number < i->number));
    else if (before)
        assert_true(before->at < i->at);
    before = i;
    seen++;
}

static void events_come_by_time_then_rank_then_as_asked(void **state)
{
    enum { N = 20000 };
    struct apc_executive *e = make();
    struct item *items = calloc(N, sizeof *items);
    struct apc_random r;
    (void)state;
    apc_random_init(&r, 1, "events");
    before = NULL;
    seen = 0;
    for (int i = 0; i < N; i++) {
        items[i] = (struct item){e, now(e) + (apc_ns)(apc_random_next(&r) % 1000),
                                 (int)(apc_random_next(&r) % 4), i};
        assert_int_equal(apc_virtual_at(e, items[i].at, items[i].rank, in_order, &items[i]), 0);
    }
    assert_int_equal(apc_virtual_run(e, now(e) + 1000), N);
    assert_int_equal(seen, N);
    free(items);
    apc_executive_destroy(e);
}

static char low_name[] = "low", high_name[] = "high";

static void say(void *ctx)
{
    note("%s ", (const char *)ctx);
}

static void ask_for_more(void *ctx)
{
    struct apc_executive *e = ctx;
    note("first ");
    assert_int_equal(apc_virtual_at(e, now(e), 1, say, low_name), 0);
    assert_int_equal(apc_virtual_at(e, now(e) - 1, 1, say, low_name), APC_EINVAL);
    assert_int_equal(apc_virtual_run(e, now(e) + S), APC_EINVAL);
}

static void an_event_of_now_comes_before_those_of_higher_rank(void **state)
{
    struct apc_executive *e = make();
    (void)state;
    apc_virtual_at(e, now(e) + S, 3, say, high_name);
    apc_virtual_at(e, now(e) + S, 2, ask_for_more, e);
    apc_virtual_run(e, now(e) + S);
    assert_string_equal(trace, "first low high ");
    apc_executive_destroy(e);
}

/* ---- Execution times ---- */

/* Promise(simulation/tasks): Execution, jitter, overrun and clock of the tasks are as the file says. */
static void what_a_callback_made_takes_effect_at_its_end(void **state)
{
    struct apc_executive *e = make();
    struct unit slow = {0}, other = {0};
    struct apc_timing timing = {.size = sizeof timing};
    (void)state;
    begin(&slow, e, "a", (struct apc_task_options){.period = 2 * S},
          &(struct apc_virtual_model){.execution = constant(1.5), .finish = on_finish});
    begin(&other, e, "b", (struct apc_task_options){.period = 1 * S},
          &(struct apc_virtual_model){.finish = on_finish, .rank = 1});
    apc_virtual_run(e, now(e) + 3 * S + 600 * MS);
    assert_string_equal(trace, "a0@0 b0@0 /b@0 b1@1 /b@1 /a@1.5 a1@2 b2@2 /b@2 b3@3 /b@3 /a@3.5 ");
    apc_task_timing(slow.task, &timing);
    assert_int_equal(timing.run.min, 1500 * MS);
    assert_int_equal(timing.run.max, 1500 * MS);
    assert_int_equal(timing.lateness.max, 0);
    assert_int_equal(timing.missed, 0);
    timing = (struct apc_timing){.size = offsetof(struct apc_timing, missed), .missed = 7}; /* an older one */
    apc_task_timing(slow.task, &timing);
    assert_true(timing.ticks > 0);
    assert_int_equal(timing.missed, 7);
    apc_task_destroy(slow.task);
    apc_task_destroy(other.task);
    apc_executive_destroy(e);
}

/* Promise(simulation/tasks) */
static void an_overrun_follows_its_policy(void **state)
{
    static const struct {
        enum apc_overrun policy;
        const char *trace;
        uint64_t ticks, missed;
        int result;
    } cases[] = {
        {APC_OVERRUN_SKIP, "a0@0 /a@2.5 a3@3 (2 missed) /a@5.5 a6@6 (2 missed) ", 3, 6, APC_ETIMEDOUT},
        {APC_OVERRUN_BURST, "a0@0 /a@2.5 a1@2.5 /a@5 a2@5 /a@7.5 a3@7.5 ", 4, 0, APC_ETIMEDOUT},
        {APC_OVERRUN_STOP, "a0@0 /a@2.5 ", 1, 2, APC_EOVERRUN},
    };
    (void)state;
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        struct apc_executive *e = make();
        struct unit u = {0};
        struct apc_timing timing = {.size = sizeof timing};
        begin(&u, e, "a", (struct apc_task_options){.period = 1 * S, .overrun = cases[i].policy},
              &(struct apc_virtual_model){.execution = constant(2.5), .finish = on_finish});
        apc_virtual_run(e, now(e) + 8 * S);
        assert_string_equal(trace, cases[i].trace);
        apc_task_timing(u.task, &timing);
        assert_int_equal(timing.ticks, cases[i].ticks);
        assert_int_equal(timing.missed, cases[i].missed);
        int result = 0, waited = apc_task_wait(u.task, 0, &result);
        assert_int_equal(waited ? waited : result, cases[i].result);
        apc_task_destroy(u.task);
        assert_int_equal(apc_executive_destroy(e), 0);
    }
}

static void an_end_at_the_next_instant_comes_before_its_tick(void **state)
{
    struct apc_executive *e = make();
    struct unit u = {0};
    (void)state;
    begin(&u, e, "a", (struct apc_task_options){.period = 1 * S},
          &(struct apc_virtual_model){.execution = constant(1), .finish = on_finish});
    apc_virtual_run(e, now(e) + 2 * S);
    assert_string_equal(trace, "a0@0 /a@1 a1@1 /a@2 a2@2 ");
    assert_int_equal(apc_task_missed(u.task), 0);
    apc_task_destroy(u.task);
    apc_executive_destroy(e);
}

static void a_task_that_returns_nonzero_has_ended(void **state)
{
    struct apc_executive *e = make();
    struct unit u = {.end_at = 2};
    (void)state;
    begin(&u, e, "a", (struct apc_task_options){.period = 1 * S}, NULL);
    apc_virtual_run(e, now(e) + 9 * S);
    assert_string_equal(trace, "a0@0 a1@1 a2@2 ");
    int result = 0;
    assert_int_equal(apc_task_wait(u.task, 0, &result), 0);
    assert_int_equal(result, 7);
    apc_task_destroy(u.task);
    apc_executive_destroy(e);
}

/* ---- Jitter ---- */

/* Promise(simulation/tasks) */
static void jitter_delays_ticks_and_moves_no_grid(void **state)
{
    struct apc_executive *e = make();
    struct unit u = {0};
    struct apc_timing timing = {.size = sizeof timing};
    (void)state;
    begin(&u, e, "a", (struct apc_task_options){.period = 100 * MS},
          &(struct apc_virtual_model){.jitter = {APC_UNIFORM, 0.001, 0.003, NULL, 0}, .seed = 4});
    apc_virtual_run(e, now(e) + 1000 * S + 10 * MS);
    apc_task_timing(u.task, &timing);
    assert_int_equal(timing.ticks, 10001);
    assert_int_equal(timing.missed, 0);
    assert_in_range(timing.lateness.min, MS, MS + 10000);
    assert_in_range(timing.lateness.max, 3 * MS - 10000, 3 * MS);
    assert_near(timing.lateness.mean, 2e6, 2e4);
    assert_near(timing.jitter.mean, 0.0, 1e3);
    assert_near(timing.jitter.sd, 2e6 / sqrt(12) * sqrt(2), 2e4);
    apc_task_destroy(u.task);
    apc_executive_destroy(e);
}

static void jitter_beyond_the_period_misses_ticks(void **state)
{
    struct apc_executive *e = make();
    struct unit u = {0};
    (void)state;
    begin(&u, e, "a", (struct apc_task_options){.period = 1 * S},
          &(struct apc_virtual_model){.jitter = constant(2.5)});
    apc_virtual_run(e, now(e) + 6 * S);
    assert_string_equal(trace, "a2@2.5 (2 missed) a5@5.5 (2 missed) ");
    assert_int_equal(apc_task_missed(u.task), 4);
    apc_task_destroy(u.task);
    apc_executive_destroy(e);
}

/* The trace of task a, with a task b beside it that behaves as told. */
static void run_beside(struct apc_distribution other, char out[TRACE])
{
    struct apc_executive *e = make();
    struct unit a = {0}, b = {0};
    const struct apc_virtual_model random = {
        .jitter = {APC_EXPONENTIAL, 0.01, 0, NULL, 0}, .execution = {APC_GAMMA, 2, 0.02, NULL, 0}, .seed = 9};
    const struct apc_virtual_model model = {.jitter = other, .execution = other, .seed = 9};
    size_t n = 0;

    begin(&a, e, "a", (struct apc_task_options){.period = 100 * MS}, &random);
    begin(&b, e, "b", (struct apc_task_options){.period = 70 * MS}, &model);
    apc_virtual_run(e, now(e) + 2 * S);
    out[0] = '\0';
    char *rest = NULL;
    for (const char *word = strtok_r(trace, " ", &rest); word; word = strtok_r(NULL, " ", &rest))
        if (word[0] == 'a')
            n += (size_t)snprintf(out + n, TRACE - n, "%s ", word);
    apc_task_destroy(a.task);
    apc_task_destroy(b.task);
    apc_executive_destroy(e);
}

/* Promise(simulation/seed-run-last) */
static void a_seed_repeats_and_models_do_not_disturb_each_other(void **state)
{
    static char first[TRACE], again[TRACE], beside[TRACE];
    (void)state;
    run_beside(constant(0), first);
    run_beside(constant(0), again);
    run_beside((struct apc_distribution){APC_NORMAL, 0.01, 0.02, NULL, 0}, beside);
    assert_true(strlen(first) > 100);
    assert_string_equal(first, again);
    assert_string_equal(first, beside);
}

/* ---- The clock ---- */

/* Promise(simulation/tasks) */
static void the_wall_clock_steps_and_drifts_and_ticks_stay(void **state)
{
    struct apc_executive *e = make();
    const struct apc_clock *clock = apc_executive_clock(e);
    struct unit u = {0};
    (void)state;
    begin(&u, e, "a", (struct apc_task_options){.period = 1 * S, .start = BEGIN, .aligned = true}, NULL);
    assert_int_equal(apc_clock_utc(clock), BEGIN);
    apc_virtual_run(e, now(e) + S + 500 * MS);
    assert_int_equal(apc_clock_utc(clock), BEGIN + S + 500 * MS);
    assert_int_equal(apc_virtual_set_clock(e, -3600 * S, 0), 0);
    assert_int_equal(apc_clock_utc(clock), BEGIN + S + 500 * MS - 3600 * S);
    assert_int_equal(apc_virtual_set_clock(e, 3600 * S, 1e-3), 0);
    apc_virtual_run(e, now(e) + 2 * S);
    assert_int_equal(apc_clock_utc(clock), BEGIN + 3 * S + 502 * MS);
    assert_int_equal(apc_virtual_set_clock(e, 0, 0), 0);
    apc_virtual_run(e, now(e) + S);
    assert_int_equal(apc_clock_utc(clock), BEGIN + 4 * S + 502 * MS);
    assert_string_equal(trace, "a0@0 a1@1 a2@2 a3@3 a4@4 ");
    apc_task_destroy(u.task);
    apc_executive_destroy(e);
}

/* ---- Running and stopping ---- */

static void stop_running(void *ctx)
{
    apc_virtual_stop(ctx);
}

static void a_run_that_was_stopped_goes_on_where_it_was(void **state)
{
    struct apc_executive *e = make();
    struct unit u = {0};
    apc_ns zero = now(e);
    (void)state;
    begin(&u, e, "a", (struct apc_task_options){.period = 1 * S}, NULL);
    apc_virtual_at(e, zero + 1500 * MS, 0, stop_running, e);
    assert_int_equal(apc_virtual_run(e, zero + 3 * S), 3);
    assert_int_equal(now(e), zero + 1500 * MS);
    assert_int_equal(apc_virtual_run(e, zero + S), APC_EINVAL);
    assert_int_equal(apc_virtual_run(e, zero + 3 * S), 2);
    assert_int_equal(now(e), zero + 3 * S);
    assert_string_equal(trace, "a0@0 a1@1 a2@2 a3@3 ");
    apc_task_destroy(u.task);
    apc_executive_destroy(e);
}

static void own_event(void *ctx)
{
    (void)ctx;
    note("own ");
}

static void stop_task(void *ctx)
{
    assert_int_equal(apc_task_stop(((struct unit *)ctx)->task), 0);
}

static void a_stopped_task_ticks_no_more_and_the_others_do(void **state)
{
    struct apc_executive *e = make();
    struct unit a = {0}, b = {0};
    (void)state;
    begin(&a, e, "a", (struct apc_task_options){.period = 1 * S},
          &(struct apc_virtual_model){.execution = constant(0.8), .finish = on_finish});
    begin(&b, e, "b", (struct apc_task_options){.period = 1 * S}, NULL);
    apc_virtual_at(e, now(e) + 1500 * MS, 0, stop_task, &a);
    apc_virtual_at(e, now(e) + 1800 * MS, 0, own_event, a.task); /* not the task's, although it names it */
    apc_virtual_run(e, now(e) + 2 * S);
    assert_string_equal(trace, "a0@0 b0@0 /a@0.8 a1@1 b1@1 own b2@2 ");
    assert_int_equal(apc_executive_destroy(e), APC_ESTATE);
    apc_task_destroy(a.task);
    apc_task_destroy(b.task);
    assert_int_equal(apc_executive_destroy(e), 0);
}

static void what_makes_no_sense_is_refused(void **state)
{
    struct apc_executive *e = make(), *real = NULL;
    const struct apc_executive_options with_clock = {.size = sizeof with_clock, .clock = apc_clock_system()};
    const struct apc_task_options options = {.size = sizeof options, .period = S};
    struct apc_virtual_model model = {.size = sizeof model};
    struct apc_task *task = NULL, *other = NULL;
    struct apc_error why = {""};
    struct unit u = {.e = e, .name = "a"};
    (void)state;
    assert_int_equal(apc_executive_create(&real, "virtual", &with_clock, &why), APC_EINVAL);
    assert_non_null(strstr(why.text, "clock"));
    assert_int_equal(apc_executive_create(&real, "deadline", NULL, NULL), 0);
    assert_int_equal(apc_virtual_run(real, INT64_MAX), APC_EINVAL);
    assert_int_equal(apc_virtual_stop(NULL), APC_EINVAL);
    assert_int_equal(apc_virtual_at(real, INT64_MAX, 0, say, NULL), APC_EINVAL);
    assert_int_equal(apc_virtual_at(e, INT64_MAX, 0, NULL, NULL), APC_EINVAL);
    assert_int_equal(apc_virtual_set_clock(real, 0, 0), APC_EINVAL);
    assert_int_equal(apc_virtual_set_clock(e, 0, 1), APC_EINVAL);
    assert_int_equal(apc_virtual_set_clock(e, 0, (double)NAN), APC_EINVAL);
    assert_int_equal(apc_task_create(real, &options, on_tick, &u, &other, NULL), 0);
    assert_int_equal(apc_virtual_set_model(other, &model, &why), APC_EINVAL);
    assert_int_equal(apc_task_create(e, &options, on_tick, &u, &task, NULL), 0);
    assert_int_equal(apc_task_start(task, NULL), 0);
    assert_int_equal(apc_virtual_set_model(task, &model, &why), APC_ESTATE);
    apc_task_destroy(task);
    apc_task_destroy(other);
    apc_executive_destroy(real);
    apc_executive_destroy(e);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(coinciding_ticks_come_by_rank),
        cmocka_unit_test(ticks_lie_on_the_grid_of_the_wall_clock),
        cmocka_unit_test(events_come_by_time_then_rank_then_as_asked),
        cmocka_unit_test(an_event_of_now_comes_before_those_of_higher_rank),
        cmocka_unit_test(what_a_callback_made_takes_effect_at_its_end),
        cmocka_unit_test(an_overrun_follows_its_policy),
        cmocka_unit_test(an_end_at_the_next_instant_comes_before_its_tick),
        cmocka_unit_test(a_task_that_returns_nonzero_has_ended),
        cmocka_unit_test(jitter_delays_ticks_and_moves_no_grid),
        cmocka_unit_test(jitter_beyond_the_period_misses_ticks),
        cmocka_unit_test(a_seed_repeats_and_models_do_not_disturb_each_other),
        cmocka_unit_test(the_wall_clock_steps_and_drifts_and_ticks_stay),
        cmocka_unit_test(a_run_that_was_stopped_goes_on_where_it_was),
        cmocka_unit_test(a_stopped_task_ticks_no_more_and_the_others_do),
        cmocka_unit_test(what_makes_no_sense_is_refused),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}

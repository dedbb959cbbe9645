/* SPDX-License-Identifier: BSD-3-Clause */
/* The scheduler: which step of which setpoint is due, and that none is written to one that is the operator's. */
#include <string.h>

#include "check.h"

#include "apcmodules.h"

#define S      APC_NS_PER_S
#define T0     (INT64_C(1700000000) * S)
#define PERIOD (20 * S)

enum { R1 = 4, R2 = 7, OWNER1 = 65603, OWNER2 = 65651 };

static const struct apc_scheduler_setpoint setpoints[] = {{"r1", R1, OWNER1}, {"r2", R2, OWNER2}};
static const double sequence[] = {1, 2, 3, 4, 5, 6};
static const struct apc_scheduler_options options = {
    .size = sizeof(options), .nz = 2, .z = setpoints, .steps = 3, .sequence = sequence, .period = PERIOD};

/* What the store has: setpoints and switches, as in. */
struct world {
    struct apc_scheduler *scheduler;
    struct apc_sample there[4];
    struct apc_notice notice;
    apc_ns now;
};

static void begin(struct world *w, const struct apc_scheduler_options *o)
{
    *w = (struct world){.now = T0};
    assert_int_equal(apc_scheduler_create(&w->scheduler, o, NULL), 0);
    const struct apc_rows *in = apc_scheduler_in(w->scheduler);
    assert_int_equal(in->n_samples, 4);
    memcpy(w->there, in->sample, sizeof(w->there));
}

static void see(struct world *w)
{
    memcpy(apc_scheduler_in(w->scheduler)->sample, w->there, sizeof(w->there));
}

static apc_ns age; /* of the step */

static int compute(struct world *w, uint64_t step)
{
    const struct apc_now now = {.mono = w->now - T0, .utc = w->now};
    return apc_scheduler_compute(w->scheduler, now, step, age, &w->notice);
}

/* Append what it made, where nobody was faster. */
static bool store(struct world *w)
{
    struct apc_rows *out = apc_scheduler_out(w->scheduler);
    for (size_t i = 0; i < out->n_samples; i++)
        for (size_t k = 0; k < 2; k++)
            if (w->there[k].id == out->sample[i].id) {
                const bool newest = out->sample[i].seq == w->there[k].seq;
                out->sample[i].seq = newest ? w->there[k].seq + 1 : 0;
                w->there[k] = newest ? out->sample[i] : w->there[k];
            }
    return apc_scheduler_update(w->scheduler, true);
}

static int step(struct world *w, uint64_t index)
{
    see(w);
    const int n = compute(w, index);
    assert_true(store(w));
    return n;
}

static void operate(struct world *w, size_t k, double value)
{
    w->there[k].seq++;
    w->there[k].value = value;
    w->there[k].status = APC_GOOD;
    w->there[k].time = w->now;
}

static void each_step_is_written_once(void **state)
{
    struct world w;
    (void)state;
    begin(&w, &options);
    for (uint64_t i = 0; i < 3; i++) {
        assert_int_equal(step(&w, i), 2);
        assert_near(w.there[0].value, 1.0 + 2.0 * (double)i, 0.0);
        assert_near(w.there[1].value, 2.0 + 2.0 * (double)i, 0.0);
        assert_int_equal(step(&w, i), 0);
    }
    assert_int_equal(w.there[1].table, APC_SETPOINT);
    assert_int_equal(w.there[1].id, R2);
    assert_int_equal(w.there[1].seq, 3);
    assert_int_equal(w.there[1].time, T0);
    assert_int_equal(w.there[1].status, APC_GOOD);
    assert_int_equal(w.notice.kind, APC_NOTICE_NONE);
    apc_scheduler_destroy(w.scheduler);
}

/*
 * Promise(experiment/schedule-keeps-last): The schedule keeps its last step or begins again; a daemon that
 *   is restarted falls into its step.
 */
static void the_schedule_keeps_its_last_step_or_begins_again(void **state)
{
    struct apc_scheduler_options o = options;
    struct world w;
    (void)state;
    begin(&w, &o);
    step(&w, UINT64_MAX);
    assert_near(w.there[0].value, 5.0, 0.0);
    apc_scheduler_destroy(w.scheduler);
    o.repeat = true;
    begin(&w, &o);
    step(&w, 4);
    assert_near(w.there[0].value, 3.0, 0.0);
    apc_scheduler_destroy(w.scheduler);
}

/* Promise(modes/scheduled-setpoint) */
static void one_that_is_local_is_left_alone_and_given_back_gets_the_step_that_is_due(void **state)
{
    struct world w;
    (void)state;
    begin(&w, &options);
    step(&w, 0);
    operate(&w, 0, 9);
    operate(&w, 2, 0);
    assert_int_equal(step(&w, 0), 0);
    assert_int_equal(w.notice.kind, APC_NOTICE_MODE);
    assert_string_equal(w.notice.text, "r1 is Local: its steps are not written");
    assert_int_equal(step(&w, 1), 1); /* the other one's */
    assert_int_equal(w.notice.kind, APC_NOTICE_NONE);
    assert_near(w.there[0].value, 9, 0);
    assert_near(w.there[1].value, 4, 0);
    operate(&w, 3, 0);
    operate(&w, 2, 1);
    assert_int_equal(step(&w, 1), 1);
    assert_string_equal(w.notice.text,
                        "r1 is Remote: its steps are written again; r2 is Local: its steps are not written");
    assert_near(w.there[0].value, 3, 0);
    apc_scheduler_destroy(w.scheduler);
}

/* Taken and given back between two looks: its setpoint is the operator's, though the switch says Remote. */
static void what_was_taken_and_given_back_unseen_is_written_again(void **state)
{
    struct world w;
    (void)state;
    begin(&w, &options);
    step(&w, 0);
    operate(&w, 0, 9);
    operate(&w, 2, 1);
    assert_int_equal(step(&w, 0), 1);
    assert_near(w.there[0].value, 1, 0);
    apc_scheduler_destroy(w.scheduler);
}

static void a_step_that_was_left_out_is_due_still(void **state)
{
    struct world w;
    (void)state;
    begin(&w, &options);
    see(&w);
    assert_int_equal(compute(&w, 0), 2);
    operate(&w, 0, 9);
    assert_false(store(&w));
    assert_near(w.there[0].value, 9, 0);
    see(&w);
    assert_int_equal(compute(&w, 0), 1);
    assert_false(apc_scheduler_update(w.scheduler, false)); /* the store was away */
    assert_int_equal(step(&w, 0), 1);
    assert_near(w.there[0].value, 1, 0);
    apc_scheduler_destroy(w.scheduler);
}

/* Plan @p i of out is that of setpoint @p i. */
static void assert_plan(struct world *w, size_t i, const double *pairs, uint32_t n)
{
    const struct apc_rows *out = apc_scheduler_out(w->scheduler);
    const struct apc_vector *v = &out->vector[i];
    assert_int_equal(out->n_vectors, out->n_samples);
    assert_true(v->table == APC_PLAN && v->id == setpoints[i].id && v->status == APC_GOOD);
    assert_int_equal(v->seq, out->sample[i].seq + 1);
    assert_int_equal(v->time, out->sample[i].time);
    assert_int_equal(v->n, n);
    for (uint32_t k = 0; k < n; k++)
        assert_near(v->value[k], pairs[k], 1e-9);
}

/* Promise(modes/law-looks-ahead) */
static void a_step_goes_with_those_to_come_that_change_it(void **state)
{
    static const double whole[] = {1, 2, 1, 4, 5, 6};
    struct apc_scheduler_options o = options;
    struct world w;
    (void)state;
    o.sequence = whole;
    begin(&w, &o);
    see(&w);
    age = 3 * S;
    assert_int_equal(compute(&w, 0), 2);
    assert_plan(&w, 0, (const double[]){0, 1, 37, 5}, 4);
    assert_plan(&w, 1, (const double[]){0, 2, 17, 4, 37, 6}, 6);
    store(&w);
    age = 0;
    see(&w);
    compute(&w, 2);
    assert_plan(&w, 0, (const double[]){0, 5}, 2);
    apc_scheduler_destroy(w.scheduler);
    o.repeat = true; /* one round */
    begin(&w, &o);
    see(&w);
    compute(&w, 1);
    assert_plan(&w, 0, (const double[]){0, 1, 20, 5, 40, 1}, 6);
    apc_scheduler_destroy(w.scheduler);
}

static void a_long_sequence_is_told_as_far_as_there_is_room(void **state)
{
    double many[1000];
    struct apc_scheduler_options o = options;
    struct world w;
    (void)state;
    for (size_t i = 0; i < 1000; i++)
        many[i] = (double)i;
    o.sequence = many;
    o.steps = 500;
    begin(&w, &o);
    see(&w);
    compute(&w, 0);
    const struct apc_vector *v = apc_scheduler_out(w.scheduler)->vector;
    assert_int_equal(v->n, 2 * APC_PLAN_PAIRS);
    assert_near(v->value[v->n - 2], 20.0 * (APC_PLAN_PAIRS - 1), 1e-9);
    assert_near(v->value[v->n - 1], 2.0 * (APC_PLAN_PAIRS - 1), 0);
    apc_scheduler_destroy(w.scheduler);
}

static int restart(struct world *w, uint64_t index, apc_ns since)
{
    apc_scheduler_destroy(w->scheduler);
    assert_int_equal(apc_scheduler_create(&w->scheduler, &options, NULL), 0);
    see(w);
    apc_scheduler_resume(w->scheduler, index, since);
    return compute(w, index);
}

/* Promise(modes/scheduled-setpoint) */
static void one_that_is_restarted_writes_what_is_not_there(void **state)
{
    struct world w;
    (void)state;
    begin(&w, &options);
    step(&w, 0);
    assert_int_equal(restart(&w, 0, T0), 0);
    w.now += PERIOD;
    assert_int_equal(restart(&w, 1, w.now), 2); /* those are of the step before */
    store(&w);
    w.now += S;
    operate(&w, 0, 9); /* by somebody who knows no switch: until the next step */
    assert_int_equal(restart(&w, 1, T0 + PERIOD), 0);
    operate(&w, 2, 0);
    assert_int_equal(restart(&w, 1, T0 + PERIOD), 0);
    assert_int_equal(restart(&w, 2, w.now + PERIOD), 1); /* of r2 alone */
    store(&w);
    w.now += S;
    operate(&w, 0, 9); /* given back while nobody was there, with the setpoint as it stood */
    operate(&w, 2, 1);
    assert_int_equal(restart(&w, 1, T0 + PERIOD), 1);
    store(&w);
    assert_near(w.there[0].value, 3, 0);
    /* Written in the instant in which it was given back, or before that: written again. */
    assert_int_equal(restart(&w, 1, T0 + PERIOD), 1);
    store(&w);
    w.now += S;
    operate(&w, 0, 3); /* long after it was given back */
    assert_int_equal(restart(&w, 1, T0 + PERIOD), 0);
    apc_scheduler_destroy(w.scheduler);
}

static void options_that_say_too_little_are_refused(void **state)
{
    const struct apc_scheduler_options bad[] = {
        {.size = sizeof(*bad), .z = setpoints, .steps = 3, .sequence = sequence, .period = PERIOD},
        {.size = sizeof(*bad), .nz = 2, .steps = 3, .sequence = sequence, .period = PERIOD},
        {.size = sizeof(*bad), .nz = 2, .z = setpoints, .sequence = sequence, .period = PERIOD},
        {.size = sizeof(*bad), .nz = 2, .z = setpoints, .steps = 3, .period = PERIOD},
        {.size = sizeof(*bad), .nz = 2, .z = setpoints, .steps = 3, .sequence = sequence},
        {.nz = 2, .z = setpoints, .steps = 3, .sequence = sequence, .period = PERIOD}};
    struct apc_scheduler *s = NULL;
    struct apc_error why = {""};
    (void)state;
    for (size_t i = 0; i < sizeof(bad) / sizeof(*bad); i++) {
        assert_int_equal(apc_scheduler_create(&s, &bad[i], &why), APC_EINVAL);
        assert_null(s);
        assert_true(why.text[0] != '\0');
    }
    apc_scheduler_destroy(NULL);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(each_step_is_written_once),
        cmocka_unit_test(the_schedule_keeps_its_last_step_or_begins_again),
        cmocka_unit_test(one_that_is_local_is_left_alone_and_given_back_gets_the_step_that_is_due),
        cmocka_unit_test(what_was_taken_and_given_back_unseen_is_written_again),
        cmocka_unit_test(a_step_that_was_left_out_is_due_still),
        cmocka_unit_test(a_step_goes_with_those_to_come_that_change_it),
        cmocka_unit_test(a_long_sequence_is_told_as_far_as_there_is_room),
        cmocka_unit_test(one_that_is_restarted_writes_what_is_not_there),
        cmocka_unit_test(options_that_say_too_little_are_refused),
    };

    return cmocka_run_group_tests(tests, NULL, NULL);
}

/* SPDX-License-Identifier: BSD-3-Clause */
/*
 * Whatever the shared data holds, no output of the controller is ever anything but a finite number within
 * its limits, and the rows it writes are such as the store takes. Set APC_TEST_SEED to see a failure again.
 */
#include "check.h"

#include "base/base_internal.h"
#include "modules/controller.h"
#include "xorshift.h"

#include <stdlib.h>

#define S     APC_NS_PER_S
#define T0    (INT64_C(1700000000) * S)
#define LOW   (-1.5)
#define HIGH  2.5
#define TICKS 200000

static uint64_t seed;

static uint32_t chance(uint32_t n)
{
    return (uint32_t)(xorshift(&seed) >> 33) % n;
}

static double any_value(void)
{
    static const double odd[] = {0.0, -0.0, 1e-320, 1e299, -1e299, 1e301, 1.7e308, -1.7e308, 1e9, -1e9};

    switch (chance(8)) {
    case 0:
        return odd[chance(sizeof(odd) / sizeof(odd[0]))];
    case 1:
        return (double)NAN;
    case 2:
        return chance(2) ? (double)INFINITY : -(double)INFINITY;
    default:
        return ((double)chance(2000) - 1000.0) / 100.0;
    }
}

static apc_status any_status(void)
{
    static const apc_status status[] = {APC_GOOD, APC_UNCERTAIN, APC_BAD_NO_DATA, 0xC0000000u, 0xFFFFFFFFu};

    return chance(3) ? APC_GOOD : status[chance(sizeof(status) / sizeof(status[0]))];
}

static void spoil(struct apc_sample *s, struct apc_now now)
{
    s->seq = chance(20) ? s->seq + chance(2) : chance(3);
    s->time = chance(30) ? now.utc : (apc_ns)((uint64_t)chance(1u << 31) << 33);
    s->status = any_status();
    s->value = s->table == APC_OPMODE && chance(10) ? (double)chance(2) : any_value();
}

static void calm(struct apc_sample *s, struct apc_now now)
{
    s->seq++;
    s->time = now.utc;
    s->status = APC_GOOD;
    s->value = s->table == APC_OPMODE ? 1.0 : 1.0 + (double)chance(100) / 100.0;
}

/* How many outputs were computed, held, at the fault value, how many runs went on: all must have been tried. */
struct tally {
    int64_t seq[2];
    int computed, held, fault, resumed;
};

static void check(const struct apc_controller *c, const struct apc_rows *out, struct tally *t)
{
    for (size_t i = 0; i < out->n_samples; i++) {
        const struct apc_sample *s = &out->sample[i];

        if (!(fabs(s->value) < APC_VALUE_MAX))
            fail_msg("table %d id %d: %g", (int)s->table, s->id, s->value);
        assert_in_range(s->seq, 1, APC_SEQ_MAX);
        if (s->table != APC_ACTUATOR)
            continue;
        if (!(s->value >= LOW && s->value <= HIGH))
            fail_msg("actuator %d: %g", s->id, s->value);
        assert_true(s->seq > t->seq[s->id - 1]);
        t->seq[s->id - 1] = s->seq;
        t->computed += c->state[s->id - 1].loop.state == APC_LOOP_AUTO;
        t->held += s->status == APC_UNCERTAIN_LAST_USABLE;
        t->fault += s->status == APC_UNCERTAIN_SUBSTITUTE;
    }
    for (size_t i = 0; i < out->n_vectors; i++)
        assert_true(apc_values_ok(out->vector[i].value, out->vector[i].n));
}

static struct apc_controller *make(void)
{
    static const struct apc_controller_loop loop[] = {
        {.id = 1, .mode = 1, .low = LOW, .high = HIGH, .fault = -1.0},
        {.id = 2, .mode = 2, .low = LOW, .high = HIGH, .fault = 1.0, .rate = 0.5}};
    const struct apc_controller_options o = {.size = sizeof(o),
                                             .law = &apc_law_pi,
                                             .dim = {2, 2, 2, 0},
                                             .period = S,
                                             .horizon = 3 * S,
                                             .loop = loop};
    struct apc_controller *c = NULL;

    assert_int_equal(apc_controller_create(&c, &o, NULL), 0);
    return c;
}

/* Rows as the store has them: seqs only ever rise, and there are none of an output above what was put. */
static void run(struct apc_controller *c, struct apc_now *now, int ticks, struct tally *t)
{
    struct apc_rows *in = apc_controller_in(c);

    for (int k = 0; k < ticks; k++) {
        bool quiet = k / 50 % 3 == 0; /* let it control for a while, so that there is something to spoil */

        now->mono += S;
        now->utc = T0 + now->mono + (chance(50) ? 0 : (apc_ns)chance(7200) * S);
        for (size_t i = 0; i < in->n_samples; i++) {
            if (quiet)
                calm(&in->sample[i], *now);
            else if (chance(4) == 0)
                spoil(&in->sample[i], *now);
        }
        apc_controller_compute(c, *now, (uint64_t)k, chance(20), NULL);
        check(c, apc_controller_out(c), t);
        apc_controller_update(c, (int)chance(3) - 1);
    }
}

/*
 * Promise(run/nothing-not-finite): Nothing that is not finite or is outside its limits reaches the plant.
 */
static void no_input_makes_an_output_that_is_not_finite_or_outside_its_limits(void **state)
{
    struct apc_controller *c = make();
    struct apc_now now = {.mono = S, .utc = T0};
    struct tally t = {0};

    (void)state;
    run(c, &now, TICKS, &t);
    print_message("%d computed, %d held, %d at the fault value\n", t.computed, t.held, t.fault);
    assert_true(t.computed > 1000 && t.held > 1000 && t.fault > 1000);
    apc_controller_destroy(c);
}

/* A number of a tick row that nobody has checked; @p wild: maybe one that is none. */
static double any_field(double value, bool wild)
{
    static const double odd[] = {-1.0, 0.5, 255.0, 4294967296.0, 9007199254740992.0, -9007199254740993.0};

    switch (chance(4)) {
    case 0:
        return odd[chance(sizeof(odd) / sizeof(odd[0]))];
    case 1:
        return wild ? any_value() : (double)chance(100) - 50.0;
    default:
        return value;
    }
}

/* What a former run left, spoilt: another length, NaN, states that are none, seqs beyond all, from tomorrow. */
static void no_former_row_makes_an_output_that_is_not_finite_or_outside_its_limits(void **state)
{
    struct apc_now now = {.mono = S, .utc = T0};
    struct tally all = {0};

    (void)state;
    for (int k = 0; k < 2000; k++) {
        struct apc_controller *before = make(), *c = make();
        struct apc_vector *row = apc_controller_former(c)->vector;
        struct tally t = {0};
        bool wild = chance(3) == 0;

        run(before, &now, 3, &t);
        *row = (struct apc_vector){.table = row->table,
                                   .id = row->id,
                                   .seq = before->out_row->seq,
                                   .time = now.utc + ((apc_ns)chance(5) - 2) * 86400 * S / 2,
                                   .n = chance(4) ? row->room : chance(2 * row->room),
                                   .room = row->room,
                                   .value = row->value};
        for (uint32_t i = 0; i < row->room; i++)
            row->value[i] = i < 2 && chance(4) ? before->row[i] : any_field(before->row[i], wild);
        for (size_t i = 0; i < apc_controller_former(c)->n_samples; i++)
            if (chance(2))
                spoil(&apc_controller_former(c)->sample[i], now);
        all.resumed += apc_controller_resume(c, chance(2) ? T0 : 0);
        t = (struct tally){0};
        run(c, &now, 20, &t);
        all.computed += t.computed;
        apc_controller_destroy(before);
        apc_controller_destroy(c);
    }
    print_message("%d went on, %d outputs computed\n", all.resumed, all.computed);
    assert_true(all.resumed > 100 && all.computed > 1000);
}

static int set_up(void **state)
{
    const char *given = getenv("APC_TEST_SEED");

    (void)state;
    seed = given ? strtoull(given, NULL, 10) : 20260131;
    print_message("APC_TEST_SEED=%llu\n", (unsigned long long)seed);
    return 0;
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test_setup(no_input_makes_an_output_that_is_not_finite_or_outside_its_limits, set_up),
        cmocka_unit_test_setup(no_former_row_makes_an_output_that_is_not_finite_or_outside_its_limits,
                               set_up),
    };

    return cmocka_run_group_tests(tests, NULL, NULL);
}

/* SPDX-License-Identifier: BSD-3-Clause */
/*
 * Whatever the shared data holds, no output of the controller is ever anything but a finite number within
 * its limits, and the rows it writes are such as the store takes. Set APC_TEST_SEED to see a failure again.
 */
#include "check.h"

#include "apcmodules.h"

#include <stdlib.h>

#define S     APC_NS_PER_S
#define T0    (INT64_C(1700000000) * S)
#define LOW   (-1.5)
#define HIGH  2.5
#define TICKS 200000

enum { IN = 2 + 2 + 1 + 10 + 2 + 1, OUT = 2 + 12 + 1 };

static uint64_t seed;

static uint32_t chance(uint32_t n)
{
    seed ^= seed << 13;
    seed ^= seed >> 7;
    seed ^= seed << 17;
    return (uint32_t)(seed >> 33) % n;
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

/* How many outputs were computed, held, at the fault value: all three must have been tried. */
struct tally {
    int64_t seq[2];
    int computed, held, fault;
};

static void check(const struct apc_sample *out, int n, struct tally *t)
{
    assert_in_range(n, 0, OUT);
    for (int i = 0; i < n; i++) {
        if (!(fabs(out[i].value) < APC_VALUE_MAX))
            fail_msg("table %d id %d: %g", (int)out[i].table, out[i].id, out[i].value);
        if (out[i].table != APC_ACTUATOR)
            continue;
        if (!(out[i].value >= LOW && out[i].value <= HIGH))
            fail_msg("actuator %d: %g", out[i].id, out[i].value);
        assert_true(out[i].seq > t->seq[out[i].id - 1]);
        t->seq[out[i].id - 1] = out[i].seq;
        t->computed += out[i].sensor_seq && out[i].status == APC_GOOD;
        t->held += out[i].status == APC_UNCERTAIN_LAST_USABLE;
        t->fault += out[i].status == APC_UNCERTAIN_SUBSTITUTE;
    }
}

static void no_input_makes_an_output_that_is_not_finite_or_outside_its_limits(void **state)
{
    const double low[] = {LOW, LOW}, high[] = {HIGH, HIGH}, fault[] = {-1.0, 1.0};
    const struct apc_controller_options o = {.size = sizeof(o),
                                             .law = &apc_law_pi,
                                             .dim = {2, 2, 2, 0},
                                             .period = S,
                                             .horizon = 3 * S,
                                             .fault = fault,
                                             .low = low,
                                             .high = high};
    const char *given = getenv("APC_TEST_SEED");
    struct apc_controller *c = NULL;
    struct apc_sample in[IN], out[OUT];
    struct apc_now now = {.mono = S, .utc = T0};
    struct tally t = {0};

    (void)state;
    seed = given ? strtoull(given, NULL, 10) : 20260131;
    print_message("APC_TEST_SEED=%llu\n", (unsigned long long)seed);
    assert_int_equal(apc_controller_create(&c, &o, NULL), 0);
    assert_int_equal(apc_controller_size(c).in, IN);
    assert_int_equal(apc_controller_size(c).out, OUT);
    apc_controller_inputs(c, in);
    for (int k = 0; k < TICKS; k++) {
        bool quiet = k / 50 % 3 == 0; /* let it control for a while, so that there is something to spoil */
        int n;

        now.mono += S;
        now.utc = T0 + now.mono + (chance(50) ? 0 : (apc_ns)chance(7200) * S);
        for (int i = 0; i < IN; i++) {
            if (quiet)
                calm(&in[i], now);
            else if (chance(4) == 0)
                spoil(&in[i], now);
        }
        n = apc_controller_compute(c, now, chance(20) ? in : NULL, out, NULL);
        check(out, n, &t);
        if (chance(20))
            apc_controller_update(c);
    }
    print_message("%d computed, %d held, %d at the fault value\n", t.computed, t.held, t.fault);
    assert_true(t.computed > 1000 && t.held > 1000 && t.fault > 1000);
    apc_controller_destroy(c);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(no_input_makes_an_output_that_is_not_finite_or_outside_its_limits),
    };

    return cmocka_run_group_tests(tests, NULL, NULL);
}

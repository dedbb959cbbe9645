/* SPDX-License-Identifier: BSD-3-Clause */
/*
 * The shipped experiments give the same numbers on each compiler, with or without optimisation and
 * sanitizers, as long as nobody means them to be others: all that their plants, sensors, laws and layers did
 * is one number here. Who changes them on purpose takes the new ones from what this test says, and tells why
 * they are better.
 */
#include "check.h"
#include "simulated.h"

#include <math.h>
#include <stdio.h>

struct sum {
    double value;
    size_t n;
};

/* Each number counts by its leading digits, whatever its size. */
static void count(struct sum *sum, double value)
{
    const double weight = 1.0 + 0.618 * (double)(++sum->n % 7);

    sum->value += weight * (isfinite(value) ? asinh(1e3 * value) : 7.0);
}

static int count_sample(void *ctx, const struct apc_sample *s)
{
    count(ctx, s->value);
    count(ctx, (double)s->status / 1e9);
    return 0;
}

static struct sum sum_of(const char *name, double until)
{
    static const enum apc_table table[] = {APC_SENSOR, APC_ACTUATOR, APC_SETPOINT};
    struct apc_experiment *e;
    struct apc_simulation *s = NULL;
    struct apc_error why;
    struct sum sum = {0.0, 0};
    char file[300];

    snprintf(file, sizeof file, APC_SOURCE_DIR "/experiments/%s.conf", name);
    if (apc_experiment_load(&e, file, NULL, &why) < 0 || apc_simulation_create(&s, e, NULL, &why) < 0)
        fail_msg("%s", why.text);
    run(s, until);
    for (int id = 1; id <= 8; id++) {
        for (size_t i = 0; i < sizeof table / sizeof *table; i++)
            assert_true(apc_store_history(apc_simulation_store(s), table[i], id, NULL, count_sample, &sum) >=
                        0);
    }
    apc_simulation_destroy(s);
    apc_experiment_destroy(e);
    return sum;
}

static void the_shipped_experiments_give_the_same_numbers(void **state)
{
    static const struct {
        const char *name;
        double until, expected;
    } of[] = {
        {"adiabatic-cstr", 3000, 576639.401359406},
        {"double-tank", 600, 235950.999963409},
        {"double-tank-override", 600, 329236.018827302},
        {"first-order", 60, 3980.087558433},
        {"four-tank", 600, 49362.681186775},
        {"hundred-loops", 5, 20586.274497412},
        {"pendulum", 10, 3191.412940593},
        {"quadruple-tank", 600, 221611.062367153},
        {"quadruple-tank-nonminimum", 600, 47423.378681288},
        {"servo", 5, 9215.816069957},
        {"temperature-lab", 300, 28484.647668083},
        {"two-layers", 300, 198316.152117185},
        {"van-de-vusse", 2000, 21465.083790918},
    };
    size_t wrong = 0;

    (void)state;
    for (size_t i = 0; i < sizeof of / sizeof *of; i++) {
        const struct sum sum = sum_of(of[i].name, of[i].until);

        if (!(fabs(sum.value - of[i].expected) <= 1e-9 * (double)sum.n)) {
            print_message("{\"%s\", %g, %.9f}, of %zu numbers\n", of[i].name, of[i].until, sum.value, sum.n);
            wrong++;
        }
    }
    assert_int_equal(wrong, 0);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(the_shipped_experiments_give_the_same_numbers),
    };

    return cmocka_run_group_tests(tests, NULL, NULL);
}

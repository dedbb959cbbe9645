/* SPDX-License-Identifier: BSD-3-Clause */
/*
 * The shipped experiments give the same numbers on each compiler, with or without optimisation and
 * sanitizers, as long as nobody means them to be others: all that their plants, sensors, laws and layers did
 * is one number here, by themselves and with an operator who does all that one may, wrong things among it.
 * Who changes them on purpose takes the new ones from what this test says, and tells why they are better.
 */
#include "base/base_internal.h"
#include "check.h"
#include "simulated.h"

#include <math.h>
#include <stdio.h>
#include <string.h>

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

/* ---- With an operator -------------------------------------------------------------------------------- */

static void count_text(struct sum *sum, const char *text)
{
    count(sum, (double)apc_hash(APC_HASH_BEGIN, text, strlen(text)) / 4294967296.0);
}

static int count_event(void *ctx, const struct apc_event *e)
{
    count(ctx, apc_ns_to_s(e->time) - 946684800.0);
    count(ctx, e->severity);
    count_text(ctx, e->source);
    count_text(ctx, e->kind);
    count_text(ctx, e->text);
    return 0;
}

static void count_figures(struct sum *sum, const struct apc_simulation *s)
{
    struct apc_figure f[40] = {{.size = sizeof *f}};
    const int n = apc_simulation_figures(s, f, 40);

    count(sum, n);
    for (int i = 0; i < n && i < 40; i++) {
        const double number[] = {f[i].from,     f[i].until,     f[i].iae,      f[i].ise,
                                 f[i].itae,     f[i].overshoot, f[i].settling, f[i].peak,
                                 f[i].recovery, f[i].effort,    f[i].without};

        count_text(sum, f[i].loop);
        count_text(sum, f[i].event);
        for (size_t k = 0; k < sizeof number / sizeof *number; k++)
            count(sum, number[k]);
    }
}

/* What its variables are called, and their limits. */
static void count_tags(struct sum *sum, struct apc_store *store)
{
    static struct apc_tag tag[400];
    const int n = apc_store_get_tags(store, tag, 400);

    count(sum, n);
    for (int i = 0; i < n && i < 400; i++) {
        count(sum, (double)tag[i].table + 0.001 * (double)tag[i].id);
        count_text(sum, tag[i].name);
        count_text(sum, tag[i].unit);
        count_text(sum, tag[i].description);
        count_text(sum, tag[i].controller);
        count_text(sum, tag[i].area);
        const double number[] = {tag[i].low,    tag[i].high, tag[i].display_low, tag[i].display_high,
                                 tag[i].period, tag[i].step, tag[i].length};
        for (size_t k = 0; k < sizeof number / sizeof *number; k++)
            count(sum, number[k]);
    }
}

/* Everything in the store but what is vectors. */
static void count_store(struct sum *sum, struct apc_simulation *s)
{
    count_tags(sum, apc_simulation_store(s));
    for (enum apc_table table = APC_SENSOR; table < APC_TABLE_END; table++) {
        for (int id = 0; id <= 40 && !apc_table_vectors(table); id++) {
            count(sum, apc_store_history(apc_simulation_store(s), table, id, NULL, count_sample, sum));
        }
    }
    count(sum, apc_store_events(apc_simulation_store(s), &(struct apc_range){0}, count_event, sum));
}

/* Of each sort of thing that has a name, all that one may ask for, after such a share of the run. */
static void operate(struct sum *sum, struct apc_simulation *s, const char *const *name, int step)
{
    static const enum apc_mode mode[] = {APC_MODE_MAN, APC_MODE_AUTO, APC_MODE_OOS, APC_MODE_CAS};
    static const char *const what[] = {"local", "remote", "kill", "start", "promote", "dance"};

    for (size_t i = 0; name[i]; i++) {
        struct apc_value value = {0};
        const int rc = apc_simulation_read(s, name[i], &value);

        count(sum, rc);
        count(sum, value.value);
        if ((step + (int)i) % 3 == 0)
            count(sum, apc_simulation_mode(s, name[i], mode[(size_t)step / 3 % 4]));
        if ((step + (int)i) % 4 == 1)
            count(sum, apc_simulation_write(s, name[i], value.value * (step % 2 ? 1.05 : 0.97)));
        if ((step + (int)i) % 5 == 2)
            count(sum, apc_simulation_do(s, what[(size_t)step % 6], name[i]));
    }
}

static void with_an_operator_they_give_the_same_numbers(void **state)
{
    enum { STEPS = 24 };
    static const struct {
        const char *name, *names[12];
        double until, expected;
        const char *set[3];
    } of[] = {
        {"alarms/pump-failure",
         {"h1", "r1", "F1", "F2", "controller", "controller.F1.Kp", "none"},
         480,
         55344.427096666,
         {NULL}},
        {"double-tank-override",
         {"h2", "r", "h1_max", "u", "upper", "want", "levels", "choose", "smooth", "levels.want", "none"},
         240,
         103808.753079157,
         {"controllers.levels.want.Kp=30", "plant.initial.h1=0.1"}},
        {"four-tank-mpc",
         {"h1", "r1", "r2", "F1", "controller", "none"},
         480,
         77979.355818530,
         {"outputs.F1.high=350"}},
        {"temperature-lab", {"T1", "r2", "Q1", "Q2", "controller", "none"}, 240, 40125.305397089, {NULL}},
        {"two-layers",
         {"y1", "r1", "w1", "w2", "v1", "base", "upper", "upper.r1", "base.v2", "none"},
         240,
         91018.903560968,
         {NULL}},
        {"two-layers-mpc",
         {"y2", "r1", "w1", "w2", "v1", "base", "upper", "upper.r2", "none"},
         240,
         107380.389509424,
         {NULL}},
    };
    size_t wrong = 0;

    (void)state;
    for (size_t i = 0; i < sizeof of / sizeof *of; i++) {
        struct apc_experiment *e;
        struct apc_simulation *s = NULL;
        struct apc_error why = {""};
        struct sum sum = {0.0, 0};
        char file[300];

        snprintf(file, sizeof file, APC_SOURCE_DIR "/experiments/%s.conf", of[i].name);
        assert_int_equal(apc_experiment_load(&e, file, NULL, &why), 0);
        for (size_t k = 0; k < 3 && of[i].set[k]; k++) {
            char path[100];
            const size_t n = strcspn(of[i].set[k], "=");

            snprintf(path, sizeof path, "%.*s", (int)n, of[i].set[k]);
            count(&sum, apc_experiment_set(e, path, of[i].set[k] + n + 1, &why));
        }
        if (apc_simulation_create(&s, e, NULL, &why) < 0)
            fail_msg("%s", why.text);
        for (int step = 0; step < STEPS; step++) {
            run(s, of[i].until * (step + 1) / (double)STEPS);
            operate(&sum, s, of[i].names, step);
        }
        count_figures(&sum, s);
        count_store(&sum, s);
        if (!(fabs(sum.value - of[i].expected) <= 1e-9 * (double)sum.n)) {
            print_message("%s, with an operator: %.9f, of %zu numbers\n", of[i].name, sum.value, sum.n);
            wrong++;
        }
        apc_simulation_destroy(s);
        apc_experiment_destroy(e);
    }
    assert_int_equal(wrong, 0);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(the_shipped_experiments_give_the_same_numbers),
        cmocka_unit_test(with_an_operator_they_give_the_same_numbers),
    };

    return cmocka_run_group_tests(tests, NULL, NULL);
}

/* SPDX-License-Identifier: BSD-3-Clause */
/*
 * Shadows of controllers above and below others, of those that calculate signals and of those that select, in
 * virtual time. Where a plant is at rest nothing may move, whoever is promoted when, and afterwards all is as
 * it was; and what a shadow's presence does to the others is nothing, to the last bit.
 */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "check.h"

#include <apccontrol.h>
#include <apcrun.h>

#define AWAKE 400.0 /* s: at rest */

#define CASCADE                                                                                              \
    "name = \"cascade\"; duration = 3600.0;\n"                                                               \
    "measurements = ( { name = \"y\"; low = -100.0; high = 100.0; } );\n"                                    \
    "setpoints = ( { name = \"r\"; low = -50.0; high = 50.0; initial = 1.0; },\n"                            \
    "              { name = \"w\"; low = -50.0; high = 50.0; initial = 5.0; } );\n"                          \
    "outputs = ( { name = \"u\"; low = -20.0; high = 20.0; } );\n"                                           \
    "signals = ( { name = \"f\"; low = -100.0; high = 100.0; } );\n"                                         \
    "plant = { model = \"first-order\"; parameters = { tau = 1.0; }; period = 0.1; };\n"                     \
    "client = { period = 0.1; };\n"                                                                          \
    "controllers = (\n"                                                                                      \
    "  { name = \"smooth\"; law = \"filter\"; period = 0.5; measurements = [\"y\"]; outputs = [\"f\"];\n"    \
    "    tuning = ( { tau = 0.5; } ); },\n"                                                                  \
    "  { name = \"base\"; execution = \"uniform(0.0, 0.25)\"; law = \"pi\"; period = 0.5; mode = \"Cas\"; "  \
    "measurements = [\"y\"];\n"                                                                              \
    "    setpoints = [\"r\"]; outputs = [\"u\"]; tuning = ( { Kp = 0.2; tau_i = 1.0; } ); },\n"              \
    "  { name = \"upper\"; execution = \"uniform(0.0, 0.25)\"; law = \"pi\"; period = 1.0; measurements = "  \
    "[\"f\"]; setpoints = [\"w\"];\n"                                                                        \
    "    outputs = [\"r\"]; tuning = ( { Kp = 0.3; tau_i = 2.0; } ); }"
#define SHADOWS                                                                                              \
    ",\n  { name = \"smooth2\"; execution = \"uniform(0.0, 0.25)\"; shadow = true; law = \"filter\"; "       \
    "period = 0.3; measurements = [\"y\"];\n"                                                                \
    "    outputs = [\"f\"]; tuning = ( { tau = 1.5; } ); },\n"                                               \
    "  { name = \"base2\"; execution = \"uniform(0.0, 0.25)\"; shadow = true; law = \"pid\"; period = 0.4; " \
    "mode = \"Cas\";\n"                                                                                      \
    "    measurements = [\"y\"]; setpoints = [\"r\"]; outputs = [\"u\"];\n"                                  \
    "    tuning = ( { Kp = 0.3; tau_i = 1.5; } ); },\n"                                                      \
    "  { name = \"upper2\"; execution = \"uniform(0.0, 0.25)\"; shadow = true; law = \"pid\"; period = "     \
    "1.5; measurements = [\"y\"];\n"                                                                         \
    "    setpoints = [\"w\"]; outputs = [\"r\"]; tuning = ( { Kp = 0.2; tau_i = 3.0; } ); },\n"              \
    "  { name = \"upper3\"; shadow = true; law = \"pi\"; period = 0.7; measurements = [\"f\"];\n"            \
    "    setpoints = [\"w\"]; outputs = [\"r\"]; tuning = ( { Kp = 0.1; tau_i = 4.0; } ); }"

#define END " );\n"

#define SELECT                                                                                               \
    "name = \"select\"; duration = 3600.0;\n"                                                                \
    "measurements = ( { name = \"y\"; low = -100.0; high = 100.0; } );\n"                                    \
    "setpoints = ( { name = \"r\"; low = -50.0; high = 50.0; initial = 5.0; },\n"                            \
    "              { name = \"y_max\"; low = -50.0; high = 50.0; initial = 7.0; } );\n"                      \
    "outputs = ( { name = \"u\"; low = -20.0; high = 20.0; } );\n"                                           \
    "signals = ( { name = \"want\"; low = -100.0; high = 100.0; },\n"                                        \
    "            { name = \"allow\"; low = -100.0; high = 100.0; } );\n"                                     \
    "plant = { model = \"first-order\"; parameters = { tau = 1.0; }; period = 0.1; };\n"                     \
    "client = { period = 0.1; };\n"                                                                          \
    "controllers = (\n"                                                                                      \
    "  { name = \"level\"; law = \"pi\"; period = 0.5; measurements = [\"y\"]; setpoints = [\"r\"];\n"       \
    "    outputs = [\"want\"]; tuning = ( { Kp = 0.2; tau_i = 1.0; } ); },\n"                                \
    "  { name = \"guard\"; law = \"pi\"; period = 0.5; measurements = [\"y\"]; setpoints = [\"y_max\"];\n"   \
    "    outputs = [\"allow\"]; tuning = ( { Kp = 0.2; tau_i = 1.0; } ); },\n"                               \
    "  { name = \"choose\"; law = \"select\"; period = 0.5; measurements = [\"want\", \"allow\"];\n"         \
    "    outputs = [\"u\"]; settings = { select = \"low\"; }; }"

#define SELECTORS                                                                                            \
    ",\n  { name = \"level2\"; shadow = true; law = \"pid\"; period = 0.4; measurements = [\"y\"];\n"        \
    "    setpoints = [\"r\"]; outputs = [\"want\"]; tuning = ( { Kp = 0.3; tau_i = 1.5; } ); },\n"           \
    "  { name = \"guard2\"; shadow = true; law = \"pid\"; period = 0.6; measurements = [\"y\"];\n"           \
    "    setpoints = [\"y_max\"]; outputs = [\"allow\"]; tuning = ( { Kp = 0.1; tau_i = 2.0; } ); },\n"      \
    "  { name = \"choose2\"; shadow = true; law = \"select\"; period = 0.7;\n"                               \
    "    measurements = [\"want\", \"allow\"]; outputs = [\"u\"];\n"                                         \
    "    settings = { select = \"low\"; }; }"

static struct apc_simulation *simulate(const char *text, double until)
{
    struct apc_experiment *e;
    struct apc_simulation *s = NULL;
    struct apc_error why = {""};
    if (apc_experiment_load(&e, "cascade.conf", text, &why) < 0 ||
        apc_simulation_create(&s, e, NULL, &why) < 0)
        fail_msg("%s", why.text);
    if (apc_simulation_run(s, until) < 0)
        fail_msg("%s", apc_simulation_error(s));
    apc_experiment_destroy(e);
    return s;
}

static double value(struct apc_simulation *s, const char *name)
{
    struct apc_value v;
    if (apc_simulation_read(s, name, &v) < 0)
        fail_msg("%s: %s", name, apc_simulation_error(s));
    return v.value;
}

struct rows {
    struct apc_sample *at;
    size_t n;
};

static int keep(void *ctx, const struct apc_sample *sample)
{
    struct rows *r = ctx;
    r->at = reallocarray(r->at, r->n + 1, sizeof *r->at);
    assert_non_null(r->at);
    r->at[r->n++] = *sample;
    return 0;
}

static struct rows history(struct apc_simulation *s, enum apc_table table, int id)
{
    struct rows r = {NULL, 0};
    assert_true(apc_store_history(apc_simulation_store(s), table, id, NULL, keep, &r) >= 0);
    return r;
}

static void act(struct apc_simulation *s, const char *what, const char *name)
{
    if (apc_simulation_do(s, what, name) < 0)
        fail_msg("%s %s: %s", what, name, apc_simulation_error(s));
}

static void run(struct apc_simulation *s, double until)
{
    if (apc_simulation_run(s, until) < 0)
        fail_msg("%s", apc_simulation_error(s));
}

/* ---- Tests -------------------------------------------------------------------------------- */

static void same_rows(struct apc_simulation *a, struct apc_simulation *b, enum apc_table table, int id)
{
    struct rows one = history(a, table, id), other = history(b, table, id);
    assert_int_equal(one.n, other.n);
    assert_true(one.n > 100);
    for (size_t i = 0; i < one.n; i++) {
        assert_int_equal(one.at[i].time, other.at[i].time);
        assert_int_equal(one.at[i].status, other.at[i].status);
        assert_memory_equal(&one.at[i].value, &other.at[i].value, sizeof one.at[i].value);
    }
    free(one.at);
    free(other.at);
}

/* All that the first ones do is, bit for bit, what they do alone. */
/*
 * Promise(modes/controller-shadow-above): Any controller has a shadow: above, below, one that calculates,
 *   one that selects; beside the others it changes no bit, and no promotion moves what is at rest.
 */
static void shadows_in_a_cascade_change_nothing(void **state)
{
    struct apc_simulation *a = simulate(CASCADE SHADOWS END, 200), *b = simulate(CASCADE END, 200);
    (void)state;
    assert_true(apc_simulation_mode(a, "base2.u", APC_MODE_MAN) >= 0);
    run(a, 300);
    run(b, 300);
    same_rows(a, b, APC_ACTUATOR, 1);
    same_rows(a, b, APC_SETPOINT, 1);
    same_rows(a, b, APC_SENSOR, 2);
    apc_simulation_destroy(a);
    apc_simulation_destroy(b);
}

static void stays(struct apc_simulation *s, enum apc_table table, int id, double rest, unsigned seed)
{
    struct rows r = history(s, table, id);
    const apc_ns zero = r.n ? r.at[0].time : 0;
    for (size_t i = 0; i < r.n; i++)
        if (apc_ns_to_s(r.at[i].time - zero) > AWAKE - 10 && !(fabs(r.at[i].value - rest) < 1e-6))
            fail_msg("seed %u: %s.%d is %.9g at %.3f s, not %.9g", seed, apc_table_name(table), id,
                     r.at[i].value, apc_ns_to_s(r.at[i].time - zero), rest);
    free(r.at);
}

static const char *one_of(const char *const *names, struct apc_random *random)
{
    size_t n = 0;
    while (names[n])
        n++;
    return names[apc_random_next(random) % n];
}

static void pass(struct apc_simulation *s, double *now, struct apc_random *random)
{
    *now += 0.05 * (double)(1 + apc_random_next(random) % 60);
    run(s, *now);
}

/* A controller is gone for a while, but not for so long, with a promotion before or after it, that the plant
 * misses it. */
static void restart(struct apc_simulation *s, const char *name, double *now)
{
    run(s, *now += 2.0);
    act(s, "kill", name);
    run(s, *now += 0.3);
    act(s, "start", name);
    run(s, *now += 2.0);
}

/* The outputs for the plant are not passed on and on, for the same reason. */
static void promote(struct apc_simulation *s, const char *name, double *now)
{
    const double pause = strncmp(name, "base", 4) ? 0.0 : 2.0;
    run(s, *now += pause);
    act(s, "promote", name);
    run(s, *now += pause);
}

/* Promise(modes/controller-shadow-above) */
static void at_rest_no_promotion_in_a_cascade_moves_anything(void **state)
{
    static const char *const all[] = {"smooth", "smooth2", "base",   "base2", "upper",
                                      "upper2", "upper3",  "upper2", NULL},
                             *const lower[] = {"u", "base2.u", NULL};
    (void)state;
    for (unsigned seed = 1; seed <= 24; seed++) {
        struct apc_simulation *s = simulate(CASCADE SHADOWS END, AWAKE);
        const double r = value(s, "r"), u = value(s, "u"), f = value(s, "f");
        struct apc_random random;
        double now = AWAKE;
        apc_random_init(&random, seed, "promotions");
        assert_near(value(s, "y"), 5.0, 1e-6);
        for (int i = 0; i < 30; i++) {
            pass(s, &now, &random);
            switch (apc_random_next(&random) % 7) {
            case 0:
                restart(s, one_of(all, &random), &now);
                break;
            case 1:
                assert_true(apc_simulation_mode(s, one_of(lower, &random), APC_MODE_AUTO) >= 0);
                break;
            case 2:
                assert_true(apc_simulation_mode(s, one_of(lower, &random), APC_MODE_CAS) >= 0);
                break;
            case 3:
                assert_true(apc_simulation_mode(s, one_of(lower, &random), APC_MODE_MAN) >= 0);
                break;
            default:
                promote(s, one_of(all, &random), &now);
            }
        }
        assert_true(apc_simulation_mode(s, "u", APC_MODE_CAS) >= 0);
        assert_true(apc_simulation_mode(s, "base2.u", APC_MODE_CAS) >= 0);
        run(s, now + 30);
        stays(s, APC_SETPOINT, 1, r, seed);
        stays(s, APC_ACTUATOR, 1, u, seed);
        stays(s, APC_SENSOR, 2, f, seed);
        /* And it lives: the cascade is closed, and what is wanted comes about. */
        assert_true(apc_simulation_write(s, "w", 6.0) >= 0);
        run(s, now + 600);
        if (!(fabs(value(s, "y") - 6.0) < 1e-3))
            fail_msg("seed %u: y is %g, not 6", seed, value(s, "y"));
        apc_simulation_destroy(s);
    }
}

/* Nobody sheds where the one above is another from now on. */
/* Promise(modes/controller-shadow-above) */
static void a_promotion_above_opens_no_cascade(void **state)
{
    struct apc_simulation *s = simulate(CASCADE SHADOWS END, AWAKE);
    struct rows mode;
    double now = AWAKE;
    (void)state;
    for (int i = 0; i < 10; i++) {
        static const char *const to[] = {"upper2", "upper3", "upper"};
        act(s, "promote", to[i % 3]);
        run(s, now += 20.05);
    }
    mode = history(s, APC_ACTUAL, apc_variable_number(APC_OPMODE, 2));
    assert_true(mode.n > 0);
    assert_true(apc_ns_to_s(mode.at[mode.n - 1].time - mode.at[0].time) < AWAKE);
    assert_near(mode.at[mode.n - 1].value, APC_MODE_CAS, 0);
    free(mode.at);
    apc_simulation_destroy(s);
}

static enum apc_mode actual(struct apc_simulation *s, int loop)
{
    struct apc_sample row = {.table = APC_ACTUAL, .id = apc_variable_number(APC_OPMODE, loop)};
    assert_true(apc_store_read(apc_simulation_store(s), &row, 1) >= 0);
    return (enum apc_mode)(int)row.value;
}

enum { BASE = 2, UPPER, SMOOTH2, BASE2, UPPER2 }; /* loops in the order of the file */

/* Neighbours go by the loop of whoever acts, whatever the other ones are asked for. */
/* Promise(modes/controller-shadow-above) */
static void the_loop_of_who_acts_counts(void **state)
{
    struct apc_simulation *s = simulate(CASCADE SHADOWS END, AWAKE);
    (void)state;
    assert_true(apc_simulation_mode(s, "base2.u", APC_MODE_AUTO) >= 0);
    run(s, AWAKE + 10);
    assert_int_equal(actual(s, BASE), APC_MODE_CAS);
    assert_int_equal(actual(s, UPPER), APC_MODE_AUTO);
    act(s, "promote", "base2");
    run(s, AWAKE + 20);
    assert_int_equal(actual(s, BASE2), APC_MODE_AUTO);
    assert_int_equal(actual(s, UPPER), APC_MODE_IMAN);
    assert_true(apc_simulation_mode(s, "u", APC_MODE_AUTO) >= 0);
    assert_true(apc_simulation_mode(s, "base2.u", APC_MODE_CAS) >= 0);
    run(s, AWAKE + 30);
    assert_int_equal(actual(s, BASE2), APC_MODE_CAS);
    assert_int_equal(actual(s, UPPER), APC_MODE_AUTO);

    act(s, "promote", "upper2");
    run(s, AWAKE + 40);
    assert_true(apc_simulation_mode(s, "upper.r", APC_MODE_OOS) >= 0);
    run(s, AWAKE + 50);
    assert_int_equal(actual(s, BASE2), APC_MODE_CAS);
    assert_true(apc_simulation_mode(s, "upper2.r", APC_MODE_OOS) >= 0);
    run(s, AWAKE + 52.5); /* sooner than its last row is stale */
    assert_int_equal(actual(s, UPPER2), APC_MODE_OOS);
    assert_int_equal(actual(s, BASE2), APC_MODE_AUTO);
    apc_simulation_destroy(s);
}

/* The loop has been shed; a row that was on its way comes at some time of a promotion. Whoever acts then puts
 * back what was in force. */
/* Promise(modes/controller-shadow-above) */
static void a_late_row_is_not_taken_by_who_is_promoted(void **state)
{
    (void)state;
    for (int when = 0; when < 9; when++) {
        struct apc_simulation *s = simulate(CASCADE SHADOWS END, AWAKE);
        struct apc_store *store = apc_simulation_store(s);
        const double r = value(s, "r"), u = value(s, "u");
        struct apc_sample late = {.table = APC_SETPOINT, .id = 1};
        for (const char *const *who = (const char *const[]){"upper", "upper2", "upper3", NULL}; *who; who++)
            act(s, "kill", *who);
        run(s, AWAKE + 10);
        assert_int_equal(actual(s, BASE), APC_MODE_AUTO);
        act(s, "promote", "base2");
        run(s, AWAKE + 10 + 0.13 * when);
        assert_true(apc_store_read(store, &late, 1) >= 0);
        late.seq++;
        late.time += 10 * APC_NS_PER_S;
        late.value = r + 3;
        late.origin = 1;
        assert_true(apc_store_append(store, &late, 1) >= 0);
        run(s, AWAKE + 30);
        assert_int_equal(actual(s, BASE2), APC_MODE_AUTO);
        assert_near(value(s, "r"), r, 1e-6);
        stays(s, APC_ACTUATOR, 1, u, (unsigned)when);
        apc_simulation_destroy(s);
    }
}

/* Promise(modes/controller-shadow-above) */
static void at_rest_no_promotion_among_selectors_moves_anything(void **state)
{
    static const char *const all[] = {"level", "level2", "guard", "guard2", "choose", "choose2", NULL};
    (void)state;
    for (unsigned seed = 1; seed <= 24; seed++) {
        struct apc_simulation *s = simulate(SELECT SELECTORS END, AWAKE);
        const double u = value(s, "u");
        struct apc_random random;
        double now = AWAKE;
        apc_random_init(&random, seed, "promotions");
        assert_near(value(s, "y"), 5.0, 1e-6);
        for (int i = 0; i < 30; i++) {
            now +=
                2.0; /* a signal that nobody calculates for longer is stale, and then rightly not selected */
            pass(s, &now, &random);
            act(s, "promote", one_of(all, &random));
        }
        run(s, now + 30);
        stays(s, APC_ACTUATOR, 1, u, seed);
        stays(s, APC_SENSOR, 2, u, seed);
        assert_true(apc_simulation_write(s, "r", 9.0) >= 0); /* more than is allowed */
        run(s, now + 200);
        assert_near(value(s, "y"), 7.0, 1e-3);
        apc_simulation_destroy(s);
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(shadows_in_a_cascade_change_nothing),
        cmocka_unit_test(at_rest_no_promotion_in_a_cascade_moves_anything),
        cmocka_unit_test(a_promotion_above_opens_no_cascade),
        cmocka_unit_test(the_loop_of_who_acts_counts),
        cmocka_unit_test(a_late_row_is_not_taken_by_who_is_promoted),
        cmocka_unit_test(at_rest_no_promotion_among_selectors_moves_anything),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}

/* SPDX-License-Identifier: BSD-3-Clause */
/* A file with a controller in shadow: how it is read, and what it does in virtual time. */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "check.h"

#include <apcrun.h>

#define HEAD                                                                                                 \
    "name = \"shadow\"; duration = 600.0;\n"                                                                 \
    "measurements = ( { name = \"y\"; } );\n"                                                                \
    "setpoints = ( { name = \"r\"; low = -100.0; high = 100.0; initial = 10.0; } );\n"                       \
    "outputs = ( { name = \"u\"; low = -10.0; high = 10.0; } );\n"                                           \
    "plant = { model = \"first-order\"; parameters = { K = 10.0; tau = 10.0; }; period = 0.2; };\n"          \
    "client = { period = 0.5; };\n"
#define FIRST                                                                                                \
    "{ name = \"first\"; law = \"pi\"; period = 2.0; measurements = [\"y\"]; setpoints = [\"r\"]; "          \
    "outputs = [\"u\"]; tuning = ( { Kp = 0.2; tau_i = 10.0; } ); }"
#define TRIAL                                                                                                \
    "{ name = \"trial\"; shadow = true; law = \"pid\"; period = 2.0; measurements = [\"y\"]; "               \
    "setpoints = [\"r\"]; outputs = [\"u\"]; tuning = ( { Kp = 0.05; tau_i = 20.0; } ); }"
#define ACTIONS                                                                                              \
    "actions = ( { at = 60.2; set = \"r\"; value = 20.0; }, { at = 65.2; promote = \"trial\"; },\n"          \
    "            { at = 120.2; set = \"r\"; value = 5.0; }, { at = 125.2; promote = \"first\"; },\n"         \
    "            { at = 300.2; kill = \"first\"; } );\n"

/* ---- Runs --------------------------------------------------------------------------------- */

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

static struct apc_simulation *simulate(const char *text, double until)
{
    struct apc_experiment *e;
    struct apc_simulation *s = NULL;
    struct apc_error why;
    if (apc_experiment_load(&e, "shadow.conf", text, &why) < 0 ||
        apc_simulation_create(&s, e, NULL, &why) < 0)
        fail_msg("%s", why.text);
    if (apc_simulation_run(s, until) < 0)
        fail_msg("%s", apc_simulation_error(s));
    apc_experiment_destroy(e);
    return s;
}

static struct rows history(struct apc_simulation *s, enum apc_table table, int id)
{
    struct rows r = {NULL, 0};
    assert_true(apc_store_history(apc_simulation_store(s), table, id, NULL, keep, &r) >= 0);
    return r;
}

/* ---- Tests -------------------------------------------------------------------------------- */

/* All that the first one does is, bit for bit, what it does alone. */
static void a_shadow_changes_nothing(void **state)
{
    struct apc_simulation *with = simulate(HEAD "controllers = ( " FIRST ", " TRIAL " );", 200),
                          *alone = simulate(HEAD "controllers = ( " FIRST " );", 200);
    struct rows a = history(with, APC_ACTUATOR, 1), b = history(alone, APC_ACTUATOR, 1),
                would = history(with, APC_ESTIMATE, 2);
    (void)state;
    assert_int_equal(a.n, b.n);
    assert_true(a.n > 90);
    for (size_t i = 0; i < a.n; i++) {
        assert_int_equal(a.at[i].time, b.at[i].time);
        assert_memory_equal(&a.at[i].value, &b.at[i].value, sizeof a.at[i].value);
    }
    assert_true(would.n > 90);
    free(would.at);
    free(b.at);
    free(a.at);
    apc_simulation_destroy(alone);
    apc_simulation_destroy(with);
}

/* There and back: the first output of whoever takes over is the last one of whoever did; three ticks apart. */
static void a_promotion_is_no_step(void **state)
{
    static const double at[] = {65.2, 125.2};
    struct apc_simulation *s = simulate(HEAD "controllers = ( " FIRST ", " TRIAL " );" ACTIONS, 290);
    struct rows u = history(s, APC_ACTUATOR, 1);
    const apc_ns zero = u.at[0].time;
    (void)state;
    for (size_t k = 0; k < 2; k++) {
        size_t i = 1, apart = 1;
        while (i < u.n && apc_ns_to_s(u.at[i].time - zero) < at[k])
            i++;
        while (apart < 5 &&
               u.at[i].time - u.at[i - 1].time < 3 * APC_NS_PER_S) /* where nothing was written */
            i += apart++ > 0;
        assert_true(apart < 5);
        assert_true(u.at[i].time - u.at[i - 1].time <= 6 * APC_NS_PER_S + APC_NS_PER_MS);
        assert_near(u.at[i].value, u.at[i - 1].value, 1e-9);
        assert_true(fabs(u.at[i - 1].value - u.at[i - 2].value) > 1e-3); /* in the middle of a move */
    }
    free(u.at);
    apc_simulation_destroy(s);
}

static void the_shadow_of_a_dead_one_stays_in_shadow(void **state)
{
    struct apc_simulation *s = simulate(HEAD "controllers = ( " FIRST ", " TRIAL " );" ACTIONS, 500);
    struct rows u = history(s, APC_ACTUATOR, 1), would = history(s, APC_ESTIMATE, 2);
    (void)state;
    assert_true(u.at[u.n - 1].time - u.at[0].time < 301 * APC_NS_PER_S);
    assert_true(would.at[would.n - 1].time - u.at[0].time > 490 * APC_NS_PER_S);
    free(would.at);
    free(u.at);
    apc_simulation_destroy(s);
}

static void what_makes_no_sense_is_refused(void **state)
{
    static const struct {
        const char *text, *why;
    } bad[] = {
        {HEAD "controllers = ( " TRIAL ", " FIRST " );", "trial is to be in shadow: its outputs must be all"},
        {HEAD "controllers = ( " FIRST " ); actions = ( { at = 1.0; promote = \"first\"; } );",
         "first acts already: no other controller has its outputs"},
        {HEAD "controllers = ( " FIRST ", " TRIAL " ); actions = ( { at = 1.0; promote = \"tryal\"; } );",
         "did you mean \"trial\""},
        {HEAD "controllers = ( " FIRST ", " TRIAL " ); actions = ( { at = 1.0; promote = \"trial\"; value = "
              "1.0; } );",
         "no \"value\""},
    };
    (void)state;
    for (size_t i = 0; i < sizeof bad / sizeof *bad; i++) {
        struct apc_experiment *e;
        struct apc_simulation *s = NULL;
        struct apc_error why = {""};
        int rc = apc_experiment_load(&e, "shadow.conf", bad[i].text, &why);
        if (rc == 0) {
            rc = apc_simulation_create(&s, e, NULL, &why);
            apc_experiment_destroy(e);
        }
        assert_true(rc < 0);
        assert_has(why.text, bad[i].why);
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(a_shadow_changes_nothing),
        cmocka_unit_test(a_promotion_is_no_step),
        cmocka_unit_test(the_shadow_of_a_dead_one_stays_in_shadow),
        cmocka_unit_test(what_makes_no_sense_is_refused),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}

/* SPDX-License-Identifier: BSD-3-Clause */
/* Nonlinear predictive control in a run: each option that it has in common with mpc, on Van de Vusse's
 * reactor without steps that are announced, unless a test says so. */
/*
 * Promise(laws/nmpc-options-mpc): `nmpc` has the options of `mpc`: ranks of setpoints out of reach and of
 *   limits, input reference and cost of steady states, ranges, terminal weight, outputs in Man, measurements out of
 *   service, Bad for long, critical.
 */
#include <math.h>
#include <stdio.h>
#include <string.h>

#include "check.h"
#include "simulated.h"

#include <apcplant.h>
#include <apcrun.h>
#include <apcstore.h>

#define REACTOR APC_SOURCE_DIR "/experiments/van-de-vusse-nmpc.conf"
#define STEP    1800.0 /* s: when the sequence steps */
#define QUIET   7200.0 /* s: until the feed becomes colder */

enum { CB = 1, T = 2, F = 1, Q = 2 };

struct change {
    const char *path, *value;
};

static struct apc_error why;

/* The shipped experiment with so much more said of measurement @p name, at its end, and these settings, the
 * last one without a path. */
static struct apc_simulation *begin_with(const char *name, const char *more, const char *end,
                                         const struct change *change)
{
    static char file[8192], text[9216];
    char label[32];
    struct apc_experiment *e = NULL;
    struct apc_simulation *s = NULL;
    FILE *f = fopen(REACTOR, "r");
    assert_non_null(f);
    file[fread(file, 1, sizeof file - 1, f)] = '\0';
    fclose(f);
    snprintf(label, sizeof label, "name = \"%s\";", name);
    char *at = strstr(file, label);
    assert_non_null(at);
    at += strlen(label);
    snprintf(text, sizeof text, "%.*s %s %s %s", (int)(at - file), file, more, at, end);
    if (apc_experiment_load(&e, "nmpc.conf", text, &why) < 0 ||
        apc_experiment_set(e, "controller.settings.setpoint_preview", "0", &why) < 0)
        fail_msg("%s", why.text);
    for (; change && change->path; change++)
        if (apc_experiment_set(e, change->path, change->value, &why) < 0)
            fail_msg("%s", why.text);
    if (apc_simulation_create(&s, e, NULL, &why) < 0)
        fail_msg("%s", why.text);
    apc_experiment_destroy(e);
    return s;
}

static struct apc_simulation *begin(const struct change *change)
{
    return begin_with("cB", "", "", change);
}

struct count {
    const char *says;
    int n;
};

static int count_event(void *ctx, const struct apc_event *event)
{
    struct count *c = ctx;
    c->n += strstr(event->text, c->says) != NULL;
    return 0;
}

/* How often it was told of the law's answers. */
static int told(struct apc_simulation *s, const char *says)
{
    struct count c = {says, 0};
    assert_true(apc_store_events(apc_simulation_store(s), &(struct apc_range){0}, count_event, &c) >= 0);
    return c.n;
}

/* The mean of a variable over the 30 min until t, to which the run goes. */
static double mean(struct apc_simulation *s, enum apc_table table, int id, double t)
{
    double sum = 0.0;
    int n = 0;

    for (double at = t - 1800.0; at <= t; at += 20.0, n++) {
        run(s, at);
        sum += newest(s, table, id).value;
    }
    return sum / n;
}

/* ---- Steady states ------------------------------------------------------------------------ */

/* What a horizon of 10 periods does not see: without it the temperature is given away. */
static void a_short_horizon_has_the_cost_of_what_comes_after_it(void **state)
{
    struct change change[] = {{"controller.settings.blocks", "[1, 1, 1, 1, 1]"},
                              {"controller.settings.horizon", "10"},
                              {"controller.settings.terminal", "0"},
                              {NULL, NULL}};
    double iae[2];
    (void)state;
    for (int terminal = 0; terminal < 2; terminal++) {
        struct apc_figure figure[16] = {{.size = sizeof *figure}};
        change[2].value = terminal ? "1" : "0";
        struct apc_simulation *s = begin(change);
        run(s, 0);
        const int n = apc_simulation_figures(s, figure, 16);
        for (int i = 0; i < n && i < 16; i++)
            if (!strcmp(figure[i].loop, "T") && !strcmp(figure[i].event, "all"))
                iae[terminal] = figure[i].iae;
        apc_simulation_destroy(s);
    }
    if (!(iae[1] < 0.5 * iae[0]))
        fail_msg("%g with it, %g without", iae[1], iae[0]);
}

/* At this heat there is no feed at which cB is 0.85 and T 115.8, one for each. */
static void of_setpoints_out_of_reach_the_first_rank_is_kept_and_it_is_told(void **state)
{
    static const double wanted[] = {0.85, 115.8}, within[] = {0.005, 0.2};
    (void)state;
    for (int first = 0; first < 2; first++) {
        const struct change change[] = {
            {"controller.settings.rank", first ? "[2, 1]" : "[1, 2]"},
            {"controller.tuning",
             "( { move_suppression = 1.0; }, { move_suppression = 1.0; u_max = -500.0; } )"},
            {"scheduler.sequence", "( [1.022, 113.1], [0.85, 115.8] )"},
            {NULL, NULL}};
        struct apc_simulation *s = begin(change);
        run(s, STEP - 1);
        assert_int_equal(told(s, "law nmpc"), 0);
        assert_near(mean(s, APC_SENSOR, CB + first, QUIET), wanted[first], within[first]);
        assert_true(told(s, "law nmpc: no steady state within the limits has these setpoints: goes to the "
                            "nearest") >= 1);
        if (first)
            assert_true(newest(s, APC_SENSOR, CB).value > 0.9);
        else
            assert_true(mean(s, APC_SENSOR, T, QUIET) < 115.5);
        apc_simulation_destroy(s);
    }
}

static void an_input_reference_leaves_no_offset(void **state)
{
    const struct change change[] = {{"controller.tuning",
                                     "( { move_suppression = 1.0; reference_weight = 10.0; reference = 14.0; "
                                     "}, { move_suppression = 1.0; reference_weight = 10.0; "
                                     "reference = -4000.0; } )"},
                                    {"scheduler.sequence", "( [1.022, 113.1], [1.03, 112.0] )"},
                                    {NULL, NULL}};
    struct apc_simulation *s = begin(change);
    (void)state;
    run(s, STEP + 1800.0);
    assert_near(mean(s, APC_SENSOR, T, QUIET), 112.0, 0.1);
    assert_near(mean(s, APC_SENSOR, CB, QUIET), 1.03, 0.003);
    apc_simulation_destroy(s);
}

/* One setpoint, two inputs: of all steady states at that temperature the cheaper one, by either cost. */
static void of_steady_states_the_cheapest_is_held(void **state)
{
    static const char *const cost[] = {"( { move_suppression = 1.0; reference_weight = 1.0; reference = 8.0; "
                                       "}, { move_suppression = 1.0; reference_weight = 1.0; "
                                       "reference = -1113.5; cost = 0.005; } )",
                                       "( { move_suppression = 1.0; reference_weight = 1.0; reference = 8.0; "
                                       "}, { move_suppression = 1.0; reference_weight = 1.0; "
                                       "reference = -1113.5; cost = -0.005; } )"};
    double heat[2];
    (void)state;
    for (int way = 0; way < 2; way++) {
        const struct change change[] = {{"controller.measurement_tuning", "( { service = 0.0; }, { } )"},
                                        {"controller.settings.terminal", "1"},
                                        {"controller.tuning", cost[way]},
                                        {"scheduler.sequence", "( [1.022, 113.1] )"},
                                        {NULL, NULL}};
        struct apc_simulation *s = begin(change);
        assert_near(mean(s, APC_SENSOR, T, QUIET - 1800.0), 113.1, 0.1);
        heat[way] = mean(s, APC_ACTUATOR, Q, QUIET);
        apc_simulation_destroy(s);
    }
    assert_true(heat[0] < heat[1] - 300.0);
}

/* ---- Ranges, soft limits -------------------------------------------------------------------- */

/* The range is 112.1 to 114.1: whatever wanders within it moves nothing. */
static void within_a_range_nothing_needs_to_be_done(void **state)
{
    double effort[2];
    (void)state;
    for (int range = 0; range < 2; range++) {
        const struct change change[] = {
            {"controller.measurement_tuning", range ? "( { }, { zone = 1.0; } )" : "( { }, { } )"},
            {"scheduler.sequence", "( [1.022, 113.1] )"},
            {NULL, NULL}};
        struct apc_simulation *s = begin(change);
        double before = 0.0;
        effort[range] = 0.0;
        for (double t = 1000.0; t < QUIET; t += 20.0) {
            run(s, t);
            const double heat = newest(s, APC_ACTUATOR, Q).value;
            effort[range] += t > 1000.0 ? fabs(heat - before) : 0.0;
            before = heat;
            assert_near(newest(s, APC_SENSOR, T).value, 113.1, range ? 1.2 : 0.6);
        }
        apc_simulation_destroy(s);
    }
    if (!(effort[1] < 0.3 * effort[0]))
        fail_msg("%g in a range, %g at a setpoint", effort[1], effort[0]);
}

/* cB is to be below 0.9 and T above 115.2, for which there is no heat, and it begins where neither is so. */
/* Promise(laws/limits-contradict-never) */
static void limits_that_contradict_are_given_up_by_rank(void **state)
{
    (void)state;
    for (int first = 0; first < 2; first++) {
        const struct change change[] = {
            {"controller.settings.rank", first ? "[2, 1]" : "[1, 2]"},
            {"controller.tuning",
             "( { move_suppression = 1.0; }, { move_suppression = 1.0; u_max = -700.0; } )"},
            {"controller.measurement_tuning", "( { y_max = 0.9; }, { y_min = 115.2; } )"},
            {"scheduler.sequence", "( [0.85, 115.5] )"},
            {NULL, NULL}};
        struct apc_simulation *s = begin(change);
        run(s, 1.0); /* the first tick has a plan */
        for (int id = F; id <= Q; id++)
            assert_int_equal(apc_status_severity(newest(s, APC_ACTUATOR, id).status), APC_SEVERITY_GOOD);
        const double cB = mean(s, APC_SENSOR, CB, 3600.0), temperature = mean(s, APC_SENSOR, T, 4800.0);
        assert_int_equal(told(s, "no plan"), 0);
        assert_true(told(s, "law nmpc: limits of measurements of rank 1 cannot be kept") >= 1);
        if (first)
            assert_true(temperature > 115.05 && cB > 0.95);
        else
            assert_true(cB < 0.91 && temperature < 114.6);
        apc_simulation_destroy(s);
    }
}

/* ---- Service ------------------------------------------------------------------------------ */

static void an_output_in_man_is_known_and_comes_back_without_a_bump(void **state)
{
    static const char by_hand[] =
        "actions = ( { at = 2000.2; mode = \"F\"; value = \"Man\"; }, "
        "{ at = 2005.2; set = \"F\"; value = 9.5; }, { at = 3700.2; set = \"F\"; value = 8.1; }, "
        "{ at = 5400.2; mode = \"F\"; value = \"Auto\"; } );";
    const struct change change[] = {
        {"controller.settings.rank", "[2, 1]"}, {"scheduler.sequence", "( [1.022, 113.1] )"}, {NULL, NULL}};
    struct apc_simulation *s = begin_with("cB", "", by_hand, change);
    double first = HUGE_VAL, later = 0.0;
    (void)state;
    run(s, 2600.0);
    for (double t = 2600.0; t < 3700.0; t += 20.0) { /* by the other one */
        run(s, t);
        assert_near(newest(s, APC_SENSOR, T).value, 113.1, 0.8);
    }
    assert_near(newest(s, APC_ACTUATOR, F).value, 9.5, 0.0);
    assert_near(newest(s, APC_ACTUATOR, Q).status, APC_GOOD, 0.0);
    for (double t = 5421.0, before = 8.1, at; t < 6400.0; t += 20.0, before = at) {
        run(s, t);
        at = newest(s, APC_ACTUATOR, F).value;
        if (t < 5430.0)
            first = fabs(at - before);
        else
            later = fmax(later, fabs(at - before));
    }
    assert_true(first < 1.2 * later); /* what noise does at any tick */
    assert_near(mean(s, APC_SENSOR, CB, QUIET), 1.022, 0.003);
    apc_simulation_destroy(s);
}

static void out_of_service_a_measurement_is_not_controlled_and_the_other_one_is(void **state)
{
    const struct change change[] = {{"controller.measurement_tuning", "( { service = 0.0; }, { } )"},
                                    {NULL, NULL}};
    struct apc_simulation *s = begin(change); /* of cB, whose setpoint steps */
    (void)state;
    assert_near(mean(s, APC_SENSOR, T, 2.0 * STEP - 20.0), 113.1, 0.1);
    assert_near(newest(s, APC_SENSOR, CB).value, 1.022, 0.02);
    assert_near(newest(s, APC_SETPOINT, CB).value, 0.97, 0.0);
    apc_simulation_destroy(s);
}

#define BAD " faults = ( { kind = \"dropout\"; at = 2000.0; duration = 3000.0; } );"

static void what_is_bad_for_longer_than_its_hold_is_given_up_until_it_is_back(void **state)
{
    const struct change change[] = {{"controller.settings.hold", "[100, 100]"},
                                    {"scheduler.sequence", "( [1.022, 113.1] )"},
                                    {NULL, NULL}};
    struct apc_simulation *s = begin_with("cB", BAD, "", change);
    (void)state;
    for (double t = 2030.0; t < 5000.0; t += 20.0) {
        run(s, t);
        assert_int_equal(apc_status_severity(newest(s, APC_SENSOR, CB).status), APC_SEVERITY_BAD);
        for (int id = F; id <= Q; id++)
            assert_int_equal(apc_status_severity(newest(s, APC_ACTUATOR, id).status), APC_SEVERITY_GOOD);
        assert_near(newest(s, APC_SENSOR, T).value, 113.1, 0.7);
    }
    run(s, 5400.0);
    assert_near(mean(s, APC_SENSOR, CB, QUIET), 1.022, 0.003);
    apc_simulation_destroy(s);
}

static void without_a_critical_one_it_is_shed_after_its_hold(void **state)
{
    const struct change change[] = {{"controller.settings.hold", "[100, 100]"}, {NULL, NULL}};
    struct apc_simulation *s = begin_with("T", " critical = true;" BAD, "", change);
    (void)state;
    run(s, 2080.0);
    for (int id = F; id <= Q; id++)
        assert_int_equal(apc_status_severity(newest(s, APC_ACTUATOR, id).status), APC_SEVERITY_GOOD);
    run(s, 2400.0);
    assert_near(newest(s, APC_ACTUATOR, F).value, 8.0, 0.0); /* their safe values */
    assert_near(newest(s, APC_ACTUATOR, Q).value, -1113.5, 0.0);
    assert_true(told(s, "law nmpc: measurement 2 is critical and has been Bad for") >= 1);
    run(s, 5400.0);
    for (int id = F; id <= Q; id++)
        assert_int_equal(apc_status_severity(newest(s, APC_ACTUATOR, id).status), APC_SEVERITY_GOOD);
    assert_near(mean(s, APC_SENSOR, T, QUIET), 112.0, 0.3);
    apc_simulation_destroy(s);
}

/* ---- Loops below ------------------------------------------------------------------------------ */

/* The file of mpc above base loops, with the plant's own equations in the place of the linear model. */
static struct apc_simulation *begin_above(bool nonlinear)
{
    static const char model[] = "operating_point = { u = [3.0, 3.0]; x = [12.263, 12.783, 1.634, 1.409]; };",
                      lower[] = "lower = ( [1.0, 3.0, 30.0], [2.0, 2.7, 40.0] ); delay = 0.8; steps = 20; "
                                "terminal = 1;";
    static char file[8192], text[9216];
    struct apc_experiment *e = NULL;
    struct apc_simulation *s = NULL;
    FILE *f = fopen(APC_SOURCE_DIR "/experiments/two-layers-mpc.conf", "r");
    assert_non_null(f);
    file[fread(file, 1, sizeof file - 1, f)] = '\0';
    fclose(f);
    char *law = strstr(file, "\"mpc\""), *from = strstr(file, "model = {\n"),
         *settings = strstr(file, "settings = {\n");
    assert_true(law && from && settings && law < from && from < settings);
    if (nonlinear)
        snprintf(text, sizeof text, "%.*s\"nmpc\"%.*s%s settings = { %s %s", (int)(law - file), file,
                 (int)(from - law) - 5, law + 5, model, lower, settings + strlen("settings = {"));
    else
        snprintf(text, sizeof text, "%s", file);
    if (apc_experiment_load(&e, "above.conf", text, &why) < 0 || apc_simulation_create(&s, e, NULL, &why) < 0)
        fail_msg("%s", why.text);
    apc_experiment_destroy(e);
    return s;
}

/* Promise(laws/nmpc-moves-setpoints) */
static void above_base_loops_it_moves_their_setpoints(void **state)
{
    double iae[2][2] = {{0.0}};
    (void)state;
    for (int nonlinear = 0; nonlinear < 2; nonlinear++) {
        struct apc_figure figure[32] = {{.size = sizeof *figure}};
        struct apc_simulation *s = begin_above(nonlinear);
        double most = 0.0;
        for (double t = 5.0; t <= 1000.0; t += 5.0) {
            run(s, t);
            most = fmax(most, newest(s, APC_SENSOR, 1).value);
        }
        assert_int_equal(mode_of(s, 1), APC_MODE_CAS);
        assert_near(newest(s, APC_SENSOR, 1).value, 7.1315, 0.01);
        assert_true(most < 7.21); /* its limit is 7.2 */
        const int n = apc_simulation_figures(s, figure, 32);
        for (int i = 0; i < n && i < 32; i++)
            for (int k = 0; k < 2; k++)
                if (!strcmp(figure[i].loop, k ? "upper.r2" : "upper.r1") && !strcmp(figure[i].event, "all"))
                    iae[nonlinear][k] = figure[i].iae;
        apc_simulation_destroy(s);
    }
    for (int k = 0; k < 2; k++)
        if (!(iae[0][k] > 0.0 && iae[1][k] < 1.02 * iae[0][k]))
            fail_msg("r%d: %g with its equations, %g with a linear model", k + 1, iae[1][k], iae[0][k]);
}

/* ---- Economics ---------------------------------------------------------------------------- */

#define PRICE  (-50.0) /* 100 x -0.5 */
#define WANTED 113.1   /* degC */

/* What a steady state costs in each sample; x [4] is where it is sought from, and it. */
static double cost_at_rest(const struct apc_model *m, double feed, double heat, double x[4])
{
    const double u[] = {feed, heat, 5.1, 104.9};

    if (apc_model_equilibrium(m, NULL, u, x, NULL) < 0)
        return HUGE_VAL;
    return PRICE * x[1] + (x[2] - WANTED) * (x[2] - WANTED) / 2.0;
}

/* Promise(laws/nmpc-economic): `nmpc` goes where a measurement with a price and those with setpoints cost least together, also where
 *   the gain changes its sign; a price that is to change is known ahead. */
static void it_goes_where_all_costs_least(void **state)
{
    struct apc_experiment *e = NULL;
    struct apc_simulation *s = NULL;
    const struct apc_model *model;
    void *handle;
    double best[4] = {0.0}, least = HUGE_VAL;
    (void)state;

    if (apc_model_find("van-de-vusse", &model, &handle, &why) < 0)
        fail_msg("%s", why.text);
    for (double feed = 5.0; feed <= 30.0; feed += 0.25)
        for (double heat = -4000.0; heat <= 0.0; heat += 50.0) {
            double x[] = {2.1, 1.1, 113.0, 112.0};
            const double cost = cost_at_rest(model, feed, heat, x);

            if (cost < least) {
                least = cost;
                memcpy(best, x, sizeof best);
            }
        }
    if (apc_experiment_load(&e, APC_SOURCE_DIR "/experiments/van-de-vusse-economic.conf", NULL, &why) < 0 ||
        apc_experiment_set(e, "scheduler.period", "3600", &why) < 0 ||
        apc_simulation_create(&s, e, NULL, &why) < 0)
        fail_msg("%s", why.text);
    apc_experiment_destroy(e);
    run(s, 600.0);
    const double cB = mean(s, APC_SENSOR, CB, 2400.0), at = newest(s, APC_SENSOR, T).value;
    print_message("%g at %g degC; at rest the best is %g at %g degC\n", cB, at, best[1], best[2]);
    assert_near(cB, best[1], 0.002);
    assert_near(at, best[2], 0.15);
    apc_simulation_destroy(s);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(a_short_horizon_has_the_cost_of_what_comes_after_it),
        cmocka_unit_test(of_setpoints_out_of_reach_the_first_rank_is_kept_and_it_is_told),
        cmocka_unit_test(an_input_reference_leaves_no_offset),
        cmocka_unit_test(of_steady_states_the_cheapest_is_held),
        cmocka_unit_test(within_a_range_nothing_needs_to_be_done),
        cmocka_unit_test(limits_that_contradict_are_given_up_by_rank),
        cmocka_unit_test(an_output_in_man_is_known_and_comes_back_without_a_bump),
        cmocka_unit_test(out_of_service_a_measurement_is_not_controlled_and_the_other_one_is),
        cmocka_unit_test(what_is_bad_for_longer_than_its_hold_is_given_up_until_it_is_back),
        cmocka_unit_test(without_a_critical_one_it_is_shed_after_its_hold),
        cmocka_unit_test(above_base_loops_it_moves_their_setpoints),
        cmocka_unit_test(it_goes_where_all_costs_least),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}

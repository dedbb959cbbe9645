/* SPDX-License-Identifier: BSD-3-Clause */
/* The small laws that others are put together with. */
#include "laws.h"

#include <string.h>

#define H 0.5

/* One output. */
struct rig {
    struct apc_instances *law;
    double y[4], z[1], d[1], u[2], x[8], tuning[2 * 16], published[2];
    apc_status status[4];
    bool is_new[4];
    unsigned limited[2];
    struct apc_law_call c;
};

static void make(struct rig *r, const struct apc_law *law, struct apc_dim dim,
                 const struct apc_setting *setting, size_t n)
{
    const struct apc_law_setup setup = {.dim = dim, .Ts = H, .n_setting = n, .setting = setting};
    struct apc_error why = {""};

    memset(r, 0, sizeof(*r));
    for (size_t i = 0; i < 4; i++)
        r->is_new[i] = true;
    for (size_t i = 0; i < apc_law_parameters(law, &dim); i++)
        r->tuning[i] = law->tuning[apc_law_parameter_at(law, &dim, i).number].initial;
    r->c = (struct apc_law_call){.dim = dim,
                                 .y = r->y,
                                 .z = r->z,
                                 .d = r->d,
                                 .u = r->u,
                                 .x = r->x,
                                 .tuning = r->tuning,
                                 .limited = r->limited,
                                 .y_status = r->status,
                                 .y_new = r->is_new,
                                 .published = r->published};
    if (laws_make(&r->law, law, &setup, &why) < 0)
        fail_msg("%s", why.text);
}

static double tick(struct rig *r)
{
    laws_compute(r->law, &r->c);
    laws_update(r->law, &r->c);
    return r->u[0];
}

static void assert_refused(const struct apc_law *law, struct apc_dim dim, const struct apc_setting *setting,
                           size_t n, const char *what)
{
    const struct apc_law_setup setup = {.dim = dim, .Ts = H, .n_setting = n, .setting = setting};
    struct apc_error why = {""};

    assert_int_equal(apc_law_try(law, &setup, NULL, &why), APC_EINVAL);
    if (!strstr(why.text, what))
        fail_msg("%s", why.text);
}

/* ---- Selector -------------------------------------------------------------------------------- */

static const struct apc_setting low = {"select", "low", 0, 0, NULL}, high = {"select", "high", 0, 0, NULL};

/*
 * Promise(laws/select): `select`: low, high, Bad inputs left out; override neither winds up nor keeps the
 *   loser from winning, between controllers, too; back from Man without a bump; a restart changes no bit.
 */
static void the_least_or_the_greatest_good_input_is_selected(void **state)
{
    (void)state;
    for (int greatest = 0; greatest <= 1; greatest++) {
        const struct apc_law_call *c;
        struct rig r;

        make(&r, &apc_law_select, (struct apc_dim){4, 0, 1, 0}, greatest ? &high : &low, 1);
        memcpy(r.y, (double[]){3.0, -8.0, 9.0, 2.0}, sizeof(r.y));
        assert_near(tick(&r), greatest ? 9.0 : -8.0, 0.0);
        assert_near(r.published[0], greatest ? 3.0 : 2.0, 0.0);
        r.status[1] = r.status[2] = APC_BAD;
        assert_near(tick(&r), greatest ? 3.0 : 2.0, 0.0);
        assert_near(r.published[0], greatest ? 1.0 : 4.0, 0.0);
        r.y[3] = r.y[0]; /* equal ones: the first */
        (void)tick(&r);
        assert_near(r.published[0], 1.0, 0.0);
        r.status[0] = r.status[3] = APC_BAD;
        c = &r.c;
        assert_int_equal(apc_instances_compute(r.law, 0, c), APC_LAW_INFEASIBLE);
    }
}

/* Promise(laws/select) */
static void each_output_has_inputs_of_its_own(void **state)
{
    static const double inputs[] = {3, 1, 2, 4};
    const struct apc_setting setting[] = {{"select", "high", 0, 0, NULL}, {"inputs", NULL, 2, 2, inputs}};
    struct rig r;

    (void)state;
    make(&r, &apc_law_select, (struct apc_dim){4, 0, 2, 0}, setting, 2);
    memcpy(r.y, (double[]){1.0, 20.0, 3.0, 4.0}, sizeof(r.y));
    (void)tick(&r);
    assert_near(r.u[0], 3.0, 0.0);
    assert_near(r.u[1], 20.0, 0.0);
    assert_near(r.published[0], 1.0, 0.0);
    assert_near(r.published[1], 1.0, 0.0);
    assert_int_equal(apc_instances_ports(r.law, 0)->y[0], 2);
}

static void a_selector_that_makes_no_sense_is_refused(void **state)
{
    static const double beyond[] = {1, 3}, flat[] = {1, 2};
    const struct apc_setting middle = {"select", "middle", 0, 0, NULL}, number = {"select", NULL, 1, 1, flat};
    const struct apc_setting far[] = {low, {"inputs", NULL, 1, 2, beyond}};
    const struct apc_setting rows[] = {low, {"inputs", NULL, 2, 1, flat}};
    const struct apc_setting text[] = {low, {"inputs", "y1", 0, 0, NULL}};
    const struct apc_dim two = {2, 0, 1, 0};

    (void)state;
    assert_refused(&apc_law_select, two, NULL, 0, "select = \"low\"");
    assert_refused(&apc_law_select, two, &middle, 1, "select = \"low\"");
    assert_refused(&apc_law_select, two, &number, 1, "select = \"low\"");
    assert_refused(&apc_law_select, two, far, 2, "3 is no whole number from 1 to 2");
    assert_refused(&apc_law_select, two, rows, 2, "a row of measurements for each of the 1 outputs");
    assert_refused(&apc_law_select, two, text, 2, "a row of measurements");
    assert_refused(&apc_law_select, (struct apc_dim){17, 0, 1, 0}, &low, 1, "17 inputs");
    assert_refused(&apc_law_select, (struct apc_dim){0, 0, 1, 0}, &low, 1, "0 inputs");
}

/*
 * Override: a temperature wants more steam than a pressure allows. Two PI controllers, the lower of the two
 * goes out. At 300 s the boiler gives more, and the temperature may have what it wants.
 */
struct override {
    double worst; /* pressure above its limit */
    double taken; /* s from then on until the temperature's loop was selected */
    double end;   /* temperature */
};

static struct override run_override(bool told)
{
    struct override o = {.taken = -1.0};
    struct rig loop[2], select;
    double temperature = 0.0, pressure = 0.0;

    for (int i = 0; i < 2; i++) {
        make(&loop[i], &apc_law_pi, (struct apc_dim){1, 1, 1, 0}, NULL, 0);
        loop[i].tuning[0] = i ? 0.3 : 2.0;  /* Kp */
        loop[i].tuning[1] = i ? 2.0 : 15.0; /* tau_i */
        loop[i].z[0] = i ? 40.0 : 60.0;
    }
    make(&select, &apc_law_select, (struct apc_dim){2, 0, 1, 0}, &low, 1);
    for (int k = 0; k < 1600; k++) {
        const double t = k * H, gain = t < 300.0 ? 0.8 : 0.5;

        loop[0].y[0] = temperature;
        loop[1].y[0] = pressure;
        for (int i = 0; i < 2; i++) {
            laws_compute(loop[i].law, &loop[i].c);
            select.y[i] = loop[i].u[0];
        }
        (void)tick(&select);
        for (int i = 0; i < 2; i++) { /* external reset: what was selected, and that it is limited */
            const bool lost = select.published[0] != i + 1.0;

            loop[i].limited[0] = told && lost ? APC_LIMITED_HIGH : 0;
            loop[i].u[0] = told ? select.u[0] : loop[i].u[0];
            apc_instances_update(loop[i].law, 0, &loop[i].c);
        }
        temperature += H / 20.0 * (select.u[0] - temperature);
        pressure += H / 2.0 * (gain * select.u[0] - pressure);
        if (t > 100.0)
            o.worst = fmax(o.worst, pressure - 40.0);
        if (t >= 300.0 && o.taken < 0.0 && select.published[0] < 1.5)
            o.taken = t - 300.0;
    }
    o.end = temperature;
    return o;
}

/* Promise(laws/select) */
static void override_control_neither_winds_up_nor_keeps_the_loser_from_winning(void **state)
{
    const struct override told = run_override(true), alone = run_override(false);

    (void)state;
    assert_near(told.end, 60.0, 1e-3);
    assert_true(told.worst < 0.5);
    assert_true(told.taken >= 0.0 && told.taken < 30.0);
    assert_true(alone.taken < 0.0 || alone.taken > 3.0 * told.taken); /* what it is for */
}

/* ---- Split range ------------------------------------------------------------------------------ */

/* Promise(laws/blocks): `split`, `ramp`, `leadlag`, `filter`: their equations. */
static void each_output_moves_over_its_part_of_the_demand(void **state)
{
    /* a cooling valve that closes up to 45, a heating one that opens from 55 */
    static const struct {
        double demand, u[2];
        unsigned limited[2];
    } of[] = {{-5.0, {100.0, 0.0}, {APC_LIMITED_HIGH, APC_LIMITED_LOW}},
              {0.0, {100.0, 0.0}, {0, APC_LIMITED_LOW}},
              {9.0, {80.0, 0.0}, {0, APC_LIMITED_LOW}},
              {50.0, {0.0, 0.0}, {APC_LIMITED_LOW, APC_LIMITED_LOW}},
              {64.0, {0.0, 20.0}, {APC_LIMITED_LOW, 0}},
              {120.0, {0.0, 100.0}, {APC_LIMITED_LOW, APC_LIMITED_HIGH}}};
    const double parts[] = {0.0, 45.0, 100.0, 0.0, 55.0, 100.0, 0.0, 100.0};
    struct apc_error why = {""};
    struct rig r;

    (void)state;
    make(&r, &apc_law_split, (struct apc_dim){1, 0, 2, 0}, NULL, 0);
    memcpy(r.tuning, parts, sizeof(parts));
    for (size_t i = 0; i < sizeof(of) / sizeof(of[0]); i++) {
        r.y[0] = of[i].demand;
        (void)tick(&r);
        for (int k = 0; k < 2; k++) {
            assert_near(r.u[k], of[i].u[k], 1e-12);
            assert_int_equal(r.limited[k], of[i].limited[k]);
        }
    }
    assert_int_equal(apc_instances_check(r.law, r.tuning, &why), 0);
    r.tuning[5] = 55.0;
    assert_int_equal(apc_instances_check(r.law, r.tuning, &why), APC_ERANGE);
    assert_string_equal(why.text, "output 2: from = 55 is not below to = 55");
}

static void the_demand_may_be_any_measurement(void **state)
{
    static const double input[] = {2, 3}, beyond[] = {2, 4};
    const struct apc_setting setting = {"input", NULL, 1, 2, input}, bad = {"input", NULL, 1, 2, beyond};
    struct rig r;

    (void)state;
    make(&r, &apc_law_split, (struct apc_dim){3, 0, 2, 0}, &setting, 1);
    r.y[1] = 25.0;
    r.y[2] = 75.0;
    (void)tick(&r);
    assert_near(r.u[0], 25.0, 1e-12);
    assert_near(r.u[1], 75.0, 1e-12);
    assert_refused(&apc_law_split, (struct apc_dim){3, 0, 2, 0}, &bad, 1, "4 is no whole number from 1 to 3");
}

/* ---- Setpoint ramp ------------------------------------------------------------------------------ */

/* Promise(laws/blocks) */
static void a_setpoint_moves_at_its_rate_and_within_its_limits(void **state)
{
    struct rig r;

    (void)state;
    make(&r, &apc_law_ramp, (struct apc_dim){1, 1, 1, 0}, NULL, 0);
    r.tuning[0] = 2.0; /* rate: 1 a period */
    r.tuning[2] = 13.5;
    r.z[0] = 10.0;
    laws_reset(r.law, &r.c);
    assert_near(tick(&r), 10.0, 0.0);
    r.z[0] = 99.0;
    for (int k = 1; k <= 3; k++) {
        assert_near(tick(&r), 10.0 + k, 1e-12);
        assert_int_equal(r.limited[0], APC_LIMITED_HIGH);
    }
    assert_near(tick(&r), 13.5, 1e-12);
    r.z[0] = 0.0;
    assert_near(tick(&r), 12.5, 1e-12);
    assert_int_equal(r.limited[0], APC_LIMITED_LOW);
    r.u[0] = 5.0; /* taken over from there */
    laws_track(r.law, &r.c);
    assert_near(tick(&r), 4.0, 1e-12);
    r.tuning[0] = 0.0;
    assert_near(tick(&r), 0.0, 0.0);
    assert_int_equal(apc_instances_ports(r.law, 0)->ny, 0);
    r.tuning[0] = 2.0; /* from a setpoint beyond its limits on it begins within them */
    r.z[0] = 20.0;
    laws_reset(r.law, &r.c);
    assert_near(tick(&r), 13.5, 0.0);
}

/* ---- Lead and lag -------------------------------------------------------------------------------- */

/* Promise(laws/blocks) */
static void lead_and_lag_answer_a_step_as_the_formula_says(void **state)
{
    static const double time[][2] = {{0.0, 0.0}, {5.0, 5.0}, {0.0, 4.0}, {9.0, 3.0}, {2.0, 0.0}};

    (void)state;
    for (size_t i = 0; i < sizeof(time) / sizeof(time[0]); i++) {
        for (size_t measured = 0; measured <= 1; measured++) {
            const double lead = time[i][0], lag = time[i][1];
            struct rig r;

            make(&r, &apc_law_leadlag, (struct apc_dim){measured, 1, 1, !measured}, NULL, 0);
            r.tuning[0] = -2.0;
            r.tuning[1] = lead;
            r.tuning[2] = lag;
            r.tuning[3] = 7.0;
            r.d[0] = r.y[0] = 1.0;
            laws_reset(r.law, &r.c);
            for (int k = 0; k < 3; k++)
                assert_near(tick(&r), 7.0 - 2.0, 1e-12); /* at rest from the first */
            r.d[0] = r.y[0] = 2.0;
            for (int k = 0; k < 20; k++) {
                /* w = 1 + 1 + (T_lead - T_lag) / (T_lag + h) a^k, a = T_lag / (T_lag + h) */
                const double w = 2.0 + (lead - lag) / (lag + H) * pow(lag / (lag + H), k);

                assert_near(tick(&r), 7.0 - 2.0 * w, 1e-9);
            }
        }
    }
    assert_refused(&apc_law_leadlag, (struct apc_dim){1, 0, 2, 1}, NULL, 0, "output 2 has neither");
}

static void lead_and_lag_go_on_from_what_was_given(void **state)
{
    struct rig r;
    double before = 3.0;

    (void)state;
    make(&r, &apc_law_leadlag, (struct apc_dim){0, 0, 1, 1}, NULL, 0);
    r.tuning[2] = 6.0;
    r.d[0] = 1.0;
    laws_reset(r.law, &r.c);
    for (int gap = 0; gap <= 1; gap++) {
        r.c.gap = gap != 0;
        r.u[0] = 3.0;
        laws_track(r.law, &r.c);
        assert_near(tick(&r), 3.0, 1e-12);
    }
    for (int k = 0; k < 200; k++) {
        assert_true(tick(&r) < before);
        before = r.u[0];
    }
    assert_near(before, 1.0, 1e-6);
}

/* y = 2 / (10 s + 1) u + 1 / (4 s + 1) d: what is fed forward is -(10 s + 1) / (2 (4 s + 1)) d, by way of
 * pid. */
static double worst_deviation(double lead, double lag, double gain)
{
    static const double second = 2.0;
    const struct apc_setting setting = {"feed_forward", NULL, 1, 1, &second};
    double from_u = 0.0, from_d = 0.0, worst = 0.0;
    struct rig forward, loop;

    make(&forward, &apc_law_leadlag, (struct apc_dim){1, 0, 1, 0}, NULL, 0);
    make(&loop, &apc_law_pid, (struct apc_dim){2, 1, 1, 0}, &setting, 1);
    forward.tuning[0] = gain;
    forward.tuning[1] = lead;
    forward.tuning[2] = lag;
    loop.tuning[0] = 0.5;
    loop.tuning[11] = 1.0; /* Kff */
    laws_reset(forward.law, &forward.c);
    laws_reset(loop.law, &loop.c);
    for (int k = 0; k < 400; k++) {
        const double d = k < 20 ? 0.0 : 1.0;

        forward.y[0] = d;
        loop.y[0] = from_u + from_d;
        loop.y[1] = tick(&forward); /* a calculated signal, and the loop's second measurement */
        worst = fmax(worst, fabs(loop.y[0]));
        (void)tick(&loop);
        from_u += -expm1(-H / 10.0) * (2.0 * loop.u[0] - from_u);
        from_d += -expm1(-H / 4.0) * (d - from_d);
    }
    assert_near(from_u + from_d, 0.0, 1e-3);
    return worst;
}

/* Promise(laws/blocks) */
static void feed_forward_with_lead_and_lag_keeps_a_disturbance_from_the_loop(void **state)
{
    const double none = worst_deviation(0.0, 0.0, 0.0), gain = worst_deviation(0.0, 0.0, -0.5),
                 both = worst_deviation(10.0, 4.0, -0.5);

    (void)state;
    assert_true(gain < 0.8 * none);
    assert_true(both < 0.2 * gain);
}

/* ---- Filter --------------------------------------------------------------------------------------- */

/* Promise(laws/blocks) */
static void a_filter_goes_to_its_measurement_with_tau(void **state)
{
    struct rig r;

    (void)state;
    make(&r, &apc_law_filter, (struct apc_dim){1, 1, 1, 0}, NULL, 0);
    r.tuning[0] = 2.0;
    r.y[0] = 10.0;
    laws_reset(r.law, &r.c);
    assert_near(tick(&r), 10.0, 0.0);
    r.y[0] = 20.0;
    for (int k = 1; k <= 30; k++)
        assert_near(tick(&r), 20.0 - 10.0 * pow(2.0 / (2.0 + H), k), 1e-9);
    r.tuning[0] = 0.0;
    r.y[0] = -3.0;
    assert_near(tick(&r), -3.0, 1e-12);
    assert_int_equal(apc_instances_ports(r.law, 0)->nz, 0);
}

/* Every tenth tick: filtered as much as ten periods' worth, and not again in between. */
/* Promise(laws/blocks) */
static void a_sample_that_comes_seldom_counts_once(void **state)
{
    struct rig r;
    double expected = 0.0;

    (void)state;
    make(&r, &apc_law_filter, (struct apc_dim){1, 0, 1, 0}, NULL, 0);
    r.tuning[0] = 8.0;
    laws_reset(r.law, &r.c);
    (void)tick(&r);
    for (int k = 1; k <= 60; k++) {
        r.is_new[0] = k % 10 == 0;
        r.y[0] = r.is_new[0] ? 1.0 + k / 10 : r.y[0];
        if (r.is_new[0])
            expected += 10.0 * H / (8.0 + 10.0 * H) * (r.y[0] - expected);
        assert_near(tick(&r), expected, 1e-12);
    }
}

/* Promise(laws/blocks) */
static void what_lies_outside_its_range_is_no_measurement(void **state)
{
    char why[APC_LAW_WHY];
    struct apc_error refused;
    struct rig r;

    (void)state;
    make(&r, &apc_law_filter, (struct apc_dim){1, 0, 1, 0}, NULL, 0);
    r.tuning[1] = -50.0;
    r.tuning[2] = 150.0;
    r.c.why = why;
    for (double y = -50.0; y <= 150.0; y += 200.0) {
        r.y[0] = y;
        assert_int_equal(apc_instances_compute(r.law, 0, &r.c), APC_LAW_GOOD);
        r.y[0] = y < 0.0 ? -50.5 : 150.5;
        assert_int_equal(apc_instances_compute(r.law, 0, &r.c), APC_LAW_INFEASIBLE);
        assert_string_equal(why, y < 0.0 ? "has -50.5, not within -50 to 150"
                                         : "has 150.5, not within -50 to 150");
    }
    r.u[0] = 30.0; /* held meanwhile: it goes on from there */
    laws_track(r.law, &r.c);
    r.tuning[0] = 4.5;
    r.y[0] = 40.0;
    assert_near(tick(&r), 31.0, 1e-12);
    r.tuning[1] = 151.0;
    assert_int_equal(apc_instances_check(r.law, r.tuning, &refused), APC_ERANGE);
    assert_non_null(strstr(refused.text, "valid_low = 151 is above valid_high = 150"));
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test_teardown(the_least_or_the_greatest_good_input_is_selected, laws_end),
        cmocka_unit_test_teardown(each_output_has_inputs_of_its_own, laws_end),
        cmocka_unit_test_teardown(a_selector_that_makes_no_sense_is_refused, laws_end),
        cmocka_unit_test_teardown(override_control_neither_winds_up_nor_keeps_the_loser_from_winning,
                                  laws_end),
        cmocka_unit_test_teardown(each_output_moves_over_its_part_of_the_demand, laws_end),
        cmocka_unit_test_teardown(the_demand_may_be_any_measurement, laws_end),
        cmocka_unit_test_teardown(a_setpoint_moves_at_its_rate_and_within_its_limits, laws_end),
        cmocka_unit_test_teardown(lead_and_lag_answer_a_step_as_the_formula_says, laws_end),
        cmocka_unit_test_teardown(lead_and_lag_go_on_from_what_was_given, laws_end),
        cmocka_unit_test_teardown(feed_forward_with_lead_and_lag_keeps_a_disturbance_from_the_loop, laws_end),
        cmocka_unit_test_teardown(a_filter_goes_to_its_measurement_with_tau, laws_end),
        cmocka_unit_test_teardown(a_sample_that_comes_seldom_counts_once, laws_end),
        cmocka_unit_test_teardown(what_lies_outside_its_range_is_no_measurement, laws_end),
    };

    return cmocka_run_group_tests(tests, NULL, NULL);
}

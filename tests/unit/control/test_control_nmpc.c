/* SPDX-License-Identifier: BSD-3-Clause */
/* Law nmpc on the adiabatic reactor, whose steady states between the folds are unstable: loads that nobody
 * measures, limits, rates, an output by hand, a restart. */
/*
 * Promise(laws/nmpc): `nmpc`: rests at unstable steady states, no offset over the whole range, finds what
 *   disturbs, limits and rates, by hand, a restart has the same bits; what is predicted is what the model
 *   does, nodes need not fit.
 */
#include "apclinear.h"
#include "laws.h"
#include "plant/plant_internal.h"

#include <string.h>

#define SEED 20260902u

enum { STATES_MOST = 2048, PUBLISHED_MOST = 512, AHEAD_MOST = 64, TUNING = 12 };
enum { MOVE, REFERENCE_WEIGHT, REFERENCE, COST, U_MIN, U_MAX, DU_MAX, WEIGHT, ZONE, Y_MIN, Y_MAX, SERVICE };

static const double Ts = 1.0, delay = 0.4, late = 3.4, horizon = 40.0, deviation[] = {1.0, 50.0},
                    of_y[] = {0.02}, of_x[] = {0.0002, 0.0002, 0.005}, of_d[] = {0.05},
                    feed_temperature[] = {4.0}, four = 4.0;

struct rig {
    struct apc_law_setup setup;
    struct apc_law_plant view;
    struct apc_setting setting[16];
    double A[9], B[12], C[3], D[4], B1[3], D1[1], x0[3], u0[4], y0[1];
    struct apc_plant *plant;
    double dead_time, line[8]; /* outputs on their way to the plant, the youngest first */
    double between[1], y[1], z[AHEAD_MOST], d[AHEAD_MOST], u[1], x[STATES_MOST], tuning[TUNING], u_last[1],
        low[1], high[1], rate[1], y_low[1], y_high[1], published[PUBLISHED_MOST];
    apc_status y_status[1];
    bool y_new[1];
    enum apc_law_output out[1];
    unsigned limited[1];
    char why[APC_LAW_WHY];
    struct apc_instances *law;
    struct apc_law_call c;
    int result;
};

static struct apc_setting number(const char *name, const double *value, size_t n)
{
    return (struct apc_setting){.name = name, .rows = 1, .columns = n, .value = value};
}

static void set_point(struct rig *r, double z)
{
    for (size_t i = 0; i < AHEAD_MOST; i++)
        r->z[i] = z;
}

/* Its linear model at 500 mL/min, and the plant there. */
static void prepare(struct rig *r)
{
    const struct apc_model *m = &apc_model_adiabatic_cstr;
    const struct apc_plant_options how = {.size = sizeof how, .integrator = "cvode"};
    struct apc_error why;

    memset(r, 0, sizeof *r);
    memcpy(r->u0, (const double[]){500.0, 0.8, 1.2, 0.5}, sizeof r->u0);
    memcpy(r->x0, (const double[]){0.515, 0.63, 38.6}, sizeof r->x0);
    assert_int_equal(apc_model_equilibrium(m, NULL, r->u0, r->x0, &why), 0);
    assert_int_equal(apc_model_linearize(m, NULL, r->x0, r->u0, r->A, r->B, r->C, r->D, &why), 0);
    for (size_t i = 0; i < 3; i++)
        r->B1[i] = r->B[4 * i];
    r->y0[0] = r->x0[2];
    r->view = (struct apc_law_plant){.nx = 3,
                                     .A = r->A,
                                     .B = r->B1,
                                     .C = r->C,
                                     .D = r->D1,
                                     .x0 = r->x0,
                                     .u0 = r->u0,
                                     .y0 = r->y0,
                                     .model = m};
    const struct apc_setting setting[] = {number("horizon", &horizon, 1),
                                          number("y_scale", deviation, 1),
                                          number("u_scale", deviation + 1, 1),
                                          number("y_noise", of_y, 1),
                                          number("x_noise", of_x, 3),
                                          number("d_noise", of_d, 1),
                                          number("at_input", feed_temperature, 1),
                                          number("delay", &delay, 1),
                                          number("steps", &four, 1)};
    memcpy(r->setting, setting, sizeof setting);
    r->setup = (struct apc_law_setup){.size = sizeof r->setup,
                                      .dim = {.ny = 1, .nz = 1, .nu = 1},
                                      .Ts = Ts,
                                      .n_setting = sizeof setting / sizeof *setting,
                                      .setting = r->setting,
                                      .plant = &r->view};
    assert_int_equal(apc_plant_create(&r->plant, m, NULL, r->x0, &how, &why), 0);
    r->dead_time = delay;
    for (size_t k = 0; k < 8; k++)
        r->line[k] = r->u0[0];
    r->u[0] = r->u_last[0] = r->u0[0];
    r->high[0] = 1000.0;
    r->rate[0] = HUGE_VAL;
    r->y_low[0] = -HUGE_VAL;
    r->y_high[0] = HUGE_VAL;
    r->y_new[0] = true;
    r->out[0] = APC_OUT_LAW;
    r->y[0] = r->y0[0];
    set_point(r, r->y0[0]);
}

static void make(struct rig *r)
{
    struct apc_error why = {""};

    if (laws_make(&r->law, &apc_law_nmpc, &r->setup, &why) < 0)
        fail_msg("%s", why.text);
    const struct apc_instances_size size = apc_instances_size(r->law);
    assert_in_range(size.states, 1, STATES_MOST);
    assert_in_range(size.published, 1, PUBLISHED_MOST);
    assert_in_range(size.n_ahead, 1, AHEAD_MOST);
    assert_int_equal(size.tuning, TUNING);
    for (size_t i = 0; i < TUNING; i++)
        r->tuning[i] = apc_law_nmpc.tuning[i].initial;
    r->tuning[MOVE] = 0.5;
    r->c = (struct apc_law_call){.size = sizeof r->c,
                                 .dim = r->setup.dim,
                                 .Ts = Ts,
                                 .y = r->y,
                                 .z = r->z,
                                 .d = r->d,
                                 .tuning = r->tuning,
                                 .x = r->x,
                                 .u = r->u,
                                 .limited = r->limited,
                                 .y_status = r->y_status,
                                 .y_new = r->y_new,
                                 .n_ahead = size.n_ahead,
                                 .low = r->low,
                                 .high = r->high,
                                 .rate = r->rate,
                                 .y_low = r->y_low,
                                 .y_high = r->y_high,
                                 .u_last = r->u_last,
                                 .out = r->out,
                                 .published = r->published,
                                 .why = r->why,
                                 .budget = 0.5};
    apc_instances_reset(r->law, 0, &r->c);
}

static void begin(struct rig *r)
{
    prepare(r);
    make(r);
}

/* A period of the plant; each output acts after the dead time. */
static void pass(struct rig *r, double u)
{
    const size_t periods = (size_t)r->dead_time;
    const double bit = r->dead_time - (double)periods;

    memmove(r->line + 1, r->line, sizeof r->line - sizeof *r->line);
    r->line[0] = u;
    assert_int_equal(apc_plant_advance(r->plant, bit, &r->line[periods + 1]), 0);
    apc_plant_output(r->plant, &r->line[periods + 1], r->between);
    assert_int_equal(apc_plant_advance(r->plant, Ts - bit, &r->line[periods]), 0);
    apc_plant_output(r->plant, &r->line[periods], r->y);
}

static void act(struct rig *r)
{
    r->limited[0] = 0;
    apc_instances_update(r->law, 0, &r->c);
    pass(r, r->u[0]);
    r->u_last[0] = r->u[0];
}

static void tick(struct rig *r)
{
    r->result = apc_instances_compute(r->law, 0, &r->c);
    if (r->out[0] != APC_OUT_LAW)
        r->u[0] = r->u_last[0];
    assert_true(r->u[0] >= r->low[0] && r->u[0] <= r->high[0]);
    assert_true(fabs(r->u[0] - r->u_last[0]) <= r->rate[0] * Ts + 1e-9);
    act(r);
}

static void run(struct rig *r, int ticks)
{
    for (int k = 0; k < ticks; k++) {
        tick(r);
        if (r->result != APC_LAW_GOOD)
            fail_msg("tick %d: %s", k, r->why);
    }
}

static void it_rests_at_an_unstable_steady_state(void **state)
{
    struct rig r;
    (void)state;

    begin(&r);
    run(&r, 200);
    assert_near(r.u[0], 500.0, 1e-3);
    assert_near(r.y[0], r.y0[0], 1e-5);
    apc_plant_destroy(r.plant);
}

static void from_one_end_to_the_other_no_offset_remains_whatever_disturbs(void **state)
{
    struct rig r;
    (void)state;

    begin(&r);
    set_point(&r, 52.0);
    run(&r, 100);
    assert_near(r.y[0], 52.0, 1e-3);
    assert_int_equal(apc_plant_disturb(r.plant, 2, 2.5),
                     0); /* the feed is warmer, which the law has to find out */
    set_point(&r, 20.0);
    run(&r, 200);
    assert_near(r.y[0], 20.0, 1e-3);
    assert_near(r.published[2 * 40 + 2], 2.0, 0.02); /* Tin.disturbance */
    assert_int_equal(apc_plant_disturb(r.plant, 0, 0.82),
                     0); /* of this it knows nothing: it takes it for a temperature */
    run(&r, 300);
    assert_near(r.y[0], 20.0, 1e-3);
    apc_plant_destroy(r.plant);
}

/* The feed becomes warmer by 2 degrees: how far that moves the reactor. */
static double moved_by_the_feed(struct rig *r)
{
    double most = 0.0;

    run(r, 20);
    assert_int_equal(apc_plant_disturb(r->plant, 2, 2.5), 0);
    for (size_t i = 0; i < AHEAD_MOST; i++)
        r->d[i] = 2.5;
    for (int k = 0; k < 300; k++) {
        run(r, 1);
        most = fmax(most, fabs(r->y[0] - r->y0[0]));
    }
    assert_near(r->y[0], r->y0[0], 1e-3);
    return most;
}

/*
 * Promise(laws/measured-disturbances): Measured disturbances are fed forward by `mpc` and `nmpc`, with the
 *   plant's model as well; one that the plant does not have is refused.
 */
static void a_measured_disturbance_is_fed_forward(void **state)
{
    static const size_t temperature[] = {2};
    static const double at_the_pump = 1.0, little = 0.05;
    struct rig r;
    double unmeasured, measured, B[6], D[2], u0[2];
    (void)state;

    begin(&r);
    unmeasured = moved_by_the_feed(&r);
    apc_plant_destroy(r.plant);

    prepare(&r);
    for (size_t i = 0; i < 3; i++) {
        B[2 * i] = r.B[4 * i];
        B[2 * i + 1] = r.B[4 * i + 3];
    }
    D[0] = D[1] = 0.0;
    u0[0] = r.u0[0];
    u0[1] = r.u0[3];
    r.view.B = B;
    r.view.D = D;
    r.view.u0 = u0;
    r.view.disturbance = temperature;
    r.setup.dim.nd = 1;
    r.setting[5] = number("d_noise", &little, 1);
    r.setting[6] = number("at_input", &at_the_pump, 1);
    for (size_t i = 0; i < AHEAD_MOST; i++)
        r.d[i] = u0[1];
    make(&r);
    measured = moved_by_the_feed(&r);
    assert_true(unmeasured > 0.5);
    assert_true(measured < 0.3 * unmeasured);
    assert_near(r.published[2 * 40 + 2], 0.0, 0.02); /* u1.disturbance: nothing was unknown */
    apc_plant_destroy(r.plant);
}

/* The first plan already is one that comes true, though nothing was known before it. */
static void its_first_plan_comes_true(void **state)
{
    struct rig r;
    (void)state;

    begin(&r);
    set_point(&r, 48.0);
    assert_int_equal(apc_instances_compute(r.law, 0, &r.c), APC_LAW_GOOD);
    for (size_t k = 0; k < 40; k++) {
        pass(&r, r.published[40 + k]);
        if (k >= 7) /* what the delay moved has settled */
            assert_near(r.published[k], r.y[0], 0.05);
    }
    apc_plant_destroy(r.plant);
}

/* Outputs act three periods and a bit late: the plant is unstable there, and a law that did not know would
 * lose it, as the same without it does. */
/* Promise(laws/nmpc-outputs-act) */
static void a_dead_time_of_some_periods_is_in_the_prediction(void **state)
{
    static const double many = 50.0;
    struct rig r;
    double worst = 0.0;
    (void)state;

    for (int knows = 1; knows >= 0; knows--) {
        prepare(&r);
        r.dead_time = late;
        if (knows)
            r.setting[7] = number("delay", &late, 1);
        r.setting[r.setup.n_setting++] = number("newton", &many, 1);
        make(&r);
        for (int k = 0; k < 100; k++) {
            if (k == 10)
                assert_int_equal(apc_plant_disturb(r.plant, 2, 1.0), 0);
            tick(&r);
            worst = fmax(worst, fabs(r.y[0] - r.y0[0]));
        }
        if (!knows) {
            assert_true(worst > 20.0);
            apc_plant_destroy(r.plant);
            continue;
        }
        assert_true(worst < 5.0);
        run(&r, 150);
        assert_near(r.y[0], r.y0[0], 0.01);
        set_point(&r, 42.0);
        assert_int_equal(apc_instances_compute(r.law, 0, &r.c), APC_LAW_GOOD);
        for (size_t k = 0; k < 40; k++) { /* what it plans comes true, its samples being that bit later */
            pass(&r, r.published[40 + k]);
            if (k > 0)
                assert_near(r.published[k - 1], r.between[0], 0.05);
        }
        apc_plant_destroy(r.plant);
    }
}

/* Steps of the search for steady states are counted like changes of the working set. */
/* Promise(laws/nmpc-outputs-act) */
static void a_search_that_takes_too_many_steps_is_late_and_goes_on(void **state)
{
    static const double few = 3.0;
    struct rig r;
    int ticks = 0;
    (void)state;

    prepare(&r);
    r.setting[r.setup.n_setting++] = number("iterations", &few, 1);
    make(&r);
    run(&r, 20);
    set_point(&r, 62.0);
    do {
        tick(&r);
        if (r.result != APC_LAW_LATE)
            continue;
        assert_non_null(strstr(r.why, "no plan in time, after "));
        assert_in_range(++ticks, 1, 20);
    } while (r.result == APC_LAW_LATE);
    assert_true(ticks > 0);
    for (int k = 0; k < 150; k++)
        tick(&r);
    assert_near(r.y[0], 62.0, 0.01);
    apc_plant_destroy(r.plant);
}

/* Its time is over after so many evaluations of the model; 0: never. */
static long evaluations, most_evaluations;
static apc_ns over;

static int f_that_takes_time(double t, const double *x, const double *u, const double *p, double *dx)
{
    if (++evaluations == most_evaluations)
        while (apc_clock_mono(NULL) <= over)
            ;
    return apc_model_adiabatic_cstr.f(t, x, u, p, dx);
}

/* Wherever in a tick its time is over, also while it looks how a price bends. */
static void without_time_the_former_plan_goes_on(void **state)
{
    static const double one = 1.0;
    struct apc_model model = apc_model_adiabatic_cstr;
    struct rig r;
    long of_a_tick;
    int late_ticks = 0;
    (void)state;

    prepare(&r);
    model.f = f_that_takes_time;
    r.view.model = &model;
    r.setting[r.setup.n_setting++] = number("economic", &one, 1);
    set_point(&r, -1e-3);
    make(&r);
    run(&r, 10);
    evaluations = 0;
    run(&r, 1);
    of_a_tick = evaluations;
    for (long tenth = 1; tenth < 10; tenth++) {
        evaluations = 0;
        most_evaluations = of_a_tick * tenth / 10;
        r.c.deadline = over = apc_clock_mono(NULL) + 30 * APC_NS_PER_MS;
        tick(&r);
        if (r.result != APC_LAW_LATE && r.result != APC_LAW_GOOD)
            fail_msg("after %ld tenths: %s", tenth, r.why);
        late_ticks += r.result == APC_LAW_LATE;
        most_evaluations = r.c.deadline = 0;
        run(&r, 2);
    }
    assert_true(late_ticks >= 5);
    apc_plant_destroy(r.plant);
}

/* Nothing brings it there: neither is it judged by that, nor does a price go along with it in Man. */
static void what_has_a_price_is_not_the_measurement_of_a_loop(void **state)
{
    static const double one = 1.0;
    struct apc_error why = {""};
    struct apc_pair pair;
    struct rig r;
    (void)state;

    prepare(&r);
    assert_int_equal(apc_law_pairing(&apc_law_nmpc, &r.setup, &pair, &why), 0);
    assert_true(pair.measurement == 1 && pair.setpoint == 1);
    r.setting[r.setup.n_setting++] = number("economic", &one, 1);
    assert_int_equal(apc_law_pairing(&apc_law_nmpc, &r.setup, &pair, &why), 0);
    assert_true(pair.measurement == 0 && pair.setpoint == 1);
    apc_plant_destroy(r.plant);
}

static void limits_and_rates_hold_and_a_limit_of_y_comes_before_its_setpoint(void **state)
{
    struct rig r;
    double most = 0.0;
    (void)state;

    begin(&r);
    r.rate[0] = 20.0;
    r.tuning[Y_MAX] = 45.0;
    set_point(&r, 48.0);
    for (int k = 0; k < 200; k++) {
        tick(&r); /* looks at limits and rate */
        assert_int_equal(r.result, APC_LAW_SUBOPTIMAL);
        assert_non_null(strstr(r.why, "nearest"));
        most = fmax(most, r.y[0]);
    }
    assert_true(most < 45.05);
    assert_near(r.y[0], 45.0, 0.01);
    apc_plant_destroy(r.plant);
}

static void limits_of_a_measurement_that_cannot_be_kept_are_told_with_their_rank(void **state)
{
    struct rig r;
    (void)state;

    begin(&r);
    run(&r, 5);
    r.tuning[Y_MAX] = 37.0; /* it stands above, and the feed takes a while */
    r.rate[0] = 5.0;
    set_point(&r, 36.0);
    tick(&r);
    assert_int_equal(r.result, APC_LAW_SUBOPTIMAL);
    assert_string_equal(r.why, "limits of measurements of rank 1 cannot be kept");
    for (int k = 0; k < 150; k++)
        tick(&r);
    assert_int_equal(r.result, APC_LAW_GOOD);
    assert_near(r.y[0], 36.0, 0.02);
    apc_plant_destroy(r.plant);
}

/* The controller's model, which a test can break; the plant's own goes on. */
enum { WHOLE, NO_NUMBER, NOT_DEFINED };
static int broken;

static int f_or_not(double t, const double *x, const double *u, const double *p, double *dx)
{
    const int rc = apc_model_adiabatic_cstr.f(t, x, u, p, dx);

    if (broken == NO_NUMBER)
        dx[2] = (double)NAN;
    return broken == NOT_DEFINED ? 1 : rc;
}

static void a_model_that_gives_no_number_gives_no_output_and_is_told(void **state)
{
    static const int ways[] = {NO_NUMBER, NOT_DEFINED};
    struct apc_model model = apc_model_adiabatic_cstr;
    struct apc_error why = {""};
    struct rig r;
    (void)state;

    model.f = f_or_not;
    for (size_t way = 0; way < 2; way++) {
        begin(&r);
        r.view.model = &model;
        if (laws_make(&r.law, &apc_law_nmpc, &r.setup, &why) < 0)
            fail_msg("%s", why.text);
        apc_instances_reset(r.law, 0, &r.c);
        run(&r, 10);
        broken = ways[way];
        for (int k = 0; k < 5; k++) {
            r.result = apc_instances_compute(r.law, 0, &r.c);
            assert_int_equal(r.result, APC_LAW_INFEASIBLE);
            assert_non_null(strstr(r.why, "no plan: "));
            r.u[0] = r.u_last[0]; /* as the controller does then */
            act(&r);
            for (size_t i = 0; i < apc_instances_size(r.law).states; i++)
                assert_true(isfinite(r.x[i]));
        }
        broken = WHOLE;
        run(&r, 60);
        assert_near(r.y[0], r.y0[0], 0.05);
        apc_plant_destroy(r.plant);
    }
}

static void too_few_steps_for_a_stiff_model_are_refused_and_it_says_how_many(void **state)
{
    static const double two = 2.0, twelve = 12.0;
    struct apc_error why = {""};
    struct rig r;
    (void)state;

    prepare(&r);
    r.setting[8] = number("steps", &two, 1);
    assert_int_equal(laws_make(&r.law, &apc_law_nmpc, &r.setup, &why), 0);
    r.A[0] -= 30.0; /* a mode of 33 ms; steps of Ts / 11 and less hold */
    assert_int_equal(laws_make(&r.law, &apc_law_nmpc, &r.setup, &why), APC_EINVAL);
    assert_non_null(
        strstr(why.text, "setting \"steps\": with 2 in a period of 1 s the integration blows up"));
    assert_non_null(strstr(why.text, "take 11 or more"));
    r.setting[8] = number("steps", &twelve, 1);
    assert_int_equal(laws_make(&r.law, &apc_law_nmpc, &r.setup, &why), 0);
    r.A[0] = -1e5;
    assert_int_equal(laws_make(&r.law, &apc_law_nmpc, &r.setup, &why), APC_EINVAL);
    assert_non_null(strstr(why.text, "too stiff"));
    apc_plant_destroy(r.plant);
}

static void by_hand_it_goes_along_and_comes_back_without_a_bump(void **state)
{
    struct rig r;
    (void)state;

    begin(&r);
    run(&r, 20);
    r.out[0] = APC_OUT_GIVEN;
    for (int k = 0; k < 5; k++) {
        r.u_last[0] = 505.0;
        tick(&r);
    }
    r.out[0] = APC_OUT_LAW;
    const double before = r.u_last[0], off = fabs(r.y[0] - r.y0[0]);
    tick(&r);
    assert_true(fabs(r.u[0] - before) < 60.0 * off + 10.0);
    run(&r, 150);
    assert_near(r.y[0], r.y0[0], 1e-3);
    apc_plant_destroy(r.plant);
}

static void the_bits_do_not_depend_on_a_restart(void **state)
{
    struct rig one, other;
    struct apc_random noise;
    struct apc_error why;
    (void)state;

    begin(&one);
    begin(&other);
    apc_random_init(&noise, SEED, "restart");
    for (int k = 0; k < 60; k++) {
        const double by = 0.02 * apc_random_normal(&noise);

        if (k == 10 || k == 35) {
            set_point(&one, k == 10 ? 45.0 : 30.0);
            set_point(&other, k == 10 ? 45.0 : 30.0);
        }
        one.y[0] += by;
        other.y[0] += by;
        one.result = apc_instances_compute(one.law, 0, &one.c);
        other.result = apc_instances_compute(other.law, 0, &other.c);
        assert_memory_equal(one.u, other.u, sizeof one.u);
        assert_memory_equal(one.published, other.published, sizeof one.published);
        if (k % 3 == 0) { /* after u went out and before x was updated: the successor does that */
            apc_instances_destroy(laws_kept[1]);
            laws_n_kept = 1;
            assert_int_equal(laws_make(&other.law, &apc_law_nmpc, &other.setup, &why), 0);
        }
        act(&one);
        act(&other);
        assert_memory_equal(one.x, other.x, sizeof one.x);
    }
    apc_plant_destroy(one.plant);
    apc_plant_destroy(other.plant);
}

static void what_makes_no_sense_is_refused_with_a_sentence(void **state)
{
    static const double one = 1.0, zero = 0.0, fifty = 50.0, ages = 2000.0, nowhere[] = {2.0, 1.0, 1.0},
                        idle[] = {1.0, 0.0, 1.0}, five[] = {5.0}, nothing[] = {0.0}, minus[] = {-1.0};
    const struct {
        struct apc_setting instead;
        const char *says;
    } refused[] = {
        {number("delay", &fifty, 1), "longer than the dead time"},
        {number("delay", &ages, 1), "it must be from 0 to 1000 periods of 1 s"},
        {number("steps", &zero, 1), "steps"},
        {number("at_input", five, 1), "at_input"},
        {number("y_noise", nothing, 1), "setting \"y_noise\""},
        {number("x_noise", minus, 1), "3 numbers"},
        {number("d_noise", minus, 1), "d_noise"},
        {number("newton", &zero, 1), "newton"},
        {number("terminal", five, 1), "terminal"},
        {number("lower", nowhere, 3), "output 1: there is no measurement 2"},
        {number("lower", idle, 3), "the loop below has a gain of 0"},
        {number("lower", &one, 1), "1 rows, of each output [measurement, gain, integral time]"},
        {number("steady", &one, 1), "an extended filter has no gain that stays; leave it out"},
    };
    struct apc_error why;
    struct rig r;
    (void)state;

    for (size_t i = 0; i < sizeof refused / sizeof *refused; i++) {
        size_t k = 0;

        prepare(&r);
        while (k < r.setup.n_setting && strcmp(r.setting[k].name, refused[i].instead.name) != 0)
            k++;
        r.setting[k] = refused[i].instead;
        r.setup.n_setting += k == r.setup.n_setting;
        assert_true(laws_make(&r.law, &apc_law_nmpc, &r.setup, &why) < 0);
        if (!strstr(why.text, refused[i].says))
            fail_msg("number %zu: \"%s\" does not say \"%s\"", i, why.text, refused[i].says);
        apc_plant_destroy(r.plant);
    }
    prepare(&r);
    r.view.model = NULL;
    assert_int_equal(laws_make(&r.law, &apc_law_nmpc, &r.setup, &why), APC_EINVAL);
    assert_non_null(strstr(why.text, "law nmpc: the plant's equations are not known"));
    apc_plant_destroy(r.plant);
}

int main(void)
{
#define TEST(name) cmocka_unit_test_teardown(name, laws_end)
    const struct CMUnitTest tests[] = {
        TEST(it_rests_at_an_unstable_steady_state),
        TEST(from_one_end_to_the_other_no_offset_remains_whatever_disturbs),
        TEST(a_measured_disturbance_is_fed_forward),
        TEST(its_first_plan_comes_true),
        TEST(a_dead_time_of_some_periods_is_in_the_prediction),
        TEST(a_search_that_takes_too_many_steps_is_late_and_goes_on),
        TEST(without_time_the_former_plan_goes_on),
        TEST(what_has_a_price_is_not_the_measurement_of_a_loop),
        TEST(limits_and_rates_hold_and_a_limit_of_y_comes_before_its_setpoint),
        TEST(limits_of_a_measurement_that_cannot_be_kept_are_told_with_their_rank),
        TEST(a_model_that_gives_no_number_gives_no_output_and_is_told),
        TEST(too_few_steps_for_a_stiff_model_are_refused_and_it_says_how_many),
        TEST(by_hand_it_goes_along_and_comes_back_without_a_bump),
        TEST(the_bits_do_not_depend_on_a_restart),
        TEST(what_makes_no_sense_is_refused_with_a_sentence),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}

/* SPDX-License-Identifier: BSD-3-Clause */
/* The figures of a loop, on courses whose figures are known by hand; statistics over runs. */
#include "check.h"

#include <stdlib.h>
#include <string.h>

#include "apc/simulate/statistic.h"
#include "figures/figures.h"
#include "scratch.h"

static struct signal signals[3][2];
static struct experiment e;
static struct controller controller;
static struct trajectory trajectory;
static struct figures figures;

static int begin(void **state)
{
    const struct apc_dim dim = {.ny = 1, .nz = 1, .nu = 1};
    (void)state;
    static struct wire y[] = {{APC_SENSOR, 0}, {APC_SENSOR, 1}}, z[] = {{APC_SETPOINT, 0}, {APC_SETPOINT, 1}},
                       u[] = {{APC_ACTUATOR, 0}, {APC_ACTUATOR, 1}};
    controller = (struct controller){
        .rhythm.period = APC_NS_PER_S, .dim = dim, .y = y, .z = z, .u = u, .first_loop = 1};
    e = (struct experiment){.dim = dim,
                            .y = signals[0],
                            .z = signals[1],
                            .u = signals[2],
                            .controllers = &controller,
                            .n_controllers = 1};
    e.plant.rhythm.period = e.client.rhythm.period = APC_NS_PER_S;
    for (int i = 0; i < 2; i++)
        signals[1][i].tag = (struct apc_tag){.low = -APC_VALUE_MAX, .high = APC_VALUE_MAX};
    figures = (struct figures){0};
    return trajectory_create(&trajectory, &dim);
}

static int end(void **state)
{
    (void)state;
    figures_free(&figures);
    trajectory_free(&trajectory);
    return 0;
}

static void setpoint(double t, double value)
{
    trajectory_change(&trajectory, &trajectory.setpoint[0], t, value);
}

static void output(double t, double value)
{
    trajectory_add(&trajectory, &trajectory.output[0], t, value);
}

static void make(double until)
{
    trajectory.end = until;
    figures_free(&figures);
    assert_int_equal(figures_make(&figures, &trajectory, &e), 0);
}

static double of(size_t part, enum metric metric)
{
    assert_true(part < figures.n_parts);
    return figures.of[0].part[part].figure[metric];
}

static double whole(enum metric metric)
{
    return figures.of[0].figure[metric];
}

/* r goes from 0 to 10 at 1 s and to 6 at 10 s; z follows in straight lines. */
/* Promise(simulation/figures-plant-true) */
static void figures_are_those_by_hand(void **state)
{
    (void)state;
    setpoint(0, 0);
    setpoint(1, 10);
    setpoint(10, 6);
    output(0, 0);
    output(1, 0);
    output(3, 12); /* crosses 10 at 2.666 */
    output(4, 10);
    output(9, 10.5);
    output(10, 10);
    output(12, 6);
    trajectory_change(&trajectory, &trajectory.input[0], 0, 1);
    trajectory_change(&trajectory, &trajectory.input[0], 1, 3);
    trajectory_change(&trajectory, &trajectory.input[0], 4, 2.5);
    trajectory_change(&trajectory, &trajectory.input[0], 11, 4);
    trajectory_change(&trajectory, &trajectory.without, 0, 1);
    trajectory_change(&trajectory, &trajectory.without, 0.5, 0);
    trajectory_change(&trajectory, &trajectory.without, 15, 1);
    make(20);
    assert_int_equal(figures.n_parts, 3);

    /* the start is no step: the setpoint was where the output is */
    assert_false(figures.of[0].part[0].step);
    assert_near(of(0, METRIC_IAE), 0, 0);
    assert_true(isnan(of(0, METRIC_OVERSHOOT)) && isnan(of(0, METRIC_SETTLING)));
    assert_near(of(0, METRIC_PEAK), 0, 0);
    assert_near(of(0, METRIC_RECOVERY), 0, 0);
    assert_near(of(0, METRIC_EFFORT), 2, 0); /* at 1 s: what is done then answers what was before */
    assert_near(of(0, METRIC_UNCONTROLLED), 50, 1e-12);

    /* |r - z|: a triangle of 10 over 5/3 s, one of 2 over 1/3 s, one of 2 over 1 s, one of 0.5 over 5 s and 1
     * s */
    assert_near(of(1, METRIC_IAE), 25.0 / 3 + 1.0 / 3 + 1 + 1.25 + 0.25, 1e-9);
    assert_near(of(1, METRIC_ISE), 500.0 / 9 + 4.0 / 9 + 4.0 / 3 + 1.25 / 3 + 0.25 / 3, 1e-9);
    /* area times the time of its centre of mass, counted from 1 s */
    assert_near(of(1, METRIC_ITAE),
                25.0 / 3 * (5.0 / 9) + 1.0 / 3 * (5.0 / 3 + 2.0 / 9) + 1 * (2 + 1.0 / 3) +
                    1.25 * (3 + 10.0 / 3) + 0.25 * (8 + 1.0 / 3),
                1e-9);
    assert_near(of(1, METRIC_OVERSHOOT), 20, 1e-9);
    assert_near(of(1, METRIC_SETTLING), 3, 1e-9); /* from the tick at 4 s on: 10.5 is still within 5 % */
    assert_true(isnan(of(1, METRIC_PEAK)) && isnan(of(1, METRIC_RECOVERY)));
    assert_near(of(1, METRIC_EFFORT), 0.5, 0);
    assert_near(of(1, METRIC_UNCONTROLLED), 0, 0);

    /* 4 to 0 over 2 s; after its last tick the output stays */
    assert_near(of(2, METRIC_IAE), 4, 1e-9);
    assert_near(of(2, METRIC_ITAE), 4 * 2.0 / 3, 1e-9);
    assert_near(of(2, METRIC_OVERSHOOT), 0, 0);
    assert_near(of(2, METRIC_SETTLING), 2, 1e-9);
    assert_near(of(2, METRIC_EFFORT), 1.5, 0);
    assert_near(of(2, METRIC_UNCONTROLLED), 50, 1e-9);

    assert_near(whole(METRIC_IAE), of(1, METRIC_IAE) + 4, 1e-9);
    assert_near(whole(METRIC_ISE), of(0, METRIC_ISE) + of(1, METRIC_ISE) + of(2, METRIC_ISE), 1e-9);
    assert_near(whole(METRIC_OVERSHOOT), 20, 1e-9);
    assert_near(whole(METRIC_SETTLING), 3, 1e-9);
    assert_near(whole(METRIC_PEAK), 0, 0);
    assert_near(whole(METRIC_EFFORT), 4, 0);
    assert_near(whole(METRIC_UNCONTROLLED), 100 * 5.5 / 20, 1e-9);
}

static void ramp(double t, double target, double rate)
{
    trajectory_add(&trajectory, &trajectory.target[0], t, target);
    trajectory_add(&trajectory, &trajectory.rate[0], t, rate);
}

/* From 2 at 1 s to 10 at 1/s, which arrives; from 10 at 20 s to 2, which somebody ends at 22 s by writing 5. */
static void a_ramp_is_one_event_and_no_step(void **state)
{
    char name[80];
    (void)state;
    setpoint(0, 2);
    ramp(1, 10, 1);
    for (int k = 1; k <= 32; k++)
        setpoint(1 + k / 4.0, 2 + k / 4.0);
    trajectory_add(&trajectory, &trajectory.rate[0], 9, 0);
    ramp(20, 2, 1);
    for (int k = 1; k < 8; k++)
        setpoint(20 + k / 4.0, 10 - k / 4.0);
    setpoint(22, 5);
    trajectory_add(&trajectory, &trajectory.rate[0], 22, 0);
    for (int k = 0; k <= 160; k++) {
        const double t = k / 4.0;
        output(t, t < 1 ? 2 : t < 9 ? 1 + t : t < 20 ? 10 : t < 22 ? 30 - t : 5);
    }
    make(40);
    assert_int_equal(figures.n_parts, 4); /* the start, two ramps, a step */
    const struct part *part = figures.of[0].part;
    assert_near(part[1].from, 1, 0);
    assert_near(part[2].from, 20, 0);
    assert_near(part[3].from, 22, 0);
    assert_false(part[1].step || part[2].step);
    assert_true(part[3].step);
    assert_true(isnan(part[1].figure[METRIC_OVERSHOOT]));
    assert_near(part[1].figure[METRIC_PEAK], 0.25, 1e-12);
    assert_near(part[1].figure[METRIC_IAE], 32 * 0.25 * 0.25 / 2, 1e-9);
    assert_near(part[1].figure[METRIC_RECOVERY], 0, 0); /* never far: 5 % of the largest, 8 */
    figures_name_part(&figures, &part[1], &e, name, sizeof name);
    assert_string_equal(name, " 2 -> 10 in 8 s");
    figures_name_part(&figures, &part[2], &e, name, sizeof name);
    assert_string_equal(name, " 10 -> 8.25 in 1.75 s");
    figures_name_part(&figures, &part[3], &e, name, sizeof name);
    assert_string_equal(name, " 8.25 -> 5");
}

static void a_run_of_less_than_a_second_has_all_its_figures(void **state)
{
    (void)state;
    setpoint(0, 1);
    output(0, 0);
    output(0.25, 1);
    trajectory_change(&trajectory, &trajectory.input[0], 0, 1);
    trajectory_change(&trajectory, &trajectory.input[0], 0.125, 3);
    trajectory_change(&trajectory, &trajectory.without, 0, 1);
    trajectory_change(&trajectory, &trajectory.without, 0.125, 0);
    make(0.5);
    assert_near(whole(METRIC_IAE), 0.125, 1e-12);
    assert_near(whole(METRIC_SETTLING), 0.25, 0);
    assert_near(whole(METRIC_EFFORT), 2, 0);
    assert_near(whole(METRIC_UNCONTROLLED), 25, 1e-12);
}

static void settling_ends_with_the_first_tick_from_which_on_it_is_near(void **state)
{
    (void)state;
    setpoint(0, 10);
    output(0, 0);
    output(1, 9.4);
    output(2, 9.51);
    output(3, 9.49);
    output(4, 9.52);
    output(5, 10);
    make(6);
    assert_near(of(0, METRIC_SETTLING), 4, 0);
    output(6, 9.4);
    make(6); /* the tick at the end belongs to it */
    assert_true(isinf(of(0, METRIC_SETTLING)) && isinf(whole(METRIC_SETTLING)));
    make(5.5);
    assert_near(of(0, METRIC_SETTLING), 4, 0);
}

/* Promise(simulation/figures-plant-true) */
static void a_loop_that_does_not_settle_is_infinitely_slow(void **state)
{
    (void)state;
    setpoint(0, 1);
    setpoint(5, 2);
    output(0, 0);
    output(1, 0.9);
    output(6, 2);
    make(10);
    assert_true(isinf(of(0, METRIC_SETTLING)));
    assert_near(of(1, METRIC_SETTLING), 1, 0);
    assert_true(isinf(whole(METRIC_SETTLING)));
    assert_near(of(0, METRIC_OVERSHOOT), 0, 0);
}

static void an_offset_at_the_start_is_no_step_beside_larger_ones(void **state)
{
    (void)state;
    setpoint(0, 10);
    setpoint(2, 20);
    output(0, 9.2);
    output(1, 11);
    output(3, 20.2);
    make(5);
    assert_false(figures.of[0].part[0].step);
    assert_near(of(0, METRIC_PEAK), 1, 1e-9);
    assert_true(isnan(of(0, METRIC_OVERSHOOT)));
    assert_near(whole(METRIC_OVERSHOOT), 2, 1e-9);
    setpoint(4, 20.5); /* neither is a small change later on, but it begins a part of its own */
    make(5);
    assert_int_equal(figures.n_parts, 3);
    assert_false(figures.of[0].part[2].step);
    assert_near(of(2, METRIC_PEAK), 0.3, 1e-9);
    assert_near(of(2, METRIC_RECOVERY), 0, 0); /* 5 % of 10 are near */
}

/* A setpoint that never moves, an output that is 1e-6 away and noisy: no step, so no overshoot of 9050 %. */
static void where_the_setpoint_does_not_move_there_is_no_overshoot(void **state)
{
    (void)state;
    setpoint(0, 6.1315);
    output(0, 6.131501);
    output(1, 6.135);
    output(2, 6.12);
    make(5);
    assert_false(figures.of[0].part[0].step);
    assert_true(isnan(whole(METRIC_OVERSHOOT)) && isnan(whole(METRIC_SETTLING)));
    assert_near(whole(METRIC_PEAK), 0.0115, 1e-12);
    assert_true(isnan(whole(METRIC_RECOVERY))); /* nothing says what is near */
    signals[1][0].tag.low = 0;
    signals[1][0].tag.high = 1; /* 1 % of its range */
    make(5);
    assert_true(isinf(whole(METRIC_RECOVERY)));
    signals[1][0].tag.high = 2;
    make(5);
    assert_near(whole(METRIC_RECOVERY), 0, 0);
    setpoint(3, 7.1315); /* 5 % of a step, once there is one */
    output(3, 6.0);
    output(3.5, 7.13);
    make(5);
    assert_true(isinf(of(0, METRIC_RECOVERY)));
    assert_near(of(1, METRIC_SETTLING), 0.5, 1e-12);
}

/* Promise(simulation/figures-plant-true) */
static void a_disturbance_has_figures_of_its_own(void **state)
{
    static const struct apc_param names[] = {{.name = "load", .initial = 1}};
    static const struct apc_model model = {.name = "m", .nd = 1, .disturbance = names};
    struct apc_disturbance changes[] = {{0, 10 * APC_NS_PER_S, 3},
                                        {0, 20 * APC_NS_PER_S, 3},
                                        {0, 30 * APC_NS_PER_S, 1},
                                        {0, 99 * APC_NS_PER_S, 7}};
    (void)state;
    e.plant.model = &model;
    e.plant.disturbance = changes;
    e.plant.n_disturbances = 4;
    e.plant.rhythm.phase = APC_NS_PER_S / 2; /* times of disturbances are since the plant's first tick */
    setpoint(0, 10);
    output(0.5, 0);
    output(1, 10);
    output(10.5, 10);
    output(11, 8);
    output(12.5, 10.4);
    output(40, 10);
    make(50);
    assert_int_equal(figures.n_parts, 3); /* the second change is none, the last one comes after the end */
    assert_near(figures.of[0].part[1].from, 10.5, 0);
    assert_near(figures.of[0].part[1].to, 30.5, 0);
    assert_near(of(1, METRIC_PEAK), 2, 0);
    assert_near(of(1, METRIC_RECOVERY), 2, 0);
    assert_true(isnan(of(1, METRIC_OVERSHOOT)) && isnan(of(1, METRIC_SETTLING)));
    assert_near(whole(METRIC_PEAK), 2, 0);
    assert_near(whole(METRIC_RECOVERY), 2, 0);
    assert_near(figures.event[1].from, 1, 0);
    assert_near(figures.event[2].from, 3, 0);
}

static void a_setpoint_that_a_controller_moves_begins_no_part_and_is_followed(void **state)
{
    static struct wire w = {APC_SETPOINT, 1}, r = {APC_SETPOINT, 0}, y = {APC_SENSOR, 0};
    const struct apc_dim dim = {.ny = 1, .nz = 2, .nu = 1};
    struct controller both[] = {controller,
                                {.dim = {.ny = 1, .nz = 1, .nu = 1},
                                 .y = &y,
                                 .z = &w,
                                 .u = &r,
                                 .first_loop = 2,
                                 .rhythm.period = APC_NS_PER_S}};
    (void)state;
    snprintf(both[0].name, sizeof both[0].name, "base");
    snprintf(both[1].name, sizeof both[1].name, "upper");
    snprintf(signals[1][0].tag.name, sizeof signals[1][0].tag.name, "r");
    snprintf(signals[2][0].tag.name, sizeof signals[2][0].tag.name, "u");
    trajectory_free(&trajectory);
    e.dim = dim;
    e.controllers = both;
    e.n_controllers = 2;
    assert_int_equal(trajectory_create(&trajectory, &dim), 0);
    setpoint(0, 5);
    setpoint(1.5, 6); /* while the output stays where it is */
    setpoint(3, 5);
    trajectory_change(&trajectory, &trajectory.setpoint[1], 0, 5);
    for (int t = 0; t <= 4; t++)
        output(t, 5);
    make(4);
    assert_int_equal(figures.n_parts, 1);
    assert_int_equal(figures.n_loops, 2);
    assert_string_equal(figures.loop[0].name, "u");
    assert_string_equal(figures.loop[1].name, "upper.r");
    assert_near(whole(METRIC_IAE), 1.5, 1e-12);
    assert_near(whole(METRIC_PEAK), 1, 0);
    assert_near(figures.of[1].figure[METRIC_IAE], 0, 0);
    assert_near(figures.of[1].figure[METRIC_EFFORT], 2, 0); /* of the setpoint that it moves */
}

static void another_loop_s_step_is_none_of_this_one(void **state)
{
    const struct apc_dim dim = {.ny = 2, .nz = 2, .nu = 2};
    (void)state;
    trajectory_free(&trajectory);
    e.dim = controller.dim = dim;
    assert_int_equal(trajectory_create(&trajectory, &dim), 0);
    for (size_t i = 0; i < 2; i++) {
        trajectory_change(&trajectory, &trajectory.setpoint[i], 0, 5);
        trajectory_add(&trajectory, &trajectory.output[i], 0, 5);
    }
    trajectory_change(&trajectory, &trajectory.setpoint[1], 2, 6);
    trajectory_add(&trajectory, &trajectory.output[0], 2, 5);
    trajectory_add(&trajectory, &trajectory.output[0], 3, 5.25);
    trajectory_add(&trajectory, &trajectory.output[1], 3, 6);
    trajectory_change(&trajectory, &trajectory.input[0], 0, 1);
    make(4);
    assert_int_equal(figures.n_loops, 2);
    assert_false(figures.of[0].part[1].step);
    assert_true(figures.of[1].part[1].step);
    assert_near(figures.of[0].part[1].figure[METRIC_PEAK], 0.25, 0);
    assert_near(figures.of[1].part[1].figure[METRIC_SETTLING], 1, 0);
    assert_near(figures.of[0].figure[METRIC_EFFORT], 0, 0);
}

/* In real time the plant is measured a moment before the first setpoint is written: that moment is no part of the
 * run, and hides none of its figures. */
/* Promise(simulation/figures-plant-true) */
static void a_run_in_real_time_begins_once_there_is_a_setpoint(void **state)
{
    (void)state;
    output(0, 0);
    setpoint(6e-5, 10);
    output(1, 10);
    output(2, 10);
    trajectory.gap = 3;
    make(3);
    assert_int_equal(figures.n_parts, 1);
    assert_near(figures.of[0].part[0].from, 6e-5, 0);
    assert_near(whole(METRIC_IAE), 5, 1e-3);
    assert_near(whole(METRIC_SETTLING), 1, 1e-3);

    trajectory.gap = 5e-5; /* for longer than may be missing: that is said */
    make(3);
    assert_int_equal(figures.n_parts, 2);
    assert_true(isnan(whole(METRIC_IAE)));

    trajectory.gap = HUGE_VAL; /* simulated after such a run: within a period of the plant */
    make(3);
    assert_int_equal(figures.n_parts, 1);
    assert_near(whole(METRIC_IAE), 5, 1e-3);
}

static void a_run_begins_with_the_first_measurement_of_any_output(void **state)
{
    const struct apc_dim dim = {.ny = 2, .nz = 2, .nu = 2};
    (void)state;
    for (size_t early = 0; early < 2; early++) {
        trajectory_free(&trajectory);
        e.dim = controller.dim = dim;
        assert_int_equal(trajectory_create(&trajectory, &dim), 0);
        for (size_t i = 0; i < 2; i++) {
            trajectory_change(&trajectory, &trajectory.setpoint[i], 0, 5);
            for (int t = i == early ? 1 : 2; t <= 4; t++)
                trajectory_add(&trajectory, &trajectory.output[i], t, 5 - (double)i);
        }
        make(4);
        assert_int_equal(figures.n_parts, 1);
        for (size_t i = 0; i < 2; i++)
            assert_near(figures.of[i].part[0].from, 1, 0);
        assert_near(figures.of[1].figure[METRIC_IAE], 3, 1e-12);
    }
}

static void two_outputs_for_one_thing_are_one_loop_and_a_calculated_one_is_none(void **state)
{
    static struct wire both[] = {{APC_SENSOR, 0}, {APC_SENSOR, 0}},
                       calculated[] = {{APC_SENSOR, 0}, {APC_SENSOR, 2}},
                       same[] = {{APC_SETPOINT, 0}, {APC_SETPOINT, 0}};
    const struct apc_dim dim = {.ny = 2, .nz = 2, .nu = 2};
    struct wire *const y = controller.y, *const z = controller.z;
    struct loop loop[2];
    (void)state;
    e.dim = controller.dim = dim;
    snprintf(signals[0][1].tag.name, sizeof signals[0][1].tag.name, "level");
    snprintf(signals[2][1].tag.name, sizeof signals[2][1].tag.name, "valve");
    assert_int_equal(metrics_loops(&e, loop), 2);
    assert_string_equal(loop[1].name, "level"); /* as it has always been, where there is one controller */
    controller.y = both;
    assert_int_equal(metrics_loops(&e, loop), 2); /* of two setpoints */
    controller.z = same;
    assert_int_equal(metrics_loops(&e, loop), 1);
    assert_true(loop[0].y == 0 && loop[0].z == 0 && loop[0].u.table == APC_ACTUATOR && loop[0].u.at == 0);
    controller.y = y;
    assert_int_equal(metrics_loops(&e, loop), 2); /* of two measurements */
    controller.y = calculated;
    controller.z = z;
    assert_int_equal(metrics_loops(&e, loop), 1);
    assert_true(loop[0].y == 0 && loop[0].z == 0);
}

/* Whatever the order in which the file and the setpoints tell of them. */
static void events_come_by_time_and_at_one_time_the_setpoints_before_the_disturbances(void **state)
{
    static const struct event expected[] = {
        {EVENT_START, 0, 1, 0, 0, 0},       {EVENT_DISTURBANCE, 1, 1, 0, 9, 0},
        {EVENT_SETPOINT, 1, 2, 5, 6, 0},    {EVENT_DISTURBANCE, 0, 3, 0, 7, 0},
        {EVENT_SETPOINT, 0, 4, 5, 8, 0},    {EVENT_SETPOINT, 1, 4, 6, 5, 0},
        {EVENT_DISTURBANCE, 0, 4, 7, 1, 0}, {EVENT_DISTURBANCE, 0, 4, 1, 3, 0},
        {EVENT_DISTURBANCE, 1, 4, 9, 2, 0}, {EVENT_SETPOINT, 0, 6, 8, 5, 0},
        {EVENT_SETPOINT, 1, 6, 5, 7, 0},    {EVENT_DISTURBANCE, 0, 6, 3, 2, 0},
        {EVENT_DISTURBANCE, 1, 6, 2, 1, 0}};
    static const struct apc_param names[] = {{.name = "load"}, {.name = "feed"}};
    static const struct apc_model model = {.name = "m", .nd = 2, .disturbance = names};
    struct apc_disturbance changes[] = {
        {1, 0, 9},
        {1, 4 * APC_NS_PER_S, 2},
        {0, 3 * APC_NS_PER_S, 7},
        {0, 4 * APC_NS_PER_S, 1},
        {0, 4 * APC_NS_PER_S, 3},
        {1, 6 * APC_NS_PER_S, 1},
        {0, 6 * APC_NS_PER_S, 2},
    };
    const struct apc_dim dim = {.ny = 2, .nz = 2, .nu = 2};
    (void)state;
    trajectory_free(&trajectory);
    e.dim = dim;
    e.plant.model = &model;
    e.plant.disturbance = changes;
    e.plant.n_disturbances = sizeof changes / sizeof *changes;
    assert_int_equal(trajectory_create(&trajectory, &dim), 0);
    for (size_t i = 0; i < 2; i++) {
        trajectory_change(&trajectory, &trajectory.setpoint[i], 0, 5);
        trajectory_add(&trajectory, &trajectory.output[i], 1, 5);
    }
    trajectory_change(&trajectory, &trajectory.setpoint[0], 4, 8);
    trajectory_change(&trajectory, &trajectory.setpoint[0], 6, 5);
    trajectory_change(&trajectory, &trajectory.setpoint[1], 2, 6);
    trajectory_change(&trajectory, &trajectory.setpoint[1], 4, 5);
    trajectory_change(&trajectory, &trajectory.setpoint[1], 6, 7);
    make(8);
    assert_int_equal(figures.n_events, sizeof expected / sizeof *expected);
    for (size_t i = 0; i < figures.n_events; i++) {
        const struct event *is = &figures.event[i], *want = &expected[i];
        assert_int_equal(is->kind, want->kind);
        assert_int_equal(is->which, want->which);
        assert_near(is->t, want->t, 0);
        assert_true(i == 0 || (fabs(is->from - want->from) <= 0 && fabs(is->to - want->to) <= 0));
    }
    /* and are named so */
    static const char *const names_of[] = {"start-up; feed 0 -> 9", "T 5 -> 6", "load 0 -> 7",
                                           "h 5 -> 8; T 6 -> 5; load 7 -> 1; and 2 more",
                                           "h 8 -> 5; T 5 -> 7; load 3 -> 2; feed 2 -> 1"};
    char text[100], cut[60];
    snprintf(signals[1][0].tag.name, sizeof signals[1][0].tag.name, "h");
    snprintf(signals[1][1].tag.name, sizeof signals[1][1].tag.name, "T");
    assert_int_equal(figures.n_parts, sizeof names_of / sizeof *names_of);
    for (size_t i = 0; i < figures.n_parts; i++) {
        figures_name_part(&figures, &figures.of[0].part[i], &e, text, sizeof text);
        assert_string_equal(text, names_of[i]);
        for (size_t size = 1; size < sizeof cut;
             size++) { /* as far as there is room, and nothing behind it */
            memset(cut, 'x', sizeof cut);
            figures_name_part(&figures, &figures.of[0].part[i], &e, cut, size);
            assert_int_equal(strncmp(cut, names_of[i], size - 1), 0);
            assert_true(strlen(cut) < size);
            for (size_t k = size; k < sizeof cut; k++)
                assert_int_equal(cut[k], 'x');
        }
    }
    figures.event[2].from = (double)NAN; /* nothing was set before */
    figures_name_part(&figures, &figures.of[0].part[1], &e, text, sizeof text);
    assert_string_equal(text, "T 6");
}

/* Promise(simulation/figures-plant-true) */
static void what_is_not_known_has_no_figures_and_what_diverged_infinite_ones(void **state)
{
    (void)state;
    make(5);
    for (int i = 0; i < METRICS; i++)
        assert_true(isnan(whole((enum metric)i)));
    setpoint(0, 1);
    output(0, 0);
    output(1, 1);
    make(5);
    assert_near(whole(METRIC_IAE), 0.5, 1e-12);
    trajectory.gap = 3.9; /* of a run in real time: nothing for so long means that nobody knows */
    make(5);
    assert_true(isnan(whole(METRIC_IAE)) && isnan(whole(METRIC_SETTLING)) && isnan(whole(METRIC_OVERSHOOT)));
    trajectory.gap = 4;
    make(5);
    assert_near(whole(METRIC_IAE), 0.5, 1e-12);
    setpoint(4, 2);
    output(4.5, 2);
    output(9, 2);
    trajectory.gap = 3.6;
    make(9);
    assert_true(isnan(whole(METRIC_IAE)) && isnan(of(1, METRIC_IAE)) && !isnan(of(0, METRIC_IAE)));
    trajectory.gap = 3.4; /* also the hole that ends in the next part */
    make(9);
    assert_true(isnan(of(0, METRIC_IAE)));
    trajectory.gap = HUGE_VAL;
    trajectory.diverged = true;
    make(9);
    assert_true(isinf(of(1, METRIC_IAE)) && isinf(of(1, METRIC_ISE)) && isinf(of(1, METRIC_ITAE)));
    assert_true(isinf(of(1, METRIC_SETTLING)) && isinf(of(1, METRIC_OVERSHOOT)) && isnan(of(1, METRIC_PEAK)));
    assert_true(of(0, METRIC_IAE) < 10);
    assert_true(isinf(whole(METRIC_IAE)) && isinf(whole(METRIC_SETTLING)));
}

/* ---- From samples ------------------------------------------------------------------------- */

static struct samples samples;

static void sample(enum apc_table table, double t, double value, apc_status status)
{
    struct apc_sample s = {.table = table, .id = 1, .value = value, .status = status};
    assert_int_equal(apc_ns_from_s(t, &s.time), 0);
    s.time += 7 * APC_NS_PER_S;
    assert_int_equal(samples_add(&samples, &s), 0);
}

/* Periods of 1 s: what stays away for 3.1 s is lost. */
static void samples_tell_when_there_was_no_control(void **state)
{
    static const double expected[][2] = {{0, 1}, {1, 0}, {4, 1}, {5, 0}, {8.1, 1}, {12, 0}, {15.1, 1}};
    (void)state;
    trajectory_free(&trajectory);
    sample(APC_SETPOINT, 0, 5, APC_GOOD);
    sample(APC_SENSOR, 0, 1, APC_GOOD);
    sample(APC_ACTUATOR, 1, 1, APC_GOOD);
    sample(APC_SENSOR, 3, 2, APC_GOOD);
    sample(APC_ACTUATOR, 4, 1, APC_UNCERTAIN_LAST_USABLE);
    sample(APC_SENSOR, 5, 3, APC_GOOD);
    sample(APC_ACTUATOR, 5, 2, APC_GOOD);
    sample(APC_SENSOR, 6, 9, APC_BAD);
    sample(APC_ACTUATOR, 6, 2, APC_GOOD);
    sample(APC_ACTUATOR, 9.5, 2, APC_GOOD); /* no measurement since 5 s */
    sample(APC_SENSOR, 12, 4, APC_GOOD);
    sample(APC_ACTUATOR, 12, 2, APC_GOOD);
    sample(APC_SENSOR, 13, 4, APC_GOOD);
    sample(APC_SENSOR, 16.5, 4, APC_GOOD);
    assert_int_equal(trajectory_of_samples(&trajectory, &samples, &e, 7 * APC_NS_PER_S), 0);
    assert_true(trajectory.measured);
    assert_near(trajectory.gap, 3.1, 1e-12);
    assert_near(trajectory.end, 16.5, 1e-12);
    assert_int_equal(trajectory.output[0].n, 6); /* not the Bad one */
    assert_int_equal(trajectory.input[0].n, 2);
    assert_int_equal(trajectory.without.n, 7);
    for (size_t i = 0; i < 7; i++) {
        assert_near(trajectory.without.at[i].t, expected[i][0], 1e-9);
        assert_near(trajectory.without.at[i].value, expected[i][1], 0);
    }
    samples_free(&samples);
}

/* 6.1 s and 3.1 s; to the very end of that there is control. */
static void measurements_and_outputs_may_stay_away_for_three_of_their_own_periods(void **state)
{
    static const double expected[][2] = {{0, 1}, {1, 0}, {6.5, 1}, {7, 0}, {16.1, 1}};
    (void)state;
    trajectory_free(&trajectory);
    e.client.rhythm.period = 2 * APC_NS_PER_S;
    sample(APC_ACTUATOR, 0, 1, APC_GOOD); /* of a measurement that nobody knows */
    sample(APC_SENSOR, 0.4, 1, APC_GOOD);
    sample(APC_ACTUATOR, 1, 1, APC_GOOD);
    sample(APC_ACTUATOR, 4.1, 1, APC_GOOD);
    sample(APC_ACTUATOR, 6.5, 1, APC_GOOD);
    sample(APC_ACTUATOR, 6.7, 1, APC_GOOD);
    sample(APC_SENSOR, 7, 1, APC_GOOD);
    sample(APC_ACTUATOR, 7, 1, APC_GOOD);
    for (int t = 10; t <= 13; t++) {
        sample(APC_SENSOR, t, 1, APC_GOOD);
        sample(APC_ACTUATOR, t, 1, APC_GOOD);
    }
    sample(APC_SETPOINT, 17, 5, APC_GOOD);
    sample(APC_ACTUATOR, 18, 1, APC_BAD);
    samples.n--; /* it is there and not one of them */
    assert_int_equal(trajectory_of_samples(&trajectory, &samples, &e, 7 * APC_NS_PER_S), 0);
    assert_near(trajectory.end, 17, 0);
    assert_int_equal(trajectory.without.n, 5);
    for (size_t i = 0; i < 5; i++) {
        assert_near(trajectory.without.at[i].t, expected[i][0], 1e-9);
        assert_near(trajectory.without.at[i].value, expected[i][1], 0);
    }
    samples_free(&samples);
}

static void silence_lasts_until_the_end(void **state)
{
    (void)state;
    trajectory_free(&trajectory);
    sample(APC_SENSOR, 0, 1, APC_GOOD);
    sample(APC_ACTUATOR, 0, 1, APC_GOOD);
    sample(APC_SETPOINT, 9, 5, APC_GOOD);
    assert_int_equal(trajectory_of_samples(&trajectory, &samples, &e, 7 * APC_NS_PER_S), 0);
    assert_near(trajectory.end, 9, 0);
    assert_int_equal(trajectory.without.n, 3);
    assert_near(trajectory.without.at[2].t, 3.1, 1e-12);
    assert_near(trajectory.without.at[2].value, 1, 0);
    samples_free(&samples);
}

static void a_course_is_read_as_it_was_written(void **state)
{
    struct apc_error why;
    struct trajectory again;
    (void)state;
    assert_int_equal(trajectory_read(&again, scratch_folder(), &e.dim, &why), APC_ENOTFOUND);
    trajectory_free(&again);
    setpoint(0, 1.0 / 3);
    output(0, 0.1);
    output(0.001, 1e-300);
    trajectory_change(&trajectory, &trajectory.input[0], 0, -7);
    trajectory_change(&trajectory, &trajectory.without, 0, 1);
    trajectory.end = 12.5;
    trajectory.diverged = true;
    assert_int_equal(trajectory_write(&trajectory, scratch_folder(), &why), 0);
    assert_int_equal(trajectory_read(&again, scratch_folder(), &e.dim, &why), 0);
    assert_int_equal(again.output[0].n, 2);
    assert_near(again.output[0].at[1].value, 1e-300, 0);
    assert_near(again.output[0].at[1].t, 0.001, 0);
    assert_near(again.setpoint[0].at[0].value, 1.0 / 3, 0);
    assert_near(again.input[0].at[0].value, -7, 0);
    assert_near(again.without.at[0].value, 1, 0);
    assert_near(again.end, 12.5, 0);
    assert_true(again.diverged && !again.measured && isinf(again.gap));
    trajectory_free(&again);
}

/* ---- Statistics --------------------------------------------------------------------------- */

static void statistics_are_those_by_hand(void **state)
{
    double few[] = {4, 1, 3, 2};
    const uint64_t seed[] = {11, 12, 13, 14};
    (void)state;
    struct statistic s = statistic_of(few, seed, 4);
    assert_int_equal(s.n, 4);
    assert_int_equal(s.infinite, 0);
    assert_near(s.mean, 2.5, 1e-12);
    assert_near(s.sd, sqrt(5.0 / 3), 1e-12);
    assert_near(s.half, 3.1824 * sqrt(5.0 / 3) / 2, 1e-4); /* Student's, with 3 degrees of freedom */
    assert_near(s.median, 2, 0);
    assert_near(s.p95, 4, 0);
    assert_near(s.worst, 4, 0);
    assert_int_equal(s.worst_seed, 11);
}

/* Quantiles of Student's distribution from tables of it. */
/* Promise(simulation/worse-world-worse) */
static void intervals_are_student_s(void **state)
{
    static const struct {
        size_t n;
        double t;
    } of[] = {{2, 12.7062},  {3, 4.30265},  {9, 2.306},    {10, 2.26216},
              {11, 2.22814}, {21, 2.08596}, {31, 2.04227}, {200, 1.97196}};
    (void)state;
    for (size_t i = 0; i < sizeof of / sizeof *of; i++) {
        double value[200];
        uint64_t seed[200] = {0};
        for (size_t k = 0; k < of[i].n; k++)
            value[k] = (double)(k * k % 7);
        struct statistic s = statistic_of(value, seed, of[i].n);
        assert_near(s.half / s.sd * sqrt((double)of[i].n), of[i].t, 4e-4);
    }
}

/* Promise(simulation/worse-world-worse) */
static void what_is_infinite_counts_as_infinite(void **state)
{
    double value[100];
    uint64_t seed[100];
    (void)state;
    for (size_t i = 0; i < 100; i++) {
        value[i] = i % 17 == 5 ? HUGE_VAL : (double)i; /* six of them */
        seed[i] = i;
    }
    struct statistic s = statistic_of(value, seed, 100);
    assert_int_equal(s.infinite, 6);
    assert_true(isinf(s.mean) && isnan(s.sd) && isnan(s.half));
    assert_true(s.median < 100);
    assert_true(isinf(s.p95) && isinf(s.p99) && isinf(s.worst));
    assert_int_equal(s.worst_seed, 5); /* the first of them */
    s = statistic_of(value, seed, 0);
    assert_int_equal(s.n, 0);
    assert_true(isnan(s.mean) && isnan(s.half) && isnan(s.median) && isnan(s.worst));
    value[0] = 3;
    s = statistic_of(value, seed, 1);
    assert_near(s.mean, 3, 0);
    assert_true(isnan(s.sd) && isnan(s.half));
    assert_near(s.p99, 3, 0);
}

#define T(name) cmocka_unit_test_setup_teardown(name, begin, end)

int main(void)
{
    const struct CMUnitTest tests[] = {
        T(figures_are_those_by_hand),
        T(a_ramp_is_one_event_and_no_step),
        T(a_run_of_less_than_a_second_has_all_its_figures),
        T(settling_ends_with_the_first_tick_from_which_on_it_is_near),
        T(a_loop_that_does_not_settle_is_infinitely_slow),
        T(an_offset_at_the_start_is_no_step_beside_larger_ones),
        T(where_the_setpoint_does_not_move_there_is_no_overshoot),
        T(a_disturbance_has_figures_of_its_own),
        T(a_setpoint_that_a_controller_moves_begins_no_part_and_is_followed),
        T(a_run_in_real_time_begins_once_there_is_a_setpoint),
        T(a_run_begins_with_the_first_measurement_of_any_output),
        T(two_outputs_for_one_thing_are_one_loop_and_a_calculated_one_is_none),
        T(another_loop_s_step_is_none_of_this_one),
        T(events_come_by_time_and_at_one_time_the_setpoints_before_the_disturbances),
        T(what_is_not_known_has_no_figures_and_what_diverged_infinite_ones),
        T(samples_tell_when_there_was_no_control),
        T(silence_lasts_until_the_end),
        T(measurements_and_outputs_may_stay_away_for_three_of_their_own_periods),
        T(a_course_is_read_as_it_was_written),
        cmocka_unit_test(statistics_are_those_by_hand),
        cmocka_unit_test(intervals_are_student_s),
        cmocka_unit_test(what_is_infinite_counts_as_infinite),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}

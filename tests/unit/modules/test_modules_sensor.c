/* SPDX-License-Identifier: BSD-3-Clause */
/* Noise, sensors and their faults, disturbances: in the plant server's core. */
#include "check.h"

#include "apcmodules.h"
#include "apcsockets.h"

#include <string.h>

#define S    APC_NS_PER_S
#define TICK (S / 10)
#define N    2000

/* A plant with its core, that is read at each tick. */
struct rig {
    struct apc_plant *plant;
    struct apc_plantserver *server;
    size_t ny;
    struct apc_sample y[4];
    double gain, tau; /* of the first-order plant */
};

static struct rig make(const char *name, struct apc_plantserver_options o)
{
    struct rig r = {0};
    struct apc_error why = {""};
    void *handle;

    o.size = sizeof(o);
    o.link_period = o.command_period = S;
    if (apc_model_find(name, &o.model, &handle, &why) < 0 ||
        apc_plant_create(&r.plant, o.model, NULL, NULL, NULL, &why) < 0)
        fail_msg("%s", why.text);
    o.plant = r.plant;
    r.ny = o.model->ny;
    r.gain = o.model->param[0].initial;
    r.tau = o.model->param[1].initial;
    if (apc_plantserver_create(&r.server, &o, &why) < 0)
        fail_msg("%s", why.text);
    return r;
}

static void drop(struct rig *r)
{
    apc_plantserver_destroy(r->server);
    apc_plant_destroy(r->plant);
}

/* Tick number k, and what a client then reads. */
static void tick(struct rig *r, int k)
{
    const struct apc_now now = {.mono = 5 * S + k * TICK, .utc = k * TICK};
    const struct apc_frame query = {.kind = APC_FRAME_QUERY, .id = 1};
    struct apc_frame frame;
    char text[64], reply[512];
    int n = apc_frame_encode(text, sizeof(text), &query, NULL);

    assert_int_equal(apc_plantserver_tick(r->server, now, NULL), 0);
    n = apc_plantserver_request(r->server, now, 1, text, (size_t)n, reply, sizeof(reply), NULL);
    assert_true(n > 0);
    assert_int_equal(apc_frame_decode(reply, (size_t)n, &frame, r->y, 4), 0);
    assert_int_equal(frame.n, r->ny);
}

/* ---- Noise --------------------------------------------------------------------------------- */

/*
 * Promise(experiment/noise-steps-faults): Noise, steps and faults of sensors begin and end when they
 *   should, and come of the seed.
 */
static void measurement_noise_has_its_standard_deviation_and_leaves_the_plant_alone(void **state)
{
    const struct apc_sensor sensor = {.noise = 0.3};
    struct rig r = make("first-order", (struct apc_plantserver_options){.sensor = &sensor, .seed = 7});
    double sum = 0.0, square = 0.0;

    (void)state;
    for (int k = 0; k < N; k++) {
        tick(&r, k);
        sum += r.y[0].value;
        square += r.y[0].value * r.y[0].value;
    }
    assert_near(apc_plant_state(r.plant)[0], 0.0, 0.0);
    assert_near(sum / N, 0.0, 4.0 * 0.3 / sqrt(N));
    assert_near(sqrt(square / N), 0.3, 4.0 * 0.3 / sqrt(2.0 * N));
    drop(&r);
}

/* What a tick adds to where the plant would go by itself. */
/* Promise(experiment/dead-time-process) */
static void process_noise_moves_the_state_as_a_random_walk(void **state)
{
    const double noise = 0.2, expected = 0.2 * sqrt(0.1);
    struct rig r = make("first-order", (struct apc_plantserver_options){.noise = &noise, .seed = 7});
    double before = 0.0, square = 0.0;

    (void)state;
    for (int k = 0; k < N; k++) {
        double x;

        tick(&r, k);
        x = apc_plant_state(r.plant)[0];
        assert_near(r.y[0].value, x, 0.0);
        square += k > 0 ? pow(x - exp(-0.01) * before, 2) : 0.0;
        before = x;
    }
    assert_near(sqrt(square / (N - 1)), expected, 4.0 * expected / sqrt(2.0 * N));
    drop(&r);
}

/* Each state with its own: what has none follows from the others as if there were none. */
static void each_state_has_its_own_process_noise(void **state)
{
    (void)state;
    for (size_t noisy = 0; noisy < 4; noisy++) {
        double noise[4] = {0.0, 0.0, 0.0, 0.0}, square = 0.0, before;
        const double lag = exp(-0.1 / (noisy < 2 ? 1.0 / (1.0 / 20.0 + 1.0 / 100.0) : 140.0));
        const double expected = (1.0 + (double)noisy) * sqrt(0.1);
        struct rig r;

        noise[noisy] = 1.0 + (double)noisy;
        r = make("temperature-lab", (struct apc_plantserver_options){.noise = noise, .seed = 3});
        tick(&r, 0);
        before = apc_plant_state(r.plant)[noisy];
        for (int k = 1; k < N; k++) {
            double x, moved;

            tick(&r, k);
            x = apc_plant_state(r.plant)[noisy];
            moved = x - 21.0 - lag * (before - 21.0);
            square += moved * moved;
            before = x;
            for (size_t i = 2; i < 4 && noisy >= 2; i++) /* a sensor's own noise goes nowhere else */
                assert_int_equal(fabs(apc_plant_state(r.plant)[i] - 21.0) < 1e-9, i != noisy);
        }
        assert_near(sqrt(square / (N - 1)), expected, 5.0 * expected / sqrt(2.0 * N));
        drop(&r);
    }
}

static void a_level_under_noise_stays_at_or_above_zero(void **state)
{
    const double noise[] = {0.5, 0.5};
    struct rig r = make("double-tank", (struct apc_plantserver_options){.noise = noise});

    (void)state;
    for (int k = 0; k < N; k++) {
        tick(&r, k);
        assert_true(apc_plant_state(r.plant)[0] >= -1e-9 && apc_plant_state(r.plant)[1] >= -1e-9);
    }
    drop(&r);
}

/* Promise(experiment/noise-steps-faults) */
static void the_same_seed_gives_the_same_numbers_and_another_others(void **state)
{
    const struct apc_sensor sensor[2] = {{.noise = 1.0}, {.noise = 1.0}};
    const double noise[4] = {0.1, 0.0, 0.0, 0.1};
    const struct apc_plantserver_options o = {.sensor = sensor, .noise = noise, .seed = 42};
    struct apc_plantserver_options other = o;
    struct rig a = make("temperature-lab", o), b = make("temperature-lab", o), c;
    int differ = 0;

    (void)state;
    other.seed = 43;
    c = make("temperature-lab", other);
    for (int k = 0; k < N; k++) {
        tick(&a, k);
        tick(&b, k);
        tick(&c, k);
        assert_true(a.y[0].value == b.y[0].value && a.y[1].value == b.y[1].value);
        assert_true(a.y[0].value != a.y[1].value);
        differ += a.y[0].value != c.y[0].value;
    }
    assert_int_equal(differ, N);
    drop(&a);
    drop(&b);
    drop(&c);
}

/* Giving one sensor noise, or a fault, must not change what another shows. */
/* Promise(experiment/noise-steps-faults) */
static void one_sensor_changes_nothing_of_another(void **state)
{
    const struct apc_sensor_fault fault = {.kind = APC_FAULT_DROPOUT, .at = S};
    const struct apc_sensor one[2] = {{.noise = 0.0}, {.noise = 1.0}};
    const struct apc_sensor two[2] = {{.noise = 5.0, .fault = &fault, .n_faults = 1}, {.noise = 1.0}};
    struct rig a = make("temperature-lab", (struct apc_plantserver_options){.sensor = one});
    struct rig b = make("temperature-lab", (struct apc_plantserver_options){.sensor = two});

    (void)state;
    for (int k = 0; k < 100; k++) {
        tick(&a, k);
        tick(&b, k);
        assert_true(a.y[1].value == b.y[1].value);
        assert_int_equal(b.y[1].status, APC_GOOD);
    }
    drop(&a);
    drop(&b);
}

/* ---- Sensors ------------------------------------------------------------------------------- */

/* Promise(experiment/noise-steps-faults) */
static void a_sensor_shows_whole_steps_only(void **state)
{
    const struct apc_sensor sensor[2] = {{.noise = 0.5, .quantum = 0.3223}, {.quantum = 0.3223}};
    struct rig r = make("temperature-lab", (struct apc_plantserver_options){.sensor = sensor});

    (void)state;
    for (int k = 0; k < 200; k++) {
        double steps;

        tick(&r, k);
        steps = r.y[0].value / 0.3223;
        assert_near(steps, round(steps), 1e-9);
    }
    assert_near(r.y[1].value, 65.0 * 0.3223, 1e-12); /* 21 lies between 65 and 66 of them */
    drop(&r);
}

/* Levels that rise all the time, so that a stuck sensor shows. */
/* Promise(experiment/noise-steps-faults) */
static void faults_begin_and_end_when_they_should(void **state)
{
    const struct apc_sensor_fault stuck = {.kind = APC_FAULT_STUCK, .at = 2 * S, .duration = S};
    const struct apc_sensor_fault several[] = {
        {.kind = APC_FAULT_DRIFT, .at = S, .duration = S, .size = 0.5},
        {.kind = APC_FAULT_SPIKE,
         .at = 3 * S - S / 40,
         .size = 7.0}, /* between two ticks: seen at the second */
        {.kind = APC_FAULT_SPIKE, .at = 4 * S, .duration = S / 5, .size = -7.0},
        {.kind = APC_FAULT_DROPOUT, .at = 5 * S, .duration = S},
    };
    const struct apc_sensor sensor[2] = {{.fault = &stuck, .n_faults = 1}, {.fault = several, .n_faults = 4}};
    const double noise[4] = {0.0, 0.0, 0.2, 0.2};
    struct rig r =
        make("temperature-lab", (struct apc_plantserver_options){.sensor = sensor, .noise = noise});
    double before[2] = {0.0, 0.0};

    (void)state;
    for (int k = 0; k < 80; k++) {
        double t = 0.1 * k, added = 0.0;
        const double *x = apc_plant_state(r.plant) + 2;

        tick(&r, k);
        assert_int_equal(r.y[0].status, APC_GOOD);
        assert_true(r.y[0].value == (k >= 20 && k < 30 ? before[0] : x[0]));
        assert_int_equal(r.y[1].status, k >= 50 && k < 60 ? APC_BAD_SENSOR_FAILURE : APC_GOOD);
        if (k >= 10 && k < 20)
            added = 0.5 * (t - 1.0);
        if (k == 30)
            added = 7.0;
        if (k == 40 || k == 41)
            added = -7.0;
        assert_near(r.y[1].value, k >= 50 && k < 60 ? before[1] : x[1] + added, 1e-12);
        before[0] = r.y[0].value;
        before[1] = r.y[1].value;
    }
    drop(&r);
}

/* Promise(experiment/noise-steps-faults) */
static void a_fault_without_duration_lasts(void **state)
{
    const struct apc_sensor_fault fault = {.kind = APC_FAULT_DROPOUT, .at = S};
    const struct apc_sensor sensor = {.fault = &fault, .n_faults = 1};
    struct rig r = make("first-order", (struct apc_plantserver_options){.sensor = &sensor});

    (void)state;
    for (int k = 0; k < N; k++) {
        tick(&r, k);
        assert_int_equal(r.y[0].status, k < 10 ? APC_GOOD : APC_BAD_SENSOR_FAILURE);
    }
    drop(&r);
}

/* Promise(experiment/noise-steps-faults) */
static void a_sensor_is_off_or_noisy_or_its_time_stands_still(void **state)
{
    const struct apc_sensor_fault faults[] = {
        {.kind = APC_FAULT_BIAS, .at = S, .duration = S, .size = 3.0},
        {.kind = APC_FAULT_NOISE, .at = 3 * S, .duration = S, .size = 0.5},
        {.kind = APC_FAULT_FROZEN, .at = 5 * S, .duration = S},
    };
    const struct apc_sensor sensor = {.noise = 1.0, .fault = faults, .n_faults = 3}, usual = {.noise = 1.0};
    struct rig r = make("first-order", (struct apc_plantserver_options){.sensor = &sensor}),
               same = make("first-order", (struct apc_plantserver_options){.sensor = &usual});
    double squares = 0.0;
    apc_ns before = 0;

    (void)state;
    for (int k = 0; k < 70; k++) {
        tick(&r, k);
        tick(&same, k);
        const double off = r.y[0].value - same.y[0].value;
        assert_near(k >= 30 && k < 40 ? 0.0 : off, k >= 10 && k < 20 ? 3.0 : 0.0, 1e-12);
        squares += off * off * (k >= 30 && k < 40);
        assert_int_equal(r.y[0].time, k >= 50 && k < 60 ? before : same.y[0].time);
        before = r.y[0].time;
    }
    assert_true(squares > 0.5 && squares < 8.0); /* 10 draws of variance 0.25: 0.05 % beyond */
    drop(&r);
    drop(&same);
}

/* Every third tick from the first one on; the other sensor goes on as if it were alone. */
/*
 * Promise(laws/measurement-period-own): A measurement with a period of its own comes as often, in virtual
 *   time as in real, with its time; predictive control takes a sample of a laboratory once, and knows its
 *   course in between; a filter that this would lead astray is refused.
 */
static void a_sensor_with_a_period_of_its_own_looks_as_often_and_its_value_stands_with_its_time(void **state)
{
    const double noise[4] = {0.0, 0.0, 0.2, 0.2};
    const struct apc_sensor_fault dropout = {.kind = APC_FAULT_DROPOUT, .at = S, .duration = 3 * TICK};
    const struct apc_sensor sensor[2] = {
        {.period = 3 * TICK, .fault = &dropout, .n_faults = 1}, /* seen at 1.2 s, so until 1.5 s */
        {.noise = 1.0}};
    const struct apc_sensor usual[2] = {{.period = 0}, {.noise = 1.0}};
    struct rig r = make("temperature-lab",
                        (struct apc_plantserver_options){.sensor = sensor, .noise = noise}),
               same =
                   make("temperature-lab", (struct apc_plantserver_options){.sensor = usual, .noise = noise});
    double shown = 0.0;

    (void)state;
    for (int k = 0; k < 40; k++) {
        tick(&r, k);
        tick(&same, k);
        if (k % 3 == 0 && k != 12)
            shown = apc_plant_state(r.plant)[2];
        assert_true(r.y[0].value == shown);
        assert_int_equal(r.y[0].time, (k - k % 3) * TICK);
        assert_int_equal(r.y[0].status, k / 3 == 4 ? APC_BAD_SENSOR_FAILURE : APC_GOOD);
        assert_true(r.y[1].value == same.y[1].value);
        assert_int_equal(r.y[1].time, k * TICK);
    }
    drop(&r);
    drop(&same);
}

/* Between two ticks: it shows what the next tick finds. A draw of noise for each look. */
/* Promise(laws/measurement-period-own) */
static void a_period_that_is_no_multiple_of_the_plants_is_kept_on_average(void **state)
{
    const struct apc_sensor sensor = {.period = 25 * TICK / 10, .noise = 0.3};
    struct rig r = make("first-order", (struct apc_plantserver_options){.sensor = &sensor, .seed = 7});
    int looks = 0;

    (void)state;
    for (int k = 0; k < 1000; k++) {
        const double before = r.y[0].value;
        const bool due = k % 5 == 0 || k % 5 == 3;

        tick(&r, k);
        assert_true(due == (r.y[0].time == k * TICK));
        assert_true(due == (r.y[0].value != before));
        looks += due;
    }
    assert_int_equal(looks, 400);
    drop(&r);
}

/* ---- Actuators ----------------------------------------------------------------------------- */

/* Where it stood in the interval before tick @p k, from states on either side of it; the watchdog gives it its
 * safe value from 3.1 s on, between two ticks. */
static double stood(struct rig *r, int k, double *x)
{
    const double decay = exp(-0.07 / r->tau), before = *x;
    const struct apc_now now = {.mono = 5 * S + k * 7 * TICK / 10, .utc = k * TICK};

    assert_int_equal(apc_plantserver_tick(r->server, now, NULL), 0);
    *x = apc_plant_state(r->plant)[0];
    return k ? (*x - decay * before) / (1.0 - decay) / r->gain : 0.0;
}

/* Promise(experiment/actuator-faults) */
static void an_actuator_that_is_stuck_or_slow_is_so_on_its_way_to_the_safe_value(void **state)
{
    const double initial = 5.0;
    const struct apc_actuator_fault fault[] = {{.kind = APC_ACTUATOR_STUCK, .at = S},
                                               {.kind = APC_ACTUATOR_RATE, .at = S, .size = 2.0}};

    (void)state;
    for (int slow = 0; slow < 2; slow++) {
        const struct apc_actuator actuator = {.fault = &fault[slow], .n_faults = 1};
        struct rig r =
            make("first-order", (struct apc_plantserver_options){.actuator = &actuator, .initial = &initial});
        double x = 0.0, told;

        for (int k = 0; k <= 100; k++) {
            const double t = 0.07 * k, u = stood(&r, k, &x); /* in the 0.07 s until t */
            const double fell = k <= 45 ? 5.0 : 5.0 - 2.0 * (0.07 * (k - 1) - 3.08);

            if (k > 0 && t < 3.1)
                assert_near(u, 5.0, 1e-4);
            else if (k == 45) /* 0.02 s before the watchdog, 0.05 s after it */
                assert_near(u,
                            slow ? 5.0 - 0.04 * (1.0 - exp(-0.05 / r.tau)) / (1.0 - exp(-0.07 / r.tau)) : 5.0,
                            1e-4);
            else if (k > 45)
                assert_near(u, slow ? fmax(fell, 0.0) : 5.0, 1e-4);
        }
        assert_true(apc_plantserver_input(r.server, &told));
        assert_near(told, 0.0, 0.0); /* what it is told is the safe value all the same */
        drop(&r);
    }
}

/* Promise(experiment/actuator-faults) */
static void an_actuator_without_power_goes_to_its_safe_position(void **state)
{
    const double initial = 5.0;
    const struct apc_actuator_fault fault = {.kind = APC_ACTUATOR_POWER, .at = S, .low = 2.0, .high = 2.0};
    const struct apc_actuator actuator = {.fault = &fault, .n_faults = 1};
    struct rig r =
        make("first-order", (struct apc_plantserver_options){.actuator = &actuator, .initial = &initial});
    double x = 0.0;

    (void)state;
    for (int k = 0; k <= 40; k++) {
        const double u = stood(&r, k, &x);
        if (k > 0)
            assert_near(u, k <= 15 ? 5.0 : 2.0, 1e-4); /* in the 0.07 s before */
    }
    drop(&r);
}

/* ---- Disturbances -------------------------------------------------------------------------- */

/* Between two ticks, at 0.25 s and 0.55 s: ambient temperature through heater to sensor, in closed form. */
/* Promise(experiment/dead-time-process) */
static void a_disturbance_changes_at_its_very_instant(void **state)
{
    const struct apc_disturbance changes[] = {{.k = 0, .at = S / 4, .value = 31.0},
                                              {.k = 0, .at = 55 * S / 100, .value = 21.0}};
    struct rig r = make("temperature-lab",
                        (struct apc_plantserver_options){.disturbance = changes, .n_disturbances = 2});
    double h = 0.0;

    (void)state;
    for (int k = 0; k <= 10; k++)
        tick(&r, k);
    h = 10.0 * (1.0 - exp(-0.3 / 20.0)) *
        exp(-0.45 / 20.0); /* both heaters are alike: no flow between them */
    assert_near(apc_plant_state(r.plant)[0], 21.0 + h, 1e-6);
    assert_near(apc_plant_state(r.plant)[1], 21.0 + h, 1e-6);
    drop(&r);
}

/* ---- Another world for a running plant ------------------------------------------------------ */

static void change(struct rig *r, struct apc_plantserver_options o, const struct apc_model *model,
                   int expected)
{
    struct apc_error why = {""};

    o.size = sizeof(o);
    o.model = model;
    assert_int_equal(apc_plantserver_change(r->server, &o, &why), expected);
    assert_int_equal(why.text[0] != '\0', expected < 0);
}

static const struct apc_model *lab(void)
{
    const struct apc_model *model = NULL;
    void *handle;

    assert_int_equal(apc_model_find("temperature-lab", &model, &handle, NULL), 0);
    return model;
}

static void assert_same(struct rig *a, struct rig *b, int first, int last)
{
    for (int k = first; k < last; k++) {
        tick(a, k);
        tick(b, k);
        assert_memory_equal(apc_plant_state(a->plant), apc_plant_state(b->plant), 4 * sizeof(double));
        for (size_t i = 0; i < a->ny; i++) {
            assert_true(a->y[i].value == b->y[i].value && a->y[i].status == b->y[i].status);
            assert_true(apc_plantserver_output(a->server)[i] == apc_plantserver_output(b->server)[i]);
        }
    }
}

static const struct apc_sensor coarse[2] = {{.quantum = 0.5, .noise = 1.0}, {.quantum = 0.25}};
static const double shaken[4] = {0.1, 0.0, 0.2, 0.0};

static void what_a_plant_is_changed_to_before_it_runs_is_as_if_it_had_been_made_so(void **state)
{
    const struct apc_disturbance changes[] = {{.k = 0, .at = 0, .value = 31.0},
                                              {.k = 0, .at = S, .value = 5.0}};
    const struct apc_plantserver_options o = {
        .seed = 7, .sensor = coarse, .noise = shaken, .disturbance = changes, .n_disturbances = 2};
    struct rig made = make("temperature-lab", o),
               changed = make("temperature-lab", (struct apc_plantserver_options){.seed = 7});

    (void)state;
    change(&changed, o, lab(), 0);
    assert_same(&made, &changed, 0, 20);
    drop(&made);
    drop(&changed);
}

/* What would have been before is passed over, what is to be at this very instant or later is not. */
static void a_running_plant_has_from_then_on_the_disturbances_that_it_is_changed_to(void **state)
{
    const struct apc_disturbance was[] = {{.k = 0, .at = S / 4, .value = 31.0},
                                          {.k = 0, .at = S, .value = 99.0}},
                                 is[] = {{.k = 0, .at = S / 10, .value = 25.0},
                                         {.k = 0, .at = 3 * S / 10 - 1, .value = 26.0},
                                         {.k = 0, .at = 3 * S / 10, .value = 27.0},
                                         {.k = 0, .at = 55 * S / 100, .value = 21.0}},
                                 all[] = {was[0], is[2], is[3]};
    struct rig whole = make("temperature-lab",
                            (struct apc_plantserver_options){.disturbance = all, .n_disturbances = 3}),
               changed = make("temperature-lab",
                              (struct apc_plantserver_options){.disturbance = was, .n_disturbances = 2});

    (void)state;
    assert_same(&whole, &changed, 0, 4);
    change(&changed, (struct apc_plantserver_options){.disturbance = is, .n_disturbances = 4}, lab(), 0);
    assert_same(&whole, &changed, 4, 20);
    drop(&whole);
    drop(&changed);
}

/* An instant after the last of them. */
static void disturbances_that_are_all_past_change_nothing(void **state)
{
    const struct apc_disturbance past[] = {{.k = 0, .at = 0, .value = 50.0},
                                           {.k = 0, .at = S / 4, .value = 60.0}};
    struct rig still = make("temperature-lab", (struct apc_plantserver_options){.seed = 1}),
               changed = make("temperature-lab", (struct apc_plantserver_options){.seed = 1});

    (void)state;
    assert_same(&still, &changed, 0, 4);
    change(&changed, (struct apc_plantserver_options){.disturbance = past, .n_disturbances = 2}, lab(), 0);
    assert_same(&still, &changed, 4, 20);
    drop(&still);
    drop(&changed);
}

static void noise_and_sensors_come_and_go_with_the_change(void **state)
{
    struct rig r = make("temperature-lab", (struct apc_plantserver_options){.seed = 7});
    const double *x = apc_plant_state(r.plant) + 2;
    double begin[4];

    (void)state;
    tick(&r, 0);
    memcpy(begin, apc_plant_state(r.plant), sizeof(begin));
    change(&r, (struct apc_plantserver_options){.sensor = coarse, .noise = shaken}, lab(), 0);
    tick(&r, 1);
    assert_true(x[0] != begin[2] && r.y[0].value != x[0]);
    assert_near(r.y[0].value, 0.5 * round(2.0 * r.y[0].value), 0.0);
    assert_near(r.y[1].value, 0.25 * round(4.0 * r.y[1].value), 0.0);
    change(&r, (struct apc_plantserver_options){.noise = NULL}, lab(), 0);
    for (int k = 2; k < 5; k++) {
        memcpy(begin, apc_plant_state(r.plant), sizeof(begin));
        tick(&r, k);
        assert_true(r.y[0].value == x[0] && r.y[1].value == x[1]);
        assert_near(apc_plant_state(r.plant)[0], begin[0], 0.02); /* only what heat flows: no kick of 0.1 */
    }
    drop(&r);
}

static void a_change_that_makes_no_sense_changes_nothing(void **state)
{
    const double negative[4] = {0.0, 0.0, 0.0, -1.0};
    struct rig r = make("temperature-lab",
                        (struct apc_plantserver_options){.sensor = coarse, .noise = shaken}),
               same = make("temperature-lab",
                           (struct apc_plantserver_options){.sensor = coarse, .noise = shaken});
    struct apc_error why;

    (void)state;
    change(&r, (struct apc_plantserver_options){.noise = NULL}, NULL, APC_EINVAL);
    change(&r, (struct apc_plantserver_options){.noise = negative}, lab(), APC_EINVAL);
    assert_int_equal(apc_plantserver_change(r.server, NULL, &why), APC_EINVAL);
    assert_same(&r, &same, 0, 5);
    drop(&r);
    drop(&same);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(measurement_noise_has_its_standard_deviation_and_leaves_the_plant_alone),
        cmocka_unit_test(process_noise_moves_the_state_as_a_random_walk),
        cmocka_unit_test(each_state_has_its_own_process_noise),
        cmocka_unit_test(a_level_under_noise_stays_at_or_above_zero),
        cmocka_unit_test(the_same_seed_gives_the_same_numbers_and_another_others),
        cmocka_unit_test(one_sensor_changes_nothing_of_another),
        cmocka_unit_test(a_sensor_shows_whole_steps_only),
        cmocka_unit_test(faults_begin_and_end_when_they_should),
        cmocka_unit_test(an_actuator_that_is_stuck_or_slow_is_so_on_its_way_to_the_safe_value),
        cmocka_unit_test(an_actuator_without_power_goes_to_its_safe_position),
        cmocka_unit_test(a_fault_without_duration_lasts),
        cmocka_unit_test(a_sensor_is_off_or_noisy_or_its_time_stands_still),
        cmocka_unit_test(a_sensor_with_a_period_of_its_own_looks_as_often_and_its_value_stands_with_its_time),
        cmocka_unit_test(a_period_that_is_no_multiple_of_the_plants_is_kept_on_average),
        cmocka_unit_test(a_disturbance_changes_at_its_very_instant),
        cmocka_unit_test(what_a_plant_is_changed_to_before_it_runs_is_as_if_it_had_been_made_so),
        cmocka_unit_test(a_running_plant_has_from_then_on_the_disturbances_that_it_is_changed_to),
        cmocka_unit_test(disturbances_that_are_all_past_change_nothing),
        cmocka_unit_test(noise_and_sensors_come_and_go_with_the_change),
        cmocka_unit_test(a_change_that_makes_no_sense_changes_nothing),
    };

    return cmocka_run_group_tests(tests, NULL, NULL);
}

/* SPDX-License-Identifier: BSD-3-Clause */
/* The client, and freshness. */
#include "check.h"

#include "apcmodules.h"

#include <math.h>

#define S      APC_NS_PER_S
#define T0     (INT64_C(1700000000) * S)
#define PERIOD (2 * S)
#define LIMIT  (3 * PERIOD + 100 * APC_NS_PER_MS)

static struct apc_now at(apc_ns mono)
{
    return (struct apc_now){.mono = mono, .utc = T0 + mono};
}

static struct apc_sample actuator(int id, int64_t seq, apc_ns time, double value)
{
    return (struct apc_sample){.table = APC_ACTUATOR, .id = id, .seq = seq, .time = time, .value = value};
}

/* ---- Freshness ------------------------------------------------------------------------------ */

/*
 * Promise(experiment/measurement-stale): A measurement is stale, a command is sent, for the times that are
 *   stated.
 */
static void a_variable_is_fresh_until_its_mark_stood_still_for_the_horizon(void **state)
{
    struct apc_freshness f = {0};

    (void)state;
    assert_true(apc_freshness_look(&f, 7, T0, at(0), 10));
    assert_true(apc_freshness_look(&f, 7, T0, at(10), 10));
    assert_false(apc_freshness_look(&f, 7, T0, at(11), 10));
    assert_true(apc_freshness_look(&f, 8, T0, at(12), 10));
    assert_false(apc_freshness_look(&f, 0, T0, at(13), 10));
    assert_true(apc_freshness_look(&f, 8, T0, at(22), 10));
    assert_false(apc_freshness_look(&f, 8, T0, at(23), 10));
}

static void the_first_look_believes_the_stamp_within_the_horizon(void **state)
{
    const struct {
        apc_ns stamp;
        bool fresh;
    } cases[] = {{T0, true},       {T0 - 10, true},    {T0 - 11, false},  {T0 + 10, true},
                 {T0 + 11, false}, {INT64_MIN, false}, {INT64_MAX, false}};

    (void)state;
    for (size_t i = 0; i < sizeof(cases) / sizeof(cases[0]); i++) {
        struct apc_freshness f = {0};

        assert_int_equal(apc_freshness_look(&f, 1, cases[i].stamp, at(0), 10), cases[i].fresh);
        assert_false(apc_freshness_look(&f, 1, cases[i].stamp, at(11), 10));
        assert_true(apc_freshness_look(&f, 2, cases[i].stamp, at(11), 10));
    }
}

static void an_age_seen_at_the_first_look_counts_on(void **state)
{
    struct apc_freshness f = {0};

    (void)state;
    assert_true(apc_freshness_look(&f, 1, T0 - 6, at(0), 10));
    assert_true(apc_freshness_look(&f, 1, T0 - 6, at(4), 10));
    assert_false(apc_freshness_look(&f, 1, T0 - 6, at(5), 10));
}

/* One who looks each 100 at what is written each 5 sees by its stamp that it is gone, at the next look. */
/* Promise(modes/shed) */
static void what_is_stamped_when_written_is_as_old_as_its_stamp_says(void **state)
{
    struct apc_freshness f = {0};

    (void)state;
    assert_true(apc_freshness_dated(&f, 1, T0, at(0), 10));
    assert_true(apc_freshness_dated(&f, 20, T0 + 95, at(100), 10));
    assert_false(apc_freshness_dated(&f, 23, T0 + 115, at(200), 10));
    assert_true(apc_freshness_dated(&f, 40, T0 + 290, at(300), 10));
    assert_false(apc_freshness_dated(&f, 40, T0 + 290, at(301), 10));
    assert_false(apc_freshness_dated(&f, 0, T0 + 301, at(301), 10));
}

/* A stamp of before the last look, or of the future, is a stepped clock's: the looks bound the age. */
static void a_stamp_that_lies_outside_the_looks_is_not_believed(void **state)
{
    struct apc_freshness f = {0};

    (void)state;
    assert_true(apc_freshness_dated(&f, 1, T0, at(0), 10));
    assert_true(apc_freshness_dated(&f, 2, INT64_MIN, at(4), 10)); /* of 0 at the earliest */
    assert_true(apc_freshness_dated(&f, 2, INT64_MIN, at(10), 10));
    assert_false(apc_freshness_dated(&f, 2, INT64_MIN, at(11), 10));
    assert_true(apc_freshness_dated(&f, 3, INT64_MAX, at(12), 10));
    assert_true(apc_freshness_dated(&f, 3, INT64_MAX, at(22), 10));
    assert_false(apc_freshness_dated(&f, 3, INT64_MAX, at(23), 10));
}

/* ---- Client --------------------------------------------------------------------------------- */

static struct apc_client *make(apc_ns since)
{
    static const int64_t last[] = {41, 7};
    const struct apc_client_options o = {
        .size = sizeof(o), .ny = 2, .nu = 2, .command_period = PERIOD, .last = last, .since = since};
    struct apc_client *client;

    assert_int_equal(apc_client_create(&client, &o, NULL), 0);
    return client;
}

static int set_up(void **state)
{
    *state = make(0);
    return 0;
}

static int tear_down(void **state)
{
    apc_client_destroy(*state);
    return 0;
}

/* Which of two may be written: 1, 2 or both, 3. */
static int written_at(struct apc_client *client, struct apc_now now, const struct apc_sample *u)
{
    struct apc_value out[2];
    int which = 0;
    size_t n = apc_client_command(client, now, u, out);

    for (int i = 0; i < 2; i++)
        if (apc_status_severity(out[i].status) != APC_SEVERITY_BAD)
            which |= 1 << i;
    assert_int_equal(n, (which & 1) + (which >> 1));
    return which;
}

static int written(struct apc_client *client, apc_ns mono, const struct apc_sample *u)
{
    return written_at(client, at(mono), u);
}

static void a_whole_fresh_vector_is_given_as_it_is(void **state)
{
    struct apc_sample u[] = {actuator(1, 1, T0, 1.5), actuator(2, 1, T0 + 1, -2.5)};
    struct apc_value out[2];

    u[1].status = APC_UNCERTAIN_SUBSTITUTE;
    apc_client_command(*state, at(0), u, out);
    assert_near(out[0].value, 1.5, 0.0);
    assert_near(out[1].value, -2.5, 0.0);
    assert_int_equal(out[0].status, APC_GOOD);
    assert_int_equal(out[1].status, APC_UNCERTAIN_SUBSTITUTE);
    assert_int_equal(out[0].time, T0);
    assert_int_equal(out[1].time, T0 + 1);
}

/* Promise(links/whatever-scheme-plant) */
static void what_is_missing_bad_or_not_finite_is_not_written(void **state)
{
    const struct {
        int64_t seq;
        apc_status status;
        double value;
        apc_status says;
    } cases[] = {{0, APC_GOOD, 1.0, APC_BAD_NO_DATA},
                 {1, APC_BAD_OUT_OF_SERVICE, 1.0, APC_BAD_OUT_OF_SERVICE},
                 {1, APC_GOOD, (double)NAN, APC_BAD_OUT_OF_RANGE},
                 {1, APC_GOOD, (double)INFINITY, APC_BAD_OUT_OF_RANGE}};

    assert_int_equal(written(*state, 0, NULL), 0);
    for (size_t k = 0; k < 2; k++)
        for (size_t i = 0; i < sizeof(cases) / sizeof(cases[0]); i++) {
            struct apc_sample u[] = {actuator(1, 1, T0, 1.0), actuator(2, 1, T0, 2.0)};
            struct apc_value out[2];

            u[k].seq = cases[i].seq;
            u[k].status = cases[i].status;
            u[k].value = cases[i].value;
            apc_client_command(*state, at(0), u, out);
            assert_int_equal(out[k].status, cases[i].says);
            assert_int_equal(out[1 - k].status, APC_GOOD); /* the other is not touched by it */
        }
}

/* Promise(experiment/measurement-stale) */
static void a_command_that_is_no_longer_renewed_is_not_written(void **state)
{
    struct apc_sample u[] = {actuator(1, 1, T0, 1.0), actuator(2, 1, T0, 2.0)};

    assert_int_equal(written(*state, 0, u), 3);
    assert_int_equal(written(*state, LIMIT, u), 3);
    assert_int_equal(written(*state, LIMIT + 1, u), 0);
    u[0].seq = 2; /* half of it */
    assert_int_equal(written(*state, LIMIT + 2, u), 1);
    u[1].seq = 2;
    assert_int_equal(written(*state, LIMIT + 3, u), 3);
}

static void a_client_that_starts_late_does_not_write_an_old_command(void **state)
{
    const struct apc_sample u[] = {actuator(1, 5, T0 - LIMIT - 1, 1.0), actuator(2, 5, T0 - LIMIT - 1, 2.0)};

    assert_int_equal(written(*state, 0, u), 0);
    assert_int_equal(written(*state, 1, u), 0);
}

static void a_former_runs_command_is_not_written_and_this_runs_are_whatever_the_clock_does(void **state)
{
    struct apc_client *client = make(T0);
    struct apc_sample u[] = {actuator(1, 5, T0 - 1, 1.0), actuator(2, 5, T0, 2.0)};

    (void)state;
    assert_int_equal(written(client, 1, u), 2); /* the first was written 2 ns ago, but by another run */
    assert_int_equal(written(client, 2, u), 2);
    u[0] = actuator(1, 6, T0 + 3, 1.5);
    assert_int_equal(written(client, 3, u), 3);
    u[0] = actuator(1, 7, T0 - 3600 * S, 1.5); /* the clock stepped back by an hour */
    assert_int_equal(written(client, 4, u), 3);
    apc_client_destroy(client);
}

static void a_clock_step_neither_stops_nor_revives_a_command(void **state)
{
    const struct apc_sample u[] = {actuator(1, 1, T0, 1.0), actuator(2, 1, T0, 2.0)};

    assert_int_equal(written(*state, 0, u), 3);
    assert_int_equal(written_at(*state, (struct apc_now){.mono = 1, .utc = T0 + 3600 * S}, u), 3);
    assert_int_equal(written_at(*state, (struct apc_now){.mono = LIMIT + 2, .utc = T0}, u), 0);
}

/*
 * Promise(links/opcua-one-sample): Over OPC UA the same value, status and time is one sample, whatever
 *   else changes is new; a sample of a laboratory that is read again and again counts once.
 */
static void each_new_measurement_is_stored_once(void **state)
{
    struct apc_value y[] = {{.time = T0, .value = 1.0},
                            {.time = T0, .value = 2.0, .status = APC_BAD_SENSOR_FAILURE}};
    struct apc_sample out[2];

    assert_int_equal(apc_client_measurements(*state, y, out), 2);
    assert_int_equal(out[0].table, APC_SENSOR);
    assert_int_equal(out[0].seq, 42);
    assert_int_equal(out[1].seq, 8);
    assert_int_equal(out[1].id, 2);
    assert_int_equal(out[1].time, T0);
    assert_int_equal(out[1].status, APC_BAD_SENSOR_FAILURE);
    assert_near(out[1].value, 2.0, 0.0);
    assert_int_equal(apc_client_measurements(*state, y, out), 0);
    y[1].time = T0 - 3600 * S; /* the plant's clock stepped back: still new */
    assert_int_equal(apc_client_measurements(*state, y, out), 1);
    assert_int_equal(out[0].id, 2);
    assert_int_equal(out[0].seq, 9);
}

/* Of y 1, 0 to 100, and y 2, at least -10: its status once it shows that. */
static apc_status shown(struct apc_client *client, size_t i, double value)
{
    static apc_ns time = T0;
    time++;
    struct apc_value y[] = {{50.0, APC_GOOD, time}, {50.0, APC_GOOD, time}};
    struct apc_sample out[2];

    y[i].value = value;
    assert_int_equal(apc_client_measurements(client, y, out), 2);
    assert_near(out[i].value, value, 0.0); /* it stays for people to see */
    assert_int_equal(out[i].status == APC_BAD_OUT_OF_RANGE, apc_client_outside(client, i));
    return out[i].status;
}

static struct apc_client *make_ranged(const double *low, const double *high)
{
    const struct apc_client_options o = {
        .size = sizeof(o), .ny = 2, .nu = 2, .command_period = PERIOD, .low = low, .high = high};
    struct apc_client *client = NULL;

    (void)apc_client_create(&client, &o, NULL);
    return client;
}

/*
 * Promise(incoming/beyond-its-range): A number well beyond `low` to `high` of a measurement is no
 *   measurement: Bad, bridged, then the fault value, and said.
 */
static void what_lies_beyond_its_range_is_bad_until_it_is_well_back(void **state)
{
    static const struct {
        size_t i;
        double value;
        bool bad;
    } cases[] = {{0, 0.0, false},    {0, 100.0, false}, {0, -2.5, false},        {0, 106.25, false},
                 {0, -327.68, true}, {0, 50.0, false},  {0, 655.35, true},       {0, -2.0, true},
                 {0, 103.2, true},   {0, 103.1, false}, {0, 106.2, false},       {0, 106.3, true},
                 {0, -1.2, false},   {0, -2.51, true},  {0, 99.0, false},        {1, -10.0, false},
                 {1, -10.1, true},   {1, -10.0, false}, {1, 4294967295.0, false}};
    const double low[] = {0.0, -10.0}, high[] = {100.0, HUGE_VAL}, crossed[] = {101.0, 0.0};
    struct apc_client *client = make_ranged(low, high);

    (void)state;
    assert_non_null(client);
    for (size_t i = 0; i < sizeof(cases) / sizeof(cases[0]); i++)
        if ((shown(client, cases[i].i, cases[i].value) == APC_BAD_OUT_OF_RANGE) != cases[i].bad)
            fail_msg("%zu: %g", i, cases[i].value);
    apc_client_destroy(client);
    assert_null(make_ranged(crossed, high));
}

/* A plant that says itself that a value is Bad is believed, and its number looked at no further. */
static void a_status_that_is_bad_is_the_plants_own(void **state)
{
    const double low[] = {0.0, 0.0}, high[] = {1.0, 1.0};
    struct apc_value y[] = {{0.5, APC_GOOD, T0}, {7.0, APC_BAD_SENSOR_FAILURE, T0}};
    struct apc_client *client = make_ranged(low, high);
    struct apc_sample out[2];

    (void)state;
    assert_int_equal(apc_client_measurements(client, y, out), 2);
    assert_int_equal(out[1].status, APC_BAD_SENSOR_FAILURE);
    assert_false(apc_client_outside(client, 1));
    y[1] = (struct apc_value){7.0, APC_UNCERTAIN, T0 + 1};
    assert_int_equal(apc_client_measurements(client, y, out), 1);
    assert_int_equal(out[0].status, APC_BAD_OUT_OF_RANGE);
    assert_true(apc_client_outside(client, 1));
    assert_false(apc_client_outside(client, 2));
    apc_client_destroy(client);
}

/* Promise(links/opcua-one-sample) */
static void what_changes_under_the_same_time_is_new(void **state)
{
    struct apc_value y[] = {{.time = T0, .value = 1.0}, {.time = T0, .value = 2.0}};
    struct apc_sample out[2];

    assert_int_equal(apc_client_measurements(*state, y, out), 2);
    y[1].status = APC_BAD_SENSOR_FAILURE;
    assert_int_equal(apc_client_measurements(*state, y, out), 1);
    assert_int_equal(out[0].seq, 9);
    assert_int_equal(out[0].status, APC_BAD_SENSOR_FAILURE);
    y[0].value = 1.5;
    assert_int_equal(apc_client_measurements(*state, y, out), 1);
    assert_int_equal(out[0].id, 1);
    assert_near(out[0].value, 1.5, 0.0);
    assert_int_equal(apc_client_measurements(*state, y, out), 0);
}

/* As over modbus: each reading has a time. */
/* Promise(links/opcua-one-sample) */
static void a_sample_of_a_laboratory_that_is_read_again_and_again_counts_once(void **state)
{
    const apc_ns apart[] = {0, 60 * S};
    const struct apc_client_options o = {
        .size = sizeof(o), .ny = 2, .nu = 3, .command_period = PERIOD, .apart = apart};
    struct apc_client *client = NULL;
    struct apc_sample out[2];
    int stored = 0;

    (void)state;
    assert_int_equal(apc_client_create(&client, &o, NULL), 0);
    for (int k = 0; k < 60; k++) {
        const struct apc_value y[] = {{.time = T0 + k * S, .value = 1.0},
                                      {.time = T0 + k * S, .value = k < 20 ? 5.0 : 6.0}};
        const size_t n = apc_client_measurements(client, y, out);

        assert_true(n >= 1);
        assert_int_equal(out[0].seq, k + 1);
        stored += n == 2;
    }
    assert_int_equal(stored, 2);
    /* the next sample says the same as the one before */
    const struct apc_value y[] = {{.time = T0 + 80 * S, .value = 1.0}, {.time = T0 + 80 * S, .value = 6.0}};
    assert_int_equal(apc_client_measurements(client, y, out), 2);
    assert_int_equal(out[1].seq, 3);
    apc_client_destroy(client);
}

static void a_client_without_dimensions_is_refused(void **state)
{
    struct apc_client *client = NULL;
    struct apc_client_options o = {.size = sizeof(o), .ny = 1, .nu = 1, .command_period = PERIOD};

    (void)state;
    o.nu = 0;
    assert_int_equal(apc_client_create(&client, &o, NULL), APC_EINVAL);
    o.nu = 8193;
    assert_int_equal(apc_client_create(&client, &o, NULL), APC_EINVAL);
    o.nu = 8192;
    o.ny = 0;
    assert_int_equal(apc_client_create(&client, &o, NULL), APC_EINVAL);
    o.ny = 8193;
    assert_int_equal(apc_client_create(&client, &o, NULL), APC_EINVAL);
    o.ny = 8192;
    assert_int_equal(apc_client_create(&client, &o, NULL), 0);
    apc_client_destroy(client);
    assert_int_equal(apc_client_create(NULL, &o, NULL), APC_EINVAL);
    o.command_period = 0;
    assert_int_equal(apc_client_create(&client, &o, NULL), APC_EINVAL);
    assert_null(client);
    apc_client_destroy(NULL);
}

/* ---- Source times --------------------------------------------------------------------------- */

#define HOUR (3600 * S)

/* Promise(incoming/clock-of-the-plant) */
static void a_clock_that_is_near_enough_dates_its_samples(void **state)
{
    static const apc_ns off[] = {0, -9 * S, 9 * S};
    (void)state;
    for (size_t k = 0; k < sizeof off / sizeof *off; k++) {
        struct apc_dating d = {0};
        for (apc_ns t = T0; t < T0 + 60 * S; t += S)
            assert_int_equal(apc_dating_look(&d, t + off[k], t, T0), t + off[k]);
        assert_false(d.wrong);
    }
}

/*
 * Promise(incoming/clock-of-the-plant): A plant whose clock is an hour ahead or behind, or in 1970, has
 *   its record, by when the measurements came, and that is said.
 */
static void a_clock_that_is_wrong_dates_nothing_and_is_known(void **state)
{
    static const apc_ns off[] = {HOUR,          -HOUR, -60 * S, 11 * S, -T0, INT64_MAX - T0 - 3 * HOUR,
                                 INT64_MIN + T0};
    (void)state;
    for (size_t k = 0; k < sizeof off / sizeof *off; k++) {
        struct apc_dating d = {0};
        for (apc_ns t = T0; t < T0 + 2 * HOUR; t += S) /* until its times are those of the run's begin */
            assert_int_equal(apc_dating_look(&d, t + off[k], t, T0), t);
        assert_true(d.wrong);
        assert_true(d.off > 0 ? off[k] > 0 : off[k] < 0);
        assert_int_equal(d.looks, APC_DATING_SURE);
        assert_int_equal(apc_dating_look(&d, T0 + 2 * HOUR, T0 + 2 * HOUR, T0),
                         T0 + 2 * HOUR); /* it was set */
        assert_false(d.wrong);
    }
}

/* Of one computer both clocks are stepped, and a sample may be under way. */
static void a_step_of_ones_own_clock_is_not_laid_at_the_plants_door(void **state)
{
    static const apc_ns step[] = {-2 * HOUR, 2 * HOUR, -HOUR};
    struct apc_dating d = {0};
    apc_ns t = T0 + 24 * HOUR;
    unsigned most = 0;
    (void)state;
    for (size_t k = 0; k < sizeof step / sizeof *step; k++) {
        for (int i = 0; i < 10; i++, t += S)
            (void)apc_dating_look(&d, t - S / 2, t, T0);
        assert_false(d.wrong);
        const apc_ns before = t - S / 2;
        t += step[k];
        for (int i = 0; i < 10; i++, t += S) {
            (void)apc_dating_look(&d, i == 0 ? before : t - S / 2, t, T0);
            most = d.looks > most ? d.looks : most;
        }
        assert_false(d.wrong);
    }
    assert_in_range(most, 1, APC_DATING_SURE - 1);
}

/* Such a time is that of the last change, and old with right. */
/* Promise(incoming/clock-of-the-plant) */
static void what_was_at_rest_since_before_the_run_came_when_it_came(void **state)
{
    struct apc_dating d = {0};
    (void)state;
    for (apc_ns t = T0; t < T0 + 60 * S; t += S) { /* the same time, though a status has changed */
        assert_int_equal(apc_dating_look(&d, T0 - HOUR, t, T0), t);
        assert_false(d.wrong);
    }
    assert_int_equal(apc_dating_look(&d, T0 + 60 * S, T0 + 61 * S, T0), T0 + 60 * S);
    assert_int_equal(apc_dating_look(&d, T0 + 60 * S, T0 + HOUR, T0), T0 + 60 * S);
    assert_int_equal(apc_dating_look(&d, T0 + HOUR - S, T0 + HOUR + S, T0), T0 + HOUR - S);
    assert_false(d.wrong);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(a_clock_that_is_near_enough_dates_its_samples),
        cmocka_unit_test(a_clock_that_is_wrong_dates_nothing_and_is_known),
        cmocka_unit_test(a_step_of_ones_own_clock_is_not_laid_at_the_plants_door),
        cmocka_unit_test(what_was_at_rest_since_before_the_run_came_when_it_came),
        cmocka_unit_test(a_variable_is_fresh_until_its_mark_stood_still_for_the_horizon),
        cmocka_unit_test(the_first_look_believes_the_stamp_within_the_horizon),
        cmocka_unit_test(an_age_seen_at_the_first_look_counts_on),
        cmocka_unit_test(what_is_stamped_when_written_is_as_old_as_its_stamp_says),
        cmocka_unit_test(a_stamp_that_lies_outside_the_looks_is_not_believed),
        cmocka_unit_test_setup_teardown(a_whole_fresh_vector_is_given_as_it_is, set_up, tear_down),
        cmocka_unit_test_setup_teardown(what_is_missing_bad_or_not_finite_is_not_written, set_up, tear_down),
        cmocka_unit_test_setup_teardown(a_command_that_is_no_longer_renewed_is_not_written, set_up,
                                        tear_down),
        cmocka_unit_test_setup_teardown(a_client_that_starts_late_does_not_write_an_old_command, set_up,
                                        tear_down),
        cmocka_unit_test(a_former_runs_command_is_not_written_and_this_runs_are_whatever_the_clock_does),
        cmocka_unit_test_setup_teardown(a_clock_step_neither_stops_nor_revives_a_command, set_up, tear_down),
        cmocka_unit_test_setup_teardown(each_new_measurement_is_stored_once, set_up, tear_down),
        cmocka_unit_test(what_lies_beyond_its_range_is_bad_until_it_is_well_back),
        cmocka_unit_test(a_status_that_is_bad_is_the_plants_own),
        cmocka_unit_test_setup_teardown(what_changes_under_the_same_time_is_new, set_up, tear_down),
        cmocka_unit_test(a_sample_of_a_laboratory_that_is_read_again_and_again_counts_once),
        cmocka_unit_test(a_client_without_dimensions_is_refused),
    };

    return cmocka_run_group_tests(tests, NULL, NULL);
}

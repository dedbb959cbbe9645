/* SPDX-License-Identifier: BSD-3-Clause */
/* What laws expected at an instant, beside what came of it. */
#include "check.h"

#include <string.h>

#include "record/record.h"

#define S APC_NS_PER_S

/* "upper" expects y1 and plans the setpoint r1, 4 steps of 2 s; the other two are nobody's expectation. */
static const struct apc_tag tags[] = {
    {.table = APC_SENSOR, .id = 1, .name = "y1", .unit = "cm", .period = 1.0},
    {.table = APC_SENSOR, .id = 2, .name = "y11"},
    {.table = APC_SETPOINT, .id = 3, .name = "r1"},
    {.table = APC_PREDICTION,
     .id = 1,
     .name = "upper.y1.prediction",
     .controller = "upper",
     .step = 2.0,
     .length = 4},
    {.table = APC_PREDICTION,
     .id = 2,
     .name = "upper.r1.plan",
     .controller = "upper",
     .step = 2.0,
     .length = 4},
    {.table = APC_PREDICTION,
     .id = 3,
     .name = "upper.d1.prediction",
     .controller = "upper",
     .step = 2.0,
     .length = 4},
    {.table = APC_PREDICTION, .id = 4, .name = "y11.prediction", .length = 4},
};
#define TAGS (sizeof tags / sizeof *tags)

static struct apc_store *store;
static struct prediction prediction;

static int begin(void **state)
{
    struct apc_error why;
    (void)state;
    prediction = (struct prediction){0};
    assert_int_equal(apc_store_open(&store, "mem:", NULL, &why), 0);
    assert_true(apc_store_init(store) >= 0);
    return 0;
}

static int end(void **state)
{
    (void)state;
    prediction_free(&prediction);
    apc_store_close(store);
    return 0;
}

static void publish(int id, int64_t seq, apc_ns at, double first)
{
    double value[4] = {first, first + 1, first + 2, first + 3};
    struct apc_vector v = {
        .table = APC_PREDICTION, .id = id, .seq = seq, .time = at, .n = 4, .room = 4, .value = value};
    assert_true(
        apc_store_append_rows(
            store, &(struct apc_rows){.size = sizeof(struct apc_rows), .vector = &v, .n_vectors = 1}) >= 0);
}

static void put(enum apc_table table, int id, int64_t seq, apc_ns at, double value, apc_status status)
{
    const struct apc_sample s = {
        .table = table, .id = id, .seq = seq, .time = at, .value = value, .status = status};
    assert_true(apc_store_append(store, &s, 1) >= 0);
}

static void load(apc_ns at)
{
    prediction_free(&prediction);
    assert_int_equal(prediction_load(&prediction, store, tags, TAGS, at, 0), 0);
}

/*
 * Promise(laws/predictive-law-expected): What a predictive law expected at a time is shown beside what
 *   came, of a run and of a store, as a table, as JSON, in the figure and in the HTTP API.
 */
static void it_is_the_newest_plan_until_then_whose_horizon_is_not_over(void **state)
{
    (void)state;
    for (int id = 1; id <= 4; id++) {
        publish(id, 1, 100 * S, 10.0 * id);
        publish(id, 2, 110 * S, 100.0 * id);
    }
    load(100 * S - 1);
    assert_int_equal(prediction.n, 0);
    load(105 * S);
    assert_int_equal(prediction.n, 2); /* neither of what is no variable, nor of what is no course in time */
    const struct prediction_trajectory *y = &prediction.trajectory[0], *r = &prediction.trajectory[1];
    assert_string_equal(y->name, "y1");
    assert_string_equal(y->unit, "cm");
    assert_int_equal(y->table, APC_SENSOR);
    assert_int_equal(r->table, APC_SETPOINT);
    assert_int_equal(r->id, 3);
    assert_true(y->made == 100 * S && y->n == 4);
    assert_near(y->expected[3], 13.0, 0.0);
    assert_near(prediction_ahead(y, 0), 2.0,
                0.0); /* predicted from the next sample on, planned from now on */
    assert_near(prediction_ahead(r, 0), 0.0, 0.0);
    assert_true(isnan(y->came[0]));
    load(110 * S);
    assert_near(prediction.trajectory[0].expected[0], 100.0, 0.0);
    load(119 * S);
    assert_int_equal(prediction.n, 1); /* what is predicted reaches a step further than what is planned */
    load(120 * S);
    assert_int_equal(prediction.n, 0);
}

/* Promise(laws/predictive-law-expected) */
static void what_came_is_what_was_measured_then_and_what_went_out(void **state)
{
    (void)state;
    publish(1, 1, 100 * S, 0);
    publish(2, 1, 100 * S, 0);
    put(APC_SENSOR, 1, 1, 99 * S, 5.0, APC_GOOD);
    put(APC_SENSOR, 1, 2, 101 * S, 6.0, APC_GOOD);
    put(APC_SENSOR, 1, 3, 104 * S, 7.0, APC_BAD);
    put(APC_SENSOR, 1, 4, 105 * S, 8.0, APC_GOOD); /* and none for longer than it stands */
    put(APC_SENSOR, 2, 1, 102 * S, 99.0, APC_GOOD);
    put(APC_SETPOINT, 3, 1, 90 * S, 1.0, APC_GOOD);
    put(APC_SETPOINT, 3, 2, 100 * S + S / 10, 2.0, APC_GOOD); /* a tick writes when it has computed */
    put(APC_SETPOINT, 3, 3, 102 * S + S / 10, 3.0, APC_GOOD);
    put(APC_SETPOINT, 3, 4, 106 * S + S / 10, 4.0, APC_GOOD);
    load(101 * S);
    assert_int_equal(prediction_take_store(&prediction, store, 106 * S + S / 2), 0);
    const double *y = prediction.trajectory[0].came, *r = prediction.trajectory[1].came;
    assert_near(y[0], 6.0, 0.0);
    assert_true(isnan(y[1]));
    assert_near(y[2], 8.0, 0.0);
    assert_true(isnan(y[3]));
    assert_near(r[0], 2.0, 0.0);
    assert_near(r[1], 3.0, 0.0);
    assert_near(r[2], 3.0, 0.0);
    assert_true(isnan(r[3])); /* still to come */
}

/* Promise(laws/predictive-law-expected) */
static void rows_that_are_at_hand_say_the_same(void **state)
{
    const struct apc_sample rows[] = {
        {.table = APC_SENSOR, .id = 1, .time = 1 * S, .value = 6.0},
        {.table = APC_SETPOINT, .id = 3, .time = 1 * S, .value = 2.0},
        {.table = APC_SENSOR, .id = 1, .time = 4 * S, .value = 7.0},
        {.table = APC_SENSOR, .id = 2, .time = 8 * S, .value = 0.0},
    };
    (void)state;
    publish(1, 1, 100 * S, 0);
    publish(2, 1, 100 * S, 0);
    assert_int_equal(prediction_load(&prediction, store, tags, TAGS, 1 * S, 100 * S), 0);
    assert_int_equal(prediction.n, 2);
    assert_true(prediction.trajectory[0].made == 0);
    prediction_take(&prediction, rows, sizeof rows / sizeof *rows);
    assert_near(prediction.trajectory[0].came[0], 6.0, 0.0);
    assert_near(prediction.trajectory[0].came[1], 7.0, 0.0);
    assert_true(isnan(prediction.trajectory[0].came[3]));    /* 4 s old: older than three periods and 0.1 s */
    assert_near(prediction.trajectory[1].came[3], 2.0, 0.0); /* until the record ends */
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test_setup_teardown(it_is_the_newest_plan_until_then_whose_horizon_is_not_over, begin,
                                        end),
        cmocka_unit_test_setup_teardown(what_came_is_what_was_measured_then_and_what_went_out, begin, end),
        cmocka_unit_test_setup_teardown(rows_that_are_at_hand_say_the_same, begin, end),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}

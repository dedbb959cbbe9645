/* SPDX-License-Identifier: BSD-3-Clause */
/* Figures of merit of records whose figures are known by hand. */
/*
 * Promise(laws/time-service-limits): Time in service and at limits, deviations with and without service,
 *   errors of predictions and what held plans back are those of the record, over any window of a run or of
 *   a store.
 */
#include "check.h"

#include <stdlib.h>
#include <string.h>

#include "figures/figures.h"

#define S APC_NS_PER_S

static const char text[] =
    "name = \"merits\"; duration = 100.0;"
    "measurements = ( { name = \"y\"; } ); setpoints = ( { name = \"r\"; } ); outputs "
    "= ( { name = \"u\"; } );"
    "plant = { model = \"first-order\"; period = 0.5; }; client = { period = 1.0; };"
    "controller = { law = \"mpc\"; period = 2.0; operating_point = { u = [0.0]; };"
    "  settings = { horizon = 4; blocks = [1, 1]; y_scale = [1.0]; u_scale = [1.0]; }; };";

static struct experiment e;
static struct apc_tag *tags;
static size_t n_tags;
static struct loops loops;
static struct samples process, operation;
static struct apc_store *published;
static struct kpis m;

static int begin(void **state)
{
    struct apc_error why;
    (void)state;
    process = operation = (struct samples){0};
    m = (struct kpis){0};
    if (experiment_parse(&e, &(struct experiment_source){.file = "merits", .text = text},
                         EXPERIMENT_LAW | EXPERIMENT_MODEL, NULL, &why) < 0)
        fail_msg("%s", why.text);
    assert_int_equal(apc_store_open(&published, "mem:", NULL, &why), 0);
    assert_true(apc_store_init(published) >= 0);
    tags = provision_tags(&e, &n_tags);
    assert_non_null(tags);
    assert_int_equal(controllers_describe(&e, &loops), 0);
    return 0;
}

static int end(void **state)
{
    (void)state;
    kpis_free(&m);
    samples_free(&process);
    samples_free(&operation);
    loops_free(&loops);
    free(tags);
    apc_store_close(published);
    experiment_free(&e);
    return 0;
}

static void row(struct samples *to, double t, enum apc_table table, int id, apc_status status, double value)
{
    const struct apc_sample s = {
        .table = table, .id = id, .time = (apc_ns)(t * 1e9), .status = status, .value = value};
    assert_int_equal(samples_add(to, &s), 0);
}

static void mode(double t, enum apc_mode actual, apc_status status)
{
    row(&operation, t, APC_ACTUAL, apc_variable_number(APC_OPMODE, 1), status, actual);
}

static void output(double t, apc_status status)
{
    row(&process, t, APC_ACTUATOR, 1, status, 1.0);
}

static void make(double from, double until)
{
    const struct kpis_source source = {.tag = tags,
                                       .n_tags = n_tags,
                                       .loops = &loops,
                                       .process = &process,
                                       .operation = &operation,
                                       .published = published,
                                       .offset = 1000 * S,
                                       .from = (apc_ns)(from * 1e9),
                                       .until = (apc_ns)(until * 1e9)};
    kpis_free(&m);
    assert_int_equal(kpis_make(&m, &source), 0);
    assert_int_equal(m.n_loops, 1);
}

/* 100 s, an output every 2 s: in Auto from 10 s, held 20 to 30, by the backup law 40 to 50, at its fault
 * value 50 to 60, in Man 70 to 80, and gone from 90 s on. */
static void time_in_service_is_that_of_the_laws_own_answers(void **state)
{
    (void)state;
    mode(0, APC_MODE_MAN, APC_GOOD);
    mode(10, APC_MODE_AUTO, APC_GOOD);
    mode(40, APC_MODE_AUTO, APC_GOOD_LOCAL_OVERRIDE);
    mode(50, APC_MODE_LO, APC_UNCERTAIN);
    mode(60, APC_MODE_CAS, APC_GOOD);
    mode(70, APC_MODE_MAN, APC_GOOD);
    mode(80, APC_MODE_AUTO, APC_GOOD);
    for (int t = 0; t < 90; t += 2)
        output(t, t >= 20 && t < 30   ? APC_UNCERTAIN_LAST_USABLE
                  : t >= 50 && t < 60 ? APC_UNCERTAIN_SUBSTITUTE
                  : t >= 60 && t < 64 ? APC_GOOD_LIMITED_LOW
                  : t >= 80 && t < 90 ? APC_GOOD_LIMITED_HIGH
                                      : APC_GOOD);
    make(0, 100);
    /* 10..20, 30..40, 60..70, 80..90, and the last row stands for 3 periods and 0.1 s */
    assert_near(m.loop[0].service, (10 + 10 + 10 + 8 + 6.1) / 100, 1e-9);
    assert_near(m.loop[0].low, 0.04, 1e-9);
    assert_near(m.loop[0].high, (8 + 6.1) / 100, 1e-9);
    const double in[] = {0.2, (40 + 14.1) / 100, 0, 0.1, 0, 0.1};
    for (int i = APC_MODE_MAN; i <= APC_MODE_LO; i++)
        assert_near(m.loop[0].mode[i], in[i], 1e-9);
    assert_near(m.loop[0].stopped, 0.059, 1e-9);
    make(35, 45); /* what was before the window still holds in it */
    assert_near(m.loop[0].service, 0.5, 1e-9);
    make(0, 10);
    assert_true(isnan(m.loop[0].iae)); /* nothing was measured */
    assert_near(m.loop[0].service, 0.0, 0.0);
    make(98, 100);
    assert_near(m.loop[0].service, 0.0, 0.0);
}

/* Promise(incoming): Figures leave out what is Bad. */
static void deviations_with_and_without_service_are_those_by_hand(void **state)
{
    (void)state;
    mode(0, APC_MODE_MAN, APC_GOOD);
    mode(100, APC_MODE_AUTO, APC_GOOD);
    row(&process, 0, APC_SENSOR, 1, APC_GOOD, 99.0); /* no setpoint yet: no error */
    row(&process, 0, APC_SETPOINT, 1, APC_GOOD, 10.0);
    for (int t = 0; t < 200; t++) {
        const double error = (t < 100 ? 3 : 1) * (t % 2 ? -1 : 1);
        if (t % 2 == 0)
            output(t, APC_GOOD);
        if (t == 150)
            row(&process, 150, APC_SETPOINT, 1, APC_GOOD, 20.0);
        row(&process, t + 0.5, APC_SENSOR, 1, APC_GOOD, (t < 150 ? 10 : 20) + error);
        row(&process, t + 0.7, APC_SENSOR, 1, APC_BAD, 1e6);
    }
    make(0, 200);
    assert_near(m.loop[0].without, 3 * sqrt(100.0 / 99), 1e-12);
    assert_near(m.loop[0].with, sqrt(100.0 / 99), 1e-12);
    assert_near(m.loop[0].benefit, 2.0 / 3, 1e-12);
    /* each measurement holds until the next, which is Bad; the first one for half a second */
    assert_near(m.loop[0].iae, 89 * 0.5 + 100 * 0.2 * (3 + 1), 1e-6);
    make(100, 200);
    assert_true(isnan(m.loop[0].without) && isnan(m.loop[0].benefit));
    make(90, 200); /* out of service for a moment: five periods */
    assert_near(m.loop[0].without, 3 * sqrt(10.0 / 9), 1e-12);
    assert_true(isnan(m.loop[0].benefit));
    make(0, 110);
    assert_true(m.loop[0].with > 0 && isnan(m.loop[0].benefit));
}

#define MANY 30

/* Of loop @p i, or of all: two share a setpoint. */
static void record_many(int i)
{
    process.n = operation.n = 0;
    for (int k = 0; k < MANY; k++)
        if (i < 0 || i == k)
            row(&operation, 0, APC_ACTUAL, apc_variable_number(APC_OPMODE, k + 1), APC_GOOD, APC_MODE_AUTO);
    for (int t = 0; t < 100; t++)
        for (int k = 0; k < MANY; k++) {
            if (k % 2 == 0 && (i < 0 || i / 2 == k / 2))
                row(&process, t + 0.01 * k, APC_SETPOINT, k / 2 + 1, APC_GOOD, t / 7.0 + k);
            if (i >= 0 && i != k)
                continue;
            row(&process, t + 0.01 * k + 0.003, APC_SENSOR, k + 1, APC_GOOD, t / 7.1 + k);
            row(&process, t + 0.01 * k + 0.007, APC_ACTUATOR, k + 1, t % 9 ? APC_GOOD : APC_GOOD_LIMITED_LOW,
                1.0);
        }
}

/* To the last bit: what others record is not even looked at, so that the time it takes does not grow with the
 * product of loops and rows. */
static void a_loop_is_judged_by_its_own_rows(void **state)
{
    struct loops_loop many[MANY];
    struct kpis alone, all;
    const struct loops of = {.at = many, .n = MANY, .controller = loops.controller, .n_controllers = 1};
    const struct kpis_source source = {
        .loops = &of, .process = &process, .operation = &operation, .from = S / 3, .until = 99 * S + S / 7};
    (void)state;
    for (int k = 0; k < MANY; k++)
        many[k] = (struct loops_loop){.id = k + 1,
                                      .table = APC_ACTUATOR,
                                      .output = k + 1,
                                      .measurement = k + 1,
                                      .setpoint = k / 2 + 1,
                                      .above = -1};
    record_many(-1);
    assert_int_equal(kpis_make(&all, &source), 0);
    assert_int_equal(all.n_loops, MANY);
    for (int k = 0; k < MANY; k++) {
        record_many(k);
        assert_int_equal(kpis_make(&alone, &source), 0);
        assert_true(alone.loop[k].service > 0.9 && alone.loop[k].low > 0.1 && alone.loop[k].iae > 0);
        assert_memory_equal(&alone.loop[k].service, &all.loop[k].service,
                            offsetof(struct kpis_loop, health) - offsetof(struct kpis_loop, service));
        kpis_free(&alone);
    }
    kpis_free(&all);
}

static void publish(double t, double first, double last, double limits)
{
    double value[4] = {first, 0, 0, last};
    struct apc_vector v = {.table = APC_PREDICTION,
                           .id = 1,
                           .seq = (int64_t)t + 1,
                           .time = 1000 * S + (apc_ns)(t * 1e9),
                           .n = 4,
                           .room = 4,
                           .value = value};
    const struct apc_sample s = {
        .table = APC_ESTIMATE, .id = 4, .seq = (int64_t)t + 1, .time = v.time, .value = limits};
    const struct apc_rows rows = {.size = sizeof rows, .vector = &v, .n_vectors = 1};
    assert_true(apc_store_append_rows(published, &rows) >= 0);
    assert_true(apc_store_append(published, &s, 1) >= 0);
}

/* y = t, measured every second; predictions of steps of 2 s. */
static void predictions_are_held_against_what_was_measured_then(void **state)
{
    (void)state;
    for (int t = 0; t <= 40; t++)
        row(&process, t, APC_SENSOR, 1, t == 20 ? APC_BAD : APC_GOOD, t);
    for (int t = 0; t < 40; t += 2)
        publish(t, t + 2 + (t % 4 ? 0.3 : 0.4), t + 8 - 2.5, t < 10 ? 1 : t < 20 ? 6 : 0);
    make(0, 40);
    assert_int_equal(m.n_predictions, 1);
    const struct kpis_prediction *p = &m.prediction[0];
    assert_string_equal(p->name, "y");
    assert_int_equal(p->length, 4);
    assert_near(p->step, 2.0, 0.0);
    assert_int_equal(p->n_first, 18); /* of 20: one would come true at the end, one when y was Bad */
    assert_int_equal(p->n_last, 15);
    assert_near(p->first, sqrt((0.09 * 8 + 0.16 * 10) / 18), 1e-12);
    assert_near(p->last, 2.5, 1e-12);
    assert_int_equal(m.n_limits, 2);
    assert_string_equal(m.limit[0].name, "y");
    assert_string_equal(m.limit[1].name, "u");
    assert_near(m.limit[0].low, 0.25, 1e-12);
    assert_near(m.limit[0].high, 0.25, 1e-12);
    assert_near(m.limit[0].falls, 0.25, 1e-12);
    make(30, 40);
    assert_int_equal(m.prediction[0].n_last, 1);
    make(50, 60);
    assert_true(isnan(m.prediction[0].first) && m.prediction[0].n_first == 0);
}

static void a_store_is_judged_of_the_time_it_knows(void **state)
{
    struct apc_sample y = {.table = APC_SENSOR, .id = 1, .seq = 1, .time = 1000 * S, .value = 1.0};
    (void)state;
    assert_int_equal(kpis_of_store(&m, published, 1000 * S, 1010 * S, 100), APC_ENOTFOUND); /* no loops */
    kpis_free(&m);
    assert_true(provision(published, &e, PROVISION_KEEP) >= 0);
    assert_int_equal(kpis_of_store(&m, published, 1000 * S, 1010 * S, 100), APC_ENOTFOUND); /* no rows */
    assert_int_equal(m.n_loops, 0);
    kpis_free(&m);
    assert_int_equal(apc_store_append(published, &y, 1), 1);
    y = (struct apc_sample){.table = APC_SENSOR, .id = 1, .seq = 2, .time = 1004 * S, .value = 2.0};
    assert_int_equal(apc_store_append(published, &y, 1), 1);
    static const struct {
        apc_ns from, until;
        size_t most;
        int rc;
        apc_ns begins, ends; /* what is judged */
    } of[] = {
        {990 * S, 1010 * S, 2, 0, 1000 * S, 1004 * S + 1},
        {1002 * S, 1003 * S, 2, APC_ENOTFOUND, 0, 0}, /* nothing came meanwhile */
        {1004 * S, 1010 * S, 2, 0, 1004 * S, 1004 * S + 1},
        {1004 * S + 1, 1010 * S, 2, APC_ENOTFOUND, 0, 0}, /* it ended just before */
        {1005 * S, 1010 * S, 2, APC_ENOTFOUND, 0, 0},
        {990 * S, 1000 * S, 2, APC_ENOTFOUND, 0, 0},
        {990 * S, 1010 * S, 1, APC_ERANGE, 0, 0},
    };
    for (size_t i = 0; i < sizeof of / sizeof *of; i++) {
        const int rc = kpis_of_store(&m, published, of[i].from, of[i].until, of[i].most);
        if (rc != of[i].rc)
            fail_msg("case %zu: %s", i, apc_err_name(rc));
        assert_int_equal(m.n_loops, rc == 0);
        if (rc == 0 && (m.from != of[i].begins || m.until != of[i].ends))
            fail_msg("case %zu: %g to %g s", i, apc_ns_to_s(m.from), apc_ns_to_s(m.until));
        kpis_free(&m);
    }
}

static void append(enum apc_table table, int id, int t, apc_status status)
{
    const struct apc_sample s = {
        .table = table, .id = id, .seq = t + 1, .time = t * S, .status = status, .value = t};
    assert_int_equal(apc_store_append(published, &s, 1), 1);
}

/* Promise(laws): Outages of a report are what the record lacks: measurements that did not come or were Bad, and
 *   outputs that no controller wrote; what went and came together is one, and what never came is none. */
static void outages_are_what_the_record_lacks(void **state)
{
    static const struct apc_tag of[] = {
        {.table = APC_SENSOR, .id = 1, .name = "y1", .period = 1},
        {.table = APC_SENSOR, .id = 2, .name = "y2", .period = 1},
        {.table = APC_SENSOR, .id = 3, .name = "never", .period = 1},
        {.table = APC_SENSOR, .id = 4, .name = "seldom"},
        {.table = APC_ACTUATOR, .id = 1, .name = "u", .period = 2},
        {.table = APC_SENSOR, .id = 5, .name = "fast", .period = 0.1},
        {.table = APC_SENSOR, .id = 6, .name = "faster", .period = 0.1},
    };
    static const struct outage expected[] = {{119 * S, 130 * S, APC_SENSOR, APC_GOOD, 0, 2},
                                             {150 * S, 155 * S, APC_SENSOR, APC_BAD, 0, 1},
                                             {160 * S, 200 * S, APC_ACTUATOR, APC_GOOD, 6, 1}};
    struct outages o;
    (void)state;
    assert_int_equal(apc_store_put_tags(published, of, sizeof of / sizeof *of), sizeof of / sizeof *of);
    append(APC_SENSOR, 4, 100, APC_GOOD);
    for (int t = 90; t < 200; t++) {
        if (t < 120 || t >= 130) {
            append(APC_SENSOR, 1, t, t >= 150 && t < 155 ? APC_BAD : APC_GOOD);
            append(APC_SENSOR, 2, t, APC_GOOD);
        }
        if (t % 2 == 0 && t <= 160)
            append(APC_ACTUATOR, 1, t, APC_GOOD);
    }
    assert_int_equal(outages_of_store(&o, published, 100 * S, 200 * S), 0);
    assert_int_equal(o.n, sizeof expected / sizeof *expected);
    assert_memory_equal(o.at, expected, sizeof expected);
    assert_true(o.down == (11 + 5 + 40) * S);
    outages_free(&o);
    assert_int_equal(outages_of_store(&o, published, 125 * S, 152 * S), 0);
    assert_int_equal(o.n, 2);
    assert_true(o.at[0].from == 125 * S && o.at[1].until == 152 * S && o.down == 7 * S);
    outages_free(&o);
    /* twice within a second is two, and the other one's time counts whole */
    for (int id = 5; id <= 6; id++)
        for (int i = 0; i < 10; i++) {
            const bool bad = id == 5 ? i == 2 || i == 6 : i >= 2 && i < 9;
            const struct apc_sample s = {.table = APC_SENSOR,
                                         .id = id,
                                         .seq = i + 1,
                                         .time = 10 * S + i * (S / 10),
                                         .status = bad ? APC_BAD : APC_GOOD};
            assert_int_equal(apc_store_append(published, &s, 1), 1);
        }
    assert_int_equal(outages_of_store(&o, published, 10 * S, 11 * S), 0);
    assert_int_equal(o.n, 2);
    assert_true(o.at[0].n == 2 && o.at[1].n == 1 && o.at[1].from == 10 * S + 6 * (S / 10));
    assert_true(o.down == 7 * (S / 10));
    outages_free(&o);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
#define TEST(name) cmocka_unit_test_setup_teardown(name, begin, end)
        TEST(time_in_service_is_that_of_the_laws_own_answers),
        TEST(deviations_with_and_without_service_are_those_by_hand),
        TEST(a_loop_is_judged_by_its_own_rows),
        TEST(predictions_are_held_against_what_was_measured_then),
        TEST(a_store_is_judged_of_the_time_it_knows),
        TEST(outages_are_what_the_record_lacks),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}

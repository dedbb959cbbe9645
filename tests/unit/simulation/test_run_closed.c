/* SPDX-License-Identifier: BSD-3-Clause */
/* A record in closed loop: under the law that ran it is the record to the last bit, also a part of it, of a store, and
 * of one that is packed.
 */
#include "check.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>

#include "files/files.h"
#include "record/record.h"
#include "scratch.h"
#include "simulation/simulation.h"

#define S(t) (SIMULATION_BEGIN + (apc_ns)((t)*1e9))

static struct apc_error why;
static struct experiment e;
static struct apc_store *store;
static struct closed closed;

/* ---- A store as daemons leave it ------------------------------------------------------------ */

static apc_ns later; /* by which rows come later, and all of them are of another start */

/* Of one variable, at once. */
static struct apc_sample *row;
static struct apc_vector *vector;
static size_t rows;

static int take_copied_sample(void *ctx, const struct apc_sample *sample)
{
    const uint32_t *author = ctx;
    assert_true(apc_grow(&row, rows + 1, sizeof *row));
    row[rows] = *sample;
    row[rows].time += later;
    row[rows].seq += later / APC_NS_PER_MS;
    row[rows++].author = sample->author ? *author : 0;
    return 0;
}

static int take_copied_vector(void *ctx, const struct apc_vector *from)
{
    (void)ctx;
    assert_true(apc_grow(&vector, rows + 1, sizeof *vector));
    vector[rows] = *from;
    vector[rows].time += later;
    vector[rows].seq += later / APC_NS_PER_MS;
    vector[rows].room = from->n;
    vector[rows].value = calloc(from->n, sizeof(double));
    assert_non_null(vector[rows].value);
    memcpy(vector[rows++].value, from->value, from->n * sizeof(double));
    return 0;
}

static void copy_variable(struct apc_store *from, const struct apc_sample *variable, uint32_t author)
{
    const struct apc_range all = {0};
    rows = 0;
    if (apc_table_vectors(variable->table)) {
        assert_true(apc_store_vectors(from, variable->table, variable->id, &all, take_copied_vector, NULL) >=
                    0);
        const struct apc_rows out = {.size = sizeof out, .vector = vector, .n_vectors = rows};
        assert_true(apc_store_append_rows(store, &out) >= 0);
        for (size_t i = 0; i < rows; i++)
            free(vector[i].value);
        return;
    }
    assert_true(apc_store_history(from, variable->table, variable->id, &all, take_copied_sample, &author) >=
                0);
    if (apc_store_append(store, row, rows) < 0)
        fail_msg("%s %d: %s", apc_table_name(variable->table), variable->id, apc_store_error(store));
}

static void copy_store(struct apc_store *from)
{
    struct apc_sample variable[200];
    const int n = apc_store_variables(from, variable, 200), author = apc_store_author(store, "tester");
    assert_in_range(n, 1, 199);
    assert_true(author > 0);
    for (int i = 0; i < n; i++)
        copy_variable(from, &variable[i], (uint32_t)author);
    free(row);
    free(vector);
    row = NULL;
    vector = NULL;
}

static void record(const char *name, const struct experiment_setting *set, size_t n)
{
    const struct experiment_overrides overrides = {.set = set, .n_set = n};
    char file[300], uri[300];
    struct simulation s;
    snprintf(file, sizeof file, APC_SOURCE_DIR "/experiments/%s.conf", name);
    snprintf(uri, sizeof uri, "sqlite:%s", scratch_path(name));
    (void)remove(scratch_path(name)); /* another test's */
    if (experiment_load(&e, file, EXPERIMENT_MODEL | EXPERIMENT_LAW, &overrides, &why) < 0 ||
        simulation_create(&s, &e, e.seed, &why) < 0 || simulation_run(&s, e.duration) < 0 ||
        apc_store_open(&store, uri, NULL, &why) < 0)
        fail_msg("%s", why.text);
    assert_true(apc_store_init(store) >= 0);
    copy_store(s.store);
    assert_true(provision(store, &e, PROVISION_KEEP) >= 0);
    simulation_destroy(&s);
}

static int end(void **state)
{
    (void)state;
    closed_free(&closed);
    closed = (struct closed){.since = 0};
    apc_store_close(store);
    store = NULL;
    experiment_free(&e);
    e = (struct experiment){.file = ""};
    later = 0;
    return 0;
}

/* ---- What comes of it ----------------------------------------------------------------------- */

static int close_loop(apc_ns since, apc_ns until)
{
    closed_free(&closed);
    return closed_load(&closed, &(struct replay_range){.store = store, .since = since, .until = until}, &why);
}

static void assert_record(const char *what)
{
    struct samples made = {0};
    size_t k = 0, n = 0;
    if (closed_run(&closed, NULL, &made, &why) < 0)
        fail_msg("%s: %s", what, why.text);
    for (size_t i = 0; i < closed.all.n; i++) {
        const struct apc_sample *was = &closed.all.at[i];
        if (was->table == APC_SETPOINT || was->time < closed.since || was->time >= closed.end)
            continue;
        while (k < made.n && (made.at[k].table == APC_SETPOINT || made.at[k].time < was->time))
            k++;
        size_t j = k;
        while (j < made.n && made.at[j].time == was->time &&
               (made.at[j].table != was->table || made.at[j].id != was->id))
            j++;
        if (j == made.n || made.at[j].time != was->time ||
            memcmp(&made.at[j].value, &was->value, sizeof was->value) != 0 ||
            made.at[j].status != was->status)
            fail_msg("%s: %s %d at %g s is another", what, apc_table_name(was->table), was->id,
                     apc_ns_to_s(was->time));
        n++;
    }
    samples_free(&made);
    assert_true(n > 100);
}

static bool is_noted(const char *text)
{
    for (size_t i = 0; i < closed.n_notes; i++)
        if (strstr(closed.note[i], text))
            return true;
    return false;
}

static const struct experiment_setting eventful[] = {
    {"measurements.y.noise", "0.05"},
    {"measurements.y.faults", "( { kind = \"dropout\"; at = 300.0; duration = 5.0; } )"},
    {"actions",
     "( { at = 30.2; mode = \"u\"; value = \"Man\"; }, { at = 36.2; set = \"u\"; value = 1.4; },"
     "{ at = 50.2; mode = \"u\"; value = \"Auto\"; }, { at = 90.2; set = \"Kp\"; value = 0.3; },"
     "{ at = 170.2; kill = \"controller\"; }, { at = 178.3; start = \"controller\"; },"
     "{ at = 200.2; mode = \"u\"; value = \"Man\"; }, { at = 230.2; mode = \"u\"; value = \"Auto\"; } )"}};

/* Promise(simulation/replay-closed-part): In closed loop with the model the law that ran gives the record bit for bit, of
 *   stores too and of any time of them: over changes of mode and tuning, restarts and Bad samples; with another start in
 *   that time it is refused. */
static void under_the_law_that_ran_it_is_the_record(void **state)
{
    static const double part[][2] = {{0, 1000}, {40, 600}, {100.3, 250}, {172, 420}, {215, 330}, {299, 600}};
    const struct apc_retention packed = {.size = sizeof packed, .packed = 1};
    char what[60];
    (void)state;
    record("first-order", eventful, sizeof eventful / sizeof *eventful);
    for (int i = 0; i < 2; i++) {
        for (size_t k = 0; k < sizeof part / sizeof *part; k++) {
            snprintf(what, sizeof what, "%s, %g to %g s", i ? "packed" : "in rows", part[k][0], part[k][1]);
            if (close_loop(S(part[k][0]), S(part[k][1])) < 0)
                fail_msg("%s: %s", what, why.text);
            assert_record(what);
            assert_int_equal(is_noted("ticks are not on record"), part[k][0] < 178 && part[k][1] > 178);
            assert_int_equal(is_noted("were Bad, and are so again"), part[k][1] > 305);
            assert_int_equal(is_noted("people wrote 1 tuning values"), part[k][0] < 90);
        }
        assert_true(apc_store_maintain(store, &packed) >= 0);
    }
}

static void layers_of_controllers_are_closed_at_once(void **state)
{
    (void)state;
    record("two-layers", NULL, 0);
    if (close_loop(S(300), S(700)) < 0)
        fail_msg("%s", why.text);
    assert_record("two layers");
}

/* Promise(simulation/replay-closed-part) */
static void a_schedule_that_ends_is_where_it_was(void **state)
{
    (void)state;
    record("four-tank", NULL, 0);
    if (close_loop(S(1236), S(1836)) < 0)
        fail_msg("%s", why.text);
    assert_record("behind its last step");
    if (close_loop(S(760), S(1100)) < 0)
        fail_msg("%s", why.text);
    assert_record("over its last step");
}

static void what_cannot_be_closed_is_refused(void **state)
{
    (void)state;
    record("first-order", NULL, 0);
    assert_int_equal(close_loop(S(-100), S(-50)), APC_ENOTFOUND);
    assert_int_equal(close_loop(S(700), S(800)), APC_ENOTFOUND);
    assert_int_equal(close_loop(S(101), S(101.5)), APC_ENOTFOUND);
    later = 1000 * APC_NS_PER_S + 70 * APC_NS_PER_MS; /* and once more, with all else */
    struct simulation s;
    if (simulation_create(&s, &e, e.seed, &why) < 0 || simulation_run(&s, 60) < 0)
        fail_msg("%s", why.text);
    copy_store(s.store);
    simulation_destroy(&s);
    assert_int_equal(close_loop(S(100), S(2000)), APC_ESTATE);
    assert_non_null(strstr(why.text, "was started anew"));
    if (close_loop(S(1010), S(1050)) < 0 || close_loop(S(100), S(600)) < 0)
        fail_msg("%s", why.text);
    assert_record("before another start");
    later = 400 * APC_NS_PER_S + 70 * APC_NS_PER_MS; /* once more, the clock having been set back */
    if (simulation_create(&s, &e, e.seed, &why) < 0 || simulation_run(&s, 60) < 0)
        fail_msg("%s", why.text);
    copy_store(s.store);
    simulation_destroy(&s);
    assert_int_equal(close_loop(S(100), S(600)), APC_ESTATE);
    assert_non_null(strstr(why.text, "the clock was set"));
}

/* Of straight lines between measurements, about the setpoint that was in force before the part began. */
static void figures_of_a_part_are_those_of_its_rows(void **state)
{
    struct figures f;
    double iae = 0, r = (double)NAN;
    const struct apc_sample *before = NULL;
    (void)state;
    record("first-order", NULL, 0);
    assert_int_equal(close_loop(S(155.05), S(290)), 0);
    for (size_t i = 0; i < closed.all.n; i++) {
        const struct apc_sample *at = &closed.all.at[i];
        if (at->table == APC_SETPOINT && at->time <= closed.since)
            r = at->value;
        assert_true(at->table != APC_SETPOINT || at->time <= closed.since || at->time >= closed.end);
        if (at->table != APC_SENSOR || at->time < closed.since || at->time >= closed.end)
            continue;
        if (before) {
            const double a = before->value - r, b = at->value - r, dt = apc_ns_to_s(at->time - before->time);
            iae += a * b < 0 ? dt * (a * a + b * b) / fabs(a - b) / 2 : dt * fabs(a + b) / 2;
        }
        before = at;
    }
    assert_non_null(before);
    iae += fabs(before->value - r) * apc_ns_to_s(closed.end - before->time);
    assert_int_equal(closed_figures(&f, &closed.all, &closed.was, closed.since, closed.end), 0);
    assert_int_equal(f.n_loops, 1);
    assert_true(iae > 0.1);
    assert_near(f.of[0].figure[METRIC_IAE], iae, 1e-9 * iae);
    figures_free(&f);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test_teardown(under_the_law_that_ran_it_is_the_record, end),
        cmocka_unit_test_teardown(layers_of_controllers_are_closed_at_once, end),
        cmocka_unit_test_teardown(a_schedule_that_ends_is_where_it_was, end),
        cmocka_unit_test_teardown(what_cannot_be_closed_is_refused, end),
        cmocka_unit_test_teardown(figures_of_a_part_are_those_of_its_rows, end),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}

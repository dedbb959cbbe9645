/* SPDX-License-Identifier: BSD-3-Clause */
/* Samples of a run and its course: from a store, into files and out of them, and what is refused there. */
#include "check.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#include "record/record.h"
#include "record/samples_columns.h"
#include "scratch.h"

static struct apc_error why;
static struct samples samples;

static int nothing_yet(void **state)
{
    (void)state;
    samples = (struct samples){0};
    return 0;
}

static int done(void **state)
{
    (void)state;
    samples_free(&samples);
    return 0;
}

/* ---- From a store ------------------------------------------------------------------------- */

#define SECOND(t) ((t)*APC_NS_PER_S)
#define ROW(in, number, count, s, is)                                                                        \
    {                                                                                                        \
        .table = (in), .id = (number), .seq = (count), .time = SECOND(s), .value = (is)                      \
    }

static struct apc_store *filled_store(void)
{
    /* table, id, seq, s, value */
    static const struct apc_sample rows[] = {
        ROW(APC_ACTUATOR, 1, 1, 5, 1),
        ROW(APC_SENSOR, 2, 1, 5, 2),
        ROW(APC_SENSOR, 1, 1, 5, 3),
        ROW(APC_SENSOR, 1, 2, 5, 4),
        ROW(APC_SETPOINT, 1, 1, 5, 5),
        ROW(APC_SENSOR, 1, 3, 4, 6), /* the clock was set back */
        ROW(APC_SENSOR, 1, 4, 9, 7),
        ROW(APC_SENSOR, 3, 1, 5, 8), /* of another experiment's size */
        ROW(APC_ACTUATOR, 2, 1, 5, 8),
        ROW(APC_OPMODE, 1, 1, 1, 1),
        ROW(APC_OPMODE, 1, 2, 2, 2),
        ROW(APC_OPMODE, 1, 3, 5, 3),
        ROW(APC_ACTUAL, 16 + APC_OPMODE, 1, 5, 4),
        ROW(APC_TUNING, 2, 1, 2, 5),
        ROW(APC_TUNING, 3, 1, 2, 6), /* no parameter of this law */
        ROW(APC_MANUAL, 1, 1, 5, 7),
        ROW(APC_MANUAL, 1, 2, 9, 8),
    };
    const struct apc_store_options options = {.size = sizeof options, .name = "test"};
    struct apc_store *store = NULL;
    if (apc_store_open(&store, "mem:samples", &options, &why) < 0)
        fail_msg("%s", why.text);
    assert_int_equal(apc_store_init(store), 0);
    for (size_t i = 0; i < sizeof rows / sizeof *rows; i++)
        assert_int_equal(apc_store_append(store, &rows[i], 1), 1);
    return store;
}

/* Their values tell which they are. */
static void assert_values(const double *values, size_t n)
{
    assert_int_equal(samples.n, n);
    for (size_t i = 0; i < n; i++)
        assert_near(samples.at[i].value, values[i], 0);
}

static void samples_come_by_time_and_in_the_order_of_the_loop(void **state)
{
    static const double loop[] = {6, 5, 3, 4, 2, 1}, operation[] = {2, 5, 3, 4, 7}, early[] = {1, 2, 5};
    static const struct apc_law law = {.name = "ours", .n_tuning = 2};
    const struct experiment e = {
        .dim = {.ny = 2, .nz = 1, .nu = 1, 0},
        .controllers =
            &(struct controller){.law = &law, .dim = {.ny = 2, .nz = 1, .nu = 1}, .first_tuning = 1},
        .n_controllers = 1};
    struct apc_store *store = filled_store();
    const struct apc_range range = {.since = SECOND(3), .until = SECOND(9)};
    (void)state;
    assert_int_equal(samples_collect(&samples, store, &e, &range), 0);
    assert_values(loop, 6);
    samples_free(&samples);
    /* of what was set the newest before it counts as well */
    assert_int_equal(samples_collect_operation(&samples, store, &e, &range), 0);
    assert_values(operation, 5);
    samples_free(&samples);
    const struct apc_range from_the_begin = {.since = 0, .until = SECOND(3)};
    assert_int_equal(samples_collect_operation(&samples, store, &e, &from_the_begin), 0);
    assert_values(early, 3);
    samples_free(&samples);
    const struct apc_range late = {.since = SECOND(10), .until = SECOND(11)};
    assert_int_equal(samples_collect(&samples, store, &e, &late), 0);
    assert_int_equal(samples.n, 0);
    apc_store_close(store);
}

static void a_store_that_is_lost_is_an_error(void **state)
{
    static const struct apc_law law = {.name = "ours", .n_tuning = 2};
    const struct experiment e = {
        .dim = {.ny = 2, .nz = 1, .nu = 1, 0},
        .controllers =
            &(struct controller){.law = &law, .dim = {.ny = 2, .nz = 1, .nu = 1}, .first_tuning = 1},
        .n_controllers = 1};
    const struct apc_store_options options = {.size = sizeof options, .name = "test"};
    const struct apc_range range = {.since = 1};
    struct apc_store *store = NULL;
    (void)state;
    assert_int_equal(apc_store_open(&store, "mem:without-a-schema", &options, &why), 0);
    assert_int_equal(samples_collect(&samples, store, &e, &range), APC_ESCHEMA);
    assert_int_equal(samples_collect_operation(&samples, store, &e, &range), APC_ESCHEMA);
    apc_store_close(store);
}

/* All that the laws of all controllers publish as numbers, and nothing else. */
static void what_laws_publish_is_collected_of_each(void **state)
{
    static const char text[] =
        "name = \"p\"; duration = 10.0; measurements = ( { name = \"y\"; } ); setpoints = ( { name = \"r\"; "
        "} );"
        "outputs = ( { name = \"u\"; } ); plant = { model = \"first-order\"; period = 0.5; }; client = { "
        "period "
        "= 1.0; };"
        "controller = { law = \"mpc\"; period = 2.0; operating_point = { u = [0.0]; };"
        "  settings = { horizon = 4; blocks = [1, 1]; y_scale = [1.0]; u_scale = [1.0]; }; };";
    const struct apc_store_options options = {.size = sizeof options, .name = "test"};
    const struct apc_range range = {.since = SECOND(2)};
    struct apc_store *store = NULL;
    struct experiment e;
    size_t n_tags, published = 0;
    (void)state;
    if (experiment_parse(&e, &(struct experiment_source){.file = "p", .text = text},
                         EXPERIMENT_LAW | EXPERIMENT_MODEL, NULL, &why) < 0 ||
        apc_store_open(&store, "mem:published", &options, &why) < 0)
        fail_msg("%s", why.text);
    assert_int_equal(samples_collect_published(&samples, store, &e, &range), APC_ESCHEMA);
    assert_int_equal(apc_store_init(store), 0);
    struct apc_tag *tag = provision_tags(&e, &n_tags);
    assert_non_null(tag);
    for (size_t i = 0; i < n_tags; i++)
        published += tag[i].table == APC_ESTIMATE;
    assert_true(published > 2);
    for (int t = 1; t <= 3; t++)
        for (int id = (int)published + 1; id > 0; id--) { /* one more than there are */
            const struct apc_sample rows[] = {ROW(APC_ESTIMATE, id, t, t, 100.0 * t + id),
                                              ROW(APC_SENSOR, id, t, t, 1)};
            assert_int_equal(apc_store_append(store, rows, 2), 2);
        }
    assert_int_equal(samples_collect_published(&samples, store, &e, &range), 0);
    assert_int_equal(samples.n, 2 * published);
    for (size_t i = 0; i < samples.n; i++) {
        assert_int_equal(samples.at[i].table, APC_ESTIMATE);
        assert_near(samples.at[i].value, 100.0 * (double)(2 + i / published) + (double)(1 + i % published),
                    0);
    }
    free(tag);
    apc_store_close(store);
    experiment_free(&e);
}

/* ---- Files of samples --------------------------------------------------------------------- */

static void write_all(void)
{
    FILE *out = fopen(scratch_path("samples.csv"), "w");
    assert_non_null(out);
    samples_write(&samples, SECOND(7), out);
    assert_int_equal(fclose(out), 0);
}

static void samples_are_read_as_they_were_written(void **state)
{
    (void)state;
    for (int i = 0; i < 5000; i++) {
        const struct apc_sample sample = {.table = i % 3 ? APC_SENSOR : APC_OPMODE,
                                          .id = i % 3,
                                          .seq = 100 + i,
                                          .time = SECOND(7) + i * INT64_C(1000),
                                          .value = 1.0 / (i + 1),
                                          .status = i % 7 ? APC_GOOD : APC_UNCERTAIN_LAST_USABLE};
        assert_int_equal(samples_add(&samples, &sample), 0);
    }
    write_all();
    const struct samples written = samples;
    if (samples_read(&samples, scratch_folder(), "samples.csv", &why) < 0)
        fail_msg("%s", why.text);
    assert_int_equal(samples.n, written.n);
    for (size_t i = 0; i < samples.n; i++) {
        const struct apc_sample *is = &samples.at[i], *was = &written.at[i];
        assert_int_equal(is->table, was->table);
        assert_int_equal(is->id, was->id);
        assert_int_equal(is->time, was->time - SECOND(7));
        assert_int_equal(is->status, was->status);
        assert_near(is->value, was->value, 0);
        assert_int_equal(is->seq, i / 3 + 1); /* counted for each variable */
    }
    free(written.at);
}

#define HEADER "time,table,id,status,value\n"

static void variables_are_counted_each_for_itself(void **state)
{
    static const int64_t seq[] = {1, 1, 1, 2, 2, 1, 3};
    (void)state;
    scratch_write("samples.csv", "time,table,id,status,value\n0,sensor,1,Good,1\n0,sensor,2,Good,1\n"
                                 "0,actuator,1,Good,1\n1,sensor,1,Good,1\n1,actuator,1,Good,1\n"
                                 "1,opmode,0,Good,1\n2,actuator,1,Good,1\n");
    assert_int_equal(samples_read(&samples, scratch_folder(), "samples.csv", &why), 0);
    for (size_t i = 0; i < 7; i++)
        assert_int_equal(samples.at[i].seq, seq[i]);
    samples_free(&samples);
    /* of any table and id: the largest id of all stands in the first line */
    scratch_write("samples.csv", HEADER "0,sensor,2,Good,1\n0,sensor,0,Good,1\n0,actuator,0,Good,1\n"
                                        "0,setpoint,0,Good,1\n0,opmode,0,Good,1\n0,tuning,0,Good,1\n"
                                        "0,manual,0,Good,1\n");
    assert_int_equal(samples_read(&samples, scratch_folder(), "samples.csv", &why), 0);
    for (size_t i = 0; i < 7; i++)
        assert_int_equal(samples.at[i].seq, 1);
    samples_free(&samples);
    scratch_write("samples.csv", HEADER "0,sensor,0,Good,1\n0,actuator,0,Good,1\n");
    assert_int_equal(samples_read(&samples, scratch_folder(), "samples.csv", &why), 0);
    assert_int_equal(samples.at[1].seq, 1);
}

static void a_line_that_is_no_sample_is_refused_with_its_number(void **state)
{
    static const struct {
        const char *text, *reason;
    } of[] = {
        {"", "x.csv:1: it is empty; expected a row of names"},
        {"time,table\n", "x.csv:1: expected the columns"},
        {HEADER "0,sensor,1,Good,1\n0,sensor,1,Good\n",
         "x.csv:3: 4 fields under 5 names: is the row cut off?"},
        {HEADER "0,sensor,1,Good,1,1\n", "x.csv:2: 6 fields under 5 names"},
        {HEADER "x,sensor,1,Good,1\n", "x.csv:2: column \"time\": \"x\" is no number"},
        {HEADER "1e300,sensor,1,Good,1\n", "x.csv:2: column \"time\": \"1e300\" is no time of a run"},
        {HEADER "0,censor,1,Good,1\n", "x.csv:2: column \"table\": \"censor\" is no table"},
        {HEADER "0,sensor,one,Good,1\n", "x.csv:2: column \"id\": \""},
        {HEADER "0,sensor,-1,Good,1\n", "x.csv:2: column \"id\": \""},
        {HEADER "0,sensor,1.5,Good,1\n", "x.csv:2: column \"id\": \""},
        {HEADER "0,sensor,1000001,Good,1\n", "x.csv:2: column \"id\": \""},
        {HEADER "0,sensor,1,Excellent,1\n", "x.csv:2: column \"status\": \"Excellent\" is no status"},
        {HEADER "0,sensor,1,Good,nan\n", "x.csv:2: column \"value\": \"nan\" is no number"},
        {HEADER "0,sensor,1,Good,\n", "x.csv:2: column \"value\": \"\" is no number"},
        {HEADER "0,sensor,1,Good,1.2", "x.csv:2: ends in the middle of a line"},
    };
    (void)state;
    for (size_t i = 0; i < sizeof of / sizeof *of; i++) {
        scratch_write("x.csv", of[i].text);
        if (samples_read(&samples, scratch_folder(), "x.csv", &why) != APC_EPROTO)
            fail_msg("taken: %s", of[i].text);
        assert_has(why.text, of[i].reason);
        samples_free(&samples);
    }
    scratch_write("x.csv", HEADER
                  "0,sensor,0,Good,1\r\n0,sensor,1000000,Good,1\n\n-1,sensor,1,Good,-1e300\n"); /* edges */
    assert_int_equal(samples_read(&samples, scratch_folder(), "x.csv", &why), 0);
    assert_int_equal(samples.n, 3);
    samples_free(&samples);
    scratch_write("x.csv", HEADER);
    assert_int_equal(samples_read(&samples, scratch_folder(), "x.csv", &why), 0);
    assert_int_equal(samples.n, 0);
    assert_int_equal(samples_read(&samples, scratch_folder(), "none.csv", &why), APC_ENOTFOUND);
    assert_has(why.text, "none.csv: No such file");
    scratch_write("file", "");
    assert_int_equal(samples_read(&samples, scratch_path("file"), "none.csv", &why), APC_ESYS);
    assert_has(why.text, "none.csv: Not a directory");
}

/* ---- The course --------------------------------------------------------------------------- */

static const struct apc_dim dim = {.ny = 2, .nz = 1, .nu = 1};

#define COURSE "time,what,id,value\n"

static void a_line_that_is_of_no_course_is_refused_with_its_number(void **state)
{
    static const struct {
        const char *text, *reason;
    } of[] = {
        {"", "plant.csv:1: it is empty; expected a row of names"},
        {"time,what\n", "plant.csv:1: expected the columns"},
        {COURSE "0,output,1,1\n0,output,3,1\n", "plant.csv:3: this experiment has no output 3"},
        {COURSE "0,output,0,1\n", "plant.csv:2: this experiment has no output 0"},
        {COURSE "0,output,1.5,1\n", "plant.csv:2: this experiment has no output 1.5"},
        {COURSE "0,setpoint,2,1\n", "plant.csv:2: this experiment has no setpoint 2"},
        {COURSE "0,input,2,1\n", "plant.csv:2: this experiment has no input 2"},
        {COURSE "0,without,2,1\n", "plant.csv:2: this experiment has no without 2"},
        {COURSE "0,outlet,1,1\n", "plant.csv:2: this experiment has no outlet 1"},
        {COURSE "x,output,1,1\n", "plant.csv:2: column \"time\": \"x\" is no number"},
        {COURSE "0,output,x,1\n", "plant.csv:2: column \"id\": \"x\" is no number"},
        {COURSE "0,output,1,x\n", "plant.csv:2: column \"value\": \"x\" is no number"},
        {COURSE "0,output,1\n", "plant.csv:2: 3 fields under 4 names"},
        {COURSE "0,output,1,1,1\n", "plant.csv:2: 5 fields under 4 names"},
        {COURSE "1,output,1,1\n0,output,1,1\n", "plant.csv:3: output 1 goes back in time"},
        {COURSE "0,output,1,1\n", "plant.csv: is not whole"},
        {COURSE "-1,end,1,0\n", "plant.csv: is not whole"},
    };
    struct trajectory trajectory;
    (void)state;
    for (size_t i = 0; i < sizeof of / sizeof *of; i++) {
        scratch_write("plant.csv", of[i].text);
        if (trajectory_read(&trajectory, scratch_folder(), &dim, &why) != APC_EPROTO)
            fail_msg("taken: %s", of[i].text);
        assert_has(why.text, of[i].reason);
        trajectory_free(&trajectory);
    }
    scratch_write("plant.csv", COURSE "0,output,2,1\r\n0,output,2,2\n0,output,1,3\n0,without,1,1\n0,end,1,0");
    assert_int_equal(trajectory_read(&trajectory, scratch_folder(), &dim, &why), 0);
    assert_int_equal(trajectory.output[1].n, 2);
    assert_int_equal(trajectory.output[0].n, 1);
    assert_near(trajectory.output[1].at[1].value, 2, 0);
    assert_near(trajectory.end, 0, 0);
    assert_false(trajectory.diverged);
    trajectory_free(&trajectory);
    scratch_write("file", "");
    assert_int_equal(trajectory_read(&trajectory, scratch_path("file"), &dim, &why), APC_ESYS);
    trajectory_free(&trajectory);
}

static void a_course_of_any_length_is_written_line_by_line(void **state)
{
    char line[100];
    struct trajectory trajectory;
    (void)state;
    assert_int_equal(trajectory_create(&trajectory, &dim), 0);
    assert_true(isinf(trajectory.gap));
    for (int i = 0; i < 1000; i++) {
        trajectory_add(&trajectory, &trajectory.output[1], i, 2);
        trajectory_change(&trajectory, &trajectory.input[0], i, i / 500);
    }
    trajectory_change(&trajectory, &trajectory.setpoint[0], 0, 0);
    trajectory.end = 1000;
    assert_int_equal(trajectory.output[1].n, 1000);
    assert_int_equal(trajectory.input[0].n, 2);
    assert_near(trajectory.input[0].at[1].t, 500, 0);
    assert_int_equal(trajectory_write(&trajectory, scratch_folder(), &why), 0);
    trajectory_free(&trajectory);
    assert_null(trajectory.output);
    FILE *in = fopen(scratch_path("plant.csv"), "r");
    assert_non_null(in);
    assert_string_equal(fgets(line, sizeof line, in), COURSE);
    assert_string_equal(fgets(line, sizeof line, in), "0.000000000,output,2,2\n");
    int lines = 2;
    while (fgets(line, sizeof line, in))
        lines++;
    fclose(in);
    assert_int_equal(lines, 1 + 1000 + 2 + 1 + 1);
    assert_string_equal(line, "1000.000000000,end,1,0\n");
    assert_int_equal(trajectory_create(&trajectory, &dim), 0);
    assert_int_equal(trajectory_write(&trajectory, "/nowhere", &why), APC_ESYS);
    assert_has(why.text, "/nowhere/plant.csv: cannot be written: No such file");
    trajectory_free(&trajectory);
}

static void a_folder_without_a_course_has_that_of_its_samples(void **state)
{
    struct wire u[] = {{APC_ACTUATOR, 0}, {APC_ACTUATOR, 1}, {APC_ACTUATOR, 2}};
    struct controller controller = {.rhythm.period = APC_NS_PER_S, .dim.nu = dim.nu, .u = u};
    struct experiment e = {.dim = dim, .controllers = &controller, .n_controllers = 1};
    struct trajectory trajectory;
    (void)state;
    e.plant.rhythm.period = APC_NS_PER_S;
    e.client.rhythm.period = SECOND(2);
    remove(scratch_path("plant.csv"));
    /* ids beyond the experiment's, and setpoints and sensors that are not Good */
    scratch_write("samples.csv",
                  HEADER "0,setpoint,1,Good,5\n0,sensor,2,Good,1\n0,sensor,3,Good,9\n0,setpoint,2,Good,9\n"
                         "0,actuator,2,Good,9\n0,sensor,0,Good,9\n1,actuator,1,Good,3\n"
                         "2,sensor,2,UncertainLastUsableValue,2\n2,setpoint,1,Good,5\n3,sensor,2,Bad,4\n"
                         "2.5,actuator,1,Bad,4\n");
    if (trajectory_load(&trajectory, scratch_folder(), &e, &why) < 0)
        fail_msg("%s", why.text);
    assert_true(trajectory.measured);
    assert_near(trajectory.gap, 6.1, 1e-12); /* of the slower one */
    assert_near(trajectory.end, 3, 0);       /* a clock that was set back takes nothing away */
    assert_int_equal(trajectory.output[0].n, 0);
    assert_int_equal(trajectory.output[1].n, 2);
    assert_near(trajectory.output[1].at[1].value, 2, 0);
    assert_int_equal(trajectory.setpoint[0].n, 1);
    assert_int_equal(trajectory.input[0].n, 2);
    assert_near(trajectory.input[0].at[1].t, 3, 0);
    assert_int_equal(trajectory.without.n, 3);
    assert_near(trajectory.without.at[1].t, 1, 0);
    assert_near(trajectory.without.at[2].t, 3, 0);
    assert_near(trajectory.without.at[2].value, 1, 0);
    trajectory_free(&trajectory);
    scratch_write("plant.csv", COURSE "4,end,1,1\n"); /* what the plant itself says goes before */
    assert_int_equal(trajectory_load(&trajectory, scratch_folder(), &e, &why), 0);
    assert_false(trajectory.measured);
    assert_true(trajectory.diverged);
    assert_near(trajectory.end, 4, 0);
    trajectory_free(&trajectory);
    scratch_write("plant.csv", "");
    assert_int_equal(trajectory_load(&trajectory, scratch_folder(), &e, &why), APC_EPROTO);
    trajectory_free(&trajectory);
    remove(scratch_path("plant.csv"));
    remove(scratch_path("samples.csv"));
    assert_int_equal(trajectory_load(&trajectory, scratch_folder(), &e, &why), APC_ENOTFOUND);
    assert_has(why.text,
               "samples.csv: No such file; of a run that goes on, or was killed, first: apc report ");
    assert_has(why.text, scratch_folder());
    trajectory_free(&trajectory);
}

/* As of a run that ended before its plant had answered. */
static void a_record_without_rows_is_kept_and_read(void **state)
{
    struct apc_samples *const rows = calloc(1, sizeof *rows);
    (void)state;

    assert_non_null(rows);
    scratch_write("samples.csv", HEADER);
    char *const csv = strdup(scratch_path("samples.csv")), *const columns =
                                                               strdup(scratch_path("samples.columns"));
    assert_true(csv && columns);
    apc_samples_keep(csv, columns);
    assert_int_equal(access(columns, R_OK), 0);
    assert_int_equal(apc_samples_read(rows, csv, columns, &why), 0);
    assert_int_equal(rows->n, 0);
    assert_int_equal(rows->n_variables, 0);
    apc_samples_free(rows);
    remove(columns);
    remove(csv);
    free(columns);
    free(csv);
}

static void flip_byte(const char *file, long at, int mask)
{
    FILE *const f = fopen(file, "r+");
    int byte = EOF;

    assert_non_null(f);
    assert_int_equal(fseek(f, at, SEEK_SET), 0);
    byte = getc(f);
    assert_int_equal(fseek(f, at, SEEK_SET), 0);
    assert_int_equal(putc(byte ^ mask, f), (byte ^ mask) & 0xff);
    assert_int_equal(fclose(f), 0);
}

static void assert_samples_of(const char *csv, const char *columns, const struct apc_samples *want)
{
    struct apc_samples *const rows = calloc(1, sizeof *rows);

    assert_non_null(rows);
    assert_int_equal(apc_samples_read(rows, csv, columns, &why), 0);
    assert_int_equal(rows->n, want->n);
    assert_int_equal(rows->n_variables, want->n_variables);
    assert_memory_equal(rows->time, want->time, want->n * sizeof *want->time);
    assert_memory_equal(rows->value, want->value, want->n * sizeof *want->value);
    assert_memory_equal(rows->variable, want->variable, want->n * sizeof *want->variable);
    for (size_t i = 0; i < want->n; i++)
        assert_int_equal(rows->code[rows->status[i]], want->code[want->status[i]]);
    assert_memory_equal(rows->table, want->table, want->n_variables * sizeof *want->table);
    assert_memory_equal(rows->id, want->id, want->n_variables * sizeof *want->id);
    apc_samples_free(rows);
}

/*
 * Promise(python): Whatever byte of `samples.columns` is damaged, and wherever it ends: the rows are those of
 *   `samples.csv`.
 */
static void no_damage_of_the_columns_changes_a_row(void **state)
{
    struct apc_samples want = {0};
    struct stat of;
    (void)state;

    scratch_write("samples.csv",
                  HEADER "-0.5,sensor,1,Good,1.25\n0,actuator,2,Bad,-1e300\n1e9,sensor,1,Uncertain,3\n");
    char *const csv = strdup(scratch_path("samples.csv")), *const columns =
                                                               strdup(scratch_path("samples.columns"));
    assert_true(csv && columns);
    apc_samples_keep(csv, columns);
    assert_int_equal(samples_csv_read(&want, csv, &why), 0);
    assert_samples_of(csv, columns, &want);
    assert_int_equal(stat(columns, &of), 0);
    for (long at = 0; at < of.st_size; at++)
        for (int mask = 1; mask < 256; mask = mask < 128 ? 2 * mask : mask + 127) {
            flip_byte(columns, at, mask); /* each bit, and all of them */
            assert_samples_of(csv, columns, &want);
            flip_byte(columns, at, mask);
        }
    while (of.st_size > 0) {
        assert_int_equal(truncate(columns, --of.st_size), 0);
        assert_samples_of(csv, columns, &want);
    }
    samples_forget(&want);
    remove(columns);
    remove(csv);
    free(columns);
    free(csv);
}

/* A spreadsheet quotes fields and ends lines by \r\n; the columns in Python are the same. */
static void a_file_from_a_spreadsheet_has_the_same_columns(void **state)
{
    static const char *const texts[] = {
        HEADER "-0.5,sensor,1,Good,1.25\n0,actuator,2,Bad,-1e300\n1e9,sensor,1,Uncertain,3\n", HEADER
        "\"-0.5\",sensor,\"1\",Good,1.25\r\n0,\"actuator\",2,Bad,-1e300\r\n1e9,sensor,1,Uncertain,\"3\"\r\n"};
    static const double time[] = {-0.5, 0, 1e9}, value[] = {1.25, -1e300, 3};
    static const int32_t of_variable[] = {7, 8};
    static const int8_t of_small[] = {1, 2};
    (void)state;
    for (size_t i = 0; i < 2; i++) {
        struct apc_samples rows = {0};
        int32_t variable[2];
        int8_t small[3];
        int64_t ns[3];
        scratch_write("x.csv", texts[i]);
        if (samples_csv_read(&rows, scratch_path("x.csv"), &why) < 0)
            fail_msg("%s", why.text);
        assert_int_equal(rows.n, 3);
        assert_memory_equal(rows.time, time, sizeof time);
        assert_memory_equal(rows.value, value, sizeof value);
        assert_int_equal(rows.n_variables, 2);
        assert_true(rows.table[0] == APC_SENSOR && rows.id[0] == 1 && rows.table[1] == APC_ACTUATOR &&
                    rows.id[1] == 2);
        apc_samples_spread(&rows, 1, 2, of_variable, sizeof *of_variable, variable);
        assert_true(variable[0] == 8 && variable[1] == 7);
        apc_samples_spread(&rows, 0, 3, of_small, sizeof *of_small, small);
        assert_true(small[0] == 1 && small[1] == 2 && small[2] == 1);
        apc_samples_times(&rows, 1000, ns);
        assert_true(ns[0] == 1000 - 500000000 && ns[1] == 1000 &&
                    ns[2] == 1000 + INT64_C(1000000000000000000));
        samples_forget(&rows);
    }
}

#define T(name) cmocka_unit_test_setup_teardown(name, nothing_yet, done)

int main(void)
{
    const struct CMUnitTest tests[] = {
        T(samples_come_by_time_and_in_the_order_of_the_loop),
        T(a_store_that_is_lost_is_an_error),
        T(what_laws_publish_is_collected_of_each),
        T(samples_are_read_as_they_were_written),
        T(variables_are_counted_each_for_itself),
        T(a_line_that_is_no_sample_is_refused_with_its_number),
        T(a_line_that_is_of_no_course_is_refused_with_its_number),
        T(a_course_of_any_length_is_written_line_by_line),
        T(a_folder_without_a_course_has_that_of_its_samples),
        T(a_record_without_rows_is_kept_and_read),
        T(no_damage_of_the_columns_changes_a_row),
        T(a_file_from_a_spreadsheet_has_the_same_columns),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}

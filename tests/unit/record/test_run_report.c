/* SPDX-License-Identifier: BSD-3-Clause */
/* What a report is drawn from: the files of a run folder, read and refused. */
#include <stdio.h>
#include <string.h>
#include <unistd.h>

#include "check.h"
#include "scratch.h"

#include "record/record.h"

#define SAMPLES   "time,table,id,status,value\n"
#define OPERATION SAMPLES
#define TIMING    "task,quantity,period_ns,low_ns,high_ns,count\n"
#define SUMMARY   "task,quantity,period_ns,count,missed,mean_ns,sd_ns,min_ns,p50_ns,p99_ns,p999_ns,max_ns\n"
#define EVENTS    "time,severity,source,kind,text\n"

static struct report_data data;
static struct apc_error why;

static void write_all(void)
{
    scratch_write("samples.csv", SAMPLES "0.5,sensor,1,Good,2\n"
                                         "1,actuator,1,UncertainLastUsableValue,3\n"
                                         "0.25,sensor,2,Bad,-1e3\n"
                                         "0.25,sensor,1,Good,1\n"
                                         "0.25,sensor,1,Good,7\n"
                                         "-1,setpoint,1,Good,4\n");
    scratch_write("operation.csv", OPERATION "0.125,actual,21,Good,1\n"
                                             "9,opmode,1,Good,1\n"
                                             "0.5,actual,37,Uncertain,0\n"
                                             "0.5,actual,22,Good,5\n"
                                             "0.5,actual,5,Good,6\n");
    scratch_write("published.csv", OPERATION "0.5,estimate,2,Good,8\n"
                                             "0.25,estimate,2,Good,9\n");
    scratch_write("timing.csv", TIMING "client,lateness,500,0,10,4\n"
                                       "client,jitter,500,-20,-10,3\n"
                                       "plant,jitter,200,5,5,1\n"
                                       "client,jitter,500,-10,0,0\n"
                                       "client,jitter,500,0,30,5\n");
    scratch_write("timing-summary.csv", SUMMARY "client,lateness,500,1,2,3,4,5,6,7,8,9\n"
                                                "client,jitter,500,8,2,-0.5,12.5,-20,1,2,3,30\n");
    scratch_write("events.csv", EVENTS "0.1,info,a,start,\"x\"\n"
                                       "0.2,warning,a,fault,\"x, y\"\n"
                                       "-0.2,alarm,a,early,\"x\"\n"
                                       "0.3,alarm,a,watchdog,\"x\"\n");
}

/* Promise(modes/record-figure-run) */
static void a_folder_is_read_by_time(void **state)
{
    (void)state;
    write_all();
    if (report_read(&data, scratch_folder(), &why) < 0)
        fail_msg("%s", why.text);
    assert_int_equal(data.y.n, 2);
    assert_int_equal(data.published.n, 2);
    assert_int_equal(data.published.series[1].n, 2);
    assert_near(data.published.series[1].points[0].value, 9, 0);
    assert_int_equal(data.y.series[0].n, 3);
    static const double t[] = {0.25, 0.25, 0.5},
                        value[] = {1, 7, 2}; /* those of a time as they stand there */
    for (size_t i = 0; i < 3; i++) {
        assert_near(data.y.series[0].points[i].t, t[i], 0);
        assert_near(data.y.series[0].points[i].value, value[i], 0);
    }
    assert_int_equal(data.y.series[1].points[0].severity, APC_SEVERITY_BAD);
    assert_int_equal(data.u.series[0].points[0].severity, APC_SEVERITY_UNCERTAIN);
    assert_int_equal(data.z.series[0].n, 1);
    assert_near(data.end, 1.0, 0);
    assert_int_equal(data.mode.n, 2); /* of the loops, whatever else is confirmed */
    assert_int_equal(data.mode.series[0].n, 1);
    assert_near(data.mode.series[0].points[0].value, 1, 0);
    assert_int_equal(data.mode.series[1].points[0].severity, APC_SEVERITY_UNCERTAIN);

    const struct report_jitter *client = report_jitter_of(&data, "client");
    assert_int_equal(data.n_jitter, 2);
    assert_int_equal(client->n_bins, 2);
    assert_int_equal(client->bins[0].low, -20);
    assert_int_equal(client->bins[0].high, -10);
    assert_int_equal(client->bins[1].count, 5);
    assert_int_equal(client->count, 8);
    assert_int_equal(client->missed, 2);
    assert_near(client->period, 500, 0);
    assert_near(client->mean, -0.5, 0);
    assert_near(client->sd, 12.5, 0);
    assert_int_equal(report_jitter_of(&data, "plant")->n_bins, 1);
    assert_null(report_jitter_of(&data, "plan"));

    assert_int_equal(data.n_events, 2);
    assert_near(data.event[0].t, 0.2, 0);
    assert_false(data.event[0].alarm);
    assert_string_equal(data.event[0].kind, "fault");
    assert_true(data.event[1].alarm);
    report_free(&data);
}

static void more_points_than_there_was_room_for_are_kept(void **state)
{
    enum { N = 1000 };
    static char text[40 * N];
    size_t length = (size_t)snprintf(text, sizeof text, SAMPLES);
    (void)state;
    write_all();
    for (int i = 0; i < N; i++)
        length += (size_t)snprintf(text + length, sizeof text - length, "%d,sensor,1,Good,%d\n", N - i, i);
    scratch_write("samples.csv", text);
    assert_int_equal(report_read(&data, scratch_folder(), &why), 0);
    assert_int_equal(data.y.series[0].n, N);
    for (int i = 0; i < N; i++)
        assert_near(data.y.series[0].points[i].value, N - 1 - i, 0);
    report_free(&data);
}

static void what_is_not_understood_is_refused_with_its_line(void **state)
{
    static const struct {
        const char *file, *text, *says;
    } bad[] = {
        {"samples.csv", "", "samples.csv:1: it is empty; expected a row of names"},
        {"samples.csv", "time,table,id,status,values\n",
         "samples.csv:1: expected the columns time,table,id,status,value"},
        {"samples.csv", SAMPLES "1,sensor,1,Good\n",
         "samples.csv:2: 4 fields under 5 names: is the row cut off?"},
        {"samples.csv", SAMPLES "1,sensor,1,Good,1,1\n", "samples.csv:2: 6 fields under 5 names"},
        {"samples.csv", SAMPLES "x,sensor,1,Good,1\n", "samples.csv:2: column \"time\": cannot be \"x\""},
        {"samples.csv", SAMPLES "1,sensors,1,Good,1\n", "column \"table\": cannot be \"sensors\""},
        {"samples.csv", SAMPLES "1,tuning,1,Good,1\n", "column \"table\": cannot be \"tuning\""},
        {"samples.csv", SAMPLES "1,sensor,0,Good,1\n", "column \"id\": cannot be \"0\""},
        {"samples.csv", SAMPLES "1,sensor,8193,Good,1\n", "column \"id\": cannot be \"8193\""},
        {"samples.csv", SAMPLES "1,sensor,1.5,Good,1\n", "column \"id\": cannot be \"1.5\""},
        {"samples.csv", SAMPLES "1,sensor,1,Fine,1\n", "column \"status\": cannot be \"Fine\""},
        {"samples.csv", SAMPLES "1,sensor,1,Good,1e301\n", "column \"value\": cannot be \"1e301\""},
        {"operation.csv", OPERATION "1,actual,21,Good,x\n", "operation.csv:2: column \"value\""},
        {"published.csv", OPERATION "1,sensor,1,Good,1\n",
         "published.csv:2: column \"table\": cannot be \"sensor\""},
        {"published.csv", OPERATION "1,estimate,0,Good,1\n", "column \"id\": cannot be \"0\""},
        {"timing.csv", TIMING "a,jitter,1,0.5,2,1\n", "column \"low_ns\": cannot be \"0.5\""},
        {"timing.csv", TIMING "a,jitter,1,2,1,1\n", "column \"high_ns\": cannot be \"1\""},
        {"timing.csv", TIMING "a,jitter,1,1,2,-1\n", "column \"count\": cannot be \"-1\""},
        {"timing-summary.csv", SUMMARY "a,jitter,0,1,1,1,1,1,1,1,1,1\n",
         "column \"period_ns\": cannot be \"0\""},
        {"timing-summary.csv", SUMMARY "a,jitter,1,x,1,1,1,1,1,1,1,1\n", "column \"count\""},
        {"timing-summary.csv", SUMMARY "a,jitter,1,1,x,1,1,1,1,1,1,1\n", "column \"missed\""},
        {"timing-summary.csv", SUMMARY "a,jitter,1,1,1,x,1,1,1,1,1,1\n", "column \"mean_ns\""},
        {"timing-summary.csv", SUMMARY "a,jitter,1,1,1,1,x,1,1,1,1,1\n", "column \"sd_ns\""},
        {"events.csv", EVENTS "x,alarm,a,b,\"\"\n", "events.csv:2: column \"time\": cannot be \"x\""},
        {"events.csv", EVENTS "1,alarm\n", "events.csv:2: 2 fields under 5 names"},
    };
    (void)state;
    for (size_t i = 0; i < sizeof bad / sizeof *bad; i++) {
        write_all();
        scratch_write(bad[i].file, bad[i].text);
        assert_int_equal(report_read(&data, scratch_folder(), &why), APC_EPROTO);
        if (!strstr(why.text, bad[i].says))
            fail_msg("%zu: \"%s\" does not say \"%s\"", i, why.text, bad[i].says);
        report_free(&data);
    }
}

/* The largest and the least that may be, beside what is refused above. */
static void what_is_just_within_its_bounds_is_taken(void **state)
{
    (void)state;
    write_all();
    scratch_write("samples.csv", SAMPLES "0,sensor,8192,Good,1e300\n"
                                         "2,sensor,1,GoodLimitedLow,-1e300\n");
    scratch_write("operation.csv", OPERATION "1,actual,131072,Good,1\n"
                                             "1,setpoint,532480,Good,1\n");
    scratch_write("published.csv", OPERATION "1,estimate,1048576,Good,1\n");
    scratch_write("timing.csv", TIMING "a,jitter,1,-9000000000000000,-9000000000000000,9000000000000000\n");
    scratch_write("timing-summary.csv", SUMMARY "a,jitter,31622400000000000,9e15,9e15,1e300,0,1,1,1,1,1\n"
                                                "b,jitter,1,0,0,0,0,0,0,0,0,0\n");
    scratch_write("events.csv", EVENTS "0,alarm,a,at once,\"x\"\n"
                                       "1,info,a,no,\"x\"\n"
                                       "2,warning,a,later,\"of\r\ntwo lines, \"\"quoted\"\"\"\n");
    if (report_read(&data, scratch_folder(), &why) < 0)
        fail_msg("%s", why.text);
    assert_int_equal(data.y.n, 8192);
    assert_near(data.y.series[8191].points[0].value, 1e300, 0);
    assert_int_equal(data.y.series[1].n, 0);
    assert_false(data.y.series[8191].points[0].limited);
    assert_true(data.y.series[0].points[0].limited);
    assert_int_equal(data.y.series[0].points[0].line, 3);
    assert_int_equal(data.published.n, 1048576);
    assert_int_equal(data.n_jitter, 2);
    assert_int_equal(data.jitter[0].bins[0].low, -9000000000000000);
    assert_int_equal(data.jitter[0].bins[0].count, 9000000000000000);
    assert_near(data.jitter[0].period, 366 * 86400e9, 0);
    assert_int_equal(data.jitter[0].missed, 9000000000000000);
    assert_near(data.jitter[1].period, 1, 0);
    assert_int_equal(data.n_events, 2);
    assert_near(data.event[0].t, 0, 0);
    assert_string_equal(data.event[1].kind, "later");
    report_free(&data);
    static const struct {
        const char *file, *text, *says;
    } beyond[] = {
        {"published.csv", OPERATION "1,estimate,1048577,Good,1\n", "column \"id\": cannot be \"1048577\""},
        {"operation.csv", OPERATION "1,actual,131073,Good,1\n", "column \"id\": cannot be \"131073\""},
        {"timing.csv", TIMING "a,jitter,1,-9000000000000001,2,1\n", "column \"low_ns\""},
        {"timing.csv", TIMING "a,jitter,1,1,9000000000000001,1\n", "column \"high_ns\""},
        {"timing.csv", TIMING "a,jitter,1,1,1,9000000000000001\n", "column \"count\""},
        {"timing-summary.csv", SUMMARY "a,jitter,31622400000000004,1,1,1,1,1,1,1,1,1\n",
         "column \"period_ns\""},
    };
    for (size_t i = 0; i < sizeof beyond / sizeof *beyond; i++) {
        write_all();
        scratch_write(beyond[i].file, beyond[i].text);
        assert_int_equal(report_read(&data, scratch_folder(), &why), APC_EPROTO);
        if (!strstr(why.text, beyond[i].says))
            fail_msg("%zu: \"%s\" does not say \"%s\"", i, why.text, beyond[i].says);
        report_free(&data);
    }
}

/* Of each series what lies in the window, and the one before it, which is in force when it begins. */
static void a_window_has_what_was_in_force_when_it_began(void **state)
{
    static const struct {
        double begin, end;
        double first, last; /* of measurement 1, by time */
        size_t n, n_z, n_published, n_mode, n_events;
    } of[] = {{0.0, 10.0, 0.25, 0.5, 3, 1, 2, 1, 2},  {0.3, 10.0, 0.25, 0.5, 2, 1, 2, 1, 1},
              {0.25, 10.0, 0.25, 0.5, 2, 1, 2, 1, 1}, {0.5, 0.75, 0.5, 0.5, 1, 1, 1, 1, 0},
              {0.2, 0.3, 0.25, 0.25, 2, 1, 1, 1, 2},  {0.31, 0.49, 0.25, 0.25, 1, 1, 1, 1, 0},
              {0.125, 0.125, 0.0, 0.0, 0, 1, 0, 1, 0}};
    (void)state;
    for (size_t i = 0; i < sizeof of / sizeof *of; i++) {
        write_all();
        assert_int_equal(report_read(&data, scratch_folder(), &why), 0);
        report_clip(&data, of[i].begin, of[i].end);
        const struct report_series *y = &data.y.series[0];
        assert_int_equal(y->n, of[i].n);
        if (y->n > 0) {
            assert_near(y->points[0].t, of[i].first, 0);
            assert_near(y->points[y->n - 1].t, of[i].last, 0);
        }
        assert_int_equal(data.z.series[0].n, of[i].n_z);
        assert_int_equal(data.published.series[1].n, of[i].n_published);
        assert_int_equal(data.mode.series[0].n, of[i].n_mode);
        assert_int_equal(data.u.series[0].n, of[i].end >= 1.0);
        assert_int_equal(data.n_events, of[i].n_events);
        assert_near(data.begin, of[i].begin, 0);
        assert_near(data.end, fmin(of[i].end, 1.0), 0);
        report_free(&data);
    }
}

static void a_folder_may_have_no_operation_and_no_events_but_has_the_rest(void **state)
{
    static const char *const file[] = {"operation.csv", "events.csv", "samples.csv", "timing.csv",
                                       "timing-summary.csv"};
    (void)state;
    for (size_t i = 0; i < sizeof file / sizeof *file; i++) {
        write_all();
        unlink(scratch_path(file[i]));
        assert_int_equal(report_read(&data, scratch_folder(), &why), i < 2 ? 0 : APC_ENOTFOUND);
        if (i >= 2)
            assert_non_null(strstr(why.text, file[i]));
        report_free(&data);
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(a_folder_is_read_by_time),
        cmocka_unit_test(more_points_than_there_was_room_for_are_kept),
        cmocka_unit_test(what_is_not_understood_is_refused_with_its_line),
        cmocka_unit_test(what_is_just_within_its_bounds_is_taken),
        cmocka_unit_test(a_window_has_what_was_in_force_when_it_began),
        cmocka_unit_test(a_folder_may_have_no_operation_and_no_events_but_has_the_rest),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}

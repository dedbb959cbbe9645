/* SPDX-License-Identifier: BSD-3-Clause */
/* The world around the modules, as a file and the command line describe it. */
#include "check.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#include "experiment/experiment_parts.h"
#include "scratch.h"

static struct apc_error why;

/* The file's models, and those of a task "client". Returns 0 or the failure. */
static int take(const char *text, struct models *m, struct task_model *client)
{
    config_t config;
    struct settings s = {.file = scratch_path("world.conf"), .why = &why};
    *m = (struct models){0};
    *client = (struct task_model){0};
    scratch_write("world.conf", text);
    assert_int_equal(settings_load(&config, s.file, &why), 0);
    const config_setting_t *root = config_root_setting(&config);
    models_read(&s, root, m);
    if (!s.failed && config_setting_get_member(root, "client"))
        models_read_task(&s, config_setting_get_member(root, "client"), "client", client, &m->recordings);
    config_destroy(&config);
    return s.failed;
}

static void everything_in_the_file_is_taken(void **state)
{
    struct models m;
    struct task_model client;
    (void)state;
    if (take("network = { delay = \"normal(0.004, 0.001)\"; jitter = \"uniform(-0.5, 0.5)\"; loss = 0.25;\n"
             "duplication = 0.5; reordering = 0.125; bandwidth = 1000000000000L;\n"
             "outages = ( [1.5, 2.0], [7, 7] ); };\n"
             "clock = ( { at = 100.0; step = -3600.0; drift = 0.5; }, { at = 31622400.0; } );\n"
             "client = { execution = 3; jitter = 0.25; };",
             &m, &client) < 0)
        fail_msg("%s", why.text);
    const struct apc_network_options *o = &m.network.options;
    assert_int_equal(o->delay.kind, APC_NORMAL);
    assert_near(o->delay.a, 0.004, 0);
    assert_near(o->delay.b, 0.001, 0);
    assert_int_equal(o->jitter.kind, APC_UNIFORM);
    assert_near(o->loss, 0.25, 0);
    assert_near(o->duplication, 0.5, 0);
    assert_near(o->reordering, 0.125, 0);
    assert_near(o->bandwidth, 1e12, 0);
    assert_int_equal(o->n_outages, 2);
    assert_ptr_equal(o->outages, m.network.outages);
    assert_int_equal(o->outages[0].from, 3 * APC_NS_PER_S / 2);
    assert_int_equal(o->outages[0].until, 2 * APC_NS_PER_S);
    assert_int_equal(o->outages[1].from, 7 * APC_NS_PER_S);
    assert_int_equal(m.n_clock, 2);
    assert_int_equal(m.clock[0].at, 100 * APC_NS_PER_S);
    assert_int_equal(m.clock[0].step, -3600 * APC_NS_PER_S);
    assert_near(m.clock[0].drift, 0.5, 0);
    assert_int_equal(m.clock[1].at, 366 * 86400 * APC_NS_PER_S);
    assert_int_equal(m.clock[1].step, 0);
    assert_near(m.clock[1].drift, 0, 0);
    assert_int_equal(client.execution.kind, APC_CONSTANT);
    assert_near(client.execution.a, 3, 0);
    assert_near(client.jitter.a, 0.25, 0);
    models_free(&m);
    assert_int_equal(take("client = { }; clock = ();", &m, &client), 0);
    assert_int_equal(client.execution.kind, 0);
    assert_int_equal(m.n_clock, 0);
    models_free(&m);
    assert_int_equal(take("client = { execution = 0.0; jitter = \"0\"; };", &m, &client), 0); /* an edge */
    assert_int_equal(client.jitter.kind, APC_CONSTANT);
    models_free(&m);
}

static void what_the_file_must_not_say_is_refused(void **state)
{
    static const struct {
        const char *text, *reason;
    } of[] = {
        {"network = { speed = 1.0; };", "world.conf:1: unknown setting \"speed\""},
        {"network = 3;", "\"network\" must be a group"},
        {"network = { delay = true; };",
         "1: expected a number or a distribution such as \"normal(0.004, 0.001)\""},
        {"network = { delay = [1.0]; };", "expected a number or a distribution"},
        {"network = { delay = \"cauchy(1)\"; };", "1: \"delay\": "},
        {"network = { jitter = \"normal(1)\"; };", "1: \"jitter\": "},
        {"network = { delay = -1.0; };", "delay must not be negative"},
        {"network = { loss = 1.5; };", "\"loss\" is 1.5: must be from 0 to 1"},
        {"network = { loss = -0.5; };", "\"loss\" is -0.5"},
        {"network = { duplication = 1.5; };", "\"duplication\" is 1.5"},
        {"network = { reordering = 1.5; };", "\"reordering\" is 1.5"},
        {"network = { reordering = -1.5; };", "\"reordering\" is -1.5"},
        {"network = { bandwidth = -1.0; };", "\"bandwidth\" is -1"},
        {"network = { bandwidth = 2e15; };", "\"bandwidth\" is 2"},
        {"network = {\noutages = ( [1.0] ); };", "world.conf:2: expected 2 numbers in brackets"},
        {"network = { outages = ( [1.0, 1e300] ); };", "\"outage\" must hold [from, until] in seconds"},
        {"network = { outages = ( [1e300, 2.0] ); };", "\"outage\" must hold [from, until] in seconds"},
        {"network = { outages = ( [2.0, 1.0] ); };", "outage 1 ends before it begins"},
        {"network = { outages = 3; };", "\"outages\" must be a list"},
        {"clock = 3;", "\"clock\" must be a list"},
        {"clock = ( 3 );", "expected a group: { at = 100.0; step = -3600.0; }"},
        {"clock = ( { step = 1.0; } );", "\"at\" is missing"},
        {"clock = ( { at = -1.0; } );", "\"at\" is -1: must be from 0 to 31622400"},
        {"clock = ( { at = 31622401.0; } );", "\"at\" is 31622401"},
        {"clock = ( { at = 0.0; step = 31622401.0; } );", "\"step\" is 31622401"},
        {"clock = ( { at = 0.0; step = -31622401.0; } );", "\"step\" is -31622401: must be from -31622400"},
        {"clock = ( { at = 0.0; drift = 0.51; } );", "\"drift\" is 0.51: must be from -0.5 to 0.5"},
        {"clock = ( { at = 0.0; drift = -0.51; } );", "\"drift\" is -0.51"},
        {"clock = ( { at = 0.0; leap = 1.0; } );", "unknown setting \"leap\""},
        {"clock = ( { at = 0.0; },\n{ at = -1.0; },\n{ at = -2.0; } );", "world.conf:2: \"at\" is -1"},
        {"client = {\nexecution = -0.5; };", "world.conf:2: \"execution\" must not be negative"},
        {"client = { jitter = \"-0.5\"; };", "\"jitter\" must not be negative"},
        {"client = { jitter = \"triangle(1)\"; };", "1: \"jitter\": no distribution"},
    };
    (void)state;
    for (size_t i = 0; i < sizeof of / sizeof *of; i++) {
        struct models m;
        struct task_model client;
        if (take(of[i].text, &m, &client) >= 0)
            fail_msg("taken: %s", of[i].text);
        assert_has(why.text, of[i].reason);
        models_free(&m);
    }
}

/* ---- Histograms --------------------------------------------------------------------------- */

static void a_histogram_is_taken_as_shares_of_all(void **state)
{
    struct models m;
    struct task_model client;
    char text[6000] = "low,high,count\n";
    (void)state;
    scratch_write("delays.csv", "low,high,count\r\n0.5,1,1\r\n2,2,3\r\n");
    /* a path counts from where the file lies */
    assert_int_equal(take("network = { delay = \"recorded(delays.csv)\"; };", &m, &client), 0);
    const struct apc_distribution *d = &m.network.options.delay;
    assert_int_equal(d->kind, APC_RECORDED);
    assert_int_equal(d->n_shares, 2);
    assert_near(d->shares[0].low, 0.5, 0);
    assert_near(d->shares[0].high, 1, 0);
    assert_near(d->shares[0].share, 0.25, 0);
    assert_near(d->shares[1].low, 2, 0);
    assert_near(d->shares[1].share, 1, 0);
    models_free(&m);
    /* of any length; on a command line a path is one, absolute or not */
    for (int i = 0; i < 150; i++)
        snprintf(text + strlen(text), sizeof text - strlen(text), "%d,%d,2\n", i, i + 1);
    scratch_write("long.csv", text);
    char spec[400];
    snprintf(spec, sizeof spec, "jitter=recorded(%s),loss=0.5", scratch_path("long.csv"));
    m = (struct models){0};
    assert_int_equal(models_network(&m, spec, &why), 0);
    d = &m.network.options.jitter;
    assert_int_equal(d->n_shares, 150);
    for (size_t i = 0; i < 150; i++) {
        assert_near(d->shares[i].low, (double)i, 0);
        assert_near(d->shares[i].high, (double)i + 1, 0);
        assert_near(d->shares[i].share, (double)(i + 1) / 150, 1e-12);
    }
    assert_near(m.network.options.loss, 0.5, 0);
    models_free(&m);
}

static void of_a_run_folder_it_is_the_task_s_own(void **state)
{
    struct models m;
    struct task_model client;
    (void)state;
    mkdir(scratch_path("run"), 0700);
    scratch_write("run/timing.csv", "task,quantity,period_ns,low_ns,high_ns,count\n"
                                    "plant,run,1000000000,1,2,50\n"
                                    "client,run,1000000000,1000000,3000000,4\n"
                                    "client,lateness,1000000000,-5000000,500000000,4\n"
                                    "client,run,1000000000,4000000,4000000,4\n");
    assert_int_equal(
        take("client = { execution = \"recorded(run)\"; jitter = \"recorded(run)\"; };", &m, &client), 0);
    assert_int_equal(client.execution.n_shares, 2);
    assert_near(client.execution.shares[0].low, 0.001, 1e-15);
    assert_near(client.execution.shares[0].high, 0.003, 1e-15);
    assert_near(client.execution.shares[0].share, 0.5, 0);
    assert_near(client.execution.shares[1].high, 0.004, 1e-15);
    assert_int_equal(client.jitter.n_shares, 1);
    assert_near(client.jitter.shares[0].low, -0.005, 1e-15);
    assert_near(client.jitter.shares[0].high, 0.5, 1e-15);
    models_free(&m);
    assert_true(take("network = { delay = \"recorded(run)\"; };", &m, &client) < 0);
    assert_has(why.text, "run/timing.csv: has nothing of the delay of task network");
    models_free(&m);
}

static void a_file_that_is_no_histogram_is_refused_with_its_line(void **state)
{
    static const struct {
        const char *text, *reason;
    } of[] = {
        {"", "h.csv:1: it is empty"},
        {"low,high\n1,2\n", "h.csv:1: expected the columns low,high,count"},
        {"low,high,count\n", "h.csv: has nothing of the delay of task network"},
        {"low,high,count\n1,2,0\n", "h.csv: has nothing of the delay"},
        {"low,high,count\n1,2,1\n1,2\n", "h.csv:3: 2 fields under 3 names"},
        {"low,high,count\n1,2,1,1\n", "h.csv:2: 4 fields under 3 names"},
        {"low,high,count\n2,1,1\n", "h.csv:2: a bin from 2 to 1 that counts 1"},
        {"low,high,count\n1,2,-1\n", "h.csv:2: a bin from 1 to 2 that counts -1"},
        {"low,high,count\n1,two,1\n", "h.csv:2: column \"high\": \"two\" is no number"},
        {"low,high,count\none,2,1\n", "h.csv:2: column \"low\": \"one\" is no number"},
        {"low,high,count\n1,2,\n", "h.csv:2: column \"count\": \"\" is no number"},
    };
    char spec[400];
    struct models m = {0};
    const int next = dup(0); /* the lowest descriptor that is free */
    (void)state;
    close(next);
    snprintf(spec, sizeof spec, "delay=recorded(%s)", scratch_path("h.csv"));
    for (size_t i = 0; i < sizeof of / sizeof *of; i++) {
        scratch_write("h.csv", of[i].text);
        m = (struct models){0};
        if (models_network(&m, spec, &why) >= 0)
            fail_msg("taken: %s", of[i].text);
        assert_has(why.text, of[i].reason);
        models_free(&m);
    }
    assert_int_equal(dup(0), next); /* no file is left open */
    close(next);
    m = (struct models){0};
    assert_int_equal(models_network(&m, "delay=recorded(/nowhere)", &why), APC_ENOTFOUND);
    assert_has(why.text, "/nowhere: No such file");
    models_free(&m);
    m = (struct models){0};
    assert_true(models_network(&m, "delay=recorded(/nowhere", &why) < 0);
    assert_has(why.text, "no distribution");
    models_free(&m);
}

/* ---- The command line --------------------------------------------------------------------- */

static void the_command_line_changes_and_adds(void **state)
{
    struct models m;
    struct task_model client;
    (void)state;
    assert_int_equal(take("network = { delay = 1.0; loss = 0.5; outages = ( [1.0, 2.0] ); };", &m, &client),
                     0);
    if (models_network(&m,
                       "delay=gamma(2,0.05),jitter=normal(0,0.01),duplication=0.25,reordering=0.125,"
                       "bandwidth=1e5,outage=10-12.5,outage=20-20",
                       &why) < 0)
        fail_msg("%s", why.text);
    const struct apc_network_options *o = &m.network.options;
    assert_int_equal(o->delay.kind, APC_GAMMA);
    assert_near(o->delay.a, 2, 0);
    assert_near(o->delay.b, 0.05, 0);
    assert_int_equal(o->jitter.kind, APC_NORMAL);
    assert_near(o->loss, 0.5, 0); /* the file's */
    assert_near(o->duplication, 0.25, 0);
    assert_near(o->reordering, 0.125, 0);
    assert_near(o->bandwidth, 1e5, 0);
    assert_int_equal(o->n_outages, 3);
    assert_int_equal(o->outages[0].from, APC_NS_PER_S);
    assert_int_equal(o->outages[1].from, 10 * APC_NS_PER_S);
    assert_int_equal(o->outages[1].until, 25 * APC_NS_PER_S / 2);
    assert_int_equal(o->outages[2].until, 20 * APC_NS_PER_S);
    assert_int_equal(models_network(&m, "loss=1", &why), 0);
    assert_near(o->loss, 1, 0);
    assert_int_equal(models_network(&m, "", &why), 0);
    models_free(&m);
}

static void what_the_command_line_must_not_say_is_refused(void **state)
{
    static const struct {
        const char *spec, *reason;
    } of[] = {
        {"fast", "\"fast\": expected NAME=VALUE, as delay=0.004"},
        {"loss=0.5,fast", "\"fast\": expected NAME=VALUE"},
        {"loss=0.5,,delay=1", "\"\": expected NAME=VALUE"},
        {"speed=3", "there is no \"speed\"; there are: delay, jitter,"},
        {"loss=much", "loss=much: must be a number"},
        {"loss=1.5", "loss is 1.5; it is a probability"},
        {"bandwidth=-1", "bandwidth is -1"},
        {"delay=-0.1", "must not be negative"},
        {"delay=normal(1)", "expected normal(mean, sd)"},
        {"delay=normal(1,2", "normal(1,2"}, /* the bracket that is open takes the commas in it */
        {"outage=3", "outage=3: must be FROM-UNTIL in seconds, as 10-12.5"},
        {"outage=x-3", "outage=x-3: must be FROM-UNTIL"},
        {"outage=3-x", "outage=3-x: must be FROM-UNTIL"},
        {"outage=3-1e300", "must be FROM-UNTIL"},
        {"outage=3-2", "ends before it begins"},
        {"loss=2,loss=0.5,speed=1", "there is no \"speed\""},
    };
    char spec[800];
    (void)state;
    for (size_t i = 0; i < sizeof of / sizeof *of; i++) {
        struct models m = {0};
        if (models_network(&m, of[i].spec, &why) >= 0)
            fail_msg("taken: %s", of[i].spec);
        assert_has(why.text, of[i].reason);
        models_free(&m);
    }
    /* a path that is as long as a part may be is one */
    struct models far = {0};
    scratch_write("delays.csv", "low,high,count\n1,2,3\n");
    const char *folder = scratch_folder();
    const int dots = 511 - 17 - (int)strlen(folder) - (int)strlen("delays.csv");
    int n = snprintf(spec, sizeof spec, "delay=recorded(%s", folder);
    for (int i = 0; i < dots; i++)
        spec[n++] = '/';
    snprintf(spec + n, sizeof spec - (size_t)n, "/delays.csv)");
    assert_int_equal(strlen(spec), 511);
    if (models_network(&far, spec, &why) < 0)
        fail_msg("%s", why.text);
    assert_int_equal(far.network.options.delay.n_shares, 1);
    models_free(&far);
    for (int length = 511; length <= 512; length++) { /* bytes of a part */
        struct models m = {0};
        snprintf(spec, sizeof spec, "delay=recorded(/%0*d)", length - 17, 5);
        assert_int_equal(strlen(spec), length);
        assert_true(models_network(&m, spec, &why) < 0);
        assert_has(why.text, length == 511 ? "0005: File name" : "expected NAME=VALUE");
        models_free(&m);
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(everything_in_the_file_is_taken),
        cmocka_unit_test(what_the_file_must_not_say_is_refused),
        cmocka_unit_test(a_histogram_is_taken_as_shares_of_all),
        cmocka_unit_test(of_a_run_folder_it_is_the_task_s_own),
        cmocka_unit_test(a_file_that_is_no_histogram_is_refused_with_its_line),
        cmocka_unit_test(the_command_line_changes_and_adds),
        cmocka_unit_test(what_the_command_line_must_not_say_is_refused),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}

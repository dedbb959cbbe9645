/* SPDX-License-Identifier: BSD-3-Clause */
/* No memory for an experiment or for what is made of a run, at each place that asks for some: it is said, and
 * nothing is left behind.
 */
#include "check.h"

#include <stdio.h>

#include "analyze/linear.h"
#include "experiment/experiment_parts.h"
#include "figures/figures.h"
#include "nomem.h"
#include "record/record.h"
#include "scratch.h"
#include "simulation/simulation.h"

static struct apc_error why;
static const char *file;
static double until; /* s */
static bool running; /* when it failed: a message that was not sent is one that was lost */

/* Again and again, each time one allocation later fails. */
static void each_allocation_may_fail(const char *what, int (*step)(void))
{
    int n = 0;
    if (!NOMEM)
        skip();
    foreign = false;
    until_failure = 0;
    if (step() < 0) /* what is kept for good is there then */
        fail_msg("%s fails: %s", what, why.text);
    const long before = alive;
    do {
        until_failure = ++n;
        failed = running = false;
        why.text[0] = '\0';
        counting = true;
        const int rc = step();
        counting = false;
        if (failed && rc >= 0 && !running)
            fail_msg("%s: allocation %d: nothing is said of it", what, n);
        if (alive != before)
            fail_msg("%s: allocation %d: %ld are left", what, n, alive - before);
    } while (failed);
    assert_true(n > 1);
}

/* ---- From a file to a simulation -------------------------------------------------------------- */

static int load_and_run(void)
{
    struct experiment e = {.name = ""};
    struct simulation s = {.rc = 0};
    int rc = experiment_load(&e, file, EXPERIMENT_MODEL | EXPERIMENT_LAW, NULL, &why);
    if (rc < 0)
        return rc;
    rc = simulation_create(&s, &e, e.seed, &why);
    running = !failed;
    if (rc == 0)
        rc = simulation_run(&s, until);
    simulation_destroy(&s);
    experiment_free(&e);
    return rc;
}

static void an_experiment_is_refused_or_whole(void **state)
{
    static const struct {
        const char *file;
        double until;
    } of[] = {
        {"alarms/pump-failure.conf", 3.0},  {"two-layers.conf", 3.0},      {"two-layers-mpc.conf", 3.0},
        {"double-tank-override.conf", 3.0}, {"temperature-lab.conf", 3.0}, {"qts/lmpc.conf", 3.0},
        {"van-de-vusse-nmpc.conf", 0.1},
    };
    (void)state;
    for (size_t i = 0; i < sizeof of / sizeof *of; i++) {
        char path[300];
        snprintf(path, sizeof path, "%s/experiments/%s", APC_SOURCE_DIR, of[i].file);
        file = path;
        until = of[i].until;
        each_allocation_may_fail(of[i].file, load_and_run);
    }
}

/* ---- What is made of a run -------------------------------------------------------------------- */

static struct experiment e;
static struct simulation s;
static struct apc_tag *tags;
static size_t n_tags;

static int make_tags(void)
{
    size_t n;
    struct apc_tag *made = provision_tags(&e, &n);
    free(made);
    return made ? 0 : APC_ENOMEM;
}

static int take_controller_alone(void)
{
    const struct controller *c = e.controllers;
    struct standalone *alone;
    const struct experiment_source from = {.file = "alone.conf", .text = e.text};
    while (c->u[0].table == APC_SETPOINT)
        c++;
    int rc = standalone_create(&alone, &from, c->name, &why);
    standalone_destroy(alone);
    return rc;
}

static int provide(void)
{
    struct apc_store *store = NULL;
    int rc = apc_store_open(&store, "mem:", NULL, &why);
    if (rc == 0)
        rc = apc_store_init(store);
    if (rc >= 0)
        rc = provision(store, &e, PROVISION_KEEP);
    apc_store_close(store);
    return rc;
}

static int collect(void)
{
    const struct apc_range range = {.since = 1};
    struct samples all = {0};
    int rc = samples_collect(&all, s.store, &e, &range);
    if (rc == 0)
        rc = samples_collect_operation(&all, s.store, &e, &range);
    if (rc == 0)
        rc = samples_collect_published(&all, s.store, &e, &range);
    samples_free(&all);
    return rc;
}

static int follow(void)
{
    const struct apc_range range = {.since = 1};
    struct samples all = {0};
    struct trajectory trajectory = {0};
    int rc = samples_collect(&all, s.store, &e, &range);
    if (rc == 0)
        rc = trajectory_of_samples(&trajectory, &all, &e, all.n ? all.at[0].time : 0);
    trajectory_free(&trajectory);
    samples_free(&all);
    return rc;
}

static int judge(void)
{
    struct figures f = {0};
    int rc = figures_make(&f, &s.trajectory, &e);
    figures_free(&f);
    return rc;
}

static int value_kpis(void)
{
    struct kpis m = {0};
    int rc = kpis_of_store(&m, s.store, 1, apc_clock_utc(s.clock), 100000);
    kpis_free(&m);
    return rc;
}

static int judge_health(void)
{
    const struct health_asked asked = {.give_up = INT64_MAX};
    struct kpis m = {.from = 1, .until = apc_clock_utc(s.clock)};
    int rc = health_of_store(&m, s.store, &asked);
    kpis_free(&m);
    return rc;
}

static int look_ahead(void)
{
    struct prediction o = {0};
    int rc = prediction_load(&o, s.store, tags, n_tags, INT64_MAX, 0);
    if (rc == 0)
        rc = prediction_take_store(&o, s.store, INT64_MAX);
    prediction_free(&o);
    return rc;
}

static int read_ticks(void)
{
    struct ticks ticks = {0};
    int rc = ticks_load(&ticks, s.store, APC_TICK, 1, 0);
    ticks_free(&ticks);
    return rc;
}

static int read_loops(void)
{
    struct loops loops = {0}, described = {0};
    int rc = loops_load(&loops, s.store, tags, n_tags);
    if (rc >= 0)
        rc = controllers_describe(&e, &described);
    loops_free(&loops);
    loops_free(&described);
    return rc;
}

static int read_journal(void)
{
    struct alarm_journal journal = {0};
    struct alarm_figures figures = {0};
    int rc = alarm_journal_load(&journal, s.store, e.n_alarms, NULL);
    if (rc == 0)
        rc = alarm_figures_make(&figures, &journal, &e, 0, APC_NS_PER_S);
    alarm_figures_free(&figures);
    alarm_journal_free(&journal);
    return rc;
}

static int linearise(void)
{
    const struct linear_how how = {.at = NULL};
    struct linear_loop l = {0};
    struct linear_cost cost = {.known = {false}};
    int rc = linear_loop_create(&l, &e, &how, &why);
    if (rc == 0)
        rc = linear_cost_create(&cost, &e, &l, &how, &why);
    if (rc == 0 && failed && *cost.unknown) /* it is without those that it could not find */
        rc = APC_ENOMEM;
    linear_cost_free(&cost);
    linear_loop_free(&l);
    return rc;
}

static int rewrite(void)
{
    char *line = NULL;
    double value;
    int rc = experiment_line(&e, "plant.period", &line, &why);
    if (rc == 0)
        rc = experiment_value(&e, "client.period", &value, &why);
    free(line);
    return rc;
}

static int read_files(void)
{
    static const struct apc_dim dim = {.ny = 1, .nz = 1, .nu = 1};
    char spec[400];
    struct samples all = {0};
    struct trajectory trajectory = {0};
    struct models m = {0};
    snprintf(spec, sizeof spec, "delay=recorded(%s)", scratch_path("h.csv"));
    int rc = samples_read(&all, scratch_folder(), "samples.csv", &why);
    if (rc == 0)
        rc = trajectory_read(&trajectory, scratch_folder(), &dim, &why);
    if (rc == 0)
        rc = models_network(&m, spec, &why);
    models_free(&m);
    trajectory_free(&trajectory);
    samples_free(&all);
    return rc;
}

static void what_is_read_of_a_run_is_whole_or_not_there(void **state)
{
    (void)state;
    scratch_write("samples.csv", "time,table,id,status,value\n0,sensor,1,Good,1\n1,actuator,1,Good,1\n");
    scratch_write("plant.csv", "time,what,id,value\n0,output,1,1\n1,input,1,1\n2,end,1,0\n");
    scratch_write("h.csv", "low,high,count\n1,2,1\n2,3,1\n");
    each_allocation_may_fail("files", read_files);
}

static int repeat_run(void)
{
    struct replay r;
    int rc = replay_load(&r, scratch_folder(), NULL, &why);
    if (rc == 0 && (rc = replay_run(&r, &(struct replay_watch){.ctx = NULL})) < 0)
        why = r.why;
    replay_free(&r);
    return rc;
}

static int go_back(void)
{
    struct playback playback;
    struct apc_store *store = NULL;
    int rc = playback_load(&playback, scratch_folder(), &e, 20 * APC_NS_PER_S, &why);
    if (rc == 0 && (rc = apc_store_open(&store, "mem:", NULL, &why)) == 0)
        rc = apc_store_init(store);
    if (rc >= 0)
        rc = playback_end(&playback, store);
    apc_store_close(store);
    playback_free(&playback);
    return rc;
}

static void what_a_run_left_is_taken_up_or_not(void **state)
{
    char path[300];
    (void)state;
    if (!NOMEM)
        skip();
    snprintf(path, sizeof path, "%s/experiments/first-order.conf", APC_SOURCE_DIR);
    if (experiment_load(&e, path, EXPERIMENT_MODEL | EXPERIMENT_LAW, NULL, &why) < 0 ||
        simulation_create(&s, &e, e.seed, &why) < 0 || simulation_run(&s, 20.0) < 0 ||
        ticks_keep(scratch_folder(), s.store, &e, &(struct apc_range){0}, &why) < 0)
        fail_msg("%s", why.text);
    e.start = SIMULATION_BEGIN;
    scratch_write("run.conf", e.text);
    scratch_write("samples.csv", "time,table,id,status,value\n0,sensor,1,Good,1\n1,actuator,1,Good,1\n");
    each_allocation_may_fail("replay", repeat_run);
    each_allocation_may_fail("past", go_back);
    simulation_destroy(&s);
    experiment_free(&e);
}

static void what_is_made_of_a_run_is_whole_or_not_there(void **state)
{
    static const struct {
        const char *file;
        double until;
        bool linear; /* what it costs takes its time where a law is predictive */
    } of[] = {{"alarms/pump-failure.conf", 400.0, true}, {"two-layers-mpc.conf", 30.0, false}};
    static const struct {
        const char *what;
        int (*step)(void);
    } steps[] = {{"tags", make_tags},        {"provision", provide},
                 {"samples", collect},       {"course", follow},
                 {"figures", judge},         {"merits", value_kpis},
                 {"prediction", look_ahead}, {"ticks", read_ticks},
                 {"loops", read_loops},      {"health", judge_health},
                 {"alarms", read_journal},   {"text", rewrite},
                 {"linear", linearise},      {"alone", take_controller_alone}};
    (void)state;
    for (size_t i = 0; i < sizeof of / sizeof *of; i++) {
        char path[300];
        snprintf(path, sizeof path, "%s/experiments/%s", APC_SOURCE_DIR, of[i].file);
        if (experiment_load(&e, path, EXPERIMENT_MODEL | EXPERIMENT_LAW, NULL, &why) < 0 ||
            simulation_create(&s, &e, e.seed, &why) < 0 || simulation_run(&s, of[i].until) < 0)
            fail_msg("%s", why.text);
        tags = provision_tags(&e, &n_tags);
        assert_non_null(tags);
        assert_true(apc_store_describe(s.store, tags, n_tags, NULL) >= 0);
        for (size_t k = 0; k < sizeof steps / sizeof *steps; k++)
            if (of[i].linear || steps[k].step != linearise)
                each_allocation_may_fail(steps[k].what, steps[k].step);
        free(tags);
        simulation_destroy(&s);
        experiment_free(&e);
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(an_experiment_is_refused_or_whole),
        cmocka_unit_test(what_is_made_of_a_run_is_whole_or_not_there),
        cmocka_unit_test(what_is_read_of_a_run_is_whole_or_not_there),
        cmocka_unit_test(what_a_run_left_is_taken_up_or_not),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}

/* SPDX-License-Identifier: BSD-3-Clause */
/* What is said of the runs of a campaign, on runs whose figures are known; and campaigns that are run. */
#include "check.h"

#include <fcntl.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/wait.h>
#include <unistd.h>

#include "apc/simulate/campaign_summary.h"
#include "scratch.h"
#include "simulation/simulation.h"

#define RUNS  6
#define FIRST 10 /* seed */

static struct signal y[2] = {{.tag.name = "level"}, {.tag.name = "heat"}};
static const struct apc_law law = {.name = "ours"};
static struct experiment e;
static const struct loop loop[2] = {{"level", 0, 0, {APC_ACTUATOR, 0}}, {"heat", 1, 1, {APC_ACTUATOR, 1}}};
static struct campaign_options options;
static struct campaign campaign;
static struct worker_pool pool;
static struct apc_error why;
static char *said;
static size_t said_length;
static struct controller controller;

static double *figure(unsigned run, size_t of, enum metric metric)
{
    return &campaign_trial(&campaign, run)->figure[of * METRICS + (size_t)metric];
}

/* Runs that were made and went well; of each loop all figures are known, and are 1. */
static int begin(void **state)
{
    (void)state;
    controller = (struct controller){.law = &law};
    e = (struct experiment){.name = "two",
                            .y = y,
                            .dim = {2, 2, 2, 0},
                            .duration = 2.5,
                            .controllers = &controller,
                            .n_controllers = 1};
    options = (struct campaign_options){.seed = FIRST, .runs = RUNS, .against = "before.csv"};
    campaign = (struct campaign){.e = &e, .options = &options, .loop = loop, .loops = 2, .pool = &pool};
    campaign.stride = trial_size(2);
    campaign.trials = calloc(RUNS, campaign.stride);
    atomic_store(&pool.stop, false);
    options.talk = open_memstream(&said, &said_length);
    for (unsigned run = 0; run < RUNS; run++) {
        campaign_trial(&campaign, run)->made = true;
        for (size_t i = 0; i < (size_t)2 * METRICS; i++)
            campaign_trial(&campaign, run)->figure[i] = 1;
    }
    return campaign.trials && options.talk ? 0 : -1;
}

static int end(void **state)
{
    (void)state;
    fclose(options.talk);
    free(said);
    free(campaign.former);
    free(campaign.trials);
    return 0;
}

/* What was said since it was asked for last. */
static const char *talk(void)
{
    static char text[20000];
    fclose(options.talk);
    snprintf(text, sizeof text, "%s", said);
    free(said);
    options.talk = open_memstream(&said, &said_length);
    assert_non_null(options.talk);
    return text;
}

/* A line of a table that begins with @start, a blank between two words. */
static const char *row(const char *text, const char *start)
{
    static char line[400];
    while (*text) {
        size_t n = 0;
        for (; *text && *text != '\n'; text++)
            if (*text != ' ' || (n > 0 && line[n - 1] != ' '))
                line[n++] = *text;
        text += *text == '\n';
        line[n] = '\0';
        if (!strncmp(line, start, strlen(start)))
            return line;
    }
    fail_msg("no line \"%s\"", start);
    return NULL;
}

static void assert_lacks(const char *text, const char *part)
{
    if (strstr(text, part))
        fail_msg("\"%s\" in \"%s\"", part, text);
}

/* What @p print leaves on stdout. */
static const char *printed(int (*print)(const struct campaign *c, struct apc_error *error))
{
    static char text[20000];
    fflush(stdout);
    int before = dup(STDOUT_FILENO), file = open(scratch_path("stdout"), O_RDWR | O_CREAT | O_TRUNC, 0600);
    assert_true(before >= 0 && file >= 0);
    dup2(file, STDOUT_FILENO);
    int rc = print(&campaign, &why);
    fflush(stdout);
    dup2(before, STDOUT_FILENO);
    ssize_t n = pread(file, text, sizeof text - 1, 0);
    close(before);
    close(file);
    assert_int_equal(rc, 0);
    assert_true(n >= 0);
    text[n] = '\0';
    return text;
}

static const char *table(void)
{
    if (summary_print(&campaign, &why) < 0)
        fail_msg("%s", why.text);
    return talk();
}

/* ---- Over all runs ------------------------------------------------------------------------ */

static void a_row_has_the_statistics_of_the_runs_that_have_the_figure(void **state)
{
    static const double iae[] = {2, 6, 1, 3};
    (void)state;
    for (unsigned run = 0; run < 4; run++)
        *figure(run, 0, METRIC_IAE) = iae[run];
    campaign_trial(&campaign, 4)->made = false;
    campaign_trial(&campaign, 5)->rc = APC_ESOLVER;
    for (unsigned run = 4; run < RUNS; run++)
        *figure(run, 0, METRIC_IAE) = 99;
    for (unsigned run = 0; run < RUNS; run++) {
        *figure(run, 0, METRIC_PEAK) = run == 2 ? 5 : (double)NAN;
        *figure(run, 1, METRIC_PEAK) = (double)NAN;
    }
    *figure(3, 1, METRIC_IAE) = 7;
    const char *text = table();
    assert_string_equal(row(text, "loop "), "loop runs mean +- 95 % sd median 95 % 99 % worst its seed");
    /* mean 3, squares 1 + 9 + 4 + 0 over 3 degrees of freedom, 3.1824 of Student's */
    assert_string_equal(row(text, "level IAE"), "level IAE 4 3 3.44 2.16 2 6 6 6 11");
    assert_string_equal(row(text, "level peak"), "level peak 1 5 - - 5 5 5 5 12");
    assert_string_equal(row(text, "heat peak"), "heat peak 0 - - - - - - - -");
    assert_string_equal(row(text, "heat IAE"), "heat IAE 4 2.5 4.77 3 1 7 7 7 13");
    assert_string_equal(row(text, "heat control effort"), "heat control effort 4 1 0 0 1 1 1 1 10");
    assert_lacks(text, "infinite");
    assert_lacks(text, "controller");
    assert_lacks(text, "compared with");
}

static void numbers_are_told_with_the_digits_that_they_are_good_for(void **state)
{
    (void)state;
    for (unsigned run = 0; run < RUNS; run++)
        *figure(run, 0, METRIC_IAE) = 1234.5678 + 1111.11111 * run;
    /* 1111.1 sqrt(3.5), 5 degrees of freedom, 2.5706 of Student's */
    assert_string_equal(row(table(), "level IAE"),
                        "level IAE 6 4012.3 2.18e+03 2.08e+03 3456.8 6790.1 6790.1 6790.1 15");
}

static void what_diverged_counts_as_infinite_and_is_told(void **state)
{
    (void)state;
    campaign_trial(&campaign, 1)->rc = APC_ESOLVER;
    campaign_trial(&campaign, 1)->diverged = true;
    *figure(1, 0, METRIC_IAE) = HUGE_VAL;
    for (unsigned run = 2; run < 5; run++)
        *figure(run, 1, METRIC_SETTLING) = HUGE_VAL;
    *figure(5, 1, METRIC_SETTLING) = (double)NAN;
    *figure(0, 1, METRIC_RECOVERY) = HUGE_VAL;
    campaign_trial(&campaign, 4)->rc = APC_ESOLVER; /* nobody knows its figures */
    const char *text = table();
    assert_string_equal(row(text, "level IAE"), "level IAE 5 inf - - 1 inf inf inf 11");
    assert_has(text, "level: 1 of 5 runs ended early: they count as infinite\n");
    assert_has(text, "heat: 2 of 4 runs did not settle: they count as infinite\n");
    assert_has(text, "heat: 1 of 5 runs did not recover: they count as infinite\n");
    assert_lacks(text, "level: 0");
    assert_lacks(text, "heat: 0");
}

static void what_the_controllers_had_is_told(void **state)
{
    (void)state;
    campaign_trial(&campaign, 0)->held = 1;
    campaign_trial(&campaign, 2)->held = 1000;
    campaign_trial(&campaign, 3)->failures = 1;
    campaign_trial(&campaign, 5)->made = false;
    const char *text = table();
    assert_has(text, "controller: output held or at its fault value in 2 of 5 runs\n");
    assert_has(text, "controller: law ours gave no usable output in 1 of 5 runs\n");
}

static void runs_that_are_all_the_same_are_told_of(void **state)
{
    static const char same[] = "all 6 runs are the same";
    (void)state;
    assert_has(table(), same);
    *figure(RUNS - 1, 1, METRICS - 1) = 2;
    assert_lacks(table(), same);
    *figure(RUNS - 1, 1, METRICS - 1) = 1;
    *figure(1, 0, METRIC_IAE) = 2;
    assert_lacks(table(), same);
    *figure(1, 0, METRIC_IAE) = 1;
    campaign_trial(&campaign, 3)->rc = APC_ESOLVER;
    assert_lacks(table(), same);
    campaign_trial(&campaign, 3)->rc = 0;
    options.runs = 2;
    assert_has(table(), "all 2 runs are the same");
    options.runs = 1;
    assert_lacks(table(), "are the same");
}

static void a_program_gets_all_of_it(void **state)
{
    static const double iae[] = {2, 6, 1, 3};
    (void)state;
    options.json = true;
    options.runs = 4;
    for (unsigned run = 0; run < 4; run++)
        *figure(run, 0, METRIC_IAE) = iae[run];
    *figure(3, 1, METRIC_SETTLING) = HUGE_VAL;
    for (unsigned run = 0; run < 4; run++)
        *figure(run, 0, METRIC_PEAK) = *figure(run, 1, METRIC_PEAK) = (double)NAN;
    *figure(2, 1, METRIC_PEAK) = 5;
    const char *text = printed(summary_print);
    assert_int_equal(
        strncmp(text,
                "{\"experiment\":\"two\",\"runs\":4,\"seed\":10,\"duration_s\":2.5,\"loops\":[{"
                "\"loop\":\"level\",\"iae\":{\"runs\":4,\"infinite\":0,\"mean\":3,\"low95\":-0.43",
                130),
        0);
    assert_has(text, ",\"high95\":6.43");
    assert_has(text, ",\"sd\":2.16");
    assert_has(text, ",\"median\":2,\"p95\":6,\"p99\":6,\"worst\":6,\"worst_seed\":11},\"ise\":{");
    assert_has(text, "\"peak\":{\"runs\":0,\"infinite\":0,\"mean\":null,\"low95\":null,\"high95\":null,"
                     "\"sd\":null,\"median\":null,\"p95\":null,\"p99\":null,\"worst\":null},");
    assert_has(text, "},{\"loop\":\"heat\",\"iae\":{\"runs\":4,\"infinite\":0,\"mean\":1,\"low95\":1,");
    assert_has(text, "\"settling_s\":{\"runs\":4,\"infinite\":1,\"mean\":null,");
    assert_has(text, "\"worst\":null,\"worst_seed\":13}");
    assert_has(text, "\"peak\":{\"runs\":1,\"infinite\":0,\"mean\":5,");
    assert_has(text, "\"worst\":5,\"worst_seed\":12}");
    assert_string_equal(text + strlen(text) - 5, "}}]}\n");
    assert_lacks(text, "differences");
}

/* ---- The file of the runs ----------------------------------------------------------------- */

static void read_again(const char *name)
{
    static char path[300];
    snprintf(path, sizeof path, "%s", scratch_path(name));
    options.against = path;
    if (summary_read(&campaign, &why) < 0)
        fail_msg("%s", why.text);
}

static void a_file_of_runs_is_read_as_it_was_written(void **state)
{
    char path[300], line[300];
    (void)state;
    *figure(0, 0, METRIC_IAE) = 1.0 / 3;
    *figure(0, 0, METRIC_SETTLING) = HUGE_VAL;
    *figure(0, 0, METRIC_PEAK) = (double)NAN;
    *figure(RUNS - 1, 1, METRICS - 1) = -8;
    campaign_trial(&campaign, 2)->rc = APC_ESOLVER;
    snprintf(path, sizeof path, "%s", scratch_path("runs.csv"));
    options.csv = path;
    assert_int_equal(summary_csv(&campaign, &why), 0);
    FILE *in = fopen(path, "r");
    assert_non_null(in);
    assert_non_null(fgets(line, sizeof line, in));
    assert_string_equal(line, "seed,loop,iae,ise,itae,overshoot_percent,settling_s,peak,recovery_s,effort,"
                              "uncontrolled_percent\n");
    assert_non_null(fgets(line, sizeof line, in));
    assert_string_equal(line, "10,1,0.33333333333333331,1,1,1,inf,,1,1,1\n");
    int lines = 2;
    while (fgets(line, sizeof line, in))
        lines++;
    fclose(in);
    assert_string_equal(line, "15,2,1,1,1,1,1,1,1,1,-8\n");
    assert_int_equal(lines, 1 + (RUNS - 1) * 2);
    read_again("runs.csv");
    for (unsigned run = 0; run < RUNS; run++)
        for (size_t i = 0; i < (size_t)2 * METRICS; i++) {
            double was = campaign_trial(&campaign, run)->figure[i],
                   is = campaign.former[run * 2 * METRICS + i];
            if (run == 2 || isnan(was))
                assert_true(isnan(is));
            else if (isinf(was))
                assert_true(isinf(is));
            else
                assert_near(is, was, 0);
        }
    options.csv = "-";
    assert_has(printed(summary_csv), "\n15,2,1,1,1,1,1,1,1,1,-8\n");
    options.csv = "/dev/full";
    assert_int_equal(summary_csv(&campaign, &why), APC_ESYS);
    assert_has(why.text, "/dev/full: cannot be written: ");
    options.csv = "/nowhere/runs.csv";
    assert_int_equal(summary_csv(&campaign, &why), APC_ESYS);
    assert_has(why.text, "/nowhere/runs.csv: cannot be written: No such file");
}

static void two_campaigns_are_compared_seed_by_seed(void **state)
{
    char path[300];
    (void)state;
    for (unsigned run = 0; run < RUNS; run++) {
        *figure(run, 0, METRIC_IAE) = run;
        *figure(run, 0, METRIC_SETTLING) = run < 2 ? HUGE_VAL : 1;
    }
    *figure(5, 0, METRIC_PEAK) = (double)NAN;
    snprintf(path, sizeof path, "%s", scratch_path("former.csv"));
    options.csv = path;
    assert_int_equal(summary_csv(&campaign, &why), 0);
    /* the campaign after it begins two seeds later: of its runs the first four were in the one before */
    options.seed += 2;
    for (unsigned run = 0; run < RUNS; run++) {
        *figure(run, 0, METRIC_IAE) = run + 2 + 5 + run % 2; /* 5, 6, 5, 6 more */
        *figure(run, 0, METRIC_ISE) = 0.5 - run % 2;         /* 0.5 or 1.5 less, so hardly anything */
        *figure(run, 0, METRIC_ITAE) = run % 2 ? 3 : -1;     /* 2 more or 2 less */
        *figure(run, 0, METRIC_EFFORT) = -9 - (double)run;
        *figure(run, 0, METRIC_OVERSHOOT) = 1235.5678; /* 1234.5678 more */
    }
    read_again("former.csv");
    const char *text = table();
    assert_has(text, "compared with ");
    assert_has(text, "/former.csv, seed by seed:\n");
    text = strstr(text, "compared with ");
    assert_string_equal(row(text, "loop "), "loop pairs mean difference 95 % from to");
    /* 5.5 +- 3.1824 sqrt(1/3) / 2 */
    assert_string_equal(row(text, "level IAE"), "level IAE 4 5.5 4.5813 6.4187 more");
    assert_string_equal(row(text, "level ITAE"), "level ITAE 4 0 -3.6747 3.6747 none to be seen");
    assert_string_equal(row(text, "level control effort"),
                        "level control effort 4 -11.5 -13.554 -9.4458 less");
    assert_string_equal(row(text, "level overshoot"), "level overshoot % 4 1234.6 1234.6 1234.6 more");
    assert_string_equal(row(text, "level peak"), "level peak 3 0 0 0 none to be seen");
    assert_string_equal(row(text, "heat IAE"), "heat IAE 4 0 0 0 none to be seen");
    options.json = true;
    text = printed(summary_print);
    assert_has(text,
               "],\"differences\":[{\"loop\":\"level\",\"iae\":{\"runs\":4,\"infinite\":0,\"mean\":5.5,");
    options.json = false;
    /* infinite in both: no difference; in one: an infinite one */
    options.seed -= 2;
    for (unsigned run = 0; run < RUNS; run++)
        *figure(run, 0, METRIC_SETTLING) = 1;
    *figure(0, 0, METRIC_SETTLING) = HUGE_VAL;
    free(campaign.former);
    read_again("former.csv");
    text = strstr(table(), "compared with ");
    assert_non_null(text);
    assert_string_equal(row(text, "level settling"), "level settling s 6 -inf - -");
}

static void a_file_that_is_none_of_a_campaign_is_refused_with_its_line(void **state)
{
    static const char *const lines[] = {"10,3,1,1,1,1,1,1,1,1,1",   "10,0,1,1,1,1,1,1,1,1,1",
                                        "10,1.5,1,1,1,1,1,1,1,1,1", "10,,1,1,1,1,1,1,1,1,1",
                                        ",1,1,1,1,1,1,1,1,1,1",     "1x,1,1,1,1,1,1,1,1,1,1",
                                        "10,1,1,1,1,1,1,1,1,1",     "10,1,1,1,1,1,1,1,1,1,1,1",
                                        "10,1,one,1,1,1,1,1,1,1,1", "99,3,1,1,1,1,1,1,1,1,1"};
    static const char *const good[] = {"10,2,1,1,1,1,1,1,1,1,1",
                                       "99,1,1,1,1,1,1,1,1,1,1",
                                       "9,1,,,,,,,,,",
                                       "16,1,1,1,1,1,1,1,1,1,1",
                                       "15,2,inf,inf,,,,,,,inf\r",
                                       "10,1,1,1,1,1,1,1,1,1,nan",
                                       ""};
    char path[300];
    (void)state;
    snprintf(path, sizeof path, "%s", scratch_path("bad.csv"));
    options.against = path;
    const size_t bad = sizeof lines / sizeof *lines, all = bad + sizeof good / sizeof *good;
    for (size_t i = 0; i < all; i++) {
        const char *line = i < bad ? lines[i] : good[i - bad];
        FILE *out = fopen(path, "w");
        assert_non_null(out);
        fprintf(out, "seed,loop");
        for (int metric = 0; metric < METRICS; metric++) {
            const char *former = metric_former_key((enum metric)metric);
            fprintf(out, ",%s", former && i % 2 ? former : metric_key((enum metric)metric));
        }
        fprintf(out, "\n10,1,1,1,1,1,1,1,1,1,1\n%s\n", line);
        fclose(out);
        int rc = summary_read(&campaign, &why);
        if (rc != (i < bad ? APC_EPROTO : 0))
            fail_msg("\"%s\": %d", line, rc);
        if (i < bad)
            assert_has(why.text, "bad.csv:3: ");
        free(campaign.former);
        campaign.former = NULL;
    }
    FILE *out = fopen(path, "w");
    assert_non_null(out);
    fclose(out);
    assert_int_equal(summary_read(&campaign, &why), APC_EPROTO);
    assert_has(why.text, "bad.csv:1: it is empty");
    free(campaign.former);
    options.against = "/nowhere/at.all";
    assert_int_equal(summary_read(&campaign, &why), APC_ENOTFOUND);
    assert_has(why.text, "/nowhere/at.all: No such file");
}

/* ---- What failed -------------------------------------------------------------------------- */

static void a_few_of_the_runs_that_failed_are_told_of(void **state)
{
    (void)state;
    assert_int_equal(summary_failures(&campaign, &why), 0);
    assert_string_equal(talk(), "");
    for (unsigned run = 0; run < RUNS; run++) {
        struct trial *r = campaign_trial(&campaign, run);
        r->rc = run == 0 ? APC_ENOMEM : APC_ESOLVER;
        snprintf(r->why, sizeof r->why, "reason %u", run);
    }
    assert_int_equal(summary_failures(&campaign, &why), APC_ENOMEM);
    assert_string_equal(why.text, "6 of 6 runs ended early");
    const char *text = talk();
    assert_has(text, "seed 10: reason 0\nseed 11: reason 1\n");
    assert_has(text, "seed 14: reason 4\n");
    assert_lacks(text, "seed 15");
    assert_lacks(text, "not made");
}

static void runs_that_are_missing_are_an_error_also_when_someone_stopped_them(void **state)
{
    (void)state;
    campaign_trial(&campaign, 1)->made = false;
    campaign_trial(&campaign, 1)->rc = APC_ESYS; /* says nothing then */
    campaign_trial(&campaign, 4)->made = false;
    assert_int_equal(summary_failures(&campaign, &why), APC_ESYS);
    assert_has(why.text, "runs are missing");
    assert_has(talk(), "2 of 6 runs were not made\n");
    atomic_store(&pool.stop, true);
    assert_int_equal(summary_failures(&campaign, &why), APC_ESTATE);
    assert_string_equal(why.text, "ended by a signal: 4 of 6 runs were made");
    assert_has(talk(), "2 of 6 runs were not made\n");
}

/* ---- Campaigns that are run --------------------------------------------------------------- */

static void load(struct experiment *of)
{
    scratch_write("world.conf",
                  "name = \"world\"; title = \"A world\"; duration = 12.0;\n"
                  "measurements = ( { name = \"y\"; noise = 0.5; } ); setpoints = ( { name = \"r\"; } );\n"
                  "outputs = ( { name = \"u\"; low = -10.0; high = 10.0; } );\n"
                  "plant = { model = \"first-order\"; period = 0.2; noise = { x = 0.1; }; };\n"
                  "client = { period = 0.2; }; controller = { law = \"pi\"; period = 0.5; };\n"
                  "scheduler = { period = 6.0; sequence = ( [0.0], [3.0] ); };\n");
    if (experiment_load(of, scratch_path("world.conf"), EXPERIMENT_MODEL | EXPERIMENT_LAW, NULL, &why) < 0)
        fail_msg("%s", why.text);
}

/* Nothing is held at a setpoint: there are runs, and nothing to judge them by. */
static void what_has_no_loop_is_run_all_the_same(void **state)
{
    struct experiment of;
    (void)state;
    scratch_write("world.conf", "name = \"open\"; title = \"An open loop\"; duration = 12.0;\n"
                                "measurements = ( { name = \"y\"; } ); setpoints = ( { name = \"r\"; } );\n"
                                "outputs = ( { name = \"u\"; low = -10.0; high = 10.0; } );\n"
                                "plant = { model = \"first-order\"; period = 0.2; };\n"
                                "client = { period = 0.2; };\n"
                                "controllers = ( { name = \"smooth\"; law = \"filter\"; period = 0.5;\n"
                                "  measurements = [\"y\"]; outputs = [\"u\"]; } );\n");
    if (experiment_load(&of, scratch_path("world.conf"), EXPERIMENT_MODEL | EXPERIMENT_LAW, NULL, &why) < 0)
        fail_msg("%s", why.text);
    options = (struct campaign_options){.seed = 7, .runs = 3, .jobs = 2, .talk = options.talk};
    if (campaign_run(&of, &options, &why) < 0)
        fail_msg("%s", why.text);
    assert_has(talk(), "open: An open loop\n3 runs of 12 s in ");
    experiment_free(&of);
}

/* A law that lives in this program, as code of the user's that does something else with the process. */
static void (*mood)(unsigned call);
static unsigned calls;

static int moody(struct apc_law_call *c)
{
    if (mood)
        mood(calls++);
    c->u[0] = 0.1 * (c->z[0] - c->y[0]) + 0.001 * calls;
    return APC_LAW_GOOD;
}

static void be(struct experiment *of, void (*how)(unsigned call), bool plugin)
{
    static struct apc_law moody_law;
    moody_law = *of->controllers->law;
    moody_law.name = "moody";
    moody_law.compute = moody;
    of->controllers->law = &moody_law;
    of->controllers->law_handle = plugin ? &mood : NULL;
    mood = how;
    calls = 0;
}

static int run(struct experiment *of, unsigned runs, unsigned jobs)
{
    static char path[300];
    snprintf(path, sizeof path, "%s", scratch_path("ran.csv"));
    options =
        (struct campaign_options){.seed = 7, .runs = runs, .jobs = jobs, .csv = path, .talk = options.talk};
    why.text[0] = '\0';
    return campaign_run(of, &options, &why);
}

static void done_with(struct experiment *of)
{
    of->controllers->law_handle = NULL;
    experiment_free(of);
}

static void assert_ran_as_alone(const struct experiment *of, unsigned runs)
{
    struct campaign again = campaign;
    again.options = &options;
    again.loops = 1;
    again.former = NULL;
    options.against = options.csv;
    assert_int_equal(summary_read(&again, &why), 0);
    for (unsigned i = 0; i < runs; i++) {
        struct simulation s;
        struct figures f = {0};
        calls = 0;
        assert_int_equal(simulation_create(&s, of, 7 + i, &why), 0);
        assert_int_equal(simulation_run(&s, of->duration), 0);
        assert_int_equal(figures_make(&f, &s.trajectory, of), 0);
        for (size_t k = 0; k < METRICS; k++) {
            double wanted = f.of[0].figure[k], is = again.former[i * METRICS + k];
            assert_true(isnan(wanted) ? isnan(is) : isinf(wanted) ? isinf(is) : fabs(wanted - is) <= 0);
        }
        figures_free(&f);
        simulation_destroy(&s);
    }
    free(again.former);
}

static void on_no_terminal_it_does_not_show_how_far_it_is(void **state)
{
    struct experiment of;
    (void)state;
    fflush(stderr);
    int before = dup(STDERR_FILENO), file = open(scratch_path("stderr"), O_RDWR | O_CREAT | O_TRUNC, 0600);
    assert_true(before >= 0 && file >= 0);
    load(&of);
    dup2(file, STDERR_FILENO);
    int rc = run(&of, 3, 2);
    fflush(stderr);
    dup2(before, STDERR_FILENO);
    assert_int_equal(rc, 0);
    assert_int_equal(lseek(file, 0, SEEK_END), 0);
    close(before);
    close(file);
    done_with(&of);
}

static void each_run_is_that_of_its_seed_whoever_makes_it(void **state)
{
    (void)state;
    for (unsigned jobs = 0; jobs < 4; jobs++) {
        struct experiment of;
        load(&of);
        assert_int_equal(run(&of, 5, jobs), 0);
        assert_ran_as_alone(&of, 5);
        const char *text = talk();
        assert_has(text, "world: A world\n5 runs of 12 s in ");
        assert_lacks(text, "not made");
        double took, times;
        assert_int_equal(
            sscanf(strstr(text, "12 s in "), "12 s in %lf s: %lf times as fast as real time", &took, &times),
            2);
        assert_near(took * times, 5 * 12.0, 0.02 * 60);
        done_with(&of);
    }
}

static void step_once(unsigned call)
{
    (void)call;
}

static void code_of_the_user_s_finds_its_statics_as_they_were(void **state)
{
    struct experiment of;
    (void)state;
    load(&of);
    be(&of, step_once, true);
    assert_int_equal(run(&of, 4, 1), 0);
    assert_ran_as_alone(&of, 4);
    done_with(&of);
}

static void crash(unsigned call)
{
    if (call == 3)
        abort();
}

static void leave(unsigned call)
{
    if (call == 3)
        _exit(9);
}

static void a_run_that_ends_its_process_says_how(void **state)
{
    struct experiment of;
    (void)state;
    load(&of);
    be(&of, crash, true);
    assert_int_equal(run(&of, 3, 2), APC_ESYS);
    assert_string_equal(why.text, "3 of 3 runs ended early");
    const char *text = talk();
    assert_has(text, "3 runs of 12 s in "); /* none is left out */
    assert_has(text, "seed 9: its process was ended by signal 6 (Aborted)\n");
    be(&of, leave, true);
    assert_int_equal(run(&of, 3, 2), APC_ESYS);
    assert_has(talk(), "seed 7: law or plant ended its process (exit code 9)\n");
    done_with(&of);
}

static void a_worker_that_dies_is_an_error_and_what_was_made_is_kept(void **state)
{
    struct experiment of;
    (void)state;
    load(&of);
    be(&of, crash, false);
    assert_int_equal(run(&of, 3, 1), APC_ESYS);
    assert_string_equal(why.text, "a process of the campaign died of a signal: runs are missing");
    assert_has(talk(), "3 of 3 runs were not made\n");
    be(&of, leave, false);
    assert_int_equal(run(&of, 3, 1), APC_ESYS);
    assert_string_equal(why.text, "a process of the campaign died: runs are missing");
    done_with(&of);
}

static pid_t campaign_process;

static void stop(unsigned call)
{
    if (call == 3)
        kill(campaign_process, SIGTERM);
}

static void never_return(unsigned call)
{
    (void)call;
    for (;;) {
        kill(campaign_process, SIGINT);
        usleep(50000); /* until the campaign ends this process */
    }
}

static void a_signal_lets_the_runs_at_hand_end_and_a_later_one_ends_them(void **state)
{
    sigset_t before, after;
    struct experiment of;
    (void)state;
    campaign_process = getpid();
    sigprocmask(SIG_SETMASK, NULL, &before);
    load(&of);
    be(&of, stop, false);
    assert_int_equal(run(&of, 20000, 1), APC_ESTATE);
    assert_has(why.text, "ended by a signal: ");
    const char *text = talk();
    assert_has(text, " of 20000 runs were not made\n");
    assert_lacks(text, "20000 of 20000");
    be(&of, never_return, false);
    assert_int_equal(run(&of, 8, 2), APC_ESTATE);
    assert_string_equal(why.text, "ended by a signal: 0 of 8 runs were made");
    assert_has(talk(), "8 of 8 runs were not made\n");
    sigprocmask(SIG_SETMASK, NULL, &after);
    assert_int_equal(sigismember(&after, SIGTERM), sigismember(&before, SIGTERM));
    assert_int_equal(sigismember(&after, SIGINT), sigismember(&before, SIGINT));
    done_with(&of);
}

/* ---- On a terminal ------------------------------------------------------------------------ */

static void a_terminal_shows_how_far_it_is(void **state)
{
    char text[100000];
    size_t n = 0;
    struct experiment of;
    (void)state;
    int master = posix_openpt(O_RDWR | O_NOCTTY);
    if (master < 0 || grantpt(master) < 0 || unlockpt(master) < 0)
        skip();
    int slave = open(ptsname(master), O_RDWR | O_NOCTTY), before = dup(STDERR_FILENO);
    assert_true(slave >= 0 && before >= 0);
    load(&of);
    fflush(stderr);
    dup2(slave, STDERR_FILENO);
    int rc = run(&of, 8, 2);
    fflush(stderr);
    dup2(before, STDERR_FILENO);
    close(before);
    assert_int_equal(rc, 0);
    fcntl(master, F_SETFL, O_NONBLOCK);
    for (ssize_t got; n < sizeof text - 1 && (got = read(master, text + n, sizeof text - 1 - n)) > 0;)
        n += (size_t)got;
    text[n] = '\0';
    close(slave);
    close(master);
    assert_has(text, "\r8 of 8 runs  [########################] 100 %\r\n");
    unsigned shown = 0;
    for (const char *at = text; (at = strstr(at, " of 8 runs  [")); shown++) {
        unsigned done = (unsigned)(at[-1] - '0');
        at += strlen(" of 8 runs  [");
        assert_int_equal(strspn(at, "#"), 3 * done);
        at += 3 * done;
        assert_int_equal(strspn(at, "."), 24 - 3 * done);
        assert_int_equal(strtod(strchr(at, ']') + 1, NULL), (int)rint(12.5 * done)); /* as printf rounds */
    }
    assert_true(shown > 0);
    done_with(&of);
}

#define T(name) cmocka_unit_test_setup_teardown(name, begin, end)

int main(void)
{
    const struct CMUnitTest tests[] = {
        T(a_row_has_the_statistics_of_the_runs_that_have_the_figure),
        T(numbers_are_told_with_the_digits_that_they_are_good_for),
        T(what_diverged_counts_as_infinite_and_is_told),
        T(what_the_controllers_had_is_told),
        T(runs_that_are_all_the_same_are_told_of),
        T(a_program_gets_all_of_it),
        T(a_file_of_runs_is_read_as_it_was_written),
        T(two_campaigns_are_compared_seed_by_seed),
        T(a_file_that_is_none_of_a_campaign_is_refused_with_its_line),
        T(a_few_of_the_runs_that_failed_are_told_of),
        T(runs_that_are_missing_are_an_error_also_when_someone_stopped_them),
        T(what_has_no_loop_is_run_all_the_same),
        T(on_no_terminal_it_does_not_show_how_far_it_is),
        T(each_run_is_that_of_its_seed_whoever_makes_it),
        T(code_of_the_user_s_finds_its_statics_as_they_were),
        T(a_run_that_ends_its_process_says_how),
        T(a_worker_that_dies_is_an_error_and_what_was_made_is_kept),
        T(a_signal_lets_the_runs_at_hand_end_and_a_later_one_ends_them),
        T(a_terminal_shows_how_far_it_is),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}

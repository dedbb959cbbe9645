/* SPDX-License-Identifier: BSD-3-Clause */
/* apc check: scenarios in virtual time, over their seeds, and what is expected of them. */
#include "check_session.h"

#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>

#include "apc/common/cli.h"
#include "apc/common/setting.h"
#include "apc/folder/folder.h"
#include "apc/simulate/trial.h"
#include "apc/simulate/worker_pool.h"

struct check_options {
    enum check_format format;
    unsigned runs, jobs; /* 0: the scenario's; one a CPU */
    uint64_t seed;
    bool seeded;
    const char *session, *report;
    bool force;
    struct setting_list set;
};

static const char *const formats[] = {"text", "tap", "junit", "json", "html", NULL};

#define AT(member) .to = offsetof(struct check_options, member)
static const struct option_spec own_options[] = {
    {"format", 0, "FORMAT",
     "text (default), tap (Test Anything Protocol), junit (XML), json, or html: a page for paper",
     OPTION_CHOICE, AT(format), .choices = formats},
    {"runs", 'n', "N", "Number of runs of each scenario, each with a seed of its own, instead of the file's",
     OPTION_COUNT, AT(runs), .low = 1, .high = 1000000, .must = "be 1 to 1000000"},
    {"seed", 's', "N", "Seed of the first run, instead of the file's; without --runs there is only this run",
     OPTION_WHOLE, AT(seed), .given = 1 + offsetof(struct check_options, seeded), .high = 0x1p53,
     .must = "be a whole number, 0 to 9007199254740992"},
    {"session", 0, "RUN",
     "Check the session of `apc run --speed` in run folder RUN, with its operators' actions, instead of "
     "running the scenario's experiment",
     OPTION_TEXT, AT(session)},
    {"jobs", 'j', "N", "Number of processes; default: one per CPU", OPTION_COUNT, AT(jobs), .low = 1,
     .high = 1024, .must = "be 1 to 1024"},
    {"set", 0, "PATH=VALUE",
     "Override a setting of the experiment file and of the scenario, as duration=60.0; may be repeated",
     OPTION_OWN, AT(set), .take = setting_add},
    {"report", 'o', "DIR",
     "Keep the run folder of each run that is reported as failed, as DIR/NAME-SEED, with a figure around "
     "each failure",
     OPTION_TEXT, AT(report)},
    {"force", 0, NULL, "Overwrite the files in such a folder", OPTION_FLAG, AT(force)},
    {0},
};

static const struct cli_spec spec = {
    .args_doc = "SCENARIO...",
    .doc = "Run scenarios in virtual time and check their expectations. A scenario is an experiment with "
           "faults, disturbances and an operator's actions, and with expectations such as `never y2 < 20`. "
           "For a failed one, show why the responsible output moved, as `apc why` does. The exit code is 0 "
           "if all were met, 1 if some were not, 2 if a scenario is wrong: then nothing was run.",
    .min_args = 1,
    .max_args = -1,
    .options = own_options,
};

struct check {
    struct cli cli;
    struct check_options options;
    struct checked *of; /* [n] */
    size_t n;
    struct worker_pool *pool;
    size_t size; /* of what the runs leave */
};

/* ---- One run -------------------------------------------------------------------------------- */

struct check_work {
    const struct scenario *of;
    struct check_trial *trial;
    uint64_t seed;
};

static void run_scenario(void *ctx)
{
    const struct check_work *w = ctx;
    w->trial->rc = scenario_run(w->of, w->seed, w->trial->verdict, &w->trial->end);
    w->trial->made = true;
}

static void work_on_check(void *ctx, unsigned job)
{
    const struct check *c = ctx;
    size_t i = 0;
    for (; job >= c->of[i].scenario.runs; i++)
        job -= c->of[i].scenario.runs;
    struct check_trial *trial = (struct check_trial *)(void *)(c->of[i].trials + job * c->of[i].stride);
    struct check_work work = {&c->of[i].scenario, trial, c->of[i].scenario.seed + job};
    int rc = 0;
    if (trial_has_plugin(&work.of->e))
        rc = trial_apart(run_scenario, &work, &trial->made, trial->end.why, sizeof trial->end.why);
    else
        run_scenario(&work);
    if (rc < 0) {
        trial->rc = rc;
        trial->made = true;
    }
    atomic_fetch_add(&c->pool->done, 1);
}

/* ---- All of them ---------------------------------------------------------------------------- */

/* So many runs at least, or the share cannot be shown even if all of them hold. */
static int check_runs(const struct check *c, const struct scenario *of)
{
    if (of->share >= 1 || of->runs == 1 || check_share_least(of->runs, of->runs) >= of->share)
        return 0;
    unsigned least = of->runs;
    while (check_share_least(least, least) < of->share)
        least++;
    cli_error(
        &c->cli, APC_EINVAL,
        "%s: a share of %.6g cannot be shown with 95 %% confidence by %u runs, even if all of them hold: "
        "%u are needed",
        of->file, of->share, of->runs, least);
    return APC_EINVAL;
}

/* All of them before the first run. Returns an exit code. */
static int load_scenarios(struct check *c)
{
    struct apc_error why;
    int rc = EXIT_OK;
    c->of = calloc((size_t)c->cli.n_args, sizeof *c->of);
    if (!c->of)
        return cli_error(&c->cli, APC_ENOMEM, "out of memory");
    for (; c->n < (size_t)c->cli.n_args; c->n++) {
        struct scenario *of = &c->of[c->n].scenario;
        int loaded = scenario_load(of, c->cli.args[c->n], c->options.session, c->options.set.at,
                                   c->options.set.n, &why);
        if (loaded < 0) {
            cli_error(&c->cli, loaded, "%s", why.text);
            rc = EXIT_USAGE;
            continue;
        }
        of->seed = c->options.seeded ? c->options.seed : of->seed;
        of->runs = c->options.runs ? c->options.runs : c->options.seeded ? 1 : of->runs;
        if (check_runs(c, of) < 0)
            rc = EXIT_USAGE;
        if (of->session && (c->options.runs || c->options.seeded || c->options.set.n > 0))
            rc = cli_usage(&c->cli, "%s: a session is judged as it was: not with --runs, --seed or --set",
                           of->file);
        if (of->session && (loaded = checked_session_load(&c->of[c->n], &why)) < 0) {
            cli_error(&c->cli, loaded, "%s", why.text);
            rc = EXIT_USAGE;
        }
    }
    if (rc == EXIT_OK && c->options.report) {
        umask(077); /* the record of a plant is its owner's */
        const int made = folder_make(c->options.report, c->options.force, &why);
        if (made < 0) {
            cli_error(&c->cli, made, "%s", why.text);
            rc = EXIT_USAGE;
        }
    }
    return rc;
}

/* Room for what the runs leave, and the runs. */
static int run_scenarios(struct check *c, struct apc_error *why)
{
    void *results = NULL;
    unsigned jobs = 0;
    for (size_t i = 0; i < c->n; i++) {
        const struct scenario *of = &c->of[i].scenario;
        const size_t size = sizeof(struct check_trial) + of->n_expect * sizeof(struct check_verdict);
        c->of[i].stride = (size + CACHE_LINE - 1) / CACHE_LINE * CACHE_LINE;
        c->size += of->runs * c->of[i].stride;
        jobs += of->runs;
    }
    c->pool = worker_pool_create(c->size, &results);
    if (!c->pool)
        return apc_fail(why, APC_ENOMEM, "no memory for %u runs", jobs);
    for (size_t i = 0; i < c->n; i++) {
        c->of[i].trials = results;
        results = (char *)results + c->of[i].scenario.runs * c->of[i].stride;
    }
    c->pool->jobs = c->pool->all = jobs;
    c->pool->what = "runs";
    return worker_pool_run(c->pool, c->options.jobs, work_on_check, c, why);
}

/* Runs that ended for another reason than the plant's are told of by themselves. */
static bool any_broken(const struct check *c)
{
    bool any = false;
    for (size_t i = 0; i < c->n; i++)
        for (unsigned run = 0; run < c->of[i].scenario.runs; run++) {
            const struct check_trial *t = checked_trial(&c->of[i], run);
            if (t->made && t->rc < 0)
                cli_error(&c->cli, t->rc, "%s, seed %llu: %s", c->of[i].scenario.file,
                          (unsigned long long)c->of[i].scenario.seed + run, t->end.why);
            any = any || !t->made || t->rc < 0;
        }
    return any;
}

int command_check(int argc, char **argv)
{
    struct check c = {.n = 0};
    struct apc_error why;
    cli_parse(&c.cli, &spec, &c.options, argc, argv);
    const struct check_report report = {&c.cli, c.options.report, c.options.force};
    int code = c.options.format == CHECK_FORMAT_HTML && c.cli.n_args > 1
                   ? cli_usage(&c.cli, "--format html: a page shows one scenario: give one")
                   : load_scenarios(&c);
    if (code == EXIT_OK) {
        int rc = run_scenarios(&c, &why);
        if (rc < 0)
            code = cli_error(&c.cli, rc, "%s", why.text);
        for (size_t i = 0; i < c.n && code == EXIT_OK && c.pool; i++)
            if (c.of[i].session && (rc = checked_session_make(&c.of[i], c.options.jobs, &why)) < 0)
                code = cli_error(&c.cli, rc, "%s", why.text);
        for (size_t i = 0; i < c.n && code == EXIT_OK && c.pool; i++)
            if ((rc = checked_why(&c.of[i], &report, &why)) < 0)
                code = cli_error(&c.cli, rc, "%s", why.text);
        if (c.pool && (any_broken(&c) || checked_print(c.of, c.n, c.options.format) > 0))
            code = EXIT_ERROR;
    }
    worker_pool_destroy(c.pool, c.size);
    if (c.options.report)
        remove(c.options.report); /* fails, as it should, when there is more in it */
    for (size_t i = 0; i < c.n; i++) {
        checked_why_free(&c.of[i]);
        checked_session_free(&c.of[i]);
        scenario_free(&c.of[i].scenario);
    }
    free(c.of);
    return cli_done(&c.cli, code);
}

/* SPDX-License-Identifier: BSD-3-Clause */
/* apc replay: what a controller would have done in a recorded run, or over a season of records. */
#include "simulation/simulation.h"

#include <errno.h>
#include <float.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>

#include "apc/common/print.h"
#include "apc/common/setting.h"
#include "apc/folder/folder.h"
#include "closed_replay.h"
#include "common/storeuri.h"
#include "files/files.h"
#include "print_differs.h"
#include "replay_curves.h"
#include "worker_pool.h"

struct replay_options {
    const char *csv, *figure;
    bool force, json;
    unsigned jobs;    /* 0: one a CPU */
    double tolerance; /* < 0: none */
    bool virtually, closed;
    const char *since, *until, *controller;
    struct setting_list set;
    struct experiment_overrides overrides;
};

static void check_replay_options(void *input, const struct argp_state *state)
{
    const struct replay_options *o = input;
    if (o->virtually && (o->csv || o->overrides.law || o->set.n > 0 || o->tolerance >= 0 || o->since ||
                         o->until || o->controller || o->json || o->jobs))
        argp_error(state, "--virtual: cannot be combined with other options");
    if (o->closed && (o->virtually || o->csv || o->tolerance >= 0 || o->controller || o->jobs ||
                      (!o->overrides.law && o->set.n == 0)))
        argp_error(state, "--closed: goes with --law and --set, which say what is to be another, --since, "
                          "--until and --json");
    if (o->figure && (o->virtually || o->jobs))
        argp_error(state, "--figure: goes without --virtual and --jobs");
    if (o->csv && (o->jobs || o->json))
        argp_error(state, "--csv: goes without --jobs and --json");
}

#define AT(member) .to = offsetof(struct replay_options, member)
static const struct option_spec own_options[] = {
    {"law", 0, "NAME",
     "Control law instead of the run's: built in, ./file.so or ./file.py; its own tuning applies. Of several "
     "controllers: CONTROLLER=NAME",
     OPTION_TEXT, AT(overrides.law), .once = "only one law at a time"},
    {"set", 0, "PATH=VALUE",
     "Override a setting of the record, as controllers.base.v1.Kp=2; may be repeated; the experiment's own "
     "tuning applies, not the recorded one",
     OPTION_OWN, AT(set), .take = setting_add},
    {"since", 0, "TIME", "Only ticks from TIME on, UTC as 2026-01-31T12:00:00Z, or before now as 10m, 2h, 1d",
     OPTION_TEXT, AT(since)},
    {"until", 0, "TIME", "Only ticks before TIME", OPTION_TEXT, AT(until)},
    {"controller", 0, "NAME", "Only this controller", OPTION_TEXT, AT(controller)},
    {"jobs", 'j', "N", "Number of processes; default: one per CPU. The result does not depend on it",
     OPTION_COUNT, AT(jobs), .low = 1, .high = 1024, .must = "be 1 to 1024"},
    {"json", 0, NULL, "JSON on stdout", OPTION_FLAG, AT(json)},
    {"tolerance", 0, "U", "Exit code 1 if an output differs by more than U, in its unit", OPTION_NUMBER,
     AT(tolerance), .high = DBL_MAX, .must = "be a number, 0 or above"},
    {"csv", 0, "FILE", "Write time,loop,recorded,replayed to FILE; - is stdout", OPTION_TEXT, AT(csv)},
    {"virtual", 0, NULL, "Simulate the run again instead, and show the first tick that differs", OPTION_FLAG,
     AT(virtually)},
    {"closed", 0, NULL,
     "Simulate the closed loop with the plant's model, with --law and --set, and compare it with the record",
     OPTION_FLAG, AT(closed)},
    {"figure", 0, "NAME",
     "With one run or store: draw recorded and replayed outputs around the first difference, as NAME.svg and "
     "NAME.png; with --closed all signals",
     OPTION_TEXT, AT(figure)},
    {"force", 0, NULL, "Overwrite that file", OPTION_FLAG, AT(force)},
    {0},
};

static const struct cli_spec spec = {
    .args_doc = "[RUN|STORE]...",
    .doc = "Recalculate each controller of run folder RUN from the recorded inputs of its ticks, and report "
           "how its outputs differ from the record. Without --law the law of the run is used, and each tick "
           "must come out bit for bit; the first one that does not is shown, with the cause. With stores and "
           "with several runs, their ticks are replayed in parallel, across restarts and changes of tuning, "
           "mode, law and settings. The exit code is then 1 if a tick differs or none could be replayed, "
           "unless --law, --set or --tolerance say what else is wanted.",
    .takes = CLI_STORE,
    .max_args = -1,
    .options = own_options,
    .check = check_replay_options,
};

/* A run folder or a store. */
struct source {
    const char *name;
    bool folder;
    struct apc_store *store; /* NULL: it is not open in this process */
    struct season season;
    bool opened;
    struct differs differs; /* of the first tick that differs; time 0: none does, or it is not told */
};

struct replay_command {
    struct cli cli;
    struct replay_options options;
    struct replay replay; /* of one run folder, whole */
    FILE *csv, *talk;
    struct replay_curves curves; /* for --figure */
    struct source *source;       /* [n] of a season */
    size_t n;
};

static int fail_replay(const struct replay_command *c, int err, const struct apc_error *why)
{
    cli_error(&c->cli, err, "%s", why->text);
    return err;
}

static void put_replayed_output(void *ctx, double t, const char *loop, double recorded, double replayed)
{
    struct replay_command *c = ctx;
    char a[40], b[40];
    if (c->options.figure)
        replay_curves_keep(&c->curves, t, loop, recorded, replayed);
    if (!c->csv)
        return;
    apc_number_format(recorded, a, sizeof a);
    apc_number_format(replayed, b, sizeof b);
    fprintf(c->csv, "%.6f,", t);
    csv_put(c->csv, loop);
    fprintf(c->csv, ",%s,%s\n", a, b);
}

static void put_notice(void *ctx, double t, const char *text)
{
    const struct replay_command *c = ctx;
    fprintf(c->talk, "%10.3f s  %s\n", t, text);
}

/* Did all of each tick come out again? If not: which is the first that did not, and why. */
static bool print_same(const struct replay_command *c, const char *name, const struct replay_figures *f)
{
    fprintf(c->talk, "%s: %llu of %llu ticks the same bit for bit", name, (unsigned long long)f->same,
            (unsigned long long)f->judged);
    if (f->restarts)
        fprintf(c->talk, ", %llu of them after a restart", (unsigned long long)f->restarts);
    putc('\n', c->talk);
    if (f->first[0])
        fprintf(c->talk, "%s: the first that differs: %s\n", name, f->first);
    return !f->first[0];
}

static bool print_exactness(const struct replay_command *c)
{
    bool exact = true;
    for (size_t i = 0; i < c->replay.e.n_controllers; i++) {
        const struct replay_controller *of = &c->replay.controller[i];
        char since[APC_TIME_LEN];
        if (of->figures.begins)
            fprintf(c->talk,
                    "%s: ticks before %s are not on record: the run's store had no room for more (apc run "
                    "--history URI keeps all, shm:NAME?size=MIB more)\n",
                    of->of->name, apc_time_format(of->figures.begins, since));
        exact = print_same(c, of->of->name, &of->figures) && exact;
    }
    return exact;
}

static void put_output_difference(struct print_table *table, const char *name,
                                  const struct replay_difference *d)
{
    print_cell(table, PRINT_PLAIN, "%s", name);
    print_cell(table, PRINT_PLAIN, "%llu", (unsigned long long)d->ticks);
    print_cell(table, PRINT_PLAIN, "%llu", (unsigned long long)d->same);
    print_cell(table, PRINT_PLAIN, d->ticks ? "%.3g" : "-", d->sum / (double)d->ticks);
    print_cell(table, PRINT_PLAIN, "%.3g", d->worst);
    print_cell(table, PRINT_PLAIN, d->high > d->low ? "%.4f" : "-", 100 * d->worst / (d->high - d->low));
    print_cell(table, PRINT_PLAIN, "%.3f", d->at);
}

/* Of a season, or of the run. */
static int print_differences(const struct replay_command *c, const struct season *season)
{
    static const struct print_column columns[] = {{"", PRINT_LEFT},         {"ticks", PRINT_RIGHT},
                                                  {"equal", PRINT_RIGHT},   {"mean difference", PRINT_POINT},
                                                  {"largest", PRINT_POINT}, {"% of span", PRINT_POINT},
                                                  {"at s", PRINT_POINT}};
    struct print_table table;
    print_table_open(&table, columns, sizeof columns / sizeof *columns);
    for (size_t i = 0; season && i < season->n_loops; i++)
        put_output_difference(&table, season->loop[i].name, &season->loop[i].difference);
    for (size_t i = 0; !season && i < c->replay.loops.n; i++)
        put_output_difference(&table, c->replay.loops.at[i].name, &c->replay.difference[i]);
    return print_table_end(&table, c->talk, false, 0);
}

static bool is_folder(const char *name)
{
    struct stat at;
    return stat(name, &at) == 0 ? S_ISDIR(at.st_mode) : !strchr(name, ':');
}

static int make_sources(struct replay_command *c)
{
    c->n = c->cli.n_args > 0 ? (size_t)c->cli.n_args : 1;
    c->source = calloc(c->n, sizeof *c->source);
    if (!c->source)
        return fail_replay(c, APC_ENOMEM, &(struct apc_error){"out of memory"});
    for (size_t i = 0; i < c->n; i++) {
        c->source[i].name = c->cli.n_args > 0 ? c->cli.args[i] : c->cli.store;
        c->source[i].folder = c->cli.n_args > 0 && is_folder(c->cli.args[i]);
    }
    return 0;
}

static int open_csv(struct replay_command *c)
{
    const char *csv = c->options.csv;
    struct apc_error why;
    const int rc = csv ? folder_spare(csv, c->options.force, &why) : 0;
    if (rc < 0)
        return fail_replay(c, rc, &why);
    if (csv && !(c->csv = !strcmp(csv, "-") ? stdout : fopen(csv, "we"))) {
        cli_error(&c->cli, APC_ESYS, "%s: cannot be written: %s", csv, strerror(errno));
        return APC_ESYS;
    }
    if (c->csv)
        fputs("time,loop,recorded,replayed\n", c->csv);
    return 0;
}

static int close_csv(struct replay_command *c)
{
    if (!c->csv || c->csv == stdout || fclose(c->csv) == 0)
        return 0;
    cli_error(&c->cli, APC_ESYS, "%s: cannot be written: %s", c->options.csv, strerror(errno));
    return APC_ESYS;
}

static bool is_candidate(const struct replay_command *c)
{
    return c->options.overrides.law || c->options.set.n > 0;
}

/* Within what --tolerance says? */
static int judge_difference(const struct replay_command *c, const struct differs *first, const char *name,
                            const struct replay_difference *d)
{
    if (c->options.tolerance < 0 || d->worst <= c->options.tolerance)
        return 0;
    const bool told = first->n > 0 && strcmp(first->output, name) == 0;
    cli_error(&c->cli, APC_ESTATE, "%s differs by %g, more than %g%s%s", name, d->worst, c->options.tolerance,
              told ? ": at first by " : "", told ? first->cause[0].name : "");
    return APC_ESTATE;
}

static int open_source_store(const struct replay_command *c, struct source *s, struct apc_error *why)
{
    const struct apc_store_options options = {
        .size = sizeof options, .name = "apc", .timeout = c->cli.timeout};
    return s->folder ? replay_open_ticks(&s->store, s->name, why)
                     : store_open(&s->store, s->name, &options, why);
}

static void close_source(struct source *s)
{
    if (s->opened)
        season_close(&s->season);
    s->opened = false;
    apc_store_close(s->store);
    s->store = NULL;
}

/* ---- Why a tick differs ---------------------------------------------------------------------- */

/* The earliest of those that differ: of a loop or, where the law that ran is replayed, of a controller. */
struct earliest {
    const char *name;
    apc_ns time, since; /* time 0: none does */
};

static void look_at_earliest(struct earliest *e, const char *name, apc_ns time, apc_ns since)
{
    if (time && (!e->time || time < e->time))
        *e = (struct earliest){name, time, since};
}

static struct earliest earliest_of_folder(const struct replay_command *c)
{
    struct earliest e = {.time = 0};
    for (size_t i = 0; i < c->replay.loops.n && is_candidate(c); i++)
        look_at_earliest(&e, c->replay.loops.at[i].name, c->replay.difference[i].differs, 0);
    for (size_t i = 0; i < c->replay.e.n_controllers && !is_candidate(c); i++)
        look_at_earliest(&e, c->replay.controller[i].of->name, c->replay.controller[i].figures.differs, 0);
    return e;
}

/* Ticks of another law only where none of its own differs. */
static struct earliest earliest_of_season(const struct replay_command *c, const struct season *s)
{
    struct earliest e = {.time = 0}, other = {.time = 0};
    for (size_t i = 0; i < s->n_loops && is_candidate(c); i++)
        look_at_earliest(&e, s->loop[i].name, s->loop[i].difference.differs, s->loop[i].difference.since);
    for (size_t i = 0; i < s->n_controllers && !is_candidate(c); i++) {
        look_at_earliest(&e, s->controller[i].name, s->controller[i].figures.differs, 0);
        look_at_earliest(&other, s->controller[i].name, s->controller[i].figures.other, 0);
    }
    return e.time ? e : other;
}

/* Where it cannot be told, why not. */
static void explain_source(const struct replay_command *c, struct source *s, struct replay_range range,
                           struct earliest of)
{
    struct apc_error why;
    if (!of.time)
        return;
    int rc = open_source_store(c, s, &why);
    range.store = s->store;
    range.dir = s->folder ? s->name : NULL;
    if (rc == 0)
        rc = is_candidate(c) ? differs_of_candidate(&s->differs, &range, of.name, of.time, of.since, &why)
                             : differs_of_record(&s->differs, &range, of.name, of.time, &why);
    if (rc < 0)
        snprintf(s->differs.unknown, sizeof s->differs.unknown, "the cause is not known: %.250s", why.text);
    s->differs.time = of.time;
    apc_store_close(s->store);
    s->store = NULL;
}

/* What of the experiment, the law or the record it comes from. */
static int print_explained(const struct replay_command *c, const struct source *s)
{
    char time[APC_TIME_LEN] = "";
    if (!s->differs.time)
        return 0;
    if (is_candidate(c) && c->replay.controller)
        replay_time(&c->replay, s->differs.time, time);
    else if (is_candidate(c))
        apc_time_format(s->differs.time, time);
    return print_differs(&s->differs, time, c->talk);
}

/* After the run has been replayed: what came of it. */
static int judge_folder(const struct replay_command *c)
{
    const struct replay_range range = {.until = INT64_MAX, .overrides = &c->options.overrides};
    int rc = print_differences(c, NULL);
    if (rc < 0)
        return fail_replay(c, rc, &(struct apc_error){"out of memory"});
    if (!is_candidate(c))
        (void)print_exactness(c);
    explain_source(c, c->source, range, earliest_of_folder(c));
    if (print_explained(c, c->source) < 0)
        return fail_replay(c, APC_ENOMEM, &(struct apc_error){"out of memory"});
    for (size_t i = 0; i < c->replay.loops.n && rc == 0; i++)
        rc = judge_difference(c, &c->source->differs, c->replay.loops.at[i].name, &c->replay.difference[i]);
    return rc;
}

static int replay_folder(struct replay_command *c, const struct replay_watch *watch)
{
    struct apc_error why;
    int rc = replay_load(&c->replay, c->cli.args[0], &c->options.overrides, &why);
    if (rc < 0)
        return fail_replay(c, rc, &why);
    size_t n = 0;
    for (size_t i = 0; i < c->replay.e.n_controllers; i++)
        n += c->replay.controller[i].ticks.n;
    if (n == 0) {
        cli_error(&c->cli, APC_ENOTFOUND, "%s/" TICKS_FILE " holds no ticks", c->cli.args[0]);
        return APC_ENOTFOUND;
    }
    if (c->options.virtually) {
        if ((rc = replay_virtual(&c->replay)) < 0)
            return fail_replay(c, rc, &c->replay.why);
        return print_exactness(c) ? 0 : APC_ESTATE;
    }
    if ((rc = open_csv(c)) < 0)
        return rc;
    rc = replay_run(&c->replay, watch);
    const int closed = close_csv(c);
    return rc < 0 ? fail_replay(c, rc, &c->replay.why) : closed < 0 ? closed : judge_folder(c);
}

/* ---- A season ------------------------------------------------------------------------------- */

#define WINDOW (3600 * APC_NS_PER_S)
#define JOBS   1000 /* of a source, or a few more: each leaves what came of it in memory until the end */

/* Windows of one source. */
struct season_job {
    size_t source;
    apc_ns since, until;
};

/* What came of a job: figures of each controller, and behind them of each loop. */
struct season_result {
    bool done;
    int rc;
    struct apc_error why;
    struct season_controller controller[];
};

struct season_work {
    struct replay_command *c;
    const struct replay_watch *watch;
    struct season_job *job;
    size_t n;
    struct worker_pool *pool;
    char *results;
    size_t stride;
    struct source *own; /* [c->n] as open in this process */
};

static struct season_result *season_result_of(const struct season_work *w, size_t job)
{
    return (struct season_result *)(void *)(w->results + job * w->stride);
}

static struct season_loop *result_loops(struct season_result *result, const struct season *s)
{
    return (struct season_loop *)(void *)(result->controller + s->n_controllers);
}

/* One that cannot be opened is as if nobody had tried: the next job tries anew. */
static int open_season(const struct season_work *w, struct source *s, struct replay_range range,
                       struct apc_error *why)
{
    int rc = open_source_store(w->c, s, why);
    if (rc < 0)
        return rc;
    range.store = s->store;
    range.dir = s->folder ? s->name : NULL;
    s->opened = true;
    rc = season_open(&s->season, &range, w->watch, why);
    if (rc < 0)
        close_source(s);
    return rc;
}

static void clear_figures(struct season *s)
{
    for (size_t i = 0; i < s->n_controllers; i++)
        s->controller[i].figures = (struct replay_figures){.judged = 0};
    for (size_t i = 0; i < s->n_loops; i++)
        s->loop[i].difference = (struct replay_difference){.ticks = 0};
}

/* In one of the processes, each of which has stores of its own. */
static void work_on_windows(void *ctx, unsigned number)
{
    const struct season_work *w = ctx;
    const struct season_job *job = &w->job[number];
    struct season_result *result = season_result_of(w, number);
    struct source *own = &w->own[job->source];
    struct replay_range range = w->c->source[job->source].season.of;
    range.exact = true;
    result->rc = own->opened ? 0 : open_season(w, own, range, &result->why);
    struct season *s = &own->season;
    if (result->rc == 0)
        clear_figures(s);
    for (apc_ns since = job->since, until; since < job->until && result->rc == 0; since = until) {
        until = season_window(s, since);
        result->rc = season_replay(s, since, until, &result->why);
    }
    if (result->rc == 0) {
        memcpy(result->controller, s->controller, s->n_controllers * sizeof *s->controller);
        memcpy(result_loops(result, s), s->loop, s->n_loops * sizeof *s->loop);
    }
    result->done = true;
    atomic_fetch_add(&w->pool->done, 1);
}

/* Of as many windows each as leaves some JOBS of a source; they do not depend on the number of processes. */
static int plan_jobs(struct season_work *w)
{
    for (size_t i = 0; i < w->c->n; i++) {
        const struct season *s = &w->c->source[i].season;
        const apc_ns share = (s->of.until - s->of.since) / JOBS;
        const size_t size = sizeof(struct season_result) + s->n_controllers * sizeof *s->controller +
                            s->n_loops * sizeof *s->loop;
        w->stride = size > w->stride ? size : w->stride;
        for (apc_ns since = s->of.since, until; since < s->of.until; since = until) {
            for (until = season_window(s, since); until < s->of.until && until - since < share;)
                until = season_window(s, until);
            if (!apc_grow(&w->job, w->n + 1, sizeof *w->job))
                return APC_ENOMEM;
            w->job[w->n++] = (struct season_job){i, since, until};
        }
    }
    w->stride = (w->stride + CACHE_LINE - 1) / CACHE_LINE * CACHE_LINE;
    return 0;
}

static int do_season(struct season_work *w, struct apc_error *why)
{
    void *results = NULL;
    w->pool = worker_pool_create(w->n * w->stride, &results);
    w->own = calloc(w->c->n, sizeof *w->own);
    if (!w->pool || !w->own)
        return apc_fail(why, APC_ENOMEM, "out of memory");
    for (size_t i = 0; i < w->c->n; i++)
        w->own[i] = (struct source){.name = w->c->source[i].name, .folder = w->c->source[i].folder};
    w->results = results;
    w->pool->jobs = w->pool->all = (unsigned)w->n;
    w->pool->what = "parts";
    if (w->c->csv || w->c->options.figure)
        for (unsigned i = 0; i < w->n; i++)
            work_on_windows(w, i);
    else if (worker_pool_run(w->pool, w->c->options.jobs, work_on_windows, w, why) < 0)
        return APC_ESYS;
    for (size_t i = 0; i < w->n; i++) {
        struct season_result *result = season_result_of(w, i);
        struct season *s = &w->c->source[w->job[i].source].season;
        if (!result->done)
            return apc_fail(why, APC_ESTATE, "it was ended before all of it was replayed");
        if (result->rc < 0)
            return *why = result->why, result->rc;
        season_add(s, result->controller, result_loops(result, s));
    }
    return 0;
}

static void end_season(struct season_work *w)
{
    for (size_t i = 0; w->own && i < w->c->n; i++)
        close_source(&w->own[i]);
    free(w->own);
    free(w->job);
    worker_pool_destroy(w->pool, w->n * w->stride);
}

static void print_unreplayed(const struct replay_command *c, const char *name, const struct replay_figures *f)
{
    char time[APC_TIME_LEN];
    if (f->begins)
        fprintf(c->talk, "%s: the state before its tick at %s is not on record\n", name,
                apc_time_format(f->begins, time));
    if (f->lost)
        fprintf(c->talk, "%s: %llu ticks cannot be replayed: the record lacks rows. The first: %s\n", name,
                (unsigned long long)f->lost, f->lacks);
    if (f->others)
        fprintf(c->talk,
                "%s: %llu ticks are of another law, other settings or another model, and not replayed. The "
                "first is at %s\n",
                name, (unsigned long long)f->others, apc_time_format(f->other, time));
}

static void put_json(const struct replay_command *c, const struct source *source, struct text *t)
{
    const struct season *s = &source->season;
    json_add(t, "{source:%s, since:%.6jd, until:%.6jd, controllers:[", source->name, (intmax_t)s->of.since,
             (intmax_t)s->of.until);
    for (size_t i = 0; i < s->n_controllers && !is_candidate(c); i++) {
        const struct replay_figures *f = &s->controller[i].figures;
        json_add(t,
                 "{controller:%s, ticks:%ju, same:%ju, after_restart:%ju, lacking:%ju, other_law:%ju, "
                 "differs:{time:%.6jd, why:%-s}, lacks:{time:%.6jd, why:%-s}, other:%.6jd}",
                 s->controller[i].name, (uintmax_t)f->judged, (uintmax_t)f->same, (uintmax_t)f->restarts,
                 (uintmax_t)f->lost, (uintmax_t)f->others, (intmax_t)json_some(f->differs), f->first,
                 (intmax_t)json_some(f->loses), f->lacks, (intmax_t)json_some(f->other));
    }
    json_add(t, "], outputs:[");
    for (size_t i = 0; i < s->n_loops; i++) {
        const struct replay_difference *d = &s->loop[i].difference;
        json_add(t, "{output:%s, ticks:%ju, same:%ju, mean:%g, max:%g, span:%g, time:%g}", s->loop[i].name,
                 (uintmax_t)d->ticks, (uintmax_t)d->same, d->sum / (double)d->ticks, d->worst,
                 d->high - d->low, d->at);
    }
    json_add(t, "], differs:");
    put_differs_json(&source->differs, t);
    json_add(t, "}");
}

/* Is each output of a law that did not run the same? */
static bool has_same_outputs(const struct season *s)
{
    uint64_t ticks = 0, same = 0;
    for (size_t i = 0; i < s->n_loops; i++) {
        ticks += s->loop[i].difference.ticks;
        same += s->loop[i].difference.same;
    }
    return ticks > 0 && same == ticks;
}

/* Is each tick of it, as far as it could be replayed, the same? */
static bool is_exact(const struct season *s)
{
    bool exact = true;
    uint64_t same = 0;
    for (size_t i = 0; i < s->n_controllers; i++) {
        const struct replay_figures *f = &s->controller[i].figures;
        exact = exact && !f->first[0] && f->others == 0;
        same += f->same;
    }
    return exact && same > 0;
}

static int print_season(const struct replay_command *c, const struct source *source)
{
    const struct season *s = &source->season;
    if (c->n > 1)
        fprintf(c->talk, "%s%s\n", source == c->source ? "" : "\n", source->name);
    int rc = print_differences(c, s);
    for (size_t i = 0; i < s->n_controllers && !is_candidate(c); i++) {
        const struct replay_figures *f = &s->controller[i].figures;
        if (f->judged > 0)
            (void)print_same(c, s->controller[i].name, f);
        print_unreplayed(c, s->controller[i].name, f);
    }
    if (rc == 0)
        rc = print_explained(c, source);
    for (size_t v = 0; v < s->n; v++)
        if (!s->revision[v].usable)
            fprintf(c->talk, "as it was described once it cannot be replayed: %s\n", s->revision[v].why.text);
    return rc;
}

static int print_seasons(const struct replay_command *c)
{
    struct text json = {.at = NULL};
    bool same = true;
    int rc = 0;
    for (size_t i = 0; i < c->n; i++)
        same = same &&
               (is_candidate(c) ? has_same_outputs(&c->source[i].season) : is_exact(&c->source[i].season));
    json_add(&json, "{same:%i, sources:[", same);
    for (size_t i = 0; i < c->n && rc == 0; i++)
        if (c->options.json)
            put_json(c, &c->source[i], &json);
        else
            rc = print_season(c, &c->source[i]);
    json_add(&json, "]}");
    if (rc < 0 || json.failed)
        cli_error(&c->cli, rc = APC_ENOMEM, "out of memory");
    else if (c->options.json)
        printf("%.*s\n", (int)json.n, json.at);
    text_free(&json);
    for (size_t i = 0; i < c->n && rc == 0; i++)
        for (size_t k = 0; k < c->source[i].season.n_loops && rc == 0; k++)
            rc = judge_difference(c, &c->source[i].differs, c->source[i].season.loop[k].name,
                                  &c->source[i].season.loop[k].difference);
    return rc < 0 || same || is_candidate(c) || c->options.tolerance >= 0 ? rc : APC_ESTATE;
}

/* How far each goes, before it is parted. The stores are closed again: a process has its own. */
static int plan_season(struct season_work *w, const struct replay_range *range, struct apc_error *why)
{
    struct replay_command *c = w->c;
    for (size_t i = 0; i < c->n; i++) {
        struct source *s = &c->source[i];
        const int rc = open_season(w, s, *range, why);
        apc_store_close(s->store);
        s->store = NULL;
        if (rc < 0)
            return rc;
        if (s->season.of.since >= s->season.of.until)
            return apc_fail(why, APC_ENOTFOUND, "no ticks are on record%s",
                            c->options.since || c->options.until ? " in that time" : "");
    }
    return plan_jobs(w) < 0 ? apc_fail(why, APC_ENOMEM, "out of memory") : 0;
}

static void read_replay_range(const struct replay_command *c, struct replay_range *range)
{
    if (cli_time(&c->cli, "since", c->options.since, &range->since) != EXIT_OK ||
        cli_time(&c->cli, "until", c->options.until, &range->until) != EXIT_OK ||
        (c->options.since && range->since >= range->until &&
         cli_usage(&c->cli, "--since must be before --until") != EXIT_OK))
        exit(EXIT_USAGE);
}

static int replay_of_season(struct replay_command *c, const struct replay_watch *watch)
{
    struct season_work w = {.c = c, .watch = watch};
    struct replay_range range = {.until = INT64_MAX,
                                 .window = WINDOW,
                                 .controller = c->options.controller,
                                 .overrides = &c->options.overrides};
    struct apc_error why;
    read_replay_range(c, &range);
    int rc = open_csv(c);
    if (rc < 0)
        return rc;
    rc = plan_season(&w, &range, &why);
    if (rc == 0)
        rc = do_season(&w, &why);
    end_season(&w);
    const int closed = close_csv(c);
    if (rc < 0 || closed < 0)
        return rc < 0 ? fail_replay(c, rc, &why) : closed;
    for (size_t i = 0; i < c->n; i++)
        explain_source(c, &c->source[i], c->source[i].season.of, earliest_of_season(c, &c->source[i].season));
    return print_seasons(c);
}

static int replay_closed_source(struct replay_command *c, struct source *s, struct replay_range range,
                                struct text *json, struct apc_error *why)
{
    int rc = open_source_store(c, s, why);
    range.store = s->store;
    range.dir = s->folder ? s->name : NULL;
    if (rc == 0 && c->n > 1 && !json)
        printf("%s%s\n", s == c->source ? "" : "\n", s->name);
    return rc < 0 ? rc : closed_replay(s->name, &range, c->options.figure, json, why);
}

static int replay_closed(struct replay_command *c)
{
    struct replay_range range = {.until = INT64_MAX, .overrides = &c->options.overrides};
    struct apc_error why;
    struct text json = {.at = NULL};
    int rc = 0;
    read_replay_range(c, &range);
    for (size_t i = 0; i < c->options.set.n; i++)
        if (strncmp(c->options.set.at[i].path, "controller", strlen("controller")) != 0)
            exit(cli_usage(&c->cli,
                           "--closed: %s: only settings of controllers may be changed, as controller.Kp",
                           c->options.set.at[i].path));
    json_add(&json, "{runs:[");
    for (size_t i = 0; i < c->n && rc == 0; i++)
        rc = replay_closed_source(c, &c->source[i], range, c->options.json ? &json : NULL, &why);
    json_add(&json, "]}");
    if (rc == 0 && json.failed)
        rc = apc_fail(&why, APC_ENOMEM, "out of memory");
    if (rc == 0 && c->options.json)
        printf("%.*s\n", (int)json.n, json.at);
    text_free(&json);
    return rc < 0 ? fail_replay(c, rc, &why) : 0;
}

/* Not a run folder as a whole. */
static bool is_season(const struct replay_command *c)
{
    const struct replay_options *o = &c->options;
    return c->cli.n_args != 1 || !is_folder(c->cli.args[0]) || o->since || o->until || o->controller ||
           o->json || o->jobs;
}

int command_replay(int argc, char **argv)
{
    struct replay_command c = {.options = {.tolerance = -1}};
    const struct replay_watch watch = {.output = put_replayed_output, .notice = put_notice, .ctx = &c};
    const struct replay_watch outputs = {.output = put_replayed_output, .ctx = &c};
    cli_parse(&c.cli, &spec, &c.options, argc, argv);
    c.talk = c.options.csv && !strcmp(c.options.csv, "-") ? stderr : stdout;
    c.options.overrides.set = c.options.set.at;
    c.options.overrides.n_set = c.options.set.n;
    if (c.cli.n_args > 0 && c.cli.store_given)
        return cli_usage(&c.cli, "expected either runs and stores, %s, or --store", c.cli.args[0]);
    if (is_season(&c) && c.options.virtually)
        return cli_usage(&c.cli, "--virtual: of a run folder");
    if (c.options.figure && c.cli.n_args > 1)
        return cli_usage(&c.cli, "--figure: of one run or store");
    c.curves.whole = !is_season(&c);
    int rc = make_sources(&c);
    if (rc == 0)
        rc = c.options.closed ? replay_closed(&c)
             : is_season(&c)  ? replay_of_season(&c, &outputs)
                              : replay_folder(&c, &watch);
    if (c.options.figure && !c.options.closed && (rc == 0 || (rc == APC_ESTATE && c.curves.n > 0))) {
        struct apc_error why;
        const int drawn = replay_curves_draw(&c.curves, c.source->name, c.options.figure,
                                             c.options.json ? stderr : c.talk, &why);
        rc = drawn < 0 ? fail_replay(&c, drawn, &why) : rc;
    }
    replay_curves_free(&c.curves);
    replay_free(&c.replay);
    for (size_t i = 0; i < c.n; i++) {
        close_source(&c.source[i]);
        differs_free(&c.source[i].differs);
    }
    free(c.source);
    return cli_done(&c.cli, exit_code_of(rc));
}

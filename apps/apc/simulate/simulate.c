/* SPDX-License-Identifier: BSD-3-Clause */
/* apc simulate: an experiment in virtual time, once or over many seeds. */
#include <errno.h>
#include <signal.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#include <openssl/evp.h>

#include "apc/common/cli.h"
#include "apc/common/experiment_warnings.h"
#include "apc/common/print.h"
#include "apc/common/print_alarms.h"
#include "apc/common/print_figures.h"
#include "apc/common/setting.h"
#include "apc/folder/folder.h"
#include "apc/folder/simulation_export.h"
#include "apc/report/report.h"
#include "base/text.h"
#include "campaign.h"
#include "compare.h"
#include "sweep.h"
#include "whatif.h"

#define EVENTS 10 /* of a run that are told of */
#define ROWS   60 /* of figures */

struct simulate_options {
    double duration; /* s; 0: the file's */
    uint64_t seed;
    bool seeded, force;  /* seeded: --seed was given */
    unsigned runs, jobs; /* runs 0: one, and no campaign */
    const char *csv, *report, *net, *compare, *against, *figure;
    struct whatif from; /* dir "": none */
    bool json;
    struct experiment_overrides overrides;
    struct setting_list set;
    struct sweep sweep; /* n 0: none */
    char value[40];     /* that it is at */
};

static void take_from(void *from, char *arg, const struct argp_state *state)
{
    struct apc_error why;
    if (whatif_parse(from, arg, &why) < 0)
        argp_error(state, "--from %s", why.text);
}

static void take_sweep(void *sweep, char *arg, const struct argp_state *state)
{
    struct apc_error why;
    if (((const struct sweep *)sweep)->n)
        argp_error(state, "--sweep: only one number at a time");
    if (sweep_parse(arg, sweep, &why) < 0)
        argp_error(state, "--sweep %s", why.text);
}

static void check_simulate_options(void *input, const struct argp_state *state)
{
    const struct simulate_options *o = input;
    if (o->jobs && !o->runs && !o->sweep.n)
        argp_error(state, "--jobs: only a campaign has several; give --runs N as well");
    if (o->sweep.n && (o->report || o->compare || o->against))
        argp_error(state, "--sweep: has no single run or campaign to %s", o->report ? "report" : "compare");
    if (o->from.dir[0] &&
        (o->runs || o->sweep.n || o->compare || o->seeded || o->net || o->overrides.model || o->report))
        argp_error(state,
                   "--from: the run's seed, network and plant hold, and it is one future that is laid "
                   "over the run: not with %s",
                   o->runs      ? "--runs"
                   : o->sweep.n ? "--sweep"
                   : o->compare ? "--compare"
                   : o->seeded  ? "--seed"
                   : o->net     ? "--net"
                   : o->report  ? "--report, as no file says what a folder would hold: --csv FILE"
                                : "--plant");
    if (o->figure && !o->sweep.n && !o->compare && !o->from.dir[0])
        argp_error(state, "--figure: is of a sweep, or of --compare or --from; the figure of a run is in the "
                          "folder of --report");
    if (o->against && !o->runs)
        argp_error(state, "--against: compares a campaign with another one; give --runs N as well");
    if (o->json && o->csv && !strcmp(o->csv, "-"))
        argp_error(state, "--json and --csv -: both want stdout; give --csv a FILE");
    if (o->runs && (o->report || o->compare))
        argp_error(state, "--runs: a campaign has no single run to %s", o->report ? "report" : "compare");
}

#define AT(member) .to = offsetof(struct simulate_options, member)
static const struct option_spec own_options[] = {
    {"seed", 's', "N", "Seed of all random numbers, 0 to 2^64 - 1, instead of the file's", OPTION_WHOLE,
     AT(seed), .given = 1 + offsetof(struct simulate_options, seeded), .high = 0x1p64,
     .must = "be a whole number, 0 to 18446744073709551615"},
    {"duration", 'd', "SECONDS", "Simulated time, in s, instead of the file's duration", OPTION_NUMBER,
     AT(duration), .above = true, .high = YEAR, .must = "be seconds, above 0 up to 31622400"},
    {"csv", 0, "FILE", "Write the samples (with --runs: the figures of each run) to FILE; - is stdout",
     OPTION_TEXT, AT(csv)},
    {"report", 'o', "DIR", "Make the run folder DIR, with its figure", OPTION_TEXT, AT(report)},
    {"force", 0, NULL, "Overwrite that folder or file", OPTION_FLAG, AT(force)},
    {"net", 0, "SPEC",
     "Override the file's network: "
     "delay=normal(0.004,0.001),jitter=...,loss=0.01,duplication=...,reordering=...,bandwidth=1e6,outage=10-"
     "12; times in seconds, bandwidth in bit/s",
     OPTION_TEXT, AT(net)},
    {"compare", 0, "RUN", "Compare the simulation with the samples of run folder RUN", OPTION_TEXT,
     AT(compare)},
    {"from", 0, "RUN@TIME",
     "Continue from the state at TIME (s) in run folder RUN, or in a store, STORE@TIME (RFC 3339, or before "
     "now as -10m). Until TIME it is the run, then FILE, with another law, tuning, setpoint, disturbance or "
     "fault. The result is compared with the record",
     OPTION_OWN, AT(from), .take = take_from},
    {"set", 0, "PATH=VALUE",
     "Override a setting of the file, as controllers.base.v1.Kp=2 or plant.parameters.K=normal(10,1); may be "
     "repeated",
     OPTION_OWN, AT(set), .take = setting_add},
    {"sweep", 0, "PATH=FROM..TO:N",
     "Sweep a number over N evenly spaced values: a table of IAE, overshoot and control effort", OPTION_OWN,
     AT(sweep), .take = take_sweep},
    {"figure", 0, "NAME",
     "Draw the sweep, or the comparison of --compare or --from, as NAME.svg and NAME.png", OPTION_TEXT,
     AT(figure)},
    {"runs", 'n', "N", "A campaign over N seeds from --seed on, with a summary", OPTION_COUNT, AT(runs),
     .low = 1, .high = 1000000, .must = "be 1 to 1000000"},
    {"against", 0, "FILE", "Compare a campaign with another one, seed by seed: FILE is the --csv of that one",
     OPTION_TEXT, AT(against)},
    {"json", 0, NULL, "The figures as JSON on stdout, and all other output on stderr", OPTION_FLAG, AT(json)},
    {"jobs", 'j', "N", "Number of processes of a campaign; default: one per CPU", OPTION_COUNT, AT(jobs),
     .low = 1, .high = 1024, .must = "be 1 to 1024"},
    {"law", 0, "NAME",
     "Control law instead of the file's: built in, ./file.so or ./file.py; its own tuning applies. Of "
     "several controllers: CONTROLLER=NAME",
     OPTION_TEXT, AT(overrides.law), .once = "only one law at a time"},
    {"model", 0, "MODELFILE",
     "Model file that the controller computes with, instead of the file's model or operating point; the "
     "plant stays the same. Of several controllers: CONTROLLER=MODELFILE",
     OPTION_TEXT, AT(overrides.model_file),
     .once = "of one controller only; of others --set controllers.NAME.model=FILE"},
    {"plant", 0, "NAME", "Model instead of the file's: built in, or ./file.so; its own parameters apply",
     OPTION_TEXT, AT(overrides.model)},
    {0},
};

static const struct cli_spec spec = {
    .args_doc = "FILE",
    .doc = "Run the experiment FILE in virtual time, in one process, with the modules, laws and plants of "
           "`apc run`. A run folder instead of FILE: its experiment, with the settings that were in force "
           "there. Delay, loss and outages of the network are simulated as well. The same seed gives the "
           "same samples bit for bit.",
    .min_args = 1,
    .max_args = 1,
    .options = own_options,
    .check = check_simulate_options,
};

struct simulate {
    struct cli cli;
    struct simulate_options options;
    struct experiment e;
    struct simulation s;
    struct samples samples;
    struct samples written; /* by people, in the run of apc run --speed that is simulated again */
    char hash[65];          /* of the samples, in hex digits */
    FILE *talk;             /* where the summary goes: stdout, unless the samples go there */
};

static int refuse_simulation(const struct simulate *r, int rc, const struct apc_error *why)
{
    cli_error(&r->cli, rc, "%s", why->text);
    return rc;
}

/* Before the work, not after it: may what is asked for be written? */
static int check_outputs(const struct simulate *r)
{
    const char *path = r->options.csv;
    struct apc_error why;
    bool to_file = path && strcmp(path, "-") != 0;
    int rc = to_file ? folder_spare(path, r->options.force, &why) : 0;
    FILE *file = to_file && rc == 0 ? fopen(path, "ae") : NULL;
    if (file)
        fclose(file);
    else if (to_file && rc == 0)
        rc = apc_fail(&why, APC_ESYS, "%s: cannot be written: %s", path, strerror(errno));
    if (rc == 0 && r->options.report) {
        umask(077); /* the record of a plant is its owner's */
        rc = folder_create(r->options.report, &r->e, r->options.force, &why);
    }
    return rc < 0 ? refuse_simulation(r, rc, &why) : 0;
}

/* ---- The samples -------------------------------------------------------------------------- */

/* What is written goes into the hash and, where they were asked for, on to a file, as the run goes on: its
 * samples are never in memory as a whole, but where they are compared with others. */
struct sink {
    struct simulate *of;
    EVP_MD_CTX *digest;
    FILE *in;
    FILE *out;   /* NULL: nobody asked */
    int failed;  /* the errno of writing there */
    apc_ns took; /* to write, not to simulate */
};

static ssize_t pour(void *ctx, const char *text, size_t size)
{
    struct sink *sink = ctx;
    if (sink->out && !sink->failed && fwrite(text, 1, size, sink->out) != size)
        sink->failed = errno;
    return EVP_DigestUpdate(sink->digest, text, size) == 1 ? (ssize_t)size : 0;
}

static int open_sink(struct simulate *r, struct sink *sink)
{
    const char *path = r->options.csv;
    *sink = (struct sink){.of = r, .digest = EVP_MD_CTX_new()};
    sink->in = sink->digest && EVP_DigestInit_ex(sink->digest, EVP_sha256(), NULL) == 1
                   ? fopencookie(sink, "w", (cookie_io_functions_t){.write = pour})
                   : NULL;
    if (!sink->in) {
        EVP_MD_CTX_free(sink->digest);
        return cli_error(&r->cli, APC_ENOMEM, "out of memory"), APC_ENOMEM;
    }
    sink->out = path && !strcmp(path, "-") ? stdout : path ? fopen(path, "we") : NULL;
    sink->failed = path && !sink->out ? errno : 0;
    samples_write(&(struct samples){0}, SIMULATION_BEGIN, sink->in); /* the header */
    return 0;
}

static int put_simulated_samples(void *ctx, const struct samples *rows)
{
    struct sink *sink = ctx;
    const struct simulate_options *o = &sink->of->options;
    const apc_ns began = apc_clock_mono(NULL);
    samples_write_rows(rows, SIMULATION_BEGIN, sink->in);
    const int rc = o->compare || o->from.dir[0] ? samples_append(&sink->of->samples, rows) : 0;
    sink->took += apc_clock_mono(NULL) - began;
    return rc;
}

static void print_hash(struct simulate *r, EVP_MD_CTX *digest)
{
    unsigned char hash[EVP_MAX_MD_SIZE];
    unsigned length = 0;
    if (EVP_DigestFinal_ex(digest, hash, &length) != 1)
        return;
    for (size_t i = 0; i < length && 2 * i + 2 < sizeof r->hash; i++)
        snprintf(r->hash + 2 * i, 3, "%02x", hash[i]);
    fprintf(r->talk, "sha256:  %s\n", r->hash);
}

static int close_sink(struct simulate *r, struct sink *sink)
{
    const char *path = r->options.csv;
    if (fclose(sink->in) == 0)
        print_hash(r, sink->digest);
    EVP_MD_CTX_free(sink->digest);
    if (sink->out && (sink->out == stdout ? fflush(stdout) : fclose(sink->out)) != 0 && !sink->failed)
        sink->failed = errno;
    if (sink->failed)
        cli_error(&r->cli, APC_ESYS, "%s: cannot be written: %s", path, strerror(sink->failed));
    return sink->failed ? APC_ESYS : 0;
}

/* ---- One run ------------------------------------------------------------------------------ */

static void print_speed(const struct simulate *r, apc_ns took)
{
    double t = r->s.ended, wall = apc_ns_to_s(took);
    fprintf(r->talk, "%s: %s\n%.10g s in %.3g ms: %.3g times as fast as real time; %lld events, seed %llu\n",
            r->e.name, r->e.title, t, 1e3 * wall, t / wall, (long long)r->s.handled,
            (unsigned long long)r->options.seed);
}

/* What was drawn for this seed. */
static void print_parameters(const struct simulate *r)
{
    const struct apc_model *m = r->e.plant.model;
    double *p = calloc(m->np + 1, sizeof *p);
    if (p && experiment_draw(&r->e, r->options.seed, p, NULL) == 0)
        for (size_t i = 0; i < m->np; i++)
            if (r->e.plant.spread[i].kind)
                fprintf(r->talk, "plant: %s = %.6g in this run\n", m->param[i].name, p[i]);
    free(p);
}

static void print_simulated_controller(const struct simulate *r, const struct simulated *c)
{
    const uint64_t failures = simulated_failures(c);
    if (c->held > 0)
        fprintf(r->talk, "%s: output held or at its fault value at %llu tick%s\n", c->of->name,
                (unsigned long long)c->held, PLURAL(c->held));
    if (failures > 0)
        fprintf(r->talk, "%s: law %s gave no usable output at %llu tick%s\n", c->of->name, c->of->law->name,
                (unsigned long long)failures, PLURAL(failures));
}

static void print_tasks(const struct simulate *r)
{
    struct apc_inproc_stats link = {.size = sizeof link};
    struct apc_timing timing = {.size = sizeof timing};
    for (size_t i = 0; i < r->s.n_tasks; i++) {
        apc_task_timing(r->s.task[i].task, &timing);
        if (timing.missed > 0)
            fprintf(r->talk, "%s: %llu of %llu ticks missed\n", r->s.task[i].name,
                    (unsigned long long)timing.missed, (unsigned long long)(timing.missed + timing.ticks));
    }
    apc_inproc_stats(r->s.exchange, &link);
    if (link.frames.lost + link.frames.duplicated + link.frames.reordered + link.timeouts > 0)
        fprintf(r->talk,
                "network: %llu frames, %llu lost, %llu duplicated, %llu reordered; %llu of %llu exchanges in "
                "vain\n",
                (unsigned long long)link.frames.sent, (unsigned long long)link.frames.lost,
                (unsigned long long)link.frames.duplicated, (unsigned long long)link.frames.reordered,
                (unsigned long long)link.timeouts, (unsigned long long)link.exchanges);
    for (size_t i = 0; i < r->e.n_controllers; i++)
        print_simulated_controller(r, &r->s.controller[i]);
}

struct listing {
    FILE *out;
    size_t n;
};

/* What was out of the ordinary, the first few. */
static int print_event(void *ctx, const struct apc_event *e)
{
    struct listing *l = ctx;
    if (e->severity != APC_EVENT_INFO && l->n++ < EVENTS)
        fprintf(l->out, "%10.3f s  %s: %s\n", apc_ns_to_s(e->time - SIMULATION_BEGIN), e->source, e->text);
    return 0;
}

static void print_events(const struct simulate *r)
{
    struct listing l = {.out = r->talk};
    apc_store_events(r->s.store, NULL, print_event, &l);
    if (l.n > EVENTS)
        fprintf(r->talk, "... and %zu more\n", l.n - EVENTS);
}

static void print_json_parameters(const struct simulate *r, struct text *t)
{
    const struct apc_model *m = r->e.plant.model;
    double *p = calloc(m->np + 1, sizeof *p);
    json_add(t, "parameters:{");
    if (p && experiment_draw(&r->e, r->options.seed, p, NULL) == 0)
        for (size_t i = 0; i < m->np; i++)
            json_add(t, "%s:%g", m->param[i].name, p[i]);
    json_add(t, "}");
    free(p);
}

static void print_simulation_json(const struct simulate *r, const struct figures *figures,
                                  const struct alarm_figures *alarms)
{
    struct apc_inproc_stats link = {.size = sizeof link};
    struct apc_timing timing = {.size = sizeof timing};
    struct text t = {.out = stdout};
    json_add(&t, "{experiment:%s, title:%s, seed:%ju, sha256:%s, missed_ticks:{", r->e.name, r->e.title,
             (uintmax_t)r->options.seed, r->hash);
    for (size_t i = 0; i < r->s.n_tasks; i++) {
        apc_task_timing(r->s.task[i].task, &timing);
        json_add(&t, "%s:%ju", r->s.task[i].name, timing.missed);
    }
    apc_inproc_stats(r->s.exchange, &link);
    json_add(&t,
             "}, network:{frames:%ju, lost:%ju, duplicated:%ju, reordered:%ju, exchanges:%ju, failed:%ju, "
             "in_vain:%ju}",
             link.frames.sent, link.frames.lost, link.frames.duplicated, link.frames.reordered,
             link.exchanges, link.timeouts,
             link.timeouts); /* in_vain is the name before: for one more version */
    json_add(&t, "held_ticks:%ju, law_failures:%ju", simulation_held(&r->s), simulation_failures(&r->s));
    print_json_parameters(r, &t);
    figures_members(figures, &r->s.trajectory, &r->e, &t);
    if (r->e.n_alarms > 0)
        alarms_member_json(alarms, &r->e, SIMULATION_BEGIN, &t);
    json_add(&t, "}\n");
}

static int leave_simulation_report(const struct simulate *r)
{
    struct apc_error why;
    int rc = simulation_export(&r->s, r->options.report, "apc simulate", 0, &why);
    if (rc == 0 && r->written.n > 0)
        rc = folder_put_written(r->options.report, &r->s.written, SIMULATION_BEGIN, &why);
    if (rc < 0)
        return refuse_simulation(r, rc, &why);
    rc = report_leave(&r->cli, r->options.report, &r->e, r->e.title, NULL, &why);
    if (rc < 0)
        return refuse_simulation(r, rc, &why);
    if (rc > 0)
        fprintf(r->talk, "report:  %s/report.png, report.svg\n", r->options.report);
    return 0;
}

/* What was operated in the run whose folder is simulated is no part of the experiment. */
static void tell_operation(const struct simulate *r)
{
    const unsigned long long n = folder_operated(&r->e, false);
    const size_t written = r->written.n + r->options.from.written.n;

    if (written > 0)
        fprintf(r->talk, "the operators' writes of that run are repeated at the same ticks: %zu values\n",
                written);
    else if (n > 0)
        fprintf(r->talk,
                "in that run an operator changed modes, tuning or outputs %llu time%s: a simulation does "
                "not, apc "
                "replay does\n",
                n, PLURAL(n));
}

/* The runs of a campaign or a sweep are of the experiment alone. */
static void tell_left_out(const struct simulate *r)
{
    struct samples written;
    struct apc_error why;
    if (simulation_written(&r->e, &written, &why) > 0 && written.n > 0)
        fprintf(r->talk,
                "the operators' writes of that run, %zu value%s, are not repeated in these: without --runs "
                "and --sweep they are\n",
                written.n, PLURAL(written.n));
    else
        tell_operation(r);
    samples_free(&written);
}

static int make_alarm_figures(const struct simulate *r, struct alarm_figures *alarms)
{
    struct alarm_journal journal;
    apc_ns ended = 0;
    int rc = alarm_journal_load(&journal, r->s.store, r->e.n_alarms, NULL);
    *alarms = (struct alarm_figures){0};
    (void)apc_ns_from_s(r->s.ended, &ended);
    if (rc == 0)
        rc = alarm_figures_make(alarms, &journal, &r->e, SIMULATION_BEGIN, SIMULATION_BEGIN + ended);
    alarm_journal_free(&journal);
    return rc;
}

/* Ramps that people asked for are events of the figures. */
static int add_ramps(struct simulate *r)
{
    const struct apc_range all = {0};
    struct samples operation = {0};
    const int rc = r->written.n > 0 ? samples_collect_operation(&operation, r->s.store, &r->e, &all) : 0;
    if (rc == 0)
        trajectory_add_ramps(&r->s.trajectory, &operation, SIMULATION_BEGIN);
    samples_free(&operation);
    return rc < 0 || r->s.trajectory.failed ? APC_ENOMEM : 0;
}

static int put_simulation_figures(struct simulate *r)
{
    struct figures figures = {0};
    struct alarm_figures alarms;
    int rc = add_ramps(r);
    if (rc == 0)
        rc = figures_make(&figures, &r->s.trajectory, &r->e);
    const int made = make_alarm_figures(r, &alarms);
    rc = rc < 0 ? rc : made;
    if (rc == 0 && r->options.json)
        print_simulation_json(r, &figures, &alarms);
    else if (rc == 0)
        rc = figures_print(&figures, &r->s.trajectory, &r->e, ROWS, r->talk);
    if (rc == 0 && !r->options.json && r->e.n_alarms > 0)
        rc = alarms_print(&alarms, &r->e, SIMULATION_BEGIN, r->talk);
    alarm_figures_free(&alarms);
    figures_free(&figures);
    if (rc < 0)
        cli_error(&r->cli, rc, "out of memory");
    return rc;
}

static int compare_with_run(struct simulate *r)
{
    const struct whatif *from = &r->options.from;
    struct apc_error why;
    const struct compare c = {.simulated = &r->samples,
                              .unchanged = from->unchanged.n > 0 ? &from->unchanged : NULL,
                              .from = from->at,
                              .dir = r->options.compare ? r->options.compare : from->dir,
                              .figure = r->options.figure};
    int rc = compare_run(&c, &r->e, r->talk, &why);
    return rc < 0 ? refuse_simulation(r, rc, &why) : 0;
}

static void keep_first_code(int *rc, int next)
{
    if (*rc == 0)
        *rc = next;
}

static struct simulation *running;

static void on_simulate_signal(int number)
{
    (void)number;
    simulation_interrupt(running);
}

/* The first one ends the run and keeps what there is, the second ends the process, also when a law does not
 * return. */
static void catch_simulate_signals(void)
{
    struct sigaction action = {.sa_handler = on_simulate_signal, .sa_flags = (int)SA_RESETHAND};
    sigemptyset(&action.sa_mask);
    sigaction(SIGINT, &action, NULL);
    sigaction(SIGTERM, &action, NULL);
}

/* The run folder is made of the store, which keeps all. */
static int run_for_report(struct simulate *r, struct sink *sink)
{
    struct samples all = {0};
    const int ended = simulation_run(&r->s, r->e.duration);
    int rc = samples_collect(&all, r->s.store, &r->e, NULL);
    if (rc < 0)
        apc_fail(&r->s.why, rc, "%s", rc == APC_ENOMEM ? apc_err_text(rc) : apc_store_error(r->s.store));
    else
        rc = put_simulated_samples(sink, &all);
    samples_free(&all);
    return ended < 0 ? ended : rc;
}

/* Of the run of apc run --speed whose folder it is what people did. */
static int create_simulation(struct simulate *r, struct apc_error *why)
{
    int rc = simulation_written(&r->e, &r->written, why);
    if (rc >= 0)
        rc = simulation_create(&r->s, &r->e, r->options.seed, why);
    if (rc == 0 && (rc = simulation_repeat_writes(&r->s, &r->written)) < 0)
        apc_fail(why, rc, "out of memory");
    return rc;
}

static int simulate_once(struct simulate *r)
{
    struct apc_error why;
    apc_ns began = apc_clock_mono(NULL);
    int rc = 0;
    const bool from = r->options.from.dir[0];
    if (from && (rc = whatif_load(&r->options.from, &r->e, &why)) < 0)
        return refuse_simulation(r, rc, &why);
    r->options.seed = from ? r->options.from.was.seed : r->options.seed;
    running = &r->s;
    catch_simulate_signals();
    rc = from ? whatif_begin(&r->options.from, &r->s, &r->e, &why) : create_simulation(r, &why);
    if (rc < 0)
        return refuse_simulation(r, rc, &why);
    struct sink sink;
    if ((rc = open_sink(r, &sink)) < 0)
        return rc;
    const int ended = r->options.report
                          ? run_for_report(r, &sink)
                          : simulation_stream(&r->s, r->e.duration, put_simulated_samples, &sink);
    print_speed(r, apc_clock_mono(NULL) - began - sink.took);
    if (r->s.interrupted)
        fprintf(r->talk, "ended by a signal at t = %.10g s: these are the results until then\n", r->s.ended);
    tell_operation(r);
    print_parameters(r);
    print_tasks(r);
    print_events(r);
    /* Each of them, also when one before it failed: the run may have been long. */
    rc = close_sink(r, &sink);
    keep_first_code(&rc, put_simulation_figures(r));
    if (from && ended == 0 && rc == 0 && (rc = whatif_judge(&r->options.from, r->talk, &why)) < 0)
        refuse_simulation(r, rc, &why);
    if (r->options.compare || from)
        keep_first_code(&rc, compare_with_run(r));
    if (r->options.report)
        keep_first_code(&rc, leave_simulation_report(r));
    if (ended < 0)
        cli_error(&r->cli, ended, "%s", r->s.why.text);
    if (ended < 0)
        return ended;
    return rc == 0 && r->s.interrupted ? APC_ESTATE : rc;
}

/* Over what the file says. */
static int override(const struct simulate *r, struct experiment *e)
{
    const struct simulate_options *o = &r->options;
    struct apc_error why;
    int rc = o->net ? models_network(&e->models, o->net, &why) : 0;
    if (rc < 0) {
        cli_error(&r->cli, rc, "--net: %s", why.text);
        return rc;
    }
    if (o->net) {
        size_t n = strlen(e->net);
        if (n + strlen(o->net) + 2 > sizeof e->net)
            return cli_error(&r->cli, APC_EINVAL, "--net: is too long"), APC_EINVAL;
        snprintf(e->net + n, sizeof e->net - n, "%s%s", n ? "," : "", o->net);
    }
    if (o->duration > 0)
        e->duration = o->duration;
    if (!(e->duration > 0)) {
        cli_error(&r->cli, APC_EINVAL, "%s has no duration: give --duration SECONDS", r->cli.args[0]);
        return APC_EINVAL;
    }
    if (o->seeded)
        e->seed = o->seed;
    return 0;
}

static int sweep(struct simulate *r, const struct campaign_options *campaign)
{
    struct simulate_options *o = &r->options;
    struct experiment *e = calloc(o->sweep.n, sizeof *e);
    struct apc_error why;
    double now;
    int rc =
        e ? experiment_value(&r->e, o->sweep.path, &now, &why) : apc_fail(&why, APC_ENOMEM, "out of memory");
    if (rc < 0)
        refuse_simulation(r, rc, &why);
    o->set.at[o->set.n++] = (struct experiment_setting){o->sweep.path, o->value};
    o->overrides.set = o->set.at;
    o->overrides.n_set = o->set.n;
    for (unsigned i = 0; i < o->sweep.n && rc == 0; i++) {
        sweep_value(&o->sweep, i, o->value);
        rc = experiment_load(&e[i], r->cli.args[0], EXPERIMENT_MODEL | EXPERIMENT_LAW, &o->overrides, &why);
        if (rc < 0)
            refuse_simulation(r, rc, &why);
        else
            rc = override(r, &e[i]);
    }
    if (rc == 0 && (rc = sweep_run(&o->sweep, e, now, campaign, o->figure, &why)) < 0)
        refuse_simulation(r, rc, &why);
    for (unsigned i = 0; e && i < o->sweep.n; i++)
        experiment_free(&e[i]);
    free(e);
    return rc;
}

static int simulate(struct simulate *r)
{
    struct apc_error why;
    r->options.overrides.set = r->options.set.at;
    r->options.overrides.n_set = r->options.set.n;
    int rc = experiment_load(&r->e, r->cli.args[0], EXPERIMENT_MODEL | EXPERIMENT_LAW, &r->options.overrides,
                             &why);
    if (rc < 0)
        return refuse_simulation(r, rc, &why);
    warn(&r->cli, &r->e);
    if ((rc = override(r, &r->e)) < 0)
        return rc;
    r->options.seed = r->e.seed;
    if ((rc = check_outputs(r)) < 0)
        return rc;
    const bool several = r->options.runs > 0;
    if (!several && !r->options.sweep.n)
        return simulate_once(r);
    tell_left_out(r);
    if (several && r->options.runs - 1 > UINT64_MAX - r->options.seed) {
        cli_error(&r->cli, APC_ERANGE, "--runs %u: so many seeds from %llu on go beyond 18446744073709551615",
                  r->options.runs, (unsigned long long)r->options.seed);
        return APC_ERANGE;
    }
    const struct campaign_options campaign = {.seed = r->options.seed,
                                              .runs = several ? r->options.runs : 1,
                                              .jobs = r->options.jobs,
                                              .csv = r->options.csv,
                                              .against = r->options.against,
                                              .json = r->options.json,
                                              .talk = r->talk};
    if (r->options.sweep.n)
        return sweep(r, &campaign);
    rc = campaign_run(&r->e, &campaign, &why);
    return rc < 0 ? refuse_simulation(r, rc, &why) : rc;
}

int command_simulate(int argc, char **argv)
{
    struct simulate r = {.options = {.seed = 0}};
    cli_parse(&r.cli, &spec, &r.options, argc, argv);
    r.talk = r.options.json || (r.options.csv && !strcmp(r.options.csv, "-")) ? stderr : stdout;
    int rc = simulate(&r);
    simulation_destroy(&r.s);
    whatif_free(&r.options.from);
    samples_free(&r.samples);
    samples_free(&r.written);
    experiment_free(&r.e);
    return cli_done(&r.cli, exit_code_of(rc));
}

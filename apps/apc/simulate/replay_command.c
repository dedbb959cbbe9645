/* SPDX-License-Identifier: BSD-3-Clause */
/* apc replay: what a controller would have done in a recorded run, or over the record of a store. */
#include "simulation/simulation.h"

#include <errno.h>
#include <float.h>
#include <stdlib.h>
#include <string.h>

#include "apc/common/print.h"
#include "apc/common/setting.h"
#include "apc/folder/folder.h"
#include "files/files.h"

struct replay_options {
    const char *csv;
    bool force;
    double tolerance; /* < 0: none */
    bool virtually;
    const char *since, *until, *controller;
    struct setting_list set;
    struct experiment_overrides overrides;
};

static void check_replay_options(void *input, const struct argp_state *state)
{
    const struct replay_options *o = input;
    if (o->virtually && (o->csv || o->overrides.law || o->set.n > 0 || o->tolerance >= 0))
        argp_error(state, "--virtual: goes with no other option");
}

#define AT(member) .to = offsetof(struct replay_options, member)
static const struct option_spec own_options[] = {
    {"law", 0, "NAME",
     "Control law instead of the run's: built in, ./file.so or ./file.py; its own tuning applies. Of several "
     "controllers: CONTROLLER=NAME",
     OPTION_TEXT, AT(overrides.law), .once = "only one law at a time"},
    {"set", 0, "PATH=VALUE",
     "A setting other than the record's, as controllers.base.v1.Kp=2, any number of times; the experiment's "
     "own "
     "tuning "
     "applies, not the recorded one",
     OPTION_OWN, AT(set), .take = setting_add},
    {"since", 0, "TIME",
     "Of a store: ticks from then on, UTC as 2026-01-31T12:00:00Z, or before now as 10m, 2h, 1d", OPTION_TEXT,
     AT(since)},
    {"until", 0, "TIME", "Of a store: ticks before then; the experiment is that of then", OPTION_TEXT,
     AT(until)},
    {"controller", 0, "NAME", "Of a store: this controller alone", OPTION_TEXT, AT(controller)},
    {"tolerance", 0, "U", "End with code 1 when an output differs by more", OPTION_NUMBER, AT(tolerance),
     .high = DBL_MAX, .must = "be a number, 0 or above"},
    {"csv", 0, "FILE", "Write time,loop,recorded,replayed there; - is stdout", OPTION_TEXT, AT(csv)},
    {"virtual", 0, NULL, "Simulate the run again instead, and name the first tick that differs", OPTION_FLAG,
     AT(virtually)},
    {"force", 0, NULL, "Write over what is in that file", OPTION_FLAG, AT(force)},
    {0},
};

static const struct cli_spec spec = {
    .args_doc = "[RUN]",
    .doc =
        "Repeat each controller of run folder RUN from what its ticks were made from, and report how what it "
        "does differs from what was recorded. Without --law it is the law that ran: then all of each tick "
        "has "
        "to come out again, bit for bit; the first tick that does not is named, and why. Without RUN, of a "
        "store: its ticks over restarts and changes of tuning and mode; without --law, --set and --tolerance "
        "the code is 1 unless all came out.",
    .takes = CLI_STORE,
    .max_args = 1,
    .options = own_options,
    .check = check_replay_options,
};

struct replay_command {
    struct cli cli;
    struct replay_options options;
    struct replay replay;
    struct apc_store *store; /* NULL: of a run folder */
    FILE *csv, *talk;
};

static int fail_replay(const struct replay_command *c, int err, const struct apc_error *why)
{
    cli_error(&c->cli, err, "%s", why->text);
    return err;
}

static void put_replayed_output(void *ctx, double t, const char *loop, double recorded, double replayed)
{
    const struct replay_command *c = ctx;
    char a[40], b[40];
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
static bool print_exactness(const struct replay_command *c)
{
    bool exact = true;
    for (size_t i = 0; i < c->replay.e.n_controllers; i++) {
        const struct replay_controller *of = &c->replay.controller[i];
        char since[APC_TIME_LEN];
        if (c->store && of->judged + of->others == 0)
            continue;
        if (of->begins && c->store)
            fprintf(c->talk, "%s: what its tick at %s went on from is not on record\n", of->of->name,
                    apc_time_format(of->begins, since));
        else if (of->begins)
            fprintf(c->talk,
                    "%s: ticks before %s are not on record: the run's store had no room for more (apc run "
                    "--history URI keeps all, shm:NAME?size=MIB more)\n",
                    of->of->name, apc_time_format(of->begins, since));
        fprintf(c->talk, "%s: %llu of %llu ticks the same bit for bit%s", of->of->name,
                (unsigned long long)of->same, (unsigned long long)of->judged, of->restarts ? ", " : "\n");
        if (of->restarts)
            fprintf(c->talk, "%llu of them after a restart\n", (unsigned long long)of->restarts);
        if (of->first[0])
            fprintf(c->talk, "%s: the first that differs: %s\n", of->of->name, of->first);
        if (of->others)
            fprintf(c->talk,
                    "%s: %llu ticks are of another law, other settings or another model, and not replayed\n",
                    of->of->name, (unsigned long long)of->others);
        exact = exact && !of->first[0] && of->others == 0;
    }
    return exact;
}

static uint64_t ticks_of(const struct replay_command *c)
{
    uint64_t n = 0;
    for (size_t i = 0; i < c->replay.e.n_controllers; i++)
        n += c->store ? c->replay.controller[i].judged + c->replay.controller[i].others
                      : c->replay.controller[i].ticks.n;
    return n;
}

static int print_differences(const struct replay_command *c)
{
    static const struct print_column columns[] = {{"", PRINT_LEFT},          {"ticks", PRINT_RIGHT},
                                                  {"the same", PRINT_RIGHT}, {"mean apart", PRINT_POINT},
                                                  {"at most", PRINT_POINT},  {"% of span", PRINT_POINT},
                                                  {"at s", PRINT_POINT}};
    struct print_table table;
    print_table_open(&table, columns, sizeof columns / sizeof *columns);
    for (size_t i = 0; i < c->replay.loops.n; i++) {
        const struct replay_difference *d = &c->replay.difference[i];
        print_cell(&table, PRINT_PLAIN, "%s", c->replay.loops.at[i].name);
        print_cell(&table, PRINT_PLAIN, "%llu", (unsigned long long)d->ticks);
        print_cell(&table, PRINT_PLAIN, "%llu", (unsigned long long)d->same);
        print_cell(&table, PRINT_PLAIN, d->ticks ? "%.3g" : "-", d->sum / (double)d->ticks);
        print_cell(&table, PRINT_PLAIN, "%.3g", d->worst);
        print_cell(&table, PRINT_PLAIN, d->high > d->low ? "%.4f" : "-", 100 * d->worst / (d->high - d->low));
        print_cell(&table, PRINT_PLAIN, "%.3f", d->at);
    }
    return print_table_end(&table, c->talk, false, 0);
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

/* After it has run: what came of it. */
static int judge_replay(struct replay_command *c)
{
    const bool other = c->options.overrides.law || c->options.set.n > 0;
    int rc = print_differences(c);
    if (rc < 0) {
        cli_error(&c->cli, rc, "out of memory");
        return rc;
    }
    const bool exact = other || print_exactness(c);
    for (size_t i = 0; i < c->replay.loops.n && c->options.tolerance >= 0; i++)
        if (!(c->replay.difference[i].worst <= c->options.tolerance)) {
            cli_error(&c->cli, APC_ESTATE, "%s differs by %g, more than %g", c->replay.loops.at[i].name,
                      c->replay.difference[i].worst, c->options.tolerance);
            return APC_ESTATE;
        }
    return exact || !c->store || c->options.tolerance >= 0 ? 0 : APC_ESTATE;
}

static int replay_folder(struct replay_command *c, const struct replay_watch *watch)
{
    struct apc_error why;
    int rc = replay_load(&c->replay, c->cli.args[0], &c->options.overrides, &why);
    if (rc < 0)
        return fail_replay(c, rc, &why);
    if (ticks_of(c) == 0) {
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
    return rc < 0 ? fail_replay(c, rc, &c->replay.why) : closed < 0 ? closed : judge_replay(c);
}

#define WINDOW (3600 * APC_NS_PER_S)

static int take_first_tick(void *ctx, const struct apc_vector *tick)
{
    *(apc_ns *)ctx = tick->time;
    return 1;
}

/* Where its record begins: of the ticks that there are. */
static int find_first_tick(struct replay_command *c, apc_ns *first)
{
    struct known_plant plant;
    int rc = known_load(&plant, c->store);
    *first = INT64_MAX;
    for (size_t i = 0; i < plant.loops.n_controllers && rc >= 0; i++) {
        apc_ns time = INT64_MAX;
        rc = apc_store_vectors(c->store, APC_TICK, plant.loops.controller[i].number, &(struct apc_range){0},
                               take_first_tick, &time);
        *first = time < *first ? time : *first;
    }
    known_free(&plant);
    return rc < 0 ? cli_store_error(&c->cli, rc, c->store), rc : 0;
}

static int replay_of_store(struct replay_command *c, const struct replay_watch *watch)
{
    struct replay_range range = {.until = apc_clock_utc(NULL),
                                 .window = WINDOW,
                                 .controller = c->options.controller,
                                 .overrides = &c->options.overrides};
    struct apc_error why;
    if (cli_time(&c->cli, "since", c->options.since, &range.since) != EXIT_OK ||
        cli_time(&c->cli, "until", c->options.until, &range.until) != EXIT_OK)
        exit(EXIT_USAGE);
    int rc = cli_open(&c->cli, &c->store);
    apc_ns first = 0;
    if (rc == 0)
        rc = find_first_tick(c, &first);
    if (rc == 0)
        rc = open_csv(c);
    if (rc < 0)
        return rc;
    range.store = c->store;
    range.since = first > range.since ? first : range.since;
    rc = replay_store(&c->replay, &range, watch, &why);
    const int closed = close_csv(c);
    if (rc < 0 || closed < 0)
        return rc < 0 ? fail_replay(c, rc, &why) : closed;
    if (ticks_of(c) == 0) {
        cli_error(&c->cli, APC_ENOTFOUND, "no ticks are on record%s",
                  c->options.since || c->options.until ? " in that time" : "");
        return APC_ENOTFOUND;
    }
    return judge_replay(c);
}

int command_replay(int argc, char **argv)
{
    struct replay_command c = {.options = {.tolerance = -1}};
    const struct replay_watch watch = {.output = put_replayed_output, .notice = put_notice, .ctx = &c};
    cli_parse(&c.cli, &spec, &c.options, argc, argv);
    c.talk = c.options.csv && !strcmp(c.options.csv, "-") ? stderr : stdout;
    c.options.overrides.set = c.options.set.at;
    c.options.overrides.n_set = c.options.set.n;
    if (c.cli.n_args > 0 && (c.cli.store_given || c.options.since || c.options.until || c.options.controller))
        return cli_usage(&c.cli,
                         "a run folder is replayed whole: --since, --until and --controller go with --store");
    if (c.cli.n_args == 0 && c.options.virtually)
        return cli_usage(&c.cli, "--virtual: of a run folder");
    int rc = c.cli.n_args > 0 ? replay_folder(&c, &watch) : replay_of_store(&c, &watch);
    replay_free(&c.replay);
    apc_store_close(c.store);
    return cli_done(&c.cli, exit_code_of(rc));
}

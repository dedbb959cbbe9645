/* SPDX-License-Identifier: BSD-3-Clause */
/* apc replay: what a controller would have done in a recorded run. */
#include "simulation/simulation.h"

#include <errno.h>
#include <float.h>
#include <stdlib.h>
#include <string.h>

#include "apc/common/cli.h"
#include "apc/common/print.h"
#include "apc/folder/folder.h"
#include "files/files.h"

struct replay_options {
    const char *csv;
    bool force;
    double tolerance; /* < 0: none */
    bool virtually;
    struct experiment_overrides overrides;
};

static void check_replay_options(void *input, const struct argp_state *state)
{
    const struct replay_options *o = input;
    if (o->virtually && (o->csv || o->overrides.law || o->tolerance >= 0))
        argp_error(state, "--virtual: goes with no other option");
}

#define AT(member) .to = offsetof(struct replay_options, member)
static const struct option_spec own_options[] = {
    {"law", 0, "NAME",
     "Control law instead of the run's: built in, ./file.so or ./file.py; its own tuning applies. Of several "
     "controllers: CONTROLLER=NAME",
     OPTION_TEXT, AT(overrides.law), .once = "only one law at a time"},
    {"tolerance", 0, "U", "End with code 1 when an output differs by more", OPTION_NUMBER, AT(tolerance),
     .high = DBL_MAX, .must = "be a number, 0 or above"},
    {"csv", 0, "FILE", "Write time,loop,recorded,replayed there; - is stdout", OPTION_TEXT, AT(csv)},
    {"virtual", 0, NULL, "Simulate the run again instead, and name the first tick that differs", OPTION_FLAG,
     AT(virtually)},
    {"force", 0, NULL, "Write over what is in that file", OPTION_FLAG, AT(force)},
    {0},
};

static const struct cli_spec spec = {
    .args_doc = "RUN",
    .doc =
        "Repeat each controller of run folder RUN from what its ticks were made from, and report how what it "
        "does differs from what was recorded. Without --law it is the law that ran: then all of each tick "
        "has "
        "to come out again, bit for bit; the first tick that does not is named, and why.",
    .min_args = 1,
    .max_args = 1,
    .options = own_options,
    .check = check_replay_options,
};

struct replay_command {
    struct cli cli;
    struct replay_options options;
    struct replay replay;
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
        const uint64_t compared = of->ticks.n - (of->begins > 0);
        char since[APC_TIME_LEN];
        if (of->begins)
            fprintf(c->talk,
                    "%s: ticks before %s are not on record: the run's store had no room for more (apc run "
                    "--history URI keeps all, shm:NAME?size=MIB more)\n",
                    of->of->name, apc_time_format(of->begins, since));
        fprintf(c->talk, "%s: %llu of %llu ticks the same bit for bit%s", of->of->name,
                (unsigned long long)of->same, (unsigned long long)compared, of->restarts ? ", " : "\n");
        if (of->restarts)
            fprintf(c->talk, "%llu of them after a restart\n", (unsigned long long)of->restarts);
        if (of->first[0])
            fprintf(c->talk, "%s: the first that differs: %s\n", of->of->name, of->first);
        exact = exact && !of->first[0];
    }
    return exact;
}

static uint64_t ticks_of(const struct replay_command *c)
{
    uint64_t n = 0;
    for (size_t i = 0; i < c->replay.e.n_controllers; i++)
        n += c->replay.controller[i].ticks.n;
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

static int replay(struct replay_command *c)
{
    struct apc_error why;
    const char *csv = c->options.csv;
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
    if (csv && (rc = folder_spare(csv, c->options.force, &why)) < 0)
        return fail_replay(c, rc, &why);
    if (csv && !(c->csv = !strcmp(csv, "-") ? stdout : fopen(csv, "we"))) {
        cli_error(&c->cli, APC_ESYS, "%s: cannot be written: %s", csv, strerror(errno));
        return APC_ESYS;
    }
    if (c->csv)
        fputs("time,loop,recorded,replayed\n", c->csv);
    rc = replay_run(&c->replay,
                    &(struct replay_watch){.output = put_replayed_output, .notice = put_notice, .ctx = c});
    if (c->csv && c->csv != stdout && fclose(c->csv) != 0) {
        cli_error(&c->cli, APC_ESYS, "%s: cannot be written: %s", csv, strerror(errno));
        return APC_ESYS;
    }
    if (rc < 0)
        return fail_replay(c, rc, &c->replay.why);
    if ((rc = print_differences(c)) < 0) {
        cli_error(&c->cli, rc, "out of memory");
        return rc;
    }
    if (!c->options.overrides.law)
        (void)print_exactness(c);
    for (size_t i = 0; i < c->replay.loops.n && c->options.tolerance >= 0; i++)
        if (!(c->replay.difference[i].worst <= c->options.tolerance)) {
            cli_error(&c->cli, APC_ESTATE, "%s differs by %g, more than %g", c->replay.loops.at[i].name,
                      c->replay.difference[i].worst, c->options.tolerance);
            return APC_ESTATE;
        }
    return 0;
}

int command_replay(int argc, char **argv)
{
    struct replay_command c = {.options = {.tolerance = -1}};
    cli_parse(&c.cli, &spec, &c.options, argc, argv);
    c.talk = c.options.csv && !strcmp(c.options.csv, "-") ? stderr : stdout;
    int rc = replay(&c);
    replay_free(&c.replay);
    return cli_done(&c.cli, exit_code_of(rc));
}

/* SPDX-License-Identifier: BSD-3-Clause */
/*
 * What the commands of `apc` have in common. A command is one function, one entry in main.c: it parses
 * its options with cli_parse(), does its work, returns an exit code. Results go to stdout, messages to
 * stderr.
 */
#ifndef APC_CLI_H
#define APC_CLI_H

#include <argp.h>
#include <stdio.h>

#include <apcstore.h>

#include "common/exitcode.h"
#include "common/option.h"
#include "operate/operate.h"

enum cli_format { CLI_TEXT = 0, CLI_JSON, CLI_CSV };

/* Which of the shared options a command takes. */
enum cli_takes {
    CLI_STORE = 1,
    CLI_FORMAT = 2,
    CLI_NEGATIVE = 4,    /* arguments may be negative numbers: -5 is then none of the options */
    CLI_OWN_STORE = 8,   /* `store` stays NULL without --store and APC_STORE */
    CLI_WRITES = 16,     /* --no-wait, --reason */
    CLI_MAKES_STORE = 32 /* one that is not there yet may be meant */
};

struct cli {
    const char *command; /* "apc get": for messages */
    const char *store;
    const char
        *stores; /* LIVE+HISTORY, where that has become the history, because the run has ended or goes back */
    const char *folder; /* of the run whose stores these are, where it was given; else NULL */
    bool no_wait;       /* for what becomes of a write */
    const char *reason; /* of a write; NULL: none */
    bool unnamed;       /* neither --store nor APC_STORE gave one */
    bool store_given;   /* --store did */
    enum cli_format format;
    char **args; /* positional arguments */
    int n_args;
    unsigned takes;
    apc_ns timeout; /* of the store's operations; cli_parse() sets 10 s */
};

struct cli_spec {
    const char *args_doc, *doc;
    unsigned takes;
    int min_args, max_args;            /* of positional arguments; max -1: any number */
    const struct option_spec *options; /* own ones, which go into `own`; may be NULL */
    void (*check)(void *own, const struct argp_state *state); /* all of them, at the end; may be NULL */
};

/* Exits on --help and on usage errors (with EXIT_USAGE). argv[0] is the command's name. */
void cli_parse(struct cli *cli, const struct cli_spec *spec, void *own, int argc, char **argv);

/* A run folder in cli->store becomes the stores of its run, or the process exits and says why. Of
 * LIVE+HISTORY only the history is left when the run has ended. cli_parse() does that with --store. */
void cli_find_store(struct cli *cli);

/* "apc get: ..." on stderr. Returns the exit code for err. */
int cli_error(const struct cli *cli, int err, const char *fmt, ...) APC_PRINTF(3, 4);
/* A usage error that only shows after cli_parse(). Returns EXIT_USAGE. */
int cli_usage(const struct cli *cli, const char *fmt, ...) APC_PRINTF(2, 3);
/* Nothing is to be written: EXIT_OK, or a usage error where --reason or --no-wait is given. */
int cli_only_shows(const struct cli *cli);
/* Behind the answer where all is as it is to be: that the reason was not kept; "" where there is none. */
const char *cli_unkept(const struct cli *cli);
/* The same as cli_error() for the last failure of a store. */
int cli_store_error(const struct cli *cli, int err, const struct apc_store *store);

/* apc_store_init(), which says so when tables of a former version were brought along. */
int cli_init(const struct cli *cli, struct apc_store *store);

/* Open and connect the store of --store, APC_STORE or the environment. Returns 0 or an error already said. */
int cli_open(const struct cli *cli, struct apc_store **store);

/* Does a loop read what is written there? Of a history nobody does. Returns EXIT_OK, or it is said why not. */
int cli_live(const struct cli *cli, struct apc_store *store);

/* The end of a command that exits with rc: EXIT_ERROR instead of success when stdout could not be written. */
int cli_done(const struct cli *cli, int rc);

/* True when stdout is a terminal and NO_COLOR is not set. */
bool cli_colour(void);

/* RFC 3339, without its seconds or its time of day as well, or before now as 30s, -10m, 2h, 1d, -600 (s). False: it is neither. */
bool cli_when(const char *text, apc_ns *time);
bool cli_date(const char *text, apc_ns *time); /* without the latter */
/* The TIME of option --NAME, as past_time() takes it, into *time; NULL leaves it as it
 * is. Returns EXIT_OK, or EXIT_USAGE after saying so. */
int cli_time(const struct cli *cli, const char *name, const char *text, apc_ns *time);
/* The same of seconds since the start of a run; NULL: NAN. */
int cli_seconds(const struct cli *cli, const char *name, const char *text, double *t);

/* The DURATION of option --NAME, as 30s, 10m, 2h, 90d, into *duration; NULL leaves it as it is. Returns
 * EXIT_OK, or EXIT_USAGE after saying so. */
int cli_duration(const struct cli *cli, const char *name, const char *text, apc_ns *duration);

/* The variables' descriptions, and finding one by name. */
struct cli_tags {
    struct apc_tag *tag;
    size_t n;
};
int cli_tags_load(const struct cli *cli, struct apc_store *store, struct cli_tags *tags);
void cli_tags_free(struct cli_tags *tags);
const struct apc_tag *cli_tag(const struct cli_tags *tags, enum apc_table table,
                              int id); /* NULL: undescribed */
/* The variables' descriptions with the loops that they tell of. Says its own errors. */
struct cli_plant {
    struct cli_tags tags;
    struct loops loops;
};
int cli_plant_load(const struct cli *cli, struct apc_store *store, struct cli_plant *plant);
void cli_plant_free(struct cli_plant *plant);
/* Is it a loop's target mode? Its tag bears the loop's name, which people also call the output by. */
bool cli_is_loop(const struct apc_tag *tag);
/*
 * A variable as people write it: its name ("y"), or TABLE.ID ("sensor.1"). Returns 0, or APC_ENOTFOUND
 * after saying what names there are.
 */
int cli_find(const struct cli *cli, const struct cli_tags *tags, const char *text, enum apc_table *table,
             int *id);
/* Warn that @p former was the name of @p present in the version before. */
void cli_former(const struct cli *cli, const char *former, const char *present);
/* The same without a word: is there one? */
bool cli_look(const struct cli_tags *tags, const char *text, enum apc_table *table, int *id);
/* Says that there is no such variable (of @p table, or 0), and which there are. Returns APC_ENOTFOUND. */
int cli_unknown(const struct cli *cli, const struct cli_tags *tags, const char *text, enum apc_table table);
/*
 * All variables that are described of these tables (the list ends with 0), in this order, as
 * apc_store_read() takes them. Returns how many, or an error already said. *samples goes to free() either
 * way.
 */
int cli_described(const struct cli *cli, const struct cli_tags *tags, const enum apc_table *tables,
                  struct apc_sample **samples);
/* The same for the variables to show: those that the arguments name or, without any, the described ones. It
 * is an error when there are none. */
int cli_variables(const struct cli *cli, const struct cli_tags *tags, const enum apc_table *tables,
                  struct apc_sample **samples);

int command_init(int argc, char **argv);
int command_export(int argc, char **argv);
int command_run(int argc, char **argv);
int command_simulate(int argc, char **argv);
int command_speed(int argc, char **argv);
int command_fault(int argc, char **argv);
int command_check(int argc, char **argv);
int command_replay(int argc, char **argv);
int command_why(int argc, char **argv);
int command_laws(int argc, char **argv);
int command_status(int argc, char **argv);
int command_get(int argc, char **argv);
int command_set(int argc, char **argv);
int command_mode(int argc, char **argv);
int command_remote(int argc, char **argv);
int command_undo(int argc, char **argv);
int command_approve(int argc, char **argv);
int command_log(int argc, char **argv);
int command_promote(int argc, char **argv);
int command_tune(int argc, char **argv);
int command_watch(int argc, char **argv);
int command_history(int argc, char **argv);
int command_timing(int argc, char **argv);
int command_report(int argc, char **argv);
int command_monitor(int argc, char **argv);
int command_alarm(int argc, char **argv);
int command_user(int argc, char **argv);
int command_maintain(int argc, char **argv);
int command_plants(int argc, char **argv);
int command_linearize(int argc, char **argv);
int command_test(int argc, char **argv);
int command_identify(int argc, char **argv);
int command_optimize(int argc, char **argv);
int command_analyze(int argc, char **argv);
int command_cert(int argc, char **argv);
int command_copy(int argc, char **argv);
int command_drain(int argc, char **argv);
int command_restore(int argc, char **argv);

#endif

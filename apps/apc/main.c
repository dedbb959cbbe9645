/* SPDX-License-Identifier: BSD-3-Clause */
/* apc: the command line. */
#include <signal.h>
#include <string.h>

#include "apc/common/cli.h"
#include "common/streams.h"
#include "files/files.h"

/* By group, each with its folder; a name stands before the first of its group. */
static const struct {
    const char *name;
    int (*run)(int argc, char **argv);
    const char *doc;
    const char *group;
} commands[] = {
    {"run", command_run, "run an experiment in real time and leave a report", "Run"},
    {"drain", command_drain, "store what was left behind in a folder, by daemons or a killed run", NULL},
    {"simulate", command_simulate, "run an experiment in virtual time, once or over many seeds", "Simulate"},
    {"replay", command_replay, "give a recorded run to a controller and see how its outputs differ", NULL},
    {"status", command_status, "what every part is doing: modes, values with their age, timing, events",
     "Operate"},
    {"get", command_get, "newest values", NULL},
    {"set", command_set, "write a setpoint, or an output in mode Man", NULL},
    {"mode", command_mode, "show or change the mode of a loop, a controller, or all: Man, Auto, Cas, OOS",
     NULL},
    {"remote", command_remote, "give a setpoint back to the controller above that moves it", NULL},
    {"promote", command_promote, "have a controller act that is in shadow of another one", NULL},
    {"watch", command_watch, "follow values as they change", NULL},
    {"alarm", command_alarm, "the alarms: list, acknowledge, shelve, and all that they did", NULL},
    {"history", command_history, "past values of a variable, or events", "Look back"},
    {"why", command_why, "which inputs moved an output of a run, and by how much", NULL},
    {"timing", command_timing, "how well the tasks keep time: lateness, jitter, run time, missed ticks",
     NULL},
    {"report", command_report, "draw the report of a run again", NULL},
    {"test", command_test, "move a plant, simulated or live, so that it can be identified", "Identify"},
    {"identify", command_identify, "models of a plant from its record: dead times, gains, time constants",
     NULL},
    {"linearize", command_linearize, "the linear model of a plant: matrices, poles, zeros, gains",
     "Design and tune"},
    {"analyze", command_analyze, "margins, sensitivity and poles of the loops as they tick", NULL},
    {"tune", command_tune, "show or change the tuning of the control law", NULL},
    {"optimize", command_optimize, "search numbers of an experiment with which it is controlled better",
     NULL},
    {"plants", command_plants, "the plants there are: their parameters, states, inputs, outputs",
     "Set up and maintain"},
    {"laws", command_laws, "the control laws there are: their tuning parameters and settings", NULL},
    {"init", command_init, "make or update the tables, and describe an experiment in them", NULL},
    {"copy", command_copy, "copy history, descriptions, events and timing to another store", NULL},
    {"restore", command_restore, "put a backup in the place of a record that is a file", NULL},
    {"maintain", command_maintain, "make room ahead for samples, and drop what is old", NULL},
    {"user", command_user, "who may use the operator's page", NULL},
    {"cert", command_cert, "an authority, and certificates of a plant and its clients, for tls:", NULL},
};

static void usage(FILE *out)
{
    fputs("Usage: apc COMMAND [OPTION...]\n"
          "Real-time advanced process control from the command line.\n\n",
          out);
    for (size_t i = 0; i < sizeof commands / sizeof *commands; i++) {
        if (commands[i].group)
            fprintf(out, "%s%s:\n", i > 0 ? "\n" : "", commands[i].group);
        fprintf(out, "  %-9s %s\n", commands[i].name, commands[i].doc);
    }
    fputs("\n`apc COMMAND --help` tells more. The shared data are those of --store URI, of\n"
          "APC_STORE, or of the PostgreSQL of libpq's environment (PGHOST, PGSERVICE, ...).\n"
          "\nExit codes, also of the daemons:\n"
          "  0  all was done\n"
          "  1  it failed, for another reason than those below\n"
          "  2  the command line is wrong\n"
          "  3  no connection to the store, the plant or the page's port\n"
          "  4  refused: outside its limits, in use by another, not allowed\n"
          "  5  not confirmed in time, or too late\n",
          out);
}

int main(int argc, char **argv)
{
    streams_keep();
    option_library();
    if (argc < 2) {
        usage(stderr);
        return EXIT_USAGE;
    }
    if (!strcmp(argv[1], "--help") || !strcmp(argv[1], "-?") || !strcmp(argv[1], "help")) {
        usage(stdout);
        return EXIT_OK;
    }
    if (!strcmp(argv[1], "--version") || !strcmp(argv[1], "-V")) {
        printf("apc (libapc) %s\n", apc_version());
        return EXIT_OK;
    }
    signal(SIGXFSZ, SIG_IGN); /* a file that may not grow is a full disk */
    struct nearest nearest = {.wanted = argv[1]};
    for (size_t i = 0; i < sizeof commands / sizeof *commands; i++) {
        if (!strcmp(argv[1], commands[i].name))
            return commands[i].run(argc - 1, argv + 1);
        nearest_look(&nearest, commands[i].name);
    }
    fprintf(stderr, "apc: unknown command \"%s\"; ", argv[1]);
    if (nearest.name)
        fprintf(stderr, "did you mean \"%s\"? ", nearest.name);
    fputs("`apc --help` lists them\n", stderr);
    return EXIT_USAGE;
}

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
    {"drain", command_drain, "store the rows that daemons or a killed run left in a folder", NULL},
    {"simulate", command_simulate, "run an experiment in virtual time, once or over many seeds", "Simulate"},
    {"check", command_check, "run scenarios in virtual time and check their expectations", NULL},
    {"replay", command_replay, "recalculate the outputs of a recorded run, and compare them", NULL},
    {"status", command_status, "show modes, values with their age, timing, events", "Operate"},
    {"get", command_get, "show the newest values", NULL},
    {"set", command_set, "write a setpoint, or an output in mode Man", NULL},
    {"undo", command_undo, "take back your last write, within a minute", NULL},
    {"approve", command_approve, "list and approve writes that wait for a second person", NULL},
    {"mode", command_mode, "show or change modes: Man, Auto, Cas, OOS", NULL},
    {"speed", command_speed, "show or change the speed of `apc run --speed`", NULL},
    {"fault", command_fault, "start and stop faults of the plant of `apc run --speed`", NULL},
    {"remote", command_remote, "let the controller above or the scheduler move a setpoint again", NULL},
    {"promote", command_promote, "make a shadow controller the active one", NULL},
    {"watch", command_watch, "follow values as they change", NULL},
    {"alarm", command_alarm, "list, acknowledge and shelve alarms; show their journal", NULL},
    {"log", command_log, "enter a line in the log book, or sign a shift handover", NULL},
    {"history", command_history, "show past values of a variable, or events", "Look back"},
    {"why", command_why, "show which inputs moved an output, and by how much", NULL},
    {"timing", command_timing, "show lateness, jitter, run time and missed ticks of tasks", NULL},
    {"report", command_report, "show figures and KPIs of a run or a store; draw the report", NULL},
    {"monitor", command_monitor, "find loops that need attention: sensor, valve, tuning, disturbance", NULL},
    {"test", command_test, "excite a plant, simulated or live, so that it can be identified", "Identify"},
    {"identify", command_identify, "find models of a plant in its record: gains, lags, dead times", NULL},
    {"linearize", command_linearize, "show the linear model of a plant: matrices, poles, gains",
     "Design and tune"},
    {"analyze", command_analyze, "show margins, sensitivity and poles of the loops", NULL},
    {"tune", command_tune, "show or change the tuning of the control law", NULL},
    {"optimize", command_optimize, "search better tuning and settings of an experiment", NULL},
    {"plants", command_plants, "list the plants: parameters, states, inputs, outputs", "Set up and maintain"},
    {"laws", command_laws, "list the control laws: tuning parameters and settings", NULL},
    {"export", command_export, "make an FMU of a controller, for other tools", NULL},
    {"init", command_init, "make or update the tables, and describe an experiment in them", NULL},
    {"copy", command_copy, "copy history, descriptions, events and timing to another store", NULL},
    {"restore", command_restore, "put a backup back into a record that is a file", NULL},
    {"maintain", command_maintain, "make partitions for new samples; drop or pack old ones", NULL},
    {"user", command_user, "list, add and remove users of the operator's page", NULL},
    {"cert", command_cert, "make the certificates of a plant and its clients, for tls:", NULL},
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
    fputs("\n`apc COMMAND --help` shows more. --store URI names the shared data; without it\n"
          "APC_STORE does, or libpq's environment (PGHOST, PGSERVICE, ...).\n"
          "\nExit codes, also of the daemons:\n"
          "  0  success\n"
          "  1  failure, for a reason not listed below\n"
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

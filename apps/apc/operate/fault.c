/* SPDX-License-Identifier: BSD-3-Clause */
/* apc fault: what an instructor breaks, in the plant of `apc run --speed`. */
#include <string.h>

#include "apc/common/print.h"
#include "common/storeuri.h"
#include "experiment/experiment.h"
#include "operate.h"
#include "simulation/simulation.h"

static const struct cli_spec spec = {
    .args_doc = "[start FAULT | stop FAULT]",
    .doc =
        "List the faults of the plant of `apc run --speed`, and start or stop one at the plant's next "
        "tick. FAULT is its number in the list, or SIGNAL KIND [SETTING=NUMBER...] [when=CONDITION], of "
        "any measurement, output, disturbance or parameter. Kinds and settings are those of the "
        "experiment file, with at=SECONDS and duration=SECONDS. A disturbance has the kind disturbance, a "
        "parameter the kind drift, both with size. CONDITION is `y > 21`, or `alarm NAME`. `plant power` "
        "is the power supply of the whole plant, `link lost` the loss of its connection; a controller is "
        "`hung`, "
        "or `killed` until it is started at the end. The page does not show faults to operators. A repeated "
        "session has the fault at the same tick.",
    .takes = CLI_STORE | CLI_FORMAT,
    .max_args = 16,
};

static void put_fault_state(struct print_table *t, const struct faults *f, size_t i)
{
    const enum fault_state state = faults_state(f, i);
    if (state == FAULT_WAITS)
        print_cell(t, PRINT_FAINT, f->row[i].seq > 0 ? "waits" : "waits for the instructor");
    else if (state == FAULT_TIMED)
        print_cell(t, PRINT_PLAIN, "at %.10g s", apc_ns_to_s(*experiment_fault(&f->e, i).at));
    else
        print_cell(t, state == FAULT_STOPPED ? PRINT_PLAIN : PRINT_WARN,
                   state == FAULT_AT_LIMIT  ? "at its limit since %.10g s"
                   : state == FAULT_STOPPED ? "stopped at %.10g s"
                                            : "started at %.10g s",
                   apc_ns_to_s(f->row[i].time - SIMULATION_BEGIN));
}

static int list_faults(const struct cli *cli, const struct faults *f)
{
    static const struct print_column columns[] = {{"FAULT", PRINT_RIGHT},
                                                  {"SIGNAL", PRINT_LEFT},
                                                  {"KIND", PRINT_LEFT},
                                                  {"WITH", PRINT_LEFT},
                                                  {"STATE", PRINT_LEFT}};
    char with[FAULT_TEXT];
    size_t listed = 0;
    struct print_table t;
    if (cli->format == CLI_JSON) {
        struct text out = {.out = stdout};
        faults_json(f, &out);
        putchar('\n');
        return EXIT_OK;
    }
    print_table_open(&t, columns, sizeof columns / sizeof *columns);
    for (size_t i = 0; i < f->n; i++) {
        if (!faults_listed(f, i))
            continue;
        const struct experiment_fault fault = experiment_fault(&f->e, i);
        listed++;
        print_cell(&t, PRINT_PLAIN, "%zu", i + 1);
        print_cell(&t, PRINT_PLAIN, "%s", fault.signal);
        print_cell(&t, PRINT_PLAIN, "%s", fault.kind);
        print_cell(&t, PRINT_PLAIN, "%s", faults_words(f, i, with));
        put_fault_state(&t, f, i);
    }
    if (listed == 0)
        puts("the experiment has no faults, and none was started");
    return print_table_end(&t, stdout, cli_colour(), 0) < 0 ? EXIT_ERROR : EXIT_OK;
}

/* The arguments behind the first, as one text. */
static void join_fault_words(const struct cli *cli, char *text, size_t size)
{
    size_t used = 0;
    text[0] = '\0';
    for (int i = 1; i < cli->n_args && used < size; i++)
        used += (size_t)snprintf(text + used, size - used, "%s%s", i > 1 ? " " : "", cli->args[i]);
}

static int order_fault(const struct cli *cli, struct apc_store *store, const struct faults *f)
{
    const bool start = !strcmp(cli->args[0], "start");
    char who[APC_AUTHOR_LEN], text[2 * FAULT_TEXT];
    struct fault_order order;
    struct apc_error why;
    if ((!start && strcmp(cli->args[0], "stop") != 0) || cli->n_args < 2)
        return cli_usage(
            cli, "expected `start FAULT` or `stop FAULT`, FAULT as `apc fault` lists it, or SIGNAL KIND");
    join_fault_words(cli, text, sizeof text);
    int rc = faults_find(f, text, start, &order, &why);
    if (rc < 0)
        return cli_error(cli, rc, "%s", why.text);
    operate_who(who, sizeof who);
    rc = faults_order(f, store, &order, start, who);
    if (rc < 0)
        return cli_store_error(cli, rc, store);
    const struct experiment_fault fault = experiment_fault(&f->e, order.i);
    const char *when = order.number[FAULT_IF] + order.number[FAULT_AT] > 0 ? "starts once that is so"
                                                                           : "starts at the next tick";
    printf("%s %s: %s\n", fault.kind ? fault.signal : "plant", fault.kind ? fault.kind : "power",
           start ? when : "stops at the next tick");
    return EXIT_OK;
}

int command_fault(int argc, char **argv)
{
    struct apc_store *store = NULL;
    struct apc_store_clock clock;
    struct apc_error why;
    struct faults f = {.n = 0};
    struct cli cli;
    cli_parse(&cli, &spec, NULL, argc, argv);
    int rc = exit_code_of(cli_open(&cli, &store));
    int err = rc == EXIT_OK ? operate_simulated(&cli, &store, &clock, &why) : 0;
    if (err > 0 && cli.n_args > 0 && clock.rewind > 0)
        err = apc_fail(&why, APC_ESTATE, "the plant is being rewound: do this again when that is done");
    if (err > 0)
        err = faults_open(&f, store, &why);
    if (err < 0)
        rc = cli_error(&cli, err, "%s", why.text);
    else if (rc == EXIT_OK)
        rc = cli.n_args == 0 ? list_faults(&cli, &f) : order_fault(&cli, store, &f);
    faults_close(&f);
    apc_store_close(store);
    return cli_done(&cli, rc);
}

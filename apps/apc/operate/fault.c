/* SPDX-License-Identifier: BSD-3-Clause */
/* apc fault: what an instructor breaks, in the plant of `apc run --speed`. */
#include <string.h>

#include "apc/common/print.h"
#include "common/storeuri.h"
#include "experiment/experiment.h"
#include "operate.h"
#include "simulation/simulation.h"

static const struct cli_spec spec = {
    .args_doc = "[start N | stop N]",
    .doc = "List the faults of the plant of `apc run --speed`, as its experiment has them, and start or stop "
           "number "
           "N at the plant's next tick. With `instructor = true` instead of `at` a fault waits for that. "
           "Nothing on "
           "the page tells operators of it; the session repeats it at the same tick.",
    .takes = CLI_STORE | CLI_FORMAT,
    .max_args = 2,
};

static void put_fault_state(struct print_table *t, const struct faults *f, size_t i)
{
    const enum fault_state state = faults_state(f, i);
    if (state == FAULT_WAITS)
        print_cell(t, PRINT_FAINT, "waits for the instructor");
    else if (state == FAULT_TIMED)
        print_cell(t, PRINT_PLAIN, "at %.10g s", apc_ns_to_s(*experiment_fault(&f->e, i).at));
    else
        print_cell(t, state == FAULT_STARTED ? PRINT_WARN : PRINT_PLAIN, "%s at %.10g s",
                   fault_state_name(state), apc_ns_to_s(f->row[i].time - SIMULATION_BEGIN));
}

static int list_faults(const struct cli *cli, const struct faults *f)
{
    static const struct print_column columns[] = {
        {"FAULT", PRINT_RIGHT}, {"SIGNAL", PRINT_LEFT}, {"KIND", PRINT_LEFT}, {"STATE", PRINT_LEFT}};
    struct print_table t;
    if (cli->format == CLI_JSON) {
        struct text out = {.out = stdout};
        faults_json(f, &out);
        putchar('\n');
        return EXIT_OK;
    }
    print_table_open(&t, columns, sizeof columns / sizeof *columns);
    for (size_t i = 0; i < f->n; i++) {
        const struct experiment_fault fault = experiment_fault(&f->e, i);
        print_cell(&t, PRINT_PLAIN, "%zu", i + 1);
        print_cell(&t, PRINT_PLAIN, "%s", fault.signal->name);
        print_cell(&t, PRINT_PLAIN, "%s", fault.kind);
        put_fault_state(&t, f, i);
    }
    if (f->n == 0)
        puts("the experiment has no faults: give a measurement or an output some");
    return print_table_end(&t, stdout, cli_colour(), 0) < 0 ? EXIT_ERROR : EXIT_OK;
}

static int order_fault(const struct cli *cli, struct apc_store *store, const struct faults *f)
{
    const bool start = !strcmp(cli->args[0], "start");
    char who[APC_AUTHOR_LEN];
    double number = 0;
    if ((!start && strcmp(cli->args[0], "stop") != 0) || cli->n_args < 2)
        return cli_usage(cli, "expected `start N` or `stop N`, N as `apc fault` lists it");
    if (apc_number_parse(cli->args[1], &number) < 0 || number != (double)(int)number || !(number >= 1) ||
        number > (double)f->n)
        return cli_error(cli, APC_ENOTFOUND, "there is no fault %s: `apc fault` lists them, 1 to %zu",
                         cli->args[1], f->n);
    const size_t i = (size_t)number - 1;
    const struct experiment_fault fault = experiment_fault(&f->e, i);
    operate_who(who, sizeof who);
    const int rc = faults_order(store, i, start, who);
    if (rc < 0)
        return cli_store_error(cli, rc, store);
    printf("%s %s: %s at the next tick\n", fault.signal->name, fault.kind, start ? "starts" : "stops");
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
    int err = rc == EXIT_OK ? store_simulated(store, &clock, &why) : 0;
    if (rc == EXIT_OK && err == 0)
        err = apc_fail(&why, APC_ESTATE, "the plant is not simulated: its time is real");
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

/* SPDX-License-Identifier: BSD-3-Clause */
/* apc speed: how fast the plant of `apc run --speed` is simulated. */
#include <stdio.h>
#include <string.h>
#include <time.h>

#include "apc/common/speed.h"
#include "common/storeuri.h"
#include "files/files.h"
#include "operate.h"

#define PATIENCE (10 * APC_NS_PER_S)

static const struct cli_spec spec = {
    .args_doc = "[X | pause | max | step [N]]",
    .doc = "Show or change how fast the plant of `apc run --speed` is simulated: X plant seconds per second, "
           "from 0 "
           "to 1000, or as fast as the machine can. `pause` is 0; `step` makes the next N ticks of a paused "
           "plant "
           "(1), and returns when they are made. A speed that the machine cannot hold shows as a lower one "
           "that was reached.",
    .takes = CLI_STORE | CLI_FORMAT,
    .min_args = 0,
    .max_args = 2,
};

static int show_speed(const struct cli *cli, struct apc_store *store)
{
    struct apc_store_clock clock;
    struct apc_error why;
    char asked[SPEED_TEXT], time[APC_TIME_LEN];
    const int rc = store_simulated(store, &clock, &why);
    if (rc < 0)
        return cli_error(cli, rc, "%s", why.text);
    if (rc == 0)
        return cli_error(cli, APC_ESTATE, "the plant is not simulated: its time is real");
    if (clock.asked == 0)
        clock.reached = 0;
    if (cli->format == CLI_JSON) {
        struct text t = {.out = stdout};
        json_add(&t, "{t:%.6jd, asked:%g, reached:%g, steps:%ju}\n", clock.now, clock.asked, clock.reached,
                 (uintmax_t)clock.steps);
    } else {
        printf("%s  asked %s  reached %.1f x\n", apc_time_format(clock.now, time),
               speed_text(clock.asked, asked), clock.reached);
    }
    return EXIT_OK;
}

/* The steps are made when this returns; a simulation that makes none for PATIENCE is waited for no longer. */
static int wait_for_steps(const struct cli *cli, struct apc_store *store)
{
    struct apc_store_clock clock;
    struct apc_error why;
    apc_ns since = apc_clock_mono(NULL);
    uint64_t left = 0;
    for (;;) {
        const int rc = store_simulated(store, &clock, &why);
        const apc_ns now = apc_clock_mono(NULL);
        if (rc < 0)
            return cli_error(cli, rc, "%s", why.text);
        if (rc == 0 || clock.steps == 0 || clock.asked != 0)
            return EXIT_OK;
        if (clock.steps != left)
            since = now;
        left = clock.steps;
        if (now - since > PATIENCE)
            return cli_error(cli, APC_ETIMEDOUT, "no tick within 10 s: does `apc run --speed` still run?");
        nanosleep(&(struct timespec){.tv_nsec = 2 * APC_NS_PER_MS}, NULL);
    }
}

/* What the arguments ask for. */
static int read_speed_arguments(const struct cli *cli, double *speed, uint64_t *steps)
{
    struct apc_error why;
    const char *first = cli->args[0];
    const bool step = !strcmp(first, "step");
    double n = 1;
    if (cli->n_args > 1 && (!step || apc_number_parse(cli->args[1], &n) < 0 || !(n >= 1 && n <= 1e9) ||
                            n != (double)(uint64_t)n))
        return cli_usage(cli,
                         step ? "step \"%s\": must be a whole number of ticks, 1 to 1000000000"
                              : "unexpected argument \"%s\"",
                         cli->args[1]);
    *steps = step ? (uint64_t)n : 0;
    *speed = 0;
    if (step || !strcmp(first, "pause"))
        return EXIT_OK;
    return speed_parse(first, speed, &why) < 0 ? cli_usage(cli, "%s", why.text) : EXIT_OK;
}

static int set_speed(const struct cli *cli, struct apc_store *store, double speed, uint64_t steps)
{
    struct apc_store_clock clock;
    struct apc_error why;
    int rc = store_simulated(store, &clock, &why);
    if (rc < 0)
        return cli_error(cli, rc, "%s", why.text);
    rc = apc_store_set_speed(store, speed, steps);
    if (rc < 0)
        return cli_store_error(cli, rc, store);
    return steps > 0 ? wait_for_steps(cli, store) : EXIT_OK;
}

int command_speed(int argc, char **argv)
{
    struct apc_store *store = NULL;
    struct cli cli;
    double speed = 0;
    uint64_t steps = 0;

    cli_parse(&cli, &spec, NULL, argc, argv);
    int rc = cli.n_args > 0 ? read_speed_arguments(&cli, &speed, &steps) : EXIT_OK;
    if (rc == EXIT_OK)
        rc = exit_code_of(cli_open(&cli, &store));
    if (rc == EXIT_OK)
        rc = cli.n_args > 0 ? set_speed(&cli, store, speed, steps) : show_speed(&cli, store);
    apc_store_close(store);
    return cli_done(&cli, rc);
}

/* SPDX-License-Identifier: BSD-3-Clause */
/* apc speed: how fast the plant of `apc run --speed` is simulated. */
#include <math.h>
#include <stdio.h>
#include <string.h>
#include <time.h>

#include "apc/common/speed.h"
#include "common/storeuri.h"
#include "experiment/experiment.h"
#include "files/files.h"
#include "operate.h"
#include "simulation/simulation.h"

#define PATIENCE (10 * APC_NS_PER_S)
#define RETURN   (60 * APC_NS_PER_S) /* of a plant that goes back, once what was is reported */

static const struct cli_spec spec = {
    .args_doc = "[X | pause | max | step [N] | rewind SECONDS]",
    .doc =
        "Show or change how fast the plant of `apc run --speed` is simulated: X plant seconds per second, "
        "from 0 to 1000, or as fast as the machine can. `pause` is 0; `step` runs the next N ticks (default: "
        "1) of a paused plant, and returns when they are done. `rewind` goes back to SECONDS since the "
        "start, paused: earlier actions of people are repeated, and the run so far is kept beside its "
        "folder. If the machine is too slow for a speed, the lower speed that it reaches is shown.",
    .takes = CLI_STORE | CLI_FORMAT,
    .min_args = 0,
    .max_args = 2,
};

static int show_speed(const struct cli *cli, struct apc_store **store)
{
    struct apc_store_clock clock;
    struct apc_error why;
    char asked[SPEED_TEXT], time[APC_TIME_LEN];
    const int rc = operate_simulated(cli, store, &clock, &why);
    if (rc < 0)
        return cli_error(cli, rc, "%s", why.text);
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

/* Until it stands there, and nobody takes it back. */
static int await_return(const struct cli *cli, struct apc_store **store, struct apc_store_clock *clock,
                        struct apc_error *why)
{
    apc_ns since = apc_clock_mono(NULL), was = 0;
    for (;;) {
        const int rc = operate_again(cli, store, clock, why);
        if (rc > 0 && clock->rewind == 0 && !isinf(clock->asked))
            return 0;
        if (clock->now != was)
            since = apc_clock_mono(NULL);
        was = clock->now;
        if (apc_clock_mono(NULL) - since > RETURN)
            return apc_fail(why, APC_ETIMEDOUT,
                            "the rewind did not end within 60 s: see the messages of its `apc run`");
        nanosleep(&(struct timespec){.tv_nsec = 10 * APC_NS_PER_MS}, NULL);
    }
}

/* The tick of the plant next to @t, both UTC. */
static int find_tick(struct apc_store *store, apc_ns t, apc_ns *tick, struct apc_error *why)
{
    struct experiment e;
    int64_t revision;
    const int rc = experiment_stored(&e, store, &revision, why);
    *tick = rc > 0 ? SIMULATION_BEGIN + simulation_nearest_tick(&e, t - SIMULATION_BEGIN) : t;
    experiment_free(&e);
    return rc < 0 ? rc : 0;
}

/* Who is second to go back does so from where the first one went. */
static int return_plant(const struct cli *cli, struct apc_store **store, apc_ns t, struct apc_error *why)
{
    struct apc_store_clock clock;
    apc_ns tick = 0;
    int rc = operate_simulated(cli, store, &clock, why);
    if (rc < 0 && clock.reached >= 0) /* nobody does any more */
        return rc;
    if (rc < 0 || clock.rewind > 0)
        rc = await_return(cli, store, &clock, why);
    while (rc >= 0 && clock.now != tick) {
        if (t > clock.now)
            return apc_fail(why, APC_ERANGE, "rewind %.10g: the plant is at %g s: expected a time before",
                            apc_ns_to_s(t - SIMULATION_BEGIN), apc_ns_to_s(clock.now - SIMULATION_BEGIN));
        if ((rc = find_tick(*store, t, &tick, why)) == 0 && (rc = apc_store_rewind(*store, t)) < 0)
            return apc_fail(why, rc, "%s", apc_store_error(*store));
        if (rc == 0)
            rc = await_return(cli, store, &clock, why);
    }
    return rc;
}

static int rewind_plant(const struct cli *cli, struct apc_store **store, double to)
{
    struct apc_error why;
    apc_ns t = 0;
    (void)apc_ns_from_s(to, &t);
    const int rc = return_plant(cli, store, SIMULATION_BEGIN + t, &why);
    return rc < 0 ? cli_error(cli, rc, "%s", why.text) : EXIT_OK;
}

/* What the arguments ask for. @p back: below 0: not to go back. */
static int read_speed_arguments(const struct cli *cli, double *speed, uint64_t *steps, double *back)
{
    struct apc_error why;
    const char *first = cli->args[0];
    const bool step = !strcmp(first, "step");
    double n = 1;
    if (!strcmp(first, "rewind"))
        return cli->n_args > 1 && apc_number_parse(cli->args[1], back) == 0 && *back >= 0 && *back <= YEAR
                   ? EXIT_OK
                   : cli_usage(cli, "rewind \"%s\": must be seconds since the start, 0 or more",
                               cli->n_args > 1 ? cli->args[1] : "");
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

static int set_speed(const struct cli *cli, struct apc_store **store, double speed, uint64_t steps)
{
    struct apc_store_clock clock;
    struct apc_error why;
    int rc = operate_simulated(cli, store, &clock, &why);
    if (rc < 0)
        return cli_error(cli, rc, "%s", why.text);
    rc = apc_store_set_speed(*store, speed, steps);
    if (rc < 0)
        return cli_store_error(cli, rc, *store);
    return steps > 0 ? wait_for_steps(cli, *store) : EXIT_OK;
}

int command_speed(int argc, char **argv)
{
    struct apc_store *store = NULL;
    struct cli cli;
    double speed = 0, back = -1;
    uint64_t steps = 0;

    cli_parse(&cli, &spec, NULL, argc, argv);
    int rc = cli.n_args > 0 ? read_speed_arguments(&cli, &speed, &steps, &back) : EXIT_OK;
    if (rc == EXIT_OK)
        rc = exit_code_of(cli_open(&cli, &store));
    if (rc == EXIT_OK)
        rc = cli.n_args == 0 ? show_speed(&cli, &store)
             : back < 0      ? set_speed(&cli, &store, speed, steps)
                             : rewind_plant(&cli, &store, back);
    apc_store_close(store);
    return cli_done(&cli, rc);
}

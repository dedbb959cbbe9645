/* SPDX-License-Identifier: BSD-3-Clause */
/* apc promote: which of several controllers of the same outputs acts. */
#include <stdio.h>
#include <time.h>

#include "apc/common/print.h"
#include "operate.h"
#include "simulation/simulation.h"

#define GRACE APC_NS_PER_S

static const struct cli_spec spec = {
    .args_doc = "CONTROLLER",
    .doc = "Make CONTROLLER the active one of the controllers that act on the same outputs; the former one "
           "is then in shadow. The outputs do not jump. Each controller's loops keep their own target modes "
           "and tuning. The command waits until CONTROLLER acts.",
    .takes = CLI_STORE | CLI_WRITES,
    .min_args = 1,
    .max_args = 1,
};

/* Its tick row changes: no clock of another host is asked. */
static int await_tick(const struct cli *cli, struct apc_store *store, struct promotion *p, apc_ns patience)
{
    const apc_ns until = apc_clock_mono(NULL) + patience;
    const int64_t seen = p->tick.seq;
    struct change_fault why;
    int rc = 0;
    while (rc == 0 && p->tick.seq == seen) {
        if (apc_clock_mono(NULL) > until) {
            rc = promotion_silent(p, &why);
            return cli_error(cli, rc, "%s; --no-wait writes it all the same", why.text);
        }
        nanosleep(&(struct timespec){.tv_nsec = 20 * APC_NS_PER_MS}, NULL);
        rc = promotion_look(p, store);
    }
    return rc < 0 ? cli_store_error(cli, rc, store) : EXIT_OK;
}

/* May it act, if it ticks? */
static int check_promotion(const struct cli *cli, struct apc_store *store, const struct promotion *p)
{
    struct change_fault why;
    struct apc_error reason;
    int rc = promotion_in_service(p, &why);
    const int made = rc == 0 ? simulation_as_described(store, p->to->name, &p->tick, &reason) : 1;
    if (made < 0)
        return cli_error(cli, made, "%s", reason.text);
    if (made == 0)
        rc = promotion_stale(p, &why);
    return rc < 0 ? cli_error(cli, rc, "%s; --no-wait writes it all the same", why.text) : EXIT_OK;
}

static int await_turn(const struct cli *cli, struct apc_store *store, struct promotion *p, apc_ns patience)
{
    const apc_ns until = apc_clock_mono(NULL) + patience;
    const int64_t mine = p->choice.seq;
    int rc = promotion_look(p, store);
    while (rc == 0 && p->choice.seq == mine && !promotion_is_done(p)) {
        if (apc_clock_mono(NULL) > until)
            return cli_error(
                cli, APC_ETIMEDOUT,
                "%s is to act, and does not yet: the other one has not given the outputs back, see "
                "apc status",
                p->to->name);
        nanosleep(&(struct timespec){.tv_nsec = 20 * APC_NS_PER_MS}, NULL);
        rc = promotion_look(p, store);
    }
    if (rc < 0)
        return cli_store_error(cli, rc, store);
    return p->choice.seq == mine
               ? EXIT_OK
               : cli_error(cli, APC_ECONFLICT,
                           "another user has promoted a controller meanwhile: see apc status");
}

static int write_promotion(const struct cli *cli, struct apc_store *store, struct promotion *p)
{
    struct apc_event event;
    struct change_fault why;
    char author[APC_AUTHOR_LEN];
    int rc = cli_live(cli, store);
    if (rc != EXIT_OK)
        return rc;
    operate_who(author, sizeof author);
    rc = promotion_put(p, store, author, "", cli->reason, &event, &why);
    if (rc < 0)
        return cli_error(cli, rc, "%s", why.text);
    rc = apc_store_append_events(store, &event, 1);
    if (rc < 0)
        return cli_error(cli, rc, "the change was made, but not recorded as an event: %s",
                         apc_store_error(store));
    print_clean(stdout, event.text);
    fflush(stdout);
    return EXIT_OK;
}

static int promote(const struct cli *cli, struct apc_store *store, const struct loops *loops)
{
    struct promotion p;
    struct change_fault why;
    int rc = promotion_find(&p, loops, cli->args[0], &why);
    if (rc < 0)
        return cli_error(cli, rc, "%s", why.text);
    if ((rc = promotion_look(&p, store)) < 0)
        return cli_store_error(cli, rc, store);
    const apc_ns patience = 5 * p.to->period + GRACE;
    if (p.choice.seq > 0 && promotion_acting(&p) == p.to && promotion_is_done(&p)) {
        printf("%s acts already%s\n", p.to->name, cli_unkept(cli));
        return EXIT_OK;
    }
    rc = cli->no_wait ? EXIT_OK : await_tick(cli, store, &p, patience);
    if (rc == EXIT_OK && !cli->no_wait)
        rc = check_promotion(cli, store, &p);
    if (rc == EXIT_OK && (rc = write_promotion(cli, store, &p)) == EXIT_OK) {
        rc = cli->no_wait ? EXIT_OK : await_turn(cli, store, &p, patience);
        puts(rc == EXIT_OK && !cli->no_wait ? " (applied)" : "");
    }
    return rc;
}

int command_promote(int argc, char **argv)
{
    struct cli_plant plant = {0};
    struct apc_store *store = NULL;
    struct cli cli;

    cli_parse(&cli, &spec, NULL, argc, argv);
    int rc = exit_code_of(cli_open(&cli, &store));
    if (rc == EXIT_OK)
        rc = exit_code_of(cli_plant_load(&cli, store, &plant));
    if (rc == EXIT_OK)
        rc = promote(&cli, store, &plant.loops);
    cli_plant_free(&plant);
    apc_store_close(store);
    return cli_done(&cli, rc);
}

/* SPDX-License-Identifier: BSD-3-Clause */
/* apc promote: which of several controllers of the same outputs acts. */
#include <stdio.h>
#include <string.h>
#include <time.h>

#include "apc/common/print.h"
#include "files/files.h"
#include "operate.h"

#define GRACE APC_NS_PER_S

static const struct cli_spec spec = {
    .args_doc = "CONTROLLER",
    .doc = "Have a controller act that is in shadow of another one, or was: the other one is then in shadow. "
           "What goes out does not jump. Its loops have target modes and tuning of their own. Waits until it "
           "acts.",
    .takes = CLI_STORE | CLI_WRITES,
    .min_args = 1,
    .max_args = 1,
};

struct promotion {
    const struct cli *cli;
    struct apc_store *store;
    const struct loops *loops;
    const struct loops_controller *to;
    struct apc_sample row[3]; /* the switch; of its first loop the target and the actual mode */
    struct apc_vector tick;   /* of its own */
};

enum { CHOICE, TARGET, ACTUAL };

static int find_controller(struct promotion *p, const char *name)
{
    struct nearest nearest = {.wanted = name};
    p->to = loops_controller(p->loops, name);
    for (size_t i = 0; i < p->loops->n_controllers; i++)
        nearest_look(&nearest, p->loops->controller[i].name);
    if (!p->to)
        return cli_error(p->cli, APC_ENOTFOUND, "there is no controller \"%s\"%s%s%s", name,
                         nearest.name ? ": did you mean \"" : "", nearest.name ? nearest.name : "",
                         nearest.name ? "\"?" : "");
    return EXIT_OK;
}

/* Which takes two persons, of all controllers of its outputs? They are put in shadow or made to act together. */
static const struct loops_controller *takes_two_persons(const struct promotion *p)
{
    const struct loops_loop *mine = &p->loops->at[p->to->first];
    for (size_t i = 0; i < p->loops->n; i++)
        for (size_t k = 0; k < p->to->n; k++) {
            const struct loops_loop *loop = &p->loops->at[i];
            const struct loops_controller *of = &p->loops->controller[loop->controller];
            if (loop->table == mine[k].table && loop->output == mine[k].output &&
                loops_second(p->loops, APC_TICK, of->number) > 0)
                return of;
        }
    return NULL;
}

/* The switch has the number of one of its outputs. */
static int find_switch(struct promotion *p, const struct cli_tags *tags)
{
    const struct loops_loop *first = &p->loops->at[p->to->first];
    const struct loops_controller *two = takes_two_persons(p);
    int id = 0;
    if (two)
        return cli_error(p->cli, APC_EPERM,
                         "%s takes two persons, and apc promote asks no second one: change \"shadow\" in the "
                         "experiment file",
                         two->name);
    for (size_t i = 0; i < p->to->n && !id; i++)
        if (first[i].table && cli_tag(tags, APC_OPMODE, LOOPS_ACTING(first[i].table, first[i].output)))
            id = LOOPS_ACTING(first[i].table, first[i].output);
    if (!id)
        return cli_error(p->cli, APC_EPERM, "%s acts already: no other controller has its outputs",
                         p->to->name);
    p->row[CHOICE] = (struct apc_sample){.table = APC_OPMODE, .id = id};
    p->row[TARGET] = (struct apc_sample){.table = APC_OPMODE, .id = first->id};
    p->row[ACTUAL] =
        (struct apc_sample){.table = APC_ACTUAL, .id = apc_variable_number(APC_OPMODE, first->id)};
    p->tick = (struct apc_vector){.table = APC_TICK, .id = p->to->number};
    return EXIT_OK;
}

static int look_at_promotion(struct promotion *p)
{
    struct apc_rows rows = {
        .size = sizeof rows, .sample = p->row, .n_samples = 3, .vector = &p->tick, .n_vectors = 1};
    int rc = apc_store_read_rows(p->store, &rows);
    return rc < 0 ? cli_store_error(p->cli, rc, p->store) : EXIT_OK;
}

/* Out of service, if that is what is wanted, nobody can see who acts. */
static bool is_promoted_acting(const struct promotion *p)
{
    const bool wanted = p->row[TARGET].seq > 0 && p->row[TARGET].value != (double)APC_MODE_OOS;
    return !wanted || (p->row[ACTUAL].seq > 0 && p->row[ACTUAL].value != (double)APC_MODE_OOS);
}

/* Its tick row changes: no clock of another host is asked. */
static int await_tick(struct promotion *p, apc_ns patience)
{
    const apc_ns until = apc_clock_mono(NULL) + patience;
    const int64_t seen = p->tick.seq;
    int rc = EXIT_OK;
    while (rc == EXIT_OK && p->tick.seq == seen) {
        if (apc_clock_mono(NULL) > until)
            return cli_error(
                p->cli, APC_EPERM,
                "%s does not tick: nobody would act. Nothing was written; --no-wait writes it all the same",
                p->to->name);
        nanosleep(&(struct timespec){.tv_nsec = 20 * APC_NS_PER_MS}, NULL);
        rc = look_at_promotion(p);
    }
    return rc;
}

static int await_turn(struct promotion *p, apc_ns patience)
{
    const apc_ns until = apc_clock_mono(NULL) + patience;
    const int64_t mine = p->row[CHOICE].seq;
    int rc = look_at_promotion(p);
    while (rc == EXIT_OK && p->row[CHOICE].seq == mine && !is_promoted_acting(p)) {
        if (apc_clock_mono(NULL) > until)
            return cli_error(
                p->cli, APC_ETIMEDOUT,
                "%s is to act, and does not yet: the other one has not given the outputs back, see "
                "apc status",
                p->to->name);
        nanosleep(&(struct timespec){.tv_nsec = 20 * APC_NS_PER_MS}, NULL);
        rc = look_at_promotion(p);
    }
    if (rc == EXIT_OK && p->row[CHOICE].seq != mine)
        return cli_error(p->cli, APC_ECONFLICT, "somebody else has promoted meanwhile: see apc status");
    return rc;
}

static int promote(struct promotion *p)
{
    const size_t from =
        p->row[CHOICE].value >= 1 ? (size_t)p->row[CHOICE].value - 1 : p->loops->n_controllers;
    const char *was = p->row[CHOICE].seq > 0 && from < p->loops->n_controllers
                          ? p->loops->controller[from].name
                          : "the file's";
    struct apc_event event = {.time = apc_clock_utc(NULL), .severity = APC_EVENT_INFO, .kind = "operator"};
    struct apc_sample *choice = &p->row[CHOICE];

    int rc = cli_live(p->cli, p->store);
    if (rc != EXIT_OK)
        return rc;
    choice->value = p->to->number;
    choice->time = event.time;
    choice->status = APC_GOOD;
    operate_who(event.source, sizeof event.source);
    rc = apc_store_author(p->store, event.source);
    choice->author = rc > 0 ? (uint32_t)rc : 0;
    rc = rc < 0 ? rc : apc_store_put(p->store, choice, 1);
    if (rc < 0)
        return cli_store_error(p->cli, rc, p->store);
    snprintf(event.text, sizeof event.text, "promoted: %.40s -> %.40s%s%s", was, p->to->name,
             p->cli->reason ? ": " : "", p->cli->reason ? p->cli->reason : "");
    rc = apc_store_append_events(p->store, &event, 1);
    if (rc < 0)
        return cli_error(p->cli, rc, "the change was made, but not recorded as an event: %s",
                         apc_store_error(p->store));
    print_clean(stdout, event.text);
    fflush(stdout);
    return EXIT_OK;
}

static int change_acting(struct promotion *p)
{
    const apc_ns patience = 5 * p->to->period + GRACE;
    if (p->row[CHOICE].seq > 0 && p->row[CHOICE].value == (double)p->to->number && is_promoted_acting(p)) {
        printf("%s acts already%s\n", p->to->name, cli_unkept(p->cli));
        return EXIT_OK;
    }
    int rc = p->cli->no_wait ? EXIT_OK : await_tick(p, patience);
    if (rc == EXIT_OK && (rc = promote(p)) == EXIT_OK) {
        rc = p->cli->no_wait ? EXIT_OK : await_turn(p, patience);
        puts(rc == EXIT_OK && !p->cli->no_wait ? " (applied)" : "");
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
    struct promotion p = {.cli = &cli, .store = store, .loops = &plant.loops};
    if (rc == EXIT_OK)
        rc = find_controller(&p, cli.args[0]);
    if (rc == EXIT_OK)
        rc = find_switch(&p, &plant.tags);
    if (rc == EXIT_OK)
        rc = look_at_promotion(&p);
    if (rc == EXIT_OK)
        rc = change_acting(&p);
    cli_plant_free(&plant);
    apc_store_close(store);
    return cli_done(&cli, rc);
}

/* SPDX-License-Identifier: BSD-3-Clause */
/* apc get, apc set, apc undo: the newest values, and the operator's. */
#include <stddef.h>
#include <stdlib.h>
#include <string.h>

#include "apc/common/past.h"
#include "apc/common/print.h"
#include "experiment/experiment.h"
#include "operate.h"
#include "status_loops.h"

/* ---- get ---------------------------------------------------------------------------------- */

struct get_options {
    const char *at;
};

static const struct option_spec get_options[] = {PAST_OPTION(struct get_options), {0}};

static const struct cli_spec get_spec = {
    .args_doc = "[VARIABLE...]",
    .doc = "Show the newest value of each VARIABLE, or of all described variables; with --at, the value at "
           "that time. A VARIABLE is a name or TABLE.ID, such as sensor.1.",
    .takes = CLI_STORE | CLI_FORMAT,
    .max_args = -1,
    .options = get_options,
};

/* Of a setpoint or an output: what stands between an entry and its effect. NULL: nothing, or it is neither. */
static const struct entry_note *entry_of_sample(const struct status_loops *loops, const struct apc_sample *s)
{
    const struct loops *all = &loops->plant->loops;
    const struct loops_loop *loop = status_loop_of_entry(all, s);
    return loop ? status_loops_entry(loops, (size_t)(loop - all->at)) : NULL;
}

static void get_json(const struct status_loops *loops, const struct apc_sample *samples, int n,
                     const struct past *past)
{
    const struct cli_tags *tags = &loops->plant->tags;
    struct text t = {.out = stdout};
    char author[APC_AUTHOR_LEN];
    json_add(&t, "[");
    for (int i = 0; i < n; i++) {
        json_add(&t, ",\n{");
        print_sample_members(&t, &samples[i], tags, apc_store_now(past->store));
        if (loops->now > 0) {
            json_add(&t, "entry:");
            entry_note_json(entry_of_sample(loops, &samples[i]), &t);
        }
        past_json(past, &t);
        if (past->is &&
            (samples[i].author == 0 || apc_store_author_name(past->store, samples[i].author, author) < 0))
            author[0] = '\0';
        if (past->is)
            json_add(&t, "author:%-s", author);
        json_add(&t, "}");
    }
    json_add(&t, "\n]\n");
}

static void get_csv(const struct apc_sample *samples, int n)
{
    puts(PRINT_SAMPLE_HEADER);
    for (int i = 0; i < n; i++)
        if (samples[i].seq > 0)
            print_sample_csv(stdout, &samples[i]);
}

/* @p named: they are asked for by name. */
static int get_text(const struct status_loops *loops, const struct apc_sample *samples, int n, apc_ns now,
                    bool named)
{
    const struct cli_tags *tags = &loops->plant->tags;
    char name[PRINT_LEN];
    struct print_table table;
    print_table_open(&table, print_sample_columns, 6);
    for (int i = 0; i < n; i++)
        print_sample_cells(&table, tags, &samples[i], now, "");
    const int rc = print_table_end(&table, stdout, cli_colour(), 0);
    for (int i = 0; i < n && named && loops->now > 0; i++) {
        const struct entry_note *entry = entry_of_sample(loops, &samples[i]);
        status_ramps_show(loops, &samples[i]);
        if (entry)
            printf("%s: %s\n", print_name(tags, &samples[i], name), entry->text);
    }
    return rc;
}

/* What is beside an entry, where the store lets it be seen: a role of less than an operator's has the values
 * alone, and `now` stays 0. */
static int load_entries(const struct cli *cli, struct status_loops *loops, struct apc_store *store,
                        const struct apc_sample *samples, int n)
{
    const struct cli_plant *plant = loops->plant;
    const int rc = status_entries_load(loops, store, plant, samples, (size_t)n, cli->format != CLI_JSON);
    if (rc < 0 && rc != APC_EPERM)
        cli_store_error(cli, rc, store);
    if (rc != APC_EPERM)
        return rc;
    status_loops_free(loops);
    *loops = (struct status_loops){.plant = plant};
    return 0;
}

int command_get(int argc, char **argv)
{
    static const enum apc_table shown[] = {APC_SENSOR, APC_SETPOINT, APC_ACTUATOR,
                                           APC_OPMODE, APC_ACTUAL,   APC_MANUAL,
                                           APC_TUNING, APC_DIM,      (enum apc_table)0};
    struct get_options options = {0};
    struct past past;
    struct cli_plant plant = {0};
    struct status_loops loops = {.plant = &plant};
    struct apc_sample *samples = NULL;
    struct cli cli;
    int n = 0;

    cli_parse(&cli, &get_spec, &options, argc, argv);
    int rc = past_open(&cli, "at", options.at, &past);
    if (rc == 0)
        rc = cli_plant_load(&cli, past.store, &plant);
    if (rc == 0)
        rc = n = cli_variables(&cli, &plant.tags, shown, &samples);
    if (rc < 0)
        goto out;
    rc = apc_store_read(past.store, samples, (size_t)n);
    if (rc < 0)
        cli_store_error(&cli, rc, past.store);
    else
        rc = past_check(&past, &cli, samples, (size_t)n);
    if (rc < 0)
        goto out;
    past_show(&past, &cli);
    if (cli.format == CLI_JSON || (cli.format != CLI_CSV && cli.n_args > 0))
        rc = load_entries(&cli, &loops, past.store, samples, n);
    if (rc < 0)
        goto out;
    if (cli.format == CLI_JSON)
        get_json(&loops, samples, n, &past);
    else if (cli.format == CLI_CSV)
        get_csv(samples, n);
    else if ((rc = get_text(&loops, samples, n, apc_store_now(past.store), cli.n_args > 0)) < 0)
        cli_error(&cli, rc, "out of memory");
    past_note(&past, &cli);
out:
    free(samples);
    status_loops_free(&loops);
    cli_plant_free(&plant);
    past_close(&past);
    return cli_done(&cli, exit_code_of(rc));
}

/* ---- set ---------------------------------------------------------------------------------- */

struct set_options {
    bool confirm, stop, apply;
    double over;      /* 0: at once */
    const char *from; /* NULL: the values are arguments */
};

static void check_set_options(void *input, const struct argp_state *state)
{
    const struct set_options *own = input;
    if (own->stop && own->over > 0)
        argp_error(state, "--stop ends a ramp, and --over begins one");
    if (own->from && (own->stop || own->over > 0))
        argp_error(state, "--from takes values at once: without --over and --stop");
    if (own->apply && !own->from)
        argp_error(state, "--apply goes with --from TIME");
}

static const struct option_spec set_options[] = {
    {"confirm", 'c', NULL,
     "Confirm a step that is larger than the `confirm` of its variable in the experiment file", OPTION_FLAG,
     .to = offsetof(struct set_options, confirm)},
    {"over", 'o', "SECONDS", "On a ramp: linearly from the present value, within this time", OPTION_NUMBER,
     .to = offsetof(struct set_options, over), .high = YEAR, .above = true,
     .must = "be seconds, above 0 up to 31622400"},
    {"stop", 0, NULL, "End the ramp of each VARIABLE where it is; give no VALUE", OPTION_FLAG,
     .to = offsetof(struct set_options, stop)},
    {"from", 0, "TIME",
     "Return to the values of TIME, a time as of `apc get --at`: show the differences, and with --apply "
     "write them",
     OPTION_TEXT, .to = offsetof(struct set_options, from)},
    {"apply", 0, NULL, "Write what --from shows, as one change", OPTION_FLAG,
     .to = offsetof(struct set_options, apply)},
    {0},
};

static const struct cli_spec set_spec = {
    .args_doc = "VARIABLE VALUE [VARIABLE VALUE...]\n--stop VARIABLE...\n--from TIME [--apply] [NAME...]",
    .doc = "Write setpoints, or outputs of loops in Man; several pairs are one transaction. A VARIABLE is a "
           "name or TABLE.ID, such as setpoint.1. A setpoint that another controller or the scheduler moves "
           "becomes Local until `apc remote`; its loop then goes from Cas to Auto. The command waits for the "
           "controller and prints the outcome: applied, superseded or refused. If no controller runs, "
           "nothing is written. The controller moves a ramp; it ends at its value, with a new write, or by "
           "--stop. With --from, tuning, modes and setpoints return to those of TIME, for all or for the "
           "loops, controllers and variables NAME; outputs stay.",
    .takes = CLI_STORE | CLI_NEGATIVE | CLI_WRITES,
    .max_args = -1,
    .options = set_options,
    .check = check_set_options,
};

/* Why nobody sets what there is of that name; NULL: there is none. */
static const char *why_not(const struct cli_tags *tags, const char *name)
{
    enum apc_table table;
    int id;
    if (!cli_look(tags, name, &table, &id))
        return NULL;
    switch (table) {
    case APC_SENSOR:
        return "measurements are written by the client only";
    case APC_ACTUATOR:
        return "it is not the output of a loop, so no controller would write it to the plant";
    case APC_OPMODE:
        return loops_is_owner_id(id) ? "whose a setpoint is is changed with \"apc set\" and \"apc remote\""
                                     : "a mode is changed with \"apc mode man\", or \"apc mode LOOP man\"";
    case APC_TUNING:
        return "tuning is changed with \"apc tune NAME=VALUE\"";
    case APC_DIM:
        return "dimensions are written by \"apc init\" only";
    case APC_SETPOINT:
    case APC_MANUAL:
        return NULL;
    default:
        return "it is written by programs only";
    }
}

static int admit_all(const struct cli *cli, const struct cli_tags *tags, const struct set_options *own,
                     struct operation *o)
{
    const unsigned kinds = CHANGE_SETPOINT | CHANGE_OUTPUT;
    for (size_t i = 0; i < o->n; i++) {
        struct change *c = &o->change[i];
        const char *name = cli->args[own->stop ? i : 2 * i], *never = why_not(tags, name);
        struct change_target to;
        struct change_fault why;
        if (never && change_find(o->plant, name, kinds, &to, &why) < 0)
            return cli_error(cli, APC_EPERM, "%s: %s", name, never);
        const int rc = own->stop ? operate_find_any(cli, o->plant, name, kinds, c)
                                 : operate_find(cli, o->plant, name, kinds, c->after.value, c);
        if (rc != EXIT_OK)
            return rc;
        c->stop = own->stop;
        c->over = own->over;
        for (size_t j = 0; j < i; j++)
            if (o->change[j].to.table == c->to.table && o->change[j].to.id == c->to.id)
                return cli_usage(cli, "%s is given twice: give each once", c->to.name);
    }
    return EXIT_OK;
}

static int check_modes(const struct cli *cli, struct apc_store *store, struct operation *o)
{
    struct change_fault why;
    const int err = operation_look(o, store);
    if (err < 0)
        return cli_store_error(cli, err, store);
    for (size_t i = 0; i < o->n; i++)
        if (change_now(o->plant, &o->change[i].to, &o->change[i].mode, &why) < 0)
            return operate_fault(cli, &why);
    return EXIT_OK;
}

static int set_values(const struct cli *cli, struct apc_store *store, struct change *changes, size_t n,
                      const struct set_options *own)
{
    struct cli_plant plant;
    int rc = exit_code_of(cli_plant_load(cli, store, &plant));
    const struct plant_view view = operate_view(&plant);
    struct operation o = {.plant = &view, .change = changes, .n = n, .confirmed = own->confirm};
    if (rc == EXIT_OK)
        rc = admit_all(cli, &plant.tags, own, &o);
    if (rc == EXIT_OK)
        rc = check_modes(cli, store, &o);
    if (rc == EXIT_OK)
        rc = operate(cli, store, &o);
    cli_plant_free(&plant);
    return rc;
}

/* ---- set --from --------------------------------------------------------------------------- */

static int show_retaken(const struct operation *o)
{
    static const struct print_column columns[] = {
        {"NAME", PRINT_LEFT}, {"NOW", PRINT_POINT}, {"THEN", PRINT_POINT}, {"", PRINT_LEFT}};
    struct print_table table;
    char text[CHANGE_TEXT];
    print_table_open(&table, columns, 4);
    for (size_t i = 0; i < o->n; i++) {
        const struct change *c = &o->change[i];
        const struct apc_tag *tag = plant_tag(o->plant, c->to.table, c->to.id);
        struct apc_sample then = c->after;
        const bool given_back = loops_is_owner(&then) && !loops_is_local(&then);
        then.seq = 1;
        print_cell(&table, PRINT_PLAIN, "%s%s", c->to.name,
                   c->to.table == APC_OPMODE && c->to.loop ? " mode" : "");
        print_cell(&table, PRINT_PLAIN, "%s", change_text(&c->before, text));
        print_cell(&table, PRINT_PLAIN, "%s", change_text(&then, text));
        print_cell(&table, PRINT_FAINT, "%s",
                   given_back ? "the scheduler, or the loop above, moves it at once"
                   : tag      ? tag->unit
                              : "");
    }
    return print_table_end(&table, stdout, cli_colour(), 0);
}

static int retake(const struct cli *cli, const struct past *past, const struct set_options *own,
                  const struct plant_view *view, const struct retake *of)
{
    char note[APC_TIME_LEN + 16], time[APC_TIME_LEN];
    struct operation o = {.plant = view, .note = note, .confirmed = own->confirm};
    struct change_fault why;
    int rc = EXIT_OK;
    snprintf(note, sizeof note, " (as of %s)", apc_time_format(apc_store_now(past->store), time));
    if (operation_retake(&o, past->present, of, &why) < 0)
        rc = cli_error(cli, why.err, "%s: nothing was written", why.text);
    else if (o.n == 0)
        printf("nothing differs from what was set as of %s%s\n", time, cli_unkept(cli));
    else if (own->apply)
        rc = operate(cli, past->present, &o);
    else if (show_retaken(&o) < 0)
        rc = cli_error(cli, APC_ENOMEM, "out of memory");
    else
        puts("nothing was written: --apply writes it");
    free(o.change);
    return rc;
}

static int set_from(const struct cli *cli, const struct set_options *own)
{
    struct cli_plant plant = {0};
    struct apc_tag *then = NULL;
    struct apc_error why;
    struct past past;
    size_t n = 0;
    int rc = exit_code_of(past_open(cli, "from", own->from, &past));
    if (rc == EXIT_OK)
        rc = cli_live(cli, past.present);
    if (rc == EXIT_OK)
        rc = exit_code_of(cli_plant_load(cli, past.present, &plant));
    if (rc == EXIT_OK && (rc = experiment_tags_then(past.store, past.present, NULL, &then, &n, &why)) < 0)
        rc = cli_error(cli, rc, "%s", why.text);
    const struct plant_view view = operate_view(&plant);
    const struct retake of = {.past = past.store,
                              .tag = then,
                              .n = n,
                              .name = (const char *const *)cli->args,
                              .n_names = (size_t)cli->n_args};
    if (rc == EXIT_OK)
        rc = retake(cli, &past, own, &view, &of);
    free(then);
    cli_plant_free(&plant);
    past_close(&past);
    return cli_done(cli, rc);
}

int command_set(int argc, char **argv)
{
    struct apc_store *store = NULL;
    struct set_options own = {0};
    struct cli cli;

    cli_parse(&cli, &set_spec, &own, argc, argv);
    if (own.from) {
        const int rc = own.apply ? EXIT_OK : cli_only_shows(&cli);
        return rc == EXIT_OK ? set_from(&cli, &own) : rc;
    }
    if (cli.n_args == 0)
        return cli_usage(&cli, "expected %s", own.stop ? "VARIABLE..." : "VARIABLE VALUE");
    if (!own.stop && cli.n_args % 2)
        return cli_usage(&cli, "\"%s\" has no value: each takes VARIABLE VALUE", cli.args[cli.n_args - 1]);
    size_t n = (size_t)cli.n_args / (own.stop ? 1 : 2);
    struct change *changes = calloc(n, sizeof *changes);
    if (!changes)
        return cli_error(&cli, APC_ENOMEM, "out of memory");
    struct change_fault why;
    int rc = EXIT_OK;
    for (size_t i = 0; i < n && rc == EXIT_OK && !own.stop; i++)
        if (change_number(cli.args[2 * i + 1], &changes[i].after.value, &why) < 0)
            rc = cli_usage(&cli, "%s: %s", cli.args[2 * i], why.text);
    if (rc == EXIT_OK && (rc = exit_code_of(cli_open(&cli, &store))) == EXIT_OK)
        rc = set_values(&cli, store, changes, n, &own);
    apc_store_close(store);
    free(changes);
    return cli_done(&cli, rc);
}

/* ---- undo --------------------------------------------------------------------------------- */

static const struct cli_spec undo_spec = {
    .doc = "Take back your last write of a setpoint, an output, a mode or tuning, by apc or the page: the "
           "value before is written again. The write must be less than a minute old, and nobody may have "
           "changed its variable since. A second undo takes back the first.",
    .takes = CLI_STORE | CLI_WRITES,
};

static int undo_last(const struct cli *cli, struct apc_store *store, const struct cli_plant *plant)
{
    char who[APC_AUTHOR_LEN];
    struct change_fault why;
    const struct plant_view view = operate_view(plant);
    struct operation o = {.plant = &view, .author = who, .note = " (undo)"};
    operate_who(who, sizeof who);
    const int err = operation_undo(&o, store, 0, &why);
    const int rc = err == 0                         ? operate(cli, store, &o)
                   : strcmp(why.code, "store") == 0 ? cli_store_error(cli, err, store)
                                                    : operate_fault(cli, &why);
    free(o.change);
    return rc;
}

int command_undo(int argc, char **argv)
{
    struct apc_store *store = NULL;
    struct cli_plant plant = {0};
    struct cli cli;

    cli_parse(&cli, &undo_spec, NULL, argc, argv);
    int rc = exit_code_of(cli_open(&cli, &store));
    if (rc == EXIT_OK)
        rc = cli_live(&cli, store);
    if (rc == EXIT_OK)
        rc = exit_code_of(cli_plant_load(&cli, store, &plant));
    if (rc == EXIT_OK)
        rc = undo_last(&cli, store, &plant);
    cli_plant_free(&plant);
    apc_store_close(store);
    return cli_done(&cli, rc);
}

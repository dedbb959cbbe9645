/* SPDX-License-Identifier: BSD-3-Clause */
/* apc get, apc set: the newest values, and the operator's. */
#include <stdlib.h>
#include <string.h>

#include "apc/common/print.h"
#include "operate.h"

/* ---- get ---------------------------------------------------------------------------------- */

static const struct cli_spec get_spec = {
    .args_doc = "[VARIABLE...]",
    .doc = "Show the newest value of each VARIABLE, or of all that are described. A VARIABLE is a name or "
           "TABLE.ID, such as sensor.1.",
    .takes = CLI_STORE | CLI_FORMAT,
    .max_args = -1,
};

static void get_json(const struct cli_tags *tags, const struct apc_sample *samples, int n, apc_ns now)
{
    for (int i = 0; i < n; i++) {
        fputs(i == 0 ? "[\n" : ",\n", stdout);
        print_sample_json(stdout, &samples[i], tags, now);
    }
    fputs("\n]\n", stdout);
}

static void get_csv(const struct apc_sample *samples, int n)
{
    puts(PRINT_SAMPLE_HEADER);
    for (int i = 0; i < n; i++)
        if (samples[i].seq > 0)
            print_sample_csv(stdout, &samples[i]);
}

static int get_text(const struct cli_tags *tags, const struct apc_sample *samples, int n, apc_ns now)
{
    struct print_table table;
    print_table_open(&table, print_sample_columns, 6);
    for (int i = 0; i < n; i++)
        print_sample_cells(&table, tags, &samples[i], now, "");
    int rc = print_table_show(&table, stdout, cli_colour(), 0, "\n");
    print_table_close(&table);
    return rc;
}

int command_get(int argc, char **argv)
{
    static const enum apc_table shown[] = {APC_SENSOR, APC_SETPOINT, APC_ACTUATOR,
                                           APC_OPMODE, APC_ACTUAL,   APC_MANUAL,
                                           APC_TUNING, APC_DIM,      (enum apc_table)0};
    struct apc_store *store = NULL;
    struct cli_tags tags = {0};
    struct apc_sample *samples = NULL;
    struct cli cli;
    int n = 0;

    cli_parse(&cli, &get_spec, NULL, argc, argv);
    int rc = cli_open(&cli, &store);
    if (rc == 0)
        rc = cli_tags_load(&cli, store, &tags);
    if (rc == 0)
        rc = n = cli_variables(&cli, &tags, shown, &samples);
    if (rc < 0)
        goto out;
    rc = apc_store_read(store, samples, (size_t)n);
    if (rc < 0) {
        cli_store_error(&cli, rc, store);
        goto out;
    }
    if (cli.format == CLI_JSON)
        get_json(&tags, samples, n, apc_clock_utc(NULL));
    else if (cli.format == CLI_CSV)
        get_csv(samples, n);
    else if ((rc = get_text(&tags, samples, n, apc_clock_utc(NULL))) < 0)
        cli_error(&cli, rc, "out of memory");
out:
    free(samples);
    cli_tags_free(&tags);
    apc_store_close(store);
    return cli_done(&cli, exit_code_of(rc));
}

/* ---- set ---------------------------------------------------------------------------------- */

static const struct cli_spec set_spec = {
    .args_doc = "VARIABLE VALUE [VARIABLE VALUE...]",
    .doc =
        "Write setpoints or, of loops in Man, outputs; several pairs in one transaction. A VARIABLE is a "
        "name "
        "or TABLE.ID, such as setpoint.1. A setpoint that another controller or the scheduler moves is taken "
        "from it, until `apc remote`; its loop then goes from Cas to Auto. Waits until the controller has "
        "it, and says what became of "
        "it: applied, superseded or refused; where no controller ticks, nothing is written.",
    .takes = CLI_STORE | CLI_NEGATIVE | CLI_WRITES,
    .min_args = 2,
    .max_args = -1,
};

static int parse_values(const struct cli *cli, struct change *changes, size_t n)
{
    for (size_t i = 0; i < n; i++)
        if (apc_number_parse(cli->args[2 * i + 1], &changes[i].after.value) < 0)
            return cli_usage(cli, "%s: \"%s\" is not a finite number", cli->args[2 * i],
                             cli->args[2 * i + 1]);
    return EXIT_OK;
}

/* What an operator writes of a loop's output, shown as what goes out. */
static int admit_output(const struct cli *cli, const struct cli_plant *plant, const struct loops_loop *loop,
                        struct change *c)
{
    if (!loop || !loop->manual || !loop->table)
        return cli_error(cli, APC_EPERM, "%s: it is the output of no loop: nobody would put it out", c->name);
    c->after.table = APC_MANUAL;
    c->after.id = loop->manual;
    c->before = (struct apc_sample){.table = loop->table, .id = loop->output};
    c->tag = cli_tag(&plant->tags, APC_MANUAL, loop->manual);
    snprintf(c->name, sizeof c->name, "%s", loop->name);
    return EXIT_OK;
}

/* Is the variable one that may be set? To an output the operator writes through table manual. */
static int admit(const struct cli *cli, const struct cli_plant *plant, struct change *c)
{
    const char *why = "it is written by programs only";
    switch (c->after.table) {
    case APC_ACTUATOR:
    case APC_MANUAL:
        return admit_output(cli, plant, loops_of(&plant->loops, c->after.table, c->after.id), c);
    case APC_SETPOINT:
        c->before = (struct apc_sample){.table = APC_SETPOINT, .id = c->after.id};
        c->tag = cli_tag(&plant->tags, APC_SETPOINT, c->after.id);
        if (!c->tag)
            return cli_error(cli, APC_ENOTFOUND,
                             "%s is not described, so its limits are not known; `apc init FILE` describes "
                             "the variables of an experiment",
                             c->name);
        snprintf(c->name, sizeof c->name, "%s", c->tag->name);
        return EXIT_OK;
    case APC_SENSOR:
        why = "measurements are written by the client only";
        break;
    case APC_OPMODE:
        why = loops_is_owner(&c->after) ? "whose a setpoint is is changed with \"apc set\" and \"apc remote\""
                                        : "a mode is changed with \"apc mode man\", or \"apc mode LOOP man\"";
        break;
    case APC_TUNING:
        why = "tuning is changed with \"apc tune NAME=VALUE\"";
        break;
    case APC_DIM:
        why = "dimensions are written by \"apc init\" only";
        break;
    default:
        break;
    }
    return cli_error(cli, APC_EPERM, "%s: %s", c->name, why);
}

/* Where a measurement has the same name, what may be set is meant; a loop's name is its output's. */
static int find_named_value(const struct cli *cli, const struct cli_plant *plant, const char *name,
                            struct apc_sample *found)
{
    const struct loops_loop *loop = loops_find(&plant->loops, name);
    for (size_t i = 0; i < plant->tags.n; i++) {
        const struct apc_tag *tag = &plant->tags.tag[i];
        if ((tag->table == APC_SETPOINT || tag->table == APC_ACTUATOR) && !strcmp(tag->name, name)) {
            found->table = tag->table;
            found->id = tag->id;
            return 0;
        }
    }
    if (loop && loop->manual) {
        found->table = APC_MANUAL;
        found->id = loop->manual;
        return 0;
    }
    return cli_find(cli, &plant->tags, name, &found->table, &found->id);
}

static int admit_all(const struct cli *cli, const struct operation *o)
{
    for (size_t i = 0; i < o->n; i++) {
        struct change *c = &o->change[i];
        snprintf(c->name, sizeof c->name, "%s", cli->args[2 * i]);
        int rc = find_named_value(cli, o->plant, cli->args[2 * i], &c->after);
        if (rc < 0)
            return exit_code_of(rc);
        if ((rc = admit(cli, o->plant, c)) != EXIT_OK || (rc = operate_check(cli, c)) != EXIT_OK)
            return rc;
        for (size_t j = 0; j < i; j++)
            if (o->change[j].after.table == c->after.table && o->change[j].after.id == c->after.id)
                return cli_usage(cli, "%s is given twice", c->name);
    }
    return EXIT_OK;
}

/* As the loop's target @p mode is, may it be set? */
static int check_mode_takes_value(const struct cli *cli, const struct cli_plant *plant,
                                  const struct change *c, const struct loops_loop *loop,
                                  const struct apc_sample *mode)
{
    const struct apc_tag *y = cli_tag(&plant->tags, APC_SENSOR, loop->measurement);
    const bool man = mode->seq > 0 && mode->value == (double)APC_MODE_MAN;
    char text[PRINT_LEN], how[APC_TAG_LEN + 16] = "man";
    if (plant->loops.n > 1)
        snprintf(how, sizeof how, "%s man", loop->name);
    if (c->after.table == APC_MANUAL && !man && mode->seq == 0)
        return cli_error(cli, APC_EPERM, "%s cannot be set while no mode is; \"apc mode %s\" first", c->name,
                         how);
    if (c->after.table == APC_MANUAL && !man)
        return cli_error(cli, APC_EPERM, "%s is controlled in mode %s; \"apc mode %s\" first", c->name,
                         print_value(mode, text), how);
    if (c->after.table == APC_SETPOINT && man && loop->above >= 0)
        return cli_error(cli, APC_EPERM, "%s follows %s while %s is in Man", c->name,
                         y ? y->name : "its measurement", loop->name);
    return EXIT_OK;
}

static int check_modes(const struct cli *cli, struct apc_store *store, const struct operation *o)
{
    int rc = EXIT_OK;
    for (size_t i = 0; i < o->n && rc == EXIT_OK; i++) {
        const struct apc_sample *after = &o->change[i].after;
        const struct loops_loop *loop = loops_of(&o->plant->loops, after->table, after->id);
        struct apc_sample mode = {.table = APC_OPMODE, .id = loop ? loop->id : 0};
        int err = loop ? apc_store_read(store, &mode, 1) : 0;
        if (err < 0)
            return cli_store_error(cli, err, store);
        rc = loop ? check_mode_takes_value(cli, o->plant, &o->change[i], loop, &mode) : EXIT_OK;
    }
    return rc;
}

static int set_values(const struct cli *cli, struct apc_store *store, struct change *changes, size_t n)
{
    struct cli_plant plant;
    const struct operation o = {.plant = &plant, .change = changes, .n = n};
    int rc = exit_code_of(cli_plant_load(cli, store, &plant));
    if (rc == EXIT_OK)
        rc = admit_all(cli, &o);
    int err = rc == EXIT_OK ? operate_read(store, changes, n) : 0;
    if (err < 0)
        rc = cli_store_error(cli, err, store);
    if (rc == EXIT_OK)
        rc = check_modes(cli, store, &o);
    if (rc == EXIT_OK)
        rc = operate(cli, store, &o);
    cli_plant_free(&plant);
    return rc;
}

int command_set(int argc, char **argv)
{
    struct apc_store *store = NULL;
    struct cli cli;

    cli_parse(&cli, &set_spec, NULL, argc, argv);
    if (cli.n_args % 2)
        return cli_usage(&cli, "\"%s\" has no value", cli.args[cli.n_args - 1]);
    size_t n = (size_t)cli.n_args / 2;
    struct change *changes = calloc(n, sizeof *changes);
    if (!changes)
        return cli_error(&cli, APC_ENOMEM, "out of memory");
    int rc = parse_values(&cli, changes, n);
    if (rc == EXIT_OK && (rc = exit_code_of(cli_open(&cli, &store))) == EXIT_OK)
        rc = set_values(&cli, store, changes, n);
    apc_store_close(store);
    free(changes);
    return cli_done(&cli, rc);
}

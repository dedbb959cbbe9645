/* SPDX-License-Identifier: BSD-3-Clause */
/* apc mode, apc remote: in which mode each loop is, and who moves its setpoint. */
#include <stdlib.h>
#include <string.h>
#include <strings.h>

#include "apc/common/mode_reason.h"
#include "apc/common/print.h"
#include "operate.h"
#include "status_loops.h"

static const struct cli_spec mode_spec = {
    .args_doc = "[LOOP|CONTROLLER] [man|auto|cas|oos]",
    .doc =
        "Show the target and actual mode of each loop, of one loop, or of a controller's loops; or change "
        "the target mode, without a name that of all loops. A loop has the name of its output; a loop that "
        "moves a setpoint is CONTROLLER.SETPOINT. Auto: the law makes the output. Cas: as Auto, with the "
        "setpoint that the controller above writes. Man: the operator sets the output; it stays where it is "
        "until `apc set` changes it. OOS: nothing goes out. The command waits until the loop is in the mode.",
    .takes = CLI_STORE | CLI_FORMAT | CLI_WRITES,
    .max_args = 2,
};

static const struct cli_spec remote_spec = {
    .args_doc = "SETPOINT...",
    .doc = "Return a setpoint from Local to Remote. The controller above moves it again, and the target mode "
           "of its loop becomes Cas; or the scheduler does, and writes the step that is due. `apc set "
           "SETPOINT VALUE` makes it Local. The command waits until the setpoint is moved.",
    .takes = CLI_STORE | CLI_WRITES,
    .min_args = 1,
    .max_args = -1,
};

/* ---- Which loops -------------------------------------------------------------------------- */

/* Those of which a command tells or that it changes, in their order. */
struct chosen {
    const struct loops_loop **loop;
    size_t n;
    char group[APC_TAG_LEN + 8]; /* "mode", "base mode"; "": one, by its name */
};

/* By the name of a loop or of a controller; NULL: all. */
static int choose_loops(const struct cli *cli, const struct cli_plant *plant, const char *name,
                        struct chosen *c)
{
    const struct plant_view view = operate_view(plant);
    const struct loops *loops = &plant->loops;
    struct change_target none;
    struct change_fault why;
    const struct loops_controller *controller = name ? loops_controller(loops, name) : NULL;
    const struct loops_loop *loop = name ? loops_find(loops, name) : NULL;
    /* NOLINTNEXTLINE(bugprone-sizeof-expression): an array of pointers */
    *c = (struct chosen){.loop = calloc(loops->n + 1, sizeof *c->loop)};
    if (!c->loop)
        return cli_error(cli, APC_ENOMEM, "out of memory");
    if (name && !loop && !controller) {
        (void)change_find(&view, name, CHANGE_MODE, &none, &why);
        return cli_error(cli, why.err, "%s%s", why.text,
                         cli->n_args == 1 ? "; modes are OOS, Man, Auto and Cas" : "");
    }
    if (loops->n == 0)
        return cli_error(cli, APC_ENOTFOUND,
                         "no loops are described yet: `apc init FILE` describes those of an experiment");
    for (size_t i = 0; i < loops->n; i++)
        if (!name || &loops->at[i] == loop ||
            (!loop && &loops->controller[loops->at[i].controller] == controller))
            c->loop[c->n++] = &loops->at[i];
    if (!name || loops->n == 1)
        snprintf(c->group, sizeof c->group, "mode");
    else if (!loop)
        snprintf(c->group, sizeof c->group, "%s mode", controller->name);
    return EXIT_OK;
}

/* Targets, then actual modes. NULL: without memory, or an error of the store that was said. */
static struct apc_sample *read_loop_modes(const struct cli *cli, struct apc_store *store,
                                          const struct chosen *c, int *rc)
{
    struct apc_sample *mode = calloc(2 * c->n + 1, sizeof *mode);
    for (size_t i = 0; mode && i < c->n; i++) {
        mode[i] = (struct apc_sample){.table = APC_OPMODE, .id = c->loop[i]->id};
        mode[c->n + i] =
            (struct apc_sample){.table = APC_ACTUAL, .id = apc_variable_number(APC_OPMODE, c->loop[i]->id)};
    }
    int err = mode ? apc_store_read(store, mode, 2 * c->n) : APC_ENOMEM;
    *rc = err >= 0 ? EXIT_OK : mode ? cli_store_error(cli, err, store) : cli_error(cli, err, "out of memory");
    if (err < 0) {
        free(mode);
        mode = NULL;
    }
    return mode;
}

#define WHY_LEN (REASON_LEN + 40)

/* ---- Showing ------------------------------------------------------------------------------ */

static const char *mode_word(const struct apc_sample *mode)
{
    return mode->seq > 0 && mode->value >= 0 ? apc_mode_name((int)mode->value) : NULL;
}

/* The one that all have; NULL: they differ, or have none. */
static const char *common(const struct apc_sample *mode, size_t n)
{
    const char *word = mode_word(&mode[0]);
    for (size_t i = 1; i < n && word; i++)
        if (!mode_word(&mode[i]) || strcmp(word, mode_word(&mode[i])) != 0)
            word = NULL;
    return word;
}

/* Why the loop is not in its target, and that its modes are its last; NULL: neither. */
static const char *reason_of(const struct status_loops *s, const struct loops_loop *loop, char text[WHY_LEN])
{
    const size_t i = (size_t)(loop - s->plant->loops.at);
    const struct entry_note *entry = status_loops_entry(s, i);
    const bool stopped = entry && !strcmp(entry->code, "stopped");
    snprintf(text, WHY_LEN, "%s%s%s", s->reason[i], stopped && s->reason[i][0] ? "; " : "",
             stopped ? entry->text : "");
    return text[0] ? text : NULL;
}

static void show_modes_json(const struct status_loops *s, const struct chosen *c,
                            const struct apc_sample *mode)
{
    struct text t = {.out = stdout};
    char why[WHY_LEN];
    json_add(&t, "{target:%s, actual:%s, loops:[", common(mode, c->n), common(mode + c->n, c->n));
    for (size_t i = 0; i < c->n; i++)
        json_add(&t, ",\n{loop:%s, controller:%s, target:%s, actual:%s, reason:%s}", c->loop[i]->name,
                 s->plant->loops.controller[c->loop[i]->controller].name, mode_word(&mode[i]),
                 mode_word(&mode[c->n + i]), reason_of(s, c->loop[i], why));
    json_add(&t, "]}\n");
}

static void show_one(const struct apc_sample mode[2], const char *reason)
{
    static const char *const names[] = {"target", "actual"};
    char age[PRINT_LEN];
    for (int i = 0; i < 2; i++) {
        const char *word = mode_word(&mode[i]);
        printf("%s  ", names[i]);
        if (word)
            printf("%-4s  for %s", word, print_age(apc_clock_utc(NULL) - mode[i].time, age));
        else
            fputs("none", stdout);
        if (i == 1 && reason) {
            fputs(": ", stdout);
            print_clean(stdout, reason);
        }
        putchar('\n');
    }
}

static int show_table(const struct status_loops *s, const struct chosen *c, const struct apc_sample *mode)
{
    static const struct print_column columns[] = {{"LOOP", PRINT_LEFT},   {"CONTROLLER", PRINT_LEFT},
                                                  {"TARGET", PRINT_LEFT}, {"ACTUAL", PRINT_LEFT},
                                                  {"SINCE", PRINT_POINT}, {"", PRINT_LEFT}};
    struct print_table table;
    char text[PRINT_LEN], why[WHY_LEN];
    print_table_open(&table, columns, 6);
    for (size_t i = 0; i < c->n; i++) {
        const char *target = mode_word(&mode[i]), *actual = mode_word(&mode[c->n + i]);
        const char *reason = reason_of(s, c->loop[i], why);
        print_cell(&table, PRINT_PLAIN, "%s", c->loop[i]->name);
        print_cell(&table, PRINT_PLAIN, "%s", s->plant->loops.controller[c->loop[i]->controller].name);
        print_cell(&table, PRINT_PLAIN, "%s", target ? target : "none");
        print_cell(&table, reason ? PRINT_WARN : PRINT_PLAIN, "%s", actual ? actual : "none");
        print_cell(&table, PRINT_PLAIN, "%s",
                   actual ? print_age(apc_clock_utc(NULL) - mode[c->n + i].time, text) : "");
        print_cell(&table, PRINT_WARN, "%s", reason ? reason : "");
    }
    return print_table_end(&table, stdout, cli_colour(), 0);
}

static int show_modes(const struct cli *cli, struct apc_store *store, const struct cli_plant *plant,
                      const struct chosen *c)
{
    struct status_loops s = {0};
    char why[WHY_LEN];
    int rc;
    struct apc_sample *mode = read_loop_modes(cli, store, c, &rc);
    if (!mode)
        return rc;
    const int err = status_loops_load(&s, store, plant, NULL);
    if (err < 0)
        rc = err == APC_ENOMEM ? cli_error(cli, err, "out of memory") : cli_store_error(cli, err, store);
    else if (cli->format == CLI_JSON)
        show_modes_json(&s, c, mode);
    else if (cli->format == CLI_TEXT && c->n == 1)
        show_one(mode, reason_of(&s, c->loop[0], why));
    else if (cli->format == CLI_TEXT && show_table(&s, c, mode) < 0)
        rc = cli_error(cli, APC_ENOMEM, "out of memory");
    else if (cli->format == CLI_CSV) {
        puts(PRINT_SAMPLE_HEADER);
        for (size_t i = 0; i < 2 * c->n; i++)
            if (mode[i].seq > 0)
                print_sample_csv(stdout, &mode[i]);
    }
    status_loops_free(&s);
    free(mode);
    return rc;
}

/* ---- Changing ----------------------------------------------------------------------------- */

/* All have that target already: that they are not in it, or that nobody ticks, is no success. */
static int already(const struct cli *cli, struct apc_store *store, const struct cli_plant *plant,
                   const struct chosen *c, const struct apc_sample *mode, struct operation *o)
{
    const char *word = mode_word(&mode[0]);
    char why[REASON_LEN];
    for (size_t i = 0; i < c->n && !cli->no_wait; i++) {
        const struct apc_sample *actual = &mode[c->n + i];
        if (!mode_word(actual) || actual->value == mode[i].value)
            continue;
        const char *reason = mode_reason_find(store, &plant->loops, c->loop[i], &mode[i], actual, why);
        return cli_error(cli, APC_EPERM, "the target is %s already, but %s is in %s: %s", word,
                         c->loop[i]->name, mode_word(actual), reason ? reason : "see apc status");
    }
    const int rc = cli->no_wait ? EXIT_OK : operate_ready(cli, store, o);
    if (rc != EXIT_OK)
        return rc;
    printf("%s%s: %s already%s\n", c->group[0] ? c->group : c->loop[0]->name, c->group[0] ? "" : " mode",
           word, cli_unkept(cli));
    return EXIT_OK;
}

static int make_modes(const struct cli *cli, const struct plant_view *view, const struct chosen *c,
                      enum apc_mode wanted, struct change *changes)
{
    struct change_target to;
    struct change_fault why;
    for (size_t i = 0; i < c->n; i++) {
        if (change_at(view, APC_OPMODE, c->loop[i]->id, &to, &why) < 0 ||
            change_cascade(c->loop[i]->name, c->loop[i]->above >= 0, (double)wanted, &why) < 0)
            return operate_fault(cli, &why);
        change_make(view, &to, (double)wanted, &changes[i]);
    }
    return EXIT_OK;
}

static int change_modes(const struct cli *cli, struct apc_store *store, const struct cli_plant *plant,
                        const struct chosen *c, enum apc_mode wanted)
{
    const struct plant_view view = operate_view(plant);
    struct change *changes = calloc(c->n + 1, sizeof *changes);
    struct operation o = {
        .plant = &view, .change = changes, .n = c->n, .group = c->group[0] ? c->group : NULL};
    int rc =
        changes ? make_modes(cli, &view, c, wanted, changes) : cli_error(cli, APC_ENOMEM, "out of memory");
    struct apc_sample *mode = rc == EXIT_OK ? read_loop_modes(cli, store, c, &rc) : NULL;
    bool same = true;
    for (size_t i = 0; mode && i < c->n; i++)
        same &= mode[i].seq > 0 && mode[i].value == (double)wanted;
    if (mode)
        rc = same ? already(cli, store, plant, c, mode, &o) : operate(cli, store, &o);
    free(changes);
    free(mode);
    return rc;
}

/* One that nobody can ask for counts as well. */
static bool is_mode(const char *word)
{
    int mode = APC_MODE_MAN;
    while (mode <= APC_MODE_LO && strcasecmp(word, apc_mode_name(mode)) != 0)
        mode++;
    return mode <= APC_MODE_LO;
}

int command_mode(int argc, char **argv)
{
    struct change_fault why;
    double wanted = 0;
    struct cli_plant plant = {0};
    struct apc_store *store = NULL;
    struct chosen chosen = {0};
    struct cli cli;

    cli_parse(&cli, &mode_spec, NULL, argc, argv);
    const char *last = cli.n_args > 0 ? cli.args[cli.n_args - 1] : NULL;
    const bool changes = last && change_mode(last, &wanted, &why) == 0;
    const char *name = cli.n_args == 2 || (last && !changes) ? cli.args[0] : NULL;
    if (last && !changes && (cli.n_args == 2 || is_mode(last)))
        return cli_usage(&cli, "%s", why.text);
    if (changes && cli.format != CLI_TEXT)
        return cli_usage(&cli, "--json and --csv show the mode; they do not go with a change");
    int rc = changes ? EXIT_OK : cli_only_shows(&cli);
    if (rc == EXIT_OK)
        rc = exit_code_of(cli_open(&cli, &store));
    if (rc == EXIT_OK)
        rc = exit_code_of(cli_plant_load(&cli, store, &plant));
    if (rc == EXIT_OK)
        rc = choose_loops(&cli, &plant, name, &chosen);
    if (rc == EXIT_OK)
        rc = changes ? change_modes(&cli, store, &plant, &chosen, (enum apc_mode)wanted)
                     : show_modes(&cli, store, &plant, &chosen);
    free(chosen.loop);
    cli_plant_free(&plant);
    apc_store_close(store);
    return cli_done(&cli, rc);
}

/* ---- remote ------------------------------------------------------------------------------- */

struct given {
    struct chosen loops; /* to controllers above */
    int *setpoint;       /* to the scheduler */
    size_t n;
};

static bool is_given(const struct given *g, int setpoint)
{
    for (size_t i = 0; i < g->loops.n; i++)
        if (g->loops.loop[i]->setpoint == setpoint)
            return true;
    for (size_t i = 0; i < g->n; i++)
        if (g->setpoint[i] == setpoint)
            return true;
    return false;
}

static int choose_setpoint(const struct cli *cli, const struct cli_plant *plant, const char *name,
                           struct given *g)
{
    enum apc_table table = APC_SETPOINT;
    int id = 0;
    for (size_t i = 0; i < plant->tags.n && !id; i++)
        if (plant->tags.tag[i].table == APC_SETPOINT && !strcmp(plant->tags.tag[i].name, name))
            id = plant->tags.tag[i].id;
    int rc = id ? 0 : cli_find(cli, &plant->tags, name, &table, &id);
    if (rc < 0)
        return exit_code_of(rc);
    if (table != APC_SETPOINT)
        return cli_error(cli, APC_EPERM, "%s is no setpoint: apc mode changes the mode of a loop", name);
    if (is_given(g, id))
        return cli_usage(cli, "%s is given twice: give each once", name);
    const struct loops_loop *loop = loops_of(&plant->loops, table, id);
    if (loop && loop->setpoint == id && loop->above >= 0)
        g->loops.loop[g->loops.n++] = loop;
    else if (loops_scheduled(&plant->loops, id))
        g->setpoint[g->n++] = id;
    else
        return cli_error(cli, APC_EPERM,
                         "%s: neither a controller nor the scheduler moves it: it is always Local", name);
    return EXIT_OK;
}

/* The switches, and with them the setpoints as they stand. */
static void make_remote(struct operation *o, const int *setpoint)
{
    struct change_target to = {.table = APC_OPMODE, .high = 1};
    for (size_t i = 0; i < o->n; i++) {
        to.id = LOOPS_OWNER(setpoint[i]);
        snprintf(to.name, sizeof to.name, "%s", plant_tag(o->plant, APC_SETPOINT, setpoint[i])->name);
        change_make(o->plant, &to, 1, &o->change[i]);
    }
}

/* Give setpoints back to the scheduler. */
static int change_to_remote(const struct cli *cli, struct apc_store *store, const struct cli_plant *plant,
                            const struct given *g)
{
    const struct plant_view view = operate_view(plant);
    struct operation o = {.plant = &view, .change = calloc(g->n, sizeof *o.change), .n = g->n};
    bool local = false;
    int rc = o.change ? cli_live(cli, store) : cli_error(cli, APC_ENOMEM, "out of memory");
    if (rc == EXIT_OK) {
        make_remote(&o, g->setpoint);
        const int read = operation_read(&o, store);
        rc = read < 0 ? cli_store_error(cli, read, store) : EXIT_OK;
    }
    for (size_t i = 0; i < o.n && rc == EXIT_OK; i++)
        local |= loops_is_local(&o.change[i].before);
    for (size_t i = 0; i < o.n && rc == EXIT_OK && !local; i++) {
        print_clean(stdout, o.change[i].to.name);
        printf(": Remote already%s\n", cli_unkept(cli));
    }
    if (rc == EXIT_OK && local)
        rc = operate(cli, store, &o);
    free(o.change);
    return rc;
}

int command_remote(int argc, char **argv)
{
    struct cli_plant plant = {0};
    struct apc_store *store = NULL;
    struct given given = {0};
    struct cli cli;

    cli_parse(&cli, &remote_spec, NULL, argc, argv);
    int rc = exit_code_of(cli_open(&cli, &store));
    if (rc == EXIT_OK)
        rc = exit_code_of(cli_plant_load(&cli, store, &plant));
    /* NOLINTNEXTLINE(bugprone-sizeof-expression): an array of pointers */
    given.loops.loop = calloc((size_t)cli.n_args, sizeof *given.loops.loop);
    given.setpoint = calloc((size_t)cli.n_args, sizeof *given.setpoint);
    const bool room = given.loops.loop && given.setpoint;
    if (rc == EXIT_OK && !room)
        rc = cli_error(&cli, APC_ENOMEM, "out of memory");
    for (int i = 0; room && i < cli.n_args && rc == EXIT_OK; i++)
        rc = choose_setpoint(&cli, &plant, cli.args[i], &given);
    if (room && rc == EXIT_OK && given.loops.n > 0)
        rc = change_modes(&cli, store, &plant, &given.loops, APC_MODE_CAS);
    if (room && rc == EXIT_OK && given.n > 0)
        rc = change_to_remote(&cli, store, &plant, &given);
    free(given.loops.loop);
    free(given.setpoint);
    cli_plant_free(&plant);
    apc_store_close(store);
    return cli_done(&cli, rc);
}

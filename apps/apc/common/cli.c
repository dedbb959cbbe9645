/* SPDX-License-Identifier: BSD-3-Clause */
#include "cli.h"

#include <errno.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#include "apc/folder/runstore.h"
#include "base/text.h"
#include "common/storeuri.h"
#include "files/files.h"
#include "past.h"
#include "print.h"

#define NAMES 12 /* that are listed where one is not known */

enum { OPT_JSON = 0x300, OPT_CSV, OPT_NO_WAIT };

static const struct argp_option store_options[] = {{"store", 's', "URI", 0, STORE_HELP, 0}, {0}};
static const struct argp_option format_options[] = {
    {"json", OPT_JSON, NULL, 0, "JSON on stdout", 0}, {"csv", OPT_CSV, NULL, 0, "CSV on stdout", 0}, {0}};
static const struct argp_option write_options[] = {
    {"no-wait", OPT_NO_WAIT, NULL, 0, "Write even if no controller runs, and do not wait for the outcome", 0},
    {"reason", 'r', "TEXT", 0, "Reason, for the record; at most 80 bytes", 0},
    {0}};

/* What getopt would take for options of one digit. */
#define DIGIT(key)                                                                                           \
    {                                                                                                        \
        NULL, key, "DIGITS", OPTION_ARG_OPTIONAL | OPTION_HIDDEN, NULL, 0                                    \
    }
static const struct argp_option negative_options[] = {DIGIT('0'), DIGIT('1'), DIGIT('2'), DIGIT('3'),
                                                      DIGIT('4'), DIGIT('5'), DIGIT('6'), DIGIT('7'),
                                                      DIGIT('8'), DIGIT('9'), DIGIT('.'), {0}};

static error_t parse_store(int key, char *arg, struct argp_state *state)
{
    struct cli *cli = state->input;
    if (key != 's')
        return ARGP_ERR_UNKNOWN;
    cli->store = arg;
    return 0;
}

static error_t parse_format(int key, char *arg, struct argp_state *state)
{
    struct cli *cli = state->input;
    (void)arg;
    if (key != OPT_JSON && key != OPT_CSV)
        return ARGP_ERR_UNKNOWN;
    cli->format = key == OPT_JSON ? CLI_JSON : CLI_CSV;
    return 0;
}

static error_t parse_write(int key, char *arg, struct argp_state *state)
{
    struct cli *cli = state->input;
    struct change_fault why;
    if (key == OPT_NO_WAIT)
        cli->no_wait = true;
    else if (key == 'r' && change_reason(cli->reason = arg, &why) < 0)
        argp_error(state, "%s", why.text);
    return key == OPT_NO_WAIT || key == 'r' ? 0 : ARGP_ERR_UNKNOWN;
}

static const struct argp store_argp = {store_options, parse_store, NULL, NULL, NULL, NULL, NULL};
static const struct argp format_argp = {format_options, parse_format, NULL, NULL, NULL, NULL, NULL};
static const struct argp write_argp = {write_options, parse_write, NULL, NULL, NULL, NULL, NULL};

struct parsing {
    struct cli *cli;
    const struct cli_spec *spec;
    struct option_input own;
};

/* Inputs of the children, in the order in which cli_parse() lists them. */
static void give_inputs(struct parsing *p, struct argp_state *state)
{
    int child = 0;
    if (p->spec->options)
        state->child_inputs[child++] = &p->own;
    if (p->spec->takes & CLI_STORE)
        state->child_inputs[child++] = p->cli;
    if (p->spec->takes & CLI_FORMAT)
        state->child_inputs[child++] = p->cli;
    if (p->spec->takes & CLI_WRITES)
        state->child_inputs[child] = p->cli;
}

/* Gather arguments in their order, over argv itself: an argument never stood before where it goes. */
static error_t add_arg(struct parsing *p, char *arg)
{
    if (!(p->spec->takes & CLI_NEGATIVE))
        return ARGP_ERR_UNKNOWN; /* ARGP_KEY_ARGS then gives them all at once */
    p->cli->args[p->cli->n_args++] = arg;
    return 0;
}

static error_t parse_args(int key, char *arg, struct argp_state *state)
{
    struct parsing *p = state->input;
    switch (key) {
    case ARGP_KEY_INIT:
        give_inputs(p, state);
        p->cli->args = state->argv + 1;
        break;
    case ARGP_KEY_ARG:
        return add_arg(p, arg);
    case ARGP_KEY_ARGS:
        p->cli->args = state->argv + state->next;
        p->cli->n_args = state->argc - state->next;
        break;
    case ARGP_KEY_END:
        if (p->cli->n_args < p->spec->min_args)
            argp_error(state, "expected %s", p->spec->args_doc);
        if (p->spec->max_args >= 0 && p->cli->n_args > p->spec->max_args)
            argp_error(state, "unexpected argument \"%s\"", p->cli->args[p->spec->max_args]);
        break;
    default:
        if (key != '.' && (key < '0' || key > '9'))
            return ARGP_ERR_UNKNOWN;
        return add_arg(p, state->argv[state->next - 1]);
    }
    return 0;
}

void cli_find_store(struct cli *cli)
{
    static char uri[RUNSTORE_LEN];
    struct apc_error why;
    struct stat at;
    if (!cli->store || (cli->takes & CLI_MAKES_STORE))
        return;
    const bool there = stat(cli->store, &at) == 0;
    if (!strchr(cli->store, ':') && !(there && S_ISDIR(at.st_mode)))
        exit(cli_error(cli, APC_ENOTFOUND,
                       "--store: %s: there is no such folder: expected that of a run, or postgresql:, "
                       "postgresql://..., sqlite:FILE, shm:NAME%s",
                       cli->store, there ? "; of a SQLite file write sqlite: before its name" : ""));
    if (there && S_ISDIR(at.st_mode)) {
        const int rc = runstore_uri(cli->store, uri, &why);
        if (rc < 0)
            exit(cli_error(cli, rc, "%s%s", cli->store_given ? "--store: " : "", why.text));
        cli->folder = cli->store;
        cli->store = uri;
    }
    const size_t live = apc_store_live(cli->store);
    if (cli->store[live] && runstore_gone(cli->store)) {
        cli->stores = cli->store;
        cli->store += live + 1;
    }
    store_follow(cli->store);
}

void cli_parse(struct cli *cli, const struct cli_spec *spec, void *own, int argc, char **argv)
{
    static char name[64];
    struct parsing parsing = {cli, spec, {.option = spec->options, .check = spec->check, .own = own}};
    struct argp_option list[2 * OPTIONS_MAX + 1];
    const struct argp own_argp = {list, option_parse, NULL, NULL, NULL, NULL, NULL};
    struct argp_child children[5] = {{0}};
    int child = 0;

    *cli = (struct cli){.takes = spec->takes, .timeout = 10 * APC_NS_PER_S};
    snprintf(name, sizeof name, "apc %s", argv[0]);
    argv[0] = name;
    cli->command = name;
    if (spec->options) {
        option_list(spec->options, list);
        children[child++] = (struct argp_child){&own_argp, 0, NULL, 0};
    }
    if (spec->takes & CLI_STORE)
        children[child++] = (struct argp_child){&store_argp, 0, NULL, 0};
    if (spec->takes & CLI_FORMAT)
        children[child++] = (struct argp_child){&format_argp, 0, NULL, 0};
    if (spec->takes & CLI_WRITES)
        children[child++] = (struct argp_child){&write_argp, 0, NULL, 0};
    bool negative = spec->takes & CLI_NEGATIVE;
    const struct argp argp = {
        negative ? negative_options : NULL, parse_args, spec->args_doc, spec->doc, children, NULL, NULL};
    argp_err_exit_status = EXIT_USAGE;
    argp_parse(&argp, argc, argv, negative ? ARGP_IN_ORDER : 0, NULL, &parsing);
    cli->store_given = cli->store;
    if (!cli->store)
        cli->store = getenv("APC_STORE");
    cli->unnamed = !cli->store || !*cli->store;
    if (cli->unnamed)
        cli->store = spec->takes & CLI_OWN_STORE ? NULL : "postgresql:";
    cli_find_store(cli);
}

static void APC_PRINTF(2, 0) say_prefixed(const struct cli *cli, const char *fmt, va_list args)
{
    char *text = NULL;

    fflush(stdout);
    fprintf(stderr, "%s: ", cli->command);
    if (vasprintf(&text, fmt, args) >= 0)
        print_clean(stderr, text);
    free(text);
    fputc('\n', stderr);
}

int cli_error(const struct cli *cli, int err, const char *fmt, ...)
{
    va_list args;
    va_start(args, fmt);
    say_prefixed(cli, fmt, args);
    va_end(args);
    return exit_code_of(err);
}

int cli_usage(const struct cli *cli, const char *fmt, ...)
{
    va_list args;
    va_start(args, fmt);
    say_prefixed(cli, fmt, args);
    va_end(args);
    fprintf(stderr, "Try `%s --help' for more information.\n", cli->command);
    return EXIT_USAGE;
}

int cli_done(const struct cli *cli, int rc)
{
    if (fflush(stdout) == 0 && !ferror(stdout))
        return rc;
    cli_error(cli, APC_ESYS, "cannot write the results: %s", strerror(errno));
    return rc == EXIT_OK ? EXIT_ERROR : rc;
}

int cli_only_shows(const struct cli *cli)
{
    return cli->reason || cli->no_wait
               ? cli_usage(cli, "%s goes with a write, and nothing is written here: leave it out",
                           cli->reason ? "--reason" : "--no-wait")
               : EXIT_OK;
}

const char *cli_unkept(const struct cli *cli)
{
    return cli->reason ? ": nothing was written, nor the reason" : "";
}

int cli_store_error(const struct cli *cli, int err, const struct apc_store *store)
{
    const char *why = apc_store_error(store);
    if (cli->unnamed && err == APC_ECONN && !getenv("PGHOST") && !getenv("PGSERVICE") &&
        !getenv("PGDATABASE"))
        return cli_error(
            cli, err,
            "no store is named: give --store and a run's folder (--store runs/...), or set APC_STORE "
            "to what `apc run` prints; without either it is the PostgreSQL of this host, and: %s",
            *why ? why : apc_err_text(err));
    return cli_error(cli, err, "%s%s", *why ? why : apc_err_text(err),
                     cli->unnamed && err == APC_ECONN ? " (neither --store nor APC_STORE says which store)"
                                                      : "");
}

int cli_init(const struct cli *cli, struct apc_store *store)
{
    const int had = apc_store_init(store);
    const bool postgresql = cli->store && strncmp(cli->store, "postgres", 8) == 0;
    if (had > 0 && had < apc_store_version())
        printf("tables brought from version %d to %d%s\n", had, apc_store_version(),
               postgresql ? "; where roles are used, run sql/roles.sql again" : "");
    return had;
}

int cli_live(const struct cli *cli, struct apc_store *store)
{
    const int history = apc_store_is_history(store);
    if (history < 0)
        return cli_store_error(cli, history, store);
    return history == 0 ? EXIT_OK
                        : cli_error(cli, APC_EPERM,
                                    "the store is a history, which no loop reads: write to the live store "
                                    "instead (apc set, mode and tune ask its historian)");
}

int cli_open(const struct cli *cli, struct apc_store **store)
{
    const struct apc_store_options options = {.size = sizeof options, .name = "apc", .timeout = cli->timeout};
    struct apc_error why;
    int rc = store_open(store, cli->store, &options, &why);
    if (rc < 0)
        cli_error(cli, rc, "%s", why.text);
    return rc;
}

bool cli_colour(void)
{
    const char *no = getenv("NO_COLOR");
    return isatty(STDOUT_FILENO) && !(no && *no);
}

/* 30s, 10m, 2h, 1d */
static bool parse_duration(const char *text, apc_ns *duration)
{
    static const char units[] = "smhd";
    static const double seconds[] = {1, 60, 3600, 86400};
    char number[32];
    size_t length = strlen(text);
    double value;

    if (length < 2 || length > sizeof number)
        return false;
    const char *unit = strchr(units, text[length - 1]);
    memcpy(number, text, length - 1);
    number[length - 1] = '\0';
    return unit && apc_number_parse(number, &value) == 0 && value >= 0 &&
           apc_ns_from_s(value * seconds[unit - units], duration) == 0;
}

int cli_seconds(const struct cli *cli, const char *name, const char *text, double *t)
{
    *t = (double)NAN;
    if (!text || (apc_number_parse(text, t) == 0 && *t >= 0))
        return EXIT_OK;
    return cli_usage(cli, "--%s \"%s\": must be s since the start of the run, 0 or more", name, text);
}

int cli_duration(const struct cli *cli, const char *option, const char *text, apc_ns *duration)
{
    if (!text || (parse_duration(text, duration) && *duration > 0 && *duration < apc_clock_utc(NULL)))
        return EXIT_OK;
    return cli_usage(cli, "--%s \"%s\": must be a duration above zero, as 30s, 10m, 2h, 90d", option, text);
}

bool cli_date(const char *text, apc_ns *time)
{
    char whole[APC_TIME_LEN + 16];
    const char *rest = strlen(text) == 10 ? "T00:00:00" : strlen(text) == 16 ? ":00" : "";
    snprintf(whole, sizeof whole, "%s%s", text, rest);
    return strlen(text) < APC_TIME_LEN + 6 && apc_time_parse(whole, time) == 0;
}

bool cli_when(const char *text, apc_ns *time)
{
    const apc_ns now = apc_clock_utc(NULL);
    const bool minus = text[0] == '-';
    apc_ns before;
    double seconds;
    const bool given =
        parse_duration(text + minus, &before) || (minus && apc_number_parse(text + 1, &seconds) == 0 &&
                                                  seconds >= 0 && apc_ns_from_s(seconds, &before) == 0);
    if (given && before < now)
        *time = now - before;
    return given ? before < now : cli_date(text, time);
}

int cli_time(const struct cli *cli, const char *option, const char *text, apc_ns *time)
{
    double seconds;
    if (!text || past_time(cli, text, time))
        return text ? past_check_end(cli, text, *time) : EXIT_OK;
    if (apc_number_parse(text, &seconds) == 0 && seconds >= 0)
        return cli_usage(cli,
                         "--%s \"%s\": must be a time; seconds since the start of a run are of its folder: "
                         "--store FOLDER; before now, -%s",
                         option, text, text);
    return cli_usage(cli,
                     "--%s \"%s\": must be a time, as 2026-01-31T12:00:00Z, 2026-01-31, or before "
                     "now, as 30s, 10m, 2h, 1d; seconds alone as -600",
                     option, text);
}

int cli_tags_load(const struct cli *cli, struct apc_store *store, struct cli_tags *tags)
{
    *tags = (struct cli_tags){0};
    int n = apc_store_get_tags(store, NULL, 0);
    if (n < 0) {
        cli_store_error(cli, n, store);
        return n;
    }
    tags->tag = calloc(n > 0 ? (size_t)n : 1, sizeof *tags->tag);
    if (!tags->tag) {
        cli_error(cli, APC_ENOMEM, "out of memory");
        return APC_ENOMEM;
    }
    int got = apc_store_get_tags(store, tags->tag, (size_t)n);
    if (got < 0) {
        cli_store_error(cli, got, store);
        cli_tags_free(tags);
        return got;
    }
    tags->n = (size_t)(got < n ? got : n);
    return 0;
}

void cli_tags_free(struct cli_tags *tags)
{
    free(tags->tag);
    *tags = (struct cli_tags){0};
}

int cli_plant_load(const struct cli *cli, struct apc_store *store, struct cli_plant *plant)
{
    *plant = (struct cli_plant){0};
    int rc = cli_tags_load(cli, store, &plant->tags);
    if (rc < 0)
        return rc;
    rc = loops_load(&plant->loops, store, plant->tags.tag, plant->tags.n);
    if (rc < 0)
        cli_store_error(cli, rc, store);
    return rc;
}

void cli_plant_free(struct cli_plant *plant)
{
    loops_free(&plant->loops);
    cli_tags_free(&plant->tags);
}

bool cli_is_loop(const struct apc_tag *tag)
{
    return tag->table == APC_OPMODE && tag->id > 0 && tag->controller[0];
}

const struct apc_tag *cli_tag(const struct cli_tags *tags, enum apc_table table, int id)
{
    for (size_t i = 0; i < tags->n; i++)
        if (tags->tag[i].table == table && tags->tag[i].id == id)
            return &tags->tag[i];
    return NULL;
}

/* TABLE.ID */
static bool parse_address(const char *text, enum apc_table *table, int *id)
{
    const char *dot = strchr(text, '.');
    char name[32], *end;
    if (!dot || dot == text || (size_t)(dot - text) >= sizeof name)
        return false;
    memcpy(name, text, (size_t)(dot - text));
    name[dot - text] = '\0';
    long number = strtol(dot + 1, &end, 10);
    *table = apc_table_parse(name);
    *id = (int)number;
    return *table && dot[1] >= '0' && dot[1] <= '9' && !*end && number <= 1000000;
}

/* Programs' own: rows that are no numbers, and the name of the experiment. */
static bool is_inside(const struct apc_tag *tag)
{
    return !tag->name[0] || tag->table == APC_STATE || apc_table_vectors(tag->table);
}

/* LOOP.mode */
static const struct apc_tag *find_mode(const struct cli_tags *tags, const char *text)
{
    const size_t n = strlen(text), of = strlen(".mode");
    for (size_t i = 0; i < tags->n && n > of; i++)
        if (cli_is_loop(&tags->tag[i]) && strlen(tags->tag[i].name) == n - of &&
            !strncmp(tags->tag[i].name, text, n - of) && !strcmp(text + n - of, ".mode"))
            return &tags->tag[i];
    return NULL;
}

static bool is_tag_named(const struct apc_tag *tag, const char *name)
{
    return !strcmp(tag->name, name) || (tag->table == APC_TUNING && former_is(name, tag->name));
}

void cli_former(const struct cli *cli, const char *former, const char *present)
{
    cli_error(cli, 0,
              "warning: \"%s\" is called \"%s\" now; this version is the last that takes the former name",
              former, present);
}

/* "y" may be a measurement and what is set for it; no other two things are called the same without saying
 * which. */
static int find_settable_name(const struct cli *cli, const struct cli_tags *tags, const char *text,
                              const struct apc_tag **found)
{
    *found = find_mode(tags, text);
    if (*found)
        return 0;
    for (size_t i = 0; i < tags->n; i++) {
        const struct apc_tag *tag = &tags->tag[i], *first = *found;
        if (!is_tag_named(tag, text) || cli_is_loop(tag) || is_inside(tag))
            continue;
        if (first &&
            (first->table != APC_SENSOR || (tag->table != APC_SETPOINT && tag->table != APC_ACTUATOR))) {
            cli_error(cli, APC_EINVAL, "\"%s\" names two things: say %s.%d or %s.%d", text,
                      apc_table_name(first->table), first->id, apc_table_name(tag->table), tag->id);
            return APC_EINVAL;
        }
        if (!first)
            *found = tag;
    }
    return 0;
}

/* What there is, or when that is more than a line, what is most like it. */
int cli_unknown(const struct cli *cli, const struct cli_tags *tags, const char *text, enum apc_table table)
{
    char names[300] = "", more[64] = "";
    struct nearest nearest = {.wanted = text};
    size_t n = 0;
    for (size_t i = 0; i < tags->n; i++) {
        const struct apc_tag *tag = &tags->tag[i];
        if (is_inside(tag) || cli_is_loop(tag) || (table && tag->table != table))
            continue;
        size_t used = strlen(names);
        n++;
        nearest_look(&nearest, tag->name);
        if (n <= NAMES)
            snprintf(names + used, sizeof names - used, "%s%s", used ? ", " : "", tag->name);
    }
    if (n > NAMES)
        snprintf(more, sizeof more, " and %zu more", n - NAMES);
    const char *what = table == APC_TUNING ? "parameter of the control law" : "variable";
    if (nearest.name)
        cli_error(cli, APC_ENOTFOUND, "no %s \"%s\": did you mean \"%s\"? There are: %s%s", what, text,
                  nearest.name, names, more);
    else
        cli_error(cli, APC_ENOTFOUND, "no %s \"%s\"; there are: %s%s, or TABLE.ID such as %s.1", what, text,
                  *names ? names : "none described yet (apc init FILE)", more, table ? "tuning" : "sensor");
    return APC_ENOTFOUND;
}

bool cli_look(const struct cli_tags *tags, const char *text, enum apc_table *table, int *id)
{
    const struct apc_tag *tag = find_mode(tags, text);
    for (size_t i = 0; i < tags->n && !tag; i++)
        if (is_tag_named(&tags->tag[i], text) && !cli_is_loop(&tags->tag[i]) && !is_inside(&tags->tag[i]))
            tag = &tags->tag[i];
    if (!tag)
        return parse_address(text, table, id) && !apc_table_vectors(*table) && cli_tag(tags, *table, *id);
    *table = tag->table;
    *id = tag->id;
    return true;
}

int cli_find(const struct cli *cli, const struct cli_tags *tags, const char *text, enum apc_table *table,
             int *id)
{
    const struct apc_tag *tag;
    int rc = find_settable_name(cli, tags, text, &tag);
    if (rc < 0)
        return rc;
    if (tag) {
        if (former_is(text, tag->name))
            cli_former(cli, text, tag->name);
        *table = tag->table;
        *id = tag->id;
        return 0;
    }
    /* By its address only what is described, but where nothing is described yet. */
    if (parse_address(text, table, id) && !apc_table_vectors(*table) &&
        (tags->n == 0 || cli_tag(tags, *table, *id)))
        return 0;
    return cli_unknown(cli, tags, text, (enum apc_table)0);
}

static int no_room(const struct cli *cli)
{
    cli_error(cli, APC_ENOMEM, "out of memory");
    return APC_ENOMEM;
}

/* Of the target modes those of the loops are shown, or of one loop what the paper calls its mode. */
static bool is_tag_shown(const struct apc_tag *tag, size_t loops)
{
    if (tag->table != APC_OPMODE)
        return true;
    return cli_is_loop(tag) ? loops > 1 : tag->id == 0 && loops <= 1;
}

int cli_described(const struct cli *cli, const struct cli_tags *tags, const enum apc_table *tables,
                  struct apc_sample **out)
{
    int n = 0;
    size_t loops = 0;
    *out = calloc(tags->n + 1, sizeof **out);
    if (!*out)
        return no_room(cli);
    for (size_t i = 0; i < tags->n; i++)
        loops += cli_is_loop(&tags->tag[i]);
    for (; *tables; tables++)
        for (size_t i = 0; i < tags->n; i++)
            if (tags->tag[i].table == *tables && is_tag_shown(&tags->tag[i], loops))
                (*out)[n++] = (struct apc_sample){.table = *tables, .id = tags->tag[i].id};
    return n;
}

int cli_variables(const struct cli *cli, const struct cli_tags *tags, const enum apc_table *tables,
                  struct apc_sample **out)
{
    if (cli->n_args == 0) {
        int n = cli_described(cli, tags, tables, out);
        if (n != 0)
            return n;
        cli_error(cli, APC_ENOTFOUND,
                  "no variables are described yet: `apc init FILE` describes those of an experiment");
        return APC_ENOTFOUND;
    }
    *out = calloc((size_t)cli->n_args, sizeof **out);
    if (!*out)
        return no_room(cli);
    for (int i = 0; i < cli->n_args; i++) {
        int rc = cli_find(cli, tags, cli->args[i], &(*out)[i].table, &(*out)[i].id);
        if (rc < 0)
            return rc;
    }
    return cli->n_args;
}

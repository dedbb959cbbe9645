/* SPDX-License-Identifier: BSD-3-Clause */
/* apc why: what moved an output, of a recorded run or of one whose record is in a store. */
#include "simulation/simulation.h"

#include <math.h>
#include <string.h>

#include "apc/common/cli.h"
#include "apc/common/print.h"
#include "files/files.h"

#define DEPTH 4 /* loops above one another that are followed */

struct why_options {
    double over; /* s; 0: the tick alone */
};

#define AT(member) .to = offsetof(struct why_options, member)
static const struct option_spec own_options[] = {
    {"over", 0, "SECONDS", "Explain the move over so long a time until then, instead of one tick",
     OPTION_NUMBER, AT(over), .high = 366 * 86400.0, .must = "be seconds, from 0 to 366 days"},
    {0},
};

static const struct cli_spec spec = {
    .args_doc = "[RUN] OUTPUT[@TIME]",
    .doc = "Why output OUTPUT moved at TIME, in run folder RUN or, without one, in the store; without TIME "
           "at the "
           "last tick. TIME is RFC 3339 or, of a folder, seconds since the start of the run or, in a store, "
           "before "
           "now as 30s, 10m, 2h, 1d. Each input that changed is held as it was before, and the tick computed "
           "again: the difference is its effect. Only ticks that come out of the record bit for bit are "
           "explained. A setpoint that a loop above moved is followed upwards.",
    .takes = CLI_STORE | CLI_FORMAT,
    .min_args = 1,
    .max_args = 2,
    .options = own_options,
};

struct why_command {
    struct cli cli;
    struct why_options options;
    struct replay replay;
    struct apc_store *store; /* NULL: of a run folder, which is loaded */
    char loop[APC_TAG_LEN];
    apc_ns at;
    struct text json;
};

static int fail_why(const struct why_command *c, int err, const char *text)
{
    cli_error(&c->cli, err, "%s", text);
    return err;
}

/* ---- Words ----------------------------------------------------------------------------------- */

static const char *kind_name(enum why_kind kind)
{
    static const char *const name[] = {[WHY_SETPOINT] = "setpoint",
                                       [WHY_MEASUREMENT] = "measurement",
                                       [WHY_DISTURBANCE] = "disturbance",
                                       [WHY_TUNING] = "tuning",
                                       [WHY_MODE] = "mode",
                                       [WHY_MANUAL] = "manual output",
                                       [WHY_BELOW] = "loop below",
                                       [WHY_ABOVE] = "loop above",
                                       [WHY_ACTING] = "promoted",
                                       [WHY_LAW] = "law"};
    return name[kind];
}

static const char *state_name(enum apc_loop_state state)
{
    static const char *const name[APC_LOOP_END] = {
        [APC_LOOP_OOS] = "OOS",       [APC_LOOP_MAN] = "Man",           [APC_LOOP_AUTO] = "Auto",
        [APC_LOOP_CAS] = "Cas",       [APC_LOOP_INIT] = "IMan",         [APC_LOOP_HOLD] = "held",
        [APC_LOOP_BACKUP] = "backup", [APC_LOOP_FAULT] = "fault value", [APC_LOOP_SHADOW] = "shadow"};
    return state > 0 && state < APC_LOOP_END ? name[state] : "none";
}

static const char *cause_name(const struct why *w, const struct why_cause *cause)
{
    return cause->tag ? cause->tag->name : w->by->of->name;
}

/* A value with its status where that is not Good; "" where it is no number. */
static char *value_text(const struct why_cause *cause, double value, apc_status status, char text[PRINT_LEN])
{
    char of[APC_STATUS_NAME_LEN];
    struct apc_sample sample = {
        .table = cause->kind == WHY_MODE ? APC_OPMODE : APC_SENSOR, .seq = 1, .value = value};
    text[0] = '\0';
    if (isnan(value))
        return text;
    print_value(&sample, text);
    if (apc_status_severity(status) != APC_SEVERITY_GOOD) {
        const size_t n = strlen(text);
        snprintf(text + n, PRINT_LEN - n, " %s", apc_status_format(status, of));
    }
    return text;
}

/* Who wrote the row, and why, as the operators' events of the run say; "": none does. */
struct author {
    char source[APC_TAG_LEN], text[200];
};

static bool is_of_variable(const char *text, const char *name)
{
    const size_t n = strlen(name);
    return strncmp(text, name, n) == 0 && (text[n] == ':' || text[n] == ' ' || text[n] == '.');
}

struct author_search {
    const struct why_cause *cause;
    struct author *author;
};

static int take_author(void *ctx, const struct apc_event *event)
{
    const struct author_search *s = ctx;
    if (strcmp(event->kind, "operator") != 0 || !is_of_variable(event->text, s->cause->tag->name))
        return 0;
    snprintf(s->author->source, sizeof s->author->source, "%s", event->source);
    snprintf(s->author->text, sizeof s->author->text, "%s", event->text);
    return 0;
}

/* The row itself says who; the event, where there is one at its time, says why too. */
static int find_author_in_store(const struct why_command *c, const struct why_cause *cause,
                                struct author *author)
{
    const struct apc_range range = {.since = cause->row->time - APC_NS_PER_US,
                                    .until = cause->row->time + APC_NS_PER_US};
    struct author_search search = {cause, author};
    char name[APC_AUTHOR_LEN] = "";
    const int rc = apc_store_events(c->store, &range, take_author, &search);
    if (rc < 0)
        return fail_why(c, rc, apc_store_error(c->store));
    if (cause->row->author > 0 && apc_store_author_name(c->store, cause->row->author, name) >= 0 && name[0])
        snprintf(author->source, sizeof author->source, "%s", name);
    return 0;
}

static int find_author_in_folder(const struct why_command *c, const struct why_cause *cause,
                                 struct author *author)
{
    char path[600];
    struct csv *csv;
    struct apc_error none;
    int rc = 0;
    snprintf(path, sizeof path, "%.580s/events.csv", c->cli.args[0]);
    if (csv_open(&csv, path, &none) < 0)
        return 0;
    const double at = apc_ns_to_s(cause->row->time - c->replay.start);
    while (csv_expect(csv, "time,severity,source,kind,text", &none) == 0 && (rc = csv_next(csv, &none)) > 0) {
        double t;
        const char *text = csv_text(csv, 4);
        if (strcmp(csv_text(csv, 3), "operator") != 0 || csv_number(csv, 0, &t, &none) < 0 ||
            fabs(t - at) > 1e-6 || !is_of_variable(text, cause->tag->name))
            continue;
        snprintf(author->source, sizeof author->source, "%s", csv_text(csv, 2));
        snprintf(author->text, sizeof author->text, "%s", text);
    }
    csv_close(csv);
    return rc;
}

static int find_row_author(const struct why_command *c, const struct why_cause *cause, struct author *author)
{
    *author = (struct author){{0}, {0}};
    if (!cause->row || !cause->tag)
        return 0;
    return c->store ? find_author_in_store(c, cause, author) : find_author_in_folder(c, cause, author);
}

/* A time as people are told it, with a unit; as programs are: seconds since the start of the run, or UTC. */
static const char *when_text(const struct why_command *c, apc_ns time, char text[APC_TIME_LEN])
{
    if (c->store)
        return apc_time_format(time, text);
    snprintf(text, APC_TIME_LEN, "%.3f s", apc_ns_to_s(time - c->replay.start));
    return text;
}

static double when_number(const struct why_command *c, apc_ns time)
{
    return apc_ns_to_s(c->store ? time : time - c->replay.start);
}

/* ---- For people ------------------------------------------------------------------------------ */

static void print_effect(struct print_table *table, const struct why *w, double effect)
{
    const double move = w->u - w->u_before;
    print_cell(table, PRINT_PLAIN, "%+.4g", effect);
    if (move < 0 || move > 0)
        print_cell(table, PRINT_PLAIN, "%.0f", 100 * effect / move + 0.0);
    else
        print_cell(table, PRINT_PLAIN, "%s", "");
}

static int print_causes(const struct why *w)
{
    static const struct print_column columns[] = {{"input", PRINT_LEFT},   {"", PRINT_LEFT},
                                                  {"before", PRINT_RIGHT}, {"now", PRINT_RIGHT},
                                                  {"effect", PRINT_POINT}, {"%", PRINT_RIGHT}};
    const double rounding = 1e-12 * (fabs(w->u) + fabs(w->u_before));
    struct print_table table;
    char text[PRINT_LEN];
    print_table_open(&table, columns, sizeof columns / sizeof *columns);
    for (size_t i = 0; i < w->n; i++) {
        const struct why_cause *cause = &w->cause[i];
        if (cause->effect == 0)
            continue;
        print_cell(&table, PRINT_PLAIN, "%s", cause_name(w, cause));
        print_cell(&table, PRINT_PLAIN, "%s", kind_name(cause->kind));
        print_cell(&table, PRINT_PLAIN, "%s", value_text(cause, cause->before, cause->status_before, text));
        print_cell(&table, PRINT_PLAIN, "%s", value_text(cause, cause->now, cause->status, text));
        print_effect(&table, w, cause->effect);
    }
    const struct {
        const char *what, *of;
        double effect;
    } rest[] = {{"(none of them)", "the loop goes on", w->earlier},
                {"(together)", "not one alone", w->together}};
    for (size_t i = 0; i < sizeof rest / sizeof *rest; i++) {
        if (fabs(rest[i].effect) <= rounding)
            continue;
        print_cell(&table, PRINT_PLAIN, "%s", rest[i].what);
        print_cell(&table, PRINT_FAINT, "%s", rest[i].of);
        print_cell(&table, PRINT_PLAIN, "%s", "");
        print_cell(&table, PRINT_PLAIN, "%s", "");
        print_effect(&table, w, rest[i].effect);
    }
    const int rc = table.n > 0 ? print_table_show(&table, stdout, cli_colour(), 0, "\n") : 0;
    print_table_close(&table);
    return rc;
}

/* Inputs that changed and moved nothing stand at the end. */
static void print_idle(const struct why *w)
{
    const char *before = "no effect: ";
    for (size_t i = 0; i < w->n; i++) {
        if (w->cause[i].effect != 0)
            continue;
        fputs(before, stdout);
        print_clean(stdout, cause_name(w, &w->cause[i]));
        printf(" (%s)", kind_name(w->cause[i].kind));
        before = ", ";
    }
    if (*before == ',')
        putchar('\n');
}

static const char *direction(unsigned limited)
{
    return limited == (APC_LIMITED_LOW | APC_LIMITED_HIGH) ? "both ways"
           : limited & APC_LIMITED_HIGH                    ? "upwards"
                                                           : "downwards";
}

static void print_move_limit(const struct why *w)
{
    if (w->u >= w->high)
        printf("  at its high limit, %.6g\n", w->high);
    else if (w->u <= w->low)
        printf("  at its low limit, %.6g\n", w->low);
    else if (w->limited)
        printf("  a limit of the law or of the rate holds it back %s\n", direction(w->limited));
    if (w->blocked)
        printf("  the loop below cannot follow %s\n", direction(w->blocked));
}

static int print_why(const struct why_command *c, const struct why *w)
{
    char before[PRINT_LEN], now[PRINT_LEN], time[APC_TIME_LEN];
    const char *unit = w->output ? w->output->unit : "";
    print_clean(stdout, w->loop);
    printf(": %s -> %s%s%s, tick at %s of %s", print_exact(w->u_before, before), print_exact(w->u, now),
           *unit ? " " : "", unit, when_text(c, w->tick->time, time), w->by->of->name);
    if (w->state_before != w->state)
        printf(", %s -> %s", state_name(w->state_before), state_name(w->state));
    else
        printf(", %s", state_name(w->state));
    fputs(w->reason[0] ? ": " : "", stdout);
    print_clean(stdout, w->reason);
    putchar('\n');
    print_move_limit(w);
    int rc = print_causes(w);
    print_idle(w);
    for (size_t i = 0; i < w->n && rc >= 0; i++) {
        struct author author;
        rc = find_row_author(c, &w->cause[i], &author);
        if (author.source[0]) {
            printf("%s  ", when_text(c, w->cause[i].row->time, time));
            print_clean(stdout, author.source);
            fputs(author.text[0] ? ": " : "", stdout);
            print_clean(stdout, author.text);
            putchar('\n');
        }
    }
    return rc < 0 ? rc : 0;
}

/* ---- For programs ---------------------------------------------------------------------------- */

static int put_why_cause(const struct why_command *c, const struct why *w, const struct why_cause *cause,
                         struct text *t)
{
    char before[APC_STATUS_NAME_LEN], status[APC_STATUS_NAME_LEN];
    struct author author;
    const int rc = find_row_author(c, cause, &author);
    json_add(t, "{input:%s, kind:%s, before:%g, now:%g, status_before:%s, status:%s", cause_name(w, cause),
             kind_name(cause->kind), cause->before, cause->now,
             apc_status_format(cause->status_before, before), apc_status_format(cause->status, status));
    json_add(t, "written:%g, author:%-s, event:%-s, effect:%g}",
             cause->row ? when_number(c, cause->row->time) : (double)NAN, author.source, author.text,
             cause->effect);
    return rc < 0 ? rc : 0;
}

static int put_why(const struct why_command *c, const struct why *w, unsigned depth, struct text *t)
{
    int rc = 0;
    json_add(t, depth ? "above:{" : "{");
    json_add(t, "output:%s, controller:%s, unit:%s, from:%g, time:%g, before:%g, now:%g", w->loop,
             w->by->of->name, w->output ? w->output->unit : NULL, when_number(c, w->before->time),
             when_number(c, w->tick->time), w->u_before, w->u);
    json_add(t, "state_before:%s, state:%s, reason:%-s, low:%e, high:%e, earlier:%g, together:%g, inputs:[",
             state_name(w->state_before), state_name(w->state), w->reason, w->low, w->high, w->earlier,
             w->together);
    for (size_t i = 0; i < w->n && rc == 0; i++)
        rc = put_why_cause(c, w, &w->cause[i], t);
    json_add(t, "]");
    return rc;
}

/* ---- The command ----------------------------------------------------------------------------- */

#define LEAD 2 /* ticks before those of a move: what is read of a store at first */
#define MORE 8 /* as many times as many, where these do not tell */
#define MOST 1024

/* Of a store only what the move needs is read: more where it does not come out of that. */
static int find_part_move(struct why_command *c, const char *loop, apc_ns at, struct why *w,
                          struct apc_error *why)
{
    struct replay_part part = {.store = c->store, .loop = loop, .until = at, .lead = LEAD};
    int rc = APC_ESTATE;
    *w = (struct why){0};
    (void)apc_ns_from_s(c->options.over, &part.over);
    const apc_ns from = part.over > 0 ? at - part.over : at;
    if (!c->store)
        return why_find(w, &c->replay, loop, from, at, why);
    for (bool more = true; rc == APC_ESTATE && more && part.lead <= MOST; part.lead *= MORE) {
        why_free(w);
        replay_free(&c->replay);
        if ((rc = replay_load_part(&c->replay, &part, why)) == 0)
            rc = why_find(w, &c->replay, loop, from, at, why);
        more = c->replay.more && !w->restarted;
    }
    return rc;
}

static int explain_move(struct why_command *c, const char *loop, apc_ns at, unsigned depth)
{
    const bool json = c->cli.format == CLI_JSON;
    char above[APC_TAG_LEN];
    struct apc_error why;
    struct why w;
    const struct why_cause *moved = NULL;
    int rc = find_part_move(c, loop, at, &w, &why);
    const bool found = rc == 0;
    if (!found)
        fail_why(c, rc, why.text);
    else
        rc = json ? put_why(c, &w, depth, &c->json) : print_why(c, &w);
    for (size_t i = 0; i < w.n && rc == 0 && !moved; i++)
        if (w.cause[i].effect != 0 && why_above(&c->replay, &w.cause[i]))
            moved = &w.cause[i];
    if (moved && depth < DEPTH) {
        if (!json)
            putchar('\n');
        snprintf(above, sizeof above, "%s", why_above(&c->replay, moved));
        rc = explain_move(c, above, moved->row->time, depth + 1);
    }
    if (json && found)
        json_add(&c->json, depth ? "}" : "}\n");
    why_free(&w);
    return rc;
}

/* OUTPUT[@TIME]; the run is loaded, if it is one. */
static int parse_output(struct why_command *c)
{
    const char *text = c->cli.args[c->cli.n_args - 1], *at = strrchr(text, '@');
    const size_t length = at ? (size_t)(at - text) : strlen(text);
    double t;
    c->at = INT64_MAX;
    if (length == 0 || length >= sizeof c->loop)
        return cli_usage(&c->cli, "\"%s\": expected OUTPUT or OUTPUT@TIME", text);
    memcpy(c->loop, text, length);
    if (!at)
        return 0;
    if (c->cli.n_args < 2)
        return cli_when(at + 1, &c->at)
                   ? EXIT_OK
                   : cli_usage(
                         &c->cli,
                         "\"%s\": \"%s\" must be a time, as 2026-01-31T12:00:00Z, or before now, as 30s, "
                         "10m, 2h, 1d; in a run folder: apc why RUN %s",
                         text, at + 1, text);
    if (apc_number_parse(at + 1, &t) == 0 && apc_ns_from_s(t, &c->at) == 0) {
        c->at += c->replay.start;
        return 0;
    }
    return cli_when(at + 1, &c->at)
               ? 0
               : cli_usage(&c->cli,
                           "\"%s\": \"%s\" must be seconds since the start of the run, or a "
                           "time, as 2026-01-31T12:00:00Z",
                           text, at + 1);
}

/* Returns an exit code. */
static int explain_folder(struct why_command *c)
{
    struct apc_error why;
    int rc = replay_load(&c->replay, c->cli.args[0], NULL, &why);
    if (rc < 0)
        return exit_code_of(fail_why(c, rc, why.text));
    rc = parse_output(c);
    return rc != EXIT_OK ? rc : exit_code_of(explain_move(c, c->loop, c->at, 0));
}

static int explain_store(struct why_command *c)
{
    int rc = parse_output(c);
    if (rc == EXIT_OK)
        rc = exit_code_of(cli_open(&c->cli, &c->store));
    if (rc == EXIT_OK)
        rc = exit_code_of(explain_move(c, c->loop, c->at, 0));
    apc_store_close(c->store);
    return rc;
}

int command_why(int argc, char **argv)
{
    struct why_command c = {.json = {.out = stdout}};
    cli_parse(&c.cli, &spec, &c.options, argc, argv);
    const int rc = c.cli.n_args > 1 ? explain_folder(&c) : explain_store(&c);
    replay_free(&c.replay);
    return rc == EXIT_USAGE ? rc : cli_done(&c.cli, rc);
}

/* SPDX-License-Identifier: BSD-3-Clause */
/* apc why: what moved an output, of a recorded run or of one whose record is in a store. */
#include "print_why.h"

#include <math.h>
#include <string.h>

#include "apc/common/past.h"
#include "apc/common/print.h"
#include "apcmath.h"
#include "files/files.h"

struct why_options {
    double over; /* s; 0: the tick alone */
};

#define AT(member) .to = offsetof(struct why_options, member)
static const struct option_spec own_options[] = {
    {"over", 0, "SECONDS", "Explain the move over this time until TIME, instead of one tick", OPTION_NUMBER,
     AT(over), .high = 366 * 86400.0, .must = "be seconds, from 0 to 366 days"},
    {0},
};

static const struct cli_spec spec = {
    .args_doc = "[RUN] OUTPUT[@TIME]",
    .doc = "Show why OUTPUT moved at TIME, in run folder RUN or, without one, in the store; without TIME at "
           "the last tick. TIME is RFC 3339; in a folder it may be seconds since the start of the run, in a "
           "store a time before now as 30s, 10m, 2h, 1d. For the effect of an input that changed, the tick "
           "is computed again with its former value. Only ticks that the record reproduces bit for bit are "
           "explained. If a loop above moved the setpoint, that loop is explained as well.",
    .takes = CLI_STORE | CLI_FORMAT,
    .min_args = 1,
    .max_args = 2,
    .options = own_options,
};

struct why_command {
    struct cli cli;
    struct why_options options;
    struct replay replay;
    struct why_question question;
    apc_ns start; /* of a run folder: t = 0 */
    char loop[APC_TAG_LEN];
};

/* ---- For people ------------------------------------------------------------------------------ */

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

/* It changed, and changed back. */
static bool is_back(const struct why_cause *cause)
{
    return cause->kind != WHY_BELOW && cause->before == cause->now && cause->status_before == cause->status;
}

#define SHARE_MOST 100 /* of the whole move; a greater part says that the output is where it was */
#define WIDEST     1e6 /* limits farther apart than that are none */

static bool has_effect(const struct why *w, double effect)
{
    return fabs(effect) > 1e-12 * (fabs(w->u) + fabs(w->u_before));
}

/* A ten-thousandth of its range, as a power of ten; 0: it has none. */
static double resolution(const struct why *w)
{
    const double span = w->high - w->low;
    return span > 0 && span <= WIDEST ? apc_pow(10, fmax(-6, fmin(0, floor(apc_log10(span)) - 4))) : 0;
}

static void print_effect(struct print_table *table, const struct why *w, double effect)
{
    const double move = w->u - w->u_before, least = resolution(w);
    if (fabs(effect) < least / 2)
        print_cell(table, PRINT_PLAIN, "<%g", least);
    else
        print_cell(table, PRINT_PLAIN, "%+.4g", effect);
    if (fabs(effect) < SHARE_MOST * fabs(move))
        print_cell(table, PRINT_PLAIN, "%.0f", 100 * effect / move + 0.0);
    else
        print_cell(table, PRINT_PLAIN, "%s", "");
}

static int print_causes(const struct why *w, FILE *out)
{
    static const struct print_column columns[] = {{"input", PRINT_LEFT},   {"", PRINT_LEFT},
                                                  {"before", PRINT_RIGHT}, {"now", PRINT_RIGHT},
                                                  {"effect", PRINT_POINT}, {"%", PRINT_RIGHT}};
    struct print_table table;
    char text[PRINT_LEN];
    print_table_open(&table, columns, sizeof columns / sizeof *columns);
    for (size_t i = 0; i < w->n; i++) {
        const struct why_cause *cause = &w->cause[i];
        if (!has_effect(w, cause->effect))
            continue;
        print_cell(&table, PRINT_PLAIN, "%s", why_cause_name(w, cause));
        print_cell(&table, PRINT_PLAIN, "%s", why_kind_name(cause->kind));
        print_cell(&table, PRINT_PLAIN, "%s", value_text(cause, cause->before, cause->status_before, text));
        print_cell(&table, PRINT_PLAIN, "%s%s", value_text(cause, cause->now, cause->status, text),
                   is_back(cause) ? " again" : "");
        print_effect(&table, w, cause->effect);
    }
    const struct {
        const char *what, *of;
        double effect;
    } rest[] = {{"(no new input)", "the loop goes on", w->earlier},
                {"(together)", "not one alone", w->together}};
    for (size_t i = 0; i < sizeof rest / sizeof *rest; i++) {
        if (!has_effect(w, rest[i].effect))
            continue;
        print_cell(&table, PRINT_PLAIN, "%s", rest[i].what);
        print_cell(&table, PRINT_FAINT, "%s", rest[i].of);
        print_cell(&table, PRINT_PLAIN, "%s", "");
        print_cell(&table, PRINT_PLAIN, "%s", "");
        print_effect(&table, w, rest[i].effect);
    }
    return print_table_end(&table, out, out == stdout && cli_colour(), 0);
}

/* Inputs that changed and moved nothing stand at the end. */
static void print_idle(const struct why *w, FILE *out)
{
    const char *before = "no effect: ";
    for (size_t i = 0; i < w->n; i++) {
        if (has_effect(w, w->cause[i].effect))
            continue;
        fputs(before, out);
        print_clean(out, why_cause_name(w, &w->cause[i]));
        fprintf(out, " (%s)", why_kind_name(w->cause[i].kind));
        before = ", ";
    }
    if (*before == ',')
        putc('\n', out);
}

static const char *direction(unsigned limited)
{
    return limited == (APC_LIMITED_LOW | APC_LIMITED_HIGH) ? "both ways"
           : limited & APC_LIMITED_HIGH                    ? "upwards"
                                                           : "downwards";
}

static void print_move_limit(const struct why *w, FILE *out)
{
    if (w->u >= w->high)
        fprintf(out, "  at its high limit, %.6g\n", w->high);
    else if (w->u <= w->low)
        fprintf(out, "  at its low limit, %.6g\n", w->low);
    else if (w->limited)
        fprintf(out, "  a limit of the law or of the rate holds it back %s\n", direction(w->limited));
    if (w->blocked)
        fprintf(out, "  the loop below cannot follow %s\n", direction(w->blocked));
}

static const char *term_text(double value, char text[PRINT_LEN])
{
    snprintf(text, PRINT_LEN, isnan(value) ? "none" : "%.6g", value);
    return text;
}

static void print_term(const struct why_term *term, FILE *out)
{
    char before[PRINT_LEN], now[PRINT_LEN];
    fprintf(out, " %s -> %s", term_text(term->before, before), term_text(term->now, now));
}

/* Before and now, of those that are not 0 all the time: "  law: P 0.2 -> 0.6, I 1.5 -> 1.5"; a line of the
 * signals that have one of the same name: "  high limit: v1 0 -> 3.2, v2 0.4 -> 0". */
static void print_terms(const struct why *w, FILE *out)
{
    const char *line = NULL;
    for (size_t i = 0; i < w->n_terms; i++) {
        const struct why_term *term = &w->term[i];
        const char *of = term->of[0] ? term->name : "law";
        if (term->before == 0 && term->now == 0)
            continue;
        if (line && strcmp(line, of) == 0)
            putc(',', out);
        else
            fprintf(out, "%s  %s:", line ? "\n" : "", of);
        putc(' ', out);
        print_clean(out, term->of[0] ? term->of : term->name);
        print_term(term, out);
        line = of;
    }
    if (line)
        putc('\n', out);
}

static int put_why(const struct why_question *q, const struct why *w, FILE *out, struct apc_error *why)
{
    char before[PRINT_LEN], now[PRINT_LEN], time[APC_TIME_LEN];
    const char *unit = w->output ? w->output->unit : "";
    print_clean(out, w->loop);
    fprintf(out, ": %s -> %s%s%s, tick at %s of %s", print_exact(w->u_before, before), print_exact(w->u, now),
            *unit ? " " : "", unit, replay_time(q->replay, w->tick->time, time), w->by->of->name);
    if (w->state_before != w->state)
        fprintf(out, ", %s -> %s", why_state_name(w->state_before), why_state_name(w->state));
    else
        fprintf(out, ", %s", why_state_name(w->state));
    fputs(w->reason[0] ? ": " : "", out);
    print_clean(out, w->reason);
    putc('\n', out);
    if (w->cut)
        fprintf(out, "  over the ticks after %s: those before are not on record any more\n",
                replay_time(q->replay, w->before->time, time));
    print_terms(w, out);
    print_move_limit(w, out);
    int rc = print_causes(w, out);
    print_idle(w, out);
    for (size_t i = 0; i < w->n && rc >= 0; i++) {
        struct why_author author;
        rc = why_find_author(q, &w->cause[i], &author, why);
        if (author.source[0]) {
            fprintf(out, "%s  ", replay_time(q->replay, w->cause[i].row->time, time));
            print_clean(out, author.source);
            fputs(": ", out);
            print_clean(out, author.text);
            if (!author.text[0]) { /* no event says more than the row */
                print_clean(out, why_cause_name(w, &w->cause[i]));
                fprintf(out, " = %s", value_text(&w->cause[i], w->cause[i].row->value, APC_GOOD, before));
            }
            putc('\n', out);
        }
    }
    return rc < 0 ? rc : 0;
}

int print_why(const struct why_question *q, FILE *out, struct apc_error *why)
{
    char loop[APC_TAG_LEN];
    struct why w;
    int rc = why_ask(&w, q, why);
    if (rc == 0)
        rc = put_why(q, &w, out, why);
    const struct why_cause *moved = rc == 0 ? why_moved_above(&w, q) : NULL;
    if (moved) {
        const struct why_question above = why_question_above(q, moved, loop);
        putc('\n', out);
        if (print_why(&above, out, why) < 0)
            fprintf(out, "%s: %s\n", loop, why->text);
    }
    why_free(&w);
    return rc;
}

/* ---- The command ----------------------------------------------------------------------------- */

/* Returns an exit code. */
static int explain_move(struct why_command *c)
{
    struct apc_error why;
    struct text json = {0};
    c->question.loop = c->loop;
    c->question.replay = &c->replay;
    (void)apc_ns_from_s(c->options.over, &c->question.over);
    json_add(&json, "{");
    int rc = c->cli.format == CLI_JSON ? why_json(&c->question, &json, &why)
                                       : print_why(&c->question, stdout, &why);
    json_add(&json, "}");
    if (json.failed)
        rc = apc_fail(&why, APC_ENOMEM, "out of memory");
    if (rc == 0 && c->cli.format == CLI_JSON)
        printf("%.*s\n", (int)json.n, json.at);
    text_free(&json);
    if (rc == APC_ECONN && !c->question.dir)
        return cli_store_error(&c->cli, rc, c->question.store);
    return rc < 0 ? cli_error(&c->cli, rc, "%s", why.text) : EXIT_OK;
}

/* OUTPUT[@TIME]; of a run its start is known. */
static int parse_output(struct why_command *c)
{
    const char *text = c->cli.args[c->cli.n_args - 1], *at = strrchr(text, '@');
    const size_t length = at ? (size_t)(at - text) : strlen(text);
    double t;
    c->question.at = INT64_MAX;
    if (length == 0 || length >= sizeof c->loop)
        return cli_usage(&c->cli, "\"%s\": expected OUTPUT or OUTPUT@TIME", text);
    memcpy(c->loop, text, length);
    if (!at)
        return 0;
    if (c->cli.n_args < 2)
        return past_time(&c->cli, at + 1, &c->question.at)
                   ? past_check_end(&c->cli, at + 1, c->question.at)
                   : cli_usage(
                         &c->cli,
                         "\"%s\": \"%s\" must be a time, as 2026-01-31T12:00:00Z, or before now, as 30s, "
                         "10m, 2h, 1d; of a run's folder also seconds: apc why RUN %s",
                         text, at + 1, text);
    if (apc_number_parse(at + 1, &t) == 0 && apc_ns_from_s(t, &c->question.at) == 0) {
        c->question.at += c->start;
        return 0;
    }
    return cli_date(at + 1, &c->question.at)
               ? 0
               : cli_usage(&c->cli,
                           "\"%s\": \"%s\" must be seconds since the start of the run, as %.*s@10, or a "
                           "time, as 2026-01-31T12:00:00Z",
                           text, at + 1, (int)length, text);
}

/* Returns an exit code. */
static int explain_folder(struct why_command *c)
{
    const char *dir = c->question.dir = c->cli.args[0];
    struct experiment e;
    struct apc_error why;
    if (c->cli.store_given)
        return cli_usage(&c->cli, "expected either a run folder, %s, or --store", dir);
    int rc = experiment_load(&e, dir, 0, NULL, &why);
    c->start = e.start ? e.start : SIMULATION_BEGIN;
    experiment_free(&e);
    if (rc == 0)
        rc = replay_open_ticks(&c->question.store, dir, &why);
    if (rc < 0)
        return cli_error(&c->cli, rc, "%s", why.text);
    rc = parse_output(c);
    return rc != EXIT_OK ? rc : explain_move(c);
}

static int explain_store(struct why_command *c)
{
    int rc = parse_output(c);
    if (rc == EXIT_OK)
        rc = exit_code_of(cli_open(&c->cli, &c->question.store));
    return rc == EXIT_OK ? explain_move(c) : rc;
}

int command_why(int argc, char **argv)
{
    struct why_command c = {.question = {.store = NULL}};
    cli_parse(&c.cli, &spec, &c.options, argc, argv);
    const int rc = c.cli.n_args > 1 ? explain_folder(&c) : explain_store(&c);
    replay_free(&c.replay);
    apc_store_close(c.question.store);
    return rc == EXIT_USAGE ? rc : cli_done(&c.cli, rc);
}

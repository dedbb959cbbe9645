/* SPDX-License-Identifier: BSD-3-Clause */
/*
 * apc copy: what one store holds into another. Samples are named by (table, id, seq), so a repeat leaves
 * those that are there alone; events and timing have no name, so each batch of them is first looked up in the
 * other store.
 */
#include <inttypes.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "cli.h"

#define SAMPLES 10000 /* of one append */
#define EVENTS  512
#define ROWS    64 /* of timing */
#define BAR     24
#define SHOW    (APC_NS_PER_S / 10) /* between two pictures of the progress bar */

static const struct argp_option option_list[] = {{"since", 0x500, "TIME", 0,
                                                  "Only what is not older, RFC 3339 or before now as -30s, "
                                                  "-10m, -2h, -1d; the newest sample of each variable "
                                                  "in any case",
                                                  0},
                                                 {0}};

static error_t parse(int key, char *arg, struct argp_state *state)
{
    if (key != 0x500)
        return ARGP_ERR_UNKNOWN;
    *(const char **)state->input = arg;
    return 0;
}

static const struct argp own = {option_list, parse, NULL, NULL, NULL, NULL, NULL};

static const struct cli_spec spec = {
    .args_doc = "FROM TO",
    .doc =
        "Copy what the store FROM holds to the store TO: samples, descriptions, events and timing. Tables "
        "are "
        "made where there are none. Running it again copies what is new. Nobody may be writing TO meanwhile.",
    .min_args = 2,
    .max_args = 2,
    .extra = &own,
};

struct counts {
    uint64_t copied, there;
};

struct copy {
    struct cli cli;
    struct apc_store *from, *to;
    struct apc_range range;
    struct counts samples, events, timing;
    size_t tags;
    int failed;   /* why the store TO stopped a stream of FROM */
    bool damaged; /* part of FROM could not be read */

    bool terminal;
    apc_ns shown;
    double done, weight,
        total;             /* progress: of variables before, of the one at hand, of all: their newest seqs */
    int64_t first, newest; /* seq: of the one at hand */

    struct apc_sample *sample; /* [SAMPLES], of which n */
    struct apc_event *event;   /* [EVENTS] */
    struct timing_copy {
        struct apc_timing_row row;
        int64_t *bins;
    } timing_row[ROWS];
    bool found[EVENTS]; /* which of the events or timing rows TO has */
    size_t n;
};

/* ---- Progress ------------------------------------------------------------------------------- */

static void show(struct copy *c, int64_t seq)
{
    apc_ns now = apc_clock_mono(NULL);
    if (!c->terminal || now - c->shown < SHOW)
        return;
    c->shown = now;
    double part = c->newest > c->first ? (double)(seq - c->first) / (double)(c->newest - c->first) : 1;
    double share = c->total > 0 ? (c->done + part * c->weight) / c->total : 1;
    share = share < 1 ? share : 1; /* the last batch holds what has been counted */
    int filled = (int)(share * BAR);
    fprintf(stderr, "\r[%.*s%*s] %3.0f %%  %" PRIu64 " samples", filled, "########################",
            BAR - filled, "", 100 * share, c->samples.copied + c->samples.there);
    fflush(stderr);
}

static void end_show(const struct copy *c)
{
    if (c->terminal && c->shown)
        fputs("\r\033[K", stderr);
}

/* ---- Failures ------------------------------------------------------------------------------- */

static int fail_from(const struct copy *c, int err)
{
    end_show(c);
    cli_error(&c->cli, err, "reading FROM: %s", apc_store_error(c->from));
    return err;
}

/* Part of FROM is damaged. The rest of it is worth all the more: say it and go on. */
static int leave_out(struct copy *c, const char *what)
{
    end_show(c);
    cli_error(&c->cli, APC_ESTORE, "FROM is damaged: %s not all copied (%s)", what, apc_store_error(c->from));
    c->damaged = true;
    return 0;
}

static int fail_to(const struct copy *c, int err)
{
    end_show(c);
    cli_error(&c->cli, err, "writing TO: %s", apc_store_error(c->to));
    return err;
}

/* The outcome of a stream of FROM whose function ended it when TO failed. */
static int stream_result(struct copy *c, int rc, const char *what)
{
    if (c->failed < 0)
        return fail_to(c, c->failed);
    return rc == APC_ESTORE ? leave_out(c, what) : rc < 0 ? fail_from(c, rc) : 0;
}

/* ---- Samples -------------------------------------------------------------------------------- */

static int flush_samples(struct copy *c)
{
    int stored = apc_store_append(c->to, c->sample, c->n);
    if (stored < 0)
        return c->failed = stored;
    c->samples.copied += (uint64_t)stored;
    c->samples.there += c->n - (size_t)stored;
    if (c->n > 0)
        show(c, c->sample[c->n - 1].seq);
    c->n = 0;
    return 0;
}

static int take_sample(void *ctx, const struct apc_sample *s)
{
    struct copy *c = ctx;
    if (c->first == 0)
        c->first = s->seq;
    c->sample[c->n++] = *s;
    return c->n == SAMPLES ? flush_samples(c) : 0;
}

static int copy_variable(struct copy *c, const struct apc_sample *newest)
{
    c->first = 0;
    c->newest = newest->seq;
    c->weight = (double)newest->seq;
    char what[64];
    snprintf(what, sizeof what, "%s %d is", apc_table_name(newest->table), newest->id);
    int rc = apc_store_history(c->from, newest->table, newest->id, &c->range, take_sample, c);
    if (rc == 0 && newest->seq > 0) /* all of it is older: what holds now goes along all the same */
        take_sample(c, newest);
    c->done += c->weight;
    return stream_result(c, rc, what);
}

static int copy_samples(struct copy *c)
{
    struct apc_sample *newest = NULL;
    int n = apc_store_variables(c->from, NULL, 0);
    int rc = n;
    if (n > 0) {
        newest = calloc((size_t)n, sizeof *newest);
        if (!newest)
            return cli_error(&c->cli, APC_ENOMEM, "out of memory"), APC_ENOMEM;
        rc = apc_store_variables(c->from, newest, (size_t)n);
        n = rc < n ? rc : n;
    }
    if (rc > 0)
        rc = apc_store_read(c->from, newest, (size_t)n);
    if (rc < 0) {
        fail_from(c, rc);
        goto out;
    }
    for (int i = 0; i < n; i++)
        c->total += (double)newest[i].seq;
    for (int i = 0; i < n && rc >= 0; i++)
        rc = copy_variable(c, &newest[i]);
    if (rc >= 0)
        rc = stream_result(c, flush_samples(c), "");
out:
    free(newest);
    return rc;
}

/* ---- Events --------------------------------------------------------------------------------- */

static bool same_event(const struct apc_event *a, const struct apc_event *b)
{
    return a->time == b->time && a->severity == b->severity && !strcmp(a->source, b->source) &&
           !strcmp(a->kind, b->kind) && !strcmp(a->text, b->text);
}

static int mark_event(void *ctx, const struct apc_event *e)
{
    struct copy *c = ctx;
    for (size_t i = 0; i < c->n; i++)
        if (!c->found[i] && same_event(&c->event[i], e)) {
            c->found[i] = true;
            break;
        }
    return 0;
}

/* What TO can have of a batch: between its earliest time and its latest. */
static struct apc_range span(apc_ns first, apc_ns last)
{
    return (struct apc_range){.since = first, .until = last < INT64_MAX - 1000 ? last + 1000 : 0};
}

/* A store with little room takes fewer at once. */
static int append_events(struct copy *c, const struct apc_event *events, size_t n)
{
    int rc = apc_store_append_events(c->to, events, n);
    if (rc != APC_ESTORE || n < 2)
        return rc;
    rc = append_events(c, events, n / 2);
    return rc < 0 ? rc : append_events(c, events + n / 2, n - n / 2);
}

static int append_timing(struct copy *c, const struct apc_timing_row *rows, size_t n)
{
    int rc = apc_store_append_timing(c->to, rows, n);
    if (rc != APC_ESTORE || n < 2)
        return rc;
    rc = append_timing(c, rows, n / 2);
    return rc < 0 ? rc : append_timing(c, rows + n / 2, n - n / 2);
}

static int flush_events(struct copy *c)
{
    apc_ns first = INT64_MAX, last = INT64_MIN;
    size_t new = 0;
    if (c->n == 0)
        return 0;
    for (size_t i = 0; i < c->n; i++) {
        c->found[i] = false;
        first = c->event[i].time < first ? c->event[i].time : first;
        last = c->event[i].time > last ? c->event[i].time : last;
    }
    const struct apc_range range = span(first, last);
    int rc = apc_store_events(c->to, &range, mark_event, c);
    for (size_t i = 0; i < c->n; i++)
        if (!c->found[i])
            c->event[new ++] = c->event[i];
    if (rc >= 0)
        rc = append_events(c, c->event, new);
    c->events.copied += new;
    c->events.there += c->n - new;
    c->n = 0;
    return c->failed = rc < 0 ? rc : 0;
}

/* Two that are alike stay in one batch: else the second would find the first one's copy. */
static int take_event(void *ctx, const struct apc_event *e)
{
    struct copy *c = ctx;
    if (c->n == EVENTS || (c->n > EVENTS / 2 && e->time != c->event[c->n - 1].time))
        if (flush_events(c) < 0)
            return c->failed;
    c->event[c->n++] = *e;
    return 0;
}

static int copy_events(struct copy *c)
{
    c->n = 0;
    int rc = apc_store_events(c->from, &c->range, take_event, c);
    if (!c->failed)
        flush_events(c);
    return stream_result(c, rc, "events are");
}

/* ---- Timing --------------------------------------------------------------------------------- */

static bool same_timing(const struct apc_timing_row *a, const struct apc_timing_row *b)
{
    return a->time == b->time && !strcmp(a->task, b->task) && !strcmp(a->quantity, b->quantity) &&
           a->period == b->period && a->missed == b->missed && a->count == b->count && a->p50 == b->p50 &&
           a->p99 == b->p99 && a->max == b->max && a->n_bins == b->n_bins;
}

static int mark_timing(void *ctx, const struct apc_timing_row *row)
{
    struct copy *c = ctx;
    for (size_t i = 0; i < c->n; i++)
        if (!c->found[i] && same_timing(&c->timing_row[i].row, row)) {
            c->found[i] = true;
            break;
        }
    return 0;
}

static int flush_timing(struct copy *c)
{
    struct apc_timing_row rows[ROWS];
    size_t new = 0;
    if (c->n == 0)
        return 0;
    memset(c->found, 0, sizeof c->found);
    const struct apc_range range =
        span(c->timing_row[0].row.time, c->timing_row[c->n - 1].row.time); /* by time */
    int rc = apc_store_timing(c->to, &range, mark_timing, c);
    for (size_t i = 0; i < c->n; i++)
        if (!c->found[i])
            rows[new ++] = c->timing_row[i].row;
    if (rc >= 0)
        rc = append_timing(c, rows, new);
    c->timing.copied += new;
    c->timing.there += c->n - new;
    c->n = 0;
    return c->failed = rc < 0 ? rc : 0;
}

static int take_timing(void *ctx, const struct apc_timing_row *row)
{
    struct copy *c = ctx;
    if (c->n == ROWS || (c->n > ROWS / 2 && row->time != c->timing_row[c->n - 1].row.time))
        if (flush_timing(c) < 0)
            return c->failed;
    struct timing_copy *t = &c->timing_row[c->n];
    int64_t *bins = realloc(t->bins, (3 * row->n_bins + 1) * sizeof *bins);
    if (!bins)
        return c->failed = APC_ENOMEM;
    const size_t n = row->n_bins;
    t->bins = bins;
    t->row = *row;
    t->row.bin_low = bins;
    t->row.bin_high = bins + n;
    t->row.bin_count = bins + 2 * n;
    if (n > 0) {
        memcpy(bins, row->bin_low, n * sizeof *bins);
        memcpy(bins + n, row->bin_high, n * sizeof *bins);
        memcpy(bins + 2 * n, row->bin_count, n * sizeof *bins);
    }
    c->n++;
    return 0;
}

static int copy_timing(struct copy *c)
{
    c->n = 0;
    int rc = apc_store_timing(c->from, &c->range, take_timing, c);
    if (!c->failed)
        flush_timing(c);
    for (size_t i = 0; i < ROWS; i++)
        free(c->timing_row[i].bins);
    return stream_result(c, rc, "timing is");
}

/* ---- Descriptions --------------------------------------------------------------------------- */

/* FROM's, and TO's own of variables that FROM does not describe. */
/* Two experiments in one store would be one series of each variable. */
static int check_experiment(const struct copy *c, const struct cli_tags *from, const struct cli_tags *to)
{
    for (size_t i = 0; i < from->n; i++) {
        const struct apc_tag *a = &from->tag[i], *b = cli_tag(to, a->table, a->id);
        bool experiment = a->table == APC_STATE, signal = a->table <= APC_SETPOINT;
        if (!b || (experiment && !strcmp(a->description, b->description)) ||
            (signal && !strcmp(a->name, b->name) && !strcmp(a->unit, b->unit)) || (!experiment && !signal))
            continue;
        cli_error(&c->cli, APC_EPERM,
                  "writing TO: it belongs to another experiment: its %s.%d is \"%s\" [%s], that of FROM "
                  "\"%s\" [%s]",
                  apc_table_name(b->table), b->id, experiment ? b->description : b->name, b->unit,
                  experiment ? a->description : a->name, a->unit);
        return APC_EPERM;
    }
    return 0;
}

static int copy_tags(struct copy *c)
{
    struct cli_tags from = {0}, to = {0};
    struct apc_tag *all = NULL;
    int rc = cli_tags_load(&c->cli, c->from, &from);
    if (rc == 0)
        rc = cli_tags_load(&c->cli, c->to, &to);
    if (rc == 0)
        rc = check_experiment(c, &from, &to);
    if (rc < 0 || from.n == 0)
        goto out;
    all = calloc(from.n + to.n, sizeof *all);
    if (!all) {
        rc = APC_ENOMEM;
        cli_error(&c->cli, rc, "out of memory");
        goto out;
    }
    size_t n = from.n;
    memcpy(all, from.tag, n * sizeof *all);
    for (size_t i = 0; i < to.n; i++)
        if (!cli_tag(&from, to.tag[i].table, to.tag[i].id))
            all[n++] = to.tag[i];
    c->tags = from.n;
    rc = apc_store_put_tags(c->to, all, n);
    if (rc < 0)
        fail_to(c, rc);
out:
    free(all);
    cli_tags_free(&from);
    cli_tags_free(&to);
    return rc;
}

/* ---- The whole ------------------------------------------------------------------------------ */

/* What FROM has now. */
static int claim_all(struct copy *c)
{
    const int n = apc_store_variables(c->from, NULL, 0);
    if (n < 0)
        return fail_from(c, n);
    struct apc_sample *variables = calloc((size_t)n + 1, sizeof *variables);
    const int now = variables ? apc_store_variables(c->from, variables, (size_t)n) : APC_ENOMEM;
    int rc = now < 0 ? fail_from(c, now) : 0;
    if (now > 0 && (rc = apc_store_claim_set(c->to, variables, (size_t)(now < n ? now : n))) < 0)
        rc = fail_to(c, rc);
    free(variables);
    return rc;
}

/* FROM first: nothing is made of TO when there is nothing to copy. Then nobody but us may write TO. */
static int open_both(struct copy *c)
{
    struct cli cli = c->cli;
    cli.store = c->cli.args[0];
    int rc = cli_open(&cli, &c->from);
    if (rc < 0)
        return rc;
    if ((rc = apc_store_connect(c->from)) < 0)
        return fail_from(c, rc);
    cli.store = c->cli.args[1];
    if ((rc = cli_open(&cli, &c->to)) < 0)
        return rc;
    rc = apc_store_init(c->to);
    return rc < 0 ? fail_to(c, rc) : claim_all(c);
}

static void say(const char *what, const struct counts *n)
{
    printf("%-13s %" PRIu64 " copied", what, n->copied);
    if (n->there > 0)
        printf(", %" PRIu64 " were there", n->there);
    putchar('\n');
}

int command_copy(int argc, char **argv)
{
    const char *since = NULL;
    struct copy *c = calloc(1, sizeof *c);
    int rc = APC_ENOMEM;
    if (c) {
        cli_parse(&c->cli, &spec, &since, argc, argv);
        c->terminal = isatty(STDERR_FILENO);
        c->sample = calloc(SAMPLES, sizeof *c->sample);
        c->event = calloc(EVENTS, sizeof *c->event);
    }
    if (!c || !c->sample || !c->event) {
        fputs("apc copy: out of memory\n", stderr);
        goto out;
    }
    rc = EXIT_USAGE;
    if (!strcmp(c->cli.args[0], c->cli.args[1])) {
        rc = cli_usage(&c->cli, "FROM and TO are the same store");
        goto out;
    }
    if (cli_time(&c->cli, "since", since, &c->range.since))
        goto out;
    if ((rc = open_both(c)) >= 0 && (rc = copy_tags(c)) >= 0 && (rc = copy_samples(c)) >= 0 &&
        (rc = copy_events(c)) >= 0 && (rc = copy_timing(c)) >= 0) {
        end_show(c);
        say("samples:", &c->samples);
        printf("descriptions: %zu copied\n", c->tags);
        say("events:", &c->events);
        say("timing:", &c->timing);
        rc = c->damaged ? APC_ESTORE : rc;
    }
    rc = cli_done(&c->cli, exit_code_of(rc));
out:
    if (c) {
        apc_store_close(c->from);
        apc_store_close(c->to);
        free(c->sample);
        free(c->event);
    }
    free(c);
    return rc;
}

/* SPDX-License-Identifier: BSD-3-Clause */
/*
 * apc copy: what one store holds into another. Samples and vectors are named by (table, id, seq), so a repeat
 * leaves those that are there alone; events and timing have no name, so each batch of them is first looked up
 * in the other store.
 */
#include <inttypes.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "apc/common/cli.h"

#define SAMPLES  10000 /* of one append */
#define VECTORS  1000
#define ELEMENTS 131072 /* of all of them; more than one can have */
#define EVENTS   512
#define ROWS     64 /* of timing */
#define BAR      24
#define SHOW     (APC_NS_PER_S / 10) /* between two pictures of the progress bar */

static const struct option_spec own_options[] = {
    {"since", 0, "TIME",
     "Only rows from TIME on, RFC 3339 or before now as -30s, -10m, -2h, -1d; the newest row of each "
     "variable is always copied",
     OPTION_TEXT, .to = 0},
    {0},
};

static const struct cli_spec spec = {
    .args_doc = "FROM TO",
    .doc = "Copy the rows of FROM, a store or a run folder, to the store TO: samples, vectors, descriptions, "
           "events and timing. Missing tables are made. Run again, it copies only new rows. Nobody may write "
           "to TO meanwhile.",
    .min_args = 2,
    .max_args = 2,
    .options = own_options,
};

struct counts {
    uint64_t copied, there;
};

struct copy {
    struct cli cli;
    struct apc_store *from, *to;
    struct apc_store *names; /* FROM once more: for who is asked while it streams */
    struct author {
        uint32_t from, to;
    } * author; /* whose number in TO is known */
    size_t authors;
    struct apc_range range;
    struct counts samples, vectors, events, timing;
    size_t tags;
    int failed;    /* why the store TO stopped a stream of FROM */
    bool nameless; /* ... which was FROM, asked for an author's name */
    bool damaged;  /* part of FROM could not be read */
    bool former;   /* FROM has rows of table state */

    struct apc_sample *variable; /* [variables]: of FROM, with their newest seqs; those of vectors are last */
    size_t variables;

    bool terminal;
    apc_ns shown;
    double done, weight,
        total;             /* progress: of variables before, of the one at hand, of all: their newest seqs */
    int64_t first, newest; /* seq: of the one at hand */

    struct apc_sample *sample; /* [SAMPLES], of which n_samples */
    struct apc_vector *vector; /* [VECTORS], of which n_vectors: their values are in element */
    double *element;           /* [ELEMENTS], of which n_elements */
    size_t n_samples, n_vectors, n_elements;
    struct apc_event *event; /* [EVENTS], of which n, or of timing_row */
    struct timing_copy {
        struct apc_timing_row row;
        int64_t *bins;
    } timing_row[ROWS];
    bool found[EVENTS]; /* which of the events or timing rows TO has */
    size_t n;
};

/* ---- Progress ------------------------------------------------------------------------------- */

static void show_copy_progress(struct copy *c, int64_t seq)
{
    apc_ns now = c->terminal ? apc_clock_mono(NULL) : c->shown;
    if (now - c->shown < SHOW)
        return;
    c->shown = now;
    double part = c->newest > c->first ? (double)(seq - c->first) / (double)(c->newest - c->first) : 1;
    double share = c->total > 0 ? (c->done + part * c->weight) / c->total : 1;
    share = share < 1 ? share : 1; /* the last batch holds what has been counted */
    int filled = (int)(share * BAR);
    fprintf(stderr, "\r[%.*s%*s] %3.0f %%  %" PRIu64 " rows", filled, "########################",
            BAR - filled, "", 100 * share,
            c->samples.copied + c->samples.there + c->vectors.copied + c->vectors.there);
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
    if (c->nameless)
        cli_error(&c->cli, err, "reading FROM: %s", apc_store_error(c->names));
    else
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

/* ---- Samples and vectors -------------------------------------------------------------------- */

static void count(struct counts *counts, size_t n, int stored)
{
    counts->copied += (uint64_t)stored;
    counts->there += n - (size_t)stored;
}

/* A number of an author is a name's in its own store only. Returns that of TO for @from of FROM; 0: FROM does
 * not know it. */
static int find_author(struct copy *c, uint32_t from)
{
    char name[APC_AUTHOR_LEN];
    for (size_t i = 0; i < c->authors; i++)
        if (c->author[i].from == from)
            return (int)c->author[i].to;
    struct author *grown = realloc(c->author, (c->authors + 1) * sizeof *grown);
    if (!grown)
        return APC_ENOMEM;
    c->author = grown;
    int rc = apc_store_author_name(c->names, from, name);
    if (rc < 0 && rc != APC_ENOTFOUND) {
        c->nameless = true;
        return rc;
    }
    rc = rc < 0 ? 0 : apc_store_author(c->to, name);
    if (rc >= 0)
        c->author[c->authors++] = (struct author){from, (uint32_t)rc};
    return rc;
}

static int flush_rows(struct copy *c)
{
    const struct apc_rows rows = {.size = sizeof rows, .vector = c->vector, .n_vectors = c->n_vectors};
    for (size_t i = 0; i < c->n_samples; i++) {
        const int author = c->sample[i].author > 0 ? find_author(c, c->sample[i].author) : 0;
        if (author < 0)
            return c->failed = author;
        c->sample[i].author = (uint32_t)author;
    }
    int stored = apc_store_append(c->to, c->sample, c->n_samples);
    if (stored >= 0) {
        count(&c->samples, c->n_samples, stored);
        c->n_samples = 0;
        stored = apc_store_append_rows(c->to, &rows);
    }
    if (stored < 0)
        return c->failed = stored;
    count(&c->vectors, c->n_vectors, stored);
    c->n_vectors = c->n_elements = 0;
    return 0;
}

static int begin_row(struct copy *c, int64_t seq)
{
    if (c->first == 0)
        c->first = seq;
    show_copy_progress(c, seq);
    return c->n_samples == SAMPLES || c->n_vectors == VECTORS ? flush_rows(c) : 0;
}

static int copy_sample(void *ctx, const struct apc_sample *s)
{
    struct copy *c = ctx;
    if (begin_row(c, s->seq) < 0)
        return c->failed;
    c->sample[c->n_samples++] = *s;
    return 0;
}

static int take_vector(void *ctx, const struct apc_vector *v)
{
    struct copy *c = ctx;
    if (begin_row(c, v->seq) < 0 || (c->n_elements + v->n > ELEMENTS && flush_rows(c) < 0))
        return c->failed;
    struct apc_vector *to = &c->vector[c->n_vectors++];
    *to = *v;
    to->value = c->element + c->n_elements;
    memcpy(to->value, v->value, v->n * sizeof *v->value);
    c->n_elements += v->n;
    return 0;
}

static int take_history(struct copy *c, const struct apc_sample *v, const struct apc_range *range)
{
    return apc_table_vectors(v->table) ? apc_store_vectors(c->from, v->table, v->id, range, take_vector, c)
                                       : apc_store_history(c->from, v->table, v->id, range, copy_sample, c);
}

static int copy_variable(struct copy *c, const struct apc_sample *newest)
{
    c->first = 0;
    c->newest = newest->seq;
    c->weight = (double)newest->seq;
    char what[64];
    snprintf(what, sizeof what, "%s %d is", apc_table_name(newest->table), newest->id);
    int rc = take_history(c, newest, &c->range);
    if (rc == 0) /* all of it is older: what holds now goes along all the same */
        rc = take_history(c, newest, &(struct apc_range){.last = 1});
    c->done += c->weight;
    return stream_result(c, rc, what);
}

/* The newest seqs are only how far it is: where they cannot be read, the histories will tell. */
static int measure(struct copy *c)
{
    struct apc_rows rows = {.size = sizeof rows, .sample = c->variable, .n_samples = c->variables};
    while (rows.n_samples > 0 && apc_table_vectors(c->variable[rows.n_samples - 1].table))
        rows.n_samples--;
    rows.n_vectors = c->variables - rows.n_samples;
    rows.vector = calloc(rows.n_vectors + 1, sizeof *rows.vector);
    if (!rows.vector)
        return cli_error(&c->cli, APC_ENOMEM, "out of memory"), APC_ENOMEM;
    for (size_t i = 0; i < rows.n_vectors; i++) {
        const struct apc_sample *v = &c->variable[rows.n_samples + i];
        rows.vector[i] = (struct apc_vector){.table = v->table, .id = v->id};
    }
    const int rc = apc_store_read_rows(c->from, &rows);
    for (size_t i = 0; i < rows.n_vectors; i++)
        c->variable[rows.n_samples + i].seq = rows.vector[i].seq;
    free(rows.vector);
    for (size_t i = 0; i < c->variables; i++)
        c->total += (double)c->variable[i].seq;
    return rc < 0 && rc != APC_ESTORE ? fail_from(c, rc) : 0;
}

static int copy_rows(struct copy *c)
{
    int rc = measure(c);
    for (size_t i = 0; i < c->variables && rc >= 0; i++)
        rc = copy_variable(c, &c->variable[i]);
    return rc < 0 ? rc : stream_result(c, flush_rows(c), "");
}

/* ---- Events --------------------------------------------------------------------------------- */

static bool is_same_copied_event(const struct apc_event *a, const struct apc_event *b)
{
    return a->time == b->time && a->severity == b->severity && !strcmp(a->source, b->source) &&
           !strcmp(a->kind, b->kind) && !strcmp(a->text, b->text);
}

static int mark_event(void *ctx, const struct apc_event *e)
{
    struct copy *c = ctx;
    for (size_t i = 0; i < c->n; i++)
        if (!c->found[i] && is_same_copied_event(&c->event[i], e)) {
            c->found[i] = true;
            break;
        }
    return 0;
}

/* What TO can have of a batch: between its earliest time and its latest. */
static struct apc_range copied_batch_range(apc_ns first, apc_ns last)
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

static int flush_copied_events(struct copy *c)
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
    const struct apc_range range = copied_batch_range(first, last);
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
static int copy_event(void *ctx, const struct apc_event *e)
{
    struct copy *c = ctx;
    if (c->n == EVENTS || (c->n > EVENTS / 2 && e->time != c->event[c->n - 1].time))
        if (flush_copied_events(c) < 0)
            return c->failed;
    c->event[c->n++] = *e;
    return 0;
}

static int copy_events(struct copy *c)
{
    c->n = 0;
    int rc = apc_store_events(c->from, &c->range, copy_event, c);
    if (!c->failed)
        flush_copied_events(c);
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

static int flush_copied_timing(struct copy *c)
{
    struct apc_timing_row rows[ROWS];
    size_t new = 0;
    if (c->n == 0)
        return 0;
    memset(c->found, 0, sizeof c->found);
    const struct apc_range range =
        copied_batch_range(c->timing_row[0].row.time, c->timing_row[c->n - 1].row.time); /* by time */
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

static int copy_timing_row(void *ctx, const struct apc_timing_row *row)
{
    struct copy *c = ctx;
    if (c->n == ROWS || (c->n > ROWS / 2 && row->time != c->timing_row[c->n - 1].row.time))
        if (flush_copied_timing(c) < 0)
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
    int rc = apc_store_timing(c->from, &c->range, copy_timing_row, c);
    if (!c->failed)
        flush_copied_timing(c);
    for (size_t i = 0; i < ROWS; i++)
        free(c->timing_row[i].bins);
    return stream_result(c, rc, "timing is");
}

/* ---- Descriptions --------------------------------------------------------------------------- */

/* FROM's, and TO's own of variables that FROM does not describe. */
/* Two experiments in one store would be one series of each variable. */
static int check_copied_experiment(const struct copy *c, const struct cli_tags *from,
                                   const struct cli_tags *to)
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
        rc = check_copied_experiment(c, &from, &to);
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
    int64_t revision = 0;
    const int length = apc_store_catalogue(c->from, NULL, 0, &revision);
    char *text = length >= 0 ? calloc((size_t)length + 1, 1) : NULL;
    if (!text || apc_store_catalogue(c->from, text, (size_t)length + 1, &revision) < 0)
        rc = fail_from(c, length < 0 ? length : APC_ENOMEM);
    else if ((rc = apc_store_describe(c->to, all, n, revision > 0 ? text : NULL)) < 0)
        fail_to(c, rc);
    free(text);
out:
    free(all);
    cli_tags_free(&from);
    cli_tags_free(&to);
    return rc;
}

/* ---- The whole ------------------------------------------------------------------------------ */

/* What FROM has now, in the order of its tables. Nothing reads table state any more. */
static int list_variables(struct copy *c)
{
    const int n = apc_store_variables(c->from, NULL, 0);
    if (n < 0)
        return fail_from(c, n);
    c->variable = calloc((size_t)n + 1, sizeof *c->variable);
    if (!c->variable)
        return cli_error(&c->cli, APC_ENOMEM, "out of memory"), APC_ENOMEM;
    const int now = apc_store_variables(c->from, c->variable, (size_t)n);
    for (int i = 0; i < now && i < n; i++)
        if (c->variable[i].table == APC_STATE)
            c->former = true;
        else
            c->variable[c->variables++] = c->variable[i];
    return now < 0 ? fail_from(c, now) : 0;
}

/* FROM first: nothing is made of TO when there is nothing to copy. Then nobody but us may write TO. */
static int open_both(struct copy *c)
{
    struct cli cli = c->cli;
    cli.store = c->cli.args[0];
    cli_find_store(&cli);
    int rc = cli_open(&cli, &c->from);
    if (rc < 0 || (rc = cli_open(&cli, &c->names)) < 0)
        return rc;
    if ((rc = apc_store_connect(c->from)) < 0)
        return fail_from(c, rc);
    cli.store = c->cli.args[1];
    if ((rc = cli_open(&cli, &c->to)) < 0)
        return rc;
    if ((rc = list_variables(c)) < 0)
        return rc;
    if ((rc = cli_init(&cli, c->to)) >= 0)
        rc = apc_store_claim_set(c->to, c->variable, c->variables);
    return rc < 0 ? fail_to(c, rc) : 0;
}

static void say_copied(const char *what, const struct counts *n)
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
        c->vector = calloc(VECTORS, sizeof *c->vector);
        c->element = calloc(ELEMENTS, sizeof *c->element);
        c->event = calloc(EVENTS, sizeof *c->event);
    }
    if (!c || !c->sample || !c->vector || !c->element || !c->event) {
        fputs("apc copy: out of memory\n", stderr);
        goto out;
    }
    rc = EXIT_USAGE;
    if (!strcmp(c->cli.args[0], c->cli.args[1])) {
        rc = cli_usage(&c->cli, "FROM and TO are the same store: name another one as TO");
        goto out;
    }
    if (cli_time(&c->cli, "since", since, &c->range.since))
        goto out;
    if ((rc = open_both(c)) >= 0 && (rc = copy_tags(c)) >= 0 && (rc = copy_rows(c)) >= 0 &&
        (rc = copy_events(c)) >= 0 && (rc = copy_timing(c)) >= 0) {
        end_show(c);
        say_copied("samples:", &c->samples);
        say_copied("vectors:", &c->vectors);
        printf("descriptions: %zu copied\n", c->tags);
        say_copied("events:", &c->events);
        say_copied("timing:", &c->timing);
        if (c->former)
            puts("left out:     table state, from which controllers of version 1 resumed");
        rc = c->damaged ? APC_ESTORE : rc;
    }
    rc = cli_done(&c->cli, exit_code_of(rc));
out:
    if (c) {
        apc_store_close(c->from);
        apc_store_close(c->names);
        apc_store_close(c->to);
        free(c->variable);
        free(c->author);
        free(c->sample);
        free(c->vector);
        free(c->element);
        free(c->event);
    }
    free(c);
    return rc;
}

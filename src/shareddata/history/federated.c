/* SPDX-License-Identifier: BSD-3-Clause */
/*
 * A live store, which holds the newest and a recent past, and the history that a historian moves its rows on
 * to: its user sees one store. What is newest, and every write, is the live store's; the past is the
 * history's as far as it goes, and from there on the live store's.
 *
 * Rows of variables bear the same seq in both. So the history is streamed to its end, and the live store
 * from behind the last seq that it gave: whatever the historian moves meanwhile, a row comes once.
 *
 * The history may be away, be another's, or not have begun. Then the live store's rows are all there are, and
 * the handle's error text says so, though the operation succeeds. A history that makes its callers wait is
 * left alone for a while.
 */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "shareddata/history/federated_internal.h"
#include "shareddata/spool/spool.h"

#define TRIES 10 /* to find where the newest N begin, while a historian moves rows */

static struct apc_federated *federated_of(struct apc_store *store)
{
    return (struct apc_federated *)store;
}

/* ---- Asking the history ---------------------------------------------------------------------- */

/* It answered so to what began then. Without it there is less to give, and no failure. */
int apc_federated_answered(struct apc_federated *s, int rc, apc_ns began, const char *text)
{
    if (rc >= 0) {
        s->away = 0;
        return rc;
    }
    const apc_ns now = apc_clock_mono(NULL);
    s->quiet_until = now + apc_spool_pause(now - began, ++s->away, &s->base.config);
    s->checked = false;
    s->failed = rc;
    apc_fail(&s->reason, rc, "the history is left out: %s", text);
    s->base.why = s->reason;
    return rc;
}

static int check_same_experiment(struct apc_federated *s)
{
    struct apc_tag *live = NULL, *history = NULL;
    size_t n_live = 0, n_history = 0;
    struct apc_error why = {""};
    const apc_ns began = apc_clock_mono(NULL);
    int rc = apc_tags_load(s->base.inner, &live, &n_live);
    why = s->base.inner->why;
    if (rc == 0) {
        rc = apc_tags_load(s->history, &history, &n_history);
        why = s->history->why;
    }
    if (rc == 0) {
        rc = apc_tags_compare(live, n_live, history, n_history, &why);
    }
    free(live);
    free(history);
    s->checked = rc == 0;
    return apc_federated_answered(s, rc, began, why.text);
}

/* May the history be asked? */
bool apc_federated_has_history(struct apc_federated *s)
{
    if (apc_clock_mono(NULL) < s->quiet_until) {
        s->base.why = s->reason;
        return false;
    }
    return s->checked || check_same_experiment(s) == 0;
}

static int newest_seq(struct apc_store *store, enum apc_table table, int id, int64_t *seq)
{
    struct apc_sample sample = {.table = table, .id = id};
    struct apc_vector vector = {.table = table, .id = id};
    const bool vectors = apc_table_vectors(table);
    struct apc_rows rows = {.size = sizeof rows,
                            .sample = &sample,
                            .n_samples = !vectors,
                            .vector = &vector,
                            .n_vectors = vectors};
    const int rc = apc_store_read_rows(store, &rows);
    *seq = vectors ? vector.seq : sample.seq;
    return rc;
}

/* Up to which seq the history has the variable. It cannot have more than the live store, which began with
 * what it had. */
static int history_reach(struct apc_federated *s, enum apc_table table, int id, int64_t *seq)
{
    int64_t live = 0;
    const apc_ns began = apc_clock_mono(NULL);
    int rc = newest_seq(s->history, table, id, seq);
    if (rc < 0) {
        return apc_federated_answered(s, rc, began, s->history->why.text);
    }
    rc = newest_seq(s->base.inner, table, id, &live);
    if (rc < 0) {
        return apc_fail(&s->base.why, rc, "the history is left out: %s", s->base.inner->why.text);
    }
    if (live > 0 && *seq > live) {
        char text[160];
        snprintf(text, sizeof text, "it has %s %d up to seq %lld, newer than %lld here: it is another run's",
                 apc_table_name(table), id, (long long)*seq, (long long)live);
        return apc_federated_answered(s, APC_ECONFLICT, began, text);
    }
    return rc;
}

/* ---- Samples and vectors --------------------------------------------------------------------- */

/* A variable's rows on their way to a caller; without a function they are looked at only. */
struct stream {
    apc_sample_fn sample;
    apc_vector_fn vector;
    void *ctx;
    uint32_t mark; /* of authors */
    size_t most;   /* 0: any number */
    size_t n;
    int64_t first, last; /* seqs */
    apc_ns since;        /* time of the first */
    bool one;            /* the first is enough */
    bool ended;          /* by the caller */
};

static bool take_stream_row(struct stream *x, int64_t seq, apc_ns time)
{
    if (x->n == 0) {
        x->first = seq;
        x->since = time;
    }
    x->last = seq;
    x->n++;
    return x->one;
}

static int pass_sample(void *ctx, const struct apc_sample *s)
{
    struct stream *x = (struct stream *)ctx;
    struct apc_sample row = *s;
    bool end = take_stream_row(x, s->seq, s->time);
    if (x->sample) {
        row.author |= row.author > 0 ? x->mark : 0;
        x->ended = x->sample(x->ctx, &row) != 0;
        end = x->ended || x->n == x->most;
    }
    return end;
}

static int pass_vector(void *ctx, const struct apc_vector *v)
{
    struct stream *x = (struct stream *)ctx;
    bool end = take_stream_row(x, v->seq, v->time);
    if (x->vector) {
        x->ended = x->vector(x->ctx, v) != 0;
        end = x->ended || x->n == x->most;
    }
    return end;
}

static int stream(struct apc_store *store, enum apc_table table, int id, const struct apc_range *range,
                  struct stream *x)
{
    return apc_table_vectors(table) ? apc_store_vectors(store, table, id, range, pass_vector, x)
                                    : apc_store_history(store, table, id, range, pass_sample, x);
}

/* What the live store has reaches as far back as is asked for: 1, or 0, or an error. */
static int is_live(struct apc_federated *s, enum apc_table table, int id, const struct apc_range *range)
{
    struct stream oldest = {.one = true}, rows = {0};
    int rc = stream(s->base.inner, table, id, NULL, &oldest);
    if (rc <= 0) {
        return rc;
    }
    if (oldest.first == 1 || range->after >= oldest.first - 1 ||
        (range->since != 0 && range->since > oldest.since)) {
        return 1;
    }
    rc = range->last > 0 ? stream(s->base.inner, table, id, range, &rows) : 0;
    return rc < 0 ? rc : range->last > 0 && rows.n == range->last;
}

/* Where the newest `last` begin, so that both stores can be asked for what lies behind one seq. */
static int find_first(struct apc_federated *s, enum apc_table table, int id, struct apc_range *range)
{
    int64_t end = 0, moved = 0;
    int rc = history_reach(s, table, id, &moved);
    struct stream old = {.one = true};
    for (int i = 0; rc == 0 && i < TRIES && (i == 0 || moved != end); i++) {
        struct apc_range tail = *range, head = *range;
        struct stream new = {0};
        end = moved;
        tail.after = end > range->after ? end : range->after;
        rc = stream(s->base.inner, table, id, &tail, &new);
        if (rc < 0) {
            return apc_fail(&s->base.why, rc, "the history is left out: %s", s->base.inner->why.text);
        }
        old = (struct stream){.one = true};
        head.last = range->last - (new.n < range->last ? new.n : range->last - 1);
        const apc_ns began = apc_clock_mono(NULL);
        rc = stream(s->history, table, id, &head, &old);
        rc = rc < 0 ? apc_federated_answered(s, rc, began, s->history->why.text)
                    : history_reach(s, table, id, &moved);
    }
    range->after = rc == 0 && old.n > 0 ? old.first - 1 : range->after;
    return rc;
}

/* The caller's rows of the variable, in the order of their seqs. */
static int federated_rows(struct apc_federated *s, enum apc_table table, int id,
                          const struct apc_range *asked, struct stream *x)
{
    struct apc_range range = *asked;
    int64_t end = 0;
    s->base.streaming = true;
    const int reached = is_live(s, table, id, asked);
    int rc = reached;
    if (rc < 0) {
        s->base.why = s->base.inner->why;
    } else if (rc == 0 && apc_federated_has_history(s)) {
        rc = range.last > 0 ? find_first(s, table, id, &range) : history_reach(s, table, id, &end);
        if (rc == 0) {
            const apc_ns began = apc_clock_mono(NULL);
            range.last = 0;
            x->most = asked->last;
            x->mark = APC_SEAM_AUTHOR;
            rc = apc_federated_answered(s, stream(s->history, table, id, &range, x), began,
                                        s->history->why.text);
        }
    }
    if (reached >= 0 && !x->ended && (x->most == 0 || x->n < x->most)) {
        x->mark = 0;
        range = *asked;
        range.after = x->last > range.after ? x->last : range.after;
        rc = stream(s->base.inner, table, id, &range, x);
        if (rc < 0) {
            s->base.why = s->base.inner->why;
        }
    }
    s->base.streaming = false;
    return rc < 0 ? rc : (int)x->n;
}

static int federated_history(struct apc_store *store, enum apc_table table, int id,
                             const struct apc_range *range, apc_sample_fn fn, void *ctx)
{
    struct stream x = {.sample = fn, .ctx = ctx};
    return federated_rows(federated_of(store), table, id, range, &x);
}

static int federated_vectors(struct apc_store *store, enum apc_table table, int id,
                             const struct apc_range *range, apc_vector_fn fn, void *ctx)
{
    struct stream x = {.vector = fn, .ctx = ctx};
    return federated_rows(federated_of(store), table, id, range, &x);
}

static int live_bins(struct apc_federated *s, enum apc_table table, int id, apc_ns since, apc_ns until,
                     size_t n, apc_history_bin_fn fn, void *ctx)
{
    s->base.streaming = true;
    const int count = apc_store_history_bins(s->base.inner, table, id, since, until, n, fn, ctx);
    s->base.streaming = false;
    s->base.why = count < 0 ? s->base.inner->why : s->base.why;
    return count;
}

/* The history's bins, made where the rows are, and into them what the live store has behind these. */
static int federated_history_bins(struct apc_store *store, enum apc_table table, int id, apc_ns since,
                                  apc_ns until, size_t n, apc_history_bin_fn fn, void *ctx)
{
    struct apc_federated *s = federated_of(store);
    struct apc_bins bins;
    struct apc_range range = {.since = since, .until = until};
    int64_t end = 0;
    const int reached = is_live(s, table, id, &range);
    if (reached < 0) {
        store->why = s->base.inner->why;
        return reached;
    }
    if (reached > 0 || !apc_federated_has_history(s) || history_reach(s, table, id, &end) < 0) {
        return live_bins(s, table, id, since, until, n, fn, ctx);
    }
    int rc = apc_bins_make(store, &bins, since, until, n);
    const apc_ns began = apc_clock_mono(NULL);
    if (rc == 0) {
        rc = apc_store_history_bins(s->history, table, id, since, until, n, apc_bins_take, &bins);
        rc = apc_federated_answered(s, rc, began, s->history->why.text);
    }
    if (rc < 0) {
        free(bins.bin);
        return bins.bin ? live_bins(s, table, id, since, until, n, fn, ctx) : rc;
    }
    range.after = bins.last;
    rc = apc_store_history(s->base.inner, table, id, &range, apc_bins_add, &bins);
    if (rc < 0) {
        store->why = s->base.inner->why;
    }
    rc = rc < 0 ? rc : apc_bins_give(store, &bins, fn, ctx);
    free(bins.bin);
    return rc;
}

/* The history's alone: a row that another follows there is no row of its end. */
static int federated_newest_within(struct apc_store *store, struct apc_sample *samples, size_t n,
                                   apc_ns since, apc_ns until)
{
    struct apc_federated *s = federated_of(store);
    const struct apc_store_ops *ops = s->history->ops;
    const apc_ns began = apc_clock_mono(NULL);
    int rc = 0;
    if (ops->newest_within && apc_federated_has_history(s)) {
        rc = apc_store_enter(s->history, samples, n);
        rc = rc < 0 ? rc : ops->newest_within(s->history, samples, n, since, until);
        rc = apc_federated_answered(s, rc, began, s->history->why.text);
        for (size_t i = 0; i < n; i++) {
            samples[i].author |= samples[i].author > 0 ? APC_SEAM_AUTHOR : 0;
        }
    }
    return rc < 0 ? 0 : rc;
}

/* Those of both: a run that began without its history has not got all in the live store. */
static int federated_variables(struct apc_store *store, struct apc_sample *into, size_t capacity)
{
    struct apc_federated *s = federated_of(store);
    int n_live = apc_store_variables(s->base.inner, NULL, 0), n_history = 0, n = 0;
    const apc_ns began = apc_clock_mono(NULL);
    if (n_live >= 0 && apc_federated_has_history(s)) {
        n_history = apc_store_variables(s->history, NULL, 0);
        n_history = apc_federated_answered(s, n_history, began, s->history->why.text) < 0 ? 0 : n_history;
    }
    const size_t room = (size_t)(n_live > 0 ? n_live : 0) + (size_t)n_history;
    struct apc_sample *all = (struct apc_sample *)calloc(room ? room : 1, sizeof *all);
    if (!all) {
        return apc_fail(&store->why, APC_ENOMEM, "out of memory for %zu variables", room);
    }
    const int had = n_live < 0 ? n_live : apc_store_variables(s->base.inner, all, (size_t)n_live);
    if (had < 0) {
        store->why = s->base.inner->why;
        free(all);
        return had;
    }
    n = had < n_live ? had : n_live;
    const int known = n;
    const int more = n_history > 0 ? apc_store_variables(s->history, all + n, (size_t)n_history) : 0;
    for (int i = 0; i < more && i < n_history; i++) {
        const struct apc_sample v = all[known + i];
        int k = 0;
        while (k < known && (all[k].table != v.table || all[k].id != v.id)) {
            k++;
        }
        if (k == known) {
            all[n++] = v;
        }
    }
    return apc_variables_give(all, (size_t)n, into, capacity);
}

/* The newest of @p n variables, vectors first, of one moment. */
static int read_newest_of_all(struct apc_store *store, const struct apc_sample *variable, size_t n,
                              struct apc_sample *sample, struct apc_vector *vector)
{
    struct apc_rows all = {.size = sizeof all, .sample = sample, .vector = vector};
    for (size_t i = 0; i < n; i++) {
        const struct apc_sample *v = &variable[i];
        if (apc_table_vectors(v->table)) {
            vector[all.n_vectors++] = (struct apc_vector){.table = v->table, .id = v->id};
        } else if (v->table != APC_STATE) {
            sample[all.n_samples++] = (struct apc_sample){.table = v->table, .id = v->id};
        }
    }
    const int rc = apc_store_read_rows(store, &all);
    for (size_t i = 0; i < all.n_vectors; i++) { /* of interest are seq and time */
        sample[all.n_samples + i] = (struct apc_sample){.seq = vector[i].seq, .time = vector[i].time};
    }
    return rc;
}

/* For how many ns the first of @p rows that are missing has waited, had they come at even distances. Who wrote them may
 * have a clock that is ahead: then until the newest of them. In double, as times may lie at both ends of their range. */
static double wait_of_missing(const struct apc_sample *live, const struct apc_sample *history, uint64_t rows)
{
    const double newest = (double)live->time, stored = history->seq > 0 ? (double)history->time : newest;
    return fmax((double)apc_clock_utc(NULL), newest) - (stored + (newest - stored) / (double)rows);
}

static void compare_newest(int64_t first, const struct apc_sample *live, const struct apc_sample *history,
                           size_t n, struct apc_behind *behind)
{
    double most = 0;
    behind->nothing = n > 0;
    for (size_t i = 0; i < n; i++) {
        const uint64_t rows = apc_rows_between(first, history[i].seq, live[i].seq);
        behind->nothing = behind->nothing && history[i].seq == 0;
        behind->rows += rows;
        most = rows > 0 ? fmax(most, wait_of_missing(&live[i], &history[i], rows)) : most;
    }
    behind->time = behind->nothing ? 0 : (apc_ns)fmin(most, 9e18);
}

/* The live store first: what it gets meanwhile is not what the history should have. */
static int measure_lag(struct apc_federated *s, struct apc_behind *behind)
{
    const int most = apc_store_variables(s->base.inner, NULL, 0);
    const size_t n = most > 0 ? (size_t)most : 0;
    struct apc_sample *at = (struct apc_sample *)calloc(3 * n + 1, sizeof *at);
    struct apc_vector *vector = (struct apc_vector *)calloc(n + 1, sizeof *vector);
    int rc = at && vector ? most : apc_fail(&s->base.why, APC_ENOMEM, "out of memory for %zu variables", n);
    rc = rc > 0 ? apc_store_variables(s->base.inner, at, n) : rc;
    rc = rc > 0 ? read_newest_of_all(s->base.inner, at, n, at + n, vector) : rc;
    if (rc < 0 && rc != APC_ENOMEM) {
        s->base.why = s->base.inner->why;
    }
    const apc_ns began = apc_clock_mono(NULL);
    if (rc == 0 && n > 0) {
        rc = read_newest_of_all(s->history, at, n, at + 2 * n, vector);
        rc = apc_federated_answered(s, rc, began, s->history->why.text);
    }
    if (rc == 0) {
        compare_newest(apc_store_first(s->base.inner), at + n, at + 2 * n, n, behind);
    }
    free(at);
    free(vector);
    return rc;
}

static int behind_of(struct apc_store *store, struct apc_behind *behind)
{
    struct apc_federated *s = federated_of(store);
    const int rc = apc_federated_has_history(s) ? measure_lag(s, behind) : s->failed;
    return rc < 0 ? rc : 1;
}

/* ---- What is the live store's ---------------------------------------------------------------- */

#define LIVE(store, call)                                                                                    \
    do {                                                                                                     \
        struct apc_store *live = (store)->inner;                                                             \
        const int live_rc = (call);                                                                          \
        (store)->why = live->why;                                                                            \
        return live_rc;                                                                                      \
    } while (0)

static int federated_holder(struct apc_store *store, const struct apc_sample *variable, uint64_t *holder)
{
    LIVE(store, apc_store_holder(live, variable, holder));
}

static int federated_seize(struct apc_store *store, struct apc_sample *seized, size_t n, uint64_t holder)
{
    LIVE(store, apc_store_seize(live, seized, n, holder));
}

static int federated_author_name(struct apc_store *store, uint32_t number, char name[APC_AUTHOR_LEN])
{
    struct apc_federated *s = federated_of(store);
    if (number & APC_SEAM_AUTHOR) {
        const int rc = apc_store_author_name(s->history, number & ~APC_SEAM_AUTHOR, name);
        store->why = s->history->why;
        return rc;
    }
    LIVE(store, apc_store_author_name(live, number, name));
}

/* Former ones are the history's. */
static int federated_catalogue_at(struct apc_store *store, apc_ns time, char *text, size_t size,
                                  int64_t *revision)
{
    struct apc_federated *s = federated_of(store);
    const apc_ns began = apc_clock_mono(NULL);
    *revision = 0;
    int rc =
        apc_federated_has_history(s) ? apc_store_catalogue_at(s->history, time, text, size, revision) : 0;
    rc = rc < 0 ? apc_federated_answered(s, rc, began, s->history->why.text) : rc;
    if (rc >= 0 && *revision > 0) {
        return rc;
    }
    LIVE(store, apc_store_catalogue(live, text, size, revision));
}

/* ---- Opening --------------------------------------------------------------------------------- */

static void federated_close(struct apc_store *store)
{
    struct apc_federated *s = federated_of(store);
    apc_store_close(s->base.inner);
    apc_store_close(s->history);
    free(s);
}

static const struct apc_store_ops federated_store = {
    .scheme = "",
    .close = federated_close,
    .variables = federated_variables,
    .history = federated_history,
    .history_bins = federated_history_bins,
    .newest_within = federated_newest_within,
    .events = apc_federated_events,
    .timing = apc_federated_timing,
    .vectors = federated_vectors,
    .holder = federated_holder,
    .seize = federated_seize,
    .author_name = federated_author_name,
    .catalogue_at = federated_catalogue_at,
    .behind = behind_of,
};

int apc_federated_wrap(struct apc_store **store, struct apc_store *live, struct apc_store *history_of_it,
                       struct apc_error *why)
{
    struct apc_federated *s = (struct apc_federated *)calloc(1, sizeof *s);
    if (!s) {
        apc_store_close(live);
        apc_store_close(history_of_it);
        return apc_fail(why, APC_ENOMEM, "out of memory");
    }
    s->base.ops = &federated_store;
    s->base.config = live->config;
    s->base.inner = live;
    s->history = history_of_it;
    *store = &s->base;
    return 0;
}

/* SPDX-License-Identifier: BSD-3-Clause */
/*
 * The SQLite store: history, bins, housekeeping. All go from block to block, each in a transaction of its
 * own, so that the file is never locked for longer than a block takes and is free while the caller's function
 * runs.
 */
#include "shareddata/sqlite/sqlite.h"

#include <stdlib.h>

/* A walk over the samples of one variable in rising seq. */
struct walk {
    struct apc_sqlite *sq;
    int64_t variable, since, until; /* us */
    int64_t next, end;              /* seq: from next to end */
};

/* The next block that has some: 1 with its rows in sq->loaded and the file free, 0 at the end, or an error. */
static int next_rows(struct walk *w)
{
    struct apc_sqlite_block b;
    int err = apc_sqlite_begin(w->sq, APC_SQLITE_READ);
    if (err) {
        return err;
    }
    int found = apc_sqlite_next_block(w->sq, w->variable, w->next, w->since, w->until, &b);
    if (found > 0) {
        err = apc_sqlite_load(w->sq, w->variable, &b);
    }
    return apc_sqlite_end(w->sq, err ? err : found);
}

static bool is_in_walk_range(const struct walk *w, const struct apc_sample *s)
{
    int64_t us = apc_sqlite_time(s->time);
    return s->seq >= w->next && s->seq <= w->end && us >= w->since && us < w->until;
}

/* Past the rows at hand. */
static bool advance_walk(struct walk *w)
{
    w->next = w->sq->loaded.rows[w->sq->loaded.n - 1].sample.seq + 1;
    return w->next <= w->end;
}

/* ---- History -------------------------------------------------------------------------------- */

/* From which of the rows at hand on there are @p most within the bounds; how many there are, if fewer. */
static size_t count_back(struct walk *w, size_t most)
{
    size_t n = 0;
    for (size_t i = w->sq->loaded.n; i-- > 0 && n < most;) {
        const struct apc_sample *s = &w->sq->loaded.rows[i].sample;
        if (is_in_walk_range(w, s)) {
            n++;
            w->next = n == most ? s->seq : w->next;
        }
    }
    return n;
}

/* Begin the walk at the last so many samples. What is newer when it gets there does not belong to it. */
static int begin_at_last(struct walk *w, size_t last)
{
    struct apc_sqlite_block b;
    int found, err = apc_sqlite_begin(w->sq, APC_SQLITE_READ);
    if (err) {
        return err;
    }
    found = apc_sqlite_former_block(w->sq, w->variable, INT64_MAX, w->since, w->until, &b);
    for (bool newest = true; found > 0; newest = false) {
        w->end = newest ? b.seq : w->end;
        if (b.first >= w->since && b.last < w->until && (uint64_t)b.count < last) {
            last -= (size_t)b.count;
        } else {
            err = apc_sqlite_load(w->sq, w->variable, &b);
            last -= err ? 0 : count_back(w, last);
            if (err || last == 0) {
                break;
            }
        }
        found = apc_sqlite_former_block(w->sq, w->variable, b.seq, w->since, w->until, &b);
    }
    return apc_sqlite_end(w->sq, err ? err : found < 0 ? found : 0);
}

static int give_walked_rows(struct walk *w, apc_sqlite_give_fn give, void *ctx, int *count)
{
    const struct apc_sqlite_loaded *l = &w->sq->loaded;
    int more = 1;
    for (size_t i = 0; i < l->n && more > 0; i++) {
        if (is_in_walk_range(w, &l->rows[i].sample)) {
            more = give(w->sq, &l->rows[i], ctx);
            *count += *count < INT_MAX;
        }
    }
    return more > 0 ? advance_walk(w) : more;
}

int apc_sqlite_walk(struct apc_sqlite *sq, enum apc_table table, int id, const struct apc_range *range,
                    apc_sqlite_give_fn give, void *ctx)
{
    struct walk w = {.sq = sq,
                     .variable = apc_sqlite_variable(table, id),
                     .since = apc_sqlite_bound(range->since, INT64_MIN),
                     .until = apc_sqlite_bound(range->until, INT64_MAX),
                     .next = range->after > 0 ? range->after + 1 : 0,
                     .end = INT64_MAX - 1};
    int count = 0, more = 1, err = apc_sqlite_enter(w.sq);
    if (!err && range->last > 0) {
        err = begin_at_last(&w, range->last);
    }
    while (!err && more > 0 && (more = next_rows(&w)) > 0) {
        more = give_walked_rows(&w, give, ctx, &count);
        err = more > 0 ? apc_sqlite_enter(w.sq)
                       : 0; /* a new deadline: the caller's own time is not the file's */
    }
    return err ? err : more < 0 ? more : count;
}

struct samples {
    apc_sample_fn fn;
    void *ctx;
};

static int sqlite_give_sample(struct apc_sqlite *sq, const struct apc_sqlite_row *row, void *ctx)
{
    const struct samples *s = (const struct samples *)ctx;
    sq->base.streaming = true;
    const int ended = s->fn(s->ctx, &row->sample);
    sq->base.streaming = false;
    return ended == 0;
}

int apc_sqlite_history(struct apc_store *store, enum apc_table table, int id, const struct apc_range *range,
                       apc_sample_fn fn, void *ctx)
{
    return apc_sqlite_walk(apc_sqlite_of(store), table, id, range, sqlite_give_sample,
                           &(struct samples){.fn = fn, .ctx = ctx});
}

int apc_sqlite_variables(struct apc_store *store, struct apc_sample *variables, size_t capacity)
{
    struct apc_sqlite *sq = apc_sqlite_of(store);
    sqlite3_stmt *statement = NULL;
    int count = 0, found = apc_sqlite_enter(sq);
    sq->base.stats.round_trips++;
    if (found == 0) {
        found = apc_sqlite_prepare(sq, "SELECT variable & 15, variable >> 4 FROM variable ORDER BY 1, 2",
                                   &statement);
    }
    while (found >= 0 && (found = apc_sqlite_step(sq, statement)) > 0) {
        if ((size_t)count < capacity) {
            variables[count] = (struct apc_sample){.table = (enum apc_table)sqlite3_column_int(statement, 0),
                                                   .id = sqlite3_column_int(statement, 1)};
        }
        count++;
    }
    sqlite3_finalize(statement);
    return found < 0 ? found : count;
}

/* ---- Bins ----------------------------------------------------------------------------------- */

struct bins {
    struct apc_history_bin *bin;
    size_t n;
    apc_ns since, until;
};

static struct apc_history_bin *bin_of_time(const struct bins *b, apc_ns time)
{
    double share = ((double)time - (double)b->since) / ((double)b->until - (double)b->since);
    size_t i = share > 0 ? (size_t)(share * (double)b->n) : 0;
    i = i < b->n ? i : b->n - 1;
    while (i > 0 && apc_bin_edge(b->since, b->until, b->n, i) > time) { /* what rounding did */
        i--;
    }
    while (i + 1 < b->n && apc_bin_edge(b->since, b->until, b->n, i + 1) <= time) {
        i++;
    }
    return &b->bin[i];
}

/* In rising seq. */
static void put_in_bin(struct apc_history_bin *bin, const struct apc_sample *s)
{
    bin->seq = s->seq;
    bin->worst = s->status > bin->worst ? s->status : bin->worst;
    if (apc_status_severity(s->status) == APC_SEVERITY_BAD) {
        bin->bad++;
        return;
    }
    bin->count++;
    bin->min = bin->count == 1 || s->value < bin->min ? s->value : bin->min;
    bin->max = bin->count == 1 || s->value > bin->max ? s->value : bin->max;
    bin->mean += (s->value - bin->mean) / (double)bin->count;
    bin->last = s->value;
}

static int sqlite_fill_bins(struct walk *w, const struct bins *bins)
{
    const apc_ns deadline = w->sq->deadline; /* of it all */
    int more = 1;
    while (more && (more = next_rows(w)) > 0) {
        for (size_t i = 0; i < w->sq->loaded.n; i++) {
            const struct apc_sample *s = &w->sq->loaded.rows[i].sample;
            if (is_in_walk_range(w, s)) {
                put_in_bin(bin_of_time(bins, s->time), s);
            }
        }
        more = advance_walk(w);
        if (more && apc_clock_mono(NULL) >= deadline) {
            return apc_sqlite_fail(w->sq, SQLITE_INTERRUPT);
        }
    }
    return more;
}

static int give_bins(struct apc_store *store, const struct bins *bins, apc_history_bin_fn fn, void *ctx)
{
    int count = 0;
    bool ended = false;
    store->streaming = true;
    for (size_t i = 0; i < bins->n && !ended; i++) {
        struct apc_history_bin *bin = &bins->bin[i];
        if (bin->seq > 0) {
            bin->from = apc_bin_edge(bins->since, bins->until, bins->n, i);
            bin->until = apc_bin_edge(bins->since, bins->until, bins->n, i + 1);
            ended = fn(ctx, bin) != 0;
            count++;
        }
    }
    store->streaming = false;
    return count;
}

int apc_sqlite_history_bins(struct apc_store *store, enum apc_table table, int id, apc_ns since, apc_ns until,
                            size_t n, apc_history_bin_fn fn, void *ctx)
{
    struct walk w = {.sq = apc_sqlite_of(store),
                     .variable = apc_sqlite_variable(table, id),
                     .since = apc_sqlite_time(since) + (since % 1000 != 0),
                     .until = apc_sqlite_time(until) + (until % 1000 != 0),
                     .end = INT64_MAX - 1};
    struct bins bins = {.n = n, .since = since, .until = until, .bin = calloc(n, sizeof *bins.bin)};
    if (!bins.bin) {
        return apc_fail(&store->why, APC_ENOMEM, "out of memory for %zu bins", n);
    }
    int err = apc_sqlite_enter(w.sq);
    if (!err) {
        err = sqlite_fill_bins(&w, &bins);
    }
    int count = err ? err : give_bins(store, &bins, fn, ctx);
    free(bins.bin);
    return count;
}

/* ---- Housekeeping --------------------------------------------------------------------------- */

#define SLICE (10 * APC_NS_PER_MS) /* of work in one transaction: others wait meanwhile */

/* Trim blocks of a variable, one at least, until the slice is over: 1 when there may be more. */
static int trim_slice(struct apc_sqlite *sq, int64_t variable, int64_t *next, int64_t before, int *dropped)
{
    struct apc_sqlite_block b;
    const apc_ns end = apc_clock_mono(NULL) + SLICE;
    int found = 1, err = 0;
    do {
        found = apc_sqlite_next_block(sq, variable, *next, INT64_MIN, before, &b);
        if (found > 0) {
            *next = b.seq + 1;
            err = apc_sqlite_load(sq, variable, &b);
        }
        if (found > 0 && !err) {
            int n = apc_sqlite_trim(sq, before);
            err = n < 0 ? n : 0;
            *dropped += n > 0 ? n : 0;
        }
    } while (!err && found > 0 && apc_clock_mono(NULL) < end);
    return err ? err : found;
}

static int trim_variable(struct apc_sqlite *sq, int64_t variable, int64_t before, int *dropped)
{
    int64_t next = 1;
    int more = 1;
    while (more > 0) {
        more = apc_sqlite_enter_begin(sq, APC_SQLITE_WRITE);
        if (more == 0) {
            more = apc_sqlite_end(sq, trim_slice(sq, variable, &next, before, dropped));
        }
    }
    return more;
}

int apc_sqlite_next_variable(struct apc_sqlite *sq, int64_t *variable)
{
    sqlite3_stmt *statement = NULL;
    int found = apc_sqlite_prepare(
        sq, "SELECT variable FROM variable WHERE variable > ?1 ORDER BY variable LIMIT 1", &statement);
    if (found == 0) {
        sqlite3_bind_int64(statement, 1, *variable);
        found = apc_sqlite_step(sq, statement);
    }
    if (found > 0) {
        *variable = sqlite3_column_int64(statement, 0);
    }
    sqlite3_finalize(statement);
    return found;
}

static int trim_samples(struct apc_sqlite *sq, const struct apc_retention *keep, apc_ns now, int *dropped)
{
    int64_t variable = -1;
    int found = 1;
    while (found > 0) {
        int err = apc_sqlite_enter(sq);
        found = err ? err : apc_sqlite_next_variable(sq, &variable);
        const apc_ns kept = found > 0 ? apc_table_kept(keep, (enum apc_table)(variable & 15)) : 0;
        if (kept > 0) {
            err = trim_variable(sq, variable, apc_sqlite_time(now - kept), dropped);
            found = err ? err : found;
        }
    }
    return found;
}

/* Some hundred rows at a time of a table that has id and time. */
static int trim_records(struct apc_sqlite *sq, const char *sql, int64_t before, int *dropped)
{
    int changes = 1, err = 0;
    while (!err && changes > 0) {
        sqlite3_stmt *statement = NULL;
        err = apc_sqlite_enter(sq);
        if (!err) {
            err = apc_sqlite_prepare(sq, sql, &statement);
        }
        if (!err) {
            sqlite3_bind_int64(statement, 1, before);
            err = apc_sqlite_step(sq, statement);
            changes = err ? 0 : sqlite3_changes(sq->db);
            *dropped += changes;
        }
        sqlite3_finalize(statement);
    }
    return err;
}

int apc_sqlite_maintain(struct apc_store *store, const struct apc_retention *keep)
{
    struct apc_sqlite *sq = apc_sqlite_of(store);
    const apc_ns now = apc_clock_utc(NULL);
    int dropped = 0, err = apc_sqlite_enter(sq);
    if (!err) {
        err = trim_samples(sq, keep, now, &dropped);
    }
    if (!err && keep->events > 0) {
        err = trim_records(
            sq,
            "DELETE FROM event WHERE id IN (SELECT id FROM event WHERE time < ?1 ORDER BY time LIMIT 500)",
            apc_sqlite_time(now - keep->events), &dropped);
    }
    if (!err && keep->timing > 0) {
        err = trim_records(
            sq,
            "DELETE FROM timing WHERE id IN (SELECT id FROM timing WHERE time < ?1 ORDER BY time LIMIT 500)",
            apc_sqlite_time(now - keep->timing), &dropped);
    }
    if (!err && keep->packed > 0) {
        err = apc_sqlite_pack(sq, now - keep->packed);
        dropped += err > 0 ? err : 0;
        err = err < 0 ? err : 0;
    }
    return err ? err : dropped;
}

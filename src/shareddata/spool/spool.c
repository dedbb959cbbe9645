/* SPDX-License-Identifier: BSD-3-Clause */
/*
 * A store that spools what the store behind it cannot take at the moment. Its user sees one store.
 *
 * Everything happens in the caller's thread: an acknowledgement means that the record is on disk, so another
 * thread could not give it any sooner. The store behind is asked through its public functions, so its own
 * checks hold (above all that nobody uses it from inside its history function).
 *
 * What may have been stored already, though nobody acknowledged it, lies before `unsure`: what a former
 * writer left (it may have been killed while it drained), and what was sent and had no answer.
 */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "shareddata/spool/spool.h"

/* Of a table in which this store claims some, how far its variables 1..n have come. */
struct writing {
    size_t n;
    int64_t *last;
};

struct spooling {
    struct apc_store base;
    struct apc_spool_file file;
    struct apc_spool_batch batch;
    uint64_t unsure;    /* see above; a place in the file */
    apc_ns quiet_until; /* monotonic; the store is left alone so long */
    unsigned away;      /* times in a row that it was */
    struct apc_error reason;
    struct writing writing[APC_TABLE_END];
    struct apc_claims claims;
    bool pending; /* claimed while the store was away: still to be done */
    /* The newest sample seen of each variable. One list in the order of their first use, and a cursor: who
     * goes through the same variables again finds each where he looks. */
    struct apc_sample *seen;
    size_t n_seen, seen_capacity, cursor;
};

static struct spooling *spooling_of(struct apc_store *store)
{
    return (struct spooling *)store;
}

/* It may take later what it does not take now. */
static bool is_store_away(int err)
{
    return err == APC_ECONN || err == APC_ETIMEDOUT || err == APC_EFULL;
}

/* ---- Asking the store behind ----------------------------------------------------------------- */

static bool is_quiet(const struct spooling *s)
{
    return apc_clock_mono(NULL) < s->quiet_until;
}

static int resting(struct spooling *s)
{
    s->base.why = s->reason;
    return APC_ECONN;
}

apc_ns apc_spool_pause(apc_ns waited, unsigned away, const struct apc_store_config *config)
{
    const apc_ns pause = waited * (away < 2 ? 1 : away < 3 ? 2 : 4);
    return pause < config->backoff_min   ? config->backoff_min
           : pause > config->backoff_max ? config->backoff_max
                                         : pause;
}

/* What it answered to a call that began then. */
static int note_answer(struct spooling *s, int rc, apc_ns began)
{
    apc_ns now = apc_clock_mono(NULL);
    s->base.stats = s->base.inner->stats;
    if (rc >= 0) {
        s->quiet_until = 0;
        s->away = 0;
        return rc;
    }
    s->base.why = s->base.inner->why;
    if (is_store_away(rc)) {
        s->reason = s->base.inner->why;
        s->quiet_until = now + apc_spool_pause(now - began, ++s->away, &s->base.config);
    }
    return rc;
}

static int spool_answered(struct apc_store *store, int rc, apc_ns began)
{
    return note_answer(spooling_of(store), rc, began);
}

/* ---- What was seen --------------------------------------------------------------------------- */

static struct apc_sample *find_seen(struct spooling *s, enum apc_table table, int id)
{
    for (size_t i = 0; i < s->n_seen; i++) {
        struct apc_sample *at = &s->seen[(s->cursor + i) % s->n_seen];
        if (at->table == table && at->id == id) {
            s->cursor = (s->cursor + i + 1) % s->n_seen;
            return at;
        }
    }
    return NULL;
}

/* A newer one, or, while nothing waits, what the store says: it may have been put back to an older state.
 * Without memory for one more it is not remembered, that is all. */
static void see_newer(struct spooling *s, const struct apc_sample *sample)
{
    struct apc_sample *seen = find_seen(s, sample->table, sample->id);
    if (!seen && s->n_seen == s->seen_capacity) {
        size_t capacity = 2 * s->seen_capacity + 64;
        struct apc_sample *grown = realloc(s->seen, capacity * sizeof *grown);
        if (!grown) {
            return;
        }
        s->seen = grown;
        s->seen_capacity = capacity;
    }
    if (!seen) {
        seen = &s->seen[s->n_seen++];
        *seen = (struct apc_sample){0};
    }
    if (sample->seq >= seen->seq || apc_spool_empty(&s->file)) {
        *seen = *sample;
    }
}

static int spool_read_newest(struct apc_store *store, struct apc_sample *samples, size_t n)
{
    struct spooling *s = spooling_of(store);
    apc_ns began = apc_clock_mono(NULL);
    int rc = is_quiet(s) ? resting(s) : note_answer(s, apc_store_read(s->base.inner, samples, n), began);
    if (rc < 0 && !is_store_away(rc)) {
        return rc;
    }
    for (size_t i = 0; i < n; i++) {
        if (rc == 0) {
            see_newer(s, &samples[i]);
        }
        const struct apc_sample *seen = find_seen(s, samples[i].table, samples[i].id);
        if (!seen) {
            if (rc < 0) {
                return rc;
            }
            continue;
        }
        samples[i] = *seen;
        if (rc < 0 && apc_status_severity(seen->status) != APC_SEVERITY_BAD) {
            samples[i].status = APC_UNCERTAIN_LAST_USABLE;
        }
    }
    return 0;
}

/* ---- How far the writer has come ------------------------------------------------------------- */

static int reserve_writing(struct writing *w, size_t n)
{
    if (n > w->n) {
        int64_t *last = realloc(w->last, (n + 1) * sizeof *last);
        if (!last) {
            return APC_ENOMEM;
        }
        memset(last + w->n, 0, (n - w->n) * sizeof *last);
        w->last = last;
        w->n = n;
    }
    return 0;
}

/* These seqs are used up, whether the samples will be stored or not. */
static void use_up(struct spooling *s, const struct apc_sample *samples, size_t n)
{
    for (size_t i = 0; i < n; i++) {
        struct writing *w = &s->writing[samples[i].table];
        if (samples[i].id >= 1 && (size_t)samples[i].id <= w->n &&
            samples[i].seq > w->last[samples[i].id - 1]) {
            w->last[samples[i].id - 1] = samples[i].seq;
        }
    }
}

/* Found in the file at opening. */
static int recovered(void *ctx, enum apc_spool_kind kind, const struct apc_sample *sample)
{
    struct spooling *s = (struct spooling *)ctx;
    if (!apc_table_known(sample->table) || sample->id < 0) {
        return APC_EPROTO;
    }
    if (kind == APC_SPOOL_BASE && sample->id >= 1 &&
        reserve_writing(&s->writing[sample->table], (size_t)sample->id) != 0) {
        return APC_ENOMEM;
    }
    use_up(s, sample, 1);
    if (kind == APC_SPOOL_SAMPLES) {
        see_newer(s, sample);
    }
    return 0;
}

/* The first records of an outage: from which seqs whoever finds the file has to count on. */
static int put_base(struct spooling *s, struct apc_error *why)
{
    int err = 0;
    for (enum apc_table table = APC_SENSOR; table < APC_TABLE_END && !err; table++) {
        const struct writing *w = &s->writing[table];
        if (w->n == 0) {
            continue;
        }
        struct apc_sample *base = calloc(w->n, sizeof *base);
        for (size_t i = 0; i < w->n && base; i++) {
            base[i] = (struct apc_sample){.table = table, .id = (int)i + 1, .seq = w->last[i]};
        }
        err = base ? apc_spool_put(&s->file, APC_SPOOL_BASE, base, w->n, why)
                   : apc_fail(why, APC_ENOMEM, "out of memory for a spool's first record of %zu", w->n);
        free(base);
    }
    return err;
}

/* ---- Draining ------------------------------------------------------------------------------- */

static bool same_sample(const struct apc_sample *a, const struct apc_sample *b)
{
    return a->id == b->id && a->seq == b->seq && a->time / APC_NS_PER_US == b->time / APC_NS_PER_US &&
           a->status == b->status && a->value == b->value;
}

/* Samples or events that stand in the store leave the batch. */
struct standing {
    struct apc_spool_batch *batch;
};

static int strike_sample(void *ctx, const struct apc_sample *row)
{
    struct apc_spool_batch *b = ((struct standing *)ctx)->batch;
    for (size_t i = 0; i < b->n; i++) {
        if (b->samples[i].table == row->table && same_sample(&b->samples[i], row)) {
            b->samples[i] = b->samples[--b->n];
            return 0;
        }
    }
    return 0;
}

static int strike_event(void *ctx, const struct apc_event *row)
{
    struct apc_spool_batch *b = ((struct standing *)ctx)->batch;
    for (size_t i = 0; i < b->n; i++) {
        const struct apc_event *e = &b->events[i];
        if (e->time / APC_NS_PER_US == row->time / APC_NS_PER_US && strcmp(e->source, row->source) == 0 &&
            strcmp(e->kind, row->kind) == 0 && strcmp(e->text, row->text) == 0) {
            memmove(&b->events[i], &b->events[i + 1], (--b->n - i) * sizeof *b->events);
            return 0;
        }
    }
    return 0;
}

/* The batch was appended, but some of it stood there: is that ours? A writer that may not read what it writes
 * has to believe it where it may be so. */
static int verify_batch(struct spooling *s)
{
    struct apc_spool_batch *b = &s->batch;
    struct standing standing = {b};
    while (b->n > 0) { /* one variable after the other */
        const enum apc_table table = b->samples[0].table;
        const int id = b->samples[0].id;
        struct apc_range range = {.since = INT64_MAX, .until = INT64_MIN};
        size_t after = 0;
        for (size_t i = 0; i < b->n; i++) {
            if (b->samples[i].table == table && b->samples[i].id == id) {
                apc_ns time = b->samples[i].time;
                range.since = time < range.since ? time : range.since;
                range.until = time > range.until ? time : range.until;
            }
        }
        range.since -= APC_NS_PER_US;
        range.until += APC_NS_PER_US;
        apc_ns began = apc_clock_mono(NULL);
        int rc = apc_store_history(s->base.inner, table, id, &range, strike_sample, &standing);
        if (rc == APC_EPERM) {
            return b->begin < s->unsure ? 0 : APC_ECONFLICT;
        }
        if (rc < 0) {
            return note_answer(s, rc, began);
        }
        for (size_t i = 0; i < b->n; i++) {
            after += b->samples[i].table == table && b->samples[i].id == id;
        }
        if (after > 0) {
            return APC_ECONFLICT;
        }
    }
    return 0;
}

static int drain_samples(struct spooling *s)
{
    apc_ns began = apc_clock_mono(NULL);
    size_t n = s->batch.n;
    int rc = note_answer(s, apc_store_append(s->base.inner, s->batch.samples, n), began);
    if (rc < 0 || (size_t)rc == n) {
        return rc;
    }
    rc = verify_batch(s);
    s->batch.n = n;
    if (rc == APC_ECONFLICT && apc_spool_set_aside(&s->file, "conflict", false, &s->base.why) == 0) {
        s->file.stats.damaged++;
        s->file.stats.samples = s->file.stats.events = s->file.stats.bytes = 0;
        s->file.stats.oldest = 0;
        (void)apc_fail(&s->base.why, rc,
                       "while the store was offline, another writer wrote the same %s: ours are kept in %s",
                       apc_table_name(s->batch.samples[0].table), s->file.stats.aside);
    }
    return rc;
}

static int drain_events(struct spooling *s)
{
    struct apc_spool_batch *b = &s->batch;
    apc_ns began = apc_clock_mono(NULL);
    const size_t n = b->n;
    int rc = 0;
    if (b->begin < s->unsure) {
        struct standing standing = {b};
        struct apc_range range = {.since = INT64_MAX, .until = INT64_MIN};
        for (size_t i = 0; i < n; i++) {
            range.since = b->events[i].time < range.since ? b->events[i].time : range.since;
            range.until = b->events[i].time > range.until ? b->events[i].time : range.until;
        }
        range.since -= APC_NS_PER_US;
        range.until += APC_NS_PER_US;
        rc = apc_store_events(s->base.inner, &range, strike_event, &standing);
    }
    if (rc >= 0 || rc == APC_EPERM) {
        rc = apc_store_append_events(s->base.inner, b->events, b->n);
    }
    b->n = n;
    return note_answer(s, rc, began);
}

static int drain_batch(struct spooling *s)
{
    int rc = apc_spool_peek(&s->file, &s->batch, &s->base.why);
    if (rc == APC_EPROTO) { /* it was whole when it was opened */
        rc = apc_spool_recover(&s->file, recovered, s, &s->base.why);
        s->unsure = s->file.end;
        return rc;
    }
    if (rc < 0) {
        return rc;
    }
    if (s->batch.n == 0) { /* only how far the writer was, which the store knows, if it is there */
        apc_ns began = apc_clock_mono(NULL);
        rc = note_answer(s, apc_store_connect(s->base.inner), began);
    } else {
        rc = s->batch.kind == APC_SPOOL_EVENTS ? drain_events(s) : drain_samples(s);
    }
    if (is_store_away(rc) && s->unsure < s->batch.end) {
        s->unsure = s->batch.end;
    }
    return rc < 0 ? rc : apc_spool_advance(&s->file, &s->batch, &s->base.why);
}

/* Claims that were taken on trust while the store was away. */
static int claim_pending(struct spooling *s)
{
    if (!s->pending) {
        return 0;
    }
    apc_ns began = apc_clock_mono(NULL);
    int rc = note_answer(s, apc_store_claim_set(s->base.inner, s->claims.at, s->claims.n), began);
    s->pending = rc < 0;
    return rc;
}

/* A portion of what waits. Returns 0, or why there is still something. */
static int drain_portion(struct spooling *s)
{
    const apc_ns enough = apc_clock_mono(NULL) + s->base.config.timeout / 10;
    if (apc_spool_empty(&s->file)) {
        return 0;
    }
    if (is_quiet(s)) {
        return resting(s);
    }
    int rc = claim_pending(s);
    while (rc >= 0 && !apc_spool_empty(&s->file) && (rc = drain_batch(s)) >= 0 &&
           apc_clock_mono(NULL) < enough) {
    }
    s->file.stats.blocked = rc < 0 && !is_store_away(rc) ? rc : 0;
    return rc < 0 ? rc : 0;
}

/* ---- Appending ------------------------------------------------------------------------------ */

static bool may_fall_back(const struct spooling *s)
{
    return s->base.config.spool_or_memory && !s->file.memory;
}

static int keep_in_spool(struct spooling *s, enum apc_spool_kind kind, const void *items, size_t n, bool sent)
{
    struct apc_error why = {""};
    bool first = apc_spool_empty(&s->file);
    if (first) {
        s->unsure = 0;
    }
    int err = first ? put_base(s, &why) : 0;
    if (!err) {
        err = apc_spool_put(&s->file, kind, items, n, &why);
    }
    if (err == APC_ESTORE && first && may_fall_back(s) && apc_spool_to_memory(&s->file, &why) == 0) {
        err = put_base(s, &why);
        err = err ? err : apc_spool_put(&s->file, kind, items, n, &why);
    }
    if (err) {
        s->file.stats.refused += n;
        return apc_fail(&s->base.why, err, "%s (the store: %.200s)", why.text, s->reason.text);
    }
    if (sent) {
        s->unsure = s->file.end;
    }
    return 0;
}

/* @p sent: the store was asked, and may have it. What tells the writer to stop is said although the record is
 * safe; that the store refuses a part of what waits is not: it goes on waiting. */
static int spool(struct spooling *s, enum apc_spool_kind kind, const void *items, size_t n, bool sent)
{
    int rc = keep_in_spool(s, kind, items, n, sent);
    const struct apc_error why = s->base.why;
    int left = drain_portion(s); /* also when it is full: there may be room the next time */
    if (rc < 0) {
        s->base.why = why;
        return rc;
    }
    return left == APC_EBUSY || left == APC_ECONFLICT || left == APC_ESCHEMA ? left : (int)n;
}

static int spool_append(struct apc_store *store, const struct apc_sample *samples, size_t n)
{
    struct spooling *s = spooling_of(store);
    bool direct = apc_spool_empty(&s->file) && !is_quiet(s);
    int rc = APC_ECONN;
    use_up(s, samples, n);
    if (direct) {
        apc_ns began = apc_clock_mono(NULL);
        rc = note_answer(s, apc_store_append(s->base.inner, samples, n), began);
    }
    if (is_store_away(rc)) {
        rc = spool(s, APC_SPOOL_SAMPLES, samples, n, direct);
    }
    for (size_t i = 0; rc >= 0 && i < n; i++) {
        see_newer(s, &samples[i]);
    }
    return rc;
}

static int spool_append_events(struct apc_store *store, const struct apc_event *events, size_t n)
{
    struct spooling *s = spooling_of(store);
    bool direct = apc_spool_empty(&s->file) && !is_quiet(s);
    int rc = APC_ECONN;
    if (direct) {
        apc_ns began = apc_clock_mono(NULL);
        rc = note_answer(s, apc_store_append_events(s->base.inner, events, n), began);
    }
    return is_store_away(rc) ? spool(s, APC_SPOOL_EVENTS, events, n, direct) : rc;
}

/* ---- Claiming ------------------------------------------------------------------------------- */

/* Does what waits say how far all of them had come? */
static bool is_known(const struct spooling *s, const struct apc_sample *variables, size_t n)
{
    bool known = !apc_spool_empty(&s->file);
    for (size_t i = 0; known && i < n; i++) {
        known = variables[i].id >= 1 && (size_t)variables[i].id <= s->writing[variables[i].table].n;
    }
    return known;
}

/* What waits is one writer's. */
static int check_left(struct spooling *s, const struct apc_sample *variables, size_t n)
{
    for (enum apc_table other = APC_SENSOR; !apc_spool_empty(&s->file) && other < APC_TABLE_END; other++) {
        bool named = s->writing[other].n == 0;
        for (size_t i = 0; i < n; i++) {
            named = named || variables[i].table == other || s->writing[variables[i].table].n > 0;
        }
        if (!named) {
            return apc_fail(&s->base.why, APC_EINVAL,
                            "spool %s holds what a writer of table %s left: drain it first", s->file.path,
                            apc_table_name(other));
        }
    }
    return 0;
}

/* How far it has come: what the store says, if it does, or what still waits. */
static void count_on(struct spooling *s, struct apc_sample *v, bool trusted)
{
    const struct apc_sample *seen = find_seen(s, v->table, v->id);
    int64_t newest = trusted ? 0 : v->seq;
    newest = seen && seen->seq > newest ? seen->seq : newest;
    if (v->id >= 1) {
        int64_t *last = &s->writing[v->table].last[v->id - 1];
        *last = newest > *last ? newest : *last;
        newest = *last;
    }
    v->seq = newest;
}

static int spool_claim(struct apc_store *store, struct apc_sample *variables, size_t n)
{
    struct spooling *s = spooling_of(store);
    const bool known = is_known(s, variables, n);
    int rc = check_left(s, variables, n);
    if (rc < 0) {
        return rc;
    }
    apc_ns began = apc_clock_mono(NULL);
    rc = note_answer(s, apc_store_claim_set(s->base.inner, variables, n), began);
    bool trusted = known && is_store_away(rc);
    if (rc < 0 && !trusted) {
        return rc;
    }
    rc = apc_claims_reserve(store, &s->claims, n);
    for (size_t i = 0; !rc && i < n; i++) {
        const size_t id = variables[i].id > 0 ? (size_t)variables[i].id : 0;
        if (id > s->writing[variables[i].table].n &&
            reserve_writing(&s->writing[variables[i].table], id) != 0) {
            rc = apc_fail(&s->base.why, APC_ENOMEM, "out of memory for a claim of %zu", n);
        }
    }
    if (rc) {
        return rc;
    }
    apc_claims_add(&s->claims, variables, n);
    s->pending = trusted;
    for (size_t i = 0; i < n; i++) {
        count_on(s, &variables[i], trusted);
    }
    return 0;
}

/* What waits in the spool is ours still. */
static int spool_release(struct apc_store *store, const struct apc_sample *variables, size_t n)
{
    apc_claims_drop(&spooling_of(store)->claims, variables, n);
    const apc_ns began = apc_clock_mono(NULL);
    return note_answer(spooling_of(store), apc_store_release(store->inner, variables, n), began);
}

/* ---- Everything else ------------------------------------------------------------------------ */

static int spool_connect(struct apc_store *store)
{
    struct spooling *s = spooling_of(store);
    if (is_quiet(s)) {
        return resting(s);
    }
    apc_ns began = apc_clock_mono(NULL);
    int rc = note_answer(s, apc_store_connect(s->base.inner), began);
    return rc < 0 ? rc : drain_portion(s);
}

static void spool_stats(const struct apc_store *store, struct apc_store_stats *out)
{
    const struct spooling *s = (const struct spooling *)store;
    *out = s->base.inner->stats;
    out->spool = s->file.stats;
}

static void free_all(struct spooling *s)
{
    apc_store_close(s->base.inner);
    for (enum apc_table table = APC_SENSOR; table < APC_TABLE_END; table++) {
        free(s->writing[table].last);
    }
    free(s->batch.samples);
    free(s->batch.events);
    free(s->claims.at);
    free(s->seen);
    free(s);
}

static void spool_close(struct apc_store *store)
{
    apc_spool_close(&spooling_of(store)->file);
    free_all(spooling_of(store));
}

static const struct apc_store_ops spooling_store = {
    .scheme = "",
    .close = spool_close,
    .answered = spool_answered,
    .stats = spool_stats,
    .connect = spool_connect,
    .read = spool_read_newest,
    .append = spool_append,
    .claim_set = spool_claim,
    .release = spool_release,
    .append_events = spool_append_events,
};

int apc_spool_wrap(struct apc_store **store, struct apc_store *inner, const char *uri, const char *path,
                   uint64_t capacity, struct apc_error *why)
{
    char identity[2048];
    struct spooling *s = (struct spooling *)calloc(1, sizeof *s);
    if (!s) {
        apc_store_close(inner);
        return apc_fail(why, APC_ENOMEM, "out of memory");
    }
    s->base.ops = &spooling_store;
    s->base.config = inner->config;
    s->base.inner = inner;
    apc_spool_identity(uri, identity, sizeof identity);
    const char *name = inner->config.name;
    struct apc_error disk = {""};
    int err = apc_spool_open(&s->file, path, name, identity, capacity, recovered, s, &disk);
    if (err == APC_ESTORE && *path && inner->config.spool_or_memory) {
        apc_spool_left(path, name, identity, recovered, s); /* its seqs are not given out again */
        capacity = capacity < APC_SPOOL_IN_MEMORY ? capacity : APC_SPOOL_IN_MEMORY;
        char instead[sizeof disk.text];
        memcpy(instead, disk.text, sizeof instead);
        err = apc_spool_open(&s->file, "", name, identity, capacity, recovered, s, &disk);
        snprintf(s->file.stats.instead, sizeof s->file.stats.instead, "%.*s",
                 (int)sizeof s->file.stats.instead - 1, instead);
    }
    if (err) {
        (void)apc_fail(why, err, "%s", disk.text);
        free_all(s);
        return err;
    }
    s->unsure = s->file.end;
    *store = &s->base;
    return 0;
}

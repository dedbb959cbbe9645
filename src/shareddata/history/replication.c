/* SPDX-License-Identifier: BSD-3-Clause */
/*
 * From one store into another, over the public interface of both.
 *
 * Where it is, it does not write down: of each variable that is the newest seq in TO, read when the variable
 * is first seen and after every failure, and known in between. A batch is appended at once and each
 * variable's rows in rising seq, so nothing below the newest is still to come; and a row that is there
 * already is left alone, so a batch whose answer was lost is sent again. Vectors go before samples: what
 * names a tick finds it.
 *
 * TO may come back older, from a backup that is restored. So before it gets more it is asked for what it took
 * last, and where that is gone all places are read anew. (What is restored between that question and the
 * append, milliseconds, has a hole.)
 *
 * A step takes of each variable what there was when it began, as of one moment, so that TO as a whole is
 * FROM as it was. Only when a step is cut short is one variable ahead of another.
 */
#include <stdlib.h>
#include <string.h>

#include "shareddata/history/replication.h"

#define SAMPLES  16384 /* of one append */
#define VECTORS  1024
#define ELEMENTS 131072 /* of all of them; more than one can have */

/* ---- Failures ------------------------------------------------------------------------------ */

int apc_replication_fail_from(struct apc_replication *f, int err)
{
    f->stats.away = false;
    return apc_fail(&f->why, err, "reading: %s", apc_store_error(f->from));
}

/* How far each variable is in TO is to be asked again. */
static void lose_places(struct apc_replication *f)
{
    for (size_t i = 0; i < f->n; i++) {
        f->variable[i].placed = false;
    }
}

/* What became of an append is not known, nor what else happened in TO. */
int apc_replication_fail_to(struct apc_replication *f, int err)
{
    f->stats.away = true;
    f->described = false;
    lose_places(f);
    return apc_fail(&f->why, err, "writing: %s", apc_store_error(f->to));
}

int apc_replication_no_memory(struct apc_replication *f)
{
    f->stats.away = false;
    return apc_fail(&f->why, APC_ENOMEM, "out of memory");
}

/* After something was moved: a step without time would get nowhere. */
static bool late(const struct apc_replication *f)
{
    return f->moved > 0 && apc_clock_mono(NULL) >= f->deadline;
}

/* ---- Descriptions -------------------------------------------------------------------------- */

/* FROM's descriptions, and TO's own of variables that FROM does not describe, unless TO has them. */
static int send_tags(struct apc_replication *f, const struct apc_tag *to, size_t n_to)
{
    int64_t revision = 0;
    const int length = apc_store_catalogue(f->from, NULL, 0, &revision);
    const int there = length < 0 ? 0 : apc_store_catalogue(f->to, NULL, 0, NULL);
    if (length < 0 || there < 0) {
        return length < 0 ? apc_replication_fail_from(f, length) : apc_replication_fail_to(f, there);
    }
    struct apc_tag *all = (struct apc_tag *)calloc(f->n_tags + n_to + 1, sizeof *all);
    char *text = (char *)calloc((size_t)length + 1, 1), *old = (char *)calloc((size_t)there + 1, 1);
    size_t n = f->n_tags, same = 0;
    int rc = all && text && old ? 0 : apc_replication_no_memory(f);
    if (rc == 0 && (rc = apc_store_catalogue(f->from, text, (size_t)length + 1, &revision)) < 0) {
        rc = apc_replication_fail_from(f, rc);
    }
    if (rc >= 0 && (rc = apc_store_catalogue(f->to, old, (size_t)there + 1, NULL)) < 0) {
        rc = apc_replication_fail_to(f, rc);
    }
    for (size_t i = 0; rc >= 0 && i < f->n_tags; i++) {
        const struct apc_tag *b = apc_tag_of(to, n_to, &f->tag[i]);
        all[i] = f->tag[i];
        same += b && apc_tags_alike(&f->tag[i], b);
    }
    for (size_t i = 0; rc >= 0 && i < n_to; i++) {
        if (!apc_tag_of(f->tag, f->n_tags, &to[i])) {
            all[n++] = to[i];
        }
    }
    if (rc >= 0 && (same < f->n_tags || (revision > 0 && strcmp(text, old) != 0)) &&
        (rc = apc_store_describe(f->to, all, n, revision > 0 ? text : NULL)) < 0) {
        rc = apc_replication_fail_to(f, rc);
    }
    f->revision = revision;
    f->described = rc >= 0;
    free(all);
    free(text);
    free(old);
    return rc < 0 ? rc : 0;
}

/* When they have changed, or TO may not have them. */
static int copy_descriptions(struct apc_replication *f)
{
    struct apc_tag *now = NULL, *to = NULL;
    size_t n = 0, n_to = 0;
    int64_t revision = 0;
    int rc = apc_tags_load(f->from, &now, &n);
    if (rc >= 0 && (rc = apc_store_catalogue(f->from, NULL, 0, &revision)) >= 0) {
        rc = 0;
    }
    if (rc < 0) {
        free(now);
        return rc == APC_ENOMEM ? apc_replication_no_memory(f) : apc_replication_fail_from(f, rc);
    }
    bool changed = n != f->n_tags || revision != f->revision;
    for (size_t i = 0; !changed && i < n; i++) {
        const struct apc_tag *b = &f->tag[i];
        changed = now[i].table != b->table || now[i].id != b->id || !apc_tags_alike(&now[i], b);
    }
    free(f->tag);
    f->tag = now;
    f->n_tags = n;
    f->described = f->described && !changed;
    if (f->described || n == 0) {
        return 0;
    }
    rc = apc_tags_load(f->to, &to, &n_to);
    if (rc < 0) {
        rc = rc == APC_ENOMEM ? apc_replication_no_memory(f) : apc_replication_fail_to(f, rc);
    }
    if (rc == 0) { /* two experiments in one store would be one series of each variable */
        rc = apc_tags_compare(f->tag, f->n_tags, to, n_to, &f->why);
        f->stats.away = f->stats.away || rc < 0;
    }
    if (rc == 0) {
        rc = send_tags(f, to, n_to);
    }
    free(to);
    return rc;
}

/* ---- Where it is --------------------------------------------------------------------------- */

static int grow_replicated(struct apc_replication *f, size_t n)
{
    struct apc_replication_variable *variable =
        (struct apc_replication_variable *)realloc(f->variable, n * sizeof *variable);
    if (!variable) {
        return apc_replication_no_memory(f);
    }
    f->variable = variable;
    struct apc_sample *ask = (struct apc_sample *)realloc(f->ask, n * sizeof *ask);
    if (!ask) {
        return apc_replication_no_memory(f);
    }
    f->ask = ask;
    struct apc_vector *vector = (struct apc_vector *)realloc(f->ask_vector, n * sizeof *vector);
    if (!vector) {
        return apc_replication_no_memory(f);
    }
    f->ask_vector = vector;
    return 0;
}

static int by_kind(const void *a, const void *b)
{
    const struct apc_sample *x = &((const struct apc_replication_variable *)a)->at,
                            *y = &((const struct apc_replication_variable *)b)->at;
    const bool v = apc_table_vectors(x->table), w = apc_table_vectors(y->table);
    return v != w                 ? w - v
           : x->table != y->table ? (x->table > y->table) - (x->table < y->table)
                                  : (x->id > y->id) - (x->id < y->id);
}

/* Variables that have come since the last time. Nothing reads table state, of version 1, any more. */
static int list_new_variables(struct apc_replication *f)
{
    const int room = apc_store_variables(f->from, NULL, 0);
    if (room < 0 || (size_t)room == f->n) {
        return room < 0 ? apc_replication_fail_from(f, room) : 0;
    }
    const size_t known = f->n;
    const int rc = grow_replicated(f, known + (size_t)room);
    const int n = rc < 0 ? 0 : apc_store_variables(f->from, f->ask, (size_t)room);
    if (rc < 0 || n < 0) {
        return rc < 0 ? rc : apc_replication_fail_from(f, n);
    }
    for (int i = 0; i < n && i < room; i++) { /* those that come meanwhile have their turn */
        const struct apc_replication_variable new = {.at = {.table = f->ask[i].table, .id = f->ask[i].id}};
        if (new.at.table != APC_STATE && !(known && bsearch(&new, f->variable, known, sizeof new, by_kind))) {
            f->variable[f->n++] = new;
        }
    }
    qsort(f->variable, f->n, sizeof *f->variable, by_kind);
    f->n_vectors = f->turn = 0;
    while (f->n_vectors < f->n && apc_table_vectors(f->variable[f->n_vectors].at.table)) {
        f->n_vectors++;
    }
    return 0;
}

/* The newest of all, as of one moment, into ask_vector and ask. */
static int read_newest_of_both(struct apc_replication *f, struct apc_store *store)
{
    const size_t n_samples = f->n - f->n_vectors;
    for (size_t i = 0; i < f->n_vectors; i++) {
        f->ask_vector[i] = (struct apc_vector){.table = f->variable[i].at.table, .id = f->variable[i].at.id};
    }
    for (size_t i = 0; i < n_samples; i++) {
        const struct apc_sample *at = &f->variable[f->n_vectors + i].at;
        f->ask[i] = (struct apc_sample){.table = at->table, .id = at->id};
    }
    struct apc_rows rows = {.size = sizeof rows,
                            .sample = f->ask,
                            .n_samples = n_samples,
                            .vector = f->ask_vector,
                            .n_vectors = f->n_vectors};
    return apc_store_read_rows(store, &rows);
}

static int64_t seq_read(const struct apc_replication *f, size_t i)
{
    return i < f->n_vectors ? f->ask_vector[i].seq : f->ask[i - f->n_vectors].seq;
}

static apc_ns time_read(const struct apc_replication *f, size_t i)
{
    return i < f->n_vectors ? f->ask_vector[i].time : f->ask[i - f->n_vectors].time;
}

/* Has it what it took last? */
static int look_at_to(struct apc_replication *f)
{
    const bool vector = apc_table_vectors(f->last.table);
    struct apc_sample s = {.table = f->last.table, .id = f->last.id};
    struct apc_vector v = {.table = f->last.table, .id = f->last.id};
    struct apc_rows rows = {
        .size = sizeof rows, .sample = &s, .n_samples = !vector, .vector = &v, .n_vectors = vector};
    if (f->last.seq == 0 || f->stats.behind == 0) {
        return 0;
    }
    const int rc = apc_store_read_rows(f->to, &rows);
    if (rc < 0) {
        return apc_replication_fail_to(f, rc);
    }
    if ((vector ? v.seq : s.seq) < f->last.seq) {
        f->described = false;
        lose_places(f);
    }
    return 0;
}

/* All that is known of TO was of before. */
static void begin_anew(struct apc_replication *f)
{
    f->stats.older++;
    f->events = f->timing = (struct apc_replication_cursor){.doubtful = true};
    f->last.seq = 0;
    f->n_authors = 0;
    for (size_t i = 0; i < f->n; i++) {
        f->variable[i].missing = 0;
    }
}

/* How much TO has not got; or that it cannot have got what it has from here. */
static int compare_stores(struct apc_replication *f)
{
    f->stats.behind = 0;
    for (size_t i = 0; i < f->n; i++) {
        const struct apc_replication_variable *v = &f->variable[i];
        if (v->placed && v->stored > v->newest) {
            f->stats.away = true;
            return apc_fail(&f->why, APC_ECONFLICT,
                            "it has %s %d up to seq %lld, newer than %lld here: it is of another run, or the "
                            "clock of one was wrong",
                            apc_table_name(v->at.table), v->at.id, (long long)v->stored,
                            (long long)v->newest);
        }
        f->stats.behind += apc_rows_between(f->first, v->stored, v->newest);
    }
    return 0;
}

/* Become the one who writes those in TO that are new, then see what it has. */
static int find_places(struct apc_replication *f)
{
    size_t n = 0;
    for (size_t i = 0; i < f->n; i++) {
        if (!f->variable[i].placed) {
            f->ask[n++] = (struct apc_sample){.table = f->variable[i].at.table, .id = f->variable[i].at.id};
        }
    }
    if (n == 0) {
        return 0;
    }
    int rc = apc_store_claim_set(f->to, f->ask, n);
    if (rc >= 0) {
        rc = read_newest_of_both(f, f->to);
    }
    if (rc < 0) {
        return apc_replication_fail_to(f, rc);
    }
    bool older = false;
    f->kept = false;
    f->kept_until = 0;
    for (size_t i = 0; i < f->n; i++) {
        struct apc_replication_variable *v = &f->variable[i];
        older = older || seq_read(f, i) < v->stored;
        v->gone = seq_read(f, i) == 0 && (v->gone || v->stored > 0);
        f->kept = f->kept || seq_read(f, i) > f->first;
        f->kept_until = time_read(f, i) > f->kept_until ? time_read(f, i) : f->kept_until;
        v->ours = v->ours && (seq_read(f, i) == v->at.seq || seq_read(f, i) == v->stored);
        v->at.seq = v->stored = seq_read(f, i);
        v->at.time = time_read(f, i);
        v->placed = true;
    }
    if (older) {
        begin_anew(f);
    }
    rc = compare_stores(f);
    rc = rc == 0 ? apc_replication_compare_places(f) : rc;
    if (rc < 0) {
        lose_places(f);
    }
    return rc;
}

static int look_at_from(struct apc_replication *f)
{
    int rc = list_new_variables(f);
    if (rc == 0 && f->n > 0 && (rc = read_newest_of_both(f, f->from)) < 0) {
        return apc_replication_fail_from(f, rc);
    }
    f->first = apc_store_first(f->from);
    for (size_t i = 0; rc == 0 && i < f->n; i++) {
        f->variable[i].newest = seq_read(f, i);
        f->variable[i].read = false;
    }
    return rc;
}

/* ---- Samples and vectors ------------------------------------------------------------------- */

/* A number of an author is a name's in its own store only. 0: FROM does not know it. */
static int find_author_in_target(struct apc_replication *f, uint32_t number)
{
    char name[APC_AUTHOR_LEN];
    for (size_t i = 0; i < f->n_authors; i++) {
        if (f->author[i].from == number) {
            return (int)f->author[i].to;
        }
    }
    struct apc_replication_author *grown =
        (struct apc_replication_author *)realloc(f->author, (f->n_authors + 1) * sizeof *grown);
    if (!grown) {
        return apc_replication_no_memory(f);
    }
    f->author = grown;
    int rc = apc_store_author_name(f->from, number, name);
    if (rc < 0 && rc != APC_ENOTFOUND) {
        return apc_replication_fail_from(f, rc);
    }
    rc = rc < 0 ? 0 : apc_store_author(f->to, name);
    if (rc < 0) {
        return apc_replication_fail_to(f, rc);
    }
    f->author[f->n_authors++] = (struct apc_replication_author){number, (uint32_t)rc};
    return rc;
}

void apc_replication_count(struct apc_replication *f, uint64_t *of, int stored)
{
    *of += (uint64_t)stored;
    f->moved += stored;
}

/* What is missing is on record before what follows it: else a process that ends in between would leave a gap
 * without a word. */
static int tell_before(struct apc_replication *f)
{
    const bool any = f->tell && f->gap.variables > 0;
    const int rc = any ? apc_replication_tell_gap(f) : 0;
    return any && rc == 0 ? apc_replication_events(f) : rc;
}

static int flush_row_batch(struct apc_replication *f)
{
    int rc = tell_before(f);
    if (rc < 0) {
        return rc;
    }
    const struct apc_rows rows = {.size = sizeof rows, .vector = f->vector, .n_vectors = f->vectors};
    for (size_t i = 0; i < f->samples; i++) {
        const int author = f->sample[i].author > 0 ? find_author_in_target(f, f->sample[i].author) : 0;
        if (author < 0) {
            return author;
        }
        f->sample[i].author = (uint32_t)author;
    }
    const int vectors = apc_store_append_rows(f->to, &rows);
    if (vectors < 0) {
        return apc_replication_fail_to(f, vectors);
    }
    apc_replication_count(f, &f->stats.vectors, vectors);
    const int samples = apc_store_append(f->to, f->sample, f->samples);
    if (samples < 0) {
        return apc_replication_fail_to(f, samples);
    }
    apc_replication_count(f, &f->stats.samples, samples);
    const int compared = apc_replication_compare_batch(f, (size_t)samples < f->samples ? f->samples : 0,
                                                       (size_t)vectors < f->vectors ? f->vectors : 0);
    if (compared < 0) {
        return compared;
    }
    if (f->samples > 0) {
        f->last = f->sample[f->samples - 1];
    } else if (f->vectors > 0) {
        const struct apc_vector *v = &f->vector[f->vectors - 1];
        f->last = (struct apc_sample){.table = v->table, .id = v->id, .seq = v->seq};
    }
    for (size_t i = 0; i < f->n; i++) {
        f->variable[i].stored = f->variable[i].at.seq;
    }
    f->samples = f->vectors = f->elements = 0;
    return 0;
}

/* Are rows missing between the last one that TO has, or has been told of, and the first of a step? Of what
 * was before a record began none is. Where numbers are left out, the row before says whether any was
 * overwritten, as long as it is there to be read. */
static bool is_gap(const struct apc_replication *f, const struct apc_replication_variable *v, int64_t seq,
                   int64_t told)
{
    if (v->read || seq <= told + 1) {
        return false;
    }
    if (v->at.seq == 0) { /* TO has none: it may be a backup of before there were any */
        return v->gone || (f->kept && !apc_table_leaves_out(v->at.table) && seq > f->first + 1);
    }
    return !apc_table_leaves_out(v->at.table) || (!v->follows && (v->ours || v->at.seq > f->first));
}

/* The first row of a variable in a step: is it the one that follows? After a step that failed it may come
 * again. */
static void see_gap(struct apc_replication *f, int64_t seq, apc_ns time)
{
    struct apc_replication_variable *v = f->reading;
    struct apc_replication_gap *gap = &f->gap;
    const int64_t told = v->at.seq > v->missing ? v->at.seq : v->missing;
    const apc_ns since = v->at.seq > 0 ? v->at.time : f->kept_until;
    if (!is_gap(f, v, seq, told)) {
        return;
    }
    f->stats.gap.since = f->stats.gap.times == 0 || since < f->stats.gap.since ? since : f->stats.gap.since;
    f->stats.gap.until = time > f->stats.gap.until ? time : f->stats.gap.until;
    f->stats.gap.times++;
    f->stats.gap.rows += apc_rows_between(f->first, told, seq - 1);
    gap->since = gap->variables == 0 || since < gap->since ? since : gap->since;
    gap->until = gap->variables == 0 || time > gap->until ? time : gap->until;
    gap->variables++;
    v->missing = seq - 1;
}

enum taken { TAKEN, KNOWN, LATER };

/* The row joins the batch, unless it is the one before, or came after the step began. */
static enum taken take_row_into_batch(struct apc_replication *f, int64_t seq, apc_ns time)
{
    struct apc_replication_variable *v = f->reading;
    if (seq > v->newest) {
        return LATER;
    }
    if (seq <= v->at.seq) {
        v->follows = true;
        return KNOWN;
    }
    see_gap(f, seq, time);
    v->read = v->ours = true;
    v->at.seq = seq;
    v->at.time = time;
    return TAKEN;
}

static int replicate_sample(void *ctx, const struct apc_sample *s)
{
    struct apc_replication *f = (struct apc_replication *)ctx;
    const enum taken taken = f->samples == SAMPLES ? LATER : take_row_into_batch(f, s->seq, s->time);
    if (taken == TAKEN) {
        f->sample[f->samples++] = *s;
    }
    return taken == LATER;
}

static int replicate_vector(void *ctx, const struct apc_vector *v)
{
    struct apc_replication *f = (struct apc_replication *)ctx;
    const bool room = f->vectors < VECTORS && f->elements + v->n <= ELEMENTS;
    const enum taken taken = room ? take_row_into_batch(f, v->seq, v->time) : LATER;
    if (taken != TAKEN) {
        return taken == LATER;
    }
    struct apc_vector *to = &f->vector[f->vectors++];
    *to = *v;
    to->value = f->element + f->elements;
    if (v->n > 0) {
        memcpy(to->value, v->value, v->n * sizeof *v->value);
    }
    f->elements += v->n;
    return 0;
}

static bool is_full(const struct apc_replication *f)
{
    return f->samples == SAMPLES || f->vectors == VECTORS || f->elements + APC_ELEMENTS_MAX > ELEMENTS;
}

/* All that there was of it, as far as there is time. */
static int move_variable(struct apc_replication *f, struct apc_replication_variable *v)
{
    int rc = 0;
    f->reading = v;
    while (rc == 0 && v->at.seq < v->newest && !late(f)) {
        const struct apc_range range = {.after =
                                            v->at.seq - (apc_table_leaves_out(v->at.table) && v->at.seq > 0)};
        v->follows = false;
        const int given =
            apc_table_vectors(v->at.table)
                ? apc_store_vectors(f->from, v->at.table, v->at.id, &range, replicate_vector, f)
                : apc_store_history(f->from, v->at.table, v->at.id, &range, replicate_sample, f);
        if (given < 0) {
            return apc_replication_fail_from(f, given);
        }
        if (!is_full(f)) {
            break;
        }
        rc = flush_row_batch(f);
    }
    return rc;
}

static int move_rows(struct apc_replication *f)
{
    int rc = 0;
    f->samples = f->vectors = f->elements = 0; /* of a step that failed */
    for (size_t i = 0; rc == 0 && i < f->n && !late(f); i++) {
        rc = move_variable(f, &f->variable[f->turn]);
        f->turn += late(f) ? 0 : 1; /* where there is no time for all, all have their turn */
        f->turn = f->turn < f->n ? f->turn : 0;
    }
    rc = rc == 0 ? flush_row_batch(f) : rc;
    if (rc < 0) {
        lose_places(f); /* what is in the batch was read, and is not stored */
    }
    return rc;
}

/* ---- The whole ----------------------------------------------------------------------------- */

int apc_replication_create(struct apc_replication **replication, struct apc_store *from, struct apc_store *to,
                           struct apc_error *why)
{
    if (!replication) {
        return apc_fail(why, APC_EINVAL, "nowhere to put it");
    }
    *replication = NULL;
    if (!from || !to || from == to) {
        return apc_fail(why, APC_EINVAL, "from which store into which other one?");
    }
    struct apc_replication *f = (struct apc_replication *)calloc(1, sizeof *f);
    if (f) {
        f->from = from;
        f->to = to;
        f->events.doubtful = f->timing.doubtful = true;
        f->sample = (struct apc_sample *)calloc(SAMPLES, sizeof *f->sample);
        f->vector = (struct apc_vector *)calloc(VECTORS, sizeof *f->vector);
        f->element = (double *)calloc(ELEMENTS, sizeof *f->element);
    }
    if (!f || !f->sample || !f->vector || !f->element) {
        apc_replication_destroy(f);
        return apc_fail(why, APC_ENOMEM, "out of memory");
    }
    *replication = f;
    return 0;
}

void apc_replication_destroy(struct apc_replication *f)
{
    if (!f) {
        return;
    }
    for (size_t i = 0; i < APC_FORWARD_TIMING; i++) {
        free(f->bins[i]);
    }
    free(f->tag);
    free(f->variable);
    free(f->ask);
    free(f->ask_vector);
    free(f->author);
    free(f->sample);
    free(f->vector);
    free(f->element);
    free(f);
}

void apc_replication_tell(struct apc_replication *f, apc_replication_gap_fn fn, void *ctx)
{
    f->tell = fn;
    f->told = ctx;
}

int apc_replication_tell_gap(struct apc_replication *f)
{
    struct apc_replication_gap gap = f->gap;
    if (!f->tell || (gap.variables == 0 && gap.events == 0 && gap.timing == 0)) {
        return 0;
    }
    gap.size = sizeof gap;
    const int rc = f->tell(f->told, &gap);
    if (rc < 0) {
        return apc_replication_fail_from(f, rc);
    }
    f->gap = (struct apc_replication_gap){0};
    return 0;
}

int apc_replication_step(struct apc_replication *f, apc_ns timeout)
{
    if (!f || timeout < 0) {
        return APC_EINVAL;
    }
    f->deadline = apc_clock_mono(NULL) + timeout;
    f->moved = 0;
    f->why.text[0] = '\0';
    int rc = look_at_from(f);
    if (rc == 0) {
        rc = compare_stores(f); /* while TO is away: how far behind it is by now */
    }
    if (rc == 0) {
        rc = look_at_to(f);
    }
    if (rc == 0) {
        rc = copy_descriptions(f);
    }
    if (rc == 0) {
        rc = find_places(f);
    }
    if (rc == 0) {
        rc = compare_stores(f);
    }
    if (rc == 0) {
        rc = move_rows(f);
    }
    if (rc == 0) {
        rc = apc_replication_records(f);
    }
    if (rc == 0) {
        rc = apc_replication_tell_gap(f);
    }
    if (rc == 0) {
        rc = compare_stores(f);
    }
    return rc < 0 ? rc : f->moved;
}

struct held {
    int64_t first;
    size_t n;
};

static void hold_seq(struct held *h, int64_t seq)
{
    h->first = h->n++ == 0 ? seq : h->first;
}

static int hold_sample(void *ctx, const struct apc_sample *s)
{
    hold_seq((struct held *)ctx, s->seq);
    return 0;
}

static int hold_vector(void *ctx, const struct apc_vector *v)
{
    hold_seq((struct held *)ctx, v->seq);
    return 0;
}

double apc_replication_left(struct apc_replication *f)
{
    double left = 1;
    const int looked = f ? look_at_from(f) : APC_EINVAL;
    for (size_t i = 0; looked == 0 && i < f->n; i++) {
        struct apc_replication_variable *v = &f->variable[i];
        struct held held = {0};
        const int rc = i < f->n_vectors
                           ? apc_store_vectors(f->from, v->at.table, v->at.id, NULL, hold_vector, &held)
                           : apc_store_history(f->from, v->at.table, v->at.id, NULL, hold_sample, &held);
        const double kept = held.n > 0 ? (double)held.n : 1,
                     waiting = (double)apc_rows_between(f->first, v->stored, v->newest);
        if (rc > 0 && v->oldest > 0 && held.first > v->oldest && 1 - waiting / kept < left) {
            left = waiting < kept ? 1 - waiting / kept : 0;
        }
        v->oldest = held.first;
    }
    return left;
}

const char *apc_replication_error(const struct apc_replication *f)
{
    return f ? f->why.text : "nothing is forwarded";
}

void apc_replication_stats(const struct apc_replication *f, struct apc_replication_stats *stats)
{
    const struct apc_replication_stats none = {.size = 0};
    apc_result_copy(stats, f ? &f->stats : &none, sizeof none);
}

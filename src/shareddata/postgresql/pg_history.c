/* SPDX-License-Identifier: BSD-3-Clause */
/*
 * The PostgreSQL store: history of samples, in bins too, of many at once, and of vectors. Old weeks may be packed (pg_pack.c):
 * a chunk of up to APC_PACK_MAX samples comes as one row among the others, in the order of seq, and is
 * unpacked here. The seqs of a chunk follow each other without a gap, so chunks of a variable never overlap;
 * but a row that came late may lie within one. One statement reads both, so that what is being packed
 * meanwhile is seen once.
 */
#include <endian.h>
#include <limits.h>
#include <stdlib.h>
#include <string.h>

#include "shareddata/pack.h"
#include "shareddata/postgresql/postgresql.h"

static int strange(struct apc_pg *pg)
{
    return apc_fail(&pg->base.why, APC_EPROTO, "the database did not answer what was asked");
}

static void add_id(struct apc_pg_params *p, char bytes[4], int id)
{
    uint32_t big = htobe32((uint32_t)id);
    memcpy(bytes, &big, 4);
    apc_pg_param(p, bytes, 4);
}

/* ---- Chunks -------------------------------------------------------------------------------- */

static int take_there(void *ctx, int statement, PGresult *result)
{
    struct apc_pg *pg = (struct apc_pg *)ctx;
    (void)statement;
    pg->packed = PQntuples(result) == 1 && apc_pg_cell(result, 0, 0) > 0;
    return 0;
}

/* They may be made while programs are connected, so one that has not seen them looks again each time. */
int apc_pg_has_chunks(struct apc_pg *pg)
{
    int err = 0;
    if (!pg->packed) {
        err = apc_pg_send(pg, "SELECT count(to_regclass('estimate_packed'))", &(struct apc_pg_params){0});
        err = err ? err : apc_pg_finish(pg, take_there, pg);
    }
    return err ? err : pg->packed;
}

static int pg_take_chunk(struct apc_pg *pg, const PGresult *result, int row, int column,
                         struct apc_pack *chunk)
{
    const size_t length = (size_t)PQgetlength(result, row, column);
    if (apc_unpack((const uint8_t *)PQgetvalue(result, row, column), length, chunk) != 0) {
        return apc_fail(&pg->base.why, APC_ESTORE,
                        "a chunk of %zu bytes in the history is damaged, or of a newer libapc", length);
    }
    return 0;
}

static struct apc_sample chunk_sample(const struct apc_pack *chunk, size_t i, enum apc_table table, int id)
{
    return (struct apc_sample){.table = table,
                               .id = id,
                               .seq = chunk->first + (int64_t)i,
                               .time = apc_pg_time_ns(chunk->at[APC_PACK_TIME][i]),
                               .status = (apc_status)chunk->at[APC_PACK_STATUS][i],
                               .value = apc_pack_value(chunk->at[APC_PACK_VALUE][i]),
                               .origin = chunk->at[APC_PACK_ORIGIN][i],
                               .author = (uint32_t)chunk->at[APC_PACK_AUTHOR][i]};
}

/* ---- Samples ------------------------------------------------------------------------------- */

#define HOUR (3600 * APC_NS_PER_S)

/* A short while, and so long ago that the index on times knows of it. */
static bool is_long_ago(const struct apc_range *range)
{
    return range->since > 0 && range->until > range->since && range->until - range->since <= HOUR &&
           range->until < apc_clock_utc(NULL) - HOUR;
}

/* The statement for a range, of those for all, for the last and for the last of long ago. */
static const char *text_for(const struct apc_range *range, const char *all, const char *last,
                            const char *then)
{
    return range->last == 0 ? all : is_long_ago(range) ? then : last;
}

/* In rising seq as they come, or the newest ones in falling seq, which are held until all are there. */
struct chunk_merge {
    struct apc_pg_stream s; /* the first member: the stream's row function has it */
    const struct apc_range *range;
    struct apc_pack chunk;
    size_t left; /* of the chunk: samples that have not come to their turn */
    int count;
    bool ended;
    struct apc_sample *newest; /* to be freed */
    size_t n, room;
};

static struct apc_sample row_sample(const struct apc_pg_stream *s, const PGresult *result, int row)
{
    return (struct apc_sample){
        .table = s->table,
        .id = s->id,
        .seq = apc_pg_cell(result, row, 0),
        .time = apc_pg_time_ns(apc_pg_cell(result, row, 1)),
        .status = (apc_status)apc_pg_cell(result, row, 2),
        .value = apc_pg_cell_double(result, row, 3),
        .origin = apc_pg_cell(result, row, 4), /* NULL has length 0 */
        .author = (uint32_t)apc_pg_cell(result, row, 5),
    };
}

static int pg_give_sample(struct apc_pg_stream *s, const PGresult *result, int row)
{
    const struct apc_sample sample = row_sample(s, result, row);
    return s->fn.sample(s->ctx, &sample) != 0;
}

static int hold_chunk_sample(struct chunk_merge *m, const struct apc_sample *sample)
{
    if (m->n == m->room) {
        const size_t room = m->room ? 2 * m->room : 256;
        struct apc_sample *more = (struct apc_sample *)realloc(m->newest, room * sizeof *more);
        if (!more) {
            return apc_fail(&m->s.pg->base.why, APC_ENOMEM, "out of memory for %zu samples", room);
        }
        m->newest = more;
        m->room = room;
    }
    m->newest[m->n++] = *sample;
    return m->n == m->range->last;
}

static int merge_chunk_sample(struct chunk_merge *m, const struct apc_sample *sample)
{
    if (m->range->last > 0) {
        return hold_chunk_sample(m, sample);
    }
    m->count += m->count < INT_MAX;
    m->ended = m->s.fn.sample(m->s.ctx, sample) != 0;
    return m->ended;
}

static bool is_in_history_range(const struct apc_range *range, const struct apc_sample *s)
{
    return s->seq > range->after && (range->since == 0 || s->time >= range->since) &&
           (range->until == 0 || s->time < range->until);
}

/* The samples of the chunk at hand whose turn is before that of a seq. */
static int turn_chunk(struct chunk_merge *m, int64_t seq)
{
    const bool falling = m->range->last > 0;
    int err = 0;
    while (!err && m->left > 0) {
        const size_t i = falling ? m->left - 1 : m->chunk.n - m->left;
        const struct apc_sample sample = chunk_sample(&m->chunk, i, m->s.table, m->s.id);
        if (falling ? sample.seq <= seq : sample.seq >= seq) {
            break;
        }
        m->left--;
        err = is_in_history_range(m->range, &sample) ? merge_chunk_sample(m, &sample) : 0;
    }
    return err;
}

static int turn_all(struct chunk_merge *m)
{
    return turn_chunk(m, m->range->last > 0 ? 0 : INT64_MAX);
}

static int merge_row(struct apc_pg_stream *s, const PGresult *result, int row)
{
    struct chunk_merge *m = (struct chunk_merge *)s;
    const int64_t seq = apc_pg_cell(result, row, 0);
    if (PQgetisnull(result, row, 6)) {
        const struct apc_sample sample = row_sample(s, result, row);
        const int err = turn_chunk(m, seq);
        return err ? err : merge_chunk_sample(m, &sample);
    }
    int err = turn_all(m);
    if (!err) {
        err = pg_take_chunk(s->pg, result, row, 6, &m->chunk);
    }
    if (!err) {
        m->left = m->chunk.n;
        m->chunk.first = m->range->last > 0 ? seq - (int64_t)m->chunk.n + 1 : seq;
    }
    return err;
}

/* What is left when the stream has ended. */
static int end_of_merge(struct chunk_merge *m)
{
    struct apc_store *store = &m->s.pg->base;
    store->streaming = true;
    int err = m->ended || (m->range->last > 0 && m->n == m->range->last) ? 0 : turn_all(m);
    for (size_t i = m->n; i-- > 0 && err >= 0 && !m->ended;) {
        m->ended = m->s.fn.sample(m->s.ctx, &m->newest[i]) != 0;
        m->count += m->count < INT_MAX;
    }
    store->streaming = false;
    return err < 0 ? err : m->count;
}

static int merged_history(struct apc_pg_stream *s, const struct apc_pg_text *text,
                          const struct apc_range *range, const struct apc_pg_params *p)
{
    struct chunk_merge *m = (struct chunk_merge *)malloc(sizeof *m);
    if (!m) {
        return apc_fail(&s->pg->base.why, APC_ENOMEM, "out of memory for a chunk of samples");
    }
    m->s = *s;
    m->s.row = merge_row;
    m->s.columns = 7;
    m->range = range;
    m->left = m->n = m->room = 0;
    m->count = 0;
    m->ended = false;
    m->newest = NULL;
    int count = apc_pg_stream(&m->s, text_for(range, text->merged, text->merged_last, text->merged_then), p);
    count = count < 0 ? count : end_of_merge(m);
    free(m->newest);
    free(m);
    return count;
}

int apc_pg_history(struct apc_store *store, enum apc_table table, int id, const struct apc_range *range,
                   apc_sample_fn fn, void *ctx)
{
    struct apc_pg_stream s = {.pg = apc_pg_of(store),
                              .row = pg_give_sample,
                              .columns = 6,
                              .fn.sample = fn,
                              .ctx = ctx,
                              .table = table,
                              .id = id};
    struct apc_pg_params p = {0};
    struct apc_pg_bounds b;
    char number[4];
    add_id(&p, number, id);
    const struct apc_pg_text *text = apc_pg_text_of(s.pg, table);
    int chunks = !text ? APC_ESCHEMA : text->merged ? apc_pg_begin(s.pg) : 0;
    chunks = chunks == 0 && text->merged ? apc_pg_has_chunks(s.pg) : chunks;
    if (chunks < 0) {
        return chunks;
    }
    if (chunks > 0) {
        const struct apc_range all = {.since = range->since, .until = range->until, .after = range->after};
        apc_pg_add_range(&p, &b, &all);
        return merged_history(&s, text, range, &p);
    }
    apc_pg_add_range(&p, &b, range);
    return apc_pg_stream(&s, text_for(range, text->history, text->history_last, text->history_then), &p);
}

/* What begins at t holds whole microseconds only: those from the next whole one on. */
static int64_t pg_edge(apc_ns t)
{
    return t > INT64_MAX - 999 ? INT64_MAX : apc_pg_time(t + 999);
}

/* ---- Many variables at once ---------------------------------------------------------------- */

#define DAY (24 * HOUR)

/* A negative seq: the next one has not been seen. */
struct within {
    struct apc_pg_stream s; /* whose rows they are */
    struct apc_sample *sample;
    size_t n;
    apc_ns since, until;
    struct apc_pack *chunk; /* room for one */
};

static void take_candidate(struct within *w, const struct apc_sample *row, bool followed)
{
    for (size_t i = 0; i < w->n; i++) {
        struct apc_sample *best = &w->sample[i];
        if (best->id == row->id && row->seq > llabs(best->seq)) {
            *best = *row;
            best->seq = followed ? row->seq : -row->seq;
        }
    }
}

/* The highest seq of a chunk within the times. */
static int take_from_chunk(struct within *w, const PGresult *result, int row, int id)
{
    struct apc_pack *chunk = w->chunk;
    const int err = pg_take_chunk(w->s.pg, result, row, 6, chunk);
    if (!err) {
        chunk->first = apc_pg_cell(result, row, 0) - (int64_t)chunk->n + 1;
    }
    for (size_t i = err ? 0 : chunk->n; i-- > 0;) {
        const struct apc_sample sample = chunk_sample(chunk, i, w->s.table, id);
        if (sample.time >= w->since && sample.time < w->until) {
            take_candidate(w, &sample, i + 1 < chunk->n);
            break;
        }
    }
    return err;
}

static int take_rows_within(void *ctx, int statement, PGresult *result)
{
    struct within *w = (struct within *)ctx;
    int err = statement == 0 && PQnfields(result) != 9 ? strange(w->s.pg) : 0;
    for (int row = 0; !err && row < PQntuples(result); row++) {
        const int id = (int)apc_pg_cell(result, row, 7);
        if (!PQgetisnull(result, row, 6)) {
            err = take_from_chunk(w, result, row, id);
        } else {
            struct apc_sample sample = row_sample(&w->s, result, row);
            sample.id = id;
            take_candidate(w, &sample, apc_pg_cell(result, row, 8) > 0);
        }
    }
    return err;
}

/* A row each at most: by no cursor, in one round trip. */
static int ask_within(struct within *w, const char *text)
{
    struct apc_pg *pg = w->s.pg;
    struct apc_pg_array *ids = &pg->columns[0];
    struct apc_pg_params p = {0};
    struct apc_pg_bounds b;
    char day[8];
    if (apc_pg_array_begin(ids, APC_PG_INT4, w->n) != 0) {
        return apc_fail(&pg->base.why, APC_ENOMEM, "out of memory for %zu samples", w->n);
    }
    for (size_t i = 0; i < w->n; i++) {
        apc_pg_array_int4(ids, w->sample[i].id);
        w->sample[i].seq = 0;
    }
    apc_pg_put_int8(b.since, pg_edge(w->since));
    apc_pg_put_int8(b.until, pg_edge(w->until));
    apc_pg_put_int8(day, pg_edge(w->until + DAY));
    apc_pg_param(&p, ids->data, ids->length);
    apc_pg_param(&p, b.since, sizeof b.since);
    apc_pg_param(&p, b.until, sizeof b.until);
    apc_pg_param(&p, day, sizeof day);
    const int err = apc_pg_send(pg, text, &p);
    return err ? err : apc_pg_finish(pg, take_rows_within, w);
}

int apc_pg_newest_within(struct apc_store *store, struct apc_sample *samples, size_t n, apc_ns since,
                         apc_ns until)
{
    struct apc_pg *pg = apc_pg_of(store);
    const enum apc_table table = samples[0].table;
    const struct apc_pg_text *text = apc_pg_text_of(pg, table);
    struct within w = {
        .s = {.pg = pg, .table = table}, .sample = samples, .n = n, .since = since, .until = until};
    int chunks = text ? apc_pg_begin(pg) : APC_ESCHEMA;
    chunks = chunks == 0 && text->merged ? apc_pg_has_chunks(pg) : chunks;
    if (chunks > 0) {
        w.chunk = (struct apc_pack *)malloc(sizeof *w.chunk);
        chunks =
            w.chunk ? chunks : apc_fail(&pg->base.why, APC_ENOMEM, "out of memory for a chunk of samples");
    }
    const int rc = chunks < 0 ? chunks : ask_within(&w, chunks > 0 ? text->merged_within : text->within);
    for (size_t i = 0; i < n; i++) {
        samples[i].seq = rc < 0 || samples[i].seq < 0 ? 0 : samples[i].seq;
    }
    free(w.chunk);
    return rc;
}

/* ---- Vectors ------------------------------------------------------------------------------- */

static int pg_give_vector(struct apc_pg_stream *s, const PGresult *result, int row)
{
    const char *bytes = PQgetvalue(result, row, 3);
    const size_t length = (size_t)PQgetlength(result, row, 3);
    int n = apc_pg_get_float8_array(bytes, length, s->values, s->room);
    if (n > 0 && (size_t)n > s->room) {
        double *values = (double *)realloc(s->values, (size_t)n * sizeof *values);
        if (!values) {
            return apc_fail(&s->pg->base.why, APC_ENOMEM, "out of memory for %d elements", n);
        }
        s->values = values;
        s->room = (size_t)n;
        n = apc_pg_get_float8_array(bytes, length, s->values, s->room);
    }
    if (n < 0) {
        return strange(s->pg);
    }
    const struct apc_vector v = {
        .table = s->table,
        .id = s->id,
        .seq = apc_pg_cell(result, row, 0),
        .time = apc_pg_time_ns(apc_pg_cell(result, row, 1)),
        .status = (apc_status)apc_pg_cell(result, row, 2),
        .n = (uint32_t)n,
        .room = (uint32_t)n,
        .value = s->values,
    };
    return s->fn.vector(s->ctx, &v) != 0;
}

int apc_pg_vectors(struct apc_store *store, enum apc_table table, int id, const struct apc_range *range,
                   apc_vector_fn fn, void *ctx)
{
    struct apc_pg_stream s = {.pg = apc_pg_of(store),
                              .row = pg_give_vector,
                              .columns = 4,
                              .fn.vector = fn,
                              .ctx = ctx,
                              .table = table,
                              .id = id};
    struct apc_pg_params p = {0};
    struct apc_pg_bounds b;
    char number[4];
    add_id(&p, number, id);
    apc_pg_add_range(&p, &b, range);
    const struct apc_pg_text *text = &apc_pg_texts[table];
    int count = apc_pg_stream(&s, text_for(range, text->history, text->history_last, text->history_then), &p);
    free(s.values);
    return count;
}

/* ---- Samples in bins ----------------------------------------------------------------------- */

struct binned {
    struct apc_pg_stream s; /* the first member: the stream's row function has it */
    struct apc_bins bins;
    struct apc_pack *chunk; /* room for one */
};

/* A chunk that lies in several bins, or partly outside of all. */
static int bin_chunk(struct binned *b, const PGresult *result, int row)
{
    int err = pg_take_chunk(b->s.pg, result, row, 10, b->chunk);
    b->chunk->first = apc_pg_cell(result, row, 8);
    for (size_t i = 0; !err && i < b->chunk->n; i++) {
        const struct apc_sample sample = chunk_sample(b->chunk, i, b->s.table, b->s.id);
        err = apc_bins_add(&b->bins, &sample);
    }
    return err;
}

static int pg_bin_row(struct apc_pg_stream *s, const PGresult *result, int row)
{
    struct binned *b = (struct binned *)s;
    if (!PQgetisnull(result, row, 10)) {
        return bin_chunk(b, result, row);
    }
    const int64_t number = apc_pg_cell(result, row, 0); /* from 1 */
    if (number < 1 || (uint64_t)number > b->bins.n) {
        return strange(s->pg);
    }
    const struct apc_history_bin bin = {
        .count = (uint64_t)apc_pg_cell(result, row, 1),
        .bad = (uint64_t)apc_pg_cell(result, row, 2),
        .min = apc_pg_cell_double(result, row, 3), /* NULL, which is 0, when there is none */
        .max = apc_pg_cell_double(result, row, 4),
        .mean = apc_pg_cell_double(result, row, 5),
        .last = apc_pg_cell_double(result, row, 6),
        .worst = (apc_status)apc_pg_cell(result, row, 7),
        .seq = apc_pg_cell(result, row, 8),
    };
    apc_bins_merge(&b->bins, (size_t)number - 1, &bin, apc_pg_cell(result, row, 9));
    return 0;
}

static int pg_fill_bins(struct binned *b, const struct apc_pg_text *text, int chunks)
{
    struct apc_pg *pg = b->s.pg;
    struct apc_pg_array *edges = &pg->columns[0];
    struct apc_pg_params p = {0};
    const struct apc_bins *x = &b->bins;
    if (apc_pg_array_begin(edges, APC_PG_TIMESTAMPTZ, x->n) != 0) {
        return apc_fail(&pg->base.why, APC_ENOMEM, "out of memory for %zu bins", x->n);
    }
    for (size_t i = 0; i < x->n; i++) {
        apc_pg_array_int8(edges, pg_edge(apc_bin_edge(x->since, x->until, x->n, i)));
    }
    char number[4], bounds[2][8];
    add_id(&p, number, b->s.id);
    apc_pg_put_int8(bounds[0], pg_edge(x->since));
    apc_pg_put_int8(bounds[1], pg_edge(x->until));
    apc_pg_param(&p, bounds[0], 8);
    apc_pg_param(&p, bounds[1], 8);
    apc_pg_param(&p, edges->data, edges->length);
    return apc_pg_stream(&b->s, chunks ? text->merged_bins : text->bins, &p);
}

int apc_pg_history_bins(struct apc_store *store, enum apc_table table, int id, apc_ns since, apc_ns until,
                        size_t n, apc_history_bin_fn fn, void *ctx)
{
    struct apc_pg *pg = apc_pg_of(store);
    struct binned b = {
        .s = {.pg = pg, .row = pg_bin_row, .columns = 11, .large = true, .table = table, .id = id}};
    const struct apc_pg_text *text = apc_pg_text_of(pg, table);
    int chunks = text ? apc_pg_begin(pg) : APC_ESCHEMA;
    chunks = chunks == 0 && text->merged ? apc_pg_has_chunks(pg) : chunks;
    int err = chunks < 0 ? chunks : apc_bins_make(store, &b.bins, since, until, n);
    if (!err && chunks > 0) {
        b.chunk = (struct apc_pack *)malloc(sizeof *b.chunk);
        err = b.chunk ? 0 : apc_fail(&pg->base.why, APC_ENOMEM, "out of memory for a chunk of samples");
    }
    if (!err) {
        err = pg_fill_bins(&b, text, chunks);
    }
    int count = err < 0 ? err : apc_bins_give(store, &b.bins, fn, ctx);
    free(b.chunk);
    free(b.bins.bin);
    return count;
}

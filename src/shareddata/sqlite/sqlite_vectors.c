/* SPDX-License-Identifier: BSD-3-Clause */
/*
 * The SQLite store: vectors, and rows of both kinds together. A vector is a row like a sample's whose value
 * is a blob, so everything that is said of samples in sqlite_blocks.c holds.
 */
#include "shareddata/sqlite/sqlite.h"

#include <endian.h>
#include <stdlib.h>
#include <string.h>

/* ---- Elements at hand ----------------------------------------------------------------------- */

static int make_elements_room(struct apc_sqlite *sq, size_t n)
{
    if (n > sq->room) {
        uint64_t *element = (uint64_t *)realloc(sq->element, n * sizeof *element);
        if (!element) {
            return apc_fail(&sq->base.why, APC_ENOMEM, "out of memory for a vector of %zu", n);
        }
        sq->element = element;
        sq->room = n;
    }
    sq->n_elements = n;
    return 0;
}

static int encode(struct apc_sqlite *sq, const struct apc_vector *v)
{
    int err = make_elements_room(sq, v->n);
    for (uint32_t i = 0; !err && i < v->n; i++) {
        uint64_t bits;
        memcpy(&bits, &v->value[i], sizeof bits);
        sq->element[i] = htole64(bits);
    }
    return err;
}

/* Up to @p room elements of a blob; returns how many it has, or an error. */
static int decode(struct apc_sqlite *sq, sqlite3_stmt *statement, int column, double *value, uint32_t room)
{
    const int bytes = sqlite3_column_bytes(statement, column);
    const char *blob = (const char *)sqlite3_column_blob(statement, column); /* NULL, where it is empty */
    if (bytes % 8 != 0 || bytes / 8 > APC_ELEMENTS_MAX || (bytes > 0 && !blob)) {
        return apc_sqlite_damaged(sq);
    }
    for (uint32_t i = 0; i < room && i < (uint32_t)bytes / 8; i++) {
        uint64_t bits;
        memcpy(&bits, blob + 8 * (size_t)i, sizeof bits);
        bits = le64toh(bits);
        memcpy(&value[i], &bits, sizeof bits);
    }
    return bytes / 8;
}

/* ---- Read and append ------------------------------------------------------------------------ */

static int read_vector(struct apc_sqlite *sq, struct apc_vector *v)
{
    sqlite3_stmt *statement = apc_sqlite_use(sq, APC_SQLITE_NEWEST);
    v->seq = v->time = 0;
    v->n = 0;
    v->status = APC_BAD_NO_DATA;
    sqlite3_bind_int64(statement, 1, apc_sqlite_variable(v->table, v->id));
    int found = apc_sqlite_step(sq, statement);
    if (found <= 0) {
        return found;
    }
    v->seq = sqlite3_column_int64(statement, 0);
    v->time = apc_sqlite_ns(sqlite3_column_int64(statement, 1));
    v->status = (apc_status)sqlite3_column_int64(statement, 2);
    const int n = decode(sq, statement, 3, v->value, v->room);
    v->n = n > 0 ? (uint32_t)n : 0;
    sqlite3_reset(statement);
    return n < 0 ? n : 0;
}

int apc_sqlite_read_rows(struct apc_store *store, struct apc_rows *rows)
{
    struct apc_sqlite *sq = apc_sqlite_of(store);
    int err = apc_sqlite_enter_begin(sq, APC_SQLITE_READ);
    if (err) {
        return err;
    }
    for (size_t i = 0; !err && i < rows->n_samples; i++) {
        err = apc_sqlite_newest(sq, &rows->sample[i]);
    }
    for (size_t i = 0; !err && i < rows->n_vectors; i++) {
        err = read_vector(sq, &rows->vector[i]);
    }
    return apc_sqlite_end(sq, err);
}

int apc_sqlite_append_loops(struct apc_sqlite *sq, const struct apc_sample *s)
{
    const struct apc_store *store = &sq->base;
    int err = 0;
    for (size_t k = 0; apc_is_of_all(s) && err >= 0 && k < store->n_loops; k++) {
        struct apc_sample newest = store->loop[k];
        err = apc_sqlite_newest(sq, &newest);
        if (!err) {
            newest = apc_loop_row(store, s, k, newest.seq);
            err = apc_sqlite_append_one(sq, &newest);
        }
    }
    return err < 0 ? err : 0;
}

/* Returns 1 when it was stored, 0 when somebody else was faster or its seq is taken, or an error. */
static int append_sample(struct apc_sqlite *sq, struct apc_sample *s)
{
    struct apc_sample newest = {.table = s->table, .id = s->id};
    int err = apc_table_shared(s->table) ? apc_sqlite_newest(sq, &newest) : 0;
    if (err || !apc_rows_next(s, newest.seq)) {
        return err;
    }
    err = apc_sqlite_append_one(sq, s);
    const int loops = err > 0 ? apc_sqlite_append_loops(sq, s) : 0;
    return loops < 0 ? loops : err;
}

static int append_vector(struct apc_sqlite *sq, const struct apc_vector *v)
{
    const struct apc_sample head = {
        .table = v->table, .id = v->id, .seq = v->seq, .time = v->time, .status = v->status};
    int err = encode(sq, v);
    return err ? err : apc_sqlite_append_one(sq, &head);
}

int apc_sqlite_append_rows(struct apc_store *store, const struct apc_rows *rows)
{
    struct apc_sqlite *sq = apc_sqlite_of(store);
    int count = 0, err = apc_sqlite_enter_begin(sq, APC_SQLITE_WRITE);
    if (err) {
        return err;
    }
    bool people = false;
    for (size_t i = 0; i < rows->n_samples; i++) {
        people = people || apc_table_shared(rows->sample[i].table);
    }
    err = people ? apc_sqlite_check_live(sq) : 0;
    for (size_t i = 0; err >= 0 && i < rows->n_samples; i++) {
        err = append_sample(sq, &rows->sample[i]);
        count += err > 0;
    }
    for (size_t i = 0; err >= 0 && i < rows->n_vectors; i++) {
        err = append_vector(sq, &rows->vector[i]);
        count += err > 0;
    }
    return apc_sqlite_end(sq, err < 0 ? err : count);
}

/* ---- History -------------------------------------------------------------------------------- */

/* Elements of rows that follow each other in the block at hand, read ahead in one transaction. */
struct given {
    apc_vector_fn fn;
    void *ctx;
    struct {
        size_t first;
        uint32_t n;
        bool there; /* false: it has just been dropped */
    } ahead[APC_SQLITE_BLOCK];
    const struct apc_sqlite_row *row; /* of the first of them */
    int64_t block;                    /* its seq */
    size_t n, most;                   /* so many are read; the next time so many at most */
    double *value;
    size_t used, room;
};

/* The elements of a row behind those that are there: 1, 0 when it has just been dropped, or an error. */
static int fetch_elements(struct apc_sqlite *sq, const struct apc_sqlite_row *row, int64_t from,
                          struct given *g, uint32_t *n)
{
    const struct apc_sample *s = &row->sample;
    sqlite3_stmt *statement = apc_sqlite_use(sq, APC_SQLITE_ROWS_UP);
    int found = apc_sqlite_find_row(sq, APC_SQLITE_ROWS_UP, from, row->pos);
    if (found <= 0 || sqlite3_column_int64(statement, 0) != apc_sqlite_variable(s->table, s->id) ||
        sqlite3_column_int64(statement, 2) != s->seq) {
        return found < 0 ? found : 0;
    }
    const uint32_t need = (uint32_t)sqlite3_column_bytes(statement, 5) / 8;
    if (g->used + need > g->room) {
        double *value = (double *)realloc(g->value, (g->used + need) * sizeof *value);
        if (value) {
            g->value = value;
            g->room = g->used + need;
        }
    }
    found = g->used + need > g->room
                ? apc_fail(&sq->base.why, APC_ENOMEM, "out of memory for a vector of %u", need)
                : decode(sq, statement, 5, g->value + g->used, need);
    *n = need;
    return found < 0 ? found : 1;
}

/* From @p row on: of each that is asked for the next time twice as many, so that who wants one reads one. */
static int read_ahead(struct apc_sqlite *sq, const struct apc_sqlite_row *row, struct given *g)
{
    const struct apc_sqlite_loaded *l = &sq->loaded;
    const size_t left = l->n - (size_t)(row - l->rows);
    int found = apc_sqlite_enter_begin(sq, APC_SQLITE_READ);
    if (found) {
        return found;
    }
    g->row = row;
    g->block = l->block.seq;
    g->n = g->used = 0;
    g->most = g->most > 0 ? 2 * g->most : 1;
    g->most = g->most < APC_SQLITE_BLOCK ? g->most : APC_SQLITE_BLOCK;
    for (size_t i = 0; i < left && i < g->most && found >= 0; i++) {
        uint32_t n = 0;
        found = fetch_elements(sq, row + i, found > 0 ? row[i - 1].pos : 0, g, &n);
        g->ahead[i].first = g->used;
        g->ahead[i].n = n;
        g->ahead[i].there = found > 0;
        g->used += n;
        g->n++;
    }
    sqlite3_reset(apc_sqlite_use(sq, APC_SQLITE_ROWS_UP));
    found = apc_sqlite_end(sq, found);
    return found < 0 ? found : 0;
}

static int sqlite_give_vector(struct apc_sqlite *sq, const struct apc_sqlite_row *row, void *ctx)
{
    struct given *g = (struct given *)ctx;
    const struct apc_sample s = row->sample;
    if (!g->row || g->block != sq->loaded.block.seq || row < g->row || (size_t)(row - g->row) >= g->n) {
        const int err = read_ahead(sq, row, g);
        if (err) {
            return err;
        }
    }
    const size_t i = (size_t)(row - g->row);
    if (!g->ahead[i].there) {
        return 1;
    }
    const struct apc_vector v = {.table = s.table,
                                 .id = s.id,
                                 .seq = s.seq,
                                 .time = s.time,
                                 .status = s.status,
                                 .n = g->ahead[i].n,
                                 .room = g->ahead[i].n,
                                 .value = g->value + g->ahead[i].first};
    sq->base.streaming = true;
    const int ended = g->fn(g->ctx, &v);
    sq->base.streaming = false;
    return ended == 0;
}

int apc_sqlite_vectors(struct apc_store *store, enum apc_table table, int id, const struct apc_range *range,
                       apc_vector_fn fn, void *ctx)
{
    struct given g = {.fn = fn, .ctx = ctx};
    int count = apc_sqlite_walk(apc_sqlite_of(store), table, id, range, sqlite_give_vector, &g);
    free(g.value);
    return count;
}

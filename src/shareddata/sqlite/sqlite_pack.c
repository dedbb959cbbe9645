/* SPDX-License-Identifier: BSD-3-Clause */
/*
 * The SQLite store: packing old samples. Samples whose seqs follow each other become a row of table packed
 * (pack.h), which is a block like any other but that its place is the row's number with a minus sign. Each
 * is made in a transaction of its own, some milliseconds long, so that others write in between.
 *
 * The rows that it stands for go afterwards, those of all variables that came at one time together: their
 * pages are written once then, not once a variable. Until they go nothing leads to them any more but the
 * views; table packing says where they are, so that whoever packs next finds those of one who was killed.
 */
#include <inttypes.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "shareddata/sqlite/sqlite.h"

#define FEW   8    /* samples that follow each other are not worth a chunk if they are fewer */
#define TURN  8    /* chunks of a variable before the next one has its turn */
#define SWEEP 2000 /* rows that are looked at in one transaction */
#define ROOM  (APC_PACK_MAX + 2 * APC_SQLITE_BLOCK + 1)

static const char tables[] =
    "CREATE TABLE IF NOT EXISTS packed (number INTEGER PRIMARY KEY, data BLOB NOT NULL);"
    "CREATE TABLE IF NOT EXISTS packing (low INTEGER NOT NULL, high INTEGER NOT NULL, times INTEGER NOT "
    "NULL)";

struct packer {
    struct apc_sqlite *sq;
    int64_t page;
    int64_t before;         /* us */
    int64_t variable, next; /* seq from which on blocks are looked at */
    int64_t samples, bytes, chunks;
    size_t n, n_blocks;
    struct apc_sqlite_row row[ROOM];
    uint8_t taken[ROOM]; /* 1: into a chunk */
    struct apc_sqlite_block block[ROOM];
    struct apc_pack pack;
    uint8_t data[APC_PACK_BYTES];
};

/* ---- One that is packed --------------------------------------------------------------------- */

static int sqlite_take_chunk(struct apc_sqlite *sq, int64_t variable, const struct apc_sqlite_block *b,
                             const uint8_t *data, size_t length)
{
    struct apc_sqlite_loaded *l = &sq->loaded;
    struct apc_pack *p = (struct apc_pack *)malloc(sizeof *p);
    int err = p ? apc_unpack(data, length, p) : APC_ENOMEM;
    if (!p) {
        return apc_fail(&sq->base.why, err, "out of memory for a chunk of samples");
    }
    for (size_t i = 0; !err && i < p->n; i++) {
        l->rows[i] = (struct apc_sqlite_row){.pos = b->pos,
                                             .sample = {.table = (enum apc_table)(variable & 15),
                                                        .id = (int)(variable >> 4),
                                                        .seq = b->seq - (int64_t)(p->n - 1 - i),
                                                        .time = apc_sqlite_ns(p->at[APC_PACK_TIME][i]),
                                                        .status = (apc_status)p->at[APC_PACK_STATUS][i],
                                                        .value = apc_pack_value(p->at[APC_PACK_VALUE][i]),
                                                        .origin = p->at[APC_PACK_ORIGIN][i],
                                                        .author = (uint32_t)p->at[APC_PACK_AUTHOR][i]}};
    }
    const bool whole = !err && p->n == (size_t)b->count;
    free(p);
    return whole ? 0 : apc_sqlite_damaged(sq);
}

int apc_sqlite_load_packed(struct apc_sqlite *sq, int64_t variable, const struct apc_sqlite_block *b)
{
    sqlite3_stmt *statement = NULL;
    int found = apc_sqlite_prepare(sq, "SELECT data FROM packed WHERE number = ?1", &statement);
    if (found == 0) {
        sqlite3_bind_int64(statement, 1, -b->pos);
        found = apc_sqlite_step(sq, statement);
    }
    int err = found == 0 ? apc_sqlite_damaged(sq) : found < 0 ? found : 0;
    if (!err) {
        const void *data = sqlite3_column_blob(statement, 0);
        const int length = sqlite3_column_bytes(statement, 0);
        err = sqlite_take_chunk(sq, variable, b, (const uint8_t *)data, (size_t)length);
    }
    sqlite3_finalize(statement);
    return err;
}

/* One statement with up to three numbers, of which no row comes back. */
static int run_pack_statement(struct apc_sqlite *sq, const char *sql, int64_t first, int64_t second,
                              int64_t third)
{
    const int64_t number[] = {first, second, third};
    sqlite3_stmt *statement = NULL;
    int err = apc_sqlite_prepare(sq, sql, &statement);
    for (int i = 0; !err && i < 3 && i < sqlite3_bind_parameter_count(statement); i++) {
        sqlite3_bind_int64(statement, i + 1, number[i]);
    }
    err = err ? err : apc_sqlite_step(sq, statement);
    sqlite3_finalize(statement);
    return err;
}

int apc_sqlite_drop_packed(struct apc_sqlite *sq, const struct apc_sqlite_block *b)
{
    return run_pack_statement(sq, "DELETE FROM packed WHERE number = ?1", -b->pos, 0, 0);
}

/* ---- Chunks --------------------------------------------------------------------------------- */

/* What the row of a chunk takes of the file's pages: its end shares a page with those of others, and what is
 * too long for that begins with pages of its own (SQLite's file format, 1.6). */
static int64_t on_pages(int64_t page, int64_t payload)
{
    const int64_t most = page - 35, least = (page - 12) * 32 / 255 - 23;
    int64_t shared = payload;
    if (payload > most) {
        shared = least + (payload - least) % (page - 4);
        shared = shared > most ? least : shared;
    }
    const int64_t pages = (payload - shared + page - 5) / (page - 4);
    return pages * page + page / ((page - 8) / (shared + 10));
}

/* The rows from @p from on into the chunk at hand. */
static int take_rows_into_chunk(struct packer *p, size_t from, size_t n)
{
    for (size_t i = 0; i < n; i++) {
        const struct apc_sample *s = &p->row[from + i].sample;
        const int64_t cell[APC_PACK_COLUMNS] = {apc_sqlite_time(s->time), s->status, apc_pack_bits(s->value),
                                                s->origin, s->author};
        for (size_t c = 0; c < APC_PACK_COLUMNS; c++) {
            p->pack.at[c][i] = cell[c];
        }
    }
    if ((p->variable & 15) != APC_ACTUATOR) {
        return 0;
    }
    sqlite3_stmt *statement = NULL; /* what outputs of version 1 had */
    int err =
        apc_sqlite_prepare(p->sq, "SELECT sensor_seq, setpoint_seq FROM sample WHERE pos = ?1", &statement);
    for (size_t i = 0; !err && i < n; i++) {
        sqlite3_bind_int64(statement, 1, p->row[from + i].pos);
        const int found = apc_sqlite_step(p->sq, statement);
        err = found > 0 ? 0 : found < 0 ? found : apc_sqlite_damaged(p->sq);
        p->pack.at[APC_PACK_SENSOR_SEQ][i] = err ? 0 : sqlite3_column_int64(statement, 0);
        p->pack.at[APC_PACK_SETPOINT_SEQ][i] = err ? 0 : sqlite3_column_int64(statement, 1);
        sqlite3_reset(statement);
    }
    sqlite3_finalize(statement);
    return err;
}

/* How many of the @p n at hand make the best of the pages; 0: they cannot be packed. */
static size_t best_length(struct packer *p, size_t n)
{
    size_t best = 0;
    double least = 1e300;
    for (p->pack.n = n; p->pack.n >= FEW && p->pack.n > n / 2; p->pack.n -= p->pack.n > 32 ? 32 : 1) {
        const size_t length = apc_pack(&p->pack, p->data);
        const double each = (double)on_pages(p->page, (int64_t)length + 8) / (double)p->pack.n;
        if (length > 0 && each < least) {
            least = each;
            best = p->pack.n;
        }
        if (n < APC_PACK_MAX) {
            break;
        }
    }
    return best;
}

static int put_chunk(struct packer *p, size_t from, size_t n)
{
    struct apc_sqlite *sq = p->sq;
    sqlite3_stmt *statement = NULL;
    p->pack.n = n;
    const size_t length = apc_pack(&p->pack, p->data);
    int err = apc_sqlite_prepare(sq, "INSERT INTO packed (data) VALUES (?1)", &statement);
    if (!err) {
        sqlite3_bind_blob64(statement, 1, p->data, length, SQLITE_STATIC);
        err = apc_sqlite_step(sq, statement);
    }
    sqlite3_finalize(statement);
    if (err) {
        return err;
    }
    memset(&p->taken[from], 1, n);
    p->samples += (int64_t)n;
    p->bytes += (int64_t)length;
    p->chunks++;
    return apc_sqlite_put_rows(sq, p->variable, &p->row[from], n, -sqlite3_last_insert_rowid(sq->db));
}

/* ---- Of rows -------------------------------------------------------------------------------- */

/* Rows of the blocks from p->next on that have rows, are old, and are not the newest: 1 when there are enough
 * for a chunk. */
static int gather_old_rows(struct packer *p)
{
    struct apc_sqlite *sq = p->sq;
    sqlite3_stmt *statement = NULL;
    int64_t seq = p->next;
    p->n = p->n_blocks = 0;
    int found = apc_sqlite_prepare(
        sq,
        "SELECT seq, pos, count, first, last FROM block WHERE variable = ?1 AND seq >= ?2 AND last < ?3"
        " AND pos > 0 AND seq < (SELECT seq FROM variable WHERE variable = ?1) ORDER BY seq LIMIT 1",
        &statement);
    while (found >= 0 && p->n < APC_PACK_MAX) {
        sqlite3_bind_int64(statement, 1, p->variable);
        sqlite3_bind_int64(statement, 2, seq);
        sqlite3_bind_int64(statement, 3, p->before);
        found = apc_sqlite_step(sq, statement);
        if (found <= 0) {
            break;
        }
        struct apc_sqlite_block *b = &p->block[p->n_blocks++];
        *b = (struct apc_sqlite_block){.seq = sqlite3_column_int64(statement, 0),
                                       .pos = sqlite3_column_int64(statement, 1),
                                       .count = sqlite3_column_int64(statement, 2),
                                       .first = sqlite3_column_int64(statement, 3),
                                       .last = sqlite3_column_int64(statement, 4)};
        sqlite3_reset(statement);
        found = apc_sqlite_load(sq, p->variable, b);
        if (found == 0) {
            memcpy(&p->row[p->n], sq->loaded.rows, sq->loaded.n * sizeof p->row[0]);
            p->n += sq->loaded.n;
            seq = b->seq + 1;
        }
    }
    sqlite3_finalize(statement);
    sq->loaded.variable = -1; /* they are about to be others */
    memset(p->taken, 0, sizeof p->taken);
    return found < 0 ? found : p->n >= APC_PACK_MAX;
}

/* How many from @p from on follow each other. */
static size_t run_from(const struct packer *p, size_t from)
{
    size_t n = 1;
    while (from + n < p->n && n < APC_PACK_MAX &&
           p->row[from + n].sample.seq == p->row[from].sample.seq + (int64_t)n) {
        n++;
    }
    return n;
}

/* Chunks of what is at hand. The last run may go on in blocks that are not. */
static int make_chunks(struct packer *p)
{
    size_t from = 0;
    int err = 0;
    while (!err && from < p->n) {
        const size_t n = run_from(p, from);
        if (from + n == p->n && n < APC_PACK_MAX) {
            break;
        }
        size_t length = 0;
        if (n >= FEW) {
            err = take_rows_into_chunk(p, from, n);
            length = err ? 0 : best_length(p, n);
        }
        if (length > 0) {
            err = put_chunk(p, from, length);
        }
        from += length > 0 ? length : n;
    }
    p->next = from < p->n ? p->row[from].sample.seq : p->row[p->n - 1].sample.seq + 1;
    return err;
}

/* The blocks of which something was taken: what was not is blocks of its own. */
static int put_rest(struct packer *p)
{
    size_t from = 0;
    int err = 0;
    for (size_t i = 0; !err && i < p->n_blocks; i++) {
        const size_t end = from + (size_t)p->block[i].count;
        if (memchr(&p->taken[from], 1, end - from)) {
            /* one that ends with a chunk has become that chunk's */
            err = run_pack_statement(p->sq, "DELETE FROM block WHERE variable = ?1 AND seq = ?2 AND pos > 0",
                                     p->variable, p->block[i].seq, 0);
            for (size_t a = from, b; !err && a < end; a = b) {
                for (b = a; b < end && p->taken[b] == p->taken[a]; b++) {
                }
                if (!p->taken[a]) {
                    err = apc_sqlite_put_rows(p->sq, p->variable, &p->row[a], b - a, 0);
                }
            }
        }
        from = end;
    }
    return err;
}

/* Where the rows are that nothing leads to from now on. */
static int note_rows(struct packer *p)
{
    int64_t low = INT64_MAX, high = 0;
    for (size_t i = 0; i < p->n; i++) {
        const int64_t pos = p->row[i].pos;
        low = p->taken[i] && pos < low ? pos : low;
        high = p->taken[i] && pos > high ? pos : high;
    }
    int err = run_pack_statement(
        p->sq, "INSERT INTO packing SELECT ?1, ?2, 0 WHERE NOT EXISTS (SELECT 1 FROM packing)", low, high, 0);
    return err ? err
               : run_pack_statement(
                     p->sq, "UPDATE packing SET low = min(low, ?1), high = max(high, ?2), times = times + 1",
                     low, high, 0);
}

/* In a transaction: 1 when there may be more of this variable. */
static int pack_some(struct packer *p)
{
    const int64_t chunks = p->chunks;
    int more = gather_old_rows(p), err = 0;
    if (more > 0) {
        err = make_chunks(p);
    }
    if (!err && p->chunks > chunks) {
        err = put_rest(p);
        err = err ? err : note_rows(p);
    }
    return err ? err : more;
}

static int pack_variable(struct packer *p)
{
    const int64_t chunks = p->chunks;
    int more = 1;
    p->next = 0;
    while (more > 0 && p->chunks < chunks + TURN) {
        more = apc_sqlite_enter_begin(p->sq, APC_SQLITE_WRITE);
        more = more ? more : apc_sqlite_end(p->sq, pack_some(p));
    }
    return more < 0 ? more : 0;
}

/* ---- What they stood for -------------------------------------------------------------------- */

struct sweep {
    int64_t low, high, times;
};

static int read_sweep(struct apc_sqlite *sq, struct sweep *s)
{
    sqlite3_stmt *statement = NULL;
    int found = apc_sqlite_prepare(sq, "SELECT low, high, times FROM packing", &statement);
    found = found ? found : apc_sqlite_step(sq, statement);
    if (found > 0) {
        s->low = sqlite3_column_int64(statement, 0);
        s->high = sqlite3_column_int64(statement, 1);
        s->times = sqlite3_column_int64(statement, 2);
    }
    sqlite3_finalize(statement);
    return found;
}

/* Rows that a chunk stands for go. What somebody else has packed meanwhile is left to him, or to the next. */
static int sweep_packed_rows(struct apc_sqlite *sq)
{
    struct sweep s = {0};
    int err = apc_sqlite_enter(sq), found = err ? err : read_sweep(sq, &s);
    for (int64_t pos = s.low; found > 0 && !err && pos <= s.high; pos += SWEEP) {
        err = apc_sqlite_enter_begin(sq, APC_SQLITE_WRITE);
        if (!err) {
            err = apc_sqlite_end(
                sq, run_pack_statement(
                        sq,
                        "DELETE FROM sample WHERE pos >= ?1 AND pos < ?2 AND variable & 15 IN (1, 2, 3, 9, "
                        "10) AND"
                        " (SELECT b.pos < 0 AND b.seq - b.count < sample.seq FROM block b WHERE"
                        " b.variable = sample.variable AND b.seq >= sample.seq ORDER BY b.seq LIMIT 1)",
                        pos, pos + SWEEP, 0));
        }
    }
    if (found > 0 && !err) {
        err = apc_sqlite_enter(sq);
        err = err ? err : run_pack_statement(sq, "DELETE FROM packing WHERE times = ?1", s.times, 0, 0);
    }
    return found < 0 ? found : err;
}

/* ---- All of it ------------------------------------------------------------------------------ */

/* A turn of each variable. */
static int pack_turn(struct packer *p)
{
    int found = 1, err = 0;
    for (p->variable = -1; found > 0 && !err;) {
        found = apc_sqlite_enter(p->sq);
        found = found ? found : apc_sqlite_next_variable(p->sq, &p->variable);
        if (found > 0 && apc_table_packed((enum apc_table)(p->variable & 15))) {
            err = pack_variable(p);
        }
    }
    return err ? err : found;
}

static int report_packing(const struct packer *p)
{
    struct apc_event event = {
        .time = apc_clock_utc(NULL), .severity = APC_EVENT_INFO, .source = "apc maintain", .kind = "store"};
    snprintf(event.text, sizeof event.text,
             "packed: %" PRId64 " samples are %" PRId64 " chunks of %" PRId64 " kB now", p->samples,
             p->chunks, p->bytes / 1000);
    const int rc = apc_sqlite_append_events(&p->sq->base, &event, 1);
    return rc < 0 ? rc : 0;
}

static int pack_all(struct packer *p)
{
    int64_t chunks;
    int err = apc_sqlite_enter_begin(p->sq, APC_SQLITE_WRITE);
    err = err ? err : apc_sqlite_end(p->sq, apc_sqlite_run(p->sq, tables));
    err = err ? err : sweep_packed_rows(p->sq); /* of one who was killed */
    do {
        chunks = p->chunks;
        err = err ? err : pack_turn(p);
        err = err ? err : sweep_packed_rows(p->sq);
    } while (!err && p->chunks > chunks);
    return err || p->chunks == 0 ? err : report_packing(p);
}

static int page_size(struct apc_sqlite *sq, int64_t *page)
{
    sqlite3_stmt *statement = NULL;
    int found = apc_sqlite_enter(sq);
    found = found ? found : apc_sqlite_prepare(sq, "PRAGMA page_size", &statement);
    found = found ? found : apc_sqlite_step(sq, statement);
    *page = found > 0 ? sqlite3_column_int64(statement, 0) : 4096;
    sqlite3_finalize(statement);
    return found < 0 ? found : 0;
}

int apc_sqlite_pack(struct apc_sqlite *sq, apc_ns before)
{
    struct packer *p = (struct packer *)calloc(1, sizeof *p);
    if (!p) {
        return apc_fail(&sq->base.why, APC_ENOMEM, "out of memory for a chunk of samples");
    }
    p->sq = sq;
    p->before = apc_sqlite_time(before);
    int err = page_size(sq, &p->page);
    err = err ? err : pack_all(p);
    const int chunks = p->chunks < INT_MAX ? (int)p->chunks : INT_MAX;
    free(p);
    return err ? err : chunks;
}

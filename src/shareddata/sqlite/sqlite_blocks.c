/* SPDX-License-Identifier: BSD-3-Clause */
/*
 * Where samples are and how they are found.
 *
 * An index on (variable, seq) would make each tick of n variables write n of its pages: measured, the
 * durable commit takes 1.3 times as long at n = 10, 3 times at n = 100, 8 times at n = 1000. So rows stand in
 * the order in which they came, each with the place of its variable's previous row, and every 64 rows of a
 * variable are a block: one entry with the last row's seq and place, the number of rows and the span of their
 * times. Any sample is at most some steps back from the end of its block, and of a long history only the
 * blocks that matter are looked at. Old ones are packed (sqlite_pack.c).
 *
 * A sample whose seq is not above the newest is rare (a repeat, a spool, a copy). It is looked for in its
 * block, and put between its neighbours if it is not there; a block that grows too long is split. Nothing
 * refers from one block to another, so a block can be dropped or trimmed by itself.
 */
#include "shareddata/sqlite/sqlite.h"

#include <inttypes.h>
#include <math.h>
#include <string.h>

/* ---- Rows of the tables --------------------------------------------------------------------- */

static void take_block_row(sqlite3_stmt *statement, struct apc_sqlite_block *b)
{
    *b = (struct apc_sqlite_block){.seq = sqlite3_column_int64(statement, 0),
                                   .pos = sqlite3_column_int64(statement, 1),
                                   .count = sqlite3_column_int64(statement, 2),
                                   .first = sqlite3_column_int64(statement, 3),
                                   .last = sqlite3_column_int64(statement, 4)};
}

/* The growing block. 1, 0 when there is no such variable, or an error. */
static int growing_block(struct apc_sqlite *sq, int64_t variable, struct apc_sqlite_block *b)
{
    sqlite3_stmt *statement = apc_sqlite_use(sq, APC_SQLITE_VARIABLE);
    sqlite3_bind_int64(statement, 1, variable);
    int found = apc_sqlite_step(sq, statement);
    if (found > 0) {
        take_block_row(statement, b);
        sqlite3_reset(statement);
    }
    return found;
}

static int put_block_row(struct apc_sqlite *sq, enum apc_sqlite_sql where, int64_t variable,
                         const struct apc_sqlite_block *b)
{
    sqlite3_stmt *statement = apc_sqlite_use(sq, where);
    sqlite3_bind_int64(statement, 1, variable);
    sqlite3_bind_int64(statement, 2, b->seq);
    sqlite3_bind_int64(statement, 3, b->pos);
    sqlite3_bind_int64(statement, 4, b->count);
    sqlite3_bind_int64(statement, 5, b->first);
    sqlite3_bind_int64(statement, 6, b->last);
    return apc_sqlite_step(sq, statement);
}

static const struct apc_sqlite_block no_block = {.first = INT64_MAX, .last = INT64_MIN};

/* The span of times grows by one sample's, the count by one. */
static void widen_block(struct apc_sqlite_block *b, apc_ns time)
{
    int64_t us = apc_sqlite_time(time);
    b->count++;
    b->first = us < b->first ? us : b->first;
    b->last = us > b->last ? us : b->last;
}

/* The growing block; when it is full, it becomes one of those that do not. */
static int put_growing(struct apc_sqlite *sq, int64_t variable, struct apc_sqlite_block *b)
{
    int err = 0;
    if (b->count >= APC_SQLITE_BLOCK) {
        err = put_block_row(sq, APC_SQLITE_PUT_BLOCK, variable, b);
        b->count = 0;
        b->first = no_block.first;
        b->last = no_block.last;
    }
    return err ? err : put_block_row(sq, APC_SQLITE_PUT_VARIABLE, variable, b);
}

static void bind_reference(sqlite3_stmt *statement, int parameter, int64_t seq)
{
    if (seq > 0) {
        sqlite3_bind_int64(statement, parameter, seq);
    } else {
        sqlite3_bind_null(statement, parameter);
    }
}

/* Where the next row goes: behind all others. */
static int next_pos(struct apc_sqlite *sq)
{
    if (sq->pos == 0) {
        sqlite3_stmt *statement = apc_sqlite_use(sq, APC_SQLITE_LAST_POS);
        int found = apc_sqlite_step(sq, statement);
        if (found < 0) {
            return found;
        }
        sq->pos = sqlite3_column_int64(statement, 0); /* NULL, of an empty table, is 0 */
        sqlite3_reset(statement);
    }
    sq->pos++;
    return 0;
}

/* What sql/ says by constraints of the same names. Here they would cost a row a fifth of its time. */
static int check_constraints(struct apc_sqlite *sq, const struct apc_sample *s)
{
    const bool whole = (s->table != APC_DIM && s->table != APC_OPMODE && s->table != APC_ALARM) ||
                       s->value == trunc(s->value);
    if (whole && s->seq <= APC_SEQ_MAX) {
        return 0;
    }
    return apc_fail(&sq->base.why, APC_ESTORE, "%s %d, seq %" PRId64 ", value %g: refused by %s",
                    apc_table_name(s->table), s->id, s->seq, s->value,
                    whole ? "seq_in_range" : "value_whole");
}

/* A row at sq->pos; of a vector its elements are at hand. */
static int insert_block_row(struct apc_sqlite *sq, const struct apc_sample *s, int64_t previous)
{
    sqlite3_stmt *statement = apc_sqlite_use(sq, APC_SQLITE_INSERT);
    sqlite3_bind_int64(statement, 1, sq->pos);
    sqlite3_bind_int64(statement, 2, apc_sqlite_variable(s->table, s->id));
    sqlite3_bind_int64(statement, 3, s->seq);
    sqlite3_bind_int64(statement, 4, previous);
    sqlite3_bind_int64(statement, 5, apc_sqlite_time(s->time));
    sqlite3_bind_int64(statement, 6, s->status);
    if (!apc_table_vectors(s->table)) {
        sqlite3_bind_double(statement, 7, s->value);
    } else if (sq->n_elements > 0) {
        sqlite3_bind_blob64(statement, 7, sq->element, sq->n_elements * sizeof *sq->element, SQLITE_STATIC);
    } else {
        sqlite3_bind_zeroblob(statement, 7, 0);
    }
    bind_reference(statement, 8, s->origin);
    bind_reference(statement, 9, s->author);
    return apc_sqlite_step(sq, statement);
}

/*
 * grow(seq, pos, count, first, last) in GROW: keeps what the block was and gives where its next row goes. So
 * one statement both reads and writes it; a statement costs about half a microsecond, a tenth of a row.
 */
static void grow_block_function(sqlite3_context *context, int n, sqlite3_value **value)
{
    struct apc_sqlite *sq = (struct apc_sqlite *)sqlite3_user_data(context);
    (void)n;
    sq->grown = (struct apc_sqlite_block){.seq = sqlite3_value_int64(value[0]),
                                          .pos = sqlite3_value_int64(value[1]),
                                          .count = sqlite3_value_int64(value[2]),
                                          .first = sqlite3_value_int64(value[3]),
                                          .last = sqlite3_value_int64(value[4])};
    sqlite3_result_int64(context, sq->pos);
}

int apc_sqlite_make_function(struct apc_sqlite *sq)
{
    return sqlite3_create_function_v2(sq->db, "grow", 5, SQLITE_UTF8 | SQLITE_DIRECTONLY, sq,
                                      grow_block_function, NULL, NULL, NULL);
}

/* ---- Reading -------------------------------------------------------------------------------- */

/* Columns from seq on, without a vector's elements. */
static void take_sample_columns(sqlite3_stmt *statement, int column, struct apc_sample *s)
{
    s->seq = sqlite3_column_int64(statement, column);
    s->time = apc_sqlite_ns(sqlite3_column_int64(statement, column + 1));
    s->status = (apc_status)sqlite3_column_int64(statement, column + 2);
    s->value = apc_table_vectors(s->table) ? 0 : sqlite3_column_double(statement, column + 3);
    s->origin = sqlite3_column_int64(statement, column + 4); /* NULL is 0 */
    s->author = (uint32_t)sqlite3_column_int64(statement, column + 5);
}

int apc_sqlite_newest(struct apc_sqlite *sq, struct apc_sample *s)
{
    sqlite3_stmt *statement = apc_sqlite_use(sq, APC_SQLITE_NEWEST);
    *s = (struct apc_sample){.table = s->table, .id = s->id, .status = APC_BAD_NO_DATA};
    sqlite3_bind_int64(statement, 1, apc_sqlite_variable(s->table, s->id));
    int found = apc_sqlite_step(sq, statement);
    if (found > 0) {
        take_sample_columns(statement, 0, s);
        sqlite3_reset(statement);
    }
    return found < 0 ? found : 0;
}

/* The row at hand, which is to be one of the variable; returns the place of the one before it. */
static int64_t take_row_of_block(sqlite3_stmt *statement, struct apc_sqlite_row *row, int64_t variable)
{
    row->pos = sqlite3_column_int64(statement, 8);
    row->sample = (struct apc_sample){.table = (enum apc_table)(variable & 15), .id = (int)(variable >> 4)};
    take_sample_columns(statement, 2, &row->sample);
    return sqlite3_column_int64(statement, 1);
}

static int load_block_rows(struct apc_sqlite *sq, int64_t variable, const struct apc_sqlite_block *b)
{
    struct apc_sqlite_loaded *l = &sq->loaded;
    sqlite3_stmt *statement = apc_sqlite_use(sq, APC_SQLITE_ROWS_DOWN);
    int64_t pos = b->pos, from = 0;
    int found = 1;
    for (size_t i = (size_t)b->count; i-- > 0 && found > 0;) {
        found = apc_sqlite_find_row(sq, APC_SQLITE_ROWS_DOWN, from, pos);
        from = pos;
        if (found > 0 && sqlite3_column_int64(statement, 0) == variable) {
            pos = take_row_of_block(statement, &l->rows[i], variable);
            found = i + 1 == (size_t)b->count || l->rows[i].sample.seq < l->rows[i + 1].sample.seq;
        } else {
            found = found < 0 ? found : 0;
        }
    }
    sqlite3_reset(statement);
    return found == 0 ? apc_sqlite_damaged(sq) : found < 0 ? found : 0;
}

/* After an error the rows are no block's: with it the transaction ends, and the next begins without any. */
int apc_sqlite_load(struct apc_sqlite *sq, int64_t variable, const struct apc_sqlite_block *b)
{
    struct apc_sqlite_loaded *l = &sq->loaded;
    if (l->variable == variable && l->block.seq == b->seq && l->n == (size_t)b->count) {
        return 0;
    }
    const bool packed = b->pos < 0;
    if (b->count < 1 || b->count > (packed ? APC_PACK_MAX : 2 * APC_SQLITE_BLOCK + 1)) {
        return apc_sqlite_damaged(sq);
    }
    const int err = packed ? apc_sqlite_load_packed(sq, variable, b) : load_block_rows(sq, variable, b);
    if (err) {
        return err;
    }
    l->variable = variable;
    l->block = *b;
    l->n = (size_t)b->count;
    return 0;
}

static int find_block(struct apc_sqlite *sq, enum apc_sqlite_sql which, int64_t variable, int64_t seq,
                      int64_t since, int64_t until, struct apc_sqlite_block *b)
{
    sqlite3_stmt *statement = apc_sqlite_use(sq, which);
    sqlite3_bind_int64(statement, 1, variable);
    sqlite3_bind_int64(statement, 2, seq);
    sqlite3_bind_int64(statement, 3, since);
    sqlite3_bind_int64(statement, 4, until);
    int found = apc_sqlite_step(sq, statement);
    if (found > 0) {
        take_block_row(statement, b);
        sqlite3_reset(statement);
    }
    return found;
}

static int growing_within(struct apc_sqlite *sq, int64_t variable, int64_t since, int64_t until,
                          struct apc_sqlite_block *b)
{
    int found = growing_block(sq, variable, b);
    return found > 0 ? b->count > 0 && b->last >= since && b->first < until : found;
}

int apc_sqlite_next_block(struct apc_sqlite *sq, int64_t variable, int64_t seq, int64_t since, int64_t until,
                          struct apc_sqlite_block *b)
{
    int found = find_block(sq, APC_SQLITE_NEXT_BLOCK, variable, seq, since, until, b);
    if (found == 0) {
        found = growing_within(sq, variable, since, until, b);
        found = found > 0 ? b->seq >= seq : found;
    }
    return found;
}

int apc_sqlite_former_block(struct apc_sqlite *sq, int64_t variable, int64_t seq, int64_t since,
                            int64_t until, struct apc_sqlite_block *b)
{
    int found = seq == INT64_MAX ? growing_within(sq, variable, since, until, b) : 0;
    return found ? found : find_block(sq, APC_SQLITE_FORMER_BLOCK, variable, seq, since, until, b);
}

/* ---- Late samples --------------------------------------------------------------------------- */

/* A block of some rows at hand: its last, its number, its times. */
static struct apc_sqlite_block block_of(const struct apc_sqlite_row *rows, size_t n)
{
    struct apc_sqlite_block b = no_block;
    for (size_t i = 0; i < n; i++) {
        widen_block(&b, rows[i].sample.time);
    }
    b.seq = n > 0 ? rows[n - 1].sample.seq : 0;
    b.pos = n > 0 ? rows[n - 1].pos : 0;
    return b;
}

/* The block at hand is too long: its lower half becomes one of its own. */
static int split_block(struct apc_sqlite *sq, int64_t variable)
{
    struct apc_sqlite_loaded *l = &sq->loaded;
    const struct apc_sqlite_block lower = block_of(l->rows, APC_SQLITE_BLOCK);
    const struct apc_sqlite_block upper = block_of(l->rows + APC_SQLITE_BLOCK, l->n - APC_SQLITE_BLOCK);
    l->variable = -1;
    int err = put_block_row(sq, APC_SQLITE_PUT_BLOCK, variable, &lower);
    return err ? err : put_block_row(sq, APC_SQLITE_PUT_BLOCK, variable, &upper);
}

/* Between rows[i - 1] and rows[i] of the block at hand, which is the growing one or not. */
static int insert_late(struct apc_sqlite *sq, const struct apc_sample *s, size_t i, bool growing)
{
    struct apc_sqlite_loaded *l = &sq->loaded;
    int err = insert_block_row(sq, s, i > 0 ? l->rows[i - 1].pos : 0);
    if (err) {
        return err;
    }
    sqlite3_stmt *statement = apc_sqlite_use(sq, APC_SQLITE_LINK);
    sqlite3_bind_int64(statement, 1, l->rows[i].pos);
    sqlite3_bind_int64(statement, 2, sq->pos);
    err = apc_sqlite_step(sq, statement);
    if (err) {
        return err;
    }
    memmove(&l->rows[i + 1], &l->rows[i], (l->n - i) * sizeof l->rows[0]);
    l->rows[i] = (struct apc_sqlite_row){.pos = sq->pos, .sample = *s};
    l->n++;
    widen_block(&l->block, s->time);
    if (growing) {
        struct apc_sqlite_block b = l->block;
        return put_growing(sq, l->variable, &b);
    }
    return l->n > (size_t)2 * APC_SQLITE_BLOCK
               ? split_block(sq, l->variable)
               : put_block_row(sq, APC_SQLITE_PUT_BLOCK, l->variable, &l->block);
}

int apc_sqlite_put_rows(struct apc_sqlite *sq, int64_t variable, const struct apc_sqlite_row *rows, size_t n,
                        int64_t pos)
{
    struct apc_sqlite_block b = block_of(rows, n);
    b.pos = pos ? pos : b.pos;
    return put_block_row(sq, APC_SQLITE_PUT_BLOCK, variable, &b);
}

/* What is packed has all the seqs that it spans; below them there is room for a block. */
static int append_before_packed(struct apc_sqlite *sq, const struct apc_sample *s, int64_t variable,
                                const struct apc_sqlite_block *b)
{
    if (s->seq > b->seq - b->count) {
        return 0;
    }
    int err = insert_block_row(sq, s, 0);
    if (!err) {
        err = apc_sqlite_put_rows(sq, variable, &(struct apc_sqlite_row){.pos = sq->pos, .sample = *s}, 1, 0);
    }
    return err ? err : 1;
}

/* The newest seq is not below that of @p s. */
static int append_late(struct apc_sqlite *sq, const struct apc_sample *s, int64_t variable,
                       const struct apc_sqlite_block *growing)
{
    struct apc_sqlite_block b;
    int found = find_block(sq, APC_SQLITE_NEXT_BLOCK, variable, s->seq, INT64_MIN, INT64_MAX, &b);
    if (found < 0) {
        return found;
    }
    if (found > 0 && b.pos < 0) {
        return append_before_packed(sq, s, variable, &b);
    }
    int err = apc_sqlite_load(sq, variable, found ? &b : growing);
    if (err) {
        return err;
    }
    const struct apc_sqlite_loaded *l = &sq->loaded;
    size_t low = 0, high = l->n;
    while (low < high) { /* the first row that is not below */
        size_t middle = (low + high) / 2;
        if (l->rows[middle].sample.seq < s->seq) {
            low = middle + 1;
        } else {
            high = middle;
        }
    }
    if (low == l->n) {
        return apc_sqlite_damaged(sq);
    }
    if (l->rows[low].sample.seq == s->seq) {
        return 0;
    }
    err = insert_late(sq, s, low, !found);
    return err ? err : 1;
}

/* The growing block takes the newest sample: 1, 0 when it is not the newest or there is no block, or an
 * error. */
static int grow_block(struct apc_sqlite *sq, const struct apc_sample *s, int64_t variable)
{
    sqlite3_stmt *statement = apc_sqlite_use(sq, APC_SQLITE_GROW);
    sqlite3_bind_int64(statement, 1, variable);
    sqlite3_bind_int64(statement, 2, s->seq);
    sqlite3_bind_int64(statement, 3, apc_sqlite_time(s->time));
    int err = apc_sqlite_step(sq, statement);
    if (err || sqlite3_changes(sq->db) == 0) {
        return err;
    }
    struct apc_sqlite_block b = sq->grown;
    err = insert_block_row(sq, s, b.count > 0 ? b.pos : 0);
    widen_block(&b, s->time);
    if (!err && b.count >= APC_SQLITE_BLOCK) {
        b.seq = s->seq;
        b.pos = sq->pos;
        err = put_growing(sq, variable, &b);
    }
    return err ? err : 1;
}

int apc_sqlite_append_one(struct apc_sqlite *sq, const struct apc_sample *s)
{
    const int64_t variable = apc_sqlite_variable(s->table, s->id);
    struct apc_sqlite_block b = no_block;
    int err = check_constraints(sq, s);
    if (!err) {
        err = next_pos(sq);
    }
    if (!err) {
        err = grow_block(sq, s, variable);
    }
    if (err) {
        return err;
    }
    int found = growing_block(sq, variable, &b);
    if (found != 0) {
        return found < 0 ? found : append_late(sq, s, variable, &b);
    }
    err = insert_block_row(sq, s, 0);
    if (err) {
        return err;
    }
    b.seq = s->seq;
    b.pos = sq->pos;
    widen_block(&b, s->time);
    err = put_growing(sq, variable, &b);
    return err ? err : 1;
}

/* ---- Trimming ------------------------------------------------------------------------------- */

static int drop_row(struct apc_sqlite *sq, int64_t pos)
{
    sqlite3_stmt *statement = apc_sqlite_use(sq, APC_SQLITE_DROP_SAMPLE);
    sqlite3_bind_int64(statement, 1, pos);
    return apc_sqlite_step(sq, statement);
}

static int drop_block(struct apc_sqlite *sq, int64_t variable, int64_t seq)
{
    sqlite3_stmt *statement = apc_sqlite_use(sq, APC_SQLITE_DROP_BLOCK);
    sqlite3_bind_int64(statement, 1, variable);
    sqlite3_bind_int64(statement, 2, seq);
    return apc_sqlite_step(sq, statement);
}

/* What is left of the block at hand; its last row may be another one. */
static int put_trimmed(struct apc_sqlite *sq, bool growing)
{
    struct apc_sqlite_loaded *l = &sq->loaded;
    struct apc_sqlite_block left = block_of(l->rows, l->n);
    if (growing) { /* the newest stays in any case */
        return put_block_row(sq, APC_SQLITE_PUT_VARIABLE, l->variable, &left);
    }
    int err = 0;
    if (left.seq != l->block.seq) {
        err = drop_block(sq, l->variable, l->block.seq);
    }
    return err || l->n == 0 ? err : put_block_row(sq, APC_SQLITE_PUT_BLOCK, l->variable, &left);
}

/* One that is packed goes as a whole. */
static int trim_packed(struct apc_sqlite *sq, int64_t before)
{
    struct apc_sqlite_loaded *l = &sq->loaded;
    if (l->block.last >= before) {
        return 0;
    }
    int err = drop_block(sq, l->variable, l->block.seq);
    if (!err) {
        err = apc_sqlite_drop_packed(sq, &l->block);
    }
    l->variable = -1;
    return err ? err : (int)l->n;
}

int apc_sqlite_trim(struct apc_sqlite *sq, int64_t before)
{
    struct apc_sqlite_loaded *l = &sq->loaded;
    if (l->block.pos < 0) {
        return trim_packed(sq, before);
    }
    struct apc_sqlite_block newest;
    int err = growing_block(sq, l->variable, &newest);
    if (err <= 0) {
        return err < 0 ? err : apc_sqlite_damaged(sq);
    }
    const bool growing = newest.count > 0 && newest.seq == l->block.seq;
    size_t kept = 0, n = l->n;
    bool linked = true; /* to the row before it that is kept */
    for (size_t i = 0; i < n; i++) {
        const struct apc_sqlite_row row = l->rows[i];
        if (apc_sqlite_time(row.sample.time) < before && row.pos != newest.pos) {
            err = drop_row(sq, row.pos);
            linked = false;
        } else {
            if (!linked && kept > 0) {
                sqlite3_stmt *statement = apc_sqlite_use(sq, APC_SQLITE_LINK);
                sqlite3_bind_int64(statement, 1, row.pos);
                sqlite3_bind_int64(statement, 2, l->rows[kept - 1].pos);
                err = apc_sqlite_step(sq, statement);
            }
            l->rows[kept++] = row;
            linked = true;
        }
        if (err < 0) {
            return err;
        }
    }
    l->n = kept;
    err = kept < n ? put_trimmed(sq, growing) : 0;
    l->variable = -1;
    return err ? err : (int)(n - kept);
}

/* SPDX-License-Identifier: BSD-3-Clause */
/*
 * The PostgreSQL store: what a tick does. Rows go and come as binary arrays, one statement a table, all of
 * them in one pipeline: one round trip and one transaction whatever the number of rows. The buffers belong to
 * the store and only grow, so in the steady state only libpq allocates.
 */
#include <stdlib.h>

#include "shareddata/postgresql/postgresql.h"

/* ---- Places: rows in the order of their tables ---------------------------------------------- */

/* A row's number counts the samples first, then the vectors. NULL: it is a sample's. */
static const struct apc_vector *vector_of(const struct apc_rows *rows, uint32_t row)
{
    return rows->vector && row >= rows->n_samples ? &rows->vector[row - rows->n_samples] : NULL;
}

static enum apc_table table_of(const struct apc_rows *rows, uint32_t row)
{
    const struct apc_vector *v = vector_of(rows, row);
    return v ? v->table : rows->sample[row].table;
}

static int id_of(const struct apc_rows *rows, uint32_t row)
{
    const struct apc_vector *v = vector_of(rows, row);
    return v ? v->id : rows->sample[row].id;
}

/* The rows of one statement: a part of pg->places. */
struct batch {
    enum apc_table table;
    size_t begin, n;
};

static struct batch batch_at(const struct apc_pg *pg, const struct apc_rows *rows, size_t begin)
{
    const struct apc_pg_place *place = &pg->places[begin];
    const size_t total = rows->n_samples + rows->n_vectors;
    struct batch b = {.table = table_of(rows, place->row), .begin = begin, .n = 1};
    while (begin + b.n < total && place[b.n].pass == place->pass &&
           table_of(rows, place[b.n].row) == b.table) {
        b.n++;
    }
    return b;
}

/* A counting sort: table by table, within a table as given. */
static int sort_by_table(struct apc_pg *pg, const struct apc_rows *rows)
{
    const size_t total = rows->n_samples + rows->n_vectors;
    if (total > pg->places_capacity) {
        struct apc_pg_place *places = (struct apc_pg_place *)realloc(pg->places, total * sizeof *places);
        if (!places) {
            return apc_fail(&pg->base.why, APC_ENOMEM, "out of memory for %zu rows", total);
        }
        pg->places = places;
        pg->places_capacity = total;
    }
    size_t next[APC_TABLE_END + 1] = {0};
    for (uint32_t i = 0; i < total; i++) {
        if (!apc_pg_text_of(pg, table_of(rows, i))) {
            return APC_ESCHEMA;
        }
        next[table_of(rows, i) + 1]++;
    }
    for (int t = 0; t < APC_TABLE_END; t++) {
        next[t + 1] += next[t];
    }
    for (uint32_t i = 0; i < total; i++) {
        pg->places[next[table_of(rows, i)]++] = (struct apc_pg_place){.row = i};
    }
    return 0;
}

static bool place_is_before(const struct apc_rows *rows, struct apc_pg_place a, struct apc_pg_place b)
{
    const int i = id_of(rows, a.row), j = id_of(rows, b.row);
    return a.pass != b.pass ? a.pass < b.pass : i != j ? i < j : a.row < b.row;
}

/* Shell's: qsort() may allocate. */
static void sort_places(const struct apc_rows *rows, struct apc_pg_place *place, size_t n)
{
    for (size_t gap = n / 2; gap > 0; gap /= 2) {
        for (size_t i = gap; i < n; i++) {
            struct apc_pg_place moving = place[i];
            size_t at = i;
            for (; at >= gap && place_is_before(rows, moving, place[at - gap]); at -= gap) {
                place[at] = place[at - gap];
            }
            place[at] = moving;
        }
    }
}

/* What people write goes in the order of ids; a variable's second row in a statement of its own, after it. */
static void sort_shared(struct apc_pg *pg, const struct apc_rows *rows)
{
    const size_t total = rows->n_samples + rows->n_vectors;
    struct batch b;
    for (size_t at = 0; at < total; at = b.begin + b.n) {
        b = batch_at(pg, rows, at);
        if (!apc_table_shared(b.table)) {
            continue;
        }
        struct apc_pg_place *place = &pg->places[at];
        sort_places(rows, place, b.n);
        bool twice = false;
        for (size_t i = 1; i < b.n; i++) {
            if (id_of(rows, place[i].row) == id_of(rows, place[i - 1].row)) {
                place[i].pass = place[i - 1].pass + 1;
                twice = true;
            }
        }
        if (twice) {
            sort_places(rows, place, b.n);
        }
    }
}

/* The statement of a table's rows that go as chunks. */
#define CHUNKS 1U

/* All that came of a variable goes as one chunk, where that is of use; what people write does not. */
static void choose_chunks(struct apc_pg *pg, const struct apc_rows *rows)
{
    struct batch b;
    for (size_t at = 0; at < rows->n_samples; at = b.begin + b.n) {
        b = batch_at(pg, rows, at);
        struct apc_pg_place *place = &pg->places[at];
        if (apc_table_shared(b.table) || !apc_pg_texts[b.table].merged) {
            continue;
        }
        sort_places(rows, place, b.n);
        size_t end, chosen = 0;
        for (size_t i = 0; i < b.n; i = end) {
            for (end = i + 1; end < b.n && id_of(rows, place[end].row) == id_of(rows, place[i].row); end++) {
            }
            const bool chunk = apc_pg_chunkable(rows->sample, place + i, end - i);
            for (size_t k = i; chunk && k < end; k++, chosen++) {
                place[k].pass = CHUNKS;
            }
        }
        if (chosen > 0 && chosen < b.n) {
            sort_places(rows, place, b.n);
        }
    }
}

/* ---- Parameters ----------------------------------------------------------------------------- */

enum column {
    COLUMN_ID,
    COLUMN_SEQ,
    COLUMN_TIME,
    COLUMN_STATUS,
    COLUMN_VALUE,
    COLUMN_ORIGIN,
    COLUMN_AUTHOR,
    /* Of vectors, instead of the value: all elements, one after another, and from where to where, from 1. */
    COLUMN_ELEMENTS,
    COLUMN_FIRST,
    COLUMN_LAST
};

static void put_reference(struct apc_pg_array *a, int64_t seq)
{
    if (seq > 0) {
        apc_pg_array_int8(a, seq);
    } else {
        apc_pg_array_null(a);
    }
}

static void put_array_sample(struct apc_pg_array *a, enum column column, const struct apc_sample *s)
{
    switch (column) {
    case COLUMN_ID:
        apc_pg_array_int4(a, s->id);
        break;
    case COLUMN_SEQ:
        apc_pg_array_int8(a, s->seq);
        break;
    case COLUMN_TIME:
        apc_pg_array_int8(a, apc_pg_time(s->time));
        break;
    case COLUMN_STATUS:
        apc_pg_array_int8(a, s->status);
        break;
    case COLUMN_VALUE:
        apc_pg_array_float8(a, s->value);
        break;
    case COLUMN_ORIGIN:
        put_reference(a, s->origin);
        break;
    default:
        put_reference(a, s->author);
        break;
    }
}

/* @p end: of the elements so far, this one's included. */
static void put_vector(struct apc_pg_array *a, enum column column, const struct apc_vector *v, size_t end)
{
    switch (column) {
    case COLUMN_ID:
        apc_pg_array_int4(a, v->id);
        break;
    case COLUMN_SEQ:
        apc_pg_array_int8(a, v->seq);
        break;
    case COLUMN_TIME:
        apc_pg_array_int8(a, apc_pg_time(v->time));
        break;
    case COLUMN_STATUS:
        apc_pg_array_int8(a, v->status);
        break;
    case COLUMN_FIRST:
        apc_pg_array_int4(a, (int32_t)(end - v->n + 1));
        break;
    case COLUMN_LAST:
        apc_pg_array_int4(a, (int32_t)end);
        break;
    default:
        for (uint32_t i = 0; i < v->n; i++) {
            apc_pg_array_float8(a, v->value[i]);
        }
        break;
    }
}

/* What the server takes as one parameter. */
#define ELEMENTS_MAX ((size_t)1 << 26)

/* One column of a statement's rows becomes its @p number-th parameter. */
static int add_column(struct apc_pg *pg, struct apc_pg_params *p, const struct apc_rows *rows,
                      const struct batch *b, enum column column, size_t number)
{
    static const uint32_t oid[] = {APC_PG_INT4, APC_PG_INT8, APC_PG_TIMESTAMPTZ, APC_PG_INT8, APC_PG_FLOAT8,
                                   APC_PG_INT8, APC_PG_INT8, APC_PG_FLOAT8,      APC_PG_INT4, APC_PG_INT4};
    const struct apc_pg_place *place = &pg->places[b->begin];
    struct apc_pg_array *a = &pg->columns[number];
    size_t elements = 0;
    for (size_t i = 0; column != COLUMN_ID && i < b->n; i++) {
        const struct apc_vector *v = vector_of(rows, place[i].row);
        elements += v ? v->n : 0;
    }
    if (elements > ELEMENTS_MAX) {
        return apc_fail(&pg->base.why, APC_EINVAL, "%zu elements at once are too many: at most %zu", elements,
                        ELEMENTS_MAX);
    }
    if (apc_pg_array_begin(a, oid[column], column == COLUMN_ELEMENTS ? elements : b->n) != 0) {
        return apc_fail(&pg->base.why, APC_ENOMEM, "out of memory for %zu rows", b->n);
    }
    for (size_t i = 0, end = 0; i < b->n; i++) {
        const struct apc_vector *v = vector_of(rows, place[i].row);
        if (v) {
            end += v->n;
            put_vector(a, column, v, end);
        } else {
            put_array_sample(a, column, &rows->sample[place[i].row]);
        }
    }
    apc_pg_param(p, a->data, a->length);
    return 0;
}

static const enum column sample_columns[] = {COLUMN_ID,    COLUMN_SEQ,    COLUMN_TIME,  COLUMN_STATUS,
                                             COLUMN_VALUE, COLUMN_ORIGIN, COLUMN_AUTHOR};
static const enum column vector_columns[] = {COLUMN_ID,       COLUMN_SEQ,   COLUMN_TIME, COLUMN_STATUS,
                                             COLUMN_ELEMENTS, COLUMN_FIRST, COLUMN_LAST};
static const enum column put_columns[] = {COLUMN_ID,    COLUMN_TIME,   COLUMN_STATUS,
                                          COLUMN_VALUE, COLUMN_ORIGIN, COLUMN_AUTHOR};

/* APPEND stores rows under their seq; PLACE does so but where people write: there it places them. */
enum operation { READ, APPEND, PLACE, PUT, SWAP };

/* ---- One operation -------------------------------------------------------------------------- */

struct exchange {
    struct apc_pg *pg;
    const struct apc_rows *rows;
    enum operation op;
    bool repeat; /* an append: leave out what is there */
    bool framed; /* its first statement is a BEGIN */
    size_t at;   /* where the batch of the next result begins */
    int count;
};

/* Has none of the rows more than a value? */
static bool has_values_only(const struct exchange *x, const struct batch *b)
{
    for (size_t i = b->begin; i < b->begin + b->n; i++) {
        const struct apc_sample *s = &x->rows->sample[x->pg->places[i].row];
        if (s->origin > 0 || s->author > 0) {
            return false;
        }
    }
    return true;
}

static bool is_chunks(const struct exchange *x, const struct batch *b)
{
    return x->op == APPEND && x->pg->places[b->begin].pass == CHUNKS;
}

static int send_batch(struct exchange *x, const struct batch *b)
{
    if (is_chunks(x, b)) {
        return apc_pg_send_chunks(x->pg, b->table, x->rows->sample, &x->pg->places[b->begin], b->n);
    }
    const struct apc_pg_text *text = &apc_pg_texts[b->table];
    const bool vectors = apc_table_vectors(b->table);
    const bool place = x->op == PLACE && apc_table_shared(b->table);
    const bool append = !place && (x->op == APPEND || x->op == PLACE);
    const bool plain = append && !vectors && !x->repeat && has_values_only(x, b);
    const enum column *columns = vectors ? vector_columns : x->op == PUT ? put_columns : sample_columns;
    const size_t n = x->op == READ ? 1 : x->op == PUT ? 6 : plain ? 5 : 7;
    struct apc_pg_params p = {0};
    for (size_t i = 0; i < n; i++) {
        int err = add_column(x->pg, &p, x->rows, b, columns[i], i);
        if (err) {
            return err;
        }
    }
    switch (x->op) {
    case READ:
        return apc_pg_send_prepared(x->pg, text->read_name, &p);
    case PUT:
        return apc_pg_send(x->pg, text->put, &p);
    case SWAP:
        return apc_pg_send(x->pg, text->swap, &p);
    default:
        return place       ? apc_pg_send_prepared(x->pg, text->place_name, &p)
               : x->repeat ? apc_pg_send(x->pg, text->repeat, &p)
                           : apc_pg_send_prepared(x->pg, plain ? text->plain_name : text->append_name, &p);
    }
}

static int send_command(struct apc_pg *pg, const char *sql)
{
    return apc_pg_send(pg, sql, &(struct apc_pg_params){0});
}

/* Everything of one operation but its answer. */
static int send_all(struct exchange *x)
{
    const size_t total = x->rows->n_samples + x->rows->n_vectors;
    int err = sort_by_table(x->pg, x->rows);
    if (!err && x->op == PLACE) {
        sort_shared(x->pg, x->rows);
    }
    if (!err && x->op == APPEND && x->pg->base.config.chunks && !x->repeat) {
        choose_chunks(x->pg, x->rows);
    }
    if (!err) {
        err = apc_pg_begin(x->pg);
    }
    /* A statement sees what was committed when it begins: several see one moment in such a transaction. */
    x->framed = !err && (x->op == SWAP ||
                         (x->op == READ && batch_at(x->pg, x->rows, 0).n < total && x->rows->n_vectors > 0));
    if (!err && x->framed) {
        err =
            send_command(x->pg, x->op == SWAP ? "BEGIN" : "BEGIN ISOLATION LEVEL REPEATABLE READ READ ONLY");
    }
    struct batch b = {0};
    for (x->at = 0; !err && x->at < total; x->at += b.n) {
        b = batch_at(x->pg, x->rows, x->at);
        err = send_batch(x, &b);
        if (err) {
            apc_pg_drop(x->pg); /* with what is queued */
        }
    }
    if (!err && x->framed && x->op == READ) {
        err = send_command(x->pg, "COMMIT");
    }
    x->at = 0;
    x->count = 0;
    return err;
}

static int pg_tick_unexpected(struct apc_pg *pg)
{
    return apc_fail(&pg->base.why, APC_EPROTO, "the database did not answer what was asked");
}

/* The batch that a result is of: they come in the order in which they were sent. 1: it is of none. */
static int next_batch(struct exchange *x, int statement, struct batch *b)
{
    if ((x->framed && statement == 0) || x->at >= x->rows->n_samples + x->rows->n_vectors) {
        return 1;
    }
    *b = batch_at(x->pg, x->rows, x->at);
    x->at += b->n;
    return 0;
}

static int end_transaction(struct apc_pg *pg, const char *how)
{
    int err = apc_pg_begin(pg);
    if (!err) {
        err = send_command(pg, how);
    }
    return err ? err : apc_pg_finish(pg, NULL, NULL);
}

/* ---- Read ----------------------------------------------------------------------------------- */

static void take_result_sample(const PGresult *result, int row, struct apc_sample *s)
{
    s->value = apc_pg_get_float8(PQgetvalue(result, row, 4));
    s->origin = apc_pg_cell(result, row, 5); /* NULL is 0 */
    s->author = (uint32_t)apc_pg_cell(result, row, 6);
}

static int give_row(struct exchange *x, const struct batch *b, const PGresult *result, int row)
{
    const bool vectors = apc_table_vectors(b->table);
    for (int column = 0; column < PQnfields(result); column++) {
        if (PQgetlength(result, row, column) != 8 && !PQgetisnull(result, row, column) &&
            !(vectors && column == 4)) {
            return pg_tick_unexpected(x->pg);
        }
    }
    const int64_t position = apc_pg_cell(result, row, 0);
    if (position < 1 || (size_t)position > b->n) {
        return pg_tick_unexpected(x->pg);
    }
    const uint32_t at = x->pg->places[b->begin + (size_t)position - 1].row;
    const int64_t seq = apc_pg_cell(result, row, 1);
    const apc_ns time = apc_pg_time_ns(apc_pg_cell(result, row, 2));
    const apc_status status = (apc_status)apc_pg_cell(result, row, 3);
    if (at < x->rows->n_samples) {
        struct apc_sample *s = &x->rows->sample[at];
        s->seq = seq;
        s->time = time;
        s->status = status;
        if (!vectors) { /* a wait looks at seqs only */
            take_result_sample(result, row, s);
        }
        return 0;
    }
    struct apc_vector *v = &x->rows->vector[at - x->rows->n_samples];
    int n = apc_pg_get_float8_array(PQgetvalue(result, row, 4), (size_t)PQgetlength(result, row, 4), v->value,
                                    v->room);
    if (n < 0) {
        return pg_tick_unexpected(x->pg);
    }
    v->seq = seq;
    v->time = time;
    v->status = status;
    v->n = (uint32_t)n;
    return 0;
}

static int take_read(void *ctx, int statement, PGresult *result)
{
    struct exchange *x = (struct exchange *)ctx;
    struct batch b;
    if (next_batch(x, statement, &b)) {
        return 0;
    }
    const int columns = apc_table_vectors(b.table) ? 5 : 7;
    int err = PQnfields(result) == columns ? 0 : pg_tick_unexpected(x->pg);
    for (int row = 0; !err && row < PQntuples(result); row++) {
        err = give_row(x, &b, result, row);
    }
    return err;
}

int apc_pg_read_rows(struct apc_store *store, struct apc_rows *rows)
{
    struct exchange x = {.pg = apc_pg_of(store), .rows = rows, .op = READ};
    int err = send_all(&x);
    if (err) {
        return err;
    }
    for (size_t i = 0; i < rows->n_samples; i++) {
        struct apc_sample *s = &rows->sample[i];
        *s = (struct apc_sample){.table = s->table, .id = s->id, .status = APC_BAD_NO_DATA};
    }
    for (size_t i = 0; i < rows->n_vectors; i++) {
        struct apc_vector *v = &rows->vector[i];
        v->seq = v->time = 0;
        v->n = 0;
        v->status = APC_BAD_NO_DATA;
    }
    err = apc_pg_finish(x.pg, take_read, &x);
    if (err && x.framed && x.pg->conn) {
        struct apc_error why = x.pg->base.why;
        end_transaction(x.pg, "ROLLBACK"); /* on failure the connection is closed, which does as well */
        x.pg->base.why = why;
    }
    return err;
}

int apc_pg_read(struct apc_store *store, struct apc_sample *samples, size_t n)
{
    struct apc_rows rows = {.size = sizeof rows, .sample = samples, .n_samples = n};
    return apc_pg_read_rows(store, &rows);
}

/* ---- Append --------------------------------------------------------------------------------- */

/* RETURNING id and seq, in the order of ids, of what was placed. */
static int take_places(struct exchange *x, const struct batch *b, const PGresult *result)
{
    int row = 0;
    if (PQnfields(result) != 2) {
        return pg_tick_unexpected(x->pg);
    }
    for (size_t i = b->begin; i < b->begin + b->n; i++) {
        struct apc_sample *s = &x->rows->sample[x->pg->places[i].row];
        s->seq = 0;
        if (row < PQntuples(result) && PQgetlength(result, row, 0) == 4 &&
            apc_pg_get_int4(PQgetvalue(result, row, 0)) == s->id) {
            s->seq = apc_pg_cell(result, row++, 1);
        }
    }
    return row == PQntuples(result) ? 0 : pg_tick_unexpected(x->pg);
}

static int take_append(void *ctx, int statement, PGresult *result)
{
    struct exchange *x = (struct exchange *)ctx;
    struct batch b;
    if (next_batch(x, statement, &b)) {
        return pg_tick_unexpected(x->pg);
    }
    x->count += is_chunks(x, &b) ? (int)b.n : (int)strtol(PQcmdTuples(result), NULL, 10);
    return x->op == PLACE && apc_table_shared(b.table) ? take_places(x, &b, result) : 0;
}

/* A commit is an acknowledgement only when the standby, if one is waited for, has it too. */
static int check_replicated(struct apc_pg *pg)
{
    if (!pg->unreplicated) {
        return 0;
    }
    return apc_fail(&pg->base.why, APC_ETIMEDOUT,
                    "committed on this server, but maybe not on its standby: not acknowledged, repeat it");
}

static int try_append(struct exchange *x)
{
    const apc_ns deadline = x->pg->deadline;
    int err = send_all(x);
    if (!err) {
        if (x->repeat) {
            x->pg->deadline = deadline; /* still that of the first try */
        }
        err = apc_pg_finish(x->pg, take_append, x);
    }
    return err;
}

/* Only a row that is there already, so that all are refused, makes it two round trips. */
static int run_append(struct apc_pg *pg, enum operation op, const struct apc_rows *rows)
{
    struct exchange x = {.pg = pg, .op = op, .rows = rows};
    int err = try_append(&x);
    for (int i = 0; i < 10 && err == APC_ECONFLICT; i++) { /* again when another writer is faster */
        for (size_t k = 0; op == PLACE && k < rows->n_samples; k++) {
            rows->sample[k].seq = pg->base.seq[k];
        }
        x.repeat = true;
        err = try_append(&x);
    }
    if (!err) {
        err = check_replicated(pg);
    }
    return err == APC_ECONFLICT ? APC_ESTORE : err ? err : x.count; /* a deadlock; nobody's value won */
}

int apc_pg_append_rows(struct apc_store *store, const struct apc_rows *rows)
{
    return run_append(apc_pg_of(store), PLACE, rows);
}

int apc_pg_append(struct apc_store *store, const struct apc_sample *samples, size_t n)
{
    const struct apc_rows rows = {
        .size = sizeof rows, .sample = (struct apc_sample *)(uintptr_t)samples, .n_samples = n};
    return run_append(apc_pg_of(store), APPEND, &rows);
}

/* ---- Put ------------------------------------------------------------------------------------ */

static int take_put(void *ctx, int statement, PGresult *result)
{
    struct exchange *x = (struct exchange *)ctx;
    struct batch b;
    if (next_batch(x, statement, &b) || PQnfields(result) != 2 || (size_t)PQntuples(result) != b.n) {
        return pg_tick_unexpected(x->pg);
    }
    for (int row = 0; row < PQntuples(result); row++) {
        if (PQgetlength(result, row, 0) != 4 || PQgetlength(result, row, 1) != 8) {
            return pg_tick_unexpected(x->pg);
        }
        const int id = apc_pg_get_int4(PQgetvalue(result, row, 0));
        for (size_t i = b.begin; i < b.begin + b.n; i++) {
            struct apc_sample *s = &x->rows->sample[x->pg->places[i].row];
            if (s->id == id) {
                s->seq = apc_pg_cell(result, row, 1);
            }
        }
    }
    return 0;
}

/*
 * The server itself takes the next seq. Two writers that take the same collide on the primary key: the
 * later one's whole transaction fails, so all of its values or none are written, and it tries again.
 */
int apc_pg_put(struct apc_store *store, struct apc_sample *samples, size_t n)
{
    const struct apc_rows rows = {.size = sizeof rows, .sample = samples, .n_samples = n};
    struct exchange x = {.pg = apc_pg_of(store), .op = PUT, .rows = &rows};
    int err = APC_ECONFLICT;
    for (int i = 0; i < 10 && err == APC_ECONFLICT; i++) {
        err = send_all(&x);
        if (!err) {
            err = apc_pg_finish(x.pg, take_put, &x);
        }
    }
    return err ? err : check_replicated(x.pg);
}

/* ---- Swap ----------------------------------------------------------------------------------- */

/* RETURNING id and seq of those that were as expected. Statement 0 is the BEGIN. */
static int take_swap(void *ctx, int statement, PGresult *result)
{
    struct exchange *x = (struct exchange *)ctx;
    x->count += PQntuples(result);
    return statement == 0 || PQnfields(result) == 2 ? 0 : pg_tick_unexpected(x->pg);
}

/*
 * Whether all are the newest still is known only when all statements have answered: so the transaction ends
 * in a second round trip. Of two that swap at the same time the later one collides on the primary key.
 */
int apc_pg_swap(struct apc_store *store, struct apc_sample *samples, size_t n)
{
    const struct apc_rows rows = {.size = sizeof rows, .sample = samples, .n_samples = n};
    struct exchange x = {.pg = apc_pg_of(store), .op = SWAP, .rows = &rows};
    int err = send_all(&x);
    if (!err) {
        err = apc_pg_finish(x.pg, take_swap, &x);
    }
    bool late = err == APC_ECONFLICT || (!err && (size_t)x.count < n);
    if (!err && !late) {
        err = end_transaction(x.pg, "COMMIT");
        for (size_t i = 0; !err && i < n; i++) {
            samples[i].seq++;
        }
        return err ? err : check_replicated(x.pg);
    }
    struct apc_error why = x.pg->base.why;
    int ended = x.pg->conn ? end_transaction(x.pg, "ROLLBACK") : 0;
    if (!late) {
        x.pg->base.why = why;
        return err;
    }
    err = ended ? ended : apc_pg_read(store, samples, n);
    return err ? err : apc_fail(&x.pg->base.why, APC_ECONFLICT, "another write was faster: it has changed");
}

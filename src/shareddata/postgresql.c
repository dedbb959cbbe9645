/* SPDX-License-Identifier: BSD-3-Clause */
/*
 * The PostgreSQL store: what a tick does. Samples go and come as binary arrays, one statement a table,
 * all of them in one pipeline: one round trip and one transaction whatever the number of samples. The
 * buffers belong to the store and only grow, so in the steady state only libpq allocates.
 */
#include <stdlib.h>
#include <string.h>

#include "shareddata/postgresql.h"

/* ---- Groups: the samples of one table ------------------------------------------------------- */

struct groups {
    size_t begin[APC_PG_TABLE_END + 1]; /* of each table's part of pg->order */
};

/* A counting sort: pg->order lists the samples table by table, within a table as given. */
static int group(struct apc_pg *pg, const struct apc_sample *samples, size_t n, struct groups *g)
{
    if (n > pg->order_capacity) {
        uint32_t *order = realloc(pg->order, n * sizeof *order);
        if (!order) {
            return apc_fail(&pg->base.why, APC_ENOMEM, "out of memory for %zu samples", n);
        }
        pg->order = order;
        pg->order_capacity = n;
    }
    memset(g, 0, sizeof *g);
    for (size_t i = 0; i < n; i++) {
        g->begin[samples[i].table + 1]++;
    }
    size_t next[APC_PG_TABLE_END];
    for (int t = 0; t < APC_PG_TABLE_END; t++) {
        next[t] = g->begin[t];
        g->begin[t + 1] += g->begin[t];
    }
    for (size_t i = 0; i < n; i++) {
        pg->order[next[samples[i].table]++] = (uint32_t)i;
    }
    return 0;
}

static size_t group_size(const struct groups *g, enum apc_table table)
{
    return g->begin[table + 1] - g->begin[table];
}

/* The statements of an operation are numbered as its tables with samples in rising order. */
static enum apc_table group_table(const struct groups *g, int statement)
{
    enum apc_table table = APC_SENSOR;
    while (table < APC_PG_TABLE_END && (group_size(g, table) == 0 || statement-- > 0)) {
        table++;
    }
    return table;
}

enum column {
    COLUMN_ID,
    COLUMN_SEQ,
    COLUMN_TIME,
    COLUMN_STATUS,
    COLUMN_VALUE,
    COLUMN_SENSOR,
    COLUMN_SETPOINT
};

static void put_reference(struct apc_pg_array *a, int64_t seq)
{
    if (seq > 0) {
        apc_pg_array_int8(a, seq);
    } else {
        apc_pg_array_null(a);
    }
}

static void put_cell(struct apc_pg_array *a, enum column column, const struct apc_sample *s)
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
    case COLUMN_SENSOR:
        put_reference(a, s->sensor_seq);
        break;
    case COLUMN_SETPOINT:
        put_reference(a, s->setpoint_seq);
        break;
    }
}

/* One column of one table's samples becomes a parameter. */
static int add_column(struct apc_pg *pg, struct apc_pg_params *p, const struct groups *g,
                      enum apc_table table, const struct apc_sample *samples, enum column column)
{
    static const uint32_t oid[] = {APC_PG_INT4,   APC_PG_INT8, APC_PG_TIMESTAMPTZ, APC_PG_INT8,
                                   APC_PG_FLOAT8, APC_PG_INT8, APC_PG_INT8};
    struct apc_pg_array *a = &pg->columns[column];
    if (apc_pg_array_begin(a, oid[column], group_size(g, table)) != 0) {
        return apc_fail(&pg->base.why, APC_ENOMEM, "out of memory for %zu samples", group_size(g, table));
    }
    for (size_t i = g->begin[table]; i < g->begin[table + 1]; i++) {
        put_cell(a, column, &samples[pg->order[i]]);
    }
    apc_pg_param(p, a->data, a->length);
    return 0;
}

static const enum column read_columns[] = {COLUMN_ID};
static const enum column append_columns[] = {COLUMN_ID,    COLUMN_SEQ,    COLUMN_TIME,    COLUMN_STATUS,
                                             COLUMN_VALUE, COLUMN_SENSOR, COLUMN_SETPOINT};
static const enum column put_columns[] = {COLUMN_ID, COLUMN_TIME, COLUMN_STATUS, COLUMN_VALUE};

enum operation { READ, APPEND, REPEAT, PUT, SWAP };

static int send_group(struct apc_pg *pg, enum operation op, enum apc_table table, const struct groups *g,
                      const struct apc_sample *samples)
{
    const struct apc_pg_text *text = &apc_pg_texts[table];
    const enum column *columns = op == READ ? read_columns : op == PUT ? put_columns : append_columns;
    size_t n = op == READ ? 1 : op == PUT ? 4 : op != SWAP && table == APC_ACTUATOR ? 7 : 5;
    struct apc_pg_params p = {0};
    for (size_t i = 0; i < n; i++) {
        int err = add_column(pg, &p, g, table, samples, columns[i]);
        if (err) {
            return err;
        }
    }
    switch (op) {
    case READ:
        return apc_pg_send_prepared(pg, text->read_name, &p);
    case APPEND:
        return apc_pg_send_prepared(pg, text->append_name, &p);
    case REPEAT:
        return apc_pg_send(pg, text->repeat, &p);
    case PUT:
        return apc_pg_send(pg, text->put, &p);
    default:
        return apc_pg_send(pg, text->swap, &p);
    }
}

/* Everything of one operation but its answer. */
static int send_groups(struct apc_pg *pg, enum operation op, const struct apc_sample *samples, size_t n,
                       struct groups *g)
{
    int err = group(pg, samples, n, g);
    if (!err) {
        err = apc_pg_begin(pg);
    }
    for (enum apc_table table = APC_SENSOR; !err && table < APC_PG_TABLE_END; table++) {
        if (group_size(g, table) > 0) {
            err = send_group(pg, op, table, g, samples);
            if (err) {
                apc_pg_drop(pg); /* with what is queued */
            }
        }
    }
    return err;
}

struct exchange {
    struct apc_pg *pg;
    struct apc_sample *samples;
    struct groups groups;
    int count;
};

static int unexpected(struct apc_pg *pg)
{
    return apc_fail(&pg->base.why, APC_EPROTO, "the database did not answer what was asked");
}

/* ---- Read --------------------------------------------------------------------------------- */

static int take_read(void *ctx, int statement, PGresult *result)
{
    const struct exchange *x = (const struct exchange *)ctx;
    enum apc_table table = group_table(&x->groups, statement);
    int columns = table == APC_ACTUATOR ? 7 : 5;
    if (table >= APC_PG_TABLE_END || PQnfields(result) != columns) {
        return unexpected(x->pg);
    }
    for (int row = 0; row < PQntuples(result); row++) {
        for (int column = 0; column < columns; column++) {
            if (PQgetlength(result, row, column) != 8 && !PQgetisnull(result, row, column)) {
                return unexpected(x->pg);
            }
        }
        int64_t position = apc_pg_cell(result, row, 0);
        if (position < 1 || (size_t)position > group_size(&x->groups, table)) {
            return unexpected(x->pg);
        }
        struct apc_sample *s = &x->samples[x->pg->order[x->groups.begin[table] + (size_t)position - 1]];
        s->seq = apc_pg_cell(result, row, 1);
        s->time = apc_pg_time_ns(apc_pg_cell(result, row, 2));
        s->status = (apc_status)apc_pg_cell(result, row, 3);
        s->value = apc_pg_get_float8(PQgetvalue(result, row, 4));
        s->sensor_seq = columns == 7 ? apc_pg_cell(result, row, 5) : 0;
        s->setpoint_seq = columns == 7 ? apc_pg_cell(result, row, 6) : 0;
    }
    return 0;
}

int apc_pg_read(struct apc_store *store, struct apc_sample *samples, size_t n)
{
    struct exchange x = {.pg = apc_pg_of(store), .samples = samples};
    int err = send_groups(x.pg, READ, samples, n, &x.groups);
    if (err) {
        return err;
    }
    for (size_t i = 0; i < n; i++) {
        samples[i] =
            (struct apc_sample){.table = samples[i].table, .id = samples[i].id, .status = APC_BAD_NO_DATA};
    }
    return apc_pg_finish(x.pg, take_read, &x);
}

/* ---- Append and put ------------------------------------------------------------------------ */

static int take_append(void *ctx, int statement, PGresult *result)
{
    struct exchange *x = (struct exchange *)ctx;
    (void)statement;
    x->count += (int)strtol(PQcmdTuples(result), NULL, 10);
    return 0;
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

static int try_append(struct exchange *x, enum operation op, const struct apc_sample *samples, size_t n)
{
    const apc_ns deadline = x->pg->deadline;
    int err = send_groups(x->pg, op, samples, n, &x->groups);
    if (!err) {
        if (op == REPEAT) {
            x->pg->deadline = deadline; /* still that of the first try */
        }
        x->count = 0;
        err = apc_pg_finish(x->pg, take_append, x);
    }
    return err;
}

/* Only a row that is there already, so that all are refused, makes it two round trips. */
static int append(struct apc_store *store, const struct apc_sample *samples, size_t n)
{
    struct exchange x = {.pg = apc_pg_of(store)};
    int err = try_append(&x, APPEND, samples, n);
    for (int i = 0; i < 10 && err == APC_ECONFLICT; i++) { /* again when another writer is faster */
        err = try_append(&x, REPEAT, samples, n);
    }
    if (!err) {
        err = check_replicated(x.pg);
    }
    return err == APC_ECONFLICT ? APC_ESTORE : err ? err : x.count; /* a deadlock; nobody's value won */
}

static int take_put(void *ctx, int statement, PGresult *result)
{
    struct exchange *x = (struct exchange *)ctx;
    enum apc_table table = group_table(&x->groups, statement);
    if (table >= APC_PG_TABLE_END || PQnfields(result) != 2 ||
        (size_t)PQntuples(result) != group_size(&x->groups, table)) {
        return unexpected(x->pg);
    }
    for (int row = 0; row < PQntuples(result); row++) {
        if (PQgetlength(result, row, 0) != 4 || PQgetlength(result, row, 1) != 8) {
            return unexpected(x->pg);
        }
        int id = apc_pg_get_int4(PQgetvalue(result, row, 0));
        for (size_t i = x->groups.begin[table]; i < x->groups.begin[table + 1]; i++) {
            struct apc_sample *s = &x->samples[x->pg->order[i]];
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
static int put(struct apc_store *store, struct apc_sample *samples, size_t n)
{
    struct exchange x = {.pg = apc_pg_of(store), .samples = samples};
    int err = APC_ECONFLICT;
    for (int i = 0; i < 10 && err == APC_ECONFLICT; i++) {
        err = send_groups(x.pg, PUT, samples, n, &x.groups);
        if (!err) {
            err = apc_pg_finish(x.pg, take_put, &x);
        }
    }
    return err ? err : check_replicated(x.pg);
}

/* ---- Swap ---------------------------------------------------------------------------------- */

/* RETURNING id and seq of those that were as expected. Statement 0 is the BEGIN. */
static int take_swap(void *ctx, int statement, PGresult *result)
{
    struct exchange *x = (struct exchange *)ctx;
    x->count += PQntuples(result);
    return statement == 0 || PQnfields(result) == 2 ? 0 : unexpected(x->pg);
}

static int end_transaction(struct apc_pg *pg, const char *how)
{
    int err = apc_pg_begin(pg);
    if (!err) {
        err = apc_pg_send(pg, how, &(struct apc_pg_params){0});
    }
    return err ? err : apc_pg_finish(pg, NULL, NULL);
}

/*
 * Whether all are the newest still is known only when all statements have answered: so the transaction ends
 * in a second round trip. Of two that swap at the same time the later one collides on the primary key.
 */
static int swap(struct apc_store *store, struct apc_sample *samples, size_t n)
{
    struct exchange x = {.pg = apc_pg_of(store), .samples = samples};
    int err = apc_pg_begin(x.pg);
    if (!err) {
        err = apc_pg_send(x.pg, "BEGIN", &(struct apc_pg_params){0});
    }
    if (!err) {
        err = send_groups(x.pg, SWAP, samples, n, &x.groups);
    }
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
    return err ? err : apc_fail(&x.pg->base.why, APC_ECONFLICT, "somebody else was faster: it has changed");
}

/* ---- Claim --------------------------------------------------------------------------------- */

int apc_pg_send_claim(struct apc_pg *pg, enum apc_table table, size_t n)
{
    struct apc_pg_params p = {0};
    char count[8];
    apc_pg_put_int8(count, (int64_t)n);
    apc_pg_param_text(&p, apc_table_name(table));
    apc_pg_param(&p, count, sizeof count);
    pg->session.claimant = true;
    return apc_pg_send(pg, "SELECT holder, last FROM claim($1, $2::int8::int4)", &p);
}

int apc_pg_take_claim(struct apc_pg *pg, enum apc_table table, const PGresult *result, int64_t *last,
                      size_t n)
{
    if (PQntuples(result) != 1 || PQnfields(result) != 2) {
        return unexpected(pg);
    }
    if (!PQgetisnull(result, 0, 0)) {
        return apc_fail(&pg->base.why, APC_EBUSY,
                        "table %s of schema %s is already written by %s: stop it first",
                        apc_table_name(table), pg->schema, PQgetvalue(result, 0, 0));
    }
    if (n == 0) {
        return 0;
    }
    int got = apc_pg_get_int8_array(PQgetvalue(result, 0, 1), (size_t)PQgetlength(result, 0, 1), last, n);
    return got >= 0 && (size_t)got == n ? 0 : unexpected(pg);
}

struct claiming {
    struct apc_pg *pg;
    enum apc_table table;
    int64_t *last;
    size_t n;
};

static int take_claim(void *ctx, int statement, PGresult *result)
{
    const struct claiming *c = (const struct claiming *)ctx;
    (void)statement;
    return apc_pg_take_claim(c->pg, c->table, result, c->last, c->n);
}

static int claim(struct apc_store *store, enum apc_table table, size_t n, int64_t *last)
{
    struct claiming c = {.pg = apc_pg_of(store), .table = table, .last = last, .n = n};
    int err = apc_pg_begin(c.pg);
    if (!err) {
        err = apc_pg_send_claim(c.pg, table, n);
    }
    if (!err) {
        err = apc_pg_finish(c.pg, take_claim, &c);
    }
    if (!err) {
        c.pg->claimed[table] = true;
    }
    return err;
}

/* ---- Life ---------------------------------------------------------------------------------- */

static void close_store(struct apc_store *store)
{
    struct apc_pg *pg = apc_pg_of(store);
    apc_pg_close_waiter(pg);
    apc_pg_drop(pg);
    PQconninfoFree(pg->uri);
    for (size_t i = 0; i < sizeof pg->columns / sizeof pg->columns[0]; i++) {
        free(pg->columns[i].data);
    }
    free(pg->order);
    free(pg);
}

static int open_store(struct apc_store **store, const char *uri, const struct apc_store_config *config,
                      struct apc_error *why)
{
    struct apc_pg *pg = (struct apc_pg *)calloc(1, sizeof *pg);
    if (!pg) {
        return apc_fail(why, APC_ENOMEM, "out of memory");
    }
    pg->base.ops = &apc_postgresql_store;
    pg->base.config = *config;
    pg->random = ((uint64_t)apc_clock_mono(NULL) ^ (uint64_t)(uintptr_t)pg) | 1;
    int err = apc_pg_parse_uri(pg, uri, why);
    if (err) {
        close_store(&pg->base);
        return err;
    }
    *store = &pg->base;
    return 0;
}

static bool connected(const struct apc_store *store)
{
    const struct apc_pg *pg = (const struct apc_pg *)store;
    return pg->conn && PQstatus(pg->conn) == CONNECTION_OK;
}

static int version(const struct apc_store *store)
{
    return ((const struct apc_pg *)store)->version;
}

static int connect_store(struct apc_store *store)
{
    return apc_pg_begin(apc_pg_of(store));
}

#define OPS(word)                                                                                            \
    {                                                                                                        \
        .scheme = word, .table_end = APC_PG_TABLE_END, .open = open_store, .close = close_store,             \
        .connected = connected, .connect = connect_store, .version = version, .read = apc_pg_read,           \
        .append = append, .claim = claim, .put = put, .swap = swap, .wait = apc_pg_wait,                     \
        .variables = apc_pg_variables, .history = apc_pg_history, .history_bins = apc_pg_history_bins,       \
        .put_tags = apc_pg_put_tags, .get_tags = apc_pg_get_tags, .append_events = apc_pg_append_events,     \
        .events = apc_pg_events, .append_timing = apc_pg_append_timing, .timing = apc_pg_timing,             \
        .init = apc_pg_init, .maintain = apc_pg_maintain,                                                    \
    }

const struct apc_store_ops apc_postgresql_store = OPS("postgresql:");
const struct apc_store_ops apc_postgres_store = OPS("postgres:");

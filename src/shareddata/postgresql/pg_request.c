/* SPDX-License-Identifier: BSD-3-Clause */
/* The PostgreSQL store as a history: what people want written, and what they are told. */
#include <stdio.h>
#include <string.h>

#include "shareddata/postgresql/postgresql.h"

/* The server's clock says how old they are: it has stamped them. Ids are given before a row is to be seen, so
 * one may come after a later one; not after a thousand. */
static const char requests_sql[] =
    "SELECT id, time, (extract(epoch FROM clock_timestamp() - time) * 1e6)::int8, "
    "(extract(epoch FROM until - clock_timestamp()) * 1e6)::int8, variable::int8, value, coalesce(seq, -1), "
    "table_name, author, reason, role::text FROM request "
    "WHERE outcome IS NULL AND id > (SELECT coalesce(max(id), 0) - 1000 FROM request) ORDER BY id LIMIT 64";

static const char answer_sql[] = "UPDATE request SET seq = $2::int8, outcome = $3 WHERE id = $1::int8 AND "
                                 "outcome IS NULL";

struct asking {
    struct apc_pg *pg;
    apc_request_fn fn;
    void *ctx;
    int count;
};

static void request_cell_text(const PGresult *result, int row, int column, char *text, size_t size)
{
    snprintf(text, size, "%.*s", PQgetlength(result, row, column), PQgetvalue(result, row, column));
}

static apc_ns cell_us(const PGresult *result, int row, int column)
{
    const int64_t us = apc_pg_cell(result, row, column);
    return us > INT64_MAX / 1000 ? INT64_MAX : us < INT64_MIN / 1000 ? INT64_MIN : us * 1000;
}

static int take_requests(void *ctx, int statement, PGresult *result)
{
    struct asking *a = (struct asking *)ctx;
    (void)statement;
    if (PQnfields(result) != 11) {
        return apc_fail(&a->pg->base.why, APC_EPROTO, "the database did not answer what was asked");
    }
    a->pg->base.streaming = true;
    for (int row = 0; row < PQntuples(result); row++) {
        char table[16];
        struct apc_request r = {.id = apc_pg_cell(result, row, 0),
                                .time = apc_pg_time_ns(apc_pg_cell(result, row, 1)),
                                .age = cell_us(result, row, 2),
                                .left = cell_us(result, row, 3),
                                .variable = (int)apc_pg_cell(result, row, 4),
                                .value = apc_pg_get_float8(PQgetvalue(result, row, 5)),
                                .seq = apc_pg_cell(result, row, 6)};
        request_cell_text(result, row, 7, table, sizeof table);
        request_cell_text(result, row, 8, r.author, sizeof r.author);
        request_cell_text(result, row, 9, r.reason, sizeof r.reason);
        request_cell_text(result, row, 10, r.role, sizeof r.role);
        r.table = apc_table_parse(table);
        a->count++;
        if (a->fn(a->ctx, &r) != 0) {
            break;
        }
    }
    a->pg->base.streaming = false;
    return 0;
}

int apc_pg_requests(struct apc_store *store, apc_request_fn fn, void *ctx)
{
    struct asking a = {.pg = apc_pg_of(store), .fn = fn, .ctx = ctx};
    int err = apc_pg_begin(a.pg);
    if (!err) {
        err = apc_pg_send(a.pg, requests_sql, &(struct apc_pg_params){0});
    }
    if (!err) {
        err = apc_pg_finish(a.pg, take_requests, &a);
    }
    return err ? err : a.count;
}

int apc_pg_answer(struct apc_store *store, int64_t id, int64_t seq, const char *outcome)
{
    struct apc_pg *pg = apc_pg_of(store);
    struct apc_pg_params p = {0};
    char bytes[2][8];
    apc_pg_put_int8(bytes[0], id);
    apc_pg_put_int8(bytes[1], seq);
    apc_pg_param(&p, bytes[0], 8);
    apc_pg_param(&p, bytes[1], 8);
    apc_pg_param_text(&p, outcome);
    int err = apc_pg_begin(pg);
    if (!err) {
        err = apc_pg_send(pg, answer_sql, &p);
    }
    return err ? err : apc_pg_finish(pg, NULL, NULL);
}

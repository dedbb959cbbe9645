/* SPDX-License-Identifier: BSD-3-Clause */
/*
 * The paper's functions. They run the store's own statements, on schema apc, over a PGconn that the
 * caller made and whose waiting is the caller's business.
 */
#include <limits.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "apcshareddata.h"
#include "shareddata/postgresql/postgresql.h"

void genTimeStampUTC(char ts[27])
{
    char text[APC_TIME_LEN];
    apc_time_format(apc_clock_utc(NULL), text); /* 2026-01-31T12:00:00.123456Z */
    memcpy(ts, text, 26);
    ts[10] = ' ';
    ts[26] = '\0';
}

#define TRIES 10

/* The caller's session may be one of serializable transactions: then the server may undo a statement that met
 * another's, as it does in a deadlock, and wants it again. Within a transaction of the caller's that is his.
 */
static PGresult *execute(PGconn *conn, const char *sql, const struct apc_pg_params *p)
{
    for (int i = 1;; i++) {
        PGresult *result = PQexecParams(conn, sql, p->n, NULL, p->values, p->lengths, p->formats, 1);
        const char *state = PQresultErrorField(result, PG_DIAG_SQLSTATE);
        const bool again = state && (strcmp(state, "40001") == 0 || strcmp(state, "40P01") == 0);
        if (!again || i == TRIES || PQtransactionStatus(conn) != PQTRANS_IDLE) {
            return result;
        }
        PQclear(result);
    }
}

static int refused_by_server(PGconn *conn)
{
    return PQstatus(conn) == CONNECTION_OK ? APC_ESTORE : APC_ECONN;
}

/* ---- Insert -------------------------------------------------------------------------------- */

/* The store's parameters are arrays; these are arrays of one. */
struct one_sample {
    char data[4][APC_PG_ARRAY_SIZE(1, 8)];
    struct apc_pg_params params;
};

static void make_one(struct one_sample *one, int id, apc_ns time, apc_status status, double value)
{
    static const uint32_t oid[4] = {APC_PG_INT4, APC_PG_TIMESTAMPTZ, APC_PG_INT8, APC_PG_FLOAT8};
    *one = (struct one_sample){0};
    for (size_t i = 0; i < 4; i++) {
        struct apc_pg_array a = {.data = one->data[i], .capacity = sizeof one->data[i]};
        apc_pg_array_begin(&a, oid[i], 1); /* it fits: nothing is allocated */
        switch (i) {
        case 0:
            apc_pg_array_int4(&a, id);
            break;
        case 1:
            apc_pg_array_int8(&a, apc_pg_time(time));
            break;
        case 2:
            apc_pg_array_int8(&a, status);
            break;
        default:
            apc_pg_array_float8(&a, value);
        }
        apc_pg_param(&one->params, a.data, a.length);
    }
}

int insertIntoTableFloat(PGconn *conn, const char *table, int id, const char *ts, const char *status,
                         double value)
{
    enum apc_table number = table ? apc_table_parse(table) : (enum apc_table)0;
    apc_ns time = 0;
    apc_status code = APC_BAD;
    if (!conn || !apc_table_known(number) || !apc_pg_texts[number].paper_put || id < 0 || !ts ||
        apc_time_parse(ts, &time) != 0 || !status || apc_status_parse(status, &code) != 0 ||
        !(fabs(value) < APC_VALUE_MAX)) {
        return APC_EINVAL;
    }
    struct one_sample one;
    make_one(&one, id, time, code, value);
    for (int i = 0; i < 3; i++) {
        PGresult *result = execute(conn, apc_pg_texts[number].paper_put, &one.params);
        bool done = PQresultStatus(result) == PGRES_COMMAND_OK;
        bool inserted = done && strcmp(PQcmdTuples(result), "1") == 0;
        const char *sqlstate = PQresultErrorField(result, PG_DIAG_SQLSTATE);
        bool taken = sqlstate && strcmp(sqlstate, "23505") == 0;
        PQclear(result);
        if (!done && !taken) {
            return refused_by_server(conn);
        }
        if (inserted) {
            return 0;
        }
    }
    return APC_ECONFLICT; /* someone else took the next seq each time */
}

int insertIntoTableInt(PGconn *conn, const char *table, int id, const char *ts, const char *status, int value)
{
    return insertIntoTableFloat(conn, table, id, ts, status, value);
}

/* ---- Read ---------------------------------------------------------------------------------- */

/* Columns of a row: position, seq, time, status, value. */
static int position(const PGresult *result, int row)
{
    return (int)apc_pg_get_int8(PQgetvalue(result, row, 0)) - 1;
}

/* Is it libapc's table at all? The caller's PGconn may lead to any. */
static bool well_formed(const PGresult *result, int n)
{
    if (PQnfields(result) != 5) {
        return false;
    }
    for (int row = 0; row < PQntuples(result); row++) {
        for (int column = 0; column < 5; column++) {
            if (PQgetlength(result, row, column) != 8) {
                return false;
            }
        }
        if (position(result, row) < 0 || position(result, row) >= n) {
            return false;
        }
    }
    return true;
}

/* The newest samples of ids first .. first + n - 1, or what kept from it; PQclear() the result either way. */
static int read_newest_rows(PGconn *conn, const char *table, int first, int n, PGresult **result)
{
    enum apc_table number = table ? apc_table_parse(table) : (enum apc_table)0;
    *result = NULL;
    if (!conn || !apc_table_known(number) || !apc_pg_texts[number].paper_read || first < 0 || n < 0 ||
        (size_t)n > APC_STORE_SAMPLES_MAX) {
        return APC_EINVAL;
    }
    struct apc_pg_array ids = {0};
    if (apc_pg_array_begin(&ids, APC_PG_INT4, (size_t)n) != 0) {
        return APC_ENOMEM;
    }
    for (int i = 0; i < n; i++) {
        apc_pg_array_int4(&ids, first + i);
    }
    struct apc_pg_params p = {0};
    apc_pg_param(&p, ids.data, ids.length);
    *result = execute(conn, apc_pg_texts[number].paper_read, &p);
    free(ids.data);
    if (PQresultStatus(*result) != PGRES_TUPLES_OK) {
        return refused_by_server(conn);
    }
    if (!well_formed(*result, n)) {
        return APC_ESTORE;
    }
    return PQntuples(*result) == n ? 0 : APC_ENOTFOUND;
}

static double value_of_result(const PGresult *result, int row)
{
    return apc_pg_get_float8(PQgetvalue(result, row, 4));
}

static void write_texts(const PGresult *result, int row, char *ts, char *status)
{
    char text[APC_TIME_LEN];
    if (ts) {
        apc_time_format(apc_pg_time_ns(apc_pg_get_int8(PQgetvalue(result, row, 2))), text);
        memcpy(ts, text, 26);
        ts[10] = ' ';
        ts[26] = '\0';
    }
    if (status) {
        apc_status_format((apc_status)apc_pg_get_int8(PQgetvalue(result, row, 3)), status);
    }
}

/* Is every value an int? Before anything is written. */
static int check_ints(const PGresult *result)
{
    for (int row = 0; row < PQntuples(result); row++) {
        double value = value_of_result(result, row);
        if (!(value >= INT_MIN && value <= INT_MAX) || value != trunc(value)) {
            return APC_ERANGE;
        }
    }
    return 0;
}

int readRecentValFloat(PGconn *conn, const char *table, int id, char *ts, char *status, double *value)
{
    if (!value) {
        return APC_EINVAL;
    }
    PGresult *result;
    int err = read_newest_rows(conn, table, id, 1, &result);
    if (!err) {
        *value = value_of_result(result, 0);
        write_texts(result, 0, ts, status);
    }
    PQclear(result);
    return err;
}

int readRecentValInt(PGconn *conn, const char *table, int id, char *ts, char *status, int *value)
{
    if (!value) {
        return APC_EINVAL;
    }
    PGresult *result;
    int err = read_newest_rows(conn, table, id, 1, &result);
    if (!err) {
        err = check_ints(result);
    }
    if (!err) {
        *value = (int)value_of_result(result, 0);
        write_texts(result, 0, ts, status);
    }
    PQclear(result);
    return err;
}

static void write_all_texts(const PGresult *result, char (*ts)[1024], char (*status)[1024])
{
    for (int row = 0; row < PQntuples(result); row++) {
        int i = position(result, row);
        write_texts(result, row, ts ? ts[i] : NULL, status ? status[i] : NULL);
    }
}

int readMultiRecentValsFloat(PGconn *conn, const char *table, int n, char (*ts)[1024], char (*status)[1024],
                             double *values)
{
    if (!values) {
        return APC_EINVAL;
    }
    PGresult *result;
    int err = read_newest_rows(conn, table, 1, n, &result);
    if (!err) {
        for (int row = 0; row < n; row++) {
            values[position(result, row)] = value_of_result(result, row);
        }
        write_all_texts(result, ts, status);
    }
    PQclear(result);
    return err;
}

int readMultiRecentValsInt(PGconn *conn, const char *table, int n, char (*ts)[1024], char (*status)[1024],
                           int *values)
{
    if (!values) {
        return APC_EINVAL;
    }
    PGresult *result;
    int err = read_newest_rows(conn, table, 1, n, &result);
    if (!err) {
        err = check_ints(result);
    }
    if (!err) {
        for (int row = 0; row < n; row++) {
            values[position(result, row)] = (int)value_of_result(result, row);
        }
        write_all_texts(result, ts, status);
    }
    PQclear(result);
    return err;
}

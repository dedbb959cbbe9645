/* SPDX-License-Identifier: BSD-3-Clause */
/* Plain libpq: the floor of a tick, and the tick of the paper's listing. */
#include <stdlib.h>

#include "bench.h"
#include "tick.h"

#define KP    0.2 /* of the listing: its tuning is in its source */
#define TAU_I 10.0

PGconn *tick_connect(const char *schema)
{
    PGconn *conn = PQconnectdb("application_name=bench");

    if (PQstatus(conn) != CONNECTION_OK)
        die("%s", PQerrorMessage(conn));
    if (schema) {
        char sql[128];
        snprintf(sql, sizeof sql, "SET search_path = %s; SET plan_cache_mode = force_generic_plan", schema);
        PQclear(tick_execute(conn, sql));
    }
    return conn;
}

PGresult *tick_expect(PGconn *conn, PGresult *result)
{
    ExecStatusType status = PQresultStatus(result);

    if (status != PGRES_TUPLES_OK && status != PGRES_COMMAND_OK && status != PGRES_PIPELINE_SYNC)
        die("%s", PQerrorMessage(conn));
    return result;
}

PGresult *tick_execute(PGconn *conn, const char *sql)
{
    return tick_expect(conn, PQexec(conn, sql));
}

void floor_once(void *conn)
{
    PQclear(tick_execute(conn, "SELECT 1"));
    PQclear(tick_execute(conn, "SELECT 1"));
}

/* ---- The listing's way --------------------------------------------------------------------- */

/* 3 n + 4 statements and as many round trips; n of them commits. The newest is found by the key, which is
 * kinder to it than the latest time of the paper. */
struct listing {
    PGconn *conn;
    size_t n;
    int64_t seq;
    double *y, *z, *integral;
};

struct listing *listing_open(const char *schema, size_t n)
{
    struct listing *l = allocate(1, sizeof *l);

    l->conn = tick_connect(schema);
    l->n = n;
    l->y = allocate(n, sizeof *l->y);
    l->z = allocate(n, sizeof *l->z);
    l->integral = allocate(n, sizeof *l->integral);
    PGresult *result = tick_execute(l->conn, "SELECT coalesce(max(seq), 0) FROM actuator");
    l->seq = strtoll(PQgetvalue(result, 0, 0), NULL, 10);
    PQclear(result);
    return l;
}

static double recent(struct listing *l, const char *table, size_t id)
{
    char sql[160], text[24];
    const char *const values[1] = {text};

    snprintf(sql, sizeof sql, "SELECT time, status, value FROM %s WHERE id = $1 ORDER BY seq DESC LIMIT 1",
             table);
    snprintf(text, sizeof text, "%zu", id);
    PGresult *result = tick_expect(l->conn, PQexecParams(l->conn, sql, 1, NULL, values, NULL, NULL, 0));
    if (PQntuples(result) != 1)
        die("table %s has no row %zu", table, id);
    double value = strtod(PQgetvalue(result, 0, 2), NULL);
    PQclear(result);
    return value;
}

static void insert(struct listing *l, size_t id, const char *time, double value)
{
    char texts[3][32];
    const char *const values[5] = {texts[0], texts[1], time, "0", texts[2]};

    snprintf(texts[0], sizeof texts[0], "%zu", id);
    snprintf(texts[1], sizeof texts[1], "%lld", (long long)l->seq);
    snprintf(texts[2], sizeof texts[2], "%.17g", value);
    PQclear(tick_expect(l->conn, PQexecParams(l->conn,
                                              "INSERT INTO actuator (id, seq, time, status, value)"
                                              " VALUES ($1, $2, $3, $4, $5)",
                                              5, NULL, values, NULL, NULL, 0)));
}

void listing_once(void *ctx)
{
    struct listing *l = ctx;
    char time[27];

    if (recent(l, "opmode", 0) != 1)
        die("the stored mode is not Auto");
    for (size_t i = 1; i <= 3; i++)
        if (recent(l, "dim", i) != (double)l->n)
            die("the stored dimensions are not %zu", l->n);
    for (size_t i = 0; i < l->n; i++)
        l->y[i] = recent(l, "sensor", i + 1);
    for (size_t i = 0; i < l->n; i++)
        l->z[i] = recent(l, "setpoint", i + 1);
    genTimeStampUTC(time);
    l->seq++;
    for (size_t i = 0; i < l->n; i++)
        insert(l, i + 1, time, KP * (l->z[i] - l->y[i]) + l->integral[i]);
    for (size_t i = 0; i < l->n; i++)
        l->integral[i] += KP * TS / TAU_I * (l->z[i] - l->y[i]);
}

void listing_close(struct listing *l)
{
    PQfinish(l->conn);
    free(l->y);
    free(l->z);
    free(l->integral);
    free(l);
}

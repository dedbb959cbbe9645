/* SPDX-License-Identifier: BSD-3-Clause */
/*
 * A controller's tick written by hand with libpq for these very tables: two round trips, prepared statements,
 * pipelines, binary arrays. It has what is known to be fast (pg_statements.c says what was measured), and
 * nothing that guards against a slow or failing server: no deadline, no reconnecting, no repeating.
 */
#include <stdlib.h>
#include <string.h>

#include "bench.h"
#include "pgbinary.h"
#include "tick.h"

/* ---- Parts ----------------------------------------------------------------------------------- */

struct value {
    int64_t seq, time, status;
    double value;
};

/* The variables of one table that the tick reads or writes. */
struct part {
    const char *table;
    size_t n;
    char *ids; /* parameter, made once */
    size_t ids_length;
    struct value *values; /* read: the newest; write: what is to be written, seq being the last one */
};

#define PARTS 5

struct hand {
    PGconn *conn;
    size_t n;
    struct part read[PARTS], write[2];
    size_t n_read, n_write;
    const struct value *mode, *tuning, *y, *z;
    struct value *u;
    double *integral;
    char *columns[6]; /* parameters: seq, time, status, value, sensor_seq, setpoint_seq */
};

static double from_bits(int64_t i)
{
    double value;
    memcpy(&value, &i, sizeof value);
    return value;
}

static int64_t get_int8(const PGresult *result, int row, int column)
{
    uint64_t big;
    memcpy(&big, PQgetvalue(result, row, column), sizeof big);
    return (int64_t)be64toh(big);
}

static void make_part(struct part *part, const char *table, int first, size_t n)
{
    part->table = table;
    part->n = n;
    part->values = allocate(n, sizeof *part->values);
    part->ids = allocate(20 + 8 * n, 1);
    char *at = begin_array(part->ids, 23, n);
    for (size_t i = 0; i < n; i++)
        at = add_int4(at, (uint32_t)first + (uint32_t)i);
    part->ids_length = (size_t)(at - part->ids);
}

static void prepare(struct hand *h, const char *verb, const char *table, const char *sql)
{
    char name[64];

    snprintf(name, sizeof name, "%s_%s", verb, table);
    PQclear(tick_expect(h->conn, PQprepare(h->conn, name, sql, 0, NULL)));
}

static struct value *add_read(struct hand *h, const char *table, int first, size_t n)
{
    struct part *part = &h->read[h->n_read++];
    char sql[512];

    make_part(part, table, first, n);
    snprintf(
        sql, sizeof sql,
        "SELECT n.* FROM unnest($1::int4[]) AS v (id) CROSS JOIN LATERAL (SELECT seq, time, status, value"
        " FROM %s_newest WHERE id = v.id LIMIT 1) AS n",
        table);
    prepare(h, "read", table, sql);
    return part->values;
}

static struct value *add_write(struct hand *h, const char *table, size_t n, const char *more,
                               const char *arrays)
{
    struct part *part = &h->write[h->n_write++];
    char sql[512];

    make_part(part, table, 1, n);
    snprintf(sql, sizeof sql,
             "INSERT INTO %s (id, seq, time, status, value%s) SELECT * FROM"
             " unnest($1::int4[], $2::int8[], $3::timestamptz[], $4::int8[], $5::float8[]%s)",
             table, more, arrays);
    prepare(h, "write", table, sql);
    return part->values;
}

/* ---- Trips ----------------------------------------------------------------------------------- */

static PGresult *next_result(struct hand *h)
{
    PGresult *result = PQgetResult(h->conn);

    if (!result)
        die("%s", PQerrorMessage(h->conn));
    return tick_expect(h->conn, result);
}

static void take_rows(struct hand *h, struct part *part)
{
    PGresult *result = next_result(h);

    if ((size_t)PQntuples(result) != part->n)
        die("table %s: %d rows instead of %zu", part->table, PQntuples(result), part->n);
    for (size_t i = 0; i < part->n; i++)
        part->values[i] = (struct value){.seq = get_int8(result, (int)i, 0),
                                         .time = get_int8(result, (int)i, 1),
                                         .status = get_int8(result, (int)i, 2),
                                         .value = from_bits(get_int8(result, (int)i, 3))};
    PQclear(result);
    PQclear(PQgetResult(h->conn));
}

static void send(struct hand *h, const char *verb, const struct part *part, size_t n,
                 const char *const *values, const int *lengths)
{
    static const int binary[7] = {1, 1, 1, 1, 1, 1, 1};
    char name[64];

    snprintf(name, sizeof name, "%s_%s", verb, part->table);
    if (!PQsendQueryPrepared(h->conn, name, (int)n, values, lengths, binary, 1))
        die("%s", PQerrorMessage(h->conn));
}

static void read_all(struct hand *h)
{
    for (size_t i = 0; i < h->n_read; i++) {
        const char *const values[1] = {h->read[i].ids};
        const int lengths[1] = {(int)h->read[i].ids_length};
        send(h, "read", &h->read[i], 1, values, lengths);
    }
    PQpipelineSync(h->conn);
    for (size_t i = 0; i < h->n_read; i++)
        take_rows(h, &h->read[i]);
    PQclear(next_result(h));
}

static void send_rows(struct hand *h, struct part *part, int64_t time)
{
    static const uint32_t type[6] = {20, 1184, 20, 701, 20, 20};
    const bool actuator = part->values == h->u;
    const size_t columns = actuator ? 6 : 4;
    const char *values[7] = {part->ids};
    int lengths[7] = {(int)part->ids_length};
    char *at[6] = {0};

    for (size_t k = 0; k < columns; k++)
        at[k] = begin_array(h->columns[k], type[k], part->n);
    for (size_t i = 0; i < part->n; i++) {
        at[0] = add_int8(at[0], ++part->values[i].seq);
        at[1] = add_int8(at[1], time);
        at[2] = add_int8(at[2], 0);
        at[3] = add_int8(at[3], bits(part->values[i].value));
        if (actuator) {
            at[4] = add_int8(at[4], h->y[i].seq);
            at[5] = add_int8(at[5], h->z[i].seq);
        }
    }
    for (size_t k = 0; k < columns; k++) {
        values[k + 1] = h->columns[k];
        lengths[k + 1] = (int)(at[k] - h->columns[k]);
    }
    send(h, "write", part, columns + 1, values, lengths);
}

static void write_all(struct hand *h)
{
    const int64_t time = apc_clock_utc(NULL) / APC_NS_PER_US - PG_EPOCH_US;

    for (size_t i = 0; i < h->n_write; i++)
        send_rows(h, &h->write[i], time);
    PQpipelineSync(h->conn);
    for (size_t i = 0; i < h->n_write; i++) {
        PGresult *result = next_result(h);
        if (strtoul(PQcmdTuples(result), NULL, 10) != h->write[i].n)
            die("table %s: not all rows were written", h->write[i].table);
        PQclear(result);
        PQclear(PQgetResult(h->conn));
    }
    PQclear(next_result(h));
}

/* ---- The tick -------------------------------------------------------------------------------- */

struct hand *hand_open(const char *schema, size_t n, enum tick_rows rows)
{
    struct hand *h = allocate(1, sizeof *h);
    size_t most = rows == TICK_FULL ? 4 * n : n;
    char sql[128];

    h->conn = tick_connect(schema);
    h->n = n;
    h->integral = allocate(n, sizeof *h->integral);
    for (size_t k = 0; k < 6; k++)
        h->columns[k] = allocate(20 + 12 * most, 1);
    h->y = add_read(h, "sensor", 1, n);
    h->z = add_read(h, "setpoint", 1, n);
    h->mode = add_read(h, "opmode", 0, 1);
    h->tuning = add_read(h, "tuning", 1, rows == TICK_FULL ? n * apc_law_pi.n_tuning : TUNING);
    h->u = add_write(h, "actuator", n, ", sensor_seq, setpoint_seq", ", $6::int8[], $7::int8[]");
    if (rows == TICK_FULL) {
        add_read(h, "manual", 1, n);
        add_write(h, "state", 4 * n, "", "");
    }
    for (size_t i = 0; i < n; i++) {
        snprintf(sql, sizeof sql, "SELECT coalesce(max(seq), 0) FROM actuator WHERE id = %zu", i + 1);
        PGresult *result = tick_execute(h->conn, sql);
        h->u[i].seq = strtoll(PQgetvalue(result, 0, 0), NULL, 10);
        PQclear(result);
    }
    if (!PQenterPipelineMode(h->conn))
        die("%s", PQerrorMessage(h->conn));
    return h;
}

void hand_once(void *ctx)
{
    struct hand *h = ctx;

    read_all(h);
    if (h->mode->value != 1)
        die("the stored mode is not Auto");
    const double Kp = h->tuning[0].value, tau_i = h->tuning[1].value;
    for (size_t i = 0; i < h->n; i++)
        h->u[i].value = Kp * (h->z[i].value - h->y[i].value) + h->integral[i];
    for (size_t i = 0; h->n_write > 1 && i < 4 * h->n; i++) {
        const double state[4] = {h->integral[i % h->n], h->y[i % h->n].value, h->z[i % h->n].value,
                                 h->u[i % h->n].value};
        h->write[1].values[i].value = state[i / h->n];
    }
    write_all(h);
    for (size_t i = 0; i < h->n; i++)
        h->integral[i] += Kp * TS / tau_i * (h->z[i].value - h->y[i].value);
}

void hand_close(struct hand *h)
{
    PQfinish(h->conn);
    for (size_t i = 0; i < h->n_read; i++) {
        free(h->read[i].ids);
        free(h->read[i].values);
    }
    for (size_t i = 0; i < h->n_write; i++) {
        free(h->write[i].ids);
        free(h->write[i].values);
    }
    for (size_t k = 0; k < 6; k++)
        free(h->columns[k]);
    free(h->integral);
    free(h);
}

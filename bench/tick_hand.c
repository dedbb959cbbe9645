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

#define PARTS 6

struct hand {
    PGconn *conn;
    size_t n;
    struct part read[PARTS], write;
    size_t n_read;
    const struct value *mode, *tuning, *y, *z;
    struct value *u;
    double *integral;
    char *columns[5]; /* parameters: seq, time, status, value, origin */
    bool full;
    int64_t tick; /* seq of its row */
    size_t n_row;
    double *row;      /* [n_row] */
    char *row_column; /* parameter */
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

static void prepare_writes(struct hand *h)
{
    make_part(&h->write, "actuator", 1, h->n);
    h->u = h->write.values;
    prepare(h, "write", "actuator",
            h->full
                ? "INSERT INTO actuator (id, seq, time, status, value, origin) SELECT * FROM"
                  " unnest($1::int4[], $2::int8[], $3::timestamptz[], $4::int8[], $5::float8[], $6::int8[])"
                : "INSERT INTO actuator (id, seq, time, status, value) SELECT * FROM"
                  " unnest($1::int4[], $2::int8[], $3::timestamptz[], $4::int8[], $5::float8[])");
    if (h->full)
        prepare(h, "write", "tick",
                "INSERT INTO tick (id, seq, time, status, value)"
                " VALUES (1, $1::int8, $2::timestamptz, 0, $3::float8[])");
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

static void send(struct hand *h, const char *verb, const char *table, size_t n, const char *const *values,
                 const int *lengths)
{
    static const int binary[6] = {1, 1, 1, 1, 1, 1};
    char name[64];

    snprintf(name, sizeof name, "%s_%s", verb, table);
    if (!PQsendQueryPrepared(h->conn, name, (int)n, values, lengths, binary, 1))
        die("%s", PQerrorMessage(h->conn));
}

static void read_all(struct hand *h)
{
    for (size_t i = 0; i < h->n_read; i++) {
        const char *const values[1] = {h->read[i].ids};
        const int lengths[1] = {(int)h->read[i].ids_length};
        send(h, "read", h->read[i].table, 1, values, lengths);
    }
    PQpipelineSync(h->conn);
    for (size_t i = 0; i < h->n_read; i++)
        take_rows(h, &h->read[i]);
    PQclear(next_result(h));
}

static void send_outputs(struct hand *h, int64_t time)
{
    static const uint32_t type[5] = {20, 1184, 20, 701, 20};
    const size_t columns = h->full ? 5 : 4;
    const char *values[6] = {h->write.ids};
    int lengths[6] = {(int)h->write.ids_length};
    char *at[5] = {0};

    for (size_t k = 0; k < columns; k++)
        at[k] = begin_array(h->columns[k], type[k], h->n);
    for (size_t i = 0; i < h->n; i++) {
        at[0] = add_int8(at[0], ++h->u[i].seq);
        at[1] = add_int8(at[1], time);
        at[2] = add_int8(at[2], 0);
        at[3] = add_int8(at[3], bits(h->u[i].value));
        if (h->full)
            at[4] = add_int8(at[4], h->tick);
    }
    for (size_t k = 0; k < columns; k++) {
        values[k + 1] = h->columns[k];
        lengths[k + 1] = (int)(at[k] - h->columns[k]);
    }
    send(h, "write", "actuator", columns + 1, values, lengths);
}

static void send_tick(struct hand *h, int64_t time)
{
    const uint64_t head[2] = {htobe64((uint64_t)h->tick), htobe64((uint64_t)time)};
    char *end = begin_array(h->row_column, 701, h->n_row);

    for (size_t i = 0; i < h->n_row; i++)
        end = add_int8(end, bits(h->row[i]));
    const char *const values[3] = {(const char *)&head[0], (const char *)&head[1], h->row_column};
    const int lengths[3] = {8, 8, (int)(end - h->row_column)};
    send(h, "write", "tick", 3, values, lengths);
}

static void take_written(struct hand *h, size_t rows)
{
    PGresult *result = next_result(h);

    if (strtoul(PQcmdTuples(result), NULL, 10) != rows)
        die("not all rows were written");
    PQclear(result);
    PQclear(PQgetResult(h->conn));
}

static void write_all(struct hand *h)
{
    const int64_t time = apc_clock_utc(NULL) / APC_NS_PER_US - PG_EPOCH_US;

    h->tick++;
    send_outputs(h, time);
    if (h->full)
        send_tick(h, time);
    PQpipelineSync(h->conn);
    take_written(h, h->n);
    if (h->full)
        take_written(h, 1);
    PQclear(next_result(h));
}

/* ---- The tick -------------------------------------------------------------------------------- */

struct hand *hand_open(const char *schema, size_t n, enum tick_rows rows)
{
    struct hand *h = allocate(1, sizeof *h);
    char sql[128];

    h->conn = tick_connect(schema);
    h->n = n;
    h->full = rows == TICK_FULL;
    h->integral = allocate(n, sizeof *h->integral);
    h->n_row = control_row(n);
    h->row = allocate(h->n_row, sizeof *h->row);
    h->row_column = allocate(20 + 12 * h->n_row, 1);
    for (size_t k = 0; k < 5; k++)
        h->columns[k] = allocate(20 + 12 * n, 1);
    h->y = add_read(h, "sensor", 1, n);
    h->z = add_read(h, "setpoint", 1, n);
    h->mode = h->full ? add_read(h, "opmode", 1, n) : add_read(h, "opmode", 0, 1);
    h->tuning = add_read(h, "tuning", 1, h->full ? n * apc_law_pi.n_tuning : TUNING);
    if (h->full) {
        add_read(h, "manual", 1, n);
        add_read(h, "actuator", 1, n);
    }
    prepare_writes(h);
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
    for (size_t i = 0; i < h->n_row; i++)
        h->row[i] = i < h->n ? h->integral[i] : h->y[i % h->n].value;
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
    free(h->write.ids);
    free(h->write.values);
    for (size_t k = 0; k < 5; k++)
        free(h->columns[k]);
    free(h->row);
    free(h->row_column);
    free(h->integral);
    free(h);
}

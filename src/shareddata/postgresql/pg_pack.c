/* SPDX-License-Identifier: BSD-3-Clause */
/*
 * Packing old weeks. A week of a table is read in the order of its seqs, made chunks of, and dropped, in one
 * transaction: whoever looks, and whatever ends it, finds the rows or the chunks. Nobody waits for it but at
 * its end, for as long as the partition takes to go. What is written to the week meanwhile makes it fail, and
 * the week stays as it was (sql/0001-baseline.sql). Seqs that follow each other in too small a number
 * stay rows. Small chunks that a historian wrote (pg_chunks.c) are read in the place of rows, and become
 * chunks whatever their number.
 */
#include <inttypes.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "shareddata/pack.h"
#include "shareddata/postgresql/postgresql.h"

#define PATIENCE 300 /* timeouts: a week is sorted by the server before its first row comes */
#define FEW      8   /* samples that follow each other are not worth a chunk if they are fewer */
enum { FETCH = 4096, CELLS = 2 + APC_PACK_COLUMNS };

struct week {
    char target[16], partition[64];
    bool open; /* it is a table of small chunks */
};

/* A small chunk: its bytes among those of its batch. */
struct small {
    size_t at, length;
};

struct run {
    int32_t id;
    int64_t first, last;
};

struct packer {
    struct apc_pg *pg;
    struct week week;
    struct apc_pack chunk; /* that is being filled; n 0: none */
    int32_t id;            /* of the chunk */
    size_t rows;           /* of the batch at hand */
    int64_t (*row)[CELLS]; /* [FETCH]: id, seq, and what a chunk has */
    bool *odd;             /* [FETCH]: a reference that is there and 0, which a chunk cannot tell from none */
    struct small *small;   /* [FETCH]: what stands in the place of rows where the week is open */
    struct run *stays;     /* rows */
    size_t n_stays, room;
    int queued;                             /* statements of chunks that were sent and not answered */
    int64_t samples, bytes, before, stayed; /* bytes: of the chunks, and of the week as it was */
    struct apc_pack small_chunk;
    uint8_t data[APC_PACK_BYTES];
    uint8_t *held; /* bytes of the small chunks of the batch at hand */
    size_t n_held, room_held;
};

/* ---- Chunks on their way in ----------------------------------------------------------------- */

static int stay(struct packer *p)
{
    if (p->n_stays == p->room) {
        const size_t room = p->room ? 2 * p->room : 64;
        struct run *more = (struct run *)realloc(p->stays, room * sizeof *more);
        if (!more) {
            return apc_fail(&p->pg->base.why, APC_ENOMEM, "out of memory for %zu runs of rows", room);
        }
        p->stays = more;
        p->room = room;
    }
    p->stays[p->n_stays++] = (struct run){p->id, p->chunk.first, p->chunk.first + (int64_t)p->chunk.n - 1};
    return 0;
}

static int insert_chunk(struct packer *p, size_t length)
{
    struct apc_pack_summary s;
    apc_pack_summarize(&p->chunk, &s);
    const int64_t number[12] = {p->chunk.first,
                                p->chunk.first + (int64_t)p->chunk.n - 1,
                                s.since,
                                s.until,
                                s.final,
                                s.worst,
                                apc_pack_bits(s.lowest),
                                apc_pack_bits(s.highest),
                                apc_pack_bits(s.mean),
                                apc_pack_bits(s.last),
                                p->id,
                                s.good};
    char sql[400], bytes[12][8];
    struct apc_pg_params params = {0};
    for (size_t i = 0; i < 12; i++) {
        apc_pg_put_int8(bytes[i], number[i]);
        apc_pg_param(&params, bytes[i], 8);
    }
    apc_pg_param(&params, (const char *)p->data, length);
    snprintf(
        sql, sizeof sql,
        "INSERT INTO %s_packed (first, last, since, until, final, worst, lowest, highest, mean, latest, id, "
        "good, data) VALUES ($1::int8, $2::int8, $3::timestamptz, $4::timestamptz, $5::int8, $6::int8, "
        "$7::float8, $8::float8, $9::float8, $10::float8, $11::int8, $12::int8, $13)",
        p->week.target);
    p->bytes += (int64_t)length;
    p->queued++;
    return apc_pg_send(p->pg, sql, &params);
}

static int end_chunk(struct packer *p)
{
    const size_t n = p->chunk.n, length = n >= FEW || p->week.open ? apc_pack(&p->chunk, p->data) : 0;
    int err = 0;
    if (n > 0 && length == 0 && p->week.open) {
        err = apc_fail(&p->pg->base.why, APC_ECONFLICT, "samples of it that no chunk can hold");
    } else if (n > 0) {
        err = length > 0 ? insert_chunk(p, length) : stay(p);
        p->samples += length > 0 ? (int64_t)n : 0;
    }
    p->chunk.n = 0;
    return err;
}

static int take_packer_row(struct packer *p, const int64_t row[CELLS], bool odd)
{
    struct apc_pack *c = &p->chunk;
    int err = 0;
    if (c->n == APC_PACK_MAX || row[0] != p->id || row[1] != c->first + (int64_t)c->n || odd) {
        err = end_chunk(p);
    }
    if (c->n == 0) {
        p->id = (int32_t)row[0];
        c->first = row[1];
    }
    for (size_t k = 0; k < APC_PACK_COLUMNS; k++) {
        c->at[k][c->n] = row[2 + k];
    }
    c->n++;
    if (!err && odd) {
        err = stay(p);
        c->n = 0;
    }
    return err;
}

/* The samples of a small chunk, one after the other. */
static int take_small(struct packer *p, size_t i)
{
    struct apc_pack *c = &p->small_chunk;
    int64_t row[CELLS] = {p->row[i][0], p->row[i][1]};
    if (apc_unpack(p->held + p->small[i].at, p->small[i].length, c) != 0) {
        return apc_fail(&p->pg->base.why, APC_ECONFLICT, "a chunk of variable %d in it is damaged",
                        (int)row[0]);
    }
    int err = 0;
    for (size_t k = 0; k < c->n && !err; k++, row[1]++) {
        for (size_t column = 0; column < APC_PACK_COLUMNS; column++) {
            row[2 + column] = c->at[column][k];
        }
        err = take_packer_row(p, row, false);
    }
    return err;
}

/* ---- Rows on their way out ------------------------------------------------------------------ */

struct batch {
    struct packer *packer;
    int fetch; /* number of the FETCH among the statements sent */
};

static int keep_small(struct packer *p, size_t i, const PGresult *result)
{
    const size_t length = (size_t)PQgetlength(result, (int)i, 2), need = p->n_held + length;
    if (need > p->room_held || !p->held) {
        uint8_t *bytes = (uint8_t *)realloc(p->held, 2 * need + 1);
        if (!bytes) {
            return apc_fail(&p->pg->base.why, APC_ENOMEM, "out of memory for %zu bytes of chunks", need);
        }
        p->held = bytes;
        p->room_held = 2 * need + 1;
    }
    memcpy(p->held + p->n_held, PQgetvalue(result, (int)i, 2), length);
    p->small[i] = (struct small){p->n_held, length};
    p->n_held = need;
    return 0;
}

static int take_packer_batch(void *ctx, int statement, PGresult *result)
{
    struct batch *b = (struct batch *)ctx;
    struct packer *p = b->packer;
    if (statement != b->fetch) {
        return 0;
    }
    const int cells = p->week.open ? 2 : CELLS;
    if (PQnfields(result) != (p->week.open ? 3 : CELLS) || PQntuples(result) > FETCH) {
        return apc_fail(&p->pg->base.why, APC_EPROTO, "the database did not answer what was asked");
    }
    int err = 0;
    p->n_held = 0;
    p->rows = (size_t)PQntuples(result);
    for (size_t i = 0; i < p->rows && !err; i++) {
        p->odd[i] = false;
        for (int c = 0; c < cells; c++) {
            p->row[i][c] = apc_pg_cell(result, (int)i, c); /* a double's bits; NULL is 0 */
            p->odd[i] |= c >= 2 + APC_PACK_ORIGIN && p->row[i][c] == 0 && !PQgetisnull(result, (int)i, c);
        }
        err = p->week.open ? keep_small(p, i, result) : 0;
    }
    return err;
}

/* What was queued goes along. */
static int fetch_packer_rows(struct packer *p)
{
    struct batch b = {p, p->queued};
    p->queued = 0;
    p->pg->deadline = apc_clock_mono(NULL) + PATIENCE * p->pg->base.config.timeout;
    int err = apc_pg_send(p->pg, "FETCH FORWARD 4096 FROM rows", &(struct apc_pg_params){0});
    return err ? err : apc_pg_finish(p->pg, take_packer_batch, &b);
}

static int take_size(void *ctx, int statement, PGresult *result)
{
    struct packer *p = (struct packer *)ctx;
    if (statement == 3 && PQntuples(result) == 1) {
        p->before = apc_pg_cell(result, 0, 0);
    }
    return 0;
}

static int begin_week(struct packer *p)
{
    struct apc_pg_params none = {0}, name = {0};
    char rows[400];
    const bool actuator = strcmp(p->week.target, "actuator") == 0;
    apc_pg_param_text(&name, p->week.partition);
    snprintf(rows, sizeof rows, "DECLARE rows NO SCROLL CURSOR FOR SELECT id::int8, %s FROM %s ORDER BY 1, 2",
             p->week.open ? "first, data"
             : actuator   ? "seq, time, status, value, origin, author, sensor_seq, setpoint_seq"
                          : "seq, time, status, value, origin, author, NULL::int8, NULL::int8",
             p->week.partition);
    p->pg->deadline = apc_clock_mono(NULL) + PATIENCE * p->pg->base.config.timeout;
    int err = apc_pg_send(p->pg, "SELECT pack_begin($1)", &name);
    err = err ? err : apc_pg_finish(p->pg, NULL, NULL);
    err = err ? err : apc_pg_send(p->pg, "BEGIN", &none);
    err = err ? err : apc_pg_send(p->pg, "SET LOCAL work_mem TO '128MB'", &none);
    err = err ? err : apc_pg_send(p->pg, "SELECT pack_lock($1, 'SHARE UPDATE EXCLUSIVE')", &name);
    err = err ? err : apc_pg_send(p->pg, "SELECT pg_total_relation_size($1::regclass)", &name);
    err = err ? err : apc_pg_send(p->pg, rows, &none);
    return err ? err : apc_pg_finish(p->pg, take_size, p);
}

static int pack_rows(struct packer *p)
{
    int err = fetch_packer_rows(p);
    while (!err && p->rows > 0) {
        for (size_t i = 0; i < p->rows && !err; i++) {
            err = p->week.open ? take_small(p, i) : take_packer_row(p, p->row[i], p->odd[i]);
        }
        err = err ? err : fetch_packer_rows(p);
    }
    return err ? err : end_chunk(p);
}

static int take_stayed(void *ctx, int statement, PGresult *result)
{
    struct packer *p = (struct packer *)ctx;
    (void)statement;
    if (PQntuples(result) == 1 && PQnfields(result) == 1) {
        p->stayed = apc_pg_cell(result, 0, 0);
    }
    return 0;
}

static int end_week(struct packer *p)
{
    struct apc_pg *pg = p->pg;
    struct apc_pg_params params = {0};
    struct apc_pg_array *ids = &pg->columns[0], *firsts = &pg->columns[1], *lasts = &pg->columns[2];
    if (apc_pg_array_begin(ids, APC_PG_INT4, p->n_stays) != 0 ||
        apc_pg_array_begin(firsts, APC_PG_INT8, p->n_stays) != 0 ||
        apc_pg_array_begin(lasts, APC_PG_INT8, p->n_stays) != 0) {
        return apc_fail(&pg->base.why, APC_ENOMEM, "out of memory for %zu runs of rows", p->n_stays);
    }
    for (size_t i = 0; i < p->n_stays; i++) {
        apc_pg_array_int4(ids, p->stays[i].id);
        apc_pg_array_int8(firsts, p->stays[i].first);
        apc_pg_array_int8(lasts, p->stays[i].last);
    }
    apc_pg_param_text(&params, p->week.target);
    apc_pg_param_text(&params, p->week.partition);
    apc_pg_param(&params, ids->data, ids->length);
    apc_pg_param(&params, firsts->data, firsts->length);
    apc_pg_param(&params, lasts->data, lasts->length);
    int err = apc_pg_send(pg, "CLOSE rows", &(struct apc_pg_params){0});
    err = err ? err : apc_pg_send(pg, "SELECT pack_end($1, $2, $3::int4[], $4::int8[], $5::int8[])", &params);
    return err ? err : apc_pg_finish(pg, take_stayed, p);
}

static int say_packing(struct apc_pg *pg, const char *severity, const char *text)
{
    struct apc_pg_params params = {0};
    apc_pg_param_text(&params, severity);
    apc_pg_param_text(&params, text);
    return apc_pg_send(pg,
                       "INSERT INTO event (time, severity, source, kind, text) VALUES (now(), $1::int2, "
                       "'apc maintain', 'store', $2)",
                       &params);
}

static int commit_week(struct packer *p)
{
    char text[256]; /* of which 191 bytes are used, unless numbers are absurd */
    snprintf(text, sizeof text,
             "%s packed: %" PRId64 " samples in %" PRId64 " kB are %" PRId64 " kB now, %" PRId64
             " rows stayed",
             p->week.partition, p->samples, p->before / 1000, p->bytes / 1000, p->stayed);
    int err = say_packing(p->pg, "1", text);
    err = err ? err : apc_pg_send(p->pg, "COMMIT", &(struct apc_pg_params){0});
    return err ? err : apc_pg_finish(p->pg, NULL, NULL);
}

/* Whatever went wrong, the week is as it was, and the connection of use if there is one. */
static void roll_back(struct apc_pg *pg)
{
    const struct apc_error why = pg->base.why;
    if (pg->conn && apc_pg_send(pg, "ROLLBACK", &(struct apc_pg_params){0}) == 0) {
        apc_pg_finish(pg, NULL, NULL);
    }
    pg->base.why = why;
}

static int pack_week(struct packer *p)
{
    int err = begin_week(p);
    err = err ? err : pack_rows(p);
    err = err ? err : end_week(p);
    err = err ? err : commit_week(p);
    if (err) {
        roll_back(p->pg);
    }
    return err;
}

/* ---- Weeks ---------------------------------------------------------------------------------- */

struct weeks {
    struct apc_pg *pg;
    struct week *week; /* to be freed */
    size_t n;
};

static int take_weeks(void *ctx, int statement, PGresult *result)
{
    struct weeks *w = (struct weeks *)ctx;
    (void)statement;
    const size_t n = (size_t)PQntuples(result);
    w->week = (struct week *)calloc(n + 1, sizeof *w->week);
    if (!w->week) {
        return apc_fail(&w->pg->base.why, APC_ENOMEM, "out of memory for %zu weeks", n);
    }
    for (w->n = 0; w->n < n; w->n++) { /* names that the statement has looked at */
        struct week *week = &w->week[w->n];
        snprintf(week->target, sizeof week->target, "%s", PQgetvalue(result, (int)w->n, 0));
        snprintf(week->partition, sizeof week->partition, "%s", PQgetvalue(result, (int)w->n, 1));
        week->open = strstr(week->partition, "_open_") != NULL;
    }
    return 0;
}

static int list_weeks(struct weeks *w, apc_ns before)
{
    struct apc_pg_params params = {0};
    char bytes[8];
    apc_pg_put_int8(bytes, apc_pg_time(before));
    apc_pg_param(&params, bytes, 8);
    int err = apc_pg_send(
        w->pg,
        "SELECT * FROM (SELECT target, partition FROM packable($1::timestamptz) UNION ALL "
        "SELECT t, c.relname::text FROM unnest(ARRAY['sensor', 'actuator', 'actual', 'estimate']) AS t "
        "JOIN pg_inherits ON inhparent = to_regclass(t || '_packed') JOIN pg_class AS c ON c.oid = inhrelid "
        "WHERE CASE WHEN c.relname ~ format('^%s_open_[0-9]{8}$', t) THEN (to_date(right(c.relname, 8), "
        "'YYYYMMDD') + 7)::timestamp AT TIME ZONE 'UTC' <= $1::timestamptz END) AS w "
        "ORDER BY right(partition, 8), partition",
        &params);
    return err ? err : apc_pg_finish(w->pg, take_weeks, w);
}

/* A week that cannot be packed now is told of, and the others are tried. */
static int pack_or_say(struct apc_pg *pg, const struct week *week)
{
    struct packer *p = (struct packer *)calloc(1, sizeof *p);
    int err = APC_ENOMEM;
    if (p) {
        *p = (struct packer){.pg = pg, .week = *week};
        p->row = (int64_t(*)[CELLS])calloc(FETCH, sizeof *p->row);
        p->odd = (bool *)calloc(FETCH, sizeof *p->odd);
        p->small = (struct small *)calloc(FETCH, sizeof *p->small);
    }
    if (p && p->row && p->odd && p->small) {
        err = pack_week(p);
    } else {
        apc_fail(&pg->base.why, err, "out of memory for a chunk of samples");
    }
    if (err == APC_ECONFLICT) {
        char text[192];
        snprintf(text, sizeof text, "%s is not packed: %.100s", week->partition, pg->base.why.text);
        err = say_packing(pg, "2", text);
        err = err ? err : apc_pg_finish(pg, NULL, NULL);
    } else if (!err) {
        err = 1;
    }
    if (p) {
        free(p->row);
        free(p->odd);
        free(p->small);
        free(p->held);
        free(p->stays);
    }
    free(p);
    return err;
}

int apc_pg_pack(struct apc_pg *pg, apc_ns before)
{
    struct weeks w = {.pg = pg};
    int packed = 0, err = apc_pg_begin(pg);
    err = err ? err : apc_pg_has_chunks(pg);
    if (err == 0) {
        return apc_fail(&pg->base.why, APC_ESCHEMA, "schema %s has no tables for packed weeks: run apc init",
                        pg->schema);
    }
    err = err < 0 ? err : list_weeks(&w, before);
    for (size_t i = 0; i < w.n && err >= 0; i++) {
        pg->deadline = apc_clock_mono(NULL) + pg->base.config.timeout;
        err = pack_or_say(pg, &w.week[i]);
        packed += err > 0;
    }
    free(w.week);
    return err < 0 ? err : packed;
}

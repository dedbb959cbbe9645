/* SPDX-License-Identifier: BSD-3-Clause */
/*
 * The PostgreSQL store: an append of chunks. Where many rows of a variable come at once, they cost the server
 * a third of what they do as rows when they are one chunk, whose row, place in the key and newest value they
 * share (sql/0001-baseline.sql). Packing makes large chunks of them when their week is over.
 */
#include <stdlib.h>
#include <string.h>

#include "shareddata/pack.h"
#include "shareddata/postgresql/postgresql.h"

enum {
    ID,
    FIRST,
    LAST,
    SINCE,
    UNTIL,
    FINAL,
    WORST,
    LOWEST,
    HIGHEST,
    MEAN,
    LATEST,
    GOOD,
    START,
    LENGTH,
    TIME,
    STATUS,
    VALUE,
    ORIGIN,
    COLUMNS
};

struct apc_pg_chunks {
    struct apc_pg_array column[COLUMNS];
    char *data; /* of all, one after another; kept, as the columns are */
    size_t length, capacity;
    struct apc_pack chunk;
    uint8_t bytes[APC_PACK_BYTES];
};

void apc_pg_free_chunks(struct apc_pg_chunks *c)
{
    for (size_t i = 0; c && i < COLUMNS; i++) {
        free(c->column[i].data);
    }
    free(c ? c->data : NULL);
    free(c);
}

static int begin_chunks(struct apc_pg *pg, size_t chunks)
{
    static const uint32_t oid[COLUMNS] = {
        [ID] = APC_PG_INT4,       [SINCE] = APC_PG_TIMESTAMPTZ, [UNTIL] = APC_PG_TIMESTAMPTZ,
        [LOWEST] = APC_PG_FLOAT8, [HIGHEST] = APC_PG_FLOAT8,    [MEAN] = APC_PG_FLOAT8,
        [LATEST] = APC_PG_FLOAT8, [GOOD] = APC_PG_INT4,         [START] = APC_PG_INT4,
        [LENGTH] = APC_PG_INT4,   [TIME] = APC_PG_TIMESTAMPTZ,  [VALUE] = APC_PG_FLOAT8};
    if (!pg->chunks) {
        pg->chunks = (struct apc_pg_chunks *)calloc(1, sizeof *pg->chunks);
    }
    bool room = pg->chunks != NULL;
    for (size_t i = 0; room && i < COLUMNS; i++) {
        room = apc_pg_array_begin(&pg->chunks->column[i], oid[i] ? oid[i] : APC_PG_INT8, chunks) == 0;
    }
    if (!room) {
        return apc_fail(&pg->base.why, APC_ENOMEM, "out of memory for %zu chunks", chunks);
    }
    pg->chunks->length = 0;
    return 0;
}

/* 1: no chunk can hold these, so they go as rows; else 0 or an error. */
static int add_bytes(struct apc_pg *pg)
{
    struct apc_pg_chunks *c = pg->chunks;
    const size_t n = apc_pack(&c->chunk, c->bytes);
    if (n == 0) {
        return 1;
    }
    if (c->length + n > c->capacity) {
        const size_t capacity = 2 * (c->length + n);
        char *data = (char *)realloc(c->data, capacity);
        if (!data) {
            return apc_fail(&pg->base.why, APC_ENOMEM, "out of memory for %zu bytes of chunks", capacity);
        }
        c->data = data;
        c->capacity = capacity;
    }
    memcpy(c->data + c->length, c->bytes, n);
    apc_pg_array_int4(&c->column[START], (int32_t)c->length + 1);
    apc_pg_array_int4(&c->column[LENGTH], (int32_t)n);
    c->length += n;
    return 0;
}

static void add_summary(struct apc_pg_chunks *c, int id)
{
    struct apc_pack_summary s;
    apc_pack_summarize(&c->chunk, &s);
    apc_pg_array_int4(&c->column[ID], id);
    apc_pg_array_int8(&c->column[FIRST], c->chunk.first);
    apc_pg_array_int8(&c->column[LAST], c->chunk.first + (int64_t)c->chunk.n - 1);
    apc_pg_array_int8(&c->column[SINCE], s.since);
    apc_pg_array_int8(&c->column[UNTIL], s.until);
    apc_pg_array_int8(&c->column[FINAL], s.final);
    apc_pg_array_int8(&c->column[WORST], s.worst);
    apc_pg_array_float8(&c->column[LOWEST], s.lowest);
    apc_pg_array_float8(&c->column[HIGHEST], s.highest);
    apc_pg_array_float8(&c->column[MEAN], s.mean);
    apc_pg_array_float8(&c->column[LATEST], s.last);
    apc_pg_array_int4(&c->column[GOOD], (int32_t)s.good);
}

static void add_last(struct apc_pg_chunks *c)
{
    const size_t last = c->chunk.n - 1;
    const int64_t origin = c->chunk.at[APC_PACK_ORIGIN][last];
    apc_pg_array_int8(&c->column[TIME], c->chunk.at[APC_PACK_TIME][last]);
    apc_pg_array_int8(&c->column[STATUS], c->chunk.at[APC_PACK_STATUS][last]);
    apc_pg_array_float8(&c->column[VALUE], apc_pack_value(c->chunk.at[APC_PACK_VALUE][last]));
    if (origin > 0) {
        apc_pg_array_int8(&c->column[ORIGIN], origin);
    } else {
        apc_pg_array_null(&c->column[ORIGIN]);
    }
}

static int add_chunk(struct apc_pg *pg, const struct apc_sample *sample, const struct apc_pg_place *place,
                     size_t n)
{
    struct apc_pack *p = &pg->chunks->chunk;
    p->n = n;
    p->first = sample[place->row].seq;
    for (size_t i = 0; i < n; i++) {
        const struct apc_sample *s = &sample[place[i].row];
        p->at[APC_PACK_TIME][i] = apc_pg_time(s->time);
        p->at[APC_PACK_STATUS][i] = s->status;
        p->at[APC_PACK_VALUE][i] = apc_pack_bits(s->value);
        p->at[APC_PACK_ORIGIN][i] = s->origin > 0 ? s->origin : 0;
        p->at[APC_PACK_AUTHOR][i] = p->at[APC_PACK_SENSOR_SEQ][i] = p->at[APC_PACK_SETPOINT_SEQ][i] = 0;
    }
    const int err = add_bytes(pg);
    if (!err) {
        add_summary(pg->chunks, sample[place->row].id);
        add_last(pg->chunks);
    }
    return err;
}

/* How many of the places from here on are of one variable. */
static size_t of_one(const struct apc_sample *sample, const struct apc_pg_place *place, size_t n)
{
    size_t i = 1;
    while (i < n && sample[place[i].row].id == sample[place->row].id) {
        i++;
    }
    return i;
}

bool apc_pg_chunkable(const struct apc_sample *sample, const struct apc_pg_place *place, size_t n)
{
    for (size_t i = 0; i < n; i++) {
        const struct apc_sample *s = &sample[place[i].row];
        if (s->author > 0 || s->seq != sample[place->row].seq + (int64_t)i) {
            return false;
        }
    }
    return n >= APC_PACK_OPEN && n <= APC_PACK_MAX;
}

int apc_pg_send_chunks(struct apc_pg *pg, enum apc_table table, const struct apc_sample *sample,
                       const struct apc_pg_place *place, size_t n)
{
    size_t chunks = 0, length;
    for (size_t i = 0; i < n; i += of_one(sample, place + i, n - i)) {
        chunks++;
    }
    int err = begin_chunks(pg, chunks);
    for (size_t i = 0; i < n && !err; i += length) {
        length = of_one(sample, place + i, n - i);
        err = add_chunk(pg, sample, place + i, length);
    }
    if (err) {
        return err > 0 ? apc_fail(&pg->base.why, APC_ECONFLICT, "samples that no chunk can hold") : err;
    }
    struct apc_pg_params p = {0};
    apc_pg_param_text(&p, apc_table_name(table));
    for (size_t i = 0; i < COLUMNS; i++) {
        if (i == TIME) {
            apc_pg_param(&p, pg->chunks->data, pg->chunks->length);
        }
        apc_pg_param(&p, pg->chunks->column[i].data, pg->chunks->column[i].length);
    }
    return apc_pg_send(pg,
                       "SELECT append_chunks($1, $2::int4[], $3::int8[], $4::int8[], $5::timestamptz[], "
                       "$6::timestamptz[], $7::int8[], $8::int8[], $9::float8[], $10::float8[], "
                       "$11::float8[], $12::float8[], $13::int4[], $14::int4[], $15::int4[], $16::bytea, "
                       "$17::timestamptz[], $18::int8[], $19::float8[], $20::int8[])",
                       &p);
}

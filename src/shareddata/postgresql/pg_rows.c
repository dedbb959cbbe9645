/* SPDX-License-Identifier: BSD-3-Clause */
/*
 * The PostgreSQL store outside the tick: events, timing, tags, and the streams of all rows. They come through
 * a cursor, some at a time, so that memory stays bounded however long the history is and the caller may stop
 * early.
 */
#include <endian.h>
#include <limits.h>
#include <stdlib.h>
#include <string.h>

#include "base/text.h"
#include "shareddata/postgresql/postgresql.h"

/* ---- Streams ------------------------------------------------------------------------------- */

#define BATCH      512
#define FETCH_ROWS "FETCH FORWARD 512 FROM rows"
#define FETCH_ALL  "FETCH ALL FROM rows"

static int take_result_batch(void *ctx, int statement, PGresult *result)
{
    struct apc_pg_stream *s = (struct apc_pg_stream *)ctx;
    if (statement != s->fetch || s->ended) {
        return 0;
    }
    if (PQnfields(result) != s->columns) {
        return apc_fail(&s->pg->base.why, APC_EPROTO, "the database did not answer what was asked");
    }
    int err = 0;
    s->pg->base.streaming = true;
    for (int row = 0; !err && row < PQntuples(result); row++) {
        err = s->row(s, result, row);
        s->count += err >= 0 && s->count < INT_MAX;
    }
    s->pg->base.streaming = false;
    s->ended = err != 0 || (PQresultStatus(result) == PGRES_TUPLES_OK && PQntuples(result) < BATCH);
    /* The caller's own time is not the server's. */
    s->pg->deadline = apc_clock_mono(NULL) + s->pg->base.config.timeout;
    return err < 0 ? err : 0;
}

int apc_pg_stream(struct apc_pg_stream *s, const char *declare, const struct apc_pg_params *p)
{
    struct apc_pg *pg = s->pg;
    int err = apc_pg_begin(pg);
    if (!err) {
        err = apc_pg_send(pg, "BEGIN READ ONLY", &(struct apc_pg_params){0});
    }
    if (!err) {
        err = apc_pg_send(pg, declare, p);
    }
    for (s->fetch = 2; !err && !s->ended; s->fetch = 0) {
        err = apc_pg_send(pg, s->large ? FETCH_ALL : FETCH_ROWS, &(struct apc_pg_params){0});
        if (!err) {
            err = apc_pg_finish_by_rows(pg, s->large ? s->fetch : -1, take_result_batch, s);
        }
    }
    if (pg->conn) {
        struct apc_error why = pg->base.why;
        if (apc_pg_send(pg, "ROLLBACK", &(struct apc_pg_params){0}) == 0) {
            apc_pg_finish(pg, NULL, NULL); /* on failure the connection is closed, which does as well */
        }
        pg->base.why = why;
    }
    return err ? err : s->count;
}

/* Stored times are whole microseconds: t >= bound is the same as t >= the next whole one. */
static void add_bound(struct apc_pg_params *p, char bytes[8], apc_ns bound, int64_t none)
{
    int64_t pg = bound == 0 || bound > INT64_MAX - 999 ? none : apc_pg_time(bound + 999);
    apc_pg_put_int8(bytes, pg);
    apc_pg_param(p, bytes, 8);
}

/* since, until, after and, when asked for, how many. INT64_MIN and MAX are PostgreSQL's -infinity and
 * infinity. */
void apc_pg_add_range(struct apc_pg_params *p, struct apc_pg_bounds *b, const struct apc_range *range)
{
    add_bound(p, b->since, range->since, INT64_MIN);
    add_bound(p, b->until, range->until, INT64_MAX);
    apc_pg_put_int8(b->after, range->after);
    apc_pg_param(p, b->after, 8);
    if (range->last > 0) {
        apc_pg_put_int8(b->last, (int64_t)range->last);
        apc_pg_param(p, b->last, 8);
    }
}

double apc_pg_cell_double(const PGresult *result, int row, int column)
{
    return PQgetlength(result, row, column) == 8 ? apc_pg_get_float8(PQgetvalue(result, row, column)) : 0.0;
}

/* The tables' CHECKs see to it that it fits. */
static void record_cell_text(const PGresult *result, int row, int column, char *out, size_t size)
{
    size_t length = (size_t)PQgetlength(result, row, column);
    length = length < size ? length : size - 1;
    memcpy(out, PQgetvalue(result, row, column), length);
    out[length] = '\0';
}

/* ---- Variables ------------------------------------------------------------------------------ */

/* The tables' numbers are those of enum apc_table. */
#define OF(table, number) "SELECT " number "::int8, id::int8 FROM " table "_newest WHERE seq > 0 UNION ALL "
static const char variables_sql[] =
    OF("sensor", "1") OF("actuator", "2") OF("setpoint", "3") OF("dim", "4") OF("opmode", "5")
        OF("tuning", "6") OF("manual", "7") OF("actual", "9") OF("estimate", "10") OF("alarm", "11")
            OF("tick", "12") OF("plan", "13") "SELECT 14, id FROM prediction_newest ORDER BY 1, 2";

struct variable_list {
    struct apc_pg *pg;
    struct apc_sample *variables;
    size_t capacity;
    int count;
};

static int take_variables(void *ctx, int statement, PGresult *result)
{
    struct variable_list *list = (struct variable_list *)ctx;
    (void)statement;
    if (PQnfields(result) != 2) {
        return apc_fail(&list->pg->base.why, APC_EPROTO, "the database did not answer what was asked");
    }
    list->count = PQntuples(result);
    for (int row = 0; row < list->count && (size_t)row < list->capacity; row++) {
        list->variables[row] = (struct apc_sample){.table = (enum apc_table)apc_pg_cell(result, row, 0),
                                                   .id = (int)apc_pg_cell(result, row, 1)};
    }
    return 0;
}

int apc_pg_variables(struct apc_store *store, struct apc_sample *variables, size_t capacity)
{
    struct variable_list list = {.pg = apc_pg_of(store), .variables = variables, .capacity = capacity};
    int err = apc_pg_begin(list.pg);
    if (!err) {
        err = apc_pg_send(list.pg, variables_sql, &(struct apc_pg_params){0});
    }
    if (!err) {
        err = apc_pg_finish(list.pg, take_variables, &list);
    }
    return err ? err : list.count;
}

/* ---- Rows on their way in --------------------------------------------------------------------- */

static void add_int8(struct apc_pg_params *p, char (*bytes)[8], int64_t value)
{
    apc_pg_put_int8(bytes[p->n], value);
    apc_pg_param(p, bytes[p->n], 8);
}

static void add_float8(struct apc_pg_params *p, char (*bytes)[8], double value)
{
    apc_pg_put_float8(bytes[p->n], value);
    apc_pg_param(p, bytes[p->n], 8);
}

/* Sends what was queued. A constraint that says no is no race here. */
int apc_pg_finish_insert(struct apc_pg *pg, int err, int count)
{
    if (!err) {
        err = apc_pg_finish(pg, NULL, NULL);
    } else {
        apc_pg_drop(pg);
    }
    if (!err && pg->unreplicated) {
        err =
            apc_fail(&pg->base.why, APC_ETIMEDOUT, "committed on this server, but maybe not on its standby");
    }
    return err == APC_ECONFLICT ? APC_ESTORE : err ? err : count;
}

/* A record that is refused for what it says is so for good: whoever waits with it should know. */
static int finish_records(struct apc_pg *pg, int err, int count)
{
    pg->violated = false;
    err = apc_pg_finish_insert(pg, err, count);
    return err == APC_ESTORE && pg->violated ? APC_ERANGE : err;
}

/* ---- Events -------------------------------------------------------------------------------- */

#define EVENTS "SELECT time, severity::int8, source, kind, text, id"
#define WITHIN " WHERE time >= $1::timestamptz AND time < $2::timestamptz AND id > $3::int8 "

int apc_pg_append_events(struct apc_store *store, const struct apc_event *events, size_t n)
{
    struct apc_pg *pg = apc_pg_of(store);
    int err = apc_pg_begin(pg);
    for (size_t i = 0; !err && i < n; i++) {
        const struct apc_event *e = &events[i];
        struct apc_pg_params p = {0};
        char numbers[16][8], source[sizeof e->source], kind[sizeof e->kind], text[sizeof e->text];
        add_int8(&p, numbers, apc_pg_time(e->time));
        add_int8(&p, numbers, (int64_t)e->severity);
        apc_pg_param_text(&p, text_clean(source, e->source, sizeof source));
        apc_pg_param_text(&p, text_clean(kind, e->kind, sizeof kind));
        apc_pg_param_text(&p, text_clean(text, e->text, sizeof text));
        err = apc_pg_send(pg,
                          "INSERT INTO event (time, severity, source, kind, text) "
                          "VALUES ($1::timestamptz, $2::int8, $3, $4, $5)",
                          &p);
    }
    return finish_records(pg, err, (int)n);
}

static int pg_give_event(struct apc_pg_stream *s, const PGresult *result, int row)
{
    struct apc_event e = {.time = apc_pg_time_ns(apc_pg_cell(result, row, 0)),
                          .severity = (enum apc_event_severity)apc_pg_cell(result, row, 1),
                          .number = apc_pg_cell(result, row, 5)};
    record_cell_text(result, row, 2, e.source, sizeof e.source);
    record_cell_text(result, row, 3, e.kind, sizeof e.kind);
    record_cell_text(result, row, 4, e.text, sizeof e.text);
    return s->fn.event(s->ctx, &e) != 0;
}

int apc_pg_events(struct apc_store *store, const struct apc_range *range, apc_event_fn fn, void *ctx)
{
    struct apc_pg_stream s = {
        .pg = apc_pg_of(store), .row = pg_give_event, .columns = 6, .fn.event = fn, .ctx = ctx};
    struct apc_pg_params p = {0};
    struct apc_pg_bounds b;
    apc_pg_add_range(&p, &b, range);
    return apc_pg_stream(&s,
                         range->last > 0
                             ? "DECLARE rows NO SCROLL CURSOR FOR " EVENTS " FROM (SELECT * FROM event" WITHIN
                               "ORDER BY id DESC LIMIT $4::int8) AS newest ORDER BY id"
                             : "DECLARE rows NO SCROLL CURSOR FOR " EVENTS " FROM event" WITHIN "ORDER BY id",
                         &p);
}

/* ---- Timing -------------------------------------------------------------------------------- */

#define TIMING                                                                                               \
    "SELECT time, task, quantity, period, missed, count, mean, sd, p50, p99, max, bin_low, bin_high, "       \
    "bin_count, id"

static int add_bins(struct apc_pg *pg, struct apc_pg_params *p, struct apc_pg_array *a, const int64_t *bins,
                    size_t n)
{
    if (apc_pg_array_begin(a, APC_PG_INT8, n) != 0) {
        return apc_fail(&pg->base.why, APC_ENOMEM, "out of memory for %zu buckets", n);
    }
    for (size_t i = 0; i < n; i++) {
        apc_pg_array_int8(a, bins[i]);
    }
    apc_pg_param(p, a->data, a->length);
    return 0;
}

static int send_timing(struct apc_pg *pg, const struct apc_timing_row *r)
{
    struct apc_pg_params p = {0};
    char numbers[16][8], task[sizeof r->task], quantity[sizeof r->quantity];
    add_int8(&p, numbers, apc_pg_time(r->time));
    apc_pg_param_text(&p, text_clean(task, r->task, sizeof task));
    apc_pg_param_text(&p, text_clean(quantity, r->quantity, sizeof quantity));
    add_int8(&p, numbers, r->period);
    add_int8(&p, numbers, (int64_t)r->missed);
    add_int8(&p, numbers, (int64_t)r->count);
    add_float8(&p, numbers, r->mean);
    add_float8(&p, numbers, r->sd);
    add_int8(&p, numbers, r->p50);
    add_int8(&p, numbers, r->p99);
    add_int8(&p, numbers, r->max);
    const int64_t *const bins[3] = {r->bin_low, r->bin_high, r->bin_count};
    for (size_t i = 0; i < 3; i++) {
        int err = add_bins(pg, &p, &pg->columns[i], bins[i], r->n_bins);
        if (err) {
            return err;
        }
    }
    return apc_pg_send(
        pg,
        "INSERT INTO timing (time, task, quantity, period, missed, count, mean, sd, p50, p99, max,"
        " bin_low, bin_high, bin_count) VALUES ($1::timestamptz, $2, $3, $4::int8, $5::int8,"
        " $6::int8, $7::float8, $8::float8, $9::int8, $10::int8, $11::int8, $12::int8[],"
        " $13::int8[], $14::int8[])",
        &p);
}

int apc_pg_append_timing(struct apc_store *store, const struct apc_timing_row *rows, size_t n)
{
    struct apc_pg *pg = apc_pg_of(store);
    int err = apc_pg_begin(pg);
    for (size_t i = 0; !err && i < n; i++) {
        err = send_timing(pg, &rows[i]);
    }
    return finish_records(pg, err, (int)n);
}

/* The three arrays of a row, into s->bins one after the other. Returns the number of buckets. */
static int pg_take_bins(struct apc_pg_stream *s, const PGresult *result, int row)
{
    size_t need = 0;
    for (int column = 11; column < 14; column++) {
        need += (size_t)PQgetlength(result, row, column) / 12; /* 12 bytes an element */
    }
    if (need > s->bins_capacity) {
        int64_t *bins = (int64_t *)realloc(s->bins, need * sizeof *bins);
        if (!bins) {
            return apc_fail(&s->pg->base.why, APC_ENOMEM, "out of memory for %zu buckets", need);
        }
        s->bins = bins;
        s->bins_capacity = need;
    }
    int n = -1;
    size_t used = 0;
    for (int column = 11; column < 14; column++) {
        int got =
            apc_pg_get_int8_array(PQgetvalue(result, row, column), (size_t)PQgetlength(result, row, column),
                                  s->bins + used, s->bins_capacity - used);
        if (got < 0 || (n >= 0 && got != n)) {
            return apc_fail(&s->pg->base.why, APC_EPROTO, "a timing row's buckets make no sense");
        }
        n = got;
        used += (size_t)got;
    }
    return n;
}

static int pg_give_timing(struct apc_pg_stream *s, const PGresult *result, int row)
{
    int n = pg_take_bins(s, result, row);
    if (n < 0) {
        return n;
    }
    struct apc_timing_row r = {
        .time = apc_pg_time_ns(apc_pg_cell(result, row, 0)),
        .period = apc_pg_cell(result, row, 3),
        .missed = (uint64_t)apc_pg_cell(result, row, 4),
        .count = (uint64_t)apc_pg_cell(result, row, 5),
        .mean = apc_pg_cell_double(result, row, 6),
        .sd = apc_pg_cell_double(result, row, 7),
        .p50 = apc_pg_cell(result, row, 8),
        .p99 = apc_pg_cell(result, row, 9),
        .max = apc_pg_cell(result, row, 10),
        .bin_low = s->bins,
        .bin_high = n > 0 ? s->bins + n : NULL,
        .bin_count = n > 0 ? s->bins + (ptrdiff_t)2 * n : NULL,
        .n_bins = (size_t)n,
        .number = apc_pg_cell(result, row, 14),
    };
    record_cell_text(result, row, 1, r.task, sizeof r.task);
    record_cell_text(result, row, 2, r.quantity, sizeof r.quantity);
    return s->fn.timing(s->ctx, &r) != 0;
}

int apc_pg_timing(struct apc_store *store, const struct apc_range *range, apc_timing_fn fn, void *ctx)
{
    struct apc_pg_stream s = {
        .pg = apc_pg_of(store), .row = pg_give_timing, .columns = 15, .fn.timing = fn, .ctx = ctx};
    struct apc_pg_params p = {0};
    struct apc_pg_bounds b;
    apc_pg_add_range(&p, &b, range);
    int count = apc_pg_stream(
        &s,
        range->last > 0 ? "DECLARE rows NO SCROLL CURSOR FOR " TIMING " FROM (SELECT * FROM timing" WITHIN
                          "ORDER BY time DESC, id DESC LIMIT $4::int8) AS newest ORDER BY time, id"
                        : "DECLARE rows NO SCROLL CURSOR FOR " TIMING " FROM timing" WITHIN
                          "ORDER BY time, id",
        &p);
    free(s.bins);
    return count;
}

/* ---- Tags ---------------------------------------------------------------------------------- */

#define TAG "name, unit, description, controller, area, low, high, display_low, display_high, period, step"

/* All go, all come, in one transaction: what is no longer described vanishes, and names may change places. */
int apc_pg_send_tags(struct apc_pg *pg, const struct apc_tag *tags, size_t n)
{
    int err = apc_pg_send(pg, "DELETE FROM tag", &(struct apc_pg_params){0});
    for (size_t i = 0; !err && i < n; i++) {
        const struct apc_tag *t = &tags[i];
        struct apc_pg_params p = {0};
        char numbers[16][8], name[APC_TAG_LEN], unit[APC_TAG_LEN], description[sizeof t->description];
        char controller[sizeof t->controller], area[sizeof t->area];
        apc_pg_param_text(&p, apc_table_name(t->table));
        add_int8(&p, numbers, t->id);
        apc_pg_param_text(&p, text_clean(name, t->name, sizeof name));
        apc_pg_param_text(&p, text_clean(unit, t->unit, sizeof unit));
        apc_pg_param_text(&p, text_clean(description, t->description, sizeof description));
        apc_pg_param_text(&p, text_clean(controller, t->controller, sizeof controller));
        apc_pg_param_text(&p, text_clean(area, t->area, sizeof area));
        add_float8(&p, numbers, t->low);
        add_float8(&p, numbers, t->high);
        add_float8(&p, numbers, t->display_low);
        add_float8(&p, numbers, t->display_high);
        add_float8(&p, numbers, t->period);
        add_float8(&p, numbers, t->step);
        add_int8(&p, numbers, t->length);
        err =
            apc_pg_send(pg,
                        "INSERT INTO tag (table_name, id, " TAG ", length) VALUES ($1, $2::int8, $3, $4, $5,"
                        " $6, $7, $8::float8, $9::float8, $10::float8, $11::float8, $12::float8,"
                        " $13::float8, $14::int8)",
                        &p);
    }
    return err;
}

struct tag_list {
    struct apc_pg *pg;
    struct apc_tag *tags;
    size_t capacity;
    int count;
};

static int take_tags(void *ctx, int statement, PGresult *result)
{
    struct tag_list *list = (struct tag_list *)ctx;
    (void)statement;
    if (PQnfields(result) != 14) {
        return apc_fail(&list->pg->base.why, APC_EPROTO, "the database did not answer what was asked");
    }
    list->count = PQntuples(result);
    for (int row = 0; row < list->count && (size_t)row < list->capacity; row++) {
        struct apc_tag *t = &list->tags[row];
        char table[APC_TAG_LEN];
        record_cell_text(result, row, 0, table, sizeof table);
        *t = (struct apc_tag){.table = apc_table_parse(table),
                              .id = (int)apc_pg_cell(result, row, 1),
                              .low = apc_pg_cell_double(result, row, 7),
                              .high = apc_pg_cell_double(result, row, 8),
                              .display_low = apc_pg_cell_double(result, row, 9),
                              .display_high = apc_pg_cell_double(result, row, 10),
                              .period = apc_pg_cell_double(result, row, 11),
                              .step = apc_pg_cell_double(result, row, 12),
                              .length = (int)apc_pg_cell(result, row, 13)};
        record_cell_text(result, row, 2, t->name, sizeof t->name);
        record_cell_text(result, row, 3, t->unit, sizeof t->unit);
        record_cell_text(result, row, 4, t->description, sizeof t->description);
        record_cell_text(result, row, 5, t->controller, sizeof t->controller);
        record_cell_text(result, row, 6, t->area, sizeof t->area);
    }
    return 0;
}

int apc_pg_get_tags(struct apc_store *store, struct apc_tag *tags, size_t capacity)
{
    struct tag_list list = {.pg = apc_pg_of(store), .tags = tags, .capacity = capacity};
    int err = apc_pg_begin(list.pg);
    if (!err) {
        err = apc_pg_send(list.pg,
                          "SELECT table_name, id::int8, " TAG ", length::int8 FROM tag ORDER BY"
                          " array_position(ARRAY['sensor', 'actuator', 'setpoint', 'dim', 'opmode', 'tuning',"
                          " 'manual', 'state', 'actual', 'estimate', 'alarm', 'tick', 'plan',"
                          " 'prediction'], table_name), id",
                          &(struct apc_pg_params){0});
    }
    if (!err) {
        err = apc_pg_finish(list.pg, take_tags, &list);
    }
    return err ? err : list.count;
}

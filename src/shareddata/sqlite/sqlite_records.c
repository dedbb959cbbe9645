/* SPDX-License-Identifier: BSD-3-Clause */
/* The SQLite store outside the tick: events, timing, tags, authors. Statements are prepared for each use. */
#include "shareddata/sqlite/sqlite.h"

#include <endian.h>
#include <stdlib.h>
#include <string.h>

#include "base/text.h"

/* Clean copies of texts into the parameters from @p first on. */
struct text {
    const char *text;
    size_t size;
};

static int bind_texts(struct apc_sqlite *sq, sqlite3_stmt *statement, int first, const struct text *texts,
                      size_t n)
{
    char clean[sizeof((struct apc_event *)0)->text];
    int rc = SQLITE_OK;
    for (size_t i = 0; rc == SQLITE_OK && i < n; i++) {
        rc = sqlite3_bind_text(statement, first + (int)i, text_clean(clean, texts[i].text, texts[i].size), -1,
                               SQLITE_TRANSIENT);
    }
    return rc == SQLITE_OK ? 0 : apc_sqlite_fail(sq, rc);
}

#define TEXT(member)                                                                                         \
    {                                                                                                        \
        member, sizeof member                                                                                \
    }

static void take_text(sqlite3_stmt *statement, int column, char *out, size_t size)
{
    const unsigned char *text = sqlite3_column_text(statement, column);
    sqlite3_snprintf((int)size, out, "%s", text ? (const char *)text : "");
}

/* ---- Writing -------------------------------------------------------------------------------- */

/* Binds row i of an array. Returns 0 or an error. */
typedef int (*bind_fn)(struct apc_sqlite *sq, sqlite3_stmt *statement, const void *rows, size_t i);

static int insert_rows(struct apc_sqlite *sq, const char *sql, bind_fn bind, const void *rows, size_t n)
{
    sqlite3_stmt *statement = NULL;
    int err = apc_sqlite_prepare(sq, sql, &statement);
    for (size_t i = 0; !err && i < n; i++) {
        err = bind(sq, statement, rows, i);
        if (!err) {
            err = apc_sqlite_step(sq, statement);
        }
    }
    sqlite3_finalize(statement);
    return err ? err : (int)n;
}

static int append_records(struct apc_store *store, const char *sql, bind_fn bind, const void *rows, size_t n)
{
    struct apc_sqlite *sq = apc_sqlite_of(store);
    int err = apc_sqlite_enter_begin(sq, APC_SQLITE_WRITE);
    return err ? err : apc_sqlite_end(sq, insert_rows(sq, sql, bind, rows, n));
}

/* ---- Reading -------------------------------------------------------------------------------- */

/*
 * Rows in the order of two numbers, a and b. Each comes in a transaction of its own and is copied, so that
 * the file is free while the caller's function runs.
 */
struct stream {
    struct apc_sqlite *sq;
    const char *next; /* ?1 since, ?2 until, ?5 after: the first row from (a, b) = (?3, ?4) on; a and b are
                         its first columns */
    const char *back; /* ?1, ?2, ?5: a and b of the row with ?3 newer ones */
    int (*take)(struct stream *s, sqlite3_stmt *statement); /* copies the row: 0 or an error */
    int (*give)(struct stream *s); /* gives it to the caller, who may end the stream */
    int64_t since, until, after, a, b;
    union {
        apc_event_fn event;
        apc_timing_fn timing;
    } fn;
    void *ctx;
    struct apc_event event;
    struct apc_timing_row timing;
    int64_t *bins; /* of the timing row */
};

/* One row of a query with the stream's bounds and two numbers more. */
static int query(struct stream *s, sqlite3_stmt *statement, int64_t third, int64_t fourth)
{
    sqlite3_bind_int64(statement, 1, s->since);
    sqlite3_bind_int64(statement, 2, s->until);
    sqlite3_bind_int64(statement, 3, third);
    sqlite3_bind_int64(statement, 4, fourth);
    sqlite3_bind_int64(statement, 5, s->after);
    return apc_sqlite_step(s->sq, statement);
}

/* Where to begin: at the last so many rows. */
static int go_back(struct stream *s, size_t last)
{
    sqlite3_stmt *statement = NULL;
    int found = apc_sqlite_prepare(s->sq, s->back, &statement);
    if (found == 0) {
        found = query(s, statement, (int64_t)last - 1, 0);
    }
    if (found > 0) {
        s->a = sqlite3_column_int64(statement, 0);
        s->b = sqlite3_column_int64(statement, 1);
    }
    sqlite3_finalize(statement);
    return found < 0 ? found : 0;
}

/* The next row: 1, 0 at the end, or an error. */
static int next_row(struct stream *s, sqlite3_stmt *statement)
{
    s->sq->deadline =
        apc_clock_mono(NULL) + s->sq->base.config.timeout; /* the caller's own time is not ours */
    int found = query(s, statement, s->a, s->b);
    if (found > 0) {
        s->a = sqlite3_column_int64(statement, 0);
        s->b = sqlite3_column_int64(statement, 1) + 1;
        int err = s->take(s, statement);
        sqlite3_reset(statement);
        found = err ? err : found;
    }
    return found;
}

static int run_stream(struct stream *s, const struct apc_range *range)
{
    sqlite3_stmt *statement = NULL;
    int count = 0;
    s->since = apc_sqlite_bound(range->since, INT64_MIN);
    s->until = apc_sqlite_bound(range->until, INT64_MAX);
    s->after = range->after;
    s->a = s->b = INT64_MIN;
    s->sq->base.stats.round_trips++;
    int found = apc_sqlite_enter(s->sq);
    if (found == 0 && range->last > 0) {
        found = go_back(s, range->last);
    }
    if (found == 0) {
        found = apc_sqlite_prepare(s->sq, s->next, &statement);
    }
    bool ended = found < 0;
    while (!ended && (found = next_row(s, statement)) > 0) {
        s->sq->base.streaming = true;
        ended = s->give(s) != 0;
        s->sq->base.streaming = false;
        count += count < INT_MAX;
    }
    sqlite3_finalize(statement);
    return found < 0 ? found : count;
}

/* ---- Events --------------------------------------------------------------------------------- */

static int bind_event(struct apc_sqlite *sq, sqlite3_stmt *statement, const void *rows, size_t i)
{
    const struct apc_event *e = (const struct apc_event *)rows + i;
    sqlite3_bind_int64(statement, 1, apc_sqlite_time(e->time));
    sqlite3_bind_int64(statement, 2, e->severity);
    return bind_texts(sq, statement, 3, (const struct text[]){TEXT(e->source), TEXT(e->kind), TEXT(e->text)},
                      3);
}

int apc_sqlite_append_events(struct apc_store *store, const struct apc_event *events, size_t n)
{
    return append_records(
        store, "INSERT INTO event (time, severity, source, kind, text) VALUES (?1, ?2, ?3, ?4, ?5)",
        bind_event, events, n);
}

static int take_event_row(struct stream *s, sqlite3_stmt *statement)
{
    struct apc_event *e = &s->event;
    e->number = sqlite3_column_int64(statement, 1);
    e->time = apc_sqlite_ns(sqlite3_column_int64(statement, 2));
    e->severity = (enum apc_event_severity)sqlite3_column_int(statement, 3);
    take_text(statement, 4, e->source, sizeof e->source);
    take_text(statement, 5, e->kind, sizeof e->kind);
    take_text(statement, 6, e->text, sizeof e->text);
    return 0;
}

static int sqlite_give_event(struct stream *s)
{
    return s->fn.event(s->ctx, &s->event);
}

/* By id, the order of arrival; the first one by the index on time. */
int apc_sqlite_events(struct apc_store *store, const struct apc_range *range, apc_event_fn fn, void *ctx)
{
    struct stream s = {
        .sq = apc_sqlite_of(store),
        .next = "SELECT 0, id, time, severity, source, kind, text FROM event NOT INDEXED"
                " WHERE id >= CASE WHEN ?4 > 0 THEN ?4 WHEN ?5 > 0 THEN ?5 + 1 ELSE coalesce((SELECT min(id) "
                "FROM event INDEXED BY "
                "event_time"
                " WHERE time >= ?1 AND time < ?2), 9223372036854775807) END"
                " AND time >= ?1 AND time < ?2 ORDER BY id LIMIT 1",
        .back = "SELECT 0, id FROM event NOT INDEXED WHERE id > ?5 AND time >= ?1 AND time < ?2"
                " ORDER BY id DESC LIMIT 1 OFFSET ?3",
        .take = take_event_row,
        .give = sqlite_give_event,
        .fn.event = fn,
        .ctx = ctx,
    };
    return run_stream(&s, range);
}

/* ---- Timing --------------------------------------------------------------------------------- */

static int bind_timing(struct apc_sqlite *sq, sqlite3_stmt *statement, const void *rows, size_t i)
{
    const struct apc_timing_row *r = (const struct apc_timing_row *)rows + i;
    const int64_t *const bins[3] = {r->bin_low, r->bin_high, r->bin_count};
    sqlite3_bind_int64(statement, 1, apc_sqlite_time(r->time));
    int err = bind_texts(sq, statement, 2, (const struct text[]){TEXT(r->task), TEXT(r->quantity)}, 2);
    if (err) {
        return err;
    }
    sqlite3_bind_int64(statement, 4, r->period);
    sqlite3_bind_int64(statement, 5, (int64_t)r->missed);
    sqlite3_bind_int64(statement, 6, (int64_t)r->count);
    sqlite3_bind_double(statement, 7, r->mean);
    sqlite3_bind_double(statement, 8, r->sd);
    sqlite3_bind_int64(statement, 9, r->p50);
    sqlite3_bind_int64(statement, 10, r->p99);
    sqlite3_bind_int64(statement, 11, r->max);
    uint64_t *blob = malloc(3 * r->n_bins * sizeof *blob + 1);
    if (!blob) {
        return apc_fail(&sq->base.why, APC_ENOMEM, "out of memory for %zu buckets", r->n_bins);
    }
    for (size_t b = 0; b < 3 * r->n_bins; b++) {
        blob[b] = htole64((uint64_t)bins[b / r->n_bins][b % r->n_bins]);
    }
    int rc = sqlite3_bind_blob64(statement, 12, blob, 3 * r->n_bins * sizeof *blob, free);
    return rc == SQLITE_OK ? 0 : apc_sqlite_fail(sq, rc);
}

int apc_sqlite_append_timing(struct apc_store *store, const struct apc_timing_row *rows, size_t n)
{
    return append_records(
        store,
        "INSERT INTO timing (time, task, quantity, period, missed, count, mean, sd, p50, p99, max,"
        " bins) VALUES (?1, ?2, ?3, ?4, ?5, ?6, ?7, ?8, ?9, ?10, ?11, ?12)",
        bind_timing, rows, n);
}

static int sqlite_take_bins(struct stream *s, sqlite3_stmt *statement, int column)
{
    size_t n = (size_t)sqlite3_column_bytes(statement, column) / (3 * sizeof *s->bins);
    const void *blob = sqlite3_column_blob(statement, column);
    int64_t *bins = realloc(s->bins, 3 * n * sizeof *bins + 1);
    if (!bins || (n > 0 && !blob)) {
        s->bins = bins ? bins : s->bins;
        return apc_fail(&s->sq->base.why, APC_ENOMEM, "out of memory for %zu buckets", n);
    }
    s->bins = bins;
    for (size_t i = 0; i < 3 * n; i++) {
        uint64_t little;
        memcpy(&little, (const char *)blob + i * sizeof little, sizeof little);
        bins[i] = (int64_t)le64toh(little);
    }
    s->timing.n_bins = n;
    s->timing.bin_low = bins;
    s->timing.bin_high = bins + n;
    s->timing.bin_count = bins + 2 * n;
    return 0;
}

static int take_timing_row(struct stream *s, sqlite3_stmt *statement)
{
    struct apc_timing_row *r = &s->timing;
    r->time = apc_sqlite_ns(sqlite3_column_int64(statement, 0));
    r->number = sqlite3_column_int64(statement, 1);
    take_text(statement, 2, r->task, sizeof r->task);
    take_text(statement, 3, r->quantity, sizeof r->quantity);
    r->period = sqlite3_column_int64(statement, 4);
    r->missed = (uint64_t)sqlite3_column_int64(statement, 5);
    r->count = (uint64_t)sqlite3_column_int64(statement, 6);
    r->mean = sqlite3_column_double(statement, 7);
    r->sd = sqlite3_column_double(statement, 8);
    r->p50 = sqlite3_column_int64(statement, 9);
    r->p99 = sqlite3_column_int64(statement, 10);
    r->max = sqlite3_column_int64(statement, 11);
    return sqlite_take_bins(s, statement, 12);
}

static int sqlite_give_timing(struct stream *s)
{
    return s->fn.timing(s->ctx, &s->timing);
}

int apc_sqlite_timing(struct apc_store *store, const struct apc_range *range, apc_timing_fn fn, void *ctx)
{
    struct stream s = {
        .sq = apc_sqlite_of(store),
        .next = "SELECT time, id, task, quantity, period, missed, count, mean, sd, p50, p99, max, bins"
                " FROM timing WHERE (time, id) >= (max(?1, ?3), ?4) AND time < ?2 AND id > ?5"
                " ORDER BY time, id LIMIT 1",
        .back = "SELECT time, id FROM timing WHERE time >= ?1 AND time < ?2 AND id > ?5"
                " ORDER BY time DESC, id DESC LIMIT 1 OFFSET ?3",
        .take = take_timing_row,
        .give = sqlite_give_timing,
        .fn.timing = fn,
        .ctx = ctx,
    };
    int count = run_stream(&s, range);
    free(s.bins);
    return count;
}

/* ---- Descriptions --------------------------------------------------------------------------- */

#define TAG                                                                                                  \
    "table_number, id, name, unit, description, controller, area, low, high, display_low, display_high, "    \
    "period, step, length"

static int bind_tag(struct apc_sqlite *sq, sqlite3_stmt *statement, const void *rows, size_t i)
{
    const struct apc_tag *t = (const struct apc_tag *)rows + i;
    const struct text texts[] = {TEXT(t->name), TEXT(t->unit), TEXT(t->description), TEXT(t->controller),
                                 TEXT(t->area)};
    const double numbers[] = {t->low, t->high, t->display_low, t->display_high, t->period, t->step};
    sqlite3_bind_int64(statement, 1, t->table);
    sqlite3_bind_int64(statement, 2, t->id);
    for (int k = 0; k < 6; k++) {
        sqlite3_bind_double(statement, 8 + k, numbers[k]);
    }
    sqlite3_bind_int64(statement, 14, t->length);
    sqlite3_bind_int64(statement, 15, apc_variable_number(t->table, t->id));
    return bind_texts(sq, statement, 3, texts, 5);
}

/* Of the same kind as before; and none where nothing has changed. */
static int insert_catalogue(struct apc_sqlite *sq, const char *text)
{
    sqlite3_stmt *statement = NULL;
    int err = apc_sqlite_prepare(
        sq,
        "WITH newest AS (SELECT * FROM catalogue ORDER BY revision DESC LIMIT 1)"
        " INSERT INTO catalogue (revision, time, kind, text)"
        " SELECT coalesce((SELECT revision FROM newest), 0) + 1, ?2,"
        " coalesce((SELECT kind FROM newest), 'live'), ?1 WHERE ?1 IS NOT (SELECT text FROM newest)",
        &statement);
    if (!err) {
        sqlite3_bind_text(statement, 1, text, -1, SQLITE_STATIC);
        sqlite3_bind_int64(statement, 2, apc_sqlite_time(apc_clock_utc(NULL)));
        err = apc_sqlite_step(sq, statement);
    }
    sqlite3_finalize(statement);
    return err;
}

int apc_sqlite_describe(struct apc_store *store, const struct apc_tag *tags, size_t n, const char *catalogue)
{
    struct apc_sqlite *sq = apc_sqlite_of(store);
    int err = apc_sqlite_enter_begin(sq, APC_SQLITE_WRITE);
    if (err) {
        return err;
    }
    err = apc_sqlite_run(sq, "DELETE FROM tag");
    if (!err && catalogue) {
        err = insert_catalogue(sq, catalogue);
    }
    if (!err) {
        err = insert_rows(sq,
                          "INSERT INTO tag (" TAG ", number)"
                          " VALUES (?1, ?2, ?3, ?4, ?5, ?6, ?7, ?8, ?9, ?10, ?11, ?12, ?13, ?14, ?15)",
                          bind_tag, tags, n);
    }
    return apc_sqlite_end(sq, err);
}

int apc_sqlite_catalogue_at(struct apc_store *store, apc_ns time, char *text, size_t size, int64_t *revision)
{
    struct apc_sqlite *sq = apc_sqlite_of(store);
    sqlite3_stmt *statement = NULL;
    int found = apc_sqlite_enter(sq), length = 0;
    *revision = 0;
    sq->base.stats.round_trips++;
    if (found == 0) {
        found = apc_sqlite_prepare(sq,
                                   "SELECT revision, text FROM catalogue"
                                   " ORDER BY iif(time <= ?1, -revision, revision) LIMIT 1",
                                   &statement);
    }
    if (found == 0) {
        sqlite3_bind_int64(statement, 1, time == INT64_MAX ? time : apc_sqlite_time(time));
        found = apc_sqlite_step(sq, statement);
    }
    if (found > 0) {
        *revision = sqlite3_column_int64(statement, 0);
        length = sqlite3_column_bytes(statement, 1);
        if (size > 0) {
            take_text(statement, 1, text, size <= INT_MAX ? size : INT_MAX);
        }
    }
    sqlite3_finalize(statement);
    return found < 0 ? found : length;
}

int apc_sqlite_catalogue(struct apc_store *store, char *text, size_t size, int64_t *revision)
{
    return apc_sqlite_catalogue_at(store, INT64_MAX, text, size, revision);
}

/* ---- A history ------------------------------------------------------------------------------ */

static int find_kind(struct apc_sqlite *sq)
{
    sqlite3_stmt *statement = NULL;
    int found = apc_sqlite_prepare(
        sq, "SELECT kind = 'history' FROM catalogue ORDER BY revision DESC LIMIT 1", &statement);
    found = found ? found : apc_sqlite_step(sq, statement);
    const int history = found > 0 ? sqlite3_column_int(statement, 0) : 0;
    sqlite3_finalize(statement);
    return found < 0 ? found : history;
}

int apc_sqlite_is_history(struct apc_store *store)
{
    struct apc_sqlite *sq = apc_sqlite_of(store);
    const int err = apc_sqlite_enter(sq);
    sq->base.stats.round_trips++;
    return err ? err : find_kind(sq);
}

/* A file has no table of requests: who asks is told where to go. */
int apc_sqlite_ask(struct apc_store *store, struct apc_request *request)
{
    struct apc_sqlite *sq = apc_sqlite_of(store);
    int err = apc_sqlite_enter(sq);
    err = err ? err : apc_sqlite_check_live(sq);
    request->id = 0;
    return err ? err : apc_fail(&store->why, APC_EINVAL, "nobody can be asked for that here");
}

static int insert_kind(struct apc_sqlite *sq)
{
    sqlite3_stmt *statement = NULL;
    int err = apc_sqlite_prepare(
        sq,
        "INSERT INTO catalogue (revision, time, kind, text) SELECT revision + 1, ?1, 'history', text FROM"
        " (SELECT * FROM catalogue ORDER BY revision DESC LIMIT 1) WHERE kind <> 'history' RETURNING 1",
        &statement);
    if (!err) {
        sqlite3_bind_int64(statement, 1, apc_sqlite_time(apc_clock_utc(NULL)));
        err = apc_sqlite_step(sq, statement);
    }
    sqlite3_finalize(statement);
    return err;
}

int apc_sqlite_keep_history(struct apc_store *store)
{
    struct apc_sqlite *sq = apc_sqlite_of(store);
    const int history = apc_sqlite_is_history(store);
    const int err = history ? history : apc_sqlite_begin(sq, APC_SQLITE_WRITE);
    return err ? (err > 0 ? 0 : err) : apc_sqlite_end(sq, insert_kind(sq));
}

int apc_sqlite_check_live(struct apc_sqlite *sq)
{
    const int history = find_kind(sq);
    return history > 0
               ? apc_fail(
                     &sq->base.why, APC_EPERM,
                     "%s is a history, which no loop reads: write to the live store instead; --store RUN "
                     "leads there while the run goes on",
                     sq->given)
               : history;
}

/* ---- Tags ----------------------------------------------------------------------------------- */

static void take_tag(sqlite3_stmt *statement, struct apc_tag *t)
{
    *t = (struct apc_tag){.table = (enum apc_table)sqlite3_column_int(statement, 0),
                          .id = sqlite3_column_int(statement, 1),
                          .low = sqlite3_column_double(statement, 7),
                          .high = sqlite3_column_double(statement, 8),
                          .display_low = sqlite3_column_double(statement, 9),
                          .display_high = sqlite3_column_double(statement, 10),
                          .period = sqlite3_column_double(statement, 11),
                          .step = sqlite3_column_double(statement, 12),
                          .length = sqlite3_column_int(statement, 13)};
    take_text(statement, 2, t->name, sizeof t->name);
    take_text(statement, 3, t->unit, sizeof t->unit);
    take_text(statement, 4, t->description, sizeof t->description);
    take_text(statement, 5, t->controller, sizeof t->controller);
    take_text(statement, 6, t->area, sizeof t->area);
}

int apc_sqlite_get_tags(struct apc_store *store, struct apc_tag *tags, size_t capacity)
{
    struct apc_sqlite *sq = apc_sqlite_of(store);
    sqlite3_stmt *statement = NULL;
    int count = 0, found = apc_sqlite_enter(sq);
    if (found == 0) {
        found = apc_sqlite_prepare(sq, "SELECT " TAG " FROM tag ORDER BY table_number, id", &statement);
    }
    sq->base.stats.round_trips++;
    while (found >= 0 && (found = apc_sqlite_step(sq, statement)) > 0) {
        if ((size_t)count < capacity) {
            take_tag(statement, &tags[count]);
        }
        count++;
    }
    sqlite3_finalize(statement);
    return found < 0 ? found : count;
}

/* ---- Authors -------------------------------------------------------------------------------- */

/* The number of a name: 0 when it has none yet. */
static int find_author_number(struct apc_sqlite *sq, const char *name)
{
    sqlite3_stmt *statement = NULL;
    int found = apc_sqlite_prepare(sq, "SELECT number FROM author WHERE name = ?1", &statement);
    if (found == 0) {
        sqlite3_bind_text(statement, 1, name, -1, SQLITE_STATIC);
        found = apc_sqlite_step(sq, statement);
    }
    const int number = found > 0 ? sqlite3_column_int(statement, 0) : 0;
    sqlite3_finalize(statement);
    return found < 0 ? found : number;
}

static int insert_author(struct apc_sqlite *sq, const char *name)
{
    sqlite3_stmt *statement = NULL;
    int err =
        apc_sqlite_prepare(sq, "INSERT INTO author (name) VALUES (?1) ON CONFLICT DO NOTHING", &statement);
    if (!err) {
        sqlite3_bind_text(statement, 1, name, -1, SQLITE_STATIC);
        err = apc_sqlite_step(sq, statement);
    }
    sqlite3_finalize(statement);
    return err ? err : find_author_number(sq, name);
}

int apc_sqlite_author(struct apc_store *store, const char *name)
{
    struct apc_sqlite *sq = apc_sqlite_of(store);
    int number = apc_sqlite_enter(sq);
    sq->base.stats.round_trips++;
    if (number == 0) {
        number = find_author_number(sq, name);
    }
    if (number == 0) {
        number = apc_sqlite_begin(sq, APC_SQLITE_WRITE);
        number = number < 0 ? number : apc_sqlite_end(sq, insert_author(sq, name));
    }
    return number;
}

int apc_sqlite_author_name(struct apc_store *store, uint32_t number, char name[APC_AUTHOR_LEN])
{
    struct apc_sqlite *sq = apc_sqlite_of(store);
    sqlite3_stmt *statement = NULL;
    int found = apc_sqlite_enter(sq);
    sq->base.stats.round_trips++;
    if (found == 0) {
        found = apc_sqlite_prepare(sq, "SELECT name FROM author WHERE number = ?1", &statement);
    }
    if (found == 0) {
        sqlite3_bind_int64(statement, 1, number);
        found = apc_sqlite_step(sq, statement);
    }
    if (found > 0) {
        take_text(statement, 0, name, APC_AUTHOR_LEN);
    }
    sqlite3_finalize(statement);
    return found < 0 ? found : found > 0 ? 0 : APC_ENOTFOUND;
}

/* SPDX-License-Identifier: BSD-3-Clause */
/*
 * The PostgreSQL store, shared by its files: pg_array.c (binary values), pg_statements.c (every SQL text),
 * pg_connection.c (operations, waiting with a deadline), pg_connect.c (connecting), pg_error.c (what failed),
 * pg_claim.c (claims), pg_former.c (claims that outlive their connection), pg_pooled.c (poolers), pg_init.c
 * (migrations), pg_tick.c (the ticks' operations), pg_chunks.c (appending chunks), pg_catalogue.c (authors,
 * the catalogue), pg_request.c (what people ask of a history), pg_rows.c (events, timing, tags), pg_history.c
 * (history of samples and vectors), pg_pack.c (packing old weeks), pg_plants.c (which plants there are),
 * postgresql.c (its life). apcshareddata.c uses the first two.
 */
#ifndef APC_POSTGRESQL_H
#define APC_POSTGRESQL_H

#include <libpq-fe.h>

#include "shareddata/shareddata_internal.h"

/* ---- pg_array.c: values in PostgreSQL's binary format -------------------------------------- */

enum { APC_PG_INT4 = 23, APC_PG_INT8 = 20, APC_PG_FLOAT8 = 701, APC_PG_TIMESTAMPTZ = 1184 };

/** A one-dimensional array under construction. Its memory is kept and only ever grows. */
struct apc_pg_array {
    char *data;
    size_t length, capacity;
};

/** Bytes of an array of @p n elements of @p width bytes. */
#define APC_PG_ARRAY_SIZE(n, width) (20 + (n) * (4 + (size_t)(width)))

/** Begin an array of @p n elements of type @p oid, at most 8 bytes each. Returns 0 or APC_ENOMEM. */
int apc_pg_array_begin(struct apc_pg_array *a, uint32_t oid, size_t n);
void apc_pg_array_int4(struct apc_pg_array *a, int32_t value);
void apc_pg_array_int8(struct apc_pg_array *a, int64_t value);
void apc_pg_array_float8(struct apc_pg_array *a, double value);
void apc_pg_array_null(struct apc_pg_array *a);

void apc_pg_put_int8(char bytes[8], int64_t value);
void apc_pg_put_float8(char bytes[8], double value);
int32_t apc_pg_get_int4(const char *bytes);
int64_t apc_pg_get_int8(const char *bytes);
double apc_pg_get_float8(const char *bytes);
/** A result's cell of 8 bytes; 0 when it is NULL or of another size. */
int64_t apc_pg_cell(const PGresult *result, int row, int column);
/** Elements of an int8[] without NULLs: up to @p capacity into @p out. Returns how many there are, or
 * APC_EPROTO. */
int apc_pg_get_int8_array(const char *bytes, size_t length, int64_t *out, size_t capacity);
/** The same of a float8[]. */
int apc_pg_get_float8_array(const char *bytes, size_t length, double *out, size_t capacity);

/** A timestamptz is microseconds since 2000. Nanoseconds are cut off; what apc_ns cannot hold is clamped. */
int64_t apc_pg_time(apc_ns utc);
apc_ns apc_pg_time_ns(int64_t pg);

/* ---- pg_statements.c: every SQL text -------------------------------------------------------- */

/** The statements of one table; names are resolved by the search_path. */
struct apc_pg_text {
    const char *read_name, *read;       /* prepared */
    const char *append_name, *append;   /* prepared */
    const char *plain_name, *plain;     /* prepared; append of samples without origin, author and the like */
    const char *repeat;                 /* append of those that are not there */
    const char *put;                    /* takes the next seq; a concurrent writer makes it fail */
    const char *swap;                   /* the next seq of those whose newest is the one given */
    const char *place_name, *place;     /* prepared; the same of what nobody holds. Of what people write */
    const char *history, *history_last; /* declares cursor "rows" */
    const char *history_then;           /* likewise; the last of long ago */
    const char *bins;                   /* likewise */
    const char *within;                 /* likewise; the last of many variables at once. Not of vectors */
    const char *merged, *merged_last, *merged_bins; /* the same with chunks; NULL: it is never packed */
    const char *merged_then, *merged_within;        /* likewise */
    const char *paper_read, *paper_put;             /* the same on schema apc, for any PGconn */
};
extern const struct apc_pg_text apc_pg_texts[APC_TABLE_END];
/** The texts of a table, or NULL with the error APC_ESCHEMA: the schema has no such table any more. */
struct apc_pg;
const struct apc_pg_text *apc_pg_text_of(struct apc_pg *pg, enum apc_table table);

/* ---- pg_connection.c ------------------------------------------------------------------------ */

/** The server's end of a connection. */
struct apc_pg_session {
    int32_t pid;
    int64_t start; /* a timestamptz */
    bool claimant; /* a claim was sent: it may hold tables */
};

#define APC_PG_FORMER_MAX 8 /* each is one that the server could not end for as long as the timeout */

/** A row of the running operation, and which statement on its table it is part of. */
struct apc_pg_place {
    uint32_t row, pass;
};

struct apc_pg_chunks;

struct apc_pg {
    struct apc_store base;
    char schema[64];
    PQconninfoOption *uri; /* what the URI says */
    char hosts[3][1024];   /* host, hostaddr, port for the next try; "": as the URI and libpq say */
    PGconn *conn;          /* NULL: not connected. In pipeline mode whenever an operation begins */
    apc_ns deadline;       /* of the running operation, monotonic */
    apc_ns next_try;       /* no connect before it, monotonic */
    int version;           /* of the schema that it connected to */
    int64_t timeline;      /* of the leader that it connected to last; 0: none yet */
    bool packed;           /* it was seen to have tables of chunks */
    unsigned failures;     /* connects that failed in a row */
    uint64_t random;       /* of the jitter */
    int failed;            /* why the last connect failed */
    struct apc_error failure;
    struct apc_claims claimed;
    struct apc_pg_session session, former[APC_PG_FORMER_MAX];
    size_t n_former;
    bool unreplicated;              /* a commit's warning: not on the standby */
    bool violated;                  /* the last refusal was a row's, for what it says */
    struct apc_pg *waiter;          /* the connection of apc_store_wait(); NULL: never used */
    uint32_t listening;             /* of a waiter: bit t: to changes of table t */
    struct apc_pg_array columns[9]; /* parameters; kept, so that a tick allocates nothing */
    struct apc_pg_place *places;    /* rows sorted by table; kept as well */
    size_t places_capacity;
    struct apc_pg_chunks *chunks; /* pg_chunks.c's own; kept as well */
};

static inline struct apc_pg *apc_pg_of(struct apc_store *store)
{
    return (struct apc_pg *)store;
}

/** A statement's parameters: up to twenty, all binary but where length is 0 (text) or value is NULL. */
struct apc_pg_params {
    int n;
    const char *values[20];
    int lengths[20], formats[20];
};
void apc_pg_param(struct apc_pg_params *p, const char *binary, size_t length);
void apc_pg_param_text(struct apc_pg_params *p, const char *text);

/**
 * Called with each result, in the order of the statements sent, numbered from 0; not after the first
 * failure. Returns 0, or a negative error whose text it left in the store: the result of the operation.
 */
typedef int (*apc_pg_result_fn)(void *ctx, int statement, PGresult *result);

/** Wait for a notification until @p deadline (monotonic). Returns 1, 0 when the time is up, or an error. */
int apc_pg_await_notify(struct apc_pg *pg, apc_ns deadline);
/** Wait for the socket within the running operation. Returns 0, or APC_ETIMEDOUT, APC_ESYS. */
int apc_pg_wait_socket(struct apc_pg *pg, short events);
/** Queue a statement by text, or a prepared one by name. */
int apc_pg_send(struct apc_pg *pg, const char *sql, const struct apc_pg_params *p);
int apc_pg_send_prepared(struct apc_pg *pg, const char *name, const struct apc_pg_params *p);
/** Half a queue is of no use: close the connection, and with it what was queued before. Returns an error. */
int apc_pg_not_queued(struct apc_pg *pg);
/** Send what is queued, wait for all results: one round trip. @p fn may be NULL. */
int apc_pg_finish(struct apc_pg *pg, apc_pg_result_fn fn, void *ctx);
/** The same; each row of the statement of that number, from 1, is a result of its own, given while the server
 * goes on with the next. An empty result ends them. */
int apc_pg_finish_by_rows(struct apc_pg *pg, int by_rows, apc_pg_result_fn fn, void *ctx);
/** Close the connection, without waiting for anything. The next operation connects anew. */
void apc_pg_drop(struct apc_pg *pg);

/** Run SQL text, maybe several commands, outside pipeline mode. @p result (may be NULL) gets the last result. */
int apc_pg_command(struct apc_pg *pg, const char *sql, PGresult **result);

/* ---- pg_connect.c --------------------------------------------------------------------------- */

/** Split the URI. On failure nothing has to be freed. */
int apc_pg_parse_uri(struct apc_pg *pg, const char *uri, struct apc_error *why);
/** Begin an operation: set its deadline, connect when not connected. */
int apc_pg_begin(struct apc_pg *pg);
/**
 * Can this library work with a schema of that version, made for programs from compatible_from on? 0, or
 * APC_ESCHEMA with what to do when it is too new.
 */
int apc_pg_check_version(struct apc_pg *pg, int version, int compatible_from);

/** Connect without looking at the schema and without pipeline mode: for pg_init.c. */
int apc_pg_connect_bare(struct apc_pg *pg);

/* ---- pg_error.c ----------------------------------------------------------------------------- */

/** The text of libpq or of the server: several lines become one, and a password is never shown. */
void apc_pg_flatten(const struct apc_pg *pg, char *out, size_t size, const char *text);
/** Fail with it, behind @p what. */
int apc_pg_fail(struct apc_pg *pg, int err, const char *what, const char *text);
/** The connection is of no use any more: say so, and close it. */
int apc_pg_lost(struct apc_pg *pg);
int apc_pg_timed_out(struct apc_pg *pg);
/** Fail with the error that a result reports. */
int apc_pg_refused(struct apc_pg *pg, const PGresult *result);

/* ---- pg_chunks.c ---------------------------------------------------------------------------- */

/** May the samples at these places, all of one variable, go as one chunk? */
bool apc_pg_chunkable(const struct apc_sample *sample, const struct apc_pg_place *place, size_t n);
/** Queue the append of those at these places, each variable's one after the other, as chunks. */
int apc_pg_send_chunks(struct apc_pg *pg, enum apc_table table, const struct apc_sample *sample,
                       const struct apc_pg_place *place, size_t n);
void apc_pg_free_chunks(struct apc_pg_chunks *chunks);

/* ---- pg_former.c ---------------------------------------------------------------------------- */

/** The connection ends: keep its session's name if it may hold claims. */
void apc_pg_remember(struct apc_pg *pg);
/** Before claims are renewed: end the former sessions. APC_ECONN when one is left. */
int apc_pg_end_former(struct apc_pg *pg);

/* ---- pg_pooled.c ---------------------------------------------------------------------------- */

/** The sentence about a pooler that shares sessions; returns APC_ECONN. */
int apc_pg_fail_pooled(struct apc_pg *pg);
/** After the session has its name: 0, or that sentence. */
int apc_pg_look_for_pooler(struct apc_pg *pg);

/* ---- pg_wait.c ------------------------------------------------------------------------------ */

int apc_pg_wait(struct apc_store *store, const struct apc_sample *seen, size_t n, apc_ns timeout);
void apc_pg_close_waiter(struct apc_pg *pg);

/* ---- pg_claim.c ----------------------------------------------------------------------------- */

/** Queue a claim on all that this store has claimed; look at its result. */
int apc_pg_send_claims(struct apc_pg *pg);
int apc_pg_take_claims(struct apc_pg *pg, const PGresult *result);

/* ---- pg_rows.c ------------------------------------------------------------------------------- */

struct apc_pg_stream;
/** Gives one row to the caller: 0, 1 to end the stream, or a negative error. */
typedef int (*apc_pg_row_fn)(struct apc_pg_stream *s, const PGresult *result, int row);

/** Rows on their way out, through a cursor. */
struct apc_pg_stream {
    struct apc_pg *pg;
    apc_pg_row_fn row;
    int columns;
    bool large; /* rows of some kilobytes: each is given while the server goes on with the next */
    union {
        apc_sample_fn sample;
        apc_vector_fn vector;
        apc_event_fn event;
        apc_timing_fn timing;
    } fn;
    void *ctx;
    enum apc_table table; /* of a history */
    int id;
    int64_t *bins; /* of timing rows: room for three arrays */
    size_t bins_capacity;
    double *values; /* of a vector */
    size_t room;
    int fetch; /* number of the FETCH among the statements sent */
    int count; /* rows given */
    bool ended;
};

/** Run a statement that declares cursor "rows", and give its rows. Returns how many were given, or an error. */
int apc_pg_stream(struct apc_pg_stream *s, const char *declare, const struct apc_pg_params *p);

/** Room for what a range becomes among the parameters: since, until, after and, when asked for, how many. */
struct apc_pg_bounds {
    char since[8], until[8], after[8], last[8];
};
void apc_pg_add_range(struct apc_pg_params *p, struct apc_pg_bounds *b, const struct apc_range *range);
/** A result's cell of 8 bytes; 0 when it is NULL. */
double apc_pg_cell_double(const PGresult *result, int row, int column);

/** Queue all that replaces the descriptions. */
int apc_pg_send_tags(struct apc_pg *pg, const struct apc_tag *tags, size_t n);
/** Send what was queued, unless @p err; a constraint that says no is no race. Returns @p count or an error. */
int apc_pg_finish_insert(struct apc_pg *pg, int err, int count);

/* ---- pg_tick.c, pg_claim.c, pg_catalogue.c, pg_init.c, pg_maintain.c, pg_rows.c: operations
 * ------------------ */

int apc_pg_read(struct apc_store *store, struct apc_sample *samples, size_t n);
int apc_pg_append(struct apc_store *store, const struct apc_sample *samples, size_t n);
int apc_pg_put(struct apc_store *store, struct apc_sample *samples, size_t n);
int apc_pg_swap(struct apc_store *store, struct apc_sample *samples, size_t n);
int apc_pg_read_rows(struct apc_store *store, struct apc_rows *rows);
int apc_pg_append_rows(struct apc_store *store, const struct apc_rows *rows);
int apc_pg_claim_set(struct apc_store *store, struct apc_sample *variables, size_t n);
int apc_pg_author(struct apc_store *store, const char *name);
int apc_pg_author_name(struct apc_store *store, uint32_t number, char name[APC_AUTHOR_LEN]);
int apc_pg_keep_history(struct apc_store *store);
int apc_pg_is_history(struct apc_store *store);
int apc_pg_ask(struct apc_store *store, struct apc_request *request);
int apc_pg_asked(struct apc_store *store, int64_t id, char *outcome, size_t size);
int apc_pg_describe(struct apc_store *store, const struct apc_tag *tags, size_t n, const char *catalogue);
int apc_pg_catalogue_at(struct apc_store *store, apc_ns time, char *text, size_t size, int64_t *revision);
int apc_pg_catalogue(struct apc_store *store, char *text, size_t size, int64_t *revision);
int apc_pg_requests(struct apc_store *store, apc_request_fn fn, void *ctx);
int apc_pg_answer(struct apc_store *store, int64_t id, int64_t seq, const char *outcome);
int apc_pg_release(struct apc_store *store, const struct apc_sample *variables, size_t n);
int apc_pg_holder(struct apc_store *store, const struct apc_sample *variable, uint64_t *holder);
int apc_pg_seize(struct apc_store *store, struct apc_sample *variables, size_t n, uint64_t holder);
int apc_pg_vectors(struct apc_store *store, enum apc_table table, int id, const struct apc_range *range,
                   apc_vector_fn fn, void *ctx);
int apc_pg_init(struct apc_store *store);
int apc_pg_maintain(struct apc_store *store, const struct apc_retention *keep);
int apc_pg_plants(struct apc_store *store, apc_plant_fn fn, void *ctx);
/** Pack the weeks that ended before @p before. Returns how many tables' weeks were packed, or an error. */
int apc_pg_pack(struct apc_pg *pg, apc_ns before);
/** Has the schema tables of chunks? 1, 0 or an error. Within an operation that has begun. */
int apc_pg_has_chunks(struct apc_pg *pg);
int apc_pg_variables(struct apc_store *store, struct apc_sample *variables, size_t capacity);
int apc_pg_history(struct apc_store *store, enum apc_table table, int id, const struct apc_range *range,
                   apc_sample_fn fn, void *ctx);
int apc_pg_newest_within(struct apc_store *store, struct apc_sample *samples, size_t n, apc_ns since,
                         apc_ns until);
int apc_pg_history_bins(struct apc_store *store, enum apc_table table, int id, apc_ns since, apc_ns until,
                        size_t n, apc_history_bin_fn fn, void *ctx);
int apc_pg_get_tags(struct apc_store *store, struct apc_tag *tags, size_t capacity);
int apc_pg_append_events(struct apc_store *store, const struct apc_event *events, size_t n);
int apc_pg_events(struct apc_store *store, const struct apc_range *range, apc_event_fn fn, void *ctx);
int apc_pg_append_timing(struct apc_store *store, const struct apc_timing_row *rows, size_t n);
int apc_pg_timing(struct apc_store *store, const struct apc_range *range, apc_timing_fn fn, void *ctx);

#endif

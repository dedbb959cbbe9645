/* SPDX-License-Identifier: BSD-3-Clause */
/*
 * The SQLite store, shared by its files: sqlite.c (connecting, transactions, errors, the ticks' operations),
 * sqlite_blocks.c (where samples are and how they are found), sqlite_history.c (history, bins, housekeeping),
 * sqlite_pack.c (packing old samples), sqlite_vectors.c (vectors), sqlite_records.c (tags, events, timing),
 * sqlite_claim.c (claims, waiting for a change) and sqlite_schema.c (the tables).
 */
#ifndef APC_SQLITE_H
#define APC_SQLITE_H

#include <limits.h>
#include <sqlite3.h>
#include <sys/types.h>

#include "shareddata/pack.h"
#include "shareddata/shareddata_internal.h"

#define APC_SQLITE_APPLICATION 0x61706331 /* "apc1", in the file's header */
#define APC_SQLITE_BLOCK       64 /* samples of a full block; a late sample splits one of twice as many */

/** Statements that are prepared once a connection. */
enum apc_sqlite_sql {
    APC_SQLITE_READ, /* BEGIN ... */
    APC_SQLITE_WRITE,
    APC_SQLITE_COMMIT,
    APC_SQLITE_ROLLBACK,
    APC_SQLITE_NEWEST,       /* ?1 variable */
    APC_SQLITE_MARK,         /* changes nothing, but puts page 1 into the journal first of all */
    APC_SQLITE_VARIABLE,     /* ?1 variable */
    APC_SQLITE_GROW,         /* ?1 variable, ?2 seq, ?3 time: the growing block by one sample */
    APC_SQLITE_LAST_POS,     /* of all samples */
    APC_SQLITE_PUT_VARIABLE, /* ?1 variable, then struct apc_sqlite_block */
    APC_SQLITE_NEXT_BLOCK,   /* ?1 variable, ?2 seq or above, ?3 since, ?4 until */
    APC_SQLITE_FORMER_BLOCK, /* ?1 variable, ?2 below seq, ?3 since, ?4 until */
    APC_SQLITE_PUT_BLOCK,    /* as PUT_VARIABLE */
    APC_SQLITE_DROP_BLOCK,   /* ?1 variable, ?2 seq */
    APC_SQLITE_ROWS_UP,      /* ?1 pos: from it on */
    APC_SQLITE_ROWS_DOWN,
    APC_SQLITE_INSERT,
    APC_SQLITE_LINK,        /* ?1 pos, ?2 previous */
    APC_SQLITE_DROP_SAMPLE, /* ?1 pos */
    APC_SQLITE_STATEMENTS
};

/**
 * Samples of one variable that follow each other in seq. Each row names the place of the one before it, so
 * the block is read backwards from its last one. A variable's newest block, which is still growing, is its
 * row of table variable (count 0: none; seq and pos are the newest sample's all the same). A block that is
 * packed has pos below 0, and its samples' seqs follow each other without a gap (sqlite_pack.c).
 */
struct apc_sqlite_block {
    int64_t seq, pos; /* of the last sample */
    int64_t count;
    int64_t first, last; /* earliest and latest time among them, us */
};

struct apc_sqlite_row {
    int64_t pos;
    struct apc_sample sample;
};

/** The block whose rows are at hand, in rising seq. */
struct apc_sqlite_loaded {
    int64_t variable; /* -1: none */
    struct apc_sqlite_block block;
    size_t n;
    struct apc_sqlite_row rows[APC_PACK_MAX];
};

struct apc_sqlite {
    struct apc_store base;
    char given[PATH_MAX]; /* as in the URI, made absolute */
    char path[PATH_MAX];  /* of the open file, without symbolic links */
    sqlite3 *db;          /* NULL: not open */
    sqlite3_stmt *statements[APC_SQLITE_STATEMENTS];
    dev_t device; /* of the open file */
    ino_t inode;
    apc_ns deadline;               /* of the running operation, monotonic */
    uint64_t random;               /* of the jitter of pauses */
    int64_t pos;                   /* of the newest row, in a transaction that has inserted some; else 0 */
    struct apc_sqlite_block grown; /* what the last GROW found */
    struct apc_sqlite_loaded loaded;
    int claims;      /* the lock file; -1: not open */
    uint32_t record; /* as a claimant; 0: none */
    bool fresh;      /* what a former one of that number claimed is not cleared yet */
    struct apc_claims claimed;
    bool reopened;     /* maybe another file: it has to be told of them */
    int watch;         /* inotify on the open file; -1: none */
    uint64_t *element; /* of the vector at hand, each with its little end first */
    size_t n_elements, room;
};

static inline struct apc_sqlite *apc_sqlite_of(struct apc_store *store)
{
    return (struct apc_sqlite *)store;
}

/* ---- sqlite.c ------------------------------------------------------------------------------- */

/** Prepare the statements, but for transactions, once the tables are there. */
int apc_sqlite_prepare_all(struct apc_sqlite *sq);
/** Open the file, make it first when @p make; without a look at what is in it then. */
int apc_sqlite_open(struct apc_sqlite *sq, bool make);
/** Make an empty file of that name, for its user alone, where there is none. */
int apc_sqlite_make(struct apc_sqlite *sq, const char *path);
/** Begin an operation: set its deadline, open the file when it is not, or is another one now. */
int apc_sqlite_enter(struct apc_sqlite *sq);
/** Begin a transaction: APC_SQLITE_READ or APC_SQLITE_WRITE. On failure there is none. */
int apc_sqlite_begin(struct apc_sqlite *sq, enum apc_sqlite_sql how);
/** Both at once. */
int apc_sqlite_enter_begin(struct apc_sqlite *sq, enum apc_sqlite_sql how);
/** End it: commit when @p result is 0 or above, else roll back. Returns @p result, or why it cannot commit. */
int apc_sqlite_end(struct apc_sqlite *sq, int result);
/** Close the file. The next operation opens it anew. */
void apc_sqlite_drop(struct apc_sqlite *sq);

/** Take a statement from the cache; its parameters are still those of its last use. */
sqlite3_stmt *apc_sqlite_use(struct apc_sqlite *sq, enum apc_sqlite_sql which);
/** Step to the row at @p pos with ROWS_UP or ROWS_DOWN; @p from: where it stands, 0: nowhere. A row nearby is stepped to
 * and another looked up. Returns 1, 0 when it is not there, or an error; who ends before that resets the statement. */
int apc_sqlite_find_row(struct apc_sqlite *sq, enum apc_sqlite_sql which, int64_t from, int64_t pos);
/** Prepare one that is used seldom. */
int apc_sqlite_prepare(struct apc_sqlite *sq, const char *sql, sqlite3_stmt **statement);
/** One step: 1 for a row, 0 when it is done, or an error. Done or failed it is reset. */
int apc_sqlite_step(struct apc_sqlite *sq, sqlite3_stmt *statement);
/** Run SQL text, maybe several commands. */
int apc_sqlite_run(struct apc_sqlite *sq, const char *sql);
/** Fail with SQLite's error number and text. */
int apc_sqlite_fail(struct apc_sqlite *sq, int code);
/** Fail because what is in the file contradicts itself. */
int apc_sqlite_damaged(struct apc_sqlite *sq);

/** Times are kept as whole microseconds; a bound is the next whole one (0: @p none). */
int64_t apc_sqlite_time(apc_ns utc);
int64_t apc_sqlite_bound(apc_ns utc, int64_t none);
apc_ns apc_sqlite_ns(int64_t us);

/* ---- sqlite_schema.c ------------------------------------------------------------------------ */

/** What a file must say of itself to be used: 0, or APC_ESCHEMA. */
int apc_sqlite_check(struct apc_sqlite *sq);
/** 0: the file is empty or ours, of whatever version; APC_ESCHEMA: another program's, or of a newer libapc. */
int apc_sqlite_another(struct apc_sqlite *sq);
int apc_sqlite_init(struct apc_store *store);

/* ---- sqlite_blocks.c: within a transaction -------------------------------------------------- */

/** A variable in the file. */
static inline int64_t apc_sqlite_variable(enum apc_table table, int id)
{
    return (int64_t)id * 16 + (int64_t)table;
}

/** Make the SQL function that GROW needs. Returns SQLite's error number. */
int apc_sqlite_make_function(struct apc_sqlite *sq);
/** The newest sample of @p s's table and id, as apc_store_read() gives it. */
int apc_sqlite_newest(struct apc_sqlite *sq, struct apc_sample *s);
/** Returns 1 when it was stored, 0 when its seq is taken, or an error. */
int apc_sqlite_append_one(struct apc_sqlite *sq, const struct apc_sample *s);
/** After a sample: where it is the mode of all, that of each loop. Returns 0 or an error. */
int apc_sqlite_append_loops(struct apc_sqlite *sq, const struct apc_sample *s);
/** The first block that reaches @p seq or beyond and may have samples of since <= time < until. 1, 0 or
 * error. */
int apc_sqlite_next_block(struct apc_sqlite *sq, int64_t variable, int64_t seq, int64_t since, int64_t until,
                          struct apc_sqlite_block *b);
/** The last such block that ends below @p seq; INT64_MAX: the growing one too. */
int apc_sqlite_former_block(struct apc_sqlite *sq, int64_t variable, int64_t seq, int64_t since,
                            int64_t until, struct apc_sqlite_block *b);
/** Bring a block's rows into sq->loaded. */
int apc_sqlite_load(struct apc_sqlite *sq, int64_t variable, const struct apc_sqlite_block *b);
/** Make the @p n rows, or the chunk at @p pos that they became (0: they are rows), a block. */
int apc_sqlite_put_rows(struct apc_sqlite *sq, int64_t variable, const struct apc_sqlite_row *rows, size_t n,
                        int64_t pos);
/** Drop the samples before @p before (us) of the block at hand, but not the variable's newest. Returns how
 * many. */
int apc_sqlite_trim(struct apc_sqlite *sq, int64_t before);

/* ---- sqlite_pack.c -------------------------------------------------------------------------- */

/** The samples of a packed block into sq->loaded.rows. */
int apc_sqlite_load_packed(struct apc_sqlite *sq, int64_t variable, const struct apc_sqlite_block *b);
/** Its chunk goes. */
int apc_sqlite_drop_packed(struct apc_sqlite *sq, const struct apc_sqlite_block *b);
/** Pack what is older. Returns how many chunks were made, or an error. */
int apc_sqlite_pack(struct apc_sqlite *sq, apc_ns before);

/* ---- sqlite_vectors.c ------------------------------------------------------------------------ */

int apc_sqlite_read_rows(struct apc_store *store, struct apc_rows *rows);
int apc_sqlite_append_rows(struct apc_store *store, const struct apc_rows *rows);
int apc_sqlite_vectors(struct apc_store *store, enum apc_table table, int id, const struct apc_range *range,
                       apc_vector_fn fn, void *ctx);

/* ---- sqlite_claim.c ------------------------------------------------------------------------- */

int apc_sqlite_claim(struct apc_store *store, struct apc_sample *variables, size_t n);
int apc_sqlite_release(struct apc_store *store, const struct apc_sample *variables, size_t n);
/** After the file was opened, or whenever claims are held: are they still? Else take them again. */
int apc_sqlite_renew_claims(struct apc_sqlite *sq);
int apc_sqlite_wait(struct apc_store *store, const struct apc_sample *seen, size_t n, apc_ns timeout);
#define APC_SQLITE_HOLDER 128 /* bytes for a claimant's name */
/** A claimant who lives, in text. Returns 1, 0: there is none, or an error. */
int apc_sqlite_holder(struct apc_sqlite *sq, char text[APC_SQLITE_HOLDER]);

/* ---- sqlite_journal.c, sqlite_restore.c ------------------------------------------------------ */

/** A file that has just been opened: 0, or APC_ESTORE: what is called its journal is another file's. */
int apc_sqlite_check_journal(struct apc_sqlite *sq);
int apc_sqlite_restore(struct apc_store *store, const char *from, char *kept, size_t size);

/* ---- sqlite_history.c ------------------------------------------------------------------------ */

/** The lowest variable above @p variable: 1, 0 at the end, or an error. */
int apc_sqlite_next_variable(struct apc_sqlite *sq, int64_t *variable);
/** Gives a row at hand to the caller: 1, 0 when the caller ends it, or an error. It may use the file. */
typedef int (*apc_sqlite_give_fn)(struct apc_sqlite *sq, const struct apc_sqlite_row *row, void *ctx);
/** All rows of a variable within the range, in rising seq. Returns how many were given, or an error. */
int apc_sqlite_walk(struct apc_sqlite *sq, enum apc_table table, int id, const struct apc_range *range,
                    apc_sqlite_give_fn give, void *ctx);

/* ---- sqlite_history.c, sqlite_records.c: operations ----------------------------------------- */

int apc_sqlite_variables(struct apc_store *store, struct apc_sample *variables, size_t capacity);
int apc_sqlite_history(struct apc_store *store, enum apc_table table, int id, const struct apc_range *range,
                       apc_sample_fn fn, void *ctx);
int apc_sqlite_history_bins(struct apc_store *store, enum apc_table table, int id, apc_ns since, apc_ns until,
                            size_t n, apc_history_bin_fn fn, void *ctx);
int apc_sqlite_maintain(struct apc_store *store, const struct apc_retention *keep);
int apc_sqlite_author(struct apc_store *store, const char *name);
int apc_sqlite_author_name(struct apc_store *store, uint32_t number, char name[APC_AUTHOR_LEN]);
int apc_sqlite_describe(struct apc_store *store, const struct apc_tag *tags, size_t n, const char *catalogue);
int apc_sqlite_catalogue_at(struct apc_store *store, apc_ns time, char *text, size_t size, int64_t *revision);
int apc_sqlite_catalogue(struct apc_store *store, char *text, size_t size, int64_t *revision);
int apc_sqlite_is_history(struct apc_store *store);
int apc_sqlite_ask(struct apc_store *store, struct apc_request *request);
int apc_sqlite_keep_history(struct apc_store *store);
/** In a transaction that is to write what people write: 0, APC_EPERM: the file is a history, or an error. */
int apc_sqlite_check_live(struct apc_sqlite *sq);
int apc_sqlite_get_tags(struct apc_store *store, struct apc_tag *tags, size_t capacity);
int apc_sqlite_append_events(struct apc_store *store, const struct apc_event *events, size_t n);
int apc_sqlite_events(struct apc_store *store, const struct apc_range *range, apc_event_fn fn, void *ctx);
int apc_sqlite_append_timing(struct apc_store *store, const struct apc_timing_row *rows, size_t n);
int apc_sqlite_timing(struct apc_store *store, const struct apc_range *range, apc_timing_fn fn, void *ctx);

#endif

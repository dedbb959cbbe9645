/* SPDX-License-Identifier: BSD-3-Clause */
/*
 * The SQLite store where it is itself: what a file may be wrong with, who else may have it open, writers that
 * are killed, and the chains of samples against a model of them.
 */
#include <errno.h>
#include <fcntl.h>
#include <inttypes.h>
#include <limits.h>
#include <pthread.h>
#include <signal.h>
#include <sqlite3.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/resource.h>
#include <sys/stat.h>
#include <sys/wait.h>
#include <time.h>
#include <unistd.h>

#include "apcstore.h"
#include "check.h"
#include "scratch.h"
#include "shareddata/sqlite/sqlite.h"

/* ---- Stores and samples ------------------------------------------------------------------------ */

#define SECOND APC_NS_PER_S

static char path[200], uri[220]; /* of this test's file */

static struct apc_store *open_named(const char *name, apc_ns timeout)
{
    struct apc_store *store = NULL;
    struct apc_error why = {""};
    struct apc_store_options options = {.size = sizeof options, .name = "test", .timeout = timeout};
    if (apc_store_open(&store, name, &options, &why) != 0) {
        fail_msg("%s", why.text);
    }
    return store;
}

static struct apc_store *open_store(apc_ns timeout)
{
    return open_named(uri, timeout);
}

static int set_up_nothing(void **state)
{
    static int number;
    snprintf(path, sizeof path, "%s/%d.db", scratch_folder(), ++number);
    snprintf(uri, sizeof uri, "sqlite:%s", path);
    *state = open_store(20 * SECOND);
    return 0;
}

static int set_up(void **state)
{
    set_up_nothing(state);
    return apc_store_init(*state) != 0;
}

/* Whatever was done: no statement is left behind, and none holds the file. */
static int tear_down(void **state)
{
    sqlite3 *db = apc_sqlite_of(*state)->db;
    sqlite3_stmt *statement = NULL;
    int n = 0;
    while (db && (statement = sqlite3_next_stmt(db, statement)) != NULL) {
        assert_false(sqlite3_stmt_busy(statement));
        n++;
    }
    assert_true(n <= APC_SQLITE_STATEMENTS);
    apc_store_close(*state);
    return 0;
}

static struct apc_sample sample(enum apc_table table, int id, int64_t seq, double value)
{
    return (struct apc_sample){.table = table, .id = id, .seq = seq, .time = seq * 1000, .value = value};
}

static int append_one(struct apc_store *store, int id, int64_t seq)
{
    struct apc_sample s = sample(APC_SENSOR, id, seq, (double)seq);
    return apc_store_append(store, &s, 1);
}

static int64_t newest_seq(struct apc_store *store, int id)
{
    struct apc_sample s = {.table = APC_SENSOR, .id = id};
    int err = apc_store_read(store, &s, 1);
    return err ? err : s.seq;
}

#define assert_said(store, call, err, text)                                                                  \
    do {                                                                                                     \
        int said_result = (int)(call);                                                                       \
        if (said_result != (err) || !strstr(apc_store_error(store), text))                                   \
            fail_msg("%s: %s: %s", #call, apc_err_name(said_result), apc_store_error(store));                \
    } while (0)

static void raw(const char *file, const char *sql)
{
    sqlite3 *db = NULL;
    assert_int_equal(sqlite3_open(file, &db), SQLITE_OK);
    assert_int_equal(sqlite3_exec(db, sql, NULL, NULL, NULL), SQLITE_OK);
    sqlite3_close(db);
}

static void write_file(const char *file, const char *text)
{
    FILE *f = fopen(file, "w");
    assert_non_null(f);
    fputs(text, f);
    assert_int_equal(fclose(f), 0);
}

/* ---- The chains against a model ---------------------------------------------------------------- */

enum { MODEL_IDS = 3, MODEL_SEQS = 1500 };

static struct model {
    bool there[MODEL_SEQS + 1];
    apc_ns time[MODEL_SEQS + 1];
} model[MODEL_IDS];

static uint64_t seed;

static int64_t random_below(int64_t n)
{
    seed = seed * UINT64_C(6364136223846793005) + UINT64_C(1442695040888963407);
    return (int64_t)((seed >> 33) % (uint64_t)n);
}

static int64_t model_newest(const struct model *m)
{
    int64_t seq = MODEL_SEQS;
    while (seq > 0 && !m->there[seq]) {
        seq--;
    }
    return seq;
}

/* Some samples: the next ones, with gaps, or anywhere, there already or not; the clock mostly goes on. */
static void append_some(struct apc_store *store, apc_ns base)
{
    struct apc_sample s[100];
    const int n = 1 + (int)random_below(100);
    const bool late = random_below(3) == 0;
    int fresh = 0;
    int64_t next[MODEL_IDS];
    for (int id = 0; id < MODEL_IDS; id++) {
        next[id] = model_newest(&model[id]) + 1;
    }
    for (int i = 0; i < n; i++) {
        const int id = (int)random_below(MODEL_IDS);
        int64_t seq = late ? 1 + random_below(MODEL_SEQS) : next[id]++;
        next[id] += !late && random_below(20) == 0 ? random_below(5) : 0;
        seq = seq < MODEL_SEQS ? seq : MODEL_SEQS;
        struct model *m = &model[id];
        s[i] = sample(APC_SENSOR, id, seq, (double)(seq * MODEL_IDS + id));
        s[i].time = base + seq * 1000 + (random_below(10) == 0 ? (random_below(2000) - 1000) * 1000 : 0);
        if (!m->there[seq]) {
            m->there[seq] = true;
            m->time[seq] = s[i].time;
            fresh++;
        }
    }
    assert_int_equal(apc_store_append(store, s, (size_t)n), fresh);
}

struct check {
    const struct model *m;
    int id, count;
    int64_t next; /* seq from which on the model's next one must be the row's */
    struct apc_range range;
};

static bool in_range(const struct check *c, int64_t seq)
{
    return c->m->there[seq] && (c->range.since == 0 || c->m->time[seq] >= c->range.since) &&
           (c->range.until == 0 || c->m->time[seq] < c->range.until);
}

static int check_row(void *ctx, const struct apc_sample *s)
{
    struct check *c = ctx;
    while (c->next <= MODEL_SEQS && !in_range(c, c->next)) {
        c->next++;
    }
    if (s->seq != c->next || s->time != c->m->time[s->seq] ||
        !(s->value == (double)(s->seq * MODEL_IDS + c->id))) {
        fail_msg("variable %d: seq %" PRId64 " at %" PRId64 ", expected %" PRId64, c->id, s->seq, s->time,
                 c->next);
    }
    c->next++;
    c->count++;
    return 0;
}

static void check_history(struct apc_store *store, apc_ns base)
{
    const int id = (int)random_below(MODEL_IDS);
    struct check c = {.m = &model[id], .id = id, .next = 1};
    if (random_below(2)) {
        c.range.since = base + 1000 * random_below(MODEL_SEQS);
    }
    if (random_below(2)) {
        c.range.until = base + 1000 * random_below(MODEL_SEQS);
    }
    int expected = 0;
    for (int64_t seq = 1; seq <= MODEL_SEQS; seq++) {
        expected += in_range(&c, seq);
    }
    if (random_below(2)) {
        c.range.last = 1 + (size_t)random_below(300);
        for (; (size_t)expected > c.range.last; c.next++) {
            expected -= in_range(&c, c.next);
        }
    }
    assert_int_equal(apc_store_history(store, APC_SENSOR, id, &c.range, check_row, &c), expected);
    assert_int_equal(c.count, expected);
    assert_true(newest_seq(store, id) == model_newest(c.m));
}

static int sum_bin(void *ctx, const struct apc_history_bin *bin)
{
    struct check *c = ctx;
    for (int64_t seq = 1; seq <= MODEL_SEQS; seq++) {
        if (c->m->there[seq] && c->m->time[seq] >= bin->from && c->m->time[seq] < bin->until) {
            c->count++;
        }
    }
    c->next += (int64_t)bin->count;
    return 0;
}

static void check_bins(struct apc_store *store, apc_ns base)
{
    const int id = (int)random_below(MODEL_IDS);
    struct check c = {.m = &model[id], .id = id};
    const apc_ns since = base + random_below(1000000), until = since + 1 + random_below(2000000);
    assert_true(apc_store_history_bins(store, APC_SENSOR, id, since, until, 1 + (size_t)random_below(50),
                                       sum_bin, &c) >= 0);
    assert_true(c.next == c.count);
}

/* What is older goes, but for each newest one. */
static void trim_model(struct apc_store *store, apc_ns before)
{
    const struct apc_retention keep = {.size = sizeof keep, .samples = apc_clock_utc(NULL) - before};
    int dropped = 0;
    for (int id = 0; id < MODEL_IDS; id++) {
        const int64_t newest = model_newest(&model[id]);
        for (int64_t seq = 1; seq < newest; seq++) {
            if (model[id].there[seq] && model[id].time[seq] < before) {
                model[id].there[seq] = false;
                dropped++;
            }
        }
    }
    assert_int_equal(apc_store_maintain(store, &keep), dropped);
}

static void test_samples_in_any_order_are_found_as_a_model_finds_them(void **state)
{
    const char *given = getenv("APC_TEST_SEED");
    seed = given ? strtoull(given, NULL, 0) : (uint64_t)apc_clock_mono(NULL);
    print_message("APC_TEST_SEED=%" PRIu64 "\n", seed);
    memset(model, 0, sizeof model);
    /* An hour apart from what the trimming below keeps: the time that passes meanwhile decides nothing. */
    const apc_ns base = (apc_clock_utc(NULL) - 3600 * SECOND) / 1000 * 1000;
    for (int round = 0; round < 150; round++) {
        append_some(*state, base);
        check_history(*state, base);
        check_bins(*state, base);
    }
    for (int id = 0; id < MODEL_IDS; id++) { /* far in the future of the rest: these stay */
        struct apc_sample s = sample(APC_SENSOR, id, MODEL_SEQS, (double)(MODEL_SEQS * MODEL_IDS + id));
        s.time = base + 2 * 3600 * SECOND;
        bool fresh = !model[id].there[MODEL_SEQS];
        assert_int_equal(apc_store_append(*state, &s, 1), fresh);
        if (fresh) {
            model[id].there[MODEL_SEQS] = true;
            model[id].time[MODEL_SEQS] = s.time;
        }
    }
    trim_model(*state, base + 1800 * SECOND);
    for (int round = 0; round < 50; round++) { /* where something was dropped, there is room again */
        append_some(*state, base + 7200 * SECOND);
        check_history(*state, base);
    }
}

/* ---- What a file may be wrong with ------------------------------------------------------------- */

static void test_a_path_that_is_none_is_refused(void **state)
{
    struct apc_store *store = *state;
    struct apc_error why;
    char longest[5000] = "sqlite:/";
    memset(longest + 8, 'x', sizeof longest - 9);
    assert_int_equal(apc_store_open(&store, "sqlite:", NULL, &why), APC_EINVAL);
    assert_non_null(strstr(why.text, "sqlite:FILE"));
    assert_int_equal(apc_store_open(&store, longest, NULL, &why), APC_EINVAL);
    assert_null(store);
}

/* Wherever the program goes afterwards. */
static void test_a_path_is_from_where_the_program_was_when_it_opened_it(void **state)
{
    char here[4096], at[300];
    (void)state;
    assert_non_null(getcwd(here, sizeof here));
    snprintf(at, sizeof at, "%s/named.db", scratch_folder());
    assert_int_equal(chdir(scratch_folder()), 0);
    struct apc_store *store = open_named("sqlite:named.db", 20 * SECOND);
    assert_int_equal(chdir("/"), 0);
    const int made = apc_store_init(store), stored = append_one(store, 1, 1), there = access(at, F_OK);
    apc_store_close(store);
    assert_int_equal(chdir(here), 0);
    if (made != 0 || stored != 1 || there != 0)
        fail_msg("made %d, stored %d, there %d", made, stored, there);
}

static void test_a_file_that_is_not_there_is_not_made_by_using_it(void **state)
{
    assert_said(*state, newest_seq(*state, 1), APC_ECONN, "apc init");
    assert_said(*state, append_one(*state, 1, 1), APC_ECONN, path);
    assert_int_equal(access(path, F_OK), -1);
    assert_int_equal(apc_store_init(*state), 0);
    assert_int_equal(append_one(*state, 1, 1), 1); /* and the same store goes on */

    struct apc_store *store = open_named("sqlite:/no/such/folder/x.db", SECOND);
    assert_said(store, apc_store_init(store), APC_ECONN, "/no/such/folder/x.db");
    apc_store_close(store);
    char text[300];
    snprintf(text, sizeof text, "sqlite:%s", scratch_folder());
    store = open_named(text, SECOND);
    assert_said(store, newest_seq(store, 1), APC_EINVAL, "is no file");
    assert_said(store, apc_store_init(store), APC_EINVAL, "is no file");
    apc_store_close(store);
}

static void test_a_file_that_is_not_ours_is_refused_and_left_alone(void **state)
{
    struct apc_store *store = *state;
    static const char text[] =
        "Dear diary, this is more than a hundred bytes of text that nobody wants to lose, "
        "least of all to a control system.\n";
    write_file(path, text);
    assert_said(store, newest_seq(store, 1), APC_ESCHEMA, "no SQLite database");
    assert_said(store, apc_store_init(store), APC_ESCHEMA, "no SQLite database");
    char read_back[sizeof text];
    FILE *f = fopen(path, "r");
    assert_true(fgets(read_back, sizeof read_back, f) && strcmp(read_back, text) == 0);
    fclose(f);
    unlink(path);

    raw(path, "CREATE TABLE recipe (name TEXT)");
    assert_said(store, newest_seq(store, 1), APC_ESCHEMA, "another program's");
    assert_said(store, apc_store_init(store), APC_ESCHEMA, "another program's");
    unlink(path);
    raw(path, "PRAGMA application_id = 252006674; CREATE TABLE sample (x)");
    assert_said(store, apc_store_init(store), APC_ESCHEMA, "another program's");
    unlink(path);

    write_file(path, ""); /* an empty file is an empty database: anybody's */
    assert_said(store, newest_seq(store, 1), APC_ESCHEMA, "apc init");
    assert_int_equal(apc_store_init(store), 0);
    assert_int_equal(append_one(store, 1, 1), 1);
}

static int64_t raw_number(const char *file, const char *sql)
{
    sqlite3 *db = NULL;
    sqlite3_stmt *statement = NULL;
    assert_int_equal(sqlite3_open(file, &db), SQLITE_OK);
    assert_int_equal(sqlite3_prepare_v2(db, sql, -1, &statement, NULL), SQLITE_OK);
    assert_int_equal(sqlite3_step(statement), SQLITE_ROW);
    int64_t n = sqlite3_column_int64(statement, 0);
    sqlite3_finalize(statement);
    sqlite3_close(db);
    return n;
}

/*
 * Promise(database/before-release-file): A SQLite file of before the first release is refused with the way
 *   out, and left alone.
 */
static void test_another_version_is_refused(void **state)
{
    struct apc_store *store = open_store(SECOND);
    assert_int_equal(append_one(*state, 1, 1), 1);
    const int64_t version = raw_number(path, "PRAGMA user_version");
    raw(path, "PRAGMA user_version = 999");
    assert_said(store, newest_seq(store, 1), APC_ESCHEMA, "upgrade libapc");
    assert_said(store, apc_store_init(store), APC_ESCHEMA, "upgrade libapc");
    raw(path, "PRAGMA user_version = 0");
    assert_said(store, newest_seq(store, 1), APC_ESCHEMA, "apc init");
    char sql[60];
    for (int former = 1; former < version; former++) { /* from before the first release */
        snprintf(sql, sizeof sql, "PRAGMA user_version = %d", former);
        raw(path, sql);
        assert_said(store, newest_seq(store, 1), APC_ESCHEMA, "run apc init of commit");
        assert_said(store, apc_store_init(store), APC_ESCHEMA, "run apc init of commit");
        assert_int_equal(raw_number(path, "PRAGMA user_version"), former);
    }
    snprintf(sql, sizeof sql, "PRAGMA user_version = %d", (int)version);
    raw(path, sql);
    assert_int_equal(newest_seq(store, 1), 1);
    apc_store_close(store);
}

/*
 * Promise(stores/file-history-nobody): In a file that is a history nobody sets, tunes, switches or
 *   acknowledges; a row that somebody wrote past the historian is told, and another run's rows are refused.
 */
static void test_people_write_nothing_to_a_history(void **state)
{
    struct apc_store *store = *state;
    const struct apc_tag tag = {.table = APC_SETPOINT, .id = 1, .name = "r"};
    struct apc_sample r = sample(APC_SETPOINT, 1, 1, 5);
    assert_int_equal(apc_store_keep_history(store), 0); /* nothing is described yet */
    assert_int_equal(apc_store_describe(store, &tag, 1, "name = \"plant\";"), 1);
    assert_int_equal(apc_store_append(store, &r, 1), 1);
    assert_int_equal(apc_store_is_history(store), 0);
    assert_int_equal(apc_store_put(store, &r, 1), 0);
    assert_int_equal(apc_store_keep_history(store), 1);
    assert_int_equal(apc_store_keep_history(store), 0);
    struct apc_store *other = open_store(20 * SECOND);
    assert_int_equal(apc_store_is_history(other), 1);
    static const enum apc_table tables[] = {APC_SETPOINT, APC_OPMODE, APC_TUNING, APC_MANUAL};
    for (size_t i = 0; i < sizeof tables / sizeof *tables; i++) {
        struct apc_sample s = {.table = tables[i], .id = 1, .seq = tables[i] == APC_SETPOINT ? 2 : 0};
        const struct apc_rows rows = {.size = sizeof rows, .sample = &s, .n_samples = 1};
        assert_int_equal(apc_store_put(other, &s, 1), APC_EPERM);
        assert_non_null(strstr(apc_store_error(other), "is a history"));
        s.seq = tables[i] == APC_SETPOINT ? 2 : 0;
        assert_int_equal(apc_store_swap(other, &s, 1), APC_EPERM);
        assert_int_equal(apc_store_append_rows(other, &rows), APC_EPERM);
        struct apc_request request = {.table = tables[i], .variable = 1, .author = "test"};
        assert_int_equal(apc_store_ask(other, &request), APC_EPERM);
    }
    r.seq = 3; /* its historian does */
    assert_int_equal(apc_store_append(other, &r, 1), 1);
    assert_int_equal(apc_store_describe(other, &tag, 1, "name = \"plant\"; # again"), 1);
    assert_int_equal(apc_store_is_history(other), 1); /* a new text is of the same kind */
    apc_store_close(other);
}

static int count_sample(void *ctx, const struct apc_sample *s)
{
    (void)s;
    ++*(int *)ctx;
    return 0;
}

static int drop_the_third(void *ctx, const struct apc_vector *v)
{
    int64_t *sum = ctx;
    if (v->seq == 1) {
        raw(path, "DELETE FROM sample WHERE variable = 28 AND seq = 3");
    }
    *sum = *sum * 10 + v->seq;
    return 0;
}

/* While the caller has one vector, another is trimmed away: those after it are given all the same. */
static void test_a_vector_that_goes_meanwhile_is_left_out(void **state)
{
    struct apc_store *store = *state;
    double value = 1;
    struct apc_vector v = {.table = APC_TICK, .id = 1, .n = 1, .value = &value};
    const struct apc_rows rows = {.size = sizeof rows, .vector = &v, .n_vectors = 1};
    int64_t sum = 0;
    for (v.seq = 1; v.seq <= 5; v.seq++) {
        assert_int_equal(apc_store_append_rows(store, &rows), 1);
    }
    assert_true(apc_store_vectors(store, APC_TICK, 1, NULL, drop_the_third, &sum) >= 4);
    assert_int_equal(sum, 1245);
}

static void test_a_file_in_a_folder_that_is_not_there_says_so(void **state)
{
    struct apc_store *store;
    (void)state;
    snprintf(uri, sizeof uri, "sqlite:%s/none/such.db", scratch_folder());
    store = open_store(20 * SECOND);
    assert_said(store, apc_store_init(store), APC_ECONN, "cannot be made: its folder: No such file");
    apc_store_close(store);
}

/* Promise(stores/sqlite-0600-writer) */
static void test_a_write_ahead_log_goes_or_is_refused(void **state)
{
    struct apc_store *store = *state;
    sqlite3 *db = NULL;
    assert_int_equal(append_one(store, 1, 1), 1);
    apc_store_close(store);
    raw(path, "PRAGMA journal_mode = WAL");
    assert_int_equal(sqlite3_open(path, &db), SQLITE_OK);
    assert_int_equal(sqlite3_exec(db, "SELECT count(*) FROM sample", NULL, NULL, NULL), SQLITE_OK);
    *state = store = open_store(SECOND / 10);
    int err = append_one(store, 1, 2); /* somebody has the log open */
    assert_true(err == APC_ESTORE || err == APC_ETIMEDOUT);
    sqlite3_close(db);
    assert_int_equal(append_one(store, 1, 2), 1);
    char file[300];
    snprintf(file, sizeof file, "%s-wal", path);
    assert_int_equal(access(file, F_OK), -1);
}

/* ---- A backup in a file's place ----------------------------------------------------------------- */

/* A process that is killed in the middle of a transaction, part of which is in the file already. */
static void leave_a_journal(void)
{
    const pid_t child = fork();
    assert_true(child >= 0);
    if (child == 0) {
        struct apc_sqlite *sq = apc_sqlite_of(open_store(SECOND));
        if (apc_sqlite_enter(sq) == 0 && apc_sqlite_run(sq, "PRAGMA cache_size = 4") == 0 &&
            apc_sqlite_begin(sq, APC_SQLITE_WRITE) == 0) {
            apc_sqlite_run(
                sq, "UPDATE sample SET value = -1; WITH RECURSIVE c(i) AS (SELECT 1 UNION ALL SELECT i + 1 "
                    "FROM c WHERE i < 5000) INSERT INTO event (time, severity, source, kind, text) SELECT "
                    "i, 1, 'x', 'x', i FROM c; UPDATE sample SET value = -2");
        }
        _exit(0);
    }
    assert_int_equal(waitpid(child, NULL, 0), child);
}

static int count_value(void *ctx, const struct apc_sample *s)
{
    *(int *)ctx += s->value == (double)s->seq;
    return 0;
}

/* Rows that are as they were appended. */
static int rows_of(struct apc_store *store)
{
    int n = 0;
    const int err = apc_store_history(store, APC_SENSOR, 1, NULL, count_value, &n);
    return err < 0 ? err : n;
}

static void append_up_to(struct apc_store *store, int64_t first, int64_t last)
{
    for (int64_t seq = first; seq <= last; seq++) {
        assert_int_equal(append_one(store, 1, seq), 1);
    }
}

static void make_backup(char backup[300])
{
    char sql[400];
    snprintf(backup, 300, "%s.backup", path);
    snprintf(sql, sizeof sql, "VACUUM INTO '%s'", backup);
    raw(path, sql);
}

/* Promise(database/backup-put-file) */
static void test_a_journal_of_another_file_is_told_and_a_files_own_is_rolled_back(void **state)
{
    char backup[300], journal[300];
    append_up_to(*state, 1, 30);
    make_backup(backup);
    append_up_to(*state, 31, 60);
    apc_store_close(*state);
    leave_a_journal();
    *state = open_store(SECOND);
    assert_int_equal(rows_of(*state), 60); /* its own */
    apc_store_close(*state);
    leave_a_journal();
    assert_int_equal(rename(backup, path), 0); /* as one would put a backup back */
    *state = open_store(SECOND);
    assert_said(*state, apc_store_connect(*state), APC_ESTORE, "-journal is of another file");
    assert_said(*state, append_one(*state, 1, 31), APC_ESTORE, "move it away");
    snprintf(journal, sizeof journal, "%s-journal", path);
    assert_int_equal(unlink(journal), 0);
    assert_int_equal(rows_of(*state), 30); /* the backup is as it was */
    append_up_to(*state, 31, 40);
    assert_int_equal(rows_of(*state), 40);
}

/*
 * Promise(database/backup-put-file): A backup is put in a file's place at once, what was there is kept, and
 *   what is no backup or has a writer is left as it is; a journal of a former file is recognised, and
 *   spoils none.
 */
static void test_a_backup_is_restored_at_once_and_what_was_there_is_kept(void **state)
{
    char backup[300], kept[400], named[420];
    append_up_to(*state, 1, 30);
    make_backup(backup);
    append_up_to(*state, 31, 60);
    struct apc_store *reader = open_store(SECOND);
    assert_int_equal(rows_of(reader), 60);
    leave_a_journal(); /* which is rolled back first, where it belongs */
    assert_int_equal(apc_store_restore(*state, backup, kept, sizeof kept), 0);
    assert_int_equal(rows_of(*state), 30);
    assert_int_equal(rows_of(reader), 30);
    append_up_to(*state, 31, 32);
    assert_int_equal(rows_of(reader), 32);
    apc_store_close(reader);
    snprintf(named, sizeof named, "sqlite:%s", kept);
    struct apc_store *former = open_named(named, SECOND);
    assert_int_equal(rows_of(former), 60);
    apc_store_close(former);
    assert_int_equal(unlink(path), 0); /* where there is none it is made */
    assert_int_equal(apc_store_restore(*state, backup, kept, sizeof kept), 0);
    assert_string_equal(kept, "");
    assert_int_equal(rows_of(*state), 30);
}

/* Promise(database/backup-put-file) */
static void test_what_is_no_backup_or_has_a_writer_is_left_as_it_is(void **state)
{
    char backup[300], kept[400];
    struct apc_store *writer = open_store(SECOND);
    int64_t last[1];
    append_up_to(*state, 1, 30);
    make_backup(backup);
    append_up_to(*state, 31, 60);
    assert_said(*state, apc_store_restore(*state, "/nonexistent", kept, sizeof kept), APC_ENOTFOUND,
                "nonexistent");
    assert_said(*state, apc_store_restore(*state, path, kept, sizeof kept), APC_EINVAL, "itself");
    assert_int_equal(apc_store_claim(writer, APC_SENSOR, 1, last), 0);
    assert_said(*state, apc_store_restore(*state, backup, kept, sizeof kept), APC_EBUSY, "stop it first");
    apc_store_close(writer);
    const int fd = open(backup, O_WRONLY);
    memset(kept, 0x77, sizeof kept);
    for (off_t at = 4096; at < 10 * 4096; at += 4096) {
        assert_int_equal(pwrite(fd, kept, 200, at), 200);
    }
    assert_int_equal(close(fd), 0);
    assert_said(*state, apc_store_restore(*state, backup, kept, sizeof kept), APC_ESTORE, "is damaged");
    write_file(backup, "this is a letter");
    assert_said(*state, apc_store_restore(*state, backup, kept, sizeof kept), APC_ESCHEMA,
                "no record of libapc's");
    assert_int_equal(rows_of(*state), 60);
    struct apc_store *memory = open_named("mem:restore", SECOND);
    assert_said(memory, apc_store_restore(memory, backup, kept, sizeof kept), APC_EINVAL, "only a file");
    apc_store_close(memory);
}

/* Promise(stores/sqlite-0600-writer) */
static void test_a_file_for_reading_only_is_read(void **state)
{
    struct apc_store *store = open_store(SECOND);
    assert_int_equal(append_one(*state, 1, 1), 1);
    char journal[300];
    snprintf(journal, sizeof journal, "%s-journal", path);
    const bool root = geteuid() == 0; /* who may do everything */
    assert_int_equal(chmod(scratch_folder(), root ? 0755 : 0555), 0);
    assert_int_equal(chmod(path, 0444), 0);
    assert_int_equal(chmod(journal, 0444), 0);
    if (root) {
        assert_int_equal(seteuid(65534), 0);
    }
    int64_t last[1];
    int64_t read = newest_seq(store, 1);
    int written = append_one(store, 1, 2), claimed = apc_store_claim(store, APC_SENSOR, 1, last);
    struct apc_error why;
    snprintf(why.text, sizeof why.text, "%s", apc_store_error(store));
    int closed = chmod(path, 0) == 0 || root;
    if (root) {
        assert_int_equal(seteuid(0), 0);
        closed = chmod(path, 0) == 0;
        assert_int_equal(seteuid(65534), 0);
    }
    struct apc_store *other = open_store(SECOND);
    int unreadable = apc_store_connect(other);
    if (root) {
        assert_int_equal(seteuid(0), 0);
    }
    assert_int_equal(read, 1);
    assert_int_equal(written, APC_EPERM);
    assert_int_equal(claimed, APC_EPERM);
    assert_non_null(strstr(why.text, "-claims"));
    assert_true(closed);
    assert_said(other, unreadable, APC_EPERM, path);
    assert_int_equal(chmod(scratch_folder(), 0755), 0);
    assert_int_equal(chmod(path, 0644), 0);
    assert_int_equal(chmod(journal, 0644), 0);
    assert_int_equal(append_one(other, 1, 2), 1); /* the cause has gone */
    apc_store_close(other);
    apc_store_close(store);
}

/* On media that nobody can write; SQLite says "No such file or directory" of the log that it cannot make. */
static void test_a_log_that_cannot_be_made_is_told_of(void **state)
{
    apc_store_close(*state);
    raw(path, "PRAGMA journal_mode = WAL");
    const bool root = geteuid() == 0;
    assert_int_equal(chmod(scratch_folder(), root ? 0755 : 0555), 0);
    assert_int_equal(chmod(path, 0444), 0);
    if (root) {
        assert_int_equal(seteuid(65534), 0);
    }
    struct apc_store *store = open_store(SECOND);
    const int read = apc_store_connect(store);
    struct apc_error why;
    snprintf(why.text, sizeof why.text, "%s", apc_store_error(store));
    apc_store_close(store);
    if (root) {
        assert_int_equal(seteuid(0), 0);
    }
    assert_int_equal(chmod(scratch_folder(), 0755), 0);
    assert_int_equal(chmod(path, 0644), 0);
    if (read != APC_EPERM || !strstr(why.text, "write-ahead log")) {
        fail_msg("%d: %s", read, why.text);
    }
    *state = store = open_store(SECOND);
    assert_int_equal(append_one(store, 1, 1), 1); /* the cause has gone */
}

/* Promise(stores/sqlite-0600-writer) */
static void test_a_full_disk_keeps_the_whole_append_out_and_no_later_one(void **state)
{
    enum { N = 50000 };
    struct apc_sample *s = calloc(N, sizeof *s);
    struct rlimit unlimited, limit;
    assert_non_null(s);
    for (int i = 0; i < N; i++) {
        s[i] = sample(APC_SENSOR, i % 100, 2 + i / 100, i);
    }
    assert_int_equal(append_one(*state, 1, 1), 1);
    signal(SIGXFSZ, SIG_IGN);
    assert_int_equal(getrlimit(RLIMIT_FSIZE, &unlimited), 0);
    limit = (struct rlimit){.rlim_cur = 1 << 20, .rlim_max = unlimited.rlim_max};
    assert_int_equal(setrlimit(RLIMIT_FSIZE, &limit), 0);
    int full = apc_store_append(*state, s, N);
    struct apc_error why;
    snprintf(why.text, sizeof why.text, "%s", apc_store_error(*state));
    int64_t after = newest_seq(*state, 1);
    int small = append_one(*state, 1, 2);
    assert_int_equal(setrlimit(RLIMIT_FSIZE, &unlimited), 0);
    assert_int_equal(full, APC_EFULL);
    assert_non_null(strstr(why.text, "no room left"));
    assert_int_equal(after, 1);
    assert_int_equal(small, 1);
    assert_int_equal(apc_store_append(*state, s, N), N - 1);
    free(s);
}

/* Promise(stores/sqlite-0600-writer) */
static void test_a_damaged_file_gives_errors_and_no_nonsense(void **state)
{
    enum { PAGE = 4096, N = 300 };
    struct stat st;
    for (int i = 1; i <= N; i++) {
        struct apc_sample s[2] = {sample(APC_SENSOR, 1, i, i), sample(APC_SENSOR, 2, i, i)};
        assert_int_equal(apc_store_append(*state, s, 2), 2);
    }
    apc_store_close(*state);
    assert_int_equal(stat(path, &st), 0);
    int refused = 0;
    for (off_t page = 1; page < st.st_size / PAGE; page++) { /* the first one is the header */
        char whole[PAGE], junk[PAGE];
        int fd = open(path, O_RDWR);
        assert_int_equal(pread(fd, whole, PAGE, page * PAGE), PAGE);
        memset(junk, 0x5A, PAGE);
        assert_int_equal(pwrite(fd, junk, PAGE, page * PAGE), PAGE);
        close(fd);
        struct apc_store *store = open_store(SECOND);
        int n = 0, rows = apc_store_history(store, APC_SENSOR, 1, NULL, count_sample, &n);
        assert_true(rows == N || rows == APC_ESTORE || rows == APC_ESCHEMA);
        refused += rows < 0;
        apc_store_close(store);
        fd = open(path, O_RDWR);
        assert_int_equal(pwrite(fd, whole, PAGE, page * PAGE), PAGE);
        close(fd);
    }
    assert_true(refused > 0);
    *state = open_store(SECOND);
    int n = 0;
    assert_int_equal(apc_store_history(*state, APC_SENSOR, 1, NULL, count_sample, &n), N);
}

static int sum_sample(void *ctx, const struct apc_sample *s)
{
    *(int64_t *)ctx += s->seq;
    return 0;
}

/* Of a block that cannot be read whole nothing is taken for the one that was read before. */
static void test_what_is_whole_is_read_as_it_was_beside_what_is_not(void **state)
{
    enum { BLOCK = 64 };
    const struct apc_range first = {.until = BLOCK * 1000 + 1};
    for (int64_t seq = 1; seq <= 3 * BLOCK; seq++) {
        assert_int_equal(append_one(*state, 1, seq), 1);
    }
    raw(path, "UPDATE sample SET variable = 33 WHERE variable = 17 AND seq = 70");
    for (int i = 0; i < 2; i++) {
        int64_t sum = 0;
        assert_int_equal(apc_store_history(*state, APC_SENSOR, 1, &first, sum_sample, &sum), BLOCK);
        assert_int_equal(sum, BLOCK * (BLOCK + 1) / 2);
        const struct apc_range second = {.since = (BLOCK + 1) * 1000, .until = 2 * BLOCK * 1000};
        assert_true(apc_store_history(*state, APC_SENSOR, 1, &second, sum_sample, &sum) < 0);
    }
}

/* What the file refuses to give up is said, and all of its slice stays: here the first, whose end lies with
 * the clock. */
static void test_an_error_in_the_middle_of_housekeeping_is_said(void **state)
{
    enum { N = 200 };
    int n = 0;
    const struct apc_retention keep = {.size = sizeof keep, .samples = SECOND};
    const struct apc_retention records = {.size = sizeof records, .events = SECOND};
    const struct apc_event event = {.severity = APC_EVENT_INFO};
    for (int i = 1; i <= N; i++) {
        assert_int_equal(append_one(*state, 1, i), 1);
    }
    assert_int_equal(apc_store_append_events(*state, &event, 1), 1);
    raw(path, "CREATE TRIGGER no BEFORE DELETE ON sample WHEN old.seq = 30 BEGIN SELECT RAISE(ABORT, 'no, "
              "30'); END;"
              "CREATE TRIGGER nor BEFORE DELETE ON event BEGIN SELECT RAISE(ABORT, 'nor this'); END");
    assert_said(*state, apc_store_maintain(*state, &keep), APC_ESTORE, "no, 30");
    assert_said(*state, apc_store_maintain(*state, &records), APC_ESTORE, "nor this");
    assert_int_equal(apc_store_history(*state, APC_SENSOR, 1, NULL, count_sample, &n), N);
    raw(path, "DROP TRIGGER no; DROP TRIGGER nor");
    assert_int_equal(apc_store_maintain(*state, &keep), N - 1);
    assert_int_equal(apc_store_maintain(*state, &records), 1);
}

/* Whatever the umask: a record is its user's own until he says otherwise, and what stands beside it follows. */
/*
 * Promise(stores/sqlite-0600-writer): SQLite: 0600, one writer, readers hold nobody up, full disk, damage,
 *   no write-ahead log, a file that comes and goes.
 */
static void test_a_file_is_made_for_its_user_alone(void **state)
{
    char beside[700];
    struct stat st;
    int64_t last;
    const mode_t umask_before = umask(0);
    int rc = apc_store_init(*state);
    umask(umask_before);
    assert_int_equal(rc, 0);
    assert_int_equal(append_one(*state, 1, 1), 1);
    assert_int_equal(apc_store_claim(*state, APC_SENSOR, 1, &last), 0);
    static const char *const files[] = {"", "-journal", "-claims"};
    for (size_t i = 0; i < 3; i++) {
        snprintf(beside, sizeof beside, "%s%s", path, files[i]);
        assert_int_equal(stat(beside, &st), 0);
        assert_int_equal(st.st_mode & 0777, 0600);
    }
    apc_store_close(*state);
    assert_int_equal(chmod(path, 0660), 0);
    snprintf(beside, sizeof beside, "%s-claims", path);
    assert_int_equal(unlink(beside), 0);
    *state = open_store(20 * SECOND);
    const mode_t umask_again = umask(077);
    rc = apc_store_init(*state); /* and he has said otherwise */
    int claimed = apc_store_claim(*state, APC_SENSOR, 1, &last);
    umask(umask_again);
    assert_int_equal(rc, apc_store_version());
    assert_int_equal(claimed, 0);
    assert_int_equal(stat(path, &st), 0);
    assert_int_equal(st.st_mode & 0777, 0660);
    assert_int_equal(stat(beside, &st), 0);
    assert_int_equal(st.st_mode & 0777, 0660);
}

static void *give_back_later(void *db)
{
    nanosleep(&(struct timespec){.tv_nsec = 100 * 1000 * 1000}, NULL);
    return sqlite3_exec((sqlite3 *)db, "COMMIT", NULL, NULL, NULL) == SQLITE_OK ? db : NULL;
}

static void test_making_the_tables_waits_for_a_lock_as_all_else_does(void **state)
{
    sqlite3 *db = NULL;
    pthread_t thread;
    void *given_back = NULL;
    assert_int_equal(sqlite3_open(path, &db), SQLITE_OK);
    assert_int_equal(sqlite3_exec(db, "BEGIN EXCLUSIVE", NULL, NULL, NULL), SQLITE_OK);
    assert_int_equal(pthread_create(&thread, NULL, give_back_later, db), 0);
    int rc = apc_store_init(*state);
    assert_int_equal(pthread_join(thread, &given_back), 0);
    assert_ptr_equal(given_back, db);
    assert_int_equal(rc, apc_store_version());
    sqlite3_close(db);
}

/* ---- Others have it open ----------------------------------------------------------------------- */

/* Promise(stores/sqlite-0600-writer) */
static void test_a_lock_that_is_not_given_back_ends_in_a_timeout(void **state)
{
    struct apc_store *store = open_store(50 * APC_NS_PER_MS);
    sqlite3 *db = NULL;
    assert_int_equal(append_one(*state, 1, 1), 1);
    assert_int_equal(sqlite3_open(path, &db), SQLITE_OK);
    assert_int_equal(sqlite3_exec(db, "BEGIN EXCLUSIVE", NULL, NULL, NULL), SQLITE_OK);
    assert_said(store, newest_seq(store, 1), APC_ETIMEDOUT, "locked by another process");
    assert_said(store, append_one(store, 1, 2), APC_ETIMEDOUT, "locked by another process");
    assert_int_equal(sqlite3_exec(db, "ROLLBACK; BEGIN; SELECT * FROM sample", NULL, NULL, NULL), SQLITE_OK);
    assert_int_equal(newest_seq(store, 1), 1); /* beside a reader one can read, but not commit */
    assert_said(store, append_one(store, 1, 2), APC_ETIMEDOUT, "locked by another process");
    assert_int_equal(sqlite3_exec(db, "COMMIT", NULL, NULL, NULL), SQLITE_OK);
    assert_int_equal(newest_seq(store, 1), 1);
    assert_int_equal(append_one(store, 1, 2), 1);
    sqlite3_close(db);
    apc_store_close(store);
}

struct beside {
    struct apc_store *store; /* of somebody who writes meanwhile */
    int id, count, failed;
};

static int write_beside(struct beside *b)
{
    b->failed += append_one(b->store, b->id, ++b->count) != 1;
    return 0;
}

static int beside_sample(void *ctx, const struct apc_sample *s)
{
    (void)s;
    return write_beside(ctx);
}

static int beside_event(void *ctx, const struct apc_event *e)
{
    (void)e;
    return write_beside(ctx);
}

static int beside_timing(void *ctx, const struct apc_timing_row *row)
{
    (void)row;
    return write_beside(ctx);
}

static int beside_bin(void *ctx, const struct apc_history_bin *bin)
{
    (void)bin;
    return write_beside(ctx);
}

/* Promise(stores/sqlite-0600-writer) */
static void test_nobody_is_held_up_by_somebody_who_reads_slowly(void **state)
{
    struct apc_store *store = *state;
    struct beside b = {.store = open_store(SECOND), .id = 50};
    const struct apc_event event = {.time = 1000, .severity = APC_EVENT_INFO};
    const struct apc_timing_row row = {.time = 1000, .task = "t", .quantity = "run"};
    for (int i = 1; i <= 200; i++) {
        assert_int_equal(append_one(store, 1, i), 1);
    }
    assert_int_equal(apc_store_append_events(store, &event, 1), 1);
    assert_int_equal(apc_store_append_timing(store, &row, 1), 1);
    assert_int_equal(apc_store_history(store, APC_SENSOR, 1, NULL, beside_sample, &b), 200);
    assert_int_equal(apc_store_history_bins(store, APC_SENSOR, 1, 0, SECOND, 1, beside_bin, &b), 1);
    assert_int_equal(apc_store_events(store, NULL, beside_event, &b), 1);
    assert_int_equal(apc_store_timing(store, NULL, beside_timing, &b), 1);
    assert_int_equal(b.failed, 0);
    assert_int_equal(newest_seq(store, 50), 203);
    apc_store_close(b.store);
}

/* Promise(stores/sqlite-0600-writer) */
static void test_a_file_that_goes_away_and_comes_back_is_noticed(void **state)
{
    struct apc_store *store = *state;
    char aside[220];
    snprintf(aside, sizeof aside, "%s.aside", path);
    assert_int_equal(append_one(store, 1, 1), 1);
    assert_int_equal(rename(path, aside), 0);
    const struct apc_sample seen = {.table = APC_SENSOR, .id = 1, .seq = 1};
    assert_said(store, append_one(store, 1, 2), APC_ECONN, "No such file");
    assert_said(store, apc_store_wait(store, &seen, 1, 60 * SECOND), APC_ECONN, "No such file");
    assert_false(apc_store_connected(store));
    assert_int_equal(rename(aside, path), 0);
    assert_int_equal(append_one(store, 1, 2), 1);

    /* another one in its place is another store */
    assert_int_equal(rename(path, aside), 0);
    struct apc_store *other = open_store(SECOND);
    assert_int_equal(apc_store_init(other), 0);
    assert_int_equal(append_one(other, 1, 70), 1);
    assert_int_equal(newest_seq(store, 1), 70);
    apc_store_close(other);
}

/* ---- Processes --------------------------------------------------------------------------------- */

/* A process that claims table sensor, says so with a byte on @p fd, and stays until it is killed. */
static pid_t start_claimant(int fd)
{
    pid_t pid = fork();
    if (pid != 0) {
        return pid;
    }
    struct apc_store *store = NULL;
    int64_t last[1];
    char ok =
        apc_store_open(&store, uri, NULL, NULL) == 0 && apc_store_claim(store, APC_SENSOR, 1, last) == 0;
    if (write(fd, &ok, 1) == 1) {
        pause();
    }
    _exit(1);
}

/* Promise(stores/sqlite-0600-writer) */
static void test_a_claim_ends_with_its_process_and_with_nothing_less(void **state)
{
    struct apc_store *store = *state;
    int fd[2], status;
    int64_t last[1];
    char ok = 0, name[40], file[220];
    snprintf(file, sizeof file, "%s-claims", path);
    assert_int_equal(append_one(store, 1, 5), 1);
    assert_int_equal(pipe(fd), 0);
    pid_t pid = start_claimant(fd[1]);
    assert_true(read(fd[0], &ok, 1) == 1 && ok);
    snprintf(name, sizeof name, "libapc (process %ld)", (long)pid);
    assert_said(store, apc_store_claim(store, APC_SENSOR, 1, last), APC_EBUSY, name);
    kill(pid, SIGSTOP); /* it lives */
    assert_said(store, apc_store_claim(store, APC_SENSOR, 1, last), APC_EBUSY, name);
    kill(pid, SIGKILL);
    assert_int_equal(waitpid(pid, &status, 0), pid);
    assert_int_equal(apc_store_claim(store, APC_SENSOR, 1, last), 0);
    assert_int_equal(last[0], 5);

    /* Somebody removes the file of locks: its holder makes it anew with its next operation. */
    assert_int_equal(unlink(file), 0);
    assert_int_equal(append_one(store, 1, 6), 1);
    struct apc_store *other = open_store(SECOND);
    assert_said(other, apc_store_claim(other, APC_SENSOR, 1, last), APC_EBUSY, "test (process ");
    assert_int_equal(unlink(file), 0);
    assert_int_equal(apc_store_claim(other, APC_SENSOR, 1, last), 0); /* or is told that it came too late, */
    assert_said(store, append_one(store, 1, 7), APC_EBUSY, "test (process ");
    assert_said(store, append_one(store, 1, 7), APC_EBUSY, "test (process "); /* each time, */
    apc_store_close(other);
    assert_int_equal(append_one(store, 1, 7), 1); /* until it is not so any more */
    close(fd[0]);
    close(fd[1]);
}

enum { KILLS = 25 };

/* Appends ticks of two tables, and says after each which one the store has acknowledged. */
static void append_until_killed(int fd, int64_t seq)
{
    struct apc_store *store = NULL;
    int err = apc_store_open(&store, uri, NULL, NULL);
    for (; !err; seq++) {
        const struct apc_sample tick[3] = {sample(APC_SENSOR, 1, seq, 1), sample(APC_STATE, 1, seq, 1),
                                           sample(APC_SENSOR, 2, seq, 1)};
        err = apc_store_append(store, tick, 3) != 3 || write(fd, &seq, sizeof seq) != sizeof seq;
    }
    _exit(1);
}

/* Promise(stores/acknowledged-survives) */
static void test_a_killed_writer_leaves_what_was_acknowledged_and_no_half_of_a_tick(void **state)
{
    struct apc_store *store = *state;
    int64_t acknowledged = 0;
    for (int kills = 0; kills < KILLS; kills++) {
        int fd[2], status;
        const int64_t enough = acknowledged + 1 + kills % 7;
        assert_int_equal(pipe(fd), 0);
        pid_t pid = fork();
        if (pid == 0) {
            append_until_killed(fd[1], newest_seq(store, 1) + 1);
        }
        close(fd[1]);
        while (acknowledged < enough && read(fd[0], &acknowledged, sizeof acknowledged) > 0) {
        }
        kill(pid, SIGKILL);
        assert_int_equal(waitpid(pid, &status, 0), pid);
        assert_true(WIFSIGNALED(status)); /* it did not end for another reason */
        while (read(fd[0], &acknowledged, sizeof acknowledged) > 0) {
        }
        close(fd[0]);
        struct apc_sample s[3] = {
            {.table = APC_SENSOR, .id = 1}, {.table = APC_STATE, .id = 1}, {.table = APC_SENSOR, .id = 2}};
        assert_int_equal(apc_store_read(store, s, 3), 0);
        assert_true(s[0].seq == acknowledged || s[0].seq == acknowledged + 1); /* attempted */
        assert_true(s[1].seq == s[0].seq && s[2].seq == s[0].seq);
        int n = 0;
        assert_int_equal(apc_store_history(store, APC_SENSOR, 2, NULL, count_sample, &n), s[0].seq);
        acknowledged = s[0].seq;
    }
}

#define T(name) cmocka_unit_test_setup_teardown(name, set_up, tear_down)
#define N(name) cmocka_unit_test_setup_teardown(name, set_up_nothing, tear_down)

int main(void)
{
    const struct CMUnitTest tests[] = {
        T(test_samples_in_any_order_are_found_as_a_model_finds_them),
        T(test_a_path_that_is_none_is_refused),
        T(test_a_path_is_from_where_the_program_was_when_it_opened_it),
        N(test_a_file_that_is_not_there_is_not_made_by_using_it),
        N(test_a_file_that_is_not_ours_is_refused_and_left_alone),
        T(test_another_version_is_refused),
        T(test_a_vector_that_goes_meanwhile_is_left_out),
        N(test_a_file_in_a_folder_that_is_not_there_says_so),
        T(test_a_write_ahead_log_goes_or_is_refused),
        T(test_a_journal_of_another_file_is_told_and_a_files_own_is_rolled_back),
        T(test_a_backup_is_restored_at_once_and_what_was_there_is_kept),
        T(test_what_is_no_backup_or_has_a_writer_is_left_as_it_is),
        T(test_a_file_for_reading_only_is_read),
        T(test_a_log_that_cannot_be_made_is_told_of),
        T(test_a_full_disk_keeps_the_whole_append_out_and_no_later_one),
        T(test_a_damaged_file_gives_errors_and_no_nonsense),
        T(test_what_is_whole_is_read_as_it_was_beside_what_is_not),
        T(test_an_error_in_the_middle_of_housekeeping_is_said),
        T(test_making_the_tables_waits_for_a_lock_as_all_else_does),
        cmocka_unit_test_setup_teardown(test_a_file_is_made_for_its_user_alone, set_up_nothing, tear_down),
        T(test_people_write_nothing_to_a_history),
        T(test_a_lock_that_is_not_given_back_ends_in_a_timeout),
        T(test_nobody_is_held_up_by_somebody_who_reads_slowly),
        T(test_a_file_that_goes_away_and_comes_back_is_noticed),
        T(test_a_claim_ends_with_its_process_and_with_nothing_less),
        T(test_a_killed_writer_leaves_what_was_acknowledged_and_no_half_of_a_tick),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}

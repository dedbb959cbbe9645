/* SPDX-License-Identifier: BSD-3-Clause */
/* Packed samples of the SQLite store: the same history in less room, whatever happens meanwhile. */
#include <pthread.h>
#include <signal.h>
#include <sqlite3.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/resource.h>
#include <sys/wait.h>
#include <unistd.h>

#include "apcstore.h"
#include "check.h"
#include "scratch.h"
#include "shareddata/sqlite/sqlite.h"
#include "xorshift.h"

#define SECOND APC_NS_PER_S
#define BEGIN  (INT64_C(1700000000) * SECOND)

static char path[200], uri[220]; /* of this test's file */

static struct apc_store *open_store(void)
{
    struct apc_store *store = NULL;
    const struct apc_store_options options = {.size = sizeof options, .name = "test", .timeout = 60 * SECOND};
    assert_int_equal(apc_store_open(&store, uri, &options, NULL), 0);
    return store;
}

static int set_up(void **state)
{
    static int number;
    snprintf(path, sizeof path, "%s/%d.db", scratch_folder(), ++number);
    snprintf(uri, sizeof uri, "sqlite:%s", path);
    *state = open_store();
    return apc_store_init(*state) != 0;
}

static int tear_down(void **state)
{
    apc_store_close(*state);
    return 0;
}

static int64_t ask(const char *sql)
{
    sqlite3 *db = NULL;
    sqlite3_stmt *statement = NULL;
    assert_int_equal(sqlite3_open(path, &db), SQLITE_OK);
    sqlite3_busy_timeout(db, 60000);
    assert_int_equal(sqlite3_prepare_v2(db, sql, -1, &statement, NULL), SQLITE_OK);
    const int rc = sqlite3_step(statement);
    assert_true(rc == SQLITE_ROW || rc == SQLITE_DONE);
    const int64_t answer = rc == SQLITE_ROW ? sqlite3_column_int64(statement, 0) : 0;
    sqlite3_finalize(statement);
    sqlite3_close(db);
    return answer;
}

static uint64_t next_random(void)
{
    static uint64_t seed = 88172645463325252U;
    return xorshift(&seed);
}

/* ---- Signals -------------------------------------------------------------------------------- */

static double noise(int64_t i)
{
    uint64_t bits = next_random() >> 1;
    double v;
    (void)i;
    memcpy(&v, &bits, sizeof v);
    return fabs(v) < 1e300 ? v : 1.5;
}

static double any_code(int64_t i)
{
    (void)i;
    return 4 + (double)(next_random() % 65536) * (16 / 65535.0);
}

static double constant(int64_t i)
{
    (void)i;
    return 20.3;
}

static double counting(int64_t i)
{
    return -0.25 * (double)i;
}

struct signal {
    enum apc_table table;
    int id;
    double (*value)(int64_t i);
    bool jitters;
    int64_t gap; /* each so many samples a seq is left out; 0: none */
    int64_t n;
    bool all_good;
};

static void add(struct apc_store *store, const struct signal *s, int64_t from, int64_t to)
{
    static struct apc_sample batch[500];
    for (int64_t i = from; i < to;) {
        size_t n = 0;
        for (; n < 500 && i < to; n++, i++) {
            batch[n] = (struct apc_sample){.table = s->table,
                                           .id = s->id,
                                           .seq = 1 + i + (s->gap ? i / s->gap : 0),
                                           .time = BEGIN + i * SECOND,
                                           .value = s->value(i)};
            batch[n].time += s->jitters ? (apc_ns)(next_random() % 256) * 1000 : 0;
            batch[n].status = s->all_good   ? 0
                              : i % 700 < 5 ? APC_BAD_SENSOR_FAILURE
                              : i % 900 < 3 ? APC_UNCERTAIN_SUBSTITUTE
                                            : 0;
            batch[n].origin = s->table == APC_ACTUATOR ? i / 2 : 0;
        }
        assert_int_equal(apc_store_append(store, batch, n), n);
    }
}

/* The ones with gaps have runs that are too short for a chunk among them. */
static const struct signal signals[] = {
    {APC_SENSOR, 1, noise, true, 0, 9000, false},          {APC_SENSOR, 2, any_code, true, 700, 7000, false},
    {APC_SENSOR, 3, counting, false, 5, 3000, false},      {APC_ACTUATOR, 1, counting, true, 0, 5000, false},
    {APC_SETPOINT, 1, constant, false, 2000, 4000, false}, {APC_SENSOR, 4, counting, false, 0, 40, false},
    {APC_MANUAL, 1, counting, false, 0, 3000, false}};
enum { SIGNALS = sizeof signals / sizeof signals[0] };

struct list {
    struct apc_sample *at;
    size_t n, room;
};

static int keep(void *ctx, const struct apc_sample *s)
{
    struct list *l = ctx;
    if (l->n == l->room) {
        l->room = l->room ? 2 * l->room : 1024;
        l->at = realloc(l->at, l->room * sizeof *l->at);
        assert_non_null(l->at);
    }
    l->at[l->n++] = *s;
    return 0;
}

static struct list history(struct apc_store *store, const struct signal *s, const struct apc_range *range)
{
    struct list l = {0};
    const int n = apc_store_history(store, s->table, s->id, range, keep, &l);
    assert_int_equal(n, l.n);
    return l;
}

static void assert_same(const struct list *a, const struct list *b)
{
    assert_int_equal(a->n, b->n);
    for (size_t i = 0; i < a->n; i++) {
        const struct apc_sample *x = &a->at[i], *y = &b->at[i];
        assert_true(x->seq == y->seq && x->time == y->time && x->status == y->status &&
                    x->origin == y->origin && x->author == y->author && x->id == y->id &&
                    x->table == y->table && memcmp(&x->value, &y->value, sizeof x->value) == 0);
    }
}

struct record {
    struct list of[SIGNALS];
};

static struct record fill(struct apc_store *store)
{
    struct record r;
    for (size_t i = 0; i < SIGNALS; i++) {
        add(store, &signals[i], 0, signals[i].n);
    }
    for (size_t i = 0; i < SIGNALS; i++) {
        r.of[i] = history(store, &signals[i], NULL);
        assert_int_equal(r.of[i].n, signals[i].n);
    }
    return r;
}

static void assert_recorded(struct apc_store *store, const struct record *r)
{
    for (size_t i = 0; i < SIGNALS; i++) {
        struct list now = history(store, &signals[i], NULL);
        assert_same(&r->of[i], &now);
        free(now.at);
    }
}

static void free_record(struct record *r)
{
    for (size_t i = 0; i < SIGNALS; i++) {
        free(r->of[i].at);
    }
}

static int pack(struct apc_store *store)
{
    const struct apc_retention retention = {.size = sizeof retention, .packed = 1};
    return apc_store_maintain(store, &retention);
}

/* No row is there twice: packed, and in table sample as well. */
static void assert_swept(void)
{
    assert_int_equal(ask("SELECT count(*) FROM sample s JOIN block b ON b.variable = s.variable AND b.pos < 0"
                         " AND s.seq <= b.seq AND s.seq > b.seq - b.count"),
                     0);
    assert_int_equal(ask("SELECT count(*) FROM packing"), 0);
    assert_int_equal(ask("SELECT (SELECT count(*) FROM packed) - (SELECT count(*) FROM block WHERE pos < 0)"),
                     0);
}

/* ---- The same history ----------------------------------------------------------------------- */

/*
 * Promise(database/sqlite-file-packed): In a `sqlite:` file what is packed is the same history, in at most
 *   11, 4 and 1 bytes a sample of noise, 16 bits and a constant, whoever is killed, writes or packs
 *   meanwhile, and when the disk is full.
 */
static void test_what_is_packed_is_the_same_history(void **state)
{
    struct record before = fill(*state);
    assert_true(pack(*state) > 20);
    assert_recorded(*state, &before);
    assert_swept();
    assert_int_equal(pack(*state), 0);
    assert_recorded(*state, &before);
    assert_int_equal(ask("SELECT count(*) FROM event WHERE text LIKE 'packed: %'"), 1);
    assert_int_equal(ask("SELECT count(*) FROM block WHERE pos < 0 AND variable & 15 NOT IN (1, 2, 3)"), 0);
    assert_true(ask("SELECT sum(count) FROM block WHERE pos < 0") > 20000);
    for (size_t i = 0; i < SIGNALS; i++) {
        struct apc_sample s = {.table = signals[i].table, .id = signals[i].id};
        assert_int_equal(apc_store_read(*state, &s, 1), 0);
        assert_int_equal(s.seq, before.of[i].at[before.of[i].n - 1].seq);
    }
    free_record(&before);
}

static void test_parts_of_it_are_those_of_the_rows(void **state)
{
    enum { ROUNDS = 48 };
    static struct list want[SIGNALS][ROUNDS];
    static struct apc_range range[SIGNALS][ROUNDS];
    struct record whole = fill(*state);
    for (int packed = 0; packed < 2; packed++) {
        for (size_t v = 0; v < SIGNALS; v++) {
            const struct list *l = &whole.of[v];
            for (unsigned k = 0; k < ROUNDS; k++) {
                struct apc_range *r = &range[v][k];
                if (!packed) {
                    r->since = k & 1 ? l->at[next_random() % l->n].time - (apc_ns)(next_random() % 3) : 0;
                    r->until = k & 2 ? l->at[next_random() % l->n].time + (apc_ns)(next_random() % 3) : 0;
                    r->last = k & 4 ? 1 + next_random() % 1500 : 0;
                    r->after = k & 8 ? l->at[next_random() % l->n].seq : 0;
                    want[v][k] = history(*state, &signals[v], r);
                    continue;
                }
                struct list now = history(*state, &signals[v], r);
                assert_same(&want[v][k], &now);
                free(now.at);
                free(want[v][k].at);
            }
        }
        assert_true(packed || pack(*state) > 0);
    }
    free_record(&whole);
}

enum { BINS = 70 };

struct bins {
    struct apc_history_bin at[BINS];
    size_t n;
};

static int keep_bin(void *ctx, const struct apc_history_bin *bin)
{
    struct bins *b = ctx;
    b->at[b->n++] = *bin;
    return 0;
}

static void test_bins_of_it_are_those_of_the_rows(void **state)
{
    static struct bins want[SIGNALS];
    struct record whole = fill(*state);
    for (int packed = 0; packed < 2; packed++) {
        for (size_t v = 0; v < SIGNALS; v++) {
            struct bins now = {.n = 0};
            assert_true(apc_store_history_bins(*state, signals[v].table, signals[v].id, BEGIN - 12345,
                                               BEGIN + 9000 * SECOND, BINS, keep_bin, &now) > 0);
            assert_true(!packed ||
                        (now.n == want[v].n && memcmp(now.at, want[v].at, now.n * sizeof *now.at) == 0));
            want[v] = now;
        }
        assert_true(packed || pack(*state) > 0);
    }
    free_record(&whole);
}

/* Promise(database/sqlite-file-packed) */
static void test_a_sample_takes_the_bytes_that_it_holds(void **state)
{
    static const struct {
        const char *what;
        struct signal signal;
        double most;
    } kinds[] = {{"noise, jitter", {APC_SENSOR, 1, noise, true, 0, 60000, true}, 11},
                 {"any code of 16 bits, jitter", {APC_SENSOR, 1, any_code, true, 0, 60000, true}, 4},
                 {"constant", {APC_SENSOR, 1, constant, false, 0, 60000, true}, 1}};
    (void)state;
    for (size_t i = 0; i < sizeof kinds / sizeof kinds[0]; i++) {
        struct apc_store *mine = NULL;
        assert_int_equal(set_up((void **)&mine), 0);
        const int64_t empty = ask("SELECT 4096 * (SELECT page_count FROM pragma_page_count)");
        add(mine, &kinds[i].signal, 0, kinds[i].signal.n);
        const int64_t rows = ask("SELECT 4096 * (SELECT page_count FROM pragma_page_count)") - empty;
        assert_true(pack(mine) > 0);
        apc_store_close(mine);
        const int64_t stayed = ask("SELECT count(*) FROM sample");
        ask("VACUUM");
        const int64_t packed = ask("SELECT 4096 * (SELECT page_count FROM pragma_page_count)") - empty;
        const double n = (double)kinds[i].signal.n, row = (double)rows / n;
        const double each = ((double)packed - row * (double)stayed) / (n - (double)stayed);
        print_message("%s: %.1f bytes a sample were rows, %.2f now\n", kinds[i].what, row, each);
        assert_true(each <= kinds[i].most);
    }
}

/* ---- What comes late ------------------------------------------------------------------------ */

static void test_a_packed_seq_is_taken_and_a_free_one_is_not(void **state)
{
    const struct signal *s = &signals[1];
    struct record before = fill(*state);
    assert_true(pack(*state) > 0);
    struct list want = before.of[1];
    for (int64_t k = 1; k <= 3; k++) { /* a seq is left out behind each 700, from 1 on */
        struct apc_sample late = want.at[700 * k - 1], taken = late;
        taken.value = 1;
        assert_int_equal(apc_store_append(*state, &taken, 1), 0);
        late.seq++;
        assert_true(late.seq < want.at[700 * k + 1].seq);
        late.value = 7;
        late.time += 40000 * SECOND;
        assert_int_equal(apc_store_append(*state, &late, 1), 700 * k < 7000);
        assert_int_equal(apc_store_append(*state, &late, 1), 0);
    }
    struct list now = history(*state, s, NULL);
    assert_int_equal(now.n, want.n + 3);
    assert_int_equal(pack(*state) >= 0, 1);
    struct list again = history(*state, s, NULL);
    assert_same(&now, &again);
    add(*state, s, s->n, s->n + 3000); /* and it goes on */
    assert_true(pack(*state) > 0);
    struct list more = history(*state, s, NULL);
    assert_int_equal(more.n, now.n + 3000);
    more.n = now.n;
    assert_same(&now, &more);
    assert_swept();
    free(now.at);
    free(again.at);
    free(more.at);
    free_record(&before);
}

static void test_chunks_are_dropped_as_a_whole_when_they_are_old(void **state)
{
    struct apc_retention retention = {.size = sizeof retention};
    struct record before = fill(*state);
    assert_true(pack(*state) > 0);
    retention.samples = apc_clock_utc(NULL) - (BEGIN + 5000 * SECOND);
    assert_true(apc_store_maintain(*state, &retention) > 4000);
    struct list now = history(*state, &signals[0], NULL);
    assert_true(now.n >= 4000 && now.n < 4000 + 1024);
    struct list tail = before.of[0];
    tail.at += tail.n - now.n;
    tail.n = now.n;
    assert_same(&tail, &now);
    assert_swept();
    free(now.at);
    free_record(&before);
}

/* ---- Faults --------------------------------------------------------------------------------- */

/* Promise(database/sqlite-file-packed) */
static void test_who_is_killed_while_he_packs_leaves_the_history_as_it_is(void **state)
{
    struct record before = fill(*state);
    apc_store_close(*state);
    int killed = 0;
    for (int k = 0; k < 30; k++) {
        const pid_t child = fork();
        assert_true(child >= 0);
        if (child == 0) {
            struct apc_store *mine = open_store();
            _exit(pack(mine) < 0);
        }
        usleep((useconds_t)(next_random() % 60000));
        kill(child, SIGKILL);
        int status = 0;
        assert_int_equal(waitpid(child, &status, 0), child);
        killed += WIFSIGNALED(status);
        assert_true(WIFSIGNALED(status) || WEXITSTATUS(status) == 0);
        *state = open_store();
        assert_recorded(*state, &before);
        apc_store_close(*state);
    }
    *state = open_store();
    assert_true(killed > 0 && pack(*state) >= 0);
    assert_recorded(*state, &before);
    assert_swept();
    free_record(&before);
}

/* Promise(database/sqlite-file-packed) */
static void test_a_full_disk_leaves_the_history_as_it_is(void **state)
{
    struct record before = fill(*state);
    const rlim_t size = (rlim_t)ask("SELECT 4096 * (SELECT page_count FROM pragma_page_count)");
    struct rlimit unlimited;
    signal(SIGXFSZ, SIG_IGN);
    assert_int_equal(getrlimit(RLIMIT_FSIZE, &unlimited), 0);
    const struct rlimit limit = {size + 20000, unlimited.rlim_max};
    assert_int_equal(setrlimit(RLIMIT_FSIZE, &limit), 0);
    const int full = pack(*state);
    assert_int_equal(setrlimit(RLIMIT_FSIZE, &unlimited), 0);
    assert_int_equal(full, APC_EFULL);
    assert_recorded(*state, &before);
    assert_true(pack(*state) > 0);
    assert_recorded(*state, &before);
    assert_swept();
    free_record(&before);
}

static void *pack_beside(void *result)
{
    struct apc_store *mine = open_store();
    *(int *)result = pack(mine);
    apc_store_close(mine);
    return NULL;
}

/* Promise(database/sqlite-file-packed) */
static void test_two_who_pack_at_once_do_it_once(void **state)
{
    struct record before = fill(*state);
    pthread_t thread[2];
    int result[2];
    for (size_t i = 0; i < 2; i++) {
        assert_int_equal(pthread_create(&thread[i], NULL, pack_beside, &result[i]), 0);
    }
    struct apc_sample s = before.of[0].at[before.of[0].n - 1];
    for (int k = 1; k <= 20; k++) { /* while somebody writes */
        s.seq++;
        s.time += SECOND;
        assert_int_equal(apc_store_append(*state, &s, 1), 1);
        keep(&before.of[0], &s);
    }
    for (size_t i = 0; i < 2; i++) {
        assert_int_equal(pthread_join(thread[i], NULL), 0);
        assert_true(result[i] >= 0);
    }
    assert_true(result[0] + result[1] > 20);
    assert_recorded(*state, &before);
    assert_true(pack(*state) >= 0);
    assert_swept();
    free_record(&before);
}

#define T(name) cmocka_unit_test_setup_teardown(name, set_up, tear_down)

int main(void)
{
    const struct CMUnitTest tests[] = {
        T(test_what_is_packed_is_the_same_history),
        T(test_parts_of_it_are_those_of_the_rows),
        T(test_bins_of_it_are_those_of_the_rows),
        T(test_a_sample_takes_the_bytes_that_it_holds),
        T(test_a_packed_seq_is_taken_and_a_free_one_is_not),
        T(test_chunks_are_dropped_as_a_whole_when_they_are_old),
        T(test_who_is_killed_while_he_packs_leaves_the_history_as_it_is),
        T(test_a_full_disk_leaves_the_history_as_it_is),
        T(test_two_who_pack_at_once_do_it_once),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}

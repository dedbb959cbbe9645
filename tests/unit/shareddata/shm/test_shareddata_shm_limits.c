/* SPDX-License-Identifier: BSD-3-Clause */
/* How much a store in shared memory holds of what there is only a fixed room for, to the last one, and that
 * what does not fit is said and changes nothing; and how long a writer waits for another one.
 */
#include <sched.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/wait.h>
#include <unistd.h>

#include "apcstore.h"
#include "check.h"
#include "shareddata/shm/shm.h"

static char uri[128], path[128];

static struct apc_store *open_store(apc_ns timeout)
{
    struct apc_store *store = NULL;
    struct apc_store_options options = {.size = sizeof options, .name = "limits", .timeout = timeout};
    struct apc_error why = {""};
    if (apc_store_open(&store, uri, &options, &why) != 0) {
        fail_msg("%s", why.text);
    }
    return store;
}

static int set_up(void **state)
{
    snprintf(uri, sizeof uri, "shm:limits-test-%d?size=1", (int)getpid());
    snprintf(path, sizeof path, "/dev/shm/apc.limits-test-%d", (int)getpid());
    unlink(path);
    *state = open_store(600 * APC_NS_PER_S);
    return apc_store_init(*state);
}

static int tear_down(void **state)
{
    apc_store_close(*state);
    unlink(path);
    return 0;
}

static void assert_refused(struct apc_store *store, int rc, enum apc_err err, const char *part)
{
    assert_int_equal(rc, err);
    assert_has(apc_store_error(store), part);
}

static void test_names_and_sizes_have_bounds(void **state)
{
    char name[APC_SHM_NAME_MAX + 2], long_uri[APC_SHM_NAME_MAX + 40];
    (void)state;
    memset(name, 'n', sizeof name);
    const struct {
        size_t length;
        const char *query;
        int rc;
    } of[] = {{APC_SHM_NAME_MAX, "", 0},
              {APC_SHM_NAME_MAX + 1, "", APC_EINVAL},
              {1, "", 0},
              {0, "", APC_EINVAL},
              {1, "?size=1", 0},
              {1, "?size=0", APC_EINVAL},
              {1, "?size=-1", APC_EINVAL},
              {1, "?size=", APC_EINVAL},
              {1, "?size=2x", APC_EINVAL},
              {1, "?size=99999999999999999999", APC_EINVAL},
              {1, "?site=2", APC_EINVAL},
              {1, "!", APC_EINVAL}};
    for (size_t i = 0; i < sizeof of / sizeof *of; i++) {
        struct apc_store *store = NULL;
        struct apc_error why = {""};
        snprintf(long_uri, sizeof long_uri, "shm:%.*s%s", (int)of[i].length, name, of[i].query);
        if (apc_store_open(&store, long_uri, NULL, &why) != of[i].rc) {
            fail_msg("%s: %s", long_uri, why.text);
        }
        apc_store_close(store);
    }
    for (int over = 0; over < 2; over++) {
        struct apc_store *store = NULL;
        snprintf(long_uri, sizeof long_uri, "shm:n?size=%d", APC_SHM_MIB_MAX + over);
        assert_int_equal(apc_store_open(&store, long_uri, NULL, NULL), over ? APC_EINVAL : 0);
        apc_store_close(store);
    }
}

static void test_a_catalogue_of_any_length_below_its_room_comes_back(void **state)
{
    struct apc_store *store = *state;
    char text[20000], back[20000];
    int64_t revision = 0, before = 0;
    memset(text, 'a', sizeof text);
    /* 1 MiB has 16 KiB for it */
    const size_t room = 16384, length[] = {0, 1, 7, 8, 9, 4096, room - 2, room - 1};
    for (size_t i = 0; i < sizeof length / sizeof *length; i++) {
        text[length[i]] = '\0';
        assert_int_equal(apc_store_describe(store, NULL, 0, text), 0);
        assert_int_equal(apc_store_catalogue(store, back, sizeof back, &revision), length[i]);
        assert_string_equal(back, text);
        assert_int_equal(revision, ++before);
        assert_int_equal(apc_store_describe(store, NULL, 0, text), 0); /* the same again is no other one */
        assert_int_equal(apc_store_catalogue(store, back, 5, &revision), length[i]);
        assert_int_equal(strlen(back), length[i] < 4 ? length[i] : 4);
        assert_int_equal(revision, before);
        text[length[i]] = 'a';
        text[0] = (char)('b' + i);
    }
    text[room] = '\0';
    assert_refused(
        store, apc_store_describe(store, NULL, 0, text), APC_ESTORE,
        "holds a catalogue of less than 16384 bytes, not 16384: stop its programs, remove /dev/shm/apc.");
    assert_int_equal(apc_store_catalogue(store, back, sizeof back, &revision), room - 1);
    assert_int_equal(revision, before);
}

static void test_as_many_tags_as_it_says_are_held(void **state)
{
    struct apc_store *store = *state;
    const size_t most = apc_shm_of(store)->tags;
    struct apc_tag *tags = calloc(2 * most + 1, sizeof *tags), *back = tags + most + 1;
    char part[96];
    assert_non_null(tags);
    for (size_t i = 0; i <= most; i++) {
        tags[i].table = APC_SENSOR;
        tags[i].id = (int)i;
        snprintf(tags[i].name, sizeof tags[i].name, "y%zu", i);
    }
    assert_int_equal(apc_store_put_tags(store, tags, most), most);
    snprintf(part, sizeof part, "holds %zu tags at most, not %zu", most, most + 1);
    assert_refused(store, apc_store_put_tags(store, tags, most + 1), APC_ESTORE, part);
    assert_int_equal(apc_store_get_tags(store, back, most), most);
    for (size_t i = 0; i < most; i++) {
        assert_int_equal(back[i].id, i);
        assert_string_equal(back[i].name, tags[i].name);
    }
    assert_int_equal(apc_store_get_tags(store, NULL, 0), most);
    free(tags);
}

static void test_authors_are_known_to_the_last_one_and_no_more_are_taken(void **state)
{
    struct apc_store *store = *state;
    char name[APC_AUTHOR_LEN], back[APC_AUTHOR_LEN];
    for (int pass = 0; pass < 2; pass++) { /* each has its number, and keeps it */
        for (int i = 1; i <= APC_SHM_AUTHORS; i++) {
            snprintf(name, sizeof name, "author %d", i);
            assert_int_equal(apc_store_author(store, name), i);
        }
    }
    assert_refused(store, apc_store_author(store, "one more"), APC_ESTORE,
                   "holds the names of 1024 authors, and no more");
    for (int i = 1; i <= APC_SHM_AUTHORS; i++) {
        snprintf(name, sizeof name, "author %d", i);
        assert_int_equal(apc_store_author_name(store, (uint32_t)i, back), 0);
        assert_string_equal(back, name);
    }
    assert_int_equal(apc_store_author_name(store, APC_SHM_AUTHORS + 1, back), APC_ENOTFOUND);
}

static void test_as_many_writers_may_claim_as_it_says(void **state)
{
    static struct apc_store *writer[APC_SHM_CLAIMANTS];
    struct apc_sample variable = {.table = APC_SENSOR, .id = 1000};
    for (int i = 0; i < APC_SHM_CLAIMANTS; i++) {
        struct apc_sample own = {.table = APC_SENSOR, .id = i};
        writer[i] = open_store(APC_NS_PER_S);
        if (apc_store_claim_set(writer[i], &own, 1) < 0) {
            fail_msg("%s", apc_store_error(writer[i]));
        }
    }
    assert_refused(*state, apc_store_claim_set(*state, &variable, 1), APC_ESTORE,
                   "has 256 writers, and no room for more");
    apc_store_close(writer[17]); /* who goes leaves his place */
    assert_int_equal(apc_store_claim_set(*state, &variable, 1), 0);
    variable.id = 17;
    assert_int_equal(apc_store_claim_set(*state, &variable, 1), 0);
    variable.id = 18;
    assert_refused(*state, apc_store_claim_set(*state, &variable, 1), APC_EBUSY,
                   "sensor 18 of shm:limits-test");
    for (int i = 0; i < APC_SHM_CLAIMANTS; i++) {
        if (i != 17) {
            apc_store_close(writer[i]);
        }
    }
}

/* Rings grow as far as they may, as those of alarms in a flood do; then the first row of every variable that
 * the segment can describe is taken, three tables of each: somebody's write, a mode, an alarm. */
/*
 * Promise(stores): Histories that grow in shared memory leave room for the first rows of variables that are
 *   yet to come.
 */
static void test_rings_that_grow_leave_room_for_first_rows(void **state)
{
    struct apc_store *store = *state;
    const size_t tags = apc_shm_of(store)->tags;
    static const enum apc_table table[] = {APC_SETPOINT, APC_OPMODE, APC_ACTUATOR};
    enum { FLOOD = 60, ROWS = 200 };
    for (int64_t seq = 1; seq <= ROWS; seq++) {
        struct apc_sample row[FLOOD];
        for (int id = 0; id < FLOOD; id++) {
            row[id] = (struct apc_sample){.table = APC_SENSOR, .id = id, .seq = seq, .time = seq};
        }
        if (apc_store_append(store, row, FLOOD) != FLOOD) {
            fail_msg("row %d: %s", (int)seq, apc_store_error(store));
        }
    }
    for (size_t t = 0; t < sizeof table / sizeof *table; t++) {
        for (size_t id = 1; id <= tags; id++) {
            struct apc_sample row = {.table = table[t], .id = (int)id, .seq = 1, .time = 1, .value = 1};
            if (apc_store_append(store, &row, 1) != 1) {
                fail_msg("%s %zu: %s", apc_table_name(table[t]), id, apc_store_error(store));
            }
        }
    }
    struct apc_sample newest = {.table = APC_SENSOR, .id = FLOOD - 1, .seq = ROWS + 1, .time = ROWS + 1};
    assert_int_equal(apc_store_append(store, &newest, 1), 1); /* and theirs go on, the oldest give way */
}

struct newest {
    int64_t number;
    int in_order;
};

static int see_event(void *ctx, const struct apc_event *e)
{
    struct newest *n = ctx;
    n->in_order += e->number == n->number + 1 || n->in_order == 0;
    n->number = e->number;
    return 0;
}

static int see_timing(void *ctx, const struct apc_timing_row *row)
{
    ((struct newest *)ctx)->number = row->number;
    return 0;
}

static struct apc_store_room room_of(struct apc_store *store)
{
    struct apc_store_room room = {.size = sizeof room};
    assert_int_equal(apc_store_room(store, &room), 1);
    return room;
}

/* With vectors, each shorter than the one that found no room any more, until no sample finds room. */
static void fill(struct apc_store *store, double *value)
{
    struct apc_vector v = {.table = APC_PREDICTION, .id = 1, .seq = 1, .time = 1, .value = value};
    for (v.n = 2000; v.n > 0; v.n /= 10) {
        const struct apc_rows rows = {.size = sizeof rows, .vector = &v, .n_vectors = 1};
        while (apc_store_append_rows(store, &rows) == 1) {
            v.id++;
        }
    }
    assert_in_range(room_of(store).cells_max - room_of(store).cells, 0, 3);
}

/*
 * The first row of a variable finds no room. Everybody is told of it, as long as it has none, and how often.
 * Promise(stores/memory-full): That shared memory is full is told as long as it is, by `apc status`,
 *   `/readyz`, state, stream, metrics and page; after a flood of alarms people's writes have room, the newest
 *   states are kept, and what is lost is told.
 */
static void test_a_row_without_room_is_known_to_all_until_it_is_written(void **state)
{
    struct apc_store *store = *state, *other = open_store(APC_NS_PER_S);
    struct apc_shm *shm = apc_shm_of(store);
    struct apc_sample row = {.table = APC_SENSOR, .id = 1, .seq = 1, .time = 1};
    double wide[2000] = {0};
    struct apc_vector plan = {.table = APC_PLAN, .id = 3, .seq = 1, .time = 1, .n = 1, .value = wide};
    struct apc_rows rows = {.size = sizeof rows, .vector = &plan, .n_vectors = 1};
    assert_int_equal(apc_store_append(store, &row, 1), 1);
    assert_int_equal(apc_store_append_rows(store, &rows), 1);
    struct apc_store_room room = room_of(other);
    assert_false(room.full);
    assert_int_equal(room.refused, 0);
    assert_int_equal(room.variables, 2);
    assert_int_equal(room.variables_max, shm->variables);
    assert_int_equal(room.cells, 8);
    assert_int_equal(room.cells_max, shm->cells);

    fill(store, wide);
    const uint64_t before = room_of(other).refused;
    row.id = 2;
    struct apc_sample both[] = {{.table = APC_SENSOR, .id = 1, .seq = 2, .time = 2}, row};
    assert_refused(store, apc_store_append(store, both, 2), APC_ESTORE,
                   "is full: it has no room for sensor ");
    assert_int_equal(apc_store_append(store, both, 1), 1); /* what has rows goes on, and it is full still */
    room = room_of(other);
    assert_true(room.full);
    assert_int_equal(room.refused, before + 1);
    assert_int_equal(room.table, APC_SENSOR);
    assert_int_equal(room.id, 2);
    assert_true(room.refused_at > 0);

    /* A vector that has grown: a shorter one finds its place again. */
    plan.seq = 2;
    plan.n = 2000;
    assert_refused(store, apc_store_append_rows(store, &rows), APC_ESTORE, "has no room for ");
    room = room_of(other);
    assert_int_equal(room.refused, before + 2);
    assert_int_equal(room.table, APC_PLAN);
    assert_int_equal(room.id, 3);
    plan.n = 1;
    assert_int_equal(apc_store_append_rows(store, &rows), 1);
    room = room_of(other);
    assert_false(room.full);
    assert_int_equal(room.table, 0);
    assert_int_equal(room.refused, before + 2);
    apc_store_close(other);
}

/* As many events in one call as somebody had kept back: they go through a ring that is smaller.
 * Promise(stores/memory-full) */
static void test_more_records_at_once_than_there_is_room_for_push_out_the_oldest(void **state)
{
    struct apc_store *store = *state;
    struct apc_event event[200] = {{0}};
    struct apc_timing_row row[200] = {{0}};
    for (int i = 0; i < 200; i++) {
        event[i] = (struct apc_event){.time = i + 1, .severity = APC_EVENT_ALARM, .kind = "alarm"};
        row[i] = (struct apc_timing_row){.time = i + 1, .period = 1, .task = "t", .quantity = "run"};
    }
    for (int round = 0; round < 3; round++) {
        struct newest newest = {0};
        assert_int_equal(apc_store_append_events(store, event, 200), 200);
        assert_int_equal(apc_store_append_timing(store, row, 200), 200);
        assert_int_equal(apc_store_events(store, NULL, see_event, &newest), 12);
        assert_int_equal(newest.number, 200 * (round + 1));
        assert_int_equal(newest.in_order, 12);
        assert_int_equal(apc_store_timing(store, NULL, see_timing, &newest), 12);
        assert_int_equal(newest.number, 200 * (round + 1));
    }
}

/* Another process that has the writers' lock, until it is killed. */
static pid_t hold_the_lock(struct apc_store *store)
{
    int ready[2];
    char byte = 0;
    assert_int_equal(pipe(ready), 0);
    const pid_t pid = fork();
    if (pid == 0) {
        byte = apc_shm_lock(apc_shm_of(store)) == 0;
        if (write(ready[1], &byte, 1) == 1) {
            pause();
        }
        _exit(1);
    }
    assert_true(pid > 0);
    assert_int_equal(read(ready[0], &byte, 1), 1);
    assert_int_equal(byte, 1);
    close(ready[0]);
    close(ready[1]);
    return pid;
}

static void test_who_waits_too_long_for_another_writer_is_told_and_goes_on_after_it(void **state)
{
    struct apc_store *hurried = open_store(20 * APC_NS_PER_MS);
    struct apc_sample row = {.table = APC_SENSOR, .id = 1, .seq = 1, .time = 1, .value = 3}, back = row;
    const struct apc_tag tag = {.table = APC_SENSOR, .id = 1, .name = "y"};
    static const char *const held = "another writer has held the lock for too long";
    assert_int_equal(apc_store_append(hurried, &row, 1), 1);
    const pid_t pid = hold_the_lock(*state);
    row.seq = 2;
    assert_refused(hurried, apc_store_append(hurried, &row, 1), APC_ETIMEDOUT, held);
    assert_refused(hurried, apc_store_put_tags(hurried, &tag, 1), APC_ETIMEDOUT, held);
    assert_refused(hurried, apc_store_author(hurried, "somebody"), APC_ETIMEDOUT, held);
    assert_refused(hurried, apc_store_claim_set(hurried, &back, 1), APC_ETIMEDOUT, held);
    assert_int_equal(apc_store_read(hurried, &back, 1), 0); /* who reads waits for nobody */
    assert_int_equal(back.seq, 1);
    assert_int_equal(kill(pid, SIGKILL), 0);
    assert_int_equal(waitpid(pid, NULL, 0), pid);
    assert_int_equal(apc_store_append(hurried, &row, 1), 1);
    assert_int_equal(apc_store_author(hurried, "somebody"), 1);
    assert_int_equal(apc_store_read(*state, &back, 1), 0);
    assert_int_equal(back.seq, 2);
    apc_store_close(hurried);
}

static bool sleeps_or_ended(pid_t pid)
{
    char name[40], text[300] = "";
    snprintf(name, sizeof name, "/proc/%d/stat", (int)pid);
    FILE *in = fopen(name, "r");
    assert_non_null(in);
    text[fread(text, 1, sizeof text - 1, in)] = '\0';
    fclose(in);
    const char *state = strrchr(text, ')'); /* behind its name */
    return state && state[1] == ' ' && (state[2] == 'S' || state[2] == 'Z');
}

/* They all look for it, wait for the lock together, and the first of them makes it known. */
static void test_who_brings_the_same_new_author_gets_the_same_number(void **state)
{
    enum { WHO = 3 };
    pid_t pid[WHO];
    const pid_t holder = hold_the_lock(*state);
    for (int i = 0; i < WHO; i++) {
        pid[i] = fork();
        if (pid[i] == 0) {
            _exit(apc_store_author(*state, "the same") == 1 ? 0 : 1);
        }
        assert_true(pid[i] > 0);
    }
    for (int i = 0; i < WHO; i++) {
        while (!sleeps_or_ended(pid[i])) {
            sched_yield();
        }
    }
    assert_int_equal(kill(holder, SIGKILL), 0);
    assert_int_equal(waitpid(holder, NULL, 0), holder);
    for (int i = 0; i < WHO; i++) {
        int status = -1;
        assert_int_equal(waitpid(pid[i], &status, 0), pid[i]);
        assert_int_equal(status, 0);
    }
    assert_int_equal(apc_store_author(*state, "another"), 2);
}

#define T(test) cmocka_unit_test_setup_teardown(test, set_up, tear_down)

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_names_and_sizes_have_bounds),
        T(test_a_catalogue_of_any_length_below_its_room_comes_back),
        T(test_as_many_tags_as_it_says_are_held),
        T(test_authors_are_known_to_the_last_one_and_no_more_are_taken),
        T(test_as_many_writers_may_claim_as_it_says),
        T(test_rings_that_grow_leave_room_for_first_rows),
        T(test_a_row_without_room_is_known_to_all_until_it_is_written),
        T(test_more_records_at_once_than_there_is_room_for_push_out_the_oldest),
        T(test_who_brings_the_same_new_author_gets_the_same_number),
        T(test_who_waits_too_long_for_another_writer_is_told_and_goes_on_after_it),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}

/* SPDX-License-Identifier: BSD-3-Clause */
/* The store in shared memory beyond what every store must do: its segment, its limits, several processes. */
#include <fcntl.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <sys/statvfs.h>
#include <sys/wait.h>
#include <unistd.h>

#include "apcstore.h"
#include "check.h"
#include "shareddata/shm/shm.h"

static char uri[128], path[128];

static struct apc_store *open_uri(const char *which)
{
    struct apc_store *store = NULL;
    struct apc_error why = {""};
    struct apc_store_options options = {.size = sizeof options, .name = "test", .timeout = 20 * APC_NS_PER_S};
    if (apc_store_open(&store, which, &options, &why) != 0) {
        fail_msg("%s", why.text);
    }
    return store;
}

static struct apc_store *open_store(void)
{
    return open_uri(uri);
}

static int set_up(void **state)
{
    snprintf(uri, sizeof uri, "shm:shm-test-%d?size=1", (int)getpid());
    snprintf(path, sizeof path, "/dev/shm/apc.shm-test-%d", (int)getpid());
    unlink(path);
    *state = open_store();
    return apc_store_init(*state);
}

static int tear_down(void **state)
{
    apc_store_close(*state);
    unlink(path);
    return 0;
}

static struct apc_sample sample(int id, int64_t seq)
{
    return (struct apc_sample){
        .table = APC_SENSOR, .id = id, .seq = seq, .time = 1000 * seq, .value = (double)seq};
}

static int append(struct apc_store *store, int id, int64_t seq)
{
    struct apc_sample s = sample(id, seq);
    return apc_store_append(store, &s, 1);
}

static int64_t newest(struct apc_store *store, int id)
{
    struct apc_sample s = sample(id, 0);
    int err = apc_store_read(store, &s, 1);
    if (err) {
        fail_msg("%s", apc_store_error(store));
    }
    return s.seq;
}

struct span {
    int64_t first, last;
    int count;
};

static int see(void *ctx, const struct apc_sample *s)
{
    struct span *span = ctx;
    span->first = span->count++ == 0 ? s->seq : span->first;
    span->last = s->seq;
    return 0;
}

static int see_vector(void *ctx, const struct apc_vector *v)
{
    struct span *span = ctx;
    span->first = span->count++ == 0 ? v->seq : span->first;
    span->last = v->seq;
    return 0;
}

static int count_event(void *ctx, const struct apc_event *event)
{
    int *next = ctx;
    return event->time != 1000 * (*next)++; /* ends where one is missing */
}

static int sum_bins(void *ctx, const struct apc_timing_row *row)
{
    int64_t *sum = ctx;
    for (size_t i = 0; i < row->n_bins; i++) {
        sum[0] += row->bin_count[i];
        sum[1] += row->bin_low[i] <= row->bin_high[i] && (i == 0 || row->bin_high[i - 1] < row->bin_low[i]);
    }
    sum[2] += (int64_t)row->n_bins;
    sum[3]++;
    return 0;
}

/* ---- Names ----------------------------------------------------------------------------------- */

static void test_a_uri_that_names_no_segment_is_refused(void **state)
{
    (void)state;
    char longer[220] = "shm:";
    memset(longer + 4, 'x', 201);
    const char *const bad[] = {"shm:",          "shm:a/b",         "shm:../etc/passwd",
                               "shm:?size=3",   "shm:a?",          "shm:a?size",
                               "shm:a?size=",   "shm:a?size=0",    "shm:a?size=-1",
                               "shm:a?size=+1", "shm:a?size=1M",   "shm:a?size=65537",
                               "shm:a?size= 1", "shm:a?history=9", "shm:a?size=1&b=2",
                               "shm:a b",       "shm:a?size=1e3",  "shm:\xc3\xa4",
                               longer};
    for (size_t i = 0; i < sizeof bad / sizeof bad[0]; i++) {
        struct apc_store *store = NULL;
        struct apc_error why = {""};
        assert_int_equal(apc_store_open(&store, bad[i], NULL, &why), APC_EINVAL);
        assert_null(store);
        assert_non_null(strstr(why.text, "expected"));
    }
}

static void test_before_init_there_is_nothing_and_nothing_is_made(void **state)
{
    (void)state;
    struct apc_store *store = open_uri("shm:shm-test-nobody-made-it");
    assert_int_equal(apc_store_connect(store), APC_ESCHEMA);
    assert_int_equal(append(store, 1, 1), APC_ESCHEMA);
    assert_non_null(strstr(apc_store_error(store), "apc init"));
    assert_int_equal(apc_store_get_tags(store, NULL, 0), APC_ESCHEMA);
    assert_int_equal(apc_store_put_tags(store, &(struct apc_tag){.table = APC_SENSOR, .name = "y"}, 1),
                     APC_ESCHEMA);
    assert_int_equal(apc_store_catalogue(store, NULL, 0, NULL), APC_ESCHEMA);
    assert_int_equal(apc_store_variables(store, NULL, 0), APC_ESCHEMA);
    assert_int_equal(apc_store_history(store, APC_SENSOR, 1, NULL, see, &(struct span){0}), APC_ESCHEMA);
    assert_int_equal(apc_store_vectors(store, APC_TICK, 1, NULL, see_vector, &(struct span){0}), APC_ESCHEMA);
    assert_int_equal(apc_store_events(store, NULL, count_event, &(int){0}), APC_ESCHEMA);
    assert_int_equal(apc_store_timing(store, NULL, sum_bins, (int64_t[4]){0}), APC_ESCHEMA);
    assert_int_equal(apc_store_maintain(
                         store, &(struct apc_retention){.size = sizeof(struct apc_retention), .samples = 1}),
                     APC_ESCHEMA);
    assert_false(apc_store_connected(store));
    assert_int_equal(access("/dev/shm/apc.shm-test-nobody-made-it", F_OK), -1);
    apc_store_close(store);
}

/*
 * Promise(stores/shared-memory-user): Shared memory: its user's alone, sizes of a MiB, rings, full,
 *   damaged, removed, cut short, another version, another processor.
 */
static void test_a_segment_is_its_users_alone(void **state)
{
    (void)state;
    struct stat st;
    assert_int_equal(stat(path, &st), 0);
    assert_int_equal(st.st_mode & 0777, 0600);
    assert_int_equal(st.st_size, 1 << 20);
    assert_int_equal(st.st_blocks, (1 << 20) / 512); /* all there: no SIGBUS later */
    assert_int_equal(chmod(path, 0644), 0);
    struct apc_store *store = open_store();
    assert_int_equal(apc_store_connect(store), APC_EPERM);
    assert_int_equal(apc_store_init(store), APC_EPERM);
    apc_store_close(store);
}

static void test_what_is_no_store_of_ours_is_refused_and_left_as_it_is(void **state)
{
    (void)state;
    const struct {
        long at, length; /* spoil one byte there; make it so long, -1: leave that */
        int err;
        const char *word;
    } cases[] = {
        {-1, 0, APC_ESTORE, "no store"},
        {-1, 10, APC_ESTORE, "no store"},
        {0, -1, APC_ESTORE, "no store"},
        /* the first version's checksum stands elsewhere */
        {offsetof(struct apc_shm_constants, layout), -1, APC_ESCHEMA, "another version"},
        {offsetof(struct apc_shm_constants, mib), -1, APC_ESTORE, "checksum"},
        {offsetof(struct apc_shm_constants, checksum), -1, APC_ESTORE, "checksum"},
        {-1, 4096, APC_ESTORE, "size"},
        {-1, (1 << 20) - 1, APC_ESTORE, "size"},
        {-1, (1 << 20) + 1, APC_ESTORE, "size"},
    };
    for (size_t i = 0; i < sizeof cases / sizeof cases[0]; i++) {
        void *other = NULL;
        assert_int_equal(set_up(&other), 0);
        apc_store_close(other);
        int fd = open(path, O_RDWR);
        char byte = 0, before[512] = {0}, after[512] = {0};
        if (cases[i].at >= 0) {
            assert_int_equal(pread(fd, &byte, 1, cases[i].at), 1);
            byte ^= 4;
            assert_int_equal(pwrite(fd, &byte, 1, cases[i].at), 1);
        }
        if (cases[i].length >= 0) {
            assert_int_equal(ftruncate(fd, cases[i].length), 0);
        }
        ssize_t length = pread(fd, before, sizeof before, 0);
        struct apc_store *store = open_store();
        assert_int_equal(apc_store_connect(store), cases[i].err);
        assert_int_equal(append(store, 1, 1), cases[i].err);
        assert_int_equal(apc_store_init(store), cases[i].err);
        assert_non_null(strstr(apc_store_error(store), cases[i].word));
        assert_non_null(strstr(apc_store_error(store), path));
        assert_int_equal(pread(fd, after, sizeof after, 0), length);
        assert_memory_equal(before, after, sizeof before);
        apc_store_close(store);
        close(fd);
    }
    unlink(path);
    assert_int_equal(mkdir(path, 0700), 0);
    struct apc_store *store = open_store();
    assert_true(apc_store_init(store) < 0);
    assert_int_equal(rmdir(path), 0);
    assert_int_equal(symlink("/dev/null", path), 0);
    assert_true(apc_store_init(store) < 0);
    assert_int_equal(unlink(path), 0);
    assert_int_equal(mkfifo(path, 0600), 0);
    assert_true(apc_store_init(store) < 0); /* and does not hang */
    apc_store_close(store);
}

/* Whatever byte of what never changes. */
/* Promise(stores/shared-memory-user) */
static void test_no_byte_of_the_constants_is_wrong_unseen(void **state)
{
    (void)state;
    const int fd = open(path, O_RDWR);
    for (size_t at = 0; at < sizeof(struct apc_shm_constants); at++) {
        char byte;
        assert_int_equal(pread(fd, &byte, 1, (off_t)at), 1);
        assert_int_equal(pwrite(fd, &(char){(char)~byte}, 1, (off_t)at), 1);
        struct apc_store *store = open_store();
        assert_true(apc_store_connect(store) < 0);
        assert_non_null(strstr(apc_store_error(store), path));
        apc_store_close(store);
        assert_int_equal(pwrite(fd, &byte, 1, (off_t)at), 1);
    }
    close(fd);
}

/* Promise(stores/shared-memory-user) */
static void test_a_segment_of_another_version_or_machine_is_refused(void **state)
{
    (void)state;
    const char *words[] = {"is of another version of libapc (layout ",
                           "is of a processor with the other byte order: ",
                           "is of programs for sparc processors, and this one is for ",
                           "is of programs with another C library (a header of "};
    struct apc_shm_constants own;
    int fd = open(path, O_RDWR);
    assert_int_equal(pread(fd, &own, sizeof own, 0), sizeof own);
    for (size_t i = 0; i < sizeof words / sizeof words[0]; i++) {
        struct apc_shm_constants c = own;
        c.layout += i == 0;
        c.layout = i == 1 ? __builtin_bswap32(c.layout) : c.layout;
        if (i == 2) {
            memcpy(c.machine, "sparc", sizeof "sparc");
        }
        c.header_size += i == 3;
        c.checksum = UINT64_C(0xcbf29ce484222325);
        for (size_t k = 0; k < offsetof(struct apc_shm_constants, checksum); k++) {
            c.checksum = (c.checksum ^ ((unsigned char *)&c)[k]) * UINT64_C(0x100000001b3);
        }
        assert_int_equal(pwrite(fd, &c, sizeof c, 0), sizeof c);
        struct apc_store *store = open_store();
        assert_int_equal(apc_store_connect(store), APC_ESCHEMA);
        assert_non_null(strstr(apc_store_error(store), words[i]));
        assert_int_equal(apc_store_init(store), APC_ESCHEMA);
        apc_store_close(store);
    }
    close(fd);
}

/* Promise(stores/shared-memory-user) */
static void test_a_segment_larger_than_dev_shm_is_refused_and_leaves_nothing(void **state)
{
    (void)state;
    struct statvfs fs;
    assert_int_equal(statvfs("/dev/shm", &fs), 0);
    const unsigned long long mib = ((unsigned long long)fs.f_blocks * fs.f_frsize >> 20) + 1;
    if (fs.f_blocks == 0 || mib > APC_SHM_MIB_MAX) {
        skip();
    }
    char large[160];
    unlink(path);
    snprintf(large, sizeof large, "%.*s?size=%llu", (int)strcspn(uri, "?"), uri, mib);
    struct apc_store *store = open_uri(large);
    assert_int_equal(apc_store_init(store), APC_ESTORE);
    unsigned long long needed = 0, left = 0;
    const char *needs = strstr(apc_store_error(store), "it needs ");
    assert_non_null(needs);
    assert_int_equal(sscanf(needs, "it needs %llu MiB of /dev/shm, which has %llu free", &needed, &left), 2);
    assert_int_equal(needed, mib);
    assert_true(left < mib);
    assert_int_equal(access(path, F_OK), -1);
    apc_store_close(store);
}

/* ---- Limits ---------------------------------------------------------------------------------- */

/* Promise(stores/shared-memory-user) */
static void test_a_full_segment_refuses_new_variables_and_keeps_the_rest(void **state)
{
    struct apc_store *store = *state;
    enum { MOST = 1600 };
    static struct apc_sample s[MOST + 10];
    for (int i = 0; i < MOST + 10; i++) {
        s[i] = sample(i, 1);
    }
    assert_int_equal(apc_store_append(store, s, MOST - 1), MOST - 1);
    struct apc_sample two[3] = {sample(5, 2), sample(9000, 1), sample(9001, 1)};
    assert_int_equal(apc_store_append(store, two, 3), APC_ESTORE); /* room for one, not for two */
    assert_non_null(strstr(apc_store_error(store), "full"));
    assert_int_equal(newest(store, 5), 1); /* none of it */
    assert_int_equal(newest(store, 9000), 0);
    assert_int_equal(newest(store, MOST - 2), 1); /* all of what was there */
    assert_int_equal(apc_store_append(store, two, 2), 2);
    assert_int_equal(newest(store, 9000), 1);
    assert_int_equal(append(store, 9001, 1), APC_ESTORE);
    assert_int_equal(append(store, 5, 3), 1); /* and it goes on */
    assert_int_equal(newest(store, 5), 3);
}

static void append_twenty(struct apc_store *store, int64_t seq)
{
    double value[20] = {0};
    struct apc_vector v = {
        .table = APC_TICK, .id = 1, .seq = seq, .time = 1000 * seq, .value = value, .n = 20, .room = 20};
    assert_int_equal(
        apc_store_append_rows(
            store, &(struct apc_rows){.size = sizeof(struct apc_rows), .vector = &v, .n_vectors = 1}),
        1);
}

/* A sample every 0.1 s, another and a vector every 0.7 s. */
/* Promise(run/shared-memory-keeps): Shared memory keeps what `apc run` says that it keeps. */
static void test_it_holds_what_it_says_that_it_holds(void **state)
{
    const struct apc_tag tags[] = {{.table = APC_SENSOR, .id = 1, .period = 0.1},
                                   {.table = APC_SENSOR, .id = 2, .period = 0.7},
                                   {.table = APC_TICK, .id = 1, .period = 0.7, .length = 20},
                                   {.table = APC_OPMODE, .id = 1}};
    const double held = apc_shm_holds(1, tags, 4);
    const int fast = (int)(held / 0.1 + 0.5);
    assert_true(held > 60 && held < 1e5);
    for (int k = 1; k <= fast + 20; k++) {
        assert_int_equal(append(*state, 1, k), 1);
        if (k % 7 == 0) {
            assert_int_equal(append(*state, 2, k / 7), 1);
            append_twenty(*state, k / 7);
        }
        if (k == fast || k == fast + 20) {
            struct span first = {0}, second = {0}, third = {0};
            apc_store_history(*state, APC_SENSOR, 1, NULL, see, &first);
            apc_store_history(*state, APC_SENSOR, 2, NULL, see, &second);
            apc_store_vectors(*state, APC_TICK, 1, NULL, see_vector, &third);
            const bool all = first.count == k && second.count == k / 7 && third.count == k / 7;
            assert_int_equal(all, k == fast);
        }
    }
    assert_true(apc_shm_holds(16, tags, 4) > held);
    assert_true(apc_shm_holds(0, tags, 4) == 0);
}

/* Promise(stores/shared-memory-user) */
static void test_a_history_ends_where_it_was_overwritten(void **state)
{
    (void)state;
    enum { N = 40000, KEPT = 12288 };
    unlink(path);
    char larger[160];
    snprintf(larger, sizeof larger, "%.*s?size=4", (int)strcspn(uri, "?"), uri);
    struct apc_store *store = open_uri(larger);
    assert_int_equal(apc_store_init(store), 0);
    for (int64_t seq = 1; seq <= N; seq++) {
        assert_int_equal(append(store, 1, seq), 1);
        if (seq % 1000 == 0) {
            struct span span = {0};
            const int kept = seq < KEPT ? (int)seq : KEPT;
            assert_int_equal(apc_store_history(store, APC_SENSOR, 1, NULL, see, &span), kept);
            assert_true(span.last == seq && span.first == seq - kept + 1);
        }
    }
    assert_int_equal(append(store, 1, N - 5000), 0);
    assert_int_equal(append(store, 1, 1), 0); /* overwritten: it was there */
    assert_int_equal(append(store, 1, N), 0);
    /* A second one finds fewer cells, and still keeps its newest. */
    for (int64_t seq = 1; seq <= N; seq++) {
        assert_int_equal(append(store, 2, 2 * seq), 1);
    }
    struct span span = {0};
    assert_true(apc_store_history(store, APC_SENSOR, 2, NULL, see, &span) >= 768);
    assert_int_equal(span.last, 2 * N);
    assert_int_equal(append(store, 2, 2 * N - 1), 1); /* a late one */
    assert_int_equal(append(store, 2, 2 * N - 1), 0);
    assert_int_equal(newest(store, 2), 2 * N);
    apc_store_close(store);
}

static void test_late_samples_never_push_the_newest_out(void **state)
{
    enum { LATE = 20000 };
    assert_int_equal(append(*state, 1, LATE + 1), 1);
    for (int64_t seq = 1; seq <= LATE; seq++) {
        assert_int_equal(append(*state, 1, seq), 1);
    }
    struct span span = {0};
    assert_true(apc_store_history(*state, APC_SENSOR, 1, NULL, see, &span) > 768);
    assert_int_equal(span.last, LATE + 1);
    assert_int_equal(newest(*state, 1), LATE + 1);
}

static int append_vector(struct apc_store *store, int64_t seq)
{
    double value[2] = {(double)seq, 1};
    struct apc_vector v = {
        .table = APC_TICK, .id = 1, .seq = seq, .time = 1000 * seq, .n = 2, .value = value};
    const struct apc_rows rows = {.size = sizeof rows, .vector = &v, .n_vectors = 1};
    const int stored = apc_store_append_rows(store, &rows);
    if (stored >= 0) {
        assert_string_equal(apc_store_error(store), "");
    }
    return stored;
}

/* A late one that the ring still has room for is stored, once; one that was overwritten was there. */
static void test_late_vectors_are_stored_while_there_is_room_for_them(void **state)
{
    enum { N = 20000 };
    struct span span = {0};
    for (int64_t seq = 1; seq <= N; seq++) {
        assert_int_equal(append_vector(*state, 2 * seq), 1);
    }
    const int kept = apc_store_vectors(*state, APC_TICK, 1, NULL, see_vector, &span);
    assert_true(kept > 10 && kept < N && span.last == 2 * N);
    assert_int_equal(append_vector(*state, 2 * N - 1), 1);
    assert_int_equal(append_vector(*state, 2 * N - 1), 0);
    assert_int_equal(append_vector(*state, 2 * N - 2), 0);
    assert_int_equal(append_vector(*state, 1), 0);
    span = (struct span){0};
    apc_store_vectors(*state, APC_TICK, 1, &(struct apc_range){.last = 2}, see_vector, &span);
    assert_true(span.first == 2 * N - 1 && span.last == 2 * N);
}

/* With standard input closed, as a daemon's may be, a segment's file is number 0. */
static void test_a_segment_may_have_any_number_for_its_file(void **state)
{
    apc_store_close(*state);
    unlink(path);
    const int input = dup(STDIN_FILENO);
    close(STDIN_FILENO);
    *state = open_store();
    const int made = apc_store_init(*state), stored = made == 0 ? append(*state, 1, 1) : made;
    apc_store_close(*state);
    struct apc_store *other = open_store(); /* it is there, and found with that number, too */
    const int64_t found = stored == 1 ? newest(other, 1) : 0;
    apc_store_close(other);
    dup2(input, STDIN_FILENO);
    close(input);
    *state = open_store();
    assert_int_equal(stored, 1);
    assert_int_equal(found, 1);
}

static int note_kind(void *ctx, const struct apc_event *e)
{
    static const char *const kinds[] = {"operator", "alarm", "start", "measurement"};
    for (unsigned i = 0; i < 4; i++) {
        *(unsigned *)ctx |= strcmp(e->kind, kinds[i]) == 0 ? 1U << i : 0;
    }
    return 0;
}

/*
 * Promise(stores/link-comes-goes): A link that comes and goes pushes out no action, alarm or start, and is
 *   counted instead of listed.
 */
static void test_a_flood_of_link_events_displaces_nothing_that_matters(void **state)
{
    struct apc_store *store = *state;
    const struct apc_event kept[] = {
        {.time = 1, .severity = APC_EVENT_INFO, .source = "anna", .kind = "operator"},
        {.time = 2, .severity = APC_EVENT_ALARM, .kind = "alarm"},
        {.time = 3, .severity = APC_EVENT_INFO, .kind = "start"},
        {.time = 4, .severity = APC_EVENT_ALARM, .kind = "measurement"},
    };
    struct apc_event link = {.severity = APC_EVENT_WARNING, .kind = "link"};
    unsigned there = 0;
    assert_int_equal(apc_store_append_events(store, kept, 4), 4);
    for (int i = 0; i < 1000; i++) {
        link.time = 1000 + i;
        assert_int_equal(apc_store_append_events(store, &link, 1), 1);
    }
    for (int i = 0; i < 1000; i++) { /* nor do alarms */
        const struct apc_event alarm = {.time = 2000 + i, .severity = APC_EVENT_ALARM, .kind = "alarm"};
        assert_int_equal(apc_store_append_events(store, &alarm, 1), 1);
    }
    assert_true(apc_store_events(store, NULL, note_kind, &there) > 4);
    assert_int_equal(there, 15);
}

/*
 * Promise(run/shared-memory-keeps)
 * Promise(stores/shared-memory-user)
 */
static void test_rings_of_events_and_timing_keep_the_newest(void **state)
{
    struct apc_store *store = *state;
    enum { EVENTS = 24, ROWS = 12 };
    struct apc_event e[EVENTS + 1];
    for (int i = 0; i <= EVENTS; i++) {
        e[i] = (struct apc_event){.time = 1000 * i, .severity = APC_EVENT_INFO};
    }
    assert_int_equal(apc_store_append_events(store, e, EVENTS), EVENTS);
    assert_int_equal(apc_store_append_events(store, &e[EVENTS], 1), 1);
    int next = 1;
    assert_int_equal(apc_store_events(store, NULL, count_event, &next), EVENTS);
    assert_int_equal(next, EVENTS + 1);

    enum { BINS = 1000 };
    static int64_t low[BINS], high[BINS], count[BINS];
    for (int i = 0; i < BINS; i++) {
        low[i] = 10 * i;
        high[i] = 10 * i + 9;
        count[i] = i;
    }
    const struct apc_timing_row row = {.quantity = "run",
                                       .task = "a task with a long enough name",
                                       .bin_low = low,
                                       .bin_high = high,
                                       .bin_count = count,
                                       .n_bins = BINS};
    for (int i = 0; i < ROWS + 3; i++) {
        assert_int_equal(apc_store_append_timing(store, &row, 1), 1);
    }
    int64_t sum[4] = {0};
    assert_int_equal(apc_store_timing(store, NULL, sum_bins, sum), ROWS);
    assert_int_equal(apc_shm_timing_rows(1), ROWS);
    assert_int_equal(apc_shm_timing_rows(0), 0);
    assert_int_equal(sum[0], ROWS * (BINS * (BINS - 1) / 2)); /* merged, none lost */
    assert_int_equal(sum[1], sum[2]);
    assert_true(sum[2] <= 256 * ROWS);

    struct apc_tag tags[65] = {{0}};
    for (int i = 0; i < 65; i++) {
        tags[i] = (struct apc_tag){.table = APC_SENSOR, .id = i};
        snprintf(tags[i].name, sizeof tags[i].name, "%d", i);
    }
    assert_int_equal(apc_store_put_tags(store, tags, 64), 64);
    assert_int_equal(apc_store_put_tags(store, tags, 65), APC_ESTORE);
    assert_int_equal(apc_store_get_tags(store, NULL, 0), 64);
}

struct kinds {
    int n[3]; /* operator, access, other */
    apc_ns last;
};

/* Each was given as its time how many came before it. */
static int count_kinds(void *ctx, const struct apc_event *e)
{
    struct kinds *k = ctx;
    k->n[strcmp(e->kind, "operator") == 0 ? 0 : strcmp(e->kind, "access") == 0 ? 1 : 2]++;
    assert_true(e->time > k->last);
    k->last = e->time;
    return 0;
}

/* Promise(stores/shared-memory-user) */
static void test_no_chatter_pushes_out_what_people_did(void **state)
{
    struct apc_store *store = *state;
    enum { SHOWN = 12, ACTIONS = 24, LOGINS = 6 };
    struct apc_event all[ACTIONS + 1] = {0};
    struct kinds kinds = {.last = -1};
    apc_ns arrived = 0;
    struct apc_event action = {.severity = APC_EVENT_INFO, .kind = "operator"};
    struct apc_event login = {.severity = APC_EVENT_WARNING, .kind = "access"};
    struct apc_event chatter = {.severity = APC_EVENT_INFO, .kind = "link"};
    for (int i = 0; i < 100 * ACTIONS; i++) {
        if (i < ACTIONS) {
            action.time = ++arrived * 1000;
            assert_int_equal(apc_store_append_events(store, &action, 1), 1);
        }
        if (i < LOGINS) {
            login.time = ++arrived * 1000;
            assert_int_equal(apc_store_append_events(store, &login, 1), 1);
        }
        chatter.time = ++arrived * 1000;
        assert_int_equal(apc_store_append_events(store, &chatter, 1), 1);
    }
    assert_int_equal(apc_store_events(store, NULL, count_kinds, &kinds), ACTIONS + LOGINS + SHOWN);
    assert_int_equal(kinds.n[0], ACTIONS);
    assert_int_equal(kinds.n[1], LOGINS);
    assert_int_equal(kinds.n[2], SHOWN);
    kinds = (struct kinds){.last = -1};
    assert_int_equal(apc_store_events(store, &(struct apc_range){.last = SHOWN + 1}, count_kinds, &kinds),
                     SHOWN + 1);
    assert_int_equal(kinds.n[0], 1); /* the newest of all, whatever their kind */

    for (int i = 0; i <= ACTIONS; i++) {
        all[i] = i <= LOGINS ? login : action;
        all[i].time = ++arrived * 1000;
    }
    /* More in one call than there is room for: the last of them are there, as after one call for each. */
    assert_int_equal(apc_store_append_events(store, all, ACTIONS + 1), ACTIONS + 1); /* 7 logins */
    kinds = (struct kinds){.last = -1};
    assert_int_equal(apc_store_events(store, NULL, count_kinds, &kinds), ACTIONS + LOGINS + SHOWN);
    assert_int_equal(kinds.n[1], LOGINS);
    const struct apc_retention keep = {.size = sizeof keep, .events = 1};
    assert_int_equal(apc_store_maintain(store, &keep), ACTIONS + LOGINS + SHOWN);
    assert_int_equal(apc_store_events(store, NULL, count_kinds, &kinds), 0);
}

/* Whatever stands in a damaged segment: who reads it is told, at once, and never waits for what cannot come. */
/* Promise(stores/shared-memory-user) */
static void test_a_damaged_segment_is_said_to_be_one(void **state)
{
    struct apc_store *store = *state;
    struct apc_sample s = sample(1, 0), all[2];
    const struct apc_event event = {.time = 1000, .severity = APC_EVENT_INFO};
    const struct apc_retention keep = {.size = sizeof keep, .samples = 1, .events = 1};
    int next = 1;
    assert_int_equal(append(store, 1, 1), 1);
    assert_int_equal(apc_store_append_events(store, &event, 1), 1);
    struct apc_shm *shm = apc_shm_of(store);
    apc_word *marks[] = {shm->slot[0].mark, shm->header->tags_mark, shm->header->meta.mark};
    for (size_t i = 0; i < 3; i++) { /* both versions are of a generation that is to come */
        const uint64_t before[2] = {apc_word_get(&marks[i][0]), apc_word_get(&marks[i][1])};
        apc_word_put(&marks[i][0], apc_shm_generation(shm) + 7);
        apc_word_put(&marks[i][1], apc_shm_generation(shm) + 7);
        if (i == 0) {
            assert_int_equal(apc_store_wait(store, &s, 1, APC_NS_PER_S), 1); /* and reading says why */
            assert_int_equal(apc_store_read(store, &s, 1), APC_ESTORE);
            assert_int_equal(apc_store_history(store, APC_SENSOR, 1, NULL, see, &(struct span){0}),
                             APC_ESTORE);
            assert_int_equal(apc_store_variables(store, all, 2), APC_ESTORE);
            assert_int_equal(apc_store_maintain(store, &keep), APC_ESTORE);
        } else if (i == 1) {
            assert_int_equal(apc_store_get_tags(store, NULL, 0), APC_ESTORE);
            assert_int_equal(apc_store_catalogue(store, NULL, 0, NULL), APC_ESTORE);
        } else {
            assert_int_equal(apc_store_events(store, NULL, count_event, &next), APC_ESTORE);
        }
        assert_non_null(strstr(apc_store_error(store), "corrupt"));
        apc_word_put(&marks[i][0], before[0]);
        apc_word_put(&marks[i][1], before[1]);
    }
    struct apc_shm_cell *version = shm->slot[0].version;
    apc_word *kept[] = {&version[0].ring, &version[1].ring},
             *counters[] = {shm->header->meta.counters[0], shm->header->meta.counters[1]};
    for (int i = 0; i < 2; i++) { /* rings that hold more than there can be */
        apc_word_put(kept[i], UINT64_MAX);
        apc_word_put(&counters[i][offsetof(struct apc_shm_counters, log) / 8 + 1], UINT64_MAX);
    }
    assert_int_equal(apc_store_history(store, APC_SENSOR, 1, NULL, see, &(struct span){0}), APC_ESTORE);
    assert_int_equal(apc_store_maintain(store, &keep), APC_ESTORE);
    assert_int_equal(append_vector(store, 1), 1);
    struct apc_shm_cell *rows = shm->slot[1].version;
    const uint64_t whole = apc_word_get(&rows[0].ring) | apc_word_get(&rows[1].ring);
    static const uint64_t wrong[] = {0xff, 0xff00, 0x20000}; /* pieces, length of a row, rows: too many */
    for (size_t i = 0; i < sizeof wrong / sizeof wrong[0]; i++) {
        apc_word_put(&rows[0].ring, whole | wrong[i]);
        apc_word_put(&rows[1].ring, whole | wrong[i]);
        assert_int_equal(apc_store_vectors(store, APC_TICK, 1, NULL, see_vector, &(struct span){0}),
                         APC_ESTORE);
        assert_non_null(strstr(apc_store_error(store), "corrupt"));
    }
    assert_int_equal(apc_store_maintain(store, &(struct apc_retention){.size = sizeof keep, .events = 1}),
                     APC_ESTORE);
    assert_int_equal(apc_store_events(store, NULL, count_event, &next), APC_ESTORE);
}

/* glibc would end the process: neither a wait for a thread that does not exist, nor another kind of mutex, is
 * begun. */
static void test_a_damaged_lock_is_said_to_be_one(void **state)
{
    struct apc_store *store = *state;
    struct apc_shm *shm = apc_shm_of(store);
    pthread_mutex_t *const writer = &shm->header->writer;
    const pthread_mutex_t whole = *writer;
    assert_int_equal(append(store, 1, 1), 1);
    writer->__data.__lock = 0x3ffffff0; /* no thread may have that number */
    assert_int_equal(append(store, 1, 2), APC_ESTORE);
    assert_non_null(strstr(apc_store_error(store), "its writers' lock is damaged"));
    *writer = whole;
    static const int bits[] = {1, 0x10, 0x20, 0x80, 0x40000000};
    for (size_t i = 0; i < sizeof bits / sizeof bits[0]; i++) {
        writer->__data.__kind ^= bits[i];
        assert_int_equal(append(store, 1, 2), APC_ESTORE);
        assert_non_null(strstr(apc_store_error(store), "its writers' lock is damaged"));
        *writer = whole;
    }
    assert_int_equal(append(store, 1, 2), 1);
}

/* ---- Removed and made anew ---------------------------------------------------------------------- */

/* Promise(stores/shared-memory-user) */
static void test_a_removed_segment_is_noticed_and_the_new_one_used(void **state)
{
    struct apc_store *store = *state, *other = open_store();
    int64_t last[1];
    assert_int_equal(append(store, 1, 7), 1);
    assert_int_equal(apc_store_claim(store, APC_SENSOR, 1, last), 0);
    assert_int_equal(apc_store_claim(store, APC_STATE, 1, last), 0);
    assert_int_equal(unlink(path), 0);
    struct apc_sample s = sample(1, 0);
    while (apc_store_read(store, &s, 1) == 0) { /* until it has noticed */
    }
    assert_int_equal(apc_store_read(store, &s, 1), APC_ESCHEMA);
    assert_false(apc_store_connected(store));
    assert_int_equal(apc_store_init(other), 0);
    assert_int_equal(newest(other, 1), 0);
    assert_int_equal(newest(store, 1), 0);                                    /* the new one's */
    assert_int_equal(apc_store_claim(other, APC_SENSOR, 1, last), APC_EBUSY); /* claims were renewed */

    assert_int_equal(unlink(path), 0);
    while (apc_store_init(other) != 0) {
    }
    assert_int_equal(apc_store_claim(other, APC_STATE, 1, last), 0);
    int err = 0;
    while ((err = apc_store_read(store, &s, 1)) == 0) {
    }
    assert_int_equal(err, APC_EBUSY); /* another writer took what was ours */
    apc_store_close(other);
    assert_int_equal(newest(store, 1), 0);
}

/* Whoever may write the file may cut it short; to touch what is gone would be the end of the process. */
/* Promise(stores/shared-memory-user) */
static void test_a_segment_cut_short_is_refused_and_not_touched(void **state)
{
    struct apc_store *store = *state;
    struct apc_sample s = sample(1, 0);
    assert_int_equal(append(store, 1, 7), 1);
    assert_int_equal(truncate(path, 4096), 0);
    apc_shm_of(store)->checked = 0; /* it looked long ago */
    assert_int_equal(apc_store_read(store, &s, 1), APC_ESTORE);
    assert_non_null(strstr(apc_store_error(store), "has not the size"));
    assert_int_equal(append(store, 1, 8), APC_ESTORE);
    assert_int_equal(apc_store_wait(store, &s, 1, 0), APC_ESTORE);
    assert_false(apc_store_connected(store));
    const int fd = dup(2); /* what was the segment's may be another's now */
    apc_store_close(store);
    *state = NULL;
    assert_int_equal(fcntl(fd, F_GETFD) & ~FD_CLOEXEC, 0);
    close(fd);
}

static void test_who_waits_notices_a_removed_segment(void **state)
{
    struct apc_sample seen = sample(1, 0);
    assert_int_equal(apc_store_wait(*state, &seen, 1, 0), 0);
    assert_int_equal(unlink(path), 0);
    assert_int_equal(apc_store_wait(*state, &seen, 1, 3600 * APC_NS_PER_S), APC_ESCHEMA);
}

/* ---- Processes --------------------------------------------------------------------------------- */

static void wait_for(pid_t pid, int signal)
{
    int status = 0;
    assert_int_equal(waitpid(pid, &status, 0), pid);
    assert_true(signal ? WIFSIGNALED(status) && WTERMSIG(status) == signal
                       : WIFEXITED(status) && WEXITSTATUS(status) == 0);
}

static void test_processes_that_init_at_once_share_one_segment(void **state)
{
    enum { PROCESSES = 8, ROUNDS = 20 };
    apc_store_close(*state);
    for (int round = 0; round < ROUNDS; round++) {
        pid_t child[PROCESSES];
        int go[2];
        char byte;
        unlink(path);
        assert_int_equal(pipe(go), 0);
        for (int i = 0; i < PROCESSES; i++) {
            child[i] = fork();
            if (child[i] == 0) {
                close(go[1]);
                struct apc_store *store = open_store();
                bool good =
                    read(go[0], &byte, 1) == 0 && apc_store_init(store) >= 0 && append(store, i, 1) == 1;
                _exit(!good);
            }
        }
        close(go[0]);
        close(go[1]); /* all of them, now */
        for (int i = 0; i < PROCESSES; i++) {
            wait_for(child[i], 0);
        }
        struct apc_store *store = open_store();
        for (int i = 0; i < PROCESSES; i++) {
            assert_int_equal(newest(store, i), 1);
        }
        apc_store_close(store);
    }
    *state = open_store();
}

static void test_a_dead_writers_claim_is_free(void **state)
{
    int ready[2];
    int64_t last[1];
    char byte;
    assert_int_equal(pipe(ready), 0);
    pid_t child = fork();
    if (child == 0) {
        struct apc_store_options options = {.size = sizeof options, .name = "the first"};
        struct apc_store *store = NULL;
        if (apc_store_open(&store, uri, &options, NULL) == 0 &&
            apc_store_claim(store, APC_ACTUATOR, 1, last) == 0 && write(ready[1], "", 1) == 1) {
            pause();
        }
        _exit(1);
    }
    assert_int_equal(read(ready[0], &byte, 1), 1);
    assert_int_equal(apc_store_claim(*state, APC_ACTUATOR, 1, last), APC_EBUSY);
    assert_non_null(strstr(apc_store_error(*state), "already written by the first"));
    kill(child, SIGKILL);
    wait_for(child, SIGKILL);
    assert_int_equal(apc_store_claim(*state, APC_ACTUATOR, 1, last), 0);
    close(ready[0]);
    close(ready[1]);
}

/* Samples of one append belong together: no reader ever sees two appends mixed, however fast they come. */
/* Who died while it claimed a variable that was new has left its number in a slot that nobody uses. */
static void test_a_new_variable_has_no_owner(void **state)
{
    struct apc_store *store = *state, *other = open_store();
    struct apc_shm *shm = apc_shm_of(store);
    int64_t last[3];
    assert_int_equal(apc_store_claim(store, APC_SENSOR, 1, last), 0);
    const uint32_t owner = atomic_load(&shm->slot[0].owner);
    assert_true(owner > 0);
    for (int i = 1; i < 3; i++) {
        atomic_store(&shm->slot[i].owner, owner);
    }
    assert_int_equal(append(other, 2, 1), 1);
    struct apc_sample v[2] = {sample(2, 0), sample(3, 0)};
    assert_int_equal(apc_store_claim_set(other, v, 2), 0);
    assert_int_equal(apc_store_claim(other, APC_SENSOR, 1, last), APC_EBUSY);
    apc_store_close(other);
}

/* Promise(stores/shared-memory-user) */
static void test_a_flat_out_writer_neither_tears_nor_starves_a_reader(void **state)
{
    enum { N = 10, READS = 20000 };
    struct apc_store *store = *state;
    struct apc_sample s[N];
    for (int i = 0; i < N; i++) {
        s[i] = sample(i, 1);
    }
    assert_int_equal(apc_store_append(store, s, N), N);
    pid_t child = fork();
    if (child == 0) {
        struct apc_store *writer = open_store();
        for (int64_t seq = 2;; seq++) {
            for (int i = 0; i < N; i++) {
                s[i] = sample(i, seq);
            }
            if (apc_store_append(writer, s, N) != N) {
                _exit(1);
            }
        }
    }
    int64_t before = 0;
    int torn = 0, fell = 0, failed = 0, rows_wrong = 0;
    for (int k = 0; k < READS; k++) {
        failed += apc_store_read(store, s, N) != 0;
        for (int i = 0; i < N; i++) {
            torn += s[i].seq != s[0].seq || s[i].time != 1000 * s[i].seq || s[i].value < (double)s[i].seq ||
                    s[i].value > (double)s[i].seq;
        }
        fell += s[0].seq < before;
        before = s[0].seq;
        if (k % 1000 == 0) {
            struct span span = {0};
            int rows = apc_store_history(store, APC_SENSOR, 3, &(struct apc_range){.last = 50}, see, &span);
            rows_wrong += rows > 50 || rows < 1 || span.last - span.first != rows - 1 || span.last < before;
        }
    }
    assert_int_equal(kill(child, SIGKILL), 0);
    wait_for(child, SIGKILL);
    assert_int_equal(failed, 0);
    assert_int_equal(torn, 0);
    assert_int_equal(fell, 0);
    assert_int_equal(rows_wrong, 0);
}

#define T(name) cmocka_unit_test_setup_teardown(name, set_up, tear_down)

int main(void)
{
    const struct CMUnitTest tests[] = {
        T(test_a_uri_that_names_no_segment_is_refused),
        T(test_before_init_there_is_nothing_and_nothing_is_made),
        T(test_a_segment_is_its_users_alone),
        T(test_what_is_no_store_of_ours_is_refused_and_left_as_it_is),
        T(test_a_damaged_segment_is_said_to_be_one),
        T(test_a_damaged_lock_is_said_to_be_one),
        T(test_a_segment_of_another_version_or_machine_is_refused),
        T(test_no_byte_of_the_constants_is_wrong_unseen),
        T(test_a_segment_larger_than_dev_shm_is_refused_and_leaves_nothing),
        T(test_a_full_segment_refuses_new_variables_and_keeps_the_rest),
        T(test_it_holds_what_it_says_that_it_holds),
        T(test_a_history_ends_where_it_was_overwritten),
        T(test_late_samples_never_push_the_newest_out),
        T(test_late_vectors_are_stored_while_there_is_room_for_them),
        T(test_a_segment_may_have_any_number_for_its_file),
        T(test_rings_of_events_and_timing_keep_the_newest),
        T(test_a_flood_of_link_events_displaces_nothing_that_matters),
        T(test_no_chatter_pushes_out_what_people_did),
        T(test_a_segment_cut_short_is_refused_and_not_touched),
        T(test_a_removed_segment_is_noticed_and_the_new_one_used),
        T(test_who_waits_notices_a_removed_segment),
        T(test_processes_that_init_at_once_share_one_segment),
        T(test_a_dead_writers_claim_is_free),
        T(test_a_new_variable_has_no_owner),
        T(test_a_flat_out_writer_neither_tears_nor_starves_a_reader),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}

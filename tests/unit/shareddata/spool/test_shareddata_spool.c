/* SPDX-License-Identifier: BSD-3-Clause */
/* Store and forward: what a spool keeps, gives on, refuses and recovers. */
#include <fcntl.h>
#include <limits.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/fsuid.h>
#include <sys/resource.h>
#include <sys/stat.h>
#include <sys/wait.h>
#include <unistd.h>

#include "cluster.h"
#include "proxy.h"
#include "spool_rig.h"

static struct cluster *cluster;
static char direct[512], through[800];
static struct proxy *proxy;

static struct apc_store *open_plain(void)
{
    struct apc_store_options o = options();
    o.spool = NULL;
    return open_with(direct, &o);
}

static int set_up_server(void **state)
{
    char listening[400], server[400];
    set_up(state);
    if (!cluster) {
        cluster = cluster_start();
    }
    snprintf(direct, sizeof direct, "%s#plant%d", cluster_uri(cluster), plant);
    snprintf(through, sizeof through, "postgresql://apc@/%s?host=%s#plant%d", cluster_database(cluster),
             folder, plant);
    snprintf(listening, sizeof listening, "unix:%s/.s.PGSQL.5432", folder);
    snprintf(server, sizeof server, "unix:%s", cluster_socket(cluster));
    proxy = proxy_start(listening, server);
    struct apc_store *store = open_plain();
    int had = apc_store_init(store);
    apc_store_close(store);
    return had != 0;
}

static int clear_server(void **state)
{
    proxy_stop(proxy);
    return clear_folder(state);
}

static struct apc_event event(int number)
{
    struct apc_event e = {.time = T0 + number * APC_NS_PER_MS, .severity = APC_EVENT_INFO};
    snprintf(e.source, sizeof e.source, "writer");
    snprintf(e.kind, sizeof e.kind, "store");
    snprintf(e.text, sizeof e.text, "event %d", number);
    return e;
}

static struct apc_spool_info look(void)
{
    struct apc_spool_info info = {.size = sizeof info};
    struct apc_error why = {""};
    if (apc_spool_look(spool, &info, &why) != 0) {
        fail_msg("%s", why.text);
    }
    return info;
}

/* Seqs 1..n of variable 1, each with its value, once. */
static int expect_next(void *ctx, const struct apc_sample *s)
{
    int64_t *seq = ctx;
    assert_int_equal(s->seq, ++*seq);
    assert_near(s->value, (double)(s->seq * 10 + 1), 0.0);
    assert_int_equal(s->time, T0 + s->seq * APC_NS_PER_MS);
    return 0;
}

static void assert_stored(int64_t n)
{
    int64_t seq = 0;
    struct apc_store *store = open_plain();
    ok(store, apc_store_history(store, APC_SENSOR, 1, NULL, expect_next, &seq));
    assert_int_equal(seq, n);
    apc_store_close(store);
}

static const char *count_events(void)
{
    char sql[128];
    snprintf(sql, sizeof sql, "SELECT count(*) || ' ' || count(DISTINCT text) FROM plant%d.event", plant);
    return cluster_query(cluster, sql);
}

/* What a process leaves that is killed: the file as it lies there, without its lock. */
static void in_a_process_that_dies(const char *uri, void (*fn)(struct apc_store *))
{
    int status;
    pid_t pid = fork();
    if (pid == 0) {
        fn(open_spooled(uri));
        _exit(0);
    }
    assert_int_equal(waitpid(pid, &status, 0), pid);
    assert_int_equal(status, 0);
}

/* ---- While the store is away ---------------------------------------------------------------- */

/*
 * Promise(stores/spool-acknowledges): A spool acknowledges, drains in order, none twice, survives its
 *   writer, says its damage, keeps the oldest when full.
 */
static void test_an_append_is_acknowledged_once_it_is_in_the_spool(void **state)
{
    (void)state;
    struct apc_store *store = open_spooled(nowhere);
    append(store, 1, 1);
    assert_says(apc_store_error(store), "cannot connect");
    struct apc_sample two[2] = {sample(1, 2, 21), sample(2, 1, 12)};
    assert_int_equal(apc_store_append(store, two, 2), 2);
    struct apc_event e = event(1);
    assert_int_equal(apc_store_append_events(store, &e, 1), 1);
    struct apc_spool_stats own = stats_of(store);
    struct apc_spool_info seen = look(); /* from outside, while it is open */
    assert_int_equal(own.samples, 3);
    assert_int_equal(own.events, 1);
    assert_int_equal(own.oldest, T0 + APC_NS_PER_MS);
    assert_int_equal(seen.stats.samples, 3);
    assert_int_equal(seen.stats.events, 1);
    assert_int_equal(seen.stats.oldest, own.oldest);
    assert_int_equal(seen.stats.bytes, own.bytes);
    assert_string_equal(seen.writer, "writer");
    assert_null(strstr(seen.store, "secret"));
    apc_store_close(store);
    store = open_spooled(nowhere); /* they outlive the writer */
    assert_int_equal(stats_of(store).samples, 3);
    assert_int_equal(stats_of(store).events, 1);
    apc_store_close(store);
}

static void test_a_spool_without_records_is_removed_at_the_end(void **state)
{
    (void)state;
    struct apc_store *store = open_spooled(nowhere);
    assert_int_equal(access(spool, F_OK), 0); /* made at once: what cannot be shows at the start */
    apc_store_close(store);
    assert_int_equal(access(spool, F_OK), -1);
}

/* Promise(stores/tick-not-held) */
static void test_what_commands_is_not_spooled(void **state)
{
    (void)state;
    struct apc_store *store = open_spooled(nowhere);
    struct apc_sample s = {.table = APC_SETPOINT, .id = 1, .value = 3};
    assert_int_equal(apc_store_put(store, &s, 1), APC_ECONN);
    assert_int_equal(stats_of(store).samples, 0);
    apc_store_close(store);
}

/* Promise(stores/tick-not-held) */
static void test_a_reader_gets_the_last_value_with_its_own_time_and_an_uncertain_status(void **state)
{
    (void)state;
    struct apc_store *store = open_spooled(through), *other = open_plain();
    struct apc_sample s[2] = {sample(1, 1, 11), sample(2, 1, 12)};
    s[1].status = APC_BAD_SENSOR_FAILURE;
    ok(other, apc_store_append(other, s, 2));
    struct apc_sample r[2] = {{.table = APC_SENSOR, .id = 1}, {.table = APC_SENSOR, .id = 2}};
    ok(store, apc_store_read(store, r, 2));
    assert_int_equal(r[0].status, APC_GOOD);
    proxy_set(proxy, PROXY_REFUSE);
    for (int i = 0; i < 3; i++) {
        ok(store, apc_store_read(store, r, 2));
        assert_int_equal(r[0].status, APC_UNCERTAIN_LAST_USABLE);
        assert_int_equal(r[1].status, APC_BAD_SENSOR_FAILURE);
        assert_int_equal(r[0].seq, 1);
        assert_int_equal(r[0].time, s[0].time);
        assert_near(r[0].value, 11, 0);
    }
    struct apc_sample unseen = {.table = APC_SENSOR, .id = 3};
    assert_int_equal(apc_store_read(store, &unseen, 1), APC_ECONN);
    proxy_set(proxy, PROXY_PASS);
    s[0] = sample(1, 2, 21);
    ok(other, apc_store_append(other, s, 1));
    ok(store, apc_store_read(store, r, 2));
    assert_int_equal(r[0].status, APC_GOOD);
    assert_int_equal(r[0].seq, 2);
    apc_store_close(store);
    apc_store_close(other);
}

static void test_what_waits_is_newer_than_what_is_stored(void **state)
{
    (void)state;
    struct apc_store *store = open_spooled(through);
    append(store, 1, 1);
    proxy_set(proxy, PROXY_REFUSE);
    append(store, 1, 2);
    proxy_set(proxy, PROXY_PASS); /* the store is there again, and knows of seq 1 only */
    struct apc_sample r = {.table = APC_SENSOR, .id = 1};
    ok(store, apc_store_read(store, &r, 1));
    assert_int_equal(r.seq, 2);
    apc_store_close(store);
}

/* A controller that reads through a spool while the store is away: holds, then goes to its fault value. */
/* Promise(stores/tick-not-held) */
static void test_a_controller_does_not_take_an_old_value_for_a_new_one(void **state)
{
    (void)state;
    const struct apc_controller_loop loop = {
        .id = 1, .mode = 1, .low = -1.0, .high = 1.0, .fault = -0.7, .hold = 3 * APC_NS_PER_S};
    const struct apc_law *law = NULL;
    void *handle = NULL;
    struct apc_error why = {""};
    assert_int_equal(apc_law_find("pi", &law, &handle, &why), 0);
    const struct apc_controller_options o = {.size = sizeof o,
                                             .law = law,
                                             .dim = {.ny = 1, .nz = 1, .nu = 1, 0},
                                             .period = APC_NS_PER_S,
                                             .horizon = 2 * APC_NS_PER_S,
                                             .loop = &loop};
    struct apc_controller *c = NULL;
    assert_int_equal(apc_controller_create(&c, &o, &why), 0);
    const struct apc_rows *in = apc_controller_in(c), *out = apc_controller_out(c);
    struct apc_store *store = open_spooled(through), *other = open_plain();
    struct apc_sample rows[] = {sample(1, 1, 11),
                                {.table = APC_SETPOINT, .id = 1, .seq = 1, .time = T0, .value = 10},
                                {.table = APC_OPMODE, .id = 1, .seq = 1, .time = T0, .value = APC_MODE_AUTO}};
    ok(other, apc_store_append(other, rows, 3));
    enum apc_notice_kind told[8] = {0};
    for (int i = 0; i < 8; i++) {
        const struct apc_now now = {.mono = i * APC_NS_PER_S, .utc = T0 + i * APC_NS_PER_S};
        struct apc_notice notice = {0};
        ok(store, apc_store_read(store, in->sample, in->n_samples));
        proxy_set(proxy, PROXY_REFUSE); /* from the second tick on */
        assert_true(apc_controller_compute(c, now, (uint64_t)i, true, &notice) > 0);
        told[i] = notice.kind;
    }
    assert_int_equal(told[3], APC_NOTICE_HOLD);
    assert_int_equal(told[6], APC_NOTICE_FAULT);
    assert_near(out->sample[0].value, loop.fault, 0.0);
    apc_store_close(store);
    apc_store_close(other);
    apc_controller_destroy(c);
    apc_plugin_close(handle);
}

/* ---- At its return --------------------------------------------------------------------------- */

/* Promise(stores/spool-acknowledges) */
static void test_it_drains_in_order_and_without_duplicates(void **state)
{
    (void)state;
    struct apc_store *store = open_spooled(through);
    append(store, 1, 1);
    proxy_set(proxy, PROXY_REFUSE);
    for (int64_t seq = 2; seq <= 2500; seq += 17) {
        struct apc_sample s[17];
        for (int64_t i = 0; i < 17; i++) {
            s[i] = sample(1, seq + i, (double)((seq + i) * 10 + 1));
        }
        assert_int_equal(apc_store_append(store, s, 17), 17);
    }
    assert_int_equal(stats_of(store).samples, 2499);
    proxy_set(proxy, PROXY_PASS);
    append(store, 1, 2501); /* behind those that wait */
    drain(store);
    assert_int_equal(stats_of(store).samples, 0);
    assert_int_equal(stats_of(store).oldest, 0);
    assert_int_equal(stats_of(store).drained, 2500);
    append(store, 1, 2502);
    assert_int_equal(stats_of(store).drained, 2500); /* that one went straight on */
    assert_stored(2502);
    apc_store_close(store);
}

static void test_an_append_whose_answer_was_lost_is_stored_once(void **state)
{
    (void)state;
    struct apc_store *store = open_spooled(through);
    append(store, 1, 1);
    proxy_arm(proxy, PROXY_TO_CLIENT, 0, PROXY_REFUSE);
    append(store, 1, 2); /* stored, and spooled as well */
    append(store, 1, 3);
    assert_stored(2);
    proxy_set(proxy, PROXY_PASS);
    proxy_arm(proxy, PROXY_TO_CLIENT, 4000, PROXY_CUT); /* while it drains */
    drain(store);
    assert_stored(3);
    assert_int_equal(stats_of(store).damaged, 0); /* its own row is not taken for another's */
    apc_store_close(store);
}

static void spool_some(struct apc_store *store)
{
    for (int64_t seq = 1; seq <= 30; seq++) {
        append(store, 1, seq);
    }
    for (int i = 1; i <= 5; i++) {
        struct apc_event e = event(i);
        ok(store, apc_store_append_events(store, &e, 1));
    }
}

/* The next process drains what a killed one left, and what both sent is there once, events too. */
/* Promise(stores/spool-acknowledges) */
static void test_a_killed_writers_spool_is_drained_by_the_next(void **state)
{
    (void)state;
    proxy_set(proxy, PROXY_REFUSE);
    in_a_process_that_dies(through, spool_some);
    proxy_set(proxy, PROXY_PASS);
    struct apc_store_options o = options();
    o.timeout = APC_NS_PER_S / 2;
    struct apc_store *store = open_with(through, &o);
    assert_int_equal(stats_of(store).samples, 30);
    for (uint64_t bytes = 0; stats_of(store).bytes > 0 && bytes < 20000; bytes += 211) {
        (void)apc_store_connect(store);
        proxy_arm(proxy, PROXY_TO_CLIENT, bytes, PROXY_CUT);
        (void)apc_store_connect(store);
        apc_store_close(store); /* with what is left */
        proxy_set(proxy, PROXY_PASS);
        store = open_with(through, &o);
    }
    drain(store);
    assert_stored(30);
    assert_string_equal(count_events(), "5 5");
    apc_store_close(store);
}

/* Promise(stores/spool-acknowledges) */
static void test_events_whose_answer_was_lost_are_stored_once(void **state)
{
    (void)state;
    struct apc_store *store = open_spooled(through);
    ok(store, apc_store_connect(store));
    struct apc_event e[3] = {event(1), event(2), event(3)};
    proxy_arm(proxy, PROXY_TO_CLIENT, 0, PROXY_REFUSE);
    assert_int_equal(apc_store_append_events(store, e, 2), 2);
    assert_string_equal(count_events(), "2 2");
    assert_int_equal(apc_store_append_events(store, e + 2, 1), 1);
    proxy_set(proxy, PROXY_PASS);
    drain(store);
    assert_string_equal(count_events(), "3 3");
    apc_store_close(store);
}

static void test_a_large_spool_drains_in_portions(void **state)
{
    (void)state;
    static struct apc_sample s[1000];
    int64_t last;
    struct apc_store_options o = options();
    struct apc_store *store = open_with(through, &o);
    ok(store, apc_store_claim(store, APC_SENSOR, 1, &last));
    proxy_set(proxy, PROXY_REFUSE);
    for (int64_t batch = 0; batch < 100; batch++) {
        for (int64_t i = 0; i < 1000; i++) {
            s[i] = sample(1, batch * 1000 + i + 1, (double)((batch * 1000 + i + 1) * 10 + 1));
        }
        assert_int_equal(apc_store_append(store, s, 1000), 1000);
    }
    apc_store_close(store);
    o.timeout = 300 * APC_NS_PER_MS; /* a portion: a tenth of it, or one batch */
    proxy_set(proxy, PROXY_PASS);
    uint64_t left = 100000, calls = 1;
    for (store = open_with(through, &o); stats_of(store).drained == 0; calls++) {
        (void)apc_store_connect(store);
    }
    apc_store_close(store); /* in the middle of it; the next writer counts on from all the same */
    store = open_with(through, &o);
    assert_true(stats_of(store).samples > 0);
    while (apc_store_claim(store, APC_SENSOR, 1, &last) != 0) { /* a busy machine, a short timeout */
    }
    assert_int_equal(last, 100000);
    const uint64_t all = stats_of(store).samples + stats_of(store).drained;
    while (left > 0 && calls < 100000) {
        (void)apc_store_connect(store);
        const struct apc_spool_stats stats = stats_of(store);
        assert_true(stats.samples <= left && stats.events == 0);
        assert_int_equal(stats.samples + stats.drained, all);
        left = stats.samples;
        calls++;
    }
    assert_int_equal(left, 0);
    assert_true(calls > 3);
    assert_stored(100000);
    apc_store_close(store);
}

/*
 * Promise(stores/tick-not-held): A tick is not held up; a short stall is not made a long one; commands are
 *   not spooled; old values do not look new.
 */
static void test_a_store_that_hangs_is_left_alone_for_a_while(void **state)
{
    (void)state;
    struct apc_store_options o = options();
    o.timeout = 200 * APC_NS_PER_MS;
    o.backoff_min = o.backoff_max = LONG;
    struct apc_store *store = open_with(through, &o);
    append(store, 1, 1);
    proxy_set(proxy, PROXY_STALL);
    append(store, 1, 2); /* waits its time */
    struct apc_store_stats before = {.size = sizeof before}, after = before;
    apc_store_stats(store, &before);
    uint64_t asked = proxy_round_trips(proxy);
    struct apc_sample r = {.table = APC_SENSOR, .id = 1};
    for (int64_t seq = 3; seq < 50; seq++) {
        append(store, 1, seq);
        ok(store, apc_store_read(store, &r, 1));
        assert_int_equal(r.seq, seq);
        assert_int_equal(apc_store_connect(store), APC_ECONN);
    }
    apc_store_stats(store, &after);
    assert_int_equal(after.round_trips, before.round_trips); /* these did not */
    assert_int_equal(proxy_round_trips(proxy), asked);
    apc_store_close(store);
}

/* Promise(stores/tick-not-held) */
static void test_a_short_stall_is_not_made_a_long_one(void **state)
{
    (void)state;
    const struct apc_store_config config = {.backoff_min = 100, .backoff_max = 5000};
    assert_int_equal(apc_spool_pause(1000, 1, &config), 1000);
    assert_int_equal(apc_spool_pause(1000, 2, &config), 2000);
    assert_int_equal(apc_spool_pause(1000, 3, &config), 4000);
    assert_int_equal(apc_spool_pause(1000, UINT_MAX, &config), 4000);
    assert_int_equal(apc_spool_pause(99, 1, &config), 100); /* a refusal comes at once */
    assert_int_equal(apc_spool_pause(1251, 3, &config), 5000);
}

static void limit_files(rlim_t size)
{
    struct rlimit limit;
    signal(SIGXFSZ, SIG_IGN);
    assert_int_equal(getrlimit(RLIMIT_FSIZE, &limit), 0);
    limit.rlim_cur = size;
    assert_int_equal(setrlimit(RLIMIT_FSIZE, &limit), 0);
}

/* ---- Claims --------------------------------------------------------------------------------- */

static void spool_claimed(struct apc_store *store)
{
    int64_t last[2];
    ok(store, apc_store_claim(store, APC_SENSOR, 2, last));
    append(store, 1, 1);
    proxy_set(proxy, PROXY_REFUSE);
    append(store, 1, 2);
    append(store, 1, 3);
}

/* ---- A disk that will not have it --------------------------------------------------------------- */

/* Whatever @p path is opened as, in this process, takes nothing any more. */
static void fill_disk_of(const char *path)
{
    char link[64], at[512];
    int filled = 0;
    for (int fd = 0; fd < 1024; fd++) {
        snprintf(link, sizeof link, "/proc/self/fd/%d", fd);
        const ssize_t n = readlink(link, at, sizeof at - 1);
        if (n > 0 && (at[n] = '\0', strcmp(at, path) == 0)) {
            const int full = open("/dev/full", O_RDWR | O_CLOEXEC);
            assert_true(full >= 0 && dup3(full, fd, O_CLOEXEC) == fd);
            close(full);
            filled++;
        }
    }
    assert_int_equal(filled, 1);
}

/*
 * Promise(stores/disk-will-not): A disk that will not have the spool, when a daemon starts or later, keeps
 *   no loop from running; what waits there keeps its numbers; `shm:` needs no spool.
 */
static void test_without_its_disk_a_spool_is_in_memory_and_says_so(void **state)
{
    (void)state;
    struct apc_store_options o = options();
    o.spool_or_memory = true;
    for (int i = 0; i < 2; i++) {
        o.spool = i == 0 ? "/nowhere/at/all.spool" : folder;
        struct apc_store *store = open_with(through, &o);
        assert_says(stats_of(store).instead, i == 0 ? "No such file" : "Is a directory");
        append(store, i + 1, 1);
        proxy_set(proxy, PROXY_REFUSE);
        append(store, i + 1, 2);
        assert_int_equal(stats_of(store).samples, 1);
        proxy_set(proxy, PROXY_PASS);
        drain(store);
        apc_store_close(store);
    }
    assert_stored(2);
    o.spool = spool; /* one that is another's is refused all the same */
    o.name = "another";
    struct apc_store *other = open_with(nowhere, &o);
    append(other, 1, 1);
    assert_string_equal(stats_of(other).instead, "");
    apc_store_close(other);
    o.name = "writer";
    assert_refused(nowhere, &o, APC_EINVAL, "of writer another");
}

/* Promise(stores/disk-will-not) */
static void test_a_disk_that_fills_up_before_the_store_goes_away_costs_nothing(void **state)
{
    (void)state;
    struct apc_store_options o = options();
    o.spool_or_memory = true;
    struct apc_store *store = open_with(through, &o);
    append(store, 1, 1);
    fill_disk_of(spool);
    proxy_set(proxy, PROXY_REFUSE);
    append(store, 1, 2);
    append(store, 1, 3);
    assert_says(stats_of(store).instead, "No space left on device");
    assert_int_equal(stats_of(store).samples, 2);
    assert_int_equal(stats_of(store).refused, 0);
    proxy_set(proxy, PROXY_PASS);
    drain(store);
    assert_stored(3);
    apc_store_close(store);
}

/* The rights of an ordinary user, for what root may do all the same. */
static void as_nobody(bool nobody)
{
    if (geteuid() == 0) {
        (void)setfsuid(nobody ? 65534 : 0);
    }
}

/* Promise(stores/disk-will-not) */
static void test_numbers_that_wait_where_nothing_can_be_written_are_not_given_out_again(void **state)
{
    (void)state;
    int64_t last[2];
    struct apc_store_options o = options();
    o.spool_or_memory = true;
    struct apc_store *store = open_with(through, &o);
    spool_claimed(store); /* 2 and 3 wait */
    apc_store_close(store);
    assert_int_equal(chmod(folder, 0755), 0);
    assert_int_equal(chmod(spool, 0444), 0);
    as_nobody(true);
    store = open_with(through, &o);
    as_nobody(false);
    assert_says(stats_of(store).instead, "Permission denied");
    proxy_set(proxy, PROXY_PASS);
    ok(store, apc_store_claim(store, APC_SENSOR, 2, last));
    assert_int_equal(last[0], 3);
    append(store, 1, 4);
    apc_store_close(store);
    assert_int_equal(chmod(spool, 0600), 0);
    store = open_with(through, &o); /* what waited there goes on */
    assert_string_equal(stats_of(store).instead, "");
    drain(store);
    assert_stored(4);
    apc_store_close(store);
}

/* A disk that is full from the first record on: both reasons are told. */
static void test_a_spool_that_cannot_even_begin_says_why(void **state)
{
    (void)state;
    int64_t last[2];
    struct apc_store *store = open_spooled(through);
    struct apc_sample s = sample(1, 2, 21);
    ok(store, apc_store_claim(store, APC_SENSOR, 2, last));
    append(store, 1, 1);
    proxy_set(proxy, PROXY_REFUSE);
    limit_files(APC_SPOOL_HEADER);
    int rc = apc_store_append(store, &s, 1);
    limit_files(RLIM_INFINITY);
    assert_int_equal(rc, APC_ESTORE);
    assert_says(apc_store_error(store), "cannot be written: new rows are lost");
    assert_says(apc_store_error(store), "(the store: ");
    assert_says(apc_store_error(store), "connection to the database lost");
    append(store, 1, 2); /* there is room again */
    apc_store_close(store);
}

static void test_a_claim_counts_the_spool_in_and_needs_it_while_the_store_is_away(void **state)
{
    (void)state;
    int64_t last[2] = {-1, -1};
    struct apc_store *store = open_spooled(nowhere);
    assert_int_equal(apc_store_claim(store, APC_SENSOR, 2, last), APC_ECONN); /* who knows how far it was? */
    apc_store_close(store);
    unlink(spool);
    store = open_spooled(through);
    spool_claimed(store);
    apc_store_close(store);
    store = open_spooled(through); /* the next process, with the store still away */
    ok(store, apc_store_claim(store, APC_SENSOR, 2, last));
    assert_int_equal(last[0], 3);
    assert_int_equal(last[1], 0);
    append(store, 1, 4);
    assert_int_equal(apc_store_claim(store, APC_ACTUATOR, 1, last), APC_EINVAL);
    assert_says(apc_store_error(store), "writer of table sensor");
    apc_store_close(store);
    proxy_set(proxy, PROXY_PASS);
    store = open_spooled(through);
    ok(store, apc_store_claim(store, APC_SENSOR, 2, last)); /* with the store there, and seq 1 in it */
    assert_int_equal(last[0], 4);
    drain(store);
    assert_stored(4);
    apc_store_close(store);
}

/* The store has it, its answer was lost, and the spool could not take it: nobody acknowledged it, but its seq
 * is used up, also for the next process. */
static void test_a_seq_that_was_sent_is_never_given_out_again(void **state)
{
    (void)state;
    int64_t last;
    struct apc_store *store = open_spooled(through);
    ok(store, apc_store_claim(store, APC_SENSOR, 1, &last));
    append(store, 1, 1);
    proxy_arm(proxy, PROXY_TO_CLIENT, 0, PROXY_REFUSE);
    struct apc_sample s = sample(1, 2, 21);
    limit_files(APC_SPOOL_HEADER + 72); /* how far it was fits, the sample does not */
    int rc = apc_store_append(store, &s, 1);
    limit_files(RLIM_INFINITY);
    assert_int_equal(rc, APC_ESTORE);
    assert_stored(2);
    apc_store_close(store);
    store = open_spooled(through);
    ok(store, apc_store_claim(store, APC_SENSOR, 1, &last));
    assert_int_equal(last, 2);
    apc_store_close(store);
}

static void test_a_claim_on_trust_is_made_up_for_before_anything_drains(void **state)
{
    (void)state;
    int64_t last[2];
    struct apc_store *store = open_spooled(through), *other = open_plain();
    spool_claimed(store);
    apc_store_close(store);
    store = open_spooled(through);
    ok(store, apc_store_claim(store, APC_SENSOR, 2, last));
    ok(other, apc_store_claim(other, APC_SENSOR, 2, last)); /* somebody is faster */
    proxy_set(proxy, PROXY_PASS);
    struct apc_sample s = sample(1, 4, 41);
    assert_int_equal(apc_store_append(store, &s, 1), APC_EBUSY);
    assert_true(stats_of(store).samples >= 2); /* nothing is thrown away */
    assert_stored(1);
    apc_store_close(other);
    drain(store);
    apc_store_close(store);
}

/* Promise(stores/spool-acknowledges) */
static void test_seqs_that_somebody_else_took_meanwhile_are_found_and_set_aside(void **state)
{
    (void)state;
    char pattern[400];
    struct apc_store *store = open_spooled(through), *other = open_plain();
    append(store, 1, 1);
    proxy_set(proxy, PROXY_REFUSE);
    append(store, 1, 2);
    append(store, 1, 3);
    struct apc_sample theirs = sample(1, 2, -5);
    ok(other, apc_store_append(other, &theirs, 1));
    proxy_set(proxy, PROXY_PASS);
    assert_int_equal(apc_store_connect(store), APC_ECONFLICT);
    assert_says(apc_store_error(store), "another writer wrote the same sensor");
    assert_int_equal(stats_of(store).damaged, 1);
    snprintf(pattern, sizeof pattern, "%s.conflict-", spool);
    assert_says(stats_of(store).aside, pattern);
    struct apc_spool_info info = {.size = sizeof info};
    assert_int_equal(apc_spool_look(stats_of(store).aside, &info, NULL), 0);
    assert_int_equal(info.stats.samples, 2);
    append(store, 2, 1); /* it goes on */
    assert_int_equal(stats_of(store).samples, 0);
    apc_store_close(store);
    apc_store_close(other);
}

static void test_a_spool_in_memory_does_the_same_until_the_process_ends(void **state)
{
    (void)state;
    struct apc_store_options o = options();
    o.spool = "";
    struct apc_store *store = open_with(through, &o), *other = open_plain();
    append(store, 1, 1);
    proxy_set(proxy, PROXY_REFUSE);
    append(store, 1, 2);
    append(store, 1, 3);
    assert_int_equal(stats_of(store).samples, 2);
    proxy_set(proxy, PROXY_PASS);
    drain(store);
    assert_stored(3);

    proxy_set(proxy, PROXY_REFUSE);
    append(store, 1, 4);
    struct apc_sample theirs = sample(1, 4, -5);
    ok(other, apc_store_append(other, &theirs, 1));
    proxy_set(proxy, PROXY_PASS);
    assert_int_equal(apc_store_connect(store), APC_ECONFLICT);
    assert_says(stats_of(store).aside, "it was in memory");
    append(store, 2, 1); /* it goes on */
    assert_int_equal(stats_of(store).samples, 0);
    apc_store_close(store);
    apc_store_close(other);
}

/* Promise(stores/spool-acknowledges) */
static void test_a_row_that_the_store_refuses_shows_and_loses_nothing(void **state)
{
    char sql[128];
    (void)state;
    struct apc_store *store = open_spooled(through);
    proxy_set(proxy, PROXY_REFUSE);
    for (int64_t seq = 1; seq <= 3; seq++) {
        append(store, 1, seq);
    }
    assert_int_equal(stats_of(store).blocked, 0);
    snprintf(sql, sizeof sql, "ALTER TABLE plant%d.sensor ADD CONSTRAINT never CHECK (seq <> 2)", plant);
    cluster_query(cluster, sql);
    proxy_set(proxy, PROXY_PASS);
    append(store, 1, 4); /* acknowledged, although what comes before it is refused */
    assert_int_equal(stats_of(store).blocked, APC_ESTORE);
    assert_says(apc_store_error(store), "never");
    assert_int_equal(stats_of(store).samples, 4);
    snprintf(sql, sizeof sql, "ALTER TABLE plant%d.sensor DROP CONSTRAINT never", plant);
    cluster_query(cluster, sql);
    drain(store);
    assert_int_equal(stats_of(store).blocked, 0);
    assert_stored(4);
    apc_store_close(store);
}

/* ---- Full, unwritable ------------------------------------------------------------------------- */

/* Promise(stores/spool-acknowledges) */
static void test_a_full_spool_keeps_what_it_has_and_refuses_the_next(void **state)
{
    (void)state;
    struct apc_store_options o = options();
    o.spool_size = 1000; /* of records of 16 + 56 bytes */
    struct apc_store *store = open_with(through, &o);
    proxy_set(proxy, PROXY_REFUSE);
    struct apc_sample s = sample(1, 14, 141);
    for (int64_t seq = 1; seq <= 13; seq++) {
        append(store, 1, seq);
    }
    assert_int_equal(apc_store_append(store, &s, 1), APC_ESTORE);
    assert_says(apc_store_error(store), "is full");
    assert_says(apc_store_error(store), "cannot connect");
    assert_int_equal(stats_of(store).refused, 1);
    assert_int_equal(stats_of(store).samples, 13);
    proxy_set(proxy, PROXY_PASS);
    drain(store);
    append(store, 1, 14);
    assert_stored(14);
    apc_store_close(store);
}

/* Promise(stores/spool-acknowledges) */
static void test_what_the_disk_does_not_take_is_not_acknowledged(void **state)
{
    (void)state;
    struct apc_store *store = open_spooled(nowhere);
    append(store, 1, 1);
    struct apc_sample s = sample(1, 2, 21);
    limit_files(APC_SPOOL_HEADER + 72 + 20); /* the second record's first twenty bytes fit */
    int rc = apc_store_append(store, &s, 1);
    limit_files(RLIM_INFINITY);
    assert_int_equal(rc, APC_ESTORE);
    assert_says(apc_store_error(store), "cannot be written");
    assert_int_equal(look().stats.samples, 1);
    append(store, 1, 2); /* there is room again */
    apc_store_close(store);
    store = open_spooled(nowhere);
    assert_int_equal(stats_of(store).samples, 2);
    assert_int_equal(stats_of(store).torn, 0);
    apc_store_close(store);
}

/* Promise(stores/tick-not-held) */
static void test_a_store_whose_disk_is_full_is_bridged(void **state)
{
    enum { THERE = 5000, N = 500 };
    char uri[300];
    struct apc_sample *s = calloc(THERE + N, sizeof *s);
    (void)state;
    assert_non_null(s);
    for (int i = 0; i < THERE + N; i++) {
        s[i] = sample(1, i + 1, (i + 1) * 10 + 1);
    }
    snprintf(uri, sizeof uri, "sqlite:%s/a.db", folder);
    struct apc_store *store = open_spooled(uri);
    ok(store, apc_store_init(store));
    assert_int_equal(apc_store_append(store, s, THERE), THERE);
    limit_files(100 << 10); /* the store is larger already, its spool is not */
    int rc = apc_store_append(store, s + THERE, N);
    struct apc_spool_stats full = stats_of(store);
    limit_files(RLIM_INFINITY);
    assert_int_equal(rc, N);
    assert_int_equal(full.samples, N);
    drain(store);
    int64_t seq = 0;
    assert_int_equal(apc_store_history(store, APC_SENSOR, 1, NULL, expect_next, &seq), THERE + N);
    apc_store_close(store);
    free(s);
}

int main(void)
{
#define OFFLINE(test) cmocka_unit_test_setup_teardown(test, set_up, clear_folder)
#define ONLINE(test)  cmocka_unit_test_setup_teardown(test, set_up_server, clear_server)
    const struct CMUnitTest tests[] = {
        OFFLINE(test_an_append_is_acknowledged_once_it_is_in_the_spool),
        OFFLINE(test_a_spool_without_records_is_removed_at_the_end),
        OFFLINE(test_what_commands_is_not_spooled),
        ONLINE(test_a_reader_gets_the_last_value_with_its_own_time_and_an_uncertain_status),
        ONLINE(test_what_waits_is_newer_than_what_is_stored),
        ONLINE(test_a_controller_does_not_take_an_old_value_for_a_new_one),
        ONLINE(test_it_drains_in_order_and_without_duplicates),
        ONLINE(test_an_append_whose_answer_was_lost_is_stored_once),
        ONLINE(test_a_killed_writers_spool_is_drained_by_the_next),
        ONLINE(test_events_whose_answer_was_lost_are_stored_once),
        ONLINE(test_a_large_spool_drains_in_portions),
        ONLINE(test_a_store_that_hangs_is_left_alone_for_a_while),
        OFFLINE(test_a_short_stall_is_not_made_a_long_one),
        ONLINE(test_a_spool_that_cannot_even_begin_says_why),
        ONLINE(test_without_its_disk_a_spool_is_in_memory_and_says_so),
        ONLINE(test_a_disk_that_fills_up_before_the_store_goes_away_costs_nothing),
        ONLINE(test_numbers_that_wait_where_nothing_can_be_written_are_not_given_out_again),
        ONLINE(test_a_claim_counts_the_spool_in_and_needs_it_while_the_store_is_away),
        ONLINE(test_a_seq_that_was_sent_is_never_given_out_again),
        ONLINE(test_a_claim_on_trust_is_made_up_for_before_anything_drains),
        ONLINE(test_seqs_that_somebody_else_took_meanwhile_are_found_and_set_aside),
        ONLINE(test_a_spool_in_memory_does_the_same_until_the_process_ends),
        ONLINE(test_a_row_that_the_store_refuses_shows_and_loses_nothing),
        ONLINE(test_a_full_spool_keeps_what_it_has_and_refuses_the_next),
        OFFLINE(test_what_the_disk_does_not_take_is_not_acknowledged),
        OFFLINE(test_a_store_whose_disk_is_full_is_bridged),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}

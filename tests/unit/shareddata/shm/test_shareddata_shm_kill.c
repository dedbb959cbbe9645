/* SPDX-License-Identifier: BSD-3-Clause */
/*
 * A writer of the store in shared memory that is killed, after every instruction of an operation that leaves
 * something else, and at random instants: what it leaves is what was there before or what it was to write,
 * and the next writer goes on.
 */
#include <errno.h>
#include <fcntl.h>
#include <limits.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>
#include <sys/ptrace.h>
#include <sys/stat.h>
#include <sys/syscall.h>
#include <sys/uio.h>
#include <sys/wait.h>
#include <time.h>
#include <unistd.h>

#include "apcstore.h"
#include "check.h"

#if defined(__SANITIZE_ADDRESS__) || defined(__SANITIZE_THREAD__)
#define SANITIZED 1
#elif defined(__has_feature)
#if __has_feature(address_sanitizer) || __has_feature(thread_sanitizer) || __has_feature(memory_sanitizer)
#define SANITIZED 1
#endif
#endif
#ifndef SANITIZED
#define SANITIZED 0
#endif

static char uri[128], path[128];

static struct apc_store *open_store(void)
{
    struct apc_store *store = NULL;
    struct apc_store_options options = {.size = sizeof options, .name = "test", .timeout = 20 * APC_NS_PER_S};
    assert_int_equal(apc_store_open(&store, uri, &options, NULL), 0);
    return store;
}

static struct apc_store *new_store(void)
{
    unlink(path);
    struct apc_store *store = open_store();
    assert_int_equal(apc_store_init(store), 0);
    return store;
}

static int set_up(void **state)
{
    (void)state;
    snprintf(uri, sizeof uri, "shm:kill-test-%d?size=1", (int)getpid());
    snprintf(path, sizeof path, "/dev/shm/apc.kill-test-%d", (int)getpid());
    return 0;
}

static int tear_down(void **state)
{
    (void)state;
    unlink(path);
    return 0;
}

static struct apc_sample sample(enum apc_table table, int id, int64_t seq)
{
    return (struct apc_sample){
        .table = table, .id = id, .seq = seq, .time = 1000 * seq, .value = (double)seq};
}

enum { WIDE = 300 }; /* so wide that its ring cannot grow: four rows, which are written over again soon */

/* Each of its elements is its seq. */
static struct apc_vector vector(int id, int64_t seq, uint32_t n)
{
    static double value[WIDE];
    for (uint32_t i = 0; i < n; i++) {
        value[i] = (double)seq;
    }
    return (struct apc_vector){
        .table = APC_TICK, .id = id, .seq = seq, .time = 1000 * seq, .n = n, .room = WIDE, .value = value};
}

static int append_rows(struct apc_store *store, struct apc_sample *samples, size_t n, struct apc_vector v)
{
    const struct apc_rows rows = {
        .size = sizeof rows, .sample = samples, .n_samples = n, .vector = &v, .n_vectors = 1};
    return apc_store_append_rows(store, &rows);
}

/* ---- All that a store holds, in one number ------------------------------------------------------- */

enum { IDS = 8 };

static void mix(uint64_t *sum, const void *bytes, size_t n)
{
    for (size_t i = 0; i < n; i++) {
        *sum = (*sum ^ ((const unsigned char *)bytes)[i]) * UINT64_C(0x100000001b3);
    }
}

static int mix_sample(void *ctx, const struct apc_sample *s)
{
    mix(ctx, &s->seq, sizeof s->seq);
    mix(ctx, &s->time, sizeof s->time);
    mix(ctx, &s->value, sizeof s->value);
    mix(ctx, &s->status, sizeof s->status);
    return 0;
}

static int mix_vector(void *ctx, const struct apc_vector *v)
{
    mix(ctx, &v->seq, sizeof v->seq);
    mix(ctx, &v->time, sizeof v->time);
    mix(ctx, &v->status, sizeof v->status);
    mix(ctx, v->value, v->n * sizeof *v->value);
    return 0;
}

static int mix_event(void *ctx, const struct apc_event *e)
{
    mix(ctx, e, sizeof *e);
    return 0;
}

static int mix_timing(void *ctx, const struct apc_timing_row *row)
{
    mix(ctx, row->task, strlen(row->task));
    mix(ctx, row->bin_count, row->n_bins * sizeof *row->bin_count);
    return 0;
}

/* By what any process can see: a handle of its own that only reads. */
static uint64_t contents(void)
{
    const enum apc_table tables[2] = {APC_SENSOR, APC_SETPOINT};
    uint64_t sum = UINT64_C(0xcbf29ce484222325);
    struct apc_store *store = open_store();
    int err = 0;
    for (int t = 0; t < 2; t++) {
        for (int id = 0; id < IDS; id++) {
            struct apc_sample s = sample(tables[t], id, 0);
            err |= apc_store_read(store, &s, 1);
            mix_sample(&sum, &s);
            err |= apc_store_history(store, tables[t], id, NULL, mix_sample, &sum) < 0;
            mix(&sum, "|", 1);
        }
    }
    for (int id = 0; id < IDS; id++) {
        static double value[WIDE];
        struct apc_vector v = {.table = APC_TICK, .id = id, .room = WIDE, .value = value};
        struct apc_rows rows = {.size = sizeof rows, .vector = &v, .n_vectors = 1};
        err |= apc_store_read_rows(store, &rows);
        mix_vector(&sum, &v);
        err |= apc_store_vectors(store, APC_TICK, id, NULL, mix_vector, &sum) < 0;
        mix(&sum, "|", 1);
    }
    static struct apc_tag tags[64];
    int n = apc_store_get_tags(store, tags, 64);
    assert_true(n >= 0 && n <= 64);
    mix(&sum, tags, (size_t)n * sizeof *tags);
    err |= apc_store_events(store, NULL, mix_event, &sum) < 0;
    err |= apc_store_timing(store, NULL, mix_timing, &sum) < 0;
    assert_int_equal(err, 0);
    apc_store_close(store);
    return sum;
}

/* ---- The operations ------------------------------------------------------------------------------ */

static int prepare(struct apc_store *store)
{
    struct apc_sample s[5];
    for (int64_t seq = 1; seq <= 3; seq++) { /* the rings are about to grow from 4 cells to 16 */
        for (int i = 0; i < 4; i++) {
            s[i] = sample(APC_SENSOR, i, seq);
        }
        s[4] = sample(APC_SETPOINT, 1, seq);
        if (apc_store_append(store, s, 5) != 5) {
            return -1;
        }
    }
    for (int64_t seq = 4; seq <= 5; seq++) { /* and those of the first two have grown */
        if (apc_store_append(store, (struct apc_sample[]){sample(APC_SENSOR, 0, seq)}, 1) != 1 ||
            apc_store_append(store, (struct apc_sample[]){sample(APC_SENSOR, 1, seq)}, 1) != 1) {
            return -1;
        }
    }
    for (int64_t seq = 1; seq <= 3; seq++) { /* the ring of the first is about to grow */
        if (append_rows(store, NULL, 0, vector(0, seq, 10)) != 1 ||
            append_rows(store, NULL, 0, vector(1, seq, 3)) != 1) {
            return -1;
        }
    }
    if (append_rows(store, NULL, 0, vector(0, 4, 10)) != 1) { /* and has grown */
        return -1;
    }
    const struct apc_tag tag = {.table = APC_SENSOR, .id = 1, .name = "old"};
    const struct apc_event event = {.severity = APC_EVENT_INFO, .text = "old"};
    return apc_store_put_tags(store, &tag, 1) == 1 && apc_store_append_events(store, &event, 1) == 1 ? 0 : -1;
}

/* The ring of sensor 0 cannot grow any more and has gone round. */
static int prepare_full(struct apc_store *store)
{
    enum { FULL = 4500 };
    static struct apc_sample s[FULL];
    for (int i = 0; i < FULL; i++) {
        s[i] = sample(APC_SENSOR, 0, i + 1);
    }
    return apc_store_append(store, s, FULL) == FULL ? 0 : -1;
}

static int append_full(struct apc_store *store)
{
    return apc_store_append(store, (struct apc_sample[]){sample(APC_SENSOR, 0, 4501)}, 1);
}

static int append_known(struct apc_store *store)
{
    const struct apc_sample s[2] = {sample(APC_SENSOR, 0, 6), sample(APC_SENSOR, 1, 6)};
    return apc_store_append(store, s, 2);
}

/* One new, one whose ring grows, one known. */
static int append_new(struct apc_store *store)
{
    const struct apc_sample s[4] = {sample(APC_SENSOR, 7, 1), sample(APC_SENSOR, 2, 4),
                                    sample(APC_SENSOR, 0, 6), sample(APC_SETPOINT, 7, 1)};
    return apc_store_append(store, s, 4);
}

static int append_late(struct apc_store *store)
{
    const struct apc_sample s[3] = {sample(APC_SENSOR, 0, 8), sample(APC_SENSOR, 0, 7),
                                    sample(APC_SENSOR, 0, 6)};
    return apc_store_append(store, s, 3);
}

static int put(struct apc_store *store)
{
    struct apc_sample s[2] = {sample(APC_SETPOINT, 1, 0), sample(APC_SETPOINT, 2, 0)};
    return apc_store_put(store, s, 2);
}

static int swap(struct apc_store *store)
{
    struct apc_sample s[2] = {sample(APC_SETPOINT, 1, 3), sample(APC_SENSOR, 0, 5)};
    int err = apc_store_swap(store, s, 2);
    return err == APC_ECONFLICT && s[0].seq == 4 ? 0 : err; /* a repeat */
}

/* A tick: an output, a setpoint by swap, what it was made from. */
static int append_tick(struct apc_store *store)
{
    struct apc_sample s[2] = {sample(APC_SENSOR, 0, 6), sample(APC_SETPOINT, 1, 3)};
    return append_rows(store, s, 2, vector(0, 5, 10));
}

/* A vector that moves its ring. */
static int append_wider(struct apc_store *store)
{
    return append_rows(store, NULL, 0, vector(1, 4, 20));
}

/* The first one of a variable. */
static int append_new_vector(struct apc_store *store)
{
    struct apc_sample s = sample(APC_SENSOR, 7, 1);
    return append_rows(store, &s, 1, vector(7, 1, 5));
}

static int append_late_vector(struct apc_store *store)
{
    double eight[2] = {8, 8}, six[2] = {6, 6};
    struct apc_vector v[2] = {vector(0, 8, 2), vector(0, 6, 2)};
    v[0].value = eight;
    v[1].value = six;
    const struct apc_rows rows = {.size = sizeof rows, .vector = v, .n_vectors = 2};
    return apc_store_append_rows(store, &rows);
}

static int prepare_narrow(struct apc_store *store)
{
    for (int64_t seq = 1; seq <= 9; seq++) { /* it has gone round */
        if (append_rows(store, NULL, 0, vector(0, seq, WIDE)) != 1) {
            return -1;
        }
    }
    return 0;
}

static int append_wide(struct apc_store *store)
{
    return append_rows(store, NULL, 0, vector(0, 10, WIDE));
}

static int put_tags(struct apc_store *store)
{
    const struct apc_tag tags[2] = {{.table = APC_SENSOR, .id = 1, .name = "new"},
                                    {.table = APC_SENSOR, .id = 2, .name = "newer"}};
    return apc_store_put_tags(store, tags, 2);
}

static int append_events(struct apc_store *store)
{
    const struct apc_event events[2] = {{.severity = APC_EVENT_ALARM, .text = "one"},
                                        {.severity = APC_EVENT_ALARM, .text = "other"}};
    return apc_store_append_events(store, events, 2);
}

static int append_timing(struct apc_store *store)
{
    const int64_t bin[2] = {1, 2};
    const struct apc_timing_row row = {
        .task = "t", .quantity = "run", .bin_low = bin, .bin_high = bin, .bin_count = bin, .n_bins = 2};
    return apc_store_append_timing(store, &row, 1);
}

static int maintain(struct apc_store *store)
{
    const struct apc_retention keep = {.size = sizeof keep, .samples = 1, .events = 1};
    return apc_store_maintain(store, &keep);
}

/* ---- Killed after every instruction --------------------------------------------------------------- */

/* To be killed after k instructions takes k single steps: so many in all, spread evenly over an operation
 * that takes more. APC_KILLS=2000 is the long run: so many random kills, and no operation is spared. */
enum { SOME = 120000, EVERYWHERE = INT_MAX, KILLS = SANITIZED ? 100 : 400, N = 6 };

static int random_kills(void)
{
    const char *given = getenv("APC_KILLS");
    char *end = NULL;
    const long kills = given ? strtol(given, &end, 10) : KILLS;
    if (given && (end == given || *end || kills < 1 || kills > INT_MAX))
        fail_msg("APC_KILLS=%s is no number of kills", given);
    return (int)kills;
}

static long some(void)
{
    return random_kills() > KILLS ? EVERYWHERE : SOME;
}

typedef int (*operation_fn)(struct apc_store *store);

/* A process that is about to do it; -1: no ptrace here, or most of the instructions are a sanitizer's. */
static pid_t stopped_before(struct apc_store *store, operation_fn operation)
{
    if (SANITIZED) {
        return -1;
    }
    pid_t child = fork();
    if (child == 0) {
        if (ptrace(PTRACE_TRACEME, 0, NULL, NULL) != 0) {
            _exit(77);
        }
        raise(SIGSTOP);
        _exit(operation(store) < 0);
    }
    int status = 0;
    assert_int_equal(waitpid(child, &status, 0), child);
    if (WIFEXITED(status) && WEXITSTATUS(status) == 77) {
        return -1;
    }
    assert_true(WIFSTOPPED(status));
    return child;
}

/* One instruction; false when it was the last. */
static bool step(pid_t child)
{
    int status = 0;
    assert_int_equal(ptrace(PTRACE_SINGLESTEP, child, NULL, NULL), 0);
    assert_int_equal(waitpid(child, &status, 0), child);
    assert_true(WIFSTOPPED(status) || (WIFEXITED(status) && WEXITSTATUS(status) == 0));
    return WIFSTOPPED(status);
}

/* What the dead leave: the segment, and what the kernel reads of them, their list of robust mutexes. */
enum { PAGE = 4096, PAGES = 1024 };

static struct {
    unsigned char *segment, was[PAGES * PAGE];
    size_t pages;
    bool touched[PAGES]; /* by the operation, as far as is known */
    void *list;          /* of robust mutexes, in the process */
    long robust[3];
} remains;

static bool remains_differ(pid_t child, bool look_everywhere)
{
    long robust[3];
    const size_t n = sizeof robust;
    const struct iovec to = {.iov_base = robust, .iov_len = n},
                       from = {.iov_base = remains.list, .iov_len = n};
    assert_int_equal(process_vm_readv(child, &to, 1, &from, 1, 0), n);
    bool differ = memcmp(remains.robust, robust, n) != 0;
    memcpy(remains.robust, robust, n);
    for (size_t i = 0; i < remains.pages; i++) {
        unsigned char *is = remains.segment + i * PAGE, *was = remains.was + i * PAGE;
        if ((look_everywhere || remains.touched[i]) && memcmp(is, was, PAGE) != 0) {
            memcpy(was, is, PAGE);
            differ = remains.touched[i] = true;
        }
    }
    return differ;
}

/* Let a process do it and be killed by the last of so many instructions after which what it leaves differs
 * from what it left before. Returns how many there were, and of all @p instructions; or -1: no ptrace here.
 */
static long run_killed(struct apc_store *store, operation_fn operation, long most, long *instructions)
{
    pid_t child = stopped_before(store, operation);
    if (child < 0) {
        return -1;
    }
    struct stat stat;
    int fd = open(path, O_RDONLY);
    assert_true(fd >= 0 && fstat(fd, &stat) == 0);
    remains.pages = (size_t)stat.st_size / PAGE;
    assert_true(remains.pages * PAGE == (size_t)stat.st_size && remains.pages <= PAGES);
    remains.segment = mmap(NULL, remains.pages * PAGE, PROT_READ, MAP_SHARED, fd, 0);
    assert_true(remains.segment != MAP_FAILED);
    close(fd);
    size_t n_list = 0;
    assert_int_equal(syscall(SYS_get_robust_list, child, &remains.list, &n_list), 0);
    assert_int_equal(n_list, sizeof remains.robust);
    (void)remains_differ(child, true);
    const bool first = most == LONG_MAX;
    if (first) {
        memset(remains.touched, 0, sizeof remains.touched);
    }
    long n = 0;
    bool running = true;
    for (*instructions = 0; n < most && running; ++*instructions) {
        running = step(child);
        n += running && remains_differ(child, first);
    }
    if (running) {
        kill(child, SIGKILL);
        assert_int_equal(waitpid(child, NULL, 0), child);
    }
    munmap(remains.segment, remains.pages * PAGE);
    return n;
}

/* Once: what is left is old or new, and the next writer makes it new. */
static void check_killed(operation_fn before, operation_fn operation, long most, bool repeatable,
                         uint64_t old_contents, uint64_t new_contents, bool *was_new)
{
    struct apc_store *store = new_store();
    assert_int_equal(before(store), 0);
    assert_true(contents() == old_contents);
    long instructions;
    run_killed(store, operation, most, &instructions);
    const uint64_t left = contents();
    *was_new = left == new_contents;
    if (left != old_contents && left != new_contents) {
        fail_msg("neither old nor new after %ld instructions", instructions);
    }
    struct apc_sample other = sample(APC_STATE, 1, 1);
    assert_int_equal(apc_store_append(store, &other, 1), 1); /* the next writer: it erases what it finds */
    assert_true(contents() == left);
    if (left == old_contents || repeatable) {
        assert_true(operation(store) >= 0);
        assert_true(contents() == new_contents);
    }
    apc_store_close(store);
}

/* From one place to the next: each takes half of the operation's steps. */
static long stride(long places, long instructions)
{
    return 1 + places * instructions / 2 / some();
}

static void kill_everywhere(operation_fn before, operation_fn operation, bool repeatable)
{
    struct apc_store *store = new_store();
    assert_int_equal(before(store), 0);
    const uint64_t old_contents = contents();
    long instructions = 0;
    const long places = run_killed(store, operation, LONG_MAX, &instructions);
    const uint64_t new_contents = contents();
    apc_store_close(store);
    if (places < 0) {
        skip();
    }
    assert_true(new_contents != old_contents);
    int n_old = 0, n_new = 0;
    for (long place = places; place > 0; place -= stride(places, instructions)) {
        bool was_new = false;
        check_killed(before, operation, place, repeatable, old_contents, new_contents, &was_new);
        n_new += was_new;
        n_old += !was_new;
    }
    printf("%ld instructions, %ld of which leave something else: killed %d times with the old left, %d times "
           "with the new\n",
           instructions, places, n_old, n_new);
    assert_true(n_old > 0 && n_new > 0);
}

#define KILLED(before, operation, repeatable)                                                                \
    static void test_##operation##_killed_anywhere_leaves_old_or_new(void **state)                           \
    {                                                                                                        \
        (void)state;                                                                                         \
        kill_everywhere(before, operation, repeatable);                                                      \
    }

KILLED(prepare, append_known, true)
KILLED(prepare_full, append_full, true)
KILLED(prepare, append_new, true)
KILLED(prepare, append_late, true)
KILLED(prepare, put, false)
KILLED(prepare, swap, true)
/* Promise(stores/rows-samples-vectors) */
KILLED(prepare, append_tick, false)
KILLED(prepare, append_wider, true)
KILLED(prepare, append_new_vector, true)
KILLED(prepare, append_late_vector, true)
KILLED(prepare_narrow, append_wide, true)
KILLED(prepare, put_tags, true)
KILLED(prepare, append_events, false)
KILLED(prepare, append_timing, false)

/* Housekeeping is a transaction a variable: in between is neither old nor new, but every newest sample stays. */
static void test_maintain_killed_anywhere_keeps_the_newest_and_can_be_repeated(void **state)
{
    (void)state;
    struct apc_store *store = new_store();
    assert_int_equal(prepare(store), 0);
    long instructions;
    const long places = run_killed(store, maintain, LONG_MAX, &instructions);
    const uint64_t new_contents = contents();
    apc_store_close(store);
    if (places < 0) {
        skip();
    }
    for (long place = 1; place <= places; place += stride(places, instructions)) {
        store = new_store();
        assert_int_equal(prepare(store), 0);
        run_killed(store, maintain, place, &(long){0});
        struct apc_sample s[2] = {sample(APC_SENSOR, 0, 0), sample(APC_SETPOINT, 1, 0)};
        assert_int_equal(apc_store_read(store, s, 2), 0);
        assert_true(s[0].seq == 5 && s[1].seq == 3);
        double value[WIDE];
        struct apc_vector v = {.table = APC_TICK, .id = 0, .room = WIDE, .value = value};
        struct apc_rows rows = {.size = sizeof rows, .vector = &v, .n_vectors = 1};
        assert_int_equal(apc_store_read_rows(store, &rows), 0);
        assert_true(v.seq == 4 && v.n == 10);
        assert_true(maintain(store) >= 0);
        assert_true(contents() == new_contents);
        apc_store_close(store);
    }
}

/* ---- A reader that is stopped ---------------------------------------------------------------------- */

enum { TOGETHER = 3 };

static int append_together(struct apc_store *store, int64_t seq)
{
    struct apc_sample s[TOGETHER];
    for (int i = 0; i < TOGETHER; i++) {
        s[i] = sample(APC_SENSOR, i, seq);
    }
    return apc_store_append(store, s, TOGETHER);
}

static int read_together(struct apc_store *store)
{
    struct apc_sample s[TOGETHER];
    for (int i = 0; i < TOGETHER; i++) {
        s[i] = sample(APC_SENSOR, i, 0);
    }
    int err = apc_store_read(store, s, TOGETHER);
    for (int i = 0; !err && i < TOGETHER; i++) {
        err = s[i].seq != s[0].seq || s[i].time != 1000 * s[i].seq || s[i].value < (double)s[i].seq ||
                      s[i].value > (double)s[i].seq
                  ? APC_EPROTO
                  : 0;
    }
    return err;
}

static int append_tick_together(struct apc_store *store, int64_t seq)
{
    struct apc_sample s = sample(APC_SENSOR, 0, seq);
    return append_rows(store, &s, 1, vector(0, seq, WIDE)) + TOGETHER - 2;
}

/* Of the elements, which are read by one loop, the first ones. */
static int read_tick_together(struct apc_store *store)
{
    double value[6];
    struct apc_sample s = sample(APC_SENSOR, 0, 0);
    struct apc_vector v = {.table = APC_TICK, .id = 0, .room = 6, .value = value};
    struct apc_rows rows = {.size = sizeof rows, .sample = &s, .n_samples = 1, .vector = &v, .n_vectors = 1};
    int err = apc_store_read_rows(store, &rows);
    if (!err && (v.seq != s.seq || v.n != WIDE || v.time != s.time)) {
        err = APC_EPROTO;
    }
    for (uint32_t i = 0; !err && i < v.room; i++) {
        err = value[i] < (double)s.seq || value[i] > (double)s.seq ? APC_EPROTO : 0;
    }
    return err;
}

/* Wherever a reader is stopped, whatever is written then: what it has read in the end is one append's. */
static void stop_everywhere(int (*append)(struct apc_store *, int64_t), operation_fn read)
{
    struct apc_store *store = new_store();
    int64_t seq = 0;
    assert_int_equal(append(store, ++seq), TOGETHER);
    assert_int_equal(read(store), 0);
    bool running = true;
    for (long steps = 1; running; steps++) {
        pid_t child = stopped_before(store, read);
        if (child < 0) {
            apc_store_close(store);
            skip();
        }
        for (long made = 0; made < steps && running; made++) {
            running = step(child);
        }
        for (int64_t more = 1 + steps % 5; more > 0; more--) {
            assert_int_equal(append(store, ++seq), TOGETHER);
        }
        if (running) {
            int status = 0;
            assert_int_equal(ptrace(PTRACE_CONT, child, NULL, NULL), 0);
            assert_int_equal(waitpid(child, &status, 0), child);
            assert_true(WIFEXITED(status));
            assert_int_equal(WEXITSTATUS(status), 0);
        }
    }
    apc_store_close(store);
}

static void test_a_reader_stopped_anywhere_reads_one_append(void **state)
{
    (void)state;
    stop_everywhere(append_together, read_together);
}

static void test_a_reader_of_rows_stopped_anywhere_reads_one_append(void **state)
{
    (void)state;
    stop_everywhere(append_tick_together, read_tick_together);
}

/* ---- Killed at random ------------------------------------------------------------------------------ */

struct record {
    volatile int64_t attempted, acknowledged;
};

/* Appends the same seq to N variables, an event now and then, for ever. */
static void write_on(struct record *r, int64_t seq)
{
    struct apc_store *store = NULL;
    if (apc_store_open(&store, uri, NULL, NULL) != 0) {
        _exit(1);
    }
    for (;; seq++) {
        struct apc_sample s[N];
        for (int i = 0; i < N; i++) {
            s[i] = sample(APC_SENSOR, i, seq);
        }
        r->attempted = seq;
        if (append_rows(store, s, N, vector(0, seq, (uint32_t)(1 + seq % 12))) != N + 1) {
            _exit(2);
        }
        r->acknowledged = seq;
        const struct apc_event e = {.time = 1000 * seq, .severity = APC_EVENT_INFO};
        if (seq % 3 == 0 && apc_store_append_events(store, &e, 1) != 1) {
            _exit(3);
        }
    }
}

struct run {
    int64_t previous; /* its seq, or an event's time */
    int count;
    bool gap;
};

static int follow(void *ctx, const struct apc_sample *s)
{
    struct run *run = ctx;
    run->gap = run->gap || (run->count > 0 && s->seq != run->previous + 1) || s->time != 1000 * s->seq ||
               s->value < (double)s->seq || s->value > (double)s->seq;
    run->previous = s->seq;
    run->count++;
    return 0;
}

static int follow_vector(void *ctx, const struct apc_vector *v)
{
    struct run *run = ctx;
    run->gap = run->gap || v->n != (uint32_t)(1 + v->seq % 12);
    for (uint32_t i = 0; i < v->n; i++) {
        run->gap = run->gap || v->value[i] < (double)v->seq || v->value[i] > (double)v->seq;
    }
    run->gap = run->gap || (run->count > 0 && v->seq != run->previous + 1) || v->time != 1000 * v->seq;
    run->previous = v->seq;
    run->count++;
    return 0;
}

static int follow_event(void *ctx, const struct apc_event *e)
{
    struct run *run = ctx;
    run->gap = run->gap || e->time < run->previous || e->time % 3000 != 0;
    run->previous = e->time;
    return 0;
}

static int64_t check_all(struct apc_store *store)
{
    struct apc_sample s[N];
    for (int i = 0; i < N; i++) {
        s[i] = sample(APC_SENSOR, i, 0);
    }
    assert_int_equal(apc_store_read(store, s, N), 0);
    for (int i = 0; i < N; i++) {
        assert_true(s[i].seq == s[0].seq && s[i].time == 1000 * s[0].seq);
        struct run run = {0};
        assert_true(apc_store_history(store, APC_SENSOR, i, NULL, follow, &run) >= 0);
        assert_false(run.gap);
        assert_int_equal(run.previous, s[0].seq);
    }
    struct run vectors = {0};
    assert_true(apc_store_vectors(store, APC_TICK, 0, NULL, follow_vector, &vectors) >= 0);
    assert_false(vectors.gap);
    assert_int_equal(vectors.previous, s[0].seq);
    struct run events = {0};
    assert_true(apc_store_events(store, NULL, follow_event, &events) >= 0);
    assert_false(events.gap);
    return s[0].seq;
}

/* Promise(stores/acknowledged-survives) */
static void test_random_kills_lose_double_and_tear_nothing(void **state)
{
    (void)state;
    struct record *r = mmap(NULL, sizeof *r, PROT_READ | PROT_WRITE, MAP_SHARED | MAP_ANONYMOUS, -1, 0);
    assert_true(r != MAP_FAILED);
    const unsigned seed = 1;
    const int kills = random_kills();
    struct apc_store *store = new_store();
    int64_t stored = 0, acknowledged_by_all = 0;
    srand(seed);
    for (int k = 0; k < kills; k++) {
        r->attempted = r->acknowledged = stored;
        pid_t child = fork();
        if (child == 0) {
            write_on(r, stored + 1);
        }
        const int64_t enough = stored + rand() % 40;
        while (r->acknowledged < enough) { /* or until it fails, when the test runs out of time */
        }
        for (volatile int spin = rand() % 3000; spin > 0; spin--) {
        }
        kill(child, SIGKILL);
        int status = 0;
        assert_int_equal(waitpid(child, &status, 0), child);
        assert_true(WIFSIGNALED(status));
        stored = check_all(store);
        assert_true(r->acknowledged <= stored && stored <= r->attempted);
        acknowledged_by_all += r->acknowledged > 0;
    }
    printf("%d kills (seed %u), %lld appends\n", kills, seed, (long long)stored);
    assert_true(acknowledged_by_all > kills / 2);
    apc_store_close(store);
    munmap(r, sizeof *r);
}

#define T(name)             cmocka_unit_test_setup_teardown(name, set_up, tear_down)
#define T_KILLED(operation) T(test_##operation##_killed_anywhere_leaves_old_or_new)

int main(void)
{
    const struct CMUnitTest tests[] = {
        T_KILLED(append_known),
        T_KILLED(append_full),
        T_KILLED(append_new),
        T_KILLED(append_late),
        T_KILLED(put),
        T_KILLED(swap),
        T_KILLED(append_tick),
        T_KILLED(append_wider),
        T_KILLED(append_new_vector),
        T_KILLED(append_late_vector),
        T_KILLED(append_wide),
        T_KILLED(put_tags),
        T_KILLED(append_events),
        T_KILLED(append_timing),
        T(test_maintain_killed_anywhere_keeps_the_newest_and_can_be_repeated),
        T(test_a_reader_stopped_anywhere_reads_one_append),
        T(test_a_reader_of_rows_stopped_anywhere_reads_one_append),
        T(test_random_kills_lose_double_and_tear_nothing),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}

/* SPDX-License-Identifier: BSD-3-Clause */
/*
 * The store in shared memory, between two processes: this one on the first CPU, the other on the second.
 * Beside it the store in one process' memory, which no other sees.
 *
 *     seqlock   ten samples behind one sequence number, one writer, nothing else: what the hardware takes
 *     futex     a word and a futex for each direction: what waking takes
 *
 * Reads and writes are timed by the thousand, for one is shorter than a look at the clock; meanwhile the
 * other side writes, or reads, the same samples at 1 kHz.
 */
#include <errno.h>
#include <limits.h>
#include <linux/futex.h>
#include <sched.h>
#include <signal.h>
#include <stdatomic.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>
#include <sys/syscall.h>
#include <sys/wait.h>
#include <time.h>
#include <unistd.h>

#include <apcstore.h>

#include "store.h"

#define N      10
#define VECTOR 40
#define BATCH  1000
#define WORDS  5                   /* of a sample */
#define PAUSE  (2 * APC_NS_PER_US) /* before a ball comes back, so that who waits for it is asleep */

/* ---- By hand --------------------------------------------------------------------------------- */

struct hand {
    _Alignas(64) _Atomic uint64_t sequence;
    _Atomic uint64_t word[N][WORDS];
    _Alignas(64) _Atomic uint32_t ball[2];
};

static void load(const _Atomic uint64_t word[WORDS], struct apc_sample *s)
{
    const uint64_t value = atomic_load_explicit(&word[2], memory_order_relaxed);
    s->seq = (int64_t)atomic_load_explicit(&word[0], memory_order_relaxed);
    s->time = (apc_ns)atomic_load_explicit(&word[1], memory_order_relaxed);
    memcpy(&s->value, &value, sizeof value);
    s->status = (apc_status)atomic_load_explicit(&word[3], memory_order_relaxed);
    s->origin = (int64_t)atomic_load_explicit(&word[4], memory_order_relaxed);
}

static void store(_Atomic uint64_t word[WORDS], const struct apc_sample *s)
{
    uint64_t value;
    memcpy(&value, &s->value, sizeof value);
    atomic_store_explicit(&word[0], (uint64_t)s->seq, memory_order_relaxed);
    atomic_store_explicit(&word[1], (uint64_t)s->time, memory_order_relaxed);
    atomic_store_explicit(&word[2], value, memory_order_relaxed);
    atomic_store_explicit(&word[3], s->status, memory_order_relaxed);
    atomic_store_explicit(&word[4], (uint64_t)s->origin, memory_order_relaxed);
}

static void hand_read(struct hand *h, struct apc_sample *s)
{
    uint64_t before, after;
    do {
        before = atomic_load_explicit(&h->sequence, memory_order_acquire);
        for (size_t i = 0; i < N; i++)
            load(h->word[i], &s[i]);
        atomic_thread_fence(memory_order_acquire);
        after = atomic_load_explicit(&h->sequence, memory_order_relaxed);
    } while (before != after || before & 1);
}

static void hand_write(struct hand *h, const struct apc_sample *s)
{
    const uint64_t sequence = atomic_load_explicit(&h->sequence, memory_order_relaxed);
    atomic_store_explicit(&h->sequence, sequence + 1, memory_order_relaxed);
    atomic_thread_fence(memory_order_release);
    for (size_t i = 0; i < N; i++)
        store(h->word[i], &s[i]);
    atomic_store_explicit(&h->sequence, sequence + 2, memory_order_release);
}

static void pause_awake(void)
{
    const apc_ns end = apc_clock_mono(NULL) + PAUSE;
    while (apc_clock_mono(NULL) < end) {
    }
}

static void hand_throw(struct hand *h, int side)
{
    pause_awake();
    atomic_fetch_add(&h->ball[side], 1);
    syscall(SYS_futex, &h->ball[side], FUTEX_WAKE, INT_MAX, NULL, NULL, 0);
}

/* Wait until it is no longer @p seen. */
static uint32_t hand_catch(struct hand *h, int side, uint32_t seen)
{
    uint32_t ball;
    while ((ball = atomic_load(&h->ball[side])) == seen)
        syscall(SYS_futex, &h->ball[side], FUTEX_WAIT, seen, NULL, NULL, 0);
    return ball;
}

/* ---- Both ---------------------------------------------------------------------------------- */

struct side {
    struct hand *hand;
    struct apc_store *store;
    struct apc_sample sample[N], seen;
    double value[VECTOR];
    int64_t tick;
    uint32_t ball;
};

static void check(const struct side *s, int got, int expected)
{
    if (got != expected)
        die("shm: %s: %s", apc_err_name(got), apc_store_error(s->store));
}

static void store_read(struct side *s)
{
    check(s, apc_store_read(s->store, s->sample, N), 0);
}

static void store_write(struct side *s)
{
    for (size_t i = 0; i < N; i++)
        s->sample[i].seq++;
    check(s, apc_store_append(s->store, s->sample, N), N);
}

/* A tick: the samples and a vector of what they were made from. */
static void store_write_rows(struct side *s)
{
    for (size_t i = 0; i < N; i++)
        s->sample[i].seq++;
    struct apc_vector v = {.table = APC_TICK, .id = 1, .seq = ++s->tick, .n = VECTOR, .value = s->value};
    const struct apc_rows rows = {
        .size = sizeof rows, .sample = s->sample, .n_samples = N, .vector = &v, .n_vectors = 1};
    check(s, apc_store_append_rows(s->store, &rows), N + 1);
}

static void both_read(struct side *s)
{
    hand_read(s->hand, s->sample);
    store_read(s);
}

static void both_write(struct side *s)
{
    hand_write(s->hand, s->sample);
    store_write(s);
}

static void store_throw(struct side *s, size_t i)
{
    pause_awake();
    s->sample[i].seq++;
    check(s, apc_store_append(s->store, &s->sample[i], 1), 1);
}

/* Wait for the next one of sample @p i. */
static void store_catch(struct side *s, size_t i)
{
    s->seen = s->sample[i];
    check(s, apc_store_wait(s->store, &s->seen, 1, 60 * APC_NS_PER_S), 1);
    check(s, apc_store_read(s->store, &s->sample[i], 1), 0);
}

/* ---- Rows ---------------------------------------------------------------------------------- */

static void seqlock_reads(void *ctx)
{
    struct side *s = ctx;
    for (int i = 0; i < BATCH; i++)
        hand_read(s->hand, s->sample);
}

static void store_reads(void *ctx)
{
    for (int i = 0; i < BATCH; i++)
        store_read(ctx);
}

static void seqlock_writes(void *ctx)
{
    struct side *s = ctx;
    for (int i = 0; i < BATCH; i++) {
        for (size_t k = 0; k < N; k++)
            s->sample[k].seq++;
        hand_write(s->hand, s->sample);
    }
}

static void store_writes(void *ctx)
{
    for (int i = 0; i < BATCH; i++)
        store_write(ctx);
}

static void store_ticks(void *ctx)
{
    for (int i = 0; i < BATCH; i++)
        store_write_rows(ctx);
}

static void futex_rally(void *ctx)
{
    struct side *s = ctx;
    hand_throw(s->hand, 0);
    s->ball = hand_catch(s->hand, 1, s->ball);
}

static void store_rally(void *ctx)
{
    store_throw(ctx, 0);
    store_catch(ctx, 1);
}

/* ---- The other process ------------------------------------------------------------------------- */

static void run_on(int cpu)
{
    cpu_set_t set;
    CPU_ZERO(&set);
    CPU_SET((size_t)cpu, &set);
    if (sysconf(_SC_NPROCESSORS_ONLN) > 1)
        (void)sched_setaffinity(0, sizeof set, &set);
}

static void open_side(struct side *s, struct hand *hand, const char *uri)
{
    struct apc_error why = {""};
    *s = (struct side){.hand = hand};
    if (apc_store_open(&s->store, uri, NULL, &why) != 0)
        die("%s", why.text);
    if (apc_store_init(s->store) < 0)
        die("%s", apc_store_error(s->store));
    for (size_t i = 0; i < N; i++)
        s->sample[i] = (struct apc_sample){.table = APC_SENSOR, .id = (int)i};
    store_read(s);
    for (size_t i = 0; i < N; i++)
        s->sample[i].status = APC_GOOD;
}

/* At 1 kHz, on the grid. */
static void every_ms(struct side *s, void (*work)(struct side *))
{
    struct timespec next;
    clock_gettime(CLOCK_MONOTONIC, &next);
    for (;;) {
        next.tv_nsec += 1000000;
        next.tv_sec += next.tv_nsec / 1000000000;
        next.tv_nsec %= 1000000000;
        while (clock_nanosleep(CLOCK_MONOTONIC, TIMER_ABSTIME, &next, NULL) == EINTR) {
        }
        work(s);
    }
}

static void rally_futex(struct side *s)
{
    for (uint32_t ball = atomic_load(&s->hand->ball[0]);;) {
        ball = hand_catch(s->hand, 0, ball);
        hand_throw(s->hand, 1);
    }
}

static void rally_store(struct side *s)
{
    for (;;) {
        store_catch(s, 0);
        store_throw(s, 1);
    }
}

struct other {
    void (*work)(struct side *); /* every ms, or */
    void (*rally)(struct side *);
};

static pid_t start_other(const struct other *other, struct hand *hand, const char *uri)
{
    int ready[2];
    char byte;
    if (pipe(ready) != 0)
        die("no pipe");
    pid_t pid = fork();
    if (pid == 0) {
        struct side s;
        run_on(1);
        open_side(&s, hand, uri);
        if (write(ready[1], "", 1) != 1)
            _exit(1);
        if (other->work)
            every_ms(&s, other->work);
        else
            other->rally(&s);
        _exit(1);
    }
    if (pid < 0 || read(ready[0], &byte, 1) != 1)
        die("no second process");
    close(ready[0]);
    close(ready[1]);
    return pid;
}

static void measure(struct bench *b, const char *title, struct bench_row *rows, size_t n, struct hand *hand,
                    const struct other *other, const char *uri)
{
    pid_t pid = start_other(other, hand, uri);
    bench_run(b, title, N, rows, n);
    kill(pid, SIGKILL);
    waitpid(pid, NULL, 0);
}

void bench_shm(struct bench *b)
{
    char uri[64], path[64];
    struct side s, mem;
    cpu_set_t everywhere;
    struct hand *hand = mmap(NULL, sizeof *hand, PROT_READ | PROT_WRITE, MAP_SHARED | MAP_ANONYMOUS, -1, 0);
    if (hand == MAP_FAILED || sched_getaffinity(0, sizeof everywhere, &everywhere) != 0)
        die("no shared memory, or no CPU");
    snprintf(uri, sizeof uri, "shm:bench-%d", (int)getpid());
    snprintf(path, sizeof path, "/dev/shm/apc.bench-%d", (int)getpid());
    run_on(0);
    open_side(&s, hand, uri);
    open_side(&mem, hand, "mem:");
    store_write(&s);
    store_write(&mem);

    b->budget = APC_NS_PER_S / 4;
    b->calls = 1000;
    b->reference[0] = "seqlock";
    b->reference[1] = NULL;
    struct bench_row reads[] = {
        {.name = "seqlock", .once = seqlock_reads, .ctx = &s},
        {.name = "shm: apc_store_read()", .once = store_reads, .ctx = &s, .to = {&reads[0]}},
        {.name = "mem: apc_store_read()", .once = store_reads, .ctx = &mem, .to = {&reads[0]}},
    };
    measure(b, "1000 reads of 10 newest", reads, 3, hand, &(struct other){.work = both_write}, uri);
    store_read(&s);
    struct bench_row writes[] = {
        {.name = "seqlock", .once = seqlock_writes, .ctx = &s},
        {.name = "shm: apc_store_append()", .once = store_writes, .ctx = &s, .to = {&writes[0]}},
        {.name = "mem: apc_store_append()", .once = store_writes, .ctx = &mem, .to = {&writes[0]}},
        {.name = "shm: and a vector of 40", .once = store_ticks, .ctx = &s, .to = {&writes[0], &writes[1]}},
    };
    b->reference[1] = "without";
    measure(b, "1000 appends of 10", writes, 4, hand, &(struct other){.work = both_read}, uri);
    b->reference[1] = NULL;
    apc_store_close(mem.store);

    b->reference[0] = "futex";
    struct bench_row wakes[] = {
        {.name = "futex", .once = futex_rally, .ctx = &s},
        {.name = "shm: append, wait, read", .once = store_rally, .ctx = &s, .to = {&wakes[0]}},
    };
    pid_t pid = start_other(&(struct other){.rally = rally_futex}, hand, uri);
    store_read(&s);
    s.ball = atomic_load(&hand->ball[1]);
    measure(b, "there and back, each waking the other", wakes, 2, hand, &(struct other){.rally = rally_store},
            uri);
    kill(pid, SIGKILL);
    waitpid(pid, NULL, 0);

    apc_store_close(s.store);
    munmap(hand, sizeof *hand);
    unlink(path);
    (void)sched_setaffinity(0, sizeof everywhere, &everywhere);
}

/* SPDX-License-Identifier: BSD-3-Clause */
/*
 * jitter_task ROW PERIOD_NS DURATION_NS: a row of libapc's tasks, or of the plain loop they replace.
 * jitter_task cost: what a tick costs besides its callback, and what of that its records cost.
 *
 * Lateness is taken by the callback's own look at the clock, so that it includes the dispatch, and against
 * a grid reckoned here from the first tick, so that one which crept would show. A call that stands for
 * missed ticks too is charged with the lateness of the oldest, as cyclictest does.
 */
#include <apctimer.h>

#include <stdlib.h>
#include <string.h>
#include <time.h>

#include "bench.h"
#include "jitter_row.h"

#define PRIORITY 80                   /* that of the reference too: see jitter_run.c */
#define LEAD     (50 * APC_NS_PER_MS) /* from making the task to its first tick: cyclictest sleeps first, too */

static const struct kind {
    const char *name, *executive;
    int priority;
    bool hold, spin;
} kinds[] = {
    {"deadline", "deadline", PRIORITY, true, false}, {"spin", "deadline", PRIORITY, true, true},
    {"no-hold", "deadline", PRIORITY, false, false}, {"other", "deadline", -1, false, false},
    {"posix", "posix", PRIORITY, false, false},
};

/* ---- A task -------------------------------------------------------------------------------- */

struct measured {
    struct jitter_row row;
    apc_ns first;  /* instant of tick 0 */
    uint64_t last; /* its index ends the task */
};

static int record(void *ctx, const struct apc_tick *tick)
{
    apc_ns now = apc_clock_mono(NULL);
    struct measured *m = ctx;

    if (m->row.n == 0) {
        m->first = tick->scheduled - (apc_ns)tick->index * m->row.period;
        jitter_row_from(&m->row);
    }
    apc_ns due = m->first + (apc_ns)(tick->index - tick->missed) * m->row.period;
    if (m->row.n < m->row.capacity)
        m->row.ns[m->row.n++] = now - due;
    return tick->index >= m->last;
}

static struct apc_executive *open_executive(const struct kind *kind, struct apc_error *why)
{
    const struct apc_executive_options options = {
        .size = sizeof options, .hold_latency = kind->hold, .lock_memory = true};
    struct apc_executive *executive;

    if (apc_executive_create(&executive, kind->executive, &options, why) < 0)
        die("%s", why->text);
    return executive;
}

static void run_task(const struct kind *kind, const char *period, const char *duration)
{
    struct measured m;
    struct apc_error why;
    struct apc_task *task;

    jitter_row_begin(&m.row, period, duration);
    m.last = (uint64_t)(m.row.duration / m.row.period) - 1;
    struct apc_executive *executive = open_executive(kind, &why);
    const struct apc_task_options options = {.size = sizeof options,
                                             .name = kind->name,
                                             .period = m.row.period,
                                             .start = apc_clock_mono(NULL) + LEAD,
                                             .priority = kind->priority,
                                             .spin = kind->spin};
    if (apc_task_create(executive, &options, record, &m, &task, &why) < 0)
        die("%s", why.text);
    if (apc_task_start(task, &why) < 0)
        die("%s", why.text);
    apc_task_wait(task, m.row.duration + 10 * APC_NS_PER_S, NULL);
    jitter_row_to(&m.row);
    apc_task_stop(task);
    m.row.missed = apc_task_missed(task);
    apc_task_destroy(task);
    apc_executive_destroy(executive);
    jitter_row_end(&m.row);
}

/* ---- A loop that sleeps for a period ------------------------------------------------------- */

static void run_loop(const char *period, const char *duration)
{
    struct jitter_row row;

    jitter_row_begin(&row, period, duration);
    const struct timespec pause = {.tv_sec = row.period / APC_NS_PER_S, .tv_nsec = row.period % APC_NS_PER_S};
    jitter_row_from(&row);
    apc_ns begin = apc_clock_mono(NULL), before = begin;
    while (before - begin < row.duration && row.n < row.capacity) {
        nanosleep(&pause, NULL);
        apc_ns now = apc_clock_mono(NULL);
        row.ns[row.n++] = now - before - row.period;
        before = now;
    }
    jitter_row_to(&row);
    row.missed = (uint64_t)((before - begin) / row.period) - row.n;
    jitter_row_end(&row);
}

/* ---- What a tick costs --------------------------------------------------------------------- */

#define PERIOD_MIN (10 * APC_NS_PER_US) /* the shortest there is */
#define ARREARS    10000

/* Its first tick takes as long as all that follow should have, which then run one after another. */
struct arrears {
    apc_ns left[ARREARS + 1], between[ARREARS + 1];
    size_t n;
};

static int catch_up(void *ctx, const struct apc_tick *tick)
{
    const apc_ns now = apc_clock_mono(NULL), until = tick->scheduled + ARREARS * PERIOD_MIN;
    struct arrears *a = ctx;

    if (a->n > 0)
        a->between[a->n] = now - a->left[a->n - 1];
    while (a->n == 0 && apc_clock_mono(NULL) < until) {
    }
    a->left[a->n] = apc_clock_mono(NULL);
    return ++a->n > ARREARS;
}

static int by_size(const void *a, const void *b)
{
    const apc_ns x = *(const apc_ns *)a, y = *(const apc_ns *)b;
    return (x > y) - (x < y);
}

/* Median time from the end of one callback to the next, when the next is already due. On "posix", which does
 * not go to sleep in between as "deadline" does; the tick is the same. */
static apc_ns tick_cost(void)
{
    const struct apc_task_options options = {
        .size = sizeof options, .period = PERIOD_MIN, .priority = PRIORITY, .overrun = APC_OVERRUN_BURST};
    struct arrears *a = allocate(1, sizeof *a);
    struct apc_executive *executive;
    struct apc_task *task;
    struct apc_error why;

    memset(a->left, 1, sizeof a->left);
    memset(a->between, 1, sizeof a->between);
    if (apc_executive_create(&executive, "posix", NULL, &why) < 0 ||
        apc_task_create(executive, &options, catch_up, a, &task, &why) < 0 || apc_task_start(task, &why) < 0)
        die("%s", why.text);
    apc_task_wait(task, 10 * APC_NS_PER_S, NULL);
    apc_task_destroy(task);
    apc_executive_destroy(executive);
    qsort(a->between + 1, ARREARS, sizeof *a->between, by_size);
    apc_ns median = a->between[ARREARS / 2];
    free(a);
    return median;
}

/* A tick records its lateness, its interval and its run time. */
static double record_cost(void)
{
    enum { TICKS = 1000000, VALUES = 1024 };
    struct apc_histogram *of[3];
    apc_ns values[VALUES];
    uint32_t random = 1;

    for (size_t i = 0; i < VALUES; i++) {
        random = random * 1664525 + 1013904223;
        values[i] = random >> 15; /* up to 131 us */
    }
    for (size_t i = 0; i < 3; i++)
        if (apc_histogram_create(&of[i]) < 0)
            die("out of memory");
    apc_ns from = apc_clock_mono(NULL);
    for (size_t k = 0; k < TICKS; k++)
        for (size_t i = 0; i < 3; i++)
            apc_histogram_record(of[i], values[(k + i) % VALUES]);
    apc_ns to = apc_clock_mono(NULL);
    for (size_t i = 0; i < 3; i++)
        apc_histogram_destroy(of[i]);
    return (double)(to - from) / (double)TICKS;
}

int main(int argc, char **argv)
{
    if (argc == 2 && strcmp(argv[1], "cost") == 0) {
        printf("%lld %.1f\n", (long long)tick_cost(), record_cost());
        return 0;
    }
    if (argc != 4)
        die("usage: jitter_task ROW PERIOD_NS DURATION_NS, or jitter_task cost");
    if (strcmp(argv[1], "loop") == 0) {
        run_loop(argv[2], argv[3]);
        return 0;
    }
    for (size_t i = 0; i < sizeof kinds / sizeof *kinds; i++) {
        if (strcmp(argv[1], kinds[i].name) == 0) {
            run_task(&kinds[i], argv[2], argv[3]);
            return 0;
        }
    }
    die("no row \"%s\"", argv[1]);
}

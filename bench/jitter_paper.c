/* SPDX-License-Identifier: BSD-3-Clause */
/*
 * jitter_paper PERIOD_NS DURATION_NS: the row of the paper's Listing 2, which is linked in verbatim.
 *
 * Its callbacks are not told which expiry they stand for, run in threads of their own, and may overlap. The
 * grid is the kernel's: where its next instant lies is asked of the running timer. Each call is charged
 * to the newest instant that it can belong to, no two to the same one: the kindest reading there is.
 */
#include <apctimer.h>

#include <stdatomic.h>
#include <stdlib.h>
#include <time.h>

#include "bench.h"
#include "jitter_row.h"

struct calls {
    struct jitter_row row;
    atomic_size_t n;
    atomic_bool over; /* calls that are still on their way count no more */
    atomic_int inside;
};

static void callback(union sigval args)
{
    struct calls *calls = args.sival_ptr;
    apc_ns now = apc_clock_mono(NULL);

    atomic_fetch_add(&calls->inside, 1);
    if (!atomic_load(&calls->over)) {
        size_t i = atomic_fetch_add(&calls->n, 1);
        if (i < calls->row.capacity)
            calls->row.ns[i] = now;
    }
    atomic_fetch_sub(&calls->inside, 1);
}

/* An instant of the timer's grid: now and what remains to the next, asked until both are of one moment. */
static apc_ns find_instant(timer_t timer)
{
    struct itimerspec left;
    apc_ns best = INT64_MAX, at = 0;

    for (int i = 0; i < 200; i++) {
        apc_ns before = apc_clock_mono(NULL);
        if (timer_gettime(timer, &left) < 0)
            die("timer_gettime failed");
        apc_ns took = apc_clock_mono(NULL) - before;
        if (took < best) {
            best = took;
            at = before + took / 2 + left.it_value.tv_sec * APC_NS_PER_S + left.it_value.tv_nsec;
        }
    }
    return at;
}

static int by_time(const void *a, const void *b)
{
    const apc_ns x = *(const apc_ns *)a, y = *(const apc_ns *)b;
    return (x > y) - (x < y);
}

static apc_ns floor_div(apc_ns a, apc_ns b)
{
    return a / b - (a % b < 0);
}

/* Instants to lateness. */
static void charge(struct jitter_row *row, apc_ns instant)
{
    apc_ns next = INT64_MAX, last = 0;

    qsort(row->ns, row->n, sizeof *row->ns, by_time);
    for (size_t i = row->n; i-- > 0;) {
        apc_ns k = floor_div(row->ns[i] - instant, row->period);
        if (k >= next)
            k = next - 1;
        if (i == row->n - 1)
            last = k;
        row->ns[i] -= instant + k * row->period;
        next = k;
    }
    if (row->n > 0)
        row->missed = (uint64_t)(last - next + 1) - row->n;
}

int main(int argc, char **argv)
{
    static struct calls calls; /* outlives main() for a call that is late even for the end */

    if (argc != 3)
        die("usage: jitter_paper PERIOD_NS DURATION_NS");
    jitter_row_begin(&calls.row, argv[1], argv[2]);

    timer_t timer = create_apctimer(callback, &calls);
    jitter_row_from(&calls.row);
    if (start_apctimer(timer, apc_ns_to_s(calls.row.period)) != 0)
        die("the timer did not start");
    const struct timespec pause = {.tv_sec = calls.row.duration / APC_NS_PER_S,
                                   .tv_nsec = calls.row.duration % APC_NS_PER_S};
    nanosleep(&pause, NULL);
    apc_ns instant = find_instant(timer);
    stop_apctimer(timer);
    atomic_store(&calls.over, true);
    jitter_row_to(&calls.row);
    while (atomic_load(&calls.inside) > 0)
        nanosleep(&(struct timespec){.tv_nsec = 1000000}, NULL);
    timer_delete(timer);

    size_t n = atomic_load(&calls.n);
    calls.row.n = n < calls.row.capacity ? n : calls.row.capacity;
    charge(&calls.row, instant);
    jitter_row_end(&calls.row);
    return 0;
}

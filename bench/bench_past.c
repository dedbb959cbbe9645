/* SPDX-License-Identifier: BSD-3-Clause */
/*
 * bench/past: how long a screen of the past takes, that is all signals at a random instant: of a day at 1 s,
 * which PostgreSQL has in rows, and of a year at 60 s, which is packed. Every value, time and status is compared
 * with what was stored.
 *
 * bench_past STORE SIGNALS day|year
 */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "../tests/support/xorshift.h"
#include "apcstore.h"
#include "bench.h"

#define S        APC_NS_PER_S
#define INSTANTS 100

static struct apc_store *store;

static double value_of(int id, int64_t seq)
{
    return (double)id + (double)(seq % 1000) / 1000;
}

static void check(int rc, const char *what)
{
    if (rc < 0)
        die("%s: %s", what, apc_store_error(store));
}

/* @p each rows of each signal at a time, from @p begin on. */
static void fill(int signals, apc_ns begin, apc_ns period, int64_t rows, int64_t each)
{
    struct apc_sample *s = allocate((size_t)(signals * each), sizeof *s);
    for (int64_t from = 1; from <= rows; from += each) {
        size_t n = 0;
        for (int id = 1; id <= signals; id++)
            for (int64_t seq = from; seq < from + each && seq <= rows; seq++)
                s[n++] = (struct apc_sample){.table = APC_SENSOR,
                                             .id = id,
                                             .seq = seq,
                                             .time = begin + seq * period,
                                             .value = value_of(id, seq)};
        check(apc_store_append(store, s, n), "append");
    }
    free(s);
}

static int by_time(const void *a, const void *b)
{
    const double x = *(const double *)a, y = *(const double *)b;
    return (x > y) - (x < y);
}

static void compare(const struct apc_sample *s, int64_t seq, apc_ns time)
{
    if (s->seq != seq || s->time != time || s->status != APC_GOOD || s->value < value_of(s->id, seq) ||
        s->value > value_of(s->id, seq))
        die("signal %d: row %lld, and %lld was the newest", s->id, (long long)s->seq, (long long)seq);
}

static void measure(const char *what, int signals, apc_ns begin, apc_ns period, int64_t rows)
{
    struct apc_sample *s = allocate((size_t)signals, sizeof *s);
    uint64_t seed = 88172645463325252U;
    double ms[INSTANTS];
    for (int i = 0; i < INSTANTS; i++) {
        const int64_t seq = 1 + (int64_t)(xorshift(&seed) % (uint64_t)rows);
        const apc_ns at = begin + seq * period + (apc_ns)(xorshift(&seed) % (uint64_t)period);
        struct apc_store *then;
        struct apc_error why;
        for (int id = 1; id <= signals; id++)
            s[id - 1] = (struct apc_sample){.table = APC_SENSOR, .id = id};
        const apc_ns from = apc_clock_mono(NULL);
        if (apc_store_past(&then, store, at, &why) < 0)
            die("%s", why.text);
        check(apc_store_read(then, s, (size_t)signals), "read");
        ms[i] = (double)(apc_clock_mono(NULL) - from) / 1e6;
        apc_store_close(then);
        for (int k = 0; k < signals; k++)
            compare(&s[k], seq, begin + seq * period);
    }
    qsort(ms, INSTANTS, sizeof *ms, by_time);
    printf("%-22s %8d %12lld %10.1f %10.1f %10.1f\n", what, signals, (long long)rows * signals,
           ms[INSTANTS / 2], ms[INSTANTS * 95 / 100], ms[INSTANTS - 1]);
    free(s);
}

int main(int argc, char **argv)
{
    if (argc != 4)
        die("usage: bench_past STORE SIGNALS day|year");
    const int signals = (int)strtol(argv[2], NULL, 10);
    const bool year = strcmp(argv[3], "year") == 0;
    const struct apc_store_options options = {.size = sizeof options, .timeout = 600 * S, .chunks = year};
    const struct apc_retention packed = {.size = sizeof packed, .packed = 1}, all = {.size = sizeof all};
    const apc_ns period = (year ? 60 : 1) * S, now = apc_clock_utc(NULL) / S * S;
    const int64_t rows = (year ? 365 : 1) * INT64_C(86400) * S / period;
    const apc_ns begin = now - (rows + 1) * period;
    struct apc_error why;
    char what[100];
    if (signals < 1)
        die("usage: bench_past STORE SIGNALS day|year; SIGNALS 1 or more, not %s", argv[2]);
    if (apc_store_open(&store, argv[1], &options, &why) < 0)
        die("%s", why.text);
    check(apc_store_init(store), "init");
    fill(signals, begin, period, rows, year || strncmp(argv[1], "sqlite:", 7) == 0 ? 1000 : 3);
    check(apc_store_maintain(store, year ? &packed : &all), "maintain");
    snprintf(what, sizeof what, "%.*s, %s", (int)strcspn(argv[1], ":"), argv[1], year ? "year" : "day");
    measure(what, signals, begin, period, rows);
    apc_store_close(store);
    return 0;
}

/* SPDX-License-Identifier: BSD-3-Clause */
#include "jitter_row.h"

#include <stdlib.h>
#include <string.h>
#include <sys/resource.h>

#include "bench.h"

static apc_ns number(const char *text, const char *what)
{
    double value;

    if (apc_number_parse(text, &value) < 0 || !(value >= 1e4 && value <= 1e12))
        die("%s is \"%s\": expected nanoseconds, 1e4 to 1e12", what, text);
    return (apc_ns)value;
}

void jitter_row_begin(struct jitter_row *row, const char *period, const char *duration)
{
    *row = (struct jitter_row){.period = number(period, "the period"),
                               .duration = number(duration, "the duration")};
    row->capacity = (size_t)(row->duration / row->period) + 100;
    row->ns = allocate(row->capacity, sizeof *row->ns);
    memset(row->ns, 1, row->capacity * sizeof *row->ns); /* no page fault later */
}

static apc_ns cpu_time(void)
{
    struct rusage r;

    getrusage(RUSAGE_SELF, &r);
    return (r.ru_utime.tv_sec + r.ru_stime.tv_sec) * APC_NS_PER_S +
           (r.ru_utime.tv_usec + r.ru_stime.tv_usec) * 1000;
}

void jitter_row_from(struct jitter_row *row)
{
    row->cpu = cpu_time();
    row->wall = apc_clock_mono(NULL);
}

void jitter_row_to(struct jitter_row *row)
{
    row->wall = apc_clock_mono(NULL) - row->wall;
    row->cpu = cpu_time() - row->cpu;
}

void jitter_row_end(struct jitter_row *row)
{
    printf("%lld %lld %llu %zu\n", (long long)row->cpu, (long long)row->wall, (unsigned long long)row->missed,
           row->n);
    for (size_t i = 0; i < row->n; i++)
        printf("%lld\n", (long long)row->ns[i]);
    free(row->ns);
    if (fflush(stdout))
        die("the samples could not be written");
}

/* SPDX-License-Identifier: BSD-3-Clause */
/*
 * What a row of bench/jitter is to the driver: a program of its own, so that no row inherits another's
 * locked memory, priority or latency hold. It runs for a while, keeps its samples in memory that it touched
 * before, and prints them at the end:
 *
 *     cpu_ns wall_ns missed n
 *     (n lines: nanoseconds, in the order of the ticks)
 *
 * A sample is the lateness of a tick on its grid or, for a row that has none, how much longer than the
 * period its last interval was.
 */
#ifndef APC_JITTER_ROW_H
#define APC_JITTER_ROW_H

#include <apcbase.h>

struct jitter_row {
    apc_ns period, duration;
    apc_ns *ns;      /* samples, or instants on their way to become some */
    size_t capacity; /* as many as can come */
    size_t n;
    uint64_t missed;
    apc_ns wall, cpu;
};

/* From the command line: period and duration in ns. */
void jitter_row_begin(struct jitter_row *row, const char *period, const char *duration);
/* Around what is measured. */
void jitter_row_from(struct jitter_row *row);
void jitter_row_to(struct jitter_row *row);
/* Print it and free it. */
void jitter_row_end(struct jitter_row *row);

#endif

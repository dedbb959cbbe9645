/* SPDX-License-Identifier: BSD-3-Clause */
/* What the main thread of a daemon looks out for while the task runs. Each look compares with the one before.
 */
#ifndef APC_WATCH_H
#define APC_WATCH_H

#include <apcbase.h>

/* The wall clock against the monotonic one. */
struct clock_watch {
    const struct apc_clock *clock; /* NULL: the system's */
    apc_ns offset;
};
void clock_watch_init(struct clock_watch *w, const struct apc_clock *clock);
/* By how much the wall clock was stepped since the last look; 0 when it was not, or slewed. */
apc_ns clock_watch_look(struct clock_watch *w);

/* The alarm of a task that misses its ticks. Zeroed: none. */
struct overrun_watch {
    uint64_t alarms;
    bool on;
};
enum overrun_change { OVERRUN_SAME = 0, OVERRUN_BEGAN, OVERRUN_ENDED };
/* Given what apc_task_overruns() says. One that began and ended between two looks began now and ends at the
 * next look. */
enum overrun_change overrun_watch_look(struct overrun_watch *w, uint64_t in_a_row, uint64_t alarms);

#endif

/* SPDX-License-Identifier: BSD-3-Clause */
#include "common/watch.h"

#include <apctimer.h>

#define CLOCK_STEP (APC_NS_PER_S / 2) /* beyond any slewing between two looks */

void clock_watch_init(struct clock_watch *w, const struct apc_clock *clock)
{
    w->clock = clock;
    w->offset = apc_clock_offset(clock, clock);
}

apc_ns clock_watch_look(struct clock_watch *w)
{
    apc_ns before = w->offset;
    w->offset = apc_clock_offset(w->clock, w->clock);
    apc_ns step = w->offset - before;
    return step > CLOCK_STEP || step < -CLOCK_STEP ? step : 0;
}

enum overrun_change overrun_watch_look(struct overrun_watch *w, uint64_t in_a_row, uint64_t alarms)
{
    bool before = w->on, again = alarms != w->alarms;
    w->alarms = alarms;
    w->on = in_a_row >= APC_OVERRUN_ALARM || (!before && again);
    if (w->on == before)
        return OVERRUN_SAME;
    return w->on ? OVERRUN_BEGAN : OVERRUN_ENDED;
}

/* SPDX-License-Identifier: BSD-3-Clause */
#include "daemon/self_monitor.h"

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

bool tick_watch_look(struct tick_watch *w, uint64_t ticks, uint64_t overruns)
{
    if (ticks != w->ticks || !w->begun)
        *w = (struct tick_watch){.begun = true, .ticks = ticks, .overruns = overruns};
    return overruns <= w->overruns;
}

enum state_change state_watch_look(struct state_watch *w, bool up, apc_ns now)
{
    w->held += up != w->up;
    w->up = up;
    if (w->held == 0 || w->full > now + (STATE_CHANGES - 1) * STATE_AGAIN)
        return CHANGE_NONE;
    w->full = (w->full > now ? w->full : now) + STATE_AGAIN;
    w->count = w->held;
    w->held = 0;
    return w->count == 1 ? CHANGE_ONE : CHANGE_MANY;
}

enum lag_change lag_watch_look(struct lag_watch *w, bool away, uint64_t behind, apc_ns late)
{
    const bool trouble = w->away || w->slow, begins = away && !w->away,
               slow = !away && !trouble && late > LAG_LIMIT;
    const apc_ns most = trouble ? w->late : 0;
    w->late = late > most ? late : most;
    w->away = w->away || away;
    w->slow = w->slow || slow;
    if (begins || slow)
        return begins ? LAG_AWAY : LAG_SLOW;
    if (!trouble || away || behind > 0 ||
        late > LAG_LIMIT) /* the last: while it does not answer, nothing is known */
        return LAG_SAME;
    w->away = w->slow = false;
    return LAG_ENDED;
}

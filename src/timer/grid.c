/* SPDX-License-Identifier: BSD-3-Clause */
/*
 * Ticks on a grid: start + k * period. All arithmetic is on uint64_t, where the distance of any two
 * int64_t instants is exact, so nothing overflows for any argument.
 *
 * Which tick to run, and which are missed
 * ---------------------------------------
 * A task keeps `due`: every tick before it has run or has been counted as missed. Two rules move it.
 *
 *   waking at `now`        apc_grid_newest: run the newest tick whose instant has come. Those between due
 *                          and it are missed: their time is over, a younger one stands for them. A wake-up
 *                          three seconds late is therefore one call, less than a period late.
 *   callback ends at `now` apc_grid_resume: wait for the first tick that is not yet past. Those that passed
 *                          during the callback are missed; one whose instant is exactly now is not.
 *
 * So a call runs the tick it was woken for, or a younger one, and calls and missed ticks together are the
 * grid up to due: missed = due - calls, whatever happened. With APC_OVERRUN_BURST neither rule is applied.
 */
#include "timer/timer_internal.h"

/* to - from, where to >= from. */
static uint64_t elapsed(apc_ns from, apc_ns to)
{
    return (uint64_t)to - (uint64_t)from;
}

apc_ns apc_grid_time(apc_ns start, apc_ns period, uint64_t index)
{
    uint64_t gone;
    if (__builtin_mul_overflow(index, (uint64_t)period, &gone) || gone > elapsed(start, INT64_MAX))
        return INT64_MAX;
    return (apc_ns)((uint64_t)start + gone);
}

uint64_t apc_grid_next(apc_ns start, apc_ns period, apc_ns now)
{
    if (now <= start)
        return 0;
    uint64_t gone = elapsed(start, now);
    return gone / (uint64_t)period + (gone % (uint64_t)period != 0);
}

uint64_t apc_grid_newest(apc_ns start, apc_ns period, uint64_t due, apc_ns now)
{
    if (now < apc_grid_time(start, period, due + 1)) /* as nearly always: without a division */
        return due;
    uint64_t newest = now <= start ? 0 : elapsed(start, now) / (uint64_t)period;
    return newest > due ? newest : due;
}

uint64_t apc_grid_resume(apc_ns start, apc_ns period, uint64_t index, apc_ns now)
{
    if (now <= apc_grid_time(start, period, index + 1))
        return index + 1;
    return apc_grid_next(start, period, now);
}

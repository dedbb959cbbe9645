/* SPDX-License-Identifier: BSD-3-Clause */
/*
 * The paper's wrapper of POSIX interval timers (Listing 2), with its arguments checked.
 *
 * (timer_t)0 can stand for "none": glibc's timer_t of a SIGEV_THREAD timer is its helper's record, a
 * pointer with the top bit set. Kernel ids of other timers do start at 0, so 0 is refused everywhere
 * here: after a failed create it would name somebody else's timer.
 */
#include "apctimer.h"

#include <errno.h>
#include <string.h>

timer_t create_apctimer(void (*fnc)(union sigval), void *args)
{
    timer_t timer = (timer_t)0;
    struct sigevent event;

    if (!fnc) {
        errno = EINVAL;
        return (timer_t)0;
    }
    memset(&event, 0, sizeof event);
    event.sigev_notify = SIGEV_THREAD;
    event.sigev_notify_function = fnc;
    event.sigev_value.sival_ptr = args;
    if (timer_create(CLOCK_MONOTONIC, &event, &timer) < 0)
        return (timer_t)0;
    return timer;
}

int start_apctimer(timer_t timer, double Ts)
{
    struct itimerspec setting = {.it_value = {.tv_nsec = 1}}; /* at once; 0 would disarm */
    apc_ns period;

    if (timer == (timer_t)0 || apc_period_from_s(Ts, &period, NULL) < 0)
        return APC_EINVAL;
    setting.it_interval.tv_sec = period / APC_NS_PER_S;
    setting.it_interval.tv_nsec = period % APC_NS_PER_S;
    return timer_settime(timer, 0, &setting, NULL) < 0 ? APC_ESYS : 0;
}

int stop_apctimer(timer_t timer)
{
    const struct itimerspec never = {.it_value = {0}};

    if (timer == (timer_t)0)
        return APC_EINVAL;
    return timer_settime(timer, 0, &never, NULL) < 0 ? APC_ESYS : 0;
}

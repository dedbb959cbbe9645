/* SPDX-License-Identifier: BSD-3-Clause */
#include "modules/modules_internal.h"

struct apc_watchdog apc_watchdog_make(apc_ns link_period, apc_ns command_period)
{
    return (struct apc_watchdog){.link = apc_loss_limit(link_period),
                                 .command = apc_loss_limit(command_period)};
}

void apc_watchdog_take(struct apc_watchdog *w, apc_ns mono, apc_ns stamp)
{
    w->given = mono;
    if (!w->ever || stamp != w->stamp) {
        w->changed = mono;
        w->stamp = stamp;
        w->ever = w->commanded = true;
    }
    if (w->commanded)
        w->deadline =
            w->given + w->link < w->changed + w->command ? w->given + w->link : w->changed + w->command;
}

bool apc_watchdog_trips(struct apc_watchdog *w, apc_ns mono)
{
    if (!w->commanded || mono <= w->deadline)
        return false;
    w->commanded = false;
    w->tripped = w->deadline;
    return true;
}

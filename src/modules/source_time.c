/* SPDX-License-Identifier: BSD-3-Clause */
/*
 * Whose clock is it? A plant may give the time at which it looked, or that of the last change, which can be
 * as old as one likes. But what has changed since the last look cannot be older than that look, and nothing
 * comes from the future. A clock of which that is not true is not ours, and what it says of a sample is of no
 * use to a record: it would put the sample where no one looks for it.
 */
#include "apcmodules.h"

enum verdict { RIGHT, UNKNOWN, WRONG };

static enum verdict judge_source_time(const struct apc_dating *d, apc_ns time, apc_ns now, apc_ns by)
{
    if (time > now + by)
        return WRONG;
    if (!d->seen || time == d->time)
        return UNKNOWN;
    return time < d->looked - by ? WRONG : RIGHT;
}

apc_ns apc_dating_look(struct apc_dating *d, apc_ns time, apc_ns now, apc_ns since)
{
    const enum verdict is = judge_source_time(d, time, now, d->wrong ? APC_DATING_OFF / 2 : APC_DATING_OFF);

    d->wrong = is == UNKNOWN ? d->wrong : is == WRONG;
    d->off = time < now - APC_DATING_FAR   ? -APC_DATING_FAR
             : time > now + APC_DATING_FAR ? APC_DATING_FAR
                                           : time - now;
    d->looks = d->wrong ? d->looks + (d->looks < APC_DATING_SURE) : 0;
    d->seen = true;
    d->time = time;
    d->looked = now;
    return d->wrong || time < since - APC_DATING_OFF ? now : time;
}

/* SPDX-License-Identifier: BSD-3-Clause */
#include "apcmodules.h"

/*
 * At the first look there is nothing to compare with, so the stamp has to be believed: the two clocks
 * must agree to within the horizon. Stamps from far away, past or future, count as just too old, and never
 * overflow the subtraction.
 */
static apc_ns first_age(apc_ns source_time, apc_ns utc, apc_ns horizon)
{
    if (source_time < utc - horizon || source_time > utc + horizon)
        return horizon + 1;
    return source_time < utc ? utc - source_time : 0;
}

bool apc_freshness_look(struct apc_freshness *f, int64_t mark, apc_ns source_time, struct apc_now now,
                        apc_ns horizon)
{
    if (mark == 0)
        return false;
    if (!f->seen)
        f->changed = now.mono - first_age(source_time, now.utc, horizon);
    else if (mark != f->mark)
        f->changed = now.mono;
    f->mark = mark;
    f->seen = true;
    return now.mono - f->changed <= horizon;
}

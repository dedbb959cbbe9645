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

/* How long before this look it changed: as its stamp says, as far as that lies after the look before. */
static apc_ns since(apc_ns source_time, struct apc_now now, apc_ns looked)
{
    if (source_time >= now.utc)
        return 0;
    return source_time <= now.utc - (now.mono - looked) ? now.mono - looked : now.utc - source_time;
}

bool apc_freshness_dated(struct apc_freshness *f, int64_t mark, apc_ns written, struct apc_now now,
                         apc_ns horizon)
{
    bool moved = f->seen && mark != f->mark;

    if (!apc_freshness_look(f, mark, written, now, horizon))
        return false;
    if (moved)
        f->changed = now.mono - since(written, now, f->looked);
    f->looked = now.mono;
    return now.mono - f->changed <= horizon;
}

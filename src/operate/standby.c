/* SPDX-License-Identifier: BSD-3-Clause */
#include "operate.h"

#define MISSING 2 /* looks in a row without a new tick */

void standby_follow(struct standby *s)
{
    s->looked = false;
    s->missing = 0;
}

/* A look that came late itself says nothing: what kept it may have kept the other one as well. */
static bool is_look_late(const struct standby *s, apc_ns mono)
{
    return !s->looked || mono - s->time > s->period + s->period / 2;
}

/* What numbers no claims has nobody whom one could take it from. */
static int see_holder(struct standby *s, struct apc_store *store)
{
    const int rc = apc_store_holder(store, &s->mine[s->n - 1], &s->holder);
    if (rc != APC_EINVAL)
        return rc;
    s->holder = 0;
    return 0;
}

/* One that is gone has left it; of one that lives it is taken, if it is he whose ticks were waited for. */
static int take_place(struct standby *s, struct apc_store *store)
{
    int rc = apc_store_claim_set(store, s->mine, s->n);
    if (rc == APC_EBUSY && s->holder != 0)
        rc = apc_store_seize(store, s->mine, s->n, s->holder);
    if (rc != APC_EBUSY)
        return rc < 0 ? rc : 1;
    s->missing = 0; /* another one was faster */
    return 0;
}

int standby_look(struct standby *s, struct apc_store *store, struct apc_rows *former, apc_ns mono)
{
    int rc = apc_store_read_rows(store, former);
    const bool late = is_look_late(s, mono), moved = rc >= 0 && former->vector[0].seq != s->seq;
    s->looked = true;
    s->time = mono;
    if (rc < 0 || late || moved) {
        s->missing = 0;
        s->seq = rc >= 0 ? former->vector[0].seq : s->seq;
        return rc < 0 ? rc : 0;
    }
    if (++s->missing < MISSING)
        return see_holder(s, store);
    return take_place(s, store);
}

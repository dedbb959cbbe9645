/* SPDX-License-Identifier: BSD-3-Clause */
#include "run_recovery.h"

#include <unistd.h>

#include "common/storeuri.h"
#include "daemon/gaps.h"
#include "runstore.h"
#include "segment.h"
#include "spools.h"

#define STEP (5 * APC_NS_PER_S)

int recovery_finish(const char *live, const char *history, apc_ns timeout, struct apc_error *why)
{
    const struct apc_store_options options = {.size = sizeof options, .name = "apc", .timeout = timeout};
    struct apc_store *from = NULL, *to = NULL;
    struct apc_replication *f = NULL;
    int rc = store_open(&from, live, &options, why);
    if (rc == 0)
        rc = store_open(&to, history, &options, why);
    if (rc == 0)
        rc = apc_replication_create(&f, from, to, why);
    if (rc == 0) {
        struct gap_teller gaps = {.live = from, .source = "apc"};
        apc_replication_tell(f, gap_tell, &gaps);
        while ((rc = apc_replication_step(f, STEP)) > 0)
            ;
        if (rc == 0)
            rc = apc_store_keep_history(to);
        if (rc > 0 || rc == APC_EPERM) /* it is said now, or its owner is to say so */
            rc = 0;
        if (rc < 0)
            apc_fail(why, rc, "the history: %s", apc_replication_error(f));
    }
    apc_replication_destroy(f);
    apc_store_close(from);
    apc_store_close(to);
    return rc;
}

int recovery_of_killed_run(const char *dir, const char *store, apc_ns timeout, struct apc_error *why)
{
    struct runstore r;
    struct segment segment;
    if (runstore_find(&r, dir, why) < 0 || !r.live[0]) /* spools may lie anywhere */
        return 0;
    const char *history = r.history[0] ? r.history : store;
    int rc = segment_adopt(&segment, r.live, why);
    if (rc <= 0)
        return rc;
    rc = history ? spools_drain(dir, r.live, timeout, why)
                 : apc_fail(why, APC_EINVAL, "%s does not say where its record goes: give --store URI", dir);
    if (rc == 0 || rc == APC_EPROTO) {
        const int kept = recovery_finish(r.live, history, timeout, why);
        rc = kept < 0 ? kept : rc;
        if (kept == 0)
            segment_remove(&segment);
    }
    close(segment.lock);
    return rc < 0 ? rc : 1;
}

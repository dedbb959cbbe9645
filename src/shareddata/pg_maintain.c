/* SPDX-License-Identifier: BSD-3-Clause */
/* Housekeeping: dropping what is older than is to be kept. */
#include <stdlib.h>

#include "shareddata/postgresql.h"

/* Deleting much takes longer than a tick's operation. */
#define PATIENCE 300

struct dropping {
    struct apc_pg *pg;
    int count;
};

static int take_dropped(void *ctx, int statement, PGresult *result)
{
    struct dropping *d = (struct dropping *)ctx;
    (void)statement;
    d->count += atoi(PQcmdTuples(result));
    return 0;
}

static int drop_older(struct apc_pg *pg, const char *sql, apc_ns keep)
{
    if (keep == 0) {
        return 0;
    }
    struct apc_pg_params p = {0};
    char before[8];
    apc_pg_put_int8(before, apc_pg_time(apc_clock_utc(NULL) - keep));
    apc_pg_param(&p, before, sizeof before);
    return apc_pg_send(pg, sql, &p);
}

int apc_pg_maintain(struct apc_store *store, const struct apc_retention *keep)
{
    struct dropping d = {.pg = apc_pg_of(store)};
    int err = apc_pg_begin(d.pg);
    for (enum apc_table table = APC_SENSOR; !err && table < APC_TABLE_END; table++) {
        err = drop_older(d.pg, apc_pg_texts[table].drop, keep->samples);
    }
    err = err ? err : drop_older(d.pg, "DELETE FROM event WHERE time < $1::timestamptz", keep->events);
    err = err ? err : drop_older(d.pg, "DELETE FROM timing WHERE time < $1::timestamptz", keep->timing);
    if (!err) {
        d.pg->deadline = apc_clock_mono(NULL) + PATIENCE * d.pg->base.config.timeout;
        err = apc_pg_finish(d.pg, take_dropped, &d);
    }
    return err ? err : d.count;
}

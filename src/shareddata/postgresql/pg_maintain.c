/* SPDX-License-Identifier: BSD-3-Clause */
/* Housekeeping: the procedure maintain() of the schema does it, a transaction for each step; then old weeks
 * are packed. */
#include "shareddata/postgresql/postgresql.h"

/* Dropping much takes longer than a tick's operation. */
#define PATIENCE 300

static int take_dropped(void *ctx, int statement, PGresult *result)
{
    (void)statement;
    int64_t dropped = PQntuples(result) == 1 && PQnfields(result) == 1 ? apc_pg_cell(result, 0, 0) : 0;
    *(int *)ctx = dropped < INT32_MAX ? (int)dropped : INT32_MAX;
    return 0;
}

static int finish_patiently(struct apc_pg *pg, apc_pg_result_fn fn, void *ctx)
{
    pg->deadline = apc_clock_mono(NULL) + PATIENCE * pg->base.config.timeout;
    return apc_pg_finish(pg, fn, ctx);
}

/* What came at once, as by apc copy, the server has not entered into the indexes on time: it is gone through whenever an
 * instant is asked for. An index that another who maintains drops meanwhile needs nothing. */
static int enter_times(struct apc_pg *pg)
{
    const int err = apc_pg_send(
        pg,
        "DO $$ DECLARE which oid; BEGIN "
        "FOR which IN SELECT c.oid FROM pg_class AS c JOIN pg_am AS a ON a.oid = c.relam AND a.amname = "
        "'brin' "
        "WHERE c.relkind = 'i' AND c.relnamespace = to_regnamespace(quote_ident(current_schema())) LOOP "
        "BEGIN PERFORM brin_summarize_new_values(which); "
        "EXCEPTION WHEN OTHERS THEN "
        "IF EXISTS (SELECT FROM pg_class WHERE oid = which) THEN RAISE; END IF; "
        "END; COMMIT; END LOOP; END $$",
        &(struct apc_pg_params){0});
    return err ? err : finish_patiently(pg, NULL, NULL);
}

int apc_pg_maintain(struct apc_store *store, const struct apc_retention *keep)
{
    struct apc_pg *pg = apc_pg_of(store);
    const apc_ns now = apc_clock_utc(NULL),
                 kept[5] = {0, keep->samples, keep->events, keep->timing, keep->ticks};
    struct apc_pg_params p = {0};
    char times[5][8];
    for (size_t i = 0; i < 5; i++) {
        if (i > 0 && kept[i] == 0) {
            apc_pg_param_text(&p, i < 4 ? NULL : "-infinity"); /* without a time ticks are kept a day */
        } else {
            apc_pg_put_int8(times[i], apc_pg_time(now - kept[i]));
            apc_pg_param(&p, times[i], 8);
        }
    }
    int dropped = 0;
    int err = apc_pg_begin(pg);
    if (!err) {
        err = apc_pg_send(
            pg,
            "CALL maintain($1::timestamptz, $2::timestamptz, $3::timestamptz, $4::timestamptz, NULL, "
            "$5::timestamptz)",
            &p);
    }
    err = err ? err : finish_patiently(pg, take_dropped, &dropped);
    err = err ? err : enter_times(pg);
    const int packed = !err && keep->packed > 0 ? apc_pg_pack(pg, now - keep->packed) : 0;
    err = packed < 0 ? packed : err;
    return err ? err : dropped + packed;
}

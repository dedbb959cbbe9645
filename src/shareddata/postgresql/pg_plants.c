/* SPDX-License-Identifier: BSD-3-Clause */
/*
 * Which plants a database has: the schemas that have libapc's tables and are this user's to look at. They are
 * found by the server's own catalogue, so the URI's schema need not be there. A view that somebody called as
 * one of the tables is none: to read it would run what he wrote with our rights.
 */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "shareddata/postgresql/postgresql.h"

static const char plants_sql[] =
    "SET search_path TO pg_catalog, pg_temp;"
    "SELECT n.nspname, (o.rolname = current_user)::text, quote_ident(n.nspname),"
    " has_table_privilege(s.oid, 'SELECT')::text"
    " FROM pg_namespace n"
    " JOIN pg_class m ON m.relnamespace = n.oid AND m.relname = 'migration' AND m.relkind = 'r'"
    " JOIN pg_class s ON s.relnamespace = n.oid AND s.relname = 'sensor_newest' AND s.relkind = 'r'"
    " AND s.relowner = m.relowner"
    " JOIN pg_roles o ON o.oid = m.relowner"
    " WHERE has_schema_privilege(n.oid, 'USAGE') AND has_table_privilege(m.oid, 'SELECT')"
    " ORDER BY n.nspname COLLATE \"C\"";

#define ONE_MAX 256 /* bytes of SQL that ask for one plant's newest measurement */

/* Their newest measurements, a row each in the same order, by one statement. NULL: out of memory. */
static char *newest_sql(const PGresult *plants)
{
    const int n = PQntuples(plants);
    char *sql = (char *)malloc((size_t)n * ONE_MAX + 1), *at = sql;
    for (int i = 0; sql && i < n; i++) {
        const bool seen = PQgetvalue(plants, i, 3)[0] == 't';
        at += snprintf(at, ONE_MAX, "%sSELECT %d AS i, (%s%s%s)", i > 0 ? " UNION ALL " : "", i,
                       seen ? "SELECT (extract(epoch FROM max(time)) * 1e6)::int8 FROM " : "NULL::int8",
                       seen ? PQgetvalue(plants, i, 2) : "", seen ? ".sensor_newest WHERE seq > 0" : "");
    }
    if (sql) {
        memcpy(at, " ORDER BY i", sizeof " ORDER BY i");
    }
    return sql;
}

static int give_plants(struct apc_pg *pg, const PGresult *plants, const PGresult *newest, apc_plant_fn fn,
                       void *ctx)
{
    const int n = PQntuples(plants);
    if (PQnfields(plants) != 4 || PQntuples(newest) != n || PQnfields(newest) != 2) {
        return apc_fail(&pg->base.why, APC_EPROTO, "the database did not answer what was asked");
    }
    int given = 0;
    for (int ended = 0; given < n && !ended; given++) {
        struct apc_store_plant plant = {.size = sizeof plant};
        snprintf(plant.schema, sizeof plant.schema, "%s", PQgetvalue(plants, given, 0));
        plant.owned = PQgetvalue(plants, given, 1)[0] == 't';
        plant.newest = (apc_ns)strtoll(PQgetvalue(newest, given, 1), NULL, 10) * 1000;
        ended = fn(ctx, &plant);
    }
    return given;
}

int apc_pg_plants(struct apc_store *store, apc_plant_fn fn, void *ctx)
{
    struct apc_pg *pg = apc_pg_of(store);
    PGresult *plants = NULL, *newest = NULL;
    int rc = apc_pg_connect_bare(pg);
    if (rc == 0) {
        rc = apc_pg_command(pg, plants_sql, &plants);
    }
    if (rc == 0 && PQntuples(plants) > 0) {
        char *sql = newest_sql(plants);
        rc = sql ? apc_pg_command(pg, sql, &newest) : apc_fail(&pg->base.why, APC_ENOMEM, "out of memory");
        free(sql);
    }
    apc_pg_drop(pg); /* the next operation connects as it should be */
    if (rc == 0 && newest) {
        store->streaming = true;
        rc = give_plants(pg, plants, newest, fn, ctx);
        store->streaming = false;
    }
    PQclear(newest);
    PQclear(plants);
    return rc;
}

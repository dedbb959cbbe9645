/* SPDX-License-Identifier: BSD-3-Clause */
/*
 * Making the schema and bringing it up to date: all in one transaction, under an advisory lock, so that
 * it happens wholly or not at all, and once however many do it at the same time. The files of sql/ hold
 * many commands each, so this runs outside pipeline mode.
 */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "shareddata/migrations.h"
#include "shareddata/postgresql.h"

/* Waiting for another init, or rewriting a large table, may take longer than a tick's operation. */
#define PATIENCE 30

static int command(struct apc_pg *pg, const char *sql, PGresult **result)
{
    pg->deadline = apc_clock_mono(NULL) + PATIENCE * pg->base.config.timeout;
    return apc_pg_command(pg, sql, result);
}

/* The one number that a query gives. */
static int number(struct apc_pg *pg, const char *sql, int *out)
{
    PGresult *result = NULL;
    int err = command(pg, sql, &result);
    if (err) {
        return err;
    }
    if (PQntuples(result) == 1 && PQnfields(result) == 1) {
        *out = (int)strtol(PQgetvalue(result, 0, 0), NULL, 10);
    } else {
        err = apc_fail(&pg->base.why, APC_EPROTO, "the database did not answer what was asked");
    }
    PQclear(result);
    return err;
}

/* The schema's name needs no escaping: apc_pg_parse_uri() let nothing through that would. */
#define SQL_MAX 512

static int current_version(struct apc_pg *pg, int *version)
{
    char sql[SQL_MAX];
    *version = 0;
    snprintf(sql, sizeof sql,
             "BEGIN; SELECT pg_advisory_xact_lock(6385763, hashtext('%s')); "
             "SELECT count(*) FROM pg_namespace WHERE nspname = '%s'",
             pg->schema, pg->schema);
    int there = 0;
    int err = number(pg, sql, &there);
    if (!err && !there) {
        snprintf(sql, sizeof sql, "CREATE SCHEMA \"%s\"", pg->schema);
        err = command(pg, sql, NULL);
    }
    if (!err) {
        snprintf(sql, sizeof sql,
                 "SET LOCAL search_path TO \"%s\", pg_temp; "
                 "SELECT count(*) FROM pg_class c JOIN pg_namespace n ON n.oid = c.relnamespace "
                 "WHERE n.nspname = '%s' AND c.relname = 'migration'",
                 pg->schema, pg->schema);
        err = number(pg, sql, &there);
    }
    if (err || !there) {
        return err;
    }
    snprintf(sql, sizeof sql, "SELECT coalesce(max(version), 0) FROM \"%s\".migration", pg->schema);
    return number(pg, sql, version);
}

static int apply(struct apc_pg *pg, const struct apc_migration *m)
{
    int err = command(pg, m->sql, NULL);
    if (!err) {
        char sql[SQL_MAX];
        snprintf(sql, sizeof sql, "INSERT INTO migration (version, name) VALUES (%d, '%s')", m->version,
                 m->name);
        err = command(pg, sql, NULL);
    }
    if (err) {
        struct apc_error cause = pg->base.why;
        apc_fail(&pg->base.why, err, "schema %s, %s: %.400s", pg->schema, m->name, cause.text);
    }
    return err;
}

static int migrate(struct apc_pg *pg, int *version)
{
    int err = current_version(pg, version);
    if (!err && *version > apc_migration_count) {
        return apc_fail(&pg->base.why, APC_ESCHEMA,
                        "schema %s is version %d, this library knows %d: upgrade libapc", pg->schema,
                        *version, apc_migration_count);
    }
    for (int i = 0; !err && i < apc_migration_count; i++) {
        if (apc_migrations[i].version > *version) {
            err = apply(pg, &apc_migrations[i]);
        }
    }
    return err ? err : command(pg, "COMMIT", NULL);
}

int apc_pg_init(struct apc_store *store)
{
    struct apc_pg *pg = apc_pg_of(store);
    int version = 0;
    int err = apc_pg_connect_bare(pg);
    if (!err) {
        err = migrate(pg, &version);
    }
    apc_pg_drop(pg); /* rolls back what failed; the next operation finds the schema as it is now */
    if (!err) {
        pg->next_try = 0;
        pg->failures = 0;
    }
    return err ? err : version;
}

/* SPDX-License-Identifier: BSD-3-Clause */
/*
 * Making the schema and bringing it up to date: all in one transaction, under an advisory lock, so that
 * it happens wholly or not at all, and once however many do it at the same time. A file of sql/ makes the
 * next version, which table migration then names, or repairs what there is, which table repair names:
 * programs of that version go on, also made before the repair. The files of sql/ hold many commands each, so
 * this runs outside pipeline mode.
 */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "shareddata/migrations.h"
#include "shareddata/postgresql/postgresql.h"

/* Waiting for another init, or rewriting a large table, may take longer than a tick's operation. */
#define PATIENCE 30

static int run_schema_command(struct apc_pg *pg, const char *sql, PGresult **result)
{
    pg->deadline = apc_clock_mono(NULL) + PATIENCE * pg->base.config.timeout;
    return apc_pg_command(pg, sql, result);
}

/* The one number that a query gives. */
static int query_schema_number(struct apc_pg *pg, const char *sql, int *out)
{
    PGresult *result = NULL;
    int err = run_schema_command(pg, sql, &result);
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

/*
 * The schema's name needs no escaping: apc_pg_parse_uri() let nothing through that would. Nor does a file's.
 * It stands before each name, as the files of sql/ do not: what they make and use is in the search_path's
 * first schema.
 */
#define SQL_MAX 768

static int has_table(struct apc_pg *pg, const char *name, int *there)
{
    char sql[SQL_MAX];
    snprintf(sql, sizeof sql,
             "SELECT count(*) FROM pg_class c JOIN pg_namespace n ON n.oid = c.relnamespace "
             "WHERE n.nspname = '%s' AND c.relname = '%s'",
             pg->schema, name);
    return query_schema_number(pg, sql, there);
}

static int make_schema(struct apc_pg *pg)
{
    char sql[SQL_MAX];
    snprintf(sql, sizeof sql,
             "BEGIN; SELECT pg_advisory_xact_lock(6385763, hashtext('%s')); "
             "SELECT count(*) FROM pg_namespace WHERE nspname = '%s'",
             pg->schema, pg->schema);
    int there = 0;
    int err = query_schema_number(pg, sql, &there);
    if (!err && !there) {
        snprintf(sql, sizeof sql, "CREATE SCHEMA \"%s\"", pg->schema);
        err = run_schema_command(pg, sql, NULL);
    }
    return err;
}

/*
 * From here on as the owner of the tables, or of the schema that is to have them: what is made is then the
 * owner's, whoever makes it. The role is looked for with nothing but the server's own names in the
 * search_path. (A superuser is not safe from an owner by that: what the owner keeps in the schema could take
 * the role off again.)
 */
static int enter_schema(struct apc_pg *pg)
{
    char sql[SQL_MAX];
    snprintf(sql, sizeof sql,
             "SET LOCAL search_path TO pg_catalog, pg_temp; "
             "SELECT set_config('role', pg_get_userbyid(owner), true) FROM (SELECT coalesce((SELECT relowner "
             "FROM pg_class WHERE relnamespace = n.oid AND relname = 'migration'), nspowner) AS owner "
             "FROM pg_namespace n WHERE nspname = '%s') AS o WHERE pg_has_role(owner, 'MEMBER'); "
             "SET LOCAL search_path TO \"%s\", pg_temp",
             pg->schema, pg->schema);
    return run_schema_command(pg, sql, NULL);
}

static int current_version(struct apc_pg *pg, int *version, int *compatible_from)
{
    char sql[SQL_MAX];
    *version = *compatible_from = 0;
    int there = 0;
    int err = has_table(pg, "migration", &there);
    if (err || !there) {
        return err;
    }
    snprintf(sql, sizeof sql, "SELECT coalesce(max(version), 0) FROM \"%s\".migration", pg->schema);
    err = query_schema_number(pg, sql, version);
    snprintf(sql, sizeof sql,
             "SELECT coalesce(max(compatible_from), %d) FROM \"%s\".migration WHERE version = %d", *version,
             pg->schema, *version);
    return err ? err : query_schema_number(pg, sql, compatible_from);
}

static int is_repaired(struct apc_pg *pg, const char *name, int *repaired)
{
    char sql[SQL_MAX];
    *repaired = 0;
    int there = 0;
    int err = has_table(pg, "repair", &there);
    if (err || !there) {
        return err; /* the first one makes the table */
    }
    snprintf(sql, sizeof sql, "SELECT count(*) FROM \"%s\".repair WHERE name = '%s'", pg->schema, name);
    return query_schema_number(pg, sql, repaired);
}

/*
 * Before the baseline there were twelve files, and databases that they made. One that has them all is the
 * baseline, whatever its number was (4). One that lacks some is refused: the files are no longer here.
 */
#define FORMER_LAST "0012-repair-times"

static int take_former(struct apc_pg *pg)
{
    char sql[SQL_MAX];
    int former = 0, complete = 0;
    int err = has_table(pg, "migration", &former);
    if (!err && former) {
        snprintf(
            sql, sizeof sql,
            "SELECT (count(*) > 0 AND count(*) FILTER (WHERE name = '%s') = 0)::int FROM \"%s\".migration",
            apc_migrations[0].name, pg->schema);
        err = query_schema_number(pg, sql, &former);
    }
    if (err || !former) {
        return err;
    }
    err = is_repaired(pg, FORMER_LAST, &complete);
    if (!err && !complete) {
        return apc_fail(&pg->base.why, APC_ESCHEMA,
                        "schema %s was made before %s and lacks " FORMER_LAST
                        ": run apc init of commit " APC_FORMER_COMMIT " on it first (sql/README.md)",
                        pg->schema, apc_migrations[0].name);
    }
    snprintf(
        sql, sizeof sql,
        "DELETE FROM migration; DELETE FROM repair; INSERT INTO migration (version, name) VALUES (1, '%s'); "
        "INSERT INTO event (time, severity, source, kind, text) SELECT now(), 1, 'apc init', 'store', "
        "'the tables are those of %s'",
        apc_migrations[0].name, apc_migrations[0].name);
    return err ? err : run_schema_command(pg, sql, NULL);
}

/* What was mended while programs worked is worth an event. */
static int note_migration(struct apc_pg *pg, const struct apc_migration *m, bool running)
{
    char sql[SQL_MAX];
    if (!m->repair) {
        snprintf(sql, sizeof sql,
                 "INSERT INTO migration (version, name) VALUES (%d, '%s') ON CONFLICT DO NOTHING", m->number,
                 m->name); /* a file that is compatible says so itself */
    } else {
        snprintf(sql, sizeof sql,
                 "INSERT INTO repair (name) VALUES ('%s'); INSERT INTO event (time, severity, source, kind, "
                 "text) SELECT now(), 1, 'apc init', 'store', 'repair %s of the tables applied' WHERE %s",
                 m->name, m->name, running ? "true" : "false");
    }
    return run_schema_command(pg, sql, NULL);
}

static int apply(struct apc_pg *pg, const struct apc_migration *m, int had)
{
    int done = m->number <= had;
    int err = m->repair ? is_repaired(pg, m->name, &done) : 0;
    if (err || done) {
        return err;
    }
    err = run_schema_command(pg, m->sql, NULL);
    if (!err) {
        err = note_migration(pg, m, had > 0);
    }
    if (err) {
        struct apc_error cause = pg->base.why;
        apc_fail(&pg->base.why, err, "schema %s, %s: %.400s", pg->schema, m->name, cause.text);
    }
    return err;
}

/* A newer version has all repairs of ours. */
static int migrate_schema(struct apc_pg *pg, int *version)
{
    int compatible_from = 0;
    int err = make_schema(pg);
    if (!err) {
        err = enter_schema(pg);
    }
    if (!err) {
        err = take_former(pg);
    }
    if (!err) {
        err = current_version(pg, version, &compatible_from);
    }
    if (!err) {
        err = apc_pg_check_version(pg, *version, compatible_from);
    }
    for (int i = 0; !err && i < apc_migration_count && *version <= apc_store_version(); i++) {
        err = apply(pg, &apc_migrations[i], *version);
    }
    return err ? err : run_schema_command(pg, "COMMIT", NULL);
}

int apc_pg_init(struct apc_store *store)
{
    struct apc_pg *pg = apc_pg_of(store);
    int version = 0;
    int err = apc_pg_connect_bare(pg);
    if (!err) {
        err = migrate_schema(pg, &version);
    }
    apc_pg_drop(pg); /* rolls back what failed; the next operation finds the schema as it is now */
    if (!err) {
        pg->next_try = 0;
        pg->failures = 0;
    }
    return err ? err : version;
}

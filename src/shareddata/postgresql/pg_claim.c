/* SPDX-License-Identifier: BSD-3-Clause */
/*
 * The PostgreSQL store: claims. The server ends them with the session (sql/0001-baseline.sql), so the store keeps
 * in mind what it claimed and claims it anew in each session, before anything else.
 */
#include <stdlib.h>
#include <string.h>

#include "shareddata/postgresql/postgresql.h"

static int pg_claim_unexpected(struct apc_pg *pg)
{
    return apc_fail(&pg->base.why, APC_EPROTO, "the database did not answer what was asked");
}

#define NAME_MAX_LEN 12 /* of a table, with its comma */

/* An array of names, as text: they are words of ours, without anything to quote. */
static char *names_of(const struct apc_sample *variables, size_t n)
{
    char *text = (char *)malloc(n * NAME_MAX_LEN + 3), *end = text;
    if (!text) {
        return NULL;
    }
    *end++ = '{';
    for (size_t i = 0; i < n; i++) {
        const char *name = apc_table_name(variables[i].table);
        const size_t length = strlen(name);
        if (i > 0) {
            *end++ = ',';
        }
        memcpy(end, name, length);
        end += length;
    }
    memcpy(end, "}", 2);
    return text;
}

static int send_set(struct apc_pg *pg, const char *sql, const struct apc_sample *variables, size_t n)
{
    struct apc_pg_params p = {0};
    char *names = names_of(variables, n);
    if (!names || apc_pg_array_begin(&pg->columns[0], APC_PG_INT4, n) != 0) {
        free(names);
        return apc_fail(&pg->base.why, APC_ENOMEM, "out of memory for %zu variables", n);
    }
    for (size_t i = 0; i < n; i++) {
        apc_pg_array_int4(&pg->columns[0], variables[i].id);
    }
    apc_pg_param_text(&p, names);
    apc_pg_param(&p, pg->columns[0].data, pg->columns[0].length);
    int err = apc_pg_send(pg, sql, &p);
    free(names);
    return err;
}

/* The clock of when it was given: whoever gets it later has a later one, whatever session came first. */
#define CLAIM_SET                                                                                            \
    "SELECT at, holder, last, (extract(epoch FROM clock_timestamp()) * 1e6)::int8"                           \
    " FROM claim_set($1::text[], $2::int4[])"

int apc_pg_send_claims(struct apc_pg *pg)
{
    pg->session.claimant = true;
    return send_set(pg, CLAIM_SET, pg->claimed.at, pg->claimed.n);
}

static int take_set(struct apc_pg *pg, const PGresult *result, const struct apc_sample *variables, size_t n,
                    int64_t *last)
{
    if (PQntuples(result) != 1 || PQnfields(result) != 4) {
        return pg_claim_unexpected(pg);
    }
    const int64_t at = apc_pg_cell(result, 0, 0);
    if (!PQgetisnull(result, 0, 0)) {
        return at < 1 || (size_t)at > n
                   ? pg_claim_unexpected(pg)
                   : apc_fail(&pg->base.why, APC_EBUSY,
                              "%s %d of schema %s is already written by %s: stop it first",
                              apc_table_name(variables[at - 1].table), variables[at - 1].id, pg->schema,
                              PQgetvalue(result, 0, 1));
    }
    pg->base.claim = (uint64_t)apc_pg_cell(result, 0, 3);
    if (!last) {
        return 0;
    }
    int got = apc_pg_get_int8_array(PQgetvalue(result, 0, 2), (size_t)PQgetlength(result, 0, 2), last, n);
    return got >= 0 && (size_t)got == n ? 0 : pg_claim_unexpected(pg);
}

int apc_pg_take_claims(struct apc_pg *pg, const PGresult *result)
{
    return take_set(pg, result, pg->claimed.at, pg->claimed.n, NULL);
}

struct set {
    struct apc_pg *pg;
    const struct apc_sample *variables;
    size_t n;
    int64_t *last;
};

static int take_claimed(void *ctx, int statement, PGresult *result)
{
    const struct set *set = (const struct set *)ctx;
    (void)statement;
    return take_set(set->pg, result, set->variables, set->n, set->last);
}

int apc_pg_claim_set(struct apc_store *store, struct apc_sample *variables, size_t n)
{
    struct apc_pg *pg = apc_pg_of(store);
    struct set set = {
        .pg = pg, .variables = variables, .n = n, .last = (int64_t *)calloc(n, sizeof *set.last)};
    int err = set.last ? apc_claims_reserve(store, &pg->claimed, n)
                       : apc_fail(&pg->base.why, APC_ENOMEM, "out of memory for %zu variables", n);
    if (!err) {
        err = apc_pg_begin(pg);
    }
    if (!err) {
        pg->session.claimant = true;
        err = send_set(pg, CLAIM_SET, variables, n);
    }
    if (!err) {
        err = apc_pg_finish(pg, take_claimed, &set);
    }
    for (size_t i = 0; !err && i < n; i++) {
        variables[i].seq = set.last[i];
    }
    if (!err) {
        apc_claims_add(&pg->claimed, variables, n);
    }
    free(set.last);
    return err;
}

int apc_pg_release(struct apc_store *store, const struct apc_sample *variables, size_t n)
{
    struct apc_pg *pg = apc_pg_of(store);
    apc_claims_drop(&pg->claimed, variables, n); /* first: a new connection must not claim them again */
    if (!pg->conn) { /* with the session they have gone, or the next one ends it */
        pg->next_try = pg->failed == APC_EBUSY ? 0 : pg->next_try; /* it failed for them */
        return 0;
    }
    int err = apc_pg_begin(pg);
    if (!err) {
        err = send_set(pg, "SELECT claim_release($1::text[], $2::int4[])", variables, n);
    }
    return err ? err : apc_pg_finish(pg, NULL, NULL);
}

/* ---- Of one who lives ---------------------------------------------------------------------- */

#define NUMBER " (extract(epoch FROM c.started) * 1e6)::int8"
#define OF_THE_LIVING                                                                                        \
    " FROM claim c JOIN pg_locks l ON l.pid = c.pid AND l.locktype = 'advisory' AND l.granted"               \
    " AND l.classid = 'claim'::regclass AND l.objid = c.pid::oid AND l.objsubid = 2"

static int take_holder(void *ctx, int statement, PGresult *result)
{
    (void)statement;
    *(uint64_t *)ctx = PQntuples(result) > 0 ? (uint64_t)apc_pg_cell(result, 0, 0) : 0;
    return 0;
}

int apc_pg_holder(struct apc_store *store, const struct apc_sample *variable, uint64_t *holder)
{
    struct apc_pg *pg = apc_pg_of(store);
    int err = apc_pg_begin(pg);
    if (!err) {
        err = send_set(pg,
                       "SELECT" NUMBER OF_THE_LIVING
                       " WHERE c.table_name = ($1::text[])[1] AND c.id = ($2::int4[])[1]",
                       variable, 1);
    }
    return err ? err : apc_pg_finish(pg, take_holder, holder);
}

/* A session that has ended holds nothing, and no append of it can come any more. */
static int end_holder(struct apc_pg *pg, uint64_t holder)
{
    struct apc_pg_params p = {0};
    char number[8], wait[8];
    int err = apc_pg_begin(pg);
    if (err) {
        return err;
    }
    apc_pg_put_int8(number, (int64_t)holder);
    apc_pg_put_int8(wait, pg->base.config.timeout / 2 / APC_NS_PER_MS);
    apc_pg_param(&p, number, sizeof number);
    apc_pg_param(&p, wait, sizeof wait);
    err = apc_pg_send(pg,
                      "SELECT pg_terminate_backend(pid, $2::int8) FROM (SELECT DISTINCT c.pid" OF_THE_LIVING
                      " WHERE" NUMBER " = $1::int8 AND c.pid <> pg_backend_pid()) AS his",
                      &p);
    return err ? err : apc_pg_finish(pg, NULL, NULL);
}

int apc_pg_seize(struct apc_store *store, struct apc_sample *variables, size_t n, uint64_t holder)
{
    const int err = end_holder(apc_pg_of(store), holder);
    return err ? err : apc_pg_claim_set(store, variables, n);
}

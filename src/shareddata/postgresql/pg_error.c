/* SPDX-License-Identifier: BSD-3-Clause */
/* What libpq and the server say of a failure, as an error of ours on one line. */
#include <ctype.h>
#include <stdio.h>
#include <string.h>

#include "shareddata/postgresql/postgresql.h"

static const char *option(const struct apc_pg *pg, const char *keyword)
{
    for (const PQconninfoOption *o = pg->uri; o && o->keyword; o++) {
        if (strcmp(o->keyword, keyword) == 0 && o->val && o->val[0]) {
            return o->val;
        }
    }
    return NULL;
}

void apc_pg_flatten(const struct apc_pg *pg, char *out, size_t size, const char *text)
{
    const char *password = option(pg, "password");
    size_t used = 0;
    while (*text && used + 4 < size) {
        if (password && strncmp(text, password, strlen(password)) == 0) {
            memcpy(out + used, "***", 3);
            used += 3;
            text += strlen(password);
        } else if (isspace((unsigned char)*text)) {
            text += strspn(text, " \t\r\n");
            if (*text) {
                out[used++] = ' ';
            }
        } else {
            out[used++] = *text++;
        }
    }
    out[used] = '\0';
}

int apc_pg_fail(struct apc_pg *pg, int err, const char *what, const char *text)
{
    char flat[sizeof pg->base.why.text];
    apc_pg_flatten(pg, flat, sizeof flat, text);
    return apc_fail(&pg->base.why, err, "%s%s%s", what, flat[0] ? ": " : "", flat);
}

int apc_pg_lost(struct apc_pg *pg)
{
    int err = apc_pg_fail(pg, APC_ECONN, "connection to the database lost", PQerrorMessage(pg->conn));
    apc_pg_drop(pg);
    return err;
}

int apc_pg_timed_out(struct apc_pg *pg)
{
    const char *host = PQhost(pg->conn);
    return apc_fail(&pg->base.why, APC_ETIMEDOUT, "no answer from the database%s%s within %lld ms",
                    host && host[0] ? " at " : "", host ? host : "",
                    (long long)(pg->base.config.timeout / APC_NS_PER_MS));
}

/* By SQLSTATE: PostgreSQL's manual, appendix A. */
static int error_of_sqlstate(const char *sqlstate)
{
    static const struct {
        const char *prefix;
        int err;
    } map[] = {
        {"42501", APC_EPERM},     /* insufficient privilege */
        {"42P01", APC_ESCHEMA},   /* undefined table */
        {"42883", APC_ESCHEMA},   /* undefined function */
        {"3F", APC_ESCHEMA},      /* undefined schema */
        {"25006", APC_ECONN},     /* read-only: this server has become, or is still, a standby */
        {"57P", APC_ECONN},       /* shutting down, starting up */
        {"53100", APC_EFULL},     /* disk full */
        {"53", APC_ECONN},        /* no memory, too many connections: it may pass */
        {"08", APC_ECONN},        /* connection */
        {"40P01", APC_ECONFLICT}, /* deadlock */
        {"40001", APC_ECONFLICT}, /* serialization */
        {"23505", APC_ECONFLICT}, /* unique */
    };
    for (size_t i = 0; i < sizeof map / sizeof map[0]; i++) {
        if (strncmp(sqlstate, map[i].prefix, strlen(map[i].prefix)) == 0) {
            return map[i].err;
        }
    }
    return APC_ESTORE;
}

int apc_pg_refused(struct apc_pg *pg, const PGresult *result)
{
    const char *sqlstate = PQresultErrorField(result, PG_DIAG_SQLSTATE);
    const char *primary = PQresultErrorField(result, PG_DIAG_MESSAGE_PRIMARY);
    const char *detail = PQresultErrorField(result, PG_DIAG_MESSAGE_DETAIL);
    if (!sqlstate || !primary) {
        return apc_pg_fail(pg, APC_ECONN, "connection to the database lost", PQresultErrorMessage(result));
    }
    char text[sizeof pg->base.why.text];
    snprintf(text, sizeof text, "%s%s%s", primary, detail ? ": " : "", detail ? detail : "");
    pg->violated = strcmp(sqlstate, "23514") == 0;
    int err = error_of_sqlstate(sqlstate);
    switch (err) {
    case APC_EPERM:
        return apc_pg_fail(pg, err, "the database does not permit it", text);
    case APC_ESCHEMA:
        return apc_pg_fail(pg, err, "the database's schema is not libapc's (run apc init)", text);
    case APC_ECONN:
        return apc_pg_fail(pg, err, "the database server ended the connection", text);
    default:
        break;
    }
    if (!strcmp(sqlstate, "26000") ||
        !strcmp(sqlstate, "42P05")) { /* a prepared statement of another session */
        return apc_pg_fail_pooled(pg);
    }
    if (!strcmp(sqlstate, "42703") || !strcmp(sqlstate, "42P07")) { /* no such column; the table is there */
        char what[160];
        snprintf(what, sizeof what,
                 "schema \"%s\" has tables that are not libapc's (name another behind a #)", pg->schema);
        return apc_pg_fail(pg, err, what, text);
    }
    return apc_pg_fail(pg, err, "the database refused it", text);
}

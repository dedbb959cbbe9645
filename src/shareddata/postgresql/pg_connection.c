/* SPDX-License-Identifier: BSD-3-Clause */
/*
 * One PostgreSQL connection that never makes its user wait beyond a deadline.
 *
 * libpq's own waits have no bound that holds: with packets dropped, statement_timeout, keepalives and
 * tcp_user_timeout all leave a caller hanging for half a minute or for ever. So libpq is used only
 * asynchronously, every wait is a poll() of ours, and when the deadline passes the connection is closed:
 * a late answer can then never be taken for that of a later question. PQfinish() does not block, because
 * the connection is in non-blocking mode, where libpq sends its goodbye only if the socket takes it.
 * What can block: the name service, inside PQconnectStart(). Give addresses (hostaddr=), not names,
 * where that matters.
 *
 * An operation is: queue statements, one Sync, wait for all answers. The server runs what lies between
 * two Syncs as one transaction and commits it at the Sync, so one operation is one transaction and one
 * round trip; it has failed if anything at all before the Sync's answer is an error, a failing commit
 * included.
 *
 * After a failed connect no other is tried until a pause is over; the pauses double up to a bound and
 * are jittered, so that the clients of a server that comes back do not all arrive at once.
 */
#include <ctype.h>
#include <errno.h>
#include <poll.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

#include "shareddata/postgresql/postgresql.h"

/* ---- Error texts -------------------------------------------------------------------------- */

static const char *option(const struct apc_pg *pg, const char *keyword)
{
    for (const PQconninfoOption *o = pg->uri; o && o->keyword; o++) {
        if (strcmp(o->keyword, keyword) == 0 && o->val && o->val[0]) {
            return o->val;
        }
    }
    return NULL;
}

/* libpq and the server write several lines; ours is one. A password is never shown. */
static void flatten(const struct apc_pg *pg, char *out, size_t size, const char *text)
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

/* The text of libpq or of the server on one line, without the password. */
static int fail(struct apc_pg *pg, int err, const char *what, const char *text)
{
    char flat[sizeof pg->base.why.text];
    flatten(pg, flat, sizeof flat, text);
    return apc_fail(&pg->base.why, err, "%s%s%s", what, flat[0] ? ": " : "", flat);
}

/* The connection is of no use any more. */
static int lost(struct apc_pg *pg)
{
    int err = fail(pg, APC_ECONN, "connection to the database lost", PQerrorMessage(pg->conn));
    apc_pg_drop(pg);
    return err;
}

static int timed_out(struct apc_pg *pg)
{
    const char *host = PQhost(pg->conn);
    return apc_fail(&pg->base.why, APC_ETIMEDOUT, "no answer from the database%s%s within %lld ms",
                    host && host[0] ? " at " : "", host ? host : "",
                    (long long)(pg->base.config.timeout / APC_NS_PER_MS));
}

/* By SQLSTATE: PostgreSQL's manual, appendix A. */
static int error_of(const char *sqlstate)
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

/* Fail with the error that a result reports. */
static int refused(struct apc_pg *pg, const PGresult *result)
{
    const char *sqlstate = PQresultErrorField(result, PG_DIAG_SQLSTATE);
    const char *primary = PQresultErrorField(result, PG_DIAG_MESSAGE_PRIMARY);
    const char *detail = PQresultErrorField(result, PG_DIAG_MESSAGE_DETAIL);
    if (!sqlstate || !primary) {
        return fail(pg, APC_ECONN, "connection to the database lost", PQresultErrorMessage(result));
    }
    char text[sizeof pg->base.why.text];
    snprintf(text, sizeof text, "%s%s%s", primary, detail ? ": " : "", detail ? detail : "");
    pg->violated = strcmp(sqlstate, "23514") == 0;
    int err = error_of(sqlstate);
    switch (err) {
    case APC_EPERM:
        return fail(pg, err, "the database does not permit it", text);
    case APC_ESCHEMA:
        return fail(pg, err, "the database's schema is not libapc's (run apc init)", text);
    case APC_ECONN:
        return fail(pg, err, "the database server ended the connection", text);
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
        return fail(pg, err, what, text);
    }
    return fail(pg, err, "the database refused it", text);
}

/* ---- Waiting ------------------------------------------------------------------------------ */

/* Until the socket is ready, but not past the deadline: 1, 0 when the time is up, or APC_ESYS. */
static int poll_socket(struct apc_pg *pg, short events, apc_ns deadline)
{
    for (;;) {
        apc_ns left = deadline - apc_clock_mono(NULL);
        if (left <= 0) {
            return 0;
        }
        struct pollfd fd = {.fd = PQsocket(pg->conn), .events = events};
        struct timespec timeout = {.tv_sec = left / APC_NS_PER_S, .tv_nsec = left % APC_NS_PER_S};
        int ready = ppoll(&fd, 1, &timeout, NULL);
        if (ready > 0) {
            return 1;
        }
        if (ready < 0 && errno != EINTR) {
            return apc_fail(&pg->base.why, APC_ESYS, "cannot wait for the database: %s", strerror(errno));
        }
    }
}

/* The same within an operation: 0, or APC_ETIMEDOUT, APC_ESYS. */
static int wait_socket(struct apc_pg *pg, short events)
{
    int ready = poll_socket(pg, events, pg->deadline);
    return ready > 0 ? 0 : ready < 0 ? ready : timed_out(pg);
}

/* One may have come already, along with the answer to an operation. */
int apc_pg_await_notify(struct apc_pg *pg, apc_ns deadline)
{
    for (;;) {
        bool any = false;
        for (PGnotify *n = PQnotifies(pg->conn); n; n = PQnotifies(pg->conn)) {
            PQfreemem(n);
            any = true;
        }
        if (any) {
            return 1;
        }
        int ready = poll_socket(pg, POLLIN, deadline);
        if (ready <= 0) {
            return ready;
        }
        if (!PQconsumeInput(pg->conn)) {
            return lost(pg);
        }
    }
}

/* Until PQgetResult() will not block. Reads while it writes, or both sides could wait for each other. */
static int await_result(struct apc_pg *pg)
{
    for (;;) {
        int unsent = PQflush(pg->conn);
        if (unsent < 0) {
            return lost(pg);
        }
        if (!PQisBusy(pg->conn)) {
            return 0;
        }
        int err = wait_socket(pg, (short)(POLLIN | (unsent ? POLLOUT : 0)));
        if (err) {
            apc_pg_drop(pg);
            return err;
        }
        if (!PQconsumeInput(pg->conn)) {
            return lost(pg);
        }
    }
}

/*
 * Warnings of interest: a commit whose wait for the standby was cut short is durable here only, so it is
 * no acknowledgement (SyncRepWaitForLSN() in PostgreSQL's syncrep.c; texts are translated, so go by
 * SQLSTATE). Everything else is dropped: the library never prints, as libpq would.
 */
static void notice(void *ctx, const PGresult *result)
{
    struct apc_pg *pg = (struct apc_pg *)ctx;
    const char *severity = PQresultErrorField(result, PG_DIAG_SEVERITY_NONLOCALIZED);
    const char *sqlstate = PQresultErrorField(result, PG_DIAG_SQLSTATE);
    if (severity && sqlstate && strcmp(severity, "WARNING") == 0 &&
        (strcmp(sqlstate, "01000") == 0 || strncmp(sqlstate, "57P", 3) == 0)) {
        pg->unreplicated = true;
    }
}

/* ---- One operation ------------------------------------------------------------------------ */

void apc_pg_param(struct apc_pg_params *p, const char *binary, size_t length)
{
    p->values[p->n] = binary;
    p->lengths[p->n] = (int)length;
    p->formats[p->n++] = 1;
}

void apc_pg_param_text(struct apc_pg_params *p, const char *text)
{
    p->values[p->n] = text;
    p->formats[p->n++] = 0;
}

/* Half a queue is of no use: what was queued before goes with the connection. */
static int not_queued(struct apc_pg *pg)
{
    int err = fail(pg, PQstatus(pg->conn) == CONNECTION_BAD ? APC_ECONN : APC_ENOMEM,
                   "cannot talk to the database", PQerrorMessage(pg->conn));
    apc_pg_drop(pg);
    return err;
}

int apc_pg_send(struct apc_pg *pg, const char *sql, const struct apc_pg_params *p)
{
    return PQsendQueryParams(pg->conn, sql, p->n, NULL, p->values, p->lengths, p->formats, 1)
               ? 0
               : not_queued(pg);
}

int apc_pg_send_prepared(struct apc_pg *pg, const char *name, const struct apc_pg_params *p)
{
    return PQsendQueryPrepared(pg->conn, name, p->n, p->values, p->lengths, p->formats, 1) ? 0
                                                                                           : not_queued(pg);
}

/* Where the answers to an operation have got to. */
struct progress {
    int statement;
    bool between; /* statements: the last one's results are through */
    bool ended;   /* with the Sync's answer */
};

static int take(struct apc_pg *pg, PGresult *result, struct progress *at, apc_pg_result_fn fn, void *ctx)
{
    switch (PQresultStatus(result)) {
    case PGRES_PIPELINE_SYNC:
        at->ended = true;
        return 0;
    case PGRES_COMMAND_OK:
    case PGRES_SINGLE_TUPLE:
    case PGRES_TUPLES_OK:
        return fn ? fn(ctx, at->statement, result) : 0;
    case PGRES_PIPELINE_ABORTED:
        return 0; /* the error came before */
    case PGRES_FATAL_ERROR:
        return refused(pg, result);
    default:
        return apc_fail(&pg->base.why, APC_EPROTO, "the database gave an answer of an unexpected kind");
    }
}

static int take_next(struct apc_pg *pg, struct progress *at, apc_pg_result_fn fn, void *ctx)
{
    int err = await_result(pg);
    if (err) {
        return err;
    }
    PGresult *result = PQgetResult(pg->conn);
    if (!result) {
        if (PQstatus(pg->conn) == CONNECTION_BAD || at->between) {
            return lost(pg);
        }
        at->between = true;
        at->statement++;
        return 0;
    }
    at->between = false;
    err = take(pg, result, at, fn, ctx);
    PQclear(result);
    return err;
}

int apc_pg_finish(struct apc_pg *pg, apc_pg_result_fn fn, void *ctx)
{
    return apc_pg_finish_by_rows(pg, -1, fn, ctx);
}

int apc_pg_finish_by_rows(struct apc_pg *pg, int by_rows, apc_pg_result_fn fn, void *ctx)
{
    if (!PQpipelineSync(pg->conn)) {
        return not_queued(pg);
    }
    pg->base.stats.round_trips++;
    pg->unreplicated = false;
    struct progress at = {0};
    struct apc_error first; /* what failed first says why; the rest is its consequence */
    int failed = 0;
    while (pg->conn && !at.ended) {
        if (at.between && at.statement == by_rows) {
            PQsetSingleRowMode(pg->conn); /* or they come all at once, which gives the same */
        }
        int err = take_next(pg, &at, failed ? NULL : fn, ctx);
        if (err && !failed) {
            failed = err;
            first = pg->base.why;
        }
    }
    if (failed) {
        pg->base.why = first;
        if (failed == APC_ECONN || failed == APC_EPROTO || failed == APC_ESCHEMA) {
            apc_pg_drop(pg);
        }
    }
    return failed;
}

void apc_pg_drop(struct apc_pg *pg)
{
    apc_pg_remember(pg);
    PQfinish(pg->conn);
    pg->conn = NULL;
    pg->listening = 0;
    pg->packed = false;
}

/* ---- Connecting --------------------------------------------------------------------------- */

/* What cannot be one may be a part of a password, which libpq would quote. NULL: all is well. */
static const char *misread(const PQconninfoOption *options)
{
    for (const PQconninfoOption *o = options; o && o->keyword; o++) {
        const char *const at = o->val && strcmp(o->keyword, "host") == 0 ? strrchr(o->val, '@') : NULL;
        if (at && at > o->val && at[-1] != ',') { /* one that begins so is an abstract socket */
            return "the host has an @ in it: in a password @ is written %40, : %3A, / %2F";
        }
        if (o->val && strcmp(o->keyword, "port") == 0 && o->val[strspn(o->val, "0123456789,")] != '\0') {
            return "the port is no number: expected postgresql://USER:PASSWORD@HOST:PORT/DATABASE";
        }
    }
    return NULL;
}

int apc_pg_parse_uri(struct apc_pg *pg, const char *uri, struct apc_error *why)
{
    const char *hash = strrchr(uri, '#');
    const char *schema = hash ? hash + 1 : "apc";
    size_t length = strlen(schema);
    if (length == 0 || length > 63 || strspn(schema, "abcdefghijklmnopqrstuvwxyz0123456789_") != length ||
        isdigit((unsigned char)schema[0])) {
        return apc_fail(why, APC_EINVAL,
                        "the schema after # must be a lower-case name of at most 63 letters, "
                        "digits and _, not beginning with a digit");
    }
    memcpy(pg->schema, schema, length + 1);

    char *text = hash ? strndup(uri, (size_t)(hash - uri)) : strdup(uri);
    if (!text) {
        return apc_fail(why, APC_ENOMEM, "out of memory");
    }
    const char *rest = strchr(text, ':') + 1;
    char *message = NULL;
    int err = 0;
    if (rest[0] != '\0' && strncmp(rest, "//", 2) != 0) {
        err = apc_fail(why, APC_EINVAL, "malformed store URI: after postgresql: comes nothing or //");
    } else {
        pg->uri = PQconninfoParse(rest[0] ? text : "", &message);
        if (!pg->uri) { /* libpq's own text may quote a password */
            bool secret = strchr(text, '@') || strstr(text, "password");
            char flat[256];
            flatten(pg, flat, sizeof flat, message && !secret ? message : "libpq cannot read it");
            err = apc_fail(why, APC_EINVAL, "malformed store URI: %s", flat);
        } else if (misread(pg->uri)) {
            err = apc_fail(why, APC_EINVAL, "malformed store URI: %s", misread(pg->uri));
        }
    }
    PQfreemem(message);
    free(text);
    return err;
}

static const char *const host_keywords[3] = {"host", "hostaddr", "port"};

/*
 * A host that swallows packets eats the whole deadline, and libpq would begin with it again each time: so
 * after such a try the next one begins with the next host. libpq itself says which hosts there are, from
 * the URI, the environment or a service file; the first of each list goes to its end. Returns whether there
 * are several.
 */
static bool rotate_hosts(struct apc_pg *pg)
{
    bool several = false;
    PQconninfoOption *used = PQconninfo(pg->conn);
    for (const PQconninfoOption *o = used; o && o->keyword; o++) {
        for (size_t i = 0; i < 3; i++) {
            const char *comma = o->val ? strchr(o->val, ',') : NULL;
            if (comma && strcmp(o->keyword, host_keywords[i]) == 0 &&
                strlen(o->val) < sizeof pg->hosts[i] - 1) {
                snprintf(pg->hosts[i], sizeof pg->hosts[i], "%s,%.*s", comma + 1, (int)(comma - o->val),
                         o->val);
                several = true;
            }
        }
    }
    PQconninfoFree(used);
    return several;
}

#define OPTIONS_MAX 96

struct connect_params {
    const char *keywords[OPTIONS_MAX], *values[OPTIONS_MAX];
    int n;
};

static void add(struct connect_params *c, const char *keyword, const char *value)
{
    if (value && c->n < OPTIONS_MAX - 1) {
        c->keywords[c->n] = keyword;
        c->values[c->n++] = value;
    }
}

/*
 * A later keyword overrides an earlier one: what the URI says goes before our defaults. These go before a
 * service file, in which libpq alone can look; only target_session_attrs is worth a word: a store is for
 * writing, so whoever means a standby has to say so in the URI or the environment.
 */
static void make_params(struct apc_pg *pg, struct connect_params *c)
{
    c->n = 0;
    add(c, "application_name", pg->base.config.name);
    add(c, "keepalives_idle", "5");
    add(c, "keepalives_interval", "1");
    add(c, "keepalives_count", "3");
    add(c, "tcp_user_timeout", "8000");
    if (!getenv("PGTARGETSESSIONATTRS")) {
        add(c, "target_session_attrs", "read-write");
    }
    for (const PQconninfoOption *o = pg->uri; o->keyword; o++) {
        add(c, o->keyword, o->val);
    }
    for (size_t i = 0; i < 3; i++) {
        add(c, host_keywords[i], pg->hosts[i][0] ? pg->hosts[i] : NULL);
    }
    add(c, "client_encoding", "UTF8");
    c->keywords[c->n] = c->values[c->n] = NULL;
}

/* Where several servers are named, the one that leads may just have gone: that passes. */
static int not_established(struct apc_pg *pg)
{
    const char *text = PQerrorMessage(pg->conn);
    const bool standby = strstr(text, "session is read-only") != NULL;
    return fail(
        pg, APC_ECONN,
        standby ? "no server takes writes: a standby has not been promoted yet, only standbys are named, or "
                  "default_transaction_read_only is on for the database or the user"
                : "cannot connect to the database",
        text);
}

static int establish(struct apc_pg *pg)
{
    struct connect_params c;
    make_params(pg, &c);
    pg->conn = PQconnectStartParams(c.keywords, c.values, 0);
    if (!pg->conn) {
        return apc_fail(&pg->base.why, APC_ENOMEM, "out of memory");
    }
    PQsetNoticeReceiver(pg->conn, notice, pg);
    PostgresPollingStatusType state = PGRES_POLLING_WRITING;
    while (PQstatus(pg->conn) != CONNECTION_BAD && state != PGRES_POLLING_OK &&
           state != PGRES_POLLING_FAILED) {
        int err = wait_socket(pg, state == PGRES_POLLING_READING ? POLLIN : POLLOUT);
        if (err) {
            rotate_hosts(pg);
            return err;
        }
        state = PQconnectPoll(pg->conn);
    }
    if (PQstatus(pg->conn) != CONNECTION_OK || PQsetnonblocking(pg->conn, 1) != 0) {
        return not_established(pg);
    }
    return 0;
}

/*
 * What the tables and this code rely on, whatever the server, the database or the role has for a default.
 * Each operation sees what others committed before its statements, so it is read committed; triggers and
 * claims go by that. Nobody ends a session that is idle, or waits, but its own deadline. Commands that a
 * function puts together hold times as text. A standby that was not waited for is told by a warning. A
 * policy is to be obeyed, no error. A server that has not heard of one of them is not asked for it.
 */
#define SETTINGS                                                                                             \
    "(SELECT pg_catalog.count(pg_catalog.set_config(name, value, false)) FROM (VALUES "                      \
    "('default_transaction_isolation', 'read committed'), ('default_transaction_deferrable', 'off'), "       \
    "('statement_timeout', '0'), ('lock_timeout', '0'), ('transaction_timeout', '0'), "                      \
    "('idle_in_transaction_session_timeout', '0'), ('idle_session_timeout', '0'), "                          \
    "('DateStyle', 'ISO, YMD'), ('IntervalStyle', 'postgres'), ('TimeZone', 'UTC'), "                        \
    "('extra_float_digits', '1'), ('bytea_output', 'hex'), ('standard_conforming_strings', 'on'), "          \
    "('row_security', 'on'), ('client_min_messages', 'warning')) AS v (name, value) "                        \
    "WHERE pg_catalog.current_setting(name, true) IS NOT NULL)"

/*
 * What a session needs, and its name, before it is asked for anything. A server that loses its client must
 * end the session, and with it the claims: idle ones by TCP keepalives, working ones by
 * client_connection_check_interval. The schema's name is quoted because it may be a word of SQL; it has no
 * quote in it.
 */
static const char session_sql[] =
    "SELECT " SETTINGS ", set_config('search_path', '\"' || $1 || '\", pg_temp', false),"
    " set_config('plan_cache_mode', 'force_generic_plan', false), set_config('jit', 'off', false),"
    " set_config('tcp_keepalives_idle', '5', false), set_config('tcp_keepalives_interval', '1', false),"
    " set_config('tcp_keepalives_count', '3', false), set_config('client_connection_check_interval', '1s', "
    "false),"
    " CASE WHEN pg_is_in_recovery() THEN 0"
    " ELSE ('x' || left(pg_walfile_name(pg_current_wal_lsn()), 8))::bit(32)::int8 END,"
    " pg_backend_pid()::int8, (SELECT backend_start FROM pg_stat_activity WHERE pid = pg_backend_pid()),"
    " (SELECT has_schema_privilege(oid, 'USAGE')::text FROM pg_namespace WHERE nspname = $1)";
/* Before its first repair a schema did not say from which version on programs can work with it. */
static const char version_sql[] = "SELECT version::int8, coalesce((to_jsonb(m) ->> 'compatible_from')::int8, "
                                  "version), pg_backend_pid()::int8"
                                  " FROM migration m ORDER BY version DESC LIMIT 1";

/* The statements of the set-up: the version, then what is prepared, then the claims. */
enum { SETUP_VERSION, SETUP_PREPARE };

struct prepared {
    const char *name, *sql; /* NULL: the table has none of that kind */
};

static void prepared_of(enum apc_table table, struct prepared prepared[4])
{
    const struct apc_pg_text *t = &apc_pg_texts[table];
    prepared[0] = (struct prepared){t->read_name, t->read};
    prepared[1] = (struct prepared){t->append_name, t->append};
    prepared[2] = (struct prepared){t->plain_name, t->plain};
    prepared[3] = (struct prepared){t->place_name, t->place};
}

static int count_prepared(void)
{
    int n = 0;
    for (enum apc_table table = APC_SENSOR; table < APC_TABLE_END; table++) {
        struct prepared prepared[4];
        prepared_of(table, prepared);
        for (size_t i = 0; i < 4; i++) {
            n += prepared[i].sql != NULL;
        }
    }
    return n;
}

/*
 * Each promotion begins a timeline with a higher number. Where a standby was promoted and the former leader
 * still lives, that one takes writes as well, and who goes back to it makes a second record. With one server
 * there is none to choose: then it is another database, restored from a dump.
 */
static int take_timeline(struct apc_pg *pg, int64_t timeline)
{
    if (timeline > 0 && timeline < pg->timeline && rotate_hosts(pg)) {
        return apc_fail(&pg->base.why, APC_ECONN,
                        "the server at \"%s\" is a former leader, which another one has replaced (timeline "
                        "%lld, after %lld): stop it, and make it a standby of the new one (pg_rewind)",
                        PQhost(pg->conn), (long long)timeline, (long long)pg->timeline);
    }
    pg->timeline = timeline > 0 ? timeline : pg->timeline;
    return 0;
}

static int take_session(void *ctx, int statement, PGresult *result)
{
    struct apc_pg *pg = (struct apc_pg *)ctx;
    int column = PQnfields(result) - 1;
    (void)statement;
    if (PQntuples(result) != 1 || column < 3) {
        return apc_fail(&pg->base.why, APC_EPROTO, "the database did not answer what was asked");
    }
    const int err = take_timeline(pg, apc_pg_cell(result, 0, column - 3));
    if (err) {
        return err;
    }
    pg->session.pid = (int32_t)apc_pg_cell(result, 0, column - 2);
    pg->session.start = apc_pg_cell(result, 0, column - 1);
    if (PQgetisnull(result, 0, column)) {
        return apc_fail(&pg->base.why, APC_ESCHEMA,
                        "schema \"%s\" in database \"%s\" is missing: run apc init", pg->schema,
                        PQdb(pg->conn));
    }
    if (PQgetvalue(result, 0, column)[0] != 't') {
        return apc_fail(&pg->base.why, APC_EPERM,
                        "user %s may not use schema \"%s\": see sql/README.md, roles", PQuser(pg->conn),
                        pg->schema);
    }
    return 0;
}

int apc_pg_check_version(struct apc_pg *pg, int version, int compatible_from)
{
    if (compatible_from <= apc_store_version()) {
        return 0;
    }
    return apc_fail(&pg->base.why, APC_ESCHEMA,
                    "schema %s is version %d, for programs of version %d or newer; this library is of %d: "
                    "upgrade libapc",
                    pg->schema, version, compatible_from, apc_store_version());
}

static int take_version(struct apc_pg *pg, const PGresult *result)
{
    if (PQnfields(result) != 3) {
        return apc_fail(&pg->base.why, APC_EPROTO, "the database did not answer what was asked");
    }
    bool any = PQntuples(result) > 0;
    if (any && apc_pg_cell(result, 0, 2) != pg->session.pid) {
        return apc_pg_fail_pooled(pg);
    }
    pg->version = any ? (int)apc_pg_cell(result, 0, 0) : 0;
    if (pg->version < apc_store_version()) {
        return apc_fail(&pg->base.why, APC_ESCHEMA,
                        "schema %s is version %d, this library needs %d: run apc init", pg->schema,
                        pg->version, apc_store_version());
    }
    return apc_pg_check_version(pg, pg->version, (int)apc_pg_cell(result, 0, 1));
}

static int take_setup(void *ctx, int statement, PGresult *result)
{
    struct apc_pg *pg = (struct apc_pg *)ctx;
    if (statement == SETUP_VERSION) {
        return take_version(pg, result);
    }
    const bool claims = pg->claimed.n > 0 && statement == SETUP_PREPARE + count_prepared();
    return claims ? apc_pg_take_claims(pg, result) : 0;
}

static int begin_session(struct apc_pg *pg)
{
    if (!PQenterPipelineMode(pg->conn)) {
        return fail(pg, APC_ECONN, "cannot talk to the database", PQerrorMessage(pg->conn));
    }
    struct apc_pg_params p = {0};
    apc_pg_param_text(&p, pg->schema);
    int err = apc_pg_send(pg, session_sql, &p);
    return err ? err : apc_pg_finish(pg, take_session, pg);
}

static int set_up(struct apc_pg *pg)
{
    int err = apc_pg_send(pg, version_sql, &(struct apc_pg_params){0});
    for (enum apc_table table = APC_SENSOR; !err && table < APC_TABLE_END; table++) {
        struct prepared prepared[4];
        prepared_of(table, prepared);
        for (size_t i = 0; !err && i < 4; i++) {
            if (prepared[i].sql && !PQsendPrepare(pg->conn, prepared[i].name, prepared[i].sql, 0, NULL)) {
                err = not_queued(pg);
            }
        }
    }
    if (!err && pg->claimed.n > 0) {
        err = apc_pg_send_claims(pg);
    }
    return err ? err : apc_pg_finish(pg, take_setup, pg);
}

/* ---- Pauses ------------------------------------------------------------------------------- */

/* xorshift64: spreads clients apart, no more is asked of it. */
static uint64_t next_random(struct apc_pg *pg)
{
    pg->random ^= pg->random << 13;
    pg->random ^= pg->random >> 7;
    pg->random ^= pg->random << 17;
    return pg->random;
}

/* Half of the pause is certain, the other half random. */
static int connect_failed(struct apc_pg *pg, int err)
{
    const struct apc_store_config *config = &pg->base.config;
    apc_pg_drop(pg);
    apc_ns pause = config->backoff_min;
    for (unsigned i = 0; i < pg->failures && pause < config->backoff_max; i++) {
        pause = pause > config->backoff_max / 2 ? config->backoff_max : pause * 2;
    }
    pause = pause / 2 + (apc_ns)(next_random(pg) % (uint64_t)(pause / 2 + 1));
    pg->next_try = apc_clock_mono(NULL) + pause;
    pg->failures++;
    pg->failed = err;
    pg->failure = pg->base.why;
    return err;
}

/* What waits for people, not for the network, keeps its own error. */
static int pausing(struct apc_pg *pg, apc_ns left)
{
    long long tenths = (left + 99 * APC_NS_PER_MS) / (100 * APC_NS_PER_MS);
    int err = pg->failed == APC_ETIMEDOUT ? APC_ECONN : pg->failed;
    return apc_fail(&pg->base.why, err, "%.400s; next try in %lld.%lld s", pg->failure.text, tenths / 10,
                    tenths % 10);
}

int apc_pg_begin(struct apc_pg *pg)
{
    apc_ns now = apc_clock_mono(NULL);
    pg->deadline = now + pg->base.config.timeout;
    if (pg->conn && PQstatus(pg->conn) == CONNECTION_OK) {
        return 0;
    }
    apc_pg_drop(pg);
    if (now < pg->next_try) {
        return pausing(pg, pg->next_try - now);
    }
    int err = establish(pg);
    if (!err) {
        err = begin_session(pg);
    }
    if (!err) {
        err = apc_pg_look_for_pooler(pg);
    }
    if (!err) {
        err = apc_pg_end_former(pg);
    }
    if (!err) {
        err = set_up(pg);
    }
    if (err) {
        return connect_failed(pg, err);
    }
    pg->failures = 0;
    pg->failed = 0;
    pg->next_try = 0;
    pg->base.stats.connects++;
    return 0;
}

/* ---- For set-up --------------------------------------------------------------------------- */

int apc_pg_connect_bare(struct apc_pg *pg)
{
    apc_pg_drop(pg);
    pg->deadline = apc_clock_mono(NULL) + pg->base.config.timeout;
    int err = establish(pg);
    if (!err) {
        err = apc_pg_command(pg, "SELECT " SETTINGS, NULL);
    }
    if (err) {
        apc_pg_drop(pg);
    }
    return err;
}

int apc_pg_command(struct apc_pg *pg, const char *sql, PGresult **result)
{
    if (!PQsendQuery(pg->conn, sql)) {
        return not_queued(pg);
    }
    pg->base.stats.round_trips++;
    PGresult *last = NULL;
    int failed = 0;
    for (;;) {
        int err = await_result(pg);
        if (err) {
            PQclear(last);
            return err;
        }
        PGresult *r = PQgetResult(pg->conn);
        if (!r) {
            break;
        }
        PQclear(last);
        last = r;
        if (PQresultStatus(r) != PGRES_COMMAND_OK && PQresultStatus(r) != PGRES_TUPLES_OK && !failed) {
            failed = refused(pg, r);
        }
    }
    if (!failed && result) {
        *result = last;
        return 0;
    }
    PQclear(last);
    return failed;
}

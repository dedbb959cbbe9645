/* SPDX-License-Identifier: BSD-3-Clause */
/*
 * Connecting: the URI, a server of several, what a session needs, the version of the schema.
 *
 * What can block: the name service, inside PQconnectStart(). Give addresses (hostaddr=), not names,
 * where that matters.
 *
 * After a failed connect no other is tried until a pause is over; the pauses double up to a bound and
 * are jittered, so that the clients of a server that comes back do not all arrive at once.
 */
#include <ctype.h>
#include <poll.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "shareddata/postgresql/postgresql.h"

/* ---- The URI, and which of its hosts ------------------------------------------------------- */

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
        err = apc_fail(why, APC_EINVAL,
                       "malformed store URI: after postgresql: comes nothing, or //HOST/DATABASE");
    } else {
        pg->uri = PQconninfoParse(rest[0] ? text : "", &message);
        if (!pg->uri) { /* libpq's own text may quote a password */
            bool secret = strchr(text, '@') || strstr(text, "password");
            char flat[256];
            apc_pg_flatten(pg, flat, sizeof flat, message && !secret ? message : "libpq cannot read it");
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

/* ---- Reaching a server --------------------------------------------------------------------- */

#define OPTIONS_MAX 96

struct connect_params {
    const char *keywords[OPTIONS_MAX], *values[OPTIONS_MAX];
    int n;
};

static void add_connect_param(struct connect_params *c, const char *keyword, const char *value)
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
    add_connect_param(c, "application_name", pg->base.config.name);
    add_connect_param(c, "keepalives_idle", "5");
    add_connect_param(c, "keepalives_interval", "1");
    add_connect_param(c, "keepalives_count", "3");
    add_connect_param(c, "tcp_user_timeout", "8000");
    if (!getenv("PGTARGETSESSIONATTRS")) {
        add_connect_param(c, "target_session_attrs", "read-write");
    }
    for (const PQconninfoOption *o = pg->uri; o->keyword; o++) {
        add_connect_param(c, o->keyword, o->val);
    }
    for (size_t i = 0; i < 3; i++) {
        add_connect_param(c, host_keywords[i], pg->hosts[i][0] ? pg->hosts[i] : NULL);
    }
    add_connect_param(c, "client_encoding", "UTF8");
    c->keywords[c->n] = c->values[c->n] = NULL;
}

/* Where several servers are named, the one that leads may just have gone: that passes. */
static int not_established(struct apc_pg *pg)
{
    const char *text = PQerrorMessage(pg->conn);
    const bool standby = strstr(text, "session is read-only") != NULL;
    return apc_pg_fail(
        pg, APC_ECONN,
        standby ? "no server takes writes: a standby has not been promoted yet, only standbys are named, or "
                  "default_transaction_read_only is on for the database or the user"
                : "cannot connect to the database",
        text);
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
        int err = apc_pg_wait_socket(pg, state == PGRES_POLLING_READING ? POLLIN : POLLOUT);
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

/* ---- What a session needs ------------------------------------------------------------------ */

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
/* Versions count from the baseline. A schema that was made before it (pg_init.c) has none, and the first of
 * those had no column compatible_from. */
static const char version_sql[] =
    "SELECT version::int8, coalesce((to_jsonb(m) ->> 'compatible_from')::int8, version), "
    "pg_backend_pid()::int8 FROM migration m "
    "WHERE EXISTS (SELECT FROM migration WHERE name = '0001-baseline') ORDER BY version DESC LIMIT 1";

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
        return apc_pg_fail(pg, APC_ECONN, "cannot talk to the database", PQerrorMessage(pg->conn));
    }
    struct apc_pg_params p = {0};
    apc_pg_param_text(&p, pg->schema);
    int err = apc_pg_send(pg, session_sql, &p);
    return err ? err : apc_pg_finish(pg, take_session, pg);
}

static int set_up_session(struct apc_pg *pg)
{
    int err = apc_pg_send(pg, version_sql, &(struct apc_pg_params){0});
    for (enum apc_table table = APC_SENSOR; !err && table < APC_TABLE_END; table++) {
        struct prepared prepared[4];
        prepared_of(table, prepared);
        for (size_t i = 0; !err && i < 4; i++) {
            if (prepared[i].sql && !PQsendPrepare(pg->conn, prepared[i].name, prepared[i].sql, 0, NULL)) {
                err = apc_pg_not_queued(pg);
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
        err = set_up_session(pg);
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

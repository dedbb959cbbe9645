/* SPDX-License-Identifier: BSD-3-Clause */
/* The PostgreSQL store: what the plant is, and who writes what people write. */
#include <string.h>

#include "shareddata/postgresql/postgresql.h"

static int pg_catalogue_unexpected(struct apc_pg *pg)
{
    return apc_fail(&pg->base.why, APC_EPROTO, "the database did not answer what was asked");
}

/* ---- Authors -------------------------------------------------------------------------------- */

struct answer {
    struct apc_pg *pg;
    int64_t number;
    char *text; /* of so many bytes; NULL: none is asked for */
    size_t size, length;
    bool found;
};

/* The first row: a number of 8 bytes, then a text where one is asked for. */
static int take_answer(void *ctx, int statement, PGresult *result)
{
    struct answer *a = (struct answer *)ctx;
    (void)statement;
    if (PQnfields(result) != (a->text ? 2 : 1)) {
        return pg_catalogue_unexpected(a->pg);
    }
    a->found = PQntuples(result) > 0;
    if (!a->found) {
        return 0;
    }
    a->number = apc_pg_cell(result, 0, 0);
    if (a->text) {
        a->length = (size_t)PQgetlength(result, 0, 1);
        const size_t n = a->length < a->size ? a->length : a->size > 0 ? a->size - 1 : 0;
        memcpy(a->text, PQgetvalue(result, 0, 1), n);
        if (a->size > 0) {
            a->text[n] = '\0';
        }
    }
    return 0;
}

static int ask_catalogue(struct answer *a, const char *sql, const struct apc_pg_params *p)
{
    int err = apc_pg_begin(a->pg);
    if (!err) {
        err = apc_pg_send(a->pg, sql, p);
    }
    return err ? err : apc_pg_finish(a->pg, take_answer, a);
}

int apc_pg_author(struct apc_store *store, const char *name)
{
    struct answer a = {.pg = apc_pg_of(store)};
    struct apc_pg_params p = {0};
    apc_pg_param_text(&p, name);
    int err = ask_catalogue(&a, "SELECT author_number($1)", &p);
    return err                                                ? err
           : a.found && a.number > 0 && a.number <= INT32_MAX ? (int)a.number
                                                              : pg_catalogue_unexpected(a.pg);
}

int apc_pg_author_name(struct apc_store *store, uint32_t number, char name[APC_AUTHOR_LEN])
{
    struct answer a = {.pg = apc_pg_of(store), .text = name, .size = APC_AUTHOR_LEN};
    struct apc_pg_params p = {0};
    char bytes[8];
    apc_pg_put_int8(bytes, number);
    apc_pg_param(&p, bytes, sizeof bytes);
    int err = ask_catalogue(&a, "SELECT number, name FROM author WHERE number = $1::int8", &p);
    return err || a.found ? err : APC_ENOTFOUND;
}

/* ---- The catalogue -------------------------------------------------------------------------- */

/* Of the same kind as before; and none where nothing has changed. */
static const char describe_sql[] =
    "INSERT INTO catalogue (revision, kind, text) SELECT coalesce(max(revision), 0) + 1, "
    "coalesce((SELECT kind FROM catalogue ORDER BY revision DESC LIMIT 1), 'live'), $1 FROM catalogue "
    "HAVING $1 IS DISTINCT FROM (SELECT text FROM catalogue ORDER BY revision DESC LIMIT 1)";

int apc_pg_describe(struct apc_store *store, const struct apc_tag *tags, size_t n, const char *catalogue)
{
    struct apc_pg *pg = apc_pg_of(store);
    struct apc_pg_params p = {0};
    apc_pg_param_text(&p, catalogue);
    int err = apc_pg_begin(pg);
    if (!err) {
        err = apc_pg_send_tags(pg, tags, n);
    }
    if (!err && catalogue) {
        err = apc_pg_send(pg, describe_sql, &p);
    }
    return apc_pg_finish_insert(pg, err, (int)n);
}

/* Returns the length of the text in force, of which as much is given as fits; 0 and revision 0: there is
 * none.
 */
int apc_pg_catalogue_at(struct apc_store *store, apc_ns time, char *text, size_t size, int64_t *revision)
{
    char none[1], bytes[8];
    struct apc_pg_params p = {0};
    struct answer a = {.pg = apc_pg_of(store), .text = text ? text : none, .size = text ? size : 0};
    apc_pg_put_int8(bytes, time == INT64_MAX ? time : apc_pg_time(time));
    apc_pg_param(&p, bytes, sizeof bytes);
    int err =
        ask_catalogue(&a,
                      "SELECT revision, text FROM catalogue "
                      "ORDER BY CASE WHEN time <= $1::timestamptz THEN -revision ELSE revision END LIMIT 1",
                      &p);
    if (err) {
        return err;
    }
    *revision = a.found ? a.number : 0;
    return a.length <= INT32_MAX ? (int)a.length : pg_catalogue_unexpected(a.pg);
}

int apc_pg_catalogue(struct apc_store *store, char *text, size_t size, int64_t *revision)
{
    return apc_pg_catalogue_at(store, INT64_MAX, text, size, revision);
}

/* ---- A history, and what is asked of it ----------------------------------------------------- */

int apc_pg_is_history(struct apc_store *store)
{
    char kind[16] = "";
    struct answer a = {.pg = apc_pg_of(store), .text = kind, .size = sizeof kind};
    const int err = ask_catalogue(&a, "SELECT revision, kind FROM catalogue ORDER BY revision DESC LIMIT 1",
                                  &(struct apc_pg_params){0});
    return err ? err : strcmp(kind, "history") == 0;
}

int apc_pg_keep_history(struct apc_store *store)
{
    struct answer a = {.pg = apc_pg_of(store)};
    const int err = ask_catalogue(
        &a,
        "INSERT INTO catalogue (revision, kind, text) SELECT revision + 1, 'history', text FROM "
        "(SELECT revision, kind, text FROM catalogue ORDER BY revision DESC LIMIT 1) newest "
        "WHERE kind <> 'history' RETURNING revision",
        &(struct apc_pg_params){0});
    return err ? err : a.found;
}

int apc_pg_ask(struct apc_store *store, struct apc_request *request)
{
    struct answer a = {.pg = apc_pg_of(store)};
    struct apc_pg_params p = {0};
    char bytes[2][8];
    apc_pg_put_int8(bytes[0], request->variable);
    apc_pg_put_float8(bytes[1], request->value);
    apc_pg_param(&p, bytes[0], 8);
    apc_pg_param(&p, bytes[1], 8);
    apc_pg_param_text(&p, apc_table_name(request->table));
    apc_pg_param_text(&p, request->author);
    apc_pg_param_text(&p, request->reason);
    const int err = ask_catalogue(&a,
                                  "INSERT INTO request (table_name, variable, value, author, reason) VALUES "
                                  "($3, ($1::int8)::int4, $2::float8, $4, $5) RETURNING id",
                                  &p);
    request->id = err ? 0 : a.number;
    return err || a.found ? err : pg_catalogue_unexpected(a.pg);
}

int apc_pg_asked(struct apc_store *store, int64_t id, char *outcome, size_t size)
{
    struct answer a = {.pg = apc_pg_of(store), .text = outcome, .size = size};
    struct apc_pg_params p = {0};
    char bytes[8];
    apc_pg_put_int8(bytes, id);
    apc_pg_param(&p, bytes, sizeof bytes);
    const int err =
        ask_catalogue(&a, "SELECT id, outcome FROM request WHERE id = $1::int8 AND outcome IS NOT NULL", &p);
    return err ? err : a.found;
}

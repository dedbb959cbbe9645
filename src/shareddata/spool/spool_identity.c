/* SPDX-License-Identifier: BSD-3-Clause */
/* Which store a spool is for: a name that stays the same when a password changes, and tells none. */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "shareddata/spool/spool.h"

static void add_to_identity(char *text, size_t size, const char *more, size_t n)
{
    size_t used = strlen(text);
    snprintf(text + used, size - used, "%.*s", (int)n, more);
}

/* Of ?NAME=VALUE&... only what says where the database is. */
static void add_query(char *text, size_t size, const char *query, size_t n)
{
    static const char *const names[] = {"host=", "hostaddr=", "port=", "dbname=", "service="};
    for (const char *at = query, *end = query + n; at < end;) {
        size_t length = strcspn(at, "&#");
        for (size_t i = 0; i < sizeof names / sizeof *names; i++) {
            if (strncmp(at, names[i], strlen(names[i])) == 0) {
                add_to_identity(text, size, " ", 1);
                add_to_identity(text, size, at, length);
            }
        }
        at += length + 1;
    }
}

void apc_spool_identity(const char *uri, char *text, size_t size)
{
    static const char *const environment[] = {"PGSERVICE", "PGHOST", "PGPORT", "PGDATABASE"};
    const char *authority = strstr(uri, "://"), *rest = authority ? authority + 3 : uri;
    size_t host = strcspn(rest, "/?#");
    text[0] = '\0';
    add_to_identity(text, size, uri, (size_t)(rest - uri));
    for (size_t i = host; i > 0 && authority; i--) { /* user:password@ */
        if (rest[i - 1] == '@') {
            rest += i;
            break;
        }
    }
    size_t query = strcspn(rest, "?"), hash = strcspn(rest, "#");
    add_to_identity(text, size, rest, query < hash ? query : hash);
    if (query < hash) {
        add_query(text, size, rest + query + 1, hash - query - 1);
    }
    add_to_identity(text, size, rest + hash, strlen(rest + hash));
    for (size_t i = 0; strncmp(uri, "postgres", 8) == 0 && i < sizeof environment / sizeof *environment;
         i++) {
        const char *value = getenv(environment[i]);
        if (value && value[0]) {
            add_to_identity(text, size, " ", 1);
            add_to_identity(text, size, environment[i], strlen(environment[i]));
            add_to_identity(text, size, "=", 1);
            add_to_identity(text, size, value, strlen(value));
        }
    }
}

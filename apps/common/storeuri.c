/* SPDX-License-Identifier: BSD-3-Clause */
#include "storeuri.h"

#include <stdbool.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

int store_open(struct apc_store **store, const char *uri, const struct apc_store_options *options,
               struct apc_error *why)
{
    if (strncmp(uri, "mem:", 4) == 0)
        return apc_fail(why, APC_EINVAL,
                        "\"%.40s\" is the memory of one process, which ends with it and which no other sees: "
                        "expected postgresql:, sqlite:FILE or shm:NAME",
                        uri);
    return apc_store_open(store, uri, options, why);
}

const char *store_live(const char *uri, char room[256])
{
    const size_t n = apc_store_live(uri);
    snprintf(room, 256, "%.*s", (int)n, uri);
    return uri[n] ? room : uri;
}

/* ---- For people --------------------------------------------------------------------------- */

static void add(char *out, size_t size, const char *text, size_t n)
{
    size_t used = strlen(out);
    snprintf(out + used, size - used, "%.*s", (int)n, text);
}

static bool is_public(const char *parameter, size_t n)
{
    static const char *const names[] = {"host", "hostaddr", "port", "dbname", "user", "service", "sslmode"};
    for (size_t i = 0; i < sizeof names / sizeof *names; i++)
        if (n == strlen(names[i]) && !strncmp(parameter, names[i], n))
            return true;
    return false;
}

/* ?NAME=VALUE&...: only values that are known to be no secret are shown. Returns what comes after it. */
static const char *mask_query(const char *query, char *out, size_t size)
{
    while (*query == '?' || *query == '&') {
        size_t name = 1 + strcspn(query + 1, "=&#"), length = 1 + strcspn(query + 1, "&#");
        bool open = name == length || is_public(query + 1, name - 1);
        add(out, size, query, open ? length : name);
        if (!open)
            add(out, size, "=***", 4);
        query += length;
    }
    return query;
}

/* The URI without its passwords. What is between the first ':' and the last '@' is taken for one: rather
 * too much than too little. */
static void mask(const char *uri, char *out, size_t size)
{
    const char *scheme = strstr(uri, "://"), *rest = scheme ? scheme + 3 : uri;
    const char *at = strrchr(rest, '@'), *colon = strchr(rest, ':');
    *out = '\0';
    if (at && colon && colon < at) {
        add(out, size, uri, (size_t)(colon - uri) + 1);
        add(out, size, "***", 3);
        uri = at;
    }
    size_t head = strcspn(uri, "?");
    add(out, size, uri, head);
    uri = mask_query(uri + head, out, size);
    add(out, size, uri, strlen(uri));
}

/* "postgresql:" says nothing of where: the environment does. */
static void add_environment(const char *uri, char *out, size_t size)
{
    static const char *const names[] = {"PGSERVICE", "PGHOST", "PGPORT", "PGDATABASE", "PGUSER"};
    bool any = false;
    if (strncmp(uri, "postgresql:", 11) != 0 || (uri[11] && uri[11] != '#'))
        return;
    for (size_t i = 0; i < sizeof names / sizeof *names; i++) {
        const char *value = getenv(names[i]);
        if (!value || !*value)
            continue;
        size_t used = strlen(out);
        snprintf(out + used, size - used, "%s%s=%s", any ? " " : " (", names[i], value);
        any = true;
    }
    if (any)
        add(out, size, ")", 1);
}

void store_name(const char *uri, char *name, size_t size)
{
    mask(uri, name, size);
    add_environment(uri, name, size);
}

/* SPDX-License-Identifier: BSD-3-Clause */
#include "storeuri.h"

#include <stdbool.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>

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

/* Who simulates has its first measurement for as long as he does. */
int store_simulated(struct apc_store *store, struct apc_store_clock *clock, struct apc_error *why)
{
    const struct apc_sample first = {.table = APC_SENSOR, .id = 1};
    uint64_t holder = 0;
    *clock = (struct apc_store_clock){.size = sizeof *clock};
    const int simulated = apc_store_clock(store, clock);
    const int rc = simulated > 0 ? apc_store_holder(store, &first, &holder) : simulated;
    if (rc < 0)
        return apc_fail(why, rc, "%s", apc_store_error(store));
    if (simulated > 0 && holder == 0)
        return apc_fail(why, APC_ESTATE,
                        "nobody simulates the plant any more: its `apc run --speed` was ended, and its time "
                        "stands still");
    return simulated == 0 || clock->reached >= 0 ? simulated : apc_fail(why, APC_ESTATE, STORE_BEGINS);
}

bool store_follow(const char *uri)
{
    struct apc_store *store = NULL;
    struct apc_store_clock clock = {.now = 0};
    struct apc_error why;
    if (strncmp(uri, "shm:", 4) == 0 && apc_store_open(&store, uri, NULL, NULL) == 0 &&
        (store_simulated(store, &clock, &why) > 0 || clock.reached < 0))
        (void)apc_store_follow(store);
    apc_store_close(store);
    return clock.now != 0;
}

bool store_is_uri(const char *text)
{
    struct stat what;

    return text[strcspn(text, ":/")] == ':' && stat(text, &what) != 0;
}

const char *store_live(const char *uri, char room[256])
{
    const size_t n = apc_store_live(uri);
    snprintf(room, 256, "%.*s", (int)n, uri);
    return uri[n] ? room : uri;
}

/* ---- For people --------------------------------------------------------------------------- */

static void add_uri_text(char *out, size_t size, const char *text, size_t n)
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

#define LETTERS  "abcdefghijklmnopqrstuvwxyzABCDEFGHIJKLMNOPQRSTUVWXYZ0123456789_"
#define UNQUOTED LETTERS ".-~%"

/* Either the first @p n bytes, as they are what belongs there, or that there is something. */
static void show_uri_part(char *out, size_t size, const char *text, size_t n, bool good)
{
    add_uri_text(out, size, good ? text : "***", good ? n : 3);
}

static bool is_made_of(const char *text, size_t n, const char *accepted)
{
    return strspn(text, accepted) >= n;
}

/* ?NAME=VALUE&...: only values that are known to be no secret are shown. Returns what comes after it. */
static const char *mask_query(const char *query, char *out, size_t size)
{
    while (*query == '?' || *query == '&') {
        const size_t name = 1 + strcspn(query + 1, "=&#"), length = 1 + strcspn(query + 1, "&#");
        const bool value = name < length,
                   open = value && is_public(query + 1, name - 1) &&
                          is_made_of(query + name + 1, length - name - 1, UNQUOTED "/,:");
        add_uri_text(out, size, query, 1);
        show_uri_part(out, size, query + 1, name - 1, value || length == 1);
        add_uri_text(out, size, "=", value);
        if (value)
            show_uri_part(out, size, query + name + 1, length - name - 1, open);
        query += length;
    }
    return query;
}

/* HOST[:PORT],...; a port that is no number may be a password whose @ is missing. */
static bool is_hosts(const char *text, size_t n)
{
    bool good = is_made_of(text, n, UNQUOTED "[]:,"), bracket = false;
    for (size_t i = 0; i < n && good; i++) {
        bracket = text[i] == '[' || (bracket && text[i] != ']');
        if (text[i] == ':' && !bracket) {
            const size_t digits = strspn(text + i + 1, "0123456789");
            good = i + 1 + digits == n || text[i + 1 + digits] == ',';
        }
    }
    return good;
}

/*
 * A URI of PostgreSQL without its passwords. What is between the first ':' and the last '@' is taken for one:
 * rather too much than too little. So is all that a URI cannot have where it stands: such a one is malformed,
 * and a part of a password may be anywhere.
 */
static void mask_database(const char *rest, char *out, size_t size)
{
    const char *at = strrchr(rest, '@');
    size_t n;
    if (strncmp(rest, "//", 2) == 0) {
        add_uri_text(out, size, rest, 2);
        rest += 2;
        n = at ? strcspn(rest, ":@/?#") : 0;
        if (at) {
            show_uri_part(out, size, rest, n, rest[n] == ':' || rest[n] == '@');
            add_uri_text(out, size, ":***@", rest + n == at ? 0 : 4);
            add_uri_text(out, size, at, 1);
            rest = at + 1;
        }
        n = strcspn(rest, "/?#");
        show_uri_part(out, size, rest, n, is_hosts(rest, n));
        rest += n;
        n = strcspn(rest, "?#");
        show_uri_part(out, size, rest, n, n == 0 || is_made_of(rest + 1, n - 1, UNQUOTED));
        rest = mask_query(rest + n, out, size);
    }
    n = strlen(rest);
    show_uri_part(out, size, rest, n, n == 0 || (*rest == '#' && is_made_of(rest + 1, n - 1, LETTERS)));
}

static void mask(const char *uri, char *out, size_t size)
{
    static const char *const plain[] = {"sqlite:", "shm:", "mem:"};
    const size_t scheme = strncmp(uri, "postgresql:", 11) == 0 ? 11
                          : strncmp(uri, "postgres:", 9) == 0  ? 9
                                                               : 0;
    bool known = *uri == '\0';
    for (size_t i = 0; i < sizeof plain / sizeof *plain; i++)
        known |= strncmp(uri, plain[i], strlen(plain[i])) == 0;
    if (scheme == 0) {
        show_uri_part(out, size, uri, strlen(uri), known);
        return;
    }
    add_uri_text(out, size, uri, scheme);
    mask_database(uri + scheme, out, size);
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
        add_uri_text(out, size, ")", 1);
}

void store_name(const char *uri, char *name, size_t size)
{
    char room[256];
    const char *const live = store_live(uri, room);

    *name = '\0';
    mask(live, name, size);
    if (live != uri) {
        const char *const history = uri + strlen(live) + 1;
        add_uri_text(name, size, "+", 1);
        mask(history, name, size);
    }
    add_environment(uri, name, size);
}

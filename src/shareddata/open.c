/* SPDX-License-Identifier: BSD-3-Clause */
/* Which stores there are, and how one is opened: alone, before its history, behind a spool. */
#include <stdio.h>
#include <string.h>

#include "base/base_internal.h"
#include "shareddata/history/federated.h"
#include "shareddata/shareddata_internal.h"
#include "shareddata/spool/spool.h"

static const struct apc_store_ops *const stores[] = {&apc_postgresql_store, &apc_postgres_store,
                                                     &apc_sqlite_store, &apc_shm_store, &apc_mem_store};

#define SPOOL_SIZE ((uint64_t)256 << 20)

static int make_config(struct apc_store_config *config, struct apc_store_options o, struct apc_error *why)
{
    if (o.timeout < 0 || o.backoff_min < 0 || o.backoff_max < 0) {
        return apc_fail(why, APC_EINVAL, "a store's timeout and pauses must not be negative");
    }
    *config = (struct apc_store_config){
        .timeout = o.timeout ? o.timeout : 2 * APC_NS_PER_S,
        .backoff_min = o.backoff_min ? o.backoff_min : 100 * APC_NS_PER_MS,
        .backoff_max = o.backoff_max ? o.backoff_max : 5 * APC_NS_PER_S,
        .chunks = o.chunks,
        .spool_or_memory = o.spool_or_memory,
    };
    if (config->backoff_max < config->backoff_min) {
        return apc_fail(why, APC_EINVAL, "the longest pause between connects is shorter than the first one");
    }
    snprintf(config->name, sizeof config->name, "%s", o.name && o.name[0] ? o.name : "libapc");
    return 0;
}

static int open_plain(struct apc_store **store, const char *uri, const struct apc_store_config *config,
                      struct apc_error *why)
{
    for (size_t i = 0; i < sizeof stores / sizeof stores[0]; i++) {
        if (strncmp(uri, stores[i]->scheme, strlen(stores[i]->scheme)) == 0) {
            return stores[i]->open(store, uri, config, why);
        }
    }
    /* The URI may hold a password: only what must be its scheme is shown. */
    size_t scheme = strcspn(uri, ":/@");
    bool shown = scheme < 32 && uri[scheme] == ':';
    return apc_fail(why, APC_EINVAL,
                    "%s%.*s%s: expected postgresql:, postgresql://..., sqlite:FILE, shm:NAME or mem:NAME",
                    shown ? "unknown store \"" : "the name of a store does not begin with its kind",
                    shown ? (int)scheme + 1 : 0, uri, shown ? "\"" : "");
}

/* LIVE+HISTORY: the live one is memory. */
static int open_live_and_history(struct apc_store **store, const char *uri, size_t live_length,
                                 const struct apc_store_config *config, struct apc_error *why)
{
    char live_uri[256];
    struct apc_store *live = NULL, *history = NULL;
    if (live_length >= sizeof live_uri) {
        return apc_fail(why, APC_EINVAL, "the live store's name before '+' is too long");
    }
    snprintf(live_uri, sizeof live_uri, "%.*s", (int)live_length, uri);
    int err = open_plain(&live, live_uri, config, why);
    if (!err && (err = open_plain(&history, uri + live_length + 1, config, why)) != 0) {
        apc_store_close(live);
    }
    return err ? err : apc_federated_wrap(store, live, history, why);
}

size_t apc_store_live(const char *uri)
{
    const bool memory = strncmp(uri, "shm:", 4) == 0 || strncmp(uri, "mem:", 4) == 0;
    return memory ? strcspn(uri, "+") : strlen(uri);
}

int apc_store_open(struct apc_store **store, const char *uri, const struct apc_store_options *options,
                   struct apc_error *why)
{
    if (!store) {
        return apc_fail(why, APC_EINVAL, "nowhere to put the store");
    }
    *store = NULL;
    if (!uri) {
        return apc_fail(why, APC_EINVAL, "no store URI given; the simplest is sqlite:FILE");
    }
    struct apc_store_config config;
    struct apc_store_options o = {0};
    int err = apc_options_copy(&o, sizeof o, options, "apc_store_options", why);
    if (!err) {
        err = make_config(&config, o, why);
    }
    if (err) {
        return err;
    }
    const size_t live = apc_store_live(uri);
    struct apc_store *plain = NULL;
    err = uri[live] ? open_live_and_history(&plain, uri, live, &config, why)
                    : open_plain(&plain, uri, &config, why);
    if (!err && o.spool) {
        return apc_spool_wrap(store, plain, uri, o.spool, o.spool_size ? o.spool_size : SPOOL_SIZE, why);
    }
    *store = plain;
    return err;
}

/* SPDX-License-Identifier: BSD-3-Clause */
/* The PostgreSQL store: its life, and its operations by name. */
#include <stdlib.h>

#include "shareddata/postgresql/postgresql.h"

/* ---- Life ---------------------------------------------------------------------------------- */

static void pg_close(struct apc_store *store)
{
    struct apc_pg *pg = apc_pg_of(store);
    apc_pg_close_waiter(pg);
    apc_pg_drop(pg);
    PQconninfoFree(pg->uri);
    for (size_t i = 0; i < sizeof pg->columns / sizeof pg->columns[0]; i++) {
        free(pg->columns[i].data);
    }
    free(pg->places);
    apc_pg_free_chunks(pg->chunks);
    free(pg->claimed.at);
    free(pg);
}

static int pg_open(struct apc_store **store, const char *uri, const struct apc_store_config *config,
                   struct apc_error *why)
{
    struct apc_pg *pg = (struct apc_pg *)calloc(1, sizeof *pg);
    if (!pg) {
        return apc_fail(why, APC_ENOMEM, "out of memory");
    }
    pg->base.ops = &apc_postgresql_store;
    pg->base.config = *config;
    pg->random = ((uint64_t)apc_clock_mono(NULL) ^ (uint64_t)(uintptr_t)pg) | 1;
    int err = apc_pg_parse_uri(pg, uri, why);
    if (err) {
        pg_close(&pg->base);
        return err;
    }
    *store = &pg->base;
    return 0;
}

static bool pg_connected(const struct apc_store *store)
{
    const struct apc_pg *pg = (const struct apc_pg *)store;
    return pg->conn && PQstatus(pg->conn) == CONNECTION_OK;
}

static int pg_version(const struct apc_store *store)
{
    return ((const struct apc_pg *)store)->version;
}

static int pg_connect(struct apc_store *store)
{
    return apc_pg_begin(apc_pg_of(store));
}

#define OPS(word)                                                                                            \
    {                                                                                                        \
        .scheme = word, .spreads = true, .open = pg_open, .close = pg_close, .connected = pg_connected,      \
        .connect = pg_connect, .version = pg_version, .read = apc_pg_read, .append = apc_pg_append,          \
        .put = apc_pg_put, .swap = apc_pg_swap, .wait = apc_pg_wait, .variables = apc_pg_variables,          \
        .history = apc_pg_history, .history_bins = apc_pg_history_bins,                                      \
        .newest_within = apc_pg_newest_within, .get_tags = apc_pg_get_tags,                                  \
        .append_events = apc_pg_append_events, .events = apc_pg_events,                                      \
        .append_timing = apc_pg_append_timing, .timing = apc_pg_timing, .read_rows = apc_pg_read_rows,       \
        .append_rows = apc_pg_append_rows, .vectors = apc_pg_vectors, .claim_set = apc_pg_claim_set,         \
        .release = apc_pg_release, .holder = apc_pg_holder, .seize = apc_pg_seize, .author = apc_pg_author,  \
        .author_name = apc_pg_author_name, .describe = apc_pg_describe, .catalogue = apc_pg_catalogue,       \
        .catalogue_at = apc_pg_catalogue_at, .init = apc_pg_init, .maintain = apc_pg_maintain,               \
        .requests = apc_pg_requests, .answer = apc_pg_answer, .keep_history = apc_pg_keep_history,           \
        .is_history = apc_pg_is_history, .ask = apc_pg_ask, .asked = apc_pg_asked, .plants = apc_pg_plants,  \
    }

const struct apc_store_ops apc_postgresql_store = OPS("postgresql:");
const struct apc_store_ops apc_postgres_store = OPS("postgres:");

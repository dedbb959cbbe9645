/* SPDX-License-Identifier: BSD-3-Clause */
/* For tests of the PostgreSQL store: one database, in it a schema of its own for each test. */
#ifndef APC_TEST_PLANTS_H
#define APC_TEST_PLANTS_H

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "apcstore.h"
#include "check.h"
#include "cluster.h"

static struct cluster *cluster;
static int plant; /* a schema for each test */

#define ok(store, call)                                                                                      \
    do {                                                                                                     \
        int ok_result = (call);                                                                              \
        if (ok_result < 0) {                                                                                 \
            fail_msg("%s: %s: %s", #call, apc_err_name(ok_result), apc_store_error(store));                  \
        }                                                                                                    \
    } while (0)

#define assert_says(store, words)                                                                            \
    do {                                                                                                     \
        if (!strstr(apc_store_error(store), words)) {                                                        \
            fail_msg("expected \"%s\" in \"%s\"", words, apc_store_error(store));                            \
        }                                                                                                    \
        assert_null(strchr(apc_store_error(store), '\n'));                                                   \
    } while (0)

/* Short where the test waits for it, never in the way where it does not. */
#define LONG  (30 * APC_NS_PER_S)
#define SHORT (300 * APC_NS_PER_MS)

static inline struct apc_store *open_uri(const char *uri, apc_ns timeout)
{
    struct apc_error why = {""};
    struct apc_store *store = NULL;
    struct apc_store_options options = {
        .size = sizeof options, .name = "test", .timeout = timeout, .backoff_min = 1, .backoff_max = 1};
    if (apc_store_open(&store, uri, &options, &why) != 0) {
        fail_msg("%s", why.text);
    }
    return store;
}

static inline struct apc_store *open_direct(apc_ns timeout)
{
    char uri[600];
    snprintf(uri, sizeof uri, "%s#plant%d", cluster_uri(cluster), plant);
    return open_uri(uri, timeout);
}

static inline int set_up(void **state)
{
    (void)state;
    plant++;
    struct apc_store *store = open_direct(LONG);
    int had = apc_store_init(store);
    apc_store_close(store);
    return had != 0;
}

static inline struct apc_sample sample(enum apc_table table, int id, int64_t seq, double value)
{
    return (struct apc_sample){
        .table = table, .id = id, .seq = seq, .time = seq * APC_NS_PER_US, .value = value};
}

static inline struct apc_sample newest(struct apc_store *store, enum apc_table table, int id)
{
    struct apc_sample s = {.table = table, .id = id};
    ok(store, apc_store_read(store, &s, 1));
    return s;
}

/* Until the pause after a failed connect is over: the store itself says when; and for as long as a machine
 * that stalls takes longer than a short timeout. */
static inline int append_again(struct apc_store *store, const struct apc_sample *s, size_t n)
{
    int result = APC_ECONN;
    for (int i = 0; i < 100000 && (result == APC_ECONN || result == APC_EBUSY || result == APC_ETIMEDOUT);
         i++) {
        result = apc_store_append(store, s, n);
    }
    return result;
}

/* The same for a connection. */
static inline void connect_again(struct apc_store *store)
{
    while (apc_store_connect(store) != 0) { /* or until the test runs out of time */
    }
}

static inline void terminate(struct cluster *c, const char *application)
{
    char sql[200];
    snprintf(sql, sizeof sql,
             "SELECT count(pg_terminate_backend(pid, 20000)) FROM pg_stat_activity WHERE application_name = "
             "'%s' AND "
             "datname = current_database()",
             application);
    assert_string_equal(cluster_query(c, sql), "1");
}

#endif

/* SPDX-License-Identifier: BSD-3-Clause */
/* A writer with a spool, before a server that can be away. */
#ifndef APC_TEST_SPOOL_RIG_H
#define APC_TEST_SPOOL_RIG_H

#include <fcntl.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "apcmodules.h"
#include "apcstore.h"
#include "check.h"
#include "shareddata/spool/spool.h"

#define LONG (30 * APC_NS_PER_S)
#define T0   (INT64_C(1700000000) * APC_NS_PER_S)

static int plant;         /* a schema for each test */
static char folder[256];  /* of this test: the spool and the proxy's socket */
static char spool[300];   /* folder/writer.spool */
static char nowhere[400]; /* the URI of a server that is not there */

#define ok(store, call)                                                                                      \
    do {                                                                                                     \
        int ok_result = (call);                                                                              \
        if (ok_result < 0) {                                                                                 \
            fail_msg("%s: %s: %s", #call, apc_err_name(ok_result), apc_store_error(store));                  \
        }                                                                                                    \
    } while (0)

#define assert_says(text, words)                                                                             \
    do {                                                                                                     \
        if (!strstr(text, words)) {                                                                          \
            fail_msg("expected \"%s\" in \"%s\"", words, text);                                              \
        }                                                                                                    \
        assert_null(strchr(text, '\n'));                                                                     \
    } while (0)

/* No pauses: every call asks the store. */
static struct apc_store_options options(void)
{
    return (struct apc_store_options){.size = sizeof(struct apc_store_options),
                                      .name = "writer",
                                      .timeout = LONG,
                                      .backoff_min = 1,
                                      .backoff_max = 1,
                                      .spool = spool};
}

static struct apc_store *open_with(const char *uri, const struct apc_store_options *o)
{
    struct apc_error why = {""};
    struct apc_store *store = NULL;
    if (apc_store_open(&store, uri, o, &why) != 0) {
        fail_msg("%s", why.text);
    }
    return store;
}

static struct apc_store *open_spooled(const char *uri)
{
    struct apc_store_options o = options();
    return open_with(uri, &o);
}

static int set_up(void **state)
{
    (void)state;
    plant++;
    snprintf(folder, sizeof folder, "/tmp/apc-spool.XXXXXX");
    if (!mkdtemp(folder)) {
        return 1;
    }
    snprintf(spool, sizeof spool, "%s/writer.spool", folder);
    snprintf(nowhere, sizeof nowhere, "postgresql://apc:secret@/none?host=%s", folder);
    return 0;
}

static int clear_folder(void **state)
{
    char command[300];
    (void)state;
    snprintf(command, sizeof command, "rm -rf %s", folder);
    return system(command);
}

static struct apc_sample sample(int id, int64_t seq, double value)
{
    return (struct apc_sample){
        .table = APC_SENSOR, .id = id, .seq = seq, .time = T0 + seq * APC_NS_PER_MS, .value = value};
}

static void append(struct apc_store *store, int id, int64_t seq)
{
    struct apc_sample s = sample(id, seq, (double)(seq * 10 + id));
    int rc = apc_store_append(store, &s, 1);
    ok(store, rc);
    assert_int_equal(rc, 1);
}

static struct apc_spool_stats stats_of(const struct apc_store *store)
{
    struct apc_store_stats stats = {.size = sizeof stats};
    apc_store_stats(store, &stats);
    return stats.spool;
}

static void drain(struct apc_store *store)
{
    for (int i = 0; i < 100000 && stats_of(store).bytes > 0; i++) {
        (void)apc_store_connect(store);
    }
    if (stats_of(store).bytes > 0) {
        fail_msg("not drained: %s", apc_store_error(store));
    }
}

static void assert_refused(const char *uri, const struct apc_store_options *o, int err, const char *words)
{
    struct apc_error why = {""};
    struct apc_store *store = NULL;
    assert_int_equal(apc_store_open(&store, uri, o, &why), err);
    assert_null(store);
    assert_says(why.text, words);
}

#endif

/* SPDX-License-Identifier: BSD-3-Clause */
/* A new store joins by a line in store_kinds[]. */
#include <stdatomic.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "cluster.h"
#include "scratch.h"
#include "stores.h"

static struct cluster *cluster;

static void postgresql_uri(char *text, size_t size, int number)
{
    if (!cluster) {
        cluster = cluster_start();
    }
    snprintf(text, size, "%s#plant%d", cluster_uri(cluster), number);
}

static void sqlite_uri(char *text, size_t size, int number)
{
    snprintf(text, size, "sqlite:%s/plant%d.db", scratch_folder(), number);
}

static void mem_uri(char *text, size_t size, int number)
{
    snprintf(text, size, "mem:plant%d", number);
}

/* A container's /dev/shm may have no more than 64 MiB. */
static void shm_uri(char *text, size_t size, int number)
{
    snprintf(text, size, "shm:test-%d-%d?size=16", (int)getpid(), number);
}

static void shm_remove(int number)
{
    char path[64];
    snprintf(path, sizeof path, "/dev/shm/apc.test-%d-%d", (int)getpid(), number);
    unlink(path);
}

static const struct store_kind store_kinds[] = {{"postgresql:", postgresql_uri, NULL, false},
                                                {"sqlite:", sqlite_uri, NULL, false},
                                                {"mem:", mem_uri, NULL, false},
                                                {"shm:", shm_uri, shm_remove, false},
                                                {"sqlite: with a spool", sqlite_uri, NULL, true}};

const struct store_kind *store_kind;
char store_uri[512];

bool stores_next(void)
{
    static size_t next;
    const char *only = getenv("APC_TEST_STORE");
    while (next < sizeof store_kinds / sizeof store_kinds[0]) {
        store_kind = &store_kinds[next++];
        if (!only || strncmp(store_kind->name, only, strlen(only)) == 0) {
            return true;
        }
    }
    return false;
}

struct apc_store *stores_open(void)
{
    struct apc_error why = {""};
    struct apc_store *store = NULL;
    static atomic_int spools;
    char spool[300];
    snprintf(spool, sizeof spool, "%s/%d.spool", scratch_folder(), atomic_fetch_add(&spools, 1));
    struct apc_store_options options = {.size = sizeof options,
                                        .name = "test",
                                        .timeout = 20 * APC_NS_PER_S,
                                        .spool = store_kind->spooled ? spool : NULL};
    if (apc_store_open(&store, store_uri, &options, &why) != 0) {
        fail_msg("%s", why.text);
    }
    return store;
}

static int number, removed; /* so many stores were made, and so many of them removed */

int stores_set_up(void **state)
{
    store_kind->uri(store_uri, sizeof store_uri, ++number);
    struct apc_store *store = stores_open();
    int had = apc_store_init(store);
    if (had != 0) {
        fprintf(stderr, "%s\n", apc_store_error(store));
    }
    *state = store;
    return had != 0;
}

int stores_tear_down(void **state)
{
    apc_store_close(*state);
    while (store_kind->remove && removed < number) {
        store_kind->remove(++removed);
    }
    return 0;
}

struct apc_sample sample(enum apc_table table, int id, int64_t seq, double value)
{
    return (struct apc_sample){
        .table = table, .id = id, .seq = seq, .time = 1000 * seq * APC_NS_PER_US, .value = value};
}

struct apc_sample newest(struct apc_store *store, enum apc_table table, int id)
{
    struct apc_sample s = {.table = table, .id = id};
    ok(store, apc_store_read(store, &s, 1));
    return s;
}

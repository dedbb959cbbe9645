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

/* Names of all tables, indices and sequences of a plant, as one word. */
static const char *postgresql_names(int number)
{
    char sql[200];
    snprintf(sql, sizeof sql,
             "SELECT md5(string_agg(relname, ' ' ORDER BY relname)) FROM pg_class WHERE relnamespace = "
             "'plant%d'::regnamespace",
             number);
    return cluster_query(cluster, sql);
}

static char as_made[64];

static void postgresql_made(int number)
{
    if (!as_made[0]) {
        snprintf(as_made, sizeof as_made, "%s", postgresql_names(number));
    }
}

/* Tables take most of a second to make, and next to nothing to empty, once nobody is connected any more. A
 * test that has made or dropped some keeps them for itself. */
static bool postgresql_empty(int number)
{
    char sql[500];
    if (strcmp(postgresql_names(number), as_made) != 0 ||
        !cluster_await(cluster,
                       "SELECT count(*) FROM pg_stat_activity WHERE datname = current_database() AND pid <> "
                       "pg_backend_pid() AND backend_type = 'client backend'",
                       "0")) {
        return false;
    }
    snprintf(
        sql, sizeof sql,
        "DO $$ DECLARE c record; BEGIN FOR c IN SELECT oid::regclass AS name, relkind FROM pg_class WHERE "
        "relnamespace = 'plant%d'::regnamespace AND relkind IN ('r', 'S') AND relname NOT IN ('migration', "
        "'repair') LOOP IF c.relkind = 'S' THEN PERFORM setval(c.name, 1, false); ELSE EXECUTE "
        "format('DELETE FROM %%s', c.name); END IF; END LOOP; END $$",
        number);
    cluster_query(cluster, sql);
    return true;
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

static bool shm_remove(int number)
{
    char path[64];
    snprintf(path, sizeof path, "/dev/shm/apc.test-%d-%d", (int)getpid(), number);
    unlink(path);
    return false;
}

static const struct store_kind store_kinds[] = {
    {"postgresql:", postgresql_uri, postgresql_made, postgresql_empty, false},
    {"sqlite:", sqlite_uri, NULL, NULL, false},
    {"mem:", mem_uri, NULL, NULL, false},
    {"shm:", shm_uri, NULL, shm_remove, false},
    {"sqlite: with a spool", sqlite_uri, NULL, NULL, true}};

/* Numbers of stores: so many were made; those of the running test; those that are as new. */
static int made, taken[8], n_taken, spare[8], n_spare;

const struct store_kind *store_kind;
char store_uri[512];

bool stores_next(void)
{
    static size_t next;
    const char *only = getenv("APC_TEST_STORE");
    while (next < sizeof store_kinds / sizeof store_kinds[0]) {
        store_kind = &store_kinds[next++];
        n_spare = 0;
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

int stores_set_up(void **state)
{
    const bool fresh = n_spare == 0;
    const int number = fresh ? ++made : spare[--n_spare];
    taken[n_taken++] = number;
    store_kind->uri(store_uri, sizeof store_uri, number);
    struct apc_store *store = *state = stores_open();
    if (!fresh) {
        return 0;
    }
    const int had = apc_store_init(store);
    if (had != 0) {
        fprintf(stderr, "%s\n", apc_store_error(store));
    } else if (store_kind->made) {
        store_kind->made(number);
    }
    return had != 0;
}

int stores_tear_down(void **state)
{
    apc_store_close(*state);
    while (n_taken > 0) {
        const int number = taken[--n_taken];
        if (store_kind->empty && store_kind->empty(number)) {
            spare[n_spare++] = number;
        }
    }
    return 0;
}

struct apc_sample sample(enum apc_table table, int id, int64_t seq, double value)
{
    const apc_ns ms = seq % 1000000000; /* of a seq that begins high as well */
    return (struct apc_sample){
        .table = table, .id = id, .seq = seq, .time = ms * APC_NS_PER_MS, .value = value};
}

struct apc_sample newest(struct apc_store *store, enum apc_table table, int id)
{
    struct apc_sample s = {.table = table, .id = id};
    ok(store, apc_store_read(store, &s, 1));
    return s;
}

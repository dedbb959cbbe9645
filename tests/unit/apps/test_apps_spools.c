/* SPDX-License-Identifier: BSD-3-Clause */
/* What `apc drain` and the end of a run make of the spools in a folder. */
#include "apc/folder/spools.h"

#include <fcntl.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "check.h"

static char folder[64], uri[128], spool[128];

static int set_up(void **state)
{
    (void)state;
    snprintf(folder, sizeof folder, "/tmp/apc-drain.XXXXXX");
    if (!mkdtemp(folder))
        return 1;
    snprintf(uri, sizeof uri, "sqlite:%s/store.db", folder);
    snprintf(spool, sizeof spool, "%s/apc-client.spool", folder);
    return 0;
}

static int clear(void **state)
{
    char command[100];
    (void)state;
    snprintf(command, sizeof command, "rm -rf %s", folder);
    return system(command);
}

static struct apc_store *open_with(const char *path)
{
    const struct apc_store_options options = {
        .size = sizeof options, .name = "apc-client", .spool = path, .backoff_min = 1, .backoff_max = 1};
    struct apc_store *store = NULL;
    assert_int_equal(apc_store_open(&store, uri, &options, NULL), 0);
    return store;
}

/* Three samples, each a record of its own, while the store's file is not there; then it is. */
static void leave_three(void)
{
    struct apc_store *store = open_with(spool);
    for (int64_t seq = 1; seq <= 3; seq++) {
        const struct apc_sample s = {.table = APC_SENSOR, .id = 1, .seq = seq, .time = seq * APC_NS_PER_S};
        assert_int_equal(apc_store_append(store, &s, 1), 1);
    }
    apc_store_close(store);
    store = open_with(NULL);
    assert_int_equal(apc_store_init(store), 0);
    apc_store_close(store);
}

static int count(void *ctx, const struct apc_sample *sample)
{
    (void)sample;
    ++*(int *)ctx;
    return 0;
}

static int stored(void)
{
    int n = 0;
    struct apc_store *store = open_with(NULL);
    assert_true(apc_store_history(store, APC_SENSOR, 1, NULL, count, &n) >= 0);
    apc_store_close(store);
    return n;
}

/* Promise(stores/apc-drain): `apc drain` and `apc status --spool` say and do what docs/stores.md has. */
static void test_what_waits_is_stored_and_the_spool_removed(void **state)
{
    struct apc_error why = {""};
    (void)state;
    leave_three();
    assert_int_equal(spools_drain(folder, uri, APC_NS_PER_S * 30, &why), 0);
    assert_int_equal(stored(), 3);
    assert_int_equal(access(spool, F_OK), -1);
}

/* Wherever the damage is, above all at the end, where it could be taken for a record cut short. */
/* Promise(stores/apc-drain) */
static void test_damage_is_said_and_the_rest_is_stored(void **state)
{
    (void)state;
    for (off_t at = 4096 + 12; at < 4096 + 3 * 72; at += 72) {
        struct apc_error why = {""};
        unsigned char byte;
        clear(NULL);
        set_up(NULL);
        leave_three();
        int fd = open(spool, O_RDWR);
        assert_int_equal(pread(fd, &byte, 1, at), 1);
        byte ^= 1;
        assert_int_equal(pwrite(fd, &byte, 1, at), 1);
        close(fd);
        assert_true(spools_drain(folder, uri, APC_NS_PER_S * 30, &why) < 0);
        assert_non_null(strstr(why.text, "apc-client.spool was damaged"));
        assert_non_null(strstr(why.text, "(2 samples and events)"));
        char *aside = strstr(why.text, "apc-client.spool.damaged-");
        assert_non_null(aside);
        aside[strcspn(aside, ",")] = '\0';
        char path[256];
        snprintf(path, sizeof path, "%s/%s", folder, aside);
        assert_int_equal(access(path, R_OK), 0);
        assert_int_equal(stored(), 2);
        assert_int_equal(spools_drain(folder, uri, APC_NS_PER_S * 30, &why), 0);
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test_setup_teardown(test_what_waits_is_stored_and_the_spool_removed, set_up, clear),
        cmocka_unit_test_setup_teardown(test_damage_is_said_and_the_rest_is_stored, set_up, clear),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}

/* SPDX-License-Identifier: BSD-3-Clause */
/* The file of a spool: what is found at opening, torn, damaged, foreign. */
#include <fcntl.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#include "spool_rig.h"

/* ---- What is found at opening ------------------------------------------------------------------ */

/* Promise(stores/spool-acknowledges) */
static void test_another_writers_or_stores_spool_is_refused(void **state)
{
    (void)state;
    struct apc_store *store = open_spooled(nowhere);
    struct apc_store_options o = options();
    assert_refused(nowhere, &o, APC_EBUSY, "in use by another process");
    append(store, 1, 1);
    apc_store_close(store);
    o.name = "somebody";
    assert_refused(nowhere, &o, APC_EINVAL, "is of writer writer, not of somebody");
    o.name = "writer";
    char other[500];
    snprintf(other, sizeof other, "%s#plant2", nowhere);
    assert_refused(other, &o, APC_EINVAL, "is for the store");
    snprintf(other, sizeof other, "postgresql://apc:changed@/none?host=%s&connect_timeout=3", folder);
    store = open_with(other, &o); /* the same store with another password */
    assert_int_equal(stats_of(store).samples, 1);
    apc_store_close(store);
}

/* Where a store is, and nothing of who asks, or how. */
/* Promise(stores/password-shown) */
static void test_the_identity_of_a_store_has_no_secrets(void **state)
{
    static const char *const names[] = {"PGSERVICE", "PGHOST", "PGPORT", "PGDATABASE"};
    static const char *const cases[][2] = {
        {"sqlite:/a/b.db", "sqlite:/a/b.db"},
        {"shm:plant?size=3", "shm:plant"},
        {"postgresql:", "postgresql: PGHOST=here"},
        {"postgresql:#b", "postgresql:#b PGHOST=here"},
        {"postgresql://u:p@h1,h2:5/db?host=/tmp&password=x&port=7#b",
         "postgresql://h1,h2:5/db host=/tmp port=7#b PGHOST=here"},
        {"postgres://a:b@c@d/e?sslmode=disable&dbname=f", "postgres://d/e dbname=f PGHOST=here"},
        {"postgresql://h/db?connect_timeout=3#host=x", "postgresql://h/db#host=x PGHOST=here"},
    };
    char before[4][200], text[200];
    (void)state;
    for (size_t i = 0; i < 4; i++) {
        const char *value = getenv(names[i]);
        snprintf(before[i], sizeof before[i], "%s", value ? value : "");
        unsetenv(names[i]);
    }
    setenv("PGHOST", "here", 1);
    bool same = true;
    for (size_t i = 0; i < sizeof cases / sizeof cases[0]; i++) {
        apc_spool_identity(cases[i][0], text, sizeof text);
        if (strcmp(text, cases[i][1]) != 0) {
            print_message("%s: \"%s\"\n", cases[i][0], text);
            same = false;
        }
    }
    apc_spool_identity("sqlite:/a/long/path", text, 8);
    same = same && strcmp(text, "sqlite:") == 0;
    unsetenv("PGHOST");
    for (size_t i = 0; i < 4; i++) {
        if (before[i][0]) {
            setenv(names[i], before[i], 1);
        }
    }
    assert_true(same);
}

static void write_file(const char *text, size_t n)
{
    int fd = open(spool, O_WRONLY | O_CREAT | O_TRUNC, 0600);
    assert_int_equal(write(fd, text, n), n);
    close(fd);
}

static void test_a_file_that_is_no_spool_is_refused_and_left_alone(void **state)
{
    (void)state;
    struct apc_store_options o = options();
    write_file("precious", 8);
    assert_refused(nowhere, &o, APC_EINVAL, "no spool of libapc");
    struct stat st;
    assert_int_equal(stat(spool, &st), 0);
    assert_int_equal(st.st_size, 8);
    unlink(spool);
    assert_int_equal(mkdir(spool, 0700), 0);
    assert_refused(nowhere, &o, APC_ESTORE, "cannot be opened");
    rmdir(spool);
    o.spool = "/nowhere/at/all.spool";
    assert_refused(nowhere, &o, APC_ESTORE, "No such file");
    assert_int_equal(apc_spool_look("/nowhere/at/all.spool", &(struct apc_spool_info){0}, NULL),
                     APC_ENOTFOUND);
}

static void test_a_file_that_was_just_begun_is_taken_over(void **state)
{
    (void)state;
    write_file("apcspool\1\0\0\0", 12); /* killed while it wrote the header */
    struct apc_store *store = open_spooled(nowhere);
    append(store, 1, 1);
    apc_store_close(store);
    write_file("", 0);
    store = open_spooled(nowhere);
    append(store, 1, 1);
    apc_store_close(store);
}

static void spool_three(void)
{
    struct apc_store *store = open_spooled(nowhere);
    for (int64_t seq = 1; seq <= 3; seq++) {
        append(store, 1, seq);
    }
    apc_store_close(store);
}

static off_t size_of(const char *path)
{
    struct stat st;
    return stat(path, &st) == 0 ? st.st_size : -1;
}

/* At whatever byte the last record ends: it goes, those before it stay. */
/* Promise(stores/spool-acknowledges) */
static void test_a_torn_tail_is_cut_off(void **state)
{
    (void)state;
    for (int cut = 1; cut < 72; cut++) {
        unlink(spool);
        spool_three();
        assert_int_equal(truncate(spool, size_of(spool) - cut), 0);
        struct apc_store *store = open_spooled(nowhere);
        assert_int_equal(stats_of(store).samples, 2);
        assert_int_equal(stats_of(store).torn, 72 - cut);
        assert_int_equal(stats_of(store).damaged, 0);
        append(store, 1, 3);
        apc_store_close(store);
        store = open_spooled(nowhere);
        assert_int_equal(stats_of(store).samples, 3);
        apc_store_close(store);
    }
}

static void flip(off_t at)
{
    unsigned char byte;
    int fd = open(spool, O_RDWR);
    assert_int_equal(pread(fd, &byte, 1, at), 1);
    byte ^= 0x10;
    assert_int_equal(pwrite(fd, &byte, 1, at), 1);
    close(fd);
}

/* Whatever byte of whatever record is wrong: that record is lost to us, the others are not, and the file is
 * kept for people. */
/* Promise(stores/spool-acknowledges) */
static void test_a_damaged_record_is_set_aside_and_the_others_go_on(void **state)
{
    (void)state;
    for (int at = 0; at < 3 * 72; at++) {
        unlink(spool);
        spool_three();
        flip(APC_SPOOL_HEADER + at);
        off_t size = size_of(spool);
        struct apc_spool_info info = {.size = sizeof info};
        assert_int_equal(apc_spool_look(spool, &info, NULL), 0);
        assert_int_equal(info.stats.samples, 2);
        assert_int_equal(info.stats.damaged, 1);
        struct apc_store *store = open_spooled(nowhere);
        struct apc_spool_stats stats = stats_of(store);
        assert_int_equal(stats.samples, 2);
        assert_int_equal(stats.damaged, 1);
        assert_int_equal(stats.torn, 0);
        assert_int_equal(size_of(stats.aside), size);
        unlink(stats.aside);
        apc_store_close(store);
    }
}

static uint32_t crc(const unsigned char *bytes, size_t n)
{
    uint32_t c = 0xffffffffu;
    for (size_t i = 0; i < 8 * n; i++) {
        bool odd = (c ^ (uint32_t)(bytes[i / 8] >> i % 8)) & 1;
        c = odd ? c >> 1 ^ 0x82f63b78u : c >> 1;
    }
    return ~c;
}

/* As version 1 of the file had them: magic, CRC of all that follows, kind, count, items. */
static void make_records_old(void)
{
    unsigned char record[72];
    int fd = open(spool, O_RDWR);
    for (off_t at = APC_SPOOL_HEADER; pread(fd, record, sizeof record, at) > 0; at += (off_t)sizeof record) {
        const uint32_t head[4] = {0x5a7c0e1du, 0, APC_SPOOL_SAMPLES, 1};
        memcpy(record, head, sizeof head);
        const uint32_t sum = crc(record + 8, sizeof record - 8);
        memcpy(record + 4, &sum, sizeof sum);
        assert_int_equal(pwrite(fd, record, sizeof record, at), sizeof record);
    }
    assert_int_equal(pwrite(fd, &(uint32_t){1}, 4, 8), 4);
    close(fd);
}

/* Promise(stores/spool-acknowledges) */
static void test_a_spool_of_the_former_version_is_taken_over_whole(void **state)
{
    (void)state;
    uint32_t version = 0;
    struct apc_spool_info info = {.size = sizeof info};
    spool_three();
    make_records_old();
    assert_int_equal(apc_spool_look(spool, &info, NULL), 0);
    assert_int_equal(info.stats.samples, 3);
    assert_int_equal(info.stats.damaged, 0);
    struct apc_store *store = open_spooled(nowhere);
    append(store, 1, 4);
    assert_int_equal(stats_of(store).samples, 4);
    assert_int_equal(stats_of(store).damaged, 0);
    apc_store_close(store);
    int fd = open(spool, O_RDWR);
    assert_int_equal(pread(fd, &version, 4, 8), 4);
    assert_int_equal(version, 2);
    version = 3;
    assert_int_equal(pwrite(fd, &version, 4, 8), 4);
    close(fd);
    struct apc_store_options o = options();
    assert_refused(nowhere, &o, APC_EINVAL,
                   "version 3, this library knows up to 2: drain it with the libapc");
}

/* So a spool that another processor left is drained here. */
static void test_its_bytes_are_those_of_no_processor(void **state)
{
    (void)state;
    /* clang-format off */
    static const unsigned char record[72] = {
        0x1e, 0x0e, 0x7c, 0x5a, 0x1d, 0xde, 0xc0, 0x93,
        0x01, 0x01, 0x00, 0x00, 0x32, 0x99, 0x1e, 0xb5,
        0x73, 0x65, 0x6e, 0x73, 0x6f, 0x72, 0x00, 0x00,
        0x04, 0x03, 0x02, 0x01, 0x00, 0x00, 0x00, 0x40,
        0x08, 0x07, 0x06, 0x05, 0x04, 0x03, 0x02, 0x01,
        0x00, 0x00, 0x2a, 0x36, 0xfe, 0x9c, 0x97, 0x17,
        0x00, 0x00, 0x00, 0x00, 0x00, 0x00, 0x04, 0xc0,
        0x00, 0x00, 0x00, 0x00, 0x00, 0x00, 0x00, 0x00,
        0x00, 0x00, 0x00, 0x00, 0x00, 0x00, 0x00, 0x00,
    };
    /* clang-format on */
    unsigned char bytes[72];
    struct apc_sample s = {.table = APC_SENSOR,
                           .id = 0x01020304,
                           .status = APC_UNCERTAIN,
                           .seq = 0x0102030405060708,
                           .time = T0,
                           .value = -2.5};
    struct apc_store *store = open_spooled(nowhere);
    ok(store, apc_store_append(store, &s, 1));
    apc_store_close(store);
    int fd = open(spool, O_RDONLY);
    assert_int_equal(pread(fd, bytes, sizeof bytes, APC_SPOOL_HEADER), sizeof bytes);
    close(fd);
    assert_memory_equal(bytes, record, sizeof bytes);
}

/* It was whole when it was opened. What lies before the damage is drained as if nothing were. */
static void test_damage_while_it_is_open_is_found_when_it_drains(void **state)
{
    (void)state;
    char uri[400];
    snprintf(uri, sizeof uri, "sqlite:%s/store.db", folder);
    struct apc_store *store = open_spooled(uri), *behind = NULL;
    for (int64_t seq = 1; seq <= 5; seq++) {
        append(store, 1, seq);
    }
    flip(APC_SPOOL_HEADER + 2 * 72 + 30);
    struct apc_store_options o = options();
    o.spool = NULL;
    behind = open_with(uri, &o);
    assert_int_equal(apc_store_init(behind), 0);
    drain(store);
    assert_int_equal(stats_of(store).damaged, 1);
    assert_int_equal(stats_of(store).drained, 4);
    assert_true(size_of(stats_of(store).aside) >= APC_SPOOL_HEADER + 5 * 72);
    struct apc_sample newest = {.table = APC_SENSOR, .id = 1};
    ok(behind, apc_store_read(behind, &newest, 1));
    assert_int_equal(newest.seq, 5);
    append(store, 1, 6);
    apc_store_close(behind);
    apc_store_close(store);
}

/* Bytes changed, cut off, added anywhere: it is taken over or refused, and nothing is made up. */
static void test_no_garbage_does_harm(void **state)
{
    (void)state;
    struct apc_store_options o = options();
    struct apc_error why;
    for (unsigned seed = 1; seed <= 150; seed++) {
        char command[400];
        unsigned char bytes[64];
        snprintf(command, sizeof command, "rm -f %s*", spool);
        assert_int_equal(system(command), 0);
        spool_three();
        uint64_t r = seed * UINT64_C(0x9e3779b97f4a7c15);
        for (size_t i = 0; i < sizeof bytes; i++) {
            r = r * UINT64_C(6364136223846793005) + UINT64_C(1442695040888963407);
            bytes[i] = (unsigned char)(r >> 56);
        }
        int fd = open(spool, O_RDWR);
        off_t at = (off_t)((r >> 20) % (seed % 3 == 0 ? 140 : APC_SPOOL_HEADER + 3 * 72));
        assert_true(pwrite(fd, bytes, 1 + seed % 60, at) > 0);
        assert_int_equal(ftruncate(fd, size_of(spool) - (off_t)(seed % 4 == 0 ? (r >> 8) % 300 : 0)), 0);
        close(fd);
        struct apc_store *store = NULL;
        struct apc_spool_info info = {.size = sizeof info};
        (void)apc_spool_look(spool, &info, &why);
        int rc = apc_store_open(&store, nowhere, &o, &why);
        if (rc != 0 && rc != APC_EINVAL) {
            fail_msg("seed %u: %s", seed, why.text);
        }
        if (rc == 0 && stats_of(store).samples > 3) {
            fail_msg("seed %u: %llu samples", seed, (unsigned long long)stats_of(store).samples);
        }
        apc_store_close(store);
    }
}

static void test_a_damaged_header_sets_the_file_aside(void **state)
{
    (void)state;
    spool_three();
    flip(100);
    struct apc_store *store = open_spooled(nowhere);
    assert_int_equal(stats_of(store).samples, 0);
    assert_int_equal(stats_of(store).damaged, 1);
    assert_int_equal(size_of(stats_of(store).aside), APC_SPOOL_HEADER + 3 * 72);
    assert_int_equal(size_of(spool), APC_SPOOL_HEADER); /* whose records those are nobody knows */
    append(store, 1, 1);
    apc_store_close(store);
    unlink(spool);
    spool_three();
    flip(4080); /* the head: from the first record on, then */
    store = open_spooled(nowhere);
    assert_int_equal(stats_of(store).samples, 3);
    apc_store_close(store);
}

/* Whatever byte of it: it is told with the file's name, or it changes nothing of what waits. */
/* Promise(stores/spool-acknowledges) */
static void test_no_byte_of_the_header_is_wrong_unseen(void **state)
{
    (void)state;
    spool_three();
    for (int at = 0; at < APC_SPOOL_HEADER; at++) {
        struct apc_spool_info info = {.size = sizeof info};
        struct apc_error why = {""};
        const bool form = at < 12, texts = at >= 12 && at < 2128; /* and what is not in use, and the head */
        flip(at);
        assert_int_equal(apc_spool_look(spool, &info, &why), form ? APC_EINVAL : texts ? APC_EPROTO : 0);
        if (form || texts) {
            assert_non_null(strstr(why.text, spool));
        } else {
            assert_int_equal(info.stats.samples, 3);
            assert_int_equal(info.stats.damaged, 0);
            assert_string_equal(info.writer, "writer");
        }
        flip(at);
    }
}

int main(void)
{
#define OFFLINE(test) cmocka_unit_test_setup_teardown(test, set_up, clear_folder)
    const struct CMUnitTest tests[] = {
        OFFLINE(test_another_writers_or_stores_spool_is_refused),
        OFFLINE(test_the_identity_of_a_store_has_no_secrets),
        OFFLINE(test_a_file_that_is_no_spool_is_refused_and_left_alone),
        OFFLINE(test_a_file_that_was_just_begun_is_taken_over),
        OFFLINE(test_a_torn_tail_is_cut_off),
        OFFLINE(test_a_damaged_record_is_set_aside_and_the_others_go_on),
        OFFLINE(test_a_spool_of_the_former_version_is_taken_over_whole),
        OFFLINE(test_its_bytes_are_those_of_no_processor),
        OFFLINE(test_damage_while_it_is_open_is_found_when_it_drains),
        OFFLINE(test_no_garbage_does_harm),
        OFFLINE(test_a_damaged_header_sets_the_file_aside),
        OFFLINE(test_no_byte_of_the_header_is_wrong_unseen),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}

/* SPDX-License-Identifier: BSD-3-Clause */
/* One that stands by: whose place it is, over a store that can take it from one who lives. */
/* Promise(modes/process-stands-takes) */
#include "operate/operate.h"
#include "stores.h"

#define PERIOD APC_NS_PER_S

struct follower {
    struct standby standby;
    struct apc_sample mine[2];
    struct apc_store *store;
    struct apc_vector tick;
    double value[1];
    struct apc_rows former;
};

static struct follower *begin(struct follower *f)
{
    *f = (struct follower){.mine = {{.table = APC_ACTUATOR, .id = 1}, {.table = APC_TICK, .id = 1}},
                           .store = stores_open()};
    f->tick = (struct apc_vector){.table = APC_TICK, .id = 1, .room = 1, .value = f->value};
    f->former = (struct apc_rows){.size = sizeof f->former, .vector = &f->tick, .n_vectors = 1};
    f->standby = (struct standby){.mine = f->mine, .n = 2, .period = PERIOD};
    standby_follow(&f->standby);
    return f;
}

static int look(struct follower *f, double periods)
{
    const int rc = standby_look(&f->standby, f->store, &f->former, (apc_ns)(periods * (double)PERIOD));
    ok(f->store, rc);
    return rc;
}

static int tick(struct apc_store *store, int64_t seq)
{
    double value[1] = {(double)seq};
    struct apc_sample u = sample(APC_ACTUATOR, 1, seq, (double)seq);
    struct apc_vector row = {.table = APC_TICK, .id = 1, .seq = seq, .n = 1, .value = value};
    const struct apc_rows rows = {
        .size = sizeof rows, .sample = &u, .n_samples = 1, .vector = &row, .n_vectors = 1};
    int rc = APC_ECONN;
    while (rc == APC_ECONN) /* a session that was ended */
        rc = apc_store_append_rows(store, &rows);
    return rc;
}

static struct apc_store *begin_acting(void)
{
    struct apc_store *store = stores_open();
    struct apc_sample place[2] = {{.table = APC_ACTUATOR, .id = 1}, {.table = APC_TICK, .id = 1}};
    ok(store, apc_store_claim_set(store, place, 2));
    return store;
}

static void test_who_ticks_is_followed(void **state)
{
    struct follower f;
    struct apc_store *acting = begin_acting();
    (void)state;
    begin(&f);
    for (int k = 1; k < 20; k++) {
        if (k % 2) /* each second tick is missed */
            ok(acting, tick(acting, k));
        assert_int_equal(look(&f, k), 0);
    }
    apc_store_close(acting);
    apc_store_close(f.store);
}

static void test_the_place_of_one_that_is_gone_is_taken_at_the_second_look_without_a_tick(void **state)
{
    struct follower f;
    struct apc_store *acting = begin_acting();
    (void)state;
    begin(&f);
    ok(acting, tick(acting, 1));
    assert_int_equal(look(&f, 1), 0);
    apc_store_close(acting);
    assert_int_equal(look(&f, 2), 0);
    assert_int_equal(look(&f, 3), 1);
    assert_int_equal(tick(f.store, 2), 2);
    assert_true(f.mine[0].seq == 1 && f.mine[1].seq == 1);
    apc_store_close(f.store);
}

static void test_one_that_hangs_is_fenced_when_it_wakes_up(void **state)
{
    struct follower f;
    struct apc_store *acting = begin_acting();
    (void)state;
    begin(&f);
    ok(acting, tick(acting, 1));
    assert_int_equal(look(&f, 1), 0);
    assert_int_equal(look(&f, 2), 0);
    assert_int_equal(look(&f, 3), 1);
    assert_int_equal(tick(acting, 2), APC_EBUSY);
    assert_int_equal(tick(f.store, 2), 2);
    assert_true(newest(f.store, APC_ACTUATOR, 1).seq == 2);
    apc_store_close(acting);
    apc_store_close(f.store);
}

static void test_where_claims_have_no_numbers_one_that_hangs_keeps_its_place(void **state)
{
    struct follower f;
    struct apc_store *acting = begin_acting();
    (void)state;
    begin(&f);
    ok(acting, tick(acting, 1));
    for (int k = 1; k < 10; k++)
        assert_int_equal(look(&f, k), 0);
    ok(acting, tick(acting, 2));
    apc_store_close(acting);
    for (int k = 10; k < 12; k++)
        assert_int_equal(look(&f, k), 0);
    assert_int_equal(look(&f, 12), 1); /* now that it has ended */
    apc_store_close(f.store);
}

static void test_a_look_that_is_late_itself_says_nothing(void **state)
{
    struct follower f;
    struct apc_store *acting = begin_acting();
    (void)state;
    begin(&f);
    ok(acting, tick(acting, 1));
    assert_int_equal(look(&f, 1), 0);
    assert_int_equal(look(&f, 2), 0);
    assert_int_equal(look(&f, 30), 0); /* all of the machine was stopped */
    assert_int_equal(look(&f, 31), 0);
    ok(acting, tick(acting, 2));
    assert_int_equal(look(&f, 32), 0);
    apc_store_close(acting);
    apc_store_close(f.store);
}

static void test_of_several_that_stand_by_one_takes_the_place(void **state)
{
    struct follower f[3];
    struct apc_store *acting = begin_acting();
    (void)state;
    for (int i = 0; i < 3; i++)
        begin(&f[i]);
    ok(acting, tick(acting, 1));
    int took = 0;
    for (int k = 1; k <= 3; k++)
        for (int i = 0; i < 3; i++)
            took += look(&f[i], k);
    assert_int_equal(took, 1);
    ok(f[0].store, tick(f[0].store, 2));
    for (int k = 4; k <= 6; k++) { /* the others follow it */
        ok(f[0].store, tick(f[0].store, k));
        assert_int_equal(look(&f[1], k) + look(&f[2], k), 0);
    }
    apc_store_close(acting);
    for (int i = 0; i < 3; i++)
        apc_store_close(f[i].store);
}

static void test_who_cannot_read_does_not_judge(void **state)
{
    struct follower f;
    struct apc_store *acting = begin_acting();
    begin(&f);
    ok(acting, tick(acting, 1));
    assert_int_equal(look(&f, 1), 0);
    assert_int_equal(look(&f, 2), 0);
    struct apc_rows nothing = {.size = 1, .vector = &f.tick, .n_vectors = 1}; /* refused */
    assert_true(standby_look(&f.standby, f.store, &nothing, 3 * PERIOD) < 0);
    assert_int_equal(look(&f, 4), 0);
    assert_int_equal(look(&f, 5), 1);
    (void)state;
    apc_store_close(acting);
    apc_store_close(f.store);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        T(test_who_ticks_is_followed),
        T(test_the_place_of_one_that_is_gone_is_taken_at_the_second_look_without_a_tick),
        T(test_one_that_hangs_is_fenced_when_it_wakes_up),
        T(test_a_look_that_is_late_itself_says_nothing),
        T(test_of_several_that_stand_by_one_takes_the_place),
        T(test_who_cannot_read_does_not_judge),
    };
    const struct CMUnitTest unnumbered[] = {
        T(test_who_ticks_is_followed),
        T(test_where_claims_have_no_numbers_one_that_hangs_keeps_its_place),
    };
    int failed = 0;
    while (stores_next())
        if (strncmp(store_kind->name, "shm", 3) == 0 || strncmp(store_kind->name, "postgresql", 10) == 0)
            failed += cmocka_run_group_tests_name(store_kind->name, tests, NULL, NULL);
        else if (strcmp(store_kind->name, "sqlite:") == 0)
            failed += cmocka_run_group_tests_name(store_kind->name, unnumbered, NULL, NULL);
    return failed;
}

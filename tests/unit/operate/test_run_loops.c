/* SPDX-License-Identifier: BSD-3-Clause */
/* The loops of a plant, as a store describes them. */
#include <stdio.h>

#include "operate/operate.h"
#include "stores.h"

static struct apc_tag tags[40];
static size_t n_tags;

static struct apc_tag *describe(enum apc_table table, int id, const char *name, const char *controller)
{
    struct apc_tag *tag = &tags[n_tags++];
    *tag = (struct apc_tag){.table = table, .id = id, .low = -1, .high = 1};
    snprintf(tag->name, sizeof tag->name, "%s", name);
    snprintf(tag->controller, sizeof tag->controller, "%s", controller);
    return tag;
}

static void pair(struct apc_store *store, int loop, int measurement, int setpoint)
{
    const struct apc_sample dim[] = {sample(APC_DIM, 2 + 2 * loop, 1, measurement),
                                     sample(APC_DIM, 3 + 2 * loop, 1, setpoint)};
    assert_int_equal(apc_store_append(store, dim, 2), 2);
}

static struct loops load(struct apc_store *store)
{
    struct apc_tag got[40];
    struct loops loops;
    ok(store, apc_store_put_tags(store, tags, n_tags));
    const int n = apc_store_get_tags(store, got, 40);
    assert_int_equal(n, n_tags);
    ok(store, loops_load(&loops, store, got, n_tags));
    return loops;
}

/* Two layers: base has v1, v2; upper moves r1, which v1 has as its setpoint. v2 stands first among outputs. */
static void describe_layers(struct apc_store *store)
{
    n_tags = 0;
    describe(APC_SENSOR, 1, "y1", "");
    describe(APC_SENSOR, 2, "y2", "");
    describe(APC_ACTUATOR, 1, "v2", "base");
    describe(APC_ACTUATOR, 2, "v1", "base");
    describe(APC_SETPOINT, 1, "r1", "base");
    describe(APC_SETPOINT, 2, "w1", "upper");
    describe(APC_SETPOINT, 3, "1", "base");
    describe(APC_OPMODE, 0, "mode", "base"); /* that of all, whoever it is said to be of */
    describe(APC_OPMODE, 1, "v1", "base");
    describe(APC_OPMODE, 2, "v2", "base");
    describe(APC_OPMODE, 3, "upper.r1", "upper");
    describe(APC_OPMODE, 65536 + 19, "r1.owner", "base"); /* another switch */
    describe(APC_MANUAL, 2, "v1.manual", "base");
    describe(APC_MANUAL, 1, "v2.manual", "base");
    describe(APC_MANUAL, 3, "upper.r1.manual", "upper");
    describe(APC_TICK, 1, "base", "base")->period = 0.5;
    describe(APC_TICK, 2, "upper", "upper")->period = 5;
    pair(store, 1, 1, 1);
    pair(store, 2, 2, 0);
    pair(store, 3, 1, 2);
}

static void test_each_loop_has_its_signals_its_controller_and_the_loop_above(void **state)
{
    describe_layers(*state);
    struct loops l = load(*state);
    assert_int_equal(l.n, 3);
    assert_int_equal(l.n_controllers, 2);
    const struct loops_loop *v1 = &l.at[0], *v2 = &l.at[1], *r1 = &l.at[2];
    assert_string_equal(v1->name, "v1");
    assert_true(v1->id == 1 && v1->controller == 0 && v1->table == APC_ACTUATOR && v1->output == 2);
    assert_true(v1->manual == 2 && v1->measurement == 1 && v1->setpoint == 1 && v1->above == 2);
    assert_true(v2->output == 1 && v2->manual == 1 && v2->measurement == 2 && v2->setpoint == 0);
    assert_true(v2->above == -1 && r1->above == -1);
    assert_true(r1->controller == 1 && r1->table == APC_SETPOINT && r1->output == 1 && r1->manual == 3);
    assert_true(l.controller[0].number == 1 && l.controller[0].first == 0 && l.controller[0].n == 2);
    assert_true(l.controller[1].number == 2 && l.controller[1].first == 2 && l.controller[1].n == 1);
    assert_true(l.controller[0].period == APC_NS_PER_S / 2 && l.controller[1].period == 5 * APC_NS_PER_S);
    loops_free(&l);
}

static void test_a_loop_is_found_by_name_and_by_what_belongs_to_it(void **state)
{
    describe_layers(*state);
    struct loops l = load(*state);
    assert_ptr_equal(loops_find(&l, "upper.r1"), &l.at[2]);
    assert_null(loops_find(&l, "r1"));
    assert_ptr_equal(loops_controller(&l, "upper"), &l.controller[1]);
    assert_null(loops_controller(&l, "v1"));
    assert_ptr_equal(loops_of(&l, APC_ACTUATOR, 1), &l.at[1]);
    assert_ptr_equal(loops_of(&l, APC_MANUAL, 2), &l.at[0]);
    assert_ptr_equal(loops_of(&l, APC_OPMODE, 3), &l.at[2]);
    assert_ptr_equal(loops_of(&l, APC_SETPOINT, 1), &l.at[0]); /* whose it is, not who moves it */
    assert_null(loops_of(&l, APC_SENSOR, 1));
    loops_free(&l);
}

static void test_the_only_loop_has_the_only_manual_output(void **state)
{
    n_tags = 0;
    describe(APC_ACTUATOR, 1, "u", "controller");
    describe(APC_OPMODE, 1, "u", "controller");
    describe(APC_MANUAL, 1, "manual", "controller");
    struct loops l = load(*state);
    assert_int_equal(l.n, 1);
    assert_true(l.at[0].manual == 1 && l.at[0].output == 1 && l.at[0].setpoint == 0);
    assert_true(l.controller[0].period == 0);
    loops_free(&l);
}

static void test_a_store_that_describes_no_loop_has_none(void **state)
{
    n_tags = 0;
    describe(APC_OPMODE, 1, "mode.actual", "");
    struct loops l = load(*state);
    assert_int_equal(l.n, 0);
    assert_null(loops_of(&l, APC_SETPOINT, 1));
    loops_free(&l);
}

/* ---- Who acts -------------------------------------------------------------------------------- */

#define SWITCH LOOPS_ACTING(APC_ACTUATOR, 1)

/* Three of one output and one of another; the switch is of the first output. */
static void describe_shadows(struct apc_store *store)
{
    static const char *const controller[] = {"first", "trial", "third", "other"};
    static const char *const loop[] = {"u", "trial.u", "third.u", "v"};
    n_tags = 0;
    describe(APC_SENSOR, 1, "y", "");
    describe(APC_ACTUATOR, 1, "u", "first");
    describe(APC_ACTUATOR, 2, "v", "other");
    describe(APC_SETPOINT, 1, "r", "first");
    for (int i = 1; i <= 4; i++) {
        char manual[20], output[20];
        snprintf(manual, sizeof manual, "%s.manual", loop[i - 1]);
        snprintf(output, sizeof output, "%s.output", loop[i - 1]);
        describe(APC_OPMODE, i, loop[i - 1], controller[i - 1]);
        describe(APC_MANUAL, i, manual, controller[i - 1]);
        describe(APC_TICK, i, controller[i - 1], controller[i - 1]);
        describe(APC_ESTIMATE, 10 + i, output, controller[i - 1]); /* of the fourth it is a law's own */
        pair(store, i, 1, i < 4 ? 1 : 0);
    }
    describe(APC_OPMODE, SWITCH, "u.acting", "");
}

/*
 * Promise(modes/output-called-loop): An output is called for the loop of the controller that acts on it,
 *   and so is what became of a write, also where another one is dead.
 */
static void test_an_output_is_called_for_the_loop_that_acts_on_it(void **state)
{
    const struct apc_tag r = {.table = APC_SETPOINT, .id = 1, .controller = "first"},
                         Kp = {.table = APC_TUNING, .id = 1, .controller = "first"};
    describe_shadows(*state);
    struct loops l = load(*state);
    for (int acts = 1; acts <= 3; acts++) {
        const struct loops_loop *loop = &l.at[acts - 1];
        if (acts > 1) { /* until somebody sets the switch it is the first one */
            const struct apc_sample row = sample(APC_OPMODE, SWITCH, acts - 1, acts);
            assert_int_equal(apc_store_append(*state, &row, 1), 1);
            loops_free(&l);
            l = load(*state);
            loop = &l.at[acts - 1];
        }
        assert_ptr_equal(loops_find(&l, "u"), loop);
        assert_ptr_equal(loops_of(&l, APC_ACTUATOR, 1), loop);
        assert_ptr_equal(loops_of(&l, APC_SETPOINT, 1), loop);
        assert_ptr_equal(loops_taker(&l, &r), &l.controller[acts - 1]);
        assert_ptr_equal(loops_taker(&l, &Kp), &l.controller[0]); /* each has its own */
        assert_ptr_equal(loops_find(&l, "first.u"), &l.at[0]);
        assert_ptr_equal(loops_find(&l, "trial.u"), &l.at[1]);
        assert_ptr_equal(loops_of(&l, APC_OPMODE, 1), &l.at[0]);
        assert_ptr_equal(loops_of(&l, APC_MANUAL, 2), &l.at[1]);
        assert_ptr_equal(loops_find(&l, "v"), &l.at[3]);
        assert_true(l.controller[3].acts);
        for (int i = 0; i < 4; i++)
            assert_int_equal(l.at[i].would, i < 3 ? 11 + i : 0);
        assert_null(loops_taker(&l, &(struct apc_tag){.table = APC_SETPOINT, .controller = "nobody"}));
    }
    assert_false(loops_choose(&l, SWITCH, 4)); /* none of them: nothing changes */
    assert_false(loops_choose(&l, SWITCH, 7));
    assert_false(loops_choose(&l, SWITCH + 1, 1));
    assert_false(loops_choose(&l, SWITCH, 3));
    assert_ptr_equal(loops_find(&l, "u"), &l.at[2]);
    assert_true(loops_choose(&l, SWITCH, 1));
    assert_ptr_equal(loops_find(&l, "u"), &l.at[0]);
    loops_free(&l);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        T(test_each_loop_has_its_signals_its_controller_and_the_loop_above),
        T(test_a_loop_is_found_by_name_and_by_what_belongs_to_it),
        T(test_the_only_loop_has_the_only_manual_output),
        T(test_a_store_that_describes_no_loop_has_none),
        T(test_an_output_is_called_for_the_loop_that_acts_on_it),
    };
    int failed = 0;
    while (stores_next())
        failed += cmocka_run_group_tests_name(store_kind->name, tests, NULL, NULL);
    return failed;
}

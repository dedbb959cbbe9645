/* SPDX-License-Identifier: BSD-3-Clause */
/* A live store and its history as one: each function is the live store's, which answers, but for those that
 * look back, and those that are done in a history alone.
 */
#include "check.h"
#include "counting_store.h"
#include "shareddata/history/federated_internal.h"

static struct apc_store *both;
static struct apc_store *own; /* the live store that it was made with */

static int set_up_both(void **state)
{
    struct apc_error why;
    (void)set_up(state);
    if (apc_store_open(&both, "mem:seam-live+mem:seam-history", NULL, &why) < 0)
        fail_msg("%s", why.text);
    own = ((struct apc_federated *)both)->base.inner;
    ((struct apc_federated *)both)->base.inner = &store;
    return apc_store_init(((struct apc_federated *)both)->history) < 0;
}

static int tear_down_both(void **state)
{
    ((struct apc_federated *)both)->base.inner = own;
    apc_store_close(both);
    return tear_down(state);
}

static bool is_of_a_history(int i)
{
    return i >= 13 && i <= 18; /* what people ask for in one */
}

static void test_what_the_live_store_answers_is_the_answer(void **state)
{
    static const int answers[] = {APC_ETIMEDOUT, APC_ECONFLICT, APC_EPERM};
    (void)state;
    for (int i = 0; i < FUNCTIONS; i++) {
        for (size_t k = 0; k < 3 && !is_of_a_history(i); k++) {
            reached = 0;
            answer = answers[k];
            const int rc = call(i, both);
            if (rc != answers[k] || reached < 1)
                fail_msg("function %d: %d, reached %d times", i, rc, reached);
        }
        answer = reached = 0;
        const int rc = call(i, both);
        if (is_of_a_history(i) ? reached > 0 : rc < 0 || reached < 1)
            fail_msg("function %d: %d, reached %d times", i, rc, reached);
    }
}

static void test_it_is_there_as_the_live_store_is(void **state)
{
    (void)state;
    there = true;
    assert_true(apc_store_connected(both));
    assert_int_equal(apc_store_tables_version(both), 77);
    there = false;
    assert_false(apc_store_connected(both));
    assert_int_equal(apc_store_tables_version(both), 0);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test_setup_teardown(test_what_the_live_store_answers_is_the_answer, set_up_both,
                                        tear_down_both),
        cmocka_unit_test_setup_teardown(test_it_is_there_as_the_live_store_is, set_up_both, tear_down_both),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}

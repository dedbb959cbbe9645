/* SPDX-License-Identifier: BSD-3-Clause */
#include "check.h"

#include "control/control_internal.h"

#include <string.h>

static void compute(struct apc_law_call *c)
{
    c->u[0] = 0.0;
}

static void the_built_in_laws_are_found_by_name(void **state)
{
    const struct apc_law *const built_in[] = {&apc_law_pi, &apc_law_pid, &apc_law_cascade, &apc_law_lqg};

    (void)state;
    for (size_t i = 0; i < sizeof(built_in) / sizeof(built_in[0]); i++) {
        const struct apc_law *law = NULL;
        void *handle = &law;

        assert_int_equal(apc_law_find(built_in[i]->name, &law, &handle, NULL), 0);
        assert_ptr_equal(law, built_in[i]);
        assert_null(handle);
        assert_int_equal(apc_law_check(law, law->name, NULL), 0);
    }
}

static void an_unknown_name_is_answered_with_the_names_there_are(void **state)
{
    const struct apc_law *law = &apc_law_pi;
    void *handle = &law;
    struct apc_error why = {""};

    (void)state;
    assert_int_equal(apc_law_find("pdi", &law, &handle, &why), APC_ENOTFOUND);
    assert_null(law);
    assert_null(handle);
    assert_non_null(strstr(why.text, "\"pdi\""));
    assert_non_null(strstr(why.text, "there are: pi, pid, cascade, lqg;"));
}

static void a_missing_shared_object_is_named(void **state)
{
    const struct apc_law *law;
    void *handle;
    struct apc_error why = {""};

    (void)state;
    assert_int_equal(apc_law_find("./no-such-law.so", &law, &handle, &why), APC_ENOTFOUND);
    assert_null(law);
    assert_non_null(strstr(why.text, "no-such-law.so"));
}

static void a_law_that_cannot_work_is_refused_with_the_reason(void **state)
{
    const struct apc_param upside_down = {"Kp", "", "", 1.0, 5.0, -5.0};
    const struct apc_param not_a_number = {"Kp", "", "", (double)NAN, -5.0, 5.0};
    const struct apc_param nameless = {NULL, "", "", 1.0, -5.0, 5.0};
    const struct apc_law good = {.abi = APC_LAW_ABI, .name = "mine", .compute = compute};
    struct apc_law law = good;
    struct apc_error why = {""};

    (void)state;
    assert_int_equal(apc_law_check(&law, "x.so", &why), 0);
    law.abi = APC_LAW_ABI + 1;
    assert_int_equal(apc_law_check(&law, "x.so", &why), APC_EINVAL);
    assert_non_null(strstr(why.text, "version 2"));
    law = good;
    law.compute = NULL;
    assert_int_equal(apc_law_check(&law, "x.so", &why), APC_EINVAL);
    assert_non_null(strstr(why.text, "compute"));
    law = good;
    law.name = "";
    assert_int_equal(apc_law_check(&law, "x.so", &why), APC_EINVAL);
    law = good;
    law.n_tuning = 1;
    assert_int_equal(apc_law_check(&law, "x.so", &why), APC_EINVAL);
    law.tuning = &upside_down;
    assert_int_equal(apc_law_check(&law, "x.so", &why), APC_EINVAL);
    assert_non_null(strstr(why.text, "Kp"));
    law.tuning = &not_a_number;
    assert_int_equal(apc_law_check(&law, "x.so", &why), APC_EINVAL);
    law.tuning = &nameless;
    assert_int_equal(apc_law_check(&law, "x.so", &why), APC_EINVAL);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(the_built_in_laws_are_found_by_name),
        cmocka_unit_test(an_unknown_name_is_answered_with_the_names_there_are),
        cmocka_unit_test(a_missing_shared_object_is_named),
        cmocka_unit_test(a_law_that_cannot_work_is_refused_with_the_reason),
    };

    return cmocka_run_group_tests(tests, NULL, NULL);
}

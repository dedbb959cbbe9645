/* SPDX-License-Identifier: BSD-3-Clause */
/* The examples' own law and own plant, as shared objects, as a user would build and name them. */
#include "check.h"

#include "apcmodules.h"

#include <string.h>

#define S  APC_NS_PER_S
#define T0 (INT64_C(1700000000) * S)

static void a_users_law_is_loaded_and_controls(void **state)
{
    const struct apc_law *law;
    void *handle;
    struct apc_controller_options o = {.size = sizeof(o), .dim = {1, 1, 1}, .period = S, .horizon = 3 * S};
    struct apc_controller *c;
    struct apc_sample in[6], out[7];
    struct apc_error why = {""};

    (void)state;
    if (apc_law_find(APC_EXAMPLES_DIR "/mylaw.so", &law, &handle, &why) < 0)
        fail_msg("%s", why.text);
    assert_string_equal(law->name, "mylaw");
    o.law = law;
    assert_int_equal(apc_controller_create(&c, &o, &why), 0);
    assert_int_equal(apc_controller_size(c).in, 6);
    assert_int_equal(apc_controller_size(c).out, 7);
    apc_controller_inputs(c, in);
    for (int i = 0; i < 4; i++) {
        in[i].seq = 1;
        in[i].time = T0;
        in[i].status = APC_GOOD;
    }
    in[0].value = 2.0; /* y */
    in[1].value = 5.0; /* z */
    in[2].value = APC_MODE_AUTO;
    in[3].value = 7.0; /* Kp */
    assert_true(apc_controller_compute(c, (struct apc_now){.utc = T0}, in, out, NULL) > 0);
    assert_int_equal(out[0].table, APC_ACTUATOR);
    assert_near(out[0].value, 21.0, 1e-12);
    apc_controller_destroy(c);
    apc_plugin_close(handle);
}

static void a_users_plant_is_loaded_and_runs_to_its_equilibrium(void **state)
{
    const double inflow = 0.05, level = inflow * inflow / (2.0 * 9.81 * 0.019 * 0.019);
    const struct apc_model *model;
    void *handle;
    struct apc_plant *plant;
    struct apc_error why = {""};
    double y = 0.0;

    (void)state;
    if (apc_model_find(APC_EXAMPLES_DIR "/myplant.so", &model, &handle, &why) < 0)
        fail_msg("%s", why.text);
    assert_int_equal(apc_plant_create(&plant, model, NULL, NULL, NULL, &why), 0);
    for (int k = 0; k < 1000; k++)
        assert_int_equal(apc_plant_advance(plant, 1.0, &inflow), 0);
    apc_plant_output(plant, &inflow, &y);
    assert_near(y, level, 1e-6);
    apc_plant_destroy(plant);
    apc_plugin_close(handle);
}

static void a_shared_object_of_another_kind_is_refused_by_name(void **state)
{
    const struct apc_law *law;
    const struct apc_model *model;
    void *handle;
    struct apc_error why = {""};

    (void)state;
    assert_int_equal(apc_law_find(APC_EXAMPLES_DIR "/myplant.so", &law, &handle, &why), APC_ENOTFOUND);
    assert_null(law);
    assert_null(handle);
    assert_non_null(strstr(why.text, "apc_law"));
    assert_int_equal(apc_model_find(APC_EXAMPLES_DIR "/mylaw.so", &model, &handle, &why), APC_ENOTFOUND);
    assert_null(model);
    assert_non_null(strstr(why.text, "apc_model"));
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(a_users_law_is_loaded_and_controls),
        cmocka_unit_test(a_users_plant_is_loaded_and_runs_to_its_equilibrium),
        cmocka_unit_test(a_shared_object_of_another_kind_is_refused_by_name),
    };

    return cmocka_run_group_tests(tests, NULL, NULL);
}

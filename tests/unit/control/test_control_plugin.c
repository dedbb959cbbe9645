/* SPDX-License-Identifier: BSD-3-Clause */
/* The examples' own laws and own plant, as shared objects, as a user would build and name them. */
#include "check.h"

#include "rows.h"

#include <stdio.h>
#include <string.h>

#define S  APC_NS_PER_S
#define T0 (INT64_C(1700000000) * S)

/* As they are in C and, where there is a compiler for it, as C++. */
static const char *const flavours[] = {"",
#ifdef APC_CPP_EXAMPLES
                                       "_cpp"
#endif
};
#define FLAVOURS (sizeof(flavours) / sizeof(flavours[0]))

static const char *path_of(const char *name, size_t flavour)
{
    static char path[512];

    (void)snprintf(path, sizeof(path), "%s/%s%s.so", APC_EXAMPLES_DIR, name, flavours[flavour]);
    return path;
}

/* A law on the plant of the paper with some dead time, both every two seconds. */
struct rig {
    const struct apc_law *law;
    void *handle;
    struct apc_controller *controller;
    const struct apc_rows *out;
    struct apc_plant *plant;
    int64_t k;
};

static const double model[] = {10.0, 10.0, 8.0};
static const struct apc_setting smith_setting = {"model", NULL, 1, 3, model};

static void make(struct rig *r, const char *name, size_t flavour, double dead_time)
{
    const struct apc_plant_options late = {.size = sizeof(late), .dead_time = dead_time};
    const struct apc_controller_loop loop = {.id = 1, .mode = 1, .low = -4.0, .high = 4.0};
    struct apc_controller_options o = {.size = sizeof(o),
                                       .dim = {1, 1, 1, 0},
                                       .period = 2 * S,
                                       .horizon = 7 * S,
                                       .loop = &loop,
                                       .n_setting = strcmp(name, "smith") == 0,
                                       .setting = &smith_setting};
    struct apc_error why = {""};

    memset(r, 0, sizeof(*r));
    if (apc_law_find(path_of(name, flavour), &r->law, &r->handle, &why) < 0)
        fail_msg("%s", why.text);
    assert_string_equal(r->law->name, name);
    o.law = r->law;
    if (apc_controller_create(&r->controller, &o, &why) < 0 ||
        apc_plant_create(&r->plant, &apc_model_first_order, NULL, NULL, &late, &why) < 0)
        fail_msg("%s", why.text);
    r->out = apc_controller_out(r->controller);
    rows_feed(apc_controller_in(r->controller), APC_OPMODE, 1, APC_MODE_AUTO, T0);
    for (int i = 0; i < 2; i++)
        rows_feed(apc_controller_in(r->controller), APC_TUNING, i + 1, r->law->tuning[i].initial, T0);
}

static void unmake(struct rig *r)
{
    apc_controller_destroy(r->controller);
    apc_plant_destroy(r->plant);
    apc_plugin_close(r->handle);
}

static double output(const struct rig *r)
{
    return r->out->sample[0].value;
}

/* Returns y. */
static double tick(struct rig *r, double z)
{
    const struct apc_rows *in = apc_controller_in(r->controller);
    double y = 0.0, u = r->k > 0 ? output(r) : 0.0;

    if (r->k > 0)
        assert_int_equal(apc_plant_advance(r->plant, 2.0, &u), 0);
    apc_plant_output(r->plant, &u, &y);
    r->k++;
    rows_feed(in, APC_SENSOR, 1, y, T0 + 2 * r->k * S);
    rows_feed(in, APC_SETPOINT, 1, z, T0 + 2 * r->k * S);
    assert_true(apc_controller_compute(r->controller, (struct apc_now){2 * r->k * S, T0 + 2 * r->k * S},
                                       (uint64_t)r->k, true, NULL) > 0);
    assert_int_equal(r->out->sample[0].table, APC_ACTUATOR);
    apc_controller_update(r->controller, 1);
    return y;
}

/* Promise(run/law-of-readme) */
static void a_users_law_controls_well(void **state)
{
    (void)state;
    for (size_t flavour = 0; flavour < FLAVOURS; flavour++) {
        struct rig r;
        double most = 0.0, y = 0.0;

        make(&r, "mylaw", flavour, 0.0);
        for (int k = 0; k < 75; k++)
            most = fmax(most, y = tick(&r, 10.0));
        assert_near(y, 10.0, 1e-4);
        assert_true(most < 10.5);
        unmake(&r);
    }
}

/* With dead time of four periods: the predictor settles where the same PI without it swings. */
/* Promise(run/law-of-readme) */
static void a_users_law_with_settings_and_state_predicts(void **state)
{
    double most[2] = {0.0, 0.0}, y = 0.0;
    struct rig r;

    (void)state;
    make(&r, "mylaw", 0, 8.0);
    for (int k = 0; k < 150; k++)
        most[0] = fmax(most[0], tick(&r, 10.0));
    unmake(&r);
    assert_true(most[0] > 12.0);
    for (size_t flavour = 0; flavour < FLAVOURS; flavour++) {
        most[1] = 0.0;
        make(&r, "smith", flavour, 8.0);
        for (int k = 0; k < 150; k++)
            most[1] = fmax(most[1], y = tick(&r, 10.0));
        assert_near(y, 10.0, 1e-6);
        assert_true(most[1] < 10.5);
        unmake(&r);
    }
}

/* Promise(run/law-of-readme) */
static void users_laws_go_from_man_to_auto_and_out_of_a_limit_without_a_bump(void **state)
{
    static const char *const names[] = {"mylaw", "smith"};

    (void)state;
    for (size_t i = 0; i < 2 * FLAVOURS; i++) {
        struct rig r;
        double u, before;
        int late = 0;

        make(&r, names[i / FLAVOURS], i % FLAVOURS, 0.0);
        rows_feed(apc_controller_in(r.controller), APC_OPMODE, 1, APC_MODE_MAN, T0);
        rows_feed(apc_controller_in(r.controller), APC_MANUAL, 1, 1.5, T0 + S);
        for (int k = 0; k < 10; k++)
            tick(&r, 10.0);
        assert_near(output(&r), 1.5, 0.0);
        rows_feed(apc_controller_in(r.controller), APC_OPMODE, 1, APC_MODE_AUTO, T0);
        tick(&r, 10.0);
        assert_near(output(&r), 1.5, 1e-12);
        for (int k = 0; k < 50; k++)
            tick(&r, 1000.0); /* far beyond what the output can do */
        assert_near(output(&r), 4.0, 0.0);
        u = output(&r);
        while (late++ < 20 && output(&r) >= 4.0)
            tick(&r, 30.0);
        assert_in_range(late, 1, 2); /* nothing has wound up */
        before = output(&r);
        assert_true(before < u);
        unmake(&r);
    }
}

#ifdef APC_CPP_EXAMPLES
/* Of the same name and size, but what its state means only its own code knows. */
/* Promise(laws/state-law-settings) */
static void a_plugin_built_otherwise_is_another_law_to_a_stored_state(void **state)
{
    static const char *const names[] = {"mylaw", "smith"};
    double mark[3] = {0.0};

    (void)state;
    for (size_t i = 0; i < 2; i++) {
        for (size_t n = 0; n < 3; n++) {
            struct rig r;

            make(&r, names[i], n / 2, 0.0); /* twice the one, once the other */
            tick(&r, 1.0);
            assert_int_equal(r.out->n_vectors, 1);
            mark[n] = r.out->vector[0].value[1]; /* behind that of the dimensions */
            unmake(&r);
        }
        assert_near(mark[1], mark[0], 0.0);
        assert_true(mark[2] < mark[0] || mark[2] > mark[0]);
    }
}
#endif

static void the_predictor_refuses_what_it_cannot_work_with(void **state)
{
    static const double wrong[][3] = {{1, 0, 1}, {1, 1, -1}, {1, 1, 1e6}};
    struct apc_setting setting = {"model", NULL, 1, 3, NULL};
    const struct apc_law *law;
    void *handle;
    struct apc_controller_options o = {
        .size = sizeof(o), .dim = {1, 1, 1, 0}, .period = 2 * S, .horizon = 7 * S, .setting = &setting};
    struct apc_controller *c;
    struct apc_error why = {""};

    (void)state;
    assert_int_equal(apc_law_find(path_of("smith", 0), &law, &handle, &why), 0);
    o.law = law;
    assert_int_equal(apc_controller_create(&c, &o, &why), APC_EINVAL);
    assert_non_null(strstr(why.text, "model = [gain, tau, dead time]"));
    o.n_setting = 1;
    for (size_t i = 0; i < 3; i++) {
        setting.value = wrong[i];
        assert_int_equal(apc_controller_create(&c, &o, &why), APC_EINVAL);
    }
    setting.value = wrong[0];
    setting.columns = 2;
    assert_int_equal(apc_controller_create(&c, &o, &why), APC_EINVAL);
    setting = smith_setting;
    o.dim.nz = 0;
    assert_int_equal(apc_controller_create(&c, &o, &why), APC_EINVAL);
    assert_non_null(strstr(why.text, "a setpoint for each output"));
    o.dim = (struct apc_dim){2, 2, 2, 0}; /* and one row of settings */
    assert_int_equal(apc_controller_create(&c, &o, &why), APC_EINVAL);
    assert_non_null(strstr(why.text, "a row for each output"));
    apc_plugin_close(handle);
}

/* Promise(laws): A plug-in of a former layout is refused, saying what to do. */
static void a_plugin_of_a_former_layout_is_refused_with_what_to_do(void **state)
{
    static const char *const former[] = {"old_law_1", "old_law_2"};
    const struct apc_law *law;
    void *handle;

    (void)state;
    for (size_t i = 0; i < 2; i++) {
        struct apc_error why = {""};

        assert_int_equal(apc_law_find(path_of(former[i], 0), &law, &handle, &why), APC_EINVAL);
        assert_null(law);
        assert_null(handle);
        assert_non_null(strstr(why.text, former[i]));
        assert_non_null(strstr(why.text, i ? "compiled for version 2" : "compiled for version 1"));
        assert_non_null(strstr(why.text, "compile it again"));
    }
}

static void a_users_plant_is_loaded_and_runs_to_its_equilibrium(void **state)
{
    const double inflow = 0.05, level = inflow * inflow / (2.0 * 9.81 * 0.019 * 0.019);
    const struct apc_model *own;
    void *handle;
    struct apc_plant *plant;
    struct apc_error why = {""};

    (void)state;
    for (size_t flavour = 0; flavour < FLAVOURS; flavour++) {
        double y = 0.0;

        if (apc_model_find(path_of("myplant", flavour), &own, &handle, &why) < 0)
            fail_msg("%s", why.text);
        assert_int_equal(apc_plant_create(&plant, own, NULL, NULL, NULL, &why), 0);
        for (int k = 0; k < 1000; k++)
            assert_int_equal(apc_plant_advance(plant, 1.0, &inflow), 0);
        apc_plant_output(plant, &inflow, &y);
        assert_near(y, level, 1e-6);
        apc_plant_destroy(plant);
        apc_plugin_close(handle);
    }
}

static void a_shared_object_of_another_kind_is_refused_by_name(void **state)
{
    const struct apc_law *law;
    const struct apc_model *own;
    void *handle;
    struct apc_error why = {""};

    (void)state;
    assert_int_equal(apc_law_find(APC_EXAMPLES_DIR "/myplant.so", &law, &handle, &why), APC_ENOTFOUND);
    assert_null(law);
    assert_null(handle);
    assert_non_null(strstr(why.text, "apc_law"));
    assert_int_equal(apc_model_find(APC_EXAMPLES_DIR "/mylaw.so", &own, &handle, &why), APC_ENOTFOUND);
    assert_null(own);
    assert_non_null(strstr(why.text, "apc_model"));
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(a_users_law_controls_well),
        cmocka_unit_test(a_users_law_with_settings_and_state_predicts),
        cmocka_unit_test(users_laws_go_from_man_to_auto_and_out_of_a_limit_without_a_bump),
#ifdef APC_CPP_EXAMPLES
        cmocka_unit_test(a_plugin_built_otherwise_is_another_law_to_a_stored_state),
#endif
        cmocka_unit_test(the_predictor_refuses_what_it_cannot_work_with),
        cmocka_unit_test(a_plugin_of_a_former_layout_is_refused_with_what_to_do),
        cmocka_unit_test(a_users_plant_is_loaded_and_runs_to_its_equilibrium),
        cmocka_unit_test(a_shared_object_of_another_kind_is_refused_by_name),
    };

    return cmocka_run_group_tests(tests, NULL, NULL);
}

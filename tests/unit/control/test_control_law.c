/* SPDX-License-Identifier: BSD-3-Clause */
#include "laws.h"

#include <stdio.h>
#include <string.h>

static int compute(struct apc_law_call *c)
{
    c->u[0] = 0.0;
    return APC_LAW_GOOD;
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
    for (size_t i = 0; apc_law_built_in(i); i++)
        assert_non_null(strstr(strstr(why.text, "there are: "), apc_law_built_in(i)->name));
}

static void a_missing_shared_object_is_named(void **state)
{
    const struct apc_law *law = &apc_law_pi;
    void *handle = &law;
    struct apc_error why = {""};

    (void)state;
    assert_int_equal(apc_law_find("./no-such-law.so", &law, &handle, &why), APC_ENOTFOUND);
    assert_null(law);
    assert_null(handle);
    assert_non_null(strstr(why.text, "no-such-law.so"));
}

static void a_law_that_cannot_work_is_refused_with_the_reason(void **state)
{
    const struct apc_param upside_down = {"Kp", "", "", 1.0, 5.0, -5.0};
    const struct apc_param not_a_number = {"Kp", "", "", (double)NAN, -5.0, 5.0};
    const struct apc_param fine = {"Kp", "", "", 1.0, -5.0, 5.0};
    const enum apc_law_scope nothing = (enum apc_law_scope)3;
    const struct apc_param nameless = {NULL, "", "", 1.0, -5.0, 5.0};
    const struct apc_law good = {.abi = APC_LAW_ABI, .name = "mine", .compute = compute};
    struct apc_law law = good;
    struct apc_error why = {""};

    (void)state;
    assert_int_equal(apc_law_check(&law, "x.so", &why), 0);
    for (unsigned abi = 0; abi < APC_LAW_ABI + 2; abi++) {
        law.abi = abi;
        if (abi == APC_LAW_ABI)
            continue;
        assert_int_equal(apc_law_check(&law, "x.so", &why), APC_EINVAL);
        assert_non_null(strstr(why.text, "compile it again"));
    }
    law = good;
    law.compute = NULL;
    assert_int_equal(apc_law_check(&law, "x.so", &why), APC_EINVAL);
    assert_non_null(strstr(why.text, "compute"));
    law = good;
    law.name = "";
    assert_int_equal(apc_law_check(&law, "x.so", &why), APC_EINVAL);
    law = good;
    law.whole = true;
    law.estimates = true;
    assert_int_equal(apc_law_check(&law, "x.so", &why), 0);
    law.selects = true;
    assert_int_equal(apc_law_check(&law, "x.so", &why), APC_EINVAL);
    assert_has(why.text, "is whole, so it cannot be one that selects");
    law.whole = false;
    assert_int_equal(apc_law_check(&law, "x.so", &why), APC_EINVAL);
    assert_has(why.text, "is not whole, so it cannot be one that estimates");
    law.estimates = false;
    assert_int_equal(apc_law_check(&law, "x.so", &why), 0);
    assert_int_equal(apc_law_find("pi", NULL, NULL, &why), APC_EINVAL);
    assert_has(why.text, "law must not be NULL");
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
    law.tuning = &fine;
    assert_int_equal(apc_law_check(&law, "x.so", &why), 0);
    law.scope = &nothing;
    assert_int_equal(apc_law_check(&law, "x.so", &why), APC_EINVAL);
    assert_non_null(strstr(why.text, "scope 3"));
}

/* ---- A whole set of tuning ------------------------------------------------------------------- */

static size_t parameter(const struct apc_law *law, const char *name)
{
    size_t i = 0;

    while (i < law->n_tuning && strcmp(law->tuning[i].name, name) != 0)
        i++;
    assert_in_range(i, 0, law->n_tuning - 1);
    return i;
}

/* Promise(laws/tuning-taken-set) */
static void the_built_in_laws_refuse_crossed_limits_of_any_output(void **state)
{
    static const struct {
        const struct apc_law *law;
        const char *low, *high;
    } of[] = {{&apc_law_pi, "u_min", "u_max"},
              {&apc_law_pid, "u_min", "u_max"},
              {&apc_law_cascade, "outer_u_min", "outer_u_max"},
              {&apc_law_cascade, "inner_u_min", "inner_u_max"},
              {&apc_law_lqg, "u_min", "u_max"}};
    static const double A[] = {-1, 0, 0, -2}, one[] = {1, 0, 0, 1, 1, 0, 0, 1}, zero[8];
    static const struct apc_law_plant plant = {
        .nx = 2, .A = A, .B = one, .C = one, .D = zero, .x0 = zero, .u0 = zero, .y0 = zero};
    const struct apc_law_setup setup = {.dim = {4, 2, 2, 0}, .Ts = 1.0, .plant = &plant};

    (void)state;
    for (size_t i = 0; i < sizeof(of) / sizeof(of[0]); i++) {
        const struct apc_law *law = of[i].law;
        const size_t n = law->n_tuning, low = parameter(law, of[i].low), high = parameter(law, of[i].high);

        for (size_t output = 0; output < 2; output++) {
            double tuning[64];
            struct apc_error why = {""};

            assert_in_range(2 * n, 1, 64);
            for (size_t k = 0; k < 2 * n; k++)
                tuning[k] = law->tuning[k % n].initial;
            assert_int_equal(apc_law_try(law, &setup, tuning, &why), 0);
            tuning[output * n + low] = tuning[output * n + high] = 5.0; /* it may be held fast */
            assert_int_equal(apc_law_try(law, &setup, tuning, &why), 0);
            tuning[output * n + high] = 4.9;
            assert_int_equal(apc_law_try(law, &setup, tuning, &why), APC_ERANGE);
            assert_non_null(strstr(why.text, output ? "output 2" : "output 1"));
            assert_non_null(strstr(why.text, of[i].low));
            assert_non_null(strstr(why.text, of[i].high));
        }
    }
}

/* What a loop does that nobody tuned, and what it may be tuned to, must not change with a new version. */
static void a_parameter_of_which_nothing_is_said_has_its_initial_value_and_limits(void **state)
{
    static const struct apc_law *const laws[] = {&apc_law_pi, &apc_law_pid, &apc_law_cascade, &apc_law_lqg};
    static const char *const tables[] = {
        "Kp 0.2 (-1000000 to 1000000)\n"
        "tau_i 10 (1e-06 to 1000000000)\n"
        "u_bar 0 (-1000000000 to 1000000000)\n"
        "u_min -1000000000 (-1000000000 to 1000000000)\n"
        "u_max 1000000000 (-1000000000 to 1000000000)\n",
        "Kp 1 (-1000000 to 1000000)\n"
        "tau_i 10 (0 to 1000000000)\n"
        "tau_d 0 (0 to 1000000000)\n"
        "N 10 (1 to 1000000)\n"
        "b 1 (0 to 10)\n"
        "c 0 (0 to 10)\n"
        "tau_t 0 (0 to 1000000000)\n"
        "u_bar 0 (-1000000000 to 1000000000)\n"
        "u_min -1000000000 (-1000000000 to 1000000000)\n"
        "u_max 1000000000 (-1000000000 to 1000000000)\n"
        "du_max 0 (0 to 1000000000)\n"
        "Kff 0 (-1000000 to 1000000)\n",
        "outer_Kp 1 (-1000000 to 1000000)\n"
        "outer_tau_i 10 (0 to 1000000000)\n"
        "outer_tau_d 0 (0 to 1000000000)\n"
        "outer_N 10 (1 to 1000000)\n"
        "outer_b 1 (0 to 10)\n"
        "outer_c 0 (0 to 10)\n"
        "outer_tau_t 0 (0 to 1000000000)\n"
        "outer_u_bar 0 (-1000000000 to 1000000000)\n"
        "outer_u_min -1000000000 (-1000000000 to 1000000000)\n"
        "outer_u_max 1000000000 (-1000000000 to 1000000000)\n"
        "outer_du_max 0 (0 to 1000000000)\n"
        "inner_Kp 1 (-1000000 to 1000000)\n"
        "inner_tau_i 10 (0 to 1000000000)\n"
        "inner_tau_d 0 (0 to 1000000000)\n"
        "inner_N 10 (1 to 1000000)\n"
        "inner_b 1 (0 to 10)\n"
        "inner_c 0 (0 to 10)\n"
        "inner_tau_t 0 (0 to 1000000000)\n"
        "inner_u_bar 0 (-1000000000 to 1000000000)\n"
        "inner_u_min -1000000000 (-1000000000 to 1000000000)\n"
        "inner_u_max 1000000000 (-1000000000 to 1000000000)\n"
        "inner_du_max 0 (0 to 1000000000)\n",
        "u_min -1000000000 (-1000000000 to 1000000000)\n"
        "u_max 1000000000 (-1000000000 to 1000000000)\n"
        "tau_b 10 (0 to 1000000000)\n"
        "du_max 0 (0 to 1000000000)\n",
    };

    (void)state;
    for (size_t i = 0; i < sizeof(laws) / sizeof(laws[0]); i++) {
        char text[1500] = "";
        size_t used = 0;

        for (size_t k = 0; k < laws[i]->n_tuning && used < sizeof(text); k++) {
            const struct apc_param *p = &laws[i]->tuning[k];

            used += (size_t)snprintf(text + used, sizeof(text) - used, "%s %.15g (%.15g to %.15g)\n", p->name,
                                     p->initial, p->low, p->high);
        }
        assert_in_range(used, 1, sizeof(text) - 1);
        assert_string_equal(text, tables[i]);
    }
}

static void a_parameter_outside_its_limits_is_refused_by_name(void **state)
{
    const struct apc_law_setup setup = {.dim = {2, 2, 2, 0}, .Ts = 1.0};
    double tuning[10];
    struct apc_error why = {""};

    (void)state;
    for (size_t k = 0; k < 10; k++)
        tuning[k] = apc_law_pi.tuning[k % 5].initial;
    for (size_t k = 0; k < 10; k++) { /* whichever it is */
        const double own = tuning[k];

        tuning[k] = 2e9;
        assert_int_equal(apc_law_try(&apc_law_pi, &setup, tuning, &why), APC_ERANGE);
        assert_non_null(strstr(why.text, apc_law_pi.tuning[k % 5].name));
        assert_non_null(strstr(why.text, k < 5 ? "output 1" : "output 2"));
        tuning[k] = own;
    }
    tuning[6] = -1.0;
    assert_int_equal(apc_law_try(&apc_law_pi, &setup, tuning, &why), APC_ERANGE);
    assert_non_null(strstr(why.text, "tau_i of output 2"));
    tuning[6] = (double)NAN;
    assert_int_equal(apc_law_try(&apc_law_pi, &setup, tuning, &why), APC_ERANGE);
}

static void a_setting_that_a_law_does_not_know_is_refused_by_name(void **state)
{
    static const double one = 1.0;
    const struct apc_setting setting[] = {{"measurement", NULL, 1, 1, &one},
                                          {"measurements", NULL, 1, 1, &one}};
    struct apc_law_setup setup = {.dim = {1, 1, 1, 0}, .Ts = 1.0, .n_setting = 1, .setting = setting};
    struct apc_error why = {""};

    (void)state;
    assert_int_equal(apc_law_try(&apc_law_pid, &setup, NULL, &why), 0);
    assert_int_equal(apc_law_try(&apc_law_pi, &setup, NULL, &why), APC_EINVAL); /* it has none at all */
    setup.n_setting = 2;
    assert_int_equal(apc_law_try(&apc_law_pid, &setup, NULL, &why), APC_EINVAL);
    assert_non_null(strstr(why.text, "law pid has no setting \"measurements\""));
}

/* ---- Pairing --------------------------------------------------------------------------------- */

static void assert_pairs(const struct apc_law *law, const struct apc_law_setup *setup,
                         const struct apc_pair *expected)
{
    struct apc_pair pair[2] = {{9, 9}, {9, 9}};
    struct apc_error why = {""};

    if (apc_law_pairing(law, setup, pair, &why) < 0)
        fail_msg("%s: %s", law->name, why.text);
    for (size_t i = 0; i < setup->dim.nu; i++) {
        assert_int_equal(pair[i].measurement, expected[i].measurement);
        assert_int_equal(pair[i].setpoint, expected[i].setpoint);
    }
}

/* Promise(laws/pairing-stands-shared) */
static void a_law_that_says_nothing_is_paired_in_order(void **state)
{
    const struct apc_law law = {.abi = APC_LAW_ABI, .name = "mine", .compute = compute};
    const struct apc_law_setup square = {.dim = {2, 2, 2, 0}}, wide = {.dim = {1, 1, 2, 0}},
                               free = {.dim = {2, 0, 2, 0}};

    (void)state;
    assert_pairs(&law, &square, (struct apc_pair[]){{1, 1}, {2, 2}});
    assert_pairs(&law, &wide, (struct apc_pair[]){{1, 1}, {1, 1}});
    assert_pairs(&law, &free, (struct apc_pair[]){{1, 0}, {2, 0}});
}

static void the_built_in_laws_are_paired_by_their_settings(void **state)
{
    static const double swapped[] = {2, 1}, same[] = {1, 1}, outer[] = {4, 2}, inner[] = {3, 1};
    static const double A[] = {-1, 0, 0, -2}, one[] = {1, 0, 0, 1}, zero[4];
    const struct apc_law_plant plant = {
        .nx = 2, .A = A, .B = one, .C = one, .D = zero, .x0 = zero, .u0 = zero, .y0 = zero};
    const struct apc_setting pid[] = {{"measurement", NULL, 1, 2, swapped}, {"setpoint", NULL, 1, 2, same}};
    const struct apc_setting cascade[] = {
        {"outer", NULL, 1, 2, outer}, {"inner", NULL, 1, 2, inner}, {"setpoint", NULL, 1, 2, swapped}};
    struct apc_law_setup setup = {.dim = {2, 2, 2, 0}, .Ts = 1.0, .setting = pid};

    (void)state;
    assert_pairs(&apc_law_pi, &setup, (struct apc_pair[]){{1, 1}, {2, 2}});
    assert_pairs(&apc_law_pid, &setup, (struct apc_pair[]){{1, 1}, {2, 2}});
    setup.n_setting = 1; /* the setpoint's number is the measurement's */
    assert_pairs(&apc_law_pid, &setup, (struct apc_pair[]){{2, 2}, {1, 1}});
    setup.n_setting = 2;
    assert_pairs(&apc_law_pid, &setup, (struct apc_pair[]){{2, 1}, {1, 1}});
    setup.n_setting = 1;
    setup.plant = &plant; /* lqg: which measurement each setpoint is for */
    assert_pairs(&apc_law_lqg, &setup, (struct apc_pair[]){{2, 1}, {1, 2}});
    setup = (struct apc_law_setup){.dim = {4, 2, 2, 0}, .Ts = 1.0, .n_setting = 3, .setting = cascade};
    assert_pairs(&apc_law_cascade, &setup, (struct apc_pair[]){{4, 2}, {2, 1}});
}

static int beyond(const struct apc_law_setup *setup, size_t output, struct apc_law_ports *p,
                  struct apc_error *why)
{
    const double *at = setup->setting->value;

    (void)why;
    if (output + 1 < setup->dim.nu)
        return 0;
    p->ny = (size_t)at[2];
    p->nz = p->nd = 1;
    p->y[0] = (int)at[0];
    p->z[0] = (int)at[1];
    return 0;
}

/* Promise(laws/pairing-stands-shared) */
static void ports_to_what_there_is_not_are_refused(void **state)
{
    static const char *const known[] = {"ports", NULL};
    const struct apc_law law = {
        .abi = APC_LAW_ABI, .name = "mine", .compute = compute, .settings = known, .ports = beyond};
    static const struct {
        double at[3];
        const char *what;
    } of[] = {{{-1, 0, 1}, "measurement 0, but there are 2"}, {{2, 0, 1}, "measurement 3, but there are 2"},
              {{0, 1, 1}, "setpoint 2, but there are 1"},     {{0, -1, 1}, "setpoint 0, but there are 1"},
              {{0, 0, 17}, "17 measurements; 16 at most"},    {{0, 0, 1}, "disturbance 2, but there are 0"}};
    struct apc_setting setting = {"ports", NULL, 1, 3, NULL};
    struct apc_law_setup setup = {.dim = {2, 1, 2, 0}, .Ts = 1.0, .n_setting = 1, .setting = &setting};
    struct apc_pair pair[2];
    struct apc_error why = {""};

    (void)state;
    for (size_t i = 0; i < sizeof(of) / sizeof(of[0]); i++) {
        setting.value = of[i].at;
        assert_int_equal(apc_law_pairing(&law, &setup, pair, &why), APC_EINVAL);
        assert_non_null(strstr(why.text, "output 2"));
        if (!strstr(why.text, of[i].what))
            fail_msg("%s", why.text);
        assert_int_equal(apc_law_try(&law, &setup, NULL, &why), APC_EINVAL);
    }
    setup.dim.nd = 2;
    assert_int_equal(apc_law_try(&law, &setup, NULL, &why), 0);
}

static void a_law_that_refuses_its_settings_has_no_pairs(void **state)
{
    static const double three[] = {3, 1};
    const struct apc_setting unknown = {"measurement", NULL, 1, 2, three};
    const struct apc_law_setup setup = {.dim = {2, 2, 2, 0}, .n_setting = 1, .setting = &unknown};
    struct apc_pair pair[2];
    struct apc_error why = {""};

    (void)state;
    assert_int_equal(apc_law_pairing(&apc_law_pid, &setup, pair, &why), APC_EINVAL);
    assert_int_equal(apc_law_pairing(&apc_law_lqg, &setup, pair, &why), APC_EINVAL); /* and has no model */
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(the_built_in_laws_are_found_by_name),
        cmocka_unit_test(an_unknown_name_is_answered_with_the_names_there_are),
        cmocka_unit_test(a_missing_shared_object_is_named),
        cmocka_unit_test(a_law_that_cannot_work_is_refused_with_the_reason),
        cmocka_unit_test(the_built_in_laws_refuse_crossed_limits_of_any_output),
        cmocka_unit_test(a_parameter_of_which_nothing_is_said_has_its_initial_value_and_limits),
        cmocka_unit_test(a_parameter_outside_its_limits_is_refused_by_name),
        cmocka_unit_test(a_setting_that_a_law_does_not_know_is_refused_by_name),
        cmocka_unit_test(a_law_that_says_nothing_is_paired_in_order),
        cmocka_unit_test(the_built_in_laws_are_paired_by_their_settings),
        cmocka_unit_test(ports_to_what_there_is_not_are_refused),
        cmocka_unit_test(a_law_that_refuses_its_settings_has_no_pairs),
    };

    return cmocka_run_group_tests(tests, NULL, NULL);
}

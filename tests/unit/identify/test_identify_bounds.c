/* SPDX-License-Identifier: BSD-3-Clause */
/* What identification, tuning and test signals are asked for, bound by bound: the last value that makes sense
 * is taken, the first one that does not is refused, with a sentence that names it and nothing made.
 */
#include "apcexcite.h"
#include "apcplant.h"
#include "apctune.h"
#include "check.h"
#include "records.h"

#include <stdlib.h>

#define SAMPLES 240

static struct record_test *t;
static struct apc_error why;

static void judge(int rc, const char *part)
{
    if (part ? rc != APC_EINVAL || !strstr(why.text, part) : rc < 0)
        fail_msg("%s, \"%s\" instead of \"%s\"", apc_err_name(rc), why.text, part ? part : "");
    why.text[0] = '\0';
}

static int set_up(void **state)
{
    static const struct apc_transfer g[] = {{.gain = 2.0, .tau = {1.0}, .dead_time = 0.4},
                                            {.gain = -1.0, .tau = {0.5}}};
    (void)state;
    t = record_simulate(g, 2, 1, SAMPLES, 0.25, (const size_t[]){11, 15}, 0.05, 0.0, 1);
    return 0;
}

static int tear_down(void **state)
{
    (void)state;
    free(t);
    return 0;
}

static void transfer(struct apc_identify_transfer_options o, const char *part)
{
    struct apc_transfer g[2], error[2];
    double u0[2], y0[1];

    judge(apc_identify_transfer(&t->record, &o, g, error, u0, y0, NULL, &why), part);
}

static void transfer_functions_have_bounds(void **state)
{
    static const char *const part = "the order must be 1, 2, or 0 to be found";
    const size_t size = sizeof(struct apc_identify_transfer_options);
    const double half = SAMPLES / 2 * 0.25;
    (void)state;
#define TRANSFER(...) (struct apc_identify_transfer_options){__VA_ARGS__}
    transfer(TRANSFER(.order = 1), "size is 0");
    transfer(TRANSFER(size, .order = 3), part);
    transfer(TRANSFER(size, .order = 1, .dead_time_max = -1e-9), part);
    transfer(TRANSFER(size, .order = 1, .dead_time_max = (double)NAN), part);
    transfer(TRANSFER(size, .order = 1, .dead_time_max = nextafter(half, 1e9)), part);
    transfer(TRANSFER(size, .order = 1, .dead_time_max = half), NULL);
    transfer(TRANSFER(size, .order = 1, .integrating = (enum apc_identify_integrating)3), part);
}

static void arx(struct apc_identify_arx_options o, const char *part)
{
    struct apc_identified *m = (struct apc_identified *)t;
    const int rc = apc_identify_arx(&m, &t->record, &o, &why);

    assert_int_equal(m == NULL, rc < 0);
    judge(rc, part);
    apc_identified_destroy(m);
}

static void difference_equations_have_bounds(void **state)
{
    static const char *const part = "no more than a third of the 240 samples of a run, an fir has no na";
    const size_t size = sizeof(struct apc_identify_arx_options);
    (void)state;
#define ARX(...) (struct apc_identify_arx_options){__VA_ARGS__}
    arx(ARX(.na = 1), "size is 0");
    arx(ARX(size, .fir = true, .na = 1, .nb = 4), part);
    arx(ARX(size, .na = 51, .nb = 1, .delay_max = 1), part);
    arx(ARX(size, .na = 50, .nb = 1, .delay_max = 1), NULL);
    arx(ARX(size, .na = 2, .nb = 8, .delay_max = SAMPLES / 3 - 10), "have no gap"); /* too few for so many */
    arx(ARX(size, .na = 2, .nb = 8, .delay_max = SAMPLES / 3 - 9), part);
    arx(ARX(size, .na = 3, .nb = 8, .delay_max = SAMPLES / 3 - 10), part);
    arx(ARX(size, .na = 2, .nb = 9, .delay_max = SAMPLES / 3 - 10), part);
}

/* As the model that it is held against has it: inputs, outputs, period, and enough of it. */
static void records_to_validate_on_have_bounds(void **state)
{
    static const char *const unlike = "validate: the model has 2 inputs, 0 disturbances and 1 outputs",
                             *const period = "validate: the model has a period of 0.25 s",
                             *const few = "samples of output 1 to validate on; 20 are the least";
    const struct apc_record good = t->record;
    struct apc_identified *m;
    struct apc_validation v;
    (void)state;
    assert_int_equal(apc_identify_arx(&m, &good, NULL, &why), 0);
#define VALIDATED(change, from, part)                                                                        \
    do {                                                                                                     \
        t->record = good;                                                                                    \
        change;                                                                                              \
        judge(apc_validate(m->linear, m->K, &t->record, from, &v, NULL, &why), part);                        \
    } while (0)
    VALIDATED((void)0, 0, NULL);
    VALIDATED(t->record.size = 0, 0, "size is 0");
    VALIDATED(t->record.nu = 1, 0, unlike);
    VALIDATED(t->record.nd = 1, 0, unlike);
    VALIDATED(t->record.ny = 2, 0, unlike);
    VALIDATED((t->record.nu = 1, t->record.nd = 1), 0, unlike);
    VALIDATED(t->record.Ts *= 1 + 2e-6, 0, period);
    VALIDATED(t->record.Ts *= 1 - 2e-6, 0, period);
    VALIDATED(t->record.Ts *= 1 + 0.5e-6, 0, NULL);
    VALIDATED((void)0, SAMPLES - 19, few);
    VALIDATED((void)0, SAMPLES - 20, NULL);
    for (size_t k = SAMPLES - 40; k < SAMPLES; k += 2)
        t->y[k] = (double)NAN; /* twenty of the last forty */
    VALIDATED((void)0, SAMPLES - 40, NULL);
    VALIDATED((void)0, SAMPLES - 38, few);
    apc_identified_destroy(m);
}

static void what_is_sought_of_a_model_has_bounds(void **state)
{
    static const size_t first[] = {0, 1, 0}, beyond[] = {1, 3}, only[] = {0};
    struct apc_param fixed[2];
    struct apc_model model;
    const struct apc_model *known;
    double value[3], error[3];
    void *handle;
    (void)state;
    assert_int_equal(apc_model_find("first-order", &known, &handle, NULL), 0);
    assert_int_equal(known->np, 2);
    const struct apc_parameters good = {.size = sizeof good, .model = known, .which = first, .n = 2};
    struct apc_parameters o = good;
    t->record.nu = 1;
    t->record.n = SAMPLES / 2;
#define SOUGHT(change, part)                                                                                 \
    do {                                                                                                     \
        o = good;                                                                                            \
        change;                                                                                              \
        judge(apc_identify_parameters(&t->record, &o, value, error, NULL, NULL, &why), part);                \
    } while (0)
    SOUGHT(o.size = 0, "size is 0");
    SOUGHT(o.which = NULL, "parameters: none is sought");
    SOUGHT(o.n = 0, "parameters: none is sought");
    SOUGHT(o.n = 3, "parameters: one is sought twice");
    SOUGHT(o.which = beyond, "parameters: first-order has no parameter 4");
    SOUGHT(o.input = (const size_t[]){1}, "parameters: first-order has no input 1");
    SOUGHT(o.output = (const size_t[]){1}, "parameters: first-order has no output 1");
    model = *known;
    fixed[0] = known->param[0];
    fixed[1] = known->param[1];
    fixed[0].low = fixed[0].high = fixed[0].initial;
    model.param = fixed;
    SOUGHT((o.model = &model, o.which = only, o.n = 1), "can be nothing but");
    model.param = NULL;
    SOUGHT((o.model = &model, o.which = only, o.n = 1), "has no parameter 1");
    t->record.nu = 2;
    SOUGHT((void)0, "parameters: first-order has no input 2");
    for (size_t k = 0; k < SAMPLES; k++)
        t->y[k] = 4.0;
    t->record.nu = 1;
    SOUGHT((void)0, "output 1 is the same all the time, or not there: leave it out");
}

static void multisines_have_bounds(void **state)
{
    static const struct {
        size_t first, last, every, n;
        int rc;
    } of[] = {{0, 5, 1, 64, APC_EINVAL}, {6, 5, 1, 64, APC_EINVAL}, {5, 5, 1, 64, 0},
              {1, 5, 0, 64, APC_EINVAL}, {1, 31, 1, 64, 0},         {1, 32, 1, 64, APC_EINVAL},
              {1, 1, 1, 4, 0},           {1, 1, 1, 3, APC_EINVAL},  {1, 2, 1, 4, APC_EINVAL}};
    double u[64], crest;
    (void)state;
    for (size_t i = 0; i < sizeof of / sizeof *of; i++)
        assert_int_equal(apc_excite_multisine(of[i].first, of[i].last, of[i].every, u, of[i].n, &crest),
                         of[i].rc);
    assert_int_equal(apc_excite_multisine(1, 5, 1, u, 64, NULL), 0); /* not everybody asks for its crest */
}

static void a_relay_switches_beyond_its_hysteresis(void **state)
{
    struct apc_relay r = {.hysteresis = 0.5};
    (void)state;
    assert_near(apc_relay_step(&r, 0.0, (double)NAN), 1.0, 0.0); /* before anything was put out */
    assert_near(apc_relay_step(&r, 1.0, 0.0), 1.0, 0.0);
    assert_near(apc_relay_step(&r, 2.0, -0.5), 1.0, 0.0);
    assert_near(apc_relay_step(&r, 3.0, nextafter(-0.5, -1.0)), -1.0, 0.0);
    assert_near(apc_relay_step(&r, 4.0, (double)NAN), -1.0, 0.0);
    assert_near(apc_relay_step(&r, 5.0, 0.5), -1.0, 0.0);
    assert_near(apc_relay_step(&r, 6.0, nextafter(0.5, 1.0)), 1.0, 0.0);
    assert_near(r.since, 6.0, 0.0);
    assert_near(r.period[0], 0.0, 0.0); /* the first one was no whole oscillation */
    r = (struct apc_relay){.hysteresis = 0.5};
    assert_near(apc_relay_step(&r, 0.0, -1e-9), -1.0, 0.0);
}

/* Of an oscillation that dies down each has its own amplitude, and settled is what two have alike. */
static void a_relay_measures_each_oscillation_by_itself(void **state)
{
    static const double size[] = {8.0, 4.0, 2.0, 1.96};
    struct apc_relay r = {.hysteresis = 0.1};
    (void)state;
    for (int k = 0; k < 4; k++) {
        apc_relay_step(&r, 10.0 * k, 0.2);
        apc_relay_step(&r, 10.0 * k + 2.0, size[k]);
        apc_relay_step(&r, 10.0 * k + 6.0, -size[k]);
        assert_int_equal(apc_relay_settled(&r), false);
    }
    apc_relay_step(&r, 40.0, 0.2);
    assert_near(r.amplitude[0], 1.96, 1e-12);
    assert_near(r.amplitude[1], 2.0, 1e-12);
    assert_near(r.period[0], 10.0, 1e-12);
    assert_near(r.period[1], 10.0, 1e-12);
    assert_true(apc_relay_settled(&r));
}

static void only_what_is_late_has_a_limit_of_its_gain(void **state)
{
    const struct apc_transfer quick = {.gain = 1.0, .tau = {1.0}}, none = {.gain = 0.0, .tau = {1.0}},
                              late = {.gain = -1.0, .tau = {1.0}, .dead_time = 0.1};
    double gain = 0.0, every;
    (void)state;
    judge(apc_tune_limit(&quick, 0.0, &gain, &every, &why),
          "no gain makes this loop oscillate: it has no dead time");
    judge(apc_tune_limit(&quick, 0.1, &gain, &every, &why), NULL); /* a period is as half of it late */
    assert_true(gain > 1.0);
    judge(apc_tune_limit(&late, 0.0, &gain, &every, &why), NULL);
    assert_true(gain < -1.0);
    assert_int_equal(apc_tune_limit(&none, 0.1, &gain, &every, &why), APC_EINVAL);
}

#define T(test) cmocka_unit_test_setup_teardown(test, set_up, tear_down)

int main(void)
{
    const struct CMUnitTest tests[] = {
        T(transfer_functions_have_bounds),
        T(difference_equations_have_bounds),
        T(records_to_validate_on_have_bounds),
        T(what_is_sought_of_a_model_has_bounds),
        cmocka_unit_test(multisines_have_bounds),
        cmocka_unit_test(a_relay_switches_beyond_its_hysteresis),
        cmocka_unit_test(a_relay_measures_each_oscillation_by_itself),
        cmocka_unit_test(only_what_is_late_has_a_limit_of_its_gain),
    };

    return cmocka_run_group_tests(tests, NULL, NULL);
}

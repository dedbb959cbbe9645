/* SPDX-License-Identifier: BSD-3-Clause */
/* No memory for what is made of a record, at each place that asks for some: it is said, no model is there,
 * and nothing is left behind.
 */
#include "apcexcite.h"
#include "apctune.h"
#include "check.h"

#include <stdio.h>

#include "nomem.h"
#include "records.h"

static struct record_test *t;
static struct apc_error why;
static size_t most_rows;

static int check(void)
{
    return apc_record_check(&t->record, &why);
}

static int excitation(void)
{
    const int order = apc_record_excitation(&t->record, 0);
    return order < 0 ? order : order > 5 ? 0 : -100;
}

static int transfer(void)
{
    struct apc_transfer g[2], error[2];
    double u0[2], y0[1];
    const struct apc_identify_transfer_options options = {
        .size = sizeof options, .order = 1, .dead_time_max = 1.0};
    return apc_identify_transfer(&t->record, &options, g, error, u0, y0, NULL, &why);
}

static int keep(struct apc_identified *m, int rc)
{
    if ((rc == 0) != (m != NULL))
        fail_msg("%s, and a model is%s there", apc_err_name(rc), m ? "" : " not");
    apc_identified_destroy(m);
    return rc;
}

static int arx(void)
{
    struct apc_identified *m = (struct apc_identified *)t;
    const int rc = apc_identify_arx(&m, &t->record, NULL, &why);
    return keep(m, rc);
}

static int fir(void)
{
    const struct apc_identify_arx_options options = {.size = sizeof options, .fir = true, .nb = 20};
    struct apc_identified *m = (struct apc_identified *)t;
    const int rc = apc_identify_arx(&m, &t->record, &options, &why);
    return keep(m, rc);
}

static int subspace(void)
{
    const struct apc_identify_subspace_options options = {.size = sizeof options, .rows = most_rows};
    struct apc_identified *m = (struct apc_identified *)t;
    const int rc = apc_identify_subspace(&m, &t->record, &options, &why);
    return keep(m, rc);
}

static int of_order(void)
{
    const struct apc_identify_subspace_options options = {
        .size = sizeof options, .rows = most_rows, .order = 2, .direct = true, .deviations = true};
    struct apc_identified *m = (struct apc_identified *)t;
    const int rc = apc_identify_subspace(&m, &t->record, &options, &why);
    return keep(m, rc);
}

static struct apc_identified *model;

static int validate(void)
{
    struct apc_validation v;
    const int rc = apc_validate(model->linear, NULL, &t->record, 50, &v, NULL, &why);
    return rc < 0 ? rc : apc_validate(model->linear, model->K, &t->record, 0, &v, NULL, &why);
}

static int sines(void)
{
    double u[64], crest;
    return apc_excite_multisine(1, 5, 1, u, 64, &crest);
}

static const struct nomem_step steps[] = {
    {"check", check, false},
    {"excitation", excitation, true},
    {"transfer", transfer, false},
    {"arx", arx, false},
    {"fir", fir, false},
    {"subspace", subspace, false},
    {"of order 2", of_order, false},
    {"validate", validate, false},
    {"sines", sines, true},
};

static void each_allocation_may_fail(void **state)
{
    static const struct apc_transfer g[] = {{.gain = 2.0, .tau = {1.0}, .dead_time = 0.4},
                                            {.gain = -1.0, .tau = {0.5}}};
    (void)state;
    most_rows = 5;
    t = record_simulate(g, 2, 1, 120, 0.2, (const size_t[]){5, 7}, 0.05, 0.5, 1);
    assert_int_equal(apc_identify_arx(&model, &t->record, NULL, NULL), 0);
    for (size_t i = 0; i < sizeof steps / sizeof *steps; i++)
        nomem_each(&steps[i], 20, 199, &why); /* a search asks for the same again and again */
    apc_identified_destroy(model);
    free(t);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(each_allocation_may_fail),
    };

    return cmocka_run_group_tests(tests, NULL, NULL);
}

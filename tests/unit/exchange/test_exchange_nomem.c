/* SPDX-License-Identifier: BSD-3-Clause */
/* No memory for a way to a plant, or for the plant's own side, at each place that asks for some: it is said,
 * nothing is there, and nothing is left behind.
 */
#include "apcexchange.h"
#include "check.h"

#include <stdio.h>

#include "nomem.h"

enum { N = 2 };

static struct apc_error why;
static const struct apc_modbus_point u[N] = {
    {.area = APC_MODBUS_HOLDING, .type = APC_MODBUS_U16, .address = 0},
    {.area = APC_MODBUS_COIL, .type = APC_MODBUS_BIT, .address = 1}};
static const struct apc_modbus_point y[N] = {
    {.area = APC_MODBUS_INPUT, .type = APC_MODBUS_F32, .address = 0},
    {.area = APC_MODBUS_INPUT, .type = APC_MODBUS_F32, .address = 2}};
static const struct apc_modbus_options map = {.size = sizeof map, .unit = 255, .u = u, .y = y};

static int command(void *ctx, const double *values, bool sign)
{
    (void)ctx, (void)values, (void)sign;
    return 0;
}

static unsigned measure(void *ctx, struct apc_value *values)
{
    (void)ctx, (void)values;
    return 0;
}

static int open_uri(const char *uri)
{
    const struct apc_exchange_options options = {.size = sizeof options, .nu = N, .ny = N, .modbus = &map};
    struct apc_exchange *x = (struct apc_exchange *)&why;
    const int rc = apc_exchange_open(&x, uri, &options, &why);
    assert_int_equal(rc == 0, x != NULL);
    apc_exchange_close(x);
    return rc;
}

static int tcp(void)
{
    return open_uri("tcp:127.0.0.1:4840");
}

static int modbus(void)
{
    return open_uri("modbus:127.0.0.1:502");
}

static int serial(void)
{
    return open_uri("serial:/dev/null");
}

static int unit(void)
{
    const struct apc_modbus_unit_options options = {
        .size = sizeof options, .nu = N, .ny = N, .modbus = &map, .command = command, .measure = measure};
    struct apc_modbus_unit *made = (struct apc_modbus_unit *)&why;
    const int rc = apc_modbus_unit_create(&made, &options, &why);
    assert_int_equal(rc == 0, made != NULL);
    apc_modbus_unit_destroy(made);
    return rc;
}

static int board(void)
{
    const struct apc_tclab_options options = {
        .size = sizeof options, .nu = N, .ny = N, .command = command, .measure = measure};
    struct apc_tclab *made = (struct apc_tclab *)&why;
    const int rc = apc_tclab_create(&made, &options, &why);
    assert_int_equal(rc == 0, made != NULL);
    apc_tclab_destroy(made);
    return rc;
}

static void each_allocation_may_fail(void **state)
{
    static const struct nomem_step steps[] = {{"tcp", tcp, false},
                                              {"modbus", modbus, false},
                                              {"serial", serial, false},
                                              {"unit", unit, false},
                                              {"board", board, false}};
    (void)state;
    for (size_t i = 0; i < sizeof steps / sizeof *steps; i++)
        nomem_each(&steps[i], 1, 1, &why);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(each_allocation_may_fail),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}

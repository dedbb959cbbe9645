/* SPDX-License-Identifier: BSD-3-Clause */
/* Options that make no sense are refused by whoever takes them, with their reason, and nothing is there. */
#include "apcexchange.h"
#include "check.h"

enum { N = 2 };

static const struct apc_modbus_point u[N] = {
    {.area = APC_MODBUS_HOLDING, .type = APC_MODBUS_U16, .address = 0},
    {.area = APC_MODBUS_COIL, .type = APC_MODBUS_BIT, .address = 1}};
static const struct apc_modbus_point y[N] = {
    {.area = APC_MODBUS_INPUT, .type = APC_MODBUS_F32, .address = 0},
    {.area = APC_MODBUS_INPUT, .type = APC_MODBUS_F32, .address = 2}};
static const struct apc_modbus_point coil = {.area = APC_MODBUS_COIL, .type = APC_MODBUS_BIT, .address = 9},
                                     signed_word = {
                                         .area = APC_MODBUS_HOLDING, .type = APC_MODBUS_S16, .address = 9};

static struct apc_error why;

static int command(void *ctx, const double *values, bool sign)
{
    (void)ctx, (void)values, (void)sign;
    return 0;
}

static unsigned measure(void *ctx, struct apc_value *values)
{
    for (size_t i = 0; i < *(const size_t *)ctx; i++)
        values[i] = (struct apc_value){.value = 23.456};
    return 0;
}

static struct apc_exchange_options exchange_options(void)
{
    return (struct apc_exchange_options){.size = sizeof(struct apc_exchange_options), .nu = N, .ny = N};
}

static void assert_exchange(const char *uri, const struct apc_exchange_options *options, const char *reason)
{
    struct apc_exchange *x = (struct apc_exchange *)&why;

    assert_int_equal(apc_exchange_open(&x, uri, options, &why), APC_EINVAL);
    assert_null(x);
    assert_has(why.text, reason);
}

static void an_exchange_knows_what_it_is_told(void **state)
{
    struct apc_exchange_options o = exchange_options();
    struct apc_modbus_options map = {.size = sizeof map, .unit = 255, .u = u, .y = y};
    const struct apc_inproc_options inproc = {.size = 1};
    (void)state;

    o.size = 1;
    assert_exchange("tcp:127.0.0.1:4840", &o, "apc_exchange_options: size is 1");
    o = exchange_options();
    o.nu = 0;
    assert_exchange("tcp:127.0.0.1:4840", &o, "");
    o = exchange_options();
    o.ny = 0;
    assert_exchange("tcp:127.0.0.1:4840", &o, "");
    o = exchange_options();
    assert_exchange(NULL, &o, "plant \"\": unknown scheme");
    assert_exchange("udp:127.0.0.1:4840", &o, "plant \"udp:127.0.0.1:4840\": unknown scheme");
    o.inproc = &inproc;
    assert_exchange("inproc:", &o, "apc_inproc_options: size is 1");
    o.inproc = NULL;
    assert_exchange("inproc:", &o, "executive and serve are required");
    assert_exchange("modbus:127.0.0.1:502", &o, "modbus: u and y are required");
    o.modbus = &map;
    map.size = 1;
    assert_exchange("modbus:127.0.0.1:502", &o, "apc_modbus_options: size is 1");
    map.size = sizeof map;
    map.unit = 256;
    assert_exchange("modbus:127.0.0.1:502", &o, "unit is at most 255");
    map.unit = 255;
    map.u = NULL;
    assert_exchange("modbus:127.0.0.1:502", &o, "u and y are required");
    map.u = u;
    map.y = NULL;
    assert_exchange("modbus:127.0.0.1:502", &o, "u and y are required");
    map.y = y;
    map.life = &y[0];
    assert_exchange("modbus:127.0.0.1:502", &o, "life takes a limit above 0");
    map.life = NULL;
    map.watchdogs = (const struct apc_modbus_point[N]){{.area = 0}, coil};
    assert_exchange("modbus:127.0.0.1:502", &o,
                    "the watchdog of output 2 must be a holding register: it counts");
    map.watchdogs = (const struct apc_modbus_point[N]){signed_word, {.area = 0}};
    assert_exchange("modbus:127.0.0.1:502", &o,
                    "the watchdog of output 1 must be a holding register: it counts");
    map.watchdogs = NULL;
    struct apc_exchange *x = NULL;
    assert_int_equal(apc_exchange_open(&x, "modbus:127.0.0.1:502", &o, &why), 0);
    apc_exchange_close(x);
    assert_int_equal(apc_exchange_open(NULL, "tcp:127.0.0.1:4840", &o, &why), APC_EINVAL);
}

static void assert_unit(const struct apc_modbus_unit_options *options, const char *reason)
{
    struct apc_modbus_unit *unit = (struct apc_modbus_unit *)&why;

    assert_int_equal(apc_modbus_unit_create(&unit, options, &why), APC_EINVAL);
    assert_null(unit);
    assert_has(why.text, reason);
}

static void a_unit_knows_what_it_is_told(void **state)
{
    const struct apc_modbus_options map = {.size = sizeof map, .unit = 255, .u = u, .y = y};
    struct apc_modbus_options other = map;
    const struct apc_modbus_unit_options good = {
        .size = sizeof good, .nu = N, .ny = N, .modbus = &map, .command = command, .measure = measure};
    struct apc_modbus_unit_options o = good;
    (void)state;

    o.size = 1;
    assert_unit(&o, "apc_modbus_unit_options: size is 1");
    o = good;
    other.size = 1;
    o.modbus = &other;
    assert_unit(&o, "apc_modbus_options: size is 1");
    other = map;
    other.unit = 256;
    assert_unit(&o, "unit at most 255");
    other = map;
    other.u = NULL;
    assert_unit(&o, "are required");
    other = map;
    other.y = NULL;
    assert_unit(&o, "are required");
    o = good;
    o.nu = 0;
    assert_unit(&o, "nu and ny must be 1 to");
    o = good;
    o.ny = 0;
    assert_unit(&o, "nu and ny must be 1 to");
    o = good;
    o.command = NULL;
    assert_unit(&o, "command and measure are required");
    o = good;
    o.measure = NULL;
    assert_unit(&o, "command and measure are required");
    assert_int_equal(apc_modbus_unit_create(NULL, &good, &why), APC_EINVAL);
}

static void assert_board(const struct apc_tclab_options *options, const char *reason)
{
    struct apc_tclab *board = (struct apc_tclab *)&why;

    assert_int_equal(apc_tclab_create(&board, options, &why), APC_EINVAL);
    assert_null(board);
    assert_has(why.text, reason);
}

static void a_board_has_one_or_two_of_each(void **state)
{
    size_t ny = 1;
    const struct apc_tclab_options good = {
        .size = sizeof good, .nu = 1, .ny = 1, .command = command, .measure = measure, .ctx = &ny};
    struct apc_tclab_options o = good;
    (void)state;

    o.size = 1;
    assert_board(&o, "apc_tclab_options: size is 1");
    for (size_t n = 0; n <= 3; n += 3) {
        o = good;
        o.nu = n;
        assert_board(&o, "one or two heaters and sensors");
        o = good;
        o.ny = n;
        assert_board(&o, "one or two heaters and sensors");
    }
    o = good;
    o.command = NULL;
    assert_board(&o, "command and measure are required");
    o = good;
    o.measure = NULL;
    assert_board(&o, "command and measure are required");
    assert_int_equal(apc_tclab_create(NULL, &good, &why), APC_EINVAL);

    struct apc_tclab *board;
    char reply[32];
    assert_int_equal(apc_tclab_create(&board, &good, &why), 0);
    assert_int_equal(apc_tclab_answer(board, "T1\n", 3, reply, sizeof reply), 7);
    assert_memory_equal(reply, "23.46\r\n", 7);
    assert_int_equal(apc_tclab_answer(board, "T2\n", 3, reply, sizeof reply), 6); /* it has none */
    assert_memory_equal(reply, "0.00\r\n", 6);
    assert_int_equal(apc_tclab_answer(board, "T1\n", 3, reply, 7), APC_ERANGE);
    apc_tclab_destroy(board);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(an_exchange_knows_what_it_is_told),
        cmocka_unit_test(a_unit_knows_what_it_is_told),
        cmocka_unit_test(a_board_has_one_or_two_of_each),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}

/* SPDX-License-Identifier: BSD-3-Clause */
/* The scheme modbus: what stands in which register, and what goes in one request. */
#include "check.h"

#include <float.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include <apcexchange.h>

#include "modbus_peer.h"

#define PATIENCE (20 * APC_NS_PER_S)

struct bench {
    struct modbus_peer peer;
    struct apc_exchange *x;
};

static struct apc_modbus_point point(enum apc_modbus_area area, enum apc_modbus_type type, unsigned address)
{
    return (struct apc_modbus_point){.area = area, .type = type, .address = address};
}

static struct bench *start(size_t nu, size_t ny, struct apc_modbus_options o)
{
    const struct apc_exchange_options options = {.size = sizeof options, .nu = nu, .ny = ny, .modbus = &o};
    struct bench *b = calloc(1, sizeof *b);
    struct apc_error why;
    char uri[64];
    assert_non_null(b);
    o.size = sizeof o;
    modbus_peer_start(&b->peer);
    snprintf(uri, sizeof uri, "modbus:127.0.0.1:%d", b->peer.port);
    if (apc_exchange_open(&b->x, uri, &options, &why) < 0)
        fail_msg("%s", why.text);
    return b;
}

static void end(struct bench *b)
{
    apc_exchange_close(b->x);
    modbus_peer_stop(&b->peer);
    free(b);
}

/* What this side did with the peer's memory is done for the other, and the reverse. */
static void meet(struct bench *b)
{
    pthread_mutex_lock(&b->peer.mutex);
    pthread_mutex_unlock(&b->peer.mutex);
}

/* Between two of them the peer only waits. */
static int exchange(struct bench *b, const struct apc_value *u, struct apc_value *y)
{
    meet(b);
    int rc = apc_exchange_begin(b->x, u, apc_clock_mono(NULL) + PATIENCE);
    if (rc == 0)
        rc = apc_exchange_finish(b->x, y);
    meet(b);
    return rc;
}

/* ---- Values --------------------------------------------------------------------------------- */

/* Each is written to where it is read from. */
/*
 * Promise(links/types-word-order): Types, word order, scale, and what goes in one request; what does not
 *   fit is not written; no bytes of a peer hang or get past the client.
 */
static void a_value_of_each_type_stands_as_the_specification_has_it(void **state)
{
    static const struct {
        struct apc_modbus_point p;
        double value;
        uint16_t registers[4];
    } cases[] = {
        {{.type = APC_MODBUS_U16}, 65535, {0xFFFF}},
        {{.type = APC_MODBUS_U16}, 258.4, {0x0102}}, /* the nearest */
        {{.type = APC_MODBUS_S16}, -2, {0xFFFE}},
        {{.type = APC_MODBUS_S16}, -32768, {0x8000}},
        {{.type = APC_MODBUS_U32}, 4294967295.0, {0xFFFF, 0xFFFF}},
        {{.type = APC_MODBUS_U32}, 0x01020304, {0x0102, 0x0304}},
        {{.type = APC_MODBUS_U32, .low_word_first = true}, 0x01020304, {0x0304, 0x0102}},
        {{.type = APC_MODBUS_S32}, -3, {0xFFFF, 0xFFFD}},
        {{.type = APC_MODBUS_S32, .low_word_first = true}, -3, {0xFFFD, 0xFFFF}},
        {{.type = APC_MODBUS_F32}, 1.5, {0x3FC0, 0x0000}},
        {{.type = APC_MODBUS_F32, .low_word_first = true}, 1.5, {0x0000, 0x3FC0}},
        {{.type = APC_MODBUS_F64}, -1.0 / 3, {0xBFD5, 0x5555, 0x5555, 0x5555}},
        {{.type = APC_MODBUS_F64, .low_word_first = true}, 1.0 + 0x1p-52, {0x0001, 0, 0, 0x3FF0}},
        {{.type = APC_MODBUS_U16, .low_byte_first = true}, 0x0102, {0x0201}},
        {{.type = APC_MODBUS_S32, .low_byte_first = true}, 0x01020304, {0x0201, 0x0403}},
        {{.type = APC_MODBUS_F32, .low_word_first = true, .low_byte_first = true}, 1.5, {0x0000, 0xC03F}},
        {{.type = APC_MODBUS_F64, .low_word_first = true, .low_byte_first = true}, 1.5, {0, 0, 0, 0xF83F}},
        {{.type = APC_MODBUS_F64, .low_byte_first = true}, 1.5, {0xF83F, 0, 0, 0}},
        {{.type = APC_MODBUS_U64}, 0x0102030405060000, {0x0102, 0x0304, 0x0506, 0}},
        {{.type = APC_MODBUS_U64}, 0x1p63, {0x8000, 0, 0, 0}},
        {{.type = APC_MODBUS_S64, .low_word_first = true}, -2, {0xFFFE, 0xFFFF, 0xFFFF, 0xFFFF}},
        {{.type = APC_MODBUS_S64}, -0x1p63, {0x8000, 0, 0, 0}},
        {{.type = APC_MODBUS_U16, .scale = 0.5, .offset = -10}, 2.5, {25}},
        {{.type = APC_MODBUS_S16, .scale = -0.25}, 1.0, {0xFFFC}},
        {{.type = APC_MODBUS_F32, .offset = 273.15}, 273.15, {0, 0}},
    };
    (void)state;
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        struct apc_modbus_point p = cases[i].p;
        const struct apc_value u = {.value = cases[i].value};
        struct apc_value y = {0};
        p.area = APC_MODBUS_HOLDING;
        p.address = 100;
        struct bench *b = start(1, 1, (struct apc_modbus_options){.u = &p, .y = &p});
        assert_int_equal(exchange(b, &u, &y), 0);
        assert_memory_equal(&b->peer.holding[100], cases[i].registers, sizeof cases[i].registers);
        assert_near(y.value, i == 1 ? 258.0 : cases[i].value, 0.0);
        assert_int_equal(y.status, APC_GOOD);
        end(b);
    }
}

/* Promise(links/types-word-order) */
static void what_does_not_fit_is_not_written_nor_anything_beside_it(void **state)
{
    static const struct {
        enum apc_modbus_type type;
        double value;
    } cases[] = {{APC_MODBUS_U16, -1},
                 {APC_MODBUS_U16, 65536},
                 {APC_MODBUS_S16, 32768},
                 {APC_MODBUS_S16, -32769},
                 {APC_MODBUS_U32, 4294967296},
                 {APC_MODBUS_S32, 2147483648.0},
                 {APC_MODBUS_S32, -2147483649.0},
                 {APC_MODBUS_F32, 1e39},
                 {APC_MODBUS_U64, 0x1p64},
                 {APC_MODBUS_U64, -1},
                 {APC_MODBUS_S64, 0x1p63},
                 {APC_MODBUS_S64, -0x1.0000000000001p63},
                 {APC_MODBUS_FLAG, 2},
                 {APC_MODBUS_FLAG, -1},
                 {APC_MODBUS_U32, -1e299}};
    (void)state;
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        const struct apc_modbus_point u[] = {point(APC_MODBUS_HOLDING, APC_MODBUS_U16, 0),
                                             point(APC_MODBUS_HOLDING, cases[i].type, 1)};
        const struct apc_value values[] = {{.value = 7}, {.value = cases[i].value}};
        struct apc_value y;
        assert_true(apc_modbus_fits(&u[0], 7));
        assert_false(apc_modbus_fits(&u[1], cases[i].value));
        struct bench *b = start(2, 1, (struct apc_modbus_options){.u = u, .y = u});
        assert_int_equal(exchange(b, values, &y), APC_ERANGE);
        assert_non_null(strstr(apc_exchange_error(b->x), "output 2 is"));
        assert_int_equal(exchange(b, NULL, &y), 0);
        assert_int_equal(b->peer.writes, 0);
        end(b);
    }
}

static void what_just_fits_is_written(void **state)
{
    static const struct {
        enum apc_modbus_type type;
        double low, high;
    } cases[] = {{APC_MODBUS_U16, 0, 65535},
                 {APC_MODBUS_S16, -32768, 32767},
                 {APC_MODBUS_U32, 0, 4294967295.0},
                 {APC_MODBUS_S32, -2147483648.0, 2147483647},
                 {APC_MODBUS_F32, -(double)FLT_MAX, (double)FLT_MAX},
                 {APC_MODBUS_F64, -DBL_MAX, DBL_MAX}};
    (void)state;
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        const struct apc_modbus_point p = point(APC_MODBUS_HOLDING, cases[i].type, 0);
        assert_true(apc_modbus_fits(&p, cases[i].low));
        assert_true(apc_modbus_fits(&p, cases[i].high));
    }
}

static void a_register_that_holds_no_number_is_bad(void **state)
{
    const struct apc_modbus_point u = point(APC_MODBUS_COIL, APC_MODBUS_BIT, 0),
                                  y[] = {point(APC_MODBUS_INPUT, APC_MODBUS_F32, 0),
                                         point(APC_MODBUS_INPUT, APC_MODBUS_F32, 2),
                                         point(APC_MODBUS_INPUT, APC_MODBUS_F64, 4)};
    struct bench *b = start(1, 3, (struct apc_modbus_options){.u = &u, .y = y});
    struct apc_value values[3];
    (void)state;
    b->peer.input[0] = 0x7FC0; /* NaN */
    b->peer.input[2] = 0x4000; /* 2 */
    b->peer.input[4] = 0x7FE0; /* beyond 1e300 */
    assert_int_equal(exchange(b, NULL, values), 0);
    assert_int_equal(values[0].status, APC_BAD_SENSOR_FAILURE);
    assert_near(values[0].value, 0, 0);
    assert_int_equal(values[1].status, APC_GOOD);
    assert_near(values[1].value, 2, 0);
    assert_int_equal(values[2].status, APC_BAD_SENSOR_FAILURE);
    end(b);
}

/* ---- Requests ------------------------------------------------------------------------------- */

/* Promise(links/types-word-order) */
static void what_is_next_to_each_other_goes_in_one_request(void **state)
{
    const struct apc_modbus_point
        u[] = {point(APC_MODBUS_HOLDING, APC_MODBUS_F32, 12), point(APC_MODBUS_COIL, APC_MODBUS_BIT, 9),
               point(APC_MODBUS_HOLDING, APC_MODBUS_U16, 10), point(APC_MODBUS_COIL, APC_MODBUS_BIT, 8),
               point(APC_MODBUS_HOLDING, APC_MODBUS_U16, 11), point(APC_MODBUS_HOLDING, APC_MODBUS_U16, 20)},
        y[] = {point(APC_MODBUS_INPUT, APC_MODBUS_U16, 5),     point(APC_MODBUS_DISCRETE, APC_MODBUS_BIT, 17),
               point(APC_MODBUS_INPUT, APC_MODBUS_U16, 4),     point(APC_MODBUS_INPUT, APC_MODBUS_U16, 5),
               point(APC_MODBUS_HOLDING, APC_MODBUS_U16, 6),   point(APC_MODBUS_COIL, APC_MODBUS_BIT, 9),
               point(APC_MODBUS_DISCRETE, APC_MODBUS_BIT, 16), point(APC_MODBUS_INPUT, APC_MODBUS_U32, 4)};
    struct apc_value values[] = {{.value = 1.5}, {.value = 1}, {.value = 3},
                                 {.value = 0},   {.value = 5}, {.value = 6}};
    const double expected[] = {77, 1, 66, 77, 88, 1, 0, 66 * 65536 + 77};
    struct apc_value answer[8];
    struct bench *b = start(6, 8, (struct apc_modbus_options){.u = u, .y = y, .unit = 17});
    (void)state;
    b->peer.input[4] = 66;
    b->peer.input[5] = 77;
    b->peer.holding[6] = 88;
    b->peer.discrete[17] = true;
    b->peer.coil[8] = true;
    assert_int_equal(exchange(b, values, answer), 0);
    assert_int_equal(b->peer.unit, 17);
    assert_int_equal(b->peer.writes, 3); /* coils 8 and 9; registers 10 to 13; register 20 */
    assert_int_equal(b->peer.reads, 4);  /* one of each area */
    assert_int_equal(b->peer.holding[10], 3);
    assert_int_equal(b->peer.holding[11], 5);
    assert_int_equal(b->peer.holding[12], 0x3FC0);
    assert_int_equal(b->peer.holding[20], 6);
    assert_false(b->peer.coil[8]);
    assert_true(b->peer.coil[9]);
    for (size_t i = 0; i < 8; i++)
        assert_near(answer[i].value, expected[i], 0);
    values[4].status = APC_BAD_NO_DATA; /* register 11 is left out, what is beside it is not */
    values[2].value = 30;
    values[0].value = 2;
    values[4].value = 50;
    assert_int_equal(exchange(b, values, answer), 0);
    assert_int_equal(b->peer.writes, 3 + 4);
    assert_int_equal(b->peer.holding[10], 30);
    assert_int_equal(b->peer.holding[11], 5);
    assert_int_equal(b->peer.holding[12], 0x4000);
    end(b);
}

/* Promise(links/types-word-order) */
static void a_request_has_no_more_than_a_frame_holds(void **state)
{
    enum { N = 2500 };
    static struct apc_modbus_point u[2 * N], y[2 * N];
    static struct apc_value values[2 * N], answer[2 * N];
    (void)state;
    for (unsigned i = 0; i < N; i++) {
        u[i] = point(APC_MODBUS_HOLDING, APC_MODBUS_U16, 65536 - N + i);
        u[N + i] = point(APC_MODBUS_COIL, APC_MODBUS_BIT, i);
        values[i].value = (double)i;
        values[N + i].value = i % 3 == 0;
    }
    memcpy(y, u, sizeof y);
    struct bench *b = start(2 * N, 2 * N, (struct apc_modbus_options){.u = u, .y = y});
    assert_int_equal(exchange(b, values, answer), 0);
    for (size_t i = 0; i < 2 * N; i++)
        assert_near(answer[i].value, values[i].value, 0);
    assert_int_equal(b->peer.writes, (N + 122) / 123 + (N + 1967) / 1968);
    assert_int_equal(b->peer.reads, (N + 124) / 125 + (N + 1999) / 2000);
    end(b);
}

/* Promise(links/plant-behind-modbus) */
static void an_exception_is_a_status_when_read_and_a_failure_when_written(void **state)
{
    static const struct {
        unsigned char exception;
        apc_status status;
    } cases[] = {{1, APC_BAD_NOT_CONNECTED},  {2, APC_BAD_NOT_CONNECTED},     {3, APC_BAD_NOT_CONNECTED},
                 {4, APC_BAD_DEVICE_FAILURE}, {10, APC_BAD_NO_COMMUNICATION}, {11, APC_BAD_NO_COMMUNICATION},
                 {200, APC_BAD_NO_DATA}};
    const struct apc_modbus_point p = point(APC_MODBUS_HOLDING, APC_MODBUS_U16, 30);
    struct bench *b = start(1, 1, (struct apc_modbus_options){.u = &p, .y = &p});
    struct apc_value u = {.value = 1}, y;
    (void)state;
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        char text[60];
        pthread_mutex_lock(&b->peer.mutex);
        b->peer.behaviour = MODBUS_EXCEPTION;
        b->peer.exception = cases[i].exception;
        pthread_mutex_unlock(&b->peer.mutex);
        assert_int_equal(exchange(b, NULL, &y), 0);
        assert_int_equal(y.status, cases[i].status);
        assert_int_equal(exchange(b, &u, &y), APC_EPERM);
        snprintf(text, sizeof text, "holding registers 30 to 30 written: exception %d,", cases[i].exception);
        assert_non_null(strstr(apc_exchange_error(b->x), text));
    }
    end(b);
}

/* ---- What a device may lawfully do ---------------------------------------------------------- */

/* Whoever is busy for some requests is asked again; who stays so is Bad, and the others are read all the
 * same. */
/*
 * Promise(links/modbus-device-lawfully): What a Modbus device may lawfully do costs no measurement: busy,
 *   closing after each answer, functions 5 and 6 only, few registers a request, swapped bytes, codes for no
 *   value.
 */
static void a_device_that_is_busy_is_asked_again_in_time(void **state)
{
    const struct apc_modbus_point p = point(APC_MODBUS_HOLDING, APC_MODBUS_U16, 30);
    struct bench *b = start(1, 1, (struct apc_modbus_options){.u = &p, .y = &p});
    struct apc_value u = {.value = 7}, y;
    int rc;
    (void)state;
    b->peer.busy = 3;
    assert_int_equal(exchange(b, &u, &y), 0);
    b->peer.busy = 2;
    assert_int_equal(exchange(b, NULL, &y), 0);
    assert_near(y.value, 7, 0);
    assert_int_equal(y.status, APC_GOOD);
    for (unsigned char exception = 5; exception <= 6; exception++) {
        pthread_mutex_lock(&b->peer.mutex);
        b->peer.behaviour = MODBUS_EXCEPTION;
        b->peer.exception = exception;
        pthread_mutex_unlock(&b->peer.mutex);
        do { /* a machine that is busy itself may have no answer in time */
            rc = apc_exchange_begin(b->x, NULL, apc_clock_mono(NULL) + 50 * APC_NS_PER_MS);
            rc = rc == 0 ? apc_exchange_finish(b->x, &y) : rc;
        } while (rc == APC_ETIMEDOUT);
        assert_int_equal(rc, 0);
        assert_int_equal(y.status, APC_BAD_NO_DATA);
        do {
            rc = apc_exchange_begin(b->x, &u, apc_clock_mono(NULL) + 50 * APC_NS_PER_MS);
        } while (rc == APC_ETIMEDOUT);
        assert_int_equal(rc, APC_EPERM);
    }
    end(b);
}

/* Promise(links/modbus-device-lawfully) */
static void a_server_that_closes_after_each_answer_gives_all(void **state)
{
    const struct apc_modbus_point u[] = {point(APC_MODBUS_HOLDING, APC_MODBUS_U16, 0),
                                         point(APC_MODBUS_COIL, APC_MODBUS_BIT, 0)},
                                  y[] = {point(APC_MODBUS_HOLDING, APC_MODBUS_U16, 0),
                                         point(APC_MODBUS_COIL, APC_MODBUS_BIT, 0),
                                         point(APC_MODBUS_INPUT, APC_MODBUS_U16, 9)};
    struct bench *b = start(2, 3, (struct apc_modbus_options){.u = u, .y = y});
    struct apc_value values[] = {{.value = 0}, {.value = 1}}, answer[3];
    (void)state;
    b->peer.behaviour = MODBUS_ONCE;
    for (int i = 1; i <= 50; i++) {
        values[0].value = i;
        assert_int_equal(exchange(b, values, answer), 0);
        assert_near(answer[0].value, i, 0);
        assert_near(answer[1].value, 1, 0);
        assert_int_equal(answer[2].status, APC_GOOD);
    }
    end(b);
}

/* By a setting, or after exception 1 to the other function, which is then not tried again. */
/* Promise(links/modbus-device-lawfully) */
static void a_device_that_writes_one_at_a_time_is_written_so(void **state)
{
    const struct apc_modbus_point u[] = {
        point(APC_MODBUS_HOLDING, APC_MODBUS_U16, 0), point(APC_MODBUS_HOLDING, APC_MODBUS_S16, 1),
        point(APC_MODBUS_COIL, APC_MODBUS_BIT, 4), point(APC_MODBUS_COIL, APC_MODBUS_BIT, 5)};
    const struct apc_value values[] = {{.value = 3}, {.value = -3}, {.value = 1}, {.value = 1}};
    struct apc_value y;
    (void)state;
    for (int set = 0; set < 2; set++) {
        struct bench *b = start(4, 1, (struct apc_modbus_options){.u = u, .y = u, .write_single = set});
        b->peer.unknown = 1 << 15 | 1 << 16;
        assert_int_equal(exchange(b, values, &y), 0);
        assert_int_equal(b->peer.holding[0], 3);
        assert_int_equal(b->peer.holding[1], (uint16_t)-3);
        assert_true(b->peer.coil[4] && b->peer.coil[5]);
        const unsigned asked = b->peer.of[0];
        assert_int_equal(asked, set ? 5 : 7);
        assert_int_equal(exchange(b, values, &y), 0);
        assert_int_equal(b->peer.of[0], asked + 5);
        assert_int_equal(apc_exchange_safe(b->x, NULL, apc_clock_mono(NULL) + PATIENCE), 0);
        meet(b);
        assert_int_equal(b->peer.holding[0], 0);
        assert_false(b->peer.coil[5]);
        end(b);
    }
}

/* Half of a value must not stand there, even for a moment. */
/* Promise(links/nothing-modbus-written) */
static void a_value_of_several_registers_is_not_written_one_at_a_time(void **state)
{
    const struct apc_modbus_point u = point(APC_MODBUS_HOLDING, APC_MODBUS_F32, 0);
    const struct apc_value value = {.value = 3};
    struct apc_modbus_options o = {.size = sizeof o, .u = &u, .y = &u, .write_single = true};
    const struct apc_exchange_options options = {.size = sizeof options, .nu = 1, .ny = 1, .modbus = &o};
    struct apc_exchange *x;
    struct apc_value y;
    struct apc_error why;
    struct bench *b = start(1, 1, (struct apc_modbus_options){.u = &u, .y = &u});
    (void)state;
    b->peer.unknown = 1 << 16;
    assert_int_equal(exchange(b, &value, &y), APC_EPERM);
    assert_non_null(strstr(apc_exchange_error(b->x), "would leave half of it"));
    assert_int_equal(b->peer.writes, 0);
    end(b);
    assert_int_equal(apc_exchange_open(&x, "modbus:127.0.0.1:502", &options, &why), APC_EINVAL);
    assert_non_null(strstr(why.text, "half written"));
    o = (struct apc_modbus_options){.size = sizeof o, .u = &u, .y = &u, .block = 1};
    assert_int_equal(apc_exchange_open(&x, "modbus:127.0.0.1:502", &options, &why), APC_EINVAL);
    assert_non_null(strstr(why.text, "a block must have as many"));
}

/* Promise(links/modbus-device-lawfully) */
static void a_request_has_no_more_registers_than_a_block(void **state)
{
    enum { N = 24 };
    struct apc_modbus_point y[N], u = point(APC_MODBUS_COIL, APC_MODBUS_BIT, 0);
    struct apc_value answer[N];
    (void)state;
    for (unsigned i = 0; i < N; i++)
        y[i] = point(APC_MODBUS_INPUT, APC_MODBUS_F32, 2 * i);
    struct bench *b = start(1, N, (struct apc_modbus_options){.u = &u, .y = y, .block = 11});
    b->peer.most = 10;
    assert_int_equal(exchange(b, NULL, answer), 0);
    for (size_t i = 0; i < N; i++)
        assert_int_equal(answer[i].status, APC_GOOD);
    assert_int_equal(b->peer.reads, (N + 4) / 5);
    end(b);
}

/* Promise(links/modbus-device-lawfully) */
static void a_map_may_name_several_units(void **state)
{
    struct apc_modbus_point u[] = {point(APC_MODBUS_HOLDING, APC_MODBUS_U16, 0),
                                   point(APC_MODBUS_HOLDING, APC_MODBUS_U16, 0)},
                            y[] = {point(APC_MODBUS_INPUT, APC_MODBUS_U16, 0),
                                   point(APC_MODBUS_INPUT, APC_MODBUS_U16, 1)};
    const struct apc_value values[] = {{.value = 3}, {.value = 4}};
    struct apc_value answer[2];
    (void)state;
    u[1].unit = 9; /* the same register of another device */
    y[0].unit = 200;
    struct bench *b = start(2, 2, (struct apc_modbus_options){.u = u, .y = y, .unit = 1});
    assert_int_equal(exchange(b, values, answer), 0);
    assert_int_equal(b->peer.of[1], 2);
    assert_int_equal(b->peer.of[9], 1);
    assert_int_equal(b->peer.of[200], 1);
    end(b);
}

/* What a gateway does not reach is Bad by itself, and the other devices behind it are read all the same. */
static void a_device_that_its_gateway_does_not_reach_leaves_the_others(void **state)
{
    struct apc_modbus_point u = point(APC_MODBUS_HOLDING, APC_MODBUS_U16, 0),
                            y[] = {point(APC_MODBUS_HOLDING, APC_MODBUS_U16, 0),
                                   point(APC_MODBUS_HOLDING, APC_MODBUS_U16, 0),
                                   point(APC_MODBUS_HOLDING, APC_MODBUS_U16, 0)};
    struct apc_value value = {.value = 5}, answer[3];
    (void)state;
    y[1].unit = 7;
    y[2].unit = 9;
    struct bench *b = start(1, 3, (struct apc_modbus_options){.u = &u, .y = y, .unit = 1});
    b->peer.absent = 7;
    for (int i = 0; i < 20; i++) {
        value.value = i;
        assert_int_equal(exchange(b, &value, answer), 0);
        assert_int_equal(answer[1].status, APC_BAD_NO_COMMUNICATION);
        for (size_t k = 0; k < 3; k += 2) {
            assert_int_equal(answer[k].status, APC_GOOD);
            assert_near(answer[k].value, i, 0);
        }
    }
    b->peer.absent = 0;
    assert_int_equal(exchange(b, &value, answer), 0);
    assert_int_equal(answer[1].status, APC_GOOD);
    end(b);
}

/* ---- One of several units does not answer ----------------------------------------------------- */

/* Outputs 0, 1 and 2, and measurements of the same registers, in units 1, 7 and 9. */
enum { UNITS = 3 };
static const unsigned UNIT[UNITS] = {1, 7, 9};

static struct bench *start_units(struct apc_modbus_options o)
{
    static struct apc_modbus_point points[UNITS];
    for (unsigned i = 0; i < UNITS; i++) {
        points[i] = point(APC_MODBUS_HOLDING, APC_MODBUS_U16, 10 * i);
        points[i].unit = UNIT[i];
        points[i].safe = 99;
    }
    o.u = o.y = points;
    return start(UNITS, UNITS, o);
}

/* Whoever is silent takes its share of that. */
static int exchange_soon(struct bench *b, const struct apc_value *u, struct apc_value *y)
{
    meet(b);
    int rc = apc_exchange_begin(b->x, u, apc_clock_mono(NULL) + 2 * APC_NS_PER_S);
    if (rc == 0)
        rc = apc_exchange_finish(b->x, y);
    meet(b);
    return rc;
}

static void command_all(struct apc_value *u, int value)
{
    for (size_t i = 0; i < UNITS; i++)
        u[i] = (struct apc_value){.value = value};
}

/* All but unit 7 have what they were given. */
static void only_the_second_is_missing(struct bench *b, const struct apc_value *u, const struct apc_value *y)
{
    for (size_t i = 0; i < UNITS; i += 2) {
        assert_int_equal(y[i].status, APC_GOOD);
        assert_near(y[i].value, u[i].value, 0);
        assert_int_equal(b->peer.holding[10 * i], (int)u[i].value);
    }
    assert_int_equal(y[1].status, APC_BAD_NO_COMMUNICATION);
    assert_near(y[1].value, 0, 0);
    assert_true(y[1].time > 0);
    assert_false(apc_exchange_taken(b->x));
    assert_non_null(strstr(apc_exchange_error(b->x), "unit 7: "));
}

/* Until it is asked no more in each exchange. Returns what was written last. */
static int until_it_pauses(struct bench *b)
{
    struct apc_value u[UNITS], y[UNITS];
    int value = 0;
    unsigned before;
    do {
        command_all(u, ++value);
        before = b->peer.of[7];
        assert_int_equal(exchange_soon(b, u, y), 0);
        only_the_second_is_missing(b, u, y);
    } while (b->peer.of[7] > before);
    return value;
}

/* Until all that unit 7 has is there again. */
static void until_it_is_back(struct bench *b)
{
    const apc_ns until = apc_clock_mono(NULL) + PATIENCE;
    struct apc_value u[UNITS], y[UNITS];
    command_all(u, 1000);
    do
        assert_int_equal(exchange(b, u, y), 0);
    while (y[1].status != APC_GOOD && apc_clock_mono(NULL) < until);
    assert_int_equal(y[1].status, APC_GOOD);
    assert_near(y[1].value, 1000, 0);
    assert_true(apc_exchange_taken(b->x));
    assert_string_equal(apc_exchange_error(b->x), "");
}

/*
 * Promise(links/modbus-unit-silent): A Modbus unit that does not answer costs only its own values: the others
 *   are read and written in the same exchange, and it is asked seldom.
 */
static void a_silent_unit_costs_its_own_values_only(void **state)
{
    struct bench *b = start_units((struct apc_modbus_options){0});
    (void)state;
    b->peer.silent = 7;
    (void)until_it_pauses(b);
    assert_int_equal(b->peer.accepted, 1);
    b->peer.silent = 0;
    until_it_is_back(b);
    end(b);
}

/* Promise(links/modbus-unit-silent) */
static void a_late_reply_is_dropped_by_its_number(void **state)
{
    struct bench *b = start_units((struct apc_modbus_options){0});
    (void)state;
    b->peer.slow = 7;
    b->peer.holding[10] = 4711; /* in its late replies */
    (void)until_it_pauses(b);
    for (int whole = 0; whole < 2; whole++) {
        struct apc_value u[UNITS], y[UNITS];
        command_all(u, 2000 + whole);
        while (b->peer.held_length == 0) { /* until it is asked again, behind the others */
            assert_int_equal(exchange_soon(b, u, y), 0);
            only_the_second_is_missing(b, u, y);
        }
        modbus_peer_release(&b->peer, whole ? b->peer.held_length : 5);
        assert_int_equal(exchange_soon(b, u, y), 0);
        only_the_second_is_missing(b, u, y);
    }
    assert_int_equal(b->peer.accepted, 1);
    b->peer.slow = 0;
    until_it_is_back(b);
    end(b);
}

/* A gateway may close the connection for one, or say that it does not reach it; the one may be the first. */
/* Promise(links/modbus-unit-silent) */
static void a_unit_for_which_its_gateway_hangs_up_costs_no_other(void **state)
{
    (void)state;
    for (int says = 0; says < 2; says++) {
        struct apc_value u[UNITS], y[UNITS];
        struct bench *b = start_units((struct apc_modbus_options){0});
        command_all(u, 3);
        b->peer.lost = says ? 0 : 1;
        b->peer.absent = says ? 1 : 0;
        while (exchange(b, u, y) < 0) /* nobody knows yet who is to blame */
            assert_int_equal(says, 0);
        assert_int_equal(y[0].status, APC_BAD_NO_COMMUNICATION);
        for (size_t i = 1; i < UNITS; i++) {
            assert_int_equal(y[i].status, APC_GOOD);
            assert_near(y[i].value, 3, 0);
        }
        assert_false(apc_exchange_taken(b->x));
        assert_non_null(strstr(apc_exchange_error(b->x), "unit 1: "));
        end(b);
    }
}

/* A gateway that waits for the silent one answers nobody meanwhile. */
/* Promise(links/modbus-unit-silent) */
static void a_gateway_that_waits_for_a_silent_unit_is_left_in_peace(void **state)
{
    const apc_ns until = apc_clock_mono(NULL) + PATIENCE;
    struct apc_modbus_point points[] = {point(APC_MODBUS_HOLDING, APC_MODBUS_U16, 0),
                                        point(APC_MODBUS_HOLDING, APC_MODBUS_U16, 10)};
    struct apc_value u[] = {{.value = 5}, {.value = 6}}, y[2];
    int in_a_row = 0;
    (void)state;
    points[0].unit = 7;
    points[1].unit = 9;
    struct bench *b = start(2, 2, (struct apc_modbus_options){.u = points, .y = points});
    b->peer.silent = 7;
    b->peer.blocks = true;
    while (in_a_row < 5 && apc_clock_mono(NULL) < until) {
        int rc = apc_exchange_begin(b->x, u, apc_clock_mono(NULL) + 200 * APC_NS_PER_MS);
        rc = rc == 0 ? apc_exchange_finish(b->x, y) : rc;
        in_a_row = rc == 0 && y[1].status == APC_GOOD ? in_a_row + 1 : 0;
    }
    assert_int_equal(in_a_row, 5);
    assert_int_equal(y[0].status, APC_BAD_NO_COMMUNICATION);
    end(b);
}

/* Promise(links/modbus-unit-silent) */
static void a_watchdog_waits_for_outputs_of_a_silent_unit(void **state)
{
    struct apc_modbus_point all = point(APC_MODBUS_HOLDING, APC_MODBUS_U16, 100),
                            own[UNITS] = {point(APC_MODBUS_HOLDING, APC_MODBUS_U16, 101),
                                          point(APC_MODBUS_HOLDING, APC_MODBUS_U16, 102)};
    struct apc_value u[UNITS], y[UNITS];
    (void)state;
    all.unit = own[0].unit = own[1].unit = 9;
    struct bench *b = start_units((struct apc_modbus_options){.watchdog = &all, .watchdogs = own});
    command_all(u, 1);
    assert_int_equal(exchange(b, u, y), 0);
    assert_int_equal(b->peer.holding[100], 1);
    b->peer.silent = 7;
    const int exchanges = until_it_pauses(b);
    assert_int_equal(b->peer.holding[100], 1);
    assert_int_equal(b->peer.holding[101], 1 + exchanges);
    assert_int_equal(b->peer.holding[102], 1);
    b->peer.silent = 0;
    until_it_is_back(b);
    assert_int_equal(exchange(b, u, y), 0);
    assert_true(b->peer.holding[100] > 1);
    assert_true(b->peer.holding[102] > 1);
    end(b);
}

/* Promise(links/modbus-unit-silent) */
static void a_silent_unit_keeps_no_other_from_its_safe_values(void **state)
{
    struct apc_value u[UNITS], y[UNITS];
    struct bench *b = start_units((struct apc_modbus_options){0});
    (void)state;
    command_all(u, 5);
    assert_int_equal(exchange(b, u, y), 0);
    meet(b);
    b->peer.silent = 7;
    assert_int_equal(apc_exchange_safe(b->x, NULL, apc_clock_mono(NULL) + APC_NS_PER_S), APC_ETIMEDOUT);
    meet(b);
    assert_non_null(strstr(apc_exchange_error(b->x), "unit 7: "));
    for (size_t i = 0; i < UNITS; i += 2)
        assert_int_equal(b->peer.holding[10 * i], 99);
    end(b);
}

/* TCP has bytes and no pieces: a reply may come in any. */
static void a_reply_may_come_in_pieces(void **state)
{
    enum { N = 60 };
    struct apc_modbus_point u = point(APC_MODBUS_HOLDING, APC_MODBUS_U16, 0), y[N];
    struct apc_value value = {0}, answer[N];
    (void)state;
    for (unsigned i = 0; i < N; i++)
        y[i] = point(APC_MODBUS_HOLDING, APC_MODBUS_U16, i);
    struct bench *b = start(1, N, (struct apc_modbus_options){.u = &u, .y = y});
    for (unsigned i = 1; i < N; i++)
        b->peer.holding[i] = (uint16_t)(1000 + i);
    b->peer.behaviour = MODBUS_PIECES;
    for (int k = 0; k < 10; k++) {
        value.value = k;
        assert_int_equal(exchange(b, &value, answer), 0);
        for (unsigned i = 0; i < N; i++)
            assert_near(answer[i].value, i ? 1000 + i : (unsigned)k, 0);
    }
    end(b);
}

/* Bits of one register go in one request that leaves the others, and in no other. */
/*
 * Promise(links/nothing-modbus-written): Nothing of Modbus is written by halves: a bit by function 22, a
 *   value of several registers whole.
 */
static void a_bit_of_a_register_is_read_and_written_by_itself(void **state)
{
    struct apc_modbus_point u[] = {point(APC_MODBUS_HOLDING, APC_MODBUS_FLAG, 7),
                                   point(APC_MODBUS_HOLDING, APC_MODBUS_FLAG, 7),
                                   point(APC_MODBUS_HOLDING, APC_MODBUS_U16, 8)};
    struct apc_value values[] = {{.value = 1}, {.value = 0}, {.value = 5}}, y[3];
    double found;
    (void)state;
    u[0].bit = 3;
    u[1].bit = 15;
    struct bench *b = start(3, 3, (struct apc_modbus_options){.u = u, .y = u, .read_back = true});
    b->peer.holding[7] = 0x8421;
    assert_int_equal(exchange(b, values, y), 0);
    assert_int_equal(b->peer.holding[7], 0x0429);
    assert_int_equal(b->peer.holding[8], 5);
    assert_int_equal(b->peer.writes, 2);
    assert_near(y[0].value, 1, 0);
    assert_near(y[1].value, 0, 0);
    b->peer.holding[7] |= 0x8002; /* one of ours and one of theirs */
    assert_int_equal(exchange(b, values, y), 0);
    assert_int_equal(apc_exchange_read_back(b->x, 0, &found), APC_GOOD);
    assert_int_equal(apc_exchange_read_back(b->x, 1, &found), APC_UNCERTAIN_SUBSTITUTE);
    assert_int_equal(b->peer.holding[7], 0x042B);
    b->peer.unknown = 1 << 22;
    assert_int_equal(exchange(b, values, y), APC_EPERM);
    assert_non_null(strstr(apc_exchange_error(b->x), "22, mask write register"));
    end(b);
}

/* Promise(links/modbus-device-lawfully) */
static void a_code_for_no_value_is_none(void **state)
{
    static const struct {
        enum apc_modbus_type type;
        bool low_word_first, low_byte_first;
        uint64_t code;
        uint16_t registers[4];
    } cases[] = {
        {APC_MODBUS_S16, false, false, 0x8000, {0x8000}},
        {APC_MODBUS_U16, false, true, 0xFF00, {0x00FF}},
        {APC_MODBUS_S32, true, false, 0x80000000, {0x0000, 0x8000}},
        {APC_MODBUS_U64, false, false, 0xFFFFFFFFFFFFFFFF, {0xFFFF, 0xFFFF, 0xFFFF, 0xFFFF}},
        {APC_MODBUS_S64, false, false, 0x8000000000000000, {0x8000, 0, 0, 0}},
        {APC_MODBUS_F32, false, false, 0xC61C3C00, {0xC61C, 0x3C00}}, /* -9999 */
    };
    (void)state;
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        struct apc_modbus_point p = {.area = APC_MODBUS_HOLDING,
                                     .type = cases[i].type,
                                     .low_word_first = cases[i].low_word_first,
                                     .low_byte_first = cases[i].low_byte_first,
                                     .no_value = {1, cases[i].code},
                                     .n_no_value = 2};
        struct apc_value y;
        struct bench *b = start(1, 1, (struct apc_modbus_options){.u = &p, .y = &p});
        memcpy(b->peer.holding, cases[i].registers, sizeof cases[i].registers);
        assert_int_equal(exchange(b, NULL, &y), 0);
        assert_int_equal(y.status, APC_BAD_NO_DATA);
        b->peer.holding[0] ^= 0x0100;
        assert_int_equal(exchange(b, NULL, &y), 0);
        assert_int_equal(y.status, APC_GOOD);
        end(b);
    }
}

/* ---- Who watches whom ----------------------------------------------------------------------- */

/*
 * Promise(links/plant-behind-modbus)
 * Promise(links/output-own-watchdog)
 */
static void the_watchdog_counts_what_was_given_whole(void **state)
{
    const struct apc_modbus_point u[] = {point(APC_MODBUS_HOLDING, APC_MODBUS_U16, 0),
                                         point(APC_MODBUS_HOLDING, APC_MODBUS_U16, 1)},
                                  watchdog = point(APC_MODBUS_HOLDING, APC_MODBUS_U16, 2);
    struct bench *b = start(2, 1, (struct apc_modbus_options){.u = u, .y = u, .watchdog = &watchdog});
    struct apc_value values[] = {{.value = 4}, {.value = 5}}, y;
    (void)state;
    for (int i = 1; i <= 3; i++) {
        assert_int_equal(exchange(b, values, &y), 0);
        assert_int_equal(b->peer.holding[2], i);
        assert_int_equal(b->peer.writes, i); /* with the others */
    }
    assert_int_equal(exchange(b, NULL, &y), 0);
    values[0].status = APC_BAD_OUT_OF_SERVICE;
    assert_int_equal(exchange(b, values, &y), 0);
    assert_int_equal(b->peer.holding[2], 3);
    values[0].status = APC_GOOD;
    assert_int_equal(exchange(b, values, &y), 0);
    assert_int_equal(b->peer.holding[2], 4);
    assert_int_equal(apc_exchange_safe(b->x, NULL, apc_clock_mono(NULL) + PATIENCE), 0);
    meet(b);
    assert_int_equal(b->peer.holding[0], 0);
    assert_int_equal(b->peer.holding[2], 4); /* who leaves is no longer there */
    end(b);
}

/* One that is out of service stops its own, and no other's. */
/*
 * Promise(links/output-own-watchdog): An output's own watchdog goes on while other outputs are out of
 *   service; the one of all stands still.
 */
static void each_outputs_watchdog_counts_by_itself(void **state)
{
    const struct apc_modbus_point u[] = {point(APC_MODBUS_HOLDING, APC_MODBUS_U16, 0),
                                         point(APC_MODBUS_HOLDING, APC_MODBUS_U16, 1),
                                         point(APC_MODBUS_COIL, APC_MODBUS_BIT, 0)},
                                  watchdogs[] = {point(APC_MODBUS_HOLDING, APC_MODBUS_U16, 10),
                                                 {0},
                                                 point(APC_MODBUS_HOLDING, APC_MODBUS_U16, 2)},
                                  watchdog = point(APC_MODBUS_HOLDING, APC_MODBUS_U16, 3);
    struct bench *b = start(
        3, 1, (struct apc_modbus_options){.u = u, .y = u, .watchdog = &watchdog, .watchdogs = watchdogs});
    struct apc_value values[] = {{.value = 4}, {.value = 5}, {.value = 1}}, y;
    (void)state;
    for (int i = 1; i <= 3; i++)
        assert_int_equal(exchange(b, values, &y), 0);
    values[0].status = APC_BAD_OUT_OF_SERVICE;
    for (int i = 1; i <= 4; i++)
        assert_int_equal(exchange(b, values, &y), 0);
    assert_int_equal(b->peer.holding[10], 3);
    assert_int_equal(b->peer.holding[2], 7);
    assert_int_equal(b->peer.holding[3], 3); /* that of all */
    values[0].status = APC_GOOD;
    values[2].status = APC_BAD_NO_DATA;
    assert_int_equal(exchange(b, values, &y), 0);
    assert_int_equal(b->peer.holding[10], 4);
    assert_int_equal(b->peer.holding[2], 7);
    assert_int_equal(exchange(b, NULL, &y), 0);
    assert_int_equal(apc_exchange_safe(b->x, NULL, apc_clock_mono(NULL) + PATIENCE), 0);
    meet(b);
    assert_int_equal(b->peer.holding[10], 4);
    assert_int_equal(b->peer.holding[3], 3);
    end(b);
}

/* What stands where the outputs are, as each exchange begins: what was given the last time, or somebody
 * else's. */
/*
 * Promise(links/output-stands-value): An output that stands at another value than it was given is found,
 *   said once, and counts as not commanded.
 */
static void an_output_that_is_another_than_was_given_is_found(void **state)
{
    const struct apc_modbus_point u[] = {point(APC_MODBUS_HOLDING, APC_MODBUS_F32, 0),
                                         point(APC_MODBUS_COIL, APC_MODBUS_BIT, 5),
                                         point(APC_MODBUS_HOLDING, APC_MODBUS_S16, 3)},
                                  watchdog = point(APC_MODBUS_HOLDING, APC_MODBUS_U16, 2);
    struct bench *b =
        start(3, 1, (struct apc_modbus_options){.u = u, .y = u, .watchdog = &watchdog, .read_back = true});
    struct apc_value values[] = {{.value = 0.1}, {.value = 1}, {.value = -4}}, y;
    double value;
    (void)state;
    b->peer.holding[3] = 77; /* before the first there is nothing to compare with */
    for (int i = 0; i < 3; i++) {
        assert_int_equal(exchange(b, values, &y), 0);
        for (size_t k = 0; k < 3; k++) /* 0.1 is none of float32's, and as it was given all the same */
            assert_int_equal(apc_exchange_read_back(b->x, k, &value), APC_GOOD);
        values[0].value += 0.1;
    }
    b->peer.holding[3] = 12; /* somebody else */
    assert_int_equal(exchange(b, values, &y), 0);
    assert_int_equal(apc_exchange_read_back(b->x, 2, &value), APC_UNCERTAIN_SUBSTITUTE);
    assert_near(value, 12.0, 0.0);
    b->peer.behaviour = MODBUS_CLOSES; /* what was given then nobody knows, nor that it is another */
    assert_int_equal(exchange(b, values, &y), APC_ECONN);
    b->peer.behaviour = MODBUS_PROPER;
    assert_int_equal(exchange(b, values, &y), 0);
    assert_int_equal(apc_exchange_read_back(b->x, 2, &value), APC_UNCERTAIN_SUBSTITUTE);
    assert_int_equal(exchange(b, values, &y), 0);
    assert_int_equal(apc_exchange_read_back(b->x, 2, &value), APC_GOOD);
    assert_int_equal(apc_exchange_read_back(b->x, 0, &value), APC_GOOD);
    assert_int_equal(b->peer.holding[3], (uint16_t)-4); /* it is given anew all the same */
    b->peer.holding[0] = 0x7FC0;                        /* no number */
    values[1].status = APC_BAD_OUT_OF_SERVICE;
    assert_int_equal(exchange(b, values, &y), 0);
    assert_int_equal(apc_exchange_read_back(b->x, 0, &value), APC_BAD_SENSOR_FAILURE);
    assert_int_equal(apc_exchange_read_back(b->x, 2, &value), APC_GOOD);
    memset(b->peer.holding, 0, sizeof b->peer.holding); /* it was switched off and on */
    assert_int_equal(exchange(b, values, &y), 0);
    assert_int_equal(apc_exchange_read_back(b->x, 0, &value), APC_UNCERTAIN_SUBSTITUTE);
    assert_int_equal(apc_exchange_read_back(b->x, 1, &value), APC_GOOD); /* that nobody has given */
    assert_int_equal(apc_exchange_read_back(b->x, 3, &value), APC_GOOD); /* there is none */
    end(b);
}

/* Promise(links/plant-behind-modbus) */
static void once_its_sign_of_life_stands_still_nothing_is_good(void **state)
{
    const struct apc_modbus_point u = point(APC_MODBUS_COIL, APC_MODBUS_BIT, 0),
                                  y = point(APC_MODBUS_INPUT, APC_MODBUS_U16, 0),
                                  life = point(APC_MODBUS_INPUT, APC_MODBUS_U16, 9);
    const apc_ns limit = 200 * APC_NS_PER_MS;
    struct bench *b =
        start(1, 1, (struct apc_modbus_options){.u = &u, .y = &y, .life = &life, .life_limit = limit});
    struct apc_value value;
    const apc_ns begun = apc_clock_mono(NULL), until = begun + PATIENCE;
    (void)state;
    assert_int_equal(exchange(b, NULL, &value), 0);
    assert_int_equal(value.status, APC_GOOD); /* the first look: it may be alive */
    do
        assert_int_equal(exchange(b, NULL, &value), 0);
    while (value.status == APC_GOOD && apc_clock_mono(NULL) < until);
    assert_int_equal(value.status, APC_BAD_DEVICE_FAILURE);
    assert_true(apc_clock_mono(NULL) - begun > limit); /* not before */
    b->peer.input[9] = 1;
    assert_int_equal(exchange(b, NULL, &value), 0);
    assert_int_equal(value.status, APC_GOOD);
    end(b);
}

/* ---- Nonsense ------------------------------------------------------------------------------- */

/* Whatever comes instead of a reply: refused, or a reply by chance; never a hang, and the next is good. */
/* Promise(links/types-word-order) */
static void no_bytes_hang_it_or_get_past_it(void **state)
{
    const struct apc_modbus_point p = point(APC_MODBUS_HOLDING, APC_MODBUS_U16, 0);
    static const unsigned char good[] = {0, 0, 0, 0, 0, 5, 0, 3, 2, 0, 42};
    struct bench *b = start(1, 1, (struct apc_modbus_options){.u = &p, .y = &p});
    struct apc_random random;
    struct apc_value y;
    int refused = 0;
    (void)state;
    apc_random_init(&random, 7, "modbus");
    for (int i = 0; i < 3000; i++) {
        pthread_mutex_lock(&b->peer.mutex);
        b->peer.behaviour = MODBUS_SCRIPT;
        memcpy(b->peer.script, good, sizeof good);
        b->peer.script_length = sizeof good;
        for (int k = 0; k < 1 + i % 3; k++)
            b->peer.script[2 + (size_t)(apc_random_uniform(&random) * (sizeof good - 2))] =
                (unsigned char)(apc_random_uniform(&random) * 256);
        pthread_mutex_unlock(&b->peer.mutex);
        int rc = apc_exchange_begin(b->x, NULL, apc_clock_mono(NULL) + 2 * APC_NS_PER_MS);
        if (rc == 0)
            rc = apc_exchange_finish(b->x, &y);
        assert_true(rc == 0 || rc == APC_EPROTO || rc == APC_ETIMEDOUT || rc == APC_ECONN);
        assert_true(rc < 0 || apc_status_severity(y.status) == APC_SEVERITY_BAD ||
                    y.value <= 65535); /* the value may be what was changed */
        refused += rc < 0;
    }
    assert_true(refused > 1000);
    modbus_peer_behave(&b->peer, MODBUS_PROPER);
    b->peer.holding[0] = 42;
    int rc;
    do /* a connect may have failed, then it pauses */
        rc = exchange(b, NULL, &y);
    while (rc == APC_ECONN);
    assert_int_equal(rc, 0);
    assert_near(y.value, 42, 0);
    end(b);
}

/* Whoever looks for the device's fault is told which part of its reply is another than it was asked for. */
static void what_is_wrong_with_a_reply_is_told(void **state)
{
    static const struct {
        size_t n;
        unsigned char reply[16]; /* behind the transaction's number */
        const char *says;
    } cases[] = {{11, {0, 0, 0, 5, 9, 3, 2, 0, 42}, "its unit is 9, and should be 0"},
                 {11, {0, 0, 0, 5, 0, 4, 2, 0, 42}, "its function is 4, and should be 3"},
                 {13, {0, 0, 0, 7, 0, 3, 4, 0, 42, 0, 0}, "its length is 13, and should be 11"},
                 {10, {0, 0, 0, 4, 0, 3, 1, 42}, "its length is 10, and should be 11"},
                 {11, {0, 0, 0, 5, 0, 3, 4, 0, 42}, "its count of bytes is 4, and should be 2"}};
    const struct apc_modbus_point p = point(APC_MODBUS_HOLDING, APC_MODBUS_U16, 0);
    struct bench *b = start(1, 1, (struct apc_modbus_options){.u = &p, .y = &p});
    const struct apc_value u = {.value = 1};
    struct apc_value y;
    int rc;
    (void)state;
    for (size_t i = 0; i <= sizeof cases / sizeof *cases; i++) {
        const bool another = i == sizeof cases / sizeof *cases;
        pthread_mutex_lock(&b->peer.mutex);
        b->peer.behaviour = another ? MODBUS_ANOTHERS : MODBUS_SCRIPT;
        memcpy(b->peer.script + 2, cases[another ? 0 : i].reply, sizeof cases[0].reply);
        b->peer.script_length = cases[another ? 0 : i].n;
        pthread_mutex_unlock(&b->peer.mutex);
        do /* a connect may have failed, then it pauses */
            rc = exchange(b, NULL, &y);
        while (rc == APC_ECONN);
        assert_int_equal(rc, APC_EPROTO);
        if (!strstr(apc_exchange_error(b->x), another ? "its transaction is " : cases[i].says))
            fail_msg("%zu: %s", i, apc_exchange_error(b->x));
    }
    /* 1 was to be written to 0 */
    for (unsigned char at = 0; at < 2; at++) {
        const unsigned char echo[] = {0, 0, 0, 6, 0, 16, 0, at ? 0 : 8, 0, at ? 3 : 1};
        pthread_mutex_lock(&b->peer.mutex);
        b->peer.behaviour = MODBUS_SCRIPT;
        memcpy(b->peer.script + 2, echo, sizeof echo);
        b->peer.script_length = 2 + sizeof echo;
        pthread_mutex_unlock(&b->peer.mutex);
        do
            rc = exchange(b, &u, &y);
        while (rc == APC_ECONN);
        assert_int_equal(rc, APC_EPROTO);
        assert_non_null(strstr(apc_exchange_error(b->x), at ? "number of them, is 3, and should be 1"
                                                            : "its address is 8, and should be 0"));
    }
    end(b);
}

/* What says that it is longer than any reply may be is refused at once, and not waited for. */
static void a_reply_that_would_be_too_long_is_not_waited_for(void **state)
{
    const struct apc_modbus_point p = point(APC_MODBUS_HOLDING, APC_MODBUS_U16, 0);
    const unsigned char head[] = {0, 0, 0, 0, 0, 255, 0, 3};
    struct apc_value y;
    int rc;
    (void)state;
    struct bench *b = start(1, 1, (struct apc_modbus_options){.u = &p, .y = &p});
    pthread_mutex_lock(&b->peer.mutex);
    b->peer.behaviour = MODBUS_SCRIPT;
    memcpy(b->peer.script, head, sizeof head);
    b->peer.script_length = sizeof head;
    pthread_mutex_unlock(&b->peer.mutex);
    do /* a connect may take its time */
        rc = exchange(b, NULL, &y);
    while (rc == APC_ECONN);
    assert_int_equal(rc, APC_EPROTO);
    end(b);
}

/* What stands in its head says how long a frame is, or that it is none. */
static void a_frame_is_as_long_as_its_head_says(void **state)
{
    static const struct {
        size_t there;
        unsigned protocol, length;
        int whole;
    } cases[] = {
        {5, 0, 6, 0},          {6, 0, 6, 12},           {260, 0, 6, 12},           {7, 0, 2, 8},
        {7, 0, 1, APC_EPROTO}, {7, 0, 0, APC_EPROTO},   {6, 0, 254, 260},          {6, 0, 255, APC_EPROTO},
        {6, 1, 6, APC_EPROTO}, {6, 256, 6, APC_EPROTO}, {6, 0, 65535, APC_EPROTO},
    };
    (void)state;
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        char frame[APC_MODBUS_FRAME] = {1, 2};
        frame[2] = (char)(cases[i].protocol >> 8);
        frame[3] = (char)cases[i].protocol;
        frame[4] = (char)(cases[i].length >> 8);
        frame[5] = (char)cases[i].length;
        assert_int_equal(apc_modbus_whole(frame, cases[i].there), cases[i].whole);
    }
}

static void a_map_that_makes_no_sense_is_refused(void **state)
{
    const struct apc_modbus_point
        good = point(APC_MODBUS_HOLDING, APC_MODBUS_U16, 0),
        not_finite = {.area = APC_MODBUS_HOLDING, .type = APC_MODBUS_U16, .scale = (double)INFINITY},
        nowhere = {.area = APC_MODBUS_HOLDING, .type = APC_MODBUS_U16, .offset = (double)NAN},
        unsafe = {.area = APC_MODBUS_HOLDING, .type = APC_MODBUS_U16, .safe = -(double)INFINITY};
    struct {
        struct apc_modbus_point p;
        bool output;
        const char *why;
    } cases[] = {
        {point(APC_MODBUS_INPUT, APC_MODBUS_U16, 0), true,
         "output 1: only coils and holding registers can be written"},
        {point(APC_MODBUS_DISCRETE, APC_MODBUS_BIT, 0), true, "can be written"},
        {point(APC_MODBUS_COIL, APC_MODBUS_U16, 0), false,
         "measurement 1: coils and discrete inputs are bits"},
        {point(APC_MODBUS_HOLDING, APC_MODBUS_BIT, 0), false, "registers are not"},
        {point(APC_MODBUS_HOLDING, APC_MODBUS_F64, 65533), false,
         "measurement 1: address 65533 is beyond 65535"},
        {point(APC_MODBUS_HOLDING, APC_MODBUS_U16, 4000000000u), false, "beyond 65535"},
        {point(APC_MODBUS_HOLDING, 0, 0), false, "are bits"},
        {point(0, APC_MODBUS_U16, 0), false, "are bits"},
        {not_finite, true, "output 1: scale, offset and safe must be finite"},
        {not_finite, false, "measurement 1: scale, offset and safe must be finite"},
        {nowhere, false, "must be finite"},
        {unsafe, true, "must be finite"},
        {point(APC_MODBUS_HOLDING, APC_MODBUS_F64 + 1, 0), false, "are bits"},
        {point(APC_MODBUS_HOLDING + 1, APC_MODBUS_U16, 0), false, "are bits"},
        {point(APC_MODBUS_HOLDING, APC_MODBUS_U16, 65536), false, "address 65536 is beyond 65535"},
        {point(APC_MODBUS_HOLDING, APC_MODBUS_U32, 65535), false, "beyond 65535"},
    };
    struct apc_modbus_options o = {.size = sizeof o, .u = &good, .y = &good};
    const struct apc_exchange_options options = {.size = sizeof options, .nu = 1, .ny = 1, .modbus = &o};
    struct apc_exchange *x;
    struct apc_error why;
    (void)state;
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        o.u = cases[i].output ? &cases[i].p : &good;
        o.y = cases[i].output ? &good : &cases[i].p;
        assert_int_equal(apc_exchange_open(&x, "modbus:127.0.0.1:502", &options, &why), APC_EINVAL);
        if (!strstr(why.text, cases[i].why))
            fail_msg("\"%s\" says nothing of \"%s\"", why.text, cases[i].why);
    }
    o = (struct apc_modbus_options){.size = sizeof o, .u = &good, .y = &good, .watchdog = &good};
    assert_int_equal(apc_exchange_open(&x, "modbus:127.0.0.1:502", &options, &why), APC_EINVAL);
    assert_non_null(strstr(why.text, "two outputs are written to address 0"));
    o = (struct apc_modbus_options){.size = sizeof o, .u = &good, .y = &good, .life = &good};
    assert_int_equal(apc_exchange_open(&x, "modbus:127.0.0.1:502", &options, &why), APC_EINVAL);
    o = (struct apc_modbus_options){.size = sizeof o, .u = &good, .y = &good, .unit = 256};
    assert_int_equal(apc_exchange_open(&x, "modbus:127.0.0.1:502", &options, &why), APC_EINVAL);
    o.unit = 255;
    assert_int_equal(apc_exchange_open(&x, "modbus:127.0.0.1", &options, &why), APC_EINVAL);
    assert_int_equal(apc_exchange_open(&x, "modbus:127.0.0.1:502", &options, &why), 0);
    apc_exchange_close(x);
}

/* Up to the last register, side by side, at one address of two areas. */
static void a_map_may_use_each_place_there_is(void **state)
{
    static const struct apc_modbus_point y = {
        .area = APC_MODBUS_INPUT, .type = APC_MODBUS_U16, .address = 65535};
    const struct apc_modbus_point cases[][2] = {
        {point(APC_MODBUS_HOLDING, APC_MODBUS_F64, 65532), point(APC_MODBUS_HOLDING, APC_MODBUS_F64, 65528)},
        {point(APC_MODBUS_HOLDING, APC_MODBUS_U16, 65535), point(APC_MODBUS_HOLDING, APC_MODBUS_F32, 65533)},
        {point(APC_MODBUS_HOLDING, APC_MODBUS_U16, 0), point(APC_MODBUS_HOLDING, APC_MODBUS_U16, 1)},
        {point(APC_MODBUS_HOLDING, APC_MODBUS_U16, 7), point(APC_MODBUS_COIL, APC_MODBUS_BIT, 7)},
    };
    struct apc_exchange *x;
    struct apc_error why;
    (void)state;
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        struct apc_modbus_options o = {.size = sizeof o, .u = cases[i], .y = &y};
        const struct apc_exchange_options options = {.size = sizeof options, .nu = 2, .ny = 1, .modbus = &o};
        if (apc_exchange_open(&x, "modbus:127.0.0.1:502", &options, &why) < 0)
            fail_msg("%zu: %s", i, why.text);
        apc_exchange_close(x);
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(a_value_of_each_type_stands_as_the_specification_has_it),
        cmocka_unit_test(what_does_not_fit_is_not_written_nor_anything_beside_it),
        cmocka_unit_test(what_just_fits_is_written),
        cmocka_unit_test(a_register_that_holds_no_number_is_bad),
        cmocka_unit_test(what_is_next_to_each_other_goes_in_one_request),
        cmocka_unit_test(a_request_has_no_more_than_a_frame_holds),
        cmocka_unit_test(an_exception_is_a_status_when_read_and_a_failure_when_written),
        cmocka_unit_test(a_device_that_is_busy_is_asked_again_in_time),
        cmocka_unit_test(a_server_that_closes_after_each_answer_gives_all),
        cmocka_unit_test(a_device_that_writes_one_at_a_time_is_written_so),
        cmocka_unit_test(a_value_of_several_registers_is_not_written_one_at_a_time),
        cmocka_unit_test(a_request_has_no_more_registers_than_a_block),
        cmocka_unit_test(a_map_may_name_several_units),
        cmocka_unit_test(a_device_that_its_gateway_does_not_reach_leaves_the_others),
        cmocka_unit_test(a_silent_unit_costs_its_own_values_only),
        cmocka_unit_test(a_late_reply_is_dropped_by_its_number),
        cmocka_unit_test(a_unit_for_which_its_gateway_hangs_up_costs_no_other),
        cmocka_unit_test(a_gateway_that_waits_for_a_silent_unit_is_left_in_peace),
        cmocka_unit_test(a_watchdog_waits_for_outputs_of_a_silent_unit),
        cmocka_unit_test(a_silent_unit_keeps_no_other_from_its_safe_values),
        cmocka_unit_test(a_reply_may_come_in_pieces),
        cmocka_unit_test(a_bit_of_a_register_is_read_and_written_by_itself),
        cmocka_unit_test(a_code_for_no_value_is_none),
        cmocka_unit_test(the_watchdog_counts_what_was_given_whole),
        cmocka_unit_test(each_outputs_watchdog_counts_by_itself),
        cmocka_unit_test(an_output_that_is_another_than_was_given_is_found),
        cmocka_unit_test(once_its_sign_of_life_stands_still_nothing_is_good),
        cmocka_unit_test(no_bytes_hang_it_or_get_past_it),
        cmocka_unit_test(what_is_wrong_with_a_reply_is_told),
        cmocka_unit_test(a_reply_that_would_be_too_long_is_not_waited_for),
        cmocka_unit_test(a_frame_is_as_long_as_its_head_says),
        cmocka_unit_test(a_map_that_makes_no_sense_is_refused),
        cmocka_unit_test(a_map_may_use_each_place_there_is),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}

/* SPDX-License-Identifier: BSD-3-Clause */
/* A plant as a Modbus server: what each request is answered, and what never reaches the plant. */
#include "check.h"

#include <arpa/inet.h>
#include <errno.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/socket.h>
#include <unistd.h>

#include <apcexchange.h>

#define PATIENCE (60 * APC_NS_PER_S)
enum { NU = 3, NY = 4 };

struct plant {
    struct apc_modbus_unit *unit;
    double u[NU];
    struct apc_value y[NY];
    unsigned life, commands, signs;
    int refuses; /* with this exception; 0: takes */
};

/* What a test map holds: u at holding:0 (float32), coil:5 and holding:10 (int16, halves), the watchdog at
 * holding:2; y at input:0 (float32), discrete:3, input:10 (uint16, hundredths) and coil:6; life at input:2.
 */
static const struct apc_modbus_point U[NU] = {
    {.area = APC_MODBUS_HOLDING, .type = APC_MODBUS_F32, .address = 0, .safe = 1.5},
    {.area = APC_MODBUS_COIL, .type = APC_MODBUS_BIT, .address = 5, .safe = 1},
    {.area = APC_MODBUS_HOLDING, .type = APC_MODBUS_S16, .address = 10, .scale = 0.5, .safe = -1}};
static const struct apc_modbus_point Y[NY] = {
    {.area = APC_MODBUS_INPUT,
     .type = APC_MODBUS_F32,
     .address = 0,
     .no_value = {0xC61C3C00}, /* -9999 */
     .n_no_value = 1},
    {.area = APC_MODBUS_DISCRETE, .type = APC_MODBUS_BIT, .address = 3},
    {.area = APC_MODBUS_INPUT, .type = APC_MODBUS_U16, .address = 10, .scale = 0.01},
    {.area = APC_MODBUS_COIL, .type = APC_MODBUS_BIT, .address = 6}};
static const struct apc_modbus_point WATCHDOG = {
    .area = APC_MODBUS_HOLDING, .type = APC_MODBUS_U16, .address = 2};
static const struct apc_modbus_point LIFE = {.area = APC_MODBUS_INPUT, .type = APC_MODBUS_U16, .address = 2};

static int command(void *ctx, const double *u, bool alive)
{
    struct plant *p = ctx;
    if (p->refuses)
        return p->refuses;
    memcpy(p->u, u, sizeof p->u);
    p->commands++;
    p->signs += alive;
    return 0;
}

static unsigned measure(void *ctx, struct apc_value *y)
{
    struct plant *p = ctx;
    memcpy(y, p->y, sizeof p->y);
    return p->life;
}

static void open_unit(struct plant *p, bool watched)
{
    const struct apc_modbus_options map = {.size = sizeof map,
                                           .unit = 7,
                                           .u = U,
                                           .y = Y,
                                           .watchdog = watched ? &WATCHDOG : NULL,
                                           .life = &LIFE,
                                           .life_limit = APC_NS_PER_S};
    const struct apc_modbus_unit_options options = {.size = sizeof options,
                                                    .nu = NU,
                                                    .ny = NY,
                                                    .modbus = &map,
                                                    .command = command,
                                                    .measure = measure,
                                                    .ctx = p};
    struct apc_error why;
    *p = (struct plant){.y = {{.value = 0.5}, {.value = 1}, {.value = 655.35}, {.value = 1}},
                        .life = 65536 + 9};
    if (apc_modbus_unit_create(&p->unit, &options, &why) < 0)
        fail_msg("%s", why.text);
}

static size_t bytes_of(const char *hex, char *to)
{
    size_t n = 0;
    for (unsigned byte; sscanf(hex += strspn(hex, " "), "%2x", &byte) == 1; hex += 2)
        to[n++] = (char)byte;
    return n;
}

/* The reply to a request, both without what stands before the function's number, in hex. */
static char *ask_as(struct plant *p, unsigned unit, const char *request)
{
    static char hex[2 * APC_MODBUS_FRAME + 1];
    char frame[APC_MODBUS_FRAME] = {0x12, 0x34}, reply[APC_MODBUS_FRAME];
    const size_t n = bytes_of(request, frame + 7);
    frame[5] = (char)(n + 1);
    frame[6] = (char)unit;
    const int length = apc_modbus_unit_answer(p->unit, frame, n + 7, reply, sizeof reply);
    assert_true(length > 8 && length <= APC_MODBUS_FRAME);
    assert_memory_equal(reply, frame, 4);
    assert_int_equal(reply[6], frame[6]);
    assert_int_equal((unsigned char)reply[4] << 8 | (unsigned char)reply[5], length - 6);
    for (int i = 7; i < length; i++)
        (void)snprintf(hex + 2 * (i - 7), 3, "%02x", (unsigned char)reply[i]);
    return hex;
}

static char *ask(struct plant *p, const char *request)
{
    return ask_as(p, 7, request);
}

/*
 * Promise(links/plant-ours-modbus): A plant of ours as a Modbus server: each request is answered as the
 *   specification has it; nothing but whole numbers within the limits reaches the plant; it watches its
 *   client; no bytes do harm.
 */
static void each_request_is_answered_as_the_specification_has_it(void **state)
{
    static const struct {
        const char *request, *reply;
    } cases[] = {
        /* what stands there at first: the safe values */
        {"03 0000 0002", "03043fc00000"},
        {"03 0000 0003", "03063fc000000000"},
        {"03 000a 0001", "0302fffe"},
        {"01 0005 0001", "010101"},
        /* a half of a value may be read */
        {"03 0000 0001", "03023fc0"},
        {"04 0001 0002", "040400000009"},
        /* measurements; a coil that is measured stands beside one that is written */
        {"04 0000 0002", "04043f000000"},
        {"04 000a 0001", "0402ffff"},
        {"02 0003 0001", "020101"},
        {"01 0005 0002", "010103"},
        /* nothing stands there, in front, behind, between */
        {"03 0003 0001", "8302"},
        {"03 0002 0002", "8302"},
        {"04 0002 0009", "8402"},
        {"01 0004 0002", "8102"},
        {"02 0002 0002", "8202"},
        {"04 ffff 0001", "8402"},
        /* quantities */
        {"04 0000 0000", "8403"},
        {"04 0000 007e", "8403"},
        {"01 0000 07d1", "8103"},
        {"04 0000", "8403"},
        {"04 0000 0002 00", "8403"},
        /* writing */
        {"10 0000 0003 06 40200000 0001", "1000000003"},
        {"03 0000 0003", "0306402000000001"},
        {"06 000a fffe", "06000afffe"},
        {"05 0005 0000", "0500050000"},
        {"0f 0005 0001 01 01", "0f00050001"},
        {"06 0002 0002", "0600020002"},
        /* some bits of what stands there, -1 of halves: 4 is 2 */
        {"16 000a fff0 0004", "16000afff00004"},
        {"03 000a 0001", "0302fff4"},
        {"16 000a 0000 0004", "16000a00000004"},
        {"16 0005 0000 0004", "9602"},
        {"16 000a 0000", "9603"},
        {"16 0000 00f2 0025", "9603"},
        /* a half of a value is none */
        {"06 0000 4020", "8603"},
        {"10 0001 0002 04 0000 0001", "9003"},
        {"10 0000 0001 02 4020", "9003"},
        /* no number */
        {"10 0000 0002 04 7fc00000", "9003"},
        {"10 0000 0002 04 7f800000", "9003"},
        /* not there, not to be written */
        {"06 0003 0001", "8602"},
        {"05 0006 ff00", "8502"},
        {"10 0002 0002 04 0001 0001", "9002"},
        {"0f 0005 0002 01 03", "8f02"},
        /* malformed */
        {"05 0005 0001", "8503"},
        {"05 0005", "8503"},
        {"10 0000 0002 03 402000", "9003"},
        {"10 0000 0002 04 4020", "9003"},
        {"10 0000 0002", "9003"},
        {"10 0000 0000 00", "9003"},
        {"10 0000 007c f8", "9003"},
        {"0f 0005 0001 02 0101", "8f03"},
        /* functions that are none of ours */
        {"07", "8701"},
        {"2b 0e 01 00", "ab01"},
        {"00", "8001"},
        {"83 0000 0001", "8301"},
    };
    struct plant p;
    (void)state;
    open_unit(&p, true);
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++)
        if (strcmp(ask(&p, cases[i].request), cases[i].reply) != 0)
            fail_msg("%s: %s, not %s", cases[i].request, ask(&p, cases[i].request), cases[i].reply);
    assert_int_equal(p.commands, 7);
    assert_near(p.u[0], 2.5, 0.0);
    assert_near(p.u[1], 1.0, 0.0);
    assert_near(p.u[2], 2.0, 0.0);
    apc_modbus_unit_destroy(p.unit);
}

static void another_unit_does_not_answer_for_this_one(void **state)
{
    struct plant p;
    (void)state;
    open_unit(&p, true);
    assert_string_equal(ask_as(&p, 8, "03 0000 0001"), "830b");
    assert_string_equal(ask_as(&p, 8, "06 000a 0004"), "860b");
    assert_int_equal(p.commands, 0);
    assert_string_equal(ask_as(&p, 0, "03 0000 0001"), "03023fc0");
    assert_string_equal(ask_as(&p, 255, "03 0000 0001"), "03023fc0");
    apc_modbus_unit_destroy(p.unit);
}

/* Promise(links/plant-ours-modbus) */
static void what_the_plant_refuses_is_as_if_it_was_never_written(void **state)
{
    struct plant p;
    (void)state;
    open_unit(&p, true);
    p.refuses = 6;
    assert_string_equal(ask(&p, "10 0000 0003 06 40200000 0001"), "9006");
    assert_string_equal(ask(&p, "03 0000 0003"), "03063fc000000000");
    p.refuses = 0;
    assert_string_equal(ask(&p, "06 000a 0004"), "06000a0004");
    assert_near(p.u[0], 1.5, 0.0);
    assert_int_equal(p.signs, 0);
    apc_modbus_unit_destroy(p.unit);
}

/* Promise(links/plant-ours-modbus) */
static void a_sign_of_life_is_a_new_count_or_any_write(void **state)
{
    struct plant p;
    (void)state;
    open_unit(&p, true);
    ask(&p, "06 000a 0004");
    assert_int_equal(p.signs, 0);
    ask(&p, "06 0002 0001");
    ask(&p, "06 0002 0001");
    assert_int_equal(p.signs, 1);
    ask(&p, "06 0002 0000");
    assert_int_equal(p.signs, 2);
    assert_int_equal(p.commands, 4);
    apc_modbus_unit_destroy(p.unit);
    open_unit(&p, false);
    ask(&p, "06 000a 0004");
    ask(&p, "06 000a 0004");
    assert_int_equal(p.signs, 2);
    assert_string_equal(ask(&p, "06 0002 0001"), "8602");
    apc_modbus_unit_destroy(p.unit);
}

static void a_measurement_beyond_its_register_is_the_end_of_it_and_a_bad_one_a_failure(void **state)
{
    struct plant p;
    (void)state;
    open_unit(&p, true);
    p.y[2].value = 700;
    assert_string_equal(ask(&p, "04 000a 0001"), "0402ffff");
    p.y[2].value = -0.3;
    assert_string_equal(ask(&p, "04 000a 0001"), "04020000");
    p.y[2].status = APC_UNCERTAIN;
    assert_string_equal(ask(&p, "04 000a 0001"), "04020000");
    p.y[0].status = APC_BAD_SENSOR_FAILURE; /* it has a code for that */
    assert_string_equal(ask(&p, "04 0000 0002"), "0404c61c3c00");
    p.y[0].status = APC_GOOD;
    p.y[2].status = APC_BAD_SENSOR_FAILURE;
    assert_string_equal(ask(&p, "04 000a 0001"), "8404");
    assert_string_equal(ask(&p, "04 0000 0002"), "04043f000000"); /* the others go on */
    p.y[1].value = 0.4;
    assert_string_equal(ask(&p, "02 0003 0001"), "020100");
    apc_modbus_unit_destroy(p.unit);
}

static void a_map_in_which_two_stand_at_one_place_cannot_be_served(void **state)
{
    const struct apc_modbus_point same = {.area = APC_MODBUS_HOLDING, .type = APC_MODBUS_U16, .address = 1};
    const struct apc_modbus_options map = {.size = sizeof map, .u = U, .y = &same};
    struct apc_modbus_unit_options o = {
        .size = sizeof o, .nu = 1, .ny = 1, .modbus = &map, .command = command, .measure = measure};
    struct apc_modbus_unit *unit;
    struct apc_error why;
    (void)state;
    assert_int_equal(apc_modbus_unit_create(&unit, &o, &why), APC_EINVAL);
    assert_non_null(strstr(why.text, "two values stand at address 1"));
    assert_null(unit);
    o.measure = NULL;
    assert_int_equal(apc_modbus_unit_create(&unit, &o, &why), APC_EINVAL);
    assert_int_equal(apc_modbus_unit_create(&unit, NULL, &why), APC_EINVAL);
    assert_int_equal(apc_modbus_unit_create(NULL, &o, &why), APC_EINVAL);
    apc_modbus_unit_destroy(NULL);
}

/* Whatever bytes: a reply that is one, and to the plant only numbers. */
/* Promise(links/plant-ours-modbus) */
static void no_bytes_do_harm(void **state)
{
    struct apc_random random;
    char reply[APC_MODBUS_FRAME];
    struct plant p;
    unsigned answered = 0;
    (void)state;
    apc_random_init(&random, 1, "bytes");
    open_unit(&p, true);
    for (int i = 0; i < 200000; i++) {
        char *frame = malloc(APC_MODBUS_FRAME); /* so that a sanitizer sees a byte beyond it */
        size_t n = i % 2 ? 12 : 8 + (size_t)(apc_random_uniform(&random) * 30);
        char *request = malloc(n);
        for (size_t k = 0; k < n; k++)
            request[k] = (char)(apc_random_uniform(&random) < 0.5 ? apc_random_uniform(&random) * 12
                                                                  : apc_random_uniform(&random) * 256);
        if (i % 16) {
            request[2] = request[3] = request[4] = 0;
            request[5] = (char)(n - 6);
            request[6] = 7;
            if (n > 8)
                request[8] = 0; /* something stands at low addresses only */
        }
        const int length = apc_modbus_unit_answer(p.unit, request, n, frame, APC_MODBUS_FRAME);
        assert_true(length == APC_EPROTO || (length > 8 && length <= APC_MODBUS_FRAME));
        answered += length > 0;
        free(request);
        free(frame);
    }
    assert_true(answered > 100000);
    assert_true(p.commands > 100);
    for (size_t i = 0; i < NU; i++)
        assert_true(isfinite(p.u[i]));
    char few[8] = {0, 1, 0, 0, 0, 2, 7, 3};
    assert_int_equal(apc_modbus_unit_answer(p.unit, few, 7, reply, sizeof reply), APC_EPROTO);
    assert_int_equal(apc_modbus_unit_answer(p.unit, few, 8, reply, sizeof reply - 1), APC_ERANGE);
    assert_int_equal(apc_modbus_unit_answer(p.unit, few, 8, reply, sizeof reply), 9);
    apc_modbus_unit_destroy(p.unit);
}

/* ---- Over a server ---------------------------------------------------------------------------- */

static int serve(void *ctx, uint64_t connection, const char *request, size_t length, char *reply, size_t size)
{
    struct plant *p = ctx;
    (void)connection;
    return apc_modbus_unit_answer(p->unit, request, length, reply, size);
}

static struct apc_server *start(struct plant *p)
{
    const struct apc_server_options options = {.size = sizeof options,
                                               .frame_max = APC_MODBUS_FRAME,
                                               .frame_timeout = PATIENCE,
                                               .whole = apc_modbus_whole};
    struct apc_server *server;
    struct apc_error why;
    open_unit(p, true);
    if (apc_server_create(&server, "tcp:127.0.0.1:0", &options, serve, p, &why) < 0)
        fail_msg("%s", why.text);
    return server;
}

/* Of outputs that have their own the count of any is a sign of life, and no value is. */
/* Promise(links/output-own-watchdog) */
static void a_new_count_of_any_watchdog_is_a_sign_of_life(void **state)
{
    static const struct apc_modbus_point u[NU] = {
        {.area = APC_MODBUS_HOLDING, .type = APC_MODBUS_U16, .address = 0},
        {.area = APC_MODBUS_HOLDING, .type = APC_MODBUS_U16, .address = 1},
        {.area = APC_MODBUS_HOLDING, .type = APC_MODBUS_U16, .address = 2}};
    static const struct apc_modbus_point watchdogs[NU] = {
        {.area = APC_MODBUS_HOLDING, .type = APC_MODBUS_U16, .address = 3},
        {0},
        {.area = APC_MODBUS_HOLDING, .type = APC_MODBUS_U16, .address = 4}};
    const struct apc_modbus_options map = {
        .size = sizeof map, .unit = 7, .u = u, .y = Y, .watchdogs = watchdogs};
    struct plant p = {0};
    const struct apc_modbus_unit_options options = {.size = sizeof options,
                                                    .nu = NU,
                                                    .ny = NY,
                                                    .modbus = &map,
                                                    .command = command,
                                                    .measure = measure,
                                                    .ctx = &p};
    (void)state;
    assert_int_equal(apc_modbus_unit_create(&p.unit, &options, NULL), 0);
    assert_string_equal(ask(&p, "06 0000 0007"), "0600000007");
    assert_int_equal(p.commands, 1);
    assert_int_equal(p.signs, 0);
    assert_string_equal(ask(&p, "06 0003 0001"), "0600030001");
    assert_string_equal(ask(&p, "06 0003 0001"), "0600030001"); /* the same once more */
    assert_int_equal(p.signs, 1);
    assert_string_equal(ask(&p, "10 0002 0003 06 0009 0001 0001"), "1000020003");
    assert_int_equal(p.signs, 2);
    assert_near(p.u[2], 9.0, 0.0);
    assert_string_equal(ask(&p, "03 0000 0005"), "030a00070000000900010001");
    apc_modbus_unit_destroy(p.unit);
}

/* Wherever the two stand that share one. */
static void each_address_is_one_values(void **state)
{
    (void)state;
    for (unsigned i = 0; i < NY; i++) {
        for (unsigned j = 0; j < i; j++) {
            struct apc_modbus_point y[NY];
            const struct apc_modbus_options map = {.size = sizeof map, .u = U, .y = y};
            const struct apc_modbus_unit_options options = {.size = sizeof options,
                                                            .nu = NU,
                                                            .ny = NY,
                                                            .modbus = &map,
                                                            .command = command,
                                                            .measure = measure};
            struct apc_modbus_unit *unit;
            struct apc_error why;
            char sentence[120];
            for (unsigned k = 0; k < NY; k++)
                y[k] = (struct apc_modbus_point){
                    .area = APC_MODBUS_INPUT, .type = APC_MODBUS_F32, .address = 20 + 2 * k};
            assert_int_equal(apc_modbus_unit_create(&unit, &options, &why), 0);
            apc_modbus_unit_destroy(unit);
            y[i].address = 21 + 2 * j;
            y[j].address = 20 + 2 * j;
            assert_int_equal(apc_modbus_unit_create(&unit, &options, &why), APC_EINVAL);
            snprintf(sentence, sizeof sentence,
                     "modbus: two values stand at address %u: a plant that is served needs a place for each",
                     21 + 2 * j);
            assert_string_equal(why.text, sentence);
            assert_null(unit);
        }
    }
}

/* What the one side writes the other reads, and the reverse. */
static void our_client_and_our_plant_understand_each_other(void **state)
{
    const struct apc_modbus_options map = {.size = sizeof map,
                                           .unit = 7,
                                           .u = U,
                                           .y = Y,
                                           .watchdog = &WATCHDOG,
                                           .life = &LIFE,
                                           .life_limit = PATIENCE};
    const struct apc_exchange_options options = {.size = sizeof options, .nu = NU, .ny = NY, .modbus = &map};
    struct apc_value u[NU] = {{.value = 0}}, y[NY];
    struct apc_exchange *x;
    struct apc_error why;
    struct plant p;
    char uri[64];
    (void)state;
    struct apc_server *server = start(&p);
    snprintf(uri, sizeof uri, "modbus:127.0.0.1:%d", apc_server_port(server));
    assert_int_equal(apc_exchange_open(&x, uri, &options, &why), 0);
    for (int i = 0; i < 500; i++) {
        u[0].value = i / 8.0;
        u[1].value = i % 2;
        u[2].value = -i / 2.0;
        assert_int_equal(apc_exchange_begin(x, u, apc_clock_mono(NULL) + PATIENCE), 0);
        assert_int_equal(apc_exchange_finish(x, y), 0);
        for (size_t k = 0; k < NU; k++)
            assert_near(p.u[k], u[k].value, 0.0);
        for (size_t k = 0; k < NY; k++) {
            assert_int_equal(y[k].status, APC_GOOD);
            assert_near(y[k].value, p.y[k].value, 1e-12);
        }
    }
    assert_true(p.signs == 500);
    apc_exchange_close(x);
    apc_server_destroy(server);
    apc_modbus_unit_destroy(p.unit);
}

static int connect_to(struct apc_server *server)
{
    const struct sockaddr_in at = {.sin_family = AF_INET,
                                   .sin_port = htons((uint16_t)apc_server_port(server)),
                                   .sin_addr.s_addr = htonl(INADDR_LOOPBACK)};
    const int fd = socket(AF_INET, SOCK_STREAM, 0);
    const struct timeval patience = {.tv_sec = 60};
    assert_int_equal(connect(fd, (const struct sockaddr *)&at, sizeof at), 0);
    assert_int_equal(setsockopt(fd, SOL_SOCKET, SO_RCVTIMEO, &patience, sizeof patience), 0);
    return fd;
}

/* Promise(links/plant-ours-modbus) */
static void requests_may_come_in_pieces_and_several_at_once(void **state)
{
    static const char two_and_a_half[] =
        "0001 0000 0006 07 04 000a 0001 0002 0000 0006 07 02 0003 0001 0003 0000 00";
    static const char rest[] = "06 07 01 0005 0001";
    char bytes[100], reply[100];
    struct plant p;
    (void)state;
    struct apc_server *server = start(&p);
    const int fd = connect_to(server);
    size_t n = bytes_of(two_and_a_half, bytes);
    assert_int_equal(send(fd, bytes, n, 0), (ssize_t)n);
    assert_int_equal(recv(fd, reply, 21, MSG_WAITALL), 21); /* 11 and 10 */
    assert_memory_equal(reply, "\0\1\0\0\0\5\7\4\2\xff\xff\0\2\0\0\0\4\7\2\1\1", 21);
    n = bytes_of(rest, bytes);
    for (size_t i = 0; i < n; i++)
        assert_int_equal(send(fd, bytes + i, 1, 0), 1);
    assert_int_equal(recv(fd, reply, 10, MSG_WAITALL), 10);
    assert_memory_equal(reply, "\0\3\0\0\0\4\7\1\1\1", 10);
    close(fd);
    apc_server_destroy(server);
    apc_modbus_unit_destroy(p.unit);
}

/* Promise(links/plant-ours-modbus) */
static void who_speaks_something_else_is_sent_away(void **state)
{
    static const char http[] = "GET / HTTP/1.1\r\n\r\n";
    char reply[100];
    struct plant p;
    (void)state;
    struct apc_server *server = start(&p);
    const int fd = connect_to(server);
    assert_int_equal(send(fd, http, sizeof http - 1, 0), sizeof http - 1);
    const ssize_t n = recv(fd, reply, sizeof reply, 0);
    assert_true(n == 0 || (n < 0 && errno == ECONNRESET));
    close(fd);
    assert_int_equal(p.commands, 0);
    apc_server_destroy(server);
    apc_modbus_unit_destroy(p.unit);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(each_request_is_answered_as_the_specification_has_it),
        cmocka_unit_test(another_unit_does_not_answer_for_this_one),
        cmocka_unit_test(what_the_plant_refuses_is_as_if_it_was_never_written),
        cmocka_unit_test(a_sign_of_life_is_a_new_count_or_any_write),
        cmocka_unit_test(a_measurement_beyond_its_register_is_the_end_of_it_and_a_bad_one_a_failure),
        cmocka_unit_test(a_map_in_which_two_stand_at_one_place_cannot_be_served),
        cmocka_unit_test(no_bytes_do_harm),
        cmocka_unit_test(a_new_count_of_any_watchdog_is_a_sign_of_life),
        cmocka_unit_test(each_address_is_one_values),
        cmocka_unit_test(our_client_and_our_plant_understand_each_other),
        cmocka_unit_test(requests_may_come_in_pieces_and_several_at_once),
        cmocka_unit_test(who_speaks_something_else_is_sent_away),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}

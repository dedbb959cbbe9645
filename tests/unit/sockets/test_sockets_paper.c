/* SPDX-License-Identifier: BSD-3-Clause */
/* The paper's functions, used as its listings use them. */
#include "apcsockets.h"
#include "check.h"

#include <errno.h>
#include <fcntl.h>
#include <netinet/in.h>
#include <netinet/tcp.h>
#include <stdio.h>
#include <string.h>
#include <sys/socket.h>
#include <unistd.h>

#define N 40

static char ts[N][1024], status[N][1024], ts_back[N][1024], status_back[N][1024];

static void what_is_packed_is_unpacked(void **state)
{
    const double u[] = {1.5, -2e-300, 0.1};
    double back[3] = {0};
    char buff[APC_PACK_MAX];
    int length;
    (void)state;

    snprintf(ts[0], sizeof ts[0], "%s", "2026-01-31 12:00:00.123456"); /* genTimeStampUTC() */
    snprintf(ts[1], sizeof ts[1], "%s", "2026-01-31T12:00:00.5Z");
    snprintf(ts[2], sizeof ts[2], "%s", "2026-01-31T13:00:00+01:00");
    snprintf(status[0], sizeof status[0], "%s", "'ok'");
    snprintf(status[1], sizeof status[1], "%s", "ok");
    snprintf(status[2], sizeof status[2], "%s", "'BadOutOfService'");
    length = packMultiMsg(buff, 3, ts, status, u);
    assert_string_equal(buff, "apc1 values 0 3;2026-01-31T12:00:00.123456Z,Good,1.5;"
                              "2026-01-31T12:00:00.500000Z,Good,-2.0000000000000001e-300;"
                              "2026-01-31T12:00:00.000000Z,BadOutOfService,0.10000000000000001;\n");
    assert_int_equal(length, strlen(buff));
    assert_int_equal(unpackMultiMsg(ts_back, status_back, back, buff), 3);
    assert_memory_equal(back, u, sizeof u);
    assert_string_equal(ts_back[0], "2026-01-31T12:00:00.123456Z");
    assert_string_equal(ts_back[2], "2026-01-31T12:00:00.000000Z");
    assert_string_equal(status_back[1], "Good");
    assert_string_equal(status_back[2], "BadOutOfService");
}

static void times_and_statuses_may_be_left_out(void **state)
{
    const double u = 7;
    double back = 0;
    apc_ns before = apc_clock_utc(NULL), stamp;
    char buff[APC_PACK_MAX];
    (void)state;

    assert_true(packMultiMsg(buff, 1, NULL, NULL, &u) > 0);
    assert_int_equal(unpackMultiMsg(ts_back, status_back, &back, buff), 1);
    assert_string_equal(status_back[0], "Good");
    assert_int_equal(apc_time_parse(ts_back[0], &stamp), 0);
    assert_true(stamp >= before - APC_NS_PER_US && stamp <= apc_clock_utc(NULL));
    assert_int_equal(unpackMultiMsg(NULL, NULL, &back, buff), 1);
    assert_near(back, 7, 0);
    assert_true(packMultiMsg(buff, 0, NULL, NULL, NULL) > 0);
    assert_int_equal(unpackMultiMsg(NULL, NULL, &back, buff), 0);
}

/* Hazard 11: the listing's own buffer overflows at about twenty variables. */
static void a_message_never_leaves_its_1024_bytes(void **state)
{
    double u[N];
    char buff[APC_PACK_MAX + 8];
    int fits = 0;
    (void)state;

    for (int i = 0; i < N; i++)
        u[i] = -0.1 * (i + 1);
    for (int n = 0; n <= N; n++) {
        int length;
        memset(buff, '#', sizeof buff);
        length = packMultiMsg(buff, n, NULL, NULL, u);
        assert_memory_equal(buff + APC_PACK_MAX, "########", 8);
        if (length < 0) {
            assert_int_equal(length, APC_ERANGE);
            assert_string_equal(buff, "");
        } else {
            assert_int_equal(length, strlen(buff));
            assert_int_equal(fits, n == 0 ? 0 : n - 1); /* once it does not fit it never does */
            fits = n;
        }
    }
    assert_in_range(fits, 15, 30);
    assert_int_equal(packMultiMsg(buff, 1000000, NULL, NULL, u), APC_ERANGE);
}

static void nothing_is_packed_from_bad_arguments(void **state)
{
    const double u = 1, nan_value = (double)NAN;
    char buff[APC_PACK_MAX] = "old";
    (void)state;

    snprintf(ts[0], sizeof ts[0], "%s", "2026-01-31 12:00:00");
    snprintf(status[0], sizeof status[0], "%s", "ok");
    assert_int_equal(packMultiMsg(NULL, 1, NULL, NULL, &u), APC_EINVAL);
    assert_int_equal(packMultiMsg(buff, -1, NULL, NULL, &u), APC_EINVAL);
    assert_string_equal(buff, "");
    assert_int_equal(packMultiMsg(buff, 1, NULL, NULL, NULL), APC_EINVAL);
    assert_int_equal(packMultiMsg(buff, 1, NULL, NULL, &nan_value), APC_EINVAL);
    snprintf(buff, sizeof buff, "%s", "old");
    snprintf(status[0], sizeof status[0], "%s", "ok'); DROP TABLE sensor; --");
    assert_int_equal(packMultiMsg(buff, 1, ts, status, &u), APC_EINVAL);
    assert_string_equal(buff, "");
    snprintf(status[0], sizeof status[0], "%s", "'");
    assert_int_equal(packMultiMsg(buff, 1, ts, status, &u), APC_EINVAL);
    memset(status[0], 'x', sizeof status[0]); /* not terminated */
    assert_int_equal(packMultiMsg(buff, 1, ts, status, &u), APC_EINVAL);
    snprintf(status[0], sizeof status[0], "%s", "ok");
    memset(ts[0], '1', sizeof ts[0]);
    assert_int_equal(packMultiMsg(buff, 1, ts, status, &u), APC_EINVAL);
    snprintf(ts[0], sizeof ts[0], "%s", "yesterday");
    assert_int_equal(packMultiMsg(buff, 1, ts, status, &u), APC_EINVAL);
}

static void garbage_unpacks_to_nothing(void **state)
{
    static const char *const bad[] = {"",
                                      "7",
                                      "hello\n",
                                      "apc1 values 0 1;2026-01-31T12:00:00.123456Z,Good,1;",
                                      "apc1 values 0 2;2026-01-31T12:00:00.123456Z,Good,1;\n",
                                      "apc1 values 0 2;2026-01-31T12:00:00.123456Z,Good,1;x\n"};
    char long_text[2 * APC_PACK_MAX];
    double values[2] = {42, 43};
    (void)state;

    snprintf(ts_back[0], sizeof ts_back[0], "%s", "old");
    snprintf(status_back[0], sizeof status_back[0], "%s", "old");
    for (size_t i = 0; i < sizeof bad / sizeof *bad; i++)
        assert_int_equal(unpackMultiMsg(ts_back, status_back, values, bad[i]), APC_EPROTO);
    memset(long_text, 'a', sizeof long_text); /* no end within the 1024 bytes that a listing's buffer has */
    assert_int_equal(unpackMultiMsg(ts_back, status_back, values, long_text), APC_EPROTO);
    assert_int_equal(unpackMultiMsg(ts_back, status_back, NULL, bad[0]), APC_EINVAL);
    assert_int_equal(unpackMultiMsg(ts_back, status_back, values, NULL), APC_EINVAL);
    assert_near(values[0], 42, 0);
    assert_near(values[1], 43, 0);
    assert_string_equal(ts_back[0], "old");
    assert_string_equal(status_back[0], "old");
}

/* Hazard 10: Listing 4 does not clear its buffer, and "7" after "-123.456" was applied as 7123.46. */
static void a_short_message_over_a_long_one_is_the_short_one(void **state)
{
    const double first = -123.456, second = 7;
    double back = 0;
    char buff[APC_PACK_MAX], message[APC_PACK_MAX];
    int length;
    (void)state;

    assert_true(packMultiMsg(buff, 1, NULL, NULL, &first) > 0);
    length = packMultiMsg(message, 1, NULL, NULL, &second);
    memcpy(buff, message, (size_t)length); /* as read() does, without a terminator */
    assert_int_equal(unpackMultiMsg(NULL, NULL, &back, buff), 1);
    assert_near(back, 7, 0);
}

static int bound_port(int fd)
{
    struct sockaddr_in in = {0};
    socklen_t length = sizeof in;
    assert_int_equal(getsockname(fd, (struct sockaddr *)&in, &length), 0);
    assert_int_equal(ntohl(in.sin_addr.s_addr), INADDR_LOOPBACK);
    return ntohs(in.sin_port);
}

/* The paper's port may be in use on the machine that runs the test; then a free one is listened on. */
static int server_on_some_port(void)
{
    struct sockaddr_in in = {.sin_family = AF_INET};
    int fd = server_init();
    if (fd >= 0) {
        assert_int_equal(bound_port(fd), APC_PORT);
        return fd;
    }
    assert_int_equal(errno, EADDRINUSE);
    print_message("port %d is taken; testing on another\n", APC_PORT);
    in.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
    fd = socket(AF_INET, SOCK_STREAM, 0);
    assert_int_equal(bind(fd, (struct sockaddr *)&in, sizeof in), 0);
    return fd;
}

static void the_listings_talk_to_each_other(void **state)
{
    const double u = 0.25;
    double got = 0;
    char buff[APC_PACK_MAX] = {0};
    int client = client_init(), server = server_on_some_port(), connection;
    (void)state;

    assert_int_equal(server_listen(server, 3), 0);
    assert_int_equal(client_connect(client, "127.0.0.1", bound_port(server)), 0);
    connection = server_accept(server);
    assert_true(connection >= 0);
    assert_false(fcntl(client, F_GETFL) & O_NONBLOCK);
    assert_false(fcntl(connection, F_GETFL) & O_NONBLOCK);
    assert_true(fcntl(client, F_GETFD) & FD_CLOEXEC);
    assert_true(fcntl(connection, F_GETFD) & FD_CLOEXEC);
    for (int i = 0; i < 2; i++) { /* nothing waits for more to be sent */
        int on = 0;
        socklen_t size = sizeof on;
        assert_int_equal(getsockopt(i ? connection : client, IPPROTO_TCP, TCP_NODELAY, &on, &size), 0);
        assert_int_equal(on, 1);
    }

    assert_true(packMultiMsg(buff, 1, NULL, NULL, &u) > 0);
    assert_int_equal(send(client, buff, strlen(buff), MSG_NOSIGNAL), (int)strlen(buff));
    memset(buff, 0, sizeof buff);
    assert_true(read(connection, buff, sizeof buff) > 0);
    assert_int_equal(unpackMultiMsg(NULL, NULL, &got, buff), 1);
    assert_near(got, 0.25, 0);
    close(connection);
    close(client);
    close(server);
}

static void a_taken_port_is_reported(void **state)
{
    int first = server_init(), next = dup(0); /* the lowest that is free */
    (void)state;
    if (first >= 0)
        assert_int_equal(server_listen(first, 1), 0);
    close(next);
    for (int i = 0; i < 3; i++) {
        assert_int_equal(server_init(), APC_ESYS);
        assert_int_equal(errno, EADDRINUSE);
    }
    assert_int_equal(dup(0), next); /* and is still so */
    close(next);
    if (first >= 0)
        close(first);
}

static void connecting_in_vain_is_an_error(void **state)
{
    struct sockaddr_in in = {.sin_family = AF_INET};
    int fd = client_init(), bound = socket(AF_INET, SOCK_STREAM, 0);
    (void)state;

    in.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
    assert_int_equal(bind(bound, (struct sockaddr *)&in, sizeof in), 0); /* ours, and nobody listens */
    assert_int_equal(client_connect(fd, "127.0.0.1", bound_port(bound)), APC_ECONN);
    assert_int_equal(errno, ECONNREFUSED);
    assert_false(fcntl(fd, F_GETFL) & O_NONBLOCK); /* as it was */
    assert_int_equal(client_connect(fd, "127.0.0.1", 0), APC_EINVAL);
    assert_int_equal(client_connect(fd, "127.0.0.1", 65536), APC_EINVAL);
    assert_int_equal(client_connect(fd, "plant", 1), APC_EINVAL);
    assert_int_equal(client_connect(fd, NULL, 1), APC_EINVAL);
    assert_int_equal(client_connect(-1, "127.0.0.1", 1), APC_EINVAL);
    assert_int_equal(server_listen(-1, 1), APC_EINVAL);
    assert_int_equal(server_listen(bound, 0), APC_EINVAL);
    assert_int_equal(server_accept(-1), APC_ESYS);
    close(fd);
    assert_int_equal(client_connect(fd, "127.0.0.1", 1), APC_EINVAL); /* not a descriptor any more */
    close(bound);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(what_is_packed_is_unpacked),
        cmocka_unit_test(times_and_statuses_may_be_left_out),
        cmocka_unit_test(a_message_never_leaves_its_1024_bytes),
        cmocka_unit_test(nothing_is_packed_from_bad_arguments),
        cmocka_unit_test(garbage_unpacks_to_nothing),
        cmocka_unit_test(a_short_message_over_a_long_one_is_the_short_one),
        cmocka_unit_test(the_listings_talk_to_each_other),
        cmocka_unit_test(a_taken_port_is_reported),
        cmocka_unit_test(connecting_in_vain_is_an_error),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}

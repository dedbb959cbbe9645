/* SPDX-License-Identifier: BSD-3-Clause */
/* The asking side of a link, against peers that misbehave to order. */
#include "check.h"
#include "sockets/sockets_internal.h"

#include <errno.h>
#include <fcntl.h>
#include <netinet/in.h>
#include <pthread.h>
#include <semaphore.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/socket.h>
#include <unistd.h>

#define PATIENCE (20 * APC_NS_PER_S) /* a hang is a failure, not a hung test */
#define SHORT    (50 * APC_NS_PER_MS)

static apc_ns soon(apc_ns from_now)
{
    return apc_clock_mono(NULL) + from_now;
}

/* ---- A peer that follows a script ----------------------------------------------------------- */

/*
 * a accept            r read a line          e send it back          c close
 * h send half of it   x send it and more     s speak unasked         l send a line of 200 bytes
 * w wait for go       d tell that it is done
 */
struct peer {
    int listener, port;
    const char *script;
    pthread_t thread;
    sem_t go, done;
    int connections[8], count;
};

static bool wait_sem(sem_t *sem)
{
    struct timespec until;
    apc_ns t = soon(PATIENCE);
    until = (struct timespec){t / APC_NS_PER_S, t % APC_NS_PER_S};
    return sem_clockwait(sem, CLOCK_MONOTONIC, &until) == 0;
}

static void say(int fd, const char *text, size_t length)
{
    (void)send(fd, text, length, MSG_NOSIGNAL); /* the other side may be gone: that is the point */
}

static size_t read_line(int fd, char *line, size_t size)
{
    size_t n = 0;
    while (n < size && (n == 0 || line[n - 1] != '\n') && recv(fd, line + n, 1, 0) == 1)
        n++;
    return n;
}

static void *play(void *arg)
{
    struct peer *p = arg;
    char line[256] = "", more[512];
    size_t n = 0;
    int fd = -1;

    for (const char *step = p->script; *step; step++)
        switch (*step) {
        case 'a':
            fd = p->connections[p->count++] = accept(p->listener, NULL, NULL);
            break;
        case 'r':
            n = read_line(fd, line, sizeof line);
            break;
        case 'e':
            say(fd, line, n);
            break;
        case 'h':
            say(fd, line, n / 2);
            break;
        case 'x':
            memcpy(more, line, n);
            memcpy(more + n, "more", 4);
            say(fd, more, n + 4);
            break;
        case 's':
            say(fd, "nobody asked\n", 13);
            break;
        case 'l':
            memset(more, 'l', 200);
            more[199] = '\n';
            say(fd, more, 200);
            break;
        case 'c':
            close(fd);
            p->connections[p->count - 1] = -1;
            break;
        case 'w':
            wait_sem(&p->go);
            break;
        case 'd':
            sem_post(&p->done);
            break;
        default:
            abort();
        }
    return NULL;
}

/* A socket bound to a free port of the loopback; @backlog 0: it refuses whoever connects. */
static int bind_somewhere(int *port, int backlog)
{
    struct sockaddr_in in = {.sin_family = AF_INET};
    socklen_t length = sizeof in;
    int fd = socket(AF_INET, SOCK_STREAM, 0);

    in.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
    assert_int_equal(bind(fd, (struct sockaddr *)&in, sizeof in), 0);
    assert_int_equal(getsockname(fd, (struct sockaddr *)&in, &length), 0);
    if (backlog > 0)
        assert_int_equal(listen(fd, backlog), 0);
    *port = ntohs(in.sin_port);
    return fd;
}

static struct apc_link *link_to(int port, const struct apc_link_options *options)
{
    struct apc_link *link;
    char uri[64];
    snprintf(uri, sizeof uri, "tcp:127.0.0.1:%d", port);
    assert_int_equal(apc_link_create(&link, uri, options, NULL), 0);
    return link;
}

static struct apc_link *start_peer(struct peer *p, const char *script)
{
    const struct apc_link_options options = {.size = sizeof options, .frame_max = 100};
    *p = (struct peer){.script = script};
    sem_init(&p->go, 0, 0);
    sem_init(&p->done, 0, 0);
    p->listener = bind_somewhere(&p->port, 8);
    assert_int_equal(pthread_create(&p->thread, NULL, play, p), 0);
    return link_to(p->port, &options);
}

static void end_peer(struct peer *p, struct apc_link *link)
{
    pthread_join(p->thread, NULL);
    apc_link_destroy(link);
    for (int i = 0; i < p->count; i++)
        if (p->connections[i] >= 0)
            close(p->connections[i]);
    close(p->listener);
    sem_destroy(&p->go);
    sem_destroy(&p->done);
}

static int ask(struct apc_link *link, const char *request, apc_ns patience)
{
    const char *reply;
    int n = apc_link_exchange(link, request, strlen(request), &reply, soon(patience));
    if (n < 0) {
        assert_null(reply);
        return n;
    }
    assert_int_equal(n, strlen(request)); /* every peer here echoes, if it answers properly */
    assert_memory_equal(reply, request, strlen(request));
    return 0;
}

/* ---- What must hold -------------------------------------------------------------------------- */

static void one_connection_carries_many_exchanges(void **state)
{
    struct peer p;
    struct apc_link *link = start_peer(&p, "arererere");
    (void)state;

    assert_false(apc_link_connected(link));
    assert_int_equal(ask(link, "one\n", PATIENCE), 0);
    assert_int_equal(ask(link, "two and a bit\n", PATIENCE), 0);
    assert_int_equal(ask(link, "\n", PATIENCE), 0);
    assert_int_equal(ask(link, "four\n", PATIENCE), 0);
    assert_true(apc_link_connected(link));
    assert_int_equal(apc_link_connects(link), 1);
    assert_string_equal(apc_link_error(link), "");
    end_peer(&p, link);
}

/* Hazard 8: the paper's client takes a late reply for the next tick's. */
static void a_late_reply_is_never_the_next_ones(void **state)
{
    struct peer p;
    struct apc_link *link = start_peer(&p, "arwedare");
    (void)state;

    assert_int_equal(ask(link, "old\n", SHORT), APC_ETIMEDOUT);
    assert_false(apc_link_connected(link));
    assert_non_null(strstr(apc_link_error(link), "in time"));
    sem_post(&p.go); /* now it comes, on a connection that is no more */
    assert_true(wait_sem(&p.done));
    assert_int_equal(ask(link, "new\n", PATIENCE), 0);
    assert_int_equal(apc_link_connects(link), 2);
    end_peer(&p, link);
}

/* Hazard 9: end of file is not a reply. */
static void a_peer_that_closes_is_no_reply(void **state)
{
    struct peer p;
    struct apc_link *link = start_peer(&p, "arcarhcare");
    (void)state;

    assert_int_equal(ask(link, "one\n", PATIENCE), APC_ECONN);
    assert_false(apc_link_connected(link));
    assert_int_equal(ask(link, "two\n", PATIENCE), APC_ECONN); /* half of a reply is none */
    assert_int_equal(ask(link, "three\n", PATIENCE), 0);       /* connecting did not fail: no pause */
    assert_int_equal(apc_link_connects(link), 3);
    end_peer(&p, link);
}

static void a_reply_beyond_frame_max_is_refused(void **state)
{
    struct peer p;
    struct apc_link *link = start_peer(&p, "arlare");
    (void)state;

    assert_int_equal(ask(link, "one\n", PATIENCE), APC_EPROTO);
    assert_non_null(strstr(apc_link_error(link), "longer than 100 bytes"));
    assert_false(apc_link_connected(link));
    assert_int_equal(ask(link, "two\n", PATIENCE), 0);
    end_peer(&p, link);
}

static void bytes_after_the_reply_close_the_connection(void **state)
{
    struct peer p;
    struct apc_link *link = start_peer(&p, "arxare");
    (void)state;

    assert_int_equal(ask(link, "one\n", PATIENCE), APC_EPROTO);
    assert_false(apc_link_connected(link));
    assert_int_equal(ask(link, "two\n", PATIENCE), 0);
    end_peer(&p, link);
}

static void what_comes_unasked_is_not_taken_for_a_reply(void **state)
{
    struct peer p;
    struct apc_link *link = start_peer(&p, "arewsdare");
    (void)state;

    assert_int_equal(ask(link, "one\n", PATIENCE), 0);
    sem_post(&p.go);
    assert_true(wait_sem(&p.done));
    assert_int_equal(ask(link, "two\n", PATIENCE), 0);
    assert_int_equal(apc_link_connects(link), 2);
    end_peer(&p, link);
}

static void a_peer_that_went_away_between_two_exchanges_costs_none(void **state)
{
    struct peer p;
    struct apc_link *link = start_peer(&p, "arecdare");
    (void)state;

    assert_int_equal(ask(link, "one\n", PATIENCE), 0);
    assert_true(wait_sem(&p.done));
    assert_int_equal(ask(link, "two\n", PATIENCE), 0);
    assert_int_equal(apc_link_connects(link), 2);
    end_peer(&p, link);
}

static void reset_closes_and_the_next_exchange_connects(void **state)
{
    struct peer p;
    struct apc_link *link = start_peer(&p, "areare");
    (void)state;

    assert_int_equal(ask(link, "one\n", PATIENCE), 0);
    apc_link_reset(link);
    assert_false(apc_link_connected(link));
    apc_link_reset(link);
    assert_int_equal(ask(link, "two\n", PATIENCE), 0);
    end_peer(&p, link);
}

static void a_peer_that_never_reads_cannot_hold_the_sender(void **state)
{
    const size_t size = 32u << 20; /* more than any socket buffers */
    int port, connection, listener = bind_somewhere(&port, 1);
    struct apc_link *link = link_to(port, NULL);
    char *request = calloc(1, size);
    const char *reply;
    ssize_t n;
    (void)state;

    assert_non_null(request);
    assert_int_equal(apc_link_exchange(link, request, size, &reply, soon(SHORT)), APC_ETIMEDOUT);
    assert_non_null(strstr(apc_link_error(link), "sending"));
    assert_false(apc_link_connected(link));
    apc_link_destroy(link);

    /* and what the kernel still held is not delivered later: a network that comes back brings no old command
     */
    connection = accept(listener, NULL, NULL);
    do
        n = recv(connection, request, size, 0);
    while (n > 0);
    assert_int_equal(n, -1);
    assert_int_equal(errno, ECONNRESET);
    free(request);
    close(connection);
    close(listener);
}

static void a_pause_follows_a_failed_connect(void **state)
{
    const struct apc_link_options options = {
        .size = sizeof options, .backoff_min = 3600 * APC_NS_PER_S, .backoff_max = 7200 * APC_NS_PER_S};
    int port, listener = bind_somewhere(&port, 0);
    struct apc_link *link = link_to(port, &options);
    char why[512];
    (void)state;

    assert_int_equal(ask(link, "one\n", PATIENCE), APC_ECONN);
    snprintf(why, sizeof why, "link \"tcp:127.0.0.1:%d\": connecting to 127.0.0.1:%d: Connection refused",
             port, port);
    assert_string_equal(apc_link_error(link), why);

    assert_int_equal(listen(listener, 8), 0); /* from here on a connect would succeed, and be seen */
    for (int i = 0; i < 100; i++)
        assert_int_equal(ask(link, "two\n", PATIENCE), APC_ECONN);
    assert_int_equal(apc_link_connects(link), 0);
    assert_string_equal(apc_link_error(link), why);
    assert_int_equal(fcntl(listener, F_SETFL, O_NONBLOCK), 0);
    assert_int_equal(accept(listener, NULL, NULL), -1);
    assert_int_equal(errno, EAGAIN);
    apc_link_destroy(link);
    close(listener);
}

static int echo(void *ctx, uint64_t connection, const char *request, size_t length, char *reply, size_t size)
{
    (void)ctx;
    (void)connection;
    if (length > size)
        return APC_ERANGE;
    memcpy(reply, request, length);
    return (int)length;
}

static void a_restarted_server_is_found_again(void **state)
{
    const struct apc_link_options options = {
        .size = sizeof options, .backoff_min = APC_NS_PER_MS, .backoff_max = 4 * APC_NS_PER_MS};
    struct apc_server *server;
    struct apc_link *link;
    char uri[64];
    apc_ns until;
    int port, err;
    (void)state;

    assert_int_equal(apc_server_create(&server, "tcp:127.0.0.1:0", NULL, echo, NULL, NULL), 0);
    port = apc_server_port(server);
    link = link_to(port, &options);
    assert_int_equal(ask(link, "one\n", PATIENCE), 0);
    apc_server_destroy(server);
    for (int i = 0; i < 10; i++)
        assert_int_equal(ask(link, "two\n", PATIENCE), APC_ECONN);
    snprintf(uri, sizeof uri, "tcp:127.0.0.1:%d", port);
    assert_int_equal(apc_server_create(&server, uri, NULL, echo, NULL, NULL), 0);
    until = soon(PATIENCE);
    do
        err = ask(link, "three\n", PATIENCE);
    while (err == APC_ECONN && apc_clock_mono(NULL) < until);
    assert_int_equal(err, 0);
    assert_int_equal(apc_link_connects(link), 2);
    apc_link_destroy(link);
    apc_server_destroy(server);
}

static void a_host_may_be_a_name(void **state)
{
    struct apc_server *server;
    struct apc_link *link;
    char uri[64];
    (void)state;

    assert_int_equal(apc_server_create(&server, "tcp:localhost:0", NULL, echo, NULL, NULL), 0);
    snprintf(uri, sizeof uri, "tcp:localhost:%d", apc_server_port(server));
    assert_int_equal(apc_link_create(&link, uri, NULL, NULL), 0);
    assert_int_equal(ask(link, "one\n", PATIENCE), 0);
    apc_link_destroy(link);
    apc_server_destroy(server);
}

static void a_name_without_an_address_is_an_error_of_the_exchange(void **state)
{
    struct apc_link *link;
    char uri[128];
    (void)state;

    /* a label of 70 letters is refused without asking any server */
    snprintf(uri, sizeof uri, "tcp:%070d.invalid:1", 0);
    assert_int_equal(apc_link_create(&link, uri, NULL, NULL), 0);
    assert_int_equal(ask(link, "one\n", PATIENCE), APC_ECONN);
    assert_non_null(strstr(apc_link_error(link), "cannot resolve host name"));
    assert_int_equal(ask(link, "one\n", PATIENCE), APC_ECONN);
    apc_link_destroy(link);
}

static void an_ipv6_address_is_written_in_brackets(void **state)
{
    struct apc_server *server;
    struct apc_link *link;
    char uri[64];
    (void)state;

    if (apc_server_create(&server, "tcp:[::1]:0", NULL, echo, NULL, NULL) < 0) {
        print_message("no IPv6 on this machine: skipped\n");
        skip();
    }
    snprintf(uri, sizeof uri, "tcp:[::1]:%d", apc_server_port(server));
    assert_int_equal(apc_link_create(&link, uri, NULL, NULL), 0);
    assert_int_equal(ask(link, "one\n", PATIENCE), 0);
    apc_link_destroy(link);
    apc_server_destroy(server);
}

static void a_malformed_address_is_named(void **state)
{
    static const struct {
        const char *uri, *why;
    } bad[] = {
        {"tcp:host:99999", "link \"tcp:host:99999\": port must be 1..65535"},
        {"tcp:host:0", "link \"tcp:host:0\": port must be 1..65535"},
        {"tcp:host:", "port must be"},
        {"tcp:host:-1", "port must be"},
        {"tcp:host:12x", "port must be"},
        {"tcp:host:000080", "port must be"},
        {"tcp:host", "expected tcp:HOST:PORT"},
        {"tcp:", "expected tcp:HOST:PORT"},
        {"tcp::80", "neither an address nor a host name"},
        {"tcp:ho st:80", "neither an address nor a host name"},
        {"tcp:host/x:80", "neither an address nor a host name"},
        {"tcp:::1:80", "in brackets"},
        {"tcp:[127.0.0.1]:80", "in brackets"},
        {"tcp:[plant]:80", "in brackets"},
        {"tcp:[::1:80", "expected tcp:[IPV6]:PORT"},
        {"tcp:[]:80", "expected tcp:[IPV6]:PORT"},
        {"udp:host:80", "link \"udp:host:80\": unknown scheme"},
        {"", "unknown scheme"},
        {NULL, "unknown scheme"},
    };
    struct apc_link *link;
    struct apc_error why;
    char host[400];
    (void)state;

    for (size_t i = 0; i < sizeof bad / sizeof *bad; i++) {
        link = (struct apc_link *)&why;
        assert_int_equal(apc_link_create(&link, bad[i].uri, NULL, &why), APC_EINVAL);
        assert_null(link);
        if (!strstr(why.text, bad[i].why))
            fail_msg("%s: \"%s\", expected \"%s\"", bad[i].uri, why.text, bad[i].why);
    }
    snprintf(host, sizeof host, "tcp:%0300d:80", 0);
    assert_int_equal(apc_link_create(&link, host, NULL, &why), APC_EINVAL);
    assert_int_equal(apc_link_create(NULL, "tcp:127.0.0.1:1", NULL, &why), APC_EINVAL);
}

static void options_are_checked(void **state)
{
    struct {
        struct apc_link_options known;
        uint64_t unknown;
    } options = {.known = {.size = sizeof options}};
    struct apc_link *link;
    struct apc_error why;
    (void)state;

    assert_int_equal(apc_link_create(&link, "tcp:127.0.0.1:1", &options.known, &why), 0);
    apc_link_destroy(link);
    options.unknown = 1;
    assert_int_equal(apc_link_create(&link, "tcp:127.0.0.1:1", &options.known, &why), APC_EINVAL);
    options.known = (struct apc_link_options){.size = 0};
    assert_int_equal(apc_link_create(&link, "tcp:127.0.0.1:1", &options.known, &why), APC_EINVAL);
    options.known = (struct apc_link_options){.size = sizeof options.known, .frame_max = APC_FRAME_MAX + 1};
    assert_int_equal(apc_link_create(&link, "tcp:127.0.0.1:1", &options.known, &why), APC_EINVAL);
    options.known = (struct apc_link_options){.size = sizeof options.known, .backoff_min = -1};
    assert_int_equal(apc_link_create(&link, "tcp:127.0.0.1:1", &options.known, &why), APC_EINVAL);
    options.known =
        (struct apc_link_options){.size = sizeof options.known, .backoff_min = 2, .backoff_max = 1};
    assert_int_equal(apc_link_create(&link, "tcp:127.0.0.1:1", &options.known, &why), APC_EINVAL);
}

static void no_link_is_legal_to_destroy_and_useless_to_ask(void **state)
{
    const char *reply;
    (void)state;
    apc_link_destroy(NULL);
    apc_link_reset(NULL);
    assert_false(apc_link_connected(NULL));
    assert_int_equal(apc_link_connects(NULL), 0);
    assert_string_equal(apc_link_error(NULL), "");
    assert_int_equal(apc_link_exchange(NULL, "x\n", 2, &reply, 0), APC_EINVAL);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(one_connection_carries_many_exchanges),
        cmocka_unit_test(a_late_reply_is_never_the_next_ones),
        cmocka_unit_test(a_peer_that_closes_is_no_reply),
        cmocka_unit_test(a_reply_beyond_frame_max_is_refused),
        cmocka_unit_test(bytes_after_the_reply_close_the_connection),
        cmocka_unit_test(what_comes_unasked_is_not_taken_for_a_reply),
        cmocka_unit_test(a_peer_that_went_away_between_two_exchanges_costs_none),
        cmocka_unit_test(reset_closes_and_the_next_exchange_connects),
        cmocka_unit_test(a_peer_that_never_reads_cannot_hold_the_sender),
        cmocka_unit_test(a_pause_follows_a_failed_connect),
        cmocka_unit_test(a_restarted_server_is_found_again),
        cmocka_unit_test(a_host_may_be_a_name),
        cmocka_unit_test(a_name_without_an_address_is_an_error_of_the_exchange),
        cmocka_unit_test(an_ipv6_address_is_written_in_brackets),
        cmocka_unit_test(a_malformed_address_is_named),
        cmocka_unit_test(options_are_checked),
        cmocka_unit_test(no_link_is_legal_to_destroy_and_useless_to_ask),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}

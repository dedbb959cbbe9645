/* SPDX-License-Identifier: BSD-3-Clause */
/* The answering side of a link, against clients that misbehave. */
#define UNDER_TEST accepted
#include "apcsockets.h"
#include "sockets_faults.h"

#include <pthread.h>
#include <semaphore.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/resource.h>
#include <sys/wait.h>

#define PATIENCE_MS 20000 /* a hang is a failure, not a hung test */
#define PATIENCE    (PATIENCE_MS * APC_NS_PER_MS)

static apc_ns soon(apc_ns from_now)
{
    return apc_clock_mono(NULL) + from_now;
}

/* ---- A plain client -------------------------------------------------------------------------- */

static int connect_to(int port)
{
    struct sockaddr_in in = {.sin_family = AF_INET, .sin_port = htons((uint16_t)port)};
    int fd = socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0);

    in.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
    assert_true(fd >= 0);
    assert_int_equal(connect(fd, (struct sockaddr *)&in, sizeof in), 0);
    return fd;
}

static void say(int fd, const char *text)
{
    assert_int_equal(send(fd, text, strlen(text), MSG_NOSIGNAL), (int)strlen(text));
}

/* What comes next: the number of bytes, 0 when the server closed, -1 when nothing comes. */
static ssize_t hear(int fd, char *text, size_t size)
{
    struct pollfd p = {.fd = fd, .events = POLLIN};
    ssize_t n;
    if (poll(&p, 1, PATIENCE_MS) != 1)
        return -1;
    n = recv(fd, text, size, 0);
    return n < 0 && errno == ECONNRESET ? 0 : n;
}

static void expect(int fd, const char *text)
{
    char heard[256];
    size_t n = 0, length = strlen(text);
    assert_true(length < sizeof heard);
    while (n < length) {
        ssize_t more = hear(fd, heard + n, length - n);
        assert_true(more > 0);
        n += (size_t)more;
    }
    assert_memory_equal(heard, text, length);
}

static void expect_closed(int fd)
{
    char byte;
    assert_int_equal(hear(fd, &byte, 1), 0);
    close(fd);
}

static void ask(int fd, const char *text)
{
    say(fd, text);
    expect(fd, text);
}

static void hang_up_hard(int fd)
{
    const struct linger at_once = {.l_onoff = 1, .l_linger = 0};
    assert_int_equal(setsockopt(fd, SOL_SOCKET, SO_LINGER, &at_once, sizeof at_once), 0);
    close(fd);
}

/* ---- A plain server -------------------------------------------------------------------------- */

struct plant {
    struct apc_server *server;
    sem_t entered, leave; /* for the requests "wait\n" and "who\n" */
    atomic_int calls;
    _Atomic uint64_t last_connection;
    char peer[APC_PEER_LEN],
        nobody[APC_PEER_LEN], /* of "who\n": who asks; who a connection is that there is not */
        former[APC_PEER_LEN]; /* and the one before */
    atomic_bool unmasked;     /* the thread of the server takes signals */
};

/* Echo; but "bad..." is refused, "many\n" is answered with as much as fits, "wait\n" waits. */
static int answer(void *ctx, uint64_t connection, const char *request, size_t length, char *reply,
                  size_t size)
{
    struct plant *p = ctx;
    sigset_t mask;

    atomic_fetch_add(&p->calls, 1);
    atomic_store(&p->last_connection, connection);
    pthread_sigmask(SIG_SETMASK, NULL, &mask);
    if (!sigismember(&mask, SIGTERM) || !sigismember(&mask, SIGALRM))
        atomic_store(&p->unmasked, true);
    if (length >= 3 && !memcmp(request, "bad", 3))
        return APC_EPROTO;
    if (length == 4 && !memcmp(request, "who\n", 4)) {
        sem_wait(&p->leave);
        apc_server_peer(p->server, connection, p->peer);
        apc_server_peer(p->server, connection + 1, p->nobody);
        apc_server_peer(p->server, connection - 1, p->former);
        sem_post(&p->entered);
    }
    if (length == 5 && !memcmp(request, "over\n", 5))
        return (int)size + 1; /* more than there is room for */
    if (length == 5 && !memcmp(request, "none\n", 5))
        return 0;
    if (length == 5 && !memcmp(request, "many\n", 5)) {
        memset(reply, 'm', size);
        return (int)size;
    }
    if (length == 5 && !memcmp(request, "wait\n", 5)) {
        sem_post(&p->entered);
        sem_wait(&p->leave);
    }
    memcpy(reply, request, length);
    return (int)length;
}

static int start(struct plant *p, const struct apc_server_options *options)
{
    struct apc_error why;
    *p = (struct plant){.server = NULL};
    sem_init(&p->entered, 0, 0);
    sem_init(&p->leave, 0, 0);
    if (apc_server_create(&p->server, "tcp:127.0.0.1:0", options, answer, p, &why) < 0)
        fail_msg("%s", why.text);
    return apc_server_port(p->server);
}

static void stop(struct plant *p)
{
    apc_server_destroy(p->server);
    sem_destroy(&p->entered);
    sem_destroy(&p->leave);
}

static struct apc_server_stats stats_of(const struct plant *p)
{
    struct apc_server_stats stats = {.size = sizeof stats};
    apc_server_stats(p->server, &stats);
    return stats;
}

static void wait_entered(struct plant *p)
{
    apc_ns t = soon(PATIENCE);
    struct timespec until = {t / APC_NS_PER_S, t % APC_NS_PER_S};
    assert_int_equal(sem_clockwait(&p->entered, CLOCK_MONOTONIC, &until), 0);
}

/* ---- What must hold -------------------------------------------------------------------------- */

static void each_connection_is_served_and_has_its_own_number(void **state)
{
    struct plant p;
    int port = start(&p, NULL), one = connect_to(port), two = connect_to(port);
    uint64_t first;
    (void)state;

    ask(one, "hello\n");
    first = atomic_load(&p.last_connection);
    ask(two, "hello\n");
    assert_true(atomic_load(&p.last_connection) != first);
    ask(one, "\n");
    assert_true(atomic_load(&p.last_connection) == first);
    assert_int_equal(stats_of(&p).accepted, 2);
    assert_int_equal(stats_of(&p).open, 2);
    assert_int_equal(stats_of(&p).requests, 3);
    assert_int_equal(stats_of(&p).rejected, 0);
    close(one);
    close(two);
    stop(&p);
}

static void bytes_may_trickle(void **state)
{
    struct plant p;
    int fd = connect_to(start(&p, NULL));
    const char *text = "one byte at a time\n";
    (void)state;

    for (const char *c = text; *c; c++)
        assert_int_equal(send(fd, c, 1, MSG_NOSIGNAL), 1);
    expect(fd, text);
    assert_int_equal(atomic_load(&p.calls), 1);
    close(fd);
    stop(&p);
}

static void pipelined_requests_are_answered_in_order(void **state)
{
    struct plant p;
    int fd = connect_to(start(&p, NULL));
    (void)state;

    say(fd, "one\ntwo\nthree\nfo");
    expect(fd, "one\ntwo\nthree\n");
    say(fd, "ur\n");
    expect(fd, "four\n");
    assert_int_equal(atomic_load(&p.calls), 4);
    close(fd);
    stop(&p);
}

/* As `nc` does when its input ends. */
static void a_client_that_ends_after_its_requests_gets_its_answers(void **state)
{
    struct plant p;
    int fd = connect_to(start(&p, NULL));
    (void)state;

    say(fd, "one\ntwo\n");
    assert_int_equal(shutdown(fd, SHUT_WR), 0);
    expect(fd, "one\ntwo\n");
    expect_closed(fd);
    assert_int_equal(stats_of(&p).rejected, 0);
    stop(&p);
}

static void a_frame_cut_off_by_the_end_is_rejected(void **state)
{
    struct plant p;
    int fd = connect_to(start(&p, NULL));
    (void)state;

    say(fd, "one\ntw");
    assert_int_equal(shutdown(fd, SHUT_WR), 0);
    expect(fd, "one\n");
    expect_closed(fd);
    assert_int_equal(stats_of(&p).rejected, 1);
    assert_int_equal(atomic_load(&p.calls), 1);
    stop(&p);
}

static void half_a_frame_times_out_and_idleness_does_not(void **state)
{
    const struct apc_server_options options = {.size = sizeof options, .frame_timeout = 50 * APC_NS_PER_MS};
    struct plant p;
    int port = start(&p, &options), idle = connect_to(port), half = connect_to(port);
    (void)state;

    ask(idle, "hello\n");
    say(half, "apc1 comm");
    expect_closed(half); /* at least the timeout has passed, and the other was idle throughout */
    ask(idle, "still here\n");
    assert_int_equal(stats_of(&p).rejected, 1);
    close(idle);
    stop(&p);
}

/* More bytes do not buy more time. */
/* Promise(links/malformed-endless-slow) */
static void a_frame_that_trickles_for_ever_times_out(void **state)
{
    const struct apc_server_options options = {.size = sizeof options, .frame_timeout = 50 * APC_NS_PER_MS};
    struct plant p;
    int port = start(&p, &options), slow = connect_to(port), other = connect_to(port);
    apc_ns until = soon(PATIENCE);
    (void)state;

    while (stats_of(&p).rejected == 0 && apc_clock_mono(NULL) < until) {
        (void)send(slow, "a", 1, MSG_NOSIGNAL);
        ask(other, "one of many\n"); /* paces the loop, and is served throughout */
    }
    assert_int_equal(stats_of(&p).rejected, 1);
    close(slow);
    close(other);
    stop(&p);
}

/* Promise(links/malformed-endless-slow) */
static void a_frame_beyond_frame_max_is_rejected(void **state)
{
    const struct apc_server_options options = {.size = sizeof options, .frame_max = 16};
    struct plant p;
    int port = start(&p, &options), fd = connect_to(port);
    (void)state;

    ask(fd, "15 and newline.\n");
    say(fd, "sixteen, no end.");
    expect_closed(fd);
    assert_int_equal(stats_of(&p).rejected, 1);
    assert_int_equal(atomic_load(&p.calls), 1);
    stop(&p);
}

static void an_error_of_the_handler_closes_that_connection_only(void **state)
{
    struct plant p;
    int port = start(&p, NULL), good = connect_to(port), bad = connect_to(port);
    (void)state;

    ask(good, "hello\n");
    say(bad, "bad\nhello\n"); /* and what is behind it is not looked at */
    expect_closed(bad);
    ask(good, "hello\n");
    assert_int_equal(stats_of(&p).rejected, 1);
    assert_int_equal(atomic_load(&p.calls), 3);
    close(good);
    stop(&p);
}

/* Promise(links/malformed-endless-slow) */
static void a_client_that_never_reads_is_closed_and_holds_nobody_up(void **state)
{
    const struct apc_server_options options = {
        .size = sizeof options, .frame_timeout = 50 * APC_NS_PER_MS, .frame_max = APC_FRAME_MAX};
    struct plant p;
    int port = start(&p, &options), deaf = connect_to(port), other = connect_to(port);
    apc_ns until = soon(PATIENCE);
    (void)state;

    for (int i = 0; i < 64; i++)
        say(deaf, "many\n"); /* 64 MiB of replies: more than any socket buffers */
    while (stats_of(&p).rejected == 0 && apc_clock_mono(NULL) < until)
        ask(other, "hello\n");
    assert_int_equal(stats_of(&p).rejected, 1);
    ask(other, "hello\n");
    assert_int_equal(stats_of(&p).open, 1);
    close(deaf);
    close(other);
    stop(&p);
}

static void a_reply_too_large_for_one_send_arrives_whole(void **state)
{
    const struct apc_server_options options = {.size = sizeof options, .frame_max = APC_FRAME_MAX};
    struct plant p;
    int fd = connect_to(start(&p, &options));
    const size_t whole = 8u * APC_FRAME_MAX;
    size_t heard = 0;
    char *text = malloc(APC_FRAME_MAX);
    (void)state;

    assert_non_null(text);
    for (int i = 0; i < 8; i++)
        say(fd, "many\n");
    while (heard < whole) {
        ssize_t n = hear(fd, text, APC_FRAME_MAX);
        assert_true(n > 0);
        for (ssize_t i = 0; i < n; i++)
            if (text[i] != 'm')
                fail_msg("byte %zu is 0x%x", heard + (size_t)i, (unsigned)text[i]);
        heard += (size_t)n;
    }
    assert_int_equal(heard, whole);
    ask(fd, "and then\n");
    free(text);
    close(fd);
    stop(&p);
}

/* A command whose sender is gone must not be applied: the sender has another connection by now. */
static void a_request_on_a_reset_connection_is_not_answered(void **state)
{
    struct plant p;
    int port = start(&p, NULL), busy = connect_to(port), gone = connect_to(port), calls;
    (void)state;

    ask(gone, "hello\n");
    say(busy, "wait\n");
    wait_entered(&p);
    say(gone, "an old command\n");
    hang_up_hard(gone);
    calls = atomic_load(&p.calls);
    sem_post(&p.leave);
    expect(busy, "wait\n");
    ask(busy, "hello\n");
    ask(busy, "hello\n"); /* by now the server has been round its connections */
    assert_int_equal(atomic_load(&p.calls), calls + 2);
    assert_int_equal(stats_of(&p).open, 1);
    close(busy);
    stop(&p);
}

static void connections_beyond_the_cap_are_closed_at_once_while_all_others_are_in_use(void **state)
{
    const struct apc_server_options options = {
        .size = sizeof options, .connections = 2, .frame_timeout = PATIENCE};
    struct plant p;
    int port = start(&p, &options), two = connect_to(port), one, three;
    apc_ns until = soon(PATIENCE);
    char heard[8];
    (void)state;

    ask(two, "hello\n");
    one = connect_to(port);
    ask(one, "hello\n"); /* the last that was answered; and of the other's next request half is here */
    say(two, "hello\nhel");
    expect(two, "hello\n");
    ask(one, "hello\n");
    expect_closed(connect_to(port));
    ask(one, "hello\n");
    assert_int_equal(stats_of(&p).refused, 1);
    assert_int_equal(stats_of(&p).accepted, 2);
    assert_int_equal(stats_of(&p).open, 2);
    close(two);
    for (three = -1; three < 0 && apc_clock_mono(NULL) < until;) { /* until the server knows of it */
        three = connect_to(port);
        if (send(three, "hello\n", 6, MSG_NOSIGNAL) != 6 || hear(three, heard, sizeof heard) != 6) {
            close(three);
            three = -1;
        }
    }
    assert_true(three >= 0);
    close(one);
    close(three);
    stop(&p);
}

/* Promise(links/malformed-endless-slow) */
static void whoever_only_connects_cannot_lock_the_client_out(void **state)
{
    struct plant p;
    int port = start(&p, NULL), silent[40], client = -1, late;
    apc_ns until = soon(PATIENCE);
    (void)state;

    for (int i = 0; i < 40; i++) {
        silent[i] = connect_to(port);
        if (i == 20) {
            client = connect_to(port);
            ask(client, "hello\n");
        }
    }
    while (stats_of(&p).accepted < 41 && apc_clock_mono(NULL) < until)
        continue;
    ask(client, "hello\n"); /* the last that was answered keeps its place */
    late = connect_to(port);
    ask(late, "hello\n");
    expect_closed(silent[0]); /* the one that was silent longest went first */
    assert_int_equal(stats_of(&p).accepted, 42);
    assert_int_equal(stats_of(&p).evicted, 42 - 16);
    assert_int_equal(stats_of(&p).refused, 0);
    assert_int_equal(stats_of(&p).rejected, 0);
    assert_int_equal(stats_of(&p).open, 16);
    for (int i = 1; i < 40; i++)
        close(silent[i]);
    close(client);
    close(late);
    stop(&p);
}

static void the_connection_that_was_silent_longest_gives_way(void **state)
{
    const struct apc_server_options options = {.size = sizeof options, .connections = 3};
    struct plant p;
    int port = start(&p, &options), fresh, first = connect_to(port), last = connect_to(port), next;
    apc_ns until = soon(PATIENCE);
    (void)state;

    ask(first, "hello\n");
    ask(last, "hello\n");
    fresh = connect_to(port); /* it has said nothing yet, but is not silent for as long as the first */
    while (stats_of(&p).accepted < 3 && apc_clock_mono(NULL) < until)
        continue;
    next = connect_to(port);
    ask(next, "hello\n");
    expect_closed(first);
    ask(fresh, "hello\n");
    ask(last, "hello\n");
    assert_int_equal(stats_of(&p).evicted, 1);
    close(last);
    close(fresh);
    close(next);
    stop(&p);
}

static void many_connections_come_and_go(void **state)
{
    struct plant p;
    int port = start(&p, NULL);
    (void)state;

    for (int i = 0; i < 500; i++) {
        int fd = connect_to(port);
        if (i % 3 == 0)
            say(fd, "hel");
        if (i % 3 == 1)
            say(fd, "bad\n");
        hang_up_hard(fd);
    }
    for (int fd = connect_to(port);; fd = connect_to(port)) { /* the queue may still be full of the others */
        char heard[8];
        if (send(fd, "hello\n", 6, MSG_NOSIGNAL) == 6 && hear(fd, heard, sizeof heard) == 6) {
            close(fd);
            break;
        }
        close(fd);
    }
    stop(&p);
}

static void destroy_ends_connections_and_calls(void **state)
{
    struct plant p;
    int port = start(&p, NULL), one = connect_to(port), two = connect_to(port), calls;
    (void)state;

    ask(one, "hello\n");
    ask(two, "hello\n");
    say(one, "hello\nhello\nhello\nhel");
    apc_server_destroy(p.server);
    calls = atomic_load(&p.calls);
    (void)send(two, "hello\n", 6, MSG_NOSIGNAL);
    for (char byte; hear(one, &byte, 1) > 0;)
        continue;
    close(one);
    expect_closed(two);
    assert_int_equal(atomic_load(&p.calls), calls);
    p.server = NULL;
    stop(&p);
}

/* Promise(links/plant-listens-beyond): The plant listens beyond its host only when told so by name. */
static void only_loopback_is_listened_on_unless_allowed_by_name(void **state)
{
    struct apc_server_options options = {.size = sizeof options};
    struct apc_server *server = NULL;
    struct apc_error why;
    (void)state;

    assert_int_equal(apc_server_create(&server, "tcp:0.0.0.0:0", &options, answer, NULL, &why), APC_EPERM);
    assert_null(server);
    assert_non_null(strstr(why.text, "allow_plaintext"));
    assert_non_null(strstr(why.text, "plain text"));
    assert_int_equal(apc_server_create(&server, "tcp:127.0.0.2:0", &options, answer, NULL, &why), 0);
    apc_server_destroy(server);
    options.allow_plaintext = true;
    assert_int_equal(apc_server_create(&server, "tcp:0.0.0.0:0", &options, answer, NULL, &why), 0);
    apc_server_destroy(server);
}

static void a_taken_port_is_named(void **state)
{
    struct plant p;
    struct apc_server *server;
    struct apc_error why;
    char uri[64];
    (void)state;

    snprintf(uri, sizeof uri, "tcp:127.0.0.1:%d", start(&p, NULL));
    assert_int_equal(apc_server_create(&server, uri, NULL, answer, NULL, &why), APC_ESYS);
    assert_null(server);
    assert_non_null(strstr(why.text, uri + 4));
    assert_non_null(strstr(why.text, "Address already in use"));
    stop(&p);
}

static void arguments_are_checked(void **state)
{
    struct apc_server_options options = {.size = sizeof options, .frame_max = APC_FRAME_MAX + 1};
    struct apc_server_stats stats = {.size = sizeof stats, .open = 3};
    struct apc_server *server;
    struct apc_error why;
    (void)state;

    assert_int_equal(apc_server_create(&server, "tcp:127.0.0.1:0", &options, answer, NULL, &why), APC_EINVAL);
    options = (struct apc_server_options){.size = sizeof options, .frame_timeout = -1};
    assert_int_equal(apc_server_create(&server, "tcp:127.0.0.1:0", &options, answer, NULL, &why), APC_EINVAL);
    assert_int_equal(apc_server_create(&server, "tcp:127.0.0.1:0", NULL, NULL, NULL, &why), APC_EINVAL);
    assert_int_equal(apc_server_create(NULL, "tcp:127.0.0.1:0", NULL, answer, NULL, &why), APC_EINVAL);
    assert_int_equal(apc_server_create(&server, NULL, NULL, answer, NULL, &why), APC_EINVAL);
    assert_int_equal(apc_server_create(&server, "tcp:127.0.0.1", NULL, answer, NULL, &why), APC_EINVAL);
    assert_int_equal(apc_server_create(&server, "udp:127.0.0.1:1", NULL, answer, NULL, &why), APC_EINVAL);
    apc_server_destroy(NULL);
    assert_int_equal(apc_server_port(NULL), APC_EINVAL);
    apc_server_stats(NULL, &stats);
    assert_int_equal(stats.open, 0);
}

static void rejections_are_logged_once_in_a_while(void **state)
{
    struct apc_server_options options = {.size = sizeof options};
    struct plant p;
    char text[4096];
    int fds[2], port;
    ssize_t n;
    (void)state;

    assert_int_equal(pipe(fds), 0);
    assert_int_equal(apc_log_create(&options.log, fds[1], "test", APC_LOG_DEBUG), 0);
    port = start(&p, &options);
    for (int i = 0; i < 20; i++) {
        int fd = connect_to(port);
        say(fd, "bad\n");
        expect_closed(fd);
    }
    assert_int_equal(stats_of(&p).rejected, 20);
    stop(&p);
    apc_log_destroy(options.log);
    n = read(fds[0], text, sizeof text - 1);
    assert_true(n > 0);
    text[n] = '\0';
    assert_non_null(strstr(text, "closed the connection from 127.0.0.1:"));
    assert_ptr_equal(strchr(text, '\n'), text + n - 1); /* one line */
    close(fds[0]);
    close(fds[1]);
}

static void the_answer_knows_who_asks_and_is_not_interrupted(void **state)
{
    struct plant p;
    int fd = connect_to(start(&p, NULL));
    struct sockaddr_in in;
    socklen_t length = sizeof in;
    sigset_t mask;
    char expected[64];
    (void)state;

    sem_post(&p.leave); /* what start() wrote is for the server's thread to read */
    ask(fd, "who\n");
    sem_wait(&p.entered); /* and the other way round */
    assert_int_equal(getsockname(fd, (struct sockaddr *)&in, &length), 0);
    snprintf(expected, sizeof expected, "127.0.0.1:%d", ntohs(in.sin_port));
    assert_string_equal(p.peer, expected);
    assert_string_equal(p.nobody, "one whose address is forgotten");
    assert_string_equal(p.former, p.nobody);
    assert_false(atomic_load(&p.unmasked)); /* signals are for the program's own threads */
    pthread_sigmask(SIG_SETMASK, NULL, &mask);
    assert_false(sigismember(&mask, SIGTERM)); /* of which this is one, as before */
    assert_tuned(atomic_load(&accepted));
    close(fd);
    stop(&p);
}

/* Whoever sent something and left can still be named. */
/* Promise(modes/command-whatever-number) */
static void the_address_of_a_closed_connection_is_told(void **state)
{
    struct plant p;
    int port = start(&p, NULL), fd = connect_to(port);
    struct sockaddr_in in;
    socklen_t length = sizeof in;
    char expected[64];
    (void)state;

    assert_int_equal(getsockname(fd, (struct sockaddr *)&in, &length), 0);
    snprintf(expected, sizeof expected, "127.0.0.1:%d", ntohs(in.sin_port));
    say(fd, "bad\n");
    assert_int_equal(recv(fd, &(char){0}, 1, 0), 0); /* closed there as well */
    close(fd);
    fd = connect_to(port);
    sem_post(&p.leave);
    ask(fd, "who\n");
    sem_wait(&p.entered);
    assert_string_equal(p.former, expected);
    close(fd);
    stop(&p);
}

static void a_reply_that_is_none_or_has_no_room_closes_the_connection(void **state)
{
    static const char *const requests[] = {"none\n", "over\n"};
    struct plant p;
    int port = start(&p, NULL);
    (void)state;

    for (unsigned i = 0; i < 2; i++) {
        int fd = connect_to(port);
        ask(fd, "hello\n");
        say(fd, requests[i]);
        expect_closed(fd);
        assert_int_equal(stats_of(&p).rejected, i + 1);
    }
    stop(&p);
}

static void no_descriptor_is_left_open(void **state)
{
    const int before = open_descriptors();
    struct apc_server_options options = {.size = sizeof options};
    struct plant p;
    struct apc_server *second;
    char uri[64];
    int port, fd;
    (void)state;

    assert_int_equal(apc_server_create(&second, "tcp:0.0.0.0:0", &options, answer, NULL, NULL), APC_EPERM);
    assert_int_equal(open_descriptors(), before);
    port = start(&p, NULL);
    fd = connect_to(port);
    ask(fd, "hello\n");
    assert_int_equal(open_descriptors(), before + 4); /* wake, listener, and the two ends */
    snprintf(uri, sizeof uri, "tcp:127.0.0.1:%d", port);
    for (int i = 0; i < 3; i++)
        assert_int_equal(apc_server_create(&second, uri, NULL, answer, NULL, NULL), APC_ESYS);
    assert_int_equal(open_descriptors(), before + 4);
    stop(&p);
    assert_int_equal(open_descriptors(), before + 1);
    close(fd);
}

static void a_socket_that_fails_is_closed_and_one_that_has_to_wait_is_not(void **state)
{
    static const struct {
        enum call call;
        int number;
        bool closed;
    } faults[] = {{RECV, ECONNRESET, true}, {RECV, EAGAIN, false}, {RECV, EINTR, false},
                  {SEND, EPIPE, true},      {SEND, EAGAIN, false}, {SEND, EINTR, false}};
    struct plant p;
    int port = start(&p, NULL);
    (void)state;

    for (size_t i = 0; i < sizeof faults / sizeof *faults; i++) {
        int fd = connect_to(port);
        ask(fd, "hello\n"); /* so that it is the socket under test */
        order(faults[i].call, faults[i].number, 0, 1);
        say(fd, "again\n");
        if (faults[i].closed) {
            expect_closed(fd);
        } else {
            expect(fd, "again\n");
            close(fd);
        }
    }
    assert_int_equal(stats_of(&p).rejected, 0); /* it was nothing that a peer did */
    stop(&p);
}

static void replies_may_go_byte_by_byte(void **state)
{
    struct plant p;
    int fd = connect_to(start(&p, NULL));
    (void)state;

    ask(fd, "hello\n");
    atomic_store(&kernel[SEND].most, 1);
    atomic_store(&kernel[RECV].most, 2);
    say(fd, "one\ntwo\n\nfour\nfi");
    expect(fd, "one\ntwo\n\nfour\n");
    say(fd, "ve\n");
    expect(fd, "five\n");
    assert_int_equal(atomic_load(&p.calls), 6);
    close(fd);
    stop(&p);
}

/* ---- On a clock that stands ---------------------------------------------------------------------- */

static void stand(apc_ns at)
{
    atomic_store(&standing, at);
}

static void half_a_frame_has_exactly_the_time_there_is(void **state)
{
    const struct apc_server_options options = {.size = sizeof options, .frame_timeout = 50 * APC_NS_PER_MS};
    struct plant p;
    int port, half, other;
    (void)state;

    stand(APC_NS_PER_S);
    port = start(&p, &options);
    half = connect_to(port);
    other = connect_to(port);
    ask(half, "hello\n");
    stand(2 * APC_NS_PER_S); /* from here on: idleness before does not count */
    say(half, "apc1 comm");
    ask(other, "hello\n");
    stand(2 * APC_NS_PER_S + options.frame_timeout - 1);
    for (int i = 0; i < 10; i++)
        ask(other, "hello\n");
    assert_int_equal(stats_of(&p).rejected, 0);
    stand(2 * APC_NS_PER_S + options.frame_timeout);
    expect_closed(half);
    ask(other, "hello\n");
    assert_int_equal(stats_of(&p).rejected, 1);
    close(other);
    stop(&p);
}

static void a_server_that_cannot_accept_pauses_for_a_tenth_of_a_second(void **state)
{
    static const int lacking[] = {EMFILE, ENFILE, ENOBUFS, ENOMEM}, passing[] = {ECONNABORTED, EINTR, EAGAIN};
    const apc_ns begun = 5 * APC_NS_PER_S;
    struct plant p;
    int port, first;
    (void)state;

    stand(begun);
    port = start(&p, NULL);
    for (size_t i = 0; i < sizeof lacking / sizeof *lacking; i++) {
        int second, tried;

        stand(begun);
        first = connect_to(port);
        ask(first, "hello\n");
        tried = atomic_load(&kernel[ACCEPT].calls);
        order(ACCEPT, lacking[i], 0, 1);
        second = connect_to(port);
        say(second, "second\n");
        while (atomic_load(&kernel[ACCEPT].times) > 0)
            ask(first, "hello\n");
        stand(begun + 100 * APC_NS_PER_MS - 1);
        for (int k = 0; k < 20; k++)
            ask(first, "hello\n");
        assert_int_equal(atomic_load(&kernel[ACCEPT].calls), tried + 1);
        if (i % 2 == 0)
            stand(begun + 100 * APC_NS_PER_MS);
        else
            close(first); /* there is a descriptor again: at once */
        expect(second, "second\n");
        if (i % 2 == 0)
            close(first);
        close(second);
        for (int k = 0; stats_of(&p).open > 0 && k < PATIENCE_MS; k++)
            poll(NULL, 0, 1);
    }
    for (size_t i = 0; i < sizeof passing / sizeof *passing; i++) {
        order(ACCEPT, passing[i], 0, 1); /* what concerns one client only is no reason to wait */
        first = connect_to(port);
        ask(first, "hello\n");
        close(first);
    }
    stop(&p);
}

static void a_line_in_ten_seconds_says_how_many_were_closed(void **state)
{
    static const struct {
        apc_ns at;
        const char *more; /* NULL: nothing is said */
    } closings[] = {{1, "(0 more "},           {2, NULL},
                    {10 * APC_NS_PER_S, NULL}, {10 * APC_NS_PER_S + 1, "(2 more "},
                    {20 * APC_NS_PER_S, NULL}, {20 * APC_NS_PER_S + 1, "(1 more "}};
    struct apc_server_options options = {.size = sizeof options};
    struct plant p;
    char text[4096], *line = text;
    int fds[2], port;
    ssize_t n;
    (void)state;

    assert_int_equal(pipe(fds), 0);
    assert_int_equal(apc_log_create(&options.log, fds[1], "test", APC_LOG_DEBUG), 0);
    stand(1);
    port = start(&p, &options);
    for (size_t i = 0; i < sizeof closings / sizeof *closings; i++) {
        int fd;
        stand(closings[i].at);
        fd = connect_to(port);
        say(fd, "bad\n");
        expect_closed(fd);
    }
    stop(&p);
    apc_log_destroy(options.log);
    n = read(fds[0], text, sizeof text - 1);
    assert_true(n > 0);
    text[n] = '\0';
    for (size_t i = 0; i < sizeof closings / sizeof *closings; i++)
        if (closings[i].more) {
            char *end = strchr(line, '\n');
            assert_non_null(end);
            *end = '\0';
            assert_non_null(strstr(line, closings[i].more));
            assert_non_null(strstr(line, "not a request that can be answered"));
            line = end + 1;
        }
    assert_string_equal(line, "");
    close(fds[0]);
    close(fds[1]);
}

static void the_longest_idle_goes_and_never_who_is_in_the_middle_of_something(void **state)
{
    const struct apc_server_options options = {
        .size = sizeof options, .connections = 3, .frame_timeout = PATIENCE};
    struct plant p;
    int port, half, idle, younger, next;
    (void)state;

    stand(APC_NS_PER_S);
    port = start(&p, &options);
    half = connect_to(port);
    ask(half, "hello\n");
    say(half, "hel"); /* the oldest, but not idle */
    stand(2 * APC_NS_PER_S);
    younger = connect_to(port); /* in the table before the older one */
    ask(younger, "hello\n");
    idle = connect_to(port);
    ask(idle, "hello\n");
    stand(3 * APC_NS_PER_S);
    ask(younger, "hello\n");
    next = connect_to(port);
    ask(next, "hello\n");
    expect_closed(idle);
    ask(younger, "hello\n");
    say(half, "lo\n");
    expect(half, "hello\n");
    assert_int_equal(stats_of(&p).evicted, 1);
    close(half);
    close(younger);
    close(next);
    stop(&p);
}

/* In a child, so that the limit is its own. Returns 0, or at which step it failed. */
static int starve(void)
{
    struct sockaddr_in in = {.sin_family = AF_INET};
    struct plant p;
    struct rlimit limit;
    int spare[64], count = 0, port = start(&p, NULL), first = connect_to(port), second, tried;

    ask(first, "hello\n");
    second = socket(AF_INET, SOCK_STREAM, 0);
    if (getrlimit(RLIMIT_NOFILE, &limit) < 0)
        return 1;
    limit.rlim_cur = (rlim_t)second + 8;
    if (setrlimit(RLIMIT_NOFILE, &limit) < 0)
        return 2;
    while (count < 64 && (spare[count] = dup(first)) >= 0)
        count++;
    if (count == 64)
        return 3;

    tried = atomic_load(&kernel[ACCEPT].calls);
    in.sin_port = htons((uint16_t)port);
    in.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
    if (connect(second, (struct sockaddr *)&in, sizeof in) < 0) /* into the queue, where it stays */
        return 4;
    say(second, "second\n");
    for (int i = 0; i < 1000; i++) /* who is in is served; a server that spins tries at least as often */
        ask(first, "hello\n");
    tried = atomic_load(&kernel[ACCEPT].calls) - tried;
    if (tried < 1 || tried > 500 || stats_of(&p).accepted != 1)
        return 5;
    while (count > 0)
        close(spare[--count]);
    expect(second, "second\n"); /* although no connection was closed */
    stop(&p);
    return 0;
}

static void a_server_out_of_descriptors_serves_on_and_recovers(void **state)
{
    int status = 0;
    pid_t child = fork();
    (void)state;

    assert_true(child >= 0);
    if (child == 0)
        _exit(starve());
    assert_int_equal(waitpid(child, &status, 0), child);
    assert_true(WIFEXITED(status));
    assert_int_equal(WEXITSTATUS(status), 0);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(a_server_out_of_descriptors_serves_on_and_recovers),
        cmocka_unit_test(each_connection_is_served_and_has_its_own_number),
        cmocka_unit_test(bytes_may_trickle),
        cmocka_unit_test(pipelined_requests_are_answered_in_order),
        cmocka_unit_test(a_client_that_ends_after_its_requests_gets_its_answers),
        cmocka_unit_test(a_frame_cut_off_by_the_end_is_rejected),
        cmocka_unit_test(half_a_frame_times_out_and_idleness_does_not),
        cmocka_unit_test(a_frame_that_trickles_for_ever_times_out),
        cmocka_unit_test(a_frame_beyond_frame_max_is_rejected),
        cmocka_unit_test(an_error_of_the_handler_closes_that_connection_only),
        cmocka_unit_test(a_client_that_never_reads_is_closed_and_holds_nobody_up),
        cmocka_unit_test(a_reply_too_large_for_one_send_arrives_whole),
        cmocka_unit_test(a_request_on_a_reset_connection_is_not_answered),
        cmocka_unit_test(connections_beyond_the_cap_are_closed_at_once_while_all_others_are_in_use),
        cmocka_unit_test(whoever_only_connects_cannot_lock_the_client_out),
        cmocka_unit_test(the_connection_that_was_silent_longest_gives_way),
        cmocka_unit_test(many_connections_come_and_go),
        cmocka_unit_test(destroy_ends_connections_and_calls),
        cmocka_unit_test(only_loopback_is_listened_on_unless_allowed_by_name),
        cmocka_unit_test(a_taken_port_is_named),
        cmocka_unit_test(arguments_are_checked),
        cmocka_unit_test(rejections_are_logged_once_in_a_while),
        cmocka_unit_test(the_address_of_a_closed_connection_is_told),
        cmocka_unit_test_teardown(the_answer_knows_who_asks_and_is_not_interrupted, mend),
        cmocka_unit_test_teardown(a_reply_that_is_none_or_has_no_room_closes_the_connection, mend),
        cmocka_unit_test_teardown(no_descriptor_is_left_open, mend),
        cmocka_unit_test_teardown(a_socket_that_fails_is_closed_and_one_that_has_to_wait_is_not, mend),
        cmocka_unit_test_teardown(replies_may_go_byte_by_byte, mend),
        cmocka_unit_test_teardown(half_a_frame_has_exactly_the_time_there_is, mend),
        cmocka_unit_test_teardown(a_server_that_cannot_accept_pauses_for_a_tenth_of_a_second, mend),
        cmocka_unit_test_teardown(a_line_in_ten_seconds_says_how_many_were_closed, mend),
        cmocka_unit_test_teardown(the_longest_idle_goes_and_never_who_is_in_the_middle_of_something, mend),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}

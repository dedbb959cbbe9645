/* SPDX-License-Identifier: BSD-3-Clause */
/* The asking side of a link, against peers that misbehave to order. */
#define UNDER_TEST connected
#include "sockets/sockets_internal.h"
#include "sockets_faults.h"

#include <dlfcn.h>
#include <netdb.h>
#include <pthread.h>
#include <semaphore.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#define PATIENCE (20 * APC_NS_PER_S) /* a hang is a failure, not a hung test */
#define SHORT    (250 * APC_NS_PER_MS)

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
    struct apc_link *link = start_peer(&p, "arcarearhcare");
    (void)state;

    assert_int_equal(ask(link, "one\n", PATIENCE), APC_ECONN);
    assert_false(apc_link_connected(link));
    assert_int_equal(ask(link, "two\n", PATIENCE), 0); /* connecting did not fail: no pause */
    apc_link_reset(link);
    assert_int_equal(ask(link, "three\n", PATIENCE), APC_ECONN); /* half of a reply is none */
    assert_int_equal(ask(link, "four\n", PATIENCE), 0);
    assert_int_equal(apc_link_connects(link), 4);
    end_peer(&p, link);
}

/* As a plant does with a client that was replaced: it is not to be asked again at each tick. */
/* Promise(run/growing-pauses) */
static void a_peer_that_refuses_is_left_alone_for_a_pause(void **state)
{
    const struct apc_link_options options = {
        .size = sizeof options, .backoff_min = 3600 * APC_NS_PER_S, .backoff_max = 7200 * APC_NS_PER_S};
    struct peer p;
    struct apc_link *first = start_peer(&p, "arcarc"), *link = link_to(p.port, &options);
    (void)state;

    apc_link_destroy(first);
    assert_int_equal(ask(link, "one\n", PATIENCE), APC_ECONN);
    assert_int_equal(ask(link, "two\n", PATIENCE), APC_ECONN);
    struct apc_error why;
    snprintf(why.text, sizeof why.text, "%s", apc_link_error(link));
    for (int i = 0; i < 3; i++)
        assert_int_equal(ask(link, "three\n", PATIENCE), APC_ECONN);
    assert_string_equal(apc_link_error(link), why.text); /* that of the refusal */
    assert_int_equal(apc_link_connects(link), 2);
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

    /* and what the kernel still held is not delivered later: a network that comes back brings no old command */
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

/* Promise(run/growing-pauses) */
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

/* As ask(), until a peer that pauses, or is not there yet, answers. */
static int ask_until(struct apc_link *link, const char *request, int refusal)
{
    apc_ns until = soon(PATIENCE);
    int err;
    do
        err = ask(link, request, PATIENCE);
    while (err == refusal && apc_clock_mono(NULL) < until);
    return err;
}

static int serve_echo(struct apc_server **server, const char *uri)
{
    assert_int_equal(apc_server_create(server, uri, NULL, echo, NULL, NULL), 0);
    return apc_server_port(*server);
}

static void calls_that_a_signal_interrupts_are_repeated(void **state)
{
    struct apc_server *server;
    struct apc_link *link = link_to(serve_echo(&server, "tcp:127.0.0.1:0"), NULL);
    (void)state;

    order(CONNECT, EINTR, 0, 1);
    order(PPOLL, EINTR, 0, 3);
    order(SEND, EINTR, 0, 2);
    order(RECV, EINTR, 0, 2);
    assert_int_equal(ask(link, "one\n", PATIENCE), 0);
    for (int number = EINTR; number; number = number == EINTR ? EAGAIN : 0) {
        order(PPOLL, EINTR, 0, 2);
        order(SEND, number, 0, 2);
        order(RECV, number, 0, 3); /* the first looks whether the peer is still there */
        assert_int_equal(ask(link, "two\n", PATIENCE), 0);
        for (int i = 0; i < CALLS; i++)
            assert_int_equal(atomic_load(&kernel[i].times), 0);
    }
    assert_int_equal(apc_link_connects(link), 1);
    apc_link_destroy(link);
    apc_server_destroy(server);
}

static void bytes_may_go_one_by_one(void **state)
{
    struct apc_server *server;
    struct apc_link *link = link_to(serve_echo(&server, "tcp:127.0.0.1:0"), NULL);
    (void)state;

    atomic_store(&kernel[SEND].most, 1);
    atomic_store(&kernel[RECV].most, 1);
    assert_int_equal(ask(link, "one byte at a time\n", PATIENCE), 0);
    assert_int_equal(ask(link, "\n", PATIENCE), 0);
    assert_int_equal(apc_link_connects(link), 1);
    apc_link_destroy(link);
    apc_server_destroy(server);
}

static void what_fails_is_said_and_leaves_nothing_open(void **state)
{
    static const struct {
        enum call call;
        int number, after, err;
        enum call besides; /* fails once with EAGAIN; CALLS: none does */
        const char *doing, *why;
    } faults[] = {
        {SOCKET, EMFILE, 0, APC_ECONN, CALLS, "cannot make a socket", ": Too many open files"},
        {CONNECT, ENETUNREACH, 0, APC_ECONN, CALLS, "connecting to 127.0.0.1:", ": Network is unreachable"},
        {PPOLL, ENOMEM, 0, APC_ECONN, CALLS, "connecting to 127.0.0.1:", ": Cannot allocate memory"},
        {PPOLL, 0, 0, APC_ETIMEDOUT, CALLS, "connecting to 127.0.0.1:", ": no answer in time"},
        {SEND, ENETDOWN, 0, APC_ECONN, CALLS, "sending", ": Network is down"},
        {PPOLL, ENOMEM, 1, APC_ECONN, SEND, "sending", ": Cannot allocate memory"},
        {PPOLL, 0, 1, APC_ETIMEDOUT, SEND, "sending", ": the peer took nothing in time"},
        {PPOLL, ENOMEM, 1, APC_ECONN, CALLS, "waiting for the reply", ": Cannot allocate memory"},
        {PPOLL, 0, 1, APC_ETIMEDOUT, CALLS, "no whole reply in time", ""},
        {RECV, EHOSTUNREACH, 0, APC_ECONN, CALLS, "receiving", ": No route to host"},
    };
    const struct apc_link_options options = {.size = sizeof options, .backoff_min = 1, .backoff_max = 1};
    (void)state;

    for (size_t i = 0; i < sizeof faults / sizeof *faults; i++) {
        struct peer p = {.script = "are"};
        struct apc_link *link;
        int before, err;

        p.listener = bind_somewhere(&p.port, 8);
        if (faults[i].call == RECV)
            assert_int_equal(pthread_create(&p.thread, NULL, play, &p), 0);
        link = link_to(p.port, &options);
        before = open_descriptors();
        order(CONNECT, EINPROGRESS, 0, 1); /* so that it is waited for */
        order(faults[i].call, faults[i].number, faults[i].after, 1);
        if (faults[i].besides != CALLS)
            order(faults[i].besides, EAGAIN, 0, 1);
        err = ask(link, "one\n", PATIENCE);
        if (err != faults[i].err)
            fail_msg("case %zu: %d, \"%s\"", i, err, apc_link_error(link));
        if (!strstr(apc_link_error(link), faults[i].doing) || !strstr(apc_link_error(link), faults[i].why))
            fail_msg("\"%s\": expected \"%s\" and \"%s\"", apc_link_error(link), faults[i].doing,
                     faults[i].why);
        assert_false(apc_link_connected(link));
        if (faults[i].call == RECV) {
            pthread_join(p.thread, NULL);
            close(p.connections[0]);
        }
        assert_int_equal(open_descriptors(), before);
        apc_link_destroy(link);
        close(p.listener);
    }
}

/* Where nothing of ours is on its way the peer reads an end, and no reset, of which servers have died. */
/* Promise(links): A link is closed in order. */
static void who_has_his_answer_closes_in_order(void **state)
{
    struct peer p;
    struct apc_link *link = start_peer(&p, "are");
    char byte;
    (void)state;

    assert_int_equal(ask(link, "one\n", PATIENCE), 0);
    pthread_join(p.thread, NULL);
    apc_link_destroy(link);
    assert_int_equal(recv(p.connections[0], &byte, 1, 0), 0);
    close(p.connections[0]);
    close(p.listener);
}

static void a_link_has_one_descriptor_while_it_is_connected(void **state)
{
    struct apc_server *server;
    int port = serve_echo(&server, "tcp:127.0.0.1:0"), before = open_descriptors();
    struct apc_link *link = link_to(port, NULL);
    (void)state;

    assert_int_equal(open_descriptors(), before);
    assert_int_equal(ask(link, "one\n", PATIENCE), 0);
    assert_tuned(atomic_load(&connected));
    assert_int_equal(open_descriptors(), before + 2); /* and the server's */
    apc_server_destroy(server);
    apc_link_reset(link);
    assert_int_equal(open_descriptors(), before - 2); /* nor the server's listener and its wake descriptor */
    apc_link_destroy(link);
    serve_echo(&server, "tcp:127.0.0.1:0");
    link = link_to(apc_server_port(server), NULL);
    assert_int_equal(ask(link, "one\n", PATIENCE), 0);
    apc_link_destroy(link);
    apc_server_destroy(server);
    assert_int_equal(open_descriptors(), before - 2);
}

/* ---- Pauses, on a clock that stands ------------------------------------------------------------ */

static void pauses_double_up_to_their_longest_and_have_the_jitter_of_the_seed(void **state)
{
    /* the generator's published outputs for this seed */
    static const uint64_t splitmix64[] = {6457827717110365317u, 3203168211198807973u, 9817491932198370423u,
                                          4593380528125082431u, 16408922859458223821u};
    static const apc_ns longest[] = {1000, 2000, 4000, 5000}; /* s */
    const struct apc_link_options options = {.size = sizeof options,
                                             .seed = 1234567,
                                             .backoff_min = 1000 * APC_NS_PER_S,
                                             .backoff_max = 5000 * APC_NS_PER_S};
    int port, listener = bind_somewhere(&port, 0);
    struct apc_link *link = link_to(port, &options);
    (void)state;

    atomic_store(&standing, 42 * APC_NS_PER_S);
    assert_int_equal(ask(link, "one\n", PATIENCE), APC_ECONN);
    for (size_t i = 0; i < 5; i++) {
        double share = 0.5 + (double)(splitmix64[i] >> 11) * 0x1p-53 / 2;
        apc_ns whole = i < 4 ? longest[i] : 1000; /* the last one: after a success */
        apc_ns pause = (apc_ns)((double)(whole * APC_NS_PER_S) * share);
        int before = atomic_load(&kernel[CONNECT].calls);

        atomic_fetch_add(&standing, pause - 1);
        assert_int_equal(ask(link, "one\n", PATIENCE), APC_ECONN);
        assert_int_equal(atomic_load(&kernel[CONNECT].calls), before);
        atomic_fetch_add(&standing, 1);
        if (i == 3) {
            assert_int_equal(listen(listener, 8), 0);
            order(CONNECT, EINPROGRESS, 0, 1);
            order(PPOLL, 0, 1, 1); /* connected; and nobody answers */
            assert_int_equal(ask(link, "one\n", PATIENCE), APC_ETIMEDOUT);
            assert_int_equal(apc_link_connects(link), 1);
            order(CONNECT, ECONNREFUSED, 0, 1);
        }
        assert_int_equal(ask(link, "one\n", PATIENCE), i == 4 ? APC_ETIMEDOUT : APC_ECONN);
        assert_int_equal(atomic_load(&kernel[CONNECT].calls), before + (i == 3 ? 2 : 1));
        if (i == 3) {
            order(CONNECT, EINPROGRESS, 0, 1);
            order(PPOLL, 0, 1, 1);
        }
    }
    apc_link_destroy(link);
    close(listener);
}

/* A hundred clients of a plant that restarts do not come back in step. */
static void links_without_a_seed_pause_for_different_times(void **state)
{
    const struct apc_link_options options = {.size = sizeof options, .backoff_min = 1000 * APC_NS_PER_S};
    int port, listener = bind_somewhere(&port, 0), first = -1;
    bool differ = false;
    (void)state;

    for (int i = 0; i < 8; i++) {
        struct apc_link *link;
        int before, percent = 50;

        atomic_store(&standing, 42 * APC_NS_PER_S + i);
        link = link_to(port, &options);
        assert_int_equal(ask(link, "one\n", PATIENCE), APC_ECONN);
        before = atomic_load(&kernel[CONNECT].calls);
        atomic_fetch_add(&standing, 500 * APC_NS_PER_S - 1);
        assert_int_equal(ask(link, "one\n", PATIENCE), APC_ECONN);
        assert_int_equal(atomic_load(&kernel[CONNECT].calls), before);
        for (; atomic_load(&kernel[CONNECT].calls) == before && percent < 100; percent++) {
            atomic_fetch_add(&standing, 10 * APC_NS_PER_S);
            assert_int_equal(ask(link, "one\n", PATIENCE), APC_ECONN);
        }
        assert_int_equal(atomic_load(&kernel[CONNECT].calls), before + 1); /* the pause is over by then */
        if (first < 0)
            first = percent;
        differ = differ || percent != first;
        apc_link_destroy(link);
    }
    assert_true(differ);
    close(listener);
}

static void the_longest_pause_is_five_seconds_or_the_shortest(void **state)
{
    const apc_ns mins[] = {4 * APC_NS_PER_S, 6 * APC_NS_PER_S};
    int port, listener = bind_somewhere(&port, 0);
    (void)state;

    for (size_t i = 0; i < 2; i++) {
        const struct apc_link_options options = {.size = sizeof options, .backoff_min = mins[i]};
        const apc_ns longest = i == 0 ? 5 * APC_NS_PER_S : mins[i];
        struct apc_link *link = link_to(port, &options);
        int before = atomic_load(&kernel[CONNECT].calls);

        atomic_store(&standing, 42 * APC_NS_PER_S);
        for (int tries = 1; tries < 6; tries++) {
            assert_int_equal(ask(link, "one\n", PATIENCE), APC_ECONN);
            assert_int_equal(atomic_load(&kernel[CONNECT].calls), before + tries);
            atomic_fetch_add(&standing, longest);
        }
        apc_link_destroy(link);
    }
    close(listener);
}

/* ---- Names, which a resolver of ours resolves --------------------------------------------------- */

static const char *_Atomic addresses[8]; /* of plant.test, up to the first NULL */
static atomic_int queries;
static atomic_bool unmasked; /* a query came from a thread that takes signals */
static sem_t *_Atomic gate;  /* what a query waits for, if not NULL */

static void resolve_to(const char *first, const char *second)
{
    atomic_store(&addresses[2], NULL);
    atomic_store(&addresses[1], second);
    atomic_store(&addresses[0], first);
    atomic_store(&queries, 0);
    atomic_store(&n_asked, 0);
}

int own_names(const char *host, const char *service, const struct addrinfo *hints,
              struct addrinfo **list) __asm__("getaddrinfo");
int own_names(const char *host, const char *service, const struct addrinfo *hints, struct addrinfo **list)
{
    int (*libc)(const char *, const char *, const struct addrinfo *, struct addrinfo **) = NULL;
    struct addrinfo **end = list;
    const char *address;
    sigset_t mask;
    void *found = dlsym(RTLD_NEXT, "getaddrinfo");

    memcpy(&libc, &found, sizeof libc);
    if (strcmp(host, "plant.test") != 0)
        return libc(host, service, hints, list);
    pthread_sigmask(SIG_SETMASK, NULL, &mask);
    if (!sigismember(&mask, SIGTERM))
        atomic_store(&unmasked, true);
    if (atomic_load(&gate))
        sem_wait(atomic_load(&gate));
    atomic_fetch_add(&queries, 1);
    *list = NULL;
    for (int i = 0; (address = atomic_load(&addresses[i])); i++) {
        if (libc(address, service, hints, end) != 0)
            return EAI_FAIL;
        end = &(*end)->ai_next;
    }
    return 0;
}

static struct apc_link *link_to_name(int port)
{
    const struct apc_link_options options = {.size = sizeof options, .backoff_min = 1, .backoff_max = 1};
    struct apc_link *link;
    char uri[64];
    snprintf(uri, sizeof uri, "tcp:plant.test:%d", port);
    assert_int_equal(apc_link_create(&link, uri, &options, NULL), 0);
    return link;
}

static void assert_asked(const char *expected)
{
    char text[128] = "";
    for (int i = 0; i < atomic_load(&n_asked); i++)
        snprintf(text + strlen(text), sizeof text - strlen(text), "%d ", atomic_load(&asked[i]));
    assert_string_equal(text, expected);
}

static void every_address_of_a_name_is_tried_in_turn(void **state)
{
    struct apc_server *server;
    struct apc_link *link;
    int port = serve_echo(&server, "tcp:127.0.0.3:0");
    (void)state;

    resolve_to("127.0.0.2", "127.0.0.3");
    link = link_to_name(port);
    assert_int_equal(ask(link, "one\n", PATIENCE), 0);
    assert_int_equal(apc_link_connects(link), 1);
    assert_asked("2 3 ");
    apc_link_reset(link);
    assert_int_equal(ask(link, "two\n", PATIENCE), 0);
    assert_asked("2 3 3 "); /* what was good is tried first */
    assert_int_equal(atomic_load(&queries), 1);
    assert_false(atomic_load(&unmasked));
    apc_link_destroy(link);
    apc_server_destroy(server);
}

static void an_address_that_does_not_answer_is_not_the_first_next_time(void **state)
{
    struct apc_server *server;
    struct apc_link *link;
    int port = serve_echo(&server, "tcp:127.0.0.3:0");
    (void)state;

    resolve_to("127.0.0.2", "127.0.0.3");
    link = link_to_name(port);
    order(CONNECT, EINPROGRESS, 0, 1);
    order(PPOLL, 0, 0, 1);
    assert_int_equal(ask(link, "one\n", PATIENCE), APC_ETIMEDOUT);
    assert_asked("2 "); /* it took all the time that there was */
    assert_int_equal(ask_until(link, "two\n", APC_ECONN), 0);
    assert_asked("2 3 ");
    apc_link_destroy(link);
    apc_server_destroy(server);
}

static void ipv4_comes_first_and_no_more_than_four_are_kept(void **state)
{
    int port, listener = bind_somewhere(&port, 0);
    struct apc_link *link;
    (void)state;

    resolve_to("::1", "127.0.0.2");
    for (int i = 6; i > 1; i--) {
        static const char *const more[] = {"127.0.0.3", "127.0.0.4", "127.0.0.5", "127.0.0.6", "127.0.0.7"};
        atomic_store(&addresses[i], more[i - 2]);
    }
    link = link_to_name(port);
    assert_int_equal(ask(link, "one\n", PATIENCE), APC_ECONN);
    assert_asked("2 3 4 5 ");
    apc_link_destroy(link);
    for (int i = 2; i <= 6; i++)
        atomic_store(&addresses[i], NULL);
    close(listener);
}

static void a_host_that_moved_is_found_again(void **state)
{
    struct apc_server *server;
    struct apc_link *link;
    int port = serve_echo(&server, "tcp:127.0.0.3:0");
    (void)state;

    resolve_to("127.0.0.2", NULL);
    link = link_to_name(port);
    assert_int_equal(ask(link, "one\n", PATIENCE), APC_ECONN);
    atomic_store(&addresses[0], "127.0.0.3");
    assert_int_equal(ask_until(link, "two\n", APC_ECONN), 0);
    apc_link_destroy(link);
    apc_server_destroy(server);
}

static void a_name_that_had_no_address_gets_one(void **state)
{
    struct apc_server *server;
    struct apc_link *link;
    int port = serve_echo(&server, "tcp:127.0.0.3:0");
    (void)state;

    resolve_to(NULL, NULL);
    link = link_to_name(port);
    assert_int_equal(ask(link, "one\n", PATIENCE), APC_ECONN);
    assert_non_null(strstr(apc_link_error(link), "host name \"plant.test\" has no address"));
    atomic_store(&addresses[0], "127.0.0.3");
    assert_int_equal(ask_until(link, "two\n", APC_ECONN), 0);
    apc_link_destroy(link);
    apc_server_destroy(server);
}

static void a_name_that_takes_its_time_holds_nobody_up(void **state)
{
    struct apc_server *server;
    struct apc_link *link;
    sem_t opens;
    int port = serve_echo(&server, "tcp:127.0.0.3:0");
    (void)state;

    sem_init(&opens, 0, 0);
    atomic_store(&gate, &opens);
    resolve_to("127.0.0.3", NULL);
    link = link_to_name(port);
    assert_int_equal(ask(link, "one\n", SHORT), APC_ETIMEDOUT);
    assert_non_null(strstr(apc_link_error(link), "host name \"plant.test\" is not resolved yet"));
    atomic_store(&gate, NULL);
    sem_post(&opens);
    assert_int_equal(ask_until(link, "two\n", APC_ECONN), 0);
    apc_link_destroy(link);
    apc_server_destroy(server);
    sem_destroy(&opens);
}

static void a_restarted_server_is_found_again(void **state)
{
    const struct apc_link_options options = {
        .size = sizeof options, .backoff_min = APC_NS_PER_MS, .backoff_max = 4 * APC_NS_PER_MS};
    struct apc_server *server;
    struct apc_link *link;
    char uri[64];
    int port = serve_echo(&server, "tcp:127.0.0.1:0");
    (void)state;

    link = link_to(port, &options);
    assert_int_equal(ask(link, "one\n", PATIENCE), 0);
    apc_server_destroy(server);
    for (int i = 0; i < 10; i++)
        assert_int_equal(ask(link, "two\n", PATIENCE), APC_ECONN);
    snprintf(uri, sizeof uri, "tcp:127.0.0.1:%d", port);
    serve_echo(&server, uri);
    assert_int_equal(ask_until(link, "three\n", APC_ECONN), 0);
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
    char uri[64], why[128];
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

    assert_int_equal(apc_link_create(&link, uri, NULL, NULL), 0);
    assert_int_equal(ask(link, "one\n", PATIENCE), APC_ECONN); /* and so it is shown */
    snprintf(why, sizeof why, "connecting to %s: Connection refused", uri + 4);
    assert_non_null(strstr(apc_link_error(link), why));
    apc_link_destroy(link);
}

/* Also where the machine has no IPv6. */
static void an_address_is_shown_as_it_is_written(void **state)
{
    static const struct {
        const char *uri, *text;
        bool loopback;
    } cases[] = {{"tcp:127.0.0.1:1", "127.0.0.1:1", true},
                 {"tcp:127.255.0.9:65535", "127.255.0.9:65535", true},
                 {"tcp:126.0.0.1:80", "126.0.0.1:80", false},
                 {"tcp:128.0.0.1:80", "128.0.0.1:80", false},
                 {"tcp:[::1]:502", "[::1]:502", true},
                 {"tcp:[0:0::2]:502", "[::2]:502", false},
                 {"tcp:[fe80::A:1]:4840", "[fe80::a:1]:4840", false}};
    (void)state;

    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        char text[APC_ENDPOINT_TEXT];
        struct apc_hostport host;
        struct apc_endpoints to;
        assert_int_equal(apc_hostport_parse(&host, cases[i].uri, NULL), 0);
        assert_true(host.numeric);
        assert_int_equal(apc_hostport_resolve(&host, &to, NULL), 0);
        assert_int_equal(to.count, 1);
        assert_string_equal(apc_endpoint_format(&to.at[0], text), cases[i].text);
        assert_int_equal(apc_endpoint_port(&to.at[0]), host.port);
        assert_int_equal(apc_endpoint_is_loopback(&to.at[0]), cases[i].loopback);
    }
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

static void no_link_is_legal_to_destroy_and_nothing_can_be_asked_without(void **state)
{
    struct apc_link *link;
    const char *reply;
    int before = atomic_load(&kernel[CONNECT].calls);
    (void)state;
    apc_link_destroy(NULL);
    apc_link_reset(NULL);
    assert_false(apc_link_connected(NULL));
    assert_int_equal(apc_link_connects(NULL), 0);
    assert_string_equal(apc_link_error(NULL), "");
    assert_int_equal(apc_link_exchange(NULL, "x\n", 2, &reply, 0), APC_EINVAL);
    assert_int_equal(apc_link_create(&link, "tcp:127.0.0.1:1", NULL, NULL), 0);
    assert_int_equal(apc_link_exchange(link, NULL, 2, &reply, 0), APC_EINVAL);
    assert_int_equal(apc_link_exchange(link, "x\n", 0, &reply, 0), APC_EINVAL);
    assert_int_equal(apc_link_exchange(link, "x\n", 2, NULL, 0), APC_EINVAL);
    assert_int_equal(atomic_load(&kernel[CONNECT].calls), before);
    apc_link_destroy(link);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(one_connection_carries_many_exchanges),
        cmocka_unit_test(a_late_reply_is_never_the_next_ones),
        cmocka_unit_test(a_peer_that_closes_is_no_reply),
        cmocka_unit_test(a_peer_that_refuses_is_left_alone_for_a_pause),
        cmocka_unit_test(a_reply_beyond_frame_max_is_refused),
        cmocka_unit_test(bytes_after_the_reply_close_the_connection),
        cmocka_unit_test(what_comes_unasked_is_not_taken_for_a_reply),
        cmocka_unit_test(a_peer_that_went_away_between_two_exchanges_costs_none),
        cmocka_unit_test(reset_closes_and_the_next_exchange_connects),
        cmocka_unit_test(a_peer_that_never_reads_cannot_hold_the_sender),
        cmocka_unit_test(a_pause_follows_a_failed_connect),
        cmocka_unit_test_teardown(calls_that_a_signal_interrupts_are_repeated, mend),
        cmocka_unit_test_teardown(bytes_may_go_one_by_one, mend),
        cmocka_unit_test_teardown(what_fails_is_said_and_leaves_nothing_open, mend),
        cmocka_unit_test(who_has_his_answer_closes_in_order),
        cmocka_unit_test_teardown(a_link_has_one_descriptor_while_it_is_connected, mend),
        cmocka_unit_test_teardown(pauses_double_up_to_their_longest_and_have_the_jitter_of_the_seed, mend),
        cmocka_unit_test_teardown(links_without_a_seed_pause_for_different_times, mend),
        cmocka_unit_test_teardown(the_longest_pause_is_five_seconds_or_the_shortest, mend),
        cmocka_unit_test_teardown(every_address_of_a_name_is_tried_in_turn, mend),
        cmocka_unit_test_teardown(an_address_that_does_not_answer_is_not_the_first_next_time, mend),
        cmocka_unit_test_teardown(ipv4_comes_first_and_no_more_than_four_are_kept, mend),
        cmocka_unit_test_teardown(a_host_that_moved_is_found_again, mend),
        cmocka_unit_test_teardown(a_name_that_had_no_address_gets_one, mend),
        cmocka_unit_test_teardown(a_name_that_takes_its_time_holds_nobody_up, mend),
        cmocka_unit_test(a_restarted_server_is_found_again),
        cmocka_unit_test(a_host_may_be_a_name),
        cmocka_unit_test(a_name_without_an_address_is_an_error_of_the_exchange),
        cmocka_unit_test(an_ipv6_address_is_written_in_brackets),
        cmocka_unit_test(an_address_is_shown_as_it_is_written),
        cmocka_unit_test(a_malformed_address_is_named),
        cmocka_unit_test(options_are_checked),
        cmocka_unit_test(no_link_is_legal_to_destroy_and_nothing_can_be_asked_without),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}

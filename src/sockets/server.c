/* SPDX-License-Identifier: BSD-3-Clause */
/*
 * The answering side of a link: one thread, one poll loop, a fixed table of connections.
 *
 * Everything but the counters and the wake descriptor belongs to that thread alone, so there is no lock.
 * All memory is taken in create. A connection is in one of these states, and `since` is when it came
 * into it:
 *
 *     shaking    of tls: the handshake is not over   frame_timeout; a step a turn, so that a crowd of
 *                                                    strangers costs the others no more than a step each
 *     idle       nothing begun                       may last for ever (keepalive finds the dead), as long as
 *                                                    there is room: a new connection takes the place of the
 *                                                    one that was idle longest
 *     begun      part of a request is here           frame_timeout, however the bytes trickle
 *     ready      a whole request is here             answered on the next turn, one a turn, so that a peer
 *                                                    that pipelines cannot starve the others
 *     answering  the reply is not yet wholly sent    frame_timeout; meanwhile nothing is read
 *
 * Whoever only connects can therefore not lock the client out: it gets in, and once it was the last to be
 * answered it keeps its place however many others come.
 *
 * Who has not said a word of a handshake gives way as who is idle does, and is closed without a word in the
 * end: so a connection that only waits for that shows that this thread runs. Beyond what is taken in create
 * OpenSSL takes some ten KiB for each session.
 *
 * What a peer can make us hold is therefore one request buffer and one reply. A connection that the peer
 * has reset is closed before its requests are looked at: nobody waits for them any more, and a command
 * from a dead connection must not be applied.
 */
#include "base/base_internal.h"
#include "sockets/sockets_internal.h"

#include <errno.h>
#include <fcntl.h>
#include <netinet/in.h>
#include <poll.h>
#include <pthread.h>
#include <signal.h>
#include <stdatomic.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/eventfd.h>
#include <unistd.h>

#define FRAME_MAX         (64u << 10)
#define CONNECTIONS       16
#define FRAME_TIMEOUT     APC_NS_PER_S
#define ACCEPT_PAUSE      (100 * APC_NS_PER_MS)
#define CLOSING_LOG_EVERY (10 * APC_NS_PER_S)

struct connection {
    int fd; /* -1: free */
    uint64_t id;
    struct apc_endpoint peer; /* stays when it is closed, until its place is taken */
    char name[24];            /* of the peer, by tls; "": plain */
    char *request, *reply;    /* frame_max bytes each */
    size_t from, have;        /* request: where the first unanswered begins; where the bytes end */
    size_t line;              /* length of the whole request at from; 0: none, and from is 0 */
    size_t sent, length;      /* of the reply; equal: none pending */
    bool end;                 /* the peer sends no more */
    bool alien;               /* what stands at from is no frame */
    bool shaking;             /* hands, of tls */
    struct apc_tls *tls;      /* NULL: plain */
    apc_ns since;
};

struct apc_server {
    struct apc_server_options options; /* no zeros left */
    apc_server_fn fn;
    void *ctx;
    pthread_t thread;
    int listener, wake, port;
    bool tls;
    struct connection *connections; /* options.connections of them */
    struct pollfd *polls;           /* wake, listener, then the open connections */
    struct connection **polled;     /* which connection polls[i] is */
    char *buffers;
    uint64_t last_id;
    uint64_t served;  /* id of the connection that was answered last; 0: none */
    apc_ns accept_at; /* out of descriptors: do not accept before this; 0: accept */
    apc_ns logged_at; /* when a closing was last logged; 0: never */
    unsigned unlogged;
    atomic_uint_least64_t accepted, refused, evicted, requests, rejected;
    atomic_uint open;
};

/* ---- One connection ------------------------------------------------------------------------ */

static void count_up(atomic_uint_least64_t *counter)
{
    atomic_fetch_add_explicit(counter, 1, memory_order_relaxed);
}

static void hang_up(struct apc_server *s, struct connection *c)
{
    apc_tls_free(c->tls);
    c->tls = NULL;
    close(c->fd);
    c->fd = -1;
    s->accept_at = 0; /* there is a descriptor again */
    atomic_fetch_sub_explicit(&s->open, 1, memory_order_relaxed);
}

/* One line at most in ten seconds: a hostile peer must not fill a disk. */
static void log_closing(struct apc_server *s, const struct apc_endpoint *peer, const char *reason, apc_ns now)
{
    char text[APC_ENDPOINT_TEXT];

    if (s->logged_at && now - s->logged_at < CLOSING_LOG_EVERY) {
        s->unlogged++;
        return;
    }
    apc_log_write(s->options.log, APC_LOG_WARN,
                  "closed the connection from %s: %s (%u more since the last such line)",
                  apc_endpoint_format(peer, text), reason, s->unlogged);
    s->logged_at = now;
    s->unlogged = 0;
}

/* Close for what the peer did. */
static void reject(struct apc_server *s, struct connection *c, const char *reason, apc_ns now)
{
    count_up(&s->rejected);
    log_closing(s, &c->peer, reason, now);
    hang_up(s, c);
}

static bool answering(const struct connection *c)
{
    return c->sent < c->length;
}

/* Look for the end of the first request. Bytes before @at were searched already for a newline. */
static void find_end(struct apc_server *s, struct connection *c, size_t at)
{
    const size_t have = c->have - c->from;

    if (!s->options.whole) {
        const char *newline = memchr(c->request + at, '\n', c->have - at);
        c->line = newline ? (size_t)(newline + 1 - (c->request + c->from)) : 0;
        return;
    }
    const int length = have ? s->options.whole(c->request + c->from, have) : 0;
    c->line = length > 0 && (size_t)length <= have ? (size_t)length : 0;
    c->alien = length < 0 || (size_t)length > s->options.frame_max;
}

/* On to the next request. Bytes are moved only when no whole one is left, so once each. */
static void drop_request(struct apc_server *s, struct connection *c)
{
    c->from += c->line;
    find_end(s, c, c->from);
    if (!c->line) {
        c->have -= c->from;
        memmove(c->request, c->request + c->from, c->have);
        c->from = 0;
    }
}

static void fill_input(struct apc_server *s, struct connection *c, apc_ns now)
{
    char *at = c->request + c->have;
    const size_t room = s->options.frame_max - c->have;
    ssize_t n = c->tls ? apc_tls_recv(c->tls, at, room) : recv(c->fd, at, room, 0);

    if (n > 0) {
        if (c->have == 0)
            c->since = now;
        c->have += (size_t)n;
        find_end(s, c, c->have - (size_t)n);
        if (!c->line && c->have == s->options.frame_max)
            reject(s, c, "a frame is too long", now);
    } else if (n == 0) {
        c->end = true;
    } else if (errno != EAGAIN && errno != EINTR) {
        hang_up(s, c);
    }
}

static void flush_output(struct apc_server *s, struct connection *c, apc_ns now)
{
    const char *at = c->reply + c->sent;
    const size_t left = c->length - c->sent;
    ssize_t n = c->tls ? apc_tls_send(c->tls, at, left) : send(c->fd, at, left, MSG_NOSIGNAL);

    if (n >= 0) {
        c->sent += (size_t)n;
        if (!answering(c))
            c->since = now; /* of the request that may have begun behind this one */
    } else if (errno != EAGAIN && errno != EINTR) {
        hang_up(s, c);
    }
}

static void answer_requests(struct apc_server *s, struct connection *c, apc_ns now)
{
    int n = s->fn(s->ctx, c->id, c->request + c->from, c->line, c->reply, s->options.frame_max);

    if (n <= 0 || (size_t)n > s->options.frame_max) {
        reject(s, c, n == APC_EPERM ? "its request is refused" : "not a request that can be answered", now);
        return;
    }
    count_up(&s->requests);
    s->served = c->id;
    c->sent = 0;
    c->length = (size_t)n;
    c->since = now;
    flush_output(s, c, now);
    drop_request(s, c);
}

/* Close a connection that has nothing more to say, or took too long to say it. */
static void close_expired(struct apc_server *s, struct connection *c, apc_ns now)
{
    bool late = now - c->since >= s->options.frame_timeout;

    if (c->shaking) {
        if (late && apc_tls_heard(c->tls))
            reject(s, c, "its TLS handshake took too long", now);
        else if (late)
            hang_up(s, c);
    } else if (c->alien && !answering(c)) {
        reject(s, c, "not a frame of this link", now);
    } else if (answering(c)) {
        if (late)
            reject(s, c, "it did not take its reply in time", now);
    } else if (c->line) {
        return;
    } else if (c->have > 0) {
        if (late || c->end)
            reject(s, c, "a frame was begun and not completed", now);
    } else if (c->end) {
        hang_up(s, c);
    }
}

/* A peer that closes in the middle of it has thought better of it, or asked whether somebody is here. */
static void shake_hands(struct apc_server *s, struct connection *c, apc_ns now)
{
    struct apc_error why;
    int done = apc_tls_handshake(c->tls, &why);

    if (done > 0) {
        c->shaking = false;
        c->since = now;
        snprintf(c->name, sizeof(c->name), "%.23s", apc_tls_peer(c->tls));
    } else if (done < 0 && apc_tls_heard(c->tls)) {
        reject(s, c, why.text, now);
    } else if (done < 0) {
        hang_up(s, c);
    }
}

/* Bytes of the next request may be here already, out of the socket. */
static bool has_pending_input(const struct connection *c)
{
    return c->tls && !c->shaking && apc_tls_more(c->tls);
}

static void serve_connection(struct apc_server *s, struct connection *c, short events, apc_ns now)
{
    if (events & (POLLERR | POLLNVAL)) {
        hang_up(s, c);
        return;
    }
    if (c->shaking) {
        if (events)
            shake_hands(s, c, now);
    } else if (answering(c)) {
        if (events & (POLLOUT | POLLHUP))
            flush_output(s, c, now);
    } else {
        if (!c->line && !c->end && (events || has_pending_input(c)))
            fill_input(s, c, now);
        if (c->fd >= 0 && c->line)
            answer_requests(s, c, now);
    }
    if (c->fd >= 0)
        close_expired(s, c, now);
}

/* ---- The loop ------------------------------------------------------------------------------ */

/* A free place, or that of the connection that was idle longest, which is closed. NULL: there is none. Of
 * free ones that of the oldest connection: who the latest were can still be told. */
static struct connection *make_connection_room(struct apc_server *s, apc_ns now)
{
    struct connection *idle = NULL, *vacant = NULL;

    for (unsigned i = 0; i < s->options.connections; i++) {
        struct connection *c = &s->connections[i];

        if (c->fd < 0)
            vacant = !vacant || c->id < vacant->id ? c : vacant;
        else if (c->have == 0 && !answering(c) && !(c->shaking && apc_tls_heard(c->tls)) &&
                 c->id != s->served && (!idle || c->since < idle->since))
            idle = c;
    }
    if (vacant)
        return vacant;
    if (idle) {
        count_up(&s->evicted);
        log_closing(s, &idle->peer, "it was silent longest, and a new one needed its place", now);
        hang_up(s, idle);
    }
    return idle;
}

static void open_connection(struct apc_server *s, int fd, const struct apc_endpoint *peer, apc_ns now)
{
    struct connection *c = make_connection_room(s, now);
    struct apc_tls *tls = NULL;

    if (!c || (s->tls &&
               apc_tls_answer(&tls, s->options.identity, fd, s->options.clients, s->options.n_clients) < 0)) {
        count_up(&s->refused);
        log_closing(s, peer, "all the connections there may be are in use", now);
        close(fd);
        return;
    }
    apc_tcp_tune(fd);
    *c = (struct connection){.fd = fd,
                             .id = ++s->last_id,
                             .peer = *peer,
                             .request = c->request,
                             .reply = c->reply,
                             .shaking = s->tls,
                             .tls = tls,
                             .since = now};
    count_up(&s->accepted);
    atomic_fetch_add_explicit(&s->open, 1, memory_order_relaxed);
}

static void accept_one(struct apc_server *s, apc_ns now)
{
    struct apc_endpoint peer = {.length = sizeof peer.address};
    int fd =
        accept4(s->listener, (struct sockaddr *)&peer.address, &peer.length, SOCK_CLOEXEC | SOCK_NONBLOCK);

    if (fd >= 0)
        open_connection(s, fd, &peer, now);
    else if (errno == EMFILE || errno == ENFILE || errno == ENOBUFS || errno == ENOMEM)
        s->accept_at = now + ACCEPT_PAUSE; /* the client stays in the queue, readable: do not spin on it */
}

static short events_of(const struct connection *c)
{
    if (answering(c))
        return POLLOUT;
    if (c->line || c->end || c->alien)
        return 0;
    return c->tls ? apc_tls_events(c->tls) : POLLIN;
}

/* Fill polls[]; when the next thing happens by itself. */
static apc_ns prepare_polls(struct apc_server *s, nfds_t *n)
{
    apc_ns next = s->accept_at ? s->accept_at : INT64_MAX;

    s->polls[0] = (struct pollfd){.fd = s->wake, .events = POLLIN};
    s->polls[1] = (struct pollfd){.fd = s->accept_at ? -1 : s->listener, .events = POLLIN};
    *n = 2;
    for (unsigned i = 0; i < s->options.connections; i++) {
        struct connection *c = &s->connections[i];
        apc_ns at = INT64_MAX;
        if (c->fd < 0)
            continue;
        s->polls[*n] = (struct pollfd){.fd = c->fd, .events = events_of(c)};
        s->polled[(*n)++] = c;
        if (!answering(c) && (c->line || c->end || c->alien || has_pending_input(c)))
            at = 0;
        else if (c->shaking || answering(c) || c->have > 0)
            at = c->since + s->options.frame_timeout;
        if (at < next)
            next = at;
    }
    return next;
}

static void wait_for_events(struct apc_server *s, nfds_t n, apc_ns until)
{
    struct timespec t = {0};
    apc_ns left = until == INT64_MAX ? 0 : until - apc_clock_mono(NULL);

    if (left > 0)
        t = (struct timespec){left / APC_NS_PER_S, left % APC_NS_PER_S};
    (void)ppoll(s->polls, n, until == INT64_MAX ? NULL : &t, NULL); /* if it fails, nothing happened */
}

static void *run_server(void *arg)
{
    struct apc_server *s = arg;

    for (;;) {
        nfds_t n;
        apc_ns now, until = prepare_polls(s, &n);
        wait_for_events(s, n, until);
        if (s->polls[0].revents)
            return NULL;
        now = apc_clock_mono(NULL);
        if (s->accept_at && now >= s->accept_at)
            s->accept_at = 0;
        for (nfds_t i = 2; i < n; i++)
            serve_connection(s, s->polled[i], s->polls[i].revents, now);
        if (s->polls[1].revents)
            accept_one(s, now);
    }
}

/* ---- Set-up -------------------------------------------------------------------------------- */

static int take_server_options(struct apc_server_options *o, const struct apc_server_options *options,
                               struct apc_error *why)
{
    int err = apc_options_copy(o, sizeof *o, options, "apc_server_options", why);
    if (err < 0)
        return err;
    if (!o->frame_max)
        o->frame_max = FRAME_MAX;
    if (!o->connections)
        o->connections = CONNECTIONS;
    if (!o->frame_timeout)
        o->frame_timeout = FRAME_TIMEOUT;
    if (o->frame_max > APC_FRAME_MAX)
        return apc_fail(why, APC_EINVAL, "frame_max is %zu: a frame has at most %u bytes", o->frame_max,
                        APC_FRAME_MAX);
    if (o->frame_timeout < 0)
        return apc_fail(why, APC_EINVAL, "frame_timeout must be positive");
    return 0;
}

static int bind_and_listen(struct apc_server *s, const char *uri, const struct apc_endpoint *at,
                           struct apc_error *why)
{
    char text[APC_ENDPOINT_TEXT];
    struct apc_endpoint bound = {.length = sizeof bound.address};

    if (!s->tls && !apc_endpoint_is_loopback(at) && !s->options.allow_plaintext)
        return apc_fail(
            why, APC_EPERM,
            "link \"%s\": %s is not a loopback address, and tcp: would take commands over the network in "
            "plain text from anyone; listen by tls:, or on 127.0.0.1, or allow it by name (allow_plaintext)",
            uri, apc_endpoint_format(at, text));
    s->listener = apc_tcp_bind(at);
    if (s->listener < 0 || listen(s->listener, SOMAXCONN) < 0 ||
        fcntl(s->listener, F_SETFL, O_NONBLOCK) < 0 ||
        getsockname(s->listener, (struct sockaddr *)&bound.address, &bound.length) < 0) {
        int number = errno;
        return apc_fail(why, APC_ESYS, "link \"%s\": cannot listen on %s: %s%s", uri,
                        apc_endpoint_format(at, text), strerrordesc_np(number),
                        number == EADDRINUSE ? "; stop the program that has this port, or choose another"
                                             : "");
    }
    s->port = apc_endpoint_port(&bound);
    return 0;
}

static int start_listening(struct apc_server *s, const char *uri, struct apc_error *why)
{
    struct apc_hostport host;
    struct apc_endpoints at;
    struct apc_error reason;
    int err;

    s->tls = !strncmp(uri, "tls:", 4);
    if (!s->tls && strncmp(uri, "tcp:", 4) != 0)
        return apc_fail(why, APC_EINVAL,
                        "link \"%s\": unknown scheme; expected tcp:HOST:PORT or tls:HOST:PORT", uri);
    if (s->tls && (!s->options.identity || !s->options.n_clients))
        return apc_fail(
            why, APC_EINVAL,
            "link \"%s\": tls: needs an identity of its own (`apc cert` makes one), and the names of "
            "the clients that may connect",
            uri);
    err = apc_hostport_parse(&host, uri, why);
    if (err < 0)
        return err;
    if (apc_hostport_resolve(&host, &at, &reason) < 0)
        return apc_fail(why, APC_EINVAL, "link \"%s\": %s", uri, reason.text);
    return bind_and_listen(s, uri, &at.at[0], why);
}

static int allocate_server(struct apc_server *s)
{
    size_t n = s->options.connections, each = s->options.frame_max;

    s->connections = calloc(n, sizeof *s->connections);
    s->polls = calloc(n + 2, sizeof *s->polls);
    s->polled = calloc(n + 2, sizeof(struct connection *));
    s->buffers = calloc(n, 2 * each); /* pages that no connection needs are never touched */
    if (!s->connections || !s->polls || !s->polled || !s->buffers)
        return APC_ENOMEM;
    for (size_t i = 0; i < n; i++)
        s->connections[i] = (struct connection){
            .fd = -1, .request = s->buffers + 2 * i * each, .reply = s->buffers + (2 * i + 1) * each};
    return 0;
}

static int start_server_thread(struct apc_server *s)
{
    sigset_t all, old;
    int number;

    sigfillset(&all); /* signals are the program's own threads' business */
    pthread_sigmask(SIG_SETMASK, &all, &old);
    number = pthread_create(&s->thread, NULL, run_server, s);
    pthread_sigmask(SIG_SETMASK, &old, NULL);
    return number;
}

/* All but the thread. */
static void release_server(struct apc_server *s)
{
    for (unsigned i = 0; s->connections && i < s->options.connections; i++)
        if (s->connections[i].fd >= 0)
            hang_up(s, &s->connections[i]);
    if (s->listener >= 0)
        close(s->listener);
    if (s->wake >= 0)
        close(s->wake);
    free(s->buffers);
    free(s->polled);
    free(s->polls);
    free(s->connections);
    free(s);
}

int apc_server_create(struct apc_server **server, const char *uri, const struct apc_server_options *options,
                      apc_server_fn fn, void *ctx, struct apc_error *why)
{
    struct apc_server_options o = {0};
    struct apc_server *s;
    int err, number;

    if (!server || !uri || !fn)
        return apc_fail(why, APC_EINVAL,
                        "a server needs a place to go, an address and a function that answers");
    *server = NULL;
    err = take_server_options(&o, options, why);
    if (err < 0)
        return err;
    s = calloc(1, sizeof *s);
    if (!s)
        return apc_fail(why, APC_ENOMEM, "link \"%s\": no memory", uri);
    s->options = o;
    s->fn = fn;
    s->ctx = ctx;
    s->listener = -1;
    s->wake = -1;
    err = start_listening(s, uri, why);
    if (err < 0)
        goto fail;
    err = allocate_server(s);
    if (err < 0) {
        apc_fail(why, err, "link \"%s\": no memory for %u connections", uri, o.connections);
        goto fail;
    }
    s->wake = eventfd(0, EFD_CLOEXEC);
    number = s->wake < 0 ? errno : start_server_thread(s);
    if (number) {
        err =
            apc_fail(why, APC_ESYS, "link \"%s\": cannot start its thread: %s", uri, strerrordesc_np(number));
        goto fail;
    }
    *server = s;
    return 0;
fail:
    release_server(s);
    return err;
}

void apc_server_destroy(struct apc_server *s)
{
    if (!s)
        return;
    (void)eventfd_write(s->wake, 1);
    pthread_join(s->thread, NULL);
    release_server(s);
}

char *apc_server_peer(const struct apc_server *server, uint64_t connection, char text[APC_PEER_LEN])
{
    for (unsigned i = 0; i < server->options.connections; i++) {
        const struct connection *c = &server->connections[i];
        char at[APC_ENDPOINT_TEXT];
        if (!connection || c->id != connection)
            continue;
        apc_endpoint_format(&c->peer, at);
        if (*c->name)
            snprintf(text, APC_PEER_LEN, "%.53s (%.23s)", at, c->name);
        else
            snprintf(text, APC_PEER_LEN, "%s", at);
        return text;
    }
    snprintf(text, APC_PEER_LEN, "one whose address is forgotten");
    return text;
}

int apc_server_port(const struct apc_server *s)
{
    return s ? s->port : APC_EINVAL;
}

void apc_server_stats(const struct apc_server *s, struct apc_server_stats *stats)
{
    struct apc_server_stats all = {.size = 0};

    if (s) {
        all.accepted = atomic_load_explicit(&s->accepted, memory_order_relaxed);
        all.refused = atomic_load_explicit(&s->refused, memory_order_relaxed);
        all.evicted = atomic_load_explicit(&s->evicted, memory_order_relaxed);
        all.requests = atomic_load_explicit(&s->requests, memory_order_relaxed);
        all.rejected = atomic_load_explicit(&s->rejected, memory_order_relaxed);
        all.open = atomic_load_explicit(&s->open, memory_order_relaxed);
    }
    apc_result_copy(stats, &all, sizeof(all));
}

/* SPDX-License-Identifier: BSD-3-Clause */
/*
 * TCP with deadlines, and the `tcp:` transport of a link; that of `tls:` (tls_link.c) is the same with a session
 * on top.
 *
 * Sockets of a link are non-blocking: a send goes out at once in nearly every case, so it is tried
 * before it is waited for; a reply is never there yet, so it is waited for before it is read.
 *
 * A link is closed in order, by FIN, unless the kernel still holds something of what was sent: that is thrown
 * away, which resets the connection. A command that went into a dead network must not reach the plant when
 * the network comes back.
 */
#include "sockets/sockets_internal.h"

#include <errno.h>
#include <linux/sockios.h>
#include <netinet/in.h>
#include <netinet/tcp.h>
#include <poll.h>
#include <stdlib.h>
#include <string.h>
#include <sys/ioctl.h>
#include <unistd.h>

int apc_tcp_wait(int fd, short events, apc_ns deadline)
{
    for (;;) {
        struct pollfd p = {.fd = fd, .events = events};
        apc_ns left = deadline - apc_clock_mono(NULL);
        struct timespec t = {0};
        int n;
        if (left > 0)
            t = (struct timespec){left / APC_NS_PER_S, left % APC_NS_PER_S};
        n = ppoll(&p, 1, &t, NULL);
        if (n > 0)
            return 0;
        if (n == 0)
            return APC_ETIMEDOUT;
        if (errno != EINTR)
            return APC_ESYS;
    }
}

int apc_tcp_connect(int fd, const struct apc_endpoint *to, apc_ns deadline)
{
    socklen_t length = sizeof(int);
    int err, number = 0;

    if (connect(fd, (const struct sockaddr *)&to->address, to->length) == 0)
        return 0;
    if (errno != EINPROGRESS && errno != EINTR) /* either way it goes on in the background */
        return APC_ECONN;
    err = apc_tcp_wait(fd, POLLOUT, deadline);
    if (err < 0)
        return err == APC_ETIMEDOUT ? err : APC_ECONN;
    if (getsockopt(fd, SOL_SOCKET, SO_ERROR, &number, &length) < 0)
        return APC_ECONN;
    errno = number;
    return number ? APC_ECONN : 0;
}

static void set_socket_option(int fd, int level, int option, int value)
{
    (void)setsockopt(fd, level, option, &value, sizeof value); /* comfort: nothing depends on it */
}

void apc_tcp_tune(int fd)
{
    set_socket_option(fd, IPPROTO_TCP, TCP_NODELAY, 1);
    set_socket_option(fd, SOL_SOCKET, SO_KEEPALIVE, 1);
    set_socket_option(fd, IPPROTO_TCP, TCP_KEEPIDLE, 5);
    set_socket_option(fd, IPPROTO_TCP, TCP_KEEPINTVL, 5);
    set_socket_option(fd, IPPROTO_TCP, TCP_KEEPCNT, 3);
    set_socket_option(fd, IPPROTO_TCP, TCP_USER_TIMEOUT, 15000);
}

int apc_tcp_bind(const struct apc_endpoint *at)
{
    int number, fd = socket(at->address.ss_family, SOCK_STREAM | SOCK_CLOEXEC, 0);

    if (fd < 0)
        return APC_ESYS;
    set_socket_option(fd, SOL_SOCKET, SO_REUSEADDR,
                      1); /* a server restarts while its old connections are in TIME_WAIT */
    if (bind(fd, (const struct sockaddr *)&at->address, at->length) == 0)
        return fd;
    number = errno;
    close(fd);
    errno = number;
    return APC_ESYS;
}

/* ---- The transport ------------------------------------------------------------------------- */

int apc_tcp_open(struct apc_tcp *t, const char *uri, struct apc_hostport *host, struct apc_error *why)
{
    int err = apc_hostport_parse(host, uri, why);

    *t = (struct apc_tcp){.fd = -1};
    if (err < 0)
        return err;
    if (host->port == 0)
        return apc_fail(why, APC_EINVAL, "link \"%s\": port must be 1..65535", uri);
    return apc_resolver_create(&t->resolver, host, why);
}

void apc_tcp_release(struct apc_tcp *t)
{
    apc_tcp_hang_up(t);
    apc_resolver_destroy(t->resolver);
}

static int tcp_create(void **self, const char *uri, struct apc_identity *identity, struct apc_error *why)
{
    struct apc_hostport host;
    struct apc_tcp *t = calloc(1, sizeof *t);
    int err = t ? apc_tcp_open(t, uri, &host, why) : apc_fail(why, APC_ENOMEM, "link \"%s\": no memory", uri);

    (void)identity;
    if (err < 0)
        free(t);
    *self = err < 0 ? NULL : t;
    return err;
}

void apc_tcp_hang_up(void *self)
{
    const struct linger at_once = {.l_onoff = 1, .l_linger = 0};
    struct apc_tcp *t = self;
    char rest[512];
    int held = 0;

    if (t->fd < 0)
        return;
    if (ioctl(t->fd, SIOCOUTQ, &held) < 0 || held > 0)
        (void)setsockopt(t->fd, SOL_SOCKET, SO_LINGER, &at_once, sizeof at_once);
    else /* what has come and is not read would reset it as well */
        for (int i = 0; i < 8 && recv(t->fd, rest, sizeof rest, MSG_DONTWAIT) > 0; i++)
            ;
    close(t->fd);
    t->fd = -1;
}

static void tcp_destroy(void *self)
{
    apc_tcp_release(self);
    free(self);
}

static int connect_one(struct apc_tcp *t, const struct apc_endpoint *to, apc_ns deadline,
                       struct apc_error *why)
{
    char text[APC_ENDPOINT_TEXT];
    int err;

    t->fd = socket(to->address.ss_family, SOCK_STREAM | SOCK_CLOEXEC | SOCK_NONBLOCK, 0);
    if (t->fd < 0)
        return apc_fail(why, APC_ECONN, "cannot make a socket: %s", strerrordesc_np(errno));
    apc_tcp_tune(t->fd);
    err = apc_tcp_connect(t->fd, to, deadline);
    if (err == APC_ETIMEDOUT)
        apc_fail(why, err, "connecting to %s: no answer in time", apc_endpoint_format(to, text));
    else if (err < 0)
        apc_fail(why, err, "connecting to %s: %s", apc_endpoint_format(to, text), strerrordesc_np(errno));
    if (err < 0)
        apc_tcp_hang_up(t);
    return err;
}

/* All addresses in turn; one that eats the whole deadline is not the first to be tried next time. */
int apc_tcp_link_connect(void *self, apc_ns deadline, struct apc_error *why)
{
    struct apc_tcp *t = self;
    struct apc_endpoints to;
    int err = apc_resolver_get(t->resolver, &to, deadline, why);

    for (size_t i = 0; err == 0 && i < to.count; i++) {
        err = connect_one(t, &to.at[t->next % to.count], deadline, why);
        if (err == 0)
            return 0;
        t->next = (t->next + 1) % to.count;
        if (err == APC_ECONN && i + 1 < to.count)
            err = 0;
    }
    apc_resolver_refresh(t->resolver);
    return err;
}

bool apc_tcp_quiet(void *self)
{
    const struct apc_tcp *t = self;
    char byte;
    if (t->tls && apc_tls_more(t->tls))
        return false;
    return recv(t->fd, &byte, 1, MSG_PEEK | MSG_DONTWAIT) < 0 && (errno == EAGAIN || errno == EINTR);
}

static int broken(const struct apc_tcp *t, struct apc_error *why, const char *doing)
{
    return apc_fail(why, APC_ECONN, "%s: %s", doing,
                    t->tls && errno == EPROTO ? apc_tls_error(t->tls) : strerrordesc_np(errno));
}

int apc_tcp_send(void *self, const char *data, size_t length, apc_ns deadline, struct apc_error *why)
{
    const struct apc_tcp *t = self;

    while (length > 0) {
        ssize_t n = t->tls ? apc_tls_send(t->tls, data, length) : send(t->fd, data, length, MSG_NOSIGNAL);
        if (n >= 0) {
            data += n;
            length -= (size_t)n;
        } else if (errno == EAGAIN) {
            int err = apc_tcp_wait(t->fd, t->tls ? apc_tls_events(t->tls) : POLLOUT, deadline);
            if (err == APC_ETIMEDOUT)
                return apc_fail(why, err, "sending: the peer took nothing in time");
            if (err < 0)
                return broken(t, why, "sending");
        } else if (errno != EINTR) {
            return broken(t, why, "sending");
        }
    }
    return 0;
}

int apc_tcp_receive(void *self, char *data, size_t size, apc_ns deadline, struct apc_error *why)
{
    const struct apc_tcp *t = self;

    for (;;) {
        ssize_t n;
        int err = t->tls && apc_tls_more(t->tls)
                      ? 0
                      : apc_tcp_wait(t->fd, t->tls ? apc_tls_events(t->tls) : POLLIN, deadline);
        if (err == APC_ETIMEDOUT)
            return apc_fail(why, err, "no whole reply in time");
        if (err < 0)
            return broken(t, why, "waiting for the reply");
        n = t->tls ? apc_tls_recv(t->tls, data, size) : recv(t->fd, data, size, 0);
        if (n > 0)
            return (int)n;
        if (n == 0)
            return apc_fail(why, APC_ECONN, "the peer closed the connection");
        if (errno != EAGAIN && errno != EINTR)
            return broken(t, why, "receiving");
    }
}

const struct apc_transport apc_transport_tcp = {
    .scheme = "tcp:",
    .create = tcp_create,
    .destroy = tcp_destroy,
    .connect = apc_tcp_link_connect,
    .close = apc_tcp_hang_up,
    .quiet = apc_tcp_quiet,
    .send = apc_tcp_send,
    .receive = apc_tcp_receive,
};

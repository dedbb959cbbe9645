/* SPDX-License-Identifier: BSD-3-Clause */
/* What the files of src/sockets share. Never installed. */
#ifndef APC_SOCKETS_INTERNAL_H
#define APC_SOCKETS_INTERNAL_H

#include "apcsockets.h"

#include <sys/socket.h>
#include <sys/types.h>

/* ---- address.c: where a link leads --------------------------------------------------------- */

#define APC_ADDRESS_MAX 4 /* addresses of one name that are kept */

struct apc_endpoint {
    struct sockaddr_storage address;
    socklen_t length;
};

struct apc_endpoints {
    size_t count;
    struct apc_endpoint at[APC_ADDRESS_MAX];
};

/** HOST:PORT, [IPV6]:PORT, taken apart. */
struct apc_hostport {
    char host[256];
    int port;
    bool numeric; /* the host is an address: no resolver is ever asked */
};

#define APC_ENDPOINT_TEXT APC_PEER_LEN
/** "127.0.0.1:43051", "[::1]:43051". Returns @p text. [tick] */
char *apc_endpoint_format(const struct apc_endpoint *endpoint, char text[APC_ENDPOINT_TEXT]);
int apc_endpoint_port(const struct apc_endpoint *endpoint);
bool apc_endpoint_is_loopback(const struct apc_endpoint *endpoint);
/** Read what follows `tcp:` in @p uri; @p uri is for the error's text. [setup] Returns 0 or APC_EINVAL. */
int apc_hostport_parse(struct apc_hostport *out, const char *uri, struct apc_error *why);
/**
 * The addresses of a host, IPv4 before IPv6, so that both ends of a link agree on what `localhost` is.
 * Does not wait for anything when the host is numeric. [setup] Returns 0 or APC_ECONN.
 */
int apc_hostport_resolve(const struct apc_hostport *host, struct apc_endpoints *out, struct apc_error *why);

/**
 * Addresses of a host for a caller that must not wait beyond its deadline, although getaddrinfo() knows
 * no deadline. A numeric host is resolved in create; a name by a thread of the resolver's own.
 */
struct apc_resolver;
int apc_resolver_create(struct apc_resolver **resolver, const struct apc_hostport *host,
                        struct apc_error *why);
/** Waits for a query that is under way. NULL is legal. [setup] */
void apc_resolver_destroy(struct apc_resolver *resolver);
/** The newest addresses; waits until the deadline when there are none yet. [tick] 0, APC_ECONN,
 * APC_ETIMEDOUT. */
int apc_resolver_get(struct apc_resolver *resolver, struct apc_endpoints *out, apc_ns deadline,
                     struct apc_error *why);
/** Nobody answers at these addresses: ask again, in the background. Until then the old ones stay. [tick] */
void apc_resolver_refresh(struct apc_resolver *resolver);

/* ---- tcp.c: sockets with deadlines --------------------------------------------------------- */

/** Wait for poll(2) @p events. Returns 0, APC_ETIMEDOUT, or APC_ESYS with errno. [tick] */
int apc_tcp_wait(int fd, short events, apc_ns deadline);
/** Connect a non-blocking socket. Returns 0, APC_ECONN with errno, APC_ETIMEDOUT. [tick] */
int apc_tcp_connect(int fd, const struct apc_endpoint *to, apc_ns deadline);
/** A bound socket, close-on-exec, SO_REUSEADDR. Returns the fd, or APC_ESYS with errno. [setup] */
int apc_tcp_bind(const struct apc_endpoint *at);
/** Small frames go at once; a peer that vanished is noticed although nothing is sent. [any] */
void apc_tcp_tune(int fd);

/** The asking side of a connection, of tcp: and of tls:, whose transports begin with it. */
struct apc_tcp {
    int fd;      /* -1: not connected */
    size_t next; /* of the addresses: where the next connect begins */
    struct apc_resolver *resolver;
    struct apc_tls *tls; /* NULL: plain */
};

int apc_tcp_open(struct apc_tcp *tcp, const char *uri, struct apc_hostport *host, struct apc_error *why);
void apc_tcp_release(struct apc_tcp *tcp);
/* Of a transport, whose self is, or begins with, a struct apc_tcp. */
int apc_tcp_link_connect(void *self, apc_ns deadline, struct apc_error *why);
void apc_tcp_hang_up(void *self);
bool apc_tcp_quiet(void *self);
int apc_tcp_send(void *self, const char *data, size_t length, apc_ns deadline, struct apc_error *why);
int apc_tcp_receive(void *self, char *data, size_t size, apc_ns deadline, struct apc_error *why);

/* ---- tls.c: a session over a connected, non-blocking socket --------------------------------- */

struct apc_tls;

/** The side that asks, of a server that must be @p host. [any] 0, APC_ENOMEM. */
int apc_tls_ask(struct apc_tls **tls, struct apc_identity *identity, int fd, const struct apc_hostport *host);
/** The side that answers, to peers of these names only; borrowed. [any] 0, APC_ENOMEM. */
int apc_tls_answer(struct apc_tls **tls, struct apc_identity *identity, int fd, const char *const *clients,
                   size_t n);
void apc_tls_free(struct apc_tls *tls); /**< NULL is legal; the socket stays. */
/** A step of the handshake. Returns 1: done, 0: to be called again after apc_tls_events(), or APC_EPROTO with
 * its text in @p why. The side that asks is done when the other one has accepted it. */
int apc_tls_handshake(struct apc_tls *tls, struct apc_error *why);
/** As recv(2) and send(2); errno is EAGAIN, or EPROTO with its text in apc_tls_error(). [tick] */
ssize_t apc_tls_recv(struct apc_tls *tls, char *data, size_t size);
ssize_t apc_tls_send(struct apc_tls *tls, const char *data, size_t size);
/** Which of poll(2)'s events the last call waits for, which said EAGAIN. [tick] */
short apc_tls_events(const struct apc_tls *tls);
/** There may be more to receive without an event of the socket. [tick] */
bool apc_tls_more(const struct apc_tls *tls);
/** Has the peer sent anything at all? [tick] */
bool apc_tls_heard(const struct apc_tls *tls);
const char *apc_tls_error(const struct apc_tls *tls);
/** The name of the peer's certificate. [tick] */
const char *apc_tls_peer(const struct apc_tls *tls);

/* ---- The transports of a link -------------------------------------------------------------- */

/**
 * How link.c reaches the other side. A transport moves bytes; deadlines of calls, framing, pauses and
 * stale connections are link.c's. A new scheme is a new table in link.c's list.
 */
struct apc_transport {
    const char *scheme; /* with its colon */
    int (*create)(void **self, const char *uri, struct apc_identity *identity, struct apc_error *why);
    void (*destroy)(void *self);
    int (*connect)(void *self, apc_ns deadline, struct apc_error *why); /* 0, APC_ECONN, APC_ETIMEDOUT */
    void (*close)(void *self);                                          /* forget what is still unsent */
    bool (*quiet)(void *self); /* connected still, and nothing came in */
    int (*send)(void *self, const char *data, size_t length, apc_ns deadline,
                struct apc_error *why);                                                          /* 0: all */
    int (*receive)(void *self, char *data, size_t size, apc_ns deadline, struct apc_error *why); /* bytes */
};

extern const struct apc_transport apc_transport_tcp, apc_transport_tls;

#endif

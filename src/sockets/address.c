/* SPDX-License-Identifier: BSD-3-Clause */
/*
 * Where a link leads: HOST:PORT taken apart and resolved.
 *
 * getaddrinfo() can block for half a minute and takes no deadline, and a link lives inside a task that
 * must not wait. Two cases:
 *
 *   - the host is an address: AI_NUMERICHOST, done in create, never again, no thread;
 *   - the host is a name: the resolver owns a thread, which asks once at the start and once more
 *     whenever the link could not connect (the host may have moved). It publishes under the mutex, which
 *     is held for a copy only. The link takes the newest addresses known, and waits for them, within
 *     its own deadline, only as long as there never were any.
 *
 * `wanted` is set by the link and cleared by the thread after a query; `stop` ends the thread. A query
 * cannot be interrupted, so destroy waits for one that is under way.
 */
#include "sockets/sockets_internal.h"

#include <arpa/inet.h>
#include <errno.h>
#include <netdb.h>
#include <netinet/in.h>
#include <pthread.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

char *apc_endpoint_format(const struct apc_endpoint *endpoint, char text[APC_ENDPOINT_TEXT])
{
    char host[INET6_ADDRSTRLEN] = "?";

    if (endpoint->address.ss_family == AF_INET) {
        struct sockaddr_in in;
        memcpy(&in, &endpoint->address, sizeof in);
        inet_ntop(AF_INET, &in.sin_addr, host, sizeof host);
        snprintf(text, APC_ENDPOINT_TEXT, "%s:%d", host, ntohs(in.sin_port));
    } else {
        struct sockaddr_in6 in6;
        memcpy(&in6, &endpoint->address, sizeof in6);
        inet_ntop(AF_INET6, &in6.sin6_addr, host, sizeof host);
        snprintf(text, APC_ENDPOINT_TEXT, "[%s]:%d", host, ntohs(in6.sin6_port));
    }
    return text;
}

int apc_endpoint_port(const struct apc_endpoint *endpoint)
{
    /* sin_port and sin6_port are the same bytes: RFC 3493, 3.3 */
    struct sockaddr_in in;
    memcpy(&in, &endpoint->address, sizeof in);
    return ntohs(in.sin_port);
}

bool apc_endpoint_is_loopback(const struct apc_endpoint *endpoint)
{
    if (endpoint->address.ss_family == AF_INET) {
        struct sockaddr_in in;
        memcpy(&in, &endpoint->address, sizeof in);
        return ntohl(in.sin_addr.s_addr) >> 24 == IN_LOOPBACKNET;
    }
    if (endpoint->address.ss_family == AF_INET6) {
        struct sockaddr_in6 in6;
        memcpy(&in6, &endpoint->address, sizeof in6);
        return IN6_IS_ADDR_LOOPBACK(&in6.sin6_addr);
    }
    return false;
}

static bool is_numeric(const char *host)
{
    struct in6_addr any;
    return inet_pton(AF_INET, host, &any) == 1 || inet_pton(AF_INET6, host, &any) == 1;
}

static bool is_hostname(const char *host, size_t length)
{
    const char *allowed = "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789-._";
    return length > 0 && strspn(host, allowed) == length;
}

/* 0..65535 in at most five digits, or -1. */
static int parse_port(const char *text)
{
    int port = 0;
    size_t digits = strspn(text, "0123456789");

    if (digits < 1 || digits > 5 || text[digits])
        return -1;
    for (; *text; text++)
        port = port * 10 + (*text - '0');
    return port <= UINT16_MAX ? port : -1;
}

int apc_hostport_parse(struct apc_hostport *out, const char *uri, struct apc_error *why)
{
    const int scheme = (int)strcspn(uri, ":");
    const char *host = uri + scheme + 1; /* there is a scheme: it chose the transport */
    const char *colon = strrchr(host, ':');
    bool bracket = host[0] == '[';
    size_t length;

    if (!colon)
        return apc_fail(why, APC_EINVAL, "link \"%s\": expected %.*s:HOST:PORT, such as %.*s:127.0.0.1:%d",
                        uri, scheme, uri, scheme, uri, APC_PORT);
    length = (size_t)(colon - host);
    if (bracket) {
        if (length < 3 || host[length - 1] != ']')
            return apc_fail(why, APC_EINVAL, "link \"%s\": expected %.*s:[IPV6]:PORT, such as %.*s:[::1]:%d",
                            uri, scheme, uri, scheme, uri, APC_PORT);
        host++;
        length -= 2;
    }
    if (length >= sizeof out->host)
        return apc_fail(why, APC_EINVAL, "link \"%s\": the host is longer than %zu bytes", uri,
                        sizeof out->host - 1);
    memcpy(out->host, host, length);
    out->host[length] = '\0';
    out->numeric = is_numeric(out->host);
    if (bracket != (strchr(out->host, ':') != NULL) || (bracket && !out->numeric))
        return apc_fail(why, APC_EINVAL,
                        "link \"%s\": an IPv6 address, and only that, is written in brackets", uri);
    if (!bracket && !is_hostname(out->host, length))
        return apc_fail(why, APC_EINVAL, "link \"%s\": \"%s\" is neither an address nor a host name", uri,
                        out->host);
    out->port = parse_port(colon + 1);
    if (out->port < 0)
        return apc_fail(why, APC_EINVAL, "link \"%s\": port must be 1..65535", uri);
    return 0;
}

static void collect_endpoints(struct apc_endpoints *out, const struct addrinfo *list, int family)
{
    for (const struct addrinfo *a = list; a && out->count < APC_ADDRESS_MAX; a = a->ai_next)
        if (a->ai_family == family && a->ai_addrlen <= sizeof out->at->address) {
            struct apc_endpoint *e = &out->at[out->count++];
            memset(e, 0, sizeof *e);
            memcpy(&e->address, a->ai_addr, a->ai_addrlen);
            e->length = a->ai_addrlen;
        }
}

int apc_hostport_resolve(const struct apc_hostport *host, struct apc_endpoints *out, struct apc_error *why)
{
    struct addrinfo hints = {.ai_family = AF_UNSPEC, .ai_socktype = SOCK_STREAM, .ai_flags = AI_NUMERICSERV};
    struct addrinfo *list = NULL;
    char port[8];
    int err;

    out->count = 0;
    if (host->numeric)
        hints.ai_flags |= AI_NUMERICHOST;
    snprintf(port, sizeof port, "%d", host->port);
    err = getaddrinfo(host->host, port, &hints, &list);
    if (err != 0)
        return apc_fail(why, APC_ECONN, "cannot resolve host name \"%s\": %s", host->host, gai_strerror(err));
    collect_endpoints(out, list, AF_INET);
    collect_endpoints(out, list, AF_INET6);
    freeaddrinfo(list);
    if (out->count == 0)
        return apc_fail(why, APC_ECONN, "host name \"%s\" has no address", host->host);
    return 0;
}

/* ---- The resolver -------------------------------------------------------------------------- */

struct apc_resolver {
    struct apc_hostport host;
    pthread_t thread; /* only when the host is a name */
    pthread_mutex_t mutex;
    pthread_cond_t changed;
    bool wanted, stop;
    struct apc_endpoints known; /* count 0: none yet */
    struct apc_error why;       /* of the last query, when it failed */
};

static void *resolve_in_thread(void *arg)
{
    struct apc_resolver *r = arg;

    pthread_mutex_lock(&r->mutex);
    while (!r->stop) {
        struct apc_endpoints found;
        struct apc_error why;
        int err;
        if (!r->wanted) {
            pthread_cond_wait(&r->changed, &r->mutex);
            continue;
        }
        pthread_mutex_unlock(&r->mutex);
        err = apc_hostport_resolve(&r->host, &found, &why);
        pthread_mutex_lock(&r->mutex);
        if (err == 0)
            r->known = found;
        else
            r->why = why;
        r->wanted = false;
        pthread_cond_broadcast(&r->changed);
    }
    pthread_mutex_unlock(&r->mutex);
    return NULL;
}

static int start_resolver(struct apc_resolver *r)
{
    sigset_t all, old;
    int err;
    sigfillset(&all); /* signals are the program's own threads' business */
    pthread_sigmask(SIG_SETMASK, &all, &old);
    err = pthread_create(&r->thread, NULL, resolve_in_thread, r);
    pthread_sigmask(SIG_SETMASK, &old, NULL);
    return err;
}

int apc_resolver_create(struct apc_resolver **resolver, const struct apc_hostport *host,
                        struct apc_error *why)
{
    struct apc_resolver *r = calloc(1, sizeof *r);
    int err;

    *resolver = NULL;
    if (!r)
        return apc_fail(why, APC_ENOMEM, "no memory for the link's address");
    r->host = *host;
    pthread_cond_init(&r->changed, NULL);
    if (apc_mutex_init(&r->mutex) < 0) { /* the link may run at real-time priority, the thread need not */
        pthread_cond_destroy(&r->changed);
        free(r);
        return apc_fail(why, APC_ESYS, "cannot make a mutex for the link's address");
    }
    if (host->numeric) {
        err = apc_hostport_resolve(host, &r->known, why);
    } else {
        r->wanted = true;
        err = start_resolver(r);
        if (err)
            err = apc_fail(why, APC_ESYS, "cannot start a thread to resolve \"%s\": %s", host->host,
                           strerrordesc_np(err));
    }
    if (err < 0) {
        r->host.numeric = true; /* there is no thread to join */
        apc_resolver_destroy(r);
        return err;
    }
    *resolver = r;
    return 0;
}

void apc_resolver_destroy(struct apc_resolver *r)
{
    if (!r)
        return;
    if (!r->host.numeric) {
        pthread_mutex_lock(&r->mutex);
        r->stop = true;
        pthread_cond_broadcast(&r->changed);
        pthread_mutex_unlock(&r->mutex);
        pthread_join(r->thread, NULL);
    }
    pthread_cond_destroy(&r->changed);
    pthread_mutex_destroy(&r->mutex);
    free(r);
}

int apc_resolver_get(struct apc_resolver *r, struct apc_endpoints *out, apc_ns deadline,
                     struct apc_error *why)
{
    struct timespec until = {deadline / APC_NS_PER_S, deadline % APC_NS_PER_S};
    int timeout = 0, err = 0;

    pthread_mutex_lock(&r->mutex);
    while (r->known.count == 0 && r->wanted && !timeout)
        timeout = pthread_cond_clockwait(&r->changed, &r->mutex, CLOCK_MONOTONIC, &until);
    if (r->known.count > 0)
        *out = r->known;
    else if (timeout)
        err = apc_fail(why, APC_ETIMEDOUT, "host name \"%s\" is not resolved yet", r->host.host);
    else
        err = apc_fail(why, APC_ECONN, "%s", r->why.text);
    pthread_mutex_unlock(&r->mutex);
    return err;
}

void apc_resolver_refresh(struct apc_resolver *r)
{
    if (r->host.numeric)
        return;
    pthread_mutex_lock(&r->mutex);
    r->wanted = true;
    pthread_cond_broadcast(&r->changed);
    pthread_mutex_unlock(&r->mutex);
}

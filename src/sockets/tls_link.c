/* SPDX-License-Identifier: BSD-3-Clause */
/*
 * The `tls:` transport of a link: that of `tcp:` with a session on top.
 *
 * A handshake takes memory, some public keys and two round trips, and a link lives inside a task that must
 * take none of it. So a thread of the link's own connects, within PATIENCE, and who exchanges waits for it
 * until its own deadline; a connection that comes later is there for the next exchange. Nothing is sent on it
 * before, so nothing old can ever arrive.
 *
 * `step` says whose turn it is. While it is WANTED all but the mutex, the condition and `step` is the
 * thread's; else it is the caller's. A session that the caller has done with waits in `spent` for the thread:
 * freeing it is as little the task's business as making it. The thread has more than one attempt's time for
 * nothing, so destroy waits for no longer.
 */
#include "sockets/sockets_internal.h"

#include <errno.h>
#include <poll.h>
#include <pthread.h>
#include <signal.h>
#include <stdlib.h>
#include <string.h>

#define PATIENCE APC_NS_PER_S

enum step { IDLE, WANTED, DONE, END };

struct tls_connection {
    struct apc_tcp tcp; /* first: the functions of tcp.c take it */
    struct apc_hostport host;
    struct apc_identity *identity; /* borrowed */
    struct apc_tls *spent;
    int result; /* of the last attempt */
    struct apc_error why;
    struct apc_error last; /* the caller's: why the attempt before failed; "": it did not */
    pthread_t thread;
    pthread_mutex_t mutex;
    pthread_cond_t changed;
    enum step step;
};

static int tls_handshake(struct tls_connection *d, apc_ns deadline)
{
    for (;;) {
        int rc = apc_tls_handshake(d->tcp.tls, &d->why);
        if (rc != 0)
            return rc > 0 ? 0 : APC_ECONN;
        rc = apc_tcp_wait(d->tcp.fd, apc_tls_events(d->tcp.tls), deadline);
        if (rc == APC_ETIMEDOUT)
            return apc_fail(&d->why, rc, "the TLS handshake was not over in time");
        if (rc < 0)
            return apc_fail(&d->why, APC_ECONN, "TLS handshake: %s", strerrordesc_np(errno));
    }
}

static int attempt(struct tls_connection *d)
{
    const apc_ns deadline = apc_clock_mono(NULL) + PATIENCE;
    int rc;

    apc_tls_free(d->spent);
    d->spent = NULL;
    rc = apc_tcp_link_connect(&d->tcp, deadline, &d->why);
    if (rc < 0)
        return rc;
    rc = apc_tls_ask(&d->tcp.tls, d->identity, d->tcp.fd, &d->host);
    if (rc < 0)
        rc = apc_fail(&d->why, APC_ECONN, "no memory for a TLS session");
    else
        rc = tls_handshake(d, deadline);
    if (rc < 0) {
        apc_tls_free(d->tcp.tls);
        d->tcp.tls = NULL;
        apc_tcp_hang_up(&d->tcp);
    }
    return rc;
}

static void *run_tls_thread(void *arg)
{
    struct tls_connection *d = arg;

    pthread_mutex_lock(&d->mutex);
    while (d->step != END) {
        int result;
        if (d->step != WANTED) {
            pthread_cond_wait(&d->changed, &d->mutex);
            continue;
        }
        pthread_mutex_unlock(&d->mutex);
        result = attempt(d);
        pthread_mutex_lock(&d->mutex);
        d->result = result;
        if (d->step == WANTED)
            d->step = DONE;
        pthread_cond_broadcast(&d->changed);
    }
    pthread_mutex_unlock(&d->mutex);
    return NULL;
}

static int start_tls_thread(struct tls_connection *d)
{
    sigset_t all, old;
    int number;

    sigfillset(&all); /* signals are the program's own threads' business */
    pthread_sigmask(SIG_SETMASK, &all, &old);
    number = pthread_create(&d->thread, NULL, run_tls_thread, d);
    pthread_sigmask(SIG_SETMASK, &old, NULL);
    return number;
}

static int tls_create(void **self, const char *uri, struct apc_identity *identity, struct apc_error *why)
{
    struct tls_connection *d;
    int err, number;

    *self = NULL;
    if (!identity)
        return apc_fail(why, APC_EINVAL,
                        "link \"%s\": tls: needs an identity: a key and certificates (`apc cert` makes one)",
                        uri);
    d = calloc(1, sizeof *d);
    if (!d)
        return apc_fail(why, APC_ENOMEM, "link \"%s\": no memory", uri);
    d->identity = identity;
    err = apc_tcp_open(&d->tcp, uri, &d->host, why);
    if (err < 0)
        goto free;
    err = apc_mutex_init(&d->mutex);
    if (err < 0) {
        apc_fail(why, err, "link \"%s\": cannot make a mutex", uri);
        goto release;
    }
    pthread_cond_init(&d->changed, NULL);
    number = start_tls_thread(d);
    if (number == 0) {
        *self = d;
        return 0;
    }
    err = apc_fail(why, APC_ESYS, "link \"%s\": cannot start its thread: %s", uri, strerrordesc_np(number));
    pthread_cond_destroy(&d->changed);
    pthread_mutex_destroy(&d->mutex);
release:
    apc_tcp_release(&d->tcp);
free:
    free(d);
    return err;
}

static void tls_destroy(void *self)
{
    struct tls_connection *d = self;

    pthread_mutex_lock(&d->mutex);
    d->step = END;
    pthread_cond_broadcast(&d->changed);
    pthread_mutex_unlock(&d->mutex);
    pthread_join(d->thread, NULL);
    apc_tls_free(d->spent);
    apc_tls_free(d->tcp.tls);
    apc_tcp_release(&d->tcp);
    pthread_cond_destroy(&d->changed);
    pthread_mutex_destroy(&d->mutex);
    free(d);
}

static int tls_connect(void *self, apc_ns deadline, struct apc_error *why)
{
    const struct timespec until = {deadline / APC_NS_PER_S, deadline % APC_NS_PER_S};
    struct tls_connection *d = self;
    int late = 0, err;

    pthread_mutex_lock(&d->mutex);
    if (d->step == IDLE)
        d->step = WANTED;
    pthread_cond_broadcast(&d->changed);
    while (d->step == WANTED && !late)
        late = pthread_cond_clockwait(&d->changed, &d->mutex, CLOCK_MONOTONIC, &until);
    if (d->step == WANTED) {
        err =
            apc_fail(why, APC_ETIMEDOUT, "%s", d->last.text[0] ? d->last.text : "connecting takes its time");
    } else {
        d->step = IDLE;
        err = d->result;
        d->last.text[0] = '\0';
        if (err < 0)
            *why = d->last = d->why;
    }
    pthread_mutex_unlock(&d->mutex);
    return err;
}

static void tls_close(void *self)
{
    struct tls_connection *d = self;

    apc_tcp_hang_up(&d->tcp);
    d->spent = d->tcp.tls; /* there is no other: that one went before this was made */
    d->tcp.tls = NULL;
}

const struct apc_transport apc_transport_tls = {
    .scheme = "tls:",
    .create = tls_create,
    .destroy = tls_destroy,
    .connect = tls_connect,
    .close = tls_close,
    .quiet = apc_tcp_quiet,
    .send = apc_tcp_send,
    .receive = apc_tcp_receive,
};

/* SPDX-License-Identifier: BSD-3-Clause */
#include "connection_limits.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/socket.h>

int connection_limits_init(struct connection_limits *connection_limits)
{
    connection_limits->newest = NULL;
    return apc_mutex_init(&connection_limits->mutex);
}

void connection_limits_free(struct connection_limits *connection_limits)
{
    pthread_mutex_destroy(&connection_limits->mutex);
}

static bool same_owner(const struct connection *a, const struct connection *b)
{
    return a->member == b->member &&
           !strcmp(a->member ? a->owner : a->address, b->member ? b->owner : b->address);
}

static void dismiss(struct connection *c)
{
    c->dismissed = true;
    shutdown(c->fd, SHUT_RDWR);
}

/* Among c's room, or among its share of it, the one that goes when there are more than `most`. */
static void keep_connections(struct connection_limits *connection_limits, struct connection *c, bool share,
                             size_t most)
{
    struct connection *idle = c;
    size_t n = 0;
    for (struct connection *i = connection_limits->newest; i; i = i->next) {
        if (i->dismissed || i->member != c->member || (share && !same_owner(i, c)))
            continue;
        n++;
        if (!i->busy && i != c && (idle == c || i->since <= idle->since))
            idle = i;
    }
    if (n > most)
        dismiss(idle);
}

static void make_connection_place(struct connection_limits *connection_limits, struct connection *c)
{
    if (!c->member || c->owner[0]) /* the local session is everything that this user runs */
        keep_connections(connection_limits, c, true, c->member ? MEMBERS_SESSION : STRANGERS_ADDRESS);
    keep_connections(connection_limits, c, false, c->member ? MEMBERS : STRANGERS);
}

struct connection *connection_limits_enter(struct connection_limits *connection_limits, int fd,
                                           const char *address, apc_ns now)
{
    struct connection *c = calloc(1, sizeof *c);
    if (!c)
        return NULL;
    c->fd = fd;
    c->since = now;
    snprintf(c->address, sizeof c->address, "%s", address);
    pthread_mutex_lock(&connection_limits->mutex);
    c->at = &connection_limits->newest;
    c->next = connection_limits->newest;
    if (c->next)
        c->next->at = &c->next;
    connection_limits->newest = c;
    make_connection_place(connection_limits, c);
    pthread_mutex_unlock(&connection_limits->mutex);
    return c;
}

void connection_limits_leave(struct connection_limits *connection_limits, struct connection *c)
{
    pthread_mutex_lock(&connection_limits->mutex);
    *c->at = c->next;
    if (c->next)
        c->next->at = c->at;
    pthread_mutex_unlock(&connection_limits->mutex);
    free(c);
}

void connection_limits_asked(struct connection_limits *connection_limits, struct connection *c)
{
    pthread_mutex_lock(&connection_limits->mutex);
    c->asked = true;
    pthread_mutex_unlock(&connection_limits->mutex);
}

void connection_limits_busy(struct connection_limits *connection_limits, struct connection *c)
{
    pthread_mutex_lock(&connection_limits->mutex);
    c->busy = true;
    pthread_mutex_unlock(&connection_limits->mutex);
}

void connection_limits_answered(struct connection_limits *connection_limits, struct connection *c, apc_ns now)
{
    pthread_mutex_lock(&connection_limits->mutex);
    c->since = now;
    c->asked = c->busy = false;
    pthread_mutex_unlock(&connection_limits->mutex);
}

void connection_limits_member(struct connection_limits *connection_limits, struct connection *c,
                              const char *token)
{
    pthread_mutex_lock(&connection_limits->mutex);
    if (!c->member || strcmp(c->owner, token) != 0) {
        c->member = true;
        snprintf(c->owner, sizeof c->owner, "%s", token);
        make_connection_place(connection_limits, c);
    }
    pthread_mutex_unlock(&connection_limits->mutex);
}

void connection_limits_look(struct connection_limits *connection_limits, apc_ns now)
{
    pthread_mutex_lock(&connection_limits->mutex);
    for (struct connection *c = connection_limits->newest; c; c = c->next)
        if (!c->busy && !c->dismissed &&
            now - c->since > (c->member || c->asked ? REQUEST_DEADLINE : HEADER_DEADLINE))
            dismiss(c);
    pthread_mutex_unlock(&connection_limits->mutex);
}

/* SPDX-License-Identifier: BSD-3-Clause */
#include "connection_limits.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/socket.h>

int rooms_init(struct rooms *rooms)
{
    rooms->newest = NULL;
    return apc_mutex_init(&rooms->mutex);
}

void rooms_free(struct rooms *rooms)
{
    pthread_mutex_destroy(&rooms->mutex);
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
static void keep(struct rooms *rooms, struct connection *c, bool share, size_t most)
{
    struct connection *idle = c;
    size_t n = 0;
    for (struct connection *i = rooms->newest; i; i = i->next) {
        if (i->dismissed || i->member != c->member || (share && !same_owner(i, c)))
            continue;
        n++;
        if (!i->busy && i != c && (idle == c || i->since <= idle->since))
            idle = i;
    }
    if (n > most)
        dismiss(idle);
}

static void make_place(struct rooms *rooms, struct connection *c)
{
    if (!c->member || c->owner[0]) /* the local session is everything that this user runs */
        keep(rooms, c, true, c->member ? MEMBERS_SESSION : STRANGERS_ADDRESS);
    keep(rooms, c, false, c->member ? MEMBERS : STRANGERS);
}

struct connection *rooms_enter(struct rooms *rooms, int fd, const char *address, apc_ns now)
{
    struct connection *c = calloc(1, sizeof *c);
    if (!c)
        return NULL;
    c->fd = fd;
    c->since = now;
    snprintf(c->address, sizeof c->address, "%s", address);
    pthread_mutex_lock(&rooms->mutex);
    c->at = &rooms->newest;
    c->next = rooms->newest;
    if (c->next)
        c->next->at = &c->next;
    rooms->newest = c;
    make_place(rooms, c);
    pthread_mutex_unlock(&rooms->mutex);
    return c;
}

void rooms_leave(struct rooms *rooms, struct connection *c)
{
    pthread_mutex_lock(&rooms->mutex);
    *c->at = c->next;
    if (c->next)
        c->next->at = c->at;
    pthread_mutex_unlock(&rooms->mutex);
    free(c);
}

void rooms_asked(struct rooms *rooms, struct connection *c)
{
    pthread_mutex_lock(&rooms->mutex);
    c->asked = true;
    pthread_mutex_unlock(&rooms->mutex);
}

void rooms_busy(struct rooms *rooms, struct connection *c)
{
    pthread_mutex_lock(&rooms->mutex);
    c->busy = true;
    pthread_mutex_unlock(&rooms->mutex);
}

void rooms_answered(struct rooms *rooms, struct connection *c, apc_ns now)
{
    pthread_mutex_lock(&rooms->mutex);
    c->since = now;
    c->asked = c->busy = false;
    pthread_mutex_unlock(&rooms->mutex);
}

void rooms_member(struct rooms *rooms, struct connection *c, const char *token)
{
    pthread_mutex_lock(&rooms->mutex);
    if (!c->member || strcmp(c->owner, token) != 0) {
        c->member = true;
        snprintf(c->owner, sizeof c->owner, "%s", token);
        make_place(rooms, c);
    }
    pthread_mutex_unlock(&rooms->mutex);
}

void rooms_look(struct rooms *rooms, apc_ns now)
{
    pthread_mutex_lock(&rooms->mutex);
    for (struct connection *c = rooms->newest; c; c = c->next)
        if (!c->busy && !c->dismissed &&
            now - c->since > (c->member || c->asked ? REQUEST_DEADLINE : HEADER_DEADLINE))
            dismiss(c);
    pthread_mutex_unlock(&rooms->mutex);
}

/* SPDX-License-Identifier: BSD-3-Clause */
/*
 * Who may keep how many connections. Strangers and those who are logged in have a room each, and in it
 * everybody a share: a stranger by his address, the others by their session. Where a room or a share is full,
 * whoever has been idle for longest in it makes place: so nobody who comes is kept out by those who only sit
 * there, and no number of strangers costs a session its connection. A connection is closed by shutting its
 * socket down: the server, which then finds its end, does the rest.
 */
#ifndef APC_UI_ROOMS_H
#define APC_UI_ROOMS_H

#include <pthread.h>

#include "session.h"

#define STRANGERS         256
#define STRANGERS_ADDRESS 64 /* of one address */
#define MEMBERS           512
#define MEMBERS_SESSION   48                  /* of one session; streams are among them */
#define HEADER_DEADLINE   (5 * APC_NS_PER_S)  /* from a stranger's connection to the end of his headers */
#define REQUEST_DEADLINE  (20 * APC_NS_PER_S) /* to the end of the request */

struct connection {
    struct connection *next, **at;
    int fd;
    apc_ns since;                       /* opened, or last answered */
    bool asked;                         /* the headers of a request are there */
    bool busy;                          /* a request is whole and not yet answered */
    bool member;                        /* has asked in the name of a session */
    bool dismissed;                     /* shut down */
    int peer;                           /* 0: not looked at; 1: a process of this user; -1: not */
    char address[64], owner[TOKEN_LEN]; /* numeric; token of the session, "": the local one */
};

struct connection_limits {
    pthread_mutex_t mutex;
    struct connection *newest;
};

int connection_limits_init(struct connection_limits *connection_limits);
void connection_limits_free(struct connection_limits *connection_limits);
/* A stranger. NULL: out of memory. */
struct connection *connection_limits_enter(struct connection_limits *connection_limits, int fd,
                                           const char *address, apc_ns now);
void connection_limits_leave(struct connection_limits *connection_limits, struct connection *c);
/* The headers of a request are there; the request is whole; its answer is out. */
void connection_limits_asked(struct connection_limits *connection_limits, struct connection *c);
void connection_limits_busy(struct connection_limits *connection_limits, struct connection *c);
void connection_limits_answered(struct connection_limits *connection_limits, struct connection *c,
                                apc_ns now);
/* It has asked in the name of this session. */
void connection_limits_member(struct connection_limits *connection_limits, struct connection *c,
                              const char *token);
/* Shut down those who did not send their request in time, however they dribble. */
void connection_limits_look(struct connection_limits *connection_limits, apc_ns now);

/* Does a process of this user hold the other end of this connection on loopback? The kernel says. */
bool peer_is_own(int fd);

#endif

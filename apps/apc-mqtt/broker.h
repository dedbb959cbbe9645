/* SPDX-License-Identifier: BSD-3-Clause */
/*
 * A connection to an MQTT broker that comes and goes, by a thread of its own. Messages are of quality 1; the
 * retained message at PREFIX/status says that we are there, and the broker says it when we are not.
 *
 * libmosquitto repeats by itself, with the next connection, what was not acknowledged on the last one.
 *
 * The connection speaks MQTT 5, in which a broker says what it refuses. A broker that does not know it is
 * spoken to by MQTT 3.1.1: what that one refuses to publish it acknowledges all the same.
 */
#ifndef APC_MQTT_BROKER_H
#define APC_MQTT_BROKER_H

#include <apcbase.h>

#include <stdint.h>

#include "options.h"

#define BROKER_BATCH 500 /* rows under way */
#define BROKER_TOPIC 256

struct broker;

/* What a broker may refuse. */
enum broker_subject {
    BROKER_ROWS,       /* publishing them */
    BROKER_STATUS,     /* publishing that we are there */
    BROKER_OUTCOMES,   /* publishing what became of commands */
    BROKER_OWN_STATUS, /* giving us what is published at PREFIX/status */
    BROKER_COMMANDS,   /* giving us what is commanded */
    BROKER_SUBJECTS
};

struct broker_calls {
    void *birth_ctx, *command_ctx;
    /* What stands at PREFIX/status while we are there, malloc'd; NULL: no memory. [of the
     * connection's thread] */
    char *(*birth)(void *ctx);
    /* Something came to PREFIX/command/USER/SIGNAL. NULL: nothing is asked for. [of the same] */
    void (*command)(void *ctx, const char *user, const char *signal, const void *payload, size_t n,
                    bool retained);
};

/* "mqtts://HOST:PORT" and the rest of the options, looked at; nothing is connected yet. Returns 0,
 * APC_EINVAL, APC_ENOMEM, APC_ESYS. */
int broker_open(struct broker **broker, const struct mqtt_options *options, const char *prefix,
                const struct broker_calls *calls, struct apc_error *why);
int broker_start(struct broker *b, struct apc_error *why);
/* Say farewell, and end. Returns false where a connection attempt could not be ended in time: then b stays. */
bool broker_close(struct broker *b);

/* @why [n] gets why it is not. */
bool broker_is_up(struct broker *b, char *why, size_t n);
/* How often it was reached: after each time it may have forgotten what it retained. */
uint64_t broker_sessions(struct broker *b);
/* Does it refuse that, as far as we know on this connection? @why [n] gets what it refused last, and its
 * reason. */
bool broker_refuses(struct broker *b, enum broker_subject subject, char *why, size_t n);
/* Is the connection one of MQTT 5? */
bool broker_says_refusals(struct broker *b);
/* At PREFIX/@topic. @of: the row's series, of rows. Returns whether it is under way. */
bool broker_publish(struct broker *b, enum broker_subject subject, const char *topic, const char *payload,
                    size_t n, bool retained, size_t of);
/* Has all been acknowledged or refused? Waits for it up to @timeout, while the broker is there. */
bool broker_settled(struct broker *b, apc_ns timeout);
/* Has it refused a row of series @of since this was asked last? */
bool broker_refused(struct broker *b, size_t of);

#endif

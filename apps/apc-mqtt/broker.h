/* SPDX-License-Identifier: BSD-3-Clause */
/*
 * A connection to an MQTT broker that comes and goes, by a thread of its own. Messages are of quality 1; the
 * retained message at PREFIX/status says that we are there, and the broker says it when we are not.
 *
 * libmosquitto repeats by itself, with the next connection, what was not acknowledged on the last one.
 */
#ifndef APC_MQTT_BROKER_H
#define APC_MQTT_BROKER_H

#include <apcbase.h>

#include <stdint.h>

#include "options.h"

#define BROKER_BATCH 500 /* messages under way, of those that are waited for */
#define BROKER_TOPIC 256

struct broker;

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
/* Has it refused to give us what is commanded? Asked for with each connection. */
bool broker_refuses_commands(struct broker *b);
/* At PREFIX/@topic. `counted`: broker_settled() waits for it. Returns whether it is under way. */
bool broker_publish(struct broker *b, const char *topic, const char *payload, size_t n, bool retained,
                    bool counted);
/* Has all that was counted been acknowledged? Waits for it up to @timeout. */
bool broker_settled(struct broker *b, apc_ns timeout);

#endif

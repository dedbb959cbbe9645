/* SPDX-License-Identifier: BSD-3-Clause */
/*
 * A network that a test controls: a thread that forwards connections to a server and can stall, cut,
 * refuse or delay them, and that counts round trips by itself. Addresses: "unix:PATH" or
 * "tcp:127.0.0.1:PORT" (listening on port 0 takes a free one).
 */
#ifndef APC_TEST_PROXY_H
#define APC_TEST_PROXY_H

#include <stddef.h>
#include <stdint.h>

struct proxy;

enum proxy_mode {
    PROXY_PASS = 1,
    PROXY_STALL,  /**< forward nothing; sockets stay open, connections are still accepted */
    PROXY_CUT,    /**< close every connection now, then pass */
    PROXY_REFUSE, /**< close every connection, and new ones as they come */
};

enum proxy_direction { PROXY_TO_SERVER = 0, PROXY_TO_CLIENT = 1 };

/** Aborts the test program when it cannot be made. */
struct proxy *proxy_start(const char *listen_address, const char *server_address);
void proxy_stop(struct proxy *p);      /**< closes everything; NULL is legal */
int proxy_port(const struct proxy *p); /**< of a tcp: listener */

/** In force when it returns. */
void proxy_set(struct proxy *p, enum proxy_mode mode);
/** Let @p bytes more pass in a direction; as soon as there is another one, change to @p mode instead of
 * forwarding it. */
void proxy_arm(struct proxy *p, enum proxy_direction direction, uint64_t bytes, enum proxy_mode mode);
/** Hold everything back for so long. 0: not at all. */
void proxy_delay(struct proxy *p, int64_t ns);

/** How many times the server answered something the client had sent, over all connections. */
uint64_t proxy_round_trips(struct proxy *p);
/** Wait until a proxy_arm() has happened. Returns 0, or -1 when it did not (bounded: 20 s). */
int proxy_await_armed(struct proxy *p);

#endif

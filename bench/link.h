/* SPDX-License-Identifier: BSD-3-Clause */
/* What the files of bench/link share. */
#ifndef APC_BENCH_LINK_H
#define APC_BENCH_LINK_H

#include <netinet/in.h>
#include <pthread.h>

#include <apcexchange.h>

#include "bench.h"

#define N         10
#define FRAME_MAX (256 + 96 * 2 * N) /* as apc-client has it */

struct frames {
    char request[FRAME_MAX], reply[FRAME_MAX];
    size_t request_length, reply_length;
};

/* A listener on a free port of loopback, and the address to connect to. */
int listen_somewhere(struct sockaddr_in *at);
int connect_to(const struct sockaddr_in *at);
int accept_tuned(int listener);
/* False when the other side has gone. */
bool receive_all(int fd, char *buffer, size_t length);

/* link_tls.c: a key and a certificate for either side, and the ping-pong by OpenSSL alone, blocking, with the
 * same. */
struct keys {
    char folder[32], plant[64], client[64];
    struct apc_identity *its, *ours;
};
void keys_make(struct keys *keys);
void keys_drop(struct keys *keys);

struct bare_tls;
struct bare_tls *bare_tls_open(const struct frames *frames, const struct keys *keys);
void bare_tls_once(void *ctx);
void bare_tls_close(struct bare_tls *t);

/* link_modbus.c: ten registers out and ten in, by libmodbus and by us, each with a server of libmodbus's own. */
struct modbus_bench;
struct modbus_bench *modbus_open(void);
void modbus_bare_once(void *ctx);
void modbus_ours_once(void *ctx);
void modbus_close_both(struct modbus_bench *m);

#endif

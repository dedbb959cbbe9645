/* SPDX-License-Identifier: BSD-3-Clause */
/*
 * What the parts of apc-plant share. A part that serves the plant in another language than frames asks the
 * core by frames all the same (gateway.c): so its commands are watched, refused and told of as all others.
 */
#ifndef PLANT_H
#define PLANT_H

#include <pthread.h>

#include "daemon/credentials.h"
#include "daemon/daemon.h"
#include "daemon/self_monitor.h"
#include "experiment/experiment.h"

#define URI_LEN 256

struct shell {
    struct daemon *d;
    pthread_mutex_t mutex; /* of the core; inherits priority, so the server cannot hold the timer up */
    struct apc_plant *plant;
    struct apc_plantserver *core;
    struct credentials credentials;
    struct apc_server *server;
    bool hurries;                   /* the server's thread has the priority that it may have */
    unsigned ticks;                 /* under the mutex */
    struct state_watch solved;      /* the task's */
    struct gateway {                /* the server's thread's */
        struct apc_sample *samples; /* [max(nu, ny)] */
        char *request, *reply;      /* frames of @room bytes */
        size_t room;
        uint64_t connection, id;
        apc_ns stamp; /* of the last sign of life */
    } gateway;
    struct {
        struct apc_modbus_unit *unit;
        struct apc_modbus_point *points; /* where the file has no map */
    } registers;
    struct {
        struct apc_tclab *board;
        char path[URI_LEN];   /* the name of the port; "": none */
        int port, kept, wake; /* our end; the other one, kept open; to end the thread */
        pthread_t thread;
    } board;
};

/* main.c: a frame of whatever connection. */
int on_plant_request(void *ctx, uint64_t connection, const char *request, size_t length, char *reply,
                     size_t size);

/* gateway.c: vectors instead of frames. command() returns 0 or the Modbus exception that says why not. */
int gateway_open(struct shell *s, struct apc_error *why);
void gateway_close(struct shell *s);
int gateway_command(void *ctx, const double *u, bool alive);
unsigned gateway_measure(void *ctx, struct apc_value *y);

/* registers.c: Modbus. */
int registers_open(struct shell *s, struct apc_error *why);
void registers_close(struct shell *s);
int registers_answer(void *ctx, uint64_t connection, const char *request, size_t length, char *reply,
                     size_t size);

/* tclab_port.c: a serial port of ours, with a Temperature Control Lab behind it. */
int board_open(struct shell *s, const char *path, struct apc_error *why);
void board_close(struct shell *s);

#endif

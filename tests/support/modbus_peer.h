/* SPDX-License-Identifier: BSD-3-Clause */
/* A Modbus TCP server on a thread of its own, written after the specification, that also misbehaves to order. */
#ifndef APC_TEST_MODBUS_PEER_H
#define APC_TEST_MODBUS_PEER_H

#include <pthread.h>
#include <semaphore.h>
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

enum modbus_behaviour {
    MODBUS_PROPER,
    MODBUS_GARBAGE,   /* bytes that are no frame */
    MODBUS_FEW,       /* one register less than asked for */
    MODBUS_MANY,      /* one more */
    MODBUS_ANOTHERS,  /* the reply to another transaction */
    MODBUS_OTHER,     /* of another function */
    MODBUS_CLOSES,    /* the connection instead of a reply */
    MODBUS_ONCE,      /* it behind each reply */
    MODBUS_PIECES,    /* the reply byte by byte */
    MODBUS_LATE,      /* the reply when it is released */
    MODBUS_EXCEPTION, /* the exception of that number */
    MODBUS_SCRIPT     /* the bytes of the script, with the transaction's number put in where there is room */
};

struct modbus_peer {
    int listener, port;
    pthread_t thread;
    sem_t released;
    pthread_mutex_t mutex; /* of what follows */
    enum modbus_behaviour behaviour;
    unsigned char exception, unit; /* unit: of the last request */
    unsigned reads, writes;        /* requests so far */
    unsigned of[256];              /* by unit */
    unsigned busy;                 /* so many are answered by exception 6 before one is served */
    unsigned absent;               /* unit that a gateway does not reach: exception 11; 0: none */
    unsigned silent;               /* unit that takes a request and never answers */
    bool blocks;                   /* after which nothing on that connection is answered */
    unsigned slow;                 /* unit whose reply comes with that to the next request */
    unsigned lost;                 /* unit for whose requests the connection is closed */
    unsigned accepted;             /* connections */
    uint32_t unknown;              /* functions that it does not know, as bits */
    unsigned most;                 /* registers that it gives in one reply; 0: as many as there is room for */
    uint16_t holding[65536], input[65536];
    bool coil[65536], discrete[65536];
    unsigned char script[300];
    size_t script_length, held_length;
    unsigned char held[300]; /* the reply of the slow one */
    int connection;
    bool ends;
};

void modbus_peer_start(struct modbus_peer *p);
void modbus_peer_stop(struct modbus_peer *p);
/* So many bytes of the reply that it holds go out now. */
void modbus_peer_release(struct modbus_peer *p, size_t n);
void modbus_peer_behave(struct modbus_peer *p, enum modbus_behaviour behaviour);

#endif

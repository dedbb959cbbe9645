/* SPDX-License-Identifier: BSD-3-Clause */
#include "modbus_peer.h"

#include <arpa/inet.h>
#include <netinet/in.h>
#include <string.h>
#include <sys/socket.h>
#include <unistd.h>

#include "check.h"

static unsigned u16(const unsigned char *b)
{
    return (unsigned)b[0] << 8 | b[1];
}

static void put_u16(unsigned char *b, unsigned value)
{
    b[0] = (unsigned char)(value >> 8);
    b[1] = (unsigned char)value;
}

/* Registers or bits; the length of the reply's PDU. */
static size_t do_read(struct modbus_peer *p, const unsigned char *pdu, unsigned char *out)
{
    const unsigned at = u16(pdu + 1), n = u16(pdu + 3);
    const bool bits = pdu[0] <= 2;

    p->reads++;
    out[1] = (unsigned char)(bits ? (n + 7) / 8 : 2 * n);
    memset(out + 2, 0, out[1]);
    for (unsigned i = 0; i < n; i++)
        if (bits)
            out[2 + i / 8] |= (unsigned char)((pdu[0] == 1 ? p->coil : p->discrete)[at + i] << i % 8);
        else
            put_u16(out + 2 + (size_t)2 * i, (pdu[0] == 3 ? p->holding : p->input)[at + i]);
    return 2 + (size_t)out[1];
}

static size_t do_write(struct modbus_peer *p, const unsigned char *pdu, unsigned char *out)
{
    const unsigned at = u16(pdu + 1), n = u16(pdu + 3);

    p->writes++;
    memcpy(out, pdu, pdu[0] == 22 ? 7 : 5);
    if (pdu[0] == 5)
        p->coil[at] = n == 0xFF00;
    if (pdu[0] == 6)
        p->holding[at] = (uint16_t)n;
    if (pdu[0] == 22)
        p->holding[at] = (uint16_t)((p->holding[at] & n) | (u16(pdu + 5) & ~n));
    if (pdu[0] < 15 || pdu[0] == 22)
        return pdu[0] == 22 ? 7 : 5;
    for (unsigned i = 0; i < n; i++)
        if (pdu[0] == 15)
            p->coil[at + i] = pdu[6 + i / 8] >> i % 8 & 1;
        else
            p->holding[at + i] = (uint16_t)u16(pdu + 6 + (size_t)2 * i);
    return 5;
}

/* A reply with its header, good or as it was ordered. 0: none, close. */
static size_t answer(struct modbus_peer *p, const unsigned char *request, unsigned char *reply)
{
    unsigned char *out = reply + 7;
    const enum modbus_behaviour b = p->behaviour;
    const unsigned function = request[7];
    const bool counts = function <= 4 || function == 15 || function == 16,
               beyond = counts && u16(request + 8) + u16(request + 10) > 65536,
               unknown = p->unknown >> function % 32 & 1,
               large = function <= 4 && p->most && u16(request + 10) > p->most, busy = p->busy > 0,
               absent = p->absent && request[6] == p->absent;
    size_t n = 2;

    p->unit = request[6];
    p->of[p->unit]++;
    p->busy -= busy;
    memcpy(reply, request, 7);
    out[0] = request[7];
    if (beyond || unknown || large || busy || absent || b == MODBUS_EXCEPTION) {
        out[0] |= 0x80;
        out[1] = busy ? 6 : absent ? 11 : unknown ? 1 : beyond || large ? 2 : p->exception;
    } else {
        n = request[7] <= 4 ? do_read(p, request + 7, out) : do_write(p, request + 7, out);
    }
    if (b == MODBUS_FEW || b == MODBUS_MANY) {
        n = n + 2 * (size_t)(b == MODBUS_MANY) - 2 * (size_t)(b == MODBUS_FEW);
        out[1] = (unsigned char)(n - 2);
    }
    reply[1] = (unsigned char)(reply[1] + (b == MODBUS_ANOTHERS));
    out[0] = (unsigned char)(out[0] + (b == MODBUS_OTHER));
    put_u16(reply + 4, (unsigned)n + 1);
    if (b == MODBUS_GARBAGE)
        memset(reply, '7', 13);
    if (b == MODBUS_SCRIPT) {
        n = p->script_length - 7;
        memcpy(reply, p->script, p->script_length);
        memcpy(reply, request, p->script_length < 2 ? p->script_length : 2);
    }
    return 7 + n;
}

static bool receive(int fd, unsigned char *to, size_t n)
{
    return recv(fd, to, n, MSG_WAITALL) == (ssize_t)n;
}

/* What goes out: the reply of @n bytes with one that was held before it, or nothing yet. */
static size_t hold_slow(struct modbus_peer *p, const unsigned char *request, unsigned char *reply, size_t n)
{
    if (p->silent && request[6] == p->silent)
        return 0;
    if (p->slow && request[6] == p->slow) {
        memcpy(p->held, reply, n);
        p->held_length = n;
        return 0;
    }
    memmove(reply + p->held_length, reply, n);
    memcpy(reply, p->held, p->held_length);
    n += p->held_length;
    p->held_length = 0;
    return n;
}

static void serve(struct modbus_peer *p, int fd)
{
    unsigned char request[300], reply[600];

    while (receive(fd, request, 7) && u16(request + 4) <= 254 &&
           receive(fd, request + 7, u16(request + 4) - (size_t)1)) {
        pthread_mutex_lock(&p->mutex);
        const bool late = p->behaviour == MODBUS_LATE, once = p->behaviour == MODBUS_ONCE,
                   pieces = p->behaviour == MODBUS_PIECES;
        const bool closes = p->behaviour == MODBUS_CLOSES || (p->lost && request[6] == p->lost);
        const size_t answered = answer(p, request, reply), n = hold_slow(p, request, reply, answered);
        pthread_mutex_unlock(&p->mutex);
        if (closes)
            return;
        if (n == 0 && p->blocks)
            while (receive(fd, request, 1))
                ;
        if (n == 0)
            continue;
        const size_t piece = pieces ? 1 : n;
        while (late && sem_wait(&p->released) < 0)
            ;
        for (size_t i = 0; i + piece < n; i += piece)
            if (send(fd, reply + i, piece, MSG_NOSIGNAL) < 0)
                return;
        if (send(fd, reply + n - piece, piece, MSG_NOSIGNAL) < 0 || once)
            return;
    }
}

static void *play(void *arg)
{
    struct modbus_peer *p = arg;

    for (;;) {
        const int fd = accept(p->listener, NULL, NULL);

        pthread_mutex_lock(&p->mutex);
        const bool ends = p->ends;
        p->connection = fd;
        p->accepted += fd >= 0;
        p->held_length = 0;
        pthread_mutex_unlock(&p->mutex);
        if (!ends && fd >= 0)
            serve(p, fd);
        pthread_mutex_lock(&p->mutex);
        if (fd >= 0)
            close(fd);
        p->connection = -1;
        pthread_mutex_unlock(&p->mutex);
        if (ends || fd < 0)
            return NULL;
    }
}

void modbus_peer_start(struct modbus_peer *p)
{
    struct sockaddr_in in = {.sin_family = AF_INET, .sin_addr.s_addr = htonl(INADDR_LOOPBACK)};
    socklen_t length = sizeof in;

    pthread_mutex_init(&p->mutex, NULL);
    sem_init(&p->released, 0, 0);
    p->connection = -1;
    p->listener = socket(AF_INET, SOCK_STREAM, 0);
    assert_int_equal(bind(p->listener, (struct sockaddr *)&in, sizeof in), 0);
    assert_int_equal(getsockname(p->listener, (struct sockaddr *)&in, &length), 0);
    assert_int_equal(listen(p->listener, 8), 0);
    p->port = ntohs(in.sin_port);
    assert_int_equal(pthread_create(&p->thread, NULL, play, p), 0);
}

void modbus_peer_stop(struct modbus_peer *p)
{
    pthread_mutex_lock(&p->mutex);
    p->ends = true;
    if (p->connection >= 0)
        shutdown(p->connection, SHUT_RDWR);
    pthread_mutex_unlock(&p->mutex);
    sem_post(&p->released);
    shutdown(p->listener, SHUT_RDWR);
    pthread_join(p->thread, NULL);
    close(p->listener);
    sem_destroy(&p->released);
    pthread_mutex_destroy(&p->mutex);
}

void modbus_peer_release(struct modbus_peer *p, size_t n)
{
    pthread_mutex_lock(&p->mutex);
    assert_int_equal(send(p->connection, p->held, n, MSG_NOSIGNAL), n);
    p->held_length -= n;
    memmove(p->held, p->held + n, p->held_length);
    pthread_mutex_unlock(&p->mutex);
}

void modbus_peer_behave(struct modbus_peer *p, enum modbus_behaviour behaviour)
{
    pthread_mutex_lock(&p->mutex);
    p->behaviour = behaviour;
    pthread_mutex_unlock(&p->mutex);
}

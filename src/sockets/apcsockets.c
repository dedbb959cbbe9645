/* SPDX-License-Identifier: BSD-3-Clause */
/*
 * The paper's functions, as thin as its listings need them: the messages are frames of the codec, and
 * the sockets are blocking, because the listings read() and send() on them.
 */
#include "sockets/sockets_internal.h"

#include <arpa/inet.h>
#include <errno.h>
#include <fcntl.h>
#include <netinet/in.h>
#include <string.h>
#include <unistd.h>

#define PACK_TEXT       1024 /* of each ts and status, as in the listings */
#define PACK_COUNT      32   /* the shortest sample has 33 bytes: no more fit into APC_PACK_MAX */
#define CONNECT_TIMEOUT (5 * APC_NS_PER_S)

/* A status with or without the quotes that the paper's SQL needs. */
static int read_status(const char text[PACK_TEXT], apc_status *status)
{
    char name[APC_STATUS_NAME_LEN];
    size_t length = strnlen(text, PACK_TEXT);

    if (length >= 2 && text[0] == '\'' && text[length - 1] == '\'') {
        text++;
        length -= 2;
    }
    if (length >= sizeof name)
        return APC_EINVAL;
    memcpy(name, text, length);
    name[length] = '\0';
    return apc_status_parse(name, status);
}

static int read_time(const char text[PACK_TEXT], apc_ns *time)
{
    return memchr(text, '\0', PACK_TEXT) ? apc_time_parse(text, time) : APC_EINVAL;
}

int packMultiMsg(char *buff, int n, char (*ts)[1024], char (*status)[1024], const double *values)
{
    struct apc_sample samples[PACK_COUNT];
    struct apc_frame frame = {.kind = APC_FRAME_VALUES};
    apc_ns now;
    int length;

    if (!buff)
        return APC_EINVAL;
    *buff = '\0';
    if (n < 0 || (n > 0 && !values))
        return APC_EINVAL;
    if (n > PACK_COUNT)
        return APC_ERANGE;
    now = apc_clock_utc(NULL);
    for (int i = 0; i < n; i++) {
        samples[i] = (struct apc_sample){.time = now, .status = APC_GOOD, .value = values[i]};
        if ((ts && read_time(ts[i], &samples[i].time) < 0) ||
            (status && read_status(status[i], &samples[i].status) < 0))
            return APC_EINVAL;
    }
    frame.n = (size_t)n;
    length = apc_frame_encode(buff, APC_PACK_MAX - 1, &frame, samples);
    buff[length < 0 ? 0 : length] = '\0';
    return length;
}

int unpackMultiMsg(char (*ts)[1024], char (*status)[1024], double *values, const char *buff)
{
    struct apc_sample samples[PACK_COUNT];
    struct apc_frame frame;
    const char *end;

    if (!buff || !values)
        return APC_EINVAL;
    /* What follows the newline is left over from a longer message: the listings do not clear buff. */
    end = memchr(buff, '\n', strnlen(buff, APC_PACK_MAX));
    if (!end || apc_frame_decode(buff, (size_t)(end - buff) + 1, &frame, samples, PACK_COUNT) < 0)
        return APC_EPROTO;
    for (size_t i = 0; i < frame.n; i++) {
        if (ts)
            apc_time_format(samples[i].time, ts[i]);
        if (status)
            apc_status_format(samples[i].status, status[i]);
        values[i] = samples[i].value;
    }
    return (int)frame.n;
}

int client_init(void)
{
    int fd = socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0);
    if (fd < 0)
        return APC_ESYS;
    apc_tcp_tune(fd);
    return fd;
}

int client_connect(int fd, const char *ip, int port)
{
    struct apc_endpoint to = {.length = sizeof(struct sockaddr_in)};
    struct sockaddr_in in = {.sin_family = AF_INET, .sin_port = htons((uint16_t)port)};
    int flags, err, number;

    if (fd < 0 || !ip || port < 1 || port > UINT16_MAX || inet_pton(AF_INET, ip, &in.sin_addr) != 1)
        return APC_EINVAL;
    memcpy(&to.address, &in, sizeof in);
    flags = fcntl(fd, F_GETFL);
    if (flags < 0 || fcntl(fd, F_SETFL, flags | O_NONBLOCK) < 0)
        return APC_EINVAL; /* not a descriptor of ours */
    err = apc_tcp_connect(fd, &to, apc_clock_mono(NULL) + CONNECT_TIMEOUT);
    number = errno;
    (void)fcntl(fd, F_SETFL, flags); /* the listings read and send blocking */
    errno = number;
    return err;
}

int server_init(void)
{
    struct apc_endpoint at = {.length = sizeof(struct sockaddr_in)};
    struct sockaddr_in in = {.sin_family = AF_INET, .sin_port = htons(APC_PORT)};

    in.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
    memcpy(&at.address, &in, sizeof in);
    return apc_tcp_bind(&at);
}

int server_listen(int fd, int queue)
{
    if (fd < 0 || queue < 1)
        return APC_EINVAL;
    return listen(fd, queue) < 0 ? APC_ESYS : 0;
}

int server_accept(int fd)
{
    int connection;
    do
        connection = accept4(fd, NULL, NULL, SOCK_CLOEXEC);
    while (connection < 0 && errno == ECONNABORTED); /* one client gave up: wait for the next */
    if (connection < 0)
        return APC_ESYS;
    apc_tcp_tune(connection);
    return connection;
}

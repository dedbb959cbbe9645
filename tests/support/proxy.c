/* SPDX-License-Identifier: BSD-3-Clause */
/*
 * One thread owns the sockets. Whatever others may set or read is under one mutex; a byte in a pipe wakes
 * the thread, and the setter waits until the thread has taken note. Each direction of a connection holds
 * one chunk at most: no reading before the last chunk has gone, so a stalled reader is felt by its sender.
 */
#include "proxy.h"

#include <arpa/inet.h>
#include <errno.h>
#include <fcntl.h>
#include <netinet/in.h>
#include <netinet/tcp.h>
#include <poll.h>
#include <pthread.h>
#include <stdbool.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/socket.h>
#include <sys/un.h>
#include <time.h>
#include <unistd.h>

#define CONNECTIONS 32
#define CHUNK       65536

struct flow {
    char data[CHUNK];
    size_t begin, end;
    int64_t due;   /* not before, monotonic ns */
    bool finished; /* its sender closed */
};

struct connection {
    int fd[2];           /* [0] the client's, [1] the server's; -1: free */
    struct flow flow[2]; /* by direction */
    bool asked;          /* the last byte came from the client */
};

struct address {
    union {
        struct sockaddr any;
        struct sockaddr_un un;
        struct sockaddr_in in;
    } a;
    socklen_t length;
};

struct proxy {
    struct address server;
    char path[108]; /* of a unix listener, to remove */
    int listener, wake[2], port;
    pthread_t thread;
    struct connection connections[CONNECTIONS]; /* the thread's */

    pthread_mutex_t mutex;
    pthread_cond_t changed;
    uint64_t wanted, done; /* count of settings made, and taken note of */
    enum proxy_mode mode;
    enum proxy_mode armed; /* 0: not */
    enum proxy_direction armed_direction;
    uint64_t armed_bytes;
    int64_t delay;
    uint64_t round_trips;
    bool quit;
};

static void must(bool ok, const char *what)
{
    if (!ok) {
        fprintf(stderr, "proxy: %s: %s\n", what, strerror(errno));
        abort();
    }
}

static int64_t now(void)
{
    struct timespec t;
    clock_gettime(CLOCK_MONOTONIC, &t);
    return (int64_t)t.tv_sec * 1000000000 + t.tv_nsec;
}

static struct address parse(const char *text)
{
    struct address out = {0};
    if (strncmp(text, "unix:", 5) == 0 && strlen(text + 5) < sizeof out.a.un.sun_path) {
        out.a.un.sun_family = AF_UNIX;
        memcpy(out.a.un.sun_path, text + 5, strlen(text + 5) + 1);
        out.length = sizeof out.a.un;
        return out;
    }
    char host[64];
    unsigned port = 0;
    errno = EINVAL;
    must(sscanf(text, "tcp:%63[^:]:%u", host, &port) == 2 && port <= 65535, text);
    out.a.in.sin_family = AF_INET;
    out.a.in.sin_port = htons((uint16_t)port);
    must(inet_pton(AF_INET, host, &out.a.in.sin_addr) == 1, host);
    out.length = sizeof out.a.in;
    return out;
}

/* ---- The thread's part ---------------------------------------------------------------------- */

static void close_connection(struct connection *c)
{
    for (int i = 0; i < 2; i++) {
        if (c->fd[i] >= 0) {
            close(c->fd[i]);
        }
        c->fd[i] = -1;
    }
}

static void close_all(struct proxy *p)
{
    for (size_t i = 0; i < CONNECTIONS; i++) {
        close_connection(&p->connections[i]);
    }
}

static void no_delay(int fd, int family)
{
    int one = 1;
    if (family == AF_INET) {
        setsockopt(fd, IPPROTO_TCP, TCP_NODELAY, &one, sizeof one);
    }
}

static void accept_one(struct proxy *p)
{
    int client = accept4(p->listener, NULL, NULL, SOCK_CLOEXEC | SOCK_NONBLOCK);
    if (client < 0) {
        return;
    }
    pthread_mutex_lock(&p->mutex);
    bool refuse = p->mode == PROXY_REFUSE;
    pthread_mutex_unlock(&p->mutex);
    struct connection *c = NULL;
    for (size_t i = 0; i < CONNECTIONS && !c; i++) {
        c = p->connections[i].fd[0] < 0 ? &p->connections[i] : NULL;
    }
    int family = p->server.a.any.sa_family;
    int server = refuse || !c ? -1 : socket(family, SOCK_STREAM | SOCK_CLOEXEC, 0);
    if (server < 0 || connect(server, &p->server.a.any, p->server.length) != 0) {
        close(client);
        if (server >= 0) {
            close(server);
        }
        return;
    }
    fcntl(server, F_SETFL, O_NONBLOCK);
    no_delay(server, family);
    no_delay(client, p->port ? AF_INET : AF_UNIX);
    c->fd[0] = client;
    c->fd[1] = server;
    for (int d = 0; d < 2; d++) {
        c->flow[d].begin = c->flow[d].end = 0;
        c->flow[d].finished = false;
    }
    c->asked = false;
}

static void apply(struct proxy *p, enum proxy_mode mode) /* mutex held */
{
    p->mode = mode == PROXY_CUT ? PROXY_PASS : mode;
    if (mode == PROXY_CUT || mode == PROXY_REFUSE) {
        close_all(p);
    }
}

/* How much of a fresh chunk may pass; less than all when the trap that was armed has sprung. */
static size_t inspect(struct proxy *p, struct connection *c, enum proxy_direction d, size_t n)
{
    pthread_mutex_lock(&p->mutex);
    if (d == PROXY_TO_SERVER) {
        c->asked = true;
    } else if (c->asked) {
        c->asked = false;
        p->round_trips++;
    }
    c->flow[d].due = p->delay ? now() + p->delay : 0;
    if (p->armed && p->armed_direction == d) {
        if (n > p->armed_bytes) {
            enum proxy_mode mode = p->armed;
            n = mode == PROXY_STALL ? n : (size_t)p->armed_bytes; /* stalled bytes are held, not lost */
            p->armed = (enum proxy_mode)0;
            apply(p, mode);
            pthread_cond_broadcast(&p->changed);
        } else {
            p->armed_bytes -= n;
        }
    }
    pthread_mutex_unlock(&p->mutex);
    return n;
}

static void receive(struct proxy *p, struct connection *c, enum proxy_direction d)
{
    struct flow *f = &c->flow[d];
    ssize_t n = read(c->fd[d], f->data, sizeof f->data);
    if (n > 0) {
        f->begin = 0;
        f->end = inspect(p, c, d, (size_t)n);
    } else if (n == 0) {
        f->finished = true;
    } else if (errno != EAGAIN && errno != EINTR) {
        close_connection(c);
    }
}

static void forward(struct connection *c, enum proxy_direction d)
{
    struct flow *f = &c->flow[d];
    ssize_t n = send(c->fd[!d], f->data + f->begin, f->end - f->begin, MSG_NOSIGNAL);
    if (n > 0) {
        f->begin += (size_t)n;
    } else if (n < 0 && errno != EAGAIN && errno != EINTR) {
        close_connection(c);
    }
}

/* One pass over a connection; @p ready by side. */
static void serve(struct proxy *p, struct connection *c, const short ready[2])
{
    for (int d = 0; d < 2 && c->fd[0] >= 0; d++) {
        struct flow *f = &c->flow[d];
        if (f->begin == f->end && !f->finished && (ready[d] & (POLLIN | POLLHUP | POLLERR))) {
            receive(p, c, (enum proxy_direction)d);
        }
        if (c->fd[0] >= 0 && f->begin < f->end && now() >= f->due) {
            forward(c, (enum proxy_direction)d);
        }
        if (c->fd[0] >= 0 && f->finished && f->begin == f->end) {
            close_connection(c);
        }
    }
}

/* What to wait for on one side: bytes to read in its direction, room for those of the other. */
static short interest(const struct connection *c, int side, int64_t *wait)
{
    const struct flow *in = &c->flow[side], *out = &c->flow[!side];
    short events = in->begin == in->end ? POLLIN : 0;
    if (out->begin < out->end) {
        int64_t left = out->due - now();
        if (left <= 0) {
            events = (short)(events | POLLOUT);
        } else if (*wait < 0 || left < *wait) {
            *wait = left;
        }
    }
    return events;
}

static bool take_note(struct proxy *p, enum proxy_mode *mode)
{
    char bytes[64];
    while (read(p->wake[0], bytes, sizeof bytes) > 0) {
    }
    pthread_mutex_lock(&p->mutex);
    if (p->done != p->wanted) {
        apply(p, p->mode);
        p->done = p->wanted;
        pthread_cond_broadcast(&p->changed);
    }
    *mode = p->mode;
    bool quit = p->quit;
    pthread_mutex_unlock(&p->mutex);
    return !quit;
}

static void *run(void *arg)
{
    struct proxy *p = arg;
    enum proxy_mode mode;
    while (take_note(p, &mode)) {
        struct pollfd fds[2 + 2 * CONNECTIONS] = {{.fd = p->wake[0], .events = POLLIN},
                                                  {.fd = p->listener, .events = POLLIN}};
        int64_t wait = -1;
        for (size_t i = 0; i < CONNECTIONS; i++) {
            for (size_t side = 0; side < 2; side++) {
                bool use = mode != PROXY_STALL && p->connections[i].fd[0] >= 0;
                struct pollfd *fd = &fds[2 + 2 * i + side];
                fd->fd = use ? p->connections[i].fd[side] : -1;
                fd->events = use ? interest(&p->connections[i], (int)side, &wait) : 0;
            }
        }
        struct timespec timeout = {.tv_sec = wait / 1000000000, .tv_nsec = wait % 1000000000};
        if (ppoll(fds, 2 + 2 * CONNECTIONS, wait < 0 ? NULL : &timeout, NULL) < 0) {
            continue;
        }
        if (!take_note(p, &mode)) {
            break;
        }
        if (fds[1].revents) {
            accept_one(p);
        }
        for (size_t i = 0; i < CONNECTIONS && mode != PROXY_STALL; i++) {
            const short ready[2] = {fds[2 + 2 * i].revents, fds[3 + 2 * i].revents};
            if (fds[2 + 2 * i].fd >= 0 && fds[2 + 2 * i].fd == p->connections[i].fd[0]) {
                serve(p, &p->connections[i], ready);
                pthread_mutex_lock(&p->mutex);
                mode = p->mode; /* a trap may have sprung */
                pthread_mutex_unlock(&p->mutex);
            }
        }
    }
    close_all(p);
    return NULL;
}

/* ---- The test's part ------------------------------------------------------------------------ */

struct proxy *proxy_start(const char *listen_address, const char *server_address)
{
    struct proxy *p = calloc(1, sizeof *p);
    must(p != NULL, "memory");
    p->server = parse(server_address);
    struct address own = parse(listen_address);
    p->listener = socket(own.a.any.sa_family, SOCK_STREAM | SOCK_CLOEXEC | SOCK_NONBLOCK, 0);
    must(p->listener >= 0, "socket");
    if (own.a.any.sa_family == AF_UNIX) {
        memcpy(p->path, own.a.un.sun_path, sizeof p->path);
        unlink(p->path);
    }
    must(bind(p->listener, &own.a.any, own.length) == 0 && listen(p->listener, 16) == 0, listen_address);
    if (own.a.any.sa_family == AF_INET) {
        must(getsockname(p->listener, &own.a.any, &own.length) == 0, "getsockname");
        p->port = ntohs(own.a.in.sin_port);
    }
    must(pipe2(p->wake, O_CLOEXEC | O_NONBLOCK) == 0, "pipe");
    for (size_t i = 0; i < CONNECTIONS; i++) {
        p->connections[i].fd[0] = p->connections[i].fd[1] = -1;
    }
    p->mode = PROXY_PASS;
    pthread_mutex_init(&p->mutex, NULL);
    pthread_cond_init(&p->changed, NULL);
    errno = pthread_create(&p->thread, NULL, run, p);
    must(errno == 0, "thread");
    return p;
}

/* mutex held */
static void wake(struct proxy *p)
{
    p->wanted++;
    must(write(p->wake[1], "", 1) == 1 || errno == EAGAIN, "wake");
}

void proxy_stop(struct proxy *p)
{
    if (!p) {
        return;
    }
    pthread_mutex_lock(&p->mutex);
    p->quit = true;
    wake(p);
    pthread_mutex_unlock(&p->mutex);
    pthread_join(p->thread, NULL);
    close(p->listener);
    close(p->wake[0]);
    close(p->wake[1]);
    if (p->path[0]) {
        unlink(p->path);
    }
    pthread_cond_destroy(&p->changed);
    pthread_mutex_destroy(&p->mutex);
    free(p);
}

int proxy_port(const struct proxy *p)
{
    return p->port;
}

void proxy_set(struct proxy *p, enum proxy_mode mode)
{
    pthread_mutex_lock(&p->mutex);
    p->mode = mode;
    p->armed = (enum proxy_mode)0;
    wake(p);
    while (p->done != p->wanted) {
        pthread_cond_wait(&p->changed, &p->mutex);
    }
    pthread_mutex_unlock(&p->mutex);
}

void proxy_arm(struct proxy *p, enum proxy_direction direction, uint64_t bytes, enum proxy_mode mode)
{
    pthread_mutex_lock(&p->mutex);
    p->armed = mode;
    p->armed_direction = direction;
    p->armed_bytes = bytes;
    pthread_mutex_unlock(&p->mutex);
}

void proxy_delay(struct proxy *p, int64_t ns)
{
    pthread_mutex_lock(&p->mutex);
    p->delay = ns;
    pthread_mutex_unlock(&p->mutex);
}

uint64_t proxy_round_trips(struct proxy *p)
{
    pthread_mutex_lock(&p->mutex);
    uint64_t n = p->round_trips;
    pthread_mutex_unlock(&p->mutex);
    return n;
}

int proxy_await_armed(struct proxy *p)
{
    struct timespec until;
    clock_gettime(CLOCK_REALTIME, &until);
    until.tv_sec += 20;
    int err = 0;
    pthread_mutex_lock(&p->mutex);
    while (p->armed && err == 0) {
        err = pthread_cond_timedwait(&p->changed, &p->mutex, &until);
    }
    pthread_mutex_unlock(&p->mutex);
    return err ? -1 : 0;
}

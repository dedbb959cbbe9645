/* SPDX-License-Identifier: BSD-3-Clause */
/*
 * One exchange of ten values with a plant, over loopback TCP, next to a ping-pong of as many bytes.
 *
 *     raw        blocking sockets and nothing else: what the kernel takes
 *     link       apc_link_exchange() and a server that answers frames made beforehand: deadlines, framing
 *     exchange   what apc-client and apc-plant do: both cores, so frames are written and read as well
 *
 * The asking side is this thread, on the first CPU; each answering side is a thread on the second, so that
 * none is favoured by where the scheduler happens to put it.
 */
#include <netinet/in.h>
#include <netinet/tcp.h>
#include <pthread.h>
#include <sched.h>
#include <stdlib.h>
#include <string.h>
#include <sys/socket.h>
#include <unistd.h>

#include <apcexchange.h>
#include <apcmodules.h>

#include "bench.h"

#define N         10
#define FRAME_MAX (256 + 96 * 2 * N)    /* as apc-client has it */
#define PERIOD    (3600 * APC_NS_PER_S) /* of everything: nothing gets stale */

/* ---- Frames -------------------------------------------------------------------------------- */

struct frames {
    char request[FRAME_MAX], reply[FRAME_MAX];
    size_t request_length, reply_length;
};

/* Values with all their digits, as measurements have them. */
static double value(size_t i)
{
    return 1.0 / (double)(i + 3);
}

static void fill_samples(struct apc_sample *samples, enum apc_table table)
{
    for (size_t i = 0; i < N; i++)
        samples[i] = (struct apc_sample){
            .table = table, .id = (int)i + 1, .seq = 1, .time = apc_clock_utc(NULL), .value = value(i)};
}

static size_t encode(char text[FRAME_MAX], enum apc_frame_kind kind)
{
    const struct apc_frame frame = {.kind = kind, .id = 1000, .n = N};
    struct apc_sample samples[N];

    fill_samples(samples, APC_ACTUATOR);
    int length = apc_frame_encode(text, FRAME_MAX, &frame, samples);
    if (length < 0)
        die("cannot encode a frame: %s", apc_err_text(length));
    return (size_t)length;
}

/* ---- Raw ----------------------------------------------------------------------------------- */

struct raw {
    const struct frames *frames;
    int listener, fd; /* the asking side */
    pthread_t thread;
};

static void no_delay(int fd)
{
    const int one = 1;
    setsockopt(fd, IPPROTO_TCP, TCP_NODELAY, &one, sizeof one);
}

/* False when the other side has gone. */
static bool receive_all(int fd, char *buffer, size_t length)
{
    for (size_t have = 0; have < length;) {
        ssize_t n = recv(fd, buffer + have, length - have, 0);
        if (n <= 0)
            return false;
        have += (size_t)n;
    }
    return true;
}

static void *raw_serve(void *ctx)
{
    const struct raw *r = ctx;
    char buffer[FRAME_MAX];
    int fd = accept(r->listener, NULL, NULL);

    if (fd < 0)
        return NULL;
    no_delay(fd);
    while (receive_all(fd, buffer, r->frames->request_length) &&
           send(fd, r->frames->reply, r->frames->reply_length, MSG_NOSIGNAL) > 0)
        ;
    close(fd);
    return NULL;
}

static void raw_open(struct raw *r, const struct frames *frames)
{
    struct sockaddr_in at = {.sin_family = AF_INET, .sin_addr.s_addr = htonl(INADDR_LOOPBACK)};
    socklen_t length = sizeof at;

    r->frames = frames;
    r->listener = socket(AF_INET, SOCK_STREAM, 0);
    if (r->listener < 0 || bind(r->listener, (struct sockaddr *)&at, sizeof at) < 0 ||
        listen(r->listener, 1) < 0 || getsockname(r->listener, (struct sockaddr *)&at, &length) < 0 ||
        pthread_create(&r->thread, NULL, raw_serve, r) != 0)
        die("cannot make a server on loopback");
    r->fd = socket(AF_INET, SOCK_STREAM, 0);
    if (r->fd < 0 || connect(r->fd, (struct sockaddr *)&at, sizeof at) < 0)
        die("cannot connect over loopback");
    no_delay(r->fd);
}

static void raw_once(void *ctx)
{
    const struct raw *r = ctx;
    char buffer[FRAME_MAX];

    if (send(r->fd, r->frames->request, r->frames->request_length, MSG_NOSIGNAL) < 0 ||
        !receive_all(r->fd, buffer, r->frames->reply_length))
        die("the raw connection broke");
}

static void raw_close(struct raw *r)
{
    close(r->fd);
    pthread_join(r->thread, NULL);
    close(r->listener);
}

/* ---- The link, with and without the cores -------------------------------------------------- */

/* A plant that does nothing: what it computes is not the link's time. */
static int still(double t, const double *x, const double *u, const double *p, double *dx)
{
    (void)t, (void)x, (void)u, (void)p;
    dx[0] = 0.0;
    return 0;
}

static void measure(double t, const double *x, const double *u, const double *p, double *y)
{
    (void)t, (void)x, (void)u, (void)p;
    for (size_t i = 0; i < N; i++)
        y[i] = value(i);
}

static const struct apc_model model = {
    .abi = APC_MODEL_ABI, .name = "still", .nx = 1, .nu = N, .ny = N, .f = still, .g = measure};

struct exchange {
    const struct frames *frames;
    struct apc_server *server;
    struct apc_link *link;
    pthread_mutex_t mutex; /* of the plant's core, as in apc-plant */
    struct apc_plant *plant;
    struct apc_plantserver *plantserver;
    struct apc_client *client;
    struct apc_exchange *x;
    struct apc_sample u[N];
};

static struct apc_now now(void)
{
    return (struct apc_now){.mono = apc_clock_mono(NULL), .utc = apc_clock_utc(NULL)};
}

static int answer_frame(void *ctx, uint64_t connection, const char *request, size_t length, char *reply,
                        size_t size)
{
    const struct exchange *e = ctx;
    (void)connection, (void)request, (void)length, (void)size;
    memcpy(reply, e->frames->reply, e->frames->reply_length);
    return (int)e->frames->reply_length;
}

static int answer_core(void *ctx, uint64_t connection, const char *request, size_t length, char *reply,
                       size_t size)
{
    struct exchange *e = ctx;
    struct apc_notice notice = {0};

    pthread_mutex_lock(&e->mutex);
    int n = apc_plantserver_request(e->plantserver, now(), connection, request, length, reply, size, &notice);
    pthread_mutex_unlock(&e->mutex);
    return n;
}

static void serve_plant(struct exchange *e, apc_server_fn fn, char uri[64])
{
    const struct apc_server_options options = {.size = sizeof options, .frame_max = FRAME_MAX};
    struct apc_error why;

    if (apc_server_create(&e->server, "tcp:127.0.0.1:0", &options, fn, e, &why) < 0)
        die("%s", why.text);
    snprintf(uri, 64, "tcp:127.0.0.1:%d", apc_server_port(e->server));
}

static void link_open(struct exchange *e, const struct frames *frames)
{
    const struct apc_link_options options = {.size = sizeof options, .frame_max = FRAME_MAX};
    struct apc_error why;
    char uri[64];

    e->frames = frames;
    serve_plant(e, answer_frame, uri);
    if (apc_link_create(&e->link, uri, &options, &why) < 0)
        die("%s", why.text);
}

static void cores_open(struct exchange *e)
{
    struct apc_notice notice;
    struct apc_error why;
    char uri[64];
    const struct apc_exchange_options options = {.size = sizeof options, .nu = N, .ny = N};
    const struct apc_client_options client = {
        .size = sizeof client, .ny = N, .nu = N, .command_period = PERIOD};

    fill_samples(e->u, APC_ACTUATOR);
    pthread_mutex_init(&e->mutex, NULL);
    if (apc_plant_create(&e->plant, &model, NULL, NULL, NULL, &why) < 0)
        die("%s", why.text);
    const struct apc_plantserver_options server = {.size = sizeof server,
                                                   .plant = e->plant,
                                                   .model = &model,
                                                   .link_period = PERIOD,
                                                   .command_period = PERIOD};
    if (apc_plantserver_create(&e->plantserver, &server, &why) < 0 ||
        apc_client_create(&e->client, &client, &why) < 0)
        die("%s", why.text);
    if (apc_plantserver_tick(e->plantserver, now(), &notice) < 0)
        die("the plant could not be computed");
    serve_plant(e, answer_core, uri);
    if (apc_exchange_open(&e->x, uri, &options, &why) < 0)
        die("%s", why.text);
}

static void link_once(void *ctx)
{
    struct exchange *e = ctx;
    const char *reply;

    int n = apc_link_exchange(e->link, e->frames->request, e->frames->request_length, &reply,
                              apc_clock_mono(NULL) + APC_NS_PER_S);
    if (n < 0)
        die("%s", apc_link_error(e->link));
    if ((size_t)n != e->frames->reply_length)
        die("the reply is not what was sent");
}

static void exchange_once(void *ctx)
{
    struct exchange *e = ctx;
    struct apc_value command[N], answer[N];
    struct apc_sample y[N];

    apc_client_command(e->client, now(), e->u, command);
    if (apc_exchange_begin(e->x, command, apc_clock_mono(NULL) + APC_NS_PER_S) < 0 ||
        apc_exchange_finish(e->x, answer) < 0)
        die("%s", apc_exchange_error(e->x));
    apc_client_measurements(e->client, answer, y);
}

static void exchange_close(struct exchange *e)
{
    apc_link_destroy(e->link);
    apc_exchange_close(e->x);
    apc_server_destroy(e->server);
    apc_client_destroy(e->client);
    apc_plantserver_destroy(e->plantserver);
    apc_plant_destroy(e->plant);
}

/* ---- Main ---------------------------------------------------------------------------------- */

/* Threads inherit where their maker may run. */
static void run_on(int cpu)
{
    cpu_set_t set;

    CPU_ZERO(&set);
    CPU_SET((size_t)cpu, &set);
    if (sysconf(_SC_NPROCESSORS_ONLN) > 1)
        (void)sched_setaffinity(0, sizeof set, &set);
}

int main(int argc, char **argv)
{
    struct bench b = {.name = "link", .reference = {"raw"}, .calls = 2000, .budget = APC_NS_PER_S};
    struct frames frames;
    struct raw raw;
    struct exchange link = {0}, exchange = {0};
    char title[64];

    bench_begin(&b, argc, argv, "Time one exchange of ten values over loopback TCP.");
    bench_describe(&b, NULL);
    frames.request_length = encode(frames.request, APC_FRAME_COMMAND);
    frames.reply_length = encode(frames.reply, APC_FRAME_VALUES);
    run_on(1);
    raw_open(&raw, &frames);
    link_open(&link, &frames);
    cores_open(&exchange);
    run_on(0);

    struct bench_row rows[] = {
        {.name = "raw ping-pong", .once = raw_once, .ctx = &raw},
        {.name = "link, frames made beforehand", .once = link_once, .ctx = &link, .to = {&rows[0]}},
        {.name = "exchange, client to plant", .once = exchange_once, .ctx = &exchange, .to = {&rows[0]}},
    };
    snprintf(title, sizeof title, "%d values, %zu and %zu bytes", N, frames.request_length,
             frames.reply_length);
    bench_run(&b, title, N, rows, sizeof rows / sizeof rows[0]);

    raw_close(&raw);
    exchange_close(&link);
    exchange_close(&exchange);
    bench_end(&b);
    return 0;
}

/* SPDX-License-Identifier: BSD-3-Clause */
/*
 * One exchange of ten values with a plant, over loopback TCP, next to a ping-pong of as many bytes.
 *
 *     raw        blocking sockets and nothing else: what the kernel takes
 *     link       apc_link_exchange() and a server that answers frames made beforehand: deadlines, framing
 *     exchange   what apc-client and apc-plant do: both cores, so frames are written and read as well
 *
 * The same by TLS, next to a ping-pong by OpenSSL alone; and an exchange of as many registers by Modbus, next
 * to one by libmodbus alone, each with a server of libmodbus's.
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

#include <apcmodules.h>

#include "link.h"

#define PERIOD (3600 * APC_NS_PER_S) /* of everything: nothing gets stale */

/* ---- Frames -------------------------------------------------------------------------------- */

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

static int no_delay(int fd)
{
    const int one = 1;
    setsockopt(fd, IPPROTO_TCP, TCP_NODELAY, &one, sizeof one);
    return fd;
}

bool receive_all(int fd, char *buffer, size_t length)
{
    for (size_t have = 0; have < length;) {
        ssize_t n = recv(fd, buffer + have, length - have, 0);
        if (n <= 0)
            return false;
        have += (size_t)n;
    }
    return true;
}

int listen_somewhere(struct sockaddr_in *at)
{
    socklen_t length = sizeof *at;
    int fd = socket(AF_INET, SOCK_STREAM, 0);

    *at = (struct sockaddr_in){.sin_family = AF_INET, .sin_addr.s_addr = htonl(INADDR_LOOPBACK)};
    if (fd < 0 || bind(fd, (struct sockaddr *)at, sizeof *at) < 0 || listen(fd, 1) < 0 ||
        getsockname(fd, (struct sockaddr *)at, &length) < 0)
        die("cannot make a server on loopback");
    return fd;
}

int connect_to(const struct sockaddr_in *at)
{
    int fd = socket(AF_INET, SOCK_STREAM, 0);

    if (fd < 0 || connect(fd, (const struct sockaddr *)at, sizeof *at) < 0)
        die("cannot connect over loopback");
    return no_delay(fd);
}

int accept_tuned(int listener)
{
    int fd = accept(listener, NULL, NULL);

    return fd < 0 ? fd : no_delay(fd);
}

static void *raw_serve(void *ctx)
{
    const struct raw *r = ctx;
    char buffer[FRAME_MAX];
    int fd = accept_tuned(r->listener);

    if (fd < 0)
        return NULL;
    while (receive_all(fd, buffer, r->frames->request_length) &&
           send(fd, r->frames->reply, r->frames->reply_length, MSG_NOSIGNAL) > 0)
        ;
    close(fd);
    return NULL;
}

static void raw_open(struct raw *r, const struct frames *frames)
{
    struct sockaddr_in at;

    r->frames = frames;
    r->listener = listen_somewhere(&at);
    if (pthread_create(&r->thread, NULL, raw_serve, r) != 0)
        die("cannot start a thread");
    r->fd = connect_to(&at);
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
    const struct keys *keys; /* NULL: tcp: */
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
    static const char *const client = "client";
    const struct apc_server_options options = {.size = sizeof options,
                                               .frame_max = FRAME_MAX,
                                               .identity = e->keys ? e->keys->its : NULL,
                                               .clients = &client,
                                               .n_clients = 1};
    const char *scheme = e->keys ? "tls" : "tcp";
    struct apc_error why;

    snprintf(uri, 64, "%s:127.0.0.1:0", scheme);
    if (apc_server_create(&e->server, uri, &options, fn, e, &why) < 0)
        die("%s", why.text);
    snprintf(uri, 64, "%s:127.0.0.1:%d", scheme, apc_server_port(e->server));
}

static void link_open(struct exchange *e, const struct frames *frames)
{
    const struct apc_link_options options = {
        .size = sizeof options, .frame_max = FRAME_MAX, .identity = e->keys ? e->keys->ours : NULL};
    struct apc_error why;
    char uri[64];

    e->frames = frames;
    serve_plant(e, answer_frame, uri);
    if (apc_link_create(&e->link, uri, &options, &why) < 0)
        die("%s", why.text);
}

static void module_open(struct exchange *e)
{
    struct apc_notice notice;
    struct apc_error why;
    char uri[64];
    const struct apc_exchange_options options = {
        .size = sizeof options, .nu = N, .ny = N, .identity = e->keys ? e->keys->ours : NULL};
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

/* The rows of tcp:, and of tls: where there are keys; @p bare is what they are compared with. */
static void run_frames(struct bench *b, const char *title, const struct frames *frames,
                       const struct keys *keys, struct bench_row bare)
{
    struct exchange link = {.keys = keys}, exchange = {.keys = keys};
    struct bench_row rows[] = {
        bare,
        {.name = "link, frames made beforehand", .once = link_once, .ctx = &link, .to = {&rows[0]}},
        {.name = "exchange, client to plant", .once = exchange_once, .ctx = &exchange, .to = {&rows[0]}},
    };
    if (keys)
        rows[1].goal = "<= 1.15";
    run_on(1);
    link_open(&link, frames);
    module_open(&exchange);
    run_on(0);
    bench_run(b, title, N, rows, sizeof rows / sizeof rows[0]);
    exchange_close(&link);
    exchange_close(&exchange);
}

static void run_tcp(struct bench *b, const struct frames *frames)
{
    struct raw raw;
    char title[64];

    run_on(1);
    raw_open(&raw, frames);
    snprintf(title, sizeof title, "%d values, %zu and %zu bytes", N, frames->request_length,
             frames->reply_length);
    run_frames(b, title, frames, NULL,
               (struct bench_row){.name = "raw ping-pong", .once = raw_once, .ctx = &raw});
    raw_close(&raw);
}

#ifdef APC_TLS
static void run_tls(struct bench *b, const struct frames *frames)
{
    struct bare_tls *bare;
    struct keys keys;

    keys_make(&keys);
    run_on(1);
    bare = bare_tls_open(frames, &keys);
    run_frames(b, "the same by TLS 1.3", frames, &keys,
               (struct bench_row){.name = "OpenSSL alone", .once = bare_tls_once, .ctx = bare});
    bare_tls_close(bare);
    keys_drop(&keys);
}
#else
static void run_tls(struct bench *b, const struct frames *frames)
{
    (void)b, (void)frames;
    puts("no TLS: libssl-dev was not there when this was built\n");
}
#endif

#ifdef APC_LIBMODBUS
static void run_modbus(struct bench *b)
{
    run_on(1);
    struct modbus_bench *m = modbus_open();
    struct bench_row rows[] = {
        {.name = "libmodbus alone", .once = modbus_bare_once, .ctx = m},
        {.name = "exchange by modbus:",
         .once = modbus_ours_once,
         .ctx = m,
         .to = {&rows[0]},
         .goal = "<= 1.05"},
    };
    run_on(0);
    bench_run(b, "10 registers out, 10 in, by Modbus TCP", N, rows, sizeof rows / sizeof rows[0]);
    modbus_close_both(m);
}
#else
static void run_modbus(struct bench *b)
{
    (void)b;
    puts("no Modbus: libmodbus-dev was not there when this was built\n");
}
#endif

int main(int argc, char **argv)
{
    struct bench b = {.name = "link", .reference = {"bare"}, .calls = 2000, .budget = APC_NS_PER_S};
    struct frames frames;

    bench_begin(&b, argc, argv, "Time one exchange of ten values: by TCP, TLS, Modbus.");
    bench_describe(&b, NULL);
    frames.request_length = encode(frames.request, APC_FRAME_COMMAND);
    frames.reply_length = encode(frames.reply, APC_FRAME_VALUES);
    run_tcp(&b, &frames);
    run_tls(&b, &frames);
    run_modbus(&b);
    bench_end(&b);
    return 0;
}

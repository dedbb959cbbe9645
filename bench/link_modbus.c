/* SPDX-License-Identifier: BSD-3-Clause */
/* Ten outputs into holding registers, ten measurements out of input registers: two requests an exchange. */
#include <errno.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include <modbus.h>

#include "link.h"

struct server {
    modbus_t *modbus;
    modbus_mapping_t *map;
    int listener, port;
    pthread_t thread;
};

struct modbus_bench {
    struct server for_bare, for_ours;
    modbus_t *bare;
    struct apc_exchange *ours;
};

static void *serve(void *arg)
{
    struct server *s = arg;
    uint8_t query[MODBUS_TCP_MAX_ADU_LENGTH];
    int n;

    if (modbus_tcp_accept(s->modbus, &s->listener) < 0)
        die("libmodbus cannot accept: %s", modbus_strerror(errno));
    while ((n = modbus_receive(s->modbus, query)) >= 0)
        if (n > 0 && modbus_reply(s->modbus, query, n, s->map) < 0)
            break;
    return NULL;
}

static void server_open(struct server *s)
{
    struct sockaddr_in at;
    socklen_t length = sizeof at;

    s->modbus = modbus_new_tcp("127.0.0.1", 0);
    s->map = modbus_mapping_new(0, 0, N, N);
    if (!s->modbus || !s->map || (s->listener = modbus_tcp_listen(s->modbus, 1)) < 0 ||
        getsockname(s->listener, (struct sockaddr *)&at, &length) < 0)
        die("libmodbus cannot serve: %s", modbus_strerror(errno));
    s->port = ntohs(at.sin_port);
    for (int i = 0; i < N; i++)
        s->map->tab_input_registers[i] = (uint16_t)(1000 + i);
    if (pthread_create(&s->thread, NULL, serve, s) != 0)
        die("cannot start a thread");
}

static void server_close(struct server *s)
{
    pthread_join(s->thread, NULL);
    close(s->listener);
    modbus_close(s->modbus);
    modbus_free(s->modbus);
    modbus_mapping_free(s->map);
}

struct modbus_bench *modbus_open(void)
{
    struct modbus_bench *m = allocate(1, sizeof *m);
    struct apc_modbus_point u[N], y[N];
    struct apc_modbus_options map = {.size = sizeof map, .unit = 1, .u = u, .y = y};
    const struct apc_exchange_options options = {.size = sizeof options, .nu = N, .ny = N, .modbus = &map};
    struct apc_error why;
    char uri[64];

    server_open(&m->for_bare);
    server_open(&m->for_ours);
    m->bare = modbus_new_tcp("127.0.0.1", m->for_bare.port);
    if (!m->bare || modbus_set_slave(m->bare, 1) < 0 || modbus_connect(m->bare) < 0)
        die("libmodbus cannot connect: %s", modbus_strerror(errno));
    for (unsigned i = 0; i < N; i++) {
        u[i] = (struct apc_modbus_point){
            .area = APC_MODBUS_HOLDING, .type = APC_MODBUS_U16, .address = i, .scale = 0.01};
        y[i] = (struct apc_modbus_point){
            .area = APC_MODBUS_INPUT, .type = APC_MODBUS_U16, .address = i, .scale = 0.01};
    }
    snprintf(uri, sizeof uri, "modbus:127.0.0.1:%d", m->for_ours.port);
    if (apc_exchange_open(&m->ours, uri, &options, &why) < 0)
        die("%s", why.text);
    return m;
}

/* With the same numbers as ours has, and their scale. */
void modbus_bare_once(void *ctx)
{
    struct modbus_bench *m = ctx;
    uint16_t registers[N];
    volatile double y[N];

    for (int i = 0; i < N; i++)
        registers[i] = (uint16_t)((1.0 + i) / 0.01 + 0.5);
    if (modbus_write_registers(m->bare, 0, N, registers) != N ||
        modbus_read_input_registers(m->bare, 0, N, registers) != N)
        die("libmodbus: %s", modbus_strerror(errno));
    for (int i = 0; i < N; i++)
        y[i] = registers[i] * 0.01;
    (void)y;
}

void modbus_ours_once(void *ctx)
{
    struct modbus_bench *m = ctx;
    struct apc_value u[N], y[N];

    for (int i = 0; i < N; i++)
        u[i] = (struct apc_value){.value = 1.0 + i};
    if (apc_exchange_begin(m->ours, u, apc_clock_mono(NULL) + APC_NS_PER_S) < 0 ||
        apc_exchange_finish(m->ours, y) < 0)
        die("%s", apc_exchange_error(m->ours));
    if (y[N - 1].value < 10.08 || y[N - 1].value > 10.1)
        die("what was read is not what is there");
}

void modbus_close_both(struct modbus_bench *m)
{
    modbus_close(m->bare);
    modbus_free(m->bare);
    apc_exchange_close(m->ours);
    server_close(&m->for_bare);
    server_close(&m->for_ours);
    free(m);
}

/* SPDX-License-Identifier: BSD-3-Clause */
/*
 * apc-plant: serves a plant over a link: the simulator of the paper, on its own timer. Two threads meet
 * here, the timer's and the server's, in the core that they take turns with.
 *
 * As a Modbus server it asks the same core by the same frames, so that commands from registers are watched,
 * refused and told of as all others.
 */
#include <pthread.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "common/daemon.h"
#include "run/run_internal.h"

#define MODBUS "modbus:"

struct own_options {
    const char *listen;
    char modbus[256];
    bool allow_plaintext;
    struct daemon_options *common;
};

enum { OPT_PLAINTEXT = 0x200, OPT_MODBUS };

static const struct argp_option option_list[] = {
    {"plant", 'p', "NAME", 0, "Model instead of the file's: built in, or ./file.so; its own parameters apply",
     0},
    {"listen", 'l', "URI", 0, "Where to serve instead of where the file says, e.g. tcp:127.0.0.1:43051", 0},
    {"modbus", OPT_MODBUS, "HOST:PORT", 0,
     "Serve Modbus TCP there, in the registers of the file's map; without a map in float32 from holding:0 "
     "and "
     "input:0 on",
     0},
    {"allow-plaintext", OPT_PLAINTEXT, NULL, 0, "Serve beyond this host without encryption", 0},
    {0},
};

static error_t parse(int key, char *arg, struct argp_state *state)
{
    struct own_options *o = state->input;
    switch (key) {
    case 'p':
        o->common->overrides.model = arg;
        break;
    case 'l':
        o->listen = arg;
        break;
    case OPT_MODBUS:
        if (snprintf(o->modbus, sizeof o->modbus, MODBUS "%s", arg) >= (int)sizeof o->modbus)
            argp_error(state, "--modbus takes HOST:PORT, not %.40s...", arg);
        o->listen = o->modbus;
        break;
    case OPT_PLAINTEXT:
        o->allow_plaintext = true;
        break;
    default:
        return ARGP_ERR_UNKNOWN;
    }
    return 0;
}

static const struct argp extra = {option_list, parse, NULL, NULL, NULL, NULL, NULL};

static const struct program program = {
    .name = "apc-plant",
    .doc = "Simulate a plant in real time and serve it over the network.",
    .task = "plant",
    .parts = EXPERIMENT_MODEL,
    .store_optional = true,
    .extra = &extra,
};

struct shell {
    struct daemon *d;
    pthread_mutex_t mutex; /* of the core; inherits priority, so the server cannot hold the timer up */
    struct apc_plant *plant;
    struct apc_plantserver *core;
    struct apc_server *server;
    unsigned ticks;    /* under the mutex */
    struct registers { /* of a Modbus server; the server's thread's */
        struct apc_modbus_unit *unit;
        struct apc_modbus_point *points; /* where the file has no map */
        struct apc_sample *samples;      /* [max(nu, ny)] */
        char *request, *reply;           /* frames of @room bytes */
        size_t room;
        uint64_t connection, id;
        apc_ns stamp; /* of the last sign of life */
    } registers;
};

static int on_tick(void *ctx, const struct apc_tick *tick)
{
    struct shell *s = ctx;
    const struct apc_now now = {.mono = tick->scheduled, .utc = tick->utc};
    struct apc_notice notice = {0};

    pthread_mutex_lock(&s->mutex);
    (void)apc_plantserver_tick(s->core, now, &notice); /* that it fails the notice says, once */
    s->ticks++;
    pthread_mutex_unlock(&s->mutex);
    daemon_notice(s->d, &notice);
    return 0;
}

/* Who they are only the server knows. */
static void tell_of_rivals(struct shell *s, uint64_t refused)
{
    char one[APC_PEER_LEN], other[APC_PEER_LEN];
    pthread_mutex_lock(&s->mutex);
    const uint64_t commander = apc_plantserver_commander(s->core);
    pthread_mutex_unlock(&s->mutex);
    daemon_event(
        s->d, APC_EVENT_ALARM, "rejected",
        "two clients command the plant and take it from each other: %.60s (now) and %.60s (now refused); "
        "stop one",
        apc_server_peer(s->server, commander, one), apc_server_peer(s->server, refused, other));
}

static int on_request(void *ctx, uint64_t connection, const char *request, size_t length, char *reply,
                      size_t size)
{
    struct shell *s = ctx;
    const struct apc_now now = {.mono = apc_clock_mono(NULL), .utc = apc_clock_utc(NULL)};
    struct apc_notice notice = {0};

    pthread_mutex_lock(&s->mutex);
    int rc = apc_plantserver_request(s->core, now, connection, request, length, reply, size, &notice);
    pthread_mutex_unlock(&s->mutex);
    if (notice.kind == APC_NOTICE_RIVALS)
        tell_of_rivals(s, connection);
    else
        daemon_notice(s->d, &notice);
    return rc;
}

/* ---- Registers ------------------------------------------------------------------------------- */

/* Of Modbus's exceptions those that this plant gives itself. */
enum { ILLEGAL_VALUE = 3, DEVICE_FAILURE, DEVICE_BUSY = 6 };

/* One frame to the core: 0 or its refusal, with the values of its reply in samples. */
static int ask(struct shell *s, int kind, size_t n)
{
    struct registers *r = &s->registers;
    struct apc_frame frame = {.kind = kind, .id = ++r->id, .n = n};
    int length = apc_frame_encode(r->request, r->room, &frame, r->samples);
    if (length > 0)
        length = on_request(s, r->connection, r->request, (size_t)length, r->reply, r->room);
    return length > 0
               ? apc_frame_decode(r->reply, (size_t)length, &frame, r->samples, s->d->experiment.dim.ny)
               : length;
}

static int command(void *ctx, const double *u, bool alive)
{
    struct shell *s = ctx;
    const struct experiment *e = &s->d->experiment;
    bool within = true;

    if (alive || !s->registers.stamp)
        s->registers.stamp = apc_clock_utc(NULL);
    for (size_t i = 0; i < e->dim.nu; i++) {
        s->registers.samples[i] = (struct apc_sample){.time = s->registers.stamp, .value = u[i]};
        within = within && u[i] >= e->u[i].tag.low && u[i] <= e->u[i].tag.high;
    }
    int rc = ask(s, APC_FRAME_COMMAND, e->dim.nu);
    if (rc == APC_EPERM)
        return DEVICE_BUSY;
    if (rc < 0 && rc != APC_EINVAL)
        return DEVICE_FAILURE;
    return within && rc == 0 ? 0 : ILLEGAL_VALUE;
}

static unsigned measure(void *ctx, struct apc_value *y)
{
    struct shell *s = ctx;
    int rc = ask(s, APC_FRAME_QUERY, 0);

    for (size_t i = 0; i < s->d->experiment.dim.ny; i++) {
        const struct apc_sample *from = &s->registers.samples[i];
        y[i] = rc == 0 ? (struct apc_value){.time = from->time, .status = from->status, .value = from->value}
                       : (struct apc_value){.status = APC_BAD_DEVICE_FAILURE};
    }
    pthread_mutex_lock(&s->mutex);
    const unsigned ticks = s->ticks;
    pthread_mutex_unlock(&s->mutex);
    return ticks;
}

static int on_registers(void *ctx, uint64_t connection, const char *request, size_t length, char *reply,
                        size_t size)
{
    struct shell *s = ctx;
    s->registers.connection = connection;
    return apc_modbus_unit_answer(s->registers.unit, request, length, reply, size);
}

/* Of a file that says nothing of registers: each vector in its order, in the type that holds any of it. */
static int plain_map(struct shell *s, struct apc_modbus_options *map)
{
    const struct experiment *e = &s->d->experiment;
    const size_t n = e->dim.nu + e->dim.ny;
    struct apc_modbus_point *p = calloc(n, sizeof *p);

    s->registers.points = p;
    if (!p)
        return APC_ENOMEM;
    for (size_t i = 0; i < n; i++) {
        const bool output = i < e->dim.nu;
        p[i] = (struct apc_modbus_point){.area = output ? APC_MODBUS_HOLDING : APC_MODBUS_INPUT,
                                         .type = APC_MODBUS_F32,
                                         .address = 2 * (unsigned)(output ? i : i - e->dim.nu)};
    }
    *map = (struct apc_modbus_options){.size = sizeof *map, .unit = 1, .u = p, .y = p + e->dim.nu};
    apc_log_write(
        s->d->log, APC_LOG_INFO,
        "unit 1, float32, high word first: %s at holding:0 and every second register on, %s at input:0 "
        "and on",
        e->u[0].tag.name, e->y[0].tag.name);
    return 0;
}

static int open_registers(struct shell *s, struct apc_error *why)
{
    const struct experiment *e = &s->d->experiment;
    struct registers *r = &s->registers;
    const size_t most = e->dim.nu > e->dim.ny ? e->dim.nu : e->dim.ny;
    struct apc_modbus_options map = e->client.modbus;
    double *initial = calloc(e->dim.nu, sizeof *initial);

    r->room = APC_FRAME_ROOM(most);
    r->samples = calloc(most, sizeof *r->samples);
    r->request = malloc(r->room);
    r->reply = malloc(r->room);
    int rc = initial && r->samples && r->request && r->reply ? 0 : APC_ENOMEM;
    if (rc == 0 && !map.size)
        rc = plain_map(s, &map);
    for (size_t i = 0; i < e->dim.nu && rc == 0; i++)
        initial[i] = e->u[i].initial;
    if (rc == 0)
        rc = apc_modbus_unit_create(
            &r->unit,
            &(struct apc_modbus_unit_options){.size = sizeof(struct apc_modbus_unit_options),
                                              .nu = e->dim.nu,
                                              .ny = e->dim.ny,
                                              .modbus = &map,
                                              .initial = initial,
                                              .command = command,
                                              .measure = measure,
                                              .ctx = s},
            why);
    else
        snprintf(why->text, sizeof why->text, "out of memory");
    free(initial);
    return rc;
}

static void close_registers(struct registers *r)
{
    apc_modbus_unit_destroy(r->unit);
    free(r->points);
    free(r->samples);
    free(r->request);
    free(r->reply);
}

/* ---- The program ----------------------------------------------------------------------------- */

static int open_server(struct shell *s, const char *at, bool allow_plaintext, struct apc_error *why)
{
    const struct experiment *e = &s->d->experiment;
    const bool modbus = !strncmp(at, MODBUS, sizeof MODBUS - 1);
    struct apc_server_options options = {
        .size = sizeof options,
        .frame_max = APC_FRAME_ROOM(e->dim.nu > e->dim.ny ? e->dim.nu : e->dim.ny),
        .allow_plaintext = allow_plaintext,
        .log = s->d->log,
    };
    char tcp[sizeof(((struct own_options *)0)->modbus)];

    if (modbus) {
        int rc = open_registers(s, why);
        if (rc < 0)
            return rc;
        options.whole = apc_modbus_whole;
        options.frame_max = APC_MODBUS_FRAME;
        snprintf(tcp, sizeof tcp, "tcp:%s", at + sizeof MODBUS - 1);
        at = tcp;
    }
    return apc_server_create(&s->server, at, &options, modbus ? on_registers : on_request, s, why);
}

static int open_shell(struct shell *s, const struct own_options *own)
{
    const struct experiment *e = &s->d->experiment;
    struct apc_error why;
    int rc = cores_plant(e, &s->plant, &s->core, &why);
    if (rc < 0)
        return daemon_error(s->d, rc, "%s", why.text);
    rc = open_server(s, own->listen ? own->listen : e->plant.listen, own->allow_plaintext, &why);
    if (rc == APC_EPERM)
        daemon_error(s->d, rc, "%s: --allow-plaintext", why.text);
    else if (rc < 0)
        daemon_error(s->d, rc, "%s%s", why.text,
                     rc == APC_ESYS
                         ? " (in the experiment file: \"listen\" of the plant, and \"link\" of the client)"
                         : "");
    return rc;
}

static void close_shell(struct shell *s)
{
    apc_server_destroy(s->server);
    close_registers(&s->registers);
    apc_plantserver_destroy(s->core);
    apc_plant_destroy(s->plant);
}

int main(int argc, char **argv)
{
    struct daemon d;
    struct own_options own = {.common = &d.options};
    struct shell s = {.d = &d};
    int rc = apc_mutex_init(&s.mutex);
    if (rc == 0)
        rc = daemon_open(&d, &program, &own, argc, argv);
    if (rc == 0)
        rc = open_shell(&s, &own);
    if (rc == 0)
        rc = daemon_run(&d, d.experiment.plant.rhythm, on_tick, &s);
    close_shell(&s);
    return daemon_close(&d, rc);
}

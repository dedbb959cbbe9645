/* SPDX-License-Identifier: BSD-3-Clause */
/*
 * apc-plant: serves a plant over a link: the simulator of the paper, on its own timer. Two threads meet
 * here, the timer's and the server's, in the core that they take turns with.
 */
#include <sched.h>
#include <stdio.h>
#include <string.h>

#include "plant.h"

#define MODBUS "modbus:"
#define SERIAL "serial:"

#define CLIENTS_MAX   32
#define LINK_PRIORITY 79 /* the task's is 80 */

struct own_options {
    const char *listen;
    char modbus[URI_LEN];
    bool allow_plaintext;
    const char *identity, *clients[CLIENTS_MAX];
    size_t n_clients;
    struct daemon_options *common;
};

static void take_model(void *to, char *arg, const struct argp_state *state)
{
    struct daemon_options **common = to;
    (void)state;
    (*common)->overrides.model = arg;
}

static void take_modbus(void *to, char *arg, const struct argp_state *state)
{
    struct own_options *o = to;
    if (snprintf(o->modbus, sizeof o->modbus, MODBUS "%s", arg) >= (int)sizeof o->modbus)
        argp_error(state, "--modbus takes HOST:PORT, not %.40s...", arg);
    o->listen = o->modbus;
}

static void take_client(void *to, char *arg, const struct argp_state *state)
{
    struct own_options *o = to;
    if (o->n_clients == CLIENTS_MAX)
        argp_error(state, "--client may be given %d times at most", CLIENTS_MAX);
    o->clients[o->n_clients++] = arg;
}

#define AT(member) .to = offsetof(struct own_options, member)
static const struct option_spec own_options[] = {
    {"plant", 'p', "NAME", "Model instead of the file's: built in, or ./file.so; its own parameters apply",
     OPTION_OWN, AT(common), .take = take_model},
    {"listen", 'l', "URI",
     "Address to serve at, instead of the file's, e.g. tcp:127.0.0.1:43051, or tls:0.0.0.0:43051",
     OPTION_TEXT, AT(listen)},
    {"modbus", 0, "HOST:PORT",
     "Serve Modbus TCP at HOST:PORT, in the registers of the file's map; without a map in float32 from "
     "holding:0 and input:0 on",
     OPTION_OWN, .take = take_modbus},
    {"identity", 0, "FILE", "Identity of this plant on tls:, made by `apc cert plant` [APC_IDENTITY]",
     OPTION_TEXT, AT(identity)},
    {"client", 0, "NAME",
     "A client that may connect and command on tls:, by the name in its certificate, instead of the file's; "
     "may be repeated. All others are rejected",
     OPTION_OWN, .take = take_client},
    {"allow-plaintext", 0, NULL, "Serve beyond this host without encryption", OPTION_FLAG,
     AT(allow_plaintext)},
    {0},
};

static const struct program program = {
    .name = "apc-plant",
    .doc = "Simulate a plant in real time and serve it over the network.",
    .task = "plant",
    .parts = EXPERIMENT_MODEL,
    .store_optional = true,
    .extra = own_options,
};

/* One that can be solved, and cannot, again and again, is counted instead of told of each time. */
static void tell_plant_notice(struct shell *s, const struct apc_notice *notice, apc_ns tripped)
{
    const bool of_solving = notice->kind == APC_NOTICE_FAILED || notice->kind == APC_NOTICE_RECOVERED;
    const bool solved = of_solving ? notice->kind == APC_NOTICE_RECOVERED : s->solved.up;
    const enum state_change change = state_watch_look(&s->solved, solved, apc_clock_mono(NULL));

    if (!of_solving || change == CHANGE_ONE)
        daemon_notice_at(s->d, notice, notice->kind == APC_NOTICE_TRIP ? tripped : apc_clock_mono(NULL));
    if (change == CHANGE_MANY || (change == CHANGE_ONE && !of_solving))
        daemon_event(s->d, solved ? APC_EVENT_INFO : APC_EVENT_ALARM, "measurement",
                     "the plant could not be solved, and could again: %u changes meanwhile; now it %s",
                     s->solved.count, solved ? "can" : "cannot");
}

static int on_plant_tick(void *ctx, const struct apc_tick *tick)
{
    struct shell *s = ctx;
    const struct apc_now now = {.mono = tick->scheduled, .utc = tick->utc};
    struct apc_notice notice = {0};

    pthread_mutex_lock(&s->mutex);
    (void)apc_plantserver_tick(s->core, now, &notice); /* that it fails the notice says, once */
    const apc_ns tripped = apc_plantserver_watchdog(s->core)->tripped;
    s->ticks++;
    pthread_mutex_unlock(&s->mutex);
    tell_plant_notice(s, &notice, tripped);
    return 0;
}

/* Who they are only the server knows. */
static void tell_of_rivals(struct shell *s, const struct apc_notice *notice, uint64_t refused)
{
    char one[APC_PEER_LEN], other[APC_PEER_LEN];
    pthread_mutex_lock(&s->mutex);
    const uint64_t commander = apc_plantserver_commander(s->core);
    pthread_mutex_unlock(&s->mutex);
    (void)apc_server_peer(s->server, commander, one);
    (void)apc_server_peer(s->server, refused, other);
    if (notice->kind == APC_NOTICE_RIVALS)
        daemon_event(s->d, APC_EVENT_ALARM, "rejected",
                     "two clients command the plant and take it from each other: %.60s (now) and %.60s (now "
                     "refused); stop one",
                     one, other);
    else
        daemon_event(s->d, APC_EVENT_ALARM, "rejected", "%.48s (while %.48s commands): %s", other, one,
                     notice->text);
}

/* Where the task may, the link waits for no less: a plant that ticks and does not answer is no plant. */
static void hurry(struct shell *s)
{
    const struct sched_param param = {.sched_priority = LINK_PRIORITY};
    if (!s->hurries)
        pthread_setschedparam(pthread_self(), SCHED_FIFO, &param);
    s->hurries = true;
}

int on_plant_request(void *ctx, uint64_t connection, const char *request, size_t length, char *reply,
                     size_t size)
{
    struct shell *s = ctx;
    const struct apc_now now = {.mono = apc_clock_mono(NULL), .utc = apc_clock_utc(NULL)};
    struct apc_notice notice = {0};

    hurry(s);
    pthread_mutex_lock(&s->mutex);
    int rc = apc_plantserver_request(s->core, now, connection, request, length, reply, size, &notice);
    const apc_ns tripped = apc_plantserver_watchdog(s->core)->tripped;
    pthread_mutex_unlock(&s->mutex);
    if (notice.kind == APC_NOTICE_RIVALS || notice.kind == APC_NOTICE_FENCED)
        tell_of_rivals(s, &notice, connection);
    else
        daemon_notice_at(s->d, &notice, notice.kind == APC_NOTICE_TRIP ? tripped : now.mono);
    return rc;
}

/* ---- The program ----------------------------------------------------------------------------- */

static int open_server(struct shell *s, const char *at, const struct own_options *own, struct apc_error *why)
{
    const struct experiment *e = &s->d->experiment;
    const bool modbus = !strncmp(at, MODBUS, sizeof MODBUS - 1);
    struct apc_server_options options = {
        .size = sizeof options,
        .frame_max = APC_FRAME_ROOM(e->dim.nu > e->dim.ny ? e->dim.nu : e->dim.ny),
        .allow_plaintext = own->allow_plaintext,
        .log = s->d->log,
        .identity = s->credentials.identity,
        .clients = own->n_clients ? own->clients : e->plant.clients,
        .n_clients = own->n_clients ? own->n_clients : e->plant.n_clients,
    };
    char tcp[URI_LEN];

    if (!strncmp(at, SERIAL, sizeof SERIAL - 1))
        return board_open(s, at + sizeof SERIAL - 1, why);
    if (modbus) {
        int rc = registers_open(s, why);
        if (rc < 0)
            return rc;
        options.whole = apc_modbus_whole;
        options.frame_max = APC_MODBUS_FRAME;
        snprintf(tcp, sizeof tcp, "tcp:%s", at + sizeof MODBUS - 1);
        at = tcp;
    }
    return apc_server_create(&s->server, at, &options, modbus ? registers_answer : on_plant_request, s, why);
}

static int open_plant_server(struct shell *s, const struct own_options *own)
{
    const struct experiment *e = &s->d->experiment;
    const char *at = own->listen ? own->listen : e->plant.listen;
    struct apc_error why;
    s->d->experiment.plant.options.patience = apc_ns_to_s(e->plant.rhythm.period) / 2;
    int rc = module_plant(e, &s->plant, &s->core, &why);
    if (rc < 0)
        return daemon_error(s->d, rc, "%s", why.text);
    rc = credentials_open(&s->credentials, s->d, at, own->identity ? own->identity : e->plant.identity);
    if (rc < 0)
        return rc;
    rc = open_server(s, at, own, &why);
    if (rc == APC_EPERM)
        daemon_error(s->d, rc, "%s: --allow-plaintext", why.text);
    else if (rc < 0)
        daemon_error(s->d, rc, "%s%s", why.text,
                     rc == APC_ESYS
                         ? " (in the experiment file: \"listen\" of the plant, and \"link\" of the client)"
                         : "");
    return rc;
}

static void close_plant(struct shell *s)
{
    apc_server_destroy(s->server);
    credentials_close(&s->credentials);
    board_close(s);
    registers_close(s);
    gateway_close(s);
    apc_plantserver_destroy(s->core);
    apc_plant_destroy(s->plant);
}

int main(int argc, char **argv)
{
    struct daemon d;
    struct own_options own = {.common = &d.options};
    struct shell s = {.d = &d, .solved.up = true};
    int rc = apc_mutex_init(&s.mutex);
    if (rc == 0)
        rc = daemon_open(&d, &program, &own, argc, argv);
    if (rc == 0)
        rc = open_plant_server(&s, &own);
    if (rc == 0)
        rc = daemon_run(&d, d.experiment.plant.rhythm, on_plant_tick, &s);
    close_plant(&s);
    return daemon_close(&d, rc);
}

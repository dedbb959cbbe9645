/* SPDX-License-Identifier: BSD-3-Clause */
/*
 * apc-client: moves the newest actuator samples to the plant and the plant's measurements into the
 * shared data, once a period.
 */
#include <stdatomic.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "common/cores.h"
#include "common/daemon.h"
#include "common/recorder.h"

struct own_options {
    const char *link;
};

static const struct argp_option option_list[] = {
    {"link", 'l', "URI", 0, "The plant, instead of where the file says, e.g. tcp:127.0.0.1:43051", 0},
    {0},
};

static error_t parse(int key, char *arg, struct argp_state *state)
{
    struct own_options *o = state->input;
    if (key != 'l')
        return ARGP_ERR_UNKNOWN;
    o->link = arg;
    return 0;
}

static const struct argp extra = {option_list, parse, NULL, NULL, NULL, NULL, NULL};

static const struct program program = {
    .name = "apc-client",
    .doc = "Move data between the plant and the shared data.",
    .task = "client",
    .spools = "measurements",
    .extra = &extra,
};

struct shell {
    struct daemon *d;
    struct apc_store *store;
    struct apc_link *link;
    struct apc_client *core;
    apc_ns patience; /* for one exchange */
    size_t frame_max;
    char *request;
    struct apc_sample *u, *read; /* newest known; scratch */
    bool know_u;                 /* u was read once */
    struct apc_sample *y;        /* [ny] of this tick */
    uint64_t lost;
    bool link_up, store_up;
    struct apc_histogram *round_trip;
    _Atomic uint64_t failed; /* exchanges */
};

/* Say a change of state once, not every tick. */
static void report(struct shell *s, bool *state, bool up, const char *kind, const char *what, const char *why)
{
    if (*state != up)
        daemon_event(s->d, up ? APC_EVENT_INFO : APC_EVENT_WARNING, kind, "%s %s%s%s", what,
                     up ? "connected" : "lost, trying again", *why ? ": " : "", why);
    *state = up;
}

/* Returns how many measurements came. */
static size_t exchange(struct shell *s, const struct apc_tick *tick, const struct apc_sample *u)
{
    const struct apc_now now = {.mono = tick->started, .utc = tick->utc};
    const char *reply;
    int n = apc_client_request(s->core, now, u, s->request, s->frame_max);
    if (n < 0) {
        daemon_event(s->d, APC_EVENT_ALARM, "link", "the command does not fit into a frame of %zu bytes",
                     s->frame_max);
        return 0;
    }
    const apc_ns sent = apc_clock_mono(NULL);
    n = apc_link_exchange(s->link, s->request, (size_t)n, &reply, sent + s->patience);
    if (n < 0) {
        atomic_fetch_add(&s->failed, 1);
        report(s, &s->link_up, false, "link", "plant", apc_link_error(s->link));
        return 0;
    }
    apc_histogram_record(s->round_trip, apc_clock_mono(NULL) - sent);
    n = apc_client_reply(s->core, reply, (size_t)n, s->y);
    if (n < 0) {
        atomic_fetch_add(&s->failed, 1);
        report(s, &s->link_up, false, "link", "plant", "its reply does not answer the request");
        apc_link_reset(s->link);
        return 0;
    }
    report(s, &s->link_up, true, "link", "plant", "");
    return (size_t)n;
}

static int read_u(struct shell *s)
{
    size_t nu = s->d->experiment.dim.nu;
    int rc = apc_store_read(s->store, s->read, nu);
    if (rc >= 0) {
        memcpy(s->u, s->read, nu * sizeof *s->u);
        s->know_u = true;
    }
    return rc;
}

/* The store, or else the spool, takes them, or they are lost: a measurement belongs to its instant. */
static int append(struct shell *s, size_t n)
{
    int rc = apc_store_append(s->store, s->y, n);
    if (rc == APC_EBUSY || rc == APC_ECONFLICT || rc == APC_ESCHEMA) /* the end, which says why */
        return rc;
    if (rc < 0) {
        if (s->lost == 0)
            daemon_event(s->d, APC_EVENT_ALARM, "store", "measurements are being lost: %.150s",
                         apc_store_error(s->store));
        s->lost += n;
        return rc;
    }
    if (s->lost > 0)
        daemon_event(s->d, APC_EVENT_ALARM, "store", "%llu measurements were lost",
                     (unsigned long long)s->lost);
    s->lost = 0;
    return (size_t)rc == n ? 0 : APC_ECONFLICT; /* none was sent before: those there are somebody else's */
}

/*
 * The exchange never waits for a store that is away: connecting comes after it, since looking up the store's
 * name may take its time. Meanwhile the last known u goes on being sent; the core stops it when it is too
 * old.
 */
static int on_tick(void *ctx, const struct apc_tick *tick)
{
    struct shell *s = ctx;
    bool connected = apc_store_connected(s->store);
    int rc = connected ? read_u(s) : 0;
    size_t n = exchange(s, tick, s->know_u ? s->u : NULL);
    if (!connected)
        rc = apc_store_connect(s->store);
    int wrote = n > 0 ? append(s, n) : 0;
    bool up = rc >= 0 && wrote >= 0 && apc_store_connected(s->store);
    report(s, &s->store_up, up, "store", "store", up ? "" : apc_store_error(s->store));
    daemon_spool(s->d, s->store);
    return daemon_fatal(s->d, s->store, wrote < 0 ? wrote : rc);
}

/* A store that hangs must not keep the link from its frames: one wait of this and an exchange stay well
 * within the plant's three periods. Connecting takes some tens of milliseconds, so no less than that. */
static apc_ns store_timeout(apc_ns period)
{
    const apc_ns least = 250 * APC_NS_PER_MS, most = 2 * APC_NS_PER_S;
    return period < least ? least : period > most ? most : period;
}

static int open_shell(struct shell *s, const struct own_options *own)
{
    const struct experiment *e = &s->d->experiment;
    const apc_ns period = e->client.rhythm.period;
    struct apc_error why;
    int64_t *last = calloc(e->dim.ny, sizeof *last);

    s->patience = cores_patience(e);
    s->frame_max = cores_frame_max(e);
    s->request = calloc(1, s->frame_max);
    s->u = calloc(e->dim.nu, sizeof *s->u);
    s->read = calloc(e->dim.nu, sizeof *s->read);
    s->y = calloc(e->dim.ny, sizeof *s->y);
    int rc =
        s->request && s->u && s->read && s->y && last ? apc_histogram_create(&s->round_trip) : APC_ENOMEM;
    if (rc == 0)
        recorder_measure(s->d->recorder, TASK_EXCHANGE, s->round_trip, &s->failed);
    for (size_t i = 0; i < e->dim.nu && rc == 0; i++)
        s->read[i] = (struct apc_sample){.table = APC_ACTUATOR, .id = (int)i + 1};
    s->d->store_timeout = store_timeout(period);
    if (rc == 0)
        rc = daemon_store(s->d, &s->store, APC_SENSOR, e->dim.ny, last);
    if (rc == 0) {
        const struct apc_link_options options = {.size = sizeof options, .frame_max = s->frame_max};
        rc = apc_link_create(&s->link, own->link ? own->link : e->client.link, &options, &why);
        if (rc < 0)
            daemon_error(s->d, rc, "%s", why.text);
    }
    if (rc == 0 && (rc = cores_client(e, last, s->d->start, &s->core, &why)) < 0)
        daemon_error(s->d, rc, "%s", why.text);
    free(last);
    return rc;
}

static void close_shell(struct shell *s)
{
    apc_client_destroy(s->core);
    apc_link_destroy(s->link);
    apc_store_close(s->store);
    apc_histogram_destroy(s->round_trip);
    free(s->request);
    free(s->u);
    free(s->read);
    free(s->y);
}

int main(int argc, char **argv)
{
    struct daemon d;
    struct own_options own = {0};
    struct shell s = {.d = &d, .store_up = true, .link_up = true};
    int rc = daemon_open(&d, &program, &own, argc, argv);
    if (rc == 0)
        rc = open_shell(&s, &own);
    if (rc == 0)
        rc = daemon_run(&d, d.experiment.client.rhythm, on_tick, &s);
    close_shell(&s);
    return daemon_close(&d, rc);
}

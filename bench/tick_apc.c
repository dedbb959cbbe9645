/* SPDX-License-Identifier: BSD-3-Clause */
/* A controller's tick with libapc: the store alone, and the whole of what apc-controller does. */
#include <stdlib.h>

#include "bench.h"
#include "tick.h"

#define PERIOD (3600 * APC_NS_PER_S) /* nobody writes sensors meanwhile; they must not be stale */

struct apc_store *tick_open_store(const char *schema)
{
    struct apc_store *store;
    struct apc_error why;
    char uri[64];
    const struct apc_store_options options = {
        .size = sizeof options, .name = "bench", .timeout = 60 * APC_NS_PER_S};

    snprintf(uri, sizeof uri, "postgresql:#%s", schema);
    if (apc_store_open(&store, uri, &options, &why) < 0)
        die("%s", why.text);
    return store;
}

static void check(struct apc_store *store, int rc)
{
    if (rc < 0)
        die("%s", apc_store_error(store));
}

static struct apc_sample *fill(struct apc_sample *at, enum apc_table table, int first, size_t n)
{
    for (size_t i = 0; i < n; i++)
        *at++ =
            (struct apc_sample){.table = table, .id = first + (int)i, .seq = 1, .time = apc_clock_utc(NULL)};
    return at;
}

void store_prepare(struct apc_store *store, size_t n)
{
    const size_t n_tuning = apc_law_pi.n_tuning, count = 4 + n * (n_tuning + 2);
    struct apc_sample *samples = allocate(count, sizeof *samples), *mode = samples, *dim = mode + 1 + n,
                      *tuning = dim + 3;

    check(store, apc_store_init(store));
    (void)fill(fill(fill(fill(mode, APC_OPMODE, 0, 1 + n), APC_DIM, 1, 3), APC_TUNING, 1, n * n_tuning),
               APC_MANUAL, 1, n);
    for (size_t i = 0; i <= n; i++)
        mode[i].value = APC_MODE_AUTO;
    for (size_t i = 0; i < 3; i++)
        dim[i].value = (double)n;
    for (size_t i = 0; i < n * n_tuning; i++)
        tuning[i].value = apc_law_pi.tuning[i % n_tuning].initial;
    check(store, apc_store_append(store, samples, count));
    free(samples);
}

/* ---- The store alone ----------------------------------------------------------------------- */

struct store {
    struct apc_store *store;
    size_t n;
    struct apc_sample *in, *out; /* mode, tuning, n sensors, n setpoints; n actuators */
    double *integral;
};

struct store *store_open(const char *schema, size_t n)
{
    struct store *s = allocate(1, sizeof *s);
    int64_t *last = allocate(n, sizeof *last);

    s->store = tick_open_store(schema);
    s->n = n;
    s->in = allocate(1 + TUNING + 2 * n, sizeof *s->in);
    s->out = allocate(n, sizeof *s->out);
    s->integral = allocate(n, sizeof *s->integral);
    struct apc_sample *at = fill(fill(s->in, APC_OPMODE, 0, 1), APC_TUNING, 1, TUNING);
    fill(fill(at, APC_SENSOR, 1, n), APC_SETPOINT, 1, n);
    fill(s->out, APC_ACTUATOR, 1, n);
    check(s->store, apc_store_claim(s->store, APC_ACTUATOR, n, last));
    for (size_t i = 0; i < n; i++)
        s->out[i].seq = last[i];
    free(last);
    return s;
}

void store_once(void *ctx)
{
    struct store *s = ctx;
    const struct apc_sample *tuning = s->in + 1, *y = tuning + TUNING, *z = y + s->n;

    check(s->store, apc_store_read(s->store, s->in, 1 + TUNING + 2 * s->n));
    if (s->in[0].value != (double)APC_MODE_AUTO)
        die("the stored mode is not Auto");
    const apc_ns now = apc_clock_utc(NULL);
    const double Kp = tuning[0].value, tau_i = tuning[1].value;
    for (size_t i = 0; i < s->n; i++) {
        s->out[i].value = Kp * (z[i].value - y[i].value) + s->integral[i];
        s->out[i].time = now;
        s->out[i].seq++;
    }
    int rows = apc_store_append(s->store, s->out, s->n);
    check(s->store, rows);
    if ((size_t)rows != s->n)
        die("of %zu rows only %d were new", s->n, rows);
    for (size_t i = 0; i < s->n; i++)
        s->integral[i] += Kp * TS / tau_i * (z[i].value - y[i].value);
}

void store_close(struct store *s)
{
    apc_store_close(s->store);
    free(s->in);
    free(s->out);
    free(s->integral);
    free(s);
}

/* ---- The controller ------------------------------------------------------------------------ */

static struct apc_controller *make_core(size_t n)
{
    struct apc_controller *core;
    struct apc_error why;
    const struct apc_controller_options options = {
        .size = sizeof options,
        .law = &apc_law_pi,
        .dim = {.ny = n, .nz = n, .nu = n, 0},
        .period = (apc_ns)(TS * 1e9),
        .horizon = PERIOD,
    };

    if (apc_controller_create(&core, &options, &why) < 0)
        die("%s", why.text);
    return core;
}

size_t control_row(size_t n)
{
    struct apc_controller *core = make_core(n);
    size_t sum = 0, offset, length;
    const char *name;

    for (size_t field = 0; apc_controller_tick_field(core, field, &name, &offset, &length); field++)
        sum += length;
    apc_controller_destroy(core);
    return sum;
}

struct control *control_open(struct apc_store *store, size_t n)
{
    struct control *c = allocate(1, sizeof *c);
    struct apc_sample *mine = allocate(n + 1, sizeof *mine);

    c->core = make_core(n);
    c->store = store;
    for (size_t i = 0; i < n; i++)
        mine[i] = (struct apc_sample){.table = APC_ACTUATOR, .id = (int)i + 1};
    mine[n] = (struct apc_sample){.table = APC_TICK, .id = 1};
    check(c->store, apc_store_claim_set(c->store, mine, n + 1));
    check(c->store, apc_store_read_rows(c->store, apc_controller_former(c->core)));
    apc_controller_resume(c->core, 0);
    free(mine);
    return c;
}

void control_once(void *ctx)
{
    struct control *c = ctx;
    const struct apc_rows *out = apc_controller_out(c->core);
    struct apc_notice notice;

    check(c->store, apc_store_read_rows(c->store, apc_controller_in(c->core)));
    const struct apc_now now = {.mono = apc_clock_mono(NULL), .utc = apc_clock_utc(NULL)};
    int n = apc_controller_compute(c->core, now, c->tick++, true, &notice);
    if (out->n_samples < 1 || out->sample[0].table != APC_ACTUATOR || out->sample[0].status != APC_GOOD)
        die("the controller does not control: %s", notice.kind ? notice.text : "no notice");
    int rows = apc_store_append_rows(c->store, out);
    check(c->store, rows);
    if (rows != n)
        die("of %d rows only %d were new", n, rows);
    apc_controller_update(c->core, 1);
}

void control_close(struct control *c)
{
    apc_controller_destroy(c->core);
    apc_store_close(c->store);
    free(c);
}

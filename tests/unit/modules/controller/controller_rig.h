/* SPDX-License-Identifier: BSD-3-Clause */
/* A controller of one loop, with what the store holds for it. */
#ifndef APC_TEST_CONTROLLER_RIG_H
#define APC_TEST_CONTROLLER_RIG_H

#include <string.h>

#include "check.h"
#include "modules/controller.h"

#define S       APC_NS_PER_S
#define T0      (INT64_C(1700000000) * S)
#define PERIOD  (2 * S)
#define HORIZON (5 * S)
#define HOLD    (6 * S)
#define FAULT   (-0.7)
#define MAX_OUT 64
#define MAX_ROW 64

/* As in in(), for one measurement, one setpoint, one output of the PI. */
enum { Y, Z, MODE, MANUAL, KP, TAU_I, U_BAR, U_MIN, U_MAX, WRITTEN, INPUTS };

/* A controller, what the store holds for it, and what it gave at the last tick. */
struct rig {
    struct apc_controller *controller;
    struct apc_sample in[INPUTS + 8], out[MAX_OUT], actual[MAX_OUT];
    size_t n, n_actual; /* of out; of actual: all rows that ever were, the newest of each */
    double row[MAX_ROW];
    struct apc_vector tick;
    struct apc_notice notice;
    apc_ns mono, utc_step;
    uint64_t index;
};

static const struct apc_sample none;

/* The row of the last tick; one with seq 0 when there was none. */
static const struct apc_sample *find(const struct rig *r, enum apc_table table, int id)
{
    for (size_t i = 0; i < r->n; i++) {
        if (r->out[i].table == table && r->out[i].id == id)
            return &r->out[i];
    }
    return &none;
}

static const double *field(const struct rig *r, enum apc_tick_field which)
{
    const char *name;
    size_t offset, length;

    assert_true(apc_controller_tick_field(r->controller, which, &name, &offset, &length));
    return r->row + offset;
}

static void set(struct rig *r, int which, double value)
{
    r->in[which].value = value;
    r->in[which].seq++;
    r->in[which].time = T0 + r->mono + r->utc_step;
    r->in[which].status = APC_GOOD;
}

static void keep(struct rig *r, const struct apc_sample *s)
{
    size_t i = 0;

    while (i < r->n_actual && r->actual[i].id != s->id)
        i++;
    assert_in_range(i, 0, MAX_OUT - 1);
    assert_true(s->seq > r->actual[i].seq);
    r->actual[i] = *s;
    if (i == r->n_actual)
        r->n_actual++;
}

/* As the shell does it, but for update: read, compute, and what was put is there when @p written. */
static void compute(struct rig *r, struct apc_now now, bool have, bool written)
{
    const struct apc_rows *out = apc_controller_out(r->controller);
    struct apc_rows *in = apc_controller_in(r->controller);

    for (size_t i = 0; i < in->n_samples; i++) {
        const struct apc_sample name = in->sample[i];

        in->sample[i] = r->in[i];
        in->sample[i].table = name.table;
        in->sample[i].id = name.id;
    }
    apc_controller_compute(r->controller, now, r->index++, have, &r->notice);
    r->n = out->n_samples;
    assert_in_range(r->n, 0, MAX_OUT);
    memcpy(r->out, out->sample, r->n * sizeof(*r->out));
    r->tick = out->vector[0];
    assert_int_equal(out->n_vectors, 1);
    assert_in_range(r->tick.n, 1, MAX_ROW);
    memcpy(r->row, r->tick.value, r->tick.n * sizeof(*r->row));
    for (size_t i = 0; i < r->n && written; i++) {
        if (r->out[i].table == APC_ACTUAL)
            keep(r, &r->out[i]);
        if (r->out[i].table == APC_ACTUATOR && r->out[i].id == 1)
            r->in[in->n_samples - 1] = r->out[i];
    }
}

/* One period later: read, compute, update. Returns the actuator row. */
static const struct apc_sample *any_tick(struct rig *r, bool have)
{
    r->mono += PERIOD;
    compute(r, (struct apc_now){.mono = r->mono, .utc = T0 + r->mono + r->utc_step}, have, true);
    apc_controller_update(r->controller, 1);
    return find(r, APC_ACTUATOR, 1);
}

static const struct apc_sample *tick(struct rig *r)
{
    return any_tick(r, true);
}

static const struct apc_sample *measured_tick(struct rig *r, double y)
{
    set(r, Y, y);
    return tick(r);
}

static void make_sized(struct rig *r, const struct apc_law *law, struct apc_dim dim)
{
    const struct apc_controller_setpoint z[] = {{.id = 1, .low = -1e4, .high = 1e4},
                                                {.id = 2, .low = -1e4, .high = 1e4}};
    const struct apc_controller_loop loop = {
        .id = 1, .mode = 1, .low = -1.0, .high = 2.0, .fault = FAULT, .hold = HOLD};
    const struct apc_controller_options o = {.size = sizeof(o),
                                             .law = law,
                                             .dim = dim,
                                             .period = PERIOD,
                                             .horizon = HORIZON,
                                             .z = z,
                                             .loop = &loop};
    struct apc_error why = {""};

    *r = (struct rig){0};
    if (apc_controller_create(&r->controller, &o, &why) < 0)
        fail_msg("%s", why.text);
    assert_in_range(apc_controller_in(r->controller)->n_samples, 1, INPUTS + 8);
    memcpy(r->in, apc_controller_in(r->controller)->sample,
           apc_controller_in(r->controller)->n_samples * sizeof(*r->in));
}

static void make(struct rig *r, const struct apc_law *law)
{
    make_sized(r, law, (struct apc_dim){1, 1, 1, 0});
}

static int set_up(void **state)
{
    static struct rig r;

    make(&r, &apc_law_pi);
    set(&r, Z, 1.0);
    set(&r, MODE, APC_MODE_AUTO);
    *state = &r;
    return 0;
}

static int tear_down(void **state)
{
    apc_controller_destroy(((struct rig *)*state)->controller);
    return 0;
}

static size_t one_state(const struct apc_dim *dim)
{
    (void)dim;
    return 1;
}

#endif

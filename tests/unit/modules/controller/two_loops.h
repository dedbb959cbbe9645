/* SPDX-License-Identifier: BSD-3-Clause */
/* A controller of two loops, and what the store holds for it. */
#ifndef APC_TEST_TWO_LOOPS_H
#define APC_TEST_TWO_LOOPS_H

#include "check.h"

#include "modules/controller.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#define S       APC_NS_PER_S
#define T0      (INT64_C(1700000000) * S)
#define PERIOD  (2 * S)
#define HORIZON (5 * S)
#define HOLD    (6 * S)
#define LOOPS   2
#define MAX     256

/* Two loops of a PID, or another law of as many; what the store holds for them. */
struct rig {
    struct apc_controller *core;
    struct apc_sample in[MAX], actual[MAX], out[MAX];
    size_t n_in, n_out, n_actual;
    double row[MAX];
    struct apc_vector tick;
    struct apc_notice notice;
    apc_ns mono;
    uint64_t index;
};

static const struct apc_sample none;
static const double fault[LOOPS] = {-0.7, 0.3};

static inline struct apc_sample *in_of(struct rig *r, enum apc_table table, int id)
{
    for (size_t i = 0; i < r->n_in; i++) {
        if (r->in[i].table == table && r->in[i].id == id)
            return &r->in[i];
    }
    fail_msg("it does not read %s %d", apc_table_name(table), id);
    return r->in;
}

static inline const struct apc_sample *find(const struct rig *r, enum apc_table table, int id)
{
    for (size_t i = 0; i < r->n_out; i++) {
        if (r->out[i].table == table && r->out[i].id == id)
            return &r->out[i];
    }
    return &none;
}

static inline const struct apc_sample *actual(const struct rig *r, enum apc_table table, int id)
{
    for (size_t i = 0; i < r->n_actual; i++) {
        if (r->actual[i].id == apc_variable_number(table, id))
            return &r->actual[i];
    }
    return &none;
}

static inline void set(struct rig *r, enum apc_table table, int id, double value)
{
    struct apc_sample *s = in_of(r, table, id);

    s->value = value;
    s->seq++;
    s->time = T0 + r->mono + PERIOD; /* of the next tick */
    s->status = APC_GOOD;
}

/* Of all that make() makes. */
static double rate_of;
static const struct apc_controller_backup *backup_of;

static inline void make_so(struct rig *r, const struct apc_law *law, double rate)
{
    const struct apc_controller_loop loop[LOOPS] = {{.name = "v1",
                                                     .id = 1,
                                                     .mode = 1,
                                                     .low = -1.0,
                                                     .high = 2.0,
                                                     .rate = rate,
                                                     .fault = fault[0],
                                                     .hold = HOLD},
                                                    {.name = "v2",
                                                     .id = 2,
                                                     .mode = 2,
                                                     .low = -1.0,
                                                     .high = 2.0,
                                                     .rate = rate,
                                                     .fault = fault[1],
                                                     .hold = HOLD}};
    const struct apc_controller_options o = {.size = sizeof(o),
                                             .number = 7,
                                             .law = law,
                                             .dim = {LOOPS, LOOPS, LOOPS, 0},
                                             .period = PERIOD,
                                             .horizon = HORIZON,
                                             .backup = backup_of,
                                             .loop = loop};
    struct apc_error why = {""};

    *r = (struct rig){0};
    if (apc_controller_create(&r->core, &o, &why) < 0)
        fail_msg("%s", why.text);
    r->n_in = apc_controller_in(r->core)->n_samples;
    assert_in_range(r->n_in, 1, MAX);
    memcpy(r->in, apc_controller_in(r->core)->sample, r->n_in * sizeof(*r->in));
    for (int id = 1; id <= LOOPS; id++) {
        set(r, APC_SETPOINT, id, 1.0);
        set(r, APC_OPMODE, id, APC_MODE_AUTO);
    }
}

static inline void make(struct rig *r, const struct apc_law *law)
{
    make_so(r, law, rate_of);
}

static inline void keep(struct rig *r, const struct apc_sample *s)
{
    size_t i = 0;

    if (s->table == APC_ACTUATOR)
        *in_of(r, APC_ACTUATOR, s->id) = *s;
    if (s->table != APC_ACTUAL)
        return;
    while (i < r->n_actual && r->actual[i].id != s->id)
        i++;
    r->actual[i] = *s;
    if (i == r->n_actual)
        r->n_actual++;
}

/* What of a tick's rows is there, and what the shell knows of it. */
enum fate { WRITTEN, REFUSED, UNANSWERED, LOST /* and the shell does not know either */ };

static inline void tick(struct rig *r, enum fate fate)
{
    const struct apc_rows *out = apc_controller_out(r->core);
    static const int known[] = {[WRITTEN] = 1, [REFUSED] = 0, [UNANSWERED] = -1, [LOST] = -1};

    r->mono += PERIOD;
    memcpy(apc_controller_in(r->core)->sample, r->in, r->n_in * sizeof(*r->in));
    apc_controller_compute(r->core, (struct apc_now){r->mono, T0 + r->mono}, r->index++, true, &r->notice);
    r->n_out = out->n_samples;
    assert_in_range(r->n_out, 0, MAX);
    memcpy(r->out, out->sample, r->n_out * sizeof(*r->out));
    assert_int_equal(out->n_vectors, 1);
    assert_in_range(out->vector[0].n, 1, MAX);
    if (fate == WRITTEN || fate == UNANSWERED) {
        for (size_t i = 0; i < r->n_out; i++)
            keep(r, &r->out[i]);
        r->tick = out->vector[0];
        memcpy(r->row, r->tick.value, r->tick.n * sizeof(*r->row));
    }
    apc_controller_update(r->core, known[fate]);
}

static inline double u(const struct rig *r, int id)
{
    return find(r, APC_ACTUATOR, id)->value;
}

static inline void measured_tick(struct rig *r, double y1, double y2)
{
    set(r, APC_SENSOR, 1, y1);
    set(r, APC_SENSOR, 2, y2);
    tick(r, WRITTEN);
}

/* The core ends, another begins in its place from what is stored. */
static inline void restart(struct rig *r, const struct apc_law *law)
{
    struct rig next;
    struct apc_rows *former;

    make(&next, law);
    memcpy(next.in, r->in, sizeof(next.in));
    memcpy(next.actual, r->actual, sizeof(next.actual));
    next.n_actual = r->n_actual;
    next.mono = r->mono;
    next.index = r->index;
    former = apc_controller_former(next.core);
    for (size_t i = 0; i < former->n_samples; i++) {
        for (size_t k = 0; k < r->n_actual; k++) {
            if (r->actual[k].id == former->sample[i].id)
                former->sample[i] = r->actual[k];
        }
    }
    if (r->tick.seq > 0) {
        assert_int_equal(former->vector[0].id, r->tick.id);
        former->vector[0].seq = r->tick.seq;
        former->vector[0].time = r->tick.time;
        former->vector[0].status = r->tick.status;
        former->vector[0].n = r->tick.n;
        memcpy(former->vector[0].value, r->row, r->tick.n * sizeof(*r->row));
    }
    assert_int_equal(apc_controller_resume(next.core, T0), r->tick.seq > 0);
    apc_controller_destroy(r->core);
    *r = next;
}

static inline void end(struct rig *r)
{
    apc_controller_destroy(r->core);
}

/* ---- Chance --------------------------------------------------------------------------------- */

static struct apc_random random_of;

static inline bool one_in(unsigned n)
{
    return apc_random_next(&random_of) % n == 0;
}

static inline double number(void)
{
    return 2.0 * apc_random_uniform(&random_of) - 1.0;
}

#endif

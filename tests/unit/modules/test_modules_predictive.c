/* SPDX-License-Identifier: BSD-3-Clause */
/*
 * Predictive control, linear and nonlinear, in its controller: whatever it is told of measurements,
 * setpoints, modes, services and tuning, and whatever the model answers, no output is ever anything but a
 * finite number within its limits, nor is its state; once there is sense in what it is told it is back, and
 * keeps to rates.
 * Set APC_TEST_SEED to see a failure again.
 */
/*
 * Promise(laws): Whatever predictive control is told, of measurements, setpoints, modes, tuning, and
 *   whatever its model answers, outputs and state are finite and within limits, and it is back once that
 *   makes sense.
 */
#include "check.h"

#include "base/base_internal.h"
#include "modules/controller.h"
#include "plant/plant_internal.h"
#include "xorshift.h"

#include <stdlib.h>
#include <string.h>

#define S     APC_NS_PER_S
#define T0    (INT64_C(1700000000) * S)
#define LOW   1.0
#define HIGH  6.0
#define RATE  0.5 /* of the second output, a second */
#define TICKS 6000

enum { NX = 4, NU = 2, NY = 2, PHASE = 40 /* ticks of sense or of none */ };

static uint64_t seed;
static bool breaks; /* the model, now and then */

static uint32_t chance(uint32_t n)
{
    return (uint32_t)(xorshift(&seed) >> 33) % n;
}

static double any_value(void)
{
    static const double odd[] = {0.0,
                                 -0.0,
                                 1e-320,
                                 1e300,
                                 -1e300,
                                 1e301,
                                 1.7e308,
                                 (double)NAN,
                                 (double)INFINITY,
                                 1e9,
                                 -(double)INFINITY,
                                 -1e9};

    return chance(2) ? odd[chance(sizeof(odd) / sizeof(odd[0]))] : ((double)chance(2000) - 1000.0) / 50.0;
}

static apc_status any_status(void)
{
    static const apc_status status[] = {APC_GOOD, APC_UNCERTAIN, APC_BAD_NO_DATA, 0xC0000000u, 0xFFFFFFFFu};

    return chance(2) ? APC_GOOD : status[chance(sizeof(status) / sizeof(status[0]))];
}

/* ---- The model ------------------------------------------------------------------------------------ */

static int f(double t, const double *x, const double *u, const double *p, double *dx)
{
    const int rc = apc_model_quadruple_tank.f(t, x, u, p, dx);

    if (breaks && chance(3000) == 0)
        dx[chance(NX)] = any_value();
    return breaks && chance(3000) == 0 ? 1 : rc;
}

struct rig {
    struct apc_model model;
    struct apc_law_plant plant;
    double x[NX], u[NU + 8], y[NY], A[NX * NX], B[NX * (NU + 8)], C[NY * NX], D[NY * (NU + 8)];
    double B_u[NX * NU], D_u[NY * NU];
    struct apc_controller *c;
    struct apc_plant *tanks; /* that obeys while there is sense */
    struct apc_now now;
    int64_t seq;
    double acts[NU];
    int computed, held, fault;
};

static void begin(struct rig *r, const struct apc_law *law)
{
    static const struct apc_controller_loop loop[] = {
        {.id = 1, .mode = 1, .low = LOW, .high = HIGH, .fault = 1.5},
        {.id = 2, .mode = 2, .low = LOW, .high = HIGH, .fault = 2.0, .rate = RATE}};
    static const double horizon = 12.0, noise[NY] = {0.01, 0.01}, delay[NU] = {1.4, 0.4}, few = 40.0,
                        blocks[] = {1.0, 1.0, 3.0, 7.0}, steps = 2.0, one = 1.0;
    const struct apc_setting setting[] = {
        {.name = "horizon", .rows = 1, .columns = 1, .value = &horizon},
        {.name = "y_noise", .rows = 1, .columns = NY, .value = noise},
        {.name = "delay", .rows = 1, .columns = NU, .value = delay},
        {.name = "iterations", .rows = 1, .columns = 1, .value = &few},
        {.name = "blocks", .rows = 1, .columns = 4, .value = blocks},
        {.name = "terminal", .rows = 1, .columns = 1, .value = &one},
        {.name = "steps", .rows = 1, .columns = 1, .value = &steps}}; /* of nmpc only */
    const struct apc_controller_options o = {.size = sizeof(o),
                                             .law = law,
                                             .dim = {.ny = NY, .nz = NY, .nu = NU},
                                             .period = S,
                                             .horizon = 3 * S,
                                             .loop = loop,
                                             .setting = setting,
                                             .n_setting =
                                                 sizeof(setting) / sizeof(*setting) - (law == &apc_law_mpc),
                                             .plant = &r->plant};
    struct apc_error why;

    *r =
        (struct rig){.model = apc_model_quadruple_tank, .x = {12.263, 12.783, 1.634, 1.409}, .u = {3.0, 3.0}};
    breaks = false;
    r->model.f = f;
    apc_param_initials(r->model.disturbance, r->model.nd, r->u + NU);
    assert_int_equal(apc_model_equilibrium(&r->model, NULL, r->u, r->x, &why), 0);
    assert_int_equal(apc_model_linearize(&r->model, NULL, r->x, r->u, r->A, r->B, r->C, r->D, &why), 0);
    assert_int_equal(apc_model_evaluate(&r->model, NULL, r->x, r->u, NULL, r->y, &why), 0);
    for (size_t i = 0; i < NX * NU; i++)
        r->B_u[i] = r->B[i / NU * (NU + r->model.nd) + i % NU];
    r->plant = (struct apc_law_plant){.nx = NX,
                                      .A = r->A,
                                      .B = r->B_u,
                                      .C = r->C,
                                      .D = r->D_u,
                                      .x0 = r->x,
                                      .u0 = r->u,
                                      .y0 = r->y,
                                      .model = &r->model};
    if (apc_controller_create(&r->c, &o, &why) < 0)
        fail_msg("%s", why.text);
    assert_int_equal(apc_plant_create(&r->tanks, &apc_model_quadruple_tank, NULL, r->x, NULL, &why), 0);
    r->now = (struct apc_now){.mono = S, .utc = T0};
    r->acts[0] = r->acts[1] = 3.0;
    (void)apc_controller_resume(r->c, 0);
}

static void end(struct rig *r)
{
    apc_controller_destroy(r->c);
    apc_plant_destroy(r->tanks);
}

/* ---- What it is told -------------------------------------------------------------------------------- */

static double sense(const struct rig *r, const struct apc_sample *s, const double *y)
{
    const struct apc_dim dim = {.ny = NY, .nz = NY, .nu = NU};

    if (s->table == APC_SENSOR)
        return y[s->id - 1];
    if (s->table == APC_SETPOINT)
        return r->y[s->id - 1] + 0.2;
    if (s->table == APC_TUNING)
        return apc_law_mpc.tuning[apc_law_parameter_at(&apc_law_mpc, &dim, (size_t)s->id - 1).number].initial;
    if (s->table == APC_ACTUATOR || s->table == APC_MANUAL)
        return r->acts[s->id - 1];
    return 1.0; /* Auto */
}

/* Missing, Bad, none, from another time, another mode. */
static void spoil(struct rig *r, struct apc_sample *s)
{
    if (chance(3) == 0)
        return; /* missing: as it was */
    s->seq = chance(20) ? ++r->seq : (int64_t)chance(3);
    s->time = chance(10) ? r->now.utc : (apc_ns)((uint64_t)chance(1u << 31) << 33);
    s->status = any_status();
    s->value = s->table == APC_OPMODE && chance(4)   ? (double)chance(4)
               : s->table == APC_TUNING && chance(3) ? (double)chance(3)
                                                     : any_value();
}

static void tell(struct rig *r, bool nonsense)
{
    struct apc_rows *in = apc_controller_in(r->c);
    double y[NY];

    apc_plant_output(r->tanks, r->acts, y);
    for (size_t i = 0; i < in->n_samples; i++) {
        struct apc_sample *s = &in->sample[i];

        if (nonsense && (s->table != APC_ACTUATOR || chance(3) == 0)) {
            spoil(r, s);
        } else {
            s->seq = ++r->seq;
            s->time = r->now.utc;
            s->status = APC_GOOD;
            s->value = sense(r, s, y);
        }
    }
}

/* ---- What it answers -------------------------------------------------------------------------------- */

static void look(struct rig *r, bool known)
{
    const struct apc_rows *out = apc_controller_out(r->c);

    for (size_t i = 0; i < out->n_samples; i++) {
        const struct apc_sample *s = &out->sample[i];

        if (!(fabs(s->value) < APC_VALUE_MAX))
            fail_msg("table %d id %d: %g", (int)s->table, s->id, s->value);
        if (s->table != APC_ACTUATOR)
            continue;
        if (!(s->value >= LOW && s->value <= HIGH))
            fail_msg("actuator %d: %g", s->id, s->value);
        if (s->id == 2 && known && s->status != APC_UNCERTAIN_SUBSTITUTE &&
            fabs(s->value - r->acts[1]) > RATE + 1e-9)
            fail_msg("actuator 2: from %g to %g within a second", r->acts[1], s->value);
        r->acts[s->id - 1] = s->value;
        r->computed += r->c->state[s->id - 1].loop.state == APC_LOOP_AUTO;
        r->held += s->status == APC_UNCERTAIN_LAST_USABLE;
        r->fault += s->status == APC_UNCERTAIN_SUBSTITUTE;
    }
    for (size_t i = 0; i < out->n_vectors; i++)
        assert_true(apc_values_ok(out->vector[i].value, out->vector[i].n));
}

static void run(struct rig *r, int ticks, bool nonsense)
{
    for (int k = 0; k < ticks; k++) {
        r->now.mono += S;
        r->now.utc = T0 + r->now.mono;
        tell(r, nonsense);
        /* after one tick of sense it knows what it put last, unless it was told that nothing ever went out */
        const bool known = !nonsense && k > 0 && r->c->state[1].there;

        apc_controller_compute(r->c, r->now, (uint64_t)(r->now.mono / S), !nonsense || chance(20), NULL);
        look(r, known);
        apc_controller_update(r->c, nonsense ? (int)chance(3) - 1 : 1);
        assert_int_equal(apc_plant_advance(r->tanks, 1.0, r->acts), 0);
    }
}

static void keeps_within_limits(const struct apc_law *law)
{
    struct rig r;

    begin(&r, law);
    for (int k = 0; k < TICKS; k += 2 * PHASE) {
        breaks = chance(2);
        run(&r, PHASE, true);
        breaks = false;
        run(&r, PHASE, false);
    }
    print_message("%s: %d computed, %d held, %d at the fault value\n", law->name, r.computed, r.held,
                  r.fault);
    assert_true(r.computed > 1000 && r.held > 100 && r.fault > 20);
    run(&r, 1500, false); /* and nothing of it is left */
    for (size_t i = 0; i < NY; i++) {
        double y[NY];

        apc_plant_output(r.tanks, r.acts, y);
        assert_near(y[i], r.y[i] + 0.2, 0.01);
        assert_int_equal(r.c->state[i].loop.state, APC_LOOP_AUTO);
    }
    end(&r);
}

/* With other chances, or with those that are asked for; one of them where a sanitizer takes ten times as
 * long. */
static void whatever_it_is_told(const struct apc_law *law)
{
    static const uint64_t chances[] = {20260131, 2, 38, 82, 155};
    const char *given = getenv("APC_TEST_SEED"), *sanitized = getenv("APC_SANITIZE");
    const size_t n = given || (sanitized && *sanitized) ? 1 : sizeof(chances) / sizeof(*chances);

    for (size_t k = 0; k < n; k++) {
        seed = given ? strtoull(given, NULL, 10) : chances[k];
        print_message("APC_TEST_SEED=%llu\n", (unsigned long long)seed);
        keeps_within_limits(law);
    }
}

static void linear_predictive_control_keeps_within_limits_whatever_it_is_told(void **state)
{
    (void)state;
    whatever_it_is_told(&apc_law_mpc);
}

static void nonlinear_predictive_control_keeps_within_limits_whatever_it_is_told(void **state)
{
    (void)state;
    whatever_it_is_told(&apc_law_nmpc);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(linear_predictive_control_keeps_within_limits_whatever_it_is_told),
        cmocka_unit_test(nonlinear_predictive_control_keeps_within_limits_whatever_it_is_told),
    };

    return cmocka_run_group_tests(tests, NULL, NULL);
}

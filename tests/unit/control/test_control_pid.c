/* SPDX-License-Identifier: BSD-3-Clause */
#include "laws.h"

#include "apclinear.h"
#include "apcplant.h"

#include <string.h>

enum { KP, TAU_I, TAU_D, N, B, C, TAU_T, U_BAR, U_MIN, U_MAX, DU_MAX, KFF, PARAMS };
enum { STATES = 6, LOOPS = 2 };

/* Loops on the law, with all that a call needs. */
struct rig {
    double y[3], z[3], u[LOOPS], x[STATES * LOOPS], tuning[PARAMS * LOOPS];
    unsigned limited[LOOPS];
    struct apc_instances *law;
    struct apc_law_call c;
};

static const struct apc_law *const pid = &apc_law_pid;

static int configure(struct rig *r, struct apc_dim dim, const struct apc_setting *setting, size_t n,
                     struct apc_error *why)
{
    const struct apc_law_setup setup = {.dim = dim, .Ts = r->c.Ts, .n_setting = n, .setting = setting};
    int rc = laws_make(&r->law, pid, &setup, why);

    if (rc == 0)
        assert_int_equal(apc_instances_size(r->law).states, STATES * dim.nu);
    return rc;
}

/* One loop with proportional gain 1 and nothing else. */
static void make(struct rig *r, double h)
{
    memset(r, 0, sizeof(*r));
    r->c = (struct apc_law_call){.dim = {1, 1, 1, 0},
                                 .Ts = h,
                                 .y = r->y,
                                 .z = r->z,
                                 .u = r->u,
                                 .x = r->x,
                                 .tuning = r->tuning,
                                 .limited = r->limited};
    for (size_t i = 0; i < PARAMS * LOOPS; i++)
        r->tuning[i] = pid->tuning[i % PARAMS].initial;
    for (size_t i = 0; i < LOOPS; i++)
        r->tuning[i * PARAMS + TAU_I] = 0.0;
    assert_int_equal(configure(r, r->c.dim, NULL, 0, NULL), 0);
    laws_reset(r->law, &r->c);
}

static double compute(struct rig *r)
{
    memset(r->limited, 0, sizeof(r->limited));
    laws_compute(r->law, &r->c);
    return r->u[0];
}

static double tick(struct rig *r)
{
    double u = compute(r);

    laws_update(r->law, &r->c);
    return u;
}

/* ---- Loops with known answers ---------------------------------------------------------------- */

/* G(s) = 1000 / (s (s + 1)), exactly. */
struct servo {
    double angle, speed, t, peak, peak_at;
};

static void servo_advance(struct servo *s, double dt, double u)
{
    double t = dt / 20.0, decay = -expm1(-t);

    for (int k = 0; k < 20; k++) { /* to see the peak between ticks */
        s->angle += s->speed * decay + 1000.0 * u * (t - decay);
        s->speed += (1000.0 * u - s->speed) * decay;
        s->t += t;
        if (s->angle > s->peak) {
            s->peak = s->angle;
            s->peak_at = s->t;
        }
    }
}

/* Follow a step with a command that acts `delay` late. */
static struct servo servo_step(struct rig *r, double delay, double duration)
{
    struct servo s = {0};
    double before = 0.0;

    r->z[0] = 1.0;
    for (int k = 0; k * r->c.Ts < duration; k++) {
        double u;

        r->y[0] = s.angle;
        u = tick(r);
        servo_advance(&s, delay, before);
        servo_advance(&s, r->c.Ts - delay, u);
        before = u;
    }
    return s;
}

static void make_servo_pid(struct rig *r)
{
    make(r, 0.006);
    r->tuning[KP] = 0.96;
    r->tuning[TAU_I] = 0.12;
    r->tuning[TAU_D] = 0.049;
    r->tuning[B] = 0.5;
}

/* Promise(laws/experiment-gallery) */
static void the_servo_under_pid_overshoots_as_published(void **state)
{
    struct rig r;
    struct servo s;

    (void)state;
    make_servo_pid(&r);
    s = servo_step(&r, 0.0, 2.0);
    assert_near(s.peak, 1.048, 0.0005);
    assert_near(s.peak_at, 0.23, 0.005);
    make_servo_pid(&r);
    assert_near(servo_step(&r, 0.002, 2.0).peak, 1.046, 0.0005);
}

static void make_servo_pd(struct rig *r)
{
    make(r, 0.010);
    r->tuning[KP] = 1.0;
    r->tuning[TAU_D] = 0.04;
    r->tuning[N] = 100.0;
}

static void the_servo_under_pd_loses_damping_with_delay_as_published(void **state)
{
    const struct {
        double delay, overshoot;
    } expected[] = {{0.0, 0.039}, {0.004, 0.089}, {0.008, 0.228}};
    struct rig r;

    (void)state;
    for (size_t i = 0; i < sizeof(expected) / sizeof(expected[0]); i++) {
        make_servo_pd(&r);
        assert_near(servo_step(&r, expected[i].delay, 2.0).peak - 1.0, expected[i].overshoot, 0.0005);
    }
}

static void the_servo_under_pd_is_unstable_above_13_8_ms_of_delay(void **state)
{
    (void)state;
    for (int above = 0; above <= 1; above++) {
        double delay = above ? 0.0140 : 0.0136, early = 0.0, late = 0.0;
        struct rig r;
        struct servo s = {.angle = 1.0};
        double u[3] = {0.0, 0.0, 0.0}; /* the newest first */

        make_servo_pd(&r);
        for (int k = 0; k < 4000; k++) {
            r.y[0] = s.angle;
            u[2] = u[1];
            u[1] = u[0];
            u[0] = tick(&r);
            servo_advance(&s, delay - r.c.Ts, u[2]);
            servo_advance(&s, 2.0 * r.c.Ts - delay, u[1]);
            if (k < 400)
                early = fmax(early, fabs(s.angle));
            else if (k >= 3600)
                late = fmax(late, fabs(s.angle));
        }
        if (above)
            assert_true(late > 2.0 * early);
        else
            assert_true(late < 0.5 * early);
    }
}

/* The linear inverted pendulum on a cart, hit once: d/dt (s, v, phi, omega) = A x + B F. */
/* Promise(laws/experiment-gallery) */
static void the_pendulum_swings_as_far_as_published(void **state)
{
    const double M = 0.5, m = 0.2, b = 0.1, l = 0.3, I = 0.006, g = 9.8, h = 0.0001;
    const double q = (M + m) * (I + m * l * l) - m * m * l * l;
    const double A[16] = {0, 1, 0, 0, 0, -(I + m * l * l) * b / q, m * m * g * l * l / q,   0,
                          0, 0, 0, 1, 0, -m * l * b / q,           m * g * l * (M + m) / q, 0};
    const double Bc[4] = {0, (I + m * l * l) / q, 0, m * l / q};
    double Ad[16], Bd[4], x[4], peak = 0.0;
    struct rig r;

    (void)state;
    assert_int_equal(apc_linear_sample(4, 1, A, Bc, h, Ad, Bd, NULL), 0);
    make(&r, h);
    r.tuning[KP] = 100.0;
    r.tuning[TAU_I] = 100.0;
    r.tuning[TAU_D] = 0.2;
    r.tuning[N] = 1e5;        /* h and N nearly those of a continuous, ideal PID, which the value is of */
    memcpy(x, Bc, sizeof(x)); /* the state right after an impulse of 1 N s */
    for (int k = 0; k < 50000; k++) {
        double next[4], u;

        r.y[0] = x[2];
        peak = fmax(peak, fabs(x[2]));
        u = tick(&r);
        for (int i = 0; i < 4; i++) {
            next[i] = Bd[i] * u;
            for (int j = 0; j < 4; j++)
                next[i] += Ad[i * 4 + j] * x[j];
        }
        memcpy(x, next, sizeof(x));
    }
    assert_near(peak, 0.0440, 0.0005);  /* the published figure */
    assert_near(peak, 0.04436, 0.0001); /* the impulse response of P / (1 + PC), integrated by other means */
    assert_near(x[2], 0.0, 0.001);
}

/* Both loops on the nonlinear plant, sampled fast. */
/* Promise(laws/experiment-gallery) */
static void the_quadruple_tank_overshoots_and_settles_as_published(void **state)
{
    const double x0[] = {12.263, 12.783, 1.634, 1.409}, v[] = {3.0, 3.0};
    const struct apc_plant_options options = {.size = sizeof(options), .integrator = "rk4", .steps = 2};
    const struct apc_model *tanks;
    struct apc_plant *plant;
    void *handle;
    double peak = 0.0, settled = 0.0, start[2];
    struct rig r;

    (void)state;
    assert_int_equal(apc_model_find("quadruple-tank", &tanks, &handle, NULL), 0);
    assert_int_equal(apc_plant_create(&plant, tanks, NULL, x0, &options, NULL), 0);
    make(&r, 0.1);
    r.c.dim = (struct apc_dim){2, 2, 2, 0};
    assert_int_equal(configure(&r, r.c.dim, NULL, 0, NULL), 0);
    for (int i = 0; i < LOOPS; i++) {
        r.tuning[i * PARAMS + KP] = i == 0 ? 3.0 : 2.7;
        r.tuning[i * PARAMS + TAU_I] = i == 0 ? 30.0 : 40.0;
        r.tuning[i * PARAMS + U_BAR] = v[i];
    }
    apc_plant_output(plant, v, start);
    memcpy(r.y, start, sizeof(start));
    laws_reset(r.law, &r.c);
    r.z[0] = start[0] + 1.0;
    r.z[1] = start[1];
    for (int k = 0; k < 4000; k++) {
        apc_plant_output(plant, r.u, r.y);
        peak = fmax(peak, r.y[0] - start[0] - 1.0);
        if (fabs(r.y[0] - r.z[0]) > 0.05 || fabs(r.y[1] - r.z[1]) > 0.05)
            settled = 0.1 * k;
        tick(&r);
        assert_int_equal(apc_plant_advance(plant, 0.1, r.u), 0);
    }
    apc_plant_destroy(plant);
    assert_near(peak, 0.046, 0.001);
    assert_near(settled, 48.0, 1.0);
}

static void without_derivative_it_gives_the_papers_sequence(void **state)
{
    const double expected[] = {0.0, .36254, .60043, .75518, .85475, .91792};
    const double a = exp(-2.0 / 10.0);
    struct rig r;
    double max = 0.0;

    (void)state;
    make(&r, 2.0);
    r.tuning[KP] = 0.2;
    r.tuning[TAU_I] = 10.0;
    r.z[0] = 1.0;
    for (int k = 0; k < 200; k++) {
        if (k < 6)
            assert_near(r.y[0], expected[k], 5e-6);
        max = fmax(max, r.y[0]);
        r.y[0] = a * r.y[0] + (1.0 - a) * 10.0 * tick(&r);
    }
    assert_near(max, 1.00859, 5e-6);
}

/* ---- Its parts ------------------------------------------------------------------------------- */

/* Promise(laws/pid): `pid` does what each line of its table in docs/laws.md says. */
static void setpoint_weights_scale_what_a_setpoint_step_gives_at_once(void **state)
{
    struct rig r;

    (void)state;
    make(&r, 0.5);
    r.tuning[KP] = 2.0;
    r.tuning[B] = 0.25;
    r.z[0] = 4.0;
    assert_near(compute(&r), 2.0 * 0.25 * 4.0, 1e-15);
    r.tuning[TAU_D] = 3.0; /* c = 0: a new setpoint gives no derivative */
    assert_near(compute(&r), 2.0, 1e-15);
    r.tuning[C] = 0.5;
    assert_near(compute(&r), 2.0 + 2.0 * 10.0 * 3.0 / (3.0 + 10.0 * 0.5) * 0.5 * 4.0, 1e-13);
    laws_update(r.law, &r.c);
    assert_near(compute(&r), 2.0 + 2.0 * 10.0 * pow(3.0 / (3.0 + 10.0 * 0.5), 2) * 0.5 * 4.0, 1e-13);
}

/* After a step of y the derivative is there at once and dies out with time constant tau_d / N. */
/* Promise(laws/pid) */
static void the_derivative_of_the_measurement_is_filtered(void **state)
{
    const double h = 0.01, a = 2.0 / (2.0 + 8.0 * h);
    struct rig r;

    (void)state;
    make(&r, h);
    r.tuning[TAU_D] = 2.0;
    r.tuning[N] = 8.0;
    r.y[0] = 3.0;
    for (int k = 0; k < 300; k++)
        assert_near(tick(&r), -3.0 - 3.0 * 8.0 * pow(a, k + 1), 1e-10);
    assert_near(pow(a, 25.0), exp(-25.0 * h / (2.0 / 8.0)), 0.02);
}

static void a_first_measurement_far_from_zero_gives_no_derivative(void **state)
{
    struct rig r;

    (void)state;
    make(&r, 0.1);
    r.tuning[TAU_D] = 5.0;
    r.tuning[C] = 0.5; /* nor does a first setpoint */
    r.y[0] = r.z[0] = 100.0;
    laws_reset(r.law, &r.c);
    assert_near(tick(&r), 0.0, 1e-13);
    assert_near(tick(&r), 0.0, 1e-13);
}

/* Promise(laws/pid) */
static void at_its_setpoint_it_begins_with_u_bar_whatever_the_weight(void **state)
{
    struct rig r;

    (void)state;
    for (double tau_i = 0.03; tau_i < 100.0; tau_i *= 10.0) {
        make(&r, 0.1);
        r.tuning[KP] = 7.0;
        r.tuning[TAU_I] = tau_i;
        r.tuning[B] = 0.4;
        r.tuning[U_BAR] = 2.5;
        r.y[0] = r.z[0] = 100.0;
        laws_reset(r.law, &r.c);
        for (int k = 0; k < 10; k++)
            assert_near(tick(&r), 2.5, 1e-12);
        r.z[0] = 101.0;
        assert_near(tick(&r), 2.5 + 7.0 * 0.4, 1e-12);
    }
}

/* A rate counts from there, so that nothing goes out beyond the limits on the way. */
/* Promise(laws/pid) */
static void with_u_bar_beyond_its_limits_it_begins_at_the_limit(void **state)
{
    struct rig r;

    (void)state;
    for (int low = 0; low < 2; low++) {
        make(&r, 0.1);
        r.tuning[KP] = 7.0;
        r.tuning[TAU_I] = 1.0;
        r.tuning[U_BAR] = low ? -60.0 : 60.0;
        r.tuning[U_MIN] = -50.0;
        r.tuning[U_MAX] = 50.0;
        r.tuning[DU_MAX] = 20.0;
        r.y[0] = r.z[0] = 100.0;
        laws_reset(r.law, &r.c);
        for (int k = 0; k < 3; k++)
            assert_near(tick(&r), low ? -50.0 : 50.0, 1e-12);
        r.z[0] = low ? 200.0 : 0.0;
        assert_near(tick(&r), low ? -48.0 : 48.0, 1e-12);
    }
}

/* Nothing would take away then what the integral began with. */
static void without_integral_it_begins_with_its_proportional_part(void **state)
{
    struct rig r;

    (void)state;
    make(&r, 0.1);
    r.tuning[KP] = 7.0;
    r.tuning[B] = 0.4;
    r.y[0] = 10.0;
    r.z[0] = 20.0;
    laws_reset(r.law, &r.c);
    for (int k = 0; k < 10; k++)
        assert_near(tick(&r), 7.0 * (0.4 * 20.0 - 10.0), 1e-12);
}

static void make_windup(struct rig *r, double tau_t)
{
    make(r, 0.1);
    r->tuning[KP] = 2.0;
    r->tuning[TAU_I] = 1.0;
    r->tuning[TAU_T] = tau_t;
    r->tuning[U_MIN] = -1.0;
    r->tuning[U_MAX] = 1.0;
    r->z[0] = 10.0;
}

/* Promise(laws/pid) */
static void conditional_integration_stands_still_in_saturation(void **state)
{
    struct rig r;

    (void)state;
    make_windup(&r, 0.0);
    for (int k = 0; k < 1000; k++)
        assert_near(tick(&r), 1.0, 0.0);
    assert_int_equal(r.limited[0], APC_LIMITED_HIGH);
    assert_near(r.x[0], 0.0, 0.0);
    r.z[0] = -10.0;
    assert_near(tick(&r), -1.0, 0.0);
    assert_int_equal(r.limited[0], APC_LIMITED_LOW);
    r.z[0] = 0.1;
    assert_near(compute(&r), 0.2, 1e-15);
    assert_int_equal(r.limited[0], 0);
}

/* The integral goes back from a limit and stays away from beyond it, by however little. */
static void conditional_integration_knows_the_smallest_errors(void **state)
{
    (void)state;
    for (double error = 1e-6; error < 1e3; error *= 10.0) {
        for (double side = -1.0; side <= 1.0; side += 2.0) {
            const double increment = 2.0 * 0.1 / 1.0 * error;
            struct rig r;

            make_windup(&r, 0.0);
            r.x[0] = side; /* just at the limit without an error */
            r.z[0] = side * error;
            assert_near(tick(&r), side, 0.0);
            assert_near(r.x[0], side, 0.0);
            r.z[0] = -side * error;
            tick(&r);
            if (2.0 * error < 2.0) /* where that does not lead to the other limit */
                assert_near(r.x[0], side * (1.0 - increment), 1e-15);
            r.x[0] = 0.0;
            r.z[0] = side * fmin(error, 0.4); /* within the limits */
            tick(&r);
            assert_near(r.x[0], 2.0 * 0.1 * r.z[0], 1e-15);
        }
    }
}

/* Where increment and back-calculation balance: Kp h / tau_i e = h / tau_t (v - u). */
/* Promise(laws/pid) */
static void back_calculation_settles_at_a_distance_from_the_limit(void **state)
{
    const double tau_t = 0.5;
    struct rig r;

    (void)state;
    make_windup(&r, tau_t);
    for (int k = 0; k < 1000; k++)
        assert_near(tick(&r), 1.0, 0.0);
    assert_near(2.0 * 10.0 + r.x[0], 1.0 + tau_t / 1.0 * 2.0 * 10.0, 1e-9);
    r.z[0] = -0.1; /* v falls by Kp 10.1: far below the limit */
    assert_near(tick(&r), -1.0, 0.0);
}

/* Promise(laws/pid) */
static void the_output_changes_no_faster_than_its_rate_limit(void **state)
{
    struct rig r;

    (void)state;
    make(&r, 0.1);
    r.tuning[U_BAR] = 3.0;
    r.tuning[DU_MAX] = 2.0;
    laws_reset(r.law, &r.c);
    r.z[0] = 1.0;
    for (int k = 1; k <= 5; k++) {
        assert_near(tick(&r), 3.0 + 0.2 * k, 1e-12);
        assert_int_equal(r.limited[0], k < 5 ? APC_LIMITED_HIGH : 0);
    }
    r.z[0] = -1.0;
    assert_near(tick(&r), 3.8, 1e-12);
    assert_int_equal(r.limited[0], APC_LIMITED_LOW);
}

/* Also after a limit of another's: what counts is what went out. */
static void the_rate_limit_begins_at_what_went_out(void **state)
{
    struct rig r;

    (void)state;
    make(&r, 0.1);
    r.tuning[DU_MAX] = 2.0;
    r.z[0] = 9.0;
    compute(&r);
    r.u[0] = 5.0;
    laws_update(r.law, &r.c);
    assert_near(tick(&r), 5.2, 1e-12);
    assert_int_equal(r.limited[0], APC_LIMITED_HIGH);
    r.u[0] = -3.0;
    laws_track(r.law, &r.c);
    r.z[0] = -9.0;
    assert_near(tick(&r), -3.2, 1e-12);
    assert_int_equal(r.limited[0], APC_LIMITED_LOW);
}

/* Promise(laws/pid) */
static void a_limit_tuned_below_the_output_is_approached_at_the_rate_limit(void **state)
{
    struct rig r;

    (void)state;
    make(&r, 1.0);
    r.z[0] = 10.0;
    tick(&r);
    r.tuning[DU_MAX] = 2.0;
    r.tuning[U_MAX] = 5.0;
    assert_near(tick(&r), 8.0, 1e-12);
    assert_near(tick(&r), 6.0, 1e-12);
    assert_near(tick(&r), 5.0, 1e-12);
}

static void after_track_it_gives_the_tracked_output(void **state)
{
    (void)state;
    for (int gap = 0; gap <= 1; gap++) {
        struct rig r;

        make(&r, 0.1);
        r.tuning[TAU_I] = 2.0;
        r.tuning[TAU_D] = 0.7;
        r.tuning[DU_MAX] = 0.5;
        r.y[0] = 3.0;
        r.z[0] = -1.0;
        tick(&r);
        r.y[0] = 5.0;
        r.u[0] = 1.234;
        r.c.gap = gap != 0;
        laws_track(r.law, &r.c);
        r.u[0] = 0.0;
        assert_near(compute(&r), 1.234, 1e-14);
    }
}

/* After a gap the last y is old: what y did meanwhile is no derivative. */
static void after_a_gap_the_derivative_begins_anew(void **state)
{
    struct rig r;

    (void)state;
    make(&r, 0.1);
    r.tuning[TAU_I] = 1e9;
    r.tuning[TAU_D] = 5.0;
    tick(&r);
    r.y[0] = 50.0;
    r.u[0] = 1.0;
    r.c.gap = true;
    laws_track(r.law, &r.c);
    for (int k = 0; k < 10; k++)
        assert_near(tick(&r), 1.0, 1e-6);
}

/* Nor do the slopes of y and r that there were before it. */
static void after_a_gap_nothing_is_left_of_the_slopes_before(void **state)
{
    struct rig r;

    (void)state;
    make(&r, 0.1);
    r.tuning[TAU_I] = 1e9;
    r.tuning[TAU_D] = 5.0;
    r.tuning[C] = 0.5;
    for (int k = 0; k < 5; k++) {
        r.y[0] += 1.0;
        r.z[0] += k % 2 ? 3.0 : 0.5;
        tick(&r);
    }
    r.u[0] = 1.0;
    r.c.gap = true;
    laws_track(r.law, &r.c);
    for (int k = 0; k < 10; k++)
        assert_near(tick(&r), 1.0, 1e-6);
}

/* Promise(laws/pid) */
static void without_integral_a_bumpless_change_dies_out_with_tau_t(void **state)
{
    struct rig r;

    (void)state;
    make(&r, 0.1);
    r.u[0] = 8.0;
    laws_track(r.law, &r.c);
    r.tuning[TAU_T] = 1.0;
    assert_near(tick(&r), 8.0, 1e-14);
    assert_near(tick(&r), 8.0 * 0.9, 1e-14);
    assert_near(tick(&r), 8.0 * 0.9 * 0.9, 1e-14);
    r.tuning[TAU_T] = 0.01; /* quicker than a period: gone with the next one */
    tick(&r);
    assert_near(tick(&r), 0.0, 1e-14);
    r.u[0] = 8.0;
    laws_track(r.law, &r.c);
    r.tuning[TAU_T] = 0.5;
    assert_near(tick(&r), 8.0, 1e-14);
    assert_near(tick(&r), 8.0 * 0.8, 1e-14);
}

/* With the tuning that it begins with, nothing may jump either: it goes in twenty periods. */
/* Promise(laws/pid) */
static void without_integral_and_tau_t_a_bumpless_change_fades(void **state)
{
    struct rig r;

    (void)state;
    make(&r, 0.1);
    r.tuning[TAU_D] = 0.5;
    r.u[0] = 8.0;
    laws_track(r.law, &r.c);
    for (int k = 0; k < 400; k++)
        assert_near(tick(&r), 8.0 * pow(0.95, k), 1e-13);
    assert_near(tick(&r), 0.0, 1e-7);
}

/* Each parameter at either end of what it may be, all combinations of them: a number within the limits. */
static void no_tuning_that_is_allowed_gives_what_is_no_number(void **state)
{
    (void)state;
    for (unsigned which = 0; which < 1U << PARAMS; which++) {
        struct rig r;
        make(&r, 0.1);
        for (size_t i = 0; i < PARAMS; i++)
            r.tuning[i] = which >> i & 1 ? pid->tuning[i].high : pid->tuning[i].low;
        r.tuning[U_MIN] = r.tuning[U_BAR] = -10.0;
        r.tuning[U_MAX] = which >> U_MAX & 1 ? 10.0 : -10.0;
        laws_reset(r.law, &r.c);
        for (int k = 0; k < 8; k++) {
            r.y[0] = k % 2 ? 1e6 : -1e6;
            r.z[0] = k % 3 ? 0.0 : 1e6;
            const double u = tick(&r);
            if (!(u >= r.tuning[U_MIN] && u <= r.tuning[U_MAX]))
                fail_msg("combination %#x: u is %g", which, u);
        }
        laws_end(NULL);
    }
}

/* An error that stays is an output that stays, however long; and an integral time that comes back begins
 * there. */
static void without_integral_an_error_that_stays_leaves_nothing_behind(void **state)
{
    struct rig r;

    (void)state;
    make(&r, 0.1);
    r.z[0] = 3.0;
    for (int k = 0; k < 100000; k++)
        assert_near(tick(&r), 3.0, 0.0);
    r.tuning[TAU_I] = 10.0;
    for (int k = 0; k < 10; k++)
        assert_near(tick(&r), 3.0 + 0.03 * k, 1e-12);
}

/* While y rises and D acts: from the change on u moves as if it had always been tuned like that. */
/* Promise(laws/pid) */
static void a_change_of_gain_or_derivative_leaves_nothing_of_the_old_one(void **state)
{
    static const struct {
        int which;
        double to;
    } change[] = {{KP, 0.2}, {TAU_D, 9.0}, {TAU_D, 0.0}, {N, 3.0}, {C, 0.0}, {KP, -0.6}};

    (void)state;
    for (size_t i = 0; i < sizeof(change) / sizeof(change[0]); i++) {
        struct rig changed, always;
        double apart = 0.0;

        make(&changed, 0.5);
        changed.tuning[KP] = 0.6;
        changed.tuning[TAU_I] = 20.0;
        changed.tuning[TAU_D] = 4.0;
        changed.tuning[C] = 0.4;
        always = changed;
        always.c.y = always.y;
        always.c.z = always.z;
        always.c.u = always.u;
        always.c.x = always.x;
        always.c.tuning = always.tuning;
        always.c.limited = always.limited;
        always.tuning[change[i].which] = change[i].to;
        for (int k = 0; k < 400; k++) {
            changed.y[0] = always.y[0] = 0.3 * k;
            changed.z[0] = always.z[0] = 1.0 + 0.7 * k;
            if (k ==
                300) { /* as the controller does it: the output of the old tuning, tracked with the new one */
                (void)compute(&changed);
                changed.tuning[change[i].which] = change[i].to;
                laws_track(changed.law, &changed.c);
            }
            (void)tick(&changed);
            (void)tick(&always);
            if (k == 300)
                apart = changed.u[0] - always.u[0];
            if (k > 300)
                assert_near(changed.u[0] - always.u[0], apart, 1e-9 * fabs(apart) + 1e-9);
        }
    }
}

/* Promise(laws/pid) */
static void a_measured_disturbance_is_fed_forward_as_it_changes(void **state)
{
    const double use = 2.0;
    const struct apc_setting setting = {"feed_forward", NULL, 1, 1, &use};
    struct rig r;

    (void)state;
    make(&r, 1.0);
    r.c.dim.ny = 2;
    assert_int_equal(configure(&r, r.c.dim, &setting, 1, NULL), 0);
    r.tuning[TAU_I] = 1e9;
    r.tuning[KFF] = -0.5;
    r.y[1] = 100.0;
    laws_reset(r.law, &r.c);
    assert_near(tick(&r), 0.0, 1e-12); /* the level it had at the start is not a change */
    r.y[1] = 104.0;
    assert_near(tick(&r), -2.0, 1e-9);
}

/* What is no measurement of the controller but a disturbance counts on behind them. */
static void a_disturbance_of_the_controllers_own_is_fed_forward(void **state)
{
    (void)state;
    for (size_t n = 1; n <= 2; n++) { /* the last of them */
        const double use = 1.0 + (double)n;
        const struct apc_setting setting = {"feed_forward", NULL, 1, 1, &use};
        double d[] = {100.0, 100.0};
        struct rig r;

        make(&r, 1.0);
        r.c.dim.nd = n;
        r.c.d = d;
        assert_int_equal(configure(&r, r.c.dim, &setting, 1, NULL), 0);
        r.tuning[TAU_I] = 1e9;
        r.tuning[KFF] = -0.5;
        laws_reset(r.law, &r.c);
        assert_near(tick(&r), 0.0, 1e-12);
        d[2 - n] = 50.0; /* the other one */
        assert_near(tick(&r), 0.0, 1e-9);
        d[n - 1] = 104.0;
        assert_near(tick(&r), -2.0, 1e-9);
    }
}

static void each_output_has_its_own_loop_tuning_and_disturbance(void **state)
{
    const double use[] = {3.0, 1.0};
    const struct apc_setting setting = {"feed_forward", NULL, 1, 2, use};
    struct rig r;

    (void)state;
    make(&r, 1.0);
    r.c.dim = (struct apc_dim){3, 2, 2, 0};
    assert_int_equal(configure(&r, r.c.dim, &setting, 1, NULL), 0);
    for (int i = 0; i < LOOPS; i++) {
        double *p = r.tuning + i * PARAMS;

        p[KP] = i ? 3.0 : 2.0;
        p[TAU_I] = i ? 8.0 : 4.0;
        p[B] = 0.5;
        p[KFF] = i ? -7.0 : 5.0;
        p[U_BAR] = i ? 200.0 : 100.0;
    }
    r.y[0] = r.z[0] = 1.0;
    r.y[1] = r.z[1] = 2.0;
    r.y[2] = 4.0;
    laws_reset(r.law, &r.c);
    compute(&r);
    assert_near(r.u[0], 100.0, 1e-12);
    assert_near(r.u[1], 200.0, 1e-12);
    r.y[2] = 5.0; /* the disturbance of the first; y[0] is that of the second */
    r.z[1] = 4.0;
    tick(&r);
    assert_near(r.u[0], 105.0, 1e-12);
    assert_near(r.u[1], 203.0, 1e-12);
    tick(&r);
    assert_near(r.u[0], 105.0, 1e-12);
    assert_near(r.u[1], 203.0 + 3.0 / 8.0 * 2.0, 1e-12);
}

/* ---- Pairing --------------------------------------------------------------------------------- */

/* Promise(laws/pid) */
static void outputs_are_paired_with_measurements_at_will(void **state)
{
    const double measurement[] = {2.0, 1.0}, setpoint[] = {1.0, 2.0};
    const struct apc_setting setting[] = {{"measurement", NULL, 1, 2, measurement},
                                          {"setpoint", NULL, 1, 2, setpoint}};
    struct rig r;

    (void)state;
    make(&r, 1.0);
    r.c.dim = (struct apc_dim){2, 2, 2, 0};
    r.y[0] = 1.0;
    r.y[1] = 20.0;
    r.z[0] = 300.0;
    r.z[1] = 4000.0;
    assert_int_equal(configure(&r, r.c.dim, NULL, 0, NULL), 0);
    compute(&r);
    assert_near(r.u[0], 299.0, 1e-12);
    assert_near(r.u[1], 3980.0, 1e-12);
    assert_int_equal(configure(&r, r.c.dim, setting, 1, NULL),
                     0); /* the setpoints go with the measurements */
    compute(&r);
    assert_near(r.u[0], 3980.0, 1e-12);
    assert_near(r.u[1], 299.0, 1e-12);
    assert_int_equal(configure(&r, r.c.dim, setting, 2, NULL), 0);
    compute(&r);
    assert_near(r.u[0], 280.0, 1e-12);
    assert_near(r.u[1], 3999.0, 1e-12);
}

static void a_pairing_that_does_not_exist_is_refused(void **state)
{
    const double beyond = 3.0, part = 1.5, none = 0.0, two[] = {1.0, 1.0};
    const struct apc_setting bad[] = {
        {"measurement", NULL, 1, 1, &beyond}, {"measurement", NULL, 1, 1, &part},
        {"measurement", NULL, 1, 1, &none},   {"measurement", NULL, 1, 2, two},
        {"setpoint", NULL, 1, 1, &beyond},    {"feed_forward", NULL, 1, 1, &beyond},
    };
    struct apc_error why;
    struct rig r;

    (void)state;
    make(&r, 1.0);
    for (size_t i = 0; i < sizeof(bad) / sizeof(bad[0]); i++) {
        assert_int_equal(configure(&r, (struct apc_dim){2, 1, 1, 0}, &bad[i], 1, &why), APC_EINVAL);
        assert_non_null(strstr(why.text, bad[i].name));
    }
    assert_int_equal(configure(&r, (struct apc_dim){1, 1, 2, 0}, NULL, 0, &why), APC_EINVAL);
    assert_non_null(strstr(why.text, "output 2"));
    for (int output = 0; output < 2;
         output++) { /* there is such a measurement, but no setpoint of its number */
        const double second[] = {output ? 1.0 : 2.0, output ? 2.0 : 1.0};
        const struct apc_setting setting = {"measurement", NULL, 1, 2, second};

        assert_int_equal(configure(&r, (struct apc_dim){2, 1, 2, 0}, &setting, 1, &why), APC_EINVAL);
        assert_non_null(strstr(why.text, output ? "output 2 would control measurement 2 to setpoint 2"
                                                : "output 1 would control measurement 2 to setpoint 2"));
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test_teardown(the_servo_under_pid_overshoots_as_published, laws_end),
        cmocka_unit_test_teardown(the_servo_under_pd_loses_damping_with_delay_as_published, laws_end),
        cmocka_unit_test_teardown(the_servo_under_pd_is_unstable_above_13_8_ms_of_delay, laws_end),
        cmocka_unit_test_teardown(the_pendulum_swings_as_far_as_published, laws_end),
        cmocka_unit_test_teardown(the_quadruple_tank_overshoots_and_settles_as_published, laws_end),
        cmocka_unit_test_teardown(without_derivative_it_gives_the_papers_sequence, laws_end),
        cmocka_unit_test_teardown(setpoint_weights_scale_what_a_setpoint_step_gives_at_once, laws_end),
        cmocka_unit_test_teardown(the_derivative_of_the_measurement_is_filtered, laws_end),
        cmocka_unit_test_teardown(a_first_measurement_far_from_zero_gives_no_derivative, laws_end),
        cmocka_unit_test_teardown(at_its_setpoint_it_begins_with_u_bar_whatever_the_weight, laws_end),
        cmocka_unit_test_teardown(with_u_bar_beyond_its_limits_it_begins_at_the_limit, laws_end),
        cmocka_unit_test_teardown(without_integral_it_begins_with_its_proportional_part, laws_end),
        cmocka_unit_test_teardown(conditional_integration_stands_still_in_saturation, laws_end),
        cmocka_unit_test_teardown(conditional_integration_knows_the_smallest_errors, laws_end),
        cmocka_unit_test_teardown(back_calculation_settles_at_a_distance_from_the_limit, laws_end),
        cmocka_unit_test_teardown(the_output_changes_no_faster_than_its_rate_limit, laws_end),
        cmocka_unit_test_teardown(the_rate_limit_begins_at_what_went_out, laws_end),
        cmocka_unit_test_teardown(a_limit_tuned_below_the_output_is_approached_at_the_rate_limit, laws_end),
        cmocka_unit_test_teardown(after_track_it_gives_the_tracked_output, laws_end),
        cmocka_unit_test_teardown(after_a_gap_the_derivative_begins_anew, laws_end),
        cmocka_unit_test_teardown(after_a_gap_nothing_is_left_of_the_slopes_before, laws_end),
        cmocka_unit_test_teardown(without_integral_a_bumpless_change_dies_out_with_tau_t, laws_end),
        cmocka_unit_test_teardown(without_integral_and_tau_t_a_bumpless_change_fades, laws_end),
        cmocka_unit_test_teardown(no_tuning_that_is_allowed_gives_what_is_no_number, laws_end),
        cmocka_unit_test_teardown(without_integral_an_error_that_stays_leaves_nothing_behind, laws_end),
        cmocka_unit_test_teardown(a_change_of_gain_or_derivative_leaves_nothing_of_the_old_one, laws_end),
        cmocka_unit_test_teardown(a_measured_disturbance_is_fed_forward_as_it_changes, laws_end),
        cmocka_unit_test_teardown(a_disturbance_of_the_controllers_own_is_fed_forward, laws_end),
        cmocka_unit_test_teardown(each_output_has_its_own_loop_tuning_and_disturbance, laws_end),
        cmocka_unit_test_teardown(outputs_are_paired_with_measurements_at_will, laws_end),
        cmocka_unit_test_teardown(a_pairing_that_does_not_exist_is_refused, laws_end),
    };

    return cmocka_run_group_tests(tests, NULL, NULL);
}

/* SPDX-License-Identifier: BSD-3-Clause */
/* Loops drawn at random, gone through a second time, event by event: what is said of them is what happens. */
#include <complex.h>
#include <stdio.h>
#include <stdlib.h>

#include "check.h"

#include "analyze/analyze_internal.h"
#include "apcbase.h"

#define MS     ((apc_ns)1000000)
#define PERIOD (1000 * MS)
#define J      ((double complex)I)

enum { NX = 2, NU = 2, NY = 2, LAWS = 2, OUTS = 3, INS = 4, TICKS = 3, KICKS = 5, PERIODS = 300 };
enum { FIRST = 5 }; /* period of which something is looked at: by then all that acts was computed */

/* ---- A loop ------------------------------------------------------------------------------------------- */

/* The first controller ticks twice a period, reads what the second leaves for it, and remembers its output. */
static const struct apc_loop_source first_in[] = {
    {APC_FROM_MEASUREMENT, 1}, {APC_FROM_OWN, 0}, {APC_FROM_NONE, 0}, {APC_FROM_OUTPUT, 2}};
static const struct apc_loop_source second_in[] = {
    {APC_FROM_MEASUREMENT, 1}, {APC_FROM_OUTPUT, 0}, {APC_FROM_MEASUREMENT, 0}, {APC_FROM_OWN, 1}};
static const size_t first_to[] = {1}, second_to[] = {0, APC_LOOP_NOWHERE};
static const size_t controller_of[OUTS] = {0, 1, 1}, input_of[OUTS] = {1, 0, APC_LOOP_NOWHERE};

struct world {
    double A[NX * NX], B[NX * NU], C[NY * NX], D[NY * NU], noise[NX], sensor[NY];
    double a[LAWS], b[LAWS][INS], c[LAWS][2], d[LAWS][2 * INS];
    struct apc_loop_controller law[LAWS];
    struct apc_loop_tick tick[TICKS];
    struct apc_loop_setup setup;
};

static double drawn(double low, double high)
{
    return low + (high - low) * rand() / RAND_MAX; // NOLINT
}

static void draw(size_t n, double size, double *to)
{
    for (size_t i = 0; i < n; i++)
        to[i] = drawn(-size, size);
}

/* At uneven times, so that no two things happen at once. @p computed: about; ms. @p age: ns of what was
 * measured. */
static struct apc_loop_tick tick(size_t controller, double computed, apc_ns age)
{
    const apc_ns at = (apc_ns)((computed + drawn(0.0, 90.0)) * 1e6);

    return (struct apc_loop_tick){controller, at - age, at, at + (apc_ns)drawn(1e6, 900e6),
                                  at + (apc_ns)drawn(1e6, 1700e6)};
}

static void draw_world(struct world *w, unsigned seed)
{
    srand(seed);
    draw(NX * NX, 0.4, w->A);
    w->A[0] -= 0.7;
    w->A[3] -= 0.9;
    draw(NX * NU, 1.0, w->B);
    draw(NY * NX, 2.0, w->C);
    draw(NY * NU, 0.2, w->D);
    for (size_t i = 0; i < NX; i++)
        w->noise[i] = drawn(0.5, 2.0);
    for (size_t i = 0; i < NY; i++)
        w->sensor[i] = drawn(0.5, 2.0);
    draw(LAWS, 0.6, w->a);
    for (size_t c = 0; c < LAWS; c++) {
        draw(INS, 0.3, w->b[c]);
        draw(2, 0.5, w->c[c]);
        draw(INS * 2, 0.9, w->d[c]);
    }
    w->law[0] = (struct apc_loop_controller){.nu = 1, .in = first_in, .to = first_to};
    w->law[1] = (struct apc_loop_controller){.nu = 2, .in = second_in, .to = second_to};
    for (size_t c = 0; c < LAWS; c++) {
        struct apc_loop_controller *law = &w->law[c];

        law->nx = 1;
        law->n_in = INS;
        law->A = &w->a[c];
        law->B = w->b[c];
        law->C = w->c[c];
        law->D = w->d[c];
    }
    const apc_ns age = (apc_ns)drawn(1e6, 900e6);
    w->tick[0] = tick(0, 10.0, age);
    w->tick[1] = tick(1, 310.0, (apc_ns)drawn(1e6, 1500e6));
    w->tick[2] = tick(0, 610.0, age);
    w->setup = (struct apc_loop_setup){.size = sizeof w->setup,
                                       .plant = {.nx = NX,
                                                 .nu = NU,
                                                 .ny = NY,
                                                 .A = w->A,
                                                 .B = w->B,
                                                 .C = w->C,
                                                 .D = w->D,
                                                 .dead_time = seed % 2 ? (apc_ns)drawn(0.0, 1200e6) : 0,
                                                 .period = PERIOD / KICKS,
                                                 .noise = w->noise,
                                                 .sensor = w->sensor},
                                       .n_controllers = LAWS,
                                       .controller = w->law,
                                       .period = PERIOD,
                                       .n_ticks = TICKS,
                                       .tick = w->tick};
}

static struct apc_loop *made(const struct apc_loop_setup *setup)
{
    struct apc_loop *loop;
    struct apc_error why;

    if (apc_loop_create(&loop, setup, &why) < 0)
        fail_msg("%s", why.text);
    return loop;
}

/* ---- What happens in it ------------------------------------------------------------------------------- */

struct event {
    apc_ns at;
    enum { LOOK, SAMPLE, COMPUTE, ACT } kind;
    size_t period, k; /* k: of the tick, or of the look in its period */
    size_t output;
};

/* What happens of itself, once, or what goes in at one output instead of what is computed. */
struct cause {
    enum { NOTHING, DISTURB, MISMEASURE, PULSE, DRIVE } kind;
    size_t k, i; /* in period FIRST: at which look or tick, which state, input or output */
    double w;    /* rad/s, of a DRIVE */
    bool sine;
};

struct course_seen {
    double x[NX], acting[OUTS], state[LAWS], own[LAWS][2];
    double sample[PERIODS][TICKS][INS], computed[PERIODS][TICKS][2];
    double begun[PERIODS]; /* a mixture of what there is when each period begins */
    double y2[NY], u2[OUTS];
};

static int earlier(const void *a, const void *b)
{
    const struct event *x = a, *y = b;

    return x->at < y->at ? -1 : x->at > y->at;
}

static size_t list_events(const struct world *w, struct event *to)
{
    size_t n = 0;

    for (size_t p = 0; p < PERIODS; p++) {
        const apc_ns t = (apc_ns)p * PERIOD;

        for (size_t k = 0; k < KICKS; k++)
            to[n++] = (struct event){t + (apc_ns)k * w->setup.plant.period, LOOK, p, k, 0};
        for (size_t k = 0; k < TICKS; k++) {
            const struct apc_loop_tick *tick = &w->tick[k];

            to[n++] = (struct event){t + tick->sampled, SAMPLE, p, k, 0};
            to[n++] = (struct event){t + tick->computed, COMPUTE, p, k, 0};
            for (size_t o = 0; o < OUTS; o++) {
                if (controller_of[o] == tick->controller)
                    to[n++] = (struct event){input_of[o] == APC_LOOP_NOWHERE
                                                 ? t + tick->written
                                                 : t + tick->acts + w->setup.plant.dead_time,
                                             ACT, p, k, o};
            }
        }
    }
    qsort(to, n, sizeof *to, earlier);
    return n;
}

/* By Taylor's series. */
static void move(const struct world *w, const double *u, double dt, double *x)
{
    double d[NX] = {0.0}, next[NX];

    for (size_t i = 0; i < NX; i++)
        d[i] = w->A[i * NX] * x[0] + w->A[i * NX + 1] * x[1] + w->B[i * NU] * u[0] + w->B[i * NU + 1] * u[1];
    for (int k = 1; k < 20; k++) {
        for (size_t i = 0; i < NX; i++) {
            d[i] *= dt / k;
            x[i] += d[i];
        }
        for (size_t i = 0; i < NX; i++)
            next[i] = w->A[i * NX] * d[0] + w->A[i * NX + 1] * d[1];
        memcpy(d, next, sizeof d);
    }
}

static double seen(const struct world *w, const struct course_seen *s, size_t i)
{
    return w->C[i * NX] * s->x[0] + w->C[i * NX + 1] * s->x[1] + w->D[i * NU] * s->acting[1] +
           w->D[i * NU + 1] * s->acting[0];
}

static void compute(const struct world *w, const struct event *e, struct course_seen *s)
{
    const size_t c = w->tick[e->k].controller;
    const struct apc_loop_controller *law = &w->law[c];
    double in[INS], x = w->a[c] * s->state[c], u[2];

    for (size_t i = 0; i < INS; i++) {
        const struct apc_loop_source *of = &law->in[i];

        in[i] = of->from == APC_FROM_MEASUREMENT ? s->sample[e->period][e->k][i]
                : of->from == APC_FROM_OUTPUT    ? s->acting[of->number]
                : of->from == APC_FROM_OWN       ? s->own[c][of->number]
                                                 : 0.0;
        x += w->b[c][i] * in[i];
    }
    for (size_t o = 0; o < law->nu; o++) {
        u[o] = w->c[c][o] * s->state[c];
        for (size_t i = 0; i < INS; i++)
            u[o] += w->d[c][o * INS + i] * in[i];
    }
    s->state[c] = x;
    memcpy(s->own[c], u, sizeof u);
    memcpy(s->computed[e->period][e->k], u, sizeof u);
}

/* What is looked at has been disturbed already. */
static void look(const struct world *w, const struct event *e, const struct cause *cause,
                 struct course_seen *s)
{
    const double one[NU] = {input_of[cause->i % OUTS] == 0, input_of[cause->i % OUTS] == 1};
    const size_t number = e->period * KICKS + e->k - FIRST * KICKS;

    if (cause->kind == DISTURB && number == cause->k)
        s->x[cause->i] += w->noise[cause->i] * sqrt(1.0 / (double)KICKS);
    if (cause->kind == PULSE && number == cause->k + 1) { /* when it has ended */
        double whole[NX] = {0.0};

        move(w, one, 1.0 / (double)KICKS, whole);
        for (size_t i = 0; i < NX; i++)
            s->x[i] += whole[i];
    }
    for (size_t i = 0; i < NY; i++)
        s->y2[i] += seen(w, s, i) * seen(w, s, i) / (double)KICKS;
    for (size_t o = 0; o < OUTS; o++)
        s->u2[o] += s->acting[o] * s->acting[o] / (double)KICKS;
    if (e->k == 0)
        s->begun[e->period] = s->x[0] - 0.6 * s->x[1] + 0.8 * s->acting[0] + 0.3 * s->acting[1] +
                              0.5 * s->acting[2] + s->state[0] - 0.7 * s->state[1];
}

static void happen(const struct world *w, const struct event *e, const struct cause *cause,
                   struct course_seen *s)
{
    const struct apc_loop_tick *tick = &w->tick[e->k % TICKS];
    const struct apc_loop_controller *law = &w->law[tick->controller];

    if (e->kind == LOOK) {
        look(w, e, cause, s);
    } else if (e->kind == SAMPLE) {
        for (size_t i = 0; i < INS; i++) {
            const bool wrong =
                cause->kind == MISMEASURE && e->period == FIRST && e->k == cause->k && i == cause->i;

            if (law->in[i].from == APC_FROM_MEASUREMENT)
                s->sample[e->period][e->k][i] =
                    seen(w, s, law->in[i].number) + (wrong ? w->sensor[law->in[i].number] : 0.0);
        }
    } else if (e->kind == COMPUTE) {
        compute(w, e, s);
    } else {
        const double angle = cause->w * apc_ns_to_s((apc_ns)e->period * PERIOD + tick->computed);

        s->acting[e->output] = s->computed[e->period][e->k][e->output - (e->output > 0)];
        if (cause->kind == DRIVE && cause->i == e->output)
            s->acting[e->output] = cause->sine ? sin(angle) : cos(angle);
    }
}

static struct event event[PERIODS * (KICKS + TICKS * (2 + OUTS))];
static size_t n_events;
static struct course_seen s;

/* From where it stands, or from rest. */
static void go_through(const struct world *w, const struct cause *cause, const double *x)
{
    apc_ns now = event[0].at;

    memset(&s, 0, sizeof s);
    if (x)
        memcpy(s.x, x, sizeof s.x);
    for (size_t i = 0; i < n_events; i++) {
        const double u[NU] = {s.acting[1], s.acting[0]};

        if (event[i].at > 0) /* it stands still before */
            move(w, u, apc_ns_to_s(event[i].at - (now > 0 ? now : 0)), s.x);
        now = event[i].at;
        happen(w, &event[i], cause, &s);
    }
}

/* ---- What is said of it -------------------------------------------------------------------------------- */

static double largest_pole(const struct apc_loop_setup *setup)
{
    struct apc_loop *loop = made(setup);
    double re[100], im[100];

    assert_true(apc_loop_states(loop) <= 100);
    assert_int_equal(apc_loop_poles(loop, re, im), 0);
    apc_loop_destroy(loop);
    return hypot(re[0], im[0]);
}

/* A matrix is a root of its own polynomial: so is what follows from it, period after period. */
static void assert_poles_of_course(const struct world *w, const struct apc_loop *loop)
{
    const size_t n = apc_loop_states(loop);
    double re[100], im[100];
    double complex polynomial[101] = {1.0};

    assert_true(n <= 100);
    assert_int_equal(apc_loop_poles(loop, re, im), 0);
    for (size_t i = 0; i < n; i++) {
        for (size_t k = i + 1; k > 0; k--)
            polynomial[k] -= (re[i] + im[i] * J) * polynomial[k - 1];
    }
    go_through(w, &(struct cause){.kind = NOTHING}, (const double[]){1.0, -0.5});
    for (size_t p = FIRST; p < FIRST + 8; p++) {
        double complex sum = 0.0;
        double size = 0.0;

        for (size_t k = 0; k <= n; k++) {
            sum += polynomial[n - k] * s.begun[p + k];
            size += cabs(polynomial[n - k] * s.begun[p + k]);
        }
        assert_near(cabs(sum), 0.0, 1e-8 * size);
    }
}

/* Each error that goes in, by itself, once a period: variances add up. */
static void assert_cost_of_course(const struct world *w, const struct apc_loop *loop)
{
    const struct apc_loop_schedule half[] = {{0.5, TICKS, w->tick}, {0.5, TICKS, w->tick}};
    double y[NY], u[OUTS], y_sum[NY] = {0.0}, u_sum[OUTS] = {0.0};

    for (size_t k = 0; k < KICKS * NX + TICKS * INS; k++) {
        const struct cause cause = k < KICKS * NX ? (struct cause){.kind = DISTURB, .k = k / NX, .i = k % NX}
                                                  : (struct cause){.kind = MISMEASURE,
                                                                   .k = (k - KICKS * NX) / INS,
                                                                   .i = (k - KICKS * NX) % INS};
        go_through(w, &cause, NULL);
        for (size_t i = 0; i < NY; i++)
            y_sum[i] += s.y2[i];
        for (size_t o = 0; o < OUTS; o++)
            u_sum[o] += s.u2[o];
    }
    for (int how = 0; how < 2; how++) {
        assert_int_equal(apc_loop_cost(loop, how ? half : NULL, how ? 2 : 0, y, u, NULL), 0);
        for (size_t i = 0; i < NY; i++)
            assert_near(y[i], y_sum[i], 1e-8 * y_sum[i]);
        for (size_t o = 0; o < OUTS; o++)
            assert_near(u[o], u_sum[o], 1e-8 * u_sum[o]);
    }
}

/* What comes back of what was put in at one output, long after the beginning. */
static double complex returned(const struct world *w, size_t of, double frequency)
{
    double complex L = 0.0;
    int n = 0;

    for (int sine = 0; sine < 2; sine++) {
        go_through(w, &(struct cause){.kind = DRIVE, .i = of, .w = frequency, .sine = sine}, NULL);
        n = 0;
        for (size_t k = 0; k < TICKS; k++) {
            const double t = apc_ns_to_s((PERIODS - 3) * PERIOD + w->tick[k].computed);

            if (w->tick[k].controller != controller_of[of])
                continue;
            L -= (sine ? J : 1.0) * s.computed[PERIODS - 3][k][of - (of > 0)] * cexp(-J * frequency * t);
            n++;
        }
    }
    return L / n;
}

static void assert_responses_of_course(const struct world *w, const struct apc_loop *loop)
{
    const double frequency[] = {0.05, 0.7, 2.9};

    for (size_t of = 0; of < OUTS; of++) {
        double re[3], im[3];

        assert_int_equal(apc_loop_response(loop, of, 3, frequency, re, im), 0);
        for (size_t k = 0; k < 3; k++)
            assert_near(cabs(re[k] + im[k] * J - returned(w, of, frequency[k])), 0.0, 1e-8);
    }
}

static double complex response_at(const struct apc_loop *loop, size_t of, double w)
{
    double re, im;

    assert_int_equal(apc_loop_response(loop, of, 1, &w, &re, &im), 0);
    return re + im * J;
}

/* By how many degrees the response may be turned where it is 1 in size, between two frequencies. */
static double turn_between(const struct apc_loop *loop, size_t of, double low, double high)
{
    const bool above = cabs(response_at(loop, of, low)) >= 1.0;

    for (int k = 0; k < 40; k++) {
        const double middle = (low + high) / 2.0;

        *((cabs(response_at(loop, of, middle)) >= 1.0) == above ? &low : &high) = middle;
    }
    return fabs(carg(-response_at(loop, of, low))) * 180.0 / M_PI;
}

/* Peaks, the crossover, and the phase of an output that is computed once a period. */
static void assert_margins_of_responses(const struct apc_loop *loop, size_t of,
                                        const struct apc_loop_margins *m)
{
    enum { STEPS = 1500 };
    const double top = M_PI * (of == 0 ? 2.0 * 0.98 : 1.0), step = pow(10.0, -5.0 / (double)STEPS);
    double S = 0.0, T = 0.0, turn = HUGE_VAL, crossover = 0.0, w = top;
    bool above = false;

    for (int k = 0; k <= STEPS; k++, w *= step) {
        const double complex L = response_at(loop, of, w);

        S = fmax(S, 1.0 / cabs(1.0 + L));
        T = fmax(T, cabs(L / (1.0 + L)));
        if (k > 0 && (cabs(L) >= 1.0) != above) {
            turn = fmin(turn, turn_between(loop, of, w, w / step));
            crossover = fmax(crossover, w);
        }
        above = cabs(L) >= 1.0;
    }
    assert_near(m->sensitivity, S, 1e-3 * S);
    assert_near(m->complementary, T, 2e-2 * T);
    if (crossover > 0.0)
        assert_near(m->crossover, crossover, 0.05 * crossover);
    else
        assert_true(isnan(m->crossover));
    if (of != 0 && turn < HUGE_VAL)
        assert_near(m->phase, turn, 1e-2);
    else if (of != 0)
        assert_true(isinf(m->phase));
}

/* A pulse in each of the plant's periods, and how large what comes of it is at each frequency. */
static double jitter_of_course(const struct world *w, size_t of, size_t tick)
{
    static double back[KICKS][PERIODS];
    enum { PER_DECADE = 400, DECADES = 5 };
    double worst = 0.0;

    for (size_t k = 0; k < KICKS; k++) {
        go_through(w, &(struct cause){.kind = PULSE, .k = k, .i = of}, NULL);
        for (size_t p = 0; p < PERIODS; p++)
            back[k][p] = s.computed[p][tick][of - (of > 0)];
    }
    for (int k = 0; k <= PER_DECADE * DECADES; k++) {
        const double angle = M_PI * pow(10.0, -(double)k / (double)PER_DECADE);
        double sum = 0.0;

        for (size_t i = 0; i < KICKS; i++) {
            double complex t = 0.0;

            for (size_t p = PERIODS; p-- > 0;)
                t = t * cexp(-J * angle) + back[i][p];
            sum += creal(t) * creal(t) + cimag(t) * cimag(t);
        }
        worst = fmax(worst, 2.0 * sin(angle / 2.0) * sqrt(sum));
    }
    const double allowed = 1.0 / (worst * worst * (double)KICKS), N = floor(sqrt(allowed));
    return N + (allowed - N * N) / (2.0 * N + 1.0);
}

static bool changed(size_t of, size_t output)
{
    return of == APC_LOOP_WHOLE ? input_of[output] != APC_LOOP_NOWHERE : of == output;
}

/* Wherever the outputs go to, they are so many times as large. */
static double pole_scaled(const struct world *w, size_t of, double factor)
{
    struct world v = *w;

    for (size_t o = 0; o < OUTS; o++) {
        if (!changed(of, o))
            continue;
        for (size_t i = 0; i < NX && input_of[o] < NU; i++) {
            v.B[i * NU + input_of[o]] *= factor;
            v.D[i * NU + input_of[o]] *= factor;
        }
        for (size_t c = 0; c < LAWS; c++) {
            for (size_t i = 0; i < INS; i++) {
                if (w->law[c].in[i].from != APC_FROM_OUTPUT || w->law[c].in[i].number != o)
                    continue;
                v.b[c][i] *= factor;
                v.d[c][i] *= factor;
                v.d[c][INS + i] *= factor;
            }
        }
    }
    for (size_t c = 0; c < LAWS; c++) {
        v.law[c].B = v.b[c];
        v.law[c].D = v.d[c];
    }
    v.setup.controller = v.law;
    v.setup.plant.B = v.B;
    v.setup.plant.D = v.D;
    return largest_pole(&v.setup);
}

static double pole_delayed(const struct world *w, size_t of, double delay)
{
    struct world v = *w;

    for (size_t k = 0; k < TICKS; k++)
        v.tick[k].acts += v.tick[k].controller == of ? (apc_ns)(delay * 1e9) : 0;
    v.setup.tick = v.tick;
    v.setup.plant.dead_time += of == APC_LOOP_WHOLE ? (apc_ns)(delay * 1e9) : 0;
    return largest_pole(&v.setup);
}

/* Within a margin the poles are, beyond it one is not. */
static void assert_margins_of_poles(const struct world *w, size_t of, const struct apc_loop_margins *m)
{
    const double within[] = {1.0 - 1e-5, 1.0 + 1e-5};

    for (int beyond = 0; beyond < 2; beyond++) {
        const double by = within[beyond];

        if (m->gain < HUGE_VAL)
            assert_int_equal(pole_scaled(w, of, m->gain * by) > 1.0, beyond);
        if (m->gain_low > 0.0)
            assert_int_equal(pole_scaled(w, of, m->gain_low / by) > 1.0, beyond);
        if (of != 2 && m->delay < 8.0) /* periods: with each there are more poles */
            assert_int_equal(pole_delayed(w, of, m->delay * by) > 1.0, beyond);
    }
}

/* Promise(analysis/margins-loop-ticks) */
static void a_loop_does_what_is_said_of_it(void **state)
{
    static const size_t which[] = {0, 1, 2, APC_LOOP_WHOLE};
    static const unsigned settling[] = {20, 29, 33, 54, 56, 64, 70}; /* soon, cut open or not */
    (void)state;

    for (size_t n = 0; n < sizeof settling / sizeof *settling; n++) {
        struct world w;

        draw_world(&w, settling[n]);
        n_events = list_events(&w, event);
        struct apc_loop *loop = made(&w.setup);

        assert_int_equal(apc_loop_outputs(loop), OUTS);
        assert_poles_of_course(&w, loop);
        assert_cost_of_course(&w, loop);
        assert_responses_of_course(&w, loop);
        for (size_t k = 0; k < sizeof which / sizeof *which; k++) {
            struct apc_loop_margins m = {.size = sizeof m};

            assert_int_equal(apc_loop_margins(loop, which[k], NULL, &m, NULL), 0);
            assert_true(m.stable);
            assert_margins_of_poles(&w, which[k], &m);
            if (which[k] != APC_LOOP_WHOLE)
                assert_margins_of_responses(loop, which[k], &m);
            assert_int_equal(isnan(m.jitter), which[k] != 1);
            if (which[k] == 1) { /* a scan may miss a little of a peak, and it cannot */
                const double jitter = jitter_of_course(&w, 1, 1);

                assert_true(m.jitter <= jitter * (1.0 + 1e-6) && m.jitter >= 0.999 * jitter);
            }
        }
        apc_loop_destroy(loop);
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(a_loop_does_what_is_said_of_it),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}

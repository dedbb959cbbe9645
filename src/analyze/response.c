/* SPDX-License-Identifier: BSD-3-Clause */
/* The loop cut open: what comes back at each frequency, and the peaks of that. */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "analyze/analyze_internal.h"

/* ---- The frequency response ------------------------------------------------------------------ */

/* The loop cut open at some outputs, [m] of them. */
struct open {
    struct machine machine;
    const struct apc_loop *loop;
    size_t m, *of;             /* [m] */
    size_t *place;             /* [n_out] among them, or m */
    double *map;               /* [n * n] of the open loop */
    double complex *A, *X, *L; /* [n * n], [n * m], [m * m] */
    double *Z;                 /* [n * 2 m] */
    size_t *ticks;             /* [m] how often each acts in a period */
    size_t *slot; /* [n_steps] lifted: each time that one acts counts as an output of its own, this one; NULL:
                     not */
    double w;
    bool listens;
};

static void cut_dead(void *ctx, const struct step *step, const double *slot, double *acting)
{
    const struct open *o = ctx;
    const size_t w = o->machine.n;

    if (o->place[step->number] < o->m)
        memset(acting, 0, w * sizeof(*acting));
    else
        memcpy(acting, slot, w * sizeof(*acting));
}

/* What goes in is exp(i w t), t being when it was computed; what comes back is compared with that. */
static void cut_driven(void *ctx, const struct step *step, const double *slot, double *acting)
{
    struct open *o = ctx;
    const size_t k = o->place[step->number], m = o->m;
    const double angle = o->w * apc_ns_to_s(step->tick), c = cos(angle), s = sin(angle);

    if (k == m) {
        memcpy(acting, slot, 2 * m * sizeof(*acting));
        return;
    }
    for (size_t j = 0; j < m && o->listens; j++)
        o->L[k * m + j] -= complex_of(slot[j], slot[m + j]) * complex_of(c, -s) / (double)o->ticks[k];
    memset(acting, 0, 2 * m * sizeof(*acting));
    acting[k] = c;
    acting[m + k] = s;
}

/* What goes in is 1 whenever it is that one's turn in a period; what comes back is taken then. */
static void cut_lifted(void *ctx, const struct step *step, const double *slot, double *acting)
{
    struct open *o = ctx;
    const size_t k = o->slot[step - o->machine.step], m = o->m;

    if (k == m) {
        memcpy(acting, slot, 2 * m * sizeof(*acting));
        return;
    }
    for (size_t j = 0; j < m && o->listens; j++)
        o->L[k * m + j] -= complex_of(slot[j], slot[m + j]);
    memset(acting, 0, 2 * m * sizeof(*acting));
    acting[k] = 1.0;
}

static void open_free(struct open *o)
{
    machine_free(&o->machine);
    free(o->slot);
    free(o->of);
    free(o->map);
    free(o->A);
    free(o->Z);
}

static int lift(struct open *o)
{
    const size_t outputs = o->m;

    o->slot = calloc(o->machine.n_steps + 1, sizeof(*o->slot));
    if (!o->slot)
        return APC_ENOMEM;
    o->m = 0;
    for (size_t k = 0; k < outputs; k++)
        o->m += o->ticks[k];
    for (size_t i = 0, next = 0; i < o->machine.n_steps; i++) {
        const struct step *step = &o->machine.step[i];
        const bool cut = step->kind == STEP_ACT && o->place[step->number] < outputs;

        o->slot[i] = cut ? next++ : o->m;
    }
    for (size_t k = 0; k < o->loop->n_out; k++)
        o->place[k] = o->place[k] < outputs ? o->place[k] : o->m;
    return 0;
}

/* @p delay: by which outputs act later, of a loop that is lifted; NULL: it is not. */
static int open_create(struct open *o, const struct apc_loop *loop, size_t of, const double *delay)
{
    const struct apc_loop_setup *s = &loop->setup;
    const struct course course = {.period = s->period, .n = s->n_ticks, .tick = s->tick, .delay = delay};
    struct ride ride;
    size_t n;
    int rc;

    *o = (struct open){.loop = loop, .of = calloc(3 * loop->n_out, sizeof(*o->of))};
    rc = machine_create(&o->machine, loop, &course, NULL);
    n = o->machine.n;
    if (rc < 0 || !o->of)
        return rc < 0 ? rc : APC_ENOMEM;
    o->place = o->of + loop->n_out;
    o->ticks = o->place + loop->n_out;
    for (size_t k = 0; k < loop->n_out; k++) {
        if (of == APC_LOOP_WHOLE ? loop->to[k] != APC_LOOP_NOWHERE : of == k)
            o->of[o->m++] = k;
    }
    for (size_t k = 0; k < loop->n_out; k++)
        o->place[k] = o->m;
    for (size_t k = 0; k < o->m; k++)
        o->place[o->of[k]] = k;
    for (size_t i = 0; i < o->machine.n_steps; i++) {
        const struct step *step = &o->machine.step[i];

        if (step->kind == STEP_ACT && o->place[step->number] < o->m)
            o->ticks[o->place[step->number]]++;
    }
    if (delay && (rc = lift(o)) < 0)
        return rc;
    o->map = calloc(n * n + 1, sizeof(*o->map));
    o->A = calloc(n * n + n * o->m + o->m * o->m + 1, sizeof(*o->A));
    o->Z = calloc(2 * n * o->m + 1, sizeof(*o->Z));
    if (!o->map || !o->A || !o->Z)
        return APC_ENOMEM;
    o->X = o->A + n * n;
    o->L = o->X + n * o->m;
    for (size_t i = 0; i < n; i++)
        o->map[i * n + i] = 1.0;
    ride = (struct ride){.Z = o->map, .width = n, .cut = cut_dead, .ctx = o};
    return machine_ride(&o->machine, &ride);
}

static int drive(struct open *o, bool listens)
{
    struct ride ride = {.Z = o->Z, .width = 2 * o->m, .cut = o->slot ? cut_lifted : cut_driven, .ctx = o};

    o->listens = listens;
    return machine_ride(&o->machine, &ride);
}

/* L [m * m] at w. */
static int respond(struct open *o, double w)
{
    const size_t n = o->machine.n, m = o->m;
    const double angle = w * apc_ns_to_s(o->loop->setup.period);
    int rc;

    o->w = w;
    memset(o->Z, 0, 2 * n * m * sizeof(*o->Z));
    memset(o->L, 0, m * m * sizeof(*o->L));
    rc = drive(o, false);
    for (size_t i = 0; i < n * n; i++)
        o->A[i] = (i % (n + 1) == 0 ? complex_of(cos(angle), sin(angle)) : 0.0) - o->map[i];
    for (size_t i = 0; i < n; i++) {
        for (size_t j = 0; j < m; j++)
            o->X[i * m + j] = complex_of(o->Z[i * 2 * m + j], o->Z[i * 2 * m + m + j]);
    }
    if (rc == 0 && complex_solve(n, m, o->A, o->X))
        rc = APC_ESOLVER; /* a pole of the open loop lies there */
    for (size_t i = 0; i < n; i++) {
        for (size_t j = 0; j < m; j++) {
            o->Z[i * 2 * m + j] = creal(o->X[i * m + j]);
            o->Z[i * 2 * m + m + j] = cimag(o->X[i * m + j]);
        }
    }
    return rc < 0 ? rc : drive(o, true);
}

int apc_loop_response(const struct apc_loop *loop, size_t of, size_t n, const double *w, double *re,
                      double *im)
{
    struct open o;
    int rc;

    if (of >= loop->n_out)
        return APC_EINVAL;
    rc = open_create(&o, loop, of, NULL);
    for (size_t k = 0; k < n && rc == 0; k++) {
        const bool there = respond(&o, w[k]) == 0 && o.ticks[0];

        re[k] = there ? creal(o.L[0]) : (double)NAN;
        im[k] = there ? cimag(o.L[0]) : (double)NAN;
    }
    open_free(&o);
    return rc;
}

/* ---- Peaks ----------------------------------------------------------------------------------- */

struct peaks {
    struct open open;
    const double *scale;
    double complex *S, *T; /* [m * m] */
};

/* The largest singular value of M [m * m], by the power method: a peak needs no more. */
static double largest_gain(size_t m, const double complex *M)
{
    double size = 0.0, sum = 0.0;
    double complex x[64], y[64];

    if (m == 1)
        return cabs(M[0]);
    for (size_t i = 0; i < m; i++)
        x[i] = 1.0 + 0.1 * (double)i;
    for (int k = 0; k < 100; k++) {
        for (size_t i = 0; i < m; i++) {
            y[i] = 0.0;
            for (size_t j = 0; j < m; j++)
                y[i] += M[i * m + j] * x[j];
        }
        sum = 0.0;
        for (size_t j = 0; j < m; j++) {
            x[j] = 0.0;
            for (size_t i = 0; i < m; i++)
                x[j] += conj(M[i * m + j]) * y[i];
            sum += creal(x[j]) * creal(x[j]) + cimag(x[j]) * cimag(x[j]);
        }
        if (!(sum > 0.0))
            return 0.0;
        size = sqrt(sqrt(sum));
        for (size_t j = 0; j < m; j++)
            x[j] /= sqrt(sum);
    }
    return size;
}

/* Of 1 / (1 + L) and L / (1 + L) at @p w, as large as they are in scaled outputs. */
static int peaks_at(struct peaks *p, double w, double *s, double *t, double *l)
{
    struct open *o = &p->open;
    const size_t m = o->m;
    int rc = respond(o, w);

    if (rc < 0)
        return rc;
    for (size_t i = 0; i < m; i++) {
        for (size_t j = 0; j < m; j++) {
            const double by = p->scale ? p->scale[o->of[j]] / p->scale[o->of[i]] : 1.0;

            p->T[i * m + j] = o->L[i * m + j] * by;
            p->S[i * m + j] = i == j ? 1.0 : 0.0;
            o->L[i * m + j] = p->S[i * m + j] + p->T[i * m + j];
        }
    }
    *l = largest_gain(m, p->T);
    if (complex_solve(m, m, o->L, p->S))
        return APC_ESOLVER;
    for (size_t i = 0; i < m * m; i++)
        p->T[i] = (i % (m + 1) == 0 ? 1.0 : 0.0) - p->S[i];
    *s = largest_gain(m, p->S);
    *t = largest_gain(m, p->T);
    return 0;
}

/* The top between two frequencies at a distance of a step from the highest point found. */
static int climb(struct peaks *p, double low, double high, struct apc_loop_margins *to)
{
    int rc = 0;

    for (int k = 0; k < 40 && rc == 0; k++) {
        double a = low + 0.382 * (high - low), b = low + 0.618 * (high - low), sa = 0.0, sb = 0.0, t, l;

        rc = peaks_at(p, exp(a), &sa, &t, &l);
        if (rc == 0)
            rc = peaks_at(p, exp(b), &sb, &t, &l);
        if (rc < 0)
            break;
        if (fmax(sa, sb) > to->sensitivity) {
            to->sensitivity = fmax(sa, sb);
            to->at = exp(sa > sb ? a : b);
        }
        *(sa > sb ? &high : &low) = sa > sb ? b : a;
    }
    return rc;
}

/* Nearly the highest Nyquist frequency of those cut open. */
static double nyquist(const struct open *o)
{
    size_t most = 1;

    for (size_t k = 0; k < o->m; k++)
        most = o->ticks[k] > most ? o->ticks[k] : most;
    return 0.98 * M_PI * (double)most / apc_ns_to_s(o->loop->setup.period);
}

/* @p delay: the phase over the frequency, the least of all crossovers: where to look for the margin. */
static int survey(struct peaks *p, struct apc_loop_margins *to, double *delay)
{
    const double top = log(nyquist(&p->open)), step = log(10.0) / PER_DECADE;
    double l_before = 0.0, phase, s, t, l;
    int rc = 0;

    *delay = HUGE_VAL;
    to->crossover = (double)NAN;
    for (int k = PER_DECADE * DECADES; k >= 0 && rc == 0; k--) {
        const double w = exp(top - k * step);

        rc = peaks_at(p, w, &s, &t, &l);
        if (rc == APC_ESOLVER) { /* just on a pole of the open loop */
            rc = 0;
            continue;
        }
        if (rc < 0)
            break;
        if (s > to->sensitivity) {
            to->sensitivity = s;
            to->at = w;
        }
        to->complementary = fmax(to->complementary, t);
        if (l >= 1.0 || l_before >= 1.0) {
            rc = respond(&p->open, w);
            phase = p->open.m == 1 ? carg(-p->open.L[0]) : 0.2;
            *delay = fmin(*delay, (phase > 0.01 ? phase : phase + 2.0 * M_PI) / w);
        }
        if ((l >= 1.0) != (l_before >= 1.0) && k < PER_DECADE * DECADES)
            to->crossover = w;
        l_before = l;
    }
    return rc < 0 ? rc : climb(p, log(to->at) - step, fmin(log(to->at) + step, top), to);
}

int response_peaks(const struct apc_loop *loop, size_t of, const double *scale, struct apc_loop_margins *to,
                   double *delay)
{
    struct peaks p = {.scale = scale};
    int rc = open_create(&p.open, loop, of, NULL);
    const size_t m = p.open.m;

    p.S = calloc(2 * m * m + 1, sizeof(*p.S));
    p.T = p.S + m * m;
    if (rc == 0)
        rc = !p.S ? APC_ENOMEM : m == 0 || m > 64 ? APC_EINVAL : survey(&p, to, delay);
    free(p.S);
    open_free(&p.open);
    return rc;
}

/* ---- Delay ----------------------------------------------------------------------------------- */

static int by_size(const void *a, const void *b)
{
    const double x = cabs(*(const double complex *)a), y = cabs(*(const double complex *)b);

    return x > y ? -1 : x < y;
}

/* The eigenvalues of L at @p w, the largest first. */
static int roots_at(struct open *o, double w, double complex *root)
{
    int rc = respond(o, w);

    if (rc == 0)
        rc = eigenvalues(o->m, o->L, root);
    if (rc == 0)
        qsort(root, o->m, sizeof(*root), by_size);
    return rc;
}

/* Where the root of place @p i is 1 in size, between two frequencies: after which delay it is -1. */
static int delay_between(struct open *o, size_t i, double low, double high, bool above, double complex *root,
                         double *delay)
{
    double phase;
    int rc = 0;

    for (int k = 0; k < 50 && rc == 0; k++) {
        const double middle = sqrt(low * high);

        rc = roots_at(o, middle, root);
        *((cabs(root[i]) >= 1.0) == above ? &low : &high) = middle;
    }
    phase = carg(-root[i]);
    if (rc == 0)
        *delay = fmin(*delay, (phase > 0.0 ? phase : phase + 2.0 * M_PI) / low);
    return rc;
}

static int find_delay(struct open *o, double complex *root, bool *above, double *delay)
{
    const double top = log(0.9999 * M_PI / apc_ns_to_s(o->loop->setup.period)), step = log(10.0) / PER_DECADE;
    double before = 0.0;

    for (int k = 0; k <= PER_DECADE * DECADES; k++) {
        const double w = exp(top - (PER_DECADE * DECADES - k) * step);
        int rc = roots_at(o, w, root);

        if (rc == APC_ESOLVER)
            continue;
        for (size_t i = 0; i < o->m && rc == 0; i++) {
            const bool was = above[i];

            above[i] = cabs(root[i]) >= 1.0;
            if (before > 0.0 && above[i] != was) {
                rc = delay_between(o, i, before, w, was, root, delay);
                if (rc == 0)
                    rc = roots_at(o, w, root);
            }
        }
        if (rc < 0)
            return rc;
        before = w;
    }
    return 0;
}

int response_delay(const struct apc_loop *loop, size_t of, const double *later, double *delay)
{
    struct open o;
    int rc = open_create(&o, loop, of, later);
    double complex *root = calloc(o.m + 1, sizeof(*root));
    bool *above = calloc(o.m + 1, sizeof(*above));

    *delay = HUGE_VAL;
    if (rc == 0 && (!root || !above))
        rc = APC_ENOMEM;
    if (rc == 0)
        rc = find_delay(&o, root, above, delay);
    free(root);
    free(above);
    open_free(&o);
    return rc;
}

/* SPDX-License-Identifier: BSD-3-Clause */
/* What makes a record a doubtful one for models: drift, limits, a loop that was closed, and what no input explains. */
#include <apcmath.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>

#include "base/complex.h"
#include "files/files.h"
#include "grid.h"

#define FREE_VALUES   20   /* so many different ones, and a signal is none of a test's levels */
#define STANDS        0.05 /* of the samples are at an extreme */
#define NEAR          0.025
#define FAR           0.1  /* of the range, from an extreme */
#define STOPPED       2.5  /* times as long from FAR as from NEAR: of a ramp 4, of what settles less */
#define DRIFTS        0.5  /* of the output's own deviation */
#define SCATTERS      2.0  /* times what is left beside the drift */
#define ANSWERS       10   /* samples within which a controller answers */
#define LEAST_ANSWER  0.15 /* a weaker correlation is not told */
#define TELLING       5.0  /* standard errors of a correlation */
#define LEAST_EXPLAIN 0.5
#define SHORTEST      16 /* samples of a segment */
#define PI            3.14159265358979323846

struct warnings {
    const struct identify_data *d;
    const double *left;
    struct grid_warning *to;
    size_t n;
};

static struct grid_warning *add_warning(struct warnings *z, const char *kind, const char *of, double value)
{
    struct grid_warning *one = &z->to[z->n++];

    *one = (struct grid_warning){.kind = kind, .of = of, .value = value};
    return one;
}

/* ---- Limits ---------------------------------------------------------------------------------------------- */

/* The share of the samples in which a signal stands at its extreme @p at, where something stopped it; 0: it does not. What
 * settles there is long in coming the last bit of the way. */
static double share_at(const struct apc_record *r, const double *v, size_t stride, double at, double range)
{
    size_t there = 0;
    bool stopped = false;

    for (size_t g = 0; g < apc_record_runs(r); g++) {
        const size_t end = apc_record_end(r, g);
        size_t far = end, near = end; /* the last samples that were so far from it */

        for (size_t k = end - apc_record_run(r, g).n; k < end; k++) {
            const double off = fabs(v[k * stride] - at);

            if (off > NEAR * range)
                near = k;
            if (off > FAR * range)
                far = k;
            if (off > 0.0 || !isfinite(off))
                continue;
            there++;
            if (near < k && k + 1 < end && fabs(v[(k + 1) * stride] - at) <= 0.0)
                stopped |= k - near <= 1 || (far < k && (double)(k - far) >= STOPPED * (double)(k - near));
            near = far = end;
        }
    }
    return stopped ? (double)there / (double)r->n : 0.0;
}

static void warn_of_limit(struct warnings *z, const char *name, const double *v, size_t stride)
{
    double seen[FREE_VALUES], low = HUGE_VAL, high = -HUGE_VAL;
    size_t values = 0;

    for (size_t k = 0; k < z->d->record.n; k++) {
        const double x = v[k * stride];
        size_t i = 0;

        if (!isfinite(x))
            continue;
        low = fmin(low, x);
        high = fmax(high, x);
        while (i < values && fabs(seen[i] - x) > 0.0)
            i++;
        if (i == values && values < FREE_VALUES)
            seen[values++] = x;
    }
    for (int top = 0; top < 2 && values == FREE_VALUES; top++) {
        const double at = top ? high : low, share = share_at(&z->d->record, v, stride, at, high - low);

        if (share < STANDS)
            continue;
        struct grid_warning *one = add_warning(z, "limit", name, share);
        snprintf(one->text, sizeof one->text,
                 "%s stands at its %s, %.6g, in %.0f %% of the samples: at a limit a record says little",
                 name, top ? "highest" : "lowest", at, 100.0 * share);
    }
}

/* ---- Drift ------------------------------------------------------------------------------------------------- */

/* Of run @p g, in what the inputs leave of output @p i. */
static void warn_of_drift(struct warnings *z, size_t i, size_t g)
{
    const struct apc_record *r = &z->d->record;
    const size_t end = apc_record_end(r, g), begin = end - apc_record_run(r, g).n;
    double n = 0.0, t = 0.0, v = 0.0, tt = 0.0, tv = 0.0, vv = 0.0, y = 0.0, yy = 0.0;

    for (size_t k = begin; k < end; k++) {
        const double x = z->left[k * r->ny + i], at = (double)(k - begin), m = r->y[k * r->ny + i];

        if (!isfinite(x) || !isfinite(m))
            continue;
        n += 1.0;
        const double dt = at - t, dv = x - v, dy = m - y; /* from the means so far */
        t += dt / n;
        v += dv / n;
        y += dy / n;
        tt += dt * (at - t);
        tv += dt * (x - v);
        vv += dv * (x - v);
        yy += dy * (m - y);
    }
    if (n < SHORTEST || !(tt > 0.0))
        return;
    const double drift = tv / tt * (double)(end - begin), beside = sqrt(fmax(0.0, vv - tv * tv / tt) / n),
                 moves = sqrt(yy / n);
    if (!(fabs(drift) > DRIFTS * moves && fabs(drift) > SCATTERS * beside))
        return;
    struct grid_warning *one = add_warning(z, "drift", z->d->output[i], drift);
    snprintf(
        one->text, sizeof one->text,
        "%s drifts by %.3g beside what the inputs do, and its standard deviation is %.3g: choose a shorter "
        "window, or name what moves it as an input",
        z->d->output[i], drift, moves);
}

/* ---- A closed loop ----------------------------------------------------------------------------------------- */

/* How often changes of input @p j, @p lag samples later, have the sign of those of what is left of output @p i: a step of
 * the setpoint counts no more than noise does. */
static double sign_agreement(const struct warnings *z, size_t i, size_t j, int lag, double *pairs)
{
    const struct apc_record *r = &z->d->record;
    const size_t inputs = r->nu + r->nd;
    double alike = 0.0;

    *pairs = 0.0;
    for (size_t g = 0; g < apc_record_runs(r); g++) {
        const size_t end = apc_record_end(r, g), begin = end - apc_record_run(r, g).n;

        for (size_t k = begin + ANSWERS + 1; k + ANSWERS < end; k++) {
            const size_t at = lag < 0 ? k - (size_t)-lag : k + (size_t)lag;
            const double dv = z->left[k * r->ny + i] - z->left[(k - 1) * r->ny + i],
                         du = r->u[at * inputs + j] - r->u[(at - 1) * inputs + j];

            if (!isfinite(dv) || !(fabs(du) > 0.0 && fabs(dv) > 0.0))
                continue;
            *pairs += 1.0;
            alike += (du > 0.0) == (dv > 0.0) ? 1.0 : -1.0;
        }
    }
    return *pairs > 0.0 ? alike / *pairs : 0.0;
}

/* An input that follows the output's own noise is a controller's; what is left of a wrong model follows the input. */
static void warn_of_loop(struct warnings *z, size_t i, size_t j)
{
    const char *const u = z->d->input[j], *const y = z->d->output[i];
    double after = 0.0, before = 0.0, pairs = 0.0, of = 1.0;

    for (int lag = -ANSWERS; lag <= ANSWERS; lag++) {
        const double c = sign_agreement(z, i, j, lag, &pairs);

        if (lag >= 0 && fabs(c) > fabs(after)) {
            after = c;
            of = pairs;
        }
        if (lag < 0)
            before = fmax(before, fabs(c));
    }
    if (!(fabs(after) > LEAST_ANSWER && fabs(after) > TELLING / sqrt(of) && fabs(after) > 2.0 * before))
        return;
    struct grid_warning *one = add_warning(z, "loop", y, after);
    one->with = u;
    snprintf(
        one->text, sizeof one->text,
        "%s answers the noise of %s (correlation of signs %.2f): a loop was closed, noise alone shows its "
        "controller",
        u, y, after);
}

/* ---- Coherence --------------------------------------------------------------------------------------------- */

struct cross {
    size_t inputs, length, lines, segments;
    double *re, *im;      /* [length] each */
    double complex *line; /* [(inputs + 2) * lines] of this segment */
    double complex *sum;  /* [lines][(inputs + 1)^2] */
    double left;          /* by the model */
};

/* Input j, then the output, and what the model leaves of it; a missing sample is as the one before. False: it begins with
 * one, or lacks more than a quarter. */
static bool transform(struct cross *c, const double *v, size_t stride, size_t j)
{
    double mean = 0.0, held = v[0];
    size_t missing = 0;

    for (size_t k = 0; k < c->length; k++) {
        if (isfinite(v[k * stride]))
            held = v[k * stride];
        else
            missing++;
        c->re[k] = held;
        mean += held / (double)c->length;
    }
    if (!isfinite(mean) || missing > c->length / 4)
        return false;
    for (size_t k = 0; k < c->length; k++) {
        c->re[k] = (c->re[k] - mean) * (0.5 - 0.5 * apc_cos(2.0 * PI * (double)k / (double)c->length));
        c->im[k] = 0.0;
    }
    grid_fourier(c->re, c->im, c->length);
    for (size_t f = 0; f < c->lines; f++)
        c->line[j * c->lines + f] = apc_complex(c->re[f + 1], c->im[f + 1]);
    return true;
}

static void add_segment(struct cross *c, const struct warnings *z, size_t i, size_t from)
{
    const struct apc_record *r = &z->d->record;
    const size_t m = c->inputs + 1;

    for (size_t j = 0; j < c->inputs; j++)
        if (!transform(c, r->u + from * c->inputs + j, c->inputs, j))
            return;
    if (!transform(c, r->y + from * r->ny + i, r->ny, c->inputs) ||
        !transform(c, z->left + from * r->ny + i, r->ny, m))
        return;
    c->segments++;
    for (size_t f = 0; f < c->lines; f++) {
        const double complex of = c->line[m * c->lines + f];

        c->left += creal(of * conj(of));
        for (size_t a = 0; a < m; a++)
            for (size_t b = 0; b < m; b++)
                c->sum[(f * m + a) * m + b] += c->line[a * c->lines + f] * conj(c->line[b * c->lines + f]);
    }
}

/* What is left of the output's power when each input has been eliminated. */
static double left_of_line(double complex *s, size_t m)
{
    const double whole = creal(s[m * m - 1]);

    for (size_t j = 0; j + 1 < m; j++) {
        if (!(creal(s[j * m + j]) > 1e-12 * whole))
            continue;
        for (size_t a = j + 1; a < m; a++) {
            const double complex by = apc_cdivide(s[a * m + j], s[j * m + j]);

            for (size_t b = j; b < m; b++)
                s[a * m + b] -= by * s[j * m + b];
        }
    }
    return fmin(whole, fmax(0.0, creal(s[m * m - 1])));
}

/* The part of output @p i that its inputs explain, by the model or by any linear one that forgets within a segment; NAN:
 * the record is too short. */
static double explained(const struct warnings *z, size_t i, struct cross *c)
{
    const struct apc_record *r = &z->d->record;
    const size_t m = c->inputs + 1;
    double whole = 0.0, left = 0.0;

    c->segments = 0;
    c->left = 0.0;
    for (size_t k = 0; k < c->lines * m * m; k++)
        c->sum[k] = apc_complex(0.0, 0.0);
    for (size_t g = 0; g < apc_record_runs(r); g++) {
        const size_t end = apc_record_end(r, g);

        for (size_t from = end - apc_record_run(r, g).n; from + c->length <= end; from += c->length / 2)
            add_segment(c, z, i, from);
    }
    if (c->segments < 2 * m)
        return (double)NAN;
    for (size_t f = 0; f < c->lines; f++) {
        whole += creal(c->sum[(f + 1) * m * m - 1]);
        left += left_of_line(c->sum + f * m * m, m);
    }
    left *= (double)c->segments / (double)(c->segments - c->inputs); /* so many went into the fit */
    return whole > 0.0 ? fmax(0.0, 1.0 - fmin(left, c->left) / whole) : (double)NAN;
}

static int warn_of_coherence(struct warnings *z)
{
    const struct apc_record *r = &z->d->record;
    struct cross c = {.inputs = r->nu + r->nd, .length = SHORTEST};
    const size_t m = c.inputs + 1;

    while (2 * c.length * 2 * m <= r->n)
        c.length *= 2;
    c.lines = c.length / 2 - 1;
    c.re = calloc(2 * c.length, sizeof *c.re);
    c.line = calloc(c.lines * (m + 1 + m * m), sizeof *c.line);
    if (!c.re || !c.line) {
        free(c.re);
        free(c.line);
        return APC_ENOMEM;
    }
    c.im = c.re + c.length;
    c.sum = c.line + c.lines * (m + 1);
    for (size_t i = 0; i < r->ny; i++) {
        const double share = explained(z, i, &c);

        if (!(share < LEAST_EXPLAIN))
            continue;
        struct grid_warning *one = add_warning(z, "coherence", z->d->output[i], share);
        snprintf(one->text, sizeof one->text,
                 "%s: of what moves it faster than each %.3g s the inputs explain %.0f %%, by this model or "
                 "by any "
                 "linear one that forgets within so long: the rest is noise, not linear, or of an input that "
                 "is not "
                 "on record",
                 z->d->output[i], (double)c.length * r->Ts, 100.0 * share);
    }
    free(c.re);
    free(c.line);
    return 0;
}

/* ---- All ----------------------------------------------------------------------------------------------------- */

/* What @p model leaves of the outputs, [n * ny], to be freed; NAN where it says nothing. NULL: out of memory. */
static double *leave(const struct apc_record *record, const struct apc_linear *model, const double *u0,
                     const double *y0)
{
    struct apc_record on = *record;
    struct apc_validation of[IDENTIFY_SIGNALS];
    double *moved = on.runs > 1 ? apc_record_gather(&on, u0, y0) : NULL,
           *left = on.runs > 1 && !moved ? NULL : calloc(on.n * on.ny, sizeof *left);
    const int rc = left ? apc_validate(model, NULL, &on, on.n / 10, of, left, NULL) : APC_ENOMEM;

    for (size_t k = 0; k < on.n * on.ny && left; k++)
        left[k] = rc < 0 ? (double)NAN : on.y[k] - left[k];
    free(moved);
    return left;
}

int grid_warnings(const struct identify_data *d, const struct apc_linear *model, const double *u0,
                  const double *y0, struct grid_warning **to, size_t *n)
{
    const struct apc_record *r = &d->record;
    const size_t inputs = r->nu + r->nd,
                 most = 2 * (inputs + r->ny) + r->ny * (inputs + apc_record_runs(r) + 1);
    double *const left = leave(r, model, u0, y0);
    struct warnings z = {d, left, calloc(most, sizeof **to), 0};

    *to = z.to;
    *n = 0;
    if (!left || !z.to) {
        free(left);
        return APC_ENOMEM;
    }
    for (size_t j = 0; j < inputs; j++)
        warn_of_limit(&z, d->input[j], r->u + j, inputs);
    for (size_t i = 0; i < r->ny; i++) {
        warn_of_limit(&z, d->output[i], r->y + i, r->ny);
        for (size_t g = 0; g < apc_record_runs(r); g++)
            warn_of_drift(&z, i, g);
        for (size_t j = 0; j < r->nu; j++)
            warn_of_loop(&z, i, j);
    }
    const int rc = warn_of_coherence(&z);
    *n = z.n;
    free(left);
    return rc;
}

void grid_warnings_json(const struct grid_warning *warning, size_t n, struct text *t)
{
    json_add(t, "warnings:[");
    for (const struct grid_warning *d = warning; d < warning + n; d++)
        json_add(t, "{kind:%s, of:%s, with:%s, value:%g, text:%s}", d->kind, d->of, d->with, d->value,
                 d->text);
    json_add(t, "]");
}

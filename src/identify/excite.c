/* SPDX-License-Identifier: BSD-3-Clause */
#include "apcexcite.h"

#include <apcmath.h>

#include <math.h>
#include <stdint.h>
#include <stdlib.h>

#define ROUNDS 200 /* of clipping */

/* ---- Steps ----------------------------------------------------------------------------------------- */

int apc_excite_steps(size_t settling, double *u, size_t n)
{
    static const struct {
        int level, quarters;
    } pattern[] = {{1, 4}, {-1, 4}, {1, 2}, {0, 2}, {-1, 1}, {1, 1}, {-1, 2}, {0, 4}};
    size_t i = 0, k = 0;

    if (settling < 4)
        return APC_EINVAL;
    while (k < n) {
        const size_t end = k + settling * (size_t)pattern[i].quarters / 4;
        for (; k < end && k < n; k++)
            u[k] = pattern[i].level;
        i = (i + 1) % (sizeof pattern / sizeof *pattern);
    }
    return 0;
}

/* ---- PRBS ------------------------------------------------------------------------------------------ */

int apc_excite_prbs(unsigned order, size_t hold, size_t shift, double *u, size_t n)
{
    /* taps of shift registers, whose polynomials are primitive */
    static const uint32_t taps[] = {0x3,   0x6,   0xC,   0x14,   0x30,   0x60,   0xB8,  0x110,
                                    0x240, 0x500, 0xE08, 0x1C80, 0x3802, 0x6000, 0xD008};
    uint32_t bits = 1;

    if (order < 2 || order > 16 || hold == 0)
        return APC_EINVAL;
    shift %= ((size_t)1 << order) - 1;
    for (size_t k = 0; k < n + shift * hold; k++) {
        if (k >= shift * hold)
            u[k - shift * hold] = bits & 1 ? 1.0 : -1.0;
        if (k % hold == hold - 1)
            bits = bits & 1 ? bits >> 1 ^ taps[order - 2] : bits >> 1;
    }
    return 0;
}

/* ---- Multisine ------------------------------------------------------------------------------------- */

struct multisine {
    size_t first, every, lines, n;
    double *cosine, *sine;    /* [n] a period of each */
    double *phase, *u, *best; /* [lines], [n], [lines] */
};

/* Where in its period a line is at sample k. */
static size_t line_phase_at(const struct multisine *m, size_t line, size_t k)
{
    return (m->first + line * m->every) * k % m->n;
}

static double add_up(const struct multisine *m, const double *phase)
{
    double largest = 0.0;

    for (size_t k = 0; k < m->n; k++)
        m->u[k] = 0.0;
    for (size_t j = 0; j < m->lines; j++) {
        const double c = apc_cos(phase[j]), s = apc_sin(phase[j]);
        for (size_t k = 0; k < m->n; k++)
            m->u[k] += c * m->cosine[line_phase_at(m, j, k)] - s * m->sine[line_phase_at(m, j, k)];
    }
    for (size_t k = 0; k < m->n; k++)
        largest = fmax(largest, fabs(m->u[k]));
    return largest;
}

/* The phases of what is left where the peaks are cut off. */
static void clip(const struct multisine *m, double level)
{
    for (size_t k = 0; k < m->n; k++)
        m->u[k] = fmax(fmin(m->u[k], level), -level);
    for (size_t j = 0; j < m->lines; j++) {
        double re = 0.0, im = 0.0;
        for (size_t k = 0; k < m->n; k++) {
            re += m->u[k] * m->cosine[line_phase_at(m, j, k)];
            im -= m->u[k] * m->sine[line_phase_at(m, j, k)];
        }
        m->phase[j] = apc_atan2(im, re);
    }
}

static double search_crest_factor(const struct multisine *m)
{
    double least = HUGE_VAL;

    for (size_t j = 0; j < m->lines; j++)
        m->phase[j] = -M_PI * (double)j * (double)j / (double)m->lines;
    for (int i = 0; i < ROUNDS; i++) {
        const double largest = add_up(m, m->phase);
        if (largest < least) {
            least = largest;
            for (size_t j = 0; j < m->lines; j++)
                m->best[j] = m->phase[j];
        }
        clip(m, largest * (0.75 + 0.2 * i / ROUNDS)); /* less and less is cut off */
    }
    return add_up(m, m->best);
}

int apc_excite_multisine(size_t first, size_t last, size_t every, double *u, size_t n, double *crest)
{
    struct multisine m = {.first = first, .every = every, .n = n, .u = u};
    double largest;

    if (first == 0 || first > last || every == 0 || n < 4 || 2 * last >= n)
        return APC_EINVAL;
    m.lines = (last - first) / every + 1;
    m.cosine = calloc(2 * n + 2 * m.lines, sizeof *m.cosine);
    if (!m.cosine)
        return APC_ENOMEM;
    m.sine = m.cosine + n;
    m.phase = m.sine + n;
    m.best = m.phase + m.lines;
    for (size_t k = 0; k < n; k++) {
        m.cosine[k] = apc_cos(2.0 * M_PI * (double)k / (double)n);
        m.sine[k] = apc_sin(2.0 * M_PI * (double)k / (double)n);
    }
    largest = search_crest_factor(&m);
    for (size_t k = 0; k < n; k++)
        u[k] /= largest;
    if (crest)
        *crest = largest / sqrt((double)m.lines / 2.0);
    free(m.cosine);
    return 0;
}

/* ---- Relay ----------------------------------------------------------------------------------------- */

static void switch_up(struct apc_relay *r, double t)
{
    if (r->since > 0.0) { /* the first one is no whole oscillation */
        r->amplitude[1] = r->amplitude[0];
        r->period[1] = r->period[0];
        r->amplitude[0] = (r->high - r->low) / 2.0;
        r->period[0] = t - r->since;
    }
    r->since = t;
    r->high = r->low = 0.0;
}

double apc_relay_step(struct apc_relay *r, double t, double error)
{
    const double was = r->out;

    if (isnan(error))
        return was != 0.0 ? was : 1.0;
    r->high = fmax(r->high, error);
    r->low = fmin(r->low, error);
    if (was == 0.0)
        r->out = error < 0.0 ? -1.0 : 1.0;
    else if (was < 0.0 && error > r->hysteresis)
        r->out = 1.0;
    else if (was > 0.0 && error < -r->hysteresis)
        r->out = -1.0;
    if (was < 0.0 && r->out > 0.0)
        switch_up(r, t);
    return r->out;
}

bool apc_relay_settled(const struct apc_relay *r)
{
    return r->period[1] > 0.0 && fabs(r->period[0] - r->period[1]) <= 0.05 * r->period[0] &&
           fabs(r->amplitude[0] - r->amplitude[1]) <= 0.05 * r->amplitude[0];
}

/* SPDX-License-Identifier: BSD-3-Clause */
/* Figures of signals on a grid: histogram, spectrum, correlation, one against the other. Answers are small however long
 * the record is, and its extremes are in them. */
#include <apcmath.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "files/files.h"
#include "grid.h"

#define BARS    50
#define LINES   200  /* of a spectrum; each stands for the highest of those beside it */
#define SEGMENT 4096 /* samples of one */
#define LAGS    200  /* to either side */
#define PIECES  400  /* of the time, of each of which the extremes are points */
#define PI      3.14159265358979323846

struct signal {
    struct signal_figures is;
    const double *v; /* [n], each stride-th */
    size_t stride;
    double *centred; /* [n] in deviations from its mean; missing: 0 */
};

static double signal_value(const struct signal *s, size_t k)
{
    return s->v[k * s->stride];
}

static void measure_signal(struct signal *s, size_t n)
{
    double squares = 0.0;

    s->is.low = HUGE_VAL;
    s->is.high = -HUGE_VAL;
    for (size_t k = 0; k < n; k++) {
        const double v = signal_value(s, k);

        if (!isfinite(v))
            continue;
        const double apart = v - s->is.mean;
        s->is.mean += apart / (double)++s->is.n;
        squares += apart * (v - s->is.mean);
        s->is.low = fmin(s->is.low, v);
        s->is.high = fmax(s->is.high, v);
    }
    s->is.deviation = s->is.n > 0 ? sqrt(squares / (double)s->is.n) : 0.0;
    for (size_t k = 0; k < n; k++) {
        const double v = signal_value(s, k);

        s->centred[k] = isfinite(v) && s->is.deviation > 0.0 ? (v - s->is.mean) / s->is.deviation : 0.0;
    }
}

static void bars_json(const struct signal *s, size_t n, struct text *t)
{
    size_t bar[BARS] = {0};

    for (size_t k = 0; k < n; k++) {
        const double v = signal_value(s, k),
                     at = s->is.high > s->is.low ? (v - s->is.low) / (s->is.high - s->is.low) * BARS : 0.0;

        if (isfinite(v))
            bar[at < BARS ? (size_t)at : BARS - 1]++;
    }
    json_add(t, "bars:[");
    for (size_t i = 0; i < BARS && s->is.n > 0; i++)
        json_add(t, "%zu", bar[i]);
    json_add(t, "],");
}

/* In place, of n complex numbers, a power of 2. */
static void fourier(double *re, double *im, size_t n)
{
    for (size_t i = 1, j = 0; i < n; i++) {
        size_t bit = n >> 1;

        for (; j & bit; bit >>= 1)
            j ^= bit;
        j ^= bit;
        if (i < j) {
            const double a = re[i], b = im[i];
            re[i] = re[j];
            im[i] = im[j];
            re[j] = a;
            im[j] = b;
        }
    }
    for (size_t half = 1; half < n; half *= 2)
        for (size_t k = 0; k < half; k++) {
            const double angle = -PI * (double)k / (double)half, c = apc_cos(angle), s = apc_sin(angle);

            for (size_t i = k; i < n; i += 2 * half) {
                const double a = re[i + half] * c - im[i + half] * s, b = re[i + half] * s + im[i + half] * c;

                re[i + half] = re[i] - a;
                im[i + half] = im[i] - b;
                re[i] += a;
                im[i] += b;
            }
        }
}

static size_t segment_of(size_t n)
{
    size_t length = 16;

    while (2 * length <= n && 2 * length <= SEGMENT)
        length *= 2;
    return length;
}

/* The amplitude of a sine at each frequency, by Welch's method: the root of the mean square over Hann windows that overlap
 * by half. Of several lines that become one it has the highest. room [3 * segment_of(n)] */
static void spectrum_json(struct signal *s, size_t n, double Ts, double *room, struct text *t)
{
    const size_t length = segment_of(n), lines = length / 2, together = (lines + LINES - 1) / LINES;
    double *re = room, *im = re + length, *power = im + length;
    size_t segments = 0, strongest = 0;

    memset(power, 0, length * sizeof *power);
    for (size_t from = 0; n >= length && from + length <= n; from += length / 2, segments++) {
        for (size_t k = 0; k < length; k++) {
            re[k] = s->centred[from + k] * s->is.deviation *
                    (0.5 - 0.5 * apc_cos(2.0 * PI * (double)k / (double)length));
            im[k] = 0.0;
        }
        fourier(re, im, length);
        for (size_t k = 0; k < lines; k++)
            power[k] += k ? re[k] * re[k] + im[k] * im[k] : 0.0;
    }
    for (size_t k = 1; k < lines; k++)
        strongest = power[k] > power[strongest] && power[k] > 0.0 ? k : strongest;
    s->is.every = strongest ? (double)length * Ts / (double)strongest : (double)NAN;
    json_add(t, "spectrum:[");
    for (size_t k = 0; k < lines && segments > 0; k += together) {
        double most = 0.0;

        for (size_t i = k; i < k + together && i < lines; i++)
            most = fmax(most, power[i]);
        json_add(t, "%.6g", 4.0 / (double)length * sqrt(most / (double)segments));
    }
    json_add(t, "]");
}

static size_t padded_length(size_t n)
{
    size_t length = 16;

    while (length < 2 * n)
        length *= 2;
    return length;
}

/* y some lags after x: of all lags that one place stands for the strongest. room [4 * padded_length(n)] */
static void correlation_json(const struct signal *x, const struct signal *y, size_t n, size_t step,
                             double *room, struct text *t)
{
    const size_t length = padded_length(n);
    double *re = room, *im = re + length, *other_re = im + length, *other_im = other_re + length;

    memset(room, 0, 4 * length * sizeof *room);
    memcpy(re, x->centred, n * sizeof *re);
    memcpy(other_re, y->centred, n * sizeof *re);
    fourier(re, im, length);
    fourier(other_re, other_im, length);
    for (size_t k = 0; k < length; k++) { /* the conjugate of conj(X) Y, so that a transform is its inverse */
        const double a = re[k] * other_re[k] + im[k] * other_im[k];

        im[k] = im[k] * other_re[k] - re[k] * other_im[k];
        re[k] = a;
    }
    fourier(re, im, length);
    json_add(t, "correlation:[");
    for (int place = -LAGS; place <= LAGS; place++) {
        const long middle = place * (long)step, half = (long)step / 2;
        double most = (double)NAN;

        for (long lag = middle - half; lag <= middle + half; lag++) {
            const size_t by = (size_t)labs(lag);
            const double is =
                by < n ? re[lag < 0 ? length - by : by] / (double)length / (double)(n - by) : 0.0;

            if (by <= n / 2 && !(fabs(is) <= fabs(most)))
                most = is;
        }
        json_add(t, "%.4g", most);
    }
    json_add(t, "],");
}

/* Of each piece of the time the samples at which either is lowest or highest. */
static void points_json(const struct signal *x, const struct signal *y, size_t n, struct text *t)
{
    const size_t piece = (n + PIECES - 1) / PIECES;
    struct text other = {0};

    json_add(t, "x:[");
    json_add(&other, "[");
    for (size_t from = 0; from < n; from += piece) {
        size_t at[4];

        for (int i = 0; i < 4; i++) {
            const struct signal *s = i < 2 ? x : y;

            at[i] = n;
            for (size_t k = from; k < from + piece && k < n; k++)
                if (isfinite(signal_value(x, k)) && isfinite(signal_value(y, k)) &&
                    (at[i] == n || (i % 2 ? signal_value(s, k) > signal_value(s, at[i])
                                          : signal_value(s, k) < signal_value(s, at[i]))))
                    at[i] = k;
        }
        for (int i = 0; i < 4; i++) {
            bool known = at[i] == n;

            for (int j = 0; j < i && !known; j++)
                known = at[j] == at[i];
            if (known)
                continue;
            json_add(t, "%.6g", signal_value(x, at[i]));
            json_add(&other, "%.6g", signal_value(y, at[i]));
        }
    }
    json_add(&other, "]");
    json_add(t, "], y:");
    json_text_add(t, &other);
    text_free(&other);
}

static void signals_members(struct signal *s, size_t signals, const struct apc_record *r, double *room,
                            struct text *t)
{
    const size_t length = segment_of(r->n), together = (length / 2 + LINES - 1) / LINES,
                 step = r->n / 4 / LAGS > 1 ? r->n / 4 / LAGS : 1;

    json_add(t, "period:%g, samples:%zu, frequency:%.9g, lag:%.9g, signals:[", r->Ts, r->n,
             (double)together / ((double)length * r->Ts), (double)step * r->Ts);
    for (size_t i = 0; i < signals; i++) {
        json_add(t, "{name:%s, missing:%zu, mean:%.6g, deviation:%.6g, low:%.6g, high:%.6g,", s[i].is.name,
                 r->n - s[i].is.n, s[i].is.n ? s[i].is.mean : (double)NAN, s[i].is.deviation,
                 s[i].is.n ? s[i].is.low : (double)NAN, s[i].is.n ? s[i].is.high : (double)NAN);
        bars_json(&s[i], r->n, t);
        spectrum_json(&s[i], r->n, r->Ts, room, t);
        json_add(t, "}");
    }
    json_add(t, "], pairs:[");
    for (size_t i = 0; i < signals; i++)
        for (size_t j = i; j < signals; j++) {
            json_add(t, "{from:%s, to:%s,", s[i].is.name, s[j].is.name);
            correlation_json(&s[i], &s[j], r->n, step, room, t);
            points_json(&s[i], &s[j], r->n, t);
            json_add(t, "}");
        }
    json_add(t, "]");
}

int grid_signals(const struct identify_data *d, struct text *t, struct signal_figures *of)
{
    const struct apc_record *r = &d->record;
    const size_t inputs = r->nu + r->nd, signals = inputs + r->ny;
    struct signal s[2 * IDENTIFY_SIGNALS];
    double *memory = calloc(signals * r->n + 4 * padded_length(r->n), sizeof *memory);

    if (!memory)
        return APC_ENOMEM;
    memset(s, 0, sizeof s);
    for (size_t i = 0; i < signals; i++) {
        const bool measured = i < r->ny; /* these first */
        const size_t at = measured ? i : i - r->ny;

        s[i].is.name = measured ? d->output[at] : d->input[at];
        s[i].v = (measured ? r->y : r->u) + at;
        s[i].stride = measured ? r->ny : inputs;
        s[i].centred = memory + i * r->n;
        measure_signal(&s[i], r->n);
    }
    signals_members(s, signals, r, memory + signals * r->n, t);
    for (size_t i = 0; i < signals && of; i++)
        of[i] = s[i].is;
    free(memory);
    return 0;
}

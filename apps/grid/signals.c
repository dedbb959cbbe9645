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
    double *centred; /* [n] from the mean of its run; missing: as the one before */
    double within;   /* deviation of these */
};

static double signal_value(const struct signal *s, size_t k)
{
    return s->v[k * s->stride];
}

static void measure_signal(struct signal *s, size_t from, size_t to)
{
    double squares = 0.0;

    s->is.n = 0;
    s->is.mean = 0.0;
    s->is.low = HUGE_VAL;
    s->is.high = -HUGE_VAL;
    for (size_t k = from; k < to; k++) {
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
    if (s->is.n == 0)
        s->is.mean = s->is.low = s->is.high = (double)NAN;
}

/* Each run around its own mean, as a difference between runs is no movement. */
static void centre_signal(struct signal *s, const struct apc_record *r)
{
    double squares = 0.0;

    for (size_t g = 0, from = 0; g < apc_record_runs(r); from = apc_record_end(r, g++)) {
        measure_signal(s, from, apc_record_end(r, g));
        for (size_t k = from; k < apc_record_end(r, g); k++)
            s->centred[k] = isfinite(signal_value(s, k)) ? signal_value(s, k) - s->is.mean
                            : k > from                   ? s->centred[k - 1]
                                                         : 0.0;
        squares += s->is.deviation * s->is.deviation * (double)s->is.n;
    }
    measure_signal(s, 0, r->n);
    s->within = s->is.n > 0 ? sqrt(squares / (double)s->is.n) : 0.0;
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

void grid_fourier(double *re, double *im, size_t n)
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

static size_t longest_run(const struct apc_record *r)
{
    size_t n = 0;

    for (size_t g = 0; g < apc_record_runs(r); g++)
        n = apc_record_run(r, g).n > n ? apc_record_run(r, g).n : n;
    return n;
}

static size_t segment_of(size_t n)
{
    size_t length = 16;

    while (2 * length <= n && 2 * length <= SEGMENT)
        length *= 2;
    return length;
}

/* The amplitude of a sine at each frequency, by Welch's method: the root of the mean square over Hann windows that overlap
 * by half and lie within a run. Of several lines that become one it has the highest. room [3 * segment_of(longest run)] */
static void spectrum_json(struct signal *s, const struct apc_record *r, double *room, struct text *t)
{
    const size_t length = segment_of(longest_run(r)), lines = length / 2,
                 together = (lines + LINES - 1) / LINES;
    double *re = room, *im = re + length, *power = im + length;
    size_t segments = 0, strongest = 0;

    memset(power, 0, length * sizeof *power);
    for (size_t g = 0, begin = 0; g < apc_record_runs(r); begin = apc_record_end(r, g++))
        for (size_t from = begin; from + length <= apc_record_end(r, g); from += length / 2, segments++) {
            for (size_t k = 0; k < length; k++) {
                re[k] = s->centred[from + k] * (0.5 - 0.5 * apc_cos(2.0 * PI * (double)k / (double)length));
                im[k] = 0.0;
            }
            grid_fourier(re, im, length);
            for (size_t k = 0; k < lines; k++)
                power[k] += k ? re[k] * re[k] + im[k] * im[k] : 0.0;
        }
    for (size_t k = 1; k < lines; k++)
        strongest = power[k] > power[strongest] && power[k] > 0.0 ? k : strongest;
    s->is.every = strongest ? (double)length * r->Ts / (double)strongest : (double)NAN;
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

/* The transform of the values of a run, in deviations, and of 1 where there is one as their imaginary part. */
static void transform_run(const struct signal *s, size_t from, size_t to, double *re, double *im,
                          size_t length)
{
    memset(re, 0, length * sizeof *re);
    memset(im, 0, length * sizeof *im);
    for (size_t k = from; k < to; k++) {
        im[k - from] = isfinite(signal_value(s, k));
        re[k - from] = s->within > 0.0 ? im[k - from] * s->centred[k] / s->within : 0.0;
    }
    grid_fourier(re, im, length);
}

/* y some lags after x, over the pairs that are there, within runs: of all lags that one place stands for the strongest.
 * Lags of less than half the pairs are left out. room [6 * padded_length(longest run)] */
static void correlation_json(const struct signal *x, const struct signal *y, const struct apc_record *r,
                             size_t step, double *room, struct text *t)
{
    const size_t n = longest_run(r), length = padded_length(n);
    double *re = room, *im = re + length, *other_re = im + length, *other_im = other_re + length,
           *sum = other_im + length, *pairs = sum + length;

    memset(sum, 0, 2 * length * sizeof *sum);
    for (size_t g = 0, from = 0; g < apc_record_runs(r); from = apc_record_end(r, g++)) {
        transform_run(x, from, apc_record_end(r, g), re, im, length);
        transform_run(y, from, apc_record_end(r, g), other_re, other_im, length);
        for (size_t k = 0; k < length; k++) {
            /* twice the transforms of the values, X and Y, and of where they are, M and N */
            const size_t back = (length - k) % length;
            const double X[] = {re[k] + re[back], im[k] - im[back]},
                         M[] = {im[k] + im[back], re[back] - re[k]},
                         Y[] = {other_re[k] + other_re[back], other_im[k] - other_im[back]},
                         N[] = {other_im[k] + other_im[back], other_re[back] - other_re[k]};

            /* the conjugate of conj(X) Y + i conj(M) N, so that a transform is its inverse */
            sum[k] += X[0] * Y[0] + X[1] * Y[1] - (M[0] * N[1] - M[1] * N[0]);
            pairs[k] -= X[0] * Y[1] - X[1] * Y[0] + M[0] * N[0] + M[1] * N[1];
        }
    }
    grid_fourier(sum, pairs, length);
    const double scale = 4.0 * (double)length, all = round(-pairs[0] / scale);
    json_add(t, "correlation:[");
    for (int place = -LAGS; place <= LAGS; place++) {
        const long middle = place * (long)step, half = (long)step / 2;
        double most = (double)NAN;

        for (long lag = middle - half; lag <= middle + half; lag++) {
            const size_t by = (size_t)labs(lag), at = lag < 0 ? length - by : by;
            const double told = by < n ? round(-pairs[at] / scale) : 0.0;

            if (told > 0.0 && 2.0 * told >= all && !(fabs(sum[at] / scale / told) <= fabs(most)))
                most = sum[at] / scale / told;
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
    const size_t longest = longest_run(r), length = segment_of(longest),
                 together = (length / 2 + LINES - 1) / LINES,
                 step = longest / 4 / LAGS > 1 ? longest / 4 / LAGS : 1;

    json_add(t, "period:%g, samples:%zu, frequency:%.9g, lag:%.9g, signals:[", r->Ts, r->n,
             (double)together / ((double)length * r->Ts), (double)step * r->Ts);
    for (size_t i = 0; i < signals; i++) {
        json_add(t, "{name:%s, missing:%zu, mean:%.6g, deviation:%.6g, low:%.6g, high:%.6g,", s[i].is.name,
                 r->n - s[i].is.n, s[i].is.mean, s[i].is.deviation, s[i].is.low, s[i].is.high);
        bars_json(&s[i], r->n, t);
        spectrum_json(&s[i], r, room, t);
        json_add(t, "}");
    }
    json_add(t, "], pairs:[");
    for (size_t i = 0; i < signals; i++)
        for (size_t j = i; j < signals; j++) {
            json_add(t, "{from:%s, to:%s,", s[i].is.name, s[j].is.name);
            correlation_json(&s[i], &s[j], r, step, room, t);
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
    double *memory = calloc(signals * r->n + 6 * padded_length(longest_run(r)), sizeof *memory);

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
        centre_signal(&s[i], r);
    }
    signals_members(s, signals, r, memory + signals * r->n, t);
    for (size_t i = 0; i < signals && of; i++)
        of[i] = s[i].is;
    free(memory);
    return 0;
}

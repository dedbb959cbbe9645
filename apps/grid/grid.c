/* SPDX-License-Identifier: BSD-3-Clause */
/* Records: a grid laid over the values of each signal. */
#include "grid.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#define SAMPLES_MOST 1000000
#define PARTS        10   /* of the median interval that are tried as the period */
#define ALIKE        0.25 /* of a period is how far a sample may be from the grid */

static int by_size(const void *a, const void *b)
{
    const double x = *(const double *)a, y = *(const double *)b;

    return (x > y) - (x < y);
}

/* The median; @p x is put in order. */
static double median_of(double *x, size_t n)
{
    if (n > 1)
        qsort(x, n, sizeof *x, by_size);
    return n > 0 ? x[n / 2] : 0.0;
}

/* Where in a grid a series begins: its first sample may be the one that came late. And how many samples are
 * near that grid. room [n] */
static size_t near_grid(const struct series *s, double Ts, double *begin, double *room)
{
    size_t n = 0;

    for (size_t k = 0; k < s->n; k++) {
        const double periods = (s->t[k] - s->t[0]) / Ts;

        room[k] = periods - round(periods);
    }
    *begin = s->t[0] + median_of(room, s->n) * Ts;
    for (size_t k = 0; k < s->n; k++) {
        const double periods = (s->t[k] - *begin) / Ts;

        n += fabs(periods - round(periods)) <= ALIKE;
    }
    return n;
}

/* The mean interval about @p median: where nearly all are a multiple of that, each is so many by itself, as
 * over many a little jitter of the median is more than one. */
static double mean_interval(const struct series *s, double median)
{
    const double span = s->t[s->n - 1] - s->t[0];
    double all = 0.0, near = 0.0;

    for (size_t k = 0; k + 1 < s->n; k++) {
        const double periods = (s->t[k + 1] - s->t[k]) / median;

        all += round(periods);
        near += fabs(periods - round(periods)) <= ALIKE;
    }
    return span / (near >= 0.9 * (double)(s->n - 1) ? all : round(span / median));
}

/* The median interval, or a part of it where samples are 2, 3, 2, 3, ... periods apart, to the microsecond;
 * so that it fits the whole series. */
static int find_sample_period(struct reading *r, const struct series *s, double *Ts, double *begin)
{
    double *room = calloc(s->n + 1, sizeof *room), median;
    size_t near = 0;

    *Ts = r->selection->period > 0.0 ? r->selection->period : r->period;
    if (!room)
        return apc_fail(r->why, APC_ENOMEM, "out of memory");
    if (s->n < 3) {
        free(room);
        return apc_fail(r->why, APC_EINVAL,
                        "%s: %zu samples of \"%s\" in that time: there is nothing to tell from", r->file,
                        s->n, s->name);
    }
    for (size_t k = 0; k + 1 < s->n; k++)
        room[k] = s->t[k + 1] - s->t[k];
    median = median_of(room, s->n - 1);
    if (*Ts > 0.0)
        near_grid(s, *Ts, begin, room);
    for (int part = 1; part <= PARTS && *Ts <= 0.0; part++) {
        double period = mean_interval(s, median / part);
        size_t there;

        period = period > 1e-3 ? round(period * 1e6) / 1e6 : period;
        there = near_grid(s, period, begin, room);
        near = part == 1 ? there : near;
        if ((double)there >= 0.9 * (double)s->n)
            *Ts = period;
    }
    free(room);
    return *Ts > 0.0
               ? 0
               : apc_fail(r->why, APC_EINVAL,
                          "%s: the sample times of \"%s\" change: of %zu samples %zu are on a grid of %g s. "
                          "Record at one period, or name one by --period",
                          r->file, s->name, s->n, near, median);
}

/* The sample of a series nearest to time @p t, looked for from @p *i on; false: there is none near. */
static bool nearest(const struct series *s, double t, double Ts, size_t *i)
{
    while (*i + 1 < s->n && fabs(s->t[*i + 1] - t) <= fabs(s->t[*i] - t))
        ++*i;
    return s->n > 0 && fabs(s->t[*i] - t) <= ALIKE * Ts;
}

/* Of a series what is near each time of the grid. */
static void lay(const struct series *s, const struct identify_data *d, size_t stride, double *to)
{
    size_t i = 0;

    for (size_t k = 0; k < d->record.n; k++) {
        const double t = d->begin + (double)k * d->record.Ts;

        to[k * stride] = nearest(s, t, d->record.Ts, &i) ? s->value[i] : (double)NAN;
    }
}

/* When sample @p k was measured, which may not be quite the time of the grid: of a row that came late all came late. */
static double measured_at(const struct series *measured, const struct identify_data *d, size_t k,
                          size_t *near)
{
    const double t = d->begin + (double)k * d->record.Ts;

    return nearest(measured, t, d->record.Ts, near) ? measured->t[*near] : t;
}

/* When row @p i of an input counts: at its own time or, where what the plant got is asked for, when the next measurement
 * was taken, since both go in one exchange. */
static double moved_at(const struct series *s, size_t i, const struct series *measured, bool exchanged,
                       size_t *next)
{
    while (exchanged && *next + 1 < measured->n && measured->t[*next] < s->t[i])
        ++*next;
    return exchanged ? fmax(s->t[i], measured->t[*next]) : s->t[i];
}

/* The mean of what was in force from each measurement until the next one. An input that moved in between has its share
 * of both values; taken as it was at the measurements, it would seem to move up to a period later, and a model's dead
 * time would lack that. */
static void hold(const struct series *s, const struct series *measured, const struct identify_data *d,
                 bool exchanged, size_t stride, double *to)
{
    const double same = 1e-3 * d->record.Ts;
    double held = (double)NAN;
    size_t i = 0, near = 0, next = 0;
    double end = measured_at(measured, d, 0, &near);

    for (size_t k = 0; k < d->record.n; k++) {
        double since = end, sum = 0.0, at;

        end = measured_at(measured, d, k + 1, &near);
        const double length = end - since;
        for (; i < s->n && moved_at(s, i, measured, exchanged, &next) <= since + same; i++)
            held = isfinite(s->value[i]) ? s->value[i] : held;
        to[k * stride] = held;
        for (; i < s->n && (at = moved_at(s, i, measured, exchanged, &next)) < end - same; i++) {
            if (!isfinite(s->value[i]) || s->value[i] == held)
                continue; /* no move, so nothing to round */
            sum += held * (at - since);
            since = at;
            held = s->value[i];
            to[k * stride] = (sum + held * (end - since)) / length;
        }
    }
}

/* The record begins where each input has a value. */
static void cut_beginning(struct identify_data *d, size_t inputs)
{
    struct apc_record *const r = &d->record;
    size_t k = 0;

    for (size_t j = 0; j < inputs && k < r->n;)
        if (isnan(r->u[k * inputs + j])) {
            k++;
            j = 0;
        } else {
            j++;
        }
    r->u += k * inputs;
    r->y += k * r->ny;
    r->n -= k;
    d->begin += (double)k * r->Ts;
}

static void count_gaps(struct identify_data *d)
{
    for (size_t i = 0; i < d->record.ny; i++) {
        size_t gap = 0;

        for (size_t k = 0; k < d->record.n; k++) {
            gap = isfinite(d->record.y[k * d->record.ny + i]) ? 0 : gap + 1;
            d->gaps[i].missing += gap > 0;
            d->gaps[i].longest = gap > d->gaps[i].longest ? gap : d->gaps[i].longest;
        }
    }
}

static bool has_value(const struct series *s)
{
    size_t i = 0;

    while (i < s->n && !isfinite(s->value[i]))
        i++;
    return i < s->n;
}

static int sample(struct reading *r, struct identify_data *d)
{
    const struct series *first = &r->output[0];
    const double *time = first->t;
    double Ts, periods, *u, *y;
    int rc = find_sample_period(r, first, &Ts, &d->begin);

    if (rc < 0 || !time)
        return rc;
    for (size_t i = 0; i < r->inputs; i++)
        if (!has_value(&r->input[i]))
            return apc_fail(r->why, APC_EINVAL, "%s: there is no value of \"%s\" in that time", r->file,
                            r->input[i].name);
    periods = (time[first->n - 1] - d->begin) / Ts;
    if (!(periods <= SAMPLES_MOST))
        return apc_fail(r->why, APC_EINVAL, "%s: %g samples of %g s: must be 2 to %d", r->file, periods, Ts,
                        SAMPLES_MOST);
    d->record = (struct apc_record){.size = sizeof d->record,
                                    .Ts = Ts,
                                    .n = (size_t)(fmax(periods, 0.0) + ALIKE) + 1,
                                    .nu = r->inputs - r->selection->disturbances,
                                    .nd = r->selection->disturbances,
                                    .ny = r->outputs};
    u = d->memory = calloc(d->record.n * (r->inputs + r->outputs), sizeof *u);
    if (!u)
        return apc_fail(r->why, APC_ENOMEM, "out of memory");
    d->record.u = u;
    d->record.y = y = u + d->record.n * r->inputs;
    for (size_t i = 0; i < r->inputs; i++)
        hold(&r->input[i], first, d, r->selection->exchanged, r->inputs, u + i);
    for (size_t i = 0; i < r->outputs; i++)
        lay(&r->output[i], d, r->outputs, y + i);
    cut_beginning(d, r->inputs);
    if (d->record.n < 2)
        return apc_fail(r->why, APC_EINVAL, "%s: %zu samples of %g s: must be 2 to %d", r->file, d->record.n,
                        Ts, SAMPLES_MOST);
    count_gaps(d);
    return 0;
}

static void close_reading(struct reading *r)
{
    for (size_t i = 0; i < IDENTIFY_SIGNALS; i++) {
        free(r->input[i].t);
        free(r->input[i].value);
        free(r->output[i].t);
        free(r->output[i].value);
    }
    free(r);
}

int grid_read(struct identify_data *data, const struct grid_source *from,
              const struct identify_selection *selection, struct apc_error *why)
{
    struct reading *r = calloc(1, sizeof *r);
    int rc;

    *data = (struct identify_data){.memory = NULL};
    if (!r)
        return apc_fail(why, APC_ENOMEM, "out of memory");
    r->file = from->file;
    r->store = from->store;
    r->selection = selection;
    r->why = why;
    r->inputs = selection->inputs;
    r->outputs = selection->outputs;
    for (size_t i = 0; i < selection->inputs; i++)
        r->input[i].name = selection->input[i];
    for (size_t i = 0; i < selection->outputs; i++)
        r->output[i].name = selection->output[i];
    rc = from->read(r);
    if (rc == 0)
        rc = sample(r, data);
    for (size_t i = 0; i < r->inputs && rc == 0; i++) {
        snprintf(data->input[i], APC_TAG_LEN, "%s", r->input[i].name);
        snprintf(data->input_unit[i], APC_TAG_LEN, "%s", r->input[i].unit);
    }
    for (size_t i = 0; i < r->outputs && rc == 0; i++) {
        snprintf(data->output[i], APC_TAG_LEN, "%s", r->output[i].name);
        snprintf(data->output_unit[i], APC_TAG_LEN, "%s", r->output[i].unit);
    }
    close_reading(r);
    return rc;
}

void identify_data_free(struct identify_data *data)
{
    free(data->memory);
    free(data->runs);
    data->memory = NULL;
    data->runs = NULL;
}

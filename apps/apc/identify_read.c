/* SPDX-License-Identifier: BSD-3-Clause */
/* Records: a grid laid over the values of each signal. */
#include "identify_series.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>

#define SAMPLES_MOST 1000000
#define PARTS        10   /* of the median interval that are tried as the period */
#define ALIKE        0.25 /* of a period is how far a sample may be from the grid */

/* ---- The grid -------------------------------------------------------------------------------------- */

static int by_size(const void *a, const void *b)
{
    const double x = *(const double *)a, y = *(const double *)b;

    return (x > y) - (x < y);
}

/* How many samples of a series are near a grid that begins with it. */
static size_t near_grid(const struct series *s, double Ts)
{
    size_t n = 0;

    for (size_t k = 0; k < s->n; k++) {
        const double periods = (s->t[k] - s->t[0]) / Ts;

        n += fabs(periods - round(periods)) <= ALIKE;
    }
    return n;
}

/* The median interval, or a part of it where samples are 2, 3, 2, 3, ... periods apart, to the microsecond;
 * so that it fits the whole series. */
static int find_period(struct reading *r, const struct series *s, double *Ts)
{
    double *apart = calloc(s->n + 1, sizeof *apart), span, median;
    size_t near = 0;

    *Ts = r->wish->period > 0.0 ? r->wish->period : r->period;
    if (!apart)
        return apc_fail(r->why, APC_ENOMEM, "out of memory");
    for (size_t k = 0; k + 1 < s->n; k++)
        apart[k] = s->t[k + 1] - s->t[k];
    if (s->n > 2)
        qsort(apart, s->n - 1, sizeof *apart, by_size);
    median = s->n > 2 ? apart[(s->n - 1) / 2] : 0.0;
    free(apart);
    if (s->n < 3)
        return apc_fail(r->why, APC_EINVAL,
                        "%s: %zu samples of \"%s\" in that time: there is nothing to tell from", r->file,
                        s->n, s->name);
    span = s->t[s->n - 1] - s->t[0];
    for (int part = 1; part <= PARTS && *Ts <= 0.0; part++) {
        double period = span / round(span / median * part);

        period = period > 1e-3 ? round(period * 1e6) / 1e6 : period;
        if (part == 1)
            near = near_grid(s, period);
        if ((double)near_grid(s, period) >= 0.9 * (double)s->n)
            *Ts = period;
    }
    return *Ts > 0.0
               ? 0
               : apc_fail(r->why, APC_EINVAL,
                          "%s: the sample times of \"%s\" change: of %zu samples %zu are on a grid of %g s. "
                          "Record at one period, or name one by --period",
                          r->file, s->name, s->n, near, median);
}

/* Of a series what is near each time of the grid. */
static void lay(const struct series *s, const struct identify_data *d, size_t stride, double *to)
{
    size_t i = 0;

    for (size_t k = 0; k < d->record.n; k++) {
        const double t = d->begin + (double)k * d->record.Ts;

        while (i + 1 < s->n && fabs(s->t[i + 1] - t) <= fabs(s->t[i] - t))
            i++;
        to[k * stride] = s->n > 0 && fabs(s->t[i] - t) <= ALIKE * d->record.Ts ? s->value[i] : (double)NAN;
    }
}

/* What was in force at each time of the grid. */
static void hold(const struct series *s, const struct identify_data *d, size_t stride, double *to)
{
    double held = (double)NAN;
    size_t i = 0;

    for (size_t k = 0; k < d->record.n; k++) {
        for (; i < s->n && s->t[i] <= d->begin + ((double)k + 1e-3) * d->record.Ts; i++)
            held = isfinite(s->value[i]) ? s->value[i] : held;
        to[k * stride] = held;
    }
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

static double first_of(const struct series *s)
{
    size_t i = 0;

    while (i < s->n && !isfinite(s->value[i]))
        i++;
    return i < s->n ? s->t[i] : HUGE_VAL;
}

static int sample(struct reading *r, struct identify_data *d)
{
    const struct series *first = &r->output[0];
    const double *time = first->t;
    double Ts, end, *u, *y;
    int rc = find_period(r, first, &Ts);

    if (rc < 0 || !time)
        return rc;
    d->begin = time[0];
    for (size_t i = 0; i < r->inputs; i++) {
        const double begin = first_of(&r->input[i]);

        if (begin == HUGE_VAL)
            return apc_fail(r->why, APC_EINVAL, "%s: there is no value of \"%s\" in that time", r->file,
                            r->input[i].name);
        if (begin > d->begin) /* on the grid of the first output */
            d->begin = time[0] + ceil((begin - time[0]) / Ts - 1e-3) * Ts;
    }
    end = time[first->n - 1];
    if (!(end > d->begin) || (end - d->begin) / Ts > SAMPLES_MOST)
        return apc_fail(r->why, APC_EINVAL, "%s: %g samples of %g s: must be 2 to %d", r->file,
                        fmax((end - d->begin) / Ts, 0.0), Ts, SAMPLES_MOST);
    d->record = (struct apc_record){.size = sizeof d->record,
                                    .Ts = Ts,
                                    .n = (size_t)((end - d->begin) / Ts + ALIKE) + 1,
                                    .nu = r->inputs - r->wish->disturbances,
                                    .nd = r->wish->disturbances,
                                    .ny = r->outputs};
    u = d->memory = calloc(d->record.n * (r->inputs + r->outputs), sizeof *u);
    if (!u)
        return apc_fail(r->why, APC_ENOMEM, "out of memory");
    d->record.u = u;
    d->record.y = y = u + d->record.n * r->inputs;
    for (size_t i = 0; i < r->inputs; i++)
        hold(&r->input[i], d, r->inputs, u + i);
    for (size_t i = 0; i < r->outputs; i++)
        lay(&r->output[i], d, r->outputs, y + i);
    count_gaps(d);
    return 0;
}

/* ---- All of it ------------------------------------------------------------------------------------- */

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

bool identify_is_store(const char *file)
{
    struct stat what;

    return file[strcspn(file, ":/")] == ':' && stat(file, &what) != 0;
}

int identify_read(struct identify_data *data, const char *file, const struct identify_wish *wish,
                  struct apc_error *why)
{
    struct reading *r = calloc(1, sizeof *r);
    int rc;

    *data = (struct identify_data){.memory = NULL};
    if (!r)
        return apc_fail(why, APC_ENOMEM, "out of memory");
    r->file = file;
    r->wish = wish;
    r->why = why;
    r->inputs = wish->inputs;
    r->outputs = wish->outputs;
    for (size_t i = 0; i < wish->inputs; i++)
        r->input[i].name = wish->input[i];
    for (size_t i = 0; i < wish->outputs; i++)
        r->output[i].name = wish->output[i];
    rc = identify_is_store(file) ? identify_read_store(r) : identify_read_files(r);
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

/* SPDX-License-Identifier: BSD-3-Clause */
#include "metrics.h"

#include <math.h>

#include "print.h"
#include "simulation.h"

#define BAND  0.05 /* of the step, within which the measurement has settled */
#define LEAST 0.1  /* of the largest step: a smaller one is none */

static const double none = (double)NAN;

static const char *const names[METRICS] = {[METRIC_IAE] = "IAE",
                                           [METRIC_ISE] = "ISE",
                                           [METRIC_ITAE] = "ITAE",
                                           [METRIC_OVERSHOOT] = "overshoot %",
                                           [METRIC_SETTLING] = "settling s",
                                           [METRIC_EFFORT] = "effort"};

const char *metric_name(enum metric metric)
{
    return names[metric];
}

size_t metrics_loops(const struct experiment *e)
{
    size_t n = e->dim.ny < e->dim.nz ? e->dim.ny : e->dim.nz;
    return n < e->dim.nu ? n : e->dim.nu;
}

/* What is known of one loop while its samples pass. */
struct loop {
    double t, y, r, u;      /* NAN: none yet */
    double step_at, step;   /* of the last step of the setpoint */
    double least;           /* a smaller step is none */
    double beyond, outside; /* largest overshoot of it; time at which y was last outside the band */
    double *figure;
};

static void integrate(struct loop *l, double until)
{
    double dt = until - l->t, e = l->r - l->y, from = l->t - l->step_at;
    if (!(dt > 0)) /* the source time of what comes later may be earlier */
        return;
    l->t = until;
    if (isnan(e))
        return;
    l->figure[METRIC_IAE] += fabs(e) * dt;
    l->figure[METRIC_ISE] += e * e * dt;
    l->figure[METRIC_ITAE] += fabs(e) * dt * (from + dt / 2);
}

/* A setpoint that begins next to where the measurement is makes no step. */
static bool steps(const struct loop *l)
{
    return fabs(l->step) > l->least;
}

static void watch(struct loop *l)
{
    if (!steps(l))
        return;
    double e = (l->y - l->r) / l->step;
    l->beyond = fmax(l->beyond, e);
    if (fabs(e) > BAND)
        l->outside = l->t;
}

/* A step is over: by the next, or by the end of the run. One at whose end y is outside has not settled. */
static void close_step(struct loop *l)
{
    double *overshoot = &l->figure[METRIC_OVERSHOOT], *settling = &l->figure[METRIC_SETTLING];
    if (!steps(l))
        return;
    double took = fabs(l->y - l->r) > BAND * fabs(l->step) ? HUGE_VAL : fmax(l->outside - l->step_at, 0);
    *overshoot = isnan(*overshoot) ? 100 * l->beyond : fmax(*overshoot, 100 * l->beyond);
    *settling = isnan(*settling) ? took : fmax(*settling, took);
}

static void take(struct loop *l, const struct apc_sample *s, double t)
{
    if (s->table == APC_ACTUATOR) {
        if (!isnan(l->u))
            l->figure[METRIC_EFFORT] += fabs(s->value - l->u);
        l->u = s->value;
        return;
    }
    integrate(l, t);
    if (s->table == APC_SENSOR) {
        l->y = s->value;
        if (isnan(l->step) && !isnan(l->r))
            l->step = l->r - l->y; /* the first step is from where the measurement begins */
        watch(l);
    } else if (isnan(l->r) || s->value < l->r || s->value > l->r) {
        close_step(l);
        l->step = s->value - (isnan(l->r) ? l->y : l->r);
        l->r = s->value;
        l->step_at = l->outside = t;
        l->beyond = 0;
    }
}

double metrics_step(const struct samples *s, int id)
{
    double step = none, before = none;
    for (size_t i = 0; i < s->n && isnan(before); i++)
        if (s->at[i].table == APC_SENSOR && s->at[i].id == id)
            before = s->at[i].value;
    for (size_t i = 0; i < s->n; i++)
        if (s->at[i].table == APC_SETPOINT && s->at[i].id == id) {
            step = fmax(step, fabs(s->at[i].value - before)); /* which is the other one when step is NAN */
            before = s->at[i].value;
        }
    return step > 0 ? step : none;
}

void metrics_of(const struct samples *s, size_t loop, apc_ns start, double end, double figure[METRICS])
{
    struct loop l = {.y = none, .r = none, .u = none, .step = none, .figure = figure};
    for (int i = 0; i < METRICS; i++)
        figure[i] = i == METRIC_OVERSHOOT || i == METRIC_SETTLING ? none : 0;
    l.least = LEAST * metrics_step(s, (int)loop + 1);
    for (size_t i = 0; i < s->n; i++)
        if (s->at[i].id == (int)loop + 1)
            take(&l, &s->at[i], apc_ns_to_s(s->at[i].time - start));
    integrate(&l, end);
    close_step(&l);
    if (isinf(figure[METRIC_SETTLING]))
        figure[METRIC_SETTLING] = none;
}

int metrics_print(const struct samples *s, const struct experiment *e, double end, FILE *out)
{
    struct print_column columns[1 + METRICS] = {{"loop", PRINT_LEFT}};
    double figure[METRICS];
    struct print_table table;
    for (int i = 0; i < METRICS; i++)
        columns[1 + i] = (struct print_column){names[i], PRINT_POINT};
    print_table_open(&table, columns, 1 + METRICS);
    for (size_t loop = 0; loop < metrics_loops(e); loop++) {
        metrics_of(s, loop, SIMULATION_BEGIN, end, figure);
        print_cell(&table, PRINT_PLAIN, "%s", e->y[loop].tag.name);
        for (int i = 0; i < METRICS; i++)
            print_cell(&table, PRINT_PLAIN, isnan(figure[i]) ? "-" : "%.6g", figure[i]);
    }
    int rc = print_table_show(&table, out, false, 0, "\n");
    print_table_close(&table);
    return rc;
}

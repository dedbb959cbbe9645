/* SPDX-License-Identifier: BSD-3-Clause */
/*
 * The output of the plant is known at its ticks; between two of them it is a straight line here, and the
 * integrals are those of these lines, exactly. The setpoint changes in steps, so that the error is made of
 * straight pieces as well; within a part only one that a controller or a ramp moves does.
 */
#include "figures.h"
#include "operate/operate.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#define BAND                                                                                                 \
    0.05 /* of the step, within which the output has settled; of the largest one, near the setpoint */
#define LEAST 0.1  /* of the largest step: a smaller change is none */
#define NEAR  0.01 /* both, where there is no step to compare with: of the setpoint's range */

#define NAMED 3 /* events that begin a part */

static const double none = (double)NAN;

static const struct {
    const char *name, *key, *former;
} names[METRICS] = {
    [METRIC_IAE] = {"IAE", "iae", NULL},
    [METRIC_ISE] = {"ISE", "ise", NULL},
    [METRIC_ITAE] = {"ITAE", "itae", NULL},
    [METRIC_OVERSHOOT] = {"overshoot %", "overshoot_percent", NULL},
    [METRIC_SETTLING] = {"settling s", "settling_s", NULL},
    [METRIC_PEAK] = {"peak", "peak", NULL},
    [METRIC_RECOVERY] = {"recovery s", "recovery_s", "return_s"},
    [METRIC_EFFORT] = {"control effort", "effort", NULL},
    [METRIC_UNCONTROLLED] = {"uncontrolled %", "uncontrolled_percent", "without_control_percent"}};

const char *metric_name(enum metric metric)
{
    return names[metric].name;
}

const char *metric_key(enum metric metric)
{
    return names[metric].key;
}

const char *metric_former_key(enum metric metric)
{
    return names[metric].former;
}

/* ---- Loops -------------------------------------------------------------------------------- */

int metrics_loops(const struct experiment *e, struct loop *loop)
{
    struct loops all;
    size_t n = 0;
    const int rc = controllers_describe(e, &all);
    for (size_t i = 0; i < all.n && rc == 0; i++) {
        const struct loops_loop *from = &all.at[i];
        const size_t y = (size_t)from->measurement - 1, z = (size_t)from->setpoint - 1;
        bool told = y >= e->dim.ny || z >= e->dim.nz; /* what has none, or is calculated, is not judged */
        for (size_t k = 0; k < n; k++)                /* two outputs for one thing */
            told = told || (loop[k].y == y && loop[k].z == z);
        if (told)
            continue;
        loop[n] = (struct loop){.y = y, .z = z, .u = {from->table, (size_t)from->output - 1}};
        snprintf(loop[n++].name, sizeof loop->name, "%s",
                 e->n_controllers > 1 ? from->name : e->y[y].tag.name);
    }
    loops_free(&all);
    return rc < 0 ? rc : (int)n;
}

/* ---- Events ------------------------------------------------------------------------------- */

/* The first point at or after @t. */
static size_t first_from(const struct curve *c, double t)
{
    size_t low = 0, high = c->n;
    while (low < high) {
        size_t middle = low + (high - low) / 2;
        if (c->at[middle].t < t)
            low = middle + 1;
        else
            high = middle;
    }
    return low;
}

/* What was set last, at @t or before. */
static double set_at(const struct curve *c, double t)
{
    size_t next = first_from(c, t);
    while (next < c->n && c->at[next].t <= t)
        next++;
    return next > 0 ? c->at[next - 1].value : none;
}

static int by_change_time(const void *left, const void *right)
{
    const struct event *a = left, *b = right;
    if (a->t != b->t)
        return a->t < b->t ? -1 : 1;
    if (a->kind != b->kind)
        return a->kind < b->kind ? -1 : 1;
    return (a->which > b->which) - (a->which < b->which);
}

static double first_of_curves(const struct curve *curve, size_t n, double end)
{
    double first = end;
    for (size_t i = 0; i < n; i++)
        if (curve[i].n > 0)
            first = fmin(first, curve[i].at[0].t);
    return first;
}

/* In real time, and simulated after it, the plant may begin a moment before the first setpoint is written: nobody
 * controlled it until then. */
static double begin_of_trajectory(const struct trajectory *c, const struct experiment *e)
{
    const double begin = first_of_curves(c->output, c->dim.ny, c->end),
                 set = first_of_curves(c->setpoint, c->dim.nz, c->end),
                 moment = isfinite(c->gap) ? c->gap : apc_ns_to_s(e->plant.rhythm.period);
    return set < c->end && set - begin <= moment ? fmax(begin, set) : begin;
}

static void add_event(struct figures *f, const struct trajectory *c, struct event event)
{
    if (event.t < c->end && event.from != event.to)
        f->event[f->n_events++] = event;
}

/* By a controller, at each of its ticks: that is no event. */
static bool is_moved(const struct experiment *e, size_t setpoint)
{
    return controllers_above(e, (struct wire){APC_SETPOINT, setpoint}).of;
}

/* Of setpoint @i on its way: moved there by a ramp, and not by who ended it. */
static bool is_by_ramp(const struct trajectory *c, size_t i, const struct curve_point *at)
{
    const struct curve *rate = &c->rate[i];
    const size_t next = first_from(rate, at->t);
    return next > 0 && rate->at[next - 1].value > 0 &&
           (set_at(rate, at->t) > 0 || at->value == set_at(&c->target[i], at->t));
}

/* Of setpoint @i the ramp that row @k of its rates begins; it goes from where it was to where it came. */
static struct event event_of_ramp(const struct trajectory *c, size_t i, size_t k)
{
    const struct curve *r = &c->setpoint[i], *rate = &c->rate[i];
    const double t = rate->at[k].t, end = k + 1 < rate->n ? rate->at[k + 1].t : c->end, was = set_at(r, t),
                 from = isnan(was) ? 0 : was;
    struct event event = {EVENT_SETPOINT, i, t, from, from, 0};
    size_t next = first_from(r, t);
    for (; next < r->n && r->at[next].t <= end; next++)
        if (is_by_ramp(c, i, &r->at[next])) {
            event.to = r->at[next].value;
            event.over = r->at[next].t - t;
        }
    return event;
}

static int collect_events(struct figures *f, const struct trajectory *c, const struct experiment *e)
{
    size_t room = 1 + (e->plant.model ? e->plant.n_disturbances : 0);
    double begin = begin_of_trajectory(c, e);
    for (size_t i = 0; i < c->dim.nz; i++)
        room += c->setpoint[i].n + c->rate[i].n;
    f->event = calloc(room, sizeof *f->event);
    if (!f->event)
        return APC_ENOMEM;
    add_event(f, c, (struct event){EVENT_START, 0, begin, none, none, 0});
    for (size_t i = 0; i < c->dim.nz; i++) {
        for (size_t k = 0; k < c->setpoint[i].n && !is_moved(e, i); k++) {
            const struct curve_point *at = &c->setpoint[i].at[k];
            if (at->t > begin && !is_by_ramp(c, i, at))
                add_event(
                    f, c,
                    (struct event){EVENT_SETPOINT, i, at->t, k > 0 ? at[-1].value : none, at->value, 0});
        }
        for (size_t k = 0; k < c->rate[i].n; k++)
            if (c->rate[i].at[k].t > begin)
                add_event(f, c, event_of_ramp(c, i, k));
    }
    for (size_t i = 0; e->plant.model && i < e->plant.n_disturbances; i++) {
        const struct apc_disturbance *d = &e->plant.disturbance[i];
        double from = e->plant.model->disturbance[d->k].initial;
        for (size_t k = 0; k < i; k++)
            if (d[-1 - (ptrdiff_t)k].k == d->k) {
                from = d[-1 - (ptrdiff_t)k].value;
                break;
            }
        double t = apc_ns_to_s(e->plant.rhythm.phase + d->at);
        add_event(f, c, (struct event){EVENT_DISTURBANCE, d->k, fmax(t, begin), from, d->value, 0});
    }
    if (f->n_events > 0)
        qsort(f->event, f->n_events, sizeof *f->event, by_change_time);
    for (size_t i = 0; i < f->n_events; i++)
        f->n_parts += i == 0 || f->event[i].t > f->event[i - 1].t;
    return 0;
}

static void make_figure_parts(const struct figures *f, struct part *part, double end)
{
    for (size_t i = 0, k = 0; i < f->n_parts; i++) {
        part[i].first = k;
        part[i].from = f->event[k].t;
        while (k < f->n_events && f->event[k].t <= part[i].from)
            k++;
        part[i].n = k - part[i].first;
        part[i].to = k < f->n_events ? f->event[k].t : end;
    }
}

/* ---- One part of one loop ----------------------------------------------------------------- */

/* What makes a change of the setpoint a step, and how near is near. */
struct scale {
    double least, band;
};

/* While the pieces of a part pass. */
struct pass {
    double from, r, band, step; /* step 0: none */
    double *figure;
    double near_since; /* s since the part's begin; HUGE_VAL: not near */
    double beyond;     /* of the step */
};

/* The integrals of an error that goes straight from @a at @t, since the event, to @b of the same sign. */
static void integrate(double *figure, double t, double dt, double a, double b)
{
    double sum = fabs(a) + fabs(b);
    figure[METRIC_IAE] += dt * sum / 2;
    figure[METRIC_ISE] += dt * (a * a + a * b + b * b) / 3;
    figure[METRIC_ITAE] += dt * (t * sum / 2 + dt * (fabs(a) + 2 * fabs(b)) / 6);
}

static void take_piece(struct pass *p, double t, double a, double to, double b)
{
    t -= p->from;
    to -= p->from;
    if (a * b < 0) {
        double cross = t + (to - t) * (a / (a - b));
        integrate(p->figure, t, cross - t, a, 0);
        integrate(p->figure, cross, to - cross, 0, b);
    } else {
        integrate(p->figure, t, to - t, a, b);
    }
}

/* The error is @e from @t on, as far as is known. */
static void take_point(struct pass *p, double t, double e)
{
    if (fabs(e) > p->band)
        p->near_since = HUGE_VAL;
    else if (isinf(p->near_since))
        p->near_since = t - p->from;
    if (p->step != 0)
        p->beyond = fmax(p->beyond, e / p->step);
    p->figure[METRIC_PEAK] = fmax(p->figure[METRIC_PEAK], fabs(e));
}

/* On the straight line between the points around @t. */
static double curve_value_at(const struct curve *c, double t)
{
    size_t next = first_from(c, t);
    if (next == c->n || next == 0)
        return c->at[next == 0 ? 0 : c->n - 1].value;
    const struct curve_point *a = &c->at[next - 1], *b = &c->at[next];
    return a->value + (b->value - a->value) * ((t - a->t) / (b->t - a->t));
}

/* Is all of it known? */
static bool whole(const struct curve *c, const struct part *part, double gap)
{
    size_t next = c->n > 0 ? first_from(c, part->from) : 0;
    double before = next > 0 ? c->at[next - 1].t : part->from;
    for (; next < c->n && c->at[next].t <= part->to; next++) {
        if (c->at[next].t - before > gap)
            return false;
        before = c->at[next].t;
    }
    return c->n > 0 && (next < c->n ? c->at[next].t : part->to) - before <= gap;
}

static void follow_curve(struct pass *p, const struct curve *c, const struct curve *r, double to)
{
    double t = p->from, e = curve_value_at(c, t) - p->r;
    size_t next = first_from(r, t);
    while (next < r->n && r->at[next].t <= t)
        next++;
    p->near_since = HUGE_VAL;
    take_point(p, t, e);
    for (size_t i = first_from(c, t); i < c->n && c->at[i].t <= to; i++) {
        for (; next < r->n && r->at[next].t < c->at[i].t; next++) { /* moved by a controller or a ramp */
            const double z = curve_value_at(c, r->at[next].t);
            take_piece(p, t, e, r->at[next].t, z - p->r);
            t = r->at[next].t;
            p->r = r->at[next].value;
            e = z - p->r;
            take_point(p, t, e);
        }
        double to_e = c->at[i].value - p->r;
        take_piece(p, t, e, c->at[i].t, to_e);
        t = c->at[i].t;
        e = to_e;
        take_point(p, t, e);
    }
    take_piece(p, t, e, to, curve_value_at(c, to) - p->r);
}

/* How far the loop's own setpoint stepped at the begin of a part; at the start from where the output was. */
static double setpoint_step_of(const struct figures *f, const struct part *part, const struct loop *loop,
                               double z, double r)
{
    for (size_t i = part->first; i < part->first + part->n; i++) {
        const struct event *at = &f->event[i];
        if (at->kind == EVENT_START)
            return r - z;
        if (at->kind == EVENT_SETPOINT && at->which == loop->z && at->over == 0)
            return r - (isnan(at->from) ? z : at->from);
    }
    return 0;
}

/* NULL: of a calculated signal there is none. */
static const struct curve *output_of(const struct trajectory *c, const struct loop *loop)
{
    return loop->u.table == APC_SENSOR     ? NULL
           : loop->u.table == APC_SETPOINT ? &c->setpoint[loop->u.at]
                                           : &c->input[loop->u.at];
}

static double effort(const struct curve *input, const struct part *part)
{
    double sum = 0;
    if (!input)
        return none;
    for (size_t i = 1; i < input->n; i++)
        if (input->at[i].t > part->from && input->at[i].t <= part->to)
            sum += fabs(input->at[i].value - input->at[i - 1].value);
    return input->n > 0 ? sum : none;
}

static double without(const struct trajectory *c, const struct part *part)
{
    const struct curve *w = &c->without;
    double sum = 0;
    for (size_t i = 0; i < w->n; i++) {
        double from = fmax(i == 0 ? part->from : w->at[i].t, part->from),
               to = fmin(i + 1 < w->n ? w->at[i + 1].t : part->to, part->to);
        sum += to > from ? w->at[i].value * (to - from) : 0;
    }
    return w->n > 0 ? 100 * sum / (part->to - part->from) : none;
}

/* After the end of a plant that diverged everything would have been endless. */
static void diverge(double *figure)
{
    for (int i = METRIC_IAE; i <= METRIC_RECOVERY; i++)
        figure[i] = isnan(figure[i]) ? none : HUGE_VAL;
}

static void measure_part(const struct figures *f, const struct trajectory *c, const struct loop *loop,
                         const struct scale *scale, struct part *part)
{
    const struct curve *output = &c->output[loop->y];
    struct pass p = {
        .from = part->from, .r = set_at(&c->setpoint[loop->z], part->from), .figure = part->figure};

    for (int i = 0; i < METRICS; i++)
        p.figure[i] = none;
    p.figure[METRIC_UNCONTROLLED] = without(c, part);
    p.figure[METRIC_EFFORT] = effort(output_of(c, loop), part);
    if (isnan(p.r) || !whole(output, part, c->gap))
        return;
    p.figure[METRIC_IAE] = p.figure[METRIC_ISE] = p.figure[METRIC_ITAE] = p.figure[METRIC_PEAK] = 0;
    p.step = setpoint_step_of(f, part, loop, curve_value_at(output, part->from), p.r);
    part->step = fabs(p.step) > scale->least;
    p.step = part->step ? p.step : 0;
    p.band = part->step ? BAND * fabs(p.step) : scale->band;
    follow_curve(&p, output, &c->setpoint[loop->z], part->to);
    if (part->step) {
        p.figure[METRIC_OVERSHOOT] = 100 * p.beyond;
        p.figure[METRIC_SETTLING] = p.near_since;
        p.figure[METRIC_PEAK] = none;
    } else {
        p.figure[METRIC_RECOVERY] = isnan(p.band) ? none : p.near_since;
    }
    if (c->diverged && part->to >= c->end)
        diverge(p.figure);
}

/* ---- One loop ----------------------------------------------------------------------------- */

static struct scale scale_of(const struct trajectory *c, const struct experiment *e, const struct loop *loop,
                             double begin)
{
    const struct curve *r = &c->setpoint[loop->z];
    const struct apc_tag *tag = &e->z[loop->z].tag;
    const double range = tag->high - tag->low,
                 z = c->output[loop->y].n > 0 ? curve_value_at(&c->output[loop->y], begin) : none,
                 first = fabs(set_at(r, begin) - z);
    double largest = 0;
    for (size_t i = 1; i < r->n && !is_moved(e, loop->z); i++)
        if (!is_by_ramp(c, loop->z, &r->at[i]))
            largest = fmax(largest, fabs(r->at[i].value - r->at[i - 1].value));
    for (size_t k = 0; k < c->rate[loop->z].n; k++) {
        const struct event ramp = event_of_ramp(c, loop->z, k);
        largest = fmax(largest, fabs(ramp.to - ramp.from)); /* NAN is none */
    }
    if (largest > 0)
        return (struct scale){LEAST * largest,
                              BAND * (first > LEAST * largest ? fmax(first, largest) : largest)};
    bool ranged = tag->low > -APC_VALUE_MAX && tag->high < APC_VALUE_MAX && range > 0;
    double least = NEAR * (ranged ? range : fmax(fabs(set_at(r, begin)), fabs(z)));
    return (struct scale){least, first > least ? BAND * first : ranged ? least : none};
}

static void sum_up_parts(struct metrics *m, size_t n_parts)
{
    double time = 0, lost = 0;
    bool hole = n_parts == 0;
    for (int i = 0; i < METRICS; i++)
        m->figure[i] =
            i == METRIC_IAE || i == METRIC_ISE || i == METRIC_ITAE || i == METRIC_EFFORT ? 0 : none;
    for (size_t k = 0; k < n_parts; k++) {
        const double *of = m->part[k].figure;
        hole |= isnan(of[METRIC_IAE]);
        for (int i = METRIC_IAE; i <= METRIC_ITAE; i++)
            m->figure[i] += of[i];
        for (int i = METRIC_OVERSHOOT; i <= METRIC_RECOVERY; i++)
            m->figure[i] = fmax(m->figure[i], of[i]); /* the other one where one of them is NAN */
        m->figure[METRIC_EFFORT] += of[METRIC_EFFORT];
        time += m->part[k].to - m->part[k].from;
        lost += of[METRIC_UNCONTROLLED] * (m->part[k].to - m->part[k].from);
    }
    for (int i = METRIC_IAE; i <= METRIC_RECOVERY && hole; i++)
        m->figure[i] = none;
    m->figure[METRIC_EFFORT] = n_parts > 0 ? m->figure[METRIC_EFFORT] : none;
    m->figure[METRIC_UNCONTROLLED] = time > 0 ? lost / time : none;
}

double figures_beyond(const struct experiment *e, const struct trajectory *c)
{
    double time = 0;
    for (size_t i = 0; i < e->dim.ny; i++) {
        const struct curve *y = &c->output[i];
        for (size_t k = 0; k < y->n; k++)
            if (y->at[k].value < e->y[i].tag.low || y->at[k].value > e->y[i].tag.high)
                time += (k + 1 < y->n ? y->at[k + 1].t : c->end) - y->at[k].t;
    }
    return c->end > 0 ? time / c->end : 0;
}

int figures_make(struct figures *f, const struct trajectory *c, const struct experiment *e)
{
    *f = (struct figures){0};
    f->loop = calloc(controllers_loops(e) + 1, sizeof *f->loop);
    if (!f->loop || collect_events(f, c, e) < 0)
        return APC_ENOMEM;
    const int n = metrics_loops(e, f->loop);
    f->of = n < 0 ? NULL : calloc((size_t)n + 1, sizeof *f->of);
    for (; f->of && f->n_loops < (size_t)n; f->n_loops++) {
        struct metrics *m = &f->of[f->n_loops];
        const struct loop *loop = &f->loop[f->n_loops];
        m->part = calloc(f->n_parts + 1, sizeof *m->part);
        if (!m->part)
            return APC_ENOMEM;
        make_figure_parts(f, m->part, c->end);
        const struct scale scale = scale_of(c, e, loop, begin_of_trajectory(c, e));
        for (size_t k = 0; k < f->n_parts; k++)
            measure_part(f, c, loop, &scale, &m->part[k]);
        sum_up_parts(m, f->n_parts);
    }
    return f->of ? 0 : APC_ENOMEM;
}

void figures_free(struct figures *f)
{
    for (size_t i = 0; i < f->n_loops; i++)
        free(f->of[i].part);
    free(f->of);
    free(f->loop);
    free(f->event);
    *f = (struct figures){0};
}

/* ---- In words ----------------------------------------------------------------------------- */

const char *figures_variable(const struct event *event, const struct experiment *e)
{
    return event->kind == EVENT_SETPOINT ? e->z[event->which].tag.name
                                         : e->plant.model->disturbance[event->which].name;
}

void figures_name_part(const struct figures *f, const struct part *part, const struct experiment *e,
                       char *text, size_t size)
{
    size_t used = 0;
    text[0] = '\0';
    for (size_t i = part->first; i < part->first + part->n && used < size; i++) {
        const struct event *event = &f->event[i];
        const char *and = used > 0 ? "; " : "";
        if (i == part->first + NAMED && part->n > NAMED + 1) {
            snprintf(text + used, size - used, "; and %zu more", part->n - NAMED);
            return;
        }
        if (event->kind == EVENT_START)
            used += (size_t)snprintf(text + used, size - used, "start-up");
        else if (isnan(event->from))
            used += (size_t)snprintf(text + used, size - used, "%s%s %.6g", and, figures_variable(event, e),
                                     event->to);
        else
            used += (size_t)snprintf(text + used, size - used, "%s%s %.6g -> %.6g", and,
                                     figures_variable(event, e), event->from, event->to);
        if (event->over > 0 && used < size)
            used += (size_t)snprintf(text + used, size - used, " in %.4g s", event->over);
    }
}

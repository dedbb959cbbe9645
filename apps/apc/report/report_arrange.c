/* SPDX-License-Identifier: BSD-3-Clause */
/*
 * Which curve goes where. What has one unit, and is about as large, shares a panel: measurements with their
 * setpoints first, then outputs; what a cascade controls has one of its own. Very many loops are drawn as
 * bundles: a row for each controller, with measurements on the left, outputs on the right, and the loop of
 * the largest error before all others.
 */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "figures/figures.h"
#include "report_panels.h"

#define BUNDLE_MAX 20 /* loops: more in one small panel would say less than panels of a few */
#define SMALL      15 /* a curve moves at least by this part of what its panel shows */

/* ---- Curves ------------------------------------------------------------------------------- */

static void widen(struct curve_of *c, const struct report_series *series, bool bad_too)
{
    for (size_t k = 0; series && k < series->n; k++) {
        const struct report_point *p = &series->points[k];
        if (!bad_too && p->severity == APC_SEVERITY_BAD)
            continue;
        c->low = fmin(c->low, p->value);
        c->high = fmax(c->high, p->value);
    }
}

static const struct report_series *series_of_group(const struct report_group *group, size_t i)
{
    return i < group->n && group->series[i].n > 0 ? &group->series[i] : NULL;
}

/* The setpoint of a loop, and what moves that: the loop of a controller above for the same measurement. */
static void add_setpoints(struct report_panels *p, struct curve_of *c, const struct loop *loop, size_t loops,
                          bool *shown)
{
    const size_t y = (size_t)(c->signal - p->e->y);
    const struct loop *own = NULL;
    for (size_t k = 0; k < loops; k++)
        if (loop[k].y == y && !shown[loop[k].z] && (!own || own->u.table == APC_SETPOINT))
            own = &loop[k];
    if (!own)
        return;
    c->wanted = series_of_group(&p->data->z, own->z);
    c->setpoint = &p->e->z[own->z];
    shown[own->z] = true;
    for (size_t k = 0; k < loops; k++)
        if (loop[k].y == y && loop[k].u.table == APC_SETPOINT && loop[k].u.at == own->z &&
            !shown[loop[k].z]) {
            c->wanted_above = series_of_group(&p->data->z, loop[k].z);
            c->above = &p->e->z[loop[k].z];
            shown[loop[k].z] = true;
            return;
        }
}

/* A law expects a signal, or moves its setpoint. */
static const struct prediction_trajectory *expected_of(const struct report_panels *p,
                                                       const struct curve_of *c)
{
    const struct prediction *o = p->data->expected;
    for (size_t i = 0; o && i < o->n; i++) {
        const struct prediction_trajectory *at = &o->trajectory[i];
        if ((at->table == c->signal->tag.table && at->id == c->signal->tag.id) ||
            (c->setpoint && at->table == APC_SETPOINT && at->id == c->setpoint->tag.id))
            return at;
    }
    return NULL;
}

/* Predictive laws call them y_min and y_max. */
static void narrow_by_law_limits(struct curve_of *c, const struct experiment *e, const struct controller *of,
                                 size_t k)
{
    const struct apc_law_parameter at = apc_law_parameter_at(of->law, &of->dim, k);
    const char *name = of->law->tuning[at.number].name;
    if (at.scope != APC_OF_MEASUREMENT || of->y[at.of].table != APC_SENSOR ||
        c->signal != &e->y[of->y[at.of].at])
        return;
    if (!strcmp(name, "y_min"))
        c->least = fmax(c->least, of->tuning[k]);
    else if (!strcmp(name, "y_max"))
        c->most = fmin(c->most, of->tuning[k]);
}

/* As the file has them. */
static void keep_limits(const struct report_panels *p, struct curve_of *c)
{
    c->least = c->signal->tag.low;
    c->most = c->signal->tag.high;
    if (c->signal->tag.table != APC_SENSOR)
        return;
    c->least = fmax(c->least, c->signal->soft_low);
    c->most = fmin(c->most, c->signal->soft_high);
    for (size_t i = 0; i < p->e->n_controllers; i++) {
        const struct controller *of = &p->e->controllers[i];
        for (size_t k = 0; !of->shadow && of->law && k < apc_law_parameters(of->law, &of->dim); k++)
            narrow_by_law_limits(c, p->e, of, k);
    }
}

static void keep_curve(struct report_panels *p, struct curve_of c)
{
    keep_limits(p, &c);
    c.low = HUGE_VAL;
    c.high = -HUGE_VAL;
    c.expected = expected_of(p, &c);
    for (size_t k = 0; c.expected && k < c.expected->n; k++) {
        c.low = fmin(c.low, c.expected->expected[k]);
        c.high = fmax(c.high, c.expected->expected[k]);
    }
    widen(&c, c.series, c.signal->tag.table != APC_SENSOR);
    widen(&c, c.wanted, true);
    widen(&c, c.wanted_above, true);
    p->curve[p->n_curves++] = c;
}

static size_t count_shadows(const struct experiment *e)
{
    size_t n = 0;
    for (size_t i = 0; i < e->n_controllers; i++)
        n += e->controllers[i].shadow ? e->controllers[i].dim.nu : 0;
    return n;
}

/* What a controller would have put out, beside what went out. */
static void keep_shadows(struct report_panels *p)
{
    struct signal *next = p->shadow;
    for (size_t i = 0; i < p->e->n_controllers; i++) {
        const struct controller *c = &p->e->controllers[i];
        for (size_t k = 0; c->shadow && k < c->dim.nu; k++, next++) {
            next->tag = *controllers_output(p->e, (struct controller_loop){c, k});
            char name[APC_TAG_LEN];
            snprintf(name, sizeof name, "%.20s of %.30s", next->tag.name, c->name);
            memcpy(next->tag.name, name, sizeof name);
            next->tag.description[0] = '\0';
            next->tag.table = APC_ACTUATOR;
            next->tag.id = 0; /* no output's */
            keep_curve(p, (struct curve_of){.signal = next,
                                            .series = series_of_group(&p->data->published,
                                                                      (size_t)c->first_output + k - 1)});
        }
    }
}

static int collect_curves(struct report_panels *p)
{
    const struct experiment *e = p->e;
    const size_t ny = e->dim.ny + e->n_signals;
    struct loop *loop = calloc(controllers_loops(e) + 1, sizeof *loop);
    bool *shown = calloc(e->dim.nz + 1, sizeof *shown);
    const size_t shadows = count_shadows(e);
    p->curve = calloc(ny + e->dim.nz + e->dim.nu + shadows + 1, sizeof *p->curve);
    p->shadow = calloc(shadows + 1, sizeof *p->shadow);
    const int loops = loop ? metrics_loops(e, loop) : APC_ENOMEM;
    if (loops < 0 || !shown || !p->curve || !p->shadow) {
        free(loop);
        free(shown);
        return APC_ENOMEM;
    }
    for (size_t i = 0; i < ny; i++) {
        struct curve_of c = {.signal = &e->y[i], .series = series_of_group(&p->data->y, i)};
        add_setpoints(p, &c, loop, (size_t)loops, shown);
        keep_curve(p, c);
    }
    for (size_t i = 0; i < e->dim.nz; i++)
        if (!shown[i])
            keep_curve(p, (struct curve_of){.signal = &e->z[i],
                                            .wanted = series_of_group(&p->data->z, i),
                                            .setpoint = &e->z[i]});
    for (size_t i = 0; i < e->dim.nu; i++)
        keep_curve(p, (struct curve_of){.signal = &e->u[i], .series = series_of_group(&p->data->u, i)});
    keep_shadows(p);
    free(loop);
    free(shown);
    return 0;
}

static double curve_span(const struct curve_of *c)
{
    return c->high > c->low ? c->high - c->low : 0;
}

/* ---- Panels ------------------------------------------------------------------------------- */

/* Would the panel still show how each of its curves moves? */
static bool fits_in_panel(const struct report_panels *p, const struct panel *panel, const struct curve_of *c)
{
    const struct curve_of *first = &p->curve[panel->first];
    double low = c->low, high = c->high, least = curve_span(c);
    if (panel->n >= p->few || panel->outputs != is_output(c) || c->above || first->above ||
        strcmp(first->signal->tag.unit, c->signal->tag.unit) != 0)
        return false;
    for (size_t i = 0; i < panel->n; i++) {
        low = fmin(low, first[i].low);
        high = fmax(high, first[i].high);
        least = fmin(least, curve_span(&first[i]));
    }
    return !(high > low) || p->few > 4 || SMALL * least >= high - low;
}

/* Each curve to the first panel that it fits into, of those with at most @few curves; the curves are put in
 * the order of the panels. False when that takes more than @most panels. */
static bool arrange_panels(struct report_panels *p, size_t few, size_t most)
{
    p->n = p->n_drawn = 0;
    p->few = few;
    for (size_t i = 0; i < p->n_curves; i++) {
        const struct curve_of c = p->curve[i];
        size_t k = 0;
        while (k < p->n && !fits_in_panel(p, &p->panel[k], &c))
            k++;
        if (k == most)
            return false;
        if (k == p->n)
            p->panel[p->n++] = (struct panel){.first = i, .outputs = is_output(&c)};
        const size_t to = p->panel[k].first + p->panel[k].n++;
        memmove(&p->curve[to + 1], &p->curve[to], (i - to) * sizeof *p->curve);
        p->curve[to] = c;
        for (size_t next = k + 1; next < p->n; next++)
            p->panel[next].first++;
        p->n_drawn++;
    }
    return true;
}

/* ---- Bundles ------------------------------------------------------------------------------ */

/* The integral of the absolute error, for comparison only. */
static double error_of(const struct curve_of *c)
{
    double sum = 0;
    size_t z = 0;
    for (size_t k = 1; c->series && c->wanted && k < c->series->n; k++) {
        const struct report_point *from = &c->series->points[k - 1];
        while (z + 1 < c->wanted->n && c->wanted->points[z + 1].t <= from->t)
            z++;
        sum += fabs(from->value - c->wanted->points[z].value) * (from[1].t - from->t);
    }
    return sum;
}

static bool same_unit(const struct panel *panel, const struct curve_of *a, const struct curve_of *b)
{
    return panel->n == 0 || !strcmp(a->signal->tag.unit, b->signal->tag.unit);
}

/* Put those of @p from that @p c's loops have, on one side, behind those that are there. False: they do not
 * have one unit, or a curve belongs to two. */
static bool bundle_side(struct report_panels *p, const struct loops_controller *c, bool outputs,
                        const struct curve_of *from, size_t n)
{
    struct panel *panel = &p->panel[p->n++];
    double most = -1;
    *panel = (struct panel){.first = p->n_drawn, .outputs = outputs, .bundle = c};
    for (size_t i = c->first; i < c->first + c->n; i++) {
        const struct loops_loop *loop = &p->loops.at[i];
        const enum apc_table table = outputs ? loop->table : APC_SENSOR;
        const int id = outputs ? loop->output : loop->measurement;
        for (size_t k = 0; k < n; k++) {
            if (from[k].signal->tag.table != table || from[k].signal->tag.id != id)
                continue;
            if (p->n_drawn == n || !same_unit(panel, &p->curve[panel->first], &from[k]))
                return false;
            const double error = outputs ? i == panel[-1].loop : error_of(&from[k]);
            if (error > most) {
                most = error;
                panel->worst = panel->n;
                panel->loop = i;
            }
            p->curve[p->n_drawn++] = from[k];
            panel->n++;
        }
    }
    return panel->n > 0;
}

/* A row of two panels for each controller. False, and nothing arranged, where that is no picture of this
 * plant. */
static bool arrange_bundles(struct report_panels *p)
{
    bool fit = 2 * p->loops.n_controllers <= PANELS_MAX;
    for (size_t i = 0; i < p->loops.n_controllers; i++)
        fit = fit && p->loops.controller[i].n <= BUNDLE_MAX;
    struct curve_of *from = fit ? calloc(p->n_curves, sizeof *from) : NULL;
    if (!from)
        return false;
    memcpy(from, p->curve, p->n_curves * sizeof *from);
    p->n = p->n_drawn = 0;
    for (size_t i = 0; i < p->loops.n_controllers && fit; i++)
        fit = bundle_side(p, &p->loops.controller[i], false, from, p->n_curves) &&
              bundle_side(p, &p->loops.controller[i], true, from, p->n_curves);
    if (!fit)
        memcpy(p->curve, from, p->n_curves * sizeof *from);
    free(from);
    return fit;
}

int report_arrange(struct report_panels *p)
{
    if (collect_curves(p) < 0)
        return APC_ENOMEM;
    /* few curves in a panel, unless that makes too many panels */
    (void)(arrange_panels(p, 4, 16) || arrange_bundles(p) || arrange_panels(p, CURVES_NAMED, 24) ||
           arrange_panels(p, (size_t)2 * CURVES_NAMED, PANELS_MAX));
    return 0;
}

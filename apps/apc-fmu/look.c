/* SPDX-License-Identifier: BSD-3-Clause */
/*
 * An FMU that is looked at: its equations at points that it has not come to. One for co-simulation follows what
 * is set while it initialises. Who looks ahead has one for model exchange in its continuous-time mode, at time 0.
 */
#include "fmu.h"

#include <math.h>
#include <stdio.h>
#include <string.h>

enum { POINTS = 4 }; /* of a difference quotient of fourth order */

struct look {
    bool exchange;     /* else it stays in its initialisation */
    size_t n_unknown;  /* that it derives; 0: differences do */
    uint32_t *unknown; /* [n_unknown] references: derivatives of states, outputs that are none of both */
    size_t *row;       /* [ny] of an output among these; beyond them: the state that it is */
    double *column;    /* [n_unknown] */
    double *moved;     /* [nx + nu] */
    double *point;     /* [POINTS * (nx + ny)] */
    double *slopes;    /* as look_slopes() gives them */
    double *at, *sum;  /* [nx] of x itself, then [nx * (nx + nu)] of its derivatives */
    double *slope;     /* the same */
};

/* Outputs that are states or their derivatives are known: not each FMU derives them. */
static void choose_derived(const struct run *r, struct look *l)
{
    const size_t nx = r->d.n[KIND_STATE];
    const struct variable *const state = r->d.of[KIND_STATE];

    for (size_t i = 0; i < nx; i++)
        l->unknown[i] = r->d.derivative[i].reference;
    l->n_unknown = nx;
    for (size_t i = 0; i < r->ny; i++) {
        size_t k = 0;

        while (k < nx && state[k].reference != r->y_float64[i])
            k++;
        if (k < nx) {
            l->row[i] = nx + r->ny + k;
            continue;
        }
        for (k = 0; k < nx && l->unknown[k] != r->y_float64[i];)
            k++;
        l->row[i] = k < nx ? k : l->n_unknown;
        if (k == nx)
            l->unknown[l->n_unknown++] = r->y_float64[i];
    }
}

bool look_begin(struct run *r)
{
    const struct exchange *const m = r->fmi->exchange;
    const size_t nx = r->d.n[KIND_STATE], ny = r->ny, n = nx + r->nu;
    struct look *const l = room(1, sizeof *l);
    size_t n_states = nx, n_indicators = 0;
    struct event event = {0};
    bool jumped, derived = r->d.directional && r->y_float64;

    l->exchange = !r->d.co_simulation;
    if (l->exchange && m->sizes && !status_well(m->sizes(&n_states, &n_indicators), "its number of states"))
        return false;
    if (l->exchange && (!r->fmi->leave() || !settle_discrete_states(m, 0.0, &event, &jumped)))
        return false;
    n_indicators += r->d.n_indicators;
    if (n_indicators || event.comes || n_states != nx) {
        fprintf(stderr,
                "it has %s, which no prediction follows: export it without, or control by a model that is "
                "identified: apc test, apc identify\n",
                n_indicators  ? "events where an indicator changes its sign"
                : event.comes ? "events at times that it names"
                              : "states that its description does not show");
        return false;
    }
    for (size_t i = 0; i < r->nu; i++) { /* what is no continuous number can only be set before */
        if (!r->fmi->get(r->u[i], &r->given[i]))
            return false;
        derived &= r->u[i]->type == TYPE_FLOAT64;
    }
    l->unknown = room(nx + ny, sizeof *l->unknown);
    l->row = room(ny, sizeof *l->row);
    l->column = room(nx + ny, sizeof *l->column);
    l->moved = room(n, sizeof *l->moved);
    l->point = room(POINTS * (nx + ny), sizeof *l->point);
    l->slopes = room((nx + ny) * (1 + n), sizeof *l->slopes);
    l->at = room(nx * (1 + n), sizeof *l->at);
    l->sum = room(nx * (1 + n), sizeof *l->sum);
    l->slope = room(nx * (1 + n), sizeof *l->slope);
    if (derived)
        choose_derived(r, l);
    r->look = l;
    return true;
}

/* ---- A point --------------------------------------------------------------------------------- */

static bool set_back(const struct run *r, const struct variable *v, double value)
{
    double is;

    if (!r->fmi->set(v, value) || !r->fmi->get(v, &is))
        return false;
    if (is - value > 1e-12 * fabs(value) || value - is > 1e-12 * fabs(value)) {
        fprintf(stderr, "its state %s is %g after it was set to %g: it cannot be moved\n", v->name, is,
                value);
        return false;
    }
    return true;
}

bool look_point(const struct run *r, const double *x, const double *u, double *out)
{
    const struct exchange *const m = r->fmi->exchange;
    const size_t nx = r->d.n[KIND_STATE];

    if (!set_fmu_inputs(r, u))
        return false;
    if (r->look && r->look->exchange)
        return status_well(m->set_states(m->self, x, nx), "SetContinuousStates") &&
               status_well(m->get_derivatives(m->self, out, nx), "its derivatives") && outputs(r, out + nx);
    for (size_t i = 0; i < nx; i++)
        if (!set_back(r, &r->d.of[KIND_STATE][i], x[i]))
            return false;
    for (size_t i = 0; i < nx; i++)
        if (!r->fmi->get(&r->d.derivative[i], &out[i]))
            return false;
    return outputs(r, out + nx);
}

/* ---- Slopes ---------------------------------------------------------------------------------- */

static bool ask_slopes(const struct run *r, double *J)
{
    const struct look *const l = r->look;
    const size_t nx = r->d.n[KIND_STATE], n = nx + r->nu;

    for (size_t j = 0; j < n; j++) {
        const struct variable *const by = j < nx ? &r->d.of[KIND_STATE][j] : r->u[j - nx];

        if (!status_well(r->fmi->directional(l->unknown, l->n_unknown, by->reference, l->column),
                         "GetDirectionalDerivative"))
            return false;
        for (size_t i = 0; i < nx; i++)
            J[i * n + j] = l->column[i];
        for (size_t i = 0; i < r->ny; i++)
            J[(nx + i) * n + j] = l->row[i] < nx + r->ny          ? l->column[l->row[i]]
                                  : l->row[i] - (nx + r->ny) == j ? 1.0
                                                                  : 0.0;
    }
    return true;
}

/* Central differences of fourth order, as of a model that is built in; at a limit, beyond which a model may refuse to
 * go or stay as it is, of third order and inwards. */
static bool differ(const struct run *r, const double *x, const double *u, double *J)
{
    static const double offset[2][POINTS] = {{1.0, -1.0, 2.0, -2.0}, {0.0, 1.0, 2.0, 3.0}},
                        weight[2][POINTS] = {{8.0, -8.0, -1.0, 1.0}, {-22.0, 36.0, -18.0, 4.0}};
    const size_t nx = r->d.n[KIND_STATE], rows = nx + r->ny, n = nx + r->nu;
    double *const w = r->look->moved, *const f = r->look->point;

    memcpy(w, x, nx * sizeof *w);
    memcpy(w + nx, u, r->nu * sizeof *w);
    for (size_t j = 0; j < n; j++) {
        const struct variable *const v = j < nx ? &r->d.of[KIND_STATE][j] : r->u[j - nx];
        const double own = w[j];
        volatile double ahead = own + 1e-4 * fmax(fabs(own), 1e-2);
        double h = ahead - own;
        const bool below = own - 2.0 * h < v->low;
        const bool above = own + 2.0 * h > v->high;
        const bool inwards = below != above;

        if (above && inwards)
            h = -h;
        for (size_t k = 0; k < POINTS; k++) {
            w[j] = own + offset[inwards][k] * h;
            if (!look_point(r, w, w + nx, f + k * rows))
                return false;
        }
        w[j] = own;
        for (size_t i = 0; i < rows; i++) {
            double sum = 0.0;

            for (size_t k = 0; k < POINTS; k++)
                sum += weight[inwards][k] * f[k * rows + i];
            J[i * n + j] = sum / (12.0 * h);
        }
    }
    return true;
}

bool look_slopes(const struct run *r, const double *x, const double *u, double *out)
{
    double *const J = out + r->d.n[KIND_STATE] + r->ny;

    if (r->look->n_unknown)
        return look_point(r, x, u, out) && ask_slopes(r, J);
    return differ(r, x, u, J) && look_point(r, x, u, out);
}

/* ---- An interval ----------------------------------------------------------------------------- */

/* Each stage with its derivatives: with x' = f, X' = (df/dx) X + df/du, X of x by what it began with and u. */
bool look_interval(const struct run *r, const double *x, const double *u, double t, double steps, double *out)
{
    static const double reach[] = {0.0, 0.5, 0.5, 1.0}, weight[] = {1.0, 2.0, 2.0, 1.0};
    const size_t nx = r->d.n[KIND_STATE], n = nx + r->nu, all = nx * (1 + n);
    const double h = t / steps;
    double *const at = r->look->at, *const sum = r->look->sum, *const slope = r->look->slope;
    const double *const J = r->look->slopes + nx + r->ny;

    memset(out, 0, all * sizeof *out);
    memcpy(out, x, nx * sizeof *out);
    for (size_t i = 0; i < nx; i++)
        out[nx + i * n + i] = 1.0;
    for (int step = 0; step < (int)steps; step++) {
        memset(sum, 0, all * sizeof *sum);
        for (int k = 0; k < 4; k++) {
            for (size_t i = 0; i < all; i++)
                at[i] = out[i] + (k ? reach[k] * h * slope[i] : 0.0);
            if (!look_slopes(r, at, u, r->look->slopes))
                return false;
            memcpy(slope, r->look->slopes, nx * sizeof *slope);
            for (size_t i = 0; i < nx; i++)
                for (size_t j = 0; j < n; j++) {
                    double by = j < nx ? 0.0 : J[i * n + j];

                    for (size_t m = 0; m < nx; m++)
                        by += J[i * n + m] * at[nx + m * n + j];
                    slope[nx + i * n + j] = by;
                }
            for (size_t i = 0; i < all; i++)
                sum[i] += weight[k] * slope[i];
        }
        for (size_t i = 0; i < all; i++)
            out[i] += h / 6.0 * sum[i];
    }
    return true;
}

/* SPDX-License-Identifier: BSD-3-Clause */
#include "control/pid_loop.h"

#include <string.h>

#include "control/control_internal.h"

enum { I, SLOPE_Y, SLOPE_R, LAST_Y, LAST_R, LAST_U };

/* The filtered slope of what was last then and is now. */
static double filtered_slope(const struct pid_loop *l, double filtered, double last, double now)
{
    double tau = l->p[PID_TAU_D], reach = tau + l->p[PID_N] * l->h;

    return (tau * filtered + l->p[PID_N] * (now - last)) / reach;
}

static double derivative_part(const struct pid_loop *l)
{
    const double *p = l->p, *x = l->x;

    return p[PID_KP] * p[PID_TAU_D] *
           (p[PID_C] * filtered_slope(l, x[SLOPE_R], x[LAST_R], l->r) -
            filtered_slope(l, x[SLOPE_Y], x[LAST_Y], l->y));
}

/* v without the integral. Always evaluated in this order: a law that resumes compares bits. */
static double output_without_integral(const struct pid_loop *l)
{
    const double *p = l->p;

    return p[PID_U_BAR] + p[PID_KP] * (p[PID_B] * l->r - l->y) + derivative_part(l) + l->feed_forward;
}

/* The part of a bias that one period takes away. */
static double bias_share(const struct pid_loop *l)
{
    return l->h < l->p[PID_TAU_T] ? l->h / l->p[PID_TAU_T] : 1.0;
}

void apc_pid_reset(const struct pid_loop *l)
{
    unsigned limited = 0;

    /* As if it had been at rest at y until now: a start at the setpoint gives u_bar, whatever b is, and what
     * is fed forward is a change from here. */
    l->x[I] = (l->p[PID_TAU_I] > 0.0 ? l->p[PID_KP] * (1.0 - l->p[PID_B]) * l->y : 0.0) - l->feed_forward;
    l->x[SLOPE_Y] = 0.0;
    l->x[SLOPE_R] = 0.0;
    l->x[LAST_Y] = l->y;
    l->x[LAST_R] = l->r;
    l->x[LAST_U] = apc_law_cut(l->p[PID_U_BAR], l->p[PID_U_MIN], l->p[PID_U_MAX], &limited);
}

double apc_pid_wanted(const struct pid_loop *l)
{
    return output_without_integral(l) + l->x[I];
}

size_t apc_pid_loop_terms(const struct pid_loop *l, struct apc_law_term *term, size_t most)
{
    const double *p = l->p;
    const struct apc_law_term terms[] = {{"u_bar", NULL, p[PID_U_BAR]},
                                         {"P", NULL, p[PID_KP] * (p[PID_B] * l->r - l->y)},
                                         {"I", NULL, l->x[I]},
                                         {"D", NULL, derivative_part(l)},
                                         {"feed-forward", NULL, l->feed_forward}};
    const size_t n = sizeof(terms) / sizeof(*terms);

    for (size_t k = 0; k < n && k < most; k++)
        term[k] = terms[k];
    return n;
}

double apc_pid_limit(const struct pid_loop *l, double wanted, unsigned *limited)
{
    const double *p = l->p;
    double step = p[PID_DU_MAX] * l->h, u = apc_law_cut(wanted, p[PID_U_MIN], p[PID_U_MAX], limited);

    return step > 0.0 ? apc_law_cut(u, l->x[LAST_U] - step, l->x[LAST_U] + step, limited) : u;
}

void apc_pid_update(const struct pid_loop *l, double u, unsigned held)
{
    const double *p = l->p;
    double *x = l->x, beyond = apc_pid_wanted(l) - u;

    if (p[PID_TAU_I] > 0.0) {
        double increment = p[PID_KP] * l->h / p[PID_TAU_I] * (l->r - l->y);
        bool conditional = !(p[PID_TAU_T] > 0.0);

        if (!apc_law_blocks(held, increment) && !(conditional && increment * beyond > 0.0))
            x[I] += increment;
        if (!conditional)
            x[I] -= bias_share(l) * beyond;
    } else {
        x[I] -= p[PID_TAU_T] > 0.0 ? bias_share(l) * x[I] : x[I] / PID_FADE;
    }
    x[SLOPE_Y] = filtered_slope(l, x[SLOPE_Y], x[LAST_Y], l->y);
    x[SLOPE_R] = filtered_slope(l, x[SLOPE_R], x[LAST_R], l->r);
    x[LAST_Y] = l->y;
    x[LAST_R] = l->r;
    x[LAST_U] = u;
}

void apc_pid_track(const struct pid_loop *l, double u, bool gap)
{
    if (gap)
        apc_pid_reset(l);
    l->x[I] = u - output_without_integral(l);
    l->x[LAST_U] = u;
}

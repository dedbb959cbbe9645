/* SPDX-License-Identifier: BSD-3-Clause */
/* What predictive control is made from: settings, a model, unknown disturbances. */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "base/base_internal.h"
#include "base/parts.h"
#include "control/mpc.h"

#define HORIZON_MAX 1000
#define BLOCKS      6    /* where settings do not say: each twice as long as the one before */
#define HOLD        10.0 /* periods, where settings do not say */
#define LEAST       1e-6 /* of a weight of 1: what keeps modes in hand that no other weight sees */

const char *const apc_mpc_settings[] = {
    "horizon",          "blocks",    "measurement", "rank",     "terminal",
    "setpoint_preview", "steady",    "delay",       "y_scale",  "u_scale",
    "x_noise",          "d_noise",   "y_noise",     "hold",     "critical",
    "at_input",         "at_output", "iterations",  "economic", NULL};

int apc_mpc_count(const struct apc_law_setup *setup, const char *name, size_t least, size_t most, size_t *to,
                  struct apc_error *why)
{
    return apc_setting_index(setup, name, 1, 0, least, most, to, why);
}

static int flag(const struct apc_law_setup *setup, const char *name, bool *to, struct apc_error *why)
{
    size_t value = *to;
    int rc = apc_mpc_count(setup, name, 0, 1, &value, why);

    *to = value != 0;
    return rc;
}

/* ---- Blocks ---------------------------------------------------------------------------------------- */

static int take_blocks(struct apc_law_mpc *p, const struct apc_law_setup *setup, struct apc_error *why)
{
    const struct apc_setting *s = apc_setting_find(setup, "blocks");
    size_t n = s ? s->rows * s->columns : BLOCKS;

    if (s && (s->text || n == 0 || n > p->N))
        return apc_fail(
            why, APC_EINVAL,
            "setting \"blocks\": %zu of them in a horizon of %zu samples: expected how many samples "
            "each lasts, as [1, 1, 2, 4]",
            s->text ? 0 : n, p->N);
    p->block = calloc(n, sizeof(*p->block));
    if (!p->block)
        return apc_fail(why, APC_ENOMEM, "no memory");
    for (size_t b = 0, begin = 0; b < n && (s || begin < p->N); b++) {
        size_t length = s ? 1 : (size_t)1 << b;

        if (s) {
            int rc = apc_setting_index(setup, "blocks", n, b, 1, p->N, &length, why);

            if (rc < 0)
                return rc;
        }
        p->block[p->blocks++] = (unsigned)length;
        begin += length;
        if (s && begin > p->N)
            return apc_fail(why, APC_EINVAL,
                            "setting \"blocks\": %zu samples and more, beyond the horizon of %zu", begin,
                            p->N);
    }
    return 0;
}

/* ---- The model ------------------------------------------------------------------------------------- */

/* It comes with its dead times. */
static int check_sampled(const struct apc_law_setup *setup, struct apc_error *why)
{
    return apc_setting_find(setup, "delay")
               ? apc_fail(why, APC_EINVAL, "setting \"delay\": a model of its own has its \"delay\" itself")
               : 0;
}

int apc_mpc_sample(const struct apc_law_setup *setup, const double *delay, struct apc_linear **model,
                   struct apc_error *why)
{
    const struct apc_law_plant *plant = setup->plant;
    const struct apc_linear_continuous from = {.size = sizeof(from),
                                               .nx = plant->nx,
                                               .nu = setup->dim.nu,
                                               .nd = setup->dim.nd,
                                               .ny = setup->dim.ny,
                                               .A = plant->A,
                                               .B = plant->B,
                                               .C = plant->C,
                                               .D = plant->D,
                                               .x0 = plant->x0,
                                               .u0 = plant->u0,
                                               .y0 = plant->y0,
                                               .dead_time = delay};

    return apc_linear_from_continuous(model, &from, setup->Ts, why);
}

int apc_mpc_take_delay(const struct apc_law_setup *setup, double *to, struct apc_error *why)
{
    const struct apc_setting *s = apc_setting_find(setup, "delay");
    const bool one = s && s->rows * s->columns == 1;
    int rc = apc_setting_amounts(setup, "delay", one ? 1 : setup->dim.nu, to, why);

    for (size_t j = 1; j < setup->dim.nu && one; j++)
        to[j] = to[0];
    return rc;
}

static int sample_mpc_model(const struct apc_law_setup *setup, struct apc_linear **model,
                            struct apc_error *why)
{
    double *delay = calloc(setup->dim.nu + setup->dim.nd + 1, sizeof(*delay));
    int rc = delay ? apc_mpc_take_delay(setup, delay, why) : apc_fail(why, APC_ENOMEM, "no memory");

    if (rc == 0)
        rc = apc_mpc_sample(setup, delay, model, why);
    free(delay);
    return rc;
}

static int take_mpc_unknown(const struct apc_law_setup *setup, const char *name, enum apc_linear_where where,
                            size_t most, struct apc_linear_unknown *unknown, size_t *n, struct apc_error *why)
{
    const struct apc_setting *s = apc_setting_find(setup, name);
    const size_t length = s ? s->rows * s->columns : 0;

    for (size_t i = 0; i < length; i++) {
        size_t number = 0;
        int rc = apc_setting_index(setup, name, length, i, 1, most, &number, why);

        if (rc < 0)
            return rc;
        if (*n == setup->dim.ny)
            return apc_fail(
                why, APC_EINVAL,
                "settings \"at_input\" and \"at_output\": there may be %zu unknown disturbances, as "
                "many as measurements",
                *n);
        unknown[(*n)++] = (struct apc_linear_unknown){.where = where, .number = number - 1};
    }
    return 0;
}

/* Where settings do not say: at the inputs, as loads are, if those can be told apart; else at the outputs. */
static int choose_unknown(struct apc_law_mpc *p, const struct apc_linear *from,
                          struct apc_linear_unknown *unknown, size_t *n, struct apc_error *why)
{
    *n = p->dim.nz;
    for (size_t i = 0; i < *n; i++)
        unknown[i] = (struct apc_linear_unknown){.where = APC_AT_INPUT, .number = i};
    const int rc = *n <= p->dim.nu ? apc_linear_disturb(&p->disturbed, from, unknown, *n, why) : APC_EINVAL;
    if (rc == 0 || rc == APC_ENOMEM)
        return rc;
    for (size_t i = 0; i < *n; i++)
        unknown[i] = (struct apc_linear_unknown){.where = APC_AT_OUTPUT, .number = p->cv[i]};
    return apc_linear_disturb(&p->disturbed, from, unknown, *n, why);
}

int apc_mpc_disturb(struct apc_law_mpc *p, const struct apc_law_setup *setup, const struct apc_linear *from,
                    struct apc_linear_unknown *unknown, struct apc_error *why)
{
    size_t n = 0;
    int rc = take_mpc_unknown(setup, "at_input", APC_AT_INPUT, from->nu + (p->nonlinear ? from->nd : 0),
                              unknown, &n, why);

    if (rc == 0)
        rc = take_mpc_unknown(setup, "at_output", APC_AT_OUTPUT, setup->dim.ny, unknown, &n, why);
    if (rc == 0)
        rc = n ? apc_linear_disturb(&p->disturbed, from, unknown, n, why)
               : choose_unknown(p, from, unknown, &n, why);
    if (rc == 0) {
        p->nx = p->disturbed->nx;
        p->n_unknown = n;
    }
    return rc;
}

static int take_mpc_model(struct apc_law_mpc *p, const struct apc_law_setup *setup, struct apc_error *why)
{
    struct apc_linear_unknown *unknown = calloc(p->dim.ny + 1, sizeof(*unknown));
    const struct apc_linear *from = setup->plant->sampled;
    struct apc_linear *own = NULL;
    int rc = !unknown ? apc_fail(why, APC_ENOMEM, "no memory")
             : from   ? check_sampled(setup, why)
                      : sample_mpc_model(setup, &own, why);

    if (!from)
        from = own;
    if (rc == 0)
        rc = apc_mpc_disturb(p, setup, from, unknown, why);
    p->model = p->disturbed;
    p->unknown = unknown;
    apc_linear_destroy(own);
    return rc;
}

/* ---- The estimator --------------------------------------------------------------------------------- */

/* With noise in every state a steady filter says. */
int apc_mpc_check_detectable(const struct apc_linear *m, const double *r, struct apc_error *why)
{
    struct apc_estimator *trial = NULL;
    double *q = calloc(m->nx, sizeof(*q));
    int rc = q ? 0 : apc_fail(why, APC_ENOMEM, "no memory");

    for (size_t i = 0; i < m->nx && rc == 0; i++)
        q[i] = 1.0;
    if (rc == 0) {
        const struct apc_estimator_options options = {
            .size = sizeof(options), .kind = APC_KALMAN_STEADY, .linear = m, .q = q, .r = r};

        rc = apc_estimator_create(&trial, &options, why);
    }
    if (rc == APC_ESOLVER)
        rc = apc_fail(why, rc,
                      "a mode of the model that does not die out by itself is not seen in any measurement: "
                      "measure what shows it, or leave it out of the model");
    apc_estimator_destroy(trial);
    free(q);
    return rc;
}

int apc_mpc_take_y_noise(const struct apc_law_setup *setup, double *to, struct apc_error *why)
{
    int rc = apc_setting_amounts(setup, "y_noise", setup->dim.ny, to, why);

    for (size_t i = 0; i < setup->dim.ny && rc == 0; i++) {
        if (!(to[i] > 0.0))
            rc = apc_fail(why, APC_EINVAL,
                          "setting \"y_noise\": the standard deviation of measurement %zu's noise must be "
                          "above 0: what its sensor cannot tell apart, if nothing else",
                          i + 1);
    }
    return rc;
}

/* Standard deviations: of what each state, each unknown disturbance gains in 1 s; of the measurements. */
static int make_estimator(struct apc_law_mpc *p, const struct apc_law_setup *setup, bool steady,
                          struct apc_error *why)
{
    const struct apc_linear *m = p->model;
    const size_t nc = m->nx - p->n_unknown, n_unknown = p->n_unknown;
    double *q = calloc(m->nx + p->dim.ny, sizeof(*q)), *r;
    int rc;

    if (!q)
        return apc_fail(why, APC_ENOMEM, "no memory");
    r = q + m->nx;
    for (size_t i = 0; i < n_unknown; i++)
        q[nc + i] = 1.0;
    for (size_t i = 0; i < p->dim.ny; i++)
        r[i] = 1.0;
    rc = apc_setting_amounts(setup, "x_noise", m->nx_plant, q, why);
    if (rc == 0)
        rc = apc_setting_amounts(setup, "d_noise", n_unknown, q + nc, why);
    if (rc == 0)
        rc = apc_mpc_take_y_noise(setup, r, why);
    for (size_t i = 0; i < m->nx; i++)
        q[i] *= q[i] * setup->Ts;
    for (size_t i = 0; i < p->dim.ny; i++)
        r[i] *= r[i];
    if (rc == 0) {
        const struct apc_estimator_options options = {.size = sizeof(options),
                                                      .kind = steady ? APC_KALMAN_STEADY : APC_KALMAN,
                                                      .linear = m,
                                                      .q = q,
                                                      .r = r};

        rc = apc_estimator_create(&p->estimator, &options, why);
        if (rc == 0 && !steady)
            rc = apc_mpc_check_detectable(m, r, why);
    }
    free(q);
    return rc;
}

/* ---- All of it -------------------------------------------------------------------------------------- */

/* What counts as 1 where settings do not say: the signal's span. */
static double signal_span(const struct apc_signal_view *signal, size_t i)
{
    double width = signal ? signal[i].high - signal[i].low : 1.0;

    return width > 0.0 && width < APC_VALUE_MAX ? width : 1.0;
}

static int take_deviations(const struct apc_law_setup *setup, const char *name,
                           const struct apc_signal_view *signal, size_t n, double *to, struct apc_error *why)
{
    int rc;

    for (size_t i = 0; i < n; i++)
        to[i] = signal_span(signal, i);
    rc = apc_setting_amounts(setup, name, n, to, why);
    for (size_t i = 0; i < n && rc == 0; i++) {
        if (!(to[i] > 0.0))
            rc = apc_fail(why, APC_EINVAL, "setting \"%s\": each must be above 0", name);
    }
    return rc;
}

static int take_mpc_signals(struct apc_law_mpc *p, const struct apc_law_setup *setup, struct apc_error *why)
{
    const size_t ny = p->dim.ny;
    int rc = take_deviations(setup, "y_scale", setup->y, ny, p->dev_y, why);

    if (rc == 0)
        rc = take_deviations(setup, "u_scale", setup->u, p->dim.nu, p->dev_u, why);
    for (size_t i = 0; i < ny; i++)
        p->hold[i] = HOLD * p->Ts;
    if (rc == 0)
        rc = apc_setting_amounts(setup, "hold", ny, p->hold, why);
    for (size_t i = 0; i < ny && rc == 0; i++) {
        size_t critical = setup->y && setup->y[i].critical;

        rc = apc_setting_index(setup, "critical", ny, i, 0, 1, &critical, why);
        p->critical[i] = critical != 0;
    }
    for (size_t i = 0; i < ny && rc == 0; i++) {
        size_t economic = 0, k = 0;

        rc = apc_setting_index(setup, "economic", ny, i, 0, 1, &economic, why);
        p->economic[i] = economic != 0;
        while (k < p->dim.nz && p->cv[k] != i)
            k++;
        if (rc == 0 && economic && k == p->dim.nz)
            rc = apc_fail(why, APC_EINVAL,
                          "setting \"economic\": measurement %zu has no setpoint, which is what a unit of it "
                          "costs: give it one",
                          i + 1);
        for (size_t j = 0; setup->u && j < p->dim.nu && rc == 0 && economic; j++) {
            if (!(setup->u[j].high - setup->u[j].low < APC_VALUE_MAX))
                rc = apc_fail(why, APC_EINVAL,
                              "setting \"economic\" needs limits of output %s: give it low and high",
                              setup->u[j].name);
        }
    }
    return rc;
}

/* Something must move each controlled measurement before the horizon ends. */
static int check_reach(const struct apc_law_mpc *p, struct apc_error *why)
{
    const struct apc_linear *m = p->model;
    const size_t nx = m->nx, ny = m->ny, inputs = m->nu + m->nd;
    double *x, *next, *u, *y;
    bool *moved;
    const struct apc_part parts[] = {APC_PART(moved, ny), APC_PART(x, nx), APC_PART(next, nx),
                                     APC_PART(u, inputs), APC_PART(y, ny)};
    void *memory = apc_parts_allocate(parts, sizeof(parts) / sizeof(*parts));
    int rc = 0;

    if (!memory)
        return apc_fail(why, APC_ENOMEM, "no memory");
    for (size_t j = 0; j < m->nu; j++) {
        memcpy(x, m->x0, nx * sizeof(*x));
        memcpy(u, m->u0, inputs * sizeof(*u));
        u[j] += fmax(1.0, fabs(u[j]));
        for (size_t i = 0; i <= p->N; i++) {
            apc_linear_output(m, x, u, y);
            for (size_t c = 0; c < ny; c++)
                moved[c] |= fabs(y[c] - m->y0[c]) > 1e-12 * fabs(m->y0[c]);
            apc_linear_next(m, x, u, next);
            memcpy(x, next, nx * sizeof(*x));
        }
    }
    for (size_t k = 0; k < p->dim.nz && rc == 0; k++) {
        if (!moved[p->cv[k]])
            rc = apc_fail(why, APC_EINVAL,
                          "measurement %zu: no output moves it within the horizon of %zu periods, %g s: it "
                          "must be longer than the dead time",
                          p->cv[k] + 1, p->N, (double)p->N * p->Ts);
    }
    free(memory);
    return rc;
}

/* Ordinary weights, of these deviations. */
static int try_weights(struct apc_law_mpc *p, const double *dev_y, const double *dev_u, struct apc_error *why)
{
    const size_t ny = p->dim.ny, nu = p->dim.nu;
    double *q, *zone, *s, *r;
    const struct apc_part parts[] = {APC_PART(q, ny), APC_PART(zone, ny), APC_PART(s, nu), APC_PART(r, nu)};
    void *memory = apc_parts_allocate(parts, sizeof(parts) / sizeof(*parts));
    struct apc_mpc_weights weights = {.least = p->least};
    bool some = true;
    int rc;

    if (!memory)
        return apc_fail(why, APC_ENOMEM, "no memory");
    weights.q = q;
    weights.zone = zone;
    weights.s = s;
    weights.r = r;
    for (size_t k = 0; k < p->dim.nz; k++) {
        q[p->cv[k]] = 1.0 / (dev_y[p->cv[k]] * dev_y[p->cv[k]]);
        some = some && q[p->cv[k]] > 0.0;
    }
    for (size_t j = 0; j < nu; j++) {
        s[j] = 0.1 / (dev_u[j] * dev_u[j]);
        some = some && s[j] > 0.0;
    }
    rc = some && apc_values_ok(q, ny) && apc_values_ok(s, nu)
             ? apc_mpc_tune(p->mpc, &weights, why)
             : apc_fail(why, APC_EINVAL, "deviations whose squares are no numbers");
    free(memory);
    return rc;
}

/* Is there a regulator of this model at all? Where there is none only with the deviations that settings give,
 * these are to blame, and not the model. */
static int check_weights(struct apc_law_mpc *p, const struct apc_law_setup *setup, struct apc_error *why)
{
    int rc = try_weights(p, p->dev_y, p->dev_u, why);
    double *dev;

    if (rc == 0 || rc == APC_ENOMEM)
        return rc;
    dev = calloc(p->dim.ny + p->dim.nu, sizeof(*dev));
    if (!dev)
        return apc_fail(why, APC_ENOMEM, "no memory");
    for (size_t i = 0; i < p->dim.ny; i++)
        dev[i] = signal_span(setup->y, i);
    for (size_t j = 0; j < p->dim.nu; j++)
        dev[p->dim.ny + j] = signal_span(setup->u, j);
    if (try_weights(p, dev, dev + p->dim.ny, NULL) == 0)
        rc =
            apc_fail(why, rc,
                     "settings \"y_scale\" and \"u_scale\": deviations as large, as small or as far apart as "
                     "these leave weights that nothing can be calculated with; give of each signal one that "
                     "it really has, as a hundredth of its range");
    free(dev);
    return rc;
}

/* Where no weight of what comes after the horizon has to be found, which would say so. */
static int check_stabilisable(const struct apc_linear *m, struct apc_error *why)
{
    const size_t n = m->nx_plant + m->nx_held, nu = m->nu;
    double *A, *Q, *P, *B, *K, *R;
    const struct apc_part parts[] = {APC_PART(A, n * n),  APC_PART(Q, n * n),  APC_PART(P, n * n),
                                     APC_PART(B, n * nu), APC_PART(K, n * nu), APC_PART(R, nu * nu)};
    void *memory = apc_parts_allocate(parts, sizeof(parts) / sizeof(*parts));
    int rc;

    if (!memory)
        return apc_fail(why, APC_ENOMEM, "no memory");
    for (size_t i = 0; i < n; i++) {
        memcpy(A + i * n, m->A + i * m->nx, n * sizeof(*A));
        memcpy(B + i * nu, m->B + i * (nu + m->nd), nu * sizeof(*B));
        Q[i * n + i] = 1.0;
    }
    for (size_t j = 0; j < nu; j++)
        R[j * nu + j] = 1.0;
    rc = apc_riccati_solve(n, nu, A, B, Q, R, P, K, why);
    if (rc == APC_ESOLVER)
        rc = apc_fail(why, rc,
                      "the model cannot be stabilised: a mode that does not die out by itself is moved by no "
                      "output");
    free(memory);
    return rc;
}

static int make_problem(struct apc_law_mpc *p, const struct apc_law_setup *setup, bool terminal,
                        struct apc_error *why)
{
    const size_t ny = p->dim.ny, nu = p->dim.nu;
    unsigned *rank = calloc(ny, sizeof(*rank));
    bool *limits = calloc(2 * ny + nu, sizeof(*limits)), *zone, *rate;
    struct apc_mpc_options options = {.model = p->model,
                                      .horizon = p->N,
                                      .blocks = p->blocks,
                                      .block = p->block,
                                      .rank = rank,
                                      .iterations = (unsigned)p->iterations,
                                      .terminal = terminal,
                                      .linearise = p->nonlinear ? apc_nmpc_linearise : NULL,
                                      .enough = apc_mpc_late,
                                      .ctx = p};
    int rc = rank && limits ? check_reach(p, why) : apc_fail(why, APC_ENOMEM, "no memory");

    if (rc == 0 && !terminal)
        rc = check_stabilisable(p->model, why);
    if (rc < 0)
        goto out;
    zone = limits + ny;
    rate = zone + ny;
    for (size_t c = 0; c < ny && rc == 0; c++) {
        size_t of = 1;

        rc = apc_setting_index(setup, "rank", ny, c, 1, ny, &of, why);
        rank[c] = (unsigned)of;
        limits[c] = true;
        p->least[c] = LEAST / (p->dev_y[c] * p->dev_y[c]);
    }
    for (size_t i = 0; i < p->dim.nz && rc == 0; i++)
        zone[p->cv[i]] = true;
    for (size_t j = 0; j < nu && rc == 0; j++)
        rate[j] = true;
    options.limits = limits;
    options.zone = zone;
    options.rate = rate;
    if (rc == 0)
        rc = apc_mpc_create(&p->mpc, &options, why);
    if (rc == 0)
        rc = check_weights(p, setup, why);
out:
    free(limits);
    free(rank);
    return rc;
}

static int allocate_mpc_law(struct apc_law_mpc *p, struct apc_error *why)
{
    const size_t ny = p->dim.ny, nu = p->dim.nu, n = nu * p->blocks, inputs = nu + p->disturbed->nd;
    const size_t nonlinear = p->nonlinear ? 1 : 0, nx = p->nonlinear ? p->model->nx_plant : 0;
    const size_t seen =
        p->states + ny + p->n_ahead * (p->dim.nz + p->dim.nd) + 3 * nu + ny * N_OF_Y + nu * N_OF_U;
    const struct apc_part parts[] = {APC_PART(p->usable, ny),
                                     APC_PART(p->given, nu),
                                     APC_PART(p->limiting, ny + nu),
                                     APC_PART_COPY(p->input, inputs, p->disturbed->u0),
                                     APC_PART(p->x, p->states),
                                     APC_PART(p->plan, n),
                                     APC_PART(p->seen, seen),
                                     APC_PART(p->now, seen),
                                     APC_PART(p->w, (p->N + 1) * ny),
                                     APC_PART(p->d, (p->N + 1) * p->dim.nd),
                                     APC_PART(p->u_last, nu),
                                     APC_PART(p->reference, nu),
                                     APC_PART(p->cost, nu),
                                     APC_PART(p->low, nu),
                                     APC_PART(p->high, nu),
                                     APC_PART(p->step, nu),
                                     APC_PART(p->s, nu),
                                     APC_PART(p->r, nu),
                                     APC_PART(p->q, ny),
                                     APC_PART(p->zone, ny),
                                     APC_PART(p->y_low, ny),
                                     APC_PART(p->y_high, ny),
                                     APC_PART(p->price, ny),
                                     APC_PART(p->tuned, ny * 3 + nu * 2),
                                     APC_PART(p->prediction, p->N * ny),
                                     APC_PART(p->multiplier, 4 * nu + 2 * ny),
                                     APC_PART(p->shifted, n),
                                     APC_PART(p->past, (p->late_most + 1) * nu),
                                     APC_PART(p->start, nonlinear * nx),
                                     APC_PART(p->nodes, nonlinear * p->N * nx),
                                     APC_PART(p->G, nonlinear * p->N * ny * n),
                                     APC_PART(p->free_y, nonlinear * p->N * ny),
                                     APC_PART(p->worth, nonlinear * p->N * ny),
                                     APC_PART(p->curve, nonlinear * n * n),
                                     APC_PART(p->bend, nonlinear * nu),
                                     APC_PART(p->Gx, nonlinear * p->nc * n),
                                     APC_PART(p->free_x, nonlinear * p->nc)};

    p->n_seen = seen;
    p->memory = apc_parts_allocate(parts, sizeof(parts) / sizeof(*parts));
    return p->memory ? 0 : apc_fail(why, APC_ENOMEM, "no memory");
}

static int take_settings(struct apc_law_mpc *p, const struct apc_law_setup *setup, bool *terminal,
                         bool *steady, bool *preview, struct apc_error *why)
{
    int rc = apc_mpc_count(setup, "horizon", 1, HORIZON_MAX, &p->N, why);

    if (rc == 0)
        rc = take_blocks(p, setup, why);
    for (size_t i = 0; i < p->dim.nz && rc == 0; i++) {
        size_t number = i + 1;

        rc = apc_setting_index(setup, "measurement", p->dim.nz, i, 1, p->dim.ny, &number, why);
        p->cv[i] = number - 1;
        for (size_t k = 0; k < i && rc == 0; k++) {
            if (p->cv[k] == p->cv[i])
                rc = apc_fail(why, APC_EINVAL,
                              "setting \"measurement\": setpoints %zu and %zu are both for measurement %zu: "
                              "expected another one for each setpoint",
                              k + 1, i + 1, number);
        }
    }
    if (rc == 0)
        rc = take_mpc_signals(p, setup, why);
    if (rc == 0)
        rc = apc_mpc_count(setup, "iterations", 1, 1000000, &p->iterations, why);
    if (rc == 0)
        rc = flag(setup, "terminal", terminal, why);
    if (rc == 0)
        rc = flag(setup, "steady", steady, why);
    return rc == 0 ? flag(setup, "setpoint_preview", preview, why) : rc;
}

static int make_mpc_law(struct apc_law_mpc *p, const struct apc_law_setup *setup, struct apc_law_needs *needs,
                        struct apc_error *why)
{
    const size_t ny = p->dim.ny;
    bool terminal = !p->nonlinear, steady = !p->nonlinear, preview = true;
    int rc;

    if (!setup->plant)
        return apc_fail(why, APC_EINVAL,
                        "the plant's linear model is not known; give group plant a model, and the controller "
                        "an operating_point, or a file with a model");
    p->cv = calloc(p->dim.nz + 1, sizeof(*p->cv));
    p->dev_y = calloc(3 * ny + p->dim.nu, sizeof(*p->dev_y));
    p->critical = calloc(2 * ny, sizeof(*p->critical));
    if (!p->cv || !p->dev_y || !p->critical)
        return apc_fail(why, APC_ENOMEM, "no memory");
    p->economic = p->critical + ny;
    p->hold = p->dev_y + ny;
    p->least = p->hold + ny;
    p->dev_u = p->least + ny;
    p->N = 20;
    rc = take_settings(p, setup, &terminal, &steady, &preview, why);
    if (rc == 0 && p->nonlinear && steady)
        rc = apc_fail(why, APC_EINVAL,
                      "setting \"steady\": an extended filter has no gain that stays; leave it out, or take "
                      "law mpc, whose linear model has one");
    if (rc == 0)
        rc = p->nonlinear ? apc_nmpc_take_model(p, setup, why) : take_mpc_model(p, setup, why);
    if (rc == 0)
        rc = apc_initial_state_create(&p->rest, p->disturbed, why);
    if (rc == 0)
        rc = make_problem(p, setup, terminal, why);
    if (rc == 0 && !p->nonlinear)
        rc = make_estimator(p, setup, steady, why);
    if (rc < 0)
        return rc;
    p->n_estimate = apc_estimator_size(p->estimator);
    p->n_rows = apc_mpc_rows(p->mpc);
    p->states = p->n_estimate + p->dim.nu * p->blocks + 1 + p->n_rows + ny + ny + p->dim.nu;
    if (p->nonlinear)
        p->states += p->N * p->model->nx_plant + p->nc + (1 + p->late_most) * p->dim.nu;
    p->n_ahead = preview ? p->N + 1 : 1;
    needs->states = p->states;
    needs->n_ahead = p->n_ahead;
    rc = allocate_mpc_law(p, why);
    return rc == 0 ? apc_mpc_declare(p, setup, needs, why) : rc;
}

static int make_named(const char *name, bool nonlinear, const struct apc_law_setup *setup,
                      struct apc_law_needs *needs, void **self, struct apc_error *why)
{
    struct apc_law_mpc *p = calloc(1, sizeof(*p));
    struct apc_error reason = {""};
    int rc;

    *self = p;
    if (!p)
        return apc_fail(why, APC_ENOMEM, "law %s: no memory", name);
    p->nonlinear = nonlinear;
    p->dim = setup->dim;
    p->Ts = setup->Ts;
    rc = make_mpc_law(p, setup, needs, &reason);
    return rc < 0 ? apc_fail(why, rc, "law %s: %s", name, reason.text) : 0;
}

int apc_mpc_make(const struct apc_law_setup *setup, struct apc_law_needs *needs, void **self,
                 struct apc_error *why)
{
    return make_named("mpc", false, setup, needs, self, why);
}

int apc_nmpc_make(const struct apc_law_setup *setup, struct apc_law_needs *needs, void **self,
                  struct apc_error *why)
{
    return make_named("nmpc", true, setup, needs, self, why);
}

void apc_mpc_unmake(void *self)
{
    struct apc_law_mpc *p = self;

    apc_mpc_destroy(p->mpc);
    apc_shooting_destroy(p->shoot);
    apc_nested_destroy(p->nested);
    for (size_t k = 0; k + 1 < p->parts; k++)
        apc_estimator_destroy(p->part[k]);
    free(p->part);
    free(p->whole);
    free(p->bit);
    apc_initial_state_destroy(p->rest);
    apc_estimator_destroy(p->estimator);
    if (p->model != p->disturbed)
        apc_linear_destroy(p->model);
    apc_linear_destroy(p->disturbed);
    free(p->published);
    free(p->name);
    free(p->unknown);
    free(p->measured);
    free(p->memory);
    free(p->critical);
    free(p->dev_y);
    free(p->cv);
    free(p->block);
    free(p);
}

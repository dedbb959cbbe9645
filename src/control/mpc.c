/* SPDX-License-Identifier: BSD-3-Clause */
/*
 * Linear predictive control of all outputs together: an estimator, steady-state targets, and the plan of
 * src/predict/mpc.c, of which the first move goes out. docs/laws.md has every option.
 *
 * At tick k the estimate is corrected with y_k, the plan begins with u_k. update tells the estimator what
 * really went out, whoever decided on it, so nothing winds up and no change of mode makes a bump: an output
 * that is given is a known input, and the cost of moves counts from what acted last.
 */
#include "control/mpc.h"
#include "plant/plant_internal.h"

#include <math.h>
#include <stdio.h>
#include <string.h>

#include "base/base_internal.h"

static const struct apc_param tuning[N_OF_U + N_OF_Y] = {
    {"move_suppression", "1", "move suppression: weight of moves, over the output's scaling", 0.1, 1e-6, 1e6},
    {"reference_weight", "1", "input reference weight, over the output's scaling", 0.0, 0.0, 1e6},
    {"reference", "u", "input reference: where the output is to be, as far as setpoints leave it free", 0.0,
     -APC_VALUE_MAX, APC_VALUE_MAX},
    {"cost", "1/u", "cost of a steady output, per unit: the law looks for the cheapest", 0.0, -1e12, 1e12},
    {"u_min", "u", "output low limit", -NO_LIMIT, -NO_LIMIT, NO_LIMIT},
    {"u_max", "u", "output high limit", NO_LIMIT, -NO_LIMIT, NO_LIMIT},
    {"du_max", "u/s", "fastest change of the output; 0: any", 0.0, 0.0, NO_LIMIT},
    {"weight", "1", "of the distance from the setpoint, over the measurement's scaling", 1.0, 0.0, 1e6},
    {"zone", "y", "half the width of a range around the setpoint within which nothing needs to be done", 0.0,
     0.0, APC_VALUE_MAX},
    {"y_min", "y", "least measurement, as long as there is a way", -NO_LIMIT, -NO_LIMIT, NO_LIMIT},
    {"y_max", "y", "greatest measurement, as long as there is a way", NO_LIMIT, -NO_LIMIT, NO_LIMIT},
    {"service", "1", "1: the measurement is controlled; 0: it is only estimated with", 1.0, 0.0, 1.0},
};
static const enum apc_law_scope scope[N_OF_U + N_OF_Y] = {
    APC_OF_OUTPUT,      APC_OF_OUTPUT,      APC_OF_OUTPUT,      APC_OF_OUTPUT,
    APC_OF_OUTPUT,      APC_OF_OUTPUT,      APC_OF_OUTPUT,      APC_OF_MEASUREMENT,
    APC_OF_MEASUREMENT, APC_OF_MEASUREMENT, APC_OF_MEASUREMENT, APC_OF_MEASUREMENT};

static double of_u(const struct apc_law_call *c, size_t j, size_t parameter)
{
    return c->tuning[j * N_OF_U + parameter];
}

static double of_y(const struct apc_law_call *c, size_t i, size_t parameter)
{
    return c->tuning[c->dim.nu * N_OF_U + i * N_OF_Y + parameter];
}

bool apc_mpc_late(void *mpc)
{
    const struct apc_law_mpc *p = mpc;

    return p->call && apc_law_left(p->call) <= 0.0;
}

/* ---- Taking in -------------------------------------------------------------------------------------- */

static double last_mpc_output(const struct apc_law_mpc *p, const struct apc_law_call *c, size_t j)
{
    return apc_value_ok(c->u_last[j]) ? c->u_last[j] : fmin(fmax(p->model->u0[j], c->low[j]), c->high[j]);
}

static bool is_bad_measurement(const struct apc_law_call *c, size_t i)
{
    return apc_status_severity(c->y_status[i]) == APC_SEVERITY_BAD;
}

/* Bad for so long that nobody vouches for its estimate any more. */
static bool is_lost(const struct apc_law_mpc *p, size_t i)
{
    return apc_mpc_absent_of(p, p->x)[i] * p->Ts > p->hold[i];
}

static bool is_served(const struct apc_law_mpc *p, const struct apc_law_call *c, size_t i)
{
    return of_y(c, i, SERVICE) >= 0.5 && !is_lost(p, i);
}

/* All that a plan follows from, so that the same question is not answered twice. What only compute is told
 * comes last: update goes with the plan that went out. */
static void gather_plan_inputs(const struct apc_law_mpc *p, const struct apc_law_call *c, double *at)
{
    memcpy(at, c->x, p->states * sizeof(*at));
    at += p->states;
    for (size_t i = 0; i < p->dim.ny; i++)
        *at++ = p->usable[i] ? c->y[i] : is_bad_measurement(c, i) ? -HUGE_VAL : HUGE_VAL;
    memcpy(at, c->z, p->n_ahead * p->dim.nz * sizeof(*at));
    at += p->n_ahead * p->dim.nz;
    if (p->dim.nd)
        memcpy(at, c->d, p->n_ahead * p->dim.nd * sizeof(*at));
    at += p->n_ahead * p->dim.nd;
    for (size_t j = 0; j < p->dim.nu; j++)
        *at++ = last_mpc_output(p, c, j);
    memcpy(at, c->tuning, (p->dim.nu * N_OF_U + p->dim.ny * N_OF_Y) * sizeof(*at));
    at += p->dim.nu * N_OF_U + p->dim.ny * N_OF_Y;
    for (size_t j = 0; j < p->dim.nu; j++) {
        *at++ = c->out[j];
        *at++ = c->limited[j];
    }
}

static void tune_mpc(struct apc_law_mpc *p, const struct apc_law_call *c)
{
    const size_t ny = p->dim.ny, nu = p->dim.nu;
    const struct apc_mpc_weights weights = {
        .q = p->q, .s = p->s, .r = p->r, .zone = p->zone, .least = p->least, .price = p->price};

    memset(p->q, 0, ny * sizeof(*p->q));
    for (size_t k = 0; k < p->dim.nz; k++) {
        const size_t i = p->cv[k];

        if (p->economic[i]) { /* which need not be measured */
            p->price[i] = of_y(c, i, SERVICE) >= 0.5 ? of_y(c, i, WEIGHT) : 0.0;
            continue;
        }
        p->q[i] = is_served(p, c, i) ? of_y(c, i, WEIGHT) / (p->dev_y[i] * p->dev_y[i]) : 0.0;
        p->zone[i] = of_y(c, i, ZONE);
    }
    for (size_t j = 0; j < nu; j++) {
        p->s[j] = of_u(c, j, MOVE) / (p->dev_u[j] * p->dev_u[j]);
        p->r[j] = of_u(c, j, REFERENCE_WEIGHT) / (p->dev_u[j] * p->dev_u[j]);
    }
    if (p->is_tuned && !memcmp(p->tuned, p->q, ny * sizeof(*p->q)) &&
        !memcmp(p->tuned + ny, p->zone, ny * sizeof(*p->q)) &&
        !memcmp(p->tuned + 2 * ny, p->s, nu * sizeof(*p->s)) &&
        !memcmp(p->tuned + 2 * ny + nu, p->r, nu * sizeof(*p->r)) &&
        !memcmp(p->tuned + 2 * ny + 2 * nu, p->price, ny * sizeof(*p->price)))
        return;
    p->is_tuned = apc_mpc_tune(p->mpc, &weights, NULL) == 0;
    memcpy(p->tuned, p->q, ny * sizeof(*p->q));
    memcpy(p->tuned + ny, p->zone, ny * sizeof(*p->q));
    memcpy(p->tuned + 2 * ny, p->s, nu * sizeof(*p->s));
    memcpy(p->tuned + 2 * ny + nu, p->r, nu * sizeof(*p->r));
    memcpy(p->tuned + 2 * ny + 2 * nu, p->price, ny * sizeof(*p->price));
}

/* Rows that the caller has; the last of them goes on. A measurement without a setpoint has weight 0. */
static void preview_setpoints(struct apc_law_mpc *p, const struct apc_law_call *c)
{
    const size_t ny = p->dim.ny, nz = p->dim.nz, nd = p->dim.nd, last_row = p->n_ahead - 1;

    for (size_t k = 0; k < nz; k++) {
        double *w = p->w + p->cv[k];

        for (size_t i = 0; i <= p->N; i++)
            w[i * ny] = c->z[(i < last_row ? i : last_row) * nz + k];
    }
    for (size_t i = 0; i <= p->N && nd; i++)
        memcpy(p->d + i * nd, c->d + (i < last_row ? i : last_row) * nd, nd * sizeof(*p->d));
}

static double clamp_mpc_limit(double value, double low, double high)
{
    return fmin(fmax(value, low), high);
}

/* The output's own limits hold, whatever the tuning says. */
static void bound_manipulated(struct apc_law_mpc *p, const struct apc_law_call *c, size_t j)
{
    const double rate = of_u(c, j, DU_MAX);

    p->low[j] = clamp_mpc_limit(of_u(c, j, U_MIN), c->low[j], c->high[j]);
    p->high[j] = clamp_mpc_limit(of_u(c, j, U_MAX), c->low[j], c->high[j]);
    p->step[j] = p->Ts * (rate > 0.0 ? fmin(rate, c->rate[j]) : c->rate[j]);
    if (c->limited[j] & APC_LIMITED_LOW)
        p->low[j] = fmax(p->low[j], p->u_last[j]);
    if (c->limited[j] & APC_LIMITED_HIGH)
        p->high[j] = fmin(p->high[j], p->u_last[j]);
}

static void bound(struct apc_law_mpc *p, const struct apc_law_call *c)
{
    for (size_t j = 0; j < p->dim.nu; j++) {
        p->u_last[j] = last_mpc_output(p, c, j);
        p->given[j] = c->out[j] != APC_OUT_LAW;
        p->reference[j] = of_u(c, j, REFERENCE_WEIGHT) > 0.0 ? of_u(c, j, REFERENCE) : p->u_last[j];
        p->cost[j] = of_u(c, j, COST);
        bound_manipulated(p, c, j);
    }
    for (size_t i = 0; i < p->dim.ny; i++) {
        const double low = of_y(c, i, Y_MIN), high = of_y(c, i, Y_MAX);
        const bool lost = is_lost(p, i);

        p->y_low[i] = lost ? -HUGE_VAL : low > -NO_LIMIT ? fmax(low, c->y_low[i]) : c->y_low[i];
        p->y_high[i] = lost ? HUGE_VAL : high < NO_LIMIT ? fmin(high, c->y_high[i]) : c->y_high[i];
        p->y_high[i] = fmax(p->y_high[i], p->y_low[i]);
    }
}

/* ---- The plan --------------------------------------------------------------------------------------- */

static void preview_disturbances(struct apc_law_mpc *p, const struct apc_law_call *c)
{
    for (size_t k = 0; k < p->dim.nd; k++)
        p->input[p->dim.nu + (p->measured ? p->measured[k] : k)] = c->d[k];
}

/* What acts now. */
static void take_acting(struct apc_law_mpc *p, const struct apc_law_call *c)
{
    for (size_t j = 0; j < p->dim.nu; j++)
        p->input[j] = p->past[j] = last_mpc_output(p, c, j);
    if (p->nonlinear) {
        memcpy(p->past + p->dim.nu, apc_mpc_past_of(p, p->x), p->late_most * p->dim.nu * sizeof(*p->past));
        apc_nmpc_take_past(p);
    }
}

static void correct(struct apc_law_mpc *p, const struct apc_law_call *c)
{
    memcpy(p->x, c->x, p->states * sizeof(*p->x));
    take_acting(p, c);
    preview_disturbances(p, c);
    for (size_t i = 0; i < p->dim.ny; i++) {
        double *absent = &apc_mpc_absent_of(p, p->x)[i];

        *absent = is_bad_measurement(c, i) ? fmin(*absent + 1.0, 1e15) : 0.0;
    }
    (void)apc_estimator_correct(p->estimator, p->x, c->y, p->usable, p->input);
}

void apc_mpc_shift_plan(struct apc_law_mpc *p, size_t age)
{
    if (age == 0)
        memcpy(p->shifted, apc_mpc_plan_of(p, p->x), p->dim.nu * p->blocks * sizeof(*p->shifted));
    for (size_t b = 0, first = 0; b < p->blocks && age; first += p->block[b++])
        memcpy(p->shifted + b * p->dim.nu, apc_mpc_move(p->mpc, apc_mpc_plan_of(p, p->x), first + age),
               p->dim.nu * sizeof(*p->shifted));
}

/* The working set, without moves that somebody else has, which are no rows to begin with when the law has
 * them again. Also one that was not finished in time: the next tick goes on from there, and not once more
 * from where this one began. */
static void keep_rows(const struct apc_law_mpc *p, const signed char *active)
{
    const size_t n = p->n_rows;
    double *rows = apc_mpc_rows_of(p, p->x);

    for (size_t k = 0; k < n; k++)
        rows[k] = active[k];
    for (size_t j = 0; j < p->dim.nu; j++) {
        for (size_t b = 0; p->given[j] && b < p->blocks; b++)
            rows[b * p->dim.nu + j] = 0.0;
    }
}

/* What the next solution begins with: the rows of the last one, and as equations moves that somebody else
 * has. */
static void take_active_rows(const struct apc_law_mpc *p)
{
    const size_t n = p->n_rows, nu = p->dim.nu; /* here, since a char might be any of them */
    const double *kept = apc_mpc_rows_of(p, p->x);
    signed char *rows = apc_mpc_room(p->mpc);

    for (size_t k = 0; k < n; k++)
        rows[k] = (signed char)kept[k];
    for (size_t j = 0; j < nu; j++) {
        for (size_t b = 0; p->given[j] && b < p->blocks; b++)
            rows[b * nu + j] = 1;
    }
    apc_mpc_start(p->mpc);
}

/* The plan, or that the former one is a sample older. */
static void keep_plan(struct apc_law_mpc *p)
{
    const size_t nu = p->dim.nu, ny = p->dim.ny;
    const signed char *active = apc_mpc_active(p->mpc);

    if (p->result.rc == 0 || p->result.rc == APC_ETIMEDOUT)
        keep_rows(p, active);
    if (p->result.rc == 0) {
        memcpy(apc_mpc_plan_of(p, p->x), p->plan, nu * p->blocks * sizeof(*p->plan));
        apc_mpc_limiting(p->mpc, active, p->limiting, p->limiting + nu);
        for (size_t k = 0; k < nu + ny; k++)
            apc_mpc_limits_of(p, p->x)[k] = p->limiting[k];
        *apc_mpc_age_of(p, p->x) = 1.0;
    } else if (*apc_mpc_age_of(p, p->x) > 0.0) {
        *apc_mpc_age_of(p, p->x) += 1.0;
    }
}

static void make_plan(struct apc_law_mpc *p, const struct apc_law_call *c)
{
    const struct apc_mpc_call call = {.x = p->x,
                                      .w = p->w,
                                      .d = p->dim.nd ? p->d : NULL,
                                      .u_last = p->u_last,
                                      .u_reference = p->reference,
                                      .u_cost = p->cost,
                                      .low = p->low,
                                      .high = p->high,
                                      .step = p->step,
                                      .y_low = p->y_low,
                                      .y_high = p->y_high,
                                      .given = p->given};

    take_active_rows(p);
    p->call = c;
    if (p->shoot)
        apc_nmpc_solve(p, &call);
    else
        apc_mpc_solve(p->mpc, &call, p->plan, &p->result);
    p->call = NULL;
    keep_plan(p);
}

static void think(struct apc_law_mpc *p, const struct apc_law_call *c, size_t n_same)
{
    for (size_t i = 0; i < p->dim.ny; i++)
        p->usable[i] = c->y_new[i] && !is_bad_measurement(c, i);
    gather_plan_inputs(p, c, p->now);
    if (p->is_seen && !memcmp(p->now, p->seen, n_same * sizeof(*p->now)))
        return;
    double *before = p->seen;

    p->seen = p->now;
    p->now = before;
    p->is_seen = true;
    apc_reduced_until(c->deadline);
    correct(p, c);
    tune_mpc(p, c);
    preview_setpoints(p, c);
    bound(p, c);
    make_plan(p, c);
}

/* ---- What goes out ---------------------------------------------------------------------------------- */

/* The measurement that it must not go on without; ny: there is none. */
static size_t missing(const struct apc_law_mpc *p)
{
    size_t i = 0;

    while (i < p->dim.ny && !(p->critical[i] && is_lost(p, i)))
        i++;
    return i;
}

/* Limits that hold whatever happens do not contradict each other: where a program finds that they do, it is
 * by numbers so far apart that nothing is left of the smaller ones. */
static const char *reason_of_no_plan(const struct apc_law_mpc *p)
{
    return p->result.rc == APC_ERANGE || (p->result.rc == APC_ESOLVER && !p->nonlinear)
               ? "the estimate is too far away to be calculated with"
           : p->shoot && *apc_shooting_error(p->shoot) ? apc_shooting_error(p->shoot)
                                                       : apc_err_text(p->result.rc);
}

static int verdict(const struct apc_law_mpc *p, const struct apc_law_call *c)
{
    if (p->result.rc == APC_ETIMEDOUT) {
        snprintf(c->why, APC_LAW_WHY, "no plan in time, after %u changes: the former one continues",
                 p->result.iterations);
        return APC_LAW_LATE;
    }
    if (p->result.rc < 0) {
        snprintf(c->why, APC_LAW_WHY, "no plan: %s", reason_of_no_plan(p));
        return APC_LAW_INFEASIBLE;
    }
    if (p->result.given_up) {
        snprintf(c->why, APC_LAW_WHY, "limits of measurements of rank %u cannot be kept", p->result.given_up);
        return APC_LAW_SUBOPTIMAL;
    }
    if (p->result.waits) {
        snprintf(c->why, APC_LAW_WHY,
                 "limits of measurements leave no room that can be calculated with: setpoints wait");
        return APC_LAW_SUBOPTIMAL;
    }
    if (!p->result.reachable) {
        snprintf(c->why, APC_LAW_WHY,
                 "no steady state within the limits has these setpoints: goes to the nearest");
        return APC_LAW_SUBOPTIMAL;
    }
    return APC_LAW_GOOD;
}

static int mpc_compute(struct apc_law_call *c)
{
    struct apc_law_mpc *p = c->self;
    const double *move, left = apc_law_left(c);
    size_t age, gone;
    int result;

    think(p, c, p->n_seen);
    p->took = left - apc_law_left(c);
    gone = missing(p);
    if (gone < p->dim.ny) {
        snprintf(c->why, APC_LAW_WHY, "measurement %zu is critical and has been Bad for %g s", gone + 1,
                 apc_mpc_absent_of(p, p->x)[gone] * p->Ts);
        return APC_LAW_INFEASIBLE;
    }
    if (!p->is_tuned) {
        snprintf(c->why, APC_LAW_WHY,
                 "weights leave a combination of moves free: give each output a move weight");
        return APC_LAW_INFEASIBLE;
    }
    age = (size_t)*apc_mpc_age_of(p, p->x);
    if (age == 0) {
        if (p->result.rc < 0 && p->result.rc != APC_ETIMEDOUT)
            return verdict(p, c);
        snprintf(c->why, APC_LAW_WHY, "no plan yet");
        return APC_LAW_INFEASIBLE;
    }
    move = apc_mpc_move(p->mpc, apc_mpc_plan_of(p, p->x), age - 1);
    for (size_t j = 0; j < p->dim.nu; j++) {
        const double least = fmax(p->low[j], p->u_last[j] - p->step[j]),
                     most = fmin(p->high[j], p->u_last[j] + p->step[j]);

        c->u[j] = clamp_mpc_limit(move[j], fmin(least, most), fmax(least, most));
        c->limited[j] |= (c->u[j] <= least ? (unsigned)APC_LIMITED_LOW : 0u) |
                         (c->u[j] >= most ? (unsigned)APC_LIMITED_HIGH : 0u);
    }
    result = verdict(p, c);
    apc_mpc_publish(p, c, result);
    return result;
}

static void mpc_update(struct apc_law_call *c)
{
    struct apc_law_mpc *p = c->self;

    think(p, c, p->n_seen - 2 * p->dim.nu);
    memcpy(c->x, p->x, p->states * sizeof(*c->x));
    if (p->nonlinear) {
        apc_reduced_until(c->deadline ? apc_clock_mono(NULL) + (apc_ns)(c->budget * 1e9) : 0);
        apc_nmpc_predict(p, c->x, c->u);
    } else {
        memcpy(p->input, c->u, p->dim.nu * sizeof(*p->input));
        (void)apc_estimator_predict(p->estimator, c->x, p->input);
    }
}

/* ---- Beginning -------------------------------------------------------------------------------------- */

/* The steady state that y and u would be of. */
static void mpc_settle(struct apc_law_call *c, const double *u)
{
    struct apc_law_mpc *p = c->self;

    memset(c->x, 0, p->states * sizeof(*c->x));
    memcpy(p->input, u, p->dim.nu * sizeof(*u));
    preview_disturbances(p, c);
    apc_initial_state_find(p->rest, c->y, p->input, p->x);
    apc_estimator_reset(p->estimator, c->x, p->x);
    for (size_t k = 0; k < p->late_most * p->dim.nu; k++)
        apc_mpc_past_of(p, c->x)[k] = u[k % p->dim.nu];
}

static void mpc_reset(struct apc_law_call *c)
{
    struct apc_law_mpc *p = c->self;

    for (size_t j = 0; j < p->dim.nu; j++)
        p->u_last[j] = last_mpc_output(p, c, j);
    mpc_settle(c, p->u_last);
}

static void mpc_track(struct apc_law_call *c)
{
    if (c->gap)
        mpc_settle(c, c->u);
}

static int mpc_ports(const struct apc_law_setup *setup, size_t output, struct apc_law_ports *to,
                     struct apc_error *why)
{
    const size_t setpoint = output < setup->dim.nz ? output : 0;
    size_t number = setpoint + 1, economic = 0;

    if (setup->dim.nz == 0)
        return 0;
    if (apc_setting_index(setup, "measurement", setup->dim.nz, setpoint, 1, setup->dim.ny, &number, why) <
            0 ||
        apc_setting_index(setup, "economic", setup->dim.ny, number - 1, 0, 1, &economic, why) < 0)
        return APC_EINVAL;
    to->nz = 1;
    to->z[0] = (int)setpoint;
    to->ny = !economic; /* what is not brought to its price */
    to->y[0] = (int)number - 1;
    return 0;
}

/* Limits that the operator writes do not cross. */
static int mpc_check_tuning(const struct apc_law_setup *setup, const double *wanted, struct apc_error *why)
{
    for (size_t j = 0; j < setup->dim.nu; j++) {
        const double *at = wanted + j * N_OF_U;

        if (at[U_MIN] > at[U_MAX])
            return apc_fail(why, APC_ERANGE, "output %zu: u_min = %.15g is above u_max = %.15g", j + 1,
                            at[U_MIN], at[U_MAX]);
    }
    for (size_t i = 0; i < setup->dim.ny; i++) {
        const double *at = wanted + setup->dim.nu * N_OF_U + i * N_OF_Y;

        if (at[Y_MIN] > at[Y_MAX])
            return apc_fail(why, APC_ERANGE, "measurement %zu: y_min = %.15g is above y_max = %.15g", i + 1,
                            at[Y_MIN], at[Y_MAX]);
    }
    return 0;
}

static bool mpc_accepts(const struct apc_dim *dim)
{
    return dim->nz >= 1 && dim->nz <= dim->ny;
}

/* What both laws have. */
#define PREDICTIVE_LAW                                                                                       \
    .abi = APC_LAW_ABI, .whole = true, .estimates = true, .n_tuning = N_OF_U + N_OF_Y, .tuning = tuning,     \
    .scope = scope, .accepts = mpc_accepts, .reset = mpc_reset, .compute = mpc_compute,                      \
    .update = mpc_update, .track = mpc_track, .ports = mpc_ports, .destroy = apc_mpc_unmake,                 \
    .check = mpc_check_tuning

const struct apc_law apc_law_mpc = {
    PREDICTIVE_LAW,
    .version = 3,
    .name = "mpc",
    .description = "linear predictive control of all outputs together, with limits, ranges and ranks",
    .settings = apc_mpc_settings,
    .create = apc_mpc_make,
};

const struct apc_law apc_law_nmpc = {
    PREDICTIVE_LAW,
    .version = 2,
    .name = "nmpc",
    .description = "nonlinear predictive control: as mpc, with the plant's own equations",
    .settings = apc_nmpc_settings,
    .create = apc_nmpc_make,
};

/* SPDX-License-Identifier: BSD-3-Clause */
/* What predictive control is made from: settings, a model, unknown disturbances. */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "base/base_internal.h"
#include "control/mpc.h"

#define HORIZON_MAX 1000
#define BLOCKS      6 /* where settings do not say: each twice as long as the one before */

const char *const apc_mpc_settings[] = {"horizon", "blocks",   "measurement", "rank",       "terminal",
                                        "preview", "steady",   "delay",       "x_noise",    "d_noise",
                                        "y_noise", "at_input", "at_output",   "iterations", NULL};

static int count(const struct apc_law_setup *setup, const char *name, size_t least, size_t most, size_t *to,
                 struct apc_error *why)
{
    return apc_setting_index(setup, name, 1, 0, least, most, to, why);
}

static int flag(const struct apc_law_setup *setup, const char *name, bool *to, struct apc_error *why)
{
    size_t value = *to;
    int rc = count(setup, name, 0, 1, &value, why);

    *to = value != 0;
    return rc;
}

/* ---- Blocks ---------------------------------------------------------------------------------------- */

static int take_blocks(struct apc_law_mpc *p, const struct apc_law_setup *setup, struct apc_error *why)
{
    const struct apc_setting *s = apc_setting_find(setup, "blocks");
    size_t n = s ? s->rows * s->columns : BLOCKS;

    if (s && (s->text || n == 0 || n > p->N))
        return apc_fail(why, APC_EINVAL,
                        "setting \"blocks\": the lengths of 1 to %zu blocks in samples, as [1, 1, 2, 4]",
                        p->N);
    p->block = calloc(n, sizeof(*p->block));
    if (!p->block)
        return apc_fail(why, APC_ENOMEM, "mpc: no memory");
    for (size_t b = 0, begin = 0; b < n && begin < p->N; b++) {
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

static int sample(const struct apc_law_setup *setup, struct apc_linear **model, struct apc_error *why)
{
    const struct apc_law_plant *plant = setup->plant;
    const size_t inputs = setup->dim.nu + setup->dim.nd;
    struct apc_linear_continuous from = {.size = sizeof(from),
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
                                         .y0 = plant->y0};
    double *delay = calloc(inputs, sizeof(*delay));
    int rc = delay ? apc_setting_amounts(setup, "delay", setup->dim.nu, delay, why)
                   : apc_fail(why, APC_ENOMEM, "mpc: no memory");

    from.dead_time = delay;
    if (rc == 0)
        rc = apc_linear_from_continuous(model, &from, setup->Ts, why);
    free(delay);
    return rc;
}

static int take_unknown(const struct apc_law_setup *setup, const char *name, enum apc_linear_where where,
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
                          struct apc_linear_unknown *unknown, struct apc_error *why)
{
    const size_t n = p->dim.nz;

    for (size_t i = 0; i < n; i++)
        unknown[i] = (struct apc_linear_unknown){.where = APC_AT_INPUT, .number = i};
    if (n <= p->dim.nu && apc_linear_disturb(&p->model, from, unknown, n, why) == 0)
        return 0;
    for (size_t i = 0; i < n; i++)
        unknown[i] = (struct apc_linear_unknown){.where = APC_AT_OUTPUT, .number = p->cv[i]};
    return apc_linear_disturb(&p->model, from, unknown, n, why);
}

static int take_model(struct apc_law_mpc *p, const struct apc_law_setup *setup, struct apc_error *why)
{
    struct apc_linear_unknown *unknown = calloc(p->dim.ny, sizeof(*unknown));
    struct apc_linear *from = NULL;
    size_t n = 0;
    int rc = unknown ? sample(setup, &from, why) : apc_fail(why, APC_ENOMEM, "mpc: no memory");

    if (rc == 0)
        rc = take_unknown(setup, "at_input", APC_AT_INPUT, setup->dim.nu, unknown, &n, why);
    if (rc == 0)
        rc = take_unknown(setup, "at_output", APC_AT_OUTPUT, setup->dim.ny, unknown, &n, why);
    if (rc == 0)
        rc = n ? apc_linear_disturb(&p->model, from, unknown, n, why) : choose_unknown(p, from, unknown, why);
    if (rc == 0)
        p->n_unknown = p->model->nx - from->nx;
    apc_linear_destroy(from);
    free(unknown);
    return rc;
}

/* ---- The estimator --------------------------------------------------------------------------------- */

/* Standard deviations: of what each state, each unknown disturbance gains in 1 s; of the measurements. */
static int make_estimator(struct apc_law_mpc *p, const struct apc_law_setup *setup, bool steady,
                          struct apc_error *why)
{
    const struct apc_linear *m = p->model;
    const size_t nc = m->nx - p->n_unknown, n_unknown = p->n_unknown;
    double *q = calloc(m->nx + p->dim.ny, sizeof(*q)), *r;
    int rc;

    if (!q)
        return apc_fail(why, APC_ENOMEM, "mpc: no memory");
    r = q + m->nx;
    for (size_t i = 0; i < n_unknown; i++)
        q[nc + i] = 1.0;
    for (size_t i = 0; i < p->dim.ny; i++)
        r[i] = 1.0;
    rc = apc_setting_amounts(setup, "x_noise", m->nx_plant, q, why);
    if (rc == 0)
        rc = apc_setting_amounts(setup, "d_noise", n_unknown, q + nc, why);
    if (rc == 0)
        rc = apc_setting_amounts(setup, "y_noise", p->dim.ny, r, why);
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
    }
    free(q);
    return rc;
}

/* ---- What it publishes ------------------------------------------------------------------------------ */

/* Number k: of signal i, or of none. */
static void declare(struct apc_law_mpc *p, size_t k, const struct apc_signal_view *signal, char letter,
                    size_t i, const char *suffix, const char *description, size_t length)
{
    struct apc_law_mpc_name *name = &p->name[k];
    const char *unit = signal && signal[i].unit ? signal[i].unit : "";

    if (signal && signal[i].name)
        snprintf(name->name, sizeof(name->name), "%s.%s", signal[i].name, suffix);
    else
        snprintf(name->name, sizeof(name->name), "%c%zu.%s", letter, i + 1, suffix);
    snprintf(name->unit, sizeof(name->unit), "%s", *unit ? unit : "1");
    p->published[k] = (struct apc_published){.name = name->name,
                                             .unit = name->unit,
                                             .description = description,
                                             .length = length,
                                             .step = length ? p->Ts : 0.0};
}

/* In the order in which apc_law_mpc.compute fills them in. */
static int publish(struct apc_law_mpc *p, const struct apc_law_setup *setup, struct apc_law_needs *needs,
                   struct apc_error *why)
{
    const size_t ny = p->dim.ny, nu = p->dim.nu, n_unknown = p->n_unknown,
                 n = 2 * ny + 2 * nu + n_unknown + 1;
    size_t k = 0;

    p->published = calloc(n, sizeof(*p->published));
    p->name = calloc(n, sizeof(*p->name));
    if (!p->published || !p->name)
        return apc_fail(why, APC_ENOMEM, "mpc: no memory");
    for (size_t i = 0; i < ny; i++)
        declare(p, k++, setup->y, 'y', i, "prediction", "predicted from the next sample on", p->N);
    for (size_t j = 0; j < nu; j++)
        declare(p, k++, setup->u, 'u', j, "plan", "moves from now on", p->N);
    for (size_t i = 0; i < ny; i++)
        declare(p, k++, setup->y, 'y', i, "target", "steady state aimed at", 0);
    for (size_t j = 0; j < nu; j++)
        declare(p, k++, setup->u, 'u', j, "target", "steady state aimed at", 0);
    for (size_t i = 0; i < n_unknown; i++)
        declare(p, k++, NULL, 'd', i, "estimate", "unknown disturbance, in the unit of where it comes in", 0);
    p->published[k] = (struct apc_published){
        .name = "iterations", .unit = "1", .description = "changes of the working set at this tick"};
    needs->n_published = n;
    needs->published = p->published;
    return 0;
}

/* ---- All of it -------------------------------------------------------------------------------------- */

static bool limited(double low, double high)
{
    return low > -HUGE_VAL || high < HUGE_VAL;
}

/* What a weight of 1 stands for: the signal's span. */
static double span(const struct apc_signal_view *signal, size_t i)
{
    double width = signal ? signal[i].high - signal[i].low : 1.0;

    return width > 0.0 && width < APC_VALUE_MAX ? width : 1.0;
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
                                      .enough = apc_mpc_late,
                                      .ctx = p};
    int rc = rank && limits ? 0 : apc_fail(why, APC_ENOMEM, "mpc: no memory");

    if (rc < 0)
        goto out;
    zone = limits + ny;
    rate = zone + ny;
    for (size_t c = 0; c < ny && rc == 0; c++) {
        size_t of = 1;

        rc = apc_setting_index(setup, "rank", ny, c, 1, ny, &of, why);
        rank[c] = (unsigned)of;
        limits[c] = setup->y && limited(setup->y[c].soft_low, setup->y[c].soft_high);
        p->span_y[c] = span(setup->y, c);
    }
    for (size_t i = 0; i < p->dim.nz; i++)
        zone[p->cv[i]] = true;
    for (size_t j = 0; j < nu; j++) {
        rate[j] = setup->u && setup->u[j].rate < HUGE_VAL;
        p->span_u[j] = span(setup->u, j);
    }
    options.limits = limits;
    options.zone = zone;
    options.rate = rate;
    if (rc == 0)
        rc = apc_mpc_create(&p->mpc, &options, why);
out:
    free(limits);
    free(rank);
    return rc;
}

static int allocate(struct apc_law_mpc *p, struct apc_error *why)
{
    const size_t ny = p->dim.ny, nu = p->dim.nu, n = nu * p->blocks;
    const size_t seen =
        p->states + ny + p->n_ahead * (p->dim.nz + p->dim.nd) + 3 * nu + ny * N_OF_Y + nu * N_OF_U;
    double *at = calloc(
        p->states + n + 3 * seen + (p->N + 1) * (ny + p->dim.nd) + 10 * nu + 6 * ny + p->N * ny, sizeof(*at));

    p->memory = at;
    p->usable = calloc(ny + nu, sizeof(*p->usable));
    if (!at || !p->usable)
        return apc_fail(why, APC_ENOMEM, "mpc: no memory");
    p->given = p->usable + ny;
#define CARVE(member, size) (p->member = at, at += (size))
    CARVE(x, p->states);
    CARVE(plan, n);
    CARVE(seen, seen);
    CARVE(now, seen);
    p->n_seen = seen;
    CARVE(w, (p->N + 1) * ny);
    CARVE(d, (p->N + 1) * p->dim.nd);
    CARVE(u_last, nu);
    CARVE(wish, nu);
    CARVE(cost, nu);
    CARVE(low, nu);
    CARVE(high, nu);
    CARVE(step, nu);
    CARVE(s, nu);
    CARVE(r, nu);
    CARVE(q, ny);
    CARVE(zone, ny);
    CARVE(tuned, ny * 3 + nu * 2);
    CARVE(input, nu + p->dim.nd);
    CARVE(prediction, p->N * ny);
#undef CARVE
    return 0;
}

int apc_mpc_make(const struct apc_law_setup *setup, struct apc_law_needs *needs, void **self,
                 struct apc_error *why)
{
    struct apc_law_mpc *p = calloc(1, sizeof(*p));
    bool terminal = true, steady = true, preview = true;
    int rc;

    *self = p;
    if (!p)
        return apc_fail(why, APC_ENOMEM, "mpc: no memory");
    p->dim = setup->dim;
    p->Ts = setup->Ts;
    if (!setup->plant)
        return apc_fail(why, APC_EINVAL,
                        "mpc: the plant's linear model is not known; give group plant a model and a steady "
                        "operating point");
    p->cv = calloc(p->dim.nz, sizeof(*p->cv));
    p->span_y = calloc(p->dim.ny + p->dim.nu, sizeof(*p->span_y));
    if (!p->cv || !p->span_y)
        return apc_fail(why, APC_ENOMEM, "mpc: no memory");
    p->span_u = p->span_y + p->dim.ny;
    p->N = 20;
    rc = count(setup, "horizon", 1, HORIZON_MAX, &p->N, why);
    if (rc == 0)
        rc = take_blocks(p, setup, why);
    for (size_t i = 0; i < p->dim.nz && rc == 0; i++) {
        size_t number = i + 1;

        rc = apc_setting_index(setup, "measurement", p->dim.nz, i, 1, p->dim.ny, &number, why);
        p->cv[i] = number - 1;
    }
    if (rc == 0)
        rc = count(setup, "iterations", 1, 1000000, &p->iterations, why);
    if (rc == 0)
        rc = flag(setup, "terminal", &terminal, why);
    if (rc == 0)
        rc = flag(setup, "steady", &steady, why);
    if (rc == 0)
        rc = flag(setup, "preview", &preview, why);
    if (rc == 0)
        rc = take_model(p, setup, why);
    if (rc == 0)
        rc = make_estimator(p, setup, steady, why);
    if (rc == 0)
        rc = make_problem(p, setup, terminal, why);
    if (rc < 0)
        return rc;
    p->n_estimate = apc_estimator_size(p->estimator);
    p->n_rows = apc_mpc_rows(p->mpc);
    p->states = p->n_estimate + p->dim.nu * p->blocks + 1 + p->n_rows;
    p->n_ahead = preview ? p->N + 1 : 1;
    needs->states = p->states;
    needs->n_ahead = p->n_ahead;
    rc = allocate(p, why);
    return rc == 0 ? publish(p, setup, needs, why) : rc;
}

void apc_mpc_unmake(void *self)
{
    struct apc_law_mpc *p = self;

    apc_mpc_destroy(p->mpc);
    apc_estimator_destroy(p->estimator);
    apc_linear_destroy(p->model);
    free(p->published);
    free(p->name);
    free(p->usable);
    free(p->memory);
    free(p->span_y);
    free(p->cv);
    free(p->block);
    free(p);
}

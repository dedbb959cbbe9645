/* SPDX-License-Identifier: BSD-3-Clause */
/*
 * The PI controller of the paper (section "Real-time simulation experiments"), one for each output:
 *
 *     e_k = zbar_k - y_k,  P_k = Kp e_k,  u_k = ubar + P_k + I_k,  I_{k+1} = I_k + (Kp Ts / tau_i) e_k
 *
 * with what a real actuator needs: u is kept within [u_min, u_max], and I stands still while the output
 * is cut and the increment would drive it further out (conditional integration), so the output
 * leaves its limit at once when the error changes sign.
 *
 * Loop i controls y_i to zbar_i with u_i; its state is I_i.
 */
#include "control/control_internal.h"

enum { KP, TAU_I, U_BAR, U_MIN, U_MAX, N_TUNING };

static const struct apc_param tuning[N_TUNING] = {
    [KP] = {"Kp", "", "proportional gain", 0.2, -1e6, 1e6},
    [TAU_I] = {"tau_i", "s", "integral time", 10.0, 1e-6, 1e9},
    [U_BAR] = {"u_bar", "", "output at the operating point", 0.0, -1e9, 1e9},
    [U_MIN] = {"u_min", "", "least output", -1e9, -1e9, 1e9},
    [U_MAX] = {"u_max", "", "greatest output", 1e9, -1e9, 1e9},
};

/* ubar + P, the output without its integral. Always evaluated in this order: a law that resumes compares
 * bits. */
static double proportional(const struct apc_law_call *c, size_t i)
{
    const double *p = c->tuning + i * N_TUNING;

    return p[U_BAR] + p[KP] * (c->z[i] - c->y[i]);
}

static size_t n_state(const struct apc_dim *dim)
{
    return dim->nu;
}

static bool accepts(const struct apc_dim *dim)
{
    return dim->nz == dim->nu && dim->ny >= dim->nu;
}

static void compute(struct apc_law_call *c)
{
    for (size_t i = 0; i < c->dim.nu; i++) {
        const double *p = c->tuning + i * N_TUNING;

        c->u[i] = apc_law_cut(proportional(c, i) + c->x[i], p[U_MIN], p[U_MAX], &c->limited[i]);
    }
}

/* Compared with what went out, not with u_min and u_max, so that a limit set elsewhere counts as well. */
static void update(struct apc_law_call *c)
{
    for (size_t i = 0; i < c->dim.nu; i++) {
        const double *p = c->tuning + i * N_TUNING;
        double increment = p[KP] * c->Ts / p[TAU_I] * (c->z[i] - c->y[i]);
        double wanted = proportional(c, i) + c->x[i];
        bool further_out = (wanted > c->u[i] && increment > 0.0) || (wanted < c->u[i] && increment < 0.0);

        if (!further_out)
            c->x[i] += increment;
    }
}

static void track(struct apc_law_call *c)
{
    for (size_t i = 0; i < c->dim.nu; i++)
        c->x[i] = c->u[i] - proportional(c, i);
}

static int check_tuning(const struct apc_dim *dim, const double *p, struct apc_error *why)
{
    return apc_law_check_order(&apc_law_pi, dim, p, U_MIN, U_MAX, why);
}

const struct apc_law apc_law_pi = {
    .abi = APC_LAW_ABI,
    .name = "pi",
    .description = "PI controller of the paper, one loop for each output",
    .n_tuning = N_TUNING,
    .tuning = tuning,
    .n_state = n_state,
    .accepts = accepts,
    .compute = compute,
    .update = update,
    .track = track,
    .check = check_tuning,
};

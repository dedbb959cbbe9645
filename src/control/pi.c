/* SPDX-License-Identifier: BSD-3-Clause */
/*
 * The PI controller of the paper (section "Real-time simulation experiments"):
 *
 *     e_k = zbar_k - y_k,  P_k = Kp e_k,  u_k = ubar + P_k + I_k,  I_{k+1} = I_k + (Kp Ts / tau_i) e_k
 *
 * with what a real actuator needs: u is kept within [u_min, u_max], and I stands still while the output
 * is cut and the increment would drive it further out (conditional integration), so the output
 * leaves its limit at once when the error changes sign.
 */
#include "control/control_internal.h"

enum { KP, TAU_I, U_BAR, U_MIN, U_MAX, N_TUNING };

static const struct apc_param tuning[N_TUNING] = {
    [KP] = {"Kp", "", "proportional gain", 0.2, -1e6, 1e6},
    [TAU_I] = {"tau_i", "s", "integral time", 10.0, 1e-6, 1e9},
    [U_BAR] = {"u_bar", "", "output at the operating point", 0.0, -1e9, 1e9},
    [U_MIN] = {"u_min", "", "output low limit", -1e9, -1e9, 1e9},
    [U_MAX] = {"u_max", "", "output high limit", 1e9, -1e9, 1e9},
};

/* ubar + P, the output without its integral. Always evaluated in this order: a law that resumes compares
 * bits. */
static double proportional(const struct apc_law_call *c)
{
    return c->tuning[U_BAR] + c->tuning[KP] * (c->z[0] - c->y[0]);
}

size_t apc_pi_terms(const struct apc_law_call *c, struct apc_law_term *term, size_t most)
{
    const struct apc_law_term terms[] = {{"u_bar", NULL, c->tuning[U_BAR]},
                                         {"P", NULL, c->tuning[KP] * (c->z[0] - c->y[0])},
                                         {"I", NULL, c->x[0]}};
    const size_t n = sizeof(terms) / sizeof(*terms);

    for (size_t k = 0; k < n && k < most; k++)
        term[k] = terms[k];
    return n;
}

static size_t pi_n_state(const struct apc_dim *dim)
{
    (void)dim;
    return 1;
}

static bool pi_accepts(const struct apc_dim *dim)
{
    return dim->nz == dim->nu && dim->ny >= dim->nu;
}

static int pi_compute(struct apc_law_call *c)
{
    c->u[0] = apc_law_cut(proportional(c) + c->x[0], c->tuning[U_MIN], c->tuning[U_MAX], &c->limited[0]);
    return APC_LAW_GOOD;
}

/* Compared with what went out, not with u_min and u_max, so that a limit set elsewhere counts as well. */
static void pi_update(struct apc_law_call *c)
{
    double increment = c->tuning[KP] * c->Ts / c->tuning[TAU_I] * (c->z[0] - c->y[0]);
    double wanted = proportional(c) + c->x[0];
    bool further_out = (wanted > c->u[0] && increment > 0.0) || (wanted < c->u[0] && increment < 0.0);

    if (!further_out && !apc_law_blocks(c->limited[0], increment))
        c->x[0] += increment;
}

static void pi_track(struct apc_law_call *c)
{
    c->x[0] = c->u[0] - proportional(c);
}

static int pi_check_tuning(const struct apc_law_setup *setup, const double *p, struct apc_error *why)
{
    return apc_law_check_order(&apc_law_pi, setup, p, U_MIN, U_MAX, why);
}

const struct apc_law apc_law_pi = {
    .abi = APC_LAW_ABI,
    .name = "pi",
    .description = "PI controller of the paper",
    .n_tuning = N_TUNING,
    .tuning = tuning,
    .n_state = pi_n_state,
    .accepts = pi_accepts,
    .compute = pi_compute,
    .update = pi_update,
    .track = pi_track,
    .check = pi_check_tuning,
};

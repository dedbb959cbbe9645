/* SPDX-License-Identifier: BSD-3-Clause */
/**
 * @file apccontrol.h
 * Control laws behind one interface (section "Control computations" of the paper). A law is a constant
 * struct of plain C functions; one of your own is a shared object that exports it as `apc_law`:
 *
 *     static void compute(struct apc_law_call *c) { c->u[0] = c->tuning[0] * (c->z[0] - c->y[0]); }
 *     static const struct apc_param gain[] = {{"Kp", "1", "gain", 1.0, -100.0, 100.0}};
 *     const struct apc_law apc_law = {.abi = APC_LAW_ABI, .name = "p", .n_tuning = 1, .tuning = gain,
 *                                     .compute = compute};
 */
#ifndef APCCONTROL_H
#define APCCONTROL_H

#include "apcbase.h"

#ifdef __cplusplus
extern "C" {
#endif

/** How many: measurements y, setpoints z-bar, manipulated variables u. */
struct apc_dim {
    size_t ny, nz, nu;
};

/** What one call of a law works on. The arrays belong to the caller. */
struct apc_law_call {
    struct apc_dim dim;
    double Ts;            /**< period of the controller in s */
    const double *y;      /**< [ny] measurements */
    const double *z;      /**< [nz] setpoints */
    const double *tuning; /**< [nu * n_tuning], the parameters of output 0, of output 1, ... */
    double *x;            /**< [n_state(dim)] the law's state */
    double *u;            /**< [nu] compute: to be filled; update, track: what went out */
};

#define APC_LAW_ABI 1u

/** All functions are [tick]: no allocation, no I/O, no clock. NULL is allowed where it says so. */
struct apc_law {
    unsigned abi; /**< APC_LAW_ABI */
    const char *name, *description;
    size_t n_tuning;                              /**< parameters of each output */
    const struct apc_param *tuning;               /**< [n_tuning] */
    size_t (*n_state)(const struct apc_dim *dim); /**< NULL: none */
    bool (*accepts)(const struct apc_dim *dim);   /**< NULL: any dimensions */
    void (*reset)(struct apc_law_call *c);        /**< fill x before the first tick; NULL: zeros */
    void (*compute)(struct apc_law_call *c);      /**< u from y, z, x; x stays as it is */
    void (*update)(struct apc_law_call *c);       /**< x for the next tick; u is what went out; NULL: none */
    void (*track)(struct apc_law_call *c);        /**< set x so that compute would give u; NULL: cannot */
};

/**
 * The built-in law of that name ("pi"), or, when @p name contains a '/', the `apc_law` of that shared
 * object. *@p handle (NULL for a built-in one) goes back with apc_plugin_close() after the last use.
 * [setup] Returns 0, APC_ENOTFOUND (names the laws there are), APC_EINVAL (other ABI, no compute).
 */
APC_API int apc_law_find(const char *name, const struct apc_law **law, void **handle, struct apc_error *why);

/** The paper's PI controller, one loop for each output; see src/control/pi.c. */
APC_API extern const struct apc_law apc_law_pi;

#ifdef __cplusplus
}
#endif
#endif

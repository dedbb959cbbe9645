/* SPDX-License-Identifier: BSD-3-Clause */
/**
 * @file apcplant.h
 * Plant models behind one interface, and their integration (section "Real-time Simulator" of the
 * paper). A model is a constant struct of plain C functions; one of your own is a shared object that
 * exports it as `apc_model`.
 */
#ifndef APCPLANT_H
#define APCPLANT_H

#include "apcbase.h"

#ifdef __cplusplus
extern "C" {
#endif

#define APC_MODEL_ABI 1u

/** x' = f(t, x, u, p), y = g(t, x, u, p). Functions are pure; f returns 0, or nonzero where undefined. */
struct apc_model {
    unsigned abi; /**< APC_MODEL_ABI */
    const char *name, *description;
    size_t nx, nu, ny, np;
    const struct apc_param *param; /**< [np] */
    const double *x0;              /**< [nx] default initial state; NULL: zeros */
    int (*f)(double t, const double *x, const double *u, const double *p, double *dx);
    void (*g)(double t, const double *x, const double *u, const double *p, double *y);
};

/** As apc_law_find(): a built-in model ("first-order"), or the `apc_model` of a shared object. [setup] */
APC_API int apc_model_find(const char *name, const struct apc_model **model, void **handle,
                           struct apc_error *why);

/** dx/dt = (-x + K u) / tau, y = x: the plant of the paper's experiment. */
APC_API extern const struct apc_model apc_model_first_order;

/** Zero means default. */
struct apc_integrator_options {
    size_t size;
    double rtol, atol; /**< default 1e-8, 1e-10 */
};

/** A model with its parameters, its state and an integrator whose memory is used again each step. */
struct apc_plant;

/**
 * @p p [np] and @p x0 [nx] are copied; NULL takes the model's own. [setup] Returns 0, APC_EINVAL (a
 * parameter outside its range, a model without functions), APC_ENOMEM, APC_ESOLVER.
 */
APC_API int apc_plant_create(struct apc_plant **plant, const struct apc_model *model, const double *p,
                             const double *x0, const struct apc_integrator_options *options,
                             struct apc_error *why);
APC_API void apc_plant_destroy(struct apc_plant *plant); /**< NULL is legal. [setup] */
/**
 * Advance the state by @p dt seconds with @p u [nu] held constant (zero-order hold). Returns 0, or
 * APC_ESOLVER, after which the state is that of before the call. [tick]
 */
APC_API int apc_plant_advance(struct apc_plant *plant, double dt, const double *u);
/** y [ny] of the present state. [tick] */
APC_API void apc_plant_output(const struct apc_plant *plant, const double *u, double *y);
APC_API const double *apc_plant_state(const struct apc_plant *plant); /**< [nx], the plant's own */
APC_API double apc_plant_time(const struct apc_plant *plant);         /**< s since it was made */
APC_API const char *apc_plant_error(const struct apc_plant *plant);   /**< last failure, "" if none */

#ifdef __cplusplus
}
#endif
#endif

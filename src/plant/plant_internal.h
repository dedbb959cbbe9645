/* SPDX-License-Identifier: BSD-3-Clause */
#ifndef APC_PLANT_INTERNAL_H
#define APC_PLANT_INTERNAL_H

#include "apcplant.h"

/** Check a model from outside; @p from, its path or name, begins the error's text. Returns 0 or APC_EINVAL.
 */
int apc_model_check(const struct apc_model *model, const char *from, struct apc_error *why);

/** One way to solve x' = f(t, x, u, p) over one interval of constant u. One file each. */
struct apc_integrator {
    /** @p p is borrowed for the integrator's life. [setup] Returns 0, APC_ENOMEM or APC_ESOLVER. */
    int (*create)(void **self, const struct apc_model *model, const double *p, double rtol, double atol,
                  struct apc_error *why);
    /** @p x at t becomes x at t + dt; on failure, APC_ESOLVER, x stays as it was. dt > 0. [tick] */
    int (*step)(void *self, double t, double dt, const double *u, double *x, struct apc_error *why);
    void (*destroy)(void *self); /**< NULL is legal. [setup] */
};

extern const struct apc_integrator apc_integrator_cvode;

#endif

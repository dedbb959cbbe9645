/* SPDX-License-Identifier: BSD-3-Clause */
#ifndef APC_PLANT_INTERNAL_H
#define APC_PLANT_INTERNAL_H

#include "apcmath.h"
#include "apcplant.h"

#include <math.h>

/** Check a model from outside; @p from, its path or name, begins the error's text. Returns 0 or APC_EINVAL. */
int apc_model_check(const struct apc_model *model, const char *from, struct apc_error *why);
/** f, with APC_ESOLVER when it says that it is not defined there or gives no finite numbers. [tick] */
int apc_model_derivative(const struct apc_model *model, double t, const double *x, const double *u,
                         const double *p, double *dx, struct apc_error *why);
/** The initial values of @p n parameters or variables into @p value; zeros when there is no table. */
void apc_param_initials(const struct apc_param *param, size_t n, double *value);
/**
 * The same, or @p given ones (NULL: none) in their place, each within its range; @p what it is, for the
 * error. Returns 0 or APC_EINVAL.
 */
int apc_model_take(const struct apc_model *model, double *value, const double *given,
                   const struct apc_param *table, size_t n, const char *what, struct apc_error *why);

/* ---- Integrators ---------------------------------------------------------------------------- */

/** One way to solve x' = f(t, x, u, p) over one interval of constant u [nu + nd]. One file each. */
struct apc_integrator {
    const char *name;
    /**
     * @p p is borrowed for the integrator's life; @p options hold no zeros any more. [setup] Returns 0,
     * APC_EINVAL: not for this model, APC_ENOMEM or APC_ESOLVER.
     */
    int (*create)(void **self, const struct apc_model *model, const double *p,
                  const struct apc_plant_options *options, struct apc_error *why);
    /** The state that it starts with into @p x, of a model that says so only when it is there; NULL: as the
     * model has it. [setup] */
    void (*start)(void *self, double *x);
    /** @p x at t becomes x at t + dt; on failure, APC_ESOLVER, x stays as it was. dt > 0. [tick] */
    int (*step)(void *self, double t, double dt, const double *u, double *x, struct apc_error *why);
    void (*destroy)(void *self); /**< NULL is legal. [setup] */
};

extern const struct apc_integrator apc_integrator_cvode, apc_integrator_adams, apc_integrator_rk4,
    apc_integrator_exact, apc_integrator_fmu;

/** One that is stepped, with no f and g that could be asked; its states are its outputs. [tick] */
bool apc_model_is_fmu(const struct apc_model *model);

/* ---- Dead time ------------------------------------------------------------------------------ */

/** The changes of an input that are still under way: a ring of vectors and of when they act. */
struct apc_delay {
    double dead_time;
    size_t width, first, n;
    double *acts, *value; /* [APC_DELAY_MAX], [APC_DELAY_MAX * width] */
};
#define APC_DELAY_MAX 8192

int apc_delay_open(struct apc_delay *delay, double dead_time, size_t width);
void apc_delay_close(struct apc_delay *delay);
/** Note that the input is @p u from @p t on, unless it was so before; @p now is what acts at present. False
 * when it is full. [tick] */
bool apc_delay_put(struct apc_delay *delay, double t, const double *u, const double *now);
/** Take what acts by @p t into @p now. Returns when the next change acts; INFINITY: none is under way. [tick] */
double apc_delay_take(struct apc_delay *delay, double t, double *now);

/* ---- Models --------------------------------------------------------------------------------- */

extern const struct apc_model apc_model_servo, apc_model_double_tank, apc_model_pendulum,
    apc_model_quadruple_tank, apc_model_quadruple_tank_nonminimum, apc_model_four_tank,
    apc_model_van_de_vusse, apc_model_adiabatic_cstr, apc_model_temperature_lab, apc_model_hundred;

#define APC_KELVIN 273.15 /* 0 degC */

/** Flow out of a hole of @p area under a level @p h: Torricelli. An empty tank gives nothing. */
static inline double apc_outflow(double area, double gravity, double h)
{
    return h > 0.0 ? area * sqrt(2.0 * gravity * h) : 0.0;
}

#endif

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

#define APC_MODEL_ABI 3u /**< 2 had no algebraic variables; its models still work */

/**
 * x' = f(t, x, u, p), y = g(t, x, u, p). Functions are pure; f returns 0, or nonzero where undefined.
 * Time is in seconds. u holds the nu manipulated inputs and after them the nd disturbances: [nu + nd].
 *
 * A differential-algebraic model has also nz algebraic variables z, and as many equations that they solve at
 * all times, 0 = residual(t, x, u, p). For its three functions x holds the nx states and after them z:
 * [nx + nz]. Its index must be 1: at given states the equations determine z (d residual/d z is regular).
 *
 * The tables name the variables; each may be NULL: then they are unnamed, unlimited, and start at zero.
 */
struct apc_model {
    unsigned abi; /**< APC_MODEL_ABI */
    const char *name, *description;
    size_t nx, nu, nd, ny, np;
    const struct apc_param *param;       /**< [np] */
    const struct apc_param *state;       /**< [nx] initial: where it starts; range: where the model holds */
    const struct apc_param *input;       /**< [nu] initial: at the nominal operating point */
    const struct apc_param *disturbance; /**< [nd] initial: as long as nothing is disturbed */
    const struct apc_param *output;      /**< [ny] name, unit, description only */
    int (*f)(double t, const double *x, const double *u, const double *p, double *dx);
    void (*g)(double t, const double *x, const double *u, const double *p, double *y);
    size_t nz; /**< from here on ABI 3 */
    const struct apc_param
        *algebraic; /**< [nz] initial: from where it is solved; range: where it is sought */
    /** To @p r [nz]; returns as f does. NULL without algebraic variables. */
    int (*residual)(double t, const double *x, const double *u, const double *p, double *r);
};

/** The model of a shared object, which defines it. Declared so that it is exported from C++ as well. */
APC_API extern const struct apc_model apc_model;

/**
 * As apc_law_find(): a built-in model ("first-order"), the `apc_model` of a shared object, or an FMU, FMI 2.0
 * or 3.0, for co-simulation or model exchange, by its path, which ends in .fmu. Such a model has no f and g that could be
 * asked: it can be a plant, and its states are its outputs; apc_model_equations() makes more of one that
 * shows more. Each plant of it is a process of its own. [setup]
 */
APC_API int apc_model_find(const char *name, const struct apc_model **model, void **handle,
                           struct apc_error *why);
/** What the inputs of an FMU that has none are called: as many as are asked for, which move nothing. */
#define APC_MODEL_NO_INPUT "(none)"
/**
 * Of an FMU, before plants are made of it: @p input [nu] are the names of those that are manipulated, the
 * other inputs are disturbances; @p output [ny] those that are measured. NULL takes the first ones. [setup]
 * Returns 0, APC_EINVAL (no FMU, too many, one twice) or APC_ENOTFOUND (names those there are).
 */
APC_API int apc_model_choose(const struct apc_model *model, const char *const *input, size_t nu,
                             const char *const *output, size_t ny, struct apc_error *why);
/**
 * Can @p variable, a parameter, input or disturbance in the tables of @p model, have that value? It must be
 * within the range and, for an FMU's integer, boolean or enumeration, a number of that type. Returns 0 or
 * APC_EINVAL. [setup]
 */
APC_API int apc_model_takes(const struct apc_model *model, const struct apc_param *variable, double value,
                            struct apc_error *why);
/** The same of an input that may be anything from @p low to @p high; one that is no real number is rounded.
 * [setup] */
APC_API int apc_model_takes_range(const struct apc_model *model, const struct apc_param *variable, double low,
                                  double high, struct apc_error *why);
/** What @p text says as a value of it: a number or, of an FMU, a label of its enumeration, "true", "false".
 * Returns 0, APC_EINVAL, or APC_ENOTFOUND: it has labels, and this is none. [setup] */
APC_API int apc_model_word(const struct apc_model *model, const struct apc_param *variable, const char *text,
                           double *value, struct apc_error *why);
/** The parameters of an FMU that are texts, [*n], each with its own text for a unit; other models have none.
 * [setup] */
APC_API const struct apc_param *apc_model_texts(const struct apc_model *model, size_t *n);
/** Give one of these another @p text, copied, before plants are made of the model; NULL is refused. [setup]
 * Returns 0, APC_EINVAL (it is one that cannot be set), APC_ENOTFOUND or APC_ENOMEM. */
APC_API int apc_model_set_text(const struct apc_model *model, const char *name, const char *text,
                               struct apc_error *why);
/**
 * Of an FMU whose ModelStructure names the derivatives of its states: the model of these states, into
 * @p shown, that the functions for linear models take, an extended estimator and laws; with the
 * inputs and outputs chosen by now, and as long as the handle. Plants are made of @p model alone. Any other
 * model: itself. [setup] Returns 0, or APC_EINVAL: it does not show them.
 */
APC_API int apc_model_equations(const struct apc_model *model, const struct apc_model **shown,
                                struct apc_error *why);
/** The built-in model number @p i, from 0; NULL beyond the last. Static. [any] */
APC_API const struct apc_model *apc_model_built_in(size_t i);

/** dx/dt = (-x + K u) / tau, y = x: the plant of the paper's experiment. */
APC_API extern const struct apc_model apc_model_first_order;

/* ---- Linear models ------------------------------------------------------------------------ */

/*
 * Of a model with algebraic variables: its linear model is that of the states alone, reduced by the equations'
 * Jacobians. The equations are solved from the variables' initial values.
 */

/**
 * Jacobians at t = 0, @p x [nx] and @p u [nu + nd], by central differences of fourth order: relative errors
 * of 1e-9 and less where f and g are smooth. Row-major; column k of B and D is input k, the disturbances
 * after the manipulated ones: @p a [nx * nx], @p b [nx * (nu + nd)], @p c [ny * nx], @p d [ny * (nu + nd)].
 * NULL for @p p, @p x, @p u takes the model's own. [setup]
 * Returns 0, APC_EINVAL, APC_ENOMEM, or APC_ESOLVER where f or g is not defined.
 */
APC_API int apc_model_linearize(const struct apc_model *model, const double *p, const double *x,
                                const double *u, double *a, double *b, double *c, double *d,
                                struct apc_error *why);
/** x' into @p dx [nx] and y into @p y [ny], each of which may be NULL; the rest as above. [setup] */
APC_API int apc_model_evaluate(const struct apc_model *model, const double *p, const double *x,
                               const double *u, double *dx, double *y, struct apc_error *why);
/**
 * Find the steady state f(0, x, u, p) = 0 by damped Newton steps from @p x [nx], and leave it there. Where
 * there are several, the start decides; it need not be a stable one. NULL for @p p, @p u: as above. [setup]
 * Returns 0, APC_EINVAL, APC_ENOMEM, or APC_ESOLVER: none found from there; x is then as it was.
 */
APC_API int apc_model_equilibrium(const struct apc_model *model, const double *p, const double *u, double *x,
                                  struct apc_error *why);

/* ---- Plants ------------------------------------------------------------------------------- */

/** Zero means default. */
struct apc_plant_options {
    size_t size;
    /**
     * "cvode" (the default: BDF of variable order and step, for anything, stiff too), "adams" (CVODE as
     * well, for what is not stiff), "rk4" (fixed steps, no control of the error), "exact" (linear models
     * only). docs/plants.md says when to choose which. A model with algebraic variables has "ida" alone.
     */
    const char *integrator;
    double rtol, atol; /**< of cvode, adams and ida; default 1e-8, 1e-10 */
    unsigned steps;    /**< of rk4: how many in each interval; default 10 */
    /**
     * s by which the manipulated inputs act later, exactly (the state is advanced from one delayed change of
     * the input to the next). Before the start they were at their nominal values. At most 8192 changes may
     * be under way.
     */
    double dead_time;
    /**
     * s that a step of an FMU may take in real time: one that takes longer has failed, and where it never
     * ends its process is started again. 0: this is virtual time, which waits (APC_FMU_TIMEOUT, in the
     * environment, s; default 60).
     */
    double patience;
    /** s from one step to the next: the length of the steps of an FMU that takes those of one length only,
     * and does not say of which. 0: that of its first one. */
    double period;
};

/** A model with its parameters, its state and an integrator whose memory is used again each step. */
struct apc_plant;

/**
 * @p p [np] and @p x0 [nx] are copied; NULL takes the model's own. [setup] Returns 0, APC_EINVAL (a
 * parameter or state outside its range, a model without functions, an unknown integrator, a nonlinear model
 * for "exact"), APC_ENOMEM, APC_ESOLVER (also where the algebraic equations have no solution at the start).
 */
APC_API int apc_plant_create(struct apc_plant **plant, const struct apc_model *model, const double *p,
                             const double *x0, const struct apc_plant_options *options,
                             struct apc_error *why);
APC_API void apc_plant_destroy(struct apc_plant *plant); /**< NULL is legal. [setup] */
/** Not of an FMU, which takes them as it starts. From now on its parameters are @p p [np], copied; the state
 * goes on. [setup] Returns 0, APC_EINVAL, APC_ENOMEM or APC_ESOLVER as apc_plant_create() does; then nothing
 * has changed. */
APC_API int apc_plant_change(struct apc_plant *plant, const double *p, struct apc_error *why);
/**
 * Advance the state by @p dt seconds with @p u [nu] held constant (zero-order hold). Returns 0, or
 * APC_ESOLVER, after which the state is that of before the call. [tick]
 */
APC_API int apc_plant_advance(struct apc_plant *plant, double dt, const double *u);
/** Give disturbance @p k, from 0, a value from now on. Returns 0, or APC_EINVAL: no such, or not finite.
 * [tick]
 */
APC_API int apc_plant_disturb(struct apc_plant *plant, size_t k, double value);
/** Add to state @p k, from 0, and keep it within its range. Returns 0 or APC_EINVAL, as above. [tick] */
APC_API int apc_plant_kick(struct apc_plant *plant, size_t k, double by);
/** y [ny] of the present state; @p u [nu] as it is, without dead time. NaN where the algebraic equations have
 * no solution. Uses memory of the plant's: by one thread at a time, as all else. [tick] */
APC_API void apc_plant_output(struct apc_plant *plant, const double *u, double *y);
APC_API const double *
apc_plant_state(const struct apc_plant *plant);                     /**< [nx + nz], the plant's own. [tick] */
APC_API double apc_plant_time(const struct apc_plant *plant);       /**< s since it was made. [tick] */
APC_API const char *apc_plant_error(const struct apc_plant *plant); /**< last failure, "" if none. [tick] */

#ifdef __cplusplus
}
#endif
#endif

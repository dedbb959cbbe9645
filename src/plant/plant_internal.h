/* SPDX-License-Identifier: BSD-3-Clause */
#ifndef APC_PLANT_INTERNAL_H
#define APC_PLANT_INTERNAL_H

#include "apcmath.h"
#include "apcplant.h"

#include <math.h>

/** Check a model from outside; @p from, its path or name, begins the error's text. Returns 0 or APC_EINVAL. */
int apc_model_check(const struct apc_model *model, const char *from, struct apc_error *why);
/** Its algebraic variables: those of an older ABI have no such member. [tick] */
static inline size_t apc_model_nz(const struct apc_model *model)
{
    return model->abi >= 3 ? model->nz : 0;
}
/** f, and into @p dx [nx + nz] after it the residuals, with APC_ESOLVER where one is not defined or not a finite
 * number. [tick] */
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

struct apc_fmu_look;

/* ---- Algebraic equations -------------------------------------------------------------------- */

/** Solves 0 = residual(t, x, z, u, p) for the z behind x [nx + nz], by Newton's method from where z is. */
struct apc_algebraic;

/** The least that a difference quotient takes for the magnitude of z: beside terms of magnitude 1 a smaller
 * step would drown in rounding. */
#define APC_ALGEBRAIC_SCALE 1e-6

/** @p p is borrowed; below @p zero_scale a variable counts as zero. [setup] Returns 0 or APC_ENOMEM. */
int apc_algebraic_create(struct apc_algebraic **algebraic, const struct apc_model *model, const double *p,
                         double zero_scale);
void apc_algebraic_destroy(struct apc_algebraic *algebraic); /**< NULL is legal. [setup] */
/** Returns 0, or APC_ESOLVER: which equation, and how far from 0; z is then as it was. [tick] */
int apc_algebraic_solve(struct apc_algebraic *algebraic, double t, double *x, const double *u,
                        struct apc_error *why);
/** Do the equations determine z at the solution @p x? Returns 0, or APC_ESOLVER: index 2, by which equation. */
int apc_algebraic_check(struct apc_algebraic *algebraic, double t, const double *x, const double *u,
                        struct apc_error *why);
/** z' behind the x' of @p rate [nx + nz], at the solution @p x: to first order. [tick] */
void apc_algebraic_rate(struct apc_algebraic *algebraic, double t, const double *x, const double *u,
                        double *rate);

/** f and g of a model as of its states alone, at t = 0. The algebraic variables are solved from their initial
 * values, so that the same states always give the same bits. */
struct apc_reduced {
    const struct apc_model *model;
    const double *p;
    struct apc_algebraic *algebraic; /* NULL: it has none */
    double *x;                       /* [nx + nz] */
    struct apc_fmu_look *look;       /* of an FMU, which is asked instead of f and g; NULL: it is none */
    bool plain;                      /* neither of both */
};

/** @p p is borrowed. [setup] Returns 0 or APC_ENOMEM. */
int apc_reduced_open(struct apc_reduced *reduced, const struct apc_model *model, const double *p,
                     struct apc_error *why);
void apc_reduced_close(struct apc_reduced *reduced); /**< One of zeros is legal. [setup] */
/** Those of a model that is not plain. [tick] */
int apc_reduced_solve_f(const struct apc_reduced *reduced, const double *x, const double *u, double *dx);
void apc_reduced_solve_g(const struct apc_reduced *reduced, const double *x, const double *u, double *y);
/** Until when (mono) this thread waits for an FMU from now on; 0: it is not real time. [tick] */
void apc_reduced_until(apc_ns mono);
/** Has it its own derivatives, which cost less than differences? */
static inline bool apc_reduced_derives(const struct apc_reduced *reduced)
{
    return reduced->look != NULL;
}

/** Derivatives by x and u [nx + nu + nd], row after row, of a model that has its own: of x' and y at a point;
 * of @p x after @p t in so many steps of Runge and Kutta, to where it goes. Return 0 or APC_ESOLVER. [tick] */
int apc_reduced_slopes(const struct apc_reduced *reduced, const double *x, const double *u, double *slopes);
int apc_reduced_interval(const struct apc_reduced *reduced, double *x, const double *u, double t,
                         unsigned steps, double *slopes);
/** Why the last question had no answer; "": nobody says. [tick] */
const char *apc_reduced_error(const struct apc_reduced *reduced);

/** x' to @p dx [nx]; nonzero where the model is not defined. Models without equations pay a look. [tick] */
static inline int apc_reduced_f(const struct apc_reduced *reduced, const double *x, const double *u,
                                double *dx)
{
    return reduced->plain ? reduced->model->f(0.0, x, u, reduced->p, dx)
                          : apc_reduced_solve_f(reduced, x, u, dx);
}

/** NaN where there is no solution or answer. [tick] */
static inline void apc_reduced_g(const struct apc_reduced *reduced, const double *x, const double *u,
                                 double *y)
{
    if (reduced->plain)
        reduced->model->g(0.0, x, u, reduced->p, y);
    else
        apc_reduced_solve_g(reduced, x, u, y);
}

/* ---- Integrators ---------------------------------------------------------------------------- */

/** One way to solve x' = f(t, x, u, p) over one interval of constant u [nu + nd]. x is [nx + nz]. */
struct apc_integrator {
    const char *name;
    /**
     * @p p is borrowed for the integrator's life; @p options hold no zeros any more. [setup] Returns 0,
     * APC_EINVAL: not for this model, APC_ENOMEM or APC_ESOLVER.
     */
    int (*create)(void **self, const struct apc_model *model, const double *p,
                  const struct apc_plant_options *options, struct apc_error *why);
    /** Put into @p x what the model's table does not say: the state of one that says so only when it is there,
     * or a solution of the algebraic equations. NULL: nothing. [setup] Returns 0 or APC_ESOLVER. */
    int (*start)(void *self, const double *u, double *x, struct apc_error *why);
    /** Algebraic variables of @p x that fit its states and @p u; NULL: there are none. [tick] Returns 0 or
     * APC_ESOLVER. */
    int (*settle)(void *self, double t, const double *u, double *x, struct apc_error *why);
    /** @p x at t becomes x at t + dt; on failure, APC_ESOLVER, x stays as it was. dt > 0. [tick] */
    int (*step)(void *self, double t, double dt, const double *u, double *x, struct apc_error *why);
    void (*destroy)(void *self); /**< NULL is legal. [setup] */
};

extern const struct apc_integrator apc_integrator_cvode, apc_integrator_adams, apc_integrator_rk4,
    apc_integrator_exact, apc_integrator_ida, apc_integrator_fmu;

/** One that is stepped, with no f and g that could be asked; its states are its outputs. [tick] */
bool apc_model_is_fmu(const struct apc_model *model);
/** Is this what apc_model_equations() has made of one? */
bool apc_fmu_shown(const struct apc_model *model);

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

/** Members of a built-in model: the tables of its file, which are called so, and how long they are. */
#define APC_MODEL_TABLES                                                                                     \
    .abi = APC_MODEL_ABI, .nx = APC_ENTRIES(state), .nu = APC_ENTRIES(input), .ny = APC_ENTRIES(output),     \
    .np = APC_ENTRIES(param), .param = param, .state = state, .input = input, .output = output
/** The same of one that has disturbances. */
#define APC_MODEL_DISTURBED APC_MODEL_TABLES, .nd = APC_ENTRIES(disturbance), .disturbance = disturbance
#define APC_ENTRIES(table)  (sizeof(table) / sizeof *(table))

#define APC_KELVIN 273.15 /* 0 degC */

/** Flow out of a hole of @p area under a level @p h: Torricelli. An empty tank gives nothing. */
static inline double apc_outflow(double area, double gravity, double h)
{
    return h > 0.0 ? area * sqrt(2.0 * gravity * h) : 0.0;
}

#endif

/* SPDX-License-Identifier: BSD-3-Clause */
/**
 * @file apclinear.h
 * Sampled linear models for control and estimation, with dead times:
 *
 *     x[k+1] - x0 = A (x[k] - x0) + B (u[k] - u0),    y[k] - y0 = C (x[k] - x0) + D (u[k] - u0)
 *
 * u holds the nu manipulated inputs and after them the nd measured disturbances, each constant from one
 * sample to the next. Matrices are row after row. Where y[k] is sampled u[k] has just begun to act, so D is
 * zero but for what acts at once.
 *
 * A dead time becomes states that hold former inputs; it need not be a multiple of the period (Astrom and
 * Wittenmark, Computer-Controlled Systems, 3rd ed., 1997, section 2.3).
 */
#ifndef APCLINEAR_H
#define APCLINEAR_H

#include "apcbase.h"

#ifdef __cplusplus
extern "C" {
#endif

/** One block of memory: goes back with apc_linear_destroy(). To be read; who writes into it knows why. */
struct apc_linear {
    double Ts; /**< s */
    size_t nx, nu, nd, ny;
    double *A, *B, *C, *D;    /**< [nx * nx], [nx * (nu + nd)], [ny * nx], [ny * (nu + nd)] */
    double *x0, *u0, *y0;     /**< [nx], [nu + nd], [ny] the operating point */
    size_t nx_plant, nx_held; /**< states of the plant come first, then former inputs, then disturbances that
                                 apc_linear_disturb() added */
};

/** dx/dt = A (x - x0) + B (u - u0), y = y0 + C (x - x0) + D (u - u0), to be sampled. */
struct apc_linear_continuous {
    size_t size;
    size_t nx, nu, nd, ny;      /**< nx may be 0 */
    const double *A, *B, *C;    /**< NULL where nx is 0 */
    const double *D;            /**< NULL: zeros */
    const double *x0, *u0, *y0; /**< NULL: zeros */
    const double *dead_time;    /**< [nu + nd] s by which an input acts later, >= 0; NULL: zeros */
};
/**
 * Sample with period @p Ts. [setup] Returns 0, APC_EINVAL (a number that is none, a period or dead time out
 * of range, more than 100 000 elements), APC_ENOMEM.
 */
APC_API int apc_linear_from_continuous(struct apc_linear **model, const struct apc_linear_continuous *from,
                                       double Ts, struct apc_error *why);

/**
 * A model that is sampled already: x of the next period = A x + B u, y = C x + D u. The rest is as above; its
 * dead times must be 0 or NULL, for they are states of it. [setup] Returns as apc_linear_from_continuous().
 */
APC_API int apc_linear_from_sampled(struct apc_linear **model, const struct apc_linear_continuous *from,
                                    double Ts, struct apc_error *why);

/**
 * gain (zero s + 1) e^(-dead_time s) / ((tau[0] s + 1) (tau[1] s + 1)), times 1/s where @p integrating.
 * A lead without a lag, zero != 0 and tau[0] = 0, is refused.
 */
struct apc_transfer {
    double gain, zero;
    double tau[2]; /**< s, >= 0; tau[1] only with tau[0] */
    double dead_time;
    bool integrating;
};
/**
 * @p g [ny * (nu + nd)], row after row: from each input to each output; a gain of 0: none. @p u0 [nu + nd],
 * @p y0 [ny]: the operating point; NULL: zeros. [setup] Returns as apc_linear_from_continuous().
 */
APC_API int apc_linear_from_transfer(struct apc_linear **model, size_t ny, size_t nu, size_t nd,
                                     const struct apc_transfer *g, const double *u0, const double *y0,
                                     double Ts, struct apc_error *why);

/** Where an unmeasured disturbance, constant until it changes, acts. */
struct apc_linear_unknown {
    enum apc_linear_where {
        APC_AT_OUTPUT = 1, /**< is added to a measurement */
        APC_AT_INPUT       /**< is added to an input, before its dead time */
    } where;
    size_t number; /**< of the measurement or input, from 0 */
};
/**
 * The model with @p n states more, one for each unknown disturbance: for offset-free control, as many as
 * there are measurements that have a setpoint (Pannocchia and Rawlings, AIChE Journal 49(2), 2003). [setup]
 * Returns 0; APC_EINVAL with what is missing where the measurements cannot tell the disturbances apart from
 * each other and from the state; APC_ENOMEM.
 */
APC_API int apc_linear_disturb(struct apc_linear **model, const struct apc_linear *from,
                               const struct apc_linear_unknown *unknown, size_t n, struct apc_error *why);

APC_API void apc_linear_destroy(struct apc_linear *model); /**< NULL is legal. [setup] */

/** @p next [nx] = the state one period on; not @p x itself. [tick] */
APC_API void apc_linear_next(const struct apc_linear *model, const double *x, const double *u, double *next);
/** @p y [ny] of state and input. [tick] */
APC_API void apc_linear_output(const struct apc_linear *model, const double *x, const double *u, double *y);

/* ---- Design ------------------------------------------------------------------------------------ */

/* Matrices are stored row after row. All return 0, APC_EINVAL, APC_ENOMEM or APC_ESOLVER. */

/**
 * Sample dx/dt = A x + B u with period @p Ts, u held between the samples: x[k+1] = Ad x[k] + Bd u[k].
 * A, Ad [nx * nx], B, Bd [nx * nu]. [setup]
 */
APC_API int apc_linear_sample(size_t nx, size_t nu, const double *A, const double *B, double Ts, double *Ad,
                              double *Bd, struct apc_error *why);
/**
 * The stabilising solution P [nx * nx] of the discrete Riccati equation
 *     P = A'PA - A'PB (R + B'PB)^-1 B'PA + Q
 * and its gain K = (R + B'PB)^-1 B'PA [nu * nx]: u = -K x minimises the sum of x'Qx + u'Ru. With A', C' for
 * A, B and the covariances of process and measurement noise for Q, R it is the Kalman filter's. R must be
 * positive definite. APC_ESOLVER: there is no stabilising solution; @p why says what is to be looked at.
 * [setup]
 */
APC_API int apc_riccati_solve(size_t nx, size_t nu, const double *A, const double *B, const double *Q,
                              const double *R, double *P, double *K, struct apc_error *why);

#ifdef __cplusplus
}
#endif
#endif

/* SPDX-License-Identifier: BSD-3-Clause */
/**
 * @file apcestimate.h
 * Estimates of a plant's state, from its inputs and its measurements.
 *
 * Each sample: correct with what was measured, use the state, predict with what went out. The estimator's
 * memory is an array of the caller's, s: a law may keep it in its x, and a restart continues bit for bit. The
 * estimator itself is workspace, and belongs to one thread at a time.
 *
 * Measurements are taken one after another, so their noises must be independent; each covariance update has
 * Joseph's form and stays positive (Bucy and Joseph, Filtering for Stochastic Processes, 1968).
 */
#ifndef APCESTIMATE_H
#define APCESTIMATE_H

#include "apclinear.h"
#include "apcplant.h"

#ifdef __cplusplus
extern "C" {
#endif

enum apc_estimator_kind {
    APC_KALMAN_STEADY =
        1,      /**< constant gain: cheap; takes a measurement that is missing for what it expected */
    APC_KALMAN, /**< covariance of its own: right also while measurements are Bad, slow, or come late */
    APC_KALMAN_EXTENDED /**< nonlinear model in continuous time, measured at instants */
};

/** Zero means default, but for those marked required. All is copied but the model of the extended one. */
struct apc_estimator_options {
    size_t size;
    enum apc_estimator_kind kind;    /**< required */
    const struct apc_linear *linear; /**< required, but for the extended one */
    const struct apc_model *model;   /**< required for the extended one; borrowed */
    const double *p;                 /**< [np] parameters of model; NULL: its own */
    double Ts;                       /**< required for the extended one, s */
    unsigned steps;                  /**< of the extended one: integration steps a period; default 10 */
    /**
     * [nx] required: variance that each state gains, in its unit squared: per period in a linear model, per
     * second in a nonlinear one. Zero: the state is certain.
     */
    const double *q;
    const double *r;  /**< [ny] required: variance of each measurement's noise, above 0 */
    const double *p0; /**< [nx] variances to begin with; NULL: q, or 1 where that is 0 */
    /** Of the extended filter: unmeasured disturbances, constant but for q; they are further states,
     * behind those of the model, and count in every nx here. [n_unknown]; an input may be one of model's own
     * disturbances, behind its nu inputs. */
    const struct apc_linear_unknown *unknown;
    size_t n_unknown;
};
struct apc_estimator;

/** [setup] Returns 0, APC_EINVAL (an option that makes no sense), APC_ENOMEM, APC_ESOLVER: there is no steady
 * gain, with the reason. */
APC_API int apc_estimator_create(struct apc_estimator **estimator,
                                 const struct apc_estimator_options *options, struct apc_error *why);
APC_API void apc_estimator_destroy(struct apc_estimator *estimator); /**< NULL is legal. [setup] */
/** How many numbers s has. Its first nx are the state. [any] */
APC_API size_t apc_estimator_size(const struct apc_estimator *estimator);
/** Begin with state @p x [nx]; NULL: the model's own. [tick] */
APC_API void apc_estimator_reset(const struct apc_estimator *estimator, double *s, const double *x);
/**
 * Take measurements @p y [ny], those whose @p usable [ny] is true (NULL: all); @p u [nu + nd] is what acts
 * where a measurement depends on it. What is not finite is not usable. A slow measurement is usable once,
 * when it is new. The extended one keeps its state in the ranges where its model holds, and begins its
 * covariance again from p0 where bad numbers have left none. Returns how many were taken. [tick]
 */
APC_API int apc_estimator_correct(struct apc_estimator *estimator, double *s, const double *y,
                                  const bool *usable, const double *u);
/**
 * One period on, with @p u [nu + nd]. Returns 0, or APC_ESOLVER where the nonlinear model is not defined: s
 * is then as it was. [tick]
 */
APC_API int apc_estimator_predict(struct apc_estimator *estimator, double *s, const double *u);
/** What the measurements are expected to be: @p y [ny]. [tick] */
APC_API void apc_estimator_output(struct apc_estimator *estimator, const double *s, const double *u,
                                  double *y);
/** Standard deviation of state @p i, from 0, as the covariance says; of a steady one, after a correction.
 * [tick] */
APC_API double apc_estimator_deviation(const struct apc_estimator *estimator, const double *s, size_t i);

#ifdef __cplusplus
}
#endif
#endif

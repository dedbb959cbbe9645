/* SPDX-License-Identifier: BSD-3-Clause */
#ifndef APC_PREDICT_INTERNAL_H
#define APC_PREDICT_INTERNAL_H

#include <stddef.h>

#include "apcestimate.h"
#include "apclinear.h"
#include "predict/nested.h"

/** apc_riccati_solve() in @p memory [apc_riccati_room()]. [tick] */
size_t apc_riccati_room(size_t nx, size_t nu);
int apc_riccati_in(double *memory, size_t nx, size_t nu, const double *A, const double *B, const double *Q,
                   const double *R, double *P, double *K, struct apc_error *why);

/** A model of zeros; nx_plant and nx_held are the caller's to tell. Returns 0, APC_EINVAL, APC_ENOMEM. */
int apc_linear_allocate(struct apc_linear **model, size_t nx, size_t nu, size_t nd, size_t ny,
                        struct apc_error *why);

/** apc_estimator_create() of a model with loops around it, which are borrowed; NULL: none. */
int apc_estimator_create_nested(struct apc_estimator **estimator, const struct apc_estimator_options *options,
                                struct apc_nested *nested, struct apc_error *why);
/** What was not expected of a measurement, from those before it, of the same instant too. */
struct apc_innovation {
    double value, variance; /* variance 0: it was not taken; NAN of the first: the covariance began again */
};
/** [ny] of the last correction, but of a steady one. [tick] */
const struct apc_innovation *apc_estimator_innovations(const struct apc_estimator *estimator);
/** How many whole periods a dead time has, and what is left of it, s. [any] */
size_t apc_linear_whole(double dead_time, double Ts, double *bit);

#endif

/* SPDX-License-Identifier: BSD-3-Clause */
/* Where an estimator begins: the steady state that measurements and inputs would be of. */
#ifndef APC_REST_H
#define APC_REST_H

#include "apclinear.h"

struct apc_rest;

/* The model must tell its unknown disturbances apart, as apc_linear_disturb() sees to. */
int apc_rest_create(struct apc_rest **rest, const struct apc_linear *model, struct apc_error *why);
void apc_rest_destroy(struct apc_rest *rest); /* NULL is legal */
/* x [nx], unknown disturbances included, that stays where it is with u [nu + nd] and shows y [ny]; where
 * there are more measurements than disturbances, as nearly as can be. [tick] */
void apc_rest_find(struct apc_rest *rest, const double *y, const double *u, double *x);

#endif

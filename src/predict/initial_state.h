/* SPDX-License-Identifier: BSD-3-Clause */
/* Where an estimator begins: the steady state that measurements and inputs would be of. */
#ifndef APC_REST_H
#define APC_REST_H

#include "apclinear.h"

struct apc_initial_state;

/* The model must tell its unknown disturbances apart, as apc_linear_disturb() sees to. */
int apc_initial_state_create(struct apc_initial_state **rest, const struct apc_linear *model,
                             struct apc_error *why);
void apc_initial_state_destroy(struct apc_initial_state *rest); /* NULL is legal */
/* x [nx], unknown disturbances included, that stays where it is with u [nu + nd] and shows y [ny]; where
 * there are more measurements than disturbances, as nearly as can be. [tick] */
void apc_initial_state_find(struct apc_initial_state *rest, const double *y, const double *u, double *x);

#endif

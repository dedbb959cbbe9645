/* SPDX-License-Identifier: BSD-3-Clause */
#ifndef APC_PREDICT_INTERNAL_H
#define APC_PREDICT_INTERNAL_H

#include <stddef.h>

#include "apcbase.h"

/** apc_riccati_solve() in @p memory [apc_riccati_room()]. [tick] */
size_t apc_riccati_room(size_t nx, size_t nu);
int apc_riccati_in(double *memory, size_t nx, size_t nu, const double *A, const double *B, const double *Q,
                   const double *R, double *P, double *K, struct apc_error *why);

#endif

/* SPDX-License-Identifier: BSD-3-Clause */
#ifndef APC_CONTROL_INTERNAL_H
#define APC_CONTROL_INTERNAL_H

#include "apccontrol.h"

/** Check a law from outside; @p from, its path or name, begins the error's text. Returns 0 or APC_EINVAL. */
int apc_law_check(const struct apc_law *law, const char *from, struct apc_error *why);
/** Refuse a setting that the law does not know. Returns 0 or APC_EINVAL. */
int apc_law_check_settings(const struct apc_law *law, const struct apc_law_setup *setup,
                           struct apc_error *why);

/**
 * The setting of that name as @p n numbers of variables, each of @p least .. @p most, as doubles in @p to;
 * where it is absent @p to stays. Returns 0 or APC_EINVAL.
 */
int apc_setting_indices(const struct apc_law_setup *setup, const char *name, size_t n, size_t least,
                        size_t most, double *to, struct apc_error *why);
/** The setting of that name as @p n numbers that are not negative; where it is absent @p to stays. */
int apc_setting_amounts(const struct apc_law_setup *setup, const char *name, size_t n, double *to,
                        struct apc_error *why);

/** For a law's check: parameter @p lower must not be above parameter @p upper of any output. [tick] Returns 0
 * or APC_ERANGE. */
int apc_law_check_order(const struct apc_law *law, const struct apc_dim *dim, const double *tuning,
                        size_t lower, size_t upper, struct apc_error *why);

/**
 * The pairing of a law whose constants begin with vectors [nu] of numbers from 1: the one at @p measurement
 * and the one at @p setpoint. Returns 0, or an error of its configure, or APC_ENOMEM.
 */
int apc_law_pairing_of(const struct apc_law *law, const struct apc_law_setup *setup, size_t measurement,
                       size_t setpoint, struct apc_pair *pair, struct apc_error *why);

/** @p u within @p low and @p high (high wins); adds to *@p limited what was cut. [tick] */
double apc_law_cut(double u, double low, double high, unsigned *limited);

#endif

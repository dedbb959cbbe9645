/* SPDX-License-Identifier: BSD-3-Clause */
/**
 * @file apctune.h
 * Tunings of a PID loop from a transfer function, and how much of a change they bear.
 */
#ifndef APCTUNE_H
#define APCTUNE_H

#include "apclinear.h"

#ifdef __cplusplus
extern "C" {
#endif

/** Standard form: u = Kp (e + 1/tau_i times the integral of e + tau_d de/dt). */
struct apc_pid_tuning {
    double Kp;
    double tau_i; /**< s; 0: no integral */
    double tau_d; /**< s */
};

enum apc_tune_rule {
    APC_TUNE_SIMC =
        1,          /**< Skogestad, J. Process Control 13, 2003: disturbances are answered soon enough, too */
    APC_TUNE_LAMBDA /**< the same, tau_i being the plant's time constant however long: calm, and slow
                       to disturbances of a slow plant; not for one that integrates */
};

/**
 * PI, or with @p derivative PID, for plant @p g. @p tau_c s is how fast the loop is to answer; 0: as fast as
 * the dead time, which SIMC gives as the tight limit. @p period s of the controller counts as half of it in
 * dead time; 0: continuous. [any] Returns 0; APC_EINVAL: a gain of 0, a number that is none, a plant without
 * a lag, no dead time and no tau_c, LAMBDA for a plant that integrates.
 */
APC_API int apc_tune_pid(const struct apc_transfer *g, enum apc_tune_rule rule, bool derivative, double tau_c,
                         double period, struct apc_pid_tuning *tuning, struct apc_error *why);

/**
 * Where a loop of plant @p g and a controller of this @p period oscillates under a gain alone: *@p gain and
 * every *@p every s. A relay finds the same by trying (apcexcite.h): gain 4 / pi times its step over the
 * amplitude. [any] Returns 0; APC_EINVAL as apc_tune_pid(), or no gain makes it oscillate.
 */
APC_API int apc_tune_limit(const struct apc_transfer *g, double period, double *gain, double *every,
                           struct apc_error *why);
/**
 * From that limit: PID with the phase margin of 45 degrees of Astrom and Hagglund (Automatica 20, 1984),
 * tau_i = 4 tau_d; without a @p derivative Tyreus and Luyben's PI (Ind. Eng. Chem. Res. 31, 1992). [any]
 * Returns 0 or APC_EINVAL.
 */
APC_API int apc_tune_relay(double gain, double every, bool derivative, struct apc_pid_tuning *tuning,
                           struct apc_error *why);

/** HUGE_VAL: there is no limit. */
struct apc_margins {
    size_t size;        /**< sizeof the struct, set by the caller: no more than that is filled */
    double gain;        /**< by this factor the loop's gain may grow */
    double phase;       /**< degrees */
    double delay;       /**< s of dead time more */
    double sensitivity; /**< largest |1 / (1 + L)|: 1.2 to 2 is usual */
    bool stable;        /**< by Nyquist; margins say nothing otherwise */
};
/**
 * Of the loop of @p g and @p tuning, the controller's @p period counting as half of it in dead time. [any]
 * Returns 0 or APC_EINVAL (a number that is none).
 */
APC_API int apc_tune_margins(const struct apc_transfer *g, const struct apc_pid_tuning *tuning, double period,
                             struct apc_margins *margins, struct apc_error *why);

#ifdef __cplusplus
}
#endif
#endif

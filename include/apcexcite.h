/* SPDX-License-Identifier: BSD-3-Clause */
/**
 * @file apcexcite.h
 * Signals that make a plant tell what it is: sample by sample, between -1 and 1, to be scaled and moved.
 */
#ifndef APCEXCITE_H
#define APCEXCITE_H

#include "apcbase.h"

#ifdef __cplusplus
extern "C" {
#endif

/**
 * Steps up and down, of a whole, a half and a quarter of @p settling samples, around 0 and over it: as many
 * as @p n samples have room for. @p u [n] is -1, 0 or 1. [any] Returns 0 or APC_EINVAL (settling below 4).
 */
APC_API int apc_excite_steps(size_t settling, double *u, size_t n);

/**
 * Pseudo-random binary sequence of maximum length: 2^order - 1 bits, each held for @p hold samples, over and
 * over, from bit @p shift on. Over whole periods its power is the same at all frequencies of one sample a
 * bit but 0, and it has nothing in common with itself shifted. @p u [n] is -1 or 1. [any] Returns 0 or
 * APC_EINVAL (order not 2 to 16, hold 0).
 */
APC_API int apc_excite_prbs(unsigned order, size_t hold, size_t shift, double *u, size_t n);

/**
 * One period of a multisine: cosines of one size, from @p first periods in @p n samples to @p last, each @p
 * every th one. Their phases keep the largest |u| low: Schroeder's (IEEE Trans. Information Theory 16, 1970),
 * then clipping (Van der Ouderaa, Schoukens, Renneboog, IEEE Trans. Instrumentation and Measurement 37,
 * 1988). @p u [n]: the largest is 1; *@p crest: it, over the root of the mean square; NULL: not wanted.
 * [setup] Returns 0, APC_EINVAL (first 0 or above last, last not below n / 2, every 0) or APC_ENOMEM.
 */
APC_API int apc_excite_multisine(size_t first, size_t last, size_t every, double *u, size_t n, double *crest);

/**
 * A relay in the place of a controller. It puts out the sign of the error, until the error is beyond
 * hysteresis on the other side. So the loop oscillates where its phase is -180 degrees. Zeroed but for
 * hysteresis it begins. To be read: what was seen of the oscillation.
 */
struct apc_relay {
    double hysteresis;              /**< >= 0, of the measurement's unit */
    double out;                     /**< -1 or 1; 0: nothing was put out yet */
    double high, low;               /**< of the error since it last went up */
    double since;                   /**< s, of the last switch up */
    double amplitude[2], period[2]; /**< of the last oscillation, and of the one before; 0: there was none */
};
/** At time @p t s the error, setpoint less measurement, is @p error; one that is NAN changes nothing. Returns
 * what goes out, -1 or 1. [tick] */
APC_API double apc_relay_step(struct apc_relay *relay, double t, double error);
/** Are the last two oscillations alike, by 5 % of amplitude and period? [any] */
APC_API bool apc_relay_settled(const struct apc_relay *relay);

#ifdef __cplusplus
}
#endif
#endif

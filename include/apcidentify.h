/* SPDX-License-Identifier: BSD-3-Clause */
/**
 * @file apcidentify.h
 * Models from records of a plant: what went in, what was measured.
 *
 * All functions read a record and own nothing of it; they may take seconds, and are [setup]. What a record
 * cannot tell is refused with the reason and what to do about it, and nothing is made up.
 */
#ifndef APCIDENTIFY_H
#define APCIDENTIFY_H

#include "apclinear.h"

#ifdef __cplusplus
extern "C" {
#endif

/** Sampled at one period, sample after sample. Several runs of one plant may stand one behind the other: each
 * has a beginning and an operating point of its own, and nothing of one acts on the next. */
struct apc_record {
    size_t size;
    double Ts; /**< s */
    size_t n, nu, nd, ny;
    const double *u; /**< [n * (nu + nd)] what goes in from sample k until k + 1; disturbances come last */
    const double *y; /**< [n * ny] what is measured at sample k; NAN: nothing */
    size_t runs;     /**< 0: one */
    const size_t *begin; /**< [runs] the first sample of each, rising from 0; unused where runs is 0 or 1 */
};

/** How many runs: 1 at least. [any] */
APC_API size_t apc_record_runs(const struct apc_record *record);
/** Run @p run, from 0, by itself: a view. [any] */
APC_API struct apc_record apc_record_run(const struct apc_record *record, size_t run);
/** The sample behind its last. [any] */
APC_API size_t apc_record_end(const struct apc_record *record, size_t run);
/** How many samples of a run are among the first @p until of the record, of which each run has its share.
 * [any] */
APC_API size_t apc_record_share(const struct apc_record *record, const struct apc_record *run, size_t until);
/**
 * @p record becomes what all its runs would have been around the operating point of the first: @p u0 [runs *
 * (nu + nd)], @p y0 [runs * ny]. [setup] Returns its numbers, to be freed after it, or NULL: no memory.
 */
APC_API double *apc_record_gather(struct apc_record *record, const double *u0, const double *y0);

/**
 * Can models be had from it? [setup] Returns 0, APC_ENOMEM, or APC_EINVAL: an input or a measurement never
 * moves, inputs move together, a measurement is missing for the most part, or there are too few samples, also
 * of one run. Also where only a controller that saw nothing but y moved the inputs. A difference between runs
 * is no movement.
 */
APC_API int apc_record_check(const struct apc_record *record, struct apc_error *why);

/**
 * Of how many different frequencies input @p j, from 0, has enough to tell them apart, 50 at most: a model
 * with that many coefficients of this input can be had (its order of persistent excitation). [setup] Returns
 * a count or APC_ENOMEM.
 */
APC_API int apc_record_excitation(const struct apc_record *record, size_t j);

/* ---- First and second order with dead time ------------------------------------------------------- */

/** Zero means default. */
struct apc_identify_transfer_options {
    size_t size;
    unsigned order;       /**< 1 or 2 lags; 0: as many as the record can tell */
    double dead_time_max; /**< s; default a quarter of the record, 500 periods at most */
    enum apc_identify_integrating {
        APC_INTEGRATING_AUTO = 0, /**< if the record says so */
        APC_INTEGRATING_NO,
        APC_INTEGRATING_YES
    } integrating;
};

/** What is known of one output. Standard errors are NAN where the record says nothing of a number: where the
 * 95 % interval is wider than the number, or the search ended at its limit. */
struct apc_transfer_fit {
    double deviation; /**< of what the inputs do not explain, as it would be predicted a sample ahead */
    unsigned noise;   /**< order of its autoregression; 0: it is white */
    bool rest;        /**< the plant was at rest when the record began, as far as the record shows; the inputs
                              may have moved with its first sample */
    size_t n_parameters; /**< that were fitted */
};

/**
 * The transfer functions from each input to each output that predict y best. A search over dead times and
 * time constants comes first, then Gauss and Newton's iteration on the errors, whitened by an autoregression
 * where they are not white (Soderstrom and Stoica, System Identification, 1989, section 7.2). Structure by
 * Schwarz' criterion: an input that an output can do without has a gain of 0, of which nothing is known. @p g
 * [ny * (nu + nd)] are the transfer functions; @p error [the same] are their standard errors, in the members
 * of the same name (a tau of 0 is not there and has none). @p u0 [runs * (nu + nd)] and @p y0 [runs * ny] are
 * an operating point of each run for apc_linear_from_transfer(), near the recorded values; @p fit [ny] may be
 * NULL. [setup] Returns 0, APC_ENOMEM, APC_EINVAL as apc_record_check() or for an option out of range, or
 * APC_ESOLVER. The latter: no model predicts an output better than its mean; or the record does not determine
 * a gain, a time constant, a dead time or the steady state.
 */
APC_API int apc_identify_transfer(const struct apc_record *record,
                                  const struct apc_identify_transfer_options *options, struct apc_transfer *g,
                                  struct apc_transfer *error, double *u0, double *y0,
                                  struct apc_transfer_fit *fit, struct apc_error *why);

/* ---- Difference equations and state space -------------------------------------------------------- */

/** A model, and what the error of its expectation says of its state:
 * x[k+1] = ... + K (y[k] - what was expected). One block of memory but for linear. */
struct apc_identified {
    struct apc_linear *linear; /**< goes with it; its operating point is that of the first run */
    double *u0, *y0;           /**< [runs * (nu + nd)], [runs * ny] the operating point of each run */
    double *K;                 /**< [nx * ny] */
    double *covariance;        /**< [ny * ny] of the errors a sample ahead */
    size_t na, nb;             /**< lags of y and of u; else 0 */
    size_t *delay;             /**< [ny * (nu + nd)] the first lag of u; else 0 */
};
APC_API void apc_identified_destroy(struct apc_identified *model); /**< NULL is legal. [setup] */

/** Zero means default. */
struct apc_identify_arx_options {
    size_t size;
    bool fir;         /**< no lags of y: na is 0 */
    size_t na, nb;    /**< 0: those that predict held-out data best, 8 at most, nb of an fir 100 */
    size_t delay_max; /**< samples; default 20, of an fir the least */
    bool direct;      /**< u may act on y of the same sample: delays from 0 on; else from 1 on, and D is 0 */
};
/**
 * y[k] = the sum of A_i y[k-i], i = 1..na, and of B_ij u_j[k-d_j-i], i = 0..nb-1, by least squares. Delays
 * are those that leave least; orders those whose free run over the last third of each run is best, before
 * all of it is used. [setup] Returns 0, APC_EINVAL as of apc_record_check(), APC_ESOLVER: it would rest far
 * from what was on record; APC_ENOMEM.
 */
APC_API int apc_identify_arx(struct apc_identified **model, const struct apc_record *record,
                             const struct apc_identify_arx_options *options, struct apc_error *why);

/** Zero means default. */
struct apc_identify_subspace_options {
    size_t size;
    size_t order; /**< 0: the one whose free run over the last third of each run is best, 10 at most */
    size_t rows; /**< how many samples past and future hang together; default 15, or what the record allows */
    bool direct; /**< u may act on y of the same sample; else D is 0 */
    bool deviations; /**< from an operating point, known: none is looked for */
};
/**
 * State space: A and C by PO-MOESP (Verhaegen, Automatica 30, 1994), the rest by least squares with the
 * errors of a long autoregression as what disturbs it. [setup] Returns 0; APC_EINVAL as of apc_record_check()
 * or too short a record; APC_ESOLVER: the plant is unstable, or would rest far from what was on record;
 * APC_ENOMEM.
 */
APC_API int apc_identify_subspace(struct apc_identified **model, const struct apc_record *record,
                                  const struct apc_identify_subspace_options *options, struct apc_error *why);

/* ---- Parameters of a model of differential equations ---------------------------------------------- */

struct apc_model;
struct apc_plant_options;

/** What is known of a parameter beforehand: normally distributed. */
struct apc_prior {
    double mean, deviation; /**< deviation 0: nothing */
};
/** What is sought, and where the search begins. */
struct apc_parameters {
    size_t size;
    const struct apc_model *model;         /**< no FMU */
    const double *p, *x0;                  /**< [np], [nx]; NULL: the model's own */
    const struct apc_plant_options *plant; /**< how it is integrated, and its dead time; NULL: the defaults */
    const size_t *which;                   /**< [n] parameters that are sought, from 0; np: the dead time */
    size_t n;
    const size_t *input;  /**< [nu + nd] which of the model's inputs, disturbances behind them, each of the
                               record's is; the others are as the model has them. NULL: the first ones */
    const size_t *output; /**< [ny] likewise */
    size_t until;         /**< fitted to that many samples, of each run its share; 0: all */
    const struct apc_prior *prior; /**< [n]; NULL: nothing is known beforehand */
};
/**
 * The parameters with which the model's free run fits the record best. Least squares by Gauss and Newton's
 * iteration with Marquardt's damping; errors are whitened by an autoregression and weighted by each output's
 * scatter. The unknowns are the parameters sought, the state at the start of each run and, where there is a
 * dead time, the inputs before that start. The model may be nonlinear; searches start from the given values
 * and beside them, until two of them end alike. With priors it is the most probable value after the record (MAP).
 * @p value, @p error [n]: the result, and standard errors. @p x0 [runs * nx]: where each run began; @p run [n
 * * ny]: the model's outputs, also for samples that it was not fitted to; both may be NULL. [setup] Returns
 * 0, APC_ENOMEM, APC_EINVAL (no record, no such parameter, an FMU, a start out of range) or APC_ESOLVER: the
 * record is too poor, or a parameter cannot be found. Such a parameter has no effect, or only the effect of
 * others, which are named, or goes to its limit.
 */
APC_API int apc_identify_parameters(const struct apc_record *record, const struct apc_parameters *sought,
                                    double *value, double *error, double *x0, double *run,
                                    struct apc_error *why);

/** White noise, of a state or a measurement. */
struct apc_noise {
    double deviation; /**< of a state: of a random walk in 1 s; 0: the record shows none */
    double error;     /**< standard error of its logarithm; NAN: the deviation is an upper limit only */
};
/** NAN: it has no end on that side within the parameter's limits. */
struct apc_interval {
    double low, high;
};
/** Zero means default. */
struct apc_likelihood {
    size_t size;
    const size_t *noisy; /**< [n_noisy] states with process noise, from 0; n_noisy 0: all */
    size_t n_noisy;
    struct apc_noise *process;  /**< [n_noisy, or nx] result, required */
    struct apc_noise *measured; /**< [ny] likewise */
    double *white; /**< [ny] the probability that innovations as white as those are not; or NULL */
    double value;  /**< logarithm of the likelihood; priors have no part in it */
    struct apc_interval *profile; /**< [n] 95 % intervals of the profile likelihood; NULL: not asked for */
};
/**
 * The same by maximum likelihood, of dx = f dt + process noise, y = g + white noise. The likelihood's logarithm
 * is the sum over all measurements of -(log(2 pi S) + v^2/S)/2. v is what the extended Kalman filter did not
 * expect, from all measurements before, and S its variance (Kristensen, Madsen and Jorgensen, Automatica 40,
 * 2004). Also for plants that drift or are unstable. Unknowns are the parameters sought, of which there may be none, the noises,
 * and x0 of each run, uncertain by what noise makes of it in a period. Fisher's scoring finds them, from where
 * apc_identify_parameters() ends. @p error is from Fisher's information. An interval of the profile likelihood ends where
 * the logarithm, priors and all, is 1.92 less with the parameter there and all else as suits best; it need not lie evenly around the value. Returns as that function; also
 * APC_ESOLVER where a noisy state acts on nothing measured. [setup]
 */
APC_API int apc_identify_likelihood(const struct apc_record *record, const struct apc_parameters *sought,
                                    struct apc_likelihood *of, double *value, double *error, double *x0,
                                    double *run, struct apc_error *why);

/* ---- Validation ------------------------------------------------------------------------------------ */

/** How well a model fits a record, for one output. NAN: unknown. */
struct apc_validation {
    double fit;         /**< %, running freely: 100 (1 - |y - model| / |y - mean of y|) */
    double ahead;       /**< the same, a sample ahead; NAN without a K */
    double white;       /**< the probability that errors as white as that are not */
    double independent; /**< the probability that errors as independent of the inputs as that are not; of
                             the same sample's where they act at once */
};
/**
 * Validate on samples from @p from on, with those before as the model's past; of several runs on that share
 * of each, all of them around the model's operating point. Where the
 * model was before, and its inputs, is what fits best: with @p K [nx * ny] of an apc_identified at the first
 * sample, of errors a sample ahead; NULL: at @p from, of the free run. @p run [n * ny]: the free
 * run, NAN before from and where y is; or NULL. [setup] Returns 0, APC_EINVAL (other dimensions, another
 * period, fewer than 20 samples to validate on), APC_ENOMEM.
 */
APC_API int apc_validate(const struct apc_linear *model, const double *K, const struct apc_record *record,
                         size_t from, struct apc_validation *of, double *run, struct apc_error *why);

#ifdef __cplusplus
}
#endif
#endif

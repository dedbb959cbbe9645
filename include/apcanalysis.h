/* SPDX-License-Identifier: BSD-3-Clause */
/**
 * @file apcanalysis.h
 * A closed loop as it ticks: a linear plant in continuous time, controllers that compute at their ticks from
 * older measurements, outputs that act later still. How much of a change it tolerates, how it answers to each
 * frequency, and how far noise moves it.
 *
 * All of it follows from one map: what a period of ticks makes of the state of plant, laws and everything
 * under way. Nothing is made up of half periods and Pade approximations.
 */
#ifndef APCANALYSIS_H
#define APCANALYSIS_H

#include "apcbase.h"

#ifdef __cplusplus
extern "C" {
#endif

/** dx/dt = A x + B u, y = C x + D u. */
struct apc_loop_plant {
    size_t nx, nu, ny;
    const double *A, *B, *C, *D;
    apc_ns dead_time;     /**< by which inputs act later */
    apc_ns period;        /**< it is disturbed, and looked at for its cost, that often; > 0 */
    const double *noise;  /**< [nx] standard deviation of a random walk in 1 s, a step each period; or NULL */
    const double *sensor; /**< [ny] standard deviation of a measurement's error; or NULL */
};

/** What a controller's input is. */
struct apc_loop_source {
    enum apc_loop_from {
        APC_FROM_NONE = 0,    /**< constant */
        APC_FROM_MEASUREMENT, /**< the plant's, as sampled for this tick */
        APC_FROM_OUTPUT,      /**< an output, over all controllers, as it acts now */
        APC_FROM_OWN          /**< its own output, from 0, that it computed last */
    } from;
    size_t number;
};

#define APC_LOOP_NOWHERE ((size_t)-1)

/** At each tick u = C x + D in, then x = A x + B in. */
struct apc_loop_controller {
    size_t nx, n_in, nu;
    const double *A, *B, *C, *D;
    const struct apc_loop_source *in; /**< [n_in] */
    const size_t *to; /**< [nu] input of the plant, from 0, or APC_LOOP_NOWHERE: others read it */
};

/** One tick of a controller. Times from the beginning of the period; what lies beyond it, or before, wraps. */
struct apc_loop_tick {
    size_t controller;
    apc_ns sampled;  /**< <= computed, and not before that of its controller's last tick: when the plant was
                        as the measurements say */
    apc_ns computed; /**< within 0 .. period; ticks are in this order */
    apc_ns written;  /**< >= computed: when other controllers see the outputs */
    apc_ns acts;     /**< >= computed: when the plant's inputs begin to change, but for its dead time;
                        INT64_MAX: never, the command was lost */
};

struct apc_loop_setup {
    size_t size;
    struct apc_loop_plant plant;
    size_t n_controllers;
    const struct apc_loop_controller *controller;
    apc_ns period; /**< after which all begins again */
    size_t n_ticks;
    const struct apc_loop_tick *tick;
};

/** Outputs over all controllers are numbered from 0, controller after controller. */
struct apc_loop;

/** A copy of all of it. [setup] Returns 0, APC_EINVAL, APC_ERANGE (more than 600 states), APC_ENOMEM. */
APC_API int apc_loop_create(struct apc_loop **loop, const struct apc_loop_setup *setup,
                            struct apc_error *why);
APC_API void apc_loop_destroy(struct apc_loop *loop);         /**< NULL is legal. [setup] */
APC_API size_t apc_loop_states(const struct apc_loop *loop);  /**< of the map. [any] */
APC_API size_t apc_loop_outputs(const struct apc_loop *loop); /**< of all controllers. [any] */
/** Eigenvalues of the map: @p re, @p im [apc_loop_states()], the largest first; the loop is stable where all
 * are within the unit circle. [setup] Returns 0, APC_ESOLVER or APC_ENOMEM. */
APC_API int apc_loop_poles(const struct apc_loop *loop, double *re, double *im);

#define APC_LOOP_WHOLE ((size_t)-1)

/** HUGE_VAL: no limit was found; NAN: unknown. */
struct apc_loop_margins {
    size_t size;
    bool stable;     /**< as it is; nothing else is said of one that is not */
    double gain_low; /**< by less than this factor the loop must not be weakened; 0: by any */
    double gain;     /**< by more than this it must not be strengthened */
    double phase;    /**< degrees that it may lag more, or lead more, whichever is less */
    double delay;    /**< s that outputs may act later, all the time; exact, not phase over frequency */
    double jitter;   /**< s by which they may act later now and then, in whatever pattern: enough, by small
                          gain, not needed (Kao and Lincoln, Automatica 40, 2004) */
    double sensitivity, at; /**< the peak of 1 / (1 + L), and its frequency in rad/s */
    double complementary;   /**< the peak of L / (1 + L) */
    double crossover;       /**< rad/s, the highest at which |L| is 1; NAN: nowhere */
};
/**
 * The margins at output @p of, the others being closed. APC_LOOP_WHOLE: at all outputs at once that the plant
 * takes, with the same change in each; then the peaks are those of the largest singular values, outputs
 * measured in @p scale [apc_loop_outputs()] (NULL: 1). Margins are found where an eigenvalue of the map
 * reaches the unit circle, up to factors of 1000; a delay has no such limit. [setup] Returns 0, APC_EINVAL,
 * APC_ESOLVER, APC_ENOMEM.
 */
APC_API int apc_loop_margins(const struct apc_loop *loop, size_t of, const double *scale,
                             struct apc_loop_margins *margins, struct apc_error *why);
/** The same without the margins, which take many times as long: gain, phase, delay, jitter are NAN. [setup] */
APC_API int apc_loop_peaks(const struct apc_loop *loop, size_t of, const double *scale,
                           struct apc_loop_margins *margins, struct apc_error *why);

/**
 * L at @p n frequencies @p w rad/s, into @p re, @p im [n]. The loop is cut open at output @p of, the others
 * are closed; L has the sign that makes 1 + L the return difference. It is NAN on a pole. A controller that
 * ticks several times in the period: L is what comes back at that frequency. [setup] Returns 0, APC_EINVAL,
 * APC_ENOMEM.
 */
APC_API int apc_loop_response(const struct apc_loop *loop, size_t of, size_t n, const double *w, double *re,
                              double *im);

/* ---- Under noise ----------------------------------------------------------------------------- */

/** One of several schedules that a period takes, chosen at each period. */
struct apc_loop_schedule {
    double probability;
    size_t n_ticks;
    const struct apc_loop_tick *tick; /**< nothing of it may lie beyond the period */
};
/**
 * The mean squares in steady state, averaged over the plant's periods: @p y [ny] of the plant's outputs,
 * without the errors of sensors, @p u [outputs] of the outputs that act. By the recursion of the covariance
 * (Nilsson, Real-Time Control Systems with Delays, 1998; Lincoln and Cervin, Jitterbug, CDC 2002): no random
 * number is drawn. @p schedule NULL: the loop's own ticks, in each period. [setup] Returns 0; APC_ESOLVER: it
 * grows without bound; APC_EINVAL, APC_ENOMEM.
 */
APC_API int apc_loop_cost(const struct apc_loop *loop, const struct apc_loop_schedule *schedule, size_t n,
                          double *y, double *u, struct apc_error *why);

#ifdef __cplusplus
}
#endif
#endif

/* SPDX-License-Identifier: BSD-3-Clause */
/**
 * @file apcrun.h
 * A run as a library: an experiment file, its simulation in virtual time, what an operator does meanwhile,
 * and the figures of how well each loop was controlled. examples/run/run.c has all of it in thirty lines.
 *
 * One thread at a time uses an experiment or a simulation; several simulations run in threads beside each
 * other.
 */
#ifndef APCRUN_H
#define APCRUN_H

#include "apcstore.h"

#ifdef __cplusplus
extern "C" {
#endif

/* ---- Experiments -------------------------------------------------------------------------- */

struct apc_experiment;

/**
 * Load the experiment @p file, or that of a run folder with what was in force there. With a @p text that is
 * what the file says; @p file is then only named in messages, and where relative paths begin.
 * docs/experiment-file.md describes it. Returns 0, or a negative error with "FILE:LINE: ..." in @p why, and
 * *e is NULL. apc_experiment_destroy() frees it. [setup]
 */
APC_API int apc_experiment_load(struct apc_experiment **e, const char *file, const char *text,
                                struct apc_error *why);
/** NULL is legal. Simulations go on. [setup] */
APC_API void apc_experiment_destroy(struct apc_experiment *e);

/**
 * Change or add one setting: "duration", "plant.parameters.tau", "outputs.u1.high", "controller.law",
 * "controller.Kp" or, of several outputs, "controller.u1.Kp", "scheduler.sequence.[0].[1]": groups by member,
 * lists by name or [INDEX] from 0. Groups that are missing on the way are created. @p value is written as in
 * a file; text may go without its quotes. The whole is checked as if it stood in a file. Returns 0, or a
 * negative error with the reason in @p why, and nothing is changed: APC_ENOTFOUND, APC_EINVAL, APC_ENOMEM.
 * Simulations that there are keep what they have. [setup]
 */
APC_API int apc_experiment_set(struct apc_experiment *e, const char *path, const char *value,
                               struct apc_error *why);

/**
 * The file's text that is in force, up to @p size bytes with its terminator (NULL and 0: none): as it was
 * written until apc_experiment_set() has changed it, then without its comments. Returns its length. [setup]
 */
APC_API int64_t apc_experiment_text(const struct apc_experiment *e, char *text, size_t size);

/**
 * Describe the experiment in a store: dimensions, names, first tuning and mode; with @p reset also over what
 * is there, as `apc run` does. Returns 0, APC_EPERM (the store belongs to another experiment), or the store's
 * error, with a text in @p why. [setup]
 */
APC_API int apc_experiment_provision(const struct apc_experiment *e, struct apc_store *store, int reset,
                                     struct apc_error *why);

/* ---- Simulations -------------------------------------------------------------------------- */

struct apc_simulation;

/** Zero: default. */
struct apc_simulation_options {
    size_t size;
    uint64_t seed; /**< of all that is random; 0: the experiment's */
};

/**
 * The experiment at t = 0, nothing of it done. @p options NULL: defaults. Returns 0, or a negative error with
 * the reason in @p why, and *s is NULL. apc_simulation_destroy() frees it. [setup]
 */
APC_API int apc_simulation_create(struct apc_simulation **s, const struct apc_experiment *e,
                                  const struct apc_simulation_options *options, struct apc_error *why);
APC_API void apc_simulation_destroy(struct apc_simulation *s); /**< NULL is legal. [setup] */

/**
 * Go on until @p until, in s since t = 0; 0: to the end of the experiment's duration. Events at that very
 * instant are left for the next call; a time that is past does nothing. Returns 0, or why it cannot go on
 * (APC_ESOLVER: the plant diverged, ...), which it then always returns. [setup]
 */
APC_API int apc_simulation_run(struct apc_simulation *s, double until);
/** How far it has come, in s since t = 0. [setup] */
APC_API double apc_simulation_time(const struct apc_simulation *s);

/**
 * Set a setpoint, a tuning parameter or, by the name of an output, what goes out in mode Man, as an operator
 * would just now. Returns 0, APC_ENOTFOUND, APC_ERANGE or another error. Whether it is taken is seen by what
 * follows, as in a plant. A setpoint that a controller or the scheduler moves is Local then. [setup]
 */
APC_API int apc_simulation_write(struct apc_simulation *s, const char *name, double value);
/** Ask for a mode of a loop, by its output or as "upper.r1" by controller and output, or of all loops of a
 * controller. Returns 0, APC_ENOTFOUND, APC_EINVAL (a mode that cannot be requested, or not of this loop).
 * [setup]
 */
APC_API int apc_simulation_mode(struct apc_simulation *s, const char *loop_or_controller, enum apc_mode mode);
/** Do @p what. Controller @p name: "kill", as kill -9 does at any moment, and "start" again; "promote", which
 * makes it the active one of several for the same outputs. Setpoint @p name: "local" makes it Local with its
 * present value; "remote" lets the controller above or the scheduler move it again. Returns 0, APC_ENOTFOUND,
 * APC_EINVAL (another @p what, a setpoint that is always Local, or a controller without a shadow), or why it
 * cannot be started. [setup] */
APC_API int apc_simulation_do(struct apc_simulation *s, const char *what, const char *name);
/** The newest value of a measurement, setpoint, output or parameter. Returns 0, APC_ENOTFOUND (no such name,
 * or there is no value yet) or another error. [setup] */
APC_API int apc_simulation_read(const struct apc_simulation *s, const char *name, struct apc_value *value);

/** The store of the simulation: all its rows and events, and the names of its variables. Lives as long as the
 * simulation; times are from 2000-01-01 on. [setup] */
APC_API struct apc_store *apc_simulation_store(struct apc_simulation *s);
/** Why the last call that failed did. Lives until the next one. [setup] */
APC_API const char *apc_simulation_error(const struct apc_simulation *s);

/** How well one loop was controlled, from an event (a new setpoint or disturbance) to the next. NAN: there is
 * no such number; HUGE_VAL: it never came to an end. */
struct apc_figure {
    size_t size;            /**< sizeof (struct apc_figure), in the first one of an array */
    char loop[APC_TAG_LEN]; /**< its measurement; of several controllers its own name: "u1", "upper.r1" */
    char event[200];        /**< "r 10 -> 20"; "all": of the whole run */
    double from, until;     /**< s since t = 0 */
    double iae, ise, itae;  /**< integrals of |r - z|, its square, and of the time since the event by it */
    double overshoot;       /**< of a step: beyond the new setpoint, in % of the step */
    double settling;        /**< of a step: s until z stays within 5 % of it */
    double peak, recovery;  /**< of what is no step: the largest |r - z|, and s until z stays near r */
    double effort;          /**< sum of all changes of what the plant was given */
    double without;         /**< % of the time without control */
};
/** The figures until now: of each loop the whole run, then its events. @p figures NULL: none are wanted.
 * Returns how many there are, of which the first @p capacity are filled in, or a negative error. [setup] */
APC_API int apc_simulation_figures(const struct apc_simulation *s, struct apc_figure *figures,
                                   size_t capacity);

#ifdef __cplusplus
}
#endif

#endif

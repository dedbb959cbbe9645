/* SPDX-License-Identifier: BSD-3-Clause */
#ifndef APC_CONTROL_INTERNAL_H
#define APC_CONTROL_INTERNAL_H

#include "apccontrol.h"

/* ---- A law as a controller runs it ----------------------------------------------------------- */

/**
 * The instances of a law: one, number 0, of a law that is whole; else one for each output, instance k for
 * output k. In every call below @p call is the controller's: its dimensions, all its y, z, d, tuning, x, u,
 * published and so on, in the controller's order. This object knows which parts instance k sees, and hands it
 * those alone. What a caller does not know may be NULL. self and size need not be set; n_ahead is
 * apc_instances_size.n_ahead.
 *
 * x is the instances' states one after another, published what they publish, the tuning as
 * apc_law_parameters() has it. A loop by itself is asked so, at each tick of its controller:
 *
 *     apc_instances_track(s, k, &call);       where the last u[k] was not the law's
 *     apc_instances_compute(s, k, &call);     into call.u[k], call.limited[k]
 *     ...                                     call.u[k] goes out
 *     apc_instances_update(s, k, &call);
 */
struct apc_instances;

/**
 * Check the law and what it is made from, make its instances. Nothing in @p setup is used after it. [setup]
 * Returns 0, or a negative error with the reason, *@p instances is then NULL.
 */
int apc_instances_create(struct apc_instances **instances, const struct apc_law *law,
                         const struct apc_law_setup *setup, struct apc_error *why);
void apc_instances_destroy(struct apc_instances *instances); /**< NULL is legal. [setup] */

/** Of all instances together. */
struct apc_instances_size {
    size_t instances; /**< 1, or one for each output */
    size_t states;    /**< of x */
    size_t tuning;    /**< apc_law_parameters() */
    size_t n_ahead;   /**< rows of z and d, 1 at least: what the instance that looks furthest asked for */
    size_t published; /**< numbers */
};
/** It stays as it is from creation on. [tick] */
struct apc_instances_size apc_instances_size(const struct apc_instances *instances);

/** Where instance k has its part of what is laid out one after another. */
struct apc_instance_part {
    size_t u, nu;                     /**< its outputs: from number u, from 0, on */
    size_t x, states;                 /**< of x */
    size_t published, n;              /**< of published; how many numbers */
    size_t n_published;               /**< how many variables they are */
    const struct apc_published *what; /**< [n_published]; the instance's */
};
const struct apc_instance_part *apc_instances_part(const struct apc_instances *instances, size_t k);

/** What belongs to output @p output, as the law says; the object's. Of an instance for an output it is all
 * that it sees. [tick] */
const struct apc_law_ports *apc_instances_ports(const struct apc_instances *instances, size_t output);

/** A mark of law, version, settings, model, period and dimensions, and of a plug-in's code: whose x it is.
 * [tick] */
uint32_t apc_instances_mark(const struct apc_instances *instances);

/** As apc_law_parameter_at(), looked up beforehand. [tick] */
struct apc_law_parameter apc_instances_parameter(const struct apc_instances *instances, size_t i);

/** May all have @p tuning: each parameter within its limits, and all of them together as the law says? [tick]
 * Returns 0, or APC_ERANGE or the law's own error with the reason. */
int apc_instances_check(struct apc_instances *instances, const double *tuning, struct apc_error *why);

/** Whoever calls with one call again and again may say so: from now on its arrays, all but u, limited, out,
 * why, say and y_limited, stay where they are. It lasts until somebody calls with another. [setup] */
void apc_instances_keep(struct apc_instances *instances, const struct apc_law_call *call);

/** Fill the x of instance k anew. [tick] */
void apc_instances_reset(struct apc_instances *instances, size_t k, const struct apc_law_call *call);
/**
 * Its u, limited and published, from the same. Returns enum apc_law_result; APC_LAW_FAILED also where u or x
 * is no finite number (u may then be anything), and where the law returned what is no result. call.why (NULL:
 * nobody asks) says what the law did, or "" where it said nothing. [tick]
 */
int apc_instances_compute(struct apc_instances *instances, size_t k, const struct apc_law_call *call);
void apc_instances_update(struct apc_instances *instances, size_t k,
                          const struct apc_law_call *call); /**< [tick] */
void apc_instances_track(struct apc_instances *instances, size_t k,
                         const struct apc_law_call *call); /**< [tick] */

/** The terms of output @p i, after apc_instances_compute(): as apc_controller_terms(). [any] */
size_t apc_instances_terms(struct apc_instances *instances, size_t i, const struct apc_law_call *call,
                           struct apc_law_term *term, size_t most);

/* ---- For laws -------------------------------------------------------------------------------- */

size_t apc_pi_terms(const struct apc_law_call *c, struct apc_law_term *term, size_t most);
size_t apc_pid_terms(const struct apc_law_call *c, struct apc_law_term *term, size_t most);
/** Of `mpc` and `nmpc`, for output @p i. */
size_t apc_mpc_terms(const struct apc_law_call *c, size_t i, struct apc_law_term *term, size_t most);

/** Check a law from outside; @p from, its path or name, begins the error's text. Returns 0 or APC_EINVAL. */
int apc_law_check(const struct apc_law *law, const char *from, struct apc_error *why);

/** Of the setting of that name, which must be @p n numbers of variables, each of @p least .. @p most, number
 * @p i to
 * *@p to; where it is absent that stays. Returns 0 or APC_EINVAL. */
int apc_setting_index(const struct apc_law_setup *setup, const char *name, size_t n, size_t i, size_t least,
                      size_t most, size_t *to, struct apc_error *why);
/** The setting of that name as @p n numbers that are not negative; where it is absent @p to stays. */
int apc_setting_amounts(const struct apc_law_setup *setup, const char *name, size_t n, double *to,
                        struct apc_error *why);

/** For the check of a law whose parameters are all of the output: parameter @p lower must not be above
 * parameter
 * @p upper. [tick] Returns 0 or APC_ERANGE. */
int apc_law_check_order(const struct apc_law *law, const struct apc_law_setup *setup, const double *tuning,
                        size_t lower, size_t upper, struct apc_error *why);

/** @p u within @p low and @p high (high wins); adds to *@p limited what was cut. [tick] */
double apc_law_cut(double u, double low, double high, unsigned *limited);
/** Would @p increment drive an output further the way that @p limited says it cannot go? [tick] */
static inline bool apc_law_blocks(unsigned limited, double increment)
{
    return (increment > 0.0 && (limited & APC_LIMITED_HIGH)) ||
           (increment < 0.0 && (limited & APC_LIMITED_LOW));
}
/** The bits for what moves the other way: high is low. [tick] */
static inline unsigned apc_law_mirrored(unsigned limited)
{
    return (limited & APC_LIMITED_LOW ? APC_LIMITED_HIGH : 0u) |
           (limited & APC_LIMITED_HIGH ? APC_LIMITED_LOW : 0u);
}

#endif

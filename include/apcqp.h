/* SPDX-License-Identifier: BSD-3-Clause */
/**
 * @file apcqp.h
 * Small dense quadratic programs, solved again and again: what a predictive controller asks at each tick.
 *
 *     minimise  x'Hx / 2 + f'x    subject to    low <= (x, Ax) <= high
 *
 * H [n*n] is positive semidefinite, A [m*n]; both row after row, of H the lower triangle is read. low and high
 * [n+m] have x's own bounds first; -INFINITY and INFINITY are none, equal ones an equation. A row may be
 * soft: it may be violated by e, at the cost linear e + square e^2 / 2.
 *
 * Dual active set (Goldfarb and Idnani 1983) on the factor of the least-distance form with LDL' updates, as
 * in Arnstrom, Bemporad and Axehill (2022): each solve begins from the working set of the former one.
 * At the end x is computed again from the final working set by one fixed factorisation. So its bits depend on
 * that set alone, not on the way there or the compiler; the residuals are computed after that.
 *
 * A singular H, also 0, is solved by proximal points (Rockafellar 1976). A step is the method above for H + E
 * and f - E c, E being diagonal and 1e-5 of H, from the former one's working set. c is 0 at first, so the
 * bits do not depend on the solve before. Then it is x, or, while the working set stays, what conjugate
 * gradients make of it. Steps end where |Hx + f + (I, A')multipliers| is at most 1e-10 of its largest terms;
 * after 200 1e-9 is optimal as well. The objective is above the least by no more than that residual times the
 * way to the least x. Of several x that are least one comes back. Linear programs and H of zeros and numbers of
 * one size take 2 to 4 steps, eigenvalues over ten decades up to 100. Where rounding leaves no answer, or says
 * that rows contradict, E is taken 100 and 10 000 times as large: each takes a factorisation, of order n^3.
 * H counts as singular where a pivot is below 2e-11 n of its diagonal, and as indefinite from -2e-13 n on.
 *
 * All memory is made at creation. One qp belongs to one thread at a time.
 */
#ifndef APCQP_H
#define APCQP_H

#include "apcbase.h"

#ifdef __cplusplus
extern "C" {
#endif

struct apc_qp;

/** Zero means default. */
struct apc_qp_options {
    size_t size;                   /**< sizeof(struct apc_qp_options) */
    unsigned iterations;           /**< most changes of the working set in one solve; default 10 (n + m) */
    double tolerance;              /**< of feasibility, in the rows' units, beside rounding; default 1e-9 */
    const double *linear, *square; /**< [n + m] weights, >= 0; both 0: a hard row; NULL: all 0. Copied */
    bool (*enough)(void *ctx);     /**< asked at each change; true ends the solve with APC_QP_LIMIT */
    void *ctx;
    bool definite; /**< refuse an H that is singular: for who wants one x, not one of several */
};

enum apc_qp_status {
    APC_QP_OPTIMAL = 1, /**< residuals were looked at */
    APC_QP_LIMIT,       /**< of iterations or time: x of the best multipliers so far, see primal */
    APC_QP_INFEASIBLE,  /**< apc_qp_rows() has the rows that contradict each other */
    APC_QP_NUMBERS,     /**< rounding, or a number that is none: no answer that can be vouched for */
    APC_QP_UNBOUNDED    /**< the objective falls without end; apc_qp_rows() has the variables that run off */
};

struct apc_qp_result {
    size_t size; /**< sizeof(struct apc_qp_result), set by the caller */
    enum apc_qp_status status;
    unsigned iterations; /**< changes of the working set */
    unsigned active;     /**< rows at a limit, or beyond a soft one */
    double objective;    /**< x'Hx / 2 + f'x */
    double soft;         /**< cost of the soft rows' violations */
    double primal;       /**< largest violation of a hard row, in its unit */
    double dual;         /**< largest |Hx + f + (I, A')multipliers| */
    double gap;          /**< largest |multiplier x distance| where one of the two ought to be 0 */
    unsigned steps;      /**< proximal ones; 0 where H is positive definite */
};

/**
 * Room for @p n variables and @p m rows. [setup] Returns 0; APC_EINVAL (n = 0, too large, an option),
 * APC_ENOMEM; *@p qp is NULL then. Goes back with apc_qp_destroy().
 */
APC_API int apc_qp_create(struct apc_qp **qp, size_t n, size_t m, const struct apc_qp_options *options,
                          struct apc_error *why);
APC_API void apc_qp_destroy(struct apc_qp *qp); /**< NULL is legal. [setup] */

/**
 * New H [n*n] and A [m*n] (NULL where m is 0); both are copied. The working set stays. [tick], of order
 * n^2 (n + m). Returns 0; APC_EINVAL where a number is none, or H is not positive semidefinite (definite, where
 * the options say so). @p why (may be NULL) has the pivot, and there is nothing to solve until the next one.
 */
APC_API int apc_qp_set(struct apc_qp *qp, const double *H, const double *A, struct apc_error *why);

/**
 * Solve for f [n], low and high [n+m] into x [n], which is finite whatever comes back. [tick] @p result may
 * be NULL. Returns 0 when optimal; APC_ETIMEDOUT (limit), APC_ERANGE (infeasible, also low above high;
 * unbounded), APC_ESOLVER (numbers), APC_EINVAL (NaN, or no H yet; status APC_QP_NUMBERS, x stays if finite).
 */
APC_API int apc_qp_solve(struct apc_qp *qp, const double *f, const double *low, const double *high, double *x,
                         struct apc_qp_result *result);

/** [n + m], the qp's own: -1 at low, 1 at high, 0 free; infeasible: the rows that contradict; unbounded:
 * of x where it runs to, 0 of the rows of A. [tick] */
APC_API const signed char *apc_qp_rows(const struct apc_qp *qp);
/** [n + m], the qp's own: > 0 at high, < 0 at low, 0 free. [tick] */
APC_API const double *apc_qp_multipliers(const struct apc_qp *qp);

/** The working set [n + m] that the next solve begins from, as of apc_qp_rows(); NULL: empty. [tick] */
APC_API void apc_qp_start(struct apc_qp *qp, const signed char *rows);

/** New weights [n + m] of soft rows, NULL: all 0. [tick] Returns 0, or APC_EINVAL (negative, not finite). */
APC_API int apc_qp_soft(struct apc_qp *qp, const double *linear, const double *square);

#ifdef __cplusplus
}
#endif
#endif

/* SPDX-License-Identifier: BSD-3-Clause */
#ifndef APC_IDENTIFY_INTERNAL_H
#define APC_IDENTIFY_INTERNAL_H

#include "apcidentify.h"

/* ---- decompose.c ---------------------------------------------------------------------------------- */

/* Of two columns of a record, as apc_matrix_dot(), eight sums at a time: one sum alone waits for itself. */
double apc_column_dot(const double *a, const double *b, size_t n);

/*
 * Columns from to to-1 of Q [n rows, column after column] become orthonormal, to those before, which are, and
 * to each other; what they were is Q R, with R [width * width], row after row, of which these columns are
 * written. A column that depends on those before becomes zeros, as does R's diagonal there.
 */
void apc_qr_extend(size_t n, size_t from, size_t to, double *Q, double *R, size_t width);
/* R x = b for the first @p p; x is 0 where the diagonal is. */
void apc_qr_solve(size_t p, const double *R, size_t width, const double *b, double *x);
/* g'(R'R)^-1 g, g [p] becoming R'^-1 g; HUGE_VAL where that is none. */
double apc_qr_variance(size_t p, const double *R, size_t width, double *g);
/*
 * The step that Marquardt damps: least squares of [R; damping D] step = [b; 0], D the lengths of R's columns.
 * R [m * m] within rows of @p width. S [2 m * (m + 1)] and T [m * m] are room, step [2 m], of which m are it.
 */
void apc_qr_damped(size_t m, const double *R, size_t width, const double *b, double damping, double *S,
                   double *T, double *step);
/* R of a matrix that is given row by row. */
struct apc_triangle {
    size_t width, room, filled;
    size_t n; /* rows that were given */
    double *Q, *R;
};
int apc_triangle_open(struct apc_triangle *rows, size_t width); /* 0 or APC_ENOMEM */
void apc_triangle_add(struct apc_triangle *rows, const double *row);
void apc_triangle_end(struct apc_triangle *rows); /* R [width * width] is that of all rows */
void apc_triangle_close(struct apc_triangle *rows);

/*
 * A [m rows, n columns, column after column], m >= n, becomes U, with A = U S V': s [n] falling, V [n * n]
 * column after column. One-sided Jacobi.
 */
void apc_svd(size_t m, size_t n, double *A, double *s, double *V);

/* ---- statistics.c --------------------------------------------------------------------------------- */

/* The probability that a chi-squared number of @p k degrees of freedom is above @p x. */
double apc_chi2_above(double x, double k);
/*
 * The autoregression e[k] = a[0] e[k-1] + ... + what is white, of the order <= most that Schwarz' criterion
 * chooses; e [n] may have NAN. Returns the order, or APC_ENOMEM.
 */
int apc_autoregression(const double *e, size_t n, size_t most, double *a);
/* out[k] = x[k] - a[0] x[k-1] - ...; NAN where one of them is, or is before the first. */
void apc_whiten(const double *x, size_t n, const double *a, size_t order, double *out);

/* ---- record.c ------------------------------------------------------------------------------------- */

/* Is there a record, and are its numbers some? Returns 0 or APC_EINVAL. */
int apc_record_check_shape(const struct apc_record *r, struct apc_error *why);
/* Samples of the shortest and of the longest run. */
size_t apc_record_shortest(const struct apc_record *r);
size_t apc_record_longest(const struct apc_record *r);
/* How far x [n], numbers that are @p stride apart, goes in a run at most. */
double apc_record_reach(const struct apc_record *r, const double *x, size_t stride);
/* Is @p at among them in that run, or beside them by no more than half of how far they go in any? */
bool apc_record_near(const struct apc_record *r, size_t run, const double *x, size_t stride, double at);
/* Is the operating point of each run, u0 [runs * (nu + nd)], y0 [runs * ny], near what was on record? 0 or
 * APC_ESOLVER. */
int apc_record_check_point(const struct apc_record *r, const double *u0, const double *y0,
                           struct apc_error *why);

/*
 * What an input was before a run is sought as levels: one of each of the last samples before it, the oldest
 * of all that is older. LEVELS are the most.
 */
#define LEVELS 16
/* The number of levels to try after @p levels, or 0: no more are worth it where the dead time is @p periods
 * long. */
size_t apc_record_more_levels(size_t levels, double periods);

/* ---- identified.c --------------------------------------------------------------------------------- */

/* With room for K, covariance, delay, and a linear model of zeros. Returns 0, APC_EINVAL, APC_ENOMEM. */
int apc_identified_create(struct apc_identified **model, const struct apc_record *r, size_t nx,
                          struct apc_error *why);
/* How badly the model's free run goes with r from @p from on, that share of each run: root mean square of the
 * errors of all outputs, each relative to its deviation. HUGE_VAL: it runs away. Negative: an error. */
double apc_identified_misfit(const struct apc_identified *model, const struct apc_record *r, size_t from);
/* The probability that errors as white as e [n] are not; it may have NAN. */
double apc_white_probability(const double *e, size_t n);
/* The growth of x[k+1] = A x[k] a step: the spectral radius. [n * n], work [2 * n * n] */
double apc_spectral_radius(size_t n, const double *A, double *work);

/* ---- lag.c ---------------------------------------------------------------------------------------- */

/* 1 / ((tau[0] s + 1) (tau[1] s + 1)) e^(-dead_time s), 1/s more where it integrates. */
struct apc_lag {
    unsigned order;
    bool integrating;
    double tau[2], dead_time;
};
/*
 * w [n] = what it makes of u [n], numbers that are @p stride apart, which was @p before until then; it was at
 * rest, at 0. @p rate [n], unless NULL: the derivative of w. Returns 0 or APC_ENOMEM.
 */
int apc_lag_response(const struct apc_lag *lag, double Ts, double before, const double *u, size_t stride,
                     size_t n, double *w, double *rate);

#endif

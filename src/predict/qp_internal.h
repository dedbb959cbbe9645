/* SPDX-License-Identifier: BSD-3-Clause */
/*
 * The inside of apc_qp. With H = R'R, J = R^-1 and w = Rx, every row i of (x, Ax) is M_i w: rows of J for x's
 * bounds, of AJ for the others. The multipliers of the working set W solve
 *
 *     (M_W M_W' + 1/s) lambda = -b - M_W q + sign linear / s,
 *     q = J'f + M_F' lambda_F,    w = -q - M_W' lambda
 *
 * where 1/s and linear are there for soft rows that are violated, s being their quadratic weight, and F are
 * the violated soft rows without one: their multiplier is +-linear. lambda is > 0 at high, < 0 at low.
 */
#ifndef APC_QP_INTERNAL_H
#define APC_QP_INTERNAL_H

#include "apcqp.h"

#include <float.h>
#include <math.h>
#include <stdint.h>
#include <string.h>

struct apc_qp {
    void *memory; /* all of it; this as well */
    size_t n, m, rows;
    unsigned most;
    double tolerance;
    bool (*enough)(void *ctx);
    void *ctx;

    bool definite;              /* H has to be */
    bool limited;               /* most is the caller's */
    bool ready;                 /* there is an H */
    bool proximal;              /* it is singular: H and J are those of H + diag(shift) */
    double *H, *A, *J, *M;      /* H and J n x n, A and M m x n */
    double *root;               /* [n] of H's diagonal: the scale of a variable */
    double share;               /* of E in H */
    double *own;                /* [n] H's diagonal without E; these and the next for proximal steps alone */
    double *shift, *centre;     /* [n] E, and c */
    double *move, *way, *slope; /* [n] what the last step changed; where the next centre is; f - E c */
    signed char *former;        /* [rows] state after the step before */
    double fell, bent,
        length;   /* how much the objective fell along the way before; H of E there; the way's size */
    double *size; /* [rows] |M_i| */
    double *linear, *square;   /* [rows] */
    unsigned *column, *filled; /* [m * n], [m] where A's rows are not 0; filled n: all */
    size_t *zeros; /* [m] columns that a row of A, and so of AJ, begins with and are 0: eights of them */
    signed char *state, *side; /* [rows] 0 free, +-1 held, +-2 violated soft row; and what the caller sees */
    double *multiplier, *fixed, *value; /* [rows] the caller's; of F; (x, Ax) */

    /* The working set, in the order in which it came, or, when settled, of the rows. */
    size_t k;
    bool settled;
    size_t fresh;           /* so many rows of L are what a factorisation of W in order makes of them */
    size_t solved;          /* so much of z is right */
    unsigned tried;         /* row whose products with W are behind those of W in G; rows: of none */
    unsigned *work, *order; /* [rows], [2 * rows] the order is scratch of settling */
    /* Of these, those that a removal moves have room for it to do so in fours. */
    double *lambda, *target;        /* [rows] where we are, and where W's own optimum is */
    double *least, *most_of, *give; /* [rows] where lambda may be; 1/s of a row that is violated, else 0 */
    double *rhs, *z, *inverse;      /* [rows] right-hand sides, L^-1 of them, 1/d */
    double *G, *L, *spare; /* packed lower triangles: M_W M_W', and its unit factor without the diagonal */
    double *beta, *carry;  /* [rows] scratch of a removal, of a step */
    struct apc_qp_pending {
        unsigned row;
        double lambda, direction;
    } * pending; /* [rows + 1] rows on their way into W */
    size_t waiting;

    /* Of the solve under way. */
    const double *f, *low, *high;
    double *q, *w, *x, *g, *e; /* [n] g and e are scratch */
    bool shifted;              /* F changed: q holds sums that the way here made */
    unsigned changes;
};

/* ---- Sums, always in the same order whatever compiles them ----------------------------------- */

/*
 * Four lanes at a time, where the machine has them two at a time elsewhere: the same sums in the same order,
 * so the same bits. A function whose loops matter is compiled for both, and the loader takes one. Not where a
 * sanitizer is, which is not ready yet when the loader asks; nor by clang, whose names for the two gcc's
 * linker does not find.
 */
#if defined(__x86_64__) && defined(__GLIBC__) && !defined(__clang__) && !defined(__SANITIZE_ADDRESS__) &&    \
    !defined(__SANITIZE_THREAD__)
#define QP_LANES __attribute__((target_clones("avx2", "default")))
#else
#define QP_LANES
#endif

typedef double apc_lanes __attribute__((vector_size(32), aligned(8), may_alias));
typedef int64_t apc_masks __attribute__((vector_size(32))); /* what comparing lanes gives: 0 or -1 each */

#define QP_FOUR(at) (*(const apc_lanes *)(at))

static inline bool qp_any(const apc_masks *masks)
{
    return (((*masks)[0] | (*masks)[1]) | ((*masks)[2] | (*masks)[3])) != 0;
}

/** to = a where @p masks is set, else b. */
static inline void qp_pick(const apc_masks *masks, const apc_lanes *a, const apc_lanes *b, apc_lanes *to)
{
    *to = (apc_lanes)((*masks & (apc_masks)*a) | (~*masks & (apc_masks)*b));
}

static inline bool qp_all_finite(size_t n, const double *v)
{
    apc_masks none = {0};
    size_t i = 0;

    for (; i + 4 <= n; i += 4) {
        const apc_lanes naught = 0.0 * QP_FOUR(v + i);

        none |= naught != 0.0;
    }
    for (; i < n; i++)
        if (!isfinite(v[i]))
            return false;
    return !qp_any(&none);
}

/** The end of a sum, fewer than eight, one after the other; the second bound is for the compiler. */
static inline double qp_rest(size_t n, const double *a, const double *b)
{
    double sum = 0.0;

    for (size_t i = 0; i < n && i < 7; i++)
        sum += a[i] * b[i];
    return sum;
}

static inline double qp_dot(size_t n, const double *a, const double *b)
{
    apc_lanes s = {0.0, 0.0, 0.0, 0.0}, t = {0.0, 0.0, 0.0, 0.0};
    size_t i = 0;

    for (; i + 8 <= n; i += 8) {
        s += QP_FOUR(a + i) * QP_FOUR(b + i);
        t += QP_FOUR(a + i + 4) * QP_FOUR(b + i + 4);
    }
    s += t;
    return ((s[0] + s[2]) + (s[1] + s[3])) + qp_rest(n - i, a + i, b + i);
}

/** y += scale x */
static inline void qp_add(size_t n, double scale, const double *x, double *y)
{
    size_t i = 0;

    for (; i + 4 <= n; i += 4)
        *(apc_lanes *)(y + i) += QP_FOUR(x + i) * scale;
    for (; i < n; i++)
        y[i] += scale * x[i];
}

/** x = scale x, element by element; returns x' of before times x of after. */
static inline double qp_scale(size_t n, const double *scale, double *x)
{
    apc_lanes sum = {0.0, 0.0, 0.0, 0.0};
    double rest = 0.0;
    size_t i = 0;

    for (; i + 4 <= n; i += 4) {
        apc_lanes before = QP_FOUR(x + i), after = before * QP_FOUR(scale + i);

        sum += before * after;
        *(apc_lanes *)(x + i) = after;
    }
    for (; i < n; i++) {
        double after = x[i] * scale[i];

        rest += x[i] * after;
        x[i] = after;
    }
    return ((sum[0] + sum[2]) + (sum[1] + sum[3])) + rest;
}

/** y -= the sum of lambda[q] row[q], four rows. */
static inline void qp_add_four(size_t n, const double *lambda, const double *const row[4], double *y)
{
    const double *a = row[0], *b = row[1], *c = row[2], *d = row[3];
    size_t i = 0;

    for (; i + 4 <= n; i += 4)
        *(apc_lanes *)(y + i) -= (QP_FOUR(a + i) * lambda[0] + QP_FOUR(b + i) * lambda[1]) +
                                 (QP_FOUR(c + i) * lambda[2] + QP_FOUR(d + i) * lambda[3]);
    for (; i < n; i++)
        y[i] -= (a[i] * lambda[0] + b[i] * lambda[1]) + (c[i] * lambda[2] + d[i] * lambda[3]);
}

/** What qp_add() does of four rows, one after the other; from the end, which is what back substitution waits
 * for. */
static inline void qp_add_each(size_t n, const double scale[4], const double *const row[4], double *y)
{
    const double *a = row[0], *b = row[1], *c = row[2], *d = row[3];
    size_t i = 0;

    for (; i + 4 <= n; i += 4)
        *(apc_lanes *)(y + i) = (((QP_FOUR(y + i) + QP_FOUR(a + i) * scale[0]) + QP_FOUR(b + i) * scale[1]) +
                                 QP_FOUR(c + i) * scale[2]) +
                                QP_FOUR(d + i) * scale[3];
    for (; i < n; i++)
        y[i] = (((y[i] + scale[0] * a[i]) + scale[1] * b[i]) + scale[2] * c[i]) + scale[3] * d[i];
}

/** Row i of M; the columns before @p from are 0. */
static inline const double *qp_row(const struct apc_qp *qp, size_t i, size_t *from)
{
    *from = i < qp->n ? i : qp->zeros[i - qp->n];
    return i < qp->n ? qp->J + i * qp->n : qp->M + (i - qp->n) * qp->n;
}

/** M_i v */
static inline double qp_row_dot(const struct apc_qp *qp, size_t i, const double *v)
{
    size_t from;
    const double *row = qp_row(qp, i, &from);

    return qp_dot(qp->n - from, row + from, v + from);
}

/** v += scale M_i' */
static inline void qp_row_add(const struct apc_qp *qp, size_t i, double scale, double *v)
{
    size_t from;
    const double *row = qp_row(qp, i, &from);

    qp_add(qp->n - from, scale, row + from, v + from);
}

/** Room of a packed lower triangle of @p k rows, its diagonal included: where row k begins. Rows are filled
 * up to fours, so that each begins where four lanes do. */
static inline size_t qp_packed(size_t k)
{
    return 4 * (k / 4 + 1) * (k / 4 * 2 + k % 4);
}

/* ---- Rows ------------------------------------------------------------------------------------- */

static inline bool qp_soft(const struct apc_qp *qp, size_t i)
{
    return qp->linear[i] > 0.0 || qp->square[i] > 0.0;
}

/** By how much a limit may be exceeded, which rounding does. */
static inline double qp_allowance(const struct apc_qp *qp, double limit)
{
    return qp->tolerance + 8.0 * DBL_EPSILON * fabs(limit);
}

/* ---- qp.c ------------------------------------------------------------------------------------------ */

/** The dual active-set method for qp->f and the limits, from the working set that there is. */
enum apc_qp_status qp_solve_definite(struct apc_qp *qp);
/** May what is called optimal be called so, by its residuals? */
bool qp_is_sound(const struct apc_qp *qp);
/** Is the dual residual of each variable at most a share of the scale of its own terms? Of qp->g. */
bool qp_is_stationary(const struct apc_qp *qp, double share);

/* ---- qp_proximal.c: H is singular ------------------------------------------------------------------ */

#define QP_SINGULAR                                                                                          \
    1e5 /* times n DBL_EPSILON: what is left of H's diagonal, at the most, where H is singular */

/** The factor of H + E, once that of H has failed. Returns 0 or the pivot that shows H to be indefinite. */
size_t qp_proximal_factor(struct apc_qp *qp);
/** The dual active-set method for f, again and again. @p steps counts. */
enum apc_qp_status qp_proximal_point(struct apc_qp *qp, const double *f, unsigned *steps);
/** What the gradient is made of, the largest of all variables, each over its root. */
double qp_gradient_scale(const struct apc_qp *qp);
/** g and e, which are those of the step, as of the problem itself. */
void qp_proximal_gradient(struct apc_qp *qp);

/* ---- qp_setup.c ------------------------------------------------------------------------------------ */

/** M = AJ, and where A's rows are not zero. */
void qp_transform(struct apc_qp *qp);

/** J = R^-1, an upper triangle, from H = R'R. Returns 0 or the pivot that is not above @p least of H's, from 1 on. */
size_t qp_invert(struct apc_qp *qp, double least);

/* ---- qp_violation.c: what is violated -------------------------------------------------------------- */

/** How far row i is beyond a limit; 0 within its allowance. *@p sign says which limit. */
double qp_violation_of(const struct apc_qp *qp, size_t i, double *sign);
/** The entering constraint: rows when there is none. *@p sign says on which side; @p careful takes the
 * first one, else it is that which is violated most. */
size_t qp_entering(const struct apc_qp *qp, bool careful, double *sign);

/* ---- qp_working_set.c: the working set and its factor ------------------------------------------------ */

/** Where the multiplier of row i may be, in the state that it is in. */
void qp_interval(const struct apc_qp *qp, size_t i, double *low, double *high);
/** Append row i with multiplier @p lambda. False when it depends on W: the row of L is made, W is as it was. */
bool qp_working_set_append(struct apc_qp *qp, size_t i, double lambda);
void qp_working_set_remove(struct apc_qp *qp, size_t at);
/** Right-hand sides of rows from @p at on, which is also how far z holds. */
void qp_working_set_right_hand_sides(struct apc_qp *qp, size_t at);
/** target = W's own optimum. */
void qp_working_set_target(struct apc_qp *qp);
/** lambda of M_W M_W' lambda = L's row k d: how W moves against a row that depends on it. */
void qp_working_set_dual_direction(const struct apc_qp *qp, double *move);
/** v -= M_W' lambda */
void qp_working_set_subtract_rows(const struct apc_qp *qp, const double *lambda, double *v);
/** Put W in the order of its rows and factorise it anew: from then on nothing tells how it came about. */
void qp_working_set_settle(struct apc_qp *qp);
/** Solve (M_W M_W' + 1/s) y = y for the first @p k rows of W. */
void qp_working_set_solve(const struct apc_qp *qp, size_t k, double *y);

#endif

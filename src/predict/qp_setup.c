/* SPDX-License-Identifier: BSD-3-Clause */
/* apc_qp before a solve: its memory, its problem, and where it begins. */
#include "base/base_internal.h"
#include "predict/qp_internal.h"

#include <float.h>
#include <math.h>
#include <stdlib.h>

#define LINE    64    /* bytes: of a cache */
#define LARGEST 16384 /* rows: indices fit, and the packed triangles an address space */

/* ---- Creation --------------------------------------------------------------------------------- */

static int weights_check(size_t n, const double *weight)
{
    for (size_t i = 0; weight && i < n; i++)
        if (!(weight[i] >= 0.0) || weight[i] > APC_VALUE_MAX)
            return APC_EINVAL;
    return 0;
}

/** Cut a piece of @p n elements of @p width bytes off the block; with block NULL it only counts. */
static void *cut_block(unsigned char *block, size_t *used, size_t n, size_t width)
{
    void *piece = block ? block + *used : NULL;

    *used += (n * width + 31) / 32 * 32;
    return piece;
}

static size_t lay_out_qp(struct apc_qp *qp, unsigned char *block)
{
    size_t n = qp->n, m = qp->m, rows = qp->rows, used = 0, packed = qp_packed(rows + 1);
    struct {
        double **to;
        size_t n;
    } doubles[] = {{&qp->H, n * n},
                   {&qp->A, m * n},
                   {&qp->J, n * n},
                   {&qp->M, m * n},
                   {&qp->root, n},
                   {&qp->own, n},
                   {&qp->shift, n},
                   {&qp->centre, n},
                   {&qp->move, n},
                   {&qp->way, n},
                   {&qp->slope, n},
                   {&qp->size, rows},
                   {&qp->linear, rows},
                   {&qp->square, rows},
                   {&qp->fixed, rows},
                   {&qp->multiplier, rows},
                   {&qp->value, rows},
                   {&qp->lambda, rows + 4},
                   {&qp->target, rows + 1},
                   {&qp->least, rows + 4},
                   {&qp->most_of, rows + 4},
                   {&qp->give, rows + 4},
                   {&qp->rhs, rows + 4},
                   {&qp->z, rows + 1},
                   {&qp->inverse, rows + 4},
                   {&qp->G, packed},
                   {&qp->L, packed},
                   {&qp->spare, packed},
                   {&qp->beta, rows + 1},
                   {&qp->carry, rows + 1},
                   {&qp->q, n},
                   {&qp->w, n},
                   {&qp->x, n},
                   {&qp->g, n},
                   {&qp->e, n}};

    used = (sizeof(*qp) + 31) / 32 * 32;
    for (size_t i = 0; i < sizeof(doubles) / sizeof(doubles[0]); i++)
        *doubles[i].to = cut_block(block, &used, doubles[i].n, sizeof(double));
    qp->pending = cut_block(block, &used, rows + 1, sizeof(*qp->pending));
    qp->column = cut_block(block, &used, m * n, sizeof(*qp->column));
    qp->filled = cut_block(block, &used, m, sizeof(*qp->filled));
    qp->zeros = cut_block(block, &used, m, sizeof(*qp->zeros));
    qp->work = cut_block(block, &used, rows + 1, sizeof(*qp->work));
    qp->order = cut_block(block, &used, 2 * rows, sizeof(*qp->order));
    qp->state = cut_block(block, &used, rows, 1);
    qp->side = cut_block(block, &used, rows, 1);
    qp->former = cut_block(block, &used, rows, 1);
    return used;
}

int apc_qp_create(struct apc_qp **qp, size_t n, size_t m, const struct apc_qp_options *options,
                  struct apc_error *why)
{
    struct apc_qp_options o = {.size = sizeof o};
    struct apc_qp plan = {.n = n, .m = m, .rows = n + m};
    unsigned char *block;
    size_t size;
    int err = apc_options_copy(&o, sizeof o, options, "options of the QP", why);

    if (!qp)
        return apc_fail(why, APC_EINVAL, "no place for the QP");
    *qp = NULL;
    if (err)
        return err;
    if (n < 1 || n > LARGEST || m > LARGEST - n)
        return apc_fail(why, APC_EINVAL,
                        "a QP has 1 to %d variables and rows together; %zu and %zu were asked for", LARGEST,
                        n, m);
    if (!(o.tolerance >= 0.0) || o.tolerance > APC_VALUE_MAX || weights_check(n + m, o.linear) ||
        weights_check(n + m, o.square))
        return apc_fail(why, APC_EINVAL, "a QP's tolerance and weights are numbers that are not negative");
    size = lay_out_qp(&plan, NULL) + LINE;
    plan.memory = malloc(size);
    if (!plan.memory)
        return apc_fail(why, APC_ENOMEM, "no memory for a QP of %zu variables and %zu rows: %zu bytes", n, m,
                        size);
    plan.most = o.iterations ? o.iterations : (unsigned)(10 * (n + m));
    plan.tolerance = o.tolerance > 0.0 ? o.tolerance : 1e-9;
    plan.enough = o.enough;
    plan.ctx = o.ctx;
    plan.definite = o.definite;
    plan.limited = o.iterations > 0;
    block = (unsigned char *)plan.memory + (LINE - (uintptr_t)plan.memory % LINE) % LINE;
    memset(block, 0, size - LINE); /* no page is touched for the first time in a solve */
    (void)lay_out_qp(&plan, block);
    memcpy(block, &plan, sizeof plan);
    *qp = (struct apc_qp *)(void *)block;
    return apc_qp_soft(*qp, o.linear, o.square);
}

void apc_qp_destroy(struct apc_qp *qp)
{
    if (qp)
        free(qp->memory);
}

/* ---- The problem ------------------------------------------------------------------------------ */

QP_LANES size_t qp_invert(struct apc_qp *qp, double least)
{
    size_t n = qp->n;
    double *L = qp->spare, *J = qp->J; /* L = R', packed, while this lasts */

    for (size_t i = 0; i < n; i++) {
        double *row = L + qp_packed(i), left;

        for (size_t j = 0; j < i; j++)
            row[j] = (qp->H[i * n + j] - qp_dot(j, L + qp_packed(j), row)) / L[qp_packed(j) + j];
        left = qp->H[i * n + i] - qp_dot(i, row, row);
        if (!(left > least * qp->H[i * n + i]))
            return i + 1;
        row[i] = sqrt(left);
    }
    /* Row i of R^-1 from the rows below it: (R^-1)_i = (e_i - sum over j > i of R_ij (R^-1)_j) / R_ii. */
    for (size_t i = n; i-- > 0;) {
        double *row = J + i * n;

        memset(row, 0, n * sizeof(*row));
        row[i] = 1.0;
        for (size_t j = i + 1; j < n; j++)
            qp_add(n - j, -L[qp_packed(j) + i], J + j * n + j, row + j);
        for (size_t j = i; j < n; j++)
            row[j] /= L[qp_packed(i) + i];
    }
    return 0;
}

QP_LANES void qp_transform(struct apc_qp *qp)
{
    size_t n = qp->n;

    memset(qp->M, 0, qp->m * n * sizeof(*qp->M));
    for (size_t r = 0; r < qp->m; r++) {
        unsigned *column = qp->column + r * n, filled = 0;

        for (size_t c = 0; c < n; c++) {
            double a = qp->A[r * n + c];

            if (a == 0.0)
                continue;
            column[filled++] = (unsigned)c;
            qp_add(n - c, a, qp->J + c * n + c, qp->M + r * n + c);
        }
        qp->filled[r] = filled;
        qp->zeros[r] = (filled ? column[0] : n) / 8 * 8;
    }
    for (size_t i = 0; i < qp->rows; i++) {
        size_t from;
        const double *row = qp_row(qp, i, &from);

        qp->size[i] = sqrt(qp_dot(n - from, row + from, row + from));
    }
}

int apc_qp_set(struct apc_qp *qp, const double *H, const double *A, struct apc_error *why)
{
    size_t n, pivot, below;

    if (!qp || !H || (qp->m > 0 && !A))
        return apc_fail(why, APC_EINVAL, "a QP needs its H, and A where it has rows");
    n = qp->n;
    qp->ready = false;
    for (size_t i = 0; i < n; i++)
        for (size_t j = 0; j <= i; j++)
            qp->H[i * n + j] = qp->H[j * n + i] = H[i * n + j];
    if (qp->m > 0)
        memcpy(qp->A, A, qp->m * n * sizeof(*A));
    if (!qp_all_finite(n * n, qp->H) || !qp_all_finite(qp->m * n, qp->A))
        return apc_fail(why, APC_EINVAL, "the QP's H or A has an element that is no finite number");
    pivot = qp_invert(qp, (double)n * DBL_EPSILON * (qp->definite ? 1.0 : QP_SINGULAR));
    qp->proximal = pivot && !qp->definite;
    below = qp->proximal ? qp_proximal_factor(qp) : 0;
    if (below)
        return apc_fail(
            why, APC_EINVAL,
            "H of the QP is indefinite: pivot %zu of %zu is below zero; only a convex QP is solved", below,
            n);
    if (pivot && qp->definite)
        return apc_fail(
            why, APC_EINVAL,
            "H of the QP is not positive definite: pivot %zu of %zu is not above zero; every variable needs "
            "a weight",
            pivot, n);
    qp_transform(qp);
    if (!qp_all_finite(n * n, qp->J) || !qp_all_finite(qp->m * n, qp->M))
        return apc_fail(why, APC_EINVAL, "H of the QP is too badly scaled: its factor has no finite inverse");
    for (size_t i = 0; i < n && !qp->proximal; i++)
        qp->root[i] = sqrt(qp->H[i * n + i]);
    qp->ready = true;
    qp->k = qp->rows + 1; /* what is known of W is of another H */
    return 0;
}

int apc_qp_soft(struct apc_qp *qp, const double *linear, const double *square)
{
    if (!qp || weights_check(qp->rows, linear) || weights_check(qp->rows, square))
        return APC_EINVAL;
    for (size_t i = 0; i < qp->rows; i++) {
        qp->linear[i] = linear ? linear[i] : 0.0;
        qp->square[i] = square ? square[i] : 0.0;
    }
    qp->k = qp->rows + 1;
    return 0;
}

void apc_qp_start(struct apc_qp *qp, const signed char *rows)
{
    if (!qp)
        return;
    const size_t n = qp->rows;
    signed char *state = qp->state;

    memset(state, 0, n);
    for (size_t i = 0; rows && i < n; i++)
        state[i] = (signed char)((rows[i] > 0) - (rows[i] < 0));
    memset(qp->multiplier, 0, n * sizeof(*qp->multiplier));
    qp->k = n + 1;
}

const signed char *apc_qp_rows(const struct apc_qp *qp)
{
    return qp ? qp->side : NULL;
}

const double *apc_qp_multipliers(const struct apc_qp *qp)
{
    return qp ? qp->multiplier : NULL;
}

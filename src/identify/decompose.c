/* SPDX-License-Identifier: BSD-3-Clause */
#include "identify/identify_internal.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "base/matrix.h"

#define DEPENDENT 1e-10 /* of a column's length is left when it depends on others */
#define ROUNDING  1e-6  /* of a sum that is 0 is left, its terms being differences */

static void subtract(size_t n, double scale, const double *from, double *x)
{
    for (size_t i = 0; i < n; i++)
        x[i] -= scale * from[i];
}

static void scale_column(size_t n, double by, double *x)
{
    for (size_t i = 0; i < n; i++)
        x[i] *= by;
}

double apc_column_dot(const double *a, const double *b, size_t n)
{
    double sum[8] = {0.0};
    size_t i = 0;

    for (; i + 8 <= n; i += 8)
        for (size_t k = 0; k < 8; k++)
            sum[k] += a[i + k] * b[i + k];
    for (; i < n; i++)
        sum[i % 8] += a[i] * b[i];
    return ((sum[0] + sum[4]) + (sum[1] + sum[5])) + ((sum[2] + sum[6]) + (sum[3] + sum[7]));
}

/* Gram and Schmidt, modified, each column twice: then Q is orthonormal to rounding (Giraud, Langou and
 * Rozloznik, Computers & Mathematics with Applications 50, 2005). */
void apc_qr_extend(size_t n, size_t from, size_t to, double *Q, double *R, size_t width)
{
    for (size_t j = from; j < to; j++) {
        double *q = Q + j * n;
        const double before = sqrt(apc_column_dot(q, q, n));
        double length;

        for (size_t i = 0; i < width; i++)
            R[i * width + j] = 0.0;
        for (int pass = 0; pass < 2; pass++) {
            for (size_t i = 0; i < j; i++) {
                const double along = apc_column_dot(Q + i * n, q, n);

                subtract(n, along, Q + i * n, q);
                R[i * width + j] += along;
            }
        }
        length = sqrt(apc_column_dot(q, q, n));
        if (length <= DEPENDENT * before)
            length = 0.0;
        R[j * width + j] = length;
        scale_column(n, length > 0.0 ? 1.0 / length : 0.0, q);
    }
}

void apc_qr_solve(size_t p, const double *R, size_t width, const double *b, double *x)
{
    for (size_t i = p; i-- > 0;) {
        double sum = b[i];

        for (size_t j = i + 1; j < p; j++)
            sum -= R[i * width + j] * x[j];
        x[i] = R[i * width + i] > 0.0 ? sum / R[i * width + i] : 0.0;
    }
}

double apc_qr_variance(size_t p, const double *R, size_t width, double *g)
{
    for (size_t i = 0; i < p; i++) {
        double size = fabs(g[i]);

        for (size_t k = 0; k < i; k++) {
            g[i] -= R[k * width + i] * g[k];
            size += fabs(R[k * width + i] * g[k]);
        }
        if (R[i * width + i] > 0.0)
            g[i] /= R[i * width + i];
        else if (fabs(g[i]) > ROUNDING * size)
            return HUGE_VAL;
        else
            g[i] = 0.0; /* of what the others are known by, whatever this one is */
    }
    return apc_matrix_dot(g, g, p);
}

void apc_qr_damped(size_t m, const double *R, size_t width, const double *b, double damping, double *S,
                   double *T, double *step)
{
    double *rhs = step + m;

    memset(S, 0, 2 * m * (m + 1) * sizeof(*S));
    for (size_t j = 0; j < m; j++) {
        double length = 0.0;

        for (size_t i = 0; i <= j; i++) {
            const double r = R[i * width + j];

            S[j * 2 * m + i] = r;
            length += r * r;
        }
        S[j * 2 * m + m + j] = sqrt(damping * length);
    }
    memcpy(S + 2 * m * m, b, m * sizeof(*S));
    apc_qr_extend(2 * m, 0, m, S, T, m);
    for (size_t i = 0; i < m; i++)
        rhs[i] = apc_matrix_dot(S + i * 2 * m, S + 2 * m * m, 2 * m);
    apc_qr_solve(m, T, m, rhs, step);
}

/* Rows gather below the R of those before them. */
int apc_triangle_open(struct apc_triangle *rows, size_t width)
{
    const size_t room = 3 * width + 64;

    *rows = (struct apc_triangle){.width = width, .room = room, .filled = width};
    rows->Q = calloc(room * width + width * width + 1, sizeof(*rows->Q));
    rows->R = rows->Q ? rows->Q + room * width : NULL;
    return rows->Q ? 0 : APC_ENOMEM;
}

void apc_triangle_end(struct apc_triangle *rows)
{
    for (size_t j = 0; j < rows->width; j++)
        memset(rows->Q + j * rows->room + rows->filled, 0, (rows->room - rows->filled) * sizeof(*rows->Q));
    apc_qr_extend(rows->room, 0, rows->width, rows->Q, rows->R, rows->width);
    memset(rows->Q, 0, rows->room * rows->width * sizeof(*rows->Q));
    for (size_t j = 0; j < rows->width; j++) {
        for (size_t i = 0; i <= j; i++)
            rows->Q[j * rows->room + i] = rows->R[i * rows->width + j];
    }
    rows->filled = rows->width;
}

void apc_triangle_add(struct apc_triangle *rows, const double *row)
{
    if (rows->filled == rows->room)
        apc_triangle_end(rows);
    for (size_t j = 0; j < rows->width; j++)
        rows->Q[j * rows->room + rows->filled] = row[j];
    rows->filled++;
    rows->n++;
}

void apc_triangle_close(struct apc_triangle *rows)
{
    free(rows->Q);
}

static void rotate_columns(size_t n, double *a, double *b, double c, double s)
{
    for (size_t i = 0; i < n; i++) {
        const double kept = a[i];

        a[i] = c * kept - s * b[i];
        b[i] = s * kept + c * b[i];
    }
}

/* Make columns p and q orthogonal; false when they were. */
static bool orthogonalize_columns(size_t m, size_t n, double *A, double *V, size_t p, size_t q)
{
    double *a = A + p * m, *b = A + q * m;
    const double aa = apc_matrix_dot(a, a, m), bb = apc_matrix_dot(b, b, m), ab = apc_matrix_dot(a, b, m);
    double zeta, t, c;

    if (fabs(ab) <= 1e-15 * sqrt(aa * bb))
        return false;
    zeta = (bb - aa) / (2.0 * ab);
    t = copysign(1.0, zeta) / (fabs(zeta) + sqrt(1.0 + zeta * zeta));
    c = 1.0 / sqrt(1.0 + t * t);
    rotate_columns(m, a, b, c, c * t);
    rotate_columns(n, V + p * n, V + q * n, c, c * t);
    return true;
}

static void swap_columns(size_t n, double *a, double *b)
{
    for (size_t i = 0; i < n; i++) {
        const double kept = a[i];

        a[i] = b[i];
        b[i] = kept;
    }
}

void apc_svd(size_t m, size_t n, double *A, double *s, double *V)
{
    bool turned = true;

    memset(V, 0, n * n * sizeof(*V));
    for (size_t i = 0; i < n; i++)
        V[i * n + i] = 1.0;
    for (int sweep = 0; sweep < 60 && turned; sweep++) {
        turned = false;
        for (size_t p = 0; p + 1 < n; p++) {
            for (size_t q = p + 1; q < n; q++)
                turned |= orthogonalize_columns(m, n, A, V, p, q);
        }
    }
    for (size_t j = 0; j < n; j++)
        s[j] = sqrt(apc_matrix_dot(A + j * m, A + j * m, m));
    for (size_t j = 0; j < n; j++) {
        size_t largest = j;

        for (size_t k = j + 1; k < n; k++)
            largest = s[k] > s[largest] ? k : largest;
        swap_columns(1, &s[j], &s[largest]);
        swap_columns(m, A + j * m, A + largest * m);
        swap_columns(n, V + j * n, V + largest * n);
        scale_column(m, s[j] > 0.0 ? 1.0 / s[j] : 0.0, A + j * m);
    }
}

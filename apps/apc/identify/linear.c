/* SPDX-License-Identifier: BSD-3-Clause */
#include "linear.h"

#include <dlfcn.h>
#include <lapacke.h>

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "base/complex.h"

#define RANK_TOLERANCE 1e-8 /* against the largest singular value; the Jacobians are good to 1e-9 */

#define LAPACK_FUNCTIONS(X) X(dgeev) X(dgelss) X(dgesv) X(dgesvd)

static struct {
#define LAPACK_MEMBER(name) __typeof__(LAPACKE_##name) *name;
    LAPACK_FUNCTIONS(LAPACK_MEMBER)
} lapack;

int linear_load(struct apc_error *why)
{
    static const char library[] = "liblapacke.so.3";
    void *handle = dlopen(library, RTLD_NOW | RTLD_LOCAL | RTLD_NODELETE);
    if (!handle)
        return apc_fail(why, APC_ENOTFOUND, "%s is missing (Debian: liblapacke): %s", library, dlerror());
#define LAPACK_FIND(name)                                                                                    \
    *(void **)&lapack.name = dlsym(handle, "LAPACKE_" #name);                                                \
    if (!lapack.name)                                                                                        \
        return apc_fail(why, APC_ENOTFOUND, "%s has no LAPACKE_" #name, library);
    LAPACK_FUNCTIONS(LAPACK_FIND)
    return 0;
}

static int size_of(size_t n)
{
    return (int)n;
}

/* The eigenvalues of a[n * n], which is destroyed. */
static int lapack_eigenvalues(double *a, size_t n, double complex *value)
{
    double *re = calloc(n, sizeof *re), *im = calloc(n, sizeof *im);
    int rc = re && im ? 0 : APC_ENOMEM;
    if (rc == 0 &&
        lapack.dgeev(LAPACK_ROW_MAJOR, 'N', 'N', size_of(n), a, size_of(n), re, im, NULL, 1, NULL, 1))
        rc = APC_ESOLVER;
    for (size_t i = 0; i < n && rc == 0; i++)
        value[i] = re[i] + im[i] * (double complex)I;
    free(re);
    free(im);
    return rc;
}

int linear_poles(const struct linear *sys, double complex *pole)
{
    double *a = calloc(sys->nx * sys->nx, sizeof *a);
    if (!a)
        return APC_ENOMEM;
    memcpy(a, sys->a, sys->nx * sys->nx * sizeof *a);
    int rc = lapack_eigenvalues(a, sys->nx, pole);
    free(a);
    return rc;
}

/* ---- Zeros --------------------------------------------------------------------------------- */

/*
 * The states from which some input keeps y at zero form a subspace, found by leaving out, until nothing more
 * goes, what leads out of it (Wonham, Linear Multivariable Control, 4.3). The zeros are the eigenvalues of
 * the motion within it. Unlike the generalised eigenvalue problem this has no zeros at infinity to tell from
 * large ones, and it takes systems that are not square.
 */
struct subspace {
    size_t n, m, r, k; /* states, inputs, outputs, dimension */
    double *a, *b, *c, *d;
    double *v;                   /* [n * k] orthonormal columns */
    double *next;                /* [n * n] */
    double *test;                /* [(n + r) * (n + m)] */
    double *s, *right, *scratch; /* of singular value decompositions: (n + m), its square, (n + r) */
    double *motion;              /* [n * n] */
};

/* out = x y, x [rows * inner], y [inner * columns] with that many numbers between two rows of out. */
static void multiply(const double *x, const double *y, double *out, size_t rows, size_t inner, size_t columns,
                     size_t stride)
{
    for (size_t i = 0; i < rows; i++)
        for (size_t j = 0; j < columns; j++) {
            double sum = 0;
            for (size_t l = 0; l < inner; l++)
                sum += x[i * inner + l] * y[l * columns + j];
            out[i * stride + j] = sum;
        }
}

/* Take from the columns of m [n * columns] what lies in the subspace. */
static void project_out(const struct subspace *z, double *m, size_t columns, size_t stride)
{
    for (size_t j = 0; j < columns; j++)
        for (size_t q = 0; q < z->k; q++) {
            double along = 0;
            for (size_t i = 0; i < z->n; i++)
                along += z->v[i * z->k + q] * m[i * stride + j];
            for (size_t i = 0; i < z->n; i++)
                m[i * stride + j] -= along * z->v[i * z->k + q];
        }
}

/* test = [A V, B; C V, D], its upper rows as far as they lie outside the subspace. */
static void build_test(struct subspace *z)
{
    size_t w = z->k + z->m;
    multiply(z->a, z->v, z->test, z->n, z->n, z->k, w);
    multiply(z->c, z->v, z->test + z->n * w, z->r, z->n, z->k, w);
    for (size_t i = 0; i < z->n; i++)
        memcpy(z->test + i * w + z->k, z->b + i * z->m, z->m * sizeof *z->b);
    for (size_t i = 0; i < z->r; i++)
        memcpy(z->test + (z->n + i) * w + z->k, z->d + i * z->m, z->m * sizeof *z->d);
    project_out(z, z->test, w, w);
}

/* Singular values and right vectors of x [rows * columns], rows >= columns, destroyed; the rank, or an error. */
static int decompose(struct subspace *z, double *x, size_t rows, size_t columns, double largest)
{
    if (columns == 0)
        return 0;
    if (lapack.dgesvd(LAPACK_ROW_MAJOR, 'N', 'A', size_of(rows), size_of(columns), x, size_of(columns), z->s,
                      NULL, 1, z->right, size_of(columns), z->scratch))
        return APC_ESOLVER;
    int rank = 0;
    while (rank < size_of(columns) && z->s[rank] > RANK_TOLERANCE * largest)
        rank++;
    return rank;
}

/* One round. Returns 1 when it left nothing out. */
static int shrink(struct subspace *z)
{
    size_t w = z->k + z->m;
    build_test(z);
    int rank = decompose(z, z->test, z->n + z->r, w, 1.0);
    if (rank < 0)
        return rank;
    size_t stay = w - (size_t)rank;
    for (size_t q = 0; q < stay; q++) /* the x part of each solution, as a row */
        for (size_t i = 0; i < z->n; i++) {
            double sum = 0;
            for (size_t l = 0; l < z->k; l++)
                sum += z->v[i * z->k + l] * z->right[((size_t)rank + q) * w + l];
            z->next[q * z->n + i] = sum;
        }
    for (size_t q = stay; q < z->n + z->m; q++)
        memset(z->next + q * z->n, 0, z->n * sizeof *z->next);
    int k = decompose(z, z->next, z->n + z->m, z->n, 1.0);
    if (k < 0 || (size_t)k == z->k)
        return k < 0 ? k : 1;
    z->k = (size_t)k;
    for (size_t i = 0; i < z->n; i++)
        for (size_t q = 0; q < z->k; q++)
            z->v[i * z->k + q] = z->right[q * z->n + i];
    return 0;
}

/* The motion within the subspace, V'(A V + B F), with the F that keeps it there; its eigenvalues. */
static int motion_of(struct subspace *z, double complex *zero)
{
    size_t w = z->k + z->m, rows = z->n + z->r, rhs = z->k ? z->k : 1;
    double *f = calloc(rows * rhs + 1, sizeof *f), *left = calloc(rows * z->m + 1, sizeof *left);
    double *into = calloc(z->n * rhs + 1, sizeof *into);
    int rank = 0, rc = f && left && into ? 0 : APC_ENOMEM;

    build_test(z);
    for (size_t i = 0; i < rows && rc == 0; i++) {
        for (size_t q = 0; q < z->k; q++)
            f[i * z->k + q] = -z->test[i * w + q];
        memcpy(left + i * z->m, z->test + i * w + z->k, z->m * sizeof *left);
    }
    if (rc == 0 && lapack.dgelss(LAPACK_ROW_MAJOR, size_of(rows), size_of(z->m), size_of(rhs), left,
                                 size_of(z->m), f, size_of(rhs), z->s, RANK_TOLERANCE, &rank))
        rc = APC_ESOLVER;
    if (rc == 0 && (rank < size_of(z->m) || z->s[rank - 1] < RANK_TOLERANCE))
        rc = APC_ESTATE;
    for (size_t i = 0; i < z->n && rc == 0; i++)
        for (size_t q = 0; q < z->k; q++) {
            double sum = 0;
            for (size_t l = 0; l < z->n; l++)
                sum += z->a[i * z->n + l] * z->v[l * z->k + q];
            for (size_t l = 0; l < z->m; l++)
                sum += z->b[i * z->m + l] * f[l * z->k + q];
            into[i * z->k + q] = sum;
        }
    for (size_t p = 0; p < z->k && rc == 0; p++)
        for (size_t q = 0; q < z->k; q++) {
            z->motion[p * z->k + q] = 0;
            for (size_t i = 0; i < z->n; i++)
                z->motion[p * z->k + q] += z->v[i * z->k + p] * into[i * z->k + q];
        }
    if (rc == 0 && z->k > 0)
        rc = lapack_eigenvalues(z->motion, z->k, zero);
    free(f);
    free(left);
    free(into);
    return rc;
}

/* Inputs and outputs to length one: it moves no zero, and ranks then mean something. */
static void normalise(struct subspace *z)
{
    for (size_t j = 0; j < z->m; j++) {
        double sum = 0;
        for (size_t i = 0; i < z->n + z->r; i++)
            sum += apc_pow(i < z->n ? z->b[i * z->m + j] : z->d[(i - z->n) * z->m + j], 2);
        for (size_t i = 0; i < z->n + z->r && sum > 0; i++)
            *(i < z->n ? &z->b[i * z->m + j] : &z->d[(i - z->n) * z->m + j]) /= sqrt(sum);
    }
    for (size_t i = 0; i < z->r; i++) {
        double sum = 0;
        for (size_t j = 0; j < z->n + z->m; j++)
            sum += apc_pow(j < z->n ? z->c[i * z->n + j] : z->d[i * z->m + j - z->n], 2);
        for (size_t j = 0; j < z->n + z->m && sum > 0; j++)
            *(j < z->n ? &z->c[i * z->n + j] : &z->d[i * z->m + j - z->n]) /= sqrt(sum);
    }
}

/* A copy with no more inputs than outputs: the transposed system has the same zeros. Time is scaled so that A
 * has length one; returns the scale. */
static double copy_system(struct subspace *z, const struct linear *sys)
{
    bool flip = sys->nu > sys->ny;
    double sum = 0;
    for (size_t i = 0; i < z->n * z->n; i++)
        sum += sys->a[i] * sys->a[i];
    double scale = sum > 0 ? sqrt(sum) : 1.0;
    for (size_t i = 0; i < z->n; i++) {
        for (size_t j = 0; j < z->n; j++)
            z->a[i * z->n + j] = sys->a[flip ? j * z->n + i : i * z->n + j] / scale;
        for (size_t j = 0; j < z->m; j++)
            z->b[i * z->m + j] = (flip ? sys->c[j * z->n + i] : sys->b[i * z->m + j]) / scale;
        for (size_t j = 0; j < z->r; j++)
            z->c[j * z->n + i] = flip ? sys->b[i * z->r + j] : sys->c[j * z->n + i];
    }
    for (size_t i = 0; i < z->r; i++)
        for (size_t j = 0; j < z->m; j++)
            z->d[i * z->m + j] = sys->d[flip ? j * z->r + i : i * z->m + j];
    normalise(z);
    return scale;
}

int linear_zeros(const struct linear *sys, double complex *zero)
{
    size_t n = sys->nx, m = sys->nu < sys->ny ? sys->nu : sys->ny, r = sys->nu + sys->ny - m;
    size_t w = n + m, h = n + r;
    double *at = calloc(3 * n * n + n * m + r * n + r * m + w * n + h * w + w + w * w + h, sizeof *at);
    struct subspace z = {.n = n, .m = m, .r = r, .k = n, .a = at};
    int rc = 0;
    if (!at)
        return APC_ENOMEM;
    z.b = z.a + n * n;
    z.c = z.b + n * m;
    z.d = z.c + r * n;
    z.v = z.d + r * m;
    z.motion = z.v + n * n;
    z.next = z.motion + n * n;
    z.test = z.next + w * n;
    z.s = z.test + h * w;
    z.right = z.s + w;
    z.scratch = z.right + w * w;
    double scale = copy_system(&z, sys);
    for (size_t i = 0; i < n; i++)
        z.v[i * n + i] = 1;
    while (rc == 0 && z.k > 0)
        rc = shrink(&z);
    if (rc >= 0)
        rc = motion_of(&z, zero);
    for (size_t i = 0; i < z.k && rc == 0; i++)
        zero[i] *= scale;
    free(at);
    return rc < 0 ? rc : size_of(z.k);
}

/* ---- Gains --------------------------------------------------------------------------------- */

/* What rounding has left of a zero in a column of @n numbers, @stride apart. */
static void clear_rounding(double *column, size_t n, size_t stride)
{
    double largest = 0;
    for (size_t i = 0; i < n; i++)
        largest = fmax(largest, fabs(column[i * stride]));
    for (size_t i = 0; i < n; i++)
        if (fabs(column[i * stride]) <= 1e-14 * largest)
            column[i * stride] = 0;
}

int linear_gain(const struct linear *sys, double *gain)
{
    size_t n = sys->nx, m = sys->nu;
    double complex *pole = calloc(n, sizeof *pole);
    double *a = calloc(n * n, sizeof *a), *x = calloc(n * m, sizeof *x), fastest = 0;
    int *pivot = calloc(n, sizeof *pivot);
    int rc = pole && a && x && pivot ? linear_poles(sys, pole) : APC_ENOMEM;
    for (size_t i = 0; i < n && rc == 0; i++)
        fastest = fmax(fastest, apc_cabs(pole[i]));
    for (size_t i = 0; i < n && rc == 0; i++)
        if (apc_cabs(pole[i]) <= 1e-9 * fastest)
            rc = APC_ESTATE;
    if (rc == 0) {
        memcpy(a, sys->a, n * n * sizeof *a);
        memcpy(x, sys->b, n * m * sizeof *x);
        if (lapack.dgesv(LAPACK_ROW_MAJOR, size_of(n), size_of(m), a, size_of(n), pivot, x, size_of(m)))
            rc = APC_ESTATE;
    }
    for (size_t j = 0; j < m && rc == 0; j++)
        clear_rounding(x + j, n, m);
    if (rc == 0)
        multiply(sys->c, x, gain, sys->ny, n, m, m);
    for (size_t i = 0; i < sys->ny * m && rc == 0; i++)
        gain[i] = sys->d[i] - gain[i];
    free(pole);
    free(a);
    free(x);
    free(pivot);
    return rc;
}

int linear_rga(const double *gain, size_t n, double *rga)
{
    double *inverse = calloc(n * n, sizeof *inverse), *a = calloc(n * n, sizeof *a);
    int *pivot = calloc(n, sizeof *pivot);
    int rc = inverse && a && pivot ? 0 : APC_ENOMEM;
    if (rc == 0)
        memcpy(a, gain, n * n * sizeof *a);
    for (size_t i = 0; i < n && rc == 0; i++)
        inverse[i * n + i] = 1;
    if (rc == 0 &&
        lapack.dgesv(LAPACK_ROW_MAJOR, size_of(n), size_of(n), a, size_of(n), pivot, inverse, size_of(n)))
        rc = APC_ESTATE;
    for (size_t i = 0; i < n && rc == 0; i++)
        for (size_t j = 0; j < n; j++)
            rga[i * n + j] = gain[i * n + j] * inverse[j * n + i] + 0.0; /* and no -0 */
    free(inverse);
    free(a);
    free(pivot);
    return rc;
}

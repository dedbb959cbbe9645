/* SPDX-License-Identifier: BSD-3-Clause */
/*
 * Preloaded before libapc: every QP that a program solves, and its answer, into the file APC_QP_LOG: doubles,
 * a record after the other. All of them begin with their kind and the number of the qp:
 *
 *     1, qp, n, m                     made
 *     2, qp, H [n*n], A [m*n]         set
 *     3, qp, linear, square [n+m]     soft
 *     4, qp, f [n], low, high [n+m], status, objective, soft, x [n], multipliers [n+m]     solved
 */
#include <apcqp.h>

#include <dlfcn.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

enum { MOST = 64 };

static struct {
    const struct apc_qp *qp;
    size_t n, m;
} known[MOST];
static size_t n_known;
static FILE *out;

static void *next(const char *name)
{
    void *found = dlsym(RTLD_NEXT, name);

    if (!found)
        abort();
    return found;
}

static void put(const double *v, size_t n)
{
    static const double zeros[1024];

    if (!out)
        out = fopen(getenv("APC_QP_LOG"), "ab");
    for (size_t i = 0; i < n; i += 1024) {
        const size_t some = n - i < 1024 ? n - i : 1024;

        if (!out || fwrite(v ? v + i : zeros, sizeof *v, some, out) != some)
            abort();
    }
}

static void head(int kind, size_t number)
{
    put((const double[]){kind, (double)number}, 2);
}

/* The newest of that address: a qp may have had it before. */
static size_t find(const struct apc_qp *qp)
{
    for (size_t i = n_known; i-- > 0;)
        if (known[i].qp == qp)
            return i;
    abort();
}

static void soft(size_t i, const double *linear, const double *square)
{
    head(3, i);
    put(linear, known[i].n + known[i].m);
    put(square, known[i].n + known[i].m);
}

int apc_qp_create(struct apc_qp **qp, size_t n, size_t m, const struct apc_qp_options *options,
                  struct apc_error *why)
{
    int (*create)(struct apc_qp **, size_t, size_t, const struct apc_qp_options *, struct apc_error *);
    int rc;

    *(void **)&create = next("apc_qp_create");
    if (n_known == MOST)
        abort();
    known[n_known].n = n;
    known[n_known].m = m;
    rc = create(qp, n, m, options, why);
    if (rc < 0)
        return rc;
    known[n_known].qp = *qp;
    head(1, n_known);
    put((const double[]){(double)n, (double)m}, 2);
    soft(n_known++, options ? options->linear : NULL, options ? options->square : NULL);
    return rc;
}

int apc_qp_set(struct apc_qp *qp, const double *H, const double *A, struct apc_error *why)
{
    int (*set)(struct apc_qp *, const double *, const double *, struct apc_error *);
    const size_t i = find(qp);

    *(void **)&set = next("apc_qp_set");
    head(2, i);
    put(H, known[i].n * known[i].n);
    put(A, known[i].m * known[i].n);
    return set(qp, H, A, why);
}

int apc_qp_soft(struct apc_qp *qp, const double *linear, const double *square)
{
    int (*give)(struct apc_qp *, const double *, const double *);

    *(void **)&give = next("apc_qp_soft");
    for (size_t i = 0; i < n_known; i++) /* not while it is made */
        if (known[i].qp == qp) {
            soft(find(qp), linear, square);
            break;
        }
    return give(qp, linear, square);
}

int apc_qp_solve(struct apc_qp *qp, const double *f, const double *low, const double *high, double *x,
                 struct apc_qp_result *result)
{
    int (*solve)(struct apc_qp *, const double *, const double *, const double *, double *,
                 struct apc_qp_result *);
    struct apc_qp_result own = {.size = sizeof own};
    const size_t i = find(qp), rows = known[i].n + known[i].m;
    int rc;

    *(void **)&solve = next("apc_qp_solve");
    head(4, i);
    put(f, known[i].n);
    put(low, rows);
    put(high, rows);
    rc = solve(qp, f, low, high, x, &own);
    put((const double[]){own.status, own.objective, own.soft}, 3);
    put(x, known[i].n);
    put(apc_qp_multipliers(qp), rows);
    if (result)
        memcpy(result, &own, result->size < sizeof own ? result->size : sizeof own);
    return rc;
}

/* SPDX-License-Identifier: BSD-3-Clause */
/*
 * apc_qp beside DAQP, OSQP and HPIPM on the QPs of closed predictive loops, in one process, turn about. Built
 * by bench/qp against casadi's wheel; never part of the build. Each sequence is recorded once and solved by
 * both as it came, each from its own former working set.
 */
#include <apcqp.h>

#include <api.h>
#include <hpipm_d_dense_qp.h>
#include <hpipm_d_dense_qp_dim.h>
#include <hpipm_d_dense_qp_ipm.h>
#include <hpipm_d_dense_qp_sol.h>
#include <math.h>
#include <osqp.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

enum { STEPS = 200, ROUNDS = 8, SLOW_ROUNDS = 2 };

struct loop {
    size_t nu, horizon, nx, n;
    double *A, *B, *C;      /* nx x nx, nx x nu, nu x nx */
    double *H, *rows;       /* n x n; n x n: moves */
    double *F, *T;          /* [n][nx + 2 nu]: f = F (x, u_last, r); of the state */
    double *f, *low, *high; /* of each step */
};

static double *numbers(size_t n)
{
    double *v = calloc(n, sizeof *v);

    if (!v)
        exit(1);
    return v;
}

/** y[t] = sum over k of G[t - k] u[k]: the condensed problem of a random stable plant with nu inputs and
 * outputs. */
static void make(struct loop *l, size_t nu, size_t horizon, uint64_t seed)
{
    struct apc_random random;
    size_t nx = 2 * nu, n = nu * horizon, width = nx + 2 * nu;
    double *G, *P, *power, *next;

    apc_random_init(&random, seed, "loop");
    *l = (struct loop){.nu = nu, .horizon = horizon, .nx = nx, .n = n};
    l->A = numbers(nx * nx);
    l->B = numbers(nx * nu);
    l->C = numbers(nu * nx);
    for (size_t i = 0; i < nx; i++) { /* poles between .8 and .97, weakly coupled */
        for (size_t j = 0; j < nx; j++)
            l->A[i * nx + j] = i == j ? 0.8 + 0.17 * apc_random_uniform(&random)
                                      : 0.02 * apc_random_normal(&random) / (double)nx;
        for (size_t j = 0; j < nu; j++)
            l->B[i * nu + j] = 0.2 * apc_random_normal(&random);
    }
    for (size_t i = 0; i < nu * nx; i++)
        l->C[i] = 0.5 * apc_random_normal(&random);
    /* P[t] = C A^(t + 1), G[t] = C A^t B */
    P = numbers(horizon * nu * nx);
    G = numbers(horizon * nu * nu);
    power = numbers(nu * nx);
    next = numbers(nu * nx);
    memcpy(power, l->C, nu * nx * sizeof *power);
    for (size_t t = 0; t < horizon; t++) {
        for (size_t i = 0; i < nu; i++)
            for (size_t j = 0; j < nu; j++)
                for (size_t k = 0; k < nx; k++)
                    G[(t * nu + i) * nu + j] += power[i * nx + k] * l->B[k * nu + j];
        memset(next, 0, nu * nx * sizeof *next);
        for (size_t i = 0; i < nu; i++)
            for (size_t j = 0; j < nx; j++)
                for (size_t k = 0; k < nx; k++)
                    next[i * nx + j] += power[i * nx + k] * l->A[k * nx + j];
        memcpy(power, next, nu * nx * sizeof *power);
        memcpy(P + t * nu * nx, power, nu * nx * sizeof *power);
    }
    double *S = numbers(n * n); /* y = S u + P x */

    for (size_t t = 0; t < horizon; t++)
        for (size_t k = 0; k <= t; k++)
            for (size_t i = 0; i < nu; i++)
                for (size_t j = 0; j < nu; j++)
                    S[(t * nu + i) * n + k * nu + j] = G[((t - k) * nu + i) * nu + j];
    l->H = numbers(n * n);
    l->F = numbers(n * width);
    l->rows = numbers(n * n);
    for (size_t i = 0; i < n; i++) {
        l->rows[i * n + i] = 1.0;
        if (i >= nu)
            l->rows[i * n + i - nu] = -1.0;
    }
    for (size_t i = 0; i < n; i++) {
        for (size_t j = 0; j < n; j++) {
            double sum = 0.0;

            for (size_t k = 0; k < n; k++)
                sum += S[k * n + i] * S[k * n + j] + 0.1 * l->rows[k * n + i] * l->rows[k * n + j];
            l->H[i * n + j] = sum;
        }
        for (size_t k = 0; k < n; k++) {
            for (size_t j = 0; j < nx; j++)
                l->F[i * width + j] += S[k * n + i] * P[(k / nu * nu + k % nu) * nx + j];
            l->F[i * width + nx + nu + k % nu] -= S[k * n + i];
        }
        if (i < nu)
            l->F[i * width + nx + i] = -0.1;
    }
    free(P);
    free(G);
    free(S);
    free(power);
    free(next);
}

/** Run the loop with apc_qp and keep what it asked. */
static void record(struct loop *l, uint64_t seed)
{
    struct apc_random random;
    struct apc_error why;
    struct apc_qp *qp = NULL;
    size_t n = l->n, nu = l->nu, nx = l->nx, width = nx + 2 * nu;
    double *x = numbers(nx), *next = numbers(nx), *u = numbers(n), *last = numbers(nu), *r = numbers(nu),
           *z = numbers(width);

    apc_random_init(&random, seed, "run");
    l->f = numbers(STEPS * n);
    l->low = numbers(STEPS * 2 * n);
    l->high = numbers(STEPS * 2 * n);
    if (apc_qp_create(&qp, n, n, NULL, &why) || apc_qp_set(qp, l->H, l->rows, &why)) {
        fprintf(stderr, "%s\n", why.text);
        exit(1);
    }
    for (size_t k = 0; k < STEPS; k++) {
        double *f = l->f + k * n, *low = l->low + k * 2 * n, *high = l->high + k * 2 * n;

        if (k % 40 == 0)
            for (size_t i = 0; i < nu; i++)
                r[i] = 2.0 * apc_random_normal(&random);
        memcpy(z, x, nx * sizeof *z);
        memcpy(z + nx, last, nu * sizeof *z);
        memcpy(z + nx + nu, r, nu * sizeof *z);
        for (size_t i = 0; i < n; i++) {
            for (size_t j = 0; j < width; j++)
                f[i] += l->F[i * width + j] * z[j];
            low[i] = -1.0;
            high[i] = 1.0;
            low[n + i] = -0.1 + (i < nu ? last[i] : 0.0);
            high[n + i] = 0.1 + (i < nu ? last[i] : 0.0);
        }
        if (apc_qp_solve(qp, f, low, high, u, NULL)) {
            fprintf(stderr, "step %zu was not solved\n", k);
            exit(1);
        }
        memcpy(last, u, nu * sizeof *u);
        for (size_t i = 0; i < nx; i++) {
            next[i] = 0.01 * apc_random_normal(&random) + (k == STEPS / 2 ? 1.0 : 0.0);
            for (size_t j = 0; j < nx; j++)
                next[i] += l->A[i * nx + j] * x[j];
            for (size_t j = 0; j < nu; j++)
                next[i] += l->B[i * nu + j] * last[j];
        }
        memcpy(x, next, nx * sizeof *x);
    }
    apc_qp_destroy(qp);
    free(x), free(next), free(u), free(last), free(r), free(z);
}

static double now(void)
{
    struct timespec t;

    clock_gettime(CLOCK_THREAD_CPUTIME_ID, &t);
    return (double)t.tv_sec * 1e6 + (double)t.tv_nsec * 1e-3;
}

struct figures {
    double least[STEPS];
    double worst_change; /* largest |x - x of apc_qp| */
    unsigned most, sum;
};

static void ours(const struct loop *l, struct figures *g, double *answer)
{
    struct apc_error why;
    struct apc_qp *qp = NULL;

    if (apc_qp_create(&qp, l->n, l->n, NULL, &why) || apc_qp_set(qp, l->H, l->rows, &why))
        exit(1);
    g->sum = 0;
    for (size_t k = 0; k < STEPS; k++) {
        struct apc_qp_result result = {.size = sizeof result};
        double begun = now(), took;

        if (apc_qp_solve(qp, l->f + k * l->n, l->low + k * 2 * l->n, l->high + k * 2 * l->n,
                         answer + k * l->n, &result))
            exit(1);
        took = now() - begun;
        g->least[k] = g->least[k] == 0.0 || took < g->least[k] ? took : g->least[k];
        g->most = result.iterations > g->most ? result.iterations : g->most;
        g->sum += result.iterations;
    }
    apc_qp_destroy(qp);
}

static void daqp(const struct loop *l, struct figures *g, const double *answer)
{
    size_t n = l->n;
    int *sense = calloc(2 * n, sizeof *sense);
    double *H = numbers(n * n), *A = numbers(n * n);
    DAQPProblem p = {(int)n, (int)(2 * n), (int)n, H, l->f, A, l->high, l->low, sense};
    DAQPWorkspace work;
    DAQPResult res = {.x = numbers(n), .lam = numbers(2 * n)};

    memset(&work, 0, sizeof work);
    memcpy(H, l->H, n * n * sizeof *H);
    memcpy(A, l->rows, n * n * sizeof *A);
    allocate_daqp_settings(&work);
    work.settings->primal_tol = 1e-9;
    if (setup_daqp(&p, &work, NULL) < 0)
        exit(1);
    g->sum = 0;
    for (size_t k = 0; k < STEPS; k++) {
        double begun = now(), took;

        work.qp->f = l->f + k * n;
        work.qp->bupper = l->high + k * 2 * n;
        work.qp->blower = l->low + k * 2 * n;
        update_ldp(UPDATE_v | UPDATE_d, &work);
        daqp_solve(&res, &work);
        took = now() - begun;
        if (res.exitflag < 0) {
            fprintf(stderr, "DAQP: %d at step %zu\n", res.exitflag, k);
            exit(1);
        }
        for (size_t i = 0; i < n; i++)
            g->worst_change = fmax(g->worst_change, fabs(res.x[i] - answer[k * n + i]));
        g->least[k] = g->least[k] == 0.0 || took < g->least[k] ? took : g->least[k];
        g->most = (unsigned)res.iter > g->most ? (unsigned)res.iter : g->most;
        g->sum += (unsigned)res.iter;
    }
    free_daqp_workspace(&work);
    free_daqp_ldp(&work);
    free(sense), free(H), free(A), free(res.x), free(res.lam);
}

/* What a solve took, and how far its answer is from ours. */
static void note(struct figures *g, size_t k, double took, size_t n, const double *x, const double *answer)
{
    for (size_t i = 0; i < n; i++)
        g->worst_change = fmax(g->worst_change, fabs(x[i] - answer[k * n + i]));
    g->least[k] = g->least[k] == 0.0 || took < g->least[k] ? took : g->least[k];
}

/** Columns of a matrix [m * n], after those of the identity where @p bounds says so; @p upper: its triangle. */
static OSQPCscMatrix columns(size_t m, size_t n, const double *a, bool bounds, bool upper)
{
    OSQPCscMatrix to;
    OSQPFloat *x = calloc((m + 1) * n, sizeof *x);
    OSQPInt *row = calloc((m + 1) * n, sizeof *row), *first = calloc(n + 1, sizeof *first), used = 0;

    for (size_t c = 0; c < n; c++) {
        if (bounds) {
            row[used] = (OSQPInt)c;
            x[used++] = 1.0;
        }
        for (size_t r = 0; r < (upper ? c + 1 : m); r++)
            if (a[r * n + c] != 0.0) {
                row[used] = (OSQPInt)(r + (bounds ? n : 0));
                x[used++] = a[r * n + c];
            }
        first[c + 1] = used;
    }
    OSQPCscMatrix_set_data(&to, (OSQPInt)(m + (bounds ? n : 0)), (OSQPInt)n, used, x, row, first);
    return to;
}

static void osqp(const struct loop *l, struct figures *g, const double *answer)
{
    size_t n = l->n;
    OSQPCscMatrix P = columns(n, n, l->H, false, true), A = columns(n, n, l->rows, true, false);
    OSQPSettings settings;
    OSQPSolver *solver = NULL;

    osqp_set_default_settings(&settings);
    settings.verbose = 0;
    settings.eps_abs = settings.eps_rel = 1e-6;
    settings.max_iter = 100000;
    if (osqp_setup(&solver, &P, l->f, &A, l->low, l->high, (OSQPInt)(2 * n), (OSQPInt)n, &settings))
        exit(1);
    for (size_t k = 0; k < STEPS; k++) {
        double begun = now(), took;

        osqp_update_data_vec(solver, l->f + k * n, l->low + k * 2 * n, l->high + k * 2 * n);
        osqp_solve(solver);
        took = now() - begun;
        g->sum += solver->info->status_val != OSQP_SOLVED;
        note(g, k, took, n, solver->solution->x, answer);
    }
    osqp_cleanup(solver);
    free(P.x), free(P.i), free(P.p), free(A.x), free(A.i), free(A.p);
}

static void hpipm(const struct loop *l, struct figures *g, const double *answer)
{
    size_t n = l->n;
    struct d_dense_qp_dim dim;
    struct d_dense_qp qp;
    struct d_dense_qp_sol sol;
    struct d_dense_qp_ipm_arg arg;
    struct d_dense_qp_ipm_ws work;
    int *bound = calloc(n, sizeof *bound), most = 200, status;
    double *x = numbers(n), tolerance = 1e-8;
    void *memory[5];

    memory[0] = calloc(1, d_dense_qp_dim_memsize());
    d_dense_qp_dim_create(&dim, memory[0]);
    d_dense_qp_dim_set_all((int)n, 0, (int)n, (int)n, 0, &dim);
    memory[1] = calloc(1, d_dense_qp_memsize(&dim));
    d_dense_qp_create(&dim, &qp, memory[1]);
    memory[2] = calloc(1, d_dense_qp_sol_memsize(&dim));
    d_dense_qp_sol_create(&dim, &sol, memory[2]);
    memory[3] = calloc(1, d_dense_qp_ipm_arg_memsize(&dim));
    d_dense_qp_ipm_arg_create(&dim, &arg, memory[3]);
    d_dense_qp_ipm_arg_set_default(SPEED, &arg);
    d_dense_qp_ipm_arg_set_tol_stat(&tolerance, &arg);
    d_dense_qp_ipm_arg_set_tol_ineq(&tolerance, &arg);
    d_dense_qp_ipm_arg_set_tol_comp(&tolerance, &arg);
    d_dense_qp_ipm_arg_set_iter_max(&most, &arg);
    memory[4] = calloc(1, d_dense_qp_ipm_ws_memsize(&dim, &arg));
    d_dense_qp_ipm_ws_create(&dim, &arg, &work, memory[4]);
    for (size_t i = 0; i < n; i++)
        bound[i] = (int)i;
    double *transposed = numbers(n * n); /* columns first */

    for (size_t i = 0; i < n * n; i++)
        transposed[i % n * n + i / n] = l->rows[i];
    d_dense_qp_set_H(l->H, &qp);
    d_dense_qp_set_C(transposed, &qp);
    d_dense_qp_set_idxb(bound, &qp);
    for (size_t k = 0; k < STEPS; k++) {
        double begun = now(), took;

        d_dense_qp_set_g(l->f + k * n, &qp);
        d_dense_qp_set_lb(l->low + k * 2 * n, &qp);
        d_dense_qp_set_ub(l->high + k * 2 * n, &qp);
        d_dense_qp_set_lg(l->low + k * 2 * n + n, &qp);
        d_dense_qp_set_ug(l->high + k * 2 * n + n, &qp);
        d_dense_qp_ipm_solve(&qp, &sol, &arg, &work);
        took = now() - begun;
        d_dense_qp_ipm_get_status(&work, &status);
        g->sum += status != 0;
        d_dense_qp_sol_get_v(&sol, x);
        note(g, k, took, n, x, answer);
    }
    for (size_t i = 0; i < 5; i++)
        free(memory[i]);
    free(bound), free(x), free(transposed);
}

static int rising(const void *a, const void *b)
{
    double x = *(const double *)a, y = *(const double *)b;

    return (x > y) - (x < y);
}

/* Beside ours, which is sorted. */
static void tell(const char *name, struct figures *g, const struct figures *own)
{
    qsort(g->least, STEPS, sizeof(double), rising);
    printf(
        "    %-20s median %9.2f  p99 %9.2f us   %6.1f %6.1f times apc_qp's   |dx| %.1e, unsolved %u of %d\n",
        name, g->least[STEPS / 2], g->least[STEPS * 99 / 100], g->least[STEPS / 2] / own->least[STEPS / 2],
        g->least[STEPS * 99 / 100] / own->least[STEPS * 99 / 100], g->worst_change, g->sum,
        SLOW_ROUNDS * STEPS);
}

int main(void)
{
    static const size_t sizes[][2] = {{2, 20}, {2, 100}, {4, 50}, {10, 20}};

    puts("inputs x horizon  n/rows    apc_qp median  p99  max us (iterations)   DAQP median  p99  max us "
         "(iterations)   ratio median  p99   |dx|");
    for (size_t s = 0; s < 4; s++) {
        struct loop l;
        struct figures a = {0}, b = {0}, o = {0}, h = {0};
        double *answer;

        make(&l, sizes[s][0], sizes[s][1], 1);
        record(&l, 2);
        answer = numbers(STEPS * l.n);
        for (int round = 0; round < ROUNDS; round++) {
            ours(&l, &a, answer);
            daqp(&l, &b, answer);
            if (round < SLOW_ROUNDS) {
                osqp(&l, &o, answer);
                hpipm(&l, &h, answer);
            }
        }
        qsort(a.least, STEPS, sizeof(double), rising);
        qsort(b.least, STEPS, sizeof(double), rising);
        printf("%6zu x %-7zu %4zu/%-4zu   %9.2f %8.2f %8.2f (%u, %.1f)   %9.2f %8.2f %8.2f (%u, %.1f)   "
               "%8.2f %8.2f   %.1e\n",
               l.nu, l.horizon, l.n, 2 * l.n, a.least[STEPS / 2], a.least[STEPS * 99 / 100],
               a.least[STEPS - 1], a.most, (double)a.sum / STEPS, b.least[STEPS / 2],
               b.least[STEPS * 99 / 100], b.least[STEPS - 1], b.most, (double)b.sum / STEPS,
               a.least[STEPS / 2] / b.least[STEPS / 2], a.least[STEPS * 99 / 100] / b.least[STEPS * 99 / 100],
               b.worst_change);
        tell("OSQP, 1e-6", &o, &a);
        tell("HPIPM, dense, 1e-8", &h, &a);
    }
    return 0;
}

/* SPDX-License-Identifier: BSD-3-Clause */
/* The linear model of a model file. */
#include "linearize.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>
#include <strings.h>
#include <sys/stat.h>

#include "common/exitcode.h"
#include "experiment/experiment.h"

struct analysis {
    struct model_file file;
    size_t nx;
    double *memory, *A, *B, *C, *D, *x, *gain, *rga, *dead_time;
    double complex *pole, *zero;
    int n_zeros, gain_rc, rga_rc; /* or the error */
};

bool linearize_is_file(const char *name)
{
    static const char *const plug_in[] = {".so", ".fmu", ".py"};
    const char *end = strrchr(name, '.');
    struct stat file;

    for (size_t i = 0; end && i < sizeof plug_in / sizeof *plug_in; i++)
        if (!strcasecmp(end, plug_in[i]))
            return false;
    if (!strpbrk(name, "./")) /* a built-in one */
        return false;
    return (end && !strcmp(end, ".model")) || (stat(name, &file) == 0 && S_ISREG(file.st_mode));
}

/* ---- Transfer functions, their dead times left out ------------------------------------------------ */

static size_t lags(const struct apc_transfer *g)
{
    return g->gain == 0 ? 0 : (size_t)(g->tau[0] > 0) + (size_t)(g->tau[1] > 0);
}

static bool integrates(const struct analysis *z, size_t i)
{
    bool any = false;
    for (size_t j = 0; j < z->file.inputs; j++)
        any |= z->file.g[i * z->file.inputs + j].integrating;
    return any;
}

static size_t count_states(const struct analysis *z)
{
    size_t n = 0;
    for (size_t i = 0; i < z->file.outputs; i++) {
        n += integrates(z, i);
        for (size_t j = 0; j < z->file.inputs; j++)
            n += lags(&z->file.g[i * z->file.inputs + j]);
    }
    return n;
}

/* x1' = (u - x1) / tau1, x2' = (x1 - x2) / tau2, from state @p at on; what comes out of them is @p states
 * [nx] x + *@p direct u: gain (v + zero v'), v the last of them. */
static void put_lags(struct analysis *z, const struct apc_transfer *g, size_t j, size_t at, double *states,
                     double *direct)
{
    const size_t n = lags(g), nu = z->file.inputs;
    const double lead = n ? g->gain * g->zero / g->tau[n - 1] : 0;

    for (size_t k = at; k < at + n; k++) {
        z->A[k * z->nx + k] = -1 / g->tau[k - at];
        if (k > at)
            z->A[k * z->nx + k - 1] = 1 / g->tau[k - at];
        else
            z->B[k * nu + j] = 1 / g->tau[0];
    }
    if (n > 0)
        states[at + n - 1] += g->gain - lead;
    if (n > 1)
        states[at] += lead;
    else
        *direct += n ? lead : g->gain;
}

static void realise(struct analysis *z)
{
    const size_t nu = z->file.inputs;
    size_t at = 0;

    for (size_t i = 0; i < z->file.outputs; i++) {
        const size_t integrator = at;

        if (integrates(z, i))
            z->C[i * z->nx + at++] = 1;
        for (size_t j = 0; j < nu; j++) {
            const struct apc_transfer *g = &z->file.g[i * nu + j];
            double *into_states = g->integrating ? z->A + integrator * z->nx : z->C + i * z->nx;
            double *into_direct = g->integrating ? &z->B[integrator * nu + j] : &z->D[i * nu + j];

            put_lags(z, g, j, at, into_states, into_direct);
            at += lags(g);
        }
    }
}

/* ---- Dead times ------------------------------------------------------------------------------------- */

/* Of a sampled model the samples until an input shows, but for the one that is none: what is written after a
 * sample shows in the next. */
static void find_dead_times(struct analysis *z)
{
    const struct model_file *f = &z->file;
    const size_t nx = z->nx, nu = f->inputs;

    for (size_t k = 0; k < f->outputs * nu; k++) {
        const size_t i = k / nu, j = k % nu;
        double *x = z->x, *next = x + nx, largest = fabs(z->D[k]);
        size_t first = 0;

        z->dead_time[k] = f->g ? f->g[k].dead_time : f->dead_time[j];
        for (size_t q = 0; q < nx; q++)
            x[q] = z->B[q * nu + j];
        for (size_t n = 1; n <= nx && f->period; n++) {
            double y = 0;
            for (size_t q = 0; q < nx; q++)
                y += z->C[i * nx + q] * x[q];
            first = fabs(y) > 1e-9 * largest && largest <= 0 ? n : first;
            largest = fmax(largest, fabs(y));
            for (size_t p = 0; p < nx; p++) {
                next[p] = 0;
                for (size_t q = 0; q < nx; q++)
                    next[p] += z->A[p * nx + q] * x[q];
            }
            memcpy(x, next, nx * sizeof *x);
        }
        if (first > 1)
            z->dead_time[k] = (double)(first - 1) * apc_ns_to_s(f->period);
    }
}

/* ---- All of it -------------------------------------------------------------------------------------- */

static int allocate_file_analysis(struct analysis *z)
{
    const size_t nu = z->file.inputs, ny = z->file.outputs,
                 nx = z->nx = z->file.g ? count_states(z) : z->file.nx;
    double *at = z->memory = calloc(2 * nx * nx + nx * nu + ny * nx + 4 * ny * nu + 2 * nx + 1, sizeof *at);

    z->pole = calloc(nx + 1, sizeof *z->pole);
    z->zero = calloc(nx + 1, sizeof *z->zero);
    if (!at || !z->pole || !z->zero)
        return APC_ENOMEM;
    z->A = at;
    z->B = z->A + 2 * nx * nx; /* room for A - I behind A */
    z->C = z->B + nx * nu;
    z->D = z->C + ny * nx;
    z->gain = z->D + ny * nu;
    z->rga = z->gain + ny * nu;
    z->dead_time = z->rga + ny * nu;
    z->x = z->dead_time + ny * nu;
    return 0;
}

static int analyze_model_file(struct analysis *z)
{
    const size_t nx = z->nx, nu = z->file.inputs, ny = z->file.outputs;
    struct linear sys = {nx, nu, ny, z->A, z->B, z->C, z->D};
    int rc = linear_poles(&sys, z->pole);

    if (rc < 0)
        return rc;
    z->n_zeros = linear_zeros(&sys, z->zero);
    if (z->file.period) { /* x = A x + B u is 0 = (A - I) x + B u */
        sys.a = z->A + nx * nx;
        for (size_t i = 0; i < nx * nx; i++)
            sys.a[i] = z->A[i] - (i % (nx + 1) == 0);
    }
    z->gain_rc = linear_gain(&sys, z->gain);
    z->rga_rc = z->gain_rc == 0 && nu == ny ? linear_rga(z->gain, nu, z->rga) : APC_ESTATE;
    find_dead_times(z);
    return 0;
}

static void show_model_file(const struct cli *cli, const struct analysis *z)
{
    const struct model_file *f = &z->file;
    const size_t nx = z->nx, nu = f->inputs, ny = f->outputs;
    struct linearize_view v = {
        .name = cli->args[0],
        .kind = "model",
        .at = "its operating point",
        .period = apc_ns_to_s(f->period),
        .nx = nx,
        .nu = nu,
        .ny = ny,
        .x = f->x0,
        .u = f->u0,
        .y = f->y0,
        .names_x = {.letter = 'x', .n = nx},
        .names_u = {.tag = f->input, .n = nu},
        .names_y = {.tag = f->output, .n = ny},
        .n_matrices = z->gain_rc < 0             ? 5
                      : z->rga_rc < 0 || nu == 1 ? 6
                                                 : 7,
        .pole = z->pole,
        .zero = z->zero,
        .n_zeros = z->n_zeros,
        .integrates = z->gain_rc < 0,
    };
    const struct linearize_matrix all[] = {
        {"A", "A", z->A, nx, nx, &v.names_x, &v.names_x},
        {"B", "B", z->B, nx, nu, &v.names_x, &v.names_u},
        {"C", "C", z->C, ny, nx, &v.names_y, &v.names_x},
        {"D", "D", z->D, ny, nu, &v.names_y, &v.names_u},
        {"dead_time", "dead time, s", z->dead_time, ny, nu, &v.names_y, &v.names_u},
        {"gain", "steady-state gain", z->gain, ny, nu, &v.names_y, &v.names_u},
        {"rga", "relative gain array", z->rga, ny, nu, &v.names_y, &v.names_u},
    };

    memcpy(v.matrix, all, sizeof all);
    linearize_show(cli, &v);
}

int linearize_file(const struct cli *cli)
{
    struct analysis z = {.n_zeros = 0};
    struct apc_error why;
    int rc = model_file_load(&z.file, cli->args[0], &why);

    if (rc == 0)
        rc = linear_load(&why);
    if (rc == 0 && allocate_file_analysis(&z) < 0)
        rc = apc_fail(&why, APC_ENOMEM, "out of memory");
    if (rc == 0 && z.file.g)
        realise(&z);
    if (rc == 0 && !z.file.g) {
        memcpy(z.A, z.file.A, z.nx * z.nx * sizeof *z.A);
        memcpy(z.B, z.file.B, z.nx * z.file.inputs * sizeof *z.B);
        memcpy(z.C, z.file.C, z.file.outputs * z.nx * sizeof *z.C);
        memcpy(z.D, z.file.D, z.file.outputs * z.file.inputs * sizeof *z.D);
    }
    if (rc == 0 && (rc = analyze_model_file(&z)) < 0)
        apc_fail(&why, rc, "%s: the poles could not be computed", cli->args[0]);
    if (rc == 0)
        show_model_file(cli, &z);
    else
        cli_error(cli, rc, "%s", why.text);
    model_file_free(&z.file);
    free(z.memory);
    free(z.pole);
    free(z.zero);
    return rc == 0 ? EXIT_OK : exit_code_of(rc);
}

/* SPDX-License-Identifier: BSD-3-Clause */
/*
 * SUNDIALS CVODE. This file alone includes it: 6.4.1 and 7.x differ.
 *
 * BDF with Newton and a dense Jacobian unless Adams, with a fixed-point iteration, is asked for, although
 * Adams is quicker by a third on the paper's plant: reactors and other chemistry are stiff, and there Adams
 * ends in an error or takes thousands of steps, which a tick cannot afford. Where BDF is not needed it costs
 * a few us more of a tick of milliseconds.
 *
 * The input is constant over a step and jumps between steps, so each step starts the method afresh
 * (CVodeReInit uses the memory again) and CVODE is told never to look past the step's end. Nothing is
 * allocated after create, not by the first step either, which is why the Jacobian is our own. Each step runs
 * over [0, dt]: CVODE sees small times however long the plant has run.
 */
#include "plant/plant_internal.h"

#include <cvode/cvode.h>
#include <float.h>
#include <math.h>
#include <nvector/nvector_serial.h>
#include <stdlib.h>
#include <string.h>
#include <sunlinsol/sunlinsol_dense.h>
#include <sunmatrix/sunmatrix_dense.h>
#include <sunnonlinsol/sunnonlinsol_fixedpoint.h>

_Static_assert(sizeof(sunrealtype) == sizeof(double), "SUNDIALS must be built for double precision");

/* Ends a step that would otherwise go on for seconds; a fast reactor takes some hundred. */
#define MAX_INTERNAL_STEPS 20000

struct solver {
    const struct apc_model *model;
    const double *p, *u;
    double t0; /* plant time at the begin of the step */
    SUNContext context;
    void *memory;
    N_Vector state;
    SUNMatrix system, jacobian; /* I - gamma J, and J */
    double zero_scale;          /* a state below it counts as zero to the tolerances */
    SUNLinearSolver linear;
    SUNNonlinearSolver fixed_point; /* of Adams, else NULL */
    struct apc_error error;         /* what CVODE had to say last */
};

#if SUNDIALS_VERSION_MAJOR < 7
#define SUN_COMM_NULL NULL
#endif

/* For CVODE: 0, above 0 try a shorter step, below 0 give up. */
static int cvode_derivative(sunrealtype t, N_Vector state, N_Vector out, void *user)
{
    struct solver *s = user;
    double *dx = N_VGetArrayPointer(out);

    if (s->model->f(s->t0 + t, N_VGetArrayPointer(state), s->u, s->p, dx))
        return -1;
    for (size_t i = 0; i < s->model->nx; i++) {
        if (!isfinite(dx[i]))
            return 1;
    }
    return 0;
}

/* J by forward differences. CVODE has its own, but that allocates at every call. */
static int cvode_jacobian(struct solver *s, sunrealtype t, N_Vector state, N_Vector f, N_Vector shifted)
{
    double *x = N_VGetArrayPointer(state);
    const double *f0 = N_VGetArrayPointer(f), *f1 = N_VGetArrayPointer(shifted);

    for (size_t j = 0; j < s->model->nx; j++) {
        double *column = SUNDenseMatrix_Column(s->jacobian, (sunindextype)j);
        double own = x[j];
        double h = sqrt(DBL_EPSILON) * fmax(fabs(own), s->zero_scale);
        int rc;

        x[j] = own + h;
        h = x[j] - own; /* what was really added */
        rc = cvode_derivative(t, state, shifted, s);
        x[j] = own;
        if (rc)
            return rc;
        for (size_t i = 0; i < s->model->nx; i++)
            column[i] = (f1[i] - f0[i]) / h;
    }
    return 0;
}

/* The matrix of Newton's method, I - gamma J; a former J will do when CVODE says so. */
static int newton_matrix(sunrealtype t, N_Vector state, N_Vector f, SUNMatrix out, sunbooleantype former_ok,
                         sunbooleantype *anew, sunrealtype gamma, void *user, N_Vector a, N_Vector b,
                         N_Vector c)
{
    struct solver *s = user;
    int rc = former_ok ? 0 : cvode_jacobian(s, t, state, f, a);

    (void)b;
    (void)c;
    *anew = !former_ok;
    if (rc)
        return rc;
    if (SUNMatCopy(s->jacobian, out) || SUNMatScaleAddI(-gamma, out))
        return -1;
    return 0;
}

/* CVODE would print to stderr; a library does not. */
#if SUNDIALS_VERSION_MAJOR < 7
static void keep_message(int code, const char *module, const char *function, char *message, void *user)
{
    struct solver *s = user;

    if (code < 0)
        (void)apc_fail(&s->error, APC_ESOLVER, "%s %s: %s", module, function, message);
}

static int keep_messages(struct solver *s)
{
    return CVodeSetErrHandlerFn(s->memory, keep_message, s);
}
#else
static void keep_message(int line, const char *function, const char *file, const char *message,
                         SUNErrCode code, void *user, SUNContext context)
{
    struct solver *s = user;

    (void)line;
    (void)file;
    (void)context;
    if (code < 0)
        (void)apc_fail(&s->error, APC_ESOLVER, "CVODE %s: %s", function, message);
}

static int keep_messages(struct solver *s)
{
    int rc = SUNContext_ClearErrHandlers(s->context);

    if (rc == SUN_SUCCESS)
        rc = SUNContext_PushErrHandler(s->context, keep_message, s);
    return rc == SUN_SUCCESS ? CVodeSetMaxHnilWarns(s->memory, -1) : CV_MEM_FAIL;
}
#endif

static void cvode_destroy(void *self)
{
    struct solver *s = self;

    if (!s)
        return;
    if (s->memory)
        CVodeFree(&s->memory);
    if (s->fixed_point)
        SUNNonlinSolFree(s->fixed_point);
    if (s->linear)
        SUNLinSolFree(s->linear);
    if (s->system)
        SUNMatDestroy(s->system);
    if (s->jacobian)
        SUNMatDestroy(s->jacobian);
    if (s->state)
        N_VDestroy(s->state);
    if (s->context)
        SUNContext_Free(&s->context);
    free(s);
}

static int configure(struct solver *s, double rtol, double atol)
{
    int rc = keep_messages(s);

    if (rc == CV_SUCCESS)
        rc = CVodeInit(s->memory, cvode_derivative, 0.0, s->state);
    if (rc == CV_SUCCESS)
        rc = CVodeSetUserData(s->memory, s);
    if (rc == CV_SUCCESS)
        rc = CVodeSStolerances(s->memory, rtol, atol);
    if (rc == CV_SUCCESS)
        rc = CVodeSetMaxNumSteps(s->memory, MAX_INTERNAL_STEPS);
    if (rc == CV_SUCCESS && s->fixed_point)
        return CVodeSetNonlinearSolver(s->memory, s->fixed_point);
    if (rc == CV_SUCCESS)
        rc = CVodeSetLinearSolver(s->memory, s->linear, s->system);
    if (rc == CV_SUCCESS)
        rc = CVodeSetLinSysFn(s->memory, newton_matrix);
    return rc;
}

static int cvode_create(int method, void **self, const struct apc_model *model, const double *p,
                        const struct apc_plant_options *options, struct apc_error *why)
{
    sunindextype nx = (sunindextype)model->nx;
    struct solver *s = calloc(1, sizeof(*s));
    int rc = APC_ENOMEM, cv;

    if (!s)
        goto fail;
    s->model = model;
    s->p = p;
    s->zero_scale = options->atol / options->rtol;
    if (SUNContext_Create(SUN_COMM_NULL, &s->context) < 0)
        goto fail;
    s->state = N_VNew_Serial(nx, s->context);
    s->system = SUNDenseMatrix(nx, nx, s->context);
    s->jacobian = SUNDenseMatrix(nx, nx, s->context);
    if (!s->state || !s->system || !s->jacobian)
        goto fail;
    s->linear = SUNLinSol_Dense(s->state, s->system, s->context);
    s->memory = CVodeCreate(method, s->context);
    if (method == CV_ADAMS)
        s->fixed_point = SUNNonlinSol_FixedPoint(s->state, 0, s->context);
    if (!s->linear || !s->memory || (method == CV_ADAMS && !s->fixed_point))
        goto fail;
    N_VConst(0.0, s->state);
    cv = configure(s, options->rtol, options->atol);
    if (cv != CV_SUCCESS) {
        rc = cv == CV_MEM_FAIL || cv == CVLS_MEM_FAIL ? APC_ENOMEM : APC_ESOLVER;
        goto fail;
    }
    *self = s;
    return 0;

fail:
    (void)apc_fail(why, rc, "integrator CVODE could not be set up: %s",
                   s && s->error.text[0] ? s->error.text : apc_err_text(rc));
    cvode_destroy(s);
    return rc;
}

static int cvode_step(void *self, double t, double dt, const double *u, double *x, struct apc_error *why)
{
    struct solver *s = self;
    size_t nx = s->model->nx;
    double *state = N_VGetArrayPointer(s->state);
    sunrealtype reached = 0.0;
    int rc;

    s->t0 = t;
    s->u = u;
    s->error.text[0] = '\0';
    memcpy(state, x, nx * sizeof(*x));
    rc = CVodeReInit(s->memory, 0.0, s->state);
    if (rc == CV_SUCCESS)
        rc = CVodeSetStopTime(s->memory, dt);
    if (rc == CV_SUCCESS)
        rc = CVode(s->memory, dt, s->state, &reached, CV_NORMAL);
    if (rc < 0)
        return apc_fail(why, APC_ESOLVER, "%s", s->error.text[0] ? s->error.text : "CVODE gave up");
    for (size_t i = 0; i < nx; i++) {
        if (!isfinite(state[i]))
            return apc_fail(why, APC_ESOLVER, "state %zu is no longer a finite number", i + 1);
    }
    memcpy(x, state, nx * sizeof(*x));
    return 0;
}

static int create_bdf(void **self, const struct apc_model *model, const double *p,
                      const struct apc_plant_options *options, struct apc_error *why)
{
    return cvode_create(CV_BDF, self, model, p, options, why);
}

static int create_adams(void **self, const struct apc_model *model, const double *p,
                        const struct apc_plant_options *options, struct apc_error *why)
{
    return cvode_create(CV_ADAMS, self, model, p, options, why);
}

const struct apc_integrator apc_integrator_cvode = {
    .name = "cvode", .create = create_bdf, .step = cvode_step, .destroy = cvode_destroy};
const struct apc_integrator apc_integrator_adams = {
    .name = "adams", .create = create_adams, .step = cvode_step, .destroy = cvode_destroy};

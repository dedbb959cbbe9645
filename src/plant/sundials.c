/* SPDX-License-Identifier: BSD-3-Clause */
/*
 * SUNDIALS: CVODE for x' = f, IDA where algebraic equations come with it. This file alone includes it: 6.4.1
 * and 7.x differ.
 *
 * CVODE: BDF with Newton and a dense Jacobian unless Adams, with a fixed-point iteration, is asked for, although
 * Adams is quicker by a third on the paper's plant: reactors and other chemistry are stiff, and there Adams
 * ends in an error or takes thousands of steps, which a tick cannot afford. Where BDF is not needed it costs
 * a few us more of a tick of milliseconds.
 *
 * The input is constant over a step and jumps between steps, so each step starts the method afresh
 * (CVodeReInit and IDAReInit use the memory again) and the solver is told never to look past the step's end.
 * Nothing is allocated after create, not by the first step either, which is why the Jacobian is our own. Each
 * step runs over [0, dt]: the solver sees small times however long the plant has run.
 *
 * The algebraic variables jump with the input, so before each step they are solved anew (algebraic.c).
 */
#include "plant/plant_internal.h"

#include <cvode/cvode.h>
#include <float.h>
#include <ida/ida.h>
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
    N_Vector state, rate,
        differential;           /* the last two of IDA: x', and 1 for a state, 0 for what is algebraic */
    SUNMatrix system, jacobian; /* what is factored; J of CVODE, whose system is I - gamma J */
    double zero_scale;          /* a state below it counts as zero to the tolerances */
    SUNLinearSolver linear;
    SUNNonlinearSolver fixed_point;  /* of Adams, else NULL */
    struct apc_algebraic *algebraic; /* of IDA, else NULL */
    struct apc_error error;          /* what the solver had to say last */
    struct apc_error model_error;    /* what the model had to say in this step */
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

/* For IDA: r [nx + nz] = f - x', and the residuals. Returns as cvode_derivative(). */
static int ida_residual(sunrealtype t, N_Vector state, N_Vector rate, N_Vector out, void *user)
{
    struct solver *s = user;
    const double *dx = N_VGetArrayPointer(rate);
    double *r = N_VGetArrayPointer(out);

    if (apc_model_derivative(s->model, s->t0 + t, N_VGetArrayPointer(state), s->u, s->p, r, &s->model_error))
        return 1;
    for (size_t i = 0; i < s->model->nx; i++)
        r[i] -= dx[i];
    return 0;
}

/* d r/d x + c d r/d x', by forward differences. */
static int ida_jacobian(sunrealtype t, sunrealtype c, N_Vector state, N_Vector rate, N_Vector r,
                        SUNMatrix out, void *user, N_Vector shifted, N_Vector b, N_Vector d)
{
    struct solver *s = user;
    const size_t nx = s->model->nx, n = nx + apc_model_nz(s->model);
    double *x = N_VGetArrayPointer(state);
    const double *r0 = N_VGetArrayPointer(r), *r1 = N_VGetArrayPointer(shifted);

    (void)b;
    (void)d;
    for (size_t j = 0; j < n; j++) {
        double *column = SUNDenseMatrix_Column(out, (sunindextype)j);
        const double own = x[j], least = j < nx ? s->zero_scale : fmax(s->zero_scale, APC_ALGEBRAIC_SCALE);
        double h = sqrt(DBL_EPSILON) * fmax(fabs(own), least);
        int rc;

        x[j] = own + h;
        h = x[j] - own; /* what was really added */
        rc = ida_residual(t, state, rate, shifted, s);
        x[j] = own;
        if (rc)
            return rc;
        for (size_t i = 0; i < n; i++)
            column[i] = (r1[i] - r0[i]) / h;
        if (j < nx)
            column[j] -= c;
    }
    return 0;
}

/* SUNDIALS would print to stderr; a library does not. */
#if SUNDIALS_VERSION_MAJOR < 7
static void keep_message(int code, const char *module, const char *function, char *message, void *user)
{
    struct solver *s = user;

    if (code < 0)
        (void)apc_fail(&s->error, APC_ESOLVER, "%s %s: %s", module, function, message);
}

static int keep_messages(struct solver *s)
{
    return s->algebraic ? IDASetErrHandlerFn(s->memory, keep_message, s)
                        : CVodeSetErrHandlerFn(s->memory, keep_message, s);
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
        (void)apc_fail(&s->error, APC_ESOLVER, "%s %s: %s", s->algebraic ? "IDA" : "CVODE", function,
                       message);
}

static int keep_messages(struct solver *s)
{
    int rc = SUNContext_ClearErrHandlers(s->context);

    if (rc == SUN_SUCCESS)
        rc = SUNContext_PushErrHandler(s->context, keep_message, s);
    if (rc != SUN_SUCCESS)
        return CV_MEM_FAIL;
    return s->algebraic ? IDA_SUCCESS : CVodeSetMaxHnilWarns(s->memory, -1);
}
#endif

static void sundials_destroy(void *self)
{
    struct solver *s = self;

    if (!s)
        return;
    if (s->memory && s->algebraic)
        IDAFree(&s->memory);
    else if (s->memory)
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
    if (s->rate)
        N_VDestroy(s->rate);
    if (s->differential)
        N_VDestroy(s->differential);
    if (s->context)
        SUNContext_Free(&s->context);
    apc_algebraic_destroy(s->algebraic);
    free(s);
}

static int configure_cvode(struct solver *s, double rtol, double atol)
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

static int configure_ida(struct solver *s, double rtol, double atol)
{
    int rc = keep_messages(s);

    if (rc == IDA_SUCCESS)
        rc = IDAInit(s->memory, ida_residual, 0.0, s->state, s->rate);
    if (rc == IDA_SUCCESS)
        rc = IDASetUserData(s->memory, s);
    if (rc == IDA_SUCCESS)
        rc = IDASStolerances(s->memory, rtol, atol);
    if (rc == IDA_SUCCESS)
        rc = IDASetMaxNumSteps(s->memory, MAX_INTERNAL_STEPS);
    if (rc == IDA_SUCCESS)
        rc = IDASetId(s->memory, s->differential);
    if (rc == IDA_SUCCESS)
        rc = IDASetLinearSolver(s->memory, s->linear, s->system);
    if (rc == IDA_SUCCESS)
        rc = IDASetJacFn(s->memory, ida_jacobian);
    return rc;
}

/* What both take: vectors, matrices and the linear solver. Returns 0 or APC_ENOMEM. */
static int open_solver(struct solver **solver, const struct apc_model *model, const double *p,
                       const struct apc_plant_options *options)
{
    const sunindextype n = (sunindextype)(model->nx + apc_model_nz(model));
    struct solver *s = *solver = calloc(1, sizeof(*s));

    if (!s)
        return APC_ENOMEM;
    s->model = model;
    s->p = p;
    s->zero_scale = options->atol / options->rtol;
    if (SUNContext_Create(SUN_COMM_NULL, &s->context) < 0)
        return APC_ENOMEM;
    s->state = N_VNew_Serial(n, s->context);
    s->system = SUNDenseMatrix(n, n, s->context);
    if (!s->state || !s->system)
        return APC_ENOMEM;
    N_VConst(0.0, s->state);
    s->linear = SUNLinSol_Dense(s->state, s->system, s->context);
    return s->linear ? 0 : APC_ENOMEM;
}

/* Of a set-up: the solver's memory ran out, or it says something else. */
static int setup_result(const struct solver *s, int rc)
{
    const int none = s->algebraic ? IDA_MEM_FAIL : CV_MEM_FAIL;
    const int none_linear = s->algebraic ? IDALS_MEM_FAIL : CVLS_MEM_FAIL;

    if (rc == 0)
        return 0;
    return rc == none || rc == none_linear ? APC_ENOMEM : APC_ESOLVER;
}

static int end_setup(struct solver *s, void **self, int rc, const char *name, struct apc_error *why)
{
    if (rc == 0) {
        *self = s;
        return 0;
    }
    (void)apc_fail(why, rc, "integrator %s could not be set up: %s", name,
                   s && s->error.text[0] ? s->error.text : apc_err_text(rc));
    sundials_destroy(s);
    return rc;
}

static int cvode_create(int method, void **self, const struct apc_model *model, const double *p,
                        const struct apc_plant_options *options, struct apc_error *why)
{
    struct solver *s;
    int rc = open_solver(&s, model, p, options);

    if (rc == 0) {
        s->jacobian = SUNDenseMatrix((sunindextype)model->nx, (sunindextype)model->nx, s->context);
        s->memory = CVodeCreate(method, s->context);
        if (method == CV_ADAMS)
            s->fixed_point = SUNNonlinSol_FixedPoint(s->state, 0, s->context);
        if (!s->jacobian || !s->memory || (method == CV_ADAMS && !s->fixed_point))
            rc = APC_ENOMEM;
    }
    if (rc == 0)
        rc = setup_result(s, configure_cvode(s, options->rtol, options->atol));
    return end_setup(s, self, rc, "CVODE", why);
}

static int create_ida(void **self, const struct apc_model *model, const double *p,
                      const struct apc_plant_options *options, struct apc_error *why)
{
    struct solver *s;
    int rc = open_solver(&s, model, p, options);

    if (rc == 0)
        rc = apc_algebraic_create(&s->algebraic, model, p, s->zero_scale);
    if (rc == 0) {
        s->rate = N_VClone(s->state);
        s->differential = N_VClone(s->state);
        s->memory = IDACreate(s->context);
        if (!s->rate || !s->differential || !s->memory)
            rc = APC_ENOMEM;
    }
    if (rc == 0) {
        N_VConst(0.0, s->rate);
        N_VConst(0.0, s->differential);
        for (size_t i = 0; i < model->nx; i++)
            N_VGetArrayPointer(s->differential)[i] = 1.0;
        rc = setup_result(s, configure_ida(s, options->rtol, options->atol));
    }
    return end_setup(s, self, rc, "IDA", why);
}

static void begin_step(struct solver *s, double t, const double *u, const double *x)
{
    s->t0 = t;
    s->u = u;
    s->error.text[0] = '\0';
    s->model_error.text[0] = '\0';
    memcpy(N_VGetArrayPointer(s->state), x, (s->model->nx + apc_model_nz(s->model)) * sizeof(*x));
}

/* The state at the end of a step to @p x, unless @p rc says that it failed. */
static int end_step(const struct solver *s, int rc, double *x, struct apc_error *why)
{
    const size_t n = s->model->nx + apc_model_nz(s->model);
    const double *state = N_VGetArrayPointer(s->state);
    const char *gave_up = s->algebraic ? "IDA gave up" : "CVODE gave up";

    if (rc < 0)
        return apc_fail(why, APC_ESOLVER, "%s%s%s", s->error.text[0] ? s->error.text : gave_up,
                        s->model_error.text[0] ? "; " : "", s->model_error.text);
    for (size_t i = 0; i < n; i++) {
        if (!isfinite(state[i]))
            return apc_fail(why, APC_ESOLVER, "state %zu is no longer a finite number", i + 1);
    }
    memcpy(x, state, n * sizeof(*x));
    return 0;
}

static int cvode_step(void *self, double t, double dt, const double *u, double *x, struct apc_error *why)
{
    struct solver *s = self;
    sunrealtype reached = 0.0;
    int rc;

    begin_step(s, t, u, x);
    rc = CVodeReInit(s->memory, 0.0, s->state);
    if (rc == CV_SUCCESS)
        rc = CVodeSetStopTime(s->memory, dt);
    if (rc == CV_SUCCESS)
        rc = CVode(s->memory, dt, s->state, &reached, CV_NORMAL);
    return end_step(s, rc, x, why);
}

static int ida_start(void *self, const double *u, double *x, struct apc_error *why)
{
    struct solver *s = self;
    int rc = apc_algebraic_solve(s->algebraic, 0.0, x, u, why);

    return rc < 0 ? rc : apc_algebraic_check(s->algebraic, 0.0, x, u, why);
}

static int ida_settle(void *self, double t, const double *u, double *x, struct apc_error *why)
{
    struct solver *s = self;

    return apc_algebraic_solve(s->algebraic, t, x, u, why);
}

static int ida_step(void *self, double t, double dt, const double *u, double *x, struct apc_error *why)
{
    struct solver *s = self;
    double *state, *rate = N_VGetArrayPointer(s->rate);
    sunrealtype reached = 0.0;
    int rc;

    begin_step(s, t, u, x);
    state = N_VGetArrayPointer(s->state);
    rc = apc_algebraic_solve(s->algebraic, t, state, u, why);
    if (rc == 0)
        rc = apc_model_derivative(s->model, t, state, u, s->p, rate, why);
    if (rc < 0)
        return rc;
    apc_algebraic_rate(s->algebraic, t, state, u, rate);
    rc = IDAReInit(s->memory, 0.0, s->state, s->rate);
    if (rc == IDA_SUCCESS)
        rc = IDASetStopTime(s->memory, dt);
    if (rc == IDA_SUCCESS)
        rc = IDASolve(s->memory, dt, &reached, s->state, s->rate, IDA_NORMAL);
    return end_step(s, rc, x, why);
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
    .name = "cvode", .create = create_bdf, .step = cvode_step, .destroy = sundials_destroy};
const struct apc_integrator apc_integrator_adams = {
    .name = "adams", .create = create_adams, .step = cvode_step, .destroy = sundials_destroy};
const struct apc_integrator apc_integrator_ida = {.name = "ida",
                                                  .create = create_ida,
                                                  .start = ida_start,
                                                  .settle = ida_settle,
                                                  .step = ida_step,
                                                  .destroy = sundials_destroy};

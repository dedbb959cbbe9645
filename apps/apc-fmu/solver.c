/* SPDX-License-Identifier: BSD-3-Clause */
/*
 * The solver of an FMU for model exchange: CVODE between its events. These are where an indicator changes its
 * sign, the times that it names, a step after which it asks for one, and a jump of an input. At each, the
 * model's discrete states are updated until they stay, and CVODE begins anew.
 */
#include "fmu.h"

#include <cvode/cvode.h>
#include <float.h>
#include <math.h>
#include <nvector/nvector_serial.h>
#include <stdio.h>
#include <sunlinsol/sunlinsol_dense.h>
#include <sunmatrix/sunmatrix_dense.h>

#define TOLERANCE   1e-12
#define STATES_MAX  1000  /* that a dense matrix is made of */
#define UPDATES_MAX 1000  /* until the discrete states stay */
#define EVENTS_MAX  10000 /* within a step of the plant */
#define STEPS_MAX   100000

#if SUNDIALS_VERSION_MAJOR < 7
#define SUN_COMM_NULL NULL
#endif

struct solver {
    const struct exchange *model;
    size_t nx, nz; /* without states there is one that stays 0, so that time passes */
    double t;
    struct event event; /* the newest */
    bool in_event;
    SUNContext context;
    void *memory;
    N_Vector x, tolerance;
    SUNMatrix matrix;
    SUNLinearSolver linear;
    const char *said; /* what of the model's failed last, in this step, where CVODE asked for it */
};

/* For CVODE: 0, above 0 try a shorter step, below 0 give up. Only what is no discard is told at once. */
static int judge(struct solver *s, int status, const char *what)
{
    if (status == STATUS_OK || status == STATUS_WARNING)
        return 0;
    s->said = what;
    if (status != STATUS_DISCARD)
        (void)status_well(status, "while CVODE steps");
    return status == STATUS_DISCARD ? 1 : -1;
}

/* The model's time and states. */
static int set_model(struct solver *s, double t, N_Vector x)
{
    const int rc = judge(s, s->model->set_time(s->model->self, t), ": it does not take the time");

    return rc || s->nx == 0 ? rc
                            : judge(s, s->model->set_states(s->model->self, N_VGetArrayPointer(x), s->nx),
                                    ": it does not take its states");
}

static int right_side(sunrealtype t, N_Vector x, N_Vector dx, void *user)
{
    struct solver *const s = user;
    double *const out = N_VGetArrayPointer(dx);
    int rc = set_model(s, t, x);

    out[0] = 0.0;
    if (rc == 0 && s->nx)
        rc = judge(s, s->model->get_derivatives(s->model->self, out, s->nx), ": it has no derivatives");
    for (size_t i = 0; rc == 0 && i < s->nx; i++)
        if (!isfinite(out[i])) {
            s->said = ": a derivative is not a finite number";
            rc = 1;
        }
    return rc;
}

static int indicators(sunrealtype t, N_Vector x, sunrealtype *z, void *user)
{
    struct solver *const s = user;
    const int rc = set_model(s, t, x);

    return rc ? rc
              : judge(s, s->model->get_indicators(s->model->self, z, s->nz), ": it has no event indicators");
}

/* ---- Events ---------------------------------------------------------------------------------- */

bool settle_discrete_states(const struct exchange *model, double t, struct event *last, bool *jumped)
{
    *jumped = false;
    *last = (struct event){.again = true};
    for (int i = 0; last->again; i++) {
        if (i == UPDATES_MAX) {
            fprintf(stderr, "at %g s its discrete states have not settled after %d updates\n", t,
                    UPDATES_MAX);
            return false;
        }
        *last = (struct event){0};
        if (!status_well(model->update(last), "the update of its discrete states"))
            return false;
        if (last->ends) {
            fprintf(stderr, "the model has come to its end, at %g s\n", t);
            fmu_spent = true;
            return false;
        }
        *jumped |= last->states;
    }
    return status_well(model->enter_continuous(model->self), "EnterContinuousTimeMode");
}

/* Out of event mode, with the states that it left behind. */
static bool settle(struct solver *s)
{
    const struct exchange *const m = s->model;
    bool jumped;

    if (!settle_discrete_states(m, s->t, &s->event, &jumped))
        return false;
    s->in_event = false;
    if (s->nx && jumped &&
        !status_well(m->get_states(m->self, N_VGetArrayPointer(s->x), s->nx), "GetContinuousStates"))
        return false;
    if (CVodeReInit(s->memory, s->t, s->x) != CV_SUCCESS) {
        fprintf(stderr, "CVODE cannot restart at %g s\n", s->t);
        return false;
    }
    return true;
}

bool solver_announce(struct solver *s)
{
    if (!s->in_event && !status_well(s->model->enter_events(s->model->self), "EnterEventMode"))
        return false;
    s->in_event = true;
    return true;
}

/* ---- Time ------------------------------------------------------------------------------------ */

/* What SUNDIALS would print: solver_step() says it with what the model said. */
#if SUNDIALS_VERSION_MAJOR < 7
static void ignore(int code, const char *module, const char *function, char *message, void *user)
{
    (void)code, (void)module, (void)function, (void)message, (void)user;
}
#endif

static bool set_up_cvode(struct solver *s)
{
    const sunindextype n = (sunindextype)(s->nx ? s->nx : 1);

    if (SUNContext_Create(SUN_COMM_NULL, &s->context) != 0)
        return false;
    s->x = N_VNew_Serial(n, s->context);
    s->tolerance = N_VNew_Serial(n, s->context);
    s->matrix = SUNDenseMatrix(n, n, s->context);
    if (!s->x || !s->tolerance || !s->matrix || !(s->linear = SUNLinSol_Dense(s->x, s->matrix, s->context)) ||
        !(s->memory = CVodeCreate(CV_BDF, s->context)))
        return false;
    double *const x = N_VGetArrayPointer(s->x), *const tolerance = N_VGetArrayPointer(s->tolerance);
    x[0] = 0.0;
    tolerance[0] = 1.0;
    if (s->nx && (!status_well(s->model->get_states(s->model->self, x, s->nx), "GetContinuousStates") ||
                  !status_well(s->model->get_nominals(s->model->self, tolerance, s->nx),
                               "GetNominalsOfContinuousStates")))
        return false;
    for (sunindextype i = 0; i < n; i++)
        tolerance[i] = TOLERANCE * (isfinite(tolerance[i]) && tolerance[i] != 0.0 ? fabs(tolerance[i]) : 1.0);
#if SUNDIALS_VERSION_MAJOR < 7
    (void)CVodeSetErrHandlerFn(s->memory, ignore, NULL);
#else
    (void)SUNContext_ClearErrHandlers(s->context);
#endif
    return CVodeInit(s->memory, right_side, 0.0, s->x) == CV_SUCCESS &&
           CVodeSVtolerances(s->memory, TOLERANCE, s->tolerance) == CV_SUCCESS &&
           CVodeSetUserData(s->memory, s) == CV_SUCCESS &&
           CVodeSetLinearSolver(s->memory, s->linear, s->matrix) == CV_SUCCESS &&
           (s->nz == 0 || (CVodeRootInit(s->memory, (int)s->nz, indicators) == CV_SUCCESS &&
                           CVodeSetNoInactiveRootWarn(s->memory) == CV_SUCCESS));
}

struct solver *solver_begin(const struct standard *fmi, const struct description *d)
{
    struct solver *const s = room(1, sizeof *s);

    s->model = fmi->exchange;
    s->nx = d->n_states;
    s->nz = d->n_indicators;
    if (s->model->sizes && !status_well(s->model->sizes(&s->nx, &s->nz), "GetNumberOfContinuousStates"))
        return NULL;
    if (s->nx > STATES_MAX || s->nz > STATES_MAX) {
        fprintf(stderr,
                "it has %zu states and %zu event indicators; %d of each can be taken: export it for "
                "co-simulation\n",
                s->nx, s->nz, STATES_MAX);
        return NULL;
    }
    s->in_event = true; /* so the standard begins */
    if (!set_up_cvode(s)) {
        fputs("CVODE cannot be set up for it\n", stderr);
        return NULL;
    }
    return settle(s) ? s : NULL;
}

/* One step of CVODE's, to @p to at most; @p event: something has happened there. */
static bool advance(struct solver *s, double to, bool *event)
{
    double reached = s->t;
    bool ends = false;
    int rc = CVodeSetStopTime(s->memory, to);

    *event = false;
    if (rc == CV_SUCCESS)
        rc = CVode(s->memory, to, s->x, &reached, CV_ONE_STEP);
    if (rc < 0) {
        fprintf(stderr, "CVODE got to %g s, not to %g s%s\n", s->t, to, s->said);
        return false;
    }
    s->t = reached;
    if (set_model(s, s->t, s->x) != 0 ||
        !status_well(s->model->completed(event, &ends), "CompletedIntegratorStep")) {
        fprintf(stderr, "at %g s\n", s->t);
        return false;
    }
    if (ends) {
        fprintf(stderr, "the model has come to its end, at %g s\n", s->t);
        fmu_spent = true;
    }
    *event |= rc == CV_ROOT_RETURN;
    return !ends;
}

/* Sums of times that mean the same instant are as near as that; CVODE takes no step so short. */
static double sliver(const struct solver *s, double end)
{
    return 1e3 * DBL_EPSILON * (fabs(s->t) + fabs(end));
}

/* To the next event or @p end, whichever comes first, or as far as CVODE goes in one step. */
static bool to_next_event(struct solver *s, double end, bool *event)
{
    const bool comes = s->event.comes && s->event.at <= end + sliver(s, end);
    const double to = comes ? fmax(s->event.at, s->t) : end;

    *event = comes && to <= s->t;
    if (*event)
        return true;
    if (to - s->t > sliver(s, end))
        return advance(s, to, event);
    s->t = to;
    return set_model(s, to, s->x) == 0;
}

bool solver_step(struct solver *s, double end, double *reached)
{
    const double from = s->t;
    unsigned steps = 0, events = 0;

    s->said = "";
    bool well = !s->in_event || settle(s);

    while (well && (s->t < end || (s->event.comes && s->event.at <= s->t))) {
        bool event;
        well = to_next_event(s, end, &event);
        if (well && event)
            well = solver_announce(s) && settle(s);
        events += event;
        if (well && (events > EVENTS_MAX || ++steps > STEPS_MAX)) {
            fprintf(stderr,
                    events > EVENTS_MAX ? "it chatters: more than %d events from %g s to %g s%s\n"
                                        : "more than %d steps of CVODE from %g s to %g s%s\n",
                    events > EVENTS_MAX ? EVENTS_MAX : STEPS_MAX, from, s->t, s->said);
            well = false;
        }
    }
    *reached = s->t;
    return well;
}

/* SPDX-License-Identifier: BSD-3-Clause */
/*
 * A plant of an FMU: a process of its own that is asked for each step.
 *
 * The states of such a model are its outputs: what is inside nobody is shown. In real time
 * (apc_plant_options.patience) nobody waits for it longer than that: the step has failed, and the next one
 * goes on from where the FMU has come to by then. One that has not answered for three times that and a second
 * is killed; what has ended is started again by a thread, from its start. In virtual time it has
 * APC_FMU_TIMEOUT seconds, and what has ended stays away.
 */
#include "plant/fmu_internal.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

struct runner {
    const struct fmu *fmu;
    struct apc_subprocess own;
    const double *p;
    apc_ns patience, timeout; /* patience 0: this is virtual time */
    uint32_t asked;
    bool waiting;             /* the newest request has not been answered */
    bool spent;               /* it ends by itself */
    bool hung;                /* it has been killed, in virtual time for good */
    bool anew;                /* it begins at the time of the next step */
    double offset;            /* the plant's time at its own 0 */
    struct fmu_header *begin; /* as it was sent */
    size_t begin_length;
    double *request, *answer; /* a header and numbers */
    size_t room;              /* bytes of the answer */
    double *y;                /* [ny] as it begins */
    struct apc_error failure; /* of the newest look ahead */
};

#define HEADER (sizeof(struct fmu_header) / sizeof(double)) /* in numbers */

/* Is the answer, of @p n bytes, one of that many numbers? They are behind its header. */
static int read_fmu_answer(struct runner *r, ssize_t n, size_t n_values, struct apc_error *why)
{
    struct fmu_header header;
    char said[400];

    if (n > 6 && memcmp(r->answer, "error\t", 6) == 0) {
        ((char *)r->answer)[n] = '\0';
        apc_subprocess_bury(&r->own, false);
        return apc_fail(why, APC_EINVAL, "%s: %s", r->fmu->file, (const char *)r->answer + 6);
    }
    if (n != (ssize_t)((HEADER + n_values) * sizeof(double))) {
        apc_subprocess_bury(&r->own, true);
        return apc_fail(why, APC_ESOLVER, "%s: its process sent %zd bytes that are no answer, and was killed",
                        r->fmu->file, n);
    }
    memcpy(&header, r->answer, sizeof(header));
    apc_subprocess_listen(&r->own);
    apc_subprocess_said(&r->own, said, sizeof(said));
    r->spent = header.spent;
    if (header.failed)
        return apc_fail(why, APC_ESOLVER, "%s: %s", r->fmu->file, said[0] ? said : "failed, without a word");
    return 0;
}

/* How many numbers an answer has: derivatives of states, outputs, and what a prediction is made of. */
struct shape {
    size_t nx, ny, more;
};

/* All of them or none. */
static int take_fmu_answer(struct runner *r, ssize_t n, struct shape of, double *value, struct apc_error *why)
{
    const size_t n_values = of.nx + of.ny + of.more;
    const int rc = read_fmu_answer(r, n, n_values, why);

    if (rc < 0)
        return rc;
    for (size_t i = 0; i < n_values; i++)
        if (!apc_value_ok(r->answer[HEADER + i]))
            return apc_fail(why, APC_ESOLVER, "%s: its %s%s is not a finite number", r->fmu->file,
                            i < of.nx           ? "derivative of "
                            : i < of.nx + of.ny ? "output "
                                                : "prediction",
                            i < of.nx           ? r->fmu->table[STATE][i].name
                            : i < of.nx + of.ny ? r->fmu->output[i - of.nx].name
                                                : "");
    memcpy(value, r->answer + HEADER, n_values * sizeof(*value));
    return 0;
}

/* A request of @p n numbers, which stand behind its header. Returns the bytes of the answer, or APC_ESOLVER. */
static ssize_t converse(struct runner *r, enum fmu_request request, size_t n, struct apc_error *why)
{
    const struct fmu_header header = {.request = request, .number = ++r->asked};

    memcpy(r->request, &header, sizeof(header));
    r->own.since = apc_clock_mono(NULL);
    if (!apc_subprocess_give(&r->own, r->request, (HEADER + n) * sizeof(double)))
        return apc_fmu_fail_silent(&r->own, 0, why);
    const ssize_t taken = apc_subprocess_take(&r->own, r->answer, r->room,
                                              r->own.since + (r->patience ? r->patience : r->timeout));
    if (taken < 0 && r->patience) {
        r->waiting = true;
        return apc_fail(why, APC_ESOLVER, "%s: has not answered within %g s", r->fmu->file,
                        apc_ns_to_s(r->patience));
    }
    r->hung = taken < 0;
    return taken <= 0 ? apc_fmu_fail_silent(&r->own, taken, why) : taken;
}

/* Start it, and wait until it has begun. */
static int set_out(struct runner *r, struct apc_error *why)
{
    int rc = apc_fmu_begin(&r->own, "run", r->fmu->folder, why);

    if (rc < 0)
        return rc;
    r->waiting = false;
    r->anew = true;
    r->begin->number = ++r->asked;
    /* It may have ended already: why is to be read. */
    (void)apc_subprocess_give(&r->own, r->begin, r->begin_length);
    const ssize_t n = apc_subprocess_take(&r->own, r->answer, r->room, apc_clock_mono(NULL) + r->timeout);
    if (n <= 0)
        return apc_fmu_fail_silent(&r->own, n, why);
    return take_fmu_answer(r, n, (struct shape){.ny = r->fmu->model.ny}, r->y, why);
}

static bool revive(struct apc_subprocess *own)
{
    struct runner *const r = (struct runner *)(void *)((char *)own - offsetof(struct runner, own));
    struct apc_error why;
    const bool well = set_out(r, &why) == 0;

    if (!well)
        apc_subprocess_bury(own, true);
    return well;
}

/* What is given to its texts, as numbers: the place, the bytes with their 0, these. Returns how many numbers
 * these are; @p at NULL: nothing is written. */
static size_t pack_fmu_strings(const struct fmu *f, double *at)
{
    size_t n = 0;

    for (size_t i = 0; i < f->n[TEXT]; i++) {
        const size_t bytes = f->given[i] ? strlen(f->given[i]) + 1 : 0;
        if (bytes == 0)
            continue;
        if (at) {
            at[n] = (double)i;
            at[n + 1] = (double)bytes;
            memcpy(at + n + 2, f->given[i], bytes);
        }
        n += 2 + (bytes + sizeof(*at) - 1) / sizeof(*at);
    }
    return n;
}

/* How many it has that were chosen. */
static size_t n_fmu_inputs(const struct fmu *f)
{
    return f->n[INPUT] ? f->model.nu + f->model.nd : 0;
}

/* What it is to begin with: parameters that are other than its own. */
static bool write_begin(struct runner *r, double period)
{
    const struct fmu *const f = r->fmu;
    const struct apc_model *const m = &f->model;
    double *at;
    size_t np = 0, texts = 0;

    r->begin =
        calloc(1, sizeof(*r->begin) +
                      (5 + m->nu + m->nd + m->ny + 2 * m->np + pack_fmu_strings(f, NULL)) * sizeof(double));
    if (!r->begin)
        return false;
    r->begin->request = FMU_BEGIN;
    double *const numbers = (double *)(void *)(r->begin + 1);
    numbers[0] = (double)n_fmu_inputs(f);
    numbers[1] = (double)m->ny;
    numbers[4] = period;
    at = numbers + 5;
    for (size_t i = 0; i < n_fmu_inputs(f); i++)
        *at++ = (double)f->input_place[i];
    for (size_t i = 0; i < m->ny; i++)
        *at++ = (double)f->output_place[i];
    for (size_t i = 0; i < m->np; i++) {
        if (r->p[i] >= m->param[i].initial && r->p[i] <= m->param[i].initial)
            continue;
        *at++ = (double)i;
        *at++ = r->p[i];
        np++;
    }
    for (size_t i = 0; i < f->n[TEXT]; i++)
        texts += f->given[i] != NULL;
    at += pack_fmu_strings(f, at);
    numbers[2] = (double)np;
    numbers[3] = (double)texts;
    r->begin_length = (size_t)((char *)at - (char *)r->begin);
    return true;
}

static void fmu_plant_destroy(void *self)
{
    struct runner *const r = self;

    if (!r)
        return;
    apc_subprocess_close(&r->own);
    free(r->begin);
    free(r->request);
    free(r->answer);
    free(r->y);
    free(r);
}

/* A process of the FMU, begun as @p with says: FMU_BEGIN, FMU_LOOK or FMU_AHEAD. */
static int employ(struct runner **runner, const struct fmu *f, enum fmu_request with, const double *p,
                  const struct apc_plant_options *options, struct apc_error *why)
{
    const struct apc_model *const model = &f->model;
    const size_t nx = with == FMU_BEGIN ? 0 : f->n[STATE],
                 slopes = with == FMU_AHEAD ? (nx + model->ny) * (nx + n_fmu_inputs(f)) : 0;
    struct runner *r;
    int rc;

    for (size_t i = 0; i < model->np; i++) { /* what is its own is not set, whatever it is */
        if ((p[i] < model->param[i].initial || p[i] > model->param[i].initial) &&
            (rc = apc_model_takes(model, &model->param[i], p[i], why)) < 0)
            return rc;
    }
    r = calloc(1, sizeof(*r));
    if (!r || apc_subprocess_open(&r->own, f->file, revive) < 0) {
        free(r);
        return apc_fail(why, APC_ENOMEM, "%s: no memory", f->file);
    }
    r->fmu = f;
    r->p = p;
    r->patience = (apc_ns)(options->patience * 1e9);
    r->timeout = apc_fmu_timeout();
    r->request = calloc(HEADER + 2 + nx + model->nu + model->nd, sizeof(double));
    r->room = (HEADER + nx + model->ny + slopes) * sizeof(double) + APC_FMU_TEXT;
    r->answer = calloc(r->room + 1, 1);
    r->y = calloc(nx + model->ny + slopes, sizeof(double));
    rc = r->request && r->answer && r->y && write_begin(r, options->period)
             ? 0
             : apc_fail(why, APC_ENOMEM, "%s: no memory", f->file);
    if (rc == 0)
        r->begin->request = with;
    if (rc == 0 && r->begin_length > APC_SUBPROCESS_MESSAGE)
        rc = apc_fail(why, APC_EINVAL, "%s: its inputs, outputs and parameters that were set are too many",
                      f->file);
    if (rc == 0 && r->room > APC_SUBPROCESS_MESSAGE)
        rc = apc_fail(why, APC_EINVAL, "%s: its %zu states are too many for a linear model at each point",
                      f->file, nx);
    if (rc == 0)
        rc = set_out(r, why);
    if (rc < 0) {
        fmu_plant_destroy(r);
        return rc;
    }
    *runner = r;
    return 0;
}

static int fmu_plant_create(void **self, const struct apc_model *model, const double *p,
                            const struct apc_plant_options *options, struct apc_error *why)
{
    const struct fmu *const f = apc_fmu_of(model);
    struct runner *r = NULL;
    const int rc = employ(&r, f, FMU_BEGIN, p, options, why);

    *self = r;
    return rc;
}

static int fmu_plant_start(void *self, const double *u, double *x, struct apc_error *why)
{
    const struct runner *const r = self;

    (void)u, (void)why;
    memcpy(x, r->y, r->fmu->model.ny * sizeof(*x));
    return 0;
}

/* Is there one that can be asked? What it was late with is taken, if it has come. */
static int be_ready(struct runner *r, struct apc_error *why)
{
    const apc_ns now = apc_clock_mono(NULL);

    if (!r->own.starting)
        apc_subprocess_disown(&r->own);
    if (!r->own.starting && r->own.socket < 0 && r->patience && now - r->own.since > APC_NS_PER_S) {
        r->own.since = now;
        apc_subprocess_start(&r->own);
    }
    if (r->own.starting)
        return apc_fail(why, APC_ESOLVER, "%s: is being started again, from its start", r->fmu->file);
    if (r->own.socket < 0)
        return apc_fail(why, APC_ESOLVER, "%s: %s", r->fmu->file, r->own.end);
    while (r->waiting) {
        struct fmu_header header = {0};
        const ssize_t n = apc_subprocess_take(&r->own, r->answer, r->room, 0);
        if (n == 0 || (n < 0 && now - r->own.since > 3 * r->patience + APC_NS_PER_S))
            return apc_fmu_fail_silent(&r->own, n, why);
        if (n < 0)
            return apc_fail(why, APC_ESOLVER, "%s: has not answered an earlier step yet", r->fmu->file);
        memcpy(&header, r->answer, n >= (ssize_t)sizeof(header) ? sizeof(header) : 0);
        r->waiting = header.number != r->asked;
    }
    return 0;
}

static int request_fmu_step(struct runner *r, double t, double dt, const double *u, double *x,
                            struct apc_error *why)
{
    const size_t n_in = n_fmu_inputs(r->fmu);
    const int rc = be_ready(r, why);

    if (rc < 0)
        return rc;
    if (r->anew)
        r->offset = t;
    r->anew = false;
    r->request[HEADER] = t - r->offset;
    r->request[HEADER + 1] = dt;
    memcpy(r->request + HEADER + 2, u, n_in * sizeof(*u));
    const ssize_t n = converse(r, FMU_STEP, 2 + n_in, why);
    return n < 0 ? (int)n : take_fmu_answer(r, n, (struct shape){.ny = r->fmu->model.ny}, x, why);
}

static int fmu_plant_step(void *self, double t, double dt, const double *u, double *x, struct apc_error *why)
{
    struct runner *const r = self;
    int rc;

    pthread_mutex_lock(&r->own.lock);
    rc = request_fmu_step(r, t, dt, u, x, why);
    pthread_mutex_unlock(&r->own.lock);
    return rc < 0 ? APC_ESOLVER : 0;
}

const struct apc_integrator apc_integrator_fmu = {.name = "fmu",
                                                  .create = fmu_plant_create,
                                                  .start = fmu_plant_start,
                                                  .step = fmu_plant_step,
                                                  .destroy = fmu_plant_destroy};

/* ---- What it starts with, where its description does not say ------------------------------------- */

static int ask_start(struct runner *r, enum table k, size_t place, struct apc_error *why)
{
    r->request[HEADER] = (double)k;
    r->request[HEADER + 1] = (double)place;
    const ssize_t n = converse(r, FMU_OWN, 2, why);
    int rc = n < 0 ? (int)n : read_fmu_answer(r, n, 1, why);
    if (rc == 0 && !apc_value_ok(r->answer[HEADER]))
        rc = apc_fail(why, APC_EINVAL, "%s: its %s is not a finite number", r->fmu->file,
                      r->fmu->table[k][place].name);
    struct apc_param *const v = &r->fmu->table[k][place];
    if (rc == 0) /* an input is set before anything is asked of it, to what it takes */
        v->initial = k == INPUT ? fmin(fmax(r->answer[HEADER], v->low), v->high) : r->answer[HEADER];
    return rc;
}

int apc_fmu_ask_start(struct fmu *f, enum table k, struct apc_error *why)
{
    const struct apc_plant_options options = {.size = sizeof(options)};
    struct apc_error cause = {.text = ""};
    struct runner *r = NULL;
    const char *name = NULL;
    double *const p = calloc(f->model.np + 1, sizeof(*p));
    int rc = 0;

    if (!p)
        return apc_fail(why, APC_ENOMEM, "%s: no memory", f->file);
    apc_param_initials(f->model.param, f->model.np, p);
    for (size_t i = 0; i < f->n[k] && rc == 0; i++) {
        if (!isnan(f->table[k][i].initial))
            continue;
        name = f->table[k][i].name;
        if (!r)
            rc = employ(&r, f, FMU_LOOK, p, &options, &cause);
        if (rc == 0)
            rc = ask_start(r, k, i, &cause);
    }
    fmu_plant_destroy(r);
    free(p);
    return rc < 0 ? apc_fail(why, rc,
                             "its modelDescription.xml says no start value of %s, and the model could not be "
                             "asked: %s: export it with start values",
                             name, cause.text)
                  : 0;
}

/* ---- Its equations, where it shows them ---------------------------------------------------------- */

/* Asked of its process alone: apc_fmu_look_at(). */
static int shown_elsewhere(double t, const double *x, const double *u, const double *p, double *dx)
{
    (void)t;
    (void)x;
    (void)u;
    (void)p;
    (void)dx;
    return -1;
}

bool apc_fmu_shown(const struct apc_model *model)
{
    return model->f == shown_elsewhere;
}

int apc_model_equations(const struct apc_model *model, const struct apc_model **shown, struct apc_error *why)
{
    struct fmu *const f = apc_fmu_of(model);

    *shown = model;
    if (!apc_model_is_fmu(model))
        return 0;
    if (f->n[STATE] == 0)
        return apc_fail(
            why, APC_EINVAL,
            "%s does not show its states and their derivatives (an FMU does by its ModelStructure), so there "
            "are no equations to make linear; a step test of it and a model of that do as well: apc test, "
            "apc identify",
            f->file);
    const int rc = apc_fmu_ask_start(f, STATE, why);
    if (rc < 0)
        return rc;
    f->shown = f->model;
    f->shown.nx = f->n[STATE];
    f->shown.state = f->table[STATE];
    f->shown.f = shown_elsewhere;
    *shown = &f->shown;
    return apc_model_check(*shown, f->file, why);
}

int apc_fmu_look_open(struct apc_fmu_look **look, const struct apc_model *shown, const double *p, bool ahead,
                      struct apc_error *why)
{
    const struct fmu *const f = apc_fmu_of(shown);
    struct runner *r = NULL;

    *look = NULL;
    if (ahead && !f->n[INPUT])
        return apc_fail(why, APC_EINVAL, "%s: it has no inputs, so nothing could be controlled by it",
                        f->file);
    for (size_t i = 0; f->n[INPUT] && i < f->model.nu; i++) /* its rounded differences would be a gain of 0 */
        if (f->sort[INPUT][f->input_place[i]].kind != REAL)
            return apc_fail(why, APC_EINVAL,
                            "%s: its input %s takes whole numbers only, so nothing can be derived by it: "
                            "apc analyze an experiment that has others as its outputs, or apc test",
                            f->file, f->input[i].name);
    const int rc =
        employ(&r, f, ahead ? FMU_AHEAD : FMU_LOOK, p, &(struct apc_plant_options){.size = 0}, why);

    *look = (struct apc_fmu_look *)(void *)r;
    return rc;
}

static _Thread_local apc_ns look_until;

void apc_reduced_until(apc_ns mono)
{
    look_until = mono;
}

/* x, u and @p more numbers that stand behind these already: the answer to r->y. Without @p why the reason is
 * kept, that of a question before that of none, which has been none since. */
static int look(struct runner *r, enum fmu_request request, const double *x, const double *u, size_t more,
                struct shape of, struct apc_error *why)
{
    const size_t nx = r->fmu->n[STATE], n_in = n_fmu_inputs(r->fmu);
    struct apc_error cause = {.text = ""};
    bool asked = false;
    int rc = 0;

    pthread_mutex_lock(&r->own.lock);
    if (r->spent && !r->own.starting) { /* else they are the thread's */
        apc_subprocess_bury(&r->own, false);
        r->spent = false;
    }
    r->patience = look_until ? look_until - apc_clock_mono(NULL) : 0;
    if (look_until && r->patience <= 0)
        rc = apc_fail(&cause, APC_ESOLVER, "%s: there is no time left to ask it", r->fmu->file);
    else if (r->own.socket < 0 && !look_until && !r->hung) /* it erred, and may answer another question */
        rc = set_out(r, &cause);
    if (rc == 0)
        rc = be_ready(r, &cause);
    if (rc == 0) {
        asked = true;
        memcpy(r->request + HEADER, x, nx * sizeof(*x));
        memcpy(r->request + HEADER + nx, u, n_in * sizeof(*u));
        const ssize_t n = converse(r, request, nx + n_in + more, &cause);
        rc = n < 0 ? (int)n : take_fmu_answer(r, n, of, r->y, &cause);
    }
    pthread_mutex_unlock(&r->own.lock);
    if (why)
        *why = cause;
    else if (rc == 0 || asked || !r->failure.text[0])
        r->failure = cause;
    return rc < 0 ? APC_ESOLVER : 0;
}

static size_t n_slopes(const struct runner *r, size_t rows)
{
    return rows * (r->fmu->n[STATE] + n_fmu_inputs(r->fmu));
}

int apc_fmu_look_at(struct apc_fmu_look *at, const double *x, const double *u, double *dx, double *y,
                    struct apc_error *why)
{
    struct runner *const r = (struct runner *)(void *)at;
    const struct shape of = {.nx = r->fmu->n[STATE], .ny = r->fmu->model.ny};
    const int rc = look(r, FMU_POINT, x, u, 0, of, why);

    if (rc == 0 && dx)
        memcpy(dx, r->y, of.nx * sizeof(*dx));
    if (rc == 0 && y)
        memcpy(y, r->y + of.nx, of.ny * sizeof(*y));
    return rc;
}

int apc_fmu_look_slopes(struct apc_fmu_look *at, const double *x, const double *u, double *slopes)
{
    struct runner *const r = (struct runner *)(void *)at;
    const size_t nx = r->fmu->n[STATE], ny = r->fmu->model.ny, n = n_slopes(r, nx + ny);
    const int rc = look(r, FMU_SLOPES, x, u, 0, (struct shape){nx, ny, n}, NULL);

    if (rc == 0)
        memcpy(slopes, r->y + nx + ny, n * sizeof(*slopes));
    return rc;
}

int apc_fmu_look_interval(struct apc_fmu_look *at, double *x, const double *u, double t, unsigned steps,
                          double *slopes)
{
    struct runner *const r = (struct runner *)(void *)at;
    const size_t nx = r->fmu->n[STATE], n = n_slopes(r, nx);
    double *const behind = r->request + HEADER + nx + n_fmu_inputs(r->fmu);

    behind[0] = t;
    behind[1] = steps;
    const int rc = look(r, FMU_INTERVAL, x, u, 2, (struct shape){.more = nx + n}, NULL);
    if (rc == 0) {
        memcpy(x, r->y, nx * sizeof(*x));
        memcpy(slopes, r->y + nx, n * sizeof(*slopes));
    }
    return rc;
}

const char *apc_fmu_look_error(const struct apc_fmu_look *at)
{
    const struct runner *const r = (const struct runner *)(const void *)at;
    const size_t n = strlen(r->fmu->file);

    return strncmp(r->failure.text, r->fmu->file, n) == 0 ? r->failure.text + n + 2 : r->failure.text;
}

void apc_fmu_look_close(struct apc_fmu_look *look)
{
    fmu_plant_destroy(look);
}

/* SPDX-License-Identifier: BSD-3-Clause */
/* FMI 2.0, co-simulation and model exchange: its functions, as far as a plant needs them. */
#include "fmu.h"

#include <math.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

typedef void *instance;
struct callbacks {
    void (*logger)(void *environment, const char *name, int status, const char *category, const char *message,
                   ...);
    void *(*allocate)(size_t n, size_t size);
    void (*release)(void *memory);
    void (*finished)(void *environment, int status);
    void *environment;
};

/* As the standard has it. */
struct event_info {
    int again, ends, nominals, states, comes;
    double at;
};

static struct {
    instance (*instantiate)(const char *name, int type, const char *guid, const char *resources,
                            const struct callbacks *callbacks, int visible, int logging);
    int (*set_up)(instance, int tolerant, double tolerance, double start, int stops, double stop);
    int (*enter)(instance);
    int (*leave)(instance);
    int (*get_real)(instance, const unsigned *reference, size_t n, double *value);
    int (*get_integer)(instance, const unsigned *reference, size_t n, int *value);
    int (*get_boolean)(instance, const unsigned *reference, size_t n, int *value);
    int (*set_real)(instance, const unsigned *reference, size_t n, const double *value);
    int (*set_integer)(instance, const unsigned *reference, size_t n, const int *value);
    int (*set_boolean)(instance, const unsigned *reference, size_t n, const int *value);
    int (*set_string)(instance, const unsigned *reference, size_t n, const char *const *value);
    int (*do_step)(instance, double t, double h, int no_way_back);
    /* Of a step that it has discarded; NULL where it has none. */
    int (*real_status)(instance, int what, double *value);
    int (*boolean_status)(instance, int what, int *value);
    int (*directional)(instance, const unsigned *unknown, size_t n_unknown, const unsigned *known,
                       size_t n_known, const double *seed, double *value);
    int (*update)(instance, struct event_info *);
    int (*completed)(instance, int no_way_back, int *event, int *ends);
} call;
static instance self;

static void fmi2_log(void *environment, const char *name, int status, const char *category,
                     const char *message, ...)
{
    va_list arguments;

    (void)environment;
    (void)name;
    if (status == STATUS_OK || !message)
        return;
    va_start(arguments, message);
    fprintf(stderr, "%s: ", category ? category : "");
#pragma GCC diagnostic push
#pragma GCC diagnostic ignored "-Wformat-nonliteral"
    vfprintf(stderr, message, arguments); /* NOLINT(clang-diagnostic-format-nonliteral): it is the FMU's */
#pragma GCC diagnostic pop
    fputc('\n', stderr);
    va_end(arguments);
}

static int fmi2_update(struct event *e)
{
    struct event_info info = {0};
    const int status = call.update(self, &info);

    *e = (struct event){.again = info.again != 0,
                        .ends = info.ends != 0,
                        .states = info.states != 0,
                        .comes = info.comes != 0,
                        .at = info.at};
    return status;
}

static int fmi2_completed(bool *event, bool *ends)
{
    int enter = 0, terminate = 0;
    const int status = call.completed(self, 1, &enter, &terminate);

    *event = enter != 0;
    *ends = terminate != 0;
    return status;
}

static struct exchange exchange = {.update = fmi2_update, .completed = fmi2_completed};

static const char *fmi2_load(void *library, const struct description *d)
{
    const struct entry_point all[] = {{"fmi2Instantiate", &call.instantiate},
                                      {"fmi2SetupExperiment", &call.set_up},
                                      {"fmi2EnterInitializationMode", &call.enter},
                                      {"fmi2ExitInitializationMode", &call.leave},
                                      {"fmi2GetReal", &call.get_real},
                                      {"fmi2GetInteger", &call.get_integer},
                                      {"fmi2GetBoolean", &call.get_boolean},
                                      {"fmi2SetReal", &call.set_real},
                                      {"fmi2SetInteger", &call.set_integer},
                                      {"fmi2SetBoolean", &call.set_boolean},
                                      {NULL, NULL}},
                             steps[] = {{"fmi2DoStep", &call.do_step}, {NULL, NULL}},
                             without_solver[] = {{"fmi2SetTime", &exchange.set_time},
                                                 {"fmi2SetContinuousStates", &exchange.set_states},
                                                 {"fmi2GetContinuousStates", &exchange.get_states},
                                                 {"fmi2GetNominalsOfContinuousStates",
                                                  &exchange.get_nominals},
                                                 {"fmi2GetDerivatives", &exchange.get_derivatives},
                                                 {"fmi2GetEventIndicators", &exchange.get_indicators},
                                                 {"fmi2EnterEventMode", &exchange.enter_events},
                                                 {"fmi2NewDiscreteStates", &call.update},
                                                 {"fmi2EnterContinuousTimeMode", &exchange.enter_continuous},
                                                 {"fmi2CompletedIntegratorStep", &call.completed},
                                                 {NULL, NULL}},
                             seldom[] = {{"fmi2SetString", &call.set_string},
                                         {"fmi2GetRealStatus", &call.real_status},
                                         {"fmi2GetBooleanStatus", &call.boolean_status},
                                         {"fmi2GetDirectionalDerivative", &call.directional},
                                         {NULL, NULL}};
    const char *missing = find_entry_points(library, all);

    if (!missing)
        missing = find_entry_points(library, d->co_simulation ? steps : without_solver);
    for (size_t i = 0; seldom[i].name; i++)
        (void)find_entry_points(library, (const struct entry_point[]){seldom[i], {NULL, NULL}});
    return missing;
}

static bool fmi2_instantiate(const struct description *d, const char *folder)
{
    static const struct callbacks callbacks = {.logger = fmi2_log, .allocate = calloc, .release = free};
    char resources[600];

    snprintf(resources, sizeof resources, "file://%s/resources", folder);
    self = call.instantiate(d->name, d->co_simulation, d->token, resources, &callbacks, 0, 1);
    exchange.self = self;
    return self && status_well(call.set_up(self, 0, 0.0, 0.0, 0, 0.0), "fmi2SetupExperiment");
}

static bool fmi2_enter(void)
{
    return status_well(call.enter(self), "fmi2EnterInitializationMode");
}

static bool fmi2_leave(void)
{
    return status_well(call.leave(self), "fmi2ExitInitializationMode");
}

/* It was looked at before whether it fits. */
static bool fmi2_set(const struct variable *v, double value)
{
    const int whole = v->type == TYPE_BOOLEAN ? value >= 0.5 : v->type == TYPE_INT32 ? (int)lrint(value) : 0;

    return status_well(v->type == TYPE_FLOAT64 ? call.set_real(self, &v->reference, 1, &value)
                       : v->type == TYPE_INT32 ? call.set_integer(self, &v->reference, 1, &whole)
                                               : call.set_boolean(self, &v->reference, 1, &whole),
                       v->name);
}

static bool fmi2_set_text(const struct variable *v, const char *text)
{
    if (!call.set_string)
        fputs("its library does not export fmi2SetString\n", stderr);
    return call.set_string && status_well(call.set_string(self, &v->reference, 1, &text), v->name);
}

static bool fmi2_get(const struct variable *v, double *value)
{
    int whole = 0, status;

    if (v->type == TYPE_FLOAT64)
        return status_well(call.get_real(self, &v->reference, 1, value), v->name);
    status = v->type == TYPE_INT32 ? call.get_integer(self, &v->reference, 1, &whole)
                                   : call.get_boolean(self, &v->reference, 1, &whole);
    *value = whole;
    return status_well(status, v->name);
}

static bool fmi2_get_float64(const uint32_t *reference, size_t n, double *value)
{
    return status_well(call.get_real(self, reference, n, value), "fmi2GetReal");
}

static int fmi2_directional(const uint32_t *unknown, size_t n, uint32_t known, double *value)
{
    const double one = 1.0;

    return call.directional ? call.directional(self, unknown, n, &known, 1, &one, value) : STATUS_ERROR;
}

/* What it says of a step that it has discarded. */
static void explain(double t, double h, double *reached)
{
    enum { LAST_SUCCESSFUL_TIME = 2, TERMINATED };
    double last = t;
    int ended = 0;

    if (call.real_status && call.real_status(self, LAST_SUCCESSFUL_TIME, &last) == STATUS_OK && last > t &&
        last <= t + h)
        *reached = last;
    if (call.boolean_status && call.boolean_status(self, TERMINATED, &ended) == STATUS_OK && ended) {
        fprintf(stderr, "the model has come to its end, at %g s\n", *reached);
        fmu_spent = true;
    } else {
        fprintf(stderr, "it got from %g s to %g s, not to %g s\n", t, *reached, t + h);
    }
}

static bool fmi2_step(double t, double h, double *reached)
{
    const int status = call.do_step(self, t, h, 1);

    *reached = t;
    if (status_well(status, "fmi2DoStep")) {
        *reached = t + h;
        return true;
    }
    if (status == STATUS_DISCARD)
        explain(t, h, reached);
    return false;
}

const struct standard fmi2 = {.load = fmi2_load,
                              .instantiate = fmi2_instantiate,
                              .enter = fmi2_enter,
                              .leave = fmi2_leave,
                              .set = fmi2_set,
                              .set_text = fmi2_set_text,
                              .get = fmi2_get,
                              .get_float64 = fmi2_get_float64,
                              .directional = fmi2_directional,
                              .step = fmi2_step,
                              .exchange = &exchange};

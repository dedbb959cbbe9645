/* SPDX-License-Identifier: BSD-3-Clause */
/* FMI 3.0, co-simulation without event mode and model exchange: its functions, as far as a plant needs them. */
#include "fmu.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

typedef void *instance;

/* Of each type of number: what it is called, and what it is in C. */
#define TYPES(X)                                                                                             \
    X(FLOAT64, Float64, double)                                                                              \
    X(FLOAT32, Float32, float)                                                                               \
    X(INT8, Int8, int8_t)                                                                                    \
    X(UINT8, UInt8, uint8_t)                                                                                 \
    X(INT16, Int16, int16_t)                                                                                 \
    X(UINT16, UInt16, uint16_t)                                                                              \
    X(INT32, Int32, int32_t)                                                                                 \
    X(UINT32, UInt32, uint32_t)                                                                              \
    X(INT64, Int64, int64_t)                                                                                 \
    X(UINT64, UInt64, uint64_t)                                                                              \
    X(BOOLEAN, Boolean, bool)

static struct {
    instance (*instantiate)(
        const char *name, const char *token, const char *resources, bool visible, bool logging, bool events,
        bool early, const uint32_t *intermediate, size_t n_intermediate, void *environment,
        void (*log)(void *environment, int status, const char *category, const char *message), void *update);
    int (*enter)(instance, bool tolerant, double tolerance, double start, bool stops, double stop);
    int (*leave)(instance);
    int (*do_step)(instance, double t, double h, bool no_way_back, bool *event, bool *ends, bool *early,
                   double *last);
    int (*set_string)(instance, const uint32_t *reference, size_t n, const char *const *value,
                      size_t n_values);
    instance (*instantiate_exchange)(const char *name, const char *token, const char *resources, bool visible,
                                     bool logging, void *environment,
                                     void (*log)(void *environment, int status, const char *category,
                                                 const char *message));
    int (*n_states)(instance, size_t *n);
    int (*n_indicators)(instance, size_t *n);
    int (*update)(instance, bool *again, bool *ends, bool *nominals, bool *states, bool *comes, double *at);
    int (*completed)(instance, bool no_way_back, bool *event, bool *ends);
    int (*directional)(instance, const uint32_t *unknown, size_t n_unknown, const uint32_t *known,
                       size_t n_known, const double *seed, size_t n_seed, double *value, size_t n_values);
#define MEMBERS(TYPE, Name, c)                                                                               \
    int (*get_##Name)(instance, const uint32_t *reference, size_t n, c *value, size_t n_values);             \
    int (*set_##Name)(instance, const uint32_t *reference, size_t n, const c *value, size_t n_values);
    TYPES(MEMBERS)
} call;
static instance self;

static void fmi3_log(void *environment, int status, const char *category, const char *message)
{
    (void)environment;
    if (status != STATUS_OK)
        fprintf(stderr, "%s: %s\n", category ? category : "", message ? message : "");
}

static int fmi3_sizes(size_t *n_states, size_t *n_indicators)
{
    const int status = call.n_states(self, n_states);
    return status > STATUS_WARNING ? status : call.n_indicators(self, n_indicators);
}

static int fmi3_update(struct event *e)
{
    bool nominals = false;
    return call.update(self, &e->again, &e->ends, &nominals, &e->states, &e->comes, &e->at);
}

static int fmi3_completed(bool *event, bool *ends)
{
    return call.completed(self, true, event, ends);
}

static struct exchange exchange = {.sizes = fmi3_sizes, .update = fmi3_update, .completed = fmi3_completed};

static const char *fmi3_load(void *library, const struct description *d)
{
    const struct entry_point all[] = {{"fmi3EnterInitializationMode", &call.enter},
                                      {"fmi3ExitInitializationMode", &call.leave},
#define SYMBOLS(TYPE, Name, c) {"fmi3Get" #Name, &call.get_##Name}, {"fmi3Set" #Name, &call.set_##Name},
                                      TYPES(SYMBOLS){NULL, NULL}},
                             steps[] = {{"fmi3InstantiateCoSimulation", &call.instantiate},
                                        {"fmi3DoStep", &call.do_step},
                                        {NULL, NULL}},
                             without_solver[] = {{"fmi3InstantiateModelExchange", &call.instantiate_exchange},
                                                 {"fmi3GetNumberOfContinuousStates", &call.n_states},
                                                 {"fmi3GetNumberOfEventIndicators", &call.n_indicators},
                                                 {"fmi3SetTime", &exchange.set_time},
                                                 {"fmi3SetContinuousStates", &exchange.set_states},
                                                 {"fmi3GetContinuousStates", &exchange.get_states},
                                                 {"fmi3GetNominalsOfContinuousStates",
                                                  &exchange.get_nominals},
                                                 {"fmi3GetContinuousStateDerivatives",
                                                  &exchange.get_derivatives},
                                                 {"fmi3GetEventIndicators", &exchange.get_indicators},
                                                 {"fmi3EnterEventMode", &exchange.enter_events},
                                                 {"fmi3UpdateDiscreteStates", &call.update},
                                                 {"fmi3EnterContinuousTimeMode", &exchange.enter_continuous},
                                                 {"fmi3CompletedIntegratorStep", &call.completed},
                                                 {NULL, NULL}},
                             seldom[] = {{"fmi3SetString", &call.set_string}, {NULL, NULL}},
                             derived[] = {{"fmi3GetDirectionalDerivative", &call.directional}, {NULL, NULL}};
    const char *missing = find_entry_points(library, all);

    if (!missing)
        missing = find_entry_points(library, d->co_simulation ? steps : without_solver);
    (void)find_entry_points(library, seldom);
    (void)find_entry_points(library, derived);
    return missing;
}

static bool fmi3_instantiate(const struct description *d, const char *folder)
{
    char resources[600];

    snprintf(resources, sizeof resources, "%s/resources/", folder);
    self = d->co_simulation
               ? call.instantiate(d->name, d->token, resources, false, true, false, false, NULL, 0, NULL,
                                  fmi3_log, NULL)
               : call.instantiate_exchange(d->name, d->token, resources, false, true, NULL, fmi3_log);
    exchange.self = self;
    return self != NULL;
}

static bool fmi3_enter(void)
{
    return status_well(call.enter(self, false, 0.0, 0.0, false, 0.0), "fmi3EnterInitializationMode");
}

static bool fmi3_leave(void)
{
    return status_well(call.leave(self), "fmi3ExitInitializationMode");
}

/* It was looked at before whether it fits. */
static bool fmi3_set(const struct variable *v, double value)
{
    switch (v->type) {
#define SET(TYPE, Name, c)                                                                                   \
    case TYPE_##TYPE: {                                                                                      \
        const c own = (c)(TYPE_##TYPE == TYPE_FLOAT64 || TYPE_##TYPE == TYPE_FLOAT32 ? value                 \
                          : TYPE_##TYPE == TYPE_BOOLEAN                              ? value >= 0.5          \
                                                                                     : rint(value));                                      \
        return status_well(call.set_##Name(self, &v->reference, 1, &own, 1), v->name);                       \
    }
        TYPES(SET)
    default:
        return false;
    }
}

static bool fmi3_set_text(const struct variable *v, const char *text)
{
    if (!call.set_string)
        fputs("its library does not export fmi3SetString\n", stderr);
    return call.set_string && status_well(call.set_string(self, &v->reference, 1, &text, 1), v->name);
}

static bool fmi3_get(const struct variable *v, double *value)
{
    switch (v->type) {
#define GET(TYPE, Name, c)                                                                                   \
    case TYPE_##TYPE: {                                                                                      \
        c own = 0;                                                                                           \
        const int status = call.get_##Name(self, &v->reference, 1, &own, 1);                                 \
        *value = (double)own;                                                                                \
        return status_well(status, v->name);                                                                 \
    }
        TYPES(GET)
    default:
        return false;
    }
}

static bool fmi3_get_float64(const uint32_t *reference, size_t n, double *value)
{
    return status_well(call.get_Float64(self, reference, n, value, n), "fmi3GetFloat64");
}

static int fmi3_directional(const uint32_t *unknown, size_t n, uint32_t known, double *value)
{
    const double one = 1.0;

    return call.directional ? call.directional(self, unknown, n, &known, 1, &one, 1, value, n) : STATUS_ERROR;
}

static bool fmi3_step(double t, double h, double *reached)
{
    bool event = false, ends = false, early = false;
    double last = t;
    const int status = call.do_step(self, t, h, true, &event, &ends, &early, &last);
    const bool well = status_well(status, "fmi3DoStep");

    *reached = well && !early && !ends ? t + h : last > t && last <= t + h ? last : t;
    if (well && ends) {
        fprintf(stderr, "fmi3DoStep: the model has come to its end, at %g s\n", *reached);
        fmu_spent = true;
    } else if ((well && early) || status == STATUS_DISCARD) {
        fprintf(stderr, "%sit got from %g s to %g s, not to %g s\n",
                well ? "fmi3DoStep: returned early, which nobody allowed: " : "", t, *reached, t + h);
    }
    return well && !ends && !early;
}

const struct standard fmi3 = {.load = fmi3_load,
                              .instantiate = fmi3_instantiate,
                              .enter = fmi3_enter,
                              .leave = fmi3_leave,
                              .set = fmi3_set,
                              .set_text = fmi3_set_text,
                              .get = fmi3_get,
                              .get_float64 = fmi3_get_float64,
                              .directional = fmi3_directional,
                              .step = fmi3_step,
                              .exchange = &exchange};

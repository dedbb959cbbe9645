/* SPDX-License-Identifier: BSD-3-Clause */
/* FMI 3.0, co-simulation without event mode: its functions, as far as a plant needs them. */
#include "fmu.h"

#include <dlfcn.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

enum { OK, WARNING, DISCARD, ERROR, FATAL };

typedef void *instance;

/* Of each type of number: what it is called, what it is in C, what it may be. */
#define TYPES(X)                                                                                             \
    X(FLOAT64, Float64, double, -HUGE_VAL, HUGE_VAL)                                                         \
    X(FLOAT32, Float32, float, -HUGE_VAL, HUGE_VAL)                                                          \
    X(INT8, Int8, int8_t, INT8_MIN, INT8_MAX)                                                                \
    X(UINT8, UInt8, uint8_t, 0, UINT8_MAX)                                                                   \
    X(INT16, Int16, int16_t, INT16_MIN, INT16_MAX)                                                           \
    X(UINT16, UInt16, uint16_t, 0, UINT16_MAX)                                                               \
    X(INT32, Int32, int32_t, INT32_MIN, INT32_MAX)                                                           \
    X(UINT32, UInt32, uint32_t, 0, UINT32_MAX)                                                               \
    X(INT64, Int64, int64_t, -9e15, 9e15)                                                                    \
    X(UINT64, UInt64, uint64_t, 0, 9e15)                                                                     \
    X(BOOLEAN, Boolean, bool, 0, 1)

static struct {
    instance (*instantiate)(
        const char *name, const char *token, const char *resources, bool visible, bool logging, bool events,
        bool early, const uint32_t *intermediate, size_t n_intermediate, void *environment,
        void (*log)(void *environment, int status, const char *category, const char *message), void *update);
    int (*enter)(instance, bool tolerant, double tolerance, double start, bool stops, double stop);
    int (*leave)(instance);
    int (*do_step)(instance, double t, double h, bool no_way_back, bool *event, bool *ends, bool *early,
                   double *last);
#define MEMBERS(TYPE, Name, c, low, high)                                                                    \
    int (*get_##Name)(instance, const uint32_t *reference, size_t n, c *value, size_t n_values);             \
    int (*set_##Name)(instance, const uint32_t *reference, size_t n, const c *value, size_t n_values);
    TYPES(MEMBERS)
} call;
static instance self;

static void say(void *environment, int status, const char *category, const char *message)
{
    (void)environment;
    if (status != OK)
        fprintf(stderr, "%s: %s\n", category ? category : "", message ? message : "");
}

static const char *load(void *library)
{
    const struct {
        const char *name;
        void *at;
    } needed[] = {{"fmi3InstantiateCoSimulation", &call.instantiate},
                  {"fmi3EnterInitializationMode", &call.enter},
                  {"fmi3ExitInitializationMode", &call.leave},
                  {"fmi3DoStep", &call.do_step},
#define SYMBOLS(TYPE, Name, c, low, high)                                                                    \
    {"fmi3Get" #Name, &call.get_##Name}, {"fmi3Set" #Name, &call.set_##Name},
                  TYPES(SYMBOLS)};

    for (size_t i = 0; i < sizeof needed / sizeof needed[0]; i++) {
        void *const address = dlsym(library, needed[i].name);
        if (!address)
            return needed[i].name;
        memcpy(needed[i].at, &address, sizeof address);
    }
    return NULL;
}

static bool well(int status, const char *what)
{
    if (status == OK || status == WARNING)
        return true;
    fprintf(stderr, "%s: %s\n", what,
            status == DISCARD ? "discarded"
            : status == ERROR ? "error"
                              : "fatal error");
    if (status == FATAL)
        exit(EXIT_FAILURE); /* of no use any more */
    return false;
}

static bool instantiate(const struct description *d, const char *folder)
{
    char resources[600];

    snprintf(resources, sizeof resources, "%s/resources/", folder);
    self =
        call.instantiate(d->name, d->token, resources, false, true, false, false, NULL, 0, NULL, say, NULL);
    return self != NULL;
}

static bool enter(void)
{
    return well(call.enter(self, false, 0.0, 0.0, false, 0.0), "fmi3EnterInitializationMode");
}

static bool leave(void)
{
    return well(call.leave(self), "fmi3ExitInitializationMode");
}

static bool set(const struct variable *v, double value)
{
    switch (v->type) {
#define SET(TYPE, Name, c, low, high)                                                                        \
    case TYPE_##TYPE: {                                                                                      \
        const c own =                                                                                        \
            (c)fmax(fmin(TYPE_##TYPE == TYPE_FLOAT64 || TYPE_##TYPE == TYPE_FLOAT32 ? value : rint(value),   \
                         (double)(high)),                                                                    \
                    (double)(low));                                                                          \
        return well(call.set_##Name(self, &v->reference, 1, &own, 1), v->name);                              \
    }
        TYPES(SET)
    default:
        return false;
    }
}

static bool get(const struct variable *v, double *value)
{
    switch (v->type) {
#define GET(TYPE, Name, c, low, high)                                                                        \
    case TYPE_##TYPE: {                                                                                      \
        c own = 0;                                                                                           \
        const int status = call.get_##Name(self, &v->reference, 1, &own, 1);                                 \
        *value = (double)own;                                                                                \
        return well(status, v->name);                                                                        \
    }
        TYPES(GET)
    default:
        return false;
    }
}

static bool get_float64(const uint32_t *reference, size_t n, double *value)
{
    return well(call.get_Float64(self, reference, n, value, n), "fmi3GetFloat64");
}

static bool step(double t, double h)
{
    bool event = false, ends = false, early = false;
    double last = t + h;

    if (!well(call.do_step(self, t, h, true, &event, &ends, &early, &last), "fmi3DoStep"))
        return false;
    if (ends)
        fprintf(stderr, "fmi3DoStep: the model has come to its end\n");
    else if (early)
        fprintf(stderr, "fmi3DoStep: returned early, at %g s, which nobody allowed\n", last);
    return !ends && !early;
}

const struct standard fmi3 = {.load = load,
                              .instantiate = instantiate,
                              .enter = enter,
                              .leave = leave,
                              .set = set,
                              .get = get,
                              .get_float64 = get_float64,
                              .step = step};

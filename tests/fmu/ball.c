/* SPDX-License-Identifier: BSD-3-Clause */
/*
 * A ball that bounces, as a model without a solver: FMI 2 or 3 (-DFMI) for model exchange. It has what a solver must care
 * for: a state event at each bounce, where its velocity jumps; a time event each quarter of a second, which a counter
 * counts; inputs that may jump, a push and a wind upwards. What else it does to who runs it, its parameter "trick" says.
 */
#include <math.h>
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <string.h>

#define EXPORT __attribute__((visibility("default")))

/* Value references; beyond 4 parameters. */
enum { H, V, DH, DV, PUSH, COUNT, BOUNCES, GRAVITY, RESTITUTION, TRICK, WIND, N };
enum { CHATTERS = 1, NOT_A_NUMBER, ENDS, NEVER_SETTLES, FAILS, DISCARDS, ERRS };

static double v[N] = {[H] = 1.0, [GRAVITY] = -9.81, [RESTITUTION] = 0.7};
static double now, next = 0.25;

/* Of each, what follows from what was set. */
static void follow(void)
{
    v[DH] = v[V];
    v[DV] = v[TRICK] == NOT_A_NUMBER && now > 0.6 ? (double)NAN : v[GRAVITY] + v[PUSH] + v[WIND];
}

static int update(bool *again, bool *ends, bool *states, bool *comes, double *at)
{
    if (v[TRICK] == FAILS && now > 0.6)
        return 3;
    if (v[H] <= 0.0 && v[V] < 0.0) {
        v[H] = 0.0;
        v[V] = -v[RESTITUTION] * v[V];
        v[BOUNCES] += 1.0;
        *states = true;
    }
    while (now >= next) {
        v[COUNT] += 1.0;
        next += 0.25;
    }
    *again = v[TRICK] == NEVER_SETTLES && now > 0.6;
    *ends = v[TRICK] == ENDS && now > 0.6;
    *comes = true;
    *at = v[TRICK] == CHATTERS && now > 0.6 ? now : next;
    return 0;
}

static int move(const uint32_t *reference, size_t n, double *value, const double *from)
{
    for (size_t i = 0; i < n; i++) {
        if (reference[i] >= N)
            return 3;
        if (from)
            v[reference[i]] = from[i];
        follow();
        if (!from)
            value[i] = v[reference[i]];
    }
    return 0;
}

static int derivatives(double *dx)
{
    static bool failed;

    if (failed) { /* the standard allows no other question after an error */
        fputs("asked after an error\n", stderr);
        return 3;
    }
    failed = v[TRICK] == ERRS && now > 0.6;
    follow();
    dx[0] = v[DH];
    dx[1] = v[DV];
    return failed ? 3 : v[TRICK] == DISCARDS && now > 0.6 ? 2 : 0;
}

static int states(double *x, const double *from)
{
    if (from) {
        v[H] = from[0];
        v[V] = from[1];
    } else {
        x[0] = v[H];
        x[1] = v[V];
    }
    return 0;
}

/* That of a ball which lies is held above. */
static double indicator(void)
{
    return v[H] == 0.0 && v[V] >= 0.0 ? 1.0 : v[H];
}

static int set_clock(double t)
{
    now = t;
    return 0;
}

#define SAME(version)                                                                                        \
    EXPORT int fmi##version##SetTime(void *self, double t);                                                  \
    EXPORT int fmi##version##SetContinuousStates(void *self, const double *x, size_t n);                     \
    EXPORT int fmi##version##GetContinuousStates(void *self, double *x, size_t n);                           \
    EXPORT int fmi##version##GetNominalsOfContinuousStates(void *self, double *x, size_t n);                 \
    EXPORT int fmi##version##GetEventIndicators(void *self, double *z, size_t n);                            \
    EXPORT int fmi##version##EnterEventMode(void *self);                                                     \
    EXPORT int fmi##version##EnterContinuousTimeMode(void *self);                                            \
    EXPORT int fmi##version##ExitInitializationMode(void *self);                                             \
    EXPORT int fmi##version##Terminate(void *self);                                                          \
    EXPORT void fmi##version##FreeInstance(void *self);                                                      \
    int fmi##version##SetTime(void *self, double t)                                                          \
    {                                                                                                        \
        return self ? set_clock(t) : 3;                                                                      \
    }                                                                                                        \
    int fmi##version##SetContinuousStates(void *self, const double *x, size_t n)                             \
    {                                                                                                        \
        return self && n == 2 ? states(NULL, x) : 3;                                                         \
    }                                                                                                        \
    int fmi##version##GetContinuousStates(void *self, double *x, size_t n)                                   \
    {                                                                                                        \
        return self && n == 2 ? states(x, NULL) : 3;                                                         \
    }                                                                                                        \
    int fmi##version##GetNominalsOfContinuousStates(void *self, double *x, size_t n)                         \
    {                                                                                                        \
        x[0] = x[n - 1] = 1.0;                                                                               \
        return self ? 0 : 3;                                                                                 \
    }                                                                                                        \
    int fmi##version##GetEventIndicators(void *self, double *z, size_t n)                                    \
    {                                                                                                        \
        z[0] = indicator();                                                                                  \
        return self && n == 1 ? 0 : 3;                                                                       \
    }                                                                                                        \
    int fmi##version##EnterEventMode(void *self)                                                             \
    {                                                                                                        \
        return self ? 0 : 3;                                                                                 \
    }                                                                                                        \
    int fmi##version##EnterContinuousTimeMode(void *self)                                                    \
    {                                                                                                        \
        return self ? 0 : 3;                                                                                 \
    }                                                                                                        \
    int fmi##version##ExitInitializationMode(void *self)                                                     \
    {                                                                                                        \
        return self ? 0 : 3;                                                                                 \
    }                                                                                                        \
    int fmi##version##Terminate(void *self)                                                                  \
    {                                                                                                        \
        return self ? 0 : 3;                                                                                 \
    }                                                                                                        \
    void fmi##version##FreeInstance(void *self)                                                              \
    {                                                                                                        \
        (void)self;                                                                                          \
    }

#if FMI == 2
SAME(2)
#define NUMBERS(Name, c)                                                                                     \
    EXPORT int fmi2Get##Name(void *self, const uint32_t *reference, size_t n, c *value);                     \
    EXPORT int fmi2Set##Name(void *self, const uint32_t *reference, size_t n, const c *value);               \
    int fmi2Get##Name(void *self, const uint32_t *reference, size_t n, c *value)                             \
    {                                                                                                        \
        for (size_t i = 0; self && i < n; i++) {                                                             \
            double own = 0;                                                                                  \
            if (move(&reference[i], 1, &own, NULL))                                                          \
                return 3;                                                                                    \
            value[i] = (c)own;                                                                               \
        }                                                                                                    \
        return 0;                                                                                            \
    }                                                                                                        \
    int fmi2Set##Name(void *self, const uint32_t *reference, size_t n, const c *value)                       \
    {                                                                                                        \
        const double own = (double)*value;                                                                   \
        return self && n == 1 ? move(reference, 1, NULL, &own) : 3;                                          \
    }
NUMBERS(Real, double)
NUMBERS(Integer, int)
NUMBERS(Boolean, int)

struct info {
    int again, ends, nominals, states, comes;
    double at;
};

EXPORT void *fmi2Instantiate(const char *name, int type, const char *guid, const char *resources,
                             const void *call, int visible, int logging);
EXPORT int fmi2SetupExperiment(void *self, int tolerant, double tolerance, double start, int stops,
                               double stop);
EXPORT int fmi2EnterInitializationMode(void *self);
EXPORT int fmi2GetDerivatives(void *self, double *dx, size_t n);
EXPORT int fmi2NewDiscreteStates(void *self, struct info *info);
EXPORT int fmi2CompletedIntegratorStep(void *self, int final, int *event, int *ends);

void *fmi2Instantiate(const char *name, int type, const char *guid, const char *resources, const void *call,
                      int visible, int logging)
{
    return name && resources && call && !visible && logging >= 0 && type == 0 && strcmp(guid, "{ball}") == 0
               ? v
               : NULL;
}

int fmi2SetupExperiment(void *self, int tolerant, double tolerance, double start, int stops, double stop)
{
    return self && (!tolerant || tolerance > 0.0) && !(start > 0.0) && (!stops || stop > 0.0) ? 0 : 3;
}

int fmi2EnterInitializationMode(void *self)
{
    return self ? 0 : 3;
}

int fmi2GetDerivatives(void *self, double *dx, size_t n)
{
    return self && n == 2 ? derivatives(dx) : 3;
}

int fmi2NewDiscreteStates(void *self, struct info *info)
{
    bool again = false, ends = false, jumped = false, comes = false;
    const int status = self ? update(&again, &ends, &jumped, &comes, &info->at) : 3;

    info->again = again;
    info->ends = ends;
    info->nominals = 0;
    info->states = jumped;
    info->comes = comes;
    return status;
}

int fmi2CompletedIntegratorStep(void *self, int final, int *event, int *ends)
{
    *event = *ends = 0;
    return self && final ? 0 : 3;
}
#else
SAME(3)
#define NUMBERS(Name, c)                                                                                     \
    EXPORT int fmi3Get##Name(void *self, const uint32_t *reference, size_t n, c *value, size_t values);      \
    EXPORT int fmi3Set##Name(void *self, const uint32_t *reference, size_t n, const c *value,                \
                             size_t values);                                                                 \
    int fmi3Get##Name(void *self, const uint32_t *reference, size_t n, c *value, size_t values)              \
    {                                                                                                        \
        for (size_t i = 0; self && i < n; i++) {                                                             \
            double own = 0;                                                                                  \
            if (n != values || move(&reference[i], 1, &own, NULL))                                           \
                return 3;                                                                                    \
            value[i] = (c)own;                                                                               \
        }                                                                                                    \
        return 0;                                                                                            \
    }                                                                                                        \
    int fmi3Set##Name(void *self, const uint32_t *reference, size_t n, const c *value, size_t values)        \
    {                                                                                                        \
        const double own = (double)*value;                                                                   \
        return self && n == 1 && values == 1 ? move(reference, 1, NULL, &own) : 3;                           \
    }
NUMBERS(Float64, double)
NUMBERS(Float32, float)
NUMBERS(Int8, int8_t)
NUMBERS(UInt8, uint8_t)
NUMBERS(Int16, int16_t)
NUMBERS(UInt16, uint16_t)
NUMBERS(Int32, int32_t)
NUMBERS(UInt32, uint32_t)
NUMBERS(Int64, int64_t)
NUMBERS(UInt64, uint64_t)
NUMBERS(Boolean, bool)

EXPORT void *fmi3InstantiateModelExchange(const char *name, const char *token, const char *resources,
                                          bool visible, bool logging, void *environment, void *log);
EXPORT int fmi3EnterInitializationMode(void *self, bool tolerant, double tolerance, double start, bool stops,
                                       double stop);
EXPORT int fmi3GetNumberOfContinuousStates(void *self, size_t *n);
EXPORT int fmi3GetNumberOfEventIndicators(void *self, size_t *n);
EXPORT int fmi3GetContinuousStateDerivatives(void *self, double *dx, size_t n);
EXPORT int fmi3UpdateDiscreteStates(void *self, bool *again, bool *ends, bool *nominals, bool *jumped,
                                    bool *comes, double *at);
EXPORT int fmi3CompletedIntegratorStep(void *self, bool final, bool *event, bool *ends);

void *fmi3InstantiateModelExchange(const char *name, const char *token, const char *resources, bool visible,
                                   bool logging, void *environment, void *log)
{
    (void)logging;
    (void)environment;
    (void)log;
    return name && resources && !visible && strcmp(token, "{ball}") == 0 ? v : NULL;
}

int fmi3EnterInitializationMode(void *self, bool tolerant, double tolerance, double start, bool stops,
                                double stop)
{
    return self && (!tolerant || tolerance > 0.0) && !(start > 0.0) && (!stops || stop > 0.0) ? 0 : 3;
}

int fmi3GetNumberOfContinuousStates(void *self, size_t *n)
{
    *n = 2;
    return self ? 0 : 3;
}

int fmi3GetNumberOfEventIndicators(void *self, size_t *n)
{
    *n = 1;
    return self ? 0 : 3;
}

int fmi3GetContinuousStateDerivatives(void *self, double *dx, size_t n)
{
    return self && n == 2 ? derivatives(dx) : 3;
}

int fmi3UpdateDiscreteStates(void *self, bool *again, bool *ends, bool *nominals, bool *jumped, bool *comes,
                             double *at)
{
    *again = *ends = *nominals = *jumped = *comes = false;
    return self ? update(again, ends, jumped, comes, at) : 3;
}

int fmi3CompletedIntegratorStep(void *self, bool final, bool *event, bool *ends)
{
    *event = *ends = false;
    return self && final ? 0 : 3;
}
#endif

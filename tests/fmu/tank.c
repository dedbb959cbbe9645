/* SPDX-License-Identifier: BSD-3-Clause */
/*
 * A tank as an FMU, of version 2 or 3 (FMI): dx/dt = (-x + K u + d) / tau, y = x, exactly from one
 * communication point to the next. At the value 1 of its parameter `trick` and from 5 s on it hangs, at 2
 * crashes, at 3 returns an error, at 4 NaN, at 5 exits, at 6 prints without end, at 7 leaves a process behind
 * as it is killed, at 8 hangs as it begins, at 9 fails as it begins, at 10 discards each other step, at 11
 * half of each, at 12 comes to its end in the middle of one, at 13 warns, at 14 returns early. Its state may
 * be set, and its derivative read; there is also one that stays as it is, and a state that does. In `mode` 4
 * it takes twice as much, without `on` nothing, and a `note` "leaky" lets 5 run out.
 */
#include <math.h>
#include <signal.h>
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#define EXPORT __attribute__((visibility("default")))

enum { U, D, Y, K, TAU, TRICK, SLOPE, STUCK_SLOPE, STUCK, MODE, NOTE, ON, N };

static double v[N] = {[K] = 10.0, [TAU] = 10.0, [MODE] = 2.0, [ON] = 1.0};
static double reached; /* in the step that was not taken whole */

static double inflow(void)
{
    return v[K] * (v[MODE] == 4.0 ? 2.0 : 1.0) * v[ON] * v[U] + v[D] - v[NOTE];
}

static void hang(void)
{
    for (;;)
        pause();
}

static int begin(void)
{
    if (v[TRICK] == 8.0)
        hang();
    return v[TRICK] == 9.0 ? 3 : 0;
}

static int go(double t, double h)
{
    const double to = inflow();

    reached = t;
    v[Y] = to + (v[Y] - to) * exp(-h / v[TAU]);
    if (t < 5.0)
        return 0;
    switch ((int)v[TRICK]) {
    case 1:
        hang();
        break;
    case 2:
        signal(SIGSEGV, SIG_DFL); /* also where a sanitizer has its own */
        raise(SIGSEGV);
        break;
    case 3:
        fprintf(stderr, "the tank is empty\n");
        return 3;
    case 4:
        v[Y] = (double)NAN;
        break;
    case 5:
        exit(7);
    case 6:
        for (int i = 0; i < 10000; i++)
            printf("the tank is at %g m and says so again and again\n", v[Y]);
        break;
    case 10: {
        static bool odd;
        odd = !odd;
        return odd ? 2 : 0;
    }
    case 11:
    case 12:
        reached = t + h / 2;
        return 2;
    case 13:
        return 1;
    case 14:
        reached = t + h / 2;
        return 0;
    case 7:
        if (fork() == 0)
            execlp("sleep", "sleep", "4242.42", NULL);
        raise(SIGKILL);
        break;
    default:
        break;
    }
    return 0;
}

static int move(const uint32_t *reference, size_t n, double *value, const double *from)
{
    for (size_t i = 0; i < n; i++) {
        if (reference[i] >= N)
            return 3;
        if (from && (reference[i] < SLOPE || reference[i] >= MODE))
            v[reference[i]] = from[i];
        v[SLOPE] = (inflow() - v[Y]) / v[TAU];
        if (!from)
            value[i] = v[reference[i]];
    }
    return 0;
}

static int note(uint32_t reference, const char *text)
{
    v[NOTE] = strcmp(text, "leaky") == 0 ? 5.0 : 0.0;
    return reference == NOTE ? 0 : 3;
}

#if FMI == 2
#define NUMBERS(Name, c)                                                                                     \
    EXPORT int fmi2Get##Name(void *self, const uint32_t *reference, size_t n, c *value);                     \
    EXPORT int fmi2Set##Name(void *self, const uint32_t *reference, size_t n, const c *value);               \
    int fmi2Get##Name(void *self, const uint32_t *reference, size_t n, c *value)                             \
    {                                                                                                        \
        double own = 0;                                                                                      \
        const int status = move(reference, n ? 1 : 0, &own, NULL);                                           \
        (void)self;                                                                                          \
        *value = (c)own;                                                                                     \
        return status;                                                                                       \
    }                                                                                                        \
    int fmi2Set##Name(void *self, const uint32_t *reference, size_t n, const c *value)                       \
    {                                                                                                        \
        const double own = (double)*value;                                                                   \
        (void)self;                                                                                          \
        return move(reference, n ? 1 : 0, NULL, &own);                                                       \
    }
NUMBERS(Real, double)
NUMBERS(Integer, int)
NUMBERS(Boolean, int)

EXPORT void *fmi2Instantiate(const char *name, int type, const char *guid, const char *resources,
                             const void *call, int visible, int logging);
EXPORT int fmi2SetupExperiment(void *self, int tolerant, double tolerance, double start, int stops,
                               double stop);
EXPORT int fmi2EnterInitializationMode(void *self);
EXPORT int fmi2ExitInitializationMode(void *self);
EXPORT int fmi2DoStep(void *self, double t, double h, int no_way_back);
EXPORT int fmi2SetString(void *self, const uint32_t *reference, size_t n, const char *const *value);
EXPORT int fmi2GetRealStatus(void *self, int what, double *value);
EXPORT int fmi2GetBooleanStatus(void *self, int what, int *value);
/* What fmpy asks for besides. */
EXPORT int fmi2Terminate(void *self);
EXPORT void fmi2FreeInstance(void *self);

void *fmi2Instantiate(const char *name, int type, const char *guid, const char *resources, const void *call,
                      int visible, int logging)
{
    (void)name;
    (void)call;
    (void)visible;
    (void)logging;
    return type == 1 && strcmp(guid, "{tank}") == 0 && strncmp(resources, "file:///", 8) == 0 ? v : NULL;
}

int fmi2SetupExperiment(void *self, int tolerant, double tolerance, double start, int stops, double stop)
{
    (void)self;
    (void)tolerant;
    (void)tolerance;
    (void)stops;
    (void)stop;
    return start > 0.0 ? 3 : 0;
}

int fmi2EnterInitializationMode(void *self)
{
    (void)self;
    return begin();
}

int fmi2ExitInitializationMode(void *self)
{
    (void)self;
    return 0;
}

int fmi2SetString(void *self, const uint32_t *reference, size_t n, const char *const *value)
{
    (void)self;
    return n == 1 ? note(*reference, *value) : 3;
}

int fmi2GetRealStatus(void *self, int what, double *value)
{
    (void)self;
    *value = reached;
    return what == 2 ? 0 : 3;
}

int fmi2GetBooleanStatus(void *self, int what, int *value)
{
    (void)self;
    *value = v[TRICK] == 12.0;
    return what == 3 ? 0 : 3;
}

#ifndef WITHOUT_STEP
int fmi2DoStep(void *self, double t, double h, int no_way_back)
{
    (void)self;
    (void)no_way_back;
    return go(t, h);
}
#endif

int fmi2Terminate(void *self)
{
    (void)self;
    return 0;
}

void fmi2FreeInstance(void *self)
{
    (void)self;
}
#else
#define NUMBERS(Name, c)                                                                                     \
    EXPORT int fmi3Get##Name(void *self, const uint32_t *reference, size_t n, c *value, size_t values);      \
    EXPORT int fmi3Set##Name(void *self, const uint32_t *reference, size_t n, const c *value,                \
                             size_t values);                                                                 \
    int fmi3Get##Name(void *self, const uint32_t *reference, size_t n, c *value, size_t values)              \
    {                                                                                                        \
        double own = 0;                                                                                      \
        const int status = move(reference, n == values ? 1 : 0, &own, NULL);                                 \
        (void)self;                                                                                          \
        *value = (c)own;                                                                                     \
        return status;                                                                                       \
    }                                                                                                        \
    int fmi3Set##Name(void *self, const uint32_t *reference, size_t n, const c *value, size_t values)        \
    {                                                                                                        \
        const double own = (double)*value;                                                                   \
        (void)self;                                                                                          \
        return move(reference, n == values ? 1 : 0, NULL, &own);                                             \
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

EXPORT void *fmi3InstantiateCoSimulation(const char *name, const char *token, const char *resources,
                                         bool visible, bool logging, bool events, bool early,
                                         const uint32_t *intermediate, size_t n, void *environment, void *log,
                                         void *update);
EXPORT int fmi3EnterInitializationMode(void *self, bool tolerant, double tolerance, double start, bool stops,
                                       double stop);
EXPORT int fmi3ExitInitializationMode(void *self);
EXPORT int fmi3SetString(void *self, const uint32_t *reference, size_t n, const char *const *value,
                         size_t values);
EXPORT int fmi3DoStep(void *self, double t, double h, bool no_way_back, bool *event, bool *ends, bool *early,
                      double *last);

void *fmi3InstantiateCoSimulation(const char *name, const char *token, const char *resources, bool visible,
                                  bool logging, bool events, bool early, const uint32_t *intermediate,
                                  size_t n, void *environment, void *log, void *update)
{
    (void)name;
    (void)visible;
    (void)logging;
    (void)intermediate;
    (void)environment;
    (void)log;
    (void)update;
    return strcmp(token, "{tank}") == 0 && resources[0] == '/' && resources[strlen(resources) - 1] == '/' &&
                   !events && !early && n == 0
               ? v
               : NULL;
}

int fmi3EnterInitializationMode(void *self, bool tolerant, double tolerance, double start, bool stops,
                                double stop)
{
    (void)self;
    (void)tolerant;
    (void)tolerance;
    (void)stops;
    (void)stop;
    return start > 0.0 ? 3 : begin();
}

int fmi3ExitInitializationMode(void *self)
{
    (void)self;
    return 0;
}

int fmi3SetString(void *self, const uint32_t *reference, size_t n, const char *const *value, size_t values)
{
    (void)self;
    return n == 1 && values == 1 ? note(*reference, *value) : 3;
}

int fmi3DoStep(void *self, double t, double h, bool no_way_back, bool *event, bool *ends, bool *early,
               double *last)
{
    const int status = go(t, h);
    (void)self;
    (void)no_way_back;
    *event = false;
    *ends = status == 2 && v[TRICK] == 12.0;
    *early = reached > t;
    *last = status == 0 && !*early ? t + h : reached;
    return *ends ? 0 : status;
}
#endif

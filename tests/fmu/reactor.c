/* SPDX-License-Identifier: BSD-3-Clause */
/*
 * The adiabatic reactor that is built in, as an FMU for model exchange, of version 2 or 3 (-DFMI). Where it is only looked
 * ahead at, which it knows by the time that nobody sets, a derivative is NaN at the value 1 of its parameter `trick`, at
 * 2 the call fails, at 3 it hangs, at 6 the process ends. At 4 directional derivatives fail, at 5 it names a time of
 * an event. At 7 it takes no feed beyond its limits.
 */
#include "../../src/plant/adiabatic_cstr.c"

#include <stdbool.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#define EXPORT __attribute__((visibility("default")))

/* Value references: states, derivatives, inputs, output, parameters, trick; states that only die away, which a
 * description may have as well, and their derivatives. */
enum { X = 0, DX = 3, U = 6, Y = 10, P = 11, TRICK = 15, MORE = 16, MANY = 150, N = MORE + 2 * MANY };
enum { NOT_A_NUMBER = 1, FAILS, HANGS, DERIVES_NOT, NAMES_A_TIME, EXITS, REFUSES };

static double v[N];
static bool begun, timed;

static void *begin(const char *token)
{
    memcpy(v + X, (const double[]){0.51509, 0.63017, 38.6155},
           3 * sizeof(*v)); /* at rest, unless it is disturbed */
    v[U] = input[0].initial;
    for (size_t i = 0; i < 3; i++)
        v[U + 1 + i] = disturbance[i].initial;
    for (size_t i = 0; i < N_PARAM; i++)
        v[P + i] = param[i].initial;
    v[TRICK] = 0.0;
    return strcmp(token, "{reactor}") == 0 ? v : NULL;
}

static int follow(void)
{
    const bool ahead = begun && !timed;

    adiabatic_cstr_g(0.0, v, v + U, v + P, v + Y);
    if (adiabatic_cstr_f(0.0, v, v + U, v + P, v + DX))
        return 2;
    if (ahead && v[TRICK] == NOT_A_NUMBER)
        v[DX] = (double)NAN;
    while (ahead && v[TRICK] == HANGS)
        pause();
    if (ahead && v[TRICK] == EXITS)
        _exit(7);
    if (ahead && v[TRICK] == FAILS)
        fputs("the reactor has burst\n", stderr);
    return ahead && v[TRICK] == FAILS ? 3 : 0;
}

static int move(const uint32_t *reference, size_t n, double *value, const double *from)
{
    int status = 0;

    for (size_t i = 0; i < n; i++) {
        if (reference[i] >= N)
            return 3;
        if (from && v[TRICK] == REFUSES && reference[i] == U && !(from[i] >= 0.0 && from[i] <= 1000.0))
            return 3;
        if (from)
            v[reference[i]] = from[i];
        else if (reference[i] >= DX && reference[i] < U)
            status = follow();
        else if (reference[i] == Y)
            v[Y] = v[X + 2];
        else if (reference[i] >= MORE + MANY)
            v[reference[i]] = -v[reference[i] - MANY];
        if (!from)
            value[i] = v[reference[i]];
    }
    return status;
}

static int derivatives(double *dx, size_t n)
{
    const int status = n == 3 ? follow() : 3;

    memcpy(dx, v + DX, 3 * sizeof(*dx));
    return status;
}

/* By one that is known, exactly but for rounding; of outputs that are states it says nothing. */
static int directional(const uint32_t *unknown, size_t n, uint32_t known, double *value)
{
    const double own = v[known], h = 1e-4 * fmax(fabs(own), 1e-2);
    double f[4][3];

    for (size_t k = 0; k < 4; k++) {
        v[known] = own + (double[]){h, -h, 2.0 * h, -2.0 * h}[k];
        if (adiabatic_cstr_f(0.0, v, v + U, v + P, f[k]))
            return 2;
    }
    v[known] = own;
    for (size_t i = 0; i < n; i++) {
        const size_t row = unknown[i] - DX;

        if (row >= 3 || v[TRICK] == DERIVES_NOT)
            return 3;
        value[i] = (8.0 * (f[0][row] - f[1][row]) - (f[2][row] - f[3][row])) / (12.0 * h);
    }
    return 0;
}

#define SAME(version)                                                                                        \
    EXPORT int fmi##version##SetTime(void *self, double t)                                                   \
    {                                                                                                        \
        timed = true;                                                                                        \
        return self && t >= 0.0 ? 0 : 3;                                                                     \
    }                                                                                                        \
    EXPORT int fmi##version##SetContinuousStates(void *self, const double *x, size_t n)                      \
    {                                                                                                        \
        memcpy(v + X, x, 3 * sizeof(*x));                                                                    \
        return self && n == 3 ? 0 : 3;                                                                       \
    }                                                                                                        \
    EXPORT int fmi##version##GetContinuousStates(void *self, double *x, size_t n)                            \
    {                                                                                                        \
        memcpy(x, v + X, 3 * sizeof(*x));                                                                    \
        return self && n == 3 ? 0 : 3;                                                                       \
    }                                                                                                        \
    EXPORT int fmi##version##GetNominalsOfContinuousStates(void *self, double *x, size_t n)                  \
    {                                                                                                        \
        x[0] = x[1] = x[2] = 1.0;                                                                            \
        return self && n == 3 ? 0 : 3;                                                                       \
    }                                                                                                        \
    EXPORT int fmi##version##GetEventIndicators(void *self, double *z, size_t n)                             \
    {                                                                                                        \
        (void)z;                                                                                             \
        return self && n == 0 ? 0 : 3;                                                                       \
    }                                                                                                        \
    EXPORT int fmi##version##EnterEventMode(void *self)                                                      \
    {                                                                                                        \
        return self ? 0 : 3;                                                                                 \
    }                                                                                                        \
    EXPORT int fmi##version##EnterContinuousTimeMode(void *self)                                             \
    {                                                                                                        \
        return self ? 0 : 3;                                                                                 \
    }                                                                                                        \
    EXPORT int fmi##version##ExitInitializationMode(void *self)                                              \
    {                                                                                                        \
        begun = true;                                                                                        \
        return self ? 0 : 3;                                                                                 \
    }

#if FMI == 2
SAME(2)
#define NUMBERS(Name, c)                                                                                     \
    EXPORT int fmi2Get##Name(void *self, const uint32_t *reference, size_t n, c *value)                      \
    {                                                                                                        \
        for (size_t i = 0; self && i < n; i++) {                                                             \
            double own = 0;                                                                                  \
            const int status = move(&reference[i], 1, &own, NULL);                                           \
            if (status)                                                                                      \
                return status;                                                                               \
            value[i] = (c)own;                                                                               \
        }                                                                                                    \
        return 0;                                                                                            \
    }                                                                                                        \
    EXPORT int fmi2Set##Name(void *self, const uint32_t *reference, size_t n, const c *value)                \
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
                             const void *call, int visible, int logging)
{
    return name && resources && call && !visible && logging >= 0 && type == 0 ? begin(guid) : NULL;
}

EXPORT int fmi2SetupExperiment(void *self, int tolerant, double tolerance, double start, int stops,
                               double stop)
{
    return self && !tolerant && tolerance <= 0.0 && !stops && stop <= 0.0 && start <= 0.0 ? 0 : 3;
}

EXPORT int fmi2EnterInitializationMode(void *self)
{
    return self ? 0 : 3;
}

EXPORT int fmi2GetDerivatives(void *self, double *dx, size_t n)
{
    return self ? derivatives(dx, n) : 3;
}

EXPORT int fmi2NewDiscreteStates(void *self, struct info *info)
{
    *info = (struct info){.comes = v[TRICK] == NAMES_A_TIME, .at = 1e6};
    return self ? 0 : 3;
}

EXPORT int fmi2CompletedIntegratorStep(void *self, int final, int *event, int *ends)
{
    *event = *ends = 0;
    return self && final ? 0 : 3;
}

EXPORT int fmi2GetDirectionalDerivative(void *self, const uint32_t *unknown, size_t n, const uint32_t *known,
                                        size_t n_known, const double *seed, double *value)
{
    return self && n_known == 1 && seed[0] == 1.0 ? directional(unknown, n, known[0], value) : 3;
}
#else
SAME(3)
#define NUMBERS(Name, c)                                                                                     \
    EXPORT int fmi3Get##Name(void *self, const uint32_t *reference, size_t n, c *value, size_t values)       \
    {                                                                                                        \
        for (size_t i = 0; self && i < n; i++) {                                                             \
            double own = 0;                                                                                  \
            const int status = n == values ? move(&reference[i], 1, &own, NULL) : 3;                         \
            if (status)                                                                                      \
                return status;                                                                               \
            value[i] = (c)own;                                                                               \
        }                                                                                                    \
        return 0;                                                                                            \
    }                                                                                                        \
    EXPORT int fmi3Set##Name(void *self, const uint32_t *reference, size_t n, const c *value, size_t values) \
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
                                          bool visible, bool logging, void *environment, void *log)
{
    (void)logging, (void)environment, (void)log;
    return name && resources && !visible ? begin(token) : NULL;
}

EXPORT int fmi3EnterInitializationMode(void *self, bool tolerant, double tolerance, double start, bool stops,
                                       double stop)
{
    return self && !tolerant && tolerance <= 0.0 && !stops && stop <= 0.0 && start <= 0.0 ? 0 : 3;
}

EXPORT int fmi3GetNumberOfContinuousStates(void *self, size_t *n)
{
    *n = 3;
    return self ? 0 : 3;
}

EXPORT int fmi3GetNumberOfEventIndicators(void *self, size_t *n)
{
    *n = 0;
    return self ? 0 : 3;
}

EXPORT int fmi3GetContinuousStateDerivatives(void *self, double *dx, size_t n)
{
    return self ? derivatives(dx, n) : 3;
}

EXPORT int fmi3UpdateDiscreteStates(void *self, bool *again, bool *ends, bool *nominals, bool *jumped,
                                    bool *comes, double *at)
{
    *again = *ends = *nominals = *jumped = false;
    *comes = v[TRICK] == NAMES_A_TIME;
    *at = 1e6;
    return self ? 0 : 3;
}

EXPORT int fmi3CompletedIntegratorStep(void *self, bool final, bool *event, bool *ends)
{
    *event = *ends = false;
    return self && final ? 0 : 3;
}

EXPORT int fmi3GetDirectionalDerivative(void *self, const uint32_t *unknown, size_t n, const uint32_t *known,
                                        size_t n_known, const double *seed, size_t n_seed, double *value,
                                        size_t n_values)
{
    return self && n_known == 1 && n_seed == 1 && n == n_values && seed[0] == 1.0
               ? directional(unknown, n, known[0], value)
               : 3;
}
#endif

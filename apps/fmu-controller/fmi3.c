/* SPDX-License-Identifier: BSD-3-Clause */
/* The functions of FMI 3.0 for co-simulation. */
#include <stdint.h>
#include <stdio.h>
#include <string.h>

#include "instance.h"

typedef void log_fn(void *environment, int status, const char *category, const char *message);

#define FMI3(name, ...)                                                                                      \
    FMI_EXPORT int fmi3##name(__VA_ARGS__);                                                                  \
    int fmi3##name(__VA_ARGS__)

static void say_fmi3(const struct instance_log *log, enum instance_status status, const char *text)
{
    log_fn *function;
    memcpy(&function, &log->function, sizeof function);
    if (function)
        function(log->environment, (int)status,
                 status == INSTANCE_OK        ? "logAll"
                 : status == INSTANCE_WARNING ? "logStatusWarning"
                                              : "logStatusError",
                 text);
}

FMI_EXPORT const char *fmi3GetVersion(void);
const char *fmi3GetVersion(void)
{
    return "3.0";
}

FMI_EXPORT void *fmi3InstantiateCoSimulation(const char *name, const char *token, const char *resources,
                                             bool visible, bool logging, bool events, bool early,
                                             const unsigned *intermediate, size_t n_intermediate,
                                             void *environment, log_fn *log, void *update);
void *fmi3InstantiateCoSimulation(const char *name, const char *token, const char *resources, bool visible,
                                  bool logging, bool events, bool early, const unsigned *intermediate,
                                  size_t n_intermediate, void *environment, log_fn *log, void *update)
{
    struct instance_log to = {.say = say_fmi3, .environment = environment, .name = name, .all = logging};
    char folder[480] = "";

    (void)visible;
    (void)early;
    (void)intermediate;
    (void)n_intermediate;
    (void)update;
    memcpy(&to.function, &log, sizeof to.function);
    if (events) {
        say_fmi3(&to, INSTANCE_ERROR, "it has no event mode, as its description says");
        return NULL;
    }
    const size_t length = resources ? strlen(resources) : 0;
    snprintf(folder, sizeof folder, "%.*s",
             (int)(length > 1 && resources[length - 1] == '/' ? length - 1 : length),
             resources ? resources : "");
    return instance_make(&to, token, length > 0 ? folder : NULL);
}

/* Of other kinds there is none. */
#define FMI3_NO_KIND(name)                                                                                   \
    FMI_EXPORT void *fmi3##name(void);                                                                       \
    void *fmi3##name(void)                                                                                   \
    {                                                                                                        \
        return NULL;                                                                                         \
    }
FMI3_NO_KIND(InstantiateModelExchange)
FMI3_NO_KIND(InstantiateScheduledExecution)

FMI_EXPORT void fmi3FreeInstance(void *c);
void fmi3FreeInstance(void *c)
{
    instance_free(c);
}

FMI3(SetDebugLogging, void *c, bool on, size_t n, const char *const *category)
{
    (void)n;
    (void)category;
    instance_log_all(c, on);
    return INSTANCE_OK;
}

FMI3(EnterInitializationMode, void *c, bool tolerant, double tolerance, double start, bool stops, double stop)
{
    (void)tolerant;
    (void)tolerance;
    (void)stops;
    (void)stop;
    const int status = instance_turn(c, INSTANCE_MADE, INSTANCE_INITIALISING, "fmi3EnterInitializationMode");
    return status == INSTANCE_OK ? instance_start(c, start) : status;
}

FMI3(ExitInitializationMode, void *c)
{
    return instance_turn(c, INSTANCE_INITIALISING, INSTANCE_STEPS, "fmi3ExitInitializationMode");
}

FMI3(Terminate, void *c)
{
    return instance_terminate(c, "fmi3Terminate");
}

FMI3(Reset, void *c)
{
    return instance_reset(c);
}

/* All variables are scalars: as many values as references. */
static int refuse_count(void *c, const char *function)
{
    return instance_refuse(c, function, "there must be as many values as references");
}

FMI3(GetFloat64, void *c, const unsigned *reference, size_t n, double *value, size_t n_values)
{
    return n == n_values ? instance_get(c, false, reference, n, value) : refuse_count(c, "fmi3GetFloat64");
}

FMI3(SetFloat64, void *c, const unsigned *reference, size_t n, const double *value, size_t n_values)
{
    return n == n_values ? instance_set(c, false, reference, n, value) : refuse_count(c, "fmi3SetFloat64");
}

FMI3(GetInt32, void *c, const unsigned *reference, size_t n, int32_t *value, size_t n_values)
{
    int status = n == n_values ? INSTANCE_OK : refuse_count(c, "fmi3GetInt32");
    for (size_t k = 0; k < n && status == INSTANCE_OK; k++) {
        double mode = 0;
        status = instance_get(c, true, &reference[k], 1, &mode);
        value[k] = (int32_t)mode;
    }
    return status;
}

FMI3(SetInt32, void *c, const unsigned *reference, size_t n, const int32_t *value, size_t n_values)
{
    int status = n == n_values ? INSTANCE_OK : refuse_count(c, "fmi3SetInt32");
    for (size_t k = 0; k < n && status == INSTANCE_OK; k++)
        status = instance_set(c, true, &reference[k], 1, &(double){value[k]});
    return status;
}

FMI3(DoStep, void *c, double time, double step, bool no_way_back, bool *event, bool *ends, bool *early,
     double *last)
{
    const int status = instance_step(c, time, step);

    (void)no_way_back;
    *event = *ends = *early = false;
    *last = instance_time(c);
    return status;
}

/* Of no variables nothing is refused. */
#define FMI3_NO_VARIABLES(name)                                                                              \
    FMI3(name, void *c, const unsigned *reference, size_t n)                                                 \
    {                                                                                                        \
        (void)reference;                                                                                     \
        return n == 0 ? INSTANCE_OK : instance_refuse(c, "fmi3" #name, "there is no variable of this type"); \
    }
FMI3_NO_VARIABLES(GetFloat32)
FMI3_NO_VARIABLES(SetFloat32)
FMI3_NO_VARIABLES(GetInt8)
FMI3_NO_VARIABLES(SetInt8)
FMI3_NO_VARIABLES(GetUInt8)
FMI3_NO_VARIABLES(SetUInt8)
FMI3_NO_VARIABLES(GetInt16)
FMI3_NO_VARIABLES(SetInt16)
FMI3_NO_VARIABLES(GetUInt16)
FMI3_NO_VARIABLES(SetUInt16)
FMI3_NO_VARIABLES(GetUInt32)
FMI3_NO_VARIABLES(SetUInt32)
FMI3_NO_VARIABLES(GetInt64)
FMI3_NO_VARIABLES(SetInt64)
FMI3_NO_VARIABLES(GetUInt64)
FMI3_NO_VARIABLES(SetUInt64)
FMI3_NO_VARIABLES(GetBoolean)
FMI3_NO_VARIABLES(SetBoolean)
FMI3_NO_VARIABLES(GetString)
FMI3_NO_VARIABLES(SetString)
FMI3_NO_VARIABLES(GetBinary)
FMI3_NO_VARIABLES(SetBinary)
FMI3_NO_VARIABLES(GetClock)
FMI3_NO_VARIABLES(SetClock)

/* The importer gives more arguments, at which nothing looks. */
#define FMI3_NOT_OFFERED(name)                                                                               \
    FMI3(name, void *c)                                                                                      \
    {                                                                                                        \
        return instance_refuse(c, "fmi3" #name, "the description does not offer it");                        \
    }
FMI3_NOT_OFFERED(EnterEventMode)
FMI3_NOT_OFFERED(GetNumberOfVariableDependencies)
FMI3_NOT_OFFERED(GetVariableDependencies)
FMI3_NOT_OFFERED(GetFMUState)
FMI3_NOT_OFFERED(SetFMUState)
FMI3_NOT_OFFERED(FreeFMUState)
FMI3_NOT_OFFERED(SerializedFMUStateSize)
FMI3_NOT_OFFERED(SerializeFMUState)
FMI3_NOT_OFFERED(DeserializeFMUState)
FMI3_NOT_OFFERED(GetDirectionalDerivative)
FMI3_NOT_OFFERED(GetAdjointDerivative)
FMI3_NOT_OFFERED(EnterConfigurationMode)
FMI3_NOT_OFFERED(ExitConfigurationMode)
FMI3_NOT_OFFERED(GetIntervalDecimal)
FMI3_NOT_OFFERED(GetIntervalFraction)
FMI3_NOT_OFFERED(GetShiftDecimal)
FMI3_NOT_OFFERED(GetShiftFraction)
FMI3_NOT_OFFERED(SetIntervalDecimal)
FMI3_NOT_OFFERED(SetIntervalFraction)
FMI3_NOT_OFFERED(SetShiftDecimal)
FMI3_NOT_OFFERED(SetShiftFraction)
FMI3_NOT_OFFERED(EvaluateDiscreteStates)
FMI3_NOT_OFFERED(UpdateDiscreteStates)
FMI3_NOT_OFFERED(EnterContinuousTimeMode)
FMI3_NOT_OFFERED(CompletedIntegratorStep)
FMI3_NOT_OFFERED(SetTime)
FMI3_NOT_OFFERED(SetContinuousStates)
FMI3_NOT_OFFERED(GetContinuousStateDerivatives)
FMI3_NOT_OFFERED(GetEventIndicators)
FMI3_NOT_OFFERED(GetContinuousStates)
FMI3_NOT_OFFERED(GetNominalsOfContinuousStates)
FMI3_NOT_OFFERED(GetNumberOfEventIndicators)
FMI3_NOT_OFFERED(GetNumberOfContinuousStates)
FMI3_NOT_OFFERED(EnterStepMode)
FMI3_NOT_OFFERED(GetOutputDerivatives)
FMI3_NOT_OFFERED(ActivateModelPartition)

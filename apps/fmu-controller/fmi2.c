/* SPDX-License-Identifier: BSD-3-Clause */
/* The functions of FMI 2.0 for co-simulation. */
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "instance.h"

typedef void log_fn(void *environment, const char *name, int status, const char *category,
                    const char *message, ...);
struct fmi2_callbacks {
    log_fn *log;
    void *(*allocate)(size_t n, size_t size);
    void (*release)(void *memory);
    void (*finished)(void *environment, int status);
    void *environment;
};

#define FMI2(name, ...)                                                                                      \
    FMI_EXPORT int fmi2##name(__VA_ARGS__);                                                                  \
    int fmi2##name(__VA_ARGS__)

static void say_fmi2(const struct instance_log *log, enum instance_status status, const char *text)
{
    log_fn *function;
    memcpy(&function, &log->function, sizeof function);
    if (function)
        function(log->environment, log->name, (int)status,
                 status == INSTANCE_OK        ? "logAll"
                 : status == INSTANCE_WARNING ? "logStatusWarning"
                                              : "logStatusError",
                 "%s", text);
}

/* Of "file:///folder", or of "file:/folder", with %20 and the like. Returns false: it is no such name. */
static bool folder_of_uri(const char *uri, char *folder, size_t size)
{
    size_t n = 0;

    if (!uri || strncmp(uri, "file:", 5) != 0)
        return false;
    uri += strncmp(uri, "file://", 7) == 0 ? 7 : 5;
    if (*uri != '/')
        uri += strcspn(uri, "/"); /* the host, which is this one */
    for (; *uri && n + 1 < size; n++) {
        char hex[3] = {0};
        if (*uri == '%' && uri[1] && uri[2]) {
            memcpy(hex, uri + 1, 2);
            folder[n] = (char)strtol(hex, NULL, 16);
            uri += 3;
        } else {
            folder[n] = *uri++;
        }
    }
    while (n > 1 && folder[n - 1] == '/')
        n--;
    folder[n] = '\0';
    return n > 0 && !*uri;
}

FMI_EXPORT const char *fmi2GetTypesPlatform(void);
const char *fmi2GetTypesPlatform(void)
{
    return "default";
}

FMI_EXPORT const char *fmi2GetVersion(void);
const char *fmi2GetVersion(void)
{
    return "2.0";
}

FMI_EXPORT void *fmi2Instantiate(const char *name, int type, const char *guid, const char *resources,
                                 const struct fmi2_callbacks *callbacks, int visible, int logging);
void *fmi2Instantiate(const char *name, int type, const char *guid, const char *resources,
                      const struct fmi2_callbacks *callbacks, int visible, int logging)
{
    struct instance_log log = {.say = say_fmi2, .name = name, .all = logging};
    char folder[480];

    (void)visible;
    if (callbacks) {
        log.environment = callbacks->environment;
        memcpy(&log.function, &callbacks->log, sizeof log.function);
    }
    if (type != 1) {
        say_fmi2(&log, INSTANCE_ERROR, "it is for co-simulation alone");
        return NULL;
    }
    return instance_make(&log, guid, folder_of_uri(resources, folder, sizeof folder) ? folder : NULL);
}

FMI_EXPORT void fmi2FreeInstance(void *c);
void fmi2FreeInstance(void *c)
{
    instance_free(c);
}

FMI2(SetDebugLogging, void *c, int on, size_t n, const char *const *category)
{
    (void)n;
    (void)category;
    instance_log_all(c, on);
    return INSTANCE_OK;
}

FMI2(SetupExperiment, void *c, int tolerant, double tolerance, double start, int stops, double stop)
{
    (void)tolerant;
    (void)tolerance;
    (void)stops;
    (void)stop;
    return instance_start(c, start);
}

FMI2(EnterInitializationMode, void *c)
{
    return instance_turn(c, INSTANCE_MADE, INSTANCE_INITIALISING, "fmi2EnterInitializationMode");
}

FMI2(ExitInitializationMode, void *c)
{
    return instance_turn(c, INSTANCE_INITIALISING, INSTANCE_STEPS, "fmi2ExitInitializationMode");
}

FMI2(Terminate, void *c)
{
    return instance_terminate(c, "fmi2Terminate");
}

FMI2(Reset, void *c)
{
    return instance_reset(c);
}

FMI2(GetReal, void *c, const unsigned *reference, size_t n, double *value)
{
    return instance_get(c, false, reference, n, value);
}

FMI2(SetReal, void *c, const unsigned *reference, size_t n, const double *value)
{
    return instance_set(c, false, reference, n, value);
}

FMI2(GetInteger, void *c, const unsigned *reference, size_t n, int *value)
{
    int status = INSTANCE_OK;
    for (size_t k = 0; k < n && status == INSTANCE_OK; k++) {
        double mode = 0;
        status = instance_get(c, true, &reference[k], 1, &mode);
        value[k] = (int)mode;
    }
    return status;
}

FMI2(SetInteger, void *c, const unsigned *reference, size_t n, const int *value)
{
    int status = INSTANCE_OK;
    for (size_t k = 0; k < n && status == INSTANCE_OK; k++)
        status = instance_set(c, true, &reference[k], 1, &(double){value[k]});
    return status;
}

/* Of no variables nothing is refused. */
#define FMI2_NO_VARIABLES(name)                                                                              \
    FMI2(name, void *c, const unsigned *reference, size_t n, void *value)                                    \
    {                                                                                                        \
        (void)reference;                                                                                     \
        (void)value;                                                                                         \
        return n == 0 ? INSTANCE_OK : instance_refuse(c, "fmi2" #name, "there is no variable of this type"); \
    }
FMI2_NO_VARIABLES(GetBoolean)
FMI2_NO_VARIABLES(SetBoolean)
FMI2_NO_VARIABLES(GetString)
FMI2_NO_VARIABLES(SetString)

FMI2(DoStep, void *c, double time, double step, int no_way_back)
{
    (void)no_way_back;
    return instance_step(c, time, step);
}

/* The importer gives more arguments, at which nothing looks. */
#define FMI2_NOT_OFFERED(name)                                                                               \
    FMI2(name, void *c)                                                                                      \
    {                                                                                                        \
        return instance_refuse(c, "fmi2" #name, "the description does not offer it");                        \
    }
FMI2_NOT_OFFERED(GetFMUstate)
FMI2_NOT_OFFERED(SetFMUstate)
FMI2_NOT_OFFERED(FreeFMUstate)
FMI2_NOT_OFFERED(SerializedFMUstateSize)
FMI2_NOT_OFFERED(SerializeFMUstate)
FMI2_NOT_OFFERED(DeSerializeFMUstate)
FMI2_NOT_OFFERED(GetDirectionalDerivative)
FMI2_NOT_OFFERED(SetRealInputDerivatives)
FMI2_NOT_OFFERED(GetRealOutputDerivatives)
FMI2_NOT_OFFERED(CancelStep)
FMI2_NOT_OFFERED(GetStatus)
FMI2_NOT_OFFERED(GetRealStatus)
FMI2_NOT_OFFERED(GetIntegerStatus)
FMI2_NOT_OFFERED(GetBooleanStatus)
FMI2_NOT_OFFERED(GetStringStatus)

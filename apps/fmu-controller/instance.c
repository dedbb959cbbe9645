/* SPDX-License-Identifier: BSD-3-Clause */
#include "instance.h"

#include <math.h>
#include <stdarg.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "experiment/experiment.h"

#define TEXT_MAX  (16 << 20)
#define TOGETHER  1e-6 /* of a period: two times no further apart are one */
#define TOKEN_MAX 128

struct instance {
    struct instance_log log;
    char name[128];
    char *text; /* of the experiment file */
    char file[EXPERIMENT_PATH];
    char controller[APC_TAG_LEN];
    enum instance_state state;
    struct standalone *law;
    double period, start;
    uint64_t ticks; /* since start */
};

static void say(const struct instance_log *log, enum instance_status status, const char *format, ...)
    APC_PRINTF(3, 4);

static void say(const struct instance_log *log, enum instance_status status, const char *format, ...)
{
    char text[600];
    va_list arguments;

    va_start(arguments, format);
    vsnprintf(text, sizeof text, format, arguments);
    va_end(arguments);
    log->say(log, status, text);
}

/* ---- Its resources ---------------------------------------------------------------------------- */

/* To be freed; NULL: why was said. */
static char *read_resource(const struct instance_log *log, const char *folder, const char *name)
{
    char path[EXPERIMENT_PATH];
    FILE *const in =
        (size_t)snprintf(path, sizeof path, "%s/%s", folder, name) < sizeof path ? fopen(path, "re") : NULL;
    const long length = in && fseek(in, 0, SEEK_END) == 0 ? ftell(in) : -1;
    char *text = length >= 0 && length <= TEXT_MAX ? calloc((size_t)length + 1, 1) : NULL;

    if (text && (fseek(in, 0, SEEK_SET) < 0 || fread(text, 1, (size_t)length, in) != (size_t)length)) {
        free(text);
        text = NULL;
    }
    if (in)
        fclose(in);
    if (!text)
        say(log, INSTANCE_ERROR, "resources/%s cannot be read in %.300s: unpack the whole FMU", name, folder);
    return text;
}

/* Its first line is the token, the second one the controller's name. */
static bool read_whose(struct instance *i, const char *token, const char *folder)
{
    char *const text = read_resource(&i->log, folder, "controller"), *rest = NULL;
    const char *const expected = text ? strtok_r(text, "\n", &rest) : NULL, *const name =
                                                                                expected
                                                                                    ? strtok_r(NULL, "\n",
                                                                                               &rest)
                                                                                    : NULL;
    const bool known = name && token && strcmp(token, expected) == 0;

    if (known)
        snprintf(i->controller, sizeof i->controller, "%s", name);
    else if (text)
        say(&i->log, INSTANCE_ERROR,
            "\"%.100s\" is not the token of this FMU, \"%.100s\": description and resources are not of one "
            "export",
            token ? token : "", expected ? expected : "");
    free(text);
    return known;
}

/* ---- Life ------------------------------------------------------------------------------------- */

static int make_law(struct instance *i)
{
    const struct experiment_source from = {.file = i->file, .text = i->text};
    struct apc_error why;

    standalone_destroy(i->law);
    if (standalone_create(&i->law, &from, i->controller, &why) < 0) {
        say(&i->log, INSTANCE_ERROR, "%s", why.text);
        i->state = INSTANCE_ENDED;
        return INSTANCE_ERROR;
    }
    i->period = apc_ns_to_s(standalone_controller(i->law)->rhythm.period);
    i->state = INSTANCE_MADE;
    i->start = 0;
    i->ticks = 0;
    return INSTANCE_OK;
}

struct instance *instance_make(const struct instance_log *log, const char *token, const char *resources)
{
    struct instance *const i = calloc(1, sizeof *i);

    if (!i) {
        say(log, INSTANCE_ERROR, "out of memory");
        return NULL;
    }
    i->log = *log;
    snprintf(i->name, sizeof i->name, "%s", log->name ? log->name : "");
    i->log.name = i->name;
    snprintf(i->file, sizeof i->file, "%.480s/experiment.conf", resources ? resources : "");
    if (!resources)
        say(log, INSTANCE_ERROR, "it needs its resources, and was told of none");
    else if (read_whose(i, token, resources))
        i->text = read_resource(log, resources, "experiment.conf");
    if (!i->text || make_law(i) != INSTANCE_OK) {
        instance_free(i);
        return NULL;
    }
    return i;
}

void instance_free(struct instance *i)
{
    if (!i)
        return;
    standalone_destroy(i->law);
    free(i->text);
    free(i);
}

int instance_reset(struct instance *i)
{
    return make_law(i);
}

void instance_log_all(struct instance *i, bool all)
{
    i->log.all = all;
}

int instance_refuse(struct instance *i, const char *function, const char *why)
{
    say(&i->log, INSTANCE_ERROR, "%s: %s", function, why);
    return INSTANCE_ERROR;
}

int instance_turn(struct instance *i, enum instance_state from, enum instance_state to, const char *function)
{
    if (i->state != from)
        return instance_refuse(i, function, "not in this order: instantiate, initialise, step, terminate");
    i->state = to;
    return INSTANCE_OK;
}

int instance_start(struct instance *i, double time)
{
    if (!isfinite(time))
        return instance_refuse(i, "start time", "it is no number");
    i->start = time;
    return INSTANCE_OK;
}

int instance_terminate(struct instance *i, const char *function)
{
    return instance_turn(i, INSTANCE_STEPS, INSTANCE_ENDED, function);
}

/* ---- Values ----------------------------------------------------------------------------------- */

/* NULL: refused. References count from 1. */
static const struct standalone_variable *find_by_reference(struct instance *i, bool modes, unsigned reference)
{
    size_t n = 0;
    const struct standalone_variable *const all = i->law ? standalone_variables(i->law, &n) : NULL;

    if (reference < 1 || reference > n || (all[reference - 1].kind == STANDALONE_MODE) != modes) {
        say(&i->log, INSTANCE_ERROR, "value reference %u is of no %s variable of this FMU", reference,
            modes ? "Int32 (Integer)" : "Float64 (Real)");
        return NULL;
    }
    return &all[reference - 1];
}

int instance_get(struct instance *i, bool modes, const unsigned *reference, size_t n, double *value)
{
    for (size_t k = 0; k < n; k++) {
        /* the time of FMI 3 has a reference as well */
        if (reference[k] == 0 && !modes) {
            value[k] = instance_time(i);
            continue;
        }
        const struct standalone_variable *const v = find_by_reference(i, modes, reference[k]);
        if (!v)
            return INSTANCE_ERROR;
        value[k] = v->value;
    }
    return INSTANCE_OK;
}

int instance_set(struct instance *i, bool modes, const unsigned *reference, size_t n, const double *value)
{
    for (size_t k = 0; k < n; k++) {
        const struct standalone_variable *const v = find_by_reference(i, modes, reference[k]);
        if (!v)
            return INSTANCE_ERROR;
        if (v->kind == STANDALONE_OUTPUT) {
            say(&i->log, INSTANCE_ERROR, "%s is an output and cannot be set", v->tag.name);
            return INSTANCE_ERROR;
        }
    }
    for (size_t k = 0; k < n; k++)
        standalone_set(i->law, reference[k] - 1, value[k]);
    return INSTANCE_OK;
}

/* ---- Steps ------------------------------------------------------------------------------------ */

double instance_time(const struct instance *i)
{
    return i->start + (double)i->ticks * i->period;
}

static void tell_fmu_notice(void *ctx, const struct apc_notice *notice)
{
    const struct instance *const i = ctx;
    struct apc_event event = {0};

    notice_event(notice, &event);
    if (i->log.all || event.severity != APC_EVENT_INFO)
        say(&i->log, event.severity == APC_EVENT_INFO ? INSTANCE_OK : INSTANCE_WARNING, "at %g s: %s",
            instance_time(i), event.text);
}

int instance_step(struct instance *i, double time, double step)
{
    const double expected = instance_time(i), periods = round(step / i->period);

    if (i->state != INSTANCE_STEPS)
        return instance_refuse(i, "doStep", "it is not initialised, or was terminated");
    if (!(fabs(time - expected) <= TOGETHER * i->period)) {
        say(&i->log, INSTANCE_ERROR, "doStep: from %.15g s, but it stands at %.15g s", time, expected);
        return INSTANCE_ERROR;
    }
    if (!(periods >= 1) || !(periods < 1e9) || !(fabs(step - periods * i->period) <= TOGETHER * i->period)) {
        say(&i->log, INSTANCE_ERROR,
            "doStep: a step of %.15g s: must be the controller's period, %.15g s, or a multiple of it", step,
            i->period);
        return INSTANCE_ERROR;
    }
    for (uint64_t left = (uint64_t)periods; left > 0; left--) {
        standalone_tick(i->law, tell_fmu_notice, i);
        i->ticks++;
    }
    return INSTANCE_OK;
}

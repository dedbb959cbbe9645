/* SPDX-License-Identifier: BSD-3-Clause */
/*
 * A controller as an FMU for co-simulation: the library that `apc export fmu` puts into it, for both versions of the
 * standard. The experiment file is in the FMU's resources. fmi2.c and fmi3.c have the standard's functions, this what
 * both are made of.
 */
#ifndef APC_FMU_CONTROLLER_INSTANCE_H
#define APC_FMU_CONTROLLER_INSTANCE_H

#include <stdbool.h>
#include <stddef.h>

#define FMI_EXPORT __attribute__((visibility("default")))

/* As both versions number them. */
enum instance_status { INSTANCE_OK, INSTANCE_WARNING, INSTANCE_DISCARD, INSTANCE_ERROR, INSTANCE_FATAL };

enum instance_state { INSTANCE_MADE, INSTANCE_INITIALISING, INSTANCE_STEPS, INSTANCE_ENDED };

/* Where sentences go. */
struct instance_log {
    void (*say)(const struct instance_log *log, enum instance_status status, const char *text);
    void *environment;
    void *function; /* of the importer */
    const char *name;
    bool all; /* events of the controller too */
};

struct instance;

/* NULL: why was said. @p resources is the folder. */
struct instance *instance_make(const struct instance_log *log, const char *token, const char *resources);
void instance_free(struct instance *instance);
int instance_reset(struct instance *instance);
void instance_log_all(struct instance *instance, bool all);
/* Say why @p function cannot be, and return an error. */
int instance_refuse(struct instance *instance, const char *function, const char *why);
/* From one state to the next; @p function is what asks for it. */
int instance_turn(struct instance *instance, enum instance_state from, enum instance_state to,
                  const char *function);
int instance_start(struct instance *instance, double time);
int instance_terminate(struct instance *instance, const char *function);
/* Values of references [n], modes or all others. */
int instance_get(struct instance *instance, bool modes, const unsigned *reference, size_t n, double *value);
int instance_set(struct instance *instance, bool modes, const unsigned *reference, size_t n,
                 const double *value);
int instance_step(struct instance *instance, double time, double step);
double instance_time(const struct instance *instance);

#endif

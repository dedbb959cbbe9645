/* SPDX-License-Identifier: BSD-3-Clause */
/* Within experiment.c: what the file says of the plant and its sensors. */
#ifndef APC_EXPERIMENT_PLANT_H
#define APC_EXPERIMENT_PLANT_H

#include "experiment.h"
#include "settings.h"

/* How the model is solved and what disturbs it; e->plant has its model, parameters and x0. @own: the model is
 * not the file's, so what the file says of states and disturbances by name is left out. */
void experiment_read_dynamics(struct settings *s, const config_setting_t *group, struct experiment *e,
                              bool own);
/* noise, quantum and faults of the measurements. */
void experiment_read_sensors(struct settings *s, const config_setting_t *list, struct experiment *e);

#endif

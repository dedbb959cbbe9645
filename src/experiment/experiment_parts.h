/* SPDX-License-Identifier: BSD-3-Clause */
/* What experiment.c reads an experiment file by, a part in a file each. */
#ifndef APC_EXPERIMENT_PARTS_H
#define APC_EXPERIMENT_PARTS_H

#include "experiment.h"
#include "files/settings.h"

/* "network" and "clock" of the file's root. */
void models_read(struct settings *s, const config_setting_t *root, struct models *m);
/* "execution" and "jitter" in the group of task @name. */
void models_read_task(struct settings *s, const config_setting_t *group, const char *name,
                      struct task_model *task, struct recordings *recordings);
void models_free(struct models *m);

/* How the model is solved and what disturbs it; e->plant has its model, parameters and x0. @own: the model is
 * not the file's, so what the file says of states and disturbances by name is left out. */
/* Of a plant that is an FMU: which of its variables its signals are. */
void experiment_choose_variables(struct settings *s, const config_setting_t *group, struct experiment *e);
void experiment_read_dynamics(struct settings *s, const config_setting_t *group, struct experiment *e,
                              bool own);
/* Of the plant, as it is read, and of what controls it. */
void experiment_read_plant_faults(struct settings *s, const config_setting_t *root, struct experiment *e);
/* measurements, signals, setpoints, outputs of the file's root. */
void experiment_read_signals(struct settings *s, const config_setting_t *root, struct experiment *e);
/* noise, quantum and faults of the measurements. */
void experiment_read_sensors(struct settings *s, const config_setting_t *list, struct experiment *e);

/* faults of the outputs. */
void experiment_read_actuators(struct settings *s, const config_setting_t *list, struct experiment *e);

/* `modbus` of the client, where its link is one; after the signals. */
void experiment_read_modbus(struct settings *s, const config_setting_t *client, struct experiment *e);

/* Does the law want the plant's linear model, and so the model itself? */
bool experiment_wants_model(const config_setting_t *controller);
/* Read groups `settings`, `operating_point` and `limits` of the controller, linearise, and let the law
 * configure itself and check its tuning, so that what it does not like is said with file and line. After law
 * and model. Where another law or model than the file's runs, the file's settings, or its operating point, do
 * not apply. */
void experiment_read_law(struct settings *s, const config_setting_t *group, const struct experiment *e,
                         struct controller *c);
/* c->believed: the plant's nominal parameters, but for those of group `parameters` of an operating point. */
void experiment_read_believed(struct settings *s, const config_setting_t *group, const struct experiment *e,
                              struct controller *c);
void experiment_free_law(struct controller *c); /* and its tuning and plug-in */
/* A path in the file means: from where the file is. */
void experiment_resolve(const struct settings *s, const char *name, char *path, size_t size);
/* The model in the controller's group, or in the file that it names. */
void model_file_read(struct settings *s, const config_setting_t *group, const struct experiment *e,
                     struct controller *c);
/* Are all measurements and outputs of the plant its own, in their order? With loops below, an output may be a
 * setpoint of theirs. */
bool controllers_has_all(const struct experiment *e, const struct controller *c, bool lower);

/* Which controllers there are, with the signals of each; after the signals. Returns the group of the first
 * one; NULL after a failure. */
const config_setting_t *experiment_read_controllers(struct settings *s, const config_setting_t *root,
                                                    struct experiment *e);
/* What its law is told of the signals; its rates become those of the outputs, where these are lower. */
void experiment_view(struct settings *s, const struct experiment *e, struct controller *c);
void experiment_free_controllers(struct experiment *e);
/* The ids of controllers, loops and, with @p laws, of their tuning; then every setpoint that a controller
 * moves has a loop that it is of, and a value to begin with. */
void experiment_number(struct settings *s, const config_setting_t *list, struct experiment *e, bool laws);
/* The setpoints that the scheduler moves: what it names or, without, all that no controller does. Returns how
 * many, to be freed. */
size_t experiment_read_columns(struct settings *s, const config_setting_t *group, const struct experiment *e,
                               struct wire **columns);

/* What stands in a controller's group under a former name of its law gets the present one. */
void experiment_rename(struct settings *s, const config_setting_t *group, struct controller *c);
/* Is @p name the former name of a setting or parameter of its law? */
bool experiment_is_former(const struct controller *c, const char *name);

/* Does the path begin with a setting of a controller, and no parameter of its law? */
bool experiment_knows_of_controller(const char *name);

/* As experiment_change(), of the model of a controller, by its name or "[0]", which takes the place of an
 * operating point. Where there is one controller in short form it is that one's. */
int experiment_change_model(const char *text, const char *controller, const char *value, char **changed,
                            struct apc_error *why);

/* `alarms` of all signals and controllers, and of the file's root; when all else is known. */
void experiment_read_alarms(struct settings *s, const config_setting_t *root, struct experiment *e);

/* What an operator is to do, of the file's root; after all else. */
void experiment_read_actions(struct settings *s, const config_setting_t *root, struct experiment *e);

/* experiment_tls.c: of the plant's group, and of the client's. */
bool experiment_is_tls(const char *address);
void experiment_read_identity(struct settings *s, const config_setting_t *group, const char *address,
                              char path[EXPERIMENT_PATH]);
void experiment_read_clients(struct settings *s, const config_setting_t *group, struct experiment *e);

#endif

/* SPDX-License-Identifier: BSD-3-Clause */
/* The part of an experiment file that configures the law: its settings, and the point the plant is linearised
 * at. */
#ifndef APC_EXPERIMENT_LAW_H
#define APC_EXPERIMENT_LAW_H

#include "experiment.h"
#include "settings.h"

/* Does the law want the plant's linear model, and so the model itself? */
bool experiment_wants_model(const config_setting_t *root);
/* Read groups `settings`, `operating_point` and `limits` of the controller, linearise, and let the law
 * configure itself and check its tuning, so that what it does not like is said with file and line. After law
 * and model. Where another law or model than the file's runs, the file's settings, or its operating point, do
 * not apply. */
void experiment_read_law(struct settings *s, const config_setting_t *root, struct experiment *e);
void experiment_free_law(struct experiment *e);

#endif

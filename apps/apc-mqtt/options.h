/* SPDX-License-Identifier: BSD-3-Clause */
/* The options of apc-mqtt, which are the same where it was built without what it needs. */
#ifndef APC_MQTT_OPTIONS_H
#define APC_MQTT_OPTIONS_H

#include "common/option.h"

#define MQTT_ALLOWED 64

#define MQTT_DOC                                                                                             \
    "Publish new values, modes, alarms and events of the live store --store at an MQTT broker. While the "   \
    "broker is offline, a file keeps the messages. Commands from the broker are taken for the signals of "   \
    "--allow, from users who may operate, and answered with the outcome."

struct mqtt_options {
    const char *broker, *ca, *identity, *login, *password_file, *queue, *topic, *users;
    const char *allow[MQTT_ALLOWED];
    size_t n_allow;
};

extern const struct option_spec mqtt_options[]; /* they go into a struct mqtt_options */

#endif

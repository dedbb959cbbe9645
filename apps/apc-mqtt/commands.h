/* SPDX-License-Identifier: BSD-3-Clause */
/*
 * What the broker's people want written: PREFIX/command/USER/SIGNAL. MQTT says of a message not who sent it;
 * that USER is who he says is the broker's to see to (an access list with %u). Here it is looked at whether
 * he may operate, whether the signal is one of --allow, and how old it is; then it goes the way of what
 * people ask of a history (operate/requests.h), and what became of it to PREFIX/outcome/USER/SIGNAL.
 */
#ifndef APC_MQTT_COMMANDS_H
#define APC_MQTT_COMMANDS_H

#include "broker.h"
#include "daemon/daemon.h"

struct commands;

/* Answers go out by @broker, which may come later. @users is a file as of apps/users. */
int commands_create(struct commands **commands, struct daemon *d, const struct mqtt_options *options,
                    const char *users, struct apc_error *why);
void commands_answer_by(struct commands *c, struct broker *broker);
/* One has come. Of any thread. */
void commands_take(void *commands, const char *user, const char *signal, const void *payload, size_t n,
                   bool retained);
/* A thread that brings them to the live store. */
int commands_start(struct commands *c, struct apc_error *why);
/* Tell, in events, of what was refused. [tick] */
void commands_tell(struct commands *c);
/* Returns false where the thread could not be ended in time: then c stays. */
bool commands_destroy(struct commands *c);

#endif

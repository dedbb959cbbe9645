/* SPDX-License-Identifier: BSD-3-Clause */
#include "options.h"

static void take_allowed(void *to, char *arg, const struct argp_state *state)
{
    struct mqtt_options *o = to;
    if (o->n_allow == MQTT_ALLOWED)
        argp_error(state, "--allow can be given %d times", MQTT_ALLOWED);
    o->allow[o->n_allow++] = arg;
}

#define AT(member) .to = offsetof(struct mqtt_options, member)
const struct option_spec mqtt_options[] = {
    {"broker", 0, "URI",
     "mqtts://HOST[:8883], over TLS 1.3; mqtt://HOST[:1883], without encryption, to this host only "
     "[APC_BROKER]",
     OPTION_TEXT, AT(broker)},
    {"ca", 0, "FILE",
     "Certificate authorities that the broker's certificate may come from; default: those of this computer",
     OPTION_TEXT, AT(ca)},
    {"identity", 0, "FILE", "Certificate and key, in one file, for a broker that asks for a certificate",
     OPTION_TEXT, AT(identity)},
    {"login", 0, "NAME", "User name for a broker that asks for one", OPTION_TEXT, AT(login)},
    {"password-file", 0, "FILE", "File whose first line is the password of --login", OPTION_TEXT,
     AT(password_file)},
    {"queue", 0, "URI",
     "sqlite:FILE, which keeps the messages until the broker acknowledges them; made if missing [APC_QUEUE]",
     OPTION_TEXT, AT(queue)},
    {"topic", 0, "PREFIX", "Prefix of all topics; default apc/ and the experiment's name", OPTION_TEXT,
     AT(topic)},
    {"users", 0, "FILE",
     "Users who may command, made by `apc user add` [APC_USERS]; default ~/.config/apc/users", OPTION_TEXT,
     AT(users)},
    {"allow", 0, "NAME",
     "A setpoint, an output, or LOOP.mode that may be commanded from the broker; may be repeated. Default: "
     "none",
     OPTION_OWN, .take = take_allowed},
    {0},
};

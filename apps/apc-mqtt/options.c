/* SPDX-License-Identifier: BSD-3-Clause */
#include "options.h"

enum {
    OPT_BROKER = 0x700,
    OPT_CA,
    OPT_IDENTITY,
    OPT_LOGIN,
    OPT_PASSWORD,
    OPT_QUEUE,
    OPT_TOPIC,
    OPT_USERS,
    OPT_ALLOW
};

static const struct argp_option option_list[] = {
    {"broker", OPT_BROKER, "URI", 0,
     "mqtts://HOST[:8883], over TLS 1.3; mqtt://HOST[:1883], without encryption, to this very host only "
     "[APC_BROKER]",
     0},
    {"ca", OPT_CA, "FILE", 0, "Authorities that vouch for the broker; default: those of this computer", 0},
    {"identity", OPT_IDENTITY, "FILE", 0,
     "Who we are to a broker that asks for a certificate: it and its key in one file", 0},
    {"login", OPT_LOGIN, "NAME", 0, "Who we are to a broker that asks for a name", 0},
    {"password-file", OPT_PASSWORD, "FILE", 0, "Its first line is the password of --login", 0},
    {"queue", OPT_QUEUE, "URI", 0,
     "sqlite:FILE, where what the broker has not acknowledged is kept; it is made [APC_QUEUE]", 0},
    {"topic", OPT_TOPIC, "PREFIX", 0, "What all topics begin with; default apc/ and the experiment's name",
     0},
    {"users", OPT_USERS, "FILE", 0,
     "Who may command, made by `apc user add` [APC_USERS]; default ~/.config/apc/users", 0},
    {"allow", OPT_ALLOW, "NAME", 0,
     "A setpoint, an output, or LOOP.mode that may be commanded from the broker; as often as there are "
     "some. Without any, nothing may",
     0},
    {0},
};

static error_t parse_mqtt_options(int key, char *arg, struct argp_state *state)
{
    struct mqtt_options *o = state->input;
    switch (key) {
    case OPT_BROKER:
        o->broker = arg;
        break;
    case OPT_CA:
        o->ca = arg;
        break;
    case OPT_IDENTITY:
        o->identity = arg;
        break;
    case OPT_LOGIN:
        o->login = arg;
        break;
    case OPT_PASSWORD:
        o->password_file = arg;
        break;
    case OPT_QUEUE:
        o->queue = arg;
        break;
    case OPT_TOPIC:
        o->topic = arg;
        break;
    case OPT_USERS:
        o->users = arg;
        break;
    case OPT_ALLOW:
        if (o->n_allow == MQTT_ALLOWED)
            argp_error(state, "--allow can be given %d times", MQTT_ALLOWED);
        o->allow[o->n_allow++] = arg;
        break;
    default:
        return ARGP_ERR_UNKNOWN;
    }
    return 0;
}

const struct argp mqtt_argp = {option_list, parse_mqtt_options, NULL, NULL, NULL, NULL, NULL};

/* SPDX-License-Identifier: BSD-3-Clause */
/* apc-mqtt where it was built without libmosquitto: it says so. */
#include "../options.h"

#include <apcbase.h>

#include <stdio.h>
#include <stdlib.h>

static void print_mqtt_version(FILE *stream, struct argp_state *state)
{
    fprintf(stream, "%s (libapc) %s\n", state->name, apc_version());
}

int main(int argc, char **argv)
{
    struct mqtt_options options = {0};
    struct argp argp = mqtt_argp;

    argp.doc = MQTT_DOC;
    argp_program_version_hook = print_mqtt_version;
    argp_err_exit_status = 2;
    (void)argp_parse(&argp, argc, argv, 0, NULL, &options);
    fputs("apc-mqtt: it was built without libmosquitto, and can do nothing: install libmosquitto-dev and "
          "build it "
          "again, without -DAPC_MQTT=OFF\n",
          stderr);
    return EXIT_FAILURE;
}

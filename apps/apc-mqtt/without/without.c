/* SPDX-License-Identifier: BSD-3-Clause */
/* apc-mqtt where it was built without libmosquitto: it says so. */
#include "../options.h"

#include <apcbase.h>

#include <stdio.h>
#include <stdlib.h>

int main(int argc, char **argv)
{
    struct mqtt_options options = {0};
    struct option_input in[2] = {{.option = mqtt_options, .own = &options}, {0}};

    option_program(in, MQTT_DOC, argc, argv);
    fputs("apc-mqtt: it was built without libmosquitto, and can do nothing: install libmosquitto-dev and "
          "build it "
          "again, without -DAPC_MQTT=OFF\n",
          stderr);
    return EXIT_FAILURE;
}

/* SPDX-License-Identifier: BSD-3-Clause */
#include "speed.h"

#include <math.h>
#include <stdio.h>
#include <string.h>

#include "simulation/simulation.h"

int speed_parse(const char *text, double *speed, struct apc_error *why)
{
    if (!strcmp(text, "max")) {
        *speed = HUGE_VAL;
        return 0;
    }
    return apc_number_parse(text, speed) == 0 && *speed >= 0 && *speed <= SPEED_MOST
               ? 0
               : apc_fail(why, APC_EINVAL,
                          "\"%.40s\": must be plant seconds per second, from 0 (paused) to %d, or max", text,
                          SPEED_MOST);
}

const char *speed_text(double speed, char text[SPEED_TEXT])
{
    if (speed == 0)
        snprintf(text, SPEED_TEXT, "paused");
    else if (isinf(speed))
        snprintf(text, SPEED_TEXT, "max");
    else
        snprintf(text, SPEED_TEXT, "%.10g x", speed);
    return text;
}

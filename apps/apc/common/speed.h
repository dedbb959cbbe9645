/* SPDX-License-Identifier: BSD-3-Clause */
/* How many times as fast as time a plant is simulated: 0 to SPEED_MOST, or "max". */
#ifndef APC_SPEED_H
#define APC_SPEED_H

#include <apcbase.h>

#define SPEED_TEXT 24

/* "max" is INFINITY. Returns 0, or APC_EINVAL with what it must be. */
int speed_parse(const char *text, double *speed, struct apc_error *why);
/* "10 x", "max", "paused". */
const char *speed_text(double speed, char text[SPEED_TEXT]);

#endif

/* SPDX-License-Identifier: BSD-3-Clause */
/* What modbus.c and modbus_point.c share. Never installed. */
#ifndef APC_MODBUS_H
#define APC_MODBUS_H

#include "apcexchange.h"

/** Registers, or bits, that a value takes: 1, 2 or 4. @p type must be one. [tick] */
unsigned apc_modbus_width(enum apc_modbus_type type);
/** A value into as many registers, two bytes each; of a bit: one that is 0 or 1. False: it does not fit.
 * [tick] */
bool apc_modbus_encode(const struct apc_modbus_point *p, double value, unsigned char *registers);
/** Back. False: what stands there is no finite number. [tick] */
bool apc_modbus_decode(const struct apc_modbus_point *p, const unsigned char *registers, double *value);

#endif

/* SPDX-License-Identifier: BSD-3-Clause */
/* What modbus.c and modbus_point.c share. Never installed. */
#ifndef APC_MODBUS_H
#define APC_MODBUS_H

#include "apcexchange.h"

#define APC_MODBUS_HEADER 7 /**< transaction, protocol, length, unit */
enum {
    APC_MODBUS_READ_COILS = 1,
    APC_MODBUS_READ_DISCRETE,
    APC_MODBUS_READ_HOLDING,
    APC_MODBUS_READ_INPUT,
    APC_MODBUS_WRITE_COIL,
    APC_MODBUS_WRITE_REGISTER,
    APC_MODBUS_WRITE_COILS = 15,
    APC_MODBUS_WRITE_HOLDING,
    APC_MODBUS_MASK_HOLDING = 22
};

/** A value's place, in a list sorted by area and address. */
struct apc_modbus_item {
    struct apc_modbus_point point;
    size_t of; /**< its number in u or y; of the sign of life: their count; of the watchdog of an output: that
                  behind */
    unsigned char data[8]; /**< registers, of u: to be written */
    bool go;               /**< of u: it is to be written; of a server: it is u's */
};

/** A value into as many registers, two bytes each; of a bit: one that is 0 or 1. False: it does not fit.
 * [tick] */
bool apc_modbus_encode(const struct apc_modbus_point *p, double value, unsigned char *registers);
/** Back. False: what stands there is no finite number. [tick] */
bool apc_modbus_decode(const struct apc_modbus_point *p, const unsigned char *registers, double *value);

/** Of a flag: the bit of its register that it is. [tick] */
void apc_modbus_mask(const struct apc_modbus_point *p, unsigned char registers[2]);
/** Does what stands there say that there is no value? [tick] */
bool apc_modbus_is_code(const struct apc_modbus_point *p, const unsigned char *registers);
/** Say so; it must have a code. [tick] */
void apc_modbus_put_code(const struct apc_modbus_point *p, unsigned char *registers);

/** The value next to @p value that can be written there. [tick] */
double apc_modbus_nearest(const struct apc_modbus_point *p, double value);
bool apc_modbus_is_bit(enum apc_modbus_area area);
/** The address behind it. [tick] */
unsigned apc_modbus_end(const struct apc_modbus_item *i);
/** Of two items, for qsort(): unit, area, address, bit. */
int apc_modbus_by_place(const void *a, const void *b);
/** Do two in that order stand, at least partly, in one place? */
bool apc_modbus_overlap(const struct apc_modbus_item *a, const struct apc_modbus_item *b);
unsigned apc_modbus_get(const unsigned char *bytes);
void apc_modbus_put(unsigned char *bytes, unsigned value);
/**
 * Sort the points of u, or of y, with their signs of life into *items, the caller's to free also after a
 * failure. What is written must be such as can be, and lie apart. [setup] Returns 0, APC_EINVAL, APC_ENOMEM.
 */
int apc_modbus_take_u(struct apc_modbus_item **items, size_t *count, const struct apc_modbus_options *map,
                      size_t nu, struct apc_error *why);
int apc_modbus_take_y(struct apc_modbus_item **items, size_t *count, const struct apc_modbus_options *map,
                      size_t ny, struct apc_error *why);
/** Signs of life and outputs, in numbers: what is written. */
#define APC_MODBUS_WRITTEN(nu) (2 * (nu) + 1)

#endif

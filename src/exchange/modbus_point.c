/* SPDX-License-Identifier: BSD-3-Clause */
/* A value as registers: types, word order, scale. Bytes of a register go high one first, as Modbus has them.
 */
#include "exchange/modbus.h"

#include <float.h>
#include <math.h>
#include <string.h>

unsigned apc_modbus_width(enum apc_modbus_type type)
{
    static const unsigned width[] = {
        [APC_MODBUS_BIT] = 1, [APC_MODBUS_U16] = 1, [APC_MODBUS_S16] = 1, [APC_MODBUS_U32] = 2,
        [APC_MODBUS_S32] = 2, [APC_MODBUS_F32] = 2, [APC_MODBUS_F64] = 4};

    return width[type];
}

/* The whole number next to it, as the bits of a register; false: none of this type. */
static bool whole(double raw, double least, double most, uint64_t *bits)
{
    raw = nearbyint(raw);
    if (!(raw >= least && raw <= most))
        return false;
    *bits = (uint64_t)(int64_t)raw;
    return true;
}

static bool to_bits(enum apc_modbus_type type, double raw, uint64_t *bits)
{
    uint32_t half;
    float single;

    switch (type) {
    case APC_MODBUS_BIT:
        return whole(raw, 0, 1, bits);
    case APC_MODBUS_U16:
        return whole(raw, 0, UINT16_MAX, bits);
    case APC_MODBUS_S16:
        return whole(raw, INT16_MIN, INT16_MAX, bits);
    case APC_MODBUS_U32:
        return whole(raw, 0, UINT32_MAX, bits);
    case APC_MODBUS_S32:
        return whole(raw, INT32_MIN, INT32_MAX, bits);
    case APC_MODBUS_F32:
        if (!(fabs(raw) <= (double)FLT_MAX))
            return false;
        single = (float)raw;
        memcpy(&half, &single, sizeof(half));
        *bits = half;
        return true;
    case APC_MODBUS_F64:
        memcpy(bits, &raw, sizeof(*bits));
        return isfinite(raw);
    }
    return false;
}

static double of_bits(enum apc_modbus_type type, uint64_t bits)
{
    const uint32_t half = (uint32_t)bits;
    double wide;
    float single;

    switch (type) {
    case APC_MODBUS_S16:
        return (int16_t)bits;
    case APC_MODBUS_S32:
        return (int32_t)bits;
    case APC_MODBUS_F32:
        memcpy(&single, &half, sizeof(single));
        return (double)single;
    case APC_MODBUS_F64:
        memcpy(&wide, &bits, sizeof(wide));
        return wide;
    default:
        return (double)bits;
    }
}

/* Which of @n words, from the low one on, stands at @place. */
static unsigned word_at(const struct apc_modbus_point *p, unsigned place, unsigned n)
{
    return p->low_word_first ? place : n - 1 - place;
}

bool apc_modbus_encode(const struct apc_modbus_point *p, double value, unsigned char *registers)
{
    const unsigned n = apc_modbus_width(p->type);
    uint64_t bits;

    if (!to_bits(p->type, (value - p->offset) / p->scale, &bits))
        return false;
    for (unsigned i = 0; i < n; i++) {
        const unsigned shift = 16 * word_at(p, i, n);

        *registers++ = (unsigned char)(bits >> (shift + 8));
        *registers++ = (unsigned char)(bits >> shift);
    }
    return true;
}

bool apc_modbus_fits(const struct apc_modbus_point *point, double value)
{
    struct apc_modbus_point p = *point;
    unsigned char registers[8];

    if (p.scale == 0.0)
        p.scale = 1.0;
    return apc_modbus_encode(&p, value, registers);
}

bool apc_modbus_decode(const struct apc_modbus_point *p, const unsigned char *registers, double *value)
{
    const unsigned n = apc_modbus_width(p->type);
    uint64_t bits = 0;

    for (unsigned i = 0; i < n; i++, registers += 2)
        bits |= (uint64_t)((unsigned)registers[0] << 8 | registers[1]) << 16 * word_at(p, i, n);
    *value = p->scale * of_bits(p->type, bits) + p->offset;
    return isfinite(*value);
}

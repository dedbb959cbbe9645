/* SPDX-License-Identifier: BSD-3-Clause */
/* A value as registers: types, word order, scale, and a map of them. Bytes of a register go high one first,
 * as Modbus has them.
 */
#include "base/base_internal.h"
#include "exchange/modbus.h"

#include <float.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

unsigned apc_modbus_get(const unsigned char *bytes)
{
    return (unsigned)bytes[0] << 8 | bytes[1];
}

void apc_modbus_put(unsigned char *bytes, unsigned value)
{
    bytes[0] = (unsigned char)(value >> 8);
    bytes[1] = (unsigned char)value;
}

int apc_modbus_whole(const char *text, size_t n)
{
    const unsigned char *bytes = (const unsigned char *)text;

    if (n < APC_MODBUS_HEADER - 1)
        return 0;
    const unsigned length = apc_modbus_get(bytes + 4);
    return apc_modbus_get(bytes + 2) == 0 && length >= 2 &&
                   length <= APC_MODBUS_FRAME - (APC_MODBUS_HEADER - 1)
               ? (int)length + APC_MODBUS_HEADER - 1
               : APC_EPROTO;
}

bool apc_modbus_is_bit(enum apc_modbus_area area)
{
    return area == APC_MODBUS_COIL || area == APC_MODBUS_DISCRETE;
}

unsigned apc_modbus_registers(enum apc_modbus_type type)
{
    static const unsigned width[] = {
        [APC_MODBUS_BIT] = 1, [APC_MODBUS_U16] = 1, [APC_MODBUS_S16] = 1, [APC_MODBUS_U32] = 2,
        [APC_MODBUS_S32] = 2, [APC_MODBUS_U64] = 4, [APC_MODBUS_S64] = 4, [APC_MODBUS_FLAG] = 1,
        [APC_MODBUS_F32] = 2, [APC_MODBUS_F64] = 4};

    return width[type];
}

static const struct {
    double least, most;
} ranges[] = {[APC_MODBUS_BIT] = {0, 1},
              [APC_MODBUS_U16] = {0, UINT16_MAX},
              [APC_MODBUS_S16] = {INT16_MIN, INT16_MAX},
              [APC_MODBUS_U32] = {0, UINT32_MAX},
              [APC_MODBUS_S32] = {INT32_MIN, INT32_MAX},
              /* the ends are the last numbers of a double that fit */
              [APC_MODBUS_U64] = {0, 0x1.fffffffffffffp63},
              [APC_MODBUS_S64] = {-0x1p63, 0x1.fffffffffffffp62},
              [APC_MODBUS_FLAG] = {0, 1},
              [APC_MODBUS_F32] = {-(double)FLT_MAX, (double)FLT_MAX},
              [APC_MODBUS_F64] = {-DBL_MAX, DBL_MAX}};

static bool to_bits(enum apc_modbus_type type, double raw, uint64_t *bits)
{
    uint32_t half;
    float single;

    if (type < APC_MODBUS_F32)
        raw = nearbyint(raw);
    if (!(raw >= ranges[type].least && raw <= ranges[type].most))
        return false;
    if (type == APC_MODBUS_F64) {
        memcpy(bits, &raw, sizeof(*bits));
    } else if (type == APC_MODBUS_F32) {
        single = (float)raw;
        memcpy(&half, &single, sizeof(half));
        *bits = half;
    } else {
        *bits = raw < 0.0 ? (uint64_t)(int64_t)raw : (uint64_t)raw;
    }
    return true;
}

double apc_modbus_nearest(const struct apc_modbus_point *p, double value)
{
    const double raw = (value - p->offset) / p->scale;

    return p->scale * fmin(fmax(raw, ranges[p->type].least), ranges[p->type].most) + p->offset;
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
    case APC_MODBUS_S64:
        return (double)(int64_t)bits;
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

/* Of a register the byte at @p place: 0, the first. */
static unsigned byte_shift(const struct apc_modbus_point *p, unsigned place)
{
    return (place == 0) != p->low_byte_first ? 8 : 0;
}

static void put_register_bits(const struct apc_modbus_point *p, uint64_t bits, unsigned n,
                              unsigned char *registers)
{
    for (unsigned i = 0; i < 2 * n; i++)
        registers[i] = (unsigned char)(bits >> (16 * word_at(p, i / 2, n) + byte_shift(p, i % 2)));
}

static uint64_t get_register_bits(const struct apc_modbus_point *p, const unsigned char *registers)
{
    const unsigned n = apc_modbus_registers(p->type);
    uint64_t bits = 0;

    for (unsigned i = 0; i < 2 * n; i++)
        bits |= (uint64_t)registers[i] << (16 * word_at(p, i / 2, n) + byte_shift(p, i % 2));
    return bits;
}

void apc_modbus_mask(const struct apc_modbus_point *p, unsigned char registers[2])
{
    put_register_bits(p, UINT64_C(1) << p->bit, 1, registers);
}

bool apc_modbus_is_code(const struct apc_modbus_point *p, const unsigned char *registers)
{
    const uint64_t bits = get_register_bits(p, registers);
    bool is = false;

    for (unsigned i = 0; i < p->n_no_value; i++)
        is = is || bits == p->no_value[i];
    return is;
}

void apc_modbus_put_code(const struct apc_modbus_point *p, unsigned char *registers)
{
    put_register_bits(p, p->no_value[0], apc_modbus_registers(p->type), registers);
}

bool apc_modbus_encode(const struct apc_modbus_point *p, double value, unsigned char *registers)
{
    const unsigned n = apc_modbus_registers(p->type);
    uint64_t bits;

    if (!to_bits(p->type, (value - p->offset) / p->scale, &bits))
        return false;
    put_register_bits(p, p->type == APC_MODBUS_FLAG ? bits << p->bit : bits, n, registers);
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
    uint64_t bits = get_register_bits(p, registers);

    if (p->type == APC_MODBUS_FLAG)
        bits = bits >> p->bit & 1;
    *value = p->scale * of_bits(p->type, bits) + p->offset;
    return isfinite(*value);
}

/* ---- A map ----------------------------------------------------------------------------------- */

unsigned apc_modbus_end(const struct apc_modbus_item *i)
{
    return i->point.address + apc_modbus_registers(i->point.type);
}

static int check_point(const struct apc_modbus_point *p, bool written, const char *what, size_t i,
                       struct apc_error *why)
{
    if (p->area < APC_MODBUS_COIL || p->area > APC_MODBUS_HOLDING || p->type < APC_MODBUS_BIT ||
        p->type > APC_MODBUS_F64 || apc_modbus_is_bit(p->area) != (p->type == APC_MODBUS_BIT))
        return apc_fail(why, APC_EINVAL,
                        "modbus: %s %zu: coils and discrete inputs are bits, registers are not", what, i + 1);
    if (p->bit > 15 || p->unit > 255 || p->n_no_value > APC_MODBUS_CODES)
        return apc_fail(why, APC_EINVAL,
                        "modbus: %s %zu: a register has bits 0 to 15, a unit is at most 255, and a value has "
                        "at most %d codes for none",
                        what, i + 1, APC_MODBUS_CODES);
    if (written && p->area != APC_MODBUS_COIL && p->area != APC_MODBUS_HOLDING)
        return apc_fail(why, APC_EINVAL, "modbus: %s %zu: only coils and holding registers can be written",
                        what, i + 1);
    if (p->address + apc_modbus_registers(p->type) > 65536 || p->address > 65535)
        return apc_fail(why, APC_EINVAL, "modbus: %s %zu: address %u is beyond 65535", what, i + 1,
                        p->address);
    if (!apc_value_ok(p->scale) || !apc_value_ok(p->offset) || !apc_value_ok(p->safe))
        return apc_fail(why, APC_EINVAL, "modbus: %s %zu: scale, offset and safe must be finite", what,
                        i + 1);
    return 0;
}

int apc_modbus_by_place(const void *a, const void *b)
{
    const struct apc_modbus_point *p = &((const struct apc_modbus_item *)a)->point,
                                  *q = &((const struct apc_modbus_item *)b)->point;

    if (p->unit != q->unit)
        return p->unit < q->unit ? -1 : 1;
    if (p->area != q->area)
        return p->area < q->area ? -1 : 1;
    if (p->address != q->address)
        return p->address < q->address ? -1 : 1;
    return (p->bit > q->bit) - (p->bit < q->bit);
}

bool apc_modbus_overlap(const struct apc_modbus_item *a, const struct apc_modbus_item *b)
{
    const struct apc_modbus_point *p = &a->point, *q = &b->point;

    if (p->unit != q->unit || p->area != q->area || q->address >= apc_modbus_end(a))
        return false;
    return p->type != APC_MODBUS_FLAG || q->type != APC_MODBUS_FLAG || p->bit == q->bit;
}

/* Points that are one kind of thing, and the number of the first. */
struct list {
    const struct apc_modbus_point *points; /* NULL: none */
    size_t n, first;
    const char *what;
};

static int take_list(struct apc_modbus_item *to, size_t *count, const struct list *list, unsigned unit,
                     bool written, struct apc_error *why)
{
    for (size_t i = 0; list->points && i < list->n; i++) {
        struct apc_modbus_item *item = &to[*count];

        if (list->first && !list->points[i].area)
            continue; /* an output without a watchdog */
        int rc = check_point(&list->points[i], written, list->what, i, why);
        if (rc < 0)
            return rc;
        *item = (struct apc_modbus_item){.point = list->points[i], .of = list->first + i};
        if (item->point.scale == 0.0)
            item->point.scale = 1.0;
        if (item->point.unit == 0)
            item->point.unit = unit;
        ++*count;
    }
    return 0;
}

static int take_lists(struct apc_modbus_item **items, size_t *count, const struct list *list, size_t n,
                      unsigned unit, bool written, struct apc_error *why)
{
    size_t room = 0;
    int rc = 0;

    for (size_t i = 0; i < n; i++)
        room += list[i].n;
    *count = 0;
    *items = calloc(room, sizeof(**items));
    if (!*items)
        return apc_fail(why, APC_ENOMEM, "modbus: no memory");
    for (size_t i = 0; i < n && rc == 0; i++)
        rc = take_list(*items, count, &list[i], unit, written, why);
    if (rc < 0)
        return rc;
    qsort(*items, *count, sizeof(**items), apc_modbus_by_place);
    for (size_t i = 1; i < *count && written; i++) {
        const struct apc_modbus_item *a = &(*items)[i - 1], *b = &(*items)[i];

        if (apc_modbus_overlap(a, b))
            return apc_fail(why, APC_EINVAL, "modbus: two outputs are written to address %u",
                            b->point.address);
    }
    return 0;
}

int apc_modbus_take_u(struct apc_modbus_item **items, size_t *count, const struct apc_modbus_options *map,
                      size_t nu, struct apc_error *why)
{
    const struct list lists[] = {{map->u, nu, 0, "output"},
                                 {map->watchdog, 1, nu, "the sign of life, beside output"},
                                 {map->watchdogs, nu, nu + 1, "the watchdog of output"}};

    for (size_t i = 0; map->watchdogs && i < nu; i++)
        if (map->watchdogs[i].area &&
            (map->watchdogs[i].area != APC_MODBUS_HOLDING || map->watchdogs[i].type != APC_MODBUS_U16))
            return apc_fail(why, APC_EINVAL,
                            "modbus: the watchdog of output %zu must be a holding register: it counts",
                            i + 1);
    return take_lists(items, count, lists, sizeof(lists) / sizeof(lists[0]), map->unit, true, why);
}

int apc_modbus_take_y(struct apc_modbus_item **items, size_t *count, const struct apc_modbus_options *map,
                      size_t ny, struct apc_error *why)
{
    const struct list lists[] = {{map->y, ny, 0, "measurement"},
                                 {map->life, 1, ny, "the sign of life, beside measurement"}};

    return take_lists(items, count, lists, sizeof(lists) / sizeof(lists[0]), map->unit, false, why);
}

/* SPDX-License-Identifier: BSD-3-Clause */
/*
 * The answering side of Modbus TCP: registers and coils over a plant. Pure: bytes in, bytes out, and what it
 * wants of the plant it asks the two functions of its options for.
 *
 * There is no image of 65536 registers: the points of the map, sorted, are asked for what a request spans.
 */
#include "base/base_internal.h"
#include "exchange/modbus.h"

#include <stdlib.h>
#include <string.h>

enum { ILLEGAL_FUNCTION = 1, ILLEGAL_ADDRESS, ILLEGAL_VALUE, DEVICE_FAILURE, NO_SUCH_UNIT = 11 };
#define READ_BITS_MAX  2000
#define READ_MAX       125
#define WRITE_BITS_MAX 1968
#define WRITE_MAX      123

struct apc_modbus_unit {
    struct apc_modbus_unit_options o;
    unsigned unit;
    struct apc_modbus_item *items; /* u, the watchdog, y, life: in the order of their places */
    size_t n;
    bool watched;
    double *given,
        *asked; /* [2 nu + 1] that stands there; of the request at hand. Behind u: the watchdogs' */
    struct apc_value *shown; /* [ny + 1] last: life */
};

/* What a request spans, and its bytes: registers of two, or of bits eight in one. */
struct span {
    unsigned unit;
    enum apc_modbus_area area;
    unsigned first, count;
    const unsigned char *written;
    unsigned char *read;
};

/* ---- A span of a map ------------------------------------------------------------------------- */

/* The first item that ends behind the first address of the span. */
static size_t first_in(const struct apc_modbus_unit *m, const struct span *s)
{
    size_t low = 0, high = m->n;

    while (low < high) {
        const size_t middle = low + (high - low) / 2;
        const struct apc_modbus_item *i = &m->items[middle];
        const struct apc_modbus_point *p = &i->point;

        if (p->unit != s->unit   ? p->unit < s->unit
            : p->area != s->area ? p->area < s->area
                                 : apc_modbus_end(i) <= s->first)
            low = middle + 1;
        else
            high = middle;
    }
    return low;
}

static bool reaches(const struct apc_modbus_unit *m, size_t i, const struct span *s)
{
    return i < m->n && m->items[i].point.unit == s->unit && m->items[i].point.area == s->area &&
           m->items[i].point.address < s->first + s->count;
}

static void show_item(const struct apc_modbus_item *i, const unsigned char *data, const struct span *s)
{
    for (unsigned a = i->point.address; a < apc_modbus_end(i); a++, data += 2) {
        const unsigned at = a - s->first;

        if (a < s->first || at >= s->count)
            continue;
        if (apc_modbus_is_bit(s->area))
            s->read[at / 8] |= (unsigned char)(data[1] << at % 8);
        else
            for (size_t k = 0; k < 2; k++) /* bits of one register are several items */
                s->read[(size_t)2 * at + k] |= data[k];
    }
}

/* Every address of it is some value's: 0, or an exception. */
static int read_span(struct apc_modbus_unit *m, const struct span *s)
{
    unsigned at = s->first;
    unsigned char data[8];
    size_t i = first_in(m, s);

    for (; reaches(m, i, s) && m->items[i].point.address <= at; i++)
        at = apc_modbus_end(&m->items[i]);
    if (at < s->first + s->count)
        return ILLEGAL_ADDRESS;
    m->shown[m->o.ny].value = m->o.measure(m->o.ctx, m->shown) % 65536;
    for (i = first_in(m, s); reaches(m, i, s); i++) {
        const struct apc_modbus_item *item = &m->items[i];
        struct apc_value y = {0};
        if (item->go)
            y.value = m->given[item->of];
        else
            y = m->shown[item->of];
        const double value = apc_modbus_is_bit(s->area) && item->of == m->o.ny && !item->go
                                 ? (double)((unsigned)y.value % 2)
                                 : apc_modbus_nearest(&item->point, y.value);

        const bool bad = apc_status_severity(y.status) == APC_SEVERITY_BAD;
        if (bad && item->point.n_no_value > 0)
            apc_modbus_put_code(&item->point, data);
        else if (bad || !apc_modbus_encode(&item->point, value, data))
            return DEVICE_FAILURE;
        show_item(item, data, s);
    }
    return 0;
}

static int take_written_item(struct apc_modbus_unit *m, const struct apc_modbus_item *i, const struct span *s)
{
    const unsigned at = i->point.address - s->first;
    const bool is_bit = apc_modbus_is_bit(s->area);
    unsigned char bit[2] = {0};

    if (is_bit)
        bit[1] = s->written[at / 8] >> at % 8 & 1;

    return apc_modbus_decode(&i->point, is_bit ? bit : s->written + (size_t)2 * at, &m->asked[i->of])
               ? 0
               : ILLEGAL_VALUE;
}

static int write_span(struct apc_modbus_unit *m, const struct span *s)
{
    const size_t all = APC_MODBUS_WRITTEN(m->o.nu);
    unsigned at = s->first;
    int exception = 0;
    size_t i = first_in(m, s);

    memcpy(m->asked, m->given, all * sizeof(*m->asked));
    for (; exception == 0 && reaches(m, i, s) && m->items[i].go && m->items[i].point.address <= at; i++) {
        const unsigned end = apc_modbus_end(&m->items[i]);

        exception = m->items[i].point.address < s->first || end > s->first + s->count
                        ? ILLEGAL_VALUE
                        : take_written_item(m, &m->items[i], s);
        at = end;
    }
    if (exception == 0 && at < s->first + s->count)
        exception = ILLEGAL_ADDRESS;
    const bool counted = memcmp(m->asked + m->o.nu, m->given + m->o.nu,
                                (all - m->o.nu) * sizeof(*m->asked)) != 0; /* whole numbers from 0 on */
    if (exception == 0)
        exception = m->o.command(m->o.ctx, m->asked, !m->watched || counted);
    if (exception == 0)
        memcpy(m->given, m->asked, all * sizeof(*m->given));
    return exception;
}

/* ---- Requests -------------------------------------------------------------------------------- */

static int read_request(struct apc_modbus_unit *m, unsigned unit, const unsigned char *pdu, size_t n,
                        unsigned char *reply, size_t *length)
{
    static const enum apc_modbus_area areas[] = {[APC_MODBUS_READ_COILS] = APC_MODBUS_COIL,
                                                 [APC_MODBUS_READ_DISCRETE] = APC_MODBUS_DISCRETE,
                                                 [APC_MODBUS_READ_HOLDING] = APC_MODBUS_HOLDING,
                                                 [APC_MODBUS_READ_INPUT] = APC_MODBUS_INPUT};
    const bool bits = apc_modbus_is_bit(areas[pdu[0]]);

    if (n != 5)
        return ILLEGAL_VALUE;
    const struct span s = {.unit = unit,
                           .area = areas[pdu[0]],
                           .first = apc_modbus_get(pdu + 1),
                           .count = apc_modbus_get(pdu + 3),
                           .read = reply + 2};
    if (s.count == 0 || s.count > (bits ? READ_BITS_MAX : READ_MAX))
        return ILLEGAL_VALUE;
    reply[1] = (unsigned char)(bits ? (s.count + 7) / 8 : 2 * s.count);
    *length = 2 + (size_t)reply[1];
    memset(s.read, 0, reply[1]);
    return read_span(m, &s);
}

/* One value, functions 5 and 6, or several, 15 and 16; each is answered by the beginning of its request. */
static int answer_write(struct apc_modbus_unit *m, unsigned unit, const unsigned char *pdu, size_t n,
                        unsigned char *reply, size_t *length)
{
    const bool bits = pdu[0] == APC_MODBUS_WRITE_COIL || pdu[0] == APC_MODBUS_WRITE_COILS;
    const bool one = pdu[0] == APC_MODBUS_WRITE_COIL || pdu[0] == APC_MODBUS_WRITE_REGISTER;
    struct span s = {.unit = unit, .area = bits ? APC_MODBUS_COIL : APC_MODBUS_HOLDING, .count = 1};

    if (n < 5)
        return ILLEGAL_VALUE;
    s.first = apc_modbus_get(pdu + 1);
    s.written = pdu + 3; /* of a coil FF00 or 0000: its first bit says which */
    if (one && (n != 5 || (bits && apc_modbus_get(pdu + 3) != 0 && apc_modbus_get(pdu + 3) != 0xFF00)))
        return ILLEGAL_VALUE;
    if (!one) {
        s.count = apc_modbus_get(pdu + 3);
        s.written = pdu + 6;
        if (s.count == 0 || s.count > (bits ? WRITE_BITS_MAX : WRITE_MAX) || n < 6 ||
            pdu[5] != (bits ? (s.count + 7) / 8 : 2 * s.count) || n != 6U + pdu[5])
            return ILLEGAL_VALUE;
    }
    memcpy(reply + 1, pdu + 1, 4);
    *length = 5;
    return write_span(m, &s);
}

/* Function 22: what stands there but for some bits. */
static int mask_request(struct apc_modbus_unit *m, unsigned unit, const unsigned char *pdu, size_t n,
                        unsigned char *reply, size_t *length)
{
    unsigned char stands[2] = {0}, data[8];

    if (n != 7)
        return ILLEGAL_VALUE;
    struct span s = {.unit = unit,
                     .area = APC_MODBUS_HOLDING,
                     .first = apc_modbus_get(pdu + 1),
                     .count = 1,
                     .written = stands,
                     .read = stands};
    for (size_t i = first_in(m, &s); reaches(m, i, &s) && m->items[i].go; i++) {
        if (!apc_modbus_encode(&m->items[i].point, m->given[m->items[i].of], data))
            return DEVICE_FAILURE;
        show_item(&m->items[i], data, &s);
    }
    for (size_t k = 0; k < 2; k++)
        stands[k] = (unsigned char)((stands[k] & pdu[3 + k]) | (pdu[5 + k] & ~pdu[3 + k]));
    memcpy(reply + 1, pdu + 1, 6);
    *length = 7;
    return write_span(m, &s);
}

static bool has_unit(const struct apc_modbus_unit *m, unsigned unit)
{
    for (size_t i = 0; i < m->n; i++)
        if (m->items[i].point.unit == unit)
            return true;
    return unit == m->unit;
}

static int answer_request(struct apc_modbus_unit *m, unsigned unit, const unsigned char *pdu, size_t n,
                          unsigned char *reply, size_t *length)
{
    if (!has_unit(m, unit) && (unit == 0 || unit == 255))
        unit = m->unit;
    if (!has_unit(m, unit))
        return NO_SUCH_UNIT;
    switch (pdu[0]) {
    case APC_MODBUS_READ_COILS:
    case APC_MODBUS_READ_DISCRETE:
    case APC_MODBUS_READ_HOLDING:
    case APC_MODBUS_READ_INPUT:
        return read_request(m, unit, pdu, n, reply, length);
    case APC_MODBUS_WRITE_COIL:
    case APC_MODBUS_WRITE_REGISTER:
    case APC_MODBUS_WRITE_COILS:
    case APC_MODBUS_WRITE_HOLDING:
        return answer_write(m, unit, pdu, n, reply, length);
    case APC_MODBUS_MASK_HOLDING:
        return mask_request(m, unit, pdu, n, reply, length);
    default:
        return ILLEGAL_FUNCTION;
    }
}

int apc_modbus_unit_answer(struct apc_modbus_unit *unit, const char *request, size_t length, char *reply,
                           size_t size)
{
    const unsigned char *bytes = (const unsigned char *)request;
    unsigned char *to = (unsigned char *)reply;
    size_t n = 0;

    if (length <= APC_MODBUS_HEADER || apc_modbus_whole(request, length) != (int)length)
        return APC_EPROTO;
    if (size < APC_MODBUS_FRAME)
        return APC_ERANGE;
    memcpy(to, bytes, APC_MODBUS_HEADER + 1);
    const int exception = answer_request(unit, bytes[6], bytes + APC_MODBUS_HEADER,
                                         length - APC_MODBUS_HEADER, to + APC_MODBUS_HEADER, &n);
    if (exception) {
        to[APC_MODBUS_HEADER] |= 0x80;
        to[APC_MODBUS_HEADER + 1] = (unsigned char)exception;
        n = 2;
    }
    apc_modbus_put(to + 4, (unsigned)n + 1);
    return (int)(APC_MODBUS_HEADER + n);
}

/* ---- Set-up ---------------------------------------------------------------------------------- */

/* Of two lists one; each address is one value's. */
static int merge_register_lists(struct apc_modbus_unit *m, const struct apc_modbus_options *map,
                                struct apc_error *why)
{
    struct apc_modbus_item *u = NULL, *y = NULL;
    size_t n_u = 0, n_y = 0;
    int rc = apc_modbus_take_u(&u, &n_u, map, m->o.nu, why);

    if (rc == 0)
        rc = apc_modbus_take_y(&y, &n_y, map, m->o.ny, why);
    m->n = n_u + n_y;
    m->items = rc == 0 ? calloc(m->n, sizeof(*m->items)) : NULL;
    if (rc == 0 && !m->items)
        rc = apc_fail(why, APC_ENOMEM, "modbus: no memory");
    for (size_t i = 0; i < m->n && rc == 0; i++) {
        m->items[i] = i < n_u ? u[i] : y[i - n_u];
        m->items[i].go = i < n_u;
    }
    free(u);
    free(y);
    if (rc < 0 || !m->items)
        return rc;
    qsort(m->items, m->n, sizeof(*m->items), apc_modbus_by_place);
    for (size_t i = 1; i < m->n; i++) {
        const struct apc_modbus_item *a = &m->items[i - 1], *b = &m->items[i];

        if (apc_modbus_overlap(a, b))
            return apc_fail(why, APC_EINVAL,
                            "modbus: two values stand at address %u: a plant that is served "
                            "needs a place for each",
                            b->point.address);
    }
    return 0;
}

int apc_modbus_unit_create(struct apc_modbus_unit **unit, const struct apc_modbus_unit_options *options,
                           struct apc_error *why)
{
    struct apc_modbus_unit_options o = {0};
    struct apc_modbus_options map = {0};
    struct apc_modbus_unit *m;
    int rc;

    if (!unit)
        return apc_fail(why, APC_EINVAL, "apc_modbus_unit_create: unit must not be NULL");
    *unit = NULL;
    rc = apc_options_copy(&o, sizeof(o), options, "apc_modbus_unit_options", why);
    if (rc == 0)
        rc = apc_options_copy(&map, sizeof(map), o.modbus, "apc_modbus_options", why);
    if (rc < 0)
        return rc;
    if (!o.nu || o.nu > APC_EXCHANGE_VALUES || !o.ny || o.ny > APC_EXCHANGE_VALUES || !o.command ||
        !o.measure || !map.u || !map.y || map.unit > 255)
        return apc_fail(why, APC_EINVAL,
                        "modbus: nu and ny must be 1 to %d, unit at most 255, and u, y, command "
                        "and measure are required",
                        APC_EXCHANGE_VALUES);
    m = calloc(1, sizeof(*m));
    if (!m)
        return apc_fail(why, APC_ENOMEM, "modbus: no memory");
    m->o = o;
    m->unit = map.unit;
    m->watched = map.watchdog || map.watchdogs;
    m->given = calloc(APC_MODBUS_WRITTEN(o.nu), sizeof(*m->given));
    m->asked = calloc(APC_MODBUS_WRITTEN(o.nu), sizeof(*m->asked));
    m->shown = calloc(o.ny + 1, sizeof(*m->shown));
    rc = m->given && m->asked && m->shown ? merge_register_lists(m, &map, why)
                                          : apc_fail(why, APC_ENOMEM, "modbus: no memory");
    if (rc < 0) {
        apc_modbus_unit_destroy(m);
        return rc;
    }
    for (size_t i = 0; i < o.nu; i++)
        m->given[i] = o.initial ? o.initial[i] : map.u[i].safe;
    *unit = m;
    return 0;
}

void apc_modbus_unit_destroy(struct apc_modbus_unit *unit)
{
    if (!unit)
        return;
    free(unit->items);
    free(unit->given);
    free(unit->asked);
    free(unit->shown);
    free(unit);
}

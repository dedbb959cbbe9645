/* SPDX-License-Identifier: BSD-3-Clause */
/*
 * The scheme modbus: registers and coils of a Modbus TCP server. begin writes, finish reads, and writes and
 * reads those units that are asked last.
 *
 * Points are sorted by area and address once; those next to each other go in one request, as many as a frame
 * holds: of u those that are to be written, of y all. A server takes one request whole or not at all, and so
 * u is only as much at once as its registers are next to each other.
 *
 * Outputs that are read back are so before they are written anew: only what has stood there for a period
 * tells of somebody else who writes there, or of a plant that takes no orders at present. After an exchange
 * that failed nobody knows what was written, and what was found before stays so.
 */
#include "exchange/modbus.h"
#include "base/base_internal.h"
#include "base/parts.h"
#include "exchange/exchange_internal.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#define ILLEGAL_FUNCTION 1

struct modbus {
    struct apc_exchange x;
    struct apc_modbus_line line;
    unsigned block; /* registers, or bits, in one request at most */
    bool write_single;
    struct apc_modbus_item *u, *y; /* sorted; the watchdog and the sign of life have numbers nu and ny */
    size_t n_u, n_y;
    void *memory;             /* of the arrays below */
    double *values;           /* [2 nu + 1] to be written: u, the watchdog, each output's own */
    uint16_t *counts;         /* [nu + 1] of the outputs' watchdogs; last: of the watchdog */
    struct apc_value *read;   /* [ny + 1] */
    unsigned char *where;     /* [nu] the unit of each output */
    bool looks;               /* outputs are read back */
    struct apc_value *found;  /* [2 nu + 1] in the order of values */
    struct apc_value *stands; /* [nu] as they were found; Good: as they were written, or by nobody */
    bool *wrote;              /* [nu] by the last exchange; then its bytes are those that were written */
    bool commands;            /* this exchange writes */
    apc_ns life_limit, lived_at;
    double life;
    bool lived;
};

enum { SINGLE_REGISTERS = 1, SINGLE_COILS };

/* ---- Exceptions ------------------------------------------------------------------------------- */

static const char *exception_text(int number)
{
    static const char *const texts[] = {NULL,
                                        "illegal function",
                                        "illegal data address",
                                        "illegal data value",
                                        "server device failure",
                                        "acknowledge",
                                        "server device busy",
                                        NULL,
                                        "memory parity error",
                                        NULL,
                                        "gateway path unavailable",
                                        "gateway target device failed to respond"};

    return number < (int)(sizeof(texts) / sizeof(texts[0])) && texts[number] ? texts[number] : "unknown";
}

static apc_status exception_status(int number)
{
    switch (number) {
    case 1:
    case 2:
    case 3:
        return APC_BAD_NOT_CONNECTED; /* the map names what is not there */
    case 4:
    case 8:
        return APC_BAD_DEVICE_FAILURE;
    case 10:
    case 11:
        return APC_BAD_NO_COMMUNICATION;
    default:
        return APC_BAD_NO_DATA;
    }
}

/* ---- Units ------------------------------------------------------------------------------------ */

static struct apc_modbus_station *station_of(struct modbus *m, const struct apc_modbus_item *item)
{
    return &m->line.stations[item->point.unit];
}

/* A watchdog counts what was written: it waits for outputs in units that do not answer. Its own unit takes
 * or leaves both. */
static void hold_back_watchdogs(struct modbus *m)
{
    const size_t nu = m->x.nu;
    bool all = true;

    for (size_t i = 0; i < APC_MODBUS_UNITS && all; i++)
        all = !m->line.stations[i].outputs || !apc_modbus_out_of_reach(&m->line.stations[i]);
    for (size_t i = 0; i < m->n_u; i++) {
        struct apc_modbus_item *u = &m->u[i];
        const unsigned outputs = u->of > nu ? m->where[u->of - nu - 1] : u->point.unit;

        if (u->of == nu)
            u->go = u->go && all;
        else if (outputs != u->point.unit)
            u->go = u->go && !apc_modbus_out_of_reach(&m->line.stations[outputs]);
    }
}

/* ---- Points next to each other --------------------------------------------------------------- */

/* To be written, bits of one register are a request of their own. */
static bool goes_with(const struct apc_modbus_item *first, const struct apc_modbus_item *next)
{
    const bool flag = first->point.type == APC_MODBUS_FLAG;

    return next->go && flag == (next->point.type == APC_MODBUS_FLAG) &&
           (!flag || next->point.address == first->point.address);
}

/* How many of @left items, from the first on, go in one request, and the registers or bits that they take. */
static size_t together(const struct modbus *m, const struct apc_modbus_item *first, size_t left, bool write,
                       unsigned *width)
{
    const bool bits = apc_modbus_is_bit(first->point.area);
    const unsigned fits = write ? (bits ? 1968 : 123) : bits ? 2000 : 125;
    const unsigned most = m->block && m->block < fits ? m->block : fits;
    unsigned end = apc_modbus_end(first);
    size_t n = 1;

    for (; n < left && first[n].point.unit == first->point.unit && first[n].point.area == first->point.area &&
           first[n].point.address <= end && (!write || goes_with(first, &first[n]));
         n++) {
        const unsigned next = apc_modbus_end(&first[n]) > end ? apc_modbus_end(&first[n]) : end;

        if (next - first->point.address > most)
            break;
        end = next;
    }
    *width = end - first->point.address;
    return n;
}

/* ---- Writing --------------------------------------------------------------------------------- */

/*
 * A request to write @n items, of @bytes behind the header; the reply is the first @echo of them. Returns as
 * apc_modbus_request() does.
 */
static int request_write(struct modbus *m, const struct apc_modbus_item *first, size_t n, size_t bytes,
                         size_t echo)
{
    const unsigned char *reply;
    const int rc = apc_modbus_request(&m->line, first->point.unit, bytes, echo, &reply);

    for (size_t i = 0; i < n && rc <= 0 && m->line.sent; i++)
        if (first[i].of < m->x.nu)
            m->x.commanded[first[i].of] = true;
    const unsigned char *const asked = m->line.frame + APC_MODBUS_HEADER;
    const size_t at = rc == 0 && memcmp(reply, asked, 3) == 0 ? 3 : 1;
    return rc == 0 && memcmp(reply, asked, echo) != 0
               ? apc_modbus_no_answer(&m->line, at == 1 ? "address" : "value, or number of them,",
                                      apc_modbus_get(reply + at), apc_modbus_get(asked + at))
               : rc;
}

/* Bits of a register, and no other bit of it: the device itself puts them in. */
static int write_flags(struct modbus *m, const struct apc_modbus_item *first, size_t n)
{
    unsigned char *pdu = m->line.frame + APC_MODBUS_HEADER, mask[2];

    pdu[0] = APC_MODBUS_MASK_HOLDING;
    apc_modbus_put(pdu + 1, first->point.address);
    memset(pdu + 3, 0xFF, 2); /* what stays */
    memset(pdu + 5, 0, 2);    /* what is put in where it does not */
    for (size_t i = 0; i < n; i++) {
        apc_modbus_mask(&first[i].point, mask);
        for (size_t k = 0; k < 2; k++) {
            pdu[3 + k] &= (unsigned char)~mask[k];
            pdu[5 + k] |= first[i].data[k];
        }
    }
    return request_write(m, first, n, 7, 7);
}

/* Each by itself. */
static int write_single(struct modbus *m, const struct apc_modbus_item *first, size_t n)
{
    unsigned char *pdu = m->line.frame + APC_MODBUS_HEADER;
    const bool bits = first->point.area == APC_MODBUS_COIL;
    int rc = 0;

    for (size_t i = 0; i < n && rc == 0; i++) {
        pdu[0] = bits ? APC_MODBUS_WRITE_COIL : APC_MODBUS_WRITE_REGISTER;
        apc_modbus_put(pdu + 1, first[i].point.address);
        memcpy(pdu + 3, first[i].data, 2);
        if (bits)
            apc_modbus_put(pdu + 3, first[i].data[1] ? 0xFF00 : 0);
        rc = request_write(m, &first[i], 1, 5, 5);
    }
    return rc;
}

static int write_multiple(struct modbus *m, const struct apc_modbus_item *first, size_t n, unsigned width)
{
    unsigned char *pdu = m->line.frame + APC_MODBUS_HEADER;
    const bool bits = first->point.area == APC_MODBUS_COIL;
    const unsigned bytes = bits ? (width + 7) / 8 : 2 * width;

    pdu[0] = bits ? APC_MODBUS_WRITE_COILS : APC_MODBUS_WRITE_HOLDING;
    apc_modbus_put(pdu + 1, first->point.address);
    apc_modbus_put(pdu + 3, width);
    pdu[5] = (unsigned char)bytes;
    memset(pdu + 6, 0, bytes);
    for (size_t i = 0; i < n; i++) {
        const unsigned at = first[i].point.address - first->point.address;

        if (bits)
            pdu[6 + at / 8] |= (unsigned char)(first[i].data[1] << at % 8);
        else
            memcpy(pdu + 6 + (size_t)2 * at, first[i].data,
                   (size_t)2 * apc_modbus_registers(first[i].point.type));
    }
    return request_write(m, first, n, 6 + bytes, 5);
}

/* Values of one register, which no request can leave half written. */
static bool are_single(const struct apc_modbus_item *first, size_t n)
{
    for (size_t i = 0; i < n; i++)
        if (apc_modbus_registers(first[i].point.type) > 1)
            return false;
    return true;
}

static int write_together(struct modbus *m, const struct apc_modbus_item *first, size_t n, unsigned width)
{
    const bool bits = first->point.area == APC_MODBUS_COIL, flags = first->point.type == APC_MODBUS_FLAG;
    const unsigned char kind = bits ? SINGLE_COILS : SINGLE_REGISTERS;
    unsigned char *known = &station_of(m, first)->single;
    const bool can = are_single(first, n), first_way = m->write_single || (can && (*known & kind));
    int rc = flags       ? write_flags(m, first, n)
             : first_way ? write_single(m, first, n)
                         : write_multiple(m, first, n, width);

    if (rc == ILLEGAL_FUNCTION && !flags && !first_way && can) {
        rc = write_single(m, first, n);
        *known |= rc == 0 ? kind : 0;
    } else if (rc == ILLEGAL_FUNCTION) {
        *known &= (unsigned char)~kind; /* it may have been another state of the device */
    }
    if (rc > 0)
        return apc_fail(&m->x.error, APC_EPERM,
                        "the plant refuses to have %s %u to %u written: exception %d, %s%s",
                        bits ? "coils" : "holding registers", first->point.address,
                        first->point.address + width - 1, rc, exception_text(rc),
                        rc != ILLEGAL_FUNCTION ? ""
                        : flags ? " (22, mask write register: a bit is written by no other, which "
                                  "would undo what the plant writes beside it)"
                        : can   ? ""
                                : " (16: a value of several registers is written by no other, "
                                  "which would leave half of it)");
    return rc;
}

/* All that go, in the order of their addresses, to units that are asked last, or to the others. */
static void write_all_items(struct modbus *m, bool last)
{
    for (size_t i = 0, n; i < m->n_u; i += n) {
        struct apc_modbus_station *unit = station_of(m, &m->u[i]);
        unsigned width;

        n = 1;
        if (!m->u[i].go || unit->last != last || unit->failed)
            continue;
        n = together(m, &m->u[i], m->n_u - i, true, &width);
        const int rc = write_together(m, &m->u[i], n, width);
        if (rc < 0) {
            apc_modbus_line_fail(&m->line, unit, rc);
            hold_back_watchdogs(m);
        }
        for (size_t k = i; k < i + n; k++)
            if (m->u[k].of < m->x.nu)
                m->wrote[m->u[k].of] = rc == 0;
    }
}

/* ---- Reading --------------------------------------------------------------------------------- */

static void take_modbus_value(struct apc_value *to, const struct apc_modbus_item *y,
                              const unsigned char *data, unsigned at, apc_ns now)
{
    unsigned char bit[2] = {0};

    if (apc_modbus_is_bit(y->point.area)) {
        bit[1] = data[at / 8] >> at % 8 & 1;
        data = bit;
    } else {
        data += (size_t)2 * at;
    }
    *to = (struct apc_value){.time = now};
    if (apc_modbus_is_code(&y->point, data))
        to->status = APC_BAD_NO_DATA;
    else if (!apc_modbus_decode(&y->point, data, &to->value) || !apc_value_ok(to->value))
        *to = (struct apc_value){.status = APC_BAD_SENSOR_FAILURE, .time = now};
}

/* Each into its place in @to. */
static int read_together(struct modbus *m, const struct apc_modbus_item *first, size_t n, unsigned width,
                         struct apc_value *to)
{
    static const unsigned char functions[] = {[APC_MODBUS_COIL] = APC_MODBUS_READ_COILS,
                                              [APC_MODBUS_DISCRETE] = APC_MODBUS_READ_DISCRETE,
                                              [APC_MODBUS_INPUT] = APC_MODBUS_READ_INPUT,
                                              [APC_MODBUS_HOLDING] = APC_MODBUS_READ_HOLDING};
    unsigned char *pdu = m->line.frame + APC_MODBUS_HEADER;
    const unsigned bytes = apc_modbus_is_bit(first->point.area) ? (width + 7) / 8 : 2 * width;
    const unsigned char *reply;

    pdu[0] = functions[first->point.area];
    apc_modbus_put(pdu + 1, first->point.address);
    apc_modbus_put(pdu + 3, width);
    int rc = apc_modbus_request(&m->line, first->point.unit, 5, 2 + bytes, &reply);
    if (rc < 0)
        return rc;
    if (rc == 0 && reply[1] != bytes)
        return apc_modbus_no_answer(&m->line, "count of bytes", reply[1], bytes);
    const apc_ns now = apc_clock_utc(NULL);
    for (size_t i = 0; i < n; i++) {
        if (rc > 0)
            to[first[i].of] = (struct apc_value){.status = exception_status(rc), .time = now};
        else
            take_modbus_value(&to[first[i].of], &first[i], reply + 2,
                              first[i].point.address - first->point.address, now);
    }
    return 0;
}

/* ---- What stands there ----------------------------------------------------------------------- */

/* Is what was found there other than the bytes that were written? */
static bool differs_from_written(const struct apc_modbus_item *u, const struct apc_value *found)
{
    unsigned char bytes[8] = {0};

    return !apc_modbus_encode(&u->point, found->value, bytes) ||
           memcmp(bytes, u->data, (size_t)2 * apc_modbus_registers(u->point.type)) != 0;
}

static void look_back(struct modbus *m)
{
    const size_t nu = m->x.nu;

    for (size_t i = 0, n; i < m->n_u; i += n) {
        struct apc_modbus_station *unit = station_of(m, &m->u[i]);
        unsigned width;

        n = 1;
        if (m->u[i].of >= nu || !m->wrote[m->u[i].of] || apc_modbus_out_of_reach(unit))
            continue;
        n = together(m, &m->u[i], m->n_u - i, false, &width);
        const int rc = read_together(m, &m->u[i], n, width, m->found);
        if (rc < 0)
            apc_modbus_line_fail(&m->line, unit, rc);
    }
    for (size_t i = 0; i < m->n_u; i++) {
        const size_t of = m->u[i].of;

        if (of >= nu || !m->wrote[of] || apc_modbus_out_of_reach(station_of(m, &m->u[i])))
            continue;
        m->stands[of] = m->found[of];
        if (apc_status_severity(m->found[of].status) == APC_SEVERITY_GOOD &&
            differs_from_written(&m->u[i], &m->found[of]))
            m->stands[of].status = APC_UNCERTAIN_SUBSTITUTE;
    }
}

static apc_status modbus_read_back(const struct apc_exchange *x, size_t i, double *value)
{
    const struct modbus *m = (const struct modbus *)x;

    *value = m->stands[i].value;
    return m->stands[i].status;
}

/* ---- Outputs --------------------------------------------------------------------------------- */

/* One that does not fit is found before any is written. */
static int encode_all(struct modbus *m)
{
    for (size_t i = 0; i < m->n_u; i++) {
        struct apc_modbus_item *u = &m->u[i];

        if (u->go && !apc_modbus_encode(&u->point, m->values[u->of], u->data))
            return apc_fail(&m->x.error, APC_ERANGE,
                            "output %zu is %g: what its register can take is less (address %u)", u->of + 1,
                            m->values[u->of], u->point.address);
    }
    return 0;
}

/* What goes out this time, and who counts it. */
static void choose_commanded_value(struct modbus *m, const struct apc_value *u)
{
    const size_t nu = m->x.nu;
    bool all = true;

    for (size_t i = 0; i < nu; i++) {
        m->values[i] = u[i].value;
        all = all && apc_exchange_writes(&u[i]);
    }
    for (size_t i = 0; i < m->n_u; i++) {
        const size_t of = m->u[i].of;

        m->u[i].go = of == nu ? all : apc_exchange_writes(&u[of > nu ? of - nu - 1 : of]);
    }
    hold_back_watchdogs(m);
    for (size_t i = 0; i < m->n_u; i++) {
        const size_t of = m->u[i].of;

        if (of >= nu && m->u[i].go)
            m->values[of] = ++m->counts[of == nu ? nu : of - nu - 1];
    }
}

static int modbus_begin(struct apc_exchange *x, const struct apc_value *u, apc_ns deadline)
{
    struct modbus *m = (struct modbus *)x;

    m->line.deadline = deadline;
    m->commands = u != NULL;
    apc_modbus_line_begin(&m->line, false);
    if (!u)
        return 0;
    if (m->looks)
        look_back(m);
    choose_commanded_value(m, u);
    const int rc = encode_all(m);
    memset(m->wrote, 0, x->nu * sizeof(*m->wrote));
    if (rc < 0)
        return rc;
    write_all_items(m, false);
    for (size_t i = 0; i < m->n_u; i++)
        if (m->u[i].of < x->nu && !m->u[i].go)
            m->stands[m->u[i].of] = (struct apc_value){0};
    for (size_t i = 0; i < APC_MODBUS_UNITS; i++)
        if ((m->line.stations[i].writes || m->line.stations[i].reads) && !m->line.stations[i].failed)
            return 0;
    return apc_modbus_line_settle(&m->line, &x->partly);
}

static int modbus_safe(struct apc_exchange *x, const bool *which, apc_ns deadline)
{
    struct modbus *m = (struct modbus *)x;
    int rc;

    m->line.deadline = deadline;
    apc_modbus_line_begin(&m->line, true);
    for (size_t i = 0; i < m->n_u; i++) {
        m->u[i].go = m->u[i].of < x->nu && which[m->u[i].of];
        if (m->u[i].go)
            m->values[m->u[i].of] = m->u[i].point.safe;
    }
    rc = encode_all(m);
    if (rc < 0)
        return rc;
    write_all_items(m, false);
    write_all_items(m, true);
    (void)apc_modbus_line_settle(&m->line, &x->partly);
    return m->line.rc;
}

/* ---- Measurements ---------------------------------------------------------------------------- */

/* Has the plant's own sign of life stood still for too long? */
static bool is_dead(struct modbus *m)
{
    const struct apc_value *life = &m->read[m->x.ny];
    const apc_ns now = apc_clock_mono(NULL);
    const bool good = apc_status_severity(life->status) == APC_SEVERITY_GOOD;

    if (!m->lived || (good && (life->value < m->life || life->value > m->life))) {
        m->lived = true;
        m->life = life->value;
        m->lived_at = now;
    }
    return m->life_limit > 0 && now - m->lived_at > m->life_limit;
}

/* From units that are asked last, or from the others. */
static void read_all_items(struct modbus *m, bool last)
{
    for (size_t i = 0, n; i < m->n_y; i += n) {
        struct apc_modbus_station *unit = station_of(m, &m->y[i]);
        unsigned width;

        n = together(m, &m->y[i], m->n_y - i, false, &width);
        if (unit->last != last || unit->failed)
            continue;
        const int rc = read_together(m, &m->y[i], n, width, m->read);
        if (rc < 0)
            apc_modbus_line_fail(&m->line, unit, rc);
        else if (i + n == m->n_y || station_of(m, &m->y[i + n]) != unit) /* its last request */
            apc_modbus_line_done(&m->line);
    }
}

static int modbus_finish(struct apc_exchange *x, struct apc_value *y)
{
    struct modbus *m = (struct modbus *)x;

    m->line.left = 0;
    for (size_t i = 0; i < APC_MODBUS_UNITS; i++)
        m->line.left +=
            !m->line.stations[i].failed &&
            (m->line.stations[i].reads || (m->line.stations[i].last && m->line.stations[i].writes));
    m->line.left += m->line.left == 0;
    read_all_items(m, false);
    if (m->commands)
        write_all_items(m, true);
    read_all_items(m, true);
    const int rc = apc_modbus_line_settle(&m->line, &x->partly);
    if (rc < 0)
        return rc;
    const apc_ns now = apc_clock_utc(NULL);
    for (size_t i = 0; i < m->n_y; i++)
        if (station_of(m, &m->y[i])->failed)
            m->read[m->y[i].of] = (struct apc_value){.status = APC_BAD_NO_COMMUNICATION, .time = now};
    for (size_t i = 0; i < APC_MODBUS_UNITS; i++)
        x->refused = x->refused || (m->commands && m->line.stations[i].outputs && m->line.stations[i].failed);
    const bool dead = is_dead(m);
    memcpy(y, m->read, x->ny * sizeof(*y));
    for (size_t i = 0; i < x->ny && dead; i++)
        y[i].status = APC_BAD_DEVICE_FAILURE;
    return 0;
}

/* ---- Opening --------------------------------------------------------------------------------- */

static void modbus_close(struct apc_exchange *x)
{
    struct modbus *m = (struct modbus *)x;

    apc_modbus_line_close(&m->line);
    free(m->u);
    free(m->y);
    free(m->memory);
    free(m);
}

/* Each value whole in one request. */
static int check_widths(const struct modbus *m, const struct apc_modbus_item *items, size_t n, bool write,
                        struct apc_error *why)
{
    for (size_t i = 0; i < n; i++) {
        const unsigned width = apc_modbus_registers(items[i].point.type);

        if (m->block && width > m->block)
            return apc_fail(why, APC_EINVAL,
                            "modbus: the value at address %u has %u registers: a block must have as many",
                            items[i].point.address, width);
        if (write && m->write_single && width > 1)
            return apc_fail(why, APC_EINVAL,
                            "modbus: the output at address %u has %u registers, which function 6 would leave "
                            "half written: with write_single each has one",
                            items[i].point.address, width);
    }
    return 0;
}

static int take_modbus_options(struct modbus *m, const struct apc_exchange_options *options,
                               struct apc_error *why)
{
    struct apc_modbus_options o = {0};
    int rc = apc_options_copy(&o, sizeof(o), options->modbus, "apc_modbus_options", why);

    if (rc < 0)
        return rc;
    if (!o.u || !o.y || o.unit > 255 || (o.life && o.life_limit <= 0))
        return apc_fail(why, APC_EINVAL,
                        "modbus: u and y are required, unit is at most 255, and life takes a limit above 0");
    m->block = o.block;
    m->write_single = o.write_single;
    m->looks = o.read_back;
    m->life_limit = o.life ? o.life_limit : 0;
    rc = apc_modbus_take_u(&m->u, &m->n_u, &o, options->nu, why);
    if (rc == 0)
        rc = apc_modbus_take_y(&m->y, &m->n_y, &o, options->ny, why);
    if (rc == 0)
        rc = check_widths(m, m->u, m->n_u, true, why);
    if (rc == 0)
        rc = check_widths(m, m->y, m->n_y, false, why);
    if (rc < 0)
        return rc;
    for (size_t i = 0; i < m->n_u; i++) {
        struct apc_modbus_station *unit = station_of(m, &m->u[i]);

        unit->writes = true;
        if (m->u[i].of >= options->nu)
            continue;
        unit->outputs = true;
        m->where[m->u[i].of] = (unsigned char)m->u[i].point.unit;
    }
    for (size_t i = 0; i < m->n_y; i++)
        station_of(m, &m->y[i])->reads = true;
    return 0;
}

static int modbus_open(struct apc_exchange **x, const char *uri, const struct apc_exchange_options *options,
                       struct apc_error *why)
{
    struct modbus *m = calloc(1, sizeof(*m));
    char to[512];
    int rc;

    if (!m)
        return apc_fail(why, APC_ENOMEM, "plant \"%s\": no memory", uri);
    const struct apc_part parts[] = {APC_PART(m->values, APC_MODBUS_WRITTEN(options->nu)),
                                     APC_PART(m->counts, options->nu + 1),
                                     APC_PART(m->read, options->ny + 1),
                                     APC_PART(m->found, APC_MODBUS_WRITTEN(options->nu)),
                                     APC_PART(m->stands, options->nu),
                                     APC_PART(m->wrote, options->nu),
                                     APC_PART(m->where, options->nu)};
    m->memory = apc_parts_allocate(parts, sizeof(parts) / sizeof(*parts));
    rc = m->memory ? take_modbus_options(m, options, why) : apc_fail(why, APC_ENOMEM, "modbus: no memory");
    if (rc == 0) {
        (void)snprintf(to, sizeof(to), "tcp:%s", uri + strlen("modbus:"));
        rc = apc_modbus_line_open(&m->line, to, &m->x.error, why);
    }
    if (rc < 0) {
        modbus_close(&m->x);
        return rc;
    }
    *x = &m->x;
    return 0;
}

const struct apc_exchange_ops apc_exchange_modbus = {.scheme = "modbus:",
                                                     .open = modbus_open,
                                                     .close = modbus_close,
                                                     .begin = modbus_begin,
                                                     .finish = modbus_finish,
                                                     .safe = modbus_safe,
                                                     .read_back = modbus_read_back};

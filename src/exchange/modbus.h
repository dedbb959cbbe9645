/* SPDX-License-Identifier: BSD-3-Clause */
/* What the files of Modbus share. Never installed. */
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

/* ---- modbus_line.c: the units behind one address, as a client asks them ------------------------- */

#define APC_MODBUS_UNITS 256

struct apc_modbus_station {
    bool writes, reads;   /**< has outputs or watchdogs; has measurements or the sign of life */
    bool outputs;         /**< has one of u */
    bool last;            /**< it failed: it is asked behind the others */
    bool asked, failed;   /**< in this exchange; failed and not asked: it pauses */
    bool refuses;         /**< it failed and was not silent */
    unsigned char single; /**< modbus.c's: what it is to be written one at a time */
    unsigned late;        /**< requests on this connection to which a reply may still come */
    apc_ns pause, ask_at; /**< of a silent one */
};

/** Zeroed at first. Who asks sets writes, reads and outputs of each unit once. */
struct apc_modbus_line {
    struct apc_link *link;
    struct apc_error *error; /**< borrowed: text of what fails */
    apc_ns deadline;         /**< of the exchange */
    struct apc_modbus_station stations[APC_MODBUS_UNITS], *first;
    unsigned left;        /**< units that have something to ask in this exchange: they share its time */
    int rc;               /**< how the first of them failed in it, or 0 */
    bool reached;         /**< that one's request had left */
    struct apc_error why; /**< its text; kept while a unit is silent */
    bool sent;            /**< the last request has left */
    uint16_t transaction;
    uint64_t connects; /**< of the link, since which `late` is counted */
    unsigned char frame[APC_MODBUS_FRAME];
};

/** [setup] As apc_link_create(). */
int apc_modbus_line_open(struct apc_modbus_line *line, const char *to, struct apc_error *error,
                         struct apc_error *why);
void apc_modbus_line_close(struct apc_modbus_line *line);
/** An exchange begins, within the line's deadline. @p all: also with units that pause. [tick] */
void apc_modbus_line_begin(struct apc_modbus_line *line, bool all);
/**
 * The request of @p n bytes that stands behind the frame's header, to @p unit. Returns 0 with the reply's
 * bytes behind its header, as many as @p expected, in @p reply; the number of an exception, 1 to 255; or a
 * negative error. [tick]
 */
int apc_modbus_request(struct apc_modbus_line *line, unsigned unit, size_t n, size_t expected,
                       const unsigned char **reply);
/** @p what of the reply is @p is, and should be @p asked. Returns APC_EPROTO. [tick] */
int apc_modbus_no_answer(struct apc_modbus_line *line, const char *what, unsigned is, unsigned asked);
/** What the line's error says is of this unit: no more of it in this exchange. [tick] */
void apc_modbus_line_fail(struct apc_modbus_line *line, struct apc_modbus_station *station, int rc);
/** One of those that share the time has answered all. [tick] */
void apc_modbus_line_done(struct apc_modbus_line *line);
/** Are its outputs not written now, or perhaps not? [tick] */
bool apc_modbus_out_of_reach(const struct apc_modbus_station *station);
/** The exchange ends. Returns 0 if a unit answered all that it was asked, @p partly and the line's error if
 * others did not; else how the first one failed. [tick] */
int apc_modbus_line_settle(struct apc_modbus_line *line, bool *partly);

/** Signs of life and outputs, in numbers: what is written. */
#define APC_MODBUS_WRITTEN(nu) (2 * (nu) + 1)

#endif

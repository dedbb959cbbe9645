/* SPDX-License-Identifier: BSD-3-Clause */
/**
 * @file apcexchange.h
 * A plant, as its client sees it: whatever takes a vector u and gives a vector y, each value with a status
 * and a source time. A scheme says how: frames over a link (`tcp:`, `tls:`); registers of a Modbus server
 * (`modbus:`); lines of a Temperature Control Lab (`serial:`); frames over a modelled network in virtual time
 * (`inproc:`).
 *
 *     begin(u) ... finish(y)
 *
 * There are two calls, because virtual time does not wait. Between them one exchange is under way; what comes
 * too late for it is never taken for the next one's, and what could not be written is never written later.
 * One thread at a time.
 */
#ifndef APCEXCHANGE_H
#define APCEXCHANGE_H

#include "apcbase.h"
#include "apcsockets.h"
#include "apctimer.h"

#ifdef __cplusplus
extern "C" {
#endif

#define APC_EXCHANGE_VALUES 8192 /**< that u, and y, may have */

/** Of `inproc:`: what else there is in virtual time. */
struct apc_inproc_options {
    size_t size;
    struct apc_executive *executive; /**< required: "virtual"; borrowed, and destroyed later */
    int request_rank, reply_rank;    /**< of arrivals, among coinciding events */
    /** Both ways are alike, each with streams of its own: "network.to" and "network.from". */
    struct apc_network_options network;
    apc_server_fn serve; /**< required: the plant */
    void *serve_ctx;
    /** The exchange has ended: call apc_exchange_finish(), here or later. NULL: no call. */
    void (*done)(void *ctx);
    void *done_ctx;
};

enum apc_modbus_area { APC_MODBUS_COIL = 1, APC_MODBUS_DISCRETE, APC_MODBUS_INPUT, APC_MODBUS_HOLDING };
enum apc_modbus_type {
    APC_MODBUS_BIT = 1, /**< of a coil or a discrete input, and of nothing else: 0 or 1 */
    APC_MODBUS_U16,
    APC_MODBUS_S16,
    APC_MODBUS_U32,
    APC_MODBUS_S32,
    APC_MODBUS_U64,
    APC_MODBUS_S64,
    APC_MODBUS_FLAG, /**< one bit of a register: 0 or 1 */
    APC_MODBUS_F32,
    APC_MODBUS_F64
};

#define APC_MODBUS_CODES 4 /**< of one point that say that there is no value */

/** The place of a value in the plant's memory, and its coding: value = scale * raw + offset. */
struct apc_modbus_point {
    enum apc_modbus_area area;
    enum apc_modbus_type type; /**< types of 32 and 64 bits take 2 and 4 registers */
    unsigned address;          /**< as on the wire: the first is 0 */
    unsigned bit;              /**< of APC_MODBUS_FLAG: 0, the least significant, to 15 */
    unsigned unit;             /**< 1 to 255: in another unit than that of the options; 0: in that one */
    bool low_word_first;       /**< of those that take several; else the high one */
    bool low_byte_first;       /**< of each register; else the high one, as the specification has it */
    double scale, offset;      /**< scale 0: 1 */
    double safe;               /**< of u: what apc_exchange_safe() writes */
    /** Of y: what stands there when there is no value, as the bits of the whole, high word first: it is
     * BadNoData then. */
    uint64_t no_value[APC_MODBUS_CODES];
    unsigned n_no_value; /**< how many there are of these */
};

/** Registers that a value of @p type takes: 1, 2 or 4. [any] */
APC_API unsigned apc_modbus_registers(enum apc_modbus_type type);
/** Can @p value be written there? [any] */
APC_API bool apc_modbus_fits(const struct apc_modbus_point *point, double value);

/** Of `modbus:`: which registers and coils u and y are. */
struct apc_modbus_options {
    size_t size;
    unsigned unit;                    /**< 0 to 255, in each request */
    const struct apc_modbus_point *u; /**< required: [nu], of holding registers and coils; copied */
    const struct apc_modbus_point *y; /**< required: [ny]; copied */
    /** For a plant that watches its client: a holding register that counts the exchanges in which all of u
     * was written, 0 to 65535 and round again; NULL: none. Copied. */
    const struct apc_modbus_point *watchdog;
    /** That the plant itself is alive: what changes there as long as it is. Once it has stood still for
     * life_limit each of y is Bad. NULL: nothing does. Copied. */
    const struct apc_modbus_point *life;
    apc_ns life_limit; /**< required with life */
    /** [nu] for outputs that may be out of service by themselves: for each a holding register that counts the
     * exchanges in which it was written; area 0: that one has none. NULL: none has. Copied. */
    const struct apc_modbus_point *watchdogs;
    /** Read the registers of the outputs before they are written: apc_exchange_read_back(). */
    bool read_back;
    /** Write each register and coil by itself, functions 6 and 5: a device that knows no others. Where it is
     * false these are used of a unit that answered functions 16 and 15 by exception 1. */
    bool write_single;
    unsigned block; /**< registers, or bits, in one request at most; 0: as many as a frame holds */
};

/* ---- The other side of modbus: ---------------------------------------------------------------- */

/** What a unit that answers requests of Modbus TCP asks of the plant behind it. */
struct apc_modbus_unit_options {
    size_t size;
    size_t nu, ny; /**< required: 1 to APC_EXCHANGE_VALUES */
    const struct apc_modbus_options
        *modbus;           /**< required: the map, as the client has it; no two may overlap */
    const double *initial; /**< [nu] that stands in the registers of u at first; NULL: safe */
    /** Take the whole of u, [nu]. @p alive: with a sign of life of the client, which is a new count of a
     * watchdog where the map has one, and else that it wrote at all. Returns 0, or the Modbus exception to
     * answer with, and then what was written is as if it never was. Required. */
    int (*command)(void *ctx, const double *u, bool alive);
    /** Give y, [ny], of which what is Bad is answered by exception 4. Returns the plant's own count, which
     * goes into `life`. Required. */
    unsigned (*measure)(void *ctx, struct apc_value *y);
    void *ctx;
};

struct apc_modbus_unit;

/** [setup] Returns 0, APC_EINVAL, APC_ENOMEM. */
APC_API int apc_modbus_unit_create(struct apc_modbus_unit **unit,
                                   const struct apc_modbus_unit_options *options, struct apc_error *why);
APC_API void apc_modbus_unit_destroy(struct apc_modbus_unit *unit); /**< NULL is legal. [setup] */
/**
 * Answer one request: functions 1 to 6, 15, 16 and 22. A measurement beyond what its register holds is the
 * end of that range, as a converter has it; a value of several registers is written wholly or not at all
 * (exception 3). Answers as each unit of the map, and as 0 and 255, which mean any unit at that address.
 * Returns the reply's length, at most 260, or APC_EPROTO, APC_ERANGE (@p size): close the connection. [tick]
 */
APC_API int apc_modbus_unit_answer(struct apc_modbus_unit *unit, const char *request, size_t length,
                                   char *reply, size_t size);
#define APC_MODBUS_FRAME 260 /**< bytes of a frame of Modbus TCP, at most */
/** Where a frame of Modbus TCP ends, for apc_link_options and apc_server_options. [any] */
APC_API int apc_modbus_whole(const char *bytes, size_t n);

/* ---- The other side of serial: ------------------------------------------------------------------ */

/** As of a Modbus unit, of a plant of one or two heaters in per cent and as many temperatures in °C. */
struct apc_tclab_options {
    size_t size;
    size_t nu, ny;                                          /**< required: 1 or 2 */
    int (*command)(void *ctx, const double *u, bool alive); /**< required; what it refuses is not set */
    unsigned (*measure)(void *ctx, struct apc_value *y);    /**< required; what is Bad reads as -50 °C */
    void *ctx;
};

struct apc_tclab;

/** The firmware of a Temperature Control Lab, but for its text. [setup] Returns 0, APC_EINVAL, APC_ENOMEM. */
APC_API int apc_tclab_create(struct apc_tclab **tclab, const struct apc_tclab_options *options,
                             struct apc_error *why);
APC_API void apc_tclab_destroy(struct apc_tclab *tclab); /**< NULL is legal. [setup] */
/** Answer a line: VER, T1, R1, Q1 PERCENT, P1, LED PERCENT, X, and the same of 2. Each is a sign of life of
 * who commands. Returns the reply's length; 0: an empty line has none; APC_ERANGE: @p size. [tick] */
APC_API int apc_tclab_answer(struct apc_tclab *tclab, const char *line, size_t length, char *reply,
                             size_t size);

struct apc_exchange_options {
    size_t size;
    size_t nu, ny;                           /**< required: 1 to APC_EXCHANGE_VALUES */
    const struct apc_inproc_options *inproc; /**< of inproc:, which requires it */
    const struct apc_modbus_options *modbus; /**< of modbus:, which requires it */
    const double *safe;            /**< [nu] of serial:, what apc_exchange_safe() writes; NULL: 0. Copied */
    struct apc_identity *identity; /**< of tls:, which requires it; borrowed */
};

struct apc_exchange;

/**
 * Open what @p uri names: `tcp:HOST:PORT` or `tls:HOST:PORT`, as apc_link_create() has it,
 * `modbus:HOST:PORT`, `serial:PATH`, a Temperature Control Lab at that port (heaters in per cent,
 * temperatures in °C, two at most), or `inproc:`. Connects to nothing yet: the first exchange does. [setup]
 * Returns 0, APC_EINVAL (unknown scheme, malformed address, an option that makes no sense), APC_ENOMEM,
 * APC_ESYS.
 */
APC_API int apc_exchange_open(struct apc_exchange **exchange, const char *uri,
                              const struct apc_exchange_options *options, struct apc_error *why);
APC_API void apc_exchange_close(struct apc_exchange *exchange); /**< NULL is legal. [setup] */

/**
 * Give the plant @p u [nu] and ask for y, within @p deadline (monotonic). A value that is Bad or not finite
 * is not written; a plant behind frames takes whole vectors, so there one such value keeps all from being
 * written. NULL: ask only. Returns 0 when the exchange is under way, else a negative error. APC_EBUSY: the
 * one before is under way; APC_ECONN: no connection, or pausing before the next try. Also APC_ETIMEDOUT,
 * APC_EINVAL (a time that the protocol cannot express), APC_ENOMEM (inproc: only). [tick]
 */
APC_API int apc_exchange_begin(struct apc_exchange *exchange, const struct apc_value *u, apc_ns deadline);
/**
 * Its end: y [ny] with the plant's own status and source time. Waits until the deadline, in virtual time not
 * at all. Returns 0; or a negative error, then each of y is BadNoCommunication: APC_ETIMEDOUT, APC_ECONN (the
 * plant closed the connection), APC_EPROTO (what came is no answer to what was asked). APC_EBUSY: in virtual
 * time it has not ended yet; APC_EINVAL: none was begun. If a part of the plant fails (a unit of `modbus:`,
 * not all) it returns 0: y of that part is BadNoCommunication, and apc_exchange_error() names it. [tick]
 */
APC_API int apc_exchange_finish(struct apc_exchange *exchange, struct apc_value *y);
/**
 * The client leaves. A plant that does not watch its client gets the safe values, within @p deadline: of
 * those outputs that this exchange has commanded and that are not @p spared [nu] (NULL: none). A client that
 * only read changes nothing. Nothing to do for a plant behind frames, which goes there by itself. Returns 0
 * or a negative error. [setup]
 */
APC_API int apc_exchange_safe(struct apc_exchange *exchange, const bool *spared, apc_ns deadline);
/**
 * From now on the commands are those of a claim, apc_store_claimed(): a plant behind frames refuses them once
 * a client with a newer claim commands (APC_FRAME_CLAIMED). So a client that slept while another one took
 * over moves nothing. A lower number than before changes nothing; `modbus:` and `serial:` have no place for
 * one. [tick]
 */
APC_API void apc_exchange_claim(struct apc_exchange *exchange, uint64_t number);
/**
 * The plant's own value of output @p i, from 0, as the last exchange began. APC_GOOD: the value that it had
 * been given, or not read (only `modbus:` does, with read_back). APC_UNCERTAIN_SUBSTITUTE: another one,
 * in @p value. Bad: it could not be read. [tick]
 */
APC_API apc_status apc_exchange_read_back(const struct apc_exchange *exchange, size_t i, double *value);
/**
 * false: the plant answered the last exchange and has not taken its command, or not all of it. A value was
 * out of its range or too old, or a part of the plant with outputs failed. A plant with frames reports it by
 * a reply without a number. [tick]
 */
APC_API bool apc_exchange_taken(const struct apc_exchange *exchange);
/** Text of the last failure, also of a part; "" when the last exchange had none. Lives until the next call. [tick] */
APC_API const char *apc_exchange_error(const struct apc_exchange *exchange);

/** Counts of `inproc:`: of requests and replies together, and of exchanges that timed out. */
struct apc_inproc_stats {
    size_t size; /**< sizeof the struct, set by the caller: no more than that is filled */
    uint64_t exchanges, timeouts;
    struct apc_network_stats frames; /**< last, as it may grow */
};
/** Since it was opened. Zeros for another scheme. [tick] */
APC_API void apc_inproc_stats(const struct apc_exchange *exchange, struct apc_inproc_stats *stats);

#ifdef __cplusplus
}
#endif
#endif

/* SPDX-License-Identifier: BSD-3-Clause */
/*
 * Packed samples: up to APC_PACK_MAX of one variable whose seqs follow each other, as bytes that the stores
 * keep in one row. Pure: no file, no server, nothing allocated. What comes out is what went in, bit for bit.
 *
 * Bytes (numbers of several bytes have the big end first, bits the high one): 1 format, 2 how many samples,
 * then the columns one after the other. A column begins with its mode:
 *
 *   0  all are 0
 *   1  start, step, 8 bytes each: x[i] = start + i step
 *   2  blocks: x[i]
 *   3  start, slope, 8 bytes each, then blocks: x[i] - start - (i slope >> 12)
 *   4  start, 8 bytes, then blocks: x[i] - x[i - 1], and 0 for i = 0
 *   5  of values: the bits of doubles a and b, 8 bytes each, then two columns k and e: the bits of the value
 *      are those of a + b k, plus e
 *
 * Then 0xff, which is no mode, and 4 bytes of the sum of all before: the low half of XXH3. Former chunks end with
 * their columns, and unpack() in SQL looks no further.
 *
 * A block holds 128 numbers, the last one what is left: 8 bytes base, 1 byte width, then of each number width
 * bits, which are added to the base. With width 64 the base is 0, and the bits are the number.
 *
 * sql/0001-baseline.sql reads the same in SQL.
 */
#ifndef APC_PACK_H
#define APC_PACK_H

#include <stddef.h>
#include <stdint.h>

#define APC_PACK_MAX 1024
/** Fewer samples than that, of what has just come, cost a database less as rows. */
#define APC_PACK_OPEN 4
/** Bytes that are enough for any. */
#define APC_PACK_BYTES (3 + 8 * (33 + (APC_PACK_MAX / 128) * (9 + 128 * 8)) + 5)

/** What a sample has besides its seq. A reference that is none is 0. */
enum {
    APC_PACK_TIME, /* us since the store's own epoch */
    APC_PACK_STATUS,
    APC_PACK_VALUE, /* the bits of the double */
    APC_PACK_ORIGIN,
    APC_PACK_AUTHOR,
    APC_PACK_SENSOR_SEQ, /* of outputs of version 1 */
    APC_PACK_SETPOINT_SEQ,
    APC_PACK_COLUMNS
};

struct apc_pack {
    size_t n;
    int64_t first; /* seq of the first; not part of the bytes */
    int64_t at[APC_PACK_COLUMNS][APC_PACK_MAX];
};

/** What a chunk's row says of it, so that a trend need not look inside. */
struct apc_pack_summary {
    int64_t since, until;         /* earliest and latest time */
    int64_t good, final;          /* samples that are not Bad; seq of the last of them, 0: none */
    double lowest, highest, mean; /* of these; 0 when there are none */
    double last;                  /* the value of seq final */
    int64_t worst;                /* the highest status of all */
};

/** 1 to APC_PACK_MAX samples into @p bytes. Returns how many bytes, or 0: unpacked they would not be the
 * same. */
size_t apc_pack(const struct apc_pack *samples, uint8_t bytes[APC_PACK_BYTES]);
/** Back; of whatever bytes, nothing beyond them is read. Leaves first as it is. Returns 0 or APC_EPROTO: it is no
 * chunk, or one of its bytes has changed. */
int apc_unpack(const uint8_t *bytes, size_t length, struct apc_pack *samples);
void apc_pack_summarize(const struct apc_pack *samples, struct apc_pack_summary *summary);

static inline double apc_pack_value(int64_t bits)
{
    union {
        int64_t bits;
        double value;
    } u = {.bits = bits};
    return u.value;
}

static inline int64_t apc_pack_bits(double value)
{
    union {
        double value;
        int64_t bits;
    } u = {.value = value};
    return u.bits;
}

#endif

/* SPDX-License-Identifier: BSD-3-Clause */
/* PostgreSQL's binary values, as the ways by hand write them. */
#ifndef APC_BENCH_PGBINARY_H
#define APC_BENCH_PGBINARY_H

#include <endian.h>
#include <stdint.h>
#include <string.h>

#define PG_EPOCH_US INT64_C(946684800000000) /* 2000-01-01 */

/* An array in binary: dimensions, NULLs, type, length, lower bound; then each with its own length. */
static inline char *begin_array(char *at, uint32_t type, size_t n)
{
    const uint32_t head[5] = {htobe32(1), 0, htobe32(type), htobe32((uint32_t)n), htobe32(1)};

    memcpy(at, head, sizeof head);
    return at + sizeof head;
}

static inline char *add_int4(char *at, uint32_t value)
{
    const uint32_t cell[2] = {htobe32(4), htobe32(value)};

    memcpy(at, cell, sizeof cell);
    return at + sizeof cell;
}

static inline char *add_int8(char *at, int64_t value)
{
    const uint32_t length = htobe32(8);
    const uint64_t big = htobe64((uint64_t)value);

    memcpy(at, &length, 4);
    memcpy(at + 4, &big, 8);
    return at + 12;
}

static inline int64_t bits(double value)
{
    int64_t i;
    memcpy(&i, &value, sizeof i);
    return i;
}

#endif

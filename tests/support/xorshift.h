/* SPDX-License-Identifier: BSD-3-Clause */
/* Random draws of tests and benchmarks: the same everywhere for a seed, which must not be 0 (Marsaglia 2003). */
#ifndef APC_TESTS_XORSHIFT_H
#define APC_TESTS_XORSHIFT_H

#include <stdint.h>

/* 64 bits; @p state is the seed, and then the last draw. */
static inline uint64_t xorshift(uint64_t *state)
{
    *state ^= *state << 13;
    *state ^= *state >> 7;
    return *state ^= *state << 17;
}

#endif

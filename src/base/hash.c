/* SPDX-License-Identifier: BSD-3-Clause */
/* FNV-1a of 32 bits: marks by which a thing is known again, no protection against anybody. */
#include "base/base_internal.h"

#include <string.h>

uint32_t apc_hash(uint32_t hash, const void *data, size_t n)
{
    for (size_t i = 0; i < n; i++)
        hash = (hash ^ ((const unsigned char *)data)[i]) * 16777619u;
    return hash;
}

uint32_t apc_hash_number(uint32_t hash, uint64_t number)
{
    unsigned char byte[8]; /* lowest first, on every machine */

    for (size_t i = 0; i < sizeof(byte); i++)
        byte[i] = (unsigned char)(number >> 8 * i);
    return apc_hash(hash, byte, sizeof(byte));
}

uint32_t apc_hash_values(uint32_t hash, const double *value, size_t n)
{
    for (size_t i = 0; i < n; i++) {
        uint64_t bits;

        memcpy(&bits, &value[i], sizeof(bits));
        hash = apc_hash_number(hash, bits);
    }
    return hash;
}

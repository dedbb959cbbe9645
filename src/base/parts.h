/* SPDX-License-Identifier: BSD-3-Clause */
/* Arrays that come and go together, in one block of memory. In the header, as programs use it as well. */
#ifndef APC_PARTS_H
#define APC_PARTS_H

#include <stdalign.h>
#include <stddef.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>

#ifdef __SANITIZE_ADDRESS__
#include <sanitizer/asan_interface.h>
#define APC_PART_GAP 64 /* bytes behind each array, which must not be touched */
#else
#define APC_PART_GAP 0
#endif

struct apc_part {
    void *at; /* of the pointer that gets the array's address */
    size_t n, size;
    const void *from; /* what is copied there; NULL: zeros */
};

/* clang-format off */
#define APC_PART(array, n)            {&(array), (n), sizeof(*(array)), NULL}
#define APC_PART_COPY(array, n, from) {&(array), (n), sizeof(*(array)), (from)}
/* clang-format on */

/* Bytes from the beginning of an array to that of the next one; 0 where they are beyond counting. */
static inline size_t apc_part_bytes(const struct apc_part *part)
{
    const size_t step = alignof(max_align_t);

    if (part->n > SIZE_MAX / 4 / part->size)
        return 0;
    return (part->n * part->size + step - 1) / step * step + step + APC_PART_GAP;
}

/*
 * Room for all of them: the block, to be freed by free(); NULL where there is no memory, and no pointer is
 * changed. An array of no elements has an address too, at which nothing may be read.
 */
static inline void *apc_parts_allocate(const struct apc_part *part, size_t n)
{
    size_t bytes = 0;
    char *memory, *at;

    for (size_t i = 0; i < n; i++) {
        if (apc_part_bytes(&part[i]) == 0 || bytes > SIZE_MAX / 4)
            return NULL;
        bytes += apc_part_bytes(&part[i]);
    }
    at = memory = (char *)calloc(1, bytes);
    for (size_t i = 0; i < n && memory; i++) {
        const size_t own = part[i].n * part[i].size;

        memcpy(part[i].at, &at, sizeof(at));
        if (part[i].from && own > 0)
            memcpy(at, part[i].from, own);
        at += apc_part_bytes(&part[i]);
#ifdef __SANITIZE_ADDRESS__
        ASAN_POISON_MEMORY_REGION(at - APC_PART_GAP, APC_PART_GAP);
#endif
    }
    return memory;
}

#endif

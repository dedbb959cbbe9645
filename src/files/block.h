/* SPDX-License-Identifier: BSD-3-Clause */
#ifndef APC_BLOCK_H
#define APC_BLOCK_H

#include <stdbool.h>
#include <stddef.h>

/* The block that @p array points at, of malloc(), gets room for @p n elements of @p size bytes; a large one
 * in large pages, if the kernel has some: else each of the small ones is a fault when it is first written,
 * which takes longer than what is written. Returns false, with the block as it was: out of memory. */
bool apc_grow(void *array, size_t n, size_t size);

#endif

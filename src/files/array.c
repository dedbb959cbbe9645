/* SPDX-License-Identifier: BSD-3-Clause */
#include "files.h"

#include <stdint.h>
#include <stdlib.h>
#include <sys/mman.h>

enum { LARGE = 4 << 20, PAGE = 1 << 12 };

bool apc_grow(void *array, size_t n, size_t size)
{
    void **const at = array, *const more = reallocarray(*at, n, size);

    if (!more)
        return false;
    *at = more;
    if (n * size >= LARGE) {
        const uintptr_t from = ((uintptr_t)more + PAGE - 1) / PAGE * PAGE;

        madvise((void *)from, ((uintptr_t)more + n * size - from) / PAGE * PAGE, MADV_HUGEPAGE);
    }
    return true;
}

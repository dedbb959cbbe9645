/* SPDX-License-Identifier: BSD-3-Clause */
/* What Debian's static expat takes from glibc 2.36, on what glibc 2.25 has: the programs of a wheel run from glibc 2.34 on. */
#include <stdlib.h>
#include <unistd.h>

void arc4random_buf(void *buffer, size_t size);

void arc4random_buf(void *buffer, size_t size)
{
    for (unsigned char *at = buffer; size > 0;) {
        const size_t n = size < 256 ? size : 256; /* getentropy() gives no more at once */
        if (getentropy(at, n) != 0)
            abort(); /* as glibc's does */
        at += n;
        size -= n;
    }
}

/* SPDX-License-Identifier: BSD-3-Clause */
#ifndef APC_UTF8_H
#define APC_UTF8_H

#include <stddef.h>

/* Bytes of the well-formed UTF-8 sequence at @p text, which ends with 0 (Unicode 15, table 3-7); 0: it is
 * none. [tick] */
static inline size_t utf8_length(const char *text)
{
    const unsigned char *const c = (const unsigned char *)text;
    const size_t n = c[0] < 0x80                   ? 1
                     : c[0] >= 0xC2 && c[0] < 0xE0 ? 2
                     : c[0] >= 0xE0 && c[0] < 0xF0 ? 3
                     : c[0] >= 0xF0 && c[0] < 0xF5 ? 4
                                                   : 0;

    for (size_t i = 1; i < n; i++)
        if ((c[i] & 0xC0) != 0x80)
            return 0;
    if ((c[0] == 0xE0 && c[1] < 0xA0) || (c[0] == 0xED && c[1] > 0x9F) || (c[0] == 0xF0 && c[1] < 0x90) ||
        (c[0] == 0xF4 && c[1] > 0x8F))
        return 0; /* overlong, surrogate, beyond Unicode */
    return n;
}

#endif

/* SPDX-License-Identifier: BSD-3-Clause */
/* Text on its way into a store. */
#include "shareddata/shareddata_internal.h"

#include <string.h>

/* Length of the well-formed UTF-8 character at @p text, or 0. */
static size_t character(const unsigned char *text)
{
    unsigned char c = text[0];
    size_t length = c < 0x80                ? 1
                    : c >= 0xC2 && c < 0xE0 ? 2
                    : (c & 0xF0) == 0xE0    ? 3
                    : c >= 0xF0 && c < 0xF5 ? 4
                                            : 0;
    for (size_t i = 1; i < length; i++) {
        if ((text[i] & 0xC0) != 0x80) {
            return 0;
        }
    }
    if ((c == 0xE0 && text[1] < 0xA0) || (c == 0xED && text[1] > 0x9F) || (c == 0xF0 && text[1] < 0x90) ||
        (c == 0xF4 && text[1] > 0x8F)) {
        return 0; /* overlong, surrogate, beyond Unicode */
    }
    return length;
}

const char *apc_text_clean(char *out, const char *in, size_t size)
{
    size_t length = strnlen(in, size - 1);
    memset(out, 0, size);
    memcpy(out, in, length);
    for (size_t i = 0; i < length;) {
        size_t step = character((const unsigned char *)out + i);
        if (step == 0) {
            out[i] = '?';
            step = 1;
        }
        i += step;
    }
    return out;
}

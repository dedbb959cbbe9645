/* SPDX-License-Identifier: BSD-3-Clause */
/* Text on its way into a store. */
#include "shareddata/shareddata_internal.h"

#include <string.h>

#include "base/utf8.h"

const char *apc_text_clean(char *out, const char *in, size_t size)
{
    size_t length = strnlen(in, size - 1);
    memset(out, 0, size);
    memcpy(out, in, length);
    for (size_t i = 0; i < length;) {
        size_t step = utf8_length(out + i);
        if (step == 0) {
            out[i] = '?';
            step = 1;
        }
        i += step;
    }
    return out;
}

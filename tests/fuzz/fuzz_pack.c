/* SPDX-License-Identifier: BSD-3-Clause */
/* Whatever bytes come, they are no chunk, or one whose samples, packed again, are the same. */
#include "shareddata/pack.h"

#include <stdlib.h>
#include <string.h>

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size);

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
    static struct apc_pack samples, back;
    static uint8_t bytes[APC_PACK_BYTES];

    if (apc_unpack(data, size, &samples) != 0)
        return 0;
    const size_t length = apc_pack(&samples, bytes);
    if (length == 0 || length > sizeof bytes || apc_unpack(bytes, length, &back) != 0 || back.n != samples.n)
        abort();
    for (size_t c = 0; c < APC_PACK_COLUMNS; c++)
        if (memcmp(samples.at[c], back.at[c], samples.n * sizeof back.at[c][0]) != 0)
            abort();
    return 0;
}

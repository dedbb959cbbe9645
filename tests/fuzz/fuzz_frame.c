/* SPDX-License-Identifier: BSD-3-Clause */
/* Whatever bytes come, the decoder refuses them or reads what the encoder writes back the same. */
#include "apcsockets.h"

#include <stdlib.h>
#include <string.h>

#define COUNT 512

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size);

static void must(bool holds)
{
    if (!holds)
        abort();
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
    static struct apc_sample samples[COUNT], back[COUNT];
    static char text[COUNT * 96 + 64], again[sizeof text];
    struct apc_frame frame, out;
    int length, err = apc_frame_decode((const char *)data, size, &frame, samples, COUNT);

    must(err == 0 || err == APC_EPROTO || err == APC_ERANGE);
    if (err < 0) {
        must(frame.kind == 0 && frame.id == 0 && frame.n == 0);
        return 0;
    }
    length = apc_frame_encode(text, sizeof text, &frame, samples);
    must(length > 0);
    must(apc_frame_decode(text, (size_t)length, &out, back, COUNT) == 0);
    must(out.kind == frame.kind && out.id == frame.id && out.n == frame.n);
    for (size_t i = 0; i < frame.n; i++)
        must(back[i].time == samples[i].time && back[i].status == samples[i].status &&
             !memcmp(&back[i].value, &samples[i].value, sizeof(double)));
    must(apc_frame_encode(again, sizeof again, &out, back) == length && !memcmp(text, again, (size_t)length));
    return 0;
}

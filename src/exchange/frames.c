/* SPDX-License-Identifier: BSD-3-Clause */
/*
 * Vectors as frames, for all schemes that carry frames. A plant behind frames takes a command as a whole or
 * not at all, so that it never has half of a vector: one value that is not to be written makes a query of it.
 * A reply is known by the number of its request; a peer that does not number (the paper's) says 0. One that
 * does number says by 0 that it has not taken the command: what it measures counts all the same.
 */
#include "exchange/exchange_internal.h"

#include <stdlib.h>

int apc_frames_init(struct apc_frames *frames, size_t nu, size_t ny)
{
    const size_t n = nu > ny ? nu : ny;

    *frames = (struct apc_frames){.nu = nu, .ny = ny, .room = APC_FRAME_ROOM(n)};
    frames->text = malloc(frames->room);
    frames->samples = calloc(n, sizeof(*frames->samples));
    return frames->text && frames->samples ? 0 : APC_ENOMEM;
}

void apc_frames_free(struct apc_frames *frames)
{
    free(frames->text);
    free(frames->samples);
}

void apc_frames_claim(struct apc_frames *frames, uint64_t number)
{
    if (number > frames->claim)
        frames->claim = number;
}

static uint64_t next_id(const struct apc_frames *frames)
{
    return frames->claim ? frames->claim * APC_FRAME_PER_CLAIM + (frames->id + 1) % APC_FRAME_PER_CLAIM
                         : frames->id + 1;
}

int apc_frames_ask(struct apc_frames *frames, const struct apc_value *u, struct apc_error *why)
{
    struct apc_frame frame = {.kind = APC_FRAME_QUERY, .id = frames->id = next_id(frames)};
    size_t i = 0;
    int n;

    for (; u && i < frames->nu && apc_exchange_writes(&u[i]); i++) {
        frames->samples[i].time = u[i].time;
        frames->samples[i].status = u[i].status;
        frames->samples[i].value = u[i].value;
    }
    frames->commands = i == frames->nu;
    if (frames->commands) {
        frame.kind = APC_FRAME_COMMAND;
        frame.n = frames->nu;
    }
    n = apc_frame_encode(frames->text, frames->room, &frame, frames->samples);
    return n < 0 ? apc_fail(why, n,
                            "the command cannot be written as a frame: its time stamps are not within "
                            "the years 1678 to 2261")
                 : n;
}

int apc_frames_answer(struct apc_frames *frames, const char *text, size_t length, struct apc_value *y,
                      struct apc_error *why)
{
    struct apc_frame frame;
    const int rc = apc_frame_decode(text, length, &frame, frames->samples, frames->ny);

    if (rc == APC_ERANGE || (rc == 0 && frame.n < frames->ny))
        return apc_fail(why, APC_EPROTO, "its reply has %s than %zu values", rc == 0 ? "fewer" : "more",
                        frames->ny);
    if (rc < 0)
        return apc_fail(why, APC_EPROTO,
                        "its reply is no frame, or one of its values is not a finite number with a time");
    if (frame.kind != APC_FRAME_VALUES || (frame.id && frame.id != frames->id))
        return apc_fail(why, APC_EPROTO, "its reply does not answer the request");
    frames->refused = frames->commands && frames->numbers && !frame.id;
    frames->numbers = frames->numbers || frame.id;
    for (size_t i = 0; i < frames->ny; i++)
        y[i] = (struct apc_value){.value = frames->samples[i].value,
                                  .status = frames->samples[i].status,
                                  .time = frames->samples[i].time};
    return 0;
}

/* SPDX-License-Identifier: BSD-3-Clause */
#include "base/base_internal.h"

#include <string.h>

#define OPTIONS_LIMIT 4096 /* no options struct is longer: a larger size is garbage, and not to be read */

int apc_options_copy(void *ours, size_t size, const void *theirs, const char *what, struct apc_error *why)
{
    size_t given;

    if (!theirs)
        return 0;
    memcpy(&given, theirs, sizeof given);
    if (given < sizeof given || given > OPTIONS_LIMIT)
        return apc_fail(why, APC_EINVAL, "%s: size is %zu: set it to sizeof the struct", what, given);
    for (size_t i = size; i < given; i++)
        if (((const unsigned char *)theirs)[i])
            return apc_fail(why, APC_EINVAL,
                            "%s: an option is set that this version of the library does not know", what);
    memcpy(ours, theirs, given < size ? given : size);
    return 0;
}

void apc_result_copy(void *theirs, const void *ours, size_t size)
{
    const size_t head = sizeof(size_t);
    size_t room;

    if (!theirs)
        return;
    memcpy(&room, theirs, sizeof room);
    if (room > size)
        room = size;
    if (room > head)
        memcpy((char *)theirs + head, (const char *)ours + head, room - head);
}

/* SPDX-License-Identifier: BSD-3-Clause */
#include "room.h"

#include <stdio.h>

void room_text(const struct apc_store_room *room, const char *name, char text[ROOM_LEN])
{
    const bool named = name && name[0];
    snprintf(text, ROOM_LEN,
             "the store is full: it has no room for %s %d%s%.64s%s: keep it with `apc copy`, and make a "
             "larger one, shm:NAME?size=MIB",
             apc_table_name(room->table), room->id, named ? " (" : "", named ? name : "", named ? ")" : "");
}

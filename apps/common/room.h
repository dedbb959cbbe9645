/* SPDX-License-Identifier: BSD-3-Clause */
/* What is said of a store that is full, wherever it is said. */
#ifndef COMMON_ROOM_H
#define COMMON_ROOM_H

#include <apcstore.h>

#define ROOM_LEN 300

/* @name: of the variable that found no room; NULL: it has none, or it is not for everybody. */
void room_text(const struct apc_store_room *room, const char *name, char text[ROOM_LEN]);

#endif

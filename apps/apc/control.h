/* SPDX-License-Identifier: BSD-3-Clause */
/* Was the plant controlled? From what apc-plant, who knows, left in the records: its start, and each time
 * that its watchdog took it to its safe value or let it take commands. */
#ifndef APC_CONTROL_H
#define APC_CONTROL_H

#include <apcshareddata.h>

struct control {
    bool commanded, ever;  /* it takes commands; it ever did */
    apc_ns since;          /* when that was last otherwise, or the beginning */
    apc_ns longest, start; /* the longest time at its safe value; when that began */
};

void control_begin(struct control *c, apc_ns begin);
/* Events in rising order; others' are no matter. */
void control_take(struct control *c, const struct apc_event *event);
void control_end(struct control *c, apc_ns end);

#endif

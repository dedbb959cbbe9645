/* SPDX-License-Identifier: BSD-3-Clause */
/* Was the plant controlled? From what the one who knows left in the records, apc-plant or, of an external
 * plant, apc-client: its start, and each time that the plant's watchdog took it to its safe value or let it
 * take commands, or that the client began or ceased to give it some. */
#ifndef APC_CONTROL_H
#define APC_CONTROL_H

#include <apcstore.h>

struct control {
    const char *witness;   /* whose events count */
    bool commanded, ever;  /* it takes commands; it ever did */
    apc_ns since;          /* when that was last otherwise, or the beginning */
    bool excused;          /* it is out of service: that nobody commands it is meant so */
    apc_ns longest, start; /* the longest time at its safe value; when that began */
};

void control_begin(struct control *c, bool external, apc_ns begin);
/* Events in rising order; others' are no matter. */
void control_take(struct control *c, const struct apc_event *event);
/* From that time on a loop is out of service, or none is; in the order of time, events' included. */
void control_excuse(struct control *c, apc_ns time, bool excused);
void control_end(struct control *c, apc_ns end);

#endif

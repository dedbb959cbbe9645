/* SPDX-License-Identifier: BSD-3-Clause */
#include "control.h"

#include <string.h>

void control_begin(struct control *c, apc_ns begin)
{
    *c = (struct control){.since = begin};
}

void control_take(struct control *c, const struct apc_event *e)
{
    bool watchdog = !strcmp(e->kind, "watchdog"), start = !strcmp(e->kind, "start");
    if (strcmp(e->source, "apc-plant") != 0 || (!watchdog && !start))
        return;
    bool commanded = watchdog && e->severity == APC_EVENT_INFO;
    if (commanded == c->commanded)
        return;
    if (commanded)
        control_end(c, e->time);
    c->ever |= commanded;
    c->commanded = commanded;
    if (e->time > c->since)
        c->since = e->time;
}

void control_end(struct control *c, apc_ns end)
{
    if (c->commanded || end - c->since <= c->longest)
        return;
    c->longest = end - c->since;
    c->start = c->since;
}

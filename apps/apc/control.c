/* SPDX-License-Identifier: BSD-3-Clause */
#include "control.h"

#include <string.h>

void control_begin(struct control *c, bool external, apc_ns begin)
{
    *c = (struct control){.witness = external ? "apc-client" : "apc-plant", .since = begin};
}

void control_take(struct control *c, const struct apc_event *e)
{
    bool turn = !strcmp(e->kind, "watchdog") || !strcmp(e->kind, "command"),
         start = !strcmp(e->kind, "start");
    if (strcmp(e->source, c->witness) != 0 || (!turn && !start))
        return;
    bool commanded = turn && e->severity == APC_EVENT_INFO;
    if (commanded == c->commanded)
        return;
    if (commanded)
        control_end(c, e->time);
    c->ever |= commanded;
    c->commanded = commanded;
    if (e->time > c->since)
        c->since = e->time;
}

void control_excuse(struct control *c, apc_ns time, bool excused)
{
    if (excused == c->excused)
        return;
    if (excused)
        control_end(c, time);
    else if (time > c->since)
        c->since = time;
    c->excused = excused;
}

void control_end(struct control *c, apc_ns end)
{
    if (c->commanded || c->excused || end - c->since <= c->longest)
        return;
    c->longest = end - c->since;
    c->start = c->since;
}

/* SPDX-License-Identifier: BSD-3-Clause */
#include "control_verdict.h"

#include <string.h>

void control_begin(struct control *c, bool external, apc_ns link, apc_ns begin)
{
    *c = (struct control){
        .external = external, .link = link, .begin = begin, .at = begin, .end = begin, .cleared = INT64_MIN};
}

/* The condition was so from one instant to another. */
static void last(struct spells *s, bool on, apc_ns from, apc_ns to)
{
    if (on && !s->on) {
        s->since = from;
        s->times++;
    }
    s->on = on;
    if (!on)
        return;
    s->total += to - from;
    if (to - s->since > s->longest) {
        s->longest = to - s->since;
        s->start = s->since;
    }
}

/* All that is known holds until @p time. */
static void pass(struct control *c, apc_ns time)
{
    const bool bare = !c->commanded && !c->excused;

    if (time <= c->at)
        return;
    c->controlled |= c->commanded && !c->fault;
    last(&c->bare, bare, c->at, time);
    last(&c->faulty, c->fault, c->at, time);
    last(&c->open, bare || c->fault, c->at, time);
    c->at = time;
}

bool control_hears(const struct control *c, const struct apc_event *e, bool *commanded)
{
    const bool turn = !strcmp(e->kind, c->external ? "command" : "watchdog");
    *commanded = turn && e->severity == APC_EVENT_INFO;
    return !strcmp(e->source, c->external ? "apc-client" : "apc-plant") &&
           (turn || !strcmp(e->kind, "start"));
}

void control_command(struct control *c, apc_ns time, bool commanded)
{
    /* What was better than a fault value, but so short before a trip, never came to the plant. */
    const bool late = c->commanded && !commanded && c->cleared > time - c->link;
    c->fault = late && !c->fault ? c->was_faulty : c->fault;
    pass(c, time);
    c->fault = c->cleared > INT64_MIN ? NULL : c->fault;
    c->commanded = commanded;
    c->ever |= commanded;
}

void control_excuse(struct control *c, apc_ns time, bool excused)
{
    pass(c, time);
    c->excused = excused;
}

void control_fault(struct control *c, apc_ns time, const char *output)
{
    pass(c, time);
    c->cleared = c->fault && !output ? time : INT64_MIN;
    c->fault = output;
    c->was_faulty = output ? output : c->was_faulty;
}

void control_end(struct control *c, apc_ns end)
{
    pass(c, end);
    c->end = end;
}

/* What was the matter while it was open. */
static void name_trouble(const struct control *c, bool outputs, char what[160])
{
    if (outputs)
        snprintf(what, 160, "the output %.100s stood at its fault value", c->was_faulty);
    else
        snprintf(what, 160, "the plant %s", c->external ? "was given no command" : "stood at its safe value");
}

enum control_verdict control_judge(const struct control *c, apc_ns zero, apc_ns hold, char *why, size_t size)
{
    const struct spells *open = &c->open;
    char what[160];

    if (open->total == 0)
        return CONTROL_CLOSED;
    name_trouble(c, c->faulty.longest > c->bare.longest, what);
    if (!c->ever)
        snprintf(why, size, "the loop was never closed: the plant got no command");
    else if (!c->controlled)
        snprintf(why, size, "the loop was never closed: %s", what);
    else if (open->longest > hold)
        snprintf(why, size, "the loop was open: from %.1f s on %s for %.1f s (hold: %g s)",
                 apc_ns_to_s(open->start - zero), what, apc_ns_to_s(open->longest), apc_ns_to_s(hold));
    else if (open->total > hold && open->total > (c->end - c->begin) / CONTROL_SHARE)
        return snprintf(why, size, "the loop was open again and again: %u times, %.1f s of %.1f s in sum; %s",
                        open->times, apc_ns_to_s(open->total), apc_ns_to_s(c->end - c->begin), what),
               CONTROL_AGAIN;
    else
        return CONTROL_CLOSED;
    return CONTROL_OPEN;
}

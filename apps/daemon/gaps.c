/* SPDX-License-Identifier: BSD-3-Clause */
#include "gaps.h"

#include <stdio.h>

static struct apc_event event_of(const struct gap_teller *t, enum apc_event_severity severity)
{
    struct apc_event event = {.time = apc_clock_utc(NULL), .severity = severity, .kind = "history"};
    snprintf(event.source, sizeof event.source, "%s", t->source);
    return event;
}

int gap_tell(void *ctx, const struct apc_replication_gap *gap)
{
    const struct gap_teller *t = ctx;
    struct apc_event event[3];
    char since[APC_TIME_LEN], until[APC_TIME_LEN];
    size_t n = 0;

    if (gap->variables > 0) {
        event[n] = event_of(t, APC_EVENT_ALARM);
        snprintf(event[n].text, sizeof event[n].text,
                 "the record has a gap: of %llu variables nothing is there between %s and %s",
                 (unsigned long long)gap->variables, apc_time_format(gap->since, since),
                 apc_time_format(gap->until, until));
        n++;
    }
    if (gap->events > 0) {
        event[n] = event_of(t, APC_EVENT_ALARM);
        snprintf(event[n].text, sizeof event[n].text,
                 "the record has a gap: up to %llu events were overwritten before the history had them",
                 (unsigned long long)gap->events);
        n++;
    }
    if (gap->timing > 0) {
        event[n] = event_of(t, APC_EVENT_WARNING);
        snprintf(event[n].text, sizeof event[n].text,
                 "up to %llu rows of timing were overwritten before the history had them",
                 (unsigned long long)gap->timing);
        n++;
    }
    const int rc = apc_store_append_events(t->live, event, n);
    for (size_t i = 0; rc >= 0 && t->log && i < n; i++)
        apc_log_write(t->log, event[i].severity == APC_EVENT_ALARM ? APC_LOG_ERROR : APC_LOG_WARN, "%s",
                      event[i].text);
    return rc < 0 ? rc : 0;
}

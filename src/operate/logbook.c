/* SPDX-License-Identifier: BSD-3-Clause */
/* What people enter in the log book, and sign at a handover: events of two kinds of their own. */
#include <stdio.h>
#include <string.h>

#include "base/text.h"
#include "operate.h"

#define LOGBOOK_AGAIN (60 * APC_NS_PER_S) /* the same of the same author is one entry for so long */
#define LOGBOOK_BACK  (INT64_C(7) * 86400 * APC_NS_PER_S) /* so far back somebody else's entry is looked for */

/* ---- What is entered ----------------------------------------------------------------------- */

static bool is_of_plant(const struct plant_view *plant, const char *signal)
{
    for (size_t i = 0; i < plant->n; i++)
        if (!strcmp(plant->tag[i].name, signal))
            return true;
    return false;
}

/* One line of characters that each show as what they are, and not of blanks alone. */
static bool is_one_line(const char *text)
{
    bool shows = false;
    for (const char *c = text; *c; c += utf8_length(c)) {
        char instead;
        text_step(c, &instead);
        if (instead)
            return false;
        shows |= *c != ' ';
    }
    return shows;
}

int logbook_make(const struct plant_view *plant, const struct logbook_entry *entry, struct apc_event *event,
                 struct change_fault *why)
{
    const char *signal = entry->signal ? entry->signal : "";
    const size_t length = strlen(entry->text) + strlen(signal) + (signal[0] ? 2 : 0);
    *event = (struct apc_event){.severity = APC_EVENT_INFO};
    if (signal[0] && !is_of_plant(plant, signal))
        return change_fail(why, APC_ENOTFOUND, "variable", "there is no signal \"%.60s\" of which to write",
                           signal);
    if (!is_one_line(entry->text))
        return change_fail(why, APC_EINVAL, "value",
                           "an entry must be one line of UTF-8, and not empty, without control characters");
    if (length > LOGBOOK_TEXT)
        return change_fail(why, APC_EINVAL, "value",
                           "an entry must have at most %d bytes with its signal, not %zu", LOGBOOK_TEXT,
                           length);
    snprintf(event->kind, sizeof event->kind, "%s", entry->signs ? "handover" : "log");
    snprintf(event->source, sizeof event->source, "%.31s", entry->author);
    snprintf(event->text, sizeof event->text, "%s%s%s", signal, signal[0] ? ": " : "", entry->text);
    return 0;
}

/* ---- Into the store ------------------------------------------------------------------------ */

struct logbook_look {
    struct apc_event *event;
    apc_ns seen;
    struct apc_event other; /* newest entry that whoever signs has not seen; time 0: none */
    bool is_there;
};

bool logbook_is_entry(const struct apc_event *event)
{
    return !strcmp(event->kind, "log") || !strcmp(event->kind, "handover");
}

static int take_logbook_event(void *ctx, const struct apc_event *old)
{
    struct logbook_look *l = ctx;
    if (!logbook_is_entry(old))
        return 0;
    if (old->time > l->event->time - LOGBOOK_AGAIN && !strcmp(old->kind, l->event->kind) &&
        !strcmp(old->source, l->event->source) && !strcmp(old->text, l->event->text)) {
        l->event->time = old->time;
        l->is_there = true;
    }
    if (l->seen >= 0 && old->time / APC_NS_PER_US > l->seen / APC_NS_PER_US)
        l->other = *old;
    return 0;
}

int logbook_add(struct apc_store *store, apc_ns seen, struct apc_event *event, struct change_fault *why)
{
    struct logbook_look look = {.event = event, .seen = seen};
    event->time = apc_clock_utc(NULL);
    const struct apc_range late = {.since = event->time - (seen >= 0 ? LOGBOOK_BACK : LOGBOOK_AGAIN)};
    int rc = apc_store_events(store, &late, take_logbook_event, &look);
    if (rc < 0)
        return change_fail(why, rc, "store", "%s", apc_store_error(store));
    if (look.is_there)
        return 0;
    if (look.other.time > 0)
        return change_fail(why, APC_ECONFLICT, "stale",
                           "%.31s has entered \"%.100s\" meanwhile: read it, then sign", look.other.source,
                           look.other.text);
    rc = apc_store_append_events(store, event, 1);
    if (rc == APC_ECONN || rc == APC_ETIMEDOUT)
        return change_fail(
            why, rc, "unknown",
            "the store did not answer, so whether it was entered is not known: enter it again, "
            "within a minute it stays one entry");
    return rc < 0 ? change_fail(why, rc, "store", "%s", apc_store_error(store)) : 1;
}

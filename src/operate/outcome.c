/* SPDX-License-Identifier: BSD-3-Clause */
#include "operate.h"

#include <ctype.h>
#include <stdio.h>
#include <string.h>

#define EVENTS 50 /* so many are looked through for a refusal */

apc_ns outcome_age(const struct outcome_seen *seen)
{
    const apc_ns age = seen->now - seen->tick->time;
    return seen->tick->seq > 0 && age > 0 ? age : 0;
}

static bool ticks(const struct outcome_seen *seen)
{
    return seen->tick->seq > 0 &&
           (seen->period <= 0 || outcome_age(seen) <= 3 * seen->period + 100 * APC_NS_PER_MS);
}

/* The status of a setpoint that a loop above may move is what the loops say to each other: whether an
 * operator's value was taken shows in the value. */
static enum outcome of_setpoint(const struct outcome_seen *seen)
{
    const double wanted = seen->write->value, force = seen->actual->value;
    if (seen->actual->status == APC_UNCERTAIN)
        return OUTCOME_WAITING;
    return force >= wanted && force <= wanted ? OUTCOME_APPLIED : OUTCOME_REFUSED;
}

/* It was looked at; is it in force? */
static enum outcome of_own(const struct outcome_seen *seen)
{
    const enum apc_severity severity = apc_status_severity(seen->actual->status);
    if (severity == APC_SEVERITY_BAD)
        return OUTCOME_REFUSED;
    if (seen->write->table == APC_SETPOINT)
        return of_setpoint(seen);
    return severity == APC_SEVERITY_GOOD ? OUTCOME_APPLIED : OUTCOME_WAITING;
}

enum outcome outcome_of(const struct outcome_seen *seen)
{
    const int64_t looked = seen->actual->seq > 0 ? seen->actual->origin : 0;
    const enum outcome own = looked == seen->write->seq ? of_own(seen) : OUTCOME_WAITING;
    if (looked > seen->write->seq)
        return OUTCOME_SUPERSEDED;
    return own == OUTCOME_WAITING && !ticks(seen) ? OUTCOME_NOBODY : own;
}

/* ---- Why it was refused -------------------------------------------------------------------- */

struct refusal {
    const char *name;
    apc_ns since;
    char *text;
    size_t size;
    bool found, named;
};

static bool is_of_name(char c)
{
    return isalnum((unsigned char)c) || c == '_' || c == '-' || (unsigned char)c >= 0x80;
}

/* As a whole, not as a part of another's: r is in r2, in y.r and in "after". */
static bool names(const char *text, const char *name)
{
    const size_t n = strlen(name);
    for (const char *at = text; n > 0 && (at = strstr(at, name)) != NULL; at++) {
        const bool begins = at == text || !(is_of_name(at[-1]) || at[-1] == '.');
        const bool ends = !is_of_name(at[n]) && !(at[n] == '.' && is_of_name(at[n + 1]));
        if (begins && ends)
            return true;
    }
    return false;
}

static int take_outcome_event(void *ctx, const struct apc_event *event)
{
    struct refusal *r = ctx;
    const bool named = names(event->text, r->name);
    if (event->time < r->since || strcmp(event->kind, "rejected") != 0 || (r->named && !named))
        return 0;
    snprintf(r->text, r->size, "%s", event->text);
    r->found = true;
    r->named = named;
    return 0;
}

bool outcome_refusal(struct apc_store *store, const char *name, apc_ns since, char *text, size_t size)
{
    const struct apc_range last = {.last = EVENTS};
    struct refusal r = {.name = name, .since = since, .text = text, .size = size};
    return apc_store_events(store, &last, take_outcome_event, &r) >= 0 && r.found;
}

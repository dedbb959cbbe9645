/* SPDX-License-Identifier: BSD-3-Clause */
/* The states of an alarm and what leads from one to the other: ANSI/ISA-18.2-2016, 5.6, as one table. */
#include "apcalarm.h"

#include <string.h>

#define A  APC_ALARM_NORMAL
#define B  APC_ALARM_UNACKED
#define C  APC_ALARM_ACKED
#define D  APC_ALARM_RETURNED
#define E  APC_ALARM_LATCHED_UNACKED
#define F  APC_ALARM_LATCHED
#define G  APC_ALARM_SHELVED
#define GA APC_ALARM_SHELVED_ACTIVE
#define O  APC_ALARM_ONE_SHOT
#define OA APC_ALARM_ONE_SHOT_ACTIVE
#define H  APC_ALARM_SUPPRESSED
#define HA APC_ALARM_SUPPRESSED_ACTIVE
#define I  APC_ALARM_OUT_OF_SERVICE
#define IA APC_ALARM_OUT_OF_SERVICE_ACTIVE

/* What is shelved, suppressed or out of service can be made another of these directly; what then is no more
 * of them is announced anew where its condition is there, and is normal where it is not: a latch ends there.
 */
static const unsigned char next[APC_ALARM_STATES][APC_ALARM_EVENTS] = {
    /*      comes goes ack reset shelve once unshelve suppress un- remove restore */
    [A] = {0, B, A, A, A, G, O, A, H, A, I, A},     [B] = {0, B, D, C, B, GA, OA, B, HA, B, IA, B},
    [C] = {0, C, A, C, C, GA, OA, C, HA, C, IA, C}, [D] = {0, B, D, A, D, G, O, D, H, D, I, D},
    [E] = {0, B, E, F, E, G, O, E, H, E, I, E},     [F] = {0, B, F, F, A, G, O, F, H, F, I, F},
    [G] = {0, GA, G, G, G, G, O, A, H, G, I, G},    [GA] = {0, GA, G, GA, GA, GA, OA, B, HA, GA, IA, GA},
    [O] = {0, OA, O, O, O, G, O, A, H, O, I, O},    [OA] = {0, OA, A, OA, OA, GA, OA, B, HA, OA, IA, OA},
    [H] = {0, HA, H, H, H, G, O, H, H, A, I, H},    [HA] = {0, HA, H, HA, HA, GA, OA, HA, HA, B, IA, HA},
    [I] = {0, IA, I, I, I, G, O, I, H, I, I, A},    [IA] = {0, IA, I, IA, IA, GA, OA, IA, HA, IA, IA, B},
};

static bool is_state(enum apc_alarm_state state)
{
    return state >= A && state < APC_ALARM_STATES;
}

enum apc_alarm_state apc_alarm_next(enum apc_alarm_state state, enum apc_alarm_event event, bool latching)
{
    if (!is_state(state))
        state = A;
    if (event < APC_ALARM_COMES || event >= APC_ALARM_EVENTS)
        return state;
    if (latching && event == APC_ALARM_GOES && (state == B || state == C))
        return state == B ? E : F;
    return (enum apc_alarm_state)next[state][event];
}

bool apc_alarm_is_active(enum apc_alarm_state state)
{
    return state == B || state == C || state == GA || state == OA || state == HA || state == IA;
}

bool apc_alarm_is_unacked(enum apc_alarm_state state)
{
    return state == B || state == D || state == E;
}

bool apc_alarm_is_latched(enum apc_alarm_state state)
{
    return state == E || state == F;
}

bool apc_alarm_is_masked(enum apc_alarm_state state)
{
    return state >= G && state < APC_ALARM_STATES;
}

bool apc_alarm_is_standing(enum apc_alarm_state state)
{
    return state > A && state < G;
}

const char *apc_alarm_state_name(enum apc_alarm_state state)
{
    static const char *const name[APC_ALARM_STATES] = {
        [A] = "Normal",
        [B] = "Unacknowledged Active",
        [C] = "Acknowledged Active",
        [D] = "RTN Unacknowledged",
        [E] = "Latched Unacknowledged",
        [F] = "Latched Acknowledged",
        [G] = "Shelved",
        [GA] = "Shelved, Active",
        [O] = "One-shot Shelved",
        [OA] = "One-shot Shelved, Active",
        [H] = "Suppressed by Design",
        [HA] = "Suppressed by Design, Active",
        [I] = "Out of Service",
        [IA] = "Out of Service, Active",
    };
    return is_state(state) ? name[state] : NULL;
}

static const char *const kinds[APC_ALARM_KINDS] = {
    [APC_ALARM_LOW_LOW] = "low-low",     [APC_ALARM_LOW] = "low",         [APC_ALARM_HIGH] = "high",
    [APC_ALARM_HIGH_HIGH] = "high-high", [APC_ALARM_RATE] = "rate",       [APC_ALARM_DEVIATION] = "deviation",
    [APC_ALARM_FROZEN] = "frozen",       [APC_ALARM_BAD] = "bad",         [APC_ALARM_AT_LIMIT] = "at-limit",
    [APC_ALARM_MODE] = "mode",           [APC_ALARM_STOPPED] = "stopped", [APC_ALARM_OVERRUN] = "overrun",
};

const char *apc_alarm_kind_name(enum apc_alarm_kind kind)
{
    return kind >= APC_ALARM_LOW_LOW && kind < APC_ALARM_KINDS ? kinds[kind] : NULL;
}

enum apc_alarm_kind apc_alarm_kind_parse(const char *name)
{
    for (int i = APC_ALARM_LOW_LOW; i < APC_ALARM_KINDS; i++)
        if (!strcmp(name, kinds[i]))
            return (enum apc_alarm_kind)i;
    return (enum apc_alarm_kind)0;
}

int apc_alarm_switch_id(enum apc_alarm_switch which, int alarm)
{
    return (int)which * 65536 + apc_variable_number(APC_ALARM, alarm);
}

/* SPDX-License-Identifier: BSD-3-Clause */
/* What alarms are and how they stand, as JSON. */
#include <inttypes.h>

#include "apc-ui/ui.h"

void alarm_author_member(struct apc_store *store, uint32_t author, struct text *t)
{
    char name[APC_AUTHOR_LEN] = "";
    if (author > 0 && apc_store_author_name(store, author, name) < 0)
        name[0] = '\0';
    text_add(t, ",\"author\":");
    json_string_add(t, name[0] ? name : NULL);
}

void alarm_time_member(const char *name, apc_ns time, struct text *t)
{
    text_add(t, ",\"%s\":", name);
    if (time > 0)
        json_time_add(t, time);
    else
        text_add(t, "null");
}

void alarm_described_members(const struct alarm *alarm, struct text *t)
{
    const char *const texts[][2] = {{"area", alarm->area},
                                    {"message", alarm->message},
                                    {"consequence", alarm->consequence},
                                    {"response", alarm->response}};
    text_add(t, ",\"kind\":\"%s\",\"priority\":%d", apc_alarm_kind_name(alarm->is.kind), alarm->is.priority);
    for (size_t i = 0; i < sizeof texts / sizeof *texts; i++) {
        text_add(t, ",\"%s\":", texts[i][0]);
        json_string_add(t, texts[i][1]);
    }
}

#define TRANSITIONS_BACK 64 /* of one alarm, that are looked through for when it was raised */

static int keep_raised(void *ctx, const struct apc_sample *row)
{
    if ((int)row->value == APC_ALARM_UNACKED)
        *(apc_ns *)ctx = row->time;
    return 0;
}

/* When it was raised last, as long as it is not Normal; 0: it was not, or nobody knows. */
static apc_ns raised_at(const struct alarm_now *now, struct apc_store *store)
{
    const struct apc_range range = {.last = TRANSITIONS_BACK};
    const enum apc_alarm_state state = alarm_summary_state(now);
    apc_ns raised = 0;
    if (state == APC_ALARM_UNACKED)
        return now->row->time;
    if (state != APC_ALARM_NORMAL)
        (void)apc_store_history(store, APC_ALARM, now->row->id, &range, keep_raised, &raised);
    return raised;
}

void alarm_stands_members(const struct alarm_now *now, struct apc_store *store, struct text *t)
{
    const enum apc_alarm_state state = alarm_summary_state(now);
    text_add(t,
             "\"id\":%d,\"seq\":%" PRId64 ",\"journal\":%" PRId64
             ",\"state\":\"%s\",\"active\":%s,\"unacknowledged\":%s,\"standing\":%s",
             now->row->id, now->row->seq, now->row->origin, apc_alarm_state_name(state),
             json_truth(apc_alarm_is_active(state)), json_truth(apc_alarm_is_unacked(state)),
             json_truth(apc_alarm_is_standing(state)));
    alarm_time_member("time", now->row->seq > 0 ? now->row->time : 0, t);
    alarm_time_member("raised", raised_at(now, store), t);
    alarm_author_member(store, now->row->author, t);
    alarm_time_member("shelved_until", alarm_summary_shelved(now), t);
}

static bool has_limit(enum apc_alarm_kind kind)
{
    return (kind >= APC_ALARM_LOW_LOW && kind <= APC_ALARM_DEVIATION) || kind == APC_ALARM_RATE ||
           kind == APC_ALARM_OVERRUN;
}

void alarms_described_json(const struct experiment *e, struct text *t)
{
    char ref[REF_LEN];
    text_add(t, "{\"shelve_max\":");
    json_seconds_add(t, e->alarms.shelve_max);
    text_add(t, ",\"all\":[");
    for (size_t i = 0; i < e->n_alarms; i++) {
        const struct alarm *alarm = &e->alarm[i];
        text_add(t, "{\"id\":%zu,\"alarm\":", i + 1);
        json_string_add(t, alarm->name);
        text_add(t, ",\"ref\":\"%s\",\"limit\":", ref_format(alarm->is.table, alarm->is.id, ref));
        if (has_limit(alarm->is.kind))
            json_number_add(t, alarm->is.limit);
        else
            text_add(t, "null");
        alarm_described_members(alarm, t);
        text_add(t, "},");
    }
    text_chop(t, ',');
    text_add(t, "]}");
}

void alarm_stands_json(const struct alarm_now *now, struct apc_store *store, struct text *t)
{
    text_add(t, "{");
    alarm_stands_members(now, store, t);
    text_add(t, "}");
}

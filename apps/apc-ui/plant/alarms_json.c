/* SPDX-License-Identifier: BSD-3-Clause */
/* What alarms are and how they stand, as JSON. */
#include <math.h>

#include "apc-ui/ui.h"

void alarm_author_member(struct apc_store *store, uint32_t author, struct text *t)
{
    char name[APC_AUTHOR_LEN] = "";
    if (author > 0 && apc_store_author_name(store, author, name) < 0)
        name[0] = '\0';
    json_add(t, "author:%-s", name);
}

void alarm_described_members(const struct alarm *alarm, struct text *t)
{
    json_add(t, "kind:%s, priority:%d, area:%s, message:%s, consequence:%s, response:%s",
             apc_alarm_kind_name(alarm->is.kind), alarm->is.priority, alarm->area, alarm->message,
             alarm->consequence, alarm->response);
}

void alarm_stands_members(const struct alarm_now *now, struct apc_store *store, struct text *t)
{
    const enum apc_alarm_state state = alarm_summary_state(now);
    json_add(t, "id:%d, seq:%jd, journal:%jd, state:%s, active:%i, unacknowledged:%i, standing:%i",
             now->row->id, now->row->seq, now->row->origin, apc_alarm_state_name(state),
             apc_alarm_is_active(state), apc_alarm_is_unacked(state), apc_alarm_is_standing(state));
    json_add(t, "time:%.6jd, raised:%.6jd, first_out:%i", json_some(now->row->seq > 0 ? now->row->time : 0),
             json_some(state != APC_ALARM_NORMAL ? now->raised.last : 0), now->first_out);
    alarm_author_member(store, now->row->author, t);
    json_add(t, "shelved_until:%.6jd", json_some(alarm_summary_shelved(now)));
}

static bool has_limit(enum apc_alarm_kind kind)
{
    return (kind >= APC_ALARM_LOW_LOW && kind <= APC_ALARM_DEVIATION) || kind == APC_ALARM_RATE ||
           kind == APC_ALARM_OVERRUN;
}

void alarms_described_json(const struct experiment *e, struct text *t)
{
    char ref[REF_LEN];
    json_add(t, "{shelve_max:%.9jd, all:[", e->alarms.shelve_max);
    for (size_t i = 0; i < e->n_alarms; i++) {
        const struct alarm *alarm = &e->alarm[i];
        json_add(t, "{id:%zu, alarm:%s, ref:%s, limit:%g", i + 1, alarm->name,
                 ref_format(alarm->is.table, alarm->is.id, ref),
                 has_limit(alarm->is.kind) ? alarm->is.limit : (double)NAN);
        alarm_described_members(alarm, t);
        json_add(t, "}");
    }
    json_add(t, "]}");
}

void alarm_stands_json(const struct alarm_now *now, struct apc_store *store, struct text *t)
{
    json_add(t, "{");
    alarm_stands_members(now, store, t);
    json_add(t, "}");
}

/* SPDX-License-Identifier: BSD-3-Clause */
/* What waits for a second person, and its refusal; post_approve() is a write. */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "apc-ui/api/api.h"
#include "operate/operate.h"

static void waiting_json(const struct waiting *w, struct text *t)
{
    char ref[REF_LEN];
    json_add(t, "{ref:%s, name:%s, to:%g, user:%s, time:%.6jd, until:%.6jd",
             ref_format(w->to.table, w->to.id, ref), w->to.name, w->row.value, w->asker, w->row.time,
             w->until);
    if (w->over.value > 0)
        json_add(t, "over:%g", w->over.value);
    json_add(t, "}");
}

static void waiting_reply(struct request *r, struct apc_store *store, const struct plant_view *plant)
{
    const apc_ns now = apc_clock_utc(NULL);
    struct waiting *waiting;
    const int n = waiting_load(&waiting, store, plant);
    if (n < 0) {
        fault_store(r, n, store);
    } else {
        json_add(&r->reply, "{t:%.6jd, changes:[", now);
        for (int i = 0; i < n; i++)
            if (now <= waiting[i].until)
                waiting_json(&waiting[i], &r->reply);
        json_add(&r->reply, "]}");
    }
    free(waiting);
}

void get_waiting(struct ui *ui, struct request *r, struct apc_store *store)
{
    struct known_plant plant = {0};
    int rc = apc_store_connect(store);
    (void)ui;
    if (rc >= 0)
        rc = known_load(&plant, store);
    if (rc < 0)
        fault_store(r, rc, store);
    else
        waiting_reply(r, store, &plant.view);
    known_free(&plant);
}

bool request_time(struct request *r, const json_t *body, const char *member, apc_ns *time)
{
    double seconds;
    if (!member_number(body, member, &seconds, &r->fault))
        return false;
    *time = seconds > 0 && seconds < 1e10 ? llround(seconds * 1e6) * APC_NS_PER_US : 0;
    return *time > 0 || fault_set(&r->fault, 422, "value", member, "\"%s\" must be that of a write", member);
}

static void refuse_write(struct ui *ui, struct request *r, struct apc_store *store, struct operation *o,
                         apc_ns time)
{
    struct approval approval = {0};
    struct change_fault why;
    int rc = operation_approve(o, store, time, NULL, true, &approval, &why);
    if (rc == 0)
        rc = operation_refuse(o, store, &why);
    if (rc < 0 && strcmp(why.code, "store") == 0)
        fault_store(r, rc, store);
    else if (rc < 0)
        fault_change(r, &why, NULL);
    else
        waiting_reply(r, store, o->plant);
    (void)ui;
    free(approval.row);
    free(o->change);
}

void post_refuse(struct ui *ui, struct request *r, struct apc_store *store)
{
    static const char *const members[] = {"time", "reason", NULL};
    struct known_plant plant = {0};
    char reason[REASON_LEN], note[80];
    apc_ns time;
    json_t *body = body_parse(r->body, r->n, members, &r->fault);
    const bool ok = body && request_time(r, body, "time", &time) && request_reason(r, body, reason);
    json_decref(body);
    if (!ok || !request_may_write(ui, r))
        return;
    int rc = apc_store_connect(store);
    if (rc >= 0 && fault_history(r, store))
        return;
    if (rc >= 0)
        rc = known_load(&plant, store);
    if (rc < 0) {
        fault_store(r, rc, store);
    } else {
        struct operation o = {
            .plant = &plant.view, .author = r->session.user, .note = note, .reason = reason};
        snprintf(note, sizeof note, " (from %.50s)", r->from->address);
        refuse_write(ui, r, store, &o, time);
    }
    known_free(&plant);
}

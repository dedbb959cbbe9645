/* SPDX-License-Identifier: BSD-3-Clause */
/* The log book: what people enter, and sign at a handover. It is read as events are. */
#include <math.h>
#include <string.h>

#include "apc-ui/api/api.h"
#include "operate/operate.h"

struct log_order {
    struct logbook_entry entry;
    apc_ns seen;
};

/* Who signs says which entry is the newest that he has read. */
static bool read_log_order(struct request *r, const json_t *body, struct log_order *o)
{
    const json_t *sign = json_object_get(body, "sign");
    double seconds = 0;
    o->entry.signs = json_is_true(sign);
    o->seen = -1;
    if (sign && !o->entry.signs)
        return fault_set(&r->fault, 400, "json", "sign", "\"sign\" must be true");
    if (!o->entry.signs && json_object_get(body, "seen"))
        return fault_set(&r->fault, 400, "json", "seen", "\"seen\" goes with \"sign\" alone");
    if (!member_text(body, "text", &o->entry.text, &r->fault) ||
        (json_object_get(body, "signal") && !member_text(body, "signal", &o->entry.signal, &r->fault)) ||
        (o->entry.signs && !member_number(body, "seen", &seconds, &r->fault)))
        return false;
    if (!(seconds >= 0 && seconds < 1e10))
        return fault_set(&r->fault, 422, "value", "seen",
                         "\"seen\" must be the time of the newest entry that was read; 0: there is none");
    if (o->entry.signs)
        o->seen = llround(seconds * 1e6) * APC_NS_PER_US;
    return true;
}

static bool make_log_event(struct ui *ui, struct request *r, const struct log_order *o,
                           struct apc_event *event)
{
    const struct plant *plant = &ui->model.plant;
    struct change_fault why;
    pthread_mutex_lock(&ui->model.mutex);
    const struct plant_view view = {.tag = plant->tag, .n = plant->n, .loops = &plant->loops};
    const int rc = logbook_make(&view, &o->entry, event, &why);
    pthread_mutex_unlock(&ui->model.mutex);
    return rc == 0 || fault_change(r, &why, strcmp(why.code, "variable") == 0 ? "signal" : "text");
}

/* One after the other: a second press finds the first. */
static void enter_log(struct ui *ui, struct request *r, apc_ns seen, struct apc_event *event,
                      struct apc_store *store)
{
    struct desk *desk = &ui->desk[DESK_WRITES];
    struct change_fault why;
    pthread_mutex_lock(&desk->mutex);
    const int rc = logbook_add(store, seen, event, &why);
    pthread_mutex_unlock(&desk->mutex);
    if (rc >= 0)
        event_json(event, &r->reply);
    else if (strcmp(why.code, "store") == 0)
        fault_store(r, rc, store);
    else
        fault_change(r, &why, NULL);
}

void post_log(struct ui *ui, struct request *r, struct apc_store *store)
{
    static const char *const members[] = {"text", "signal", "sign", "seen", NULL};
    struct log_order o = {.entry.author = r->session.user};
    struct apc_event event;
    json_t *body = body_parse(r->body, r->n, members, &r->fault);
    const bool ok = body && read_log_order(r, body, &o) && make_log_event(ui, r, &o, &event);
    json_decref(body);
    if (!ok || !request_may_write(ui, r))
        return;
    const int rc = apc_store_connect(store);
    if (rc < 0)
        fault_store(r, rc, store);
    else if (!fault_history(r, store))
        enter_log(ui, r, o.seen, &event, store);
}

/* SPDX-License-Identifier: BSD-3-Clause */
/*
 * What operators write. Each request is checked against the description and the mode of its loop, then
 * swapped in for what the operator saw, then recorded with his name; writes.h says what becomes of it.
 *
 * A setpoint whose loop is asked for Cas is written over and over by the loop above: the newest that the
 * operator saw says nothing then, and his value takes the target Auto along (operate/operate.h).
 */
#include <inttypes.h>
#include <stdlib.h>
#include <string.h>

#include "apc-ui/api/api.h"
#include "operate/operate.h"

/* Which status each code of change_fault has. */
static bool fault_change(struct request *r, const struct change_fault *why, const char *field)
{
    const int http = !strcmp(why->code, "variable")                              ? 404
                     : !strcmp(why->code, "mode") || !strcmp(why->code, "stale") ? 409
                                                                                 : 422;
    return fault_set(&r->fault, http, why->code, field, "%s", why->text);
}

/* ---- Reading the request ------------------------------------------------------------------ */

/* What a loop's write has to do with, beside what is written: the target mode where an output or a setpoint
 * is, or the switch of a setpoint that the scheduler moves, and the setpoint where a target is. */
struct beside {
    struct apc_sample now; /* id 0: nothing */
    char name[APC_TAG_LEN];
};

struct order {
    struct write write;
    struct write_change change[WRITE_CHANGES + 1]; /* one may be taken along */
    struct beside beside;
    char reason[REASON_LEN];
};

static void look_beside(const struct plant *p, struct order *o, const struct loops_loop *loop,
                        enum apc_table table, int id)
{
    struct beside *b = &o->beside;
    if (table == APC_SETPOINT && loops_scheduled(&p->loops, id)) {
        b->now = (struct apc_sample){.table = APC_OPMODE, .id = LOOPS_OWNER(id)};
        snprintf(b->name, sizeof b->name, "%.57s.owner", p->tag[find_plant_tag(p, table, id)].name);
        return;
    }
    const struct apc_sample row = {.table = table, .id = id};
    const int owned = table == APC_OPMODE && (!loop || loop->above >= 0) ? loops_owned(&p->loops, &row) : 0;
    if (!owned && !(loop && (table == APC_MANUAL || (table == APC_SETPOINT && loop->above >= 0))))
        return;
    b->now = owned ? (struct apc_sample){.table = APC_SETPOINT, .id = owned}
                   : (struct apc_sample){.table = APC_OPMODE, .id = loop->id};
    const int at = find_plant_tag(p, b->now.table, b->now.id);
    snprintf(b->name, sizeof b->name, "%s", at < 0 ? "" : p->tag[at].name);
}

/* What is to be written, what is beside it, and whether it may be that. Loops are looked at under the lock.
 */
static bool find_order_target(struct ui *ui, struct request *r, struct order *o, enum apc_table table, int id,
                              double value, char name[APC_TAG_LEN])
{
    const struct plant *p = &ui->model.plant;
    struct change_target to;
    struct change_fault why;
    pthread_mutex_lock(&ui->model.mutex);
    const struct plant_view view = {p->tag, p->n, &p->loops};
    const bool found = change_at(&view, table, id, &to, &why) == 0;
    const bool may = found && change_check(&to, value, &why) == 0;
    if (found)
        look_beside(p, o, to.loop, table, id);
    pthread_mutex_unlock(&ui->model.mutex);
    memcpy(name, to.name, sizeof to.name);
    return may || fault_change(r, &why, found ? "value" : "id");
}

/* Change a variable to a value: is there one, and may it be that? */
static bool order_change(struct ui *ui, struct request *r, struct order *o, enum apc_table table, int64_t id,
                         double value, int64_t seq)
{
    struct write_change *c = &o->change[o->write.n];
    char name[APC_TAG_LEN];

    if (o->write.n == WRITE_CHANGES)
        return fault_set(&r->fault, 400, "json", "values", "more than %d values at once", WRITE_CHANGES);
    if (!find_order_target(ui, r, o, table, (int)id, value, name))
        return false;
    for (size_t i = 0; i < o->write.n; i++)
        if (o->change[i].after.id == (int)id)
            return fault_set(&r->fault, 422, "value", "id", "%s is given twice", name);
    *c = (struct write_change){.after = {.table = table, .id = (int)id, .value = value, .seq = seq}};
    memcpy(c->name, name, sizeof c->name);
    o->write.n++;
    return true;
}

bool request_key(struct request *r, const json_t *body, char key[KEY_LEN])
{
    const char *own = NULL;
    char token[TOKEN_LEN];
    if (!json_object_get(body, "key")) {
        if (token_make(token) < 0)
            return fault_set(&r->fault, 503, "busy", NULL, "no random number");
        snprintf(key, KEY_LEN, "%.32s", token);
        return true;
    }
    if (!member_text(body, "key", &own, &r->fault))
        return false;
    if (!key_ok(own))
        return fault_set(&r->fault, 400, "json", "key", "\"key\" must be 8 to 64 letters, digits, _ or -");
    snprintf(key, KEY_LEN, "%s", own);
    return true;
}

bool request_reason(struct request *r, const json_t *body, char reason[REASON_LEN])
{
    const char *text = "";
    struct change_fault why;
    if (json_object_get(body, "reason") && !member_text(body, "reason", &text, &r->fault))
        return false;
    if (change_reason(text, &why) < 0)
        return fault_change(r, &why, "reason");
    snprintf(reason, REASON_LEN, "%s", text);
    return true;
}

bool request_begin(struct ui *ui, struct request *r, const struct write *write, struct apc_store *store)
{
    const int rc = writes_begin(ui->writes, write, &r->reply);
    if (rc == APC_EBUSY)
        return fault_set(&r->fault, 503, "busy", "key", "this very write is under way");
    if (rc == APC_ECONFLICT)
        return fault_set(&r->fault, 422, "value", "key",
                         "another write had this \"key\": nothing was written; each takes a new one");
    if (rc < 0)
        fault_store(r, rc, store);
    return rc == 0;
}

void event_because(struct apc_event *event, const char *reason)
{
    const size_t n = strlen(event->text), room = sizeof event->text - n;
    if (reason[0])
        snprintf(event->text + n, room, ": %.*s", (int)room - 3, reason);
}

static bool read_value(struct ui *ui, struct request *r, const json_t *object, struct order *o,
                       enum apc_table table)
{
    int64_t id, seq;
    double value;
    return member_whole(object, "id", 0, INT32_MAX, &id, &r->fault) &&
           member_number(object, "value", &value, &r->fault) &&
           member_whole(object, "seq", 0, APC_SEQ_MAX, &seq, &r->fault) &&
           order_change(ui, r, o, table, id, value, seq);
}

static bool read_order_mode(struct ui *ui, struct request *r, const json_t *body, struct order *o)
{
    struct change_fault why;
    const char *name;
    int64_t id, seq;
    double mode;
    if (!member_whole(body, "id", 1, INT32_MAX, &id, &r->fault) ||
        !member_text(body, "mode", &name, &r->fault) ||
        !member_whole(body, "seq", 0, APC_SEQ_MAX, &seq, &r->fault))
        return false;
    if (change_mode(name, &mode, &why) < 0)
        return fault_change(r, &why, "mode");
    return order_change(ui, r, o, APC_OPMODE, id, mode, seq);
}

/* Of a setpoint that the scheduler moves. */
static bool read_owner(struct ui *ui, struct request *r, const json_t *body, struct order *o)
{
    const char *owner;
    int64_t id, seq;
    bool cascade = false, scheduled = false;
    if (!member_whole(body, "id", 1, INT32_MAX, &id, &r->fault) ||
        !member_text(body, "owner", &owner, &r->fault) ||
        !member_whole(body, "seq", 0, APC_SEQ_MAX, &seq, &r->fault))
        return false;
    const bool remote = strcmp(owner, loops_owner_name(false)) == 0;
    if (!remote && strcmp(owner, loops_owner_name(true)) != 0)
        return fault_set(&r->fault, 422, "value", "owner", "\"owner\" must be Local or Remote");
    pthread_mutex_lock(&ui->model.mutex);
    const struct loops *loops = &ui->model.plant.loops;
    const struct loops_loop *loop = loops_of(loops, APC_SETPOINT, (int)id);
    scheduled = loops_scheduled(loops, (int)id);
    cascade = loop && loop->above >= 0;
    pthread_mutex_unlock(&ui->model.mutex);
    if (scheduled)
        return order_change(ui, r, o, APC_OPMODE, LOOPS_OWNER((int)id), remote, seq);
    return cascade ? fault_set(&r->fault, 422, "value", "id",
                               "a loop moves setpoint.%" PRId64 ": it is that one's in mode Cas", id)
                   : fault_set(&r->fault, 404, "variable", "id",
                               "there is no setpoint.%" PRId64 " that a scheduler moves", id);
}

static bool read_tuning(struct ui *ui, struct request *r, const json_t *body, struct order *o)
{
    static const char *const members[] = {"id", "value", "seq", NULL};
    const json_t *values = json_object_get(body, "values");
    size_t n = json_array_size(values);
    if (n == 0)
        return fault_set(&r->fault, 400, "json", "values", "\"values\" must be an array that is not empty");
    for (size_t i = 0; i < n; i++) {
        const json_t *object = json_array_get(values, i);
        if (!json_is_object(object))
            return fault_set(&r->fault, 400, "json", "values", "\"values\" must hold objects");
        if (!members_known(object, members, &r->fault) || !read_value(ui, r, object, o, APC_TUNING))
            return false;
    }
    return true;
}

static bool read_write_order(struct ui *ui, struct request *r, struct order *o)
{
    static const char *const value_members[] = {"id", "value", "seq", "reason", "key", NULL};
    static const char *const mode_members[] = {"id", "mode", "seq", "reason", "key", NULL};
    static const char *const owner_members[] = {"id", "owner", "seq", "reason", "key", NULL};
    static const char *const tuning_members[] = {"values", "reason", "key", NULL};
    enum write_kind kind = o->write.kind;
    json_t *body = body_parse(r->body, r->n,
                              kind == WRITE_MODE     ? mode_members
                              : kind == WRITE_OWNER  ? owner_members
                              : kind == WRITE_TUNING ? tuning_members
                                                     : value_members,
                              &r->fault);
    bool ok = body && request_key(r, body, o->write.key) && request_reason(r, body, o->reason);
    if (ok && kind == WRITE_MODE)
        ok = read_order_mode(ui, r, body, o);
    else if (ok && kind == WRITE_OWNER)
        ok = read_owner(ui, r, body, o);
    else if (ok && kind == WRITE_TUNING)
        ok = read_tuning(ui, r, body, o);
    else if (ok)
        ok = read_value(ui, r, body, o, kind == WRITE_SETPOINT ? APC_SETPOINT : APC_MANUAL);
    json_decref(body);
    return ok;
}

/* ---- Writing ------------------------------------------------------------------------------ */

/* What is in force, all of one instant: fills in `before`, and what is beside. Returns 0 or the store's
 * error. */
static int read_before(struct order *o, struct apc_store *store)
{
    struct apc_sample now[WRITE_CHANGES + 1];
    size_t n = o->write.n;
    for (size_t i = 0; i < n; i++)
        now[i] = (struct apc_sample){.table = o->change[i].after.table, .id = o->change[i].after.id};
    now[n] = o->beside.now;
    int rc = apc_store_read(store, now, n + (o->beside.now.id > 0));
    for (size_t i = 0; i < n && rc >= 0; i++)
        o->change[i].before = now[i];
    o->beside.now = now[n];
    return rc < 0 ? rc : 0;
}

static bool in_mode(const struct apc_sample *mode, enum apc_mode wanted)
{
    return mode->seq > 0 && mode->value >= (double)wanted && mode->value <= (double)wanted;
}

static void stale_fault(struct request *r, const struct order *o)
{
    char ref[REF_LEN];
    struct change_fault why;
    const struct write_change *first = NULL;
    text_add(&r->extra, ",\"current\":{");
    for (size_t i = 0; i < o->write.n; i++) {
        const struct write_change *c = &o->change[i];
        if (!first && c->before.seq != c->after.seq)
            first = c;
        text_add(&r->extra, "\"%s\":", ref_format(c->after.table, c->after.id, ref));
        json_sample_add(&r->extra, &c->before);
        text_add(&r->extra, ",");
    }
    text_chop(&r->extra, ',');
    text_add(&r->extra, "}");
    if (!first)
        first = &o->change[0];
    (void)change_stale(first->name, &first->before, &why);
    fault_change(r, &why, NULL);
}

/* A setpoint that is the loop's above. */
static bool is_remote_setpoint(const struct order *o)
{
    return o->write.kind == WRITE_SETPOINT && o->beside.now.id > 0 && in_mode(&o->beside.now, APC_MODE_CAS);
}

/* As its loop stands: of what has just been described anew nothing is known. */
static bool check_order_mode(struct ui *ui, struct request *r, const struct order *o)
{
    const struct apc_sample *first = &o->change[0].after, *mode = &o->beside.now;
    const struct plant *p = &ui->model.plant;
    struct change_target to;
    struct change_fault why;
    if (mode->table != APC_OPMODE || mode->id >= LOOPS_IDS)
        return true;
    pthread_mutex_lock(&ui->model.mutex);
    const struct plant_view view = {p->tag, p->n, &p->loops};
    const bool may =
        change_at(&view, first->table, first->id, &to, &why) == 0 && change_now(&view, &to, mode, &why) == 0;
    pthread_mutex_unlock(&ui->model.mutex);
    return may || fault_change(r, &why, NULL);
}

/* May it be written as things stand? */
static bool check_now(struct ui *ui, struct request *r, const struct order *o)
{
    if (!check_order_mode(ui, r, o))
        return false;
    for (size_t i = 0; i < o->write.n && !is_remote_setpoint(o); i++)
        if (o->change[i].before.seq != o->change[i].after.seq) {
            stale_fault(r, o);
            return false;
        }
    return true;
}

/* The loops as they are described now; loops_free(). */
static int copy_loops(struct ui *ui, struct loops *to)
{
    const struct loops *from = &ui->model.plant.loops;
    pthread_mutex_lock(&ui->model.mutex);
    *to = *from;
    to->at = calloc(from->n + 1, sizeof *to->at);
    to->controller = calloc(from->n_controllers + 1, sizeof *to->controller);
    to->scheduled = calloc(from->n_scheduled + 1, sizeof *to->scheduled);
    const bool room = to->at && to->controller && to->scheduled;
    if (room) {
        memcpy(to->scheduled, from->scheduled, from->n_scheduled * sizeof *to->scheduled);
        memcpy(to->at, from->at, from->n * sizeof *to->at);
        memcpy(to->controller, from->controller, from->n_controllers * sizeof *to->controller);
    }
    pthread_mutex_unlock(&ui->model.mutex);
    return room ? 0 : APC_ENOMEM;
}

/* What the other loop's or the own target cost: of a single change there is one more that is told of. Loops
 * of controllers in shadow go along. */
static void take_along(struct order *o, const struct owner_rows *with)
{
    size_t i = 0;
    while (i < with->n && (with->at[i].table != o->beside.now.table || with->at[i].id != o->beside.now.id))
        i++;
    if (i == with->n)
        return;
    struct write_change *c = &o->change[o->write.n++];
    *c = (struct write_change){.before = o->beside.now, .after = with->at[i]};
    memcpy(c->name, o->beside.name, sizeof c->name);
}

/* Returns the store's answer; the changes then have their seqs, or what is newest instead. */
static int put_order(struct ui *ui, struct order *o, struct apc_store *store, uint32_t author)
{
    struct apc_sample samples[WRITE_CHANGES];
    struct owner_rows with = {0};
    struct loops loops;
    apc_ns began = apc_clock_mono(NULL);
    for (size_t i = 0; i < o->write.n; i++) {
        o->change[i].after.time = o->write.time;
        o->change[i].after.status = APC_GOOD;
        o->change[i].after.author = author;
        samples[i] = o->change[i].after;
    }
    if (is_remote_setpoint(o))
        samples[0].seq = APC_SEQ_ANY;
    int rc = copy_loops(ui, &loops);
    if (rc == 0)
        rc = owner_put(store, &loops, samples, o->write.n, &with);
    for (size_t i = 0; i < o->write.n; i++) {
        if (rc == APC_ECONFLICT)
            o->change[i].before = samples[i];
        else if (rc >= 0 || is_remote_setpoint(o))
            o->change[i].after.seq = samples[i].seq;
        else
            o->change[i].after.seq++; /* what it would have been given */
    }
    if (rc >= 0) {
        take_along(o, &with);
        duration_stats_record(&ui->stores, apc_clock_mono(NULL) - began);
    }
    free(with.at);
    loops_free(&loops);
    return rc;
}

static void record_write(struct ui *ui, const struct request *r, const struct order *o,
                         struct apc_store *store, const char *outcome)
{
    char before[CHANGE_TEXT], after[CHANGE_TEXT];
    for (size_t i = 0; i < o->write.n; i++) {
        const struct write_change *c = &o->change[i];
        const bool opened = o->write.kind == WRITE_SETPOINT && i > 0;
        struct apc_event event = {.time = o->write.time, .severity = APC_EVENT_INFO, .kind = "operator"};
        snprintf(event.source, sizeof event.source, "%s", o->write.user);
        snprintf(event.text, sizeof event.text, "%s: %s -> %s%s%s (from %s)", c->name,
                 change_text(&c->before, before), change_text(&c->after, after),
                 opened ? ", the setpoint is Local now" : "", outcome, r->from->address);
        event_because(&event, o->reason);
        audit(ui, store, &event);
    }
}

static void end_write(struct ui *ui, struct request *r, struct order *o, enum write_state state, int stored,
                      const char *reason)
{
    struct text t = {0};
    const struct write ended = {.state = state, .stored = stored, .n = o->write.n, .change = o->change};
    writes_end(ui->writes, o->write.key, &ended, reason, apc_clock_mono(NULL), &t);
    if (r->fault.http == 0) {
        r->reply = t;
        return;
    }
    if (strcmp(r->fault.code, "unknown") == 0) {
        text_add(&r->extra, ",\"write\":");
        text_put(&r->extra, t.at, t.n);
    }
    text_free(&t);
}

static void carry_out_write(struct ui *ui, struct request *r, struct order *o, struct apc_store *store)
{
    int author = 0;
    int rc = apc_store_connect(store);
    const bool refused = rc >= 0 && fault_history(r, store);
    if (rc >= 0 && !refused && o->write.user[0])
        rc = author = apc_store_author(store, o->write.user);
    if (rc >= 0 && !refused)
        rc = read_before(o, store);
    if (rc < 0)
        fault_store(r, rc, store);
    else if (!refused)
        (void)check_now(ui, r, o);
    if (r->fault.http) { /* nothing was sent */
        end_write(ui, r, o, WRITE_FAILED, 0, r->fault.message);
        return;
    }
    rc = put_order(ui, o, store, (uint32_t)author);
    if (rc == APC_ECONFLICT)
        stale_fault(r, o);
    else if (rc == APC_ECONN || rc == APC_ETIMEDOUT)
        fault_set(&r->fault, 504, "unknown", NULL,
                  "the database did not answer: whether it was written is not known");
    else if (rc < 0)
        fault_set(&r->fault, 503, "store", NULL, "the database refused it: %.150s", apc_store_error(store));
    if (r->fault.http == 504)
        record_write(ui, r, o, NULL, ", outcome unknown");
    if (r->fault.http)
        end_write(ui, r, o, r->fault.http == 504 ? WRITE_UNKNOWN : WRITE_FAILED,
                  r->fault.http == 504 ? -1 : 0, r->fault.message);
    if (rc < 0)
        return;
    end_write(ui, r, o, WRITE_ACCEPTED, 1, "");
    record_write(ui, r, o, store, "");
}

static void write_order(struct ui *ui, struct request *r, struct apc_store *store, enum write_kind kind)
{
    struct order *o = calloc(1, sizeof *o);
    if (!o) {
        fault_store(r, APC_ENOMEM, store);
        return;
    }
    o->write.kind = kind;
    o->write.change = o->change;
    o->write.time = apc_clock_utc(NULL) / APC_NS_PER_US * APC_NS_PER_US; /* as the store keeps it */
    memcpy(o->write.user, r->session.user, sizeof o->write.user);
    apc_ns now = apc_clock_mono(NULL), again;
    if (read_write_order(ui, r, o) && !session_may_write(&ui->sessions, r->session.token, now, &again)) {
        r->retry_after = again - now;
        fault_set(&r->fault, 429, "rate", NULL, "too many writes: wait a little");
    }
    if (!r->fault.http && request_begin(ui, r, &o->write, store))
        carry_out_write(ui, r, o, store);
    free(o);
}

void post_setpoint(struct ui *ui, struct request *r, struct apc_store *store)
{
    write_order(ui, r, store, WRITE_SETPOINT);
}

void post_output(struct ui *ui, struct request *r, struct apc_store *store)
{
    write_order(ui, r, store, WRITE_OUTPUT);
}

void post_mode(struct ui *ui, struct request *r, struct apc_store *store)
{
    write_order(ui, r, store, WRITE_MODE);
}

void post_owner(struct ui *ui, struct request *r, struct apc_store *store)
{
    write_order(ui, r, store, WRITE_OWNER);
}

void post_tuning(struct ui *ui, struct request *r, struct apc_store *store)
{
    write_order(ui, r, store, WRITE_TUNING);
}

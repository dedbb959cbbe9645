/* SPDX-License-Identifier: BSD-3-Clause */
/*
 * What operators write. Each request is checked against the description and the mode of its loop, then
 * swapped in for what the operator saw, then recorded with his name; writes.h says what becomes of it.
 *
 * A setpoint whose loop is asked for Cas is written over and over by the loop above: the newest that the
 * operator saw says nothing then, and his value takes the target Auto along (operate/operate.h).
 */
#include <inttypes.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "apc-ui/api/api.h"
#include "operate/operate.h"

/* Which status each code of change_fault has. */
bool fault_change(struct request *r, const struct change_fault *why, const char *field)
{
    static const struct {
        const char *code;
        int http;
    } all[] = {{"variable", 404}, {"mode", 409},  {"nobody", 409}, {"simulation", 409},
               {"confirm", 409},  {"stale", 409}, {"undo", 409},   {"ramp", 409},
               {"second", 409},   {"role", 403},  {"unknown", 504}};
    int http = 422;
    for (size_t i = 0; i < sizeof all / sizeof *all; i++)
        http = !strcmp(why->code, all[i].code) ? all[i].http : http;
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
    struct change change[WRITE_CHANGES + 1]; /* one may be taken along */
    struct beside beside;
    struct apc_sample rate; /* of the ramp that the first change is on; id 0: it cannot be on one */
    char reason[REASON_LEN];
    bool confirmed, stops;
    struct approval approval; /* of what another one has asked for */
    char *names;              /* of what is taken again, with commas; "": of all */
    json_t *seen;             /* the seqs of what differs, by their refs, as whoever asks was shown them */
    struct known_plant plant; /* as the model had it */
    struct operation operation;
};

static void look_beside(struct order *o, const struct loops_loop *loop, enum apc_table table, int id)
{
    const struct loops *loops = &o->plant.loops;
    struct beside *b = &o->beside;
    if (table == APC_SETPOINT && loops_scheduled(loops, id)) {
        b->now = (struct apc_sample){.table = APC_OPMODE, .id = LOOPS_OWNER(id)};
        snprintf(b->name, sizeof b->name, "%.57s.owner", plant_tag(&o->plant.view, table, id)->name);
        return;
    }
    const struct apc_sample row = {.table = table, .id = id};
    const int owned = table == APC_OPMODE && (!loop || loop->above >= 0) ? loops_owned(loops, &row) : 0;
    if (!owned && !(loop && (table == APC_MANUAL || (table == APC_SETPOINT && loop->above >= 0))))
        return;
    b->now = owned ? (struct apc_sample){.table = APC_SETPOINT, .id = owned}
                   : (struct apc_sample){.table = APC_OPMODE, .id = loop->id};
    const struct apc_tag *tag = plant_tag(&o->plant.view, b->now.table, b->now.id);
    snprintf(b->name, sizeof b->name, "%s", tag ? tag->name : "");
}

/* Change a variable to a value: is there one, and may it be that? */
static bool order_change(struct request *r, struct order *o, enum apc_table table, int64_t id, double value,
                         int64_t seq)
{
    struct change *c = &o->change[o->write.n];
    struct change_target to;
    struct change_fault why;

    if (o->write.n == WRITE_CHANGES)
        return fault_set(&r->fault, 400, "json", "values", "more than %d values at once", WRITE_CHANGES);
    if (change_at(&o->plant.view, table, (int)id, &to, &why) < 0)
        return fault_change(r, &why, "id");
    if (!o->stops && change_check(&to, value, &why) < 0)
        return fault_change(r, &why, "value");
    for (size_t i = 0; i < o->write.n; i++)
        if (o->change[i].after.id == (int)id)
            return fault_set(&r->fault, 422, "value", "id", "%s is given twice", to.name);
    look_beside(o, to.loop, table, (int)id);
    change_make(&o->plant.view, &to, value, c);
    c->after.seq = seq;
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

static bool request_confirmed(struct request *r, const json_t *body, bool *confirmed)
{
    const json_t *member = json_object_get(body, "confirm");
    *confirmed = json_is_true(member);
    return !member || json_is_boolean(member) ||
           fault_set(&r->fault, 400, "json", "confirm", "\"confirm\" must be true or false");
}

/* Of one that has been asked for before the answer is the reply already. */
static bool is_first(struct request *r, int rc, struct apc_store *store)
{
    if (rc == APC_EBUSY)
        return fault_set(&r->fault, 503, "busy", "key",
                         "this very write is under way already: ask what becomes of it");
    if (rc == APC_ECONFLICT)
        return fault_set(&r->fault, 422, "value", "key",
                         "another write had this \"key\": nothing was written; each takes a new one");
    if (rc < 0)
        fault_store(r, rc, store);
    return rc == 0;
}

bool request_begin(struct ui *ui, struct request *r, const struct write *write, struct apc_store *store)
{
    return is_first(r, writes_begin(ui->writes, write, &r->reply), store);
}

bool request_may_write(struct ui *ui, struct request *r)
{
    const apc_ns now = apc_clock_mono(NULL);
    apc_ns again;
    if (session_may_write(&ui->sessions, r->session.token, now, &again))
        return true;
    r->retry_after = again - now;
    return fault_set(&r->fault, 429, "rate", NULL, "too many writes: wait a little");
}

static bool read_value(struct request *r, const json_t *object, struct order *o, enum apc_table table)
{
    int64_t id, seq;
    double value;
    return member_whole(object, "id", 0, INT32_MAX, &id, &r->fault) &&
           member_number(object, "value", &value, &r->fault) &&
           member_whole(object, "seq", 0, APC_SEQ_MAX, &seq, &r->fault) &&
           order_change(r, o, table, id, value, seq);
}

/* Of a setpoint or an output: to a value, at once or on a ramp; or the end of its ramp. */
static bool read_move(struct request *r, const json_t *body, struct order *o, enum apc_table table)
{
    const json_t *stop = json_object_get(body, "stop"), *over = json_object_get(body, "over");
    struct change *c = &o->change[0];
    struct change_fault why;
    int64_t id;
    double seconds = 0;
    o->stops = json_is_true(stop);
    if (stop && (!o->stops || over || json_object_get(body, "value") || json_object_get(body, "seq") ||
                 json_object_get(body, "confirm")))
        return fault_set(&r->fault, 400, "json", "stop",
                         "\"stop\" must be true: it ends a ramp, and takes no value, seq, over or confirm");
    if (over && !member_number(body, "over", &seconds, &r->fault))
        return false;
    if (over && change_over(seconds, &why) < 0)
        return fault_change(r, &why, "over");
    if (o->stops ? !member_whole(body, "id", 0, INT32_MAX, &id, &r->fault) ||
                       !order_change(r, o, table, id, 0, APC_SEQ_ANY)
                 : !read_value(r, body, o, table))
        return false;
    c->over = seconds;
    c->stop = o->stops;
    o->rate = (struct apc_sample){.table = table, .id = LOOPS_RATE(c->after.id)};
    return true;
}

static bool read_order_mode(struct request *r, const json_t *body, struct order *o)
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
    return order_change(r, o, APC_OPMODE, id, mode, seq);
}

/* Of a setpoint that the scheduler moves. */
static bool read_owner(struct request *r, const json_t *body, struct order *o)
{
    const char *owner;
    int64_t id, seq;
    if (!member_whole(body, "id", 1, INT32_MAX, &id, &r->fault) ||
        !member_text(body, "owner", &owner, &r->fault) ||
        !member_whole(body, "seq", 0, APC_SEQ_MAX, &seq, &r->fault))
        return false;
    const bool remote = strcmp(owner, loops_owner_name(false)) == 0;
    if (!remote && strcmp(owner, loops_owner_name(true)) != 0)
        return fault_set(&r->fault, 422, "value", "owner", "\"owner\" must be Local or Remote");
    const struct loops_loop *loop = loops_of(&o->plant.loops, APC_SETPOINT, (int)id);
    if (loops_scheduled(&o->plant.loops, (int)id))
        return order_change(r, o, APC_OPMODE, LOOPS_OWNER((int)id), remote, seq);
    return loop && loop->above >= 0
               ? fault_set(&r->fault, 422, "value", "id",
                           "a loop moves setpoint.%" PRId64 ": it is that one's in mode Cas", id)
               : fault_set(&r->fault, 404, "variable", "id",
                           "there is no setpoint.%" PRId64 " that a scheduler moves", id);
}

static bool read_tuning(struct request *r, const json_t *body, struct order *o)
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
        if (!members_known(object, members, &r->fault) || !read_value(r, object, o, APC_TUNING))
            return false;
    }
    return true;
}

static bool read_undo(struct request *r, const json_t *body, struct order *o)
{
    return request_time(r, body, "time", &o->write.undoes);
}

static bool read_retake(struct request *r, const json_t *body, struct order *o)
{
    const char *names = "";
    double seconds;
    json_t *seen = json_object_get(body, "seen");
    if (!member_number(body, "at", &seconds, &r->fault) ||
        (json_object_get(body, "names") && !member_text(body, "names", &names, &r->fault)))
        return false;
    if (!json_is_object(seen))
        return fault_set(&r->fault, 400, "json", "seen",
                         "\"seen\" must be an object: the seq of each change that was shown, by its ref");
    o->write.undoes = seconds > 0 && seconds < 1e10 ? llround(seconds * 1e6) * APC_NS_PER_US : 0;
    o->seen = json_incref(seen);
    o->names = strdup(names);
    return (o->names && o->write.undoes > 0) ||
           fault_set(&r->fault, 422, "value", "at", "\"at\" must be Unix seconds, above 0");
}

static bool read_write_order(struct request *r, struct order *o)
{
    static const char *const value_members[] = {"id",      "value",  "seq", "over", "stop",
                                                "confirm", "reason", "key", NULL};
    static const char *const mode_members[] = {"id", "mode", "seq", "reason", "key", NULL};
    static const char *const owner_members[] = {"id", "owner", "seq", "reason", "key", NULL};
    static const char *const tuning_members[] = {"values", "reason", "key", NULL};
    static const char *const undo_members[] = {"time", "reason", "key", NULL};
    static const char *const retake_members[] = {"at", "names", "seen", "confirm", "reason", "key", NULL};
    enum write_kind kind = o->write.kind;
    json_t *body = body_parse(r->body, r->n,
                              kind == WRITE_MODE                            ? mode_members
                              : kind == WRITE_OWNER                         ? owner_members
                              : kind == WRITE_TUNING                        ? tuning_members
                              : kind == WRITE_UNDO || kind == WRITE_APPROVE ? undo_members
                              : kind == WRITE_RETAKE                        ? retake_members
                                                                            : value_members,
                              &r->fault);
    bool ok = body && request_key(r, body, o->write.key) && request_reason(r, body, o->reason) &&
              request_confirmed(r, body, &o->confirmed);
    if (ok && kind == WRITE_MODE)
        ok = read_order_mode(r, body, o);
    else if (ok && kind == WRITE_OWNER)
        ok = read_owner(r, body, o);
    else if (ok && kind == WRITE_TUNING)
        ok = read_tuning(r, body, o);
    else if (ok && (kind == WRITE_UNDO || kind == WRITE_APPROVE))
        ok = read_undo(r, body, o);
    else if (ok && kind == WRITE_RETAKE)
        ok = read_retake(r, body, o);
    else if (ok)
        ok = read_move(r, body, o, kind == WRITE_SETPOINT ? APC_SETPOINT : APC_MANUAL);
    json_decref(body);
    return ok;
}

/* These are what is to be written: are there not too many, and may this role? */
static void take_found(struct request *r, struct order *o, const struct operation *found, const char *instead)
{
    struct change_fault why;
    if (found->n > WRITE_CHANGES)
        fault_set(&r->fault, 422, "value", NULL, "it has more than %d values: %s", WRITE_CHANGES, instead);
    for (size_t i = 0; i < found->n && !r->fault.http; i++) {
        o->change[o->write.n++] = found->change[i];
        if (found->change[i].to.table == APC_TUNING && r->session.role < ROLE_ENGINEER &&
            change_role(o->write.user, "operator", "engineer", &why) < 0)
            fault_change(r, &why, NULL);
    }
}

/* Is it what was shown? */
static bool is_as_seen(const struct operation *o, const json_t *seen)
{
    char ref[REF_LEN];
    bool same = json_object_size(seen) == o->n;
    for (size_t i = 0; i < o->n && same; i++) {
        const struct change *c = &o->change[i];
        const json_t *seq = json_object_get(seen, ref_format(c->to.table, c->to.id, ref));
        same = c->after.seq == APC_SEQ_ANY ? json_is_null(seq)
                                           : json_is_integer(seq) && json_integer_value(seq) == c->after.seq;
    }
    return same;
}

/* Which changes make it what it was then, as find_undo(). */
static bool find_retake(struct ui *ui, struct request *r, struct order *o, struct apc_store *store)
{
    struct operation again = {.plant = &o->plant.view};
    struct apc_store *past = NULL;
    struct apc_error error;
    if (!is_first(r, writes_again(ui->writes, &o->write, &r->reply), store))
        return false;
    const int rc = apc_store_connect(store);
    if (rc < 0)
        fault_store(r, rc, store);
    else if (!fault_history(r, store) && apc_store_past(&past, store, o->write.undoes, &error) < 0)
        fault_set(&r->fault, 422, "value", "at", "%.150s", error.text);
    else if (past && request_retake(r, store, past, o->names, &again)) {
        if (again.n == 0)
            fault_set(&r->fault, 422, "value", "at", "nothing differs from what was set then");
        else if (!is_as_seen(&again, o->seen))
            fault_set(&r->fault, 409, "stale", "seen",
                      "it is not what was shown: another write came meanwhile. Look at it again");
        else
            take_found(r, o, &again, "apc set --from takes it again");
    }
    free(again.change);
    apc_store_close(past);
    return !r->fault.http;
}

/* Which changes take a write back, or were asked for. False: none do, or they have been asked for before. */
static bool find_undo(struct ui *ui, struct request *r, struct order *o, struct apc_store *store)
{
    const bool approves = o->write.kind == WRITE_APPROVE;
    struct operation undo = {.plant = &o->plant.view, .author = o->write.user};
    struct change_fault why = {0};
    if (!is_first(r, writes_again(ui->writes, &o->write, &r->reply), store))
        return false;
    int rc = apc_store_connect(store);
    const bool live = rc >= 0 && !fault_history(r, store);
    if (live)
        rc = approves ? operation_approve(&undo, store, o->write.undoes, NULL, false, &o->approval, &why)
                      : operation_undo(&undo, store, o->write.undoes, &why);
    if (rc < 0 && (!live || strcmp(why.code, "store") == 0))
        fault_store(r, rc, store);
    else if (rc < 0)
        (void)fault_change(r, &why, NULL);
    else
        take_found(r, o, &undo, approves ? "apc approve writes it" : "apc undo takes it back");
    free(undo.change);
    return !r->fault.http;
}

/* ---- Writing ------------------------------------------------------------------------------ */

/* What is newest and in force, all of one instant, and what is beside. Returns 0 or the store's error. */
static int read_before(struct order *o, struct apc_store *store)
{
    struct apc_sample now[2 * WRITE_CHANGES + 2];
    const size_t n = o->write.n;
    for (size_t i = 0; i < n; i++) {
        now[i] = o->change[i].newest;
        now[n + i] = o->change[i].before;
    }
    const size_t beside = 2 * n, rate = beside + (o->beside.now.id > 0);
    now[beside] = o->beside.now;
    now[rate] = o->rate;
    const int rc = apc_store_read(store, now, rate + (o->rate.id > 0));
    for (size_t i = 0; i < n && rc >= 0; i++) {
        o->change[i].newest = now[i];
        o->change[i].before = now[n + i];
    }
    if (o->beside.now.id > 0)
        o->beside.now = now[beside];
    o->rate = now[rate];
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
    const struct change *first = NULL;
    json_add(&r->extra, "current:{");
    for (size_t i = 0; i < o->write.n; i++) {
        const struct change *c = &o->change[i];
        if (!first && c->newest.seq != c->after.seq)
            first = c;
        json_add(&r->extra, "%s:", ref_format(c->after.table, c->after.id, ref));
        json_sample_add(&r->extra, &c->newest);
    }
    json_add(&r->extra, "}");
    if (!first)
        first = &o->change[0];
    (void)change_stale(first->to.name, &first->newest, &why);
    fault_change(r, &why, NULL);
}

/* A setpoint that is the loop's above, or what is on a ramp: its newest row is of no operator. */
static bool is_being_moved(const struct order *o)
{
    return (o->write.kind == WRITE_SETPOINT && o->beside.now.id > 0 &&
            in_mode(&o->beside.now, APC_MODE_CAS)) ||
           (o->rate.seq > 0 && o->rate.value > 0);
}

/* Would anybody apply it? The page has followed the ticks, a little behind: the store has the last word. */
static bool check_takers(struct ui *ui, struct request *r, struct order *o, struct apc_store *store)
{
    struct model *m = &ui->model;
    struct change_fault why;
    bool known = true; /* of all that they tick */
    int rc = 0;
    o->operation =
        (struct operation){.plant = &o->plant.view, .change = o->change, .n = o->write.n, .followed = true};
    pthread_mutex_lock(&m->mutex);
    for (size_t i = 0; i < o->write.n; i++) {
        struct change *c = &o->change[i];
        const size_t by = c->by ? (size_t)(c->by - o->plant.loops.controller) : SIZE_MAX;
        apc_ns age = -1;
        if (by < m->plant.loops.n_controllers) {
            c->tick = m->tick[by];
            c->ticked = c->tick.seq;
            c->period = plant_tick_time(&m->plant, by);
            age = model_tick_age(m, by, apc_clock_plant());
        }
        c->ticks = change_takes(c, age, apc_clock_utc(NULL), &why) == 0;
        known = known && c->ticks;
    }
    pthread_mutex_unlock(&m->mutex);
    if (!known)
        rc = operation_ready(&o->operation, store, &why);
    if (rc < 0 && strcmp(why.code, "store") == 0)
        fault_store(r, rc, store);
    else if (rc < 0)
        (void)fault_change(r, &why, NULL);
    return rc >= 0;
}

/* May it be written as things stand? */
static bool check_now(struct ui *ui, struct request *r, struct order *o, struct apc_store *store)
{
    struct change_fault why;
    if (o->write.undoes == 0 && change_now(&o->plant.view, &o->change[0].to, &o->beside.now, &why) < 0)
        return fault_change(r, &why, NULL);
    for (size_t i = 0; i < o->write.n && !is_being_moved(o); i++)
        if (o->change[i].after.seq != APC_SEQ_ANY && o->change[i].newest.seq != o->change[i].after.seq) {
            stale_fault(r, o);
            return false;
        }
    return check_takers(ui, r, o, store);
}

static void *copied(const void *from, size_t n, size_t size)
{
    void *to = calloc(n + 1, size);
    return to ? memcpy(to, from, n * size) : NULL;
}

int copy_model_plant(struct ui *ui, struct known_plant *to)
{
    const struct plant *from = &ui->model.plant;
    struct loops *loops = &to->loops;
    pthread_mutex_lock(&ui->model.mutex);
    *loops = from->loops;
    to->tag = copied(from->tag, from->n, sizeof *to->tag);
    loops->at = copied(from->loops.at, loops->n, sizeof *loops->at);
    loops->controller = copied(from->loops.controller, loops->n_controllers, sizeof *loops->controller);
    loops->scheduled = copied(from->loops.scheduled, loops->n_scheduled, sizeof *loops->scheduled);
    loops->step = copied(from->loops.step, loops->n_steps, sizeof *loops->step);
    to->view = (struct plant_view){to->tag, from->n, loops};
    pthread_mutex_unlock(&ui->model.mutex);
    return to->tag && loops->at && loops->controller && loops->scheduled && loops->step ? 0 : APC_ENOMEM;
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
    struct change *c = &o->change[o->write.n++];
    *c = (struct change){.before = o->beside.now, .after = with->at[i]};
    memcpy(c->to.name, o->beside.name, sizeof c->to.name);
}

static int audit_events(void *ctx, struct apc_store *store, const struct apc_event *event, size_t n)
{
    for (size_t i = 0; i < n; i++)
        audit(ctx, store, &event[i]);
    return 0;
}

/* Returns the error; the changes then have their seqs, or what is newest instead. */
static int put_order(struct ui *ui, const struct request *r, struct order *o, struct apc_store *store,
                     struct change_fault *why)
{
    char note[120], then[APC_TIME_LEN + 16] = "", time[APC_TIME_LEN];
    const apc_ns began = apc_clock_mono(NULL);
    if (o->write.kind == WRITE_RETAKE)
        snprintf(then, sizeof then, " (as of %s)", apc_time_format(o->write.undoes, time));
    snprintf(note, sizeof note, "%s (from %.50s)", o->write.kind == WRITE_UNDO ? " (undo)" : then,
             r->from->address);
    if (is_being_moved(o))
        o->change[0].after.seq = APC_SEQ_ANY;
    o->operation = (struct operation){.plant = &o->plant.view,
                                      .change = o->change,
                                      .n = o->write.n,
                                      .confirmed = o->confirmed || o->write.kind == WRITE_UNDO ||
                                                   o->write.kind == WRITE_APPROVE,
                                      .approval = o->write.kind == WRITE_APPROVE ? &o->approval : NULL,
                                      .author = o->write.user,
                                      .note = note,
                                      .reason = o->reason,
                                      .record = audit_events,
                                      .ctx = ui,
                                      .time = o->write.time};
    const int rc = operation_begin(&o->operation, store, why);
    if (rc == 0) {
        take_along(o, &o->operation.with);
        duration_stats_record(&ui->stores, apc_clock_mono(NULL) - began);
    }
    operation_end(&o->operation);
    return rc;
}

static void end_write(struct ui *ui, struct request *r, struct order *o, enum write_state state, int stored,
                      const char *reason)
{
    struct text t = {0};
    const struct write ended = {.state = state,
                                .stored = stored,
                                .confirm = r->fault.http && !strcmp(r->fault.code, "confirm"),
                                .waits = r->fault.http && !strcmp(r->fault.code, "second"),
                                .n = o->write.n,
                                .change = o->change};
    writes_end(ui->writes, o->write.key, &ended, reason, apc_clock_plant(), &t);
    if (r->fault.http == 0) {
        r->reply = t;
        return;
    }
    if (strcmp(r->fault.code, "unknown") == 0)
        json_add(&r->extra, "write:%.*s", (int)t.n, t.at);
    text_free(&t);
}

static void carry_out_write(struct ui *ui, struct request *r, struct order *o, struct apc_store *store)
{
    struct change_fault why;
    int rc = apc_store_connect(store);
    const bool refused = rc >= 0 && fault_history(r, store);
    if (rc >= 0 && !refused)
        rc = read_before(o, store);
    if (rc < 0)
        fault_store(r, rc, store);
    else if (!refused)
        (void)check_now(ui, r, o, store);
    if (r->fault.http) { /* nothing was sent */
        end_write(ui, r, o, WRITE_FAILED, 0, r->fault.message);
        return;
    }
    rc = put_order(ui, r, o, store, &why);
    if (rc < 0 && strcmp(why.code, "second") == 0)
        fault_change(r, &why, NULL);
    else if (rc == APC_ECONFLICT)
        stale_fault(r, o);
    else if (rc < 0 && (strcmp(why.code, "confirm") == 0 || strcmp(why.code, "ramp") == 0))
        fault_change(r, &why, o->stops ? "stop" : "value");
    else if (rc == APC_ENOMEM || (rc < 0 && o->operation.begun == 0))
        fault_store(r, rc, store);
    else if (rc < 0 && strcmp(why.code, "store") == 0)
        fault_set(&r->fault, 503, "store", NULL, "the database refused it: %.150s", why.text);
    else if (rc < 0)
        fault_change(r, &why, NULL);
    if (rc == 0)
        end_write(ui, r, o, WRITE_ACCEPTED, 1, "");
    else
        end_write(ui, r, o, r->fault.http == 504 ? WRITE_UNKNOWN : WRITE_FAILED,
                  r->fault.http == 504 ? -1 : 0, r->fault.message);
}

static void write_order(struct ui *ui, struct request *r, struct apc_store *store, enum write_kind kind)
{
    struct order *o = calloc(1, sizeof *o);
    if (!o || copy_model_plant(ui, &o->plant) < 0) {
        fault_store(r, APC_ENOMEM, store);
        if (o)
            known_free(&o->plant);
        free(o);
        return;
    }
    o->write.kind = kind;
    o->write.change = o->change;
    o->write.time = apc_clock_utc(NULL) / APC_NS_PER_US * APC_NS_PER_US; /* as the store keeps it */
    memcpy(o->write.user, r->session.user, sizeof o->write.user);
    if (read_write_order(r, o) && request_may_write(ui, r) &&
        ((kind != WRITE_UNDO && kind != WRITE_APPROVE) || find_undo(ui, r, o, store)) &&
        (kind != WRITE_RETAKE || find_retake(ui, r, o, store)) && request_begin(ui, r, &o->write, store))
        carry_out_write(ui, r, o, store);
    known_free(&o->plant);
    json_decref(o->seen);
    free(o->approval.row);
    free(o->names);
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

void post_retake(struct ui *ui, struct request *r, struct apc_store *store)
{
    write_order(ui, r, store, WRITE_RETAKE);
}

void post_approve(struct ui *ui, struct request *r, struct apc_store *store)
{
    write_order(ui, r, store, WRITE_APPROVE);
}

void post_undo(struct ui *ui, struct request *r, struct apc_store *store)
{
    write_order(ui, r, store, WRITE_UNDO);
}

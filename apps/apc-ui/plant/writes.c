/* SPDX-License-Identifier: BSD-3-Clause */
#include "writes.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#define EVENT_LATE (2 * APC_NS_PER_S) /* after the row that it tells of */

struct writes {
    pthread_mutex_t mutex;
    struct write at[WRITES]; /* a ring */
    uint64_t next;
    write_told told;
    void *ctx;
};

int writes_create(struct writes **writes, write_told told, void *ctx)
{
    struct writes *w = *writes = calloc(1, sizeof *w);
    if (!w)
        return APC_ENOMEM;
    w->told = told;
    w->ctx = ctx;
    return pthread_mutex_init(&w->mutex, NULL) ? APC_ESYS : 0;
}

void writes_destroy(struct writes *w)
{
    if (!w)
        return;
    for (size_t i = 0; i < WRITES; i++)
        free(w->at[i].change);
    pthread_mutex_destroy(&w->mutex);
    free(w);
}

bool key_ok(const char *key)
{
    size_t n = strspn(key, "abcdefghijklmnopqrstuvwxyzABCDEFGHIJKLMNOPQRSTUVWXYZ0123456789_-");
    return n >= 8 && n < KEY_LEN && key[n] == '\0';
}

/* ---- JSON --------------------------------------------------------------------------------- */

static void change_json(const struct write *write, const struct change *c, struct text *t)
{
    char ref[REF_LEN];
    json_add(t, "{ref:%s, name:%s, from:%g, to:%g, seq:%jd", ref_format(c->after.table, c->after.id, ref),
             c->to.name, c->before.seq > 0 ? c->before.value : (double)NAN, c->after.value,
             write->stored == 1 ? c->after.seq : JSON_NONE);
    if (c->over > 0)
        json_add(t, "over:%g", c->over);
    json_add(t, "}");
}

void write_json(const struct write *write, struct text *t)
{
    static const char *const kinds[] = {
        [WRITE_SETPOINT] = "setpoint", [WRITE_OUTPUT] = "output",   [WRITE_MODE] = "mode",
        [WRITE_OWNER] = "owner",       [WRITE_TUNING] = "tuning",   [WRITE_UNDO] = "undo",
        [WRITE_RETAKE] = "retake",     [WRITE_APPROVE] = "approve", [WRITE_ACK] = "ack",
        [WRITE_SHELVE] = "shelve",     [WRITE_SERVICE] = "service"};
    static const char *const states[] = {
        [WRITE_BEGUN] = "unknown",         [WRITE_ACCEPTED] = "accepted", [WRITE_APPLIED] = "applied",
        [WRITE_SUPERSEDED] = "superseded", [WRITE_FAILED] = "failed",     [WRITE_UNKNOWN] = "unknown"};
    json_add(t, "{key:%s, kind:%s, user:%s, time:%.6jd, state:%s, stored:%i, reason:%-s", write->key,
             kinds[write->kind], write->user, write->time, states[write->state], write->stored,
             write->reason);
    if (write->confirm)
        json_add(t, "confirm:%i", 1);
    if (write->waits)
        json_add(t, "waits:%i", 1);
    json_add(t, "changes:[");
    for (size_t i = 0; i < write->n; i++)
        change_json(write, &write->change[i], t);
    json_add(t, "]}");
}

size_t writes_json(struct writes *w, const char *key, struct text *t)
{
    size_t n = 0;
    pthread_mutex_lock(&w->mutex);
    for (uint64_t i = w->next > WRITES ? w->next - WRITES : 0; i < w->next; i++) {
        const struct write *write = &w->at[i % WRITES];
        if (key && strcmp(key, write->key) != 0)
            continue;
        write_json(write, t);
        n++;
    }
    pthread_mutex_unlock(&w->mutex);
    return n;
}

/* ---- Begin and end ------------------------------------------------------------------------ */

static struct write *find_write(struct writes *w, const char *key)
{
    for (size_t i = 0; i < WRITES; i++)
        if (w->at[i].n > 0 && !strcmp(w->at[i].key, key))
            return &w->at[i];
    return NULL;
}

/* They outlive the plant that they were found in. */
static void keep_changes(struct change *to, const struct change *from, size_t n)
{
    memcpy(to, from, n * sizeof *to);
    for (size_t i = 0; i < n; i++) {
        to[i].to.loop = NULL;
        to[i].by = NULL;
    }
}

static int begin_write(struct writes *w, const struct write *write)
{
    struct change *change = calloc(write->n + 1, sizeof *change);
    struct write *place = &w->at[w->next % WRITES];
    if (!change)
        return APC_ENOMEM;
    keep_changes(change, write->change, write->n);
    free(place->change);
    *place = *write;
    place->change = change;
    place->state = WRITE_BEGUN;
    place->stored = -1;
    place->asked = -1;
    place->wanted = write->n;
    w->next++;
    return 0;
}

static bool same_request(const struct write *a, const struct write *b)
{
    return a->kind == b->kind && !strcmp(a->user, b->user) && a->undoes == b->undoes;
}

static bool same_write(const struct write *a, const struct write *b)
{
    bool same = same_request(a, b) && a->wanted == b->n;
    for (size_t i = 0; i < b->n && same; i++) {
        const struct apc_sample *x = &a->change[i].after, *y = &b->change[i].after;
        same = x->table == y->table && x->id == y->id && a->change[i].over == b->change[i].over &&
               a->change[i].stop == b->change[i].stop &&
               (a->change[i].stop || (x->value >= y->value && x->value <= y->value));
    }
    return same;
}

static int tell_known(const struct write *known, bool same, struct text *t)
{
    if (known->state == WRITE_BEGUN)
        return APC_EBUSY;
    if (!same)
        return APC_ECONFLICT;
    write_json(known, t);
    return 1;
}

int writes_begin(struct writes *w, const struct write *write, struct text *t)
{
    pthread_mutex_lock(&w->mutex);
    const struct write *known = find_write(w, write->key);
    const int rc = known ? tell_known(known, same_write(known, write), t) : begin_write(w, write);
    pthread_mutex_unlock(&w->mutex);
    return rc;
}

int writes_again(struct writes *w, const struct write *write, struct text *t)
{
    pthread_mutex_lock(&w->mutex);
    const struct write *known = find_write(w, write->key);
    const int rc = known ? tell_known(known, same_request(known, write), t) : 0;
    pthread_mutex_unlock(&w->mutex);
    return rc;
}

static void turn_write(struct writes *w, struct write *write, enum write_state state, int stored,
                       const char *reason)
{
    write->state = state;
    write->stored = stored;
    snprintf(write->reason, sizeof write->reason, "%s", reason);
    w->told(w->ctx, write);
}

void writes_end(struct writes *w, const char *key, const struct write *ended, const char *reason, apc_ns now,
                struct text *t)
{
    pthread_mutex_lock(&w->mutex);
    struct write *write = find_write(w, key);
    if (write) {
        write->n = ended->n <= write->n ? ended->n : write->n + 1; /* begin_write() left room for one */
        keep_changes(write->change, ended->change, write->n);
        write->ended = now;
        write->confirm = ended->confirm;
        write->waits = ended->waits;
        turn_write(w, write, ended->state, ended->stored, reason);
        write_json(write, t);
    }
    pthread_mutex_unlock(&w->mutex);
}

/* ---- Settling ----------------------------------------------------------------------------- */

static const struct apc_sample *newest(const struct seen *seen, enum apc_table table, int id)
{
    for (size_t i = 0; i < seen->n; i++)
        if (seen->samples[i].table == table && seen->samples[i].id == id)
            return &seen->samples[i];
    return NULL;
}

static bool is_ours(const struct apc_sample *s, const struct apc_sample *ours)
{
    return s->time == ours->time && s->value >= ours->value && s->value <= ours->value;
}

/* Nobody answered whether it was stored: the rows tell, once one of the seqs is taken. Where the seq was the
 * store's to give, only our own row tells anything. */
static void settle_stored(struct writes *w, struct write *write, const struct seen *seen, apc_ns now)
{
    struct apc_sample *ours = &write->change[0].after;
    const bool given = ours->seq > 0;
    const struct apc_sample *s = newest(seen, ours->table, ours->id);
    if (!s || s->seq == 0 || (given && s->seq < ours->seq))
        return;
    if ((!given || s->seq == ours->seq) && is_ours(s, ours)) {
        ours->seq = s->seq;
        write->ended = now;
        turn_write(w, write, WRITE_ACCEPTED, 1, "");
    } else if (given && s->seq == ours->seq) {
        turn_write(w, write, WRITE_FAILED, 0, "it was not written: another write came first");
    }
}

static struct apc_sample newest_like(const struct seen *seen, const struct apc_sample *like)
{
    const struct apc_sample *row = newest(seen, like->table, like->id);
    return row ? *row : (struct apc_sample){.table = like->table, .id = like->id};
}

/* What is seen of it goes into it. False: it was written after they were read. */
static bool see_change(const struct seen *seen, struct change *c)
{
    const struct apc_sample *own = newest(seen, c->newest.table, c->newest.id);
    c->newest = newest_like(seen, &c->newest);
    c->actual = newest_like(seen, &c->actual);
    c->mode = newest_like(seen, &c->mode);
    const int by = own ? seen->by[own - seen->samples] : -1;
    c->by = NULL;
    c->tick = (struct apc_vector){0};
    if (by >= 0) {
        c->by = &seen->controller[by];
        c->tick = seen->tick[by];
        c->period = c->by->period;
    }
    return own != NULL;
}

/* Of what was asked for, in one transaction, the part that is furthest from being in force. */
static struct change *worst(const struct seen *seen, struct write *write)
{
    static const int rank[] = {[OUTCOME_APPLIED] = 1,
                               [OUTCOME_SUPERSEDED] = 2,
                               [OUTCOME_WAITING] = 3,
                               [OUTCOME_NOBODY] = 4,
                               [OUTCOME_REFUSED] = 5};
    struct change *of = write->change;
    for (size_t i = 0; i < write->wanted; i++) {
        struct change *c = &write->change[i];
        c->outcome = see_change(seen, c) ? change_judge(c, seen->utc) : OUTCOME_WAITING;
        if (rank[c->outcome] > rank[of->outcome])
            of = c;
    }
    return of;
}

/* The state says some of the words. */
static void tell_finish(struct writes *w, struct write *write, enum write_state state, const struct change *c,
                        const struct seen *seen)
{
    struct change_fault said;
    (void)change_finish(c, seen->utc, &said);
    const size_t n = strlen(said.code);
    const bool twice = !strncmp(said.text, said.code, n) && said.text[n] == ':';
    turn_write(w, write, state, 1, state == WRITE_APPLIED ? "" : said.text + (twice ? n + 2 : 0));
}

/* Returns whether its event is wanted, once a round. */
static bool refused(struct writes *w, struct write *write, struct change *c, const struct seen *seen,
                    apc_ns now, struct refusal *r)
{
    const bool found = !strcmp(r->key, write->key) && r->text[0];
    if (!found && write->asked != now) {
        write->asked = now;
        *r = (struct refusal){.since = write->time};
        memcpy(r->key, write->key, sizeof r->key);
        memcpy(r->name, c->to.name, sizeof r->name);
        return true;
    }
    if (found)
        memcpy(c->refusal, r->text, sizeof c->refusal);
    if (found || now - write->ended > EVENT_LATE)
        tell_finish(w, write, WRITE_FAILED, c, seen);
    return false;
}

static bool settle_used(struct writes *w, struct write *write, const struct seen *seen, apc_ns now,
                        struct refusal *r)
{
    struct change *c = worst(seen, write);
    switch (c->outcome) {
    case OUTCOME_APPLIED:
        tell_finish(w, write, WRITE_APPLIED, c, seen);
        break;
    case OUTCOME_SUPERSEDED:
        tell_finish(w, write, WRITE_SUPERSEDED, c, seen);
        break;
    case OUTCOME_REFUSED:
        return refused(w, write, c, seen, now, r);
    case OUTCOME_NOBODY:
    case OUTCOME_WAITING:
        if (write->state == WRITE_ACCEPTED &&
            (c->outcome == OUTCOME_NOBODY || now - write->ended > change_patience(c)))
            tell_finish(w, write, WRITE_UNKNOWN, c, seen);
        break;
    }
    return false;
}

size_t writes_open(struct writes *w, struct apc_sample *rows)
{
    size_t n = 0;
    pthread_mutex_lock(&w->mutex);
    for (size_t i = 0; i < WRITES; i++) {
        const struct write *write = &w->at[i];
        if (write->kind < WRITE_ACK || (write->state != WRITE_ACCEPTED && write->state != WRITE_UNKNOWN))
            continue;
        const int id = write->change[0].after.id;
        rows[n++] = (struct apc_sample){.table = APC_OPMODE, .id = id};
        rows[n++] = (struct apc_sample){.table = APC_ACTUAL, .id = apc_variable_number(APC_OPMODE, id)};
    }
    pthread_mutex_unlock(&w->mutex);
    return n;
}

bool writes_settle(struct writes *w, const struct seen *seen, apc_ns now, struct refusal *refusal)
{
    bool asks = false;
    pthread_mutex_lock(&w->mutex);
    for (uint64_t i = w->next > WRITES ? w->next - WRITES : 0; i < w->next && !asks; i++) {
        struct write *write = &w->at[i % WRITES];
        if (write->state == WRITE_UNKNOWN && write->stored < 0)
            settle_stored(w, write, seen, now);
        if (write->state == WRITE_ACCEPTED || (write->state == WRITE_UNKNOWN && write->stored == 1))
            asks = settle_used(w, write, seen, now, refusal);
    }
    pthread_mutex_unlock(&w->mutex);
    return asks;
}

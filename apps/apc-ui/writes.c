/* SPDX-License-Identifier: BSD-3-Clause */
#include "writes.h"

#include <inttypes.h>
#include <stdlib.h>
#include <string.h>

#include "plant.h"

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

static void change_json(const struct write *write, const struct write_change *c, struct text *t)
{
    char ref[REF_LEN];
    text_add(t, "{\"ref\":\"%s\",\"name\":", ref_format(c->after.table, c->after.id, ref));
    json_string_add(t, c->name);
    text_add(t, ",\"from\":");
    if (c->before.seq > 0)
        json_number_add(t, c->before.value);
    else
        text_add(t, "null");
    text_add(t, ",\"to\":");
    json_number_add(t, c->after.value);
    if (write->stored == 1)
        text_add(t, ",\"seq\":%" PRId64 "},", c->after.seq);
    else
        text_add(t, ",\"seq\":null},");
}

void write_json(const struct write *write, struct text *t)
{
    static const char *const kinds[] = {[WRITE_SETPOINT] = "setpoint",
                                        [WRITE_OUTPUT] = "output",
                                        [WRITE_MODE] = "mode",
                                        [WRITE_TUNING] = "tuning"};
    static const char *const states[] = {[WRITE_BEGUN] = "unknown",
                                         [WRITE_ACCEPTED] = "accepted",
                                         [WRITE_APPLIED] = "applied",
                                         [WRITE_FAILED] = "failed",
                                         [WRITE_UNKNOWN] = "unknown"};
    text_add(t, "{\"key\":\"%s\",\"kind\":\"%s\",\"user\":", write->key, kinds[write->kind]);
    json_string_add(t, write->user);
    text_add(t, ",\"time\":");
    json_time_add(t, write->time);
    text_add(t, ",\"state\":\"%s\",\"stored\":%s,\"reason\":", states[write->state],
             write->stored < 0 ? "null"
             : write->stored   ? "true"
                               : "false");
    json_string_add(t, write->reason[0] ? write->reason : NULL);
    text_add(t, ",\"changes\":[");
    for (size_t i = 0; i < write->n; i++)
        change_json(write, &write->change[i], t);
    text_chop(t, ',');
    text_add(t, "]}");
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
        text_add(t, ",");
        n++;
    }
    text_chop(t, ',');
    pthread_mutex_unlock(&w->mutex);
    return n;
}

/* ---- Begin and end ------------------------------------------------------------------------ */

static struct write *find(struct writes *w, const char *key)
{
    for (size_t i = 0; i < WRITES; i++)
        if (w->at[i].n > 0 && !strcmp(w->at[i].key, key))
            return &w->at[i];
    return NULL;
}

static int begin(struct writes *w, const struct write *write)
{
    struct write_change *change = calloc(write->n, sizeof *change);
    struct write *place = &w->at[w->next % WRITES];
    if (!change)
        return APC_ENOMEM;
    memcpy(change, write->change, write->n * sizeof *change);
    free(place->change);
    *place = *write;
    place->change = change;
    place->state = WRITE_BEGUN;
    place->stored = -1;
    place->taken = -1;
    w->next++;
    return 0;
}

int writes_begin(struct writes *w, const struct write *write, struct text *t)
{
    int rc;
    pthread_mutex_lock(&w->mutex);
    const struct write *known = find(w, write->key);
    if (!known) {
        rc = begin(w, write);
    } else if (known->state == WRITE_BEGUN) {
        rc = APC_EBUSY;
    } else {
        write_json(known, t);
        rc = 1;
    }
    pthread_mutex_unlock(&w->mutex);
    return rc;
}

static void turn(struct writes *w, struct write *write, enum write_state state, int stored,
                 const char *reason)
{
    write->state = state;
    write->stored = stored;
    snprintf(write->reason, sizeof write->reason, "%s", reason);
    w->told(w->ctx, write);
}

void writes_end(struct writes *w, const char *key, enum write_state state, int stored, const char *reason,
                const struct write_change *change, apc_ns now, struct text *t)
{
    pthread_mutex_lock(&w->mutex);
    struct write *write = find(w, key);
    if (write) {
        memcpy(write->change, change, write->n * sizeof *change);
        write->ended = now;
        turn(w, write, state, stored, reason);
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

static double total(const struct seen *seen)
{
    double sum = 0;
    for (size_t i = 0; i < seen->n; i++) {
        const struct apc_sample *s = &seen->samples[i];
        if (s->table == APC_SETPOINT || s->table == APC_TUNING || s->table == APC_MANUAL ||
            (s->table == APC_OPMODE && s->id == 0))
            sum += (double)s->seq;
    }
    return sum;
}

/* Nobody answered whether it was stored: the rows tell, once one of the seqs is taken. */
static void settle_stored(struct writes *w, struct write *write, const struct seen *seen, apc_ns now)
{
    const struct write_change *c = &write->change[0];
    const struct apc_sample *s = newest(seen, c->after.table, c->after.id);
    if (!s || s->seq < c->after.seq)
        return;
    if (s->seq == c->after.seq && s->time == c->after.time && !(s->value < c->after.value) &&
        !(s->value > c->after.value)) {
        write->ended = now;
        turn(w, write, WRITE_ACCEPTED, 1, "");
    } else if (s->seq == c->after.seq) {
        turn(w, write, WRITE_FAILED, 0, "it was not written: somebody else wrote first");
    }
}

static void settle_used(struct writes *w, struct write *write, const struct seen *seen, apc_ns now)
{
    const struct write_change *c = &write->change[0];
    const struct apc_sample *own = newest(seen, c->after.table, c->after.id);
    if (write->taken < 0 && own && own->seq >= c->after.seq)
        write->taken = total(seen);
    if (write->taken >= 0 && seen->taken >= write->taken) {
        const struct apc_sample *actual = newest(seen, APC_OPMODE, 1);
        double mode = actual && actual->seq > 0 ? actual->value : -1;
        char reason[160];
        if (write->kind != WRITE_MODE || (own && own->seq > c->after.seq) ||
            !(mode < c->after.value || mode > c->after.value)) {
            turn(w, write, WRITE_APPLIED, 1, "");
            return;
        }
        const char *name = mode < 0 ? NULL : apc_mode_name((int)mode);
        snprintf(reason, sizeof reason, "the controller is in %s", name ? name : "no mode");
        turn(w, write, WRITE_FAILED, 1, reason);
    } else if (write->state == WRITE_ACCEPTED && now - write->ended > seen->patience) {
        turn(w, write, WRITE_UNKNOWN, 1, "it is stored, but the controller has not confirmed it");
    }
}

void writes_settle(struct writes *w, const struct seen *seen, apc_ns now)
{
    pthread_mutex_lock(&w->mutex);
    for (uint64_t i = w->next > WRITES ? w->next - WRITES : 0; i < w->next; i++) {
        struct write *write = &w->at[i % WRITES];
        if (write->state == WRITE_UNKNOWN && write->stored < 0)
            settle_stored(w, write, seen, now);
        if (write->state == WRITE_ACCEPTED || (write->state == WRITE_UNKNOWN && write->stored == 1))
            settle_used(w, write, seen, now);
    }
    pthread_mutex_unlock(&w->mutex);
}

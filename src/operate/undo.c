/* SPDX-License-Identifier: BSD-3-Clause */
/*
 * What takes back somebody's last write. All rows of one write have its time and its author (operation.c), so
 * the rows of operators' variables of the last minute say which it was, and who came after.
 */
#include "operate.h"

#include <stdlib.h>
#include <string.h>

#define LOOKS 64 /* rows that a manual output's newest is sought in; it is told of once, or after restarts */

struct last_write {
    uint32_t author;
    apc_ns time;            /* of the latest that was found; 0: none */
    struct apc_sample *row; /* [n] of that time */
    size_t n;
};

static int take_written_row(void *ctx, const struct apc_sample *row)
{
    struct last_write *w = ctx;
    if (row->author != w->author || row->time < w->time)
        return 0;
    if (row->time > w->time)
        w->n = 0;
    w->time = row->time;
    const bool again = w->n > 0 && w->row[w->n - 1].table == row->table && w->row[w->n - 1].id == row->id;
    if (!again) /* of a repeated put one row */
        w->row[w->n++] = *row;
    return 0;
}

static int find_last_write(struct last_write *w, struct apc_store *store, const struct plant_view *plant,
                           apc_ns since)
{
    const struct apc_range late = {.since = since};
    struct apc_sample *now = calloc(plant->n + 1, sizeof *now);
    size_t n = 0;
    if (!now)
        return APC_ENOMEM;
    for (size_t i = 0; i < plant->n; i++)
        if (change_is_of(&plant->tag[i]))
            now[n++] = (struct apc_sample){.table = plant->tag[i].table, .id = plant->tag[i].id};
    int rc = apc_store_read(store, now, n);
    for (size_t i = 0; i < n && rc >= 0; i++)
        if (now[i].seq > 0 && now[i].time >= since)
            rc = apc_store_history(store, now[i].table, now[i].id, &late, take_written_row, w);
    free(now);
    return rc < 0 ? rc : 0;
}

static const struct apc_sample *row_of_write(const struct last_write *w, enum apc_table table, int id)
{
    for (size_t i = 0; i < w->n; i++)
        if (w->row[i].table == table && w->row[i].id == id)
            return &w->row[i];
    return NULL;
}

/* ---- What was before ----------------------------------------------------------------------- */

static int take_first_row(void *ctx, const struct apc_sample *row)
{
    *(struct apc_sample *)ctx = *row;
    return 1;
}

/* What @p row took the place of. seq 0: nothing is known. Returns 0 or the store's error. */
static int read_former(struct apc_store *store, const struct apc_sample *row, struct apc_sample *former)
{
    const struct apc_range from = {.after = row->seq > 2 ? row->seq - 2 : 0};
    const int rc = apc_store_history(store, row->table, row->id, &from, take_first_row, former);
    if (former->seq != row->seq - 1)
        former->seq = 0;
    return rc < 0 ? rc : 0;
}

struct looked_at {
    int64_t seq; /* of the row that was looked at */
    apc_ns time; /* when first; 0: it was not */
};

static int take_looked_at(void *ctx, const struct apc_sample *actual)
{
    struct looked_at *l = ctx;
    if (actual->origin == l->seq)
        l->time = actual->time;
    return l->time > 0;
}

/* What went out before: of the output, the last row before the tick at which its controller looked at @p row,
 * which gives both that tick's time. Not yet, then the newest. */
static int read_former_output(struct apc_store *store, const struct loops_loop *loop,
                              const struct apc_sample *row, struct apc_sample *former)
{
    struct looked_at looked = {.seq = row->seq};
    const struct apc_range late = {.last = LOOKS};
    int rc = apc_store_history(store, APC_ACTUAL, apc_variable_number(row->table, row->id), &late,
                               take_looked_at, &looked);
    const struct apc_range before = {.until = looked.time, .last = 1};
    if (rc >= 0)
        rc = apc_store_history(store, loop->table, loop->output, &before, take_first_row, former);
    return rc < 0 ? rc : 0;
}

/* ---- Undoing ------------------------------------------------------------------------------- */

static int fail_overtaken(struct apc_store *store, const struct change *c, struct change_fault *why)
{
    char author[APC_AUTHOR_LEN] = "", text[CHANGE_TEXT];
    if (c->newest.author == 0 || apc_store_author_name(store, c->newest.author, author) < 0)
        author[0] = '\0';
    change_text(&c->newest, text);
    if (!author[0])
        return change_fail(why, APC_ECONFLICT, "stale", "%.60s was changed since: it is %s now", c->to.name,
                           text);
    return change_fail(why, APC_ECONFLICT, "stale", "%.60s was changed since by %s: it is %s now", c->to.name,
                       author, text);
}

/* Did the write of @p row begin a ramp? What its mover has written since, under no name, is no other write. */
static int look_at_ramp(struct apc_store *store, const struct apc_sample *row, struct change *c,
                        struct change_fault *why)
{
    struct apc_sample now[] = {{.table = row->table, .id = LOOPS_RAMP(row->id)},
                               {.table = row->table, .id = row->id}};
    const bool may_be = row->table == APC_SETPOINT || row->table == APC_MANUAL;
    const int rc = may_be ? apc_store_read(store, now, 2) : 0;
    if (rc < 0)
        return change_fail(why, rc, "store", "%s", apc_store_error(store));
    if (now[0].seq == 0 || now[0].time != row->time || now[0].author != row->author)
        return 0;
    c->after.seq = APC_SEQ_ANY;
    c->newest = now[1];
    return now[1].author != 0 && now[1].seq != row->seq ? fail_overtaken(store, c, why) : 0;
}

static bool is_remote_owner(const struct apc_sample *owner)
{
    return loops_is_owner_id(owner->id) ? !loops_is_local(owner)
                                        : owner->seq > 0 && owner->value >= (double)APC_MODE_CAS;
}

/* The row of the write that says whose this setpoint is; NULL: none does. */
static const struct apc_sample *owner_in_write(const struct last_write *w, const struct loops *loops,
                                               int setpoint)
{
    const struct loops_loop *loop = loops_of(loops, APC_SETPOINT, setpoint);
    return loops_scheduled(loops, setpoint) ? row_of_write(w, APC_OPMODE, LOOPS_OWNER(setpoint))
           : loop && loop->above >= 0       ? row_of_write(w, APC_OPMODE, loop->id)
                                            : NULL;
}

/* One more change, back from @p row. Of a setpoint that was taken from its owner nothing: he gets it back as it
 * is. One that was given to its owner has been moved by him since. */
static int undo_row(struct operation *o, struct apc_store *store, const struct last_write *w,
                    const struct apc_sample *row, struct change_fault *why)
{
    const struct apc_sample *owner =
        row->table == APC_SETPOINT ? owner_in_write(w, o->plant->loops, row->id) : NULL;
    struct apc_sample former = {.table = row->table, .id = row->id};
    struct change *c = &o->change[o->n];
    struct change_target to;

    if (owner && !is_remote_owner(owner))
        return 0;
    int rc = change_at(o->plant, row->table, row->id, &to, why);
    if (rc < 0)
        return rc;
    rc = to.table == APC_MANUAL && to.loop ? read_former_output(store, to.loop, row, &former)
                                           : read_former(store, row, &former);
    if (rc < 0)
        return change_fail(why, rc, "store", "%s", apc_store_error(store));
    if (former.seq == 0 && loops_is_owner_id(row->id) && row->table == APC_OPMODE && row->seq == 1)
        former = (struct apc_sample){.seq = 1, .value = 1}; /* the scheduler's, as it is without a row */
    if (former.seq == 0 || apc_status_severity(former.status) == APC_SEVERITY_BAD)
        return change_fail(why, APC_EPERM, "value", "%.60s had no good value before: set it", to.name);
    rc = change_check(&to, former.value, why);
    if (rc < 0)
        return rc;
    change_make(o->plant, &to, former.value, c);
    c->after.seq = owner ? APC_SEQ_ANY : row->seq;
    o->n++;
    return look_at_ramp(store, row, c, why);
}

int operation_check(const struct operation *o, struct apc_store *store, struct change_fault *why)
{
    int rc = 0;
    for (size_t i = 0; i < o->n && rc == 0; i++) {
        const struct change *c = &o->change[i];
        rc = c->after.seq != APC_SEQ_ANY && c->after.seq != c->newest.seq
                 ? fail_overtaken(store, c, why)
                 : change_now(o->plant, &c->to, &c->mode, why);
    }
    return rc;
}

static int fail_no_write(const struct operation *o, apc_ns only, struct change_fault *why)
{
    return change_fail(why, APC_EPERM, "undo",
                       only > 0 ? "it is not the last write of %.40s of the last minute: nothing was written"
                                : "there is nothing to undo: %.40s has written nothing for a minute",
                       o->author);
}

int operation_undo(struct operation *o, struct apc_store *store, apc_ns only, struct change_fault *why)
{
    struct last_write w = {.row = calloc(o->plant->n + 1, sizeof *w.row)};
    o->change = calloc(o->plant->n + 1, sizeof *o->change);
    const int author = w.row && o->change ? apc_store_author(store, o->author) : APC_ENOMEM;
    w.author = author > 0 ? (uint32_t)author : 0;
    int rc = author < 0 ? author : find_last_write(&w, store, o->plant, apc_clock_utc(NULL) - UNDO_WITHIN);
    if (rc < 0)
        rc = change_fail(why, rc, "store", "%s", rc == APC_ENOMEM ? "out of memory" : apc_store_error(store));
    else if (w.n == 0 || (only > 0 && w.time / APC_NS_PER_US != only / APC_NS_PER_US))
        rc = fail_no_write(o, only, why);
    for (size_t i = 0; i < w.n && rc == 0; i++)
        rc = undo_row(o, store, &w, &w.row[i], why);
    if (rc == 0 && operation_look(o, store) < 0)
        rc = change_fail(why, APC_ESTORE, "store", "%s", apc_store_error(store));
    if (rc == 0)
        rc = operation_check(o, store, why);
    o->confirmed = true; /* it was in force before */
    free(w.row);
    return rc;
}

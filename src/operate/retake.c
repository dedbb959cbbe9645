/* SPDX-License-Identifier: BSD-3-Clause */
/*
 * What people had set at a past instant, to be written once more. A variable is known by its name: its number may
 * have been another one's then.
 */
#include "operate.h"

#include <stdlib.h>
#include <string.h>

struct taken {
    const struct apc_tag *tag; /* as it was described then */
    struct apc_sample was, now;
    bool chosen;
};

/* The rows that an instant consists of, of both times, and which of them are asked for. */
struct taking {
    const struct retake *of;
    const struct plant_view *plant;
    struct taken *at; /* [n] */
    size_t n;
    char time[APC_TIME_LEN];
};

static bool is_target(const struct apc_tag *tag)
{
    return tag->table == APC_OPMODE && tag->id > 0 && tag->id < LOOPS_IDS;
}

static bool is_taken(const struct apc_tag *tag)
{
    return tag->table == APC_SETPOINT || tag->table == APC_TUNING || is_target(tag) ||
           (tag->table == APC_OPMODE && loops_is_owner_id(tag->id));
}

/* ---- Which --------------------------------------------------------------------------------- */

static bool is_called_within(const char *name, const char *whole)
{
    const size_t n = strlen(whole);
    return strncmp(name, whole, n) == 0 && (name[n] == '\0' || name[n] == '.');
}

/* By its own name, or as what belongs to a loop or to a controller of that name. */
static bool is_asked_for(const struct plant_view *plant, const struct apc_tag *tag, const char *name)
{
    const struct loops_loop *loop = loops_find(plant->loops, name);
    const struct apc_tag *setpoint = loop ? plant_tag(plant, APC_SETPOINT, loop->setpoint) : NULL;
    const struct loops_controller *by = loop ? &plant->loops->controller[loop->controller] : NULL;
    return is_called_within(tag->name, name) || strcmp(tag->controller, name) == 0 ||
           (loop && is_target(tag) && strcmp(tag->name, loop->name) == 0) ||
           (setpoint && tag->table != APC_TUNING && is_called_within(tag->name, setpoint->name)) ||
           (by && by->n == 1 && tag->table == APC_TUNING && strcmp(tag->controller, by->name) == 0);
}

static const struct apc_tag *tag_of_name(const struct plant_view *plant, const struct apc_tag *was)
{
    for (size_t i = 0; i < plant->n; i++)
        if (plant->tag[i].table == was->table && strcmp(plant->tag[i].name, was->name) == 0)
            return &plant->tag[i];
    return NULL;
}

static bool is_chosen(const struct taking *t, const struct apc_tag *tag)
{
    const struct retake *of = t->of;
    size_t k = 0;
    while (k < of->n_names && !is_asked_for(t->plant, tag, of->name[k]))
        k++;
    return of->n_names == 0 || k < of->n_names;
}

/* Is there anything of that name? */
static int check_asked_name(const struct taking *t, const struct apc_tag *tag, size_t n, const char *name,
                            struct change_fault *why)
{
    struct change_target none;
    for (size_t i = 0; i < n; i++)
        if (is_taken(&tag[i]) && is_asked_for(t->plant, &tag[i], name))
            return 0;
    return change_find(t->plant, name, CHANGE_MODE, &none, why) < 0
               ? why->err
               : change_fail(why, APC_ENOTFOUND, "variable", "%.60s: there was none as of %s", name, t->time);
}

static int list_taken(struct taking *t, struct change_fault *why)
{
    const struct retake *of = t->of;
    const struct apc_tag *tag = of->tag ? of->tag : t->plant->tag;
    const size_t n = of->tag ? of->n : t->plant->n;
    int rc = 0;
    t->at = calloc(n + 1, sizeof *t->at);
    if (!t->at)
        return change_fail(why, APC_ENOMEM, "store", "out of memory");
    for (size_t k = 0; k < of->n_names && rc == 0; k++)
        rc = check_asked_name(t, tag, n, of->name[k], why);
    for (size_t i = 0; i < n && rc == 0; i++) {
        if (!is_taken(&tag[i]))
            continue;
        const struct apc_tag *is = tag_of_name(t->plant, &tag[i]);
        t->at[t->n++] = (struct taken){.tag = &tag[i],
                                       .was = {.table = tag[i].table, .id = tag[i].id},
                                       .now = {.table = tag[i].table, .id = is ? is->id : 0},
                                       .chosen = is_chosen(t, &tag[i])};
    }
    return rc;
}

/* ---- Of both times ------------------------------------------------------------------------- */

/* Of what is not there any more there is nothing to be read. */
static int read_taken(struct taking *t, struct apc_store *store, bool past, struct change_fault *why)
{
    struct apc_sample *row = calloc(t->n + 1, sizeof *row);
    size_t n = 0;
    int rc = row ? 0 : APC_ENOMEM;
    for (size_t i = 0; i < t->n && row; i++)
        if (past || t->at[i].now.id > 0)
            row[n++] = past ? t->at[i].was : t->at[i].now;
    if (row)
        rc = apc_store_read(store, row, n);
    n = 0;
    for (size_t i = 0; i < t->n && rc >= 0; i++)
        if (past || t->at[i].now.id > 0)
            *(past ? &t->at[i].was : &t->at[i].now) = row[n++];
    free(row);
    return rc < 0 ? change_fail(why, rc, "store", "%s", row ? apc_store_error(store) : "out of memory") : 0;
}

static const struct taken *find_taken(const struct taking *t, enum apc_table table, int id)
{
    for (size_t i = 0; i < t->n; i++)
        if (t->at[i].now.id > 0 && t->at[i].now.table == table && t->at[i].now.id == id)
            return &t->at[i];
    return NULL;
}

static bool is_target_mode(const struct apc_sample *target, enum apc_mode mode)
{
    return target->seq > 0 && target->value >= (double)mode && target->value <= (double)mode;
}

/* The row that says whose a setpoint is; NULL: nobody's but people's. */
static const struct taken *owner_of(const struct taking *t, const struct taken *setpoint)
{
    const struct loops *loops = t->plant->loops;
    const struct loops_loop *loop = loops_of(loops, APC_SETPOINT, setpoint->now.id);
    return loops_scheduled(loops, setpoint->now.id) ? find_taken(t, APC_OPMODE, LOOPS_OWNER(setpoint->now.id))
           : loop && loop->above >= 0 && loop->setpoint == setpoint->now.id
               ? find_taken(t, APC_OPMODE, loop->id)
               : NULL;
}

/* Is it moved by the scheduler or by a loop above, or does it follow the measurement? */
static bool owner_moves(const struct apc_sample *owner)
{
    return loops_is_owner(owner) ? !loops_is_local(owner)
                                 : is_target_mode(owner, APC_MODE_CAS) || is_target_mode(owner, APC_MODE_MAN);
}

static int is_on_ramp(struct apc_store *store, const struct taken *of, struct change_fault *why)
{
    struct apc_sample rate = {.table = of->now.table, .id = LOOPS_RATE(of->now.id)};
    if (of->now.table != APC_SETPOINT)
        return 0;
    const int rc = apc_store_read(store, &rate, 1);
    return rc < 0 ? change_fail(why, rc, "store", "%s", apc_store_error(store))
                  : rate.seq > 0 && rate.value > 0;
}

/* ---- The changes --------------------------------------------------------------------------- */

static int check_taken(const struct taking *t, const struct taken *of, struct change_fault *why)
{
    char status[APC_STATUS_NAME_LEN];
    const char *name = of->tag->name;
    const bool switches = loops_is_owner(&of->was);
    if (of->now.id == 0)
        return change_fail(why, APC_ENOTFOUND, "variable",
                           "%.60s was described as of %s, and is not any more: leave it out", name, t->time);
    if (of->was.seq == 0 && of->now.seq > 0 && !switches)
        return change_fail(why, APC_ENOTFOUND, "value", "%.60s has no value on record as of %s", name,
                           t->time);
    if (of->was.seq > 0 && apc_status_severity(of->was.status) != APC_SEVERITY_GOOD)
        return change_fail(why, APC_EPERM, "value", "%.60s: what it was as of %s is not certain, it is %s",
                           name, t->time, apc_status_format(of->was.status, status));
    return 0;
}

/* One more change, if there is any. */
static int take_again(const struct taking *t, const struct taken *of, struct apc_store *store,
                      struct operation *o, struct change_fault *why)
{
    const struct taken *owner = of->now.table == APC_SETPOINT ? owner_of(t, of) : NULL;
    const bool moved = owner && owner_moves(&owner->now);
    const bool switches = loops_is_owner(&of->was);
    const double value = switches ? !loops_is_local(&of->was) : of->was.value;
    struct change *c = &o->change[o->n];
    struct change_target to;
    if (owner && owner_moves(&owner->was))
        return 0;
    if (of->now.id == 0 && of->was.seq == 0)
        return 0;
    int rc = check_taken(t, of, why);
    if (rc < 0 || (of->was.seq == 0 && !switches))
        return rc;
    const int ramp = is_on_ramp(store, of, why);
    if (ramp < 0)
        return ramp;
    if (switches ? loops_is_local(&of->was) == loops_is_local(&of->now)
                 : !ramp && !moved && of->now.seq > 0 && of->now.value == value)
        return 0;
    rc = change_at(t->plant, of->now.table, of->now.id, &to, why);
    if (rc == 0)
        rc = change_check(&to, value, why);
    if (rc < 0)
        return rc;
    change_make(t->plant, &to, value, c);
    c->before = c->newest = of->now;
    c->after.seq = ramp || moved ? APC_SEQ_ANY : of->now.seq;
    o->n++;
    return 0;
}

static bool is_changed(const struct operation *o, int target)
{
    for (size_t i = 0; i < o->n; i++)
        if (o->change[i].to.table == APC_OPMODE && o->change[i].to.id == target)
            return true;
    return false;
}

/* May each be written as things stand, or as the modes become with it? */
static int check_modes_now(const struct taking *t, const struct operation *o, struct change_fault *why)
{
    int rc = 0;
    for (size_t i = 0; i < o->n && rc == 0; i++) {
        const struct change *c = &o->change[i];
        const struct taken *target =
            change_asks_mode(&c->to) ? find_taken(t, APC_OPMODE, c->to.loop->id) : NULL;
        if (target && !is_changed(o, c->to.loop->id))
            rc = change_now(t->plant, &c->to, &target->now, why);
    }
    return rc;
}

static bool has_any_then(const struct taking *t)
{
    size_t i = 0;
    while (i < t->n && t->at[i].was.seq == 0)
        i++;
    return i < t->n;
}

int operation_retake(struct operation *o, struct apc_store *store, const struct retake *of,
                     struct change_fault *why)
{
    struct taking t = {.of = of, .plant = o->plant};
    apc_time_format(apc_store_now(of->past), t.time);
    o->change = NULL;
    o->n = 0;
    int rc = list_taken(&t, why);
    if (rc == 0)
        rc = read_taken(&t, of->past, true, why);
    if (rc == 0)
        rc = read_taken(&t, store, false, why);
    if (rc == 0 && !has_any_then(&t))
        rc =
            change_fail(why, APC_ENOTFOUND, "value", "nothing that people set is on record as of %s", t.time);
    if (rc == 0 && !(o->change = calloc(t.n + 1, sizeof *o->change)))
        rc = change_fail(why, APC_ENOMEM, "store", "out of memory");
    for (size_t i = 0; i < t.n && rc == 0; i++)
        if (t.at[i].chosen)
            rc = take_again(&t, &t.at[i], store, o, why);
    if (rc == 0)
        rc = check_modes_now(&t, o, why);
    free(t.at);
    return rc;
}

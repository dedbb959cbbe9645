/* SPDX-License-Identifier: BSD-3-Clause */
#include "operate.h"

#include <stdlib.h>
#include <string.h>

#define TRIES 10

/* A setpoint that has an owner, and the row of table opmode that says whose it is: the target of its loop, or
 * a switch. */
struct owned {
    int setpoint, owner;               /* ids */
    bool cascade;                      /* a loop moves it, in Cas; else the scheduler */
    const struct loops_controller *by; /* of its loop; NULL: the scheduler */
};

/* One that is written to. */
struct affected {
    struct owned of;
    const struct apc_sample *owner, *setpoint; /* among what is written; NULL: is not */
    const struct apc_sample *now; /* newest: owner, setpoint, actual; the switch, where there is one */
};

struct order {
    struct apc_sample *samples;
    size_t n;
    struct affected *affected;
    size_t n_affected;
    struct apc_sample
        *now; /* [2 n + 4 n_affected] newest: of the samples; of each its rate; what is affected */
    struct apc_sample *rows; /* [2 n + n_affected] to be written */
    size_t n_rows;
};

static const struct apc_sample *written_sample(const struct order *o, enum apc_table table, int id)
{
    for (size_t i = 0; i < o->n; i++)
        if (o->samples[i].table == table && o->samples[i].id == id)
            return &o->samples[i];
    return NULL;
}

static void affect(struct order *o, struct owned of)
{
    const struct apc_sample *own = written_sample(o, APC_OPMODE, of.owner);
    const struct affected a = {.of = of,
                               .owner = own || !of.cascade ? own : written_sample(o, APC_OPMODE, 0),
                               .setpoint = written_sample(o, APC_SETPOINT, of.setpoint)};
    if (a.owner || a.setpoint)
        o->affected[o->n_affected++] = a;
}

static int prepare_order(struct order *o, const struct loops *loops, struct apc_sample *samples, size_t n)
{
    const size_t owned = loops->n + loops->n_scheduled;
    *o = (struct order){.samples = samples, .n = n, .affected = calloc(owned + 1, sizeof *o->affected)};
    o->now = calloc(2 * n + 4 * owned + 1, sizeof *o->now);
    o->rows = calloc(2 * n + owned + 1, sizeof *o->rows);
    if (!o->affected || !o->now || !o->rows)
        return APC_ENOMEM;
    for (size_t i = 0; i < loops->n; i++)
        if (loops->at[i].above >= 0)
            affect(o, (struct owned){loops->at[i].setpoint, loops->at[i].id, true,
                                     &loops->controller[loops->at[i].controller]});
    for (size_t i = 0; i < loops->n_scheduled; i++)
        affect(o, (struct owned){loops->scheduled[i], LOOPS_OWNER(loops->scheduled[i]), false, NULL});
    return 0;
}

static bool may_be_on_ramp(const struct apc_sample *s)
{
    return (s->table == APC_SETPOINT || s->table == APC_MANUAL) && s->id < LOOPS_IDS;
}

static bool has_ramps(const struct order *o)
{
    size_t i = 0;
    while (i < o->n && !may_be_on_ramp(&o->samples[i]))
        i++;
    return i < o->n;
}

static int read_owners(struct order *o, struct apc_store *store)
{
    struct apc_sample *at = o->now;
    for (size_t i = 0; i < o->n; i++)
        *at++ = (struct apc_sample){.table = o->samples[i].table, .id = o->samples[i].id};
    for (size_t i = 0; i < o->n; i++) /* of what has none its own row once more */
        *at++ = may_be_on_ramp(&o->samples[i])
                    ? (struct apc_sample){.table = o->samples[i].table, .id = LOOPS_RATE(o->samples[i].id)}
                    : o->now[i];
    for (size_t i = 0; i < o->n_affected; i++) {
        const struct owned *of = &o->affected[i].of;
        o->affected[i].now = at;
        *at++ = (struct apc_sample){.table = APC_OPMODE, .id = of->owner};
        *at++ = (struct apc_sample){.table = APC_SETPOINT, .id = of->setpoint};
        *at++ =
            (struct apc_sample){.table = APC_ACTUAL, .id = apc_variable_number(APC_SETPOINT, of->setpoint)};
        if (of->by && of->by->choice)
            *at++ = (struct apc_sample){.table = APC_OPMODE, .id = of->by->choice};
    }
    return apc_store_read(store, o->now, (size_t)(at - o->now));
}

/* Does anybody else's row stand where the caller knew another? */
static bool is_order_stale(const struct order *o)
{
    for (size_t i = 0; i < o->n; i++)
        if (o->samples[i].seq != APC_SEQ_ANY && o->samples[i].seq != o->now[i].seq)
            return true;
    return false;
}

static bool knows_nothing(const struct order *o)
{
    for (size_t i = 0; i < o->n; i++)
        if (o->samples[i].seq != APC_SEQ_ANY)
            return false;
    return true;
}

static bool is_cas(double target)
{
    return target >= (double)APC_MODE_CAS && target <= (double)APC_MODE_CAS;
}

static bool is_owner_remote(const struct apc_sample *owner, const struct owned *of)
{
    return of->cascade ? owner->seq > 0 && is_cas(owner->value) : !loops_is_local(owner);
}

static bool becomes_remote(const struct apc_sample *owner, const struct owned *of)
{
    return of->cascade ? is_cas(owner->value) : owner->value >= 1;
}

/* Is it the loop of the controller that acts? In shadow its target changes nothing now. */
static bool is_acting(const struct affected *a)
{
    const struct loops_controller *by = a->of.by;
    return !by || !by->choice || (a->now[3].seq > 0 ? a->now[3].value == by->number : by->acts);
}

static void add_to_order(struct order *o, const struct apc_sample *newest, double value)
{
    struct apc_sample *row = &o->rows[o->n_rows++];
    *row = *o->samples;
    row->table = newest->table;
    row->id = newest->id;
    row->seq = newest->seq;
    row->value = value;
}

static void add_affected(struct order *o)
{
    for (size_t i = 0; i < o->n_affected; i++) {
        const struct affected *a = &o->affected[i];
        const struct apc_sample *owner = a->now, *setpoint = owner + 1, *actual = owner + 2;
        const bool remote = is_owner_remote(owner, &a->of);
        if (!a->owner && remote)
            add_to_order(o, owner, a->of.cascade ? APC_MODE_AUTO : 0);
        if (a->owner && is_acting(a) && !a->setpoint && setpoint->seq > 0 &&
            remote != becomes_remote(a->owner, &a->of))
            add_to_order(o, setpoint,
                         setpoint->origin > 0 && actual->seq > 0 ? actual->value /* the loop above wrote it */
                                                                 : setpoint->value);
    }
}

static void end_ramps(struct order *o)
{
    for (size_t i = 0; i < o->n; i++) {
        const struct apc_sample *rate = &o->now[o->n + i];
        if (may_be_on_ramp(&o->samples[i]) && rate->seq > 0 && rate->value > 0 &&
            !written_sample(o, rate->table, rate->id))
            add_to_order(o, rate, 0);
    }
}

static int try(struct order *o, struct apc_store *store)
{
    int rc = read_owners(o, store);
    if (rc < 0)
        return rc;
    if (is_order_stale(o)) {
        memcpy(o->samples, o->now, o->n * sizeof *o->samples);
        return APC_ECONFLICT;
    }
    memcpy(o->rows, o->samples, o->n * sizeof *o->rows);
    for (size_t i = 0; i < o->n; i++)
        o->rows[i].seq = o->now[i].seq;
    o->n_rows = o->n;
    add_affected(o);
    end_ramps(o);
    rc = apc_store_swap(store, o->rows, o->n_rows);
    return rc == APC_ECONFLICT ? 1 : rc; /* again */
}

static int finish_order(struct order *o, int rc, struct owner_rows *with)
{
    if (rc == 1)
        memcpy(o->samples, o->now, o->n * sizeof *o->samples);
    for (size_t i = 0; i < o->n && rc == 0; i++)
        o->samples[i].seq = o->rows[i].seq;
    if (rc == 0) {
        with->n = o->n_rows - o->n;
        memmove(o->rows, o->rows + o->n, with->n * sizeof *o->rows);
        with->at = o->rows;
        o->rows = NULL;
    }
    return rc == 1 ? APC_ECONFLICT : rc;
}

int owner_put(struct apc_store *store, const struct loops *loops, struct apc_sample *samples, size_t n,
              struct owner_rows *with)
{
    struct order o;
    int rc = prepare_order(&o, loops, samples, n);
    *with = (struct owner_rows){0};
    if (rc == 0 && o.n_affected == 0 && knows_nothing(&o) && !has_ramps(&o)) {
        rc = apc_store_put(store, samples, n);
    } else if (rc == 0) {
        for (int i = 0; i < TRIES && (i == 0 || rc == 1); i++)
            rc = try(&o, store);
        rc = finish_order(&o, rc, with);
    }
    free(o.affected);
    free(o.now);
    free(o.rows);
    return rc;
}

/* SPDX-License-Identifier: BSD-3-Clause */
#include "operate.h"

#include <stdio.h>

#include "files/files.h"

/* Which takes two persons, of all controllers of its outputs? They are put in shadow or made to act together. */
static const struct loops_controller *takes_two_persons(const struct loops *loops,
                                                        const struct loops_controller *to)
{
    const struct loops_loop *mine = &loops->at[to->first];
    for (size_t i = 0; i < loops->n; i++)
        for (size_t k = 0; k < to->n; k++) {
            const struct loops_loop *loop = &loops->at[i];
            const struct loops_controller *of = &loops->controller[loop->controller];
            if (loop->table == mine[k].table && loop->output == mine[k].output &&
                loops_second(loops, APC_TICK, of->number) > 0)
                return of;
        }
    return NULL;
}

int promotion_find(struct promotion *p, const struct loops *loops, const char *name, struct change_fault *why)
{
    struct nearest nearest = {.wanted = name};
    const struct loops_controller *two;
    *p = (struct promotion){.loops = loops, .to = loops_controller(loops, name)};
    for (size_t i = 0; i < loops->n_controllers; i++)
        nearest_look(&nearest, loops->controller[i].name);
    if (!p->to)
        return change_fail(why, APC_ENOTFOUND, "variable", "there is no controller \"%.60s\"%s%s%s", name,
                           nearest.name ? ": did you mean \"" : "", nearest.name ? nearest.name : "",
                           nearest.name ? "\"?" : "");
    two = takes_two_persons(loops, p->to);
    if (two)
        return change_fail(why, APC_EPERM, "second",
                           "%s takes two persons, and apc promote asks no second one: change \"shadow\" in "
                           "the experiment file",
                           two->name);
    if (!p->to->choice)
        return change_fail(why, APC_EPERM, "mode", "%s acts already: no other controller has its outputs",
                           p->to->name);
    const int first = loops->at[p->to->first].id;
    p->choice = (struct apc_sample){.table = APC_OPMODE, .id = p->to->choice};
    p->target = (struct apc_sample){.table = APC_OPMODE, .id = first};
    p->actual = (struct apc_sample){.table = APC_ACTUAL, .id = apc_variable_number(APC_OPMODE, first)};
    p->tick = (struct apc_vector){.table = APC_TICK, .id = p->to->number};
    return 0;
}

int promotion_look(struct promotion *p, struct apc_store *store)
{
    struct apc_sample row[] = {p->choice, p->target, p->actual};
    struct apc_rows rows = {
        .size = sizeof rows, .sample = row, .n_samples = 3, .vector = &p->tick, .n_vectors = 1};
    p->tick.value = p->mark;
    p->tick.room = sizeof p->mark / sizeof *p->mark;
    const int rc = apc_store_read_rows(store, &rows);
    if (rc < 0)
        return rc;
    p->choice = row[0];
    p->target = row[1];
    p->actual = row[2];
    return 0;
}

const struct loops_controller *promotion_acting(const struct promotion *p)
{
    const struct loops *l = p->loops;
    for (size_t i = 0; i < l->n_controllers; i++) {
        const struct loops_controller *c = &l->controller[i];
        if (c->choice == p->choice.id && (p->choice.seq > 0 ? p->choice.value == (double)c->number : c->acts))
            return c;
    }
    return NULL;
}

bool promotion_is_done(const struct promotion *p)
{
    const bool wanted = p->target.seq > 0 && p->target.value != (double)APC_MODE_OOS;
    return !wanted || (p->actual.seq > 0 && p->actual.value != (double)APC_MODE_OOS);
}

int promotion_silent(const struct promotion *p, struct change_fault *why)
{
    return change_fail(why, APC_EPERM, "nobody",
                       "%s does not tick: no controller would act. Nothing was written", p->to->name);
}

int promotion_stale(const struct promotion *p, struct change_fault *why)
{
    return change_fail(why, APC_EPERM, "stale",
                       "%s runs with another law, other settings or another model than the plant is "
                       "described with: restart it. Nothing was written",
                       p->to->name);
}

int promotion_in_service(const struct promotion *p, struct change_fault *why)
{
    return p->target.seq == 0 || p->target.value == (double)APC_MODE_OOS
               ? change_fail(why, APC_EPERM, "mode",
                             "%s is out of service: no controller would act. Nothing was written",
                             p->to->name)
               : 0;
}

int promotion_put(struct promotion *p, struct apc_store *store, const char *author, const char *note,
                  const char *reason, struct apc_event *event, struct change_fault *why)
{
    const struct loops_controller *was = promotion_acting(p);
    *event = (struct apc_event){.time = apc_clock_utc(NULL), .severity = APC_EVENT_INFO, .kind = "operator"};
    snprintf(event->source, sizeof event->source, "%s", author);
    snprintf(event->text, sizeof event->text, "promoted: %.40s -> %.40s%s%s%s",
             was ? was->name : "the file's", p->to->name, note, reason && reason[0] ? ": " : "",
             reason ? reason : "");
    int rc = change_in_past(store, why);
    if (rc < 0)
        return rc;
    rc = apc_store_author(store, author);
    p->choice.author = rc > 0 ? (uint32_t)rc : 0;
    p->choice.value = p->to->number;
    p->choice.time = event->time;
    p->choice.status = APC_GOOD;
    rc = rc < 0 ? rc : apc_store_put(store, &p->choice, 1);
    if (rc == APC_ECONFLICT)
        return change_fail(why, rc, "stale",
                           "another user has promoted a controller just now. Nothing was written");
    if (rc == APC_ECONN || rc == APC_ETIMEDOUT)
        return change_fail(why, rc, "unknown",
                           "the store did not answer, so whether it was written is not known: %s",
                           apc_store_error(store));
    return rc < 0 ? change_fail(why, rc, "store", "%s", apc_store_error(store)) : 0;
}

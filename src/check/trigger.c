/* SPDX-License-Identifier: BSD-3-Clause */
/* What happens in a run once a condition is true: that is looked at, and done, at the ticks of the plant. */
#include "check_internal.h"

#include "base/parts.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#define NEVER INT64_MAX
#define LAST  (INT64_MAX / 4) /* of a disturbance, which the plant adds to a time: behind all others */

/* The experiment with faults of this run alone, since they begin when it says so. */
int triggers_make(struct run_triggers *t, const struct scenario *of, struct simulation *s)
{
    struct experiment *e = &t->e;
    const size_t n_actuators = of->e.actuator ? of->e.dim.nu : 0;
    size_t n_faults = 0, n_actuator_faults = 0;
    *t = (struct run_triggers){.of = of, .s = s, .e = of->e, .first = -1};
    const struct apc_disturbance *timed = e->plant.disturbance;
    const size_t n_timed = e->plant.n_disturbances;
    for (size_t i = 0; i < of->n_triggers; i++)
        e->plant.n_disturbances += of->trigger[i].what == TRIGGER_DISTURBANCE;
    for (size_t i = 0; i < e->dim.ny; i++)
        n_faults += e->sensor[i].n_faults;
    for (size_t i = 0; i < n_actuators; i++)
        n_actuator_faults += e->actuator[i].n_faults;
    const struct apc_part parts[] = {
        APC_PART(t->met, of->n_triggers),
        APC_PART(t->done, of->n_triggers),
        APC_PART(e->plant.disturbance, e->plant.n_disturbances),
        APC_PART_COPY(e->sensor, e->dim.ny, of->e.sensor),
        APC_PART_COPY(e->plant.fault, e->plant.n_faults, of->e.plant.fault),
        APC_PART_COPY(e->actuator, n_actuators, of->e.actuator),
        APC_PART_COPY(e->faults, n_faults, of->e.faults),
        APC_PART_COPY(e->actuator_faults, n_actuator_faults, of->e.actuator_faults)};
    t->memory = apc_parts_allocate(parts, sizeof parts / sizeof *parts);
    if (!t->memory)
        return APC_ENOMEM;
    if (n_timed > 0)
        memcpy(e->plant.disturbance, timed, n_timed * sizeof *timed);
    for (size_t i = n_timed; i < e->plant.n_disturbances; i++)
        e->plant.disturbance[i].at = LAST;
    for (size_t i = 0, n = 0; i < e->dim.ny; n += e->sensor[i++].n_faults)
        e->sensor[i].fault = e->faults + n;
    for (size_t i = 0, n = 0; i < n_actuators; n += e->actuator[i++].n_faults)
        e->actuator[i].fault = e->actuator_faults + n;
    if (n_actuators == 0) /* of no elements: it would be taken for one of each output */
        e->actuator = NULL;
    for (size_t i = 0; i < of->n_triggers; i++) {
        const struct scenario_trigger *trigger = &of->trigger[i];
        t->met[i] = t->done[i] = NEVER;
        if (trigger->what == TRIGGER_SENSOR)
            e->faults[trigger->fault].at = NEVER;
        else if (trigger->what == TRIGGER_ACTUATOR)
            e->actuator_faults[trigger->fault].at = NEVER;
        else if (trigger->what == TRIGGER_PLANT)
            e->plant.fault[trigger->fault].at = NEVER;
    }
    return 0;
}

/* What a source is at @p t. */
static struct check_point point_now(const struct run_triggers *t, const struct check_source *of, apc_ns now)
{
    const struct trajectory *c = &t->s->trajectory;
    const struct curve *curve = of->table == APC_SENSOR ? c->output : c->input;
    struct apc_sample row = {.table = of->table, .id = of->id};
    if (of->plant) {
        curve += of->id - 1;
        return curve->n > 0 ? (struct check_point){.value = curve->at[curve->n - 1].value, .known = true}
                            : (struct check_point){.known = false};
    }
    if (apc_store_read(t->s->store, &row, 1) < 0 || (row.seq == 0 && of->table != APC_ALARM))
        return (struct check_point){.known = false};
    struct check_point point = check_point_of(of, &row);
    if (row.seq == 0)
        point.value = APC_ALARM_NORMAL;
    if (of->horizon > 0 && now - point.t >= of->horizon)
        point.known = false;
    return point;
}

/* In a place of those that wait, which are all alike; behind what comes before. */
static void disturb_now(struct run_triggers *t, const struct apc_disturbance *disturbance, apc_ns at)
{
    struct apc_disturbance *first = t->e.plant.disturbance, *d = first + t->e.plant.n_disturbances - 1;
    for (; d > first && d[-1].at > at; d--)
        *d = d[-1];
    *d = *disturbance;
    d->at = at;
}

static void happen_now(struct run_triggers *t, const struct scenario_trigger *trigger, apc_ns now)
{
    if (trigger->what == TRIGGER_ACTION)
        simulation_do(t->s, &trigger->action, "operator");
    else if (trigger->what == TRIGGER_DISTURBANCE)
        disturb_now(t, &trigger->disturbance, now - t->first);
    else if (trigger->what == TRIGGER_SENSOR)
        t->e.faults[trigger->fault].at = now - t->first;
    else if (trigger->what == TRIGGER_PLANT)
        t->e.plant.fault[trigger->fault].at = now - t->first;
    else
        t->e.actuator_faults[trigger->fault].at = now - t->first;
}

void triggers_look(void *ctx, apc_ns now)
{
    struct run_triggers *t = ctx;
    if (t->first < 0)
        t->first = now;
    for (size_t i = 0; i < t->of->n_triggers; i++) {
        const struct scenario_trigger *trigger = &t->of->trigger[i];
        const struct expectation *x = &t->of->expect[trigger->expectation];
        if (t->met[i] == NEVER) {
            const struct check_point point = point_now(t, &t->of->sources.at[x->trajectory], now);
            if (point.known && check_is_true(x, &point))
                t->met[i] = now;
        }
        if (t->done[i] == NEVER && t->met[i] != NEVER && now - t->met[i] >= trigger->after) {
            t->done[i] = now;
            happen_now(t, trigger, now);
        }
    }
}

/* ---- What became of it ---------------------------------------------------------------------- */

/* What is done with a text, and its setting at @path: experiment_change() and its like. */
typedef int change_fn(const char *text, const char *path, const char *value, char **changed,
                      struct apc_error *why);

static int change_triggered(struct run_triggers *t, change_fn *change, const char *path, const char *value,
                            struct apc_error *why)
{
    char *changed = NULL;
    const int rc = change(t->e.text, path, value, &changed, why);
    if (rc < 0)
        return rc;
    free(t->text);
    t->e.text = t->text = changed;
    return 0;
}

static int write_fault(struct run_triggers *t, size_t i, struct apc_error *why)
{
    char path[sizeof t->of->trigger->path + 4], at[40];
    const struct scenario_trigger *trigger = &t->of->trigger[i];
    if (t->done[i] == NEVER)
        return change_triggered(t, experiment_remove, trigger->path, NULL, why);
    snprintf(path, sizeof path, "%s.at", trigger->path);
    snprintf(at, sizeof at, "%.9f", apc_ns_to_s(t->done[i] - t->first));
    return change_triggered(t, experiment_change, path, at, why);
}

/* An action has its time since t = 0, a disturbance since the plant's first tick. */
static int write_group(struct run_triggers *t, size_t i, struct apc_error *why)
{
    const struct scenario_trigger *trigger = &t->of->trigger[i];
    const apc_ns zero = trigger->what == TRIGGER_ACTION ? 0 : t->first;
    char *group;
    if (asprintf(&group, "{ at = %.9f; %s", apc_ns_to_s(t->done[i] - zero), trigger->text) < 0)
        return apc_fail(why, APC_ENOMEM, "out of memory");
    const int rc = change_triggered(t, experiment_append, trigger->path, group, why);
    free(group);
    return rc;
}

int triggers_write(struct run_triggers *t, struct apc_error *why)
{
    int rc = 0;
    for (size_t i = t->of->n_triggers; i > 0 && rc == 0;
         i--) /* what is taken away stands behind what is left */
        if (!t->of->trigger[i - 1].text)
            rc = write_fault(t, i - 1, why);
    for (size_t i = 0; i < t->of->n_triggers && rc == 0; i++)
        if (t->of->trigger[i].text && t->done[i] != NEVER)
            rc = write_group(t, i, why);
    return rc;
}

/* It is known when it was seen to be true; between two looks is not seen. */
void triggers_judge(const struct run_triggers *t, struct check_verdict *verdict)
{
    for (size_t i = 0; i < t->of->n_triggers; i++) {
        struct check_verdict *v = &verdict[t->of->trigger[i].expectation];
        if (t->done[i] != NEVER) {
            v->is = CHECK_HELD;
            v->at = t->done[i];
        } else if (t->met[i] != NEVER) {
            check_say_unknown(v, "the run ends before its time is over");
        } else if (v->is == CHECK_HELD) {
            check_say_unknown(v, "it was true only between two ticks of the plant");
        }
    }
}

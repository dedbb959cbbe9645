/* SPDX-License-Identifier: BSD-3-Clause */
/* Which output answers for what failed, and the move of it that is to be explained. */
#include "check_internal.h"

#include <stdio.h>

#define TICKS 10 /* that a move is over */

/* What an alarm is about in its place. */
static struct check_source judged_source(const struct scenario *of, const struct expectation *x)
{
    struct check_source source = of->sources.at[x->trajectory];
    if (source.table != APC_ALARM)
        return source;
    const struct apc_alarm *alarm = &of->e.alarm[source.id - 1].is;
    source.table = alarm->table == APC_OPMODE ? APC_ACTUAL : alarm->table;
    source.id = alarm->table == APC_OPMODE ? apc_variable_number(APC_OPMODE, alarm->id) : alarm->id;
    return source;
}

static bool answers_for(const struct loops_loop *loop, const struct check_source *source)
{
    switch (source->table) {
    case APC_SENSOR:
        return loop->measurement == source->id;
    case APC_ACTUAL:
        return apc_variable_number(APC_OPMODE, loop->id) == source->id;
    default:
        return loop->table == source->table && loop->output == source->id;
    }
}

/* Of several the one that moves the plant: why that moved is followed upwards. NULL: none. */
static const struct loops_loop *answering_loop(const struct loops *loops, const struct check_source *source)
{
    const struct loops_loop *found = NULL;
    for (size_t i = 0; i < loops->n; i++)
        if (loops->controller[loops->at[i].controller].acts && answers_for(&loops->at[i], source) &&
            (!found || (found->table != APC_ACTUATOR && loops->at[i].table == APC_ACTUATOR)))
            found = &loops->at[i];
    return found;
}

int check_find_move(struct check_move *move, const struct scenario *scenario, size_t i,
                    const struct check_verdict *v)
{
    const struct expectation *x = &scenario->expect[i];
    const struct check_source source = judged_source(scenario, x);
    struct loops loops;
    *move = (struct check_move){.at = v->at};
    if (v->is != CHECK_FAILED || x->form == CHECK_ACKNOWLEDGES || scenario->e.models.n_clock > 0)
        return 0;
    if (x->form == CHECK_SETTLES && x->from + x->time < v->at) /* when it was to be there */
        move->at = x->from + x->time;
    for (size_t k = 0; x->kind == CHECK_MODE && k < v->n_near && v->near[k].t <= v->at; k++)
        move->at = v->near[k].t; /* when it changed to what it is */
    const int rc = controllers_describe(&scenario->e, &loops);
    const struct loops_loop *loop = rc == 0 ? answering_loop(&loops, &source) : NULL;
    if (loop) {
        snprintf(move->loop, sizeof move->loop, "%s", loop->name);
        move->over = TICKS * loops.controller[loop->controller].period;
        move->over = move->over < move->at && x->kind != CHECK_MODE ? move->over : 0;
    }
    loops_free(&loops);
    return rc < 0 ? rc : loop != NULL;
}

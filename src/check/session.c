/* SPDX-License-Identifier: BSD-3-Clause */
/* The figures of a session, of which the same are made of other runs of its experiment. */
#include "check_internal.h"

#include <math.h>
#include <stdio.h>

#include "figures/figures.h"

size_t session_run_size(const struct scenario *of)
{
    const size_t n = controllers_loops(&of->e) + of->e.n_alarms * SESSION_ALARM;
    return sizeof(struct session_run) + n * sizeof(double);
}

double *session_alarm(struct session_run *run, const struct scenario *of, size_t i)
{
    return run->of + controllers_loops(&of->e) + i * SESSION_ALARM;
}

static double since_start(apc_ns utc)
{
    return apc_ns_to_s(utc - SIMULATION_BEGIN);
}

/* From when it was raised until somebody acknowledged it. */
static double time_to_acknowledge(const struct alarm_journal *journal, size_t raised)
{
    const struct alarm_transition *at = &journal->at[raised];
    for (size_t k = raised + 1; k < journal->n; k++)
        if (journal->at[k].alarm == at->alarm && !apc_alarm_is_unacked(journal->at[k].state))
            return apc_ns_to_s(journal->at[k].time - at->time);
    return HUGE_VAL;
}

static void take_session_alarm(const struct alarm_journal *journal, const struct alarm_figure *of, int alarm,
                               double *figure)
{
    figure[SESSION_RAISED] = (double)of->raised;
    figure[SESSION_ACTIVE] = apc_ns_to_s(of->active);
    figure[SESSION_FIRST] = figure[SESSION_SLOWEST] = (double)NAN;
    if (of->raised > 0)
        figure[SESSION_FIRST] = since_start(of->first);
    for (size_t i = 0; i < journal->n; i++)
        if (journal->at[i].alarm == alarm && alarm_is_raised(&journal->at[i]))
            figure[SESSION_SLOWEST] = fmax(figure[SESSION_SLOWEST], time_to_acknowledge(journal, i));
}

struct session_look {
    struct session_run *run;
    const struct scenario *of;
};

static int take_session_alarms(const struct session_look *look, const struct simulation *s)
{
    struct alarm_journal journal;
    struct alarm_figures figures = {.n = 0};
    apc_ns ended = 0;
    (void)apc_ns_from_s(s->ended, &ended);
    int rc = alarm_journal_load(&journal, s->store, s->e->n_alarms, NULL);
    if (rc == 0)
        rc = alarm_figures_make(&figures, &journal, s->e, SIMULATION_BEGIN, SIMULATION_BEGIN + ended);
    for (size_t i = 0; i < figures.n && rc == 0; i++)
        take_session_alarm(&journal, &figures.alarm[i], (int)i + 1, session_alarm(look->run, look->of, i));
    alarm_figures_free(&figures);
    alarm_journal_free(&journal);
    return rc;
}

static int take_session_run(void *ctx, const struct simulation *s)
{
    const struct session_look *look = ctx;
    struct figures figures;
    look->run->ended = s->ended;
    look->run->beyond = s->ended * figures_beyond(s->e, &s->trajectory);
    int rc = figures_make(&figures, &s->trajectory, s->e);
    for (size_t i = 0; i < figures.n_loops && rc == 0; i++)
        look->run->of[i] = figures.of[i].figure[METRIC_IAE];
    figures_free(&figures);
    return rc == 0 ? take_session_alarms(look, s) : rc;
}

void session_run_make(struct session_run *run, const struct scenario *of)
{
    struct apc_error why = {""};
    run->rc = scenario_rerun(of, of->seed, take_session_run, &(struct session_look){run, of}, &why);
    snprintf(run->why, sizeof run->why, "%.199s", why.text);
    run->made = true;
}

/* ---- What was to be done ------------------------------------------------------------------------- */

const struct action *session_next_action(const struct scenario *reference, size_t *i)
{
    const size_t n = reference->e.n_actions;
    while (*i < n + reference->n_triggers) {
        const size_t k = (*i)++;
        const struct action *action = k < n ? &reference->e.action[k] : &reference->trigger[k - n].action;
        if (action->kind == ACTION_WRITE && !action->alarm)
            return action;
    }
    return NULL;
}

double session_done(const struct scenario *session, const struct action *action, double from)
{
    for (size_t i = 0; i < session->written.n; i++) {
        const struct apc_sample *row = &session->written.at[i];
        if (row->table == action->to.table && row->id >= action->to.id &&
            row->id < action->to.id + (int)action->n && since_start(row->time) >= from)
            return since_start(row->time);
    }
    return (double)NAN;
}

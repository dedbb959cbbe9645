/* SPDX-License-Identifier: BSD-3-Clause */
/* What an instructor breaks, as rows of a simulated plant's store say: each begins and ends at a tick of the plant. */
#include "simulation_internal.h"

#include <apcalarm.h>

#include <math.h>
#include <stdlib.h>
#include <string.h>

/* Since the plant's first tick. */
static apc_ns fault_time(const struct simulation *s, apc_ns mono)
{
    const apc_ns t = mono - s->zero - s->e->plant.rhythm.phase;
    return t > 0 ? t : 0;
}

static bool read_fault_numbers(struct simulation *s, const struct experiment_fault *fault,
                               double number[FAULT_NUMBERS])
{
    struct apc_sample row[FAULT_NUMBERS];
    for (int k = 0; k < FAULT_NUMBERS; k++)
        row[k] = (struct apc_sample){.table = APC_TUNING, .id = fault->numbers + k};
    simulation_stop_at_store(s, apc_store_read(s->store, row, FAULT_NUMBERS));
    for (int k = 0; k < FAULT_NUMBERS; k++)
        number[k] = row[k].seq > 0 ? row[k].value : 0;
    return s->rc == 0;
}

/* ---- Of what experiment ---------------------------------------------------------------------- */

/* Another one may have others of that row, which have not begun. */
static void keep_fault(const struct simulation *s, const struct experiment *was,
                       const struct experiment_fault *is, struct simulated_fault *fault)
{
    size_t k = 0;
    while (k < s->n_faults && s->fault_row[k].id != is->row)
        k++;
    if (k == s->n_faults || s->fault[k].seen == 0)
        return;
    const struct experiment_fault before = experiment_fault(was, k);
    fault->seen = s->fault[k].seen;
    if (strcmp(before.signal, is->signal) != 0 || strcmp(before.kind, is->kind) != 0)
        return;
    fault->waits = s->fault[k].waits;
    *is->at = *before.at;
    if (is->numbers)
        *is->duration = *before.duration;
    for (int i = 0; i <= FAULT_HIGH && is->numbers; i++)
        if (is->number[i])
            *is->number[i] = *before.number[i];
}

int simulation_take_faults(struct simulation *s, const struct experiment *was)
{
    size_t n = 0;
    while (experiment_fault(s->e, n).kind)
        n++;
    struct simulated_fault *fault = calloc(n + 1, sizeof *fault);
    struct apc_sample *row = calloc(n + 1, sizeof *row);
    const bool room = fault && row;
    for (size_t i = 0; i < n && room; i++) {
        const struct experiment_fault is = experiment_fault(s->e, i);
        fault[i].at = *is.at;
        row[i] = (struct apc_sample){.table = APC_OPMODE, .id = is.row};
        keep_fault(s, was, &is, &fault[i]);
    }
    simulation_drop_faults(s, was);
    s->fault = fault;
    s->fault_row = row;
    s->n_faults = room ? n : 0;
    return room ? 0 : APC_ENOMEM;
}

void simulation_drop_faults(struct simulation *s, const struct experiment *e)
{
    for (size_t i = 0; i < s->n_faults; i++)
        if (s->fault[i].seen > 0)
            *experiment_fault(e, i).at = s->fault[i].at;
    free(s->fault);
    free(s->fault_row);
    s->n_faults = 0;
}

/* ---- Later, or once something is true -------------------------------------------------------- */

static bool is_met(struct simulation *s, const double number[FAULT_NUMBERS])
{
    struct apc_sample row = {.table = (enum apc_table)number[FAULT_IF_TABLE], .id = (int)number[FAULT_IF_ID]};
    const double limit = number[FAULT_IF_LIMIT];
    if (number[FAULT_IF] <= FAULT_IF_NONE)
        return true;
    simulation_stop_at_store(s, apc_store_read(s->store, &row, 1));
    if (s->rc < 0 || row.seq == 0 || apc_status_severity(row.status) == APC_SEVERITY_BAD)
        return false;
    switch ((enum fault_if)number[FAULT_IF]) {
    case FAULT_IF_BELOW:
        return row.value < limit;
    case FAULT_IF_NOT_ABOVE:
        return row.value <= limit;
    case FAULT_IF_ABOVE:
        return row.value > limit;
    case FAULT_IF_NOT_BELOW:
        return row.value >= limit;
    case FAULT_IF_ALARM: {
        const enum apc_alarm_state state = (enum apc_alarm_state)row.value;
        return apc_alarm_is_active(state) && !apc_alarm_is_masked(state);
    }
    case FAULT_IF_NONE:
        break;
    }
    return false;
}

/* What has become of it is told to the instructor, and is nothing that people wrote. */
static void tell_instructor(struct simulation *s, const struct experiment_fault *fault,
                            enum fault_became became)
{
    struct apc_sample row = {.table = APC_TUNING,
                             .id = fault->numbers + FAULT_BECAME,
                             .value = became,
                             .seq = APC_SEQ_ANY,
                             .time = apc_clock_utc(s->clock)};
    simulation_stop_at_store(s, apc_store_put(s->store, &row, 1));
}

static void begin_fault(struct simulation *s, size_t i, const struct experiment_fault *fault)
{
    s->fault[i].waits = false;
    *fault->at = fault_time(s, apc_clock_mono(s->clock));
    tell_instructor(s, fault, FAULT_BEGAN);
}

static void on_faults_wait(void *ctx);

static void await_faults(struct simulation *s, apc_ns at)
{
    if (apc_virtual_at(s->executive, at, RANK_INSTRUCTOR, on_faults_wait, s) < 0)
        simulation_stop(s, APC_ENOMEM, "out of memory");
}

static void on_faults_wait(void *ctx)
{
    struct simulation *s = ctx;
    const apc_ns now = apc_clock_mono(s->clock);
    double number[FAULT_NUMBERS];
    s->faults_wait = false;
    for (size_t i = 0; i < s->n_faults && s->rc == 0; i++) {
        if (!s->fault[i].waits)
            continue;
        const struct experiment_fault fault = experiment_fault(s->e, i);
        if (read_fault_numbers(s, &fault, number) && apc_ns_to_s(now - s->zero) >= number[FAULT_AT] &&
            is_met(s, number))
            begin_fault(s, i, &fault);
        s->faults_wait |= s->fault[i].waits;
    }
    if (s->faults_wait)
        await_faults(s, s->zero + simulation_next_tick(s, now - s->zero));
}

/* ---- Started and stopped -------------------------------------------------------------------- */

static void take_numbers(struct simulation *s, size_t i, const struct experiment_fault *fault)
{
    double number[FAULT_NUMBERS];
    if (!read_fault_numbers(s, fault, number))
        return;
    for (int k = FAULT_SIZE; k <= FAULT_HIGH; k++)
        if (fault->takes & 1U << k)
            *fault->number[k] = number[k];
    (void)apc_ns_from_s(number[FAULT_DURATION], fault->duration);
    if (number[FAULT_DURATION] > 0 && *fault->duration == 0) /* which is for ever */
        *fault->duration = 1;
    if (number[FAULT_AT] > 0 || number[FAULT_IF] > 0) {
        *fault->at = FAULT_NEVER;
        s->fault[i].waits = true;
    }
}

/* Begin and end are those of the plant's tick that is now. What was seen before is passed over. */
static void see_fault(struct simulation *s, size_t i, const struct apc_sample *row)
{
    const struct experiment_fault fault = experiment_fault(s->e, i);
    s->fault[i].seen = row->seq;
    s->fault[i].waits = false;
    *fault.at = row->value == 0 ? FAULT_NEVER : fault_time(s, apc_clock_mono(s->clock));
    if (row->value != 0 && fault.numbers)
        take_numbers(s, i, &fault);
}

void simulation_see_faults(struct simulation *s)
{
    struct apc_sample *row = s->fault_row;
    const bool awaited = s->faults_wait; /* at this tick, as at each */
    simulation_stop_at_store(s, apc_store_read(s->store, row, s->n_faults));
    for (size_t i = 0; i < s->n_faults && s->rc == 0; i++) {
        if (row[i].seq != s->fault[i].seen)
            see_fault(s, i, &row[i]);
        s->faults_wait |= s->fault[i].waits;
    }
    if (s->faults_wait && !awaited)
        await_faults(s, apc_clock_mono(s->clock));
}

/* ---- Of the plant itself -------------------------------------------------------------------- */

/* What the experiment has a disturbance at, @t since the plant's first tick. */
static double disturbance_at(const struct experiment *e, size_t k, apc_ns t)
{
    double value = e->plant.model->disturbance[k].initial;
    for (size_t i = 0; i < e->plant.n_disturbances && e->plant.disturbance[i].at <= t; i++)
        if (e->plant.disturbance[i].k == k)
            value = e->plant.disturbance[i].value;
    return value;
}

/* A parameter goes no farther than the model takes it: the instructor is told where it stays. */
static void hold_drift(struct simulation *s, size_t i)
{
    const struct experiment_fault fault = experiment_fault(s->e, s->n_faults - s->e->plant.n_faults + i);
    if (!s->plant_fault[i].held)
        tell_instructor(s, &fault, FAULT_HELD);
    s->plant_fault[i].held = true;
}

/* Returns whether it is to be, or was, off. */
static bool drift_parameter(struct simulation *s, size_t i, bool acts, apc_ns since, double *p)
{
    const struct apc_param *limits = &s->e->plant.model->param[s->e->plant.fault[i].k];
    const bool acted = s->plant_fault[i].acts;
    const double to = *p + s->e->plant.fault[i].size * apc_ns_to_s(since);
    if (acts)
        *p = fmin(fmax(to, limits->low), limits->high);
    if (acts && *p != to)
        hold_drift(s, i);
    return acts || acted;
}

static void break_controller(struct simulated *c, enum fault_of how, bool acts, bool acted)
{
    struct apc_error why;
    if (how == FAULT_HANGS)
        c->hangs = acts;
    else if (acts && !acted)
        simulation_kill(c);
    else if (acted && !acts && simulation_start(c, &why) < 0)
        simulation_stop(c->s, APC_ESTATE, "at t = %g s: %s", simulation_time(c->s), why.text);
}

static bool is_over(const struct plant_fault *fault, apc_ns t)
{
    return t < fault->at || (fault->duration > 0 && t - fault->at >= fault->duration);
}

static bool breaks_plant(const struct simulation *s, apc_ns t)
{
    for (size_t i = 0; i < s->e->plant.n_faults; i++)
        if (s->plant_fault[i].acts || !is_over(&s->e->plant.fault[i], t))
            return true;
    return false;
}

/* From this tick on. */
void simulation_break_plant(struct simulation *s)
{
    const struct experiment *e = s->e;
    const apc_ns t = fault_time(s, s->plant_now.mono);
    bool drifts = false;
    if (s->playback || !breaks_plant(s, t))
        return;
    double *p = calloc(e->plant.model->np + 1, sizeof *p);
    struct experiment seeded = *e;
    seeded.seed = s->seed;
    if (!p || experiment_draw(&seeded, s->seed, p, &s->why) < 0) {
        simulation_stop(s, APC_ENOMEM, "out of memory");
        free(p);
        return;
    }
    for (size_t i = 0; i < e->plant.n_faults; i++) {
        const struct plant_fault *fault = &e->plant.fault[i];
        const bool acts = !is_over(fault, t), acted = s->plant_fault[i].acts;
        s->plant_fault[i].held &= acts && t > fault->at;
        if (fault->of == FAULT_OF_LINK)
            s->link_lost = acts;
        else if (fault->of == FAULT_HANGS || fault->of == FAULT_KILLS)
            break_controller(&s->controller[fault->k], fault->of, acts, acted);
        else if (fault->of == FAULT_OF_PARAMETER)
            drifts |= drift_parameter(s, i, acts, t - fault->at, &p[fault->k]);
        else if (acts || acted)
            (void)apc_plant_disturb(s->plant, fault->k, acts ? fault->size : disturbance_at(e, fault->k, t));
        s->plant_fault[i].acts = acts;
    }
    if (drifts && apc_plant_change(s->plant, p, NULL) < 0)
        for (size_t i = 0; i < e->plant.n_faults; i++)
            if (s->plant_fault[i].acts && e->plant.fault[i].of == FAULT_OF_PARAMETER)
                hold_drift(s, i);
    free(p);
}

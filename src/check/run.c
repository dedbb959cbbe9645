/* SPDX-License-Identifier: BSD-3-Clause */
/* One run of a scenario: what its expectations are about is kept, and they are judged. */
#include "check_internal.h"

#include <stdio.h>
#include <stdlib.h>

struct run_trajectories {
    const struct check_sources *sources;
    struct check_trajectory *trajectory; /* [n] */
    bool failed;                         /* out of memory */
};

struct check_point check_point_of(const struct check_source *of, const struct apc_sample *row)
{
    const enum apc_severity severity = apc_status_severity(row->status);
    const bool state = of->table == APC_ALARM || of->table == APC_ACTUAL;
    return (struct check_point){.t = row->time - SIMULATION_BEGIN,
                                .value = row->value,
                                .known = state || severity != APC_SEVERITY_BAD,
                                .others = severity != APC_SEVERITY_GOOD};
}

static void take_check_row(struct run_trajectories *c, const struct apc_sample *row)
{
    for (size_t i = 0; i < c->sources->n; i++) {
        const struct check_source *of = &c->sources->at[i];
        if (of->plant || of->table != row->table || of->id != row->id)
            continue;
        c->failed = c->failed || check_add(&c->trajectory[i], check_point_of(of, row)) < 0;
    }
}

static int take_check_rows(void *ctx, const struct samples *rows)
{
    struct run_trajectories *c = ctx;
    for (size_t i = 0; i < rows->n; i++)
        take_check_row(c, &rows->at[i]);
    return c->failed ? APC_ENOMEM : 0;
}

/* What the store keeps to the end: what became of modes and alarms. */
static int take_check_kept(struct run_trajectories *c, struct apc_store *store)
{
    int rc = 0;
    for (size_t i = 0; i < c->sources->n && rc == 0; i++) {
        const struct check_source *of = &c->sources->at[i];
        struct samples rows = {0};
        if (of->table != APC_ALARM && of->table != APC_ACTUAL)
            continue;
        if (of->table == APC_ALARM)
            rc = check_add(&c->trajectory[i], (struct check_point){.value = APC_ALARM_NORMAL, .known = true});
        if (rc == 0)
            rc = samples_collect_one(&rows, store, of->table, of->id, NULL);
        for (size_t k = 0; k < rows.n; k++)
            take_check_row(c, &rows.at[k]);
        samples_free(&rows);
    }
    return rc < 0 ? rc : c->failed ? APC_ENOMEM : 0;
}

static int take_check_plant(struct run_trajectories *c, const struct trajectory *of)
{
    for (size_t i = 0; i < c->sources->n; i++) {
        const struct check_source *source = &c->sources->at[i];
        const struct curve *curve = source->table == APC_SENSOR ? of->output : of->input;
        if (!source->plant)
            continue;
        curve += source->id - 1;
        for (size_t k = 0; k < curve->n; k++) {
            struct check_point point = {.value = curve->at[k].value, .known = true};
            (void)apc_ns_from_s(curve->at[k].t, &point.t);
            if (check_add(&c->trajectory[i], point) < 0)
                return APC_ENOMEM;
        }
    }
    return 0;
}

/* Is something of the record wanted, that goes while the run goes on? */
static bool wants_rows(const struct check_sources *sources)
{
    for (size_t i = 0; i < sources->n; i++) {
        const struct check_source *of = &sources->at[i];
        if (!of->plant && of->table != APC_ALARM && of->table != APC_ACTUAL)
            return true;
    }
    return false;
}

static int judge_scenario(const struct scenario *of, struct simulation *s, struct run_trajectories *c,
                          struct check_verdict *verdict, struct check_end *end)
{
    apc_ns ended = INT64_MAX;
    end->rc = simulation_stream(s, of->e.duration, wants_rows(&of->sources) ? take_check_rows : NULL, c);
    end->ended = s->ended;
    snprintf(end->why, sizeof end->why, "%.199s", s->why.text);
    if (end->rc < 0)
        (void)apc_ns_from_s(s->ended, &ended);
    int rc = take_check_kept(c, s->store);
    if (rc == 0)
        rc = take_check_plant(c, &s->trajectory);
    for (size_t i = 0; i < of->n_expect && rc == 0; i++)
        verdict[i] = check_judge(&of->expect[i], &of->sources, c->trajectory, ended);
    return rc;
}

/* Not begun yet; of both the memory is the caller's to free, also after an error. */
static int begin_scenario(const struct scenario *of, uint64_t seed, struct run_triggers *t,
                          struct simulation *s, struct apc_error *why)
{
    *s = (struct simulation){.rc = 0};
    int rc = triggers_make(t, of, s);
    t->e.seed = seed;
    rc = rc < 0 ? apc_fail(why, rc, "out of memory") : simulation_create(s, &t->e, seed, why);
    if (rc == 0 && (rc = simulation_repeat_writes(s, &of->written)) < 0)
        apc_fail(why, rc, "out of memory");
    if (rc == 0 && of->n_triggers > 0 && (rc = simulation_watch(s, triggers_look, t)) < 0)
        apc_fail(why, rc, "out of memory");
    return rc;
}

int scenario_run(const struct scenario *scenario, uint64_t seed, struct check_verdict *verdict,
                 struct check_end *end)
{
    struct simulation s;
    struct run_triggers t;
    struct apc_error why = {""};
    const size_t n = scenario->sources.n;
    struct run_trajectories c = {.sources = &scenario->sources,
                                 .trajectory = calloc(n + 1, sizeof *c.trajectory)};
    *end = (struct check_end){.rc = 0};
    int rc = begin_scenario(scenario, seed, &t, &s, &why);
    snprintf(end->why, sizeof end->why, "%.199s", why.text);
    if (rc == 0)
        rc = c.trajectory ? judge_scenario(scenario, &s, &c, verdict, end) : APC_ENOMEM;
    if (rc == 0)
        triggers_judge(&t, verdict);
    simulation_destroy(&s);
    free(t.memory);
    for (size_t i = 0; c.trajectory && i < n; i++)
        free(c.trajectory[i].at);
    free(c.trajectory);
    return rc;
}

int scenario_rerun(const struct scenario *scenario, uint64_t seed,
                   int (*look)(void *ctx, const struct simulation *s), void *ctx, struct apc_error *why)
{
    struct simulation s;
    struct run_triggers t;
    int rc = begin_scenario(scenario, seed, &t, &s, why);
    if (rc == 0) {
        (void)simulation_run(&s, scenario->e.duration); /* one that ended early is looked at as well */
        rc = triggers_write(&t, why);
    }
    if (rc == 0)
        rc = look(ctx, &s);
    simulation_destroy(&s);
    free(t.text);
    free(t.memory);
    return rc;
}

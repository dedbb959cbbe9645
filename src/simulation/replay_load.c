/* SPDX-License-Identifier: BSD-3-Clause */
/* The record that a replay is of: of a run folder all of it, of a store the part that a move needs. */
#include "replay_internal.h"

#include <errno.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

int replay_load_samples(struct replay *r, struct apc_store *store, const struct apc_range *range)
{
    const struct apc_range before = {.until = range->since, .last = 1};
    int n = apc_store_variables(store, NULL, 0);
    struct apc_sample *variable = n < 0 ? NULL : calloc((size_t)n + 1, sizeof *variable);
    if (!variable)
        return n < 0 ? n : APC_ENOMEM;
    int rc = apc_store_variables(store, variable, (size_t)n);
    n = rc < n ? rc : n;
    for (int i = 0; i < n && rc >= 0; i++)
        if (ticks_name(variable[i].table)) {
            if (range->since > 0)
                rc = samples_collect_one(&r->samples, store, variable[i].table, variable[i].id, &before);
            if (rc >= 0)
                rc = samples_collect_one(&r->samples, store, variable[i].table, variable[i].id, range);
        }
    free(variable);
    if (r->samples.n > 0)
        qsort(r->samples.at, r->samples.n, sizeof *r->samples.at, replay_order_samples);
    return rc < 0 ? rc : 0;
}

int replay_open_ticks(struct apc_store **ticks, const char *dir, struct apc_error *why)
{
    char path[600];
    snprintf(path, sizeof path, "%.580s/" TICKS_FILE, dir);
    if (access(dir, F_OK) < 0)
        return apc_fail(why, APC_ENOTFOUND, "%s: there is no such file or folder: expected a run folder",
                        dir);
    if (access(path, R_OK) < 0)
        return apc_fail(why, errno == ENOENT ? APC_ENOTFOUND : APC_ESYS, "%s: %s%s", path, strerror(errno),
                        errno == ENOENT
                            ? ": a run that goes on has none yet: `apc why OUTPUT --store RUN` asks its "
                              "store; a run of a former version is replayed by that version"
                            : "");
    return ticks_open(ticks, path, why);
}

static void note_ends(struct replay_controller *rc)
{
    const struct ticks *ticks = &rc->ticks;
    rc->first = ticks->n > 0 ? ticks->at[0].time : INT64_MAX;
    rc->last = ticks->n > 0 ? ticks->at[ticks->n - 1].time : INT64_MIN;
}

static int load_replay_record(struct replay *r, const char *dir, struct apc_error *why)
{
    struct apc_store *store;
    int rc = replay_open_ticks(&store, dir, why);
    if (rc < 0)
        return rc;
    rc = replay_load_samples(r, store, &(struct apc_range){0});
    for (size_t i = 0; i < r->e.n_controllers && rc == 0; i++) {
        rc = ticks_load(&r->controller[i].ticks, store, APC_TICK, r->e.controllers[i].number, 0);
        note_ends(&r->controller[i]);
    }
    for (size_t k = 0; k < r->e.dim.nz && rc == 0; k++)
        rc = ticks_load(&r->plan[k], store, APC_PLAN, (int)k + 1, 0);
    if (rc < 0)
        apc_fail(why, rc, "%.580s/" TICKS_FILE ": %s", dir,
                 rc == APC_ENOMEM ? "out of memory" : apc_store_error(store));
    apc_store_close(store);
    return rc;
}

static void add_difference(struct replay *r, const char *what, const char *was, const char *here)
{
    const size_t n = strlen(r->other_build);
    if (was[0] && strcmp(was, here) != 0)
        snprintf(r->other_build + n, sizeof r->other_build - n, "%sanother %s (%s, here %s)",
                 n ? ", " : "the run was made by ", what, was, here);
}

/* What made the record, where it says so. */
static void compare_builds(struct replay *r, const char *dir)
{
    struct record_build was, here;
    struct apc_error none;
    if (record_build(&was, dir, &none) < 0)
        return;
    record_build_here(&here);
    add_difference(r, "CVODE", was.cvode, here.cvode);
    add_difference(r, "libapc", was.libapc, here.libapc);
    add_difference(r, "processor", was.machine, here.machine);
}

int replay_load_folder(struct replay *r, const char *dir, const struct experiment_overrides *overrides,
                       struct apc_error *why)
{
    const int rc = experiment_load(&r->e, dir, EXPERIMENT_LAW, overrides, why);
    if (rc < 0)
        return rc;
    compare_builds(r, dir);
    r->start = r->e.start ? r->e.start : SIMULATION_BEGIN;
    return 0;
}

int replay_make(struct replay *r, struct apc_error *why)
{
    r->controller = calloc(r->e.n_controllers, sizeof *r->controller);
    r->difference = calloc(controllers_loops(&r->e), sizeof *r->difference);
    r->plan = calloc(r->e.dim.nz + 1, sizeof *r->plan);
    r->tags = provision_tags(&r->e, &r->n_tags);
    if (!r->controller || !r->difference || !r->plan || !r->tags ||
        controllers_describe(&r->e, &r->loops) < 0)
        return apc_fail(why, APC_ENOMEM, "out of memory");
    for (size_t i = 0; i < r->e.n_controllers; i++)
        r->controller[i].of = &r->e.controllers[i];
    return 0;
}

int replay_load(struct replay *r, const char *dir, const struct experiment_overrides *overrides,
                struct apc_error *why)
{
    *r = (struct replay){.other_law = overrides && (overrides->law || overrides->n_set > 0)};
    int rc = replay_load_folder(r, dir, overrides, why);
    if (rc == 0)
        rc = replay_make(r, why);
    return rc < 0 ? rc : load_replay_record(r, dir, why);
}

/* ---- A part of a store's record --------------------------------------------------------------- */

int replay_catalogue(struct apc_store *store, apc_ns then, char **text, struct apc_error *why)
{
    struct apc_store *past = NULL;
    int64_t revision = 0;
    int rc = 0;
    *text = NULL;
    if (then < INT64_MAX) {
        rc = apc_store_past(&past, store, then, why);
        rc = rc < 0 ? rc : experiment_text(past, text, &revision, why);
        apc_store_close(past);
    }
    if (rc >= 0 && revision == 0) {
        free(*text);
        rc = experiment_text(store, text, &revision, why);
    }
    return rc < 0 ? rc
           : revision == 0
               ? apc_fail(why, APC_ENOTFOUND, "the store does not say which experiment it is: apc init FILE")
               : 0;
}

static int load_catalogue(struct replay *r, const struct replay_part *part, struct apc_error *why)
{
    const struct experiment *e = part->simulated;
    char *text = NULL;
    if (part->dir)
        return replay_load_folder(r, part->dir, NULL, why);
    if (e)
        return experiment_parse(&r->e, &(struct experiment_source){.file = e->file, .text = e->text},
                                EXPERIMENT_LAW, NULL, why);
    int rc = replay_catalogue(part->store, part->until, &text, why);
    const struct experiment_source from = {.file = "the store's experiment", .text = text};
    if (rc == 0 && part->built_in)
        rc = experiment_refuse_own(&from, "it is explained on the command line only: apc why", why);
    if (rc == 0)
        rc = experiment_parse(&r->e, &from, EXPERIMENT_LAW, NULL, why);
    free(text);
    return rc;
}

struct tick_times {
    apc_ns first, last;
    bool one; /* is enough */
};

static int take_tick_time(void *ctx, const struct apc_vector *tick)
{
    struct tick_times *of = ctx;
    of->first = tick->time < of->first ? tick->time : of->first;
    of->last = tick->time > of->last ? tick->time : of->last;
    return of->one;
}

/* Where the clock was set back, ticks are older than the first by seq, or younger than the last. */
int replay_look_at_ticks(struct apc_store *store, int number, apc_ns *first, apc_ns *last)
{
    struct tick_times of = {INT64_MAX, INT64_MIN, true};
    struct apc_range range = {0};
    int rc = apc_store_vectors(store, APC_TICK, number, &range, take_tick_time, &of);
    range.last = 1;
    if (rc > 0)
        rc = apc_store_vectors(store, APC_TICK, number, &range, take_tick_time, &of);
    of.one = false;
    range = (struct apc_range){.until = of.first};
    if (rc > 0)
        rc = apc_store_vectors(store, APC_TICK, number, &range, take_tick_time, &of);
    range = (struct apc_range){.since = of.last + 1};
    if (rc >= 0 && of.first <= of.last)
        rc = apc_store_vectors(store, APC_TICK, number, &range, take_tick_time, &of);
    *first = of.first < *first ? of.first : *first;
    *last = of.last > *last ? of.last : *last;
    return rc < 0 ? rc : 0;
}

/* The newest ticks of the controller until then. A tick is no sooner than a period after another. */
static int load_moved_ticks(struct replay *r, const struct replay_part *part, struct replay_controller *moved)
{
    const struct apc_range range = {.until = part->until < INT64_MAX ? part->until + 1 : 0,
                                    .last = (size_t)(part->over / moved->of->rhythm.period) + 2 + part->lead};
    struct ticks *ticks = &moved->ticks;
    int rc = ticks_add(ticks, part->store, APC_TICK, moved->of->number, &range);
    if (rc == 0)
        rc = ticks_fill(ticks, part->store, APC_TICK, moved->of->number, range.last, ticks->n < range.last);
    r->more = ticks->n >= range.last;
    return rc;
}

int replay_load_vectors(struct ticks *to, struct apc_store *store, enum apc_table table, int id,
                        const struct apc_range *range)
{
    const struct apc_range before = {.until = range->since, .last = 1};
    const int rc = ticks_add(to, store, table, id, &before);
    return rc < 0 ? rc : ticks_add(to, store, table, id, range);
}

/* What these ticks name. A row may bear a time that is off a little: another machine's. */
static int load_named(struct replay *r, struct apc_store *store, const struct replay_controller *moved)
{
    const struct ticks *ticks = &moved->ticks;
    const apc_ns off = APC_NS_PER_S;
    const struct apc_range range = {.since = ticks->at[0].time - off,
                                    .until = ticks->at[ticks->n - 1].time + off};
    int rc = replay_load_samples(r, store, &range);
    for (size_t i = 0; i < r->e.n_controllers && rc == 0; i++)
        if (&r->controller[i] != moved)
            rc = replay_load_vectors(&r->controller[i].ticks, store, APC_TICK, r->controller[i].of->number,
                                     &range);
    for (size_t k = 0; k < r->e.dim.nz && rc == 0; k++)
        rc = replay_load_vectors(&r->plan[k], store, APC_PLAN, (int)k + 1, &range);
    return rc;
}

apc_ns replay_part_start(const struct controller *of, const struct ticks *ticks)
{
    apc_ns start = INT64_MAX;
    for (size_t k = 0; k < ticks->n; k++) {
        const double *row = ticks->value + ticks->at[k].first;
        const double index = ticks->at[k].n > APC_TICK_INDEX_AT ? row[APC_TICK_INDEX_AT] : 0;
        const apc_ns zero = ticks->at[k].time - of->rhythm.phase - (apc_ns)index * of->rhythm.period;
        start = zero < start ? zero : start;
    }
    return start;
}

int replay_load_part(struct replay *r, const struct replay_part *part, struct apc_error *why)
{
    *r = (struct replay){.store = part->store, .of_store = !part->simulated && !part->dir};
    int rc = load_catalogue(r, part, why);
    if (rc == 0)
        rc = replay_make(r, why);
    if (rc < 0)
        return rc;
    struct replay_controller *moved = NULL;
    for (size_t i = 0; i < r->loops.n; i++)
        if (!strcmp(r->loops.at[i].name, part->loop))
            moved = &r->controller[r->loops.at[i].controller];
    if (moved) {
        note_ends(moved);
        rc = replay_look_at_ticks(part->store, moved->of->number, &moved->first, &moved->last);
        rc = rc < 0 ? rc : load_moved_ticks(r, part, moved);
    }
    if (moved && moved->ticks.n > 0 && rc == 0) {
        if (!part->dir)
            r->start = part->simulated ? SIMULATION_BEGIN : replay_part_start(moved->of, &moved->ticks);
        rc = load_named(r, part->store, moved);
    }
    return rc < 0 ? apc_fail(why, rc, "%s", rc == APC_ENOMEM ? "out of memory" : apc_store_error(part->store))
                  : 0;
}

apc_ns replay_time_between(const struct replay_controller *rc, size_t k)
{
    const struct tick_row *at = &rc->ticks.at[k];
    const double *value = rc->ticks.value;
    const apc_ns wall = at->time - at[-1].time, period = rc->of->rhythm.period;
    if (at->n <= APC_TICK_INDEX_AT || at[-1].n <= APC_TICK_INDEX_AT)
        return wall;
    const apc_ns grid =
        (apc_ns)((value[at->first + APC_TICK_INDEX_AT] - value[at[-1].first + APC_TICK_INDEX_AT]) *
                 (double)period);
    return grid <= 0 || llabs(wall - grid) < period ? wall : grid;
}

void replay_free(struct replay *r)
{
    for (size_t i = 0; r->controller && i < r->e.n_controllers; i++) {
        apc_controller_destroy(r->controller[i].core);
        ticks_free(&r->controller[i].ticks);
    }
    for (size_t k = 0; r->plan && k < r->e.dim.nz; k++)
        ticks_free(&r->plan[k]);
    free(r->tags);
    free(r->plan);
    free(r->controller);
    free(r->difference);
    loops_free(&r->loops);
    samples_free(&r->samples);
    for (struct replay_stray *next; r->stray; r->stray = next) {
        next = r->stray->next;
        free(r->stray);
    }
    experiment_free(&r->e);
}

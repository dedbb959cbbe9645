/* SPDX-License-Identifier: BSD-3-Clause */
/*
 * The record that is closed: of a run folder, or of a store. A part of a store has a t = 0 of its own, where all tasks
 * begin a period together, as long before the part as that lasts: by then the model is where its plant was.
 */
#include "closed_internal.h"

#include <math.h>
#include <stdarg.h>
#include <stdlib.h>
#include <string.h>

#include "files/files.h"
#include "replay_internal.h"

#define INDEX 2             /* of a tick row, behind its mark: number of the tick on its controller's grid */
#define GRAIN APC_NS_PER_MS /* t = 0 of a run is whole */

/* ---- What is said --------------------------------------------------------------------------- */

static void note_closed(struct closed *c, const char *fmt, ...) APC_PRINTF(2, 3);

static void note_closed(struct closed *c, const char *fmt, ...)
{
    va_list args;
    if (c->n_notes == CLOSED_NOTES)
        return;
    va_start(args, fmt);
    vsnprintf(c->note[c->n_notes++], REPLAY_TEXT, fmt, args);
    va_end(args);
}

/* ---- Its ticks ------------------------------------------------------------------------------ */

struct beat {
    apc_ns time;
    double index;
};

struct beats {
    struct beat *at;
    size_t n;
};

static int take_beat(void *ctx, const struct apc_vector *tick)
{
    struct beats *b = ctx;
    if (tick->n <= INDEX)
        return 0;
    if (!apc_grow(&b->at, b->n + 1, sizeof *b->at))
        return APC_ENOMEM;
    b->at[b->n++] = (struct beat){tick->time, tick->value[INDEX]};
    return 0;
}

/* The tick before @p since, and all until then. */
static int load_beats(struct beats *b, const struct closed *c, int number, apc_ns since)
{
    const struct apc_range before = {.until = since, .last = 1},
                           range = {.since = since, .until = c->of.until};
    struct apc_store *store = c->of.store;
    int rc = since > 0 ? apc_store_vectors(store, APC_TICK, number, &before, take_beat, b) : 0;
    const size_t n = b->n;
    if (rc >= 0 && (rc = apc_store_vectors(store, APC_TICK, number, &range, take_beat, b)) >= 0)
        rc = (size_t)rc > b->n - n ? APC_ENOMEM : 0;
    return rc;
}

static apc_ns zero_of_beat(const struct controller *of, const struct beat *b)
{
    return b->time - of->rhythm.phase - (apc_ns)b->index * of->rhythm.period;
}

static bool is_on_grid(const struct controller *of, const struct beat *b, apc_ns zero)
{
    const apc_ns late = zero_of_beat(of, b) - zero;
    return late > -GRAIN && late < of->rhythm.period;
}

/* ---- When a part begins --------------------------------------------------------------------- */

static apc_ns common_period(apc_ns a, apc_ns b)
{
    apc_ns x = a, y = b;
    if (a == 0 || b == 0)
        return a > b ? a : b;
    while (y != 0) {
        const apc_ns rest = x % y;
        x = y;
        y = rest;
    }
    return a / x > INT64_MAX / b ? a : a / x * b;
}

/* After which all tasks are again as at t = 0. */
static apc_ns round_of(const struct experiment *e)
{
    apc_ns round = common_period(e->plant.rhythm.period, e->client.rhythm.period);
    for (size_t i = 0; i < e->n_controllers; i++)
        round = common_period(round, e->controllers[i].rhythm.period);
    return e->n_alarms > 0 ? common_period(round, e->alarms.rhythm.period) : round;
}

/* t = 0 of those in the part, as near as the least late of them says. */
static int find_zero(const struct closed *c, const struct beats *beats, apc_ns *zero, struct apc_error *why)
{
    *zero = INT64_MAX;
    for (size_t i = 0; i < c->was.n_controllers; i++)
        for (size_t k = 0; k < beats[i].n; k++)
            if (beats[i].at[k].time >= c->of.since) {
                const apc_ns one = zero_of_beat(&c->was.controllers[i], &beats[i].at[k]);
                *zero = one < *zero ? one : *zero;
            }
    if (*zero == INT64_MAX)
        return apc_fail(why, APC_ENOTFOUND, "no ticks are on record in that time");
    *zero -= (*zero % GRAIN + GRAIN) % GRAIN;
    return 0;
}

/* One alone is late: the next one is in time again. */
static bool is_of_other_start(const struct controller *of, const struct beats *b, size_t k, apc_ns zero)
{
    return k + 1 < b->n && !is_on_grid(of, &b->at[k], zero) && !is_on_grid(of, &b->at[k + 1], zero);
}

/* The last tick before the part that is of an earlier start; one in the part is refused. */
static int find_other_start(const struct closed *c, const struct beats *beats, apc_ns zero, apc_ns *last,
                            struct apc_error *why)
{
    char text[APC_TIME_LEN];
    for (size_t i = 0; i < c->was.n_controllers; i++) {
        const struct controller *of = &c->was.controllers[i];
        const struct beats *b = &beats[i];
        for (size_t k = 0; k < b->n; k++) {
            const apc_ns time = b->at[k].time;
            const bool begins = k > 0 && b->at[k - 1].time >= c->of.since;
            if (time < c->of.since && !is_on_grid(of, &b->at[k], zero))
                *last = time > *last ? time : *last;
            else if (begins && is_of_other_start(of, b, k, zero) != is_of_other_start(of, b, k - 1, zero))
                return apc_fail(why, APC_ESTATE,
                                "at %s %s was started anew with all else, or the clock was set: replay what "
                                "is before and what is after it, --until and --since",
                                apc_time_format(time, text), of->name);
        }
    }
    return 0;
}

/* Are its first ticks those of a start, after which no more than two of them were missed? */
static bool has_start(const struct closed *c, const struct beats *beats)
{
    for (size_t i = 0; i < c->was.n_controllers; i++)
        if (beats[i].n == 0 || beats[i].at[0].index > 2)
            return false;
    return true;
}

/* And are they in it? */
static bool is_whole_run(const struct closed *c, const struct beats *beats)
{
    for (size_t i = 0; i < c->was.n_controllers; i++)
        if (beats[i].n > 0 && beats[i].at[0].time < c->of.since)
            return false;
    return has_start(c, beats);
}

/* Each controller goes on from a tick of its own. */
static void begin_behind_ticks(struct closed *c, const struct beats *beats)
{
    for (size_t i = 0; i < c->was.n_controllers; i++)
        if (beats[i].n > 0 && beats[i].at[0].time >= c->start + c->since)
            c->since = beats[i].at[0].time + 1 - c->start;
}

static int place_part(struct closed *c, const struct beats *beats, struct apc_error *why)
{
    const apc_ns round = round_of(&c->was), since = c->of.since;
    apc_ns zero, begin = since - (c->of.until - since), other = INT64_MIN;
    int rc = find_zero(c, beats, &zero, why);
    if (rc == 0)
        rc = find_other_start(c, beats, zero, &other, why);
    if (rc < 0)
        return rc;
    c->start = c->zero = zero;
    if (is_whole_run(c, beats))
        return 0;
    for (size_t i = 0; i < c->was.n_controllers; i++)
        if (beats[i].n > 0 && beats[i].at[0].time > begin)
            begin = beats[i].at[0].time;
    begin = begin > other ? begin : other + 1;
    if (begin > zero && !has_start(c, beats))
        c->start = zero + (begin - zero + round - 1) / round * round;
    c->since = since > c->start ? since - c->start : 1;
    begin_behind_ticks(c, beats);
    return 0;
}

/* ---- Gaps ----------------------------------------------------------------------------------- */

static int add_gap(struct closed *c, size_t controller, enum action_kind kind, double index)
{
    const struct rhythm *r = &c->was.controllers[controller].rhythm;
    apc_ns at = r->phase + (apc_ns)((index + (kind == ACTION_KILL ? 0.5 : -0.5)) * (double)r->period);
    if (!apc_grow(&c->gap, c->n_gaps + 1, sizeof *c->gap))
        return APC_ENOMEM;
    at = at > c->since ? at : c->since;
    c->gap[c->n_gaps++] = (struct action){.at = at, .kind = kind, .controller = controller};
    return 0;
}

static int find_gaps_of(struct closed *c, size_t i, const struct beats *beats)
{
    const struct controller *of = &c->was.controllers[i];
    const apc_ns numbered = (c->start - c->zero) / of->rhythm.period;
    const double before = (double)numbered; /* the first number from `start` on */
    const apc_ns end = c->end - of->rhythm.phase;
    unsigned long long lacking = 0;
    apc_ns first = 0;
    double last = -1;
    int rc = 0;
    for (size_t k = 0; k <= beats->n && rc == 0; k++) {
        const bool behind = k == beats->n;
        const double now =
            behind ? floor((double)end / (double)of->rhythm.period) + 1 : beats->at[k].index - before;
        if (now < 0 || (!behind && beats->at[k].time < c->start))
            continue;
        if (now - last > 2 && (apc_ns)(now * (double)of->rhythm.period) + of->rhythm.phase > c->since) {
            rc = add_gap(c, i, ACTION_KILL, last);
            rc = rc < 0 || behind ? rc : add_gap(c, i, ACTION_START, now);
            if (lacking == 0)
                first = c->start + of->rhythm.phase + (apc_ns)((last + 1) * (double)of->rhythm.period);
            lacking += (unsigned long long)(now - last - 1);
        }
        last = now;
    }
    char time[APC_TIME_LEN];
    if (lacking > 0)
        note_closed(c,
                    "%s: %llu ticks are not on record, the first of them at %s: it makes none in closed loop "
                    "either, and goes on from its last one",
                    of->name, lacking, apc_time_format(first, time));
    return rc;
}

static int by_time_of_action(const void *left, const void *right)
{
    const struct action *a = left, *b = right;
    return a->at < b->at ? -1 : a->at > b->at;
}

static int find_gaps(struct closed *c, const struct beats *beats)
{
    int rc = 0;
    for (size_t i = 0; i < c->was.n_controllers && rc == 0; i++)
        rc = find_gaps_of(c, i, &beats[i]);
    if (c->n_gaps > 0)
        qsort(c->gap, c->n_gaps, sizeof *c->gap, by_time_of_action);
    c->gaps_known = true;
    return rc;
}

/* ---- Samples -------------------------------------------------------------------------------- */

static void note_samples(struct closed *c)
{
    const struct samples *s = &c->recorded;
    unsigned long long rows = 0, bad = 0, gaps = 0;
    apc_ns longest = 0;
    for (size_t i = 0; i < s->n; i++) {
        const bool follows = i > 0 && s->at[i - 1].id == s->at[i].id;
        const apc_ns after = follows ? s->at[i].time - s->at[i - 1].time : 0;
        if (s->at[i].time >= SIMULATION_BEGIN + c->since) {
            rows++;
            bad += apc_status_severity(s->at[i].status) == APC_SEVERITY_BAD;
            gaps += after > 3 * c->was.client.rhythm.period;
            longest = after > longest ? after : longest;
        }
        if (i + 1 < s->n && s->at[i + 1].id == s->at[i].id)
            continue;
        const char *name = c->was.y[s->at[i].id - 1].tag.name;
        if (bad > 0)
            note_closed(c, "%s: %llu of %llu measurements were Bad, and are so again", name, bad, rows);
        if (gaps > 0)
            note_closed(
                c,
                "%s: measurements lack in %llu places, in one for %.3g s: there what acted before and "
                "after is taken to have acted",
                name, gaps, apc_ns_to_s(longest));
        rows = bad = gaps = 0;
        longest = 0;
    }
}

static int sort_recorded(struct closed *c, struct apc_error *why)
{
    struct samples *s = &c->recorded;
    for (size_t i = 0; i < c->all.n; i++) {
        struct apc_sample row = c->all.at[i];
        row.time += SIMULATION_BEGIN;
        if (row.table == APC_SENSOR && (size_t)row.id <= c->was.dim.ny && samples_add(s, &row) < 0)
            return apc_fail(why, APC_ENOMEM, "out of memory");
    }
    if (s->n == 0)
        return apc_fail(why, APC_ENOTFOUND, "no measurements are on record");
    qsort(s->at, s->n, sizeof *s->at, closed_by_variable_and_time);
    return 0;
}

/* Of a store: by time since its start. */
static int collect_stored(struct closed *c)
{
    const struct apc_range range = {.since = c->start, .until = c->of.until},
                           before = {.until = c->start, .last = 1};
    int rc = 0;
    for (size_t k = 0; k < c->was.dim.nz && rc == 0; k++)
        rc = samples_collect_one(&c->all, c->of.store, APC_SETPOINT, (int)k + 1, &before);
    for (size_t i = 0; i < c->all.n; i++)
        c->all.at[i].time = c->start;
    if (rc == 0)
        rc = samples_collect(&c->all, c->of.store, &c->was, &range);
    for (size_t i = 0; i < c->all.n; i++)
        c->all.at[i].time -= c->start;
    return rc;
}

static bool is_for_people(enum apc_table table)
{
    return table == APC_SETPOINT || table == APC_OPMODE || table == APC_MANUAL || table == APC_TUNING;
}

static int collect_written(struct closed *c)
{
    const struct apc_range before = {.until = c->start, .last = 1},
                           range = {.since = c->start, .until = c->of.until};
    int n = apc_store_variables(c->of.store, NULL, 0);
    struct apc_sample *variable = n < 0 ? NULL : calloc((size_t)n + 1, sizeof *variable);
    if (!variable)
        return n < 0 ? n : APC_ENOMEM;
    int rc = apc_store_variables(c->of.store, variable, (size_t)n);
    n = rc < n ? rc : n;
    for (int i = 0; i < n && rc >= 0; i++)
        if (is_for_people(variable[i].table)) {
            rc = samples_collect_one(&c->written, c->of.store, variable[i].table, variable[i].id, &before);
            if (rc >= 0)
                rc = samples_collect_one(&c->written, c->of.store, variable[i].table, variable[i].id, &range);
        }
    unsigned long long tunings = 0;
    for (size_t i = 0; i < c->written.n; i++) {
        struct apc_sample *row = &c->written.at[i];
        row->time += SIMULATION_BEGIN - c->start;
        tunings += row->table == APC_TUNING && row->author > 0 && row->time >= SIMULATION_BEGIN + c->since;
    }
    if (tunings > 0)
        note_closed(c,
                    "people wrote %llu tuning values meanwhile: with another tuning none of them is written",
                    tunings);
    samples_sort(&c->written);
    free(variable);
    return rc < 0 ? rc : 0;
}

/* ---- All of it ------------------------------------------------------------------------------ */

int closed_experiment(const struct closed *c, struct experiment *e,
                      const struct experiment_overrides *overrides, struct apc_error *why)
{
    const struct experiment_source from = {.file = "the store's experiment", .text = c->text};
    const unsigned parts = EXPERIMENT_MODEL | EXPERIMENT_LAW;
    return c->of.dir                           ? experiment_load(e, c->of.dir, parts, overrides, why)
           : overrides && overrides->n_set > 0 ? experiment_parse_changed(e, &from, parts, overrides, why)
                                               : experiment_parse(e, &from, parts, overrides, why);
}

int closed_shift_scheduler(const struct closed *c, struct experiment *e, struct apc_error *why)
{
    struct rhythm *r = &e->scheduler.rhythm;
    const size_t n = e->scheduler.n, steps = e->scheduler.steps;
    const apc_ns by = c->start - c->zero;
    if (steps == 0 || by <= 0)
        return 0;
    const apc_ns done = by > r->phase ? (by - r->phase + r->period - 1) / r->period : 0; /* by then */
    double *next = calloc(steps * n + 1, sizeof *next);
    if (!next)
        return apc_fail(why, APC_ENOMEM, "out of memory");
    for (size_t k = 0; k < steps; k++) {
        const size_t at = (size_t)done + k, of = e->scheduler.repeat ? at % steps
                                                 : at < steps        ? at
                                                                     : steps - 1;
        memcpy(next + k * n, e->scheduler.sequence + of * n, n * sizeof *next);
    }
    memcpy(e->scheduler.sequence, next, steps * n * sizeof *next);
    free(next);
    r->phase += done * r->period - by;
    return 0;
}

/* What the store says of these ticks: of one description, by whose law they were made. */
static int look_at_season(struct closed *c, struct apc_error *why)
{
    struct season s;
    const struct replay_range of = {
        .store = c->of.store, .since = c->of.since, .until = c->of.until, .window = APC_NS_PER_S};
    char time[APC_TIME_LEN];
    int rc = season_open(&s, &of, &(struct replay_watch){.output = NULL}, why);
    if (rc == 0 && s.of.since >= s.of.until)
        rc = apc_fail(why, APC_ENOTFOUND, "no ticks are on record in that time");
    if (rc == 0 && s.n > 1)
        rc = apc_fail(why, APC_ESTATE,
                      "at %s the experiment was described anew: replay what is before and what is after it, "
                      "--until and --since",
                      apc_time_format(s.revision[1].since, time));
    c->of.since = s.of.since;
    c->of.until = s.of.until;
    if (rc == 0)
        rc = replay_catalogue(c->of.store, c->of.until, &c->text, why);
    season_close(&s);
    return rc;
}

static int load_of_folder(struct closed *c, struct apc_error *why)
{
    c->start = c->zero = c->was.start ? c->was.start : SIMULATION_BEGIN;
    c->since = c->of.since > c->start ? c->of.since - c->start : 0;
    const int rc = samples_read(&c->all, c->of.dir, "samples.csv", why);
    for (size_t i = 0; i < c->all.n; i++)
        c->end = c->all.at[i].time > c->end ? c->all.at[i].time : c->end;
    if (rc < 0)
        return rc;
    if (c->of.until < c->start + c->end)
        c->end = c->of.until > c->start ? c->of.until - c->start : 0;
    c->of.until = c->start + c->end + 1;
    return c->since < c->end ? 0 : apc_fail(why, APC_ENOTFOUND, "no measurements are on record in that time");
}

static int load_of_store(struct closed *c, const struct beats *beats, struct apc_error *why)
{
    int rc = place_part(c, beats, why);
    if (rc == 0)
        rc = closed_shift_scheduler(c, &c->was, why);
    if (rc < 0)
        return rc;
    c->end = c->of.until - c->start;
    rc = collect_stored(c);
    if (rc < 0)
        return apc_fail(why, rc, "%s", rc == APC_ENOMEM ? apc_err_text(rc) : apc_store_error(c->of.store));
    return c->since < c->end ? 0 : apc_fail(why, APC_ENOTFOUND, "no two ticks are on record in that time");
}

static int load_closed_record(struct closed *c, struct beats *beats, struct apc_error *why)
{
    const apc_ns lead = c->of.dir ? INT64_MAX : c->of.until - c->of.since,
                 since = c->of.since > lead ? c->of.since - lead : 0;
    int rc = 0;
    for (size_t i = 0; i < c->was.n_controllers && rc >= 0; i++)
        rc = load_beats(&beats[i], c, c->was.controllers[i].number, since);
    if (rc < 0)
        return apc_fail(why, rc, "%s", rc == APC_ENOMEM ? apc_err_text(rc) : apc_store_error(c->of.store));
    rc = c->of.dir ? load_of_folder(c, why) : load_of_store(c, beats, why);
    if (rc == 0 && c->of.dir && !is_whole_run(c, beats)) /* its store had no room for the ticks before */
        begin_behind_ticks(c, beats);
    if (rc == 0)
        rc = sort_recorded(c, why);
    if (rc < 0)
        return rc;
    c->played = (struct playback){
        .ticks = c->of.store, .start = c->start, .end = c->start + c->end + 1, .before = c->start - c->zero};
    rc = playback_take(&c->played, &c->all, &c->was);
    if (rc == 0)
        rc = collect_written(c);
    if (rc == 0 && (!c->of.dir || c->was.start || c->since > 0))
        rc = find_gaps(c, beats);
    if (rc == 0)
        note_samples(c);
    return rc < 0
               ? apc_fail(why, rc, "%s", rc == APC_ENOMEM ? apc_err_text(rc) : apc_store_error(c->of.store))
               : 0;
}

int closed_load(struct closed *c, const struct replay_range *of, struct apc_error *why)
{
    *c = (struct closed){.of = *of};
    int rc = c->of.dir ? 0 : look_at_season(c, why);
    if (rc == 0)
        rc = closed_experiment(c, &c->was, NULL, why);
    if (rc == 0 && !c->was.plant.model)
        rc = apc_fail(why, APC_EINVAL, "%s names no model of its plant: there is nothing to simulate",
                      c->of.dir ? c->of.dir : "the experiment");
    c->model = rc == 0 ? calloc(c->was.dim.ny + 1, sizeof *c->model) : NULL;
    struct beats *beats = rc == 0 ? calloc(c->was.n_controllers + 1, sizeof *beats) : NULL;
    if (rc == 0 && (!c->model || !beats))
        rc = apc_fail(why, APC_ENOMEM, "out of memory");
    if (rc == 0)
        rc = load_closed_record(c, beats, why);
    for (size_t i = 0; beats && i < c->was.n_controllers; i++)
        free(beats[i].at);
    free(beats);
    return rc < 0 ? rc : closed_estimate(c, why);
}

void closed_free(struct closed *c)
{
    samples_free(&c->all);
    samples_free(&c->recorded);
    samples_free(&c->modelled);
    samples_free(&c->written);
    samples_free(&c->played.rows);
    free(c->text);
    free(c->gap);
    free(c->model);
    experiment_free(&c->was);
}

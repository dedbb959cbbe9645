/* SPDX-License-Identifier: BSD-3-Clause */
#include "apcmath.h"
#include "record.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#define ENOUGH 0.9 /* of what the largest value would spare */

/* ---- Settings ----------------------------------------------------------------------------- */

const char *alarm_setting_name(enum alarm_setting setting)
{
    static const char *const name[ALARM_SETTINGS] = {"as-is", "on-delay", "off-delay", "deadband"};
    return setting < ALARM_SETTINGS ? name[setting] : NULL;
}

static void add_try(struct alarm_trial *t, enum alarm_setting setting, double value)
{
    t->at[t->n++] = (struct alarm_try){.setting = setting, .value = value, .state = APC_ALARM_NORMAL};
}

static void add_delays(struct alarm_trial *t, enum alarm_setting setting, apc_ns is)
{
    static const double delays[] = {2, 5, 10, 15, 30, 60};
    for (size_t i = 0; i < sizeof delays / sizeof *delays; i++)
        if (delays[i] > apc_ns_to_s(is))
            add_try(t, setting, delays[i]);
}

/* 1, 2, 5, 10 ... of half a percent to five percent of the scale, above what there is. */
static void add_deadbands(struct alarm_trial *t, double scale, double is)
{
    static const double steps[] = {1, 2, 5};
    const double least = 0.005 * scale, most = 0.05 * scale;
    for (int decade = (int)floor(apc_log10(least)), i = 0; i < 6 && t->n < ALARM_TRIES; i++) {
        const int exponent = decade + i / 3;
        const double value = steps[i % 3] * apc_pow(10, exponent);
        if (value >= least * (1 - 1e-9) && value <= most * (1 + 1e-9) && value > is)
            add_try(t, ALARM_DEADBAND, value);
    }
}

static struct apc_alarm with_setting(const struct apc_alarm *alarm, int number, const struct alarm_try *try)
{
    struct apc_alarm a = *alarm;
    a.suppression = (struct apc_alarm_suppression){
        .table = APC_ALARM, .id = number, .below = -HUGE_VAL, .above = APC_ALARM_SHELVED - 0.5};
    if (try->setting == ALARM_ON_DELAY)
        (void)apc_ns_from_s(try->value, &a.on_delay);
    if (try->setting == ALARM_OFF_DELAY)
        (void)apc_ns_from_s(try->value, &a.off_delay);
    if (try->setting == ALARM_DEADBAND)
        a.deadband = try->value;
    return a;
}

/* ---- Core --------------------------------------------------------------------------------- */

static bool has_deadband(enum apc_alarm_kind kind)
{
    return kind <= APC_ALARM_RATE || kind == APC_ALARM_AT_LIMIT;
}

static bool is_announced(enum apc_alarm_state state)
{
    return apc_alarm_is_active(state) && !apc_alarm_is_masked(state);
}

/* As it stood at the beginning, all of them do. */
static void resume_tries(struct alarm_trial *t, const struct apc_sample *stood)
{
    const struct apc_rows *former = apc_alarms_former(t->core);
    for (size_t i = 0; stood && stood->seq > 0 && i < former->n_samples; i++) {
        struct apc_sample *s = &former->sample[i];
        if (s->table != APC_ALARM)
            continue;
        s->seq = 1;
        s->value = stood->value;
        t->at[s->id - 1].state = (enum apc_alarm_state)(int)stood->value;
        t->at[s->id - 1].told = true;
    }
    apc_alarms_resume(t->core);
    t->began = is_announced(t->at[0].state) ? t->since : 0;
    if (stood)
        alarm_trial_row(t, stood);
}

int alarm_trial_begin(struct alarm_trial *t, const struct apc_alarm *alarm, double scale,
                      const struct apc_sample *stood, apc_ns tick, apc_ns period, struct apc_error *why)
{
    struct apc_alarm tried[ALARM_TRIES];
    memset(t, 0, sizeof *t);
    t->since = t->tick = tick;
    t->period = period;
    add_try(t, ALARM_AS_IS, 0);
    add_delays(t, ALARM_ON_DELAY, alarm->on_delay);
    add_delays(t, ALARM_OFF_DELAY, alarm->off_delay);
    if (has_deadband(alarm->kind) && scale > 0)
        add_deadbands(t, scale, alarm->deadband);
    for (size_t i = 0; i < t->n; i++) {
        tried[i] = with_setting(alarm, stood->id, &t->at[i]);
        const apc_ns on = tried[i].on_delay, off = tried[i].off_delay, most = on > off ? on : off;
        t->settle = most > t->settle ? most : t->settle;
    }
    t->settle += alarm->horizon + 2 * period;
    t->quiet = tick + t->settle;
    const struct apc_alarms_options options = {
        .size = sizeof options, .n = t->n, .alarm = tried, .number = 1};
    const int rc = apc_alarms_create(&t->core, &options, why);
    if (rc == 0)
        resume_tries(t, stood);
    return rc;
}

void alarm_trial_free(struct alarm_trial *t)
{
    apc_alarms_destroy(t->core);
    t->core = NULL;
}

/* What stands as it is: when another setting tells of it, or that it never does. */
static void compare_tries(struct alarm_trial *t, apc_ns now)
{
    const bool stands = is_announced(t->at[0].state);
    if (stands && t->began == 0) {
        t->began = now;
        for (size_t i = 0; i < t->n; i++)
            t->at[i].told = false;
    }
    if (t->began == 0)
        return;
    for (size_t i = 0; i < t->n; i++) {
        struct alarm_try *try = &t->at[i];
        const apc_ns after = now - t->began;
        if (!try->told && is_announced(try->state)) {
            try->told = true;
            try->later = after > try->later ? after : try->later;
        } else if (!try->told && !stands) {
            try->missed++;
            try->longest = after > try->longest ? after : try->longest;
        }
    }
    t->began = stands ? t->began : 0;
}

static void evaluate_tries(struct alarm_trial *t, apc_ns before)
{
    for (; t->tick < before; t->tick += t->period) {
        if (t->tick > t->quiet) /* all but the last one would find what the one before did */
            t->tick += (before - 1 - t->tick) / t->period * t->period;
        const struct apc_rows *out = apc_alarms_out(t->core);
        const int n = apc_alarms_compute(t->core, (struct apc_now){.mono = t->tick, .utc = t->tick}, NULL);
        for (int i = 0; i < n; i++) {
            struct alarm_try *try = &t->at[out->sample[i].id - 1];
            try->state = (enum apc_alarm_state)(int)out->sample[i].value;
            try->raised += try->state == APC_ALARM_UNACKED;
        }
        apc_alarms_stored(t->core);
        if (n > 0)
            compare_tries(t, t->tick);
    }
}

void alarm_trial_row(struct alarm_trial *t, const struct apc_sample *row)
{
    const struct apc_rows *in = apc_alarms_in(t->core);
    evaluate_tries(t, row->time);
    t->quiet = t->tick + t->settle;
    for (size_t i = 0; i < in->n_samples; i++)
        if (in->sample[i].table == row->table && in->sample[i].id == row->id)
            in->sample[i] = *row;
}

/* Of each setting the smallest value that spares nearly as many alarms as the largest one. */
void alarm_trial_end(struct alarm_trial *t, apc_ns until)
{
    evaluate_tries(t, until);
    t->until = until;
    for (enum alarm_setting of = ALARM_ON_DELAY; of < ALARM_SETTINGS; of++) {
        const size_t is = t->at[0].raised;
        size_t least = is;
        for (size_t i = 1; i < t->n; i++)
            if (t->at[i].setting == of && t->at[i].raised < least)
                least = t->at[i].raised;
        for (size_t i = 1; least < is && i < t->n; i++)
            if (t->at[i].setting == of && (double)(is - t->at[i].raised) >= ENOUGH * (double)(is - least)) {
                t->at[i].proposed = true;
                break;
            }
    }
}

/* ---- Of a store ---------------------------------------------------------------------------- */

#define BLOCK (600 * APC_NS_PER_S) /* rows of so long are in memory */
#define LISTS 3                    /* the signal, another one, what the alarm did */

struct trial_rows {
    struct apc_sample of[LISTS]; /* table and id; table 0: there is none */
    struct apc_sample *at;       /* [n] */
    size_t n, room;
    apc_ns half; /* of an evaluation's period */
    bool failed;
};

/* A row of table alarm is of the evaluation that wrote it, which came a little late. */
static int take_trial_row(void *ctx, const struct apc_sample *row)
{
    struct trial_rows *rows = ctx;
    if (rows->n == rows->room) {
        if (!apc_grow(&rows->at, 2 * rows->room + 1024, sizeof *rows->at)) {
            rows->failed = true;
            return 1;
        }
        rows->room = 2 * rows->room + 1024;
    }
    rows->at[rows->n] = *row;
    if (row->table == APC_ALARM)
        rows->at[rows->n].time -= rows->half;
    rows->n++;
    return 0;
}

static int by_row_time(const void *x, const void *y)
{
    const struct apc_sample *a = x, *b = y;
    if (a->time != b->time)
        return a->time < b->time ? -1 : 1;
    if (a->table != b->table)
        return a->table < b->table ? -1 : 1;
    return a->seq < b->seq ? -1 : a->seq > b->seq;
}

static int load_trial_rows(struct trial_rows *rows, struct apc_store *store, const struct apc_range *range)
{
    int rc = 0;
    rows->n = 0;
    for (size_t i = 0; i < LISTS && rc >= 0; i++)
        if (rows->of[i].table)
            rc = apc_store_history(store, rows->of[i].table, rows->of[i].id, range, take_trial_row, rows);
    if (rows->failed)
        return APC_ENOMEM;
    if (rows->n > 1)
        qsort(rows->at, rows->n, sizeof *rows->at, by_row_time);
    return rc < 0 ? rc : 0;
}

static int take_one_row(void *ctx, const struct apc_sample *row)
{
    *(struct apc_sample *)ctx = *row;
    return 1;
}

static int take_span(void *ctx, const struct apc_history_bin *bin)
{
    *(double *)ctx = bin->count > 0 ? bin->max - bin->min : 0;
    return 1;
}

/* What the deadband is a part of. */
static int scale_of_deadband(struct apc_store *store, const struct apc_alarm *alarm, apc_ns since,
                             apc_ns until, double *scale)
{
    *scale = 10 * fabs(alarm->limit);
    if (!has_deadband(alarm->kind) || alarm->kind == APC_ALARM_DEVIATION || alarm->kind == APC_ALARM_RATE)
        return 0;
    return apc_store_history_bins(store, alarm->table, alarm->id, since, until, 1, take_span, scale);
}

/* The newest row before the range, or the first one in it. */
static int row_beside(struct apc_store *store, const struct apc_sample *of, const struct apc_range *range,
                      struct apc_sample *row)
{
    row->seq = 0;
    return of->table ? apc_store_history(store, of->table, of->id, range, take_one_row, row) : 0;
}

/* From @since on, or from where the record of its signal begins; as it stood then. */
static int begin_trial(struct alarm_trial *t, struct apc_store *store, const struct apc_alarm *alarm,
                       struct trial_rows *rows, struct apc_range range, apc_ns ticked, struct apc_error *why)
{
    const apc_ns period = 2 * rows->half;
    struct apc_sample row[LISTS] = {{0}};
    double scale = 0;
    int rc = row_beside(store, &rows->of[0], &(struct apc_range){.until = range.since, .last = 1}, &row[0]);
    if (rc >= 0 && row[0].seq == 0) {
        rc = row_beside(store, &rows->of[0], &range, &row[0]);
        range.since = row[0].time;
    }
    if (rc >= 0 && row[0].seq == 0)
        return apc_fail(why, APC_ENOTFOUND, "%s: there is no record of its signal in that time", alarm->name);
    for (size_t i = 1; i < LISTS && rc >= 0; i++) {
        row[i] = rows->of[i];
        rc = row_beside(store, &rows->of[i], &(struct apc_range){.until = range.since, .last = 1}, &row[i]);
    }
    if (rc >= 0)
        rc = scale_of_deadband(store, alarm, range.since, range.until, &scale);
    if (rc < 0)
        return apc_fail(why, rc, "%s", apc_store_error(store));
    ticked =
        range.since + ((ticked - range.since) % period + period) % period; /* the first one from then on */
    row[2].time = INT64_MIN;
    rc = alarm_trial_begin(t, alarm, scale, &row[2], ticked, period, why);
    t->since = range.since;
    for (size_t i = 0; i < 2 && rc == 0; i++)
        if (row[i].seq > 0 && row[i].time < range.since)
            alarm_trial_row(t, &row[i]);
    return rc;
}

/* Where nothing is recorded for a while: on to the next row, or to the end. */
static int skip_gap(const struct trial_rows *rows, struct apc_store *store, apc_ns until, apc_ns *at)
{
    const struct apc_range gap = {.since = *at, .until = until};
    struct apc_sample row;
    int rc = 0;
    *at = until;
    for (size_t i = 0; i < LISTS && rc >= 0; i++) {
        rc = row_beside(store, &rows->of[i], &gap, &row);
        if (rc >= 0 && row.seq > 0 && row.time < *at)
            *at = row.time;
    }
    return rc < 0 ? rc : 0;
}

static int feed_trial(struct alarm_trial *t, struct apc_store *store, struct trial_rows *rows, apc_ns until,
                      apc_ns give_up, struct apc_error *why)
{
    for (apc_ns at = t->since, end; at < until; at = end) {
        end = until - at > BLOCK ? at + BLOCK : until;
        int rc = load_trial_rows(rows, store, &(struct apc_range){.since = at, .until = end});
        if (rc == 0 && rows->n == 0 && end < until)
            rc = skip_gap(rows, store, until, &end);
        if (rc < 0)
            return apc_fail(why, rc, "%s", rc == APC_ENOMEM ? apc_err_text(rc) : apc_store_error(store));
        if (give_up && apc_clock_mono(NULL) > give_up)
            return apc_fail(why, APC_ETIMEDOUT,
                            "there is too much on record to try it in time: ask for a shorter one");
        for (size_t i = 0; i < rows->n; i++) {
            t->recorded += rows->at[i].table == APC_ALARM && (int)rows->at[i].value == APC_ALARM_UNACKED;
            alarm_trial_row(t, &rows->at[i]);
        }
    }
    alarm_trial_end(t, until);
    return 0;
}

int alarm_trial_make(struct alarm_trial *t, struct apc_store *store, const struct experiment *e,
                     const struct alarm *alarm, apc_ns ticked, const struct apc_range *range, apc_ns give_up,
                     struct apc_error *why)
{
    const struct apc_alarm *is = &alarm->is;
    struct trial_rows rows = {.half = e->alarms.rhythm.period / 2};
    memset(t, 0, sizeof *t);
    if (apc_table_vectors(is->table))
        return apc_fail(why, APC_EINVAL,
                        "%s is judged by the ticks of a controller: settings are tried of alarms of signals",
                        is->name);
    rows.of[0] = (struct apc_sample){.table = is->table, .id = is->id};
    if (is->kind == APC_ALARM_DEVIATION)
        rows.of[1] = (struct apc_sample){.table = is->other_table, .id = is->other};
    if (is->kind == APC_ALARM_MODE)
        rows.of[1] = (struct apc_sample){.table = APC_ACTUAL, .id = apc_variable_number(is->table, is->id)};
    rows.of[2] = (struct apc_sample){.table = APC_ALARM, .id = (int)(alarm - e->alarm) + 1};
    int rc = begin_trial(t, store, is, &rows, *range, ticked, why);
    if (rc == 0)
        rc = feed_trial(t, store, &rows, range->until, give_up, why);
    free(rows.at);
    return rc;
}

/* ---- For programs ------------------------------------------------------------------------- */

void alarm_trial_members(const struct alarm_trial *trial, const char *alarm, struct text *t)
{
    json_add(t, "alarm:%s, since:%.6jd, until:%.6jd, recorded:%zu, raised:%zu, tries:[", alarm, trial->since,
             trial->until, trial->recorded, trial->at[0].raised);
    for (size_t i = 1; i < trial->n; i++) {
        const struct alarm_try *one = &trial->at[i];
        json_add(t, "{setting:%s, value:%g, raised:%zu, later:%.9jd, missed:%zu, longest:%.9jd, proposed:%i}",
                 alarm_setting_name(one->setting), one->value, one->raised, one->later, one->missed,
                 one->longest, one->proposed);
    }
    json_add(t, "]");
}

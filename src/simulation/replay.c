/* SPDX-License-Identifier: BSD-3-Clause */
/*
 * A tick row holds what the tick was made from: values, or the seqs of rows that are on record beside it. So
 * each controller is given, tick by tick, just what the recorded one had, and all of the row that it then
 * makes is compared, bit for bit. A law that was late is given no time, and is late again; one in a process
 * of its own that failed may have been killed, and fails again.
 *
 * What a row does not say is whether its controller had been started anew before it. That is tried where the
 * row is another than that of one that lived on. From a row that differs all the same the replay goes on, so
 * that each tick is judged by itself.
 */
#include "replay_internal.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "base/base_internal.h"

/* ---- Rows that are named -------------------------------------------------------------------- */

int replay_order_samples(const void *left, const void *right)
{
    const struct apc_sample *a = left, *b = right;
    if (a->table != b->table)
        return a->table < b->table ? -1 : 1;
    if (a->id != b->id)
        return a->id < b->id ? -1 : 1;
    return a->seq < b->seq ? -1 : a->seq > b->seq;
}

/* Of a variable, the first from that number on. */
static int take_wanted_row(void *ctx, const struct apc_sample *row)
{
    *(struct apc_sample *)ctx = *row;
    return 1;
}

static bool is_known_to_lack(const struct replay *r, const struct apc_sample *wanted)
{
    const struct replay_stray *stray = r->stray;
    while (stray && (stray->sample.table != wanted->table || stray->sample.id != wanted->id ||
                     stray->sample.seq > wanted->seq || stray->lacks_until <= wanted->seq))
        stray = stray->next;
    return stray != NULL;
}

/* It bears a time far from that of its tick: of another machine, or from before a clock was set. */
static void look_for_sample(struct replay *r, const struct apc_sample *wanted)
{
    const struct apc_range range = {.after = wanted->seq - 1};
    struct apc_sample next = {.seq = INT64_MAX};
    if (!r->store || is_known_to_lack(r, wanted) ||
        apc_store_history(r->store, wanted->table, wanted->id, &range, take_wanted_row, &next) < 0)
        return;
    struct replay_stray *stray = calloc(1, sizeof *stray);
    if (!stray)
        return;
    const bool there = next.seq == wanted->seq;
    *stray = (struct replay_stray){there ? next : *wanted, there ? 0 : next.seq, r->stray};
    r->stray = stray;
}

/* How many samples come before @p wanted. */
static size_t samples_before(const struct replay *r, const struct apc_sample *wanted)
{
    size_t low = 0, high = r->samples.n;
    while (low < high) {
        const size_t middle = low + (high - low) / 2;
        if (replay_order_samples(&r->samples.at[middle], wanted) < 0)
            low = middle + 1;
        else
            high = middle;
    }
    return low;
}

const struct apc_sample *replay_sample(const struct replay *r, enum apc_table table, int id, int64_t seq)
{
    const struct apc_sample wanted = {.table = table, .id = id, .seq = seq};
    const size_t at = samples_before(r, &wanted);
    if (at < r->samples.n && replay_order_samples(&r->samples.at[at], &wanted) == 0)
        return &r->samples.at[at];
    const struct replay_stray *stray = r->stray;
    while (stray && (stray->lacks_until > 0 || replay_order_samples(&stray->sample, &wanted) != 0))
        stray = stray->next;
    return stray ? &stray->sample : NULL;
}

const struct apc_sample *replay_named(struct replay *r, enum apc_table table, int id, int64_t seq)
{
    const struct apc_sample wanted = {.table = table, .id = id, .seq = seq},
                            *there = replay_sample(r, table, id, seq);
    if (!there) {
        look_for_sample(r, &wanted);
        there = replay_sample(r, table, id, seq);
    }
    return there;
}

/* Fill in the row of @p seq of its variable; 0: there was none. False: it is not on record. */
static bool give_recorded_sample(struct replay *r, struct apc_sample *in, double seq)
{
    const struct apc_sample *there = seq > 0 ? replay_named(r, in->table, in->id, (int64_t)seq) : NULL;
    *in = there ? *there
                : (struct apc_sample){.table = in->table,
                                      .id = in->id,
                                      .seq = seq > 0 ? (int64_t)seq : 0,
                                      .status = APC_BAD_NO_DATA};
    return there || seq <= 0;
}

/* The newest row of its variable that is not younger than @p time. */
static void give_newest(struct replay *r, struct apc_sample *in, apc_ns time)
{
    const struct apc_sample end = {.table = in->table, .id = in->id, .seq = INT64_MAX};
    for (size_t i = samples_before(r, &end);
         i-- > 0 && r->samples.at[i].table == in->table && r->samples.at[i].id == in->id;)
        if (r->samples.at[i].time <= time) {
            *in = r->samples.at[i];
            return;
        }
    (void)give_recorded_sample(r, in, 0);
}

/* ---- A controller's inputs ------------------------------------------------------------------ */

/* A measurement as the row has it. Its freshness is what the recorded controller found. */
static void give_measurement(struct apc_controller *c, size_t k, double value, double seq, apc_status status,
                             struct apc_now now, apc_ns time)
{
    struct apc_sample *in = &c->in.sample[k];
    *in = (struct apc_sample){.table = in->table,
                              .id = in->id,
                              .seq = (int64_t)seq,
                              .time = time,
                              .value = value,
                              .status = status};
    c->fresh[k] =
        (struct apc_freshness){.mark = in->seq, .changed = now.mono, .looked = now.mono, .seen = true};
}

static void give_measurements(struct apc_controller *c, const double *row, struct apc_now now)
{
    const size_t *at = c->offset;
    for (size_t k = 0; k < c->dim.ny; k++)
        give_measurement(c, k, row[at[APC_TICK_Y] + k], row[at[APC_TICK_Y_SEQ] + k],
                         (apc_status)row[at[APC_TICK_Y_STATUS] + k], now,
                         apc_ns_since(now.utc, apc_ns_read(row[at[APC_TICK_Y_AGE] + k])));
    for (size_t k = 0; k < c->dim.nd; k++)
        give_measurement(c, c->dim.ny + k, row[at[APC_TICK_D] + k], row[at[APC_TICK_D_SEQ] + k],
                         (apc_status)row[at[APC_TICK_D_STATUS] + k], now, now.utc);
}

/* Who of a group acted, by its number. Returns its place. */
static size_t give_acting(const struct apc_controller_group *g, double number)
{
    size_t i = 0;
    if (!g->choice)
        return 0;
    g->choice->seq = 1;
    g->choice->value = number;
    while (i < g->n && (double)g->number[i] != number)
        i++;
    return i < g->n ? i : 0;
}

static void give_below(const struct replay *r, struct apc_vector *tick, double seq)
{
    const struct tick_row *below;
    tick->seq = (int64_t)seq;
    below = ticks_find(&r->controller[tick->id - 1].ticks, tick->seq);
    tick->time = below ? below->time : 0;
}

/* What is wanted, outputs as they stood, and loops above and below. Returns what is not on record; NULL: all
 * is. */
static const struct apc_sample *give_tick_rows(struct replay *r, struct replay_controller *rc,
                                               const double *row)
{
    struct apc_controller *c = rc->core;
    const size_t *at = c->offset, n = c->dim.nz + 2 * c->dim.nu;
    const double *peer = at[APC_TICK_PEER] < at[APC_TICK_PEER + 1] ? row + at[APC_TICK_PEER] : NULL;
    struct apc_sample *in = c->in.sample + c->dim.ny + c->dim.nd;
    const struct apc_sample *missing = NULL;

    for (size_t k = 0; k < c->n_wanted; k++, in++) {
        const bool own = r->other_law && k >= n; /* its own tuning holds */
        if (!give_recorded_sample(
                r, in, own ? 0 : row[k < n ? at[APC_TICK_WANTED] + k : at[APC_TICK_TUNING_SEQ] + k - n]))
            missing = in;
    }
    for (size_t i = 0; i < c->dim.nu; i++, in++) {
        in->seq = c->state[i].seq;
        if (c->loop[i].setpoint && !give_recorded_sample(r, in, row[at[APC_TICK_BELOW] + 4 * i]))
            missing = in;
    }
    for (size_t i = 0; i < c->dim.nu; i++) {
        const double *seq = row + at[APC_TICK_BELOW] + 4 * i;
        struct apc_controller_below *b = &c->below[i];
        if (!b->actual)
            continue;
        const size_t one = give_acting(&b->who, peer ? peer[c->dim.nz + i] : 0);
        if (c->loop[i].setpoint && !give_recorded_sample(r, &b->target[one], seq[2]))
            missing = &b->target[one];
        if (!give_recorded_sample(r, b->actual, seq[1]))
            missing = b->actual;
        give_below(r, &b->tick[one], seq[3]);
    }
    for (size_t k = 0; k < c->dim.nz; k++) {
        struct apc_controller_above *a = &c->above[k];
        const size_t one = a->mode ? give_acting(&a->who, peer ? peer[k] : 0) : 0;
        if (a->mode && !give_recorded_sample(r, &a->mode[one], row[at[APC_TICK_ABOVE] + k]))
            missing = &a->mode[one];
        if (c->choice &&
            !give_recorded_sample(r, &c->choice[1 + k], peer ? peer[c->dim.nz + c->dim.nu + k] : 0))
            missing = &c->choice[1 + k];
    }
    return missing;
}

/* What was to come of the setpoints, to the law that looked ahead; another law is not told. */
static const struct apc_sample *give_plans(struct replay *r, struct replay_controller *rc, const double *row)
{
    struct apc_controller *c = rc->core;
    const struct apc_sample *missing = NULL;
    for (size_t k = 0; k < c->dim.nz && c->plan && !r->other_law; k++) {
        struct apc_vector *to = &c->plan[k];
        const struct ticks *plans = &r->plan[to->id - 1];
        const struct tick_row *at = NULL;
        to->seq = (int64_t)row[c->offset[APC_TICK_PLAN] + k];
        if (to->seq > 0 && !(at = ticks_find(plans, to->seq))) {
            r->lost = (struct apc_sample){.table = APC_PLAN, .id = to->id, .seq = to->seq};
            missing = &r->lost;
        }
        to->time = at ? at->time : 0;
        to->n = at && at->n <= to->room ? (uint32_t)at->n : 0;
        to->status = to->n > 0 ? APC_GOOD : APC_BAD_NO_DATA;
        if (to->n > 0)
            memcpy(to->value, plans->value + at->first, to->n * sizeof *to->value);
    }
    return missing;
}

/* Who acted, and what went out before: of several that have the same outputs. */
static void give_choice(struct apc_controller *c, const double *row)
{
    struct apc_sample *output = c->in.sample + c->dim.ny + c->dim.nd + c->n_wanted;
    const bool shadow = row[c->offset[APC_TICK_STATE]] == (double)APC_LOOP_SHADOW;
    if (!c->choice)
        return;
    c->choice->seq = 1;
    c->choice->value = shadow ? 0 : c->out_row->id;
    apc_controller_claimed(c, true);
    for (size_t i = 0; i < c->dim.nu; i++) {
        if (c->loop[i].setpoint)
            continue;
        output[i].seq = row[c->offset[APC_TICK_THERE] + i] > 0 ? c->state[i].seq + 1 : 0;
        output[i].value = row[c->offset[APC_TICK_LAST] + i];
        output[i].status = APC_GOOD;
    }
}

/* The monotonic clock is not on record: it goes as the wall clock did, unless that was set, and a loop that
 * holds says for how long. */
static struct apc_now recorded_now(const struct replay_controller *rc, const double *row, apc_ns utc)
{
    const struct apc_controller *c = rc->core;
    struct apc_now now = {.mono = APC_NS_PER_S, .utc = utc};
    if (rc->row) {
        const double ticks = row[c->offset[APC_TICK_INDEX]] - rc->row[c->offset[APC_TICK_INDEX]];
        const apc_ns grid = (apc_ns)(ticks * (double)rc->of->rhythm.period), wall = utc - rc->now.utc;
        const apc_ns off = wall > grid ? wall - grid : grid - wall;
        now.mono = rc->now.mono + (off < rc->of->rhythm.period ? wall : grid);
    }
    for (size_t i = 0; i < c->dim.nu; i++) {
        const double held = row[c->offset[APC_TICK_HELD] + i];
        if (held > 0 && c->state[i].loop.holding && !c->resumed_at)
            now.mono = apc_ns_since(c->state[i].loop.held, -apc_ns_read(held));
    }
    return now;
}

static bool was_late(const struct apc_controller *c, const double *row)
{
    for (size_t k = 0; k < c->size.instances; k++)
        if ((int)row[c->offset[APC_TICK_RESULT] + k] == APC_LAW_LATE)
            return true;
    return false;
}

/* Instances of the law come first, then those of its backup, as in the row. */
static void find_gone(struct apc_controller *c, const double *row)
{
    for (size_t k = 0; k < c->size.instances; k++) {
        const struct apc_law *law = (k < c->law.size.instances ? &c->law : &c->backup)->definition;
        c->instance[k].gone =
            apc_law_in_process(law) && (int)row[c->offset[APC_TICK_RESULT] + k] == APC_LAW_FAILED;
    }
}

/* ---- Comparing ------------------------------------------------------------------------------ */

const char *replay_time(const struct replay *r, apc_ns time, char text[APC_TIME_LEN])
{
    if (r->of_store)
        return apc_time_format(time, text);
    snprintf(text, APC_TIME_LEN, "%.3f s", apc_ns_to_s(time - r->start));
    return text;
}

/* Say of a tick what is the matter with it. */
static void describe_difference(const struct replay *r, const struct replay_controller *rc,
                                const struct tick_row *at, const double *row, char text[REPLAY_TEXT],
                                const char *fmt, ...) APC_PRINTF(6, 7);
static void describe_difference(const struct replay *r, const struct replay_controller *rc,
                                const struct tick_row *at, const double *row, char text[REPLAY_TEXT],
                                const char *fmt, ...)
{
    va_list args;
    char time[APC_TIME_LEN];
    const int n = snprintf(text, REPLAY_TEXT, "tick %.0f at %s: ", row[rc->core->offset[APC_TICK_INDEX]],
                           replay_time(r, at->time, time));
    va_start(args, fmt);
    vsnprintf(text + n, REPLAY_TEXT - (size_t)n, fmt, args);
    va_end(args);
}

bool replay_same_bits(double a, double b)
{
    uint64_t bits[2];
    memcpy(&bits[0], &a, sizeof a);
    memcpy(&bits[1], &b, sizeof b);
    return bits[0] == bits[1];
}

/* The first value that differs, but in fields that @p leave_out names (NULL: none). Returns false: all are
 * the same. */
static bool first_difference(const struct apc_controller *c, const double *recorded, const double *made,
                             const bool *leave_out, const char **name, size_t *element)
{
    size_t offset, length;
    for (size_t f = 0; apc_controller_tick_field(c, f, name, &offset, &length); f++)
        for (size_t i = 0; i < length && !(leave_out && leave_out[f]); i++)
            if (!replay_same_bits(recorded[offset + i], made[offset + i])) {
                *element = offset + i;
                return true;
            }
    return false;
}

static double told_time(const struct replay *r, apc_ns time)
{
    return apc_ns_to_s(time - (r->of_store ? r->began : r->start));
}

static void compare_outputs(struct replay *r, const struct replay_controller *rc, const struct tick_row *at,
                            const double *row)
{
    const struct apc_controller *c = rc->core;
    const double t = told_time(r, at->time);
    for (size_t i = 0; i < c->dim.nu; i++) {
        const size_t loop = (size_t)rc->of->first_loop - 1 + i;
        const double recorded = row[c->offset[APC_TICK_U] + i], apart = fabs(c->u[i] - recorded);
        struct replay_difference *d = &r->difference[loop];
        if (!(row[c->offset[APC_TICK_THERE] + i] > 0))
            continue;
        d->same += apart == 0;
        d->sum += apart;
        d->low = d->ticks ? fmin(d->low, recorded) : recorded;
        d->high = d->ticks ? fmax(d->high, recorded) : recorded;
        d->ticks++;
        if (apart > 0 && !d->differs) {
            d->differs = at->time;
            d->since = r->since;
        }
        if (apart > d->worst) {
            d->worst = apart;
            d->at = t;
        }
        if (r->watch.output)
            r->watch.output(r->watch.ctx, t, r->loops.at[loop].name, recorded, c->u[i]);
    }
    if (r->watch.computed)
        r->watch.computed(r->watch.ctx, r, rc, at);
}

/* ---- The ticks ------------------------------------------------------------------------------ */

/* Instead of that on record. */
static void put_own_tuning(const struct apc_controller *c, double *tuning)
{
    if (c->law.size.tuning > 0)
        memcpy(tuning, c->law.tuning, c->law.size.tuning * sizeof *tuning);
    if (c->backup.size.tuning > 0)
        memcpy(tuning + c->backup.first, c->backup.tuning, c->backup.size.tuning * sizeof *tuning);
}

int replay_start_controller(struct replay *r, struct replay_controller *rc, const struct tick_row *former,
                            apc_ns time)
{
    struct apc_error why;
    apc_controller_destroy(rc->core);
    int err = module_controller(&r->e, rc->of, false, &rc->core, &why);
    if (err < 0)
        return apc_fail(&r->why, err, "%s", why.text);
    struct apc_rows *rows = apc_controller_former(rc->core);
    for (size_t k = 0; k < rows->n_samples; k++)
        give_newest(r, &rows->sample[k], time);
    if (former && former->n <= rows->vector->room) {
        rows->vector->seq = former->seq;
        rows->vector->time = former->time;
        rows->vector->status = APC_GOOD;
        rows->vector->n = (uint32_t)former->n;
        memcpy(rows->vector->value, rc->ticks.value + former->first, former->n * sizeof(double));
        if (r->other_law && former->n == rc->core->out_row->n)
            put_own_tuning(rc->core, rows->vector->value + rc->core->offset[APC_TICK_TUNING]);
    }
    apc_controller_resume(rc->core, r->start);
    return 0;
}

const struct apc_sample *replay_give_tick(struct replay *r, struct replay_controller *rc,
                                          const struct tick_row *at, const double *row)
{
    struct apc_controller *c = rc->core;
    rc->ticking = recorded_now(rc, row, at->time);
    give_measurements(c, row, rc->ticking);
    const struct apc_sample *missing = give_tick_rows(r, rc, row), *lost = give_plans(r, rc, row);
    give_choice(c, row);
    const bool known = at->n == c->out_row->n; /* another law's row is another one behind what all have */
    c->budget = known && was_late(c, row) ? 0.0 : apc_ns_to_s(rc->of->budget);
    if (known)
        find_gone(c, row);
    return missing ? missing : lost;
}

void replay_compute_tick(struct replay_controller *rc, const double *row, struct apc_notice *notice)
{
    apc_controller_compute(rc->core, rc->ticking, (uint64_t)row[rc->core->offset[APC_TICK_INDEX]], true,
                           notice);
}

void replay_end_tick(struct replay_controller *rc, const struct tick_row *at, const double *row)
{
    apc_controller_update(rc->core, 1);
    rc->now = recorded_now(rc, row, at->time);
    rc->row = row;
}

bool replay_is_made(const struct apc_controller *c, const double *row)
{
    return memcmp(row, c->row, c->out_row->n * sizeof *row) == 0;
}

void replay_tell_difference(const struct replay *r, const struct replay_controller *rc,
                            const struct tick_row *at, const double *row, const struct apc_sample *missing,
                            char text[REPLAY_TEXT])
{
    const struct apc_controller *c = rc->core;
    const size_t index = c->offset[APC_TICK_INDEX];
    const char *name = "", *because = "from the same inputs: it is another build, or its record is damaged";
    const double gap = rc->row ? row[index] - rc->row[index] : 1;
    size_t element = 0;
    char reason[100];
    if (!first_difference(c, row, c->row, NULL, &name, &element))
        return;
    if (missing) {
        snprintf(reason, sizeof reason, "%s.%d seq %lld is not on record", apc_table_name(missing->table),
                 missing->id, (long long)missing->seq);
        because = reason;
    } else if (!strcmp(name, "mark")) {
        because = "the law, its settings or its model are not those that ran";
    } else if (gap > 1) {
        snprintf(reason, sizeof reason, "%.0f ticks before it are not on record", gap - 1);
        because = reason;
    } else if (r->other_build[0]) {
        because = r->other_build;
    }
    describe_difference(r, rc, at, row, text, "%s was %.17g, is %.17g: %s", name, row[element],
                        c->row[element], because);
}

/* The first of the record, which went on from one that a store without room for all has overwritten. */
static bool begins_later(const struct replay_controller *rc, const double *row,
                         const struct apc_sample *missing)
{
    const size_t *at = rc->core->offset;
    return !rc->row && !missing && row[at[APC_TICK_INDEX]] > 0 &&
           replay_same_bits(row[at[APC_TICK_MARK]], rc->core->row[at[APC_TICK_MARK]]);
}

static int start_tick_anew(struct replay *r, struct replay_controller *rc, const struct tick_row *at,
                           const double *row, const struct tick_row *former, struct apc_notice *notice)
{
    const int err = replay_start_controller(r, rc, former, at[-1].time);
    if (err < 0)
        return err;
    (void)replay_give_tick(r, rc, at, row);
    replay_compute_tick(rc, row, notice);
    return 0;
}

static bool is_behind_gap(const struct replay_controller *rc, const double *row)
{
    const size_t index = rc->core->offset[APC_TICK_INDEX];
    return rc->row && row[index] - rc->row[index] > 1;
}

/* @p lost: the record has not all that it was made from. */
static void count_tick(const struct replay *r, struct replay_controller *rc, const struct tick_row *at,
                       bool same, bool begins, bool lost, const char text[REPLAY_TEXT])
{
    struct replay_figures *f = &rc->figures;
    const bool lacks = !same && !begins && lost && r->of_store && !r->other_law;
    if (begins && !f->begins)
        f->begins = at->time;
    if (lacks && !f->lacks[0]) {
        f->loses = at->time;
        memcpy(f->lacks, text, sizeof f->lacks);
    }
    if (!same && !begins && !lacks && !f->first[0]) {
        f->differs = at->time;
        memcpy(f->first, text, sizeof f->first);
    }
    f->lost += lacks;
    f->judged += !lacks && !begins;
    f->same += same;
}

bool replay_judges(const struct replay *r, apc_ns time)
{
    return time >= r->since && (r->until == 0 || time < r->until);
}

int replay_tick(struct replay *r, struct replay_controller *rc, size_t k)
{
    const struct tick_row *at = &rc->ticks.at[k], *former = k > 0 ? at - 1 : NULL;
    const double *row = rc->ticks.value + at->first;
    const bool judged = replay_judges(r, at->time);
    char text[REPLAY_TEXT] = "";
    struct apc_notice notice;
    const struct apc_sample *missing = replay_give_tick(r, rc, at, row);
    replay_compute_tick(rc, row, &notice);
    bool same = at->n == rc->core->out_row->n && replay_is_made(rc->core, row);
    int err = 0;

    const bool begins = !same && !r->other_law && begins_later(rc, row, missing);
    const bool lost = missing || is_behind_gap(rc, row);
    if (!same && !begins && !r->other_law)
        replay_tell_difference(r, rc, at, row, missing, text);
    if (!same && !r->other_law && former) {
        if ((err = start_tick_anew(r, rc, at, row, former, &notice)) < 0)
            return err;
        same = replay_is_made(rc->core, row);
        if (!same && r->of_store) { /* or a run began that takes nothing over from the one before */
            rc->row = NULL;
            if ((err = start_tick_anew(r, rc, at, row, NULL, &notice)) < 0)
                return err;
            same = replay_is_made(rc->core, row);
        }
        rc->figures.restarts += same && judged;
    }
    if (judged)
        count_tick(r, rc, at, same, begins, lost, text);
    if (judged)
        compare_outputs(r, rc, at, row);
    do
        if (r->watch.notice && judged && notice.kind != APC_NOTICE_NONE && notice.kind != APC_NOTICE_MODE)
            r->watch.notice(r->watch.ctx, told_time(r, at->time), notice.text);
    while (apc_controller_noticed(rc->core, &notice));
    replay_end_tick(rc, at, row);
    return same || r->other_law ? 0 : replay_start_controller(r, rc, at, at->time);
}

int replay_run(struct replay *r, const struct replay_watch *watch)
{
    int rc = 0;
    r->watch = *watch;
    for (size_t i = 0; i < r->e.n_controllers && rc == 0; i++) {
        struct replay_controller *c = &r->controller[i];
        rc = replay_start_controller(r, c, NULL, r->start - 1);
        for (size_t k = 0; k < c->ticks.n && rc == 0; k++) {
            if (!r->other_law && c->ticks.at[k].n != c->core->out_row->n)
                return apc_fail(&r->why, APC_EPROTO,
                                "tick row %lld of %s has %zu values, not %u: its law, its settings or its "
                                "model are not those that ran",
                                (long long)c->ticks.at[k].seq, c->of->name, c->ticks.at[k].n,
                                c->core->out_row->n);
            rc = replay_tick(r, c, k);
        }
    }
    return rc;
}

/* ---- In virtual time ------------------------------------------------------------------------ */

/* Times, and the numbers of rows, are other ones. */
static const bool left_out[APC_TICK_FIELDS] = {
    [APC_TICK_HELD] = true,  [APC_TICK_ASKED] = true, [APC_TICK_WANTED] = true, [APC_TICK_Y_SEQ] = true,
    [APC_TICK_Y_AGE] = true, [APC_TICK_D_SEQ] = true, [APC_TICK_Z_SEQ] = true,  [APC_TICK_ABOVE] = true,
    [APC_TICK_BELOW] = true, [APC_TICK_PLAN] = true,  [APC_TICK_INDEX] = true,  [APC_TICK_TUNING_SEQ] = true,
};

/* What the tick was given, before what it made of that. */
static const char *cause_of(const struct apc_controller *c, const double *recorded, const double *made)
{
    static const struct {
        enum apc_tick_field field;
        const char *what;
    } of[] = {{APC_TICK_Y, "a measurement was another"},
              {APC_TICK_Y_STATUS, "a measurement was another"},
              {APC_TICK_Y_NEW, "a measurement was late"},
              {APC_TICK_D, "a disturbance was another"},
              {APC_TICK_Z, "a setpoint was another"},
              {APC_TICK_PLANNED, "what a setpoint was to be was not known"},
              {APC_TICK_TARGET, "a mode was another"},
              {APC_TICK_TUNING, "a tuning was another"},
              {APC_TICK_MANUAL, "an operator's output was another"},
              {APC_TICK_LAST, "the output before it was another"}};
    for (size_t k = 0; k < sizeof of / sizeof *of; k++)
        for (size_t i = c->offset[of[k].field]; i < c->offset[of[k].field + 1]; i++)
            if (!replay_same_bits(recorded[i], made[i]))
                return of[k].what;
    return "from the same inputs";
}

/* By how much its controller began later than its grid says. */
static double late_s(const struct replay *r, const struct replay_controller *rc, const struct tick_row *at,
                     double index)
{
    const struct rhythm *rhythm = &rc->of->rhythm;
    return apc_ns_to_s(at->time - r->start - rhythm->phase) - index * apc_ns_to_s(rhythm->period);
}

static void compare_virtual(struct replay *r, struct replay_controller *rc, const struct ticks *made)
{
    const struct apc_controller *c = rc->core;
    const size_t index = c->offset[APC_TICK_INDEX];
    for (size_t k = 0; k < rc->ticks.n && !rc->figures.first[0]; k++) {
        const struct tick_row *at = &rc->ticks.at[k];
        const double *row = rc->ticks.value + at->first;
        const double *other = k < made->n ? made->value + made->at[k].first : NULL;
        const char *name;
        size_t element;
        if (!other || other[index] < row[index] || other[index] > row[index])
            describe_difference(r, rc, at, row, rc->figures.first, "%s",
                                !other ? "there is none in virtual time: the run was longer"
                                : other[index] < row[index]
                                    ? "a tick before it is not on record: it was missed"
                                    : "it was missed in virtual time");
        else if (at->n != made->at[k].n)
            describe_difference(r, rc, at, row, rc->figures.first,
                                "its law, its settings or its model are not those that ran");
        else if (first_difference(c, row, other, left_out, &name, &element))
            describe_difference(
                r, rc, at, row, rc->figures.first,
                "%s was %.17g, in virtual time it is %.17g: %s, and the tick %.1f ms late%s%s", name,
                row[element], other[element], cause_of(c, row, other), 1e3 * late_s(r, rc, at, row[index]),
                r->other_build[0] ? "; " : "", r->other_build);
        else
            rc->figures.same++;
    }
    rc->figures.judged = rc->ticks.n;
}

int replay_virtual(struct replay *r)
{
    struct experiment e;
    struct simulation s;
    struct samples written = {0};
    struct apc_error why = {""};
    int rc = experiment_load(&e, r->e.file, EXPERIMENT_MODEL | EXPERIMENT_LAW, NULL, &r->why);
    if (rc < 0)
        return rc;
    rc = simulation_create(&s, &e, e.seed, &why);
    if (rc == 0 && (rc = simulation_written(&e, &written, &why)) >= 0)
        rc = simulation_repeat_writes(&s, &written);
    if (rc == 0 && (rc = simulation_run(&s, e.duration)) < 0)
        why = s.why;
    for (size_t i = 0; i < e.n_controllers && rc == 0; i++) {
        struct ticks made;
        rc = replay_start_controller(r, &r->controller[i], NULL, r->start - 1);
        if (rc == 0 && (rc = ticks_load(&made, s.store, APC_TICK, e.controllers[i].number, 0)) == 0)
            compare_virtual(r, &r->controller[i], &made);
        ticks_free(&made);
    }
    if (rc < 0 && why.text[0])
        r->why = why;
    simulation_destroy(&s);
    samples_free(&written);
    experiment_free(&e);
    return rc;
}

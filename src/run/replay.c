/* SPDX-License-Identifier: BSD-3-Clause */
/*
 * The controller's core ticks where the recorded one did, at the times of its outputs, and is given what that
 * one had: the measurements and setpoints that its outputs name, the modes and the tuning of then. Its
 * outputs go nowhere: the measurements stay those that the recorded outputs have led to.
 *
 * An output names the measurement and the setpoint of its own loop only, and none when the law did not make
 * it. What is not named is taken by the clock: the newest setpoint; the measurement that was made with a
 * named one or, without any, that the client had brought by then, which it does at its own instants. A race
 * decided otherwise in the run is not seen then, so it is said that the replay is not exact.
 */
#include "replay.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#define ZERO APC_NS_PER_S /* t = 0 on both clocks of the replayed controller; not 0, which is "never" */

/* ---- What the outputs name ------------------------------------------------------------------ */

static int compare_names(const struct apc_sample *a, const struct apc_sample *b)
{
    if (a->table != b->table)
        return a->table < b->table ? -1 : 1;
    if (a->id != b->id)
        return a->id < b->id ? -1 : 1;
    return a->seq < b->seq ? -1 : a->seq > b->seq;
}

static int by_name(const void *left, const void *right, void *samples)
{
    const struct apc_sample *at = samples;
    return compare_names(&at[*(const size_t *)left], &at[*(const size_t *)right]);
}

static int index_samples(struct replay *r)
{
    r->by_seq = calloc(r->samples.n + 1, sizeof *r->by_seq);
    if (!r->by_seq)
        return APC_ENOMEM;
    for (size_t i = 0; i < r->samples.n; i++)
        r->by_seq[i] = i;
    qsort_r(r->by_seq, r->samples.n, sizeof *r->by_seq, by_name, r->samples.at);
    return 0;
}

static const struct apc_sample *find(const struct replay *r, enum apc_table table, int id, int64_t seq)
{
    const struct apc_sample wanted = {.table = table, .id = id, .seq = seq};
    size_t low = 0, high = r->samples.n;
    while (low < high) {
        size_t middle = low + (high - low) / 2;
        const struct apc_sample *s = &r->samples.at[r->by_seq[middle]];
        int order = compare_names(s, &wanted);
        if (order == 0)
            return s;
        if (order < 0)
            low = middle + 1;
        else
            high = middle;
    }
    return NULL;
}

/* The sample of a measurement or setpoint that one of the tick's outputs names; NULL: none does. */
static const struct apc_sample *named(const struct replay *r, const struct apc_sample *tick,
                                      enum apc_table table, size_t number)
{
    for (size_t i = 0; r->seqs && i < r->e.dim.nu; i++) {
        bool sensor = table == APC_SENSOR;
        int64_t seq = sensor ? tick[i].sensor_seq : tick[i].setpoint_seq;
        if (seq > 0 && number == (sensor ? r->pair[i].measurement : r->pair[i].setpoint))
            return find(r, table, (int)number, seq);
    }
    return NULL;
}

/* ---- The controller's inputs -------------------------------------------------------------- */

/* When the client brought a measurement of that source time. */
static apc_ns arrival(const struct replay *r, apc_ns source)
{
    const struct rhythm *client = &r->e.client.rhythm;
    return apc_grid_time(client->phase, client->period, apc_grid_next(client->phase, client->period, source));
}

static void give(struct apc_sample *in, const struct apc_sample *s)
{
    *in = *s;
    in->time += ZERO;
}

/* The newest sample of in[k] in @p from that was there at @p t, or that was made until @p made. */
static void give_newest(struct replay *r, const struct samples *from, size_t k, apc_ns t, apc_ns made)
{
    struct apc_sample *in = &r->in[k];
    for (size_t *i = &r->next[k]; *i < from->n; ++*i) {
        const struct apc_sample *s = &from->at[*i];
        if (s->table != in->table || s->id != in->id)
            continue;
        if (made >= 0 ? s->time > made : (s->table == APC_SENSOR ? arrival(r, s->time) : s->time) > t)
            return;
        give(in, s);
    }
}

/* Returns whether each was named. */
static bool give_loop(struct replay *r, const struct apc_sample *tick)
{
    const size_t ny = r->e.dim.ny, nz = r->e.dim.nz;
    apc_ns made = -1;
    bool all = true;
    for (size_t k = 0; k < ny; k++) {
        const struct apc_sample *s = named(r, tick, APC_SENSOR, k + 1);
        if (s)
            made = s->time > made ? s->time : made;
    }
    for (size_t k = 0; k < ny + nz; k++) {
        enum apc_table table = k < ny ? APC_SENSOR : APC_SETPOINT;
        const struct apc_sample *s = named(r, tick, table, k < ny ? k + 1 : k - ny + 1);
        if (s)
            give(&r->in[k], s);
        else
            give_newest(r, &r->samples, k, tick->time, table == APC_SENSOR ? made : -1);
        all = all && s;
    }
    return all;
}

/* What does not come from the samples: written before the run, or by an operator. */
static void give_value(struct apc_sample *in, int64_t seq, double value)
{
    in->seq = seq;
    in->time = ZERO;
    in->status = APC_GOOD;
    in->value = value;
}

/*
 * What the operator wanted at the tick of @p t whose output has @p status, from the actual mode, which has
 * the time of its tick. An output that is not Good in mode Man was the fault value, in mode Auto.
 */
static enum apc_mode mode_at(const struct replay *r, apc_ns t, apc_status status)
{
    enum apc_mode mode = r->e.controllers->mode;
    for (size_t i = 0; i < r->operation.n && r->operation.at[i].time <= t; i++)
        if (r->operation.at[i].table == APC_OPMODE && r->operation.at[i].id == 1)
            mode = (enum apc_mode)r->operation.at[i].value;
    return mode == APC_MODE_MAN && apc_status_severity(status) != APC_SEVERITY_GOOD ? APC_MODE_AUTO : mode;
}

/* @p tick points at the recorded outputs of one tick, [nu]. */
static void give_all(struct replay *r, const struct apc_sample *tick)
{
    const size_t loop = r->e.dim.ny + r->e.dim.nz, nu = r->e.dim.nu;
    const size_t n_tuning = apc_law_parameters(r->e.controllers->law, &r->e.dim);
    struct apc_sample *in = r->in + loop;
    enum apc_mode mode = mode_at(r, tick->time, tick->status);

    r->guessed += !give_loop(r, tick);
    for (size_t i = 0; i < nu; i++)
        give_value(in++, 1, mode);
    for (size_t i = 0; i < nu; i++)
        give_value(in++, mode == APC_MODE_MAN ? tick[i].seq + 1 : 1, tick[i].value);
    for (size_t i = 0; i < n_tuning; i++, in++) {
        if (in->seq == 0)
            give_value(in, 1, r->e.controllers->tuning[i]);
        if (!r->other_law)
            give_newest(r, &r->operation, loop + 2 * nu + i, tick->time, -1);
    }
}

/* ---- The ticks ---------------------------------------------------------------------------- */

static void compare(struct replay *r, const struct apc_sample *recorded, double replayed)
{
    struct replay_difference *d = &r->difference[recorded->id - 1];
    double apart = fabs(replayed - recorded->value), t = apc_ns_to_s(recorded->time);
    d->same += apart == 0;
    d->sum += apart;
    d->low = r->ticks ? fmin(d->low, recorded->value) : recorded->value;
    d->high = r->ticks ? fmax(d->high, recorded->value) : recorded->value;
    if (apart > d->worst) {
        d->worst = apart;
        d->at = t;
    }
    if (r->watch.output)
        r->watch.output(r->watch.ctx, t, recorded->id, recorded->value, replayed);
}

static void replay_tick(struct replay *r, const struct apc_sample *tick)
{
    const struct apc_now now = {.mono = ZERO + tick->time, .utc = ZERO + tick->time};
    struct apc_notice notice;
    give_all(r, tick);
    const struct apc_rows *out = apc_controller_out(r->core);
    apc_controller_compute(r->core, now, r->ticks, true, &notice);
    if (notice.kind != APC_NOTICE_NONE && notice.kind != APC_NOTICE_MODE && r->watch.notice)
        r->watch.notice(r->watch.ctx, apc_ns_to_s(tick->time), notice.text);
    for (size_t i = 0; i < out->n_samples; i++)
        if (out->sample[i].table == APC_ACTUATOR)
            compare(r, &tick[out->sample[i].id - 1], out->sample[i].value);
    apc_controller_update(r->core, 1);
    r->ticks++;
}

/* The outputs of one tick have one time and stand together, in the order of their ids. */
void replay_run(struct replay *r, const struct replay_watch *watch)
{
    const size_t nu = r->e.dim.nu;
    r->watch = *watch;
    for (size_t i = 0; i + nu <= r->samples.n; i++) {
        const struct apc_sample *s = &r->samples.at[i];
        size_t n = 0;
        while (n < nu && s[n].table == APC_ACTUATOR && s[n].id == (int)n + 1 && s[n].time == s->time)
            n++;
        if (n == nu)
            replay_tick(r, s);
    }
}

/* ---- Making one ------------------------------------------------------------------------------ */

static int make_room(struct replay *r, struct apc_error *why)
{
    const struct apc_law_setup setup = cores_law_setup(r->e.controllers);
    const size_t nu = r->e.dim.nu;
    r->in = apc_controller_in(r->core)->sample;
    r->next = calloc(apc_controller_in(r->core)->n_samples, sizeof *r->next);
    r->difference = calloc(nu, sizeof *r->difference);
    r->pair = calloc(nu, sizeof *r->pair);
    if (!r->next || !r->difference || !r->pair || index_samples(r) < 0)
        return apc_fail(why, APC_ENOMEM, "out of memory");
    return apc_law_pairing(r->e.controllers->law, &setup, r->pair, why);
}

/* A file that older runs have not. */
static int optional(int rc, bool *there)
{
    *there = rc == 0;
    return rc == APC_ENOTFOUND ? 0 : rc;
}

int replay_load(struct replay *r, const char *dir, const struct experiment_overrides *overrides,
                struct apc_error *why)
{
    *r = (struct replay){.other_law = overrides && overrides->law};
    int rc = experiment_load(&r->e, dir, EXPERIMENT_LAW, overrides, why);
    if (rc == 0)
        rc = samples_read(&r->samples, dir, "samples.csv", why);
    if (rc == 0)
        rc = optional(samples_read_seqs(&r->samples, dir, why), &r->seqs);
    if (rc == 0)
        rc = optional(samples_read(&r->operation, dir, "operation.csv", why), &r->operated);
    if (rc == 0)
        rc = cores_controller(&r->e, r->e.controllers, false, &r->core, why);
    return rc == 0 ? make_room(r, why) : rc;
}

void replay_free(struct replay *r)
{
    apc_controller_destroy(r->core);
    samples_free(&r->samples);
    samples_free(&r->operation);
    experiment_free(&r->e);
    free(r->by_seq);
    free(r->pair);
    free(r->next);
    free(r->difference);
}

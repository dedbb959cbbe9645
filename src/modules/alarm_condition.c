/* SPDX-License-Identifier: BSD-3-Clause */
/*
 * What cannot be judged stays as it was: a signal that is Bad or stale makes no level alarm come or go, but
 * the delay of one that was on its way runs on.
 */
#include "modules/alarm.h"
#include "modules/controller.h"

#include <math.h>

static bool is_good(const struct apc_sample *s)
{
    return s->seq > 0 && apc_status_severity(s->status) != APC_SEVERITY_BAD;
}

/* Beyond the limit, or, once it was, not yet back by the deadband. */
static bool exceeds(double by, const struct apc_alarm *a, bool was)
{
    return was ? by > -a->deadband : by > 0;
}

static bool judge_rate(struct apc_alarm_condition *c, const struct apc_alarm *a, const struct apc_sample *s)
{
    const double dt = apc_ns_to_s(s->time - c->before.time), dv = s->value - c->before.value;
    const bool first = c->before.seq == 0;
    bool raw = c->raw;
    if (s->seq == c->before.seq)
        return raw;
    if (!first && dt > 0)
        raw = exceeds(fabs(dv) / dt - a->limit, a, c->raw);
    c->before.seq = s->seq;
    c->before.time = s->time;
    c->before.value = s->value;
    return raw;
}

/* Of a signal that still comes: one that does not is another alarm's. */
static bool judge_frozen(struct apc_alarm_condition *c, const struct apc_alarm *a, const struct apc_sample *s)
{
    bool raw = c->raw;
    if (s->seq == c->before.seq)
        return raw;
    raw = c->before.seq > 0 && !(fabs(s->value - c->before.value) > a->deadband);
    if (!raw)
        c->before.value = s->value;
    c->before.seq = s->seq;
    return raw;
}

static bool is_at_limit(const struct apc_alarm *a, double value, bool was)
{
    const double back = was ? a->deadband : 0;
    return value >= a->high - back || value <= a->low + back;
}

/* A target that the controller has not looked at yet says nothing of its mode. */
static bool judge_mode(bool was, const struct apc_sample *target, const struct apc_sample *actual)
{
    if (actual->origin < target->seq)
        return was;
    return target->value < actual->value || target->value > actual->value;
}

/* Ticks of the grid that left no row. Rows that nobody looked at count as ticks. Of a grid or a store that
 * begins anew nothing is known to be missed. */
static bool judge_overrun(struct apc_alarm_condition *c, const struct apc_alarm *a,
                          const struct apc_vector *tick)
{
    const double index = tick->n > APC_TICK_INDEX_AT ? tick->value[APC_TICK_INDEX_AT] : -1;
    if (tick->seq == c->before.seq || !(index >= 0 && index <= 0x1p53))
        return false;
    const bool goes_on = c->before.seq > 0 && tick->seq > c->before.seq;
    const double missed = index - c->before.value - ((double)tick->seq - (double)c->before.seq);
    c->before.seq = tick->seq;
    c->before.value = index;
    return goes_on && missed > 0 && missed >= a->limit;
}

static bool judge_value(struct apc_alarm_condition *c, const struct apc_alarm *a,
                        const struct apc_alarm_inputs *in)
{
    const struct apc_sample *s = in->signal;
    switch (a->kind) {
    case APC_ALARM_LOW_LOW:
    case APC_ALARM_LOW:
        return exceeds(a->limit - s->value, a, c->raw);
    case APC_ALARM_HIGH:
    case APC_ALARM_HIGH_HIGH:
        return exceeds(s->value - a->limit, a, c->raw);
    case APC_ALARM_DEVIATION:
        return exceeds(fabs(s->value - in->other->value) - a->limit, a, c->raw);
    case APC_ALARM_RATE:
        return judge_rate(c, a, s);
    case APC_ALARM_FROZEN:
        return judge_frozen(c, a, s);
    case APC_ALARM_AT_LIMIT:
        return is_at_limit(a, s->value, c->raw);
    case APC_ALARM_MODE:
        return judge_mode(c->raw, s, in->other);
    case APC_ALARM_BAD:
    case APC_ALARM_STOPPED:
    case APC_ALARM_OVERRUN:
    case APC_ALARM_KINDS:
        break;
    }
    return c->raw;
}

/* What has not come yet may still do so, for as long as it may stay away later. */
static bool waits(struct apc_alarm_condition *c, apc_ns horizon, apc_ns now)
{
    if (!c->begun)
        c->began = now;
    c->begun = true;
    return now - c->began <= horizon;
}

static bool judge_condition(struct apc_alarm_condition *c, const struct apc_alarm *a,
                            const struct apc_alarm_inputs *in, struct apc_now now)
{
    const struct apc_sample *s = in->signal;
    const bool early = waits(c, a->horizon, now.mono);
    bool fresh = true;
    c->poor = false;
    if (a->kind == APC_ALARM_OVERRUN)
        return judge_overrun(c, a, in->tick);
    if (a->kind == APC_ALARM_STOPPED)
        fresh = apc_freshness_dated(&c->fresh, in->tick->seq, in->tick->time, now, a->horizon);
    else if (a->horizon > 0)
        fresh = apc_freshness_look(&c->fresh, s->seq, s->time, now, a->horizon);
    if (a->kind == APC_ALARM_STOPPED)
        return fresh ? false : c->raw || !early;
    if (a->kind == APC_ALARM_BAD)
        return fresh ? !is_good(s) : c->raw || !early;
    c->poor = !fresh || !is_good(s);
    if (a->kind == APC_ALARM_DEVIATION || a->kind == APC_ALARM_MODE)
        c->poor |= !in->other || in->other->seq == 0;
    if (a->kind == APC_ALARM_DEVIATION)
        c->poor |= !in->other || !is_good(in->other);
    return c->poor ? c->raw : judge_value(c, a, in);
}

bool apc_alarm_judge(struct apc_alarm_condition *c, const struct apc_alarm *a,
                     const struct apc_alarm_inputs *in, struct apc_now now)
{
    const bool raw = judge_condition(c, a, in, now);
    if (raw != c->is && !c->differs)
        c->since = now.mono;
    c->raw = raw;
    c->differs = raw != c->is;
    if (c->differs && now.mono - c->since >= (raw ? a->on_delay : a->off_delay)) {
        c->is = raw;
        c->differs = false;
    }
    return c->is;
}

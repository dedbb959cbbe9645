/* SPDX-License-Identifier: BSD-3-Clause */
/* Expectations judged over the trajectories of a run: each trajectory is made of pieces, in which its value is one or is not
 * known. */
#include "check_internal.h"

#include <apcmath.h>

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

int check_add(struct check_trajectory *trajectory, struct check_point point)
{
    if (trajectory->n == trajectory->room) {
        const size_t room = trajectory->room ? 2 * trajectory->room : 256;
        struct check_point *at = reallocarray(trajectory->at, room, sizeof *at);
        if (!at)
            return APC_ENOMEM;
        trajectory->at = at;
        trajectory->room = room;
    }
    trajectory->at[trajectory->n++] = point;
    return 0;
}

/* ---- Pieces --------------------------------------------------------------------------------- */

struct piece {
    apc_ns from, until;           /* from <= t < until */
    const struct check_point *is; /* NULL: not known */
    bool before;                  /* there has been no value yet */
};

struct pieces {
    const struct check_trajectory *trajectory;
    apc_ns horizon, end;
    size_t next;  /* point */
    apc_ns stale; /* the point before it is known until then; 0: it goes on */
    bool begun;
};

static apc_ns begin_of_next(const struct pieces *p)
{
    const apc_ns next = p->next < p->trajectory->n ? p->trajectory->at[p->next].t : INT64_MAX;
    return next < p->end ? next : p->end;
}

/* The next one; false: there is none more. The last one is not known, if nothing is from `end` on. */
static bool next_piece(struct pieces *p, struct piece *piece)
{
    const apc_ns last = piece->until;
    if (!p->begun) {
        p->begun = true;
        *piece = (struct piece){.from = INT64_MIN, .until = begin_of_next(p), .before = true};
        return true;
    }
    if (last == INT64_MAX)
        return false;
    if (last >= p->end) {
        *piece = (struct piece){.from = p->end, .until = INT64_MAX};
        return true;
    }
    if (p->stale) { /* until the next value */
        p->stale = 0;
        *piece = (struct piece){.from = last, .until = begin_of_next(p)};
        return true;
    }
    const struct check_point *point = &p->trajectory->at[p->next++];
    for (; p->next < p->trajectory->n && p->trajectory->at[p->next].t <= point->t; p->next++)
        point = &p->trajectory->at[p->next]; /* at one instant the last one holds */
    apc_ns until = begin_of_next(p);
    if (p->horizon > 0 && until - point->t > p->horizon)
        until = p->stale = point->t + p->horizon;
    *piece = (struct piece){.from = point->t, .until = until, .is = point->known ? point : NULL};
    return true;
}

/* ---- Conditions ----------------------------------------------------------------------------- */

bool check_is_true(const struct expectation *x, const struct check_point *p)
{
    const enum apc_alarm_state state = (enum apc_alarm_state)p->value;
    switch (x->kind) {
    case CHECK_BELOW:
        return p->value < x->number;
    case CHECK_AT_MOST:
        return p->value <= x->number;
    case CHECK_ABOVE:
        return p->value > x->number;
    case CHECK_AT_LEAST:
        return p->value >= x->number;
    case CHECK_FAULT:
        return p->others && p->value == x->number;
    case CHECK_ALARM:
        return apc_alarm_is_active(state) && !apc_alarm_is_masked(state);
    default:
        return p->value == x->number;
    }
}

static bool is_compared(const struct expectation *x)
{
    return x->kind <= CHECK_AT_LEAST;
}

/* How far a value is into the condition. */
static double depth_of(const struct expectation *x, double value)
{
    return x->kind <= CHECK_AT_MOST ? x->number - value : value - x->number;
}

/* The value that came nearest to making it true, or false where it always is to be. */
static void note_closest(const struct expectation *x, const struct piece *p, struct check_verdict *v)
{
    const double sign = x->form == CHECK_ALWAYS ? -1 : 1;
    if (!is_compared(x) || !p->is)
        return;
    if (isnan(v->closest) || sign * depth_of(x, p->is->value) > sign * depth_of(x, v->closest)) {
        v->closest = p->is->value;
        v->closest_at = p->from > x->from ? p->from : x->from;
    }
}

static apc_ns later_of(apc_ns a, apc_ns b)
{
    return a > b ? a : b;
}

static apc_ns earlier_of(apc_ns a, apc_ns b)
{
    return a < b ? a : b;
}

static void set_verdict(struct check_verdict *v, enum check_is is, apc_ns at, const struct check_point *point)
{
    v->is = is;
    v->at = at;
    v->value = point ? point->value : (double)NAN;
}

/* ---- Forms ---------------------------------------------------------------------------------- */

static void judge_throughout(const struct expectation *x, struct pieces p, struct check_verdict *v)
{
    struct piece piece = {.until = INT64_MIN};
    bool any = false;
    set_verdict(v, CHECK_HELD, x->until, NULL);
    while (next_piece(&p, &piece) && piece.from <= x->until) {
        if (piece.until <= x->from)
            continue;
        note_closest(x, &piece, v);
        any = any || piece.is;
        if (piece.is && check_is_true(x, piece.is) != (x->form == CHECK_ALWAYS)) {
            set_verdict(v, CHECK_FAILED, later_of(piece.from, x->from), piece.is);
            return;
        }
        if (!piece.is && !piece.before && v->is == CHECK_HELD) {
            set_verdict(v, CHECK_UNKNOWN, later_of(piece.from, x->from), NULL);
            v->until = earlier_of(piece.until, x->until);
        }
    }
    if (!any) {
        set_verdict(v, CHECK_UNKNOWN, x->from, NULL);
        v->until = x->until;
    }
}

static void judge_once(const struct expectation *x, struct pieces p, struct check_verdict *v)
{
    struct piece piece = {.until = INT64_MIN};
    const struct check_point *last = NULL;
    bool any = false, gap = false;
    while (next_piece(&p, &piece) && piece.from <= x->until) {
        if (piece.until <= x->from)
            continue;
        note_closest(x, &piece, v);
        any = any || piece.is;
        last = piece.is;
        if (piece.is && check_is_true(x, piece.is)) {
            set_verdict(v, CHECK_HELD, later_of(piece.from, x->from), piece.is);
            return;
        }
        if (!piece.is && !piece.before && !gap) {
            gap = true;
            v->at = later_of(piece.from, x->from);
            v->until = earlier_of(piece.until, x->until);
        }
    }
    if (any && !gap) {
        set_verdict(v, CHECK_FAILED, x->until, last);
    } else if (!any) {
        v->at = x->from;
        v->until = x->until;
    }
}

static void judge_at(const struct expectation *x, struct pieces p, struct check_verdict *v)
{
    struct piece piece = {.until = INT64_MIN};
    while (next_piece(&p, &piece) && piece.until <= x->until)
        continue;
    set_verdict(v,
                !piece.is                    ? CHECK_UNKNOWN
                : check_is_true(x, piece.is) ? CHECK_HELD
                                             : CHECK_FAILED,
                x->until, piece.is);
    v->until = x->until;
}

/* The setpoint in force at @p from, or the first one after it, and when it is another one. */
static const struct check_point *setpoint_from(const struct check_trajectory *trajectory, apc_ns from,
                                               apc_ns *until)
{
    const struct check_point *is = NULL;
    for (size_t i = 0; i < trajectory->n; i++) {
        const struct check_point *p = &trajectory->at[i];
        if (!is || p->t <= from)
            is = p;
        else if (p->value != is->value) {
            *until = earlier_of(*until, p->t);
            break;
        }
    }
    return is;
}

void check_say_unknown(struct check_verdict *v, const char *why)
{
    v->is = CHECK_UNKNOWN;
    snprintf(v->why, sizeof v->why, "%s", why);
}

static void judge_settling(const struct expectation *x, struct pieces p,
                           const struct check_trajectory *setpoints, struct check_verdict *v)
{
    struct piece piece = {.until = INT64_MIN};
    apc_ns until = x->until, settled = INT64_MIN;
    const struct check_point *r = setpoint_from(setpoints, x->from, &until), *y = NULL;
    double band = x->percent ? (double)NAN : x->number;
    bool gap = false; /* not known: it is still settled if it is inside again afterwards */

    set_verdict(v, CHECK_UNKNOWN, x->from, NULL);
    v->until = until;
    while (r && next_piece(&p, &piece) && piece.from < until) {
        if (piece.until <= x->from || piece.before)
            continue;
        if (piece.is && isnan(band))
            band = x->number / 100 * fabs(r->value - piece.is->value);
        y = piece.is ? piece.is : y;
        const bool inside = piece.is && fabs(piece.is->value - r->value) <= band;
        if (inside && settled == INT64_MIN)
            settled = later_of(piece.from, x->from);
        gap = !piece.is;
        if (inside)
            continue;
        if (piece.is) {
            settled = INT64_MIN;
            set_verdict(v, CHECK_FAILED, earlier_of(piece.until, until), piece.is);
        } else {
            set_verdict(v, CHECK_UNKNOWN, later_of(piece.from, x->from), NULL);
            v->until = earlier_of(piece.until, until);
        }
    }
    if (!y)
        return;
    if (!(band > 0))
        check_say_unknown(v, "the setpoint is where the measurement is: no step");
    else if (settled != INT64_MIN && !gap)
        set_verdict(v, settled - x->from <= x->time ? CHECK_HELD : CHECK_FAILED, settled, y);
}

/* Of one alarm: each time that it is raised. */
static void judge_acknowledging(const struct expectation *x, const struct check_trajectory *trajectory,
                                apc_ns end, struct check_verdict *v)
{
    for (size_t i = 0; i < trajectory->n; i++) {
        const apc_ns raised = trajectory->at[i].t, last = earlier_of(x->until, end);
        const bool was = i > 0 && apc_alarm_is_unacked((enum apc_alarm_state)trajectory->at[i - 1].value);
        size_t k = i;
        if (was || !apc_alarm_is_unacked((enum apc_alarm_state)trajectory->at[i].value) || raised < x->from ||
            raised > last)
            continue;
        while (k < trajectory->n && apc_alarm_is_unacked((enum apc_alarm_state)trajectory->at[k].value))
            k++;
        const apc_ns acknowledged = k < trajectory->n ? trajectory->at[k].t : INT64_MAX;
        if (acknowledged - raised <= x->time) {
            set_verdict(v, CHECK_HELD, acknowledged, NULL);
        } else if (last - raised >= x->time) {
            set_verdict(v, CHECK_FAILED, raised + x->time, NULL);
            return;
        } else if (v->is != CHECK_HELD) {
            check_say_unknown(v, "the run ends before its time is over");
        }
    }
}

/* ---- All of it ------------------------------------------------------------------------------ */

/* The points around what is told of. */
static void take_near(const struct check_trajectory *trajectory, struct check_verdict *v)
{
    size_t i = 0;
    while (i < trajectory->n && trajectory->at[i].t <= v->at)
        i++;
    i = i > CHECK_NEAR / 2 + 1 ? i - CHECK_NEAR / 2 - 1 : 0;
    for (; i < trajectory->n && v->n_near < CHECK_NEAR; i++)
        v->near[v->n_near++] = trajectory->at[i];
}

struct check_verdict check_judge(const struct expectation *x, const struct check_sources *sources,
                                 const struct check_trajectory *trajectories, apc_ns end)
{
    const struct check_trajectory *trajectory = &trajectories[x->trajectory];
    const struct pieces p = {
        .trajectory = trajectory, .horizon = sources->at[x->trajectory].horizon, .end = end};
    struct check_verdict v = {.is = CHECK_UNKNOWN, .value = (double)NAN, .closest = (double)NAN};

    switch (x->form) {
    case CHECK_NEVER:
    case CHECK_ALWAYS:
        judge_throughout(x, p, &v);
        break;
    case CHECK_WITHIN:
        judge_once(x, p, &v);
        break;
    case CHECK_AT:
        judge_at(x, p, &v);
        break;
    case CHECK_SETTLES:
        judge_settling(x, p, &trajectories[x->setpoint], &v);
        break;
    case CHECK_ACKNOWLEDGES:
        snprintf(v.why, sizeof v.why, "no alarm was raised");
        for (size_t i = 0; i < sources->n && v.is != CHECK_FAILED; i++)
            if (x->all ? sources->at[i].table == APC_ALARM : i == x->trajectory)
                judge_acknowledging(x, &trajectories[i], end, &v);
        break;
    }
    if (v.is != CHECK_HELD && x->form != CHECK_ACKNOWLEDGES)
        take_near(trajectory, &v);
    return v;
}

/* ---- In words ------------------------------------------------------------------------------- */

static void put_check_value(const struct expectation *x, const struct check_source *of, double value,
                            char *text, size_t size)
{
    const enum apc_alarm_state state = (enum apc_alarm_state)value;
    *text = '\0';
    if (isnan(value))
        return;
    if (x->kind == CHECK_ALARM)
        snprintf(text, size, "%s is %s", of->name,
                 apc_alarm_state_name(state) ? apc_alarm_state_name(state) : "in no state");
    else if (x->kind == CHECK_MODE)
        snprintf(text, size, "%s is %s", of->name,
                 apc_mode_name((int)value) ? apc_mode_name((int)value) : "in no mode");
    else
        snprintf(text, size, "%s%s = %.6g%s%s", of->plant ? "plant " : "", of->name, value,
                 *of->unit ? " " : "", of->unit);
}

static void put_check_unknown(const struct check_verdict *v, const struct check_source *of, const char *what,
                              char *text, size_t size)
{
    if (v->why[0])
        snprintf(text, size, "cannot be judged: %s", v->why);
    else if (v->until > v->at)
        snprintf(text, size, "cannot be judged: %s%s is not known from %.10g to %.10g s%s",
                 of->plant ? "plant " : "", of->name, apc_ns_to_s(v->at), apc_ns_to_s(v->until), what);
    else
        snprintf(text, size, "cannot be judged: %s%s is not known at %.10g s%s", of->plant ? "plant " : "",
                 of->name, apc_ns_to_s(v->at), what);
}

void check_words(const struct expectation *x, const struct check_verdict *v,
                 const struct check_sources *sources, char *text, size_t size)
{
    const struct check_source *of = &sources->at[x->trajectory];
    const bool throughout = x->form == CHECK_NEVER || x->form == CHECK_ALWAYS;
    const double at = apc_ns_to_s(v->at);
    char value[200];

    put_check_value(x, of, v->value, value, sizeof value);
    if (v->is == CHECK_UNKNOWN) {
        put_check_unknown(v, of, of->table == APC_SENSOR && !of->plant ? ": Bad, or no new value" : "", text,
                          size);
    } else if (throughout && v->is == CHECK_HELD && !isnan(v->closest)) {
        put_check_value(x, of, v->closest, value, sizeof value);
        snprintf(text, size, "at worst %s at %.10g s", value, apc_ns_to_s(v->closest_at));
    } else if (throughout && v->is == CHECK_HELD) {
        snprintf(text, size, "until %.10g s", at);
    } else if (x->form == CHECK_ACKNOWLEDGES) {
        snprintf(text, size, v->is == CHECK_HELD ? "at %.10g s" : "not yet at %.10g s", at);
    } else if (x->form == CHECK_SETTLES && (v->is == CHECK_HELD || v->at < x->until)) {
        snprintf(text, size, v->is == CHECK_HELD ? "at %.10g s" : "only at %.10g s, %s", at, value);
    } else if (x->form == CHECK_WITHIN && v->is == CHECK_FAILED && !isnan(v->closest)) {
        put_check_value(x, of, v->closest, value, sizeof value);
        snprintf(text, size, "not until %.10g s; at best %s at %.10g s", at, value,
                 apc_ns_to_s(v->closest_at));
    } else if (v->is == CHECK_HELD) {
        snprintf(text, size, "at %.10g s", at);
    } else {
        snprintf(text, size, "%s%sat %.10g s", value, *value ? " " : "", at);
    }
}

/* ---- Shares --------------------------------------------------------------------------------- */

/* Of @p n runs, each of which holds with @p share: the probability that @p held or more do. */
static double probability_of(unsigned held, unsigned n, double share)
{
    double sum = 0;
    for (unsigned k = held; k <= n; k++)
        sum += apc_exp(apc_lgamma(n + 1.0) - apc_lgamma(k + 1.0) - apc_lgamma(n - k + 1.0) +
                       k * apc_log(share) + (n - k) * apc_log(1 - share));
    return sum;
}

double check_share_least(unsigned held, unsigned n)
{
    double low = 0, high = 1;
    if (held == 0)
        return 0;
    for (int i = 0; i < 60; i++) {
        const double middle = (low + high) / 2;
        if (probability_of(held, n, middle) < 0.05)
            low = middle;
        else
            high = middle;
    }
    return low;
}

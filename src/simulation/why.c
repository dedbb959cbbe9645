/* SPDX-License-Identifier: BSD-3-Clause */
/*
 * The inputs of a tick stand in its row, as values or as seqs of rows on record. An input "as it was before" is
 * those elements of the row before the move, put into each row of the move. All else, the law's memory too, goes
 * its own way from there.
 */
#include "replay_internal.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "files/files.h"

/* The ticks of a move: those after `from` until `until`; the first that is computed for it; one as altered. */
struct move {
    struct replay *r;
    struct replay_controller *rc;
    size_t began, from, until;
    bool restarted; /* its controller was started anew within the move */
    double *row;
    double *u; /* [nu] that it put out at the tick before, as altered */
};

static const double *tick_of_move(const struct move *m, size_t k)
{
    return m->rc->ticks.value + m->rc->ticks.at[k].first;
}

/* ---- Inputs as they were before -------------------------------------------------------------- */

#define NONE APC_TICK_FIELDS

/* The fields that are held; those that say its value, its status and the seq of its row; and how far apart its
 * elements stand in those that are held, 0: all of them are its. Of a measurement its age, and that it is new,
 * stay: another value came at the same time. */
static const struct input {
    enum apc_tick_field held[2], value, status, seq;
    size_t stride;
} inputs[] = {
    [WHY_SETPOINT] = {{APC_TICK_WANTED, APC_TICK_PLAN}, APC_TICK_Z, NONE, APC_TICK_WANTED, 1},
    [WHY_MEASUREMENT] = {{APC_TICK_Y, APC_TICK_Y_STATUS}, APC_TICK_Y, APC_TICK_Y_STATUS, APC_TICK_Y_SEQ, 1},
    [WHY_DISTURBANCE] = {{APC_TICK_D, APC_TICK_D_STATUS}, APC_TICK_D, APC_TICK_D_STATUS, APC_TICK_D_SEQ, 1},
    [WHY_TUNING] = {{APC_TICK_TUNING_SEQ, NONE}, APC_TICK_TUNING, NONE, APC_TICK_TUNING_SEQ, 1},
    [WHY_MODE] = {{APC_TICK_WANTED, NONE}, APC_TICK_TARGET, NONE, APC_TICK_WANTED, 1},
    [WHY_MANUAL] = {{APC_TICK_WANTED, NONE}, APC_TICK_MANUAL, NONE, APC_TICK_WANTED, 1},
    [WHY_BELOW] = {{APC_TICK_BELOW, NONE}, NONE, NONE, NONE, 4},
    [WHY_ABOVE] = {{APC_TICK_ABOVE, NONE}, NONE, NONE, NONE, 1},
    [WHY_ACTING] = {{APC_TICK_PEER, APC_TICK_STATE}, NONE, NONE, NONE, 0},
    [WHY_LAW] = {{APC_TICK_RESULT, NONE}, NONE, NONE, NONE, 0},
};

/* Where its elements begin: in the field of what is wanted there are setpoints, target modes, manual outputs; of
 * what is below the mode of the loop. */
static size_t first_of(const struct apc_controller *c, enum why_kind kind, enum apc_tick_field field)
{
    const size_t modes = kind == WHY_MODE ? c->dim.nz : 0,
                 manual = kind == WHY_MANUAL ? c->dim.nz + c->dim.nu : 0;
    return c->offset[field] + (field == APC_TICK_WANTED ? modes + manual : field == APC_TICK_BELOW ? 2 : 0);
}

/* Its elements of a field that is held: how many, and from where on in a row. */
static size_t held_elements(const struct apc_controller *c, const struct why_cause *cause, size_t which,
                            size_t *first)
{
    const struct input *in = &inputs[cause->kind];
    const enum apc_tick_field field = in->held[which];
    if (field == NONE || c->offset[field] == c->offset[field + 1])
        return 0;
    *first = first_of(c, cause->kind, field) + in->stride * cause->element;
    return in->stride ? 1 : c->offset[field + 1] - c->offset[field];
}

static bool is_shadow(const struct apc_controller *c, const double *row)
{
    return row[c->offset[APC_TICK_STATE]] == (double)APC_LOOP_SHADOW;
}

/* What is in force below output @p i, which goes to somebody, as it was at the tick of @p row; NULL: nothing is. */
static const struct apc_sample *in_force(const struct move *m, size_t i, const double *row)
{
    const struct apc_controller *c = m->rc->core;
    const struct apc_sample *actual = c->below[i].actual;
    return replay_sample(m->r, actual->table, actual->id,
                         (int64_t)row[c->offset[APC_TICK_BELOW] + 4 * i + 1]);
}

/* Does the loop follow what is in force below, which does not take its output? */
static bool follows_below(const struct apc_controller *c, size_t i, const double *row)
{
    return row[c->offset[APC_TICK_STATE] + i] == (double)APC_LOOP_INIT;
}

static const struct apc_sample *newest_output(const struct move *m, size_t i, const double *row)
{
    const struct apc_controller *c = m->rc->core;
    const struct apc_sample *output = apc_controller_output(c, i);
    return replay_sample(m->r, output->table, output->id, (int64_t)row[c->offset[APC_TICK_BELOW] + 4 * i]);
}

/* That its own output has come into force is no news: somebody else's has, or what takes it says otherwise. */
static bool differs_below(const struct move *m, size_t i, size_t k, const double *former)
{
    const struct apc_controller *c = m->rc->core;
    const size_t mode = c->offset[APC_TICK_BELOW] + 4 * i + 2;
    const double *row = tick_of_move(m, k), own = tick_of_move(m, k - 1)[c->offset[APC_TICK_U] + i];
    const struct apc_sample *was = in_force(m, i, former), *is = in_force(m, i, row),
                            *newest = newest_output(m, i, row);
    return row[mode] < former[mode] || row[mode] > former[mode] || !was != !is ||
           (newest && newest->value != own) ||
           (is && (is->status != was->status || (follows_below(c, i, row) && is->value != was->value)));
}

static void hold_below(const struct move *m, size_t i, const double *former)
{
    const struct apc_controller *c = m->rc->core;
    struct apc_sample *actual = c->below[i].actual,
                      *newest = &c->in.sample[c->dim.ny + c->dim.nd + c->n_wanted + i];
    const struct apc_sample *was = in_force(m, i, former);
    newest->value = m->u[i];
    actual->value = was && follows_below(c, i, former) ? was->value : m->u[i];
    actual->status = was ? was->status : APC_BAD_NO_DATA;
}

static bool has_no_answer(double result)
{
    return (int)result == APC_LAW_LATE || (int)result == APC_LAW_FAILED;
}

/* At tick @p k, from the row before the move. */
static bool cause_differs(const struct move *m, const struct why_cause *cause, size_t k)
{
    const struct apc_controller *c = m->rc->core;
    const double *row = tick_of_move(m, k), *former = tick_of_move(m, m->from);
    size_t at, n;
    if (cause->kind == WHY_ACTING)
        return is_shadow(c, row) != is_shadow(c, former);
    if (cause->kind == WHY_BELOW && !c->below[cause->element].actual)
        return false;
    if (cause->kind == WHY_BELOW)
        return differs_below(m, cause->element, k, former);
    for (size_t f = 0; f < 2; f++)
        for (n = held_elements(c, cause, f, &at); n > 0; n--, at++)
            if (cause->kind == WHY_LAW ? has_no_answer(row[at]) != has_no_answer(former[at])
                                       : !replay_same_bits(row[at], former[at]))
                return true;
    return false;
}

static void hold_input(const struct move *m, const struct why_cause *cause, const double *former, double *row)
{
    size_t at = 0;
    for (size_t f = 0; f < 2; f++) {
        const size_t n = held_elements(m->rc->core, cause, f, &at);
        memcpy(row + at, former + at, n * sizeof *row);
    }
}

/* ---- The move again -------------------------------------------------------------------------- */

static void replace_echo(struct apc_sample *sample, double recorded, double altered)
{
    if (sample && sample->seq > 0 && sample->value == recorded)
        sample->value = altered;
}

/* Where the controller reads back what went out of it, that is now what the altered one put out. */
static void echo_outputs(const struct move *m, const double *before)
{
    struct apc_controller *c = m->rc->core;
    for (size_t i = 0; i < c->dim.nu; i++) {
        const double recorded = before[c->offset[APC_TICK_U] + i];
        replace_echo(&c->in.sample[c->dim.ny + c->dim.nd + c->n_wanted + i], recorded, m->u[i]);
        replace_echo(c->below[i].actual, recorded, m->u[i]);
    }
}

/* Tick @p k did not come out of its record, as @p text says. Does it of a controller that was started anew? */
static int try_restart(struct move *m, size_t k, const char *text)
{
    struct replay_controller *rc = m->rc;
    const struct tick_row *at = &rc->ticks.at[k];
    const double *recorded = tick_of_move(m, k);
    struct apc_notice notice;
    char time[APC_TIME_LEN];
    const int err = replay_start_controller(m->r, rc, at - 1, at[-1].time);
    if (err < 0)
        return err;
    (void)replay_give_tick(m->r, rc, at, recorded);
    replay_compute_tick(rc, recorded, &notice);
    m->restarted = replay_is_made(rc->core, recorded);
    if (!m->restarted)
        return apc_fail(&m->r->why, APC_ESTATE, "%s", text);
    return apc_fail(&m->r->why, APC_ESTATE,
                    "%s was started anew before its tick at %s: the move over that is not explained, what is "
                    "before and behind it is: ask over a shorter time",
                    rc->of->name, replay_time(m->r, at->time, time));
}

/* Compute it with @p n of the causes as they were before; without any, all of each row has to come out, or the
 * answer is APC_ESTATE. The controller is then at its last tick. */
static int compute_move(struct move *m, const struct why_cause *cause, size_t n)
{
    struct replay_controller *rc = m->rc;
    const struct tick_row *former = m->began > 0 ? &rc->ticks.at[m->began - 1] : NULL;
    struct apc_notice notice;
    int err = replay_start_controller(m->r, rc, former, former ? former->time : m->r->start - 1);
    if (err < 0)
        return err;
    rc->row = former ? tick_of_move(m, m->began - 1) : NULL;
    if (former)
        memcpy(m->u, rc->row + rc->core->offset[APC_TICK_U], rc->core->dim.nu * sizeof *m->u);
    rc->now = (struct apc_now){.mono = APC_NS_PER_S, .utc = former ? former->time : 0};
    for (size_t k = m->began; k <= m->until; k++) {
        const struct tick_row *at = &rc->ticks.at[k];
        const double *recorded = tick_of_move(m, k);
        if (m->r->give_up > 0 && apc_clock_mono(NULL) > m->r->give_up)
            return apc_fail(
                &m->r->why, APC_ETIMEDOUT,
                "to compute it takes too long for the page: apc why on the command line takes its time");
        memcpy(m->row, recorded, at->n * sizeof *m->row);
        for (size_t i = 0; i < n && k > m->from; i++)
            hold_input(m, &cause[i], tick_of_move(m, m->from), m->row);
        const struct apc_sample *missing = replay_give_tick(m->r, rc, at, m->row);
        if (n > 0 && k > m->from + 1)
            echo_outputs(m, tick_of_move(m, k - 1));
        for (size_t i = 0; i < n && k > m->from; i++)
            if (cause[i].kind == WHY_BELOW)
                hold_below(m, cause[i].element, tick_of_move(m, m->from));
        replay_compute_tick(rc, m->row, &notice);
        memcpy(m->u, rc->core->u, rc->core->dim.nu * sizeof *m->u);
        if (n == 0 && k > m->from && !replay_is_made(rc->core, recorded)) {
            char text[REPLAY_TEXT] = "";
            replay_tell_difference(m->r, rc, at, recorded, missing, text);
            return k > m->began && !missing ? try_restart(m, k, text)
                                            : apc_fail(&m->r->why, APC_ESTATE, "%s", text);
        }
        if (k < m->until)
            replay_end_tick(rc, at, recorded);
    }
    return 0;
}

/* Are so many ticks before those of the move, and as many again, of the law that it has now? */
static bool is_of_law(const struct move *m, size_t lead)
{
    const size_t wanted = 2 * lead + 1, first = m->from + 1 > wanted ? m->from + 1 - wanted : 0;
    for (size_t k = first > 0 ? first - 1 : 0; k < m->began; k++)
        if (m->rc->ticks.at[k].n != m->rc->core->out_row->n)
            return false;
    return true;
}

/* A row has all that its controller goes on from; but what a store, or a law, keeps beside it may have been
 * there before. So it is begun earlier until the move comes out. */
static int find_beginning(struct move *m)
{
    int rc;
    for (size_t lead = 0;; lead = 2 * lead + 1) {
        m->began = m->from + 1 > lead ? m->from + 1 - lead : 0;
        rc = compute_move(m, NULL, 0);
        if (rc != APC_ESTATE || m->began == 0 || m->restarted || !is_of_law(m, lead))
            return rc;
    }
}

/* ---- Causes ---------------------------------------------------------------------------------- */

static const struct apc_tag *tag_of(const struct replay *r, const struct apc_sample *variable)
{
    for (size_t i = 0; i < r->n_tags; i++)
        if (r->tags[i].table == variable->table && r->tags[i].id == variable->id)
            return &r->tags[i];
    return NULL;
}

static const struct apc_tag *output_tag(const struct replay *r, const struct replay_controller *by, size_t i)
{
    const struct loops_loop *loop = &r->loops.at[(size_t)by->of->first_loop - 1 + i];
    return tag_of(r, &(struct apc_sample){.table = loop->table, .id = loop->output});
}

/* Of the samples that its controller reads; NULL: it is none. */
static const struct apc_sample *input_variable(const struct apc_controller *c, const struct why_cause *cause)
{
    const size_t wanted = c->dim.ny + c->dim.nd;
    switch (cause->kind) {
    case WHY_MEASUREMENT:
        return &c->in.sample[cause->element];
    case WHY_DISTURBANCE:
        return &c->in.sample[c->dim.ny + cause->element];
    case WHY_SETPOINT:
    case WHY_ABOVE:
        return &c->in.sample[wanted + cause->element];
    case WHY_MODE:
        return &c->in.sample[wanted + c->dim.nz + cause->element];
    case WHY_MANUAL:
        return &c->in.sample[wanted + c->dim.nz + c->dim.nu + cause->element];
    case WHY_TUNING:
        return &c->in.sample[wanted + c->dim.nz + 2 * c->dim.nu + cause->element];
    case WHY_BELOW:
        return &c->in.sample[wanted + c->n_wanted + cause->element];
    case WHY_ACTING:
    case WHY_LAW:
        break;
    }
    return NULL;
}

static double input_element(const struct apc_controller *c, const struct why_cause *cause,
                            enum apc_tick_field field, const double *row)
{
    return field == NONE ? (double)NAN : row[first_of(c, cause->kind, field) + cause->element];
}

static void describe_cause(const struct move *m, struct why_cause *cause)
{
    const struct apc_controller *c = m->rc->core;
    const double *row = tick_of_move(m, m->until), *former = tick_of_move(m, m->from);
    const struct input *in = &inputs[cause->kind];
    const struct apc_sample *variable = input_variable(c, cause);
    cause->tag = variable ? tag_of(m->r, variable) : NULL;
    if (cause->kind == WHY_MANUAL)
        cause->moves = output_tag(m->r, m->rc, cause->element);
    cause->before = input_element(c, cause, in->value, former);
    cause->now = input_element(c, cause, in->value, row);
    if (in->status != NONE) {
        cause->status_before = (apc_status)input_element(c, cause, in->status, former);
        cause->status = (apc_status)input_element(c, cause, in->status, row);
    }
    if (cause->kind == WHY_BELOW) {
        const struct apc_sample *was = in_force(m, cause->element, former),
                                *is = in_force(m, cause->element, row);
        cause->status_before = was ? was->status : APC_BAD_NO_DATA;
        cause->status = is ? is->status : APC_BAD_NO_DATA;
        cause->before = was ? was->value : (double)NAN;
        cause->now = is ? is->value : (double)NAN;
        cause->row = is;
    }
    if (variable && in->seq != NONE)
        cause->row = replay_sample(m->r, variable->table, variable->id,
                                   (int64_t)input_element(c, cause, in->seq, row));
}

/* Those that differ at a tick of the move from what they were before it. */
static int find_causes(const struct move *m, struct why *w)
{
    const struct apc_controller *c = m->rc->core;
    const struct {
        enum why_kind kind;
        size_t n;
    } of[] = {{WHY_SETPOINT, c->dim.nz},       {WHY_MEASUREMENT, c->dim.ny},
              {WHY_DISTURBANCE, c->dim.nd},    {WHY_TUNING, c->size.tuning},
              {WHY_MODE, c->dim.nu},           {WHY_MANUAL, c->dim.nu},
              {WHY_BELOW, c->dim.nu},          {WHY_ABOVE, c->dim.nz},
              {WHY_ACTING, c->choice ? 1 : 0}, {WHY_LAW, 1}};
    size_t room = 0;
    for (size_t i = 0; i < sizeof of / sizeof *of; i++)
        room += of[i].n;
    w->cause = calloc(room, sizeof *w->cause);
    if (!w->cause)
        return APC_ENOMEM;
    for (size_t i = 0; i < sizeof of / sizeof *of; i++)
        for (size_t e = 0; e < of[i].n; e++) {
            const struct why_cause cause = {.kind = of[i].kind, .element = e};
            bool changed = false;
            for (size_t k = m->from + 1; k <= m->until && !changed; k++)
                changed = cause_differs(m, &cause, k);
            if (!changed)
                continue;
            w->cause[w->n] = cause;
            describe_cause(m, &w->cause[w->n++]);
        }
    return 0;
}

/* It stands in the row itself, else in a row that that names. */
static bool is_in_row(enum why_kind kind)
{
    return kind == WHY_MEASUREMENT || kind == WHY_DISTURBANCE;
}

/* At a limit each of several may take all of a move back: what was changed then comes before what was measured. */
static int by_effect(const void *left, const void *right)
{
    const struct why_cause *a = left, *b = right;
    const double x = fabs(a->effect), y = fabs(b->effect);
    if (x > y || x < y)
        return x > y ? -1 : 1;
    if (is_in_row(a->kind) != is_in_row(b->kind))
        return is_in_row(b->kind) ? -1 : 1;
    if (a->kind != b->kind)
        return a->kind < b->kind ? -1 : 1;
    return a->element < b->element ? -1 : a->element > b->element;
}

static int try_causes(struct move *m, struct why *w)
{
    double sum = 0;
    int rc = w->n > 0 ? compute_move(m, w->cause, w->n) : 0;
    if (rc < 0)
        return rc;
    w->earlier = m->rc->core->u[w->element] - w->u_before;
    for (size_t i = 0; i < w->n; i++) {
        if ((rc = compute_move(m, &w->cause[i], 1)) < 0)
            return rc;
        w->cause[i].effect = w->u - m->rc->core->u[w->element];
        sum += w->cause[i].effect;
    }
    w->together = w->u - w->u_before - w->earlier - sum;
    qsort(w->cause, w->n, sizeof *w->cause, by_effect);
    return 0;
}

/* Compute tick @p k alone, which goes on from the row before it. Did it come out? */
static bool compute_tick_alone(const struct move *m, size_t k)
{
    struct replay_controller *rc = m->rc;
    struct apc_notice notice;
    if (k == 0 || rc->ticks.at[k - 1].n != rc->core->out_row->n ||
        replay_start_controller(m->r, rc, &rc->ticks.at[k - 1], rc->ticks.at[k - 1].time) < 0)
        return false;
    rc->row = tick_of_move(m, k - 1);
    rc->now = (struct apc_now){.mono = APC_NS_PER_S, .utc = rc->ticks.at[k - 1].time};
    (void)replay_give_tick(m->r, rc, &rc->ticks.at[k], tick_of_move(m, k));
    replay_compute_tick(rc, tick_of_move(m, k), &notice);
    return replay_is_made(rc->core, tick_of_move(m, k));
}

static struct why_term *term_of(struct why *w, const struct apc_law_term *term)
{
    const char *of = term->of ? term->of : "";
    size_t i = 0;
    while (i < w->n_terms && (strcmp(w->term[i].name, term->name) != 0 || strcmp(w->term[i].of, of) != 0))
        i++;
    if (i == w->n_terms) {
        w->term[w->n_terms++] =
            (struct why_term){.name = term->name, .before = (double)NAN, .now = (double)NAN};
        snprintf(w->term[i].of, sizeof w->term[i].of, "%s", of);
    }
    return &w->term[i];
}

/* The terms of the law at tick @p k, which is the one @p now or that before. */
static int take_terms(const struct move *m, struct why *w, size_t k, bool now)
{
    struct apc_controller *core = compute_tick_alone(m, k) ? m->rc->core : NULL;
    const size_t n = core ? apc_controller_terms(core, w->element, NULL, 0) : 0;
    struct apc_law_term *term = calloc(n + 1, sizeof *term);
    struct why_term *all = realloc(w->term, (w->n_terms + n + 1) * sizeof *all);
    if (all)
        w->term = all;
    if (term && all && n > 0)
        (void)apc_controller_terms(core, w->element, term, n);
    for (size_t i = 0; term && all && i < n; i++) {
        struct why_term *to = term_of(w, &term[i]);
        *(now ? &to->now : &to->before) = term[i].value;
    }
    free(term);
    return term && all ? 0 : APC_ENOMEM;
}

static bool is_naught(double value)
{
    return value == 0 || isnan(value);
}

static int find_terms(const struct move *m, struct why *w)
{
    int rc = take_terms(m, w, m->from, false);
    size_t n = 0;
    if (rc == 0)
        rc = take_terms(m, w, m->until, true);
    for (size_t i = 0; i < w->n_terms; i++)
        if (!w->term[i].of[0] || !is_naught(w->term[i].before) || !is_naught(w->term[i].now))
            w->term[n++] = w->term[i];
    w->n_terms = n;
    return rc;
}

/* ---- A tick that differs ---------------------------------------------------------------------- */

/* Tick m->until, with these causes as the other of the two says. Does all of it come out? */
static int compute_put_right(struct move *m, const struct why_cause *cause, size_t n, bool *made)
{
    struct replay_controller *rc = m->rc;
    const struct tick_row *former = m->from < m->until ? &rc->ticks.at[m->from] : NULL;
    struct apc_notice notice;
    int err = replay_start_controller(m->r, rc, former, former ? former->time : m->r->start - 1);
    rc->row = former ? tick_of_move(m, m->from) : NULL;
    rc->now = (struct apc_now){.mono = APC_NS_PER_S, .utc = former ? former->time : 0};
    for (size_t k = former ? m->from + 1 : m->until; k <= m->until && err == 0; k++) {
        const struct tick_row *at = &rc->ticks.at[k];
        struct apc_controller *c = rc->core;
        memcpy(m->row, tick_of_move(m, k), at->n * sizeof *m->row);
        for (size_t i = 0; i < n && k == m->until; i++)
            if (is_in_row(cause[i].kind))
                m->row[first_of(c, cause[i].kind, inputs[cause[i].kind].value) + cause[i].element] =
                    cause[i].before;
        (void)replay_give_tick(m->r, rc, at, m->row);
        for (size_t i = 0; i < n && k == m->until; i++)
            if (!is_in_row(cause[i].kind))
                c->in.sample[input_variable(c, &cause[i]) - c->in.sample].value = cause[i].before;
        replay_compute_tick(rc, m->row, &notice);
        *made = replay_is_made(c, m->row);
        if (k < m->until) {
            replay_end_tick(rc, at, tick_of_move(m, k));
            err = *made ? 0 : replay_start_controller(m->r, rc, at, at->time);
        }
    }
    return err;
}

/* before: what would be right; now: what the tick was computed with. Of an input that is at odds with its own row. */
static bool is_at_odds(const struct move *m, struct why_cause *cause)
{
    const struct apc_controller *c = m->rc->core;
    const struct apc_sample *variable = input_variable(c, cause);
    const struct input *in = &inputs[cause->kind];
    const double *row = tick_of_move(m, m->until);
    const int64_t seq = (int64_t)input_element(c, cause, in->seq, row);
    const struct apc_sample *named =
        variable && seq > 0 ? replay_named(m->r, variable->table, variable->id, seq) : NULL;
    if (!named)
        return false;
    const double value = input_element(c, cause, in->value, row);
    cause->tag = tag_of(m->r, variable);
    cause->before = is_in_row(cause->kind) ? named->value : value;
    cause->now = is_in_row(cause->kind) ? value : named->value;
    return !replay_same_bits(cause->before, cause->now);
}

static int add_at_odds(struct differs *d, const struct why_cause *cause)
{
    struct differs_cause *to = differs_add(d);
    if (!to)
        return APC_ENOMEM;
    to->kind = why_kind_name(cause->kind);
    snprintf(to->name, sizeof to->name, "%s", cause->tag ? cause->tag->name : "");
    to->recorded = cause->before;
    to->replayed = cause->now;
    to->effect = cause->effect;
    return 0;
}

/* The one that alone makes it come out, or all of them. */
static int put_right(struct move *m, struct differs *d, struct why_cause *cause, size_t n, size_t element)
{
    bool made = false;
    int rc = 0;
    for (size_t i = 0; i < n && rc == 0 && !made; i++) {
        rc = compute_put_right(m, &cause[i], 1, &made);
        cause[i].effect = d->replayed - m->rc->core->u[element];
        if (rc == 0 && made)
            return add_at_odds(d, &cause[i]);
    }
    if (n > 1 && rc == 0)
        rc = compute_put_right(m, cause, n, &made);
    for (size_t i = 0; i < n && rc == 0 && made; i++)
        rc = add_at_odds(d, &cause[i]);
    return rc;
}

static int find_at_odds(struct move *m, struct differs *d, size_t element)
{
    const struct apc_controller *c = m->rc->core;
    const struct {
        enum why_kind kind;
        size_t n;
    } of[] = {{WHY_MEASUREMENT, c->dim.ny}, {WHY_DISTURBANCE, c->dim.nd}, {WHY_SETPOINT, c->dim.nz},
              {WHY_TUNING, c->size.tuning}, {WHY_MODE, c->dim.nu},        {WHY_MANUAL, c->dim.nu}};
    size_t n = 0;
    struct why_cause *cause =
        calloc(c->dim.ny + c->dim.nd + c->dim.nz + c->size.tuning + 2 * c->dim.nu, sizeof *cause);
    if (!cause)
        return APC_ENOMEM;
    for (size_t i = 0; i < sizeof of / sizeof *of; i++)
        for (size_t e = 0; e < of[i].n; e++) {
            cause[n] = (struct why_cause){.kind = of[i].kind, .element = e};
            n += is_at_odds(m, &cause[n]);
        }
    const int rc = put_right(m, d, cause, n, element);
    free(cause);
    return rc;
}

/* Those before it as of its own law, which is tried in the place of one whose mark no description has. */
static bool take_marks(const struct move *m)
{
    const struct apc_controller *c = m->rc->core;
    const size_t at = c->offset[APC_TICK_MARK];
    const double *row = tick_of_move(m, m->until);
    const bool foreign = !replay_same_bits(row[at], c->mark[0]) || !replay_same_bits(row[at + 1], c->mark[1]);
    for (size_t k = m->from; k <= m->until && foreign; k++)
        memcpy(m->rc->ticks.value + m->rc->ticks.at[k].first + at, c->mark, sizeof c->mark);
    return foreign;
}

static int compare_put_right(struct move *m, struct differs *d)
{
    const struct replay_controller *rc = m->rc;
    const double *row = tick_of_move(m, m->until);
    const bool foreign = take_marks(m);
    size_t element = 0;
    bool made = false;
    int err = compute_put_right(m, NULL, 0, &made);
    if (err < 0)
        return err;
    const struct apc_controller *c = rc->core;
    while (element < c->dim.nu && replay_same_bits(row[c->offset[APC_TICK_U] + element], c->u[element]))
        element++;
    if (element < c->dim.nu)
        snprintf(d->output, sizeof d->output, "%s",
                 m->r->loops.at[(size_t)rc->of->first_loop - 1 + element].name);
    else
        element = 0;
    d->recorded = row[c->offset[APC_TICK_U] + element];
    d->replayed = c->u[element];
    err = differs_take_terms(d, rc, element, false);
    if (err == 0 && !made)
        err = find_at_odds(m, d, element);
    if (err == 0 && foreign && made)
        snprintf(d->unknown, sizeof d->unknown,
                 "from the same inputs its law gives the same: it was compiled again, or has a setting that "
                 "moves nothing there");
    else if (err == 0 && d->n == 0)
        snprintf(d->unknown, sizeof d->unknown,
                 "all rows that it names are as it has them: %s, or its own row was altered",
                 foreign ? "its law was compiled again and computes otherwise, or has another setting"
                         : "another build of the law made it");
    return err;
}

int why_differs(struct differs *d, struct replay *r, struct replay_controller *rc, size_t k)
{
    struct move m = {.r = r, .rc = rc, .from = k, .until = k};
    while (m.from > 0 && rc->ticks.at[m.from - 1].n == rc->core->out_row->n)
        m.from--;
    if (rc->ticks.at[k].n != rc->core->out_row->n) {
        snprintf(
            d->unknown, sizeof d->unknown,
            "its row has %zu values and not %u: another law made it, or one with other settings or signals",
            rc->ticks.at[k].n, rc->core->out_row->n);
        return 0;
    }
    m.row = calloc(rc->core->out_row->n, sizeof *m.row);
    const int err = m.row ? compare_put_right(&m, d) : APC_ENOMEM;
    free(m.row);
    return err;
}

/* ---- A loop's move --------------------------------------------------------------------------- */

/* The loop's controller; NULL: it has none of that name. */
static struct replay_controller *find_moved_loop(struct why *w, struct replay *r, const char *name,
                                                 struct apc_error *why)
{
    struct nearest nearest = {.wanted = name};
    const char *within = NULL; /* the loop that is called so within its controller */
    for (size_t i = 0; i < r->loops.n; i++) {
        const struct loops_loop *loop = &r->loops.at[i];
        const char *dot = strrchr(loop->name, '.');
        if (dot && strcmp(dot + 1, name) == 0)
            within = loop->name;
        nearest_look(&nearest, loop->name);
        if (strcmp(loop->name, name) != 0)
            continue;
        w->by = &r->controller[loop->controller];
        w->loop = loop->name;
        w->element = i + 1 - (size_t)w->by->of->first_loop;
        w->output = output_tag(r, w->by, w->element);
        return &r->controller[loop->controller];
    }
    const char *meant = within ? within : nearest.name;
    apc_fail(why, APC_ENOTFOUND, "there is no loop \"%s\"%s%s%s", name, meant ? ": did you mean \"" : "",
             meant ? meant : "", meant ? "\"?" : "");
    return NULL;
}

/* The last tick that is not younger; n: there is none. */
static size_t last_tick(const struct ticks *ticks, apc_ns time)
{
    size_t n = ticks->n;
    while (n > 0 && ticks->at[n - 1].time > time)
        n--;
    return n > 0 ? n - 1 : ticks->n;
}

static int find_ticks(struct move *m, struct why *w, apc_ns from, apc_ns until, struct apc_error *why)
{
    const struct ticks *ticks = &m->rc->ticks;
    char time[APC_TIME_LEN];
    m->until = last_tick(ticks, until);
    if (m->rc->first > m->rc->last)
        return apc_fail(why, APC_ENOTFOUND, "%s has no tick on record", w->loop);
    if (m->until == ticks->n)
        return apc_fail(why, APC_ENOTFOUND, "%s has no tick until then on record: the first is at %s",
                        w->loop, replay_time(m->r, m->rc->first, time));
    if (m->until == 0)
        return apc_fail(why, APC_ENOTFOUND,
                        "%s: no tick before it is on record: there is nothing to compare with", w->loop);
    w->tick = &ticks->at[m->until];
    if (until > m->rc->last) /* a time behind the record is its end */
        from -= until - w->tick->time;
    apc_ns left = w->tick->time - from;
    m->from = m->until;
    while (m->from > 0 && (left > 0 || m->from == m->until))
        left -= replay_time_between(m->rc, m->from--);
    w->cut = left > 0;
    return 0;
}

/* What the rows say of the loop. A move begins where something goes out. */
static int read_loop(struct move *m, struct why *w, struct apc_error *why)
{
    const struct apc_controller *c = m->rc->core;
    const size_t *at = c->offset, i = w->element;
    for (size_t k = m->from; k <= m->until; k++)
        if (m->rc->ticks.at[k].n != c->out_row->n)
            return apc_fail(why, APC_EPROTO, "%s: its law, its settings or its model are not those that ran",
                            m->rc->of->name);
    while (m->from + 1 < m->until && !(tick_of_move(m, m->from)[at[APC_TICK_THERE] + i] > 0))
        m->from++;
    w->cut = w->cut && tick_of_move(m, 0)[at[APC_TICK_INDEX]] > 0;
    w->before = &m->rc->ticks.at[m->from];
    const double *row = tick_of_move(m, m->until), *former = tick_of_move(m, m->from);
    w->u_before = former[at[APC_TICK_U] + i];
    w->u = row[at[APC_TICK_U] + i];
    w->state_before = (enum apc_loop_state)former[at[APC_TICK_STATE] + i];
    w->state = (enum apc_loop_state)row[at[APC_TICK_STATE] + i];
    w->blocked = (unsigned)row[at[APC_TICK_BLOCKED] + i];
    w->low = c->low[i];
    w->high = c->high[i];
    return row[at[APC_TICK_THERE] + i] > 0 && former[at[APC_TICK_THERE] + i] > 0
               ? 0
               : apc_fail(why, APC_ENOTFOUND, "%s: nothing went out yet", w->loop);
}

int why_find(struct why *w, struct replay *r, const char *loop, apc_ns from, apc_ns until,
             struct apc_error *why)
{
    *w = (struct why){0};
    struct move m = {.r = r, .rc = find_moved_loop(w, r, loop, why)};
    if (!m.rc)
        return APC_ENOTFOUND;
    int rc = find_ticks(&m, w, from, until, why);
    if (rc < 0)
        return rc;
    if ((rc = replay_start_controller(r, m.rc, NULL, r->start - 1)) < 0) {
        *why = r->why;
        return rc;
    }
    if ((rc = read_loop(&m, w, why)) < 0)
        return rc;
    m.row = calloc(m.rc->core->out_row->n + m.rc->core->dim.nu, sizeof *m.row);
    m.u = m.row ? m.row + m.rc->core->out_row->n : NULL;
    rc = m.row ? find_beginning(&m) : APC_ENOMEM;
    w->lead = m.from + 1 - m.began;
    w->restarted = m.restarted;
    if (rc == 0) {
        const struct apc_controller_state *now = &m.rc->core->state[w->element];
        w->limited = m.rc->core->law.limited[w->element];
        snprintf(w->reason, sizeof w->reason, "%s",
                 now->trouble[0] && now->move.reason ? now->trouble
                 : now->move.reason                  ? now->move.reason
                                                     : "");
        rc = find_causes(&m, w);
    }
    if (rc == 0)
        rc = try_causes(&m, w);
    if (rc == 0)
        rc = find_terms(&m, w);
    free(m.row);
    if (rc < 0)
        apc_fail(why, rc, "%s", rc == APC_ENOMEM ? "out of memory" : r->why.text);
    return rc;
}

const char *why_above(const struct replay *r, const struct why_cause *cause)
{
    if (cause->kind != WHY_SETPOINT || !cause->row || cause->row->origin <= 0)
        return NULL;
    for (size_t i = 0; i < r->loops.n; i++) {
        const struct loops_loop *loop = &r->loops.at[i];
        const struct ticks *ticks = &r->controller[loop->controller].ticks;
        const size_t at = last_tick(ticks, cause->row->time);
        if (loop->table == APC_SETPOINT && loop->output == cause->row->id && at < ticks->n &&
            ticks->at[at].time == cause->row->time)
            return loop->name;
    }
    return NULL;
}

void why_free(struct why *w)
{
    free(w->cause);
    free(w->term);
    *w = (struct why){0};
}

/* SPDX-License-Identifier: BSD-3-Clause */
/*
 * A period of ticks as steps in the order of time. At one instant, as in a run: the plant moves and is
 * disturbed, is sampled, takes its input; then controllers compute, those above before those below.
 */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "analyze/analyze_internal.h"
#include "apclinear.h"
#include "base/base_internal.h"

/* ---- Steps ----------------------------------------------------------------------------------- */

struct sorted {
    struct step step;
    int rank;
    size_t order;
};

static int by_step_time(const void *a, const void *b)
{
    const struct sorted *x = a, *y = b;

    if (x->step.at != y->step.at)
        return x->step.at < y->step.at ? -1 : 1;
    if (x->rank != y->rank)
        return x->rank - y->rank;
    return x->order < y->order ? -1 : x->order > y->order;
}

/* The tick of the same controller after @p k; *@p turn grows where the period begins anew. */
static size_t next_of(const struct schedule *c, size_t k, apc_ns *turn)
{
    const size_t controller = c->tick[k].controller;

    do {
        if (++k == c->n) {
            k = 0;
            *turn += c->period;
        }
    } while (c->tick[k].controller != controller);
    return k;
}

/* How many samples come between the one of tick @p k and its computing. */
static size_t sample_age(const struct schedule *c, size_t k)
{
    apc_ns turn = 0, last = c->tick[k].sampled;
    size_t age = 0, j = next_of(c, k, &turn);

    for (; c->tick[j].sampled + turn <= c->tick[k].computed; j = next_of(c, j, &turn)) {
        age += c->tick[j].sampled + turn > last;
        last = c->tick[j].sampled + turn;
    }
    return age;
}

/* How often the controller has computed again when what it made at tick @p k acts at @p at. */
static size_t act_age(const struct schedule *c, size_t k, apc_ns at)
{
    apc_ns turn = 0;
    size_t age = 0, j = next_of(c, k, &turn);

    for (; c->tick[j].computed + turn < at; j = next_of(c, j, &turn))
        age++;
    return age;
}

/* Is the measurement that of the tick before? */
static bool is_sampled_in_former_tick(const struct schedule *c, size_t k)
{
    apc_ns turn = 0;
    size_t j = k;

    do {
        turn -= j == 0 ? c->period : 0;
        j = j == 0 ? c->n - 1 : j - 1;
    } while (c->tick[j].controller != c->tick[k].controller);
    return c->tick[j].sampled + turn == c->tick[k].sampled;
}

static void wrap(struct step *step, apc_ns period)
{
    apc_ns turns = step->at / period;

    turns -= step->at < turns * period;
    step->at -= turns * period;
    step->tick -= turns * period;
}

static size_t add_loop_step(struct sorted *to, size_t n, enum step_kind kind, size_t number, size_t age,
                            apc_ns at, size_t order)
{
    static const int rank[] = {[STEP_KICK] = 0, [STEP_SAMPLE] = 1, [STEP_ACT] = 2, [STEP_COMPUTE] = 3};

    to[n] = (struct sorted){{kind, number, age, at, 0}, rank[kind], order};
    return n + 1;
}

static size_t list_tick(const struct apc_loop *l, const struct schedule *c, size_t k, struct sorted *to,
                        size_t n)
{
    const struct apc_loop_tick *t = &c->tick[k];
    const size_t outputs = l->setup.controller[t->controller].nu;

    if (!is_sampled_in_former_tick(c, k))
        n = add_loop_step(to, n, STEP_SAMPLE, t->controller, 0, t->sampled, k);
    n = add_loop_step(to, n, STEP_COMPUTE, t->controller, sample_age(c, k), t->computed, 2 * k);
    for (size_t o = l->first[t->controller]; o < l->first[t->controller] + outputs; o++) {
        const bool nowhere = l->to[o] == APC_LOOP_NOWHERE;
        apc_ns at = nowhere ? t->written : t->acts, delay = 0;

        if (at == INT64_MAX)
            continue;
        if (c->delay)
            (void)apc_ns_from_s(c->delay[o], &delay);
        at += (nowhere ? 0 : l->setup.plant.dead_time) + delay;
        n = add_loop_step(to, n, STEP_ACT, o, act_age(c, k, at), at, 2 * k + 1);
        to[n - 1].step.tick = t->computed;
        if (nowhere || at == t->computed)
            to[n - 1].rank = 3;
    }
    return n;
}

/* ---- Rows ------------------------------------------------------------------------------------ */

static void lay_out_machine(struct machine *m)
{
    const struct apc_loop *l = m->loop;

    m->n = l->setup.plant.nx + l->n_out;
    for (size_t i = 0; i < m->n_steps; i++) {
        const struct step *s = &m->step[i];
        struct schedule_of *of = &m->of[s->kind == STEP_ACT ? l->owner[s->number] : s->number];

        if (s->kind == STEP_COMPUTE && s->age >= of->samples)
            of->samples = s->age + 1;
        if (s->kind == STEP_ACT && s->age >= of->computed)
            of->computed = s->age + 1;
    }
    for (size_t c = 0; c < l->setup.n_controllers; c++) {
        struct schedule_of *of = &m->of[c];

        of->computed = of->computed ? of->computed : 1;
        of->y = m->n;
        of->x = of->y + of->samples * l->measured[c];
        of->u = of->x + l->setup.controller[c].nx;
        m->n = of->u + of->computed * l->setup.controller[c].nu;
    }
}

/* Which of them it is, in @p number. */
static int find_advance(struct machine *m, apc_ns dt, size_t *number, struct apc_error *why)
{
    const struct apc_loop_plant *p = &m->loop->setup.plant;
    struct advance *all, *one;

    for (*number = 0; *number < m->n_advances; ++*number) {
        if (m->advance[*number].dt == dt)
            return 0;
    }
    all = realloc(m->advance, (m->n_advances + 1) * sizeof(*all));
    if (!all)
        return apc_fail(why, APC_ENOMEM, "no memory");
    m->advance = all;
    one = &all[m->n_advances];
    *one = (struct advance){dt, calloc(p->nx * (p->nx + p->nu) + 1, sizeof(double)), NULL};
    if (!one->A)
        return apc_fail(why, APC_ENOMEM, "no memory");
    m->n_advances++;
    one->B = one->A + p->nx * p->nx;
    return p->nx ? apc_linear_sample(p->nx, p->nu, p->A, p->B, apc_ns_to_s(dt), one->A, one->B, why) : 0;
}

/* With the plant's own motion in between. @p age of a STEP_ADVANCE is which. */
static int string_together(struct machine *m, const struct schedule *c, const struct sorted *from, size_t n,
                           struct apc_error *why)
{
    const struct apc_loop *l = m->loop;
    apc_ns now = 0;

    for (size_t i = 0; i <= n; i++) {
        const struct step *s = i < n ? &from[i].step : NULL;
        const apc_ns at = s ? s->at : c->period;
        const bool moves = !s || s->kind == STEP_KICK || s->kind == STEP_SAMPLE ||
                           (s->kind == STEP_ACT && l->to[s->number] != APC_LOOP_NOWHERE);

        if (moves && at > now) {
            size_t number;
            const int rc = find_advance(m, at - now, &number, why);

            if (rc < 0)
                return rc;
            m->step[m->n_steps++] = (struct step){.kind = STEP_ADVANCE, .age = number, .at = now};
            now = at;
        }
        if (s)
            m->step[m->n_steps++] = *s;
    }
    return 0;
}

int machine_create(struct machine *m, const struct apc_loop *loop, const struct schedule *schedule,
                   struct apc_error *why)
{
    const apc_ns every = loop->setup.plant.period;
    const size_t kicks = schedule->kicks ? (size_t)((schedule->period + every - 1) / every) : 0;
    size_t most = kicks + schedule->n * (2 + loop->n_out), n = 0;
    struct sorted *list = calloc(most, sizeof(*list));
    int rc;

    *m = (struct machine){.loop = loop,
                          .step = calloc(2 * most + 1, sizeof(*m->step)),
                          .of = calloc(loop->setup.n_controllers, sizeof(*m->of))};
    if (!list || !m->step || !m->of) {
        free(list);
        return apc_fail(why, APC_ENOMEM, "no memory");
    }
    for (size_t k = 0; k < kicks; k++)
        n = add_loop_step(list, n, STEP_KICK, 0, 0, (apc_ns)k * every, 0);
    for (size_t k = 0; k < schedule->n; k++)
        n = list_tick(loop, schedule, k, list, n);
    for (size_t k = 0; k < n; k++)
        wrap(&list[k].step, schedule->period);
    qsort(list, n, sizeof(*list), by_step_time);
    rc = string_together(m, schedule, list, n, why);
    free(list);
    if (rc == 0)
        lay_out_machine(m);
    return rc;
}

void machine_free(struct machine *m)
{
    for (size_t i = 0; i < m->n_advances; i++)
        free(m->advance[i].A);
    free(m->advance);
    free(m->step);
    free(m->of);
    free(m->room);
}

/* ---- Riding ---------------------------------------------------------------------------------- */

static void add_row(double *to, double share, const double *from, size_t width)
{
    if (share == 0.0)
        return;
    for (size_t i = 0; i < width; i++)
        to[i] += share * from[i];
}

static void advance_plant_state(struct machine *m, const struct step *s, struct ride *r)
{
    const struct apc_loop_plant *p = &m->loop->setup.plant;
    const struct advance *a = &m->advance[s->age];
    const size_t w = r->width;

    memset(m->room, 0, p->nx * w * sizeof(*m->room));
    for (size_t i = 0; i < p->nx; i++) {
        for (size_t j = 0; j < p->nx; j++)
            add_row(m->room + i * w, a->A[i * p->nx + j], r->Z + j * w, w);
        for (size_t j = 0; j < p->nu; j++) {
            if (m->loop->driver[j] != APC_LOOP_NOWHERE)
                add_row(m->room + i * w, a->B[i * p->nu + j], r->Z + (p->nx + m->loop->driver[j]) * w, w);
        }
    }
    memcpy(r->Z, m->room, p->nx * w * sizeof(*r->Z));
}

/* Make room for the newest among @p kept times @p n rows that begin at @p at. */
static void shift_rows(struct ride *r, size_t at, size_t kept, size_t n)
{
    memmove(r->Z + (at + n) * r->width, r->Z + at * r->width, (kept - 1) * n * r->width * sizeof(*r->Z));
}

static void sample_step(struct machine *m, const struct step *s, struct ride *r)
{
    const struct apc_loop_plant *p = &m->loop->setup.plant;
    const struct apc_loop_controller *c = &m->loop->setup.controller[s->number];
    const struct schedule_of *of = &m->of[s->number];
    const size_t w = r->width, n = m->loop->measured[s->number];
    double *to = r->Z + of->y * w;

    if (n == 0)
        return;
    shift_rows(r, of->y, of->samples, n);
    memset(to, 0, n * w * sizeof(*to));
    for (size_t k = 0; k < c->n_in; k++) {
        const size_t i = c->in[k].number;

        if (c->in[k].from != APC_FROM_MEASUREMENT)
            continue;
        for (size_t j = 0; j < p->nx; j++)
            add_row(to, p->C[i * p->nx + j], r->Z + j * w, w);
        for (size_t j = 0; j < p->nu; j++) {
            if (m->loop->driver[j] != APC_LOOP_NOWHERE)
                add_row(to, p->D[i * p->nu + j], r->Z + (p->nx + m->loop->driver[j]) * w, w);
        }
        to += w;
    }
}

static void compute_step(struct machine *m, const struct step *s, struct ride *r)
{
    const struct apc_loop_controller *c = &m->loop->setup.controller[s->number];
    const struct schedule_of *of = &m->of[s->number];
    const size_t w = r->width, rows = c->nx + c->nu;
    const double *measured = r->Z + (of->y + s->age * m->loop->measured[s->number]) * w;

    memset(m->room, 0, rows * w * sizeof(*m->room));
    for (size_t i = 0; i < rows; i++) {
        for (size_t j = 0; j < c->nx; j++)
            add_row(m->room + i * w, i < c->nx ? c->A[i * c->nx + j] : c->C[(i - c->nx) * c->nx + j],
                    r->Z + (of->x + j) * w, w);
    }
    for (size_t k = 0; k < c->n_in; k++) {
        const struct apc_loop_source *in = &c->in[k];
        const double *row = in->from == APC_FROM_MEASUREMENT ? measured
                            : in->from == APC_FROM_OUTPUT ? r->Z + (m->loop->setup.plant.nx + in->number) * w
                                                          : r->Z + (of->u + in->number) * w;

        measured += in->from == APC_FROM_MEASUREMENT ? w : 0;
        for (size_t i = 0; i < rows && in->from != APC_FROM_NONE; i++)
            add_row(m->room + i * w, i < c->nx ? c->B[i * c->n_in + k] : c->D[(i - c->nx) * c->n_in + k], row,
                    w);
    }
    memcpy(r->Z + of->x * w, m->room, c->nx * w * sizeof(*r->Z));
    shift_rows(r, of->u, of->computed, c->nu);
    memcpy(r->Z + of->u * w, m->room + c->nx * w, c->nu * w * sizeof(*r->Z));
}

static void actuate_step(struct machine *m, const struct step *s, struct ride *r)
{
    const struct apc_loop *l = m->loop;
    const size_t c = l->owner[s->number], w = r->width, half = w / 2;
    const double *slot =
        r->Z + (m->of[c].u + s->age * l->setup.controller[c].nu + s->number - l->first[c]) * w;
    double *acting = r->Z + (l->setup.plant.nx + s->number) * w;

    if (r->cut) {
        r->cut(r->ctx, s, slot, acting);
    } else if (r->factor) {
        const double re = creal(r->factor[s->number]), im = cimag(r->factor[s->number]);

        for (size_t i = 0; i < half; i++) {
            acting[i] = re * slot[i] - im * slot[half + i];
            acting[half + i] = re * slot[half + i] + im * slot[i];
        }
    } else {
        memcpy(acting, slot, w * sizeof(*acting));
    }
}

void machine_step(struct machine *m, const struct step *step, struct ride *ride)
{
    if (step->kind == STEP_ADVANCE)
        advance_plant_state(m, step, ride);
    else if (step->kind == STEP_SAMPLE)
        sample_step(m, step, ride);
    else if (step->kind == STEP_ACT)
        actuate_step(m, step, ride);
    else if (step->kind == STEP_COMPUTE)
        compute_step(m, step, ride);
}

int machine_widen(struct machine *m, size_t width)
{
    double *room = width > m->width ? realloc(m->room, m->n * width * sizeof(*room)) : m->room;

    if (!room)
        return APC_ENOMEM;
    m->room = room;
    m->width = width > m->width ? width : m->width;
    return 0;
}

int machine_ride(struct machine *m, struct ride *ride)
{
    const int rc = machine_widen(m, ride->width);

    for (size_t i = 0; i < m->n_steps && rc == 0; i++)
        machine_step(m, &m->step[i], ride);
    return rc;
}

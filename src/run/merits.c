/* SPDX-License-Identifier: BSD-3-Clause */
#include "merits.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "loops.h"

static const double none = (double)NAN;

/* How long a row stands for what is: as the plant's watchdog has it. */
static apc_ns patience(apc_ns period)
{
    return 3 * period + 100 * APC_NS_PER_MS;
}

/* ---- Standard deviations ------------------------------------------------------------------ */

/* Welford's. */
struct spread {
    double n, mean, sum;
};

static void spread_take(struct spread *s, double value)
{
    const double off = value - s->mean;
    s->n++;
    s->mean += off / s->n;
    s->sum += off * (value - s->mean);
}

static double deviation(const struct spread *s)
{
    return s->n > 1 ? sqrt(s->sum / (s->n - 1)) : none;
}

/* ---- Loops -------------------------------------------------------------------------------- */

/* What is known of a loop while its rows pass by in order of time. */
struct watch {
    const struct loops_loop *loop;
    apc_ns from, until, patience;
    apc_ns t;                   /* all before it is counted */
    apc_ns fresh_until;         /* of the newest output row */
    double setpoint;            /* NAN: none yet */
    bool told, automatic, good; /* told: its mode is on record */
    unsigned limited;
    double service, at[2]; /* s */
    struct spread with, without;
};

static bool serves(const struct watch *w, apc_ns t)
{
    return w->automatic && w->good && t < w->fresh_until;
}

/* Count until @p to with what was known. */
static void count_until(struct watch *w, apc_ns to)
{
    const apc_ns from = w->t > w->from ? w->t : w->from, end = to < w->until ? to : w->until,
                 stale = w->fresh_until < end ? w->fresh_until : end;
    if (w->automatic && w->good && stale > from)
        w->service += apc_ns_to_s(stale - from);
    for (int side = 0; side < 2; side++)
        if ((w->limited >> side & 1u) && stale > from)
            w->at[side] += apc_ns_to_s(stale - from);
    if (to > w->t)
        w->t = to;
}

static void take_row(struct watch *w, const struct apc_sample *s)
{
    const struct loops_loop *l = w->loop;
    count_until(w, s->time);
    if (s->table == APC_ACTUAL && s->id == apc_variable_number(APC_OPMODE, l->id)) {
        w->told = true;
        w->automatic = (s->value == (double)APC_MODE_AUTO || s->value == (double)APC_MODE_CAS) &&
                       s->status != APC_GOOD_LOCAL_OVERRIDE; /* the backup law's */
    }
    if (s->table == APC_SETPOINT && s->id == l->setpoint)
        w->setpoint = s->value;
    if (s->table == l->table && s->id == l->output) {
        w->good = apc_status_severity(s->status) == APC_SEVERITY_GOOD;
        w->limited = s->status >> 8 & 3u;
        w->fresh_until = s->time + w->patience;
    }
    if (s->table == APC_SENSOR && s->id == l->measurement && s->time >= w->from && s->time < w->until &&
        apc_status_severity(s->status) != APC_SEVERITY_BAD && !isnan(w->setpoint))
        spread_take(serves(w, s->time) ? &w->with : &w->without, s->value - w->setpoint);
}

/* Both lists by time; what was operated first. */
static void pass(struct watch *w, const struct samples *process, const struct samples *operation)
{
    size_t i = 0, k = 0;
    while (i < process->n || k < operation->n) {
        const bool second =
            i == process->n || (k < operation->n && operation->at[k].time <= process->at[i].time);
        take_row(w, second ? &operation->at[k++] : &process->at[i++]);
    }
    count_until(w, w->until);
}

static struct merits_loop judge(const struct watch *w)
{
    const double whole = apc_ns_to_s(w->until - w->from);
    struct merits_loop m = {.service = whole > 0 && w->told ? w->service / whole : none,
                            .low = whole > 0 ? w->at[0] / whole : none,
                            .high = whole > 0 ? w->at[1] / whole : none,
                            .with = deviation(&w->with),
                            .without = deviation(&w->without)};
    memcpy(m.name, w->loop->name, sizeof m.name);
    if (w->loop->above >= 0) /* whose setpoint goes along with the measurement in Man */
        m.without = none;
    m.benefit = m.without > 0 ? 1 - m.with / m.without : none;
    return m;
}

static int judge_loops(struct merits *m, const struct merits_source *s)
{
    struct loops loops;
    int rc = controllers_describe(s->e, &loops);
    m->loop = rc == 0 ? calloc(loops.n + 1, sizeof *m->loop) : NULL;
    for (size_t i = 0; i < loops.n && m->loop; i++) {
        struct watch w = {.loop = &loops.at[i],
                          .from = s->from,
                          .until = s->until,
                          .t = s->from,
                          .patience = patience(loops.controller[loops.at[i].controller].period),
                          .setpoint = none};
        pass(&w, s->process, s->operation);
        m->loop[m->n_loops++] = judge(&w);
    }
    loops_free(&loops);
    return m->loop ? 0 : APC_ENOMEM;
}

/* ---- Predictions -------------------------------------------------------------------------- */

/* What was measured of one signal, by time. */
struct measured {
    const struct apc_sample **at;
    size_t n;
    apc_ns patience;
};

struct comparison {
    struct merits_prediction *of;
    const struct measured *measured;
    const struct merits_source *source;
    double first, last; /* sums of squares */
};

/* What a tick at @p t found; false: nothing that was fresh and not Bad. */
static bool found_at(const struct measured *m, apc_ns t, double *value)
{
    size_t low = 0, high = m->n;
    while (low < high) {
        const size_t middle = low + (high - low) / 2;
        if (m->at[middle]->time <= t)
            low = middle + 1;
        else
            high = middle;
    }
    if (low == 0 || t - m->at[low - 1]->time > m->patience ||
        apc_status_severity(m->at[low - 1]->status) == APC_SEVERITY_BAD)
        return false;
    *value = m->at[low - 1]->value;
    return true;
}

static int compare(void *ctx, const struct apc_vector *row)
{
    struct comparison *c = ctx;
    const apc_ns from = row->time - c->source->offset;
    apc_ns step = 0;
    double value;
    if (row->n == 0 || from < c->source->from || from >= c->source->until)
        return 0;
    (void)apc_ns_from_s(c->of->step, &step);
    if (from + step < c->source->until && found_at(c->measured, from + step, &value)) {
        c->first += (value - row->value[0]) * (value - row->value[0]);
        c->of->n_first++;
    }
    if (from + step * (apc_ns)row->n < c->source->until &&
        found_at(c->measured, from + step * (apc_ns)row->n, &value)) {
        c->last += (value - row->value[row->n - 1]) * (value - row->value[row->n - 1]);
        c->of->n_last++;
    }
    return 0;
}

static int compare_all(struct merits_prediction *p, const struct merits_source *s)
{
    /* NOLINTNEXTLINE(bugprone-sizeof-expression): an array of pointers */
    struct measured m = {.at = calloc(s->process->n + 1, sizeof *m.at),
                         .patience = patience(s->e->client.rhythm.period)};
    struct comparison c = {.of = p, .measured = &m, .source = s};
    const struct apc_range range = {.since = s->from + s->offset, .until = s->until + s->offset};
    if (!m.at)
        return APC_ENOMEM;
    for (size_t i = 0; i < s->process->n; i++)
        if (s->process->at[i].table == APC_SENSOR && (size_t)s->process->at[i].id == p->measurement + 1)
            m.at[m.n++] = &s->process->at[i];
    const int rc = apc_store_vectors(s->published, APC_PREDICTION, p->id, &range, compare, &c);
    p->first = p->n_first > 0 ? sqrt(c.first / (double)p->n_first) : none;
    p->last = p->n_last > 0 ? sqrt(c.last / (double)p->n_last) : none;
    free(m.at);
    return rc < 0 ? rc : 0;
}

static int count_plan(void *ctx, const struct apc_sample *s)
{
    struct merits_limit *l = ctx;
    const unsigned bits = s->value >= 0 && s->value < 16 ? (unsigned)s->value : 0;
    l->plans++;
    l->low += bits & 1u;
    l->high += bits >> 1 & 1u;
    l->falls += bits >> 2 & 1u;
    l->rises += bits >> 3 & 1u;
    return 0;
}

static int count_plans(struct merits_limit *l, const struct merits_source *s)
{
    const struct apc_range range = {.since = s->from + s->offset, .until = s->until + s->offset};
    const int rc = apc_store_history(s->published, APC_ESTIMATE, l->id, &range, count_plan, l);
    const double n = l->plans > 0 ? (double)l->plans : none;
    l->low /= n;
    l->high /= n;
    l->falls /= n;
    l->rises /= n;
    return rc < 0 ? rc : 0;
}

/* What a law publishes, in the order of its ids: the first prediction is of its first measurement, and so on;
 * limits are those of its measurements, then of its outputs. */
struct listing {
    struct merits *m;
    const struct experiment *e;
    const struct controller *c;
    int estimate, prediction; /* ids of the next ones */
    size_t n_predictions, n_limits;
    bool failed;
};

static bool ends_with(const char *name, const char *end)
{
    const size_t n = strlen(name), k = strlen(end);
    return n > k && !strcmp(name + n - k, end);
}

static void *one_more(struct listing *l, void *at, size_t n, size_t size)
{
    void *grown = reallocarray(at, n + 1, size);
    if (grown)
        return grown;
    l->failed = true;
    return at;
}

static void list(void *ctx, size_t output, const struct apc_published *p)
{
    struct listing *l = ctx;
    const struct controller *c = l->c;
    struct merits *m = l->m;
    const int id = p->length ? l->prediction++ : l->estimate++;
    (void)output;
    if (!c->law->whole || l->failed)
        return;
    if (ends_with(p->name, ".prediction") && p->length && l->n_predictions < c->dim.ny) {
        const struct wire y = c->y[l->n_predictions++];
        m->prediction = one_more(l, m->prediction, m->n_predictions, sizeof *m->prediction);
        if (l->failed)
            return;
        m->prediction[m->n_predictions] =
            (struct merits_prediction){.id = id, .measurement = y.at, .step = p->step, .length = p->length};
        snprintf(m->prediction[m->n_predictions++].name, APC_TAG_LEN, "%s", l->e->y[y.at].tag.name);
    } else if (ends_with(p->name, ".limit") && !p->length && l->n_limits < c->dim.ny + c->dim.nu) {
        const size_t k = l->n_limits++;
        m->limit = one_more(l, m->limit, m->n_limits, sizeof *m->limit);
        if (l->failed)
            return;
        m->limit[m->n_limits] = (struct merits_limit){.id = id};
        snprintf(m->limit[m->n_limits++].name, APC_TAG_LEN, "%s",
                 k < c->dim.ny ? l->e->y[c->y[k].at].tag.name
                               : controllers_output(l->e, (struct controller_loop){c, k - c->dim.ny})->name);
    }
}

static int judge_published(struct merits *m, const struct merits_source *s)
{
    int rc = 0;
    for (size_t i = 0; i < s->e->n_controllers; i++) {
        const struct controller *c = &s->e->controllers[i];
        if (c->n_published == 0)
            continue;
        struct listing l = {
            .m = m, .e = s->e, .c = c, .estimate = c->first_estimate, .prediction = c->first_prediction};
        const struct apc_law_setup setup = cores_law_setup(c);
        (void)apc_law_published(c->law, &setup, list, &l, NULL);
        if (l.failed)
            return APC_ENOMEM;
    }
    for (size_t i = 0; i < m->n_predictions && rc == 0; i++)
        rc = compare_all(&m->prediction[i], s);
    for (size_t i = 0; i < m->n_limits && rc == 0; i++)
        rc = count_plans(&m->limit[i], s);
    return rc;
}

/* ---- All of it ---------------------------------------------------------------------------- */

int merits_make(struct merits *m, const struct merits_source *source)
{
    *m = (struct merits){.from = source->from, .until = source->until};
    const int rc = judge_loops(m, source);
    return rc == 0 && source->published ? judge_published(m, source) : rc;
}

void merits_free(struct merits *m)
{
    free(m->loop);
    free(m->prediction);
    free(m->limit);
    *m = (struct merits){0};
}

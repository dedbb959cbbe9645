/* SPDX-License-Identifier: BSD-3-Clause */
#include "figures_internal.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "record/record.h"

static const double none = (double)NAN;

apc_ns row_patience(apc_ns period)
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

static double standard_deviation(const struct spread *s)
{
    return s->n > 1 ? sqrt(s->sum / (s->n - 1)) : none;
}

/* Of a moment it says nothing that another one may be compared with. */
static bool spread_tells(const struct spread *s, double seconds, apc_ns period)
{
    return s->n >= KPIS_LEAST && seconds >= KPIS_LEAST * apc_ns_to_s(period);
}

/* ---- Loops -------------------------------------------------------------------------------- */

/* What is known of a loop while its rows pass by in order of time. */
struct watch {
    const struct loops_loop *loop;
    apc_ns from, until, period, patience;
    apc_ns t;                   /* all before it is counted */
    apc_ns fresh_until;         /* of the newest output row */
    double setpoint;            /* NAN: none yet */
    bool told, automatic, good; /* told: its mode is on record */
    unsigned limited;
    int mode;                                            /* the actual one, where it is told */
    apc_ns hold;                                         /* how long a measurement stands for what is */
    apc_ns known_until;                                  /* of the newest one */
    double service, at[2], in[APC_MODE_LO + 1], stopped; /* s */
    double iae;                                          /* NAN: never known */
    struct spread with, without;
    double measurement;     /* NAN: none yet */
    struct stretch stretch; /* empty unless health is asked for */
    bool health;            /* it is */
};

static bool serves(const struct watch *w, apc_ns t)
{
    return w->automatic && w->good && t < w->fresh_until;
}

/* A loop that is out of service need not be written. */
static void count_mode(struct watch *w, apc_ns from, apc_ns stale, apc_ns end)
{
    const apc_ns ticked = w->mode == APC_MODE_OOS ? end : stale > from ? stale : from;
    if (!w->told || end <= from)
        return;
    w->in[w->mode] += apc_ns_to_s(ticked - from);
    w->stopped += apc_ns_to_s(end - ticked);
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
    count_mode(w, from, stale, end);
    const apc_ns known = w->known_until < end ? w->known_until : end;
    if (known > from && !isnan(w->setpoint) && !isnan(w->measurement))
        w->iae =
            (isnan(w->iae) ? 0 : w->iae) + fabs(w->setpoint - w->measurement) * apc_ns_to_s(known - from);
    if (to > w->t)
        w->t = to;
}

static void stretch_row(struct watch *w, const struct apc_sample *s)
{
    const struct loops_loop *l = w->loop;
    if (s->time < w->from || s->time >= w->until)
        return;
    if (s->table == APC_SENSOR && s->id == l->measurement && !isnan(w->measurement))
        stretch_measured(&w->stretch, w->measurement);
    if (s->table != l->table || s->id != l->output)
        return;
    if (serves(w, s->time) && !isnan(w->measurement) && !isnan(w->setpoint))
        stretch_tick(&w->stretch, s->time, w->measurement, w->setpoint, s->value);
    else
        stretch_break(&w->stretch);
}

static void take_loop_row(struct watch *w, const struct apc_sample *s)
{
    const struct loops_loop *l = w->loop;
    count_until(w, s->time);
    if (s->table == APC_ACTUAL && s->id == apc_variable_number(APC_OPMODE, l->id)) {
        w->told = s->value >= 0 && s->value <= (double)APC_MODE_LO;
        w->mode = w->told ? (int)s->value : 0;
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
    if (s->table == APC_SENSOR && s->id == l->measurement) {
        w->measurement = apc_status_severity(s->status) == APC_SEVERITY_BAD ? none : s->value;
        w->known_until = s->time + w->hold;
    }
    if (w->health)
        stretch_row(w, s);
}

/* A variable that a loop has rows of. */
struct watched {
    enum apc_table table;
    int id;
    struct watch *by;
};

static int by_watched(const void *left, const void *right)
{
    const struct watched *a = left, *b = right;
    if (a->table != b->table)
        return a->table < b->table ? -1 : 1;
    return (a->id > b->id) - (a->id < b->id);
}

static size_t watch_variables(struct watched *to, struct watch *w)
{
    const struct loops_loop *l = w->loop;
    const struct watched of[] = {{APC_ACTUAL, apc_variable_number(APC_OPMODE, l->id), w},
                                 {APC_SENSOR, l->measurement, w},
                                 {APC_SETPOINT, l->setpoint, w},
                                 {l->table, l->output, w}};
    const bool own = by_watched(&of[3], &of[1]) != 0 && by_watched(&of[3], &of[2]) != 0;
    memcpy(to, of, sizeof of);
    return own ? 4 : 3;
}

static void take_watched_row(const struct watched *of, size_t n, const struct apc_sample *s)
{
    const struct watched wanted = {s->table, s->id, NULL};
    const struct watched *at = bsearch(&wanted, of, n, sizeof *of, by_watched);
    while (at && at > of && by_watched(&at[-1], &wanted) == 0)
        at--;
    for (; at && at < of + n && by_watched(at, &wanted) == 0; at++)
        take_loop_row(at->by, s);
}

/* Both lists by time; what was operated first. */
static void pass_rows(const struct watched *of, size_t n, const struct samples *process,
                      const struct samples *operation)
{
    size_t i = 0, k = 0;
    while (i < process->n || k < operation->n) {
        const bool second =
            i == process->n || (k < operation->n && operation->at[k].time <= process->at[i].time);
        take_watched_row(of, n, second ? &operation->at[k++] : &process->at[i++]);
    }
}

static struct kpis_loop kpis_of_loop(const struct watch *w)
{
    const double whole = apc_ns_to_s(w->until - w->from);
    struct kpis_loop m = {.from = w->from,
                          .until = w->until,
                          .service = whole > 0 && w->told ? w->service / whole : none,
                          .low = whole > 0 ? w->at[0] / whole : none,
                          .high = whole > 0 ? w->at[1] / whole : none,
                          .stopped = whole > 0 && w->told ? w->stopped / whole : none,
                          .iae = w->iae,
                          .with = standard_deviation(&w->with),
                          .without = standard_deviation(&w->without)};
    memcpy(m.name, w->loop->name, sizeof m.name);
    m.id = w->loop->id;
    for (int mode = 0; mode <= APC_MODE_LO; mode++)
        m.mode[mode] = whole > 0 && w->told ? w->in[mode] / whole : none;
    if (w->loop->above >= 0) /* whose setpoint goes along with the measurement in Man */
        m.without = none;
    const bool both = spread_tells(&w->with, w->service, w->period) &&
                      spread_tells(&w->without, whole - w->service, w->period);
    m.benefit = both && m.without > 0 ? 1 - m.with / m.without : none;
    return m;
}

/* A measurement may come less often than the controller ticks. */
static apc_ns measurement_period(const struct apc_tag *measurement, apc_ns tick)
{
    apc_ns period = 0;
    if (measurement)
        (void)apc_ns_from_s(measurement->period, &period);
    return period > tick ? period : tick;
}

static const struct apc_tag *loop_measurement(const struct kpis_source *s, const struct loops_loop *loop)
{
    const struct plant_view plant = {s->tag, s->n_tags, s->loops};
    return plant_tag(&plant, APC_SENSOR, loop->measurement);
}

static struct watch watch_of_loop(const struct kpis_source *s, const struct loops_loop *loop)
{
    const apc_ns period = s->loops->controller[loop->controller].period;
    return (struct watch){.loop = loop,
                          .from = s->from,
                          .until = s->until,
                          .t = s->from,
                          .period = period,
                          .patience = row_patience(period),
                          .hold = row_patience(measurement_period(loop_measurement(s, loop), period)),
                          .iae = none,
                          .setpoint = none,
                          .measurement = none,
                          .stretch = {.period = period, .follows = loop->above >= 0},
                          .health = s->horizon};
}

static int judge_loop(struct kpis_loop *to, const struct kpis_source *s, struct watch *w)
{
    const struct apc_tag *measurement = loop_measurement(s, w->loop);
    count_until(w, w->until);
    *to = kpis_of_loop(w);
    if (measurement)
        memcpy(to->measurement, measurement->name, sizeof to->measurement);
    return s->horizon ? stretch_judge(&w->stretch, to->low + to->high, *s->horizon, &to->health) : 0;
}

/* The @p n loops from @p first on. Each row goes to those that it is of: the time is that of the rows,
 * however many loops there are. */
static int judge_loops(struct kpis_loop *to, const struct kpis_source *s, size_t first, size_t n)
{
    struct watch *w = calloc(n + 1, sizeof *w);
    struct watched *of = calloc(4 * n + 1, sizeof *of);
    size_t variables = 0;
    int rc = w && of ? 0 : APC_ENOMEM;
    for (size_t i = 0; i < n && rc == 0; i++) {
        w[i] = watch_of_loop(s, &s->loops->at[first + i]);
        variables += watch_variables(&of[variables], &w[i]);
    }
    if (rc == 0) {
        qsort(of, variables, sizeof *of, by_watched);
        pass_rows(of, variables, s->process, s->operation);
    }
    for (size_t i = 0; i < n && w && of; i++) {
        const int judged = judge_loop(&to[i], s, &w[i]);
        rc = rc < 0 ? rc : judged;
    }
    free(of);
    free(w);
    return rc;
}

/* ---- Predictions -------------------------------------------------------------------------- */

/* What was measured of one signal, by time. */
struct measured {
    const struct apc_sample **at;
    size_t n;
    apc_ns patience;
};

struct comparison {
    struct kpis_prediction *of;
    const struct measured *measured;
    const struct kpis_source *source;
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

static int compare_tick(void *ctx, const struct apc_vector *row)
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

static int compare_all(struct kpis_prediction *p, const struct kpis_source *s)
{
    /* NOLINTNEXTLINE(bugprone-sizeof-expression): an array of pointers */
    struct measured m = {.at = calloc(s->process->n + 1, sizeof *m.at), .patience = p->patience};
    struct comparison c = {.of = p, .measured = &m, .source = s};
    const struct apc_range range = {.since = s->from + s->offset, .until = s->until + s->offset};
    if (!m.at)
        return APC_ENOMEM;
    for (size_t i = 0; i < s->process->n; i++)
        if (s->process->at[i].table == APC_SENSOR && s->process->at[i].id == p->measurement)
            m.at[m.n++] = &s->process->at[i];
    const int rc = apc_store_vectors(s->published, APC_PREDICTION, p->id, &range, compare_tick, &c);
    p->first = p->n_first > 0 ? sqrt(c.first / (double)p->n_first) : none;
    p->last = p->n_last > 0 ? sqrt(c.last / (double)p->n_last) : none;
    free(m.at);
    return rc < 0 ? rc : 0;
}

static int count_plan(void *ctx, const struct apc_sample *s)
{
    struct kpis_limit *l = ctx;
    const unsigned bits = s->value >= 0 && s->value < 16 ? (unsigned)s->value : 0;
    l->plans++;
    l->low += bits & 1u;
    l->high += bits >> 1 & 1u;
    l->falls += bits >> 2 & 1u;
    l->rises += bits >> 3 & 1u;
    return 0;
}

static int count_plans(struct kpis_limit *l, const struct kpis_source *s)
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

static void take_prediction(struct kpis *m, const struct apc_tag *tag, const struct apc_tag *of)
{
    struct kpis_prediction *p = &m->prediction[m->n_predictions++];
    apc_ns period = 0;
    (void)apc_ns_from_s(of->period, &period);
    *p = (struct kpis_prediction){.id = tag->id,
                                  .measurement = of->id,
                                  .patience = row_patience(period),
                                  .step = tag->step,
                                  .length = (size_t)tag->length};
    memcpy(p->name, of->name, sizeof p->name);
}

static void take_limit(struct kpis *m, const struct apc_tag *tag, const struct apc_tag *of)
{
    struct kpis_limit *l = &m->limit[m->n_limits++];
    *l = (struct kpis_limit){.id = tag->id, .table = of->table, .variable = of->id};
    memcpy(l->name, of->name, sizeof l->name);
}

static const struct apc_tag *limited_variable(const struct apc_tag *published, const struct kpis_source *s)
{
    static const enum apc_table tables[] = {APC_SENSOR, APC_ACTUATOR, APC_SETPOINT};
    const struct apc_tag *of = NULL;
    for (size_t i = 0; i < sizeof tables / sizeof *tables && !of; i++)
        of = prediction_variable(published, ".limit", tables[i], s->tag, s->n_tags);
    return of;
}

static int judge_published(struct kpis *m, const struct kpis_source *s)
{
    int rc = 0;
    m->prediction = calloc(s->n_tags + 1, sizeof *m->prediction);
    m->limit = calloc(s->n_tags + 1, sizeof *m->limit);
    if (!m->prediction || !m->limit)
        return APC_ENOMEM;
    for (size_t i = 0; i < s->n_tags && rc == 0; i++) {
        const struct apc_tag *tag = &s->tag[i], *of = NULL;
        if (tag->table == APC_PREDICTION && tag->step > 0 &&
            (of = prediction_variable(tag, ".prediction", APC_SENSOR, s->tag, s->n_tags))) {
            take_prediction(m, tag, of);
            rc = compare_all(&m->prediction[m->n_predictions - 1], s);
        } else if (tag->table == APC_ESTIMATE && (of = limited_variable(tag, s))) {
            take_limit(m, tag, of);
            rc = count_plans(&m->limit[m->n_limits - 1], s);
        }
    }
    return rc;
}

/* ---- All of it ---------------------------------------------------------------------------- */

int kpis_make(struct kpis *m, const struct kpis_source *source)
{
    *m = (struct kpis){
        .from = source->from, .until = source->until, .loop = calloc(source->loops->n + 1, sizeof *m->loop)};
    const int rc = m->loop ? judge_loops(m->loop, source, 0, source->loops->n) : APC_ENOMEM;
    m->n_loops = rc == 0 ? source->loops->n : 0;
    return rc == 0 && source->published ? judge_published(m, source) : rc;
}

/* ---- Of a store --------------------------------------------------------------------------- */

struct gathering {
    struct samples *to;
    size_t most;
    size_t newest; /* of each variable only so many; 0: all */
    apc_ns from;   /* where those begin, if some have been left out */
    int rc;
};

static int gather_loop_row(void *ctx, const struct apc_sample *row)
{
    struct gathering *g = ctx;
    g->rc = g->to->n < g->most ? samples_add(g->to, row) : APC_ERANGE;
    return g->rc;
}

/* Of one variable those in the window, and the newest before it. */
static int gather_variable(struct gathering *g, const struct kpis_source *s, enum apc_table table, int id)
{
    const struct apc_range before = {.until = s->from, .last = 1},
                           range = {.since = s->from, .until = s->until, .last = g->newest};
    int rc = s->from > 0 ? apc_store_history(s->published, table, id, &before, gather_loop_row, g) : 0;
    const size_t first = g->to->n;
    if (rc >= 0 && g->rc == 0)
        rc = apc_store_history(s->published, table, id, &range, gather_loop_row, g);
    if (g->newest > 0 && g->to->n - first == g->newest && g->to->at[first].time > g->from)
        g->from = g->to->at[first].time;
    return g->rc < 0 ? g->rc : rc < 0 ? rc : 0;
}

static int gather_all(const struct kpis_source *s, struct samples *process, struct samples *operation,
                      size_t most)
{
    struct gathering g = {.to = process, .most = most};
    int rc = 0;
    for (size_t i = 0; i < s->n_tags && rc == 0; i++) {
        const enum apc_table table = s->tag[i].table;
        if (table == APC_SENSOR || table == APC_SETPOINT || table == APC_ACTUATOR)
            rc = gather_variable(&g, s, table, s->tag[i].id);
    }
    g = (struct gathering){.to = operation, .most = most};
    for (size_t i = 0; i < s->loops->n && rc == 0; i++)
        rc = gather_variable(&g, s, APC_ACTUAL, apc_variable_number(APC_OPMODE, s->loops->at[i].id));
    samples_sort(process);
    samples_sort(operation);
    return rc;
}

/* What there is no record of is no time out of service. False: nothing is. */
static bool clip_to_record(struct kpis_source *s)
{
    const struct samples *const rows = s->process;
    if (rows->n > 0 && rows->at[0].time > s->from)
        s->from = rows->at[0].time;
    if (rows->n > 0 && rows->at[rows->n - 1].time < s->until)
        s->until = rows->at[rows->n - 1].time + 1;
    return rows->n > 0 && s->from < s->until;
}

static int make_of_store(struct kpis *m, struct kpis_source s, size_t most)
{
    struct samples process = {0}, operation = {0};
    int rc = gather_all(&s, &process, &operation, most);
    s.process = &process;
    s.operation = &operation;
    if (rc == 0)
        rc = clip_to_record(&s) ? kpis_make(m, &s) : APC_ENOTFOUND;
    samples_free(&operation);
    samples_free(&process);
    return rc;
}

/* What a store says of its loops; they are to be freed, and the tags, in either case. */
static int source_load(struct kpis_source *s, struct loops *loops, struct apc_tag **tag)
{
    const int n = apc_store_get_tags(s->published, NULL, 0);
    *loops = (struct loops){0};
    *tag = n < 0 ? NULL : calloc((size_t)n + 1, sizeof **tag);
    int rc = n < 0 ? n : *tag ? apc_store_get_tags(s->published, *tag, (size_t)n) : APC_ENOMEM;
    s->loops = loops;
    s->tag = *tag;
    s->n_tags = (size_t)(rc < 0 ? 0 : rc < n ? rc : n);
    if (rc >= 0)
        rc = loops_load(loops, s->published, *tag, s->n_tags);
    return rc == 0 && loops->n == 0 ? APC_ENOTFOUND : rc;
}

int kpis_of_store(struct kpis *m, struct apc_store *store, apc_ns from, apc_ns until, size_t most)
{
    struct loops loops;
    struct apc_tag *tag;
    struct kpis_source s = {.published = store, .from = from, .until = until};
    *m = (struct kpis){.from = from, .until = until};
    int rc = source_load(&s, &loops, &tag);
    if (rc == 0)
        rc = make_of_store(m, s, most);
    loops_free(&loops);
    free(tag);
    return rc;
}

/* ---- The health of a store's loops -------------------------------------------------------- */

static int judge_loop_of_store(struct kpis_loop *to, struct kpis_source s, size_t i, size_t newest)
{
    const struct loops_loop *const l = &s.loops->at[i];
    struct samples process = {0}, operation = {0};
    struct gathering g = {.to = &process, .most = SIZE_MAX, .newest = newest, .from = s.from},
                     modes = {.to = &operation, .most = SIZE_MAX};
    int rc = l->table ? gather_variable(&g, &s, l->table, l->output) : 0;
    if (rc == 0 && l->measurement)
        rc = gather_variable(&g, &s, APC_SENSOR, l->measurement);
    if (rc == 0 && l->setpoint)
        rc = gather_variable(&g, &s, APC_SETPOINT, l->setpoint);
    if (rc == 0)
        rc = gather_variable(&modes, &s, APC_ACTUAL, apc_variable_number(APC_OPMODE, l->id));
    samples_sort(&process);
    samples_sort(&operation);
    s.process = &process;
    s.operation = &operation;
    s.from = g.from;
    if (rc == 0 && !clip_to_record(&s))
        s.from = s.until;
    if (rc == 0)
        rc = judge_loops(to, &s, i, 1);
    samples_free(&operation);
    samples_free(&process);
    return rc;
}

int health_of_store(struct kpis *m, struct apc_store *store, const struct health_asked *asked)
{
    struct loops loops;
    struct apc_tag *tag;
    struct kpis_source s = {
        .published = store, .from = m->from, .until = m->until, .horizon = &asked->horizon};
    const size_t first = m->n_loops;
    int rc = source_load(&s, &loops, &tag);
    struct kpis_loop *const loop = rc == 0 ? reallocarray(m->loop, loops.n, sizeof *loop) : NULL;
    if (loop)
        m->loop = loop;
    else if (rc == 0)
        rc = APC_ENOMEM;
    while (rc == 0 && m->n_loops < loops.n &&
           (m->n_loops == first || apc_clock_mono(NULL) < asked->give_up)) {
        rc = judge_loop_of_store(&m->loop[m->n_loops], s, m->n_loops, asked->newest);
        m->n_loops += rc == 0;
    }
    const size_t left = loops.n > m->n_loops ? loops.n - m->n_loops : 0;
    loops_free(&loops);
    free(tag);
    return rc < 0 ? rc : (int)left;
}

bool kpis_on_record(const struct kpis *m)
{
    size_t i = 0;
    while (i < m->n_loops && m->loop[i].from == m->loop[i].until)
        i++;
    return i < m->n_loops;
}

static int by_health(const void *left, const void *right)
{
    const struct health *a = &((const struct kpis_loop *)left)->health,
                        *b = &((const struct kpis_loop *)right)->health;
    if (a->verdict != b->verdict)
        return a->verdict < b->verdict ? -1 : 1;
    return (a->index > b->index) - (a->index < b->index);
}

void kpis_sort_by_health(struct kpis *m)
{
    qsort(m->loop, m->n_loops, sizeof *m->loop, by_health);
}

void kpis_free(struct kpis *m)
{
    free(m->loop);
    free(m->prediction);
    free(m->limit);
    *m = (struct kpis){0};
}

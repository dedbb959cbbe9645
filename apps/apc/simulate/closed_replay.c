/* SPDX-License-Identifier: BSD-3-Clause */
#include "closed_replay.h"

#include <math.h>
#include <stdlib.h>

#include "apc/common/print.h"
#include "compare.h"
#include "figures/figures.h"
#include "statistic.h"

#define WINDOWS 10
#define MOST    0.5 /* of what moved a measurement may be none of the model's, without more being said */

/* Those that add up over windows. */
static const enum metric metrics[] = {METRIC_IAE, METRIC_ISE, METRIC_EFFORT};
#define N_METRICS (sizeof metrics / sizeof *metrics)

struct window_figures {
    double (*window)[WINDOWS]; /* [n * N_METRICS] */
    struct loop *loop;
    size_t n;
};

/* ---- Windows -------------------------------------------------------------------------------- */

static int measure_window(struct window_figures *f, const struct samples *samples, const struct experiment *e,
                          size_t window, apc_ns from, apc_ns until)
{
    struct figures figures;
    const int rc = closed_figures(&figures, samples, e, from, until);
    for (size_t i = 0; i < f->n && rc == 0; i++)
        for (size_t k = 0; k < N_METRICS; k++)
            f->window[i * N_METRICS + k][window] = figures.of[i].figure[metrics[k]];
    figures_free(&figures);
    return rc;
}

static int measure_windows(struct window_figures *f, const struct samples *samples, const struct closed *c)
{
    const struct experiment *e = &c->was;
    const apc_ns length = c->end - c->since;
    f->loop = calloc(controllers_loops(e) + 1, sizeof *f->loop);
    const int n = f->loop ? metrics_loops(e, f->loop) : APC_ENOMEM;
    f->n = n > 0 ? (size_t)n : 0;
    f->window = calloc(f->n * N_METRICS + 1, sizeof *f->window);
    int rc = n < 0 ? n : f->window ? 0 : APC_ENOMEM;
    for (size_t k = 0; k < WINDOWS && rc == 0; k++)
        rc = measure_window(f, samples, e, k, c->since + length / WINDOWS * (apc_ns)k,
                            k + 1 < WINDOWS ? c->since + length / WINDOWS * (apc_ns)(k + 1) : c->end);
    return rc;
}

static void free_window_figures(struct window_figures *f)
{
    free(f->window);
    free(f->loop);
}

/* ---- What is told --------------------------------------------------------------------------- */

struct closed_answer {
    struct closed closed;
    struct samples unchanged, otherwise;
    struct window_figures was, is;
    double apart; /* of the unchanged run from the record, in widths of the range */
};

/* Of a figure the sum over windows on record and otherwise, and the difference with its interval. */
struct closed_row {
    double was, is, low, high;
};

static struct closed_row closed_row_of(const struct closed_answer *a, size_t at)
{
    static const uint64_t seed[WINDOWS];
    struct closed_row row = {.was = 0};
    double difference[WINDOWS];
    for (size_t k = 0; k < WINDOWS; k++) {
        row.was += a->was.window[at][k];
        row.is += a->is.window[at][k];
        difference[k] = a->is.window[at][k] - a->was.window[at][k];
    }
    const struct statistic s = statistic_of(difference, seed, WINDOWS);
    row.low = WINDOWS * (s.mean - s.half);
    row.high = WINDOWS * (s.mean + s.half);
    return row;
}

static const char *closed_verdict(const struct closed_row *row)
{
    return row->low > 0 ? "more" : row->high < 0 ? "less" : row->low <= row->high ? "none to be seen" : "";
}

static int print_closed(const struct closed_answer *a)
{
    static const struct print_column columns[] = {{"", PRINT_LEFT},
                                                  {"", PRINT_LEFT},
                                                  {"recorded", PRINT_POINT},
                                                  {"otherwise", PRINT_POINT},
                                                  {"difference", PRINT_POINT},
                                                  {"from", PRINT_POINT},
                                                  {"to", PRINT_POINT},
                                                  {"", PRINT_LEFT}};
    const struct experiment *e = &a->closed.was;
    struct print_table table;
    for (size_t k = 0; k < e->dim.ny; k++) {
        const double left = closed_left_out(&a->closed, k);
        printf("%s: of what moved it the model leaves out %.3g %%%s\n", e->y[k].tag.name, 100 * left,
               left > MOST ? ": as a disturbance, which acts again, or as an error of the model, with which "
                             "the answer is wrong"
                           : "");
    }
    for (size_t i = 0; i < a->closed.n_notes; i++)
        printf("%s\n", a->closed.note[i]);
    printf("unchanged, it is at most %.3g %% of a range apart from the record\n", 100 * a->apart);
    print_table_open(&table, columns, sizeof columns / sizeof *columns);
    for (size_t i = 0; i < a->was.n; i++)
        for (size_t k = 0; k < N_METRICS; k++) {
            const struct closed_row row = closed_row_of(a, i * N_METRICS + k);
            print_cell(&table, PRINT_PLAIN, "%s", a->was.loop[i].name);
            print_cell(&table, PRINT_PLAIN, "%s", metric_name(metrics[k]));
            print_number(&table, 5, row.was);
            print_number(&table, 5, row.is);
            print_number(&table, 3, row.is - row.was);
            print_number(&table, 3, row.low);
            print_number(&table, 3, row.high);
            print_cell(&table, PRINT_PLAIN, "%s", closed_verdict(&row));
        }
    return print_table_end(&table, stdout, false, 0);
}

static void put_closed_json(const struct closed_answer *a, const char *name, struct text *t)
{
    const struct closed *c = &a->closed;
    const struct experiment *e = &c->was;
    json_add(t, "{run:%s, since:%.6jd, until:%.6jd, windows:%ju, unchanged_apart:%g, notes:[", name,
             (intmax_t)(c->start + c->since), (intmax_t)(c->start + c->end), (uintmax_t)WINDOWS, a->apart);
    for (size_t i = 0; i < c->n_notes; i++)
        json_add(t, "%s", c->note[i]);
    json_add(t, "], left_out:{");
    for (size_t k = 0; k < e->dim.ny; k++)
        json_add(t, "%s:%g", e->y[k].tag.name, closed_left_out(&a->closed, k));
    json_add(t, "}, loops:[");
    for (size_t i = 0; i < a->was.n; i++) {
        json_add(t, "{loop:%s", a->was.loop[i].name);
        for (size_t k = 0; k < N_METRICS; k++) {
            const struct closed_row row = closed_row_of(a, i * N_METRICS + k);
            json_add(t, "%s:{recorded:%g, otherwise:%g, low95:%g, high95:%g}", metric_key(metrics[k]),
                     row.was, row.is, row.low, row.high);
        }
        json_add(t, "}");
    }
    json_add(t, "]}");
}

/* ---- Its figure ----------------------------------------------------------------------------- */

/* Times of a run are since its start, of a store since the part begins. */
static int take_closed_variable(struct compare_variable *v, const struct samples *was,
                                const struct samples *is, const struct closed *c, const struct apc_tag *tag,
                                const struct apc_tag *setpoint)
{
    const apc_ns start = c->of.dir ? 0 : c->since;
    v->tag = tag;
    int rc = trace_take(&v->recorded, was, start, tag);
    if (rc == 0)
        rc = trace_take(&v->simulated, is, start, tag);
    return rc == 0 && setpoint ? trace_take(&v->setpoint, is, start, setpoint) : rc;
}

static int draw_closed(const struct closed_answer *a, const char *name, FILE *out, struct apc_error *why)
{
    const struct closed *c = &a->closed;
    const struct experiment *e = &c->was;
    struct compare_variable *v = calloc(e->dim.ny + e->dim.nu + 1, sizeof *v);
    struct samples was = {0}, is = {0};
    char time[APC_TIME_LEN], title[200];
    size_t n = 0;
    int rc = v ? closed_window(&was, &c->all, c->since, c->end) : APC_ENOMEM;
    if (rc == 0)
        rc = closed_window(&is, &a->otherwise, c->since, c->end);
    for (size_t i = 0; i < e->dim.ny && rc == 0; i++)
        rc = take_closed_variable(&v[n++], &was, &is, c, &e->y[i].tag, i < e->dim.nz ? &e->z[i].tag : NULL);
    for (size_t i = 0; i < e->dim.nu && rc == 0; i++)
        rc = take_closed_variable(&v[n++], &was, &is, c, &e->u[i].tag, NULL);
    const apc_ns start = c->of.dir ? 0 : c->since;
    snprintf(title, sizeof title, "%.120s%s%s", e->title, c->of.dir ? "" : ", from ",
             c->of.dir ? "" : apc_time_format(c->start + c->since, time));
    const struct compare_figure figure = {.title = title,
                                          .label = "otherwise",
                                          .of = v,
                                          .n = n,
                                          .begin = apc_ns_to_s(c->since - start),
                                          .end = apc_ns_to_s(c->end - start)};
    rc = rc < 0 ? apc_fail(why, rc, "out of memory") : compare_draw(&figure, name, out, why);
    for (size_t i = 0; i < n; i++) {
        trace_free(&v[i].recorded);
        trace_free(&v[i].simulated);
        trace_free(&v[i].setpoint);
    }
    free(v);
    samples_free(&was);
    samples_free(&is);
    return rc;
}

/* ---- All of it ------------------------------------------------------------------------------ */

static double range_of(const struct experiment *e, const struct apc_sample *row)
{
    const size_t at = (size_t)row->id - 1;
    const struct apc_tag *tag = row->table == APC_SENSOR && at < e->dim.ny     ? &e->y[at].tag
                                : row->table == APC_ACTUATOR && at < e->dim.nu ? &e->u[at].tag
                                                                               : NULL;
    return tag && tag->high > tag->low ? tag->high - tag->low : HUGE_VAL;
}

static size_t closed_place(const struct experiment *e, const struct apc_sample *row)
{
    return (row->table == APC_SENSOR ? 0 : e->dim.ny) + (size_t)row->id - 1;
}

/* The row of that place from row @p from on; all: there is none. */
static size_t row_of_place(const struct experiment *e, const struct samples *all, size_t place, size_t from)
{
    while (from < all->n && (isinf(range_of(e, &all->at[from])) || closed_place(e, &all->at[from]) != place))
        from++;
    return from;
}

/* What the figure is a part of: of a signal without limits what it went through on record, from row @p from on. */
static double span_on_record(const struct experiment *e, const struct samples *was, size_t place, size_t from)
{
    double low = HUGE_VAL, high = -HUGE_VAL;
    if (from < was->n && range_of(e, &was->at[from]) < APC_VALUE_MAX)
        return range_of(e, &was->at[from]);
    for (; from < was->n; from = row_of_place(e, was, place, from + 1)) {
        low = fmin(low, was->at[from].value);
        high = fmax(high, was->at[from].value);
    }
    return high - low;
}

/* Each row beside that of the record next to it in time, which in real time comes some microseconds later. */
static double widest_apart(const struct experiment *e, const struct samples *made, const struct samples *was)
{
    double widest = 0;
    for (size_t place = 0; place < e->dim.ny + e->dim.nu; place++) {
        size_t at = row_of_place(e, was, place, 0), after = row_of_place(e, was, place, at + 1);
        const double span = span_on_record(e, was, place, at);
        for (size_t i = row_of_place(e, made, place, 0); at < was->n && i < made->n;
             i = row_of_place(e, made, place, i + 1)) {
            const struct apc_sample *row = &made->at[i];
            while (after < was->n &&
                   llabs(was->at[after].time - row->time) <= llabs(was->at[at].time - row->time)) {
                at = after;
                after = row_of_place(e, was, place, at + 1);
            }
            if (span > 0)
                widest = fmax(widest, fabs(row->value - was->at[at].value) / span); /* without NAN */
        }
    }
    return widest;
}

/* Without what came before the part, or comes after it. */
static void cut_closed(struct samples *s, const struct closed *c)
{
    size_t n = 0;
    for (size_t i = 0; i < s->n; i++)
        if (s->at[i].time >= c->since && s->at[i].time <= c->end)
            s->at[n++] = s->at[i];
    s->n = n;
}

static int answer_closed(struct closed_answer *a, const struct replay_range *of, struct apc_error *why)
{
    const struct experiment *e = &a->closed.was;
    int rc = closed_load(&a->closed, of, why);
    if (rc == 0)
        rc = closed_run(&a->closed, NULL, &a->unchanged, why);
    if (rc == 0)
        rc = closed_run(&a->closed, of->overrides, &a->otherwise, why);
    if (rc == 0 && (rc = measure_windows(&a->was, &a->closed.all, &a->closed)) == 0)
        rc = measure_windows(&a->is, &a->otherwise, &a->closed);
    if (rc == APC_ENOMEM)
        apc_fail(why, rc, "out of memory");
    if (rc < 0)
        return rc;
    cut_closed(&a->unchanged, &a->closed);
    a->apart = widest_apart(e, &a->unchanged, &a->closed.all);
    return 0;
}

int closed_replay(const char *name, const struct replay_range *of, const char *figure, struct text *json,
                  struct apc_error *why)
{
    struct closed_answer a = {.apart = 0};
    int rc = answer_closed(&a, of, why);
    if (rc == 0 && json)
        put_closed_json(&a, name, json);
    else if (rc == 0 && print_closed(&a) < 0)
        rc = apc_fail(why, APC_ENOMEM, "out of memory");
    if (rc == 0 && figure)
        rc = draw_closed(&a, figure, json ? stderr : stdout, why);
    free_window_figures(&a.was);
    free_window_figures(&a.is);
    samples_free(&a.unchanged);
    samples_free(&a.otherwise);
    closed_free(&a.closed);
    return rc;
}

/* SPDX-License-Identifier: BSD-3-Clause */
/* The engineer's workbench: a model from the plant's own record. */
#include <apcidentify.h>

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "apc-ui/api/api.h"
#include "grid/grid.h"

/* ---- A model from the record ------------------------------------------------------------------ */

#define CELLS    4 /* pairs of an input and an output: with so many samples, over all pairs, it takes seconds */
#define SAMPLES  3000
#define ROWS     1000000 /* of a signal in the windows */
#define WINDOWS  8
#define HOUR     (3600 * APC_NS_PER_S)
#define SHARE    0.67 /* of the record that is fitted to; the rest judges */
#define POINTS   80   /* of a step response */
#define SETTLES  5.0  /* time constants that it is drawn for */
#define INTERVAL 1.96 /* standard errors of 95 % */

struct modelling {
    struct identify_selection selection; /* its time: that of all windows */
    struct apc_range window[WINDOWS];
    size_t windows;
    int64_t order; /* 0: found */
    char *names[2];
    struct identify_data part[WINDOWS], data; /* of each window, and of all */
    struct apc_transfer *g, *error;           /* [outputs * inputs] */
    struct apc_validation *judged;            /* [outputs] */
    struct grid_warning *warning;
    size_t warnings;
};

bool split_signals(struct request *r, const char *field, char **copy, char *name[], size_t *n)
{
    const char *text = request_query(r, field);
    char *rest;

    *copy = strdup(text ? text : "");
    for (char *at = *copy ? strtok_r(*copy, ",", &rest) : NULL; at && *n <= CELLS;
         at = strtok_r(NULL, ",", &rest))
        name[(*n)++] = at;
    return *n > 0 || fault_set(&r->fault, 422, "parameter", field,
                               "\"%s\" is needed: names with a comma between", field);
}

/* "SINCE..UNTIL,...", one after the other; without it since and until are the only one. False: the fault is set. */
static bool query_windows(struct request *r, struct modelling *m)
{
    const apc_ns now = apc_clock_utc(NULL);
    const char *text = request_query(r, "windows");
    char *copy = text ? strdup(text) : NULL, *rest, *dots;
    bool ok = true;

    for (char *at = copy ? strtok_r(copy, ",", &rest) : NULL; at && ok; at = strtok_r(NULL, ",", &rest)) {
        struct apc_range *w = &m->window[m->windows];

        if ((dots = strstr(at, "..")))
            *dots = '\0';
        ok = m->windows < WINDOWS && dots && time_parse(at, now, &w->since) &&
             time_parse(dots + 2, now, &w->until) && w->since < w->until &&
             (m->windows++ == 0 || w->since >= w[-1].until);
    }
    free(copy);
    if (text && (!ok || m->windows == 0))
        return fault_set(
            &r->fault, 422, "parameter", "windows",
            "\"windows\" must be SINCE..UNTIL with a comma between, %d at most, one after the other",
            WINDOWS);
    if (m->windows == 0) {
        m->windows = 1;
        return query_range(r, HOUR, 0, &m->window[0].since, &m->window[0].until);
    }
    return true;
}

static int note_record_begin(void *ctx, const struct apc_sample *row)
{
    *(apc_ns *)ctx = row->time;
    return 1;
}

/* The period of the grid: that of the first output, or as many of them as leave few enough samples of the record, which
 * may begin later than the time that was asked for. */
static bool choose_grid(struct ui *ui, struct request *r, struct apc_store *store, struct modelling *m)
{
    int id = 0;
    const size_t cells = m->selection.inputs * m->selection.outputs;
    double period = 0.0, span = 0.0;

    if (cells > CELLS)
        return fault_set(&r->fault, 422, "parameter", "inputs",
                         "at most %d pairs of an input and an output at once", CELLS);
    pthread_mutex_lock(&ui->model.mutex);
    for (size_t i = 0; i < ui->model.plant.n; i++) {
        const struct apc_tag *tag = &ui->model.plant.tag[i];
        if (tag->table == APC_SENSOR && !strcmp(tag->name, m->selection.output[0]))
            period = apc_ns_to_s(plant_period(&ui->model.plant, tag->table, id = tag->id));
    }
    pthread_mutex_unlock(&ui->model.mutex);
    for (struct apc_range *w = m->window; period > 0.0 && w < m->window + m->windows; w++) {
        apc_ns first = 0;
        const int rc = apc_store_history(store, APC_SENSOR, id, w, note_record_begin, &first);

        if (rc < 0) {
            fault_store(r, rc, store);
            return false;
        }
        w->since = first > w->since ? first : w->since;
        span += apc_ns_to_s(w->until - w->since);
    }
    if (span / period > ROWS)
        return fault_set(&r->fault, 422, "parameter", m->windows > 1 ? "windows" : "since",
                         "more than %d rows: ask for less time at once", ROWS);
    m->selection.since = m->window[0].since;
    m->selection.until = m->window[m->windows - 1].until;
    if (period > 0.0) /* else its record tells */
        m->selection.period = period * ceil(span / period * (double)cells / SAMPLES);
    return true;
}

static int read_windows(struct modelling *m, struct apc_store *store, struct apc_error *why)
{
    const struct grid_source from = {.file = "the record", .store = store, .read = stored_read};
    int rc = 0;

    for (size_t i = 0; i < m->windows && rc == 0; i++) {
        struct identify_selection selection = m->selection;

        selection.since = m->window[i].since;
        selection.until = m->window[i].until;
        if (i > 0)
            selection.period = m->part[0].record.Ts;
        rc = grid_read(&m->part[i], &from, &selection, why);
    }
    return rc == 0 && grid_join(&m->data, m->part, m->windows) < 0
               ? apc_fail(why, APC_ENOMEM, "out of memory")
               : rc;
}

/* By what the model was not fitted to, each window around its own point. */
static int judge_transfers(struct modelling *m, size_t fitted, const double *u0, const double *y0,
                           struct apc_error *why)
{
    struct apc_record on = m->data.record;
    double *moved = apc_record_gather(&on, u0, y0);
    struct apc_linear *linear = NULL;
    int rc = moved ? apc_linear_from_transfer(&linear, on.ny, on.nu, 0, m->g, u0, y0, on.Ts, why)
                   : apc_fail(why, APC_ENOMEM, "out of memory");

    if (rc == 0)
        rc = apc_validate(linear, NULL, &on, fitted, m->judged, NULL, why);
    if (rc == 0)
        rc = grid_warnings(&m->data, linear, u0, y0, &m->warning, &m->warnings);
    apc_linear_destroy(linear);
    free(moved);
    return rc;
}

static int find_model(struct modelling *m, struct apc_error *why)
{
    const struct apc_identify_transfer_options options = {.size = sizeof options,
                                                          .order = (unsigned)m->order};
    const struct apc_record *all = &m->data.record;
    const size_t cells = all->nu * all->ny, fitted = (size_t)((double)all->n * SHARE);
    struct apc_record first;
    double u0[CELLS * WINDOWS], y0[CELLS * WINDOWS];
    void *memory = NULL;
    int rc = apc_record_check(all, why);

    m->g = calloc(2 * cells + 1, sizeof *m->g);
    m->judged = calloc(all->ny + 1, sizeof *m->judged);
    if (rc == 0 && (!m->g || !m->judged || grid_first(all, fitted, &first, &memory) < 0))
        rc = apc_fail(why, APC_ENOMEM, "out of memory");
    m->error = m->g ? m->g + cells : NULL;
    if (rc == 0)
        rc = apc_identify_transfer(&first, &options, m->g, m->error, u0, y0, NULL, why);
    if (rc == 0)
        rc = judge_transfers(m, fitted, u0, y0, why);
    free(memory);
    return rc;
}

/* y [POINTS] after a step of 1, a point each @p Ts. Returns 0 or a negative error. */
static int step_response(const struct apc_transfer *g, double Ts, double *y)
{
    struct apc_linear *plant = NULL;
    const double one = 1.0;
    double *x = NULL;
    int rc = apc_linear_from_transfer(&plant, 1, 1, 0, g, NULL, NULL, Ts, NULL);

    if (rc == 0 && !(x = calloc(2 * plant->nx + 1, sizeof *x)))
        rc = APC_ENOMEM;
    for (size_t k = 0; k < POINTS && rc == 0; k++) {
        double *now = x + (k % 2) * plant->nx;

        apc_linear_output(plant, now, &one, &y[k]);
        apc_linear_next(plant, now, &one, x + ((k + 1) % 2) * plant->nx);
    }
    free(x);
    apc_linear_destroy(plant);
    return rc;
}

/* The step response with its 95 % interval: by what each number's error moves it, as if they were independent. */
static void response_json(const struct apc_transfer *g, const struct apc_transfer *error, struct text *t)
{
    const double Ts = (g->dead_time + SETTLES * (g->tau[0] + g->tau[1]) + fabs(g->zero)) / (POINTS - 1);
    double y[POINTS], moved[POINTS], square[POINTS] = {0.0};
    struct apc_transfer by = *g;
    struct {
        double *number, error;
        bool above;
    } part[] = {{&by.gain, error->gain, false},
                {&by.zero, error->zero, false},
                {&by.tau[0], error->tau[0], true},
                {&by.tau[1], error->tau[1], true},
                {&by.dead_time, error->dead_time, true}};
    const bool responds = Ts > 0.0 && step_response(g, Ts, y) == 0;
    bool told = responds;

    for (size_t i = 0; told && i < sizeof part / sizeof *part; i++) {
        const double was = *part[i].number;

        if (was == 0.0)
            continue;
        *part[i].number += part[i].error;
        told = isfinite(part[i].error) && step_response(&by, Ts, moved) == 0;
        *part[i].number = was;
        for (size_t k = 0; told && k < POINTS; k++)
            square[k] += (moved[k] - y[k]) * (moved[k] - y[k]);
    }
    json_add(t, "step:%g, response:[", Ts);
    for (size_t k = 0; responds && k < POINTS; k++)
        json_add(t, "%.6g", y[k]);
    json_add(t, "], half:[");
    for (size_t k = 0; told && k < POINTS; k++)
        json_add(t, "%.6g", INTERVAL * sqrt(square[k]));
    json_add(t, "]");
}

static void numbers_json(const struct apc_transfer *g, struct text *t)
{
    json_add(t, "gain:%.6g, zero:%.6g, tau1:%.6g, tau2:%.6g, dead_time:%.6g", g->gain, g->zero, g->tau[0],
             g->tau[1], g->dead_time);
}

static void cells_json(const struct modelling *m, struct text *t)
{
    const struct apc_record *r = &m->data.record;

    json_add(t, "cells:[");
    for (size_t p = 0; p < r->ny * r->nu; p++) {
        json_add(t, "{input:%s, output:%s, integrating:%i,", m->data.input[p % r->nu],
                 m->data.output[p / r->nu], m->g[p].integrating);
        numbers_json(&m->g[p], t);
        json_add(t, "error:{");
        numbers_json(&m->error[p], t);
        json_add(t, "},");
        response_json(&m->g[p], &m->error[p], t);
        json_add(t, "}");
    }
    json_add(t, "]");
}

static void model_json(const struct modelling *m, struct text *t)
{
    const struct apc_record *r = &m->data.record;

    json_add(t, "{");
    range_json(t, m->selection.since, m->selection.until);
    json_add(t, "period:%g, samples:%zu, records:%zu, inputs:[", r->Ts, r->n, m->windows);
    for (size_t j = 0; j < r->nu; j++)
        json_add(t, "%s", m->data.input[j]);
    json_add(t, "], outputs:[");
    for (size_t i = 0; i < r->ny; i++)
        json_add(t, "{name:%s, fit:%.4g, white:%.4g, independent:%.4g, missing:%zu, longest:%zu}",
                 m->data.output[i], m->judged[i].fit, m->judged[i].white, m->judged[i].independent,
                 m->data.gaps[i].missing, m->data.gaps[i].longest);
    json_add(t, "],");
    grid_warnings_json(m->warning, m->warnings, t);
    json_add(t, ",");
    cells_json(m, t);
    json_add(t, "}");
}

void get_model(struct ui *ui, struct request *r, struct apc_store *store)
{
    struct modelling m = {.selection = {.from = -HUGE_VAL}};
    struct apc_error why = {0};
    int rc = 0;

    if (query_windows(r, &m) && query_whole(r, "order", 1, 2, &m.order) &&
        split_signals(r, "inputs", &m.names[0], m.selection.input, &m.selection.inputs) &&
        split_signals(r, "outputs", &m.names[1], m.selection.output, &m.selection.outputs) &&
        choose_grid(ui, r, store, &m)) {
        rc = read_windows(&m, store, &why);
        if (rc == 0)
            rc = find_model(&m, &why);
        if (rc == 0)
            model_json(&m, &r->reply);
    }
    if (rc == APC_ECONN || rc == APC_ETIMEDOUT || rc == APC_ESTORE || rc == APC_ENOMEM)
        fault_store(r, rc, store);
    else if (rc < 0)
        fault_set(&r->fault, 422, "record", NULL, "%s", why.text);
    for (size_t i = 0; i < m.windows; i++)
        identify_data_free(&m.part[i]);
    identify_data_free(&m.data);
    free(m.warning);
    free(m.judged);
    free(m.g);
    free(m.names[0]);
    free(m.names[1]);
}

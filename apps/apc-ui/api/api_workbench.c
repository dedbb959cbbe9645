/* SPDX-License-Identifier: BSD-3-Clause */
/* The engineer's workbench: a model from the plant's own record, and what a loop would do on it with other tuning. */
#include <apcidentify.h>
#include <apctune.h>

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "apc-ui/api/api.h"
#include "grid/grid.h"
#include "simulation/simulation.h"

/* ---- A model from the record ------------------------------------------------------------------ */

#define CELLS    4 /* pairs of an input and an output: with so many samples, over all pairs, it takes seconds */
#define SAMPLES  3000
#define ROWS     1000000 /* of a signal in the window */
#define HOUR     (3600 * APC_NS_PER_S)
#define LARGE    1e6
#define SHARE    0.67 /* of the record that is fitted to; the rest judges */
#define POINTS   80   /* of a step response */
#define SETTLES  5.0  /* time constants that it is drawn for */
#define INTERVAL 1.96 /* standard errors of 95 % */

struct modelling {
    struct identify_selection selection;
    char *names[2];
    struct identify_data data;
    struct apc_transfer *g, *error; /* [outputs * inputs] */
    struct apc_validation *judged;  /* [outputs] */
};

/* "u1,u2" into its parts, cut in place; false: the fault is set. */
static bool split_signals(struct request *r, const char *field, char **copy, char *name[IDENTIFY_SIGNALS],
                          size_t *n)
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

static int note_record_begin(void *ctx, const struct apc_sample *row)
{
    *(apc_ns *)ctx = row->time;
    return 1;
}

/* The period of the grid: that of the first output, or as many of them as leave few enough samples of the record, which
 * may begin later than the time that was asked for. */
static bool choose_grid(struct ui *ui, struct request *r, struct apc_store *store, struct modelling *m)
{
    const struct apc_range range = {.since = m->selection.since, .until = m->selection.until};
    apc_ns first = 0;
    int id = 0;
    const size_t cells = m->selection.inputs * m->selection.outputs;
    double period = 0.0;

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
    if (!(period > 0.0))
        return true; /* its record tells */
    const int rc = apc_store_history(store, APC_SENSOR, id, &range, note_record_begin, &first);
    if (rc < 0) {
        fault_store(r, rc, store);
        return false;
    }
    m->selection.since = first > m->selection.since ? first : m->selection.since;
    const double span = apc_ns_to_s(m->selection.until - m->selection.since);
    if (span / period > ROWS)
        return fault_set(&r->fault, 422, "parameter", "since", "more than %d rows: ask for less time at once",
                         ROWS);
    m->selection.period = period * ceil(span / period * (double)cells / SAMPLES);
    return true;
}

static int find_model(struct modelling *m, struct apc_error *why)
{
    const struct apc_identify_transfer_options options = {.size = sizeof options};
    const struct apc_record *all = &m->data.record;
    const size_t cells = all->nu * all->ny;
    struct apc_record first = *all;
    struct apc_linear *linear = NULL;
    double u0[CELLS], y0[CELLS];
    int rc = apc_record_check(all, why);

    m->g = calloc(2 * cells + 1, sizeof *m->g);
    m->judged = calloc(all->ny + 1, sizeof *m->judged);
    if (rc == 0 && (!m->g || !m->judged))
        rc = apc_fail(why, APC_ENOMEM, "out of memory");
    first.n = (size_t)((double)all->n * SHARE);
    m->error = m->g ? m->g + cells : NULL;
    if (rc == 0)
        rc = apc_identify_transfer(&first, &options, m->g, m->error, u0, y0, NULL, why);
    if (rc == 0)
        rc = apc_linear_from_transfer(&linear, all->ny, all->nu, 0, m->g, u0, y0, all->Ts, why);
    if (rc == 0)
        rc = apc_validate(linear, NULL, all, first.n, m->judged, NULL, why);
    apc_linear_destroy(linear);
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
    json_add(t, "period:%g, samples:%zu, inputs:[", r->Ts, r->n);
    for (size_t j = 0; j < r->nu; j++)
        json_add(t, "%s", m->data.input[j]);
    json_add(t, "], outputs:[");
    for (size_t i = 0; i < r->ny; i++)
        json_add(t, "{name:%s, fit:%.4g, white:%.4g, independent:%.4g, missing:%zu, longest:%zu}",
                 m->data.output[i], m->judged[i].fit, m->judged[i].white, m->judged[i].independent,
                 m->data.gaps[i].missing, m->data.gaps[i].longest);
    json_add(t, "],");
    cells_json(m, t);
    json_add(t, "}");
}

void get_model(struct ui *ui, struct request *r, struct apc_store *store)
{
    struct modelling m = {.selection = {.from = -HUGE_VAL}};
    struct apc_error why = {0};
    const struct grid_source from = {.file = "the record", .store = store, .read = stored_read};
    int rc = 0;

    if (query_range(r, HOUR, 0, &m.selection.since, &m.selection.until) &&
        split_signals(r, "inputs", &m.names[0], m.selection.input, &m.selection.inputs) &&
        split_signals(r, "outputs", &m.names[1], m.selection.output, &m.selection.outputs) &&
        choose_grid(ui, r, store, &m)) {
        rc = grid_read(&m.data, &from, &m.selection, &why);
        if (rc == 0)
            rc = find_model(&m, &why);
        if (rc == 0)
            model_json(&m, &r->reply);
    }
    if (rc == APC_ECONN || rc == APC_ETIMEDOUT || rc == APC_ESTORE || rc == APC_ENOMEM)
        fault_store(r, rc, store);
    else if (rc < 0)
        fault_set(&r->fault, 422, "record", NULL, "%s", why.text);
    identify_data_free(&m.data);
    free(m.judged);
    free(m.g);
    free(m.names[0]);
    free(m.names[1]);
}

/* ---- What a loop would do --------------------------------------------------------------------- */

#define TICKS 8000 /* of a preview at most: some ten ms of computing */
#define DRAWN 400  /* points of a curve, two for each of its parts */

enum preview_tuning { PREVIEW_KP, PREVIEW_TAU_I, PREVIEW_TAU_D, PREVIEW_TUNINGS };
static const char *const preview_names[PREVIEW_TUNINGS] = {"Kp", "tau_i", "tau_d"};

/* A tuning, and what comes of it. */
struct tried {
    struct apc_pid_tuning tuning;
    struct apc_margins margins;
    struct loop_preview curves;
};

struct workbench {
    struct experiment e;
    struct controller_loop loop;
    struct controller *controller; /* the loop's, to be changed */
    struct apc_transfer g;
    double Ts, y0, u0, step, tau_c;
    const char *rule;
    bool derivative;
    bool asked[PREVIEW_TUNINGS];
    double value[PREVIEW_TUNINGS];
    struct tried present, proposed;
    struct apc_pid_tuning suggested;
    bool suggests;
};

static bool query_real(struct request *r, const char *name, double low, double high, double *value,
                       bool *asked)
{
    const char *text = request_query(r, name);

    if (asked)
        *asked = text != NULL;
    if (text && (apc_number_parse(text, value) < 0 || !(*value >= low && *value <= high)))
        return fault_set(&r->fault, 400, "parameter", name, "\"%s\" must be a number from %g to %g", name,
                         low, high);
    return true;
}

static bool query_workbench(struct request *r, struct workbench *w, int64_t *loop)
{
    static const char *const rules[] = {"simc", "lambda", "relay", NULL};
    int64_t integrating = 0;
    size_t rule = 0;

    w->rule = request_query(r, "rule") ? request_query(r, "rule") : rules[0];
    while (rules[rule] && strcmp(rules[rule], w->rule) != 0)
        rule++;
    if (!rules[rule])
        return fault_set(&r->fault, 400, "parameter", "rule", "\"rule\" must be simc, lambda or relay");
    if (!query_whole(r, "loop", 1, INT32_MAX, loop) || !query_whole(r, "integrating", 0, 1, &integrating))
        return false;
    if (*loop == 0)
        return fault_set(&r->fault, 422, "parameter", "loop", "\"loop\" is needed: the id of a loop");
    w->g.integrating = integrating;
    for (size_t i = 0; i < PREVIEW_TUNINGS; i++)
        if (!query_real(r, preview_names[i], i ? 0.0 : -LARGE, LARGE, &w->value[i], &w->asked[i]))
            return false;
    return query_real(r, "gain", -LARGE, LARGE, &w->g.gain, NULL) &&
           query_real(r, "zero", -LARGE, LARGE, &w->g.zero, NULL) &&
           query_real(r, "tau1", 0.0, LARGE, &w->g.tau[0], NULL) &&
           query_real(r, "tau2", 0.0, LARGE, &w->g.tau[1], NULL) &&
           query_real(r, "dead_time", 0.0, LARGE, &w->g.dead_time, NULL) &&
           query_real(r, "tau_c", 0.0, LARGE, &w->tau_c, NULL);
}

/* A law that is the user's own is not run here. */
static bool fault_own_law(struct request *r, const struct experiment *e)
{
    for (size_t i = 0; i < e->n_controllers; i++)
        if (strchr(e->controllers[i].law_name, '/'))
            return fault_set(&r->fault, 422, "loop", "loop",
                             "%.80s is not built in, so the command line alone tries it: apc simulate",
                             e->controllers[i].law_name);
    return true;
}

bool request_experiment(struct request *r, struct experiment *e, struct apc_store *store)
{
    struct experiment_source from = {.file = "the store's experiment"};
    struct apc_error why = {0};
    char *text = NULL;
    int64_t revision = 0;
    int rc = experiment_text(store, &text, &revision, &why);

    from.text = text;
    if (rc < 0)
        fault_store(r, rc, store);
    else if (revision == 0)
        rc = APC_ENOTFOUND;
    else if ((rc = experiment_parse(e, &from, 0, NULL, &why)) == 0 && fault_own_law(r, e)) {
        experiment_free(e);
        rc = experiment_parse(e, &from, EXPERIMENT_LAW, NULL, &why);
    }
    free(text);
    if (rc < 0)
        fault_set(&r->fault, 422, "loop", "loop", "the store has no experiment to try it with: %s",
                  why.text[0] ? why.text : "it describes none");
    return !r->fault.http;
}

/* The loop, of a law with such numbers, from the plant to the plant. */
static bool find_preview_loop(struct request *r, struct workbench *w, int64_t loop)
{
    int id;

    if (loop > (int64_t)controllers_loops(&w->e))
        return fault_set(&r->fault, 404, "loop", "loop", "there is no loop with the id %jd", (intmax_t)loop);
    w->loop = controllers_loop(&w->e, (size_t)loop - 1);
    const struct controller *c = w->loop.of;
    if (c->law->whole || !c->pair || c->pair[w->loop.u].setpoint == 0 ||
        c->u[w->loop.u].table != APC_ACTUATOR ||
        c->y[c->pair[w->loop.u].measurement - 1].table != APC_SENSOR ||
        c->z[c->pair[w->loop.u].setpoint - 1].table != APC_SETPOINT ||
        !controllers_loop_parameter(&w->loop, "Kp", &id) ||
        !controllers_loop_parameter(&w->loop, "tau_i", &id))
        return fault_set(&r->fault, 422, "loop", "loop",
                         "the rules are of PI and PID loops from a measurement to an output of the plant");
    w->controller = &w->e.controllers[c - w->e.controllers];
    w->controller->acting = 0; /* here it has its outputs */
    w->controller->shadow = false;
    w->derivative = controllers_loop_parameter(&w->loop, "tau_d", &id) != NULL;
    w->Ts = apc_ns_to_s(c->rhythm.period);
    return true;
}

/* The tuning that is in force, and where the loop is. */
static bool read_present(struct request *r, struct workbench *w, struct apc_store *store)
{
    struct controller *c = w->controller;
    const size_t n = apc_law_parameters(c->law, &c->dim);
    const struct apc_tag *y = &w->e.y[c->y[c->pair[w->loop.u].measurement - 1].at].tag,
                         *u = controllers_output(&w->e, w->loop);
    struct apc_sample *s = calloc(n + 2, sizeof *s);
    int rc = s ? 0 : APC_ENOMEM;

    for (size_t i = 0; i < n && rc == 0; i++)
        s[i] = (struct apc_sample){.table = APC_TUNING, .id = c->first_tuning + (int)i};
    if (rc == 0) {
        s[n] = (struct apc_sample){.table = APC_SENSOR, .id = y->id};
        s[n + 1] = (struct apc_sample){.table = APC_ACTUATOR, .id = u->id};
        rc = apc_store_read(store, s, n + 2);
    }
    for (size_t i = 0; i < n && rc >= 0; i++)
        if (s[i].seq > 0)
            c->tuning[i] = s[i].value;
    if (rc >= 0) {
        w->y0 = s[n].seq > 0 && isfinite(s[n].value) ? s[n].value : 0.0;
        w->u0 = s[n + 1].seq > 0 && isfinite(s[n + 1].value) ? s[n + 1].value : 0.0;
        w->step = y->high - y->low < APC_VALUE_MAX ? 0.1 * (y->high - y->low) : 1.0;
        if (w->y0 + w->step > y->high)
            w->step = -w->step;
    } else {
        fault_store(r, rc, store);
    }
    free(s);
    return rc >= 0;
}

static struct apc_pid_tuning tuning_of(const struct workbench *w)
{
    int id;

    return (struct apc_pid_tuning){
        .Kp = *controllers_loop_parameter(&w->loop, "Kp", &id),
        .tau_i = *controllers_loop_parameter(&w->loop, "tau_i", &id),
        .tau_d = w->derivative ? *controllers_loop_parameter(&w->loop, "tau_d", &id) : 0.0};
}

static int suggest_by_rule(struct workbench *w, struct apc_error *why)
{
    /* of what integrates the first lag is already one behind another */
    const bool derivative = w->derivative && w->g.tau[w->g.integrating ? 0 : 1] > 0.0;
    double gain, every;

    if (strcmp(w->rule, "relay") != 0)
        return apc_tune_pid(&w->g, strcmp(w->rule, "lambda") ? APC_TUNE_SIMC : APC_TUNE_LAMBDA, derivative,
                            w->tau_c, w->Ts, &w->suggested, why);
    const int rc = apc_tune_limit(&w->g, w->Ts, &gain, &every, why);
    return rc < 0 ? rc : apc_tune_relay(gain, every, derivative, &w->suggested, why);
}

static int try_tuning(struct workbench *w, struct tried *t, struct apc_error *why)
{
    const double lag = w->g.dead_time + w->g.tau[0] + w->g.tau[1] + w->Ts,
                 lasts = 2.0 * (6.0 * lag + 3.0 * fmin(w->proposed.tuning.tau_i, 5.0 * lag)),
                 reach = fabs(w->g.gain) * (w->g.integrating ? 4.0 * lag : 1.0);
    int id, rc;

    *controllers_loop_parameter(&w->loop, "Kp", &id) = t->tuning.Kp;
    *controllers_loop_parameter(&w->loop, "tau_i", &id) = t->tuning.tau_i;
    if (w->derivative)
        *controllers_loop_parameter(&w->loop, "tau_d", &id) = t->tuning.tau_d;
    t->margins.size = sizeof t->margins;
    rc = apc_tune_margins(&w->g, &t->tuning, w->Ts, &t->margins, why);
    t->curves = (struct loop_preview){.e = &w->e,
                                      .loop = (size_t)controllers_loop_id(w->loop) - 1,
                                      .g = w->g,
                                      .y0 = w->y0,
                                      .u0 = w->u0,
                                      .step = w->step,
                                      .load = w->step / reach,
                                      .n = (size_t)fmin(fmax(lasts / w->Ts, 40.0), TICKS)};
    return rc < 0 ? rc : loop_preview_run(&t->curves, why);
}

void curve_json(const char *name, const double *at, double Ts, const double *v, size_t n, struct text *t)
{
    const size_t part = (2 * n + DRAWN - 1) / DRAWN < 2 ? 1 : (2 * n + DRAWN - 1) / DRAWN;
    struct text times = {0};

    json_add(t, "%s:{v:[", name);
    json_add(&times, "[");
    for (size_t k = 0; k < n; k += part) {
        size_t first = k, last = k;

        for (size_t i = k; i < k + part && i < n; i++) {
            first = v[i] < v[first] ? i : first;
            last = v[i] > v[last] ? i : last;
        }
        if (first > last) {
            const size_t swapped = first;
            first = last;
            last = swapped;
        }
        json_add(t, "%.6g", v[first]);
        json_add(&times, "%.6g", at ? at[first] : (double)first * Ts);
        if (last > first) {
            json_add(t, "%.6g", v[last]);
            json_add(&times, "%.6g", at ? at[last] : (double)last * Ts);
        }
    }
    json_add(&times, "]");
    json_add(t, "], t:");
    json_text_add(t, &times);
    json_add(t, "}");
    text_free(&times);
}

static void tried_json(const struct workbench *w, const char *name, const struct tried *t, struct text *to)
{
    const struct loop_preview *c = &t->curves;
    double iae = 0.0, load = 0.0, overshoot = 0.0;

    for (size_t k = 0; k < c->n; k++) {
        const double left = (w->y0 + w->step - c->y[k]) / w->step;

        *(k < c->n / 2 ? &iae : &load) += fabs(left * w->step) * c->Ts;
        overshoot = k < c->n / 2 ? fmax(overshoot, -100.0 * left) : overshoot;
    }
    json_add(to, "%s:{Kp:%.4g, tau_i:%.4g, tau_d:%.4g, stable:%i, gain_margin:%.4g, phase_margin:%.4g,", name,
             t->tuning.Kp, t->tuning.tau_i, t->tuning.tau_d, t->margins.stable, t->margins.gain,
             t->margins.phase);
    json_add(to, "delay_margin:%.4g, sensitivity:%.4g, iae:%.4g, iae_disturbance:%.4g, overshoot:%.4g,",
             t->margins.delay, t->margins.sensitivity, iae, load, overshoot);
    curve_json("y", NULL, c->Ts, c->y, c->n, to);
    curve_json("u", NULL, c->Ts, c->u, c->n, to);
    json_add(to, "}");
}

static int preview_tunings(struct workbench *w, struct apc_error *why)
{
    double *const proposed[] = {&w->proposed.tuning.Kp, &w->proposed.tuning.tau_i, &w->proposed.tuning.tau_d};
    int rc = suggest_by_rule(w, why);

    w->suggests = rc == 0;
    if (rc < 0 && !w->asked[PREVIEW_KP])
        return rc;
    w->present.tuning = tuning_of(w);
    w->proposed.tuning = w->suggests ? w->suggested : w->present.tuning;
    for (size_t i = 0; i < PREVIEW_TUNINGS; i++)
        *proposed[i] = w->asked[i] ? w->value[i] : *proposed[i];
    rc = try_tuning(w, &w->proposed, why);
    return rc < 0 || w->present.tuning.Kp == 0.0 ? rc : try_tuning(w, &w->present, why);
}

void get_preview(struct ui *ui, struct request *r, struct apc_store *store)
{
    struct workbench w = {.step = 1.0};
    struct apc_error why = {0};
    int64_t loop = 0;
    int rc;

    (void)ui;
    if (!query_workbench(r, &w, &loop) || !request_experiment(r, &w.e, store) ||
        !find_preview_loop(r, &w, loop) || !read_present(r, &w, store)) {
        experiment_free(&w.e);
        return;
    }
    rc = preview_tunings(&w, &why);
    if (rc < 0)
        fault_set(&r->fault, 422, "tuning", NULL, "%s", why.text);
    else {
        const size_t half = w.proposed.curves.n / 2;

        json_add(&r->reply, "{loop:%d, step:%g, begins:%g,", (int)loop, w.step, (double)half * w.Ts);
        if (w.suggests)
            json_add(&r->reply, "suggested:{Kp:%.4g, tau_i:%.4g, tau_d:%.4g},", w.suggested.Kp,
                     w.suggested.tau_i, w.suggested.tau_d);
        else
            json_add(&r->reply, "suggested:null,");
        if (w.present.curves.y)
            tried_json(&w, "present", &w.present, &r->reply);
        else
            json_add(&r->reply, "present:null,");
        tried_json(&w, "proposed", &w.proposed, &r->reply);
        json_add(&r->reply, "}");
    }
    loop_preview_free(&w.present.curves);
    loop_preview_free(&w.proposed.curves);
    experiment_free(&w.e);
}

/* SPDX-License-Identifier: BSD-3-Clause */
/* The engineer's workbench: what a loop would do on a model with other tuning. */
#include <apctune.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "analyze/linear.h"
#include "apc-ui/api/api.h"
#include "simulation/simulation.h"

#define LARGE 1e6
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
    struct apc_transfer g, error;  /* standard errors; 0: the number is certain */
    bool uncertain;
    size_t ticks;
    double load; /* of the disturbance */
    double Ts, y0, u0, step, tau_c;
    const char *rule;
    bool derivative;
    bool asked[PREVIEW_TUNINGS];
    double value[PREVIEW_TUNINGS];
    struct tried present, proposed, worst; /* worst: proposed, with the worst of the models */
    size_t unstable;                       /* of the models */
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

/* Its numbers, and their standard errors: -1, or so large as no number may be: the record does not tell it. */
static bool query_transfer(struct request *r, struct workbench *w)
{
    const struct {
        const char *name, *error;
        double low, *value, *deviation;
    } of[] = {{"gain", "gain_error", -LARGE, &w->g.gain, &w->error.gain},
              {"zero", "zero_error", -LARGE, &w->g.zero, &w->error.zero},
              {"tau1", "tau1_error", 0.0, &w->g.tau[0], &w->error.tau[0]},
              {"tau2", "tau2_error", 0.0, &w->g.tau[1], &w->error.tau[1]},
              {"dead_time", "dead_time_error", 0.0, &w->g.dead_time, &w->error.dead_time}};

    for (size_t i = 0; i < sizeof of / sizeof *of; i++) {
        if (!query_real(r, of[i].name, of[i].low, LARGE, of[i].value, NULL) ||
            !query_real(r, of[i].error, -1.0, APC_VALUE_MAX, of[i].deviation, NULL))
            return false;
        w->uncertain |= *of[i].deviation != 0.0;
        if (*of[i].deviation < 0.0 || *of[i].deviation > LARGE)
            *of[i].deviation = (double)NAN;
    }
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
    return query_transfer(r, w) && query_real(r, "tau_c", 0.0, LARGE, &w->tau_c, NULL);
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

static int try_tuning(struct workbench *w, const struct apc_transfer *g, struct tried *t,
                      struct apc_error *why)
{
    int id, rc;

    *controllers_loop_parameter(&w->loop, "Kp", &id) = t->tuning.Kp;
    *controllers_loop_parameter(&w->loop, "tau_i", &id) = t->tuning.tau_i;
    if (w->derivative)
        *controllers_loop_parameter(&w->loop, "tau_d", &id) = t->tuning.tau_d;
    t->margins.size = sizeof t->margins;
    rc = apc_tune_margins(g, &t->tuning, w->Ts, &t->margins, why);
    t->curves = (struct loop_preview){.e = &w->e,
                                      .loop = (size_t)controllers_loop_id(w->loop) - 1,
                                      .g = *g,
                                      .y0 = w->y0,
                                      .u0 = w->u0,
                                      .step = w->step,
                                      .load = w->load,
                                      .n = w->ticks};
    return rc < 0 ? rc : loop_preview_run(&t->curves, why);
}

/* Its dead time may be longer than what is simulated: then it is left out. */
static int try_worst(struct workbench *w, struct apc_error *why)
{
    struct linear_worst worst;
    int rc = linear_worst(&worst, &w->g, &w->error, &w->proposed.tuning, w->Ts, why);

    w->unstable = worst.unstable;
    w->worst.tuning = w->proposed.tuning;
    if (rc == 0 && (rc = try_tuning(w, &worst.g, &w->worst, why)) < 0) {
        loop_preview_free(&w->worst.curves);
        rc = rc == APC_ENOMEM ? rc : 0;
    }
    return rc;
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
    const double lag = w->g.dead_time + w->g.tau[0] + w->g.tau[1] + w->Ts,
                 lasts = 2.0 * (6.0 * lag + 3.0 * fmin(w->proposed.tuning.tau_i, 5.0 * lag)),
                 reach = fabs(w->g.gain) * (w->g.integrating ? 4.0 * lag : 1.0);
    w->ticks = (size_t)fmin(fmax(lasts / w->Ts, 40.0), TICKS);
    w->load = w->step / reach;
    rc = try_tuning(w, &w->g, &w->proposed, why);
    if (rc == 0 && w->uncertain)
        rc = try_worst(w, why);
    return rc < 0 || w->present.tuning.Kp == 0.0 ? rc : try_tuning(w, &w->g, &w->present, why);
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
        if (w.worst.curves.y) {
            json_add(&r->reply, "models:%d, unstable:%zu,", LINEAR_WORST_OF, w.unstable);
            tried_json(&w, "worst", &w.worst, &r->reply);
        } else {
            json_add(&r->reply, "models:0, unstable:0, worst:null,");
        }
        tried_json(&w, "proposed", &w.proposed, &r->reply);
        json_add(&r->reply, "}");
    }
    loop_preview_free(&w.present.curves);
    loop_preview_free(&w.proposed.curves);
    loop_preview_free(&w.worst.curves);
    experiment_free(&w.e);
}

/* SPDX-License-Identifier: BSD-3-Clause */
/* A controller in shadow: what it would have done, whether it may act, and that it does from now on. */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "apc-ui/api/api.h"
#include "simulation/simulation.h"

#define HOUR  (3600 * APC_NS_PER_S)
#define TICKS 50000 /* of all controllers in the time, twice over: some s of computing */

/* ---- What it would have done ------------------------------------------------------------------ */

struct shadowing {
    struct closed closed;
    struct samples made; /* had it acted */
    struct figures recorded, would;
    struct loops loops; /* of the experiment */
    const struct controller *to;
};

static bool find_shadow(struct request *r, const struct experiment *e, const char *name,
                        const struct controller **to)
{
    for (size_t i = 0; i < e->n_controllers; i++)
        if (!strcmp(e->controllers[i].name, name) && e->controllers[i].acting)
            *to = &e->controllers[i];
    return *to || fault_set(&r->fault, 404, "variable", "controller",
                            "there is no controller \"%.60s\" that has its outputs with another one", name);
}

static bool is_short_enough(struct request *r, const struct experiment *e, apc_ns since, apc_ns until)
{
    double ticks = 0.0;

    for (size_t i = 0; i < e->n_controllers; i++)
        ticks += (double)(until - since) / (double)e->controllers[i].rhythm.period;
    return ticks <= TICKS ||
           fault_set(&r->fault, 422, "parameter", "since",
                     "more than %d ticks of its controllers: ask for less time at once", TICKS);
}

static int run_shadow(struct shadowing *s, struct apc_store *store, const char *name, apc_ns since,
                      apc_ns until, struct apc_error *why)
{
    const struct replay_range of = {.store = store, .since = since, .until = until};
    const struct experiment *e = &s->closed.was;
    int rc = closed_load(&s->closed, &of, why);

    for (size_t i = 0; i < e->n_controllers && rc == 0; i++)
        if (!strcmp(e->controllers[i].name, name) && e->controllers[i].acting)
            s->to = &e->controllers[i];
    if (rc == 0 && !s->to)
        return apc_fail(why, APC_ENOTFOUND, "%s did not run in that time", name);
    if (rc == 0 &&
        ((rc = closed_promote(&s->closed, s->to)) < 0 || (rc = controllers_describe(e, &s->loops)) < 0))
        return apc_fail(why, rc, "out of memory");
    if (rc == 0)
        rc = closed_run(&s->closed, NULL, &s->made, why);
    if (rc == 0 &&
        ((rc = closed_figures(&s->recorded, &s->closed.all, e, s->closed.since, s->closed.end)) < 0 ||
         (rc = closed_figures(&s->would, &s->made, e, s->closed.since, s->closed.end)) < 0))
        return apc_fail(why, rc, "out of memory");
    return rc;
}

/* Of one variable, from then on, its times in s since then. Returns how many, at most @p room. */
static size_t collect_curve(const struct samples *all, enum apc_table table, int id, apc_ns since, double *t,
                            double *v)
{
    size_t n = 0;

    for (size_t i = 0; i < all->n; i++)
        if (all->at[i].table == table && all->at[i].id == id && all->at[i].time >= since &&
            isfinite(all->at[i].value)) {
            t[n] = apc_ns_to_s(all->at[i].time - since);
            v[n++] = all->at[i].value;
        }
    return n;
}

/* Of two loops for one measurement there is one figure. */
static double iae_of_loop(const struct figures *f, const struct loops_loop *loop)
{
    for (size_t i = 0; i < f->n_loops; i++)
        if ((int)f->loop[i].y + 1 == loop->measurement && (int)f->loop[i].z + 1 == loop->setpoint)
            return f->of[i].figure[METRIC_IAE];
    return (double)NAN;
}

static void shadow_side_json(const struct shadowing *s, const char *name, const struct samples *all,
                             const struct figures *figures, const struct loops_loop *loop, struct text *t)
{
    double *time = calloc(2 * all->n + 1, sizeof *time), *value = time ? time + all->n : NULL, travel = 0.0;
    const apc_ns since = s->closed.since;
    size_t n = 0;

    json_add(t, "%s:{iae:%.6g,", name, iae_of_loop(figures, loop));
    if (time && loop->measurement)
        n = collect_curve(all, APC_SENSOR, loop->measurement, since, time, value);
    curve_json("y", time, 0.0, value, n, t);
    n = time ? collect_curve(all, loop->table, loop->output, since, time, value) : 0;
    for (size_t k = 1; k < n; k++)
        travel += fabs(value[k] - value[k - 1]);
    json_add(t, ",");
    curve_json("u", time, 0.0, value, n, t);
    json_add(t, "travel:%.6g}", travel);
    free(time);
}

static void shadowing_json(const struct shadowing *s, struct text *t)
{
    const struct closed *c = &s->closed;
    const struct experiment *e = &c->was;

    json_add(t, "{");
    range_json(t, c->start + c->since, c->start + c->end);
    json_add(t, "controller:%s, notes:[", s->to->name);
    for (size_t i = 0; i < c->n_notes; i++)
        json_add(t, "%s", c->note[i]);
    json_add(t, "], left_out:{");
    for (size_t k = 0; k < e->dim.ny; k++)
        json_add(t, "%s:%.4g", e->y[k].tag.name, closed_left_out(c, k));
    json_add(t, "}, loops:[");
    for (size_t i = 0; i < s->loops.n; i++) {
        const struct loops_loop *loop = &s->loops.at[i];

        if (strcmp(s->loops.controller[loop->controller].name, s->to->name) != 0)
            continue;
        json_add(t, "{id:%d,", loop->id);
        shadow_side_json(s, "recorded", &c->all, &s->recorded, loop, t);
        json_add(t, ",");
        shadow_side_json(s, "would", &s->made, &s->would, loop, t);
        json_add(t, "}");
    }
    json_add(t, "]}");
}

void get_shadow(struct ui *ui, struct request *r, struct apc_store *store)
{
    const char *name = request_query(r, "controller") ? request_query(r, "controller") : "";
    struct shadowing s = {.to = NULL};
    struct experiment e = {0};
    struct apc_error why = {0};
    const struct controller *to = NULL;
    apc_ns since, until;
    int rc = 0;

    (void)ui;
    if (query_range(r, HOUR, 0, &since, &until) && request_experiment(r, &e, store) &&
        find_shadow(r, &e, name, &to) && is_short_enough(r, &e, since, until))
        rc = run_shadow(&s, store, name, since, until, &why);
    if (rc == APC_ECONN || rc == APC_ETIMEDOUT || rc == APC_ESTORE || rc == APC_ENOMEM)
        fault_store(r, rc, store);
    else if (rc < 0)
        fault_set(&r->fault, 422, "record", NULL, "%s", why.text);
    else if (s.to)
        shadowing_json(&s, &r->reply);
    figures_free(&s.recorded);
    figures_free(&s.would);
    samples_free(&s.made);
    loops_free(&s.loops);
    closed_free(&s.closed);
    experiment_free(&e);
}

/* ---- Promotion -------------------------------------------------------------------------------- */

struct promotion_order {
    char reason[REASON_LEN];
    const char *to, *from;
};

static bool is_as_described(struct request *r, struct apc_store *store, const struct promotion *p)
{
    struct apc_error reason;
    struct change_fault why;
    const int rc = simulation_as_described(store, p->to->name, &p->tick, &reason);

    if (rc == APC_ECONN || rc == APC_ETIMEDOUT || rc == APC_ESTORE || rc == APC_ENOMEM)
        fault_store(r, rc, store);
    else if (rc < 0)
        fault_set(&r->fault, 422, "loop", "controller", "%s", reason.text);
    else if (rc == 0) {
        promotion_stale(p, &why);
        fault_change(r, &why, "controller");
    }
    return !r->fault.http;
}

static bool may_promote(struct ui *ui, struct request *r, struct apc_store *store, const struct promotion *p,
                        const char *from)
{
    const struct loops_controller *acts = promotion_acting(p);
    struct change_fault why;

    if (!acts || strcmp(acts->name, from) != 0)
        return fault_set(
            &r->fault, 409, "stale", "from",
            "%s acts, not %.60s: another user has promoted a controller meanwhile. Nothing was written",
            acts ? acts->name : "nobody", from);
    pthread_mutex_lock(&ui->model.mutex);
    const struct loops_controller *known = loops_controller(&ui->model.plant.loops, p->to->name);
    const bool ticks = known && model_ticks(&ui->model, (size_t)(known - ui->model.plant.loops.controller),
                                            apc_clock_plant()) != 0;
    pthread_mutex_unlock(&ui->model.mutex);
    if (!ticks) {
        promotion_silent(p, &why);
        return fault_change(r, &why, "controller");
    }
    if (promotion_in_service(p, &why) < 0)
        return fault_change(r, &why, "controller");
    return is_as_described(r, store, p);
}

static void carry_out_promotion(struct ui *ui, struct request *r, struct apc_store *store,
                                struct promotion *p, const struct promotion_order *o)
{
    struct apc_event event;
    struct change_fault why;
    char note[60];
    int rc = apc_store_connect(store);

    if (rc >= 0 && fault_history(r, store))
        return;
    if (rc >= 0)
        rc = promotion_look(p, store);
    if (rc < 0) {
        fault_store(r, rc, store);
        return;
    }
    if (!may_promote(ui, r, store, p, o->from))
        return;
    snprintf(note, sizeof note, " (from %.50s)", r->from->address);
    rc = promotion_put(p, store, r->session.user, note, o->reason, &event, &why);
    if (rc < 0) {
        fault_change(r, &why, NULL);
        return;
    }
    audit(ui, store, &event);
    event_json(&event, &r->reply);
}

void post_promote(struct ui *ui, struct request *r, struct apc_store *store)
{
    static const char *const members[] = {"controller", "from", "reason", NULL};
    struct promotion_order o = {.to = NULL};
    struct known_plant plant = {0};
    struct promotion p;
    double mark[2]; /* of the tick row: the rest is not wanted */
    struct change_fault why;
    json_t *body = body_parse(r->body, r->n, members, &r->fault);

    if (body && member_text(body, "controller", &o.to, &r->fault) &&
        member_text(body, "from", &o.from, &r->fault) && request_reason(r, body, o.reason) &&
        request_may_write(ui, r)) {
        if (copy_model_plant(ui, &plant) < 0)
            fault_store(r, APC_ENOMEM, store);
        else if (promotion_find(&p, &plant.loops, o.to, &why) < 0)
            fault_change(r, &why, "controller");
        else {
            p.tick.value = mark;
            p.tick.room = 2;
            carry_out_promotion(ui, r, store, &p, &o);
        }
    }
    known_free(&plant);
    json_decref(body);
}

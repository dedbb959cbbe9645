/* SPDX-License-Identifier: BSD-3-Clause */
/* apcrun.h: what strangers see of this room. */
#include <apcrun.h>

#include <math.h>
#include <stdatomic.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "base/base_internal.h"
#include "experiment/experiment.h"
#include "figures/figures.h"
#include "files/settings.h"
#include "simulation.h"

/* An experiment never changes once it is read: a change makes another one, and who uses this one goes on. */
struct reading {
    atomic_uint users;
    struct experiment e;
};

struct apc_experiment {
    struct reading *now;
    struct record record; /* of a run; less and less of it, as settings are changed */
};

struct apc_simulation {
    struct reading *of;
    struct simulation s;
    struct apc_error why;
};

/* ---- Experiments --------------------------------------------------------------------------- */

static int read_experiment(struct reading **out, const struct experiment_source *from, struct apc_error *why)
{
    struct reading *r = calloc(1, sizeof *r);
    *out = NULL;
    if (!r)
        return apc_fail(why, APC_ENOMEM, "out of memory");
    atomic_init(&r->users, 1);
    int rc = experiment_parse(&r->e, from, EXPERIMENT_MODEL | EXPERIMENT_LAW, NULL, why);
    if (rc < 0)
        free(r);
    else
        *out = r;
    return rc;
}

static void leave_reading(struct reading *r)
{
    if (!r || atomic_fetch_sub(&r->users, 1) > 1)
        return;
    experiment_free(&r->e);
    free(r);
}

int apc_experiment_load(struct apc_experiment **out, const char *file, const char *text,
                        struct apc_error *why)
{
    char path[EXPERIMENT_PATH], *own = NULL;
    struct apc_experiment *e = calloc(1, sizeof *e);
    int rc = 0;

    *out = NULL;
    if (!e)
        return apc_fail(why, APC_ENOMEM, "out of memory");
    if (text)
        snprintf(path, sizeof path, "%s", file);
    else
        rc = experiment_read(file, path, &e->record, &own, why);
    if (rc == 0)
        rc = read_experiment(
            &e->now,
            &(struct experiment_source){.file = path, .text = text ? text : own, .record = &e->record}, why);
    free(own);
    if (rc < 0)
        apc_experiment_destroy(e);
    else
        *out = e;
    return rc;
}

void apc_experiment_destroy(struct apc_experiment *e)
{
    if (!e)
        return;
    leave_reading(e->now);
    record_free(&e->record);
    free(e);
}

int apc_experiment_set(struct apc_experiment *e, const char *path, const char *value, struct apc_error *why)
{
    char *text, said[200];
    struct reading *changed;
    struct record record = e->record;
    int rc = experiment_change(e->now->e.text, path, value, &text, why);
    if (rc < 0)
        return rc;
    experiment_forget(&record, path);
    snprintf(said, sizeof said, "%.120s = %.70s", path, value);
    rc = read_experiment(
        &changed,
        &(struct experiment_source){.file = e->now->e.file, .text = text, .change = said, .record = &record},
        why);
    free(text);
    if (rc < 0)
        return rc;
    leave_reading(e->now);
    e->now = changed;
    e->record = record;
    return 0;
}

int64_t apc_experiment_text(const struct apc_experiment *e, char *text, size_t size)
{
    if (text && size > 0)
        snprintf(text, size, "%s", e->now->e.text);
    return (int64_t)strlen(e->now->e.text);
}

int apc_experiment_provision(const struct apc_experiment *e, struct apc_store *store, int reset,
                             struct apc_error *why)
{
    char differs[PROVISION_TEXT];
    int rc = provision_check(store, &e->now->e, differs);
    if (rc == APC_EPERM)
        return apc_fail(why, rc, "%s", differs);
    if (rc >= 0)
        rc = provision(store, &e->now->e, reset ? PROVISION_RESET : PROVISION_KEEP);
    return rc < 0 ? apc_fail(why, rc, "%s", apc_store_error(store)) : 0;
}

/* ---- Simulations --------------------------------------------------------------------------- */

int apc_simulation_create(struct apc_simulation **out, const struct apc_experiment *e,
                          const struct apc_simulation_options *options, struct apc_error *why)
{
    struct apc_simulation_options o = {.size = sizeof o};
    struct apc_simulation *s;

    *out = NULL;
    int rc = apc_options_copy(&o, sizeof o, options, "apc_simulation_options", why);
    if (rc < 0)
        return rc;
    s = calloc(1, sizeof *s);
    if (!s)
        return apc_fail(why, APC_ENOMEM, "out of memory");
    s->of = e->now;
    atomic_fetch_add(&s->of->users, 1);
    rc = simulation_create(&s->s, &s->of->e, o.seed ? o.seed : s->of->e.seed, why);
    if (rc == 0 && apc_store_put_tags(s->s.store, s->s.tags, s->s.n_tags) < 0)
        rc = apc_fail(why, APC_ENOMEM, "%s", apc_store_error(s->s.store));
    if (rc < 0)
        apc_simulation_destroy(s);
    else
        *out = s;
    return rc;
}

void apc_simulation_destroy(struct apc_simulation *s)
{
    if (!s)
        return;
    simulation_destroy(&s->s);
    leave_reading(s->of);
    free(s);
}

/* Why the simulation ended, if it did. */
static int said(struct apc_simulation *s, int rc)
{
    if (rc < 0)
        s->why = s->s.why;
    return rc;
}

int apc_simulation_run(struct apc_simulation *s, double until)
{
    const double end = until > 0 ? until : s->of->e.duration;
    if (until >= 0 && end > 0 && isfinite(end))
        return said(s, simulation_run(&s->s, end));
    return apc_fail(&s->why, APC_EINVAL,
                    until == 0 ? "the experiment has no duration: say until when"
                               : "until %g s: must be a time of the run, or 0 for its end",
                    until);
}

double apc_simulation_time(const struct apc_simulation *s)
{
    return s->s.ended;
}

int apc_simulation_write(struct apc_simulation *s, const char *name, double value)
{
    struct apc_tag tag;
    int rc = action_find(&s->of->e, s->s.tags, s->s.n_tags, name, true, &tag, &s->why);
    if (rc == 0)
        rc = action_check(&tag, value, &s->why);
    if (rc < 0)
        return rc;
    const struct action action = {
        .kind = ACTION_WRITE, .to = {.table = tag.table, .id = tag.id, .value = value}, .n = 1};
    return said(s, simulation_operate(&s->s, &action));
}

int apc_simulation_mode(struct apc_simulation *s, const char *name, enum apc_mode mode)
{
    struct action action = {.kind = ACTION_WRITE};
    int rc = action_find_mode(&s->of->e, name, mode, &action, &s->why);
    return rc < 0 ? rc : said(s, simulation_operate(&s->s, &action));
}

int apc_simulation_do(struct apc_simulation *s, const char *what, const char *name)
{
    const bool kill = !strcmp(what, "kill"), remote = !strcmp(what, "remote");
    struct action action = {.kind = kill ? ACTION_KILL : ACTION_START};
    if (remote || !strcmp(what, "local")) {
        action.kind = ACTION_WRITE;
        const int rc = action_find_owner(&s->of->e, name, remote, &action, &s->why);
        return rc < 0 ? rc : said(s, simulation_operate(&s->s, &action));
    }
    if (!strcmp(what, "promote")) {
        action.kind = ACTION_WRITE;
        const int rc = action_find_promotion(&s->of->e, name, &action, &s->why);
        return rc < 0 ? rc : said(s, simulation_operate(&s->s, &action));
    }
    if (!kill && strcmp(what, "start") != 0)
        return apc_fail(&s->why, APC_EINVAL,
                        "\"%s\" cannot be done: remote, local, promote, kill and start can", what);
    while (action.controller < s->of->e.n_controllers &&
           strcmp(s->of->e.controllers[action.controller].name, name) != 0)
        action.controller++;
    if (action.controller < s->of->e.n_controllers)
        return said(s, simulation_operate(&s->s, &action));
    return apc_fail(&s->why, APC_ENOTFOUND, "there is no controller \"%s\"", name);
}

int apc_simulation_read(const struct apc_simulation *s, const char *name, struct apc_value *value)
{
    struct apc_tag tag;
    int rc = action_find(&s->of->e, s->s.tags, s->s.n_tags, name, false, &tag, NULL);
    if (rc < 0)
        return rc;
    struct apc_sample newest = {.table = tag.table, .id = tag.id};
    if ((rc = apc_store_read(s->s.store, &newest, 1)) < 0)
        return rc;
    *value = (struct apc_value){.value = newest.value, .status = newest.status, .time = newest.time};
    return newest.seq > 0 ? 0 : APC_ENOTFOUND;
}

struct apc_store *apc_simulation_store(struct apc_simulation *s)
{
    return s->s.store;
}

const char *apc_simulation_error(const struct apc_simulation *s)
{
    return s->why.text;
}

/* ---- Figures ------------------------------------------------------------------------------- */

static void fill_figure(struct apc_figure *to, size_t size, const char *loop, const double *from)
{
    struct apc_figure f = {.size = size,
                           .iae = from[METRIC_IAE],
                           .ise = from[METRIC_ISE],
                           .itae = from[METRIC_ITAE],
                           .overshoot = from[METRIC_OVERSHOOT],
                           .settling = from[METRIC_SETTLING],
                           .peak = from[METRIC_PEAK],
                           .recovery = from[METRIC_RECOVERY],
                           .effort = from[METRIC_EFFORT],
                           .without = from[METRIC_UNCONTROLLED]};
    snprintf(f.loop, sizeof f.loop, "%s", loop);
    *to = f;
}

static size_t fill_all(const struct figures *f, const struct experiment *e, struct apc_figure *to,
                       size_t capacity)
{
    size_t n = 0;
    for (size_t i = 0; i < f->n_loops; i++) {
        const struct metrics *m = &f->of[i];
        for (size_t k = 0; k <= f->n_parts; k++, n++) {
            if (n >= capacity)
                continue;
            fill_figure(&to[n], sizeof *to, f->loop[i].name, k ? m->part[k - 1].figure : m->figure);
            to[n].from = f->n_parts ? m->part[k ? k - 1 : 0].from : 0;
            to[n].until = f->n_parts ? m->part[k ? k - 1 : f->n_parts - 1].to : 0;
            if (k)
                figures_name_part(f, &m->part[k - 1], e, to[n].event, sizeof to[n].event);
            else
                snprintf(to[n].event, sizeof to[n].event, "all");
        }
    }
    return n;
}

int apc_simulation_figures(const struct apc_simulation *s, struct apc_figure *figures, size_t capacity)
{
    struct figures f;
    if (figures && capacity > 0 && figures->size != sizeof *figures)
        return APC_EINVAL;
    int rc = figures_make(&f, &s->s.trajectory, &s->of->e);
    if (rc == 0)
        rc = (int)fill_all(&f, &s->of->e, figures, figures ? capacity : 0);
    figures_free(&f);
    return rc;
}

/* SPDX-License-Identifier: BSD-3-Clause */
/* Why a replayed tick is another than the recorded one: by leaving out, one at a time, what did not run then. */
#include "replay_internal.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "files/files.h"

/* ---- What is told ---------------------------------------------------------------------------- */

struct differs_cause *differs_add(struct differs *d)
{
    struct differs_cause *all = realloc(d->cause, (d->n + 1) * sizeof *all);
    if (!all)
        return NULL;
    d->cause = all;
    all[d->n] = (struct differs_cause){.recorded = (double)NAN, .replayed = (double)NAN};
    return &all[d->n++];
}

static struct differs_term *differs_term_of(struct differs *d, const struct apc_law_term *term)
{
    const char *of = term->of ? term->of : "";
    for (size_t i = 0; i < d->n_terms; i++)
        if (strcmp(d->term[i].name, term->name) == 0 && strcmp(d->term[i].of, of) == 0)
            return &d->term[i];
    struct differs_term *all = realloc(d->term, (d->n_terms + 1) * sizeof *all);
    if (!all)
        return NULL;
    d->term = all;
    all[d->n_terms] = (struct differs_term){.recorded = (double)NAN, .replayed = (double)NAN};
    snprintf(all[d->n_terms].name, sizeof all->name, "%s", term->name);
    snprintf(all[d->n_terms].of, sizeof all->of, "%s", of);
    return &all[d->n_terms++];
}

int differs_take_terms(struct differs *d, const struct replay_controller *rc, size_t element, bool recorded)
{
    const size_t n = apc_controller_terms(rc->core, element, NULL, 0);
    struct apc_law_term *term = calloc(n + 1, sizeof *term);
    int err = term ? 0 : APC_ENOMEM;
    if (term && n > 0)
        (void)apc_controller_terms(rc->core, element, term, n);
    for (size_t i = 0; i < n && err == 0; i++) {
        struct differs_term *to = differs_term_of(d, &term[i]);
        if (to)
            *(recorded ? &to->recorded : &to->replayed) = term[i].value;
        else
            err = APC_ENOMEM;
    }
    free(term);
    return err;
}

static int by_differing_effect(const void *left, const void *right)
{
    const double x = fabs(((const struct differs_cause *)left)->effect),
                 y = fabs(((const struct differs_cause *)right)->effect);
    return x > y ? -1 : x < y;
}

static void end_differs(struct differs *d)
{
    d->together = d->replayed - d->recorded;
    for (size_t i = 0; i < d->n; i++)
        d->together -= d->cause[i].effect;
    if (d->n > 0)
        qsort(d->cause, d->n, sizeof *d->cause, by_differing_effect);
}

void differs_free(struct differs *d)
{
    free(d->cause);
    free(d->term);
    *d = (struct differs){.time = 0};
}

/* ---- Of a candidate -------------------------------------------------------------------------- */

/* The tick under some of what did not run. */
struct differing {
    struct differs *d;
    const struct replay_range *of;
    apc_ns since;
    double *was;                /* [n_set] what the experiment has where a setting is another */
    bool ran;                   /* under the law that ran */
    bool terms;                 /* they are taken too */
    double u, recorded;         /* result: NAN: it was not come to */
    bool made;                  /* all of the row came out */
    struct differs_cause tuned; /* of the tuning the one value that is not that on record */
    size_t n_tuned;
    int failed;
};

static void note_tuned(struct differing *t, const struct replay *r, const struct apc_controller *c, size_t k,
                       const double *row)
{
    const size_t at = c->offset[APC_TICK_TUNING] + k;
    const int id = c->in.sample[c->dim.ny + c->dim.nd + c->dim.nz + 2 * c->dim.nu + k].id;
    if (replay_same_bits(row[at], c->row[at]))
        return;
    t->tuned = (struct differs_cause){.recorded = row[at], .replayed = c->row[at]};
    t->n_tuned++;
    for (size_t i = 0; i < r->n_tags; i++)
        if (r->tags[i].table == APC_TUNING && r->tags[i].id == id)
            snprintf(t->tuned.name, sizeof t->tuned.name, "%s", r->tags[i].name);
}

static void take_differing(void *ctx, const struct replay *r, const struct replay_controller *rc,
                           const struct tick_row *at)
{
    struct differing *t = ctx;
    const struct apc_controller *c = rc->core;
    const double *row = rc->ticks.value + at->first;
    for (size_t i = 0; i < c->dim.nu && at->time == t->d->time; i++) {
        if (strcmp(r->loops.at[(size_t)rc->of->first_loop - 1 + i].name, t->d->output) != 0)
            continue;
        t->u = c->u[i];
        t->recorded = row[c->offset[APC_TICK_U] + i];
        t->made = at->n == c->out_row->n && replay_is_made(c, row);
        if (t->terms && (!t->ran || t->made))
            t->failed = differs_take_terms(t->d, rc, i, t->ran);
        for (size_t k = 0; k < c->size.tuning && at->n == c->out_row->n; k++)
            note_tuned(t, r, c, k, row);
    }
}

static void read_recorded_settings(const struct differing *t, const struct season *s)
{
    const struct experiment_overrides *all = t->of->overrides;
    struct apc_error none;
    for (size_t i = 0; i < all->n_set && s->revision[s->n - 1].usable; i++)
        if (experiment_value(&s->revision[s->n - 1].replay.e, all->set[i].path, &t->was[i], &none) < 0)
            t->was[i] = (double)NAN;
}

/* Under these and the experiment's own tuning; NULL: under what ran. */
static int compute_differing(struct differing *t, const struct experiment_overrides *overrides,
                             struct apc_error *why)
{
    const struct replay_watch watch = {.computed = take_differing, .ctx = t};
    struct replay_range range = *t->of;
    struct season s;
    range.exact = t->since > 0;
    range.since = t->since;
    range.until = t->d->time + 1;
    range.window = INT64_MAX;
    range.overrides = overrides;
    range.own_tuning = overrides;
    t->ran = !overrides;
    t->u = t->recorded = (double)NAN;
    t->n_tuned = 0;
    int rc = season_open(&s, &range, &watch, why);
    for (apc_ns since = s.of.since, until; since < s.of.until && rc == 0; since = until) {
        until = season_window(&s, since);
        rc = season_replay(&s, since, until, why);
    }
    if (rc == 0 && t->ran)
        read_recorded_settings(t, &s);
    season_close(&s);
    return rc == 0 && t->failed < 0 ? apc_fail(why, t->failed, "out of memory") : rc;
}

static int add_candidate_cause(const struct differing *t, const struct differs_cause *cause,
                               struct apc_error *why)
{
    struct differs_cause *to = cause->effect > 0 || cause->effect < 0 ? differs_add(t->d) : NULL;
    if (to)
        *to = *cause;
    return to || !(cause->effect > 0 || cause->effect < 0) ? 0 : apc_fail(why, APC_ENOMEM, "out of memory");
}

/* All but setting @p i, or the law: what is then less is of that one. @p set: room. */
static int leave_candidate_out(struct differing *t, size_t i, struct experiment_setting *set,
                               struct apc_error *why)
{
    const struct experiment_overrides *all = t->of->overrides;
    struct experiment_overrides others = *all;
    struct differs_cause cause = {.kind = "law", .recorded = (double)NAN, .replayed = (double)NAN};
    others.set = set;
    others.n_set = 0;
    for (size_t k = 0; k < all->n_set; k++)
        if (k != i)
            set[others.n_set++] = all->set[k];
    if (i == all->n_set) {
        others.law = NULL;
        snprintf(cause.name, sizeof cause.name, "%s", all->law);
    } else {
        cause.kind = "setting";
        cause.recorded = t->was[i];
        snprintf(cause.name, sizeof cause.name, "%s", all->set[i].path);
        if (apc_number_parse(all->set[i].value, &cause.replayed) < 0)
            cause.replayed = (double)NAN;
    }
    const int rc = compute_differing(t, &others, why);
    cause.effect = t->d->replayed - t->u;
    return rc < 0 ? rc : add_candidate_cause(t, &cause, why);
}

/* What people tuned is not in the experiment, whose own tuning a candidate has. */
static int leave_tuning(struct differing *t, struct apc_error *why)
{
    const int rc = compute_differing(t, &(struct experiment_overrides){.law = NULL}, why);
    struct differs_cause cause = t->tuned;
    if (rc < 0 || t->n_tuned == 0)
        return rc;
    if (t->n_tuned > 1)
        cause = (struct differs_cause){.name = "on record", .recorded = (double)NAN, .replayed = (double)NAN};
    cause.kind = "tuning";
    cause.effect = t->u - t->recorded;
    return add_candidate_cause(t, &cause, why);
}

static int find_candidate_causes(struct differing *t, struct apc_error *why)
{
    const struct experiment_overrides *all = t->of->overrides;
    struct experiment_setting *set = calloc(all->n_set + 1, sizeof *set);
    t->was = calloc(all->n_set + 1, sizeof *t->was);
    t->terms = true;
    int rc = set && t->was ? compute_differing(t, all, why) : apc_fail(why, APC_ENOMEM, "out of memory");
    t->d->replayed = t->u;
    t->d->recorded = t->recorded;
    if (rc == 0 && (rc = compute_differing(t, NULL, why)) == 0 && !t->made)
        snprintf(
            t->d->unknown, sizeof t->d->unknown,
            "the law that ran does not come out of its record there: without --law and --set it is said why");
    t->terms = false;
    for (size_t i = 0; i < all->n_set + (all->law ? 1 : 0) && rc == 0; i++)
        rc = leave_candidate_out(t, i, set, why);
    if (rc == 0)
        rc = leave_tuning(t, why);
    free(set);
    free(t->was);
    return rc;
}

int differs_of_candidate(struct differs *d, const struct replay_range *of, const char *loop, apc_ns time,
                         apc_ns since, struct apc_error *why)
{
    struct differing t = {.d = d, .of = of, .since = since};
    *d = (struct differs){.time = time};
    snprintf(d->output, sizeof d->output, "%s", loop);
    const int rc = find_candidate_causes(&t, why);
    end_differs(d);
    return rc;
}

/* ---- Of the law that ran --------------------------------------------------------------------- */

int differs_of_record(struct differs *d, const struct replay_range *of, const char *controller, apc_ns time,
                      struct apc_error *why)
{
    struct replay_range range = *of;
    struct season s;
    struct replay *r = NULL;
    struct replay_controller *rc = NULL;
    size_t k = 0;
    range.exact = true;
    range.since = time;
    range.until = time + 1;
    *d = (struct differs){.time = time};
    int err = season_open(&s, &range, &(struct replay_watch){.ctx = NULL}, why);
    if (err == 0 && (err = season_load_tick(&s, controller, time, &r, &rc, &k)) < 0)
        apc_fail(why, err, "%s",
                 err == APC_ENOMEM      ? "out of memory"
                 : err == APC_ENOTFOUND ? "the tick is not on record any more"
                                        : apc_store_error(of->store));
    if (err == 0 && (err = why_differs(d, r, rc, k)) < 0)
        apc_fail(why, err, "%s", err == APC_ENOMEM ? "out of memory" : r->why.text);
    season_close(&s);
    end_differs(d);
    return err;
}

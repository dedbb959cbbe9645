/* SPDX-License-Identifier: BSD-3-Clause */
/*
 * The ticks that a record holds, again: window by window, so that a season needs no more memory than one of them.
 * Each begins some ticks earlier, which are not judged: what a law keeps beside its row is there again by then.
 *
 * A store may have been described several times. A tick is of the experiment in force then or, until its daemon
 * was started anew, of a former one: its mark says whose it is.
 */
#include "replay_internal.h"

#include <stdlib.h>
#include <string.h>

#include "files/files.h"

#define LEAD   50           /* ticks of the slowest controller */
#define OFF    APC_NS_PER_S /* by which a row may bear another machine's time */
#define NOBODY SIZE_MAX

/* ---- How the experiment was described ------------------------------------------------------- */

/* The number of the description in force then; 0: there was none. Returns 0 or an error. */
static int revision_then(const struct season *s, apc_ns time, int64_t *revision, struct apc_error *why)
{
    struct apc_store *past = NULL;
    int rc = apc_store_past(&past, s->of.store, time, why);
    if (rc == 0 && (rc = apc_store_catalogue(past, NULL, 0, revision)) < 0)
        apc_fail(why, rc, "%s", apc_store_error(past));
    apc_store_close(past);
    return rc < 0 ? rc : 0;
}

static struct season_revision *add_revision(struct season *s, apc_ns since)
{
    struct season_revision *all = realloc(s->revision, (s->n + 1) * sizeof *all);
    if (!all)
        return NULL;
    s->revision = all;
    all[s->n] = (struct season_revision){.since = since};
    return &all[s->n++];
}

/* Whenever it was described anew after @p since, until @p until: halfway between two times of other descriptions. */
static int find_revisions(struct season *s, apc_ns since, int64_t before, apc_ns until, struct apc_error *why)
{
    int64_t after = 0;
    int rc = revision_then(s, until, &after, why);
    while (rc == 0 && after != before) {
        apc_ns low = since, high = until;
        int64_t reached = after;
        while (high - low > 1 && rc == 0) {
            const apc_ns middle = low + (high - low) / 2;
            int64_t there = 0;
            rc = revision_then(s, middle, &there, why);
            if (there == before) {
                low = middle;
            } else {
                high = middle;
                reached = there;
            }
        }
        if (rc == 0 && before > 0 && !add_revision(s, high))
            rc = apc_fail(why, APC_ENOMEM, "out of memory");
        since = high;
        before = reached;
    }
    return rc;
}

static int parse_revision(struct season *s, struct season_revision *v, apc_ns then, struct apc_error *why)
{
    char *text;
    int rc = replay_catalogue(s->of.store, then, &text, why);
    const struct experiment_source from = {.file = "the store's experiment", .text = text};
    if (rc == 0)
        rc = s->of.overrides && s->of.overrides->n_set > 0
                 ? experiment_parse_changed(&v->replay.e, &from, EXPERIMENT_LAW, s->of.overrides, why)
                 : experiment_parse(&v->replay.e, &from, EXPERIMENT_LAW, s->of.overrides, why);
    free(text);
    return rc;
}

/* Its controllers, so that they have their marks. */
static int make_revision(struct season *s, struct season_revision *v, apc_ns then, struct apc_error *why)
{
    const struct experiment_overrides *overrides = s->of.overrides;
    struct replay *r = &v->replay;
    *r = (struct replay){.of_store = true,
                         .other_law =
                             s->of.own_tuning || (overrides && (overrides->law || overrides->n_set > 0)),
                         .watch = s->watch};
    int rc = s->of.dir ? replay_load_folder(r, s->of.dir, overrides, why) : parse_revision(s, v, then, why);
    if (rc == 0)
        rc = replay_make(r, why);
    for (size_t i = 0; i < r->e.n_controllers && rc == 0; i++)
        if ((rc = replay_start_controller(r, &r->controller[i], NULL, 0)) < 0)
            *why = r->why;
    v->usable = rc == 0;
    return rc;
}

static int make_revisions(struct season *s, struct apc_error *why)
{
    struct apc_error first = {""};
    bool any = false;
    int rc = 0;
    for (size_t i = 0; i < s->n; i++) {
        struct season_revision *v = &s->revision[i];
        const int made =
            make_revision(s, v, i + 1 < s->n ? s->revision[i + 1].since - 1 : s->of.until, &v->why);
        any = any || made == 0;
        if (made < 0 && rc == 0) {
            rc = made;
            first = v->why;
        }
    }
    if (any && rc != APC_ENOMEM)
        return 0;
    *why = first;
    return rc;
}

/* ---- The range ------------------------------------------------------------------------------ */

static int narrow_range(struct season *s, struct apc_error *why)
{
    apc_ns first = INT64_MAX, last = INT64_MIN;
    struct known_plant plant = {.tag = NULL};
    int rc = s->of.dir ? 0 : known_load(&plant, s->of.store);
    for (size_t i = 0; s->of.dir && i < s->revision->replay.e.n_controllers && rc == 0; i++)
        rc = replay_look_at_ticks(s->of.store, s->revision->replay.e.controllers[i].number, &first, &last);
    for (size_t i = 0; !s->of.dir && i < plant.loops.n_controllers && rc >= 0; i++)
        rc = replay_look_at_ticks(s->of.store, plant.loops.controller[i].number, &first, &last);
    known_free(&plant);
    if (rc < 0)
        return apc_fail(why, rc, "%s", rc == APC_ENOMEM ? "out of memory" : apc_store_error(s->of.store));
    if (first > last)
        return apc_fail(why, APC_ENOTFOUND, "no ticks are on record");
    s->of.since = first > s->of.since ? first : s->of.since;
    s->of.until = last < s->of.until - 1 ? last + 1 : s->of.until;
    return 0;
}

/* ---- Whose ticks are told ------------------------------------------------------------------- */

static bool has_controller(const struct season *s, const char *name)
{
    for (size_t i = 0; i < s->n_controllers; i++)
        if (strcmp(s->controller[i].name, name) == 0)
            return true;
    return false;
}

static bool has_loop(const struct season *s, const char *name)
{
    for (size_t i = 0; i < s->n_loops; i++)
        if (strcmp(s->loop[i].name, name) == 0)
            return true;
    return false;
}

static int list_parts(struct season *s, struct apc_error *why)
{
    size_t controllers = 1, loops = 1;
    struct nearest nearest = {.wanted = s->of.controller ? s->of.controller : ""};
    for (size_t v = 0; v < s->n; v++) {
        controllers += s->revision[v].replay.e.n_controllers;
        loops += s->revision[v].replay.loops.n;
    }
    s->controller = calloc(controllers, sizeof *s->controller);
    s->loop = calloc(loops, sizeof *s->loop);
    if (!s->controller || !s->loop)
        return apc_fail(why, APC_ENOMEM, "out of memory");
    for (size_t v = s->n; v-- > 0;) {
        const struct replay *r = &s->revision[v].replay;
        for (size_t i = 0; s->revision[v].usable && i < r->e.n_controllers; i++) {
            const char *name = r->e.controllers[i].name;
            nearest_look(&nearest, name);
            if ((!s->of.controller || strcmp(s->of.controller, name) == 0) && !has_controller(s, name))
                snprintf(s->controller[s->n_controllers++].name, APC_TAG_LEN, "%s", name);
        }
        for (size_t i = 0; s->revision[v].usable && i < r->loops.n; i++)
            if (has_controller(s, r->e.controllers[r->loops.at[i].controller].name) &&
                !has_loop(s, r->loops.at[i].name))
                snprintf(s->loop[s->n_loops++].name, APC_TAG_LEN, "%s", r->loops.at[i].name);
    }
    return s->n_controllers > 0 ? 0
                                : apc_fail(why, APC_ENOTFOUND, "there is no controller \"%s\"%s%s%s",
                                           s->of.controller, nearest.name ? ": did you mean \"" : "",
                                           nearest.name ? nearest.name : "", nearest.name ? "\"?" : "");
}

int season_open(struct season *s, const struct replay_range *of, const struct replay_watch *watch,
                struct apc_error *why)
{
    *s = (struct season){.of = *of, .watch = *watch};
    const apc_ns now = apc_clock_utc(NULL);
    int64_t before = 0;
    int rc = 0;
    s->of.until = of->until < now ? of->until : now;
    if (!add_revision(s, INT64_MIN))
        return apc_fail(why, APC_ENOMEM, "out of memory");
    if (of->dir)
        rc = make_revisions(s, why);
    if (rc == 0 && !of->exact)
        rc = narrow_range(s, why);
    if (rc == 0 && !of->dir && s->of.since < s->of.until)
        rc = revision_then(s, s->of.since, &before, why);
    if (rc == 0 && !of->dir && s->of.since < s->of.until)
        rc = find_revisions(s, s->of.since, before, s->of.until, why);
    if (rc == 0 && !of->dir)
        rc = make_revisions(s, why);
    for (size_t v = 0; v < s->n; v++)
        s->revision[v].replay.began = of->dir ? s->revision[v].replay.start : s->of.since;
    return rc < 0 ? rc : list_parts(s, why);
}

apc_ns season_window(const struct season *s, apc_ns since)
{
    apc_ns until = s->of.until - since > s->of.window ? since + s->of.window : s->of.until;
    for (size_t v = 0; v < s->n; v++)
        if (s->revision[v].since > since && s->revision[v].since < until)
            until = s->revision[v].since;
    return until;
}

/* ---- Its ticks ------------------------------------------------------------------------------ */

/* Of one controller, with those that lead to the window: as many as are needed, however long before it they were. */
static int load_ticks(struct replay *r, struct replay_controller *rc, struct apc_store *store,
                      const struct apc_range *range)
{
    struct ticks *ticks = &rc->ticks;
    ticks_free(ticks);
    const int err = replay_load_vectors(ticks, store, APC_TICK, rc->of->number, range);
    const bool led = ticks->n > LEAD && ticks->at[LEAD].time < r->since;
    return err < 0 ? err : ticks_fill(ticks, store, APC_TICK, rc->of->number, LEAD, !led);
}

/* What the ticks of all controllers name, since one names another's. */
static int load_window(struct replay *r, struct apc_store *store)
{
    apc_ns slowest = 0, first = INT64_MAX;
    int rc = 0;
    r->store = store; /* of this process */
    for (size_t i = 0; i < r->e.n_controllers; i++)
        slowest = r->e.controllers[i].rhythm.period > slowest ? r->e.controllers[i].rhythm.period : slowest;
    const struct apc_range range = {.since = r->since - LEAD * slowest, .until = r->until};
    for (size_t i = 0; i < r->e.n_controllers && rc == 0; i++) {
        const struct ticks *ticks = &r->controller[i].ticks;
        rc = load_ticks(r, &r->controller[i], store, &range);
        if (rc == 0 && ticks->n > 0) {
            const apc_ns zero = replay_part_start(r->controller[i].of, ticks);
            first = zero < first ? zero : first;
        }
    }
    r->start = first < INT64_MAX ? first : range.since;
    for (size_t k = 0; k < r->e.dim.nz && rc == 0; k++) {
        ticks_free(&r->plan[k]);
        rc = replay_load_vectors(&r->plan[k], store, APC_PLAN, (int)k + 1, &range);
    }
    samples_free(&r->samples);
    r->samples = (struct samples){.n = 0};
    const struct apc_range named = {.since = range.since - OFF, .until = r->until + OFF};
    return rc < 0 ? rc : replay_load_samples(r, store, &named);
}

static bool has_mark(const struct apc_controller *core, const double *row, size_t n)
{
    return n == core->out_row->n && row[0] >= core->mark[0] && row[0] <= core->mark[0] &&
           row[1] >= core->mark[1] && row[1] <= core->mark[1];
}

static bool is_made_by(const struct replay_controller *rc, const struct ticks *ticks, size_t k)
{
    return has_mark(rc->core, ticks->value + ticks->at[k].first, ticks->at[k].n);
}

/* Laws of the user's own are not loaded. Returns 1; 0: it has such laws, or cannot be read. */
static int parse_built_in(struct experiment *e, const char *text)
{
    const struct experiment_source from = {.file = "the store's experiment", .text = text};
    struct apc_error why;
    bool own = experiment_parse(e, &from, 0, NULL, &why) < 0;
    for (size_t i = 0; i < e->n_controllers && !own; i++)
        own = strchr(e->controllers[i].law_name, '/');
    if (own)
        return 0;
    experiment_free(e);
    return experiment_parse(e, &from, EXPERIMENT_LAW, NULL, &why) == 0;
}

int simulation_as_described(struct apc_store *store, const char *name, const struct apc_vector *tick,
                            struct apc_error *why)
{
    struct experiment e = {0};
    struct apc_controller *core = NULL;
    char *text = NULL;
    int64_t revision = 0;
    int rc = experiment_text(store, &text, &revision, why);
    bool made = true;
    const bool known = rc > 0 && parse_built_in(&e, text);
    rc = rc < 0 ? rc : 0;
    for (size_t i = 0; i < e.n_controllers && known && rc == 0; i++)
        if (strcmp(e.controllers[i].name, name) == 0 &&
            (rc = module_controller(&e, &e.controllers[i], false, &core, why)) == 0)
            made = has_mark(core, tick->value, tick->n);
    apc_controller_destroy(core);
    experiment_free(&e);
    free(text);
    return rc < 0 ? rc : made;
}

/* The description, not newer than @p newest, with which the row of controller @p number was made. */
static size_t find_maker(const struct season *s, size_t newest, int number, const struct ticks *ticks,
                         size_t k)
{
    for (size_t v = newest + 1; v-- > 0;) {
        const struct replay *r = &s->revision[v].replay;
        for (size_t i = 0; s->revision[v].usable && i < r->e.n_controllers; i++)
            if (r->controller[i].of->number == number && is_made_by(&r->controller[i], ticks, k))
                return v;
    }
    return NOBODY;
}

/* A tick of which nothing before is known, or only that before the window. */
static int begin_window(struct replay *r, struct replay_controller *rc, size_t k)
{
    const struct tick_row *former = k > 0 ? &rc->ticks.at[k - 1] : NULL;
    const int err = replay_start_controller(r, rc, former, former ? former->time : r->start - 1);
    rc->row = former ? rc->ticks.value + former->first : NULL;
    rc->now = (struct apc_now){.mono = APC_NS_PER_S, .utc = former ? former->time : 0};
    return err;
}

/* Ticks of the others are left to those: counted once, by the description in force. */
static int replay_window(struct season *s, size_t v, size_t newest, struct replay_controller *rc)
{
    const struct ticks *ticks = &rc->ticks;
    struct replay *r = &s->revision[v].replay;
    bool follows = false;
    int err = 0;
    for (size_t k = 0; k < ticks->n && err == 0; k++) {
        const bool judged = replay_judges(r, ticks->at[k].time);
        const size_t maker = r->other_law ? v : find_maker(s, newest, rc->of->number, ticks, k);
        if (judged && maker == NOBODY && !s->former) {
            rc->figures.others++;
            rc->figures.other = rc->figures.other ? rc->figures.other : ticks->at[k].time;
        } else if (judged && maker < newest && !s->former) {
            s->revision[maker].wanted = true;
        }
        if (k == 0 && !judged)
            continue;
        if (maker == v && !follows)
            err = begin_window(r, rc, k > 0 && ticks->at[k - 1].n == ticks->at[k].n ? k : 0);
        if (maker == v && err == 0)
            err = replay_tick(r, rc, k);
        follows = maker == v;
    }
    return err;
}

static int replay_revision(struct season *s, size_t v, size_t newest, apc_ns since, apc_ns until,
                           struct apc_error *why)
{
    struct replay *r = &s->revision[v].replay;
    r->since = since;
    r->until = until;
    int rc = load_window(r, s->of.store);
    if (rc < 0)
        return apc_fail(why, rc, "%s", rc == APC_ENOMEM ? "out of memory" : apc_store_error(s->of.store));
    for (size_t i = 0; i < r->e.n_controllers && rc == 0; i++)
        if (has_controller(s, r->e.controllers[i].name))
            rc = replay_window(s, v, newest, &r->controller[i]);
    return rc < 0 ? apc_fail(why, rc, "%s", r->why.text) : 0;
}

/* The one in force; where that cannot be used, the one before or, without any, after it. */
static size_t find_in_force(const struct season *s, apc_ns time)
{
    size_t v = s->n - 1;
    while (v > 0 && s->revision[v].since > time)
        v--;
    while (v > 0 && !s->revision[v].usable)
        v--;
    while (v + 1 < s->n && !s->revision[v].usable)
        v++;
    return v;
}

/* Into that description's replay, with ticks before it. @p rc: NULL: it is not there. */
static int load_tick_of(struct season *s, size_t v, const char *name, apc_ns time,
                        struct replay_controller **rc, size_t *k)
{
    struct replay *r = &s->revision[v].replay;
    r->since = time;
    r->until = time + 1;
    const int err = s->revision[v].usable ? load_window(r, s->of.store) : 0;
    *rc = NULL;
    for (size_t i = 0; i < r->e.n_controllers && s->revision[v].usable && err == 0; i++) {
        const struct ticks *ticks = &r->controller[i].ticks;
        if (strcmp(r->e.controllers[i].name, name) == 0 && ticks->n > 0 &&
            ticks->at[ticks->n - 1].time == time) {
            *rc = &r->controller[i];
            *k = ticks->n - 1;
        }
    }
    return err;
}

int season_load_tick(struct season *s, const char *controller, apc_ns time, struct replay **r,
                     struct replay_controller **rc, size_t *k)
{
    const size_t newest = find_in_force(s, time);
    for (size_t v = newest + 1; v-- > 0;) {
        const int err = load_tick_of(s, v, controller, time, rc, k);
        *r = &s->revision[v].replay;
        if (err < 0 || (*rc && is_made_by(*rc, &(*rc)->ticks, *k)))
            return err;
    }
    *r = &s->revision[newest].replay;
    const int err = load_tick_of(s, newest, controller, time, rc, k);
    return err < 0 || *rc ? err : APC_ENOTFOUND;
}

static void add_replay_figures(struct replay_figures *to, const struct replay_figures *of)
{
    if (of->first[0] && (!to->first[0] || of->differs < to->differs)) {
        to->differs = of->differs;
        memcpy(to->first, of->first, sizeof to->first);
    }
    to->begins = of->begins && (!to->begins || of->begins < to->begins) ? of->begins : to->begins;
    to->other = of->other && (!to->other || of->other < to->other) ? of->other : to->other;
    to->judged += of->judged;
    to->same += of->same;
    to->lost += of->lost;
    if (of->lacks[0] && (!to->lacks[0] || of->loses < to->loses)) {
        to->loses = of->loses;
        memcpy(to->lacks, of->lacks, sizeof to->lacks);
    }
    to->others += of->others;
    to->restarts += of->restarts;
}

static void add_replay_difference(struct replay_difference *to, const struct replay_difference *of)
{
    if (of->ticks == 0)
        return;
    to->low = to->ticks && to->low < of->low ? to->low : of->low;
    to->high = to->ticks && to->high > of->high ? to->high : of->high;
    to->at = of->worst > to->worst ? of->at : to->at;
    if (of->differs && (!to->differs || of->differs < to->differs)) {
        to->differs = of->differs;
        to->since = of->since;
    }
    to->worst = of->worst > to->worst ? of->worst : to->worst;
    to->ticks += of->ticks;
    to->same += of->same;
    to->sum += of->sum;
}

void season_add(struct season *to, const struct season_controller *controller, const struct season_loop *loop)
{
    for (size_t i = 0; i < to->n_controllers; i++)
        add_replay_figures(&to->controller[i].figures, &controller[i].figures);
    for (size_t i = 0; i < to->n_loops; i++)
        add_replay_difference(&to->loop[i].difference, &loop[i].difference);
}

/* What one description's replay has counted goes to the whole, by names. */
static void take_figures(struct season *s, struct replay *r)
{
    for (size_t i = 0; i < r->e.n_controllers; i++) {
        for (size_t k = 0; k < s->n_controllers; k++)
            if (strcmp(s->controller[k].name, r->e.controllers[i].name) == 0)
                add_replay_figures(&s->controller[k].figures, &r->controller[i].figures);
        r->controller[i].figures = (struct replay_figures){.judged = 0};
    }
    for (size_t i = 0; i < r->loops.n; i++) {
        for (size_t k = 0; k < s->n_loops; k++)
            if (strcmp(s->loop[k].name, r->loops.at[i].name) == 0)
                add_replay_difference(&s->loop[k].difference, &r->difference[i]);
        r->difference[i] = (struct replay_difference){.ticks = 0};
    }
}

int season_replay(struct season *s, apc_ns since, apc_ns until, struct apc_error *why)
{
    const size_t newest = find_in_force(s, since);
    for (size_t v = 0; v < s->n; v++)
        s->revision[v].wanted = false;
    s->former = false;
    int rc = replay_revision(s, newest, newest, since, until, why);
    s->former = true;
    for (size_t v = newest; v-- > 0 && rc == 0;)
        if (s->revision[v].wanted)
            rc = replay_revision(s, v, newest, since, until, why);
    for (size_t v = 0; v < s->n && rc == 0; v++)
        if (s->revision[v].usable)
            take_figures(s, &s->revision[v].replay);
    return rc;
}

void season_close(struct season *s)
{
    for (size_t v = 0; v < s->n; v++)
        replay_free(&s->revision[v].replay);
    free(s->revision);
    free(s->controller);
    free(s->loop);
}

/* SPDX-License-Identifier: BSD-3-Clause */
/*
 * The ticks that a store holds, again: window by window, so that a season needs no more memory than one of them.
 * Each begins some ticks earlier, which are not judged: what a law keeps beside its row is there again by then.
 */
#include "replay_internal.h"

#include <stdlib.h>
#include <string.h>

#include "files/files.h"

#define LEAD 50           /* ticks of the slowest controller */
#define OFF  APC_NS_PER_S /* by which a row may bear another machine's time */

/* As the store described it at the end. */
static int load_experiment_then(struct replay *r, const struct replay_range *of, struct apc_error *why)
{
    struct apc_store *past = NULL;
    int64_t revision = 0;
    char *text = NULL;
    int rc = apc_store_past(&past, of->store, of->until, why);
    if (rc == 0)
        rc = experiment_text(past, &text, &revision, why);
    if (rc >= 0 && revision == 0)
        rc = apc_fail(why, APC_ENOTFOUND, "the store does not say which experiment it is: apc init FILE");
    if (rc >= 0)
        rc = experiment_parse(&r->e,
                              &(struct experiment_source){.file = "the store's experiment", .text = text},
                              EXPERIMENT_LAW, of->overrides, why);
    free(text);
    apc_store_close(past);
    return rc;
}

static int find_replayed(const struct replay *r, const struct replay_range *of, struct apc_error *why)
{
    struct nearest nearest = {.wanted = of->controller};
    for (size_t i = 0; of->controller && i < r->e.n_controllers; i++) {
        if (strcmp(of->controller, r->e.controllers[i].name) == 0)
            return 0;
        nearest_look(&nearest, r->e.controllers[i].name);
    }
    return !of->controller ? 0
                           : apc_fail(why, APC_ENOTFOUND, "there is no controller \"%s\"%s%s%s",
                                      of->controller, nearest.name ? ": did you mean \"" : "",
                                      nearest.name ? nearest.name : "", nearest.name ? "\"?" : "");
}

/* What the ticks of all controllers name, since one names another's. */
static int load_window(struct replay *r, struct apc_store *store, apc_ns until)
{
    apc_ns slowest = 0, first = INT64_MAX;
    int rc = 0;
    for (size_t i = 0; i < r->e.n_controllers; i++)
        slowest = r->e.controllers[i].rhythm.period > slowest ? r->e.controllers[i].rhythm.period : slowest;
    const struct apc_range range = {.since = r->since - LEAD * slowest, .until = until};
    for (size_t i = 0; i < r->e.n_controllers && rc == 0; i++) {
        struct ticks *ticks = &r->controller[i].ticks;
        ticks_free(ticks);
        *ticks = (struct ticks){.n = 0};
        rc = replay_load_vectors(ticks, store, APC_TICK, r->e.controllers[i].number, &range);
        if (rc == 0 && ticks->n > 0) {
            const apc_ns zero = replay_part_start(r->controller[i].of, ticks);
            first = zero < first ? zero : first;
        }
    }
    r->start = first < INT64_MAX ? first : range.since;
    for (size_t k = 0; k < r->e.dim.nz && rc == 0; k++) {
        ticks_free(&r->plan[k]);
        r->plan[k] = (struct ticks){.n = 0};
        rc = replay_load_vectors(&r->plan[k], store, APC_PLAN, (int)k + 1, &range);
    }
    samples_free(&r->samples);
    r->samples = (struct samples){.n = 0};
    const struct apc_range named = {.since = range.since - OFF, .until = until + OFF};
    return rc < 0 ? rc : replay_load_samples(r, store, &named);
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

static int replay_window(struct replay *r, struct replay_controller *rc)
{
    const struct ticks *ticks = &rc->ticks;
    bool follows = false;
    int err = begin_window(r, rc, 0); /* so that its row has a length */
    for (size_t k = 0; k < ticks->n && err == 0; k++) {
        const bool fits = r->other_law || ticks->at[k].n == rc->core->out_row->n;
        if (!fits && ticks->at[k].time >= r->since)
            rc->others++;
        if (k == 0 && ticks->at[0].time < r->since) {
            follows = false;
            continue;
        }
        if (fits && !follows)
            err = begin_window(r, rc, k > 0 && ticks->at[k - 1].n == ticks->at[k].n ? k : 0);
        if (fits && err == 0)
            err = replay_tick(r, rc, k);
        follows = fits;
    }
    return err;
}

int replay_store(struct replay *r, const struct replay_range *of, const struct replay_watch *watch,
                 struct apc_error *why)
{
    const struct experiment_overrides *overrides = of->overrides;
    *r = (struct replay){.of_store = true,
                         .other_law = overrides && (overrides->law || overrides->n_set > 0),
                         .began = of->since,
                         .watch = *watch};
    int rc = load_experiment_then(r, of, why);
    if (rc == 0)
        rc = replay_make(r, why);
    if (rc == 0)
        rc = find_replayed(r, of, why);
    if (rc < 0)
        return rc;
    for (r->since = of->since; r->since < of->until && rc == 0;) {
        const apc_ns end = of->until - r->since > of->window ? r->since + of->window : of->until;
        if ((rc = load_window(r, of->store, end)) < 0)
            return apc_fail(why, rc, "%s", rc == APC_ENOMEM ? "out of memory" : apc_store_error(of->store));
        for (size_t i = 0; i < r->e.n_controllers && rc == 0; i++)
            if (!of->controller || strcmp(of->controller, r->e.controllers[i].name) == 0)
                rc = replay_window(r, &r->controller[i]);
        r->since = end;
    }
    return rc < 0 ? apc_fail(why, rc, "%s", r->why.text) : 0;
}

/* SPDX-License-Identifier: BSD-3-Clause */
#include "whatif.h"

#include <string.h>

#include "apc/common/cli.h"
#include "common/storeuri.h"
#include "experiment/experiment.h"
#include "record/record.h"

int whatif_parse(struct whatif *w, const char *spec, struct apc_error *why)
{
    const char *at = strrchr(spec, '@');
    const size_t length = at ? (size_t)(at - spec) : 0;
    *w = (struct whatif){.spec = spec};
    if (!at || length == 0 || length >= sizeof w->dir)
        return apc_fail(why, APC_EINVAL,
                        "\"%s\": expected RUN@TIME, a run folder and seconds since its start, or STORE@TIME",
                        spec);
    memcpy(w->dir, spec, length);
    if (store_is_uri(w->dir)) {
        memcpy(w->store, spec, length);
        return cli_when(at + 1, &w->utc)
                   ? 0
                   : apc_fail(why, APC_EINVAL,
                              "\"%s\": \"%s\" must be a time, as 2026-01-31T12:00:00Z, 2026-01-31, or "
                              "before now, as 30s, 10m, 2h, 1d; seconds alone as -600",
                              spec, at + 1);
    }
    if (apc_number_parse(at + 1, &w->at) < 0 || !(w->at > 0) || w->at > 366 * 86400.0)
        return apc_fail(why, APC_EINVAL, "\"%s\": \"%s\" must be seconds since the start of the run, above 0",
                        spec, at + 1);
    return 0;
}

static apc_ns end_of(const struct whatif *w)
{
    apc_ns end = 0;
    (void)apc_ns_from_s(w->at, &end);
    return end;
}

/* What a run that went on from another one was before: that one's, which its folder keeps. */
static int load_former(struct whatif *w, char *dir, size_t size, struct apc_error *why)
{
    struct experiment former;
    if (!(w->was.past > 0) || w->at > w->was.past)
        return 0;
    snprintf(dir, size, "%s", w->was.past_dir);
    const int rc = experiment_load(&former, dir, EXPERIMENT_MODEL | EXPERIMENT_LAW, NULL, why);
    former.duration = w->was.duration;
    experiment_free(&w->was);
    w->was = former;
    return rc;
}

/* What people wrote to it until then, and from there what they wrote to the run of which @p e is the folder. */
static int write_until_then(struct whatif *w, const struct experiment *e, struct apc_error *why)
{
    const apc_ns end = SIMULATION_BEGIN + end_of(w);
    struct samples after;
    while (w->written.n > 0 && w->written.at[w->written.n - 1].time >= end)
        w->written.n--;
    int rc = simulation_written(e, &after, why);
    for (size_t i = 0; i < after.n && rc >= 0; i++)
        if (after.at[i].time >= end && (rc = samples_add(&w->written, &after.at[i])) < 0)
            apc_fail(why, rc, "out of memory");
    samples_free(&after);
    return rc < 0 ? rc : 0;
}

int whatif_load(struct whatif *w, const struct experiment *e, struct apc_error *why)
{
    struct record_stores there;
    char dir[EXPERIMENT_PATH];
    int rc = w->store[0] ? store_folder_make(&w->made, w->store, w->utc, e->file, why) : 0;
    if (w->store[0]) {
        snprintf(w->dir, sizeof w->dir, "%s", w->made.dir);
        w->at = w->made.at;
    }
    if (rc == 0)
        rc = record_stores(&there, w->dir, why);
    if (rc == 0)
        rc = experiment_load(&w->was, w->dir, EXPERIMENT_MODEL | EXPERIMENT_LAW, NULL, why);
    if (rc < 0)
        return rc;
    if (w->was.duration > 0 && w->at >= w->was.duration)
        return apc_fail(why, APC_EINVAL,
                        "%s ended at %g s: it does not go on from %g s; expected a time before its end",
                        w->store[0] ? w->spec : w->dir, w->was.duration, w->at);
    if (w->at >= e->duration)
        return apc_fail(why, APC_EINVAL,
                        "it ends at %g s, before it could go on from %g s: --duration SECONDS", e->duration,
                        w->at);
    if (!w->was.plant.model)
        return apc_fail(why, APC_EINVAL, "%s names no model of its plant: there is nothing to simulate",
                        w->dir);
    snprintf(dir, sizeof dir, "%s", w->dir);
    rc = load_former(w, dir, sizeof dir, why);
    if (rc < 0)
        return rc;
    rc = simulation_written(&w->was, &w->written, why);
    w->played = rc == 0 && w->was.start;
    if (w->played)
        return playback_load(&w->playback, dir, &w->was, end_of(w), why);
    if (rc > 0)
        rc = write_until_then(w, e, why);
    while (w->was.n_actions > 0 && w->was.action[w->was.n_actions - 1].at >= end_of(w))
        w->was.n_actions--;
    return rc;
}

static int go_on(const struct whatif *w, struct simulation *s, const struct experiment *e,
                 struct apc_error *why)
{
    const int rc = simulation_run(s, w->at);
    if (rc < 0)
        return apc_fail(why, rc, "%s", s->why.text);
    return s->interrupted ? 0 : simulation_branch(s, e, why);
}

int whatif_begin(const struct whatif *w, struct simulation *s, const struct experiment *e,
                 struct apc_error *why)
{
    int rc = w->played ? simulation_create_after(s, &w->was, w->was.seed, &w->playback, why)
                       : simulation_create(s, &w->was, w->was.seed, why);
    if (rc == 0 && w->written.n > 0 && (rc = simulation_repeat_writes(s, &w->written)) < 0)
        apc_fail(why, rc, "out of memory");
    return rc < 0 ? rc : go_on(w, s, e, why);
}

/* ---- What a run in real time is worth ------------------------------------------------------- */

static int tell_lateness(const struct whatif *w, const struct controller *c, FILE *out)
{
    struct ticks ticks;
    unsigned long long n = 0, missed = 0;
    apc_ns late = 0;
    int64_t before = -1;
    const int rc = ticks_load(&ticks, w->playback.ticks, APC_TICK, c->number, w->playback.end);
    for (size_t i = 0; i < ticks.n && rc == 0; i++, n++) {
        const apc_ns since = ticks.at[i].time - w->playback.start - c->rhythm.phase;
        const int64_t place = since / c->rhythm.period;
        late = since % c->rhythm.period > late ? since % c->rhythm.period : late;
        missed += before >= 0 && place > before ? (unsigned long long)(place - before - 1) : 0;
        before = place;
    }
    if (rc == 0)
        fprintf(out, "%s: %llu ticks from then on, at most %.1f ms late, %llu missed\n", c->name, n,
                1e-6 * (double)late, missed);
    ticks_free(&ticks);
    return rc;
}

static int keep_unchanged(void *unchanged, const struct samples *rows)
{
    return samples_append(unchanged, rows);
}

int whatif_judge(struct whatif *w, FILE *out, struct apc_error *why)
{
    struct simulation s = {0};
    int rc = 0;
    if (!w->played)
        return 0;
    for (size_t i = 0; i < w->was.n_controllers && rc == 0; i++)
        if ((rc = tell_lateness(w, &w->was.controllers[i], out)) < 0)
            apc_fail(why, rc, "%s", apc_store_error(w->playback.ticks));
    if (rc == 0)
        rc = whatif_begin(w, &s, &w->was, why);
    if (rc == 0 && (rc = simulation_stream(&s, w->was.duration, keep_unchanged, &w->unchanged)) < 0)
        *why = s.why;
    simulation_destroy(&s);
    return rc;
}

void whatif_free(struct whatif *w)
{
    samples_free(&w->written);
    samples_free(&w->unchanged);
    playback_free(&w->playback);
    experiment_free(&w->was);
    store_folder_drop(&w->made);
}

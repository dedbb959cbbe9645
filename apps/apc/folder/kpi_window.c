/* SPDX-License-Identifier: BSD-3-Clause */
#include "kpi_window.h"

#include <math.h>
#include <stdlib.h>
#include <unistd.h>

#include "record/record.h"
#include "simulation/simulation.h"

static int take_window_time(double t, apc_ns otherwise, const char *name, apc_ns *to, struct apc_error *why)
{
    *to = otherwise;
    return isnan(t) || apc_ns_from_s(t, to) == 0
               ? 0
               : apc_fail(why, APC_EINVAL, "--%s %g s: is too large", name, t);
}

/* NULL: the run has none, a former version has made it. */
static int open_published(struct apc_store **store, const char *dir, struct apc_error *why)
{
    char path[600];
    snprintf(path, sizeof path, "%.580s/" TICKS_FILE, dir);
    *store = NULL;
    return access(path, R_OK) == 0 ? ticks_open(store, path, why) : 0;
}

static int nothing_recorded(struct apc_error *why)
{
    return apc_fail(why, APC_EINVAL,
                    "the window is empty: it ends before it begins, or nothing was recorded");
}

static int make_window_kpis(struct kpis *m, struct kpis_source *s, const struct experiment *e,
                            struct apc_error *why)
{
    struct loops loops;
    struct apc_tag *tag = provision_tags(e, &s->n_tags);
    int rc = controllers_describe(e, &loops);
    s->tag = tag;
    s->loops = &loops;
    if (rc == 0)
        rc = tag ? kpis_make(m, s) : APC_ENOMEM;
    if (rc < 0)
        apc_fail(why, rc, "%s",
                 rc == APC_ENOMEM || !s->published ? apc_err_text(rc) : apc_store_error(s->published));
    s->loops = NULL;
    s->tag = NULL;
    loops_free(&loops);
    free(tag);
    return rc;
}

int window_of_run(struct kpis *m, const struct experiment *e, const char *dir, double from, double until,
                  const double *horizon, struct apc_error *why)
{
    struct samples process, operation = {0};
    struct kpis_source s = {.process = &process,
                            .operation = &operation,
                            .offset = e->start ? e->start : SIMULATION_BEGIN,
                            .horizon = horizon};
    *m = (struct kpis){0};
    int rc = samples_read(&process, dir, "samples.csv", why);
    if (rc == 0)
        rc = samples_read(&operation, dir, "operation.csv", why);
    if (rc == APC_ENOTFOUND && process.n > 0) /* a former version's */
        rc = 0;
    if (rc == 0)
        rc = open_published(&s.published, dir, why);
    if (rc == 0)
        rc = take_window_time(from, 0, "from", &s.from, why);
    const apc_ns end = process.n > 0 ? process.at[process.n - 1].time + 1 : 0;
    if (rc == 0)
        rc = take_window_time(until, end, "to", &s.until, why);
    if (rc == 0 && s.from >= (s.until < end ? s.until : end))
        rc = apc_fail(why, APC_EINVAL, "the window is empty: from %g s to %g s of a record that ends at %g s",
                      apc_ns_to_s(s.from), apc_ns_to_s(s.until), apc_ns_to_s(end));
    s.until = s.until < end ? s.until : end; /* what is not on record is no time out of service */
    if (rc == 0)
        rc = make_window_kpis(m, &s, e, why);
    apc_store_close(s.published);
    samples_free(&operation);
    samples_free(&process);
    return rc;
}

static int fail_window(struct apc_error *why, int rc, struct apc_store *store)
{
    if (rc == APC_ENOTFOUND)
        return nothing_recorded(why);
    return apc_fail(why, rc, "%s", rc == APC_ENOMEM ? apc_err_text(rc) : apc_store_error(store));
}

int window_of_store(struct kpis *m, struct apc_store *store, apc_ns from, apc_ns until, struct apc_error *why)
{
    const int rc = kpis_of_store(m, store, from, until, SIZE_MAX);
    return rc < 0 ? fail_window(why, rc, store) : 0;
}

int health_window_of_store(struct kpis *m, struct apc_store *store, const struct health_asked *asked,
                           struct apc_error *why)
{
    const int rc = health_of_store(m, store, asked);
    return rc < 0 ? fail_window(why, rc, store) : kpis_on_record(m) ? 0 : nothing_recorded(why);
}

static int nothing_expected(const struct prediction *o, struct apc_error *why)
{
    return o->n > 0 ? 0
                    : apc_fail(why, APC_ENOTFOUND,
                               "no predictive law had a plan at that time: nothing was expected");
}

int window_prediction_of_run(struct prediction *o, const struct experiment *e, const char *dir, double at,
                             struct apc_error *why)
{
    struct samples process = {0};
    struct apc_store *published = NULL;
    size_t n = 0;
    apc_ns t = 0;
    struct apc_tag *tag = provision_tags(e, &n);
    *o = (struct prediction){0};
    int rc = tag ? take_window_time(at, 0, "at", &t, why) : apc_fail(why, APC_ENOMEM, "out of memory");
    if (rc == 0)
        rc = samples_read(&process, dir, "samples.csv", why);
    if (rc == 0)
        rc = open_published(&published, dir, why);
    if (rc == 0 && published &&
        (rc = prediction_load(o, published, tag, n, t, e->start ? e->start : SIMULATION_BEGIN)) < 0)
        apc_fail(why, rc, "%s", rc == APC_ENOMEM ? apc_err_text(rc) : apc_store_error(published));
    if (rc == 0)
        rc = nothing_expected(o, why);
    if (rc == 0)
        prediction_take(o, process.at, process.n);
    apc_store_close(published);
    samples_free(&process);
    free(tag);
    return rc;
}

int window_prediction_of_store(struct prediction *o, struct apc_store *store, apc_ns at,
                               struct apc_error *why)
{
    int n = apc_store_get_tags(store, NULL, 0);
    struct apc_tag *tag = n < 0 ? NULL : calloc((size_t)n + 1, sizeof *tag);
    *o = (struct prediction){0};
    int rc = n < 0 ? n : !tag ? APC_ENOMEM : apc_store_get_tags(store, tag, (size_t)n);
    if (rc >= 0)
        rc = prediction_load(o, store, tag, (size_t)(rc < n ? rc : n), at, 0);
    if (rc == 0)
        rc = prediction_take_store(o, store, apc_clock_utc(NULL));
    if (rc < 0)
        apc_fail(why, rc, "%s", rc == APC_ENOMEM ? apc_err_text(rc) : apc_store_error(store));
    free(tag);
    return rc < 0 ? rc : nothing_expected(o, why);
}

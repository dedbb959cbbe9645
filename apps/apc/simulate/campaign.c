/* SPDX-License-Identifier: BSD-3-Clause */
#include "campaign_summary.h"

#include <stdlib.h>

#include "base/text.h"

struct all {
    const struct campaign *campaign;
    unsigned runs; /* of each */
};

static void work_on_trial(void *ctx, unsigned job)
{
    const struct all *all = ctx;
    const struct campaign *c = &all->campaign[job / all->runs];
    const unsigned run = job % all->runs;
    trial_make(campaign_trial(c, run), c->e, c->options->seed + run);
    atomic_fetch_add(&c->pool->done, 1);
}

int campaigns_make(struct campaign *c, size_t n, const struct experiment *e, struct loop *loop,
                   const struct campaign_options *options, struct apc_error *why)
{
    const int paired = metrics_loops(e, loop);
    const size_t loops = paired < 0 ? 0 : (size_t)paired, stride = trial_size(loops);
    void *trials = NULL;
    struct worker_pool *pool = paired < 0 ? NULL : worker_pool_create(n * options->runs * stride, &trials);

    for (size_t i = 0; i < n; i++)
        c[i] = (struct campaign){.e = &e[i],
                                 .options = options,
                                 .loop = loop,
                                 .loops = loops,
                                 .stride = stride,
                                 .pool = pool,
                                 .trials = (char *)trials + i * options->runs * stride};
    return pool ? 0 : apc_fail(why, APC_ENOMEM, "no memory for %zu runs", n * options->runs);
}

int campaigns_run(struct campaign *c, size_t n, struct apc_error *why)
{
    struct all all = {c, c->options->runs};
    c->pool->jobs = c->pool->all = (unsigned)n * all.runs;
    c->pool->what = "runs";
    return worker_pool_run(c->pool, c->options->jobs, work_on_trial, &all, why);
}

void campaigns_end(struct campaign *c, size_t n)
{
    worker_pool_destroy(c->pool, n * c->options->runs * c->stride);
    for (size_t i = 0; i < n; i++)
        free(c[i].former);
}

static void keep_first_failure(int *rc, struct apc_error *why, int next, const struct apc_error *its)
{
    if (*rc < 0 || next >= 0)
        return;
    *rc = next;
    *why = *its;
}

int campaign_run(const struct experiment *e, const struct campaign_options *options, struct apc_error *why)
{
    struct loop *loop = calloc(controllers_loops(e) + 1, sizeof *loop);
    struct campaign c;

    if (!loop)
        return apc_fail(why, APC_ENOMEM, "out of memory");
    int rc = campaigns_make(&c, 1, e, loop, options, why);
    if (rc == 0 && options->against)
        rc = summary_read(&c, why);
    if (rc < 0)
        goto out;
    apc_ns began = apc_clock_mono(NULL);
    rc = campaigns_run(&c, 1, why);
    double took = apc_ns_to_s(apc_clock_mono(NULL) - began);
    unsigned done = atomic_load(&c.pool->done);
    fprintf(options->talk, "%s: %s\n%u run%s of %.10g s in %.3g s: %.3g times as fast as real time\n",
            e->name, e->title, done, PLURAL(done), e->duration, took, done * e->duration / took);
    /* All of it, also when something failed: the runs that were made are worth something. */
    struct apc_error next = {""};
    keep_first_failure(&rc, why, summary_print(&c, &next), &next);
    if (options->csv)
        keep_first_failure(&rc, why, summary_csv(&c, &next), &next);
    keep_first_failure(&rc, why, summary_failures(&c, &next), &next);
out:
    campaigns_end(&c, 1);
    free(loop);
    return rc;
}

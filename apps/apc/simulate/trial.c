/* SPDX-License-Identifier: BSD-3-Clause */
#include "trial.h"

#include <errno.h>
#include <signal.h>
#include <stdio.h>
#include <string.h>
#include <sys/prctl.h>
#include <sys/wait.h>
#include <unistd.h>

#include "simulation/simulation.h"
#include "worker_pool.h"

size_t trial_size(size_t loops)
{
    const size_t size = sizeof(struct trial) + loops * METRICS * sizeof(double);
    return (size + CACHE_LINE - 1) / CACHE_LINE * CACHE_LINE;
}

bool trial_counts(const struct trial *t)
{
    return t->made && (t->rc == 0 || t->diverged);
}

static void make_trial(struct trial *t, const struct experiment *e, uint64_t seed)
{
    struct simulation s;
    struct figures figures = {0};
    struct apc_error why = {""};

    t->rc = simulation_create(&s, e, seed, &why);
    if (t->rc == 0) {
        t->rc = simulation_stream(&s, e->duration, NULL, NULL);
        why = s.why;
        t->held = simulation_held(&s);
        t->failures = simulation_failures(&s);
        t->diverged = s.trajectory.diverged;
        t->ended = s.ended;
        t->beyond = figures_beyond(e, &s.trajectory);
        if (figures_make(&figures, &s.trajectory, e) < 0)
            t->rc = APC_ENOMEM;
        for (size_t loop = 0; loop < figures.n_loops; loop++)
            memcpy(t->figure + loop * METRICS, figures.of[loop].figure, METRICS * sizeof(double));
    }
    figures_free(&figures);
    simulation_destroy(&s);
    snprintf(t->why, sizeof t->why, "%.199s", why.text);
    t->made = true;
}

/*
 * Code of the user's may keep something in a static variable, which the next run would find: so each run has
 * a process of its own, in which nothing has run before. One that ends it takes no other run along.
 */
int trial_apart(void (*work)(void *ctx), void *ctx, const bool *made, char *why, size_t size)
{
    int status = 0;
    const pid_t parent = getpid(), pid = fork();
    if (pid == 0) {
        prctl(PR_SET_PDEATHSIG, SIGKILL);
        if (getppid() == parent)
            work(ctx);
        _exit(0);
    }
    while (pid > 0 && waitpid(pid, &status, 0) < 0 && errno == EINTR)
        continue;
    if (*made)
        return 0;
    if (pid < 0)
        snprintf(why, size, "no process for it: %s", strerror(errno));
    else if (WIFSIGNALED(status))
        snprintf(why, size, "its process was ended by signal %d (%s)", WTERMSIG(status),
                 strsignal(WTERMSIG(status)));
    else
        snprintf(why, size, "law or plant ended its process (exit code %d)", WEXITSTATUS(status));
    return APC_ESYS;
}

/* A law or a model of somebody's may keep state of its own. */
bool trial_has_plugin(const struct experiment *e)
{
    bool any = e->model_handle;
    for (size_t i = 0; i < e->n_controllers; i++)
        any = any || e->controllers[i].law_handle;
    return any;
}

struct trial_work {
    struct trial *t;
    const struct experiment *e;
    uint64_t seed;
};

static void work_apart(void *ctx)
{
    const struct trial_work *w = ctx;
    make_trial(w->t, w->e, w->seed);
}

void trial_make(struct trial *t, const struct experiment *e, uint64_t seed)
{
    struct trial_work work = {t, e, seed};
    const int rc = trial_has_plugin(e) ? trial_apart(work_apart, &work, &t->made, t->why, sizeof t->why) : 0;
    if (!trial_has_plugin(e))
        make_trial(t, e, seed);
    t->rc = rc < 0 ? rc : t->rc;
    t->made = true;
}

/* SPDX-License-Identifier: BSD-3-Clause */
/*
 * Processes take the next run from a counter in shared memory and leave its figures there, in the run's own
 * place: so which process made it cannot be seen in the results, and a law that crashes takes one process
 * along, not the campaign.
 */
#include "campaign_summary.h"

#include <errno.h>
#include <malloc.h>
#include <math.h>
#include <signal.h>
#include <stdatomic.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>
#include <sys/prctl.h>
#include <sys/wait.h>
#include <time.h>
#include <unistd.h>

#include "run/simulation.h"

#define BAR  24
#define LINE 64 /* bytes of a cache line: no two processes write the same one */

struct workers {
    pid_t *pid; /* 0: has ended */
    unsigned n;
};

/* ---- The runs ----------------------------------------------------------------------------- */

static void make_run(const struct campaign *c, unsigned run)
{
    struct result *r = campaign_result(c, run);
    struct simulation s;
    struct figures figures = {0};
    struct apc_error why = {""};

    r->rc = simulation_create(&s, c->e, c->options->seed + run, &why);
    if (r->rc == 0) {
        r->rc = simulation_run(&s, c->e->duration);
        why = s.why;
        r->held = simulation_held(&s);
        r->failures = simulation_failures(&s);
        r->diverged = s.course.diverged;
        if (figures_make(&figures, &s.course, c->e) < 0)
            r->rc = APC_ENOMEM;
        for (size_t loop = 0; loop < figures.n_loops; loop++)
            memcpy(campaign_figures(c, run) + loop * METRICS, figures.of[loop].figure,
                   METRICS * sizeof(double));
    }
    figures_free(&figures);
    simulation_destroy(&s);
    snprintf(r->why, sizeof r->why, "%.199s", why.text);
    r->made = true;
    atomic_fetch_add(&c->board->done, 1);
}

/*
 * Code of the user's may keep something in a static variable, which the next run would find: so each run has
 * a process of its own, in which nothing has run before. One that ends it takes no other run along.
 */
static void make_run_apart(const struct campaign *c, unsigned run)
{
    struct result *r = campaign_result(c, run);
    int status = 0;
    const pid_t parent = getpid(), pid = fork();
    if (pid == 0) {
        prctl(PR_SET_PDEATHSIG, SIGKILL);
        if (getppid() == parent)
            make_run(c, run);
        _exit(0);
    }
    while (pid > 0 && waitpid(pid, &status, 0) < 0 && errno == EINTR)
        continue;
    if (r->made)
        return;
    r->rc = APC_ESYS;
    if (pid < 0)
        snprintf(r->why, sizeof r->why, "no process for it: %s", strerror(errno));
    else if (WIFSIGNALED(status))
        snprintf(r->why, sizeof r->why, "its process was ended by signal %d (%s)", WTERMSIG(status),
                 strsignal(WTERMSIG(status)));
    else
        snprintf(r->why, sizeof r->why, "law or plant ended its process (exit code %d)", WEXITSTATUS(status));
    r->made = true;
    atomic_fetch_add(&c->board->done, 1);
}

/* Of one run for the next: or else the kernel clears some 200 pages for each. */
static void keep_memory(void)
{
    mallopt(M_TRIM_THRESHOLD, 256 << 20);
    mallopt(M_MMAP_THRESHOLD, 32 << 20);
}

/* A law or a model of somebody's may keep state of its own. */
static bool any_plugin(const struct experiment *e)
{
    bool any = e->model_handle;
    for (size_t i = 0; i < e->n_controllers; i++)
        any = any || e->controllers[i].law_handle;
    return any;
}

static void work(const struct campaign *c)
{
    unsigned run;
    keep_memory();
    while (!atomic_load(&c->board->stop) && (run = atomic_fetch_add(&c->board->next, 1)) < c->options->runs)
        if (any_plugin(c->e))
            make_run_apart(c, run);
        else
            make_run(c, run);
}

static void show_progress(const struct campaign *c, bool last)
{
    static const char full[] = "########################", empty[] = "........................";
    unsigned done = atomic_load(&c->board->done), all = c->options->runs;
    double share = (double)done / (double)all;
    int filled = (int)(share * BAR);
    if (!isatty(STDERR_FILENO))
        return;
    fprintf(stderr, "\r%u of %u runs  [%.*s%.*s] %3.0f %%%s", done, all, filled, full, BAR - filled, empty,
            100 * share, last ? "\n" : "");
    fflush(stderr);
}

/*
 * The first signal lets the runs at hand come to their end. One that comes later, not as the first one's
 * twin, ends them: a law may not return.
 */
static void take_signal(const struct campaign *c, const struct workers *w, apc_ns *stopped)
{
    const apc_ns now = apc_clock_mono(NULL);
    if (!atomic_exchange(&c->board->stop, true)) {
        *stopped = now;
        if (isatty(STDERR_FILENO))
            fputs("\nwaiting for the runs at hand; Ctrl-C again ends them\n", stderr);
    } else if (now - *stopped > APC_NS_PER_S / 2) {
        for (unsigned i = 0; i < w->n; i++)
            if (w->pid[i] > 0)
                kill(w->pid[i], SIGKILL);
    }
}

static void forget(struct workers *w, pid_t pid)
{
    for (unsigned i = 0; i < w->n; i++)
        if (w->pid[i] == pid)
            w->pid[i] = 0;
}

/* Wait for the workers; the signals are blocked. Returns 0, or APC_ESYS when one of them died. */
static int follow(const struct campaign *c, struct workers *w, const sigset_t *signals, struct apc_error *why)
{
    const struct timespec look = {0, 100 * APC_NS_PER_MS};
    unsigned left = w->n;
    apc_ns stopped = 0;
    int rc = 0, status;
    while (left > 0) {
        int signal = sigtimedwait(signals, NULL, &look);
        if (signal == SIGINT || signal == SIGTERM)
            take_signal(c, w, &stopped);
        show_progress(c, false);
        for (pid_t pid; left > 0 && (pid = waitpid(-1, &status, WNOHANG)) != 0;) {
            if (pid < 0 && errno != EINTR)
                return apc_fail(why, APC_ESYS, "a process was lost: %s", strerror(errno));
            left -= pid > 0;
            forget(w, pid);
            if (pid > 0 && stopped == 0 && (!WIFEXITED(status) || WEXITSTATUS(status) != 0))
                rc = apc_fail(why, APC_ESYS, "a process of the campaign died%s: runs are missing",
                              WIFSIGNALED(status) ? " of a signal" : "");
        }
    }
    show_progress(c, true);
    return rc;
}

static int run_all(const struct campaign *c, struct apc_error *why)
{
    unsigned jobs = c->options->jobs ? c->options->jobs : (unsigned)sysconf(_SC_NPROCESSORS_ONLN);
    struct workers w = {.n = 0};
    sigset_t signals, before;
    int rc = 0;

    if (jobs > c->options->runs)
        jobs = c->options->runs;
    w.pid = calloc(jobs, sizeof *w.pid);
    if (!w.pid)
        return apc_fail(why, APC_ENOMEM, "out of memory");
    sigemptyset(&signals);
    sigaddset(&signals, SIGINT);
    sigaddset(&signals, SIGTERM);
    sigaddset(&signals, SIGCHLD); /* only to wake follow() up */
    sigprocmask(SIG_BLOCK, &signals, &before);
    fflush(NULL);
    while (w.n < jobs && rc == 0) {
        pid_t pid = fork();
        if (pid == 0) {
            work(c);
            _exit(0);
        }
        if (pid < 0) {
            rc = apc_fail(why, APC_ESYS, "no process for the campaign: %s", strerror(errno));
            atomic_store(&c->board->stop, true);
        } else {
            w.pid[w.n++] = pid;
        }
    }
    struct apc_error died = {""};
    int followed = follow(c, &w, &signals, &died);
    if (rc == 0 && followed < 0)
        *why = died;
    free(w.pid);
    sigprocmask(SIG_SETMASK, &before, NULL);
    return rc < 0 ? rc : followed;
}

static void keep_first(int *rc, struct apc_error *why, int next, const struct apc_error *its)
{
    if (*rc < 0 || next >= 0)
        return;
    *rc = next;
    *why = *its;
}

int campaign_run(const struct experiment *e, const struct campaign_options *options, struct apc_error *why)
{
    struct loop *loop = calloc(controllers_loops(e) + 1, sizeof *loop);
    struct campaign c = {.e = e, .options = options, .loop = loop, .first = LINE};
    void *memory = MAP_FAILED;
    int rc = loop ? 0 : apc_fail(why, APC_ENOMEM, "out of memory");

    if (rc < 0)
        return rc;
    c.loops = metrics_loops(e, loop);
    c.stride = sizeof(struct result) + c.loops * METRICS * sizeof(double);
    c.stride = (c.stride + LINE - 1) / LINE * LINE;
    const size_t size = LINE + options->runs * c.stride;
    if (options->against && (rc = summary_read(&c, why)) < 0)
        goto out;
    memory = mmap(NULL, size, PROT_READ | PROT_WRITE, MAP_SHARED | MAP_ANONYMOUS, -1, 0);
    if (memory == MAP_FAILED) {
        rc = apc_fail(why, APC_ENOMEM, "no memory for %u runs", options->runs);
        goto out;
    }
    c.board = memory;
    apc_ns began = apc_clock_mono(NULL);
    rc = run_all(&c, why);
    double took = apc_ns_to_s(apc_clock_mono(NULL) - began);
    unsigned done = atomic_load(&c.board->done);
    fprintf(options->talk, "%s: %s\n%u runs of %.10g s in %.3g s: %.3g times as fast as real time\n", e->name,
            e->title, done, e->duration, took, done * e->duration / took);
    /* All of it, also when something failed: the runs that were made are worth something. */
    struct apc_error next = {""};
    keep_first(&rc, why, summary_print(&c, &next), &next);
    if (options->csv)
        keep_first(&rc, why, summary_csv(&c, &next), &next);
    keep_first(&rc, why, summary_failures(&c, &next), &next);
out:
    if (memory != MAP_FAILED)
        munmap(memory, size);
    free(c.former);
    free(loop);
    return rc;
}

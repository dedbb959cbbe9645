/* SPDX-License-Identifier: BSD-3-Clause */
/*
 * Processes take the next job from a counter in shared memory and leave what came of it there, in the job's
 * own place: so which process did it cannot be seen in the results, and a law that crashes takes one process
 * along, not all.
 */
#include "worker_pool.h"

#include <errno.h>
#include <malloc.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>
#include <sys/prctl.h>
#include <sys/wait.h>
#include <time.h>
#include <unistd.h>

#define BAR   24
#define FIRST ((sizeof(struct worker_pool) + CACHE_LINE - 1) / CACHE_LINE * CACHE_LINE)

struct workers {
    pid_t *pid; /* 0: has ended */
    unsigned n;
};

struct worker_pool *worker_pool_create(size_t size, void **results)
{
    void *memory = mmap(NULL, FIRST + size, PROT_READ | PROT_WRITE, MAP_SHARED | MAP_ANONYMOUS, -1, 0);
    if (memory == MAP_FAILED)
        return NULL;
    *results = (char *)memory + FIRST;
    return memory;
}

void worker_pool_destroy(struct worker_pool *pool, size_t size)
{
    if (pool)
        munmap(pool, FIRST + size);
}

/* Of one run for the next: or else the kernel clears some 200 pages for each. */
static void keep_memory(void)
{
    mallopt(M_TRIM_THRESHOLD, 256 << 20);
    mallopt(M_MMAP_THRESHOLD, 32 << 20);
}

static void do_jobs(struct worker_pool *pool, void (*work)(void *ctx, unsigned job), void *ctx)
{
    unsigned job;
    keep_memory();
    while (!atomic_load(&pool->stop) && (job = atomic_fetch_add(&pool->next, 1)) < pool->jobs)
        work(ctx, job);
}

static void show_progress(const struct worker_pool *pool, bool last)
{
    static const char full[] = "########################", empty[] = "........................";
    const unsigned done = atomic_load(&pool->done);
    const double share = (double)done / (double)pool->all;
    const int filled = (int)(share * BAR);
    if (!isatty(STDERR_FILENO))
        return;
    fprintf(stderr, "\r%u of %u %s  [%.*s%.*s] %3.0f %%%s", done, pool->all, pool->what, filled, full,
            BAR - filled, empty, 100 * share, last ? "\n" : "");
    fflush(stderr);
}

/*
 * The first signal lets the jobs at hand come to their end. One that comes later, not as the first one's
 * twin, ends them: a law may not return.
 */
static void take_signal(struct worker_pool *pool, const struct workers *w, apc_ns *stopped)
{
    const apc_ns now = apc_clock_mono(NULL);
    if (!atomic_exchange(&pool->stop, true)) {
        *stopped = now;
        if (isatty(STDERR_FILENO))
            fprintf(stderr, "\nwaiting for the %s at hand; Ctrl-C again ends them\n", pool->what);
    } else if (now - *stopped > APC_NS_PER_S / 2) {
        for (unsigned i = 0; i < w->n; i++)
            if (w->pid[i] > 0)
                kill(w->pid[i], SIGKILL);
    }
}

/* Was it one of them? A plant may have processes, too. */
static bool forget_worker(struct workers *w, pid_t pid)
{
    bool was = false;

    for (unsigned i = 0; pid > 0 && i < w->n; i++)
        if (w->pid[i] == pid) {
            w->pid[i] = 0;
            was = true;
        }
    return was;
}

/* Wait for the workers; the signals are blocked. Returns 0, or APC_ESYS when one of them died. */
static int follow_workers(struct worker_pool *pool, struct workers *w, const sigset_t *signals,
                          struct apc_error *why)
{
    const struct timespec look = {0, 100 * APC_NS_PER_MS};
    unsigned left = w->n;
    apc_ns stopped = 0;
    int rc = 0, status;
    while (left > 0) {
        int signal = sigtimedwait(signals, NULL, &look);
        if (signal == SIGINT || signal == SIGTERM)
            take_signal(pool, w, &stopped);
        show_progress(pool, false);
        for (pid_t pid; left > 0 && (pid = waitpid(-1, &status, WNOHANG)) != 0;) {
            if (pid < 0 && errno != EINTR)
                return apc_fail(why, APC_ESYS, "a process was lost: %s", strerror(errno));
            const bool was = forget_worker(w, pid);
            left -= was;
            if (was && stopped == 0 && (!WIFEXITED(status) || WEXITSTATUS(status) != 0))
                rc = apc_fail(why, APC_ESYS, "a process of the campaign died%s: runs are missing",
                              WIFSIGNALED(status) ? " of a signal" : "");
        }
    }
    show_progress(pool, true);
    return rc;
}

int worker_pool_run(struct worker_pool *pool, unsigned processes, void (*work)(void *ctx, unsigned job),
                    void *ctx, struct apc_error *why)
{
    unsigned n = processes ? processes : (unsigned)sysconf(_SC_NPROCESSORS_ONLN);
    struct workers w = {.n = 0};
    const pid_t parent = getpid();
    sigset_t signals, before;
    int rc = 0;

    if (n > pool->jobs)
        n = pool->jobs;
    w.pid = calloc(n, sizeof *w.pid);
    if (!w.pid)
        return apc_fail(why, APC_ENOMEM, "out of memory");
    sigemptyset(&signals);
    sigaddset(&signals, SIGINT);
    sigaddset(&signals, SIGTERM);
    sigaddset(&signals, SIGCHLD); /* only to wake follow_workers() up */
    sigprocmask(SIG_BLOCK, &signals, &before);
    fflush(NULL);
    while (w.n < n && rc == 0) {
        pid_t pid = fork();
        if (pid == 0) {
            prctl(PR_SET_PDEATHSIG, SIGKILL);
            if (getppid() == parent)
                do_jobs(pool, work, ctx);
            _exit(0);
        }
        if (pid < 0) {
            rc = apc_fail(why, APC_ESYS, "no process for the campaign: %s", strerror(errno));
            atomic_store(&pool->stop, true);
        } else {
            w.pid[w.n++] = pid;
        }
    }
    struct apc_error died = {""};
    int followed = follow_workers(pool, &w, &signals, &died);
    if (rc == 0 && followed < 0)
        *why = died;
    free(w.pid);
    sigprocmask(SIG_SETMASK, &before, NULL);
    return rc < 0 ? rc : followed;
}

/* SPDX-License-Identifier: BSD-3-Clause */
/* What the threads of tasks have in common, whoever creates them. */
#include "timer/timer_internal.h"

#include <errno.h>
#include <string.h>

/* Fixed, so that it can be touched in advance and locked in memory. Thread-local storage comes out of it. */
#define STACK ((size_t)512 * 1024)
#define PAGE  4096

void apc_task_signals(sigset_t *set)
{
    const int faults[] = {SIGSEGV, SIGBUS, SIGFPE, SIGILL, SIGTRAP, SIGABRT, SIGSYS};
    sigfillset(set);
    for (size_t i = 0; i < sizeof faults / sizeof *faults; i++)
        sigdelset(set, faults[i]);
}

void apc_task_touch_stack(void)
{
    pthread_attr_t attr;
    void *lowest;
    size_t size;
    volatile unsigned char here = 0;

    if (pthread_getattr_np(pthread_self(), &attr) != 0)
        return;
    if (pthread_attr_getstack(&attr, &lowest, &size) == 0) /* without the guard pages */
        for (volatile unsigned char *page = lowest; (uintptr_t)page + PAGE < (uintptr_t)&here; page += PAGE)
            *page = 0;
    pthread_attr_destroy(&attr);
}

void apc_task_cpus(const struct apc_task *task, cpu_set_t *cpus)
{
    CPU_ZERO(cpus);
    CPU_SET((size_t)task->options.cpu - 1, cpus);
}

static void *thread_of_nothing(void *arg)
{
    return arg;
}

static int set_policy(pthread_attr_t *attr, int policy, int priority)
{
    const struct sched_param param = {.sched_priority = priority};
    int err = pthread_attr_setinheritsched(attr, PTHREAD_EXPLICIT_SCHED);
    if (!err)
        err = pthread_attr_setschedpolicy(attr, policy);
    if (!err)
        err = pthread_attr_setschedparam(attr, &param);
    return err;
}

static int set_common(const struct apc_task *task, pthread_attr_t *attr)
{
    sigset_t blocked;
    cpu_set_t cpus;

    apc_task_signals(&blocked);
    int err = pthread_attr_setstacksize(attr, STACK);
    if (!err)
        err = pthread_attr_setsigmask_np(attr, &blocked);
    if (!err && task->options.cpu > 0) {
        apc_task_cpus(task, &cpus);
        err = pthread_attr_setaffinity_np(attr, sizeof cpus, &cpus);
    }
    return err;
}

/*
 * Whether a thread may have this priority is the kernel's to say, and only pthread_create() asks it. For
 * SIGEV_THREAD nobody would hear the answer: the thread would silently not come, at every tick. Hence the
 * trial.
 */
static int try_create(const pthread_attr_t *attr)
{
    pthread_t thread;
    int err = pthread_create(&thread, attr, thread_of_nothing, NULL);
    return err ? err : pthread_join(thread, NULL);
}

int apc_task_thread_attr(struct apc_task *task, pthread_attr_t *attr, struct apc_error *why)
{
    int priority = task->options.priority;
    int err = pthread_attr_init(attr);
    if (err)
        return apc_fail(why, APC_ESYS, "task '%s': thread attributes: %s", task->name, strerror(err));

    err = set_common(task, attr);
    if (!err)
        err = priority > 0 ? set_policy(attr, SCHED_FIFO, priority) : set_policy(attr, SCHED_OTHER, 0);
    if (!err)
        err = try_create(attr);
    if (err == EPERM && priority > 0) {
        if (!atomic_exchange(&task->executive->warned, true))
            apc_log_write(
                task->executive->log, APC_LOG_WARN,
                "real-time priority %d for task '%s' is not permitted: tasks run under SCHED_OTHER; "
                "grant CAP_SYS_NICE or raise RLIMIT_RTPRIO",
                priority, task->name);
        err = set_policy(attr, SCHED_OTHER, 0);
        if (!err)
            err = try_create(attr);
    }
    if (err) {
        pthread_attr_destroy(attr);
        return apc_fail(why, APC_ESYS, "task '%s': no thread with priority %d, cpu option %d: %s", task->name,
                        priority, task->options.cpu, strerror(err));
    }
    return 0;
}

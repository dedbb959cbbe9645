/* SPDX-License-Identifier: BSD-3-Clause */
#include "process_watchdog.h"

#include <errno.h>
#include <poll.h>
#include <pthread.h>
#include <semaphore.h>
#include <signal.h>
#include <stdatomic.h>
#include <stddef.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/socket.h>
#include <sys/un.h>
#include <unistd.h>

#include "common/exitcode.h"
#include "self_monitor.h"

/* Between two words to the watchdog: a period, so that the last tick which it heard of is the last one, within these. */
#define LOOK_MIN (200 * APC_NS_PER_MS)
#define LOOK_MAX APC_NS_PER_S

struct process_watchdog {
    pthread_t thread;
    pthread_mutex_t mutex; /* of `task`, its watch and `look` */
    const struct apc_task *task;
    struct tick_watch watch;
    apc_ns look;
    _Atomic uint64_t ticks, last; /* calls that returned; the index of the last one */
    sem_t came, closed;           /* a signal; the process is about to return from main */
    int notify;
    atomic_int signal, code;
};

static void ours(sigset_t *signals)
{
    sigemptyset(signals);
    sigaddset(signals, SIGTERM);
    sigaddset(signals, SIGINT);
}

static bool before(sem_t *sem, apc_ns timeout)
{
    const apc_ns at = apc_clock_mono(NULL) + timeout;
    const struct timespec t = {at / APC_NS_PER_S, at % APC_NS_PER_S};
    int rc;
    while ((rc = sem_clockwait(sem, CLOCK_MONOTONIC, &t)) < 0 && errno == EINTR)
        ;
    return rc == 0;
}

/* As sd_notify(), which would wait for a supervisor that does not listen. */
void process_watchdog_tell(const struct process_watchdog *w, const char *text)
{
    const char *path = getenv("NOTIFY_SOCKET");
    struct sockaddr_un to = {.sun_family = AF_UNIX};
    size_t n = path ? strlen(path) : 0;

    if (w->notify < 0 || n < 2 || n >= sizeof to.sun_path)
        return;
    memcpy(to.sun_path, path, n);
    if (path[0] == '@')
        to.sun_path[0] = '\0';
    (void)sendto(w->notify, text, strlen(text), MSG_DONTWAIT | MSG_NOSIGNAL, (struct sockaddr *)&to,
                 (socklen_t)(offsetof(struct sockaddr_un, sun_path) + n));
}

/* Returns the time until it is to be fed again. */
static struct timespec feed(struct process_watchdog *w)
{
    char text[64] = "WATCHDOG=1";
    pthread_mutex_lock(&w->mutex);
    uint64_t ticks = atomic_load(&w->ticks);
    bool alive = w->task && tick_watch_look(&w->watch, ticks, apc_task_overruns(w->task, NULL));
    const struct timespec look = {w->look / APC_NS_PER_S, w->look % APC_NS_PER_S};
    pthread_mutex_unlock(&w->mutex);
    if (ticks > 0)
        snprintf(text, sizeof text, "WATCHDOG=1\nAPC_LAST_TICK=%llu",
                 (unsigned long long)atomic_load(&w->last));
    if (alive)
        process_watchdog_tell(w, text);
    return look;
}

static void *run_watchdog(void *arg)
{
    static const char text[] = "a thread did not end within 2 s: given up\n";
    struct process_watchdog *w = arg;
    struct timespec look = {0};
    sigset_t signals;
    int signal;

    ours(&signals);
    while ((signal = sigtimedwait(&signals, NULL, &look)) < 0)
        look = feed(w);
    atomic_store(&w->signal, signal);
    sem_post(&w->came);
    if (before(&w->closed, WARDEN_PATIENCE))
        return NULL;
    struct pollfd out = {.fd = STDERR_FILENO, .events = POLLOUT};
    if (poll(&out, 1, 0) == 1 && write(STDERR_FILENO, text, sizeof text - 1) < 0)
        atomic_store(&w->code, EXIT_ERROR);
    _exit(atomic_load(&w->code));
}

int process_watchdog_create(struct process_watchdog **out)
{
    struct process_watchdog *w = calloc(1, sizeof *w);
    sigset_t signals;

    *out = NULL;
    if (!w)
        return APC_ENOMEM;
    w->look = LOOK_MIN;
    w->notify = socket(AF_UNIX, SOCK_DGRAM | SOCK_CLOEXEC, 0);
    ours(&signals);
    pthread_sigmask(SIG_BLOCK, &signals, NULL);
    sem_init(&w->came, 0, 0);
    sem_init(&w->closed, 0, 0);
    atomic_init(&w->signal, 0);
    atomic_init(&w->code, EXIT_ERROR);
    if (apc_mutex_init(&w->mutex) < 0 || pthread_create(&w->thread, NULL, run_watchdog, w)) {
        if (w->notify >= 0)
            close(w->notify);
        free(w);
        return APC_ESYS;
    }
    *out = w;
    return 0;
}

void process_watchdog_destroy(struct process_watchdog *w)
{
    if (!w)
        return;
    sem_post(&w->closed);
    /* NOLINTNEXTLINE(bugprone-bad-signal-to-kill-thread,cert-pos44-c): it waits for it, blocked */
    pthread_kill(w->thread, SIGTERM);
    pthread_join(w->thread, NULL);
    pthread_mutex_destroy(&w->mutex);
    sem_destroy(&w->came);
    sem_destroy(&w->closed);
    if (w->notify >= 0)
        close(w->notify);
    free(w);
}

int process_watchdog_wait(struct process_watchdog *w, apc_ns timeout)
{
    return before(&w->came, timeout) ? atomic_load(&w->signal) : 0;
}

void process_watchdog_watch(struct process_watchdog *w, const struct apc_task *task, apc_ns period)
{
    pthread_mutex_lock(&w->mutex);
    w->task = task;
    w->look = period < LOOK_MIN ? LOOK_MIN : period > LOOK_MAX ? LOOK_MAX : period;
    pthread_mutex_unlock(&w->mutex);
}

void process_watchdog_ticked(struct process_watchdog *w, uint64_t index)
{
    atomic_store(&w->last, index);
    atomic_fetch_add(&w->ticks, 1);
}

void process_watchdog_ending(struct process_watchdog *w, int code)
{
    process_watchdog_watch(w, NULL, LOOK_MAX);
    atomic_store(&w->code, code);
    /* NOLINTNEXTLINE(bugprone-bad-signal-to-kill-thread,cert-pos44-c): the same */
    pthread_kill(w->thread, SIGTERM);
}

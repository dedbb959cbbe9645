/* SPDX-License-Identifier: BSD-3-Clause */
/*
 * The message is in the command's standard input before the command begins, so that one which does not read,
 * or dies, breaks no pipe: a message is far shorter than what a pipe holds. The command has a process group
 * of its own, which is killed with whatever it started; timeout(1) does it where this process was killed
 * itself.
 */
#include "notifier.h"

#include <errno.h>
#include <fcntl.h>
#include <poll.h>
#include <pthread.h>
#include <signal.h>
#include <spawn.h>
#include <stdlib.h>
#include <string.h>
#include <sys/eventfd.h>
#include <sys/syscall.h>
#include <sys/wait.h>
#include <unistd.h>

#include "files/files.h"

#define WAITING 64 /* alarms; of a flood nobody wants to be told one by one */

#define LOOK (60 * APC_NS_PER_S) /* at what is due later, as clocks are set */

struct raised {
    struct apc_sample row;
    bool again, late; /* late: it is told only if it is still not acknowledged */
    apc_ns due;       /* of what is told later: mono; 0: it is not */
};

struct notifier {
    struct daemon *d;
    const struct alarm_notice *is;
    pthread_t thread;
    int wake, stop; /* eventfds */
    pthread_mutex_t mutex;
    struct raised waiting[WAITING]; /* under mutex, with: */
    size_t first, count;
    unsigned long dropped;
    struct raised *later; /* [alarms] */

    unsigned long untold; /* the thread's own: since it fails; with those dropped meanwhile */
};

/* ---- The message -------------------------------------------------------------------------- */

static char *make_message(const struct experiment *e, const struct alarm_notice *is,
                          const struct raised *raised)
{
    const struct alarm *a = &e->alarm[raised->row.id - 1];
    char time[APC_TIME_LEN];
    struct text t = {0};
    json_add(&t, "{");
    if (is->details)
        json_add(&t, "experiment:%s, alarm:%s", e->name, a->name);
    json_add(&t, "priority:%d, state:%s, time:%s, number:%jd", a->is.priority,
             apc_alarm_state_name((enum apc_alarm_state)(int)raised->row.value),
             apc_time_format(raised->row.time, time), raised->row.origin);
    if (is->details)
        json_add(&t, "area:%s, message:%s, consequence:%s, response:%s", a->area, a->message, a->consequence,
                 a->response);
    json_add(&t, "again:%i}", raised->again);
    text_put(&t, "", 1);
    return t.at;
}

/* A pipe that has the message and a newline in it and ends behind them. Returns its end to read from, or -1
 * with errno. */
static int open_message(const char *text)
{
    int end[2];
    if (pipe2(end, O_CLOEXEC) != 0)
        return -1;
    const size_t n = strlen(text);
    const bool whole = write(end[1], text, n) == (ssize_t)n && write(end[1], "\n", 1) == 1;
    close(end[1]);
    if (whole)
        return end[0];
    close(end[0]);
    return -1;
}

/* ---- The command -------------------------------------------------------------------------- */

/* Returns 0 or an errno. */
static int set_attributes(posix_spawnattr_t *attributes)
{
    sigset_t none, ignored;
    sigemptyset(&none);
    sigemptyset(&ignored);
    sigaddset(&ignored, SIGPIPE);
    int rc = posix_spawnattr_setsigmask(attributes, &none);
    rc = rc ? rc : posix_spawnattr_setsigdefault(attributes, &ignored);
    rc = rc ? rc : posix_spawnattr_setpgroup(attributes, 0);
    return rc ? rc
              : posix_spawnattr_setflags(attributes, POSIX_SPAWN_SETSIGMASK | POSIX_SPAWN_SETSIGDEF |
                                                         POSIX_SPAWN_SETPGROUP);
}

/* Returns 0 or an errno. */
static int spawn_command(const struct alarm_notice *is, int input, pid_t *pid)
{
    char guard[] = "timeout", with[] = "-sKILL", seconds[32];
    char shell[] = "/bin/sh", option[] = "-c", copy[ALARM_COMMAND];
    char *const argv[] = {guard, with, seconds, shell, option, copy, NULL};
    posix_spawn_file_actions_t actions;
    posix_spawnattr_t attributes;
    snprintf(copy, sizeof copy, "%s", is->command);
    snprintf(seconds, sizeof seconds, "%.1f", apc_ns_to_s(is->timeout) + 1);
    int rc = posix_spawn_file_actions_init(&actions);
    if (rc)
        return rc;
    if ((rc = posix_spawnattr_init(&attributes)) == 0) {
        if ((rc = set_attributes(&attributes)) == 0 &&
            (rc = posix_spawn_file_actions_adddup2(&actions, input, STDIN_FILENO)) == 0 &&
            (rc = posix_spawn_file_actions_adddup2(&actions, STDERR_FILENO, STDOUT_FILENO)) == 0)
            rc = posix_spawnp(pid, guard, &actions, &attributes, argv, environ);
        posix_spawnattr_destroy(&attributes);
    }
    posix_spawn_file_actions_destroy(&actions);
    return rc;
}

/* Until it has ended, its time is up, or @p stop can be read. Returns whether it has ended. */
static bool await_command(const struct alarm_notice *is, int stop, pid_t pid)
{
    const int process = (int)syscall(SYS_pidfd_open, pid, 0); /* glibc has it from 2.36 on */
    struct pollfd of[] = {{.fd = process, .events = POLLIN}, {.fd = stop, .events = POLLIN}};
    const apc_ns end = apc_clock_mono(NULL) + is->timeout;
    int ready = process < 0 ? -1 : 0;
    while (ready == 0 && apc_clock_mono(NULL) < end) {
        ready = poll(of, 2, (int)((end - apc_clock_mono(NULL)) / APC_NS_PER_MS) + 1);
        if (ready < 0 && errno == EINTR)
            ready = 0;
    }
    if (process >= 0)
        close(process);
    return ready > 0 && (of[0].revents & POLLIN);
}

/* Returns whether it did what it was to do; if not, @p why says what came. */
static bool run_command(const struct alarm_notice *is, int stop, const char *text, char *why, size_t size)
{
    const int input = open_message(text);
    pid_t pid = -1;
    int status = 0;
    int rc = input < 0 ? errno : spawn_command(is, input, &pid);
    if (input >= 0)
        close(input);
    if (rc != 0) {
        snprintf(why, size, "could not be started: %s", strerror(rc));
        return false;
    }
    const bool ended = await_command(is, stop, pid);
    if (!ended)
        (void)kill(-pid, SIGKILL);
    while (waitpid(pid, &status, 0) < 0 && errno == EINTR)
        ;
    if (!ended)
        snprintf(why, size, "did not end within %g s and was killed", apc_ns_to_s(is->timeout));
    else if (WIFSIGNALED(status))
        snprintf(why, size, "was ended by signal %d", WTERMSIG(status));
    else
        snprintf(why, size, "ended with code %d", WEXITSTATUS(status));
    return ended && WIFEXITED(status) && WEXITSTATUS(status) == 0;
}

/* ---- The thread --------------------------------------------------------------------------- */

static bool is_notifier_stopped(const struct notifier *n)
{
    struct pollfd of = {.fd = n->stop, .events = POLLIN};
    return poll(&of, 1, 0) != 0;
}

static void report_notification(struct notifier *n, const struct raised *raised, bool done, const char *why,
                                unsigned long dropped)
{
    const char *name = n->d->experiment.alarm[raised->row.id - 1].name;
    if (done && n->untold == 0 && dropped == 0)
        return;
    if (!done && n->untold == 0)
        daemon_event(n->d, APC_EVENT_WARNING, "notify", "%.40s was not reported: \"%.80s\" %.100s", name,
                     n->is->command, why);
    n->untold += dropped + !done;
    if (!done)
        return;
    daemon_event(n->d, APC_EVENT_INFO, "notify", "\"%.80s\" receives alarms again; %lu were not reported",
                 n->is->command, n->untold);
    n->untold = 0;
}

/* On record: which step was told of it, or was not. */
static void record_telling(struct notifier *n, const struct raised *raised, const char *what)
{
    const struct experiment *e = &n->d->experiment;
    daemon_event(n->d, APC_EVENT_INFO, "notify", "%.40s: step %td of %zu, \"%.60s\", %s",
                 e->alarm[raised->row.id - 1].name, n->is - e->alarms.notice + 1, e->alarms.n_notices,
                 n->is->command, what);
}

/* Under mutex, like what follows. */
static void queue_raised(struct notifier *n, const struct raised *raised)
{
    if (n->count < WAITING)
        n->waiting[(n->first + n->count++) % WAITING] = *raised;
    else
        n->dropped++;
}

/* Told in @p wait ns, or now, and later again. */
static void plan_notification(struct notifier *n, const struct raised *raised, apc_ns wait)
{
    struct raised *later = &n->later[raised->row.id - 1];
    *later = *raised;
    later->late = true;
    if (wait <= 0) {
        queue_raised(n, raised);
        later->again = true;
        wait = n->is->repeat;
    }
    later->due = wait > 0 ? apc_clock_mono(NULL) + wait : 0;
}

/* What is due waits. Returns ms until there is something to tell, at most; -1: there will be nothing. */
static int queue_due(struct notifier *n)
{
    apc_ns wait = INT64_MAX;
    pthread_mutex_lock(&n->mutex);
    for (size_t i = 0; i < n->d->experiment.n_alarms; i++) {
        const struct raised is = n->later[i];
        const apc_ns now = apc_clock_mono(NULL);
        if (is.due > 0 && is.due <= now)
            plan_notification(n, &is, alarm_notice_quiet(n->is, apc_clock_utc(NULL)));
        if (n->later[i].due > 0 && n->later[i].due - now < wait)
            wait = n->later[i].due - now;
    }
    const bool some = n->count > 0;
    pthread_mutex_unlock(&n->mutex);
    return some ? 0 : wait == INT64_MAX ? -1 : (int)((wait < LOOK ? wait : LOOK) / APC_NS_PER_MS) + 1;
}

static bool take_raised(struct notifier *n, struct raised *raised, unsigned long *dropped)
{
    pthread_mutex_lock(&n->mutex);
    bool some = false;
    while (n->count > 0 && !some) {
        *raised = n->waiting[n->first];
        n->first = (n->first + 1) % WAITING;
        n->count--;
        some = !raised->late || n->later[raised->row.id - 1].row.seq == raised->row.seq;
    }
    if (some) {
        *dropped = n->dropped;
        n->dropped = 0;
    }
    pthread_mutex_unlock(&n->mutex);
    return some;
}

static void tell_waiting(struct notifier *n)
{
    struct raised raised;
    unsigned long dropped;
    while (!is_notifier_stopped(n) && take_raised(n, &raised, &dropped)) {
        char why[128] = "needs more memory than there is";
        char *text = make_message(&n->d->experiment, n->is, &raised);
        const bool done = text && run_command(n->is, n->stop, text, why, sizeof why);
        if (!is_notifier_stopped(n)) {
            report_notification(n, &raised, done, why, dropped);
            record_telling(n, &raised, !done ? "failed" : raised.again ? "was told again" : "was told");
        }
        free(text);
    }
}

static void *serve_notifications(void *ctx)
{
    struct notifier *n = ctx;
    struct pollfd of[] = {{.fd = n->wake, .events = POLLIN}, {.fd = n->stop, .events = POLLIN}};
    while (!is_notifier_stopped(n)) {
        uint64_t count;
        (void)poll(of, 2, queue_due(n));
        (void)!read(n->wake, &count, sizeof count);
        tell_waiting(n);
    }
    return NULL;
}

static void destroy(struct notifier *n)
{
    if (n->wake >= 0)
        close(n->wake);
    if (n->stop >= 0)
        close(n->stop);
    pthread_mutex_destroy(&n->mutex);
    free(n->later);
    free(n);
}

int notifier_start(struct notifier **out, struct daemon *d, const struct alarm_notice *is)
{
    struct notifier *n = calloc(1, sizeof *n);
    *out = NULL;
    if (n)
        n->later = calloc(d->experiment.n_alarms + 1, sizeof *n->later);
    if (!n || !n->later || apc_mutex_init(&n->mutex) < 0) {
        if (n)
            free(n->later);
        free(n);
        return daemon_error(d, APC_ENOMEM, "out of memory");
    }
    n->d = d;
    n->is = is;
    n->wake = eventfd(0, EFD_CLOEXEC | EFD_NONBLOCK);
    n->stop = eventfd(0, EFD_CLOEXEC | EFD_NONBLOCK);
    const int rc =
        n->wake < 0 || n->stop < 0 ? errno : pthread_create(&n->thread, NULL, serve_notifications, n);
    if (rc != 0) {
        destroy(n);
        return daemon_error(d, APC_ESYS, "alarms cannot be sent to \"%s\": %s", is->command, strerror(rc));
    }
    *out = n;
    return 0;
}

/* Under mutex. What is due and not told yet, as an earlier alarm's command still runs; NULL: there is none. What
 * take_raised() is to leave out stays in its place until then. */
static struct raised *find_untold(struct notifier *n, const struct apc_sample *row)
{
    for (size_t i = 0; i < n->count; i++) {
        struct raised *waits = &n->waiting[(n->first + i) % WAITING];
        if (waits->late && !waits->again && waits->row.id == row->id && waits->row.seq == row->seq)
            return waits;
    }
    return NULL;
}

void notifier_tell(struct notifier *n, const struct apc_sample *row, bool again)
{
    const struct raised raised = {.row = *row, .again = again, .late = n->is->after > 0};
    struct raised *later = &n->later[row->id - 1];
    const uint64_t one = 1;
    if (n->d->experiment.alarm[row->id - 1].is.priority > n->is->priority)
        return;
    const apc_ns utc = apc_clock_utc(NULL), stood = utc > row->time ? utc - row->time : 0,
                 left = stood < n->is->after ? n->is->after - stood : 0,
                 wait = left + alarm_notice_quiet(n->is, utc + left);
    pthread_mutex_lock(&n->mutex);
    /* Raised anew before anybody acknowledged it, it has waited since it was raised first. */
    const bool planned = later->due > 0 && !later->again;
    struct raised *untold = planned ? later : find_untold(n, &later->row);
    if (untold)
        untold->row = later->row = *row;
    else
        plan_notification(n, &raised, wait);
    pthread_mutex_unlock(&n->mutex);
    (void)!write(n->wake, &one, sizeof one);
}

void notifier_follow(struct notifier *n, const struct apc_sample *row)
{
    struct raised *later = &n->later[row->id - 1];
    pthread_mutex_lock(&n->mutex);
    const struct raised was = *later;
    if (apc_alarm_is_unacked((enum apc_alarm_state)(int)row->value))
        later->row.value = row->value;
    else
        *later = (struct raised){.due = 0};
    const bool spared = later->row.seq == 0 && (was.again ? find_untold(n, &was.row) != NULL : was.due > 0);
    pthread_mutex_unlock(&n->mutex);
    if (spared)
        record_telling(n, &was, "was not reported: it was acknowledged or masked before");
}

bool notifier_try(const struct experiment *e, const struct alarm_notice *is, char *why, size_t size)
{
    char time[APC_TIME_LEN];
    struct text t = {0};
    json_add(&t, "{");
    if (is->details)
        json_add(&t, "experiment:%s", e->name);
    json_add(&t, "time:%s, message:%s, test:%i}", apc_time_format(apc_clock_utc(NULL), time),
             "a test: nothing happened", true);
    text_put(&t, "", 1);
    const bool done = t.at && run_command(is, -1, t.at, why, size);
    free(t.at);
    return done;
}

void notifier_stop(struct notifier *n)
{
    const uint64_t one = 1;
    if (!n)
        return;
    (void)!write(n->stop, &one, sizeof one);
    pthread_join(n->thread, NULL);
    destroy(n);
}

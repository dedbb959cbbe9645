/* SPDX-License-Identifier: BSD-3-Clause */
#include "supervisor.h"

#include <errno.h>
#include <fcntl.h>
#include <poll.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/prctl.h>
#include <sys/socket.h>
#include <sys/un.h>
#include <sys/wait.h>
#include <unistd.h>

#include <systemd/sd-daemon.h>

#include "common/exitcode.h"

#define SOON     (2 * APC_NS_PER_S)  /* a child that ends so soon after its start has failed */
#define STARTING (20 * APC_NS_PER_S) /* an error in the first so many seconds will not go away by itself */
#define FAILURES 5                   /* in a row, other than for want of a database: give up */
#define PAUSE    (APC_NS_PER_S / 2)  /* before the second try in a row; doubles to 16 times this */
#define PATIENCE 3000                /* ms for a child to stop: it ends itself within 2 s if it can run */
#define READY    (90 * APC_NS_PER_S) /* to the first tick: a law in Python may import for 60 s */
#define MARGIN   (APC_NS_PER_S / 2)  /* between two signs of life, and two looks for them */
#define MESSAGES 256                 /* read at one look: a flood must not keep us */
#define LEAST    (APC_NS_PER_S / 5)  /* from when all are ready to t = 0 */
#define GRID     (APC_NS_PER_S / 10) /* t = 0 is a multiple of it, on the wall clock */

static int find_folder(struct supervisor *s, struct apc_error *why)
{
    ssize_t n = readlink("/proc/self/exe", s->folder, sizeof s->folder - 1);
    if (n <= 0)
        return apc_fail(why, APC_ESYS, "cannot find where the programs are: %s", strerror(errno));
    s->folder[n] = '\0';
    *strrchr(s->folder, '/') = '\0';
    return 0;
}

/* In the child, before execv: as systemd does it. No other thread was there to be forked in the middle of
 * anything. */
static void hand_over(int listener)
{
    char pid[24];
    snprintf(pid, sizeof pid, "%ld", (long)getpid());
    if (dup2(listener, SD_LISTEN_FDS_START) < 0 || setenv("LISTEN_PID", pid, 1) < 0 ||
        setenv("LISTEN_FDS", "1", 1) < 0)
        _exit(127);
    fcntl(SD_LISTEN_FDS_START, F_SETFD, 0);
}

/* @input: what it reads; -1: what this process reads. */
_Noreturn static void become(const char *path, char *const *argv, int log, int listener, int input,
                             pid_t parent)
{
    sigset_t none;
    sigemptyset(&none);
    sigprocmask(SIG_SETMASK, &none, NULL);
    setpgid(0, 0); /* Ctrl-C is for the supervisor, which then stops the children in order */
    prctl(PR_SET_PDEATHSIG, SIGTERM);
    if (getppid() != parent)
        _exit(127);
    dup2(log, STDERR_FILENO);
    dup2(log, STDOUT_FILENO);
    if (input >= 0)
        dup2(input, STDIN_FILENO);
    if (listener > 0)
        hand_over(listener);
    execv(path, argv);
    static const char text[] = "cannot be executed\n";
    if (write(STDERR_FILENO, text, sizeof text - 1) < 0)
        _exit(126);
    _exit(127);
}

/* t = 0 as the wall clock says it now: should it have stepped, a daemon started again still finds the same
 * grid. */
static char *start_time(const struct supervisor *s, char text[APC_TIME_LEN])
{
    const apc_ns us = 1000,
                 now = s->start + apc_clock_offset(NULL, NULL); /* which two readings of clocks tell */
    return apc_time_format(s->simulated ? s->simulated : (now + us / 2) / us * us, text);
}

static const char *title_of(const struct child *child)
{
    return child->title[0] ? child->title : child->name;
}

/* In a name of a file a blank is a nuisance. */
static void name_log(const struct supervisor *s, struct child *child)
{
    const int n = snprintf(child->log, sizeof child->log, "%s/", s->dir);
    snprintf(child->log + n, sizeof child->log - (size_t)n, "%s.log", title_of(child));
    for (char *c = child->log + n; *c; c++)
        *c = *c == ' ' ? '-' : *c;
}

/* @input: on which it asks for t = 0, which is not known yet; -1: it is. */
static int spawn_child(const struct supervisor *s, struct child *child, int input, struct apc_error *why)
{
    char path[600], start[APC_TIME_LEN];
    char after[24];
    const char *argv[20];
    int n = 0;

    snprintf(path, sizeof path, "%s/%s", s->folder, child->name);
    name_log(s, child);
    argv[n++] = path;
    argv[n++] = "--config";
    argv[n++] = s->config;
    argv[n++] = "--start";
    argv[n++] = input >= 0 ? "-" : start_time(s, start);
    if (s->timer && !child->aside) {
        argv[n++] = "--timer";
        argv[n++] = s->timer;
    }
    if (s->spin && !child->aside)
        argv[n++] = "--spin";
    if (s->hold_latency && !child->aside)
        argv[n++] = "--hold-latency";
    if (child->restarts > 0 && !child->aside) {
        snprintf(after, sizeof after, "%lld", (long long)child->last_tick);
        argv[n++] = "--after";
        argv[n++] = after;
    }
    for (int i = 0; child->extra[i]; i++)
        argv[n++] = child->extra[i];
    argv[n] = NULL;

    int log = open(child->log,
                   O_WRONLY | O_CREAT | O_APPEND | O_CLOEXEC | (child->restarts == 0 ? O_TRUNC : 0), 0666);
    if (log < 0)
        return apc_fail(why, APC_ESYS, "%s: cannot be written: %s", child->log, strerror(errno));
    pid_t parent = getpid(), pid = fork();
    if (pid == 0) {
        union { /* execv takes char *const *, for history's sake */
            const char **from;
            char **to;
        } args = {argv};
        become(path, args.to, log, child->listener, input, parent);
    }
    close(log);
    if (pid < 0)
        return apc_fail(why, APC_ESYS, "%s: cannot be started: %s", title_of(child), strerror(errno));
    child->pid = pid;
    child->started = apc_clock_mono(NULL);
    child->ticked = child->started + READY;
    child->hung = false;
    return 0;
}

/* ---- That they tick ------------------------------------------------------------------------ */

/* Where only this user can write: whoever else could speak here could keep a hung daemon alive. */
static int open_notify(struct supervisor *s, struct apc_error *why)
{
    struct sockaddr_un at = {.sun_family = AF_UNIX};
    const int on = 1;

    if (s->meeting[0]) /* of the run that was rewound */
        return 0;
    snprintf(s->meeting, sizeof s->meeting, "/tmp/apc-run.XXXXXX");
    if (!mkdtemp(s->meeting)) {
        s->meeting[0] = '\0';
        return apc_fail(why, APC_ESYS, "/tmp: no folder for the daemons' signs of life: %s", strerror(errno));
    }
    snprintf(at.sun_path, sizeof at.sun_path, "%s/notify", s->meeting);
    s->notify = socket(AF_UNIX, SOCK_DGRAM | SOCK_CLOEXEC | SOCK_NONBLOCK, 0);
    if (s->notify < 0 || bind(s->notify, (struct sockaddr *)&at, sizeof at) < 0 ||
        setsockopt(s->notify, SOL_SOCKET, SO_PASSCRED, &on, sizeof on) < 0)
        return apc_fail(why, APC_ESYS, "%s: no socket for the daemons' signs of life: %s", at.sun_path,
                        strerror(errno));
    setenv("NOTIFY_SOCKET", at.sun_path, 1);
    return 0;
}

static void close_notify(struct supervisor *s)
{
    char path[sizeof s->meeting + 8];
    if (!s->meeting[0])
        return;
    if (s->notify >= 0)
        close(s->notify);
    unsetenv("NOTIFY_SOCKET");
    snprintf(path, sizeof path, "%s/notify", s->meeting);
    unlink(path);
    rmdir(s->meeting);
    s->meeting[0] = '\0';
}

/* One message and the process that sent it. False: there is none. */
static bool receive(int fd, char *text, size_t size, pid_t *from)
{
    union {
        char bytes[CMSG_SPACE(sizeof(struct ucred))];
        struct cmsghdr align;
    } control;
    struct iovec io = {text, size - 1};
    struct msghdr m = {.msg_iov = &io,
                       .msg_iovlen = 1,
                       .msg_control = control.bytes,
                       .msg_controllen = sizeof control.bytes};
    ssize_t n = recvmsg(fd, &m, MSG_DONTWAIT | MSG_CMSG_CLOEXEC);
    struct ucred who = {0};

    if (n < 0)
        return false;
    text[n] = '\0';
    for (struct cmsghdr *c = CMSG_FIRSTHDR(&m); c; c = CMSG_NXTHDR(&m, c))
        if (c->cmsg_level == SOL_SOCKET && c->cmsg_type == SCM_CREDENTIALS)
            memcpy(&who, CMSG_DATA(c), sizeof who);
    *from = who.pid;
    return true;
}

/* While this process could not look, messages beyond what the socket holds were lost, and whose is not known:
 * so that time is held against nobody. */
static void hear_children(struct supervisor *s)
{
    const apc_ns now = apc_clock_mono(NULL), away = now - s->heard;
    char text[256];
    pid_t from;
    for (size_t k = 0; k < s->n && s->heard > 0 && away > MARGIN; k++)
        s->child[k].ticked += away;
    s->heard = now;
    for (int i = 0; i < MESSAGES && receive(s->notify, text, sizeof text, &from); i++)
        for (size_t k = 0; k < s->n; k++) {
            struct child *child = &s->child[k];
            const char *last = strstr(text, "APC_LAST_TICK=");
            if (from != child->pid || child->pid == 0)
                continue;
            if (strstr(text, "READY=1") || strstr(text, "WATCHDOG=1"))
                child->ticked = apc_clock_mono(NULL);
            if (last)
                child->last_tick = strtoll(last + strlen("APC_LAST_TICK="), NULL, 10);
        }
}

static void kill_silent(struct child *child)
{
    apc_ns patience = 3 * child->period > APC_NS_PER_S ? 3 * child->period : APC_NS_PER_S;
    apc_ns silent = apc_clock_mono(NULL) - child->ticked;
    if (child->pid == 0 || child->period == 0 || child->hung || silent <= patience + MARGIN)
        return;
    child->hung = true;
    child->faults++;
    kill(child->pid, SIGKILL);
}

/* ---- Start, end, and start again ----------------------------------------------------------- */

/* It has been there before the store, and begins anew with it. */
static void wake_child(const struct supervisor *s, struct child *child)
{
    name_log(s, child);
    child->started = apc_clock_mono(NULL);
    child->ticked = child->started + READY;
    child->restarts = 1;
    kill(child->pid, SIGUSR1);
}

static int spawn_asking(const struct supervisor *s, struct child *child, struct apc_error *why)
{
    int pair[2];
    if (socketpair(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC, 0, pair) < 0)
        return apc_fail(why, APC_ESYS, "%s: no way to tell it t = 0: %s", title_of(child), strerror(errno));
    const int rc = spawn_child(s, child, pair[1], why);
    close(pair[1]);
    child->asks = pair[0];
    return rc;
}

/* When all have what they run and their stores, or after SUPERVISOR_LEAD. */
static void choose_start(struct supervisor *s)
{
    const apc_ns begin = apc_clock_mono(NULL);
    for (size_t i = 0; i < s->n; i++) {
        struct pollfd p = {.fd = s->child[i].asks, .events = POLLIN};
        const apc_ns left = begin + SUPERVISOR_LEAD - apc_clock_mono(NULL);
        if (p.fd > 0)
            poll(&p, 1, left > 0 ? (int)(left / APC_NS_PER_MS) : 0);
    }
    const apc_ns took = apc_clock_mono(NULL) - begin, lead = took < LEAST ? LEAST : took;
    s->chosen = (apc_clock_utc(NULL) + lead + GRID - 1) / GRID * GRID;
    s->start = s->chosen - apc_clock_offset(NULL, NULL);
}

static void answer_start(const struct supervisor *s, const struct child *child)
{
    char text[APC_TIME_LEN], line[APC_TIME_LEN + 1];
    const int n = snprintf(line, sizeof line, "%s\n", apc_time_format(s->chosen, text));
    (void)send(child->asks, line, (size_t)n, MSG_NOSIGNAL); /* whoever has ended is found to have, later */
}

int supervisor_start(struct supervisor *s, struct apc_error *why)
{
    int rc = find_folder(s, why);
    if (rc == 0)
        rc = open_notify(s, why);
    for (size_t i = 0; i < s->n && rc == 0; i++) {
        s->child[i].last_tick = -1;
        if (s->child[i].pid > 0)
            wake_child(s, &s->child[i]);
        else if (!s->simulated && s->child[i].listener <= 0)
            rc = spawn_asking(s, &s->child[i], why);
    }
    if (rc == 0 && !s->simulated)
        choose_start(s);
    for (size_t i = 0; i < s->n; i++) {
        if (s->child[i].asks > 0 && rc == 0)
            answer_start(s, &s->child[i]);
        if (s->child[i].asks > 0)
            close(s->child[i].asks);
        s->child[i].asks = 0;
        if (rc == 0 && s->child[i].pid == 0)
            rc = spawn_child(s, &s->child[i], -1, why);
    }
    if (rc < 0)
        supervisor_stop(s, NULL);
    return rc;
}

/* How much a line of a child's log says about its end: an error before it ran, one of its log, anything else. */
static int weight(const struct child *child, const char *line)
{
    const size_t n = strlen(child->name);
    return strncmp(line, child->name, n) == 0 && (line[n] == ':' || line[n] == ' ') ? 3
           : strstr(line, "level=error")                                            ? 2
                                                                                    : 1;
}

/* The last line that the child left in its log, of those that say most, or, when a signal killed it, which. */
static void last_words(const struct child *child, int status, char *text, size_t size)
{
    char line[512];
    int best = 0;
    FILE *log = WIFSIGNALED(status) ? NULL : fopen(child->log, "re");
    if (WIFSIGNALED(status))
        snprintf(text, size, "%s was killed by signal %d again and again; see %.280s", title_of(child),
                 WTERMSIG(status), child->log);
    else
        snprintf(text, size, "%s ended at once; see %.300s", title_of(child), child->log);
    if (!log)
        return;
    while (fgets(line, sizeof line, log))
        if (line[0] != '\n' && weight(child, line) >= best) {
            best = weight(child, line);
            line[strcspn(line, "\n")] = '\0';
            const char *message = strstr(line, " msg=\"");
            if (message && best < 3) /* the log's, without the quotes */
                snprintf(text, size, "%s: %.*s", title_of(child), (int)strnlen(message + 6, 350) - 1,
                         message + 6);
            else
                snprintf(text, size, "%.390s", line);
        }
    fclose(log);
}

/* "apc-controller was killed by signal 11 (Segmentation fault)" */
static void how_it_ended(const struct child *child, struct apc_error *why)
{
    if (child->hung)
        apc_fail(why, APC_ESTATE, "%s no longer ticked, was killed", title_of(child));
    else if (WIFSIGNALED(child->status))
        apc_fail(why, APC_ESTATE, "%s was killed by signal %d (%s)", title_of(child), WTERMSIG(child->status),
                 sigdescr_np(WTERMSIG(child->status)));
    else
        apc_fail(why, APC_ESTATE, "%s ended with code %d", title_of(child), WEXITSTATUS(child->status));
}

/* A child has ended: when to start it again, or why not. */
static int bury(struct child *child, int status, struct apc_error *why)
{
    char words[400];
    apc_ns now = apc_clock_mono(NULL), ran = now - child->started;
    bool waits = WIFEXITED(status) && WEXITSTATUS(status) == EXIT_CONNECTION;

    child->pid = 0;
    child->status = status;
    if (child->down)
        return 0;
    if (WIFSIGNALED(status) && WTERMSIG(status) != SIGKILL && WTERMSIG(status) != SIGTERM)
        child->faults++;
    child->failures = ran < SOON ? child->failures + 1 : 0;
    if ((WIFEXITED(status) && ran < STARTING && child->restarts == 0) ||
        (child->failures >= FAILURES && !waits)) {
        last_words(child, status, words, sizeof words);
        return apc_fail(why, APC_ESTATE, "%s", words);
    }
    child->started = now;
    if (child->failures > 0)
        child->started += PAUSE << (child->failures < 5 ? child->failures - 1 : 4);
    return 0;
}

void supervisor_wait(struct supervisor *s, apc_ns timeout)
{
    const apc_ns end = apc_clock_mono(NULL) + timeout;
    struct pollfd p = {.fd = s->notify, .events = POLLIN};
    for (apc_ns left = timeout; left > 0; left = end - apc_clock_mono(NULL)) {
        const struct timespec t = {left / APC_NS_PER_S, left % APC_NS_PER_S};
        if (ppoll(&p, 1, &t, NULL) != 1)
            return;
        hear_children(s);
    }
}

int supervisor_check(struct supervisor *s, struct apc_error *why)
{
    int status, revived = 0, rc = 0;
    hear_children(s);
    for (size_t i = 0; i < s->n && rc == 0; i++) {
        struct child *child = &s->child[i];
        if (child->pid > 0 && waitpid(child->pid, &status, WNOHANG) == child->pid)
            rc = bury(child, status, why);
        kill_silent(child); /* what has ended is silent, and did not hang */
        if (rc < 0 && child->aside) {
            child->name = NULL;
            rc = 0;
        }
        if (rc == 0 && child->name && child->pid == 0 && !child->down &&
            apc_clock_mono(NULL) >= child->started) {
            child->restarts++;
            if (!child->raised) {
                revived++;
                how_it_ended(child, why);
            }
            child->raised = false;
            rc = spawn_child(s, child, -1, why);
        }
    }
    return rc < 0 ? rc : revived;
}

void supervisor_down(struct child *child)
{
    child->down = true;
    if (child->pid > 0)
        kill(child->pid, SIGKILL);
}

void supervisor_up(struct child *child)
{
    child->raised = child->down;
    child->down = false;
    if (child->pid == 0)
        child->started = apc_clock_mono(NULL);
}

/* Wait for a child's end in slices, so that no SIGCHLD handler is needed; nobody is to wait for a full
 * socket. */
static bool ended(struct supervisor *s, struct child *child)
{
    for (int waited = 0; waitpid(child->pid, &child->status, WNOHANG) == 0; waited += 10) {
        if (waited >= PATIENCE)
            return false;
        hear_children(s);
        poll(NULL, 0, 10);
    }
    child->pid = 0;
    return true;
}

int supervisor_stop(struct supervisor *s, struct apc_error *why)
{
    int rc = 0;
    for (size_t i = s->n; i-- > 0;) {
        struct child *child = &s->child[i];
        if (child->pid == 0)
            continue;
        /* first: after SIGTERM it would undo the stop by which a tracer takes hold of one that ends */
        kill(child->pid, SIGCONT);
        kill(child->pid, SIGTERM);
        bool killed = !ended(s, child);
        if (killed) {
            kill(child->pid, SIGKILL);
            ended(s, child);
        }
        if (killed)
            rc = apc_fail(why, APC_ESTATE, "%s did not end on request, and was killed", title_of(child));
        else if (child->status != 0 && !child->aside) {
            how_it_ended(child, why);
            rc = APC_ESTATE;
        }
    }
    close_notify(s);
    return rc;
}

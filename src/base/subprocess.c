/* SPDX-License-Identifier: BSD-3-Clause */
#include "base/subprocess.h"

#include <errno.h>
#include <fcntl.h>
#include <poll.h>
#include <signal.h>
#include <spawn.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/socket.h>
#include <sys/wait.h>
#include <unistd.h>

#define LOST_ROOM 24 /* bytes of a line for how many were lost, and its end */

static void keep_said(struct apc_subprocess *c, const char *text, size_t n)
{
    if (n > APC_SUBPROCESS_SAID) {
        c->lost += n - APC_SUBPROCESS_SAID;
        text += n - APC_SUBPROCESS_SAID;
        n = APC_SUBPROCESS_SAID;
    }
    if (c->n_said + n > APC_SUBPROCESS_SAID) {
        const size_t over = c->n_said + n - APC_SUBPROCESS_SAID;

        memmove(c->said, c->said + over, c->n_said - over);
        c->n_said -= over;
        c->lost += over;
    }
    memcpy(c->said + c->n_said, text, n);
    c->n_said += n;
}

/* A pipe holds 64 KiB: more than that many reads is not there. */
void apc_subprocess_listen(struct apc_subprocess *c)
{
    char block[4096];
    ssize_t n = 1;

    for (unsigned i = 0; i < 32 && c->output >= 0 && n > 0; i++) {
        n = read(c->output, block, sizeof(block));
        if (n > 0)
            keep_said(c, block, (size_t)n);
    }
}

void apc_subprocess_said(struct apc_subprocess *c, char *text, size_t size)
{
    const size_t room = size - LOST_ROOM;
    size_t n = c->n_said, used = 0;

    while (n > 0 && (c->said[n - 1] == '\n' || c->said[n - 1] == ' '))
        n--;
    const size_t from = n > room ? n - room : 0;
    if (c->lost + from > 0)
        used = (size_t)snprintf(text, size, "(%llu B) ... ", (unsigned long long)(c->lost + from));
    for (size_t i = from; i < n && used + 1 < size; i++) {
        const unsigned char one = (unsigned char)c->said[i];

        text[used++] = (char)(one == '\n' ? '|' : one < ' ' || one == 127 ? ' ' : one);
    }
    text[used] = '\0';
    c->n_said = 0;
    c->lost = 0;
}

/* ---- Messages -------------------------------------------------------------------------------- */

#define LOOK (APC_NS_PER_S / 10) /* whether it is parted with */

static bool wait_readable(const struct apc_subprocess *c, apc_ns until)
{
    for (;;) {
        const apc_ns left = until - apc_clock_mono(NULL), slice = left < LOOK ? left : LOOK;
        const struct timespec limit = {.tv_nsec = slice > 0 ? slice : 0};
        struct pollfd in = {.fd = c->socket, .events = POLLIN};
        const int n = ppoll(&in, 1, &limit, NULL);

        if (n > 0)
            return true;
        if (n == 0 ? slice == left : errno != EINTR)
            return false;
        if (atomic_load(&c->parting))
            return false;
    }
}

/* That it ended with a message of ours unread is said once, before what it had to say itself. */
static ssize_t receive_message(int fd, void *to, size_t size)
{
    const ssize_t n = recv(fd, to, size, MSG_DONTWAIT);
    return n < 0 && errno == ECONNRESET ? recv(fd, to, size, MSG_DONTWAIT) : n;
}

ssize_t apc_subprocess_take(const struct apc_subprocess *c, void *to, size_t size, apc_ns until)
{
    if (!wait_readable(c, until))
        return -1;
    const ssize_t n = receive_message(c->socket, to, size);
    return n < 0 && errno != EAGAIN && errno != EINTR ? 0 : n;
}

bool apc_subprocess_give(const struct apc_subprocess *c, const void *from, size_t n)
{
    return send(c->socket, from, n, MSG_NOSIGNAL | MSG_DONTWAIT) == (ssize_t)n;
}

/* ---- The process ------------------------------------------------------------------------------- */

void apc_subprocess_bury(struct apc_subprocess *c, bool hung)
{
    int status = 0;

    if (c->socket < 0)
        return;
    if (c->owner == getpid()) {
        siginfo_t about;

        /* What closed its socket without ending is of no use either, nor is what it has started itself. Until
         * it is waited for, its number is nobody else's; and how it has ended stays as it is. */
        if (waitid(P_PID, (id_t)c->pid, &about, WEXITED | WNOHANG | WNOWAIT) == 0) {
            (void)kill(-c->pid, SIGKILL);
            (void)kill(c->pid, SIGKILL);
        }
        while (waitpid(c->pid, &status, 0) < 0 && errno == EINTR)
            ;
        if (hung)
            snprintf(c->end, sizeof(c->end), "did not answer and was killed");
        else if (WIFSIGNALED(status))
            snprintf(c->end, sizeof(c->end), "its process was ended by signal %d", WTERMSIG(status));
        else
            snprintf(c->end, sizeof(c->end), "its process ended, exit code %d", WEXITSTATUS(status));
        apc_subprocess_listen(c);
    }
    close(c->socket);
    close(c->output);
    c->socket = c->output = -1;
}

static char **environment(char *extra)
{
    size_t n = 0;

    while (environ[n])
        n++;
    char **const all = calloc(n + 2, sizeof(*all));
    for (size_t i = 0; all && i < n; i++)
        all[i] = environ[i];
    if (all)
        all[n] = extra;
    return all;
}

static int spawn_subprocess(char *const argv[], char *extra, int socket, int output, pid_t *pid)
{
    char **const env = environment(extra);
    posix_spawn_file_actions_t actions;
    posix_spawnattr_t attributes;
    const struct sched_param normal = {.sched_priority = 0};
    sigset_t none, all;
    int rc = ENOMEM;

    sigemptyset(&none);
    sigfillset(&all);
    if (env && posix_spawn_file_actions_init(&actions) == 0) {
        if (posix_spawnattr_init(&attributes) == 0) {
            /* A group of its own: Ctrl-C is for who asks it. */
            rc = posix_spawnattr_setflags(&attributes, POSIX_SPAWN_SETSIGMASK | POSIX_SPAWN_SETSIGDEF |
                                                           POSIX_SPAWN_SETPGROUP | POSIX_SPAWN_SETSCHEDULER);
            (void)posix_spawnattr_setsigmask(&attributes, &none);
            (void)posix_spawnattr_setsigdefault(&attributes, &all);
            (void)posix_spawnattr_setpgroup(&attributes, 0);
            (void)posix_spawnattr_setschedpolicy(&attributes, SCHED_OTHER);
            (void)posix_spawnattr_setschedparam(&attributes, &normal);
            if (rc == 0 &&
                (rc = posix_spawn_file_actions_addopen(&actions, STDIN_FILENO, "/dev/null", O_RDONLY, 0)) ==
                    0 &&
                (rc = posix_spawn_file_actions_adddup2(&actions, output, STDOUT_FILENO)) == 0 &&
                (rc = posix_spawn_file_actions_adddup2(&actions, output, STDERR_FILENO)) == 0 &&
                (rc = posix_spawn_file_actions_adddup2(&actions, socket, 3)) == 0)
                rc = posix_spawnp(pid, argv[0], &actions, &attributes, argv, env);
            posix_spawnattr_destroy(&attributes);
        }
        posix_spawn_file_actions_destroy(&actions);
    }
    free(env);
    return rc;
}

/* As this process was started (nice, chrt), whichever of its threads asks; of a real-time policy one below,
 * so that what hangs never keeps from the processor who is to kill it. */
static void inherit_scheduling(pid_t pid)
{
    const int policy = sched_getscheduler(getpid()) & ~SCHED_RESET_ON_FORK;
    struct sched_param param;

    if (policy == SCHED_OTHER || sched_getparam(getpid(), &param) < 0)
        return;
    if (policy == SCHED_FIFO || policy == SCHED_RR) {
        if (param.sched_priority == sched_get_priority_min(policy))
            return;
        param.sched_priority--;
    }
    (void)sched_setscheduler(pid, policy, &param);
}

int apc_subprocess_begin(struct apc_subprocess *c, char *const argv[], char *extra, struct apc_error *why)
{
    int pair[2], output[2], rc;

    if (socketpair(AF_UNIX, SOCK_SEQPACKET | SOCK_CLOEXEC, 0, pair) < 0)
        return apc_fail(why, APC_ESYS, "no pair of sockets: %s", strerror(errno));
    if (pipe2(output, O_CLOEXEC | O_NONBLOCK) < 0) {
        rc = apc_fail(why, APC_ESYS, "no pipe: %s", strerror(errno));
        close(pair[0]);
        close(pair[1]);
        return rc;
    }
    rc = spawn_subprocess(argv, extra, pair[1], output[1], &c->pid);
    close(pair[1]);
    close(output[1]);
    c->since = apc_clock_mono(NULL);
    if (rc != 0) {
        close(pair[0]);
        close(output[0]);
        return apc_fail(why, rc == ENOMEM ? APC_ENOMEM : APC_ESYS, "cannot be started: %s", strerror(rc));
    }
    inherit_scheduling(c->pid);
    c->socket = pair[0];
    c->output = output[0];
    c->owner = getpid();
    return 0;
}

void apc_subprocess_disown(struct apc_subprocess *c)
{
    if (c->socket < 0 || c->owner == getpid())
        return;
    close(c->socket);
    close(c->output);
    c->socket = c->output = -1;
}

int apc_subprocess_open(struct apc_subprocess *c, const char *file, bool (*revive)(struct apc_subprocess *))
{
    c->file = file;
    c->revive = revive;
    c->socket = c->output = -1;
    return apc_mutex_init(&c->lock);
}

#define PARTING_S 60

void apc_subprocess_release(struct apc_subprocess *c)
{
    const struct timespec a_while = {.tv_nsec = 2000000};
    const apc_ns until = apc_clock_mono(NULL) + PARTING_S * APC_NS_PER_S;
    bool gone = c->socket < 0 || c->owner != getpid();

    if (!gone)
        (void)shutdown(c->socket, SHUT_RDWR); /* also where a child of ours holds it, too */
    while (!gone && apc_clock_mono(NULL) < until) {
        gone = waitpid(c->pid, NULL, WNOHANG) != 0;
        if (!gone)
            (void)nanosleep(&a_while, NULL);
    }
    if (gone && c->socket >= 0) {
        close(c->socket);
        close(c->output);
        c->socket = c->output = -1;
    }
    apc_subprocess_close(c);
}

void apc_subprocess_close(struct apc_subprocess *c)
{
    apc_subprocess_part(c);
    apc_subprocess_bury(c, true);
    (void)pthread_mutex_destroy(&c->lock);
}

/* ---- Anew, by a thread ------------------------------------------------------------------------- */

/* With nothing of @p c in other hands: calls go by as long as `starting` says so. */
static void *start_again(void *ctx)
{
    struct apc_subprocess *const c = ctx;

    (void)c->revive(c);
    pthread_mutex_lock(&c->lock);
    c->starting = false;
    pthread_mutex_unlock(&c->lock);
    return NULL;
}

void apc_subprocess_start(struct apc_subprocess *c)
{
    const struct sched_param normal = {.sched_priority = 0};
    pthread_attr_t attributes;

    if (c->started == getpid())
        (void)pthread_join(c->starter, NULL); /* it has ended */
    c->started = 0;
    if (pthread_attr_init(&attributes) != 0)
        return;
    (void)pthread_attr_setinheritsched(&attributes, PTHREAD_EXPLICIT_SCHED);
    (void)pthread_attr_setschedpolicy(&attributes, SCHED_OTHER);
    (void)pthread_attr_setschedparam(&attributes, &normal);
    c->starting = true;
    if (pthread_create(&c->starter, &attributes, start_again, c) == 0)
        c->started = getpid(); /* and `starting` is the thread's */
    else
        c->starting = false;
    (void)pthread_attr_destroy(&attributes);
}

void apc_subprocess_settle(struct apc_subprocess *c)
{
    pthread_mutex_lock(&c->lock);
    const bool started = c->started == getpid();
    c->started = 0;
    pthread_mutex_unlock(&c->lock);
    if (started)
        (void)pthread_join(c->starter, NULL);
}

void apc_subprocess_part(struct apc_subprocess *c)
{
    atomic_store(&c->parting, true);
    apc_subprocess_settle(c);
    atomic_store(&c->parting, false);
}

/* SPDX-License-Identifier: BSD-3-Clause */
/*
 * A law in a process of its own: a file in Python. What it does to its process, it does to no other: it may
 * raise, hang, exit, be killed, print without end.
 *
 * The process holds the other end of a pair of sockets (SOCK_SEQPACKET: a message is whole or is not there)
 * and answers one message with one; src/apc/law.py of the package is that side. In real time nobody waits
 * longer than the deadline: no answer is APC_LAW_LATE, and the process is not asked again until it has
 * answered. One that has not for three periods and a second is killed. What has ended is started again by a
 * thread that lives as long as that takes; until then the law has failed. In virtual time all of this is done
 * at once, so that a run is the same each time, but for what hangs: that is killed after APC_LAW_TIMEOUT and
 * stays away.
 *
 * What it prints goes into a pipe that never makes it wait: what does not fit is gone. It is read after each
 * answer, and what came last is told as an event, at most once a second of the schedule, the same again once
 * a minute.
 */
#include "control/process_parts.h"

#include <errno.h>
#include <fcntl.h>
#include <math.h>
#include <poll.h>
#include <signal.h>
#include <spawn.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/socket.h>
#include <sys/wait.h>
#include <unistd.h>

#define FALLS 3 /* in virtual time: so often in a row it may end before it answers */

/* ---- What it prints -------------------------------------------------------------------------- */

static void keep_said(struct process *p, const char *text, size_t n)
{
    if (n > APC_PROCESS_SAID) {
        p->lost += n - APC_PROCESS_SAID;
        text += n - APC_PROCESS_SAID;
        n = APC_PROCESS_SAID;
    }
    if (p->n_said + n > APC_PROCESS_SAID) {
        const size_t over = p->n_said + n - APC_PROCESS_SAID;

        memmove(p->said, p->said + over, p->n_said - over);
        p->n_said -= over;
        p->lost += over;
    }
    memcpy(p->said + p->n_said, text, n);
    p->n_said += n;
}

/* A pipe holds 64 KiB: more than that many reads is not there. */
static void read_said(struct process *p)
{
    char block[4096];
    ssize_t n = 1;

    for (unsigned i = 0; i < 32 && p->output >= 0 && n > 0; i++) {
        n = read(p->output, block, sizeof(block));
        if (n > 0)
            keep_said(p, block, (size_t)n);
    }
}

/* Its end, on one line, into @p text. */
static void take_said(struct process *p, char *text, size_t size)
{
    const size_t room = size - 24;
    size_t n = p->n_said, used = 0;

    while (n > 0 && (p->said[n - 1] == '\n' || p->said[n - 1] == ' '))
        n--;
    const size_t from = n > room ? n - room : 0;
    if (p->lost + from > 0)
        used = (size_t)snprintf(text, size, "(%llu B) ... ", (unsigned long long)(p->lost + from));
    for (size_t i = from; i < n && used + 1 < size; i++) {
        const unsigned char c = (unsigned char)p->said[i];

        text[used++] = (char)(c == '\n' ? '|' : c < ' ' || c == 127 ? ' ' : c);
    }
    text[used] = '\0';
    p->n_said = 0;
    p->lost = 0;
}

static void tell_said(struct process *p, const struct apc_law_call *c)
{
    const double since = p->told_at < 0 || c->t < p->told_at ? HUGE_VAL : c->t - p->told_at;
    const char *tail;

    if (!c->say || p->n_said == 0 || since < 1.0)
        return;
    take_said(p, c->say, APC_LAW_SAY);
    tail = strstr(c->say, ") ... ");
    tail = tail ? tail : c->say;
    if (strcmp(tail, p->told) == 0 && since < 60.0) {
        c->say[0] = '\0';
        return;
    }
    snprintf(p->told, sizeof(p->told), "%s", tail);
    p->told_at = c->t;
}

/* ---- Messages -------------------------------------------------------------------------------- */

static bool wait_readable(int fd, apc_ns until)
{
    for (;;) {
        const apc_ns left = until - apc_clock_mono(NULL);
        const struct timespec limit = {.tv_sec = left > 0 ? left / APC_NS_PER_S : 0,
                                       .tv_nsec = left > 0 ? left % APC_NS_PER_S : 0};
        struct pollfd in = {.fd = fd, .events = POLLIN};
        const int n = ppoll(&in, 1, &limit, NULL);

        if (n > 0)
            return true;
        if (n == 0 || errno != EINTR)
            return false;
    }
}

/* Returns the bytes, 0 when it has ended, -1: nothing in time. */
static ssize_t take(int fd, void *to, size_t size, apc_ns until)
{
    ssize_t n = recv(fd, to, size, MSG_DONTWAIT);

    if (n < 0 && (errno == EAGAIN || errno == EINTR))
        n = wait_readable(fd, until) ? recv(fd, to, size, MSG_DONTWAIT) : -1;
    else if (n < 0)
        n = 0;
    return n < 0 && errno != EAGAIN && errno != EINTR ? 0 : n;
}

bool apc_process_give(int fd, const void *from, size_t n)
{
    return send(fd, from, n, MSG_NOSIGNAL | MSG_DONTWAIT) == (ssize_t)n;
}

/* ---- The process ------------------------------------------------------------------------------- */

void apc_process_bury(struct process *p, bool hung)
{
    int status = 0;

    if (p->socket < 0)
        return;
    if (p->owner == getpid()) {
        /* What closed its socket without ending is of no use either. */
        if (hung || waitpid(p->pid, &status, WNOHANG) == 0) {
            (void)kill(p->pid, SIGKILL);
            while (waitpid(p->pid, &status, 0) < 0 && errno == EINTR)
                ;
        }
        if (hung)
            snprintf(p->end, sizeof(p->end), "did not answer and was killed");
        else if (WIFSIGNALED(status))
            snprintf(p->end, sizeof(p->end), "its process was ended by signal %d", WTERMSIG(status));
        else
            snprintf(p->end, sizeof(p->end), "its process ended, exit code %d", WEXITSTATUS(status));
        read_said(p);
    }
    close(p->socket);
    close(p->output);
    p->socket = p->output = -1;
    p->waiting = false;
}

static char **environment(void)
{
    static char seed[] = "PYTHONHASHSEED=0"; /* sets of texts have one order: a replay is exact */
    size_t n = 0;

    while (environ[n])
        n++;
    char **const all = calloc(n + 2, sizeof(*all));
    for (size_t i = 0; all && i < n; i++)
        all[i] = environ[i];
    if (all)
        all[n] = seed;
    return all;
}

static int spawn(const char *file, int socket, int output, pid_t *pid)
{
    const char *const named = getenv("APC_PYTHON"), *const python = named && *named ? named : "python3";
    char *const argv[] = {(char *)(uintptr_t)python, (char[]){"-m"}, (char[]){"apc.law"},
                          (char *)(uintptr_t)file, NULL};
    char **const env = environment();
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
                rc = posix_spawnp(pid, python, &actions, &attributes, argv, env);
            posix_spawnattr_destroy(&attributes);
        }
        posix_spawn_file_actions_destroy(&actions);
    }
    free(env);
    return rc;
}

int apc_process_begin(struct process *p, struct apc_error *why)
{
    int pair[2], output[2], rc;

    if (socketpair(AF_UNIX, SOCK_SEQPACKET | SOCK_CLOEXEC, 0, pair) < 0)
        return apc_fail(why, APC_ESYS, "%s: no pair of sockets: %s", p->file, strerror(errno));
    if (pipe2(output, O_CLOEXEC | O_NONBLOCK) < 0) {
        rc = apc_fail(why, APC_ESYS, "%s: no pipe: %s", p->file, strerror(errno));
        close(pair[0]);
        close(pair[1]);
        return rc;
    }
    rc = spawn(p->file, pair[1], output[1], &p->pid);
    close(pair[1]);
    close(output[1]);
    p->since = apc_clock_mono(NULL);
    if (rc != 0) {
        close(pair[0]);
        close(output[0]);
        return apc_fail(why, APC_ESYS,
                        "%s: its interpreter, which APC_PYTHON names (else python3), cannot be started: %s",
                        p->file, strerror(rc));
    }
    p->socket = pair[0];
    p->output = output[0];
    p->owner = getpid();
    p->waiting = false;
    return 0;
}

/* Why it did not become one. */
static int refuse(struct process *p, const char *what, struct apc_error *why)
{
    char said[360];

    apc_process_bury(p, p->socket >= 0 && strstr(what, "within"));
    take_said(p, said, sizeof(said));
    return apc_fail(
        why, APC_EINVAL, "%s: %s%s%s%s", p->file, what, said[0] ? ": " : "", said,
        strstr(said, "No module named 'apc'")
            ? ": install it for this interpreter (pip install ./python), or name another in APC_PYTHON"
            : "");
}

int apc_process_hear(struct process *p, char *text, struct apc_error *why)
{
    const ssize_t n = take(p->socket, text, APC_PROCESS_MESSAGE, apc_clock_mono(NULL) + p->timeout);

    if (n < 0)
        return refuse(p, "said nothing within its time", why);
    if (n == 0)
        return refuse(p, "is no law", why);
    text[n] = '\0';
    read_said(p);
    if (strncmp(text, "error\t", 6) == 0)
        return apc_fail(why, APC_EINVAL, "%s: %.400s", p->file, text + 6);
    return 0;
}

int apc_process_introduce(struct process *p, const struct instance *i, char *text, struct apc_error *why)
{
    const struct header header = {.kind = CREATE, .instance = i->number};

    memcpy(i->setup, &header, sizeof(header));
    if (!apc_process_give(p->socket, i->setup, i->setup_length))
        return refuse(p, "does not take its settings", why);
    return apc_process_hear(p, text, why);
}

/* Anew, with all instances that it had. */
static bool revive(struct process *p)
{
    struct apc_error why;
    char *const text = malloc(APC_PROCESS_MESSAGE + 1);
    bool well = text && apc_process_begin(p, &why) == 0 && apc_process_hear(p, text, &why) == 0;

    for (struct instance *i = p->instances; i && well; i = i->next)
        well = apc_process_introduce(p, i, text, &why) == 0;
    if (!well)
        apc_process_bury(p, true);
    free(text);
    return well;
}

/* With nothing of @p p in other hands: calls go by as long as `starting` says so. */
static void *start_again(void *ctx)
{
    struct process *const p = ctx;

    (void)revive(p);
    pthread_mutex_lock(&p->lock);
    p->starting = false;
    pthread_mutex_unlock(&p->lock);
    return NULL;
}

/* A thread of an ordinary priority does it. */
static void call_starter(struct process *p)
{
    const struct sched_param normal = {.sched_priority = 0};
    pthread_attr_t attributes;

    if (p->started)
        (void)pthread_join(p->starter, NULL); /* it has ended */
    p->started = false;
    if (pthread_attr_init(&attributes) != 0)
        return;
    (void)pthread_attr_setinheritsched(&attributes, PTHREAD_EXPLICIT_SCHED);
    (void)pthread_attr_setschedpolicy(&attributes, SCHED_OTHER);
    (void)pthread_attr_setschedparam(&attributes, &normal);
    p->starting = true;
    p->started = pthread_create(&p->starter, &attributes, start_again, p) == 0;
    p->starting = p->started;
    (void)pthread_attr_destroy(&attributes);
}

void apc_process_settle(struct process *p)
{
    pthread_mutex_lock(&p->lock);
    const bool started = p->started && p->owner == getpid();
    p->started = false;
    pthread_mutex_unlock(&p->lock);
    if (started)
        (void)pthread_join(p->starter, NULL);
}

/* ---- Calls ------------------------------------------------------------------------------------- */

static double *put(double *to, const double *from, size_t n, double otherwise)
{
    for (size_t i = 0; i < n; i++)
        to[i] = from ? from[i] : otherwise;
    return to + n;
}

/* What the package's law.py unpacks, in this order. */
static void fill_request(const struct instance *i, const struct apc_law_call *c)
{
    const size_t ny = i->dim.ny, nu = i->dim.nu;
    double *to = (double *)(void *)(i->request + sizeof(struct header));

    *to++ = c->t;
    *to++ = (double)c->tick;
    *to++ = c->budget;
    *to++ = c->gap;
    to = put(to, c->y, ny, 0.0);
    for (size_t k = 0; k < ny; k++)
        *to++ = c->y_status ? (double)c->y_status[k] : 0.0;
    to = put(to, c->y_age, ny, 0.0);
    for (size_t k = 0; k < ny; k++)
        *to++ = c->y_new ? (double)c->y_new[k] : 1.0;
    to = put(to, c->z, i->n_ahead * i->dim.nz, 0.0);
    to = put(to, c->d, i->n_ahead * i->dim.nd, 0.0);
    to = put(to, c->low, nu, -HUGE_VAL);
    to = put(to, c->high, nu, HUGE_VAL);
    to = put(to, c->rate, nu, HUGE_VAL);
    to = put(to, c->y_low, ny, -HUGE_VAL);
    to = put(to, c->y_high, ny, HUGE_VAL);
    to = put(to, c->u_last, nu, (double)NAN);
    for (size_t k = 0; k < nu; k++)
        *to++ = c->out ? (double)c->out[k] : (double)APC_OUT_LAW;
    to = put(to, c->u, nu, 0.0);
    for (size_t k = 0; k < nu; k++)
        *to++ = c->limited ? (double)c->limited[k] : 0.0;
    to = put(to, c->tuning, i->tuning, 0.0);
    (void)put(to, c->x, i->states, 0.0);
}

static int fail_call(const struct apc_law_call *c, int result, const char *text)
{
    if (c->why)
        snprintf(c->why, APC_LAW_WHY, "%s", text);
    return result;
}

/* Has it taken what it was asked before? Returns 0, or what to answer instead. */
static int catch_up(struct process *p, const struct instance *i, const struct apc_law_call *c,
                    apc_ns patience)
{
    while (p->waiting) {
        struct header header;
        const ssize_t n = recv(p->socket, i->answer, i->n_answer, MSG_DONTWAIT);

        if (n == 0 || (n < 0 && errno != EAGAIN && errno != EINTR)) {
            apc_process_bury(p, false);
            return 0;
        }
        if (n < 0 && apc_clock_mono(NULL) - p->since > patience) {
            apc_process_bury(p, true);
            return fail_call(c, APC_LAW_FAILED, p->end);
        }
        if (n < 0)
            return fail_call(c, APC_LAW_LATE, "has not answered an earlier tick yet");
        memcpy(&header, i->answer, n >= (ssize_t)sizeof(header) ? sizeof(header) : 0);
        p->waiting = n < (ssize_t)sizeof(header) || header.number != p->asked;
    }
    return 0;
}

bool apc_process_is_there(struct process *p, bool live)
{
    if (p->socket >= 0 && p->owner != getpid()) { /* it is the parent's */
        close(p->socket);
        close(p->output);
        p->socket = p->output = -1;
    }
    if (p->socket >= 0)
        return true;
    if (p->given_up)
        return false;
    if (!live && (p->falls >= FALLS || !revive(p))) {
        p->given_up = true;
        snprintf(p->end + strlen(p->end), sizeof(p->end) - strlen(p->end), "; it is not asked again");
    } else if (live && apc_clock_mono(NULL) - p->since > APC_NS_PER_S) {
        p->since = apc_clock_mono(NULL);
        call_starter(p);
    }
    return !live && p->socket >= 0;
}

/* Ask with the lock held. Returns 0 and the answer in i->answer, or enum apc_law_result. */
static int exchange(struct process *p, const struct instance *i, enum kind kind, const struct apc_law_call *c,
                    size_t *length)
{
    const bool live = c->deadline != 0;
    const apc_ns patience =
        live ? (apc_ns)(3e9 * (c->budget > 0 ? c->budget : 0.0)) + APC_NS_PER_S : p->timeout;
    struct header header = {.kind = kind, .instance = i->number};
    int rc;

    if (p->starting || !apc_process_is_there(p, live))
        return fail_call(c, APC_LAW_FAILED,
                         p->starting || !p->end[0] ? "its process is being started" : p->end);
    if ((rc = catch_up(p, i, c, patience)) != 0)
        return rc;
    if (p->socket < 0 && (live || !apc_process_is_there(p, live)))
        return fail_call(c, APC_LAW_FAILED, p->end);
    header.number = ++p->asked;
    memcpy(i->request, &header, sizeof(header));
    fill_request(i, c);
    p->since = apc_clock_mono(NULL);
    if (!apc_process_give(p->socket, i->request, sizeof(header) + i->n_request * sizeof(double))) {
        apc_process_bury(p, false); /* killed between two ticks: in virtual time nobody was late yet */
        if (live || !apc_process_is_there(p, live) ||
            !apc_process_give(p->socket, i->request, sizeof(header) + i->n_request * sizeof(double)))
            return fail_call(c, APC_LAW_FAILED, p->end);
    }
    /* What comes after u has gone out gets the other half of the period. */
    const apc_ns until = !live             ? p->since + p->timeout
                         : kind == COMPUTE ? c->deadline
                                           : p->since + (apc_ns)(1e9 * c->budget);
    do {
        const ssize_t n = take(p->socket, i->answer, i->n_answer, until);

        if (n < 0 && live) {
            p->waiting = true;
            return fail_call(c, APC_LAW_LATE, "has not answered in time");
        }
        if (n < (ssize_t)sizeof(header)) {
            p->falls++;
            p->given_up = n < 0;
            apc_process_bury(p, n < 0);
            return fail_call(c, APC_LAW_FAILED, p->end);
        }
        memcpy(&header, i->answer, sizeof(header));
        *length = (size_t)n;
    } while (header.number != p->asked);
    p->falls = 0;
    if (header.result > APC_LAW_FAILED)
        return fail_call(c, APC_LAW_FAILED, "gave no result");
    return 0;
}

int apc_process_ask(const struct apc_law_call *c, enum kind kind)
{
    struct instance *const i = c->self;
    struct process *const p = i->of;
    const double *const from = (const double *)(const void *)(i->answer + sizeof(struct header));
    const size_t own = kind == COMPUTE ? 2 * i->dim.nu + i->published : i->states;
    const size_t needed = sizeof(struct header) + own * sizeof(double);
    struct header header;
    size_t length = 0;
    int rc;

    /* A tick is repeated, at which its process was late, or gone. */
    if (!c->deadline && c->budget <= 0)
        return fail_call(c, c->budget < 0 ? APC_LAW_FAILED : APC_LAW_LATE, "has not answered in time");
    pthread_mutex_lock(&p->lock);
    rc = exchange(p, i, kind, c, &length);
    if (!p->starting) {
        read_said(p);
        tell_said(p, c);
    }
    if (rc == 0) {
        memcpy(&header, i->answer, sizeof(header));
        rc = (int)header.result;
        if (length < needed) {
            rc = fail_call(c, APC_LAW_FAILED, "gave an answer that is too short");
        } else if (kind != COMPUTE) {
            for (size_t k = 0; k < i->states && rc == 0; k++)
                c->x[k] = from[k];
        } else {
            for (size_t k = 0; k < i->dim.nu && rc <= APC_LAW_LATE; k++) {
                c->u[k] = from[k];
                if (c->limited)
                    c->limited[k] |= (unsigned)from[i->dim.nu + k] & (APC_LIMITED_LOW | APC_LIMITED_HIGH);
            }
            for (size_t k = 0; c->published && k < i->published; k++)
                c->published[k] = from[2 * i->dim.nu + k];
            if (length > needed && c->why)
                snprintf(c->why, APC_LAW_WHY, "%.*s", (int)(length - needed),
                         (const char *)i->answer + needed);
        }
    }
    pthread_mutex_unlock(&p->lock);
    return rc;
}

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
#include "control/process.h"

#include "base/base_internal.h"

#include <errno.h>
#include <fcntl.h>
#include <math.h>
#include <poll.h>
#include <signal.h>
#include <spawn.h>
#include <stddef.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/socket.h>
#include <sys/wait.h>
#include <unistd.h>

enum {
    MESSAGE_MAX = 1 << 17, /* bytes of a message, which a socket takes at once */
    SAID_MAX = 1024,       /* of what it printed, the last so many bytes are kept */
    FALLS = 3,             /* in virtual time: so often in a row it may end before it answers */
    TIMEOUT_S = 60
};

enum kind { CREATE = 1, DESTROY, RESET, COMPUTE, UPDATE, TRACK };

struct header {
    uint32_t kind, instance, number, result; /* number: of the request, in its answer as well */
};

struct instance {
    struct process *of;
    struct instance *next;
    uint32_t number;
    struct apc_dim dim;
    size_t tuning, states, n_ahead, published;
    struct apc_published *what;
    char *texts, *setup; /* of what; as it was sent */
    size_t setup_length;
    unsigned char *request, *answer; /* a header, then numbers; room behind the answer for why */
    size_t n_request, n_answer;      /* numbers */
};

struct process {
    struct apc_plugin plugin;
    struct apc_law law;
    char *file, *texts; /* texts: of the law's description */
    struct apc_param *param;
    enum apc_law_scope *scope;
    const char **settings;
    bool resets, updates, tracks;
    uint32_t mark;
    apc_ns timeout;

    pthread_mutex_t lock; /* of all below */
    int socket, output;   /* -1: there is no process */
    pid_t pid, owner;     /* owner: whose it is; a process that was forked since has to start its own */
    uint32_t asked;       /* number of the newest request */
    bool waiting;         /* which has not been answered */
    apc_ns since;         /* mono: of that request; of the last start */
    unsigned falls;
    bool given_up, starting, started;
    pthread_t starter;
    struct instance *instances;
    uint32_t instance; /* number of the newest */
    char end[64];      /* how it ended */
    char said[SAID_MAX];
    size_t n_said;
    uint64_t lost;          /* bytes that were printed before those */
    double told_at;         /* s of the schedule; below 0: nothing was told */
    char told[APC_LAW_SAY]; /* what was, without the bytes before it */
};

/* ---- What it prints -------------------------------------------------------------------------- */

static void keep_said(struct process *p, const char *text, size_t n)
{
    if (n > SAID_MAX) {
        p->lost += n - SAID_MAX;
        text += n - SAID_MAX;
        n = SAID_MAX;
    }
    if (p->n_said + n > SAID_MAX) {
        const size_t over = p->n_said + n - SAID_MAX;

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

static bool give(int fd, const void *from, size_t n)
{
    return send(fd, from, n, MSG_NOSIGNAL | MSG_DONTWAIT) == (ssize_t)n;
}

/* ---- The process ------------------------------------------------------------------------------- */

/* End it, and say how it ended. */
static void bury(struct process *p, bool hung)
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

/* Start it; it has not said anything yet. */
static int begin(struct process *p, struct apc_error *why)
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

    bury(p, p->socket >= 0 && strstr(what, "within"));
    take_said(p, said, sizeof(said));
    return apc_fail(
        why, APC_EINVAL, "%s: %s%s%s%s", p->file, what, said[0] ? ": " : "", said,
        strstr(said, "No module named 'apc'")
            ? ": install it for this interpreter (pip install ./python), or name another in APC_PYTHON"
            : "");
}

/* The text with which it answers in set-up, into @p text [MESSAGE_MAX + 1]; "error TEXT" is why. */
static int hear(struct process *p, char *text, struct apc_error *why)
{
    const ssize_t n = take(p->socket, text, MESSAGE_MAX, apc_clock_mono(NULL) + p->timeout);

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

static int introduce(struct process *p, const struct instance *i, char *text, struct apc_error *why)
{
    const struct header header = {.kind = CREATE, .instance = i->number};

    memcpy(i->setup, &header, sizeof(header));
    if (!give(p->socket, i->setup, i->setup_length))
        return refuse(p, "does not take its settings", why);
    return hear(p, text, why);
}

/* Anew, with all instances that it had. */
static bool revive(struct process *p)
{
    struct apc_error why;
    char *const text = malloc(MESSAGE_MAX + 1);
    bool well = text && begin(p, &why) == 0 && hear(p, text, &why) == 0;

    for (struct instance *i = p->instances; i && well; i = i->next)
        well = introduce(p, i, text, &why) == 0;
    if (!well)
        bury(p, true);
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

/* Nobody starts it any more. */
static void settle(struct process *p)
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
            bury(p, false);
            return 0;
        }
        if (n < 0 && apc_clock_mono(NULL) - p->since > patience) {
            bury(p, true);
            return fail_call(c, APC_LAW_FAILED, p->end);
        }
        if (n < 0)
            return fail_call(c, APC_LAW_LATE, "has not answered an earlier tick yet");
        memcpy(&header, i->answer, n >= (ssize_t)sizeof(header) ? sizeof(header) : 0);
        p->waiting = n < (ssize_t)sizeof(header) || header.number != p->asked;
    }
    return 0;
}

/* Is there a process to be asked? */
static bool is_there(struct process *p, bool live)
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

    if (p->starting || !is_there(p, live))
        return fail_call(c, APC_LAW_FAILED,
                         p->starting || !p->end[0] ? "its process is being started" : p->end);
    if ((rc = catch_up(p, i, c, patience)) != 0)
        return rc;
    if (p->socket < 0 && (live || !is_there(p, live)))
        return fail_call(c, APC_LAW_FAILED, p->end);
    header.number = ++p->asked;
    memcpy(i->request, &header, sizeof(header));
    fill_request(i, c);
    p->since = apc_clock_mono(NULL);
    if (!give(p->socket, i->request, sizeof(header) + i->n_request * sizeof(double))) {
        bury(p, false); /* killed between two ticks: in virtual time nobody was late yet */
        if (live || !is_there(p, live) ||
            !give(p->socket, i->request, sizeof(header) + i->n_request * sizeof(double)))
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
            bury(p, n < 0);
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

/* Ask, and take x or, of compute, the rest out of the answer. */
static int ask(const struct apc_law_call *c, enum kind kind)
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

static int compute(struct apc_law_call *c)
{
    return ask(c, COMPUTE);
}

static void reset(struct apc_law_call *c)
{
    if (((const struct instance *)c->self)->of->resets)
        (void)ask(c, RESET);
}

static void update(struct apc_law_call *c)
{
    if (((const struct instance *)c->self)->of->updates)
        (void)ask(c, UPDATE);
}

static void track(struct apc_law_call *c)
{
    (void)ask(c, TRACK);
}

/* ---- Instances --------------------------------------------------------------------------------- */

static void put_text(FILE *out, const char *text)
{
    fputc('"', out);
    for (const char *c = text ? text : ""; *c; c++) {
        if (*c == '"' || *c == '\\')
            fputc('\\', out);
        if ((unsigned char)*c < ' ')
            fprintf(out, "\\u%04x", (unsigned)(unsigned char)*c);
        else
            fputc(*c, out);
    }
    fputc('"', out);
}

/* As JSON of Python's kind has it: Infinity, NaN. */
static void put_number(FILE *out, double value)
{
    char text[40];

    if (isfinite(value) && apc_number_format(value, text, sizeof(text)) > 0)
        fputs(text, out);
    else
        fputs(isnan(value) ? "NaN" : value > 0 ? "Infinity" : "-Infinity", out);
}

static void put_signals(FILE *out, const char *name, const struct apc_signal_view *signal, size_t n)
{
    fprintf(out, ",\"%s\":[", name);
    for (size_t i = 0; i < n; i++) {
        const struct apc_signal_view none = {.low = -HUGE_VAL,
                                             .high = HUGE_VAL,
                                             .rate = HUGE_VAL,
                                             .soft_low = -HUGE_VAL,
                                             .soft_high = HUGE_VAL},
                                     *const s = signal ? &signal[i] : &none;
        const double limit[] = {s->low, s->high, s->rate, s->soft_low, s->soft_high};

        fputs(i > 0 ? ",[" : "[", out);
        put_text(out, s->name);
        fputc(',', out);
        put_text(out, s->unit);
        for (size_t k = 0; k < sizeof(limit) / sizeof(limit[0]); k++) {
            fputc(',', out);
            put_number(out, limit[k]);
        }
        fputc(']', out);
    }
    fputc(']', out);
}

static void put_settings(FILE *out, const struct apc_law_setup *setup)
{
    fputs(",\"settings\":{", out);
    for (size_t i = 0; i < setup->n_setting; i++) {
        const struct apc_setting *const s = &setup->setting[i];

        fputs(i > 0 ? "," : "", out);
        put_text(out, s->name);
        fputc(':', out);
        if (s->text)
            put_text(out, s->text);
        else
            fprintf(out, "[%zu,%zu", s->rows, s->columns);
        for (size_t k = 0; !s->text && k < s->rows * s->columns; k++) {
            fputc(',', out);
            put_number(out, s->value[k]);
        }
        fputs(s->text ? "" : "]", out);
    }
    fputc('}', out);
}

/* What it is made from, behind room for a header. */
static int write_setup(struct instance *i, const struct apc_law_setup *setup, struct apc_error *why)
{
    const struct header room = {0};
    FILE *const out = open_memstream(&i->setup, &i->setup_length);

    if (!out)
        return apc_fail(why, APC_ENOMEM, "law %s: no memory", i->of->law.name);
    fwrite(&room, sizeof(room), 1, out);
    fprintf(out, "{\"ny\":%zu,\"nz\":%zu,\"nu\":%zu,\"nd\":%zu,\"output\":%zu,\"Ts\":", setup->dim.ny,
            setup->dim.nz, setup->dim.nu, setup->dim.nd, setup->output);
    put_number(out, setup->Ts);
    put_signals(out, "y", setup->y, setup->dim.ny);
    put_signals(out, "z", setup->z, setup->dim.nz);
    put_signals(out, "u", setup->u, setup->dim.nu);
    put_signals(out, "d", setup->d, setup->dim.nd);
    put_settings(out, setup);
    fputc('}', out);
    if (fclose(out) != 0)
        return apc_fail(why, APC_ENOMEM, "law %s: no memory", i->of->law.name);
    if (i->setup_length > MESSAGE_MAX)
        return apc_fail(why, APC_EINVAL, "law %s: its settings take %zu bytes; %d at most", i->of->law.name,
                        i->setup_length, MESSAGE_MAX);
    return 0;
}

/* The next line of @p text, split at its tabs into @p field [n]; what is missing is "". False: there is none.
 */
static bool next_line(char **text, char **field, size_t n)
{
    char *line = *text, *const end = line + strcspn(line, "\n");

    if (!*line)
        return false;
    *text = *end ? end + 1 : end;
    *end = '\0';
    for (size_t i = 0; i < n; i++) {
        char *const tab = line + strcspn(line, "\t");

        field[i] = line;
        line = *tab ? tab + 1 : tab;
        *tab = '\0';
    }
    return true;
}

static size_t count(const char *text, const char *key)
{
    size_t n = 0;

    for (const char *line = text; line && *line; line = strchr(line, '\n') ? strchr(line, '\n') + 1 : NULL)
        n += strncmp(line, key, strlen(key)) == 0;
    return n;
}

static int read_needs(struct instance *i, struct apc_law_needs *needs)
{
    char *text = i->texts, *field[6];

    i->what = calloc(count(text, "published\t") + 1, sizeof(*i->what));
    if (!i->what)
        return APC_ENOMEM;
    while (next_line(&text, field, 6)) {
        if (strcmp(field[0], "states") == 0) {
            needs->states = strtoul(field[1], NULL, 10);
        } else if (strcmp(field[0], "ahead") == 0) {
            needs->n_ahead = strtoul(field[1], NULL, 10);
        } else if (strcmp(field[0], "published") == 0) {
            struct apc_published *const what = &i->what[needs->n_published++];

            *what = (struct apc_published){.name = field[1],
                                           .unit = field[2],
                                           .description = field[3],
                                           .length = strtoul(field[4], NULL, 10)};
            (void)apc_number_parse(field[5], &what->step);
            i->published += what->length ? what->length : 1;
        }
    }
    needs->published = i->what;
    i->states = needs->states;
    i->n_ahead = needs->n_ahead ? needs->n_ahead : 1;
    return 0;
}

static int make_room(struct instance *i, struct apc_error *why)
{
    const struct apc_dim *const d = &i->dim;
    const size_t answer = 2 * d->nu + i->published > i->states ? 2 * d->nu + i->published : i->states;

    i->n_request = 4 + 6 * d->ny + i->n_ahead * (d->nz + d->nd) + 7 * d->nu + i->tuning + i->states;
    i->n_answer = sizeof(struct header) + answer * sizeof(double) + APC_LAW_WHY;
    if (i->states > MESSAGE_MAX || i->n_ahead > MESSAGE_MAX || i->n_answer > MESSAGE_MAX ||
        i->n_request * sizeof(double) + sizeof(struct header) > MESSAGE_MAX)
        return apc_fail(why, APC_EINVAL,
                        "law %s wants %zu states and %zu ticks ahead: a call holds %zu numbers at most",
                        i->of->law.name, i->states, i->n_ahead, MESSAGE_MAX / sizeof(double));
    i->request = calloc(1, sizeof(struct header) + i->n_request * sizeof(double));
    i->answer = calloc(1, i->n_answer);
    return i->request && i->answer ? 0 : apc_fail(why, APC_ENOMEM, "law %s: no memory", i->of->law.name);
}

static int create(const struct apc_law_setup *setup, struct apc_law_needs *needs, void **self,
                  struct apc_error *why)
{
    struct process *const p =
        (struct process *)(void *)((char *)(uintptr_t)setup->law - offsetof(struct process, law));
    struct instance *const i = calloc(1, sizeof(*i));
    char *const text = malloc(MESSAGE_MAX + 1);
    int rc = i && text ? 0 : apc_fail(why, APC_ENOMEM, "law %s: no memory", p->law.name);

    *self = i;
    if (rc == 0) {
        i->of = p;
        i->dim = setup->dim;
        i->tuning = apc_law_parameters(&p->law, &setup->dim);
        rc = write_setup(i, setup, why);
    }
    settle(p);
    pthread_mutex_lock(&p->lock);
    if (rc == 0) {
        i->number = ++p->instance;
        if (!is_there(p, false))
            rc = apc_fail(why, APC_ESTATE, "%s: %s", p->file, p->end);
    }
    if (rc == 0)
        rc = introduce(p, i, text, why);
    if (rc == 0 && (!(i->texts = strdup(text)) || read_needs(i, needs) < 0))
        rc = apc_fail(why, APC_ENOMEM, "law %s: no memory", p->law.name);
    if (rc == 0)
        rc = make_room(i, why);
    if (rc == 0) {
        i->next = p->instances;
        p->instances = i;
    }
    pthread_mutex_unlock(&p->lock);
    free(text);
    return rc;
}

static void destroy(void *self)
{
    struct instance *const i = self;
    struct process *const p = i->of;
    const struct header header = {.kind = DESTROY, .instance = i->number};

    settle(p);
    pthread_mutex_lock(&p->lock);
    for (struct instance **at = &p->instances; *at; at = &(*at)->next) {
        if (*at == i) {
            *at = i->next;
            break;
        }
    }
    if (p->socket >= 0 && p->owner == getpid())
        (void)give(p->socket, &header, sizeof(header));
    pthread_mutex_unlock(&p->lock);
    free(i->what);
    free(i->texts);
    free(i->setup);
    free(i->request);
    free(i->answer);
    free(i);
}

/* ---- The law ------------------------------------------------------------------------------------- */

/* From what it says of itself. */
static int describe(struct process *p, char *text)
{
    struct apc_law *const law = &p->law;
    char *field[8];
    size_t settings = 0;

    p->texts = text;
    p->param = calloc(count(text, "param\t") + 1, sizeof(*p->param));
    p->scope = calloc(count(text, "param\t") + 1, sizeof(*p->scope));
    p->settings = calloc(count(text, "setting\t") + 1, sizeof(*p->settings));
    if (!p->param || !p->scope || !p->settings)
        return APC_ENOMEM;
    *law = (struct apc_law){.abi = APC_LAW_ABI,
                            .name = "",
                            .tuning = p->param,
                            .scope = p->scope,
                            .settings = p->settings,
                            .create = create,
                            .destroy = destroy,
                            .reset = reset,
                            .compute = compute,
                            .update = update};
    while (next_line(&text, field, 8)) {
        if (strcmp(field[0], "name") == 0) {
            law->name = field[1];
        } else if (strcmp(field[0], "description") == 0) {
            law->description = field[1];
        } else if (strcmp(field[0], "version") == 0) {
            law->version = (unsigned)strtoul(field[1], NULL, 10);
        } else if (strcmp(field[0], "whole") == 0) {
            law->whole = field[1][0] == '1';
        } else if (strcmp(field[0], "estimates") == 0) {
            law->estimates = field[1][0] == '1';
        } else if (strcmp(field[0], "has") == 0) {
            p->resets |= strcmp(field[1], "reset") == 0;
            p->updates |= strcmp(field[1], "update") == 0;
            p->tracks |= strcmp(field[1], "track") == 0;
        } else if (strcmp(field[0], "setting") == 0) {
            p->settings[settings++] = field[1];
        } else if (strcmp(field[0], "param") == 0) {
            struct apc_param *const param = &p->param[law->n_tuning];

            p->scope[law->n_tuning++] = (enum apc_law_scope)strtoul(field[1], NULL, 10);
            *param = (struct apc_param){.name = field[2], .unit = field[3], .description = field[4]};
            (void)apc_number_parse(field[5], &param->initial);
            (void)apc_number_parse(field[6], &param->low);
            (void)apc_number_parse(field[7], &param->high);
        }
    }
    law->track = p->tracks ? track : NULL;
    return 0;
}

static void close_process(struct apc_plugin *plugin)
{
    struct process *const p = (struct process *)plugin;

    settle(p);
    bury(p, true);
    (void)pthread_mutex_destroy(&p->lock);
    free(p->file);
    free(p->texts);
    free(p->param);
    free(p->scope);
    free(p->settings);
    free(p);
}

static int mark_file(const char *file, uint32_t *mark, struct apc_error *why)
{
    unsigned char block[4096];
    FILE *const in = fopen(file, "re");
    size_t n;

    if (!in)
        return apc_fail(why, APC_ENOTFOUND, "%s: cannot be read: %s", file, strerror(errno));
    *mark = APC_HASH_BEGIN;
    while ((n = fread(block, 1, sizeof(block), in)) > 0)
        *mark = apc_hash(*mark, block, n);
    fclose(in);
    return 0;
}

static apc_ns read_timeout(void)
{
    const char *const text = getenv("APC_LAW_TIMEOUT");
    double seconds;

    return text && apc_number_parse(text, &seconds) == 0 && seconds > 0 && seconds < 1e6
               ? (apc_ns)(seconds * 1e9)
               : TIMEOUT_S * APC_NS_PER_S;
}

bool apc_law_is_process(const char *name)
{
    const size_t n = strlen(name);

    return n > 3 && strcmp(name + n - 3, ".py") == 0;
}

int apc_law_process_open(const char *file, const struct apc_law **law, void **handle, struct apc_error *why)
{
    struct process *const p = calloc(1, sizeof(*p));
    char *const text = malloc(MESSAGE_MAX + 1);
    int rc = p && text ? mark_file(file, &p->mark, why) : apc_fail(why, APC_ENOMEM, "%s: no memory", file);

    if (rc < 0) {
        free(p);
        free(text);
        return rc;
    }
    p->plugin.close = close_process;
    p->socket = p->output = -1;
    p->told_at = -1.0;
    p->timeout = read_timeout();
    p->file = strdup(file);
    rc = p->file && apc_mutex_init(&p->lock) == 0 ? begin(p, why)
                                                  : apc_fail(why, APC_ENOMEM, "%s: no memory", file);
    if (rc == 0)
        rc = hear(p, text, why);
    if (rc == 0 && describe(p, text) < 0)
        rc = apc_fail(why, APC_ENOMEM, "%s: no memory", file);
    if (rc == 0)
        rc = apc_law_check(&p->law, file, why);
    if (p->texts != text)
        free(text);
    if (rc < 0) {
        close_process(&p->plugin);
        return rc;
    }
    *law = &p->law;
    *handle = p;
    return 0;
}

bool apc_law_in_process(const struct apc_law *law)
{
    return law->compute == compute;
}

uint32_t apc_law_process_mark(const struct apc_law *law)
{
    const struct process *const p =
        (const struct process *)(const void *)((const char *)law - offsetof(struct process, law));

    return apc_law_in_process(law) ? p->mark : 0;
}

/* SPDX-License-Identifier: BSD-3-Clause */
/*
 * From an instant of a simulated plant on, a second run beside it: an `apc run` with a page of its own, which ends when this
 * process does. Of a plant in real time none is started.
 */
#include <errno.h>
#include <fcntl.h>
#include <signal.h>
#include <spawn.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/wait.h>
#include <time.h>
#include <unistd.h>

#include "apc-ui/api/api.h"
#include "simulation/simulation.h"

#define FORKS    4                  /* at once */
#define MOST     99                 /* of one run */
#define PATIENCE (8 * APC_NS_PER_S) /* the page waits for 10 */

#define FORKS_KEPT "APC_UI_FORKS" /* from the process to itself: who runs */

extern char **environ;

struct fork_order {
    char folder[512], log[528], from[40];
};

static pthread_mutex_t mutex = PTHREAD_MUTEX_INITIALIZER;
static pid_t running[FORKS]; /* 0: none */

int forks_keep(void)
{
    char text[FORKS * 12] = "";
    size_t n = 0;
    pthread_mutex_lock(&mutex);
    for (size_t i = 0; i < FORKS; i++)
        n += (size_t)snprintf(text + n, sizeof text - n, "%ld ", (long)running[i]);
    return setenv(FORKS_KEPT, text, 1);
}

void forks_resume(void)
{
    const char *kept = getenv(FORKS_KEPT);
    char *end;
    for (size_t i = 0; kept && i < FORKS; i++, kept = end)
        running[i] = (pid_t)strtol(kept, &end, 10);
    unsetenv(FORKS_KEPT);
}

/* A place for one more; NULL: as many as may be run. */
static pid_t *find_fork_place(void)
{
    pid_t *place = NULL;
    for (size_t i = 0; i < FORKS; i++) {
        if (running[i] > 0 && waitpid(running[i], NULL, WNOHANG) != 0)
            running[i] = 0;
        if (running[i] == 0)
            place = &running[i];
    }
    return place;
}

/* DIR.fork1, ...: the first that is free, by its log. Returns the log, or -1 with errno. */
static int choose_fork_folder(const char *dir, struct fork_order *o)
{
    int fd = -1;
    errno = EEXIST;
    for (int i = 1; i <= MOST && fd < 0 && errno == EEXIST; i++) {
        snprintf(o->folder, sizeof o->folder, "%.490s.fork%d", dir, i);
        snprintf(o->log, sizeof o->log, "%s.log", o->folder);
        fd = open(o->log, O_WRONLY | O_CREAT | O_EXCL | O_APPEND | O_CLOEXEC, 0600);
    }
    return fd;
}

/* Without what is of this run alone. */
static char **fork_environment(char *extra)
{
    static const char *const own[] = {"APC_STORE=",  "APC_SPOOL=",     "APC_HISTORY=",   "APC_FORKED=",
                                      "LISTEN_FDS=", "NOTIFY_SOCKET=", "WATCHDOG_USEC=", NULL};
    size_t n = 0, kept = 0;
    while (environ[n])
        n++;
    char **all = calloc(n + 2, sizeof *all);
    for (size_t i = 0; all && i < n; i++) {
        size_t k = 0;
        while (own[k] && strncmp(environ[i], own[k], strlen(own[k])) != 0)
            k++;
        if (!own[k])
            all[kept++] = environ[i];
    }
    if (all)
        all[kept] = extra;
    return all;
}

/* Returns 0 or an errno. */
static int spawn_fork(const struct fork_order *o, const char *dir, int log, pid_t *pid)
{
    char apc[4096], parent[40];
    const char *argv[] = {apc, "run", "--speed", "0", "--out", o->folder, "--from", o->from, "--", dir, NULL};
    union { /* posix_spawn takes char *const *, for history's sake */
        const char **from;
        char **to;
    } args = {argv};
    const ssize_t n = readlink("/proc/self/exe", apc, sizeof apc - 8);
    posix_spawn_file_actions_t actions;
    posix_spawnattr_t attributes;
    sigset_t none, all;
    if (!strcmp(o->from, "0")) { /* which is the begin of any run */
        argv[6] = "--";
        argv[7] = dir;
        argv[8] = NULL;
    }
    apc[n > 0 ? n : 0] = '\0';
    char *slash = strrchr(apc, '/');
    snprintf(slash ? slash : apc, 8, "/apc");
    snprintf(parent, sizeof parent, "APC_FORKED=%ld", (long)getpid());
    char **env = fork_environment(parent);
    if (!env || posix_spawn_file_actions_init(&actions) != 0) {
        free(env);
        return ENOMEM;
    }
    sigemptyset(&none);
    sigfillset(&all);
    posix_spawnattr_init(&attributes);
    posix_spawnattr_setflags(&attributes,
                             POSIX_SPAWN_SETSIGMASK | POSIX_SPAWN_SETSIGDEF | POSIX_SPAWN_SETPGROUP);
    posix_spawnattr_setsigmask(&attributes, &none);
    posix_spawnattr_setsigdefault(&attributes, &all);
    posix_spawnattr_setpgroup(&attributes, 0);
    int rc = posix_spawn_file_actions_addopen(&actions, STDIN_FILENO, "/dev/null", O_RDONLY, 0);
    for (int fd = STDOUT_FILENO; fd <= STDERR_FILENO && rc == 0; fd++)
        rc = posix_spawn_file_actions_adddup2(&actions, log, fd);
    if (rc == 0)
        rc = posix_spawn(pid, apc, &actions, &attributes, args.to, env);
    posix_spawnattr_destroy(&attributes);
    posix_spawn_file_actions_destroy(&actions);
    free(env);
    return rc;
}

/* The address of its page, as it says itself, or the last that it said. */
static bool read_fork_log(const struct fork_order *o, char page[64], char line[256])
{
    FILE *in = fopen(o->log, "re");
    bool found = false;
    while (in && !found && fgets(line, 256, in))
        found = strchr(line, '\n') && sscanf(line, "page: %63s", page) == 1;
    if (in)
        fclose(in);
    line[strcspn(line, "\n")] = '\0';
    return found;
}

/* False, with the fault set: it has ended, or has no page in time. */
static bool await_fork(struct request *r, const struct fork_order *o, pid_t *pid, char page[64])
{
    const apc_ns until = apc_clock_mono(NULL) + PATIENCE;
    char line[256] = "";
    bool ended = false;
    while (!read_fork_log(o, page, line)) {
        if (ended || apc_clock_mono(NULL) > until) {
            if (!ended)
                kill(*pid, SIGTERM);
            return fault_set(&r->fault, 409, "simulation", NULL, "the second run did not start: %.180s",
                             line);
        }
        ended = waitpid(*pid, NULL, WNOHANG) != 0;
        if (ended)
            *pid = 0;
        nanosleep(&(struct timespec){.tv_nsec = 5 * APC_NS_PER_MS}, NULL);
    }
    return true;
}

static void start_fork(struct request *r, const char *dir, apc_ns from)
{
    struct fork_order o;
    char page[64];
    apc_number_format(apc_ns_to_s(from), o.from, sizeof o.from);
    if (pthread_mutex_trylock(&mutex) != 0) { /* who waited here would keep others from writing */
        fault_set(&r->fault, 409, "simulation", NULL,
                  "another second run is being started: do this again when that is done");
        return;
    }
    pid_t *place = find_fork_place();
    const int log = place ? choose_fork_folder(dir, &o) : -1;
    int rc = 0;
    if (!place)
        fault_set(&r->fault, 409, "simulation", NULL, "%d second runs go on: end one of them before", FORKS);
    else if (log < 0 || (rc = spawn_fork(&o, dir, log, place)) != 0)
        fault_set(&r->fault, 409, "simulation", NULL, "no second run can be started beside %.100s: %s", dir,
                  strerror(log < 0 ? errno : rc));
    if (rc != 0) {
        *place = 0;
        unlink(o.log);
    }
    if (log >= 0)
        close(log);
    if (!r->fault.http && await_fork(r, &o, place, page))
        json_add(&r->reply, "{page:%s, folder:%s}", page, o.folder);
    pthread_mutex_unlock(&mutex);
}

void post_fork(struct ui *ui, struct request *r, struct apc_store *store)
{
    static const char *const members[] = {"from", NULL};
    const char *dir = ui->options.spool;
    struct apc_store_clock clock;
    struct apc_error why;
    double t = 0;
    apc_ns from = 0;
    json_t *body = body_parse(r->body, r->n, members, &r->fault);
    const bool ok = body && member_number(body, "from", &t, &r->fault) && request_may_write(ui, r);
    json_decref(body);
    if (!ok)
        return;
    int rc = model_simulated(&ui->model, store, &clock, &why);
    if (rc > 0 && clock.rewind > 0)
        rc = apc_fail(&why, APC_ESTATE, "the plant is being rewound: do this again when that is done");
    if (rc == APC_ESTATE)
        fault_set(&r->fault, 409, "simulation", NULL, "%.200s", why.text);
    else if (rc <= 0 || !dir)
        fault_set(&r->fault, 409, "simulation", NULL,
                  "only beside a plant of `apc run --speed` that goes on, on its own page, is a second run "
                  "started");
    else if (!(t >= 0) || apc_ns_from_s(t, &from) < 0 || from < SIMULATION_BEGIN || from > clock.now)
        fault_set(&r->fault, 422, "value", "from",
                  "\"from\" must be a time of the plant to which it has come");
    else
        start_fork(r, dir, from - SIMULATION_BEGIN);
}

/* SPDX-License-Identifier: BSD-3-Clause */
/*
 * Running the rows, each a process of its own, and the load. Every child dies with this process, by its
 * parent-death signal if nothing else, and is waited for with a deadline.
 */
#include "jitter.h"

#include <errno.h>
#include <fcntl.h>
#include <inttypes.h>
#include <poll.h>
#include <sched.h>
#include <signal.h>
#include <stdlib.h>
#include <string.h>
#include <sys/prctl.h>
#include <sys/wait.h>
#include <time.h>
#include <unistd.h>

#include "bench.h"

#define PRIORITY      80      /* that of our rows too: see jitter_task.c */
#define CYCLIC_RANGE  1000000 /* ns: cyclictest's histogram; what is beyond counts as its maximum */
#define GRACE         (20 * APC_NS_PER_S) /* for a row to begin and to end */
#define ARGUMENTS_MAX 20

const struct jitter_way_about jitter_ways[WAYS] = {
    [WAY_DEADLINE] = {"deadline", false},
    [WAY_SPIN] = {"deadline, spin", false},
    [WAY_NO_HOLD] = {"deadline, no hold", false},
    [WAY_OTHER] = {"deadline, OTHER", false},
    [WAY_POSIX] = {"posix", false},
    [WAY_LISTING] = {"paper's Listing 2", false},
    [WAY_LOOP] = {"nanosleep loop *", true},
    [WAY_PYTHON] = {"Python Timer *", true},
    [WAY_CYCLIC] = {"cyclictest", false},
    [WAY_CYCLIC_AGAIN] = {"cyclictest again", false},
    [WAY_CYCLIC_NO_HOLD] = {"cyclictest, no hold", false},
};

/* The rows that jitter_task runs, by the names it knows them by. */
static const char *const task_rows[WAYS] = {
    [WAY_DEADLINE] = "deadline", [WAY_SPIN] = "spin",   [WAY_NO_HOLD] = "no-hold",
    [WAY_OTHER] = "other",       [WAY_POSIX] = "posix", [WAY_LOOP] = "loop",
};

/* ---- Signals ------------------------------------------------------------------------------- */

static volatile sig_atomic_t interrupted;

static void interrupt(int signal)
{
    (void)signal;
    interrupted = 1;
}

void jitter_catch_signals(void)
{
    const struct sigaction action = {.sa_handler = interrupt}; /* no SA_RESTART: poll() is to return */

    sigaction(SIGINT, &action, NULL);
    sigaction(SIGTERM, &action, NULL);
    sigaction(SIGHUP, &action, NULL);
}

bool jitter_interrupted(void)
{
    return interrupted != 0;
}

/* ---- Tools --------------------------------------------------------------------------------- */

static const char *find(const char *program)
{
    char path[4096];
    const char *folders = getenv("PATH");

    while (folders && *folders) {
        size_t length = strcspn(folders, ":");
        snprintf(path, sizeof path, "%.*s/%s", (int)length, folders, program);
        if (access(path, X_OK) == 0)
            return program;
        folders += length + (folders[length] == ':');
    }
    return NULL;
}

static bool fifo_allowed(void)
{
    const struct sched_param fifo = {.sched_priority = PRIORITY}, other = {.sched_priority = 0};

    if (sched_setscheduler(0, SCHED_FIFO, &fifo) < 0)
        return false;
    sched_setscheduler(0, SCHED_OTHER, &other);
    return true;
}

void jitter_find_tools(struct jitter_tools *tools)
{
    ssize_t length = readlink("/proc/self/exe", tools->folder, sizeof tools->folder - 1);

    if (length < 0)
        die("/proc/self/exe: %s", strerror(errno));
    tools->folder[length] = '\0';
    *strrchr(tools->folder, '/') = '\0';
    tools->fifo = fifo_allowed();
    tools->cyclictest = tools->fifo ? find("cyclictest") : NULL; /* it refuses to run without */
    tools->stress = find("stress-ng");
    tools->python = find("python3");
}

/* ---- A child ------------------------------------------------------------------------------- */

/* In the child. Its standard output becomes @p out, and its complaints too when it is to be quiet. */
_Noreturn static void become(char *const *argv, int out, bool quiet, pid_t parent)
{
    prctl(PR_SET_PDEATHSIG, SIGTERM);
    if (quiet)
        dup2(out, STDERR_FILENO);
    if (getppid() == parent && dup2(out, STDOUT_FILENO) >= 0)
        execvp(argv[0], argv);
    fprintf(stderr, "%s: %s\n", argv[0], strerror(errno));
    _exit(127);
}

/* Its standard output is @p out, which is closed here. Returns its pid. */
static pid_t start(char *const *argv, int out, bool quiet)
{
    const pid_t self = getpid();

    if (out < 0)
        die("no output for %s: %s", argv[0], strerror(errno));
    fflush(NULL);
    pid_t child = fork();
    if (child < 0)
        die("fork: %s", strerror(errno));
    if (child == 0)
        become(argv, out, quiet, self);
    close(out);
    return child;
}

/* Its standard output comes out of @p from. */
static pid_t start_piped(char *const *argv, int *from, bool quiet)
{
    int ends[2] = {-1, -1};

    if (pipe2(ends, O_CLOEXEC) < 0)
        die("pipe: %s", strerror(errno));
    *from = ends[0];
    return start(argv, ends[1], quiet);
}

/* All that comes until the end; NULL when it does not end by @p deadline or somebody wants to leave. */
static char *read_all(int from, apc_ns deadline)
{
    size_t size = 1 << 16, length = 0;
    char *text = allocate(size, 1);

    for (;;) {
        struct pollfd wait = {.fd = from, .events = POLLIN};
        apc_ns left = deadline - apc_clock_mono(NULL);
        if (interrupted || left <= 0)
            break;
        if (poll(&wait, 1, (int)(left / 1000000) + 1) <= 0)
            continue;
        ssize_t n = read(from, text + length, size - length - 1);
        if (n == 0)
            return text;
        if (n > 0)
            length += (size_t)n;
        if (length + 1 == size) {
            text = realloc(text, size *= 2);
            if (!text)
                die("out of memory");
        }
        text[length] = '\0';
    }
    free(text);
    return NULL;
}

/* Everything that it prints; NULL when it failed. */
static char *finish(pid_t child, int from, apc_ns deadline)
{
    char *text = read_all(from, deadline);
    int status;

    close(from);
    if (!text)
        kill(child, SIGKILL);
    while (waitpid(child, &status, 0) < 0)
        if (errno != EINTR)
            die("waitpid: %s", strerror(errno));
    if (text && status == 0)
        return text;
    free(text);
    return NULL;
}

/* ---- What the rows print ------------------------------------------------------------------- */

/* See jitter_row.h. */
static bool parse_row(const char *text, struct jitter_run *run)
{
    char *at;

    run->cpu = strtoll(text, &at, 10);
    run->wall = strtoll(at, &at, 10);
    run->missed = strtoull(at, &at, 10);
    size_t n = strtoull(at, &at, 10);
    if (n == 0 || n > strlen(at))
        return false;
    run->ns = allocate(n, sizeof *run->ns);
    for (run->n = 0; run->n < n; run->n++) {
        char *end;
        run->ns[run->n] = strtoll(at, &end, 10);
        if (end == at)
            return false;
        at = end;
    }
    return true;
}

/* cyclictest's JSON: "histogram": { "ns": count, ... }, "cycles": n, "min": n, "max": n, ... */
static bool parse_cyclic(const char *text, struct jitter_run *run)
{
    const char *bins = strstr(text, "\"histogram\""), *cycles = strstr(text, "\"cycles\":");
    const char *max = strstr(text, "\"max\":");

    if (!bins || !cycles || !max)
        return false;
    size_t n = strtoull(cycles + strlen("\"cycles\":"), NULL, 10);
    apc_ns most = strtoll(max + strlen("\"max\":"), NULL, 10);
    if (n == 0 || n > 10000000)
        return false;
    run->ns = allocate(n, sizeof *run->ns);
    bins = strchr(bins, '{');
    for (const char *bin = bins; bin && (bin = strchr(bin, '"')) && bin < cycles;) {
        int64_t ns;
        size_t count;
        int length;
        if (sscanf(bin, "\"%" SCNd64 "\": %zu%n", &ns, &count, &length) != 2)
            break;
        for (; count > 0 && run->n < n; count--)
            run->ns[run->n++] = ns;
        bin += length;
    }
    while (run->n < n)
        run->ns[run->n++] = most;
    return true;
}

/* ---- Rows ---------------------------------------------------------------------------------- */

static bool is_cyclic(enum jitter_way way)
{
    return way == WAY_CYCLIC || way == WAY_CYCLIC_AGAIN || way == WAY_CYCLIC_NO_HOLD;
}

/* A command line, and room for what is composed in it. */
struct command {
    char *argv[ARGUMENTS_MAX + 1];
    size_t n;
    char text[2048 + 4096], *free;
};

static void put(struct command *c, const char *fmt, ...) APC_PRINTF(2, 3);
static void put(struct command *c, const char *fmt, ...)
{
    size_t room = (size_t)(c->text + sizeof c->text - c->free);
    va_list args;

    va_start(args, fmt);
    int length = vsnprintf(c->free, room, fmt, args);
    va_end(args);
    if (length < 0 || (size_t)length >= room || c->n == ARGUMENTS_MAX)
        die("a command line is too long");
    c->argv[c->n++] = c->free;
    c->argv[c->n] = NULL;
    c->free += length + 1;
}

/* False: the tool for it is missing. */
static bool compose(struct command *c, const struct jitter_tools *tools, enum jitter_way way, apc_ns period,
                    apc_ns duration)
{
    c->n = 0;
    c->free = c->text;
    if (is_cyclic(way)) {
        if (!tools->cyclictest)
            return false;
        put(c, "%s", tools->cyclictest);
        put(c, "-qmN");
        put(c, "-t1");
        put(c, "-p%d", PRIORITY);
        put(c, "-i%lld", (long long)(period / 1000));
        put(c, "-l%lld", (long long)(duration / period));
        put(c, "-h%d", CYCLIC_RANGE);
        put(c, "--histfile=/dev/null");
        put(c, "--json=/dev/stdout");
        if (way == WAY_CYCLIC_NO_HOLD)
            put(c, "--default-system");
        return true;
    }
    if (way == WAY_PYTHON) {
        if (!tools->python)
            return false;
        put(c, "%s", tools->python);
        put(c, "%s/jitter_timer.py", tools->folder);
    } else if (way == WAY_LISTING) {
        put(c, "%s/jitter_paper", tools->folder);
    } else {
        put(c, "%s/jitter_task", tools->folder);
        put(c, "%s", task_rows[way]);
    }
    put(c, "%lld", (long long)period);
    put(c, "%lld", (long long)duration);
    return true;
}

void jitter_run_together(const struct jitter_tools *tools, const enum jitter_way *ways, size_t n,
                         apc_ns period, apc_ns duration, struct jitter_run *runs)
{
    struct command command;
    pid_t child[WAYS];
    int from[WAYS];
    const apc_ns deadline = apc_clock_mono(NULL) + duration + GRACE;

    for (size_t i = 0; i < n; i++) {
        runs[i] = (struct jitter_run){0};
        child[i] = 0;
        if (compose(&command, tools, ways[i], period, duration)) {
            bool quiet = ways[i] == WAY_CYCLIC_NO_HOLD; /* it warns of what it was asked to do */
            child[i] = start_piped(command.argv, &from[i], quiet);
        }
    }
    for (size_t i = 0; i < n; i++) {
        char *text = child[i] ? finish(child[i], from[i], deadline) : NULL;
        if (!text || !(is_cyclic(ways[i]) ? parse_cyclic : parse_row)(text, &runs[i])) {
            free(runs[i].ns);
            runs[i] = (struct jitter_run){0};
        }
        free(text);
    }
}

bool jitter_run(const struct jitter_tools *tools, enum jitter_way way, apc_ns period, apc_ns duration,
                struct jitter_run *run)
{
    jitter_run_together(tools, &way, 1, period, duration, run);
    return run->n > 0;
}

bool jitter_run_cost(const struct jitter_tools *tools, double *tick, double *records)
{
    struct command command = {.free = command.text};
    int from;

    put(&command, "%s/jitter_task", tools->folder);
    put(&command, "cost");
    pid_t child = start_piped(command.argv, &from, false);
    char *text = finish(child, from, apc_clock_mono(NULL) + GRACE);
    bool known = text && sscanf(text, "%lf %lf", tick, records) == 2;
    free(text);
    return known;
}

/* ---- Load ---------------------------------------------------------------------------------- */

pid_t jitter_load_start(const struct jitter_tools *tools, int seconds)
{
    struct command command = {.free = command.text};

    if (!tools->stress)
        return 0;
    put(&command, "%s", tools->stress);
    put(&command, "--quiet");
    put(&command, "--cpu");
    put(&command, "0"); /* as many as there are cores */
    put(&command, "--hdd");
    put(&command, "1");
    put(&command, "--hdd-bytes");
    put(&command, "64m");
    put(&command, "--hdd-opts");
    put(&command, "wr-seq,fsync");
    put(&command, "--temp-path");
    put(&command, "%s", tools->folder);
    put(&command, "--timeout");
    put(&command, "%d", seconds);
    return start(command.argv, open("/dev/null", O_WRONLY | O_CLOEXEC), false);
}

void jitter_load_stop(pid_t load)
{
    const struct timespec pause = {.tv_nsec = 10000000};

    if (load <= 0)
        return;
    kill(load, SIGTERM); /* it takes its workers and their files with it */
    for (int i = 0; i < 1000; i++) {
        if (waitpid(load, NULL, WNOHANG) != 0)
            return;
        nanosleep(&pause, NULL);
    }
    kill(load, SIGKILL);
    waitpid(load, NULL, 0);
}

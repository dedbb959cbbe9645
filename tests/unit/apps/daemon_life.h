/* SPDX-License-Identifier: BSD-3-Clause */
/*
 * A daemon as a child of a test program: what it is started with, what it says, how it ends, what it records.
 * To be included by one file of a program.
 */
#ifndef APC_TEST_DAEMON_LIFE_H
#define APC_TEST_DAEMON_LIFE_H

#include "check.h"

#include <dirent.h>
#include <poll.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>
#include <sys/wait.h>
#include <unistd.h>

#include "common/exitcode.h"
#include "daemon/daemon.h"
#include "experiment/experiment.h"
#include "scratch.h"

#define PERIOD    (APC_NS_PER_S / 10) /* of its task */
#define LEFT_OPEN 98                  /* it ends with this when its close() left a file open */

/* What a daemon does, and what it left. */
struct life {
    apc_task_fn tick;
    int (*before)(struct daemon *d);     /* it runs; NULL: nothing. Nonzero: it is closed with that */
    const char *const *options;          /* ended by NULL */
    const char *overrun;                 /* of its task; NULL: skip */
    bool without_config, store_optional; /* no --config; see struct program */
    const char *spools;
    bool own;  /* it has an option of its own and chooses its part by it */
    bool bare; /* it is started without any of the standard streams */
};

static struct {
    _Atomic int ticks;
    _Atomic uint64_t first, last; /* their indices */
    _Atomic int held;             /* its claim, by this program */
    _Atomic int failed;           /* an allocation, by its number */
} * shared;

static char store[300], config[300];
static char said[20000];
static size_t n_said;
static int code;
static apc_ns born;              /* the last one */
static struct apc_store *opened; /* by what comes before its run, and closed after it; NULL: none */

static inline int stop_after_three(void *ctx, const struct apc_tick *tick)
{
    (void)ctx;
    if (shared->ticks == 0)
        shared->first = tick->index;
    shared->last = tick->index;
    if (++shared->ticks == 3)
        kill(getpid(), SIGTERM);
    return 0;
}

static inline void write_config(const char *overrun)
{
    snprintf(config, sizeof config, "%s/one.conf", scratch_folder());
    FILE *out = fopen(config, "w");
    assert_non_null(out);
    fprintf(out,
            "name = \"one\"; measurements = ( { name = \"y\"; } ); setpoints = ( { name = \"r\"; } );\n"
            "outputs = ( { name = \"u\"; } ); plant = { model = \"first-order\"; period = 0.1; overrun = "
            "\"%s\"; };\n"
            "client = { period = 0.1; }; controller = { law = \"pi\"; period = 0.1; };\n"
            "scheduler = { period = 5.0; sequence = ( [0.0] ); };\n",
            overrun ? overrun : "skip");
    fclose(out);
}

static inline int tick_for_two_looks(void *ctx, const struct apc_tick *tick)
{
    (void)ctx;
    if (shared->ticks++ == 0)
        shared->first = tick->index;
    if (tick->index > shared->first + 25)
        kill(getpid(), SIGTERM);
    return 0;
}

static char own_part[20]; /* what its own option says */

static inline void take_part(void *to, char *arg, const struct argp_state *state)
{
    (void)state;
    snprintf(to, sizeof own_part, "%s", arg);
}

static inline void choose_own(struct daemon *d)
{
    snprintf(d->name, sizeof d->name, "apc-test %.10s of %.20s", own_part, d->experiment.name);
    d->task_name = own_part;
}

/* Files that this process has open. */
static inline int open_files(void)
{
    DIR *all = opendir("/proc/self/fd");
    int n = 0;
    assert_non_null(all);
    while (readdir(all))
        n++;
    closedir(all);
    return n;
}

static inline void be_a_daemon(const struct life *life)
{
    static const struct option_spec own[] = {{"part", 'p', "NAME", "which", OPTION_OWN, .take = take_part},
                                             {0}};
    const struct program program = {.name = "apc-test",
                                    .doc = "A daemon.",
                                    .task = "test",
                                    .store_optional = life->store_optional,
                                    .spools = life->spools,
                                    .extra = life->own ? own : NULL,
                                    .choose = life->own ? choose_own : NULL};
    const char *argv[20] = {"apc-test"};
    const int before = open_files() + (life->bare ? 3 : 0);
    int argc = 1;
    struct daemon d;
    if (!life->without_config) {
        argv[argc++] = "--config";
        argv[argc++] = config;
    }
    for (const char *const *option = life->options; option && *option; option++)
        argv[argc++] = *option;
    int rc = daemon_open(&d, &program, life->own ? own_part : NULL, argc, (char **)(uintptr_t)argv);
    if (rc == 0 && life->before)
        rc = life->before(&d);
    if (rc == 0)
        rc = daemon_run(&d, d.experiment.plant.rhythm, life->tick, &d);
    apc_store_close(opened);
    rc = daemon_close(&d, rc);
    _exit(open_files() == before ? rc : LEFT_OPEN);
}

/* Begin one; *end gets what it says. */
static inline pid_t start(const struct life *life, int *end)
{
    int ends[2];
    shared->ticks = 0;
    shared->held = 0;
    born = apc_clock_utc(NULL) - APC_NS_PER_MS;
    n_said = 0;
    said[0] = '\0';
    write_config(life->overrun);
    assert_int_equal(pipe(ends), 0);
    fflush(NULL);
    pid_t pid = fork();
    assert_true(pid >= 0);
    if (pid == 0) {
        close(ends[0]);
        dup2(ends[1], STDERR_FILENO);
        dup2(ends[1], STDOUT_FILENO);
        for (int fd = 0; life->bare && fd <= STDERR_FILENO; fd++)
            close(fd);
        be_a_daemon(life);
    }
    close(ends[1]);
    *end = ends[0];
    return pid;
}

/* Until it has said that, or no more for @p ms. */
static inline bool hear_of(int end, const char *part, int ms)
{
    struct pollfd in = {.fd = end, .events = POLLIN};
    while (!strstr(said, part)) {
        ssize_t got = poll(&in, 1, ms) == 1 ? read(end, said + n_said, sizeof said - 1 - n_said) : 0;
        if (got <= 0)
            return false;
        n_said += (size_t)got;
        said[n_said] = '\0';
    }
    return true;
}

static inline void finish(pid_t pid, int end)
{
    size_t n = n_said;
    int status;
    for (ssize_t got; n < sizeof said - 1 && (got = read(end, said + n, sizeof said - 1 - n)) > 0;)
        n += (size_t)got;
    said[n] = '\0';
    assert_int_equal(strlen(said), n);
    close(end);
    assert_int_equal(waitpid(pid, &status, 0), pid);
    code = WIFEXITED(status) ? WEXITSTATUS(status) : 1000 + WTERMSIG(status);
}

static inline void live(const struct life *life)
{
    int end;
    pid_t pid = start(life, &end);
    finish(pid, end);
}

static inline void assert_says(const char *part)
{
    if (!strstr(said, part))
        fail_msg("no \"%s\" in \"%s\"", part, said);
}

static inline void assert_ended(int with)
{
    if (code != with)
        fail_msg("it ended with %d, not %d: %s", code, with, said);
}

static inline void fresh_store(void)
{
    static int number;
    struct apc_store *s;
    snprintf(store, sizeof store, "sqlite:%s/%d.db", scratch_folder(), ++number);
    assert_int_equal(apc_store_open(&s, store, NULL, NULL), 0);
    assert_int_equal(apc_store_init(s), 0);
    apc_store_close(s);
}

/* ---- What is in its store ----------------------------------------------------------------- */

static char events[20000];

static const char *name_now = "apc-test", *task_now = "test";

static inline int take_event(void *ctx, const struct apc_event *e)
{
    size_t n = strlen(events);
    (void)ctx;
    assert_string_equal(e->source, name_now);
    assert_true(e->time >= born && e->time <= apc_clock_utc(NULL) + APC_NS_PER_MS); /* a store may round */
    snprintf(events + n, sizeof events - n, "%d %s %s\n", (int)e->severity, e->kind, e->text);
    return 0;
}

static uint64_t count, missed;
static int rows;

static inline int take_timing(void *ctx, const struct apc_timing_row *row)
{
    (void)ctx;
    assert_string_equal(row->task, task_now);
    assert_int_equal(row->period, APC_NS_PER_S / 10);
    rows++;
    if (!strcmp(row->quantity, "run")) {
        count += row->count;
        missed += row->missed;
    }
    return 0;
}

static inline void read_store(void)
{
    const struct apc_range all = {0};
    struct apc_store *s;
    events[0] = '\0';
    count = missed = 0;
    rows = 0;
    assert_int_equal(apc_store_open(&s, store, NULL, NULL), 0);
    assert_true(apc_store_events(s, &all, take_event, NULL) >= 0);
    assert_true(apc_store_timing(s, &all, take_timing, NULL) >= 0);
    apc_store_close(s);
}

static inline void assert_recorded(const char *event)
{
    if (!strstr(events, event))
        fail_msg("no \"%s\" in \"%s\"", event, events);
}

/* For cmocka_run_group_tests(). */
static inline int make_shared(void **state)
{
    (void)state;
    unsetenv("APC_STORE"); /* of whoever runs the tests */
    shared = mmap(NULL, sizeof *shared, PROT_READ | PROT_WRITE, MAP_SHARED | MAP_ANONYMOUS, -1, 0);
    return shared == MAP_FAILED;
}

#endif

/* SPDX-License-Identifier: BSD-3-Clause */
/*
 * A stopped process, exhausted limits, refused priorities: each in a child of its own, which says by its
 * exit status, a line number, where it found things otherwise than they must be.
 */
#include "apctimer.h"
#include "check.h"
#include "timer_test.h"

#include <dlfcn.h>
#include <fcntl.h>
#include <pthread.h>
#include <sched.h>
#include <signal.h>
#include <stdatomic.h>
#include <string.h>
#include <sys/resource.h>
#include <sys/wait.h>

#define MS       APC_NS_PER_MS
#define PERIOD   (10 * MS)
#define NOT_HERE 255 /* the fault cannot be produced on this machine */
#define NOBODY   65534

/* In the child: what must hold. Lines are reported modulo 200, so that none is taken for NOT_HERE or 0. */
#define MUST(condition)                                                                                      \
    do {                                                                                                     \
        if (!(condition))                                                                                    \
            _exit(1 + __LINE__ % 200);                                                                       \
    } while (0)

static pid_t run_child(void (*child)(const char *executive, int fd), const char *executive, int *from_child)
{
    int ends[2];
    assert_int_equal(pipe2(ends, O_CLOEXEC), 0);
    fflush(stdout);
    pid_t pid = fork();
    assert_true(pid >= 0);
    if (pid == 0) {
        close(ends[0]);
        signal(SIGPIPE, SIG_IGN);
        alarm(60); /* whatever happens, the child ends */
        child(executive, ends[1]);
        _exit(0);
    }
    close(ends[1]);
    *from_child = ends[0];
    return pid;
}

static void child_found_all_well(pid_t pid)
{
    int status;
    assert_int_equal(waitpid(pid, &status, 0), pid);
    assert_true(WIFEXITED(status));
    if (WEXITSTATUS(status) == NOT_HERE) {
        print_message("not possible here: skipped\n");
        skip();
    }
    if (WEXITSTATUS(status) != 0)
        fail_msg("the child gave up at line %d (modulo 200)", WEXITSTATUS(status) - 1);
}

static struct apc_task *make_task(const char *executive, apc_task_fn fn, void *ctx, struct apc_log *log)
{
    const struct apc_executive_options options = {.size = sizeof options, .log = log};
    const struct apc_task_options task_options = {.size = sizeof task_options, .period = PERIOD};
    struct apc_executive *e;
    struct apc_task *task;
    MUST(apc_executive_create(&e, executive, &options, NULL) == 0);
    MUST(apc_task_create(e, &task_options, fn, ctx, &task, NULL) == 0);
    return task;
}

/* ---- A process that is stopped and continued ---- */

static int report_tick(void *ctx, const struct apc_tick *tick)
{
    return write(*(int *)ctx, tick, sizeof *tick) == (ssize_t)sizeof *tick ? 0 : 1;
}

static void ticking_child(const char *executive, int fd)
{
    struct apc_task *task = make_task(executive, report_tick, &fd, NULL);
    MUST(apc_task_start(task, NULL) == 0);
    int result = 0;
    MUST(apc_task_wait(task, PATIENCE, &result) == 0 && result == 1); /* the reader is gone */
    apc_task_destroy(task);
}

static void read_tick(int fd, struct apc_tick *tick)
{
    struct pollfd p = {.fd = fd, .events = POLLIN};
    assert_int_equal(poll(&p, 1, (int)(PATIENCE / MS)), 1);
    assert_int_equal(read(fd, tick, sizeof *tick), sizeof *tick);
}

static void after_a_stop_one_call_stands_for_the_gap(void **state)
{
    struct apc_tick last, tick;
    int fd, status;
    pid_t pid = run_child(ticking_child, *state, &fd);

    for (int i = 0; i < 5; i++)
        read_tick(fd, &last);
    assert_int_equal(kill(pid, SIGSTOP), 0);
    assert_int_equal(waitpid(pid, &status, WUNTRACED), pid);
    assert_true(WIFSTOPPED(status));
    apc_ns from = apc_clock_mono(NULL);
    assert_true(passed(from + 3 * APC_NS_PER_S));
    apc_ns to = apc_clock_mono(NULL);
    assert_int_equal(kill(pid, SIGCONT), 0);

    uint64_t missed = 0;
    unsigned in_gap = 0;
    do {
        read_tick(fd, &tick);
        assert_true(tick.index == last.index + 1 + tick.missed);
        assert_true(tick.started - tick.scheduled < PERIOD);
        if (tick.scheduled > from && tick.scheduled <= to)
            in_gap++;
        if (tick.scheduled > from && last.scheduled <= to)
            missed += tick.missed;
        last = tick;
    } while (tick.scheduled <= to + 3 * PERIOD);
    /* Of the ticks of the gap, the newest may run on waking; the others must be counted. */
    assert_true(in_gap <= 1);
    assert_true(missed + in_gap >= (uint64_t)((to - from) / PERIOD));
    close(fd);
    child_found_all_well(pid);
}

/* ---- Limits ---- */

static int count_call(void *ctx, const struct apc_tick *tick)
{
    (void)tick;
    sem_post(ctx);
    return 0;
}

static void child_without_pending_signals(const char *executive, int fd)
{
    const struct rlimit none = {0, RLIM_INFINITY};
    struct rlimit before, low;
    struct apc_error why = {""};
    sem_t called;
    (void)fd;

    sem_init(&called, 0, 0);
    struct apc_task *task = make_task(executive, count_call, &called, NULL);
    MUST(getrlimit(RLIMIT_SIGPENDING, &before) == 0);
    low = none;
    low.rlim_max = before.rlim_max;
    MUST(setrlimit(RLIMIT_SIGPENDING, &low) == 0);
    MUST(apc_task_start(task, &why) == APC_ESYS);
    MUST(strstr(why.text, "pending signal") && strstr(why.text, "apc-task"));
    MUST(apc_task_stop(task) == 0);

    MUST(setrlimit(RLIMIT_SIGPENDING, &before) == 0); /* nothing was started: it may be tried again */
    MUST(apc_task_start(task, &why) == 0);
    MUST(posted(&called) && posted(&called));
    apc_task_destroy(task);
}

static void no_room_for_a_timer_is_an_error_that_says_so(void **state)
{
    int fd;
    pid_t pid = run_child(child_without_pending_signals, *state, &fd);
    child_found_all_well(pid);
    close(fd);
}

/* Stands before libc's. */
int arming(timer_t timer, int flags, const struct itimerspec *to,
           struct itimerspec *old) __asm__("timer_settime");

static bool refuses_to_arm;

int arming(timer_t timer, int flags, const struct itimerspec *to, struct itimerspec *old)
{
    int (*libc)(timer_t, int, const struct itimerspec *, struct itimerspec *) = NULL;
    void *found = dlsym(RTLD_NEXT, "timer_settime");
    memcpy(&libc, &found, sizeof libc);
    if (!refuses_to_arm)
        return libc(timer, flags, to, old);
    errno = EINVAL;
    return -1;
}

/* Timers of this process, as the kernel lists them; -1: it does not. */
static int timers(void)
{
    char line[256];
    int n = 0;
    FILE *list = fopen("/proc/self/timers", "r");
    if (!list)
        return -1;
    while (fgets(line, sizeof line, list))
        n += !strncmp(line, "ID:", 3);
    fclose(list);
    return n;
}

static void child_whose_timers_come_and_go(const char *executive, int fd)
{
    struct apc_error why = {""};
    sem_t called;
    (void)fd;

    sem_init(&called, 0, 0);
    if (timers() < 0)
        _exit(NOT_HERE);
    struct apc_task *task = make_task(executive, count_call, &called, NULL);
    for (int i = 0; i < 3; i++) {
        refuses_to_arm = true;
        MUST(apc_task_start(task, &why) == APC_ESYS);
        MUST(strstr(why.text, "apc-task") && strstr(why.text, "not armed"));
        MUST(timers() == 0);
        refuses_to_arm = false; /* nothing was started: it may be tried again */
        MUST(apc_task_start(task, &why) == 0);
        MUST(posted(&called) && posted(&called));
        MUST(timers() == 1);
        MUST(apc_task_stop(task) == 0);
        MUST(timers() == 0);
        apc_task_destroy(task);
        task = make_task(executive, count_call, &called, NULL);
    }
    apc_task_destroy(task);
}

static void no_timer_is_left_behind(void **state)
{
    int fd;
    pid_t pid = run_child(child_whose_timers_come_and_go, *state, &fd);
    child_found_all_well(pid);
    close(fd);
}

static void *nothing(void *arg)
{
    return arg;
}

static void allow_threads(bool allowed)
{
    struct rlimit limit;
    MUST(getrlimit(RLIMIT_NPROC, &limit) == 0);
    limit.rlim_cur = allowed ? limit.rlim_max : 1;
    MUST(setrlimit(RLIMIT_NPROC, &limit) == 0);
}

static void child_that_may_have_no_thread(const char *executive, int fd)
{
    struct apc_error why = {""};
    pthread_t thread;
    sem_t called;
    (void)fd;

    MUST(getuid() != 0 || setuid(NOBODY) == 0); /* root has no such limit */
    sem_init(&called, 0, 0);
    struct apc_task *task = make_task(executive, count_call, &called, NULL);
    allow_threads(false);
    if (pthread_create(&thread, NULL, nothing, NULL) == 0)
        _exit(NOT_HERE);
    MUST(apc_task_start(task, &why) == APC_ESYS);
    MUST(strstr(why.text, "no thread") && strstr(why.text, "apc-task"));
    MUST(apc_task_overruns(task, NULL) == 0);
    MUST(apc_task_wait(task, 0, NULL) == APC_ESTATE);

    allow_threads(true); /* nothing was started: it may be tried again */
    MUST(apc_task_start(task, &why) == 0);
    MUST(posted(&called) && posted(&called));
    apc_task_destroy(task);
}

static void more_tasks_than_threads_are_allowed_is_an_error_that_says_so(void **state)
{
    int fd;
    pid_t pid = run_child(child_that_may_have_no_thread, *state, &fd);
    child_found_all_well(pid);
    close(fd);
}

struct starved {
    sem_t called;
    atomic_ullong missed; /* the most that one call told */
};

static int note_missed(void *ctx, const struct apc_tick *tick)
{
    struct starved *s = ctx;
    if (tick->missed > atomic_load(&s->missed))
        atomic_store(&s->missed, tick->missed);
    sem_post(&s->called);
    return 0;
}

static void child_without_threads(const char *executive, int fd)
{
    struct starved s = {.missed = 0};
    pthread_t thread;
    (void)fd;

    MUST(getuid() != 0 || setuid(NOBODY) == 0); /* root has no such limit */
    sem_init(&s.called, 0, 0);
    struct apc_task *task = make_task(executive, note_missed, &s, NULL);
    MUST(apc_task_start(task, NULL) == 0);
    MUST(posted(&s.called) && posted(&s.called));

    allow_threads(false);
    if (pthread_create(&thread, NULL, nothing, NULL) == 0)
        _exit(NOT_HERE);
    uint64_t missed = apc_task_missed(task);
    apc_ns from = apc_clock_mono(NULL);
    MUST(passed(from + 20 * PERIOD));
    MUST(apc_task_overruns(task, NULL) >= APC_OVERRUN_ALARM); /* seen although no call knows of it */
    MUST(apc_task_missed(task) + 2 >= missed + 20);
    apc_ns to = apc_clock_mono(NULL);
    while (sem_trywait(&s.called) == 0) /* calls that were on their way */
        continue;
    atomic_store(&s.missed, 0);
    allow_threads(true);
    /* One call may have begun before `from`, one tick is the one that runs; calls on their way may come
     * first. */
    const uint64_t gone = (uint64_t)((to - from) / PERIOD) - 2;
    for (int i = 0; i < 3 && atomic_load(&s.missed) < gone; i++)
        MUST(posted(&s.called));
    MUST(atomic_load(&s.missed) >= gone);
    MUST(apc_task_missed(task) + 1 >= missed + atomic_load(&s.missed));

    allow_threads(false); /* for good: what never ran is counted at the stop */
    missed = apc_task_missed(task);
    from = apc_clock_mono(NULL);
    MUST(passed(from + 20 * PERIOD));
    MUST(apc_task_stop(task) == 0);
    MUST(apc_task_missed(task) + 2 >= missed + 20);
    apc_task_destroy(task);
}

static void a_tick_whose_thread_could_not_be_created_is_counted(void **state)
{
    int fd;
    pid_t pid = run_child(child_without_threads, *state, &fd);
    child_found_all_well(pid);
    close(fd);
}

static void child_without_priority(const char *executive, int fd)
{
    const struct rlimit none = {0, 0};
    struct apc_log *log;
    sem_t called;

    MUST(setrlimit(RLIMIT_RTPRIO, &none) == 0);
    MUST(getuid() != 0 || setuid(NOBODY) == 0);
    MUST(apc_log_create(&log, fd, "test", APC_LOG_DEBUG) == 0);
    sem_init(&called, 0, 0);
    const struct apc_executive_options options = {.size = sizeof options, .log = log};
    const struct apc_task_options task_options = {.size = sizeof task_options, .period = PERIOD};
    struct apc_executive *e;
    struct apc_task *task[3];
    MUST(apc_executive_create(&e, executive, &options, NULL) == 0);
    for (int i = 0; i < 3; i++) {
        MUST(apc_task_create(e, &task_options, count_call, &called, &task[i], NULL) == 0);
        MUST(apc_task_start(task[i], NULL) == 0);
    }
    MUST(posted(&called) && posted(&called) && posted(&called));
    for (int i = 0; i < 3; i++)
        apc_task_destroy(task[i]);
    MUST(apc_executive_destroy(e) == 0);
    apc_log_destroy(log);
}

/* All that the child logs. */
static void read_log(int fd, char *text, size_t size)
{
    size_t length = 0;
    ssize_t n;
    while ((n = read(fd, text + length, size - 1 - length)) > 0)
        length += (size_t)n;
    text[length] = '\0';
    close(fd);
}

static void a_refused_priority_is_one_log_line_and_no_failure(void **state)
{
    char text[4096];
    int fd;
    pid_t pid = run_child(child_without_priority, *state, &fd);

    read_log(fd, text, sizeof text);
    child_found_all_well(pid);
    const char *line = strstr(text, "SCHED_OTHER");
    assert_non_null(line);
    assert_null(strstr(line + 1, "SCHED_OTHER"));
}

/* ---- Memory and power ---- */

/* Kilobytes of the process that are locked. */
static long locked(void)
{
    char line[128];
    long kb = -1;
    FILE *status = fopen("/proc/self/status", "r");
    MUST(status);
    while (fgets(line, sizeof line, status))
        if (!strncmp(line, "VmLck:", 6))
            kb = strtol(line + 6, NULL, 10);
    fclose(status);
    return kb;
}

static void work_with_everything_asked_for(const char *executive, int fd)
{
    struct apc_log *log;
    struct apc_executive *e;
    struct apc_task *task;
    sem_t called;
    MUST(apc_log_create(&log, fd, "test", APC_LOG_DEBUG) == 0);
    const struct apc_executive_options options = {
        .size = sizeof options, .log = log, .hold_latency = true, .lock_memory = true};
    const struct apc_task_options task_options = {.size = sizeof task_options, .period = PERIOD};
    sem_init(&called, 0, 0);
    MUST(apc_executive_create(&e, executive, &options, NULL) == 0);
    long kb = locked();
    MUST(apc_task_create(e, &task_options, count_call, &called, &task, NULL) == 0);
    MUST(apc_task_start(task, NULL) == 0);
    MUST(posted(&called) && posted(&called));
    void *more = malloc(64 << 20); /* what MCL_FUTURE under a limit would refuse */
    MUST(more);
    free(more);
    apc_task_destroy(task);
    MUST(apc_executive_destroy(e) == 0);
    apc_log_write(log, APC_LOG_INFO, "%s", kb > 0 ? "some is locked" : "none is locked");
    apc_log_destroy(log);
}

static void child_without_privileges(const char *executive, int fd)
{
    const rlim_t enough = 128 << 20; /* for now: mlockall() would succeed, and a later malloc() fail */
    struct rlimit limit;
    MUST(getrlimit(RLIMIT_MEMLOCK, &limit) == 0);
    limit.rlim_cur = limit.rlim_max < enough ? limit.rlim_max : enough;
    MUST(setrlimit(RLIMIT_MEMLOCK, &limit) == 0);
    MUST(getuid() != 0 || setuid(NOBODY) == 0);
    work_with_everything_asked_for(executive, fd);
}

/*
 * Promise(run/sched-fifo-locked-memory): SCHED_FIFO, locked memory and latency hold where they are
 *   permitted; one line of the log where not.
 */
static void refused_privileges_are_one_log_line_each_and_no_failure(void **state)
{
    char text[4096];
    int fd;
    pid_t pid = run_child(child_without_privileges, *state, &fd);

    read_log(fd, text, sizeof text);
    child_found_all_well(pid);
    assert_non_null(strstr(text, "/dev/cpu_dma_latency cannot be held"));
    assert_non_null(strstr(text, "memory is not locked: RLIMIT_MEMLOCK"));
    assert_non_null(strstr(text, "none is locked"));
}

/* Promise(run/sched-fifo-locked-memory) */
static void memory_is_locked_and_latency_held_where_that_is_allowed(void **state)
{
    char text[4096];
    int fd;
    pid_t pid = run_child(work_with_everything_asked_for, *state, &fd);

    read_log(fd, text, sizeof text);
    child_found_all_well(pid);
    if (!strstr(text, "memory is not locked") && REAL_MEMORY)
        assert_non_null(strstr(text, "some is locked"));
    if (access("/dev/cpu_dma_latency", W_OK) == 0)
        assert_non_null(strstr(text, "/dev/cpu_dma_latency is held at 0"));
}

/* ---- Clocks that are apart from those of the machine ---- */

struct shifted {
    atomic_bool off_grid;
    sem_t called;
};

#define WALL (200 * MS) /* period on the wall clock */

static int check_wall(void *ctx, const struct apc_tick *tick)
{
    struct shifted *s = ctx;
    apc_ns since = tick->utc - apc_grid_time(0, WALL, tick->index);
    if (since < -5 * MS || since > WALL + 5 * MS || tick->missed > 1000)
        atomic_store(&s->off_grid, true);
    sem_post(&s->called);
    return 0;
}

static void tick_on_the_wall_clock(const char *executive)
{
    const struct apc_task_options options = {.size = sizeof options, .period = WALL, .aligned = true};
    struct apc_executive *e;
    struct apc_task *task;
    struct shifted s = {.off_grid = false};
    sem_init(&s.called, 0, 0);
    MUST(apc_executive_create(&e, executive, NULL, NULL) == 0);
    MUST(apc_task_create(e, &options, check_wall, &s, &task, NULL) == 0);
    MUST(apc_task_start(task, NULL) == 0);
    for (int i = 0; i < 3; i++)
        MUST(posted(&s.called));
    apc_task_destroy(task);
    MUST(!atomic_load(&s.off_grid));
    MUST(apc_executive_destroy(e) == 0);
}

/*
 * The machine's wall clock is not ours to step. A time namespace has its own monotonic clock: in it UTC and
 * the monotonic time are an hour further apart than outside, which is what a step leaves behind.
 */
static void shifted_child(const char *executive, long hours)
{
    apc_ns mono = apc_clock_mono(NULL);
    int status, offsets = -1;
    if (unshare(CLONE_NEWTIME) != 0 ||
        (offsets = open("/proc/self/timens_offsets", O_WRONLY | O_CLOEXEC)) < 0 ||
        dprintf(offsets, "monotonic %ld 0\n", hours * 3600) < 0)
        _exit(NOT_HERE); /* not permitted, or the machine runs for less than an hour */
    close(offsets);
    pid_t pid = fork(); /* children live in the new namespace */
    MUST(pid >= 0);
    if (pid == 0) {
        apc_ns shift = apc_clock_mono(NULL) - mono - hours * 3600 * APC_NS_PER_S;
        MUST(shift > -60 * APC_NS_PER_S && shift < 60 * APC_NS_PER_S);
        tick_on_the_wall_clock(executive);
        _exit(0);
    }
    MUST(waitpid(pid, &status, 0) == pid);
    _exit(WIFEXITED(status) ? WEXITSTATUS(status) : 254);
}

static void child_an_hour_ahead(const char *executive, int fd)
{
    (void)fd;
    shifted_child(executive, 1);
}

static void child_an_hour_behind(const char *executive, int fd)
{
    (void)fd;
    shifted_child(executive, -1);
}

static void the_grid_holds_in_a_time_namespace_an_hour_ahead(void **state)
{
    int fd;
    pid_t pid = run_child(child_an_hour_ahead, *state, &fd);
    child_found_all_well(pid);
    close(fd);
}

static void the_grid_holds_in_a_time_namespace_an_hour_behind(void **state)
{
    int fd;
    pid_t pid = run_child(child_an_hour_behind, *state, &fd);
    child_found_all_well(pid);
    close(fd);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        EACH(after_a_stop_one_call_stands_for_the_gap),
        POSIX(no_room_for_a_timer_is_an_error_that_says_so),
        POSIX(no_timer_is_left_behind),
        POSIX(a_tick_whose_thread_could_not_be_created_is_counted),
        EACH(more_tasks_than_threads_are_allowed_is_an_error_that_says_so),
        EACH(a_refused_priority_is_one_log_line_and_no_failure),
        EACH(refused_privileges_are_one_log_line_each_and_no_failure),
        EACH(memory_is_locked_and_latency_held_where_that_is_allowed),
        EACH(the_grid_holds_in_a_time_namespace_an_hour_ahead),
        EACH(the_grid_holds_in_a_time_namespace_an_hour_behind),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}

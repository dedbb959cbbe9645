/* SPDX-License-Identifier: BSD-3-Clause */
#include "daemon.h"

#include <inttypes.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#include "base/text.h"
#include "common/exitcode.h"
#include "common/storeuri.h"
#include "common/streams.h"
#include "experiment/experiment.h"
#include "locked_memory.h"
#include "process_watchdog.h"
#include "recorder.h"
#include "self_monitor.h"

#define HOUSEKEEPING    APC_NS_PER_S                            /* between two looks of the main thread */
#define RETURN          APC_NS_PER_S                            /* for a tick to return when all is to end */
#define WINDOW          ((int)(RECORDER_WINDOW / HOUSEKEEPING)) /* looks between two timing rows */
#define SPOOL_IN_MEMORY ((uint64_t)16 << 20)
#define STACK           ((size_t)512 * 1024) /* of a thread, as those of tasks have it */
#define TAKEOVER                                                                                             \
    (12 *                                                                                                    \
     APC_NS_PER_S) /* how long to wait for a dead predecessor's claim: the server may need 8 s to notice */

/* ---- Options ------------------------------------------------------------------------------ */

#define AT(member) .to = offsetof(struct daemon_options, member)
static const struct option_spec common_options[] = {
    {"config", 'c', "FILE", "Experiment file [APC_CONFIG]", OPTION_TEXT, AT(config)},
    {"store", 's', "URI", STORE_HELP "; default postgresql:", OPTION_TEXT, AT(store)},
    {"spool", 0, "DIR",
     "Folder for the rows that wait while the store is offline [APC_SPOOL]; default: in memory", OPTION_TEXT,
     AT(spool)},
    {"timer", 't', "NAME", "Executive: deadline (default) or posix", OPTION_TEXT, AT(timer)},
    {"spin", 0, NULL, "Spin for the last microseconds before a tick (deadline only)", OPTION_FLAG, AT(spin)},
    {"hold-latency", 0, NULL, "Hold /dev/cpu_dma_latency at 0: idle CPUs stay awake", OPTION_FLAG,
     AT(hold_latency)},
    {"start", 0, "TIME",
     "Time of t = 0, RFC 3339; -: print an empty line and read it from standard input; default: the wall "
     "clock's grid",
     OPTION_TEXT, AT(start)},
    {"after", 0, "INDEX",
     "Index of the last tick of a predecessor, or -1 for none; ticks since then count as missed", OPTION_TEXT,
     AT(after)},
    {"log-level", 0, "LEVEL", "error, warn, info (default) or debug [APC_LOG_LEVEL]", OPTION_TEXT,
     AT(log_level)},
    {0},
};

static void parse_options(struct daemon *d, int argc, char **argv)
{
    struct option_input in[2] = {{.option = common_options, .own = &d->options},
                                 {.option = d->program->extra, .own = d->options.own}};
    option_program(in, d->program->doc, argc, argv);
}

static const char *daemon_or_environment(const char *flag, const char *name)
{
    return flag ? flag : getenv(name);
}

int daemon_error(const struct daemon *d, int err, const char *fmt, ...)
{
    char text[1024];
    va_list args;
    va_start(args, fmt);
    vsnprintf(text, sizeof text, fmt, args);
    va_end(args);
    text_clean(text, text, sizeof text);
    fprintf(stderr, "%s: %s\n", d->name, text); /* at once: the log is written by another thread */
    return err;
}

/* ---- Opening and closing ------------------------------------------------------------------ */

static enum apc_log_level read_level(const struct daemon *d)
{
    const char *name = daemon_or_environment(d->options.log_level, "APC_LOG_LEVEL");
    enum apc_log_level level = name ? apc_log_level_parse(name) : APC_LOG_INFO;
    if (!level) {
        daemon_error(d, 0, "--log-level \"%s\": must be error, warn, info or debug", name);
        exit(EXIT_USAGE);
    }
    return level;
}

static int open_log(struct daemon *d, enum apc_log_level level)
{
    int rc = apc_log_create(&d->log, STDERR_FILENO, d->name, level);
    return rc < 0 ? daemon_error(d, rc, "log: %s", apc_err_text(rc)) : 0;
}

static int parse_start(struct daemon *d, const char *text)
{
    return apc_time_parse(text, &d->start) == 0
               ? 0
               : daemon_error(d, APC_EINVAL, "--start \"%s\": must be a time such as 2026-01-31T12:00:00Z",
                              text);
}

/* From who has started this program, and waits until it is ready. */
static int ask_for_start(struct daemon *d)
{
    char text[APC_TIME_LEN] = "";
    if (!d->asks)
        return 0;
    d->asks = false;
    /* Who would not wait for the question has answered and is gone; a pipe or a file has the answer, too. */
    const ssize_t asked = write(STDIN_FILENO, "\n", 1);
    (void)asked;
    if (!fgets(text, sizeof text, stdin))
        return daemon_error(d, APC_EINVAL,
                            "--start -: no time came on standard input: expected one such as "
                            "2026-01-31T12:00:00Z");
    text[strcspn(text, "\n")] = '\0';
    return parse_start(d, text);
}

static int load_daemon(struct daemon *d)
{
    struct apc_error why;
    const char *file = daemon_or_environment(d->options.config, "APC_CONFIG");
    if (!file) {
        daemon_error(d, 0, "no experiment file: give --config FILE or set APC_CONFIG");
        exit(EXIT_USAGE);
    }
    int rc = experiment_load(&d->experiment, file, d->program->parts, &d->options.overrides, &why);
    if (rc < 0)
        return daemon_error(d, rc, "%s", why.text);
    d->asks = d->options.start && !strcmp(d->options.start, "-");
    if (d->options.start && !d->asks && parse_start(d, d->options.start) < 0)
        exit(EXIT_USAGE);
    double after = -1;
    if (d->options.after &&
        (apc_number_parse(d->options.after, &after) < 0 || !(after >= -1 && after < 0x1p53))) {
        daemon_error(d, 0, "--after \"%s\": must be the index of a tick, or -1", d->options.after);
        exit(EXIT_USAGE);
    }
    d->last = (int64_t)after;
    return 0;
}

static int open_executive(struct daemon *d)
{
    struct apc_executive_options options = {.size = sizeof options,
                                            .log = d->log,
                                            .hold_latency = d->options.hold_latency,
                                            .lock_memory = !d->program->ordinary};
    struct apc_error why;
    const char *name = d->options.timer ? d->options.timer : "deadline";
    if (!strcmp(name, "virtual"))
        return daemon_error(d, APC_EINVAL,
                            "--timer: a daemon runs in real time: expected 'deadline' or 'posix'");
    int rc = apc_executive_create(&d->executive, name, &options, &why);
    return rc < 0 ? daemon_error(d, rc, "--timer: %s", why.text) : 0;
}

/* @spool: what is added to the program's name for the spool's; NULL: none. */
static int open_store(struct daemon *d, struct apc_store **store, apc_ns timeout, apc_ns pause,
                      const char *spool)
{
    struct apc_store_options options = {
        .size = sizeof options, .name = d->name, .timeout = timeout, .backoff_max = pause};
    struct apc_error why;
    char path[512];
    char room[256];
    const char *named = daemon_or_environment(d->options.store, "APC_STORE");
    const char *uri = named ? store_live(named, room) : "postgresql:";
    const bool shared = !strncmp(uri, "shm:", 4); /* memory is never away for long, and then it is gone */
    if (shared && store_follow(uri))
        return daemon_error(
            d, APC_EPERM,
            "--store %s: `apc run --speed` simulates its plant, whose time is not real: a daemon "
            "runs in real time only",
            uri);
    const char *dir = spool && !shared ? daemon_or_environment(d->options.spool, "APC_SPOOL") : NULL;
    if (spool) { /* an outage that the process outlives is bridged in any case */
        options.spool = "";
        options.spool_size = SPOOL_IN_MEMORY;
    }
    if (dir && *dir) {
        mkdir(dir, 0700); /* one that is there is fine; any other trouble shows at the file */
        const int length = snprintf(path, sizeof path, "%s/%s%s.spool", dir, d->name, spool);
        if (length >= (int)sizeof path)
            return daemon_error(d, APC_EINVAL, "--spool: the path is too long");
        for (char *at = path + strlen(dir); *at; at++)
            *at = *at == ' ' ? '-' : *at; /* "apc-controller base" */
        options.spool = path;
        options.spool_size = 0;
        options.spool_or_memory = true; /* a full disk costs what it would have kept, not the loop */
    }
    int rc = store_open(store, uri, &options, &why);
    return rc < 0 ? daemon_error(d, rc, "--store: %s", why.text) : 0;
}

static void *idle_thread(void *arg)
{
    return arg;
}

/*
 * A stack is locked in memory as a whole, and by default it has 8 MiB. Before the first thread. Thread-local
 * storage of libraries comes out of it: where that leaves too little, the default stays.
 */
static void bound_stacks(void)
{
    pthread_attr_t standard, attr;
    pthread_t thread;

    if (pthread_getattr_default_np(&standard) != 0)
        return;
    if (pthread_attr_init(&attr) == 0) {
        if (pthread_attr_setstacksize(&attr, STACK) == 0 && pthread_setattr_default_np(&attr) == 0) {
            if (pthread_create(&thread, NULL, idle_thread, NULL) == 0)
                (void)pthread_join(thread, NULL);
            else
                (void)pthread_setattr_default_np(&standard);
        }
        pthread_attr_destroy(&attr);
    }
    pthread_attr_destroy(&standard);
}

int daemon_open(struct daemon *d, const struct program *program, void *own, int argc, char **argv)
{
    struct apc_store *records = NULL;
    int rc;

    streams_keep();
    memset(d, 0, sizeof *d);
    d->program = program;
    snprintf(d->name, sizeof d->name, "%s", program->name);
    d->task_name = program->task;
    d->options.own = own;
    parse_options(d, argc, argv);
    bound_stacks();
    signal(SIGPIPE, SIG_IGN);
    signal(SIGXFSZ, SIG_IGN); /* a file that may not grow is a full disk */
    if ((rc = process_watchdog_create(&d->process_watchdog)) < 0)
        return daemon_error(d, rc, "no thread that waits for signals: %s", apc_err_text(rc));
    const enum apc_log_level level = read_level(d);
    if ((rc = load_daemon(d)) < 0)
        return rc;
    if (program->choose)
        program->choose(d); /* it may have a name of its own */
    if ((rc = open_log(d, level)) < 0 || (rc = open_executive(d)) < 0)
        return rc;
    d->has_store = !program->store_optional || daemon_or_environment(d->options.store, "APC_STORE");
    if (d->has_store && (rc = open_store(d, &records, 0, 0, "-events")) < 0)
        return rc;
    rc = recorder_create(&d->recorder, records, d->task_name);
    return rc < 0 ? daemon_error(d, rc, "%s", apc_err_text(rc)) : 0;
}

int daemon_close(struct daemon *d, int rc)
{
    recorder_destroy(d->recorder);
    apc_executive_destroy(d->executive);
    apc_log_destroy(d->log);
    experiment_free(&d->experiment);
    process_watchdog_destroy(d->process_watchdog);
    return exit_code_of(rc);
}

/* Worth another try? A predecessor's claim goes when the server notices its end; a slow server may answer the
 * next time. One that refuses the connection is not there. */
static bool may_change(int rc, bool *slow)
{
    *slow |= rc == APC_ETIMEDOUT;
    return rc == APC_EBUSY || rc == APC_ETIMEDOUT || (rc == APC_ECONN && *slow);
}

apc_ns daemon_timeout(apc_ns period)
{
    const apc_ns least = APC_NS_PER_S / 2, most = 2 * APC_NS_PER_S;
    return period < least ? least : period > most ? most : period;
}

int daemon_store(struct daemon *d, struct apc_store **store, struct apc_sample *variables, size_t n)
{
    apc_ns give_up = apc_clock_mono(NULL) + TAKEOVER;
    bool slow = false;
    if (d->store_pause) /* not often, nor longer than the loop can stand */
        d->store_pause = d->store_pause < 100 * APC_NS_PER_MS ? 100 * APC_NS_PER_MS
                         : d->store_pause > 5 * APC_NS_PER_S  ? 5 * APC_NS_PER_S
                                                              : d->store_pause;
    int rc = open_store(d, store, d->store_timeout, d->store_pause, d->program->spools ? "" : NULL);

    if (rc < 0)
        return rc;
    while ((rc = apc_store_claim_set(*store, variables, n)) < 0 && may_change(rc, &slow) &&
           apc_clock_mono(NULL) < give_up)
        if (process_watchdog_wait(d->process_watchdog, 100 * APC_NS_PER_MS) > 0)
            return 1;
    if (rc < 0)
        return daemon_error(d, rc, "%s", apc_store_error(*store));
    if (apc_store_tables_version(*store) > apc_store_version())
        apc_log_write(
            d->log, APC_LOG_INFO,
            "the store's tables are of version %d, newer than this program's (%d), which works with them",
            apc_store_tables_version(*store), apc_store_version());
    return ask_for_start(d);
}

/* ---- Events ------------------------------------------------------------------------------- */

static void record_daemon_event(struct daemon *d, struct apc_event *event, apc_ns mono)
{
    static const enum apc_log_level levels[] = {[APC_EVENT_INFO] = APC_LOG_INFO,
                                                [APC_EVENT_WARNING] = APC_LOG_WARN,
                                                [APC_EVENT_ALARM] = APC_LOG_ERROR};
    event->time = apc_clock_utc(NULL) - (apc_clock_mono(NULL) - mono);
    snprintf(event->source, sizeof event->source, "%.31s", d->name);
    apc_log_write(d->log, levels[event->severity], "%s", event->text);
    recorder_event(d->recorder, event);
}

APC_PRINTF(5, 0)
static void say_as_daemon(struct daemon *d, apc_ns mono, enum apc_event_severity severity, const char *kind,
                          const char *fmt, va_list args)
{
    struct apc_event event = {.severity = severity};
    vsnprintf(event.text, sizeof event.text, fmt, args);
    snprintf(event.kind, sizeof event.kind, "%s", kind);
    record_daemon_event(d, &event, mono);
}

void daemon_event(struct daemon *d, enum apc_event_severity severity, const char *kind, const char *fmt, ...)
{
    va_list args;
    va_start(args, fmt);
    say_as_daemon(d, apc_clock_mono(NULL), severity, kind, fmt, args);
    va_end(args);
}

void daemon_event_at(struct daemon *d, apc_ns mono, enum apc_event_severity severity, const char *kind,
                     const char *fmt, ...)
{
    va_list args;
    va_start(args, fmt);
    say_as_daemon(d, mono, severity, kind, fmt, args);
    va_end(args);
}

void daemon_notice_at(struct daemon *d, const struct apc_notice *notice, apc_ns mono)
{
    struct apc_event event = {0};
    if (notice->kind == APC_NOTICE_NONE)
        return;
    notice_event(notice, &event);
    record_daemon_event(d, &event, mono);
}

void daemon_notice(struct daemon *d, const struct apc_notice *notice)
{
    daemon_notice_at(d, notice, apc_clock_mono(NULL));
}

static void watch_spool(struct daemon *d, struct spool_watch *w, const struct apc_store *store,
                        const char *what)
{
    struct apc_store_stats stats = {.size = sizeof stats};
    apc_store_stats(store, &stats);
    const struct apc_spool_stats *now = &stats.spool;
    bool waiting = now->samples + now->events > 0;
    if (now->damaged > w->damaged)
        daemon_event(d, APC_EVENT_ALARM, "store", "spool of %s damaged or in conflict: kept as %.100s", what,
                     now->aside);
    if (now->instead[0] && !w->instead)
        daemon_event(
            d, APC_EVENT_WARNING, "store",
            "what is kept of %s while the store is offline is in memory, and ends with the process: %.150s",
            what, now->instead);
    if (waiting && !w->waiting)
        daemon_event(d, APC_EVENT_WARNING, "store", "%s go to the spool: %.140s", what,
                     apc_store_error(store));
    if (now->blocked < 0 && w->blocked >= 0)
        daemon_event(d, APC_EVENT_ALARM, "store", "%s stay in the spool: %.140s", what,
                     apc_store_error(store));
    if (waiting) {
        apc_ns age = apc_clock_utc(NULL) - now->oldest;
        w->age = age > w->age || !w->waiting ? age : w->age;
    } else if (w->waiting) {
        daemon_event(d, APC_EVENT_INFO, "store", "spool of %s drained: %llu, up to %.1f s late", what,
                     (unsigned long long)(now->drained - w->drained), apc_ns_to_s(w->age));
        w->drained = now->drained;
    }
    w->waiting = waiting;
    w->damaged = now->damaged;
    w->blocked = now->blocked;
    w->instead = now->instead[0] != '\0';
}

void daemon_spool(struct daemon *d, const struct apc_store *store)
{
    watch_spool(d, &d->task, store, d->program->spools);
}

int daemon_fatal(struct daemon *d, const struct apc_store *store, int rc)
{
    if (rc == APC_ECONFLICT)
        daemon_event(d, APC_EVENT_ALARM, "store", "stopping: another process writes the same variables");
    else if (rc == APC_EBUSY || rc == APC_ESCHEMA)
        daemon_event(d, APC_EVENT_ALARM, "store", "stopping: %s", apc_store_error(store));
    else
        return 0;
    return rc;
}

struct apc_store *daemon_records(const struct daemon *d)
{
    return recorder_store(d->recorder);
}

/* ---- Running ------------------------------------------------------------------------------ */

static void watch_clock(struct daemon *d, struct clock_watch *watch)
{
    apc_ns step = clock_watch_look(watch);
    if (step != 0)
        daemon_event(d, APC_EVENT_WARNING, "clock",
                     "the wall clock stepped by %+.3f s; periods are not affected", apc_ns_to_s(step));
}

static void watch_overruns(struct daemon *d, const struct apc_task *task, struct overrun_watch *watch)
{
    uint64_t alarms, in_a_row = apc_task_overruns(task, &alarms);
    enum overrun_change change = overrun_watch_look(watch, in_a_row, alarms);
    if (change == OVERRUN_BEGAN)
        daemon_event(d, APC_EVENT_ALARM, "overrun", "%d ticks or more missed in a row", APC_OVERRUN_ALARM);
    else if (change == OVERRUN_ENDED)
        daemon_event(d, APC_EVENT_INFO, "overrun", "ticks are on time again");
}

static void watch_records(struct daemon *d, int rc, int *last)
{
    if (rc < 0 && *last >= 0)
        apc_log_write(d->log, APC_LOG_WARN, "records are kept back: %s",
                      apc_store_error(recorder_store(d->recorder)));
    if (rc >= 0 && *last < 0)
        apc_log_write(d->log, APC_LOG_INFO, "records are being stored again");
    *last = rc;
}

/* Until it is time for the next look, or a signal comes, which is returned. The program's own looks come between. */
static int wait_looking(struct daemon *d)
{
    apc_ns left = HOUSEKEEPING;
    int signal = 0;
    while (left > 0 && signal <= 0) {
        const apc_ns next = d->look ? d->look(d->look_ctx) : HOUSEKEEPING, pause = next < left ? next : left;
        signal = process_watchdog_wait(d->process_watchdog, pause);
        left -= pause;
    }
    return signal;
}

/* The main thread's part of a run: until a signal comes or the task ends by itself. */
static int housekeep(struct daemon *d, struct apc_task *task, struct rhythm rhythm)
{
    struct clock_watch clock;
    struct overrun_watch overruns = {0};
    uint64_t missed = 0;
    int recorded = 0, rc = APC_ETIMEDOUT, result = 0;

    clock_watch_init(&clock, NULL);
    for (unsigned looks = 1; rc == APC_ETIMEDOUT; looks++) {
        int signal = wait_looking(d);
        if (signal > 0) {
            daemon_event(d, APC_EVENT_INFO, "stop", "stopping on %s",
                         signal == SIGINT ? "SIGINT" : "SIGTERM");
            return 0;
        }
        watch_clock(d, &clock);
        watch_overruns(d, task, &overruns);
        const uint64_t more = apc_task_missed(task) - missed;
        if (more > 0 && looks % WINDOW == 0) {
            daemon_event(d, APC_EVENT_WARNING, "overrun", "%" PRIu64 " tick%s missed in the last %d s", more,
                         PLURAL(more), WINDOW);
            missed += more;
        }
        /* what was kept back is tried at each look: only then is it stored again */
        const bool whole = looks % WINDOW == 0 || recorded < 0;
        watch_records(
            d, recorder_flush(d->recorder, whole && !atomic_load(&d->idle) ? task : NULL, rhythm.period),
            &recorded);
        watch_spool(d, &d->records, recorder_store(d->recorder), "events");
        rc = apc_task_wait(task, 0, &result);
        if (rhythm.overrun == APC_OVERRUN_STOP && apc_task_missed(task) > 0)
            rc = APC_EOVERRUN; /* also when the tick that takes too long has not returned */
    }
    if (rc == 0)
        rc = result;
    if (rc == APC_EOVERRUN)
        daemon_event(d, APC_EVENT_ALARM, "overrun", "stopping: a tick was missed, and overrun is \"stop\"");
    return rc;
}

static int run_tick(void *ctx, const struct apc_tick *tick)
{
    struct daemon *d = ctx;

    const uint64_t first = (uint64_t)(d->last + 1); /* that the predecessor left */
    if (!d->began && d->options.after && tick->index > first)
        recorder_absent(d->recorder, tick->index - first);
    d->began = true;
    atomic_store(&d->inside, true);
    int rc = d->tick(d->tick_ctx, tick);
    atomic_store(&d->inside, false);
    process_watchdog_ticked(d->process_watchdog, tick->index);
    return rc;
}

/* A tick that does not return can be neither stopped nor waited for: the process ends around it. */
static void leave_hung_tick(struct daemon *d, const struct apc_task *task, apc_ns period, int code)
{
    const struct timespec pause = {0, 10 * APC_NS_PER_MS};
    const apc_ns give_up = apc_clock_mono(NULL) + RETURN;

    while (atomic_load(&d->inside))
        if (apc_clock_mono(NULL) < give_up) {
            nanosleep(&pause, NULL);
        } else {
            daemon_event(d, APC_EVENT_ALARM, "overrun",
                         "the tick does not return (%llu missed so far): ended without it",
                         (unsigned long long)apc_task_missed(task));
            recorder_flush(d->recorder, task, period);
            apc_log_destroy(d->log);
            _exit(code ? code : EXIT_ERROR);
        }
}

static void report_spin(const struct daemon *d, const struct apc_task *task)
{
    struct apc_timing timing = {.size = sizeof timing};
    apc_task_timing(task, &timing);
    if (d->options.spin)
        apc_log_write(d->log, APC_LOG_INFO, "spinning took %.1f %% of a CPU; the margin was %.0f us at last",
                      100 * timing.spin_share, (double)timing.spin_margin / 1e3);
}

static void say_locked(const struct daemon *d)
{
    const struct locked_memory m = locked_memory();
    if (m.own > 0)
        apc_log_write(d->log, APC_LOG_INFO,
                      "locked in memory: %.1f MB of its own, %.1f MB of files, libraries and segments", m.own,
                      m.shared);
}

int daemon_run(struct daemon *d, struct rhythm rhythm, apc_task_fn tick, void *ctx)
{
    int rc = ask_for_start(d);
    if (rc < 0)
        return rc;
    const struct apc_task_options options = {.size = sizeof options,
                                             .name = d->task_name,
                                             .priority = d->program->ordinary ? -1 : 0,
                                             .period = rhythm.period,
                                             .start = d->start + rhythm.phase,
                                             .aligned = true,
                                             .overrun = rhythm.overrun,
                                             .spin = d->options.spin};
    struct apc_task *task = NULL;
    struct apc_error why;

    d->tick = tick;
    d->tick_ctx = ctx;
    rc = apc_task_create(d->executive, &options, run_tick, d, &task, &why);
    if (rc == 0)
        rc = apc_task_start(task, &why);
    if (rc < 0) {
        daemon_error(d, rc, "%s", why.text);
        goto out;
    }
    daemon_event(d, APC_EVENT_INFO, "start", "running every %g s", apc_ns_to_s(rhythm.period));
    say_locked(d);
    process_watchdog_tell(d->process_watchdog, "READY=1");
    process_watchdog_watch(d->process_watchdog, task, rhythm.period);
    rc = housekeep(d, task, rhythm);
    process_watchdog_tell(d->process_watchdog, "STOPPING=1");
    process_watchdog_ending(d->process_watchdog, exit_code_of(rc));
    leave_hung_tick(d, task, rhythm.period, exit_code_of(rc));
    apc_task_stop(task);
    report_spin(d, task);
    recorder_flush(d->recorder, task, rhythm.period);
out:
    apc_task_destroy(task);
    return rc;
}

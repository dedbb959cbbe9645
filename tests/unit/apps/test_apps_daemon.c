/* SPDX-License-Identifier: BSD-3-Clause */
/*
 * The shell that all daemons share, as a program of its own: what it does with its options, what it says when
 * ticks are missed, fail or do not return, and that it ends. Each daemon is a child of this program.
 */
#include "daemon_life.h"

#include <arpa/inet.h>
#include <errno.h>
#include <fcntl.h>
#include <netinet/in.h>
#include <sqlite3.h>
#include <sys/socket.h>
#include <sys/un.h>
#include <time.h>

#include "daemon/credentials.h"
#include "daemon/process_watchdog.h"

static char told[20000]; /* to who started it */

/* ---- Options ------------------------------------------------------------------------------ */

static void bad_options_are_refused_and_say_what_is_expected(void **state)
{
    static const struct {
        const char *options[5];
        int code;
        const char *reason;
    } of[] = {
        {{"too", "much"}, EXIT_USAGE, "unexpected argument \"too\""},
        {{"--nonsense"}, EXIT_USAGE, "unrecognized option '--nonsense'"},
        {{"--log-level", "loud"}, EXIT_USAGE, "--log-level \"loud\": must be error, warn, info or debug"},
        {{"--start", "soon"}, EXIT_USAGE, "--start \"soon\": must be a time such as 2026-01-31T12:00:00Z"},
        {{"--after", "then"}, EXIT_USAGE, "--after \"then\": must be the index of a tick, or -1"},
        {{"--after", "-2"}, EXIT_USAGE, "--after \"-2\": must be the index"},
        {{"--after", "9007199254740992"}, EXIT_USAGE, "must be the index of a tick"},
        {{"--timer", "virtual"}, EXIT_ERROR, "--timer: a daemon runs in real time: expected 'deadline' or "},
        {{"--timer", "sundial"}, EXIT_ERROR, "--timer: "},
        {{"--store", "nonsense"}, EXIT_ERROR, "--store: "},
        {{"--config", "/nowhere/at.all"}, EXIT_ERROR, "/nowhere/at.all: there is no such file or folder"},
        {{"--version"}, EXIT_OK, "apc-test (libapc) "},
    };
    (void)state;
    fresh_store();
    setenv("APC_STORE", store, 1);
    for (size_t i = 0; i < sizeof of / sizeof *of; i++) {
        const struct life life = {.tick = stop_after_three, .options = of[i].options};
        live(&life);
        assert_ended(of[i].code);
        assert_says(of[i].reason);
        assert_int_equal(shared->ticks, 0);
    }
    const struct life life = {.tick = stop_after_three, .without_config = true};
    live(&life);
    assert_ended(EXIT_USAGE);
    assert_says("no experiment file: give --config FILE or set APC_CONFIG");
    setenv("APC_LOG_LEVEL", "loud", 1);
    live(&life);
    assert_says("--log-level \"loud\"");
    unsetenv("APC_LOG_LEVEL");
    unsetenv("APC_STORE");
}

static void an_option_of_its_own_chooses_its_part_and_name(void **state)
{
    char dir[300], file[400];
    static const char *const left[] = {"--part", "left", NULL};
    const char *const spooled[] = {"--part", "left", "--spool", dir, "--store", "sqlite:/nowhere/at.all",
                                   NULL};
    const struct life away = {.tick = tick_for_two_looks, .options = spooled, .own = true};
    const struct life own = {.tick = stop_after_three, .options = left, .own = true};
    (void)state;
    fresh_store();
    setenv("APC_STORE", store, 1);
    live(&own);
    assert_ended(EXIT_OK);
    name_now = "apc-test left of one";
    task_now = "left";
    read_store();
    assert_recorded("1 start running every 0.1 s\n");
    assert_true(rows > 0);
    name_now = "apc-test";
    task_now = "test";
    snprintf(dir, sizeof dir, "%s/its own", scratch_folder());
    snprintf(file, sizeof file, "%s/apc-test-left-of-one-events.spool", dir);
    live(&away);
    assert_ended(EXIT_OK);
    assert_int_equal(access(file, F_OK), 0);
    unsetenv("APC_STORE");
}

static void the_environment_stands_for_what_is_not_said(void **state)
{
    static const char *const quiet[] = {"--log-level", "error", NULL};
    const struct life from_environment = {.tick = stop_after_three, .without_config = true},
                      plain = {.tick = stop_after_three, .options = quiet};
    (void)state;
    fresh_store();
    setenv("APC_STORE", store, 1);
    write_config(NULL);
    setenv("APC_CONFIG", config, 1);
    live(&from_environment);
    assert_ended(EXIT_OK);
    assert_says("running every 0.1 s");
    if (strstr(said, "newer than this program"))
        fail_msg("tables of its own version are told of: %s", said);
    read_store();
    assert_recorded("1 start running every 0.1 s\n");
    setenv("APC_CONFIG", "/nowhere", 1); /* what is said goes before */
    setenv("APC_LOG_LEVEL", "debug", 1);
    live(&plain);
    assert_ended(EXIT_OK);
    if (strstr(said, "running"))
        fail_msg("not quiet: %s", said);
    unsetenv("APC_CONFIG");
    unsetenv("APC_LOG_LEVEL");
    unsetenv("APC_STORE");
}

/* ---- A life ------------------------------------------------------------------------------- */

static int hear(const char *path)
{
    int s = socket(AF_UNIX, SOCK_DGRAM, 0);
    struct sockaddr_un at = {.sun_family = AF_UNIX};
    const size_t length = offsetof(struct sockaddr_un, sun_path) + strlen(path);
    snprintf(at.sun_path, sizeof at.sun_path, "%.100s", path);
    if (*path == '@') /* of no file */
        at.sun_path[0] = '\0';
    else
        unlink(path);
    assert_int_equal(bind(s, (struct sockaddr *)&at, (socklen_t)length), 0);
    setenv("NOTIFY_SOCKET", path, 1);
    return s;
}

static void heard(int s)
{
    size_t n = 0;
    for (ssize_t got; n < sizeof told - 200 && (got = recv(s, told + n, 200, MSG_DONTWAIT)) > 0;) {
        n += (size_t)got;
        told[n++] = '\n';
    }
    told[n] = '\0';
    close(s);
    unsetenv("NOTIFY_SOCKET");
}

static int tick_nine_times(void *ctx, const struct apc_tick *tick)
{
    (void)ctx;
    shared->last = tick->index;
    if (++shared->ticks == 9)
        kill(getpid(), SIGINT);
    return 0;
}

static void a_life_is_told_recorded_and_ends_with_the_signal(void **state)
{
    char path[100];
    const char *const options[] = {"--store", store, "--timer", "deadline", NULL};
    const char *const spin[] = {"--store", store, "--spin", NULL};
    const struct life life = {.tick = tick_nine_times, .options = options};
    (void)state;
    fresh_store();
    snprintf(path, sizeof path, "%.80s/notify", scratch_folder());
    int s = hear(path);
    live(&life);
    heard(s);
    assert_ended(EXIT_OK);
    assert_says("stopping on SIGINT");
    for (const char *line = said; *line; line = strchr(line, '\n') + 1)
        if (strncmp(line, "time=", 5) != 0) /* its log, and no word of an error */
            fail_msg("it says \"%s\"", line);
    read_store();
    assert_recorded("1 start running every 0.1 s\n");
    assert_recorded("1 stop stopping on SIGINT\n");
    assert_true(count >= 9);
    assert_true(rows >= 3);
    assert_int_equal(strncmp(told, "READY=1\n", 8), 0);
    assert_non_null(strstr(told, "WATCHDOG=1\n"));
    assert_non_null(strstr(told, "APC_LAST_TICK="));
    assert_string_equal(told + strlen(told) - strlen("STOPPING=1\n"), "STOPPING=1\n");
    assert_null(strstr(said, "spinning"));
    const struct life again = {.tick = stop_after_three, .options = spin};
    live(&again);
    assert_says("stopping on SIGTERM");
    assert_says("spinning took ");
}

static void who_started_it_may_listen_without_a_file_or_not_at_all(void **state)
{
    char path[100];
    const char *const options[] = {"--store", store, NULL};
    const struct life life = {.tick = stop_after_three, .options = options};
    (void)state;
    fresh_store();
    snprintf(path, sizeof path, "@apc-test-%d", (int)getpid());
    int s = hear(path);
    live(&life);
    heard(s);
    assert_ended(EXIT_OK);
    assert_int_equal(strncmp(told, "READY=1\n", 8), 0);
    /* one that takes no more words holds nothing up */
    snprintf(path, sizeof path, "%.80s/full", scratch_folder());
    s = hear(path);
    struct sockaddr_un at = {.sun_family = AF_UNIX};
    snprintf(at.sun_path, sizeof at.sun_path, "%s", path);
    int sender = socket(AF_UNIX, SOCK_DGRAM, 0);
    while (sendto(sender, "x", 1, MSG_DONTWAIT, (struct sockaddr *)&at, sizeof at) == 1)
        ;
    live(&life);
    heard(s);
    close(sender);
    assert_ended(EXIT_OK);
    assert_null(strstr(told, "READY"));
}

static int without_period(struct daemon *d)
{
    d->experiment.plant.rhythm.period = 0;
    return 0;
}

static void a_task_that_cannot_be_made_ends_it_with_the_reason(void **state)
{
    const struct life life = {.tick = stop_after_three, .before = without_period, .store_optional = true};
    (void)state;
    live(&life);
    assert_ended(EXIT_ERROR);
    assert_says("period");
    assert_int_equal(shared->ticks, 0);
}

/* Longer than a loaded machine makes a daemon late at its end. */
static int stop_after_forty(void *ctx, const struct apc_tick *tick)
{
    (void)ctx;
    if (shared->ticks == 0)
        shared->first = tick->index;
    shared->last = tick->index;
    if (++shared->ticks == 40)
        kill(getpid(), SIGTERM);
    return 0;
}

static void ticks_since_a_predecessor_s_last_one_are_missed(void **state)
{
    static const char *const befores[] = {"-1", "4", NULL};
    (void)state;
    for (int i = 0; i < 3; i++) {
        const char *const options[] = {
            "--store",  store, "--start", "2026-01-01T00:00:00Z", befores[i] ? "--after" : NULL,
            befores[i], NULL};
        const struct life life = {.tick = stop_after_forty, .options = options};
        fresh_store();
        live(&life);
        assert_ended(EXIT_OK);
        read_store();
        /* of the task's own only those which a loaded machine let pass, some of them at its end */
        const uint64_t ran = (uint64_t)shared->ticks, own = shared->last - shared->first + 1 - ran,
                       absent = i == 0   ? shared->first
                                : i == 1 ? shared->first - 5
                                         : 0;
        assert_true(shared->first > 1000000);
        assert_true(missed >= absent + own && missed < absent + own + 30);
    }
}

static int fail_at_once(void *ctx, const struct apc_tick *tick)
{
    (void)tick;
    struct daemon *d = ctx;
    assert_int_equal(daemon_fatal(d, NULL, APC_ECONN), 0);
    daemon_notice(d, &(struct apc_notice){.kind = APC_NOTICE_NONE, .text = "nothing"});
    daemon_notice(d, &(struct apc_notice){.kind = APC_NOTICE_TRIP, .text = "it tripped"});
    return daemon_fatal(d, NULL, APC_ECONFLICT);
}

static void a_tick_that_fails_ends_it_with_its_code(void **state)
{
    const char *const options[] = {"--store", store, NULL};
    const struct life life = {.tick = fail_at_once, .options = options};
    (void)state;
    fresh_store();
    live(&life);
    assert_ended(EXIT_REJECTED);
    read_store();
    assert_recorded("3 store stopping: another process writes the same variables\n");
    assert_recorded("3 watchdog it tripped\n");
    assert_null(strstr(events, "nothing"));
}

/* In a tick, so that others are missed. */
static void sleep_until(apc_ns mono)
{
    const struct timespec t = {mono / APC_NS_PER_S, mono % APC_NS_PER_S};
    while (clock_nanosleep(CLOCK_MONOTONIC, TIMER_ABSTIME, &t, NULL) == EINTR) {
    }
}

static int miss_one(void *ctx, const struct apc_tick *tick)
{
    (void)ctx;
    sleep_until(tick->scheduled + 5 * PERIOD / 2);
    return 0;
}

static void with_overrun_stop_a_missed_tick_ends_it(void **state)
{
    const char *const options[] = {"--store", store, NULL};
    const struct life life = {.tick = miss_one, .options = options, .overrun = "stop"};
    (void)state;
    fresh_store();
    live(&life);
    assert_ended(EXIT_TIMEOUT);
    read_store();
    assert_recorded("3 overrun stopping: a tick was missed, and overrun is \"stop\"\n");
}

/* Hangs for more than ten periods, then is on time for longer than the looks take. */
static int hang_once(void *ctx, const struct apc_tick *tick)
{
    (void)ctx;
    if (shared->ticks++ == 0) {
        shared->first = tick->index;
        sleep_until(tick->scheduled + 15 * PERIOD);
    }
    shared->last = tick->index;
    if (tick->index > shared->first + 125)
        kill(getpid(), SIGTERM);
    return 0;
}

/* Of how many ticks the record tells that they were missed. */
static uint64_t missed_by_the_record(void)
{
    static const char tells[] = " missed in the last 5 s\n";
    uint64_t sum = 0;
    for (const char *at = events; (at = strstr(at, tells)); at++) {
        const char *word = at, *number;
        while (word[-1] != ' ')
            word--;
        for (number = word - 1; number[-1] != ' ';)
            number--;
        const uint64_t n = strtoull(number, NULL, 10);
        assert_int_equal(at - word, n == 1 ? strlen("tick") : strlen("ticks"));
        sum += n;
    }
    return sum;
}

static int hang_for_one(void *ctx, const struct apc_tick *tick)
{
    (void)ctx;
    if (shared->ticks++ == 0) {
        shared->first = tick->index;
        sleep_until(tick->scheduled + 3 * PERIOD / 2);
    }
    if (tick->index > shared->first + 65)
        kill(getpid(), SIGTERM);
    return 0;
}

static void one_missed_tick_is_one_tick(void **state)
{
    const char *const options[] = {"--store", store, NULL};
    const struct life life = {.tick = hang_for_one, .options = options};
    (void)state;
    fresh_store();
    live(&life);
    assert_ended(EXIT_OK);
    read_store();
    assert_true(missed_by_the_record() >= 1);
}

static void many_missed_ticks_are_an_alarm_that_ends(void **state)
{
    const char *const options[] = {"--store", store, NULL};
    const struct life life = {.tick = hang_once, .options = options};
    (void)state;
    fresh_store();
    live(&life);
    assert_ended(EXIT_OK);
    read_store();
    assert_recorded("3 overrun 10 ticks or more missed in a row\n");
    assert_recorded("1 overrun ticks are on time again\n");
    const uint64_t told_of = missed_by_the_record();
    assert_true(told_of >= 14 && told_of <= missed); /* each of them once */
    assert_true(rows >= 6);                          /* after five looks, and at the end */
    assert_true((uint64_t)rows <= 3 * ((shared->last - shared->first) / 50 + 3));
}

static int never_return(void *ctx, const struct apc_tick *tick)
{
    (void)ctx;
    (void)tick;
    kill(getpid(), SIGTERM);
    for (;;)
        pause();
    return 0;
}

static void a_tick_that_does_not_return_is_left_behind(void **state)
{
    const char *const options[] = {"--store", store, NULL};
    const struct life life = {.tick = never_return, .options = options};
    (void)state;
    fresh_store();
    live(&life);
    assert_ended(EXIT_ERROR);
    assert_says("the tick does not return (");
    read_store();
    assert_recorded("3 overrun the tick does not return (");
    assert_recorded("1 stop stopping on SIGTERM\n");
}

static apc_ns hang(void *ctx)
{
    (void)ctx;
    kill(getpid(), SIGTERM);
    for (;;)
        pause();
    return 0;
}

static int look_and_hang(struct daemon *d)
{
    d->look = hang;
    return 0;
}

static int just_tick(void *ctx, const struct apc_tick *tick)
{
    (void)ctx;
    (void)tick;
    return 0;
}

static int hang_for_ever(void *ctx, const struct apc_tick *tick)
{
    (void)ctx;
    (void)tick;
    for (;;)
        pause();
    return 0;
}

static void with_overrun_stop_a_tick_that_does_not_return_ends_it_too(void **state)
{
    const char *const options[] = {"--store", store, NULL};
    const struct life life = {.tick = hang_for_ever, .options = options, .overrun = "stop"};
    (void)state;
    fresh_store();
    live(&life);
    assert_ended(EXIT_TIMEOUT);
    read_store();
    assert_recorded("3 overrun stopping: a tick was missed, and overrun is \"stop\"\n");
    assert_recorded("3 overrun the tick does not return (");
}

static void a_main_thread_that_hangs_is_given_up(void **state)
{
    const char *const options[] = {"--store", store, NULL};
    const struct life life = {.tick = just_tick, .before = look_and_hang, .options = options};
    (void)state;
    fresh_store();
    live(&life);
    assert_ended(EXIT_ERROR);
    assert_says("a thread did not end within 2 s: given up\n");
}

/* ---- Its store ---------------------------------------------------------------------------- */

static int claim(struct daemon *d)
{
    struct apc_sample y = {.table = APC_SENSOR, .id = 1};
    d->store_timeout = daemon_timeout(d->experiment.plant.rhythm.period);
    d->store_pause = 1;
    int rc = daemon_store(d, &opened, &y, 1);
    if (rc == 0 && (y.seq != 5 || d->store_pause != APC_NS_PER_S / 10))
        return APC_ESTATE;
    if (rc == 0) { /* the longest that a loop may ask for */
        struct apc_store *other;
        d->store_pause = APC_NS_PER_S * 60;
        rc = daemon_store(d, &other, &(struct apc_sample){.table = APC_SENSOR, .id = 2}, 1);
        apc_store_close(other);
        return rc == 0 && d->store_pause != 5 * APC_NS_PER_S ? APC_ESTATE : rc;
    }
    return rc;
}

static int claim_what_is_held(struct daemon *d)
{
    while (!shared->held)
        usleep(10000);
    return claim(d);
}

static int claim_with_a_signal(struct daemon *d)
{
    kill(getpid(), SIGTERM);
    return claim_what_is_held(d);
}

/* Only after the fork: a child must not inherit the claim. */
static struct apc_store *hold(void)
{
    struct apc_store *holder;
    int64_t last;
    assert_int_equal(apc_store_open(&holder, store, NULL, NULL), 0);
    assert_int_equal(apc_store_claim(holder, APC_SENSOR, 1, &last), 0);
    shared->held = 1;
    return holder;
}

static void a_claim_is_waited_for_until_it_is_free_or_a_signal_comes(void **state)
{
    const char *const options[] = {"--store", store, NULL};
    const struct life life = {.tick = stop_after_three, .before = claim_what_is_held, .options = options},
                      signalled = {
                          .tick = stop_after_three, .before = claim_with_a_signal, .options = options};
    const struct apc_sample five = {.table = APC_SENSOR, .id = 1, .seq = 5, .time = 1};
    int end;
    (void)state;
    fresh_store();
    pid_t pid = start(&signalled, &end);
    struct apc_store *holder = hold();
    assert_int_equal(apc_store_append(holder, &five, 1), 1);
    finish(pid, end);
    apc_store_close(holder);
    assert_ended(EXIT_OK);
    assert_int_equal(shared->ticks, 0);
    pid = start(&life, &end);
    apc_store_close(hold());
    finish(pid, end);
    assert_ended(EXIT_OK);
    assert_int_equal(shared->ticks, 3);
}

static void without_a_schema_it_says_so_and_ends(void **state)
{
    const char *const options[] = {"--store", store, NULL};
    const struct life life = {.tick = stop_after_three, .before = claim, .options = options};
    (void)state;
    snprintf(store, sizeof store, "sqlite:%s/empty.db", scratch_folder());
    live(&life);
    assert_ended(EXIT_CONNECTION);
    assert_says("apc init");
    assert_int_equal(shared->ticks, 0);
}

static void a_store_that_may_be_missing_is_none(void **state)
{
    const struct life life = {.tick = tick_nine_times, .store_optional = true};
    (void)state;
    live(&life);
    assert_ended(EXIT_OK);
    assert_says("stopping on SIGINT");
}

static void what_a_store_that_is_away_does_not_take_is_told_and_kept(void **state)
{
    char dir[300], file[400], long_dir[600];
    static const char away[] = "postgresql://apc@/none?host=/nowhere/at/all";
    const char *const options[] = {"--store", away, "--spool", dir, NULL};
    const char *const in_memory[] = {"--store", away, NULL};
    const char *const too_long[] = {"--store", away, "--spool", long_dir, NULL};
    const struct life life = {.tick = tick_for_two_looks, .options = options},
                      kept_in_memory = {.tick = tick_for_two_looks, .options = in_memory},
                      refused = {.tick = stop_after_three, .options = too_long};
    (void)state;
    snprintf(dir, sizeof dir, "%s/spool", scratch_folder());
    snprintf(file, sizeof file, "%s/apc-test-events.spool", dir);
    live(&life);
    assert_ended(EXIT_OK);
    assert_says("events go to the spool: ");
    assert_says("records are kept back: ");
    assert_int_equal(access(file, F_OK), 0);
    live(&kept_in_memory);
    assert_ended(EXIT_OK);
    assert_says("events go to the spool: ");
    memset(long_dir, 'a', sizeof long_dir - 1);
    long_dir[sizeof long_dir - 1] = '\0';
    live(&refused);
    assert_ended(EXIT_ERROR);
    assert_says("--spool: the path is too long");
}

/* A file stands where its folder should be: as of any disk that will not have it, the loop starts all the
 * same. */
/* Promise(stores/disk-will-not) */
static void a_disk_that_will_not_have_the_spool_keeps_nobody_from_starting(void **state)
{
    char dir[300];
    static const char away[] = "postgresql://apc@/none?host=/nowhere/at/all";
    const char *const options[] = {"--store", away, "--spool", dir, NULL};
    const struct life life = {.tick = tick_for_two_looks, .options = options};
    (void)state;
    snprintf(dir, sizeof dir, "%s/no-folder", scratch_folder());
    const int fd = open(dir, O_CREAT | O_WRONLY | O_CLOEXEC, 0600);
    assert_true(fd >= 0);
    close(fd);
    live(&life);
    assert_ended(EXIT_OK);
    assert_says(
        "what is kept of events while the store is offline is in memory, and ends with the process: spool ");
    assert_says("Not a directory");
    assert_says("events go to the spool: ");
    unlink(dir);
}

/* Over shared memory, which is never away, there is none. */
/* Promise(stores/disk-will-not) */
static void over_shared_memory_nobody_asks_for_a_spool(void **state)
{
    char live_store[64], segment[128], dir[300];
    const char *const options[] = {"--store", live_store, "--spool", dir, NULL};
    const struct life life = {.tick = stop_after_three, .options = options};
    struct apc_store *s = NULL;
    (void)state;
    snprintf(dir, sizeof dir, "%s/never-made", scratch_folder());
    snprintf(live_store, sizeof live_store, "shm:daemon-%d?size=1", (int)getpid());
    snprintf(segment, sizeof segment, "/dev/shm/apc.daemon-%d", (int)getpid());
    assert_int_equal(apc_store_open(&s, live_store, NULL, NULL), 0);
    assert_int_equal(apc_store_init(s), 0);
    apc_store_close(s);
    live(&life);
    assert_ended(EXIT_OK);
    assert_int_equal(access(dir, F_OK), -1);
    unlink(segment);
}

/* Where the line of the log that has @part goes on after it; it must be there. */
static const char *after(const char *part)
{
    assert_says(part);
    return strstr(said, part) + strlen(part);
}

/* The store gets its tables at the 15th tick, and the daemon is ended when what was kept has drained. */
static int tick_until_drained(void *ctx, const struct apc_tick *tick)
{
    const struct apc_range all = {0};
    struct apc_store *s;
    (void)ctx;
    if (++shared->ticks < 15)
        return 0;
    assert_int_equal(apc_store_open(&s, store, NULL, NULL), 0);
    if (shared->ticks == 15) {
        shared->first = tick->index;
        assert_int_equal(apc_store_init(s), 0);
    }
    events[0] = '\0';
    assert_true(apc_store_events(s, &all, take_event, NULL) >= 0);
    apc_store_close(s);
    if (strstr(events, " drained: "))
        kill(getpid(), SIGTERM);
    return tick->index > shared->first + 600 ? APC_ETIMEDOUT : 0;
}

static void what_was_kept_drains_when_the_store_is_back_and_that_is_told_once(void **state)
{
    const char *const options[] = {"--store", store, NULL};
    const struct life life = {.tick = tick_until_drained, .options = options};
    (void)state;
    snprintf(store, sizeof store, "sqlite:%s/late.db", scratch_folder());
    live(&life);
    assert_ended(EXIT_OK);
    assert_non_null(strstr(after("events go to the spool: "), "apc init")); /* the reason */
    assert_non_null(strstr(after("records are kept back: "), "apc init"));
    assert_says("records are being stored again");
    read_store();
    assert_recorded("1 start running every 0.1 s\n");
    assert_recorded("2 store events go to the spool: ");
    unsigned long long drained = 0;
    double late = 0;
    assert_int_equal(sscanf(after("spool of events drained: "), "%llu, up to %lf s late", &drained, &late),
                     2);

    assert_true(drained >= 1 && drained < 20);
    assert_true(late >= 1 && late < 600);
    assert_null(strstr(after("spool of events drained: "), "drained"));
    assert_null(strstr(after("events go to the spool: "), "events go to the spool"));
    assert_null(strstr(after("records are being stored again"), "records are"));
    assert_null(strstr(said, "damaged"));
    assert_null(strstr(said, "stay in the spool"));
}

static void bend_store(const char *sql)
{
    sqlite3 *db;
    assert_int_equal(sqlite3_open(store + strlen("sqlite:"), &db), SQLITE_OK);
    sqlite3_busy_timeout(db, 60000);
    assert_int_equal(sqlite3_exec(db, sql, NULL, NULL, NULL), SQLITE_OK);
    sqlite3_close(db);
}

/* Timing rows are refused until that has been said, and for some looks more. */
static void records_are_stored_again_when_they_are_not_when_there_are_none(void **state)
{
    const char *const options[] = {"--store", store, NULL};
    const struct life life = {.tick = just_tick, .options = options};
    int end;
    (void)state;
    fresh_store();
    bend_store("CREATE TRIGGER full BEFORE INSERT ON timing BEGIN SELECT RAISE(ABORT, 'no room'); END");
    pid_t pid = start(&life, &end);
    const bool kept = hear_of(end, "records are kept back: ", 60000),
               early = hear_of(end, "records are being stored again", 2500);
    bend_store("DROP TRIGGER full");
    const bool stored = hear_of(end, "records are being stored again", 60000);
    kill(pid, SIGTERM);
    finish(pid, end);
    assert_ended(EXIT_OK);
    assert_true(kept && !early && stored);
    assert_null(strstr(after("records are kept back: "), "kept back")); /* once */
    assert_null(strstr(said, "\"0 ticks missed"));
    read_store();
    assert_true(rows > 0);
}

static int be_refused(void *ctx, const struct apc_tick *tick)
{
    struct apc_store *s;
    struct apc_sample y = {.table = APC_SENSOR, .id = 1};
    (void)tick;
    if (!shared->held)
        return 0;
    assert_int_equal(apc_store_open(&s, store, NULL, NULL), 0);
    int rc = daemon_fatal(ctx, s, apc_store_claim_set(s, &y, 1));
    apc_store_close(s);
    return rc;
}

static int claim_patiently(struct daemon *d)
{
    struct apc_store *s;
    d->store_timeout = APC_NS_PER_S / 2;
    d->store_pause = 3 * APC_NS_PER_S;
    int rc = daemon_store(d, &s, &(struct apc_sample){.table = APC_SENSOR, .id = 1}, 1);
    apc_store_close(s);
    return rc;
}

/* A server that answers nothing may answer the next time; the pause in between is no reason to give up. */
static void a_server_that_is_slow_is_asked_again(void **state)
{
    struct sockaddr_in at = {.sin_family = AF_INET, .sin_addr.s_addr = htonl(INADDR_LOOPBACK)};
    socklen_t length = sizeof at;
    int end, server = socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0);
    (void)state;
    assert_int_equal(bind(server, (struct sockaddr *)&at, sizeof at), 0);
    assert_int_equal(listen(server, 4), 0);
    assert_int_equal(getsockname(server, (struct sockaddr *)&at, &length), 0);
    snprintf(store, sizeof store, "postgresql://apc@127.0.0.1:%d/none", ntohs(at.sin_port));
    const char *const options[] = {"--store", store, NULL};
    const struct life life = {.tick = stop_after_three, .before = claim_patiently, .options = options};
    pid_t pid = start(&life, &end);
    for (int times = 0; times < 4; times++) { /* each of them after the one before was given up */
        struct pollfd in = {.fd = server, .events = POLLIN};
        if (poll(&in, 1, 30000) != 1) {
            finish(pid, end);
            fail_msg("given up with %d: %s", code, said);
        }
        int client = accept(server, NULL, NULL);
        char bytes[100];
        while (recv(client, bytes, sizeof bytes, 0) > 0)
            ;
        close(client);
    }
    kill(pid, SIGTERM);
    finish(pid, end);
    close(server);
    assert_ended(EXIT_OK);
    assert_int_equal(shared->ticks, 0);
}

static void a_store_that_refuses_for_good_ends_it_with_the_reason(void **state)
{
    const char *const options[] = {"--store", store, NULL};
    const struct life life = {.tick = be_refused, .options = options};
    int end;
    (void)state;
    fresh_store();
    pid_t pid = start(&life, &end);
    struct apc_store *holder = hold();
    finish(pid, end);
    apc_store_close(holder);
    assert_ended(EXIT_REJECTED);
    read_store();
    assert_recorded("3 store stopping: sensor 1 ");
}

/* A spool that is there already, as a former life left it, and was bent since. */
static void a_spool_that_is_damaged_is_told_with_where_it_was_kept(void **state)
{
    char dir[300], file[400];
    const char *const options[] = {"--store", store, "--spool", dir, NULL};
    const struct life life = {.tick = tick_for_two_looks, .options = options};
    struct apc_store *s;
    (void)state;
    snprintf(store, sizeof store, "sqlite:%s/bent.db", scratch_folder());
    snprintf(dir, sizeof dir, "%s/bent", scratch_folder());
    snprintf(file, sizeof file, "%s/apc-test-events.spool", dir);
    live(&life);
    assert_ended(EXIT_OK);
    int fd = open(file, O_RDWR | O_CLOEXEC);
    assert_true(fd >= 0);
    const off_t size = lseek(fd, 0, SEEK_END);
    char byte;
    assert_int_equal(pread(fd, &byte, 1, size - 30), 1);
    byte ^= 1;
    assert_int_equal(pwrite(fd, &byte, 1, size - 30), 1);
    close(fd);
    assert_int_equal(apc_store_open(&s, store, NULL, NULL), 0);
    assert_int_equal(apc_store_init(s), 0);
    apc_store_close(s);
    live(&life);
    assert_ended(EXIT_OK);
    const char *told_once = after("spool of events damaged or in conflict: kept as ");
    assert_non_null(strstr(told_once, file));
    assert_null(strstr(told_once, "spool of events damaged"));
}

static void an_operation_takes_a_period_within_bounds(void **state)
{
    (void)state;
    assert_int_equal(daemon_timeout(1), APC_NS_PER_S / 2);
    assert_int_equal(daemon_timeout(APC_NS_PER_S / 2), APC_NS_PER_S / 2);
    assert_int_equal(daemon_timeout(APC_NS_PER_S), APC_NS_PER_S);
    assert_int_equal(daemon_timeout(2 * APC_NS_PER_S), 2 * APC_NS_PER_S);
    assert_int_equal(daemon_timeout(60 * APC_NS_PER_S), 2 * APC_NS_PER_S);
}

/* ---- Notices ------------------------------------------------------------------------------ */

static void each_notice_is_an_event_of_its_kind_and_severity(void **state)
{
    static const struct {
        enum apc_notice_kind notice;
        enum apc_event_severity severity;
        const char *kind;
    } of[] = {{APC_NOTICE_MODE, APC_EVENT_INFO, "mode"},
              {APC_NOTICE_HOLD, APC_EVENT_WARNING, "measurement"},
              {APC_NOTICE_FAULT, APC_EVENT_ALARM, "measurement"},
              {APC_NOTICE_FAILED, APC_EVENT_ALARM, "measurement"},
              {APC_NOTICE_RECOVERED, APC_EVENT_INFO, "measurement"},
              {APC_NOTICE_TRIP, APC_EVENT_ALARM, "watchdog"},
              {APC_NOTICE_RESUMED, APC_EVENT_INFO, "watchdog"},
              {APC_NOTICE_REJECTED, APC_EVENT_WARNING, "rejected"},
              {APC_NOTICE_RIVALS, APC_EVENT_ALARM, "rejected"},
              {APC_NOTICE_POOR, APC_EVENT_INFO, "law"},
              {APC_NOTICE_SAID, APC_EVENT_INFO, "law"},
              {APC_NOTICE_FENCED, APC_EVENT_ALARM, "rejected"},
              {APC_NOTICE_CLOCK, APC_EVENT_WARNING, "clock"}};
    (void)state;
    for (size_t i = 0; i < sizeof of / sizeof *of; i++) {
        const struct apc_notice notice = {.kind = of[i].notice, .text = "it happened"};
        struct apc_event event = {0};
        notice_event(&notice, &event);
        assert_int_equal(event.severity, of[i].severity);
        assert_string_equal(event.kind, of[i].kind);
        assert_string_equal(event.text, "it happened");
    }
}

/* Promise(links/certificate-expires-said) */
static void a_certificate_that_expires_is_said_at_30_7_and_1_days_and_at_its_end(void **state)
{
    const apc_ns day = 24 * 3600 * APC_NS_PER_S;
    (void)state;
    assert_int_equal(credentials_stage(INT64_MAX), 0);
    assert_int_equal(credentials_stage(30 * day + 1), 0);
    assert_int_equal(credentials_stage(30 * day), 1);
    assert_int_equal(credentials_stage(7 * day + 1), 1);
    assert_int_equal(credentials_stage(7 * day), 2);
    assert_int_equal(credentials_stage(day + 1), 2);
    assert_int_equal(credentials_stage(day), 3);
    assert_int_equal(credentials_stage(1), 3);
    assert_int_equal(credentials_stage(0), 4);
    assert_int_equal(credentials_stage(-400 * day), 4);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(a_certificate_that_expires_is_said_at_30_7_and_1_days_and_at_its_end),
        cmocka_unit_test(bad_options_are_refused_and_say_what_is_expected),
        cmocka_unit_test(an_option_of_its_own_chooses_its_part_and_name),
        cmocka_unit_test(the_environment_stands_for_what_is_not_said),
        cmocka_unit_test(a_life_is_told_recorded_and_ends_with_the_signal),
        cmocka_unit_test(who_started_it_may_listen_without_a_file_or_not_at_all),
        cmocka_unit_test(a_task_that_cannot_be_made_ends_it_with_the_reason),
        cmocka_unit_test(ticks_since_a_predecessor_s_last_one_are_missed),
        cmocka_unit_test(a_tick_that_fails_ends_it_with_its_code),
        cmocka_unit_test(with_overrun_stop_a_missed_tick_ends_it),
        cmocka_unit_test(one_missed_tick_is_one_tick),
        cmocka_unit_test(many_missed_ticks_are_an_alarm_that_ends),
        cmocka_unit_test(a_tick_that_does_not_return_is_left_behind),
        cmocka_unit_test(with_overrun_stop_a_tick_that_does_not_return_ends_it_too),
        cmocka_unit_test(a_main_thread_that_hangs_is_given_up),
        cmocka_unit_test(a_claim_is_waited_for_until_it_is_free_or_a_signal_comes),
        cmocka_unit_test(without_a_schema_it_says_so_and_ends),
        cmocka_unit_test(a_store_that_may_be_missing_is_none),
        cmocka_unit_test(what_a_store_that_is_away_does_not_take_is_told_and_kept),
        cmocka_unit_test(a_disk_that_will_not_have_the_spool_keeps_nobody_from_starting),
        cmocka_unit_test(over_shared_memory_nobody_asks_for_a_spool),
        cmocka_unit_test(what_was_kept_drains_when_the_store_is_back_and_that_is_told_once),
        cmocka_unit_test(records_are_stored_again_when_they_are_not_when_there_are_none),
        cmocka_unit_test(a_server_that_is_slow_is_asked_again),
        cmocka_unit_test(a_store_that_refuses_for_good_ends_it_with_the_reason),
        cmocka_unit_test(a_spool_that_is_damaged_is_told_with_where_it_was_kept),
        cmocka_unit_test(an_operation_takes_a_period_within_bounds),
        cmocka_unit_test(each_notice_is_an_event_of_its_kind_and_severity),
    };
    return cmocka_run_group_tests(tests, make_shared, NULL);
}

/* SPDX-License-Identifier: BSD-3-Clause */
/* The bounds of what a daemon is told and given: paths, pauses, phases, memory; and what its log says of it. */
#include "daemon_life.h"

#include <errno.h>
#include <sqlite3.h>
#include <sys/stat.h>

#include "nomem.h"

static int end_at_once(struct daemon *d)
{
    (void)d;
    return 1;
}

/* A machine that has no time for it for 2 s says nothing of a daemon: then it lives once more. */
static void live_well(const struct life *life)
{
    int times = 0;
    do {
        live(life);
    } while (strstr(said, "given up") && ++times < 5);
}

/* ---- What it is started with --------------------------------------------------------------- */

/* Reported of rsyslog and of daemonize: a log line went into whatever file or connection had the number of a
 * stream. */
static int streams_are_nobodys(struct daemon *d)
{
    struct stat is, null;
    (void)d;
    if (stat("/dev/null", &null) != 0)
        return 1;
    for (int fd = STDIN_FILENO; fd <= STDERR_FILENO; fd++)
        if (fstat(fd, &is) != 0 || is.st_rdev != null.st_rdev)
            return 1;
    return 0;
}

static void without_standard_streams_their_numbers_are_given_to_nothing_else(void **state)
{
    const struct life life = {
        .tick = stop_after_three, .before = streams_are_nobodys, .store_optional = true, .bare = true};
    (void)state;
    live_well(&life);
    assert_ended(EXIT_OK);
}

/* ---- Options ------------------------------------------------------------------------------ */

static void help_lists_its_options_in_order(void **state)
{
    static const char *const help[] = {"--help", NULL};
    static const char *const of[] = {
        "--after=INDEX",    "-c, --config=FILE", "--hold-latency", "--log-level=LEVEL",
        "--spin",           "--spool=DIR",       "--start=TIME",   "-s, --store=URI",
        "-t, --timer=NAME", "-?, --help",        "--usage",        "-V, --version"};
    const struct life life = {.tick = stop_after_three, .options = help};
    (void)state;
    live_well(&life);
    assert_ended(EXIT_OK);
    const char *at = said;
    for (size_t i = 0; i < sizeof of / sizeof *of; i++) {
        assert_has(at, of[i]);
        at = strstr(at, of[i]);
    }
    assert_null(strstr(said, "[=")); /* none has a value that may be left out */
}

/* What follows each of them is one of its own: none is taken for another. */
static void each_option_means_itself_only(void **state)
{
    static const char *const of[][2] = {
        {"--spool", "/nowhere/at/all"}, {"--timer", "posix"}, {"--log-level", "debug"}, {"--spin", NULL}};
    (void)state;
    for (size_t i = 0; i < sizeof of / sizeof *of; i++) {
        const char *const options[] = {of[i][0], of[i][1], NULL};
        const struct life life = {.tick = stop_after_three, .options = options, .store_optional = true};
        live_well(&life);
        assert_ended(EXIT_OK);
        assert_int_equal(strstr(said, "spinning took") != NULL, !of[i][1]);
        assert_null(strstr(said, "cpu_dma_latency"));
    }
    static const char *const hold[] = {"--hold-latency", NULL};
    const struct life life = {.tick = stop_after_three, .options = hold, .store_optional = true};
    live_well(&life);
    assert_ended(EXIT_OK);
    assert_says("/dev/cpu_dma_latency "); /* is held, or cannot be: that depends on the machine */
    assert_null(strstr(said, "spinning took"));
}

static void what_spinning_took_is_a_share_of_a_processor(void **state)
{
    static const char *const spin[] = {"--spin", NULL};
    const struct life life = {.tick = stop_after_three, .options = spin, .store_optional = true};
    double share = -1, margin = -1;
    (void)state;
    live_well(&life);
    assert_ended(EXIT_OK);
    assert_says("spinning took ");
    assert_int_equal(sscanf(strstr(said, "spinning took "),
                            "spinning took %lf %% of a CPU; the margin was %lf us", &share, &margin),
                     2);
    assert_true(share > 0 && share <= 100);
    assert_true(margin > 0 && margin < 100000); /* of a period of 100 ms */
}

static void a_spool_s_path_that_is_too_long_is_refused_and_never_cut(void **state)
{
    static const char rest[] = "/apc-test-events.spool";
    char dir[600];
    const char *const options[] = {"--spool", dir, "--store", "sqlite:/nowhere/at.all", NULL};
    const struct life life = {.tick = stop_after_three, .before = end_at_once, .options = options};
    (void)state;
    for (size_t length = 510; length <= 513; length++) {
        const size_t n = length - strlen(rest);
        size_t at = (size_t)snprintf(dir, sizeof dir, "%s", scratch_folder());
        while (at < n) /* the same folder */
            dir[at++] = '/';
        dir[n] = '\0';
        live_well(&life);
        assert_ended(EXIT_ERROR);
        assert_says(length > 511 ? "--spool: the path is too long" : "--store: the spool's path is too long");
    }
}

/* ---- Its task ----------------------------------------------------------------------------- */

static int shift(struct daemon *d)
{
    d->experiment.plant.rhythm.phase = 30 * APC_NS_PER_MS;
    return 0;
}

static int note_phase(void *ctx, const struct apc_tick *tick)
{
    /* the wall clock's grid, as far as it is known on the monotonic one */
    const apc_ns utc = tick->scheduled + apc_clock_offset(NULL, NULL);
    shared->first = (uint64_t)(utc % PERIOD);
    shared->last = tick->index;
    return stop_after_three(ctx, &(struct apc_tick){.index = shared->first});
}

static void ticks_lie_a_phase_behind_the_grid(void **state)
{
    const struct life life = {.tick = note_phase, .before = shift, .store_optional = true};
    (void)state;
    live_well(&life);
    assert_ended(EXIT_OK);
    assert_true(shared->first > 20 * (uint64_t)APC_NS_PER_MS && shared->first < 40 * (uint64_t)APC_NS_PER_MS);
}

/* ---- What it says ------------------------------------------------------------------------- */

static int say_all(struct daemon *d)
{
    daemon_event(d, APC_EVENT_INFO, "one", "number %d", 1);
    daemon_event(d, APC_EVENT_WARNING, "two", "number %d", 2);
    daemon_event(d, APC_EVENT_ALARM, "three", "number %d", 3);
    return 0;
}

static void an_event_is_logged_by_its_severity(void **state)
{
    static const char *const levels[] = {"error", "warn", "info"};
    (void)state;
    for (int i = 0; i < 3; i++) {
        const char *const options[] = {"--log-level", levels[i], NULL};
        const struct life life = {
            .tick = stop_after_three, .before = say_all, .options = options, .store_optional = true};
        live_well(&life);
        assert_ended(EXIT_OK);
        assert_says("number 3");
        assert_int_equal(strstr(said, "number 2") != NULL, i >= 1);
        assert_int_equal(strstr(said, "number 1") != NULL, i >= 2);
    }
}

/* ---- Its store ---------------------------------------------------------------------------- */

static sqlite3 *db; /* another writer */

static void bend(const char *sql)
{
    char *text = NULL;
    if (sqlite3_exec(db, sql, NULL, NULL, &text) != SQLITE_OK)
        fail_msg("%s: %s", sql, text);
}

static void append(struct apc_store *s, apc_ns ago)
{
    const struct apc_event e = {
        .time = apc_clock_utc(NULL) - ago, .severity = APC_EVENT_INFO, .source = "apc-test", .kind = "start"};
    (void)apc_store_append_events(s, &e, 1); /* it goes to the spool */
}

/* Until it has drained, or, as is expected, cannot. */
static void try_to_drain(struct apc_store *s, bool stays)
{
    struct apc_store_stats stats = {.size = sizeof stats};
    do {
        (void)apc_store_connect(s);
        apc_store_stats(s, &stats);
    } while (stays ? stats.spool.blocked == 0 : stats.spool.events > 0);
}

/* Twice, each thing is told of once. */
static void tell(struct daemon *d, const struct apc_store *s)
{
    daemon_spool(d, s);
    daemon_spool(d, s);
}

/* The task's spool is filled, blocked and drained, again and again. */
static int go_through_a_spool(struct daemon *d)
{
    static const int oldest[] = {100, 50};
    const struct apc_store_options options = {.size = sizeof options,
                                              .spool = "",
                                              .backoff_min = 1,
                                              .backoff_max = 1,
                                              .timeout = APC_NS_PER_S / 10};
    struct apc_store *s;
    struct apc_error why;
    if (apc_store_open(&s, store, &options, &why) < 0)
        return daemon_error(d, APC_ESTORE, "%s", why.text);
    assert_int_equal(sqlite3_open(store + strlen("sqlite:"), &db), SQLITE_OK);
    sqlite3_busy_timeout(db, 60000);
    for (int round = 0; round < 2; round++) {
        tell(d, s); /* nothing is in it: nothing is said */
        bend("BEGIN EXCLUSIVE");
        append(s, oldest[round] * APC_NS_PER_S);
        tell(d, s);
        append(s, 10 * APC_NS_PER_S);
        tell(d, s);
        bend("CREATE TRIGGER full BEFORE INSERT ON event BEGIN SELECT RAISE(ABORT, 'no room'); END; COMMIT");
        try_to_drain(s, true);
        tell(d, s);
        bend("DROP TRIGGER full");
        try_to_drain(s, false);
        tell(d, s);
    }
    sqlite3_close(db);
    apc_store_close(s);
    return 1;
}

/* A number of s and a minute more, for a loaded machine. */
static void assert_late(const char *text, double since)
{
    const double late = strtod(text, NULL);
    assert_true(late >= since && late < since + 60);
}

static void the_task_s_spool_is_told_of_by_what_is_in_it(void **state)
{
    static const char *const of[] = {"measurements go to the spool: ", "measurements stay in the spool: ",
                                     "spool of measurements drained: 2, up to "};
    const struct life life = {.tick = stop_after_three,
                              .before = go_through_a_spool,
                              .store_optional = true,
                              .spools = "measurements"};
    (void)state;
    fresh_store();
    live_well(&life);
    assert_ended(EXIT_OK);
    const char *at = said;
    for (int i = 0; i < 6; i++) {
        assert_has(at, of[i % 3]);
        at = strstr(at, of[i % 3]) + strlen(of[i % 3]);
        if (i % 3 == 2)
            assert_late(at, i == 2 ? 100 : 50);
    }
    int lines = 0;
    for (at = said; (at = strstr(at, "measurements ")); at++)
        lines++;
    assert_int_equal(lines, 6);
    assert_null(strstr(said, "damaged"));
}

static int keep_its_pause(struct daemon *d)
{
    static const apc_ns of[][2] = {{0, 0},
                                   {1, APC_NS_PER_S / 10},
                                   {APC_NS_PER_S / 10, APC_NS_PER_S / 10},
                                   {APC_NS_PER_S / 10 + 1, APC_NS_PER_S / 10 + 1},
                                   {5 * APC_NS_PER_S - 1, 5 * APC_NS_PER_S - 1},
                                   {5 * APC_NS_PER_S, 5 * APC_NS_PER_S},
                                   {5 * APC_NS_PER_S + 1, 5 * APC_NS_PER_S}};
    for (size_t i = 0; i < sizeof of / sizeof *of; i++) {
        struct apc_store *s;
        struct apc_sample y = {.table = APC_SENSOR, .id = 1};
        d->store_pause = of[i][0];
        if (daemon_store(d, &s, &y, 1) != 0)
            return APC_ESTORE;
        apc_store_close(s);
        if (d->store_pause != of[i][1])
            return APC_ERANGE;
    }
    return 1;
}

static void the_pause_of_a_store_is_kept_within_bounds(void **state)
{
    const char *const options[] = {"--store", store, NULL};
    const struct life life = {.tick = stop_after_three, .before = keep_its_pause, .options = options};
    (void)state;
    fresh_store();
    live_well(&life);
    assert_ended(EXIT_OK);
    assert_null(strstr(said, "newer than this program")); /* these tables are its own */
}

/* ---- Memory ------------------------------------------------------------------------------- */

/* The allocation that fails; main() of the child has begun then. */
static int n_failing;

static void begin_failing(void *to, char *arg, const struct argp_state *argp)
{
    (void)to, (void)arg, (void)argp;
    until_failure = n_failing;
    counting = true; /* from here on it is the daemon that asks */
}

static void without_memory_it_says_so_and_ends(void **state)
{
    static const struct option_spec extra[] = {
        {"fail", 0, NULL, "from here on", OPTION_OWN, .take = begin_failing}, {0}};
    static const struct program program = {
        .name = "apc-test", .doc = "A daemon.", .task = "test", .extra = extra};
    const char *argv[] = {"apc-test", "--config", config, "--store", "mem:", "--fail", NULL};
    (void)state;
    if (!NOMEM)
        skip();
    write_config(NULL);
    argv[4] = store;
    fresh_store();
    shared->failed = 1;
    for (n_failing = 1; shared->failed; n_failing++) {
        int ends[2], status;
        ssize_t got;
        assert_int_equal(pipe(ends), 0);
        fflush(NULL);
        const pid_t pid = fork();
        assert_true(pid >= 0);
        if (pid == 0) {
            struct daemon d;
            dup2(ends[1], STDERR_FILENO);
            failed = false;
            const int rc = daemon_open(&d, &program, NULL, 6, (char **)(uintptr_t)argv);
            counting = false;
            shared->failed = failed;
            _exit(daemon_close(&d, rc));
        }
        close(ends[1]);
        for (n_said = 0; (got = read(ends[0], said + n_said, sizeof said - 1 - n_said)) > 0;)
            n_said += (size_t)got;
        said[n_said] = '\0';
        close(ends[0]);
        assert_int_equal(waitpid(pid, &status, 0), pid);
        if (!WIFEXITED(status) || WEXITSTATUS(status) != (shared->failed ? EXIT_ERROR : EXIT_OK))
            fail_msg("allocation %d: ended with %x: %s", n_failing, (unsigned)status, said);
        if (shared->failed && !strstr(said, "memory"))
            fail_msg("allocation %d: it says \"%s\"", n_failing, said);
    }
    assert_true(n_failing > 20);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(without_standard_streams_their_numbers_are_given_to_nothing_else),
        cmocka_unit_test(help_lists_its_options_in_order),
        cmocka_unit_test(each_option_means_itself_only),
        cmocka_unit_test(what_spinning_took_is_a_share_of_a_processor),
        cmocka_unit_test(a_spool_s_path_that_is_too_long_is_refused_and_never_cut),
        cmocka_unit_test(ticks_lie_a_phase_behind_the_grid),
        cmocka_unit_test(an_event_is_logged_by_its_severity),
        cmocka_unit_test(the_task_s_spool_is_told_of_by_what_is_in_it),
        cmocka_unit_test(the_pause_of_a_store_is_kept_within_bounds),
        cmocka_unit_test(without_memory_it_says_so_and_ends),
    };
    return cmocka_run_group_tests(tests, make_shared, NULL);
}

/* SPDX-License-Identifier: BSD-3-Clause */
/*
 * bench/historian: does apc-historian keep up, and what does it cost? VARIABLES measurements come every
 * PERIOD ms for as long as is said into shared memory; once a second it is asked how far the history is
 * behind, for which the server reads the newest value of each: that is told by itself. The historian, and a
 * database that bench/historian started, stay on the core that this program was started on; what feeds keeps
 * off it.
 *
 * bench_historian BIN EXPERIMENT HISTORY SECONDS [VARIABLES PERIOD [EVERY [--pack]]]
 */
#include <errno.h>
#include <glob.h>
#include <inttypes.h>
#include <sched.h>
#include <signal.h>
#include <stdbool.h>
#include <stdlib.h>
#include <string.h>
#include <sys/prctl.h>
#include <sys/wait.h>
#include <time.h>
#include <unistd.h>

#include <apcstore.h>
#include <libpq-fe.h>

#include "bench.h"

#define MIB      256
#define PATIENCE 60 /* s: for the last rows */

static char live[64], path[80];
static int variables = 200;
static apc_ns period = 10 * APC_NS_PER_MS;

static void sleep_until(apc_ns when)
{
    const struct timespec t = {when / APC_NS_PER_S, when % APC_NS_PER_S};
    while (clock_nanosleep(CLOCK_MONOTONIC, TIMER_ABSTIME, &t, NULL) == EINTR)
        continue;
}

static struct apc_store *open_store(const char *uri, bool init)
{
    const struct apc_store_options options = {
        .size = sizeof options, .name = "bench", .timeout = 60 * APC_NS_PER_S};
    struct apc_store *store;
    struct apc_error why;
    if (apc_store_open(&store, uri, &options, &why) < 0)
        die("%s", why.text);
    if (init && apc_store_init(store) < 0)
        die("%s", apc_store_error(store));
    return store;
}

static void remove_live(void)
{
    unlink(path);
}

/* All cores but the one that the historian has. */
static void keep_off(void)
{
    cpu_set_t its, others;
    CPU_ZERO(&others);
    sched_getaffinity(0, sizeof its, &its);
    for (size_t i = 0; i < (size_t)sysconf(_SC_NPROCESSORS_CONF); i++)
        if (!CPU_ISSET(i, &its))
            CPU_SET(i, &others);
    if (CPU_COUNT(&others) > 0)
        sched_setaffinity(0, sizeof others, &others);
}

static pid_t feed(apc_ns begin, int64_t rows)
{
    const pid_t pid = fork();
    if (pid != 0)
        return pid;
    prctl(PR_SET_PDEATHSIG, SIGKILL);
    struct apc_sample *sample = allocate((size_t)variables, sizeof *sample);
    keep_off();
    struct apc_store *store = open_store(live, false);
    for (int64_t seq = 1; seq <= rows; seq++) {
        sleep_until(begin + seq * period);
        const apc_ns now = apc_clock_utc(NULL);
        for (int i = 0; i < variables; i++)
            sample[i] = (struct apc_sample){
                .table = APC_SENSOR, .id = i + 1, .seq = seq, .time = now, .value = (double)(seq + i)};
        if (apc_store_append(store, sample, (size_t)variables) != variables)
            die("%s", apc_store_error(store));
    }
    apc_store_close(store);
    _exit(0);
}

static pid_t start_historian(const char *bin, const char *experiment, const char *history, const char *every,
                             const char *pack)
{
    const pid_t pid = fork();
    if (pid == 0) {
        prctl(PR_SET_PDEATHSIG, SIGKILL);
        char program[4096];
        snprintf(program, sizeof program, "%s/apc-historian", bin);
        execl(program, program, "--config", experiment, "--store", live, "--history", history, "--every",
              every, pack, (char *)NULL);
        _exit(127);
    }
    return pid;
}

struct of_process {
    pid_t pid, parent;
    double own, ended; /* CPU time, of children that have ended as well */
};

static struct of_process stat_of(const char *file)
{
    struct of_process p = {0};
    long ticks[4] = {0};
    FILE *f = fopen(file, "r");
    if (f && fscanf(f, "%d %*[^)]) %*c %d %*d %*d %*d %*d %*u %*u %*u %*u %*u %ld %ld %ld %ld", &p.pid,
                    &p.parent, &ticks[0], &ticks[1], &ticks[2], &ticks[3]) != 6)
        p = (struct of_process){0}; /* it has gone meanwhile */
    if (f)
        fclose(f);
    p.own = (double)(ticks[0] + ticks[1]) / (double)sysconf(_SC_CLK_TCK);
    p.ended = (double)(ticks[2] + ticks[3]) / (double)sysconf(_SC_CLK_TCK);
    return p;
}

/* CPU time of all its threads. */
static double cpu_seconds(pid_t pid)
{
    clockid_t clock;
    struct timespec t = {0};
    if (clock_getcpuclockid(pid, &clock) != 0 || clock_gettime(clock, &t) != 0)
        die("the historian has ended: see above");
    return (double)t.tv_sec + (double)t.tv_nsec / 1e9;
}

/* What the database's processes have had since it began, user and system; 0 with a file. */
static double server_seconds(const char *history)
{
    static pid_t postmaster = 0;
    if (strncmp(history, "postgresql:", strlen("postgresql:")) != 0)
        return 0;
    if (postmaster == 0) {
        PGconn *conn = PQconnectdb("");
        char file[64];
        snprintf(file, sizeof file, "/proc/%d/stat", PQbackendPID(conn));
        postmaster = stat_of(file).parent;
        PQfinish(conn);
    }
    glob_t all;
    double sum = 0;
    if (glob("/proc/[0-9]*/stat", 0, NULL, &all) != 0)
        die("no /proc");
    for (size_t i = 0; i < all.gl_pathc; i++) {
        const struct of_process p = stat_of(all.gl_pathv[i]);
        sum += p.pid == postmaster ? p.own + p.ended : p.parent == postmaster ? p.own : 0;
    }
    globfree(&all);
    return sum;
}

/* The same of the session that looks how far behind the history is. */
static double looker_seconds(const char *history)
{
    if (strncmp(history, "postgresql:", strlen("postgresql:")) != 0)
        return 0;
    PGconn *conn = PQconnectdb("");
    PGresult *result = PQexec(conn, "SELECT pid FROM pg_stat_activity WHERE application_name = 'bench' "
                                    "ORDER BY backend_start DESC LIMIT 1");
    if (PQntuples(result) != 1)
        die("nobody looks: %s", PQerrorMessage(conn));
    char file[64];
    snprintf(file, sizeof file, "/proc/%ld/stat", strtol(PQgetvalue(result, 0, 0), NULL, 10));
    PQclear(result);
    PQfinish(conn);
    return stat_of(file).own;
}

static int by_value(const void *a, const void *b)
{
    const double x = *(const double *)a, y = *(const double *)b;
    return (x > y) - (x < y);
}

static int in_order(void *ctx, const struct apc_sample *s)
{
    int64_t *last = ctx;
    if (s->seq != *last + 1)
        die("after seq %" PRId64 " comes %" PRId64, *last, s->seq);
    *last = s->seq;
    return 0;
}

struct seen {
    double *late; /* s, one a second */
    uint64_t most;
    double cpu, server,
        looks; /* s of a core: the historian, the database, the part of it that is asked how far */
};

/* Once a second for as long as it is fed. */
static void watch(struct seen *seen, const char *both, pid_t historian, apc_ns begin, long seconds)
{
    const char *history = strchr(both, '+') + 1;
    struct apc_store *store = open_store(both, false);
    sleep_until(begin);
    const double cpu = cpu_seconds(historian), server = server_seconds(history);
    for (long i = 0; i < seconds; i++) {
        struct apc_behind behind = {.size = sizeof behind};
        sleep_until(begin + (i + 1) * APC_NS_PER_S);
        if (apc_store_behind(store, &behind) < 0)
            die("%s", apc_store_error(store));
        seen->late[i] = apc_ns_to_s(behind.time);
        seen->most = behind.rows > seen->most ? behind.rows : seen->most;
        seen->cpu = cpu_seconds(historian) - cpu;
        if (i + 1 == seconds) {
            seen->server = server_seconds(history) - server;
            seen->looks = looker_seconds(history);
        }
        if (i % 60 == 59)
            printf("%4ld s: %" PRIu64 " rows behind, %.2f s\n", i + 1, behind.rows, seen->late[i]);
        fflush(stdout);
    }
    apc_store_close(store);
    qsort(seen->late, (size_t)seconds, sizeof *seen->late, by_value);
}

static void wait_for_the_last(const char *history, int64_t rows)
{
    struct apc_sample last = {.table = APC_SENSOR, .id = variables};
    struct apc_store *store = open_store(history, false);
    for (int i = 0; last.seq < rows && i < 10 * PATIENCE; i++) {
        sleep_until(apc_clock_mono(NULL) + 100 * APC_NS_PER_MS);
        if (apc_store_read(store, &last, 1) < 0)
            die("%s", apc_store_error(store));
    }
    apc_store_close(store);
}

static int64_t count(const char *history)
{
    const struct apc_range all = {0};
    struct apc_store *store = open_store(history, false);
    int64_t n = 0;
    for (int i = 1; i <= variables; i++) {
        int64_t last = 0;
        if (apc_store_history(store, APC_SENSOR, i, &all, in_order, &last) < 0)
            die("%s", apc_store_error(store));
        n += last;
    }
    apc_store_close(store);
    return n;
}

static void make_live(void)
{
    char uri[64];
    snprintf(live, sizeof live, "shm:bench-keeps-up-%d", (int)getpid());
    snprintf(path, sizeof path, "/dev/shm/apc.%s", live + strlen("shm:"));
    snprintf(uri, sizeof uri, "%.40s?size=%d", live, MIB);
    apc_store_close(open_store(uri, true));
    atexit(remove_live);
}

int main(int argc, char **argv)
{
    const long seconds = argc >= 5 ? strtol(argv[4], NULL, 10) : 0;
    if (argc >= 7) {
        variables = (int)strtol(argv[5], NULL, 10);
        period = strtol(argv[6], NULL, 10) * APC_NS_PER_MS;
    }
    if ((argc != 5 && (argc < 7 || argc > 9)) || seconds < 1 || seconds > 86400 || variables < 1 ||
        period < APC_NS_PER_MS)
        die("usage: bench_historian BIN EXPERIMENT HISTORY SECONDS [VARIABLES PERIOD [EVERY [--pack]]]");
    const char *history = argv[3], *every = argc >= 8 ? argv[7] : "0.1";
    const int64_t rows = seconds * APC_NS_PER_S / period;
    char both[4400];
    int status;
    make_live();
    snprintf(both, sizeof both, "%s+%s", live, history);
    apc_store_close(open_store(history, true));

    const pid_t historian = start_historian(argv[1], argv[2], history, every, argc == 9 ? argv[8] : NULL);
    const apc_ns begin = apc_clock_mono(NULL) + 2 * APC_NS_PER_S;
    const pid_t feeder = feed(begin, rows);
    struct seen seen = {.late = allocate((size_t)seconds, sizeof *seen.late)};
    watch(&seen, both, historian, begin, seconds);
    if (waitpid(feeder, &status, 0) != feeder || status != 0)
        die("what feeds has failed");
    wait_for_the_last(history, rows);
    kill(historian, SIGTERM);
    waitpid(historian, &status, 0);
    printf("%d samples/s for %ld s: %" PRId64 " of %" PRId64
           " stored, each once; behind p50 %.2f, most %.2f s, "
           "%" PRIu64
           " rows; of a core the historian took %.1f %%, the database %.1f %%, and %.1f %% to be looked at\n",
           (int)(variables * APC_NS_PER_S / period), seconds, count(history), rows * variables,
           seen.late[seconds / 2], seen.late[seconds - 1], seen.most, seen.cpu / (double)seconds * 100,
           (seen.server - seen.looks) / (double)seconds * 100, seen.looks / (double)seconds * 100);
    free(seen.late);
    return 0;
}

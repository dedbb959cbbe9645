/* SPDX-License-Identifier: BSD-3-Clause */
/*
 * bench/ui: apc-ui from outside, as real processes. First CLIENTS streams of VALUES values at RATE Hz: the
 * daemon's share of a core from /proc, and for each message how long after the commit it arrived. Then a
 * controller with a period of 20 ms, in turn alone and while REQUESTS a second are asked of an apc-ui beside
 * it: its lateness from its own timing rows. Then the same in a flood of alarms, and whether all of their
 * transitions are in the journal; once on the database, once on live data in memory.
 */
#include <argp.h>
#include <arpa/inet.h>
#include <errno.h>
#include <fcntl.h>
#include <inttypes.h>
#include <signal.h>
#include <stdlib.h>
#include <string.h>
#include <sys/epoll.h>
#include <sys/socket.h>
#include <sys/wait.h>
#include <unistd.h>

#include <apcstore.h>
#include <apctimer.h>

#include "bench.h"

#define CLIENTS  200
#define VALUES   50
#define RATE     10
#define SECONDS  15
#define REQUESTS 1000
#define SENDERS  8   /* connections of the flood */
#define TURNS    8   /* quiet and flooded */
#define TURN     12  /* s */
#define FLOOD    500 /* alarms, all of one signal, which moves each: */
#define FLIP     (3 * APC_NS_PER_S / 2)

static const char *bin, *experiment, *json_path;
static char folder[] = "/tmp/apc-bench-ui.XXXXXX";

static apc_ns mono(void)
{
    return apc_clock_mono(NULL);
}

static void sleep_until(apc_ns when)
{
    const struct timespec t = {when / APC_NS_PER_S, when % APC_NS_PER_S};
    while (clock_nanosleep(CLOCK_MONOTONIC, TIMER_ABSTIME, &t, NULL) == EINTR)
        continue;
}

/* ---- Processes ---------------------------------------------------------------------------- */

static pid_t start(const char *program, const char *const *arguments, const char *log)
{
    char path[4096], name[4096];
    char *argv[16] = {path};
    snprintf(path, sizeof path, "%s/%s", bin, program);
    snprintf(name, sizeof name, "%s/%s", folder, log);
    for (int i = 0; arguments[i]; i++)
        argv[i + 1] = (char *)(uintptr_t)arguments[i];
    pid_t pid = fork();
    if (pid == 0) {
        int fd = open(name, O_WRONLY | O_CREAT | O_APPEND, 0600);
        dup2(fd, 1);
        dup2(fd, 2);
        execv(path, argv);
        _exit(127);
    }
    if (pid < 0)
        die("%s cannot be started", program);
    return pid;
}

static void stop(pid_t pid)
{
    kill(pid, SIGTERM);
    waitpid(pid, NULL, 0);
}

static double cpu_seconds(pid_t pid)
{
    char path[64], text[1024] = "";
    unsigned long user = 0, system = 0;
    snprintf(path, sizeof path, "/proc/%d/stat", (int)pid);
    FILE *file = fopen(path, "r");
    if (!file || !fgets(text, sizeof text, file) ||
        sscanf(strrchr(text, ')') + 2, "%*c %*d %*d %*d %*d %*d %*u %*u %*u %*u %*u %lu %lu", &user,
               &system) != 2)
        die("%s cannot be read", path);
    fclose(file);
    return (double)(user + system) / (double)sysconf(_SC_CLK_TCK);
}

static int try_connect(int port)
{
    const struct sockaddr_in address = {
        .sin_family = AF_INET, .sin_port = htons((uint16_t)port), .sin_addr.s_addr = htonl(INADDR_LOOPBACK)};
    int fd = socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0);
    if (fd >= 0 && connect(fd, (const struct sockaddr *)&address, sizeof address) == 0)
        return fd;
    close(fd);
    return -1;
}

static void say(int fd, const char *text)
{
    if (send(fd, text, strlen(text), MSG_NOSIGNAL) != (ssize_t)strlen(text))
        die("apc-ui took no request: %s", strerror(errno));
}

static pid_t start_ui(int *port)
{
    char listen[32];
    *port = 20000 + (int)getpid() % 10000;
    snprintf(listen, sizeof listen, "127.0.0.1:%d", *port);
    const char *const arguments[] = {"--listen", listen, "--log-level", "warn", NULL};
    setenv("HOME", folder, 1); /* no users */
    pid_t pid = start("apc-ui", arguments, "ui.log");
    for (int i = 0, fd; i < 500; i++) {
        if ((fd = try_connect(*port)) >= 0) {
            close(fd);
            return pid;
        }
        sleep_until(mono() + 20 * APC_NS_PER_MS);
    }
    die("apc-ui does not listen: see %s/ui.log", folder);
}

/* The one that the programs have, too. Each part has its own: another plant's is not taken. */
static void open_store(struct apc_store **store)
{
    const struct apc_store_options options = {
        .size = sizeof options, .name = "bench", .timeout = 10 * APC_NS_PER_S};
    struct apc_error why;
    if (apc_store_open(store, getenv("APC_STORE"), &options, &why) < 0)
        die("%s", why.text);
    if (apc_store_init(*store) < 0)
        die("%s", apc_store_error(*store));
}

/* ---- Streams ------------------------------------------------------------------------------ */

struct fan {
    int epoll;
    int fd[CLIENTS];
    apc_ns committed[SECONDS * RATE + 100]; /* by seq */
    apc_ns *late;
    size_t n;
    char tail[CLIENTS][32]; /* a mark may be cut in two */
};

#define MARK "\"sensor.1\":["

/* Each message names the first variable with its seq: that of the commit it tells of. */
static void look_for_marks(struct fan *f, int i, char *data, apc_ns now)
{
    for (char *at = data; (at = strstr(at, MARK)) != NULL; at += sizeof MARK - 1) {
        char *end;
        long seq = strtol(at + sizeof MARK - 1, &end, 10);
        if (*end == ',' && seq > 0 && seq < SECONDS * RATE + 100 && f->committed[seq] > 0 &&
            f->n < (size_t)CLIENTS * SECONDS * RATE * 2)
            f->late[f->n++] = now - f->committed[seq];
    }
    size_t n = strlen(data), keep = n < sizeof f->tail[i] - 1 ? n : sizeof f->tail[i] - 1;
    char *last = data + n - keep, *mark = strstr(last, MARK);
    if (mark && strchr(mark, ',')) /* counted already */
        last = mark + sizeof MARK - 1;
    snprintf(f->tail[i], sizeof f->tail[i], "%s", last);
}

static void read_streams(struct fan *f, apc_ns until)
{
    static char data[1 << 16];
    struct epoll_event events[CLIENTS];
    while (mono() < until) {
        int n = epoll_wait(f->epoll, events, CLIENTS, (int)((until - mono()) / APC_NS_PER_MS) + 1);
        for (int k = 0; k < n; k++) {
            int i = (int)events[k].data.u32;
            size_t kept = strlen(f->tail[i]);
            memcpy(data, f->tail[i], kept);
            ssize_t got = recv(f->fd[i], data + kept, sizeof data - kept - 1, MSG_DONTWAIT);
            if (got <= 0)
                die("a stream ended");
            data[kept + (size_t)got] = '\0';
            look_for_marks(f, i, data, mono());
        }
    }
}

static int by_size(const void *a, const void *b)
{
    apc_ns x = *(const apc_ns *)a, y = *(const apc_ns *)b;
    return (x > y) - (x < y);
}

static void describe(struct apc_store *store)
{
    struct apc_tag *tags = allocate(VALUES, sizeof *tags);
    for (int i = 0; i < VALUES; i++) {
        tags[i] =
            (struct apc_tag){.table = APC_SENSOR, .id = i + 1, .low = -APC_VALUE_MAX, .high = APC_VALUE_MAX};
        snprintf(tags[i].name, sizeof tags[i].name, "y%d", i + 1);
    }
    if (apc_store_put_tags(store, tags, VALUES) < 0)
        die("%s", apc_store_error(store));
    free(tags);
}

static void append(struct apc_store *store, struct fan *f, int64_t seq)
{
    struct apc_sample samples[VALUES];
    apc_ns utc = apc_clock_utc(NULL);
    for (int i = 0; i < VALUES; i++)
        samples[i] = (struct apc_sample){
            .table = APC_SENSOR, .id = i + 1, .seq = seq, .time = utc, .value = (double)seq / 7.0 + i};
    if (apc_store_append(store, samples, VALUES) < 0)
        die("%s", apc_store_error(store));
    f->committed[seq] = mono();
}

static void fan_out(FILE *json)
{
    static struct fan f;
    struct apc_store *store;
    int port;
    setenv("APC_STORE", "postgresql:#streams", 1);
    f.late = allocate((size_t)CLIENTS * SECONDS * RATE * 2, sizeof *f.late);
    open_store(&store);
    describe(store);
    append(store, &f, 1);
    pid_t ui = start_ui(&port);
    f.epoll = epoll_create1(EPOLL_CLOEXEC);
    for (int i = 0; i < CLIENTS; i++) {
        struct epoll_event event = {.events = EPOLLIN, .data.u32 = (uint32_t)i};
        f.fd[i] = try_connect(port);
        if (f.fd[i] < 0)
            die("stream %d is refused", i);
        say(f.fd[i], "GET /events HTTP/1.1\r\nHost: localhost\r\n\r\n");
        epoll_ctl(f.epoll, EPOLL_CTL_ADD, f.fd[i], &event);
    }
    read_streams(&f, mono() + 2 * APC_NS_PER_S);
    f.n = 0;
    double cpu = cpu_seconds(ui);
    apc_ns began = mono(), tick = APC_NS_PER_S / RATE;
    for (int k = 0; k < SECONDS * RATE; k++) {
        append(store, &f, k + 2);
        read_streams(&f, began + (k + 1) * tick);
    }
    cpu = cpu_seconds(ui) - cpu;
    double share = 100 * cpu / apc_ns_to_s(mono() - began);
    qsort(f.late, f.n, sizeof *f.late, by_size);
    if (f.n < (size_t)CLIENTS * SECONDS * RATE * 9 / 10)
        die("only %zu of %d messages came", f.n, CLIENTS * SECONDS * RATE);
    double p50 = (double)f.late[f.n / 2] / 1e6, p95 = (double)f.late[f.n * 95 / 100] / 1e6,
           p99 = (double)f.late[f.n * 99 / 100] / 1e6;
    printf("%d streams, %d values at %d Hz: %.1f %% of a core\n", CLIENTS, VALUES, RATE, share);
    printf("commit to message: p50 %.2f ms, p95 %.2f ms, p99 %.2f ms (%zu messages)\n\n", p50, p95, p99, f.n);
    if (json)
        fprintf(json,
                "{\"streams\":%d,\"values\":%d,\"rate_hz\":%d,\"core_percent\":%.2f,\"p50_ms\":%.3f,\"p95_"
                "ms\":%.3f,\"p99_ms\":%.3f",
                CLIENTS, VALUES, RATE, share, p50, p95, p99);
    for (int i = 0; i < CLIENTS; i++)
        close(f.fd[i]);
    close(f.epoll);
    stop(ui);
    apc_store_close(store);
    free(f.late);
}

/* ---- Floods ------------------------------------------------------------------------------- */

/* r is the operator's from here on; `flooded`: it has alarms. */
static void write_setpoints(FILE *to, bool flooded)
{
    fputs("setpoints = ( { name = \"r\"; low = -100.0; high = 100.0;", to);
    for (int i = 0; i < FLOOD && flooded; i++)
        fprintf(to, "%s{ kind = \"high\"; name = \"flood%d\"; limit = 50.0; }",
                i ? ",\n  " : " alarms = (\n  ", i);
    fputs(flooded ? " ); } );\nalarms = { period = 0.2; };\n" : " } );\n", to);
}

/* The paper's experiment with a controller of 20 ms, so that there is something to count. */
static void write_experiment(char path[4200], bool flooded)
{
    char line[512];
    snprintf(path, 4200, "%s/fast.conf", folder);
    FILE *from = fopen(experiment, "r"), *to = fopen(path, "w");
    if (!from || !to)
        die("%s cannot be copied", experiment);
    while (fgets(line, sizeof line, from)) {
        char *port = strstr(line, "43051");
        if (strstr(line, "period = 2.0;"))
            fputs("  period = 0.02; phase = 0.003;\n", to);
        else if (strstr(line, "period = 0.5;"))
            fputs("  period = 0.1; phase = 0.011;\n", to);
        else if (strstr(line, "period = 150.0;"))
            fputs("  period = 15000.0;\n", to);
        else if (strstr(line, "name = \"r\";"))
            write_setpoints(to, flooded);
        else if (port)
            fprintf(to, "%.*s%d%s", (int)(port - line), line, 31000 + (int)getpid() % 1000, port + 5);
        else
            fputs(line, to);
    }
    fclose(from);
    fclose(to);
}

struct senders {
    int port, fd[SENDERS], n;
};

static void ask(void *ctx, apc_ns until)
{
    static const char request[] = "GET /api/state HTTP/1.1\r\nHost: localhost\r\n\r\n";
    static char answer[1 << 16];
    struct senders *s = ctx;
    apc_ns began = mono();
    for (int n = 0; mono() < until; n++, s->n++) {
        int *to = &s->fd[n % SENDERS];
        apc_ns due = began + n * (APC_NS_PER_S / REQUESTS);
        if (due > mono())
            sleep_until(due);
        if (*to < 0 && (*to = try_connect(s->port)) < 0)
            die("apc-ui refuses connections");
        say(*to, request);
        if (recv(*to, answer, sizeof answer, 0) <= 0)
            die("apc-ui closed a connection");
    }
}

struct flips {
    const char *store;
    int n;
};

static void set_r(const char *store, const char *value)
{
    int status;
    const char *const arguments[] = {"set", "r", value, "--no-wait", "--store", store, NULL};
    pid_t pid = start("apc", arguments, "set.log");
    if (waitpid(pid, &status, 0) < 0 || !WIFEXITED(status) || WEXITSTATUS(status) != 0)
        die("apc set r %s failed: see %s/set.log", value, folder);
}

/* All alarms come, and go; a turn is a whole number of both. */
static void flip(void *ctx, apc_ns until)
{
    struct flips *f = ctx;
    for (apc_ns due = mono(); due + FLIP <= until + FLIP / 2; due += FLIP) {
        sleep_until(due);
        set_r(f->store, f->n++ % 2 ? "40" : "60");
    }
    sleep_until(until);
}

struct lateness {
    struct apc_histogram *turn[2 * TURNS];
    apc_ns began[2 * TURNS + 1]; /* UTC */
    uint64_t missed[2];          /* quiet, flooded */
};

static int take_row(void *ctx, const struct apc_timing_row *row)
{
    struct lateness *l = ctx;
    if (strcmp(row->task, "controller") != 0 || strcmp(row->quantity, "lateness") != 0)
        return 0;
    for (int i = 0; i < 2 * TURNS; i++) { /* windows that lie in one turn wholly */
        if (row->time - 5 * APC_NS_PER_S < l->began[i] || row->time > l->began[i + 1])
            continue;
        l->missed[i % 2] += row->missed;
        for (size_t b = 0; b < row->n_bins; b++)
            for (int64_t k = 0; k < row->bin_count[b]; k++)
                apc_histogram_record(l->turn[i], row->bin_low[b]);
    }
    return 0;
}

static int by_value(const void *a, const void *b)
{
    double x = *(const double *)a, y = *(const double *)b;
    return (x > y) - (x < y);
}

static void ratios(const struct lateness *l, const char *by, FILE *json)
{
    double r50[TURNS], r99[TURNS];
    struct apc_summary quiet = {0}, flooded = {0};
    for (int i = 0; i < TURNS; i++) {
        apc_histogram_summary(l->turn[2 * i], &quiet);
        apc_histogram_summary(l->turn[2 * i + 1], &flooded);
        if (quiet.count == 0 || flooded.count == 0)
            die("the controller reported nothing in turn %d", i);
        r50[i] = (double)flooded.p50 / (double)quiet.p50;
        r99[i] = (double)flooded.p99 / (double)quiet.p99;
        printf("turn %d  quiet p50 %6.1f p99 %7.1f us   flooded p50 %6.1f p99 %7.1f us   (%" PRIu64
               " + %" PRIu64 " ticks)\n",
               i + 1, (double)quiet.p50 / 1e3, (double)quiet.p99 / 1e3, (double)flooded.p50 / 1e3,
               (double)flooded.p99 / 1e3, quiet.count, flooded.count);
    }
    qsort(r50, TURNS, sizeof *r50, by_value);
    qsort(r99, TURNS, sizeof *r99, by_value);
    double m50 = (r50[TURNS / 2 - 1] + r50[TURNS / 2]) / 2, m99 = (r99[TURNS / 2 - 1] + r99[TURNS / 2]) / 2;
    printf("controller's lateness, flooded by %s / quiet, median of %d turns: p50 %.2f, p99 %.2f; ticks "
           "missed: %" PRIu64 " flooded, %" PRIu64 " quiet\n\n",
           by, TURNS, m50, m99, l->missed[1], l->missed[0]);
    if (json)
        fprintf(json, ",\"%s_ratio_p50\":%.3f,\"%s_ratio_p99\":%.3f", by, m50, by, m99);
}

/* In turn quiet and flooded; each turn ends at a time that is known before. */
static void take_turns(struct lateness *l, void (*flooded)(void *ctx, apc_ns until), void *ctx)
{
    *l = (struct lateness){0};
    apc_ns end = mono();
    for (int i = 0; i < 2 * TURNS; i++) {
        l->began[i] = apc_clock_utc(NULL);
        end += TURN * APC_NS_PER_S;
        if (apc_histogram_create(&l->turn[i]) < 0)
            die("out of memory");
        if (i % 2)
            flooded(ctx, end);
        else
            sleep_until(end);
    }
    l->began[2 * TURNS] = apc_clock_utc(NULL);
    sleep_until(mono() + 6 * APC_NS_PER_S); /* its last window */
}

static void report(struct lateness *l, struct apc_store *store, const char *by, FILE *json)
{
    if (apc_store_timing(store, &(struct apc_range){.since = l->began[0]}, take_row, l) < 0)
        die("%s", apc_store_error(store));
    ratios(l, by, json);
    for (int i = 0; i < 2 * TURNS; i++)
        apc_histogram_destroy(l->turn[i]);
}

static pid_t start_run(const char *out, bool flooded)
{
    char config[4200];
    write_experiment(config, flooded);
    const char *const arguments[] = {"run", config, "--duration", "0", "--out", out, "--no-ui", NULL};
    pid_t run = start("apc", arguments, "run.log");
    sleep_until(mono() + 5 * APC_NS_PER_S); /* the grid begins 2 to 3 s from its start */
    return run;
}

static void stop_run(pid_t run)
{
    kill(run, SIGINT);
    waitpid(run, NULL, 0);
}

static void requests_flood(FILE *json)
{
    static struct lateness l;
    struct senders senders = {0};
    struct apc_store *store;
    char out[4200];
    snprintf(out, sizeof out, "%s/run", folder);
    setenv("APC_STORE", "postgresql:#requests", 1);
    pid_t run = start_run(out, false), ui = start_ui(&senders.port);
    for (int i = 0; i < SENDERS; i++)
        senders.fd[i] = -1;
    take_turns(&l, ask, &senders);
    printf("%d requests, %.0f/s while flooded\n", senders.n, (double)senders.n / (TURNS * TURN));
    stop(ui);
    stop_run(run);
    open_store(&store);
    report(&l, store, "requests", json);
    apc_store_close(store);
}

struct journal {
    int64_t last; /* of one alarm */
    size_t rows;
    bool *there; /* [most + 1] by its number in the journal */
    size_t most;
};

static int take_transition(void *ctx, const struct apc_sample *row)
{
    struct journal *j = ctx;
    if (row->seq != j->last + 1 || row->origin < 1 || (size_t)row->origin > j->most || j->there[row->origin])
        die("alarm.%d: transition %" PRId64 ", number %" PRId64 ", after %" PRId64
            ": one is lost, or there twice",
            row->id, row->seq, row->origin, j->last);
    j->last = row->seq;
    j->there[row->origin] = true;
    j->rows++;
    return 0;
}

/* Each transition is there once, of each alarm and in the one order of all. */
static void count_transitions(struct apc_store *store, int flips)
{
    struct journal j = {.most = (size_t)flips * FLOOD};
    j.there = allocate(j.most + 1, sizeof *j.there);
    for (int i = 0; i < FLOOD; i++) {
        j.last = 0;
        if (apc_store_history(store, APC_ALARM, i + 1, &(struct apc_range){0}, take_transition, &j) < 0)
            die("%s", apc_store_error(store));
    }
    if (j.rows != j.most)
        die("%zu of %zu transitions are in the journal", j.rows, j.most);
    free(j.there);
    printf("%zu of %zu transitions in the journal, each once; %.0f alarms a minute while flooded\n", j.rows,
           j.most, (double)j.most / 2 * 60 / (TURNS * TURN));
}

/* `live`: in memory, its record in the run folder. */
static void alarms_flood(bool live, FILE *json)
{
    static struct lateness l;
    struct apc_store *store;
    char out[4200], database[4300];
    snprintf(out, sizeof out, "%s/%s", folder, live ? "live" : "alarms");
    snprintf(database, sizeof database, "sqlite:%s/store.db", out);
    setenv("APC_STORE", "postgresql:#alarms", 1);
    struct flips flips = {.store = live ? out : getenv("APC_STORE")};
    if (live)
        unsetenv("APC_STORE");
    pid_t run = start_run(out, true);
    take_turns(&l, flip, &flips);
    stop_run(run);
    if (live)
        setenv("APC_STORE", database, 1);
    open_store(&store);
    count_transitions(store, flips.n);
    report(&l, store, live ? "alarms_in_memory" : "alarms", json);
    apc_store_close(store);
}

/* ------------------------------------------------------------------------------------------- */

static error_t parse(int key, char *arg, struct argp_state *state)
{
    (void)state;
    if (key == 'b')
        bin = arg;
    else if (key == 'e')
        experiment = arg;
    else if (key == 'j')
        json_path = arg;
    else
        return ARGP_ERR_UNKNOWN;
    return 0;
}

int main(int argc, char **argv)
{
    static const struct argp_option options[] = {
        {"bin", 'b', "DIR", 0, "Folder of the programs", 0},
        {"experiment", 'e', "FILE", 0, "The paper's", 0},
        {"json", 'j', "FILE", 0, "Write the figures there as well", 0},
        {0}};
    static const struct argp argp = {options, parse, NULL, "What the operator's page costs.",
                                     NULL,    NULL,  NULL};
    argp_parse(&argp, argc, argv, 0, NULL, NULL);
    if (!bin || !experiment)
        die("run bench/ui");
    FILE *json = json_path ? fopen(json_path, "w") : NULL;
    if (json_path && !json)
        die("%s cannot be written", json_path);
    if (!mkdtemp(folder))
        die("%s: %s", folder, strerror(errno));
    setvbuf(stdout, NULL, _IOLBF, 0);
    fan_out(json);
    requests_flood(json);
    alarms_flood(false, json);
    alarms_flood(true, json);
    if (json) {
        fputs("}\n", json);
        fclose(json);
    }
    return 0;
}

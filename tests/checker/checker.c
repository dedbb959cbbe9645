/* SPDX-License-Identifier: BSD-3-Clause */
/*
 * A history checker in the manner of Jepsen: processes write and read a store while writers, and the server
 * behind the store, are killed at random; each writes down what it attempted, what was acknowledged, what it
 * read. In the end that must fit together (history.h).
 *
 * checker run --store URI --dir DIR [--kills N] [--writers N] [--readers N] [--ids N] [--seed N] [--spool]
 *             [--ring] [--server-hook COMMAND] [--history URI --historian COMMAND]
 *                                         --ring: the store keeps the newest rows only. COMMAND kills the
 *                                         server and brings it back; its argument is a random number.
 *                                         --historian: COMMAND moves the store's rows on to URI, is killed as
 *                                         others are, and what stands there in the end is looked at
 * checker check DIR                       look at a history again
 */
#include <argp.h>
#include <errno.h>
#include <fcntl.h>
#include <inttypes.h>
#include <signal.h>
#include <stdbool.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/prctl.h>
#include <sys/stat.h>
#include <sys/wait.h>
#include <time.h>
#include <unistd.h>

#include <apcstore.h>

#include "history.h"

enum { WRITERS_MAX = 4, READERS_MAX = 8, IDS_MAX = 64 };

static const enum apc_table tables[WRITERS_MAX] = {APC_SENSOR, APC_ACTUATOR, APC_ESTIMATE, APC_TUNING};

struct options {
    const char *store, *dir, *server_hook, *history, *historian;
    unsigned kills, writers, readers, ids, spool, ring;
    uint64_t seed;
};

static volatile sig_atomic_t stopping;

static void on_term(int signal)
{
    (void)signal;
    stopping = 1;
}

/* ---- What everybody needs -------------------------------------------------------------------- */

/* splitmix64 */
static uint64_t random_of(uint64_t *state)
{
    uint64_t z = (*state += UINT64_C(0x9e3779b97f4a7c15));
    z = (z ^ z >> 30) * UINT64_C(0xbf58476d1ce4e5b9);
    z = (z ^ z >> 27) * UINT64_C(0x94d049bb133111eb);
    return z ^ z >> 31;
}

/* Nothing is waited for: at which instant a process dies, reads or writes is what is drawn. */
static void pause_us(uint64_t us)
{
    nanosleep(&(struct timespec){(time_t)(us / 1000000), (long)(us % 1000000) * 1000}, NULL);
}

static void die(const char *what, const char *why)
{
    fprintf(stderr, "checker: %s: %s\n", what, why);
    exit(2);
}

static int open_log(const struct options *o, const char *kind, unsigned number)
{
    char path[600];
    snprintf(path, sizeof path, "%s/%s-%u.log", o->dir, kind, number);
    int fd = open(path, O_WRONLY | O_CREAT | O_APPEND | O_CLOEXEC, 0666);
    if (fd < 0)
        die(path, strerror(errno));
    return fd;
}

/* Lines for a log; what was written is there even when the process is killed at once. */
struct lines {
    int fd;
    size_t used;
    char text[IDS_MAX * WRITERS_MAX * 96];
};

static void add_line(struct lines *l, char kind, const struct apc_sample *s)
{
    char value[40];
    apc_number_format(s->value, value, sizeof value);
    l->used += (size_t)snprintf(l->text + l->used, sizeof l->text - l->used, "%c %s %d %" PRId64 " %s\n",
                                kind, apc_table_name(s->table), s->id, s->seq, value);
}

static void write_lines(struct lines *l)
{
    if (l->used > 0 && write(l->fd, l->text, l->used) != (ssize_t)l->used)
        die("log", strerror(errno));
    l->used = 0;
}

static void write_words(struct lines *l, const char *words, const char *why)
{
    l->used = (size_t)snprintf(l->text, sizeof l->text, "x %s: %.180s\n", words, why);
    write_lines(l);
}

static struct apc_store *open_uri(const struct options *o, const char *uri, const char *name, bool spooled,
                                  unsigned number)
{
    char path[600];
    struct apc_error why;
    struct apc_store *store;
    snprintf(path, sizeof path, "%s/%s-%u.spool", o->dir, name, number);
    const struct apc_store_options options = {.size = sizeof options,
                                              .name = name,
                                              .timeout = APC_NS_PER_S,
                                              .backoff_min = 10 * APC_NS_PER_MS,
                                              .backoff_max = 200 * APC_NS_PER_MS,
                                              .spool = spooled ? path : NULL};
    for (;;) {
        int rc = apc_store_open(&store, uri, &options, &why);
        if (rc == 0)
            return store;
        if (rc != APC_EBUSY) /* the killed process still holds its spool */
            die(uri, why.text);
        pause_us(1000);
    }
}

static struct apc_store *open_store(const struct options *o, const char *name, bool spooled, unsigned number)
{
    return open_uri(o, o->store, name, spooled, number);
}

/* ---- A writer -------------------------------------------------------------------------------- */

struct writer {
    const struct options *o;
    struct apc_store *store;
    struct lines log;
    uint64_t random;
    int64_t last[IDS_MAX];
    struct apc_sample batch[IDS_MAX];
    size_t n;
};

static void claim(struct writer *w, unsigned number)
{
    int rc;
    while ((rc = apc_store_claim(w->store, tables[number], w->o->ids, w->last)) < 0 && !stopping) {
        if (rc != APC_EBUSY && rc != APC_ECONN && rc != APC_ETIMEDOUT)
            write_words(&w->log, "claim", apc_store_error(w->store));
        pause_us(5000);
    }
}

static void choose(struct writer *w, unsigned number)
{
    w->n = 1 + random_of(&w->random) % w->o->ids;
    for (size_t i = 0; i < w->n; i++) {
        w->batch[i] = (struct apc_sample){.table = tables[number],
                                          .id = (int)i + 1,
                                          .seq = ++w->last[i],
                                          .time = apc_clock_utc(NULL),
                                          .value = (double)(random_of(&w->random) >> 11)};
        add_line(&w->log, 'a', &w->batch[i]);
    }
    write_lines(&w->log);
}

/* Until it is acknowledged, or given up, as a writer that has something newer would. */
static void append(struct writer *w)
{
    bool again = false;
    for (;;) {
        int rc = apc_store_append(w->store, w->batch, w->n);
        if (rc >= 0 && (size_t)rc < w->n && !again)
            write_words(&w->log, "append", "rows stand there that nobody wrote before");
        if (rc >= 0)
            break;
        if (rc != APC_ECONN && rc != APC_ETIMEDOUT)
            write_words(&w->log, "append", apc_store_error(w->store));
        if (stopping || random_of(&w->random) % 16 == 0)
            return;
        again = true;
        pause_us(2000);
    }
    for (size_t i = 0; i < w->n; i++)
        add_line(&w->log, 'k', &w->batch[i]);
    write_lines(&w->log);
}

static void finish_writer(struct writer *w)
{
    struct apc_store_stats stats = {.size = sizeof stats};
    do {
        (void)apc_store_connect(w->store);
        apc_store_stats(w->store, &stats);
        if (stats.spool.damaged > 0)
            write_words(&w->log, "spool", stats.spool.aside);
    } while (stats.spool.samples > 0 && stats.spool.damaged == 0);
    apc_store_close(w->store);
}

static void write_rows(const struct options *o, unsigned number, uint64_t seed)
{
    static struct writer w;
    w.o = o;
    w.random = seed;
    w.log.fd = open_log(o, "writer", number);
    w.store = open_store(o, "writer", o->spool, number);
    claim(&w, number);
    while (!stopping) {
        choose(&w, number);
        append(&w);
        pause_us(random_of(&w.random) % (o->historian ? 30000 : 3000)); /* a ring outlives an outage */
    }
    finish_writer(&w);
}

/* ---- A reader -------------------------------------------------------------------------------- */

static void read_rows(const struct options *o, unsigned number, uint64_t seed)
{
    static struct lines log;
    static struct apc_sample now[WRITERS_MAX * IDS_MAX], before[WRITERS_MAX * IDS_MAX];
    size_t n = 0;
    log.fd = open_log(o, "reader", number);
    struct apc_store *store = open_store(o, "reader", false, number);
    for (unsigned t = 0; t < o->writers; t++)
        for (unsigned i = 0; i < o->ids; i++)
            now[n++] = (struct apc_sample){.table = tables[t], .id = (int)i + 1};
    while (!stopping) {
        if (apc_store_read(store, now, n) == 0) {
            for (size_t i = 0; i < n; i++) {
                if (now[i].seq != before[i].seq || now[i].value < before[i].value ||
                    now[i].value > before[i].value)
                    add_line(&log, 'r', &now[i]);
                before[i] = now[i];
            }
            write_lines(&log);
        }
        pause_us(500 + random_of(&seed) % 2000);
    }
    apc_store_close(store);
}

/* ---- A historian ----------------------------------------------------------------------------- */

static void move_rows(const struct options *o, unsigned number, uint64_t seed)
{
    const int log = open_log(o, "historian-said", number);
    char command[1000];
    (void)seed;
    snprintf(command, sizeof command, "exec %s", o->historian);
    dup2(log, STDOUT_FILENO);
    dup2(log, STDERR_FILENO);
    execl("/bin/sh", "sh", "-c", command, (char *)NULL);
    _exit(2);
}

/* ---- The run --------------------------------------------------------------------------------- */

struct run {
    struct options o;
    uint64_t random;
    pid_t writer[WRITERS_MAX], reader[READERS_MAX], historian;
    unsigned server_kills, writer_kills, historian_kills;
};

static pid_t spawn(struct run *r, void (*fn)(const struct options *, unsigned, uint64_t), unsigned number)
{
    uint64_t seed = random_of(&r->random);
    pid_t parent = getpid(), pid = fork();
    if (pid < 0)
        die("fork", strerror(errno));
    if (pid == 0) {
        prctl(PR_SET_PDEATHSIG, SIGKILL);
        if (getppid() != parent)
            _exit(2);
        signal(SIGTERM, on_term);
        fn(&r->o, number, seed);
        exit(0);
    }
    return pid;
}

static off_t log_size(const struct run *r, unsigned number)
{
    char path[600];
    struct stat st;
    snprintf(path, sizeof path, "%s/writer-%u.log", r->o.dir, number);
    return stat(path, &st) == 0 ? st.st_size : 0;
}

/* A kill says something only when there was life before it. */
static void await_progress(const struct run *r)
{
    off_t before[WRITERS_MAX];
    for (unsigned i = 0; i < r->o.writers; i++)
        before[i] = log_size(r, i);
    for (unsigned i = 0; i < r->o.writers; i++) {
        apc_ns give_up = apc_clock_mono(NULL) + 60 * APC_NS_PER_S;
        while (log_size(r, i) < before[i] + 2000) {
            int status;
            if (waitpid(r->writer[i], &status, WNOHANG) != 0)
                die("a writer", "ended by itself");
            if (apc_clock_mono(NULL) > give_up)
                die("a writer", "makes no progress");
            pause_us(1000);
        }
    }
}

static void kill_server(struct run *r)
{
    char command[800];
    snprintf(command, sizeof command, "%s %" PRIu64, r->o.server_hook, random_of(&r->random) % 1000);
    if (system(command) != 0)
        die(command, "failed");
    r->server_kills++;
}

static void kill_historian(struct run *r)
{
    kill(r->historian, SIGKILL);
    waitpid(r->historian, NULL, 0);
    r->historian = spawn(r, move_rows, 0);
    r->historian_kills++;
}

static void kill_somebody(struct run *r)
{
    const uint64_t servers = r->o.server_hook ? 1 : 0, historians = r->o.historian ? 2 : 0;
    const uint64_t victim = random_of(&r->random) % (r->o.writers + servers + historians);
    if (victim >= r->o.writers + servers) {
        kill_historian(r);
        return;
    }
    if (victim >= r->o.writers) {
        kill_server(r);
        return;
    }
    kill(r->writer[victim], SIGKILL);
    waitpid(r->writer[victim], NULL, 0);
    r->writer[victim] = spawn(r, write_rows, (unsigned)victim);
    r->writer_kills++;
}

static void stop(pid_t pid)
{
    int status;
    apc_ns give_up = apc_clock_mono(NULL) + 60 * APC_NS_PER_S;
    kill(pid, SIGTERM);
    while (waitpid(pid, &status, WNOHANG) == 0) {
        if (apc_clock_mono(NULL) > give_up)
            die("a process", "does not end");
        pause_us(1000);
    }
    if (status != 0)
        die("a process", "failed");
}

static void read_newest(struct apc_store *store, struct apc_sample *at, size_t n)
{
    apc_ns give_up = apc_clock_mono(NULL) + 60 * APC_NS_PER_S;
    while (apc_store_read(store, at, n) < 0) {
        if (apc_clock_mono(NULL) > give_up)
            die("reading what is newest", apc_store_error(store));
        pause_us(10000);
    }
}

/* The historian has moved all; then it ends. */
static void await_history(struct run *r)
{
    static struct apc_sample from[WRITERS_MAX * IDS_MAX], to[WRITERS_MAX * IDS_MAX];
    const apc_ns give_up = apc_clock_mono(NULL) + 120 * APC_NS_PER_S;
    struct apc_store *store = open_store(&r->o, "checker", false, 0);
    struct apc_store *history = open_uri(&r->o, r->o.history, "checker", false, 1);
    size_t n = 0, same;
    for (unsigned t = 0; t < r->o.writers; t++)
        for (unsigned i = 0; i < r->o.ids; i++, n++)
            from[n] = to[n] = (struct apc_sample){.table = tables[t], .id = (int)i + 1};
    read_newest(store, from, n);
    do {
        pause_us(10000);
        read_newest(history, to, n);
        for (same = 0; same < n && to[same].seq == from[same].seq;)
            same++;
        if (apc_clock_mono(NULL) > give_up)
            die("the history", "does not get all that the store has");
    } while (same < n);
    apc_store_close(store);
    apc_store_close(history);
    stop(r->historian);
}

static int store_line(void *ctx, const struct apc_sample *s)
{
    struct lines *log = ctx;
    add_line(log, 's', s);
    write_lines(log);
    return 0;
}

static void dump(const struct run *r)
{
    static struct lines log;
    char ring[600];
    log.fd = open_log(&r->o, "stored", 0);
    snprintf(ring, sizeof ring, "%s/ring", r->o.dir);
    if (r->o.ring)
        close(open(ring, O_WRONLY | O_CREAT, 0666));
    struct apc_store *store = open_uri(&r->o, r->o.history ? r->o.history : r->o.store, "checker", false, 0);
    for (unsigned t = 0; t < r->o.writers; t++)
        for (unsigned i = 0; i < r->o.ids; i++)
            if (apc_store_history(store, tables[t], (int)i + 1, NULL, store_line, &log) < 0)
                die("reading the store at the end", apc_store_error(store));
    apc_store_close(store);
    close(log.fd);
}

static int report(const char *dir, const struct run *r)
{
    struct history_counts c;
    if (history_check(dir, &c) != 0)
        die(dir, "the history cannot be read");
    if (r)
        printf("%s%s%s%s, seed %" PRIu64 ": %u kills of writers, %u of the server, %u of the historian\n",
               r->o.store, r->o.spool ? " with spools" : "", r->o.history ? " into " : "",
               r->o.history ? r->o.history : "", r->o.seed, r->writer_kills, r->server_kills,
               r->historian_kills);
    printf("attempted %zu, acknowledged %zu, stored %zu, read %zu: %zu violations\n", c.attempted,
           c.acknowledged, c.stored, c.read, c.violations);
    if (c.stored == 0 || c.acknowledged == 0 || (r && c.read == 0))
        die(dir, "a history in which nothing happened proves nothing");
    return c.violations > 0;
}

static int run(struct run *r)
{
    struct apc_store *store = open_store(&r->o, "checker", false, 0);
    if (apc_store_init(store) < 0)
        die(r->o.store, apc_store_error(store));
    apc_store_close(store);
    r->random = r->o.seed;
    for (unsigned i = 0; i < r->o.writers; i++)
        r->writer[i] = spawn(r, write_rows, i);
    for (unsigned i = 0; i < r->o.readers; i++)
        r->reader[i] = spawn(r, read_rows, i);
    if (r->o.historian)
        r->historian = spawn(r, move_rows, 0);
    await_progress(r);
    for (unsigned kills = 0; kills < r->o.kills; kills++) {
        pause_us(random_of(&r->random) % 150000);
        kill_somebody(r);
        await_progress(r);
    }
    for (unsigned i = 0; i < r->o.writers; i++)
        stop(r->writer[i]);
    for (unsigned i = 0; i < r->o.readers; i++)
        stop(r->reader[i]);
    if (r->o.historian)
        await_history(r);
    dump(r);
    return report(r->o.dir, r);
}

/* ---- Options --------------------------------------------------------------------------------- */

enum { STORE = 0x100, DIR_, KILLS, WRITERS, READERS, IDS, SEED, SPOOL, RING, HOOK, HISTORY, HISTORIAN };

static const struct argp_option option_list[] = {
    {"store", STORE, "URI", 0, "The store", 0},
    {"dir", DIR_, "DIR", 0, "An empty folder for the history", 0},
    {"kills", KILLS, "N", 0, "How often somebody is killed; default 100", 0},
    {"writers", WRITERS, "N", 0, "1 to 4, each on a table of its own; default 3", 0},
    {"readers", READERS, "N", 0, "0 to 8; default 2", 0},
    {"ids", IDS, "N", 0, "Variables of a table, 1 to 64; default 8", 0},
    {"seed", SEED, "N", 0, "Of all that is random; default: the time", 0},
    {"spool", SPOOL, NULL, 0, "The writers spool", 0},
    {"ring", RING, NULL, 0, "The store keeps the newest rows of each variable only", 0},
    {"server-hook", HOOK, "COMMAND", 0, "Kills the server and brings it back", 0},
    {"history", HISTORY, "URI", 0, "Where what is stored stands in the end", 0},
    {"historian", HISTORIAN, "COMMAND", 0, "Moves what the store gets on to there", 0},
    {0},
};

static unsigned number(const char *text, unsigned low, unsigned high, const struct argp_state *state)
{
    char *end;
    unsigned long n = strtoul(text, &end, 10);
    if (*end || end == text || n < low || n > high)
        argp_error(state, "\"%s\": must be %u to %u", text, low, high);
    return (unsigned)n;
}

static error_t parse(int key, char *arg, struct argp_state *state)
{
    struct options *o = state->input;
    switch (key) {
    case STORE:
        o->store = arg;
        break;
    case DIR_:
        o->dir = arg;
        break;
    case KILLS:
        o->kills = number(arg, 0, 1000000, state);
        break;
    case WRITERS:
        o->writers = number(arg, 1, WRITERS_MAX, state);
        break;
    case READERS:
        o->readers = number(arg, 0, READERS_MAX, state);
        break;
    case IDS:
        o->ids = number(arg, 1, IDS_MAX, state);
        break;
    case SEED:
        o->seed = strtoull(arg, NULL, 10);
        break;
    case SPOOL:
        o->spool = 1;
        break;
    case RING:
        o->ring = 1;
        break;
    case HOOK:
        o->server_hook = arg;
        break;
    case HISTORY:
        o->history = arg;
        break;
    case HISTORIAN:
        o->historian = arg;
        break;
    case ARGP_KEY_END:
        if (!o->store || !o->dir)
            argp_error(state, "--store and --dir are needed");
        if (!o->history != !o->historian)
            argp_error(state, "--history and --historian come together");
        break;
    default:
        return ARGP_ERR_UNKNOWN;
    }
    return 0;
}

int main(int argc, char **argv)
{
    static const struct argp argp = {option_list, parse, "",  "Write, kill, read, and look at the history.",
                                     NULL,        NULL,  NULL};
    struct run r = {.o = {.kills = 100, .writers = 3, .readers = 2, .ids = 8}};
    r.o.seed = (uint64_t)apc_clock_utc(NULL);
    if (argc == 3 && strcmp(argv[1], "check") == 0)
        return report(argv[2], NULL);
    if (argc < 2 || strcmp(argv[1], "run") != 0) {
        fputs("usage: checker run --store URI --dir DIR [OPTION...], checker check DIR\n", stderr);
        return 2;
    }
    argp_parse(&argp, argc - 1, argv + 1, 0, NULL, &r.o);
    return run(&r);
}

/* SPDX-License-Identifier: BSD-3-Clause */
/*
 * Processes take the next run from a counter in shared memory and leave its figures there, in the run's own
 * place: so which process made it cannot be seen in the results, and a law that crashes takes one process
 * along, not the campaign.
 */
#include "campaign.h"

#include <errno.h>
#include <math.h>
#include <signal.h>
#include <stdatomic.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>
#include <sys/wait.h>
#include <time.h>
#include <unistd.h>

#include "metrics.h"
#include "print.h"
#include "simulation.h"

#define BAR      24
#define FAILURES 5 /* that are told of */

#define LINE 64 /* bytes of a cache line: no two processes write the same one */

/* Shared by all processes; the results lie behind it, from LINE on. */
struct board {
    atomic_uint next, done;
    atomic_bool stop;
};

struct workers {
    pid_t *pid; /* 0: has ended */
    unsigned n;
};

/* figure[loop * METRICS + metric] lies behind each. */
struct result {
    bool made;
    int rc;
    uint64_t held, failures; /* ticks: output not the law's; the law gave no finite number */
    char why[200];
};

struct campaign {
    const struct experiment *e;
    const struct campaign_options *options;
    size_t loops, stride; /* bytes of a result with its figures */
    size_t size;
    struct board *board;
};

static struct result *result_of(const struct campaign *c, unsigned run)
{
    return (struct result *)(void *)((char *)c->board + LINE + run * c->stride);
}

static double *figures_of(const struct campaign *c, unsigned run)
{
    return (double *)(void *)((char *)result_of(c, run) + sizeof(struct result));
}

/* ---- The runs ----------------------------------------------------------------------------- */

static void make_run(const struct campaign *c, unsigned run)
{
    struct result *r = result_of(c, run);
    struct simulation s;
    struct samples samples = {0};
    struct apc_error why = {""};

    r->rc = simulation_create(&s, c->e, c->options->seed + run, &why);
    if (r->rc == 0) {
        r->rc = simulation_run(&s, c->e->duration);
        why = s.why;
        r->held = s.held;
        r->failures = apc_controller_failures(s.controller);
        int collected = samples_collect(&samples, s.store, c->e, NULL);
        r->rc = r->rc < 0 ? r->rc : collected;
        for (size_t loop = 0; loop < c->loops; loop++)
            metrics_of(&samples, loop, SIMULATION_BEGIN, s.ended, figures_of(c, run) + loop * METRICS);
    }
    simulation_destroy(&s);
    samples_free(&samples);
    snprintf(r->why, sizeof r->why, "%.199s", why.text);
    r->made = true;
    atomic_fetch_add(&c->board->done, 1);
}

static void work(const struct campaign *c)
{
    unsigned run;
    simulation_keep_memory();
    while (!atomic_load(&c->board->stop) && (run = atomic_fetch_add(&c->board->next, 1)) < c->options->runs)
        make_run(c, run);
}

static void show_progress(const struct campaign *c, bool last)
{
    static const char full[] = "########################", empty[] = "........................";
    unsigned done = atomic_load(&c->board->done), all = c->options->runs;
    double share = (double)done / (double)all;
    int filled = (int)(share * BAR);
    if (!isatty(STDERR_FILENO))
        return;
    fprintf(stderr, "\r%u of %u runs  [%.*s%.*s] %3.0f %%%s", done, all, filled, full, BAR - filled, empty,
            100 * share, last ? "\n" : "");
    fflush(stderr);
}

/*
 * The first signal lets the runs at hand come to their end. One that comes later, not as the first one's
 * twin, ends them: a law may not return.
 */
static void take_signal(const struct campaign *c, const struct workers *w, apc_ns *stopped)
{
    const apc_ns now = apc_clock_mono(NULL);
    if (!atomic_exchange(&c->board->stop, true)) {
        *stopped = now;
        if (isatty(STDERR_FILENO))
            fputs("\nwaiting for the runs at hand; Ctrl-C again ends them\n", stderr);
    } else if (now - *stopped > APC_NS_PER_S / 2) {
        for (unsigned i = 0; i < w->n; i++)
            if (w->pid[i] > 0)
                kill(w->pid[i], SIGKILL);
    }
}

static void forget(struct workers *w, pid_t pid)
{
    for (unsigned i = 0; i < w->n; i++)
        if (w->pid[i] == pid)
            w->pid[i] = 0;
}

/* Wait for the workers; the signals are blocked. Returns 0, or APC_ESYS when one of them died. */
static int follow(const struct campaign *c, struct workers *w, const sigset_t *signals, struct apc_error *why)
{
    const struct timespec look = {0, 100 * APC_NS_PER_MS};
    unsigned left = w->n;
    apc_ns stopped = 0;
    int rc = 0, status;
    while (left > 0) {
        int signal = sigtimedwait(signals, NULL, &look);
        if (signal == SIGINT || signal == SIGTERM)
            take_signal(c, w, &stopped);
        show_progress(c, false);
        for (pid_t pid; left > 0 && (pid = waitpid(-1, &status, WNOHANG)) != 0;) {
            if (pid < 0 && errno != EINTR)
                return apc_fail(why, APC_ESYS, "a process was lost: %s", strerror(errno));
            left -= pid > 0;
            forget(w, pid);
            if (pid > 0 && stopped == 0 && (!WIFEXITED(status) || WEXITSTATUS(status) != 0))
                rc = apc_fail(why, APC_ESYS, "a process of the campaign died%s: runs are missing",
                              WIFSIGNALED(status) ? " of a signal" : "");
        }
    }
    show_progress(c, true);
    return rc;
}

static int run_all(const struct campaign *c, struct apc_error *why)
{
    unsigned jobs = c->options->jobs ? c->options->jobs : (unsigned)sysconf(_SC_NPROCESSORS_ONLN);
    struct workers w = {.n = 0};
    sigset_t signals, before;
    int rc = 0;

    if (jobs > c->options->runs)
        jobs = c->options->runs;
    w.pid = calloc(jobs, sizeof *w.pid);
    if (!w.pid)
        return apc_fail(why, APC_ENOMEM, "out of memory");
    sigemptyset(&signals);
    sigaddset(&signals, SIGINT);
    sigaddset(&signals, SIGTERM);
    sigaddset(&signals, SIGCHLD); /* only to wake follow() up */
    sigprocmask(SIG_BLOCK, &signals, &before);
    fflush(NULL);
    while (w.n < jobs && rc == 0) {
        pid_t pid = fork();
        if (pid == 0) {
            work(c);
            _exit(0);
        }
        if (pid < 0) {
            rc = apc_fail(why, APC_ESYS, "no process for the campaign: %s", strerror(errno));
            atomic_store(&c->board->stop, true);
        } else {
            w.pid[w.n++] = pid;
        }
    }
    struct apc_error died = {""};
    int followed = follow(c, &w, &signals, &died);
    if (rc == 0 && followed < 0)
        *why = died;
    free(w.pid);
    sigprocmask(SIG_SETMASK, &before, NULL);
    return rc < 0 ? rc : followed;
}

/* ---- Together ----------------------------------------------------------------------------- */

static int by_value(const void *a, const void *b)
{
    double x = *(const double *)a, y = *(const double *)b;
    return (x > y) - (x < y);
}

/* Nearest rank. */
static double percentile(const double *sorted, size_t n, double percent)
{
    size_t rank = (size_t)ceil(percent / 100 * (double)n);
    return sorted[rank > 0 ? rank - 1 : 0];
}

/* One line: over all runs that have this figure. @values has room for all of them. */
static void summarize(const struct campaign *c, size_t loop, enum metric metric, double *values,
                      struct print_table *table)
{
    static const double percents[] = {50, 95, 99};
    double mean = 0, squares = 0, worst = -HUGE_VAL;
    uint64_t worst_seed = 0;
    size_t n = 0;

    for (unsigned run = 0; run < c->options->runs; run++) {
        double value = figures_of(c, run)[loop * METRICS + metric];
        if (!result_of(c, run)->made || result_of(c, run)->rc < 0 || isnan(value))
            continue;
        double apart = value - mean;
        values[n++] = value;
        mean += apart / (double)n;
        squares += apart * (value - mean);
        if (value > worst) {
            worst = value;
            worst_seed = c->options->seed + run;
        }
    }
    print_cell(table, PRINT_PLAIN, "%s", c->e->y[loop].tag.name);
    print_cell(table, PRINT_PLAIN, "%s", metric_name(metric));
    print_cell(table, PRINT_PLAIN, "%zu", n);
    if (n == 0) {
        for (int i = 0; i < 7; i++)
            print_cell(table, PRINT_PLAIN, "-");
        return;
    }
    qsort(values, n, sizeof *values, by_value);
    print_cell(table, PRINT_PLAIN, "%.5g", mean);
    print_cell(table, PRINT_PLAIN, "%.3g", n > 1 ? sqrt(squares / (double)(n - 1)) : 0.0);
    for (size_t i = 0; i < sizeof percents / sizeof *percents; i++)
        print_cell(table, PRINT_PLAIN, "%.5g", percentile(values, n, percents[i]));
    print_cell(table, PRINT_PLAIN, "%.5g", worst);
    print_cell(table, PRINT_PLAIN, "%llu", (unsigned long long)worst_seed);
}

static int print_summary(const struct campaign *c)
{
    static const struct print_column columns[] = {
        {"loop", PRINT_LEFT},   {"", PRINT_LEFT},         {"runs", PRINT_RIGHT}, {"mean", PRINT_POINT},
        {"sd", PRINT_POINT},    {"median", PRINT_POINT},  {"95 %", PRINT_POINT}, {"99 %", PRINT_POINT},
        {"worst", PRINT_POINT}, {"its seed", PRINT_RIGHT}};
    double *values = calloc(c->options->runs, sizeof *values);
    struct print_table table;
    if (!values)
        return APC_ENOMEM;
    print_table_open(&table, columns, sizeof columns / sizeof *columns);
    for (size_t loop = 0; loop < c->loops; loop++)
        for (int metric = 0; metric < METRICS; metric++)
            summarize(c, loop, (enum metric)metric, values, &table);
    int rc = print_table_show(&table, c->options->talk, false, 0, "\n");
    print_table_close(&table);
    free(values);
    return rc;
}

/* What a single run tells of its controller. */
static void print_controller(const struct campaign *c)
{
    unsigned held = 0, failed = 0, made = 0;
    for (unsigned run = 0; run < c->options->runs; run++) {
        const struct result *r = result_of(c, run);
        made += r->made;
        held += r->held > 0;
        failed += r->failures > 0;
    }
    if (held > 0)
        fprintf(c->options->talk, "controller: output held or at its fault value in %u of %u runs\n", held,
                made);
    if (failed > 0)
        fprintf(c->options->talk, "controller: law %s gave no finite number in %u of %u runs\n",
                c->e->controller.law->name, failed, made);
}

/* Tell of the runs that failed. Returns the first one's error; also when runs are missing that nobody
 * stopped. */
static int print_failures(const struct campaign *c, struct apc_error *why)
{
    unsigned failed = 0, missing = 0;
    int first = 0;
    for (unsigned run = 0; run < c->options->runs; run++) {
        const struct result *r = result_of(c, run);
        missing += !r->made;
        if (!r->made || r->rc == 0)
            continue;
        if (failed++ < FAILURES)
            fprintf(c->options->talk, "seed %llu: %s\n", (unsigned long long)(c->options->seed + run),
                    r->why);
        if (first == 0)
            first = r->rc;
    }
    if (missing > 0)
        fprintf(c->options->talk, "%u of %u runs were not made\n", missing, c->options->runs);
    if (failed > 0)
        return apc_fail(why, first, "%u of %u runs ended early", failed, c->options->runs);
    return missing > 0 && !atomic_load(&c->board->stop)
               ? apc_fail(why, APC_ESYS, "a process of the campaign ended: runs are missing")
               : 0;
}

static int write_csv(const struct campaign *c, struct apc_error *why)
{
    const char *path = c->options->csv;
    FILE *out = !strcmp(path, "-") ? stdout : fopen(path, "w");
    if (!out)
        return apc_fail(why, APC_ESYS, "%s: cannot be written: %s", path, strerror(errno));
    fputs("seed,loop,iae,ise,itae,overshoot_percent,settling_s,effort\n", out);
    for (unsigned run = 0; run < c->options->runs; run++)
        for (size_t loop = 0; loop < c->loops && result_of(c, run)->made; loop++) {
            fprintf(out, "%llu,%zu", (unsigned long long)(c->options->seed + run), loop + 1);
            for (int i = 0; i < METRICS; i++) {
                char value[40] = "";
                double figure = figures_of(c, run)[loop * METRICS + (size_t)i];
                if (!isnan(figure))
                    apc_number_format(figure, value, sizeof value);
                fprintf(out, ",%s", value);
            }
            fputc('\n', out);
        }
    bool failed = ferror(out) != 0;
    failed |= out == stdout ? fflush(out) != 0 : fclose(out) != 0;
    return failed ? apc_fail(why, APC_ESYS, "%s: cannot be written: %s", path, strerror(errno)) : 0;
}

static void keep_first(int *rc, struct apc_error *why, int next, const struct apc_error *its)
{
    if (*rc < 0 || next >= 0)
        return;
    *rc = next;
    *why = *its;
}

int campaign_run(const struct experiment *e, const struct campaign_options *options, struct apc_error *why)
{
    struct campaign c = {.e = e, .options = options, .loops = metrics_loops(e)};
    c.stride = sizeof(struct result) + c.loops * METRICS * sizeof(double);
    c.stride = (c.stride + LINE - 1) / LINE * LINE;
    c.size = LINE + options->runs * c.stride;
    void *memory = mmap(NULL, c.size, PROT_READ | PROT_WRITE, MAP_SHARED | MAP_ANONYMOUS, -1, 0);
    if (memory == MAP_FAILED)
        return apc_fail(why, APC_ENOMEM, "no memory for %u runs", options->runs);
    c.board = memory;
    apc_ns began = apc_clock_mono(NULL);
    int rc = run_all(&c, why);
    double took = apc_ns_to_s(apc_clock_mono(NULL) - began);
    unsigned done = atomic_load(&c.board->done);
    fprintf(options->talk, "%s: %s\n%u runs of %.10g s in %.3g s: %.3g times as fast as real time\n", e->name,
            e->title, done, e->duration, took, done * e->duration / took);
    /* All of it, also when something failed: the runs that were made are worth something. */
    struct apc_error next = {""};
    int shown = print_summary(&c);
    if (shown < 0)
        apc_fail(&next, shown, "out of memory");
    keep_first(&rc, why, shown, &next);
    print_controller(&c);
    if (options->csv)
        keep_first(&rc, why, write_csv(&c, &next), &next);
    keep_first(&rc, why, print_failures(&c, &next), &next);
    munmap(memory, c.size);
    return rc;
}

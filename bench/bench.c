/* SPDX-License-Identifier: BSD-3-Clause */
#include "bench.h"

#include <argp.h>
#include <errno.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>
#include <sys/utsname.h>
#include <unistd.h>

#define ROUNDS_MIN 8 /* fewer give no median to speak of */
#define ROUNDS     12
#define ROUNDS_MAX 1000

_Noreturn void die(const char *fmt, ...)
{
    char text[1024];
    va_list args;

    va_start(args, fmt);
    vsnprintf(text, sizeof text, fmt, args);
    va_end(args);
    text[strcspn(text, "\n")] = '\0'; /* libpq's end with one, after hints */
    fprintf(stderr, "%s: %s\n", program_invocation_short_name, text);
    exit(1);
}

void *allocate(size_t n, size_t size)
{
    void *p = calloc(n > 0 ? n : 1, size); /* for none it could be NULL without having failed */

    if (!p)
        die("out of memory");
    return p;
}

/* ---- Command line -------------------------------------------------------------------------- */

static const struct argp_option option_list[] = {
    {"json", 'j', "FILE", 0, "Write the results to FILE as well", 0},
    {"rounds", 'r', "N", 0, "Rounds to take medians of; 8 to 1000, default 12", 0},
    {0},
};

static error_t parse(int key, char *arg, struct argp_state *state)
{
    struct bench *b = state->input;
    double rounds;

    switch (key) {
    case 'j':
        b->json = fopen(arg, "w");
        if (!b->json)
            argp_failure(state, 1, errno, "%s", arg);
        return 0;
    case 'r':
        if (apc_number_parse(arg, &rounds) < 0 || rounds < ROUNDS_MIN || rounds > ROUNDS_MAX ||
            rounds != floor(rounds))
            argp_error(state, "--rounds is \"%s\": expected %d to %d", arg, ROUNDS_MIN, ROUNDS_MAX);
        b->rounds = (size_t)rounds;
        return 0;
    default:
        return ARGP_ERR_UNKNOWN;
    }
}

void bench_begin(struct bench *b, int argc, char **argv, const char *doc)
{
    const struct argp argp = {option_list, parse, NULL, doc, NULL, NULL, NULL};

    b->rounds = ROUNDS;
    b->json = NULL;
    b->any = false;
    argp_err_exit_status = 2;
    argp_parse(&argp, argc, argv, 0, NULL, b);
}

/* ---- Where it runs ------------------------------------------------------------------------- */

static void find_cpu(char *name, size_t size)
{
    char line[256];
    FILE *f = fopen("/proc/cpuinfo", "re");

    snprintf(name, size, "unknown CPU");
    while (f && fgets(line, sizeof line, f)) {
        const char *colon = strchr(line, ':');
        if (strncmp(line, "model name", 10) == 0 && colon) {
            snprintf(name, size, "%s", colon + 2);
            name[strcspn(name, "\n")] = '\0';
            break;
        }
    }
    if (f)
        fclose(f);
}

static void put_text(FILE *f, const char *key, const char *text)
{
    fprintf(f, "\"%s\": \"", key);
    for (; *text; text++) {
        if (*text == '"' || *text == '\\')
            fputc('\\', f);
        if ((unsigned char)*text >= ' ')
            fputc(*text, f);
    }
    fputc('"', f);
}

void bench_describe(struct bench *b, const char *server)
{
    char cpu[128], now[APC_TIME_LEN];
    struct utsname system;
    long cores = sysconf(_SC_NPROCESSORS_ONLN);
    double load[1] = {0};

    uname(&system);
    find_cpu(cpu, sizeof cpu);
    (void)getloadavg(load, 1);
    apc_time_format(apc_clock_utc(NULL), now);
    printf("%s %s on %s, %s %s, %s, %ld cores, load %.1f\n", b->name, now, system.nodename, system.sysname,
           system.release, cpu, cores, load[0]);
    if (server)
        printf("%s\n", server);
    if (!b->json)
        return;
    fputc('{', b->json);
    put_text(b->json, "bench", b->name);
    fputs(", ", b->json);
    put_text(b->json, "time", now);
    fputs(",\n ", b->json);
    put_text(b->json, "host", system.nodename);
    fputs(", ", b->json);
    put_text(b->json, "kernel", system.release);
    fputs(", ", b->json);
    put_text(b->json, "cpu", cpu);
    fputs(", ", b->json);
    put_text(b->json, "server", server ? server : "");
    fprintf(b->json, ",\n \"cores\": %ld, \"load\": %.2f, \"rounds\": %zu,\n \"results\": [", cores, load[0],
            b->rounds);
}

/* ---- Statistics ---------------------------------------------------------------------------- */

static int compare(const void *a, const void *b)
{
    const double x = *(const double *)a, y = *(const double *)b;
    return (x > y) - (x < y);
}

/* By nearest rank. Sorts @p values. */
static double percentile(double *values, size_t n, double p)
{
    qsort(values, n, sizeof *values, compare);
    size_t rank = (size_t)ceil(p / 100 * (double)n);
    return values[rank > 0 ? rank - 1 : 0];
}

/* Of the rounds' ratios: what disturbed one round disturbed both in it. */
static double ratio(const struct bench_row *row, const struct bench_row *to, size_t rounds)
{
    double *each = allocate(rounds, sizeof *each);

    for (size_t i = 0; i < rounds; i++)
        each[i] = row->median[i] / to->median[i];
    double median = percentile(each, rounds, 50);
    free(each);
    return median;
}

/* ---- Measuring ----------------------------------------------------------------------------- */

static void run_round(const struct bench *b, struct bench_row *row, double *median)
{
    double *first = row->us + row->count;
    const apc_ns end = apc_clock_mono(NULL) + b->budget;
    size_t n = 0;
    apc_ns to;

    do {
        const apc_ns from = apc_clock_mono(NULL);
        row->once(row->ctx);
        to = apc_clock_mono(NULL);
        first[n++] = (double)(to - from) / 1e3;
    } while (n < b->calls && to < end);
    *median = percentile(first, n, 50);
    row->count += n;
}

static void print_row(const struct bench *b, const struct bench_row *row, double p50, double p99)
{
    printf("  %-34s %6zu %10.1f ", row->name, row->count, p50);
    if (row->count >= 100)
        printf("%10.1f", p99);
    else
        printf("%10s", "-");
    for (size_t i = 0; i < BENCH_REFERENCES && b->reference[i]; i++) {
        double r = row->to[i] ? ratio(row, row->to[i], b->rounds) : 0.0;
        if (row->to[i])
            printf(" %10.*f", r < 0.1 ? 4 : 2, r);
        else
            printf(" %10s", "");
    }
    putchar('\n');
}

static void write_row(const struct bench *b, const struct bench_row *row, double p50, double p99)
{
    fputs("\n   {", b->json);
    put_text(b->json, "name", row->name);
    fprintf(b->json, ", \"calls\": %zu, \"p50_us\": %.2f, \"p99_us\": ", row->count, p50);
    if (row->count >= 100)
        fprintf(b->json, "%.2f", p99);
    else
        fputs("null", b->json);
    for (size_t i = 0; i < BENCH_REFERENCES && b->reference[i]; i++) {
        if (row->to[i])
            fprintf(b->json, ", \"to %s\": %.4f", b->reference[i], ratio(row, row->to[i], b->rounds));
    }
    fputc('}', b->json);
}

static void report(struct bench *b, const char *title, size_t n, struct bench_row *rows, size_t n_rows)
{
    printf("\n%-36s %6s %10s %10s", title, "calls", "p50 us", "p99 us");
    for (size_t i = 0; i < BENCH_REFERENCES && b->reference[i]; i++)
        printf(" %*s%s", (int)(8 - strlen(b->reference[i])), "/ ", b->reference[i]);
    putchar('\n');
    if (b->json) {
        fprintf(b->json, "%s\n  {\"n\": %zu, ", b->any ? "," : "", n);
        put_text(b->json, "title", title);
        fputs(", \"rows\": [", b->json);
    }
    b->any = true;
    for (size_t i = 0; i < n_rows; i++) {
        struct bench_row *row = &rows[i];
        double *medians = allocate(b->rounds, sizeof *medians);

        memcpy(medians, row->median, b->rounds * sizeof *medians);
        double p50 = percentile(medians, b->rounds, 50), p99 = percentile(row->us, row->count, 99);
        free(medians);
        print_row(b, row, p50, p99);
        if (b->json && i > 0)
            fputc(',', b->json);
        if (b->json)
            write_row(b, row, p50, p99);
    }
    if (b->json)
        fputs("]}", b->json);
    fflush(stdout);
}

void bench_run(struct bench *b, const char *title, size_t n, struct bench_row *rows, size_t n_rows)
{
    double warm_up;

    for (size_t i = 0; i < n_rows; i++) {
        rows[i].us = allocate(b->rounds * b->calls, sizeof(double));
        rows[i].median = allocate(b->rounds, sizeof(double));
        rows[i].count = 0;
        run_round(b, &rows[i], &warm_up);
        rows[i].count = 0;
    }
    for (size_t round = 0; round < b->rounds; round++)
        for (size_t i = 0; i < n_rows; i++)
            run_round(b, &rows[i], &rows[i].median[round]);
    report(b, title, n, rows, n_rows);
    for (size_t i = 0; i < n_rows; i++) {
        free(rows[i].us);
        free(rows[i].median);
    }
}

void bench_end(struct bench *b)
{
    if (!b->json)
        return;
    fputs("]}\n", b->json);
    if (ferror(b->json) | fclose(b->json))
        die("the JSON file could not be written whole");
}

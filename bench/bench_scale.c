/* SPDX-License-Identifier: BSD-3-Clause */
/*
 * bench/scale: what old weeks take and how soon they are found, in PostgreSQL. A week of a signal each of
 * noise, of a 16-bit converter and of a constant goes in by a COPY written by hand, is packed, and is asked
 * for before and after, while another session commits. Then SIGNALS of noise over a year, as chunks, and the
 * trends of that.
 *
 * bench_scale SIGNALS
 */
#include <inttypes.h>
#include <math.h>
#include <pthread.h>
#include <stdatomic.h>
#include <stdbool.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

#include <libpq-fe.h>

#include "../tests/support/xorshift.h"
#include "apcstore.h"
#include "bench.h"
#include "pgbinary.h"
#include "shareddata/pack.h"

#define SECONDS INT64_C(604800)
#define US      INT64_C(1000000)
#define YEAR    INT64_C(31536000)
#define MONTH   INT64_C(2592000)
#define TRENDS  5

static PGconn *by_hand;
static struct apc_store *store;

static double now(void)
{
    return (double)apc_clock_mono(NULL) / 1e9;
}

static int64_t ask(const char *sql)
{
    PGresult *r = PQexec(by_hand, sql);
    const ExecStatusType status = PQresultStatus(r);
    if (status != PGRES_COMMAND_OK && status != PGRES_TUPLES_OK)
        die("%s: %s", sql, PQerrorMessage(by_hand));
    const int64_t value = PQntuples(r) > 0 ? strtoll(PQgetvalue(r, 0, 0), NULL, 10) : 0;
    PQclear(r);
    return value;
}

static uint64_t seed = 88172645463325252U;

/* ---- A week ------------------------------------------------------------------------------------------ */

static double of_noise(int64_t i)
{
    (void)i;
    return (1 + (double)(xorshift(&seed) >> 11) * 0x1p-53) *
           (xorshift(&seed) & 1 ? 1 : -1); /* every bit of the mantissa */
}

static double of_converter(int64_t i)
{
    const double t = (double)i;
    return -10 +
           (double)(int64_t)(32768 + 20000 * sin(t * 0.001) + (double)(xorshift(&seed) % 5)) * (20 / 65535.0);
}

static double of_constant(int64_t i)
{
    (void)i;
    return 20.3;
}

static const struct kind {
    const char *what, *table;
    double (*value)(int64_t i);
    int64_t jitter; /* us */
    double goal;
} kinds[] = {{"noise, clock with jitter", "sensor", of_noise, 256, 12},
             {"16-bit converter, jitter", "actuator", of_converter, 256, 4},
             {"constant, on the grid", "estimate", of_constant, 1, 1}};

static char *put(char *at, const void *from, size_t length)
{
    memcpy(at, from, length);
    return at + length;
}

static char *put_cell(char *at, int64_t value, size_t length)
{
    const uint32_t head = htobe32((uint32_t)length), small = htobe32((uint32_t)value);
    const uint64_t large = htobe64((uint64_t)value);
    at = put(at, &head, 4);
    return length == 4 ? put(at, &small, 4) : put(at, &large, 8);
}

static const char header[19] = "PGCOPY\n\377\r\n\0\0\0\0\0\0\0\0";

static void copy_begin(const char *sql)
{
    PGresult *r = PQexec(by_hand, sql);
    if (PQresultStatus(r) != PGRES_COPY_IN || PQputCopyData(by_hand, header, 19) != 1)
        die("%s: %s", sql, PQerrorMessage(by_hand));
    PQclear(r);
}

static void copy_end(void)
{
    if (PQputCopyData(by_hand, "\377\377", 2) != 1 || PQputCopyEnd(by_hand, NULL) != 1)
        die("COPY: %s", PQerrorMessage(by_hand));
    PGresult *r = PQgetResult(by_hand);
    if (PQresultStatus(r) != PGRES_COMMAND_OK)
        die("COPY: %s", PQerrorMessage(by_hand));
    PQclear(r);
    while ((r = PQgetResult(by_hand)))
        PQclear(r);
}

/* 10 000 rows a COPY, each a transaction. Returns the seconds. */
static double copy_week(const struct kind *k, int64_t begin)
{
    enum { ROWS = 10000, BYTES = 2 + 12 + 8 + 4 * 12 };
    static char rows[ROWS * BYTES];
    char sql[200];
    double spent = 0;
    snprintf(sql, sizeof sql, "COPY %s (id, seq, time, status, value) FROM STDIN (FORMAT binary)", k->table);
    for (int64_t i = 0; i < SECONDS;) {
        char *at = rows;
        for (int n = 0; n < ROWS && i < SECONDS; n++, i++) {
            const uint16_t columns = htobe16(5);
            at = put(at, &columns, 2);
            at = put_cell(at, 1, 4);
            at = put_cell(at, i + 1, 8);
            at = put_cell(at, begin + i * US + (int64_t)(xorshift(&seed) % (uint64_t)k->jitter), 8);
            at = put_cell(at, 0, 8);
            at = put_cell(at, bits(k->value(i)), 8);
        }
        const double from = now();
        copy_begin(sql);
        if (PQputCopyData(by_hand, rows, (int)(at - rows)) != 1)
            die("COPY: %s", PQerrorMessage(by_hand));
        copy_end();
        spent += now() - from;
    }
    return spent;
}

/* ---- Commits meanwhile ------------------------------------------------------------------------------- */

#define COMMITS 200000

static struct {
    pthread_t thread;
    atomic_bool stop;
    size_t n;
    double us[COMMITS];
} commits;

static struct apc_store *open_store(void)
{
    const struct apc_store_options options = {
        .size = sizeof options, .name = "bench", .timeout = 600 * APC_NS_PER_S};
    struct apc_error why;
    struct apc_store *opened;
    if (apc_store_open(&opened, "postgresql:", &options, &why) < 0)
        die("%s", why.text);
    return opened;
}

/* A controller's ten outputs, every 10 ms. */
static void *commit(void *arg)
{
    struct apc_store *own = open_store();
    struct apc_sample s[10];
    (void)arg;
    for (int64_t seq = 1; !commits.stop && commits.n < COMMITS; seq++) {
        for (int i = 0; i < 10; i++)
            s[i] = (struct apc_sample){.table = APC_ACTUAL,
                                       .id = 100 + i,
                                       .seq = SECONDS + apc_clock_mono(NULL) + seq,
                                       .time = apc_clock_utc(NULL)};
        const double from = now();
        if (apc_store_append(own, s, 10) < 0)
            die("%s", apc_store_error(own));
        commits.us[commits.n++] = (now() - from) * 1e6;
        nanosleep(&(struct timespec){0, 10000000}, NULL);
    }
    apc_store_close(own);
    return NULL;
}

static void commits_begin(void)
{
    commits.stop = false;
    commits.n = 0;
    if (pthread_create(&commits.thread, NULL, commit, NULL) != 0)
        die("no thread");
}

static int compare(const void *a, const void *b)
{
    const double x = *(const double *)a, y = *(const double *)b;
    return (x > y) - (x < y);
}

static double commits_p99(void)
{
    commits.stop = true;
    pthread_join(commits.thread, NULL);
    qsort(commits.us, commits.n, sizeof *commits.us, compare);
    return commits.n ? commits.us[(commits.n - 1) * 99 / 100] : 0;
}

/* ---- Packing it -------------------------------------------------------------------------------------- */

static int64_t total(const char *table, const char *suffix)
{
    char sql[200];
    snprintf(sql, sizeof sql, "SELECT pg_total_relation_size(to_regclass('%s%s'))", table, suffix);
    return ask(sql);
}

static int digest(void *ctx, const struct apc_sample *s)
{
    uint64_t *d = ctx, value;
    memcpy(&value, &s->value, 8);
    *d = (*d ^ (uint64_t)s->seq ^ (uint64_t)s->time ^ s->status ^ value) * UINT64_C(1099511628211);
    return 0;
}

static uint64_t digest_of(enum apc_table table)
{
    uint64_t d = 0;
    if (apc_store_history(store, table, 1, &(struct apc_range){0}, digest, &d) != SECONDS)
        die("a week has not all its samples: %s", apc_store_error(store));
    return d;
}

/* What has gone to the server's journal, which backups and standbys get. */
static double journal(void)
{
    return (double)ask("SELECT pg_wal_lsn_diff(pg_current_wal_insert_lsn(), '0/0')::bigint");
}

static void week(void)
{
    const int64_t begin = ask("SELECT (extract(epoch FROM date_trunc('week', now()) - interval '3 weeks')"
                              " - 946684800)::bigint * 1000000");
    char suffix[20];
    snprintf(suffix, sizeof suffix, "_%" PRId64,
             ask("SELECT to_char(date_trunc('week', now()) - interval '3 weeks', 'YYYYMMDD')"));
    ask("SELECT make_week(t, (date_trunc('week', now()) - interval '3 weeks')::date, current_date)"
        " FROM unnest(ARRAY['sensor', 'actuator', 'estimate']) AS t");
    static const enum apc_table tables[] = {APC_SENSOR, APC_ACTUATOR, APC_ESTIMATE};
    int64_t before[3], after[3], had[3];
    uint64_t sums[3];
    double copied = 0, written = journal();
    for (int k = 0; k < 3; k++) {
        had[k] = total(kinds[k].table, "_packed");
        copied += copy_week(&kinds[k], begin);
        sums[k] = digest_of(tables[k]);
    }
    written = journal() - written;
    ask("CHECKPOINT");
    for (int k = 0; k < 3; k++)
        before[k] = total(kinds[k].table, suffix);
    commits_begin();
    nanosleep(&(struct timespec){15, 0}, NULL);
    const double quiet = commits_p99();
    commits_begin();
    const double from = now(), rewritten = journal();
    const struct apc_retention keep = {.size = sizeof keep, .packed = 1};
    if (apc_store_maintain(store, &keep) < 3)
        die("not packed: %s", apc_store_error(store));
    const double packed = now() - from, busy = commits_p99();
    printf("\nA week of a signal at 1 Hz, 604 800 samples, indexes counted:\n\n| signal | bytes a sample, "
           "rows | packed | goal | same bits |\n"
           "|---|---|---|---|---|\n");
    for (int k = 0; k < 3; k++) {
        after[k] = total(kinds[k].table, "_packed") - had[k];
        printf("| %s | %.1f | %.2f | %.0f | %s |\n", kinds[k].what, (double)before[k] / (double)SECONDS,
               (double)after[k] / (double)SECONDS, kinds[k].goal,
               digest_of(tables[k]) == sums[k] ? "yes" : "NO");
    }
    const double rows = 3.0 * (double)SECONDS;
    printf("\nCOPY %.0f samples/s, packing %.0f samples/s: %.2f x (goal 0.5)\n", rows / copied, rows / packed,
           copied / packed);
    printf("journal: %.0f bytes a sample by COPY, %.1f more by packing\n", written / rows,
           (journal() - rewritten) / rows);
    printf("commit of 10, p99: quiet %.0f us, while packing %.0f us: %.2f x (goal 1.5)\n", quiet, busy,
           busy / quiet);
    const double view = now();
    ask("SELECT count(value) FROM (SELECT value FROM sensor_all WHERE id = 1 LIMIT 50000) AS v");
    printf("view sensor_all: %.0f samples/s\n", 50000 / (now() - view));
}

/* ---- A year ------------------------------------------------------------------------------------------ */

/* Chunks differ in their times, which stand in the first column's start and slope; their values come again
 * every 64. */
enum { KEPT = 64, START = 4 };
static struct {
    uint8_t bytes[APC_PACK_BYTES];
    size_t length;
    struct apc_pack_summary summary;
} kept[KEPT];

static void make_kept(void)
{
    static struct apc_pack chunk;
    for (int k = 0; k < KEPT; k++) {
        memset(&chunk, 0, sizeof chunk);
        chunk.n = APC_PACK_MAX;
        for (int64_t i = 0; i < APC_PACK_MAX; i++) {
            chunk.at[APC_PACK_TIME][i] = i * US + (i > 0 ? (int64_t)(xorshift(&seed) % 256) : 0);
            chunk.at[APC_PACK_VALUE][i] = apc_pack_bits(of_noise(i));
        }
        kept[k].length = apc_pack(&chunk, kept[k].bytes);
        if (kept[k].length == 0 || kept[k].bytes[3] < 3)
            die("a chunk is not as the benchmark needs it");
        apc_pack_summarize(&chunk, &kept[k].summary);
    }
}

static char *put_chunk(char *at, int32_t id, int64_t c, int64_t begin)
{
    const int k = (int)(c % KEPT);
    const struct apc_pack_summary *s = &kept[k].summary;
    const int64_t start = begin + c * APC_PACK_MAX * US, first = 1 + c * APC_PACK_MAX;
    const uint16_t columns = htobe16(13);
    const uint32_t length = htobe32((uint32_t)kept[k].length);
    const uint64_t big = htobe64((uint64_t)start);
    at = put(at, &columns, 2);
    const int64_t cells[10] = {first,
                               first + APC_PACK_MAX - 1,
                               start,
                               start + s->until,
                               first + APC_PACK_MAX - 1,
                               0,
                               bits(s->lowest),
                               bits(s->highest),
                               bits(s->mean),
                               bits(s->last)};
    for (int i = 0; i < 10; i++)
        at = put_cell(at, cells[i], 8);
    at = put_cell(at, id, 4);
    at = put_cell(at, s->good, 4);
    at = put(at, &length, 4);
    at = put(at, kept[k].bytes, kept[k].length);
    memcpy(at - kept[k].length + START, &big, 8);
    return at;
}

static void fill_year(int signals, int64_t begin)
{
    static char row[APC_PACK_BYTES + 200];
    make_kept();
    for (int32_t id = 1001; id <= 1000 + signals; id++) {
        copy_begin("COPY sensor_packed FROM STDIN (FORMAT binary)");
        for (int64_t c = 0; c < YEAR / APC_PACK_MAX; c++)
            if (PQputCopyData(by_hand, row, (int)(put_chunk(row, id, c, begin) - row)) != 1)
                die("COPY: %s", PQerrorMessage(by_hand));
        copy_end();
    }
    ask("VACUUM ANALYZE sensor_packed");
}

static int count_bin(void *ctx, const struct apc_history_bin *bin)
{
    *(uint64_t *)ctx += bin->count;
    return 0;
}

/* The median of some, ms; and of this process alone, its processor's. */
static double trend(int signals, apc_ns since, apc_ns until, uint64_t *samples, double *own)
{
    double ms[TRENDS];
    const clock_t began = clock();
    for (int t = 0; t < TRENDS; t++) {
        const double from = now();
        *samples = 0;
        for (int id = 1001; id <= 1000 + signals; id++)
            if (apc_store_history_bins(store, APC_SENSOR, id, since, until, 1000, count_bin, samples) < 0)
                die("%s", apc_store_error(store));
        ms[t] = (now() - from) * 1e3;
    }
    *own = (double)(clock() - began) * 1e3 / CLOCKS_PER_SEC / TRENDS;
    qsort(ms, TRENDS, sizeof *ms, compare);
    return ms[TRENDS / 2];
}

static double newest_of_1000(void)
{
    static struct apc_sample s[1000];
    double ms[100];
    for (int i = 0; i < 1000; i++)
        s[i] =
            (struct apc_sample){.table = APC_SENSOR, .id = 2001 + i, .seq = 1, .time = apc_clock_utc(NULL)};
    if (apc_store_append(store, s, 1000) < 0)
        die("%s", apc_store_error(store));
    for (int t = 0; t < 100; t++) {
        const double from = now();
        if (apc_store_read(store, s, 1000) < 0)
            die("%s", apc_store_error(store));
        ms[t] = (now() - from) * 1e3;
    }
    qsort(ms, 100, sizeof *ms, compare);
    return ms[50];
}

static void year(int signals)
{
    const int64_t begin = ask("SELECT (extract(epoch FROM date_trunc('week', now()) - interval '60 weeks')"
                              " - 946684800)::bigint * 1000000"),
                  had = total("sensor", "_packed");
    const double from = now();
    fill_year(signals, begin);
    const double n = (double)signals * (double)(YEAR / APC_PACK_MAX * APC_PACK_MAX), filled = now() - from;
    const int64_t bytes = total("sensor", "_packed") - had;
    const apc_ns since = (begin + PG_EPOCH_US) * 1000;
    uint64_t one, twelve;
    double of_one, of_all;
    const double month = trend(1, since + 100 * 86400 * APC_NS_PER_S,
                               since + (100 * 86400 + MONTH) * APC_NS_PER_S, &one, &of_one);
    const double all =
        trend(signals < 12 ? signals : 12, since, since + YEAR * APC_NS_PER_S, &twelve, &of_all);
    printf("\n%d signals of noise over a year at 1 Hz: %.3g samples, %.2f bytes each, %.1f GB; chunks came "
           "in at %.2g samples/s\n\n",
           signals, n, (double)bytes / n, (double)bytes / 1e9, n / filled);
    printf("| asked for | median | of it this process | goal |\n|---|---|---|---|\n"
           "| 30 days of one signal, 1000 bins (%" PRIu64 " samples) | %.0f ms | %.0f ms | 300 ms |\n"
           "| a year of %d signals, 1000 bins (%" PRIu64 " samples) | %.0f ms | %.0f ms | 1000 ms |\n"
           "| newest of 1000 | %.2f ms | | 2 ms |\n",
           one, month, of_one, signals < 12 ? signals : 12, twelve, all, of_all, newest_of_1000());
}

int main(int argc, char **argv)
{
    char *end = NULL;
    const int signals = argc > 1 ? (int)strtol(argv[1], &end, 10) : 12;
    if (signals < 1 || signals > 900 || (end && *end))
        die("usage: bench_scale SIGNALS (1 to 900)");
    setvbuf(stdout, NULL, _IOLBF, 0);
    by_hand = PQconnectdb("");
    store = open_store();
    if (PQstatus(by_hand) != CONNECTION_OK || apc_store_init(store) < 0)
        die("%s%s", PQerrorMessage(by_hand), apc_store_error(store));
    ask("SET search_path TO apc");
    week();
    year(signals);
    apc_store_close(store);
    PQfinish(by_hand);
    return 0;
}

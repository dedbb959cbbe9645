/* SPDX-License-Identifier: BSD-3-Clause */
/*
 * samples.columns: a head, and blocks of BLOCK rows, the last one of what is left. All numbers are as this
 * machine has them; one that has them otherwise does not know the mark again.
 *
 *   head    mark, rows, variables, codes, size of samples.csv, its checksum, inode and time of change; of
 *           each variable table and id in int32; of each code uint32; checksum of all that
 *   block   time in double [rows], value in double [rows], variable in uint16 [rows], status in int8 [rows],
 *           checksum of these
 *
 * The checksum of samples.csv is that of the checksums of its segments, so that threads share the work.
 * Nothing is taken from a file of which a single one does not hold.
 */
#include "samples_columns.h"

#include <errno.h>
#include <fcntl.h>
#include <math.h>
#include <pthread.h>
#include <sched.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <sys/uio.h>
#include <time.h>
#include <unistd.h>

#define XXH_INLINE_ALL /* as fast as this processor's vectors, and no library to be had at run time */
#include <xxhash.h>

#include "files/files.h"

enum { BLOCK = 1 << 14, SEGMENT = 1 << 20, CHUNK = 1 << 18, PART = 4 << 20 /* bytes, at least */ };
enum { TICK = 100000000 /* ns, within which two changes of a file may have the same time */ };
enum { ROW = 2 * sizeof(double) + sizeof(uint16_t) + sizeof(int8_t), VARIABLES = 1 << 16 };

static const char mark[8] = "apcrows2";

struct head {
    char mark[8];
    uint64_t rows, variables, codes, csv_size, csv_sum;
    uint64_t csv_inode, csv_changed; /* changed: ns of Unix time, which nobody can set; 0: just then */
};

/* XXH3, of one piece after the other: each begins with the sum of those before. */
static uint64_t sum_of(const void *data, size_t n, uint64_t before)
{
    return XXH3_64bits_withSeed(data, n, before);
}

/* ---- Parts of the work, a thread each -------------------------------------------------------- */

struct part {
    struct apc_samples *rows;
    int csv, columns;            /* columns: -1: of the CSV file alone */
    off_t csv_size, at;          /* at: of the first block */
    uint64_t *segment;           /* [segments] their checksums */
    size_t segments, number, of; /* number: of this part */
    pthread_t thread;
    bool holds;
};

static bool read_columns_at(int fd, void *to, size_t n, off_t at)
{
    char *p = to;
    ssize_t got;

    for (; n > 0 && (got = pread(fd, p, n, at)) > 0; p += got, at += got)
        n -= (size_t)got;
    return n == 0;
}

/* Of a segment in chunks, which stay in the processor's cache. */
static bool sum_segment(const struct part *t, size_t i, char *chunk)
{
    const off_t end = (off_t)(i + 1) * SEGMENT < t->csv_size ? (off_t)(i + 1) * SEGMENT : t->csv_size;

    t->segment[i] = 0;
    for (off_t at = (off_t)i * SEGMENT; at < end; at += CHUNK) {
        const size_t n = end - at < CHUNK ? (size_t)(end - at) : CHUNK;

        if (!read_columns_at(t->csv, chunk, n, at))
            return false;
        t->segment[i] = sum_of(chunk, n, t->segment[i]);
    }
    return true;
}

static size_t rows_of_block(const struct apc_samples *r, size_t block)
{
    return r->n - block * BLOCK < BLOCK ? r->n - block * BLOCK : BLOCK;
}

static uint64_t sum_of_block(const struct apc_samples *r, size_t first, size_t n, const uint16_t *variable)
{
    uint64_t sum = sum_of(r->time + first, n * sizeof *r->time, 0);

    sum = sum_of(r->value + first, n * sizeof *r->value, sum);
    sum = sum_of(variable, n * sizeof *variable, sum);
    return sum_of(r->status + first, n * sizeof *r->status, sum);
}

static bool read_column_block(const struct part *t, size_t block, uint16_t *variable)
{
    const struct apc_samples *const r = t->rows;
    const size_t first = block * BLOCK, n = rows_of_block(r, block), size = n * ROW + sizeof(uint64_t);
    uint64_t sum;
    const struct iovec piece[] = {{r->time + first, n * sizeof *r->time},
                                  {r->value + first, n * sizeof *r->value},
                                  {variable, n * sizeof *variable},
                                  {r->status + first, n * sizeof *r->status},
                                  {&sum, sizeof sum}};
    const off_t at = t->at + (off_t)(block * ((size_t)BLOCK * ROW + sizeof sum));
    uint16_t most = 0; /* as narrow as what is compared, for many at once */
    uint8_t code = 0;

    if (preadv(t->columns, piece, sizeof piece / sizeof piece[0], at) != (ssize_t)size ||
        sum != sum_of_block(r, first, n, variable))
        return false;
    for (size_t i = 0; i < n; i++) {
        most = variable[i] > most ? variable[i] : most;
        r->variable[first + i] = variable[i];
    }
    for (size_t i = 0; i < n; i++) {
        const uint8_t one = (uint8_t)r->status[first + i];

        code = one > code ? one : code;
    }
    return most < r->n_variables && code < r->n_codes;
}

static void *read_columns_part(void *ctx)
{
    struct part *const t = ctx;
    const size_t blocks = t->columns < 0 ? 0 : (t->rows->n + BLOCK - 1) / BLOCK;
    char *const chunk = malloc(CHUNK);
    uint16_t *const variable = malloc(BLOCK * sizeof *variable);

    t->holds = chunk && variable;
    for (size_t i = t->number * blocks / t->of; t->holds && i < (t->number + 1) * blocks / t->of; i++)
        t->holds = read_column_block(t, i, variable);
    for (size_t i = t->number * t->segments / t->of; t->holds && i < (t->number + 1) * t->segments / t->of;
         i++)
        t->holds = sum_segment(t, i, chunk);
    free(chunk);
    free(variable);
    return NULL;
}

size_t samples_parts(size_t size)
{
    cpu_set_t set;
    const int cpus = sched_getaffinity(0, sizeof set, &set) == 0 ? CPU_COUNT(&set) : 1;
    size_t parts = size / PART + 1;

    parts = parts > (size_t)cpus ? (size_t)cpus : parts;
    return parts > SAMPLES_PARTS ? SAMPLES_PARTS : parts;
}

/* The blocks into the rows, unless @p columns is -1, and the checksum of the CSV file, unless @p csv is -1. */
static bool read_columns_parts(struct apc_samples *rows, int csv, off_t csv_size, int columns, off_t at,
                               uint64_t *csv_sum)
{
    const size_t parts = samples_parts((size_t)csv_size),
                 segments = csv < 0 ? 0 : (size_t)(csv_size / SEGMENT) + 1;
    uint64_t *const segment = calloc(segments + 1, sizeof *segment);
    struct part part[SAMPLES_PARTS];
    bool started[SAMPLES_PARTS] = {false}, hold = segment != NULL;

    for (size_t i = 0; hold && i < parts; i++) {
        part[i] =
            (struct part){rows, csv, columns, csv_size, at, segment, segments, i, parts, .holds = false};
        started[i] = i > 0 && pthread_create(&part[i].thread, NULL, read_columns_part, &part[i]) == 0;
    }
    for (size_t i = 0; segment && i < parts; i++) {
        if (!started[i])
            read_columns_part(&part[i]);
        else
            pthread_join(part[i].thread, NULL);
        hold &= part[i].holds;
    }
    if (hold)
        *csv_sum = sum_of(segment, segments * sizeof *segment, 0);
    free(segment);
    return hold;
}

/* ---- Reading --------------------------------------------------------------------------------- */

/* The head, as long as it fits a file of that size. */
static bool take_head(int fd, off_t size, struct apc_samples *r, struct head *head, off_t *at)
{
    uint64_t sum;

    if (!read_columns_at(fd, head, sizeof *head, 0) || memcmp(head->mark, mark, sizeof mark) != 0 ||
        head->variables > VARIABLES || head->codes > sizeof r->code / sizeof r->code[0] ||
        head->rows > (uint64_t)size / ROW)
        return false;
    const size_t n = head->variables * sizeof *r->table, codes = head->codes * sizeof *r->code;
    const uint64_t blocks = (head->rows + BLOCK - 1) / BLOCK;

    *at = (off_t)(sizeof *head + 2 * n + codes + sizeof sum);
    if ((uint64_t)*at + head->rows * ROW + blocks * sizeof sum != (uint64_t)size ||
        !apc_grow(&r->table, head->variables + 1, sizeof *r->table) ||
        !apc_grow(&r->id, head->variables + 1, sizeof *r->id) ||
        !read_columns_at(fd, r->table, n, sizeof *head) ||
        !read_columns_at(fd, r->id, n, (off_t)(sizeof *head + n)) ||
        !read_columns_at(fd, r->code, codes, (off_t)(sizeof *head + 2 * n)) ||
        !read_columns_at(fd, &sum, sizeof sum, *at - (off_t)sizeof sum))
        return false;
    for (size_t i = 0; i < head->variables; i++)
        if (r->table[i] <= 0 || r->table[i] >= APC_TABLE_END)
            return false;
    r->n = r->room = head->rows;
    r->n_variables = head->variables;
    r->n_codes = head->codes;
    return sum ==
           sum_of(r->code, codes, sum_of(r->id, n, sum_of(r->table, n, sum_of(head, sizeof *head, 0))));
}

static uint64_t change_time_of(const struct stat *of)
{
    return (uint64_t)of->st_ctim.tv_sec * 1000000000 + (uint64_t)of->st_ctim.tv_nsec;
}

static bool take_columns_file(struct apc_samples *r, int csv, int columns)
{
    struct stat of_csv, of_columns;
    struct head head;
    uint64_t csv_sum;
    off_t at;

    if (fstat(csv, &of_csv) != 0 || fstat(columns, &of_columns) != 0 ||
        !take_head(columns, of_columns.st_size, r, &head, &at) || head.csv_size != (uint64_t)of_csv.st_size ||
        !apc_grow(&r->time, r->n + 1, sizeof *r->time) || !apc_grow(&r->value, r->n + 1, sizeof *r->value) ||
        !apc_grow(&r->variable, r->n + 1, sizeof *r->variable) ||
        !apc_grow(&r->status, r->n + 1, sizeof *r->status))
        return false;
    const bool untouched = head.csv_inode == of_csv.st_ino && head.csv_changed == change_time_of(&of_csv);

    return read_columns_parts(r, untouched ? -1 : csv, of_csv.st_size, columns, at, &csv_sum) &&
           (untouched || csv_sum == head.csv_sum);
}

int apc_samples_read(struct apc_samples *rows, const char *csv, const char *columns, struct apc_error *why)
{
    const int fd = open(csv, O_RDONLY | O_CLOEXEC),
              beside = columns ? open(columns, O_RDONLY | O_CLOEXEC | O_NONBLOCK) : -1;
    const bool taken = fd >= 0 && beside >= 0 && take_columns_file(rows, fd, beside);

    if (fd >= 0)
        close(fd);
    if (beside >= 0)
        close(beside);
    if (taken)
        return 0;
    samples_forget(rows);
    return samples_csv_read(rows, csv, why);
}

void apc_samples_free(struct apc_samples *r)
{
    samples_forget(r);
    free(r);
}

/* ---- Writing --------------------------------------------------------------------------------- */

static bool write_columns(FILE *out, const void *from, size_t size, size_t n)
{
    return n == 0 || fwrite(from, size, n, out) == n; /* of a record without rows there are no arrays */
}

static bool write_column_block(FILE *out, const struct apc_samples *r, size_t block, uint16_t *variable)
{
    const size_t first = block * BLOCK, n = rows_of_block(r, block);

    for (size_t i = 0; i < n; i++)
        variable[i] = (uint16_t)r->variable[first + i];
    const uint64_t sum = sum_of_block(r, first, n, variable);

    return write_columns(out, r->time + first, sizeof *r->time, n) &&
           write_columns(out, r->value + first, sizeof *r->value, n) &&
           write_columns(out, variable, sizeof *variable, n) &&
           write_columns(out, r->status + first, sizeof *r->status, n) &&
           write_columns(out, &sum, sizeof sum, 1);
}

static bool put_columns(FILE *out, const struct apc_samples *r, const struct head *head)
{
    uint64_t sum = sum_of(head, sizeof *head, 0);
    uint16_t *const variable = malloc(BLOCK * sizeof *variable);

    sum = sum_of(r->table, r->n_variables * sizeof *r->table, sum);
    sum = sum_of(r->id, r->n_variables * sizeof *r->id, sum);
    sum = sum_of(r->code, r->n_codes * sizeof *r->code, sum);
    bool good = variable && write_columns(out, head, sizeof *head, 1) &&
                write_columns(out, r->table, sizeof *r->table, r->n_variables) &&
                write_columns(out, r->id, sizeof *r->id, r->n_variables) &&
                write_columns(out, r->code, sizeof *r->code, r->n_codes) &&
                write_columns(out, &sum, sizeof sum, 1);
    for (size_t i = 0; good && i * BLOCK < r->n; i++)
        good = write_column_block(out, r, i, variable);
    free(variable);
    return good;
}

/* Has it stayed as it was, and would a change from now on be seen by its time? */
static bool is_file_at_rest(int fd, const struct stat *was)
{
    struct timespec now;
    struct stat is;

    return clock_gettime(CLOCK_REALTIME, &now) == 0 && fstat(fd, &is) == 0 &&
           change_time_of(&is) == change_time_of(was) &&
           (uint64_t)now.tv_sec * 1000000000 + (uint64_t)now.tv_nsec > change_time_of(&is) + TICK;
}

/* What @p csv holds, and what tells it from any other. */
static bool know(const char *csv, struct apc_samples *r, struct head *head)
{
    const int fd = open(csv, O_RDONLY | O_CLOEXEC);
    struct stat of_csv = {0};
    bool good = fd >= 0 && fstat(fd, &of_csv) == 0;

    *head = (struct head){.csv_size = (uint64_t)of_csv.st_size, .csv_inode = of_csv.st_ino};
    memcpy(head->mark, mark, sizeof mark);
    good = good && read_columns_parts(NULL, fd, of_csv.st_size, -1, 0, &head->csv_sum) &&
           samples_csv_read(r, csv, &(struct apc_error){0}) == 0 && r->n_variables <= VARIABLES;
    head->rows = r->n;
    head->variables = r->n_variables;
    head->codes = r->n_codes;
    head->csv_changed = good && is_file_at_rest(fd, &of_csv) ? change_time_of(&of_csv) : 0;
    if (fd >= 0)
        close(fd);
    return good;
}

void apc_samples_keep(const char *csv, const char *columns)
{
    const size_t room = strlen(columns) + sizeof ".part";
    char *const part = malloc(room);
    struct apc_samples rows = {0};
    struct head head;
    FILE *out = NULL;
    bool good = part && know(csv, &rows, &head);

    if (good) {
        snprintf(part, room, "%s.part", columns);
        out = fopen(part, "we");
    }
    good = out && put_columns(out, &rows, &head);
    if (out && fclose(out) != 0)
        good = false;
    if (!good || rename(part, columns) != 0) {
        if (out)
            remove(part);
        remove(columns);
    }
    samples_forget(&rows);
    free(part);
}

/* ---- What is told of each row ---------------------------------------------------------------- */

void apc_samples_spread(const struct apc_samples *rows, size_t first, size_t n, const void *of, size_t size,
                        void *to)
{
    const int32_t *const variable = rows->variable + first;

    if (size == sizeof(int8_t)) {
        for (size_t i = 0; i < n; i++)
            ((int8_t *)to)[i] = ((const int8_t *)of)[variable[i]];
    } else {
        for (size_t i = 0; i < n; i++)
            ((int32_t *)to)[i] = ((const int32_t *)of)[variable[i]];
    }
}

void apc_samples_times(const struct apc_samples *rows, int64_t start, int64_t *to)
{
    /* A number added to this one has its nearest integer in the lowest bits. */
    static const double shift = 0x1.8p52;
    int64_t zero, bits;

    memcpy(&zero, &shift, sizeof zero);
    for (size_t i = 0; i < rows->n; i++) {
        const double us = 1e6 * rows->time[i], shifted = us + shift;

        memcpy(&bits, &shifted, sizeof bits);
        to[i] = (int64_t)((uint64_t)start + 1000 * (uint64_t)(fabs(us) < 0x1p51 ? bits - zero : llrint(us)));
    }
}

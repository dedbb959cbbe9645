/* SPDX-License-Identifier: BSD-3-Clause */
#include "history.h"

#include <dirent.h>
#include <inttypes.h>
#include <stdarg.h>
#include <stdbool.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#define SAID_MAX 20

struct row {
    char table[16];
    int id;
    int64_t seq;
    char value[32]; /* compared as it is written */
    size_t order;   /* in which it came */
};

struct rows {
    struct row *row;
    size_t n, capacity;
};

struct history {
    struct history_counts *counts;
    bool ring;
    struct rows attempts, acks, stored, reads; /* reads: of one reader at a time */
};

static void violated(struct history *h, const char *fmt, ...) __attribute__((format(printf, 2, 3)));
static void violated(struct history *h, const char *fmt, ...)
{
    va_list args;
    if (++h->counts->violations > SAID_MAX)
        return;
    fputs("VIOLATED: ", stderr);
    va_start(args, fmt);
    vfprintf(stderr, fmt, args);
    va_end(args);
    fputc('\n', stderr);
}

static int add(struct rows *rows, const struct row *row)
{
    if (rows->n == rows->capacity) {
        size_t capacity = 2 * rows->capacity + 1024;
        struct row *grown = realloc(rows->row, capacity * sizeof *grown);
        if (!grown)
            return -1;
        rows->row = grown;
        rows->capacity = capacity;
    }
    rows->row[rows->n] = *row;
    rows->row[rows->n].order = rows->n;
    rows->n++;
    return 0;
}

/* A writer that was killed may have left half a line: that is no line. */
static int load(struct history *h, const char *path, struct rows *of_kind[128])
{
    char line[256];
    int rc = 0;
    FILE *f = fopen(path, "r");
    if (!f)
        return -1;
    while (rc == 0 && fgets(line, sizeof line, f)) {
        struct row row = {.order = 0};
        size_t length = strlen(line);
        if (length == 0 || line[length - 1] != '\n')
            continue;
        line[length - 1] = '\0';
        struct rows *rows = line[0] > 0 ? of_kind[(int)line[0]] : NULL;
        if (line[0] == 'x')
            violated(h, "%s: %s", path, line + 2);
        else if (!rows ||
                 sscanf(line + 1, " %15s %d %" SCNd64 " %31s", row.table, &row.id, &row.seq, row.value) != 4)
            violated(h, "%s: a line that is none: %s", path, line);
        else
            rc = add(rows, &row);
    }
    fclose(f);
    return rc;
}

static int compare_key(const struct row *a, const struct row *b)
{
    int c = strcmp(a->table, b->table);
    if (c == 0)
        c = (a->id > b->id) - (a->id < b->id);
    return c != 0 ? c : (a->seq > b->seq) - (a->seq < b->seq);
}

static int compare(const void *a, const void *b)
{
    const struct row *x = a, *y = b;
    int c = compare_key(x, y);
    return c != 0 ? c : (x->order > y->order) - (x->order < y->order);
}

static void sort(struct rows *rows)
{
    if (rows->n > 0)
        qsort(rows->row, rows->n, sizeof *rows->row, compare);
}

/* Where the first row with this key is, or would be, in sorted rows. */
static size_t place(const struct rows *rows, const struct row *key)
{
    size_t low = 0, high = rows->n;
    while (low < high) {
        size_t middle = low + (high - low) / 2;
        if (compare_key(&rows->row[middle], key) < 0)
            low = middle + 1;
        else
            high = middle;
    }
    return low;
}

static const struct row *find(const struct rows *rows, const struct row *key)
{
    size_t at = place(rows, key);
    return at < rows->n && compare_key(&rows->row[at], key) == 0 ? &rows->row[at] : NULL;
}

/* Is it older than what the store keeps? */
static bool is_dropped(const struct history *h, const struct row *row)
{
    struct row first = *row;
    first.seq = 0;
    size_t at = place(&h->stored, &first);
    return h->ring && at < h->stored.n && strcmp(h->stored.row[at].table, row->table) == 0 &&
           h->stored.row[at].id == row->id && row->seq < h->stored.row[at].seq;
}

static bool same_value(const struct row *a, const struct row *b)
{
    return strcmp(a->value, b->value) == 0;
}

#define ROW     "%s %d seq %" PRId64 " value %s"
#define OF(row) (row)->table, (row)->id, (row)->seq, (row)->value

static void check_stored(struct history *h)
{
    for (size_t i = 1; i < h->stored.n; i++) {
        const struct row *before = &h->stored.row[i - 1], *row = &h->stored.row[i];
        if (strcmp(before->table, row->table) != 0 || before->id != row->id)
            continue;
        if (row->seq == before->seq)
            violated(h, "stored twice: " ROW, OF(row));
        else if (row->seq < before->seq)
            violated(h, "seq falls in the store: " ROW ", after %" PRId64, OF(row), before->seq);
    }
    sort(&h->stored);
    for (size_t i = 0; i < h->stored.n; i++) {
        const struct row *row = &h->stored.row[i], *end = h->attempts.row + h->attempts.n;
        const struct row *attempt = find(&h->attempts, row);
        if (!attempt) {
            violated(h, "stored, but nobody attempted it: " ROW, OF(row));
            continue;
        }
        while (attempt < end && compare_key(attempt, row) == 0 && !same_value(attempt, row))
            attempt++;
        if (attempt == end || compare_key(attempt, row) != 0)
            violated(h, "stored with a value that nobody attempted: " ROW, OF(row));
    }
}

static void check_acks(struct history *h)
{
    for (size_t i = 0; i < h->acks.n; i++) {
        const struct row *ack = &h->acks.row[i], *row = find(&h->stored, ack);
        if (!row && !is_dropped(h, ack))
            violated(h, "acknowledged, but not stored: " ROW, OF(ack));
        else if (row && !same_value(row, ack))
            violated(h, "acknowledged: " ROW ", but stored: value %s", OF(ack), row->value);
        if (i > 0 && compare_key(ack, ack - 1) == 0 && !same_value(ack, ack - 1))
            violated(h, "acknowledged twice with different values: " ROW " and %s", OF(ack), ack[-1].value);
    }
}

/* Sorted by seq, the reads of a variable have to be in the order in which they were made. */
static void check_reads(struct history *h, const char *reader)
{
    struct rows *reads = &h->reads;
    for (size_t i = 0; i < reads->n;
         i++) { /* of each variable in the order of reading: seq 0 sorts by order */
        const struct row *row = &reads->row[i], *stored = find(&h->stored, row);
        if (!stored && !is_dropped(h, row))
            violated(h, "%s read what is not stored: " ROW, reader, OF(row));
        else if (stored && !same_value(stored, row))
            violated(h, "%s read: " ROW ", but stored: value %s", reader, OF(row), stored->value);
    }
    sort(reads);
    for (size_t i = 1; i < reads->n; i++) {
        const struct row *before = &reads->row[i - 1], *row = &reads->row[i];
        if (strcmp(before->table, row->table) == 0 && before->id == row->id && row->order < before->order &&
            row->seq > before->seq)
            violated(h, "%s saw seq fall: %s %d seq %" PRId64 " after %" PRId64, reader, row->table, row->id,
                     before->seq, row->seq);
    }
    h->counts->read += reads->n;
    reads->n = 0;
}

static int is_log(const struct dirent *entry)
{
    size_t n = strlen(entry->d_name);
    return n > 4 && strcmp(entry->d_name + n - 4, ".log") == 0;
}

static int load_files(struct history *h, const char *dir, const char *begin, bool reader)
{
    struct rows *kinds[128] = {['a'] = reader ? NULL : &h->attempts,
                               ['k'] = reader ? NULL : &h->acks,
                               ['s'] = &h->stored,
                               ['r'] = &h->reads};
    struct dirent **names;
    char path[600];
    int rc = 0, n = scandir(dir, &names, is_log, alphasort);
    for (int i = 0; i < n; i++) {
        if (rc == 0 && strncmp(names[i]->d_name, begin, strlen(begin)) == 0) {
            snprintf(path, sizeof path, "%s/%s", dir, names[i]->d_name);
            rc = load(h, path, kinds);
            if (rc == 0 && reader)
                check_reads(h, names[i]->d_name);
        }
        free(names[i]);
    }
    if (n >= 0)
        free(names);
    return n < 0 ? -1 : rc;
}

int history_check(const char *dir, struct history_counts *counts)
{
    char ring[600];
    snprintf(ring, sizeof ring, "%s/ring", dir);
    struct history h = {.counts = counts, .ring = access(ring, F_OK) == 0};
    *counts = (struct history_counts){0};
    int rc = load_files(&h, dir, "writer-", false);
    if (rc == 0)
        rc = load_files(&h, dir, "stored", false);
    sort(&h.attempts);
    sort(&h.acks);
    counts->attempted = h.attempts.n;
    counts->acknowledged = h.acks.n;
    counts->stored = h.stored.n;
    check_stored(&h);
    check_acks(&h);
    if (rc == 0)
        rc = load_files(&h, dir, "reader-", true);
    free(h.attempts.row);
    free(h.acks.row);
    free(h.stored.row);
    free(h.reads.row);
    return rc;
}

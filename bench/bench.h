/* SPDX-License-Identifier: BSD-3-Clause */
/*
 * What the benchmarks share: ways of doing one thing, measured in turn, their statistics, and where it
 * was that they ran. Machines and moments differ, so every figure that is worth comparing is a ratio
 * inside one run: the ways take turns (A B C A B C ...), a ratio is taken within each round, and its
 * median over the rounds is what is printed. A benchmark prints; it never fails on a figure.
 */
#ifndef APC_BENCH_H
#define APC_BENCH_H

#include <stdio.h>

#include <apcbase.h>

#define BENCH_REFERENCES 3

/* One way of doing it. */
struct bench_row {
    const char *name;
    void (*once)(void *ctx); /* do it once; die() when it fails */
    void *ctx;
    const struct bench_row *to[BENCH_REFERENCES]; /* what it is compared with; NULL: nothing */
    const char *goal;                             /* for the ratio, printed behind it; NULL: none */
    /* Filled in by bench_run(). */
    double *us;     /* every call that was measured */
    double *median; /* of each round */
    size_t count;
};

struct bench {
    const char *name;
    const char *reference[BENCH_REFERENCES]; /* headings of the ratios; NULL: no such column */
    size_t calls;                            /* in a round of a row, at most */
    apc_ns budget;                           /* for a round of a row: no call begins after it */
    size_t rounds;                           /* --rounds; one more comes first and is not counted */
    FILE *json;                              /* --json */
    bool any;                                /* a result was written to it */
};

/* Read the command line. */
void bench_begin(struct bench *b, int argc, char **argv, const char *doc);
/* Say where it runs, and with what server (NULL: none). */
void bench_describe(struct bench *b, const char *server);
/* Measure the rows in turn, print them under @p title, and as one result with this @p n. */
void bench_run(struct bench *b, const char *title, size_t n, struct bench_row *rows, size_t n_rows);
void bench_end(struct bench *b);

/* Say what failed and end the program: a benchmark of something that did not happen is worth nothing. */
_Noreturn void die(const char *fmt, ...) APC_PRINTF(1, 2);
/* calloc() that never fails. */
void *allocate(size_t n, size_t size);

#endif

/* SPDX-License-Identifier: BSD-3-Clause */
/* One run of many: what came of it. */
#ifndef APC_TRIAL_H
#define APC_TRIAL_H

#include "figures/figures.h"

struct trial {
    bool made, diverged;
    int rc;
    uint64_t held, failures; /* ticks: output not the law's; the law gave no usable output */
    char why[200];
    double ended;    /* s */
    double beyond;   /* share of the time, added up over the measurements that lay beyond their limits */
    double figure[]; /* [loops * METRICS] */
};

/* Bytes of one with so many loops: no two share a cache line. */
size_t trial_size(size_t loops);

/*
 * Make the run of @p seed. Where law or plant are code of the user's it has a process of its own, and @p t
 * lies in memory that processes share.
 */
void trial_make(struct trial *t, const struct experiment *e, uint64_t seed);

/* The same for other work: is it to have a process? Then in one, which sets *@p made in such memory at its end.
 * Returns 0, or APC_ESYS with why it came to none in @p why. */
bool trial_has_plugin(const struct experiment *e);
int trial_apart(void (*work)(void *ctx), void *ctx, const bool *made, char *why, size_t size);

/* A run whose plant diverged has figures, infinite ones; any other failure has none. */
bool trial_counts(const struct trial *t);

#endif

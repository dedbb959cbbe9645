/* SPDX-License-Identifier: BSD-3-Clause */
/* The samples of a run: measurements, setpoints, outputs, and the file samples.csv. */
#ifndef APC_SAMPLES_H
#define APC_SAMPLES_H

#include <stdio.h>

#include <apcstore.h>

#include "experiment/experiment.h"

struct samples {
    struct apc_sample *at;
    size_t n, room;
};

int samples_add(struct samples *s, const struct apc_sample *sample); /* 0 or APC_ENOMEM */
void samples_free(struct samples *s);
/* By time; at one time in the order of the loop: setpoint, measurement, output. */
void samples_sort(struct samples *s);
/* Those of DIR/NAME, samples.csv or operation.csv, in the order of the file, times counted from the start of
 * the run, and the seq of each variable counted from 1. Returns 0 or a negative error; samples_free() in
 * either case. */
int samples_read(struct samples *s, const char *dir, const char *name, struct apc_error *why);
/* Each row of a file as such, with its time as a number: to @p take, which returns 0 or a negative error. */
int samples_each(const char *path, int (*take)(void *ctx, double t, const struct apc_sample *sample),
                 void *ctx, struct apc_error *why);
/* Those that a store has in a range, sorted. Returns 0, APC_ENOMEM or the store's error. */
int samples_collect(struct samples *s, struct apc_store *store, const struct experiment *e,
                    const struct apc_range *range);
/* Those of one variable. */
int samples_collect_one(struct samples *s, struct apc_store *store, enum apc_table table, int id,
                        const struct apc_range *range);
/* Modes, target and actual, tuning, operator's outputs: of each the newest before the range, and those in it;
 * by time. */
int samples_collect_operation(struct samples *samples, struct apc_store *store, const struct experiment *e,
                              const struct apc_range *range);
/* The numbers that laws published: in the range only, by time. */
int samples_collect_published(struct samples *samples, struct apc_store *store, const struct experiment *e,
                              const struct apc_range *range);
/* With the header; times in seconds since @start. */
void samples_write(const struct samples *s, apc_ns start, FILE *out);

#endif

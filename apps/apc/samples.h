/* SPDX-License-Identifier: BSD-3-Clause */
/* The samples of a run: measurements, setpoints, outputs, and the file samples.csv. */
#ifndef APC_SAMPLES_H
#define APC_SAMPLES_H

#include <stdio.h>

#include <apcbase.h>

struct samples {
    struct apc_sample *at;
    size_t n, room;
};

int samples_add(struct samples *s, const struct apc_sample *sample); /* 0 or APC_ENOMEM */
void samples_free(struct samples *s);
/* By time; at one time in the order of the loop: setpoint, measurement, output. */
void samples_sort(struct samples *s);
/* With the header; times in seconds since @start. */
void samples_write(const struct samples *s, apc_ns start, FILE *out);

#endif

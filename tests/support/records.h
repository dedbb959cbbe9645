/* SPDX-License-Identifier: BSD-3-Clause */
/* Records of plants that are known. */
#ifndef APC_TEST_RECORDS_H
#define APC_TEST_RECORDS_H

#include "apcidentify.h"

#define RECORD_SAMPLES 4000
#define RECORD_INPUTS  3
#define RECORD_OUTPUTS 2
#define RECORD_RUNS    4

struct record_test {
    struct apc_record record;
    double u[RECORD_SAMPLES * RECORD_INPUTS], y[RECORD_SAMPLES * RECORD_OUTPUTS];
    size_t begin[RECORD_RUNS];
};

/* Each input holds for hold[j] samples, then is high or low by chance, what goes into an integrator for as
 * long the other way after that; y is what the transfer functions make of it, at rest before, and noise,
 * white or with @p colour as its autoregression, whose deviation is @p noise times half the range of y.
 * free() it. */
struct record_test *record_simulate(const struct apc_transfer *g, size_t inputs, size_t ny, size_t n,
                                    double Ts, const size_t *hold, double noise, double colour,
                                    uint64_t seed);
/* @p run behind those that are there, @p du added to its inputs, @p dy to its outputs, and freed. */
void record_append(struct record_test *t, struct record_test *run, double du, double dy);

#endif

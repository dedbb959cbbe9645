/* SPDX-License-Identifier: BSD-3-Clause */
/* The parts of bench_store: one file a kind of store. To add one: its file, a line here and one in
 * bench_store.c. */
#ifndef APC_BENCH_STORE_H
#define APC_BENCH_STORE_H

#include "bench.h"

/* Each measures with bench_run(), whose references, calls and budget it sets itself. */
void bench_postgresql(struct bench *b);
void bench_shm(struct bench *b);
void bench_sqlite(struct bench *b);

#endif

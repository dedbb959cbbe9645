/* SPDX-License-Identifier: BSD-3-Clause */
/* What every store is asked for at each tick, side by side: the table of docs/stores.md. */
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include <apcstore.h>

#include "store.h"

enum { TICK = 10, MANY = 100, CALLS = 50 };

struct way {
    struct apc_store *store;
    int64_t seq;
    struct apc_sample samples[MANY];
};

static void append(struct way *w, int n)
{
    w->seq++;
    for (int i = 0; i < n; i++)
        w->samples[i] = (struct apc_sample){.table = APC_SENSOR,
                                            .id = i + 1,
                                            .seq = w->seq,
                                            .time = w->seq * APC_NS_PER_MS,
                                            .value = 0.1 * i};
    if (apc_store_append(w->store, w->samples, (size_t)n) != n)
        die("append: %s", apc_store_error(w->store));
}

static void read_newest(struct way *w, int n)
{
    for (int i = 0; i < n; i++)
        w->samples[i] = (struct apc_sample){.table = APC_SENSOR, .id = i + 1};
    if (apc_store_read(w->store, w->samples, (size_t)n) < 0 || w->samples[n - 1].seq == 0)
        die("read: %s", apc_store_error(w->store));
}

static void append_tick(void *ctx)
{
    append(ctx, TICK);
}

static void read_tick(void *ctx)
{
    read_newest(ctx, TICK);
}

static void read_many(void *ctx)
{
    read_newest(ctx, MANY);
}

static struct way *way_open(const char *uri)
{
    const struct apc_store_options options = {
        .size = sizeof options, .name = "bench", .timeout = 60 * APC_NS_PER_S};
    struct way *w = allocate(1, sizeof *w);
    struct apc_error why;
    if (apc_store_open(&w->store, uri, &options, &why) < 0)
        die("%s", why.text);
    if (apc_store_init(w->store) < 0)
        die("%s", apc_store_error(w->store));
    append(w, MANY);
    return w;
}

void bench_all(struct bench *b)
{
    static const struct {
        const char *title;
        size_t n;
        void (*once)(void *ctx);
    } jobs[] = {{"append of 10 samples, as durable as the store is", TICK, append_tick},
                {"newest of 10", TICK, read_tick},
                {"newest of 100", MANY, read_many}};
    char sqlite[4300], shm[64], segment[80];
    snprintf(sqlite, sizeof sqlite, "sqlite:%s/all.db", bench_folder());
    snprintf(shm, sizeof shm, "shm:bench-all-%d", (int)getpid());
    snprintf(segment, sizeof segment, "/dev/shm/apc.%s", shm + strlen("shm:"));
    struct bench_row rows[] = {{.name = "shm:", .ctx = way_open(shm)},
                               {.name = "mem:", .ctx = way_open("mem:")},
                               {.name = "sqlite:", .ctx = way_open(sqlite)},
                               {.name = "postgresql:", .ctx = way_open("postgresql:#everywhere")}};
    const size_t n = sizeof rows / sizeof rows[0];
    b->reference[0] = "shm";
    b->reference[1] = b->reference[2] = NULL;
    b->calls = CALLS;
    b->budget = 400 * APC_NS_PER_MS;
    for (size_t j = 0; j < sizeof jobs / sizeof jobs[0]; j++) {
        for (size_t i = 0; i < n; i++) {
            rows[i].once = jobs[j].once;
            rows[i].to[0] = i > 0 ? &rows[0] : NULL;
        }
        bench_run(b, jobs[j].title, jobs[j].n, rows, n);
    }
    for (size_t i = 0; i < n; i++) {
        apc_store_close(((struct way *)rows[i].ctx)->store);
        free(rows[i].ctx);
    }
    unlink(segment);
}

/* SPDX-License-Identifier: BSD-3-Clause */
#include "test.h"

#include <stdlib.h>
#include <time.h>

#include "apc/operate/operate.h"

#define LATE (5 * APC_NS_PER_S) /* beyond five periods: then nothing ticks */

int test_bench_open(struct test_bench *b, const struct experiment *e, const struct controller *follow,
                    uint64_t seed, struct apc_store *live, struct apc_error *why)
{
    int rc = 0;

    b->e = e;
    b->period = follow->rhythm.period;
    b->phase = follow->rhythm.phase;
    b->tick = (struct apc_vector){.table = APC_TICK, .id = follow->number};
    b->tags = provision_tags(e, &b->n_tags);
    operate_who(b->who, sizeof b->who);
    if (!b->tags || controllers_describe(e, &b->loops) < 0)
        return apc_fail(why, APC_ENOMEM, "out of memory");
    b->store = live;
    if (!live) {
        rc = simulation_create(b->s, e, seed, why);
        b->store = b->s->store;
        b->zero = b->now = SIMULATION_BEGIN;
    } else {
        b->s = NULL;
    }
    return rc;
}

void test_bench_close(struct test_bench *b)
{
    if (b->s)
        simulation_destroy(b->s);
    loops_free(&b->loops);
    free(b->tags);
}

static int read_tick(struct test_bench *b, struct apc_error *why)
{
    struct apc_rows rows = {.size = sizeof rows, .vector = &b->tick, .n_vectors = 1};
    const int rc = apc_store_read_rows(b->store, &rows);
    return rc < 0 ? apc_fail(why, rc, "%s", apc_store_error(b->store)) : 0;
}

/* A row of its controller comes with each tick. */
static int next_live(struct test_bench *b, struct apc_error *why)
{
    const apc_ns until = apc_clock_mono(NULL) + 5 * b->period + LATE;
    const int64_t seen = b->tick.seq;
    const struct timespec pause = {0, b->period < 20 * APC_NS_PER_MS ? 1000000 : 5000000};
    int rc = read_tick(b, why);

    while (rc == 0 && b->tick.seq == seen && !*b->stop) {
        if (apc_clock_mono(NULL) > until)
            return apc_fail(why, APC_ETIMEDOUT, "the controller does not tick any more");
        nanosleep(&pause, NULL);
        rc = read_tick(b, why);
    }
    b->zero = b->zero ? b->zero : b->tick.time;
    b->now = b->tick.time;
    return rc;
}

int test_bench_next(struct test_bench *b, struct apc_error *why)
{
    if (!b->s)
        return next_live(b, why);
    const apc_ns t = ++b->ticks * b->period + b->phase;
    const int rc = simulation_run(b->s, apc_ns_to_s(t));
    b->now = SIMULATION_BEGIN + t;
    return rc < 0 ? apc_fail(why, rc, "%s", b->s->why.text) : 0;
}

int test_bench_do(struct test_bench *b, const struct action *action, struct apc_error *why)
{
    if (b->s) {
        const int rc = simulation_operate(b->s, action);
        return rc < 0 ? apc_fail(why, rc, "%s", b->s->why.text) : 0;
    }
    const int rc = action_do(b->store, &b->loops, b->tags, b->n_tags, action, apc_clock_utc(NULL), b->who);
    return rc < 0 ? apc_fail(why, rc, "%s", apc_store_error(b->store)) : 0;
}

int test_bench_read(struct test_bench *b, struct apc_sample *rows, size_t n, struct apc_error *why)
{
    const int rc = apc_store_read(b->store, rows, n);
    return rc < 0 ? apc_fail(why, rc, "%s", apc_store_error(b->store)) : 0;
}

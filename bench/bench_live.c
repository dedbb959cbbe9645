/* SPDX-License-Identifier: BSD-3-Clause */
/*
 * A controller's tick through the live store, shm:, for n loops of pi, and what none can do without:
 *
 *     read      apc_store_read_rows() of all that the controller reads
 *     laws      apc_law_pi's compute and update of the n loops
 *     append    apc_store_append_rows() of all that a tick writes: n outputs and the tick row
 *     bare      these three, one after another
 *     whole     read, apc_controller_compute(), append, apc_controller_update(): what apc-controller does
 *
 * The bare ones have a store of their own, alike. Nobody else reads or writes; ticks follow each other
 * without a pause.
 */
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include <apccontrol.h>

#include "bench.h"
#include "tick.h"

#define WARM 10 /* ticks until all is told that is told once */

/* The paper's law of n loops, without what is around it. */
struct laws {
    size_t n;
    struct apc_law_call *call;
    double *y, *z, *x, *u, *tuning;
    unsigned *limited;
};

static void laws_open(struct laws *l, size_t n)
{
    const size_t n_tuning = apc_law_pi.n_tuning;

    *l = (struct laws){.n = n,
                       .call = allocate(n, sizeof *l->call),
                       .y = allocate(n, sizeof *l->y),
                       .z = allocate(n, sizeof *l->z),
                       .x = allocate(n, sizeof *l->x),
                       .u = allocate(n, sizeof *l->u),
                       .tuning = allocate(n * n_tuning, sizeof *l->tuning),
                       .limited = allocate(n, sizeof *l->limited)};
    for (size_t i = 0; i < n; i++) {
        for (size_t k = 0; k < n_tuning; k++)
            l->tuning[i * n_tuning + k] = apc_law_pi.tuning[k].initial;
        l->y[i] = (double)i;
        l->call[i] = (struct apc_law_call){.size = sizeof l->call[i],
                                           .dim = {1, 1, 1, 0},
                                           .Ts = TS,
                                           .y = &l->y[i],
                                           .z = &l->z[i],
                                           .tuning = &l->tuning[i * n_tuning],
                                           .x = &l->x[i],
                                           .u = &l->u[i],
                                           .limited = &l->limited[i],
                                           .n_ahead = 1};
    }
}

static void laws_close(struct laws *l)
{
    free(l->call);
    free(l->y);
    free(l->z);
    free(l->x);
    free(l->u);
    free(l->tuning);
    free(l->limited);
}

struct bare {
    struct control *control; /* its store, what it reads, and what its last tick wrote */
    struct laws laws;
};

static void read_once(void *ctx)
{
    const struct bare *b = ctx;

    if (apc_store_read_rows(b->control->store, apc_controller_in(b->control->core)) < 0)
        die("%s", apc_store_error(b->control->store));
}

static void laws_once(void *ctx)
{
    const struct laws *l = &((struct bare *)ctx)->laws;

    for (size_t i = 0; i < l->n; i++) {
        l->limited[i] = 0;
        if (apc_law_pi.compute(&l->call[i]) != APC_LAW_GOOD)
            die("the law failed");
        apc_law_pi.update(&l->call[i]);
    }
}

static void append_once(void *ctx)
{
    const struct bare *b = ctx;
    const struct apc_rows *out = apc_controller_out(b->control->core);
    const apc_ns now = apc_clock_utc(NULL);

    for (size_t i = 0; i < out->n_samples; i++) {
        out->sample[i].seq++;
        out->sample[i].time = now;
    }
    out->vector[0].seq++;
    out->vector[0].time = now;
    if (apc_store_append_rows(b->control->store, out) != (int)(out->n_samples + out->n_vectors))
        die("%s", apc_store_error(b->control->store));
}

static void bare_once(void *ctx)
{
    read_once(ctx);
    laws_once(ctx);
    append_once(ctx);
}

/* A controller in Auto, with measurements that do not change, in a store of this name. */
static struct control *live_open(const char *name, size_t n)
{
    struct apc_sample *input = allocate(2 * n, sizeof *input);
    struct apc_store *store;
    struct apc_error why;
    char uri[80];

    snprintf(uri, sizeof uri, "shm:%s?size=256", name);
    if (apc_store_open(&store, uri, NULL, &why) < 0)
        die("%s", why.text);
    store_prepare(store, n);
    for (size_t i = 0; i < 2 * n; i++)
        input[i] = (struct apc_sample){.table = i < n ? APC_SENSOR : APC_SETPOINT,
                                       .id = (int)(i % n) + 1,
                                       .seq = 1,
                                       .time = apc_clock_utc(NULL),
                                       .value = i < n ? (double)i : 0.0};
    if (apc_store_append(store, input, 2 * n) < 0)
        die("%s", apc_store_error(store));
    free(input);
    struct control *control = control_open(store, n);
    for (int k = 0; k < WARM; k++)
        control_once(control);
    if (apc_controller_out(control->core)->n_samples != n)
        die("a tick writes %zu samples, not one a loop", apc_controller_out(control->core)->n_samples);
    return control;
}

static void live_close(const char *name, struct control *control)
{
    char path[80];

    control_close(control);
    snprintf(path, sizeof path, "/dev/shm/apc.%s", name);
    unlink(path);
}

static void live_run(struct bench *b, size_t n)
{
    char name[2][32], title[32];
    struct bare bare;

    snprintf(name[0], sizeof name[0], "bench-live-%d", (int)getpid());
    snprintf(name[1], sizeof name[1], "bench-bare-%d", (int)getpid());
    struct control *whole = live_open(name[0], n);
    bare.control = live_open(name[1], n);
    laws_open(&bare.laws, n);

    struct bench_row rows[] = {
        {.name = "read", .once = read_once, .ctx = &bare},
        {.name = "laws", .once = laws_once, .ctx = &bare},
        {.name = "append", .once = append_once, .ctx = &bare},
        {.name = "bare: read, laws, append", .once = bare_once, .ctx = &bare},
        {.name = "libapc: apc-controller's tick", .once = control_once, .ctx = whole, .goal = "1.5"},
    };
    for (size_t i = 0; i < sizeof rows / sizeof rows[0]; i++)
        rows[i].to[0] = i == 3 ? NULL : &rows[3];
    snprintf(title, sizeof title, "n = %zu", n);
    bench_run(b, title, n, rows, sizeof rows / sizeof rows[0]);

    laws_close(&bare.laws);
    live_close(name[0], whole);
    live_close(name[1], bare.control);
}

int main(int argc, char **argv)
{
    static const size_t sizes[] = {10, 100, 1000};
    struct bench b = {.name = "live", .reference = {"bare"}, .calls = 20000, .budget = 100 * APC_NS_PER_MS};

    bench_begin(&b, argc, argv, "Time a controller's tick through the store in shared memory.");
    bench_describe(&b, NULL);
    for (size_t i = 0; i < sizeof sizes / sizeof sizes[0]; i++)
        live_run(&b, sizes[i]);
    bench_end(&b);
    return 0;
}

/* SPDX-License-Identifier: BSD-3-Clause */
/*
 * Virtual time. The paper's experiment, 600 s in 3000 steps of the plant, as apc simulate runs it (client,
 * link, controller and all), against a loop by hand that has nothing in it but CVODE and the paper's PI
 * controller; then what an event costs, in runs of 1e5 to 1e7 of them; then a campaign in one process and in
 * two.
 */
#include "bench.h"

#include <malloc.h>
#include <spawn.h>
#include <stdlib.h>
#include <sys/wait.h>
#include <unistd.h>

#include <cvode/cvode.h>
#include <nvector/nvector_serial.h>
#include <sunlinsol/sunlinsol_dense.h>
#include <sunmatrix/sunmatrix_dense.h>

#include "simulation/simulation.h"

#if SUNDIALS_VERSION_MAJOR < 7
#define SUN_COMM_NULL NULL
#endif

#define EXPERIMENT APC_SOURCE_DIR "/experiments/first-order.conf"
#define STEPS      3000
#define PENDING    1000 /* events in the queue at any time */
#define CAMPAIGNS  3    /* rounds: a call takes many seconds */

/* ---- By hand ------------------------------------------------------------------------------ */

struct hand {
    SUNContext context;
    void *memory;
    N_Vector x;
    SUNMatrix matrix;
    SUNLinearSolver linear;
    double u;
};

static int derivative(sunrealtype t, N_Vector x, N_Vector dx, void *user)
{
    const struct hand *h = user;
    (void)t;
    NV_Ith_S(dx, 0) = (-NV_Ith_S(x, 0) + 10.0 * h->u) / 10.0;
    return 0;
}

static struct hand *hand_open(int method)
{
    struct hand *h = allocate(1, sizeof *h);
    if (SUNContext_Create(SUN_COMM_NULL, &h->context) < 0)
        die("no context");
    h->x = N_VNew_Serial(1, h->context);
    h->matrix = SUNDenseMatrix(1, 1, h->context);
    h->linear = SUNLinSol_Dense(h->x, h->matrix, h->context);
    h->memory = CVodeCreate(method, h->context);
    N_VConst(0.0, h->x);
    if (CVodeInit(h->memory, derivative, 0.0, h->x) < 0 || CVodeSetUserData(h->memory, h) < 0 ||
        CVodeSStolerances(h->memory, 1e-8, 1e-10) < 0 ||
        CVodeSetLinearSolver(h->memory, h->linear, h->matrix) < 0)
        die("CVODE refuses");
    return h;
}

static void hand_close(struct hand *h)
{
    CVodeFree(&h->memory);
    SUNLinSolFree(h->linear);
    SUNMatDestroy(h->matrix);
    N_VDestroy(h->x);
    SUNContext_Free(&h->context);
    free(h);
}

static void hand_once(void *ctx)
{
    static const double sequence[] = {10, 20, 5, 15};
    struct hand *h = ctx;
    double integral = 0, reached;

    NV_Ith_S(h->x, 0) = 0;
    h->u = 0;
    for (int k = 0; k < STEPS; k++) {
        if (CVodeReInit(h->memory, 0.0, h->x) < 0 || CVodeSetStopTime(h->memory, 0.2) < 0 ||
            CVode(h->memory, 0.2, h->x, &reached, CV_NORMAL) < 0)
            die("CVODE failed at step %d", k);
        if (k % 10 == 9) {
            double e = sequence[k / 750] - NV_Ith_S(h->x, 0);
            h->u = 0.2 * e + integral;
            integral += 0.2 * 2.0 / 10.0 * e;
        }
    }
    if (NV_Ith_S(h->x, 0) < 14.9 || NV_Ith_S(h->x, 0) > 15.1)
        die("by hand the plant ends at %g", NV_Ith_S(h->x, 0));
}

/* ---- Simulated ---------------------------------------------------------------------------- */

static void load(struct experiment *e, const char *integrator)
{
    struct apc_error why;
    if (experiment_load(e, EXPERIMENT, EXPERIMENT_MODEL | EXPERIMENT_LAW, NULL, &why) < 0)
        die("%s", why.text);
    snprintf(e->plant.integrator, sizeof e->plant.integrator, "%s", integrator);
}

static void simulate_once(void *ctx)
{
    const struct experiment *e = ctx;
    struct simulation s;
    struct apc_error why;
    if (simulation_create(&s, e, 1, &why) < 0)
        die("%s", why.text);
    if (simulation_run(&s, e->duration) < 0)
        die("%s", s.why.text);
    struct apc_sample last = {.table = APC_SENSOR, .id = 1};
    if (apc_store_read(s.store, &last, 1) < 0 || last.seq != 1200)
        die("%lld measurements", (long long)last.seq);
    simulation_destroy(&s);
}

static void bench_experiment(struct bench *b)
{
    struct experiment bdf, adams, rk4, exact;
    load(&bdf, "cvode");
    load(&adams, "adams");
    load(&rk4, "rk4");
    load(&exact, "exact");
    struct hand *bdf_hand = hand_open(CV_BDF), *adams_hand = hand_open(CV_ADAMS);
    struct bench_row rows[] = {
        {.name = "by hand: CVODE, BDF", .once = hand_once, .ctx = bdf_hand},
        {.name = "apc simulate: cvode", .once = simulate_once, .ctx = &bdf},
        {.name = "by hand: CVODE, Adams", .once = hand_once, .ctx = adams_hand},
        {.name = "apc simulate: adams", .once = simulate_once, .ctx = &adams},
        {.name = "apc simulate: rk4", .once = simulate_once, .ctx = &rk4},
        {.name = "apc simulate: exact", .once = simulate_once, .ctx = &exact},
    };
    rows[1].to[0] = rows[4].to[0] = rows[5].to[0] = &rows[0];
    rows[3].to[0] = &rows[2];
    rows[1].goal = rows[3].goal = "at most 1.3";
    rows[4].goal = "at most 0.19";
    rows[5].goal = "at most 0.095";
    bench_run(b, "600 s of the paper's experiment", STEPS, rows, sizeof rows / sizeof *rows);
    hand_close(bdf_hand);
    hand_close(adams_hand);
    experiment_free(&bdf);
    experiment_free(&adams);
    experiment_free(&rk4);
    experiment_free(&exact);
}

/* ---- Events ------------------------------------------------------------------------------- */

struct queue {
    struct apc_executive *executive;
    const struct apc_clock *clock;
    struct apc_random random;
    uint64_t left;
};

static void on_event(void *ctx)
{
    struct queue *q = ctx;
    if (q->left-- == 1)
        apc_virtual_stop(q->executive);
    apc_ns at = apc_clock_mono(q->clock) + 1 + (apc_ns)(apc_random_next(&q->random) >> 44);
    if (apc_virtual_at(q->executive, at, 0, on_event, q) < 0)
        die("no room for an event");
}

static void events_once(void *ctx)
{
    const uint64_t events = *(const uint64_t *)ctx;
    struct queue q = {.left = events};
    if (apc_executive_create(&q.executive, "virtual", NULL, NULL) < 0)
        die("no executive");
    q.clock = apc_executive_clock(q.executive);
    apc_random_init(&q.random, 1, "bench");
    for (int i = 0; i < PENDING; i++)
        apc_virtual_at(q.executive, apc_clock_mono(q.clock) + i, 0, on_event, &q);
    if (apc_virtual_run(q.executive, INT64_MAX) != (int64_t)events)
        die("not all events happened");
    apc_executive_destroy(q.executive);
}

static void bench_events(struct bench *b)
{
    static uint64_t events[] = {100000, 1000000, 10000000};
    struct bench_row rows[] = {
        {.name = "1e5 events", .once = events_once, .ctx = &events[0]},
        {.name = "1e6 events", .once = events_once, .ctx = &events[1]},
        {.name = "1e7 events", .once = events_once, .ctx = &events[2]},
    };
    rows[1].to[0] = rows[2].to[0] = &rows[0];
    rows[1].goal = "10, linear";
    rows[2].goal = "100, linear";
    bench_run(b, "events, 1000 in the queue", PENDING, rows, sizeof rows / sizeof *rows);
}

/* ---- Campaigns ---------------------------------------------------------------------------- */

static void campaign_once(void *ctx)
{
    char apc[] = APC_BIN_DIR "/apc", file[] = EXPERIMENT, simulate[] = "simulate", net[] = "--net",
         spec[] = "delay=exponential(0.05),loss=0.1", runs[] = "--runs=1000", jobs[32],
         csv[] = "--csv=/dev/null";
    snprintf(jobs, sizeof jobs, "--jobs=%d", *(const int *)ctx);
    char *argv[] = {apc, simulate, file, net, spec, runs, jobs, csv, NULL};
    posix_spawn_file_actions_t quiet;
    pid_t pid;
    int status;
    posix_spawn_file_actions_init(&quiet);
    posix_spawn_file_actions_addopen(&quiet, STDOUT_FILENO, "/dev/null", 1, 0);
    if (posix_spawn(&pid, apc, &quiet, NULL, argv, environ) != 0 || waitpid(pid, &status, 0) != pid ||
        status != 0)
        die("%s simulate failed", apc);
    posix_spawn_file_actions_destroy(&quiet);
}

static void bench_campaign(struct bench *b)
{
    static int jobs[] = {1, 2};
    struct bench_row rows[] = {
        {.name = "1000 seeds, 2 processes", .once = campaign_once, .ctx = &jobs[1]},
        {.name = "1000 seeds, 1 process", .once = campaign_once, .ctx = &jobs[0]},
    };
    const size_t rounds = b->rounds;
    rows[1].to[0] = &rows[0];
    rows[1].goal = "at least 1.8";
    b->rounds = CAMPAIGNS;
    bench_run(b, "a campaign", 1000, rows, sizeof rows / sizeof *rows);
    b->rounds = rounds;
}

int main(int argc, char **argv)
{
    struct bench b = {.name = "simulate", .reference = {"first"}, .calls = 20, .budget = 200 * APC_NS_PER_MS};
    bench_begin(&b, argc, argv, "Time simulations in virtual time.");
    bench_describe(&b, NULL);
    mallopt(M_TRIM_THRESHOLD, 256 << 20); /* as a campaign does */
    mallopt(M_MMAP_THRESHOLD, 32 << 20);
    bench_experiment(&b);
    bench_events(&b);
    bench_campaign(&b);
    bench_end(&b);
    return 0;
}

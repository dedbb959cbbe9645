/* SPDX-License-Identifier: BSD-3-Clause */
/*
 * Nothing tagged [tick] allocates, what is made survives any failure of an allocation, and what is destroyed
 * gives back all that it had, also when it was never finished: every allocation of the process, libraries
 * included, goes through the functions below. Sanitizers bring their own allocator, so the test is then
 * skipped.
 */
#include "check.h"

#include "apcalarm.h"
#include "apcexchange.h"
#include "apclinear.h"
#include "apcstore.h"
#include "modules/controller.h"
#include "rows.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#if defined(__SANITIZE_ADDRESS__) || defined(__SANITIZE_THREAD__)
#define COUNTING 0
#elif defined(__has_feature)
#if __has_feature(address_sanitizer) || __has_feature(thread_sanitizer) || __has_feature(memory_sanitizer)
#define COUNTING 0
#endif
#endif
#ifndef COUNTING
#define COUNTING 1
#endif

static volatile int allocations;
static volatile int held;         /* not given back yet */
static volatile int fail_at = -1; /* the allocation with this number fails */
static volatile int failed;       /* whether one did */

#if COUNTING
/* glibc's own, for programs that replace malloc. */
extern void *__libc_malloc(size_t size);
extern void *__libc_calloc(size_t n, size_t size);
extern void *__libc_realloc(void *p, size_t size);
extern void __libc_free(void *p);

static int fails(void)
{
    int now = allocations++ == fail_at;

    failed |= now;
    return now;
}

static void *given(void *p)
{
    held += p != NULL;
    return p;
}

void *malloc(size_t size)
{
    return fails() ? NULL : given(__libc_malloc(size));
}

void *calloc(size_t n, size_t size)
{
    return fails() ? NULL : given(__libc_calloc(n, size));
}

void *realloc(void *p, size_t size)
{
    return fails() ? NULL : p ? __libc_realloc(p, size) : given(__libc_malloc(size));
}

void free(void *p)
{
    held -= p != NULL;
    __libc_free(p);
}
#endif

#define S  APC_NS_PER_S
#define T0 (INT64_C(1700000000) * S)

struct loop {
    struct apc_plant *plant;
    struct apc_plantserver *server;
    struct apc_client *client;
    struct apc_controller *controller;
    struct apc_scheduler *scheduler;
    struct apc_rows *in, *out;
    struct apc_sample u;
    char request[256], reply[256];
    int failures;
};

/* All that the loop needs. The n-th allocation fails, counted after the plant's: SUNDIALS does not survive
 * its own. */
static int make(struct loop *l, int n)
{
    int rc;
    struct apc_plantserver_options server = {
        .size = sizeof(server), .model = &apc_model_first_order, .link_period = S, .command_period = S};
    const struct apc_client_options client = {.size = sizeof(client), .ny = 1, .nu = 1, .command_period = S};
    const struct apc_controller_options controller = {
        .size = sizeof(controller), .law = &apc_law_pi, .dim = {1, 1, 1, 0}, .period = S, .horizon = 3 * S};

    static const double set = 1.0;
    const struct apc_scheduler_setpoint r = {"r", 1, 65536};
    const struct apc_scheduler_options scheduler = {
        .size = sizeof(scheduler), .nz = 1, .z = &r, .steps = 1, .sequence = &set, .period = S};

    *l = (struct loop){0};
    if (apc_plant_create(&l->plant, &apc_model_first_order, NULL, NULL, NULL, NULL) < 0)
        return -1;
    server.plant = l->plant;
    if (n >= 0)
        fail_at = allocations + n;
    rc = apc_plantserver_create(&l->server, &server, NULL);
    if (rc == 0)
        rc = apc_client_create(&l->client, &client, NULL);
    if (rc == 0)
        rc = apc_controller_create(&l->controller, &controller, NULL);
    if (rc == 0)
        rc = apc_scheduler_create(&l->scheduler, &scheduler, NULL);
    if (rc == 0) {
        l->in = apc_controller_in(l->controller);
        l->out = apc_controller_out(l->controller);
    }
    fail_at = -1;
    return rc;
}

static void destroy(struct loop *l)
{
    apc_scheduler_destroy(l->scheduler);
    apc_controller_destroy(l->controller);
    apc_client_destroy(l->client);
    apc_plantserver_destroy(l->server);
    apc_plant_destroy(l->plant);
}

/* No cmocka in here: it allocates. */
static void one_second(struct loop *l, int k)
{
    const struct apc_now now = {.mono = k * S, .utc = T0 + k * S};
    struct apc_notice notice;
    struct apc_frame frame = {.id = 1};
    struct apc_value value;
    struct apc_sample y;
    int n;

    apc_scheduler_in(l->scheduler)->sample[0] = *rows_at(l->in, APC_SETPOINT, 1);
    l->failures += apc_scheduler_compute(l->scheduler, now, (uint64_t)k, 0, &notice) != 1;
    *rows_at(l->in, APC_SETPOINT, 1) = *apc_scheduler_out(l->scheduler)->sample;
    rows_at(l->in, APC_SETPOINT, 1)->seq = apc_scheduler_out(l->scheduler)->sample->seq = k + 1;
    l->failures += !apc_scheduler_update(l->scheduler, true);
    rows_feed(l->in, APC_OPMODE, 1, k / 100 % 3, now.utc); /* Man, Auto, OOS */
    rows_feed(l->in, APC_TUNING, 1, k % 2 ? 0.2 : (double)NAN, now.utc);
    l->failures += apc_plantserver_tick(l->server, now, &notice) < 0;
    apc_client_command(l->client, now, k % 50 < 40 ? &l->u : NULL, &value);
    frame.kind = apc_status_severity(value.status) == APC_SEVERITY_BAD ? APC_FRAME_QUERY : APC_FRAME_COMMAND;
    frame.n = frame.kind == APC_FRAME_COMMAND;
    n = apc_frame_encode(l->request, sizeof(l->request), &frame, &l->u);
    l->failures += n < 0;
    n = apc_plantserver_request(l->server, now, 1, l->request, (size_t)n, l->reply, sizeof(l->reply),
                                &notice);
    l->failures += n < 0;
    l->failures += apc_frame_decode(l->reply, (size_t)n, &frame, &y, 1) < 0;
    value = (struct apc_value){y.value, y.status, y.time};
    if (apc_client_measurements(l->client, &value, &y) == 1 && k % 30 < 20)
        *rows_at(l->in, APC_SENSOR, 1) = y;
    (void)apc_controller_compute(l->controller, now, (uint64_t)k, k % 70, &notice);
    if (l->out->n_samples > 0 && l->out->sample[0].table == APC_ACTUATOR)
        l->u = l->out->sample[0];
    apc_controller_update(l->controller, k % 9 - 7 <= 0 ? 1 : -1);
}

static void the_counter_counts(void **state)
{
    int before = allocations, before_held = held;
    void *volatile p;

    (void)state;
    if (!COUNTING)
        skip();
    p = malloc(1);
    assert_int_equal(held, before_held + 1);
    free(p);
    assert_int_equal(held, before_held);
    assert_true(allocations > before);
}

/* Promise(links/nothing-tick-allocates) */
static void ticks_do_not_allocate(void **state)
{
    struct loop l;
    int before, after;

    (void)state;
    if (!COUNTING)
        skip();
    assert_int_equal(make(&l, -1), 0);
    before = allocations;
    for (int k = 0; k < 1000; k++)
        one_second(&l, k);
    after = allocations;
    destroy(&l);
    assert_int_equal(l.failures, 0);
    assert_int_equal(after - before, 0);
}

/* One that latches, and those of a controller that stops and that misses ticks: raised, acknowledged and
 * reset, shelved and taken out, and requests that are refused. */
static const struct apc_alarm watched[] = {
    {.name = "y.high",
     .kind = APC_ALARM_HIGH,
     .table = APC_SENSOR,
     .id = 1,
     .limit = 1,
     .priority = 1,
     .latching = true},
    {.name = "base.stopped",
     .kind = APC_ALARM_STOPPED,
     .table = APC_TICK,
     .id = 1,
     .horizon = 3 * S,
     .priority = 2,
     .suppression = {.alarm = 1, .hold = S}},
    {.name = "base.overrun",
     .kind = APC_ALARM_OVERRUN,
     .table = APC_TICK,
     .id = 1,
     .limit = 1,
     .priority = 3},
};

static int make_alarms(struct apc_alarms **alarms)
{
    const struct apc_alarms_options options = {.size = sizeof options, .n = 3, .alarm = watched, .number = 2};
    return apc_alarms_create(alarms, &options, NULL);
}

struct alarmed {
    int transitions, refused;
};

/* No cmocka in here either. Rows that it reads are rewritten in place: what a request is of is its table's id. */
static void one_second_of_alarms(struct apc_alarms *alarms, int k, struct alarmed *seen)
{
    const struct apc_now now = {.mono = k * S, .utc = T0 + k * S};
    struct apc_notice notice;
    const struct apc_rows *in = apc_alarms_in(alarms);
    for (size_t i = 0; i < in->n_samples; i++) {
        struct apc_sample *s = &in->sample[i];
        const bool acknowledges = s->id == apc_alarm_switch_id(APC_ALARM_ACK, 1),
                   shelves = s->id == apc_alarm_switch_id(APC_ALARM_SHELF, 1);
        if (s->table == APC_OPMODE && k % 7 != (int)i)
            continue;
        s->seq++;
        s->time = now.utc;
        s->status = APC_GOOD;
        s->value = s->table == APC_SENSOR ? k / 5 % 2 * 2
                   : acknowledges         ? k / 2
                   : shelves              ? apc_ns_to_s(T0) + k + k % 2 * 5
                                          : k / 20 % 2;
    }
    in->vector[0].seq += k / 10 % 2;
    in->vector[0].time = now.utc;
    in->vector[1].seq++;
    in->vector[1].n = APC_TICK_INDEX_AT + 1;
    in->vector[1].value[APC_TICK_INDEX_AT] = k + k / 20;
    seen->transitions += apc_alarms_compute(alarms, now, &notice);
    seen->refused += notice.kind == APC_NOTICE_REJECTED;
    apc_alarms_stored(alarms);
}

static void alarms_do_not_allocate(void **state)
{
    struct apc_alarms *alarms;
    struct alarmed seen = {0};
    int before, after;

    (void)state;
    if (!COUNTING)
        skip();
    assert_int_equal(make_alarms(&alarms), 0);
    apc_alarms_resume(alarms);
    before = allocations;
    for (int k = 1; k <= 1000; k++)
        one_second_of_alarms(alarms, k, &seen);
    after = allocations;
    apc_alarms_destroy(alarms);
    assert_int_equal(after - before, 0);
    assert_true(seen.transitions > 100);
    assert_true(seen.refused > 10);
}

static void whichever_allocation_fails_alarms_say_so(void **state)
{
    struct apc_alarms *alarms;
    int rc, n = -1;

    (void)state;
    if (!COUNTING)
        skip();
    do {
        int before = held;

        failed = 0;
        fail_at = allocations + ++n;
        rc = make_alarms(&alarms);
        fail_at = -1;
        apc_alarms_destroy(alarms);
        assert_int_equal(rc, failed ? APC_ENOMEM : 0);
        assert_int_equal(held, before);
    } while (rc < 0);
    assert_in_range(n, 2, 20);
}

/* All that apc-controller does in a tick: read, compute, append, update. Returns how many rows it wrote. */
static int live_tick(struct apc_store *store, struct apc_controller *controller, int k)
{
    struct apc_notice notice;
    int written, rc = apc_store_read_rows(store, apc_controller_in(controller));

    (void)apc_controller_compute(controller, (struct apc_now){.mono = k * S, .utc = T0 + k * S}, (uint64_t)k,
                                 rc == 0, &notice);
    written = apc_store_append_rows(store, apc_controller_out(controller));
    apc_controller_update(controller, written);
    return written;
}

/* Promise(links/nothing-tick-allocates) */
static void a_tick_through_the_live_store_does_not_allocate(void **state)
{
    enum { N = 10, WARM = 5, TICKS = 100 };
    const struct apc_controller_options o = {
        .size = sizeof(o), .law = &apc_law_pi, .dim = {N, N, N, 0}, .period = S, .horizon = 3 * S};
    struct apc_controller *controller;
    struct apc_sample y[3 * N];
    struct apc_store *store;
    char uri[64], path[64];
    int before = 0;

    (void)state;
    if (!COUNTING)
        skip();
    snprintf(uri, sizeof(uri), "shm:test-tick-%d?size=8", (int)getpid());
    snprintf(path, sizeof(path), "/dev/shm/apc.test-tick-%d", (int)getpid());
    assert_int_equal(apc_store_open(&store, uri, NULL, NULL), 0);
    assert_int_equal(apc_store_init(store), 0);
    assert_int_equal(apc_controller_create(&controller, &o, NULL), 0);
    for (int k = 1; k <= WARM + TICKS; k++) {
        for (int i = 0; i < 3 * N; i++)
            y[i] = (struct apc_sample){.table = i < N       ? APC_SENSOR
                                                : i < 2 * N ? APC_SETPOINT
                                                            : APC_OPMODE,
                                       .id = i % N + 1,
                                       .seq = k,
                                       .time = T0 + k * S,
                                       .value = i < 2 * N ? 0.1 * k : (double)APC_MODE_AUTO};
        assert_int_equal(apc_store_append(store, y, 3 * N), 3 * N);
        if (k == WARM + 1)
            before = allocations;
        assert_true(live_tick(store, controller, k) > N); /* the outputs, and the tick row */
    }
    assert_int_equal(allocations - before, 0);
    apc_controller_destroy(controller);
    apc_store_close(store);
    unlink(path);
}

static void whichever_allocation_fails_creation_says_so(void **state)
{
    struct loop l;
    int rc, n = -1;

    (void)state;
    if (!COUNTING)
        skip();
    do {
        int before = held;

        failed = 0;
        rc = make(&l, ++n);
        destroy(&l);
        assert_int_equal(rc, failed ? APC_ENOMEM : 0); /* none is passed over */
        assert_int_equal(held, before);
    } while (rc < 0);
    assert_in_range(n, 8, 100);
}

/* Laws that make constants, and the largest of them through some ticks. */
static void whichever_allocation_fails_a_configured_law_says_so(void **state)
{
    static const double A = -1.0, one = 1.0, nought = 0.0;
    static const struct apc_law_plant plant = {
        .nx = 1, .A = &A, .B = &one, .C = &one, .D = &nought, .x0 = &nought, .u0 = &nought, .y0 = &nought};
    static const struct apc_law *const laws[] = {&apc_law_pid, &apc_law_lqg, &apc_law_cascade};

    (void)state;
    if (!COUNTING)
        skip();
    for (size_t i = 0; i < sizeof(laws) / sizeof(laws[0]); i++) {
        const struct apc_controller_options o = {.size = sizeof(o),
                                                 .law = laws[i],
                                                 .dim = {laws[i] == &apc_law_cascade ? 2 : 1, 1, 1, 0},
                                                 .period = S,
                                                 .horizon = 3 * S,
                                                 .plant = &plant};
        struct apc_controller *controller;
        struct apc_notice notice;
        int rc, before, at_first, n = -1;

        do {
            at_first = held;
            failed = 0;
            fail_at = allocations + ++n;
            rc = apc_controller_create(&controller, &o, NULL);
            fail_at = -1;
            assert_int_equal(rc, failed ? APC_ENOMEM : 0); /* none is passed over */
            assert_int_equal(held > at_first, rc == 0);
        } while (rc < 0);
        assert_in_range(n, 5, 100);
        before = allocations;
        for (int k = 1; k < 100; k++) {
            const struct apc_rows *in = apc_controller_in(controller);

            for (size_t j = 0; j < o.dim.ny; j++)
                rows_feed(in, APC_SENSOR, (int)j + 1, 0.01 * k, T0 + k * S);
            rows_feed(in, APC_SETPOINT, 1, 0.01 * k, T0 + k * S);
            rows_feed(in, APC_OPMODE, 1, APC_MODE_AUTO, T0 + k * S);
            (void)apc_controller_compute(controller, (struct apc_now){.mono = k * S, .utc = T0 + k * S},
                                         (uint64_t)k, true, &notice);
            apc_controller_update(controller, 1);
        }
        assert_int_equal(allocations - before, 0);
        apc_controller_destroy(controller);
        assert_int_equal(held, at_first);
    }
}

/* x' = -x + z + d, 0 = z + z^3 - x - u. */
static int algebraic_f(double t, const double *x, const double *u, const double *p, double *dx)
{
    (void)t, (void)p;
    dx[0] = -x[0] + x[1] + u[2];
    return 0;
}

static int algebraic_residual(double t, const double *x, const double *u, const double *p, double *r)
{
    (void)t, (void)p;
    r[0] = x[1] + x[1] * x[1] * x[1] - x[0] - u[0];
    return 0;
}

static void algebraic_g(double t, const double *x, const double *u, const double *p, double *y)
{
    (void)t, (void)u, (void)p;
    y[0] = x[0];
    y[1] = x[1];
}

static const struct apc_model algebraic = {.abi = APC_MODEL_ABI,
                                           .name = "algebraic",
                                           .nx = 1,
                                           .nz = 1,
                                           .nu = 2,
                                           .nd = 1,
                                           .ny = 2,
                                           .f = algebraic_f,
                                           .residual = algebraic_residual,
                                           .g = algebraic_g};

/* A plant with everything that a file can ask for: noise, faults, disturbances, dead time. */
static int make_plant(struct loop *l, const char *integrator, int n)
{
    static const struct apc_sensor_fault fault = {.kind = APC_FAULT_DRIFT, .at = S, .size = 0.1};
    static const struct apc_sensor sensor[2] = {{.noise = 1.0, .quantum = 0.1},
                                                {.fault = &fault, .n_faults = 1}};
    static const struct apc_disturbance change = {.at = 3 * S / 2, .value = 15.0};
    static const double noise[4] = {0.1, 0.1, 0.1, 0.1};
    const struct apc_plant_options plant = {
        .size = sizeof(plant), .integrator = integrator, .dead_time = 0.7};
    struct apc_plantserver_options o = {.size = sizeof(o),
                                        .link_period = S,
                                        .command_period = S,
                                        .noise = noise,
                                        .sensor = sensor,
                                        .disturbance = &change,
                                        .n_disturbances = 1};
    void *handle;
    int rc = apc_model_find("temperature-lab", &o.model, &handle, NULL);

    if (strcmp(integrator, "ida") == 0)
        o.model = &algebraic;
    *l = (struct loop){0};
    if (n >= 0)
        fail_at = allocations + n;
    if (rc == 0)
        rc = apc_plant_create(&l->plant, o.model, NULL, NULL, &plant, NULL);
    o.plant = l->plant;
    if (rc == 0)
        rc = apc_plantserver_create(&l->server, &o, NULL);
    fail_at = -1;
    return rc;
}

static void no_integrator_allocates_in_a_tick(void **state)
{
    static const char *const integrators[] = {"cvode", "adams", "rk4", "exact", "ida"};

    (void)state;
    if (!COUNTING)
        skip();
    for (size_t i = 0; i < 5; i++) {
        struct loop l;
        double u[2] = {0.0, 0.0};
        int before, at_first = held, failures = 0;

        assert_int_equal(make_plant(&l, integrators[i], -1), 0);
        before = allocations;
        for (int k = 0; k < 100; k++) {
            const struct apc_now now = {.mono = k * S / 5, .utc = T0 + k * S / 5};

            u[0] = k % 7;
            failures += apc_plant_advance(l.plant, 0.1, u) < 0;
            failures += apc_plantserver_tick(l.server, now, NULL) < 0;
        }
        assert_int_equal(allocations - before, 0);
        assert_int_equal(failures, 0);
        destroy(&l);
        assert_int_equal(held, at_first);
    }
}

static void whichever_allocation_fails_a_plant_says_so(void **state)
{
    static const char *const integrators[] = {"rk4", "exact"}; /* SUNDIALS does not survive its own */

    (void)state;
    if (!COUNTING)
        skip();
    for (size_t i = 0; i < 2; i++) {
        struct loop l;
        int rc, n = -1;

        do {
            int before = held;

            failed = 0;
            rc = make_plant(&l, integrators[i], ++n);
            destroy(&l);
            assert_int_equal(rc, failed ? APC_ENOMEM : 0); /* none is passed over */
            assert_int_equal(held, before);
        } while (rc < 0);
        assert_in_range(n, 8, 100);
    }
}

/* What is refused, and questions about a model, leave nothing behind either. */
static void what_is_refused_or_asked_leaves_nothing_behind(void **state)
{
    static const double wild = 1e300, no_delay = -1.0, A = 1.0, nought = 0.0;
    static const struct apc_law_plant unreached = {
        .nx = 1, .A = &A, .B = &nought, .C = &A, .D = &nought, .x0 = &nought, .u0 = &nought, .y0 = &nought};
    static const struct apc_controller_loop beyond = {.id = 1, .mode = 1, .high = 1.0, .fault = 1e300};
    static const struct apc_setting setting = {"delay", NULL, 1, 1, &no_delay};
    static const char *const integrators[] = {"cvode", "adams", "rk4", "exact", "none"};
    const struct apc_model *tanks = NULL;
    struct apc_controller_options c = {.size = sizeof(c),
                                       .law = &apc_law_lqg,
                                       .dim = {1, 1, 1, 0},
                                       .period = S,
                                       .horizon = 3 * S,
                                       .plant = &unreached};
    struct apc_plantserver_options o = {
        .size = sizeof(o), .link_period = S, .command_period = S, .safe = &wild, .high = &A};
    struct apc_controller *controller;
    struct apc_plant *plant;
    struct apc_plantserver *server;
    double x[4] = {10, 10, 10, 10}, a[16], b[16], P, K;
    void *handle;
    int before;

    (void)state;
    if (!COUNTING)
        skip();
    assert_int_equal(apc_model_find("quadruple-tank", &tanks, &handle, NULL), 0);
    before = held;
    assert_true(apc_controller_create(&controller, &c, NULL) < 0);
    c.n_setting = 1;
    c.setting = &setting;
    assert_true(apc_controller_create(&controller, &c, NULL) < 0);
    c = (struct apc_controller_options){.size = sizeof(c),
                                        .law = &apc_law_pid,
                                        .dim = {1, 1, 1, 0},
                                        .period = S,
                                        .horizon = S,
                                        .loop = &beyond};
    assert_true(apc_controller_create(&controller, &c, NULL) < 0);
    for (size_t i = 0; i < 5; i++) {
        const struct apc_plant_options options = {.size = sizeof(options), .integrator = integrators[i]};

        if (apc_plant_create(&plant, tanks, NULL, NULL, &options, NULL) < 0) {
            assert_true(i >= 3);
            continue;
        }
        o.plant = plant;
        o.model = tanks;
        assert_true(apc_plantserver_create(&server, &o, NULL) < 0);
        apc_plant_destroy(plant);
    }
    assert_int_equal(apc_model_equilibrium(tanks, NULL, NULL, x, NULL), 0);
    assert_int_equal(apc_model_linearize(tanks, NULL, x, NULL, a, b, NULL, NULL, NULL), 0);
    assert_true(apc_model_linearize(tanks, &wild, x, NULL, a, b, NULL, NULL, NULL) < 0);
    assert_true(apc_model_linearize(tanks, NULL, &wild, NULL, a, b, NULL, NULL, NULL) < 0);
    assert_int_equal(apc_linear_sample(1, 1, &A, &A, 1.0, a, b, NULL), 0);
    assert_int_equal(apc_riccati_solve(1, 1, &A, &A, &A, &A, &P, &K, NULL), 0);
    assert_true(apc_riccati_solve(1, 1, &A, &nought, &A, &A, &P, &K, NULL) < 0);
    assert_int_equal(held, before);
}

static int answer(void *ctx, uint64_t connection, const char *request, size_t length, char *reply,
                  size_t size)
{
    struct apc_frame frame;
    struct apc_sample value = {.value = 1.0};

    (void)ctx, (void)connection;
    if (apc_frame_decode(request, length, &frame, &value, 1) < 0)
        return APC_EPROTO;
    frame.kind = APC_FRAME_VALUES;
    frame.n = 1;
    return apc_frame_encode(reply, size, &frame, &value);
}

/* Of an exchange over inproc:, which is given up when the executive has nothing more to do. */
static int exchange(struct apc_exchange *x, struct apc_executive *e, const struct apc_value *u,
                    struct apc_value *y)
{
    apc_ns deadline = apc_clock_mono(apc_executive_clock(e)) + S;
    int rc = apc_exchange_begin(x, u, deadline);

    if (rc < 0)
        return rc;
    apc_virtual_run(e, deadline);
    return apc_exchange_finish(x, y);
}

/* Closed with frames under way; without memory an exchange fails or times out. */
static void whichever_allocation_fails_an_exchange_says_so_and_gives_all_back(void **state)
{
    const struct apc_value u = {.value = 1.0};
    int done = 0, n = -1;

    (void)state;
    if (!COUNTING)
        skip();
    while (!done) {
        struct apc_executive *e;
        struct apc_exchange *x = NULL;
        struct apc_inproc_options inproc = {
            .size = sizeof(inproc),
            .network = {.duplication = 1.0, .delay = {.kind = APC_CONSTANT, .a = 0.25}},
            .serve = answer};
        const struct apc_exchange_options o = {.size = sizeof(o), .nu = 1, .ny = 1, .inproc = &inproc};
        struct apc_value y;
        int before = held, rc;

        assert_int_equal(apc_executive_create(&e, "virtual", NULL, NULL), 0);
        inproc.executive = e;
        failed = 0;
        fail_at = allocations + ++n;
        rc = apc_exchange_open(&x, "inproc:", &o, NULL);
        assert_int_equal(rc, failed ? APC_ENOMEM : 0);
        assert_int_equal(x != NULL, rc == 0);
        if (rc == 0) {
            rc = exchange(x, e, &u, &y);
            assert_true(failed ? rc == APC_ENOMEM || rc == APC_ETIMEDOUT || rc == 0 : rc == 0);
            done = !failed;
            fail_at = -1;
            assert_int_equal(apc_exchange_begin(x, &u, INT64_MAX), 0);
        }
        fail_at = -1;
        apc_exchange_close(x);
        assert_int_equal(apc_executive_destroy(e), 0);
        assert_int_equal(held, before);
    }
    assert_in_range(n, 8, 100);
}

/* Promise(links/nothing-tick-allocates) */
static void exchanges_do_not_allocate(void **state)
{
    struct apc_executive *e;
    struct apc_server *server;
    struct apc_exchange *inproc, *tcp;
    struct apc_inproc_options virtual = {.size = sizeof(virtual), .serve = answer};
    struct apc_exchange_options o = {.size = sizeof(o), .nu = 1, .ny = 1, .inproc = &virtual};
    struct apc_value u = {.value = 1.0}, y;
    char uri[64];
    int failures = 0, before = 0;

    (void)state;
    if (!COUNTING)
        skip();
    assert_int_equal(apc_executive_create(&e, "virtual", NULL, NULL), 0);
    virtual.executive = e;
    assert_int_equal(apc_exchange_open(&inproc, "inproc:", &o, NULL), 0);
    assert_int_equal(apc_server_create(&server, "tcp:127.0.0.1:0", NULL, answer, NULL, NULL), 0);
    snprintf(uri, sizeof(uri), "tcp:127.0.0.1:%d", apc_server_port(server));
    o.inproc = NULL;
    assert_int_equal(apc_exchange_open(&tcp, uri, &o, NULL), 0);
    for (int k = 0; k < 100; k++) {
        u.status = k % 3 ? APC_GOOD : APC_BAD;
        failures += exchange(inproc, e, &u, &y) < 0;
        failures += apc_exchange_begin(tcp, &u, apc_clock_mono(NULL) + 20 * S) < 0;
        failures += apc_exchange_finish(tcp, &y) < 0;
        if (k == 3) /* its busiest moment is over */
            before = allocations;
    }
    assert_int_equal(allocations - before, 0);
    assert_int_equal(failures, 0);
    apc_exchange_close(tcp);
    apc_server_destroy(server);
    apc_exchange_close(inproc);
    apc_executive_destroy(e);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(the_counter_counts),
        cmocka_unit_test(ticks_do_not_allocate),
        cmocka_unit_test(a_tick_through_the_live_store_does_not_allocate),
        cmocka_unit_test(alarms_do_not_allocate),
        cmocka_unit_test(whichever_allocation_fails_alarms_say_so),
        cmocka_unit_test(whichever_allocation_fails_creation_says_so),
        cmocka_unit_test(whichever_allocation_fails_a_configured_law_says_so),
        cmocka_unit_test(no_integrator_allocates_in_a_tick),
        cmocka_unit_test(whichever_allocation_fails_a_plant_says_so),
        cmocka_unit_test(what_is_refused_or_asked_leaves_nothing_behind),
        cmocka_unit_test(whichever_allocation_fails_an_exchange_says_so_and_gives_all_back),
        cmocka_unit_test(exchanges_do_not_allocate),
    };

    return cmocka_run_group_tests(tests, NULL, NULL);
}

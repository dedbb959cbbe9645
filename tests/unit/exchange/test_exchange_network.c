/* SPDX-License-Identifier: BSD-3-Clause */
/*
 * A loop that is closed over the modelled network, against theory: TrueTime's servo, 1000 / (s (s + 1)),
 * under PD control (K 1, Td 0.04, N 100) every 10 ms. The sensor sends y over inproc: to the
 * controller, whose reply is the new u: from measuring to acting it takes both ways' delay, and nothing else.
 * Overshoot 3.9, 8.9 and 22.8 % at 0, 4 and 8 ms; unstable above about 13.8 ms.
 */
#include "check.h"

#include <apcexchange.h>
#include <apcplant.h>

#define H    (10 * APC_NS_PER_MS)
#define FINE (APC_NS_PER_MS / 10) /* between two looks at y */

struct loop {
    struct apc_executive *e;
    const struct apc_clock *clock;
    struct apc_plant *plant;
    struct apc_exchange *x[2]; /* in turn: a delay may exceed the period, and there is one at a time */
    apc_ns advanced;
    double u, y_old, derivative;
    double apart; /* the largest of y - 1 since it was last looked at */
    double peak;  /* of y */
};

/* The plant up to now, with the input that it has had. */
static double measure(struct loop *l)
{
    apc_ns now = apc_clock_mono(l->clock);
    double y;
    assert_int_equal(apc_plant_advance(l->plant, apc_ns_to_s(now - l->advanced), &l->u), 0);
    l->advanced = now;
    apc_plant_output(l->plant, &l->u, &y);
    l->peak = fmax(l->peak, y);
    l->apart = fmax(l->apart, fabs(y - 1.0));
    return y;
}

static int look(void *ctx, const struct apc_tick *tick)
{
    (void)tick;
    measure(ctx);
    return 0;
}

/* The controller: PD with a filtered derivative of the measurement, by backward differences. It has the place
 * of the plant here: the measurement comes, and the new input is the answer. */
static int serve(void *ctx, uint64_t connection, const char *request, size_t length, char *reply, size_t size)
{
    const double K = 1.0, Td = 0.04, N = 100.0, h = 0.01, a = Td / (N * h + Td),
                 b = N * K * Td / (N * h + Td);
    struct loop *l = ctx;
    struct apc_frame frame;
    struct apc_sample value;
    (void)connection;
    assert_int_equal(apc_frame_decode(request, length, &frame, &value, 1), 0);
    const double y = value.value;
    l->derivative = a * l->derivative + b * (l->y_old - y);
    l->y_old = y;
    value.value = K * (1.0 - y) + l->derivative;
    frame.kind = APC_FRAME_VALUES;
    return apc_frame_encode(reply, size, &frame, &value);
}

static void act(struct loop *l, struct apc_exchange *x)
{
    struct apc_value u;
    assert_int_equal(apc_exchange_finish(x, &u), 0);
    measure(l);
    l->u = u.value;
}

static void act_on_even(void *ctx)
{
    struct loop *l = ctx;
    act(l, l->x[0]);
}

static void act_on_odd(void *ctx)
{
    struct loop *l = ctx;
    act(l, l->x[1]);
}

static int sample(void *ctx, const struct apc_tick *tick)
{
    struct loop *l = ctx;
    const struct apc_value y = {.value = measure(l)};
    return apc_exchange_begin(l->x[tick->index % 2], &y, apc_clock_mono(l->clock) + 10 * H);
}

static struct apc_task *start(struct loop *l, const char *name, apc_ns period, apc_task_fn fn)
{
    const struct apc_task_options options = {.size = sizeof options, .name = name, .period = period};
    struct apc_task *task;
    assert_int_equal(apc_task_create(l->e, &options, fn, l, &task, NULL), 0);
    assert_int_equal(apc_task_start(task, NULL), 0);
    return task;
}

/* Ten seconds with a constant delay from measuring to acting. Returns the peak of y; *growth is by how much
 * the swings of the last second exceed those of five seconds before. */
static double run(double delay_s, double *growth)
{
    const struct apc_model *servo;
    void *handle;
    struct loop l = {.u = 0};
    double before = 0;
    const struct apc_plant_options exact = {.size = sizeof exact, .integrator = "exact"};
    struct apc_error why = {""};

    assert_int_equal(apc_executive_create(&l.e, "virtual", NULL, NULL), 0);
    l.clock = apc_executive_clock(l.e);
    l.advanced = apc_clock_mono(l.clock);
    assert_int_equal(apc_model_find("servo", &servo, &handle, NULL), 0);
    if (apc_plant_create(&l.plant, servo, NULL, NULL, &exact, &why) < 0)
        fail_msg("%s", why.text);
    struct apc_inproc_options inproc = {.size = sizeof inproc,
                                        .executive = l.e,
                                        .network = {.delay = {.kind = APC_CONSTANT, .a = delay_s / 2}},
                                        .serve = serve,
                                        .serve_ctx = &l,
                                        .done_ctx = &l};
    const struct apc_exchange_options options = {.size = sizeof options, .nu = 1, .ny = 1, .inproc = &inproc};
    for (int i = 0; i < 2; i++) {
        inproc.done = i ? act_on_odd : act_on_even;
        if (apc_exchange_open(&l.x[i], "inproc:", &options, &why) < 0)
            fail_msg("%s", why.text);
    }
    struct apc_task *sensor = start(&l, "sensor", H, sample), *eye = start(&l, "eye", FINE, look);
    for (int second = 0; second < 10; second++) {
        l.apart = 0;
        assert_true(apc_virtual_run(l.e, apc_clock_mono(l.clock) + APC_NS_PER_S) > 0);
        before = second == 4 ? l.apart : before;
    }
    assert_int_equal(apc_task_wait(sensor, 0, NULL), APC_ETIMEDOUT); /* it goes on: no exchange was refused */
    *growth = l.apart / before;
    apc_task_destroy(sensor);
    apc_task_destroy(eye);
    apc_exchange_close(l.x[0]);
    apc_exchange_close(l.x[1]);
    apc_plant_destroy(l.plant);
    apc_executive_destroy(l.e);
    return l.peak;
}

/*
 * Promise(simulation/virtual-loops-overshoot): Virtual loops have the overshoot and stability limit that
 *   theory gives.
 */
static void overshoot_grows_with_delay_as_computed(void **state)
{
    double growth;
    (void)state;
    assert_near(100 * (run(0, &growth) - 1), 3.9, 0.05);
    assert_near(100 * (run(0.004, &growth) - 1), 8.9, 0.05);
    assert_near(100 * (run(0.008, &growth) - 1), 22.8, 0.05);
}

/* Promise(simulation/virtual-loops-overshoot) */
static void the_loop_is_stable_up_to_the_delay_computed(void **state)
{
    double growth, low = 0.008, high = 0.02;
    (void)state;
    while (high - low > 1e-5) {
        double delay = (low + high) / 2;
        run(delay, &growth);
        *(growth > 1 ? &high : &low) = delay;
    }
    assert_near(low, 0.0138, 0.0001);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(overshoot_grows_with_delay_as_computed),
        cmocka_unit_test(the_loop_is_stable_up_to_the_delay_computed),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}

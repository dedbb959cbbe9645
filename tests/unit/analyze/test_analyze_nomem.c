/* SPDX-License-Identifier: BSD-3-Clause */
/* No memory for a loop or for what is asked of it, at each place that asks for some: it is said, nothing is
 * there, and nothing is left behind.
 */
#include "apcanalysis.h"
#include "apcbase.h"
#include "check.h"

#include <stdio.h>

#include "nomem.h"

#define MS ((apc_ns)1000000)

enum { STATES = 20 }; /* at most */

static struct apc_error why;
static struct apc_loop
    *loop; /* integrators, each with a loop of its own; the second's is read by the first */

static const double zero[4], eye[4] = {1.0, 0.0, 0.0, 1.0};
static const double first_D[] = {-0.4, 0.1}, second_A = 0.2, second_B = 1.0, second_C = -0.1, second_D = -0.3;
static const struct apc_loop_source first_in[] = {{APC_FROM_MEASUREMENT, 0}, {APC_FROM_OUTPUT, 1}},
                                    second_in = {APC_FROM_MEASUREMENT, 1};
static const size_t first_to = 0, second_to = 1;
static const struct apc_loop_controller controllers[] = {
    {.n_in = 2, .nu = 1, .D = first_D, .in = first_in, .to = &first_to},
    {.nx = 1,
     .n_in = 1,
     .nu = 1,
     .A = &second_A,
     .B = &second_B,
     .C = &second_C,
     .D = &second_D,
     .in = &second_in,
     .to = &second_to}};
static const struct apc_loop_tick tick[] = {{0, 0, 10 * MS, 10 * MS, 20 * MS},
                                            {1, 0, 500 * MS, 500 * MS, 1600 * MS}};
static const struct apc_loop_setup setup = {.size = sizeof setup,
                                            .plant = {.nx = 2,
                                                      .nu = 2,
                                                      .ny = 2,
                                                      .A = zero,
                                                      .B = eye,
                                                      .C = eye,
                                                      .D = zero,
                                                      .period = 500 * MS,
                                                      .noise = eye},
                                            .n_controllers = 2,
                                            .controller = controllers,
                                            .period = 1000 * MS,
                                            .n_ticks = 2,
                                            .tick = tick};

static int create(void)
{
    struct apc_loop *made = (struct apc_loop *)&why;
    const int rc = apc_loop_create(&made, &setup, &why);

    assert_int_equal(rc == 0, made != NULL);
    apc_loop_destroy(made);
    return rc;
}

static int count(void)
{
    return apc_loop_states(loop) > 0 ? 0 : APC_ENOMEM;
}

static int poles(void)
{
    double re[STATES], im[STATES];

    return apc_loop_poles(loop, re, im);
}

static int respond(void)
{
    const double w = 1.0;
    double re, im;

    return apc_loop_response(loop, 0, 1, &w, &re, &im);
}

static int bound(size_t of, int (*find)(const struct apc_loop *, size_t, const double *,
                                        struct apc_loop_margins *, struct apc_error *))
{
    const struct apc_loop_margins before = {.size = sizeof before, .gain = -1.0};
    struct apc_loop_margins m = before;
    const int rc = find(loop, of, NULL, &m, &why);

    assert_int_equal(rc == 0, m.stable);
    if (rc < 0) /* as it was */
        assert_near(m.gain, -1.0, 0.0);
    return rc;
}

static int margins(void)
{
    return bound(1, apc_loop_margins);
}

static int margins_of_all(void)
{
    return bound(APC_LOOP_WHOLE, apc_loop_margins);
}

static int peaks(void)
{
    return bound(0, apc_loop_peaks);
}

static int cost(void)
{
    const struct apc_loop_schedule half[] = {{0.5, 2, tick}, {0.5, 1, tick}};
    double y[2], u[2];

    return apc_loop_cost(loop, half, 2, y, u, &why);
}

static void each_allocation_may_fail(void **state)
{
    static const struct nomem_step steps[] = {
        {"create", create, false},   {"states", count, true},     {"poles", poles, true},
        {"response", respond, true}, {"margins", margins, false}, {"margins of all", margins_of_all, false},
        {"peaks", peaks, false},     {"cost", cost, false}};
    (void)state;
    assert_int_equal(apc_loop_create(&loop, &setup, NULL), 0);
    assert_true(apc_loop_states(loop) <= STATES);
    for (size_t i = 0; i < sizeof steps / sizeof *steps; i++)
        nomem_each(&steps[i], 60, 37, &why); /* a search asks for the same again and again */
    apc_loop_destroy(loop);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(each_allocation_may_fail),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}

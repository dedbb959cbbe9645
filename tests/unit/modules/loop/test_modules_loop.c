/* SPDX-License-Identifier: BSD-3-Clause */
/*
 * The paper's experiment, 600 s of it, with the four cores in the design's time order and a store and a
 * wire that are nothing but memory, against the same experiment written out below with no library code.
 */
#include "check.h"

#include "apcmodules.h"
#include "apcsockets.h"

#include <string.h>

#define S     APC_NS_PER_S
#define MS    APC_NS_PER_MS
#define T0    (INT64_C(1700000000) * S)
#define END   (600 * S)
#define TICKS 3001

static const double sequence[] = {10.0, 20.0, 5.0, 15.0};

/* ---- Reference ------------------------------------------------------------------------------- */

/* y at each plant tick. Integer milliseconds; scheduler, plant, client, controller where ticks coincide. */
static void reference(double y[TICKS])
{
    const double a = exp(-0.2 / 10.0);
    double x = 0.0, applied = 0.0, received = 0.0; /* at the plant */
    double published = 0.0;
    double measured = 0.0, u = 0.0, I = 0.0, z = 0.0; /* in the shared data */
    int have_u = 0, k = 0;

    for (int ms = 0; ms <= 600000; ms += 10) {
        if (ms % 150000 == 0)
            z = sequence[ms / 150000 < 4 ? ms / 150000 : 3];
        if (ms % 200 == 0) {
            if (ms > 0)
                x = a * x + (1.0 - a) * 10.0 * applied;
            published = x;
            applied = received;
            y[k++] = published;
        }
        if (ms % 500 == 10) {
            if (have_u)
                received = u;
            measured = published;
        }
        if (ms % 2000 == 30) {
            double e = z - measured;

            u = 0.2 * e + I;
            I += 0.2 * 2.0 / 10.0 * e;
            have_u = 1;
        }
    }
}

/* ---- The cores ------------------------------------------------------------------------------- */

struct loop {
    struct apc_plant *plant;
    struct apc_plantserver *server;
    struct apc_client *client;
    struct apc_controller *controller;
    struct apc_scheduler *scheduler;
    struct apc_sample *in; /* what the controller reads: y first, z second, mode third */
    struct apc_sample u;
    uint64_t ticks;
    struct apc_notice notice;
    int warnings;
};

static void make(struct loop *l)
{
    const struct apc_plantserver_options server = {.size = sizeof(server),
                                                   .plant = l->plant,
                                                   .model = &apc_model_first_order,
                                                   .link_period = 500 * MS,
                                                   .command_period = 2 * S};
    const struct apc_client_options client = {
        .size = sizeof(client), .ny = 1, .nu = 1, .command_period = 2 * S};
    const struct apc_controller_options controller = {.size = sizeof(controller),
                                                      .law = &apc_law_pi,
                                                      .dim = {1, 1, 1, 0},
                                                      .period = 2 * S,
                                                      .horizon = 1600 * MS};

    const struct apc_scheduler_setpoint r = {"r", 1, 65536};
    const struct apc_scheduler_options steps = {
        .size = sizeof(steps), .nz = 1, .z = &r, .steps = 4, .sequence = sequence, .period = 150 * S};

    assert_int_equal(apc_scheduler_create(&l->scheduler, &steps, NULL), 0);
    assert_int_equal(apc_plantserver_create(&l->server, &server, NULL), 0);
    assert_int_equal(apc_client_create(&l->client, &client, NULL), 0);
    assert_int_equal(apc_controller_create(&l->controller, &controller, NULL), 0);
    l->in = apc_controller_in(l->controller)->sample;
    assert_int_equal(l->in[2].table, APC_OPMODE);
    l->in[2].seq = 1;
    l->in[2].value = APC_MODE_AUTO;
    l->in[2].status = APC_GOOD;
}

static void scheduler(struct loop *l, struct apc_now now)
{
    struct apc_rows *in = apc_scheduler_in(l->scheduler);
    struct apc_sample *out = apc_scheduler_out(l->scheduler)->sample;

    in->sample[0] = l->in[1];
    assert_int_equal(apc_scheduler_compute(l->scheduler, now, (uint64_t)(now.mono / (150 * S)), 0, NULL), 1);
    l->in[1] = *out;
    out->seq = ++l->in[1].seq;
    assert_true(apc_scheduler_update(l->scheduler, true));
}

/* One exchange of the two over a wire that is nothing but memory. */
static void client(struct loop *l, struct apc_now now)
{
    const bool known = l->u.seq > 0;
    struct apc_frame frame = {.kind = known ? APC_FRAME_COMMAND : APC_FRAME_QUERY, .n = known};
    char request[256], reply[256];
    struct apc_value u;
    struct apc_sample y;
    int n;

    apc_client_command(l->client, now, &l->u, &u);
    assert_int_equal(u.status, known ? APC_GOOD : APC_BAD_NO_DATA);
    n = apc_frame_encode(request, sizeof(request), &frame, &l->u);
    n = apc_plantserver_request(l->server, now, 1, request, (size_t)n, reply, sizeof(reply), &l->notice);
    assert_int_equal(apc_frame_decode(reply, (size_t)n, &frame, &y, 1), 0);
    if (apc_client_measurements(l->client, &(struct apc_value){y.value, y.status, y.time}, &y) == 1)
        l->in[0] = y;
}

static void controller(struct loop *l, struct apc_now now)
{
    const struct apc_rows *out = apc_controller_out(l->controller);

    assert_in_range(apc_controller_compute(l->controller, now, l->ticks++, true, &l->notice), 2, 4);
    assert_int_equal(out->sample[0].table, APC_ACTUATOR);
    assert_int_equal(out->sample[0].status, APC_GOOD);
    l->u = out->sample[0];
    apc_controller_update(l->controller, 1);
}

static void note(struct loop *l)
{
    if (l->notice.kind != APC_NOTICE_NONE && l->notice.kind != APC_NOTICE_MODE &&
        l->notice.kind != APC_NOTICE_RESUMED)
        l->warnings++;
    l->notice.kind = APC_NOTICE_NONE;
}

/* Promise(run/virtual-time) */
static void the_four_cores_make_the_papers_experiment(void **state)
{
    static double expected[TICKS];
    struct loop l = {0};
    double worst = 0.0, highest = 0.0;
    int k = 0;

    (void)state;
    reference(expected);
    assert_int_equal(apc_plant_create(&l.plant, &apc_model_first_order, NULL, NULL, NULL, NULL), 0);
    make(&l);
    for (apc_ns t = 0; t <= END; t += 10 * MS) {
        const struct apc_now now = {.mono = t, .utc = T0 + t};

        if (t % (150 * S) == 0)
            scheduler(&l, now);
        if (t % (200 * MS) == 0) {
            assert_int_equal(apc_plantserver_tick(l.server, now, &l.notice), 0);
            note(&l);
            worst = fmax(worst, fabs(apc_plant_state(l.plant)[0] - expected[k++]));
            highest = fmax(highest, apc_plant_state(l.plant)[0]);
        }
        if (t % (500 * MS) == 10 * MS) {
            client(&l, now);
            note(&l);
        }
        if (t % (2 * S) == 30 * MS) {
            controller(&l, now);
            note(&l);
        }
    }
    print_message("largest difference %g, highest y %g\n", worst, highest);
    assert_int_equal(k, TICKS);
    assert_true(worst < 1e-5);
    assert_true(highest > 20.0);
    assert_near(apc_plant_state(l.plant)[0], 15.0, 1e-3);
    assert_int_equal(l.warnings, 0);
    apc_controller_destroy(l.controller);
    apc_scheduler_destroy(l.scheduler);
    apc_client_destroy(l.client);
    apc_plantserver_destroy(l.server);
    apc_plant_destroy(l.plant);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(the_four_cores_make_the_papers_experiment),
    };

    return cmocka_run_group_tests(tests, NULL, NULL);
}

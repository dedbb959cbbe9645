/* SPDX-License-Identifier: BSD-3-Clause */
#include "check.h"

#include "apcmodules.h"
#include "apcsockets.h"

#include <string.h>

#define S        APC_NS_PER_S
#define MS       APC_NS_PER_MS
#define T0       (INT64_C(1700000000) * S)
#define TICK     (200 * MS)
#define LINK     (500 * MS)
#define COMMAND  (2 * S)
#define STAMP(k) (T0 + (k)*APC_NS_PER_US) /* the wire carries microseconds */
/* The integrator leaves 1e-6; an instant wrong by 1 ms would show as 1e-3. */
#define CLOSE 1e-5
#define SAFE  (-0.3)

struct rig {
    uint64_t later; /* than 9: the frames' ids */
    struct apc_plant *plant;
    struct apc_plantserver *server;
    struct apc_notice notice;
    apc_ns utc_step; /* how far the clock of the day was put forward */
    char reply[256];
    struct apc_sample y;
    struct apc_frame frame;
};

static struct apc_now at(const struct rig *r, apc_ns mono)
{
    return (struct apc_now){.mono = mono, .utc = T0 + mono + r->utc_step};
}

static int set_up_with(void **state, const double *initial)
{
    static struct rig r;
    static const double safe = SAFE, low = -1.0, high = 2.0;
    struct apc_plantserver_options o = {.size = sizeof(o),
                                        .model = &apc_model_first_order,
                                        .safe = &safe,
                                        .low = &low,
                                        .high = &high,
                                        .link_period = LINK,
                                        .command_period = COMMAND,
                                        .initial = initial};

    r = (struct rig){0};
    *state = &r;
    if (apc_plant_create(&r.plant, o.model, NULL, NULL, NULL, NULL) < 0)
        return -1;
    o.plant = r.plant;
    return apc_plantserver_create(&r.server, &o, NULL);
}

static int set_up(void **state)
{
    return set_up_with(state, NULL);
}

#define RUNNING 0.7

static int set_up_running(void **state)
{
    static const double initial = RUNNING;

    return set_up_with(state, &initial);
}

static int tear_down(void **state)
{
    struct rig *r = *state;

    apc_plantserver_destroy(r->server);
    apc_plant_destroy(r->plant);
    return 0;
}

static int send(struct rig *r, apc_ns mono, uint64_t connection, enum apc_frame_kind kind, apc_ns stamp,
                double u)
{
    const struct apc_sample sample = {.time = stamp, .value = u};
    const struct apc_frame frame = {.kind = kind, .id = 9 + r->later, .n = kind == APC_FRAME_QUERY ? 0 : 1};
    char text[256];
    int n = apc_frame_encode(text, sizeof(text), &frame, &sample);
    int rc;

    assert_true(n > 0);
    rc = apc_plantserver_request(r->server, at(r, mono), connection, text, (size_t)n, r->reply,
                                 sizeof(r->reply), &r->notice);
    if (rc > 0)
        assert_int_equal(apc_frame_decode(r->reply, (size_t)rc, &r->frame, &r->y, 1), 0);
    return rc;
}

static void command(struct rig *r, apc_ns mono, apc_ns stamp, double u)
{
    assert_true(send(r, mono, 1, APC_FRAME_COMMAND, stamp, u) > 0);
}

static void tick(struct rig *r, apc_ns mono)
{
    assert_int_equal(apc_plantserver_tick(r->server, at(r, mono), &r->notice), 0);
}

static double input(struct rig *r, bool *safe)
{
    double u = (double)NAN;

    *safe = apc_plantserver_input(r->server, &u);
    return u;
}

static void assert_input(struct rig *r, double expected, bool expect_safe)
{
    bool safe;
    double u = input(r, &safe);

    assert_near(u, expected, 0.0);
    assert_int_equal(safe, expect_safe);
}

static double state_of(const struct rig *r)
{
    return apc_plant_state(r->plant)[0];
}

/* The exact solution of the first-order plant. */
static double exact(double x, double u, double dt)
{
    return 10.0 * u + (x - 10.0 * u) * exp(-dt / 10.0);
}

/* ---- Time order ------------------------------------------------------------------------------ */

static void it_starts_at_the_safe_value_and_says_that_it_has_no_data(void **state)
{
    struct rig *r = *state;

    assert_input(r, SAFE, true);
    assert_true(send(r, 0, 1, APC_FRAME_QUERY, 0, 0.0) > 0);
    assert_int_equal(r->frame.kind, APC_FRAME_VALUES);
    assert_int_equal(r->frame.id, 9);
    assert_int_equal(r->y.status, APC_BAD_WAITING_FOR_INITIAL_DATA);
    tick(r, 0);
    tick(r, TICK);
    assert_near(state_of(r), exact(0.0, SAFE, 0.2), CLOSE);
    assert_input(r, SAFE, true);
}

/* A plant that is running already when the experiment begins. */
/* Promise(experiment/until-first-command): Until the first command the plant has its `initial` input. */
static void until_the_first_command_it_has_its_initial_input(void **state)
{
    struct rig *r = *state;

    assert_input(r, RUNNING, false);
    tick(r, 20 * S);                                      /* whenever it begins */
    assert_int_equal(r->notice.kind, APC_NOTICE_RESUMED); /* it is not at its safe value, as others are */
    assert_string_equal(r->notice.text, "plant begins with its initial input");
    assert_input(r, RUNNING, false);
    tick(r, 20 * S + TICK);
    assert_int_equal(r->notice.kind, APC_NOTICE_NONE);
    assert_near(state_of(r), exact(0.0, RUNNING, 0.2), CLOSE);
    command(r, 20 * S + TICK, STAMP(1), 1.5);
    tick(r, 20 * S + 2 * TICK);
    assert_near(state_of(r), exact(0.0, RUNNING, 0.4), CLOSE);
    assert_input(r, 1.5, false);
    assert_int_equal(r->notice.kind, APC_NOTICE_RESUMED); /* from here on it is controlled */
    command(r, 20 * S + 2 * TICK, STAMP(2), 1.6);
    tick(r, 20 * S + 3 * TICK);
    assert_int_equal(r->notice.kind, APC_NOTICE_NONE);
}

/* Promise(experiment/until-first-command) */
static void without_any_command_it_goes_from_its_initial_input_to_the_safe_value(void **state)
{
    const apc_ns limit = 3 * LINK + 100 * MS;
    struct rig *r = *state;

    tick(r, 20 * S);
    tick(r, 20 * S + limit);
    assert_input(r, RUNNING, false);
    tick(r, 20 * S + limit + TICK);
    assert_int_equal(r->notice.kind, APC_NOTICE_TRIP);
    assert_input(r, SAFE, true);
    assert_near(state_of(r), exact(exact(0.0, RUNNING, 1.6), SAFE, 0.2), CLOSE);
}

static void a_command_long_before_the_first_tick_has_expired_by_then(void **state)
{
    struct rig *r = *state;

    command(r, 0, STAMP(1), 1.5);
    tick(r, 20 * S);
    assert_input(r, SAFE, true);
}

static void a_command_before_the_first_tick_is_better_than_the_initial_input(void **state)
{
    struct rig *r = *state;

    command(r, 0, STAMP(1), 1.5);
    tick(r, 0);
    assert_input(r, 1.5, false);
}

static void a_tick_advances_with_the_input_sampled_at_the_tick_before(void **state)
{
    struct rig *r = *state;
    double x;

    tick(r, 0);
    command(r, 10 * MS, STAMP(1), 1.0);
    assert_input(r, SAFE, true); /* taken at the next tick, not before */
    tick(r, TICK);
    x = exact(0.0, SAFE, 0.2);
    assert_near(state_of(r), x, CLOSE);
    assert_input(r, 1.0, false);
    assert_int_equal(r->notice.kind, APC_NOTICE_RESUMED);
    tick(r, 2 * TICK);
    x = exact(x, 1.0, 0.2);
    assert_near(state_of(r), x, CLOSE);
    assert_int_equal(r->notice.kind, APC_NOTICE_NONE);
}

static void a_reply_carries_y_of_the_last_tick_under_its_time(void **state)
{
    struct rig *r = *state;

    tick(r, 0);
    tick(r, TICK);
    assert_true(send(r, TICK + 150 * MS, 1, APC_FRAME_QUERY, 0, 0.0) > 0);
    assert_near(r->y.value, state_of(r), 0.0);
    assert_int_equal(r->y.time, T0 + TICK);
    assert_int_equal(r->y.status, APC_GOOD);
}

static void missed_ticks_are_simulated_through(void **state)
{
    struct rig *r = *state;

    tick(r, 0);
    tick(r, 10 * S);
    assert_near(state_of(r), exact(0.0, SAFE, 10.0), CLOSE);
    tick(r, 9 * S); /* never backwards */
    tick(r, 11 * S);
    assert_near(state_of(r), exact(0.0, SAFE, 11.0), CLOSE);
}

/* ---- Watchdog -------------------------------------------------------------------------------- */

/*
 * Promise(run/without-frames-new): Without frames or new commands the plant goes to its safe value at the
 *   stated instants, until a new command.
 */
static void without_a_frame_it_trips_at_three_link_periods_and_100_ms(void **state)
{
    struct rig *r = *state;
    const apc_ns last = 150 * MS, deadline = last + 3 * LINK + 100 * MS; /* 1.75 s: between two ticks */
    double x;
    apc_ns t = 0;

    tick(r, 0);
    command(r, last, STAMP(1), 1.0);
    for (t = TICK; t <= deadline; t += TICK) {
        tick(r, t);
        assert_input(r, 1.0, false);
        assert_int_not_equal(r->notice.kind, APC_NOTICE_TRIP);
    }
    x = exact(exact(0.0, SAFE, 0.2), 1.0, apc_ns_to_s(deadline - TICK));
    x = exact(x, SAFE, apc_ns_to_s(t - deadline));
    tick(r, t);
    assert_int_equal(r->notice.kind, APC_NOTICE_TRIP);
    assert_int_equal(apc_plantserver_watchdog(r->server)->tripped, deadline); /* and not now */
    assert_input(r, SAFE, true);
    assert_near(state_of(r), x, CLOSE);
    tick(r, t + TICK);
    assert_int_equal(r->notice.kind, APC_NOTICE_NONE);
}

/* Promise(run/without-frames-new) */
static void repeated_commands_trip_at_three_controller_periods_and_100_ms(void **state)
{
    struct rig *r = *state;
    const apc_ns first = 150 * MS, deadline = first + 3 * COMMAND + 100 * MS; /* 6.25 s */
    double x = exact(exact(0.0, SAFE, 0.2), 1.0, apc_ns_to_s(deadline - TICK));
    apc_ns t;

    tick(r, 0);
    for (t = TICK; t <= deadline; t += TICK) {
        command(r, t - 50 * MS, STAMP(1), 1.0);
        tick(r, t);
        assert_input(r, 1.0, false);
    }
    command(r, t - 50 * MS, STAMP(1), 1.0);
    assert_int_equal(r->notice.kind, APC_NOTICE_TRIP);
    tick(r, t);
    assert_input(r, SAFE, true);
    assert_near(state_of(r), exact(x, SAFE, apc_ns_to_s(t - deadline)), CLOSE);
}

static void a_late_tick_still_knows_the_exact_instant(void **state)
{
    struct rig *r = *state;
    const apc_ns deadline = 3 * LINK + 100 * MS;
    double x = exact(0.0, 1.0, apc_ns_to_s(deadline));

    command(r, 0, STAMP(1), 1.0);
    tick(r, 0);
    tick(r, 30 * S);
    assert_near(state_of(r), exact(x, SAFE, apc_ns_to_s(30 * S - deadline)), CLOSE);
}

static void a_trip_between_ticks_counts_even_when_a_new_command_ends_it(void **state)
{
    struct rig *r = *state;
    const apc_ns deadline = 3 * LINK + 100 * MS;
    double x = exact(0.0, 1.0, apc_ns_to_s(deadline));

    command(r, 0, STAMP(1), 1.0);
    tick(r, 0);
    command(r, deadline + 50 * MS, STAMP(2), 0.5);
    assert_int_equal(r->notice.kind, APC_NOTICE_TRIP);
    tick(r, deadline + 80 * MS);
    assert_near(state_of(r), exact(x, SAFE, 0.08), CLOSE);
    assert_int_equal(r->notice.kind, APC_NOTICE_RESUMED);
    assert_input(r, 0.5, false);
}

/* Promise(run/without-frames-new) */
static void a_replay_of_the_old_command_never_resumes(void **state)
{
    struct rig *r = *state;

    command(r, 0, STAMP(1), 1.0);
    tick(r, 0);
    tick(r, 10 * S);
    assert_input(r, SAFE, true);
    for (apc_ns t = 10 * S; t < 20 * S; t += TICK) {
        command(r, t, STAMP(1), 1.0);
        tick(r, t + TICK);
        assert_input(r, SAFE, true);
    }
    command(r, 21 * S, STAMP(2), 1.0);
    tick(r, 21 * S);
    assert_input(r, 1.0, false);
    assert_int_equal(r->notice.kind, APC_NOTICE_RESUMED);
}

static void queries_do_not_keep_a_command_alive(void **state)
{
    struct rig *r = *state;

    command(r, 0, STAMP(1), 1.0);
    for (apc_ns t = 0; t <= 2 * S; t += TICK) {
        assert_true(send(r, t, 1, APC_FRAME_QUERY, 0, 0.0) > 0);
        tick(r, t);
    }
    assert_input(r, SAFE, true);
}

static void a_clock_step_of_an_hour_changes_nothing(void **state)
{
    struct rig *r = *state;
    double x = 0.0;

    for (int k = 0; k < 100; k++) {
        r->utc_step = (k / 10 % 3 - 1) * 3600 * S;
        command(r, k * TICK, STAMP(k) + r->utc_step, 0.7);
        tick(r, k * TICK);
        assert_input(r, 0.7, false);
    }
    x = exact(x, 0.7, 99 * 0.2);
    assert_near(state_of(r), x, CLOSE);
}

/* ---- What must not reach the plant ----------------------------------------------------------- */

/* Promise(run/nothing-not-finite) */
static void a_value_outside_the_limits_or_bad_is_not_applied_but_answered(void **state)
{
    struct rig *r = *state;
    const struct apc_sample bad = {.time = STAMP(5), .value = 0.1, .status = APC_BAD};
    const struct apc_frame frame = {.kind = APC_FRAME_COMMAND, .id = 1, .n = 1};
    const double wrong[] = {2.0001, -1.0001, 1e299, -1e308};
    char text[128];
    int n;

    command(r, 0, STAMP(1), 1.0);
    for (size_t i = 0; i < sizeof(wrong) / sizeof(wrong[0]); i++) {
        command(r, 1, STAMP(2) + (apc_ns)i, 1.0); /* a good one in between, so that each refusal is told of */
        assert_int_equal(r->notice.kind, APC_NOTICE_NONE);
        command(r, 1, STAMP(3) + (apc_ns)i, wrong[i]);
        assert_int_equal(r->notice.kind, APC_NOTICE_REJECTED);
    }
    command(r, 1, STAMP(4), 1.0);
    n = apc_frame_encode(text, sizeof(text), &frame, &bad);
    assert_true(apc_plantserver_request(r->server, at(r, 2), 1, text, (size_t)n, r->reply, sizeof(r->reply),
                                        &r->notice) > 0);
    assert_int_equal(r->notice.kind, APC_NOTICE_REJECTED);
    tick(r, TICK);
    assert_input(r, 1.0, false);
    command(r, 1500 * MS, STAMP(99), 7.0); /* no sign of life: the watchdog runs on */
    tick(r, 1700 * MS);
    assert_input(r, SAFE, true);
}

static void refused_commands_are_told_of_once_until_one_is_accepted(void **state)
{
    struct rig *r = *state;

    for (int round = 0; round < 3; round++) {
        command(r, 0, STAMP(10 * round), 1.0);
        assert_int_equal(r->notice.kind, APC_NOTICE_NONE);
        for (int k = 1; k < 9; k++) {
            command(r, 0, STAMP(10 * round + k), 7.0 + k);
            assert_int_equal(r->notice.kind, k == 1 ? APC_NOTICE_REJECTED : APC_NOTICE_NONE);
        }
    }
    assert_int_equal(apc_plantserver_tick(r->server, at(r, 10 * S), &r->notice), 0);
    assert_int_equal(r->notice.kind, APC_NOTICE_TRIP);
}

static void a_refusal_that_a_trip_hides_is_told_of_the_next_time(void **state)
{
    struct rig *r = *state;

    command(r, 0, STAMP(1), 1.0);
    tick(r, 0);
    command(r, 10 * S, STAMP(2), 7.0);
    assert_int_equal(r->notice.kind, APC_NOTICE_TRIP);
    command(r, 10 * S, STAMP(3), 7.0);
    assert_int_equal(r->notice.kind, APC_NOTICE_REJECTED);
}

static void the_papers_client_sends_its_command_as_values(void **state)
{
    struct rig *r = *state;

    tick(r, 0);
    assert_true(send(r, 0, 1, APC_FRAME_VALUES, T0, 0.5) > 0);
    tick(r, 1);
    assert_input(r, 0.5, false);
}

static void frames_that_are_no_request_close_the_connection(void **state)
{
    struct rig *r = *state;
    const struct apc_sample two[2] = {{.time = STAMP(1), .value = 0.5}, {.time = STAMP(1), .value = 0.5}};
    struct apc_frame frame = {.kind = APC_FRAME_COMMAND, .id = 1, .n = 2};
    char text[256];
    int n = apc_frame_encode(text, sizeof(text), &frame, two);

    assert_true(n > 0);
    assert_int_equal(
        apc_plantserver_request(r->server, at(r, 0), 1, text, (size_t)n, r->reply, sizeof(r->reply), NULL),
        APC_EPROTO);
    frame.n = 0;
    n = apc_frame_encode(text, sizeof(text), &frame, two);
    if (n > 0)
        assert_int_equal(apc_plantserver_request(r->server, at(r, 0), 1, text, (size_t)n, r->reply,
                                                 sizeof(r->reply), NULL),
                         APC_EPROTO);
    assert_int_equal(
        apc_plantserver_request(r->server, at(r, 0), 1, "7123.46\n", 8, r->reply, sizeof(r->reply), NULL),
        APC_EPROTO);
    tick(r, 0);
    assert_input(r, SAFE, true);
}

static void the_newest_connection_that_commanded_wins(void **state)
{
    struct rig *r = *state;

    assert_true(send(r, 0, 1, APC_FRAME_COMMAND, STAMP(1), 1.0) > 0);
    assert_true(send(r, 1, 2, APC_FRAME_QUERY, 0, 0.0) > 0); /* asking takes nothing over */
    assert_true(send(r, 2, 1, APC_FRAME_COMMAND, STAMP(2), 1.1) > 0);
    assert_true(send(r, 3, 2, APC_FRAME_COMMAND, STAMP(3), 1.2) > 0);
    assert_int_equal(send(r, 4, 1, APC_FRAME_COMMAND, STAMP(4), 1.3), APC_EPERM);
    assert_int_not_equal(r->notice.kind, APC_NOTICE_RIVALS); /* late, from before a reconnect */
    r->later++;
    assert_int_equal(send(r, 4, 1, APC_FRAME_COMMAND, STAMP(4), 1.3), APC_EPERM);
    assert_int_equal(r->notice.kind, APC_NOTICE_RIVALS);
    assert_non_null(strstr(r->notice.text, "another client"));
    assert_int_equal(apc_plantserver_commander(r->server), 2);
    assert_true(send(r, 5, 1, APC_FRAME_QUERY, 0, 0.0) > 0);
    tick(r, 6);
    assert_input(r, 1.2, false);
    const apc_ns minute = 60 * APC_NS_PER_S;
    assert_int_equal(send(r, 3 + minute, 1, APC_FRAME_COMMAND, STAMP(5), 1.3), APC_EPERM);
    assert_int_not_equal(r->notice.kind, APC_NOTICE_RIVALS); /* told of already */
    assert_int_equal(send(r, 4 + minute, 1, APC_FRAME_COMMAND, STAMP(6), 1.3), APC_EPERM);
    assert_int_equal(r->notice.kind, APC_NOTICE_RIVALS);
}

#define CLAIM(k) ((UINT64_C(1700000000000000) + (k)) * APC_FRAME_PER_CLAIM)

static int command_of(struct rig *r, apc_ns mono, uint64_t connection, uint64_t id, double u)
{
    r->later = id - 9;
    return send(r, mono, connection, APC_FRAME_COMMAND, STAMP(mono / MS), u);
}

static void assert_fenced(struct rig *r, apc_ns mono, uint64_t connection, uint64_t id, bool told)
{
    assert_int_equal(command_of(r, mono, connection, id, -0.9), APC_EPERM);
    assert_int_equal(r->notice.kind == APC_NOTICE_FENCED, told);
    if (told)
        assert_non_null(strstr(r->notice.text, "a newer claim has commanded since"));
}

/* It slept while another one took its place. */
/* Promise(modes/client-slept-took) */
static void a_client_of_an_older_claim_moves_nothing(void **state)
{
    struct rig *r = *state;

    assert_true(command_of(r, 1 * MS, 1, CLAIM(10), 1.0) > 0);
    assert_true(command_of(r, 2 * MS, 1, CLAIM(10) + 1, 1.1) > 0);
    assert_true(command_of(r, 3 * MS, 2, CLAIM(11), 1.2) > 0);
    assert_int_equal(command_of(r, 4 * MS, 1, CLAIM(10) + 2, -0.9), APC_EPERM); /* on its old connection */
    assert_int_not_equal(r->notice.kind, APC_NOTICE_RIVALS);
    assert_int_equal(command_of(r, 4 * MS, 1, CLAIM(11) + 9, -0.9),
                     APC_EPERM); /* from before it reconnected */
    assert_int_not_equal(r->notice.kind, APC_NOTICE_RIVALS);
    assert_fenced(r, 5 * MS, 3, CLAIM(10) + 3, true);
    assert_fenced(r, 6 * MS, 4, CLAIM(10) + 4, false); /* said once */
    assert_fenced(r, 7 * MS, 4, CLAIM(9), false);
    r->later = CLAIM(10);
    assert_true(send(r, 8 * MS, 5, APC_FRAME_QUERY, 0, 0.0) > 0); /* it may ask */
    assert_int_equal(apc_plantserver_commander(r->server), 2);
    tick(r, 9 * MS);
    assert_input(r, 1.2, false);

    assert_true(command_of(r, 10 * MS, 6, CLAIM(11) + 1, 1.3) > 0); /* it connects anew */
    assert_fenced(r, 11 * MS, 7, CLAIM(10) + 5, true);
    assert_true(command_of(r, 12 * MS, 8, 1, 1.4) >
                0);                                    /* who has no claim is not compared, as in the paper */
    assert_fenced(r, 13 * MS, 9, CLAIM(10) + 6, true); /* and changes nothing for who has */
    assert_true(command_of(r, 14 * MS, 10, CLAIM(11), 1.5) > 0);
    assert_true(command_of(r, 15 * MS, 11, CLAIM(12), 1.6) > 0);
    assert_fenced(r, 16 * MS, 12, CLAIM(11) + 1, true);
    tick(r, 17 * MS);
    assert_input(r, 1.6, false);
}

static int command_stamped(struct rig *r, apc_ns mono, uint64_t connection, uint64_t id, apc_ns stamp,
                           double u)
{
    r->later = id - 9;
    return send(r, mono, connection, APC_FRAME_COMMAND, stamp, u);
}

/* A controller has taken over, and a relay holds back what the client sent before, with its connection. */
/* Promise(modes/client-slept-took) */
static void a_command_of_the_former_controller_that_was_held_back_moves_nothing(void **state)
{
    struct rig *r = *state;

    assert_true(command_stamped(r, 1 * MS, 1, CLAIM(10), STAMP(100), 1.0) > 0);
    assert_true(command_stamped(r, 2 * MS, 2, CLAIM(10) + 3, STAMP(300), 1.2) > 0); /* of the successor */
    assert_int_equal(command_stamped(r, 3 * MS, 3, CLAIM(10) + 1, STAMP(200), -0.9), APC_EPERM);
    assert_int_equal(r->notice.kind, APC_NOTICE_NONE); /* nobody has to do anything */
    assert_int_equal(apc_plantserver_commander(r->server), 2);
    assert_true(command_stamped(r, 4 * MS, 2, CLAIM(10) + 4, STAMP(300), 1.2) > 0); /* it still commands */
    tick(r, 5 * MS);
    assert_input(r, 1.2, false);
}

/* A client that connects anew is not held back: by what it repeats, by a clock that steps back, by what it
 * asked for in vain, where its ids begin anew.
 */
static void a_client_that_connects_anew_commands(void **state)
{
    struct rig *r = *state;

    assert_true(command_stamped(r, 1 * MS, 1, CLAIM(10) + 1020, STAMP(900), 1.0) > 0);
    assert_true(command_stamped(r, 2 * MS, 2, CLAIM(10) + 1021, STAMP(900), 1.0) > 0); /* the same again */
    assert_true(command_stamped(r, 3 * MS, 3, CLAIM(10) + 1022, STAMP(200), 1.1) > 0); /* a step back */
    assert_true(command_stamped(r, 4 * MS, 4, CLAIM(10) + 3, STAMP(100), 1.2) > 0);    /* and again */
    assert_true(command_stamped(r, 5 * MS, 5, CLAIM(10) + 900, STAMP(950), 1.3) > 0);  /* after a while */
    assert_int_equal(command_stamped(r, 6 * MS, 6, CLAIM(10) + 890, STAMP(949), -0.9), APC_EPERM);
    tick(r, 7 * MS);
    assert_input(r, 1.3, false);
}

/* Of a time to come: it takes the plant from nobody whose claim counts, and alone it commands without a
 * number. */
/* Promise(modes/command-whatever-number) */
static void a_claim_ahead_of_the_clock_shuts_nobody_out(void **state)
{
    struct rig *r = *state;
    const uint64_t later = UINT64_C(600) * 1000 * 1000;

    assert_true(command_of(r, 1 * MS, 1, UINT64_MAX, 0.9) > 0);
    assert_int_equal(r->notice.kind, APC_NOTICE_CLOCK);
    assert_non_null(strstr(r->notice.text, "it is not compared with others"));
    assert_true(command_of(r, 2 * MS, 1, UINT64_MAX, 0.9) > 0);
    assert_int_not_equal(r->notice.kind, APC_NOTICE_CLOCK); /* said once */
    assert_true(command_of(r, 3 * MS, 2, CLAIM(10), 1.0) > 0);

    assert_fenced(r, 4 * MS, 2, CLAIM(9), true);
    for (uint64_t k = 0; k < 3; k++) { /* which is another word than that one */
        const uint64_t of[] = {UINT64_MAX, CLAIM(later), UINT64_C(1) << 63};
        assert_int_equal(command_of(r, 4 * MS, 3 + k, of[k], -0.9), APC_EPERM);
        assert_int_equal(r->notice.kind == APC_NOTICE_FENCED, k == 0);
        if (k == 0)
            assert_non_null(strstr(r->notice.text, "ahead of this clock"));
    }
    assert_true(command_of(r, 5 * MS, 2, CLAIM(10) + 1, 1.1) > 0);    /* on the connection that it had */
    assert_true(command_of(r, 6 * MS, 6, CLAIM(later / 3), 1.2) > 0); /* clocks may be apart a little */
    r->utc_step = -3600 * S;
    assert_true(command_of(r, 7 * MS, 7, CLAIM(later / 3) + 1, 1.3) > 0); /* it was new before the step */
    r->utc_step = 0;
    tick(r, 8 * MS);
    assert_input(r, 1.3, false);
}

/* One command of somebody with a number ends nobody's control for good. */
/* Promise(modes/command-whatever-number) */
static void a_claim_is_forgotten_once_its_client_is_silent(void **state)
{
    struct rig *r = *state;
    const apc_ns kept = 3 * LINK + 100 * MS + 10 * S;

    assert_true(command_of(r, 1 * MS, 1, CLAIM(10), 1.0) > 0);
    assert_true(command_of(r, 2 * MS, 2, CLAIM(1000), 1.1) > 0);
    assert_fenced(r, 3 * MS, 3, CLAIM(10) + 1, true);
    assert_true(command_of(r, 4 * MS, 4, 1, 1.2) > 0); /* who has no number keeps it from no oblivion */
    tick(r, 1 * MS + kept);                            /* its watchdog is heard first */
    assert_fenced(r, 2 * MS + kept, 5, CLAIM(10) + 2, true);
    assert_true(command_of(r, 3 * MS + kept, 6, CLAIM(10) + 3, 1.3) > 0);
    assert_true(command_of(r, 4 * MS + kept, 7, CLAIM(1000) + 1, 1.4) >
                0); /* it comes back, and is the newer one */
    assert_fenced(r, 5 * MS + kept, 8, CLAIM(10) + 4, true);
    tick(r, 6 * MS + kept);
    assert_input(r, 1.4, false);
}

/* Promise(modes/command-whatever-number) */
static void a_command_that_is_refused_takes_the_plant_from_nobody(void **state)
{
    struct rig *r = *state;

    assert_true(command_of(r, 1 * MS, 1, CLAIM(10), 1.0) > 0);
    assert_true(command_of(r, 2 * MS, 2, CLAIM(11), 1e9) > 0); /* out of range: answered, and not taken */
    assert_int_equal(r->notice.kind, APC_NOTICE_REJECTED);
    assert_int_equal(apc_plantserver_commander(r->server), 1);
    assert_true(command_of(r, 3 * MS, 1, CLAIM(10) + 1, 1.1) > 0);
    tick(r, 4 * MS);
    assert_input(r, 1.1, false);
}

/* ---- Several inputs --------------------------------------------------------------------------- */

/* Two heaters with limits of their own: a rig whose commands have two values. */
static struct rig make_two(void)
{
    static const double safe[] = {5.0, 6.0}, low[] = {1.0, 2.0}, high[] = {50.0, 60.0};
    struct rig r = {0};
    void *handle;
    struct apc_plantserver_options o = {.size = sizeof(o),
                                        .safe = safe,
                                        .low = low,
                                        .high = high,
                                        .link_period = LINK,
                                        .command_period = COMMAND};

    assert_int_equal(apc_model_find("temperature-lab", &o.model, &handle, NULL), 0);
    assert_int_equal(apc_plant_create(&r.plant, o.model, NULL, NULL, NULL, NULL), 0);
    o.plant = r.plant;
    assert_int_equal(apc_plantserver_create(&r.server, &o, NULL), 0);
    return r;
}

static void command_two(struct rig *r, apc_ns mono, const apc_ns *stamp, const double *u, apc_status status)
{
    const struct apc_sample sample[2] = {{.time = stamp[0], .value = u[0]},
                                         {.time = stamp[1], .value = u[1], .status = status}};
    const struct apc_frame frame = {.kind = APC_FRAME_COMMAND, .id = 1, .n = 2};
    char text[256];
    int n = apc_frame_encode(text, sizeof(text), &frame, sample);

    assert_true(n > 0);
    assert_true(apc_plantserver_request(r->server, at(r, mono), 1, text, (size_t)n, r->reply,
                                        sizeof(r->reply), &r->notice) > 0);
}

static void assert_inputs(struct rig *r, double first, double second)
{
    double u[2];

    (void)apc_plantserver_input(r->server, u);
    assert_near(u[0], first, 0.0);
    assert_near(u[1], second, 0.0);
}

static void a_command_counts_as_a_whole_and_each_value_has_its_own_limits(void **state)
{
    const apc_ns stamp[] = {STAMP(1), STAMP(1)};
    const struct {
        double u[2];
        apc_status status;
        const char *says;
    } wrong[] = {{{0.9, 30.0}, APC_GOOD, "value 1 is 0.9 and Good; it must be within 1 to 50"},
                 {{50.1, 30.0}, APC_GOOD, "value 1 is 50.1"},
                 {{20.0, 1.9}, APC_GOOD, "value 2 is 1.9"},
                 {{20.0, 60.1}, APC_GOOD, "value 2 is 60.1 and Good; it must be within 2 to 60"},
                 {{20.0, 30.0}, APC_BAD, "value 2 is 30 and Bad"}};
    struct rig r;

    (void)state;
    for (size_t i = 0; i < sizeof(wrong) / sizeof(wrong[0]); i++) {
        r = make_two();
        command_two(&r, 0, stamp, wrong[i].u, wrong[i].status);
        assert_int_equal(r.notice.kind, APC_NOTICE_REJECTED);
        if (!strstr(r.notice.text, wrong[i].says))
            fail_msg("\"%s\" does not say \"%s\"", r.notice.text, wrong[i].says);
        tick(&r, 0);
        assert_inputs(&r, 5.0, 6.0);
        apc_plantserver_destroy(r.server);
        apc_plant_destroy(r.plant);
    }
    r = make_two();
    command_two(&r, 0, stamp, (const double[]){1.0, 60.0}, APC_GOOD); /* the limits themselves are within */
    assert_int_equal(r.notice.kind, APC_NOTICE_NONE);
    tick(&r, 0);
    assert_inputs(&r, 1.0, 60.0);
    apc_plantserver_destroy(r.server);
    apc_plant_destroy(r.plant);
}

/* A command is as new as the newest of its values, whichever that is. */
static void a_command_with_one_new_value_is_new(void **state)
{
    const double u[] = {20.0, 30.0};
    struct rig r = make_two();

    (void)state;
    command_two(&r, 0, (const apc_ns[]){STAMP(1), STAMP(1)}, u, APC_GOOD);
    tick(&r, 0);
    for (int k = 1; k < 100; k++) {
        const apc_ns now = k * TICK;

        command_two(&r, now,
                    (const apc_ns[]){k % 20 < 10 ? STAMP(k) : STAMP(1), k % 20 < 10 ? STAMP(1) : STAMP(k)}, u,
                    APC_GOOD);
        tick(&r, now);
        assert_inputs(&r, 20.0, 30.0);
    }
    for (int k = 100; k < 140; k++) { /* and with none it is old */
        command_two(&r, k * TICK, (const apc_ns[]){STAMP(3), STAMP(99)}, u, APC_GOOD);
        tick(&r, k * TICK);
    }
    assert_inputs(&r, 5.0, 6.0);
    apc_plantserver_destroy(r.server);
    apc_plant_destroy(r.plant);
}

/* A minute after it was told of, whatever the clock shows: not sooner, and then again. */
static void two_rivals_are_told_of_once_a_minute(void **state)
{
    struct rig *r = *state;
    const apc_ns begin = 1000 * S;
    int told = 0;

    assert_true(send(r, begin, 2, APC_FRAME_COMMAND, STAMP(1), 1.0) > 0);
    r->later++;
    for (int k = 0; k <= 180; k++) {
        assert_int_equal(send(r, begin + k * S, 1, APC_FRAME_COMMAND, STAMP(2 + k), 1.3), APC_EPERM);
        if (r->notice.kind == APC_NOTICE_RIVALS) {
            assert_int_equal(k % 60, 0);
            told++;
        }
    }
    assert_int_equal(told, 4);
}

static void no_vector_is_longer_than_a_frame_holds(void **state)
{
    struct rig *r = *state;
    struct apc_model model = apc_model_first_order;
    struct apc_plantserver_options o = {.size = sizeof(o),
                                        .plant = r->plant,
                                        .model = &model,
                                        .link_period = LINK,
                                        .command_period = COMMAND};
    struct apc_plantserver *server;
    struct apc_error why = {""};

    for (int what = 0; what < 4; what++) {
        model = apc_model_first_order;
        *(what % 2 ? &model.nu : &model.ny) = what < 2 ? 0 : 8193;
        assert_int_equal(apc_plantserver_create(&server, &o, &why), APC_EINVAL);
        assert_non_null(strstr(why.text, "8192"));
    }
    model.nu = model.ny = 8192;
    assert_int_equal(apc_plantserver_create(&server, &o, &why), 0);
    apc_plantserver_destroy(server);
    assert_int_equal(apc_plantserver_create(NULL, &o, &why), APC_EINVAL);
    model = apc_model_first_order;
    for (int what = 0; what < 4; what++) { /* a period of a year and a day more is none */
        o.link_period = what == 0   ? INT64_C(366) * 86400 * S + 1
                        : what == 1 ? INT64_C(366) * 86400 * S
                                    : LINK;
        o.command_period = what == 2 ? INT64_C(366) * 86400 * S + 1 : what == 3 ? -1 : COMMAND;
        assert_int_equal(apc_plantserver_create(&server, &o, &why), what == 1 ? 0 : APC_EINVAL);
        apc_plantserver_destroy(server);
    }
}

static int broken_f(double t, const double *x, const double *u, const double *p, double *dx)
{
    (void)t, (void)x, (void)p;
    dx[0] = u[0];
    return u[0] > 1.5;
}

static void copy_g(double t, const double *x, const double *u, const double *p, double *y)
{
    (void)t, (void)u, (void)p;
    y[0] = x[0] > 0.25 ? (double)NAN : x[0];
}

/* Also of a sensor that looks seldom: it does not wait for its next time. */
static void a_plant_that_cannot_be_solved_is_bad_and_told_of_once_until_it_can(void **state)
{
    struct rig *r = *state;
    const struct apc_sensor seldom = {.period = 4 * TICK};
    const struct apc_model model = {
        .abi = APC_MODEL_ABI, .name = "broken", .nx = 1, .nu = 1, .ny = 1, .f = broken_f, .g = copy_g};
    struct rig own = {0};
    struct apc_plantserver_options o = {.size = sizeof(o),
                                        .model = &model,
                                        .link_period = LINK,
                                        .command_period = COMMAND,
                                        .sensor = &seldom};

    (void)r;
    assert_int_equal(apc_plant_create(&own.plant, &model, NULL, NULL, NULL, NULL), 0);
    o.plant = own.plant;
    assert_int_equal(apc_plantserver_create(&own.server, &o, NULL), 0);
    command(&own, 0, STAMP(1), 2.0);
    tick(&own, 0);
    assert_int_equal(apc_plantserver_tick(own.server, at(&own, TICK), &own.notice), APC_ESOLVER);
    assert_int_equal(own.notice.kind, APC_NOTICE_FAILED);
    assert_non_null(strstr(own.notice.text, "broken"));
    command(&own, TICK, STAMP(2), 1.0);
    assert_int_equal(own.y.status, APC_BAD_DEVICE_FAILURE);
    assert_int_equal(own.y.time, T0 + TICK);
    assert_near(own.y.value, 0.0, 0.0);
    assert_int_equal(apc_plantserver_tick(own.server, at(&own, 2 * TICK), &own.notice), APC_ESOLVER);
    assert_int_equal(own.notice.kind, APC_NOTICE_NONE);
    tick(&own, 3 * TICK);
    assert_int_equal(own.notice.kind, APC_NOTICE_RECOVERED);
    command(&own, 3 * TICK, STAMP(3), 1.0);
    assert_int_equal(own.y.status, APC_GOOD);
    assert_near(own.y.value, 0.2, CLOSE);
    tick(&own, 4 * TICK); /* g gives NaN: the last number stays, marked */
    assert_int_equal(own.notice.kind, APC_NOTICE_NONE);
    command(&own, 4 * TICK, STAMP(3), 1.0);
    assert_int_equal(own.y.status, APC_BAD_SENSOR_FAILURE);
    assert_near(own.y.value, 0.2, CLOSE);
    apc_plantserver_destroy(own.server);
    apc_plant_destroy(own.plant);
}

static void a_server_that_could_not_protect_its_plant_is_refused(void **state)
{
    struct rig *r = *state;
    const double one = 1.0, five = 5.0, nan_value = (double)NAN;
    const struct apc_plantserver_options good = {.size = sizeof(good),
                                                 .plant = r->plant,
                                                 .model = &apc_model_first_order,
                                                 .link_period = LINK,
                                                 .command_period = COMMAND};
    struct apc_plantserver_options o = good;
    struct apc_plantserver *server = NULL;
    struct apc_error why = {""};

    o.low = &one; /* zeros, the default safe value, lie outside */
    assert_int_equal(apc_plantserver_create(&server, &o, &why), APC_EINVAL);
    assert_non_null(strstr(why.text, "safe"));
    o = good;
    o.safe = &nan_value;
    assert_int_equal(apc_plantserver_create(&server, &o, &why), APC_EINVAL);
    o = good;
    o.low = &five;
    o.high = &one;
    assert_int_equal(apc_plantserver_create(&server, &o, &why), APC_EINVAL);
    assert_non_null(strstr(why.text, "limits 1: low 5 must not be above high 1"));
    o = good;
    o.initial = &five;
    o.high = &one;
    assert_int_equal(apc_plantserver_create(&server, &o, &why), APC_EINVAL);
    assert_non_null(strstr(why.text, "initial value 1 is 5"));
    o = good;
    o.link_period = 0;
    assert_int_equal(apc_plantserver_create(&server, &o, &why), APC_EINVAL);
    o = good;
    o.plant = NULL;
    assert_int_equal(apc_plantserver_create(&server, &o, &why), APC_EINVAL);
    assert_null(server);
    o = good; /* the limits themselves are within, and may be one */
    o.safe = o.low = o.high = &one;
    assert_int_equal(apc_plantserver_create(&server, &o, &why), 0);
    apc_plantserver_destroy(server);
    apc_plantserver_destroy(NULL);
}

int main(void)
{
#define T(name) cmocka_unit_test_setup_teardown(name, set_up, tear_down)
    const struct CMUnitTest tests[] = {
        T(it_starts_at_the_safe_value_and_says_that_it_has_no_data),
        cmocka_unit_test_setup_teardown(until_the_first_command_it_has_its_initial_input, set_up_running,
                                        tear_down),
        cmocka_unit_test_setup_teardown(without_any_command_it_goes_from_its_initial_input_to_the_safe_value,
                                        set_up_running, tear_down),
        cmocka_unit_test_setup_teardown(a_command_long_before_the_first_tick_has_expired_by_then,
                                        set_up_running, tear_down),
        cmocka_unit_test_setup_teardown(a_command_before_the_first_tick_is_better_than_the_initial_input,
                                        set_up_running, tear_down),
        T(a_tick_advances_with_the_input_sampled_at_the_tick_before),
        T(a_reply_carries_y_of_the_last_tick_under_its_time),
        T(missed_ticks_are_simulated_through),
        T(without_a_frame_it_trips_at_three_link_periods_and_100_ms),
        T(repeated_commands_trip_at_three_controller_periods_and_100_ms),
        T(a_late_tick_still_knows_the_exact_instant),
        T(a_trip_between_ticks_counts_even_when_a_new_command_ends_it),
        T(a_replay_of_the_old_command_never_resumes),
        T(queries_do_not_keep_a_command_alive),
        T(a_clock_step_of_an_hour_changes_nothing),
        T(a_value_outside_the_limits_or_bad_is_not_applied_but_answered),
        T(refused_commands_are_told_of_once_until_one_is_accepted),
        T(a_refusal_that_a_trip_hides_is_told_of_the_next_time),
        T(the_papers_client_sends_its_command_as_values),
        T(frames_that_are_no_request_close_the_connection),
        T(the_newest_connection_that_commanded_wins),
        cmocka_unit_test(a_command_counts_as_a_whole_and_each_value_has_its_own_limits),
        cmocka_unit_test(a_command_with_one_new_value_is_new),
        T(two_rivals_are_told_of_once_a_minute),
        T(a_client_of_an_older_claim_moves_nothing),
        T(a_command_that_is_refused_takes_the_plant_from_nobody),
        T(a_command_of_the_former_controller_that_was_held_back_moves_nothing),
        T(a_client_that_connects_anew_commands),
        T(a_claim_is_forgotten_once_its_client_is_silent),
        T(a_claim_ahead_of_the_clock_shuts_nobody_out),
        T(no_vector_is_longer_than_a_frame_holds),
        T(a_plant_that_cannot_be_solved_is_bad_and_told_of_once_until_it_can),
        T(a_server_that_could_not_protect_its_plant_is_refused),
    };

    return cmocka_run_group_tests(tests, NULL, NULL);
}

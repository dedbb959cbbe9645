/* SPDX-License-Identifier: BSD-3-Clause */
/* The controller's core with laws that have settings, filters and observers. */
#include "check.h"

#include "rows.h"

#include <stdio.h>
#include <string.h>

#define S      APC_NS_PER_S
#define T0     (INT64_C(1700000000) * S)
#define PERIOD (2 * S)
#define ROWS   64

/* A controller and all the rows that there are. */
struct rig {
    struct apc_controller *controller;
    struct apc_rows *in;
    const struct apc_rows *out;
    struct apc_sample actual[ROWS]; /* the newest of each that it ever wrote */
    size_t ny, n_actual;
};

static const double lag_A = -0.5, lag_B = 1.0, lag_C[2] = {1.0, 1.0},
                    nought[2]; /* of two measurements at most */
static const struct apc_law_plant lag = {
    .nx = 1, .A = &lag_A, .B = &lag_B, .C = lag_C, .D = nought, .x0 = nought, .u0 = nought, .y0 = nought};

static void begin(struct rig *r, struct apc_controller *controller, size_t ny)
{
    *r = (struct rig){.controller = controller,
                      .in = apc_controller_in(controller),
                      .out = apc_controller_out(controller),
                      .ny = ny};
}

static void make(struct rig *r, const struct apc_law *law, size_t ny, const struct apc_setting *setting)
{
    const struct apc_controller_options o = {.size = sizeof(o),
                                             .law = law,
                                             .dim = {ny, 1, 1, 0},
                                             .period = PERIOD,
                                             .horizon = 2 * PERIOD,
                                             .n_setting = setting ? 1 : 0,
                                             .setting = setting,
                                             .plant = &lag};
    struct apc_controller *controller;
    struct apc_error why = {""};

    if (apc_controller_create(&controller, &o, &why) < 0)
        fail_msg("%s", why.text);
    begin(r, controller, ny);
}

/* Write one of its inputs at tick k. */
static void feed(struct rig *r, enum apc_table table, int id, double value, int k)
{
    rows_feed(r->in, table, id, value, T0 + k * PERIOD);
}

static const struct apc_sample *given(const struct rig *r, enum apc_table table, int id)
{
    static const struct apc_sample none;
    const struct apc_sample *s = rows_find(r->out, table, id);

    return s ? s : &none;
}

/* As the shell does it: compute, append, update. */
static void compute(struct rig *r, int k, struct apc_notice *notice)
{
    apc_controller_compute(r->controller, (struct apc_now){.mono = k * PERIOD, .utc = T0 + k * PERIOD},
                           (uint64_t)k, true, notice);
    for (size_t i = 0; i < r->out->n_samples; i++) {
        const struct apc_sample *s = &r->out->sample[i];
        size_t at = 0;

        if (s->table == APC_ACTUATOR)
            *rows_at(r->in, s->table, s->id) = *s;
        while (at < r->n_actual && r->actual[at].id != s->id)
            at++;
        if (s->table != APC_ACTUAL)
            continue;
        assert_in_range(at, 0, ROWS - 1);
        r->actual[at] = *s;
        r->n_actual += at == r->n_actual;
    }
    apc_controller_update(r->controller, 1);
}

/* y also decides where the further measurements are. Returns u. */
static double tick(struct rig *r, int k, int mode, double y)
{
    for (size_t i = 0; i < r->ny; i++)
        feed(r, APC_SENSOR, (int)i + 1, y + 0.1 * (double)i, k);
    feed(r, APC_SETPOINT, 1, k / 11 % 2, k);
    feed(r, APC_OPMODE, 1, mode, k);
    compute(r, k, NULL);
    return given(r, APC_ACTUATOR, 1)->value;
}

static void take_over(struct rig *next, const struct rig *r)
{
    struct apc_rows *former = apc_controller_former(next->controller);
    const struct apc_vector *row = r->out->vector;
    double *room = former->vector[0].value;

    assert_int_equal(former->vector[0].room, row->n);
    memcpy(room, row->value, row->n * sizeof(*room));
    former->vector[0] = *row;
    former->vector[0].value = room;
    for (size_t i = 0; i < former->n_samples; i++)
        for (size_t k = 0; k < r->n_actual; k++)
            if (r->actual[k].id == former->sample[i].id)
                former->sample[i] = r->actual[k];
    assert_int_equal(apc_controller_resume(next->controller, T0), 1);
}

/* The next one reads what this one read. */
static void share(struct rig *next, const struct rig *r)
{
    memcpy(next->in->sample, r->in->sample, r->in->n_samples * sizeof(*r->in->sample));
}

static double wavy(int k)
{
    return sin(0.3 * k) + 0.1 * (k % 5);
}

/* Derivatives, rate limits, observers: nothing of them may be lost, in Auto and in Man. */
/* Promise(run/restarted-controller) */
static void every_law_restarted_goes_on_bit_for_bit(void **state)
{
    const struct {
        const struct apc_law *law;
        size_t ny;
    } of[] = {{&apc_law_pi, 1}, {&apc_law_pid, 1}, {&apc_law_cascade, 2}, {&apc_law_lqg, 1}};

    (void)state;
    for (size_t i = 0; i < sizeof(of) / sizeof(of[0]); i++) {
        for (int mode = APC_MODE_MAN; mode <= APC_MODE_AUTO; mode++) {
            struct rig r, next;

            make(&r, of[i].law, of[i].ny, NULL);
            make(&next, of[i].law, of[i].ny, NULL);
            for (size_t j = 0; j < of[i].law->n_tuning; j++) {
                const struct apc_param *p = &of[i].law->tuning[j];
                double value = strstr(p->name, "tau_d") ? 3.0 : strstr(p->name, "du_max") ? 0.1 : p->initial;

                feed(&r, APC_TUNING, (int)j + 1, value, 0);
                feed(&next, APC_TUNING, (int)j + 1, value, 0);
            }
            for (int k = 1; k < 30; k++)
                tick(&r, k, k < 20 ? APC_MODE_AUTO : mode, wavy(k));
            take_over(&next, &r);
            share(&next, &r);
            for (int k = 30; k < 60; k++) {
                int now = k < 40 ? mode : APC_MODE_AUTO;
                double u = tick(&r, k, now, wavy(k));

                assert_near(tick(&next, k, now, wavy(k)), u, 0.0);
            }
            apc_controller_destroy(r.controller);
            apc_controller_destroy(next.controller);
        }
    }
}

/* The output of the tick is that of the old tuning, and the next ones are those of the new. */
/* Promise(laws/order-of-calls) */
static void a_change_of_tuning_in_auto_gives_no_bump(void **state)
{
    const struct {
        const struct apc_law *law;
        size_t ny;
        int changed; /* parameter, from 1 */
    } of[] = {{&apc_law_pid, 1, 1},
              {&apc_law_pid, 1, 3},
              {&apc_law_pid, 1, 2},
              {&apc_law_cascade, 2, 1},
              {&apc_law_cascade, 2, 12}};

    (void)state;
    for (size_t i = 0; i < sizeof(of) / sizeof(of[0]); i++) {
        struct rig kept, tuned;
        double apart;

        make(&kept, of[i].law, of[i].ny, NULL);
        make(&tuned, of[i].law, of[i].ny, NULL);
        for (int k = 1; k < 15; k++) {
            tick(&kept, k, APC_MODE_AUTO, wavy(k));
            tick(&tuned, k, APC_MODE_AUTO, wavy(k));
        }
        feed(&tuned, APC_TUNING, of[i].changed, of[i].law->tuning[of[i].changed - 1].initial + 2.5, 15);
        assert_near(tick(&tuned, 15, APC_MODE_AUTO, wavy(15)), tick(&kept, 15, APC_MODE_AUTO, wavy(15)),
                    1e-12);
        apart = tick(&tuned, 16, APC_MODE_AUTO, 3.0) - tick(&kept, 16, APC_MODE_AUTO, 3.0);
        assert_true(fabs(apart) > 0.01);
        apc_controller_destroy(kept.controller);
        apc_controller_destroy(tuned.controller);
    }
}

/*
 * Promise(laws/order-of-calls): `track`, `compute`, limits, `update` in that order; no bump from Man,
 *   after a lost measurement, a tuning, a restart.
 */
static void from_man_to_auto_no_law_gives_a_bump(void **state)
{
    const struct {
        const struct apc_law *law;
        size_t ny;
    } of[] = {{&apc_law_pi, 1}, {&apc_law_pid, 1}, {&apc_law_cascade, 2}, {&apc_law_lqg, 1}};

    (void)state;
    for (size_t i = 0; i < sizeof(of) / sizeof(of[0]); i++) {
        struct rig r;

        make(&r, of[i].law, of[i].ny, NULL);
        tick(&r, 1, APC_MODE_AUTO, wavy(1));
        for (int k = 2; k < 10; k++) {
            feed(&r, APC_MANUAL, 1, 1.75, k);
            assert_near(tick(&r, k, APC_MODE_MAN, wavy(k)), 1.75, 0.0);
        }
        assert_near(tick(&r, 10, APC_MODE_AUTO, wavy(10)), 1.75, 1e-12);
        apc_controller_destroy(r.controller);
    }
}

/* Nor at any tick after: a loop without an integral leaves the operator's output, or the integral that it
 * had, little by little. */
static void a_loop_without_integral_leaves_a_bumpless_change_slowly(void **state)
{
    (void)state;
    for (int tuned = 0; tuned <= 1; tuned++) {
        for (int derivative = 0; derivative <= 1; derivative++) {
            struct rig r;
            double u = 0.0;

            make(&r, &apc_law_pid, 1, NULL);
            feed(&r, APC_TUNING, 3, derivative ? 4.0 : 0.0, 0);
            feed(&r, APC_MANUAL, 1, 1.2, 0);
            if (!tuned)
                feed(&r, APC_TUNING, 2, 0.0, 0);
            for (int k = 11; k < 15; k++)
                u = tick(&r, k, tuned ? APC_MODE_AUTO : APC_MODE_MAN, -1.0);
            feed(&r, APC_TUNING, 2, 0.0, 15);
            for (int k = 15; k < 22; k++) {
                double before = u;

                u = tick(&r, k, APC_MODE_AUTO, -1.0);
                assert_near(u, before, tuned && k == 15 ? 0.4 + 1e-12 : 0.1);
            }
            assert_near(u, 2.0, 1.5); /* on the way to Kp e */
            apc_controller_destroy(r.controller);
        }
    }
}

/*
 * Promise(laws/state-law-settings): A state of another law, other settings, or a plug-in compiled from
 *   another source is not taken, and gives no bump.
 */
static void a_state_made_with_other_settings_is_not_taken_but_gives_no_bump(void **state)
{
    const double dev = 0.01;
    const struct apc_setting setting = {"u_scale", NULL, 1, 1, &dev};
    struct rig r, next;
    double last = 0.0, mark, other;

    (void)state;
    make(&r, &apc_law_lqg, 1, NULL);
    make(&next, &apc_law_lqg, 1, &setting);
    for (int k = 1; k < 30; k++)
        last = tick(&r, k, APC_MODE_AUTO, 0.5);
    take_over(&next, &r);
    share(&next, &r);
    assert_near(tick(&next, 30, APC_MODE_AUTO, 0.5), last, 1e-12);
    mark = r.out->vector[0].value[1]; /* behind that of the dimensions */
    other = next.out->vector[0].value[1];
    assert_true(mark < other || mark > other);
    apc_controller_destroy(r.controller);
    apc_controller_destroy(next.controller);
}

/* From Man to Auto while y moves: the derivative has gone on with it, and is there from the first tick. */
/* Promise(laws/order-of-calls) */
static void in_man_a_filter_goes_on(void **state)
{
    double u[2];

    (void)state;
    for (int manual = 0; manual <= 1; manual++) {
        struct rig r;

        make(&r, &apc_law_pid, 1, NULL);
        feed(&r, APC_TUNING, 2, 0.0, 0); /* no integral */
        feed(&r, APC_TUNING, 3, 4.0, 0);
        feed(&r, APC_TUNING, 7, 2.0, 0); /* what was to prevent a bump goes in one period */
        for (int k = 1; k < 20; k++)
            tick(&r, k, manual ? APC_MODE_MAN : APC_MODE_AUTO, 0.1 * k);
        tick(&r, 20, APC_MODE_AUTO, 2.0);
        u[manual] = tick(&r, 21, APC_MODE_AUTO, 2.1);
        apc_controller_destroy(r.controller);
    }
    assert_near(u[1], u[0], 1e-12);
}

/* What y did while it was away is no derivative; the output goes on from where it was held, in Auto, after
 * Man or OOS without a measurement, and in a new controller after the plant went to its safe value. */
/* Promise(laws/order-of-calls) */
static void after_a_lost_measurement_the_derivative_begins_anew(void **state)
{
    (void)state;
    for (int way = 0; way < 4; way++) {
        const int meanwhile[] = {APC_MODE_AUTO, APC_MODE_MAN, APC_MODE_OOS, APC_MODE_AUTO};
        struct rig r, next;
        double u = 0.0;
        int k;

        make(&r, &apc_law_pid, 1, NULL);
        make(&next, &apc_law_pid, 1, NULL);
        feed(&r, APC_TUNING, 2, 1e9, 0); /* hardly an integral */
        feed(&r, APC_TUNING, 3, 40.0, 0);
        for (k = 1; k < 5; k++)
            u = tick(&r, k, APC_MODE_AUTO, 0.0);
        share(&next, &r);
        if (way == 3) {
            take_over(&next, &r);
            assert_near(tick(&next, 9, APC_MODE_AUTO, 50.0), u, 1e-6);
            assert_near(tick(&next, 10, APC_MODE_AUTO, 50.0), u, 1e-6);
        } else {
            for (; k < 7; k++) {
                feed(&r, APC_OPMODE, 1, meanwhile[way], k);
                rows_at(r.in, APC_SENSOR, 1)->status = APC_BAD;
                compute(&r, k, NULL);
            }
            for (; k < 10; k++)
                assert_near(tick(&r, k, APC_MODE_AUTO, 50.0), u, 1e-6);
        }
        apc_controller_destroy(r.controller);
        apc_controller_destroy(next.controller);
    }
}

static void the_first_measurement_gives_no_derivative(void **state)
{
    struct rig r;

    (void)state;
    make(&r, &apc_law_pid, 1, NULL);
    feed(&r, APC_TUNING, 3, 100.0, 0);
    assert_near(tick(&r, 1, APC_MODE_AUTO, 50.0), -50.0, 1e-12);
    apc_controller_destroy(r.controller);
}

/* The first tick already has the operator's tuning, the state that reset made of it as well. */
static void it_begins_with_the_tuning_there_is(void **state)
{
    struct rig r;

    (void)state;
    make(&r, &apc_law_pid, 1, NULL);
    feed(&r, APC_TUNING, 1, 4.0, 0);  /* Kp */
    feed(&r, APC_TUNING, 5, 0.5, 0);  /* b */
    feed(&r, APC_TUNING, 8, 30.0, 0); /* u_bar */
    assert_near(tick(&r, 1, APC_MODE_AUTO, 0.0), 30.0, 1e-12);
    apc_controller_destroy(r.controller);
    make(&r, &apc_law_pid, 1, NULL);
    feed(&r, APC_TUNING, 1, 4.0, 0);
    feed(&r, APC_TUNING, 5, 0.5, 0);
    feed(&r, APC_TUNING, 8, 30.0, 0);
    assert_near(tick(&r, 1, APC_MODE_AUTO, 7.0), 30.0 + 4.0 * (0.5 * 0.0 - 0.5 * 7.0), 1e-12);
    apc_controller_destroy(r.controller);
}

/* ---- A law of one's own ---------------------------------------------------------------------- */

static size_t one_state(const struct apc_dim *dim)
{
    (void)dim;
    return 1;
}

static int show_count(struct apc_law_call *c)
{
    c->u[0] = c->x[0];
    return APC_LAW_GOOD;
}

static void count(struct apc_law_call *c)
{
    c->x[0] += 1.0;
}

static void a_law_without_track_is_not_updated_in_man(void **state)
{
    static const struct apc_law counting = {
        .abi = APC_LAW_ABI, .name = "counting", .n_state = one_state, .compute = show_count, .update = count};
    struct rig r;

    (void)state;
    make(&r, &counting, 1, NULL);
    for (int k = 1; k < 5; k++)
        tick(&r, k, APC_MODE_MAN, 0.0);
    assert_near(tick(&r, 5, APC_MODE_AUTO, 0.0), 0.0, 0.0);
    assert_near(tick(&r, 6, APC_MODE_AUTO, 0.0), 1.0, 0.0);
    apc_controller_destroy(r.controller);
}

/* Its own rows of the tick before are there when it reads, as a rule: they are no reason to update again. */
static void an_output_that_was_confirmed_is_updated_once(void **state)
{
    static const struct apc_law counting = {
        .abi = APC_LAW_ABI, .name = "counting", .n_state = one_state, .compute = show_count, .update = count};
    struct rig r;

    (void)state;
    make(&r, &counting, 1, NULL);
    for (int k = 1; k < 10; k++)
        assert_near(tick(&r, k, APC_MODE_AUTO, 0.0), k - 1.0, 0.0);
    apc_controller_destroy(r.controller);
}

/* u = x; z = 1: nothing feasible, z = 2: late, but usable. */
static int answer(struct apc_law_call *c)
{
    c->u[0] = c->x[0];
    if (c->z[0] == 1.0)
        snprintf(c->why, APC_LAW_WHY, "rows 2 and 5 contradict");
    return c->z[0] == 1.0 ? APC_LAW_INFEASIBLE : c->z[0] == 2.0 ? APC_LAW_LATE : APC_LAW_SUBOPTIMAL;
}

/* Promise(laws/answer-infeasible-failed) */
static void an_infeasible_answer_is_held_and_the_state_kept(void **state)
{
    static const struct apc_law law = {
        .abi = APC_LAW_ABI, .name = "answer", .n_state = one_state, .compute = answer, .update = count};
    const double asked[] = {0.0, 2.0, 1.0, 0.0}, given_u[] = {0.0, 1.0, 1.0, 2.0};
    struct apc_notice notice;
    struct rig r;

    (void)state;
    make(&r, &law, 1, NULL);
    for (int k = 0; k < 4; k++) {
        feed(&r, APC_SENSOR, 1, 0.0, k);
        feed(&r, APC_SETPOINT, 1, asked[k], k);
        feed(&r, APC_OPMODE, 1, APC_MODE_AUTO, k);
        compute(&r, k, &notice);
        assert_near(given(&r, APC_ACTUATOR, 1)->value, given_u[k], 0.0);
        assert_int_equal(given(&r, APC_ACTUATOR, 1)->status, k == 2 ? APC_UNCERTAIN_LAST_USABLE : APC_GOOD);
        if (k == 2)
            assert_string_equal(notice.text, "output held: law answer: rows 2 and 5 contradict");
    }
    apc_controller_destroy(r.controller);
}

static double told_budget;
static apc_ns told_deadline;

static int note_time(struct apc_law_call *c)
{
    told_budget = c->budget;
    told_deadline = c->deadline;
    return APC_LAW_GOOD;
}

/* Half the period where nothing is said; in virtual time it has no end. */
static void a_law_is_told_how_long_it_may_compute(void **state)
{
    static const struct apc_law law = {.abi = APC_LAW_ABI, .name = "timed", .compute = note_time};

    (void)state;
    for (int real = 0; real <= 1; real++)
        for (int said = 0; said <= 1; said++) {
            const apc_ns budget = said ? S / 4 : 0;
            const struct apc_controller_options o = {.size = sizeof(o),
                                                     .law = &law,
                                                     .dim = {1, 1, 1, 0},
                                                     .period = PERIOD,
                                                     .budget = budget,
                                                     .real_time = real,
                                                     .horizon = 2 * PERIOD};
            struct apc_controller *controller;
            struct rig r;

            assert_int_equal(apc_controller_create(&controller, &o, NULL), 0);
            begin(&r, controller, 1);
            (void)tick(&r, 3, APC_MODE_AUTO, 0.0);
            assert_near(told_budget, said ? 0.25 : 1.0, 0.0);
            assert_true(told_deadline == (real ? 3 * PERIOD + (said ? S / 4 : S) : 0));
            apc_controller_destroy(controller);
        }
}

static void a_budget_beyond_the_period_is_refused(void **state)
{
    struct apc_controller_options o = {.size = sizeof(o),
                                       .law = &apc_law_pi,
                                       .dim = {1, 1, 1, 0},
                                       .period = PERIOD,
                                       .budget = PERIOD + 1,
                                       .horizon = PERIOD};
    struct apc_controller *controller;
    struct apc_error why;

    (void)state;
    assert_int_equal(apc_controller_create(&controller, &o, &why), APC_EINVAL);
    assert_non_null(strstr(why.text, "budget"));
    o.budget = -1;
    assert_int_equal(apc_controller_create(&controller, &o, &why), APC_EINVAL);
}

/* People know names, not numbers. */
static void what_is_refused_or_missing_is_called_by_its_name(void **state)
{
    static const struct apc_controller_setpoint z = {.name = "level", .id = 7, .low = 0.0, .high = 2.0};
    static const struct apc_controller_loop loop = {
        .name = "v1", .id = 3, .mode = 2, .low = -9.0, .high = 9.0};
    static const int y = 4;
    const struct apc_controller_options o = {.size = sizeof(o),
                                             .law = &apc_law_pi,
                                             .dim = {1, 1, 1, 0},
                                             .period = PERIOD,
                                             .horizon = 2 * PERIOD,
                                             .y = &y,
                                             .z = &z,
                                             .loop = &loop};
    struct apc_controller *controller;
    struct apc_notice notice;
    struct rig r;

    (void)state;
    assert_int_equal(apc_controller_create(&controller, &o, NULL), 0);
    begin(&r, controller, 1);
    feed(&r, APC_SETPOINT, 7, 5.0, 1);
    compute(&r, 1, &notice);
    assert_string_equal(notice.text, "setpoint level refused: 5 is not within 0 to 2");
    feed(&r, APC_TUNING, 1, 1e99, 2);
    compute(&r, 2, &notice);
    assert_non_null(strstr(notice.text, "Kp of v1 refused"));
    feed(&r, APC_SETPOINT, 7, 1.0, 3);
    feed(&r, APC_OPMODE, 2, APC_MODE_AUTO, 3);
    compute(&r, 3, &notice);
    assert_non_null(strstr(notice.text, "measurement 4 is missing"));
    feed(&r, APC_OPMODE, 2, APC_MODE_MAN, 4);
    compute(&r, 4, &notice);
    feed(&r, APC_MANUAL, 2, 99.0, 5);
    compute(&r, 5, &notice);
    assert_string_equal(notice.text, "manual output v1 refused: 99 is not within -9 to 9");
    apc_controller_destroy(controller);
}

/* Of each output: a number, a course of two, a number. z = 1: no answer, z = 2: one that is no number. */
static int create_publisher(const struct apc_law_setup *setup, struct apc_law_needs *needs, void **self,
                            struct apc_error *why)
{
    static const struct apc_published what[] = {
        {"first", "V", NULL, 0, 0.0}, {"course", "V", NULL, 2, 1.0}, {"second", "V", NULL, 0, 0.0}};

    (void)setup, (void)self, (void)why;
    needs->n_published = 3;
    needs->published = what;
    return 0;
}

static int publish(struct apc_law_call *c)
{
    const double of[] = {c->y[0], c->y[0] + 1.0, c->y[0] + 2.0, c->y[0] + 3.0};

    memcpy(c->published, of, sizeof(of));
    if (c->z[0] == 2.0)
        c->published[3] = (double)NAN;
    c->u[0] = c->y[0];
    return c->z[0] == 1.0 ? APC_LAW_INFEASIBLE : APC_LAW_GOOD;
}

static const struct apc_law publisher = {
    .abi = APC_LAW_ABI, .name = "publisher", .create = create_publisher, .compute = publish};

static void make_publisher(struct rig *r, int estimate, int prediction)
{
    const struct apc_controller_options o = {.size = sizeof(o),
                                             .law = &publisher,
                                             .dim = {2, 2, 2, 0},
                                             .period = PERIOD,
                                             .horizon = 2 * PERIOD,
                                             .estimate = estimate,
                                             .prediction = prediction};
    struct apc_controller *controller;

    assert_int_equal(apc_controller_create(&controller, &o, NULL), 0);
    begin(r, controller, 2);
}

static void what_a_law_publishes_is_written_with_its_tick(void **state)
{
    struct rig r;

    (void)state;
    make_publisher(&r, 11, 5);
    feed(&r, APC_OPMODE, 2, APC_MODE_AUTO, 1);
    feed(&r, APC_SETPOINT, 2, 0.0, 1);
    (void)tick(&r, 1, APC_MODE_AUTO, 10.0); /* y2 is 10.1 */
    assert_near(given(&r, APC_ESTIMATE, 11)->value, 10.0, 0.0);
    assert_near(given(&r, APC_ESTIMATE, 12)->value, 13.0, 0.0);
    assert_near(given(&r, APC_ESTIMATE, 13)->value, 10.1, 1e-12);
    assert_near(given(&r, APC_ESTIMATE, 14)->value, 13.1, 1e-12);
    assert_int_equal(given(&r, APC_ESTIMATE, 11)->origin, r.out->vector[0].seq);
    assert_int_equal(r.out->n_vectors, 3);
    assert_int_equal(r.out->vector[0].table, APC_TICK);
    for (int i = 0; i < 2; i++) {
        const struct apc_vector *v = &r.out->vector[1 + i];

        assert_int_equal(v->table, APC_PREDICTION);
        assert_int_equal(v->id, 5 + i);
        assert_int_equal(v->n, 2);
        assert_int_equal(v->seq, r.out->vector[0].seq);
        assert_near(v->value[0], 11.0 + 0.1 * i, 1e-12);
        assert_near(v->value[1], 12.0 + 0.1 * i, 1e-12);
    }
    feed(&r, APC_SENSOR, 1, 3.0, 2);
    feed(&r, APC_SENSOR, 2, 4.0, 2);
    feed(&r, APC_SETPOINT, 1, 1.0, 2);
    feed(&r, APC_SETPOINT, 2, 2.0, 2);
    compute(&r, 2, NULL);
    assert_int_equal(given(&r, APC_ESTIMATE, 11)->seq, 0); /* it gave no answer */
    assert_near(given(&r, APC_ESTIMATE, 13)->value, 4.0, 0.0);
    assert_int_equal(given(&r, APC_ESTIMATE, 14)->seq, 0); /* no number */
    assert_int_equal(r.out->n_vectors, 2);
    assert_int_equal(r.out->vector[1].id, 6);
    feed(&r, APC_OPMODE, 1, APC_MODE_OOS, 3);
    feed(&r, APC_OPMODE, 2, APC_MODE_OOS, 3);
    compute(&r, 3, NULL);
    assert_int_equal(given(&r, APC_ESTIMATE, 13)->seq, 0); /* nobody asked it */
    assert_int_equal(r.out->n_vectors, 1);
    apc_controller_destroy(r.controller);
}

static void seqs_go_on_from_what_was_published_and_who_does_not_want_it_has_none(void **state)
{
    struct apc_rows *former;
    struct rig r;

    (void)state;
    make_publisher(&r, 1, 0);
    former = apc_controller_former(r.controller);
    rows_at(former, APC_ESTIMATE, 3)->seq = 70; /* the tick rows are gone */
    (void)apc_controller_resume(r.controller, 0);
    (void)tick(&r, 1, APC_MODE_AUTO, 1.0);
    assert_int_equal(given(&r, APC_ESTIMATE, 1)->seq, 71);
    assert_int_equal(r.out->n_vectors, 1);
    apc_controller_destroy(r.controller);
    make_publisher(&r, 0, 1);
    (void)tick(&r, 1, APC_MODE_AUTO, 1.0);
    assert_int_equal(given(&r, APC_ESTIMATE, 1)->seq, 0);
    assert_int_equal(r.out->n_vectors, 2);
    assert_near(r.out->vector[1].value[0], 2.0, 0.0);
    apc_controller_destroy(r.controller);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(every_law_restarted_goes_on_bit_for_bit),
        cmocka_unit_test(a_change_of_tuning_in_auto_gives_no_bump),
        cmocka_unit_test(from_man_to_auto_no_law_gives_a_bump),
        cmocka_unit_test(a_loop_without_integral_leaves_a_bumpless_change_slowly),
        cmocka_unit_test(a_state_made_with_other_settings_is_not_taken_but_gives_no_bump),
        cmocka_unit_test(in_man_a_filter_goes_on),
        cmocka_unit_test(after_a_lost_measurement_the_derivative_begins_anew),
        cmocka_unit_test(the_first_measurement_gives_no_derivative),
        cmocka_unit_test(it_begins_with_the_tuning_there_is),
        cmocka_unit_test(a_law_without_track_is_not_updated_in_man),
        cmocka_unit_test(an_infeasible_answer_is_held_and_the_state_kept),
        cmocka_unit_test(an_output_that_was_confirmed_is_updated_once),
        cmocka_unit_test(a_law_is_told_how_long_it_may_compute),
        cmocka_unit_test(a_budget_beyond_the_period_is_refused),
        cmocka_unit_test(what_a_law_publishes_is_written_with_its_tick),
        cmocka_unit_test(seqs_go_on_from_what_was_published_and_who_does_not_want_it_has_none),
        cmocka_unit_test(what_is_refused_or_missing_is_called_by_its_name),
    };

    return cmocka_run_group_tests(tests, NULL, NULL);
}

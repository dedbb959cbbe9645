/* SPDX-License-Identifier: BSD-3-Clause */
/* Steady states of nonlinear models, found from other ones: of reactors whose gain changes its sign, and
 * which have several for one input. */
/* Promise(laws/nmpc-options-mpc) */
#include "check.h"
#include "plant/plant_internal.h"
#include "predict/predict_internal.h"
#include "predict/shooting.h"
#include "predict/target.h"

#include <string.h>

enum { NX_MOST = 4, NU_MOST = 2 };

struct scene {
    const struct apc_model *model;
    struct apc_shooting *shoot;
    struct apc_linear *linear;
    struct apc_target *target;
    struct apc_target_call call;
    double x[NX_MOST], u[NU_MOST], y[NU_MOST], low[NU_MOST], high[NU_MOST], reference[NU_MOST], w[NU_MOST];
    bool reachable;
};

static const double ones[NU_MOST] = {1.0, 1.0}, nobody[NU_MOST] = {0.0, 0.0};
static const double moves[NU_MOST] = {1.0 / 9.0, 1.0 / 640e3}; /* deviations of 3 1/h and 800 kJ/h */
static const unsigned first_both[NU_MOST] = {1, 1};

static int linearise(void *ctx, const double *x, const double *u, struct apc_linear *to, double *drift)
{
    return apc_shooting_sample(ctx, x, u, nobody, to, drift);
}

static void begin(struct scene *s, const struct apc_model *model, double Ts, const double *x, const double *u)
{
    const unsigned block[] = {1};
    const struct apc_shooting_options options = {
        .model = model, .Ts = Ts, .steps = 10, .horizon = 1, .blocks = 1, .block = block, .u0 = u};
    struct apc_error why;

    memset(s, 0, sizeof *s);
    s->model = model;
    memcpy(s->x, x, model->nx * sizeof *x);
    memcpy(s->u, u, model->nu * sizeof *u);
    memcpy(s->reference, u, model->nu * sizeof *u);
    for (size_t j = 0; j < model->nu; j++) {
        s->low[j] = model->input[j].low;
        s->high[j] = model->input[j].high;
    }
    s->call = (struct apc_target_call){.reference = s->reference,
                                       .low = s->low,
                                       .high = s->high,
                                       .y_low = s->w,
                                       .y_high = s->w,
                                       .q = ones,
                                       .rank = first_both,
                                       .ranks = 1};
    assert_int_equal(apc_shooting_create(&s->shoot, &options, &why), 0);
    assert_int_equal(apc_linear_allocate(&s->linear, model->nx, model->nu, 0, model->ny, &why), 0);
    s->linear->nx_plant = model->nx;
    assert_int_equal(linearise(s->shoot, s->x, s->u, s->linear, (double[NX_MOST]){0}), 0);
    if (apc_target_create(&s->target, s->linear, &why) < 0)
        fail_msg("%s", why.text);
    assert_int_equal(apc_target_tune(s->target, model->ny, nobody, moves, &why), 0);
}

static void end(struct scene *s)
{
    apc_target_destroy(s->target);
    apc_linear_destroy(s->linear);
    apc_shooting_destroy(s->shoot);
}

static int search(struct scene *s)
{
    s->call.ctx = s->shoot;
    return apc_target_search(s->target, &s->call, linearise, s->x, s->u, s->y, &s->reachable);
}

/* What the model makes of the state in a second, over its size. */
static void assert_rests(const struct scene *s)
{
    double input[NU_MOST + 4], slope[NX_MOST], p[32];

    apc_param_initials(s->model->disturbance, s->model->nd, input + s->model->nu);
    apc_param_initials(s->model->param, s->model->np, p);
    memcpy(input, s->u, s->model->nu * sizeof *input);
    assert_int_equal(s->model->f(0.0, s->x, input, p, slope), 0);
    for (size_t i = 0; i < s->model->nx; i++)
        assert_near(slope[i], 0.0, 1e-9 * (1.0 + fabs(s->x[i])));
}

static void from_any_setpoint_to_any_other_the_steady_state_is_found(void **state)
{
    static const double x[] = {0.515, 0.63, 38.6}, u[] = {500.0};
    struct scene s;
    (void)state;

    for (double from = 6.0; from < 78.0; from += 6.0) {
        for (double to = 6.0; to < 78.0; to += 6.0) {
            begin(&s, &apc_model_adiabatic_cstr, 1.0, x, u);
            s.w[0] = from;
            assert_int_equal(search(&s), 0);
            s.w[0] = to;
            if (search(&s) < 0 || !s.reachable)
                fail_msg("from %g to %g: y %g with u %g", from, to, s.y[0], s.u[0]);
            assert_near(s.y[0], to, 1e-9);
            assert_rests(&s);
            end(&s);
        }
    }
}

/* Of cB there is a most, at about 1.09 mol/L; on either side of it the gain from F has another sign. */
static void beyond_the_top_of_a_curve_the_top_is_the_nearest(void **state)
{
    static const double x[] = {1.61687, 1.02236, 113.137, 111.853}, u[] = {8.0, -1113.5};
    double top = 0.0;
    struct scene s;
    (void)state;

    begin(&s, &apc_model_van_de_vusse, 20.0, x, u);
    s.low[0] = 3.0;
    s.high[0] = 35.0;
    s.low[1] = s.high[1] = u[1]; /* somebody else's */
    s.call.q = (const double[]){1.0, 0.0};
    s.call.y_low = (const double[]){1.2, -HUGE_VAL};
    s.call.y_high = (const double[]){1.2, HUGE_VAL};
    assert_int_equal(search(&s), 0);
    assert_false(s.reachable);
    assert_rests(&s);
    const double found = s.y[0];
    for (double feed = s.u[0] - 3.0; feed < s.u[0] + 3.0; feed += 0.5) { /* one after the other by hand */
        struct scene by_hand;

        begin(&by_hand, &apc_model_van_de_vusse, 20.0, x, u);
        by_hand.low[0] = by_hand.high[0] = feed;
        by_hand.low[1] = by_hand.high[1] = u[1];
        by_hand.call.q = nobody;
        by_hand.call.y_low = (const double[]){-HUGE_VAL, -HUGE_VAL};
        by_hand.call.y_high = (const double[]){HUGE_VAL, HUGE_VAL};
        assert_int_equal(search(&by_hand), 0);
        assert_rests(&by_hand);
        top = fmax(top, by_hand.y[0]);
        end(&by_hand);
    }
    assert_true(top <= found + 1e-9);
    end(&s);
}

/* One setpoint of two, by rank, where an input has too little. */
static void the_first_rank_is_kept_where_an_input_saturates(void **state)
{
    static const double x[] = {1.61687, 1.02236, 113.137, 111.853}, u[] = {8.0, -1113.5};
    static const double over_deviations[] = {2500.0, 1.0}; /* 0.02 mol/L, 1 degC */
    static const unsigned rank[][NU_MOST] = {{1, 2}, {2, 1}};
    (void)state;

    for (size_t first = 0; first < 2; first++) {
        struct scene s;

        begin(&s, &apc_model_van_de_vusse, 20.0, x, u);
        s.low[0] = 3.0;
        s.high[0] = 35.0;
        s.high[1] = -500.0;
        s.call.rank = rank[first];
        s.call.q = over_deviations;
        s.call.ranks = 2;
        s.w[0] = 0.9;
        s.w[1] = 115.9;
        assert_int_equal(search(&s), 0);
        assert_false(s.reachable);
        assert_near(s.y[first], s.w[first], 1e-6);
        assert_rests(&s);
        end(&s);
    }
}

static bool at_once(void *ctx)
{
    (void)ctx;
    return true;
}

/* Cut short again and again it comes to the same end as in one go. */
/* Promise(laws/nmpc-outputs-act) */
static void a_search_takes_the_steps_it_is_given_and_goes_on_from_there(void **state)
{
    static const double x[] = {0.515, 0.63, 38.6}, u[] = {500.0};
    struct scene whole, bit;
    unsigned left = 0, cut = 0, used = 60;
    int rc;
    (void)state;

    begin(&whole, &apc_model_adiabatic_cstr, 1.0, x, u);
    whole.w[0] = 60.0;
    whole.call.left = &used;
    assert_int_equal(search(&whole), 0);
    used = 60 - used;
    begin(&bit, &apc_model_adiabatic_cstr, 1.0, x, u);
    bit.w[0] = 60.0;
    bit.call.left = &left;
    assert_int_equal(search(&bit), APC_ETIMEDOUT);
    assert_memory_equal(bit.x, x, sizeof x); /* nothing was left */
    while (left = 1, (rc = search(&bit)) == APC_ETIMEDOUT) {
        assert_int_equal(left, 0);
        assert_in_range(++cut, 1, used);
    }
    assert_int_equal(rc, 0);
    assert_int_equal(cut + 1, used);
    assert_memory_equal(bit.u, whole.u, sizeof u);
    bit.call.left = NULL;
    bit.call.enough = at_once;
    assert_int_equal(search(&bit), APC_ETIMEDOUT);
    end(&whole);
    end(&bit);
}

/* ---- Of linear models ------------------------------------------------------------------------------- */

enum { NX = 3, NU = 3, NY = 5, PROGRAMS = 2000 };

static double sway(struct apc_random *random)
{
    return 2.0 * apc_random_uniform(random) - 1.0;
}

/* Three inputs, three states, five outputs, of which two are nearly combinations of the others. */
static struct apc_linear *draw(struct apc_random *random, double apart)
{
    double A[NX * NX] = {0.0}, B[NX * NU], C[NY * NX];
    static const double none[NY * NU], rest[NY];
    struct apc_linear_continuous from = {.size = sizeof from,
                                         .nx = NX,
                                         .nu = NU,
                                         .ny = NY,
                                         .A = A,
                                         .B = B,
                                         .C = C,
                                         .D = none,
                                         .x0 = rest,
                                         .u0 = rest,
                                         .y0 = rest};
    struct apc_linear *model;

    for (size_t i = 0; i < NX; i++)
        A[i * NX + i] = -pow(10.0, 2.0 * sway(random));
    for (size_t i = 0; i < NX * NU; i++)
        B[i] = sway(random) * pow(10.0, 3.0 * sway(random));
    for (size_t i = 0; i < NX * NX; i++)
        C[i] = sway(random);
    for (size_t i = 0; i < NX; i++) {
        C[3 * NX + i] = C[i] * (1.0 + apart * sway(random));
        C[4 * NX + i] = C[NX + i] + C[i] + apart * sway(random);
    }
    assert_int_equal(apc_linear_from_continuous(&model, &from, 0.1, NULL), 0);
    return model;
}

/* By how much the ranks up to @p rank miss their ranges. */
static double missed(const struct apc_target_call *call, const double *y, unsigned rank)
{
    double most = 0.0;

    for (size_t c = 0; c < NY; c++) {
        if (call->rank[c] <= rank)
            most = fmax(most, fmax(call->y_low[c] - y[c], y[c] - call->y_high[c]) / (1.0 + fabs(y[c])));
    }
    return most;
}

/* Of no width, or nearly touching each other, of one rank or of several: there is a steady state to aim at,
 * and what the first rank reaches alone it reaches in spite of the others. */
/* Promise(laws/mpc-steady-states) */
static void ranges_however_narrow_have_a_steady_state_to_aim_at(void **state)
{
    static const double s[NU] = {1.0, 1.0, 1.0}, q[NY] = {1.0, 1.0, 1.0, 1.0, 1.0}, at[NX] = {0.0};
    struct apc_random random;
    (void)state;

    apc_random_init(&random, 20261128u, "narrow");
    for (int k = 0; k < PROGRAMS; k++) {
        const double apart = pow(10.0, -(k % 17)), about = sway(&random);
        double low[NU], high[NU], y_low[NY], y_high[NY], x[NX], u[NU], y[NY], alone[NY];
        unsigned rank[NY];
        struct apc_linear *model = draw(&random, apart);
        struct apc_target *target;
        struct apc_target_call call = {.unknown = at,
                                       .reference = at,
                                       .low = low,
                                       .high = high,
                                       .y_low = y_low,
                                       .y_high = y_high,
                                       .q = q,
                                       .rank = rank,
                                       .ranks = 3};
        bool reachable;
        int rc;

        assert_int_equal(apc_target_create(&target, model, NULL), 0);
        assert_int_equal(apc_target_tune(target, NY, at, s, NULL), 0);
        for (size_t j = 0; j < NU; j++) {
            low[j] = -pow(10.0, 3.0 * sway(&random));
            high[j] = pow(10.0, 3.0 * sway(&random));
        }
        for (size_t c = 0; c < NY; c++) {
            const double width = pow(10.0, -14.0 * apc_random_uniform(&random));

            rank[c] = k % 2 ? 1 + (unsigned)(3.0 * apc_random_uniform(&random)) : 1;
            y_low[c] = c % 3 == 0 ? about + (k % 4 < 2 ? apart * sway(&random) : 0.0)
                                  : about * (double)(1 + c) + (k % 8 < 4 ? sway(&random) : 0.0);
            y_high[c] = y_low[c] + (apc_random_uniform(&random) < 0.5 ? 0.0 : width);
        }
        call.ranks = 1;
        rc = apc_target_find(target, &call, x, u, alone, &reachable);
        if (rc == 0) {
            call.ranks = 3;
            rc = apc_target_find(target, &call, x, u, y, &reachable);
        }
        if (rc < 0)
            fail_msg("program %d: %s", k, apc_err_name(rc));
        for (size_t j = 0; j < NU; j++)
            assert_true(u[j] >= low[j] && u[j] <= high[j]);
        if (missed(&call, y, 1) > missed(&call, alone, 1) + 1e-2)
            fail_msg("program %d: rank 1 misses by %g, alone by %g", k, missed(&call, y, 1),
                     missed(&call, alone, 1));
        apc_target_destroy(target);
        apc_linear_destroy(model);
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(from_any_setpoint_to_any_other_the_steady_state_is_found),
        cmocka_unit_test(beyond_the_top_of_a_curve_the_top_is_the_nearest),
        cmocka_unit_test(the_first_rank_is_kept_where_an_input_saturates),
        cmocka_unit_test(a_search_takes_the_steps_it_is_given_and_goes_on_from_there),
        cmocka_unit_test(ranges_however_narrow_have_a_steady_state_to_aim_at),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}

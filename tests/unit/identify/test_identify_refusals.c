/* SPDX-License-Identifier: BSD-3-Clause */
/* What no model can be made of is said in a sentence: of which input, output, run and sample, and with what
 * would do. What just suffices is taken. */
#include "base/base_internal.h"
#include "check.h"
#include "records.h"

#include <stdlib.h>
#include <string.h>

enum { N = 400, INPUTS = 3 };

static const struct apc_transfer plant[] = {{.gain = 2.0, .tau = {1.0}}, {.gain = -1.0, .tau = {2.0}},
                                            {.gain = 0.5, .tau = {0.7}}, {.gain = 1.0, .tau = {1.5}},
                                            {.gain = 0.3, .tau = {1.0}}, {.gain = -0.8, .tau = {0.6}}};

static struct record_test *make(void)
{
    return record_simulate(plant, INPUTS, 2, N, 0.5, (const size_t[]){9, 13, 17}, 0.02, 0.0, 12);
}

/* ---- What is wrong with it -------------------------------------------------------------------------- */

static void set_input(struct record_test *t, size_t j, size_t from, size_t to, double value)
{
    for (size_t k = from; k < to; k++)
        t->u[k * INPUTS + j] = value;
}

static void set_output(struct record_test *t, size_t i, size_t from, size_t to, double value)
{
    for (size_t k = from; k < to; k++)
        t->y[k * 2 + i] = value;
}

static void two_runs(struct record_test *t, size_t second, size_t n)
{
    t->begin[0] = 0;
    t->begin[1] = second;
    t->record.n = n;
    t->record.runs = 2;
    t->record.begin = t->begin;
}

static void no_inputs(struct record_test *t)
{
    t->record.u = NULL;
}
static void no_outputs(struct record_test *t)
{
    t->record.ny = 0;
}
static void many_inputs(struct record_test *t)
{
    t->record.nu = 1000, t->record.nd = 1;
}
static void no_period(struct record_test *t)
{
    t->record.Ts = 0.0;
}
static void too_short(struct record_test *t)
{
    t->record.n = 49;
}
static void just_long_enough(struct record_test *t)
{
    t->record.n = 50;
}
static void nowhere(struct record_test *t)
{
    t->record.runs = 2;
}
static void late_begin(struct record_test *t)
{
    two_runs(t, 100, N), t->begin[0] = 1;
}
static void many_runs(struct record_test *t)
{
    two_runs(t, 100, N), t->record.runs = 101;
}
static void short_first(struct record_test *t)
{
    two_runs(t, 49, N);
}
static void short_second(struct record_test *t)
{
    two_runs(t, N - 49, N);
}
static void beyond(struct record_test *t)
{
    two_runs(t, N + 1, N);
}
static void just_two(struct record_test *t)
{
    two_runs(t, 50, N);
}
static void no_number(struct record_test *t)
{
    set_input(t, 1, 7, 8, (double)NAN);
}
static void last_too_large(struct record_test *t)
{
    set_input(t, 2, N - 1, N, 2e300);
}
static void no_measurement(struct record_test *t)
{
    set_output(t, 1, 5, 6, -2e300);
}
static void still_input(struct record_test *t)
{
    set_input(t, 2, 0, N, 0.25);
}
static void almost_still_input(struct record_test *t)
{
    set_input(t, 2, 0, N, 0.25), set_input(t, 2, 9, N, 0.25 + 2e-10);
}
static void stuck_output(struct record_test *t)
{
    set_output(t, 1, 0, N, -7.5);
}
static void few_outputs(struct record_test *t)
{
    set_output(t, 1, 49, N, (double)NAN);
}
static void few_of_many(struct record_test *t)
{
    two_runs(t, 200, N), set_output(t, 0, 0, 351, (double)NAN);
}
static void run_by_run(struct record_test *t)
{
    two_runs(t, 200, N);
    set_input(t, 0, 0, 200, 1.0);
    set_input(t, 0, 200, N, 2.0);
}
static void alike(struct record_test *t)
{
    for (size_t k = 0; k < N; k++)
        t->u[k * INPUTS + 1] = 2.0 * t->u[k * INPUTS] + 0.005 * sin((double)k);
}
static void together(struct record_test *t)
{
    for (size_t k = 0; k < N; k++)
        t->u[k * INPUTS + 2] = t->u[k * INPUTS] - 3.0 * t->u[k * INPUTS + 1];
}
static void just_apart(struct record_test *t)
{
    for (size_t k = 0; k < N; k++)
        t->u[k * INPUTS + 1] = t->u[k * INPUTS] + 0.03 * sin((double)k);
}
static void feedback(struct record_test *t)
{
    for (size_t k = 1; k < N; k++)
        t->u[k * INPUTS + 1] = 0.4 * t->y[k * 2] - 0.7 * t->y[k * 2 + 1] + 0.2 * t->y[(k - 1) * 2];
}
static void seldom_feedback(struct record_test *t)
{
    for (size_t k = 1; k < N; k++)
        t->u[k * INPUTS + 2] = k % 3 ? t->u[(k - 1) * INPUTS + 2] : -0.7 * t->y[k * 2 + 1];
}
/* Input 3 moves by half a sample before every fifth one: to where a controller or, @p by_hand, a person wants it. The
 * second output is what the plant makes of it. */
static void move_between(struct record_test *t, bool by_hand)
{
    double level = 0.0, *const u = t->u + 2, *const y = t->y + 1;
    for (size_t k = 1; k < N; k++) {
        const double was = level;
        y[k * 2] =
            0.6 * y[(k - 1) * 2] + 0.4 * u[(k - 1) * INPUTS] + (by_hand ? 0.0 : 0.1 * sin((double)(k * k)));
        level = k % 5 ? level : by_hand ? sin((double)(k * k)) : -0.7 * y[k * 2];
        u[k * INPUTS] = (was + level) / 2.0;
    }
}
static void moved_between(struct record_test *t)
{
    move_between(t, true);
}
static void feedback_between(struct record_test *t)
{
    move_between(t, false);
}
static void measured_feedback(struct record_test *t) /* a disturbance is nobody's output */
{
    seldom_feedback(t);
    t->record.nu = 2;
    t->record.nd = 1;
}

static const struct {
    void (*spoil)(struct record_test *t);
    const char *says;
} of[] = {
    {no_inputs, "record: it must have inputs and measurements, 1000 of each at most"},
    {no_outputs, "record: it must have inputs and measurements, 1000 of each at most"},
    {many_inputs, "record: it must have inputs and measurements, 1000 of each at most"},
    {no_period, "period 0 s: must be from 1e-05 s (10 us) to 31622400 s (366 days)"},
    {too_short, "record: 49 samples; 50 are the least for 3 inputs"},
    {just_long_enough, "it is taken"},
    {nowhere, "record: 2 runs must say where they begin, the first at 0; 100 are the most"},
    {late_begin, "record: 2 runs must say where they begin, the first at 0; 100 are the most"},
    {many_runs, "record: 101 runs must say where they begin, the first at 0; 100 are the most"},
    {short_first, "record: run 1 has 49 samples; 50 are the least for 3 inputs"},
    {short_second, "record: run 2 has 49 samples; 50 are the least for 3 inputs"},
    {beyond, "record: run 2 begins behind the last of 400 samples"},
    {just_two, "it is taken"},
    {no_number, "record: input 2 is no number at sample 8: what went in must be known always"},
    {last_too_large, "record: input 3 is no number at sample 400: what went in must be known always"},
    {no_measurement, "record: output 2 is -2e+300 at sample 6: that is no measurement"},
    {still_input,
     "input 3 is 0.25 all the time: its effect cannot be found. Move it in a test, or leave it out"},
    {almost_still_input,
     "input 3 is 0.25 all the time: its effect cannot be found. Move it in a test, or leave it out"},
    {stuck_output, "output 2 is -7.5 all the time: no input moves it, or its sensor is stuck"},
    {few_outputs, "output 2 has 49 good samples of 400: a tenth of them, and 50, are needed. Take another "
                  "window, or leave it out"},
    {few_of_many, "output 1 has 49 good samples of 400: a tenth of them, and 50, are needed. Take another "
                  "window, or leave it out"},
    {run_by_run, "input 1 is 2 all the time: its effect cannot be found. Move it in a test, or leave it out"},
    {alike, "input 2 moves as input 1 does, but for 0.18 %: their effects cannot be separated. Move them at "
            "different times"},
    {together, "input 3 moves as input 2, or several together, does, but for 0 %: their effects cannot be "
               "separated. Move them at different times"},
    {just_apart, "it is taken"},
    {feedback, "input 2 only follows from the measurements through a controller: the plant cannot be "
               "distinguished from the controller. Record steps of the setpoint, or of the output in Man"},
    {seldom_feedback,
     "input 3 only follows from the measurements through a controller: the plant cannot be distinguished "
     "from the controller. Record steps of the setpoint, or of the output in Man"},
    {moved_between, "it is taken"},
    {feedback_between,
     "input 3 only follows from the measurements through a controller: the plant cannot be distinguished "
     "from the controller. Record steps of the setpoint, or of the output in Man"},
    {measured_feedback, "it is taken"},
};

/*
 * Promise(identification/record-tell-refused): A record that cannot tell is refused with the reason and
 *   what to do.
 */
static void it_is_said_what_a_record_lacks(void **state)
{
    size_t wrong = 0;
    (void)state;

    for (size_t i = 0; i < sizeof of / sizeof *of; i++) {
        struct record_test *t = make();
        struct apc_error why = {"it is taken"};

        of[i].spoil(t);
        (void)apc_record_check(&t->record, &why);
        if (strcmp(why.text, of[i].says) != 0) {
            print_message("number %zu: %s\n", i, why.text);
            wrong++;
        }
        free(t);
    }
    assert_int_equal(wrong, 0);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(it_is_said_what_a_record_lacks),
    };

    return cmocka_run_group_tests(tests, NULL, NULL);
}

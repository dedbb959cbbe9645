/* SPDX-License-Identifier: BSD-3-Clause */
/* Scenarios: what expectations mean, over trajectories made by hand; what is refused; a run of one. */
#include "check.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "check/check.h"
#include "simulation/simulation.h"

#define S APC_NS_PER_S

/* A loop y, r, u with an alarm, of 100 s. */
static const char loop_text[] =
    "name = \"t\"; duration = 100.0;"
    "measurements = ( { name = \"y\"; unit = \"m\"; low = -100.0; high = 100.0; alarms = ( { kind = \"low\"; "
    "limit = "
    "5.0; } ); },"
    "                 { name = \"spare\"; } );"
    "setpoints = ( { name = \"r\"; low = -100.0; high = 100.0; initial = 10.0; } );"
    "outputs = ( { name = \"u\"; low = -10.0; high = 10.0; safe = 1.0; fault = 2.0; } );"
    "plant = { model = \"%s\"; period = 0.2; }; client = { period = 0.5; };"
    "controllers = ( { name = \"c\"; law = \"pi\"; period = 2.0; measurements = [\"y\"]; setpoints = "
    "[\"r\"]; outputs "
    "= [\"u\"];"
    "  tuning = ( { Kp = 0.2; tau_i = 10.0; } ); } );";

struct room {
    struct experiment e;
    struct check_sources sources;
    struct check_trajectory trajectory[8];
};

static int begin(void **state)
{
    static struct room room;
    struct apc_error why;
    char text[2000];
    room = (struct room){.sources = {NULL, 0, 0}};
    snprintf(text, sizeof text, loop_text, "double-tank");
    if (experiment_parse(&room.e, &(struct experiment_source){.file = "t.conf", .text = text},
                         EXPERIMENT_MODEL | EXPERIMENT_LAW, NULL, &why) < 0)
        fail_msg("%s", why.text);
    *state = &room;
    return 0;
}

static int end(void **state)
{
    struct room *room = *state;
    for (size_t i = 0; i < 8; i++)
        free(room->trajectory[i].at);
    free(room->sources.at);
    experiment_free(&room->e);
    return 0;
}

/* The trajectory of what @p expectation, "never y < 0", is about becomes these values, at 0 s, 1 s, ...; NAN: Bad. */
static struct expectation expected(struct room *room, const char *text)
{
    struct expectation x;
    struct apc_error why;
    if (check_parse(&x, text, &room->e, &room->sources, &why) < 0)
        fail_msg("%s", why.text);
    return x;
}

static void put(struct room *room, size_t trajectory, double t, double value)
{
    const struct check_point point = {
        .t = (apc_ns)(t * 1e9), .value = isnan(value) ? 3 : value, .known = !isnan(value)};
    assert_int_equal(check_add(&room->trajectory[trajectory], point), 0);
}

static void put_steady(struct room *room, size_t trajectory, double from, double until, double value)
{
    for (double t = from; t < until; t++)
        put(room, trajectory, t, value);
}

static struct check_verdict judged(struct room *room, const char *text, apc_ns ended)
{
    const struct expectation x = expected(room, text);
    return check_judge(&x, &room->sources, room->trajectory, ended);
}

#define assert_judged(room, text, what, when)                                                                \
    do {                                                                                                     \
        const struct check_verdict v_ = judged(room, text, INT64_MAX);                                       \
        if (v_.is != (what) || (v_.at != (apc_ns)((when)*1e9)))                                              \
            fail_msg("%s: %d at %g s", text, v_.is, apc_ns_to_s(v_.at));                                     \
    } while (0)

/* y: 10, from 20 s on 20, from 30 s on Bad, from 40 s on 10, nothing from 60 to 80 s, then 10 */
static void make_course(struct room *room)
{
    const size_t y = expected(room, "never y < -99").trajectory;
    put_steady(room, y, 1, 20, 10);
    put_steady(room, y, 20, 30, 20);
    put_steady(room, y, 30, 40, (double)NAN);
    put_steady(room, y, 40, 60, 10);
    put_steady(room, y, 80, 100, 10);
    room->sources.at[y].horizon = 2 * S;
}

/* Promise(simulation/check-bad): A Bad or stale value makes an expectation neither held nor excused. */
static void what_is_not_known_neither_satisfies_nor_excuses(void **state)
{
    struct room *room = *state;
    make_course(room);
    assert_judged(room, "never y > 15", CHECK_FAILED, 20);
    assert_judged(room, "never y > 15 from 25 s", CHECK_FAILED, 25);
    assert_judged(room, "never y > 15 until 19 s", CHECK_HELD, 19);
    assert_judged(room, "never y > 25", CHECK_UNKNOWN, 30);
    assert_judged(room, "never y > 25 until 29 s", CHECK_HELD, 29);
    assert_judged(room, "never y > 25 from 41 s", CHECK_UNKNOWN, 61);
    assert_judged(room, "never y > 25 from 82 s", CHECK_HELD, 100);
    assert_judged(room, "never y < 5 from 30 s until 39 s", CHECK_UNKNOWN, 30); /* Bad, and 3 */
    assert_judged(room, "always y >= 10 until 30 s", CHECK_UNKNOWN, 30);
    assert_judged(room, "always y >= 10 until 29.9 s", CHECK_HELD, 29.9);
    assert_judged(room, "always y > 10", CHECK_FAILED, 1);
    assert_judged(room, "within 5 s y < 5 from 30 s", CHECK_UNKNOWN, 30);
    assert_judged(room, "within 5 s y > 25 from 28 s", CHECK_UNKNOWN, 30);
    assert_judged(room, "within 5 s y > 15 from 18 s", CHECK_HELD, 20);
    assert_judged(room, "within 5 s y > 15 from 21 s", CHECK_HELD, 21);
    assert_judged(room, "within 5 s y > 15 from 10 s", CHECK_FAILED, 15);
    assert_judged(room, "y > 15 by 20 s", CHECK_HELD, 20);
    assert_judged(room, "y > 15 by 19.9 s", CHECK_FAILED, 19.9);
    assert_judged(room, "y > 15 at 20 s", CHECK_HELD, 20);
    assert_judged(room, "y > 15 at 19.999 s", CHECK_FAILED, 19.999);
    assert_judged(room, "y > 15 at 35 s", CHECK_UNKNOWN, 35);
    assert_judged(room, "y < 15 at 60.9 s", CHECK_HELD, 60.9);
    assert_judged(room, "y < 15 at 70 s", CHECK_UNKNOWN, 70);
    assert_judged(room, "y < 15", CHECK_HELD, 100);
}

static void after_the_end_of_a_run_nothing_is_known(void **state)
{
    struct room *room = *state;
    make_course(room);
    assert_int_equal(judged(room, "never y > 25 until 20 s", 10 * S).is, CHECK_UNKNOWN);
    assert_int_equal(judged(room, "never y > 5 until 20 s", 10 * S).is, CHECK_FAILED);
    assert_int_equal(judged(room, "y < 25 at 10 s", 10 * S).is, CHECK_UNKNOWN);
    assert_int_equal(judged(room, "y < 25 at 9 s", 10 * S).is, CHECK_HELD);
    assert_int_equal(judged(room, "never spare > 25", INT64_MAX).is, CHECK_UNKNOWN); /* it has no value */
}

/* r steps from 10 to 20 at 50 s; y follows in ten seconds, and is knocked away at 90 s. */
static void settling_is_of_the_step_and_until_the_next_one(void **state)
{
    struct room *room = *state;
    const struct expectation x = expected(room, "settles y within 5 % in 20 s from 50 s");
    put(room, x.setpoint, 0, 10);
    put(room, x.setpoint, 25, 10);
    put(room, x.setpoint, 50, 20);
    put_steady(room, x.trajectory, 0, 50, 10);
    for (int t = 50; t < 90; t++)
        put(room, x.trajectory, t, t < 60 ? t - 40 : 20.4);
    put_steady(room, x.trajectory, 90, 100, 25);
    room->sources.at[x.trajectory].horizon = 0;
    assert_judged(room, "settles y within 5 % in 20 s from 50 s until 90 s", CHECK_HELD, 60);
    assert_judged(room, "settles y within 5 % in 9.9 s from 50 s until 90 s", CHECK_FAILED, 60);
    assert_judged(room, "settles y within 3 % in 20 s from 50 s until 90 s", CHECK_FAILED, 90);
    assert_judged(room, "settles y within 5 % in 20 s from 50 s", CHECK_FAILED, 100);
    assert_judged(room, "settles y within 1.5 in 20 s from 50 s until 90 s", CHECK_HELD, 59);
    assert_judged(room, "settles y within 0.1 in 20 s", CHECK_HELD, 0); /* the window ends with the step */
    assert_judged(room, "settles y within 5 % in 20 s from 20 s", CHECK_UNKNOWN, 20); /* there is none */
    put(room, x.trajectory, 99.5, (double)NAN);
    assert_judged(room, "settles y within 6.0 in 20 s from 50 s", CHECK_UNKNOWN, 99.5);
}

/* y has settled at 2 s, and is lost from 40 s to 41 s. */
static void a_gap_after_settling_counts_only_if_it_is_outside_afterwards(void **state)
{
    struct room *room = *state;
    const struct expectation x = expected(room, "settles y within 1.0 in 5 s");
    put(room, x.setpoint, 0, 20);
    put(room, x.trajectory, 0, 10);
    put_steady(room, x.trajectory, 2, 40, 20);
    put(room, x.trajectory, 40, (double)NAN);
    room->sources.at[x.trajectory].horizon = 0;
    assert_judged(room, "settles y within 1.0 in 5 s", CHECK_UNKNOWN, 40);
    put_steady(room, x.trajectory, 41, 60, 20.5);
    assert_judged(room, "settles y within 1.0 in 5 s", CHECK_HELD, 2);
    assert_judged(room, "settles y within 0.4 in 5 s", CHECK_FAILED, 100);
}

static void an_output_is_at_its_fault_value_only_if_it_is_not_its_laws(void **state)
{
    struct room *room = *state;
    const size_t u = expected(room, "u at fault value").trajectory,
                 told = expected(room, "u at safe value").trajectory;
    assert_int_equal(check_add(&room->trajectory[u], (struct check_point){.value = 2, .known = true}), 0);
    assert_int_equal(check_add(&room->trajectory[u],
                               (struct check_point){.t = 9 * S, .value = 2, .known = true, .others = true}),
                     0);
    put(room, told, 0, 0);
    put(room, told, 7, 1);
    assert_judged(room, "u at fault value at 8 s", CHECK_FAILED, 8);
    assert_judged(room, "u at fault value by 60 s", CHECK_HELD, 9);
    assert_judged(room, "plant u at safe value by 60 s", CHECK_HELD, 7);
}

static void alarms_are_raised_and_acknowledged(void **state)
{
    struct room *room = *state;
    const size_t a = expected(room, "never alarm y.low").trajectory;
    put(room, a, 0, APC_ALARM_NORMAL);
    put(room, a, 20, APC_ALARM_UNACKED);
    put(room, a, 30, APC_ALARM_RETURNED);
    put(room, a, 35, APC_ALARM_NORMAL);
    put(room, a, 50, APC_ALARM_SUPPRESSED_ACTIVE);
    put(room, a, 95, APC_ALARM_UNACKED);
    assert_judged(room, "within 20 s alarm y.low", CHECK_HELD, 20);
    assert_judged(room, "never alarm y.low from 30 s until 90 s", CHECK_HELD, 90);
    assert_judged(room, "never alarm y.low from 30 s", CHECK_FAILED, 95);
    assert_judged(room, "operator acknowledges within 15 s", CHECK_HELD, 35);
    assert_judged(room, "operator acknowledges y.low within 14 s", CHECK_FAILED, 34);
    assert_int_equal(judged(room, "operator acknowledges within 15 s from 40 s", INT64_MAX).is,
                     CHECK_UNKNOWN);
    assert_int_equal(judged(room, "operator acknowledges within 4 s from 40 s", INT64_MAX).is, CHECK_FAILED);
    assert_int_equal(judged(room, "operator acknowledges within 4 s until 10 s", INT64_MAX).is,
                     CHECK_UNKNOWN);
}

/* 1 - 0.05^(1/n), and sums of binomials in exact arithmetic. */
static void a_share_has_its_confidence(void **state)
{
    (void)state;
    assert_near(check_share_least(100, 100), 0.9704869, 1e-6);
    assert_near(check_share_least(98, 100), 0.9383808, 1e-6);
    assert_near(check_share_least(1, 1), 0.05, 1e-9);
    assert_near(check_share_least(0, 10), 0, 0);
    assert_true(check_share_least(58, 58) < 0.95 && check_share_least(59, 59) >= 0.95);
}

static void what_can_never_be_judged_is_refused(void **state)
{
    static const struct {
        const char *text, *why;
    } wrong[] = {
        {"", "expected"},
        {"never", "the name of a signal at its end"},
        {"never spart < 20", "no signal \"spart\": did you mean \"spare\"?"},
        {"never plant r < 20", "no measurement or output \"r\""},
        {"never y 20", "expected <, <=, >, >="},
        {"never y < 20 m", "not \"m\""},
        {"never y < 20m", "in the unit of y, m"},
        {"never y < high", "expected a number, not \"high\""},
        {"never y at fault value", "y is no output"},
        {"never alarm y.lo", "did you mean \"y.low\"?"},
        {"within 10 alarm y.low", "expected a time"},
        {"within 10 m alarm y.low", "expected a time"},
        {"within 101 s alarm y.low", "the run ends at 100 s, before 101 s"},
        {"within 50 s alarm y.low from 60 s", "before 110 s"},
        {"y < 3 at 2 min", "before 120 s"},
        {"never y < 3 from 100 s", "the run ends at 100 s"},
        {"never y < 3 from 50 s until 40 s", "before it begins at 50 s"},
        {"y < 3 at 20 s from 10 s", "expected nothing more, not \"from\""},
        {"settles spare within 2 % in 10 s", "spare is the measurement of no loop"},
        {"settles y within 0 % in 10 s", "above 0"},
        {"settles y within 2 % in 200 s", "before 200 s"},
        {"mode w is Man", "no loop \"w\""},
        {"mode u is Manual", "no mode \"Manual\""},
        {"mode u is Cas", "u cannot be in Cas: no controller moves its setpoint"},
        {"operator acknowledges y.low", "expected \"within\""},
        {"never y < 20 until 50 s or so", "not \"or\""},
    };
    struct room *room = *state;
    struct expectation x;
    struct apc_error why;
    for (size_t i = 0; i < sizeof wrong / sizeof *wrong; i++) {
        if (check_parse(&x, wrong[i].text, &room->e, &room->sources, &why) == 0)
            fail_msg("%s: is taken", wrong[i].text);
        assert_has(why.text, wrong[i].why);
        assert_has(why.text, wrong[i].text);
    }
    for (const char *const *good =
             (const char *const[]){"never y<20", "never 'y'<=2e1", "never sensor.1 > 1.5",
                                   "within 1.5min y >= -1", NULL};
         *good; good++)
        (void)expected(room, *good);
}

/* ---- Files ---------------------------------------------------------------------------------- */

#define FIRST_ORDER "experiment = \"" APC_SOURCE_DIR "/experiments/first-order.conf\";\n"

static int load_text(struct scenario *scenario, const char *text, struct apc_error *why)
{
    char path[] = "/tmp/apc-scenario.XXXXXX";
    const int fd = mkstemp(path);
    FILE *out = fdopen(fd, "w");
    fputs(text, out);
    fclose(out);
    const int rc = scenario_load(scenario, path, NULL, NULL, 0, why);
    remove(path);
    return rc;
}

static void a_mistake_has_the_line_of_the_scenario(void **state)
{
    static const struct {
        const char *text, *why;
    } wrong[] = {
        {"expect = ( \"never y < 1\" );", ":1: \"experiment\" is missing"},
        {FIRST_ORDER "expects = ( \"never y < 1\" );", ":2: unknown setting \"expects\""},
        {FIRST_ORDER, "\"expect\" is missing"},
        {FIRST_ORDER "expect = (\n\"never y < 1\",\n\"never z < 1\" );",
         ":4: \"never z < 1\": there is no signal"},
        {FIRST_ORDER "\nset = ( \"controller.Kd=1\" ); expect = ( \"never y < 1\" );", ":3: "},
        {FIRST_ORDER "\nset = ( \"controller.Kp\" ); expect = ( \"never y < 1\" );",
         ":3: set \"controller.Kp\": expected"},
        {FIRST_ORDER
         "faults = ( { signal = \"y\"; kind = \"stuck\"; at = 1.0; },\n{ signal = \"x\"; kind = \"stuck\"; "
         "at = 1.0; } ); expect = ( \"never y < 1\" );",
         ":3: there is no measurement, output, controller, disturbance or parameter \"x\""},
        {FIRST_ORDER
         "faults = ( { signal = \"y\"; kind = \"stuck\"; at = 1.0; },\n{ signal = \"y\"; kind = \"stack\"; "
         "at = 2.0; },\n{ signal = \"y\"; kind = \"stuck\"; at = 3.0; } ); expect = ( \"never y < 1\" );",
         ":3: "},
        {FIRST_ORDER
         "actions = ( { at = 1.0; set = \"r\"; value = 1.0; },\n{ at = 1.0; set = \"rr\"; value = 1.0; } );"
         "expect = ( \"never y < 1\" );",
         ":3: there is no \"rr\""},
        {FIRST_ORDER
         "disturbances = ( { name = \"nothing\"; at = 1.0; value = 1.0; } ); expect = ( \"never y < 1\" );",
         ":2: "},
        {FIRST_ORDER "actions = ( { when = \"y > 1\"; at = 1.0; set = \"r\"; value = 1.0; } ); expect = ( "
                     "\"never y < 1\" );",
         ":2: it has both \"at\" and \"when\""},
        {FIRST_ORDER
         "actions = (\n{ when = \"yy > 1\"; set = \"r\"; value = 1.0; } ); expect = ( \"never y < 1\" );",
         ":3: \"yy > 1\": there is no signal \"yy\""},
        {FIRST_ORDER "faults = (\n{ signal = \"y\"; when = \"y > 1 at 2 s\"; kind = \"stuck\"; } ); expect = "
                     "( \"never y < 1\" );",
         ":3: \"y > 1 at 2 s\": expected nothing more, not \"at\""},
        {FIRST_ORDER
         "actions = ( { when = \"y > 1\"; set = \"rr\"; value = 1.0; } ); expect = ( \"never y < 1\" );",
         ":2: there is no \"rr\""},
        {FIRST_ORDER "actions = ( { when = \"y > 1\"; after = 601.0; set = \"r\"; value = 1.0; } ); expect = "
                     "( \"never y < 1\" );",
         ":2: \"after\""},
        {FIRST_ORDER
         "actions = ( { at = 1.0; after = 1.0; set = \"r\"; value = 1.0; } ); expect = ( \"never y < 1\" );",
         ":2: there is no action \"after\""},
        {FIRST_ORDER "set = ( \"measurements.y.faults=()\" ); faults = (\n{ signal = \"y\"; when = \"y > "
                     "1\"; kind = \"stuck\"; } ); expect = ( \"never y < 1\" );",
         ":3: a setting of measurements.y.faults is in the way"},
        {FIRST_ORDER "disturbances = ( { name = \"leak\"; when = \"y > 1\"; value = 1.0; } ); expect = ( "
                     "\"never y < 1\" );",
         ":2: "},
        {FIRST_ORDER "actions = ( { at = 1.0; signal = \"y\"; set = \"r\"; value = 1.0; } ); expect = ( "
                     "\"never y < 1\" );",
         ":2: there is no action \"signal\""},
        {FIRST_ORDER
         "disturbances = ( { name = \"leak\"; when = \"y > 1\"; at = 3.0; value = 1.0; } ); expect "
         "= ( \"never y < 1\" );",
         ":2: it has both"},
        {FIRST_ORDER "duration = -1.0; expect = ( \"never y < 1\" );", ":2: "},
        {FIRST_ORDER "runs = 0; expect = ( \"never y < 1\" );", ":2: \"runs\""},
    };
    struct scenario scenario;
    struct apc_error why;
    (void)state;
    for (size_t i = 0; i < sizeof wrong / sizeof *wrong; i++) {
        if (load_text(&scenario, wrong[i].text, &why) == 0)
            fail_msg("%s: is taken", wrong[i].text);
        assert_has(why.text, wrong[i].why);
        assert_has(why.text, "/tmp/apc-scenario.");
        scenario_free(&scenario);
    }
}

/* What becomes of the expectations of a scenario. */
static void assert_becomes(const char *text, const enum check_is *is, size_t n)
{
    struct scenario scenario;
    struct check_verdict verdict[8];
    struct check_end ended;
    struct apc_error why;
    if (load_text(&scenario, text, &why) < 0)
        fail_msg("%s", why.text);
    assert_int_equal(scenario.n_expect, n);
    assert_int_equal(scenario_run(&scenario, 1, verdict, &ended), 0);
    assert_int_equal(ended.rc, 0);
    for (size_t i = 0; i < n; i++) {
        char words[300];
        check_words(&scenario.expect[i], &verdict[i], &scenario.sources, words, sizeof words);
        if (verdict[i].is != is[i])
            fail_msg("%s: %s", scenario.expect[i].text, words);
    }
    scenario_free(&scenario);
}

static void a_run_is_judged(void **state)
{
    static const char text[] = FIRST_ORDER
        "duration = 100.0; set = ( \"controller.Kp=0.1\" );\n"
        "faults = ( { signal = \"y\"; kind = \"dropout\"; at = 40.0; duration = 20.0; },\n"
        "           { signal = \"y\"; kind = \"dropout\"; at = 62.0; duration = 1.0; } );\n"
        "actions = ( { at = 80.1; mode = \"u\"; value = \"Man\"; }, { at = 80.1; set = \"u\"; value = 3.0; } "
        ");\n"
        "expect = ( \"never y < -1\", \"never plant y > 11\", \"u at fault value by 47 s\", \"mode u is Man "
        "at 90 s\",\n"
        "           \"within 2.1 s u >= 3 from 80 s\", \"y < 4 at 0.01 s\", \"plant y > 9 at 40 s\" );";
    static const enum check_is is[] = {CHECK_UNKNOWN, CHECK_FAILED, CHECK_HELD, CHECK_HELD,
                                       CHECK_HELD,    CHECK_HELD,   CHECK_HELD};
    (void)state;
    assert_becomes(text, is, 7);
}

/* ---- Why -------------------------------------------------------------------------------------- */

static int ask_why_it_failed(void *ctx, const struct simulation *s)
{
    const struct check_move *move = ctx;
    struct replay replay = {.controller = NULL};
    const struct why_question question = {.replay = &replay,
                                          .store = s->store,
                                          .simulated = s->e,
                                          .loop = move->loop,
                                          .at = SIMULATION_BEGIN + move->at,
                                          .over = move->over};
    struct apc_error why;
    struct why answer;
    char time[APC_TIME_LEN];
    if (why_ask(&answer, &question, &why) < 0)
        fail_msg("%s", why.text);
    assert_string_equal(replay_time(&replay, answer.tick->time, time), "60.030 s");
    assert_true(answer.n > 0 && answer.cause[0].kind == WHY_SETPOINT);
    assert_near(answer.cause[0].before, 10, 0);
    assert_near(answer.cause[0].now, 14, 0);
    why_free(&answer);
    replay_free(&replay);
    return 7;
}

/* Promise(simulation/check-why): Of an expectation that failed `apc check` says as `apc why` why the output moved that
 *   answers for it: of a measurement or its alarm that of its loop, of a mode the move when it changed. */
static void what_failed_is_answered_for_by_an_output(void **state)
{
    static const char text[] =
        FIRST_ORDER "duration = 100.0; actions = ( { at = 59.5; set = \"r\"; value = 14.0; }, "
                    "{ at = 80.1; mode = \"u\"; value = \"Man\"; } );\n"
                    "expect = ( \"never u > 1.5 from 50 s\", \"never plant y > 10.5\", \"mode u is Auto\", "
                    "\"never r > 13\", "
                    "\"never y < -100\" );";
    struct scenario scenario;
    struct check_verdict verdict[5];
    struct check_end ended;
    struct apc_error why;
    struct check_move move;
    (void)state;
    if (load_text(&scenario, text, &why) < 0)
        fail_msg("%s", why.text);
    assert_int_equal(scenario_run(&scenario, 1, verdict, &ended), 0);
    for (size_t i = 0; i < 5; i++)
        assert_int_equal(check_find_move(&move, &scenario, i, &verdict[i]), i < 3);
    assert_int_equal(check_find_move(&move, &scenario, 1, &verdict[1]), 1);
    assert_string_equal(move.loop, "u");
    assert_true(move.at == verdict[1].at && move.over > 0);
    assert_int_equal(check_find_move(&move, &scenario, 2, &verdict[2]), 1);
    assert_true(move.at > 80 * S && move.at < 84 * S && move.over == 0);
    assert_int_equal(check_find_move(&move, &scenario, 0, &verdict[0]), 1);
    assert_int_equal(scenario_rerun(&scenario, 1, ask_why_it_failed, &move, &why), 7);
    scenario_free(&scenario);
}

/* ---- The operator ---------------------------------------------------------------------------- */

#define PUMP "experiment = \"" APC_SOURCE_DIR "/experiments/alarms/pump-failure.conf\"; duration = 600.0;\n"

/* Promise(simulation/check-acknowledges): A scripted operator acknowledges an alarm, and `operator acknowledges`
 *   holds if that was in time, and fails if nobody did. */
static void a_scripted_operator_acknowledges_an_alarm_that_stands(void **state)
{
    static const enum check_is held[] = {CHECK_HELD, CHECK_HELD, CHECK_FAILED}, failed[] = {CHECK_FAILED};
    (void)state;
    assert_becomes(PUMP
                   "actions = ( { at = 100.0; ack = \"h2.deviation\"; }, { at = 450.0; ack = "
                   "\"h2.deviation\"; } );\n"
                   "expect = ( \"alarm h2.deviation at 449 s\", \"operator acknowledges h2.deviation within "
                   "100 s\", \"operator acknowledges h2.deviation within 10 s\" );",
                   held, 3);
    assert_becomes(PUMP "actions = ( { at = 100.0; ack = \"h2.deviation\"; } );\n"
                        "expect = ( \"operator acknowledges h2.deviation within 100 s\" );",
                   failed, 1);
}

static void an_operator_is_as_quick_as_the_scenario_says(void **state)
{
    static const enum check_is held[] = {CHECK_HELD, CHECK_HELD}, slow[] = {CHECK_FAILED, CHECK_HELD},
                               late[] = {CHECK_FAILED, CHECK_UNKNOWN};
    (void)state;
    assert_becomes(PUMP
                   "actions = ( { when = \"alarm h2.deviation\"; after = 30.0; ack = \"h2.deviation\"; } );\n"
                   "expect = ( \"operator acknowledges h2.deviation within 60 s\" );",
                   held, 2);
    assert_becomes(PUMP
                   "actions = ( { when = \"alarm h2.deviation\"; after = 90.0; ack = \"h2.deviation\"; } );\n"
                   "expect = ( \"operator acknowledges h2.deviation within 60 s\" );",
                   slow, 2);
    assert_becomes(
        PUMP "actions = ( { when = \"alarm h2.deviation\"; after = 300.0; ack = \"h2.deviation\"; } );\n"
             "expect = ( \"operator acknowledges h2.deviation within 60 s\" );",
        late, 2);
}

/* ---- Conditions ------------------------------------------------------------------------------ */

static void run_text(const char *text, struct check_verdict *verdict, size_t n)
{
    struct scenario scenario;
    struct check_end ended;
    struct apc_error why;
    if (load_text(&scenario, text, &why) < 0)
        fail_msg("%s", why.text);
    assert_int_equal(scenario.n_expect, n);
    assert_int_equal(scenario_run(&scenario, 1, verdict, &ended), 0);
    scenario_free(&scenario);
}

/* Promise(simulation/check-when): A fault or action of a scenario that has a condition instead of a time happens at
 *   the first tick of the plant at which that is true, as it would at this time; a condition that never is fails. */
static void what_has_a_condition_happens_as_at_that_time(void **state)
{
    static const char expect[] = "expect = ( \"never plant y > 1000\", \"never plant u > 1000\" );";
    static const char *const happens[] = {
        "faults = ( { signal = \"y\"; kind = \"drift\"; size = 0.1; duration = 20.0; ",
        "faults = ( { signal = \"y\"; kind = \"spike\"; size = -40.0; duration = 4.0; ",
        ("faults = ( { signal = \"u\"; kind = \"stuck\"; at = 1.0; duration = 1.0; },"
         "           { signal = \"u\"; kind = \"stuck\"; duration = 20.0; "),
        "actions = ( { set = \"r\"; value = 15.0; "};
    (void)state;
    for (size_t i = 0; i < sizeof happens / sizeof *happens; i++) {
        struct check_verdict when[3], at[2], without[2];
        char text[1000];
        snprintf(text, sizeof text,
                 FIRST_ORDER "duration = 100.0; %swhen = \"plant y > 5\"; after = 2.0; } ); %s", happens[i],
                 expect);
        run_text(text, when, 3);
        assert_int_equal(when[2].is, CHECK_HELD);
        snprintf(text, sizeof text, FIRST_ORDER "duration = 100.0; %sat = %.9f; } ); %s", happens[i],
                 apc_ns_to_s(when[2].at), expect);
        run_text(text, at, 2);
        snprintf(text, sizeof text, FIRST_ORDER "duration = 100.0; %s", expect);
        run_text(text, without, 2);
        if (memcmp(&when[0].closest, &without[0].closest, sizeof when[0].closest) == 0 &&
            memcmp(&when[1].closest, &without[1].closest, sizeof when[1].closest) == 0)
            fail_msg("%s: changes nothing", happens[i]);
        for (size_t k = 0; k < 2; k++) {
            assert_memory_equal(&when[k].closest, &at[k].closest, sizeof at[k].closest);
            assert_int_equal(when[k].closest_at, at[k].closest_at);
        }
    }
}

#define DOUBLE_TANK "experiment = \"" APC_SOURCE_DIR "/experiments/double-tank.conf\"; duration = 300.0;\n"

/* One waits behind another that waits, and one that has its time comes between them; the experiment's own is none. */
static void a_disturbance_waits_for_its_condition(void **state)
{
    static const char expect[] =
        "expect = ( \"never plant h2 < -1 from 61 s until 140 s\", \"never plant h2 < -1 from 152 s\" );";
    struct check_verdict when[4], at[2], without[2];
    char text[1000];
    (void)state;
    run_text(
        DOUBLE_TANK
        "disturbances = ( { name = \"leak\"; when = \"plant h2 > 0\"; after = 150.0; value = 0.0; },"
        "{ name = \"leak\"; at = 90.0; value = 0.003; },"
        "{ name = \"leak\"; when = \"plant h2 > 0\"; after = 60.0; value = 0.001; } );\n"
        "expect = ( \"never plant h2 < -1 from 61 s until 140 s\", \"never plant h2 < -1 from 152 s\" );",
        when, 4);
    assert_int_equal(when[2].is, CHECK_HELD);
    assert_int_equal(when[3].is, CHECK_HELD);
    assert_true(when[3].at < 90 * S && when[2].at > 90 * S);
    snprintf(text, sizeof text,
             DOUBLE_TANK "disturbances = ( { name = \"leak\"; at = %.9f; value = 0.001; },"
                         "{ name = \"leak\"; at = 90.0; value = 0.003; },"
                         "{ name = \"leak\"; at = %.9f; value = 0.0; } ); %s",
             apc_ns_to_s(when[3].at), apc_ns_to_s(when[2].at), expect);
    run_text(text, at, 2);
    run_text(DOUBLE_TANK "disturbances = ( ); expect = ( \"never plant h2 < -1 from 61 s until 140 s\", "
                         "\"never plant h2 < -1 from 152 s\" );",
             without, 2);
    for (size_t k = 0; k < 2; k++) {
        assert_true(when[k].closest != without[k].closest);
        assert_memory_equal(&when[k].closest, &at[k].closest, sizeof at[k].closest);
        assert_int_equal(when[k].closest_at, at[k].closest_at);
    }
}

static void a_condition_that_never_comes_true_fails(void **state)
{
    static const enum check_is is[] = {CHECK_HELD, CHECK_FAILED};
    (void)state;
    assert_becomes(FIRST_ORDER
                   "faults = ( { signal = \"y\"; kind = \"dropout\"; when = \"plant y > 1000\"; } );"
                   "expect = ( \"never u at fault value\" );",
                   is, 2);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test_setup_teardown(what_is_not_known_neither_satisfies_nor_excuses, begin, end),
        cmocka_unit_test_setup_teardown(after_the_end_of_a_run_nothing_is_known, begin, end),
        cmocka_unit_test_setup_teardown(settling_is_of_the_step_and_until_the_next_one, begin, end),
        cmocka_unit_test_setup_teardown(a_gap_after_settling_counts_only_if_it_is_outside_afterwards, begin,
                                        end),
        cmocka_unit_test_setup_teardown(an_output_is_at_its_fault_value_only_if_it_is_not_its_laws, begin,
                                        end),
        cmocka_unit_test_setup_teardown(alarms_are_raised_and_acknowledged, begin, end),
        cmocka_unit_test(a_share_has_its_confidence),
        cmocka_unit_test_setup_teardown(what_can_never_be_judged_is_refused, begin, end),
        cmocka_unit_test(a_mistake_has_the_line_of_the_scenario),
        cmocka_unit_test(a_run_is_judged),
        cmocka_unit_test(what_failed_is_answered_for_by_an_output),
        cmocka_unit_test(a_scripted_operator_acknowledges_an_alarm_that_stands),
        cmocka_unit_test(an_operator_is_as_quick_as_the_scenario_says),
        cmocka_unit_test(what_has_a_condition_happens_as_at_that_time),
        cmocka_unit_test(a_disturbance_waits_for_its_condition),
        cmocka_unit_test(a_condition_that_never_comes_true_fails),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}

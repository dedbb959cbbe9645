/* SPDX-License-Identifier: BSD-3-Clause */
/* What moved an output is found among all that changed, and its effect is what a run without it lacks. */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "check.h"
#include "scratch.h"

#include "modules/controller.h"
#include "simulation/simulation.h"

/* An experiment of each law, with a setpoint of it and what that may be, and the loop that follows. */
static const struct plant {
    const char *name, *setpoint, *loop, *measurement;
    double low, high, spike, begin, end; /* between which nothing else happens */
} plants[] = {
    {"first-order", "r", "u", "y", 5, 25, 4, 20, 140},
    {"quadruple-tank", "r1", "v1", "y1", 5, 7, 1, 20, 190},
    {"van-de-vusse", "cB_r", "F", "cB", 0.95, 1.05, 0.1, 400, 1700},
    {"quadruple-tank-mpc", "r1", "v1", "y1", 5, 7, 1, 20, 190},
    {"adiabatic-cstr-nmpc", "r", "F", "T", 30, 50, 5, 10, 140},
};
#define PLANTS (sizeof plants / sizeof *plants)

static struct replay replay;
static struct why answer;
static struct apc_error why;

/* ---- Runs ------------------------------------------------------------------------------------ */

static void load_experiment(struct experiment *e, const char *name, const char *more)
{
    char path[300];
    snprintf(path, sizeof path, "%s/experiments/%s.conf", APC_SOURCE_DIR, name);
    FILE *in = fopen(path, "r"), *out = fopen(scratch_path("run.conf"), "w");
    assert_non_null(in);
    assert_non_null(out);
    for (int c = fgetc(in); c != EOF; c = fgetc(in))
        fputc(c, out);
    fputs(more, out);
    fclose(in);
    assert_int_equal(fclose(out), 0);
    if (experiment_load(e, scratch_path("run.conf"), EXPERIMENT_MODEL | EXPERIMENT_LAW, NULL, &why) < 0)
        fail_msg("%s: %s", name, why.text);
}

/* Simulate it; the record is what is explained from then on. */
static void make_run(const char *name, const char *more, double duration)
{
    struct experiment e;
    struct simulation s;
    load_experiment(&e, name, more);
    assert_int_equal(simulation_create(&s, &e, 3, &why), 0);
    assert_int_equal(simulation_run(&s, duration), 0);
    if (ticks_keep(scratch_folder(), s.store, &e, &(struct apc_range){0}, &why) < 0)
        fail_msg("%s: %s", name, why.text);
    simulation_destroy(&s);
    experiment_free(&e);
    replay_free(&replay);
    if (replay_load(&replay, scratch_folder(), NULL, &why) < 0)
        fail_msg("%s: %s", name, why.text);
}

static void explain(const char *loop, double from, double until)
{
    apc_ns a, b;
    assert_int_equal(apc_ns_from_s(from, &a), 0);
    assert_int_equal(apc_ns_from_s(until, &b), 0);
    why_free(&answer);
    if (why_find(&answer, &replay, loop, replay.start + a, replay.start + b, &why) < 0)
        fail_msg("%s at %g s: %s", loop, until, why.text);
}

/* The tick alone that is the first after @p time. */
static void explain_after(const char *loop, double time)
{
    explain(loop, time, time + apc_ns_to_s(replay.controller->of->rhythm.period));
}

/* What the loop put out at the same tick of another run. */
static double output_in(const char *name, const char *more, double duration)
{
    struct experiment e;
    struct simulation s;
    struct ticks ticks;
    load_experiment(&e, name, more);
    assert_int_equal(simulation_create(&s, &e, 3, &why), 0);
    assert_int_equal(simulation_run(&s, duration), 0);
    assert_int_equal(ticks_load(&ticks, s.store, APC_TICK, answer.by->of->number, 0), 0);
    const struct tick_row *at = ticks_find(&ticks, answer.tick->seq);
    assert_non_null(at);
    const double u = ticks.value[at->first + answer.by->core->offset[APC_TICK_U] + answer.element];
    ticks_free(&ticks);
    simulation_destroy(&s);
    experiment_free(&e);
    return u;
}

static const struct why_cause *cause_named(enum why_kind kind, const char *name)
{
    for (size_t i = 0; i < answer.n; i++)
        if (answer.cause[i].kind == kind && (!name || !strcmp(answer.cause[i].tag->name, name)))
            return &answer.cause[i];
    return NULL;
}

static bool is_first(enum why_kind kind, const char *name)
{
    return answer.n > 0 && answer.cause[0].effect != 0 && answer.cause == cause_named(kind, name);
}

/* The parts are all of the move. */
static void assert_whole(void)
{
    double sum = answer.earlier + answer.together;
    for (size_t i = 0; i < answer.n; i++)
        sum += answer.cause[i].effect;
    const double move = answer.u - answer.u_before;
    assert_true(fabs(sum - move) <= 1e-9 * (fabs(answer.u) + fabs(answer.u_before)));
}

static int end(void **state)
{
    (void)state;
    why_free(&answer);
    replay_free(&replay);
    memset(&replay, 0, sizeof replay);
    return 0;
}

static double between(uint64_t *seed, double low, double high)
{
    *seed = *seed * 6364136223846793005u + 1442695040888963407u;
    return low + (high - low) * (double)(*seed >> 11) * 0x1p-53;
}

/* ---- Tests ----------------------------------------------------------------------------------- */

/*
 * Promise(simulation/why-output-moved): The inputs that moved an output are named with their effects, the one
 *   that moved it most first: what the output lacks, bit for bit, in a run without the change. A row's author and
 *   the loop above are told. A tick that does not come out of its record again is not explained.
 */
static void an_effect_is_what_a_run_without_the_cause_lacks(void **state)
{
    uint64_t seed = 1;
    (void)state;
    for (size_t p = 0; p < PLANTS; p++)
        for (int i = 0; i < 4; i++) {
            const struct plant *of = &plants[p];
            const double at = between(&seed, of->begin, of->end), to = between(&seed, of->low, of->high);
            char more[200];
            snprintf(more, sizeof more, "actions = ( { at = %.3f; set = \"%s\"; value = %.17g; } );", at,
                     of->setpoint, to);
            make_run(of->name, more, of->end + 50);
            explain_after(of->loop, at);
            const struct why_cause *cause = cause_named(WHY_SETPOINT, of->setpoint);
            assert_non_null(cause);
            assert_true(is_first(WHY_SETPOINT, of->setpoint));
            assert_true(cause->now == to);
            assert_true(cause->effect == answer.u - output_in(of->name, "", of->end + 50));
            assert_whole();
        }
}

/* Promise(simulation/why-output-moved) */
static void the_change_that_moved_an_output_comes_first(void **state)
{
    const char *asked = getenv("APC_TEST_WHY");
    const long rounds = asked ? strtol(asked, NULL, 10) : 5;
    uint64_t seed = 7;
    (void)state;
    for (size_t p = 0; p < PLANTS; p++) {
        const struct plant *of = &plants[p];
        long right = 0, tried = 0;
        for (long round = 0; round < rounds; round++) {
            const double at = between(&seed, of->begin, of->end), to = between(&seed, of->low, of->high);
            const double by_hand = between(&seed, 0.1, 0.9);
            char more[500];
            snprintf(more, sizeof more,
                     "actions = ( { at = %.3f; set = \"%s\"; value = %.17g; }, { at = %.3f; mode = \"%s\"; "
                     "value = "
                     "\"Man\"; } );",
                     at, of->setpoint, to, at + (of->end + 45 - at) * by_hand, of->loop);
            make_run(of->name, more, of->end + 50);
            explain_after(of->loop, at);
            right += is_first(WHY_SETPOINT, of->setpoint);
            assert_whole();
            explain_after(of->loop, at + (of->end + 45 - at) * by_hand);
            right += cause_named(WHY_MODE, of->loop) != NULL;
            assert_true(answer.u == answer.u_before);
            assert_whole();
            tried += 2;
        }
        if (100 * right < 99 * tried)
            fail_msg("%s: %ld of %ld", of->name, right, tried);
    }
}

/* Promise(simulation/why-output-moved) */
static void each_kind_of_input_is_found(void **state)
{
    static const struct {
        const char *name, *more, *loop;
        double from, until;
        enum why_kind kind;
        const char *input;
        bool moves;
    } of[] = {
        {"first-order", "actions = ( { at = 100.1; set = \"Kp\"; value = 0.9; } );", "u", 101.9, 102.1,
         WHY_TUNING, "Kp", false}, /* without a bump, so it moves nothing at its tick, */
        {"first-order", "actions = ( { at = 151.1; set = \"Kp\"; value = 0.9; } );", "u", 150.5, 156.5,
         WHY_TUNING, "Kp", true}, /* and those behind it */
        {"first-order",
         "actions = ( { at = 50.1; mode = \"u\"; value = \"Man\"; }, { at = 60.1; set = \"u\"; value = 3.0; "
         "} );",
         "u", 60.05, 62.1, WHY_MANUAL, "manual", true},
        {"two-layers", "", "upper.r1", 700, 731, WHY_BELOW, "r1", true},
        {"two-layers", "", "v1", 200, 212, WHY_SETPOINT, "r1", true},
    };
    (void)state;
    for (size_t i = 0; i < sizeof of / sizeof *of; i++) {
        make_run(of[i].name, of[i].more, of[i].until + 10);
        explain(of[i].loop, of[i].from, of[i].until);
        const struct why_cause *cause = cause_named(of[i].kind, of[i].input);
        if (!cause || (fabs(cause->effect) > 1e-9) != of[i].moves)
            fail_msg("%s of %s: %s", of[i].input, of[i].name,
                     cause ? "moves, or not" : "is not among the inputs");
        assert_whole();
    }
}

/* Promise(simulation/why-who): Who wrote is told in the words of the write itself, of a setpoint that was taken from the
 *   scheduler at the same time and of an output that was moved by hand too. */
static void who_wrote_is_told_in_the_words_of_the_write(void **state)
{
    static const struct {
        const char *more, *events, *text;
        double from;
        enum why_kind kind;
    } of[] = {
        {"actions = ( { at = 60.1; set = \"r\"; value = 12.0; } );",
         "60.1,info,anna,operator,\"r: 10 -> 12\"\n60.1,info,anna,operator,\"r taken Local\"\n",
         "r: 10 -> 12", 60.05, WHY_SETPOINT},
        {"actions = ( { at = 50.1; mode = \"u\"; value = \"Man\"; }, { at = 60.1; set = \"u\"; value = 3.0; "
         "} );",
         "60.1,info,anna,operator,\"ub: 1 -> 3\"\n60.1,info,anna,operator,\"u: 1 -> 3\"\n", "u: 1 -> 3",
         60.05, WHY_MANUAL},
    };
    (void)state;
    for (size_t i = 0; i < sizeof of / sizeof *of; i++) {
        struct why_author author;
        make_run("first-order", of[i].more, 70);
        FILE *events = fopen(scratch_path("events.csv"), "w");
        assert_non_null(events);
        fprintf(events, "time,severity,source,kind,text\n%s", of[i].events);
        assert_int_equal(fclose(events), 0);
        explain("u", of[i].from, 62.1);
        const struct why_cause *cause = cause_named(of[i].kind, NULL);
        const struct why_question q = {.replay = &replay, .dir = scratch_folder()};
        assert_non_null(cause);
        assert_int_equal(why_find_author(&q, cause, &author, &why), 0);
        assert_string_equal(author.source, "anna");
        assert_string_equal(author.text, of[i].text);
    }
}

/* Promise(simulation/why-terms): The terms of `pi` and `pid` before and after a move add up to the output. */
static void the_terms_of_a_law_are_its_output(void **state)
{
    static const struct {
        const char *name, *loop;
        double from, until;
        size_t n;
    } of[] = {{"first-order", "u", 30, 40, 3}, {"quadruple-tank", "v1", 101, 140, 5}};
    (void)state;
    for (size_t i = 0; i < sizeof of / sizeof *of; i++) {
        double before = 0, now = 0;
        make_run(of[i].name, "", of[i].until + 10);
        explain(of[i].loop, of[i].from, of[i].until);
        assert_int_equal(answer.n_terms, of[i].n);
        for (size_t k = 0; k < answer.n_terms; k++) {
            before += answer.term[k].before;
            now += answer.term[k].now;
        }
        assert_near(before, answer.u_before, 1e-12 * fabs(before));
        assert_near(now, answer.u, 1e-12 * fabs(now));
    }
    make_run("first-order", "actions = ( { at = 30.1; mode = \"u\"; value = \"Man\"; } );", 60);
    explain("u", 29, 33);
    assert_string_equal(answer.term[1].name, "P"); /* before the operator took it, */
    assert_true(isfinite(answer.term[1].before) && isnan(answer.term[1].now));
    explain("u", 40, 44); /* and since then there is none */
    assert_int_equal(answer.n_terms, 0);
}

static const struct why_term *term_named(const char *name, const char *of)
{
    for (size_t i = 0; i < answer.n_terms; i++)
        if (!strcmp(answer.term[i].name, name) && !strcmp(answer.term[i].of, of))
            return &answer.term[i];
    return NULL;
}

/* The newest value of a variable after so long a run of the experiment. */
static double value_in(const char *name, const char *more, double duration, const char *variable)
{
    struct experiment e;
    struct simulation s;
    struct apc_sample newest = {0};
    load_experiment(&e, name, more);
    assert_int_equal(simulation_create(&s, &e, 3, &why), 0);
    assert_int_equal(simulation_run(&s, duration), 0);
    for (size_t i = 0; i < s.n_tags; i++)
        if (!strcmp(s.tags[i].name, variable))
            newest = (struct apc_sample){.table = s.tags[i].table, .id = s.tags[i].id};
    assert_true(apc_store_read(s.store, &newest, 1) >= 0 && newest.seq > 0);
    simulation_destroy(&s);
    experiment_free(&e);
    return newest.value;
}

/*
 * Promise(simulation/why-plan): Of `mpc` and `nmpc` the limits that hold the plan back are told with what the plan
 *   would cost less without, the disturbances that nobody measures, the rank that gave way, and the change of the
 *   plan.
 */
static void the_terms_of_a_plan_are_what_it_comes_from(void **state)
{
    static const struct {
        const char *name, *tuning, *loop, *disturbance;
        double begin, limit, until, rank;
    } of[] = {
        {"quadruple-tank-mpc", "v1.u_max", "v1", "v1", 150.1, 4, 197, 0},
        {"adiabatic-cstr-nmpc", "u_max", "F", "Tin", 420.1, 700, 446.5, 0},
        {"adiabatic-cstr-nmpc", "u_max", "F", "Tin", 20.1, 300, 59.5, 1},
    };
    (void)state;
    for (size_t i = 0; i < sizeof of / sizeof *of; i++) {
        char more[400], wider[2][600], disturbance[40];
        double cost[2];
        snprintf(more, sizeof more, "{ at = %g; set = \"%s\"; value = %g; }", of[i].begin, of[i].tuning,
                 of[i].limit);
        for (int k = 0; k < 2; k++) {
            snprintf(wider[k], sizeof wider[k], "actions = ( %s, { at = %g; set = \"%s\"; value = %.9g; } );",
                     more, of[i].until - 0.6, of[i].tuning, of[i].limit + (k ? 1e-4 : -1e-4));
            cost[k] = value_in(of[i].name, wider[k], of[i].until, "objective");
        }
        snprintf(wider[0], sizeof wider[0], "actions = ( %s );", more);
        make_run(of[i].name, wider[0], of[i].until);
        explain(of[i].loop, of[i].until - 0.1, of[i].until);
        const struct why_term *limit = term_named("high limit", of[i].loop),
                              *disturbed = term_named("disturbance", of[i].disturbance);
        assert_non_null(limit);
        assert_true(limit->now > 0);
        if (of[i].rank == 0) /* else where it is to come to rest depends on the limit as well */
            assert_near(limit->now, (cost[0] - cost[1]) / 2e-4, 1e-3 * limit->now);
        assert_non_null(disturbed);
        snprintf(disturbance, sizeof disturbance, "%s.disturbance", of[i].disturbance);
        assert_true(disturbed->now == value_in(of[i].name, wider[0], of[i].until, disturbance));
        assert_non_null(term_named("plan change", of[i].loop));
        assert_true(term_named("rank given up", "")->now == of[i].rank);
    }
}

/* As in a loop that waits for its first measurement. */
static void a_move_begins_where_something_goes_out(void **state)
{
    (void)state;
    make_run("first-order", "", 60);
    struct replay_controller *c = replay.controller;
    explain("u", 0, 50);
    for (size_t k = 0; k < 3; k++)
        c->ticks.value[c->ticks.at[k].first + answer.by->core->offset[APC_TICK_THERE]] = 0;
    explain("u", 0, 50);
    assert_ptr_equal(answer.before, &c->ticks.at[3]);
    assert_whole();
    why_free(&answer);
    assert_int_equal(why_find(&answer, &replay, "u", replay.start, c->ticks.at[2].time, &why), APC_ENOTFOUND);
    assert_has(why.text, "u: nothing went out yet");
}

/* Promise(simulation/why-output-moved) */
static void a_damaged_record_is_not_explained(void **state)
{
    (void)state;
    make_run("first-order", "", 120);
    struct replay_controller *c = replay.controller;
    const struct tick_row *at = &c->ticks.at[50];
    explain("u", 0, apc_ns_to_s(at->time - replay.start));
    c->ticks.value[at->first + answer.by->core->offset[APC_TICK_Y]] += 1e-9;
    why_free(&answer);
    assert_int_equal(why_find(&answer, &replay, "u", at->time - 1, at->time, &why), APC_ESTATE);
    assert_has(why.text, "tick 50 at 100.030 s: ");
    assert_int_equal(why_find(&answer, &replay, "u", at[1].time, at[2].time, &why), 0);
}

static void assert_same_answer(const struct why *a, const struct why *b)
{
    assert_int_equal(a->tick->seq, b->tick->seq);
    assert_int_equal(a->before->seq, b->before->seq);
    assert_true(a->u == b->u && a->u_before == b->u_before);
    assert_true(a->earlier == b->earlier && a->together == b->together);
    assert_int_equal(a->n, b->n);
    for (size_t i = 0; i < a->n; i++) {
        assert_int_equal(a->cause[i].kind, b->cause[i].kind);
        assert_string_equal(a->cause[i].tag->name, b->cause[i].tag->name);
        assert_true(a->cause[i].effect == b->cause[i].effect);
        assert_true(!a->cause[i].row == !b->cause[i].row);
        assert_true(!a->cause[i].row || a->cause[i].row->seq == b->cause[i].row->seq);
    }
}

/*
 * Promise(simulation/why-output-in-a-store): A store tells why an output moved as the folder of its run does, bit
 *   for bit, from the ticks that are needed alone.
 */
static void a_store_tells_what_the_folder_of_its_run_does(void **state)
{
    static const struct {
        const char *name, *loop;
        double at, over;
    } of[] = {{"first-order", "u", 100.1, 0},       {"quadruple-tank-mpc", "v1", 101, 0},
              {"quadruple-tank-mpc", "v1", 101, 9}, {"two-layers", "v1", 212, 12},
              {"two-layers", "upper.r1", 212, 0},   {"adiabatic-cstr-nmpc", "F", 60, 3}};
    (void)state;
    for (size_t i = 0; i < sizeof of / sizeof *of; i++) {
        struct experiment e;
        struct simulation s;
        struct why there;
        struct replay part;
        struct replay_part asked = {.loop = of[i].loop, .lead = 2};
        make_run(of[i].name, "", of[i].at + 50);
        explain(of[i].loop, of[i].at - of[i].over, of[i].at);
        load_experiment(&e, of[i].name, "");
        assert_int_equal(simulation_create(&s, &e, 3, &why), 0);
        assert_int_equal(simulation_run(&s, of[i].at + 50), 0);
        asked.store = s.store;
        assert_int_equal(apc_ns_from_s(of[i].over, &asked.over), 0);
        assert_int_equal(apc_ns_from_s(of[i].at, &asked.until), 0);
        asked.until += replay.start;
        if (provision(s.store, &e, PROVISION_KEEP) < 0 || replay_load_part(&part, &asked, &why) < 0 ||
            why_find(&there, &part, of[i].loop, asked.until - asked.over, asked.until, &why) < 0)
            fail_msg("%s at %g s: %s", of[i].loop, of[i].at, why.text);
        assert_same_answer(&answer, &there);
        assert_true(part.controller->ticks.n < replay.controller->ticks.n); /* the rest is not read */
        why_free(&there);
        replay_free(&part);
        simulation_destroy(&s);
        experiment_free(&e);
    }
}

/* A store of a run of @p name, and the question why @p loop moved at @p at. */
static void ask_store(struct simulation *s, struct experiment *e, struct why_question *q, const char *name,
                      double at)
{
    load_experiment(e, name, "");
    assert_int_equal(simulation_create(s, e, 3, &why), 0);
    assert_int_equal(simulation_run(s, at), 0);
    assert_int_equal(provision(s->store, e, PROVISION_KEEP), 0);
    replay_free(&replay);
    replay = (struct replay){.controller = NULL};
    q->replay = &replay;
    q->store = s->store;
    q->at = INT64_MAX;
}

/* A server, whose other readers wait, computes for so long and no longer, and runs nobody's own laws. */
static void a_question_is_answered_in_time_or_refused(void **state)
{
    struct experiment e;
    struct simulation s;
    struct why_question q = {.loop = "u", .give_up = 1};
    char law[400];
    int64_t revision = 0;
    (void)state;
    ask_store(&s, &e, &q, "first-order", 50);
    assert_int_equal(why_ask(&answer, &q, &why), APC_ETIMEDOUT);
    assert_has(why.text, "takes too long");
    q.give_up = 0;
    assert_int_equal(why_ask(&answer, &q, &why), 0);
    why_free(&answer);
    const int n = apc_store_catalogue(s.store, NULL, 0, &revision);
    char *text = calloc((size_t)n + sizeof law, 1);
    assert_non_null(text);
    assert_int_equal(apc_store_catalogue(s.store, text, (size_t)n + 1, &revision), n);
    char *at = strstr(text, "law = \"pi\"");
    assert_non_null(at);
    memmove(at + strlen("law = \"./no.so\""), at + strlen("law = \"pi\""),
            strlen(at) + 1 - strlen("law = \"pi\""));
    memcpy(at, "law = \"./no.so\"", strlen("law = \"./no.so\""));
    assert_true(apc_store_describe(s.store, replay.tags, replay.n_tags, text) >= 0);
    free(text);
    assert_true(why_ask(&answer, &q, &why) < 0); /* it is not there */
    assert_has(why.text, "./no.so");
    q.built_in = true;
    assert_int_equal(why_ask(&answer, &q, &why), APC_EPERM);
    assert_has(why.text, "./no.so is not built in");
    simulation_destroy(&s);
    experiment_free(&e);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test_teardown(an_effect_is_what_a_run_without_the_cause_lacks, end),
        cmocka_unit_test_teardown(the_change_that_moved_an_output_comes_first, end),
        cmocka_unit_test_teardown(each_kind_of_input_is_found, end),
        cmocka_unit_test_teardown(who_wrote_is_told_in_the_words_of_the_write, end),
        cmocka_unit_test_teardown(the_terms_of_a_law_are_its_output, end),
        cmocka_unit_test_teardown(the_terms_of_a_plan_are_what_it_comes_from, end),
        cmocka_unit_test_teardown(a_move_begins_where_something_goes_out, end),
        cmocka_unit_test_teardown(a_damaged_record_is_not_explained, end),
        cmocka_unit_test_teardown(a_store_tells_what_the_folder_of_its_run_does, end),
        cmocka_unit_test_teardown(a_question_is_answered_in_time_or_refused, end),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}

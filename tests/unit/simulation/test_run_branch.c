/* SPDX-License-Identifier: BSD-3-Clause */
/* A simulation that goes on as another experiment: until then it is what it was, to the last bit, and
 * afterwards other where that was asked for; also where what came before is played from its rows.
 */
#include "check.h"

#include <stdio.h>
#include <stdlib.h>

#include "record/record.h"
#include "scratch.h"
#include "simulation/simulation.h"

#define AT 170.0

static const char first_order[] = APC_SOURCE_DIR "/experiments/first-order.conf",
                  layers[] = APC_SOURCE_DIR "/experiments/two-layers.conf";

static struct apc_error why;
static struct experiment was;
static struct samples whole; /* of the simulation that nobody changed */
static struct playback playback;

static void load(struct experiment *e, const char *file, const struct experiment_setting *set)
{
    size_t n = 0;
    while (set && n < 3 && set[n].path)
        n++;
    const struct experiment_overrides overrides = {.set = set, .n_set = n};
    if (experiment_load(e, file, EXPERIMENT_MODEL | EXPERIMENT_LAW, &overrides, &why) < 0)
        fail_msg("%s", why.text);
}

static void collect(struct samples *all, const struct simulation *s)
{
    *all = (struct samples){0};
    assert_int_equal(samples_collect(all, s->store, &was, NULL), 0);
}

/* As a run folder keeps it, of a run that began when simulations do. */
static void keep(const struct simulation *s)
{
    const struct apc_range all = {.since = 0};
    FILE *out = fopen(scratch_path("samples.csv"), "w");
    assert_non_null(out);
    samples_write(&whole, SIMULATION_BEGIN, out);
    assert_int_equal(fclose(out), 0);
    if (ticks_keep(scratch_folder(), s->store, &was, &all, &why) < 0)
        fail_msg("%s", why.text);
    was.start = SIMULATION_BEGIN;
    if (playback_load(&playback, scratch_folder(), &was, (apc_ns)(AT * APC_NS_PER_S), &why) < 0)
        fail_msg("%s", why.text);
}

static void begin(const char *file, double duration)
{
    char text[40];
    struct simulation s;
    snprintf(text, sizeof text, "%g", duration);
    load(&was, file, (const struct experiment_setting[]){{"duration", text}, {NULL, NULL}});
    if (simulation_create(&s, &was, was.seed, &why) < 0 || simulation_run(&s, duration) < 0)
        fail_msg("%s", why.text);
    collect(&whole, &s);
    keep(&s);
    simulation_destroy(&s);
}

static void end(void)
{
    playback_free(&playback);
    samples_free(&whole);
    experiment_free(&was);
}

/* The time of the first row that differs, in s; HUGE_VAL: none does. */
static double parts(const struct experiment *is, const struct playback *from, double at, struct samples *all)
{
    struct experiment until = was; /* what was to happen later is the other one's */
    struct simulation s;
    while (until.n_actions > 0 && until.action[until.n_actions - 1].at >= (apc_ns)(at * APC_NS_PER_S))
        until.n_actions--;
    if (simulation_create_after(&s, &until, was.seed, from, &why) < 0 || simulation_run(&s, at) < 0)
        fail_msg("%s", why.text);
    if (simulation_branch(&s, is, &why) < 0)
        fail_msg("%s", why.text);
    if (simulation_run(&s, is->duration) < 0)
        fail_msg("%s", s.why.text);
    collect(all, &s);
    simulation_destroy(&s);
    size_t i = 0;
    while (i < all->n && i < whole.n && all->at[i].time == whole.at[i].time &&
           all->at[i].table == whole.at[i].table && all->at[i].id == whole.at[i].id &&
           memcmp(&all->at[i].value, &whole.at[i].value, sizeof(double)) == 0)
        i++;
    if (i == all->n && i == whole.n)
        return HUGE_VAL;
    return apc_ns_to_s((i < whole.n ? whole.at[i].time : all->at[i].time) - SIMULATION_BEGIN);
}

static double last_of(const struct samples *all, enum apc_table table, double until)
{
    double value = (double)NAN;
    for (size_t i = 0; i < all->n && all->at[i].time <= SIMULATION_BEGIN + (apc_ns)(until * 1e9); i++)
        if (all->at[i].table == table)
            value = all->at[i].value;
    return value;
}

static void a_future_that_nobody_changed_is_the_same(void **state)
{
    static const double at[] = {1e-9, 0.03, 150.0, AT, 299.999};
    struct samples all;
    (void)state;
    begin(first_order, 300.0);
    for (size_t i = 0; i < sizeof at / sizeof *at; i++) {
        if (parts(&was, NULL, at[i], &all) < HUGE_VAL)
            fail_msg("from %g s on it is another one", at[i]);
        samples_free(&all);
    }
    if (parts(&was, &playback, AT, &all) < HUGE_VAL)
        fail_msg("played from its rows it is another one");
    samples_free(&all);
    end();
    begin(layers, 300.0); /* whose setpoints a loop above moves, and whose signals are calculated */
    for (int rows = 0; rows < 2; rows++) {
        if (parts(&was, rows ? &playback : NULL, AT, &all) < HUGE_VAL)
            fail_msg("two layers: another future, %d", rows);
        samples_free(&all);
    }
    end();
}

static void what_was_asked_for_holds_from_then_on(void **state)
{
    static const struct {
        struct experiment_setting set[3];
        double low, high; /* s: where it parts */
    } cases[] = {
        {{{"controller.Kp", "0.4"}, {NULL, NULL}}, AT, AT + 2.1},
        {{{"controller.law", "pid"}, {NULL, NULL}}, AT, AT + 2.1},
        {{{"controller.mode", "Man"}, {NULL, NULL}}, AT, AT + 2.1},
        {{{"plant.parameters.K", "15"}, {NULL, NULL}}, AT, AT + 0.5},
        {{{"plant.noise", "{ x = 0.5; }"}, {NULL, NULL}}, AT, AT + 0.5},
        {{{"measurements.y.noise", "0.5"}, {NULL, NULL}}, AT, AT + 0.5},
        {{{"measurements.y.quantum", "0.5"}, {NULL, NULL}}, AT, AT + 0.5},
        {{{"measurements.y.faults", "( { kind = \"spike\"; at = 200.0; size = 3.0; } )"}, {NULL, NULL}},
         199.9,
         200.5},
        {{{"outputs.u.faults", "( { kind = \"saturation\"; at = 180.0; low = 1.0; high = 1.0; } )"},
          {NULL, NULL}},
         180.0,
         181.0},
        {{{"actions", "( { at = 240.0; set = \"r\"; value = 12.0; } )"}, {NULL, NULL}}, 240.0, 240.0},
        {{{"setpoints.r.initial", "17"}, {NULL, NULL}}, AT, AT + 0.1},
        {{{"scheduler.sequence.[1].[0]", "12"}, {NULL, NULL}}, AT, AT + 0.1},
        {{{"scheduler.repeat", "false"}, {NULL, NULL}}, AT, AT}, /* the setpoint is written once more */
        {{{"title", "\"other\""}, {"seed", "9"}, {NULL, NULL}}, HUGE_VAL, HUGE_VAL},
        {{{"controller.hold", "5"}, {NULL, NULL}}, HUGE_VAL, HUGE_VAL}, /* started again, it goes on so */
    };
    (void)state;
    begin(first_order, 300.0);
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        for (int rows = 0; rows < 2; rows++) {
            struct experiment is;
            struct samples all;
            load(&is, first_order, cases[i].set);
            is.duration = was.duration;
            const double at = parts(&is, rows ? &playback : NULL, AT, &all);
            if (!(at >= cases[i].low && at <= cases[i].high))
                fail_msg("%s = %s parts at %g s (%s)", cases[i].set[0].path, cases[i].set[0].value, at,
                         rows ? "from rows" : "simulated");
            if (!strcmp(cases[i].set[0].path, "scheduler.sequence.[1].[0]"))
                assert_near(last_of(&all, APC_SETPOINT, AT), 12.0, 0.0); /* at once */
            if (!strcmp(cases[i].set[0].path, "controller.mode"))
                assert_near(last_of(&all, APC_ACTUATOR, 300.0), last_of(&all, APC_ACTUATOR, AT + 2.1), 0.0);
            samples_free(&all);
            experiment_free(&is);
        }
    }
    end();
}

static void what_does_not_change_in_a_run_is_refused_by_its_name(void **state)
{
    static const struct experiment_setting cases[] = {
        {"client.period", "0.25"},       {"plant.period", "0.1"},
        {"plant.dead_time", "1.0"},      {"network", "{ loss = 0.5; }"},
        {"controller.period", "1.0"},    {"controller.phase", "0.5"},
        {"controller.execution", "0.1"}, {"controller.overrun", "\"burst\""},
        {"scheduler.period", "100.0"},   {"measurements.y.low", "-1000.0"},
        {"outputs.u.low", "-5.0"},       {"outputs.u.unit", "\"V\""},
        {"setpoints.r.high", "90.0"},
    };
    (void)state;
    begin(first_order, 200.0);
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        const struct experiment_setting set[] = {cases[i], {NULL, NULL}};
        struct simulation s;
        struct experiment is;
        char named[64], *bracket;
        load(&is, first_order, set);
        assert_int_equal(simulation_create(&s, &was, was.seed, &why), 0);
        assert_int_equal(simulation_run(&s, AT), 0);
        assert_int_equal(simulation_branch(&s, &is, &why), APC_EINVAL);
        /* a signal by its place */
        snprintf(named, sizeof named, "%s is another than in the run", cases[i].path);
        if ((bracket = strchr(cases[i].path, '.')) && strchr(bracket + 1, '.'))
            snprintf(named, sizeof named, "%.*s[0]%s is another than in the run",
                     (int)(bracket + 1 - cases[i].path), cases[i].path, strchr(bracket + 1, '.'));
        assert_has(why.text, named);
        assert_int_equal(simulation_run(&s, 200.0), APC_EINVAL); /* it has ended, and says so again */
        simulation_destroy(&s);
        experiment_free(&is);
    }
    end();
}

static void what_a_folder_has_not_cannot_be_gone_on_from(void **state)
{
    struct playback none;
    struct experiment e;
    (void)state;
    load(&e, first_order, NULL);
    assert_int_equal(playback_load(&none, "/no/such/folder", &e, APC_NS_PER_S, &why), APC_ENOTFOUND);
    assert_has(why.text, "/no/such/folder/" TICKS_FILE ": No such file");
    playback_free(&none);
    experiment_free(&e);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(a_future_that_nobody_changed_is_the_same),
        cmocka_unit_test(what_was_asked_for_holds_from_then_on),
        cmocka_unit_test(what_does_not_change_in_a_run_is_refused_by_its_name),
        cmocka_unit_test(what_a_folder_has_not_cannot_be_gone_on_from),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}

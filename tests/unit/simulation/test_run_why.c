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

/* An experiment of each law, with a setpoint of it, at rest and what it may be, and the loop that follows; how far a
 * measurement may be off, where a limit may be below the output at rest, and what else is tuned. */
static const struct plant {
    const char *law, *name, *setpoint, *loop, *measurement;
    double rest, low, high, off, begin, end; /* between which nothing else happens */
    const char *limit;
    double limit_low, limit_high;
    const char *tuning;
    double tuned;
    const char *was, *is, *tuned_as; /* the law of the file, what stands for it, and for its tuning */
} plants[] = {
    {"pi", "first-order", "r", "u", "y", 10, 5, 25, 4, 20, 140, "u_max", -2, 0.8, "tau_i", 0.3, NULL, NULL,
     NULL},
    {"pid", "quadruple-tank", "r1", "v1", "y1", 6.1315, 5, 7, 1, 20, 190, "v1.u_max", 0.5, 2.7, "v1.tau_i",
     0.3, NULL, NULL, NULL},
    {"lqg", "van-de-vusse", "cB_r", "F", "cB", 1.022, 0.95, 1.05, 0.1, 400, 1700, "F.u_max", 4, 7.5, NULL, 0,
     NULL, NULL, NULL},
    {"mpc", "quadruple-tank-mpc", "r1", "v1", "y1", 6.1315, 5, 7, 1, 20, 190, "v1.u_max", 0.5, 2.7,
     "v1.move_suppression", 5, NULL, NULL, NULL},
    {"nmpc", "adiabatic-cstr-nmpc", "r", "F", "T", 38.6155, 30, 50, 5, 10, 140, "u_max", 200, 480,
     "reference_weight", 1, NULL, NULL, NULL},
    {"mylaw.so", "first-order", "r", "u", "y", 10, 5, 25, 4, 20, 140, NULL, 0, 0, "tau_i", 0.3,
     "law = \"pi\"", "law = \"" APC_EXAMPLES_DIR "/mylaw.so\"", "Kp = 0.2; tau_i = 10.0;"},
    {"mylaw.py", "first-order", "r", "u", "y", 10, 5, 25, 4, 20, 140, NULL, 0, 0, "tau_i", 0.3,
     "law = \"pi\"", "law = \"" APC_SOURCE_DIR "/examples/python/mylaw.py\"", "Kp = 0.2; tau_i = 10.0;"},
    {"cascade", "double-tank", "r", "u", "h2", 0.18, 0.12, 0.25, 0.02, 20, 45, "inner_u_max", 2, 9, NULL, 0,
     NULL, NULL, NULL},
    {"feed-forward", "double-tank", "r", "u", "h1", 0.18, 0.12, 0.25, 0.02, 20, 45, "u_max", 2, 9, "tau_i",
     0.5, "controller = {\n  law = \"cascade\";",
     "controllers = ( { name = \"fed\"; law = \"pid\"; settings = { feed_forward = [2]; }; measurements = "
     "[\"h2\"]; disturbances = [\"h1\"]; setpoints = [\"r\"]; outputs = [\"u\"];",
     "Kp = 60.0; tau_i = 8.0; u_bar = 10.0; Kff = -5.0; } ); } );"},
    {"filter", "first-order", NULL, "u", "y", 0, 0, 0, 4, 20, 140, NULL, 0, 0, NULL, 0, "law = \"pi\"",
     "law = \"filter\"", "tau = 5.0;"},
    {"leadlag", "first-order", NULL, "u", "y", 0, 0, 0, 4, 20, 140, "bias", 2, 8, NULL, 0, "law = \"pi\"",
     "law = \"leadlag\"", "K = -0.1; T_lead = 5.0; T_lag = 20.0;"},
    {"split", "first-order", NULL, "u", "y", 0, 0, 0, 4, 20, 140, "u_to", 2, 8, NULL, 0, "law = \"pi\"",
     "law = \"split\"", "from = -50.0; to = 50.0; u_from = 4.0; u_to = -4.0;"},
    {"select", "first-order", NULL, "u", "y", 0, 0, 0, 4, 20, 140, NULL, 0, 0, NULL, 0, "law = \"pi\"",
     "law = \"select\"; settings = { select = \"low\"; }", ""},
    {"ramp", "first-order", "r", "u", NULL, 10, -8, 9, 0, 40, 140, "z_max", -8, 8, NULL, 0, "law = \"pi\"",
     "law = \"ramp\"", "rate = 0.5;"},
    {"pi over pid", "two-layers", "w1", "upper.r1", "y1", 6.1315, 5, 7, 1, 20, 110, NULL, 0, 0, NULL, 0, NULL,
     NULL, NULL},
    {"pid under pi", "two-layers", "w1", "v1", "y1", 6.1315, 5, 7, 1, 20, 110, NULL, 0, 0, NULL, 0, NULL,
     NULL, NULL},
};
#define PLANTS (sizeof plants / sizeof *plants)

#define TUNING_OF_PI "Kp = 0.2; tau_i = 10.0; u_bar = 0.0;"
#define TUNING_OF_CASCADE                                                                                    \
    "outer_Kp = 1.3; outer_tau_i = 4.0; outer_b = 0.9; outer_u_bar = 0.12707; "                              \
    "outer_u_min = 0.0; outer_u_max = 0.4;\n               "                                                 \
    "inner_Kp = 85.0; inner_tau_i = 5.0; inner_u_bar = 10.0; inner_u_min = 0.0; inner_u_max = 13.0; } "      \
    ");\n};"

static struct replay replay;
static struct why answer;
static struct apc_error why;

/* ---- Runs ------------------------------------------------------------------------------------ */

/* What stands in the file of an experiment instead of something else. */
static struct {
    const char *from;
    char to[700];
} instead[3];

static void put_file(FILE *out, const char *text)
{
    for (const char *at = text; *at;) {
        size_t i = 0;
        while (i < 3 && (!instead[i].from || strncmp(at, instead[i].from, strlen(instead[i].from)) != 0))
            i++;
        if (i < 3) {
            fputs(instead[i].to, out);
            at += strlen(instead[i].from);
        } else {
            fputc(*at++, out);
        }
    }
}

static void load_experiment(struct experiment *e, const char *name, const char *more)
{
    char path[300], text[8000];
    snprintf(path, sizeof path, "%s/experiments/%s.conf", APC_SOURCE_DIR, name);
    FILE *in = fopen(path, "r"), *out = fopen(scratch_path("run.conf"), "w");
    assert_non_null(in);
    assert_non_null(out);
    const size_t n = fread(text, 1, sizeof text - 1, in);
    assert_true(n < sizeof text - 1);
    text[n] = '\0';
    char *own = *more ? strstr(text, "\nactions = ") : NULL;
    if (own)
        *own = '\0'; /* they are the last in their file */
    put_file(out, text);
    fputs("\n", out);
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
    memset(instead, 0, sizeof instead);
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

/* ---- Causes that are put in ------------------------------------------------------------------- */

/* One is put in at a random time of a quiet loop, or of one that a step of its setpoint moves; and the name that has
 * to come first, of the ticks from then on. */
struct injection {
    enum why_kind kind;
    const char *input;
    double from, until;
    bool fault;                  /* of its measurement, not an action */
    char before[200], more[300]; /* what is done before it; it */
};

/* At no tick: each is at a whole number of milliseconds. */
static double off_grid(uint64_t *seed, const struct plant *of)
{
    return floor(1e3 * between(seed, of->begin, of->end)) / 1e3 + 5e-4;
}

/* At least a tenth of the way from low to high away from @p rest. */
static double apart(uint64_t *seed, double rest, double low, double high)
{
    double value;
    do
        value = between(seed, low, high);
    while (fabs(value - rest) < 0.1 * (high - low));
    return value;
}

static void step_before(struct injection *in, const struct plant *of, double at, uint64_t *seed)
{
    snprintf(in->before, sizeof in->before, "{ at = %.4f; set = \"%s\"; value = %.17g; }, ", at, of->setpoint,
             apart(seed, of->rest, of->low, of->high));
}

static void inject_setpoint(struct injection *in, const struct plant *of, double period, uint64_t *seed)
{
    const double at = off_grid(seed, of);
    *in = (struct injection){.kind = WHY_SETPOINT, .input = of->setpoint, .from = at, .until = at + period};
    snprintf(in->more, sizeof in->more, "{ at = %.4f; set = \"%s\"; value = %.17g; }", at, of->setpoint,
             apart(seed, of->rest, of->low, of->high));
}

static enum why_kind measured_as(const struct plant *of)
{
    return of->is && strstr(of->is, "disturbances") ? WHY_DISTURBANCE : WHY_MEASUREMENT;
}

static void inject_sensor_fault(struct injection *in, const struct plant *of, double period, uint64_t *seed)
{
    const double at = off_grid(seed, of), size = of->off * between(seed, 0.2, 2);
    *in = (struct injection){.kind = measured_as(of),
                             .input = of->measurement,
                             .from = at,
                             .until = at + 2 * period,
                             .fault = true};
    snprintf(in->more, sizeof in->more,
             "faults = ( { kind = \"drift\"; at = %.4f; duration = %g; size = %.17g; } );", at, 2 * period,
             (between(seed, -1, 1) < 0 ? -size : size) / period);
}

/* Its measurement is not to be had while a setpoint moves the output. */
static void inject_dropout(struct injection *in, const struct plant *of, double period, uint64_t *seed)
{
    const double at = off_grid(seed, of);
    *in = (struct injection){.kind = WHY_MEASUREMENT,
                             .input = of->measurement,
                             .from = at,
                             .until = at + 3 * period,
                             .fault = true};
    step_before(in, of, at - 1.5 * period, seed);
    snprintf(in->more, sizeof in->more, "faults = ( { kind = \"dropout\"; at = %.4f; } );", at);
}

static void inject_limit(struct injection *in, const struct plant *of, double period, uint64_t *seed)
{
    const double at = off_grid(seed, of);
    *in = (struct injection){.kind = WHY_TUNING, .input = of->limit, .from = at, .until = at + period};
    snprintf(in->more, sizeof in->more, "{ at = %.4f; set = \"%s\"; value = %.17g; }", at, of->limit,
             between(seed, of->limit_low, of->limit_high));
}

static void inject_tuning(struct injection *in, const struct plant *of, double period, uint64_t *seed)
{
    const double at = off_grid(seed, of);
    *in = (struct injection){
        .kind = WHY_TUNING, .input = of->tuning, .from = at, .until = at + (of->tuned < 1 ? 2 : 1) * period};
    step_before(in, of, at - 1.5 * period, seed);
    snprintf(in->more, sizeof in->more, "{ at = %.4f; set = \"%s\"; value = %.17g; }", at, of->tuning,
             of->tuned * between(seed, 0.8, 1.2));
}

static void inject_mode(struct injection *in, const struct plant *of, double period, uint64_t *seed)
{
    const double at = off_grid(seed, of);
    *in = (struct injection){.kind = WHY_MODE, .from = at, .until = at + 3 * period};
    step_before(in, of, at - 1.5 * period, seed);
    snprintf(in->more, sizeof in->more, "{ at = %.4f; mode = \"%s\"; value = \"Man\"; }", at, of->loop);
}

static void inject_manual(struct injection *in, const struct plant *of, double period, uint64_t *seed)
{
    const double at = off_grid(seed, of);
    *in = (struct injection){.kind = WHY_MANUAL, .from = at, .until = at + period};
    snprintf(in->before, sizeof in->before, "{ at = %.4f; mode = \"%s\"; value = \"Man\"; }, ",
             at - 4 * period, of->loop);
    snprintf(in->more, sizeof in->more, "{ at = %.4f; set = \"%s\"; value = %.17g; }", at, of->loop,
             between(seed, of->limit_low, of->limit_high));
}

/* The loop below is not to be had while a setpoint moves the one above. */
static void inject_below(struct injection *in, const struct plant *of, double period, uint64_t *seed)
{
    const double at = off_grid(seed, of);
    *in = (struct injection){.kind = WHY_BELOW, .input = "r1", .from = at, .until = at + 3 * period};
    step_before(in, of, at - 1.5 * period, seed);
    snprintf(in->more, sizeof in->more, "{ at = %.4f; mode = \"v1\"; value = \"Man\"; }", at);
}

/* What the loop above makes of a step is the setpoint of this one. */
static void inject_above(struct injection *in, const struct plant *of, double period, uint64_t *seed)
{
    inject_setpoint(in, of, period, seed);
    in->input = "r1";
    in->until += 0.5;
}

typedef void inject(struct injection *in, const struct plant *of, double period, uint64_t *seed);
static const struct {
    const char *name;
    inject *make;
} causes[] = {{"setpoint", inject_setpoint}, {"sensor fault", inject_sensor_fault},
              {"dropout", inject_dropout},   {"limit", inject_limit},
              {"tuning", inject_tuning},     {"mode", inject_mode},
              {"manual", inject_manual},     {"loop below", inject_below},
              {"loop above", inject_above}};
#define CAUSES (sizeof causes / sizeof *causes)

static bool has_cause(const struct plant *of, inject *make)
{
    if (!strcmp(of->loop, "upper.r1"))
        return make == inject_below || make == inject_setpoint;
    if (!strcmp(of->name, "two-layers"))
        return make == inject_above;
    return make == inject_limit || make == inject_manual ? of->limit != NULL
           : make == inject_tuning                       ? of->tuning != NULL
           : make == inject_sensor_fault                 ? of->measurement != NULL
           : make == inject_dropout ? of->setpoint && of->measurement && measured_as(of) == WHY_MEASUREMENT
           : make == inject_setpoint || make == inject_mode ? of->setpoint != NULL
                                                            : false;
}

/* The experiment of a law, with a fault of its measurement, or "". */
static void put_in(const struct plant *of, const char *fault)
{
    static char name[40];
    memset(instead, 0, sizeof instead);
    if (of->measurement) {
        snprintf(name, sizeof name, "name = \"%s\";", of->measurement);
        instead[0].from = name;
        snprintf(instead[0].to, sizeof instead[0].to, "%s %s", name, fault);
    }
    if (of->is) {
        instead[1].from = of->was;
        snprintf(instead[1].to, sizeof instead[1].to, "%s", of->is);
        instead[2].from = !strcmp(of->name, "first-order") ? TUNING_OF_PI : TUNING_OF_CASCADE;
        snprintf(instead[2].to, sizeof instead[2].to, "%s", of->tuned_as);
    }
}

/* From the same ticks of the run and of its twin, which lacks the cause until an output differs: the tick at which it
 * does. The other inputs are the same until then, so that all that differs is the cause's. */
static void assert_effect_is_what_a_twin_lacks(const struct plant *of, const struct injection *in,
                                               const struct replay *twin)
{
    const size_t number = (size_t)(answer.by - replay.controller);
    const struct ticks *mine = &answer.by->ticks, *other = &twin->controller[number].ticks;
    const size_t u = answer.by->core->offset[APC_TICK_U] + answer.element;
    const char *name = answer.cause->tag ? answer.cause->tag->name : NULL;
    struct replay with = replay;
    size_t k = 0;
    double effect[2], out[2];
    while (k < mine->n && mine->value[mine->at[k].first + u] == other->value[other->at[k].first + u])
        k++;
    assert_true(k < mine->n);
    for (int i = 0; i < 2; i++) {
        explain(of->loop, in->from, apc_ns_to_s(mine->at[k].time - replay.start));
        const struct why_cause *cause = cause_named(in->kind, name);
        assert_true(i || cause);
        assert_true(answer.tick->seq == mine->at[k].seq);
        effect[i] = cause ? cause->effect : 0;
        out[i] = answer.u;
        assert_whole();
        replay = *twin;
    }
    replay = with;
    const double error = effect[0] - effect[1] - (out[0] - out[1]);
    if (!(fabs(error) <= 1e-12 * (fabs(effect[0]) + fabs(effect[1]) + fabs(out[0]) + fabs(out[1]))))
        fail_msg("%s of %s at %.3f s: moved it by %.17g, not %.17g", in->input ? in->input : "", of->law,
                 in->from, effect[0] - effect[1], out[0] - out[1]);
}

/* Is the cause that is put in named first, with what the output lacks without it? Another one is where that one moves
 * nothing, as at a limit, or less than something else does without it. */
static bool is_named(const struct plant *of, inject *make, uint64_t *seed)
{
    for (int drawn = 0; drawn < 100; drawn++) {
        struct injection in;
        struct experiment e;
        struct replay twin;
        char more[600], before[300];
        put_in(of, "");
        load_experiment(&e, of->name, "");
        make(&in, of, apc_ns_to_s(e.controllers[e.n_controllers - 1].rhythm.period), seed);
        experiment_free(&e);
        snprintf(before, sizeof before, "actions = ( %.*s );",
                 (int)strlen(in.before) - (in.before[0] ? 2 : 0), in.before);
        snprintf(more, sizeof more, "actions = ( %s%s );", in.before, in.more);
        make_run(of->name, before, in.until + 1);
        explain(of->loop, in.from, in.until);
        const double without = answer.u, most = answer.n > 0 ? fabs(answer.cause->effect) : 0;
        twin = replay;
        replay = (struct replay){.controller = NULL};
        put_in(of, in.fault ? in.more : "");
        make_run(of->name, in.fault ? before : more, in.until + 1);
        explain(of->loop, in.from, in.until);
        assert_whole();
        const bool first = is_first(in.kind, in.input), moved = fabs(answer.u - without) > most + 1e-9;
        if (first && moved)
            assert_effect_is_what_a_twin_lacks(of, &in, &twin);
        why_free(&answer); /* may be the twin's */
        replay_free(&twin);
        if (first || moved)
            return first;
    }
    fail_msg("%s: nothing that is put in moves %s", of->law, of->loop);
    return false;
}

static bool has_python(void)
{
    return system("\"${APC_PYTHON:-python3}\" -c 'import sys; sys.exit(sys.version_info < (3, 9))'") == 0;
}

/* Promise(simulation/why-first): Of setpoints, sensor faults, limits, tuning, modes, outputs by hand and loops below
 *   that are put in at random, the one that moved an output is named first, under each law and one's own, with what the
 *   output lacks in the same run without it. */
static void the_change_that_moved_an_output_comes_first(void **state)
{
    const char *asked = getenv("APC_TEST_WHY");
    const long rounds = asked ? strtol(asked, NULL, 10) : 7;
    uint64_t seed = 7;
    (void)state;
    for (size_t p = 0; p < PLANTS; p++) {
        const struct plant *of = &plants[p];
        long right = 0, tried = 0, first[CAUSES] = {0}, of_cause[CAUSES] = {0};
        if (strstr(of->law, ".py") && !has_python()) {
            print_message("%s: skipped: there is no Python 3.9 or newer here\n", of->law);
            continue;
        }
        for (size_t c = 0; tried < rounds; c = (c + 1) % CAUSES) {
            if (!has_cause(of, causes[c].make))
                continue;
            of_cause[c]++;
            tried++;
            first[c] += is_named(of, causes[c].make, &seed);
        }
        for (size_t c = 0; c < CAUSES; c++) {
            right += first[c];
            if (asked && of_cause[c] > 0)
                printf("%-14s %-14s %4ld of %4ld\n", of->law, causes[c].name, first[c], of_cause[c]);
        }
        if (100 * right < 99 * tried)
            fail_msg("%s: %ld of %ld", of->law, right, tried);
    }
}

/*
 * Promise(simulation/why-output-moved): The inputs that moved an output are named with their effects, the one
 *   that moved it most first: what the output lacks, bit for bit, in a run without the change. A row's author and
 *   the loop above are told. A tick that does not come out of its record again is not explained.
 */
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

/*
 * Promise(simulation/replay-store): The ticks of a store come out again bit for bit whatever part of them is in memory at
 *   once; where one was altered, it is named.
 */
static void the_ticks_of_a_store_come_out_window_by_window(void **state)
{
    static const struct {
        const char *name;
        double duration, window;
    } of[] = {{"first-order", 200, 1e6},
              {"first-order", 200, 17},
              {"two-layers", 250, 31},
              {"quadruple-tank-mpc", 150, 20},
              {"adiabatic-cstr-nmpc", 90, 40}};
    const struct replay_watch nobody = {.ctx = NULL};
    (void)state;
    for (size_t i = 0; i < sizeof of / sizeof *of; i++) {
        struct experiment e;
        struct simulation s;
        struct season season;
        struct replay_range range = {.since = SIMULATION_BEGIN};
        load_experiment(&e, of[i].name, "");
        assert_int_equal(simulation_create(&s, &e, 3, &why), 0);
        assert_int_equal(simulation_run(&s, of[i].duration), 0);
        assert_int_equal(provision(s.store, &e, PROVISION_KEEP), 0);
        range.store = s.store;
        range.until = range.since + (apc_ns)(of[i].duration * 1e9);
        assert_int_equal(apc_ns_from_s(of[i].window, &range.window), 0);
        if (season_open(&season, &range, &nobody, &why) < 0)
            fail_msg("%s: %s", of[i].name, why.text);
        for (apc_ns since = season.of.since, until; since < season.of.until; since = until) {
            until = season_window(&season, since);
            if (season_replay(&season, since, until, &why) < 0)
                fail_msg("%s: %s", of[i].name, why.text);
        }
        assert_int_equal(season.n_controllers, e.n_controllers);
        for (size_t k = 0; k < e.n_controllers; k++) {
            const struct replay_figures *c = &season.controller[k].figures;
            const double ticks = of[i].duration / apc_ns_to_s(e.controllers[k].rhythm.period);
            assert_string_equal(season.controller[k].name, e.controllers[k].name);
            if (c->first[0] || c->same != c->judged || c->restarts || c->others || c->lost ||
                fabs((double)c->judged - ticks) > 1)
                fail_msg("%s: %s: %llu of %llu (%g), %s", of[i].name, e.controllers[k].name,
                         (unsigned long long)c->same, (unsigned long long)c->judged, ticks, c->first);
        }
        season_close(&season);
        range.controller = "nobody";
        assert_int_equal(season_open(&season, &range, &nobody, &why), APC_ENOTFOUND);
        assert_has(why.text, "there is no controller \"nobody\"");
        season_close(&season);
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
        cmocka_unit_test_teardown(the_change_that_moved_an_output_comes_first, end),
        cmocka_unit_test_teardown(each_kind_of_input_is_found, end),
        cmocka_unit_test_teardown(who_wrote_is_told_in_the_words_of_the_write, end),
        cmocka_unit_test_teardown(the_terms_of_a_law_are_its_output, end),
        cmocka_unit_test_teardown(the_terms_of_a_plan_are_what_it_comes_from, end),
        cmocka_unit_test_teardown(a_move_begins_where_something_goes_out, end),
        cmocka_unit_test_teardown(a_damaged_record_is_not_explained, end),
        cmocka_unit_test_teardown(a_store_tells_what_the_folder_of_its_run_does, end),
        cmocka_unit_test_teardown(the_ticks_of_a_store_come_out_window_by_window, end),
        cmocka_unit_test_teardown(a_question_is_answered_in_time_or_refused, end),
    };
    setenv("PYTHONPATH", APC_SOURCE_DIR "/python/src", 1); /* of the law in Python */
    return cmocka_run_group_tests(tests, NULL, NULL);
}

/* SPDX-License-Identifier: BSD-3-Clause */
/*
 * That a loop is calm makes its tick cheaper and nothing else: of two controllers that live through the same
 * one forgets after each tick who is calm, and all rows and notices of both are the same bits. They live
 * through quiet times and such in which everything happens: measurements stop or are Bad, somebody writes
 * modes, setpoints, outputs, tuning, also such as must be refused, the law fails or talks, rows are lost, the
 * store does not answer, clocks step, the daemon starts again.
 */
#include "check.h"

#include "modules/controller.h"

#include <stdio.h>
#include <string.h>

#define S      APC_NS_PER_S
#define T0     (INT64_C(1700000000) * S)
#define TICKS  4000
#define SEEDS  12
#define SWITCH 50 /* that says who acts */
#define BELOW  60 /* setpoint of a loop below, its mode, its controller's tick row */
#define MODE   61
#define TICK   9
#define SIGNAL 70
#define ABOVE  80 /* mode of a loop above */

enum { LOOPS = 5, ROWS = 128 };
enum kind { PLAIN, CASCADED, SELECTED, IN_TURN, KINDS };

/* ---- A law with moods ------------------------------------------------------------------------- */

static size_t number[LOOPS];
static enum apc_law_result mood[LOOPS];
static bool talks[LOOPS];

static int create(const struct apc_law_setup *setup, struct apc_law_needs *needs, void **self,
                  struct apc_error *why)
{
    (void)needs;
    (void)why;
    *self = &number[setup->output];
    return 0;
}

static void destroy(void *self)
{
    (void)self;
}

static int compute(struct apc_law_call *c)
{
    const size_t i = *(const size_t *)c->self;

    if (talks[i] && c->say)
        (void)snprintf(c->say, APC_LAW_SAY, "law %zu has something to say", i);
    if (mood[i] != APC_LAW_GOOD)
        (void)snprintf(c->why, APC_LAW_WHY, "is in mood %d", (int)mood[i]);
    (void)apc_law_pi.compute(c);
    return (int)mood[i];
}

/* ---- The two and what is around them ------------------------------------------------------------ */

struct world {
    enum kind kind;
    uint64_t seed, tick;
    struct apc_random random;
    struct apc_law law;
    struct apc_controller *core[2]; /* the second is never calm */
    struct apc_now now;
    bool lively;
    bool frozen[LOOPS];
    double y[LOOPS];
    struct apc_sample at[ROWS], kept[ROWS]; /* as `in` and `former` have them */
    struct apc_vector below, row;
    double *values;
    size_t calm, roused; /* ticks of loops */
};

static bool chance(struct world *w, double p)
{
    return apc_random_uniform(&w->random) < p;
}

static double between(struct world *w, double low, double high)
{
    return low + (high - low) * apc_random_uniform(&w->random);
}

static struct apc_controller *make(const struct world *w)
{
    struct apc_controller_setpoint z[LOOPS];
    struct apc_controller_loop loop[LOOPS];
    struct apc_controller *core;
    struct apc_error why;
    struct apc_controller_options o = {.size = sizeof(o),
                                       .law = &w->law,
                                       .dim = {LOOPS, LOOPS, LOOPS, 0},
                                       .period = S,
                                       .horizon = 7 * S / 2,
                                       .shed_after = 3,
                                       .z = z,
                                       .loop = loop,
                                       .output = w->kind == PLAIN ? 0 : 1,
                                       .acting = w->kind == IN_TURN ? SWITCH : 0};

    for (size_t i = 0; i < LOOPS; i++) {
        z[i] = (struct apc_controller_setpoint){.id = (int)i + 1, .low = -50, .high = 50};
        loop[i] = (struct apc_controller_loop){.id = (int)i + 1,
                                               .mode = (int)i + 1,
                                               .low = -10,
                                               .high = 10,
                                               .rate = i == 1 ? 0.5 : 0,
                                               .fault = 1,
                                               .hold = i == 2 ? 6 * S : 0};
    }
    if (w->kind == CASCADED) {
        z[0].above = ABOVE;
        z[0].above_period = 2 * S;
        loop[4].setpoint = BELOW;
        loop[4].below = MODE;
        loop[4].below_tick = TICK;
        loop[4].below_period = S;
    } else if (w->kind == SELECTED) {
        loop[3].signal = SIGNAL;
        loop[3].below_tick = TICK;
        loop[3].below_period = S;
    }
    assert_int_equal(apc_controller_create(&core, &o, &why), 0);
    assert_true(apc_controller_in(core)->n_samples <= ROWS && apc_controller_former(core)->n_samples <= ROWS);
    apc_controller_claimed(core, true);
    return core;
}

/* ---- What happens ------------------------------------------------------------------------------ */

static double wanted_mode(struct world *w)
{
    static const double some[] = {APC_MODE_MAN, APC_MODE_CAS, APC_MODE_CAS, APC_MODE_OOS, 7};

    return chance(w, 0.6) ? (double)APC_MODE_AUTO : some[(size_t)between(w, 0, 5)];
}

static double wanted_tuning(struct world *w, size_t parameter)
{
    static const double low[] = {-1, -1, -1, -9, -1}, high[] = {2, 20, 1, 0, 9};

    return between(w, low[parameter], high[parameter]);
}

static apc_status some_status(struct world *w)
{
    static const apc_status some[] = {APC_GOOD, APC_GOOD_LIMITED_HIGH, APC_UNCERTAIN_INITIAL,
                                      APC_GOOD_LOCAL_OVERRIDE};

    return some[(size_t)between(w, 0, 4)];
}

static void renew(struct world *w, struct apc_sample *s, double value, apc_status status)
{
    s->seq++;
    s->time = w->now.utc - (apc_ns)between(w, 0, 0.3e9);
    s->value = value;
    s->status = status;
    s->origin = 0;
}

static void measure(struct world *w, size_t k)
{
    w->frozen[k] = w->frozen[k] ? !chance(w, 0.2) : chance(w, w->lively ? 0.02 : 0.001);
    w->y[k] += between(w, -1, 1);
    if (!w->frozen[k] && chance(w, 0.95))
        renew(w, &w->at[k], w->y[k], chance(w, w->lively ? 0.03 : 0.001) ? APC_BAD : APC_GOOD);
}

/* Row @p k of what is read may become another one. */
static void happen(struct world *w, size_t k)
{
    struct apc_sample *s = &w->at[k];
    const double often = w->lively ? 0.03 : 0.001;
    const apc_status status = chance(w, 0.05) ? APC_BAD : APC_GOOD;

    if (k < LOOPS)
        measure(w, k);
    else if (s->table == APC_ACTUAL && chance(w, 0.3))
        renew(w, s, chance(w, 0.5) ? (double)APC_MODE_AUTO : between(w, -5, 5), some_status(w));
    else if (!chance(w, s->table == APC_TUNING ? often / 5 : often))
        return;
    else if (s->table == APC_OPMODE && s->id == SWITCH)
        renew(w, s, chance(w, 0.6) ? 1 : 2, APC_GOOD);
    else if (s->table == APC_OPMODE)
        renew(w, s, s->id == MODE ? (double)APC_MODE_CAS : wanted_mode(w), status);
    else if (s->table == APC_SETPOINT)
        renew(w, s, between(w, -60, 60), status);
    else if (s->table == APC_MANUAL)
        renew(w, s, between(w, -12, 12), status);
    else if (s->table == APC_TUNING)
        renew(w, s, wanted_tuning(w, (size_t)(s->id - 1) % apc_law_pi.n_tuning), status);
    else if (w->kind == IN_TURN && s->table == APC_ACTUATOR)
        renew(w, s, between(w, -10, 10), status);
    if (s->table == APC_SETPOINT && s->id == 1 && w->kind == CASCADED && chance(w, 0.8))
        s->origin = s->seq; /* of the loop above */
}

static void happen_all(struct world *w)
{
    static const enum apc_law_result bad[] = {APC_LAW_SUBOPTIMAL, APC_LAW_LATE, APC_LAW_INFEASIBLE,
                                              APC_LAW_FAILED};
    const size_t n = apc_controller_in(w->core[0])->n_samples;

    w->lively = w->lively ? !chance(w, 0.05) : chance(w, 0.01);
    w->now.mono += S;
    w->now.utc += chance(w, 0.001) ? 3600 * S : S;
    for (size_t k = 0; k < n; k++)
        happen(w, k);
    for (size_t i = 0; i < LOOPS; i++) {
        const bool moody = mood[i] != APC_LAW_GOOD ? chance(w, 0.6) : chance(w, w->lively ? 0.03 : 0.001);

        mood[i] = moody ? bad[(size_t)between(w, 0, 4)] : APC_LAW_GOOD;
        talks[i] = chance(w, w->lively ? 0.02 : 0.001);
    }
    if (chance(w, 0.8)) {
        w->below.seq++;
        w->below.time = w->now.utc;
    }
}

/* ---- A tick ------------------------------------------------------------------------------------- */

static void give(struct world *w, struct apc_controller *core)
{
    struct apc_rows *in = apc_controller_in(core);

    memcpy(in->sample, w->at, in->n_samples * sizeof(*in->sample));
    for (size_t i = 0; i < in->n_vectors; i++) {
        in->vector[i].seq = w->below.seq;
        in->vector[i].time = w->below.time;
    }
}

static bool same_sample(const struct apc_sample *a, const struct apc_sample *b)
{
    return a->table == b->table && a->id == b->id && a->seq == b->seq && a->time == b->time &&
           memcmp(&a->value, &b->value, sizeof(a->value)) == 0 && a->status == b->status &&
           a->author == b->author && a->origin == b->origin;
}

static bool same_vector(const struct apc_vector *a, const struct apc_vector *b)
{
    return a->table == b->table && a->id == b->id && a->seq == b->seq && a->time == b->time &&
           a->status == b->status && a->n == b->n && memcmp(a->value, b->value, a->n * sizeof(double)) == 0;
}

static bool same_rows(const struct apc_rows *a, const struct apc_rows *b)
{
    bool same = a->n_samples == b->n_samples && a->n_vectors == b->n_vectors;

    for (size_t i = 0; same && i < a->n_samples; i++)
        same = same_sample(&a->sample[i], &b->sample[i]);
    for (size_t i = 0; same && i < a->n_vectors; i++)
        same = same_vector(&a->vector[i], &b->vector[i]);
    return same;
}

static bool same_notice(const struct apc_notice *a, const struct apc_notice *b)
{
    return a->kind == b->kind && (a->kind == APC_NOTICE_NONE || strcmp(a->text, b->text) == 0);
}

/* Also all that is told besides the gravest. */
static bool same_notices(struct world *w, const struct apc_notice first[2])
{
    struct apc_notice more[2];
    bool same = same_notice(&first[0], &first[1]), any = chance(w, 0.8);

    while (same && any) {
        any = apc_controller_noticed(w->core[0], &more[0]);
        same =
            any == apc_controller_noticed(w->core[1], &more[1]) && (!any || same_notice(&more[0], &more[1]));
    }
    return same;
}

/* As the store has it from now on. */
static void keep(struct world *w)
{
    const struct apc_rows *out = apc_controller_out(w->core[0]), *in = apc_controller_in(w->core[0]),
                          *former = apc_controller_former(w->core[0]);

    for (size_t i = 0; i < out->n_samples; i++) {
        const struct apc_sample *s = &out->sample[i];

        for (size_t k = 0; k < in->n_samples; k++) {
            if (w->at[k].table != s->table || w->at[k].id != s->id)
                continue;
            w->at[k] = *s;
            w->at[k].seq += s->table == APC_SETPOINT; /* by swap */
        }
        for (size_t k = 0; k < former->n_samples; k++) {
            if (w->kept[k].table == s->table && w->kept[k].id == s->id)
                w->kept[k] = *s;
        }
    }
    if (!out->n_vectors)
        return;
    w->row = out->vector[0];
    w->row.value = w->values;
    memcpy(w->values, out->vector[0].value, w->row.n * sizeof(double));
}

/* Rows are stored, or not, or nobody knows, or the daemon is ended before it says so. */
static void end_tick(struct world *w)
{
    const double what = apc_random_uniform(&w->random);
    const int written = what < 0.01 ? 0 : what < 0.02 ? -1 : 1;

    if (written > 0 || (written < 0 && chance(w, 0.5)))
        keep(w);
    if (what > 0.99)
        return;
    for (size_t j = 0; j < 2; j++)
        apc_controller_update(w->core[j], written);
}

static void restart(struct world *w)
{
    const apc_ns since = chance(w, 0.8) ? T0 : w->now.utc;

    for (size_t j = 0; j < 2; j++) {
        struct apc_rows *former;

        apc_controller_destroy(w->core[j]);
        w->core[j] = make(w);
        former = apc_controller_former(w->core[j]);
        memcpy(former->sample, w->kept, former->n_samples * sizeof(*former->sample));
        former->vector[0].seq = w->row.seq;
        former->vector[0].time = w->row.time;
        former->vector[0].status = w->row.status;
        former->vector[0].n = w->row.n;
        memcpy(former->vector[0].value, w->values, w->row.n * sizeof(double));
        (void)apc_controller_resume(w->core[j], since);
    }
}

static void count(struct world *w, const bool was[LOOPS])
{
    for (size_t i = 0; i < LOOPS; i++) {
        w->calm += w->core[0]->fast_path[i];
        w->roused += was[i] && !w->core[0]->fast_path[i];
    }
}

static void tick(struct world *w)
{
    const bool have = !chance(w, w->lively ? 0.02 : 0.001), heard = !chance(w, 0.05);
    struct apc_notice notice[2] = {{.kind = APC_NOTICE_NONE}, {.kind = APC_NOTICE_NONE}};
    bool was[LOOPS];
    int rows[2];

    happen_all(w);
    if (w->kind == IN_TURN && chance(w, 0.02)) {
        const bool claimed = chance(w, 0.8);

        apc_controller_claimed(w->core[0], claimed);
        apc_controller_claimed(w->core[1], claimed);
    }
    memcpy(was, w->core[0]->fast_path, sizeof(was));
    for (size_t j = 0; j < 2; j++) {
        give(w, w->core[j]);
        rows[j] = apc_controller_compute(w->core[j], w->now, w->tick, have, heard ? &notice[j] : NULL);
    }
    if (rows[0] != rows[1] || !same_rows(apc_controller_out(w->core[0]), apc_controller_out(w->core[1])) ||
        !same_notices(w, notice) ||
        apc_controller_failures(w->core[0]) != apc_controller_failures(w->core[1]))
        fail_msg("kind %d, seed %llu, tick %llu: the two are not the same", (int)w->kind,
                 (unsigned long long)w->seed, (unsigned long long)w->tick);
    count(w, was);
    apc_controller_stir(w->core[1]);
    w->core[1]->telling = true;
    end_tick(w);
    if (chance(w, 0.003))
        restart(w);
}

static void begin(struct world *w)
{
    double *const values = w->values;

    apc_random_init(&w->random, w->seed, "calm");
    w->now = (struct apc_now){.mono = 1000 * S, .utc = T0};
    w->lively = false;
    memset(w->frozen, 0, sizeof(w->frozen));
    memset(mood, 0, sizeof(mood));
    memset(talks, 0, sizeof(talks));
    for (size_t j = 0; j < 2; j++) {
        w->core[j] = make(w);
        (void)apc_controller_resume(w->core[j], T0);
    }
    memcpy(w->at, apc_controller_in(w->core[0])->sample,
           apc_controller_in(w->core[0])->n_samples * sizeof(*w->at));
    memcpy(w->kept, apc_controller_former(w->core[0])->sample,
           apc_controller_former(w->core[0])->n_samples * sizeof(*w->kept));
    w->row = *apc_controller_former(w->core[0])->vector;
    w->row.value = values;
    w->below = (struct apc_vector){.seq = 1, .time = T0};
    for (size_t k = 0; k < apc_controller_in(w->core[0])->n_samples; k++) {
        struct apc_sample *s = &w->at[k];

        if (s->table == APC_OPMODE)
            renew(w, s, s->id == SWITCH ? 1 : (double)APC_MODE_AUTO, APC_GOOD);
        else if (s->table == APC_SETPOINT)
            renew(w, s, between(w, -5, 5), APC_GOOD);
    }
}

static void live(enum kind kind)
{
    static double values[4096];
    struct world w = {.kind = kind, .law = apc_law_pi, .values = values};

    w.law.create = create;
    w.law.destroy = destroy;
    w.law.compute = compute;
    for (w.seed = 1; w.seed <= SEEDS; w.seed++) {
        begin(&w);
        for (w.tick = 1; w.tick <= TICKS; w.tick++)
            tick(&w);
        apc_controller_destroy(w.core[0]);
        apc_controller_destroy(w.core[1]);
    }
    print_message("calm in %zu of %d ticks of loops, roused %zu times\n", w.calm, SEEDS * TICKS * LOOPS,
                  w.roused);
    if (kind == IN_TURN)
        assert_int_equal(w.calm, 0);
    else
        assert_true(w.calm > SEEDS * TICKS * LOOPS / 5 && w.roused > SEEDS * TICKS / 50);
}

/*
 * Promise(modes/loop-nothing-decide): A loop that has nothing to decide takes a shorter way through a tick,
 *   to the same rows and notices, whatever happens to it.
 */
static void a_calm_loop_does_what_it_would_do_anyway(void **state)
{
    (void)state;
    live(PLAIN);
}

/* Promise(modes/loop-nothing-decide) */
static void so_do_those_beside_loops_of_a_cascade(void **state)
{
    (void)state;
    live(CASCADED);
}

/* Promise(modes/loop-nothing-decide) */
static void so_do_those_beside_one_whose_output_is_selected(void **state)
{
    (void)state;
    live(SELECTED);
}

/* Promise(modes/loop-nothing-decide) */
static void where_controllers_take_turns_no_loop_is_calm(void **state)
{
    (void)state;
    live(IN_TURN);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(a_calm_loop_does_what_it_would_do_anyway),
        cmocka_unit_test(so_do_those_beside_loops_of_a_cascade),
        cmocka_unit_test(so_do_those_beside_one_whose_output_is_selected),
        cmocka_unit_test(where_controllers_take_turns_no_loop_is_calm),
    };

    for (size_t i = 0; i < LOOPS; i++)
        number[i] = i;
    return cmocka_run_group_tests(tests, NULL, NULL);
}

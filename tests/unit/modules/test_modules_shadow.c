/* SPDX-License-Identifier: BSD-3-Clause */
/*
 * Two controllers of one output over one store, of which one acts and the other goes along. All time is
 * virtual. A tick is two steps, for others to come between: the controller reads and computes; its rows are
 * appended, and it claims its output or gives it back.
 */
#include "check.h"

#include "apcshareddata.h"
#include "modules/controller.h"

#include <stdio.h>
#include <string.h>

#define T0     (INT64_C(1700000000) * APC_NS_PER_S)
#define PERIOD APC_NS_PER_S
#define SWITCH (2 * 65536 + 16 + APC_ACTUATOR)
#define ROWS   24

enum who { FIRST = 1, OTHER, END }; /* ids of target modes, tick rows, published outputs */

struct station {
    struct apc_store *store; /* of its own, so that its claims are */
    struct apc_controller *core;
    bool pending, claimed;
    uint64_t ticks;
};

struct plant {
    char uri[40];
    struct apc_store *store;
    struct station station[END];
    double gain[END];
    apc_ns now;
    double level;
    enum who last; /* whose row the newest output is */
    unsigned changes;
};

/* ---- The store ---------------------------------------------------------------------------- */

static struct apc_sample newest(const struct plant *p, enum apc_table table, int id)
{
    struct apc_sample s = {.table = table, .id = id};

    assert_int_equal(apc_store_read(p->store, &s, 1), 0);
    return s;
}

static void put(const struct plant *p, enum apc_table table, int id, double value)
{
    struct apc_sample s = {.table = table, .id = id, .time = T0 + p->now, .value = value};

    assert_int_equal(apc_store_put(p->store, &s, 1), 0);
}

static void measure(const struct plant *p, apc_status status)
{
    struct apc_sample s = newest(p, APC_SENSOR, 1);

    s.seq++;
    s.time = T0 + p->now;
    s.value = p->level;
    s.status = status;
    assert_true(apc_store_append(p->store, &s, 1) >= 0);
}

/* ---- Controllers ---------------------------------------------------------------------------- */

static void create(struct plant *p, enum who who, struct apc_controller **core)
{
    const double tuning[] = {p->gain[who], 5.0, 0.0, -1e9, 1e9};
    const int y = 1;
    const struct apc_controller_setpoint z = {.id = 1, .low = -5, .high = 5};
    const struct apc_controller_loop loop = {
        .id = 1, .mode = (int)who, .low = -3, .high = 3, .hold = 2 * PERIOD};
    const struct apc_controller_options o = {.size = sizeof(o),
                                             .number = (int)who,
                                             .law = &apc_law_pi,
                                             .dim = {1, 1, 1, 0},
                                             .period = PERIOD,
                                             .horizon = 3 * PERIOD,
                                             .y = &y,
                                             .z = &z,
                                             .loop = &loop,
                                             .tuning = 100 * (int)who,
                                             .acting = SWITCH,
                                             .shadow = who != FIRST,
                                             .output = (int)who,
                                             .start = tuning};
    struct apc_error why = {""};

    if (apc_controller_create(core, &o, &why) < 0)
        fail_msg("%s", why.text);
}

/* After a tick, and before the first: claims follow the switch. */
static void take_turns(struct station *s)
{
    struct apc_sample output = {.table = APC_ACTUATOR, .id = 1};
    const bool named = apc_controller_named(s->core);

    if (named && !s->claimed)
        s->claimed = apc_store_claim_set(s->store, &output, 1) == 0;
    else if (!named && s->claimed)
        s->claimed = apc_store_release(s->store, &output, 1) != 0;
    apc_controller_claimed(s->core, s->claimed);
}

static void make(struct plant *p, enum who who)
{
    struct station *s = &p->station[who];
    struct apc_sample tick = {.table = APC_TICK, .id = (int)who};

    s->claimed = s->pending = false;
    assert_int_equal(apc_store_open(&s->store, p->uri, NULL, NULL), 0);
    assert_int_equal(apc_store_claim_set(s->store, &tick, 1), 0);
    create(p, who, &s->core);
    assert_int_equal(apc_store_read_rows(s->store, apc_controller_former(s->core)), 0);
    (void)apc_controller_resume(s->core, T0 - 1);
    assert_int_equal(apc_store_read_rows(s->store, apc_controller_in(s->core)), 0);
    take_turns(s);
}

static void stop(struct plant *p, enum who who)
{
    apc_controller_destroy(p->station[who].core);
    apc_store_close(p->station[who].store);
    p->station[who] = (struct station){.core = NULL};
}

static void reads(struct plant *p, enum who who)
{
    struct station *s = &p->station[who];

    assert_int_equal(apc_store_read_rows(s->store, apc_controller_in(s->core)), 0);
    apc_controller_compute(s->core, (struct apc_now){p->now, T0 + p->now}, s->ticks++, true, NULL);
    s->pending = true;
}

static bool acts(const struct station *s)
{
    return s->core && s->pending && s->core->state[0].put;
}

static void writes(struct plant *p, enum who who)
{
    struct station *s = &p->station[who];

    if (acts(s) && p->last && p->last != who) /* what was out goes on, whenever it was put */
        assert_near(s->core->u[0], newest(p, APC_ACTUATOR, 1).value, 1e-12);
    assert_true(apc_store_append_rows(s->store, apc_controller_out(s->core)) >= 0);
    apc_controller_update(s->core, 1);
    if (acts(s)) {
        p->changes += p->last != who;
        p->last = who;
    }
    s->pending = false;
    take_turns(s);
}

static void ticks(struct plant *p, enum who who)
{
    if (!p->station[who].core)
        return;
    reads(p, who);
    writes(p, who);
}

/* A period of all. */
static void run(struct plant *p, size_t periods)
{
    for (size_t i = 0; i < periods; i++) {
        const double u = newest(p, APC_ACTUATOR, 1).value;

        p->now += PERIOD;
        p->level += 0.2 * (u - p->level);
        measure(p, APC_GOOD);
        ticks(p, FIRST);
        ticks(p, OTHER);
    }
}

static void begin(struct plant *p, const char *name, double other)
{
    *p = (struct plant){.gain = {[FIRST] = 1.0, [OTHER] = other}};
    snprintf(p->uri, sizeof(p->uri), "mem:%s", name);
    assert_int_equal(apc_store_open(&p->store, p->uri, NULL, NULL), 0);
    assert_int_equal(apc_store_init(p->store), 0);
    put(p, APC_OPMODE, FIRST, APC_MODE_AUTO);
    put(p, APC_OPMODE, OTHER, APC_MODE_AUTO);
    put(p, APC_SETPOINT, 1, 1.0);
    measure(p, APC_GOOD);
    make(p, FIRST);
    make(p, OTHER);
}

static void end(struct plant *p)
{
    for (enum who who = FIRST; who < END; who++)
        if (p->station[who].core)
            stop(p, who);
    apc_store_close(p->store);
}

static enum apc_loop_state state_of(const struct plant *p, enum who who)
{
    return p->station[who].core->state[0].loop.state;
}

static void promote(const struct plant *p, enum who who)
{
    put(p, APC_OPMODE, SWITCH, who);
}

static bool is_mine(const struct apc_sample *s, enum who who)
{
    return s->table == APC_ESTIMATE ? s->id == (int)who
                                    : s->table == APC_ACTUAL && s->id != apc_variable_number(APC_SETPOINT, 1);
}

/* ---- Tests -------------------------------------------------------------------------------- */

static void test_a_shadow_writes_nothing_that_is_another_ones(void **state)
{
    struct plant p;

    (void)state;
    begin(&p, "mine", 2.0);
    for (int i = 0; i < 20; i++) {
        const struct apc_rows *out = apc_controller_out(p.station[OTHER].core);

        put(&p, APC_SETPOINT, 1, i % 3);
        run(&p, 1);
        assert_int_equal(state_of(&p, FIRST), APC_LOOP_AUTO);
        assert_int_equal(state_of(&p, OTHER), APC_LOOP_SHADOW);
        for (size_t k = 0; k < out->n_samples; k++)
            assert_true(is_mine(&out->sample[k], OTHER));
        assert_int_equal(out->n_vectors, 1);
        assert_int_equal(out->vector[0].id, OTHER);
    }
    assert_false(p.station[OTHER].claimed);
    end(&p);
}

/* With the same law and tuning, from the same rows, it would do what the other one does. */
static void test_what_it_would_do_is_what_the_same_law_does(void **state)
{
    struct plant p;

    (void)state;
    begin(&p, "would", 1.0);
    run(&p, 3);
    put(&p, APC_SETPOINT, 1, 2.0);
    for (int i = 0; i < 20; i++) {
        const struct apc_controller *first = p.station[FIRST].core, *other = p.station[OTHER].core;

        run(&p, 1);
        assert_near(newest(&p, APC_ESTIMATE, FIRST).value, first->u[0], 0);
        assert_near(newest(&p, APC_ACTUATOR, 1).value, first->u[0], 0);
        assert_near(newest(&p, APC_ESTIMATE, OTHER).value, other->law.trial[0], 0);
        assert_int_equal(newest(&p, APC_ESTIMATE, OTHER).origin, other->seq);
        assert_near(other->u[0], first->u[0], 0); /* it goes on from what really went out */
    }
    /* Where nothing moves any more both say the same. */
    run(&p, 200);
    assert_near(newest(&p, APC_ESTIMATE, OTHER).value, newest(&p, APC_ESTIMATE, FIRST).value, 1e-6);
    end(&p);
}

/* There and back, in the middle of a step of the setpoint and with another gain. */
static void test_a_promotion_is_no_bump(void **state)
{
    struct plant p;

    (void)state;
    begin(&p, "bump", 4.0);
    run(&p, 10);
    for (int i = 0; i < 6; i++) {
        const enum who to = i % 2 ? FIRST : OTHER;
        double before;
        int64_t seq;
        int waited = 0;

        put(&p, APC_SETPOINT, 1, i % 3);
        run(&p, 3);
        promote(&p, to);
        do {
            before = newest(&p, APC_ACTUATOR, 1).value;
            seq = newest(&p, APC_ACTUATOR, 1).seq;
            run(&p, 1);
            waited++;
        } while (p.last != to);
        assert_true(waited <= 3);
        assert_int_equal(newest(&p, APC_ACTUATOR, 1).seq, seq + 1);
        assert_near(newest(&p, APC_ACTUATOR, 1).value, before, 1e-12); /* what tracking gives */
        assert_int_equal(state_of(&p, to), APC_LOOP_AUTO);
        assert_int_equal(state_of(&p, to == FIRST ? OTHER : FIRST), APC_LOOP_SHADOW);
    }
    run(&p, 100);
    assert_near(p.level, newest(&p, APC_SETPOINT, 1).value, 1e-6);
    end(&p);
}

static void test_promoted_in_man_the_output_stays(void **state)
{
    struct plant p;
    double u;

    (void)state;
    begin(&p, "man", 2.0);
    run(&p, 5);
    put(&p, APC_OPMODE, OTHER, APC_MODE_MAN);
    put(&p, APC_MANUAL, OTHER, 2.5); /* for another day */
    run(&p, 2);
    u = newest(&p, APC_ACTUATOR, 1).value;
    promote(&p, OTHER);
    while (p.last != OTHER) {
        assert_near(newest(&p, APC_ACTUATOR, 1).value, u, 0);
        run(&p, 1);
        u = p.last == OTHER ? u : newest(&p, APC_ACTUATOR, 1).value;
    }
    run(&p, 3);
    assert_near(newest(&p, APC_ACTUATOR, 1).value, u, 0);
    assert_int_equal(state_of(&p, OTHER), APC_LOOP_MAN);
    end(&p);
}

/* A measurement that is Bad: the shadow says nothing, and the one that is promoted then holds. */
static void test_without_input_a_shadow_says_nothing(void **state)
{
    struct plant p;
    int64_t seq;
    double u;

    (void)state;
    begin(&p, "bad", 2.0);
    run(&p, 5);
    p.now += PERIOD;
    measure(&p, APC_BAD);
    seq = newest(&p, APC_ESTIMATE, OTHER).seq;
    u = newest(&p, APC_ACTUATOR, 1).value;
    ticks(&p, FIRST);
    ticks(&p, OTHER);
    assert_int_equal(newest(&p, APC_ESTIMATE, OTHER).seq, seq);
    assert_int_equal(state_of(&p, OTHER), APC_LOOP_SHADOW);
    promote(&p, OTHER);
    ticks(&p, FIRST);
    ticks(&p, OTHER);
    ticks(&p, OTHER);
    assert_int_equal(p.last, OTHER);
    assert_int_equal(state_of(&p, OTHER), APC_LOOP_HOLD);
    assert_near(newest(&p, APC_ACTUATOR, 1).value, u, 0);
    end(&p);
}

static void test_a_shadow_does_not_take_over_by_itself(void **state)
{
    struct plant p;
    int64_t seq;

    (void)state;
    begin(&p, "alone", 2.0);
    run(&p, 5);
    seq = newest(&p, APC_ACTUATOR, 1).seq;
    stop(&p, FIRST);
    run(&p, 50);
    assert_int_equal(newest(&p, APC_ACTUATOR, 1).seq, seq);
    assert_int_equal(state_of(&p, OTHER), APC_LOOP_SHADOW);
    make(&p, FIRST); /* and the other one, as it comes back, goes on at once */
    run(&p, 1);
    assert_int_equal(newest(&p, APC_ACTUATOR, 1).seq, seq + 1);
    assert_int_equal(p.last, FIRST);
    end(&p);
}

/* Who acts stands in the store: a restart changes nothing. */
static void test_a_restart_is_no_promotion(void **state)
{
    struct plant p;
    double u;

    (void)state;
    begin(&p, "restart", 2.0);
    run(&p, 5);
    promote(&p, OTHER);
    run(&p, 5);
    assert_int_equal(p.last, OTHER);
    stop(&p, OTHER);
    stop(&p, FIRST);
    make(&p, FIRST);
    make(&p, OTHER);
    u = newest(&p, APC_ACTUATOR, 1).value;
    p.changes = 0;
    run(&p, 5);
    assert_int_equal(p.changes, 0);
    assert_near(newest(&p, APC_ACTUATOR, 1).value, u, 1.0);
    assert_int_equal(state_of(&p, FIRST), APC_LOOP_SHADOW);
    end(&p);
}

/* What became of the setpoint is told by the one that acts, with seqs that go on. */
static void test_what_became_of_a_setpoint_is_told_on(void **state)
{
    const int told = apc_variable_number(APC_SETPOINT, 1);
    struct plant p;

    (void)state;
    begin(&p, "told", 2.0);
    for (int i = 0; i < 6; i++) {
        const int64_t before = newest(&p, APC_ACTUAL, told).seq;

        promote(&p, i % 2 ? FIRST : OTHER);
        run(&p, 4);
        put(&p, APC_SETPOINT, 1, i % 3 + 0.5);
        run(&p, 1);
        assert_true(newest(&p, APC_ACTUAL, told).seq > before);
        assert_int_equal(newest(&p, APC_ACTUAL, told).origin, newest(&p, APC_SETPOINT, 1).seq);
        assert_near(newest(&p, APC_ACTUAL, told).value, i % 3 + 0.5, 0);
    }
    end(&p);
}

/* A switch that names nobody, or a row that makes no sense: nobody acts, none takes it for his own. */
static void test_named_is_only_who_is_named(void **state)
{
    const double other[] = {0, 3, -1, 1e9};
    struct plant p;

    (void)state;
    begin(&p, "nobody", 2.0);
    for (size_t i = 0; i < sizeof(other) / sizeof(other[0]); i++) {
        int64_t seq;

        run(&p, 3);
        put(&p, APC_OPMODE, SWITCH, other[i]);
        run(&p, 2);
        seq = newest(&p, APC_ACTUATOR, 1).seq;
        run(&p, 5);
        assert_int_equal(newest(&p, APC_ACTUATOR, 1).seq, seq);
        promote(&p, FIRST);
    }
    end(&p);
}

/* ---- Every order -------------------------------------------------------------------------- */

/* Steps of one order: three ticks of each controller, and the operator, there and back. */
#define OPERATOR 0
static const unsigned steps_of[END] = {[OPERATOR] = 2, [FIRST] = 6, [OTHER] = 6};

struct order {
    struct plant *p;
    unsigned left[END];
    unsigned char step[ROWS];
    size_t n;
    uint64_t orders, taken;
};

static void settle(struct plant *p)
{
    for (enum who who = FIRST; who < END; who++)
        if (p->station[who].pending)
            writes(p, who);
    promote(p, FIRST);
    put(p, APC_SETPOINT, 1, p->station[FIRST].core->u[0] > 0 ? -1 : 1);
    for (int i = 0; i < 3; i++) {
        ticks(p, OTHER);
        ticks(p, FIRST);
    }
    assert_int_equal(p->last, FIRST);
    assert_int_equal(state_of(p, OTHER), APC_LOOP_SHADOW);
}

/* Appends are refused to one who has no claim, and so is a seq that is there: every row counts once. */
static void play(struct order *o)
{
    struct plant *p = o->p;
    unsigned operated = 0;

    if (o->orders % 1000 == 999) { /* what was written long ago is not needed */
        end(p);
        begin(p, "orders", 2.0);
    }
    settle(p);
    p->changes = 0;
    for (size_t i = 0; i < o->n; i++) {
        const enum who who = (enum who)o->step[i];

        if (who == OPERATOR)
            promote(p, operated++ ? FIRST : OTHER);
        else if (p->station[who].pending)
            writes(p, who);
        else
            reads(p, who);
        if (acts(&p->station[FIRST]) && acts(&p->station[OTHER]))
            fail_msg("both act");
        if (p->station[FIRST].claimed && p->station[OTHER].claimed)
            fail_msg("both hold the output");
    }
    if (p->changes > 2)
        fail_msg("they take it from each other %u times", p->changes);
    o->taken += p->changes > 0;
    o->orders++;
}

static void try_orders(struct order *o)
{
    bool any = false;

    for (unsigned who = OPERATOR; who < END; who++) {
        if (!o->left[who])
            continue;
        any = true;
        o->left[who]--;
        o->step[o->n++] = (unsigned char)who;
        try_orders(o);
        o->n--;
        o->left[who]++;
    }
    if (!any)
        play(o);
}

static void test_in_every_order_one_acts(void **state)
{
    struct plant p;
    struct order o = {.p = &p};

    (void)state;
    begin(&p, "orders", 2.0);
    memcpy(o.left, steps_of, sizeof(o.left));
    try_orders(&o);
    assert_int_equal(o.orders, 84084);
    assert_true(o.taken > 1000);
    end(&p);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_a_shadow_writes_nothing_that_is_another_ones),
        cmocka_unit_test(test_what_it_would_do_is_what_the_same_law_does),
        cmocka_unit_test(test_a_promotion_is_no_bump),
        cmocka_unit_test(test_promoted_in_man_the_output_stays),
        cmocka_unit_test(test_without_input_a_shadow_says_nothing),
        cmocka_unit_test(test_a_shadow_does_not_take_over_by_itself),
        cmocka_unit_test(test_a_restart_is_no_promotion),
        cmocka_unit_test(test_what_became_of_a_setpoint_is_told_on),
        cmocka_unit_test(test_named_is_only_who_is_named),
        cmocka_unit_test(test_in_every_order_one_acts),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}

/* SPDX-License-Identifier: BSD-3-Clause */
/* All alarms of a plant: rows and their order, what people want, masks, restarts. */
#include "check.h"

#include "apcalarm.h"

#include <stdio.h>
#include <string.h>

#define S    APC_NS_PER_S
#define T0   INT64_C(1700000000) /* s */
#define N    3
#define TICK 9

enum { Y1 = 1, Y2 = 2, PUMP = 5 };

/* Y2's alarm is suppressed by that of y1, that of y1's neighbour while the pump stands; the last one latches. */
static const struct apc_alarm plant[N] = {
    {.name = "y1.high", .kind = APC_ALARM_HIGH, .table = APC_SENSOR, .id = Y1, .limit = 1, .priority = 1},
    {.name = "y2.low",
     .kind = APC_ALARM_LOW,
     .table = APC_SENSOR,
     .id = Y2,
     .limit = 0,
     .priority = 2,
     .suppression = {.table = APC_ACTUATOR, .id = PUMP, .below = 1, .above = HUGE_VAL, .hold = 2 * S}},
    {.name = "y2.high",
     .kind = APC_ALARM_HIGH,
     .table = APC_SENSOR,
     .id = Y2,
     .limit = 1,
     .priority = 3,
     .latching = true,
     .suppression = {.alarm = 1, .below = -HUGE_VAL, .above = HUGE_VAL}},
};

/* A store: the newest row of each variable that is read or written, found by its place among them. */
#define ROOM 128
struct world {
    struct apc_alarms *alarms;
    struct apc_sample row[ROOM];
    size_t n;
    int64_t ticks;
    double told[APC_ALARMS_TICK]; /* by the newest tick row */
    apc_ns mono;
    struct apc_notice notice;
    /* the journal */
    struct apc_sample journal[100];
    size_t n_journal;
};

static struct apc_sample *at(struct world *w, enum apc_table table, int id)
{
    for (size_t i = 0; i < w->n; i++)
        if (w->row[i].table == table && w->row[i].id == id)
            return &w->row[i];
    assert_true(w->n < ROOM);
    w->row[w->n] = (struct apc_sample){.table = table, .id = id, .status = APC_BAD_NO_DATA};
    return &w->row[w->n++];
}

static void put(struct world *w, enum apc_table table, int id, double value)
{
    struct apc_sample *row = at(w, table, id);
    row->seq++;
    row->value = value;
    row->status = APC_GOOD;
    row->time = T0 * S + w->mono;
}

static void read_rows(struct world *w, struct apc_rows *rows)
{
    for (size_t i = 0; i < rows->n_samples; i++)
        rows->sample[i] = *at(w, rows->sample[i].table, rows->sample[i].id);
    for (size_t i = 0; i < rows->n_vectors; i++) {
        rows->vector[i].seq = w->ticks;
        if (rows->vector[i].id != TICK || w->ticks == 0)
            continue;
        rows->vector[i].n = APC_ALARMS_TICK;
        memcpy(rows->vector[i].value, w->told, sizeof w->told);
    }
}

static void start(struct world *w)
{
    const struct apc_alarms_options options = {
        .size = sizeof options, .n = N, .alarm = plant, .number = TICK};
    struct apc_error why = {""};
    if (apc_alarms_create(&w->alarms, &options, &why) < 0)
        fail_msg("%s", why.text);
    read_rows(w, apc_alarms_former(w->alarms));
    apc_alarms_resume(w->alarms);
}

/* Each row is the successor of the one before it, the journal counts on, and each transition is one. */
static void take(struct world *w)
{
    const struct apc_rows *out = apc_alarms_out(w->alarms);
    for (size_t i = 0; i < out->n_samples; i++) {
        struct apc_sample *row = at(w, out->sample[i].table, out->sample[i].id);
        assert_int_equal(out->sample[i].seq, row->seq + 1);
        if (out->sample[i].table == APC_ALARM) {
            const int before = row->seq > 0 ? (int)row->value : APC_ALARM_NORMAL,
                      to = (int)out->sample[i].value;
            bool is = false;
            for (int event = 1; event < APC_ALARM_EVENTS; event++)
                is |= apc_alarm_next((enum apc_alarm_state)before, (enum apc_alarm_event)event,
                                     plant[row->id - 1].latching) == (enum apc_alarm_state)to;
            assert_true(is && before != to);
            struct apc_sample *last = at(w, APC_DIM, 0); /* the journal's number */
            assert_int_equal(out->sample[i].origin, ++last->seq);
            if (w->n_journal < sizeof w->journal / sizeof *w->journal)
                w->journal[w->n_journal++] = out->sample[i];
        }
        *row = out->sample[i];
    }
    assert_int_equal(out->n_vectors, 1);
    assert_int_equal(out->vector[0].seq, ++w->ticks);
    memcpy(w->told, out->vector[0].value, sizeof w->told);
}

static void compute(struct world *w)
{
    w->mono += S;
    read_rows(w, apc_alarms_in(w->alarms));
    apc_alarms_compute(w->alarms, (struct apc_now){.mono = w->mono, .utc = T0 * S + w->mono}, &w->notice);
}

static void tick(struct world *w)
{
    compute(w);
    take(w);
    apc_alarms_stored(w->alarms);
}

static int state_of(struct world *w, int alarm)
{
    const struct apc_sample *row = at(w, APC_ALARM, alarm);
    return row->seq > 0 ? (int)row->value : APC_ALARM_NORMAL;
}

/* The state that the transition number @p n, from 1, of an alarm led to; 0: there were less. */
static int nth(const struct world *w, int alarm, int n)
{
    for (size_t i = 0; i < w->n_journal; i++)
        if (w->journal[i].id == alarm && --n == 0)
            return (int)w->journal[i].value;
    return 0;
}

static void want(struct world *w, enum apc_alarm_switch which, int alarm, double value)
{
    put(w, APC_OPMODE, apc_alarm_switch_id(which, alarm), value);
    at(w, APC_OPMODE, apc_alarm_switch_id(which, alarm))->author = 7;
}

static const struct apc_sample *became(struct world *w, enum apc_alarm_switch which, int alarm)
{
    return at(w, APC_ACTUAL, apc_variable_number(APC_OPMODE, apc_alarm_switch_id(which, alarm)));
}

static void acknowledge(struct world *w, int alarm)
{
    want(w, APC_ALARM_ACK, alarm, (double)at(w, APC_ALARM, alarm)->seq);
}

/* A plant that runs, without an alarm. */
static void begin(struct world *w)
{
    memset(w, 0, sizeof *w);
    put(w, APC_SENSOR, Y1, 0.5);
    put(w, APC_SENSOR, Y2, 0.5);
    put(w, APC_ACTUATOR, PUMP, 5);
    start(w);
    tick(w);
    assert_int_equal(w->n_journal, 0);
}

static void end(struct world *w)
{
    apc_alarms_destroy(w->alarms);
}

static const double *told(const struct world *w)
{
    return apc_alarms_out(w->alarms)->vector->value;
}

/* ---- One after the other ------------------------------------------------------------------- */

static void an_alarm_is_acknowledged_by_name_and_returns(void **state)
{
    struct world w;
    (void)state;
    begin(&w);
    put(&w, APC_SENSOR, Y1, 2);
    tick(&w);
    assert_int_equal(state_of(&w, 1), APC_ALARM_UNACKED);
    assert_int_equal((int)told(&w)[APC_ALARMS_UNACKED], 1);
    assert_int_equal((int)told(&w)[APC_ALARMS_STANDING], 1);
    acknowledge(&w, 1);
    tick(&w);
    assert_int_equal(state_of(&w, 1), APC_ALARM_ACKED);
    assert_int_equal(at(&w, APC_ALARM, 1)->author, 7);
    assert_int_equal(became(&w, APC_ALARM_ACK, 1)->status, APC_GOOD);
    assert_int_equal(became(&w, APC_ALARM_ACK, 1)->origin, 1);
    acknowledge(&w, 1); /* somebody else, too late */
    tick(&w);
    assert_int_equal(apc_status_severity(became(&w, APC_ALARM_ACK, 1)->status), APC_SEVERITY_BAD);
    assert_int_equal(w.notice.kind, APC_NOTICE_REJECTED);
    assert_has(w.notice.text, "y1.high: not acknowledged: there is nothing to acknowledge any more");
    put(&w, APC_SENSOR, Y1, 0);
    tick(&w);
    assert_int_equal(state_of(&w, 1), APC_ALARM_NORMAL);
    assert_int_equal(nth(&w, 1, 3), APC_ALARM_NORMAL);
    assert_int_equal(nth(&w, 1, 4), 0);
    end(&w);
}

static void the_journal_counts_on_when_the_alarm_with_its_newest_number_is_gone(void **state)
{
    struct world w;
    (void)state;
    begin(&w);
    put(&w, APC_SENSOR, Y1, 2);
    tick(&w);
    acknowledge(&w, 1);
    tick(&w);
    const int64_t newest = at(&w, APC_ALARM, 1)->origin;
    *at(&w, APC_ALARM, 1) = (struct apc_sample){.table = APC_ALARM, .id = 1};
    apc_alarms_destroy(w.alarms);
    start(&w);
    tick(&w);
    assert_int_equal(at(&w, APC_ALARM, 1)->origin, newest + 1);
    end(&w);
}

static void who_saw_what_was_there_before_acknowledges_nothing(void **state)
{
    struct world w;
    (void)state;
    begin(&w);
    put(&w, APC_SENSOR, Y1, 2);
    tick(&w);
    acknowledge(&w, 1);
    put(&w, APC_SENSOR, Y1, 0);
    tick(&w);
    put(&w, APC_SENSOR, Y1, 2);
    tick(&w); /* a new one, with row 4 */
    assert_int_equal(state_of(&w, 1), APC_ALARM_UNACKED);
    want(&w, APC_ALARM_ACK, 1, 1);
    tick(&w);
    assert_int_equal(state_of(&w, 1), APC_ALARM_UNACKED);
    assert_has(w.notice.text, "look again");
    want(&w, APC_ALARM_ACK, 1, 99);
    tick(&w);
    assert_has(w.notice.text, "not there");
    put(&w, APC_SENSOR, Y1, 0);
    tick(&w); /* what he saw was active, and is the same occurrence */
    want(&w, APC_ALARM_ACK, 1, 4);
    tick(&w);
    assert_int_equal(state_of(&w, 1), APC_ALARM_NORMAL);
    end(&w);
}

static void an_acknowledgement_counts_before_what_comes_at_the_same_tick(void **state)
{
    struct world w;
    (void)state;
    begin(&w);
    put(&w, APC_SENSOR, Y1, 2);
    tick(&w);
    put(&w, APC_SENSOR, Y1, 0);
    tick(&w);
    acknowledge(&w, 1);
    put(&w, APC_SENSOR, Y1, 2);
    tick(&w);
    assert_int_equal(state_of(&w, 1), APC_ALARM_UNACKED);
    assert_int_equal(nth(&w, 1, 3), APC_ALARM_NORMAL);
    end(&w);
}

static void one_that_latches_stays_until_it_is_reset(void **state)
{
    struct world w;
    (void)state;
    begin(&w);
    put(&w, APC_SENSOR, Y2, 2);
    tick(&w);
    put(&w, APC_SENSOR, Y2, 0.5);
    tick(&w);
    assert_int_equal(state_of(&w, 3), APC_ALARM_LATCHED_UNACKED);
    acknowledge(&w, 3);
    tick(&w);
    assert_int_equal(state_of(&w, 3), APC_ALARM_LATCHED);
    want(&w, APC_ALARM_ACK, 3, 2); /* a second one who saw it unacknowledged resets nothing */
    tick(&w);
    assert_int_equal(state_of(&w, 3), APC_ALARM_LATCHED);
    acknowledge(&w, 3);
    tick(&w);
    assert_int_equal(state_of(&w, 3), APC_ALARM_NORMAL);
    end(&w);
}

static void shelving_ends_by_itself_and_announces_what_is_still_there(void **state)
{
    struct world w;
    (void)state;
    begin(&w);
    put(&w, APC_SENSOR, Y1, 2);
    tick(&w);
    want(&w, APC_ALARM_SHELF, 1, (double)T0 + 5);
    tick(&w);
    assert_int_equal(state_of(&w, 1), APC_ALARM_SHELVED_ACTIVE);
    assert_int_equal(at(&w, APC_ALARM, 1)->author, 7);
    assert_int_equal((int)told(&w)[APC_ALARMS_SHELVED], 1);
    assert_int_equal((int)told(&w)[APC_ALARMS_STANDING], 0);
    put(&w, APC_SENSOR, Y1, 0);
    tick(&w);
    put(&w, APC_SENSOR, Y1, 2);
    assert_int_equal(state_of(&w, 1), APC_ALARM_SHELVED);
    acknowledge(&w, 1);
    tick(&w); /* at 5 s */
    assert_has(w.notice.text, "it is shelved");
    assert_int_equal(state_of(&w, 1), APC_ALARM_UNACKED);
    assert_near(became(&w, APC_ALARM_SHELF, 1)->value, 0, 0);
    assert_int_equal(became(&w, APC_ALARM_SHELF, 1)->origin, 1);
    end(&w);
}

static void shelving_has_an_end_that_is_near(void **state)
{
    static const double wrong[] = {T0 - 1, T0 + 9 * 3600, 1, 1e300, -1, -1e300};
    struct world w;
    (void)state;
    begin(&w);
    for (size_t i = 0; i < sizeof wrong / sizeof *wrong; i++) {
        want(&w, APC_ALARM_SHELF, 1, wrong[i]);
        tick(&w);
        assert_int_equal(state_of(&w, 1), APC_ALARM_NORMAL);
        assert_int_equal(apc_status_severity(became(&w, APC_ALARM_SHELF, 1)->status), APC_SEVERITY_BAD);
        assert_has(w.notice.text, "y1.high: not shelved: its end is");
    }
    want(&w, APC_ALARM_SHELF, 1, (double)T0 + 8 * 3600);
    tick(&w);
    assert_int_equal(state_of(&w, 1), APC_ALARM_SHELVED);
    want(&w, APC_ALARM_SHELF, 1, 0);
    tick(&w);
    assert_int_equal(state_of(&w, 1), APC_ALARM_NORMAL);
    end(&w);
}

static void one_shot_lasts_until_it_has_come_and_gone(void **state)
{
    struct world w;
    (void)state;
    begin(&w);
    want(&w, APC_ALARM_SHELF, 1, -(double)(T0 + 3600));
    tick(&w);
    assert_int_equal(state_of(&w, 1), APC_ALARM_ONE_SHOT);
    put(&w, APC_SENSOR, Y1, 2);
    tick(&w);
    assert_int_equal(state_of(&w, 1), APC_ALARM_ONE_SHOT_ACTIVE);
    end(&w);
    start(&w); /* a restart keeps it */
    tick(&w);
    put(&w, APC_SENSOR, Y1, 0);
    tick(&w);
    assert_int_equal(state_of(&w, 1), APC_ALARM_NORMAL);
    assert_near(became(&w, APC_ALARM_SHELF, 1)->value, 0, 0);
    end(&w);
    start(&w); /* and another one does not bring it back */
    put(&w, APC_SENSOR, Y1, 2);
    tick(&w);
    assert_int_equal(state_of(&w, 1), APC_ALARM_UNACKED);
    end(&w);
}

static void what_is_suppressed_by_design_is_announced_only_if_it_is_still_there(void **state)
{
    struct world w;
    (void)state;
    begin(&w);
    put(&w, APC_ACTUATOR, PUMP, 0);
    put(&w, APC_SENSOR, Y2, -1);
    tick(&w);
    assert_int_equal(state_of(&w, 2), APC_ALARM_SUPPRESSED_ACTIVE);
    assert_int_equal(nth(&w, 2, 1), APC_ALARM_SUPPRESSED); /* never unacknowledged */
    assert_int_equal((int)told(&w)[APC_ALARMS_SUPPRESSED], 1);
    put(&w, APC_ACTUATOR, PUMP, 5);
    tick(&w);
    assert_int_equal(state_of(&w, 2), APC_ALARM_SUPPRESSED_ACTIVE); /* for 2 s more */
    put(&w, APC_SENSOR, Y2, 0.5);
    tick(&w);
    assert_int_equal(state_of(&w, 2), APC_ALARM_NORMAL);
    put(&w, APC_SENSOR, Y1, 2); /* the cause */
    put(&w, APC_SENSOR, Y2, 2); /* what follows from it */
    tick(&w);
    assert_int_equal(state_of(&w, 1), APC_ALARM_UNACKED);
    assert_int_equal(state_of(&w, 3), APC_ALARM_SUPPRESSED_ACTIVE);
    put(&w, APC_SENSOR, Y1, 0);
    tick(&w);
    assert_int_equal(state_of(&w, 3), APC_ALARM_UNACKED);
    end(&w);
}

static void the_strongest_mask_holds_and_the_others_wait(void **state)
{
    struct world w;
    (void)state;
    begin(&w);
    want(&w, APC_ALARM_SHELF, 2, (double)T0 + 3600);
    put(&w, APC_ACTUATOR, PUMP, 0);
    tick(&w);
    assert_int_equal(state_of(&w, 2), APC_ALARM_SUPPRESSED);
    want(&w, APC_ALARM_SERVICE, 2, 1);
    tick(&w);
    assert_int_equal(state_of(&w, 2), APC_ALARM_OUT_OF_SERVICE);
    for (int i = 0; i < 2; i++) {
        want(&w, APC_ALARM_SERVICE, 2, i ? 1 + 1e-9 : -1e-9);
        tick(&w);
        assert_has(w.notice.text, "y2.low: service not changed: it is neither 0 nor 1");
    }
    want(&w, APC_ALARM_SERVICE, 2, 0);
    at(&w, APC_OPMODE, apc_alarm_switch_id(APC_ALARM_SERVICE, 2))->status = APC_BAD;
    tick(&w);
    assert_has(w.notice.text, "y2.low: service not changed: its status is Bad");
    assert_near(became(&w, APC_ALARM_SERVICE, 2)->value, 1, 0);
    assert_int_equal((int)told(&w)[APC_ALARMS_OUT_OF_SERVICE], 1);
    put(&w, APC_ACTUATOR, PUMP, 5);
    w.mono += 5 * S;
    want(&w, APC_ALARM_SERVICE, 2, 0);
    tick(&w);
    assert_int_equal(state_of(&w, 2), APC_ALARM_SHELVED);
    assert_int_equal(w.n_journal, 3);
    end(&w);
}

static void of_two_requests_that_are_refused_each_is_told(void **state)
{
    struct world w;
    (void)state;
    begin(&w);
    want(&w, APC_ALARM_ACK, 1, 0);
    want(&w, APC_ALARM_ACK, 2, 0);
    tick(&w);
    assert_has(w.notice.text, "y1.high");
    tick(&w);
    assert_has(w.notice.text, "y2.low");
    tick(&w);
    assert_int_equal(w.notice.kind, APC_NOTICE_NONE);
    end(&w);
}

static void what_was_not_stored_is_stored_before_anything_else_is_judged(void **state)
{
    struct world w;
    (void)state;
    begin(&w);
    put(&w, APC_SENSOR, Y1, 2);
    compute(&w);
    assert_true(apc_alarms_pending(w.alarms));
    put(&w, APC_SENSOR, Y1, 0);
    compute(&w);
    take(&w);
    assert_int_equal(state_of(&w, 1), APC_ALARM_UNACKED);
    apc_alarms_stored(w.alarms);
    assert_false(apc_alarms_pending(w.alarms));
    tick(&w);
    assert_int_equal(state_of(&w, 1), APC_ALARM_RETURNED);
    end(&w);
}

/* ---- At random ----------------------------------------------------------------------------- */

static uint32_t random_state = 12345;
static unsigned draw(unsigned below)
{
    random_state = random_state * 1664525u + 1013904223u;
    return (random_state >> 8) % below;
}

static void anything(struct world *w)
{
    const int alarm = 1 + (int)draw(N);
    switch (draw(8)) {
    case 0:
        acknowledge(w, alarm);
        break;
    case 1:
        want(w, APC_ALARM_ACK, alarm, (double)draw(6));
        break;
    case 2:
        want(w, APC_ALARM_SHELF, alarm,
             (draw(2) ? 1.0 : -1.0) * (double)(T0 + w->mono / S + (int)draw(6)) * (draw(3) > 0));
        break;
    case 3:
        want(w, APC_ALARM_SERVICE, alarm, draw(3) == 0);
        break;
    case 4:
        put(w, APC_ACTUATOR, PUMP, draw(2) ? 5 : 0);
        break;
    default:
        put(w, APC_SENSOR, draw(2) ? Y1 : Y2, (double)draw(5) - 1.5);
    }
}

/* What holds after every tick, whatever went before. */
static void check_all(struct world *w)
{
    const bool active[N] = {at(w, APC_SENSOR, Y1)->value > 1,
                            at(w, APC_SENSOR, Y2)->value<0, at(w, APC_SENSOR, Y2)->value> 1};
    double standing = 0, unacked = 0, masked = 0;
    for (int i = 1; i <= N; i++) {
        const enum apc_alarm_state s = (enum apc_alarm_state)state_of(w, i);
        const bool out =
            became(w, APC_ALARM_SERVICE, i)->seq > 0 && became(w, APC_ALARM_SERVICE, i)->value > 0;
        assert_int_equal(apc_alarm_is_active(s), active[i - 1]);
        assert_int_equal(s >= APC_ALARM_OUT_OF_SERVICE, out);
        assert_true(plant[i - 1].latching || !apc_alarm_is_latched(s));
        if (i == 3 && active[0])
            assert_true(apc_alarm_is_masked(s));
        if (s >= APC_ALARM_SHELVED && s < APC_ALARM_SUPPRESSED)
            assert_true(fabs(became(w, APC_ALARM_SHELF, i)->value) > (double)(T0 + w->mono / S));
        standing += apc_alarm_is_standing(s);
        unacked += apc_alarm_is_unacked(s);
        masked += apc_alarm_is_masked(s);
    }
    const double *n = told(w);
    assert_near(n[APC_ALARMS_UNACKED], unacked, 0);
    assert_near(n[APC_ALARMS_STANDING] + n[APC_ALARMS_STANDING + 1] + n[APC_ALARMS_STANDING + 2], standing,
                0);
    assert_near(n[APC_ALARMS_SHELVED] + n[APC_ALARMS_SUPPRESSED] + n[APC_ALARMS_OUT_OF_SERVICE], masked, 0);
    assert_near(n[APC_ALARMS_JOURNAL], (double)at(w, APC_DIM, 0)->seq, 0);
}

/* Every request has an answer once nothing new comes: refused ones are told one a tick. */
static void check_answers(struct world *w)
{
    for (int i = 0; i < 3 * N; i++)
        tick(w);
    for (int i = 1; i <= N; i++)
        for (int which = APC_ALARM_ACK; which <= APC_ALARM_SERVICE; which++)
            assert_int_equal(became(w, (enum apc_alarm_switch)which, i)->origin,
                             at(w, APC_OPMODE, apc_alarm_switch_id((enum apc_alarm_switch)which, i))->seq);
}

/* Promise(alarms/alarm-state-isa) */
static void whatever_happens_the_journal_tells_it_whole_and_in_order(void **state)
{
    struct world w;
    (void)state;
    for (int sequence = 0; sequence < 100000; sequence++) {
        const bool restarts = draw(4) == 0;
        begin(&w);
        for (unsigned i = 4 + draw(8); i > 0; i--) {
            anything(&w);
            if (draw(2))
                continue;
            compute(&w);
            for (unsigned k = draw(3); k > 0; k--) { /* an append that fails, while things go on */
                anything(&w);
                compute(&w);
            }
            take(&w);
            apc_alarms_stored(w.alarms);
            if (restarts && draw(3) == 0) {
                end(&w);
                start(&w);
            }
        }
        tick(&w);
        check_all(&w);
        check_answers(&w);
        check_all(&w);
        end(&w);
    }
}

int main(void)
{
#define EACH(name) cmocka_unit_test(name)
    const struct CMUnitTest tests[] = {
        EACH(an_alarm_is_acknowledged_by_name_and_returns),
        EACH(the_journal_counts_on_when_the_alarm_with_its_newest_number_is_gone),
        EACH(who_saw_what_was_there_before_acknowledges_nothing),
        EACH(an_acknowledgement_counts_before_what_comes_at_the_same_tick),
        EACH(one_that_latches_stays_until_it_is_reset),
        EACH(shelving_ends_by_itself_and_announces_what_is_still_there),
        EACH(shelving_has_an_end_that_is_near),
        EACH(one_shot_lasts_until_it_has_come_and_gone),
        EACH(what_is_suppressed_by_design_is_announced_only_if_it_is_still_there),
        EACH(the_strongest_mask_holds_and_the_others_wait),
        EACH(of_two_requests_that_are_refused_each_is_told),
        EACH(what_was_not_stored_is_stored_before_anything_else_is_judged),
        EACH(whatever_happens_the_journal_tells_it_whole_and_in_order),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}

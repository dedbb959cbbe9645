/* SPDX-License-Identifier: BSD-3-Clause */
/*
 * Two controllers, one above the other, over one store: what test_modules_loop_cascade.c asks of the rules,
 * asked of the controllers themselves. All time is virtual. A tick is two steps, for others to come between:
 * the controller reads and computes; its rows are appended, or lost, or there without an answer.
 */
#include "check.h"

#include "apcshareddata.h"
#include "modules/controller.h"

#include <stdio.h>
#include <string.h>

#define T0      (INT64_C(1700000000) * APC_NS_PER_S)
#define BASE    (500 * APC_NS_PER_MS)
#define TOP     (2000 * APC_NS_PER_MS)
#define LOSS(p) (3 * (p) + 100 * APC_NS_PER_MS)
#define SLOTS   8 /* of a period of the controller below */
#define NOTES   32

enum who { LOWER, UPPER }; /* in this order: ids of target modes, tick rows, measurements */
enum { R = 1, W = 2 };     /* setpoints: of the loop below, of the one above */
enum fate { WRITTEN, LOST, UNANSWERED, LOST_UNANSWERED, FATES };

struct station {
    struct apc_controller *core;
    struct apc_law law;
    apc_ns period;
    enum fate fate;
    bool pending;
    unsigned append; /* slots until then */
    uint64_t ticks;
    /* Before the tick under way. */
    enum apc_loop_state before;
    double u, z, e;
    bool there, other; /* u is another's than its own */
    double y;          /* what its sensor shows; NaN: Bad */
};

struct note {
    apc_ns at;
    enum who who;
    const char *what;
    int state;
    double u, z, r, actual;
    int64_t seq, origin;
    unsigned status;
    int target;
};

struct plant {
    struct apc_store *store;
    struct station station[2];
    apc_ns now;
    double flow, level, sign;
    unsigned slot;
    uint64_t wrote, seen,
        taken_up; /* writes of the operator; of those, in the lower tick under way, written */
    apc_ns spoke; /* when the controller above last wrote */
    uint64_t entered, shed, taken, restarts;
    const char *broken;
    struct note notes[NOTES];
    size_t n_notes;
};

/* ---- A law with moods -------------------------------------------------------------------------- */

static enum apc_law_result mood[2];

static int compute(struct apc_law_call *c)
{
    const int result = apc_law_pi.compute(c);

    return result == APC_LAW_GOOD ? (int)mood[c->Ts > 1.0 ? UPPER : LOWER] : result;
}

/* ---- The store ---------------------------------------------------------------------------- */

static struct apc_sample newest(const struct plant *p, enum apc_table table, int id)
{
    struct apc_sample s = {.table = table, .id = id};
    struct apc_rows rows = {.size = sizeof(rows), .sample = &s, .n_samples = 1};

    assert_int_equal(apc_store_read_rows(p->store, &rows), 0);
    return s;
}

/* As an operator, or as one who has no rival; @p known as in apc_store_append_rows(). Returns whether it is
 * there. */
static bool write_row(const struct plant *p, enum apc_table table, int id, int64_t known, double value,
                      apc_status status)
{
    struct apc_sample s = {.table = table,
                           .id = id,
                           .seq = table == APC_SENSOR ? newest(p, table, id).seq + 1 : known,
                           .time = T0 + p->now,
                           .value = value,
                           .status = status};
    struct apc_rows rows = {.size = sizeof(rows), .sample = &s, .n_samples = 1};

    if (apc_store_append_rows(p->store, &rows) < 0)
        fail_msg("%s", apc_store_error(p->store));
    return s.seq > 0;
}

static struct apc_sample actual_of(const struct plant *p, enum apc_table table, int id)
{
    return newest(p, APC_ACTUAL, apc_variable_number(table, id));
}

static enum apc_mode target(const struct plant *p, enum who who)
{
    return (enum apc_mode)(int)newest(p, APC_OPMODE, (int)who + 1).value;
}

/* ---- What must hold ------------------------------------------------------------------------- */

static void note(struct plant *p, enum who who, const char *what)
{
    const struct station *s = &p->station[who];
    const struct apc_sample r = newest(p, APC_SETPOINT, R), a = actual_of(p, APC_SETPOINT, R);

    p->notes[p->n_notes++ % NOTES] = (struct note){p->now,
                                                   who,
                                                   what,
                                                   s->core ? (int)s->core->state[0].loop.state : 0,
                                                   s->core ? s->core->u[0] : 0,
                                                   s->core ? s->core->z[0] : 0,
                                                   r.value,
                                                   a.value,
                                                   r.seq,
                                                   r.origin,
                                                   a.status,
                                                   (int)target(p, LOWER)};
}

static void tell(const struct plant *p)
{
    if (!p->broken)
        return;
    for (size_t i = p->n_notes > NOTES ? p->n_notes - NOTES : 0; i < p->n_notes; i++) {
        const struct note *n = &p->notes[i % NOTES];
        print_message(
            "%9.4f %s %-10s state %d u %8.5f z %8.5f | r %lld %8.5f from %lld | actual %8.5f %08x | "
            "target %s\n",
            apc_ns_to_s(n->at), n->who == LOWER ? "lower" : "upper", n->what, n->state, n->u, n->z,
            (long long)n->seq, n->r, (long long)n->origin, n->actual, n->status, apc_mode_name(n->target));
    }
    fail_msg("%s", p->broken);
}

static void must(struct plant *p, bool holds, const char *rule)
{
    if (!holds && !p->broken)
        p->broken = rule;
}

static bool by_law(enum apc_loop_state state)
{
    return state == APC_LOOP_AUTO || state == APC_LOOP_CAS;
}

/* ---- Controllers ---------------------------------------------------------------------------- */

static void make_since(struct plant *p, enum who who, apc_ns since)
{
    const bool upper = who == UPPER;
    const double tuning[] = {upper ? 0.6 : 0.8 * p->sign, upper ? 4.0 : 2.0, 0.0, -1e9, 1e9};
    const int y = (int)who + 1;
    struct apc_law law = apc_law_pi;
    const struct apc_controller_setpoint z = {
        .id = upper ? W : R, .low = -5, .high = 5, .above = upper ? 0 : UPPER + 1, .above_period = TOP};
    const struct apc_controller_loop loop = {.id = y,
                                             .mode = y,
                                             .low = upper ? -5 : -1,
                                             .high = upper ? 5 : 1,
                                             .fault = upper ? 0 : -1,
                                             .setpoint = upper ? R : 0,
                                             .below = upper ? LOWER + 1 : 0,
                                             .below_tick = upper ? LOWER + 1 : 0,
                                             .below_period = BASE};
    const struct apc_controller_options o = {.size = sizeof(o),
                                             .number = y,
                                             .law = &p->station[who].law,
                                             .dim = {1, 1, 1, 0},
                                             .period = upper ? TOP : BASE,
                                             .horizon = LOSS(BASE),
                                             .y = &y,
                                             .z = &z,
                                             .loop = &loop,
                                             .tuning = 100 * y,
                                             .start = tuning};
    struct station *s = &p->station[who];
    struct apc_error why = {""};

    law.compute = compute;
    s->law = law;
    if (apc_controller_create(&s->core, &o, &why) < 0)
        fail_msg("%s", why.text);
    s->period = o.period;
    s->pending = false;
    assert_int_equal(apc_store_read_rows(p->store, apc_controller_former(s->core)), 0);
    if (apc_controller_resume(s->core, T0 + since))
        p->restarts++;
    s->e = (double)NAN;
    note(p, who, "starts");
}

static void make(struct plant *p, enum who who)
{
    make_since(p, who, -APC_NS_PER_S);
}

static void stop(struct plant *p, enum who who)
{
    note(p, who, "killed");
    apc_controller_destroy(p->station[who].core);
    p->station[who].core = NULL;
    p->station[who].pending = false;
}

/* No output moves by more than its law says of what it saw, and not at all where a law takes over. */
static void check_step(struct plant *p, enum who who)
{
    struct station *s = &p->station[who];
    const struct apc_controller_state *l = &s->core->state[0];
    const double *k = s->core->tuning, u = s->core->u[0], e = s->core->z[0] - s->core->y[0];
    const double moved = fabs(u - s->u),
                 own = fabs(k[0] * (e - s->e)) + fabs(k[0] * s->core->Ts / k[1] * s->e);

    must(p, isfinite(u) && (!l->put || (u >= s->core->low[0] && u <= s->core->high[0])),
         "an output within its limits");
    if (!s->there || !l->there)
        return;
    if (l->move.output == APC_PUT_LAST)
        must(p, moved <= 0, "a held output does not move");
    if (l->move.output == APC_PUT_LAW && (s->other || l->move.law & APC_ASK_TRACK_FIRST))
        must(p, moved <= 1e-9, "no step where a law takes over");
    else if (l->move.output == APC_PUT_LAW && isfinite(s->e))
        must(p, moved <= own + 1e-9, "no step larger than the law's own");
}

static void check_setpoint(struct plant *p)
{
    struct station *s = &p->station[LOWER];
    const enum apc_loop_state before = s->before, after = s->core->state[0].loop.state;
    const struct apc_sample *r = &s->core->in.sample[1];

    assert_int_equal(r->table, APC_SETPOINT);
    if (after == APC_LOOP_CAS)
        must(p, r->origin > 0 && p->now - p->spoke <= LOSS(TOP), "in Cas only while the loop above writes");
    if (before != after && by_law(before) && by_law(after) && p->seen == p->taken_up)
        must(p, fabs(s->core->z[0] - s->z) <= 0, "the setpoint stays where it is into Cas and out of it");
    p->entered += before != APC_LOOP_CAS && after == APC_LOOP_CAS;
    p->shed += before == APC_LOOP_CAS && after == APC_LOOP_AUTO && target(p, LOWER) == APC_MODE_CAS;
}

static void reads(struct plant *p, enum who who)
{
    struct station *s = &p->station[who];
    struct apc_rows *in = apc_controller_in(s->core);
    const struct apc_now now = {p->now, T0 + p->now};
    const bool known = s->core->seq > 0;

    assert_int_equal(apc_store_read_rows(p->store, in), 0);
    if (who == LOWER)
        p->seen = p->wrote;
    s->before = s->core->state[0].loop.state;
    s->z = s->core->z[0];
    if (who == UPPER) { /* what is in force counts, whoever put it there */
        const struct apc_sample *r = apc_controller_output(s->core, 0), *a = s->core->below[0].actual;
        const bool good = (a->status & ~APC_GOOD_LIMITED_CONSTANT) == APC_GOOD;
        s->u = good ? r->value : a->value;
        s->there = a->seq > 0;
        s->other = s->core->u[0] < s->u || s->core->u[0] > s->u;
    } else {
        s->u = apc_controller_output(s->core, 0)->value;
        s->there = s->core->state[0].there;
    }
    apc_controller_compute(s->core, now, (uint64_t)(p->now / s->period), true, NULL);
    check_step(p, who);
    if (who == LOWER && known)
        check_setpoint(p);
    p->taken += who == UPPER && s->core->state[0].move.law & APC_ASK_TRACK_FIRST;
    s->pending = true;
    s->ticks++;
    note(p, who, "reads");
}

/* What the loop above writes, it writes to a setpoint that is its own; and its answer is no step. */
static void check_writes(struct plant *p)
{
    const struct apc_controller *c = p->station[UPPER].core;
    const struct apc_sample *out = apc_controller_out(p->station[UPPER].core)->sample;

    if (!c->state[0].put)
        return;
    must(p, out[0].table == APC_SETPOINT && c->below[0].target->value == (double)APC_MODE_CAS,
         "nothing is written to a setpoint that is Local");
    must(p, c->state[0].move.output != APC_PUT_FAULT, "no fault value is written to a setpoint");
    if (c->state[0].move.output == APC_PUT_BELOW)
        must(p,
             out[0].value >= apc_controller_output(c, 0)->value &&
                 out[0].value <= apc_controller_output(c, 0)->value,
             "an answer is no step");
}

static void appends(struct plant *p, enum who who)
{
    struct station *s = &p->station[who];
    const struct apc_rows *out = apc_controller_out(s->core);
    static const int known[] = {[WRITTEN] = 1, [LOST] = 0, [UNANSWERED] = -1, [LOST_UNANSWERED] = -1};
    static const char *const what[] = {"appends", "lost", "unanswered", "vanished"};
    const enum apc_mode wanted = s->core->state[0].target;

    s->pending = false;
    if (who == UPPER)
        check_writes(p);
    for (size_t i = 0; i < out->n_samples; i++)
        must(p, wanted != APC_MODE_OOS || out->sample[i].table == APC_ACTUAL,
             "out of service nothing is written");
    if (s->fate == WRITTEN || s->fate == UNANSWERED)
        if (apc_store_append_rows(p->store, out) < 0)
            fail_msg("%s", apc_store_error(p->store));
    apc_controller_update(s->core, known[s->fate]);
    s->e = s->fate == WRITTEN ? s->core->z[0] - s->core->y[0] : (double)NAN;
    if (s->fate == WRITTEN || s->fate == UNANSWERED) {
        if (who == UPPER)
            p->spoke = p->now;
        else
            p->taken_up = p->seen;
    }
    note(p, who, what[s->fate]);
}

/* ---- The operator, as apc set, apc mode and apc remote ---------------------------------------- */

static void operator_mode(struct plant *p, enum apc_mode mode)
{
    bool done = false;

    while (!done) {
        const struct apc_sample t = newest(p, APC_OPMODE, LOWER + 1), r = newest(p, APC_SETPOINT, R),
                                a = actual_of(p, APC_SETPOINT, R);
        const bool owner = (t.value == (double)APC_MODE_CAS) != (mode == APC_MODE_CAS);

        done = write_row(p, APC_OPMODE, LOWER + 1, t.seq, (double)mode, APC_GOOD) &&
               (!owner || write_row(p, APC_SETPOINT, R, r.seq, r.origin > 0 ? a.value : r.value, APC_GOOD));
    }
    p->wrote++;
    note(p, LOWER, "mode");
}

static void operator_put(struct plant *p, double value)
{
    write_row(p, APC_SETPOINT, R, APC_SEQ_ANY, value, APC_GOOD);
    if (target(p, LOWER) == APC_MODE_CAS)
        write_row(p, APC_OPMODE, LOWER + 1, APC_SEQ_ANY, APC_MODE_AUTO, APC_GOOD);
    p->wrote++;
    note(p, LOWER, "put");
}

/* ---- The plant ------------------------------------------------------------------------------ */

static void begin(struct plant *p, double sign, const char *uri)
{
    *p = (struct plant){.sign = sign, .flow = 0.3, .level = 0.3};
    assert_int_equal(apc_store_open(&p->store, uri, NULL, NULL), 0);
    assert_int_equal(apc_store_init(p->store), 0);
    write_row(p, APC_SETPOINT, R, 0, 0.3, APC_GOOD);
    write_row(p, APC_SETPOINT, W, 0, 0.3, APC_GOOD);
    write_row(p, APC_OPMODE, LOWER + 1, 0, APC_MODE_CAS, APC_GOOD);
    write_row(p, APC_OPMODE, UPPER + 1, 0, APC_MODE_AUTO, APC_GOOD);
    make(p, LOWER);
    make(p, UPPER);
}

static void end(struct plant *p)
{
    for (int who = LOWER; who <= UPPER; who++)
        apc_controller_destroy(p->station[who].core);
    apc_store_close(p->store);
}

static void measure(struct plant *p)
{
    const double y[] = {p->flow, p->level};

    p->flow += 0.4 * (p->sign * newest(p, APC_ACTUATOR, 1).value - p->flow);
    p->level += 0.1 * (p->flow - p->level);
    for (int who = LOWER; who <= UPPER; who++) {
        const bool bad = isnan(p->station[who].y);
        write_row(p, APC_SENSOR, who + 1, 0, bad ? 0 : y[who], bad ? APC_BAD_SENSOR_FAILURE : APC_GOOD);
    }
}

/* One slot of time; @p random NULL: all in time. */
static void step(struct plant *p, struct apc_random *random)
{
    if (p->slot % SLOTS == 0)
        measure(p);
    for (int who = LOWER; who <= UPPER; who++) {
        struct station *s = &p->station[who];
        const unsigned every = who == LOWER ? SLOTS : SLOTS * (unsigned)(TOP / BASE);

        if (s->pending && s->append-- == 0)
            appends(p, (enum who)who);
        if (p->slot % every == (who == LOWER ? 0 : 1) && s->core && !s->pending) {
            reads(p, (enum who)who);
            s->append =
                !random
                    ? 0
                    : (unsigned)(apc_random_next(random) %
                                 (who == UPPER && apc_random_next(random) % 8 == 0 ? every - 2 : SLOTS - 2));
        }
    }
    p->slot++;
    p->now += BASE / SLOTS;
}

static void run(struct plant *p, int periods)
{
    for (int i = 0; i < periods * SLOTS && !p->broken; i++)
        step(p, NULL);
}

/* ---- Chance --------------------------------------------------------------------------------- */

static void trouble(struct plant *p, struct apc_random *random)
{
    static const enum apc_mode modes[] = {APC_MODE_CAS,  APC_MODE_CAS, APC_MODE_CAS,
                                          APC_MODE_AUTO, APC_MODE_MAN, APC_MODE_OOS};
    const enum who who = apc_random_next(random) % 2 ? UPPER : LOWER;
    struct station *s = &p->station[who];

    switch (apc_random_next(random) % 14) {
    case 0:
        s->y = isnan(s->y) ? 0 : (double)NAN;
        break;
    case 1:
        s->y = 0;
        break;
    case 2:
        if (s->core)
            stop(p, who);
        break;
    case 3:
    case 4:
        if (!s->core)
            make(p, who);
        break;
    case 12:
        mood[who] = (enum apc_law_result)(apc_random_next(random) % 5);
        break;
    case 13:
        mood[who] = APC_LAW_GOOD;
        break;
    case 5:
        s->fate = (enum fate)(apc_random_next(random) % FATES);
        break;
    case 6:
    case 7:
        s->fate = WRITTEN;
        break;
    case 8:
        write_row(p, APC_SETPOINT, W, APC_SEQ_ANY, 4 * apc_random_uniform(random) - 2, APC_GOOD);
        break;
    case 9:
        operator_put(p, 2 * apc_random_uniform(random) - 1);
        break;
    case 10:
        operator_mode(p, modes[apc_random_next(random) % 6]);
        break;
    default:
        write_row(p, APC_OPMODE, UPPER + 1, APC_SEQ_ANY, (double)modes[3 + apc_random_next(random) % 3],
                  APC_GOOD);
    }
}

static void heal(struct plant *p)
{
    for (int who = LOWER; who <= UPPER; who++) {
        p->station[who].y = 0;
        p->station[who].fate = WRITTEN;
        mood[who] = APC_LAW_GOOD;
        if (!p->station[who].core)
            make(p, (enum who)who);
    }
}

static void must_be_owned(struct plant *p)
{
    const struct apc_controller *lower = p->station[LOWER].core, *upper = p->station[UPPER].core;
    const struct apc_sample r = newest(p, APC_SETPOINT, R);
    const enum apc_mode wanted = target(p, LOWER);

    if (wanted == APC_MODE_OOS)
        return;
    if (wanted == APC_MODE_CAS && target(p, UPPER) != APC_MODE_OOS) {
        must(p, lower->state[0].loop.state == APC_LOOP_CAS, "all is well, and the loop comes into Cas");
        must(p, r.origin > 0, "in Cas the setpoint is the loop above's");
        must(p, by_law(upper->state[0].loop.state) || upper->state[0].loop.state == APC_LOOP_MAN,
             "all is well, and the loop above acts");
    } else {
        must(p, wanted == APC_MODE_CAS || r.origin == 0, "out of Cas the setpoint is not the loop above's");
        must(p, lower->state[0].loop.state != APC_LOOP_CAS, "Cas without anybody above");
    }
    must(p, r.value >= lower->z[0] && r.value <= lower->z[0], "the setpoint is the one in force");
}

/*
 * Promise(modes/two-controllers): Two controllers over one store give the same as one, through crashes,
 *   rows that are lost and answers that are lost.
 */
static void test_whatever_happens_two_controllers_agree_on_the_setpoint(void **state)
{
    uint64_t entered = 0, shed = 0, taken = 0, ticks = 0, restarts = 0;

    (void)state;
    for (uint64_t seed = 1; seed <= 20; seed++) {
        struct apc_random random;
        struct plant p;

        apc_random_init(&random, seed, "layers");
        begin(&p, seed % 2 ? 1 : -1, "mem:layers");
        for (int episode = 0; episode < 400; episode++) {
            const uint64_t rate = 8u << apc_random_next(&random) % 6;

            if (apc_random_next(&random) % 3 == 0) {
                heal(&p);
                operator_mode(&p, APC_MODE_CAS);
                write_row(&p, APC_OPMODE, UPPER + 1, APC_SEQ_ANY, APC_MODE_AUTO, APC_GOOD);
            }
            for (int i = 0; i < 16 * SLOTS && !p.broken; i++) {
                step(&p, &random);
                if (apc_random_next(&random) % rate == 0)
                    trouble(&p, &random);
            }
            if (apc_random_next(&random) % 8 == 0) {
                heal(&p);
                run(&p, 12 * (int)(TOP / BASE) + 2);
                must_be_owned(&p);
            }
            if (p.broken) {
                print_message("seed %d, episode %d\n", (int)seed, episode);
                tell(&p);
            }
        }
        entered += p.entered;
        shed += p.shed;
        taken += p.taken;
        restarts += p.restarts;
        ticks += p.station[LOWER].ticks + p.station[UPPER].ticks;
        end(&p);
    }
    print_message("%llu ticks: %llu times into Cas, %llu shed, %llu takings over, %llu restarts\n",
                  (unsigned long long)ticks, (unsigned long long)entered, (unsigned long long)shed,
                  (unsigned long long)taken, (unsigned long long)restarts);
    assert_true(entered > 100 && shed > 100 && taken > 100 && restarts > 100);
}

/* ---- Every order ---------------------------------------------------------------------------- */

#define EACH 4 /* steps of a controller: it reads, appends, reads, appends */

enum request { PUT, AUTO, CAS, MAN, REQUESTS };

static void request(struct plant *p, unsigned wanted)
{
    static const enum apc_mode mode[] = {[AUTO] = APC_MODE_AUTO, [CAS] = APC_MODE_CAS, [MAN] = APC_MODE_MAN};

    if (wanted == PUT)
        operator_put(p, p->station[LOWER].core->z[0] > 0 ? -0.25 : 0.25);
    else
        operator_mode(p, mode[wanted]);
}

/* Steps @p left of lower, upper, operator, in every order; @p done are those already chosen. */
static void in_every_order(struct plant *p, const unsigned left[3], char *done, size_t n, unsigned wanted[2],
                           uint64_t *orders)
{
    bool any = false;

    for (unsigned who = 0; who < 3; who++) {
        unsigned rest[3] = {left[0], left[1], left[2]};

        if (!rest[who])
            continue;
        any = true;
        rest[who]--;
        done[n] = (char)who;
        in_every_order(p, rest, done, n + 1, wanted, orders);
    }
    if (any)
        return;
    for (size_t i = 0; i < n; i++) {
        const enum who who = (enum who)done[i];
        size_t nth = 0;

        for (size_t k = 0; k < i; k++)
            nth += done[k] == done[i];
        p->now += BASE / SLOTS;
        if (done[i] == 2)
            request(p, wanted[nth]);
        else
            (nth % 2 == 0 ? reads : appends)(p, who);
    }
    p->slot = 0;
    run(p, 18);
    must_be_owned(p);
    must(p, wanted[1] != PUT || target(p, LOWER) != APC_MODE_AUTO || newest(p, APC_SETPOINT, R).origin == 0,
         "what the operator put last is in force");
    operator_mode(p, APC_MODE_CAS);
    p->slot = 0;
    run(p, 14);
    must(p, p->station[LOWER].core->state[0].loop.state == APC_LOOP_CAS, "back into Cas");
    tell(p);
    ++*orders;
}

/* Promise(modes/two-controllers) */
static void test_in_every_order_two_controllers_leave_the_setpoint_to_its_owner(void **state)
{
    static const unsigned left[3] = {EACH, EACH, 2};
    uint64_t orders = 0;

    (void)state;
    for (unsigned k = 0; k < REQUESTS * REQUESTS; k++) {
        unsigned wanted[2] = {k % REQUESTS, k / REQUESTS};
        char done[2 * EACH + 2];
        struct plant p;

        if (wanted[0] == CAS) /* it is that already */
            continue;
        begin(&p, 1, "mem:orders");
        run(&p, 16);
        in_every_order(&p, left, done, 0, wanted, &orders);
        end(&p);
    }
    print_message("%llu orders\n", (unsigned long long)orders);
}

/* ---- Windup --------------------------------------------------------------------------------- */

/* Promise(modes/two-controllers) */
static void test_above_a_loop_at_its_limit_the_setpoint_stays_in_reach(void **state)
{
    (void)state;
    for (int sign = -1; sign <= 1; sign += 2)
        for (int side = -1; side <= 1; side += 2) {
            struct plant p;
            double r;

            begin(&p, sign, "mem:windup");
            run(&p, 24);
            write_row(&p, APC_SETPOINT, W, APC_SEQ_ANY, side * 1.5, APC_GOOD); /* the level ends at 1 */
            run(&p, 80);
            r = newest(&p, APC_SETPOINT, R).value;
            run(&p, 1200); /* 600 s */
            assert_near(newest(&p, APC_ACTUATOR, 1).value, sign * side, 0.0);
            assert_true(fabs(newest(&p, APC_SETPOINT, R).value) <= fabs(r) + 0.1);
            assert_int_equal(apc_loop_limited(actual_of(&p, APC_SETPOINT, R).status),
                             side > 0 ? APC_LIMITED_HIGH : APC_LIMITED_LOW);
            write_row(&p, APC_SETPOINT, W, APC_SEQ_ANY, 0.0, APC_GOOD);
            run(&p, 32); /* it comes back at once */
            assert_true(fabs(newest(&p, APC_ACTUATOR, 1).value) < 0.99);
            tell(&p);
            end(&p);
        }
}

/* ---- Stories ------------------------------------------------------------------------------ */

static double in_force(const struct plant *p)
{
    return newest(p, APC_SETPOINT, R).value;
}

/* The setpoint in Man: the measurement, within its own limits; the last one where there is none. */
/* Promise(modes/two-controllers) */
static void test_in_man_the_setpoint_is_the_measurement_within_its_limits(void **state)
{
    struct plant p;

    (void)state;
    begin(&p, 1, "mem:man");
    run(&p, 16);
    operator_mode(&p, APC_MODE_MAN);
    p.flow = 3.0;
    run(&p, 4);
    assert_near(in_force(&p), p.station[LOWER].core->y[0], 0.0);
    assert_near(actual_of(&p, APC_SETPOINT, R).value, in_force(&p), 0.0);
    p.flow = 90.0;
    run(&p, 1);
    assert_near(in_force(&p), 5.0, 0.0);
    p.station[LOWER].y = (double)NAN;
    run(&p, 3);
    p.flow = 2.0;
    run(&p, 3);
    assert_near(in_force(&p), 5.0, 0.0);
    tell(&p);
    end(&p);

    begin(&p, 1, "mem:man");
    operator_mode(&p, APC_MODE_MAN);
    p.station[LOWER].y = (double)NAN; /* there never was one */
    run(&p, 3);
    assert_near(in_force(&p), 0.3, 0.0);
    tell(&p);
    end(&p);
}

/* The loop above is at its fault value: it writes nothing, and nobody waits for three of its periods. */
/* Promise(modes/two-controllers) */
static void test_a_loop_leaves_one_above_that_is_at_its_fault_value_at_once(void **state)
{
    struct plant p;

    (void)state;
    begin(&p, 1, "mem:fault");
    run(&p, 16);
    p.station[UPPER].y = (double)NAN;
    while (actual_of(&p, APC_OPMODE, UPPER + 1).value != (double)APC_MODE_LO)
        run(&p, 1);
    run(&p, 1);
    assert_int_equal(p.station[LOWER].core->state[0].loop.state, APC_LOOP_AUTO);
    assert_true(p.now - p.spoke < LOSS(TOP));
    tell(&p);
    end(&p);
}

/* Nobody has looked at the setpoint before, and the newest row is of the one above: it is what there is. */
static void test_the_first_setpoint_is_taken_whoever_wrote_it(void **state)
{
    struct plant p;
    double r;

    (void)state;
    begin(&p, 1, "mem:first");
    run(&p, 17);
    assert_true(newest(&p, APC_SETPOINT, R).origin > 0);
    r = in_force(&p);
    apc_controller_destroy(p.station[LOWER].core);
    p.station[LOWER].core = NULL;
    p.now += 1000 * APC_NS_PER_S; /* of another run */
    make_since(&p, LOWER, p.now);
    assert_near(p.station[LOWER].core->z[0], 0.0, 0.0);
    run(&p, 2);
    assert_near(p.station[LOWER].core->z[0], r, 0.0);
    assert_near(in_force(&p), r, 0.0);
    tell(&p);
    end(&p);
}

/* A row of the loop above that comes late is not put back by a loop that is out of service. */
static void test_out_of_service_nothing_is_put_back(void **state)
{
    struct plant p;
    struct apc_sample r;

    (void)state;
    begin(&p, 1, "mem:oos");
    run(&p, 16);
    write_row(&p, APC_OPMODE, LOWER + 1, APC_SEQ_ANY, APC_MODE_OOS, APC_GOOD); /* and no setpoint with it */
    r = newest(&p, APC_SETPOINT, R);
    assert_true(r.origin > 0);
    run(&p, 12);
    assert_int_equal(newest(&p, APC_SETPOINT, R).seq, r.seq);
    write_row(&p, APC_OPMODE, LOWER + 1, APC_SEQ_ANY, APC_MODE_AUTO, APC_GOOD);
    run(&p, 2);
    assert_int_equal(newest(&p, APC_SETPOINT, R).origin, 0);
    assert_near(in_force(&p), r.value, 0.0);
    tell(&p);
    end(&p);
}

static void assert_told(struct plant *p)
{
    for (int who = LOWER; who <= UPPER; who++)
        assert_near(actual_of(p, APC_OPMODE, who + 1).value, p->station[who].core->state[0].actual, 0.0);
    assert_near(actual_of(p, APC_SETPOINT, R).value, p->station[LOWER].core->z[0], 0.0);
    tell(p);
    end(p);
}

/* A loop is at its fault value for a while, or begins and is left by an operator, and at some tick the rows,
 * or the answer, or both get lost. */
/* Promise(modes/two-controllers) */
static void test_what_is_told_of_a_mode_is_so_whatever_became_of_a_tick(void **state)
{
    const int top = (int)(TOP / BASE);
    struct plant p;

    (void)state;
    for (int which = LOWER; which <= UPPER; which++)
        for (int fate = LOST; fate < FATES; fate++)
            for (int at = 0; at < 12; at++) {
                begin(&p, 1, "mem:told");
                run(&p, 16);
                for (int k = 0; k < 12; k++) {
                    p.station[which].y = k < 6 ? (double)NAN : 0.0;
                    p.station[which].fate = k == at ? (enum fate)fate : WRITTEN;
                    run(&p, which == LOWER ? 1 : top);
                }
                p.station[which].fate = WRITTEN;
                run(&p, 2);
                assert_told(&p);
            }
    for (int fate = LOST; fate < FATES; fate++)
        for (int at = 0; at < 6; at++) {
            begin(&p, 1, "mem:told");
            run(&p, at * top);
            p.station[UPPER].fate = (enum fate)fate;
            run(&p, top);
            p.station[UPPER].fate = WRITTEN;
            operator_put(&p, 0.1);
            run(&p, 3 * top);
            assert_told(&p);
        }
}

/* What went on above meanwhile it has not seen: after a long absence a loop asks anew. */
static void test_a_loop_that_was_away_for_long_asks_before_it_is_in_cas_again(void **state)
{
    (void)state;
    for (int away = 1; away <= 6; away++) {
        const bool for_long = (away + 1) * BASE > LOSS(BASE); /* since its last tick */
        struct plant p;

        begin(&p, 1, "mem:away");
        run(&p, 16);
        stop(&p, LOWER);
        run(&p, away);
        make(&p, LOWER);
        run(&p, 1);
        assert_int_equal(p.station[LOWER].core->state[0].loop.state, for_long ? APC_LOOP_AUTO : APC_LOOP_CAS);
        run(&p, 14);
        assert_int_equal(p.station[LOWER].core->state[0].loop.state, APC_LOOP_CAS);
        tell(&p);
        end(&p);
    }
}

static void test_cas_is_refused_where_nobody_is_above(void **state)
{
    struct plant p;

    (void)state;
    begin(&p, 1, "mem:refused");
    run(&p, 16);
    write_row(&p, APC_OPMODE, UPPER + 1, APC_SEQ_ANY, APC_MODE_CAS, APC_GOOD);
    run(&p, 8);
    assert_int_equal(p.station[UPPER].core->state[0].target, APC_MODE_AUTO);
    assert_int_equal(actual_of(&p, APC_OPMODE, UPPER + 1).status, APC_BAD);
    tell(&p);
    end(&p);
}

/* The store cannot be read: whether the loop below still asks nobody knows. */
static void test_nobody_is_answered_who_cannot_be_heard(void **state)
{
    struct plant p;
    struct apc_controller *c;

    (void)state;
    begin(&p, 1, "mem:deaf");
    run(&p, 1);
    c = p.station[UPPER].core;
    write_row(&p, APC_OPMODE, UPPER + 1, APC_SEQ_ANY, APC_MODE_MAN, APC_GOOD); /* needs no measurement */
    assert_int_equal(apc_store_read_rows(p.store, apc_controller_in(c)), 0);
    apc_controller_compute(c, (struct apc_now){p.now, T0 + p.now}, 1, true, NULL);
    assert_int_equal(c->state[0].move.output, APC_PUT_BELOW);
    apc_controller_update(c, 0);
    apc_controller_compute(c, (struct apc_now){p.now + 1, T0 + p.now + 1}, 2, false, NULL);
    assert_int_equal(c->state[0].move.state, APC_LOOP_INIT);
    assert_int_equal(c->state[0].move.output, APC_PUT_NONE);
    end(&p);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_whatever_happens_two_controllers_agree_on_the_setpoint),
        cmocka_unit_test(test_in_every_order_two_controllers_leave_the_setpoint_to_its_owner),
        cmocka_unit_test(test_above_a_loop_at_its_limit_the_setpoint_stays_in_reach),
        cmocka_unit_test(test_in_man_the_setpoint_is_the_measurement_within_its_limits),
        cmocka_unit_test(test_a_loop_leaves_one_above_that_is_at_its_fault_value_at_once),
        cmocka_unit_test(test_the_first_setpoint_is_taken_whoever_wrote_it),
        cmocka_unit_test(test_out_of_service_nothing_is_put_back),
        cmocka_unit_test(test_what_is_told_of_a_mode_is_so_whatever_became_of_a_tick),
        cmocka_unit_test(test_a_loop_that_was_away_for_long_asks_before_it_is_in_cas_again),
        cmocka_unit_test(test_cas_is_refused_where_nobody_is_above),
        cmocka_unit_test(test_nobody_is_answered_who_cannot_be_heard),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}

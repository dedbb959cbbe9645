/* SPDX-License-Identifier: BSD-3-Clause */
#include "cascade.h"

#include "check.h"

#include <stdio.h>

static double limit(double value, double low, double high)
{
    return value < low ? low : value > high ? high : value;
}

/* What happened last, told when a rule is broken. */
static void note(struct cascade *w, const char *what, enum who who)
{
    static const char *const states[APC_LOOP_END] = {
        [APC_LOOP_OOS] = "Oos",     [APC_LOOP_MAN] = "Man",       [APC_LOOP_AUTO] = "Auto",
        [APC_LOOP_CAS] = "Cas",     [APC_LOOP_INIT] = "Init",     [APC_LOOP_HOLD] = "Hold",
        [APC_LOOP_FAULT] = "Fault", [APC_LOOP_BACKUP] = "Backup", [0] = "none"};
    const struct cascade_side *s = &w->side[who == UPPER];
    struct note *n = &w->notes[w->n_notes++ % NOTES];

    *n = (struct note){w->now,         what,     who,      states[s->now.loop.state],
                       s->move.reason, s->now.u, s->now.z, w->store};
}

void cascade_check(const struct cascade *w)
{
    static const char *const who[] = {"lower", "upper", "operator"};

    if (!w->broken)
        return;
    for (size_t i = w->n_notes > NOTES ? w->n_notes - NOTES : 0; i < w->n_notes; i++) {
        const struct note *n = &w->notes[i % NOTES];
        print_message(
            "%10.4f %-8s %-8s %-6s u %8.5f z %8.5f | r %lld %8.5f by %s from %lld | actual %lld %8.5f "
            "%08x | target %s\n",
            apc_ns_to_s(n->at - START), who[n->who], n->what, n->state, n->u, n->z,
            (long long)n->store.setpoint.seq, n->store.setpoint.value, who[n->store.setpoint.author],
            (long long)n->store.setpoint.origin, (long long)n->store.actual.seq, n->store.actual.value,
            n->store.actual.status, apc_mode_name((int)n->store.target[LOWER]));
    }
    fail_msg("%s", w->broken);
}

/* Every rule that is broken is told once, by the first; the caller says where. */
void cascade_must(struct cascade *w, bool holds, const char *rule)
{
    if (!holds && !w->broken)
        w->broken = rule;
}

/* ---- A controller around the rules --------------------------------------------------------- */

static double compute(const struct law *law, const struct integral *i, double e)
{
    return law->Kp * e + i->x;
}

static void track(const struct law *law, struct integral *i, double out, double e)
{
    *i = (struct integral){.x = out - law->Kp * e, .e = e};
}

/* After what went out: as the README's law, but it does not integrate where the loop below is limited. */
static void integrate(const struct law *law, struct integral *i, double out, double e, unsigned limited)
{
    double step = law->integral * e;

    track(law, i, out, e);
    if (!(step > 0 && limited & APC_LIMITED_HIGH) && !(step < 0 && limited & APC_LIMITED_LOW))
        i->x += step;
}

/* Compute as the move says, and look again where the answer is not usable. */
static void decide(struct cascade_side *s, double really)
{
    struct memory *m = &s->now;
    double trial = 0;

    s->facts.law = true;
    s->move = apc_loop_next(m->loop.state, &s->facts);
    if (s->move.law & APC_ASK_TRACK_FIRST || (s->move.output == APC_PUT_LAW && s->missed))
        track(&s->law, &m->law, really, s->e);
    if (s->move.law & APC_ASK_COMPUTE) {
        trial = compute(&s->law, &m->law, s->e);
        apc_loop_answered(&m->loop, s->answers == GOOD, SHED_AFTER);
        s->facts.law = s->answers <= LATE;
        if (!s->facts.law)
            s->move = apc_loop_next(m->loop.state, &s->facts);
        if (s->answers == FAILED)
            m->law.x = 0;
    }
    if (s->move.backup & APC_ASK_TRACK_FIRST)
        track(&s->backup, &m->backup, really, s->e);
    if (s->move.output == APC_PUT_LAW)
        m->u = trial;
    else if (s->move.output == APC_PUT_BACKUP)
        m->u = compute(&s->backup, &m->backup, s->e);
    else if (s->move.output == APC_PUT_FAULT)
        m->u = s->low;
    else if (s->move.output != APC_PUT_LAST && s->move.output != APC_PUT_OPERATOR)
        m->u = really;
    m->u = limit(m->u, s->low, s->high);
    s->missed = false;
}

static void update(struct cascade_side *s, double out)
{
    struct memory *m = &s->now;

    if (s->move.law & APC_ASK_UPDATE)
        integrate(&s->law, &m->law, out, s->e, s->limited);
    if (s->move.backup & APC_ASK_UPDATE)
        integrate(&s->backup, &m->backup, out, s->e, 0);
    m->out = out;
}

/* No output moves by more than its law says of what it saw, from one tick to the next. */
static void check_step(struct cascade *w, struct cascade_side *s, double really)
{
    const struct law *law = s->move.output == APC_PUT_BACKUP ? &s->backup : &s->law;
    bool entry = (s->move.law | s->move.backup) & APC_ASK_TRACK_FIRST;
    double moved = fabs(s->now.u - really), e = law == &s->law ? s->before.law.e : s->before.backup.e;

    cascade_must(w, isfinite(s->now.u) && s->now.u >= s->low && s->now.u <= s->high,
                 "output within its limits");
    if (s->move.output == APC_PUT_LAST)
        cascade_must(w, moved <= 0, "a held output does not move");
    if (s->move.output != APC_PUT_LAW && s->move.output != APC_PUT_BACKUP)
        return;
    if (entry)
        cascade_must(w, moved <= 1e-9, "no step where a law takes over");
    else
        cascade_must(w, moved <= fabs(law->Kp * (s->e - e)) + fabs(law->integral * e) + 1e-9,
                     "no step larger than the law's own");
}

static void check_integral(struct cascade *w, const struct cascade_side *s)
{
    if (s->facts.input && s->move.output != APC_PUT_LAW && s->move.law & APC_ASK_UPDATE)
        cascade_must(
            w, fabs(s->now.law.x - (s->now.out - s->law.Kp * s->e)) <= fabs(s->law.integral * s->e) + 1e-9,
            "an integral moves while the output does not act");
}

/* What both do before and after: facts of themselves. */
static void begin(struct cascade *w, struct cascade_side *s, enum who who, double y)
{
    s->seen = w->store;
    s->before = s->now;
    if (s->measured)
        s->now.y = y;
    s->facts = (struct apc_loop_inputs){.target = s->seen.target[who],
                                        .acting = true,
                                        .setpoint = who == UPPER,
                                        .taken = true,
                                        .input = s->measured,
                                        .backup = s->has_backup && s->measured};
    s->facts.expired = apc_loop_expired(&s->now.loop, s->measured, w->now, s->hold, SHED_AFTER);
    s->write_setpoint = s->write_actual = false;
    s->pending = true;
    w->ticks++;
}

static bool manual(struct cascade_side *s, double value)
{
    if (s->move.output != APC_PUT_OPERATOR)
        return false;
    if (isfinite(value)) /* else the operator gave none since */
        s->now.u = limit(value, s->low, s->high);
    return true;
}

/* ---- The loop above ------------------------------------------------------------------------ */

static void upper_reads(struct cascade *w)
{
    struct cascade_side *s = &w->side[UPPER];
    struct apc_now now = {w->now, w->now};
    struct apc_loop_below below;

    begin(w, s, UPPER, w->level);
    below = (struct apc_loop_below){.cascade = s->seen.target[LOWER] == APC_MODE_CAS,
                                    .fresh = apc_freshness_dated(&s->of_tick, s->seen.tick[LOWER],
                                                                 s->seen.tick_time[LOWER], now, LOSS(BASE)),
                                    .status = s->seen.actual.seq ? s->seen.actual.status : APC_BAD,
                                    .value = s->seen.actual.value,
                                    .newest = s->seen.setpoint.value};
    s->facts.taken = apc_loop_taken(&below);
    s->facts.invited = apc_loop_invited(&below);
    s->limited = s->facts.taken ? apc_loop_limited(s->seen.actual.status) : 0;
    s->now.z = w->w;
    s->e = s->now.z - s->now.y;
    if (!s->facts.taken)
        s->now.u = s->before.u = limit(s->seen.actual.value, s->low, s->high);
    else if (s->missed)
        s->now.u = s->before.u = s->seen.setpoint.value;
    bool skip = s->missed; /* what went out since is another's: no step of the law's */
    decide(s, s->now.u);
    bool by_hand = manual(s, w->manual[UPPER]);
    if (!by_hand && !skip)
        check_step(w, s, s->before.u);
    s->write_setpoint = s->move.output != APC_PUT_NONE;
    s->setpoint = (struct row){.seq = s->seen.setpoint.seq + 1,
                               .origin = s->seen.actual.seq,
                               .value = s->now.u,
                               .status = s->move.status,
                               .author = UPPER,
                               .time = w->now};
    note(w, "reads", UPPER);
    if (s->move.output == APC_PUT_BELOW)
        cascade_must(w, s->now.u <= s->seen.setpoint.value && s->now.u >= s->seen.setpoint.value,
                     "an answer is no step");
}

/* ---- The loop below ------------------------------------------------------------------------ */

static void lower_takes_setpoint(struct cascade *w, struct cascade_side *s, bool first)
{
    struct apc_now now = {w->now, w->now};
    const struct row *newest = &s->seen.setpoint;
    bool fresh = apc_freshness_dated(&s->of_row, newest->seq, newest->time, now, LOSS(TOP));
    struct apc_loop_above above = {.target = s->seen.target[LOWER],
                                   .theirs = newest->author == UPPER,
                                   .fresh = fresh,
                                   .able = s->seen.mode[UPPER] != APC_MODE_LO &&
                                           s->seen.mode[UPPER] != APC_MODE_OOS,
                                   .origin = newest->origin,
                                   .value = newest->value,
                                   .working = s->now.z};
    bool takes = apc_loop_takes(&s->now.loop, &above), oos = s->seen.target[LOWER] == APC_MODE_OOS;

    s->now.seen = newest->seq;
    s->facts.remote = apc_loop_remote(&s->now.loop, &above);
    if (takes || first)
        s->now.z = newest->value;
    if (s->seen.target[LOWER] == APC_MODE_MAN)
        s->now.z = limit(s->now.y, w->side[UPPER].low, w->side[UPPER].high);
    s->write_setpoint = !oos && (!takes || s->now.z < newest->value || s->now.z > newest->value);
    s->setpoint = (struct row){
        .seq = newest->seq + 1, .value = s->now.z, .status = APC_GOOD, .author = LOWER, .time = w->now};
}

static bool automatic(enum apc_loop_state state)
{
    return state == APC_LOOP_AUTO || state == APC_LOOP_CAS;
}

static void check_handover(struct cascade *w, struct cascade_side *s)
{
    enum apc_loop_state before = s->before.loop.state, after = s->move.state;
    double moved = fabs(s->now.z - s->before.z);

    if (after == APC_LOOP_CAS)
        cascade_must(w, s->seen.setpoint.author == UPPER && w->now - s->seen.setpoint.time <= LOSS(TOP),
                     "in Cas only while the loop above writes");
    if (before == after || !automatic(before) || !automatic(after))
        return;
    if (after == APC_LOOP_CAS)
        cascade_must(w, moved <= 0, "the setpoint stays where it is into Cas");
    else if (s->seen.setpoint.author != OPERATOR)
        cascade_must(w, moved <= 0, "the setpoint stays where it is out of Cas");
    else if (w->put <= s->before.seen)
        cascade_must(w, moved <= w->slack + 1e-9,
                     "a change of mode moves the setpoint by a move of the loop above");
    w->entered += after == APC_LOOP_CAS;
    w->shed += after == APC_LOOP_AUTO && s->seen.target[LOWER] == APC_MODE_CAS;
}

static void lower_reads(struct cascade *w)
{
    struct cascade_side *s = &w->side[LOWER];
    bool first = !s->now.begun;

    begin(w, s, LOWER, w->flow);
    lower_takes_setpoint(w, s, first);
    s->now.begun = true;
    s->e = s->now.z - s->now.y;
    s->limited = 0;
    decide(s, s->now.u);
    bool by_hand = manual(s, w->manual[LOWER]);
    if (!by_hand && s->move.output != APC_PUT_FAULT)
        check_step(w, s, s->before.u);
    check_handover(w, s);
    s->slack = w->slack;
    note(w, "reads", LOWER);
    apc_loop_settle(&s->now.loop, &s->facts, s->move.state, w->now, s->seen.actual.seq + 1);
    bool limited = s->move.output == APC_PUT_LAW && (s->now.u <= s->low || s->now.u >= s->high);
    s->actual = (struct row){
        .seq = s->seen.actual.seq + 1,
        .value = s->now.z,
        .status = apc_loop_status(&s->now.loop, s->facts.target, apc_loop_lacks(limited, s->now.z, s->now.y)),
        .time = w->now};
    s->write_actual = s->actual.status != s->seen.actual.status || s->actual.value < s->seen.actual.value ||
                      s->actual.value > s->seen.actual.value || s->now.loop.asked == s->actual.seq ||
                      w->now - s->seen.actual.time >= TOP;
}

/* ---- Appends ------------------------------------------------------------------------------- */

/* A setpoint is written by swap: only when nobody was faster. */
static bool swap(struct cascade *w, const struct row *row)
{
    if (w->store.setpoint.seq != row->seq - 1)
        return false;
    if (row->author == UPPER && w->store.setpoint.author == UPPER)
        w->store.travel += fabs(row->value - w->store.setpoint.value);
    w->store.setpoint = *row;
    w->store.setpoint.time = w->now;
    return true;
}

void cascade_reads(struct cascade *w, enum who who)
{
    if (who == LOWER)
        lower_reads(w);
    else
        upper_reads(w);
}

void cascade_appends(struct cascade *w, enum who who)
{
    struct cascade_side *s = &w->side[who];
    double out = s->now.u;

    s->pending = false;
    if (s->lost) { /* the database was away: nothing of this tick went out */
        s->now.u = s->before.u;
        s->now.out = s->before.out;
        s->missed = who == UPPER;
        note(w, "lost", who);
        return;
    }
    cascade_must(w, !s->write_setpoint || s->facts.target != APC_MODE_OOS,
                 "out of service nothing is written");
    if (who == UPPER) {
        if (s->write_setpoint && !swap(w, &s->setpoint)) {
            s->missed = true;
            out = s->now.u = s->before.u;
        }
        apc_loop_settle(&s->now.loop, &s->facts, s->move.state, w->now, 0);
        w->taken += s->move.law & APC_ASK_TRACK_FIRST && !s->missed;
    } else {
        if (s->write_setpoint)
            swap(w, &s->setpoint);
        if (s->write_actual) {
            w->store.actual = s->actual;
            w->store.told = s->seen.travel;
        }
        w->slack -= s->slack;
        if (s->move.output != APC_PUT_NONE)
            w->store.out = (struct row){.seq = w->store.out.seq + 1, .value = s->now.u};
    }
    w->store.mode[who] = s->move.actual;
    w->store.tick[who]++;
    w->store.tick_time[who] = w->now;
    update(s, out);
    check_integral(w, s);
    note(w, s->missed ? "missed" : "appends", who);
    s->stored = s->now;
    s->stored_time = w->now;
}

/* ---- Crash and restart --------------------------------------------------------------------- */

void cascade_kill(struct cascade *w, enum who who)
{
    note(w, "killed", who);
    w->side[who].alive = w->side[who].pending = false;
}

void cascade_start(struct cascade *w, enum who who)
{
    struct cascade_side *s = &w->side[who];

    if (s->alive)
        return;
    note(w, "starts", who);
    s->alive = true;
    s->of_row = s->of_tick = (struct apc_freshness){0};
    s->missed = false;
    s->now = s->stored;
    if (w->now - s->stored_time > LOSS(s->period)) {
        s->now.loop = (struct apc_loop_memory){.state = APC_LOOP_INIT};
        s->now.law = s->now.backup = (struct integral){0};
        s->missed = who == UPPER;
        if (who == LOWER)
            s->now.u = w->store.out.value;
    }
}

/* ---- The operator -------------------------------------------------------------------------- */

void cascade_operator_reads(struct cascade *w)
{
    w->operator.seen = w->store;
    w->operator.pending = w->operator.what != NOTHING;
}

void cascade_operator_appends(struct cascade *w)
{
    const struct cascade_store *seen = &w->operator.seen;
    struct row row = {.seq = seen->setpoint.seq + 1, .status = APC_GOOD, .author = OPERATOR, .time = w->now};
    bool was_cascade = seen->target[LOWER] == APC_MODE_CAS;
    enum apc_mode mode = w->operator.what == PUT ? APC_MODE_AUTO : w->operator.mode;
    bool owner = w->operator.what == PUT ? was_cascade : was_cascade !=(mode == APC_MODE_CAS);
    bool put = w->operator.what == PUT;

    if (owner && (w->store.target_seq[LOWER] != seen->target_seq[LOWER] ||
                  (!put && w->store.setpoint.seq != seen->setpoint.seq))) {
        cascade_operator_reads(w); /* somebody was faster: again */
        return;
    }
    row.value =
        put ? w->operator.value : seen->setpoint.author == UPPER ? seen->actual.value : seen->setpoint.value;
    if (put || owner) {
        row.seq = w->store.setpoint.seq + 1;
        w->store.setpoint = row;
        w->put = put ? row.seq : w->put;
        w->slack += w->store.travel - seen->told;
    }
    if (!put || owner) {
        w->store.target[LOWER] = mode;
        w->store.target_seq[LOWER]++;
    }
    w->operator.pending = false;
    w->operator.what = NOTHING;
    note(w, put ? "put" : "mode", OPERATOR);
}

/* ---- The world ----------------------------------------------------------------------------- */

void cascade_init(struct cascade *w, double sign)
{
    *w = (struct cascade){.now = START, .gain = sign, .w = 0.3, .level = 0.3, .flow = 0.3};
    w->side[LOWER] = (struct cascade_side){.law = {0.8 * sign, 0.2 * sign},
                                           .backup = {0.3 * sign, 0.05 * sign},
                                           .low = -1,
                                           .high = 1,
                                           .period = BASE,
                                           .hold = 3 * BASE,
                                           .alive = true,
                                           .measured = true};
    w->side[UPPER] = (struct cascade_side){.law = {0.6, 0.3},
                                           .backup = {0.2, 0.1},
                                           .low = -5,
                                           .high = 5,
                                           .period = TOP,
                                           .hold = 3 * TOP,
                                           .alive = true,
                                           .measured = true};
    w->store.setpoint = (struct row){.seq = 1, .value = 0.3, .author = OPERATOR, .time = START};
    w->store.target[LOWER] = APC_MODE_CAS;
    w->store.target[UPPER] = APC_MODE_AUTO;
    w->store.mode[LOWER] = w->store.mode[UPPER] = APC_MODE_OOS;
}

void cascade_process(struct cascade *w)
{
    w->flow += 0.4 * (w->gain * w->store.out.value - w->flow);
    w->level += 0.1 * (w->flow - w->level);
}

void cascade_run(struct cascade *w, int periods)
{
    for (int i = 0; i < periods; i++) {
        for (int who = LOWER; who <= UPPER; who++) {
            if (w->side[who].alive && (w->now - START) / BASE % (w->side[who].period / BASE) == 0) {
                cascade_reads(w, (enum who)who);
                cascade_appends(w, (enum who)who);
            }
        }
        w->now += BASE;
        cascade_process(w);
    }
}

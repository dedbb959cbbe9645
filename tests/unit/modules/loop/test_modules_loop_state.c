/* SPDX-License-Identifier: BSD-3-Clause */
/* The state of a loop: every pair of a state and the facts, against what must hold of each. */
/* Promise(modes/law-act-gives) */
#include "check.h"

#include "apcmodules.h"

static const enum apc_mode targets[] = {APC_MODE_MAN,  APC_MODE_AUTO, APC_MODE_CAS,     APC_MODE_OOS,
                                        APC_MODE_IMAN, APC_MODE_LO,   (enum apc_mode)77};
#define N_TARGETS (sizeof(targets) / sizeof(*targets))

static struct apc_loop_inputs inputs_of(enum apc_mode target, unsigned bits)
{
    return (struct apc_loop_inputs){.target = target,
                                    .acting = bits & 1,
                                    .setpoint = bits & 2,
                                    .taken = bits & 4,
                                    .invited = bits & 8,
                                    .input = bits & 16,
                                    .law = bits & 32,
                                    .expired = bits & 64,
                                    .backup = bits & 128,
                                    .remote = bits & 256,
                                    .bare = bits & 512};
}

/* Call @p check with every state, some that are none, and all facts. */
static void each(void (*check)(enum apc_loop_state from, const struct apc_loop_inputs *f,
                               const struct apc_loop_move *move))
{
    for (int from = -1; from <= APC_LOOP_END; from++)
        for (size_t target = 0; target < N_TARGETS; target++)
            for (unsigned bits = 0; bits < 1024; bits++) {
                struct apc_loop_inputs f = inputs_of(targets[target], bits);
                struct apc_loop_move move = apc_loop_next((enum apc_loop_state)from, &f);
                check((enum apc_loop_state)from, &f, &move);
            }
}

static bool wanted(const struct apc_loop_inputs *f)
{
    return f->target == APC_MODE_MAN || f->target == APC_MODE_AUTO || f->target == APC_MODE_CAS;
}

/* Would the target be carried out, were there only measurements and answers? */
static bool steered(const struct apc_loop_inputs *f)
{
    return f->acting && f->taken && (f->target == APC_MODE_AUTO || f->target == APC_MODE_CAS);
}

static bool same(const struct apc_loop_move *a, const struct apc_loop_move *b)
{
    return a->state == b->state && a->actual == b->actual && a->output == b->output && a->law == b->law &&
           a->backup == b->backup && a->status == b->status && a->reason == b->reason;
}

/* ---- Total, settled ----------------------------------------------------------------------- */

static void check_settled(enum apc_loop_state from, const struct apc_loop_inputs *f,
                          const struct apc_loop_move *move)
{
    struct apc_loop_move again = apc_loop_next(move->state, f), third = apc_loop_next(again.state, f);

    (void)from;
    assert_in_range(move->state, APC_LOOP_OOS, APC_LOOP_SHADOW);
    assert_non_null(apc_mode_name((int)move->actual));
    assert_int_equal(again.state, move->state);
    again.law |= move->law & APC_ASK_TRACK_FIRST;
    again.backup |= move->backup & APC_ASK_TRACK_FIRST;
    assert_true(same(&again, move));
    assert_false((third.law | third.backup) & APC_ASK_TRACK_FIRST);
}

/*
 * Promise(modes/first-rule): The first rule of docs/modes.md that fits says the state of a loop; nothing
 *   without a source; Man, Oos, Shadow as asked; a reason where not.
 */
static void test_every_pair_has_a_move_that_settles_in_one_step(void **state)
{
    (void)state;
    each(check_settled);
}

static void check_two_passes(enum apc_loop_state from, const struct apc_loop_inputs *f,
                             const struct apc_loop_move *move)
{
    struct apc_loop_inputs without = *f;
    struct apc_loop_move other;

    without.law = false;
    other = apc_loop_next(from, &without);
    assert_int_equal(other.law & APC_ASK_COMPUTE, move->law & APC_ASK_COMPUTE);
    if (!(move->law & APC_ASK_COMPUTE))
        assert_true(same(&other, move)); /* an answer that was not asked for makes no difference */
}

/* Promise(modes/acts-now-tracks) */
static void test_whether_the_law_is_asked_does_not_hang_on_its_answer(void **state)
{
    (void)state;
    each(check_two_passes);
}

/* ---- What goes out ------------------------------------------------------------------------ */

static void check_source(enum apc_loop_state from, const struct apc_loop_inputs *f,
                         const struct apc_loop_move *move)
{
    (void)from;
    switch (move->output) {
    case APC_PUT_NONE:
        assert_true(!f->acting || !wanted(f) || !f->taken || f->setpoint);
        break;
    case APC_PUT_LAW:
        assert_true(steered(f) && f->input && f->law && !f->expired);
        break;
    case APC_PUT_OPERATOR:
        assert_true(f->acting && f->taken && f->target == APC_MODE_MAN);
        break;
    case APC_PUT_LAST:
        assert_true(steered(f) && (!f->input || !f->law || f->expired));
        assert_true(!f->expired || (f->backup && f->bare));
        break;
    case APC_PUT_FAULT:
        assert_true(steered(f) && !f->setpoint && (f->expired || !f->input || !f->law));
        break;
    case APC_PUT_BACKUP:
        assert_true(steered(f) && f->backup && !f->bare && (f->expired || !f->input || !f->law));
        break;
    case APC_PUT_BELOW:
        assert_true(f->acting && wanted(f) && !f->taken && f->invited);
        break;
    default:
        fail_msg("no output %d", (int)move->output);
    }
    if (!f->acting || !wanted(f))
        assert_int_equal(move->output, APC_PUT_NONE);
}

/* Promise(modes/first-rule) */
static void test_nothing_goes_out_without_a_source(void **state)
{
    (void)state;
    each(check_source);
}

/* It is never the law's or the operator's word that counts while the loop below listens to others. */
static void check_answer(enum apc_loop_state from, const struct apc_loop_inputs *f,
                         const struct apc_loop_move *move)
{
    bool able = f->target == APC_MODE_MAN || f->backup || (f->input && f->law && !f->expired);

    (void)from;
    if (!f->acting || !wanted(f) || f->taken)
        return;
    assert_int_equal(move->state, APC_LOOP_INIT);
    assert_int_equal(move->output, f->invited && able ? APC_PUT_BELOW : APC_PUT_NONE);
    assert_int_equal(move->status, APC_UNCERTAIN_INITIAL);
}

/* Promise(modes/down-a-cascade) */
static void test_a_loop_below_is_answered_only_by_one_that_could_act(void **state)
{
    (void)state;
    each(check_answer);
}

static void check_status(enum apc_loop_state from, const struct apc_loop_inputs *f,
                         const struct apc_loop_move *move)
{
    (void)from;
    (void)f;
    switch (move->output) {
    case APC_PUT_LAST:
        assert_int_equal(move->status, APC_UNCERTAIN_LAST_USABLE);
        break;
    case APC_PUT_FAULT:
        assert_int_equal(move->status, APC_UNCERTAIN_SUBSTITUTE);
        break;
    case APC_PUT_BELOW:
        assert_int_equal(move->status, APC_UNCERTAIN_INITIAL);
        break;
    case APC_PUT_NONE:
        break;
    default:
        assert_int_equal(move->status, APC_GOOD);
    }
}

/* Promise(modes/first-rule) */
static void test_a_row_says_whether_it_is_what_was_wanted(void **state)
{
    (void)state;
    each(check_status);
}

/* ---- Modes -------------------------------------------------------------------------------- */

static void check_mode(enum apc_loop_state from, const struct apc_loop_inputs *f,
                       const struct apc_loop_move *move)
{
    enum apc_mode target = wanted(f) ? f->target : APC_MODE_OOS;

    (void)from;
    assert_int_equal(move->state == APC_LOOP_SHADOW, !f->acting);
    assert_int_equal(move->state == APC_LOOP_OOS, f->acting && !wanted(f));
    assert_int_equal(move->state == APC_LOOP_MAN, f->acting && f->taken && f->target == APC_MODE_MAN);
    assert_int_equal(move->state == APC_LOOP_CAS, steered(f) && f->target == APC_MODE_CAS && f->input &&
                                                      f->law && !f->expired && f->remote);
    assert_int_equal(move->state == APC_LOOP_AUTO, steered(f) && (f->target == APC_MODE_AUTO || !f->remote) &&
                                                       f->input && f->law && !f->expired);
    assert_int_equal(move->actual == APC_MODE_CAS, move->state == APC_LOOP_CAS);
    assert_int_equal(move->actual == APC_MODE_MAN, move->state == APC_LOOP_MAN);
    assert_int_equal(move->actual == APC_MODE_IMAN, move->state == APC_LOOP_INIT);
    assert_int_equal(move->actual == APC_MODE_LO, move->state == APC_LOOP_FAULT);
    assert_int_equal(move->actual == APC_MODE_OOS,
                     move->state == APC_LOOP_OOS || move->state == APC_LOOP_SHADOW);
    if (move->actual != target)
        assert_non_null(move->reason);
    if (move->actual == target && move->state != APC_LOOP_HOLD && move->state != APC_LOOP_BACKUP && f->acting)
        assert_null(move->reason);
}

/* Promise(modes/first-rule) */
static void test_the_actual_mode_is_the_wanted_one_or_there_is_a_reason(void **state)
{
    (void)state;
    each(check_mode);
}

static void check_sticky(enum apc_loop_state from, const struct apc_loop_inputs *f,
                         const struct apc_loop_move *move)
{
    bool answer = f->input && f->law;

    if (!steered(f))
        return;
    if (f->expired)
        assert_int_equal(move->state, f->backup ? APC_LOOP_BACKUP : APC_LOOP_FAULT);
    else if (answer)
        assert_true(move->state == APC_LOOP_AUTO || move->state == APC_LOOP_CAS);
    else if (from == APC_LOOP_FAULT)
        assert_int_equal(move->state, APC_LOOP_FAULT);
    else if (from == APC_LOOP_BACKUP && f->backup)
        assert_int_equal(move->state, APC_LOOP_BACKUP);
    else
        assert_int_equal(move->state, APC_LOOP_HOLD);
}

/* Promise(modes/hold-and-shed-after) */
static void test_what_held_too_long_comes_back_only_with_input_and_answer(void **state)
{
    (void)state;
    each(check_sticky);
}

/* ---- What the law does -------------------------------------------------------------------- */

static void check_law(enum apc_loop_state from, const struct apc_loop_inputs *f,
                      const struct apc_loop_move *move)
{
    bool acts = move->output == APC_PUT_LAW, acted = from == APC_LOOP_AUTO || from == APC_LOOP_CAS;
    unsigned ask = move->law;

    assert_int_equal((ask & APC_ASK_TRACK_FIRST) != 0, acts && !acted);
    assert_int_equal((move->backup & APC_ASK_TRACK_FIRST) != 0,
                     move->output == APC_PUT_BACKUP && from != APC_LOOP_BACKUP);
    assert_int_equal(move->backup & ~(unsigned)APC_ASK_TRACK_FIRST,
                     move->output == APC_PUT_BACKUP ? APC_ASK_COMPUTE | APC_ASK_UPDATE : 0);
    ask &= ~(unsigned)APC_ASK_TRACK_FIRST;
    if (move->state == APC_LOOP_OOS)
        assert_int_equal(ask, 0);
    else if (!f->input)
        assert_int_equal(ask, APC_ASK_PREDICT);
    else if (move->state == APC_LOOP_MAN)
        assert_int_equal(ask, APC_ASK_TRACK | APC_ASK_UPDATE);
    else /* an update after which no integral stands that was not tracked, unless it acts */
        assert_int_equal(ask, APC_ASK_COMPUTE | APC_ASK_UPDATE | (acts ? 0u : (unsigned)APC_ASK_TRACK));
}

/*
 * Promise(modes/acts-now-tracks): What acts from now on tracks first; what does not act moves no integral.
 */
static void test_no_integral_moves_unless_the_output_acts(void **state)
{
    (void)state;
    each(check_law);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_every_pair_has_a_move_that_settles_in_one_step),
        cmocka_unit_test(test_whether_the_law_is_asked_does_not_hang_on_its_answer),
        cmocka_unit_test(test_nothing_goes_out_without_a_source),
        cmocka_unit_test(test_a_loop_below_is_answered_only_by_one_that_could_act),
        cmocka_unit_test(test_a_row_says_whether_it_is_what_was_wanted),
        cmocka_unit_test(test_the_actual_mode_is_the_wanted_one_or_there_is_a_reason),
        cmocka_unit_test(test_what_held_too_long_comes_back_only_with_input_and_answer),
        cmocka_unit_test(test_no_integral_moves_unless_the_output_acts),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}

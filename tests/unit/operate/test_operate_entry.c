/* SPDX-License-Identifier: BSD-3-Clause */
/* What stands between an entry and its effect. */
#include "check.h"
#include "operate/operate.h"

#define ANY 0x100 /* there is none */

struct situation {
    const char *code; /* "": an entry has its effect */
    int target, actual;
    apc_status of_mode, output;
    bool stopped, safe;
};

static const char *code_of(const struct situation *is, enum apc_table table)
{
    const struct entry_seen seen = {
        .target = {.table = APC_OPMODE, .seq = is->target != ANY, .value = is->target},
        .actual = {.table = APC_ACTUAL, .seq = is->actual != ANY, .value = is->actual, .status = is->of_mode},
        .output = {.table = table, .seq = 1, .status = is->output},
        .stopped = is->stopped,
        .safe = is->safe};
    const struct entry_note *note = entry_note(&seen);
    return note ? note->code : "";
}

static void assert_code(const struct situation *is, enum apc_table table, const char *code)
{
    if (strcmp(code_of(is, table), code) != 0)
        fail_msg("target %d, actual %d, output 0x%08x: \"%s\", not \"%s\"", is->target, is->actual,
                 (unsigned)is->output, code_of(is, table), code);
}

/* Promise(modes/entry-note): Whatever a loop follows instead of an entry, and a limit that holds it back, is told
 *   beside the entry by the page, the API and `apc`. */
static void what_stands_between_an_entry_and_its_effect_is_said_in_a_code(void **state)
{
    static const enum apc_mode man = APC_MODE_MAN, automatic = APC_MODE_AUTO, cas = APC_MODE_CAS;
    const struct situation all[] = {
        {"", automatic, automatic, APC_GOOD, APC_GOOD, false, false},
        {"", cas, cas, APC_GOOD, APC_GOOD, false, false},
        {"stopped", automatic, automatic, APC_GOOD, APC_GOOD, true, true},
        {"safe", man, man, APC_GOOD, APC_GOOD, false, true},
        {"oos", ANY, ANY, APC_GOOD, APC_GOOD, false, false},
        {"oos", APC_MODE_OOS, APC_MODE_OOS, APC_GOOD, APC_GOOD, false, false},
        {"shadow", automatic, APC_MODE_OOS, APC_GOOD, APC_GOOD, false, false},
        {"tracking", automatic, APC_MODE_IMAN, APC_GOOD, APC_UNCERTAIN_INITIAL, false, false},
        {"fault", automatic, APC_MODE_LO, APC_GOOD, APC_UNCERTAIN_SUBSTITUTE, false, false},
        {"backup", automatic, automatic, APC_GOOD_LOCAL_OVERRIDE, APC_UNCERTAIN_LAST_USABLE, false, false},
        {"man", man, man, APC_GOOD, APC_GOOD_LIMITED_LOW, false, false},
        {"shed", cas, automatic, APC_GOOD, APC_GOOD, false, false},
        {"held", automatic, automatic, APC_GOOD, APC_UNCERTAIN_LAST_USABLE, false, false},
        {"low", automatic, automatic, APC_GOOD, APC_GOOD_LIMITED_LOW, false, false},
        {"high", cas, cas, APC_GOOD, APC_GOOD_LIMITED_HIGH, false, false},
        {"both", automatic, automatic, APC_GOOD, APC_GOOD_LIMITED_CONSTANT, false, false},
        {"", automatic, ANY, APC_GOOD, APC_GOOD, false, false},
    };
    (void)state;
    for (size_t i = 0; i < sizeof all / sizeof *all; i++)
        assert_code(&all[i], APC_ACTUATOR, all[i].code);
}

static void a_plant_at_its_safe_value_matters_to_its_own_outputs(void **state)
{
    const struct situation is = {"", APC_MODE_AUTO, APC_MODE_AUTO, APC_GOOD, APC_GOOD, false, true};
    (void)state;
    assert_code(&is, APC_SETPOINT, "");
    assert_code(&is, APC_ACTUATOR, "safe");
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(what_stands_between_an_entry_and_its_effect_is_said_in_a_code),
        cmocka_unit_test(a_plant_at_its_safe_value_matters_to_its_own_outputs),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}

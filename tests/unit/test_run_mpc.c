/* SPDX-License-Identifier: BSD-3-Clause */
/* Predictive control in a run in which a measurement is Bad for a while, as a step comes. */
#include <math.h>
#include <stdio.h>
#include <string.h>

#include "check.h"
#include "simulated.h"

#include <apcrun.h>
#include <apcstore.h>

#define FROM  190.0 /* s: y1 is Bad; r1 steps at 200 s */
#define UNTIL 230.0

static struct apc_error why;

/* The shipped experiment with @p more said of y1; @p hold: for how long what is Bad is controlled. */
static struct apc_simulation *begin(const char *more, const char *hold)
{
    static const char name[] = "name = \"y1\";";
    static char file[8192], text[9216];
    struct apc_experiment *e = NULL;
    struct apc_simulation *s = NULL;
    FILE *f = fopen(APC_SOURCE_DIR "/experiments/quadruple-tank-mpc.conf", "r");
    assert_non_null(f);
    file[fread(file, 1, sizeof file - 1, f)] = '\0';
    fclose(f);
    char *at = strstr(file, name);
    assert_non_null(at);
    at += strlen(name);
    snprintf(text, sizeof text, "%.*s faults = ( { kind = \"dropout\"; at = %g; duration = %g; } ); %s %s",
             (int)(at - file), file, FROM, UNTIL - FROM, more, at);
    if (apc_experiment_load(&e, "mpc.conf", text, &why) < 0 ||
        apc_experiment_set(e, "controller.settings.hold", hold, &why) < 0 ||
        apc_simulation_create(&s, e, NULL, &why) < 0)
        fail_msg("%s", why.text);
    apc_experiment_destroy(e);
    return s;
}

static void it_goes_on_by_what_it_estimates(void **state)
{
    struct apc_simulation *s = begin("", "[60, 60]");
    (void)state;
    for (double t = FROM + 2; t < UNTIL; t += 1) {
        run(s, t);
        assert_int_equal(apc_status_severity(newest(s, APC_SENSOR, 1).status), APC_SEVERITY_BAD);
        for (int id = 1; id <= 2; id++)
            assert_int_equal(apc_status_severity(newest(s, APC_ACTUATOR, id).status), APC_SEVERITY_GOOD);
    }
    run(s, UNTIL + 1);
    assert_int_equal(newest(s, APC_SENSOR, 1).status, APC_GOOD);
    assert_near(newest(s, APC_SENSOR, 1).value, 7.1315, 0.05);
    assert_near(newest(s, APC_SENSOR, 2).value, 6.3915, 0.05);
    apc_simulation_destroy(s);
}

static void without_a_critical_one_it_stops_after_its_hold(void **state)
{
    struct apc_simulation *s = begin("critical = true;", "[10, 10]");
    (void)state;
    run(s, FROM + 8);
    assert_int_equal(apc_status_severity(newest(s, APC_ACTUATOR, 1).status), APC_SEVERITY_GOOD);
    run(s, FROM + 12);
    for (int id = 1; id <= 2; id++)
        assert_int_equal(apc_status_severity(newest(s, APC_ACTUATOR, id).status), APC_SEVERITY_UNCERTAIN);
    apc_simulation_destroy(s);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(it_goes_on_by_what_it_estimates),
        cmocka_unit_test(without_a_critical_one_it_stops_after_its_hold),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}

/* SPDX-License-Identifier: BSD-3-Clause */
/*
 * What each core is made of, bound by bound: the last value that makes sense is taken, the first one that
 * does not is refused, with a sentence that names it and nothing made.
 */
#include "check.h"

#include "apcalarm.h"
#include "modules/controller.h"

#include <limits.h>

#define S    APC_NS_PER_S
#define YEAR (INT64_C(366) * 86400 * S)

/* @p part of the reason, or NULL: it is made. */
static void judge(int rc, bool made, const struct apc_error *why, const char *part)
{
    if (part && (rc != APC_EINVAL || made || !strstr(why->text, part)))
        fail_msg("%s, \"%s\" instead of \"%s\"", apc_err_name(rc), why->text, part);
    if (!part && (rc != 0 || !made))
        fail_msg("%s: %s", apc_err_name(rc), why->text);
}

/* ---- Controller ------------------------------------------------------------------------------- */

enum { NY = 1, NZ = 2, NU = 2, ND = 1 };

static struct apc_controller_setpoint z[NZ];
static struct apc_controller_loop loop[NU];
static struct apc_controller_backup backup;
static struct apc_law law;
static apc_ns of_y[NY], of_d[ND];
static struct apc_param many[APC_VECTOR_MAX + 1];
static struct apc_controller_options controller;

static int answer(struct apc_law_call *c)
{
    (void)c;
    return APC_LAW_GOOD;
}

static void begin(void)
{
    static const struct apc_controller_setpoint one_z = {.id = 1, .low = -1, .high = 1};
    static const struct apc_controller_loop one_loop = {.id = 1, .mode = 1, .low = -1, .high = 1};

    law = (struct apc_law){.abi = APC_LAW_ABI, .name = "any", .whole = true, .compute = answer};
    backup = (struct apc_controller_backup){.law = &law};
    z[0] = z[1] = one_z;
    loop[0] = loop[1] = one_loop;
    of_y[0] = of_d[0] = 0;
    controller = (struct apc_controller_options){.size = sizeof controller,
                                                 .law = &law,
                                                 .dim = {NY, NZ, NU, ND},
                                                 .period = 2 * S,
                                                 .horizon = 5 * S,
                                                 .z = z,
                                                 .loop = loop,
                                                 .y_horizon = of_y,
                                                 .d_horizon = of_d,
                                                 .backup = &backup};
}

static void make_controller(const char *part)
{
    struct apc_controller *core = (struct apc_controller *)&controller;
    struct apc_error why = {""};
    const int rc = apc_controller_create(&core, &controller, &why);

    judge(rc, core != NULL, &why, part);
    apc_controller_destroy(core);
    begin();
}

static void setpoints_of_a_controller_have_bounds(void **state)
{
    static const char *const limits = "limits of setpoint 2: low", *const period =
                                                                       "setpoint 2: the period of";

    (void)state;
    begin();
    make_controller(NULL);
    z[1].low = z[1].high;
    make_controller(NULL);
    z[1].low = nextafter(z[1].high, 2);
    make_controller(limits);
    z[1].high = (double)NAN;
    make_controller(limits);
    z[1].above = 3;
    make_controller(period);
    z[1].above = 3, z[1].above_period = YEAR + 1;
    make_controller(period);
    z[1].above = 3, z[1].above_period = YEAR;
    make_controller(NULL);
}

static void loops_of_a_controller_have_bounds(void **state)
{
    static const char *const limits = "limits of output 2: low", *const fault = "fault value 2 is",
                             *const rate = "output 2: neither its rate",
                             *const period = "output 2: the period of the controller below";

    (void)state;
    begin();
    loop[1].low = nextafter(1, 2);
    make_controller(limits);
    loop[1].low = (double)NAN;
    make_controller(limits);
    loop[1].low = loop[1].fault = 1;
    make_controller(NULL);
    loop[1].fault = nextafter(1, 2);
    make_controller(fault);
    loop[1].fault = nextafter(-1, -2);
    make_controller(fault);
    loop[1].fault = -1;
    make_controller(NULL);
    loop[1].low = -HUGE_VAL, loop[1].fault = -HUGE_VAL;
    make_controller(fault);
    loop[1].rate = -1e-300;
    make_controller(rate);
    loop[1].rate = (double)NAN;
    make_controller(rate);
    loop[1].hold = -1;
    make_controller(rate);
    loop[1].hold = YEAR + 1;
    make_controller(rate);
    loop[1].hold = YEAR;
    make_controller(NULL);
    loop[1].setpoint = loop[1].signal = 7, loop[1].below_period = S;
    make_controller("output 2: it is a setpoint or a calculated signal, not both");
    loop[1].setpoint = 7;
    make_controller(period);
    loop[1].setpoint = 7, loop[1].below_period = YEAR + 1;
    make_controller(period);
    loop[1].setpoint = 7, loop[1].below_period = YEAR;
    make_controller(NULL);
    loop[1].signal = loop[1].below_tick = 7;
    make_controller(period);
    loop[1].signal = loop[1].below_tick = 7, loop[1].below_period = 1;
    make_controller(NULL);
    loop[1].signal = 7; /* nobody tells what became of it */
    make_controller(NULL);
    loop[1].below_tick = 7; /* of an actuator nobody does either */
    make_controller(NULL);
}

static void times_of_a_controller_have_bounds(void **state)
{
    static const char *const budget = "the law's budget of", *const horizons = "horizons must be above 0";

    (void)state;
    begin();
    controller.budget = -1;
    make_controller(budget);
    controller.budget = controller.period + 1;
    make_controller(budget);
    controller.budget = controller.period;
    make_controller(NULL);
    of_y[0] = YEAR + 1;
    make_controller(horizons);
    of_y[0] = YEAR;
    make_controller(NULL);
    of_d[0] = -1;
    make_controller(horizons);
    of_d[0] = 1;
    make_controller(NULL);
    controller.size = 0;
    make_controller("size");
}

static void laws_of_a_controller_have_bounds(void **state)
{
    (void)state;
    begin();
    for (size_t i = 0; i < APC_VECTOR_MAX + 1; i++)
        many[i] = (struct apc_param){.name = "k", .low = -1, .high = 1};
    law.tuning = many, law.n_tuning = APC_VECTOR_MAX + 1;
    make_controller("law any wants 8193 tuning parameters an output; too many");
    backup.law = NULL;
    make_controller("a backup wants a law");
}

/* ---- Scheduler, client ------------------------------------------------------------------------ */

static void a_scheduler_has_bounds(void **state)
{
    static struct apc_scheduler_setpoint moved[APC_VECTOR_MAX + 1];
    static double sequence[APC_VECTOR_MAX + 1];
    const struct apc_scheduler_options good = {
        .size = sizeof good, .nz = 1, .z = moved, .steps = 1, .sequence = sequence, .period = S};
    const size_t nz[] = {APC_VECTOR_MAX, APC_VECTOR_MAX + 1};
    const apc_ns period[] = {YEAR, YEAR + 1};
    struct apc_error why = {""};

    (void)state;
    for (int i = 0; i < 4; i++) {
        struct apc_scheduler *core = NULL;
        struct apc_scheduler_options o = good;

        if (i < 2)
            o.nz = nz[i];
        else
            o.period = period[i - 2];
        const int rc = apc_scheduler_create(&core, &o, &why);
        judge(rc, core != NULL, &why, i == 1 ? "setpoints (at most 8192)" : i == 3 ? "366 days" : NULL);
        apc_scheduler_destroy(core);
    }
    judge(apc_scheduler_create(NULL, &good, &why), false, &why, "scheduler must not be NULL");
}

static void a_client_has_bounds(void **state)
{
    const struct {
        size_t ny, nu;
        apc_ns period;
        const char *part;
    } of[] = {{1, 1, YEAR, NULL},           {1, 1, YEAR + 1, "command_period"},
              {1, 1, -1, "command_period"}, {0, 1, S, "each must be 1 to 8192"},
              {APC_VECTOR_MAX, 1, S, NULL}, {1, APC_VECTOR_MAX + 1, S, "each must be 1 to 8192"}};
    struct apc_client_options o = {.ny = 1, .nu = 1, .command_period = S};
    struct apc_client *core = (struct apc_client *)&o;
    struct apc_error why = {""};
    int rc = apc_client_create(&core, &o, &why);

    (void)state;
    judge(rc, core != NULL, &why, "size");
    for (size_t i = 0; i < sizeof of / sizeof *of; i++) {
        o = (struct apc_client_options){
            .size = sizeof o, .ny = of[i].ny, .nu = of[i].nu, .command_period = of[i].period};
        rc = apc_client_create(&core, &o, &why);
        judge(rc, core != NULL, &why, of[i].part);
        apc_client_destroy(core);
    }
}

/* ---- Plant server ----------------------------------------------------------------------------- */

static struct apc_model model;
static struct apc_plant *plant;
static double noise[2];
static struct apc_disturbance change[2];
static struct apc_sensor_fault fault[2];
static struct apc_sensor sensor[1];
static struct apc_plantserver_options server;

static int hold_f(double t, const double *x, const double *u, const double *p, double *dx)
{
    (void)t, (void)x, (void)u, (void)p;
    dx[0] = dx[1] = 0;
    return 0;
}

static void hold_g(double t, const double *x, const double *u, const double *p, double *y)
{
    (void)t, (void)u, (void)p;
    y[0] = x[0] + x[1];
}

static void begin_server(void)
{
    model = (struct apc_model){
        .abi = APC_MODEL_ABI, .name = "still", .nx = 2, .nu = 1, .ny = 1, .nd = 1, .f = hold_f, .g = hold_g};
    noise[0] = noise[1] = 0;
    change[0] = (struct apc_disturbance){.at = S};
    change[1] = (struct apc_disturbance){.at = 2 * S};
    fault[0] = fault[1] = (struct apc_sensor_fault){.kind = APC_FAULT_STUCK};
    sensor[0] = (struct apc_sensor){.fault = fault, .n_faults = 2};
    server = (struct apc_plantserver_options){.size = sizeof server,
                                              .plant = plant,
                                              .model = &model,
                                              .link_period = S,
                                              .command_period = S,
                                              .noise = noise,
                                              .disturbance = change,
                                              .n_disturbances = 2,
                                              .sensor = sensor};
}

static void make_server(const char *part)
{
    struct apc_plantserver *core = (struct apc_plantserver *)&server;
    struct apc_error why = {""};
    const int rc = apc_plantserver_create(&core, &server, &why);

    judge(rc, core != NULL, &why, part);
    apc_plantserver_destroy(core);
    begin_server();
}

static void a_plant_server_has_bounds(void **state)
{
    static const char *const of_noise = "noise of state 2 is", *const of_change = "change 2 of a disturbance";

    (void)state;
    begin_server();
    assert_int_equal(apc_plant_create(&plant, &model, NULL, NULL, NULL, NULL), 0);
    begin_server();
    make_server(NULL);
    server.size = 0;
    make_server("size");
    server.plant = NULL;
    make_server("plant and model are required");
    server.model = NULL;
    make_server("plant and model are required");
    noise[1] = -1e-300;
    make_server(of_noise);
    noise[1] = (double)NAN;
    make_server(of_noise);
    noise[1] = HUGE_VAL;
    make_server(of_noise);
    change[1].k = 1;
    make_server(of_change);
    change[1].value = HUGE_VAL;
    make_server(of_change);
    change[1].at = S - 1;
    make_server(of_change);
    change[1].at = S;
    make_server(NULL);
    change[0].at = -1;
    make_server("change 1 of a disturbance");
    change[0].at = 0;
    make_server(NULL);
    apc_plant_destroy(plant);
}

static void a_sensor_has_bounds(void **state)
{
    static const char *const steps = "sensor 1: noise",
                             *const times = "sensor 1: a fault's begin and duration",
                             *const kinds = "is no kind of fault";

    (void)state;
    begin_server();
    assert_int_equal(apc_plant_create(&plant, &model, NULL, NULL, NULL, NULL), 0);
    begin_server();
    sensor[0].noise = -1e-300;
    make_server(steps);
    sensor[0].noise = HUGE_VAL;
    make_server(steps);
    sensor[0].quantum = -1e-300;
    make_server(steps);
    sensor[0].quantum = HUGE_VAL;
    make_server(steps);
    sensor[0].period = -1;
    make_server("sensor 1: period");
    fault[1].kind = (enum apc_sensor_fault_kind)0;
    make_server(kinds);
    fault[1].kind = (enum apc_sensor_fault_kind)(APC_FAULT_FROZEN + 1);
    make_server(kinds);
    fault[1].kind = APC_FAULT_NOISE;
    fault[1].size = -1e-300;
    make_server("noise of a fault");
    fault[1].kind = APC_FAULT_SPIKE;
    make_server(NULL);
    fault[0].kind = (enum apc_sensor_fault_kind)0; /* the second one being good helps nothing */
    make_server(kinds);
    fault[1].at = -1;
    make_server(times);
    fault[1].duration = -1;
    make_server(times);
    fault[1].size = HUGE_VAL;
    make_server(times);
    apc_plant_destroy(plant);
}

/* ---- Alarms ----------------------------------------------------------------------------------- */

enum { ALARMS = 3 };

static struct apc_alarm of[ALARMS];
static struct apc_alarms_options alarms;

static void begin_alarms(void)
{
    for (size_t i = 0; i < ALARMS; i++)
        of[i] = (struct apc_alarm){
            .name = "a", .kind = APC_ALARM_HIGH, .table = APC_SENSOR, .id = 1, .high = 1, .priority = 1};
    alarms = (struct apc_alarms_options){.size = sizeof alarms, .n = ALARMS, .alarm = of, .number = 1};
}

static void make_alarms(const char *part)
{
    struct apc_alarms *core = (struct apc_alarms *)&alarms;
    struct apc_error why = {""};
    const int rc = apc_alarms_create(&core, &alarms, &why);

    judge(rc, core != NULL, &why, part);
    apc_alarms_destroy(core);
    begin_alarms();
}

static void all_alarms_together_have_bounds(void **state)
{
    static struct apc_alarm most[APC_ALARMS_MAX + 1];
    static const char *const few = "1 to 4095 alarms and a number are required";
    struct apc_error why = {""};

    (void)state;
    begin_alarms();
    make_alarms(NULL);
    judge(apc_alarms_create(NULL, &alarms, &why), false, &why, "alarms must not be NULL");
    for (size_t i = 0; i < APC_ALARMS_MAX + 1; i++)
        most[i] = of[0];
    alarms.size = 0;
    make_alarms("size");
    alarms.n = 0;
    make_alarms(few);
    alarms.n = 1;
    make_alarms(NULL);
    alarms.n = APC_ALARMS_MAX + 1, alarms.alarm = most;
    make_alarms(few);
    alarms.n = APC_ALARMS_MAX, alarms.alarm = most;
    make_alarms(NULL);
    alarms.alarm = NULL;
    make_alarms(few);
    alarms.number = 0;
    make_alarms(few);
    alarms.shelve_max = -1;
    make_alarms("the longest shelving");
    alarms.shelve_max = YEAR + 1;
    make_alarms("the longest shelving");
    alarms.shelve_max = YEAR;
    make_alarms(NULL);
}

static void each_alarm_has_bounds(void **state)
{
    static const char *const named = "a name and a kind are required", *const signal = "no such signal",
                             *const other = "a deviation is from another signal",
                             *const numbers = "limit and deadband must be numbers",
                             *const delays = "a delay or horizon must be from 0 to 366 days",
                             *const priority = "the priority must be from 1 to 4",
                             *const suppressed = "it is suppressed by itself, or by no alarm that there is",
                             *const suppressor = "it is suppressed by no signal that there is";
    apc_ns *const delay[] = {&of[1].on_delay, &of[1].off_delay, &of[1].horizon, &of[1].suppression.hold};

    (void)state;
    begin_alarms();
    of[1].name = NULL;
    make_alarms("alarm ?: a name and a kind are required");
    of[1].kind = (enum apc_alarm_kind)0;
    make_alarms(named);
    of[1].kind = APC_ALARM_KINDS;
    make_alarms(named);
    of[1].table = (enum apc_table)0;
    make_alarms(signal);
    of[1].id = -1;
    make_alarms(signal);
    of[1].id = 0;
    make_alarms(NULL);
    of[1].table = APC_TICK;
    make_alarms(signal);
    of[1].kind = APC_ALARM_STOPPED, of[1].horizon = S;
    make_alarms(signal);
    of[1].kind = APC_ALARM_STOPPED, of[1].horizon = S, of[1].table = APC_TICK;
    make_alarms(NULL);
    of[1].kind = APC_ALARM_OVERRUN;
    make_alarms(signal);
    of[1].kind = APC_ALARM_OVERRUN, of[1].table = APC_TICK;
    make_alarms(NULL);
    of[1].kind = APC_ALARM_DEVIATION;
    make_alarms(other);
    of[1].kind = APC_ALARM_DEVIATION, of[1].other_table = APC_TICK;
    make_alarms(other);
    of[1].kind = APC_ALARM_DEVIATION, of[1].other_table = APC_SETPOINT;
    make_alarms(NULL);
    of[1].limit = (double)NAN;
    make_alarms(numbers);
    of[1].deadband = HUGE_VAL;
    make_alarms(numbers);
    of[1].deadband = -1e-300;
    make_alarms(numbers);
    of[1].kind = APC_ALARM_AT_LIMIT, of[1].low = of[1].high;
    make_alarms("the limits must rise");
    of[1].low = of[1].high; /* of another kind they do not matter */
    make_alarms(NULL);
    for (size_t i = 0; i < sizeof delay / sizeof *delay; i++) {
        *delay[i] = -1;
        make_alarms(delays);
        *delay[i] = YEAR + 1;
        make_alarms(delays);
        *delay[i] = YEAR;
        make_alarms(NULL);
    }
    of[1].kind = APC_ALARM_BAD;
    make_alarms(delays);
    of[1].kind = APC_ALARM_STOPPED, of[1].table = APC_TICK;
    make_alarms(delays);
    of[1].priority = 0;
    make_alarms(priority);
    of[1].priority = APC_ALARM_PRIORITIES + 1;
    make_alarms(priority);
    of[1].priority = APC_ALARM_PRIORITIES;
    make_alarms(NULL);
    of[1].suppression.alarm = -1;
    make_alarms(suppressed);
    of[1].suppression.alarm = ALARMS + 1;
    make_alarms(suppressed);
    of[1].suppression.alarm = ALARMS;
    make_alarms(NULL);
    of[1].suppression.alarm = 2;
    make_alarms(suppressed);
    of[1].suppression.table = APC_TICK;
    make_alarms(suppressor);
    of[1].suppression.table = (enum apc_table)1000;
    make_alarms(suppressor);
    of[1].suppression.table = APC_ACTUATOR;
    make_alarms(NULL);
    of[0].priority = 0; /* those behind it being good helps nothing */
    make_alarms(priority);
}

/* Each suppressed by the next, the last one by the first: in a ring of any length none would ever be shown. */
static void alarms_that_suppress_one_another_in_a_ring_are_refused(void **state)
{
    (void)state;
    begin_alarms();
    for (int i = 0; i < ALARMS; i++)
        of[i].suppression.alarm = (i + 1) % ALARMS + 1;
    make_alarms("it is suppressed by itself");
    for (int i = 0; i < ALARMS - 1; i++)
        of[i].suppression.alarm = i + 2;
    make_alarms(NULL);
    of[0].suppression.alarm = of[1].suppression.alarm = 3, of[2].suppression.alarm = 2;
    make_alarms("it is suppressed by itself");
}

/* A kind is known by its name, and no other number or name is one. */
static void kinds_of_alarms_have_names(void **state)
{
    (void)state;
    for (int i = 1; i < APC_ALARM_KINDS; i++) {
        const char *name = apc_alarm_kind_name((enum apc_alarm_kind)i);

        assert_non_null(name);
        assert_int_equal(apc_alarm_kind_parse(name), i);
    }
    assert_string_equal(apc_alarm_kind_name(APC_ALARM_LOW_LOW), "low-low");
    assert_string_equal(apc_alarm_kind_name(APC_ALARM_STOPPED), "stopped");
    assert_string_equal(apc_alarm_kind_name(APC_ALARM_OVERRUN), "overrun");
    assert_null(apc_alarm_kind_name((enum apc_alarm_kind)0));
    assert_null(apc_alarm_kind_name(APC_ALARM_KINDS));
    assert_int_equal(apc_alarm_kind_parse("lowest"), 0);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(setpoints_of_a_controller_have_bounds),
        cmocka_unit_test(loops_of_a_controller_have_bounds),
        cmocka_unit_test(times_of_a_controller_have_bounds),
        cmocka_unit_test(laws_of_a_controller_have_bounds),
        cmocka_unit_test(a_scheduler_has_bounds),
        cmocka_unit_test(a_client_has_bounds),
        cmocka_unit_test(a_plant_server_has_bounds),
        cmocka_unit_test(a_sensor_has_bounds),
        cmocka_unit_test(all_alarms_together_have_bounds),
        cmocka_unit_test(each_alarm_has_bounds),
        cmocka_unit_test(alarms_that_suppress_one_another_in_a_ring_are_refused),
        cmocka_unit_test(kinds_of_alarms_have_names),
    };

    return cmocka_run_group_tests(tests, NULL, NULL);
}

/* SPDX-License-Identifier: BSD-3-Clause */
/* What a law refuses to be made of, or to be tuned to, is said in a sentence, each number of which is right. */
#include "apclinear.h"
#include "laws.h"

#include <stdio.h>
#include <string.h>

enum { WIDE = 20, TUNING_MOST = 64 };

#define TEXT(name_, text_)                                                                                   \
    {                                                                                                        \
        .name = (name_), .text = (text_)                                                                     \
    }

/* Two tanks over two others; three levels. */
static const double A[] = {-0.016, 0, 0.042, 0, 0, -0.011, 0, 0.033, 0, 0, -0.042, 0, 0, 0, 0, -0.033},
                    B[20] = {0.083, 0, 0, 0.063, 0, 0.048, 0.031, 0}, B_same[20] = {1, 1, 1, 1, 1, 1, 1, 1},
                    C[20] = {0.5, 0, 0, 0, 0, 0.5, 0, 0, 0, 0, 0.5, 0}, D[20] = {0.0},
                    D_through[20] = {0, 0, 0, 0, 0, -0.1}, rest[20] = {0.0};

enum model { NONE, TANKS, THROUGH, SAME_INPUTS, SAMPLED };

static const struct apc_law_plant *model_of(enum model which, struct apc_linear **sampled)
{
    static struct apc_law_plant plant;
    const struct apc_linear_continuous from = {
        .size = sizeof from, .nx = 4, .nu = 2, .ny = 3, .A = A, .B = B, .C = C};

    plant =
        (struct apc_law_plant){.nx = 4, .A = A, .B = B, .C = C, .D = D, .x0 = rest, .u0 = rest, .y0 = rest};
    if (which == THROUGH)
        plant.D = D_through;
    if (which == SAME_INPUTS)
        plant.B = B_same;
    if (which == SAMPLED) {
        assert_int_equal(apc_linear_from_continuous(sampled, &from, 0.5, NULL), 0);
        plant = (struct apc_law_plant){.D = D, .u0 = rest, .y0 = rest, .sampled = *sampled};
    }
    return which == NONE ? NULL : &plant;
}

struct refusal {
    const struct apc_law *law;
    struct apc_dim dim;
    struct apc_setting setting;
    enum model model;
    const char *says;
};

static const struct refusal refusals[] = {
    {&apc_law_pid,
     {1, 1, 2, 0},
     {0},
     NONE,
     "law pid: output 2 would control measurement 2 to setpoint 2, but there are 1 and 1; settings "
     "\"measurement\" and \"setpoint\" pair them"},
    {&apc_law_pid,
     {2, 1, 2, 0},
     {0},
     NONE,
     "law pid: output 2 would control measurement 2 to setpoint 2, but there are 2 and 1; settings "
     "\"measurement\" and \"setpoint\" pair them"},
    {&apc_law_pid,
     {3, 2, 2, 1},
     ROW("measurement", 1, 4),
     NONE,
     "setting \"measurement\": 4 is no whole number from 1 to 3"},
    {&apc_law_pid,
     {3, 2, 2, 1},
     ROW("measurement", 1, 0),
     NONE,
     "setting \"measurement\": 0 is no whole number from 1 to 3"},
    {&apc_law_pid,
     {3, 2, 2, 1},
     ROW("measurement", 1, 1.5),
     NONE,
     "setting \"measurement\": 1.5 is no whole number from 1 to 3"},
    {&apc_law_pid,
     {3, 2, 2, 1},
     ROW("measurement", 1),
     NONE,
     "setting \"measurement\" must be 2 numbers, not 1"},
    {&apc_law_pid,
     {3, 2, 2, 1},
     ROW("measurement", 1, 3),
     NONE,
     "law pid: output 2 would control measurement 3 to setpoint 3, but there are 3 and 2; settings "
     "\"measurement\" and \"setpoint\" pair them"},
    {&apc_law_pid,
     {3, 2, 2, 1},
     ROW("setpoint", 1, 3),
     NONE,
     "setting \"setpoint\": 3 is no whole number from 1 to 2"},
    {&apc_law_pid,
     {3, 2, 2, 1},
     ROW("feed_forward", 1, 5),
     NONE,
     "setting \"feed_forward\": 5 is no whole number from 0 to 4"},
    {&apc_law_pid,
     {3, 2, 2, 1},
     ROW("feed_forward", -1, 5),
     NONE,
     "setting \"feed_forward\": -1 is no whole number from 0 to 4"},
    {&apc_law_pid,
     {3, 2, 2, 1},
     TEXT("feed_forward", "none"),
     NONE,
     "setting \"feed_forward\" must be 2 numbers, not a text"},
    {&apc_law_pid,
     {3, 2, 2, 1},
     ROW("feed_forwards", 1, 2),
     NONE,
     "law pid has no setting \"feed_forwards\""},
    {&apc_law_cascade,
     {1, 1, 1, 0},
     {0},
     NONE,
     "law cascade: needs an outer and an inner measurement and a setpoint for each output; there are 1 "
     "measurements, 1 setpoints, 1 outputs"},
    {&apc_law_cascade,
     {2, 1, 3, 0},
     {0},
     NONE,
     "law cascade: needs an outer and an inner measurement and a setpoint for each output; there are 2 "
     "measurements, 1 setpoints, 3 outputs"},
    {&apc_law_cascade,
     {2, 0, 1, 0},
     {0},
     NONE,
     "law cascade: needs an outer and an inner measurement and a setpoint for each output; there are 2 "
     "measurements, 0 setpoints, 1 outputs"},
    {&apc_law_cascade,
     {3, 2, 2, 0},
     {0},
     NONE,
     "law cascade: \"inner\" of output 2 would be 4, but there are 3"},
    {&apc_law_cascade,
     {4, 1, 2, 0},
     {0},
     NONE,
     "law cascade: \"setpoint\" of output 2 would be 2, but there are 1"},
    {&apc_law_cascade,
     {4, 2, 2, 0},
     ROW("outer", 1, 5),
     NONE,
     "setting \"outer\": 5 is no whole number from 1 to 4"},
    {&apc_law_cascade,
     {4, 2, 2, 0},
     ROW("inner", 1, 5),
     NONE,
     "setting \"inner\": 5 is no whole number from 1 to 4"},
    {&apc_law_cascade,
     {4, 2, 2, 0},
     ROW("setpoint", 3, 1),
     NONE,
     "setting \"setpoint\": 3 is no whole number from 1 to 2"},
    {&apc_law_leadlag,
     {2, 0, 3, 1},
     {0},
     NONE,
     "law leadlag: output 3 has neither disturbance nor measurement 3"},
    {&apc_law_leadlag,
     {0, 0, 1, 0},
     {0},
     NONE,
     "law leadlag: output 1 has neither disturbance nor measurement 1"},
    {&apc_law_select,
     {3, 0, 2, 0},
     {0},
     NONE,
     "law select: needs settings = { select = \"low\"; }, or \"high\""},
    {&apc_law_select,
     {3, 0, 2, 0},
     TEXT("select", "last"),
     NONE,
     "law select: needs settings = { select = \"low\"; }, or \"high\""},
    {&apc_law_select,
     {3, 0, 2, 0},
     ROW("select", 1),
     NONE,
     "law select: needs settings = { select = \"low\"; }, or \"high\""},
    {&apc_law_select,
     {3, 0, 2, 0},
     TEXT("inputs", "all"),
     NONE,
     "law select: \"inputs\" must be a row of measurements for each of the 2 outputs"},
    {&apc_law_select,
     {3, 0, 2, 0},
     ROW("inputs", 1, 2),
     NONE,
     "law select: \"inputs\" must be a row of measurements for each of the 2 outputs"},
    {&apc_law_select,
     {3, 0, 2, 0},
     ROWS("inputs", 2, 1, 2, 3, 4),
     NONE,
     "setting \"inputs\": 4 is no whole number from 1 to 3"},
    {&apc_law_select,
     {3, 0, 2, 0},
     ROWS("inputs", 2, 1, 2, 0, 3),
     NONE,
     "setting \"inputs\": 0 is no whole number from 1 to 3"},
    {&apc_law_select,
     {17, 0, 1, 0},
     TEXT("select", "low"),
     NONE,
     "law select: output 1 has 17 inputs; from 1 to 16"},
    {&apc_law_select,
     {0, 0, 2, 0},
     TEXT("select", "low"),
     NONE,
     "law select: output 1 has 0 inputs; from 1 to 16"},
    {&apc_law_split,
     {2, 0, 3, 0},
     ROW("input", 1, 2, 3),
     NONE,
     "setting \"input\": 3 is no whole number from 1 to 2"},
    {&apc_law_split, {2, 0, 3, 0}, ROW("input", 1, 2), NONE, "setting \"input\" must be 3 numbers, not 2"},
    {&apc_law_split, {0, 0, 1, 0}, {0}, NONE, "law split: output 1 would use measurement 1, but there are 0"},
    {&apc_law_pi,
     {1, 2, 2, 0},
     {0},
     NONE,
     "law pi does not work with measurements: 1, setpoints: 2, outputs: 2"},
    {&apc_law_pi, {2, 2, 2, 0}, ROW("gain", 1), NONE, "law pi has no setting \"gain\""},
    {&apc_law_filter,
     {1, 0, 2, 0},
     {0},
     NONE,
     "law filter does not work with measurements: 1, setpoints: 0, outputs: 2"},
    {&apc_law_ramp,
     {2, 1, 2, 0},
     {0},
     NONE,
     "law ramp does not work with measurements: 2, setpoints: 1, outputs: 2"},
    {&apc_law_lqg,
     {3, 2, 2, 0},
     {0},
     NONE,
     "law lqg needs the plant's linear model: an experiment file gives it with operating_point or model"},
    {&apc_law_lqg, {3, 2, 2, 1}, {0}, TANKS, "law lqg: takes no measured disturbances"},
    {&apc_law_lqg,
     {3, 1, 2, 0},
     {0},
     TANKS,
     "law lqg: needs a setpoint for each output, and at least as many measurements; there are 2 outputs, 1 "
     "setpoints, 3 measurements"},
    {&apc_law_lqg,
     {1, 2, 2, 0},
     {0},
     TANKS,
     "law lqg: needs a setpoint for each output, and at least as many measurements; there are 2 outputs, 2 "
     "setpoints, 1 measurements"},
    {&apc_law_lqg,
     {3, 2, 2, 0},
     {0},
     THROUGH,
     "law lqg: u acts on y at once (D is not zero); that is not provided for"},
    {&apc_law_lqg,
     {3, 2, 2, 0},
     {0},
     SAME_INPUTS,
     "law lqg: no steady state belongs to every setpoint: at rest the outputs do not determine the "
     "controlled measurements one by one"},
    {&apc_law_lqg,
     {3, 2, 2, 0},
     ROW("delay", 1.0),
     TANKS,
     "law lqg: \"delay\" is 1 s; it must be below the period, 0.5 s"},
    {&apc_law_lqg, {3, 2, 2, 0}, ROW("delay", 0.1, 0.2), TANKS, "setting \"delay\" must be 1 numbers, not 2"},
    {&apc_law_lqg,
     {3, 2, 2, 0},
     ROW("delay", 0.5),
     SAMPLED,
     "law lqg: setting \"delay\": a model of its own has its \"delay\" itself"},
    {&apc_law_lqg,
     {3, 2, 2, 0},
     ROW("setpoint_preview", 5000.5),
     TANKS,
     "law lqg: \"setpoint_preview\" is 10001 periods; 10000 at most"},
    {&apc_law_lqg,
     {3, 2, 2, 0},
     ROW("setpoint_preview", -1),
     TANKS,
     "setting \"setpoint_preview\": -1 is no number from 0 to 1e+300"},
    {&apc_law_lqg,
     {3, 2, 2, 0},
     ROW("measurement", 1, 4),
     TANKS,
     "setting \"measurement\": 4 is no whole number from 1 to 3"},
    {&apc_law_lqg,
     {3, 2, 2, 0},
     ROW("measurement", 3, 3),
     TANKS,
     "law lqg: no steady state belongs to every setpoint: at rest the outputs do not determine the "
     "controlled measurements one by one"},
    {&apc_law_lqg,
     {3, 2, 2, 0},
     ROW("y_scale", 1, 2),
     TANKS,
     "law lqg: setting \"y_scale\" must be 3 numbers, not 2"},
    {&apc_law_lqg,
     {3, 2, 2, 0},
     ROW("x_scale", 1, 2, 3),
     TANKS,
     "law lqg: setting \"x_scale\" must be 4 numbers, not 3"},
    {&apc_law_lqg,
     {3, 2, 2, 0},
     ROW("u_scale", 1, 0),
     TANKS,
     "law lqg: setting \"u_scale\": each must be above 0"},
    {&apc_law_lqg,
     {3, 2, 2, 0},
     ROW("u_noise", 0, 1),
     TANKS,
     "law lqg: setting \"u_noise\": each must be above 0"},
    {&apc_law_lqg,
     {3, 2, 2, 0},
     ROW("y_noise", 1, 1, 0),
     TANKS,
     "law lqg: setting \"y_noise\": each must be above 0"},
    {&apc_law_lqg,
     {3, 2, 2, 0},
     ROW("x_noise", 1, 1, 1, -0.5),
     TANKS,
     "law lqg: setting \"x_noise\": -0.5 is no number from 0 to 1e+300"},
    {&apc_law_mpc,
     {3, 2, 2, 0},
     {0},
     NONE,
     "law mpc: the plant's linear model is not known; give group plant a model, and the controller an "
     "operating_point, or a file with a model"},
    {&apc_law_mpc,
     {1, 2, 2, 0},
     {0},
     TANKS,
     "law mpc does not work with measurements: 1, setpoints: 2, outputs: 2"},
    {&apc_law_mpc,
     {3, 2, 2, 0},
     ROW("horizon", 0),
     TANKS,
     "law mpc: setting \"horizon\": 0 is no whole number from 1 to 1000"},
    {&apc_law_mpc,
     {3, 2, 2, 0},
     ROW("horizon", 1001),
     TANKS,
     "law mpc: setting \"horizon\": 1001 is no whole number from 1 to 1000"},
    {&apc_law_mpc,
     {3, 2, 2, 0},
     ROW("blocks", 20, 1),
     TANKS,
     "law mpc: setting \"blocks\": 21 samples and more, beyond the horizon of 20"},
    {&apc_law_mpc,
     {3, 2, 2, 0},
     ROW("blocks", 1, 21),
     TANKS,
     "law mpc: setting \"blocks\": 21 is no whole number from 1 to 20"},
    {&apc_law_mpc,
     {3, 2, 2, 0},
     ROW("blocks", 1, 0),
     TANKS,
     "law mpc: setting \"blocks\": 0 is no whole number from 1 to 20"},
    {&apc_law_mpc,
     {3, 2, 2, 0},
     TEXT("blocks", "few"),
     TANKS,
     "law mpc: setting \"blocks\": 0 of them in a horizon of 20 samples: expected how many samples each "
     "lasts, as [1, 1, 2, 4]"},
    {&apc_law_mpc,
     {3, 2, 2, 0},
     ROW("measurement", 1, 4),
     TANKS,
     "setting \"measurement\": 4 is no whole number from 1 to 3"},
    {&apc_law_mpc,
     {3, 2, 2, 0},
     ROW("rank", 1, 2, 4),
     TANKS,
     "law mpc: setting \"rank\": 4 is no whole number from 1 to 3"},
    {&apc_law_mpc,
     {3, 2, 2, 0},
     ROW("terminal", 2),
     TANKS,
     "law mpc: setting \"terminal\": 2 is no whole number from 0 to 1"},
    {&apc_law_mpc,
     {3, 2, 2, 0},
     ROW("steady", -1),
     TANKS,
     "law mpc: setting \"steady\": -1 is no whole number from 0 to 1"},
    {&apc_law_mpc,
     {3, 2, 2, 0},
     ROW("setpoint_preview", 0.5),
     TANKS,
     "law mpc: setting \"setpoint_preview\": 0.5 is no whole number from 0 to 1"},
    {&apc_law_mpc,
     {3, 2, 2, 0},
     ROW("delay", 1, 2, 3),
     TANKS,
     "law mpc: setting \"delay\" must be 2 numbers, not 3"},
    {&apc_law_mpc,
     {3, 2, 2, 0},
     ROW("delay", 50),
     TANKS,
     "law mpc: measurement 1: no output moves it within the horizon of 20 periods, 10 s: it must be longer "
     "than the dead time"},
    {&apc_law_mpc,
     {3, 2, 2, 0},
     ROW("delay", 1, 2),
     SAMPLED,
     "law mpc: setting \"delay\": a model of its own has its \"delay\" itself"},
    {&apc_law_mpc,
     {3, 2, 2, 0},
     ROW("y_scale", 1, 0, 1),
     TANKS,
     "law mpc: setting \"y_scale\": each must be above 0"},
    {&apc_law_mpc,
     {3, 2, 2, 0},
     ROW("u_scale", 1, 1e300),
     TANKS,
     "law mpc: settings \"y_scale\" and \"u_scale\": deviations as large, as small or as far apart as these "
     "leave weights that nothing can be calculated with; give of each signal one that it really has, as a "
     "hundredth of its range"},
    {&apc_law_mpc,
     {3, 2, 2, 0},
     ROW("x_noise", 1, 1, 1),
     TANKS,
     "law mpc: setting \"x_noise\" must be 4 numbers, not 3"},
    {&apc_law_mpc,
     {3, 2, 2, 0},
     ROW("d_noise", 1, 1, 1),
     TANKS,
     "law mpc: setting \"d_noise\" must be 2 numbers, not 3"},
    {&apc_law_mpc,
     {3, 2, 2, 0},
     ROW("y_noise", 1, 0, 1),
     TANKS,
     "law mpc: setting \"y_noise\": the standard deviation of measurement 2's noise must be above 0: what "
     "its sensor cannot tell apart, if nothing else"},
    {&apc_law_mpc,
     {3, 2, 2, 0},
     ROW("hold", 1, 1, -1),
     TANKS,
     "law mpc: setting \"hold\": -1 is no number from 0 to 1e+300"},
    {&apc_law_mpc,
     {3, 2, 2, 0},
     ROW("economic", 1, 0, 1),
     TANKS,
     "law mpc: setting \"economic\": measurement 3 has no setpoint, which is what a unit of it costs: give "
     "it "
     "one"},
    {&apc_law_mpc,
     {3, 2, 2, 0},
     ROW("critical", 0, 0, 2),
     TANKS,
     "law mpc: setting \"critical\": 2 is no whole number from 0 to 1"},
    {&apc_law_mpc,
     {3, 2, 2, 0},
     ROW("at_input", 1, 3),
     TANKS,
     "law mpc: setting \"at_input\": 3 is no whole number from 1 to 2"},
    {&apc_law_mpc,
     {3, 2, 2, 0},
     ROW("at_output", 1, 2, 3, 1),
     TANKS,
     "law mpc: settings \"at_input\" and \"at_output\": there may be 3 unknown disturbances, as many as "
     "measurements"},
    {&apc_law_mpc,
     {3, 2, 2, 0},
     ROW("at_output", 4),
     TANKS,
     "law mpc: setting \"at_output\": 4 is no whole number from 1 to 3"},
    {&apc_law_mpc,
     {3, 2, 2, 0},
     ROW("iterations", 1000001),
     TANKS,
     "law mpc: setting \"iterations\": 1000001 is no whole number from 1 to 1000000"},
    {&apc_law_nmpc,
     {3, 2, 2, 0},
     {0},
     NONE,
     "law nmpc: the plant's linear model is not known; give group plant a model, and the controller an "
     "operating_point, or a file with a model"},
    {&apc_law_nmpc,
     {3, 2, 2, 0},
     {0},
     TANKS,
     "law nmpc: the plant's equations are not known; give group plant a model, and the controller an "
     "operating_point"},
    {&apc_law_nmpc,
     {3, 2, 2, 0},
     ROW("steady", 1),
     TANKS,
     "law nmpc: setting \"steady\": an extended filter has no gain that stays; leave it out, or take law "
     "mpc, whose linear model has one"},
};

/*
 * Promise(laws/law-made-tuned): What a law cannot be made of, or tuned to, is said in a sentence, of which
 *   output, measurement and setting.
 */
static void it_is_said_what_a_law_cannot_be_made_of(void **state)
{
    size_t wrong = 0;
    (void)state;

    for (size_t i = 0; i < sizeof refusals / sizeof *refusals; i++) {
        const struct refusal *r = &refusals[i];
        struct apc_linear *sampled = NULL;
        const struct apc_law_setup setup = {.size = sizeof setup,
                                            .dim = r->dim,
                                            .Ts = 0.5,
                                            .n_setting = r->setting.name != NULL,
                                            .setting = &r->setting,
                                            .plant = model_of(r->model, &sampled)};
        struct apc_instances *law;
        struct apc_error why = {""};

        if (laws_make(&law, r->law, &setup, &why) == 0)
            snprintf(why.text, sizeof why.text, "it is taken");
        if (strcmp(why.text, r->says) != 0) {
            print_message("number %zu, law %s: %s\n", i, r->law->name, why.text);
            wrong++;
        }
        laws_end(NULL);
        apc_linear_destroy(sampled);
    }
    assert_int_equal(wrong, 0);
}

/* Two of each: of the second one, or of the law's own. */
static const struct {
    const struct apc_law *law;
    struct {
        size_t number;
        double value;
    } tuning[2];
    const char *says;
} tunings[] = {
    {&apc_law_pi, {{8, 3.0}, {9, 2.5}}, "output 2: u_min = 3 is above u_max = 2.5"},
    {&apc_law_pi, {{3, 3.0}, {4, 2.5}}, "output 1: u_min = 3 is above u_max = 2.5"},
    {&apc_law_pi, {{6, 0.0}}, "tau_i of output 2: 0 is not within 1e-06 to 1000000000"},
    {&apc_law_pi, {{5, 1e7}}, "Kp of output 2: 10000000 is not within -1000000 to 1000000"},
    {&apc_law_pid, {{20, 3.0}, {21, 2.5}}, "output 2: u_min = 3 is above u_max = 2.5"},
    {&apc_law_pid, {{15, 0.5}}, "N of output 2: 0.5 is not within 1 to 1000000"},
    {&apc_law_pid, {{16, 10.5}}, "b of output 2: 10.5 is not within 0 to 10"},
    {&apc_law_cascade, {{30, 3.0}, {31, 2.5}}, "output 2: outer_u_min = 3 is above outer_u_max = 2.5"},
    {&apc_law_cascade, {{41, 3.0}, {42, 2.5}}, "output 2: inner_u_min = 3 is above inner_u_max = 2.5"},
    {&apc_law_cascade, {{34, -1.0}}, "inner_tau_i of output 2: -1 is not within 0 to 1000000000"},
    {&apc_law_filter, {{4, 3.0}, {5, 2.5}}, "output 2: valid_low = 3 is above valid_high = 2.5"},
    {&apc_law_ramp, {{4, 3.0}, {5, 2.5}}, "output 2: z_min = 3 is above z_max = 2.5"},
    {&apc_law_split, {{4, 3.0}, {5, 3.0}}, "output 2: from = 3 is not below to = 3"},
    {&apc_law_leadlag, {{6, -1.0}}, "T_lag of output 2: -1 is not within 0 to 1000000000"},
    {&apc_law_lqg, {{4, 3.0}, {5, 2.5}}, "output 2: u_min = 3 is above u_max = 2.5"},
    {&apc_law_lqg, {{6, -1.0}}, "tau_b of output 2: -1 is not within 0 to 1000000000"},
    {&apc_law_mpc, {{11, 3.0}, {12, 2.5}}, "output 2: u_min = 3 is above u_max = 2.5"},
    {&apc_law_mpc, {{21, 3.0}, {22, 2.5}}, "measurement 2: y_min = 3 is above y_max = 2.5"},
    {&apc_law_mpc, {{7, 0.0}}, "move_suppression of output 2: 0 is not within 1e-06 to 1000000"},
    {&apc_law_mpc, {{19, 2e6}}, "weight of measurement 2: 2000000 is not within 0 to 1000000"},
    {&apc_law_mpc, {{23, 1.5}}, "service of measurement 2: 1.5 is not within 0 to 1"},
};

/* Promise(laws/law-made-tuned) */
static void it_is_said_what_a_law_cannot_be_tuned_to(void **state)
{
    size_t wrong = 0;
    (void)state;

    for (size_t i = 0; i < sizeof tunings / sizeof *tunings; i++) {
        const struct apc_law *of = tunings[i].law;
        const struct apc_setting select = TEXT("select", "low");
        const bool blocks = of == &apc_law_filter || of == &apc_law_split;
        const struct apc_law_setup setup = {.size = sizeof setup,
                                            .dim = {of == &apc_law_cascade ? 4 : 2, blocks ? 0 : 2, 2, 0},
                                            .Ts = 0.5,
                                            .setting = &select,
                                            .plant = model_of(TANKS, NULL)};
        struct apc_instances *law;
        struct apc_error why = {"it is taken"};
        double tuning[TUNING_MOST];

        if (laws_make(&law, of, &setup, &why) < 0)
            fail_msg("%s", why.text);
        for (size_t k = 0; k < apc_instances_size(law).tuning; k++)
            tuning[k] = of->tuning[apc_instances_parameter(law, k).number].initial;
        assert_int_equal(apc_instances_check(law, tuning, &why), 0);
        for (size_t k = 0; k < 2; k++) {
            if (tunings[i].tuning[k].number > 0)
                tuning[tunings[i].tuning[k].number] = tunings[i].tuning[k].value;
        }
        (void)apc_instances_check(law, tuning, &why);
        if (strcmp(why.text, tunings[i].says) != 0) {
            print_message("number %zu, law %s: %s\n", i, of->name, why.text);
            wrong++;
        }
        laws_end(NULL);
    }
    assert_int_equal(wrong, 0);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test_teardown(it_is_said_what_a_law_cannot_be_made_of, laws_end),
        cmocka_unit_test_teardown(it_is_said_what_a_law_cannot_be_tuned_to, laws_end),
    };

    return cmocka_run_group_tests(tests, NULL, NULL);
}

/* SPDX-License-Identifier: BSD-3-Clause */
/*
 * Glucose and insulin of a person with type 1 diabetes: cc -shared -fPIC -o pancreas.so pancreas.c -lm
 *
 * The model of Hovorka et al., Nonlinear model predictive control of glucose concentration in subjects with
 * type 1 diabetes, Physiol. Meas. 25, 2004, with its mean parameters. Rates in it are a minute's. The second
 * output is what a controller pays: the square of the distance from the target, above it as it is, below it
 * and below the least that is safe at a higher weight.
 */
#include <apcplant.h>
#include <math.h>

#define MEAL u[1] /* disturbances come after the inputs */

#define MINUTE    60.0    /* s */
#define K12       0.066   /* 1/min, from the second compartment of glucose to the first */
#define KA1       0.006   /* 1/min, decay of insulin's action: on transport, */
#define KA2       0.06    /* on disposal, */
#define KA3       0.03    /* on what the liver makes */
#define KE        0.138   /* 1/min, elimination of insulin */
#define V_INSULIN 0.12    /* L/kg */
#define V_GLUCOSE 0.16    /* L/kg */
#define EGP0      0.0161  /* mmol/kg/min, made by the liver without insulin */
#define F01       0.0097  /* mmol/kg/min, taken up without insulin */
#define TAU_MEAL  40.0    /* min, to the most of absorption */
#define TAU_DOSE  55.0    /* min, the same of insulin under the skin */
#define PART      0.8     /* of the carbohydrates that gets into the blood */
#define MOLE      0.18016 /* g/mmol */

enum { WEIGHT, S_TRANSPORT, S_DISPOSAL, S_LIVER, TARGET, SAFE, BELOW, UNSAFE, N_PARAM };
enum { D1, D2, S1, S2, I, X1, X2, X3, Q1, Q2, N_STATE };

/*                                      name       unit       description                initial low high */
static const struct apc_param param[N_PARAM] = {
    {"weight", "kg", "of the body", 70.0, 20.0, 200.0},
    {"S_transport", "L/mU/min", "sensitivity to insulin, of transport", 51.2e-4, 1e-4, 1.0},
    {"S_disposal", "L/mU/min", "of disposal", 8.2e-4, 1e-5, 1.0},
    {"S_liver", "L/mU", "of what the liver makes", 520e-4, 1e-3, 1.0},
    {"target", "mmol/L", "glucose wanted", 6.0, 4.0, 10.0},
    {"safe", "mmol/L", "least glucose that is safe", 4.0, 3.0, 6.0},
    {"below", "", "weight of what is below the target, 1 being that above it", 10.0, 0.0, 1e4},
    {"unsafe", "", "weight of what is below the least that is safe", 100.0, 0.0, 1e6}};
/* at rest with 6.43 mU/min */
static const struct apc_param state[N_STATE] = {
    {"D1", "mmol", "glucose in the stomach", 0.0, 0.0, 5e3},
    {"D2", "mmol", "glucose in the gut", 0.0, 0.0, 5e3},
    {"S1", "mU", "insulin under the skin, as given", 353.65, 0.0, 1e5},
    {"S2", "mU", "insulin under the skin, as taken up", 353.65, 0.0, 1e5},
    {"I", "mU/L", "insulin in the plasma", 5.54693, 0.0, 1e4},
    {"x1", "1/min", "its action on transport", 0.0284003, 0.0, 10.0},
    {"x2", "1/min", "its action on disposal", 0.00454848, 0.0, 10.0},
    {"x3", "", "its action on the liver", 0.28844, 0.0, 10.0},
    {"Q1", "mmol", "glucose where it is measured", 67.135, 0.0, 1e4},
    {"Q2", "mmol", "glucose elsewhere", 27.0261, 0.0, 1e4}};
static const struct apc_param input[] = {{"insulin", "mU/min", "infusion", 6.43, 0.0, 1000.0}};
static const struct apc_param disturbance[] = {{"meal", "g/min", "carbohydrates eaten", 0.0, 0.0, 100.0}};
static const struct apc_param output[] = {{"G", "mmol/L", "glucose in the plasma", 0.0, 0.0, 0.0},
                                          {"cost", "", "what is paid", 0.0, 0.0, 0.0}};

static int f(double t, const double *x, const double *u, const double *p, double *dx)
{
    const double volume = V_GLUCOSE * p[WEIGHT], glucose = x[Q1] / volume;
    const double taken = p[WEIGHT] * F01 * fmin(fmax(glucose, 0.0) / 4.5, 1.0),
                 kidney = 0.003 * fmax(glucose - 9.0, 0.0) * volume;

    dx[D1] = PART * MEAL / MOLE - x[D1] / TAU_MEAL;
    dx[D2] = (x[D1] - x[D2]) / TAU_MEAL;
    dx[S1] = u[0] - x[S1] / TAU_DOSE;
    dx[S2] = (x[S1] - x[S2]) / TAU_DOSE;
    dx[I] = x[S2] / TAU_DOSE / (V_INSULIN * p[WEIGHT]) - KE * x[I];
    dx[X1] = KA1 * (p[S_TRANSPORT] * x[I] - x[X1]);
    dx[X2] = KA2 * (p[S_DISPOSAL] * x[I] - x[X2]);
    dx[X3] = KA3 * (p[S_LIVER] * x[I] - x[X3]);
    dx[Q1] = x[D2] / TAU_MEAL + p[WEIGHT] * EGP0 * fmax(1.0 - x[X3], 0.0) - taken - kidney - x[X1] * x[Q1] +
             K12 * x[Q2];
    dx[Q2] = x[X1] * x[Q1] - (K12 + x[X2]) * x[Q2];
    for (int i = 0; i < N_STATE; i++)
        dx[i] /= MINUTE;
    return 0;
}

static double square_above(double value)
{
    return value > 0.0 ? value * value : 0.0;
}

static void g(double t, const double *x, const double *u, const double *p, double *y)
{
    y[0] = x[Q1] / (V_GLUCOSE * p[WEIGHT]);
    y[1] = square_above(y[0] - p[TARGET]) + p[BELOW] * square_above(p[TARGET] - y[0]) +
           p[UNSAFE] * square_above(p[SAFE] - y[0]);
}

const struct apc_model apc_model = {
    .abi = APC_MODEL_ABI,
    .name = "pancreas",
    .description = "glucose and insulin of a person with type 1 diabetes",
    .nx = N_STATE,
    .nu = 1,
    .nd = 1,
    .ny = 2,
    .np = N_PARAM,
    .param = param,
    .state = state,
    .input = input,
    .disturbance = disturbance,
    .output = output,
    .f = f,
    .g = g,
};

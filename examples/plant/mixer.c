/* SPDX-License-Identifier: BSD-3-Clause */
/* A tank in which hot and cold water mix, as docs/tuning.md finds it: cc -shared -fPIC -o mixer.so mixer.c
 * -lm */
#include <apcplant.h>
#include <math.h>

/* It has no parameters: what it is made of, nobody outside is told. */
#define AREA   0.02    /* m2 */
#define OUTLET 8.24e-5 /* m2 */
#define VALVE  2e-6    /* m3/s a per cent */
#define HOT    60.0    /* degC */
#define COLD   10.0
#define SENSOR 8.0 /* s, lag of the thermometer */

/*                                      name    unit    description                   initial low high */
static const struct apc_param state[] = {
    {"level", "m", "of the water", 0.3, 0.0, 1.0},
    {"water", "degC", "temperature of the water", 35.0, 0.0, 100.0},
    {"sensor", "degC", "temperature of the thermometer", 35.0, 0.0, 100.0}};
static const struct apc_param input[] = {{"hot", "%", "valve of the hot water", 50.0, 0.0, 100.0},
                                         {"cold", "%", "valve of the cold water", 50.0, 0.0, 100.0}};

static int f(double t, const double *x, const double *u, const double *p, double *dx)
{
    const double hot = VALVE * u[0], cold = VALVE * u[1], volume = AREA * fmax(x[0], 0.01);
    dx[0] = (hot + cold - OUTLET * sqrt(2.0 * 9.81 * fmax(x[0], 0.0))) / AREA;
    dx[1] = (hot * (HOT - x[1]) + cold * (COLD - x[1])) / volume;
    dx[2] = (x[1] - x[2]) / SENSOR;
    return 0;
}

static void g(double t, const double *x, const double *u, const double *p, double *y)
{
    y[0] = x[2];
    y[1] = 100.0 * x[0]; /* cm */
}

const struct apc_model apc_model = {
    .abi = APC_MODEL_ABI,
    .name = "mixer",
    .description = "hot and cold water in a tank",
    .nx = 3,
    .nu = 2,
    .ny = 2,
    .state = state,
    .input = input,
    .f = f,
    .g = g,
};

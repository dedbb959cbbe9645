/* SPDX-License-Identifier: BSD-3-Clause */
/* A tuning with the models that a record allows beside the most likely one. */
#include <apcbase.h>
#include <math.h>

#include "linear.h"

#define UNTOLD                                                                                               \
    (1.0 / 1.96)   /* standard errors of a number that the record does not tell: at least as wide as itself */
#define LEAST 0.05 /* of a lag, below which none is drawn */

static double draw_number(double value, double error, double least, struct apc_random *random)
{
    const double by = apc_random_normal(random) * (isfinite(error) ? error : UNTOLD * fabs(value));

    return value == 0.0 ? 0.0 : fmax(value + by, least);
}

static struct apc_transfer draw_model(const struct apc_transfer *g, const struct apc_transfer *error,
                                      struct apc_random *random)
{
    struct apc_transfer drawn = *g;

    drawn.gain = draw_number(g->gain, error->gain, -HUGE_VAL, random);
    drawn.zero = draw_number(g->zero, error->zero, -HUGE_VAL, random);
    drawn.dead_time = draw_number(g->dead_time, error->dead_time, 0.0, random);
    for (size_t i = 0; i < 2; i++)
        drawn.tau[i] = draw_number(g->tau[i], error->tau[i], LEAST * g->tau[i], random);
    return drawn;
}

int linear_worst(struct linear_worst *w, const struct apc_transfer *g, const struct apc_transfer *error,
                 const struct apc_pid_tuning *t, double Ts, struct apc_error *why)
{
    struct apc_margins worst = {.stable = true}, one = {.size = sizeof one};
    struct apc_random random;
    int rc = 0;

    *w = (struct linear_worst){.g = *g};
    apc_random_init(&random, 1, "worst"); /* the same models for each tuning */
    for (size_t i = 0; i < LINEAR_WORST_OF && rc == 0; i++) {
        const struct apc_transfer drawn = draw_model(g, error, &random);

        rc = apc_tune_margins(&drawn, t, Ts, &one, why);
        if (rc < 0)
            break;
        w->unstable += !one.stable;
        if (worst.stable ? !one.stable || one.sensitivity > worst.sensitivity
                         : !one.stable && fabs(drawn.gain) > fabs(w->g.gain)) {
            worst = one;
            w->g = drawn;
        }
    }
    return rc;
}

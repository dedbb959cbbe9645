/* SPDX-License-Identifier: BSD-3-Clause */
/* Your own controller: cc -shared -fPIC -o mylaw.so mylaw.c, then apc run FILE --law ./mylaw.so */
#include <apccontrol.h>

/* What the operator may tune:           name     unit  description         initial  low    high */
static const struct apc_param tuning[] = {{"Kp", "", "proportional gain", 0.25, -100.0, 100.0},
                                          {"tau_i", "s", "integral time", 10.0, 0.1, 1e6}};
enum { KP, TAU_I };

/* Its state is one number, the integral. */
static size_t n_state(const struct apc_dim *dim)
{
    (void)dim;
    return 1;
}

/* At each tick: measurement y, setpoint z and state x in, output u out. */
static int compute(struct apc_law_call *c)
{
    c->u[0] = c->tuning[KP] * (c->z[0] - c->y[0]) + c->x[0];
    return APC_LAW_GOOD;
}

/* The state from which compute gives u: no bump when an operator hands the output over. */
static void track(struct apc_law_call *c)
{
    c->x[0] = c->u[0] - c->tuning[KP] * (c->z[0] - c->y[0]);
}

/* The state of the next tick. u is what went out: where a limit cut it the integral does not wind up. */
static void update(struct apc_law_call *c)
{
    track(c);
    c->x[0] += c->tuning[KP] * c->Ts / c->tuning[TAU_I] * (c->z[0] - c->y[0]);
}

APC_LAW_EXPORT(.name = "mylaw", .description = "PI control", .n_tuning = 2, .tuning = tuning,
               .n_state = n_state, .compute = compute, .update = update, .track = track);

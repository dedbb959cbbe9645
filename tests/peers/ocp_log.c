/* SPDX-License-Identifier: BSD-3-Clause */
/*
 * ocp_log FILE [PATH=VALUE]...: the experiment in virtual time, with such settings, and on stdout every
 * program that its nonlinear predictive controller solves, as JSON, a line each, and at last ISE of each
 * loop. Linked with --wrap: what the law asks of the library comes by here.
 */
#include <apcrun.h>

#include <inttypes.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "base/base_internal.h"
#include "predict/mpc.h"
#include "predict/shooting.h"

int __real_apc_shooting_create(struct apc_shooting **shoot, const struct apc_shooting_options *options,
                               struct apc_error *why);
int __wrap_apc_shooting_create(struct apc_shooting **shoot, const struct apc_shooting_options *options,
                               struct apc_error *why);
int __real_apc_shooting_linearise(struct apc_shooting *shoot, const double *x, const double *d,
                                  const double *plan, const double *past, const double *nodes, double *G,
                                  double *free_y);
int __wrap_apc_shooting_linearise(struct apc_shooting *shoot, const double *x, const double *d,
                                  const double *plan, const double *past, const double *nodes, double *G,
                                  double *free_y);
int __real_apc_mpc_create(struct apc_mpc **mpc, const struct apc_mpc_options *options, struct apc_error *why);
int __wrap_apc_mpc_create(struct apc_mpc **mpc, const struct apc_mpc_options *options, struct apc_error *why);
int __real_apc_mpc_tune(struct apc_mpc *mpc, const struct apc_mpc_weights *weights, struct apc_error *why);
int __wrap_apc_mpc_tune(struct apc_mpc *mpc, const struct apc_mpc_weights *weights, struct apc_error *why);
void __real_apc_mpc_solve(struct apc_mpc *mpc, const struct apc_mpc_call *call, double *plan,
                          struct apc_mpc_result *result);
void __wrap_apc_mpc_solve(struct apc_mpc *mpc, const struct apc_mpc_call *call, double *plan,
                          struct apc_mpc_result *result);

static size_t nx, nu, ny, blocks, horizon, n_unknown; /* of the newest controller */

static void row(const char *name, const double *v, size_t n)
{
    printf(",\"%s\":[", name);
    for (size_t i = 0; i < n; i++)
        if (isfinite(v[i]))
            printf("%s%.17g", i ? "," : "", v[i]);
        else
            printf("%s%s", i ? "," : "", v[i] > 0.0 ? "1e400" : "-1e400");
    printf("]");
}

int __wrap_apc_shooting_create(struct apc_shooting **shoot, const struct apc_shooting_options *o,
                               struct apc_error *why)
{
    const struct apc_model *m = o->model;

    nx = m->nx;
    nu = m->nu;
    ny = m->ny;
    blocks = o->blocks;
    horizon = o->horizon;
    n_unknown = o->n_unknown;
    printf("{\"model\":\"%s\",\"Ts\":%.17g,\"steps\":%u,\"horizon\":%zu,\"block\":[", m->name, o->Ts,
           o->steps, horizon);
    for (size_t b = 0; b < blocks; b++)
        printf("%s%u", b ? "," : "", o->block[b]);
    printf("],\"unknown\":[");
    for (size_t k = 0; k < n_unknown; k++)
        printf("%s[%d,%zu]", k ? "," : "", o->unknown[k].where == APC_AT_INPUT, o->unknown[k].number);
    printf("],\"nominal\":[");
    for (size_t k = 0; k < m->nd; k++)
        printf("%s%.17g", k ? "," : "", m->disturbance[k].initial);
    printf("],\"p\":[");
    for (size_t k = 0; k < m->np; k++)
        printf("%s%.17g", k ? "," : "", o->p ? o->p[k] : m->param[k].initial);
    printf("]}\n");
    return __real_apc_shooting_create(shoot, o, why);
}

int __wrap_apc_shooting_linearise(struct apc_shooting *shoot, const double *x, const double *d,
                                  const double *plan, const double *past, const double *nodes, double *G,
                                  double *free_y)
{
    printf("{\"about\":0");
    row("x", x, nx);
    row("d", d, n_unknown);
    printf("}\n");
    return __real_apc_shooting_linearise(shoot, x, d, plan, past, nodes, G, free_y);
}

int __wrap_apc_mpc_create(struct apc_mpc **mpc, const struct apc_mpc_options *o, struct apc_error *why)
{
    if (o->terminal) {
        fprintf(stderr, "ocp_log: a terminal cost is not known here\n");
        exit(1);
    }
    return __real_apc_mpc_create(mpc, o, why);
}

int __wrap_apc_mpc_tune(struct apc_mpc *mpc, const struct apc_mpc_weights *w, struct apc_error *why)
{
    printf("{\"weights\":0");
    row("q", w->q, ny);
    row("s", w->s, nu);
    row("r", w->r, nu);
    row("zone", w->zone, ny);
    row("price", w->price ? w->price : w->zone, ny); /* zones are zeros, or refused */
    printf("}\n");
    return __real_apc_mpc_tune(mpc, w, why);
}

void __wrap_apc_mpc_solve(struct apc_mpc *mpc, const struct apc_mpc_call *call, double *plan,
                          struct apc_mpc_result *result)
{
    __real_apc_mpc_solve(mpc, call, plan, result);
    printf("{\"rc\":%d,\"given_up\":%u", result->rc, result->given_up);
    row("w", call->w, (horizon + 1) * ny);
    row("u_last", call->u_last, nu);
    row("reference", call->u_reference, nu);
    row("low", call->low, nu);
    row("high", call->high, nu);
    row("step", call->step, nu);
    row("y_low", call->y_low, ny);
    row("y_high", call->y_high, ny);
    row("plan", plan, nu * blocks);
    printf(",\"given\":%d}\n", call->given[0]);
}

static void tell_ise(const struct apc_simulation *s)
{
    struct apc_figure figure[64] = {{.size = sizeof *figure}};
    const int n = apc_simulation_figures(s, figure, 64);

    printf("{\"ise\":[");
    for (int i = 0, told = 0; i < n && i < 64; i++)
        if (!strcmp(figure[i].event, "all"))
            printf("%s%.17g", told++ ? "," : "", figure[i].ise);
    printf("]}\n");
}

int main(int argc, char **argv)
{
    struct apc_experiment *e = NULL;
    struct apc_simulation *s = NULL;
    struct apc_error why;
    int rc = argc > 1 ? apc_experiment_load(&e, argv[1], NULL, &why)
                      : apc_fail(&why, APC_EINVAL, "ocp_log FILE [PATH=VALUE]...");

    for (int i = 2; i < argc && rc == 0; i++) {
        char *value = strchr(argv[i], '=');

        if (value)
            *value++ = '\0';
        rc = value ? apc_experiment_set(e, argv[i], value, &why)
                   : apc_fail(&why, APC_EINVAL, "%s: PATH=VALUE was expected", argv[i]);
    }
    if (rc == 0)
        rc = apc_simulation_create(&s, e, NULL, &why);
    if (rc == 0 && (rc = apc_simulation_run(s, 0.0)) < 0)
        rc = apc_fail(&why, rc, "%s", apc_simulation_error(s));
    if (rc == 0)
        tell_ise(s);
    else
        fprintf(stderr, "%s\n", why.text);
    apc_simulation_destroy(s);
    apc_experiment_destroy(e);
    return rc < 0;
}

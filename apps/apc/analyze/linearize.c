/* SPDX-License-Identifier: BSD-3-Clause */
/* apc linearize: a plant's linear model at a point, and what control needs to know of it. */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include <apcplant.h>

#include "linearize.h"

struct own {
    bool here;
};

#define AT(member) .to = offsetof(struct own, member)
static const struct option_spec own_options[] = {
    {"here", 'H', NULL, "Linearise at the given states, even if they are not steady", OPTION_FLAG, AT(here)},
    {0},
};

static const struct cli_spec spec = {
    .args_doc = "PLANT [NAME=VALUE...]\nMODELFILE",
    .doc = "Show the linear model of PLANT, a built-in one, ./file.so, or ./file.fmu that shows its states "
           "and their derivatives, at a steady state: A, B, C, D, poles, zeros, gains, relative gains. "
           "NAME=VALUE sets a parameter, an input or a disturbance, or the value of a state from which the "
           "search for the steady state begins. The others keep the model's own values; see `apc plants "
           "PLANT`. For MODELFILE, as `apc identify` writes it, show the same of its model, and its dead "
           "times. Poles and zeros of a sampled model are in z.",
    .takes = CLI_FORMAT,
    .min_args = 1,
    .max_args = -1,
    .options = own_options,
};

struct analysis {
    const struct apc_model *model;
    size_t n_in; /* manipulated inputs and disturbances */
    double *memory, *p, *x, *u, *y, *a, *b, *c, *d, *manipulated, *feedthrough, *gain, *rga;
    double complex *pole, *zero;
    int n_zeros, gain_rc, rga_rc; /* or the error */
};

/* ---- The point ----------------------------------------------------------------------------- */

static int allocate_linearization(struct analysis *z)
{
    const struct apc_model *m = z->model;
    size_t nx = m->nx, nu = z->n_in = m->nu + m->nd, ny = m->ny;
    double *at = calloc(m->np + nx + nu + ny + nx * nx + 2 * nx * nu + ny * nx + 4 * ny * nu, sizeof *at);

    z->memory = at;
    z->pole = calloc(nx, sizeof *z->pole);
    z->zero = calloc(nx, sizeof *z->zero);
    if (!at || !z->pole || !z->zero)
        return APC_ENOMEM;
    z->p = at;
    z->x = z->p + m->np;
    z->u = z->x + nx;
    z->y = z->u + nu;
    z->a = z->y + ny;
    z->b = z->a + nx * nx;
    z->manipulated = z->b + nx * nu;
    z->c = z->manipulated + nx * nu;
    z->d = z->c + ny * nx;
    z->feedthrough = z->d + ny * nu;
    z->gain = z->feedthrough + ny * nu;
    z->rga = z->gain + ny * nu;
    for (size_t i = 0; i < m->np; i++)
        z->p[i] = m->param[i].initial;
    for (size_t i = 0; m->state && i < nx; i++)
        z->x[i] = m->state[i].initial;
    for (size_t i = 0; m->input && i < m->nu; i++)
        z->u[i] = m->input[i].initial;
    for (size_t i = 0; m->disturbance && i < m->nd; i++)
        z->u[m->nu + i] = m->disturbance[i].initial;
    return 0;
}

/* The variable of that name, its place in *value; those of a table that is none are x1, x2, ... */
static bool find_model_variable(const struct apc_param *table, char letter, size_t n, const char *name,
                                double *values, double **value, const struct apc_param **found)
{
    static const struct apc_param unnamed = {"value", "", "", 0, -APC_VALUE_MAX, APC_VALUE_MAX};
    for (size_t i = 0; i < n; i++) {
        char text[24];
        snprintf(text, sizeof text, "%c%zu", letter, i + 1);
        *value = &values[i];
        *found = table ? &table[i] : &unnamed;
        if (strcmp(table ? table[i].name : text, name) == 0)
            return true;
    }
    return false;
}

/* A parameter that is a text. */
static int set_text_parameter(const struct cli *cli, const struct analysis *z, const char *name,
                              const char *text)
{
    struct apc_error why;
    const int rc = apc_model_set_text(z->model, name, text, &why);

    if (rc == APC_ENOTFOUND)
        return cli_error(cli, rc, "%s has no \"%s\"; `apc plants %s` shows its names", z->model->name, name,
                         cli->args[0]);
    return rc < 0 ? cli_error(cli, rc, "%s", why.text) : EXIT_OK;
}

/* NAME=VALUE */
static int set_named_value(const struct cli *cli, struct analysis *z, const char *text)
{
    const struct apc_model *m = z->model;
    const struct apc_param *found;
    const char *equals = strrchr(text, '=');
    char name[1024];
    double *at, value;
    struct apc_error why;

    if (!equals)
        return cli_usage(cli, "\"%s\": expected NAME=VALUE", text);
    snprintf(name, sizeof name, "%.*s", (int)(equals - text), text);
    if (!find_model_variable(m->param, 'p', m->np, name, z->p, &at, &found) &&
        !find_model_variable(m->input, 'u', m->nu, name, z->u, &at, &found) &&
        !find_model_variable(m->disturbance, 'd', m->nd, name, z->u + m->nu, &at, &found) &&
        !find_model_variable(m->state, 'x', m->nx, name, z->x, &at, &found))
        return set_text_parameter(cli, z, name, equals + 1);
    const int rc = apc_model_word(m, found, equals + 1, &value, &why);
    if (rc == APC_EINVAL && apc_number_parse(equals + 1, &value) < 0)
        return cli_usage(cli, "\"%s\": expected NAME=VALUE with a finite number", text);
    if (rc < 0)
        return cli_error(cli, APC_EINVAL, "%s: %s", m->name, why.text);
    *at = value;
    return EXIT_OK;
}

static int linearize_at_point(const struct cli *cli, struct analysis *z, bool here)
{
    const struct apc_model *m = z->model;
    struct linear sys = {m->nx, m->nu, m->ny, z->a, z->manipulated, z->c, z->feedthrough};
    struct apc_error why;
    int rc = linear_load(&why);
    if (rc == 0 && !here)
        rc = apc_model_equilibrium(m, z->p, z->u, z->x, &why);
    if (rc == 0)
        rc = apc_model_linearize(m, z->p, z->x, z->u, z->a, z->b, z->c, z->d, &why);
    if (rc == 0)
        rc = apc_model_evaluate(m, z->p, z->x, z->u, NULL, z->y, &why);
    if (rc < 0)
        return cli_error(cli, rc, "%s", why.text);
    for (size_t i = 0; i < m->nx; i++)
        memcpy(z->manipulated + i * m->nu, z->b + i * z->n_in, m->nu * sizeof *z->b);
    for (size_t i = 0; i < m->ny; i++)
        memcpy(z->feedthrough + i * m->nu, z->d + i * z->n_in, m->nu * sizeof *z->d);
    rc = linear_poles(&sys, z->pole);
    if (rc < 0)
        return cli_error(cli, rc, "%s: the poles could not be computed", m->name);
    z->n_zeros = linear_zeros(&sys, z->zero);
    sys.nu = z->n_in; /* gains also of the disturbances */
    sys.b = z->b;
    sys.d = z->d;
    z->gain_rc = linear_gain(&sys, z->gain);
    z->rga_rc = APC_ESTATE;
    if (z->gain_rc == 0 && m->nu == m->ny) {
        for (size_t i = 0; i < m->ny; i++) /* feedthrough is done with: the gains of the manipulated inputs */
            memcpy(z->feedthrough + i * m->nu, z->gain + i * z->n_in, m->nu * sizeof *z->gain);
        z->rga_rc = linear_rga(z->feedthrough, m->nu, z->rga);
    }
    return EXIT_OK;
}

/* ---- Showing it ---------------------------------------------------------------------------- */

static void show_linearization(const struct cli *cli, const struct analysis *z, bool here)
{
    const struct apc_model *m = z->model;
    struct linearize_view v = {
        .name = m->name,
        .kind = "plant",
        .at = here ? "these states" : "its steady state",
        .nx = m->nx,
        .nu = m->nu,
        .nd = m->nd,
        .ny = m->ny,
        .x = z->x,
        .u = z->u,
        .y = z->y,
        .names_x = {.letter = 'x', .table = m->state, .n = m->nx},
        .names_u = {.letter = 'u', .table = m->input, .more = m->disturbance, .n = m->nu},
        .names_d = {.letter = 'd', .table = m->disturbance, .n = m->nd},
        .names_y = {.letter = 'y', .table = m->output, .n = m->ny},
        .n_matrices = z->gain_rc < 0                ? 4
                      : z->rga_rc < 0 || m->nu == 1 ? 5
                                                    : 6,
        .pole = z->pole,
        .zero = z->zero,
        .n_zeros = z->n_zeros,
        .integrates = z->gain_rc < 0,
    };
    const struct linearize_matrix all[] = {
        {"A", "A", z->a, m->nx, m->nx, &v.names_x, &v.names_x},
        {"B", "B", z->b, m->nx, z->n_in, &v.names_x, &v.names_u},
        {"C", "C", z->c, m->ny, m->nx, &v.names_y, &v.names_x},
        {"D", "D", z->d, m->ny, z->n_in, &v.names_y, &v.names_u},
        {"gain", "steady-state gain", z->gain, m->ny, z->n_in, &v.names_y, &v.names_u},
        {"rga", "relative gain array", z->rga, m->ny, m->nu, &v.names_y, &v.names_u},
    };

    memcpy(v.matrix, all, sizeof all);
    linearize_show(cli, &v);
}

int command_linearize(int argc, char **argv)
{
    struct own own = {0};
    struct analysis z = {0};
    struct apc_error why;
    struct cli cli;
    void *handle = NULL;

    cli_parse(&cli, &spec, &own, argc, argv);
    if (linearize_is_file(cli.args[0])) {
        if (own.here || cli.n_args > 1)
            return cli_usage(&cli, "%s is a model file, which has one operating point: %s", cli.args[0],
                             own.here ? "--here is of plants" : "NAME=VALUE is of plants");
        return cli_done(&cli, linearize_file(&cli));
    }
    int rc = apc_model_find(cli.args[0], &z.model, &handle, &why);
    if (rc == 0 && (rc = apc_model_equations(z.model, &z.model, &why)) < 0)
        apc_plugin_close(handle);
    if (rc < 0)
        return cli_error(&cli, rc, "%s", why.text);
    if (allocate_linearization(&z) < 0)
        rc = cli_error(&cli, APC_ENOMEM, "out of memory");
    for (int i = 1; i < cli.n_args && rc == EXIT_OK; i++)
        rc = set_named_value(&cli, &z, cli.args[i]);
    if (rc == EXIT_OK)
        rc = linearize_at_point(&cli, &z, own.here);
    if (rc == EXIT_OK)
        show_linearization(&cli, &z, own.here);
    free(z.memory);
    free(z.pole);
    free(z.zero);
    apc_plugin_close(handle);
    return cli_done(&cli, rc);
}

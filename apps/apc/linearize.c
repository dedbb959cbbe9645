/* SPDX-License-Identifier: BSD-3-Clause */
/* apc linearize: a plant's linear model at a point, and what control needs to know of it. */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include <apcplant.h>

#include "cli.h"
#include "linear.h"
#include "print.h"

struct own {
    bool here;
};

static const struct argp_option option_list[] = {
    {"here", 'H', NULL, 0, "Linearise at the states as they are given, whether or not they are at rest", 0},
    {0}};

static error_t parse(int key, char *arg, struct argp_state *state)
{
    struct own *own = state->input;
    (void)arg;
    if (key != 'H')
        return ARGP_ERR_UNKNOWN;
    own->here = true;
    return 0;
}

static const struct argp extra = {option_list, parse, NULL, NULL, NULL, NULL, NULL};

static const struct cli_spec spec = {
    .args_doc = "PLANT [NAME=VALUE...]",
    .doc =
        "Show the linear model of PLANT, a built-in one, ./file.so, or ./file.fmu that shows its states "
        "and their derivatives, at a steady state: A, B, C, D, poles, zeros, gains, relative gains. A NAME "
        "is that of a parameter, an input or a disturbance, which it sets, or "
        "of a "
        "state, which is where the search for the steady state begins. What is not named has the model's own "
        "value; see `apc plants PLANT`.",
    .takes = CLI_FORMAT,
    .min_args = 1,
    .max_args = -1,
    .extra = &extra,
};

struct analysis {
    const struct apc_model *model;
    size_t n_in; /* manipulated inputs and disturbances */
    double *memory, *p, *x, *u, *y, *a, *b, *c, *d, *manipulated, *feedthrough, *gain, *rga;
    double complex *pole, *zero;
    int n_zeros, gain_rc, rga_rc; /* or the error */
};

/* ---- The point ----------------------------------------------------------------------------- */

static int allocate(struct analysis *z)
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
static bool find(const struct apc_param *table, char letter, size_t n, const char *name, double *values,
                 double **value, const struct apc_param **found)
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

/* NAME=VALUE */
static int set(const struct cli *cli, struct analysis *z, const char *text)
{
    const struct apc_model *m = z->model;
    const struct apc_param *found;
    const char *equals = strchr(text, '=');
    char name[64];
    double *at, value;

    if (!equals || apc_number_parse(equals + 1, &value) < 0)
        return cli_usage(cli, "\"%s\": expected NAME=VALUE with a finite number", text);
    snprintf(name, sizeof name, "%.*s", (int)(equals - text), text);
    if (!find(m->param, 'p', m->np, name, z->p, &at, &found) &&
        !find(m->input, 'u', m->nu, name, z->u, &at, &found) &&
        !find(m->disturbance, 'd', m->nd, name, z->u + m->nu, &at, &found) &&
        !find(m->state, 'x', m->nx, name, z->x, &at, &found))
        return cli_error(cli, APC_ENOTFOUND, "%s has no \"%s\"; `apc plants %s` shows what it has", m->name,
                         name, cli->args[0]);
    if (value < found->low || value > found->high)
        return cli_error(cli, APC_EINVAL, "%s of %s is %g; it must lie in %g to %g", name, m->name, value,
                         found->low, found->high);
    *at = value;
    return EXIT_OK;
}

static int analyse(const struct cli *cli, struct analysis *z, bool here)
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

/* Names of one kind of variable, or of inputs and disturbances after them. */
struct names {
    char letter;
    const struct apc_param *table, *more; /* the first @n of table, then those of more */
    size_t n;
};

static const char *name_of(const struct names *names, size_t i, char text[24])
{
    bool first = i < names->n;
    const struct apc_param *table = first ? names->table : names->more;
    i -= first ? 0 : names->n;
    if (table)
        return table[i].name;
    snprintf(text, 24, "%c%zu", first ? names->letter : 'd', i + 1);
    return text;
}

static const char *unit_of(const struct names *names, size_t i)
{
    const struct apc_param *table = i < names->n ? names->table : names->more;
    const char *unit = table ? table[i < names->n ? i : i - names->n].unit : NULL;
    return unit ? unit : "";
}

struct matrix {
    const char *name, *title;
    const double *value;
    size_t rows, columns;
    const struct names *row, *column;
};
#define MATRICES 6

struct view {
    struct names x, u, y;
    struct matrix matrix[MATRICES];
    size_t n_matrices;
};

static void view_of(const struct analysis *z, struct view *v)
{
    const struct apc_model *m = z->model;
    v->x = (struct names){'x', m->state, NULL, m->nx};
    v->u = (struct names){'u', m->input, m->disturbance, m->nu};
    v->y = (struct names){'y', m->output, NULL, m->ny};
    const struct matrix all[] = {
        {"A", "A", z->a, m->nx, m->nx, &v->x, &v->x},
        {"B", "B", z->b, m->nx, z->n_in, &v->x, &v->u},
        {"C", "C", z->c, m->ny, m->nx, &v->y, &v->x},
        {"D", "D", z->d, m->ny, z->n_in, &v->y, &v->u},
        {"gain", "steady-state gain", z->gain, m->ny, z->n_in, &v->y, &v->u},
        {"rga", "relative gain array", z->rga, m->ny, m->nu, &v->y, &v->u},
    };
    memcpy(v->matrix, all, sizeof all);
    v->n_matrices = z->gain_rc < 0 ? 4 : z->rga_rc < 0 || m->nu == 1 ? 5 : 6;
}

static void matrix_text(const struct matrix *m)
{
    char text[24];
    printf("\n%-12s", m->title);
    if (strlen(m->title) > 12)
        printf("\n%-12s", "");
    for (size_t j = 0; j < m->columns; j++)
        printf(" %12s", name_of(m->column, j, text));
    putchar('\n');
    for (size_t i = 0; i < m->rows; i++) {
        printf("  %-10s", name_of(m->row, i, text));
        for (size_t j = 0; j < m->columns; j++)
            printf(" %12.6g", m->value[i * m->columns + j]);
        putchar('\n');
    }
}

static int by_real_part(const void *a, const void *b)
{
    const double complex *x = a, *y = b;
    if (creal(*x) != creal(*y))
        return creal(*x) < creal(*y) ? -1 : 1;
    return (cimag(*x) > cimag(*y)) - (cimag(*x) < cimag(*y));
}

/* One a line, a pair of conjugate ones on one. */
static void roots_text(const char *title, const double complex *root, int n)
{
    printf("\n%s, 1/s\n", title);
    for (int i = 0; i < n; i++) {
        double re = creal(root[i]), im = cimag(root[i]), size = cabs(root[i]);
        if (im < 0)
            continue;
        if (im > 0)
            printf("  %.6g +- %.6gi  natural frequency %.4g rad/s, damping %.4g\n", re, im, size, -re / size);
        else if (re < 0)
            printf("  %.6g  time constant %.4g s\n", re, -1.0 / re);
        else
            printf("  %.6g%s\n", re, re > 0 ? "  right half plane" : "  integrator");
    }
}

static void values_text(const char *title, const struct names *names, const double *value, size_t n)
{
    char text[24];
    for (size_t i = 0; i < n; i++)
        printf("  %-13s %-8s %12.6g %s\n", i ? "" : title, name_of(names, i, text), value[i],
               unit_of(names, i));
}

static void show_text(const struct analysis *z, const struct view *v, bool here)
{
    const struct apc_model *m = z->model;
    const struct names disturbances = {'d', m->disturbance, NULL, m->nd};

    printf("%s at %s\n", m->name, here ? "these states" : "its steady state");
    values_text("inputs", &v->u, z->u, m->nu);
    values_text("disturbances", &disturbances, z->u + m->nu, m->nd);
    values_text("states", &v->x, z->x, m->nx);
    values_text("outputs", &v->y, z->y, m->ny);
    for (size_t i = 0; i < 4; i++)
        matrix_text(&v->matrix[i]);
    roots_text("poles", z->pole, (int)m->nx);
    if (z->n_zeros > 0)
        roots_text("zeros", z->zero, z->n_zeros);
    else
        printf("\nzeros\n  %s\n", z->n_zeros == 0 ? "none"
                                  : z->n_zeros == APC_ESTATE
                                      ? "every number: the inputs do not act independently"
                                      : "could not be computed");
    if (z->gain_rc < 0)
        puts("\nsteady-state gain\n  none: the plant integrates");
    for (size_t i = 4; i < v->n_matrices; i++)
        matrix_text(&v->matrix[i]);
}

static void json_numbers(const double *value, size_t n)
{
    char text[PRINT_LEN];
    for (size_t i = 0; i < n; i++)
        printf("%s%s", i ? "," : "", print_exact(value[i], text));
}

static void json_roots(const char *key, const double complex *root, int n)
{
    char re[PRINT_LEN], im[PRINT_LEN];
    printf(",\n\"%s\":", key);
    if (n < 0)
        fputs("null", stdout);
    for (int i = 0; i < n; i++)
        printf("%s[%s,%s]", i ? "," : "[", print_exact(creal(root[i]), re), print_exact(cimag(root[i]), im));
    if (n >= 0)
        fputs(n ? "]" : "[]", stdout);
}

static void json_names(const char *key, const struct names *names, size_t n, const double *value)
{
    char text[24];
    printf(",\n\"%s\":{\"names\":[", key);
    for (size_t i = 0; i < n; i++) {
        fputs(i ? ",\"" : "\"", stdout);
        cli_json_text(stdout, name_of(names, i, text));
        putchar('"');
    }
    fputs("],\"values\":[", stdout);
    json_numbers(value, n);
    fputs("]}", stdout);
}

static void show_json(const struct analysis *z, const struct view *v)
{
    const struct apc_model *m = z->model;
    putchar('{');
    print_json_text(stdout, "plant", m->name);
    printf(",\"manipulated\":%zu,\"disturbances\":%zu", m->nu, m->nd);
    json_names("inputs", &v->u, z->n_in, z->u);
    json_names("states", &v->x, m->nx, z->x);
    json_names("outputs", &v->y, m->ny, z->y);
    for (size_t k = 0; k < v->n_matrices; k++) {
        const struct matrix *a = &v->matrix[k];
        printf(",\n\"%s\":[", a->name);
        for (size_t i = 0; i < a->rows; i++) {
            fputs(i ? ",[" : "[", stdout);
            json_numbers(a->value + i * a->columns, a->columns);
            putchar(']');
        }
        putchar(']');
    }
    json_roots("poles", z->pole, (int)m->nx);
    json_roots("zeros", z->zero, z->n_zeros);
    puts("}");
}

static void show_csv(const struct analysis *z, const struct view *v)
{
    char row[24], column[24], text[PRINT_LEN], im[PRINT_LEN];
    puts("what,row,column,value,imaginary");
    for (size_t k = 0; k < v->n_matrices; k++) {
        const struct matrix *a = &v->matrix[k];
        for (size_t i = 0; i < a->rows; i++)
            for (size_t j = 0; j < a->columns; j++)
                printf("%s,%s,%s,%s,\n", a->name, name_of(a->row, i, row), name_of(a->column, j, column),
                       print_exact(a->value[i * a->columns + j], text));
    }
    for (size_t i = 0; i < z->model->nx; i++)
        printf("pole,%zu,,%s,%s\n", i + 1, print_exact(creal(z->pole[i]), text),
               print_exact(cimag(z->pole[i]), im));
    for (int i = 0; i < z->n_zeros; i++)
        printf("zero,%d,,%s,%s\n", i + 1, print_exact(creal(z->zero[i]), text),
               print_exact(cimag(z->zero[i]), im));
}

int command_linearize(int argc, char **argv)
{
    struct own own = {0};
    struct analysis z = {0};
    struct view view;
    struct apc_error why;
    struct cli cli;
    void *handle = NULL;

    cli_parse(&cli, &spec, &own, argc, argv);
    int rc = apc_model_find(cli.args[0], &z.model, &handle, &why);
    if (rc == 0 && (rc = apc_model_equations(z.model, &z.model, &why)) < 0)
        apc_plugin_close(handle);
    if (rc < 0)
        return cli_error(&cli, rc, "%s", why.text);
    if (allocate(&z) < 0)
        rc = cli_error(&cli, APC_ENOMEM, "out of memory");
    for (int i = 1; i < cli.n_args && rc == EXIT_OK; i++)
        rc = set(&cli, &z, cli.args[i]);
    if (rc == EXIT_OK)
        rc = analyse(&cli, &z, own.here);
    if (rc == EXIT_OK) {
        qsort(z.pole, z.model->nx, sizeof *z.pole, by_real_part);
        if (z.n_zeros > 0)
            qsort(z.zero, (size_t)z.n_zeros, sizeof *z.zero, by_real_part);
        view_of(&z, &view);
        if (cli.format == CLI_JSON)
            show_json(&z, &view);
        else if (cli.format == CLI_CSV)
            show_csv(&z, &view);
        else
            show_text(&z, &view, own.here);
    }
    free(z.memory);
    free(z.pole);
    free(z.zero);
    apc_plugin_close(handle);
    return cli_done(&cli, rc);
}

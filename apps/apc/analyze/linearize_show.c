/* SPDX-License-Identifier: BSD-3-Clause */
#include "linearize.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "apc/common/print.h"
#include "base/complex.h"
#include "base/text.h"
#include "files/files.h"

static const char *linearized_name_of(const struct linearize_names *names, size_t i, char text[24])
{
    bool first = i < names->n;
    if (names->tag)
        return names->tag[i];
    const struct apc_param *table = first ? names->table : names->more;
    i -= first ? 0 : names->n;
    if (table)
        return table[i].name;
    snprintf(text, 24, "%c%zu", first ? names->letter : 'd', i + 1);
    return text;
}

static const char *unit_of(const struct linearize_names *names, size_t i)
{
    const struct apc_param *table = i < names->n ? names->table : names->more;
    const char *unit = table ? table[i < names->n ? i : i - names->n].unit : NULL;
    return unit ? unit : "";
}

static void matrix_text(const struct linearize_matrix *m)
{
    char text[24];
    printf("\n%-12s", m->title);
    if (strlen(m->title) > 12)
        printf("\n%-12s", "");
    for (size_t j = 0; j < m->columns; j++)
        printf(" %12s", linearized_name_of(m->column, j, text));
    putchar('\n');
    for (size_t i = 0; i < m->rows; i++) {
        printf("  %-10s", linearized_name_of(m->row, i, text));
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

/* What a root does in time. Of a sampled model it is z, and s = log(z) / period. */
static void root_text(double complex root, double period)
{
    const double complex at = period > 0 ? apc_clog(root) / period : root;
    const double re = creal(at), size = apc_cabs(at);
    const bool integrates = period > 0 ? apc_cabs(root - 1.0) < 1e-9 : size == 0;

    if (integrates)
        puts("  integrator");
    else if (re > 0)
        puts(period > 0 ? "  outside the unit circle" : "  right half plane");
    else if (cimag(root) != 0)
        printf("  natural frequency %.4g rad/s, damping %.4g\n", size, -re / size);
    else if (period > 0 && creal(root) < 0)
        puts("  alternates");
    else
        printf("  time constant %.4g s\n", -1.0 / re);
}

/* One a line, a pair of conjugate ones on one. */
static void roots_text(const char *title, const double complex *root, int n, double period)
{
    int gone = 0; /* at z = 0: samples that a sampled model waits */

    printf("\n%s, %s\n", title, period > 0 ? "z" : "1/s");
    for (int i = 0; i < n; i++) {
        const bool waits = period > 0 && root[i] == 0;

        gone += waits;
        if (waits || cimag(root[i]) < 0)
            continue;
        printf("  %.6g", creal(root[i]));
        if (cimag(root[i]) > 0)
            printf(" +- %.6gi", cimag(root[i]));
        root_text(root[i], period);
    }
    if (gone > 0)
        printf("  0  %d time%s: a sample's delay each\n", gone, PLURAL(gone));
}

static void values_text(const char *title, const struct linearize_names *names, const double *value, size_t n)
{
    char text[24];
    for (size_t i = 0; i < n; i++)
        printf("  %-13s %-8s %12.6g %s\n", i ? "" : title, linearized_name_of(names, i, text), value[i],
               unit_of(names, i));
}

static void show_linear_text(const struct linearize_view *v)
{
    printf("%s at %s", v->name, v->at);
    if (v->period > 0)
        printf(", sampled every %.9g s", v->period);
    putchar('\n');
    values_text("inputs", &v->names_u, v->u, v->nu);
    values_text("disturbances", &v->names_d, v->u + v->nu, v->nd);
    if (v->x)
        values_text("states", &v->names_x, v->x, v->nx);
    values_text("outputs", &v->names_y, v->y, v->ny);
    for (size_t i = 0; i < 4; i++)
        matrix_text(&v->matrix[i]);
    roots_text("poles", v->pole, (int)v->nx, v->period);
    if (v->n_zeros > 0)
        roots_text("zeros", v->zero, v->n_zeros, v->period);
    else
        printf("\nzeros\n  %s\n", v->n_zeros == 0 ? "none"
                                  : v->n_zeros == APC_ESTATE
                                      ? "every number: the inputs do not act independently"
                                      : "could not be computed");
    if (v->integrates)
        printf("\nsteady-state gain\n  none: the %s integrates\n", v->kind);
    for (size_t i = 4; i < v->n_matrices; i++)
        matrix_text(&v->matrix[i]);
}

static void linear_numbers_json(const double *value, size_t n, struct text *t)
{
    json_add(t, "[");
    for (size_t i = 0; i < n; i++)
        json_add(t, "%g", value[i]);
    json_add(t, "]");
}

static void json_roots(const char *key, const double complex *root, int n, struct text *t)
{
    json_add(t, n < 0 ? ",\n%s:null" : ",\n%s:[", key);
    for (int i = 0; i < n; i++)
        json_add(t, "[%g, %g]", creal(root[i]), cimag(root[i]));
    json_add(t, n < 0 ? "" : "]");
}

static void json_names(const char *key, const struct linearize_names *names, size_t n, const double *value,
                       struct text *t)
{
    char text[24];
    json_add(t, ",\n%s:{names:[", key);
    for (size_t i = 0; i < n; i++)
        json_add(t, "%s", linearized_name_of(names, i, text));
    json_add(t, "], values:");
    linear_numbers_json(value, value ? n : 0, t);
    json_add(t, "}");
}

static void show_linear_json(const struct linearize_view *v)
{
    struct text t = {.out = stdout};

    json_add(&t, "{%s:%s, manipulated:%zu, disturbances:%zu", v->kind, v->name, v->nu, v->nd);
    if (v->period > 0)
        json_add(&t, "period:%g", v->period);
    json_names("inputs", &v->names_u, v->nu + v->nd, v->u, &t);
    json_names("states", &v->names_x, v->nx, v->x, &t);
    json_names("outputs", &v->names_y, v->ny, v->y, &t);
    for (size_t k = 0; k < v->n_matrices; k++) {
        const struct linearize_matrix *a = &v->matrix[k];
        json_add(&t, ",\n%s:[", a->name);
        for (size_t i = 0; i < a->rows; i++)
            linear_numbers_json(a->value + i * a->columns, a->columns, &t);
        json_add(&t, "]");
    }
    json_roots("poles", v->pole, (int)v->nx, &t);
    json_roots("zeros", v->zero, v->n_zeros, &t);
    json_add(&t, "}\n");
}

static void show_linear_csv(const struct linearize_view *v)
{
    char row[24], column[24], text[PRINT_LEN], im[PRINT_LEN];
    puts("what,row,column,value,imaginary");
    for (size_t k = 0; k < v->n_matrices; k++) {
        const struct linearize_matrix *a = &v->matrix[k];
        for (size_t i = 0; i < a->rows; i++)
            for (size_t j = 0; j < a->columns; j++) {
                printf("%s,", a->name);
                csv_put(stdout, linearized_name_of(a->row, i, row));
                putchar(',');
                csv_put(stdout, linearized_name_of(a->column, j, column));
                printf(",%s,\n", print_exact(a->value[i * a->columns + j], text));
            }
    }
    for (size_t i = 0; i < v->nx; i++)
        printf("pole,%zu,,%s,%s\n", i + 1, print_exact(creal(v->pole[i]), text),
               print_exact(cimag(v->pole[i]), im));
    for (int i = 0; i < v->n_zeros; i++)
        printf("zero,%d,,%s,%s\n", i + 1, print_exact(creal(v->zero[i]), text),
               print_exact(cimag(v->zero[i]), im));
}

void linearize_show(const struct cli *cli, struct linearize_view *view)
{
    qsort(view->pole, view->nx, sizeof *view->pole, by_real_part);
    if (view->n_zeros > 0)
        qsort(view->zero, (size_t)view->n_zeros, sizeof *view->zero, by_real_part);
    if (cli->format == CLI_JSON)
        show_linear_json(view);
    else if (cli->format == CLI_CSV)
        show_linear_csv(view);
    else
        show_linear_text(view);
}

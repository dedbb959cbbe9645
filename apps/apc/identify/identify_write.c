/* SPDX-License-Identifier: BSD-3-Clause */
/* What was identified, as a file and as a figure. */
#include "identify.h"

#include <math.h>
#include <string.h>

#include "apc/common/print.h"
#include "apc/report/gnuplot.h"
#include "files/settings.h"

/* ---- The model file -------------------------------------------------------------------------------- */

/* libconfig takes a number without a point for an integer. */
static void put_libconfig_float(FILE *out, double value)
{
    char text[PRINT_LEN];

    print_exact(value, text);
    fprintf(out, "%s%s", text, strpbrk(text, ".e") ? "" : ".0");
}

static void put_array(FILE *out, const double *value, size_t n)
{
    fputc('[', out);
    for (size_t i = 0; i < n; i++) {
        fputs(i ? ", " : "", out);
        put_libconfig_float(out, value[i]);
    }
    fputc(']', out);
}

static void put_names_list(FILE *out, const char *key, const char (*name)[APC_TAG_LEN], size_t n)
{
    fprintf(out, "%s = [", key);
    for (size_t i = 0; i < n; i++) {
        fputs(i ? ", " : "", out);
        settings_put_text(out, name[i]);
    }
    fputs("];", out);
}

static void put_matrix(FILE *out, const char *key, const double *value, size_t rows, size_t columns)
{
    fprintf(out, "  %s = (", key);
    for (size_t i = 0; i < rows; i++) {
        fprintf(out, "%s", i ? ",\n       " : " ");
        put_array(out, value + i * columns, columns);
    }
    fputs(" );\n", out);
}

static void put_transfer(FILE *out, const struct identify_model *m, const struct identify_data *d)
{
    const size_t inputs = d->record.nu + d->record.nd;

    fputs("transfer = (", out);
    for (size_t i = 0, n = 0; i < d->record.ny * inputs; i++) {
        const struct apc_transfer *g = &m->g[i];

        if (g->gain == 0.0)
            continue;
        fprintf(out, "%s\n  { from = ", n++ ? "," : "");
        settings_put_text(out, d->input[i % inputs]);
        fputs("; to = ", out);
        settings_put_text(out, d->output[i / inputs]);
        fputs("; gain = ", out);
        put_libconfig_float(out, g->gain);
        if (g->tau[0] > 0.0) {
            fputs("; tau = ", out);
            put_array(out, g->tau, g->tau[1] > 0.0 ? 2 : 1);
        }
        if (g->zero != 0.0) {
            fputs("; zero = ", out);
            put_libconfig_float(out, g->zero);
        }
        fputs("; dead_time = ", out);
        put_libconfig_float(out, g->dead_time);
        fprintf(out, "%s; }", g->integrating ? "; integrating = true" : "");
    }
    fputs(" );\n", out);
}

/* What disturbs, as it was identified. */
static void put_filter(FILE *out, const struct apc_identified *m)
{
    const size_t ny = m->linear->ny;

    put_matrix(out, "K", m->K, m->linear->nx, ny);
    fputs("  error = [", out);
    for (size_t i = 0; i < ny; i++) {
        fputs(i ? ", " : "", out);
        put_libconfig_float(out, sqrt(m->covariance[i * (ny + 1)]));
    }
    fputs("];\n", out);
}

void identify_write(FILE *out, const struct identify_model *model, const struct identify_data *data)
{
    const struct apc_linear *m = model->linear;
    const size_t inputs = m->nu + m->nd;
    char untold[200];

    for (size_t p = 0; model->g && p < inputs * m->ny; p++)
        if (identify_untold(&model->g[p], &model->error[p], untold, sizeof untold))
            fprintf(out, "# %s to %s: the record does not tell %s\n", data->input[p % inputs],
                    data->output[p / inputs], untold);
    put_names_list(out, "inputs", data->input, inputs);
    fputc(' ', out);
    put_names_list(out, "outputs", data->output, m->ny);
    fputc('\n', out);
    if (model->g) {
        put_transfer(out, model, data);
    } else {
        fputs("state_space = {\n  period = ", out);
        put_libconfig_float(out, m->Ts);
        fputs(";\n", out);
        put_matrix(out, "A", m->A, m->nx, m->nx);
        put_matrix(out, "B", m->B, m->nx, inputs);
        put_matrix(out, "C", m->C, m->ny, m->nx);
        put_matrix(out, "D", m->D, m->ny, inputs);
        if (strcmp(model->kind, "subspace") == 0)
            put_filter(out, model->identified);
        fputs("};\n", out);
    }
    fputs("operating_point = { u = ", out);
    put_array(out, m->u0, inputs);
    fputs("; y = ", out);
    put_array(out, m->y0, m->ny);
    if (!model->g) {
        fputs("; x = ", out);
        put_array(out, m->x0, m->nx);
    }
    fputs("; };\n", out);
}

/* ---- The figure ------------------------------------------------------------------------------------ */

struct figure {
    const struct identify_model *model;
    const struct identify_data *data;
};

static void put_number(FILE *script, double value)
{
    if (isfinite(value))
        fprintf(script, " %.7g", value);
    else
        fputs(" NaN", script);
}

static void put_fit(FILE *script, void *ctx)
{
    const struct figure *f = ctx;
    const struct apc_record *r = &f->data->record;
    const size_t inputs = r->nu + r->nd;

    fprintf(script, "outputs = %zu\ninputs = %zu\nbegin = %.9g\nend = %.9g\n", r->ny, inputs, f->data->begin,
            f->data->begin + (double)r->n * r->Ts);
    fputs("array name[outputs + inputs]\narray fit[outputs]\n$record << END\n", script);
    for (size_t k = 0; k < r->n; k++) {
        fprintf(script, "%.9g", f->data->begin + (double)k * r->Ts);
        for (size_t i = 0; i < r->ny; i++) {
            put_number(script, r->y[k * r->ny + i]);
            put_number(script, f->model->run[k * r->ny + i]);
        }
        for (size_t j = 0; j < inputs; j++)
            put_number(script, r->u[k * inputs + j]);
        fputc('\n', script);
    }
    fputs("END\n", script);
    for (size_t i = 0; i < r->ny + inputs; i++)
        gnuplot_text(script, "name", i, i < r->ny ? f->data->output[i] : f->data->input[i - r->ny]);
    for (size_t i = 0; i < r->ny; i++)
        fprintf(script, "fit[%zu] = %.9g\n", i + 1, f->model->validation[i].fit);
}

int identify_figure(const char *name, const struct identify_model *model, const struct identify_data *data,
                    struct apc_error *why)
{
    struct figure f = {model, data};

    return gnuplot_figure(name, figure_fit, put_fit, &f, why);
}

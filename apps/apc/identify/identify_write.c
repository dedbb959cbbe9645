/* SPDX-License-Identifier: BSD-3-Clause */
/* What was identified, as a file and as a figure. */
#include "identify.h"

#include <math.h>
#include <string.h>

#include "apc/common/print.h"
#include "apc/report/gnuplot.h"
#include "apc/report/report_script.h"
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

void identify_write(FILE *out, const struct identify_model *model, const struct identify_data *data,
                    const char *comment)
{
    const struct apc_linear *m = model->linear;
    const size_t inputs = m->nu + m->nd;
    char untold[200];

    fputs(comment, out);
    for (size_t p = 0; model->g && p < inputs * m->ny; p++)
        if (identify_untold(model, p, untold, sizeof untold))
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

#define PANEL 185.0 /* height of one, in units of the page */
#define TOP   34.0
#define FOOT  20.0

struct figure {
    const struct identify_model *model;
    const struct identify_data *data;
};

static void put_fit_blocks(FILE *script, const struct figure *f)
{
    const struct apc_record *r = &f->data->record;

    for (size_t i = 0; i < r->ny; i++) {
        fprintf(script, "$y%zu << END\n", i);
        for (size_t k = 0; k < r->n; k++) {
            const double y = r->y[k * r->ny + i], run = f->model->run[k * r->ny + i];

            fprintf(script, "%.9g ", f->data->begin + (double)k * r->Ts);
            fprintf(script, isfinite(y) ? "%.7g " : "NaN ", y);
            fprintf(script, isfinite(run) ? "%.7g\n" : "NaN\n", run);
        }
        fputs("END\n", script);
    }
    fputs("$u << END\n", script);
    for (size_t k = 0; k < r->n; k++) {
        fprintf(script, "%.9g", f->data->begin + (double)k * r->Ts);
        for (size_t j = 0; j < r->nu + r->nd; j++)
            fprintf(script, " %.7g", r->u[k * (r->nu + r->nd) + j]);
        fputc('\n', script);
    }
    fputs("END\n", script);
}

static void begin_panel(FILE *script, const struct figure *f, size_t at, double height, const char *name)
{
    const struct apc_record *r = &f->data->record;
    const double top = TOP + PANEL * (double)at;

    fprintf(script, "%sset lmargin at screen 0.105\nset rmargin at screen 0.96\n", report_panel_style);
    fprintf(script, "set tmargin at screen %.4f\nset bmargin at screen %.4f\n", report_screen(top, height),
            report_screen(top + PANEL - 50.0, height));
    fprintf(script, "set xrange [%.9g:%.9g]\nset label 1 ", f->data->begin,
            f->data->begin + (double)r->n * r->Ts);
    report_quoted(script, name);
    fprintf(script, " at graph 0, screen %.4f noenhanced\nset key at graph 1, screen %.4f horizontal\n",
            report_screen(top - 12.0, height), report_screen(top - 12.0, height));
}

static void put_panels(FILE *script, const struct figure *f, double height)
{
    const struct apc_record *r = &f->data->record;
    const size_t inputs = r->nu + r->nd;

    for (size_t i = 0; i < r->ny; i++) {
        begin_panel(script, f, i, height, f->data->output[i]);
        fprintf(script,
                "plot $y%zu using 1:2 with lines lw 1 lc rgb 0x999999 title 'measured', "
                "$y%zu using 1:3 with lines lw 1.6 lc rgb 0x0072B2 title 'model, running freely: %.1f %%'\n",
                i, i, f->model->validation[i].fit);
    }
    for (size_t j = 0; j < inputs; j++) {
        begin_panel(script, f, r->ny + j, height, f->data->input[j]);
        if (j + 1 == inputs)
            fputs("set xlabel 'time (s)' offset 0, 0.4\n", script);
        fprintf(script, "plot $u using 1:%zu with steps lw 1.2 lc rgb 0xD55E00 notitle\n", j + 2);
    }
}

static double fit_figure_height(const struct apc_record *r)
{
    return TOP + FOOT + PANEL * (double)(r->ny + r->nu + r->nd);
}

static void put_fit_figure(FILE *script, void *ctx, bool first)
{
    const struct figure *f = ctx;

    if (first)
        put_fit_blocks(script, f);
    put_panels(script, f, fit_figure_height(&f->data->record));
}

int identify_figure(const char *name, const struct identify_model *model, const struct identify_data *data,
                    struct apc_error *why)
{
    struct figure f = {model, data};

    return gnuplot_figure(name, REPORT_WIDTH, fit_figure_height(&data->record), put_fit_figure, &f, why);
}

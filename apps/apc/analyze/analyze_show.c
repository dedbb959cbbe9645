/* SPDX-License-Identifier: BSD-3-Clause */
#include "analyze.h"

#include <apcmath.h>

#include <math.h>
#include <string.h>

#include "apc/common/print.h"
#include "apc/report/gnuplot.h"
#include "files/files.h"

#define CURVES 6
#define POLES  12

/* ---- For people ----------------------------------------------------------------------------- */

static void show_point(const struct loop_analysis *z)
{
    const struct apc_model *m = z->e.plant.model;
    printf("%s: %s\naround ", z->e.name, z->e.title);
    for (size_t i = 0; i < m->nu; i++)
        printf("%s%s %.5g", i ? ", " : "", z->e.u[i].tag.name, z->l.u[i]);
    for (size_t i = 0; i < m->ny; i++)
        printf("%s%s %.5g", i ? ", " : ": ", z->e.y[i].tag.name, z->l.y[i]);
    putchar('\n');
}

static void put_analysis_number(struct print_table *t, double value)
{
    if (isnan(value))
        print_cell(t, PRINT_PLAIN, "-");
    else if (isinf(value))
        print_cell(t, PRINT_PLAIN, "any");
    else
        print_cell(t, PRINT_PLAIN, "%.4g", value);
}

static int show_margins(const struct loop_analysis *z)
{
    static const struct print_column columns[] = {{"loop", PRINT_LEFT},
                                                  {"gain margin low", PRINT_POINT},
                                                  {"high", PRINT_POINT},
                                                  {"phase margin deg", PRINT_POINT},
                                                  {"delay margin s", PRINT_POINT},
                                                  {"jitter margin s", PRINT_POINT},
                                                  {"Ms", PRINT_POINT},
                                                  {"at rad/s", PRINT_POINT},
                                                  {"MT", PRINT_POINT},
                                                  {"crossover rad/s", PRINT_POINT}};
    struct print_table t;
    print_table_open(&t, columns, sizeof columns / sizeof *columns);
    for (size_t o = z->n == 1 ? 1 : 0; o <= z->n; o++) {
        const size_t at = z->n == 1 ? 0 : o;
        const struct apc_loop_margins *m = &z->loop[at].margins;
        print_cell(&t, PRINT_PLAIN, "%s", z->loop[at].name);
        put_analysis_number(&t, m->gain_low);
        put_analysis_number(&t, m->gain);
        put_analysis_number(&t, m->phase);
        put_analysis_number(&t, m->delay);
        put_analysis_number(&t, m->jitter);
        put_analysis_number(&t, m->sensitivity);
        put_analysis_number(&t, m->at);
        put_analysis_number(&t, m->complementary);
        put_analysis_number(&t, m->crossover);
    }
    return print_table_end(&t, stdout, cli_colour(), 0);
}

/* ---- What noise costs */

static const char *const cause_key[COST_CAUSES] = {"ideal", "period", "latency", "jitter", "loss"};

static int first_cause(const struct loop_analysis *z)
{
    return z->cost.known[COST_IDEAL] ? COST_IDEAL : COST_PERIOD;
}

/* In % of the ideal, the mean over the measurements that noise moves. */
static double costs(const struct loop_analysis *z, int cause)
{
    const int ideal = first_cause(z);
    double sum = 0.0;
    size_t n = 0;
    for (size_t i = 0; i < z->e.dim.ny; i++)
        if (z->cost.known[cause] && z->cost.known[ideal] && z->cost.y[ideal][i] > 0.0) {
            sum += 100.0 * (z->cost.y[cause][i] / z->cost.y[ideal][i] - 1.0);
            n++;
        }
    return n ? sum / (double)n : (double)NAN;
}

static void put_cause(struct print_table *t, const struct loop_analysis *z, int cause, size_t ny)
{
    const struct linear_loop *l = &z->l;
    switch (cause) {
    case COST_IDEAL:
        print_cell(t, PRINT_PLAIN, "%.0f times as often, at once", z->cost.faster);
        break;
    case COST_PERIOD:
        print_cell(t, PRINT_PLAIN, "as often as it ticks, at once");
        break;
    case COST_LATENCY:
        print_cell(t, PRINT_PLAIN, "%.4g s later", apc_ns_to_s(l->tick[0].acts - l->tick[0].sampled));
        break;
    case COST_JITTER:
        print_cell(t, PRINT_PLAIN, "not always as late");
        break;
    default:
        print_cell(t, PRINT_PLAIN, "frames are lost");
    }
    for (size_t i = 0; i < ny; i++) {
        if (z->cost.known[cause] && isfinite(z->cost.y[cause][i]))
            print_cell(t, PRINT_PLAIN, "%.5g", z->cost.y[cause][i]);
        else
            print_cell(t, PRINT_PLAIN, z->cost.known[cause] ? "unstable" : "-");
    }
    put_analysis_number(t, costs(z, cause));
    put_analysis_number(t, cause == first_cause(z) ? 0.0 : costs(z, cause) - costs(z, cause - 1));
}

static int show_loop_cost(const struct loop_analysis *z)
{
    struct print_column columns[PRINT_COLUMNS] = {{"mean square of", PRINT_LEFT}};
    const size_t ny = z->e.dim.ny < PRINT_COLUMNS - 3 ? z->e.dim.ny : PRINT_COLUMNS - 3;
    struct print_table t;
    for (size_t i = 0; i < ny; i++)
        columns[i + 1] = (struct print_column){z->e.y[i].tag.name, PRINT_POINT};
    columns[ny + 1] = (struct print_column){"costs %", PRINT_POINT};
    columns[ny + 2] = (struct print_column){"of it this", PRINT_POINT};
    fputs("\nunder the noise of the file, around its point", stdout);
    fputs(z->own.timing ? ", with the timing of the run\n" : "\n", stdout);
    print_table_open(&t, columns, ny + 3);
    for (int k = first_cause(z); k < COST_CAUSES; k++)
        put_cause(&t, z, k, ny);
    const int rc = print_table_end(&t, stdout, cli_colour(), 0);
    if (z->cost.unknown[0])
        printf("%s\n", z->cost.unknown);
    return rc;
}

/* As time constants, which people compare with the plant's; a pair of conjugate ones on one line. */
static void show_poles(const struct loop_analysis *z)
{
    const double T = apc_ns_to_s(z->l.setup.period);
    int shown = 0;
    printf("\npoles, sampled each %.5g s, the slowest first; states: %zu\n", T, z->states);
    for (size_t i = 0; i < z->states && shown < POLES; i++) {
        const double re = z->pole_re[i], im = z->pole_im[i], size = apc_hypot(re, im);
        const double decay = apc_log(size) / T, turn = apc_atan2(im, re) / T;
        if (size < 1e-9 || im < -1e-9 * size)
            continue;
        shown++;
        if (im > 1e-9 * size)
            printf("  %.6g +- %.6gi", re, im);
        else
            printf("  %.6g", re);
        if (size < 1.0)
            printf("  time constant %.4g s", -1.0 / decay);
        else
            fputs("  grows", stdout);
        if (im > 1e-9 * size)
            printf(", %.4g rad/s, damping %.3g", apc_hypot(decay, turn), -decay / apc_hypot(decay, turn));
        putchar('\n');
    }
}

static bool stable(const struct loop_analysis *z)
{
    return z->loop[z->n].margins.stable;
}

static int show_analysis(const struct loop_analysis *z)
{
    int rc = EXIT_OK;
    show_point(z);
    if (stable(z)) {
        if (show_margins(z) < 0)
            rc = cli_error(&z->cli, APC_ENOMEM, "out of memory");
    } else {
        rc = cli_error(
            &z->cli, APC_ESOLVER,
            "the closed loop is unstable around this point, so it has no margins: the unstable pole is the "
            "first below. Try less gain (--set PATH=VALUE), another point (--at), or apc optimize");
    }
    show_poles(z);
    if (z->noisy && show_loop_cost(z) < 0)
        rc = cli_error(&z->cli, APC_ENOMEM, "out of memory");
    if (z->own.figure)
        printf("\nfigure:  %s.svg, %s.png\n", z->own.figure, z->own.figure);
    return rc;
}

/* ---- For programs --------------------------------------------------------------------------- */

static void analysis_loop_json(const struct analysis_of_loop *l, struct text *t)
{
    const struct apc_loop_margins *m = &l->margins;
    const struct {
        const char *key;
        double value;
    } of[] = {{"gain_margin_low", m->gain_low},
              {"gain_margin_high", m->gain},
              {"phase_margin", m->phase},
              {"delay_margin", m->delay},
              {"jitter_margin", m->jitter},
              {"ms", m->sensitivity},
              {"ms_frequency", m->at},
              {"mt", m->complementary},
              {"crossover", m->crossover},
              /* the names before: for one more version */
              {"gain_least", m->gain_low},
              {"gain", m->gain},
              {"phase", m->phase},
              {"delay", m->delay},
              {"jitter", m->jitter},
              {"sensitivity", m->sensitivity},
              {"sensitivity_at", m->at},
              {"complementary", m->complementary}};
    json_add(t, "{loop:%s", l->name);
    for (size_t i = 0; i < sizeof of / sizeof *of && m->stable; i++)
        json_add(t, "%s:%g", of[i].key, of[i].value);
    json_add(t, "}");
}

static void json_cost(const struct loop_analysis *z, struct text *t)
{
    json_add(t, ",\nmean_square:{");
    for (int k = 0; k < COST_CAUSES; k++) {
        json_add(t, ",\n%s:{", cause_key[k]);
        for (size_t i = 0; i < z->e.dim.ny; i++)
            json_add(t, "%s:%g", z->e.y[i].tag.name, z->cost.known[k] ? z->cost.y[k][i] : (double)NAN);
        json_add(t, "}");
    }
    json_add(t, "}");
}

static int show_analysis_json(const struct loop_analysis *z)
{
    struct text t = {.out = stdout};
    json_add(&t, "{experiment:%s, stable:%i, period:%g, at:{", z->e.name, stable(z),
             apc_ns_to_s(z->l.setup.period));
    for (size_t i = 0; i < z->e.dim.nu; i++)
        json_add(&t, "%s:%g", z->e.u[i].tag.name, z->l.u[i]);
    for (size_t i = 0; i < z->e.dim.ny; i++)
        json_add(&t, "%s:%g", z->e.y[i].tag.name, z->l.y[i]);
    json_add(&t, "},\nloops:[");
    for (size_t o = 0; o <= z->n; o++) {
        json_add(&t, o < z->n ? ",\n" : "],\nall:");
        analysis_loop_json(&z->loop[o], &t);
    }
    json_add(&t, ",\npoles:[");
    for (size_t i = 0; i < z->states; i++)
        json_add(&t, "[%g, %g]", z->pole_re[i], z->pole_im[i]);
    json_add(&t, "]");
    if (z->noisy)
        json_cost(z, &t);
    json_add(&t, "}\n");
    return stable(z) ? EXIT_OK : EXIT_ERROR;
}

static int show_analysis_csv(const struct loop_analysis *z)
{
    char w[PRINT_LEN], re[PRINT_LEN], im[PRINT_LEN];
    puts("loop,rad_per_s,real,imaginary");
    for (size_t o = 0; o < z->n; o++)
        for (size_t k = 0; k < z->loop[o].points; k++)
            if (isfinite(z->loop[o].re[k])) {
                csv_put(stdout, z->loop[o].name);
                printf(",%s,%s,%s\n", print_exact(z->loop[o].w[k], w), print_exact(z->loop[o].re[k], re),
                       print_exact(z->loop[o].im[k], im));
            }
    return EXIT_OK;
}

int analyze_show(const struct loop_analysis *z)
{
    return z->cli.format == CLI_JSON  ? show_analysis_json(z)
           : z->cli.format == CLI_CSV ? show_analysis_csv(z)
                                      : show_analysis(z);
}

/* ---- The figure ----------------------------------------------------------------------------- */

static size_t curves_of(const struct loop_analysis *z)
{
    return z->n < CURVES ? z->n : CURVES;
}

/* w, |L|, phase that goes on where the principal value would jump, real, imaginary. */
static void put_bode_curve(FILE *script, const struct analysis_of_loop *l)
{
    double phase = (double)NAN;
    for (size_t k = 0; k < l->points; k++) {
        double angle = apc_atan2(l->im[k], l->re[k]) * 180.0 / M_PI;
        if (!isfinite(angle))
            continue;
        if (isnan(phase))
            phase = angle > 0.0 ? angle - 360.0 : angle;
        phase += remainder(angle - phase, 360.0);
        fprintf(script, "%.7g %.7g %.7g %.7g %.7g\n", l->w[k], apc_hypot(l->re[k], l->im[k]), phase, l->re[k],
                l->im[k]);
    }
}

static void put_bode(FILE *script, void *ctx)
{
    const struct loop_analysis *z = ctx;
    double peak = 0.0;
    fprintf(script, "loops = %zu\narray name[%d]\n", curves_of(z), CURVES);
    for (size_t o = 0; o < curves_of(z); o++) {
        peak = fmax(peak, z->loop[o].margins.sensitivity);
        gnuplot_text(script, "name", o, z->loop[o].name);
        fprintf(script, "$loop%zu << END\n", o + 1);
        put_bode_curve(script, &z->loop[o]);
        fputs("END\n", script);
    }
    fprintf(script, "radius = %.6g\n", peak > 0.0 ? 1.0 / peak : 1e-6);
    gnuplot_string(script, "title", z->e.title);
    gnuplot_string(script, "note",
                   z->n > CURVES ? "the first six loops"
                                 : "the circle that the curve keeps out of: 1 / peak");
}

int analyze_draw(const struct loop_analysis *z, struct apc_error *why)
{
    return gnuplot_figure(z->own.figure, figure_bode, put_bode, (void *)(uintptr_t)z, why);
}

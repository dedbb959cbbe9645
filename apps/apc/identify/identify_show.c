/* SPDX-License-Identifier: BSD-3-Clause */
/* What apc identify tells, for people and for programs. */
#include <math.h>
#include <stdio.h>
#include <string.h>

#include <apctune.h>

#include "analyze/linear.h"
#include "apc/common/print.h"
#include "files/files.h"
#include "identify.h"

/* How far output @p i goes in any record, in the share that was fitted to, or in what it is judged on. */
static double reach(const struct identification *z, size_t i, bool judged)
{
    const struct apc_record *all = &z->data.record;
    double most = 0.0;

    for (size_t g = 0; g < apc_record_runs(all); g++) {
        const struct apc_record r = apc_record_run(all, g);
        const size_t share = apc_record_share(all, &r, z->fitted);
        double low = HUGE_VAL, high = -HUGE_VAL;

        for (size_t k = judged ? share : 0; k < (judged ? r.n : share); k++) {
            if (isfinite(r.y[k * r.ny + i])) {
                low = fmin(low, r.y[k * r.ny + i]);
                high = fmax(high, r.y[k * r.ny + i]);
            }
        }
        most = fmax(most, high - low);
    }
    return most;
}

void identify_show_samples(const struct identification *z)
{
    const struct apc_record *r = &z->data.record;
    const size_t runs = apc_record_runs(r);

    for (size_t g = 0; g < runs && runs > 1; g++)
        printf("%s: %zu samples\n", z->cli.args[g], apc_record_run(r, g).n);
    printf("%s: %zu samples, one each %g s; ", runs > 1 ? "together" : z->cli.args[0], r->n, r->Ts);
    if (z->own.validate)
        printf("judged on %s, %zu samples\n", z->own.validate, z->other.record.n);
    else if (runs > 1)
        printf("fitted to the first %.0f %% of each, judged on the rest\n", 100.0 * z->own.share);
    else
        printf("fitted to the first %zu, judged on the other %zu\n", z->fitted, r->n - z->fitted);
}

/* Samples without all outputs at each @p step th time of the grid. */
static size_t gaps_at(const struct apc_record *r, size_t step)
{
    size_t gaps = 0;

    for (size_t g = 0; g < apc_record_runs(r); g++) {
        const struct apc_record run = apc_record_run(r, g);

        for (size_t k = 0; k < run.n; k += step) {
            size_t i = 0;

            while (i < run.ny && isfinite(run.y[k * run.ny + i]))
                i++;
            gaps += i < run.ny;
        }
    }
    return gaps;
}

/* Of a plant that moves in steps which the client's period is no multiple of. */
static void show_longer_period(const struct apc_record *r)
{
    if (gaps_at(r, 1) < r->n / 5)
        return;
    for (size_t step = 2; step <= 20; step++) {
        const size_t gaps = gaps_at(r, step);

        if (gaps * step < r->n / 100) {
            printf("model transfer needs no more; arx, subspace and fir do: with --period %g %s have one\n",
                   (double)step * r->Ts, gaps ? "nearly all" : "all");
            return;
        }
    }
}

static void show_record(const struct identification *z)
{
    const struct identify_data *d = &z->data;
    const struct apc_record *r = &d->record;

    identify_show_samples(z);
    for (size_t i = 0; i < r->ny; i++)
        if (d->gaps[i].missing)
            printf("%s: %zu of %zu instants have no sample, at most %zu in a row\n", d->output[i],
                   d->gaps[i].missing, r->n, d->gaps[i].longest);
    show_longer_period(r);
    for (size_t i = 0; i < r->ny && !z->own.validate; i++)
        if (reach(z, i, true) < 0.2 * reach(z, i, false))
            printf(
                "%s hardly moves in what is judged on: its fit says little; another --share may be better\n",
                d->output[i]);
    for (size_t i = 0; i < r->ny && z->own.validate; i++)
        if (!(z->model[z->chosen].validation[i].fit > 0.0))
            printf("%s: what fits %s says nothing of %s: are they records of one plant, around one point, in "
                   "the "
                   "same units?\n",
                   d->output[i], z->cli.args[0], z->own.validate);
    for (size_t j = 0; j < r->nu + r->nd; j++) {
        const int order = apc_record_excitation(r, j);
        if (order >= 0 && order < 10)
            printf("%s has %d frequenc%s only: what a model says of others is a guess\n", d->input[j], order,
                   order == 1 ? "y" : "ies");
    }
    for (size_t i = 0; i < z->warnings; i++)
        puts(z->warning[i].text);
}

static void put_probability(struct print_table *t, double p)
{
    print_cell(t, p < 0.01 ? PRINT_WARN : PRINT_PLAIN, p < 0.001 ? "< 0.001" : "%.3f", p);
}

static int show_models(const struct identification *z)
{
    static const struct print_column columns[] = {
        {"model", PRINT_LEFT},    {"of", PRINT_LEFT},     {"states", PRINT_RIGHT},     {"fit %", PRINT_POINT},
        {"ahead %", PRINT_POINT}, {"white", PRINT_POINT}, {"independent", PRINT_POINT}};
    struct print_table t;

    print_table_open(&t, columns, sizeof columns / sizeof *columns);
    for (int k = 0; k < KINDS; k++) {
        const struct identify_model *m = &z->model[k];

        for (size_t i = 0; m->linear && i < m->linear->ny; i++) {
            const struct apc_validation *v = &m->validation[i];

            print_cell(&t, PRINT_PLAIN, "%s", i ? "" : m->kind);
            print_cell(&t, PRINT_PLAIN, "%s", z->data.output[i]);
            if (i)
                print_cell(&t, PRINT_PLAIN, "%s", "");
            else
                print_cell(&t, PRINT_PLAIN, "%zu", m->linear->nx);
            print_cell(&t, v->fit < 50.0 ? PRINT_WARN : PRINT_PLAIN, "%.1f", v->fit);
            if (isnan(v->ahead))
                print_cell(&t, PRINT_PLAIN, "%s", "");
            else
                print_cell(&t, PRINT_PLAIN, "%.1f", v->ahead);
            put_probability(&t, v->white);
            put_probability(&t, v->independent);
        }
    }
    int rc = print_table_end(&t, stdout, cli_colour(), 0);
    for (int k = 0; k < KINDS; k++)
        if (z->model[k].kind && !z->model[k].linear) {
            const char *const why = z->model[k].why.text;
            const bool named = !strncmp(why, z->model[k].kind, strlen(z->model[k].kind));

            printf("no %s%s%s\n", named ? "" : z->model[k].kind, named ? "" : ": ", why);
        }
    return rc;
}

static void put_estimate(struct print_table *t, bool there, double value, double error)
{
    const double half = 1.96 * error;

    if (!there)
        print_cell(t, PRINT_PLAIN, "%s", "");
    else if (isnan(error))
        print_cell(t, PRINT_WARN, "%.4g ± ?", value);
    else if (half >= 99.5 && half < 1e6)
        print_cell(t, PRINT_PLAIN, "%.4g ± %.0f", value, half);
    else
        print_cell(t, PRINT_PLAIN, "%.4g ± %.2g", value, half);
}

bool identify_untold(const struct apc_transfer *g, const struct apc_transfer *e, char *text, size_t size)
{
    const struct {
        const char *name;
        bool untold;
    } number[] = {{"whether there is any effect", g->gain == 0.0},
                  {"the sign of the gain", g->gain != 0.0 && !(1.96 * e->gain < fabs(g->gain))},
                  {"tau", g->tau[0] > 0.0 && isnan(e->tau[0])},
                  {"the second tau", g->tau[1] > 0.0 && isnan(e->tau[1])},
                  {"the dead time", g->gain != 0.0 && isnan(e->dead_time)},
                  {"the zero", g->zero != 0.0 && isnan(e->zero)}};
    size_t at = 0;

    text[0] = '\0';
    for (size_t i = 0; i < sizeof number / sizeof *number && at < size; i++)
        if (number[i].untold)
            at += (size_t)snprintf(text + at, size - at, "%s%s", at ? ", " : "", number[i].name);
    return at > 0;
}

static bool any_untold(const struct identify_model *m, const struct identify_data *d)
{
    char text[200];
    bool any = false;

    for (size_t p = 0; m->g && p < d->record.ny * (d->record.nu + d->record.nd); p++)
        any |= identify_untold(&m->g[p], &m->error[p], text, sizeof text);
    return any;
}

static int show_pairs(const struct identification *z)
{
    static const struct print_column columns[] = {
        {"from", PRINT_LEFT}, {"to", PRINT_LEFT},          {"gain", PRINT_LEFT},   {"tau s", PRINT_LEFT},
        {"", PRINT_LEFT},     {"dead time s", PRINT_LEFT}, {"zero s", PRINT_LEFT}, {"", PRINT_LEFT}};
    const struct identify_model *m = &z->model[TRANSFER];
    const size_t inputs = z->data.record.nu + z->data.record.nd;
    char untold[200];
    struct print_table t;

    if (!m->linear)
        return 0;
    print_table_open(&t, columns, sizeof columns / sizeof *columns);
    for (size_t p = 0; p < inputs * z->data.record.ny; p++) {
        const struct apc_transfer *g = &m->g[p], *e = &m->error[p];

        print_cell(&t, PRINT_PLAIN, "%s", z->data.input[p % inputs]);
        print_cell(&t, PRINT_PLAIN, "%s", z->data.output[p / inputs]);
        if (g->gain == 0.0) { /* none that shows */
            for (size_t i = 0; i < 6; i++)
                print_cell(&t, i ? PRINT_PLAIN : PRINT_WARN, "%s", i ? "" : "none");
            continue;
        }
        put_estimate(&t, true, g->gain, e->gain);
        put_estimate(&t, g->tau[0] > 0.0, g->tau[0], e->tau[0]);
        put_estimate(&t, g->tau[1] > 0.0, g->tau[1], e->tau[1]);
        put_estimate(&t, true, g->dead_time, e->dead_time);
        put_estimate(&t, g->zero != 0.0, g->zero, e->zero);
        print_cell(&t, PRINT_PLAIN, "%s", g->integrating ? "integrating" : "");
    }
    puts("\ntransfer, with 95 % intervals");
    int rc = print_table_end(&t, stdout, cli_colour(), 0);
    for (size_t p = 0; p < inputs * z->data.record.ny; p++)
        if (identify_untold(&m->g[p], &m->error[p], untold, sizeof untold))
            printf("%s to %s: the record does not tell %s\n", z->data.input[p % inputs],
                   z->data.output[p / inputs], untold);
    for (size_t i = 0; i < z->data.record.ny; i++)
        if (m->validation[i].independent < IDENTIFY_TELLING)
            printf("of %s these intervals are too narrow: what the model leaves out is not noise alone, and "
                   "they know of "
                   "noise only. How well a number is known, models of two records tell\n",
                   z->data.output[i]);
    return rc;
}

static double period_of_suggestion(const struct identification *z)
{
    return z->controller > 0.0 ? z->controller : z->data.record.Ts;
}

/* Of pair @p p: PI, and PID where there is a second lag. False: there is none. */
static bool suggest_pid_for_pair(const struct identification *z, size_t p, bool derivative,
                                 struct apc_pid_tuning *t, struct apc_margins *m, struct apc_error *why)
{
    const struct apc_transfer *g = &z->model[TRANSFER].g[p];
    const double period = period_of_suggestion(z);

    why->text[0] = '\0';
    return (!derivative || g->tau[g->integrating ? 0 : 1] > 0.0) &&
           apc_tune_pid(g, APC_TUNE_SIMC, derivative, z->own.tau_c, period, t, why) == 0 &&
           linear_margins_of_pid(g, t, period, m, why) == 0;
}

static void put_margin(struct print_table *t, bool stable, double margin)
{
    if (stable && isfinite(margin))
        print_cell(t, PRINT_PLAIN, "%.3g", margin);
    else
        print_cell(t, stable ? PRINT_PLAIN : PRINT_WARN, "%s", stable ? "any" : "unstable");
}

static int show_tunings(const struct identification *z)
{
    static const struct print_column columns[] = {{"from", PRINT_LEFT},
                                                  {"to", PRINT_LEFT},
                                                  {"loop", PRINT_LEFT},
                                                  {"Kp", PRINT_POINT},
                                                  {"tau_i s", PRINT_POINT},
                                                  {"tau_d s", PRINT_POINT},
                                                  {"gain margin", PRINT_POINT},
                                                  {"phase margin deg", PRINT_POINT},
                                                  {"delay margin s", PRINT_POINT},
                                                  {"Ms", PRINT_POINT}};
    const size_t inputs = z->data.record.nu + z->data.record.nd;
    struct apc_pid_tuning tuning;
    struct apc_margins m;
    struct apc_error why;
    struct print_table t;

    if (!z->own.suggest || !z->model[TRANSFER].linear || inputs == 0)
        return 0;
    print_table_open(&t, columns, sizeof columns / sizeof *columns);
    for (size_t p = 0; p < inputs * z->data.record.ny; p++) {
        for (int derivative = 0; derivative < 2 && p % inputs < z->data.record.nu; derivative++) {
            if (!suggest_pid_for_pair(z, p, derivative, &tuning, &m, &why))
                continue;
            print_cell(&t, PRINT_PLAIN, "%s", z->data.input[p % inputs]);
            print_cell(&t, PRINT_PLAIN, "%s", z->data.output[p / inputs]);
            print_cell(&t, PRINT_PLAIN, "%s", derivative ? "PID" : "PI");
            print_cell(&t, PRINT_PLAIN, "%.4g", tuning.Kp);
            print_cell(&t, PRINT_PLAIN, "%.4g", tuning.tau_i);
            print_cell(&t, PRINT_PLAIN, derivative ? "%.4g" : "%.0g", tuning.tau_d);
            put_margin(&t, m.stable, m.gain);
            put_margin(&t, m.stable, m.phase);
            put_margin(&t, m.stable, m.delay);
            put_margin(&t, m.stable, m.sensitivity);
        }
    }
    printf("\nSIMC for a loop of each pair, with %s of %g s; margins of the model\n",
           z->controller > 0.0 ? "the record's controller" : "a controller, the period that of the record,",
           period_of_suggestion(z));
    int rc = print_table_end(&t, stdout, cli_colour(), 0);
    for (size_t p = 0; p < inputs * z->data.record.ny; p++)
        if (p % inputs < z->data.record.nu && !suggest_pid_for_pair(z, p, false, &tuning, &m, &why))
            printf("%s to %s: %s\n", z->data.input[p % inputs], z->data.output[p / inputs], why.text);
    return rc;
}

static void show_models_text(const struct identification *z)
{
    const struct identify_model *m = &z->model[z->chosen];
    bool hangs = false;

    show_record(z);
    if (show_models(z) < 0 || show_pairs(z) < 0 || show_tunings(z) < 0)
        cli_error(&z->cli, APC_ENOMEM, "out of memory");
    for (size_t i = 0; i < m->linear->ny; i++)
        hangs |= m->validation[i].independent < IDENTIFY_TELLING;
    if (z->own.kind != KINDS && any_untold(m, &z->data))
        printf("\n%s has numbers that the record does not tell", m->kind);
    else
        printf("\n%s: %s%s", z->own.kind == KINDS ? "the simplest of the best" : "taken", m->kind,
               any_untold(m, &z->data) ? ", with numbers that the record does not tell" : "");
    printf("%s\n", hangs ? ", but its errors hang on the inputs: what it leaves out may be another order, a "
                           "nonlinearity, or "
                           "an input that is not on record"
                         : "");
}

static void json_transfer(const char *key, const struct apc_transfer *g, struct text *t)
{
    json_add(t, "%s:{gain:%g, tau:[%g, %g], dead_time:%g, zero:%g, integrating:%i}", key, g->gain, g->tau[0],
             g->tau[1], g->dead_time, g->zero, g->integrating);
}

static void json_tunings(const struct identification *z, size_t p, struct text *out)
{
    struct apc_pid_tuning t;
    struct apc_margins m;
    struct apc_error why;

    json_add(out, "simc:[");
    for (int derivative = 0; derivative < 2; derivative++)
        if (suggest_pid_for_pair(z, p, derivative, &t, &m, &why)) {
            json_add(out, "{Kp:%g, tau_i:%g, tau_d:%g, gain_margin:%g, phase_margin:%g, delay_margin:%g",
                     t.Kp, t.tau_i, t.tau_d, m.gain, m.phase, m.delay);
            json_add(out, "sensitivity:%g, stable:%i}", m.sensitivity, m.stable);
        }
    json_add(out, "]");
}

static void json_model(const struct identification *z, const struct identify_model *m, struct text *t)
{
    const size_t inputs = z->data.record.nu + z->data.record.nd;

    json_add(t, "{model:%s", m->kind);
    if (!m->linear) {
        json_add(t, "error:%s}", m->why.text);
        return;
    }
    json_add(t, "states:%zu, outputs:[", m->linear->nx);
    for (size_t i = 0; i < m->linear->ny; i++) {
        const struct apc_validation *v = &m->validation[i];

        json_add(t, "{output:%s, fit:%g, ahead:%g, white:%g, independent:%g}", z->data.output[i], v->fit,
                 v->ahead, v->white, v->independent);
    }
    json_add(t, m->g ? "],\npairs:[" : "]");
    for (size_t p = 0; m->g && p < inputs * m->linear->ny; p++) {
        json_add(t, "{from:%s, to:%s", z->data.input[p % inputs], z->data.output[p / inputs]);
        json_transfer("value", &m->g[p], t);
        json_transfer("standard_error", &m->error[p], t);
        if (z->own.suggest && p % inputs < z->data.record.nu)
            json_tunings(z, p, t);
        json_add(t, "}");
    }
    json_add(t, m->g ? "]}" : "}");
}

static void show_models_json(const struct identification *z)
{
    struct text t = {.out = stdout};

    json_add(&t, "{records:[");
    for (size_t g = 0; g < apc_record_runs(&z->data.record); g++)
        json_add(&t, "{record:%s, samples:%zu}", z->cli.args[g], apc_record_run(&z->data.record, g).n);
    json_add(&t, "],");
    grid_warnings_json(z->warning, z->warnings, &t);
    json_add(&t, ", samples:%zu, fitted:%zu, period:%g, chosen:%s, models:[", z->data.record.n, z->fitted,
             z->data.record.Ts, z->model[z->chosen].kind);
    for (int k = 0; k < KINDS; k++) {
        if (!z->model[k].kind)
            continue;
        json_add(&t, ",\n");
        json_model(z, &z->model[k], &t);
    }
    json_add(&t, "]}\n");
}

static void show_models_csv(const struct identification *z)
{
    puts("model,output,fit,ahead,white,independent");
    for (int k = 0; k < KINDS; k++) {
        const struct identify_model *m = &z->model[k];

        for (size_t i = 0; m->linear && i < m->linear->ny; i++) {
            const double value[] = {m->validation[i].fit, m->validation[i].ahead, m->validation[i].white,
                                    m->validation[i].independent};

            printf("%s,", m->kind);
            csv_put(stdout, z->data.output[i]);
            for (size_t q = 0; q < 4; q++) {
                char text[PRINT_LEN];
                printf(",%s", isnan(value[q]) ? "" : print_exact(value[q], text));
            }
            putchar('\n');
        }
    }
}

void identify_show(const struct identification *z)
{
    if (z->cli.format == CLI_JSON)
        show_models_json(z);
    else if (z->cli.format == CLI_CSV)
        show_models_csv(z);
    else
        show_models_text(z);
}

static void show_signals_csv(const struct signal_figures *of, size_t n)
{
    puts("signal,samples,mean,deviation,low,high,strongest");
    for (size_t i = 0; i < n; i++) {
        const double value[] = {of[i].mean, of[i].deviation, of[i].low, of[i].high, of[i].every};

        csv_put(stdout, of[i].name);
        printf(",%zu", of[i].n);
        for (size_t q = 0; q < sizeof value / sizeof *value; q++) {
            char text[PRINT_LEN];
            printf(",%s", isnan(value[q]) ? "" : print_exact(value[q], text));
        }
        putchar('\n');
    }
}

int identify_show_signals(const struct identification *z)
{
    static const struct print_column columns[] = {{"signal", PRINT_LEFT},      {"samples", PRINT_POINT},
                                                  {"mean", PRINT_POINT},       {"deviation", PRINT_POINT},
                                                  {"low", PRINT_POINT},        {"high", PRINT_POINT},
                                                  {"strongest s", PRINT_POINT}};
    const struct apc_record *r = &z->data.record;
    struct signal_figures of[2 * IDENTIFY_SIGNALS];
    struct text json = {0};
    struct print_table table;
    int rc;

    json_add(&json, "{");
    rc = grid_signals(&z->data, &json, of);
    json_add(&json, "}");
    if (rc == 0 && json.failed)
        rc = APC_ENOMEM;
    if (rc == 0 && z->cli.format == CLI_JSON)
        printf("%.*s\n", (int)json.n, json.at);
    if (rc == 0 && z->cli.format == CLI_CSV)
        show_signals_csv(of, r->ny + r->nu + r->nd);
    if (rc == 0 && z->cli.format == CLI_TEXT) {
        print_table_open(&table, columns, sizeof columns / sizeof *columns);
        for (size_t i = 0; i < r->ny + r->nu + r->nd; i++) {
            print_cell(&table, PRINT_PLAIN, "%s", of[i].name);
            print_cell(&table, PRINT_PLAIN, "%zu", of[i].n);
            print_number(&table, 5, of[i].mean);
            print_number(&table, 4, of[i].deviation);
            print_number(&table, 5, of[i].low);
            print_number(&table, 5, of[i].high);
            print_number(&table, 4, of[i].every);
        }
        rc = print_table_end(&table, stdout, cli_colour(), 0);
    }
    text_free(&json);
    return rc < 0 ? cli_error(&z->cli, rc, "out of memory") : EXIT_OK;
}

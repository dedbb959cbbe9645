/* SPDX-License-Identifier: BSD-3-Clause */
/* apc identify --find, --likelihood: parameters and noise of the plant of an experiment file, from its record. */
#include "identify.h"

#include <apcmath.h>

#include <math.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>

#include "apc/common/print.h"
#include "experiment/experiment.h"
#include "files/files.h"

#define CONTRADICT 2.58 /* standard deviations: by chance in one of a hundred */

struct finding {
    struct identification *z;
    struct experiment e;
    const char *file; /* with the plant */
    size_t which[IDENTIFY_SIGNALS], input[IDENTIFY_SIGNALS], output[IDENTIFY_SIGNALS];
    double value[IDENTIFY_SIGNALS], error[IDENTIFY_SIGNALS], was[IDENTIFY_SIGNALS];
    struct apc_prior prior[IDENTIFY_SIGNALS];
    struct apc_prior
        alone[IDENTIFY_SIGNALS]; /* what the record says without that prior; deviation 0: nothing */
    struct apc_interval profile[IDENTIFY_SIGNALS];
    size_t noisy[IDENTIFY_SIGNALS]; /* states */
    struct apc_noise process[IDENTIFY_SIGNALS], measured[IDENTIFY_SIGNALS];
    double white[IDENTIFY_SIGNALS];
    struct apc_likelihood likelihood;
    struct identify_model model; /* with the free run and how it fits, for the figure */
};

/* ---- Whose plant it is ------------------------------------------------------------------------------- */

static int take_plant(struct finding *f, struct apc_error *why)
{
    const char *first = f->z->cli.args[0];
    struct stat what;

    f->file = f->z->own.plant ? f->z->own.plant : first;
    if (!f->z->own.plant && !(stat(first, &what) == 0 && S_ISDIR(what.st_mode)))
        return apc_fail(why, APC_EINVAL,
                        "%s is no run folder, so its plant is not known: name the experiment file that has "
                        "it by --plant FILE",
                        first);
    return experiment_load(&f->e, f->file, EXPERIMENT_MODEL, &(struct experiment_overrides){.law = NULL},
                           why);
}

static int take_parameters(struct finding *f, struct apc_error *why)
{
    const struct apc_model *m = f->e.plant.model;
    const struct identify_options *own = &f->z->own;

    if (!m)
        return apc_fail(why, APC_ENOTFOUND,
                        "%s names no model of its plant: name an experiment file that does by --plant FILE",
                        f->file);
    for (size_t i = 0; i < own->finds; i++) {
        size_t at = 0;

        while (at < m->np && strcmp(m->param[at].name, own->find[i]) != 0)
            at++;
        if (at == m->np && strcmp(own->find[i], "dead_time") != 0)
            return apc_fail(
                why, APC_ENOTFOUND,
                "%s has no parameter \"%s\"; apc plants %s shows those it has, and dead_time is one of "
                "every plant",
                m->name, own->find[i], m->name);
        f->which[i] = at;
        f->was[i] = at < m->np ? f->e.plant.p[at] : f->e.plant.options.dead_time;
    }
    return 0;
}

/* "K=2+-0.3" */
static int take_prior(struct finding *f, char *text, struct apc_error *why)
{
    const struct identify_options *own = &f->z->own;
    char *mean = strchr(text, '='), *deviation = mean ? strstr(mean, "+-") : NULL;
    struct apc_prior *prior;
    size_t i = 0;

    if (!deviation)
        return apc_fail(why, APC_EINVAL, "--prior \"%s\": must be NAME=MEAN+-DEVIATION, as K=2+-0.3", text);
    *mean++ = '\0';
    *deviation = '\0';
    deviation += strlen("+-");
    while (i < own->finds && strcmp(own->find[i], text) != 0)
        i++;
    if (i == own->finds)
        return apc_fail(why, APC_EINVAL, "--prior: --find does not name \"%s\"", text);
    prior = &f->prior[i];
    if (prior->deviation > 0.0)
        return apc_fail(why, APC_EINVAL, "--prior: %s has two", text);
    if (apc_number_parse(mean, &prior->mean) < 0 || apc_number_parse(deviation, &prior->deviation) < 0 ||
        !(prior->deviation > 0.0))
        return apc_fail(why, APC_EINVAL,
                        "--prior %s: \"%s+-%s\" must be two numbers, the deviation above 0, as 2+-0.3", text,
                        mean, deviation);
    return 0;
}

static int take_noisy_states(struct finding *f, struct apc_error *why)
{
    const struct apc_model *m = f->e.plant.model;
    const struct identify_options *own = &f->z->own;
    const size_t n = own->noisy ? own->noisy : m->nx;

    if (!m->state || n > IDENTIFY_SIGNALS)
        return apc_fail(why, APC_EINVAL, "--likelihood: %s must have 1 to %d states that have names", m->name,
                        IDENTIFY_SIGNALS);
    for (size_t i = 0; i < n; i++) {
        size_t at = own->noisy ? 0 : i;

        while (own->noisy && at < m->nx && strcmp(m->state[at].name, own->noisy_state[i]) != 0)
            at++;
        if (at == m->nx)
            return apc_fail(why, APC_ENOTFOUND,
                            "--likelihood: %s has no state \"%s\"; apc plants %s shows those it has", m->name,
                            own->noisy_state[i], m->name);
        f->noisy[i] = at;
    }
    f->likelihood = (struct apc_likelihood){.size = sizeof f->likelihood,
                                            .noisy = f->noisy,
                                            .n_noisy = n,
                                            .process = f->process,
                                            .measured = f->measured,
                                            .white = f->white,
                                            .profile = own->profile ? f->profile : NULL};
    return 0;
}

/* Which of the model's inputs, disturbances behind them, a signal of the record is. */
static int take_input(struct finding *f, size_t j, struct apc_error *why)
{
    const struct apc_model *m = f->e.plant.model;
    const char *name = f->z->data.input[j];

    for (size_t i = 0; i < m->nu; i++) {
        if (!strcmp(f->e.u[i].tag.name, name)) {
            f->input[j] = i;
            return 0;
        }
    }
    for (size_t i = 0; i < m->nd && m->disturbance; i++) {
        if (!strcmp(m->disturbance[i].name, name)) {
            f->input[j] = m->nu + i;
            return 0;
        }
    }
    return apc_fail(why, APC_ENOTFOUND,
                    "%s has no output or disturbance \"%s\": name those of the plant by --inputs", f->file,
                    name);
}

static int take_signals(struct finding *f, struct apc_error *why)
{
    const struct identify_data *d = &f->z->data;
    int rc = 0;

    for (size_t j = 0; j < d->record.nu + d->record.nd && rc == 0; j++)
        rc = take_input(f, j, why);
    for (size_t i = 0; i < d->record.ny && rc == 0; i++) {
        f->output[i] = 0;
        while (f->output[i] < f->e.dim.ny && strcmp(f->e.y[f->output[i]].tag.name, d->output[i]) != 0)
            f->output[i]++;
        if (f->output[i] == f->e.dim.ny)
            rc = apc_fail(why, APC_ENOTFOUND,
                          "%s has no measurement \"%s\": name those of the plant by --outputs", f->file,
                          d->output[i]);
    }
    return rc;
}

/* ---- Finding ------------------------------------------------------------------------------------------- */

/* % of each output in what was not fitted to, around its mean there. */
static void judge_found_parameters(struct finding *f)
{
    const struct apc_record *all = &f->z->data.record;

    for (size_t i = 0; i < all->ny; i++) {
        double left = 0.0, there = 0.0;

        for (size_t g = 0; g < apc_record_runs(all); g++) {
            const struct apc_record r = apc_record_run(all, g);
            const size_t share = apc_record_share(all, &r, f->z->fitted);
            const double *run = f->model.run + (apc_record_end(all, g) - r.n) * r.ny;
            double mean = 0.0, n = 0.0;

            for (size_t k = share; k < r.n; k++) {
                const double y = r.y[k * r.ny + i];

                mean += isfinite(y) ? y : 0.0;
                n += isfinite(y) != 0;
            }
            for (size_t k = share; k < r.n; k++) {
                const double y = r.y[k * r.ny + i];

                left += isfinite(y) ? apc_pow(y - run[k * r.ny + i], 2) : 0.0;
                there += isfinite(y) ? apc_pow(y - mean / n, 2) : 0.0;
            }
        }
        f->model.validation[i].fit = there > 0.0 ? 100.0 * (1.0 - sqrt(left / there)) : (double)NAN;
    }
}

/* Each prior beside what is found without it; where that cannot be found, there is nothing to compare. */
static int compare_priors(struct finding *f, struct apc_parameters sought, struct apc_error *why)
{
    struct apc_prior prior[IDENTIFY_SIGNALS];
    struct apc_noise process[IDENTIFY_SIGNALS], measured[IDENTIFY_SIGNALS];
    struct apc_likelihood likelihood = f->likelihood;
    double value[IDENTIFY_SIGNALS], error[IDENTIFY_SIGNALS];
    int rc = 0;

    likelihood.process = process;
    likelihood.measured = measured;
    likelihood.white = NULL;
    likelihood.profile = NULL;
    sought.prior = prior;
    for (size_t i = 0; i < sought.n && rc != APC_ENOMEM; i++) {
        if (!(f->prior[i].deviation > 0.0))
            continue;
        memcpy(prior, f->prior, sizeof prior);
        prior[i].deviation = 0.0;
        rc = f->z->own.likelihood
                 ? apc_identify_likelihood(&f->z->data.record, &sought, &likelihood, value, error, NULL, NULL,
                                           why)
                 : apc_identify_parameters(&f->z->data.record, &sought, value, error, NULL, NULL, why);
        if (rc == 0)
            f->alone[i] = (struct apc_prior){value[i], error[i]};
    }
    return rc == APC_ENOMEM ? rc : 0;
}

/* Prior without record, in standard deviations of what they differ by; NAN: they cannot be compared. */
static double prior_apart(const struct finding *f, size_t i)
{
    const struct apc_prior *prior = &f->prior[i], *alone = &f->alone[i];

    return alone->deviation > 0.0
               ? (prior->mean - alone->mean) / apc_hypot(prior->deviation, alone->deviation)
               : (double)NAN;
}

static int find_parameters(struct finding *f, struct apc_error *why)
{
    const struct apc_record *r = &f->z->data.record;
    struct apc_plant_options options = f->e.plant.options;
    struct apc_parameters sought = {.size = sizeof sought,
                                    .model = f->e.plant.model,
                                    .p = f->e.plant.p,
                                    .x0 = f->e.plant.x0,
                                    .plant = &options,
                                    .which = f->which,
                                    .n = f->z->own.finds,
                                    .prior = f->prior,
                                    .input = f->input,
                                    .output = f->output};
    int rc = take_plant(f, why);

    if (rc == 0)
        rc = take_parameters(f, why);
    for (size_t i = 0; i < f->z->own.priors && rc == 0; i++)
        rc = take_prior(f, f->z->own.prior[i], why);
    if (rc == 0)
        rc = take_signals(f, why);
    if (rc == 0 && f->z->own.likelihood)
        rc = take_noisy_states(f, why);
    if (rc < 0)
        return rc;
    options = f->e.plant.options;
    options.size = sizeof options;
    options.integrator = f->e.plant.integrator[0] ? f->e.plant.integrator : NULL;
    sought.model = f->e.plant.model;
    sought.p = f->e.plant.p;
    sought.x0 = f->e.plant.x0;
    sought.until = f->z->fitted = (size_t)((double)r->n * f->z->own.share);
    f->model.kind = sought.model->name;
    f->model.run = calloc(r->n * r->ny + 1, sizeof *f->model.run);
    if (!f->model.run)
        return apc_fail(why, APC_ENOMEM, "out of memory");
    rc =
        f->z->own.likelihood
            ? apc_identify_likelihood(r, &sought, &f->likelihood, f->value, f->error, NULL, f->model.run, why)
            : apc_identify_parameters(r, &sought, f->value, f->error, NULL, f->model.run, why);
    if (rc == 0)
        judge_found_parameters(f);
    return rc == 0 ? compare_priors(f, sought, why) : rc;
}

/* ---- Showing ------------------------------------------------------------------------------------------- */

static const struct apc_param *param_of(const struct finding *f, size_t i)
{
    static const struct apc_param dead_time = {.name = "dead_time", .unit = "s", .description = ""};
    const struct apc_model *m = f->e.plant.model;

    return f->which[i] < m->np ? &m->param[f->which[i]] : &dead_time;
}

/* "1 to 3"; an end that is not there, as "1 to -": within the parameter's limits the record tells none. */
static const char *profile_text(const struct finding *f, size_t i, char *text, size_t size)
{
    const struct apc_interval *of = &f->profile[i];
    char low[24] = "-", high[24] = "-";

    if (isfinite(of->low))
        snprintf(low, sizeof low, "%.5g", of->low);
    if (isfinite(of->high))
        snprintf(high, sizeof high, "%.5g", of->high);
    snprintf(text, size, "%s to %s", low, high);
    return text;
}

/* What noise is: @p value as its setting has it, and @p was; or NULL: there is no other one. */
struct noise_row {
    char setting[2 * APC_TAG_LEN];
    const char *of;
    double was;
    const struct apc_noise *found;
};

/* Of the states first, then of the measurements. */
static bool noise_row_of(const struct finding *f, size_t i, struct noise_row *row)
{
    const size_t n = f->likelihood.n_noisy;
    const bool state = i < n;

    if (!f->z->own.likelihood || i >= n + f->z->data.record.ny)
        return false;
    const size_t at = state ? f->noisy[i] : f->output[i - n];
    row->of = state ? f->e.plant.model->state[at].name : f->e.y[at].tag.name;
    row->found = state ? &f->process[i] : &f->measured[i - n];
    row->was = !state ? f->e.sensor[at].noise : f->e.plant.noise ? f->e.plant.noise[at] : 0.0;
    snprintf(row->setting, sizeof row->setting, state ? "plant.noise.%s" : "measurements.%s.noise", row->of);
    return true;
}

static double noise_of_state(const struct finding *f, size_t i)
{
    for (size_t k = 0; k < f->likelihood.n_noisy; k++)
        if (f->noisy[k] == i)
            return f->process[k].deviation;
    return 0.0;
}

/* Of one that is not on record that of the file. */
static double noise_of_measurement(const struct finding *f, size_t i)
{
    for (size_t k = 0; k < f->z->data.record.ny; k++)
        if (f->output[k] == i)
            return f->measured[k].deviation;
    return f->e.sensor[i].noise;
}

/* As settings of a law, which takes no measurement without noise. */
static void show_law_noise(const struct finding *f)
{
    size_t without = 0;

    fputs("for lqg, mpc, nmpc: --set 'controller.settings.x_noise=[", stdout);
    for (size_t i = 0; i < f->e.plant.model->nx; i++)
        printf("%s%.6g", i ? ", " : "", noise_of_state(f, i));
    while (without < f->e.dim.ny && noise_of_measurement(f, without) > 0.0)
        without++;
    for (size_t i = 0; i < f->e.dim.ny && without == f->e.dim.ny; i++)
        printf("%s%.6g", i ? ", " : "]' --set 'controller.settings.y_noise=[", noise_of_measurement(f, i));
    puts("]'");
    if (without < f->e.dim.ny)
        printf(
            "no noise of %s is found: give y_noise, which must be above 0, as what its sensor can resolve\n",
            f->e.y[without].tag.name);
}

static int show_noise_text(const struct finding *f)
{
    static const struct print_column columns[] = {{"noise of", PRINT_LEFT},
                                                  {"was", PRINT_POINT},
                                                  {"found", PRINT_POINT},
                                                  {"95 % interval", PRINT_LEFT}};
    struct print_table t;
    struct noise_row row;

    print_table_open(&t, columns, sizeof columns / sizeof *columns);
    for (size_t i = 0; noise_row_of(f, i, &row); i++) {
        const double by = apc_exp(1.96 * row.found->error);

        print_cell(&t, PRINT_PLAIN, "%s", row.of);
        print_cell(&t, PRINT_PLAIN, "%.4g", row.was);
        print_cell(&t, PRINT_PLAIN, "%.4g", row.found->deviation);
        if (isfinite(by))
            print_cell(&t, PRINT_PLAIN, "%.4g to %.4g", row.found->deviation / by, row.found->deviation * by);
        else
            print_cell(&t, PRINT_PLAIN, "cannot be told: it may be none");
    }
    puts("noise: standard deviation, of a state of its random walk in 1 s");
    int rc = print_table_end(&t, stdout, cli_colour(), 0);
    printf("log-likelihood %.10g", f->likelihood.value);
    for (size_t i = 0; i < f->z->data.record.ny; i++)
        printf("; %s white: %.3f", f->z->data.output[i], f->white[i]);
    putchar('\n');
    return rc;
}

static int show_found_text(const struct finding *f)
{
    static const struct print_column columns[] = {{"parameter", PRINT_LEFT},
                                                  {"was", PRINT_POINT},
                                                  {"found", PRINT_LEFT},
                                                  {"unit", PRINT_LEFT},
                                                  {"description", PRINT_LEFT}};
    const struct identify_data *d = &f->z->data;
    struct print_table t;
    struct noise_row row;
    char interval[60];

    identify_show_samples(f->z);
    print_table_open(&t, columns, sizeof columns / sizeof *columns);
    for (size_t i = 0; i < f->z->own.finds; i++) {
        const struct apc_param *p = param_of(f, i);

        print_cell(&t, PRINT_PLAIN, "%s", p->name);
        print_cell(&t, PRINT_PLAIN, "%.5g", f->was[i]);
        if (f->z->own.profile)
            print_cell(&t, PRINT_PLAIN, "%.5g, %s", f->value[i],
                       profile_text(f, i, interval, sizeof interval));
        else
            print_cell(&t, PRINT_PLAIN, "%.5g ± %.2g", f->value[i], 1.96 * f->error[i]);
        print_cell(&t, PRINT_PLAIN, "%s", p->unit ? p->unit : "");
        print_cell(&t, PRINT_PLAIN, "%s", p->description ? p->description : "");
    }
    printf("%s of %s, with 95 %% intervals\n", f->e.plant.model->name, f->file);
    int rc = print_table_end(&t, stdout, cli_colour(), 0);
    if (rc == 0 && f->z->own.likelihood)
        rc = show_noise_text(f);
    for (size_t i = 0; i < f->z->own.finds && rc == 0; i++)
        if (fabs(prior_apart(f, i)) > CONTRADICT)
            printf(
                "%s: record and prior contradict each other: the record says %.5g ± %.2g, the prior %.5g ± "
                "%.2g. What was found is a mean of both: look which is wrong\n",
                param_of(f, i)->name, f->alone[i].mean, 1.96 * f->alone[i].deviation, f->prior[i].mean,
                1.96 * f->prior[i].deviation);
    for (size_t i = 0; i < d->record.ny && rc == 0; i++)
        printf("%s: running freely the model says %.1f %% of what it was not fitted to\n", d->output[i],
               f->model.validation[i].fit);
    fputs("to try: apc simulate FILE", stdout);
    for (size_t i = 0; i < f->z->own.finds; i++)
        printf(" --set plant.%s%s=%.6g", f->which[i] < f->e.plant.model->np ? "parameters." : "",
               param_of(f, i)->name, f->value[i]);
    for (size_t i = 0; noise_row_of(f, i, &row); i++)
        printf(" --set %s=%.6g", row.setting, row.found->deviation);
    putchar('\n');
    if (f->z->own.likelihood)
        show_law_noise(f);
    return rc;
}

static void show_found_json(const struct finding *f)
{
    const struct identify_data *d = &f->z->data;
    struct text t = {.out = stdout};
    struct noise_row row;

    json_add(&t, "{samples:%zu, fitted:%zu, plant:%s, parameters:[", d->record.n, f->z->fitted,
             f->e.plant.model->name);
    for (size_t i = 0; i < f->z->own.finds; i++) {
        json_add(&t, "{parameter:%s, was:%g, value:%g, standard_error:%g", param_of(f, i)->name, f->was[i],
                 f->value[i], f->error[i]);
        if (f->prior[i].deviation > 0.0)
            json_add(&t, ", prior_apart:%g", prior_apart(f, i));
        if (f->z->own.profile)
            json_add(&t, ", interval:[%g,%g]", f->profile[i].low, f->profile[i].high);
        json_add(&t, "}");
    }
    json_add(&t, "], outputs:[");
    for (size_t i = 0; i < d->record.ny; i++) {
        json_add(&t, "{output:%s, fit:%g", d->output[i], f->model.validation[i].fit);
        if (f->z->own.likelihood)
            json_add(&t, ", white:%g", f->white[i]);
        json_add(&t, "}");
    }
    if (f->z->own.likelihood)
        json_add(&t, "], log_likelihood:%g, noise:[", f->likelihood.value);
    for (size_t i = 0; noise_row_of(f, i, &row); i++)
        json_add(&t, "{setting:%s, was:%g, value:%g, log_standard_error:%g}", row.setting, row.was,
                 row.found->deviation, row.found->error);
    json_add(&t, "]}\n");
}

static void put_found_row(const char *name, double was, double value, double error)
{
    char number[3][PRINT_LEN];

    csv_put(stdout, name);
    printf(",%s,%s,%s\n", print_exact(was, number[0]), print_exact(value, number[1]),
           print_exact(error, number[2]));
}

static void show_found_csv(const struct finding *f)
{
    struct noise_row row;

    puts("parameter,was,value,standard_error");
    for (size_t i = 0; i < f->z->own.finds; i++)
        put_found_row(param_of(f, i)->name, f->was[i], f->value[i], f->error[i]);
    for (size_t i = 0; noise_row_of(f, i, &row); i++)
        put_found_row(row.setting, row.was, row.found->deviation, row.found->error * row.found->deviation);
}

int identify_find(struct identification *z)
{
    struct finding *f = calloc(1, sizeof *f);
    struct apc_error why;
    int rc;

    if (!f)
        return cli_error(&z->cli, APC_ENOMEM, "out of memory");
    f->z = z;
    rc = find_parameters(f, &why);
    if (rc == 0 && z->own.figure)
        rc = identify_figure(z->own.figure, &f->model, &z->data, &why);
    if (rc == 0) {
        if (z->cli.format == CLI_JSON)
            show_found_json(f);
        else if (z->cli.format == CLI_CSV)
            show_found_csv(f);
        else
            rc = show_found_text(f) < 0 ? apc_fail(&why, APC_ENOMEM, "out of memory") : 0;
    }
    if (rc < 0)
        rc = cli_error(&z->cli, rc, "%s: %s", z->cli.args[0], why.text);
    experiment_free(&f->e);
    free(f->model.run);
    free(f);
    return rc;
}

/* SPDX-License-Identifier: BSD-3-Clause */
/* apc identify: models of a plant from its record. */
#include "identify.h"

#include <errno.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "apc/folder/folder.h"
#include "apc/operate/operate.h"
#include "common/storeuri.h"

static const char *const kinds[KINDS + 1] = {"transfer", "arx", "subspace", "fir", NULL};

#define AS_GOOD 1.0 /* % of fit by which a simpler model may be worse than the best */

/* ---- Options ----------------------------------------------------------------------------------------- */

static void parse_names(const struct argp_state *state, char *arg, char **names, size_t *n)
{
    for (char *name; (name = strsep(&arg, ","));) {
        if (!*name || strlen(name) >= APC_TAG_LEN || strchr(name, '\n'))
            argp_error(state, "\"%s\" is no name", name);
        if (*n == IDENTIFY_SIGNALS)
            argp_error(state, "more than %d names", IDENTIFY_SIGNALS);
        names[(*n)++] = name;
    }
}

static void take_inputs_option(void *options, char *arg, const struct argp_state *state)
{
    struct identify_selection *selection = &((struct identify_options *)options)->selection;
    if (selection->disturbances)
        argp_error(state, "--inputs go before --disturbances");
    parse_names(state, arg, selection->input, &selection->inputs);
}

static void take_disturbances_option(void *options, char *arg, const struct argp_state *state)
{
    struct identify_selection *selection = &((struct identify_options *)options)->selection;
    const size_t before = selection->inputs;
    parse_names(state, arg, selection->input, &selection->inputs);
    selection->disturbances += selection->inputs - before;
}

static void take_outputs_option(void *options, char *arg, const struct argp_state *state)
{
    struct identify_selection *selection = &((struct identify_options *)options)->selection;
    parse_names(state, arg, selection->output, &selection->outputs);
}

static void take_find_option(void *options, char *arg, const struct argp_state *state)
{
    struct identify_options *own = options;
    parse_names(state, arg, own->find, &own->finds);
}

static void take_prior_option(void *options, char *arg, const struct argp_state *state)
{
    struct identify_options *own = options;
    parse_names(state, arg, own->prior, &own->priors);
}

static void take_likelihood_option(void *options, char *arg, const struct argp_state *state)
{
    struct identify_options *own = options;
    own->likelihood = true;
    if (arg)
        parse_names(state, arg, own->noisy_state, &own->noisy);
}

static void take_suggest_option(void *options, char *arg, const struct argp_state *state)
{
    struct identify_options *own = options;
    own->suggest = true;
    own->tau_c = 0.0;
    if (arg && (apc_number_parse(arg, &own->tau_c) < 0 || !(own->tau_c >= 1e-9 && own->tau_c <= 1e9)))
        argp_error(state, "--suggest \"%s\": must be a number from 1e-09 to 1e+09", arg);
}

static void check_identify_options(void *input, const struct argp_state *state)
{
    const struct identify_options *own = input;
    const struct identify_selection *selection = &own->selection;
    if (own->order && own->kind != TRANSFER && own->kind != SUBSPACE)
        argp_error(state, "--order goes with --model transfer or --model subspace");
    if (own->suggest && own->kind != KINDS && own->kind != TRANSFER)
        argp_error(state, "--suggest goes with --model transfer, or without --model");
    const bool plant = own->finds || own->likelihood;
    if (own->signals &&
        (plant || own->kind != KINDS || own->suggest || own->output || own->validate || own->figure))
        argp_error(state, "--signals makes no model: nothing that is of models goes with it");
    if (own->priors && !own->finds)
        argp_error(state, "--prior is of parameters that --find names");
    if (own->profile && !(own->finds && own->likelihood))
        argp_error(state, "--profile is of --find with --likelihood");
    if (own->plant && !plant)
        argp_error(state, "--plant goes with --find or --likelihood");
    if (plant && (own->kind != KINDS || own->suggest || own->output || own->validate))
        argp_error(state, "%s finds parameters: no --model, --suggest, --output or --validate with it",
                   own->finds ? "--find" : "--likelihood");
    if (selection->disturbances && selection->disturbances == selection->inputs)
        argp_error(state, "--disturbances goes with --inputs: name those as well");
}

#define AT(member) .to = offsetof(struct identify_options, member)
static const struct option_spec own_options[] = {
    {"inputs", 0, "NAMES",
     "Inputs of the model, as v1,v2; default, of a run folder: all outputs of its controllers", OPTION_OWN,
     .take = take_inputs_option},
    {"disturbances", 0, "NAMES", "Measured disturbances: inputs that no controller moves", OPTION_OWN,
     .take = take_disturbances_option},
    {"outputs", 0, "NAMES", "Outputs of the model; default, of a run folder: all measurements", OPTION_OWN,
     .take = take_outputs_option},
    {"period", 0, "S", "Sampling period in s; default: that of the first output", OPTION_NUMBER,
     AT(selection.period), .low = 1e-6, .high = 1e6},
    {"from", 0, "TIME",
     "Use the record from TIME on: in s; of a store RFC 3339, or before now, as -30s, -10m, -2h, -1d",
     OPTION_TEXT, AT(from)},
    {"to", 0, "TIME", "Use the record up to TIME", OPTION_TEXT, AT(to)},
    {"share", 0, "X",
     "Fit to the first part of each record, the fraction X, and validate on the rest; default: 0.67",
     OPTION_NUMBER, AT(share), .low = 0.1, .high = 0.9},
    {"validate", 0, "FILE", "Fit to the whole records, and validate on this one", OPTION_TEXT, AT(validate)},
    {"model", 0, "KIND", "transfer, arx, subspace or fir; default: all, and the simplest of the best is used",
     OPTION_CHOICE, AT(kind), .choices = kinds, .must = "be transfer, arx, subspace or fir"},
    {"order", 0, "N",
     "Number of lags of transfer functions, 1 or 2, or of states of subspace; default: chosen by the fit",
     OPTION_COUNT, AT(order), .low = 1, .high = 50, .must = "be a whole number from 1 to 50"},
    {"output", 'o', "FILE", "Write the model to FILE, for a controller's \"model\"", OPTION_TEXT, AT(output)},
    {"figure", 0, "NAME", "Draw NAME.svg and NAME.png: measured and modelled outputs", OPTION_TEXT,
     AT(figure)},
    {"suggest", 0, "TAU_C",
     "SIMC tuning of a PID loop for each pair, with the closed-loop time constant TAU_C in s; default: the "
     "dead time",
     OPTION_OWN, .take = take_suggest_option, .optional = true},
    {"signals", 0, NULL,
     "No model, but figures of the signals: spread, extremes, the strongest period; with --json also "
     "histogram, "
     "spectrum, correlations, and pairs of points",
     OPTION_FLAG, AT(signals)},
    {"find", 0, "NAMES",
     "Estimate parameters of the plant's own model instead, as K,tau,dead_time, with 95 % confidence "
     "intervals",
     OPTION_OWN, .take = take_find_option},
    {"likelihood", 0, "STATES",
     "Estimate by maximum likelihood, with --find or alone, with noise of the measurements and of STATES; "
     "default: all states",
     OPTION_OWN, .take = take_likelihood_option, .optional = true},
    {"prior", 0, "LIST",
     "With --find: prior knowledge of parameters, mean and standard deviation, as K=2+-0.3,tau=10+-1",
     OPTION_OWN, .take = take_prior_option},
    {"profile", 0, NULL,
     "With --find and --likelihood: 95 % confidence intervals by the profile likelihood, which may be "
     "asymmetric",
     OPTION_FLAG, AT(profile)},
    {"plant", 0, "FILE", "With --find: the experiment file of the plant, if the record is not a run folder",
     OPTION_TEXT, AT(plant)},
    {"force", 0, NULL, "Overwrite these files", OPTION_FLAG, AT(force)},
    {0},
};

static const struct cli_spec spec = {
    .args_doc = "RUN|STORE|FILE.csv[@FROM..TO]...",
    .doc = "Find models of a plant in its record: run folder RUN, the store with the URI STORE, or CSV with "
           "a name above each column, one of them \"time\" in s. Several records, or windows FROM..TO of "
           "them, are fitted together, each around an operating point of its own. The models are transfer "
           "functions of first or second order with dead time, difference equations (arx), a state space "
           "(subspace) and finite impulse responses (fir). Each is fitted to the first part of each record "
           "and validated on the rest: how well its simulation fits, and whether its errors are white and "
           "independent of the inputs.",
    .takes = CLI_FORMAT,
    .min_args = 1,
    .max_args = -1,
    .options = own_options,
    .check = check_identify_options,
};

static const struct identify_data *judged_on(const struct identification *z)
{
    return z->own.validate ? &z->other : &z->data;
}

/* ---- Finding ----------------------------------------------------------------------------------------- */

static int fit_transfer(struct identify_model *m, const struct apc_record *r, unsigned order)
{
    const size_t inputs = r->nu + r->nd;
    const struct apc_identify_transfer_options options = {.size = sizeof options, .order = order};
    int rc;

    m->g = calloc(2 * inputs * r->ny, sizeof *m->g);
    m->u0 = calloc(apc_record_runs(r) * (inputs + r->ny) + 1, sizeof *m->u0);
    if (!m->g || !m->u0)
        return apc_fail(&m->why, APC_ENOMEM, "out of memory");
    m->error = m->g + inputs * r->ny;
    m->y0 = m->u0 + apc_record_runs(r) * inputs;
    rc = apc_identify_transfer(r, &options, m->g, m->error, m->u0, m->y0, NULL, &m->why);
    if (rc == 0)
        rc = apc_linear_from_transfer(&m->linear, r->ny, r->nu, r->nd, m->g, m->u0, m->y0, r->Ts, &m->why);
    return rc;
}

static int fit(struct identify_model *m, int kind, const struct apc_record *r, unsigned order)
{
    const struct apc_identify_arx_options arx = {.size = sizeof arx, .fir = kind == FIR};
    const struct apc_identify_subspace_options subspace = {.size = sizeof subspace, .order = order};
    int rc;

    m->kind = kinds[kind];
    if (kind == TRANSFER)
        return fit_transfer(m, r, order);
    rc = kind == SUBSPACE ? apc_identify_subspace(&m->identified, r, &subspace, &m->why)
                          : apc_identify_arx(&m->identified, r, &arx, &m->why);
    if (rc == 0) {
        m->linear = m->identified->linear;
        m->u0 = m->identified->u0;
        m->y0 = m->identified->y0;
    }
    return rc;
}

/* The free run, from around the first record's point to around each one's own. */
static void part(const struct apc_record *r, const double *y0, double *run)
{
    for (size_t g = 0; g < apc_record_runs(r); g++) {
        const size_t end = apc_record_end(r, g), begin = end - apc_record_run(r, g).n;

        for (size_t k = begin * r->ny; k < end * r->ny; k++)
            run[k] += y0[g * r->ny + k % r->ny] - y0[k % r->ny];
    }
}

static int judge_model(struct identification *z, struct identify_model *m)
{
    struct apc_record on = judged_on(z)->record;
    const size_t from = z->own.validate ? on.n / 10 : z->fitted;
    const bool several = on.runs > 1;
    double *moved = several ? apc_record_gather(&on, m->u0, m->y0) : NULL;
    int rc;

    m->run = calloc(on.n * on.ny, sizeof *m->run);
    if (!m->run || (several && !moved)) {
        free(moved);
        return apc_fail(&m->why, APC_ENOMEM, "out of memory");
    }
    rc = apc_validate(m->linear, m->identified ? m->identified->K : NULL, &on, from, m->validation, m->run,
                      &m->why);
    if (rc == 0 && several)
        part(&on, m->y0, m->run);
    for (size_t i = 0; i < on.ny && rc == 0; i++)
        m->fit += m->validation[i].fit / (double)on.ny;
    free(moved);
    return rc;
}

static void drop_model(struct identify_model *m)
{
    if (!m->identified) {
        apc_linear_destroy(m->linear);
        free(m->u0);
    }
    apc_identified_destroy(m->identified);
    free(m->g);
    free(m->run);
    *m = (struct identify_model){.kind = m->kind, .why = m->why};
}

/* The first that is as good as the best; KINDS: there is none. */
static int choose_model(const struct identification *z)
{
    double best = -HUGE_VAL;

    for (int k = 0; k < KINDS; k++)
        best = z->model[k].linear && z->model[k].fit > best ? z->model[k].fit : best;
    for (int k = 0; k < KINDS; k++)
        if (z->model[k].linear && z->model[k].fit >= best - AS_GOOD)
            return k;
    return KINDS;
}

static int find_candidate_models(struct identification *z)
{
    const size_t n = z->data.record.n;
    struct apc_record first;
    struct apc_error why;
    void *memory = NULL;
    int rc = apc_record_check(&z->data.record, &why);

    if (rc < 0)
        return cli_error(&z->cli, rc, "%s: %s", z->cli.args[0], why.text);
    z->fitted = z->own.validate ? n : (size_t)((double)n * z->own.share);
    rc = grid_first(&z->data.record, z->fitted, &first, &memory);
    for (int k = 0; k < KINDS && rc != APC_ENOMEM; k++) {
        struct identify_model *m = &z->model[k];

        if (z->own.kind != KINDS && z->own.kind != k)
            continue;
        rc = fit(m, k, &first, z->own.order);
        if (rc == 0)
            rc = judge_model(z, m);
        if (rc < 0)
            drop_model(m);
    }
    free(memory);
    if (rc == APC_ENOMEM)
        return cli_error(&z->cli, rc, "out of memory");
    z->chosen = choose_model(z);
    if (z->chosen < KINDS)
        return EXIT_OK; /* else none could be found: why the first could not */
    for (int k = 0; k < KINDS; k++)
        if (z->model[k].kind)
            return cli_error(&z->cli, APC_ESOLVER, "%s: %s", z->cli.args[0], z->model[k].why.text);
    return EXIT_ERROR;
}

/* By the free run over the whole record: of lags where there are some, as another model takes a drift for its own. */
static int find_warnings(struct identification *z)
{
    const struct identify_model *m = &z->model[z->model[TRANSFER].linear ? TRANSFER : z->chosen];
    const int rc = grid_warnings(&z->data, m->linear, m->u0, m->y0, &z->warning, &z->warnings);

    return rc < 0 ? cli_error(&z->cli, rc, "out of memory") : EXIT_OK;
}

/* ---- Writing ------------------------------------------------------------------------------------------ */

/* On one line, as a shell takes it. */
static void put_shell_word(FILE *out, const char *word)
{
    const bool plain = *word && !word[strcspn(word, " \t\n\r!\"#$&'()*;<>?[\\]^`{|}~")];

    fputs(plain ? " " : " '", out);
    for (; *word; word++)
        if (*word == '\'')
            fputs("'\\''", out);
        else
            fputc((unsigned char)*word < ' ' ? '?' : *word, out);
    fputs(plain ? "" : "'", out);
}

/* Of a URI or --option=URI what store_name() shows. False: out of memory. */
static bool note_command(struct identification *z, int argc, char **argv)
{
    size_t size;
    FILE *out = open_memstream(&z->command, &size);
    bool whole = out != NULL;

    for (int i = 0; i < argc && whole; i++) {
        const char *const is = argv[i][0] == '-' ? strchr(argv[i], '=') : NULL,
                          *value = is ? is + 1 : argv[i];
        const char *at = strrchr(value, '@'), *end = at && strstr(at, "..") ? at : value + strlen(value);
        char *const uri = strndup(value, (size_t)(end - value));
        const bool masked = uri && store_is_uri(uri);
        char name[600], word[900];

        whole = uri != NULL;
        if (masked) {
            store_name(uri, name, sizeof name);
            snprintf(word, sizeof word, "%.*s%s%.200s", (int)(value - argv[i]), argv[i], name, end);
        }
        if (whole)
            put_shell_word(out, masked ? word : argv[i]);
        free(uri);
    }
    return out && fclose(out) == 0 && whole;
}

/* Whole or not at all. */
static int write_identified_file(const struct identification *z)
{
    const struct identify_model *m = &z->model[z->chosen];
    char part[600], who[APC_TAG_LEN], now[APC_TIME_LEN];
    struct apc_error why;
    bool failed;
    FILE *out;
    int rc = 0;

    if (m->fit < 0.0 && z->own.kind == KINDS)
        return cli_error(
            &z->cli, APC_ESOLVER,
            "%s: not written: no model says more of what they are judged on than its mean does. Judge "
            "on something that moves (--share, --validate), or take one by --model",
            z->own.output);
    if (snprintf(part, sizeof part, "%s.part", z->own.output) >= (int)sizeof part)
        return cli_error(&z->cli, APC_EINVAL, "%s: the path is too long", z->own.output);
    out = fopen(part, "we");
    if (!out)
        return cli_error(&z->cli, APC_ESYS, "%s: cannot be written: %s", part, strerror(errno));
    operate_who(who, sizeof who);
    fprintf(out, "# %s, %s: apc%s\n", apc_time_format(apc_clock_utc(NULL), now), who, z->command);
    fprintf(out, "# apc identify --model %s: free run %.1f %% of samples that it was not fitted to\n",
            m->kind, m->fit);
    if (z->cli.n_args > 1) {
        fprintf(out, "# of %d records; the operating point is that of", z->cli.n_args);
        put_shell_word(out, z->cli.args[0]);
        fputc('\n', out);
    }
    identify_write(out, m, &z->data);
    failed = ferror(out) != 0;
    failed |= fclose(out) != 0;
    if (failed) {
        rc = cli_error(&z->cli, APC_ESYS, "%s: cannot be written: %s", z->own.output, strerror(errno));
        remove(part);
        return rc;
    }
    rc = folder_replace(part, z->own.output, &why);
    return rc < 0 ? cli_error(&z->cli, rc, "%s", why.text) : EXIT_OK;
}

static int draw_identified(const struct identification *z)
{
    struct apc_error why;
    int rc = identify_figure(z->own.figure, &z->model[z->chosen], judged_on(z), &why);

    return rc < 0 ? cli_error(&z->cli, rc, "%s", why.text) : EXIT_OK;
}

/* Before it takes its time. */
static int spare_files(const struct identification *z)
{
    char svg[600] = "", png[600] = "";
    const char *const file[] = {z->own.output, z->own.figure ? svg : NULL, z->own.figure ? png : NULL};
    struct apc_error why;
    int rc = 0;

    snprintf(svg, sizeof svg, "%.590s.svg", z->own.figure ? z->own.figure : "");
    snprintf(png, sizeof png, "%.590s.png", z->own.figure ? z->own.figure : "");
    for (size_t i = 0; i < 3 && rc == 0; i++)
        rc = file[i] ? folder_spare(file[i], z->own.force, &why) : 0;
    return rc < 0 ? cli_error(&z->cli, rc, "%s", why.text) : EXIT_OK;
}

/* Of a run folder; where there are several, it is not said whose loops these will be. */
static double period_of_controller(const char *record)
{
    struct apc_error why;
    struct experiment e;
    const bool is_one = experiment_load(&e, record, EXPERIMENT_MODEL | EXPERIMENT_LAW, NULL, &why) == 0 &&
                        e.n_controllers == 1;
    const double period = is_one ? apc_ns_to_s(e.controllers[0].rhythm.period) : 0.0;

    experiment_free(&e);
    return period;
}

/* ---- The command --------------------------------------------------------------------------------------- */

int command_identify(int argc, char **argv)
{
    struct identification *z = calloc(1, sizeof *z);
    int rc;

    if (!z || !note_command(z, argc, argv)) {
        fputs("apc identify: out of memory\n", stderr);
        if (z)
            free(z->command);
        free(z);
        return EXIT_ERROR;
    }
    z->own = (struct identify_options){.share = 0.67, .kind = KINDS};
    cli_parse(&z->cli, &spec, &z->own, argc, argv);
    rc = spare_files(z);
    if (rc == EXIT_OK)
        rc = identify_read_all(z);
    if (rc == EXIT_OK && z->own.signals) {
        rc = identify_show_signals(z);
        goto out;
    }
    if (rc == EXIT_OK && (z->own.finds || z->own.likelihood)) {
        rc = identify_find(z);
        goto out;
    }
    if (rc == EXIT_OK)
        rc = find_candidate_models(z);
    if (rc == EXIT_OK)
        rc = find_warnings(z);
    if (rc == EXIT_OK && z->own.output)
        rc = write_identified_file(z);
    if (rc == EXIT_OK && z->own.figure)
        rc = draw_identified(z);
    if (rc == EXIT_OK && z->own.suggest)
        z->controller = period_of_controller(z->cli.args[0]);
    if (rc == EXIT_OK)
        identify_show(z);
out:
    rc = cli_done(&z->cli, rc);
    for (int k = 0; k < KINDS; k++)
        drop_model(&z->model[k]);
    identify_data_free(&z->data);
    identify_data_free(&z->other);
    free(z->warning);
    free(z->command);
    free(z);
    return rc;
}

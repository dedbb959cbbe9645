/* SPDX-License-Identifier: BSD-3-Clause */
#include "tune.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>

#include <apctune.h>

#include "analyze/linear.h"
#include "apc/folder/folder.h"
#include "apc/folder/kpi_window.h"
#include "apc/identify/oscillation.h"
#include "apc/report/gnuplot.h"
#include "apc/simulate/closed_replay.h"
#include "experiment/experiment.h"

#define HORIZON 20 /* of the slowest that the loop has, a step is looked at for */
#define STEPS   20000
#define SETTLED 0.05

/* What a loop does, if the plant is the model. */
struct answer {
    struct apc_margins margins;
    double iae, overshoot, settling; /* of a step of 1 of the setpoint */
    double *y;                       /* [n] what is measured after it, a sample each Ts */
    size_t n;
};

/* What is drawn of a loop. */
struct drawing {
    const char *name, *measurement;
    const struct apc_transfer *g; /* of z->model */
    double Ts;
    struct answer now, then;
};

/* A loop that a relay was in. */
struct swinging {
    const char *name;
    struct oscillation is;
};

struct suggesting {
    const struct suggest_options *o;
    struct experiment e;
    struct suggest_model *model;
    struct apc_tag *tags;
    size_t n_tags;
    struct drawing *drawing; /* [drawings] */
    size_t drawings;
    struct swinging *swinging; /* [n_swinging] */
    size_t n_swinging;
    struct identify_data data; /* of the run; unused with o->model */
    int unmodelled;            /* why there are no models, or 0 */
    struct apc_error why;      /* of that */
};

/* ---- The models ------------------------------------------------------------------------------ */

static int identify(struct suggesting *z, const struct identify_data *data, struct apc_error *why)
{
    const struct apc_identify_transfer_options options = {.size = sizeof options};
    const struct apc_record *r = &data->record;
    struct apc_transfer *g = calloc(2 * r->ny * r->nu + 1, sizeof *g), *error = g ? g + r->ny * r->nu : NULL;
    struct apc_linear *linear = NULL;
    double u0[IDENTIFY_SIGNALS], y0[IDENTIFY_SIGNALS];
    int rc = apc_record_check(r, why);

    if (!g)
        return apc_fail(why, APC_ENOMEM, "out of memory");
    if (rc == 0)
        rc = apc_identify_transfer(r, &options, g, error, u0, y0, NULL, why);
    if (rc == 0)
        rc = apc_linear_from_transfer(&linear, r->ny, r->nu, 0, g, u0, y0, r->Ts, why);
    if (rc == 0)
        rc = apc_validate(linear, NULL, r, r->n / 10, z->model->judged, NULL, why);
    apc_linear_destroy(linear);
    for (size_t p = 0; p < r->ny * r->nu && rc == 0; p++) {
        const size_t at = p / r->nu * IDENTIFY_SIGNALS + p % r->nu;

        z->model->g[at] = g[p];
        z->model->error[at] = error[p];
    }
    z->model->inputs = r->nu;
    z->model->outputs = r->ny;
    memcpy(z->model->input, data->input, sizeof data->input);
    memcpy(z->model->output, data->output, sizeof data->output);
    free(g);
    return rc;
}

/* A loop of a law with such numbers, from the plant to the plant. */
static bool is_pid(const struct controller_loop *loop)
{
    const struct controller *c = loop->of;
    int id;

    return c->law && controllers_loop_parameter(loop, "Kp", &id) &&
           controllers_loop_parameter(loop, "tau_i", &id) && c->u[loop->u].table == APC_ACTUATOR &&
           loop->u < c->dim.ny && c->y[loop->u].table == APC_SENSOR && !c->shadow;
}

/* No tuning cures a valve. */
static int check_valves(const struct suggesting *z, struct apc_error *why)
{
    const double horizon = 0.0;
    struct kpis m;
    int rc = window_of_run(&m, &z->e, z->o->run, (double)NAN, (double)NAN, &horizon, why);

    for (size_t i = 0; i < m.n_loops && rc == 0; i++) {
        const struct controller_loop loop = controllers_loop(&z->e, i);

        if (is_pid(&loop) && m.loop[i].health.verdict == HEALTH_VALVE)
            rc = apc_fail(why, APC_ESOLVER, "%s: %s (apc monitor %s). Then test the plant anew by apc test",
                          controllers_output(&z->e, loop)->name, health_words(HEALTH_VALVE), z->o->run);
    }
    kpis_free(&m);
    return rc;
}

static int find_loop_models(struct suggesting *z, struct apc_error *why)
{
    struct identify_selection selection = {.from = -HUGE_VAL};
    struct stat is;
    int rc;

    if (z->o->model)
        return suggest_read_model(z->o, z->model, why);
    if (stat(z->o->run, &is) == 0 && S_ISREG(is.st_mode))
        return apc_fail(why, APC_EINVAL,
                        "%s is a file: name the folder of a run or of apc test, or --model FILE as well",
                        z->o->run);
    rc = check_valves(z, why);
    if (rc < 0)
        return rc;
    rc = identify_read(&z->data, z->o->run, &selection, why);
    if (rc < 0) { /* samples of a real plant come late */
        identify_data_free(&z->data);
        selection.period = apc_ns_to_s(z->e.client.rhythm.period);
        rc = identify_read(&z->data, z->o->run, &selection, why);
    }
    if (rc == 0 && (rc = identify(z, &z->data, why)) < 0 && z->o->rule == SUGGEST_RELAY) {
        z->unmodelled = rc; /* what a relay has made of a loop needs none */
        z->why = *why;
        return 0;
    }
    return rc;
}

/* Is the run one of a relay in this loop? */
static bool oscillates(const struct suggesting *z, const char *output, const char *measurement,
                       struct oscillation *found)
{
    const struct apc_record *r = &z->data.record;

    for (size_t i = 0; i < r->ny && z->o->rule == SUGGEST_RELAY; i++)
        for (size_t j = 0; j < r->nu; j++)
            if (!strcmp(z->data.output[i], measurement) && !strcmp(z->data.input[j], output))
                return oscillation_find(r, j, i, found);
    return false;
}

/* From the output to what its loop controls; NULL: there is none. */
static const struct apc_transfer *model_of(const struct suggesting *z, const char *output,
                                           const char *measurement, const struct apc_transfer **error)
{
    const struct suggest_model *m = z->model;

    for (size_t i = 0; i < m->outputs; i++)
        for (size_t j = 0; j < m->inputs; j++)
            if (!strcmp(m->output[i], measurement) && !strcmp(m->input[j], output)) {
                *error = &m->error[i * IDENTIFY_SIGNALS + j];
                return &m->g[i * IDENTIFY_SIGNALS + j];
            }
    return NULL;
}

/* ---- What a tuning does ---------------------------------------------------------------------- */

static int check_suggested_loop(const struct apc_transfer *g, const struct apc_pid_tuning *t, double Ts,
                                struct answer *a, struct apc_error *why)
{
    const double lasts = HORIZON * (g->tau[0] + g->tau[1] + g->dead_time + t->tau_i + Ts);
    const size_t n = lasts / Ts > STEPS ? STEPS : (size_t)(lasts / Ts);
    struct apc_linear *plant = NULL;
    double *x = NULL, y = 0.0, u, last = 0.0, integral = 0.0;
    int rc;

    *a = (struct answer){.iae = 0.0};
    rc = linear_margins_of_pid(g, t, Ts, &a->margins, why);

    if (rc == 0)
        rc = apc_linear_from_transfer(&plant, 1, 1, 0, g, NULL, NULL, Ts, why);
    if (rc == 0 && (!(x = calloc(2 * plant->nx + 1, sizeof *x)) || !(a->y = calloc(n + 1, sizeof *a->y))))
        rc = apc_fail(why, APC_ENOMEM, "out of memory");
    for (size_t k = 0; k < n && rc == 0; k++) {
        double *now = x + (k % 2) * plant->nx, *next = x + ((k + 1) % 2) * plant->nx;
        u = 0.0;
        apc_linear_output(plant, now, &u, &y);
        a->y[a->n++] = y;
        u = t->Kp * (1.0 - y) + integral - t->Kp * t->tau_d / Ts * (y - last);
        integral += t->tau_i > 0.0 ? t->Kp * Ts / t->tau_i * (1.0 - y) : 0.0;
        last = y;
        apc_linear_next(plant, now, &u, next);
        a->iae += Ts * fabs(1.0 - y);
        a->overshoot = fmax(a->overshoot, 100.0 * (y - 1.0));
        a->settling = fabs(1.0 - y) > SETTLED ? (double)(k + 1) * Ts : a->settling;
    }
    free(x);
    apc_linear_destroy(plant);
    return rc;
}

/* @swings: what a relay has shown, or NULL. */
static int find_suggested_tuning(const struct suggesting *z, const struct apc_transfer *g,
                                 const struct oscillation *swings, bool derivative, double Ts,
                                 struct apc_pid_tuning *t, struct apc_error *why)
{
    double gain, every;

    if (swings)
        return apc_tune_relay(swings->gain, swings->every, derivative, t, why);

    if (z->o->rule != SUGGEST_RELAY)
        return apc_tune_pid(g, z->o->rule == SUGGEST_LAMBDA ? APC_TUNE_LAMBDA : APC_TUNE_SIMC, derivative,
                            z->o->tau_c, Ts, t, why);
    const int rc = apc_tune_limit(g, Ts, &gain, &every, why);
    return rc < 0 ? rc : apc_tune_relay(gain, every, derivative, t, why);
}

/* ---- Loops ----------------------------------------------------------------------------------- */

static void add_suggested_value(const struct suggesting *z, struct suggestion *s, int id, double value)
{
    char text[40];

    for (size_t i = 0; i < z->n_tags; i++)
        if (z->tags[i].table == APC_TUNING && z->tags[i].id == id)
            snprintf(s->name[s->n], APC_TAG_LEN, "%.*s", APC_TAG_LEN - 1, z->tags[i].name);
    snprintf(text, sizeof text, "%.4g", value); /* what is shown is what is written */
    (void)apc_number_parse(text, &s->value[s->n++]);
}

static void show_suggestion(const char *loop, const char *which, const struct apc_pid_tuning *t,
                            const struct answer *a)
{
    printf("%-8s %-8s %-10.4g %-8.4g %-8.4g ", loop, which, t->Kp, t->tau_i, t->tau_d);
    if (!a)
        puts("-            -                 -               -     -        -            -");
    else if (a->margins.stable)
        printf("%-12.3g %-17.3g %-15.3g %-5.3g %-8.4g %-12.3g %.4g\n", a->margins.gain, a->margins.phase,
               a->margins.delay, a->margins.sensitivity, a->iae, a->overshoot, a->settling);
    else
        puts("unstable");
}

/* With the worst of the models that the record allows; its dead time may be longer than what is simulated. */
static int show_worst(const char *output, const struct apc_transfer *g, const struct apc_transfer *error,
                      const struct apc_pid_tuning *found, double Ts, struct apc_error *why)
{
    struct linear_worst worst;
    struct answer a = {.y = NULL};
    int rc = linear_worst(&worst, g, error, found, Ts, why);

    if (rc == 0) {
        rc = check_suggested_loop(&worst.g, found, Ts, &a, why);
        show_suggestion(output, "worst", found, rc == 0 ? &a : NULL);
        rc = rc == APC_ENOMEM ? rc : 0;
    }
    free(a.y);
    return rc;
}

/* What the model says of it. */
static int predict(struct suggesting *z, const char *output, const char *measurement,
                   const struct apc_transfer *g, const struct apc_transfer *error,
                   const struct apc_pid_tuning *present, const struct apc_pid_tuning *found, double Ts,
                   struct apc_error *why)
{
    struct drawing *d = &z->drawing[z->drawings++];
    int rc = check_suggested_loop(g, found, Ts, &d->then, why);

    d->name = output;
    d->measurement = measurement;
    d->g = g;
    d->Ts = Ts;
    if (rc == 0 && !d->then.margins.stable)
        rc = apc_fail(why, APC_ESOLVER,
                      "%s: this rule's tuning is not stable with the model: take another, or a "
                      "longer --tau-c",
                      output);
    if (rc < 0)
        return rc;
    if (present->Kp != 0.0 && check_suggested_loop(g, present, Ts, &d->now, why) == 0)
        show_suggestion(output, "now", present, &d->now);
    show_suggestion(output, "then", found, &d->then);
    return z->o->model ? 0 : show_worst(output, g, error, found, Ts, why);
}

/* Is the model one to tune by? */
static int check_model(const struct suggesting *z, const char *output, const char *measurement,
                       const struct apc_transfer *g, const struct apc_transfer *error, struct apc_error *why)
{
    char untold[200];

    if (z->unmodelled) {
        *why = z->why;
        return z->unmodelled;
    }
    if (!g)
        return apc_fail(why, APC_ENOTFOUND, "%s to %s is not %s %s", output, measurement,
                        z->o->model ? "in" : "on record in", z->o->model ? z->o->model : z->o->run);
    if (g->gain == 0.0)
        return apc_fail(why, APC_ESOLVER,
                        "in %s %s has no effect on %s: test it longer, or with a larger amplitude",
                        z->o->model ? z->o->model : z->o->run, output, measurement);
    if (!(fabs(g->gain) > 2.0 * error->gain))
        return apc_fail(
            why, APC_ESOLVER,
            "the gain from %s to %s is %.3g +- %.3g: not even its sign is known. Test it longer, or "
            "with a larger amplitude",
            output, measurement, g->gain, 1.96 * error->gain);
    if (!g->integrating && isnan(error->tau[0]) && !(g->tau[1] > 0.0 && isfinite(error->tau[1]))) {
        identify_untold(g, error, untold, sizeof untold);
        return apc_fail(
            why, APC_ESOLVER,
            "%s to %s: the record does not tell %s, so there is no tuning to suggest. Test the plant by apc "
            "test, longer or with a larger amplitude",
            output, measurement, untold);
    }
    return 0;
}

/* Returns 0, or why there is nothing to be said of this loop. */
static int suggest_loop(struct suggesting *z, const struct controller_loop *loop, struct suggestion *s,
                        struct apc_error *why)
{
    const struct controller *c = loop->of;
    const double Ts = apc_ns_to_s(c->rhythm.period);
    const char *output = controllers_output(&z->e, *loop)->name;
    const char *measurement = z->e.y[c->y[loop->u].at].tag.name;
    int Kp_id, tau_i_id, tau_d_id;
    double *Kp = controllers_loop_parameter(loop, "Kp", &Kp_id),
           *tau_i = controllers_loop_parameter(loop, "tau_i", &tau_i_id),
           *tau_d = controllers_loop_parameter(loop, "tau_d", &tau_d_id);
    const struct apc_transfer *error = NULL, *g = model_of(z, output, measurement, &error);
    const struct apc_pid_tuning present = {*Kp, *tau_i, tau_d ? *tau_d : 0.0};
    struct apc_pid_tuning found;
    struct oscillation swings;
    const bool by_relay = oscillates(z, output, measurement, &swings);
    int rc = check_model(z, output, measurement, g, error, why);
    const bool modelled = rc == 0;
    /* of what integrates the first lag is already one behind another */
    const bool second = modelled ? g->tau[g->integrating ? 0 : 1] > 0.0 : present.tau_d > 0.0;

    if (rc < 0 && !by_relay)
        return rc;
    rc = find_suggested_tuning(z, g, by_relay ? &swings : NULL, tau_d && second, Ts, &found, why);
    if (rc == 0 && modelled) {
        rc = predict(z, output, measurement, g, error, &present, &found, Ts, why);
    } else if (rc == 0) {
        show_suggestion(output, "now", &present, NULL);
        show_suggestion(output, "then", &found, NULL);
    }
    if (rc < 0)
        return rc;
    if (by_relay)
        z->swinging[z->n_swinging++] = (struct swinging){output, swings};
    add_suggested_value(z, s, Kp_id, found.Kp);
    add_suggested_value(z, s, tau_i_id, found.tau_i);
    if (tau_d)
        add_suggested_value(z, s, tau_d_id, found.tau_d);
    return 0;
}

/* Is it a loop to be tuned? Where a relay was in some loop, those it was in are. */
static bool is_wanted(const struct suggesting *z, const struct controller_loop *loop, bool relays)
{
    struct oscillation swings;

    return is_pid(loop) && (!relays || oscillates(z, controllers_output(&z->e, *loop)->name,
                                                  z->e.y[loop->of->y[loop->u].at].tag.name, &swings));
}

/* What apc identify says of the models, too. */
static void show_doubts(const struct suggesting *z)
{
    char untold[200];

    for (const struct drawing *d = z->drawing; d < z->drawing + z->drawings; d++) {
        const size_t p = (size_t)(d->g - z->model->g);

        if (identify_untold(d->g, &z->model->error[p], untold, sizeof untold))
            printf("%s to %s: the record does not tell %s\n", d->name, d->measurement, untold);
        if (!z->o->model && z->model->judged[p / IDENTIFY_SIGNALS].independent < IDENTIFY_TELLING)
            printf("%s to %s: what the model leaves out is not noise alone: it may be another order, a "
                   "nonlinearity, or an input that is not on record. Try the tuning first, by apc simulate\n",
                   d->name, d->measurement);
    }
}

static int suggest_loops(struct suggesting *z, struct suggestion *s, struct apc_error *why)
{
    const size_t loops = controllers_loops(&z->e);
    bool relays = false;
    size_t n = 0;
    int rc = 0;

    s->name = calloc(3 * loops + 1, sizeof *s->name);
    s->value = calloc(3 * loops + 1, sizeof *s->value);
    z->drawing = calloc(loops + 1, sizeof *z->drawing);
    z->swinging = calloc(loops + 1, sizeof *z->swinging);
    if (!s->name || !s->value || !z->drawing || !z->swinging)
        return apc_fail(why, APC_ENOMEM, "out of memory");
    for (size_t i = 0; i < loops; i++) {
        const struct controller_loop loop = controllers_loop(&z->e, i);
        relays = relays || is_wanted(z, &loop, true);
    }
    puts("loop     tuning   Kp         tau_i s  tau_d s  gain margin  phase margin deg  delay margin s  Ms   "
         " IAE      "
         "overshoot %  "
         "settling s");
    for (size_t i = 0; i < loops && rc == 0; i++) {
        const struct controller_loop loop = controllers_loop(&z->e, i);
        if (is_wanted(z, &loop, relays)) {
            rc = suggest_loop(z, &loop, s, why);
            n++;
        }
    }
    if (rc == 0 && n == 0)
        return apc_fail(
            why, APC_EINVAL,
            "%s has no PI or PID loop on an output of the plant: apc optimize searches other laws",
            z->o->run);
    for (size_t i = 0; i < z->n_swinging && rc == 0; i++)
        printf("%s: the relay's oscillation, every %.4g s, is the loop's limit, a gain of %.4g\n",
               z->swinging[i].name, z->swinging[i].is.every, z->swinging[i].is.gain);
    if (z->unmodelled && rc == 0)
        printf("no model, so nothing is predicted: %s\n", z->why.text);
    if (rc == 0)
        show_doubts(z);
    if (z->drawings && rc == 0)
        puts("IAE, overshoot, settling (to 5 %): of a step of 1 of the setpoint, by the model; a smaller Ms "
             "is calmer");
    return rc;
}

/* ---- The figure ------------------------------------------------------------------------------ */

static void put_step(FILE *script, const char *block, size_t loop, const struct answer *a, double Ts,
                     double until)
{
    fprintf(script, "$%s%zu << END\n", block, loop + 1);
    for (size_t k = 0; k < a->n && (double)k * Ts <= until; k++)
        fprintf(script, "%.7g %.7g\n", (double)k * Ts, a->y[k]);
    fputs(a->n ? "END\n" : "NaN NaN\nEND\n", script);
}

/* Until both have settled, and a bit more. */
static double until_of(const struct drawing *d)
{
    const double then = d->then.settling,
                 now = d->now.margins.stable ? fmin(d->now.settling, 4.0 * then) : 0.0;

    return 2.0 * fmax(fmax(now, then), 10.0 * d->Ts);
}

static void put_step_responses(FILE *script, void *ctx)
{
    const struct suggesting *z = ctx;

    fprintf(script, "loops = %zu\narray name[loops]\narray until[loops]\n", z->drawings);
    for (size_t i = 0; i < z->drawings; i++) {
        const struct drawing *d = &z->drawing[i];

        put_step(script, "now", i, &d->now, d->Ts, until_of(d));
        put_step(script, "then", i, &d->then, d->Ts, until_of(d));
        fprintf(script, "until[%zu] = %.9g\n", i + 1, until_of(d));
        gnuplot_text(script, "name", i, d->measurement);
    }
}

static int draw_suggestions(struct suggesting *z, struct apc_error *why)
{
    char file[600];
    int rc = z->drawings ? 0
                         : apc_fail(why, APC_EINVAL,
                                    "without a model there is no step to be drawn: leave --figure out");

    for (int i = 0; i < 2 && rc == 0; i++) {
        snprintf(file, sizeof file, "%.590s.%s", z->o->figure, i ? "png" : "svg");
        rc = folder_spare(file, z->o->force, why);
    }
    return rc < 0 ? rc : gnuplot_figure(z->o->figure, figure_steps, put_step_responses, z, why);
}

/* ---- On the record --------------------------------------------------------------------------- */

/* What is suggested against what disturbed the run, beside what was in force then. */
static int show_on_record(const struct suggesting *z, const struct suggestion *s, struct apc_error *why)
{
    struct setting_text {
        char path[APC_TAG_LEN + 16], value[32];
    } *text = calloc(s->n + 1, sizeof *text);
    struct experiment_setting *set = calloc(s->n + 1, sizeof *set);
    const struct experiment_overrides overrides = {.set = set, .n_set = s->n};
    struct replay_range run = {.until = INT64_MAX, .dir = z->o->run, .overrides = &overrides};
    int rc = text && set ? 0 : apc_fail(why, APC_ENOMEM, "out of memory");

    for (size_t i = 0; i < s->n && rc == 0; i++) {
        snprintf(text[i].path, sizeof text[i].path, "controller%s.%s", z->e.n_controllers > 1 ? "s" : "",
                 s->name[i]);
        snprintf(text[i].value, sizeof text[i].value, "%.10g", s->value[i]);
        set[i] = (struct experiment_setting){text[i].path, text[i].value};
    }
    if (rc == 0)
        rc = replay_open_ticks(&run.store, z->o->run, why);
    if (rc == 0) {
        puts("in closed loop on this record, with all that is suggested:");
        rc = closed_replay(z->o->run, &run, NULL, NULL, why);
    }
    apc_store_close(run.store);
    free(text);
    free(set);
    return rc;
}

int suggest(const struct suggest_options *o, struct suggestion *s, struct apc_error *why)
{
    struct suggesting z = {.o = o};
    int rc = experiment_load(&z.e, o->run, EXPERIMENT_MODEL | EXPERIMENT_LAW,
                             &(struct experiment_overrides){.law = NULL}, why);

    *s = (struct suggestion){.n = 0};
    if (rc < 0)
        return rc;
    if (folder_operated(&z.e, true) > 0)
        fputs("apc tune: in that run an operator changed the tuning: `now` is the file's\n", stderr);
    z.model = calloc(1, sizeof *z.model);
    z.tags = z.model ? provision_tags(&z.e, &z.n_tags) : NULL;
    rc = z.tags ? find_loop_models(&z, why) : apc_fail(why, APC_ENOMEM, "out of memory");
    if (rc == 0)
        rc = suggest_loops(&z, s, why);
    if (rc == 0) {
        fputs("as written by --apply: apc tune", stdout);
        for (size_t i = 0; i < s->n; i++)
            printf(" %s=%.10g", s->name[i], s->value[i]);
        putchar('\n');
    }
    if (rc == 0 && o->closed)
        rc = show_on_record(&z, s, why);
    if (rc == 0 && o->figure)
        rc = draw_suggestions(&z, why);
    for (size_t i = 0; i < z.drawings; i++) {
        free(z.drawing[i].now.y);
        free(z.drawing[i].then.y);
    }
    identify_data_free(&z.data);
    free(z.swinging);
    free(z.drawing);
    free(z.model);
    free(z.tags);
    experiment_free(&z.e);
    return rc;
}

void suggestion_free(struct suggestion *s)
{
    free(s->name);
    free(s->value);
}

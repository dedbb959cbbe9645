/* SPDX-License-Identifier: BSD-3-Clause */
#include "tune.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include <apctune.h>

#include "identify.h"
#include "run/run_internal.h"

#define HORIZON 20 /* of the slowest that the loop has, a step is looked at for */
#define STEPS   20000
#define SETTLED 0.05

/* What a loop does, if the plant is the model. */
struct answer {
    struct apc_margins margins;
    double iae, overshoot, settling; /* of a step of 1 of the setpoint */
};

struct suggesting {
    const struct suggest_options *o;
    struct experiment e;
    struct identify_data data;
    struct apc_transfer *g, *error; /* [ny * nu] */
    struct apc_tag *tags;
    size_t n_tags;
};

/* ---- The models -----------------------------------------------------------------------------------------
 */

static int find_models(struct suggesting *z, struct apc_error *why)
{
    const struct apc_identify_transfer_options options = {.size = sizeof options};
    struct identify_wish wish = {.from = -HUGE_VAL};
    double u0[IDENTIFY_SIGNALS], y0[IDENTIFY_SIGNALS];
    int rc = identify_read(&z->data, z->o->run, &wish, why);

    if (rc < 0) { /* samples of a real plant come late */
        identify_data_free(&z->data);
        wish.period = apc_ns_to_s(z->e.client.rhythm.period);
        rc = identify_read(&z->data, z->o->run, &wish, why);
    }
    if (rc == 0)
        rc = apc_record_check(&z->data.record, why);
    if (rc == 0) {
        z->g = calloc(2 * z->data.record.ny * z->data.record.nu, sizeof *z->g);
        z->error = z->g ? z->g + z->data.record.ny * z->data.record.nu : NULL;
        rc = z->g ? apc_identify_transfer(&z->data.record, &options, z->g, z->error, u0, y0, NULL, why)
                  : apc_fail(why, APC_ENOMEM, "out of memory");
    }
    return rc;
}

/* From the output to what its loop controls; NULL: not on record. */
static const struct apc_transfer *model_of(const struct suggesting *z, const char *output,
                                           const char *measurement, const struct apc_transfer **error)
{
    for (size_t i = 0; i < z->data.record.ny; i++)
        for (size_t j = 0; j < z->data.record.nu; j++)
            if (!strcmp(z->data.output[i], measurement) && !strcmp(z->data.input[j], output)) {
                *error = &z->error[i * z->data.record.nu + j];
                return &z->g[i * z->data.record.nu + j];
            }
    return NULL;
}

/* ---- What a tuning does ----------------------------------------------------------------------------------
 */

static int answer(const struct apc_transfer *g, const struct apc_pid_tuning *t, double Ts, struct answer *a,
                  struct apc_error *why)
{
    const double lasts = HORIZON * (g->tau[0] + g->tau[1] + g->dead_time + t->tau_i + Ts);
    const size_t n = lasts / Ts > STEPS ? STEPS : (size_t)(lasts / Ts);
    struct apc_linear *plant = NULL;
    double *x = NULL, y = 0.0, u, last = 0.0, integral = 0.0;
    int rc;

    *a = (struct answer){.iae = 0.0};
    a->margins.size = sizeof a->margins;
    rc = apc_tune_margins(g, t, Ts, &a->margins, why);

    if (rc == 0)
        rc = apc_linear_from_transfer(&plant, 1, 1, 0, g, NULL, NULL, Ts, why);
    if (rc == 0 && !(x = calloc(2 * plant->nx + 1, sizeof *x)))
        rc = apc_fail(why, APC_ENOMEM, "out of memory");
    for (size_t k = 0; k < n && rc == 0; k++) {
        double *now = x + (k % 2) * plant->nx, *next = x + ((k + 1) % 2) * plant->nx;
        u = 0.0;
        apc_linear_output(plant, now, &u, &y);
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

static int find_tuning(const struct suggesting *z, const struct apc_transfer *g, bool derivative, double Ts,
                       struct apc_pid_tuning *t, struct apc_error *why)
{
    double gain, every;

    if (z->o->rule != SUGGEST_RELAY)
        return apc_tune_pid(g, z->o->rule == SUGGEST_LAMBDA ? APC_TUNE_LAMBDA : APC_TUNE_SIMC, derivative,
                            z->o->tau_c, Ts, t, why);
    const int rc = apc_tune_limit(g, Ts, &gain, &every, why);
    return rc < 0 ? rc : apc_tune_relay(gain, every, derivative, t, why);
}

/* ---- Loops ------------------------------------------------------------------------------------------------
 */

/* Where a loop's parameter is among those of its controller; NULL: the law has none of that name. */
static double *parameter(const struct controller_loop *loop, const char *name, int *id)
{
    const struct controller *c = loop->of;

    for (size_t k = 0; k < apc_law_parameters(c->law, &c->dim); k++) {
        const struct apc_law_parameter p = apc_law_parameter_at(c->law, &c->dim, k);
        *id = c->first_tuning + (int)k;
        if (p.scope != APC_OF_MEASUREMENT && !strcmp(c->law->tuning[p.number].name, name) &&
            (p.scope == APC_OF_LAW || p.of == loop->u))
            return &c->tuning[k];
    }
    return NULL;
}

static void add(const struct suggesting *z, struct suggestion *s, int id, double value)
{
    char text[40];

    for (size_t i = 0; i < z->n_tags; i++)
        if (z->tags[i].table == APC_TUNING && z->tags[i].id == id)
            snprintf(s->name[s->n], APC_TAG_LEN, "%.*s", APC_TAG_LEN - 1, z->tags[i].name);
    snprintf(text, sizeof text, "%.4g", value); /* what is shown is what is written */
    (void)apc_number_parse(text, &s->value[s->n++]);
}

static void show(const char *loop, const char *which, const struct apc_pid_tuning *t, const struct answer *a)
{
    printf("%-8s %-8s %-10.4g %-8.4g %-8.4g ", loop, which, t->Kp, t->tau_i, t->tau_d);
    if (a->margins.stable)
        printf("%-7.3g %-10.3g %-8.3g %-5.3g %-8.4g %-12.3g %.4g\n", a->margins.gain, a->margins.phase,
               a->margins.delay, a->margins.sensitivity, a->iae, a->overshoot, a->settling);
    else
        puts("unstable");
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
    double *Kp = parameter(loop, "Kp", &Kp_id), *tau_i = parameter(loop, "tau_i", &tau_i_id),
           *tau_d = parameter(loop, "tau_d", &tau_d_id);
    const struct apc_transfer *error, *g = model_of(z, output, measurement, &error);
    struct apc_pid_tuning found;
    struct answer now = {.iae = 0.0}, then = {.iae = 0.0};
    int rc;

    if (!g)
        return apc_fail(why, APC_ENOTFOUND, "%s to %s is not on record", output, measurement);
    if (!(fabs(g->gain) > 2.0 * error->gain))
        return apc_fail(
            why, APC_ESOLVER,
            "the gain from %s to %s is %.3g +- %.3g: not even its sign is known. Test it longer, or "
            "with a larger amplitude",
            output, measurement, g->gain, 1.96 * error->gain);
    const struct apc_pid_tuning present = {*Kp, *tau_i, tau_d ? *tau_d : 0.0};
    rc = find_tuning(z, g, tau_d && g->tau[1] > 0.0, Ts, &found, why);
    if (rc == 0)
        rc = answer(g, &found, Ts, &then, why);
    if (rc == 0 && !then.margins.stable)
        rc = apc_fail(why, APC_ESOLVER,
                      "%s: this rule's tuning is not stable with the model: take another, or a "
                      "longer --tau-c",
                      output);
    if (rc < 0)
        return rc;
    if (present.Kp != 0.0 && answer(g, &present, Ts, &now, why) == 0)
        show(output, "now", &present, &now);
    show(output, "then", &found, &then);
    add(z, s, Kp_id, found.Kp);
    add(z, s, tau_i_id, found.tau_i);
    if (tau_d)
        add(z, s, tau_d_id, found.tau_d);
    return 0;
}

/* A loop of a law with such numbers, from the plant to the plant. */
static bool is_pid(const struct controller_loop *loop)
{
    const struct controller *c = loop->of;
    int id;

    return c->law && parameter(loop, "Kp", &id) && parameter(loop, "tau_i", &id) &&
           c->u[loop->u].table == APC_ACTUATOR && loop->u < c->dim.ny && c->y[loop->u].table == APC_SENSOR &&
           !c->shadow;
}

static int suggest_loops(struct suggesting *z, struct suggestion *s, struct apc_error *why)
{
    const size_t loops = controllers_loops(&z->e);
    size_t n = 0;
    int rc = 0;

    s->name = calloc(3 * loops + 1, sizeof *s->name);
    s->value = calloc(3 * loops + 1, sizeof *s->value);
    if (!s->name || !s->value)
        return apc_fail(why, APC_ENOMEM, "out of memory");
    puts("loop     tuning   Kp         tau_i s  tau_d s  gain x  phase deg  delay s  peak  IAE      "
         "overshoot %  "
         "settling s");
    for (size_t i = 0; i < loops && rc == 0; i++) {
        const struct controller_loop loop = controllers_loop(&z->e, i);
        if (is_pid(&loop)) {
            rc = suggest_loop(z, &loop, s, why);
            n++;
        }
    }
    if (rc == 0 && n == 0)
        return apc_fail(
            why, APC_EINVAL,
            "%s has no PI or PID loop on an output of the plant: apc optimize searches other laws",
            z->o->run);
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
    z.tags = provision_tags(&z.e, &z.n_tags);
    rc = z.tags ? find_models(&z, why) : apc_fail(why, APC_ENOMEM, "out of memory");
    if (rc == 0)
        rc = suggest_loops(&z, s, why);
    if (rc == 0) {
        fputs("as written by --apply: apc tune", stdout);
        for (size_t i = 0; i < s->n; i++)
            printf(" %s=%.10g", s->name[i], s->value[i]);
        putchar('\n');
    }
    identify_data_free(&z.data);
    free(z.g);
    free(z.tags);
    experiment_free(&z.e);
    return rc;
}

void suggestion_free(struct suggestion *s)
{
    free(s->name);
    free(s->value);
}

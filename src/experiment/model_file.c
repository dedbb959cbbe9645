/* SPDX-License-Identifier: BSD-3-Clause */
/*
 * A model for a controller, written by people or by identification: transfer functions for each pair, or a
 * state space, in continuous time or sampled. It stands in a file of its own, or in the controller's group;
 * its inputs and outputs are signals of the controller, by their names, in any order.
 */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "experiment_parts.h"
#include "model_read.h"

/* ---- Signals ---------------------------------------------------------------------------------- */

static const char *name_of_wire(const struct experiment *e, struct wire w)
{
    const struct signal *of = w.table == APC_ACTUATOR ? e->u : w.table == APC_SETPOINT ? e->z : e->y;
    return of[w.at].tag.name;
}

/* Inputs are the controller's outputs, then its measured disturbances. */
static void name_signals(const struct experiment *e, const struct controller *c, struct model *m)
{
    const size_t inputs = c->dim.nu + c->dim.nd;

    m->input = (struct model_signals){"inputs", "output or measured disturbance",
                                      model_array(m->s, inputs, sizeof *m->input.name), inputs, NULL};
    m->output = (struct model_signals){"outputs", "measurement",
                                       model_array(m->s, c->dim.ny, sizeof *m->output.name), c->dim.ny, NULL};
    for (size_t i = 0; m->input.name && i < inputs; i++)
        m->input.name[i] = name_of_wire(e, i < c->dim.nu ? c->u[i] : c->d[i - c->dim.nu]);
    for (size_t i = 0; m->output.name && i < c->dim.ny; i++)
        m->output.name[i] = name_of_wire(e, c->y[i]);
}

/* ---- Transfer functions ----------------------------------------------------------------------- */

static void sample_transfer(const struct model *m, const config_setting_t *list, struct controller *c)
{
    struct apc_transfer *g = model_array(m->s, m->input.n * m->output.n, sizeof *g);
    struct apc_error why;

    if (g)
        model_read_transfer(m, list, g);
    if (!m->s->failed && apc_linear_from_transfer(&c->sampled, m->output.n, c->dim.nu, c->dim.nd, g, m->u0,
                                                  m->y0, apc_ns_to_s(c->rhythm.period), &why) < 0)
        settings_fail(m->s, list, "%s", why.text);
    free(g);
}

/* ---- State space ------------------------------------------------------------------------------ */

static void sample_space(const struct model *m, const config_setting_t *group, const struct model_space *p,
                         struct controller *c)
{
    const double Ts = apc_ns_to_s(c->rhythm.period);
    const struct apc_linear_continuous from = {.size = sizeof from,
                                               .nx = p->nx,
                                               .nu = c->dim.nu,
                                               .nd = c->dim.nd,
                                               .ny = m->output.n,
                                               .A = p->A,
                                               .B = p->B,
                                               .C = p->C,
                                               .D = p->D,
                                               .x0 = p->x0,
                                               .u0 = m->u0,
                                               .y0 = m->y0,
                                               .dead_time = p->dead_time};
    struct apc_error why;
    int rc;

    if (p->period && p->period != c->rhythm.period) {
        settings_fail(m->s, config_setting_get_member(group, "period"),
                      "\"period\" is %.15g s, that of %s %.15g s: they must be the same",
                      apc_ns_to_s(p->period), m->whose, Ts);
        return;
    }
    rc = p->period ? apc_linear_from_sampled(&c->sampled, &from, Ts, &why)
                   : apc_linear_from_continuous(&c->sampled, &from, Ts, &why);
    if (rc < 0)
        settings_fail(m->s, group, "%s", why.text);
}

/* ---- What disturbs ---------------------------------------------------------------------------- */

static bool has_setting(const struct controller *c, const char *name)
{
    for (size_t i = 0; i < c->n_setting; i++)
        if (strcmp(c->setting[i].name, name) == 0)
            return true;
    return false;
}

/* As the law has it; NULL: it knows no such setting. */
static const char *known_setting(const struct controller *c, const char *name)
{
    for (const char *const *known = c->law->settings; known && *known; known++)
        if (strcmp(*known, name) == 0)
            return *known;
    return NULL;
}

/* Does the law estimate by K? Not where its settings speak of the states, or say how measurements are
 * disturbed.
 */
static bool wants_filter(const struct controller *c)
{
    return known_setting(c, "x_noise") && known_setting(c, "y_noise") && !has_setting(c, "x_noise") &&
           !has_setting(c, "y_noise") && !has_setting(c, "x_scale");
}

/*
 * x[k+1] = A x[k] + B u[k] + K e[k], y[k] = C x[k] + D u[k] + e[k], with e as further states, which noise
 * makes anew for each sample: a filter that hardly doubts what is measured then corrects x[k+1] by K.
 */
static void widen_model(const struct model *m, struct model_space *p)
{
    const size_t outputs = m->output.n;
    double *A = p->room, *C = A + p->nx * p->nx;

    for (size_t i = 0; i < p->rows; i++) {
        memcpy(A + i * p->nx, p->A + i * p->rows, p->rows * sizeof *A);
        memcpy(A + i * p->nx + p->rows, p->K + i * outputs, outputs * sizeof *A);
    }
    for (size_t i = 0; i < outputs; i++) {
        memcpy(C + i * p->nx, p->C + i * p->rows, p->rows * sizeof *C);
        C[i * p->nx + p->rows + i] = 1.0;
    }
    p->A = A;
    p->C = C;
}

#define DOUBT 0.01 /* of a measurement, over the error that K was made for */

/* Noise of the states, per second as settings have it, and of the measurements. */
static void add_noise(const struct model *m, const struct model_space *p, struct controller *c)
{
    const double *old = c->values;
    const size_t n = c->n_setting, x = p->nx, y = m->output.n;
    size_t used = 0;
    struct apc_setting *setting = model_array(m->s, n + 3, sizeof *setting);

    for (size_t i = 0; i < n; i++)
        used += c->setting[i].rows * c->setting[i].columns;
    double *value = model_array(m->s, used + x + y, sizeof *value);
    if (setting && value) {
        for (size_t i = 0; i < n; i++) {
            setting[i] = c->setting[i];
            if (setting[i].value)
                setting[i].value = value + (setting[i].value - old);
        }
        if (used)
            memcpy(value, old, used * sizeof *value);
        free(c->setting);
        free(c->values);
        c->values = value;
        c->setting = setting;
        c->n_setting = n + 2;
        setting[n] = (struct apc_setting){
            .name = known_setting(c, "x_noise"), .rows = 1, .columns = x, .value = value + used};
        setting[n + 1] = (struct apc_setting){
            .name = known_setting(c, "y_noise"), .rows = 1, .columns = y, .value = value + used + x};
        for (size_t i = 0; i < y; i++) {
            value[used + p->rows + i] = p->error[i] / sqrt(apc_ns_to_s(c->rhythm.period));
            value[used + x + i] = DOUBT * p->error[i];
        }
    } else {
        free(setting);
        free(value);
    }
}

static void take_space(const struct model *m, const config_setting_t *group, struct controller *c)
{
    struct model_space p = {.memory = NULL};

    model_read_space(m, group, wants_filter(c), &p);
    if (!m->s->failed && p.nx > p.rows)
        widen_model(m, &p);
    if (!m->s->failed)
        sample_space(m, group, &p, c);
    if (!m->s->failed && p.nx > p.rows)
        add_noise(m, &p, c);
    free(p.memory);
}

/* ---- All of it -------------------------------------------------------------------------------- */

static void read_model_group(struct settings *s, const config_setting_t *root, const struct experiment *e,
                             struct controller *c)
{
    char whose[APC_TAG_LEN + 16];
    struct model m = {.s = s, .root = root, .whose = whose};
    const config_setting_t *transfer, *space;

    snprintf(whose, sizeof whose, "controller %s", c->name);
    name_signals(e, c, &m);
    model_kind(&m, &transfer, &space);
    if (!s->failed)
        model_begin(&m);
    if (!s->failed && transfer)
        sample_transfer(&m, transfer, c);
    else if (!s->failed)
        take_space(&m, space, c);
    model_end(&m);
    free(m.input.name);
    free(m.output.name);
}

static void read_model_file(struct settings *s, const config_setting_t *at, const struct experiment *e,
                            struct controller *c)
{
    struct apc_error why = {""};
    struct settings own = {.file = c->model_file, .why = &why};
    config_t config;

    experiment_resolve(s, config_setting_get_string(at), c->model_file, sizeof c->model_file);
    own.failed = settings_load(&config, c->model_file, &why);
    if (!own.failed)
        read_model_group(&own, config_root_setting(&config), e, c);
    if (own.failed)
        settings_fail(s, at, "%s", why.text);
    config_destroy(&config);
}

void model_file_read(struct settings *s, const config_setting_t *group, const struct experiment *e,
                     struct controller *c)
{
    const config_setting_t *at = config_setting_get_member(group, "model");

    if (!at || s->failed)
        return;
    if (!c->law->whole)
        settings_fail(s, at, "law %s takes no \"model\": it runs by itself for each output", c->law->name);
    else if (config_setting_get_member(group, "operating_point"))
        settings_fail(s, at, "\"model\" and \"operating_point\" are two models: one of them");
    else if (config_setting_is_group(at))
        read_model_group(s, at, e, c);
    else if (config_setting_get_string(at))
        read_model_file(s, at, e, c);
    else
        settings_fail(s, at, "\"model\" must be a file, as \"tanks.model\", or a group");
    if (s->failed)
        return;
    c->plant = (struct apc_law_plant){.D = c->sampled->D,
                                      .x0 = c->sampled->x0,
                                      .u0 = c->sampled->u0,
                                      .y0 = c->sampled->y0,
                                      .sampled = c->sampled};
}

/* ---- With its run ----------------------------------------------------------------------------- */

/* The group that stands for the file's name. */
static char *inline_model(const char *text, size_t *size)
{
    char *group = NULL;
    FILE *out = open_memstream(&group, size);

    if (out) {
        fprintf(out, "{ %s\n}", text);
        if (fclose(out) == 0)
            return group;
        free(group);
    }
    return NULL;
}

static int embed(const struct controller *c, char **text, struct apc_error *why)
{
    char *model = NULL, *group = NULL, *changed = NULL;
    size_t size = 0;
    int rc = settings_read(c->model_file, &model, why);

    if (rc < 0)
        return rc;
    group = inline_model(model, &size);
    rc = group ? experiment_change_model(*text, c->name, group, &changed, why)
               : apc_fail(why, APC_ENOMEM, "out of memory");
    if (rc == 0) {
        free(*text);
        *text = changed;
    }
    free(group);
    free(model);
    return rc;
}

int model_files_embed(const struct experiment *e, char **text, struct apc_error *why)
{
    *text = strdup(e->text);
    int rc = *text ? 0 : apc_fail(why, APC_ENOMEM, "out of memory");

    for (size_t i = 0; i < e->n_controllers && rc == 0; i++)
        if (e->controllers[i].model_file[0])
            rc = embed(&e->controllers[i], text, why);
    if (rc < 0) {
        free(*text);
        *text = NULL;
    }
    return rc;
}

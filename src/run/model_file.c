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

#include "apclinear.h"
#include "base/matrix.h"
#include "experiment_parts.h"
#include "nearest.h"

/* What is being read; place[i] is where signal i of the file is among the controller's. */
struct model {
    struct settings *s;
    const config_setting_t *root;
    const struct experiment *e;
    const struct controller *c;
    size_t inputs, outputs;
    size_t *input, *output; /* [inputs], [outputs] */
    double delay;           /* s, of all inputs */
    double *u0, *y0;        /* as the controller has them */
};

static void *array(struct settings *s, size_t n, size_t size)
{
    void *p = calloc(n ? n : 1, size);
    if (!p && !s->failed)
        s->failed = apc_fail(s->why, APC_ENOMEM, "%s: out of memory", s->file);
    return p;
}

/* ---- Names ------------------------------------------------------------------------------------ */

static const char *name_of(const struct experiment *e, struct wire w)
{
    const struct signal *of = w.table == APC_ACTUATOR ? e->u : w.table == APC_SETPOINT ? e->z : e->y;
    return of[w.at].tag.name;
}

/* Input i of the controller: its outputs, then its measured disturbances. */
static const char *input_name(const struct model *m, size_t i)
{
    const struct controller *c = m->c;
    return i < c->dim.nu ? name_of(m->e, c->u[i]) : name_of(m->e, c->d[i - c->dim.nu]);
}

static const char *output_name(const struct model *m, size_t i)
{
    return name_of(m->e, m->c->y[i]);
}

/* Which of the controller's signals that is. */
static size_t find(const struct model *m, const config_setting_t *at, const char *name, size_t n,
                   const char *(*name_at)(const struct model *, size_t))
{
    struct nearest nearest = {.wanted = name ? name : ""};

    for (size_t i = 0; name && i < n; i++) {
        if (!strcmp(name, name_at(m, i)))
            return i;
        nearest_look(&nearest, name_at(m, i));
    }
    settings_fail(m->s, at, "\"%s\" is no %s of controller %s%s%s%s", name ? name : "",
                  name_at == input_name ? "output or measured disturbance" : "measurement", m->c->name,
                  nearest.name ? ": did you mean \"" : "", nearest.name ? nearest.name : "",
                  nearest.name ? "\"?" : "");
    return 0;
}

/* All of the controller's signals, each once, in the file's order. */
static size_t *read_names(const struct model *m, const char *list, size_t n,
                          const char *(*name_at)(const struct model *, size_t))
{
    const config_setting_t *names = config_setting_get_member(m->root, list);
    size_t *place = array(m->s, n, sizeof *place);

    for (size_t i = 0; place && !names && i < n; i++)
        place[i] = i;
    if (names && (!config_setting_is_aggregate(names) || config_setting_is_group(names) ||
                  config_setting_length(names) != (int)n))
        settings_fail(m->s, names, "\"%s\" must name all %zu of controller %s, as [\"%s\", ...]", list, n,
                      m->c->name, name_at(m, 0));
    for (size_t i = 0; place && names && i < n && !m->s->failed; i++) {
        place[i] = find(m, names, config_setting_get_string_elem(names, (int)i), n, name_at);
        for (size_t k = 0; k < i; k++)
            if (place[k] == place[i])
                settings_fail(m->s, names, "\"%s\" names \"%s\" twice", list, name_at(m, place[i]));
    }
    return place;
}

/* ---- Numbers ---------------------------------------------------------------------------------- */

static void read_matrix(const struct model *m, const config_setting_t *group, const char *name, size_t rows,
                        size_t columns, double *to)
{
    const config_setting_t *list = settings_list(m->s, group, name, REQUIRED);

    if (list && config_setting_length(list) != (int)rows)
        settings_fail(m->s, list, "\"%s\" has %d rows: expected %zu of %zu numbers", name,
                      config_setting_length(list), rows, columns);
    for (size_t i = 0; list && i < rows && !m->s->failed; i++)
        settings_numbers(m->s, config_setting_get_elem(list, (unsigned)i), columns, to + i * columns);
}

static void read_array(const struct model *m, const config_setting_t *group, const char *name, size_t n,
                       double *to)
{
    const config_setting_t *at = group ? config_setting_get_member(group, name) : NULL;
    if (at)
        settings_numbers(m->s, at, n, to);
}

/* Numbers that stand in the file's order, to where the controller has them. */
static void read_signals(const struct model *m, const config_setting_t *group, const char *name,
                         const size_t *place, size_t n, double *to)
{
    double *from = array(m->s, n, sizeof *from);

    for (size_t i = 0; from && i < n; i++)
        from[i] = to[place[i]];
    if (from)
        read_array(m, group, name, n, from);
    for (size_t i = 0; from && i < n; i++)
        to[place[i]] = from[i];
    free(from);
}

static const config_setting_t *operating_point(const struct model *m, bool states)
{
    static const char *const known[] = {"u", "y", NULL}, *const with_x[] = {"u", "y", "x", NULL};
    const config_setting_t *group = settings_group(m->s, m->root, "operating_point", OPTIONAL);
    settings_known(m->s, group, states ? with_x : known);
    return group;
}

/* ---- Transfer functions ----------------------------------------------------------------------- */

static void read_pair(const struct model *m, const config_setting_t *group, struct apc_transfer *all,
                      bool *there)
{
    static const char *const known[] = {"from", "to",        "gain",        "zero",
                                        "tau",  "dead_time", "integrating", NULL};
    struct settings *s = m->s;
    char from[APC_TAG_LEN] = "", to[APC_TAG_LEN] = "";
    const config_setting_t *tau;

    if (!config_setting_is_group(group)) {
        settings_fail(s, group, "expected a group: { from = \"...\"; to = \"...\"; gain = 1.0; ... }");
        return;
    }
    settings_known(s, group, known);
    settings_text(s, group, "from", REQUIRED, from, sizeof from);
    settings_text(s, group, "to", REQUIRED, to, sizeof to);
    if (s->failed)
        return;
    const size_t j = find(m, config_setting_get_member(group, "from"), from, m->inputs, input_name);
    const size_t i = find(m, config_setting_get_member(group, "to"), to, m->outputs, output_name);
    struct apc_transfer *g = &all[i * m->inputs + j];
    if (!s->failed && there[i * m->inputs + j])
        settings_fail(s, group, "from %s to %s there is one already", from, to);
    there[i * m->inputs + j] = true;
    settings_number(s, group, "gain", REQUIRED, -APC_VALUE_MAX, APC_VALUE_MAX, &g->gain);
    settings_number(s, group, "zero", OPTIONAL, -APC_VALUE_MAX, APC_VALUE_MAX, &g->zero);
    settings_number(s, group, "dead_time", OPTIONAL, 0, APC_VALUE_MAX, &g->dead_time);
    settings_flag(s, group, "integrating", &g->integrating);
    g->dead_time += m->delay;
    tau = config_setting_get_member(group, "tau");
    if (!tau || s->failed)
        return;
    const int n = config_setting_is_aggregate(tau) ? config_setting_length(tau) : 0;
    if (n < 1 || n > 2)
        settings_fail(s, tau, "\"tau\" must be one or two time constants in s, as [60.0, 20.0]");
    else
        settings_numbers(s, tau, (size_t)n, g->tau);
    for (int k = 0; k < n && !s->failed; k++)
        if (!(g->tau[k] > 0.0))
            settings_fail(s, tau, "\"tau\" has %g: a time constant is above 0", g->tau[k]);
}

static void read_transfer(const struct model *m, const config_setting_t *list, struct apc_linear **to)
{
    struct apc_transfer *g = array(m->s, m->inputs * m->outputs, sizeof *g);
    bool *there = array(m->s, m->inputs * m->outputs, sizeof *there);
    const config_setting_t *at = operating_point(m, false);
    struct apc_error why;

    if (g && there && !m->s->failed) {
        read_signals(m, at, "u", m->input, m->inputs, m->u0);
        read_signals(m, at, "y", m->output, m->outputs, m->y0);
        for (int k = 0; k < config_setting_length(list) && !m->s->failed; k++)
            read_pair(m, config_setting_get_elem(list, (unsigned)k), g, there);
    }
    if (!m->s->failed && apc_linear_from_transfer(to, m->outputs, m->c->dim.nu, m->c->dim.nd, g, m->u0, m->y0,
                                                  apc_ns_to_s(m->c->rhythm.period), &why) < 0)
        settings_fail(m->s, list, "%s", why.text);
    free(there);
    free(g);
}

/* ---- State space ------------------------------------------------------------------------------ */

struct space {
    size_t nx, rows;                        /* rows: of A in the file; nx has the errors of K's as well */
    double *A, *B, *C, *D, *x0, *dead_time; /* A [rows * rows] and C [outputs * rows] until widen() */
    double *K, *error;                      /* [rows * outputs], [outputs]; unused without K */
    double *row;                            /* [inputs], [outputs * (rows + inputs)], room */
};

static void read_space(const struct model *m, const config_setting_t *group, struct space *p)
{
    const size_t nx = p->rows, inputs = m->inputs, outputs = m->outputs;
    const config_setting_t *at = operating_point(m, true);

    read_matrix(m, group, "A", nx, nx, p->A);
    read_matrix(m, group, "B", nx, inputs, p->B);
    read_matrix(m, group, "C", outputs, nx, p->C);
    if (config_setting_get_member(group, "D"))
        read_matrix(m, group, "D", outputs, inputs, p->D);
    read_array(m, at, "x", nx, p->x0);
    read_signals(m, at, "u", m->input, inputs, m->u0);
    read_signals(m, at, "y", m->output, outputs, m->y0);
    read_signals(m, group, "dead_time", m->input, inputs, p->dead_time);
    for (size_t j = 0; j < inputs; j++)
        if (p->dead_time[j] < 0.0)
            settings_fail(m->s, config_setting_get_member(group, "dead_time"),
                          "\"dead_time\" of %s is %g: must be 0 or above", input_name(m, j), p->dead_time[j]);
}

/* Column i of @p M [rows * columns] to @p place [i], where the controller has it. */
static void turn_columns(const size_t *place, size_t rows, size_t columns, double *M, double *row)
{
    for (size_t i = 0; i < rows; i++) {
        for (size_t j = 0; j < columns; j++)
            row[place[j]] = M[i * columns + j];
        memcpy(M + i * columns, row, columns * sizeof *row);
    }
}

static void turn_rows(const struct model *m, size_t columns, double *M, double *room)
{
    memcpy(room, M, m->outputs * columns * sizeof *room);
    for (size_t i = 0; i < m->outputs; i++)
        memcpy(M + m->output[i] * columns, room + i * columns, columns * sizeof *room);
}

static void sample_space(const struct model *m, const config_setting_t *group, const struct space *p,
                         struct apc_linear **to)
{
    const double Ts = apc_ns_to_s(m->c->rhythm.period);
    const struct apc_linear_continuous from = {.size = sizeof from,
                                               .nx = p->nx,
                                               .nu = m->c->dim.nu,
                                               .nd = m->c->dim.nd,
                                               .ny = m->outputs,
                                               .A = p->A,
                                               .B = p->B,
                                               .C = p->C,
                                               .D = p->D,
                                               .x0 = p->x0,
                                               .u0 = m->u0,
                                               .y0 = m->y0,
                                               .dead_time = p->dead_time};
    const config_setting_t *period = config_setting_get_member(group, "period");
    apc_ns own = 0;
    struct apc_error why;
    int rc;

    settings_period(m->s, group, "period", OPTIONAL, &own);
    if (!m->s->failed && period && own != m->c->rhythm.period)
        settings_fail(m->s, period, "\"period\" is %g s, that of controller %s %g s: they must be the same",
                      apc_ns_to_s(own), m->c->name, Ts);
    if (m->s->failed)
        return;
    rc = period ? apc_linear_from_sampled(to, &from, Ts, &why)
                : apc_linear_from_continuous(to, &from, Ts, &why);
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
           !has_setting(c, "y_noise") && !has_setting(c, "x_dev");
}

/*
 * x[k+1] = A x[k] + B u[k] + K e[k], y[k] = C x[k] + D u[k] + e[k], with e as further states, which noise
 * makes anew for each sample: a filter that hardly doubts what is measured then corrects x[k+1] by K.
 */
static void read_filter(const struct model *m, const config_setting_t *group, struct space *p)
{
    const config_setting_t *K = config_setting_get_member(group, "K"),
                           *error = config_setting_get_member(group, "error");

    if (!K != !error)
        settings_fail(m->s, K ? K : error,
                      "\"K\" and \"error\", how far y is from what it makes expected, go together");
    if (K && !config_setting_get_member(group, "period"))
        settings_fail(m->s, K, "\"K\" is that of a sampled model: \"period\" is missing");
    if (!K || m->s->failed)
        return;
    read_matrix(m, group, "K", p->rows, m->outputs, p->K);
    read_signals(m, group, "error", m->output, m->outputs, p->error);
    for (size_t i = 0; i < m->outputs && !m->s->failed; i++)
        if (!(p->error[i] > 0.0))
            settings_fail(m->s, error, "\"error\" of %s is %g: a standard deviation is above 0",
                          output_name(m, i), p->error[i]);
}

static void widen(const struct model *m, struct space *p, double *A, double *C)
{
    const size_t outputs = m->outputs;

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
static void add_noise(const struct model *m, const struct space *p, struct controller *c)
{
    const double *old = c->values;
    const size_t n = c->n_setting, x = p->nx, y = m->outputs;
    size_t used = 0;
    struct apc_setting *setting = array(m->s, n + 3, sizeof *setting);

    for (size_t i = 0; i < n; i++)
        used += c->setting[i].rows * c->setting[i].columns;
    double *value = array(m->s, used + x + y, sizeof *value);
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

static void read_state_space(const struct model *m, const config_setting_t *group, struct controller *c)
{
    static const char *const known[] = {"period", "A", "B", "C", "D", "K", "error", "dead_time", NULL};
    const config_setting_t *A = settings_list(m->s, group, "A", REQUIRED);
    const size_t rows = A ? (size_t)config_setting_length(A) : 0, inputs = m->inputs, outputs = m->outputs;
    const bool filter = config_setting_get_member(group, "K") && wants_filter(m->c);
    const size_t nx = rows + (filter ? outputs : 0);
    struct space p = {.nx = nx, .rows = rows};
    double *memory;

    settings_known(m->s, group, known);
    if (A && (rows == 0 || rows > 1000))
        settings_fail(m->s, A, "\"A\" has %zu rows: a model has 1 to 1000 states", rows);
    if (m->s->failed)
        return;
    memory =
        array(m->s, 2 * nx * nx + nx * (inputs + outputs + 1) + 3 * outputs * (nx + inputs + 1) + 2 * inputs,
              sizeof *memory);
    if (memory) {
        double *at = memory;

        p.A = apc_carve(&at, nx * nx);
        p.B = apc_carve(&at, nx * inputs);
        p.C = apc_carve(&at, outputs * nx);
        p.D = apc_carve(&at, outputs * inputs);
        p.x0 = apc_carve(&at, nx);
        p.dead_time = apc_carve(&at, inputs);
        p.K = apc_carve(&at, nx * outputs);
        p.error = apc_carve(&at, outputs);
        p.row = apc_carve(&at, inputs + outputs * (nx + inputs + 1));
        for (size_t j = 0; j < inputs; j++)
            p.dead_time[j] = m->delay;
        read_space(m, group, &p);
        read_filter(m, group, &p);
        if (!m->s->failed) {
            turn_columns(m->input, rows, inputs, p.B, p.row);
            turn_columns(m->input, outputs, inputs, p.D, p.row);
            turn_columns(m->output, rows, outputs, p.K, p.row);
            turn_rows(m, rows, p.C, p.row);
            turn_rows(m, inputs, p.D, p.row);
            for (size_t j = 0; j < inputs && config_setting_get_member(group, "dead_time"); j++)
                p.dead_time[j] += m->delay;
            if (filter) {
                double *wide = apc_carve(&at, nx * nx);

                widen(m, &p, wide, at);
            }
            sample_space(m, group, &p, &c->sampled);
        }
    }
    if (filter && !m->s->failed)
        add_noise(m, &p, c);
    free(memory);
}

/* ---- All of it -------------------------------------------------------------------------------- */

static void read_model(struct settings *s, const config_setting_t *root, const struct experiment *e,
                       struct controller *c)
{
    static const char *const known[] = {"inputs",      "outputs", "operating_point", "delay", "transfer",
                                        "state_space", NULL};
    struct model m = {
        .s = s, .root = root, .e = e, .c = c, .inputs = c->dim.nu + c->dim.nd, .outputs = c->dim.ny};
    const config_setting_t *transfer = settings_list(s, root, "transfer", OPTIONAL),
                           *space = settings_group(s, root, "state_space", OPTIONAL);

    settings_known(s, root, known);
    settings_number(s, root, "delay", OPTIONAL, 0, APC_VALUE_MAX, &m.delay);
    if (!s->failed && !transfer == !space)
        settings_fail(s, root, "a model is either \"transfer\" = ( ... ) or \"state_space\" = { ... }");
    m.input = read_names(&m, "inputs", m.inputs, input_name);
    m.output = read_names(&m, "outputs", m.outputs, output_name);
    m.u0 = array(s, m.inputs, sizeof *m.u0);
    m.y0 = array(s, m.outputs, sizeof *m.y0);
    if (!s->failed && transfer)
        read_transfer(&m, transfer, &c->sampled);
    else if (!s->failed)
        read_state_space(&m, space, c);
    free(m.y0);
    free(m.u0);
    free(m.output);
    free(m.input);
}

static void read_file(struct settings *s, const config_setting_t *at, const struct experiment *e,
                      struct controller *c)
{
    struct apc_error why = {""};
    struct settings own = {.file = c->model_file, .why = &why};
    config_t config;

    experiment_resolve(s, config_setting_get_string(at), c->model_file, sizeof c->model_file);
    own.failed = settings_load(&config, c->model_file, &why);
    if (!own.failed)
        read_model(&own, config_root_setting(&config), e, c);
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
        read_model(s, at, e, c);
    else if (config_setting_get_string(at))
        read_file(s, at, e, c);
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
    char path[APC_TAG_LEN + 32], *model = NULL, *group = NULL, *changed = NULL;
    size_t size = 0;
    int rc = settings_read(c->model_file, &model, why);

    if (rc < 0)
        return rc;
    group = inline_model(model, &size);
    snprintf(path, sizeof path, "controllers.%s.model", c->name);
    rc = group ? experiment_change(*text, path, group, &changed, why)
               : apc_fail(why, APC_ENOMEM, "out of memory");
    if (rc == APC_ENOTFOUND) /* the short form */
        rc = experiment_change(*text, "controller.model", group, &changed, why);
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

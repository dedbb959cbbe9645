/* SPDX-License-Identifier: BSD-3-Clause */
#include "experiment_parts.h"

#include "apclinear.h"

#include <stdlib.h>
#include <string.h>

#include "files/files.h"

bool experiment_wants_model(const config_setting_t *controller)
{
    return controller && config_setting_get_member(controller, "operating_point");
}

static double *numbers(struct settings *s, size_t n)
{
    double *p = calloc(n ? n : 1, sizeof *p);
    if (!p && !s->failed)
        s->failed = apc_fail(s->why, APC_ENOMEM, "%s: out of memory", s->file);
    return p;
}

/* ---- Former names ---------------------------------------------------------------------------- */

static bool law_has(const struct apc_law *law, const char *name)
{
    const char *const *setting = law->settings;
    size_t j = 0;
    while (j < law->n_tuning && strcmp(law->tuning[j].name, name) != 0)
        j++;
    while (setting && *setting && strcmp(*setting, name) != 0)
        setting++;
    return j < law->n_tuning || (setting && *setting);
}

bool experiment_is_former(const struct controller *c, const char *name)
{
    const char *present = former_name(name);
    return present && c->law && !law_has(c->law, name) && law_has(c->law, present);
}

static void rename_members(struct settings *s, const config_setting_t *group, struct controller *c)
{
    const int n = group && config_setting_is_group(group) ? config_setting_length(group) : 0;
    for (int i = 0; i < n && !s->failed; i++) {
        config_setting_t *member = config_setting_get_elem(group, (unsigned)i);
        const char *name = config_setting_name(member), *present = former_name(name);
        if (!experiment_is_former(c, name))
            continue;
        if (config_setting_get_member(group, present)) {
            settings_fail(s, member,
                          "\"%s\" is the former name of \"%s\", and both are given: leave \"%s\" out", name,
                          present, name);
            return;
        }
        char *own = strdup(present);
        if (!own) {
            s->failed = apc_fail(s->why, APC_ENOMEM, "%s: out of memory", s->file);
            return;
        }
        free(member->name); /* libconfig renames nothing */
        member->name = own;
        c->former = former_of(present);
    }
}

void experiment_rename(struct settings *s, const config_setting_t *group, struct controller *c)
{
    static const char *const groups[] = {"settings", "limits"}, *const lists[] = {"tuning",
                                                                                  "measurement_tuning"};
    for (size_t i = 0; i < sizeof groups / sizeof *groups; i++)
        rename_members(s, config_setting_get_member(group, groups[i]), c);
    for (size_t i = 0; i < sizeof lists / sizeof *lists; i++) {
        const config_setting_t *list = config_setting_get_member(group, lists[i]);
        for (int k = 0; list && config_setting_is_list(list) && k < config_setting_length(list); k++)
            rename_members(s, config_setting_get_elem(list, (unsigned)k), c);
    }
}

/* ---- Settings -------------------------------------------------------------------------------- */

static bool is_matrix(const config_setting_t *member)
{
    const config_setting_t *first =
        config_setting_is_list(member) ? config_setting_get_elem(member, 0) : NULL;
    return first && config_setting_is_aggregate(first);
}

/* How many numbers: one, an array of them, or rows of the same length. */
static void shape_setting(const config_setting_t *member, struct apc_setting *to)
{
    const size_t n = config_setting_is_aggregate(member) ? (size_t)config_setting_length(member) : 1;

    to->rows = is_matrix(member) ? n : 1;
    to->columns = is_matrix(member) ? (size_t)config_setting_length(config_setting_get_elem(member, 0)) : n;
}

/* A text is copied; the name is the law's own copy. */
static void read_setting(struct settings *s, const config_setting_t *group, const config_setting_t *member,
                         const char *const *known, struct apc_setting *to, double *value)
{
    const char *name = config_setting_name(member), *text = config_setting_get_string(member);

    for (; *known; known++)
        if (strcmp(*known, name) == 0)
            to->name = *known;
    to->value = value;
    if (text && !(to->text = strdup(text)))
        s->failed = apc_fail(s->why, APC_ENOMEM, "%s: out of memory", s->file);
    else if (text)
        to->value = NULL;
    else if (is_matrix(member))
        for (size_t i = 0; i < to->rows; i++)
            settings_numbers(s, config_setting_get_elem(member, (unsigned)i), to->columns,
                             value + i * to->columns);
    else if (config_setting_is_aggregate(member))
        settings_numbers(s, member, to->columns, value);
    else
        settings_number(s, group, name, REQUIRED, -APC_VALUE_MAX, APC_VALUE_MAX, value);
}

static void read_settings(struct settings *s, const config_setting_t *group, struct controller *c)
{
    static const char *const none[] = {NULL};
    const char *const *known = c->law->settings ? c->law->settings : none;
    const config_setting_t *list = settings_group(s, group, "settings", OPTIONAL);
    size_t n = list ? (size_t)config_setting_length(list) : 0, total = 0;

    if (!list)
        return;
    settings_known(s, list, known);
    if (s->failed)
        return;
    struct apc_setting *setting = c->setting = calloc(n + 1, sizeof *c->setting);
    if (!setting) {
        s->failed = apc_fail(s->why, APC_ENOMEM, "%s: out of memory", s->file);
        return;
    }
    c->n_setting = n;
    for (size_t i = 0; i < n; i++) {
        shape_setting(config_setting_get_elem(list, (unsigned)i), &setting[i]);
        total += setting[i].rows * setting[i].columns;
    }
    double *value = c->values = numbers(s, total);
    for (size_t i = 0; i < n && !s->failed; i++) {
        read_setting(s, list, config_setting_get_elem(list, (unsigned)i), known, &setting[i], value);
        value += setting[i].rows * setting[i].columns;
    }
}

/* ---- The operating point --------------------------------------------------------------------- */

/* Which of the plant's disturbances each measured one is: that of the same name. */
static size_t *match_disturbances(struct settings *s, const config_setting_t *at, const struct experiment *e,
                                  const struct controller *c)
{
    const struct apc_model *m = e->plant.model;
    size_t *match = calloc(c->dim.nd + 1, sizeof *match);
    if (!match)
        s->failed = apc_fail(s->why, APC_ENOMEM, "%s: out of memory", s->file);
    for (size_t k = 0; k < c->dim.nd && match && !s->failed; k++) {
        const char *name = e->y[c->d[k].at].tag.name;
        while (match[k] < m->nd && strcmp(m->disturbance[match[k]].name, name) != 0)
            match[k]++;
        if (match[k] == m->nd)
            settings_fail(
                s, at,
                "\"operating_point\": plant %s has no disturbance \"%s\", whose effect is not known: give a "
                "\"model\" instead",
                m->name, name);
    }
    return match;
}

/* Columns of u and of the measured disturbances, of all that the plant has. */
static void take_law_columns(const struct controller *c, size_t rows, const double *all, size_t n_all,
                             size_t nu, double *to)
{
    const size_t n = nu + c->dim.nd;
    for (size_t i = 0; i < rows; i++)
        for (size_t k = 0; k < n; k++)
            to[i * n + k] = all[i * n_all + (k < nu ? k : nu + c->disturbance[k - nu])];
}

/* From what the file says, or the model's own values, to the steady state there and the linear model. */
static void linearize_law_model(struct settings *s, const config_setting_t *at, const struct experiment *e,
                                struct controller *c)
{
    const struct apc_model *m;
    struct apc_error why;

    if (apc_model_equations(e->plant.model, &m, &why) < 0) {
        settings_fail(s, at, "%s", why.text);
        return;
    }
    size_t nx = m->nx, nu = m->nu, all = nu + m->nd, ny = m->ny, n = nu + c->dim.nd;
    double *memory = numbers(s, nx * nx + (nx + ny + 1) * (all + n) + ny * nx + nx + ny);
    const config_setting_t *x_setting = config_setting_get_member(at, "x");
    const config_setting_t *u_setting = config_setting_get_member(at, "u");

    c->linear = memory;
    c->disturbance = match_disturbances(s, at, e, c);
    if (s->failed)
        return;
    double *A = memory, *C = A + nx * nx, *B = C + ny * nx, *D = B + nx * n, *x = D + ny * n, *u = x + nx,
           *y = u + all, *B_all = y + ny, *D_all = B_all + nx * all, *u0 = D_all + ny * all;
    for (size_t i = 0; i < nx; i++)
        x[i] = m->state ? m->state[i].initial : 0;
    for (size_t i = 0; i < nu; i++)
        u[i] = m->input ? m->input[i].initial : 0;
    for (size_t i = 0; i < m->nd; i++)
        u[nu + i] = m->disturbance ? m->disturbance[i].initial : 0;
    if (x_setting)
        settings_numbers(s, x_setting, nx, x);
    if (u_setting)
        settings_numbers(s, u_setting, nu, u);
    if (s->failed)
        return;
    int rc = apc_model_equilibrium(m, c->believed, u, x, &why);
    if (rc == 0)
        rc = apc_model_linearize(m, c->believed, x, u, A, B_all, C, D_all, &why);
    if (rc == 0)
        rc = apc_model_evaluate(m, c->believed, x, u, NULL, y, &why);
    if (rc < 0) {
        settings_fail(s, at, "%s", why.text);
        return;
    }
    take_law_columns(c, nx, B_all, all, nu, B);
    take_law_columns(c, ny, D_all, all, nu, D);
    take_law_columns(c, 1, u, all, nu, u0);
    c->plant = (struct apc_law_plant){.nx = nx,
                                      .A = A,
                                      .B = B,
                                      .C = C,
                                      .D = D,
                                      .x0 = x,
                                      .u0 = u0,
                                      .y0 = y,
                                      .model = m,
                                      .p = c->believed,
                                      .disturbance = c->disturbance};
}

/* Does its law know of loops between its outputs and the plant's? */
static bool has_lower(const struct controller *c)
{
    size_t i = 0;

    while (i < c->n_setting && strcmp(c->setting[i].name, "lower") != 0)
        i++;
    return i < c->n_setting;
}

static void read_operating_point(struct settings *s, const config_setting_t *group,
                                 const struct experiment *e, struct controller *c)
{
    static const char *const known[] = {"x", "u", "parameters", NULL};
    const config_setting_t *at = settings_group(s, group, "operating_point", OPTIONAL);

    if (!at)
        return;
    settings_known(s, at, known);
    if (!s->failed && !controllers_has_all(e, c, has_lower(c)))
        settings_fail(
            s, at,
            "\"operating_point\" needs a controller of all measurements and outputs, in their order: give "
            "%s a \"model\" instead",
            c->name);
    if (!s->failed)
        experiment_read_believed(s, at, e, c);
    if (!s->failed)
        linearize_law_model(s, at, e, c);
}

/* ---- Tuning ---------------------------------------------------------------------------------- */

/* The law's parameters, with the limits that group `limits` narrows. */
static void read_limits(struct settings *s, const config_setting_t *group, struct controller *c)
{
    const struct apc_law *law = c->law;
    const config_setting_t *list = c->plugin.chosen ? NULL : settings_group(s, group, "limits", OPTIONAL);

    c->param = calloc(law->n_tuning + 1, sizeof *c->param);
    if (!c->param) {
        s->failed = apc_fail(s->why, APC_ENOMEM, "%s: out of memory", s->file);
        return;
    }
    for (size_t j = 0; j < law->n_tuning; j++)
        c->param[j] = law->tuning[j];
    for (int i = 0; list && i < config_setting_length(list) && !s->failed; i++) {
        const config_setting_t *member = config_setting_get_elem(list, (unsigned)i);
        double limit[2];
        size_t j = 0;
        while (j < law->n_tuning && strcmp(law->tuning[j].name, config_setting_name(member)) != 0)
            j++;
        if (j == law->n_tuning) {
            settings_fail(s, member, "%s has no parameter \"%s\"; `apc laws %s` shows its parameters",
                          law->name, config_setting_name(member), law->name);
            return;
        }
        struct apc_param *param = &c->param[j];
        settings_numbers(s, member, 2, limit);
        if (!s->failed && !(limit[0] >= param->low && limit[0] <= limit[1] && limit[1] <= param->high))
            settings_fail(s, member,
                          "\"limits\" of %s must rise and lie within those of the law, %.15g to %.15g",
                          param->name, param->low, param->high);
        param->low = limit[0];
        param->high = limit[1];
    }
}

static void check_law_tuning(struct settings *s, const config_setting_t *at, const struct controller *c)
{
    const struct apc_law *law = c->law;
    const size_t n = apc_law_parameters(law, &c->dim);

    for (size_t i = 0; i < n && !s->failed; i++) {
        const struct apc_law_parameter p = apc_law_parameter_at(law, &c->dim, i);
        const struct apc_param *param = &c->param[p.number];
        double value = c->tuning[i];
        if (value < param->low || value > param->high)
            settings_fail(s, at, "%s of output %zu is %.15g, outside its \"limits\", %.15g to %.15g",
                          param->name, p.of + 1, value, param->low, param->high);
    }
}

/* ---- Trial ----------------------------------------------------------------------------------- */

static void try_law(struct settings *s, const config_setting_t *group, const config_setting_t *tuning,
                    const struct controller *c)
{
    const struct apc_law_setup setup = module_law_setup(c);
    struct apc_error why;
    int rc = apc_law_try(c->law, &setup, c->tuning, &why);

    if (rc < 0)
        settings_fail(s, rc == APC_ERANGE ? tuning : group, "%s", why.text);
}

/* The gain that stays is that of measurements which come at each tick: where one comes seldom, what is
 * estimated may run away. */
static void check_seldom(struct settings *s, const config_setting_t *group, const struct experiment *e,
                         const struct controller *c)
{
    bool steady = !strcmp(c->law->name, "mpc");
    for (size_t i = 0; i < c->n_setting; i++)
        if (!strcmp(c->setting[i].name, "steady") && c->setting[i].value)
            steady = steady && c->setting[i].value[0] > 0.0;
    for (size_t i = 0; i < c->dim.ny && steady && !s->failed; i++) {
        const struct signal *y = &e->y[c->y[i].at];
        if (y->period > c->rhythm.period)
            settings_fail(
                s, group,
                "%s comes every %.15g s, and law mpc ticks every %.15g s: its filter must have a gain for "
                "when it is there and for when it is not: steady = 0 in \"settings\"",
                y->tag.name, apc_ns_to_s(y->period), apc_ns_to_s(c->rhythm.period));
    }
}

void experiment_read_law(struct settings *s, const config_setting_t *group, const struct experiment *e,
                         struct controller *c)
{
    if (s->failed || !c->law)
        return;
    if (!c->plugin.chosen)
        read_settings(s, group, c);
    if (e->plant.model && !e->plant.plugin.chosen)
        read_operating_point(s, group, e, c);
    if (!c->plugin.chosen)
        model_file_read(s, group, e, c);
    if (!s->failed)
        read_limits(s, group, c);
    const config_setting_t *at = config_setting_get_member(group, "tuning");
    if (!s->failed)
        check_law_tuning(s, at ? at : group, c);
    if (!s->failed)
        check_seldom(s, group, e, c);
    if (!s->failed)
        try_law(s, group, at ? at : group, c);
}

void experiment_free_law(struct controller *c)
{
    free(c->tuning);
    free(c->param);
    for (size_t i = 0; i < c->n_setting; i++)
        free((char *)(uintptr_t)c->setting[i].text);
    free(c->setting);
    free(c->values);
    free(c->linear);
    free(c->disturbance);
    free(c->believed);
    apc_linear_destroy(c->sampled);
    apc_plugin_close(c->law_handle);
}

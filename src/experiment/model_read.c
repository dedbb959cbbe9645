/* SPDX-License-Identifier: BSD-3-Clause */
#include "model_read.h"

#include <stdlib.h>
#include <string.h>

#include "base/matrix.h"
#include "experiment.h"
#include "files/files.h"

void *model_array(struct settings *s, size_t n, size_t size)
{
    void *p = calloc(n ? n : 1, size);
    if (!p && !s->failed)
        s->failed = apc_fail(s->why, APC_ENOMEM, "%s: out of memory", s->file);
    return p;
}

/* ---- Names ------------------------------------------------------------------------------------ */

/* Which of the signals that is. */
static size_t find_model_signal(const struct model *m, const config_setting_t *at, const char *name,
                                const struct model_signals *of)
{
    struct nearest nearest = {.wanted = name ? name : ""};

    for (size_t i = 0; name && i < of->n; i++) {
        if (!strcmp(name, of->name[i]))
            return i;
        nearest_look(&nearest, of->name[i]);
    }
    settings_fail(m->s, at, "\"%s\" is no %s of %s%s%s%s", name ? name : "", of->kind, m->whose,
                  nearest.name ? ": did you mean \"" : "", nearest.name ? nearest.name : "",
                  nearest.name ? "\"?" : "");
    return 0;
}

/* All of the signals, each once, in the file's order. */
static void read_model_names(const struct model *m, struct model_signals *of)
{
    const config_setting_t *names = config_setting_get_member(m->root, of->list);

    of->place = model_array(m->s, of->n, sizeof *of->place);
    for (size_t i = 0; of->place && !names && i < of->n; i++)
        of->place[i] = i;
    if (names && (!config_setting_is_aggregate(names) || config_setting_is_group(names) ||
                  config_setting_length(names) != (int)of->n))
        settings_fail(m->s, names, "\"%s\" must name all %zu of %s, as [\"%s\", ...]", of->list, of->n,
                      m->whose, of->name[0]);
    for (size_t i = 0; of->place && names && i < of->n && !m->s->failed; i++) {
        const char *name = config_setting_get_string_elem(names, (int)i);
        if (!name)
            settings_fail(m->s, names, "\"%s\" must be names in double quotes", of->list);
        of->place[i] = find_model_signal(m, names, name, of);
        for (size_t k = 0; k < i; k++)
            if (of->place[k] == of->place[i])
                settings_fail(m->s, names, "\"%s\" names \"%s\" twice", of->list, of->name[of->place[i]]);
    }
}

void model_begin(struct model *m)
{
    settings_number(m->s, m->root, "delay", OPTIONAL, 0, APC_VALUE_MAX, &m->delay);
    read_model_names(m, &m->input);
    read_model_names(m, &m->output);
    m->u0 = model_array(m->s, m->input.n, sizeof *m->u0);
    m->y0 = model_array(m->s, m->output.n, sizeof *m->y0);
}

void model_end(struct model *m)
{
    free(m->y0);
    free(m->u0);
    free(m->output.place);
    free(m->input.place);
}

void model_kind(const struct model *m, const config_setting_t **transfer, const config_setting_t **space)
{
    static const char *const known[] = {"inputs",      "outputs", "operating_point", "delay", "transfer",
                                        "state_space", NULL};

    *transfer = settings_list(m->s, m->root, "transfer", OPTIONAL);
    *space = settings_group(m->s, m->root, "state_space", OPTIONAL);
    settings_known(m->s, m->root, known);
    if (!m->s->failed && !*transfer == !*space)
        settings_fail(m->s, m->root, "a model is either \"transfer\" = ( ... ) or \"state_space\" = { ... }");
}

/* ---- Numbers ---------------------------------------------------------------------------------- */

static void read_matrix(const struct model *m, const config_setting_t *group, const char *name, size_t rows,
                        size_t columns, double *to)
{
    const config_setting_t *list = settings_list(m->s, group, name, REQUIRED);

    if (list && config_setting_length(list) != (int)rows)
        settings_fail(m->s, list, "\"%s\" must have %zu x %zu numbers; rows: %d", name, rows, columns,
                      config_setting_length(list));
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

/* Numbers that stand in the file's order, to their places. */
static void read_signal_numbers(const struct model *m, const config_setting_t *group, const char *name,
                                const struct model_signals *of, double *to)
{
    double *from = model_array(m->s, of->n, sizeof *from);

    for (size_t i = 0; from && i < of->n; i++)
        from[i] = to[of->place[i]];
    if (from)
        read_array(m, group, name, of->n, from);
    for (size_t i = 0; from && i < of->n; i++)
        to[of->place[i]] = from[i];
    free(from);
}

static const config_setting_t *operating_point(const struct model *m, bool states)
{
    static const char *const known[] = {"u", "y", NULL}, *const with_x[] = {"u", "y", "x", NULL};
    const config_setting_t *group = settings_group(m->s, m->root, "operating_point", OPTIONAL);

    settings_known(m->s, group, states ? with_x : known);
    read_signal_numbers(m, group, "u", &m->input, m->u0);
    read_signal_numbers(m, group, "y", &m->output, m->y0);
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
    const size_t j = find_model_signal(m, config_setting_get_member(group, "from"), from, &m->input);
    const size_t i = find_model_signal(m, config_setting_get_member(group, "to"), to, &m->output);
    const size_t at = i * m->input.n + j;
    struct apc_transfer *g = &all[at];
    if (!s->failed && there[at])
        settings_fail(s, group, "\"transfer\" leads twice from %s to %s: leave one out", from, to);
    there[at] = true;
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
            settings_fail(s, tau, "\"tau\" has %.15g: time constants must be above 0", g->tau[k]);
}

void model_read_transfer(const struct model *m, const config_setting_t *list, struct apc_transfer *g)
{
    bool *there = model_array(m->s, m->input.n * m->output.n, sizeof *there);

    if (!m->s->failed)
        operating_point(m, false);
    for (int k = 0; k < config_setting_length(list) && !m->s->failed; k++)
        read_pair(m, config_setting_get_elem(list, (unsigned)k), g, there);
    free(there);
}

/* ---- State space ------------------------------------------------------------------------------ */

static void read_dead_times(const struct model *m, const config_setting_t *group, struct model_space *p)
{
    const config_setting_t *at = config_setting_get_member(group, "dead_time");

    read_signal_numbers(m, group, "dead_time", &m->input, p->dead_time);
    for (size_t j = 0; j < m->input.n; j++) {
        if (p->dead_time[j] < 0.0)
            settings_fail(m->s, at, "\"dead_time\" of %s is %.15g: must be 0 or above", m->input.name[j],
                          p->dead_time[j]);
        p->dead_time[j] += m->delay;
    }
}

/* How far measurements are from what the model makes expected, and what it learns of that. */
static void read_filter(const struct model *m, const config_setting_t *group, struct model_space *p)
{
    const config_setting_t *K = config_setting_get_member(group, "K"),
                           *error = config_setting_get_member(group, "error");

    if (!K != !error)
        settings_fail(m->s, K ? K : error,
                      "\"K\" needs \"error\", the standard deviations of the prediction errors, and "
                      "\"error\" needs \"K\"");
    if (K && !config_setting_get_member(group, "period"))
        settings_fail(m->s, K, "\"K\" needs a sampled model: \"period\" is missing");
    if (!K || m->s->failed)
        return;
    read_matrix(m, group, "K", p->rows, m->output.n, p->K);
    read_signal_numbers(m, group, "error", &m->output, p->error);
    for (size_t i = 0; i < m->output.n && !m->s->failed; i++)
        if (!(p->error[i] > 0.0))
            settings_fail(m->s, error, "\"error\" of %s is %.15g: a standard deviation is above 0",
                          m->output.name[i], p->error[i]);
}

/* Column i of @p M [rows * columns] to @p place [i]. */
static void turn_columns(const struct model_signals *of, size_t rows, double *M, double *row)
{
    for (size_t i = 0; i < rows; i++) {
        for (size_t j = 0; j < of->n; j++)
            row[of->place[j]] = M[i * of->n + j];
        memcpy(M + i * of->n, row, of->n * sizeof *row);
    }
}

static void turn_rows(const struct model_signals *of, size_t columns, double *M, double *room)
{
    memcpy(room, M, of->n * columns * sizeof *room);
    for (size_t i = 0; i < of->n; i++)
        memcpy(M + of->place[i] * columns, room + i * columns, columns * sizeof *room);
}

static int allocate_model_space(const struct model *m, struct model_space *p)
{
    const size_t nx = p->nx, inputs = m->input.n, outputs = m->output.n;
    const size_t turning = inputs + outputs * (nx + inputs), widening = nx * nx + outputs * nx;
    double *at = model_array(m->s,
                             nx * nx + nx * (inputs + outputs + 1) + outputs * (nx + inputs + 1) + inputs +
                                 turning + widening,
                             sizeof *at);

    p->memory = at;
    if (!at)
        return m->s->failed;
    p->A = apc_carve(&at, nx * nx);
    p->B = apc_carve(&at, nx * inputs);
    p->C = apc_carve(&at, outputs * nx);
    p->D = apc_carve(&at, outputs * inputs);
    p->x0 = apc_carve(&at, nx);
    p->dead_time = apc_carve(&at, inputs);
    p->K = apc_carve(&at, nx * outputs);
    p->error = apc_carve(&at, outputs);
    p->room = at;
    return 0;
}

void model_read_space(const struct model *m, const config_setting_t *group, bool more, struct model_space *p)
{
    static const char *const known[] = {"period", "A", "B", "C", "D", "K", "error", "dead_time", NULL};
    const config_setting_t *A = settings_list(m->s, group, "A", REQUIRED);
    const size_t rows = A ? (size_t)config_setting_length(A) : 0, inputs = m->input.n, outputs = m->output.n;

    settings_known(m->s, group, known);
    if (A && (rows == 0 || rows > 1000))
        settings_fail(m->s, A, "\"A\" has %zu rows: a model has 1 to 1000 states", rows);
    if (m->s->failed)
        return;
    p->filter = config_setting_get_member(group, "K") != NULL;
    p->rows = rows;
    p->nx = rows + (p->filter && more ? outputs : 0);
    if (allocate_model_space(m, p) < 0)
        return;
    settings_period(m->s, group, "period", OPTIONAL, &p->period);
    read_array(m, operating_point(m, true), "x", rows, p->x0);
    read_matrix(m, group, "A", rows, rows, p->A);
    read_matrix(m, group, "B", rows, inputs, p->B);
    read_matrix(m, group, "C", outputs, rows, p->C);
    if (config_setting_get_member(group, "D"))
        read_matrix(m, group, "D", outputs, inputs, p->D);
    read_dead_times(m, group, p);
    read_filter(m, group, p);
    if (m->s->failed)
        return;
    turn_columns(&m->input, rows, p->B, p->room);
    turn_columns(&m->input, outputs, p->D, p->room);
    turn_columns(&m->output, rows, p->K, p->room);
    turn_rows(&m->output, rows, p->C, p->room);
    turn_rows(&m->output, inputs, p->D, p->room);
}

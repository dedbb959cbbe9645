/* SPDX-License-Identifier: BSD-3-Clause */
/* A model file by itself: its signals are those that it names, or x1, u1, y1. */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "experiment.h"
#include "model_read.h"

#define SIGNALS 1000 /* of a kind, at most */

struct names {
    char (*name)[APC_TAG_LEN];
    size_t n;
};

static void add_signal_name(struct settings *s, const config_setting_t *at, struct names *names,
                            const char *name)
{
    char(*more)[APC_TAG_LEN];

    for (size_t i = 0; i < names->n; i++)
        if (!strcmp(names->name[i], name))
            return;
    if (!*name || strlen(name) >= APC_TAG_LEN || names->n == SIGNALS) {
        settings_fail(s, at, "\"%.*s\" is no name of a signal, or one too many", APC_TAG_LEN, name);
        return;
    }
    more = s->failed ? NULL : realloc(names->name, (names->n + 1) * sizeof *more);
    if (!more) {
        s->failed = s->failed ? s->failed : apc_fail(s->why, APC_ENOMEM, "%s: out of memory", s->file);
        return;
    }
    names->name = more;
    snprintf(more[names->n++], APC_TAG_LEN, "%s", name);
}

static void add_numbered(struct settings *s, const config_setting_t *at, struct names *names, char letter,
                         int n)
{
    for (int i = 0; i < n && !s->failed; i++) {
        char name[24];

        snprintf(name, sizeof name, "%c%d", letter, i + 1);
        add_signal_name(s, at, names, name);
    }
}

static int length(const config_setting_t *list)
{
    return list && config_setting_is_aggregate(list) ? config_setting_length(list) : 0;
}

/* As the list of that name says, or what the pairs speak of, or a number each. */
static void find_names(const struct model *m, const char *list, const char *side, char letter, int n,
                       const config_setting_t *pairs, struct names *names)
{
    const config_setting_t *said = config_setting_get_member(m->root, list);

    for (int i = 0; i < length(said) && !m->s->failed; i++) {
        const char *name = config_setting_get_string_elem(said, i);

        add_signal_name(m->s, said, names, name ? name : "");
        if (!m->s->failed && names->n == (size_t)i)
            settings_fail(m->s, said, "\"%s\" names \"%s\" twice", list, name);
    }
    for (int i = 0; i < length(pairs) && !said && !m->s->failed; i++) {
        const config_setting_t *pair = config_setting_get_elem(pairs, (unsigned)i);
        const char *name = NULL;

        if (config_setting_is_group(pair) && config_setting_lookup_string(pair, side, &name))
            add_signal_name(m->s, pair, names, name);
        else
            settings_fail(m->s, pair, "expected a group: { from = \"...\"; to = \"...\"; gain = 1.0; ... }");
    }
    if (!said && !pairs)
        add_numbered(m->s, m->root, names, letter, n);
    if (names->n == 0 && !m->s->failed)
        settings_fail(m->s, m->root, "the model has no %s", list);
}

static void take_model_signals(struct model_signals *to, struct settings *s, const char *list,
                               const char *kind, const struct names *names)
{
    *to = (struct model_signals){list, kind, model_array(s, names->n, sizeof *to->name), names->n, NULL};
    for (size_t i = 0; to->name && i < names->n; i++)
        to->name[i] = names->name[i];
}

static void read_transfer(const struct model *m, const config_setting_t *list, struct model_file *f)
{
    f->g = model_array(m->s, f->inputs * f->outputs, sizeof *f->g);
    if (f->g)
        model_read_transfer(m, list, f->g);
}

static void read_space(const struct model *m, const config_setting_t *group, struct model_file *f)
{
    struct model_space p = {.memory = NULL};

    model_read_space(m, group, false, &p);
    f->space = p.memory;
    f->nx = p.nx;
    f->period = p.period;
    f->A = p.A;
    f->B = p.B;
    f->C = p.C;
    f->D = p.D;
    f->K = p.filter ? p.K : NULL;
    f->x0 = p.x0;
    f->dead_time = p.dead_time;
}

static void read_model_matrices(struct settings *s, const config_setting_t *root, struct model_file *f)
{
    struct model m = {.s = s, .root = root, .whose = "this model"};
    const config_setting_t *transfer, *space, *B, *C;
    struct names input = {.n = 0}, output = {.n = 0};

    model_kind(&m, &transfer, &space);
    B = space ? config_setting_get_member(space, "B") : NULL;
    C = space ? config_setting_get_member(space, "C") : NULL;
    if (!s->failed)
        find_names(&m, "inputs", "from", 'u', length(B) ? length(config_setting_get_elem(B, 0)) : 0, transfer,
                   &input);
    if (!s->failed)
        find_names(&m, "outputs", "to", 'y', length(C), transfer, &output);
    f->input = input.name;
    f->output = output.name;
    f->inputs = input.n;
    f->outputs = output.n;
    if (s->failed)
        return;
    take_model_signals(&m.input, s, "inputs", "input", &input);
    take_model_signals(&m.output, s, "outputs", "output", &output);
    if (!s->failed)
        model_begin(&m);
    if (!s->failed && transfer)
        read_transfer(&m, transfer, f);
    else if (!s->failed)
        read_space(&m, space, f);
    f->u0 = m.u0;
    f->y0 = m.y0;
    m.u0 = m.y0 = NULL;
    model_end(&m);
    free(m.input.name);
    free(m.output.name);
}

int model_file_load(struct model_file *f, const char *file, struct apc_error *why)
{
    struct settings s = {.file = file, .why = why};
    config_t config;

    *f = (struct model_file){.inputs = 0};
    s.failed = settings_load(&config, file, why);
    if (!s.failed)
        read_model_matrices(&s, config_root_setting(&config), f);
    config_destroy(&config);
    return s.failed;
}

void model_file_free(struct model_file *f)
{
    free(f->input);
    free(f->output);
    free(f->g);
    free(f->space);
    free(f->u0);
    free(f->y0);
}

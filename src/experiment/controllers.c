/* SPDX-License-Identifier: BSD-3-Clause */
/*
 * The controllers of an experiment file, and what hangs on what: which signals each one has, that each output
 * has one owner, and that nobody in the end waits for himself.
 */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "experiment_parts.h"
#include "files/files.h"
#include "operate/operate.h"

/* A kind of signals, to be found by their names. */
struct kind {
    const char *what; /* "measurement" */
    enum apc_table table;
    const struct signal *at;
    size_t n;
};

static void *controllers_array(struct settings *s, size_t n, size_t size)
{
    void *p = calloc(n ? n : 1, size);
    if (!p && !s->failed)
        s->failed = apc_fail(s->why, APC_ENOMEM, "%s: out of memory", s->file);
    return p;
}

/* ---- Lists of names ------------------------------------------------------------------------ */

static bool look_up(const struct kind *kinds, size_t n, const char *name, struct wire *wire,
                    struct nearest *nearest)
{
    for (size_t k = 0; k < n; k++)
        for (size_t i = 0; i < kinds[k].n; i++) {
            if (!strcmp(kinds[k].at[i].tag.name, name)) {
                *wire = (struct wire){kinds[k].table, i};
                return true;
            }
            nearest_look(nearest, kinds[k].at[i].tag.name);
        }
    return false;
}

static bool are_same_wires(struct wire a, struct wire b)
{
    return a.table == b.table && a.at == b.at;
}

/* The names of list @p list of a controller, each of which stands for a signal of one of the kinds. */
static size_t read_wire_names(struct settings *s, const config_setting_t *group, const char *list,
                              enum settings_presence presence, const struct kind *kinds, size_t n_kinds,
                              struct wire **wires)
{
    const config_setting_t *names = config_setting_get_member(group, list);
    const size_t n = names && config_setting_is_aggregate(names) ? (size_t)config_setting_length(names) : 0;
    struct wire *w = *wires = controllers_array(s, n, sizeof *w);

    if (n == 0 && (names || presence == REQUIRED))
        settings_fail(s, names ? names : group, "\"%s\" must name at least one %s: %s = [\"...\"];", list,
                      kinds[0].what, list);
    for (size_t i = 0; i < n && !s->failed; i++) {
        const config_setting_t *one = config_setting_get_elem(names, (unsigned)i);
        const char *name = config_setting_get_string(one);
        struct nearest nearest = {.wanted = name ? name : ""};
        if (!name)
            settings_fail(s, names, "\"%s\" must be names in double quotes", list);
        else if (!look_up(kinds, n_kinds, name, &w[i], &nearest))
            settings_fail(s, one, "there is no %s \"%s\"%s%s%s", kinds[0].what, name,
                          nearest.name ? ": did you mean \"" : "", nearest.name ? nearest.name : "",
                          nearest.name ? "\"?" : "");
        for (size_t k = 0; k < i && !s->failed; k++)
            if (are_same_wires(w[k], w[i]))
                settings_fail(s, one, "\"%s\" names \"%s\" twice", list, name);
    }
    return n;
}

static void read_wiring(struct settings *s, const config_setting_t *group, const struct experiment *e,
                        struct controller *c)
{
    const struct kind y[] = {{"measurement", APC_SENSOR, e->y, e->dim.ny + e->n_signals}},
                      z[] = {{"setpoint", APC_SETPOINT, e->z, e->dim.nz}},
                      u[] = {{"output", APC_ACTUATOR, e->u, e->dim.nu},
                             {"setpoint", APC_SETPOINT, e->z, e->dim.nz},
                             {"signal", APC_SENSOR, e->y + e->dim.ny, e->n_signals}};
    c->dim.ny = read_wire_names(s, group, "measurements", REQUIRED, y, 1, &c->y);
    c->dim.nz = read_wire_names(s, group, "setpoints", OPTIONAL, z, 1, &c->z);
    c->dim.nu = read_wire_names(s, group, "outputs", REQUIRED, u, 3, &c->u);
    c->dim.nd = read_wire_names(s, group, "disturbances", OPTIONAL, y, 1, &c->d);
    for (size_t i = 0; i < c->dim.nu && !s->failed; i++)
        if (c->u[i].table == APC_SENSOR)
            c->u[i].at += e->dim.ny; /* calculated ones stand behind the measurements */
}

static struct wire *all(struct settings *s, enum apc_table table, size_t n)
{
    struct wire *w = controllers_array(s, n, sizeof *w);
    for (size_t i = 0; w && i < n; i++)
        w[i] = (struct wire){table, i};
    return w;
}

/* ---- What hangs on what -------------------------------------------------------------------- */

static const struct signal *signal_of_wire(const struct experiment *e, struct wire w)
{
    return w.table == APC_ACTUATOR ? &e->u[w.at] : w.table == APC_SETPOINT ? &e->z[w.at] : &e->y[w.at];
}

static struct apc_signal_view view_of(const struct experiment *e, struct wire w)
{
    const struct signal *of = signal_of_wire(e, w);
    return (struct apc_signal_view){.name = of->tag.name,
                                    .unit = of->tag.unit,
                                    .low = of->tag.low,
                                    .high = of->tag.high,
                                    .rate = of->rate > 0 ? of->rate : HUGE_VAL,
                                    .soft_low = of->tag.table == APC_SENSOR ? of->soft_low : -HUGE_VAL,
                                    .soft_high = of->tag.table == APC_SENSOR ? of->soft_high : HUGE_VAL,
                                    .critical = of->critical};
}

void experiment_view(struct settings *s, const struct experiment *e, struct controller *c)
{
    const struct wire *const of[] = {c->y, c->z, c->u, c->d};
    const size_t n[] = {c->dim.ny, c->dim.nz, c->dim.nu, c->dim.nd};
    struct apc_signal_view *v = c->view = controllers_array(s, n[0] + n[1] + n[2] + n[3], sizeof *v);
    for (size_t k = 0; v && k < sizeof n / sizeof *n; k++)
        for (size_t i = 0; i < n[k]; i++)
            *v++ = view_of(e, of[k][i]);
    for (size_t i = 0; c->view && i < c->dim.nu; i++) {
        double *own = &c->view[c->dim.ny + c->dim.nz + i].rate;
        *own = c->rate[i] > 0 ? fmin(c->rate[i], *own) : *own;
        c->rate[i] = *own < HUGE_VAL ? *own : 0;
    }
    if (c->backup)
        c->backup->view = c->view;
}

static bool has_wire(const struct wire *w, size_t n, struct wire wanted)
{
    for (size_t i = 0; i < n; i++)
        if (are_same_wires(w[i], wanted))
            return true;
    return false;
}

static const struct controller *owner_of_wire(const struct experiment *e, struct wire w)
{
    for (size_t i = 0; i < e->n_controllers; i++)
        if (has_wire(e->controllers[i].u, e->controllers[i].dim.nu, w))
            return &e->controllers[i];
    return NULL;
}

/* What @p lower takes of what @p upper puts out; NULL: nothing. */
static const struct wire *cascade_input_of(const struct controller *lower, const struct controller *upper)
{
    for (size_t i = 0; i < upper->dim.nu; i++)
        if (has_wire(lower->z, lower->dim.nz, upper->u[i]) ||
            has_wire(lower->y, lower->dim.ny, upper->u[i]) || has_wire(lower->d, lower->dim.nd, upper->u[i]))
            return &upper->u[i];
    return NULL;
}

const struct controller *controllers_taker(const struct experiment *e, struct wire setpoint)
{
    for (size_t i = 0; i < e->n_controllers; i++)
        if (has_wire(e->controllers[i].z, e->controllers[i].dim.nz, setpoint))
            return &e->controllers[i];
    return NULL;
}

const struct controller *controllers_selector(const struct experiment *e, struct wire signal)
{
    for (size_t i = 0; i < e->n_controllers; i++) {
        const struct controller *c = &e->controllers[i];
        if (c->law && c->law->selects && has_wire(c->y, c->dim.ny, signal))
            return c;
    }
    return NULL;
}

/* The first one with output @p k of @p c: one that stands before it, or itself. */
static const struct controller *first_owner(const struct experiment *e, const struct controller *c, size_t k)
{
    for (const struct controller *before = e->controllers; before < c; before++)
        if (has_wire(before->u, before->dim.nu, c->u[k]))
            return before;
    return c;
}

/* The one that acts on the outputs of @p c where nobody was promoted: itself, or the one whose shadow it is. */
static const struct controller *first_acting_controller(const struct experiment *e,
                                                        const struct controller *c)
{
    return first_owner(e, c, 0);
}

static const config_setting_t *group_of_controller(const config_setting_t *list, const struct experiment *e,
                                                   const struct controller *c)
{
    return config_setting_get_elem(list, (unsigned)(c - e->controllers));
}

/* Output @p k of a controller that is to be in shadow. */
static void check_shadowed(struct settings *s, const config_setting_t *at, const struct experiment *e,
                           const struct controller *c, size_t k)
{
    const struct controller *first = first_acting_controller(e, c);
    if (first == c || first->shadow || first->dim.nu != c->dim.nu || first_owner(e, c, k) != first)
        settings_fail(s, at,
                      "%s is to be in shadow: its outputs must be all those of one controller that stands "
                      "before it, and is in nobody's shadow",
                      c->name);
}

/* Setpoint @p k of a controller, which another one may have only if both act on the same outputs. */
static void check_taken_setpoint(struct settings *s, const config_setting_t *list, const struct experiment *e,
                                 const struct controller *c, size_t k)
{
    for (const struct controller *before = e->controllers; before < c && !s->failed; before++)
        if (has_wire(before->z, before->dim.nz, c->z[k]) &&
            first_acting_controller(e, before) != first_acting_controller(e, c))
            settings_fail(s, config_setting_get_member(group_of_controller(list, e, c), "setpoints"),
                          "\"%s\" is a setpoint of two controllers, %s and %s",
                          signal_of_wire(e, c->z[k])->tag.name, before->name, c->name);
}

static void check_owners(struct settings *s, const config_setting_t *list, const struct experiment *e)
{
    for (size_t i = 0; i < e->n_controllers && !s->failed; i++) {
        const struct controller *c = &e->controllers[i];
        for (size_t k = 0; k < c->dim.nu && !s->failed; k++) {
            const struct controller *first = first_owner(e, c, k);
            const config_setting_t *at = config_setting_get_elem(
                config_setting_get_member(group_of_controller(list, e, c), "outputs"), (unsigned)k);
            const char *name = signal_of_wire(e, c->u[k])->tag.name;
            if (c->shadow)
                check_shadowed(s, at, e, c, k);
            else if (first != c)
                settings_fail(s, at, "\"%s\" is an output of two controllers, %s and %s", name, first->name,
                              c->name);
            else if (has_wire(c->z, c->dim.nz, c->u[k]))
                settings_fail(s, at, "\"%s\" is both a setpoint and an output of %s: name it in one list",
                              name, c->name);
            else if (c->u[k].table == APC_SETPOINT && !controllers_taker(e, c->u[k]))
                settings_fail(s, at, "no controller has \"%s\" in its \"setpoints\": it would have no effect",
                              name);
        }
        for (size_t k = 0; k < c->dim.nz && !s->failed; k++)
            check_taken_setpoint(s, list, e, c, k);
    }
}

static void check_owned(struct settings *s, const config_setting_t *list, const struct experiment *e)
{
    for (size_t i = 0; i < e->dim.nu && !s->failed; i++)
        if (!owner_of_wire(e, (struct wire){APC_ACTUATOR, i}))
            settings_fail(s, list,
                          "output \"%s\" belongs to no controller: name it in the \"outputs\" of one",
                          e->u[i].tag.name);
    for (size_t i = e->dim.ny; i < e->dim.ny + e->n_signals && !s->failed; i++)
        if (!owner_of_wire(e, (struct wire){APC_SENSOR, i}))
            settings_fail(s, list, "no controller has signal \"%s\" in its \"outputs\": name it in one",
                          e->y[i].tag.name);
}

static bool hangs_on(const struct experiment *e, const bool *gone, size_t lower, size_t upper)
{
    return !gone[upper] && cascade_input_of(&e->controllers[lower], &e->controllers[upper]);
}

/* Whoever waits for nobody that is left, or is waited for by nobody, goes. What stays goes round in circles. */
static size_t reduce_cycle(const struct experiment *e, bool *gone)
{
    size_t left = e->n_controllers, before;
    do {
        before = left;
        for (size_t i = 0; i < e->n_controllers; i++) {
            bool waits = false, awaited = false;
            for (size_t k = 0; k < e->n_controllers && !gone[i]; k++) {
                waits = waits || hangs_on(e, gone, i, k);
                awaited = awaited || (!gone[k] && cascade_input_of(&e->controllers[k], &e->controllers[i]));
            }
            if (gone[i] || (waits && awaited))
                continue;
            gone[i] = true;
            left--;
        }
    } while (left < before);
    return left;
}

static size_t awaited_by(const struct experiment *e, const bool *gone, size_t lower)
{
    size_t upper = 0;
    while (!hangs_on(e, gone, lower, upper))
        upper++;
    return upper;
}

static void check_circles(struct settings *s, const config_setting_t *list, const struct experiment *e)
{
    char names[300] = "";
    bool *gone = controllers_array(s, e->n_controllers, sizeof *gone);
    if (!gone || reduce_cycle(e, gone) == 0) {
        free(gone);
        return;
    }
    size_t first, in = 0, length = 0;
    while (gone[in])
        in++;
    for (size_t i = 0; i < e->n_controllers; i++) /* from what only waits for a circle into it */
        in = awaited_by(e, gone, in);
    first = in;
    for (size_t i = awaited_by(e, gone, in); i != in; i = awaited_by(e, gone, i))
        first = i < first ? i : first;
    for (size_t i = first; (i != first || !length) && length < sizeof names;) {
        const size_t upper = awaited_by(e, gone, i);
        const struct controller *c = &e->controllers[i], *of = &e->controllers[upper];
        length +=
            (size_t)snprintf(names + length, sizeof names - length, "%s%s for %s of %s", length ? ", " : "",
                             c->name, signal_of_wire(e, *cascade_input_of(c, of))->tag.name, of->name);
        i = upper;
    }
    settings_fail(s, group_of_controller(list, e, &e->controllers[first]),
                  "controllers wait for each other in a circle: %s", names);
    free(gone);
}

/* Those of one depth have nothing to do with each other. */
static void find_depths(struct experiment *e)
{
    for (size_t round = 1; round < e->n_controllers; round++)
        for (size_t i = 0; i < e->n_controllers; i++)
            for (size_t k = 0; k < e->n_controllers; k++) {
                struct controller *lower = &e->controllers[i], *upper = &e->controllers[k];
                if (lower->depth <= upper->depth && cascade_input_of(lower, upper))
                    lower->depth = upper->depth + 1;
            }
}

/* ---- Loops --------------------------------------------------------------------------------- */

size_t controllers_loops(const struct experiment *e)
{
    size_t n = 0;
    for (size_t i = 0; i < e->n_controllers; i++)
        n += e->controllers[i].dim.nu;
    return n;
}

struct controller_loop controllers_loop(const struct experiment *e, size_t n)
{
    const struct controller *c = e->controllers;
    for (; n >= c->dim.nu; c++)
        n -= c->dim.nu;
    return (struct controller_loop){c, n};
}

double *controllers_loop_parameter(const struct controller_loop *loop, const char *name, int *id)
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

const struct apc_tag *controllers_output(const struct experiment *e, struct controller_loop loop)
{
    return &signal_of_wire(e, loop.of->u[loop.u])->tag;
}

size_t controllers_parameters(const struct controller *c)
{
    return apc_law_parameters(c->law, &c->dim) +
           (c->backup ? apc_law_parameters(c->backup->law, &c->dim) : 0);
}

int controllers_loop_id(struct controller_loop loop)
{
    return loop.of->first_loop + (int)loop.u;
}

void controllers_program(const struct experiment *e, const struct controller *c, char name[APC_TAG_LEN])
{
    const bool one = e->n_controllers == 1;
    snprintf(name, APC_TAG_LEN, "apc-controller%s%.48s", one ? "" : " ", one ? "" : c->name);
}

void controllers_loop_name(const struct experiment *e, struct controller_loop loop, char name[APC_TAG_LEN])
{
    const char *output = controllers_output(e, loop)->name;
    if (loop.of->u[loop.u].table != APC_SETPOINT && !loop.of->shadow)
        snprintf(name, APC_TAG_LEN, "%s", output);
    else
        snprintf(name, APC_TAG_LEN, "%.31s.%.31s", loop.of->name, output);
}

struct controller_loop controllers_above(const struct experiment *e, struct wire output)
{
    for (size_t i = 0; i < e->n_controllers; i++)
        for (size_t k = 0; k < e->controllers[i].dim.nu; k++)
            if (are_same_wires(e->controllers[i].u[k], output))
                return (struct controller_loop){&e->controllers[i], k};
    return (struct controller_loop){NULL, 0};
}

/* By what its law says; without a law nobody asks. */
struct controller_loop controllers_below_in(const struct controller *c, struct wire setpoint)
{
    for (size_t i = 0; c && c->pair && i < c->dim.nu; i++)
        if (c->pair[i].setpoint > 0 && are_same_wires(c->z[c->pair[i].setpoint - 1], setpoint))
            return (struct controller_loop){c, i};
    return (struct controller_loop){NULL, 0};
}

struct controller_loop controllers_below(const struct experiment *e, struct wire setpoint)
{
    return controllers_below_in(controllers_taker(e, setpoint), setpoint);
}

bool controllers_is_below(const struct experiment *e, struct controller_loop loop)
{
    for (size_t k = 0; k < loop.of->dim.nz; k++) {
        const struct controller_loop below = controllers_below_in(loop.of, loop.of->z[k]);
        if (below.of && below.u == loop.u && controllers_above(e, loop.of->z[k]).of)
            return true;
    }
    return false;
}

/* By its law, to ids of what it controls and of its setpoint; 0: none. */
static void pair_loops(const struct experiment *e, const struct controller *c, struct loops_loop *loop)
{
    for (size_t i = 0; i < c->dim.nu; i++) {
        const struct controller_loop at = {c, i};
        const struct apc_pair in_order = {i < c->dim.ny ? i + 1 : 0,
                                          i < c->dim.nz ? i + 1 : 0}, /* as most do */
            pair = c->pair ? c->pair[i] : in_order;
        loop[i].measurement = pair.measurement > 0 ? (int)c->y[pair.measurement - 1].at + 1 : 0;
        loop[i].setpoint = pair.setpoint > 0 ? (int)c->z[pair.setpoint - 1].at + 1 : 0;
        controllers_loop_name(e, at, loop[i].name);
        loop[i].id = loop[i].manual = controllers_loop_id(at);
        loop[i].controller = (size_t)(c - e->controllers);
        loop[i].table = c->u[i].table;
        loop[i].output = (int)c->u[i].at + 1;
        loop[i].above = -1;
    }
}

int controllers_describe(const struct experiment *e, struct loops *loops)
{
    *loops = (struct loops){.at = calloc(controllers_loops(e) + 1, sizeof *loops->at),
                            .controller = calloc(e->n_controllers + 1, sizeof *loops->controller),
                            .scheduled = calloc(e->scheduler.n + 1, sizeof *loops->scheduled)};
    if (!loops->at || !loops->controller || !loops->scheduled)
        return APC_ENOMEM;
    for (size_t i = 0; i < e->scheduler.n; i++)
        loops->scheduled[loops->n_scheduled++] = (int)e->scheduler.z[i].at + 1;
    for (size_t i = 0; i < e->n_controllers; i++) {
        const struct controller *c = &e->controllers[i];
        struct loops_controller *to = &loops->controller[loops->n_controllers++];
        *to = (struct loops_controller){.number = c->number,
                                        .period = c->rhythm.period,
                                        .first = loops->n,
                                        .n = c->dim.nu,
                                        .choice = c->acting,
                                        .acts = !c->shadow};
        memcpy(to->name, c->name, sizeof to->name);
        pair_loops(e, c, &loops->at[loops->n]);
        loops->n += c->dim.nu;
    }
    for (size_t i = 0; i < loops->n; i++) {
        const struct wire setpoint = {APC_SETPOINT, (size_t)loops->at[i].setpoint - 1};
        const struct controller_loop above = controllers_above(e, setpoint);
        if (loops->at[i].setpoint > 0 && above.of)
            loops->at[i].above = controllers_loop_id(above) - 1;
    }
    return 0;
}

static void check_cascade(struct settings *s, const config_setting_t *list, const struct experiment *e,
                          struct controller_loop upper)
{
    const struct wire setpoint = upper.of->u[upper.u];
    if (setpoint.table != APC_SETPOINT)
        return;
    const struct signal *signal = signal_of_wire(e, setpoint);
    const config_setting_t *at = config_setting_get_elem(
        config_setting_get_member(group_of_controller(list, e, upper.of), "outputs"), (unsigned)upper.u);
    for (size_t i = 0; i < e->n_controllers && !s->failed; i++) {
        const struct controller *lower = &e->controllers[i];
        if (has_wire(lower->z, lower->dim.nz, setpoint) && !controllers_below_in(lower, setpoint).of)
            settings_fail(s, at,
                          "\"%s\" is not what law %s of %s controls an output to: nobody would take it",
                          signal->tag.name, lower->law->name, lower->name);
    }
    if (isnan(signal->initial) && !s->failed)
        settings_fail(s, at, "setpoint \"%s\" is moved by %s: it needs an \"initial\" value to begin with",
                      signal->tag.name, upper.of->name);
}

struct count {
    int numbers, vectors;
};

static void count_published_output(void *ctx, size_t output, const struct apc_published *published)
{
    struct count *n = ctx;
    (void)output;
    n->numbers += published->length == 0;
    n->vectors += published->length > 0;
}

static void number_published(struct settings *s, struct controller *c, struct count *n)
{
    const struct apc_law_setup setup = module_law_setup(c);
    c->first_estimate = n->numbers + 1;
    c->first_prediction = n->vectors + 1;
    c->n_published = apc_law_published(c->law, &setup, count_published_output, n, s->why);
    if (c->n_published < 0)
        s->failed = c->n_published;
}

static void pair_outputs(struct settings *s, struct controller *c)
{
    const struct apc_law_setup setup = module_law_setup(c);
    c->pair = controllers_array(s, c->dim.nu, sizeof *c->pair);
    if (c->pair) /* what it says of its outputs was looked at when it was tried */
        (void)apc_law_pairing(c->law, &setup, c->pair, NULL);
}

static int acting(struct wire output)
{
    return LOOPS_ACTING(output.table, (int)output.at + 1);
}

/* Is it in shadow of another one, or another one in its? */
static bool has_shadow(const struct experiment *e, const struct controller *c)
{
    for (size_t i = 0; i < e->n_controllers; i++)
        if (e->controllers[i].shadow &&
            first_acting_controller(e, &e->controllers[i]) == first_acting_controller(e, c))
            return true;
    return false;
}

void experiment_number(struct settings *s, const config_setting_t *list, struct experiment *e, bool laws)
{
    struct count published = {0};
    int loop = 1, tuning = 1;
    for (size_t i = 0; i < e->n_controllers && !s->failed; i++) {
        struct controller *c = &e->controllers[i];
        c->number = (int)i + 1;
        c->first_loop = loop;
        loop += (int)c->dim.nu;
        c->first_tuning = laws ? tuning : 0;
        if (laws && c->backup)
            c->backup->first_tuning = tuning + (int)apc_law_parameters(c->law, &c->dim);
        tuning += laws ? (int)controllers_parameters(c) : 0;
        if (laws) {
            pair_outputs(s, c);
            number_published(s, c, &published);
        }
        if (laws && has_shadow(e, c)) {
            c->acting = acting(first_acting_controller(e, c)->u[0]);
            c->first_output = published.numbers + 1;
            published.numbers += (int)c->dim.nu;
        }
    }
    for (size_t n = 0; laws && n < controllers_loops(e) && !s->failed; n++)
        check_cascade(s, list, e, controllers_loop(e, n));
}

/* ---- The list ------------------------------------------------------------------------------ */

static void read_name(struct settings *s, const config_setting_t *group, const struct experiment *e,
                      struct controller *c)
{
    const struct kind signals[] = {{"", APC_SENSOR, e->y, e->dim.ny + e->n_signals},
                                   {"", APC_SETPOINT, e->z, e->dim.nz},
                                   {"", APC_ACTUATOR, e->u, e->dim.nu}};
    static const char *const tasks[] = {"scheduler", "plant", "client"};
    struct nearest nearest = {.wanted = c->name};
    struct wire taken;
    settings_name(s, group, c->name, sizeof c->name);
    if (s->failed)
        return;
    for (size_t i = 0; i < sizeof tasks / sizeof *tasks; i++)
        if (!strcmp(c->name, tasks[i]))
            settings_fail(s, config_setting_get_member(group, "name"),
                          "a controller cannot be called \"%s\": that is another task of the run", c->name);
    if (strchr(c->name, '.'))
        settings_fail(s, config_setting_get_member(group, "name"),
                      "\"name\" of a controller has no dot: \"%s\"", c->name);
    if (look_up(signals, 3, c->name, &taken, &nearest))
        settings_fail(s, config_setting_get_member(group, "name"),
                      "a controller and a signal are called \"%s\": give one of them another name", c->name);
    for (const struct controller *other = e->controllers; other < c && !s->failed; other++)
        if (!strcmp(other->name, c->name))
            settings_fail(s, config_setting_get_member(group, "name"),
                          "two controllers are called \"%s\": give each a name of its own", c->name);
}

static void read_controllers_list(struct settings *s, const config_setting_t *list, struct experiment *e)
{
    const int n = config_setting_length(list);
    if (n < 1)
        settings_fail(s, list, "\"controllers\" must have at least one group");
    e->controllers = controllers_array(s, (size_t)n, sizeof *e->controllers);
    for (int i = 0; i < n && !s->failed; i++) {
        const config_setting_t *group = config_setting_get_elem(list, (unsigned)i);
        struct controller *c = &e->controllers[e->n_controllers++];
        if (!config_setting_is_group(group)) {
            settings_fail(s, group, "expected a group: { name = \"...\"; ... }");
            return;
        }
        read_name(s, group, e, c);
        settings_flag(s, group, "shadow", &c->shadow);
        read_wiring(s, group, e, c);
    }
    if (s->failed) /* some may be without what it names */
        return;
    check_owners(s, list, e);
    check_owned(s, list, e);
    check_circles(s, list, e);
    if (!s->failed)
        find_depths(e);
}

/* One controller of all signals, in order; so it calculates none. */
static void read_short(struct settings *s, const config_setting_t *group, struct experiment *e)
{
    struct controller *c = e->controllers = controllers_array(s, 1, sizeof *c);
    if (!c)
        return;
    e->n_controllers = 1;
    *c = (struct controller){.name = "controller", .dim = e->dim};
    c->y = all(s, APC_SENSOR, e->dim.ny);
    c->z = all(s, APC_SETPOINT, e->dim.nz);
    c->u = all(s, APC_ACTUATOR, e->dim.nu);
    check_owned(s, group, e);
}

/* The rate of a setpoint is that of the loop that puts it out. */
static void check_rates(struct settings *s, const config_setting_t *setpoints, const struct experiment *e)
{
    for (size_t i = 0; i < e->dim.nz && !s->failed; i++)
        if (e->z[i].rate > 0 && !owner_of_wire(e, (struct wire){APC_SETPOINT, i}))
            settings_fail(
                s, config_setting_get_elem(setpoints, (unsigned)i),
                "\"rate\" of setpoint \"%s\" has no effect, since no controller moves it: use law \"ramp\"",
                e->z[i].tag.name);
}

const config_setting_t *experiment_read_controllers(struct settings *s, const config_setting_t *root,
                                                    struct experiment *e)
{
    const config_setting_t *list = settings_list(s, root, "controllers", OPTIONAL);
    const config_setting_t *group = settings_group(s, root, "controller", list ? OPTIONAL : REQUIRED);
    if (list && group)
        settings_fail(s, group,
                      "the file has \"controller\" and \"controllers\": write one controller as "
                      "\"controller\", several as \"controllers\"");
    if (s->failed)
        return NULL;
    if (list)
        read_controllers_list(s, list, e);
    else
        read_short(s, group, e);
    check_rates(s, config_setting_get_member(root, "setpoints"), e);
    return s->failed ? NULL : list ? list : group;
}

size_t experiment_read_columns(struct settings *s, const config_setting_t *group, const struct experiment *e,
                               struct wire **columns)
{
    const struct kind z[] = {{"setpoint", APC_SETPOINT, e->z, e->dim.nz}};
    const config_setting_t *names = config_setting_get_member(group, "setpoints");
    size_t n = 0;
    if (names)
        n = read_wire_names(s, group, "setpoints", REQUIRED, z, 1, columns);
    else if ((*columns = all(s, APC_SETPOINT, e->dim.nz)))
        for (size_t i = 0; i < e->dim.nz; i++)
            if (!owner_of_wire(e, (*columns)[i]))
                (*columns)[n++] = (*columns)[i];
    for (size_t i = 0; i < n && !s->failed; i++)
        if (owner_of_wire(e, (*columns)[i]))
            settings_fail(s, names, "\"%s\" is moved by controller %s already",
                          signal_of_wire(e, (*columns)[i])->tag.name, owner_of_wire(e, (*columns)[i])->name);
    return n;
}

void experiment_free_controllers(struct experiment *e)
{
    for (size_t i = 0; i < e->n_controllers; i++) {
        free(e->controllers[i].y);
        free(e->controllers[i].z);
        free(e->controllers[i].u);
        free(e->controllers[i].d);
        free(e->controllers[i].rate);
        free(e->controllers[i].view);
        free(e->controllers[i].pair);
        experiment_free_law(&e->controllers[i]);
        if (e->controllers[i].backup)
            experiment_free_law(e->controllers[i].backup);
        free(e->controllers[i].backup);
    }
    free(e->controllers);
}

static bool are_wires_in_order(const struct wire *w, size_t n, enum apc_table table, size_t all)
{
    for (size_t i = 0; i < n; i++)
        if (w[i].table != table || w[i].at != i)
            return false;
    return n == all;
}

/* With loops below, an output may be a setpoint of theirs. */
static bool moves_all(const struct experiment *e, const struct controller *c, bool lower)
{
    for (size_t j = 0; j < c->dim.nu; j++)
        if ((c->u[j].table != APC_ACTUATOR || c->u[j].at != j) && !(lower && c->u[j].table == APC_SETPOINT))
            return false;
    return c->dim.nu == e->dim.nu;
}

bool controllers_has_all(const struct experiment *e, const struct controller *c, bool lower)
{
    return are_wires_in_order(c->y, c->dim.ny, APC_SENSOR, e->dim.ny) && moves_all(e, c, lower);
}

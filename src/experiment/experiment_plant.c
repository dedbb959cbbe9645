/* SPDX-License-Identifier: BSD-3-Clause */
#include "experiment_parts.h"

#include <apcmath.h>

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "operate/operate.h"

#define DAYS_366  (366 * 86400.0)
#define RK4_STEPS 10 /* in each interval, as apc_plant_options has it */

static void *zeros(struct settings *s, size_t n, size_t size)
{
    void *p = calloc(n ? n : 1, size);
    if (!p && !s->failed)
        s->failed = apc_fail(s->why, APC_ENOMEM, "%s: out of memory", s->file);
    return p;
}

static apc_ns seconds(struct settings *s, const config_setting_t *group, const char *name,
                      enum settings_presence presence)
{
    double value = 0.0;
    apc_ns ns = 0;
    settings_number(s, group, name, presence, 0, DAYS_366, &value);
    if (!s->failed)
        (void)apc_ns_from_s(value, &ns);
    return value > 0 && ns == 0 ? 1 : ns; /* a duration of 0 is for ever */
}

/* The number of a model's variable by its name; @n when there is none, and that is a failure. */
static size_t find_plant_variable(struct settings *s, const config_setting_t *at, const char *name,
                                  const struct apc_param *table, size_t n, const char *what,
                                  const char *model)
{
    char names[256] = "none with a name";
    size_t i = 0, used = 0;
    while (table && i < n && strcmp(table[i].name, name) != 0)
        i++;
    if (table && i < n)
        return i;
    for (i = 0; table && i < n && used < sizeof names; i++)
        used += (size_t)snprintf(names + used, sizeof names - used, "%s%s", i ? ", " : "", table[i].name);
    settings_fail(s, at, "%s has no %s \"%s\"; there are: %s", model, what, name, names);
    return n;
}

/* ---- Sensors ------------------------------------------------------------------------------- */

static const char *const sensor_faults[] = {"",     "stuck", "drift",  "dropout", "spike",
                                            "bias", "noise", "frozen", NULL};
static const char *const actuator_faults[] = {"",           "stuck",   "stiction", "backlash", "rate",
                                              "saturation", "reverse", "power",    NULL};

static bool sensor_fault_has_size(enum apc_sensor_fault_kind kind)
{
    return kind == APC_FAULT_DRIFT || kind == APC_FAULT_SPIKE || kind == APC_FAULT_BIAS ||
           kind == APC_FAULT_NOISE;
}

static bool actuator_fault_has_size(enum apc_actuator_fault_kind kind)
{
    return kind == APC_ACTUATOR_STICTION || kind == APC_ACTUATOR_BACKLASH || kind == APC_ACTUATOR_RATE;
}

static struct experiment_fault sensor_fault(const struct experiment *e, size_t y, size_t i)
{
    struct apc_sensor_fault *fault = &e->faults[i];
    return (struct experiment_fault){.signal = e->y[y].tag.name,
                                     .kind = sensor_faults[fault->kind],
                                     .of = FAULT_OF_SENSOR,
                                     .k = y,
                                     .at = &fault->at,
                                     .duration = &fault->duration,
                                     .number = {[FAULT_SIZE] = &fault->size},
                                     .takes = sensor_fault_has_size(fault->kind) ? 1U << FAULT_SIZE : 0};
}

static struct experiment_fault actuator_fault(const struct experiment *e, size_t u, size_t i)
{
    struct apc_actuator_fault *fault = &e->actuator_faults[i];
    const bool ends = fault->kind == APC_ACTUATOR_SATURATION;
    return (struct experiment_fault){
        .signal = e->u[u].tag.name,
        .kind = actuator_faults[fault->kind],
        .of = FAULT_OF_ACTUATOR,
        .k = u,
        .at = &fault->at,
        .duration = &fault->duration,
        .number = {&fault->size, &fault->jump, ends ? &fault->low : NULL, ends ? &fault->high : NULL},
        .takes = (actuator_fault_has_size(fault->kind) ? 1U << FAULT_SIZE : 0) |
                 (fault->kind == APC_ACTUATOR_STICTION ? 1U << FAULT_JUMP : 0) |
                 (ends ? 1U << FAULT_LOW | 1U << FAULT_HIGH : 0)};
}

static const char *const plant_faults[] = {
    [FAULT_OF_SENSOR] = "",         [FAULT_OF_ACTUATOR] = "",
    [FAULT_OF_LINK] = "lost",       [FAULT_HANGS] = "hung",
    [FAULT_KILLS] = "killed",       [FAULT_OF_DISTURBANCE] = "disturbance",
    [FAULT_OF_PARAMETER] = "drift", NULL};

static bool is_of_model(const struct plant_fault *fault)
{
    return fault->of == FAULT_OF_DISTURBANCE || fault->of == FAULT_OF_PARAMETER;
}

static const char *plant_fault_signal(const struct experiment *e, const struct plant_fault *fault)
{
    if (fault->of == FAULT_OF_LINK)
        return "link";
    return fault->of == FAULT_OF_DISTURBANCE ? e->plant.model->disturbance[fault->k].name
           : fault->of == FAULT_OF_PARAMETER ? e->plant.model->param[fault->k].name
                                             : e->controllers[fault->k].name;
}

static struct experiment_fault plant_fault(const struct experiment *e, size_t i)
{
    struct plant_fault *fault = &e->plant.fault[i];
    return (struct experiment_fault){.signal = plant_fault_signal(e, fault),
                                     .kind = plant_faults[fault->of],
                                     .of = fault->of,
                                     .k = fault->k,
                                     .at = &fault->at,
                                     .duration = &fault->duration,
                                     .number = {[FAULT_SIZE] = is_of_model(fault) ? &fault->size : NULL},
                                     .takes = is_of_model(fault) ? 1U << FAULT_SIZE : 0,
                                     .of_file = fault->of_file};
}

size_t experiment_find_plant_fault(const struct experiment *e, const char *signal, const char *kind)
{
    size_t i = 0;
    while (i < e->plant.n_faults && (strcmp(plant_fault_signal(e, &e->plant.fault[i]), signal) != 0 ||
                                     (kind && strcmp(plant_faults[e->plant.fault[i].of], kind) != 0)))
        i++;
    return i;
}

/* Number *@p i of the experiment's own; else *@p i has become one of those that wait for an instructor. */
static bool find_own_fault(const struct experiment *e, size_t *i, struct experiment_fault *fault)
{
    size_t place = 0;
    for (size_t y = 0; y < e->dim.ny; place += e->sensor[y++].n_faults) {
        const size_t n = e->sensor[y].n_faults - EXPERIMENT_SENSOR_KINDS;
        if (*i < n) {
            *fault = sensor_fault(e, y, place + *i);
            return true;
        }
        *i -= n;
    }
    place = 0;
    for (size_t u = 0; u < e->dim.nu; place += e->actuator[u++].n_faults) {
        const size_t n = e->actuator[u].n_faults - EXPERIMENT_ACTUATOR_KINDS;
        if (*i < n) {
            *fault = actuator_fault(e, u, place + *i);
            return true;
        }
        *i -= n;
    }
    return false;
}

static struct experiment_fault find_waiting_fault(const struct experiment *e, size_t i)
{
    size_t end = 0;
    for (size_t y = 0; y < e->dim.ny; y++, i -= EXPERIMENT_SENSOR_KINDS) {
        end += e->sensor[y].n_faults;
        if (i < EXPERIMENT_SENSOR_KINDS)
            return sensor_fault(e, y, end - EXPERIMENT_SENSOR_KINDS + i);
    }
    end = 0;
    for (size_t u = 0; u < e->dim.nu; u++, i -= EXPERIMENT_ACTUATOR_KINDS) {
        end += e->actuator[u].n_faults;
        if (i < EXPERIMENT_ACTUATOR_KINDS)
            return actuator_fault(e, u, end - EXPERIMENT_ACTUATOR_KINDS + i);
    }
    return i < e->plant.n_faults ? plant_fault(e, i) : (struct experiment_fault){.kind = NULL};
}

struct experiment_fault experiment_fault(const struct experiment *e, size_t i)
{
    struct experiment_fault fault = {.kind = NULL};
    size_t waiting = i;
    if (find_own_fault(e, &waiting, &fault)) {
        fault.row = LOOPS_FAULT(i);
        fault.of_file = true;
    } else if (waiting < LOOPS_FAULT_MOST) {
        fault = find_waiting_fault(e, waiting);
        fault.row = LOOPS_FAULT(LOOPS_FAULT_OWN + waiting);
        fault.numbers = LOOPS_FAULT_NUMBER(waiting, 0);
    }
    return fault;
}

/* Its kind, 1 and up by @kinds, whose first is none; @said: what there is. Then when it is. */
static int read_fault_time(struct settings *s, const config_setting_t *group, const char *const *known,
                           const char *const *kinds, const char *said, apc_ns when[2])
{
    char kind[16] = "";
    int k = 1;
    if (!config_setting_is_group(group)) {
        settings_fail(s, group, "expected a group: { kind = \"stuck\"; at = 10.0; duration = 5.0; }");
        return 0;
    }
    settings_known(s, group, known);
    settings_text(s, group, "kind", REQUIRED, kind, sizeof kind);
    while (kinds[k] && strcmp(kinds[k], kind) != 0)
        k++;
    if (!kinds[k])
        settings_fail(s, config_setting_get_member(group, "kind"), "\"kind\" must be %s", said);
    if (s->failed)
        return 0;
    bool waits = false;
    settings_flag(s, group, "instructor", &waits);
    when[0] = seconds(s, group, "at", waits ? OPTIONAL : REQUIRED);
    if (waits && config_setting_get_member(group, "at"))
        settings_fail(s, group, "a fault has \"at\" and \"instructor\": give one of them");
    if (waits)
        when[0] = FAULT_NEVER;
    when[1] = seconds(s, group, "duration", OPTIONAL);
    return k;
}

/* Settings that some kinds have: required of these, refused of others. */
static void read_fault_number(struct settings *s, const config_setting_t *group, const char *name, bool has,
                              double low, double high, double *value)
{
    if (has)
        settings_number(s, group, name, REQUIRED, low, high, value);
    else if (!s->failed && config_setting_get_member(group, name))
        settings_fail(s, group, "a fault of kind \"%s\" has no %s",
                      config_setting_get_string(config_setting_get_member(group, "kind")), name);
}

static void read_fault(struct settings *s, const config_setting_t *group, struct apc_sensor_fault *fault)
{
    static const char *const known[] = {"kind", "at", "instructor", "duration", "size", NULL};
    apc_ns when[2] = {0, 0};
    fault->kind = (enum apc_sensor_fault_kind)read_fault_time(
        s, group, known, sensor_faults,
        "\"stuck\", \"drift\", \"dropout\", \"spike\", \"bias\", \"noise\" or \"frozen\"", when);
    fault->at = when[0];
    fault->duration = when[1];
    read_fault_number(s, group, "size", sensor_fault_has_size(fault->kind),
                      fault->kind == APC_FAULT_NOISE ? 0 : -APC_VALUE_MAX / 2, APC_VALUE_MAX / 2,
                      &fault->size);
}

static const config_setting_t *faults_of(struct settings *s, const config_setting_t *list, size_t i)
{
    return settings_list(s, config_setting_get_elem(list, (unsigned)i), "faults", OPTIONAL);
}

void experiment_read_sensors(struct settings *s, const config_setting_t *list, struct experiment *e)
{
    size_t n = 0;
    if (s->failed)
        return;
    for (size_t i = 0; i < e->dim.ny; i++) {
        const config_setting_t *faults = faults_of(s, list, i);
        n += faults ? (size_t)config_setting_length(faults) : 0;
    }
    e->sensor = zeros(s, e->dim.ny, sizeof *e->sensor);
    e->faults = zeros(s, n + e->dim.ny * EXPERIMENT_SENSOR_KINDS, sizeof *e->faults);
    n = 0;
    for (size_t i = 0; i < e->dim.ny && !s->failed; i++) {
        const config_setting_t *one = config_setting_get_elem(list, (unsigned)i);
        const config_setting_t *faults = faults_of(s, list, i);
        struct apc_sensor *sensor = &e->sensor[i];
        sensor->period = e->y[i].period;
        settings_number(s, one, "noise", OPTIONAL, 0, APC_VALUE_MAX / 2, &sensor->noise);
        settings_number(s, one, "quantum", OPTIONAL, 0, APC_VALUE_MAX / 2, &sensor->quantum);
        sensor->fault = e->faults + n;
        sensor->n_faults = faults ? (size_t)config_setting_length(faults) : 0;
        for (unsigned k = 0; k < sensor->n_faults && !s->failed; k++)
            read_fault(s, config_setting_get_elem(faults, k), &e->faults[n++]);
        for (int kind = APC_FAULT_STUCK; kind <= APC_FAULT_FROZEN && !s->failed; kind++)
            e->faults[n++] =
                (struct apc_sensor_fault){.kind = (enum apc_sensor_fault_kind)kind, .at = FAULT_NEVER};
        sensor->n_faults += EXPERIMENT_SENSOR_KINDS;
    }
}

/* ---- Actuators ----------------------------------------------------------------------------- */

/* What is the output's own of such a kind. */
static struct apc_actuator_fault make_actuator_fault(const struct signal *u, int kind, apc_ns at)
{
    const struct apc_tag *tag = &u->tag;
    struct apc_actuator_fault fault = {.kind = (enum apc_actuator_fault_kind)kind, .at = at};
    if (kind == APC_ACTUATOR_POWER)
        fault.low = fault.high = u->safe;
    else if (kind == APC_ACTUATOR_REVERSE && tag->low > -APC_VALUE_MAX && tag->high < APC_VALUE_MAX) {
        fault.low = tag->low;
        fault.high = tag->high;
    }
    return fault;
}

static void read_actuator_fault(struct settings *s, const config_setting_t *group, const struct signal *u,
                                struct apc_actuator_fault *fault)
{
    const struct apc_tag *tag = &u->tag;
    static const char *const known[] = {"kind", "at",  "instructor", "duration", "size",
                                        "jump", "low", "high",       NULL};
    apc_ns when[2] = {0, 0};
    const int k = read_fault_time(
        s, group, known, actuator_faults,
        "\"stuck\", \"stiction\", \"backlash\", \"rate\", \"saturation\", \"reverse\" or \"power\"", when);
    const bool ends = k == APC_ACTUATOR_SATURATION;
    *fault = make_actuator_fault(u, k, when[0]);
    fault->duration = when[1];
    read_fault_number(s, group, "size", actuator_fault_has_size(fault->kind), 0, APC_VALUE_MAX / 2,
                      &fault->size);
    read_fault_number(s, group, "jump", k == APC_ACTUATOR_STICTION, 0, APC_VALUE_MAX / 2, &fault->jump);
    read_fault_number(s, group, "low", ends, tag->low, tag->high, &fault->low);
    read_fault_number(s, group, "high", ends, tag->low, tag->high, &fault->high);
    if (ends && fault->high < fault->low)
        settings_fail(s, group, "\"low\" is %.15g: must be at most \"high\", %.15g", fault->low, fault->high);
    if (k == APC_ACTUATOR_REVERSE && fault->high <= fault->low)
        settings_fail(s, group,
                      "a fault of kind \"reverse\" swaps the limits: give output %s \"low\" and \"high\"",
                      tag->name);
}

void experiment_read_actuators(struct settings *s, const config_setting_t *list, struct experiment *e)
{
    size_t n = 0;
    if (s->failed)
        return;
    for (size_t i = 0; i < e->dim.nu; i++) {
        const config_setting_t *faults = faults_of(s, list, i);
        n += faults ? (size_t)config_setting_length(faults) : 0;
    }
    e->actuator = zeros(s, e->dim.nu, sizeof *e->actuator);
    e->actuator_faults = zeros(s, n + e->dim.nu * EXPERIMENT_ACTUATOR_KINDS, sizeof *e->actuator_faults);
    n = 0;
    for (size_t i = 0; i < e->dim.nu && !s->failed; i++) {
        const config_setting_t *faults = faults_of(s, list, i);
        e->actuator[i].fault = e->actuator_faults + n;
        e->actuator[i].n_faults = faults ? (size_t)config_setting_length(faults) : 0;
        for (unsigned k = 0; k < e->actuator[i].n_faults && !s->failed; k++)
            read_actuator_fault(s, config_setting_get_elem(faults, k), &e->u[i], &e->actuator_faults[n++]);
        for (int kind = APC_ACTUATOR_STUCK; kind <= APC_ACTUATOR_POWER && !s->failed; kind++)
            e->actuator_faults[n++] = make_actuator_fault(&e->u[i], kind, FAULT_NEVER);
        e->actuator[i].n_faults += EXPERIMENT_ACTUATOR_KINDS;
    }
}

/* ---- Variables of an FMU or a plant in Python ------------------------------------------------------ */

/* Those that the file names, else those that have the signals' names. */
static void take_signal_names(struct settings *s, const config_setting_t *list, const char *what,
                              const struct signal *signal, size_t n, const char **name)
{
    if (list && (!config_setting_is_aggregate(list) || (size_t)config_setting_length(list) != n))
        settings_fail(s, list,
                      "\"%s\" must name %zu variables of the model, in the order of the signals: [\"...\"]",
                      what, n);
    for (size_t i = 0; i < n && !s->failed; i++) {
        name[i] = list ? config_setting_get_string_elem(list, (int)i) : signal[i].tag.name;
        if (!name[i])
            settings_fail(s, list, "\"%s\" must hold names: [\"...\"]", what);
    }
}

static void compare_units(struct settings *s, const config_setting_t *group, const struct signal *signal,
                          size_t n, const struct apc_param *variable)
{
    for (size_t i = 0; i < n && !s->failed; i++)
        if (signal[i].tag.unit[0] && variable[i].unit && variable[i].unit[0] &&
            strcmp(signal[i].tag.unit, variable[i].unit) != 0)
            settings_fail(s, group,
                          "%s is in %s, and %s of the model in %s: nothing is converted; give the signal the "
                          "model's unit, and its limits in that",
                          signal[i].tag.name, signal[i].tag.unit, variable[i].name, variable[i].unit);
}

/* A command that an input cannot have would arrive as another one. */
static void compare_ranges(struct settings *s, const config_setting_t *group, const struct experiment *e)
{
    const struct apc_model *const m = e->plant.model;
    struct apc_error why;
    for (size_t i = 0; i < e->dim.nu && !s->failed; i++) {
        const struct apc_tag *const tag = &e->u[i].tag;
        if (apc_model_takes_range(m, &m->input[i], tag->low, tag->high, &why) == 0)
            continue;
        if (tag->low <= -APC_VALUE_MAX || tag->high >= APC_VALUE_MAX)
            settings_fail(s, group, "%s has no limits, and %s: give output %s \"low\" and \"high\" within",
                          tag->name, why.text, tag->name);
        else
            settings_fail(s, group,
                          "%s may be %.15g to %.15g, and %s: give output %s \"low\" and \"high\" within",
                          tag->name, tag->low, tag->high, why.text, tag->name);
    }
}

void experiment_choose_variables(struct settings *s, const config_setting_t *group, struct experiment *e)
{
    const bool own = e->plant.plugin.chosen; /* the file's names are of another model */
    const config_setting_t *const inputs = own ? NULL : config_setting_get_member(group, "inputs");
    const char **const input = zeros(s, e->dim.nu + e->dim.ny, sizeof *input),
                       **const output = input + e->dim.nu;
    struct apc_error why;
    if (!s->failed)
        take_signal_names(s, inputs, "inputs", e->u, e->dim.nu, input);
    if (!s->failed)
        take_signal_names(s, own ? NULL : config_setting_get_member(group, "outputs"), "outputs", e->y,
                          e->dim.ny, output);
    if (!s->failed && inputs && strcmp(e->plant.model->input[0].name, APC_MODEL_NO_INPUT) == 0)
        settings_fail(s, inputs,
                      "the model has no inputs: leave \"inputs\" out, and the outputs move nothing");
    if (!s->failed && apc_model_choose(e->plant.model, input, e->dim.nu, output, e->dim.ny, &why) < 0)
        settings_fail(s, group, "%s (in the file: \"inputs\" and \"outputs\" of the plant)", why.text);
    if (!s->failed)
        compare_units(s, group, e->u, e->dim.nu, e->plant.model->input);
    if (!s->failed)
        compare_units(s, group, e->y, e->dim.ny, e->plant.model->output);
    if (!s->failed)
        compare_ranges(s, group, e);
    free(input);
}

/* ---- Plant --------------------------------------------------------------------------------- */

static void read_noise(struct settings *s, const config_setting_t *group, struct experiment *e)
{
    const struct apc_model *model = e->plant.model;
    e->plant.noise = zeros(s, model->nx, sizeof *e->plant.noise);
    for (int i = 0; i < config_setting_length(group) && !s->failed; i++) {
        const char *name;
        const config_setting_t *member = settings_value(s, group, i, &name);
        size_t k = member
                       ? find_plant_variable(s, member, name, model->state, model->nx, "state", model->name)
                       : model->nx;
        if (k < model->nx)
            settings_number_at(s, member, name, 0, APC_VALUE_MAX / 2, &e->plant.noise[k]);
    }
}

static void read_disturbance(struct settings *s, const config_setting_t *group, const struct apc_model *model,
                             bool waits, struct apc_disturbance *change)
{
    static const char *const timed[] = {"name", "at", "value", NULL}, *const waiting[] = {"name", "when",
                                                                                          "after", "value",
                                                                                          NULL};
    char name[EXPERIMENT_NAME] = "";
    struct apc_error why;
    if (!config_setting_is_group(group)) {
        settings_fail(s, group, "expected a group: { name = \"...\"; at = 100.0; value = 1.0; }");
        return;
    }
    settings_known(s, group, waits ? waiting : timed);
    settings_text(s, group, "name", REQUIRED, name, sizeof name);
    if (s->failed)
        return;
    change->k =
        find_plant_variable(s, group, name, model->disturbance, model->nd, "disturbance", model->name);
    if (!waits)
        change->at = seconds(s, group, "at", REQUIRED);
    if (s->failed)
        return;
    settings_number(s, group, "value", REQUIRED, -APC_VALUE_MAX, APC_VALUE_MAX, &change->value);
    if (!s->failed && apc_model_takes(model, &model->disturbance[change->k], change->value, &why) < 0)
        settings_fail(s, config_setting_get_member(group, "value"), "%s", why.text);
}

void experiment_read_disturbance(struct settings *s, const config_setting_t *group,
                                 const struct experiment *e, struct apc_disturbance *change)
{
    read_disturbance(s, group, e->plant.model, true, change);
}

static void read_disturbances(struct settings *s, const config_setting_t *list, struct experiment *e)
{
    int n = config_setting_length(list);
    struct apc_disturbance *all = zeros(s, (size_t)n, sizeof *all);
    e->plant.disturbance = all;
    for (int i = 0; all && i < n && !s->failed; i++) {
        struct apc_disturbance change = {0};
        size_t at = e->plant.n_disturbances;
        read_disturbance(s, config_setting_get_elem(list, (unsigned)i), e->plant.model, false, &change);
        for (; at > 0 && all[at - 1].at > change.at; at--) /* by time, as the core wants them */
            all[at] = all[at - 1];
        all[at] = change;
        e->plant.n_disturbances++;
    }
}

void experiment_read_dynamics(struct settings *s, const config_setting_t *group, struct experiment *e,
                              bool own)
{
    const config_setting_t *noise = settings_values(s, group, "noise");
    const config_setting_t *disturbances = settings_list(s, group, "disturbances", OPTIONAL);
    struct apc_plant_options *o = &e->plant.options;
    struct apc_plant *trial = NULL;
    struct apc_plantserver *core = NULL;
    struct apc_error why;
    int64_t steps = 0;
    o->size = sizeof *o;
    settings_text(s, group, "integrator", OPTIONAL, e->plant.integrator, sizeof e->plant.integrator);
    settings_number(s, group, "rtol", OPTIONAL, 1e-15, 0.1, &o->rtol);
    settings_number(s, group, "atol", OPTIONAL, 1e-300, 1e300, &o->atol);
    settings_whole(s, group, "steps", OPTIONAL, 1, 1000000, &steps);
    settings_number(s, group, "dead_time", OPTIONAL, 0, DAYS_366, &o->dead_time);
    o->steps = (unsigned)steps;
    if (noise && !own && !s->failed)
        read_noise(s, noise, e);
    if (disturbances && !own && !s->failed)
        read_disturbances(s, disturbances, e);
    if (s->failed)
        return;
    if (module_plant(e, &trial, &core, &why) < 0) /* what only the library knows, said with the line */
        settings_fail(s, group, "%s", why.text);
    apc_plantserver_destroy(core);
    apc_plant_destroy(trial);
}

/* ---- Faults of the plant itself, and of what controls it ------------------------------------ */

static void add_plant_fault(struct experiment *e, enum fault_of of, size_t k)
{
    e->plant.fault[e->plant.n_faults++] = (struct plant_fault){.of = of, .k = k, .at = FAULT_NEVER};
}

static void read_plant_fault(struct settings *s, const config_setting_t *group, struct experiment *e)
{
    static const char *const known[] = {"signal", "kind", "at", "instructor", "duration", "size", NULL};
    char signal[EXPERIMENT_NAME] = "";
    apc_ns when[2] = {0, 0};
    const int kind = read_fault_time(s, group, known, plant_faults + FAULT_OF_ACTUATOR,
                                     "\"lost\", \"hung\", \"killed\", \"disturbance\" or \"drift\"", when);
    settings_text(s, group, "signal", REQUIRED, signal, sizeof signal);
    if (s->failed)
        return;
    const char *said = plant_faults[FAULT_OF_ACTUATOR + kind];
    const size_t i = experiment_find_plant_fault(e, signal, said);
    struct plant_fault *fault = &e->plant.fault[i];
    if (i == e->plant.n_faults)
        settings_fail(
            s, config_setting_get_member(group, "signal"),
            "\"%s\" has no fault \"%s\": the link is lost, a controller hung or killed, a disturbance "
            "another one, and parameters drift",
            signal, said);
    else if (fault->of_file)
        settings_fail(s, group, "\"%s\" has a fault \"%s\" already: there is one of each at a time", signal,
                      said);
    else
        read_fault_number(s, group, "size", is_of_model(fault), -APC_VALUE_MAX / 2, APC_VALUE_MAX / 2,
                          &fault->size);
    if (s->failed)
        return;
    fault->at = when[0];
    fault->duration = when[1];
    fault->of_file = true;
    e->plant.n_timed++;
}

void experiment_read_plant_faults(struct settings *s, const config_setting_t *root, struct experiment *e)
{
    const struct apc_model *m = e->plant.model;
    const config_setting_t *group = config_setting_get_member(root, "plant");
    const config_setting_t *list = m ? settings_list(s, group, "faults", OPTIONAL) : NULL;
    const size_t np = m && m->param ? m->np : 0, nd = m ? m->nd : 0;
    e->plant.fault = zeros(s, 1 + 2 * e->n_controllers + nd + np, sizeof *e->plant.fault);
    if (s->failed)
        return;
    add_plant_fault(e, FAULT_OF_LINK, 0);
    for (size_t i = 0; i < 2 * e->n_controllers; i++)
        add_plant_fault(e, i % 2 ? FAULT_KILLS : FAULT_HANGS, i / 2);
    for (size_t i = 0; i < nd; i++)
        add_plant_fault(e, FAULT_OF_DISTURBANCE, i);
    for (size_t i = 0; i < np; i++)
        add_plant_fault(e, FAULT_OF_PARAMETER, i);
    for (int i = 0; list && !e->plant.plugin.chosen && i < config_setting_length(list) && !s->failed; i++)
        read_plant_fault(s, config_setting_get_elem(list, (unsigned)i), e);
}

/* ---- Steps that are too long ---------------------------------------------------------------- */

#define RK4_LIMIT 2.8 /* of |pole| times step: beyond it what should decay grows */
#define SQUARINGS 40

/*
 * The largest magnitude of an eigenvalue of @a [n * n], which is destroyed, by Gelfand's formula:
 * |A^m|^(1/m), with m = 2^SQUARINGS. Each power is scaled to norm 1; @b [n * n] is scratch.
 */
static double spectral_radius(double *a, double *b, size_t n)
{
    double log_radius = 0, share = 1;
    for (int k = 0; k <= SQUARINGS; k++) {
        double norm = 0;
        for (size_t i = 0; i < n * n; i++)
            norm = apc_hypot(norm, a[i]);
        if (!(norm > 0))
            return 0;
        log_radius += share * apc_log(norm);
        share /= 2;
        for (size_t i = 0; i < n * n; i++)
            a[i] /= norm;
        for (size_t i = 0; i < n; i++)
            for (size_t j = 0; j < n; j++) {
                b[i * n + j] = 0;
                for (size_t l = 0; l < n; l++)
                    b[i * n + j] += a[i * n + l] * a[l * n + j];
            }
        memcpy(a, b, n * n * sizeof *a);
    }
    return apc_exp(log_radius);
}

int experiment_check_steps(const struct experiment *e, struct apc_error *why)
{
    const struct apc_model *m = e->plant.model;
    const size_t nx = m->nx, inputs = m->nu + m->nd;
    const double steps = e->plant.options.steps ? e->plant.options.steps : RK4_STEPS,
                 period = apc_ns_to_s(e->plant.rhythm.period);
    int rc = 0;

    if (strcmp(e->plant.integrator, "rk4") != 0)
        return 0;
    double *a = calloc(2 * nx * nx + (nx + m->ny) * inputs + m->ny * nx, sizeof *a);
    if (!a)
        return apc_fail(why, APC_ENOMEM, "out of memory");
    double *scratch = a + nx * nx, *b = scratch + nx * nx, *c = b + nx * inputs, *d = c + m->ny * nx;
    if (apc_model_linearize(m, e->plant.p, e->plant.x0, NULL, a, b, c, d, NULL) == 0) {
        double pole = spectral_radius(a, scratch, nx);
        if (pole * period / steps > RK4_LIMIT)
            rc = apc_fail(
                why, APC_ERANGE,
                "steps of %.15g s of rk4 are too long for a pole of %.3g/s: what should decay grows; "
                "plant.steps = %.0f would do, or another integrator",
                period / steps, pole, ceil(pole * period - 1e-6));
    }
    free(a);
    return rc;
}

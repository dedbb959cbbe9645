/* SPDX-License-Identifier: BSD-3-Clause */
/* The signals of an experiment file: what each is called, what it may be, and what is wanted of it. */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "experiment_parts.h"

#define SIGNALS_MAX 4096

enum kind { MEASUREMENT, CALCULATED, SETPOINT, OUTPUT };

#define COMMON "name", "unit", "description", "low", "high", "area", "display", "alarms"
static const char *const known[][16] = {
    [MEASUREMENT] = {COMMON, "soft", "critical", "period", "noise", "quantum", "faults", NULL},
    [CALCULATED] = {COMMON, "soft", "critical", "rate", NULL},
    [SETPOINT] = {COMMON, "initial", "rate", "confirm", "second_person", NULL},
    [OUTPUT] = {COMMON, "safe", "fault", "initial", "rate", "confirm", "second_person", "faults", NULL}};

/* ---- A signal ------------------------------------------------------------------------------ */

/* [low, high] within its limits. */
static void read_range(struct settings *s, const config_setting_t *group, const char *name,
                       const struct apc_tag *tag, bool within, double range[2])
{
    const config_setting_t *member = config_setting_get_member(group, name);
    double value[2] = {0, 0};
    if (!member)
        return;
    settings_numbers(s, member, 2, value);
    if (s->failed)
        return;
    if (!(value[0] < value[1]) && !(within && value[0] == value[1]))
        settings_fail(s, member, "\"%s\" must %s: [low, high]", name, within ? "not fall" : "rise");
    else if (within && (value[0] < tag->low || value[1] > tag->high))
        settings_fail(s, member, "\"%s\" is %.15g to %.15g: must lie within the limits, %.15g to %.15g", name,
                      value[0], value[1], tag->low, tag->high);
    memcpy(range, value, sizeof value);
}

static void read_bounds(struct settings *s, const config_setting_t *group, enum kind kind,
                        struct signal *signal)
{
    struct apc_tag *tag = &signal->tag;
    double display[2] = {0, 0}, soft[2] = {-HUGE_VAL, HUGE_VAL};
    settings_number(s, group, "low", OPTIONAL, -APC_VALUE_MAX, APC_VALUE_MAX, &tag->low);
    settings_number(s, group, "high", OPTIONAL, -APC_VALUE_MAX, APC_VALUE_MAX, &tag->high);
    if (tag->high < tag->low)
        settings_fail(s, group, "\"low\" is %.15g: must be at most \"high\", %.15g", tag->low, tag->high);
    read_range(s, group, "display", tag, false, display);
    read_range(s, group, "soft", tag, true, soft);
    tag->display_low = display[0];
    tag->display_high = display[1];
    signal->soft_low = soft[0];
    signal->soft_high = soft[1];
    if (kind != MEASUREMENT)
        settings_number(s, group, "rate", OPTIONAL, 1e-9, APC_VALUE_MAX, &signal->rate);
}

/* A path: no name in it is empty. */
static void read_area(struct settings *s, const config_setting_t *group, struct apc_tag *tag)
{
    settings_text(s, group, "area", OPTIONAL, tag->area, sizeof tag->area);
    const size_t n = strlen(tag->area);
    if (n > 0 && (tag->area[0] == '/' || tag->area[n - 1] == '/' || strstr(tag->area, "//")))
        settings_fail(s, config_setting_get_member(group, "area"),
                      "\"area\" is \"%s\": must be names with / between, such as \"unit1/reactor\"",
                      tag->area);
}

static void read_experiment_signal(struct settings *s, const config_setting_t *group, enum kind kind, int id,
                                   struct signal *signal)
{
    static const enum apc_table table[] = {APC_SENSOR, APC_SENSOR, APC_SETPOINT, APC_ACTUATOR};
    struct apc_tag *tag = &signal->tag;

    *signal =
        (struct signal){.tag = {.table = table[kind], .id = id, .low = -APC_VALUE_MAX, .high = APC_VALUE_MAX},
                        .initial = (double)NAN};
    if (!config_setting_is_group(group)) {
        settings_fail(s, group, "expected a group: { name = \"...\"; ... }");
        return;
    }
    settings_known(s, group, known[kind]);
    settings_name(s, group, tag->name, sizeof tag->name);
    settings_text(s, group, "unit", OPTIONAL, tag->unit, sizeof tag->unit);
    settings_text(s, group, "description", OPTIONAL, tag->description, sizeof tag->description);
    read_bounds(s, group, kind, signal);
    read_area(s, group, tag);
    settings_flag(s, group, "critical", &signal->critical);
    if (kind == MEASUREMENT)
        settings_period(s, group, "period", OPTIONAL, &signal->period);
    if (kind == SETPOINT || kind == OUTPUT) {
        settings_number(s, group, "confirm", OPTIONAL, 1e-9, APC_VALUE_MAX, &signal->confirm);
        settings_number(s, group, "second_person", OPTIONAL, 1, 86400, &signal->second);
    }
    if (kind == SETPOINT)
        settings_number(s, group, "initial", OPTIONAL, tag->low, tag->high, &signal->initial);
    if (kind != OUTPUT)
        return;
    signal->safe = tag->low > 0 ? tag->low : tag->high < 0 ? tag->high : 0;
    settings_number(s, group, "safe", OPTIONAL, tag->low, tag->high, &signal->safe);
    signal->fault = signal->safe;
    settings_number(s, group, "fault", OPTIONAL, tag->low, tag->high, &signal->fault);
    signal->initial = signal->safe;
    settings_number(s, group, "initial", OPTIONAL, tag->low, tag->high, &signal->initial);
}

/* ---- All ----------------------------------------------------------------------------------- */

/* Behind the @p n that are there already. Returns how many there are now. */
static size_t read_signal_list(struct settings *s, const config_setting_t *root, const char *name,
                               enum kind kind, struct signal **signals, size_t n)
{
    const config_setting_t *list = settings_list(s, root, name, kind == CALCULATED ? OPTIONAL : REQUIRED);
    if (!list)
        return n;
    const int more = config_setting_length(list);
    if (more > SIGNALS_MAX || (more < 1 && kind != CALCULATED)) {
        settings_fail(s, list, "\"%s\" must name 1 to %d variables", name, SIGNALS_MAX);
        return n;
    }
    struct signal *all = reallocarray(*signals, n + (size_t)more + 1, sizeof *all);
    if (!all) {
        s->failed = s->failed ? s->failed : apc_fail(s->why, APC_ENOMEM, "%s: out of memory", s->file);
        return n;
    }
    *signals = all;
    memset(all + n, 0, (size_t)more * sizeof *all);
    for (int i = 0; i < more && !s->failed; i++)
        read_experiment_signal(s, config_setting_get_elem(list, (unsigned)i), kind, (int)n + i + 1,
                               &all[n + (size_t)i]);
    return n + (size_t)more;
}

/* A name stands for one variable: among those of its table, and among those that can be set. */
static void check_signal_names(struct settings *s, const config_setting_t *root, const char *list,
                               const struct signal *signals, size_t n, const struct signal *others, size_t m)
{
    for (size_t i = 0; i < n && !s->failed; i++) {
        const char *name = signals[i].tag.name;
        bool taken = false;
        for (size_t j = 0; j < i; j++)
            taken |= !strcmp(signals[j].tag.name, name);
        for (size_t j = 0; j < m; j++)
            taken |= !strcmp(others[j].tag.name, name);
        if (taken)
            settings_fail(s, config_setting_get_elem(config_setting_get_member(root, list), (unsigned)i),
                          "two variables are called \"%s\": give each a name of its own", name);
    }
}

void experiment_read_signals(struct settings *s, const config_setting_t *root, struct experiment *e)
{
    e->dim.ny = read_signal_list(s, root, "measurements", MEASUREMENT, &e->y, 0);
    experiment_read_sensors(s, config_setting_get_member(root, "measurements"), e);
    e->n_signals = read_signal_list(s, root, "signals", CALCULATED, &e->y, e->dim.ny) - e->dim.ny;
    e->dim.nz = read_signal_list(s, root, "setpoints", SETPOINT, &e->z, 0);
    e->dim.nu = read_signal_list(s, root, "outputs", OUTPUT, &e->u, 0);
    experiment_read_actuators(s, config_setting_get_member(root, "outputs"), e);
    if (s->failed)
        return;
    check_signal_names(s, root, "measurements", e->y, e->dim.ny, NULL, 0);
    check_signal_names(s, root, "signals", e->y + e->dim.ny, e->n_signals, e->y, e->dim.ny);
    check_signal_names(s, root, "setpoints", e->z, e->dim.nz, e->y + e->dim.ny, e->n_signals);
    check_signal_names(s, root, "outputs", e->u, e->dim.nu, e->y + e->dim.ny, e->n_signals);
    check_signal_names(s, root, "outputs", e->u, e->dim.nu, e->z, e->dim.nz);
}

/* SPDX-License-Identifier: BSD-3-Clause */
/* What an operator does, whoever does it: the list of an experiment file, or a caller of the library. */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "experiment_parts.h"
#include "nearest.h"

/* ---- Names --------------------------------------------------------------------------------- */

static bool may_write(enum apc_table table)
{
    return table == APC_SETPOINT || table == APC_TUNING || table == APC_MANUAL;
}

static const struct apc_tag *find_id(const struct apc_tag *tags, size_t n, enum apc_table table, int id)
{
    for (size_t i = 0; i < n; i++)
        if (tags[i].table == table && tags[i].id == id)
            return &tags[i];
    return NULL;
}

/* Its name or TABLE.ID: sensors before what may be set, as the tags stand. */
static bool is_called(const struct apc_tag *tag, const char *name)
{
    char address[48];
    snprintf(address, sizeof address, "%s.%d", apc_table_name(tag->table), tag->id);
    return !strcmp(tag->name, name) || !strcmp(address, name);
}

int action_find(const struct apc_tag *tags, size_t n, const char *name, bool write, struct apc_tag *found,
                struct apc_error *why)
{
    struct nearest nearest = {.wanted = name};
    for (size_t i = 0; i < n; i++) {
        const struct apc_tag *tag = &tags[i];
        if (write && tag->table == APC_ACTUATOR)
            tag = find_id(tags, n, APC_MANUAL, tag->id);
        if (!tag || (write && !may_write(tag->table)))
            continue;
        if (is_called(&tags[i], name)) {
            *found = *tag;
            return 0;
        }
        nearest_look(&nearest, tags[i].name);
    }
    return apc_fail(why, APC_ENOTFOUND, "there is no \"%s\" to be %s%s%s%s", name, write ? "set" : "read",
                    nearest.name ? ": did you mean \"" : "", nearest.name ? nearest.name : "",
                    nearest.name ? "\"?" : "");
}

int action_check(const struct apc_tag *tag, double value, struct apc_error *why)
{
    if (fabs(value) < APC_VALUE_MAX && value >= tag->low && value <= tag->high)
        return 0;
    return apc_fail(why, APC_ERANGE, "%s = %g lies outside its limits %g to %g", tag->name, value, tag->low,
                    tag->high);
}

int action_find_mode(const struct experiment *e, const char *name, enum apc_mode mode, struct apc_error *why)
{
    if (mode != APC_MODE_MAN && mode != APC_MODE_AUTO)
        return apc_fail(why, APC_EINVAL, "mode %s cannot be asked for: it must be Man or Auto",
                        apc_mode_name((int)mode) ? apc_mode_name((int)mode) : "of that number");
    const char *controller = e->controllers[0].name;
    if (!strcmp(name, controller) || (e->dim.nu == 1 && !strcmp(name, e->u[0].tag.name)))
        return 0;
    for (size_t i = 0; i < e->dim.nu; i++)
        if (!strcmp(name, e->u[i].tag.name))
            return apc_fail(why, APC_ESTATE, "%s has no mode of its own yet: all outputs have that of \"%s\"",
                            name, controller);
    return apc_fail(why, APC_ENOTFOUND, "there is no loop or controller \"%s\"; there is \"%s\"", name,
                    controller);
}

/* ---- Doing --------------------------------------------------------------------------------- */

static void describe(const struct apc_sample *s, char *text, size_t size)
{
    const char *mode = s->table == APC_OPMODE ? apc_mode_name((int)s->value) : NULL;
    char number[SETTINGS_NUMBER];
    settings_format(s->value, number);
    snprintf(text, size, "%s", s->seq == 0 ? "none" : mode ? mode : number);
}

int action_do(struct apc_store *store, const struct apc_tag *tags, size_t n, const struct apc_sample *to,
              apc_ns now, const char *source)
{
    const struct apc_tag *tag = find_id(tags, n, to->table, to->id);
    struct apc_event event = {.time = now, .severity = APC_EVENT_INFO, .kind = "operator"};
    struct apc_sample before = *to, after = *to;
    char was[SETTINGS_NUMBER], is[SETTINGS_NUMBER];
    int rc = apc_store_read(store, &before, 1);

    after.time = now;
    if (rc >= 0)
        rc = apc_store_put(store, &after, 1);
    if (rc < 0)
        return rc;
    describe(&before, was, sizeof was);
    describe(&after, is, sizeof is);
    snprintf(event.source, sizeof event.source, "%s", source);
    snprintf(event.text, sizeof event.text, "%.64s: %s -> %s", tag ? tag->name : "", was, is);
    rc = apc_store_append_events(store, &event, 1);
    return rc < 0 ? rc : 0;
}

/* ---- The list ------------------------------------------------------------------------------ */

/* What can be done, and what will be. */
static const char *const done[] = {"set", "mode", NULL};
static const char *const to_come[] = {"remote", "local",  "promote", "kill", "start",
                                      "ack",    "shelve", "service", NULL};

static bool is_one_of(const char *name, const char *const *names)
{
    while (*names && strcmp(*names, name) != 0)
        names++;
    return *names;
}

/* The one member that says what is to be done; NULL after a failure. */
static const config_setting_t *kind_of(struct settings *s, const config_setting_t *group)
{
    const config_setting_t *kind = NULL;
    if (!config_setting_is_group(group)) {
        settings_fail(s, group, "expected a group: { at = 100.0; set = \"...\"; value = 1.0; }");
        return NULL;
    }
    for (int i = 0; i < config_setting_length(group); i++) {
        const config_setting_t *member = config_setting_get_elem(group, (unsigned)i);
        const char *name = config_setting_name(member);
        if (!strcmp(name, "at") || !strcmp(name, "value"))
            continue;
        if (is_one_of(name, to_come))
            settings_fail(s, member, "an action \"%s\" is not possible yet: set and mode are", name);
        else if (!is_one_of(name, done))
            settings_fail(s, member, "there is no action \"%s\": set and mode are possible", name);
        else if (kind)
            settings_fail(s, member, "one action at a time: \"%s\" and \"%s\"", config_setting_name(kind),
                          name);
        kind = member;
    }
    if (!kind)
        settings_fail(s, group, "\"set\" or \"mode\" is missing in an action");
    return s->failed ? NULL : kind;
}

static void read_set(struct settings *s, const config_setting_t *group, const char *name,
                     struct action *action, const struct apc_tag *tags, size_t n)
{
    struct apc_tag tag;
    struct apc_error why;
    double value = 0;
    settings_number(s, group, "value", REQUIRED, -APC_VALUE_MAX, APC_VALUE_MAX, &value);
    if (!s->failed &&
        (action_find(tags, n, name, true, &tag, &why) < 0 || action_check(&tag, value, &why) < 0))
        settings_fail(s, group, "%s", why.text);
    if (!s->failed)
        action->to = (struct apc_sample){.table = tag.table, .id = tag.id, .value = value};
}

static void read_mode(struct settings *s, const config_setting_t *group, const char *name,
                      struct action *action, const struct experiment *e)
{
    struct apc_error why;
    char value[8] = "";
    int mode = APC_MODE_MAN;
    settings_text(s, group, "value", REQUIRED, value, sizeof value);
    while (!s->failed && apc_mode_name(mode) && strcmp(apc_mode_name(mode), value) != 0)
        mode++;
    if (!s->failed && !apc_mode_name(mode))
        settings_fail(s, group, "\"value\" is \"%s\": must be \"Man\" or \"Auto\"", value);
    if (!s->failed && action_find_mode(e, name, (enum apc_mode)mode, &why) < 0)
        settings_fail(s, group, "%s", why.text);
    action->to = (struct apc_sample){.table = APC_OPMODE, .id = 0, .value = mode};
}

static void read_action(struct settings *s, const config_setting_t *group, const struct experiment *e,
                        struct action *action, const struct apc_tag *tags, size_t n)
{
    const config_setting_t *kind = kind_of(s, group);
    char name[APC_TAG_LEN] = "";
    double at = 0;
    if (!kind)
        return;
    settings_number(s, group, "at", REQUIRED, 0, 366 * 86400.0, &at);
    if (!s->failed)
        apc_ns_from_s(at, &action->at);
    settings_text(s, group, config_setting_name(kind), REQUIRED, name, sizeof name);
    if (!strcmp(config_setting_name(kind), "set"))
        read_set(s, group, name, action, tags, n);
    else
        read_mode(s, group, name, action, e);
}

void experiment_read_actions(struct settings *s, const config_setting_t *root, struct experiment *e)
{
    const config_setting_t *list = settings_list(s, root, "actions", OPTIONAL);
    const int n = list && e->controllers->law ? config_setting_length(list) : 0;
    size_t n_tags = 0;

    if (n == 0) /* a daemon without the law knows no tuning, and does none of it */
        return;
    struct apc_tag *tags = provision_tags(e, &n_tags);
    e->action = calloc((size_t)n, sizeof *e->action);
    if (!tags || !e->action)
        s->failed = apc_fail(s->why, APC_ENOMEM, "%s: out of memory", s->file);
    for (int i = 0; i < n && !s->failed; i++) {
        struct action action = {0};
        size_t at = e->n_actions;
        read_action(s, config_setting_get_elem(list, (unsigned)i), e, &action, tags, n_tags);
        for (; at > 0 && e->action[at - 1].at > action.at;
             at--) /* by time; at one time in the file's order */
            e->action[at] = e->action[at - 1];
        e->action[at] = action;
        e->n_actions++;
    }
    free(tags);
}

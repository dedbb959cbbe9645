/* SPDX-License-Identifier: BSD-3-Clause */
/* What an operator does, whoever does it: the list of an experiment file, or a caller of the library. */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "experiment_parts.h"
#include "files/files.h"
#include "operate/operate.h"

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
static bool is_tag_called(const struct apc_tag *tag, const char *name)
{
    char address[48];
    snprintf(address, sizeof address, "%s.%d", apc_table_name(tag->table), tag->id);
    return !strcmp(tag->name, name) || !strcmp(address, name) ||
           (tag->table == APC_TUNING && former_is(name, tag->name));
}

/* What an operator writes to move it: the manual output of the loop whose output it is; of all else itself. */
static const struct apc_tag *moved_by(const struct experiment *e, const struct apc_tag *tags, size_t n,
                                      const struct apc_tag *tag)
{
    const struct controller_loop loop = controllers_above(e, (struct wire){tag->table, (size_t)tag->id - 1});
    const bool output = tag->table == APC_ACTUATOR || tag->table == APC_SENSOR;
    return output && loop.of ? find_id(tags, n, APC_MANUAL, controllers_loop_id(loop)) : tag;
}

int action_find(const struct experiment *e, const struct apc_tag *tags, size_t n, const char *name,
                bool write, struct apc_tag *found, struct apc_error *why)
{
    struct nearest nearest = {.wanted = name};
    for (size_t i = 0; i < n; i++) {
        const struct apc_tag *tag = &tags[i];
        if (write)
            tag = moved_by(e, tags, n, tag);
        if (!tag || (write && !may_write(tag->table)))
            continue;
        if (is_tag_called(&tags[i], name)) {
            *found = *tag;
            return 0;
        }
        nearest_look(&nearest, tags[i].name);
    }
    if (nearest.name)
        return apc_fail(why, APC_ENOTFOUND, "there is no \"%s\" to be %s: did you mean \"%s\"?", name,
                        write ? "set" : "read", nearest.name);
    return apc_fail(why, APC_ENOTFOUND, "there is no \"%s\" to be %s", name,
                    write ? "set: expected a setpoint, an output or a tuning parameter" : "read");
}

int action_check(const struct apc_tag *tag, double value, struct apc_error *why)
{
    struct change_fault fault;
    const int rc = change_limits(tag->name, tag->low, tag->high, value, &fault);
    return rc < 0 ? apc_fail(why, rc, "%s", fault.text) : 0;
}

static struct controller_loop find_loop(const struct experiment *e, const char *name, struct nearest *nearest)
{
    for (size_t i = 0; i < controllers_loops(e); i++) {
        const struct controller_loop loop = controllers_loop(e, i);
        const struct apc_tag *output = controllers_output(e, loop);
        char own[APC_TAG_LEN];
        controllers_loop_name(e, loop, own);
        if (!strcmp(own, name) || (loop.of->u[loop.u].table != APC_SETPOINT && !strcmp(output->name, name)))
            return loop;
        nearest_look(nearest, output->name);
    }
    return (struct controller_loop){NULL, 0};
}

static const struct controller *find_action_controller(const struct experiment *e, const char *name,
                                                       struct nearest *nearest)
{
    for (size_t i = 0; i < e->n_controllers; i++) {
        if (!strcmp(e->controllers[i].name, name))
            return &e->controllers[i];
        nearest_look(nearest, e->controllers[i].name);
    }
    return NULL;
}

static int check_action_mode(const struct experiment *e, struct controller_loop loop, enum apc_mode mode,
                             struct apc_error *why)
{
    struct change_fault fault;
    char name[APC_TAG_LEN];
    controllers_loop_name(e, loop, name);
    const int rc = change_cascade(name, controllers_is_below(e, loop), (double)mode, &fault);
    return rc < 0 ? apc_fail(why, APC_EINVAL, "%s", fault.text) : 0;
}

int action_find_mode(const struct experiment *e, const char *name, enum apc_mode mode, struct action *action,
                     struct apc_error *why)
{
    struct nearest nearest = {.wanted = name};
    if (mode != APC_MODE_MAN && mode != APC_MODE_AUTO && mode != APC_MODE_OOS && mode != APC_MODE_CAS)
        return apc_fail(why, APC_EINVAL, "mode %s is no target mode: it must be OOS, Man, Auto or Cas",
                        apc_mode_name((int)mode) ? apc_mode_name((int)mode) : "of that number");
    const struct controller *all = find_action_controller(e, name, &nearest);
    const struct controller_loop loop = all ? (struct controller_loop){all, 0} : find_loop(e, name, &nearest);
    if (!loop.of)
        return apc_fail(why, APC_ENOTFOUND, "there is no loop or controller \"%s\"%s%s%s", name,
                        nearest.name ? ": did you mean \"" : "", nearest.name ? nearest.name : "",
                        nearest.name ? "\"?" : "");
    action->to = (struct apc_sample){.table = APC_OPMODE, .id = controllers_loop_id(loop), .value = mode};
    action->n = all ? all->dim.nu : 1;
    for (size_t i = 0; i < action->n; i++) {
        int rc = check_action_mode(e, (struct controller_loop){loop.of, loop.u + i}, mode, why);
        if (rc < 0)
            return rc;
    }
    return 0;
}

int action_find_promotion(const struct experiment *e, const char *name, struct action *action,
                          struct apc_error *why)
{
    struct nearest nearest = {.wanted = name};
    const struct controller *c = find_action_controller(e, name, &nearest);
    if (!c)
        return apc_fail(why, APC_ENOTFOUND, "there is no controller \"%s\"%s%s%s", name,
                        nearest.name ? ": did you mean \"" : "", nearest.name ? nearest.name : "",
                        nearest.name ? "\"?" : "");
    if (!c->acting)
        return apc_fail(why, APC_EINVAL, "%s acts already: no other controller has its outputs", name);
    action->to = (struct apc_sample){.table = APC_OPMODE, .id = c->acting, .value = c->number};
    action->n = 1;
    return 0;
}

static bool is_scheduled(const struct experiment *e, const struct apc_tag *setpoint)
{
    size_t i = 0;
    while (i < e->scheduler.n && e->scheduler.z[i].at + 1 != (size_t)setpoint->id)
        i++;
    return i < e->scheduler.n;
}

int action_find_owner(const struct experiment *e, const char *name, bool remote, struct action *action,
                      struct apc_error *why)
{
    struct nearest nearest = {.wanted = name};
    const struct apc_tag *tag = NULL;
    for (size_t i = 0; i < e->dim.nz && !tag; i++) {
        tag = is_tag_called(&e->z[i].tag, name) ? &e->z[i].tag : NULL;
        nearest_look(&nearest, e->z[i].tag.name);
    }
    if (!tag)
        return apc_fail(why, APC_ENOTFOUND, "there is no setpoint \"%s\"%s%s%s", name,
                        nearest.name ? ": did you mean \"" : "", nearest.name ? nearest.name : "",
                        nearest.name ? "\"?" : "");
    const struct wire setpoint = {APC_SETPOINT, (size_t)tag->id - 1};
    const struct controller_loop loop = controllers_below(e, setpoint);
    action->n = 1;
    if (loop.of && controllers_is_below(e, loop)) {
        action->to = (struct apc_sample){.table = APC_OPMODE,
                                         .id = controllers_loop_id(loop),
                                         .value = remote ? APC_MODE_CAS : APC_MODE_AUTO};
        action->local = !remote;
        return 0;
    }
    action->to = (struct apc_sample){.table = APC_OPMODE, .id = LOOPS_OWNER(tag->id), .value = remote};
    return is_scheduled(e, tag)
               ? 0
               : apc_fail(why, APC_EINVAL, "%s is always Local: no scheduler and no controller moves it",
                          tag->name);
}

/* ---- Doing --------------------------------------------------------------------------------- */

static void describe_written(const struct apc_sample *s, char *text, size_t size)
{
    const bool owner = loops_is_owner(s), mode = s->table == APC_OPMODE && s->id < LOOPS_IDS;
    char number[DECIMAL_LEN];
    decimal_shortest(s->value, 15, number);
    snprintf(text, size, "%s",
             owner                                  ? loops_owner_name(loops_is_local(s))
             : s->seq == 0                          ? "no value yet"
             : mode && apc_mode_name((int)s->value) ? apc_mode_name((int)s->value)
                                                    : number);
}

/* What is written, in words. */
static const char *name_of_action(const struct loops *loops, const struct apc_tag *tags, size_t n,
                                  const struct action *action)
{
    const struct apc_tag *tag = find_id(tags, n, action->to.table, action->to.id);
    const struct loops_loop *loop =
        action->to.table == APC_OPMODE ? loops_of(loops, APC_OPMODE, action->to.id) : NULL;
    if (!loop)
        return tag ? tag->name : "";
    return action->n > 1 ? loops->controller[loop->controller].name : loop->name;
}

static int write_rows(struct apc_store *store, const struct loops *loops, const struct action *action,
                      struct apc_sample *before, struct apc_sample *rows, struct owner_rows *with)
{
    const int rc = apc_store_read(store, before, 1);
    if (rc < 0 || (action->local && !(before->value >= (double)APC_MODE_CAS)))
        return rc;
    rows->seq = action->local ? before->seq : APC_SEQ_ANY;
    return owner_put(store, loops, rows, action->n, with);
}

/* The alarm as its operator sees it: that is what is acknowledged. Where there is nothing, nothing is written. */
static int do_ack(struct apc_store *store, const struct apc_tag *alarm, const struct action *action,
                  apc_ns now, const char *source)
{
    struct apc_event event = {.time = now, .severity = APC_EVENT_INFO, .kind = "operator"};
    struct apc_sample seen = {.table = APC_ALARM, .id = action->alarm}, request = action->to;
    const int author = apc_store_author(store, source);
    int rc = author < 0 ? author : apc_store_read(store, &seen, 1);
    const enum apc_alarm_state state = seen.seq > 0 ? (enum apc_alarm_state)seen.value : APC_ALARM_NORMAL;
    const bool is = apc_alarm_is_unacked(state) || apc_alarm_is_latched(state);
    if (rc < 0)
        return rc;
    request.value = (double)seen.seq;
    request.time = now;
    request.seq = APC_SEQ_ANY;
    request.author = (uint32_t)author;
    rc = is ? apc_store_put(store, &request, 1) : 0;
    snprintf(event.source, sizeof event.source, "%s", source);
    snprintf(event.text, sizeof event.text, "%.64s: %s", alarm ? alarm->name : "",
             is ? "acknowledged" : "there is nothing to acknowledge");
    return rc < 0 ? rc : apc_store_append_events(store, &event, 1);
}

int action_do(struct apc_store *store, const struct loops *loops, const struct apc_tag *tags, size_t n,
              const struct action *action, apc_ns now, const char *source)
{
    if (action->alarm)
        return do_ack(store, find_id(tags, n, APC_ALARM, action->alarm), action, now, source);
    struct apc_event event = {.time = now, .severity = APC_EVENT_INFO, .kind = "operator"};
    struct apc_sample before = action->to, *rows = calloc(action->n, sizeof *rows);
    struct owner_rows with = {NULL, 0};
    const int author = apc_store_author(store, source);
    char was[DECIMAL_LEN], is[DECIMAL_LEN];

    for (size_t i = 0; rows && i < action->n; i++) {
        rows[i] = action->to;
        rows[i].id += (int)i;
        rows[i].time = now;
        rows[i].seq = APC_SEQ_ANY;
        rows[i].author = author > 0 ? (uint32_t)author : 0;
    }
    int rc = author < 0 ? author : rows ? 0 : APC_ENOMEM;
    if (rc >= 0)
        rc = write_rows(store, loops, action, &before, rows, &with);
    if (rc >= 0) {
        describe_written(&before, was, sizeof was);
        describe_written(rows[0].seq > 0 ? rows : &before, is, sizeof is);
        snprintf(event.source, sizeof event.source, "%s", source);
        snprintf(event.text, sizeof event.text, "%.64s: %s -> %s", name_of_action(loops, tags, n, action),
                 was, is);
        rc = apc_store_append_events(store, &event, 1);
    }
    free(with.at);
    free(rows);
    return rc < 0 ? rc : 0;
}

/* ---- The list ------------------------------------------------------------------------------ */

/* What can be done, and what will be. */
static const char *const done[] = {"set", "mode", "remote", "local", "promote", "kill", "start", "ack", NULL};
static const char *const to_come[] = {"shelve", "service", NULL};
#define POSSIBLE "set, mode, remote, local, promote, kill, start and ack"

static bool is_target_name(const char *name, const char *const *names)
{
    while (*names && strcmp(*names, name) != 0)
        names++;
    return *names;
}

/* The one member that says what is to be done; NULL after a failure. */
static const config_setting_t *kind_of_action(struct settings *s, const config_setting_t *group, bool timed)
{
    const config_setting_t *kind = NULL;
    if (!config_setting_is_group(group)) {
        settings_fail(s, group, "expected a group: { at = 100.0; set = \"...\"; value = 1.0; }");
        return NULL;
    }
    for (int i = 0; i < config_setting_length(group); i++) {
        const config_setting_t *member = config_setting_get_elem(group, (unsigned)i);
        const char *name = config_setting_name(member);
        if (!strcmp(name, timed ? "at" : "after") || !strcmp(name, "value") ||
            (!timed && !strcmp(name, "when")))
            continue;
        if (timed && !strcmp(name, "when"))
            settings_fail(s, member,
                          "\"when\" is of a scenario, for apc check: an experiment's action has \"at\"");
        else if (is_target_name(name, to_come))
            settings_fail(s, member, "an action \"%s\" is not possible yet: " POSSIBLE " are", name);
        else if (!is_target_name(name, done))
            settings_fail(s, member, "there is no action \"%s\": " POSSIBLE " are possible", name);
        else if (kind)
            settings_fail(s, member, "an action has \"%s\" and \"%s\": make two actions of it",
                          config_setting_name(kind), name);
        kind = member;
    }
    if (!kind)
        settings_fail(s, group, "an action needs one word for what it does: " POSSIBLE " are possible");
    return s->failed ? NULL : kind;
}

static void read_set(struct settings *s, const config_setting_t *group, const char *name,
                     struct action *action, const struct experiment *e, const struct apc_tag *tags, size_t n)
{
    struct apc_tag tag;
    struct apc_error why;
    double value = 0;
    settings_number(s, group, "value", REQUIRED, -APC_VALUE_MAX, APC_VALUE_MAX, &value);
    if (!s->failed &&
        (action_find(e, tags, n, name, true, &tag, &why) < 0 || action_check(&tag, value, &why) < 0))
        settings_fail(s, group, "%s", why.text);
    if (!s->failed)
        action->to = (struct apc_sample){.table = tag.table, .id = tag.id, .value = value};
    action->n = 1;
}

static void read_action_mode(struct settings *s, const config_setting_t *group, const char *name,
                             struct action *action, const struct experiment *e)
{
    struct apc_error why;
    char value[8] = "";
    int mode = APC_MODE_MAN;
    settings_text(s, group, "value", REQUIRED, value, sizeof value);
    while (!s->failed && apc_mode_name(mode) && strcmp(apc_mode_name(mode), value) != 0)
        mode++;
    if (!s->failed && !apc_mode_name(mode))
        settings_fail(s, group, "\"value\" is \"%s\": must be \"OOS\", \"Man\", \"Auto\" or \"Cas\"", value);
    if (!s->failed && action_find_mode(e, name, (enum apc_mode)mode, action, &why) < 0)
        settings_fail(s, group, "%s", why.text);
}

static void read_promotion(struct settings *s, const config_setting_t *group, const char *name,
                           struct action *action, const struct experiment *e)
{
    struct apc_error why;
    if (config_setting_get_member(group, "value"))
        settings_fail(s, group, "\"promote\" takes no \"value\": leave it out");
    else if (!s->failed && action_find_promotion(e, name, action, &why) < 0)
        settings_fail(s, group, "%s", why.text);
}

static void read_action_owner(struct settings *s, const config_setting_t *group, const char *name,
                              bool remote, struct action *action, const struct experiment *e)
{
    struct apc_error why;
    if (config_setting_get_member(group, "value"))
        settings_fail(s, group, "\"local\" and \"remote\" take no \"value\": leave it out");
    else if (!s->failed && action_find_owner(e, name, remote, action, &why) < 0)
        settings_fail(s, group, "%s", why.text);
}

static void read_life(struct settings *s, const config_setting_t *group, const char *name,
                      struct action *action, const struct experiment *e)
{
    struct nearest nearest = {.wanted = name};
    const struct controller *c = find_action_controller(e, name, &nearest);
    if (config_setting_get_member(group, "value"))
        settings_fail(s, group, "\"kill\" and \"start\" take no \"value\": leave it out");
    else if (!c)
        settings_fail(s, group, "there is no controller \"%s\"%s%s%s", name,
                      nearest.name ? ": did you mean \"" : "", nearest.name ? nearest.name : "",
                      nearest.name ? "\"?" : "");
    else
        action->controller = (size_t)(c - e->controllers);
}

static void read_ack(struct settings *s, const config_setting_t *group, const char *name,
                     struct action *action, const struct experiment *e)
{
    struct nearest nearest = {.wanted = name};
    size_t i = 0;
    while (i < e->n_alarms && strcmp(e->alarm[i].name, name) != 0)
        nearest_look(&nearest, e->alarm[i++].name);
    if (config_setting_get_member(group, "value"))
        settings_fail(s, group, "\"ack\" takes no \"value\": leave it out");
    else if (i == e->n_alarms)
        settings_fail(s, group, "there is no alarm \"%s\"%s%s%s", name,
                      nearest.name ? ": did you mean \"" : "", nearest.name ? nearest.name : "",
                      nearest.name ? "\"?" : "");
    action->alarm = (int)i + 1;
    action->to =
        (struct apc_sample){.table = APC_OPMODE, .id = apc_alarm_switch_id(APC_ALARM_ACK, action->alarm)};
    action->n = 1;
}

static void read_action(struct settings *s, const config_setting_t *group, const struct experiment *e,
                        bool timed, struct action *action, const struct apc_tag *tags, size_t n)
{
    const config_setting_t *kind = kind_of_action(s, group, timed);
    char name[APC_TAG_LEN] = "";
    double at = 0;
    if (!kind)
        return;
    if (timed)
        settings_number(s, group, "at", REQUIRED, 0, 366 * 86400.0, &at);
    apc_ns_from_s(at, &action->at);
    const char *what = config_setting_name(kind);
    settings_text(s, group, what, REQUIRED, name, sizeof name);
    action->kind = !strcmp(what, "kill") ? ACTION_KILL : !strcmp(what, "start") ? ACTION_START : ACTION_WRITE;
    if (!strcmp(what, "set"))
        read_set(s, group, name, action, e, tags, n);
    else if (!strcmp(what, "mode"))
        read_action_mode(s, group, name, action, e);
    else if (!strcmp(what, "remote") || !strcmp(what, "local"))
        read_action_owner(s, group, name, !strcmp(what, "remote"), action, e);
    else if (!strcmp(what, "promote"))
        read_promotion(s, group, name, action, e);
    else if (!strcmp(what, "ack"))
        read_ack(s, group, name, action, e);
    else
        read_life(s, group, name, action, e);
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
        read_action(s, config_setting_get_elem(list, (unsigned)i), e, true, &action, tags, n_tags);
        for (; at > 0 && e->action[at - 1].at > action.at;
             at--) /* by time; at one time in the file's order */
            e->action[at] = e->action[at - 1];
        e->action[at] = action;
        e->n_actions++;
    }
    free(tags);
}

void experiment_read_action(struct settings *s, const config_setting_t *group, const struct experiment *e,
                            struct action *action)
{
    size_t n = 0;
    struct apc_tag *tags = provision_tags(e, &n);
    if (tags)
        read_action(s, group, e, false, action, tags, n);
    else
        s->failed = apc_fail(s->why, APC_ENOMEM, "%s: out of memory", s->file);
    free(tags);
}

/* SPDX-License-Identifier: BSD-3-Clause */
/* The alarms of an experiment file: those of each signal and controller, and how they are evaluated. */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "experiment_parts.h"
#include "files/files.h"

#define PERIOD_MIN  (100 * APC_NS_PER_MS) /* of what evaluates them, where the file does not say it */
#define DELAY_MAX_S 86400.0
#define OVERRUN_OFF 60.0 /* s; a tick is missed for a moment only */
#define OVERRUN_MAX 1000000

/* A list of alarms, and whose they are. */
struct owner {
    struct experiment *e;
    const config_setting_t **group; /* [n] of each alarm */
    size_t room;
    const char *name, *area;
    struct wire wire;            /* a signal */
    const struct controller *of; /* or a controller */
    struct apc_tag tag;          /* of the signal */
};

/* ---- Which kinds there are ------------------------------------------------------------------ */

static bool is_level(enum apc_alarm_kind kind)
{
    return kind >= APC_ALARM_LOW_LOW && kind <= APC_ALARM_HIGH_HIGH;
}

static bool is_level_alarm(enum apc_alarm_kind kind)
{
    return is_level(kind) || kind == APC_ALARM_DEVIATION || kind == APC_ALARM_RATE;
}

static bool has_kind(const struct owner *o, enum apc_alarm_kind kind)
{
    const bool sensor = !o->of && o->wire.table == APC_SENSOR;
    if (kind == APC_ALARM_STOPPED || kind == APC_ALARM_OVERRUN)
        return o->of != NULL;
    if (kind == APC_ALARM_FROZEN || kind == APC_ALARM_BAD)
        return sensor;
    if (kind == APC_ALARM_AT_LIMIT || kind == APC_ALARM_MODE)
        return !o->of && !sensor;
    return !o->of;
}

/* "a", "b" or "c" */
static void name_kinds(const struct owner *o, char *text, size_t size)
{
    int last = 0;
    for (int k = 1; k < APC_ALARM_KINDS; k++)
        last = has_kind(o, (enum apc_alarm_kind)k) ? k : last;
    text[0] = '\0';
    for (int k = 1; k <= last; k++) {
        const size_t used = strlen(text);
        if (has_kind(o, (enum apc_alarm_kind)k))
            snprintf(text + used, size - used, "%s\"%s\"",
                     !used       ? ""
                     : k == last ? " or "
                                 : ", ",
                     apc_alarm_kind_name((enum apc_alarm_kind)k));
    }
}

static enum apc_alarm_kind read_kind(struct settings *s, const config_setting_t *group, const struct owner *o)
{
    char name[16] = "", kinds[160];
    settings_text(s, group, "kind", REQUIRED, name, sizeof name);
    const enum apc_alarm_kind kind = apc_alarm_kind_parse(name);
    if (s->failed || (kind && has_kind(o, kind)))
        return kind;
    name_kinds(o, kinds, sizeof kinds);
    settings_fail(s, config_setting_get_member(group, "kind"), "\"kind\" is \"%s\": must be %s", name, kinds);
    return (enum apc_alarm_kind)0;
}

/* ---- What an alarm refers to ----------------------------------------------------------------- */

static const struct apc_tag *find_among(const struct signal *signal, size_t n, const char *name,
                                        struct nearest *nearest)
{
    for (size_t i = 0; i < n; i++) {
        if (!strcmp(signal[i].tag.name, name))
            return &signal[i].tag;
        nearest_look(nearest, signal[i].tag.name);
    }
    return NULL;
}

static const struct apc_tag *read_reference(struct settings *s, const config_setting_t *group,
                                            const char *member, const struct experiment *e)
{
    char name[APC_TAG_LEN] = "";
    settings_text(s, group, member, REQUIRED, name, sizeof name);
    if (s->failed)
        return NULL;
    struct nearest nearest = {.wanted = name};
    const struct apc_tag *tag = find_among(e->y, e->dim.ny + e->n_signals, name, &nearest);
    if (!tag)
        tag = find_among(e->z, e->dim.nz, name, &nearest);
    if (!tag)
        tag = find_among(e->u, e->dim.nu, name, &nearest);
    if (!tag)
        settings_fail(s, config_setting_get_member(group, member), "there is no signal \"%s\"%s%s%s", name,
                      nearest.name ? ": did you mean \"" : "", nearest.name ? nearest.name : "",
                      nearest.name ? "\"?" : "");
    return tag;
}

static void read_delay(struct settings *s, const config_setting_t *group, const char *name, double seconds,
                       apc_ns *delay)
{
    settings_number(s, group, name, OPTIONAL, 0, DELAY_MAX_S, &seconds);
    (void)apc_ns_from_s(seconds, delay);
}

/* suppress = { signal = "v1"; below = 0.5; hold = 10.0; } or { alarm = "link"; }: that one is looked for when
 * all are known. */
static void read_suppression(struct settings *s, const config_setting_t *of, const struct experiment *e,
                             struct apc_alarm_suppression *by)
{
    static const char *const known[] = {"alarm", "signal", "below", "above", "hold", NULL};
    const config_setting_t *group = settings_group(s, of, "suppress", OPTIONAL);
    *by = (struct apc_alarm_suppression){.below = -HUGE_VAL, .above = HUGE_VAL};
    if (!group)
        return;
    settings_known(s, group, known);
    read_delay(s, group, "hold", 0, &by->hold);
    const bool alarm = config_setting_get_member(group, "alarm"),
               signal = config_setting_get_member(group, "signal"),
               below = config_setting_get_member(group, "below"),
               above = config_setting_get_member(group, "above");
    if (!s->failed && (alarm == signal || (below || above) != signal))
        settings_fail(
            s, group,
            "\"suppress\" needs a signal or an alarm: { signal = \"v1\"; below = 0.5; } or { alarm = "
            "\"y1.bad\"; }");
    if (!signal || s->failed)
        return;
    const struct apc_tag *tag = read_reference(s, group, "signal", e);
    settings_number(s, group, "below", OPTIONAL, -APC_VALUE_MAX, APC_VALUE_MAX, &by->below);
    settings_number(s, group, "above", OPTIONAL, -APC_VALUE_MAX, APC_VALUE_MAX, &by->above);
    if (tag && by->below > by->above)
        settings_fail(s, group, "\"below\" must not be above \"above\": it would always be suppressed");
    by->table = tag ? tag->table : (enum apc_table)0;
    by->id = tag ? tag->id : 0;
}

/* ---- An alarm -------------------------------------------------------------------------------- */

/* Back from the limit by the deadband there must be a value that the signal can have. */
static void check_deadband(struct settings *s, const config_setting_t *group, const struct apc_alarm *a,
                           const struct apc_tag *tag)
{
    const bool up = a->kind == APC_ALARM_HIGH || a->kind == APC_ALARM_HIGH_HIGH;
    const double back = is_level(a->kind) && !up ? a->limit + a->deadband : a->limit - a->deadband;
    const double low = is_level(a->kind) ? tag->low : 0, high = is_level(a->kind) ? tag->high : APC_VALUE_MAX;
    if (!s->failed && is_level_alarm(a->kind) && (back < low || back > high))
        settings_fail(
            s, config_setting_get_member(group, "deadband"),
            "\"deadband\" is %.15g: the alarm would return to normal at %.15g, outside %.15g to %.15g only",
            a->deadband, back, low, high);
}

static void read_alarm_signal(struct settings *s, const config_setting_t *group, const struct owner *o,
                              struct apc_alarm *a)
{
    a->table = o->wire.table;
    a->id = o->tag.id;
    a->low = o->tag.low;
    a->high = o->tag.high;
    if (a->table == APC_SENSOR)
        a->horizon = module_horizon(o->e, o->wire);
    if (a->kind == APC_ALARM_AT_LIMIT && a->low <= -APC_VALUE_MAX && a->high >= APC_VALUE_MAX)
        settings_fail(s, group, "%s has no limits to be at: give it \"low\" or \"high\"", o->tag.name);
    if (a->kind != APC_ALARM_MODE)
        return;
    const struct controller_loop loop = controllers_above(o->e, o->wire);
    if (!loop.of)
        settings_fail(s, group, "no controller moves %s, so it has no mode", o->tag.name);
    a->table = APC_OPMODE;
    a->id = loop.of ? controllers_loop_id(loop) : 0;
}

static void read_missed(struct settings *s, const config_setting_t *group, struct apc_alarm *a)
{
    int64_t missed = 1;
    settings_whole(s, group, "limit", OPTIONAL, 1, OVERRUN_MAX, &missed);
    a->limit = (double)missed;
}

static void read_limit(struct settings *s, const config_setting_t *group, const struct owner *o,
                       struct apc_alarm *a)
{
    const bool level = is_level(a->kind);
    if (a->kind == APC_ALARM_OVERRUN)
        read_missed(s, group, a);
    else if (is_level_alarm(a->kind))
        settings_number(s, group, "limit", REQUIRED, level ? o->tag.low : 0,
                        level ? o->tag.high : APC_VALUE_MAX, &a->limit);
    else if (!s->failed && config_setting_get_member(group, "limit"))
        settings_fail(s, config_setting_get_member(group, "limit"),
                      "an alarm of kind \"%s\" has no \"limit\"", apc_alarm_kind_name(a->kind));
    if (a->kind == APC_ALARM_DEVIATION) {
        const struct apc_tag *from = read_reference(s, group, "from", o->e);
        a->other_table = from ? from->table : (enum apc_table)0;
        a->other = from ? from->id : 0;
    } else if (!s->failed && config_setting_get_member(group, "from")) {
        settings_fail(s, config_setting_get_member(group, "from"),
                      "only an alarm of kind \"deviation\" has \"from\": leave it out");
    }
    settings_number(s, group, "deadband", OPTIONAL, 0, APC_VALUE_MAX, &a->deadband);
    check_deadband(s, group, a, &o->tag);
}

static void read_alarm(struct settings *s, const config_setting_t *group, const struct owner *o,
                       struct alarm *alarm)
{
    static const char *const known[] = {"kind",      "limit",    "deadband",    "priority", "delay",
                                        "off_delay", "latching", "from",        "message",  "name",
                                        "area",      "suppress", "consequence", "response", NULL};
    struct apc_alarm *a = &alarm->is;
    int64_t priority = 3;
    if (!config_setting_is_group(group)) {
        settings_fail(s, group, "expected a group: { kind = \"high\"; limit = 9.0; }");
        return;
    }
    settings_known(s, group, known);
    a->kind = read_kind(s, group, o);
    if (s->failed)
        return;
    if (o->of) {
        a->table = APC_TICK;
        a->id = o->of->number;
        a->horizon = 3 * o->of->rhythm.period + 100 * APC_NS_PER_MS;
    } else {
        read_alarm_signal(s, group, o, a);
    }
    read_limit(s, group, o, a);
    settings_whole(s, group, "priority", OPTIONAL, 1, APC_ALARM_PRIORITIES, &priority);
    a->priority = (int)priority;
    read_delay(s, group, "delay", 0, &a->on_delay);
    read_delay(s, group, "off_delay", a->kind == APC_ALARM_OVERRUN ? OVERRUN_OFF : 0, &a->off_delay);
    settings_flag(s, group, "latching", &a->latching);
    read_suppression(s, group, o->e, &a->suppression);
    snprintf(alarm->name, sizeof alarm->name, "%.46s.%s", o->name, apc_alarm_kind_name(a->kind));
    if (config_setting_get_member(group, "name"))
        settings_name(s, group, alarm->name, sizeof alarm->name);
    snprintf(alarm->area, sizeof alarm->area, "%s", o->area);
    settings_text(s, group, "area", OPTIONAL, alarm->area, sizeof alarm->area);
    settings_text(s, group, "message", OPTIONAL, alarm->message, sizeof alarm->message);
    settings_text(s, group, "consequence", OPTIONAL, alarm->consequence, sizeof alarm->consequence);
    settings_text(s, group, "response", OPTIONAL, alarm->response, sizeof alarm->response);
}

/* ---- All of an owner ------------------------------------------------------------------------- */

/* One of a kind, but for those with a name of their own, and levels that rise. */
static void check_kinds(struct settings *s, const struct owner *o, size_t first)
{
    const struct experiment *e = o->e;
    for (size_t i = first; i < e->n_alarms && !s->failed; i++)
        for (size_t k = first; k < i && !s->failed; k++) {
            const struct apc_alarm *a = &e->alarm[k].is, *b = &e->alarm[i].is;
            const struct apc_alarm *low = a->kind < b->kind ? a : b, *high = a->kind < b->kind ? b : a;
            if (a->kind == b->kind && !config_setting_get_member(o->group[i], "name"))
                settings_fail(s, o->group[i], "%s has two alarms of this kind: a signal takes one of each",
                              o->name);
            else if (is_level(low->kind) && is_level(high->kind) && a->kind != b->kind &&
                     low->limit >= high->limit)
                settings_fail(
                    s, o->group[i], "the limit of \"%s\", %.15g, must be above that of \"%s\", %.15g",
                    apc_alarm_kind_name(high->kind), high->limit, apc_alarm_kind_name(low->kind), low->limit);
        }
}

static bool make_alarm_room(struct settings *s, struct owner *o, size_t more)
{
    struct experiment *e = o->e;
    if (s->failed || (o->group && e->n_alarms + more <= o->room))
        return !s->failed;
    const size_t room = 2 * o->room + more + 1;
    struct alarm *alarm = reallocarray(e->alarm, room, sizeof *alarm);
    if (alarm)
        e->alarm = alarm;
    /* NOLINTNEXTLINE(bugprone-sizeof-expression): an array of pointers */
    const config_setting_t **group = reallocarray(o->group, room, sizeof *group);
    if (group)
        o->group = group;
    if (!alarm || !group) {
        s->failed = apc_fail(s->why, APC_ENOMEM, "%s: out of memory", s->file);
        return false;
    }
    o->room = room;
    return true;
}

static void read_alarm_list(struct settings *s, const config_setting_t *of, struct owner *o)
{
    struct experiment *e = o->e;
    const size_t first = e->n_alarms;
    const config_setting_t *list = of ? settings_list(s, of, "alarms", OPTIONAL) : NULL;
    const size_t n = list ? (size_t)config_setting_length(list) : 0;
    if (e->n_alarms + n > APC_ALARMS_MAX)
        settings_fail(s, list, "there are more than %d alarms", APC_ALARMS_MAX);
    if (!make_alarm_room(s, o, n))
        return;
    for (size_t i = 0; i < n && !s->failed; i++) {
        o->group[e->n_alarms] = config_setting_get_elem(list, (unsigned)i);
        e->alarm[e->n_alarms] = (struct alarm){.is = {.limit = 0}};
        read_alarm(s, o->group[e->n_alarms], o, &e->alarm[e->n_alarms]);
        e->n_alarms++;
    }
    check_kinds(s, o, first);
}

static void read_alarm_signals(struct settings *s, const config_setting_t *root, const char *name,
                               struct owner *o, enum apc_table table, size_t first)
{
    const config_setting_t *list = config_setting_get_member(root, name);
    for (int i = 0; list && i < config_setting_length(list) && !s->failed; i++) {
        const size_t at = first + (size_t)i;
        const struct signal *of = table == APC_SENSOR ? o->e->y : table == APC_SETPOINT ? o->e->z : o->e->u;
        o->wire = (struct wire){table, at};
        o->tag = of[at].tag;
        o->name = o->tag.name;
        o->area = o->tag.area;
        read_alarm_list(s, config_setting_get_elem(list, (unsigned)i), o);
    }
}

static void read_controllers(struct settings *s, const config_setting_t *root, struct owner *o)
{
    const config_setting_t *list = config_setting_get_member(root, "controllers");
    for (size_t i = 0; i < o->e->n_controllers && !s->failed; i++) {
        o->of = &o->e->controllers[i];
        o->tag = (struct apc_tag){.table = APC_TICK};
        o->name = o->of->name;
        o->area = "";
        read_alarm_list(s,
                        list ? config_setting_get_elem(list, (unsigned)i)
                             : config_setting_get_member(root, "controller"),
                        o);
    }
}

/* ---- What is known when all are ---------------------------------------------------------------- */

static void check_alarm_names(struct settings *s, const struct owner *o)
{
    const struct experiment *e = o->e;
    for (size_t i = 0; i < e->n_alarms && !s->failed; i++)
        for (size_t k = 0; k < i && !s->failed; k++)
            if (!strcmp(e->alarm[i].name, e->alarm[k].name))
                settings_fail(s, o->group[i], "two alarms are called \"%s\": give one of them a \"name\"",
                              e->alarm[i].name);
}

static void find_suppressor(struct settings *s, const struct owner *o, size_t i)
{
    const struct experiment *e = o->e;
    const config_setting_t *group = config_setting_get_member(o->group[i], "suppress"),
                           *member = group ? config_setting_get_member(group, "alarm") : NULL;
    char name[APC_TAG_LEN] = "";
    if (!member)
        return;
    settings_text(s, group, "alarm", REQUIRED, name, sizeof name);
    struct nearest nearest = {.wanted = name};
    for (size_t k = 0; k < e->n_alarms && !s->failed; k++) {
        nearest_look(&nearest, e->alarm[k].name);
        if (!strcmp(e->alarm[k].name, name))
            e->alarm[i].is.suppression.alarm = (int)k + 1;
    }
    if (!s->failed && !e->alarm[i].is.suppression.alarm)
        settings_fail(s, member, "there is no alarm \"%s\"%s%s%s", name,
                      nearest.name ? ": did you mean \"" : "", nearest.name ? nearest.name : "",
                      nearest.name ? "\"?" : "");
}

/* Nobody would ever see those that suppress each other. */
static void check_rings(struct settings *s, const struct owner *o)
{
    const struct experiment *e = o->e;
    for (size_t i = 0; i < e->n_alarms && !s->failed; i++) {
        int at = e->alarm[i].is.suppression.alarm;
        for (size_t n = 0; at > 0 && n < e->n_alarms && !s->failed; n++) {
            if ((size_t)at == i + 1)
                settings_fail(s, o->group[i],
                              "alarm %s would suppress itself: name another signal or alarm in \"suppress\"",
                              e->alarm[i].name);
            at = e->alarm[at - 1].is.suppression.alarm;
        }
    }
}

static void check_all(struct settings *s, const struct owner *o)
{
    check_alarm_names(s, o);
    for (size_t i = 0; i < o->e->n_alarms && !s->failed; i++)
        find_suppressor(s, o, i);
    check_rings(s, o);
}

/* ---- How they are evaluated -------------------------------------------------------------------- */

apc_ns alarm_notice_quiet(const struct alarm_notice *is, apc_ns utc)
{
    const time_t now = (time_t)(utc / APC_NS_PER_S);
    struct tm t;
    if (is->quiet_from == is->quiet_until || !localtime_r(&now, &t))
        return 0;
    const int minute = 60 * t.tm_hour + t.tm_min;
    const bool overnight = is->quiet_from > is->quiet_until, late = minute >= is->quiet_from,
               early = minute < is->quiet_until;
    if (overnight ? !late && !early : !late || !early)
        return 0;
    t.tm_mday += overnight && late;
    t.tm_hour = is->quiet_until / 60;
    t.tm_min = is->quiet_until % 60;
    t.tm_sec = 0;
    t.tm_isdst = -1;
    const apc_ns left = (apc_ns)mktime(&t) * APC_NS_PER_S - utc;
    return left > 0 ? left : 60 * APC_NS_PER_S; /* an hour that comes twice */
}

static bool read_minute(const char *text, int *minute)
{
    static const char pattern[] = "29:59";
    for (size_t i = 0; i < sizeof pattern - 1; i++)
        if (pattern[i] == ':' ? text[i] != ':' : text[i] < '0' || text[i] > pattern[i])
            return false;
    *minute = 60 * (10 * (text[0] - '0') + text[1] - '0') + 10 * (text[3] - '0') + text[4] - '0';
    return *minute < 24 * 60;
}

static void read_quiet(struct settings *s, const config_setting_t *group, struct alarm_notice *notice)
{
    char text[16] = "";
    settings_text(s, group, "quiet", OPTIONAL, text, sizeof text);
    if (s->failed || !config_setting_get_member(group, "quiet"))
        return;
    if (!read_minute(text, &notice->quiet_from) || text[5] != '-' ||
        !read_minute(text + 6, &notice->quiet_until) || text[11] != '\0' ||
        notice->quiet_from == notice->quiet_until)
        settings_fail(s, config_setting_get_member(group, "quiet"),
                      "\"quiet\" is \"%s\": expected two times of the day, as \"22:00-06:00\"", text);
}

/* notify = ( { priority = 1; command = "mail -s alarm operator"; timeout = 10.0; after = 300.0; } ) */
static void read_notices(struct settings *s, const config_setting_t *of, struct experiment *e)
{
    static const char *const known[] = {"priority", "command", "timeout", "after",
                                        "repeat",   "quiet",   "details", NULL};
    const config_setting_t *list = settings_list(s, of, "notify", OPTIONAL);
    const size_t n = list ? (size_t)config_setting_length(list) : 0;
    if (n > ALARM_NOTICES) {
        settings_fail(s, list, "\"notify\" has more than %d commands", ALARM_NOTICES);
        return;
    }
    for (size_t i = 0; i < n && !s->failed; i++) {
        const config_setting_t *group = config_setting_get_elem(list, (unsigned)i);
        struct alarm_notice *notice = &e->alarms.notice[i];
        int64_t priority = APC_ALARM_PRIORITIES;
        double timeout = 10, after = 0, repeat = 0;
        if (!config_setting_is_group(group)) {
            settings_fail(s, group, "expected a group: { priority = 1; command = \"...\"; }");
            return;
        }
        settings_known(s, group, known);
        settings_whole(s, group, "priority", OPTIONAL, 1, APC_ALARM_PRIORITIES, &priority);
        settings_text(s, group, "command", REQUIRED, notice->command, sizeof notice->command);
        settings_number(s, group, "timeout", OPTIONAL, 0.1, 600, &timeout);
        settings_number(s, group, "after", OPTIONAL, 0, 86400, &after);
        settings_number(s, group, "repeat", OPTIONAL, 1, 86400, &repeat);
        read_quiet(s, group, notice);
        notice->details = true;
        settings_flag(s, group, "details", &notice->details);
        if (!s->failed && notice->command[0] == '\0')
            settings_fail(s, group, "\"command\" is empty: expected a program and its arguments");
        notice->priority = (int)priority;
        (void)apc_ns_from_s(timeout, &notice->timeout);
        (void)apc_ns_from_s(after, &notice->after);
        (void)apc_ns_from_s(repeat, &notice->repeat);
    }
    e->alarms.n_notices = n;
}

/* As often as measurements come, from ten times a second to once. */
static void read_evaluation(struct settings *s, const config_setting_t *root, struct experiment *e)
{
    static const char *const known[] = {"period", "shelve_max", "notify", NULL};
    const config_setting_t *group = settings_group(s, root, "alarms", OPTIONAL);
    const apc_ns client = e->client.rhythm.period;
    double shelve_max = 8 * 3600.0;
    e->alarms.rhythm.period = client < PERIOD_MIN     ? PERIOD_MIN
                              : client > APC_NS_PER_S ? APC_NS_PER_S
                                                      : client;
    e->alarms.rhythm.overrun = APC_OVERRUN_SKIP;
    if (group) {
        settings_known(s, group, known);
        settings_period(s, group, "period", OPTIONAL, &e->alarms.rhythm.period);
        settings_number(s, group, "shelve_max", OPTIONAL, 1, 7 * 86400.0, &shelve_max);
        read_notices(s, group, e);
    }
    (void)apc_ns_from_s(shelve_max, &e->alarms.shelve_max);
}

void experiment_read_alarms(struct settings *s, const config_setting_t *root, struct experiment *e)
{
    struct owner o = {.e = e};
    if (s->failed)
        return;
    read_alarm_signals(s, root, "measurements", &o, APC_SENSOR, 0);
    read_alarm_signals(s, root, "signals", &o, APC_SENSOR, e->dim.ny);
    read_alarm_signals(s, root, "setpoints", &o, APC_SETPOINT, 0);
    read_alarm_signals(s, root, "outputs", &o, APC_ACTUATOR, 0);
    read_controllers(s, root, &o);
    if (o.group)
        check_all(s, &o);
    for (size_t i = 0; i < e->n_alarms; i++)
        e->alarm[i].is.name = e->alarm[i].name;
    read_evaluation(s, root, e);
    free(o.group);
}

/* SPDX-License-Identifier: BSD-3-Clause */
/*
 * The scenario file: an experiment file with some of its settings changed, and what is expected. Each change is
 * made as by `--set`; where the experiment is refused with it, the line that made it is told of.
 */
#include "check_internal.h"

#include <errno.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "files/files.h"
#include "files/settings.h"

/* A list grows element by element, each a change of its own: so a fault has a line. */
struct scenario_change {
    char *path, *value;
    unsigned line; /* 0: of the command line */
};

/* A fault, disturbance or action with a condition instead of a time. */
struct scenario_when {
    const config_setting_t *group;
    enum scenario_trigger_what what;
    size_t signal, fault; /* of a fault: whose, by its place, but for the plant; which of its list */
};

struct scenario_reading {
    struct settings s;
    struct scenario *of;
    const char *session;  /* run folder instead of the experiment that the file names; NULL: none */
    bool reference;       /* its experiment with the file's `actions` instead of what people wrote */
    struct record record; /* of a run folder: what else was in force */
    struct scenario_when *when;
    size_t n_when;
    struct scenario_change *change;
    size_t n, room;
};

static void lack_memory(struct scenario_reading *r)
{
    if (!r->s.failed)
        r->s.failed = apc_fail(r->s.why, APC_ENOMEM, "%s: out of memory", r->s.file);
}

/* Takes @p value, which may be NULL: there was no memory. */
static void add_change(struct scenario_reading *r, const char *path, char *value, unsigned line)
{
    struct scenario_change change = {strdup(path), value, line};
    if (r->n == r->room) {
        const size_t room = r->room ? 2 * r->room : 16;
        struct scenario_change *at = reallocarray(r->change, room, sizeof *at);
        if (at) {
            r->change = at;
            r->room = room;
        }
    }
    if (!change.path || !change.value || r->n == r->room) {
        free(change.path);
        free(change.value);
        lack_memory(r);
        return;
    }
    r->change[r->n++] = change;
}

/* ---- Lists ---------------------------------------------------------------------------------- */

static bool has_when(const config_setting_t *group)
{
    return config_setting_get_member(group, "when");
}

/* As the experiment has them: of a fault, which is of @kind, without its signal, and without a condition. */
static void put_experiment_members(FILE *out, const config_setting_t *group, const char *kind)
{
    const bool waits = has_when(group);
    for (int i = 0; i < config_setting_length(group); i++) {
        const config_setting_t *member = config_setting_get_elem(group, (unsigned)i);
        char *text = NULL;
        const char *name = config_setting_name(member);
        if ((kind && !strcmp(name, "signal")) || (waits && (!strcmp(name, "when") || !strcmp(name, "after"))))
            continue;
        if (kind && !strcmp(name, "kind"))
            fprintf(out, "kind = \"%s\"; ", kind);
        else if (experiment_setting_text(member, &text) == 0)
            fprintf(out, "%s = %s; ", name, text);
        free(text);
    }
    fputc('}', out);
}

/* The last change of @p path is a list, which gets one element more; or there is none, and it gets the first. */
static void grow_list(struct scenario_reading *r, const char *path, const config_setting_t *element,
                      const char *kind)
{
    char *list = NULL;
    size_t size = 0;
    const char *before = NULL;
    FILE *out = open_memstream(&list, &size);
    for (size_t i = r->n; i > 0 && !before; i--)
        before = strcmp(r->change[i - 1].path, path) ? NULL : r->change[i - 1].value;
    if (before && before[1 + strspn(before + 1, " ")] == ')') /* a setting has emptied it */
        before = NULL;
    if (out) {
        fprintf(out, "%.*s%s", before ? (int)strlen(before) - 1 : 1, before ? before : "(",
                before ? ", " : "");
        fputs(has_when(element) ? "{ at = 0.0; " : "{ ", out); /* a fault: a time that is not kept */
        put_experiment_members(out, element, kind);
        fputc(')', out);
    }
    if (!out || fclose(out) != 0) {
        free(list);
        list = NULL;
    }
    add_change(r, path, list, config_setting_source_line(element));
}

static void read_groups(struct scenario_reading *r, const config_setting_t *root, const char *name,
                        void (*read)(struct scenario_reading *r, const config_setting_t *group))
{
    const config_setting_t *list = settings_list(&r->s, root, name, OPTIONAL);
    const int n = list ? config_setting_length(list) : 0;
    for (int i = 0; i < n && !r->s.failed; i++) {
        const config_setting_t *group = config_setting_get_elem(list, (unsigned)i);
        if (config_setting_is_group(group))
            read(r, group);
        else
            settings_fail(&r->s, group, "\"%s\" must be a list of groups: %s = ( { ... } );", name, name);
    }
}

/* In place of the list at @p path, also where each waits for its condition. */
static void read_groups_instead(struct scenario_reading *r, const config_setting_t *root, const char *name,
                                const char *path,
                                void (*read)(struct scenario_reading *r, const config_setting_t *group))
{
    const config_setting_t *list = config_setting_get_member(root, name);
    const size_t before = r->n;
    read_groups(r, root, name, read);
    if (list && r->n == before)
        add_change(r, path, strdup("( )"), config_setting_source_line(list));
}

static void add_when(struct scenario_reading *r, struct scenario_when when)
{
    struct scenario_when *at = reallocarray(r->when, r->n_when + 1, sizeof *at);
    if (!at) {
        lack_memory(r);
        return;
    }
    r->when = at;
    if (config_setting_get_member(when.group, "at"))
        settings_fail(&r->s, when.group, "it has both \"at\" and \"when\": one of them says when it happens");
    r->when[r->n_when++] = when;
}

static void read_scenario_action(struct scenario_reading *r, const config_setting_t *group)
{
    if (has_when(group))
        add_when(r, (struct scenario_when){.group = group, .what = TRIGGER_ACTION});
    else
        grow_list(r, "actions", group, NULL);
}

static void read_scenario_disturbance(struct scenario_reading *r, const config_setting_t *group)
{
    if (has_when(group))
        add_when(r, (struct scenario_when){.group = group, .what = TRIGGER_DISTURBANCE});
    else
        grow_list(r, "plant.disturbances", group, NULL);
}

static void put_fault_path(const struct experiment *e, const struct scenario_when *when, char *path,
                           size_t size)
{
    const bool y = when->what == TRIGGER_SENSOR;
    if (when->what == TRIGGER_PLANT)
        snprintf(path, size, "plant.faults");
    else
        snprintf(path, size, "%s.%s.faults", y ? "measurements" : "outputs",
                 y ? e->y[when->signal].tag.name : e->u[when->signal].tag.name);
}

static size_t count_changes(const struct scenario_reading *r, const char *path)
{
    size_t n = 0;
    for (size_t i = 0; i < r->n; i++)
        n += !strcmp(r->change[i].path, path);
    return n;
}

/* @kind NULL: the list has all that the group has. */
static void add_scenario_fault(struct scenario_reading *r, struct scenario_when when, const char *kind)
{
    char path[APC_TAG_LEN + 32];
    put_fault_path(&r->of->e, &when, path, sizeof path);
    when.fault = count_changes(r, path);
    grow_list(r, path, when.group, kind);
    if (has_when(when.group) && !r->s.failed)
        add_when(r, when);
}

static void refuse_scenario_fault(struct scenario_reading *r, const config_setting_t *group,
                                  const char *signal)
{
    const struct experiment *e = &r->of->e;
    struct nearest nearest = {.wanted = signal};
    for (size_t i = 0; experiment_fault(e, i).kind; i++)
        nearest_look(&nearest, experiment_fault(e, i).signal);
    settings_fail(&r->s, group,
                  "there is no measurement, output, controller, disturbance or parameter \"%s\"%s%s%s",
                  signal, nearest.name ? ": did you mean \"" : "", nearest.name ? nearest.name : "",
                  nearest.name ? "\"?" : "");
}

/* The power of the plant is that of all its sensors and actuators. */
static void read_scenario_fault(struct scenario_reading *r, const config_setting_t *group)
{
    const struct experiment *e = &r->of->e;
    char name[EXPERIMENT_NAME] = "", kind[16] = "";
    settings_text(&r->s, group, "signal", REQUIRED, name, sizeof name);
    settings_text(&r->s, group, "kind", REQUIRED, kind, sizeof kind);
    const bool power = !strcmp(name, "plant") && !strcmp(kind, "power");
    bool found = r->s.failed;
    for (size_t i = 0; i < e->dim.ny + e->dim.nu && (!found || power); i++) {
        const bool y = i < e->dim.ny;
        const struct scenario_when when = {
            .group = group, .what = y ? TRIGGER_SENSOR : TRIGGER_ACTUATOR, .signal = y ? i : i - e->dim.ny};
        if (power || !strcmp(y ? e->y[i].tag.name : e->u[i - e->dim.ny].tag.name, name)) {
            add_scenario_fault(r, when, power && y ? "dropout" : kind);
            found = true;
        }
    }
    if (!found && experiment_find_plant_fault(e, name, NULL) < e->plant.n_faults)
        add_scenario_fault(r, (struct scenario_when){.group = group, .what = TRIGGER_PLANT}, NULL);
    else if (!found)
        refuse_scenario_fault(r, group, name);
}

/* ---- Texts ---------------------------------------------------------------------------------- */

/* Text number @p i of a list or array. */
static const char *text_in(struct scenario_reading *r, const config_setting_t *list, int i)
{
    const config_setting_t *at = config_setting_get_elem(list, (unsigned)i);
    const char *text = config_setting_get_string(at);
    if (!text)
        settings_fail(&r->s, at, "\"%s\" must be texts: %s = ( \"...\", \"...\" );",
                      config_setting_name(list), config_setting_name(list));
    return text;
}

/* A list of texts; NULL: there is none. */
static const config_setting_t *texts_of(struct scenario_reading *r, const config_setting_t *root,
                                        const char *name)
{
    const config_setting_t *list = config_setting_get_member(root, name);
    if (list && !config_setting_is_list(list) && !config_setting_is_array(list)) {
        settings_fail(&r->s, list, "\"%s\" must be a list of texts: %s = ( \"...\", \"...\" );", name, name);
        return NULL;
    }
    return list;
}

static void read_scenario_set(struct scenario_reading *r, const config_setting_t *root)
{
    const config_setting_t *list = texts_of(r, root, "set");
    const int n = list ? config_setting_length(list) : 0;
    for (int i = 0; i < n && !r->s.failed; i++) {
        const char *text = text_in(r, list, i), *equals = text ? setting_equals(text) : NULL;
        char path[EXPERIMENT_SETTING];
        if (!text)
            return;
        if (!equals || equals == text || (size_t)(equals - text) >= sizeof path) {
            settings_fail(&r->s, config_setting_get_elem(list, (unsigned)i),
                          "set \"%.80s\": expected \"PATH=VALUE\", as \"controller.Kp=0.5\"", text);
            return;
        }
        snprintf(path, sizeof path, "%.*s", (int)(equals - text), text);
        add_change(r, path, strdup(equals + 1),
                   config_setting_source_line(config_setting_get_elem(list, (unsigned)i)));
    }
}

/* Settings of the experiment's own, in place of what it says. */
static void read_scenario_member(struct scenario_reading *r, const config_setting_t *root, const char *name)
{
    const config_setting_t *member = r->s.failed ? NULL : config_setting_get_member(root, name);
    char *text = NULL;
    if (!member)
        return;
    if (experiment_setting_text(member, &text) < 0)
        text = NULL;
    add_change(r, name, text, config_setting_source_line(member));
}

/* ---- The experiment ------------------------------------------------------------------------- */

/* The experiment with its first @p n changes; who is to blame is told by the last one. */
static int parse_changed_scenario(struct scenario_reading *r, const char *file, const char *text, size_t n,
                                  struct apc_error *why)
{
    char *now = strdup(text), *next, said[EXPERIMENT_PATH + 200];
    const struct scenario_change *last = n > 0 ? &r->change[n - 1] : NULL;
    struct apc_error of_change;
    struct record record = r->record;
    int rc = now ? 0 : apc_fail(why, APC_ENOMEM, "out of memory");

    if (last && last->line)
        snprintf(said, sizeof said, "%s:%u", r->s.file, last->line);
    else if (last)
        snprintf(said, sizeof said, "%s: --set %.100s=%.80s", r->s.file, last->path, last->value);
    for (size_t i = 0; last && i < n && rc == 0; i++) {
        rc = experiment_change(now, r->change[i].path, r->change[i].value, &next, &of_change);
        if (rc < 0)
            apc_fail(why, rc, "%s: %s", said, of_change.text);
        else {
            experiment_forget(&record, r->change[i].path);
            free(now);
            now = next;
        }
    }
    if (rc == 0)
        rc = experiment_parse(&r->of->e,
                              &(struct experiment_source){
                                  .file = file, .text = now, .change = last ? said : NULL, .record = &record},
                              EXPERIMENT_MODEL | EXPERIMENT_LAW, NULL, why);
    free(now);
    return rc;
}

static int change_experiment(struct scenario_reading *r, struct apc_error *why)
{
    char file[EXPERIMENT_PATH], *text = strdup(r->of->e.text);
    snprintf(file, sizeof file, "%s", r->of->e.file);
    experiment_free(&r->of->e);
    int rc =
        text ? parse_changed_scenario(r, file, text, r->n, why) : apc_fail(why, APC_ENOMEM, "out of memory");
    for (size_t n = 1; rc < 0 && text && n < r->n; n++) {
        const int one = parse_changed_scenario(r, file, text, n, why);
        experiment_free(&r->of->e);
        if (one < 0)
            break;
        if (n + 1 == r->n)
            (void)parse_changed_scenario(r, file, text, r->n, why);
    }
    free(text);
    return rc;
}

/* A path in a scenario means: from where the scenario is. */
static void resolve_experiment(struct scenario_reading *r, const config_setting_t *at, const char *name,
                               char path[EXPERIMENT_PATH])
{
    const char *scenario = r->s.file, *slash = *name == '/' ? NULL : strrchr(scenario, '/');
    const int n =
        snprintf(path, EXPERIMENT_PATH, "%.*s%s", slash ? (int)(slash - scenario) + 1 : 0, scenario, name);
    if (n < 0 || n >= EXPERIMENT_PATH)
        r->s.failed =
            apc_fail(r->s.why, APC_EINVAL,
                     "the path of experiment \"%.60s\" is longer than %d bytes: go to the scenario's folder",
                     name, EXPERIMENT_PATH - 1);
    else if (access(path, F_OK) < 0 && errno == ENOENT)
        settings_fail(&r->s, at,
                      "there is no experiment %s: \"experiment\" is its path from the scenario's folder",
                      path);
}

/* ---- Conditions ----------------------------------------------------------------------------- */

/* Each fault of its signal was a change of its own, unless a setting has others. */
static void find_triggered_fault(struct scenario_reading *r, const struct scenario_when *when,
                                 struct scenario_trigger *trigger)
{
    const struct experiment *e = &r->of->e;
    const size_t n = when->what == TRIGGER_PLANT ? e->plant.n_timed
                     : when->what == TRIGGER_SENSOR
                         ? e->sensor[when->signal].n_faults - EXPERIMENT_SENSOR_KINDS
                         : e->actuator[when->signal].n_faults - EXPERIMENT_ACTUATOR_KINDS;
    const char *signal = "", *kind = "";
    char path[APC_TAG_LEN + 32];
    (void)config_setting_lookup_string(when->group, "signal", &signal);
    (void)config_setting_lookup_string(when->group, "kind", &kind);
    put_fault_path(e, when, path, sizeof path);
    if (n == 0 || n != count_changes(r, path))
        settings_fail(&r->s, when->group, "a setting of %s is in the way of a fault with a condition", path);
    else if (when->what == TRIGGER_PLANT)
        trigger->fault = experiment_find_plant_fault(e, signal, kind);
    else
        trigger->fault = when->fault + (size_t)(when->what == TRIGGER_SENSOR
                                                    ? e->sensor[when->signal].fault - e->faults
                                                    : e->actuator[when->signal].fault - e->actuator_faults);
    snprintf(trigger->path, sizeof trigger->path, "%s.[%zu]", path, when->fault);
}

/* How the list at @path has it, once there is a time. */
static void keep_group(struct scenario_reading *r, const struct scenario_when *when, const char *path,
                       struct scenario_trigger *trigger)
{
    size_t size;
    FILE *out = open_memstream(&trigger->text, &size);
    snprintf(trigger->path, sizeof trigger->path, "%s", path);
    if (out)
        put_experiment_members(out, when->group, NULL);
    if (!out || fclose(out) != 0)
        lack_memory(r);
}

/* What it is called among the expectations. */
static void name_when(const struct scenario_when *when, const struct scenario_trigger *trigger,
                      const char *condition, char *text, size_t size)
{
    static const char *const own[] = {"when", "after", "value", "at", NULL};
    const char *what = "", *name = "";
    char later[40] = "";
    if (trigger->after > 0)
        snprintf(later, sizeof later, "%.10g s after ", apc_ns_to_s(trigger->after));
    (void)config_setting_lookup_string(when->group, "kind", &what);
    (void)config_setting_lookup_string(when->group, "signal", &name);
    if (when->what == TRIGGER_DISTURBANCE && config_setting_lookup_string(when->group, "name", &name))
        what = "disturbance";
    for (int i = 0; when->what == TRIGGER_ACTION && i < config_setting_length(when->group); i++) {
        const config_setting_t *member = config_setting_get_elem(when->group, (unsigned)i);
        size_t k = 0;
        while (own[k] && strcmp(own[k], config_setting_name(member)) != 0)
            k++;
        if (!own[k]) {
            what = config_setting_name(member);
            name = config_setting_get_string(member);
        }
    }
    snprintf(text, size, "%s %s %s%s", what, name ? name : "", *later ? later : "when ", condition);
}

static void read_trigger(struct scenario_reading *r, const struct scenario_when *when)
{
    struct scenario *of = r->of;
    struct scenario_trigger *trigger = &of->trigger[of->n_triggers];
    const config_setting_t *member = config_setting_get_member(when->group, "when");
    char condition[CHECK_TEXT] = "", text[2 * CHECK_TEXT];
    struct apc_error why;
    double after = 0;
    *trigger = (struct scenario_trigger){.expectation = of->n_expect, .what = when->what};
    settings_text(&r->s, when->group, "when", REQUIRED, condition, sizeof condition);
    settings_number(&r->s, when->group, "after", OPTIONAL, 0, of->e.duration, &after);
    (void)apc_ns_from_s(after, &trigger->after);
    if (when->what == TRIGGER_ACTION) {
        experiment_read_action(&r->s, when->group, &of->e, &trigger->action);
        keep_group(r, when, "actions", trigger);
    } else if (when->what == TRIGGER_DISTURBANCE) {
        experiment_read_disturbance(&r->s, when->group, &of->e, &trigger->disturbance);
        keep_group(r, when, "plant.disturbances", trigger);
    } else {
        find_triggered_fault(r, when, trigger);
    }
    of->n_triggers++;
    if (of->n_triggers > 1 && when[-1].group == when->group) /* the power of the plant happens once */
        trigger->expectation = trigger[-1].expectation;
    if (r->s.failed || trigger->expectation < of->n_expect)
        return;
    name_when(when, trigger, condition, text, sizeof text);
    if (check_parse_when(&of->expect[of->n_expect], text, condition, &of->e, &of->sources, &why) < 0)
        settings_fail(&r->s, member, "%s", why.text);
    of->n_expect++;
}

/* ---- The file ------------------------------------------------------------------------------- */

static void read_expectations(struct scenario_reading *r, const config_setting_t *root)
{
    struct scenario *of = r->of;
    const config_setting_t *list = texts_of(r, root, "expect");
    struct apc_error why;
    const int n = list ? config_setting_length(list) : 0;
    if (n == 0)
        settings_fail(
            &r->s, list ? list : root,
            "\"expect\" is missing: the expectations of the run, as expect = ( \"never y < 20\" );");
    of->expect = calloc((size_t)n + r->n_when + 1, sizeof *of->expect);
    of->trigger = calloc(r->n_when + 1, sizeof *of->trigger);
    if (!of->expect || !of->trigger)
        lack_memory(r);
    for (int i = 0; i < n && !r->s.failed; i++) {
        const char *text = text_in(r, list, i);
        struct expectation *x = &of->expect[of->n_expect++];
        if (text && check_parse(x, text, &of->e, &of->sources, &why) < 0)
            settings_fail(&r->s, config_setting_get_elem(list, (unsigned)i), "%s", why.text);
    }
    for (size_t i = 0; i < r->n_when && !r->s.failed; i++)
        read_trigger(r, &r->when[i]);
}

static void read_runs(struct scenario_reading *r, const config_setting_t *root)
{
    struct scenario *of = r->of;
    int64_t runs = 1, seed = (int64_t)of->e.seed;
    settings_whole(&r->s, root, "runs", OPTIONAL, 1, 1000000, &runs);
    settings_whole(&r->s, root, "seed", OPTIONAL, 0, INT64_C(1) << 53, &seed);
    of->share = 1;
    settings_number(&r->s, root, "share", OPTIONAL, 0.01, 1, &of->share);
    of->runs = (unsigned)runs;
    of->seed = (uint64_t)seed;
}

/* It is judged as it was. */
static void check_session(struct scenario_reading *r, const config_setting_t *root)
{
    static const char *const other[] = {"set",          "duration", "network", "clock", "faults",
                                        "disturbances", "runs",     "seed",    "share", NULL};
    const struct experiment *e = &r->of->e;
    char dir[EXPERIMENT_PATH], samples[EXPERIMENT_PATH + 16];
    (void)experiment_run_dir(e, dir);
    snprintf(samples, sizeof samples, "%s/samples.csv", dir);
    for (size_t i = 0; other[i]; i++)
        if (config_setting_get_member(root, other[i]))
            settings_fail(&r->s, config_setting_get_member(root, other[i]),
                          "\"%s\" would make another run of session %s, which is judged as it was: put it "
                          "into the experiment before people operate it",
                          other[i], dir);
    if (!r->s.failed && access(samples, F_OK) != 0)
        r->s.failed = apc_fail(r->s.why, APC_ESTATE,
                               "%s: the session has not ended: there is no samples.csv yet; of one that was "
                               "killed `apc report %s` makes it",
                               dir, dir);
}

/* The instructor's, which are no part of what was done about them. */
static void keep_faults(struct samples *written)
{
    size_t n = 0;
    for (size_t i = 0; i < written->n; i++)
        if (loops_is_fault(&written->at[i]))
            written->at[n++] = written->at[i];
    written->n = n;
}

/* What people wrote, where it is the folder of a run that they operated. */
static void read_session(struct scenario_reading *r, const config_setting_t *root)
{
    struct scenario *of = r->of;
    const int rc = simulation_written(&of->e, &of->written, r->s.why);
    of->session = rc > 0;
    if (rc < 0)
        r->s.failed = rc;
    else if (rc > 0)
        check_session(r, root);
    else if (r->session)
        r->s.failed = apc_fail(
            r->s.why, APC_ENOTFOUND,
            "%s: expected the folder of a run of `apc run --speed`, which has " WRITTEN_FILE, r->session);
    if (r->reference)
        keep_faults(&of->written);
}

static void read_scenario_experiment(struct scenario_reading *r, const config_setting_t *root)
{
    struct scenario *of = r->of;
    char name[EXPERIMENT_PATH] = "", path[EXPERIMENT_PATH];
    settings_text(&r->s, root, "experiment", REQUIRED, name, sizeof name);
    if (!r->s.failed && !r->session)
        resolve_experiment(r, config_setting_get_member(root, "experiment"), name, path);
    if (r->s.failed)
        return;
    r->s.failed = experiment_load(&of->e, r->session ? r->session : path, EXPERIMENT_MODEL | EXPERIMENT_LAW,
                                  NULL, r->s.why);
    if (!r->s.failed)
        r->s.failed = record_read(&r->record, of->e.file, r->s.why);
    if (!r->s.failed)
        read_session(r, root);
}

static void read_scenario(struct scenario_reading *r, const config_setting_t *root,
                          const struct experiment_setting *set, size_t n)
{
    static const char *const known[] = {"experiment", "title",  "set",    "duration", "network",
                                        "clock",      "faults", "runs",   "seed",     "disturbances",
                                        "actions",    "share",  "expect", NULL};
    struct scenario *of = r->of;
    if (config_setting_get_member(root, "measurements"))
        settings_fail(
            &r->s, config_setting_get_member(root, "measurements"),
            "this is an experiment file, not a scenario: apc simulate runs it; a scenario names it by "
            "experiment = \"FILE\"");
    settings_known(&r->s, root, known);
    read_scenario_experiment(r, root);
    if (r->s.failed)
        return;
    snprintf(of->title, sizeof of->title, "%s", of->e.title);
    settings_text(&r->s, root, "title", OPTIONAL, of->title, sizeof of->title);
    read_scenario_member(r, root, "duration");
    read_scenario_member(r, root, "network");
    read_scenario_member(r, root, "clock");
    read_scenario_set(r, root);
    read_groups_instead(r, root, "disturbances", "plant.disturbances", read_scenario_disturbance);
    read_groups(r, root, "faults", read_scenario_fault);
    if (!of->session || r->reference)
        read_groups_instead(r, root, "actions", "actions", read_scenario_action);
    for (size_t i = 0; i < n; i++)
        add_change(r, set[i].path, strdup(set[i].value), 0);
    if (!r->s.failed && r->n > 0)
        r->s.failed = change_experiment(r, r->s.why);
    if (!r->s.failed && !(of->e.duration > 0))
        settings_fail(&r->s, root, "%s has no duration: give the scenario one, as duration = 600.0;",
                      of->e.file);
    if (r->s.failed)
        return;
    read_runs(r, root);
    read_expectations(r, root);
}

static int load_scenario(struct scenario_reading *r, const char *file, const struct experiment_setting *set,
                         size_t n, struct apc_error *why)
{
    config_t config;
    *r->of = (struct scenario){.runs = 1};
    r->s = (struct settings){.file = r->of->file, .why = why};
    snprintf(r->of->file, sizeof r->of->file, "%s", file);
    if (access(file, F_OK) < 0 && errno == ENOENT)
        return apc_fail(why, APC_ENOTFOUND, "%s: No such file or directory: expected a scenario", file);
    r->s.failed = settings_load(&config, file, why);
    if (!r->s.failed)
        read_scenario(r, config_root_setting(&config), set, n);
    config_destroy(&config);
    for (size_t i = 0; i < r->n; i++) {
        free(r->change[i].path);
        free(r->change[i].value);
    }
    free(r->change);
    free(r->when);
    record_free(&r->record);
    return r->s.failed;
}

int scenario_load(struct scenario *scenario, const char *file, const char *session,
                  const struct experiment_setting *set, size_t n, struct apc_error *why)
{
    return load_scenario(&(struct scenario_reading){.of = scenario, .session = session}, file, set, n, why);
}

int scenario_load_reference(struct scenario *reference, const struct scenario *session, struct apc_error *why)
{
    struct scenario_reading r = {.of = reference, .session = session->e.file, .reference = true};
    return load_scenario(&r, session->file, NULL, 0, why);
}

void scenario_free(struct scenario *scenario)
{
    experiment_free(&scenario->e);
    samples_free(&scenario->written);
    free(scenario->expect);
    free(scenario->sources.at);
    for (size_t i = 0; i < scenario->n_triggers; i++)
        free(scenario->trigger[i].text);
    free(scenario->trigger);
    *scenario = (struct scenario){.runs = 0};
}

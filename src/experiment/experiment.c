/* SPDX-License-Identifier: BSD-3-Clause */
#include "experiment_parts.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "experiment.h"
#include "files/files.h"

#define PHASE_MAX_S 3600.0
#define RHYTHM      "period", "phase", "overrun", "execution", "jitter"

/* What phases there are when the file names none: they keep the order scheduler, plant, client,
 * controller where ticks coincide. */
static const double client_phase_s = 0.010, controller_phase_s = 0.030, depth_phase_s = 0.010;

static void *experiment_array(struct settings *s, size_t n, size_t size)
{
    void *p = calloc(n ? n : 1, size);
    if (!p && !s->failed)
        s->failed = apc_fail(s->why, APC_ENOMEM, "%s: out of memory", s->file);
    return p;
}

static void read_overrun(struct settings *s, const config_setting_t *group, enum apc_overrun *overrun)
{
    static const char *const names[] = {
        [APC_OVERRUN_SKIP] = "skip", [APC_OVERRUN_BURST] = "burst", [APC_OVERRUN_STOP] = "stop"};
    char name[16] = "skip";
    settings_text(s, group, "overrun", OPTIONAL, name, sizeof name);
    for (*overrun = APC_OVERRUN_SKIP; *overrun <= APC_OVERRUN_STOP; (*overrun)++)
        if (strcmp(name, names[*overrun]) == 0)
            return;
    settings_fail(s, config_setting_get_member(group, "overrun"),
                  "\"overrun\" must be \"skip\", \"burst\" or \"stop\"");
}

static void read_rhythm(struct settings *s, const config_setting_t *group, const char *task, double phase_s,
                        struct rhythm *rhythm, struct recordings *recordings)
{
    settings_period(s, group, "period", REQUIRED, &rhythm->period);
    settings_number(s, group, "phase", OPTIONAL, 0, PHASE_MAX_S, &phase_s);
    const config_setting_t *phase = config_setting_get_member(group, "phase");
    if (!s->failed && phase && phase_s >= apc_ns_to_s(rhythm->period))
        settings_fail(s, phase, "\"phase\" is %.15g: must be below the period, which is %.15g", phase_s,
                      apc_ns_to_s(rhythm->period));
    if (!s->failed)
        apc_ns_from_s(phase_s, &rhythm->phase);
    read_overrun(s, group, &rhythm->overrun);
    models_read_task(s, group, task, &rhythm->model, recordings);
}

/* tcp:HOST:PORT, tls:HOST:PORT, modbus:HOST:PORT or serial:PATH; more is said when it is used. */
static void read_address(struct settings *s, const config_setting_t *group, const char *name, long least,
                         char *value, size_t size)
{
    settings_text(s, group, name, OPTIONAL, value, size);
    const char *colon = strrchr(value, ':');
    size_t digits = colon ? strspn(colon + 1, "0123456789") : 0;
    long port = digits > 0 && digits < 6 && !colon[1 + digits] ? strtol(colon + 1, NULL, 10) : -1;
    const bool modbus = !strncmp(value, "modbus:", 7), serial = !strncmp(value, "serial:", 7);
    const char *rest = value + (modbus || serial ? 7 : 4);
    const bool link = !strncmp(value, "tcp:", 4) || experiment_is_tls(value);
    const bool host = (modbus || link) && *rest != '/' && colon > rest;
    if (!s->failed && (serial ? !*rest : !host || port < least || port > 65535))
        settings_fail(s, config_setting_get_member(group, name),
                      "\"%s\" is \"%s\": must be tcp:HOST:PORT, such as \"tcp:127.0.0.1:%d\", or "
                      "tls:HOST:PORT, or modbus:HOST:PORT, or serial:PATH",
                      name, value, APC_PORT);
}

/* Text is a distribution, the value its mean, unless it is a word of the model's. */
static bool read_spread(struct settings *s, const config_setting_t *member, const struct apc_model *model,
                        const struct apc_param *param, double *value, struct apc_distribution *spread)
{
    const char *text = config_setting_get_string(member);
    struct apc_error why;
    double word;

    if (!text)
        return false;
    const int rc = apc_model_word(model, param, text, &word, &why);
    if (rc == APC_ENOTFOUND || (rc == 0 && apc_number_parse(text, &word) < 0))
        return false;
    if (apc_distribution_parse(text, spread, &why) < 0)
        settings_fail(s, member, "\"%s\": %s", param->name, why.text);
    *value = s->failed ? *value : apc_distribution_mean(spread);
    if (!(*value >= param->low && *value <= param->high))
        settings_fail(s, member, "\"%s\" has a mean of %.15g: must be from %.15g to %.15g", param->name,
                      *value, param->low, param->high);
    return true;
}

/* Whose parameters they are: a model's, or a law's (model NULL). */
struct owner {
    const char *name;
    const struct apc_param *param;
    size_t n;
    const struct apc_model *model;
};

static struct owner owner_of_model(const struct apc_model *m)
{
    return (struct owner){m->name, m->param, m->np, m};
}

/* A number; true or false, or a label, of a model that has such. */
static void read_model_value(struct settings *s, const config_setting_t *member,
                             const struct apc_model *model, const struct apc_param *param, double *value)
{
    const char *text = config_setting_type(member) == CONFIG_TYPE_BOOL
                           ? (config_setting_get_bool(member) ? "true" : "false")
                           : config_setting_get_string(member);
    double own = *value;
    struct apc_error why;
    int rc = 0;

    if (text)
        rc = apc_model_word(model, param, text, &own, &why);
    else
        settings_number_at(s, member, param->name, -APC_VALUE_MAX, APC_VALUE_MAX, &own);
    if (!text && !s->failed)
        rc = apc_model_takes(model, param, own, &why);
    if (rc < 0)
        settings_fail(s, member, "%s", why.text);
    else if (!s->failed)
        *value = own;
}

/* One that is none of the numbers: a text, or a mistake. */
static void read_model_text(struct settings *s, const config_setting_t *member, const struct owner *owner,
                            const char *name, struct nearest *nearest)
{
    size_t n = 0;
    struct apc_error why;
    const struct apc_param *texts = owner->model ? apc_model_texts(owner->model, &n) : NULL;
    const int rc = owner->model
                       ? apc_model_set_text(owner->model, name, config_setting_get_string(member), &why)
                       : APC_ENOTFOUND;

    for (size_t k = 0; k < n; k++)
        nearest_look(nearest, texts[k].name);
    if (rc < 0 && rc != APC_ENOTFOUND)
        settings_fail(s, member, "%s", why.text);
    else if (rc < 0 && (nearest->name || owner->n + n == 0))
        settings_fail(s, member, "%s has no parameter \"%s\"%s%s%s", owner->name, name,
                      nearest->name ? ": did you mean \"" : "; it has none at all",
                      nearest->name ? nearest->name : "", nearest->name ? "\"?" : "");
    else if (rc < 0)
        settings_fail(s, member, "%s has no parameter \"%s\"; `apc %s %s` shows its parameters", owner->name,
                      name, owner->model ? "plants" : "laws", owner->name);
}

/* Names of a group of parameters are those of the law or the model; absent ones keep their initial value.
 * @spread NULL: all are plain numbers. */
static void read_params(struct settings *s, const config_setting_t *group, struct owner owner, double *values,
                        struct apc_distribution *spread)
{
    for (int i = 0; group && i < config_setting_length(group) && !s->failed; i++) {
        const char *name;
        const config_setting_t *member = settings_value(s, group, i, &name);
        struct nearest nearest = {.wanted = name};
        size_t j = 0;
        if (!member)
            return;
        for (; j < owner.n && strcmp(owner.param[j].name, name) != 0; j++)
            nearest_look(&nearest, owner.param[j].name);
        const struct apc_param *param = j < owner.n ? &owner.param[j] : NULL;
        if (!param)
            read_model_text(s, member, &owner, name, &nearest);
        else if (!owner.model)
            settings_number_at(s, member, name, param->low, param->high, &values[j]);
        else if (!spread || !read_spread(s, member, owner.model, param, &values[j], &spread[j]))
            read_model_value(s, member, owner.model, param, &values[j]);
    }
}

void experiment_read_believed(struct settings *s, const config_setting_t *group, const struct experiment *e,
                              struct controller *c)
{
    const struct apc_model *m = e->plant.model;
    c->believed = experiment_array(s, m->np, sizeof *c->believed);
    for (size_t i = 0; c->believed && i < m->np; i++)
        c->believed[i] = e->plant.p[i];
    read_params(s, settings_values(s, group, "parameters"), owner_of_model(m), c->believed, NULL);
}

void experiment_resolve(const struct settings *s, const char *name, char *path, size_t size)
{
    const char *slash = strrchr(s->file, '/');
    if (name[0] != '/' && slash)
        snprintf(path, size, "%.*s/%s", (int)(slash - s->file), s->file, name);
    else
        snprintf(path, size, "%s", name);
}

static int take_error(struct settings *s, const config_setting_t *at, int err, const struct apc_error *why)
{
    if (err < 0)
        settings_fail(s, at, "%s", why->text);
    return s->failed;
}

bool is_fmu(const char *name)
{
    const size_t n = strlen(name);
    return (n > 4 && !strcmp(name + n - 4, ".fmu")) || (n > 3 && !strcmp(name + n - 3, ".py"));
}

/*
 * Which plug-in: what the command line names, else what the run's record does, else the file, where a path
 * means: from where the file is. What was chosen instead of the file's brings its own tuning or parameters.
 */
static void choose_plugin(const struct settings *s, const char *name, const char *override,
                          const struct record_plugin *recorded, struct plugin *plugin)
{
    if (override)
        snprintf(plugin->name, sizeof plugin->name, "%s", override);
    else if (recorded->name[0])
        snprintf(plugin->name, sizeof plugin->name, "%s", recorded->name);
    else if (strchr(name, '/') || is_fmu(name))
        experiment_resolve(s, name, plugin->name, sizeof plugin->name);
    else
        snprintf(plugin->name, sizeof plugin->name, "%s", name);
    if (is_fmu(plugin->name) && !strchr(plugin->name, '/')) { /* a file, not a name of ours */
        char beside[sizeof plugin->name];
        snprintf(beside, sizeof beside, "./%.500s", plugin->name);
        memcpy(plugin->name, beside, sizeof beside);
    }
    plugin->chosen = override || recorded->chosen;
}

/* What was named on the command line is no mistake of the file. */
static int take_choice(struct settings *s, const config_setting_t *group, const char *name,
                       const char *override, int err, const struct apc_error *why)
{
    if (err < 0 && override)
        s->failed = apc_fail(s->why, err, "--%s: %s", strcmp(name, "law") ? "plant" : "law", why->text);
    return override ? s->failed : take_error(s, config_setting_get_member(group, name), err, why);
}

static void read_plant_model(struct settings *s, const config_setting_t *group, struct experiment *e,
                             const char *override, const struct record *record)
{
    struct apc_error why;
    if (s->failed)
        return;
    choose_plugin(s, e->plant.name, override, &record->model, &e->plant.plugin);
    const bool chosen = e->plant.plugin.chosen;
    if (take_choice(s, group, "model", override,
                    apc_model_find(e->plant.plugin.name, &e->plant.model, &e->model_handle, &why), &why))
        return;
    const struct apc_model *model = e->plant.model;
    if (is_fmu(e->plant.plugin.name))
        experiment_choose_variables(s, group, e);
    if (s->failed)
        return;
    if (model->ny != e->dim.ny || model->nu != e->dim.nu) {
        settings_fail(
            s, group,
            "model %s has outputs: %zu, inputs: %zu; the file names measurements: %zu, outputs: %zu",
            model->name, model->ny, model->nu, e->dim.ny, e->dim.nu);
        return;
    }
    e->plant.p = experiment_array(s, model->np, sizeof *e->plant.p);
    e->plant.spread = experiment_array(s, model->np, sizeof *e->plant.spread);
    for (size_t i = 0; i < model->np && e->plant.p; i++)
        e->plant.p[i] = model->param[i].initial;
    if (!chosen && !s->failed)
        read_params(s, settings_values(s, group, "parameters"), owner_of_model(model), e->plant.p,
                    e->plant.spread);
    const config_setting_t *x0 = config_setting_get_member(group, "x0");
    if (x0 && !chosen && (e->plant.x0 = experiment_array(s, model->nx, sizeof *e->plant.x0)))
        settings_numbers(s, x0, model->nx, e->plant.x0);
    experiment_read_dynamics(s, group, e, chosen);
}

/* A plant of ours speaks what its client speaks, and without a word where it asks. */
static void check_language(struct settings *s, const config_setting_t *group, struct experiment *e)
{
    const config_setting_t *listen = config_setting_get_member(group, "listen");
    const size_t scheme = strcspn(e->client.link, ":") + 1;
    if (!listen && strncmp(e->client.link, "tcp:", 4) != 0)
        memcpy(e->plant.listen, e->client.link, sizeof e->plant.listen);
    else if (!s->failed && strncmp(e->plant.listen, e->client.link, scheme) != 0)
        settings_fail(s, listen,
                      "\"listen\" is \"%s\" and \"link\" of the client \"%s\": both must begin alike, with "
                      "one protocol",
                      e->plant.listen, e->client.link);
}

/* Behind a serial port is a temperature control lab. */
static void check_lab(struct settings *s, const config_setting_t *group, const struct experiment *e)
{
    const config_setting_t *link = config_setting_get_member(group, "link");
    if (s->failed || strncmp(e->client.link, "serial:", 7) != 0)
        return;
    if (e->dim.nu > 2 || e->dim.ny > 2)
        settings_fail(s, link,
                      "a serial port connects a temperature control lab: it has two heaters and two sensors, "
                      "the file names more");
    for (size_t i = 0; i < e->dim.nu && !s->failed; i++)
        if (!(e->u[i].tag.low >= 0 && e->u[i].tag.high <= 100))
            settings_fail(s, link,
                          "output \"%s\" has the limits %.15g to %.15g: a heater of a temperature control "
                          "lab takes 0 to 100 %%; give it \"low\" and \"high\" within",
                          e->u[i].tag.name, e->u[i].tag.low, e->u[i].tag.high);
}

static void read_plant(struct settings *s, const config_setting_t *root, struct experiment *e,
                       bool resolve_model, bool wanted, const char *override, const struct record *record)
{
    static const char *const known[] = {"model",     "parameters", "x0",           "listen", "integrator",
                                        "rtol",      "atol",       "steps",        "inputs", "outputs",
                                        "dead_time", "noise",      "disturbances", "faults", "external",
                                        "identity",  "clients",    RHYTHM,         NULL};
    const config_setting_t *group = settings_group(s, root, "plant", REQUIRED);
    if (!group)
        return;
    settings_known(s, group, known);
    settings_flag(s, group, "external", &e->plant.external);
    const bool external = e->plant.external;
    if (external && !config_setting_get_member(group, "period"))
        e->plant.rhythm.period = e->client.rhythm.period;
    else
        read_rhythm(s, group, "plant", 0, &e->plant.rhythm, &e->models.recordings);
    settings_text(s, group, "model", external ? OPTIONAL : REQUIRED, e->plant.name, sizeof e->plant.name);
    read_address(s, group, "listen", 0, e->plant.listen, sizeof e->plant.listen);
    if (!external)
        check_language(s, group, e);
    experiment_read_identity(s, group, e->plant.listen, e->plant.identity);
    experiment_read_clients(s, group, e);
    if (external && config_setting_get_member(group, "listen"))
        settings_fail(s, config_setting_get_member(group, "listen"),
                      "an external plant has no \"listen\": its address is \"link\" of the client");
    if (resolve_model && (e->plant.name[0] || override))
        read_plant_model(s, group, e, override, record);
    else if (wanted && !e->plant.name[0])
        settings_fail(s, group, "\"operating_point\" of the controller wants a \"model\" of the plant");
}

static void read_client(struct settings *s, const config_setting_t *root, struct experiment *e)
{
    static const char *const known[] = {"link", "modbus", "identity", RHYTHM, NULL};
    const config_setting_t *group = settings_group(s, root, "client", REQUIRED);
    if (!group)
        return;
    settings_known(s, group, known);
    read_rhythm(s, group, "client", client_phase_s, &e->client.rhythm, &e->models.recordings);
    read_address(s, group, "link", 1, e->client.link, sizeof e->client.link);
    experiment_read_modbus(s, group, e);
    experiment_read_identity(s, group, e->client.link, e->client.identity);
    check_lab(s, group, e);
}

/* Parameters of outputs, and of the law, belong in one list, those of measurements in another. */
static void check_scopes(struct settings *s, const config_setting_t *group, const struct apc_law *law,
                         bool measured)
{
    for (int i = 0; group && i < config_setting_length(group) && !s->failed; i++) {
        const config_setting_t *member = config_setting_get_elem(group, (unsigned)i);
        size_t j = 0;

        while (j < law->n_tuning && strcmp(law->tuning[j].name, config_setting_name(member)) != 0)
            j++;
        if (j < law->n_tuning && measured != (law->scope && law->scope[j] == APC_OF_MEASUREMENT))
            settings_fail(s, member, "%s is of %s: it belongs in \"%s\"", law->tuning[j].name,
                          measured ? "an output" : "a measurement",
                          measured ? "tuning" : "measurement_tuning");
    }
}

/* One group for each output or measurement; what is of the law stands in the first. */
static void read_tuning_list(struct settings *s, const config_setting_t *group, const char *name, size_t n,
                             struct controller *c, double *values, bool measured)
{
    const struct apc_law *law = c->law;
    const config_setting_t *list = settings_list(s, group, name, OPTIONAL);

    if (list && config_setting_length(list) != (int)n)
        settings_fail(s, list, "\"%s\" must have one group for each of the %zu %s", name, n,
                      measured ? "measurements" : "outputs");
    for (size_t i = 0; list && i < n && !s->failed; i++) {
        const config_setting_t *one = config_setting_get_elem(list, (unsigned)i);

        for (size_t j = 0; j < law->n_tuning; j++)
            values[j] = law->tuning[j].initial;
        if (!config_setting_is_group(one))
            settings_fail(s, one, "expected a group: { Kp = 1.0; ... }");
        check_scopes(s, one, law, measured);
        read_params(s, one, (struct owner){law->name, law->tuning, law->n_tuning, NULL}, values, NULL);
        for (size_t k = 0; k < apc_law_parameters(law, &c->dim); k++) {
            const struct apc_law_parameter at = apc_law_parameter_at(law, &c->dim, k);
            if (at.of == i && measured == (at.scope == APC_OF_MEASUREMENT))
                c->tuning[k] = values[at.number];
        }
    }
}

static void read_tuning_group(struct settings *s, const config_setting_t *group, struct controller *c,
                              bool override)
{
    const struct apc_law *law = c->law;
    const size_t n = apc_law_parameters(law, &c->dim);
    double *values = experiment_array(s, law->n_tuning, sizeof *values);

    c->tuning = experiment_array(s, n, sizeof *c->tuning);
    for (size_t k = 0; c->tuning && k < n; k++)
        c->tuning[k] = law->tuning[apc_law_parameter_at(law, &c->dim, k).number].initial;
    if (!s->failed && !override) {
        read_tuning_list(s, group, "tuning", c->dim.nu, c, values, false);
        read_tuning_list(s, group, "measurement_tuning", c->dim.ny, c, values, true);
    }
    free(values);
}

static void read_law(struct settings *s, const config_setting_t *group, struct controller *c, size_t place,
                     const char *override, const struct record *record)
{
    struct apc_error why;
    if (s->failed)
        return;
    static const struct record_plugin none = {.name = ""};
    choose_plugin(s, c->law_name, override, place < record->n_laws ? &record->law[place] : &none, &c->plugin);
    if (take_choice(s, group, "law", override, apc_law_find(c->plugin.name, &c->law, &c->law_handle, &why),
                    &why))
        return;
    if (c->law->accepts && !c->law->accepts(&c->dim))
        settings_fail(s, group, "law %s does not work with measurements: %zu, setpoints: %zu, outputs: %zu",
                      c->law->name, c->dim.ny, c->dim.nz, c->dim.nu);
    else {
        if (!c->plugin.chosen)
            experiment_rename(s, group, c);
        read_tuning_group(s, group, c, c->plugin.chosen);
    }
}

#define CONTROLLER                                                                                           \
    "law", "tuning", "measurement_tuning", "mode", "hold", "budget", "shed_after", "standby", "backup",      \
        "rate", "settings", "model", "operating_point", "limits", "alarms", "second_person", RHYTHM

static const char *const short_settings[] = {CONTROLLER, NULL};
static const char *const controller_settings[] = {CONTROLLER,  "name",    "shadow",       "measurements",
                                                  "setpoints", "outputs", "disturbances", NULL};

bool experiment_knows_of_controller(const char *name)
{
    const char *const *known = controller_settings;
    const size_t n = strcspn(name, ".");
    while (*known && (strncmp(*known, name, n) != 0 || (*known)[n]))
        known++;
    return *known;
}

static bool any_is_below(const struct experiment *e, const struct controller *c)
{
    for (size_t k = 0; k < c->dim.nz; k++)
        if (controllers_above(e, c->z[k]).of)
            return true;
    return false;
}

static enum apc_mode read_initial_mode(struct settings *s, const config_setting_t *group,
                                       const struct experiment *e, const struct controller *c)
{
    static const enum apc_mode modes[] = {APC_MODE_OOS, APC_MODE_MAN, APC_MODE_AUTO, APC_MODE_CAS};
    const size_t n = any_is_below(e, c) ? 4 : 3;
    char mode[16] = "Auto";
    settings_text(s, group, "mode", OPTIONAL, mode, sizeof mode);
    for (size_t i = 0; i < n; i++)
        if (!strcmp(mode, apc_mode_name((int)modes[i])))
            return modes[i];
    settings_fail(s, config_setting_get_member(group, "mode"),
                  "\"mode\" must be \"Auto\"%s, \"Man\" or \"OOS\"%s", n == 4 ? ", \"Cas\"" : "",
                  strcmp(mode, "Cas") ? "" : ": no controller moves its setpoints");
    return APC_MODE_OOS;
}

/* What --law says of one controller: of several it names whose, "base=./my.so". NULL: nothing. */
static const char *law_for(const struct experiment *e, const struct controller *c, const char *law)
{
    const size_t n = strlen(c->name);
    if (law && !strncmp(law, c->name, n) && law[n] == '=')
        return law + n + 1;
    return e->n_controllers == 1 ? law : NULL;
}

static void check_law(struct settings *s, const struct experiment *e, const char *law)
{
    char names[300] = "";
    size_t used = 0;
    bool found = !law;
    for (size_t i = 0; i < e->n_controllers; i++) {
        found = found || law_for(e, &e->controllers[i], law);
        if (used < sizeof names)
            used += (size_t)snprintf(names + used, sizeof names - used, "%s%s", i ? ", " : "",
                                     e->controllers[i].name);
    }
    if (!found && !s->failed)
        s->failed =
            apc_fail(s->why, APC_EINVAL,
                     "--law %s: there are several controllers: say whose law it is, as in --law %s=%s (%s)",
                     law, e->controllers->name, strchr(law, '=') ? strchr(law, '=') + 1 : law, names);
}

/* A controller of the same signals with a law of its own. It must be there when all else is not: a built-in
 * one. */
static void read_backup(struct settings *s, const config_setting_t *of, struct controller *c,
                        bool resolve_law)
{
    static const char *const known[] = {"law", "tuning", "measurement_tuning", "settings", "limits", NULL};
    static const struct record none = {.there = false};
    const config_setting_t *group = settings_group(s, of, "backup", OPTIONAL);
    bool any = false;
    if (!group)
        return;
    for (size_t k = 0; k < c->dim.nu; k++)
        any = any || c->u[k].table == APC_ACTUATOR;
    if (!any)
        settings_fail(s, group,
                      "\"backup\" is for outputs to the plant; what %s moves are setpoints of loops "
                      "that go on by themselves",
                      c->name);
    settings_known(s, group, known);
    c->backup = experiment_array(s, 1, sizeof *c->backup);
    if (s->failed)
        return;
    *c->backup = (struct controller){
        .dim = c->dim, .y = c->y, .z = c->z, .u = c->u, .d = c->d, .rhythm = c->rhythm, .shadow = c->shadow};
    snprintf(c->backup->name, sizeof c->backup->name, "%s", c->name);
    settings_text(s, group, "law", REQUIRED, c->backup->law_name, sizeof c->backup->law_name);
    if (strchr(c->backup->law_name, '/'))
        settings_fail(s, config_setting_get_member(group, "law"),
                      "\"law\" of a backup must be a built-in one, such as \"pid\"");
    if (resolve_law)
        read_law(s, group, c->backup, SIZE_MAX, NULL, &none);
}

static void read_controller(struct settings *s, const config_setting_t *group, struct experiment *e,
                            struct controller *c, bool resolve_law, const char *override,
                            const struct record *record)
{
    double hold_s, budget_s;
    int64_t shed_after = 0;
    settings_known(s, group, config_setting_name(group) ? short_settings : controller_settings);
    read_rhythm(s, group, c->name, controller_phase_s + c->depth * depth_phase_s, &c->rhythm,
                &e->models.recordings);
    settings_text(s, group, "law", REQUIRED, c->law_name, sizeof c->law_name);
    c->mode = read_initial_mode(s, group, e, c);
    c->rate = experiment_array(s, c->dim.nu, sizeof *c->rate);
    const config_setting_t *rate = config_setting_get_member(group, "rate");
    if (rate && c->rate)
        settings_numbers(s, rate, c->dim.nu, c->rate);
    for (size_t i = 0; i < c->dim.nu && !s->failed; i++)
        if (!(c->rate[i] >= 0 && (!rate || c->rate[i] > 0)))
            settings_fail(s, rate, "\"rate\" must be above 0, in units a second");
    hold_s = 3 * apc_ns_to_s(c->rhythm.period);
    settings_number(s, group, "hold", OPTIONAL, 0, 86400, &hold_s);
    if (!s->failed)
        apc_ns_from_s(hold_s, &c->hold);
    budget_s = apc_ns_to_s(c->rhythm.period) / 2;
    settings_number(s, group, "budget", OPTIONAL, 1e-6, apc_ns_to_s(c->rhythm.period), &budget_s);
    if (!s->failed)
        apc_ns_from_s(budget_s, &c->budget);
    settings_whole(s, group, "shed_after", OPTIONAL, 1, 1000000, &shed_after);
    c->shed_after = (unsigned)shed_after;
    settings_flag(s, group, "standby", &c->standby);
    settings_number(s, group, "second_person", OPTIONAL, 1, 86400, &c->second);
    if (resolve_law)
        read_law(s, group, c, (size_t)(c - e->controllers), override, record);
    read_backup(s, group, c, resolve_law);
}

static void read_scheduler(struct settings *s, const config_setting_t *root, struct experiment *e)
{
    static const char *const known[] = {"sequence", "repeat", "setpoints", RHYTHM, NULL};
    const config_setting_t *group = settings_group(s, root, "scheduler", OPTIONAL);
    const config_setting_t *list = group ? settings_list(s, group, "sequence", REQUIRED) : NULL;
    if (!list)
        return;
    settings_known(s, group, known);
    read_rhythm(s, group, "scheduler", 0, &e->scheduler.rhythm, &e->models.recordings);
    e->scheduler.repeat = true;
    settings_flag(s, group, "repeat", &e->scheduler.repeat);
    e->scheduler.steps = (size_t)config_setting_length(list);
    if (e->scheduler.steps == 0)
        settings_fail(s, list, "\"sequence\" must have at least one step: sequence = ( [10.0], [20.0] );");
    const size_t n = e->scheduler.n = experiment_read_columns(s, group, e, &e->scheduler.z);
    e->scheduler.sequence = experiment_array(s, e->scheduler.steps * n, sizeof(double));
    for (size_t k = 0; k < e->scheduler.steps && !s->failed; k++) {
        const config_setting_t *step = config_setting_get_elem(list, (unsigned)k);
        double *values = e->scheduler.sequence + k * n;
        settings_numbers(s, step, n, values);
        for (size_t i = 0; i < n && !s->failed; i++) {
            const struct apc_tag *tag = &e->z[e->scheduler.z[i].at].tag;
            if (values[i] < tag->low || values[i] > tag->high)
                settings_fail(s, step, "setpoint %s = %.15g lies outside its limits %.15g to %.15g",
                              tag->name, values[i], tag->low, tag->high);
        }
    }
}

static bool is_commanding_plant(const struct controller *c)
{
    for (size_t k = 0; k < c->dim.nu; k++)
        if (c->u[k].table == APC_ACTUATOR)
            return true;
    return false;
}

/* Between two commands the plant would go to its safe value, every time. */
static void check_rhythms(struct settings *s, const config_setting_t *root, const struct experiment *e)
{
    const apc_ns client = e->client.rhythm.period;
    for (size_t i = 0; i < e->n_controllers && !s->failed; i++) {
        const struct controller *c = &e->controllers[i];
        if (is_commanding_plant(c) && client > 3 * c->rhythm.period + 100 * APC_NS_PER_MS)
            settings_fail(
                s, config_setting_get_member(config_setting_get_member(root, "client"), "period"),
                "\"period\" of client is %.15g s, of %s %.15g s: at most 3 of the controller's + 0.1 s, or "
                "the plant would go to its safe value between any two commands",
                apc_ns_to_s(client), c->name, apc_ns_to_s(c->rhythm.period));
    }
}

/* Of controller @p i in the list, or the one group of the short form. */
static const config_setting_t *controller_group_at(const config_setting_t *controllers, size_t i)
{
    return config_setting_is_list(controllers) ? config_setting_get_elem(controllers, (unsigned)i)
                                               : controllers;
}

static void read_controller_laws(struct settings *s, const config_setting_t *group,
                                 const struct experiment *e, struct controller *c)
{
    if (!s->failed)
        experiment_view(s, e, c);
    experiment_read_law(s, group, e, c);
    if (c->backup && !s->failed)
        experiment_read_law(s, config_setting_get_member(group, "backup"), e, c->backup);
}

/* The shared memory of `apc run`. */
static void read_live(struct settings *s, const config_setting_t *root, struct experiment *e)
{
    static const char *const known[] = {"history", "size", NULL};
    const config_setting_t *group = settings_group(s, root, "live", OPTIONAL);
    if (!group)
        return;
    settings_known(s, group, known);
    settings_number(s, group, "history", OPTIONAL, 0, 86400.0, &e->live.history);
    settings_whole(s, group, "size", OPTIONAL, 1, 65536, &e->live.size);
}

static void read_root(struct settings *s, const config_setting_t *root, struct experiment *e, unsigned parts,
                      const struct experiment_overrides *overrides, const struct record *record)
{
    static const char *const known[] = {"name",      "title",   "duration", "seed",    "measurements",
                                        "setpoints", "outputs", "plant",    "client",  "controller",
                                        "scheduler", "network", "clock",    "actions", "controllers",
                                        "signals",   "live",    "alarms",   NULL};
    int64_t seed = 1;
    settings_known(s, root, known);
    settings_name(s, root, e->name, sizeof e->name);
    if (!s->failed && (strchr(e->name, '/') || e->name[0] == '.'))
        settings_fail(s, config_setting_get_member(root, "name"),
                      "\"name\" is \"%s\": must have no / and no dot in front, since a folder gets this name",
                      e->name);
    snprintf(e->title, sizeof e->title, "%s", e->name);
    settings_text(s, root, "title", OPTIONAL, e->title, sizeof e->title);
    settings_number(s, root, "duration", OPTIONAL, 0, 366 * 86400.0, &e->duration);
    settings_whole(s, root, "seed", OPTIONAL, 0, INT64_C(1) << 53, &seed); /* exact as a double, too */
    e->seed = (uint64_t)seed;
    experiment_read_signals(s, root, e);
    read_client(s, root, e);
    const bool laws = (parts & EXPERIMENT_LAW) != 0;
    const config_setting_t *list = experiment_read_controllers(s, root, e);
    const char *law = overrides ? overrides->law : NULL;
    bool wanted = false; /* the model, by a law */
    if (laws)
        check_law(s, e, law);
    for (size_t i = 0; i < e->n_controllers && !s->failed; i++) {
        read_controller(s, controller_group_at(list, i), e, &e->controllers[i], laws,
                        law_for(e, &e->controllers[i], law), record);
        wanted = wanted || experiment_wants_model(controller_group_at(list, i));
    }
    read_plant(s, root, e, (parts & EXPERIMENT_MODEL) || (laws && wanted), wanted,
               overrides ? overrides->model : NULL, record);
    experiment_read_plant_faults(s, root, e);
    read_scheduler(s, root, e);
    check_rhythms(s, root, e);
    for (size_t i = 0; i < e->n_controllers; i++)
        read_controller_laws(s, s->failed ? NULL : controller_group_at(list, i), e, &e->controllers[i]);
    experiment_number(s, list, e, laws);
    read_live(s, root, e);
    models_read(s, root, &e->models);
    experiment_read_alarms(s, root, e);
    experiment_read_actions(s, root, e);
}

/* What was in force beside the file: see struct record. */
static int take_recorded_settings(struct experiment *e, const struct record *record, struct apc_error *why)
{
    if (!record->there)
        return 0;
    if (!isnan(record->duration))
        e->duration = record->duration;
    if (!record->file_seed)
        e->seed = record->seed;
    e->start = record->start;
    e->past = record->past;
    if (e->past > 0 && experiment_run_dir(e, e->past_dir))
        snprintf(e->past_dir + strlen(e->past_dir), sizeof e->past_dir - strlen(e->past_dir),
                 "/" PAST_FOLDER);
    snprintf(e->net, sizeof e->net, "%s", record->net);
    return models_network(&e->models, e->net, why);
}

int experiment_parse(struct experiment *e, const struct experiment_source *from, unsigned parts,
                     const struct experiment_overrides *overrides, struct apc_error *why)
{
    static const struct record none = {.there = false};
    const struct record *record = from->record ? from->record : &none;
    struct settings s = {.file = e->file, .change = from->change, .why = why};
    config_t config;

    memset(e, 0, sizeof *e);
    snprintf(e->file, sizeof e->file, "%s", from->file);
    snprintf(e->plant.listen, sizeof e->plant.listen, "tcp:127.0.0.1:%d", APC_PORT);
    snprintf(e->client.link, sizeof e->client.link, "tcp:127.0.0.1:%d", APC_PORT);
    e->live.history = 600;
    e->live.size = 64;
    e->text = strdup(from->text);
    s.failed = settings_parse(&config, e->file, from->text, why);
    if (!e->text && !s.failed)
        s.failed = apc_fail(why, APC_ENOMEM, "out of memory");
    if (!s.failed)
        read_root(&s, config_root_setting(&config), e, parts, overrides, record);
    config_destroy(&config);
    if (!s.failed)
        s.failed = take_recorded_settings(e, record, why);
    if (s.failed)
        experiment_free(e);
    return s.failed;
}

int experiment_load(struct experiment *e, const char *name, unsigned parts,
                    const struct experiment_overrides *overrides, struct apc_error *why)
{
    char file[EXPERIMENT_PATH], *text = NULL;
    struct record record;

    memset(e, 0, sizeof *e);
    int rc = experiment_read(name, file, &record, &text, why);
    const struct experiment_source source = {.file = file, .text = text, .record = &record};
    if (rc == 0 && overrides && (overrides->n_set > 0 || overrides->model_file))
        rc = experiment_parse_changed(e, &source, parts, overrides, why);
    else if (rc == 0)
        rc = experiment_parse(e, &source, parts, overrides, why);
    free(text);
    record_free(&record);
    return rc;
}

void experiment_free(struct experiment *e)
{
    free(e->text);
    free(e->y);
    free(e->z);
    free(e->u);
    free(e->client.points);
    free(e->plant.p);
    free(e->plant.spread);
    free(e->plant.x0);
    free(e->plant.noise);
    free(e->plant.clients);
    free(e->plant.disturbance);
    free(e->plant.fault);
    free(e->sensor);
    free(e->faults);
    free(e->actuator);
    free(e->actuator_faults);
    free(e->scheduler.sequence);
    free(e->scheduler.z);
    free(e->action);
    free(e->alarm);
    experiment_free_controllers(e);
    models_free(&e->models);
    apc_plugin_close(e->model_handle);
    memset(e, 0, sizeof *e);
}

/* SPDX-License-Identifier: BSD-3-Clause */
/*
 * An experiment file with one setting changed: the text is parsed, and written anew with another value in one
 * place. Then it is read as any other, so that a change can do nothing that a file could not say.
 */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "experiment_parts.h"
#include "files/files.h"

/* Where the new value goes: instead of a setting that is there, or as a new member of a group. */
struct place {
    const config_setting_t *at, *in;
    char name[EXPERIMENT_NAME], *value; /* of the new member; value: as it stands in a file, to be freed */
    const config_setting_t *without;    /* is left out, or NULL */
    const config_setting_t *among;      /* where there is no such setting: among these, */
    const char *lost;                   /* what begins the rest of the path names none */
    const config_setting_t *controller; /* whose @parameter it is, of output number @output */
    const char *parameter;
    size_t output;
    bool measured; /* it is of measurement number @output */
    bool backup;   /* it is its backup law's */
};

static int lose_place(struct place *place, const config_setting_t *among, const char *path)
{
    place->among = among;
    place->lost = path;
    return APC_ENOTFOUND;
}

/* ---- Writing ------------------------------------------------------------------------------- */

static void put_float(FILE *out, double value)
{
    char number[DECIMAL_LEN];
    decimal_shortest(value, 15, number);
    fprintf(out, "%s%s", number, strpbrk(number, ".en") ? "" : ".0");
}

static void put_scalar(FILE *out, const config_setting_t *at)
{
    switch (config_setting_type(at)) {
    case CONFIG_TYPE_INT:
        fprintf(out, "%d", config_setting_get_int(at));
        break;
    case CONFIG_TYPE_INT64:
        fprintf(out, "%lldL", config_setting_get_int64(at));
        break;
    case CONFIG_TYPE_FLOAT:
        put_float(out, config_setting_get_float(at));
        break;
    case CONFIG_TYPE_BOOL:
        fputs(config_setting_get_bool(at) ? "true" : "false", out);
        break;
    default:
        settings_put_text(out, config_setting_get_string(at));
    }
}

static void put_setting_text(FILE *out, const config_setting_t *at, const struct place *place);

/* Of values by name: what has any name stands in a list. */
static void put_named(FILE *out, const char *name)
{
    fputs("{ name = ", out);
    settings_put_text(out, name);
    fputs("; value = ", out);
}

/* A group of such values as a list, with the new one. */
static void put_as_list(FILE *out, const config_setting_t *group, const struct place *place)
{
    fputc('(', out);
    for (int i = 0; i < config_setting_length(group); i++) {
        const config_setting_t *member = config_setting_get_elem(group, (unsigned)i);
        put_named(out, config_setting_name(member));
        put_setting_text(out, member, place);
        fputs("; }, ", out);
    }
    put_named(out, place->name);
    fprintf(out, "%s; })", place->value);
}

static void put_members(FILE *out, const config_setting_t *group, const struct place *place, const char *end)
{
    for (int i = 0; i < config_setting_length(group); i++) {
        const config_setting_t *member = config_setting_get_elem(group, (unsigned)i);
        if (!member || member == place->without)
            continue;
        fprintf(out, "%s = ", config_setting_name(member));
        put_setting_text(out, member, place);
        fputs(end, out);
    }
    if (place->in == group)
        fprintf(out, "%s = %s%s", place->name, place->value, end);
}

static void put_setting_text(FILE *out, const config_setting_t *at, const struct place *place)
{
    const bool list = config_setting_is_list(at);
    if (at == place->at) {
        fputs(place->value, out);
    } else if (config_setting_is_group(at) && at == place->in && !settings_is_word(place->name)) {
        put_as_list(out, at, place);
    } else if (config_setting_is_group(at)) {
        fputs("{ ", out);
        put_members(out, at, place, "; ");
        fputc('}', out);
    } else if (config_setting_is_aggregate(at)) {
        const char *before = "";
        fputc(list ? '(' : '[', out);
        for (int i = 0; i < config_setting_length(at); i++) {
            const config_setting_t *element = config_setting_get_elem(at, (unsigned)i);
            if (element == place->without)
                continue;
            fputs(before, out);
            before = ", ";
            put_setting_text(out, element, place);
        }
        if (at == place->in) {
            fputs(before, out);
            put_named(out, place->name);
            fprintf(out, "%s; }", place->value);
        }
        fputc(list ? ')' : ']', out);
    } else {
        put_scalar(out, at);
    }
}

int experiment_setting_text(const config_setting_t *setting, char **text)
{
    size_t size = 0;
    FILE *out = open_memstream(text, &size);
    if (!out)
        return APC_ENOMEM;
    put_setting_text(out, setting, &(struct place){.at = NULL});
    if (fclose(out) == 0)
        return 0;
    free(*text);
    return APC_ENOMEM;
}

/* ---- Finding ------------------------------------------------------------------------------- */

/* Is @p name the first part of the path? Then what comes after it, else NULL. */
static const char *after(const char *path, const char *name)
{
    const size_t n = strlen(name);
    if (strncmp(path, name, n) != 0 || (path[n] && path[n] != '.'))
        return NULL;
    return path + n + (path[n] == '.');
}

static const char *name_in(const config_setting_t *at)
{
    const char *name = NULL;
    if (config_setting_is_group(at))
        config_setting_lookup_string(at, "name", &name);
    else
        name = config_setting_get_string(at);
    return name;
}

/* The element that the path begins with, by its name, the longest that fits, or by [INDEX] from 0. */
static int element_of(const config_setting_t *list, const char *path, const char **rest)
{
    const int n = config_setting_length(list);
    int found = -1, end = 0;
    unsigned index;
    if (sscanf(path, "[%5u]%n", &index, &end) == 1 && end > 0 && (!path[end] || path[end] == '.')) {
        *rest = path + end + (path[end] == '.');
        return index < (unsigned)n ? (int)index : -1;
    }
    for (int i = 0; i < n; i++) {
        const char *name = name_in(config_setting_get_elem(list, (unsigned)i));
        const char *next = name ? after(path, name) : NULL;
        if (next && (found < 0 || next > *rest)) {
            *rest = next;
            found = i;
        }
    }
    return found;
}

/* Is the member called so, up to the next dot, now or in a former version? Then what comes after it, else NULL. */
static const char *after_member(const char *path, const char *name)
{
    const char *present = former_name(name), *former = former_of(name), *next = after(path, name);
    if (!next && present)
        next = after(path, present);
    return !next && former ? after(path, former) : next;
}

static const config_setting_t *member_of(const config_setting_t *group, const char *path, const char **rest)
{
    for (int i = 0; i < config_setting_length(group); i++) {
        const config_setting_t *member = config_setting_get_elem(group, (unsigned)i);
        const char *next = after_member(path, config_setting_name(member));
        if (next) {
            *rest = next;
            return member;
        }
    }
    return NULL;
}

/* A group of such a list, which is made when there is none: {}, {}, { NAME = VALUE; }, ... */
static int new_tuning(struct place *place, const config_setting_t *law, const char *of, int which, int n,
                      const char *name)
{
    char *list = NULL;
    size_t size = 0;
    FILE *out = open_memstream(&list, &size);
    if (!out)
        return APC_ENOMEM;
    for (int i = 0; i < n; i++) {
        fputs(i ? ", " : "(", out);
        if (i == which)
            fprintf(out, "{ %s = %s; }", name, place->value);
        else
            fputs("{ }", out);
    }
    fputc(')', out);
    if (fclose(out) != 0) {
        free(list);
        return APC_ENOMEM;
    }
    free(place->value);
    place->value = list;
    place->in = law;
    snprintf(place->name, sizeof place->name, "%s", of);
    return 0;
}

/* Of a controller, or else of the file: those that a path may begin with. *@n of them. */
static const config_setting_t *signals_of(const config_setting_t *controller, const char *name, int *n)
{
    const config_setting_t *own = config_setting_get_member(controller, name);
    if (!own)
        own = config_setting_lookup(config_setting_parent(controller), name);
    *n = own && config_setting_is_aggregate(own) ? config_setting_length(own) : 0;
    return own;
}

/* OUTPUT.PARAMETER, OUTPUT.backup.PARAMETER or, where there is one output only, what stands behind it; the
 * same of a measurement. */
static int find_tuning_place(struct place *place, const config_setting_t *controller, const char *path)
{
    int n, n_measured;
    const config_setting_t *outputs = signals_of(controller, "outputs", &n);
    const config_setting_t *measured = signals_of(controller, "measurements", &n_measured);
    const config_setting_t *backup = config_setting_get_member(controller, "backup");
    const char *rest = path;
    int which = n > 0 ? element_of(outputs, path, &path) : -1;
    const int of = which < 0 && n_measured > 0 && *path != '[' ? element_of(measured, path, &rest) : -1;
    const bool named = which >= 0 || (of >= 0 && *rest), is_measured = named && which < 0;
    const char *const name = is_measured ? "measurement_tuning" : "tuning";
    if (is_measured) {
        which = of;
        n = n_measured;
        path = rest;
    } else if (n == 1) {
        which = 0;
    }
    const char *const of_backup = backup && which >= 0 ? after(path, "backup") : NULL;
    if (of_backup)
        path = of_backup;
    if (which < 0 || !settings_is_word(path) || strlen(path) >= sizeof place->name)
        return lose_place(place, named ? NULL : outputs, path);
    place->controller = controller;
    place->parameter = path;
    place->output = (size_t)which;
    place->measured = is_measured;
    place->backup = of_backup;
    const config_setting_t *law = of_backup ? backup : controller;
    const config_setting_t *tuning = config_setting_get_member(law, name);
    if (!tuning)
        return new_tuning(place, law, name, which, n, path);
    const config_setting_t *group = config_setting_get_elem(tuning, (unsigned)which);
    if (!group || !config_setting_is_group(group))
        return lose_place(place, NULL, path);
    place->at = member_of(group, path, &rest);
    place->in = place->at ? NULL : group;
    snprintf(place->name, sizeof place->name, "%s", path);
    return 0;
}

/* Is what has @name in @parent values by a model's names, dots and all? */
static bool holds_values(const char *name, const config_setting_t *parent)
{
    const char *of = name && parent ? config_setting_name(parent) : NULL;
    return name && (!strcmp(name, "parameters") || (!strcmp(name, "noise") && of && !strcmp(of, "plant")));
}

/* One of these, new or not. */
static int find_value(struct place *place, const config_setting_t *values, const char *path)
{
    if (strlen(path) >= sizeof place->name)
        return lose_place(place, values, path);
    snprintf(place->name, sizeof place->name, "%s", path);
    if (config_setting_is_group(values)) {
        place->at = config_setting_get_member(values, path);
    } else {
        for (int i = 0; !place->at && i < config_setting_length(values); i++) {
            const config_setting_t *one = config_setting_get_elem(values, (unsigned)i);
            const char *name = name_in(one);
            place->at = name && !strcmp(name, path) && config_setting_is_group(one)
                            ? config_setting_get_member(one, "value")
                            : NULL;
        }
    }
    place->in = place->at ? NULL : values;
    return 0;
}

/* All of such values, with the one that is called @p name: in place of @p place->value. */
static int new_model_values(struct place *place, const char *name)
{
    char *values = NULL;
    size_t size = 0;
    FILE *out = open_memstream(&values, &size);
    if (!out)
        return APC_ENOMEM;
    if (settings_is_word(name)) {
        fprintf(out, "{ %s = %s; }", name, place->value);
    } else {
        fputc('(', out);
        put_named(out, name);
        fprintf(out, "%s; })", place->value);
    }
    if (fclose(out) != 0) {
        free(values);
        return APC_ENOMEM;
    }
    free(place->value);
    place->value = values;
    return 0;
}

/* The groups on the way to a new member that are not there either: "parameters.K" is { K = VALUE; }. */
static int new_member(struct place *place, const config_setting_t *in, const char *path)
{
    const size_t n = strcspn(path, ".");
    char *value = NULL, first[sizeof place->name];
    snprintf(first, sizeof first, "%.*s", (int)n, path);
    if (!settings_is_word(first) || n >= sizeof first)
        return lose_place(place, in, path);
    if (path[n] && path[n + 1] && holds_values(first, in)) {
        if (new_model_values(place, path + n + 1) < 0)
            return APC_ENOMEM;
    } else if (path[n]) {
        int rc = new_member(place, in, path + n + 1);
        if (rc < 0)
            return rc == APC_ENOMEM ? rc : lose_place(place, in, path);
        if (asprintf(&value, "{ %s = %s; }", place->name, place->value) < 0)
            return APC_ENOMEM;
        free(place->value);
        place->value = value;
    }
    place->in = in;
    snprintf(place->name, sizeof place->name, "%s", first);
    return 0;
}

static bool is_controller(const config_setting_t *group)
{
    const config_setting_t *parent = config_setting_parent(group);
    const char *name = config_setting_name(group), *list = parent ? config_setting_name(parent) : NULL;
    return name ? !strcmp(name, "controller") : list && !strcmp(list, "controllers");
}

/* Where @p path leads. Returns 0, APC_ENOTFOUND or APC_ENOMEM. */
static int find_path(struct place *place, const config_setting_t *root, const char *path)
{
    const config_setting_t *at = root;
    while (*path) {
        const char *rest = path;
        const config_setting_t *next = NULL;
        if (config_setting_is_aggregate(at) &&
            holds_values(config_setting_name(at), config_setting_parent(at)))
            return find_value(place, at, path);
        if (config_setting_is_group(at)) {
            next = member_of(at, path, &rest);
        } else if (config_setting_is_aggregate(at)) {
            int i = element_of(at, path, &rest);
            next = i < 0 ? NULL : config_setting_get_elem(at, (unsigned)i);
        }
        if (!next)
            break;
        at = next;
        path = rest;
    }
    if (!*path) {
        place->at = at;
        return at == root ? lose_place(place, root, path) : 0;
    }
    const bool of_controllers = at == root && !strncmp(path, "controller", 10); /* naming one makes none */
    if (!config_setting_is_group(at) || of_controllers)
        return lose_place(place, at, path);
    if (is_controller(at) && !experiment_knows_of_controller(path))
        return find_tuning_place(place, at, path);
    return new_member(place, at, path);
}

/* ---- The value ----------------------------------------------------------------------------- */

/* Among which no whole number may stand without its point. */
static bool is_float_in_array(const config_setting_t *at)
{
    return at && config_setting_type(at) == CONFIG_TYPE_FLOAT &&
           config_setting_is_array(config_setting_parent(at));
}

static double number_in(const config_setting_t *at)
{
    return config_setting_type(at) == CONFIG_TYPE_FLOAT ? config_setting_get_float(at)
                                                        : (double)config_setting_get_int64(at);
}

/* As it stands in a file; what would not be understood there, or where text was, is text without its quotes. */
static char *value_as_text(const char *value, const config_setting_t *was)
{
    char *line = NULL, *written = NULL;
    double number;
    size_t size = 0;
    config_t trial;
    FILE *out = open_memstream(&written, &size);
    if (!out || asprintf(&line, "value = %s\n;", value) < 0) {
        line = NULL;
        goto out;
    }
    const bool of_text =
        was && config_setting_type(was) == CONFIG_TYPE_STRING &&
        !strchr(config_setting_get_string(was), '('); /* a distribution may become a number */
    bool good = settings_parse(&trial, "", line, NULL) == 0 &&
                config_setting_length(config_root_setting(&trial)) == 1;
    const config_setting_t *is = good ? config_lookup(&trial, "value") : NULL;
    if (is && of_text)
        good = config_setting_type(is) == CONFIG_TYPE_STRING || config_setting_is_group(is);
    if (good && is && config_setting_is_number(is) && is_float_in_array(was))
        put_float(out, number_in(is));
    else if (good && is)
        put_setting_text(out, is, &(struct place){.at = NULL});
    else if (!of_text && apc_number_parse(value, &number) == 0) /* beyond 32 bits */
        put_float(out, number);
    else
        settings_put_text(out, value);
    config_destroy(&trial);
out:
    free(line);
    if (out && fclose(out) != 0) {
        free(written);
        written = NULL;
    }
    return written;
}

/* ---- Where a path leads nowhere ------------------------------------------------------------- */

static const char *name_of_element(const config_setting_t *in, int i)
{
    const config_setting_t *at = config_setting_get_elem(in, (unsigned)i);
    return config_setting_is_group(in) ? config_setting_name(at) : name_in(at);
}

static void tell_unknown_path(const struct place *place, const char *path, struct apc_error *why)
{
    const config_setting_t *in = place->among;
    const int before = (int)(place->lost - path),
              n = in && config_setting_is_aggregate(in) ? config_setting_length(in) : 0;
    char wanted[64], names[200] = "";
    struct nearest nearest = {.wanted = wanted};
    size_t used = 0;
    snprintf(wanted, sizeof wanted, "%.*s", (int)strcspn(place->lost, "."), place->lost);
    for (int i = 0; i < n; i++) {
        const char *name = name_of_element(in, i);
        if (name && used < sizeof names)
            used += (size_t)snprintf(names + used, sizeof names - used, "%s%s", used ? ", " : "; there are ",
                                     name);
        if (name)
            nearest_look(&nearest, name);
    }
    if (n > 0 && !used)
        snprintf(names, sizeof names, "; there are [0] to [%d]", n - 1);
    apc_fail(why, APC_ENOTFOUND, "%s: there is no \"%s\" in %.*s%s%s%s%s", *path ? path : "\"\"", wanted,
             before > 1 ? before - 1 : (int)strlen("the file"), before > 1 ? path : "the file", names,
             nearest.name ? ": did you mean \"" : "", nearest.name ? nearest.name : "",
             nearest.name ? "\"?" : "");
}

/* find_path(), and says why not. */
static int look_for_path(struct place *place, const config_setting_t *root, const char *path,
                         struct apc_error *why)
{
    const int rc = place->value ? find_path(place, root, path) : APC_ENOMEM;
    if (rc == APC_ENOTFOUND)
        tell_unknown_path(place, path, why);
    return rc == APC_ENOMEM ? apc_fail(why, rc, "out of memory") : rc;
}

/* What begins as a list or group and is none would pass for text, of which then something else is said. */
static int check_list(const char *path, const char *value, const config_setting_t *was, struct apc_error *why)
{
    config_t trial;
    char *line = NULL;
    const char *first = value + strspn(value, " ");
    if (!*first || !strchr("[({", *first) || (was && config_setting_type(was) == CONFIG_TYPE_STRING))
        return 0;
    if (asprintf(&line, "value = %s\n;", value) < 0)
        return apc_fail(why, APC_ENOMEM, "out of memory");
    int rc = settings_parse(&trial, "", line, NULL);
    if (rc < 0)
        rc =
            apc_fail(why, APC_EINVAL,
                     "%s = %.100s: is no list or group: in [ ] all numbers have a decimal point or none, and "
                     "what is opened is closed",
                     path, value);
    config_destroy(&trial);
    free(line);
    return rc;
}

/* A law has one model: one that is set takes the place of its operating point. */
static const config_setting_t *replaced(const struct place *place)
{
    const config_setting_t *group = place->at ? config_setting_parent(place->at) : place->in;
    const char *name = place->at ? config_setting_name(place->at) : place->name;
    const bool model = name && group && is_controller(group) && !strcmp(name, "model");
    return model ? config_setting_get_member(group, "operating_point") : NULL;
}

static int change_setting(const config_t *config, const char *path, const char *value, char **changed,
                          struct apc_error *why)
{
    const config_setting_t *root = config_root_setting(config);
    struct place place = {.value = strdup("")};
    size_t size = 0;
    int rc = look_for_path(&place, root, path, why);

    if (rc == 0)
        rc = check_list(path, value, place.at, why);
    if (rc == 0) { /* now it is known what was there */
        free(place.value);
        place = (struct place){.value = value_as_text(value, place.at)};
        rc = look_for_path(&place, root, path, why);
        place.without = replaced(&place);
    }
    FILE *out = rc == 0 ? open_memstream(changed, &size) : NULL;
    if (out)
        put_members(out, root, &place, ";\n");
    if (rc == 0 && (!out || fclose(out) != 0))
        rc = apc_fail(why, APC_ENOMEM, "out of memory");
    free(place.value);
    return rc;
}

int experiment_change(const char *text, const char *path, const char *value, char **changed,
                      struct apc_error *why)
{
    config_t config;
    *changed = NULL;
    int rc = settings_parse(&config, path, text, why);
    if (rc == 0)
        rc = change_setting(&config, path, value, changed, why);
    config_destroy(&config);
    return rc;
}

int experiment_append(const char *text, const char *path, const char *element, char **changed,
                      struct apc_error *why)
{
    config_t config;
    struct place place = {.value = strdup("")};
    char *list = NULL, *longer = NULL;
    *changed = NULL;
    int rc = settings_parse(&config, path, text, why);
    if (rc == 0)
        rc = look_for_path(&place, config_root_setting(&config), path, why);
    const int n = rc == 0 && place.at ? config_setting_length(place.at) : 0;
    if (n > 0 && experiment_setting_text(place.at, &list) < 0) {
        list = NULL;
        rc = apc_fail(why, APC_ENOMEM, "out of memory");
    }
    if (rc == 0 && asprintf(&longer, "%.*s%s%s)", n > 0 ? (int)strlen(list) - 1 : 1, n > 0 ? list : "(",
                            n > 0 ? ", " : "", element) < 0) {
        longer = NULL;
        rc = apc_fail(why, APC_ENOMEM, "out of memory");
    }
    if (rc == 0)
        rc = change_setting(&config, path, longer, changed, why);
    free(longer);
    free(list);
    free(place.value);
    config_destroy(&config);
    return rc;
}

int experiment_remove(const char *text, const char *path, const char *value, char **changed,
                      struct apc_error *why)
{
    config_t config;
    struct place place = {.value = strdup("")};
    size_t size = 0;
    (void)value;
    *changed = NULL;
    int rc = settings_parse(&config, path, text, why);
    if (rc == 0)
        rc = look_for_path(&place, config_root_setting(&config), path, why);
    FILE *out = rc == 0 ? open_memstream(changed, &size) : NULL;
    if (out)
        put_members(out, config_root_setting(&config), &(struct place){.without = place.at}, ";\n");
    if (rc == 0 && (!out || fclose(out) != 0))
        rc = apc_fail(why, APC_ENOMEM, "out of memory");
    free(place.value);
    config_destroy(&config);
    return rc;
}

int experiment_change_model(const char *text, const char *controller, const char *value, char **changed,
                            struct apc_error *why)
{
    char path[APC_TAG_LEN + 32];
    int rc;

    snprintf(path, sizeof path, "controllers.%s.model", controller);
    rc = experiment_change(text, path, value, changed, why);
    if (rc == APC_ENOTFOUND && experiment_change(text, "controller.model", value, changed, NULL) == 0)
        return 0; /* the short form */
    return rc;
}

/* ---- The number that is there --------------------------------------------------------------- */

static int number_there(const config_setting_t *at, const char *path, double *value, struct apc_error *why)
{
    struct apc_distribution spread;
    const char *text = config_setting_get_string(at);
    switch (config_setting_type(at)) {
    case CONFIG_TYPE_INT:
    case CONFIG_TYPE_INT64:
    case CONFIG_TYPE_FLOAT:
        *value = number_in(at);
        return 0;
    case CONFIG_TYPE_STRING:
        if (strchr(text, '(') && apc_distribution_parse(text, &spread, NULL) == 0) {
            *value = apc_distribution_mean(&spread);
            return 0;
        }
        return apc_fail(why, APC_EINVAL, "%s is text, \"%s\": only a number goes from one value to another",
                        path, text);
    default:
        return apc_fail(why, APC_EINVAL, "%s is no number", path);
    }
}

static bool is_parameter_called(const char *present, const char *name)
{
    return !strcmp(present, name) || former_is(name, present);
}

/* What the law's parameter is where the file does not say. */
static double number_of_law(const struct experiment *e, const struct place *place)
{
    const config_setting_t *parent = config_setting_parent(place->controller);
    const struct controller *c =
        &e->controllers[config_setting_is_list(parent) ? config_setting_index(place->controller) : 0];
    if (place->backup)
        c = c->backup;
    const size_t n = c->law ? apc_law_parameters(c->law, &c->dim) : 0;
    for (size_t k = 0; k < n; k++) {
        const struct apc_law_parameter p = apc_law_parameter_at(c->law, &c->dim, k);
        if ((p.scope == APC_OF_MEASUREMENT) == place->measured &&
            is_parameter_called(c->law->tuning[p.number].name, place->parameter) &&
            (p.scope == APC_OF_LAW || p.of == place->output))
            return c->tuning[k];
    }
    return (double)NAN;
}

static double number_of_model(const struct experiment *e, const char *name)
{
    for (size_t i = 0; e->plant.model && i < e->plant.model->np; i++)
        if (!strcmp(e->plant.model->param[i].name, name))
            return e->plant.p[i];
    return (double)NAN;
}

int experiment_value(const struct experiment *e, const char *path, double *value, struct apc_error *why)
{
    static const char of_model[] = "plant.parameters.";
    config_t config;
    *value = (double)NAN;
    int rc = settings_parse(&config, path, e->text, why);
    struct place place = {.value = strdup("")};
    if (rc == 0)
        rc = look_for_path(&place, config_root_setting(&config), path, why);
    if (rc == 0 && place.at)
        rc = number_there(place.at, path, value, why);
    else if (rc == 0 && place.controller)
        *value = number_of_law(e, &place);
    else if (rc == 0 && !strncmp(path, of_model, sizeof of_model - 1))
        *value = number_of_model(e, path + sizeof of_model - 1);
    free(place.value);
    config_destroy(&config);
    return rc;
}

/* ---- Lines to paste ------------------------------------------------------------------------- */

/* Is it the file, one of its groups, or one of its controllers: whose members stand for themselves? */
static bool is_outer(const config_setting_t *at)
{
    const config_setting_t *parent = config_setting_parent(at),
                           *above = parent ? config_setting_parent(parent) : NULL;
    return !parent || (!above && config_setting_is_group(at)) || is_controller(at);
}

int experiment_line(const struct experiment *e, const char *path, char **line, struct apc_error *why)
{
    config_t config;
    struct place place = {.value = strdup("")};
    size_t size = 0;
    *line = NULL;
    int rc = settings_parse(&config, path, e->text, why);
    if (rc == 0)
        rc = look_for_path(&place, config_root_setting(&config), path, why);
    const config_setting_t *at = rc == 0 ? place.at : NULL;
    while (at && !is_outer(config_setting_parent(at)))
        at = config_setting_parent(at);
    FILE *out = at ? open_memstream(line, &size) : NULL;
    if (out) {
        fprintf(out, "%s = ", config_setting_name(at));
        put_setting_text(out, at, &(struct place){.at = NULL});
        fputc(';', out);
    }
    if (rc == 0 && !at)
        rc = apc_fail(why, APC_ENOTFOUND, "%s: is not in the file", path);
    else if (rc == 0 && (!out || fclose(out) != 0))
        rc = apc_fail(why, APC_ENOMEM, "out of memory");
    free(place.value);
    config_destroy(&config);
    return rc;
}

/* SPDX-License-Identifier: BSD-3-Clause */
/*
 * An experiment file with one setting changed: the text is parsed, and written anew with another value in one
 * place. Then it is read as any other, so that a change can do nothing that a file could not say.
 */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "experiment_parts.h"

/* Where the new value goes: instead of a setting that is there, or as a new member of a group. */
struct place {
    const config_setting_t *at, *in;
    char name[64], *value; /* of the new member; value: as it stands in a file, to be freed */
};

/* ---- Writing ------------------------------------------------------------------------------- */

static void put_quoted(FILE *out, const char *text)
{
    fputc('"', out);
    for (const unsigned char *c = (const unsigned char *)text; *c; c++)
        if (*c == '"' || *c == '\\')
            fprintf(out, "\\%c", *c);
        else if (*c < ' ')
            fprintf(out, "\\x%02x", *c);
        else
            fputc(*c, out);
    fputc('"', out);
}

static void put_scalar(FILE *out, const config_setting_t *at)
{
    char number[SETTINGS_NUMBER];
    switch (config_setting_type(at)) {
    case CONFIG_TYPE_INT:
        fprintf(out, "%d", config_setting_get_int(at));
        break;
    case CONFIG_TYPE_INT64:
        fprintf(out, "%lldL", config_setting_get_int64(at));
        break;
    case CONFIG_TYPE_FLOAT:
        settings_format(config_setting_get_float(at), number);
        fprintf(out, "%s%s", number, strpbrk(number, ".en") ? "" : ".0");
        break;
    case CONFIG_TYPE_BOOL:
        fputs(config_setting_get_bool(at) ? "true" : "false", out);
        break;
    default:
        put_quoted(out, config_setting_get_string(at));
    }
}

static void put(FILE *out, const config_setting_t *at, const struct place *place);

static void put_members(FILE *out, const config_setting_t *group, const struct place *place, const char *end)
{
    for (int i = 0; i < config_setting_length(group); i++) {
        const config_setting_t *member = config_setting_get_elem(group, (unsigned)i);
        if (!member)
            continue;
        fprintf(out, "%s = ", config_setting_name(member));
        put(out, member, place);
        fputs(end, out);
    }
    if (place->in == group)
        fprintf(out, "%s = %s%s", place->name, place->value, end);
}

static void put(FILE *out, const config_setting_t *at, const struct place *place)
{
    const bool list = config_setting_is_list(at);
    if (at == place->at) {
        fputs(place->value, out);
    } else if (config_setting_is_group(at)) {
        fputs("{ ", out);
        put_members(out, at, place, "; ");
        fputc('}', out);
    } else if (config_setting_is_aggregate(at)) {
        fputc(list ? '(' : '[', out);
        for (int i = 0; i < config_setting_length(at); i++) {
            fputs(i ? ", " : "", out);
            put(out, config_setting_get_elem(at, (unsigned)i), place);
        }
        fputc(list ? ')' : ']', out);
    } else {
        put_scalar(out, at);
    }
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

/* A member by its name, up to the next dot. */
static const config_setting_t *member_of(const config_setting_t *group, const char *path, const char **rest)
{
    for (int i = 0; i < config_setting_length(group); i++) {
        const config_setting_t *member = config_setting_get_elem(group, (unsigned)i);
        const char *next = after(path, config_setting_name(member));
        if (next) {
            *rest = next;
            return member;
        }
    }
    return NULL;
}

/* A group of the list `tuning`, which is made when there is none: {}, {}, { NAME = VALUE; }, ... */
static int new_tuning(struct place *place, const config_setting_t *controller, int which, int n,
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
    place->in = controller;
    snprintf(place->name, sizeof place->name, "tuning");
    return 0;
}

/* OUTPUT.PARAMETER or, where there is one output only, PARAMETER. */
static int find_tuning(struct place *place, const config_setting_t *controller, const char *path)
{
    const config_setting_t *outputs = config_setting_get_member(controller, "outputs");
    const config_setting_t *tuning = config_setting_get_member(controller, "tuning");
    if (!outputs)
        outputs = config_setting_lookup(config_setting_parent(controller), "outputs");
    const int n = outputs && config_setting_is_aggregate(outputs) ? config_setting_length(outputs) : 0;
    int which = n > 0 ? element_of(outputs, path, &path) : -1;
    if (which < 0 && n == 1)
        which = 0;
    if (which < 0 || !*path || strchr(path, '.') || strlen(path) >= sizeof place->name)
        return APC_ENOTFOUND;
    if (!tuning)
        return new_tuning(place, controller, which, n, path);
    const config_setting_t *group = config_setting_get_elem(tuning, (unsigned)which);
    if (!group || !config_setting_is_group(group))
        return APC_ENOTFOUND;
    place->at = config_setting_get_member(group, path);
    place->in = place->at ? NULL : group;
    snprintf(place->name, sizeof place->name, "%s", path);
    return 0;
}

static bool is_controller(const config_setting_t *group)
{
    const config_setting_t *parent = config_setting_parent(group);
    const char *name = config_setting_name(group), *list = parent ? config_setting_name(parent) : NULL;
    return name ? !strcmp(name, "controller") : list && !strcmp(list, "controllers");
}

/* Where @p path leads. Returns 0, APC_ENOTFOUND or APC_ENOMEM. */
static int find(struct place *place, const config_setting_t *root, const char *path)
{
    const config_setting_t *at = root;
    while (*path) {
        const char *rest = path;
        const config_setting_t *next = NULL;
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
        return at == root ? APC_ENOTFOUND : 0;
    }
    if (!config_setting_is_group(at))
        return APC_ENOTFOUND;
    if (is_controller(at) && !experiment_knows_of_controller(path))
        return find_tuning(place, at, path);
    if (strchr(path, '.') || strlen(path) >= sizeof place->name)
        return APC_ENOTFOUND;
    place->in = at;
    snprintf(place->name, sizeof place->name, "%s", path);
    return 0;
}

/* ---- The value ----------------------------------------------------------------------------- */

/* As it stands in a file; what would not be understood there, or where text was, is text without its quotes.
 */
static char *value_of(const char *value, const config_setting_t *was)
{
    char *line = NULL, *written = NULL;
    size_t size = 0;
    config_t trial;
    FILE *out = open_memstream(&written, &size);
    if (!out || asprintf(&line, "value = %s\n;", value) < 0) {
        line = NULL;
        goto out;
    }
    bool good = settings_parse(&trial, "", line, NULL) == 0 &&
                config_setting_length(config_root_setting(&trial)) == 1;
    const config_setting_t *is = good ? config_lookup(&trial, "value") : NULL;
    if (is && was && config_setting_type(was) == CONFIG_TYPE_STRING)
        good = config_setting_type(is) == CONFIG_TYPE_STRING || config_setting_is_group(is);
    if (good && is)
        put(out, is, &(struct place){.at = NULL});
    else
        put_quoted(out, value);
    config_destroy(&trial);
out:
    free(line);
    if (out && fclose(out) != 0) {
        free(written);
        written = NULL;
    }
    return written;
}

static int change(const config_t *config, const char *path, const char *value, char **changed)
{
    const config_setting_t *root = config_root_setting(config);
    struct place place = {.value = strdup("")};
    size_t size = 0;
    int rc = place.value ? find(&place, root, path) : APC_ENOMEM;

    if (rc == 0) { /* now it is known what was there */
        free(place.value);
        place.value = value_of(value, place.at);
        place.at = place.in = NULL;
        rc = place.value ? find(&place, root, path) : APC_ENOMEM;
    }
    FILE *out = rc == 0 ? open_memstream(changed, &size) : NULL;
    if (out)
        put_members(out, root, &place, ";\n");
    if (rc == 0 && (!out || fclose(out) != 0))
        rc = APC_ENOMEM;
    free(place.value);
    return rc;
}

int experiment_change(const char *text, const char *path, const char *value, char **changed,
                      struct apc_error *why)
{
    config_t config;
    *changed = NULL;
    int rc = settings_parse(&config, path, text, why);
    if (rc == 0 && (rc = change(&config, path, value, changed)) < 0)
        apc_fail(why, rc,
                 rc == APC_ENOMEM ? "out of memory" : "%s: there is no such setting in this experiment",
                 path);
    config_destroy(&config);
    return rc;
}

/* SPDX-License-Identifier: BSD-3-Clause */
#include "settings.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>

int settings_fail(struct settings *s, const config_setting_t *at, const char *fmt, ...)
{
    char text[400];
    va_list args;
    if (s->failed)
        return s->failed;
    va_start(args, fmt);
    vsnprintf(text, sizeof text, fmt, args);
    va_end(args);
    s->failed =
        apc_fail(s->why, APC_EINVAL, "%s:%u: %s", s->file, at ? config_setting_source_line(at) : 1, text);
    return s->failed;
}

static const char *name_of(const config_setting_t *setting)
{
    const char *name = config_setting_name(setting);
    return name ? name : "the file";
}

void settings_known(struct settings *s, const config_setting_t *group, const char *const *names)
{
    char list[256] = "";
    if (s->failed || !group)
        return;
    for (int i = 0; i < config_setting_length(group); i++) {
        const config_setting_t *member = config_setting_get_elem(group, (unsigned)i);
        const char *const *known = names;
        while (*known && strcmp(*known, config_setting_name(member)) != 0)
            known++;
        if (*known)
            continue;
        for (known = names; *known; known++) {
            size_t length = strlen(list);
            snprintf(list + length, sizeof list - length, "%s%s", length ? ", " : "", *known);
        }
        settings_fail(s, member, "unknown setting \"%s\" in %s; known are: %s", config_setting_name(member),
                      name_of(group), list);
        return;
    }
}

static config_setting_t *find(struct settings *s, const config_setting_t *in, const char *name,
                              enum settings_presence presence)
{
    if (s->failed)
        return NULL;
    config_setting_t *found = config_setting_get_member(in, name);
    if (!found && presence == REQUIRED)
        settings_fail(s, in, "\"%s\" is missing in %s", name, name_of(in));
    return found;
}

config_setting_t *settings_group(struct settings *s, const config_setting_t *in, const char *name,
                                 enum settings_presence presence)
{
    config_setting_t *found = find(s, in, name, presence);
    if (found && !config_setting_is_group(found)) {
        settings_fail(s, found, "\"%s\" must be a group: %s = { ... };", name, name);
        return NULL;
    }
    return found;
}

config_setting_t *settings_list(struct settings *s, const config_setting_t *in, const char *name,
                                enum settings_presence presence)
{
    config_setting_t *found = find(s, in, name, presence);
    if (found && !config_setting_is_list(found)) {
        settings_fail(s, found, "\"%s\" must be a list: %s = ( ... );", name, name);
        return NULL;
    }
    return found;
}

static bool number_of(const config_setting_t *setting, double *value)
{
    switch (config_setting_type(setting)) {
    case CONFIG_TYPE_FLOAT:
        *value = config_setting_get_float(setting);
        return isfinite(*value);
    case CONFIG_TYPE_INT:
    case CONFIG_TYPE_INT64:
        *value = (double)config_setting_get_int64(setting);
        return true;
    default:
        return false;
    }
}

void settings_number(struct settings *s, const config_setting_t *in, const char *name,
                     enum settings_presence presence, double low, double high, double *value)
{
    double number;
    const config_setting_t *found = find(s, in, name, presence);
    if (!found)
        return;
    if (!number_of(found, &number))
        settings_fail(s, found, "\"%s\" must be a finite number", name);
    else if (!(number >= low && number <= high))
        settings_fail(s, found, "\"%s\" is %g: must be from %g to %g", name, number, low, high);
    else
        *value = number;
}

/* Past a text or a comment that begins here, its lines counted; NULL when none does. */
static const char *skip_text(const char *c, int *line)
{
    const char *end;
    if (*c == '"') {
        for (end = c + 1; *end && *end != '"'; end += end[0] == '\\' && end[1] ? 2 : 1)
            ;
        end += *end != '\0';
    } else if (*c == '#' || (c[0] == '/' && c[1] == '/')) {
        end = c + strcspn(c, "\n");
    } else if (c[0] == '/' && c[1] == '*') {
        end = strstr(c + 2, "*/");
        end = end ? end + 2 : c + strlen(c);
    } else {
        return NULL;
    }
    for (; c < end; c++)
        *line += *c == '\n';
    return end;
}

static int check_numbers(const char *file, const char *text, struct apc_error *why)
{
    static const char word[] = "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789_-*.+";
    int line = 1;
    for (const char *c = text, *next; *c; c = next) {
        if ((next = skip_text(c, &line)))
            continue;
        const size_t n = strspn(c, word), sign = *c == '-' || *c == '+';
        const size_t digits = strspn(c + sign, "0123456789");
        line += *c == '\n';
        next = c + (n > 0 ? n : 1);
        if (digits > 0 && sign + digits == n &&
            (digits > 10 || strtoll(c, NULL, 10) != (int32_t)strtoll(c, NULL, 10)))
            return apc_fail(why, APC_EINVAL, "%s:%d: %.*s is beyond 32 bits: write %.*s.0 or %.*sL", file,
                            line, (int)n, c, (int)n, c, (int)n, c);
    }
    return 0;
}

int settings_check_numbers(const char *file, struct apc_error *why)
{
    char *text = NULL;
    size_t size = 0;
    struct stat st;
    FILE *in = stat(file, &st) == 0 && S_ISREG(st.st_mode) ? fopen(file, "re") : NULL;
    if (!in)
        return 0; /* libconfig says why; a pipe can be read only once */
    int rc = getdelim(&text, &size, '\0', in) > 0 ? check_numbers(file, text, why) : 0;
    free(text);
    fclose(in);
    return rc;
}

void settings_whole(struct settings *s, const config_setting_t *in, const char *name,
                    enum settings_presence presence, int64_t low, int64_t high, int64_t *value)
{
    const config_setting_t *found = find(s, in, name, presence);
    if (!found)
        return;
    const int type = config_setting_type(found);
    int64_t whole = low - 1;
    if (type == CONFIG_TYPE_INT || type == CONFIG_TYPE_INT64)
        whole = config_setting_get_int64(found);
    if (whole < low || whole > high)
        settings_fail(s, found, "\"%s\" must be from %lld to %lld, a whole number", name, (long long)low,
                      (long long)high);
    else
        *value = whole;
}

void settings_period(struct settings *s, const config_setting_t *in, const char *name,
                     enum settings_presence presence, apc_ns *value)
{
    struct apc_error why;
    double seconds;
    const config_setting_t *found = find(s, in, name, presence);
    if (!found)
        return;
    if (!number_of(found, &seconds))
        settings_fail(s, found, "\"%s\" must be a number of seconds", name);
    else if (apc_period_from_s(seconds, value, &why) < 0)
        settings_fail(s, found, "\"%s\" of %s: %s", name, name_of(in), why.text);
}

void settings_flag(struct settings *s, const config_setting_t *in, const char *name, bool *value)
{
    const config_setting_t *found = find(s, in, name, OPTIONAL);
    if (!found)
        return;
    if (config_setting_type(found) != CONFIG_TYPE_BOOL)
        settings_fail(s, found, "\"%s\" must be true or false", name);
    else
        *value = config_setting_get_bool(found);
}

void settings_text(struct settings *s, const config_setting_t *in, const char *name,
                   enum settings_presence presence, char *value, size_t size)
{
    const config_setting_t *found = find(s, in, name, presence);
    if (!found)
        return;
    if (config_setting_type(found) != CONFIG_TYPE_STRING)
        settings_fail(s, found, "\"%s\" must be text in double quotes", name);
    else if (strlen(config_setting_get_string(found)) >= size)
        settings_fail(s, found, "\"%s\" is too long: at most %zu bytes", name, size - 1);
    else
        snprintf(value, size, "%s", config_setting_get_string(found));
}

void settings_name(struct settings *s, const config_setting_t *in, char *value, size_t size)
{
    settings_text(s, in, "name", REQUIRED, value, size);
    bool good = *value != '\0';
    for (const char *c = value; *c; c++)
        good = good && (unsigned char)*c >= ' ' && *c != 127;
    if (!s->failed && !good)
        settings_fail(s, config_setting_get_member(in, "name"),
                      "\"name\" must have at least one character, and no line breaks or tabs");
}

void settings_numbers(struct settings *s, const config_setting_t *array, size_t n, double *values)
{
    if (s->failed)
        return;
    if (!config_setting_is_aggregate(array) || config_setting_is_group(array) ||
        config_setting_length(array) != (int)n) {
        settings_fail(s, array, "expected %zu number%s in brackets", n, n == 1 ? "" : "s");
        return;
    }
    for (size_t i = 0; i < n; i++)
        if (!number_of(config_setting_get_elem(array, (unsigned)i), &values[i]))
            settings_fail(s, array, "element %zu must be a finite number", i + 1);
}

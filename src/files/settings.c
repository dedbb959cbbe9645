/* SPDX-License-Identifier: BSD-3-Clause */
#include "settings.h"

#include <ctype.h>
#include <errno.h>
#include <math.h>
#include <stddef.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "base/text.h"
#include "files.h"

#define FILE_MAX ((size_t)16 << 20)

int settings_fail(struct settings *s, const config_setting_t *at, const char *fmt, ...)
{
    char text[400];
    va_list args;
    if (s->failed)
        return s->failed;
    va_start(args, fmt);
    vsnprintf(text, sizeof text, fmt, args);
    va_end(args);
    unsigned line = at ? config_setting_source_line(at) : 0; /* the root has none */
    if (s->change)
        return s->failed = apc_fail(s->why, APC_EINVAL, "%s: %s", s->change, text);
    return s->failed = apc_fail(s->why, APC_EINVAL, "%s:%u: %s", s->file, line ? line : 1, text);
}

#define PLACE 80

/* "the file", the name of a group, or that of a list and which of its elements, as a path has it: alarms[0]. */
static const char *name_of_group(const config_setting_t *group, char place[PLACE])
{
    const config_setting_t *list = config_setting_parent(group);
    if (!list)
        return "the file";
    if (config_setting_name(group))
        return config_setting_name(group);
    snprintf(place, PLACE, "%s.[%d]", config_setting_name(list) ? config_setting_name(list) : "",
             config_setting_index(group));
    return place;
}

void settings_known(struct settings *s, const config_setting_t *group, const char *const *names)
{
    char list[384] = "", place[PLACE];
    if (s->failed || !group)
        return;
    for (int i = 0; i < config_setting_length(group); i++) {
        const config_setting_t *member = config_setting_get_elem(group, (unsigned)i);
        const char *const *known = names;
        struct nearest nearest = {.wanted = config_setting_name(member)};
        while (*known && strcmp(*known, nearest.wanted) != 0)
            known++;
        if (*known)
            continue;
        for (known = names; *known; known++) {
            size_t length = strlen(list);
            snprintf(list + length, sizeof list - length, "%s%s", length ? ", " : "", *known);
            nearest_look(&nearest, *known);
        }
        settings_fail(s, member, "unknown setting \"%s\" in %s; %s%s%s%s%s", nearest.wanted,
                      name_of_group(group, place), *list ? "known are: " : "there are none", list,
                      nearest.name ? "; did you mean \"" : "", nearest.name ? nearest.name : "",
                      nearest.name ? "\"?" : "");
        return;
    }
}

static config_setting_t *find_setting(struct settings *s, const config_setting_t *in, const char *name,
                                      enum settings_presence presence)
{
    char place[PLACE];
    if (s->failed)
        return NULL;
    config_setting_t *found = config_setting_get_member(in, name);
    if (!found && presence == REQUIRED)
        settings_fail(s, in, "\"%s\" is missing in %s", name, name_of_group(in, place));
    return found;
}

config_setting_t *settings_group(struct settings *s, const config_setting_t *in, const char *name,
                                 enum settings_presence presence)
{
    config_setting_t *found = find_setting(s, in, name, presence);
    if (found && !config_setting_is_group(found)) {
        settings_fail(s, found, "\"%s\" must be a group: %s = { ... };", name, name);
        return NULL;
    }
    return found;
}

config_setting_t *settings_list(struct settings *s, const config_setting_t *in, const char *name,
                                enum settings_presence presence)
{
    config_setting_t *found = find_setting(s, in, name, presence);
    if (found && !config_setting_is_list(found)) {
        settings_fail(s, found, "\"%s\" must be a list: %s = ( ... );", name, name);
        return NULL;
    }
    return found;
}

static bool number_of_setting(const config_setting_t *setting, double *value)
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
    const config_setting_t *found = find_setting(s, in, name, presence);
    if (found)
        settings_number_at(s, found, name, low, high, value);
}

void settings_number_at(struct settings *s, const config_setting_t *at, const char *name, double low,
                        double high, double *value)
{
    double number;
    if (!number_of_setting(at, &number))
        settings_fail(s, at, "\"%s\" must be a finite number", name);
    else if (!(number >= low) && high >= APC_VALUE_MAX)
        settings_fail(s, at, "\"%s\" is %.15g: must be at least %.15g", name, number, low);
    else if (!(number >= low && number <= high))
        settings_fail(s, at, "\"%s\" is %.15g: must be from %.15g to %.15g", name, number, low, high);
    else
        *value = number;
}

/* ---- Values by name --------------------------------------------------------------------- */

bool settings_is_word(const char *name)
{
    static const char letters[] = "*ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz-_0123456789";
    return *name && strspn(name, letters) == strlen(name) && !strchr("-_0123456789", *name);
}

const config_setting_t *settings_values(struct settings *s, const config_setting_t *in, const char *name)
{
    const config_setting_t *found = find_setting(s, in, name, OPTIONAL);
    if (!found || config_setting_is_group(found) || config_setting_is_list(found))
        return found;
    settings_fail(s, found,
                  "\"%s\" must be a group: %s = { NAME = VALUE; }, or a list: %s = ( { name = \"...\"; value "
                  "= VALUE; } )",
                  name, name, name);
    return NULL;
}

/* What @p element of such a list says its name is; NULL: it says none. */
static const char *name_said(const config_setting_t *element)
{
    const char *name = NULL;
    if (config_setting_is_group(element))
        config_setting_lookup_string(element, "name", &name);
    return name;
}

const config_setting_t *settings_value(struct settings *s, const config_setting_t *values, int i,
                                       const char **name)
{
    static const char *const known[] = {"name", "value", NULL};
    config_setting_t *const at = config_setting_get_elem(values, (unsigned)i);
    if (s->failed)
        return NULL;
    if (config_setting_is_group(values)) {
        *name = config_setting_name(at);
        return at;
    }
    *name = name_said(at);
    const config_setting_t *value = *name ? config_setting_get_member(at, "value") : NULL;
    if (!value)
        settings_fail(s, at, "expected a group: { name = \"...\"; value = ...; }");
    else
        settings_known(s, at, known);
    for (int k = 0; value && k < i; k++)
        if (!strcmp(name_said(config_setting_get_elem(values, (unsigned)k)), *name))
            settings_fail(s, at, "\"%s\" is there twice", *name);
    return s->failed ? NULL : value;
}

/* ---- The file --------------------------------------------------------------------------- */

/* The text in double quotes that begins at @p c: its end. */
static const char *end_of_text(const char *c)
{
    for (c++; *c && *c != '"'; c += c[0] == '\\' && c[1] ? 2 : 1)
        ;
    return c + (*c != '\0');
}

/* The comment that begins at @p c: its end; NULL when none does. */
static const char *end_of_comment(const char *c)
{
    if (*c == '#' || (c[0] == '/' && c[1] == '/'))
        return c + strcspn(c, "\n");
    if (c[0] != '/' || c[1] != '*')
        return NULL;
    const char *end = strstr(c + 2, "*/");
    return end ? end + 2 : c + strlen(c);
}

static int check_word(const char *file, int line, const char *word, size_t n, struct apc_error *why)
{
    const size_t sign = *word == '-' || *word == '+', digits = strspn(word + sign, "0123456789");
    if (digits == 0 || sign + digits != n ||
        (digits <= 10 && strtoll(word, NULL, 10) == (int32_t)strtoll(word, NULL, 10)))
        return 0;
    return apc_fail(why, APC_EINVAL, "%s:%d: %.*s is beyond 32 bits: write %.*s.0 or %.*sL", file, line,
                    (int)n, word, (int)n, word, (int)n, word);
}

/* The zeros before the digits of a number, which say nothing: libconfig 1.7 takes 010 for 8. */
static size_t leading_zeros(const char *number)
{
    const size_t zeros = strspn(number, "0");
    return zeros > 0 && !isdigit((unsigned char)number[zeros]) ? zeros - 1 : zeros;
}

/*
 * Take the comments out, but for their lines: libconfig needs minutes for one of some megabytes. A word is
 * looked at as it goes by, and a number is decimal whichever libconfig reads it.
 */
static int strip(const char *file, char *text, struct apc_error *why)
{
    static const char word[] = "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789_-*.+";
    char *to = text;
    int line = 1, rc = 0;
    for (const char *c = text, *end; *c && rc == 0; c = end) {
        const bool comment = (end = end_of_comment(c)) != NULL;
        if (*c == '@')
            return apc_fail(why, APC_EINVAL,
                            "%s:%d: @include is not allowed: an experiment is one file, which is "
                            "kept with its runs",
                            file, line);
        const size_t n = strspn(c, word);
        if (!comment && n > 0)
            rc = check_word(file, line, c, n, why);
        if (!comment)
            end = *c == '"' ? end_of_text(c) : c + (n > 0 ? n : 1);
        if (comment)
            *to++ = ' ';
        if (n > 0 && (*c == '-' || *c == '+'))
            *to++ = *c++;
        if (n > 0)
            c += leading_zeros(c);
        for (; c < end; c++) {
            line += *c == '\n';
            if (!comment || *c == '\n')
                *to++ = *c;
        }
    }
    *to = '\0';
    return rc;
}

/* What stands in a line. */
static void quote_line(const char *text, int number, char *line, size_t size)
{
    while (--number > 0 && (text = strchr(text, '\n')))
        text++;
    if (text)
        text += strspn(text, " \t\r");
    snprintf(line, size, "%.*s", text ? (int)strcspn(text, "\r\n") : 0, text ? text : "");
}

/* Texts go into files, pages and terminals: they are UTF-8, and say what they show. */
static int check_settings_text(const char *file, int line, const char *text, struct apc_error *why)
{
    char instead;

    for (size_t step; *text; text += step) {
        line += *text == '\n';
        step = text_step(text, &instead);
        if (utf8_length(text) == 0)
            return apc_fail(
                why, APC_EINVAL,
                "%s:%d: the byte 0x%02X is not UTF-8: save the file in UTF-8 (iconv -f LATIN1 -t UTF-8)",
                file, line, (unsigned char)*text);
        if (instead == '?')
            return apc_fail(
                why, APC_EINVAL,
                "%s:%d: the character U+%04X controls how text is shown and is no text: leave it out", file,
                line, (unsigned)text_code(text, step));
    }
    return 0;
}

/* Within a text in quotes it may be written as \x1b. */
static int check_values(const char *file, const config_setting_t *in, struct apc_error *why)
{
    const char *const text = config_setting_get_string(in);
    int rc = text ? check_settings_text(file, (int)config_setting_source_line(in), text, why) : 0;

    for (int i = 0; i < config_setting_length(in) && rc == 0; i++)
        rc = check_values(file, config_setting_get_elem(in, (unsigned)i), why);
    return rc;
}

static int parse_settings(config_t *config, const char *file, char *text, struct apc_error *why)
{
    char line[60];
    int rc = strip(file, text, why);
    if (rc == 0)
        rc = check_settings_text(file, 1, text, why);
    if (rc < 0)
        return rc;
    if (config_read_string(config, text) == CONFIG_TRUE)
        return check_values(file, config_root_setting(config), why);
    const int number = config_error_line(config);
    quote_line(text, number, line, sizeof line);
    if (!*line)
        return apc_fail(why, APC_EINVAL,
                        "%s:%d: %s: the file ends within a group, list or text that was begun", file, number,
                        config_error_text(config));
    return apc_fail(
        why, APC_EINVAL,
        "%s:%d: %s at \"%s\"; expected NAME = VALUE; (a ; or a bracket that is missing before it shows "
        "here, too)",
        file, number, config_error_text(config), line);
}

int settings_parse(config_t *config, const char *file, const char *text, struct apc_error *why)
{
    static const char mark[] = "\xef\xbb\xbf"; /* of an editor that says UTF-8 so */
    config_init(config);
    char *copy = strdup(text + (strncmp(text, mark, 3) == 0 ? 3 : 0));
    int rc =
        copy ? parse_settings(config, file, copy, why) : apc_fail(why, APC_ENOMEM, "%s: out of memory", file);
    free(copy);
    return rc;
}

int settings_read(const char *file, char **text, struct apc_error *why)
{
    int rc = 0;
    FILE *in = fopen(file, "re");
    *text = in ? malloc(FILE_MAX + 2) : NULL;
    if (!in)
        return apc_fail(why, APC_ENOTFOUND, "%s: cannot be read: %s", file, strerror(errno));
    const size_t n = *text ? fread(*text, 1, FILE_MAX + 1, in) : 0;
    if (!*text)
        rc = apc_fail(why, APC_ENOMEM, "%s: out of memory", file);
    else if (ferror(in))
        rc = apc_fail(why, APC_ESYS, "%s: cannot be read: %s", file, strerror(errno));
    else if (n > FILE_MAX)
        rc = apc_fail(why, APC_EINVAL, "%s: is larger than 16 MiB: that is no experiment file", file);
    else if (memchr(*text, 0, n))
        rc = apc_fail(why, APC_EINVAL, "%s: is no text: it has a byte 0", file);
    else
        (*text)[n] = '\0';
    fclose(in);
    if (rc == 0) { /* what it does not need would be locked in memory, and the heap would grow as large */
        char *fitting = realloc(*text, n + 1);
        if (fitting) {
            *text = fitting;
            return 0;
        }
        rc = apc_fail(why, APC_ENOMEM, "%s: out of memory", file);
    }
    free(*text);
    *text = NULL;
    return rc;
}

int settings_load(config_t *config, const char *file, struct apc_error *why)
{
    char *text;
    int rc = settings_read(file, &text, why);
    if (rc == 0)
        rc = settings_parse(config, file, text, why);
    else
        config_init(config);
    free(text);
    return rc;
}

void settings_whole(struct settings *s, const config_setting_t *in, const char *name,
                    enum settings_presence presence, int64_t low, int64_t high, int64_t *value)
{
    const config_setting_t *found = find_setting(s, in, name, presence);
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
    char place[PLACE];
    struct apc_error why;
    double seconds;
    const config_setting_t *found = find_setting(s, in, name, presence);
    if (!found)
        return;
    if (!number_of_setting(found, &seconds))
        settings_fail(s, found, "\"%s\" must be a number of seconds", name);
    else if (apc_period_from_s(seconds, value, &why) < 0)
        settings_fail(s, found, "\"%s\" of %s: %s", name, name_of_group(in, place), why.text);
}

void settings_flag(struct settings *s, const config_setting_t *in, const char *name, bool *value)
{
    const config_setting_t *found = find_setting(s, in, name, OPTIONAL);
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
    const config_setting_t *found = find_setting(s, in, name, presence);
    if (!found)
        return;
    if (config_setting_type(found) != CONFIG_TYPE_STRING)
        settings_fail(s, found, "\"%s\" must be text in double quotes", name);
    else if (strlen(config_setting_get_string(found)) >= size)
        settings_fail(s, found, "\"%s\" is too long: at most %zu bytes", name, size - 1);
    else /* in one line, also where the file has it in several */
        text_clean(value, config_setting_get_string(found), size);
}

/* TABLE.ID: what a variable is called without its name. */
static bool is_address(const char *name)
{
    const char *dot = strrchr(name, '.');
    char table[32];
    if (!dot || !dot[1] || dot[1 + strspn(dot + 1, "0123456789")] || dot - name >= (ptrdiff_t)sizeof table)
        return false;
    snprintf(table, sizeof table, "%.*s", (int)(dot - name), name);
    return apc_table_parse(table) != 0;
}

void settings_name(struct settings *s, const config_setting_t *in, char *value, size_t size)
{
    settings_text(s, in, "name", REQUIRED, value, size);
    const config_setting_t *const said = s->failed ? NULL : config_setting_get_member(in, "name");
    const bool good = *value != '\0' && said && strcmp(config_setting_get_string(said), value) == 0;
    if (!s->failed && !good)
        settings_fail(s, config_setting_get_member(in, "name"),
                      "\"name\" must have at least one character, and no line breaks or tabs");
    else if (!s->failed && (*value == '-' || strchr(value, '=') || is_address(value)))
        settings_fail(
            s, config_setting_get_member(in, "name"),
            "\"name\" is \"%s\": must not begin with -, have a = or be a TABLE.ID such as sensor.1, since a "
            "command would take it for something else",
            value);
}

void settings_numbers(struct settings *s, const config_setting_t *array, size_t n, double *values)
{
    if (s->failed)
        return;
    if (!config_setting_is_aggregate(array) || config_setting_is_group(array) ||
        config_setting_length(array) != (int)n) {
        const char *name = config_setting_name(array);
        settings_fail(s, array, "%s%s%sexpected %zu number%s in brackets", name ? "\"" : "", name ? name : "",
                      name ? "\": " : "", n, PLURAL(n));
        return;
    }
    for (size_t i = 0; i < n; i++)
        if (!number_of_setting(config_setting_get_elem(array, (unsigned)i), &values[i]))
            settings_fail(s, array, "element %zu must be a finite number", i + 1);
}

void settings_put_text(FILE *out, const char *text)
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

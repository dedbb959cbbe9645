/* SPDX-License-Identifier: BSD-3-Clause */
#include "json.h"

#include <inttypes.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "base/text.h"
#include "files/files.h"

/* ---- Text --------------------------------------------------------------------------------- */

void text_free(struct text *t)
{
    free(t->at);
    *t = (struct text){0};
}

static bool reserve_text(struct text *t, size_t n)
{
    if (t->failed)
        return false;
    if (t->n + n <= t->room)
        return true;
    size_t room = 2 * (t->n + n) + 256;
    char *at = realloc(t->at, room);
    if (!at) {
        text_free(t);
        t->failed = true;
        return false;
    }
    t->at = at;
    t->room = room;
    return true;
}

void text_put(struct text *t, const char *data, size_t n)
{
    if (n == 0 || !reserve_text(t, n))
        return;
    memcpy(t->at + t->n, data, n);
    t->n += n;
}

void text_add(struct text *t, const char *fmt, ...)
{
    va_list args, again;
    va_start(args, fmt);
    va_copy(again, args);
    int n = vsnprintf(NULL, 0, fmt, args);
    if (n >= 0 && reserve_text(t, (size_t)n + 1)) {
        vsnprintf(t->at + t->n, (size_t)n + 1, fmt, again);
        t->n += (size_t)n;
    }
    va_end(again);
    va_end(args);
}

void text_chop(struct text *t, char last)
{
    if (t->n > 0 && t->at[t->n - 1] == last)
        t->n--;
}

/* ---- JSON out ----------------------------------------------------------------------------- */

void json_string_add(struct text *t, const char *string)
{
    if (!string) {
        text_put(t, "null", 4);
        return;
    }
    text_put(t, "\"", 1);
    char instead;
    for (size_t n; *string; string += n) {
        n = text_step(string, &instead);
        if (*string == '"' || *string == '\\')
            text_add(t, "\\%c", *string);
        else if (instead && utf8_length(string) > 0)
            text_add(t, "\\u%04x", (unsigned)text_code(string, n));
        else if (instead)
            text_put(t, "\xEF\xBF\xBD", 3);
        else
            text_put(t, string, n);
    }
    text_put(t, "\"", 1);
}

void json_number_add(struct text *t, double value)
{
    char text[DECIMAL_LEN];
    const char *number = isfinite(value) ? decimal_shortest(value + 0.0, 15, text) : "null";
    text_put(t, number, strlen(number));
}

void json_limit_add(struct text *t, double limit)
{
    json_number_add(t, fabs(limit) < APC_VALUE_MAX ? limit : (double)NAN);
}

const char *json_truth(bool is)
{
    return is ? "true" : "false";
}

void json_time_add(struct text *t, apc_ns utc)
{
    apc_ns us = utc / APC_NS_PER_US, part = us % 1000000;
    text_add(t, "%s%" PRId64 ".%06" PRId64, utc < 0 && us / 1000000 == 0 ? "-" : "", us / 1000000,
             part < 0 ? -part : part);
}

void json_seconds_add(struct text *t, apc_ns duration)
{
    text_add(t, "%.9g", apc_ns_to_s(duration));
}

void json_sample_add(struct text *t, const struct apc_sample *sample)
{
    char status[APC_STATUS_NAME_LEN];
    text_add(t, "[%" PRId64 ",", sample->seq);
    if (sample->seq > 0) {
        json_time_add(t, sample->time);
        text_put(t, ",", 1);
        json_number_add(t, sample->value);
    } else {
        text_put(t, "null,null", 9);
    }
    text_add(t, ",\"%s\"]", apc_status_format(sample->seq > 0 ? sample->status : APC_BAD_NO_DATA, status));
}

/* ---- JSON in ------------------------------------------------------------------------------ */

bool fault_set(struct fault *f, int http, const char *code, const char *field, const char *fmt, ...)
{
    va_list args;
    if (f->http)
        return false;
    f->http = http;
    f->code = code;
    snprintf(f->field, sizeof f->field, "%s", field ? field : "");
    va_start(args, fmt);
    vsnprintf(f->message, sizeof f->message, fmt, args);
    va_end(args);
    return false;
}

bool members_known(const json_t *object, const char *const *members, struct fault *f)
{
    const char *name;
    json_t *value;
    /* jansson's iteration wants a non-const object and does not change it */
    json_object_foreach((json_t *)(uintptr_t)object, name, value)
    {
        const char *const *known = members;
        while (*known && strcmp(*known, name) != 0)
            known++;
        if (!*known)
            return fault_set(f, 400, "json", name, "\"%.40s\" is not known here", name);
    }
    return true;
}

json_t *body_parse(const char *body, size_t n, const char *const *members, struct fault *f)
{
    json_error_t error;
    if (n == 0) {
        fault_set(f, 400, "json", NULL, "the request is empty: it must be a JSON object: {...}");
        return NULL;
    }
    json_t *root = json_loadb(body, n, JSON_REJECT_DUPLICATES, &error);
    if (!root) {
        fault_set(f, 400, "json", NULL, "the request is no JSON: line %d: %.120s", error.line, error.text);
        return NULL;
    }
    if (!json_is_object(root))
        fault_set(f, 400, "json", NULL, "the request must be a JSON object: {...}");
    else if (members_known(root, members, f))
        return root;
    json_decref(root);
    return NULL;
}

static const json_t *find_member(const json_t *object, const char *name, struct fault *f)
{
    const json_t *value = json_object_get(object, name);
    if (!value)
        fault_set(f, 400, "json", name, "\"%s\" is missing", name);
    return value;
}

bool member_number(const json_t *object, const char *name, double *value, struct fault *f)
{
    const json_t *found = find_member(object, name, f);
    if (!found)
        return false;
    if (!json_is_number(found) || !isfinite(json_number_value(found))) {
        char *is = json_dumps(found, JSON_ENCODE_ANY);
        fault_set(f, 422, "value", name, "\"%s\": %.60s is not a finite number", name, is ? is : "this");
        free(is);
        return false;
    }
    *value = json_number_value(found);
    return true;
}

/* 5.0 is the same number as 5; beyond 2^53 a double no longer tells one from the next. */
static bool whole_value(const json_t *found, int64_t *value)
{
    const double number = json_number_value(found);
    if (json_is_integer(found))
        *value = json_integer_value(found);
    else if (json_is_real(found) && fabs(number) <= (double)APC_SEQ_MAX && !(number > floor(number)))
        *value = (int64_t)number;
    else
        return false;
    return true;
}

bool member_whole(const json_t *object, const char *name, int64_t low, int64_t high, int64_t *value,
                  struct fault *f)
{
    const json_t *found = find_member(object, name, f);
    int64_t whole = 0;
    if (!found)
        return false;
    if (!whole_value(found, &whole) || whole < low || whole > high)
        return fault_set(f, 400, "json", name, "\"%s\" must be a whole number from %" PRId64 " to %" PRId64,
                         name, low, high);
    *value = whole;
    return true;
}

bool member_text(const json_t *object, const char *name, const char **text, struct fault *f)
{
    const json_t *found = find_member(object, name, f);
    if (!found)
        return false;
    if (!json_is_string(found))
        return fault_set(f, 400, "json", name, "\"%s\" must be text in double quotes", name);
    *text = json_string_value(found);
    return true;
}

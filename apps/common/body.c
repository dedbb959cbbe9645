/* SPDX-License-Identifier: BSD-3-Clause */
#include "body.h"

#include <inttypes.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

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

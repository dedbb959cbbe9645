/* SPDX-License-Identifier: BSD-3-Clause */
#include "schema.h"

#include <stdbool.h>
#include <stdio.h>
#include <string.h>

#include "check.h"

const json_t *schema_resolve(const json_t *root, const json_t *one)
{
    const char *ref = json_string_value(json_object_get(one, "$ref"));
    const json_t *found = root;
    char part[64];
    int n = 0;
    if (!ref)
        return one;
    for (const char *at = ref + 1; sscanf(at, "/%63[^/]%n", part, &n) == 1; at += n)
        found = json_object_get(found, part);
    if (!found)
        fail_msg("openapi.json has no %s", ref);
    return schema_resolve(root, found);
}

static bool is_type(const char *type, const json_t *value)
{
    return (!strcmp(type, "object") && json_is_object(value)) ||
           (!strcmp(type, "array") && json_is_array(value)) ||
           (!strcmp(type, "string") && json_is_string(value)) ||
           (!strcmp(type, "integer") && json_is_integer(value)) ||
           (!strcmp(type, "number") && json_is_number(value)) ||
           (!strcmp(type, "boolean") && json_is_boolean(value)) ||
           (!strcmp(type, "null") && json_is_null(value));
}

static bool type_fits(const json_t *type, const json_t *value)
{
    size_t i;
    const json_t *one;
    if (!type || json_is_string(type))
        return !type || is_type(json_string_value(type), value);
    json_array_foreach(type, i, one) if (is_type(json_string_value(one), value)) return true;
    return false;
}

static bool enum_fits(const json_t *list, const json_t *value)
{
    size_t i;
    const json_t *one;
    json_array_foreach(list, i, one) if (json_equal(one, value)) return true;
    return !list;
}

static void check_object(const json_t *root, const json_t *schema, const json_t *value, const char *where)
{
    const json_t *properties = json_object_get(schema, "properties"),
                 *required = json_object_get(schema, "required"),
                 *others = json_object_get(schema, "additionalProperties"), *name;
    size_t i;
    json_array_foreach(required, i, name) if (!json_object_get(value, json_string_value(name)))
        fail_msg("%s: \"%s\" is missing", where, json_string_value(name));
    for (void *at = json_object_iter((json_t *)(uintptr_t)value); at;
         at = json_object_iter_next((json_t *)(uintptr_t)value, at)) {
        char inner[300];
        const char *key = json_object_iter_key(at);
        const json_t *property = json_object_get(properties, key);
        snprintf(inner, sizeof inner, "%.200s.%s", where, key);
        if (property)
            schema_check(root, property, json_object_iter_value(at), inner);
        else if (json_is_object(others))
            schema_check(root, others, json_object_iter_value(at), inner);
        else if (json_is_false(others))
            fail_msg("%s is not in openapi.json", inner);
    }
}

static void check_array(const json_t *root, const json_t *schema, const json_t *value, const char *where)
{
    const json_t *least = json_object_get(schema, "minItems"), *most = json_object_get(schema, "maxItems"),
                 *one;
    size_t i, n = json_array_size(value);
    if ((least && n < (size_t)json_integer_value(least)) || (most && n > (size_t)json_integer_value(most)))
        fail_msg("%s has %zu elements", where, n);
    json_array_foreach(value, i, one)
    {
        char inner[300];
        snprintf(inner, sizeof inner, "%.200s[%zu]", where, i);
        schema_check(root, json_object_get(schema, "items"), one, inner);
    }
}

void schema_check(const json_t *root, const json_t *schema, const json_t *value, const char *where)
{
    const json_t *choices = json_object_get(schema, "oneOf");
    if (choices) { /* here always: something, or null */
        if (json_is_null(value))
            return;
        schema_check(root, json_array_get(choices, 0), value, where);
        return;
    }
    schema = schema_resolve(root, schema);
    char *text = json_dumps(value, JSON_ENCODE_ANY | JSON_COMPACT);
    assert_non_null(text);
    if (!type_fits(json_object_get(schema, "type"), value) ||
        !enum_fits(json_object_get(schema, "enum"), value))
        fail_msg("%s is %.80s: not what openapi.json says", where, text);
    free(text);
    if (json_is_object(value))
        check_object(root, schema, value, where);
    else if (json_is_array(value))
        check_array(root, schema, value, where);
}

/* SPDX-License-Identifier: BSD-3-Clause */
#include "files.h"

#include <ctype.h>
#include <inttypes.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "base/text.h"

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
    if (n == 0)
        return;
    t->last = data[n - 1];
    if (t->out) {
        for (size_t i = 0; i < n; i++) /* they are a few, and a lock for each call would take longer */
            putc_unlocked(data[i], t->out);
    } else if (reserve_text(t, n)) {
        memcpy(t->at + t->n, data, n);
        t->n += n;
    }
}

void text_add(struct text *t, const char *fmt, ...)
{
    va_list args, again;
    va_start(args, fmt);
    va_copy(again, args);
    int n = vsnprintf(NULL, 0, fmt, args);
    if (n > 0 && reserve_text(t, (size_t)n + 1)) {
        vsnprintf(t->at + t->n, (size_t)n + 1, fmt, again);
        t->n += (size_t)n;
        t->last = t->at[t->n - 1];
    }
    va_end(again);
    va_end(args);
}

/* ---- JSON --------------------------------------------------------------------------------- */

/* A comma is due before what comes next, if a value ends here. */
static void separate(struct text *t)
{
    if (isalnum((unsigned char)t->last) || t->last == '"' || t->last == '}' || t->last == ']')
        text_put(t, ",", 1);
}

static void put_json_token(struct text *t, const char *token)
{
    separate(t);
    text_put(t, token, strlen(token));
}

static void put_json_string(struct text *t, const char *string)
{
    char instead, code[8];
    put_json_token(t, "\"");
    for (size_t n; *string; string += n) {
        n = text_step(string, &instead);
        if (*string == '"' || *string == '\\')
            text_put(t, "\\", 1);
        if (!instead)
            text_put(t, string, n);
        else if (utf8_length(string) > 0)
            text_put(
                t, code,
                (size_t)snprintf(code, sizeof code, "\\u%04x", (unsigned)text_code(string, n) & 0xFFFFu));
        else
            text_put(t, "\xEF\xBF\xBD", 3);
    }
    text_put(t, "\"", 1);
}

/* @precision: -1 for the shortest that reads back the same. */
static void put_json_number(struct text *t, double value, char form, int precision)
{
    char number[400];
    if (!isfinite(value) || (form == 'e' && fabs(value) >= APC_VALUE_MAX))
        put_json_token(t, "null");
    else if (precision < 0)
        put_json_token(t, decimal_shortest(value + 0.0, 15, number));
    else if (snprintf(number, sizeof number, form == 'f' ? "%.*f" : "%.*g", precision, value) > 0)
        put_json_token(t, number);
}

static void put_json_time(struct text *t, apc_ns utc)
{
    const apc_ns us = utc / APC_NS_PER_US, part = us % 1000000;
    char number[32];
    snprintf(number, sizeof number, "%s%" PRId64 ".%06" PRId64, utc < 0 && us / 1000000 == 0 ? "-" : "",
             us / 1000000, part < 0 ? -part : part);
    put_json_token(t, number);
}

static void put_json_whole(struct text *t, bool negative, uintmax_t size)
{
    char number[24];
    snprintf(number, sizeof number, "%s%ju", negative ? "-" : "", size);
    put_json_token(t, number);
}

static void put_json_int(struct text *t, intmax_t value, int precision)
{
    if (value == JSON_NONE)
        put_json_token(t, "null");
    else if (precision == 6)
        put_json_time(t, value);
    else if (precision > 0)
        put_json_number(t, apc_ns_to_s(value), 'g', precision);
    else
        put_json_whole(t, value < 0, value < 0 ? -(uintmax_t)value : (uintmax_t)value);
}

/* One conversion, from behind its %. Returns what is behind it. */
static const char *put_json_argument(struct text *t, const char *c, va_list *args)
{
    const bool some = *c == '-';
    int precision = -1;
    c += some;
    if (*c == '.' && c[1] == '*') {
        const int n = va_arg(*args, int);
        if (n > 0)
            separate(t);
        text_put(t, va_arg(*args, const char *), (size_t)n);
        return c + 3;
    }
    if (*c == '.') {
        precision = c[1] - '0';
        c += 2;
    }
    const char size = *c == 'j' || *c == 'z' ? *c++ : '\0';
    if (*c == 's') {
        const char *string = va_arg(*args, const char *);
        string && (*string || !some) ? put_json_string(t, string) : put_json_token(t, "null");
    } else if (*c == 'i') {
        const int is = va_arg(*args, int);
        put_json_token(t, is < 0 ? "null" : is ? "true" : "false");
    } else if (*c == 'd') {
        put_json_int(t, size ? va_arg(*args, intmax_t) : va_arg(*args, int), precision);
    } else if (*c == 'u') {
        put_json_whole(t, false,
                       size == 'z'   ? va_arg(*args, size_t)
                       : size == 'j' ? va_arg(*args, uintmax_t)
                                     : va_arg(*args, unsigned));
    } else {
        put_json_number(t, va_arg(*args, double), *c, precision);
    }
    return c + 1;
}

void json_add(struct text *t, const char *fmt, ...)
{
    va_list args;
    va_start(args, fmt);
    while (*fmt) {
        size_t n = 0;
        while (isalnum((unsigned char)fmt[n]) || fmt[n] == '_')
            n++;
        const bool key = fmt[n] == ':';
        if (n > 0) {
            separate(t);
            text_put(t, "\"", key);
            text_put(t, fmt, n);
            text_put(t, "\"", key);
            fmt += n;
        } else if (*fmt == '%') {
            fmt = put_json_argument(t, fmt + 1, &args);
        } else {
            if (*fmt == ',' || *fmt == '{' || *fmt == '[')
                separate(t);
            text_put(t, fmt, *fmt != ',' && *fmt != ' ');
            fmt++;
        }
    }
    va_end(args);
}

void json_text_add(struct text *t, const struct text *json)
{
    json_add(t, json->n > 0 ? "%.*s" : "null", (int)json->n, json->at);
}

void json_sample_add(struct text *t, const struct apc_sample *sample)
{
    const bool is = sample->seq > 0;
    char status[APC_STATUS_NAME_LEN];
    json_add(t, "[%jd, %.6jd, %g, %s]", sample->seq, is ? sample->time : JSON_NONE,
             is ? sample->value : (double)NAN,
             apc_status_format(is ? sample->status : APC_BAD_NO_DATA, status));
}

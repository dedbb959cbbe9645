/* SPDX-License-Identifier: BSD-3-Clause */
/* JSON out: into a growing text, or into a file as it is made. */
#ifndef APC_APPS_JSON_H
#define APC_APPS_JSON_H

#include <stdio.h>

#include <apcbase.h>

/* Zeroed: empty. Out of memory makes it `failed` and leaves it empty; later calls do nothing. With `out`, all
 * that is put goes there at once, nothing is allocated, and ferror() tells whether it could be written. */
struct text {
    char *at; /* not terminated */
    size_t n, room;
    bool failed;
    char last; /* the last character that was put */
    FILE *out;
};

void text_free(struct text *t);
void text_put(struct text *t, const char *data, size_t n);
void text_add(struct text *t, const char *fmt, ...) APC_PRINTF(2, 3); /* without `out` */

#define JSON_NONE INT64_MIN
/* Of times and durations that are above 0 where there is one. */
static inline apc_ns json_some(apc_ns ns)
{
    return ns > 0 ? ns : JSON_NONE;
}

/*
 * JSON as @p fmt draws it: json_add(t, "{name:%s, limits:[%g, %g]}", ...). Names need no quotes. Commas come
 * by themselves wherever a value follows another one, also one of a call before; blanks are left out. Arguments
 * are those of printf, so that compilers check them:
 *
 *   %s                   text, escaped; what is not UTF-8 becomes U+FFFD; NULL: null. Before a colon: a name
 *   %-s                  text; "" becomes null, too
 *   %d %jd %u %zu %ju    a whole number; JSON_NONE: null
 *   %i                   true or false; below 0: null
 *   %g                   the shortest number that reads back the same; %.3f, %.9g: so many digits; %e: a limit,
 *                        null where there is none. What is no finite number becomes null
 *   %.6jd                a time as seconds since 1970 with six decimals
 *   %.9jd                a duration, an apc_ns as well, as seconds with nine digits
 *   %.*s                 so many bytes of JSON
 */
void json_add(struct text *t, const char *fmt, ...) APC_PRINTF(2, 3);
void json_text_add(struct text *t, const struct text *json);           /* what was made before; empty: null */
void json_sample_add(struct text *t, const struct apc_sample *sample); /* [seq, time, value, status] */

#endif

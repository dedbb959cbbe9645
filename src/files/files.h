/* SPDX-License-Identifier: BSD-3-Clause */
/* Files of rows and numbers as text, and what goes with reading them. */
#ifndef APC_FILES_H
#define APC_FILES_H

#include <stdbool.h>
#include <stddef.h>
#include <stdio.h>

#include <apcbase.h>

/* ---- Csv ------------------------------------------------------------------------------------ */

/*
 * Tables of text by RFC 4180: a row of names, and rows of as many fields. The names decide whether ',', ';'
 * or a tab is between fields. A field in quotes may have these, doubled quotes and ends of lines. Lines end
 * with LF, CR LF or CR; blanks around fields, a byte order mark, and rows without anything are passed over.
 * Numbers have a point, or throughout the file a comma: within quotes, or where ';' or a tab is between
 * fields.
 *
 * What may mean one thing or another is refused, with FILE:LINE, the column and the reason.
 */

struct csv;

/* Open a file and read its names. Returns 0, APC_ENOTFOUND, APC_ESYS, APC_EPROTO or APC_ENOMEM; *csv is NULL
 * unless 0. */
int csv_open(struct csv **csv, const char *path, struct apc_error *why);
void csv_close(struct csv *csv);
/* The next row. Returns 1, 0: there is none more and no number was in doubt, or a negative error. */
int csv_next(struct csv *csv, struct apc_error *why);

size_t csv_columns(const struct csv *csv);
const char *csv_name(const struct csv *csv, size_t column);
/* What stands there, until the next row; "" where nothing does. */
const char *csv_text(const struct csv *csv, size_t column);
/* Nothing, or NaN, in any case. */
bool csv_missing(const struct csv *csv, size_t column);
/* Returns 0 or APC_EPROTO. */
int csv_number(struct csv *csv, size_t column, double *value, struct apc_error *why);

/* The line where the row begins, the names' being 1. */
size_t csv_line(const struct csv *csv);
/* Rows without anything that were passed over on the way to this one. */
size_t csv_passed(const struct csv *csv);
/* Did the last line of the file have an end? What programs write always does. */
bool csv_ended(const struct csv *csv);
/* APC_EPROTO for the row that was read, and what is wrong with it. */
int csv_refuse(const struct csv *csv, struct apc_error *why, const char *format, ...)
    __attribute__((format(printf, 3, 4)));
/* The same for one of its fields. */
int csv_refuse_field(const struct csv *csv, size_t column, struct apc_error *why, const char *format, ...)
    __attribute__((format(printf, 4, 5)));
/* Text as a field: in one line and as it is to be shown (base/text.h), in quotes where it needs them; always. */
void csv_put(FILE *out, const char *text);
void csv_put_quoted(FILE *out, const char *text);
/* Are the names these, which are parted by ',' here? Returns 0 or APC_EPROTO. */
int csv_expect(const struct csv *csv, const char *names, struct apc_error *why);

/* ---- Decimal -------------------------------------------------------------------------------- */

/* Decimal numbers as programs write them, to the last digit, several times as fast as by strtod(). */

/* The number that begins at @p from, and in @p end where it ends: at the first character that belongs to
 * none. Behind it 8 bytes must be there to be read. Returns whether there is one. */
bool decimal_take(const char *from, const char **end, double *value);

#define DECIMAL_LEN 48
/* The shortest text of @p digits or more that is read as the same number, in any locale. Returns @p text. */
char *decimal_shortest(double value, int digits, char text[DECIMAL_LEN]);

/* ---- JSON ----------------------------------------------------------------------------------- */

/* JSON out: into a growing text, or into a file as it is made. */

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

/* ---- Block ---------------------------------------------------------------------------------- */

/* The block that @p array points at, of malloc(), gets room for @p n elements of @p size bytes; a large one
 * in large pages, if the kernel has some: else each of the small ones is a fault when it is first written,
 * which takes longer than what is written. Returns false, with the block as it was: out of memory. */
bool apc_grow(void *array, size_t n, size_t size);

/* ---- Former names ------------------------------------------------------------------------- */

/* Tuning and settings of laws that were called otherwise in the version before. The former names are taken for
 * one version more, where a law has the present one and not the former. */

/* The present name of what was called @p name; NULL: nothing was. */
const char *former_name(const char *name);
/* The former name of @p present; NULL: it has none. */
const char *former_of(const char *present);
/* Is @p name, as `v1.move`, the former name of @p present? */
bool former_is(const char *name, const char *present);

/* ---- Nearest -------------------------------------------------------------------------------- */

/* Of several names, the one that is most like another; to be begun with the other in `wanted`. */
struct nearest {
    const char *wanted, *name; /* name: NULL when none is alike */
    size_t edits;
};
void nearest_look(struct nearest *nearest, const char *name);

#endif

/* SPDX-License-Identifier: BSD-3-Clause */
#include "files.h"

#include <errno.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <strings.h>

#include "base/text.h"

#define ROW_MOST    (1 << 20) /* bytes; more is a quote without its mate */
#define NUMBER_MOST 400

struct field {
    size_t at; /* in text */
    bool quoted;
};

struct csv {
    FILE *in;
    char *path;
    char *text; /* of the row */
    size_t n, room;
    struct field *field;
    size_t fields, field_room;
    char *names; /* [columns] one behind the other */
    size_t *name;
    size_t columns;
    size_t line, next; /* of the row, of what follows */
    char separator;
    size_t passed; /* rows without anything */
    bool ended;
    char mark;         /* decimal: of the numbers so far; 0: none had one */
    size_t mark_line;  /* where it first stood */
    size_t doubt_line; /* 0: none; a comma that may part thousands */
    size_t doubt_column;
    char doubt[40];
};

/* ---- What is wrong ------------------------------------------------------------------------- */

static int __attribute__((format(printf, 4, 0)))
refuse_csv(const struct csv *csv, struct apc_error *why, const char *column, const char *format, va_list ap)
{
    char text[300];

    vsnprintf(text, sizeof text, format, ap);
    return apc_fail(why, APC_EPROTO, "%s:%zu: %s%s", csv->path, csv->line, column, text);
}

int csv_refuse(const struct csv *csv, struct apc_error *why, const char *format, ...)
{
    va_list ap;

    va_start(ap, format);
    const int rc = refuse_csv(csv, why, "", format, ap);
    va_end(ap);
    return rc;
}

int csv_refuse_field(const struct csv *csv, size_t column, struct apc_error *why, const char *format, ...)
{
    char name[120];
    va_list ap;

    if (column < csv->columns && csv_name(csv, column)[0])
        snprintf(name, sizeof name, "column \"%.80s\": ", csv_name(csv, column));
    else
        snprintf(name, sizeof name, "column %zu: ", column + 1);
    va_start(ap, format);
    const int rc = refuse_csv(csv, why, name, format, ap);
    va_end(ap);
    return rc;
}

static int no_csv_memory(const struct csv *csv, struct apc_error *why)
{
    return apc_fail(why, APC_ENOMEM, "%s: out of memory", csv->path);
}

/* ---- Rows as they stand in the file ----------------------------------------------------------- */

static bool put_csv_byte(struct csv *csv, char c)
{
    if (csv->n == csv->room) {
        const size_t room = csv->room ? 2 * csv->room : 256;
        char *const text = realloc(csv->text, room);

        if (!text)
            return false;
        csv->text = text;
        csv->room = room;
    }
    csv->text[csv->n++] = c;
    return true;
}

/* The end of a line after its first character: CR LF is one. */
static void end_line(struct csv *csv, int c)
{
    if (c == '\r') {
        const int after = getc_unlocked(csv->in);

        if (after != '\n' && after != EOF)
            ungetc(after, csv->in);
    }
    csv->next++;
}

/* The bytes of the next row, up to an end of line that is not within quotes. Returns 1, 0: the file is at its
 * end, or a negative error. */
static int gather_csv_row(struct csv *csv, struct apc_error *why)
{
    bool quoted = false;
    int c;

    csv->n = 0;
    csv->line = csv->next;
    while ((c = getc_unlocked(csv->in)) != EOF && (quoted || (c != '\n' && c != '\r'))) {
        quoted ^= c == '"';
        csv->next += c == '\n';
        if (c == 0)
            return csv_refuse(csv, why, "a byte 0 is in it: the file must be text in UTF-8");
        if (csv->n == ROW_MOST)
            return csv_refuse(csv, why, "the row has more than %d bytes: is a quote missing?", ROW_MOST);
        if (!put_csv_byte(csv, (char)c))
            return no_csv_memory(csv, why);
    }
    if (c == EOF && ferror(csv->in))
        return apc_fail(why, APC_ESYS, "%s: cannot be read: %s", csv->path, strerror(errno));
    if (c == EOF && csv->n == 0)
        return 0;
    csv->ended = c != EOF;
    if (c != EOF)
        end_line(csv, c);
    return put_csv_byte(csv, '\0') ? 1 : no_csv_memory(csv, why);
}

static int check_csv_text(const struct csv *csv, struct apc_error *why)
{
    for (size_t at = 0, step; csv->text[at]; at += step)
        if ((step = utf8_length(csv->text + at)) == 0)
            return csv_refuse(
                csv, why, "the byte 0x%02X is not UTF-8: save the file in UTF-8 (iconv -f LATIN1 -t UTF-8)",
                (unsigned char)csv->text[at]);
    return 0;
}

/* ---- Fields ----------------------------------------------------------------------------------- */

static bool is_blank(const struct csv *csv, char c)
{
    return c == ' ' || (c == '\t' && csv->separator != '\t');
}

static bool begin_field(struct csv *csv, size_t at)
{
    if (csv->fields == csv->field_room) {
        const size_t room = csv->field_room ? 2 * csv->field_room : 16;
        struct field *const field = reallocarray(csv->field, room, sizeof *field);

        if (!field)
            return false;
        csv->field = field;
        csv->field_room = room;
    }
    csv->field[csv->fields++] = (struct field){at, csv->text[at] == '"'};
    return true;
}

/* From behind the opening quote; the text moves to where that was. Returns where it goes on, 0: it has no
 * end. */
static size_t take_quoted(struct csv *csv, size_t from)
{
    char *const text = csv->text;
    size_t to = from - 1;

    for (; text[from]; from++) {
        if (text[from] == '"' && text[++from] != '"') {
            text[to] = '\0';
            return from;
        }
        text[to++] = text[from];
    }
    return 0;
}

/* Cut the row into its fields. */
static int split_csv_row(struct csv *csv, struct apc_error *why)
{
    char *const text = csv->text;
    size_t at = 0;

    csv->fields = 0;
    for (;;) {
        const size_t column = csv->fields;

        while (is_blank(csv, text[at]))
            at++;
        if (!begin_field(csv, at))
            return no_csv_memory(csv, why);
        size_t end = at;
        if (text[at] == '"') {
            at = take_quoted(csv, at + 1);
            if (at == 0)
                return csv_refuse_field(csv, column, why, "a quote is opened and not closed");
            while (is_blank(csv, text[at]))
                at++;
            if (text[at] && text[at] != csv->separator)
                return csv_refuse_field(
                    csv, column, why, "\"%.20s\" follows the closing quote; a quote within a text is doubled",
                    text + at);
        } else {
            for (; text[at] && text[at] != csv->separator; at++) {
                if (text[at] == '"')
                    return csv_refuse_field(csv, column, why,
                                            "a quote stands within a field that does not begin with one");
                end = is_blank(csv, text[at]) ? end : at + 1;
            }
        }
        const bool last = text[at] == '\0';
        if (!csv->field[column].quoted)
            text[end] = '\0';
        if (last)
            return 0;
        at++;
    }
}

static bool is_empty_csv_row(const struct csv *csv)
{
    for (size_t i = 0; i < csv->fields; i++)
        if (csv_text(csv, i)[0])
            return false;
    return true;
}

/* A row that has something. Returns as gather_csv_row(). */
static int take_csv_row(struct csv *csv, struct apc_error *why)
{
    int rc;

    csv->passed = 0;
    for (;; csv->passed++) {
        rc = gather_csv_row(csv, why);
        if (rc <= 0)
            return rc;
        rc = check_csv_text(csv, why);
        if (rc == 0)
            rc = split_csv_row(csv, why);
        if (rc < 0)
            return rc;
        if (!is_empty_csv_row(csv))
            return 1;
    }
}

/* ---- Names --------------------------------------------------------------------------------------- */

/* What is between the names: the one of them that is there outside of quotes. */
static int find_separator(struct csv *csv, struct apc_error *why)
{
    static const char of[] = ",;\t";
    bool quoted = false, there[3] = {false};

    for (const char *c = csv->text; *c; c++) {
        const char *const is = strchr(of, *c);

        quoted ^= *c == '"';
        if (is && !quoted)
            there[is - of] = true;
    }
    if (there[0] + there[1] + there[2] > 1)
        return csv_refuse(csv, why,
                          "%s are both in the row of names: put names that have one of them in quotes",
                          !there[0]  ? "\";\" and tabs"
                          : there[1] ? "\",\" and \";\""
                                     : "\",\" and tabs");
    csv->separator = there[1] ? ';' : there[2] ? '\t' : ',';
    return 0;
}

static int take_csv_names(struct csv *csv, struct apc_error *why)
{
    int rc;

    do { /* the row of names is the first that has more than blanks */
        rc = gather_csv_row(csv, why);
    } while (rc > 0 && csv->text[strspn(csv->text, " \t")] == '\0');
    if (rc == 0)
        return apc_fail(why, APC_EPROTO, "%s:1: it is empty; expected a row of names", csv->path);
    if (rc > 0)
        rc = check_csv_text(csv, why);
    if (rc == 0)
        rc = find_separator(csv, why);
    if (rc == 0)
        rc = split_csv_row(csv, why);
    if (rc < 0)
        return rc;
    csv->names = malloc(csv->n);
    csv->name = calloc(csv->fields, sizeof *csv->name);
    if (!csv->names || !csv->name)
        return no_csv_memory(csv, why);
    memcpy(csv->names, csv->text, csv->n);
    for (size_t i = 0; i < csv->fields; i++) {
        char *const name = csv->names + csv->field[i].at; /* a spreadsheet may have it in two lines */

        csv->name[i] = csv->field[i].at;
        text_clean(name, name, strlen(name) + 1);
    }
    csv->columns = csv->fields;
    return 0;
}

/* A byte order mark is passed over where it says UTF-8, and refused where it says UTF-16. */
static int take_order_mark(struct csv *csv, struct apc_error *why)
{
    unsigned char mark[3];
    size_t n = 0;
    int c = getc_unlocked(csv->in);

    if (c != 0xEF && c != 0xFE && c != 0xFF) {
        if (c != EOF)
            ungetc(c, csv->in);
        return 0;
    }
    for (mark[n++] = (unsigned char)c; n < (c == 0xEF ? 3 : 2); n++) {
        const int next = getc_unlocked(csv->in);

        if (next == EOF)
            break;
        mark[n] = (unsigned char)next;
    }
    if (n == 3 && memcmp(mark, "\xEF\xBB\xBF", 3) == 0)
        return 0;
    return apc_fail(why, APC_EPROTO, "%s:1: it begins as %s: save the file in UTF-8", csv->path,
                    c == 0xEF ? "no UTF-8 does" : "UTF-16 does");
}

/* ---- Files --------------------------------------------------------------------------------------- */

int csv_open(struct csv **out, const char *path, struct apc_error *why)
{
    struct csv *const csv = calloc(1, sizeof *csv);
    int rc;

    *out = NULL;
    if (!csv || !(csv->path = strdup(path))) {
        free(csv);
        return apc_fail(why, APC_ENOMEM, "%s: out of memory", path);
    }
    csv->next = 1;
    csv->in = fopen(path, "re");
    if (!csv->in)
        rc = apc_fail(why, errno == ENOENT ? APC_ENOTFOUND : APC_ESYS, "%s: %s: expected a CSV file", path,
                      strerror(errno));
    else
        rc = take_order_mark(csv, why);
    if (rc == 0)
        rc = take_csv_names(csv, why);
    if (rc == 0)
        *out = csv;
    else
        csv_close(csv);
    return rc;
}

void csv_close(struct csv *csv)
{
    if (!csv)
        return;
    if (csv->in)
        fclose(csv->in);
    free(csv->path);
    free(csv->text);
    free(csv->field);
    free(csv->names);
    free(csv->name);
    free(csv);
}

/* At the end of the file: did any comma show what it is? */
static int settle_decimal_comma(struct csv *csv, struct apc_error *why)
{
    if (!csv->doubt_line)
        return 0;
    csv->line = csv->doubt_line;
    return csv_refuse_field(
        csv, csv->doubt_column, why,
        "\"%s\" may have decimals or thousands, as each comma of the file has three digits "
        "behind it: write numbers with a point",
        csv->doubt);
}

int csv_next(struct csv *csv, struct apc_error *why)
{
    const int rc = take_csv_row(csv, why);

    if (rc < 0)
        return rc;
    if (rc == 0)
        return settle_decimal_comma(csv, why);
    for (size_t i = csv->columns; i < csv->fields; i++)
        if (csv_text(csv, i)[0])
            return csv_refuse(
                csv, why,
                "%zu fields under %zu names: is one of them parted by a comma that belongs in quotes?",
                csv->fields, csv->columns);
    if (csv->fields < csv->columns)
        return csv_refuse(csv, why, "%zu fields under %zu names: is the row cut off?", csv->fields,
                          csv->columns);
    return 1;
}

size_t csv_columns(const struct csv *csv)
{
    return csv->columns;
}

const char *csv_name(const struct csv *csv, size_t column)
{
    return csv->names + csv->name[column];
}

const char *csv_text(const struct csv *csv, size_t column)
{
    return csv->text + csv->field[column].at;
}

bool csv_missing(const struct csv *csv, size_t column)
{
    const char *const text = csv_text(csv, column);

    return !*text || strcasecmp(text, "nan") == 0;
}

size_t csv_line(const struct csv *csv)
{
    return csv->line;
}

size_t csv_passed(const struct csv *csv)
{
    return csv->passed;
}

bool csv_ended(const struct csv *csv)
{
    return csv->ended;
}

int csv_expect(const struct csv *csv, const char *names, struct apc_error *why)
{
    const char *at = names;
    bool same = true;

    for (size_t i = 0; i < csv->columns && same; i++) {
        const size_t n = strcspn(at, ",");

        same = strlen(csv_name(csv, i)) == n && memcmp(at, csv_name(csv, i), n) == 0 &&
               (at[n] == ',') == (i + 1 < csv->columns);
        at += n + (at[n] == ',');
    }
    return same && !*at ? 0 : csv_refuse(csv, why, "expected the columns %s", names);
}

/* ---- Writing ---------------------------------------------------------------------------------------- */

void csv_put_quoted(FILE *out, const char *text)
{
    char instead;

    fputc('"', out);
    for (size_t n; *text; text += n) {
        n = text_step(text, &instead);
        if (*text == '"')
            fputc('"', out);
        fwrite(instead ? &instead : text, 1, instead ? 1 : n, out);
    }
    fputc('"', out);
}

void csv_put(FILE *out, const char *text)
{
    if (strpbrk(text, ",;\"") || *text == ' ' || !text_is_clean(text))
        csv_put_quoted(out, text);
    else
        fputs(text, out);
}

/* ---- Numbers ------------------------------------------------------------------------------------- */

/* Up to three digits, the first of them no 0, and groups of three: "1,234", "12,345,678". */
static bool in_thousands(const char *text)
{
    size_t n;

    text += *text == '-' || *text == '+';
    n = strspn(text, "0123456789");
    if (n < 1 || n > 3 || *text == '0' || text[n] != ',')
        return false;
    for (text += n; *text == ','; text += 4)
        if (strspn(text + 1, "0123456789") != 3)
            return false;
    return *text == '\0';
}

/* The comma of a number: for decimals, or in doubt until the end of the file. */
static void weigh_decimal_comma(struct csv *csv, size_t column, const char *text)
{
    if (csv->separator != ',' || !in_thousands(text)) {
        csv->mark = ','; /* beyond doubt */
        csv->doubt_line = 0;
    } else if (csv->mark != ',' && !csv->doubt_line) {
        csv->doubt_line = csv->line;
        csv->doubt_column = column;
        snprintf(csv->doubt, sizeof csv->doubt, "%.39s", text);
    }
}

int csv_number(struct csv *csv, size_t column, double *value, struct apc_error *why)
{
    const char *const from = csv_text(csv, column);
    char text[NUMBER_MOST];
    size_t n = strlen(from), skip = strspn(from, " \t");

    while (n > skip && strchr(" \t", from[n - 1]))
        n--;
    if (n - skip < sizeof text) {
        memcpy(text, from + skip, n - skip);
        text[n - skip] = '\0';
        char *const comma = strchr(text, ','), mark = comma ? ',' : strchr(text, '.') ? '.' : '\0';
        const bool other = mark && csv->mark_line && mark != (csv->mark == '.' ? '.' : ',');
        char as_read[sizeof csv->doubt];

        snprintf(as_read, sizeof as_read, "%.39s", text);
        if (comma)
            *comma = '.';
        if (apc_number_parse(text, value) == 0) {
            if (other)
                return csv_refuse_field(csv, column, why,
                                        "\"%.40s\" has a %s, a number in line %zu a %s: which of them parts "
                                        "decimals is in doubt",
                                        as_read, comma ? "comma" : "point", csv->mark_line,
                                        comma ? "point" : "comma");
            if (mark && !csv->mark_line) {
                csv->mark_line = csv->line;
                csv->mark = mark == '.' ? '.' : '\0';
            }
            if (comma)
                weigh_decimal_comma(csv, column, as_read);
            return 0;
        }
    }
    return csv_refuse_field(csv, column, why, "\"%.40s\" is no number%s", from,
                            strpbrk(from, ",") ? ": write it without commas between thousands" : "");
}

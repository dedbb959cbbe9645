/* SPDX-License-Identifier: BSD-3-Clause */
#include "print.h"

#include <limits.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>
#include <sys/ioctl.h>

#include "base/base_internal.h"
#include "base/text.h"
#include "files/files.h"
#include "operate/operate.h"

/* ---- Pieces ------------------------------------------------------------------------------- */

char *print_value(const struct apc_sample *sample, char text[PRINT_LEN])
{
    const char *mode = NULL;
    const bool actual = sample->table == APC_ACTUAL &&
                        sample->id == apc_variable_number(APC_OPMODE, sample->id / 16); /* of a mode */
    if (loops_is_owner(sample))
        mode = loops_owner_name(loops_is_local(sample));
    else if (((sample->table == APC_OPMODE && sample->id < LOOPS_IDS) || actual) && sample->value >= 0 &&
             sample->value <= (double)APC_MODE_LO)
        mode = apc_mode_name((int)sample->value);
    if (sample->seq == 0)
        snprintf(text, PRINT_LEN, "-");
    else if (mode)
        snprintf(text, PRINT_LEN, "%s", mode);
    else
        snprintf(text, PRINT_LEN, "%.6g", sample->value + 0.0); /* -0 reads as 0 */
    return text;
}

char *print_exact(double value, char text[PRINT_LEN])
{
    return decimal_shortest(value, 6, text);
}

char *print_duration(apc_ns duration, char text[PRINT_LEN])
{
    double ns = (double)duration, size = fabs(ns);
    if (size < 999.5)
        snprintf(text, PRINT_LEN, "%.3g ns", ns);
    else if (size < 999.5e3)
        snprintf(text, PRINT_LEN, "%.3g µs", ns / 1e3);
    else if (size < 999.5e6)
        snprintf(text, PRINT_LEN, "%.3g ms", ns / 1e6);
    else
        snprintf(text, PRINT_LEN, "%.6g s", ns / 1e9);
    return text;
}

char *print_age(apc_ns age, char text[PRINT_LEN])
{
    return change_age(age, text);
}

char *print_second(apc_ns utc, char text[PRINT_LEN])
{
    char *point = strchr(apc_time_format(utc, text), '.');
    if (point)
        memcpy(point, "Z", 2);
    return text;
}

char *print_name(const struct cli_tags *tags, const struct apc_sample *sample, char text[PRINT_LEN])
{
    const struct apc_tag *tag = cli_tag(tags, sample->table, sample->id);
    if (tag && tag->name[0])
        snprintf(text, PRINT_LEN, "%s%s", tag->name, cli_is_loop(tag) ? ".mode" : "");
    else
        snprintf(text, PRINT_LEN, "%s.%d", apc_table_name(sample->table), sample->id);
    return text;
}

void print_clean(FILE *out, const char *text)
{
    char instead;

    for (size_t n; *text; text += n) {
        n = text_step(text, &instead);
        fwrite(instead ? &instead : text, 1, instead ? 1 : n, out);
    }
}

/* ---- Columns ------------------------------------------------------------------------------ */

void print_table_open(struct print_table *table, const struct print_column *columns, size_t n)
{
    *table = (struct print_table){.columns = columns, .n_columns = n};
}

void print_table_clear(struct print_table *table)
{
    table->n = 0;
}

void print_table_close(struct print_table *table)
{
    free(table->cells);
    *table = (struct print_table){0};
}

static bool reserve_cell(struct print_table *table)
{
    if (table->n < table->capacity)
        return true;
    size_t capacity = table->capacity ? 2 * table->capacity : 64;
    struct print_cell *cells = realloc(table->cells, capacity * sizeof *cells);
    if (!cells) {
        table->failed = true;
        return false;
    }
    table->cells = cells;
    table->capacity = capacity;
    return true;
}

void print_cell(struct print_table *table, enum print_ink ink, const char *fmt, ...)
{
    va_list args;
    if (!reserve_cell(table))
        return;
    struct print_cell *cell = &table->cells[table->n++];
    va_start(args, fmt);
    vsnprintf(cell->text, sizeof cell->text, fmt, args);
    va_end(args);
    text_clean(cell->text, cell->text, sizeof cell->text);
    cell->ink = ink;
}

void print_number(struct print_table *table, int digits, double value)
{
    if (isnan(value))
        print_cell(table, PRINT_PLAIN, "-");
    else
        print_cell(table, PRINT_PLAIN, "%.*g", digits, value);
}

/* Characters on the screen: bytes that do not continue a UTF-8 sequence. */
static int width_of(const char *text)
{
    int n = 0;
    for (; *text; text++)
        n += ((unsigned char)*text & 0xC0) != 0x80;
    return n;
}

/* What of a cell stands before its decimal point; all of what is no number. */
static int before_point(const char *text)
{
    const size_t sign = text[0] == '<' && text[1] != ' ';
    const size_t digits = strspn(text + sign, "+-0123456789") + sign;
    return digits > 0 ? (int)digits : width_of(text);
}

static void lay_out(struct print_table *table, size_t column)
{
    const struct print_column *c = &table->columns[column];
    struct print_layout *l = &table->layout[column];
    for (size_t i = column; i < table->n; i += table->n_columns) {
        const char *text = table->cells[i].text;
        int width = width_of(text), before = c->align == PRINT_POINT ? before_point(text) : 0;
        l->used |= *text != '\0';
        l->before = before > l->before ? before : l->before;
        l->after = width - before > l->after ? width - before : l->after;
    }
    int heading = width_of(c->heading);
    l->width = l->before + l->after > heading ? l->before + l->after : heading;
}

static void put_coloured_text(FILE *out, enum print_ink ink, bool colour, const char *text)
{
    static const char *const codes[] = {
        [PRINT_HEADING] = "1", [PRINT_FAINT] = "2", [PRINT_WARN] = "33", [PRINT_ALARM] = "1;31"};
    bool coloured = colour && ink != PRINT_PLAIN && *text;
    if (coloured)
        fprintf(out, "\033[%sm", codes[ink]);
    print_clean(out, text);
    if (coloured)
        fputs("\033[0m", out);
}

/* @owed: blanks that are due before the next text; so that none are left at the end of a line. */
static void put_cell(FILE *out, const struct print_cell *cell, const struct print_layout *l,
                     enum print_align align, bool colour, int *owed)
{
    int width = width_of(cell->text), lead = 0;
    if (align == PRINT_RIGHT)
        lead = l->width - width;
    else if (align == PRINT_POINT)
        lead = l->before - before_point(cell->text);
    if (width > 0) {
        fprintf(out, "%*s", *owed + lead, "");
        put_coloured_text(out, cell->ink, colour, cell->text);
        *owed = 0;
        width += lead;
    }
    *owed += l->width - width + 2;
}

static void put_table_row(FILE *out, const struct print_table *table, size_t row, bool colour)
{
    int owed = 0;
    for (size_t i = 0; i < table->n_columns; i++)
        if (table->layout[i].used)
            put_cell(out, &table->cells[row * table->n_columns + i], &table->layout[i],
                     table->columns[i].align, colour, &owed);
}

static void put_headings(FILE *out, const struct print_table *table, bool colour)
{
    int owed = 0;
    for (size_t i = 0; i < table->n_columns; i++) {
        struct print_cell cell = {.ink = PRINT_HEADING};
        enum print_align align = table->columns[i].align == PRINT_RIGHT ? PRINT_RIGHT : PRINT_LEFT;
        snprintf(cell.text, sizeof cell.text, "%s", table->columns[i].heading);
        if (table->layout[i].used)
            put_cell(out, &cell, &table->layout[i], align, colour, &owed);
    }
}

static void put_used_columns(FILE *out, const struct print_table *table, bool colour, size_t most,
                             const char *eol)
{
    const size_t rows = table->n_columns > 0 ? table->n / table->n_columns : 0;

    put_headings(out, table, colour);
    fputs(eol, out);
    for (size_t row = 0; row < rows && (most == 0 || row < most); row++) {
        put_table_row(out, table, row, colour);
        fputs(eol, out);
    }
}

int print_table_show(struct print_table *table, FILE *out, bool colour, size_t most, const char *eol)
{
    if (table->failed)
        return APC_ENOMEM;
    for (size_t i = 0; i < table->n_columns; i++)
        lay_out(table, i);
    put_used_columns(out, table, colour, most, eol);
    return 0;
}

static int columns_of_screen(FILE *out)
{
    struct winsize size;
    return ioctl(fileno(out), TIOCGWINSZ, &size) == 0 && size.ws_col > 0 ? size.ws_col : INT_MAX;
}

static int width_of_column(const struct print_layout *l)
{
    return l->used ? l->width + 2 : 0;
}

/* What is too wide for the screen goes on below, behind the names again; it is cut before columns of numbers. */
static void put_table_parts(FILE *out, struct print_table *table, bool colour, size_t most)
{
    const size_t n = table->n_columns;
    const int screen = columns_of_screen(out);
    struct print_layout whole[PRINT_COLUMNS];
    size_t names = 0;
    int of_names = -2; /* nothing stands behind the last column */

    memcpy(whole, table->layout, sizeof whole);
    while (names < n && table->columns[names].align == PRINT_LEFT)
        of_names += width_of_column(&whole[names++]);
    for (size_t from = names, to = 0; to < n; from = to) {
        int width = of_names;

        for (to = from; to < n; to++) {
            width += width_of_column(&whole[to]);
            if (to > from && width > screen && table->columns[to].align != PRINT_LEFT)
                break;
        }
        for (size_t i = names; i < n; i++)
            table->layout[i].used = whole[i].used && i >= from && i < to;
        fputs(from > names ? "\n" : "", out);
        put_used_columns(out, table, colour, most, "\n");
    }
}

int print_table_end(struct print_table *table, FILE *out, bool colour, size_t most)
{
    const int rc = table->failed ? APC_ENOMEM : 0;

    for (size_t i = 0; i < table->n_columns; i++)
        lay_out(table, i);
    if (table->n > 0 && rc == 0)
        put_table_parts(out, table, colour, most);
    print_table_close(table);
    return rc;
}

enum print_ink print_ink_of(apc_status status)
{
    switch (apc_status_severity(status)) {
    case APC_SEVERITY_GOOD:
        return PRINT_PLAIN;
    case APC_SEVERITY_UNCERTAIN:
        return PRINT_WARN;
    default:
        return PRINT_ALARM;
    }
}

const struct print_column print_sample_columns[6] = {{"NAME", PRINT_LEFT}, {"VALUE", PRINT_POINT},
                                                     {"UNIT", PRINT_LEFT}, {"STATUS", PRINT_LEFT},
                                                     {"AGE", PRINT_POINT}, {"", PRINT_LEFT}};

void print_sample_cells(struct print_table *table, const struct cli_tags *tags, const struct apc_sample *s,
                        apc_ns now, const char *note)
{
    char text[PRINT_LEN], status[APC_STATUS_NAME_LEN];
    const struct apc_tag *tag = cli_tag(tags, s->table, s->id);

    print_cell(table, PRINT_PLAIN, "%s", print_name(tags, s, text));
    print_cell(table, PRINT_PLAIN, "%s", print_value(s, text));
    print_cell(table, PRINT_PLAIN, "%s", tag ? tag->unit : "");
    if (s->seq == 0) {
        print_cell(table, PRINT_FAINT, "no sample yet");
        print_cell(table, PRINT_PLAIN, "%s", "");
    } else {
        print_cell(table, print_ink_of(s->status), "%s", apc_status_format(s->status, status));
        print_cell(table, PRINT_PLAIN, "%s", print_age(apc_ns_since(now, s->time), text));
    }
    print_cell(table, PRINT_ALARM, "%s", note);
}

/* ---- Rows --------------------------------------------------------------------------------- */

void print_sample_csv(FILE *out, const struct apc_sample *s)
{
    char time[APC_TIME_LEN], status[APC_STATUS_NAME_LEN], value[PRINT_LEN];
    apc_number_format(s->value, value, sizeof value);
    fprintf(out, "%s,%s,%d,%s,%s\n", apc_time_format(s->time, time), apc_table_name(s->table), s->id,
            apc_status_format(s->status, status), value);
}

void print_sample_members(struct text *t, const struct apc_sample *s, const struct cli_tags *tags, apc_ns now)
{
    char time[APC_TIME_LEN], status[APC_STATUS_NAME_LEN], name[PRINT_LEN];
    const struct apc_tag *tag = tags ? cli_tag(tags, s->table, s->id) : NULL;

    if (tags)
        json_add(t, "name:%s", print_name(tags, s, name));
    json_add(t, "table:%s, id:%d, seq:%jd, time:%-s, status:%s, value:%g", apc_table_name(s->table), s->id,
             s->seq, s->seq ? apc_time_format(s->time, time) : "", apc_status_format(s->status, status),
             s->seq ? s->value : (double)NAN);
    if (tags)
        json_add(t, "unit:%s", tag ? tag->unit : "");
    if (now)
        json_add(t, "age:%.3f", s->seq ? apc_ns_to_s(apc_ns_since(now, s->time)) : (double)NAN);
    if (s->origin)
        json_add(t, "origin:%jd", s->origin);
}

void print_sample_json(struct text *t, const struct apc_sample *s, const struct cli_tags *tags, apc_ns now)
{
    json_add(t, "{");
    print_sample_members(t, s, tags, now);
    json_add(t, "}");
}

const char *print_severity(enum apc_event_severity severity)
{
    static const char *const names[] = {
        [APC_EVENT_INFO] = "info", [APC_EVENT_WARNING] = "warning", [APC_EVENT_ALARM] = "alarm"};
    return severity >= APC_EVENT_INFO && severity <= APC_EVENT_ALARM ? names[severity] : "?";
}

enum print_ink print_severity_ink(enum apc_event_severity severity)
{
    return severity == APC_EVENT_ALARM     ? PRINT_ALARM
           : severity == APC_EVENT_WARNING ? PRINT_WARN
                                           : PRINT_PLAIN;
}

void print_event_csv(FILE *out, const struct apc_event *e)
{
    char time[APC_TIME_LEN];
    fprintf(out, "%s,%s", apc_time_format(e->time, time), print_severity(e->severity));
    fputc(',', out);
    csv_put_quoted(out, e->source);
    fputc(',', out);
    csv_put_quoted(out, e->kind);
    fputc(',', out);
    csv_put_quoted(out, e->text);
    fputc('\n', out);
}

void print_event_json(struct text *t, const struct apc_event *e)
{
    char time[APC_TIME_LEN];
    json_add(t, "{time:%s, severity:%s, source:%s, kind:%s, text:%s}", apc_time_format(e->time, time),
             print_severity(e->severity), e->source, e->kind, e->text);
}

/* ---- A page ------------------------------------------------------------------------------- */

void page_text(FILE *out, const char *text)
{
    char clean[512];
    for (const char *c = text_cleaned(clean, text, sizeof clean, false); *c; c++)
        if (strchr("&<>\"", *c))
            fprintf(out, "&#%d;", *c);
        else
            putc(*c, out);
}

void page_begin(FILE *out, const char *what, const char *name)
{
    fprintf(out, "<!doctype html>\n<html lang=\"en\">\n<head>\n<meta charset=\"utf-8\">\n<title>%s ", what);
    page_text(out, name);
    fputs(
        "</title>\n<style>\n"
        "body { font: 10pt/1.4 sans-serif; margin: 1.5cm auto; max-width: 18cm; }\n"
        "h1 { font-size: 18pt; margin: 0 0 4pt; }\n"
        "h2 { break-after: avoid; border-bottom: 2px solid #1b3a6b; font-size: 12pt; margin: 16pt 0 4pt; }\n"
        "h3 { break-after: avoid; font-size: 10pt; margin: 8pt 0 2pt; }\n"
        "table { border-collapse: collapse; font-variant-numeric: tabular-nums; width: 100%; }\n"
        "th, td { border-bottom: 1px solid #999; padding: 2pt 8pt 2pt 0; text-align: left; vertical-align: "
        "top; }\n"
        "th { vertical-align: bottom; }\n"
        "th::first-letter { text-transform: uppercase; }\n"
        ".number { text-align: right; }\n"
        "td:not(:last-child) { white-space: nowrap; }\n"
        "td:last-child:not(.number) { overflow-wrap: anywhere; width: 100%; }\n"
        "thead { display: table-header-group; }\n" /* on each sheet */
        "tr, figure { break-inside: avoid; }\n"
        "figure { margin: 6pt 0; }\n"
        "ul.key { display: flex; flex-wrap: wrap; gap: 6pt; list-style: none; margin: 8pt 0; padding: 0; }\n"
        "ul.key li { border: 1px solid #999; flex: 1; padding: 4pt 8pt; }\n"
        "ul.key b { display: block; font-size: 15pt; white-space: nowrap; }\n"
        "@page { margin: 1.5cm; size: A4; }\n"
        "@media print { body { margin: 0; max-width: none; } }\n"
        "</style>\n</head>\n<body>\n",
        out);
    fprintf(out, "<h1>%s ", what);
    page_text(out, name);
    fputs("</h1>\n", out);
}

static bool is_column_used(const struct print_table *table, size_t column)
{
    for (size_t i = column; i < table->n; i += table->n_columns)
        if (table->cells[i].text[0])
            return true;
    return false;
}

static void page_cell(FILE *out, const char *element, enum print_align align, const char *text)
{
    fprintf(out, "<%s%s>", element, align == PRINT_LEFT ? "" : " class=\"number\"");
    page_text(out, text);
    fprintf(out, "</%s>", element);
}

int page_table(FILE *out, struct print_table *table)
{
    const bool failed = table->failed;
    bool used[PRINT_COLUMNS] = {0};
    fputs(table->n > 0 ? "<table>\n<thead><tr>" : "", out);
    for (size_t i = 0; i < table->n_columns && table->n > 0; i++)
        if ((used[i] = is_column_used(table, i)))
            page_cell(out, "th", table->columns[i].align, table->columns[i].heading);
    fputs(table->n > 0 ? "</tr></thead>\n<tbody>" : "", out);
    for (size_t i = 0, column = 0; i < table->n;
         i++, column = column + 1 < table->n_columns ? column + 1 : 0) {
        fputs(column > 0 ? "" : "\n<tr>", out);
        if (used[column])
            page_cell(out, "td", table->columns[column].align, table->cells[i].text);
        fputs(column + 1 < table->n_columns ? "" : "</tr>", out);
    }
    fputs(table->n > 0 ? "\n</tbody>\n</table>\n" : "", out);
    print_table_close(table);
    return failed ? APC_ENOMEM : 0;
}

struct page_events {
    FILE *out;
    bool (*is)(const struct apc_event *event);
    char *(*time)(const void *ctx, apc_ns utc, char text[PRINT_LEN]);
    const void *ctx;
    size_t most, n;
};

static int put_event_row(void *ctx, const struct apc_event *event)
{
    struct page_events *p = ctx;
    char time[PRINT_LEN];
    if (!p->is(event) || p->n++ >= p->most)
        return 0;
    fputs(p->n == 1
              ? "<table>\n<thead><tr><th>Time</th><th>Who</th><th>Kind</th><th>Message</th></tr></thead>\n"
                "<tbody>\n<tr>"
              : "<tr>",
          p->out);
    page_cell(p->out, "td", PRINT_LEFT, p->time(p->ctx, event->time, time));
    page_cell(p->out, "td", PRINT_LEFT, event->source);
    page_cell(p->out, "td", PRINT_LEFT, !strcmp(event->kind, "log") ? "entry" : event->kind);
    page_cell(p->out, "td", PRINT_LEFT, event->text);
    fputs("</tr>\n", p->out);
    return 0;
}

int page_events(FILE *out, struct apc_store *store, const struct apc_range *range,
                bool (*is)(const struct apc_event *event),
                char *(*time)(const void *ctx, apc_ns utc, char text[PRINT_LEN]), const void *ctx,
                size_t most)
{
    struct page_events p = {out, is, time, ctx, most, 0};
    const int rc = apc_store_events(store, range, put_event_row, &p);
    fputs(p.n > 0 ? "</tbody>\n</table>\n" : "<p>None</p>\n", out);
    page_left_out(out, p.n, most);
    return rc < 0 ? rc : (int)p.n;
}

void page_left_out(FILE *out, size_t n, size_t most)
{
    if (n > most)
        fprintf(out, "<p><b>%zu rows are left out</b>: there are %zu, and the first %zu are shown.</p>\n",
                n - most, n, most);
}

/* SPDX-License-Identifier: BSD-3-Clause */
/*
 * How results look: aligned columns for people, JSON and CSV for programs. Text from the shared data
 * never reaches a terminal with its control characters.
 */
#ifndef APC_PRINT_H
#define APC_PRINT_H

#include <stdio.h>

#include "cli.h"
#include "files/files.h"

/* ---- Pieces ------------------------------------------------------------------------------- */

#define PRINT_LEN 96 /* bytes that hold any of these */

/* Six digits: for looking at. A mode's name for a row of table opmode; "-" when there is no sample. */
char *print_value(const struct apc_sample *sample, char text[PRINT_LEN]);
/* As many digits as it takes to read the same number back: for what an operator has written. */
char *print_exact(double value, char text[PRINT_LEN]);
/* "31 µs", "2 s". */
char *print_duration(apc_ns duration, char text[PRINT_LEN]);
/* "0.4 s", "12 min", "3 h", "5 d"; "2.0 s ahead" of this machine's clock. */
char *print_age(apc_ns age, char text[PRINT_LEN]);
/* UTC to the second: for looking at. */
char *print_second(apc_ns utc, char text[PRINT_LEN]);
/* The variable's name, or TABLE.ID. */
char *print_name(const struct cli_tags *tags, const struct apc_sample *sample, char text[PRINT_LEN]);

/* ---- Columns for people ------------------------------------------------------------------- */

enum print_align { PRINT_LEFT = 0, PRINT_RIGHT, PRINT_POINT /* decimal points stand under each other */ };
enum print_ink { PRINT_PLAIN = 0, PRINT_HEADING, PRINT_FAINT, PRINT_WARN, PRINT_ALARM };

struct print_column {
    const char *heading;
    enum print_align align;
};

struct print_cell {
    char text[200];
    enum print_ink ink;
};

#define PRINT_COLUMNS 12

/* How wide a column is: of its longest parts before and after the point. */
struct print_layout {
    int before, after, width;
    bool used;
};

/* Cells are added row by row. A column in which no row has anything is left out. A table that is shown again
 * with other rows keeps its columns at least as wide, so that they do not jump. */
struct print_table {
    const struct print_column *columns;
    size_t n_columns; /* at most PRINT_COLUMNS */
    struct print_layout layout[PRINT_COLUMNS];
    struct print_cell *cells;
    size_t n, capacity;
    bool failed; /* out of memory: cells are missing */
};

void print_table_open(struct print_table *table, const struct print_column *columns, size_t n);
void print_table_clear(struct print_table *table); /* no rows again */
void print_table_close(struct print_table *table);
void print_cell(struct print_table *table, enum print_ink ink, const char *fmt, ...) APC_PRINTF(3, 4);
void print_number(struct print_table *table, int digits, double value); /* "-" for none */
/* Headings and up to @most rows (0: all), each ended by @eol. Returns 0 or APC_ENOMEM. */
int print_table_show(struct print_table *table, FILE *out, bool colour, size_t most, const char *eol);
/* The same, of one that has rows, and it is closed. */
int print_table_end(struct print_table *table, FILE *out, bool colour, size_t most);

/* Plain, or for those of a status that is not Good a warning or an alarm. */
enum print_ink print_ink_of(apc_status status);

/* A table of samples: name, value, unit, status, age, and @note, a word that is an alarm. */
extern const struct print_column print_sample_columns[6];
void print_sample_cells(struct print_table *table, const struct cli_tags *tags,
                        const struct apc_sample *sample, apc_ns now, const char *note);

/* Text in one line, as it is to be shown (base/text.h). */
void print_clean(FILE *out, const char *text);

/* ---- Rows for programs -------------------------------------------------------------------- */

#define PRINT_SAMPLE_HEADER "time,table,id,status,value"
#define PRINT_EVENT_HEADER  "time,severity,source,kind,text"

void print_sample_csv(FILE *out, const struct apc_sample *sample);
/* Its members. @tags: also name and unit; @now: also the age, in seconds. */
void print_sample_members(struct text *t, const struct apc_sample *sample, const struct cli_tags *tags,
                          apc_ns now);
void print_sample_json(struct text *t, const struct apc_sample *sample, const struct cli_tags *tags,
                       apc_ns now);
const char *print_severity(enum apc_event_severity severity);
enum print_ink print_severity_ink(enum apc_event_severity severity);
void print_event_csv(FILE *out, const struct apc_event *event);
void print_event_json(struct text *t, const struct apc_event *event);

/* ---- A page of HTML, that prints well: what is put into it is text and never markup ----------- */

/* Until its heading, @p what and the name of what it is about. */
void page_begin(FILE *out, const char *what, const char *name);
void page_text(FILE *out, const char *text);
/* Of a table that has rows, which is closed. A column in which no row has anything is left out. Returns 0 or APC_ENOMEM. */
int page_table(FILE *out, struct print_table *table);
/* Those events of a range, at most so many, their times as @p time says them with @p ctx. Returns how many
 * there are, or the store's error. */
int page_events(FILE *out, struct apc_store *store, const struct apc_range *range,
                bool (*is)(const struct apc_event *event),
                char *(*time)(const void *ctx, apc_ns utc, char text[PRINT_LEN]), const void *ctx,
                size_t most);
/* Says so, where there are more. */
void page_left_out(FILE *out, size_t n, size_t most);

#endif

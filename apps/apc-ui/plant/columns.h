/* SPDX-License-Identifier: BSD-3-Clause */
/* A table, made row by row, told as a whole: as columns in JSON, as lines of CSV, or as binary columns which
 * JSON points to. */
#ifndef APC_UI_COLUMNS_H
#define APC_UI_COLUMNS_H

#include "files/files.h"

#define COLUMNS 8

enum form { FORM_JSON = 0, FORM_CSV, FORM_BINARY };

union cell {
    apc_ns time;   /* UTC; as Unix seconds */
    double number; /* not finite: none */
    int64_t whole;
    apc_status status; /* its name, binary its number */
};

struct column {
    const char *name;
    enum cell_type { CELL_TIME = 1, CELL_NUMBER, CELL_WHOLE, CELL_STATUS } type;
};

struct columns {
    const struct column *column; /* up to one without a name */
    enum form form;
    const char *of;    /* first in each line of CSV */
    struct text *data; /* lines of CSV, or binary columns one behind the other */
    struct text cells[COLUMNS];
};

/* One cell for each column. */
void columns_row(struct columns *c, const union cell *row);
/*
 * `"NAME":[...],...` to @p t; of binary columns `"NAME":{"type":"f64","at":N,"n":ROWS}`, with N bytes of data
 * before it, a multiple of 8; "u32" of status. Of CSV nothing. Frees what the rows took.
 */
void columns_end(struct columns *c, struct text *t);
/* The first line of CSV: "name" and the columns. */
void columns_head(const struct column *column, struct text *t);
/*
 * Binary: what JSON says, and what it points to, become one: the length of the JSON (4 bytes, little-endian),
 * the JSON with spaces up to a multiple of 8 from the beginning, the data. All numbers are little-endian.
 */
void columns_join(struct text *json, const struct text *data);

#endif

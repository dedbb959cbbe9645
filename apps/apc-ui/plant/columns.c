/* SPDX-License-Identifier: BSD-3-Clause */
#include "columns.h"

#include <endian.h>
#include <math.h>
#include <string.h>

#include "base/text.h"

static double in_figures(enum cell_type type, union cell cell)
{
    return type == CELL_TIME ? apc_ns_to_s(cell.time) : type == CELL_WHOLE ? (double)cell.whole : cell.number;
}

static void put_binary(struct text *t, enum cell_type type, union cell cell)
{
    const double figure = type == CELL_STATUS ? 0 : in_figures(type, cell);
    uint64_t bits;
    if (type == CELL_STATUS) {
        const uint32_t status = htole32((uint32_t)cell.status);
        text_put(t, (const char *)&status, sizeof status);
        return;
    }
    memcpy(&bits, &figure, sizeof bits);
    bits = htole64(bits);
    text_put(t, (const char *)&bits, sizeof bits);
}

static void put_cell_text(struct text *t, enum cell_type type, union cell cell, bool json)
{
    char name[APC_STATUS_NAME_LEN];
    if (type == CELL_TIME)
        json_add(t, "%.6jd", cell.time);
    else if (type == CELL_WHOLE)
        json_add(t, "%jd", cell.whole);
    else if (type == CELL_STATUS && json)
        json_add(t, "%s", apc_status_format(cell.status, name));
    else if (type == CELL_STATUS)
        text_add(t, "%s", apc_status_format(cell.status, name));
    else if (json || isfinite(cell.number))
        json_add(t, "%g", cell.number);
}

/* A field of RFC 4180. */
static void put_csv_field(struct text *t, const char *field)
{
    const bool quoted = strpbrk(field, ",\"") != NULL;
    char instead;
    text_put(t, "\"", quoted);
    for (size_t n; *field; field += n) {
        n = text_step(field, &instead);
        text_put(t, "\"", *field == '"');
        text_put(t, instead ? &instead : field, instead ? 1 : n);
    }
    text_put(t, "\"", quoted);
}

static void put_columns_line(struct columns *c, const union cell *row)
{
    put_csv_field(c->data, c->of);
    for (size_t i = 0; c->column[i].name; i++) {
        text_put(c->data, ",", 1);
        put_cell_text(c->data, c->column[i].type, row[i], false);
    }
    text_put(c->data, "\n", 1);
}

void columns_row(struct columns *c, const union cell *row)
{
    if (c->form == FORM_CSV) {
        put_columns_line(c, row);
        return;
    }
    for (size_t i = 0; c->column[i].name; i++) {
        if (c->form == FORM_BINARY)
            put_binary(&c->cells[i], c->column[i].type, row[i]);
        else
            put_cell_text(&c->cells[i], c->column[i].type, row[i], true);
    }
}

static void end_binary(struct columns *c, size_t i, struct text *t)
{
    static const char zeros[8];
    const bool status = c->column[i].type == CELL_STATUS;
    const struct text *cells = &c->cells[i];
    json_add(t, "{type:%s, at:%zu, n:%zu}", status ? "u32" : "f64", c->data->n, cells->n / (status ? 4 : 8));
    text_put(c->data, cells->at, cells->n);
    text_put(c->data, zeros, (8 - cells->n % 8) % 8);
}

void columns_end(struct columns *c, struct text *t)
{
    for (size_t i = 0; c->form != FORM_CSV && c->column[i].name; i++) {
        json_add(t, "%s:", c->column[i].name);
        if (c->form == FORM_BINARY)
            end_binary(c, i, t);
        else
            json_add(t, "[%.*s]", (int)c->cells[i].n, c->cells[i].at);
        t->failed |= c->cells[i].failed;
        text_free(&c->cells[i]);
    }
}

void columns_head(const struct column *column, struct text *t)
{
    text_add(t, "name");
    for (; column->name; column++)
        text_add(t, ",%s", column->name);
    text_put(t, "\n", 1);
}

void columns_join(struct text *json, const struct text *data)
{
    static const char spaces[8] = "        ";
    struct text whole = {0};
    const size_t pad = (8 - (4 + json->n) % 8) % 8;
    const uint32_t n = htole32((uint32_t)(json->n + pad));
    text_put(&whole, (const char *)&n, sizeof n);
    text_put(&whole, json->at, json->n);
    text_put(&whole, spaces, pad);
    text_put(&whole, data->at, data->n);
    whole.failed |= json->failed || data->failed;
    text_free(json);
    *json = whole;
}

/* SPDX-License-Identifier: BSD-3-Clause */
#include "print_prediction.h"

#include <math.h>

#include "print.h"

static void put_predicted(struct print_table *table, double value)
{
    if (isnan(value))
        print_cell(table, PRINT_PLAIN, "-");
    else
        print_cell(table, PRINT_PLAIN, "%.6g", value);
}

static void put_prediction_row(struct print_table *table, const struct prediction_trajectory *c, size_t k)
{
    print_cell(table, PRINT_PLAIN, "%s", k == 0 ? c->name : "");
    put_predicted(table, prediction_ahead(c, k));
    put_predicted(table, c->expected[k]);
    put_predicted(table, c->came[k]);
    put_predicted(table, c->came[k] - c->expected[k]);
}

int prediction_print(const struct prediction *o, FILE *out)
{
    static const struct print_column columns[] = {{"expected", PRINT_LEFT},
                                                  {"ahead s", PRINT_POINT},
                                                  {"value", PRINT_POINT},
                                                  {"came", PRINT_POINT},
                                                  {"difference", PRINT_POINT}};
    struct print_table table;
    print_table_open(&table, columns, sizeof columns / sizeof *columns);
    for (size_t i = 0; i < o->n; i++) {
        const struct prediction_trajectory *c = &o->trajectory[i];
        for (size_t k = 1; k < c->n; k *= 2)
            put_prediction_row(&table, c, k - 1);
        put_prediction_row(&table, c, c->n - 1);
    }
    const int rc = table.n > 0 ? print_table_show(&table, out, false, 0, "\n") : 0;
    print_table_close(&table);
    return rc;
}

static void values(FILE *out, const char *name, const double *v, size_t n)
{
    fprintf(out, ",\"%s\":[", name);
    for (size_t k = 0; k < n; k++)
        isnan(v[k]) ? fprintf(out, "%snull", k ? "," : "") : fprintf(out, "%s%.17g", k ? "," : "", v[k]);
    fputc(']', out);
}

void prediction_json(const struct prediction *o, FILE *out)
{
    fputs("\"expectations\":[", out);
    for (size_t i = 0; i < o->n; i++) {
        const struct prediction_trajectory *c = &o->trajectory[i];
        fputs(i ? ",{" : "{", out);
        print_json_text(out, "variable", c->name);
        fputc(',', out);
        print_json_text(out, "table", apc_table_name(c->table));
        fputc(',', out);
        print_json_number(out, "made_s", apc_ns_to_s(c->made));
        fputc(',', out);
        print_json_number(out, "first_s", apc_ns_to_s(c->first));
        fputc(',', out);
        print_json_number(out, "step_s", apc_ns_to_s(c->step));
        values(out, "expected", c->expected, c->n);
        values(out, "came", c->came, c->n);
        fputc('}', out);
    }
    fputc(']', out);
}

/* SPDX-License-Identifier: BSD-3-Clause */
#include "print_prediction.h"

#include "print.h"

static void put_prediction_row(struct print_table *table, const struct prediction_trajectory *c, size_t k)
{
    print_cell(table, PRINT_PLAIN, "%s", k == 0 ? c->name : "");
    print_number(table, 6, prediction_ahead(c, k));
    print_number(table, 6, c->expected[k]);
    print_number(table, 6, c->came[k]);
    print_number(table, 6, c->came[k] - c->expected[k]);
}

void prediction_table(const struct prediction *o, struct print_table *table)
{
    static const struct print_column columns[] = {{"expected", PRINT_LEFT},
                                                  {"ahead s", PRINT_POINT},
                                                  {"value", PRINT_POINT},
                                                  {"came", PRINT_POINT},
                                                  {"difference", PRINT_POINT}};
    print_table_open(table, columns, sizeof columns / sizeof *columns);
    for (size_t i = 0; i < o->n; i++) {
        const struct prediction_trajectory *c = &o->trajectory[i];
        for (size_t k = 1; k < c->n; k *= 2)
            put_prediction_row(table, c, k - 1);
        put_prediction_row(table, c, c->n - 1);
    }
}

int prediction_print(const struct prediction *o, FILE *out)
{
    struct print_table table;
    prediction_table(o, &table);
    return print_table_end(&table, out, false, 0);
}

static void values_member(struct text *t, const char *name, const double *v, size_t n)
{
    json_add(t, "%s:[", name);
    for (size_t k = 0; k < n; k++)
        json_add(t, "%g", v[k]);
    json_add(t, "]");
}

void prediction_member(const struct prediction *o, struct text *t)
{
    json_add(t, "expectations:[");
    for (size_t i = 0; i < o->n; i++) {
        const struct prediction_trajectory *c = &o->trajectory[i];
        json_add(t, "{variable:%s, table:%s, made_s:%g, first_s:%g, step_s:%g", c->name,
                 apc_table_name(c->table), apc_ns_to_s(c->made), apc_ns_to_s(c->first), apc_ns_to_s(c->step));
        values_member(t, "expected", c->expected, c->n);
        values_member(t, "came", c->came, c->n);
        json_add(t, "}");
    }
    json_add(t, "]");
}

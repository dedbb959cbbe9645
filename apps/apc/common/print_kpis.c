/* SPDX-License-Identifier: BSD-3-Clause */
#include "print_kpis.h"

#include <math.h>

#include "print.h"

static void put_kpi(struct print_table *table, double value)
{
    if (isnan(value))
        print_cell(table, PRINT_PLAIN, "-");
    else
        print_cell(table, PRINT_PLAIN, "%.4g", value);
}

static int show_kpi_table(struct print_table *table, FILE *out)
{
    int rc = table->n > 0 ? print_table_show(table, out, false, 0, "\n") : 0;
    print_table_close(table);
    return rc;
}

static int print_loops(const struct kpis *m, FILE *out)
{
    static const struct print_column columns[] = {{"loop", PRINT_LEFT},
                                                  {"service factor %", PRINT_POINT},
                                                  {"at low limit %", PRINT_POINT},
                                                  {"at high limit %", PRINT_POINT},
                                                  {"SD in service", PRINT_POINT},
                                                  {"SD out of service", PRINT_POINT},
                                                  {"SD reduction %", PRINT_POINT}};
    struct print_table table;
    print_table_open(&table, columns, sizeof columns / sizeof *columns);
    for (size_t i = 0; i < m->n_loops; i++) {
        const struct kpis_loop *l = &m->loop[i];
        print_cell(&table, PRINT_PLAIN, "%s", l->name);
        put_kpi(&table, 100 * l->service);
        put_kpi(&table, 100 * l->low);
        put_kpi(&table, 100 * l->high);
        put_kpi(&table, l->with);
        put_kpi(&table, l->without);
        put_kpi(&table, 100 * l->benefit);
    }
    return show_kpi_table(&table, out);
}

static int print_predictions(const struct kpis *m, FILE *out)
{
    static const struct print_column columns[] = {{"predicted", PRINT_LEFT},
                                                  {"a step s", PRINT_POINT},
                                                  {"rms 1 step", PRINT_POINT},
                                                  {"all steps", PRINT_POINT},
                                                  {"rms all steps", PRINT_POINT}};
    struct print_table table;
    print_table_open(&table, columns, sizeof columns / sizeof *columns);
    for (size_t i = 0; i < m->n_predictions; i++) {
        const struct kpis_prediction *p = &m->prediction[i];
        print_cell(&table, PRINT_PLAIN, "%s", p->name);
        put_kpi(&table, p->step);
        put_kpi(&table, p->first);
        print_cell(&table, PRINT_PLAIN, "%zu", p->length);
        put_kpi(&table, p->last);
    }
    return show_kpi_table(&table, out);
}

static int print_limits(const struct kpis *m, FILE *out)
{
    static const struct print_column columns[] = {{"active constraints", PRINT_LEFT},
                                                  {"at low limit %", PRINT_POINT},
                                                  {"at high limit %", PRINT_POINT},
                                                  {"at low rate limit %", PRINT_POINT},
                                                  {"at high rate limit %", PRINT_POINT}};
    struct print_table table;
    print_table_open(&table, columns, sizeof columns / sizeof *columns);
    for (size_t i = 0; i < m->n_limits; i++) {
        const struct kpis_limit *l = &m->limit[i];
        print_cell(&table, PRINT_PLAIN, "%s", l->name);
        put_kpi(&table, 100 * l->low);
        put_kpi(&table, 100 * l->high);
        put_kpi(&table, 100 * l->falls);
        put_kpi(&table, 100 * l->rises);
    }
    return show_kpi_table(&table, out);
}

int kpis_print(const struct kpis *m, FILE *out)
{
    int rc = print_loops(m, out);
    if (rc == 0)
        rc = print_predictions(m, out);
    return rc == 0 ? print_limits(m, out) : rc;
}

/* ---- For programs ------------------------------------------------------------------------- */

static void number_member_json(FILE *out, const char *key, double value)
{
    fputc(',', out);
    print_json_number(out, key, value);
}

static void loop_kpis_json(const struct kpis_loop *l, FILE *out)
{
    print_json_text(out, "loop", l->name);
    number_member_json(out, "service", l->service);
    number_member_json(out, "at_low", l->low);
    number_member_json(out, "at_high", l->high);
    number_member_json(out, "sd_in_service", l->with);
    number_member_json(out, "sd_without", l->without);
    number_member_json(out, "benefit", l->benefit);
}

static void json_prediction(const struct kpis_prediction *p, FILE *out)
{
    print_json_text(out, "variable", p->name);
    number_member_json(out, "step_s", p->step);
    fprintf(out, ",\"steps\":%zu", p->length);
    number_member_json(out, "rms_one_step", p->first);
    number_member_json(out, "rms_all_steps", p->last);
}

static void json_limit(const struct kpis_limit *l, FILE *out)
{
    print_json_text(out, "variable", l->name);
    fprintf(out, ",\"plans\":%llu", (unsigned long long)l->plans);
    number_member_json(out, "low", l->low);
    number_member_json(out, "high", l->high);
    number_member_json(out, "falls", l->falls);
    number_member_json(out, "rises", l->rises);
}

static void kpis_member_json(const char *name, const struct kpis *m, apc_ns start, FILE *out)
{
    fprintf(out, "\"%s\":{", name);
    print_json_number(out, "from_s", apc_ns_to_s(m->from - start));
    number_member_json(out, "until_s", apc_ns_to_s(m->until - start));
    fputs(",\"loops\":[", out);
    for (size_t i = 0; i < m->n_loops; i++) {
        fputs(i ? ",{" : "{", out);
        loop_kpis_json(&m->loop[i], out);
        fputc('}', out);
    }
    fputs("],\"predictions\":[", out);
    for (size_t i = 0; i < m->n_predictions; i++) {
        fputs(i ? ",{" : "{", out);
        json_prediction(&m->prediction[i], out);
        fputc('}', out);
    }
    fputs("],\"plans\":[", out);
    for (size_t i = 0; i < m->n_limits; i++) {
        fputs(i ? ",{" : "{", out);
        json_limit(&m->limit[i], out);
        fputc('}', out);
    }
    fputs("]}", out);
}

void kpis_json(const struct kpis *m, apc_ns start, FILE *out)
{
    kpis_member_json("kpis", m, start, out);
    fputc(',', out);
    kpis_member_json("merits", m, start, out); /* the name before: for one more version */
}

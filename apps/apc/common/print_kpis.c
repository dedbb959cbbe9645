/* SPDX-License-Identifier: BSD-3-Clause */
#include "print_kpis.h"

#include <math.h>

#include "print.h"

static int print_loops(const struct kpis *m, FILE *out)
{
    static const struct print_column columns[] = {{"loop", PRINT_LEFT},
                                                  {"measurement", PRINT_LEFT},
                                                  {"service factor %", PRINT_POINT},
                                                  {"at low limit %", PRINT_POINT},
                                                  {"at high limit %", PRINT_POINT},
                                                  {"SD in service", PRINT_POINT},
                                                  {"SD out of service", PRINT_POINT},
                                                  {"SD reduction %", PRINT_POINT}};
    struct print_table table;
    bool short_of = false;
    print_table_open(&table, columns, sizeof columns / sizeof *columns);
    for (size_t i = 0; i < m->n_loops; i++) {
        const struct kpis_loop *l = &m->loop[i];
        print_cell(&table, PRINT_PLAIN, "%s", l->name);
        print_cell(&table, PRINT_PLAIN, "%s", l->measurement);
        print_number(&table, 4, 100 * l->service);
        print_number(&table, 4, 100 * l->low);
        print_number(&table, 4, 100 * l->high);
        print_number(&table, 4, l->with);
        print_number(&table, 4, l->without);
        print_number(&table, 4, 100 * l->benefit);
        short_of |= isnan(l->benefit) && !isnan(l->with) && !isnan(l->without);
    }
    const int rc = print_table_end(&table, out, false, 0);
    if (rc == 0 && short_of)
        fprintf(out,
                "No SD reduction: the loop must be in service, and out of it, for at least %d controller "
                "periods, with as many measurements.\n",
                KPIS_LEAST);
    return rc;
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
        print_number(&table, 4, p->step);
        print_number(&table, 4, p->first);
        print_cell(&table, PRINT_PLAIN, "%zu", p->length);
        print_number(&table, 4, p->last);
    }
    return print_table_end(&table, out, false, 0);
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
        print_number(&table, 4, 100 * l->low);
        print_number(&table, 4, 100 * l->high);
        print_number(&table, 4, 100 * l->falls);
        print_number(&table, 4, 100 * l->rises);
    }
    return print_table_end(&table, out, false, 0);
}

int kpis_print(const struct kpis *m, FILE *out)
{
    int rc = print_loops(m, out);
    if (rc == 0)
        rc = print_predictions(m, out);
    return rc == 0 ? print_limits(m, out) : rc;
}

/* ---- For programs ------------------------------------------------------------------------- */

static void kpis_member_json(const char *name, const struct kpis *m, apc_ns start, struct text *t)
{
    json_add(t, "%s:{from_s:%g, until_s:%g, loops:[", name, apc_ns_to_s(m->from - start),
             apc_ns_to_s(m->until - start));
    for (const struct kpis_loop *l = m->loop; l < m->loop + m->n_loops; l++)
        json_add(t,
                 "{loop:%s, measurement:%s, service:%g, at_low:%g, at_high:%g, sd_in_service:%g, "
                 "sd_without:%g, benefit:%g}",
                 l->name, l->measurement, l->service, l->low, l->high, l->with, l->without, l->benefit);
    json_add(t, "], predictions:[");
    for (const struct kpis_prediction *p = m->prediction; p < m->prediction + m->n_predictions; p++)
        json_add(t, "{variable:%s, step_s:%g, steps:%zu, rms_one_step:%g, rms_all_steps:%g}", p->name,
                 p->step, p->length, p->first, p->last);
    json_add(t, "], plans:[");
    for (const struct kpis_limit *l = m->limit; l < m->limit + m->n_limits; l++)
        json_add(t, "{variable:%s, plans:%ju, low:%g, high:%g, falls:%g, rises:%g}", l->name, l->plans,
                 l->low, l->high, l->falls, l->rises);
    json_add(t, "]}");
}

void kpis_members(const struct kpis *m, apc_ns start, struct text *t)
{
    kpis_member_json("kpis", m, start, t);
    kpis_member_json("merits", m, start, t); /* the name before: for one more version */
}

/* SPDX-License-Identifier: BSD-3-Clause */
#include "print_figures.h"

#include <math.h>

#include "print.h"

static void print_row(struct print_table *table, const double *figure)
{
    for (int i = 0; i < METRICS; i++)
        if (isnan(figure[i]))
            print_cell(table, PRINT_PLAIN, "-");
        else if (isinf(figure[i]))
            print_cell(table, PRINT_PLAIN, i == METRIC_SETTLING || i == METRIC_RECOVERY ? "never" : "inf");
        else
            print_cell(table, PRINT_PLAIN, "%.6g", figure[i]);
}

int figures_print(const struct figures *f, const struct trajectory *c, const struct experiment *e,
                  size_t most, FILE *out)
{
    struct print_column columns[3 + METRICS] = {
        {"loop", PRINT_LEFT}, {"from", PRINT_LEFT}, {"at s", PRINT_POINT}};
    struct print_table table;
    char event[200];
    size_t rows = f->n_loops * (1 + f->n_parts);

    for (int i = 0; i < METRICS; i++)
        columns[3 + i] = (struct print_column){metric_name((enum metric)i), PRINT_POINT};
    print_table_open(&table, columns, 3 + METRICS);
    for (size_t loop = 0; loop < f->n_loops; loop++) {
        const struct metrics *m = &f->of[loop];
        print_cell(&table, PRINT_PLAIN, "%s", f->loop[loop].name);
        print_cell(&table, PRINT_PLAIN, "all");
        print_cell(&table, PRINT_PLAIN, "%s", "");
        print_row(&table, m->figure);
        for (size_t k = 0; k < f->n_parts; k++) {
            figures_name_part(f, &m->part[k], e, event, sizeof event);
            print_cell(&table, PRINT_PLAIN, "%s", "");
            print_cell(&table, PRINT_PLAIN, "%s", event);
            print_cell(&table, PRINT_PLAIN, "%.6g", m->part[k].from);
            print_row(&table, m->part[k].figure);
        }
    }
    int rc = print_table_end(&table, out, false, most);
    if (most > 0 && rows > most)
        fprintf(out, "... and %zu rows more: --json has all\n", rows - most);
    if (c->measured)
        fputs("of what was measured: the plant's own outputs are not on record\n", out);
    return rc;
}

static void put_figure_numbers(struct text *t, const double *figure)
{
    for (int i = 0; i < METRICS; i++) {
        const char *former = metric_former_key((enum metric)i);
        json_add(t, "%s:%g", metric_key((enum metric)i), figure[i]);
        if (former)
            json_add(t, "%s:%g", former, figure[i]);
    }
    const bool recovered = !isinf(figure[METRIC_RECOVERY]);
    if (!isnan(figure[METRIC_SETTLING]))
        json_add(t, "settled:%i", !isinf(figure[METRIC_SETTLING]));
    if (!isnan(figure[METRIC_RECOVERY]))
        json_add(t, "recovered:%i, returned:%i", recovered, recovered); /* the latter is deprecated */
}

static void put_events(struct text *t, const struct figures *f, const struct part *part,
                       const struct experiment *e)
{
    static const char *const kinds[] = {
        [EVENT_START] = "start", [EVENT_SETPOINT] = "setpoint", [EVENT_DISTURBANCE] = "disturbance"};
    json_add(t, "events:[");
    for (size_t i = part->first; i < part->first + part->n; i++) {
        const struct event *event = &f->event[i];
        json_add(t, "{kind:%s", kinds[event->kind]);
        if (event->kind != EVENT_START)
            json_add(t, "variable:%s, from:%g, to:%g", figures_variable(event, e), event->from, event->to);
        if (event->over > 0)
            json_add(t, "over_s:%g", event->over);
        json_add(t, "}");
    }
    json_add(t, "]");
}

void figures_members(const struct figures *f, const struct trajectory *c, const struct experiment *e,
                     struct text *t)
{
    json_add(t, "of:%s, ended_s:%g, diverged:%i, loops:[", c->measured ? "measurements" : "plant", c->end,
             c->diverged);
    for (size_t loop = 0; loop < f->n_loops; loop++) {
        const struct metrics *m = &f->of[loop];
        json_add(t, "{loop:%s, unit:%s", f->loop[loop].name, e->y[f->loop[loop].y].tag.unit);
        put_figure_numbers(t, m->figure);
        json_add(t, "parts:[");
        for (size_t k = 0; k < f->n_parts; k++) {
            json_add(t, "{");
            put_events(t, f, &m->part[k], e);
            json_add(t, "from_s:%g, until_s:%g", m->part[k].from, m->part[k].to);
            put_figure_numbers(t, m->part[k].figure);
            json_add(t, "}");
        }
        json_add(t, "]}");
    }
    json_add(t, "]");
}

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
    int rc = print_table_show(&table, out, false, most, "\n");
    print_table_close(&table);
    if (most > 0 && rows > most)
        fprintf(out, "... and %zu rows more: --json has all\n", rows - most);
    if (c->measured)
        fputs("of what was measured: the plant's own outputs are not on record\n", out);
    return rc;
}

static void put_figure_numbers(FILE *out, const double *figure)
{
    for (int i = 0; i < METRICS; i++) {
        fputc(',', out);
        print_json_number(out, metric_key((enum metric)i), figure[i]);
        const char *former = metric_former_key((enum metric)i);
        if (former) {
            fputc(',', out);
            print_json_number(out, former, figure[i]);
        }
    }
    if (!isnan(figure[METRIC_SETTLING]))
        fprintf(out, ",\"settled\":%s", isinf(figure[METRIC_SETTLING]) ? "false" : "true");
    if (!isnan(figure[METRIC_RECOVERY])) {
        const char *recovered = isinf(figure[METRIC_RECOVERY]) ? "false" : "true";
        fprintf(out, ",\"recovered\":%s,\"returned\":%s", recovered,
                recovered); /* the latter is deprecated */
    }
}

static void put_events(FILE *out, const struct figures *f, const struct part *part,
                       const struct experiment *e)
{
    static const char *const kinds[] = {
        [EVENT_START] = "start", [EVENT_SETPOINT] = "setpoint", [EVENT_DISTURBANCE] = "disturbance"};
    fputs("\"events\":[", out);
    for (size_t i = part->first; i < part->first + part->n; i++) {
        const struct event *event = &f->event[i];
        fprintf(out, "%s{\"kind\":\"%s\"", i > part->first ? "," : "", kinds[event->kind]);
        if (event->kind != EVENT_START) {
            fputc(',', out);
            print_json_text(out, "variable", figures_variable(event, e));
            fputc(',', out);
            print_json_number(out, "from", event->from);
            fputc(',', out);
            print_json_number(out, "to", event->to);
        }
        fputc('}', out);
    }
    fputc(']', out);
}

void figures_json(const struct figures *f, const struct trajectory *c, const struct experiment *e, FILE *out)
{
    fprintf(out, "\"of\":\"%s\",", c->measured ? "measurements" : "plant");
    print_json_number(out, "ended_s", c->end);
    fprintf(out, ",\"diverged\":%s,\"loops\":[", c->diverged ? "true" : "false");
    for (size_t loop = 0; loop < f->n_loops; loop++) {
        const struct metrics *m = &f->of[loop];
        const struct apc_tag *tag = &e->y[f->loop[loop].y].tag;
        fprintf(out, "%s{", loop ? "," : "");
        print_json_text(out, "loop", f->loop[loop].name);
        fputc(',', out);
        print_json_text(out, "unit", tag->unit);
        put_figure_numbers(out, m->figure);
        fputs(",\"parts\":[", out);
        for (size_t k = 0; k < f->n_parts; k++) {
            fputs(k ? ",{" : "{", out);
            put_events(out, f, &m->part[k], e);
            fputc(',', out);
            print_json_number(out, "from_s", m->part[k].from);
            fputc(',', out);
            print_json_number(out, "until_s", m->part[k].to);
            put_figure_numbers(out, m->part[k].figure);
            fputc('}', out);
        }
        fputs("]}", out);
    }
    fputc(']', out);
}

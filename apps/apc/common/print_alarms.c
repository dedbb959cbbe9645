/* SPDX-License-Identifier: BSD-3-Clause */
#include "print_alarms.h"

#include <math.h>

#include "print.h"

#define MOST 20 /* alarms that are shown */

static const struct print_column columns[] = {
    {"alarm", PRINT_LEFT},     {"priority", PRINT_RIGHT},  {"first s", PRINT_POINT}, {"times", PRINT_RIGHT},
    {"active s", PRINT_POINT}, {"at the end", PRINT_LEFT}, {"message", PRINT_LEFT}};
#define COLUMNS (sizeof columns / sizeof *columns)

static void add_alarm_row(struct print_table *table, const struct alarm_figure *of, const struct alarm *alarm,
                          apc_ns start)
{
    const char *state = apc_alarm_state_name(of->state);
    print_cell(table, PRINT_PLAIN, "%s", alarm->name);
    print_cell(table, PRINT_PLAIN, "%d", alarm->is.priority);
    print_cell(table, PRINT_PLAIN, "%.6g", apc_ns_to_s(of->first - start));
    print_cell(table, PRINT_PLAIN, "%zu%s", of->raised, of->chatters ? " chatters" : "");
    print_cell(table, PRINT_PLAIN, "%.6g", apc_ns_to_s(of->active));
    print_cell(table, PRINT_PLAIN, "%s", state ? state : "?");
    print_cell(table, PRINT_PLAIN, "%s", alarm->message);
}

static void summarize(const struct alarm_figures *f, FILE *out)
{
    fprintf(out, "alarms: %zu raised in %.3g h, %.3g an hour; priority 1: %zu, 2: %zu, 3: %zu, 4: %zu\n",
            f->raised, f->hours, f->per_hour, f->by_priority[0], f->by_priority[1], f->by_priority[2],
            f->by_priority[3]);
    fprintf(out, "        most in ten minutes: %zu; floods (more than %d): %zu of %zu", f->peak, ALARMS_FLOOD,
            f->floods, f->windows);
    fprintf(out, "; chattering: %zu; standing: %zu, for over 24 h: %zu; unacknowledged: %zu", f->chattering,
            f->standing, f->stale, f->unacked);
    if (!isnan(f->to_acknowledge))
        fprintf(out, "; acknowledged after %.3g s on average", f->to_acknowledge);
    fputc('\n', out);
}

int alarms_print(const struct alarm_figures *f, const struct experiment *e, apc_ns start, FILE *out)
{
    struct print_table table;
    summarize(f, out);
    print_table_open(&table, columns, COLUMNS);
    for (size_t i = 0; i < f->n; i++)
        if (f->alarm[i].raised > 0)
            add_alarm_row(&table, &f->alarm[i], &e->alarm[i], start);
    const int rc = table.n > 0 ? print_table_show(&table, out, false, MOST, "\n") : 0;
    print_table_close(&table);
    return rc;
}

/* ---- For programs ------------------------------------------------------------------------- */

static void alarm_figure_json(const struct alarm_figure *of, const struct alarm *alarm, apc_ns start,
                              FILE *out)
{
    fputc('{', out);
    print_json_text(out, "alarm", alarm->name);
    fprintf(out, ",\"priority\":%d,\"raised\":%zu,\"chatters\":%s,", alarm->is.priority, of->raised,
            of->chatters ? "true" : "false");
    print_json_number(out, "first_s", of->raised ? apc_ns_to_s(of->first - start) : (double)NAN);
    fputc(',', out);
    print_json_number(out, "active_s", apc_ns_to_s(of->active));
    fputc(',', out);
    print_json_text(out, "state", apc_alarm_state_name(of->state));
    fputc(',', out);
    print_json_text(out, "message", alarm->message);
    fputc('}', out);
}

void alarms_json(const struct alarm_figures *f, const struct experiment *e, apc_ns start, FILE *out)
{
    fputs(",\"alarms\":{", out);
    print_json_number(out, "hours", f->hours);
    fprintf(out, ",\"raised\":%zu,\"by_priority\":[%zu,%zu,%zu,%zu],", f->raised, f->by_priority[0],
            f->by_priority[1], f->by_priority[2], f->by_priority[3]);
    print_json_number(out, "per_hour", f->per_hour);
    fprintf(out,
            ",\"most_in_ten_minutes\":%zu,\"floods\":%zu,\"windows\":%zu,\"chattering\":%zu,\"standing\":%zu,"
            "\"stale\":%zu,\"unacknowledged\":%zu,",
            f->peak, f->floods, f->windows, f->chattering, f->standing, f->stale, f->unacked);
    print_json_number(out, "to_acknowledge_s", f->to_acknowledge);
    fputs(",\"each\":[", out);
    bool first = true;
    for (size_t i = 0; i < f->n; i++) {
        if (f->alarm[i].raised == 0)
            continue;
        fputs(first ? "" : ",", out);
        alarm_figure_json(&f->alarm[i], &e->alarm[i], start, out);
        first = false;
    }
    fputs("]}", out);
}

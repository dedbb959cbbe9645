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
    return print_table_end(&table, out, false, MOST);
}

/* ---- For programs ------------------------------------------------------------------------- */

static void alarm_figure_json(const struct alarm_figure *of, const struct alarm *alarm, apc_ns start,
                              struct text *t)
{
    json_add(
        t, "{alarm:%s, priority:%d, raised:%zu, chatters:%i, first_s:%g, active_s:%g, state:%s, message:%s}",
        alarm->name, alarm->is.priority, of->raised, of->chatters,
        of->raised ? apc_ns_to_s(of->first - start) : (double)NAN, apc_ns_to_s(of->active),
        apc_alarm_state_name(of->state), alarm->message);
}

void alarms_member_json(const struct alarm_figures *f, const struct experiment *e, apc_ns start,
                        struct text *t)
{
    json_add(t, "alarms:{hours:%g, raised:%zu, by_priority:[%zu, %zu, %zu, %zu], per_hour:%g", f->hours,
             f->raised, f->by_priority[0], f->by_priority[1], f->by_priority[2], f->by_priority[3],
             f->per_hour);
    json_add(t, "most_in_ten_minutes:%zu, floods:%zu, windows:%zu, chattering:%zu, standing:%zu, stale:%zu",
             f->peak, f->floods, f->windows, f->chattering, f->standing, f->stale);
    json_add(t, "unacknowledged:%zu, to_acknowledge_s:%g, each:[", f->unacked, f->to_acknowledge);
    for (size_t i = 0; i < f->n; i++)
        if (f->alarm[i].raised > 0)
            alarm_figure_json(&f->alarm[i], &e->alarm[i], start, t);
    json_add(t, "]}");
}

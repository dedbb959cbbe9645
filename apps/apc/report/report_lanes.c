/* SPDX-License-Identifier: BSD-3-Clause */
/*
 * Who had which loop: a lane for each loop whose actual mode was not the same all the time, a bar for each
 * mode. A loop in Auto whose target is another mode was shed, and is called so.
 */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "report_panels.h"

#define LANES_MAX 12 /* more could not be told apart from the panels */

struct look {
    const char *text;
    unsigned colour;
};

static struct look look_of(const struct report_point *point)
{
    static const struct look looks[] = {
        [APC_MODE_MAN] = {"Man", 0xE3B8D0},   [APC_MODE_AUTO] = {"Auto", 0xD8D8D8},
        [APC_MODE_OOS] = {"OOS", 0xFFFFFF},   [APC_MODE_CAS] = {"Cas", 0xB5D3E7},
        [APC_MODE_IMAN] = {"IMan", 0xF3F3F3}, [APC_MODE_LO] = {"LO", 0xE8A07A}};
    const size_t mode = point->value >= 0 ? (size_t)point->value : APC_MODE_OOS;
    if (mode == APC_MODE_AUTO && point->severity != APC_SEVERITY_GOOD)
        return (struct look){"shed", 0xF5D58A};
    return looks[mode < sizeof looks / sizeof *looks ? mode : APC_MODE_OOS];
}

static bool changed(const struct report_series *series)
{
    for (size_t k = 1; k < series->n; k++)
        if (series->points[k].t > 0 &&
            strcmp(look_of(&series->points[k]).text, look_of(&series->points[k - 1]).text) != 0)
            return true;
    return false;
}

/* Until when its controller ran on from @p t: to the next kill of the experiment; *again: when it was
 * started. */
static double killed_from(const struct experiment *e, size_t controller, double t, double *again)
{
    double from = HUGE_VAL;
    *again = HUGE_VAL;
    for (size_t i = 0; i < e->n_actions; i++) {
        const struct action *a = &e->action[i];
        const double at = apc_ns_to_s(a->at);
        if (a->kind == ACTION_WRITE || a->controller != controller || at <= t)
            continue;
        if (a->kind == ACTION_KILL && from == HUGE_VAL)
            from = at;
        if (a->kind == ACTION_START && from < at && *again == HUGE_VAL)
            *again = at;
    }
    return from;
}

static void put_bar(FILE *script, size_t lane, double from, double to, struct look look)
{
    if (to > from)
        fprintf(script, "%zu %#.9g %#.9g %u %s\n", lane, from, to, look.colour, look.text);
}

static void put_lane(FILE *script, const struct report_data *data, const struct experiment *e,
                     const struct loops_loop *loop, size_t lane)
{
    static const struct look dead = {"killed", 0xFFFFFF};
    const struct report_series *s = &data->mode.series[loop->id - 1];
    for (size_t k = 0; k < s->n; k++) {
        const double from = fmax(s->points[k].t, data->begin),
                     to = k + 1 < s->n ? s->points[k + 1].t : data->end;
        double again, killed = killed_from(e, loop->controller, from, &again);
        put_bar(script, lane, from, fmin(to, killed), look_of(&s->points[k]));
        put_bar(script, lane, killed, fmin(to, again), dead);
        put_bar(script, lane, again, to, look_of(&s->points[k]));
    }
}

void report_lanes_put(FILE *script, const struct report_data *data, const struct experiment *e,
                      const struct loops *loops)
{
    const struct loops_loop *lane[LANES_MAX];
    size_t n = 0;
    for (size_t i = 0; i < loops->n && i < data->mode.n && n < LANES_MAX; i++)
        if (changed(&data->mode.series[loops->at[i].id - 1]))
            lane[n++] = &loops->at[i];
    fprintf(script, "lanes = %zu\narray lane[%d]\n", n, LANES_MAX);
    for (size_t i = 0; i < n; i++)
        gnuplot_text(script, "lane", i, lane[i]->name);
    fputs("$bar << END\n", script);
    for (size_t i = 0; i < n; i++)
        put_lane(script, data, e, lane[i], i + 1);
    fputs("END\n", script);
}

/* SPDX-License-Identifier: BSD-3-Clause */
/*
 * Who had which loop: a lane for each loop whose actual mode was not the same all the time, a bar for each
 * mode. A loop in Auto whose target is another mode was shed, and is called so.
 */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "operate/operate.h"
#include "report_script.h"

#define LANE      17.0
#define LANES_MAX 12 /* more could not be told apart from the panels */
#define LETTER    6.0

struct lane {
    const struct loops_loop *loop;
    const struct report_series *series;
};

struct report_lanes {
    const struct experiment *e;
    struct lane lane[LANES_MAX];
    size_t n;
    double begin, end;
};

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

int report_lanes_create(struct report_lanes **lanes, const struct report_data *data,
                        const struct experiment *e, const struct loops *loops)
{
    struct report_lanes *l = calloc(1, sizeof *l);
    *lanes = l;
    if (!l)
        return APC_ENOMEM;
    l->e = e;
    l->begin = data->begin;
    l->end = data->end;
    for (size_t i = 0; i < loops->n && i < data->mode.n && l->n < LANES_MAX; i++)
        if (changed(&data->mode.series[loops->at[i].id - 1]))
            l->lane[l->n++] = (struct lane){&loops->at[i], &data->mode.series[loops->at[i].id - 1]};
    return 0;
}

void report_lanes_destroy(struct report_lanes *lanes)
{
    free(lanes);
}

double report_lanes_height(const struct report_lanes *lanes)
{
    return lanes->n > 0 ? (double)lanes->n * LANE + LANES_GAP : 0;
}

/* Until when its controller ran on from @p t: to the next kill of the experiment; *again: when it was
 * started. */
static double killed_from(const struct report_lanes *l, size_t controller, double t, double *again)
{
    double from = HUGE_VAL;
    *again = HUGE_VAL;
    for (size_t i = 0; i < l->e->n_actions; i++) {
        const struct action *a = &l->e->action[i];
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

struct canvas {
    FILE *script;
    double unit, length, width;
};

static void put_bar(const struct canvas *c, double from, double to, double y, struct look look)
{
    const double wide = (to - from) / c->length * c->width;
    if (!(to > from))
        return;
    fprintf(c->script, "set object rect from %.9g, %.9g to %.9g, %.9g back fs solid noborder fc rgb 0x%06X\n",
            from / c->unit, y + 0.1, to / c->unit, y + 0.9, look.colour);
    if (wide > LETTER * (double)strlen(look.text) + 4)
        fprintf(c->script, "set label '{/*0.85 %s}' at %.9g, %.9g center textcolor rgb 0x333333\n", look.text,
                (from + to) / 2 / c->unit, y + 0.5);
}

static void put_lane(const struct canvas *c, const struct report_lanes *l, const struct lane *lane, double y)
{
    static const struct look dead = {"killed", 0xFFFFFF};
    const struct report_series *s = lane->series;
    for (size_t k = 0; k < s->n; k++) {
        const double from = fmax(s->points[k].t, l->begin), to = k + 1 < s->n ? s->points[k + 1].t : l->end;
        double again, killed = killed_from(l, lane->loop->controller, from, &again);
        put_bar(c, from, fmin(to, killed), y, look_of(&s->points[k]));
        put_bar(c, killed, fmin(to, again), y, dead);
        put_bar(c, again, to, y, look_of(&s->points[k]));
    }
}

void report_lanes_draw(FILE *script, const struct report_lanes *l, double unit, double length, double width)
{
    const struct canvas c = {script, unit, length, width};
    fprintf(script, "unset border\nunset tics\nunset key\nset yrange [0:%zu]\n", l->n);
    for (size_t i = 0; i < l->n; i++) {
        const double y = (double)(l->n - 1 - i);
        fputs("set label ", script);
        report_quoted(script, l->lane[i].loop->name);
        fprintf(script, " at graph -0.012, first %.9g right noenhanced\n", y + 0.5);
        put_lane(&c, l, &l->lane[i], y);
    }
    fputs("plot NaN notitle\n", script);
}

/* SPDX-License-Identifier: BSD-3-Clause */
#include "replay_curves.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "compare.h"
#include "files/files.h"

#define AROUND 60     /* ticks of the loop that differs first, a fifth of them before that */
#define SPAN   7200.0 /* s; by which the ticks of one loop may come behind those of another, and more */
#define FULL   65536  /* points of a loop, from which on it is thinned */
#define OLD    8192   /* stretches of the same length that remain of what lies long back */

static struct replay_curve *curve_of(struct replay_curves *k, const char *loop)
{
    size_t i = 0;
    while (i < k->n && strcmp(k->of[i].loop.name, loop) != 0)
        i++;
    if (i == k->n) {
        struct replay_curve *of = realloc(k->of, (i + 1) * sizeof *of);
        if (!of)
            return NULL;
        k->of = of;
        of[k->n++] = (struct replay_curve){.loop = {.table = APC_ACTUATOR, .id = (int)i + 1}};
        snprintf(of[i].loop.name, sizeof of[i].loop.name, "%s", loop);
    }
    return &k->of[i];
}

/* Of each stretch of what lies long back the lowest and the highest point are left, so that no spike of it is lost.
 * Nothing differs in them: that is what is waited for. */
static void thin_curve(struct replay_curve *c)
{
    const double begin = c->at[0].t, until = c->at[c->n - 1].t - SPAN, length = (until - begin) / OLD;
    size_t n = 0, i = 0;
    while (i < c->n && c->at[i].t < until) {
        const double stretch = floor((c->at[i].t - begin) / length);
        size_t low = i, high = i;
        for (; i < c->n && c->at[i].t < until && floor((c->at[i].t - begin) / length) <= stretch; i++) {
            low = isnan(c->at[low].recorded) || c->at[i].recorded < c->at[low].recorded ? i : low;
            high = isnan(c->at[high].recorded) || c->at[i].recorded >= c->at[high].recorded ? i : high;
        }
        const struct replay_point early = c->at[low < high ? low : high],
                                  late = c->at[low < high ? high : low];
        c->at[n++] = early;
        if (low != high)
            c->at[n++] = late;
    }
    memmove(c->at + n, c->at + i, (c->n - i) * sizeof *c->at);
    c->n -= i - n;
}

static bool make_point_room(struct replay_curve *c)
{
    if (c->n < c->room)
        return true;
    const size_t room = c->room > 0 ? 2 * c->room : 1024;
    struct replay_point *at = reallocarray(c->at, room, sizeof *at);
    if (!at)
        return false;
    c->at = at;
    c->room = room;
    return true;
}

void replay_curves_keep(struct replay_curves *k, double t, const char *loop, double recorded, double replayed)
{
    struct replay_curve *c = curve_of(k, loop);
    const bool ends = k->end > 0;
    if (c && c->n == c->room && c->n >= FULL && !ends && !k->whole)
        thin_curve(c);
    k->failed = k->failed || !c || !make_point_room(c);
    if (k->failed || (ends && t > k->end))
        return;
    if (fabs(recorded - replayed) > 0 && (!ends || t < k->first)) {
        k->first = t;
        k->end = t + fmax(SPAN, c->n > 0 ? AROUND * (t - c->at[c->n - 1].t) : 0);
    }
    c->at[c->n++] = (struct replay_point){t, recorded, replayed};
}

/* The points around the first that differs; all, where none does. */
static void find_around(const struct replay_curves *k, struct compare_figure *f)
{
    const struct replay_point *first = NULL;
    double period = 1;
    f->begin = HUGE_VAL;
    for (size_t i = 0; i < k->n; i++)
        for (size_t p = 0; p < k->of[i].n; p++) {
            const struct replay_point *at = &k->of[i].at[p];
            f->begin = fmin(f->begin, at->t);
            f->end = fmax(f->end, at->t);
            if (fabs(at->recorded - at->replayed) > 0 && (!first || at->t < first->t)) {
                first = at;
                period = p > 0 ? at->t - at[-1].t : p + 1 < k->of[i].n ? at[1].t - at->t : 1;
            }
        }
    if (!first)
        return;
    f->begin = fmax(f->begin, first->t - AROUND * period / 5);
    f->end = fmin(f->end, first->t + AROUND * period * 4 / 5);
    f->from = first->t;
}

static int take_curve(struct compare_variable *v, const struct replay_curve *c)
{
    const size_t room = c->n + 1;
    v->tag = &c->loop;
    v->recorded =
        (struct trace){.t = calloc(room, sizeof(double)), .value = calloc(room, sizeof(double)), .n = c->n};
    v->simulated =
        (struct trace){.t = calloc(room, sizeof(double)), .value = calloc(room, sizeof(double)), .n = c->n};
    if (!v->recorded.t || !v->recorded.value || !v->simulated.t || !v->simulated.value)
        return APC_ENOMEM;
    for (size_t i = 0; i < c->n; i++) {
        v->recorded.t[i] = v->simulated.t[i] = c->at[i].t;
        v->recorded.value[i] = c->at[i].recorded;
        v->simulated.value[i] = c->at[i].replayed;
    }
    return 0;
}

static void keep_within(struct trace *trace, double begin, double end)
{
    size_t n = 0, before = 0;
    while (before + 1 < trace->n && trace->t[before + 1] <= begin)
        before++;
    for (size_t i = before; i < trace->n && trace->t[i] <= end; i++, n++) {
        trace->t[n] = fmax(trace->t[i], begin);
        trace->value[n] = trace->value[i];
    }
    trace->n = n;
}

int replay_curves_draw(const struct replay_curves *k, const char *title, const char *name, FILE *out,
                       struct apc_error *why)
{
    struct compare_variable *v = calloc(k->n + 1, sizeof *v);
    struct compare_figure figure = {.title = title, .label = "replayed", .of = v, .n = k->n};
    int rc = v && !k->failed ? 0 : APC_ENOMEM;
    find_around(k, &figure);
    for (size_t i = 0; i < k->n && rc == 0; i++) {
        if ((rc = take_curve(&v[i], &k->of[i])) < 0)
            break;
        keep_within(&v[i].recorded, figure.begin, figure.end);
        keep_within(&v[i].simulated, figure.begin, figure.end);
    }
    rc = rc < 0 ? apc_fail(why, rc, "out of memory") : compare_draw(&figure, name, out, why);
    for (size_t i = 0; v && i < k->n; i++) {
        trace_free(&v[i].recorded);
        trace_free(&v[i].simulated);
    }
    free(v);
    return rc;
}

void replay_curves_free(struct replay_curves *k)
{
    for (size_t i = 0; i < k->n; i++)
        free(k->of[i].at);
    free(k->of);
}

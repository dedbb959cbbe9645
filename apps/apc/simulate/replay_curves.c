/* SPDX-License-Identifier: BSD-3-Clause */
#include "replay_curves.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "compare.h"
#include "files/files.h"

void replay_curves_keep(struct replay_curves *k, double t, const char *loop, double recorded, double replayed)
{
    size_t i = 0;
    while (i < k->n && strcmp(k->loop[i].name, loop) != 0)
        i++;
    if (i == k->n && !(k->failed = k->failed || !apc_grow(&k->loop, i + 1, sizeof *k->loop))) {
        k->loop[k->n++] = (struct apc_tag){.table = APC_ACTUATOR, .id = (int)i + 1};
        snprintf(k->loop[i].name, sizeof k->loop[i].name, "%s", loop);
    }
    struct apc_sample row = {.table = APC_ACTUATOR, .id = (int)i + 1, .value = recorded};
    k->failed = k->failed || apc_ns_from_s(t, &row.time) < 0 || samples_add(&k->recorded, &row) < 0;
    row.value = replayed;
    k->failed = k->failed || samples_add(&k->replayed, &row) < 0;
}

#define AROUND 60 /* ticks of the loop that differs first, a fifth of them before that */

/* The rows around the first that differs; all, where none does. */
static void find_around(const struct replay_curves *k, struct compare_figure *f)
{
    const struct apc_sample *was = k->recorded.at, *is = k->replayed.at;
    size_t first = k->recorded.n;
    apc_ns last = 0, before = 0;
    f->begin = HUGE_VAL;
    for (size_t i = 0; i < k->recorded.n; i++) {
        last = was[i].time > last ? was[i].time : last;
        f->begin = fmin(f->begin, apc_ns_to_s(was[i].time));
        if (fabs(was[i].value - is[i].value) > 0 && (first == k->recorded.n || was[i].time < was[first].time))
            first = i;
    }
    f->end = apc_ns_to_s(last);
    if (first == k->recorded.n)
        return;
    apc_ns period = APC_NS_PER_S;
    for (size_t i = 0; i < k->recorded.n; i++)
        if (was[i].id == was[first].id && was[i].time > before) {
            period = before > 0 && was[i].time <= was[first].time ? was[i].time - before : period;
            before = was[i].time;
        }
    const double at = apc_ns_to_s(was[first].time), width = AROUND * apc_ns_to_s(period);
    f->begin = fmax(f->begin, at - width / 5);
    f->end = fmin(f->end, at + width * 4 / 5);
    f->from = at;
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
        v[i].tag = &k->loop[i];
        rc = trace_take(&v[i].recorded, &k->recorded, 0, v[i].tag);
        rc = rc < 0 ? rc : trace_take(&v[i].simulated, &k->replayed, 0, v[i].tag);
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
    free(k->loop);
    samples_free(&k->recorded);
    samples_free(&k->replayed);
}

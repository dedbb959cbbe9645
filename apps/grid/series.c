/* SPDX-License-Identifier: BSD-3-Clause */
#include "grid.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

static bool grow_series(double **at, size_t room)
{
    double *more = reallocarray(*at, room, sizeof **at);

    if (more)
        *at = more;
    return more != NULL;
}

int series_add(struct reading *r, struct series *s, double t, double value)
{
    const struct identify_selection *selection = r->selection;

    if (selection->to > 0.0 && t > selection->to)
        return 0;
    if (t < selection->from) { /* what is in force when the window begins */
        if (s < r->input || s >= r->input + r->inputs || !isfinite(value))
            return 0;
        s->n = 0;
    }
    if (s->n == s->room) {
        const size_t room = s->room ? 2 * s->room : 1024;

        if (!grow_series(&s->t, room) || !grow_series(&s->value, room))
            return apc_fail(r->why, APC_ENOMEM, "out of memory");
        s->room = room;
    }
    s->t[s->n] = t;
    s->value[s->n++] = value;
    return 0;
}

/* Of one name an actuator goes before a setpoint, and that before a measurement. */
static int rank(enum apc_table table)
{
    return table == APC_ACTUATOR ? 3 : table == APC_SETPOINT ? 2 : table == APC_SENSOR ? 1 : 0;
}

static int choose_signals(struct reading *r, struct series *s, const struct known *known, size_t n,
                          bool input, struct series **of)
{
    size_t found = n;

    for (size_t i = 0; i < n; i++) {
        if (!strcmp(known[i].name, s->name) &&
            (input ? rank(known[i].table) > 0 : known[i].table == APC_SENSOR) &&
            (found == n || rank(known[i].table) > rank(known[found].table)))
            found = i;
    }
    if (found == n)
        return apc_fail(r->why, APC_ENOTFOUND, "%s: there is no %s \"%s\"; %s has what there is", r->file,
                        input ? "output, setpoint or measurement" : "measurement", s->name,
                        r->store ? "apc status" : "signals.csv");
    if (of[found])
        return apc_fail(r->why, APC_EINVAL, "%s: \"%s\" is named twice", r->file, s->name);
    of[found] = s;
    snprintf(s->unit, sizeof s->unit, "%s", known[found].unit);
    return 0;
}

/* All of a table where none is named. */
static int take_all(struct reading *r, bool inputs, const struct known *known, size_t n_known)
{
    struct series *series = inputs ? r->input : r->output;
    size_t *n = inputs ? &r->inputs : &r->outputs;

    for (size_t i = 0; i < n_known; i++) {
        if (known[i].table != (inputs ? APC_ACTUATOR : APC_SENSOR))
            continue;
        if (*n == IDENTIFY_SIGNALS)
            return apc_fail(r->why, APC_EINVAL,
                            "%s: it has more than %d %s: name those that belong together by %s", r->file,
                            IDENTIFY_SIGNALS, inputs ? "outputs of controllers" : "measurements",
                            inputs ? "--inputs" : "--outputs");
        snprintf(series[*n].own, sizeof series->own, "%s", known[i].name);
        series[*n].name = series[*n].own;
        ++*n;
    }
    return *n > 0 ? 0
                  : apc_fail(r->why, APC_ENOTFOUND, "%s: it describes no %s", r->file,
                             inputs ? "outputs of controllers" : "measurements");
}

int series_choose(struct reading *r, const struct known *known, size_t n, struct series **of)
{
    int rc = r->inputs > 0 || r->selection->only ? 0 : take_all(r, true, known, n);

    if (rc == 0 && r->outputs == 0)
        rc = take_all(r, false, known, n);
    for (size_t i = 0; i < r->inputs && rc == 0; i++)
        rc = choose_signals(r, &r->input[i], known, n, true, of);
    for (size_t i = 0; i < r->outputs && rc == 0; i++)
        rc = choose_signals(r, &r->output[i], known, n, false, of);
    for (size_t i = 0; i < n && rc == 0; i++)
        if (of[i] == &r->output[0])
            r->period = known[i].period;
    return rc;
}

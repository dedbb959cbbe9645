/* SPDX-License-Identifier: BSD-3-Clause */
/* What is judged of a loop's record: the longest time that it was in service with one setpoint. */
#include "figures_internal.h"

#include <stdlib.h>

static bool grow(struct stretch *to, double **array, size_t room)
{
    double *const at = reallocarray(*array, room, sizeof *at);
    if (at)
        *array = at;
    else
        to->rc = APC_ENOMEM;
    return at != NULL;
}

void stretch_measured(struct stretch *to, double value)
{
    const size_t room = to->room_measured ? 2 * to->room_measured : 4096;
    if (to->n_measured == to->room_measured) {
        if (!grow(to, &to->measured, room))
            return;
        to->room_measured = room;
    }
    to->measured[to->n_measured++] = value;
}

void stretch_break(struct stretch *to)
{
    to->begin = to->n;
}

void stretch_tick(struct stretch *to, apc_ns time, double y, double r, double u)
{
    const size_t room = to->room ? 2 * to->room : 4096;
    if (to->n == to->room) {
        if (!grow(to, &to->y, room) || !grow(to, &to->r, room) || !grow(to, &to->u, room))
            return;
        to->room = room;
    }
    const bool goes_on =
        to->n > to->begin && time - to->last < 5 * to->period / 2 && (to->follows || to->r[to->n - 1] == r);
    if (!goes_on)
        to->begin = to->n;
    to->y[to->n] = y;
    to->r[to->n] = r;
    to->u[to->n] = u;
    to->last = time;
    to->n++;
    if (to->n - to->begin > to->longest_n) {
        to->longest = to->begin;
        to->longest_n = to->n - to->begin;
    }
}

int stretch_judge(struct stretch *of, double limited, double horizon, struct health *h)
{
    const size_t begin = of->longest + of->longest_n / 10; /* the setpoint may have moved before it */
    const struct health_series s = {.y = of->y + begin,
                                    .r = of->r + begin,
                                    .u = of->u + begin,
                                    .n = of->longest + of->longest_n - begin,
                                    .period = apc_ns_to_s(of->period),
                                    .measured = of->measured,
                                    .n_measured = of->n_measured,
                                    .limited = limited,
                                    .horizon = horizon};
    int rc = of->rc;
    if (rc == 0)
        rc = health_judge(h, of->n > 0 ? &s : &(struct health_series){.period = s.period});
    free(of->y);
    free(of->r);
    free(of->u);
    free(of->measured);
    return rc;
}

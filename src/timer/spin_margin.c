/* SPDX-License-Identifier: BSD-3-Clause */
/*
 * How early a task that spins has itself woken up: a little more than all but 0.2 % of its last 1000 wake-ups
 * were late. So a wake-up that was late by 5 ms moves the margin as much as one that was late by 0.5 ms, and
 * not at all when it is one of the two in a thousand; after 1000 more it is forgotten. At first, when few
 * wake-ups say little about their tail, the margin is up to twice as long.
 *
 * It never exceeds an eighth of the period and 500 us: what is spun is less than the margin, so this bounds
 * the CPU time whatever was learned. Where wake-ups are later than that, spinning cannot help, and the task
 * is as late as without.
 *
 * The window is a ring of whole microseconds and their histogram; `level` is kept at the percentile while
 * values come and go, so that learning costs some nanoseconds.
 */
#include "timer/timer_internal.h"

#include <string.h>

#define LONGEST  (500 * APC_NS_PER_US)
#define SHARE    8   /* of the period: one part in so many */
#define EXCEED   500 /* one wake-up in so many may be later than the level */
#define GENEROUS 64  /* after so many wake-ups the first generosity has halved */

static void set_margin(struct apc_margin *m)
{
    apc_ns edge = (apc_ns)(m->level + 1) * APC_NS_PER_US;
    apc_ns margin = edge + edge / 8 + edge * GENEROUS / (GENEROUS + m->n);
    m->margin = margin < m->cap ? margin : m->cap;
}

void apc_margin_init(struct apc_margin *m, apc_ns period)
{
    memset(m, 0, sizeof *m);
    m->cap = period / SHARE < LONGEST ? period / SHARE : LONGEST;
    m->margin = m->cap;
}

void apc_margin_learn(struct apc_margin *m, apc_ns lateness)
{
    apc_ns us = lateness / APC_NS_PER_US;
    unsigned value = us < 0 ? 0 : us < APC_MARGIN_BINS ? (unsigned)us : APC_MARGIN_BINS - 1;

    if (m->n == APC_MARGIN_WINDOW) {
        unsigned oldest = m->ring[m->at];
        m->bin[oldest]--;
        m->above -= oldest > m->level;
    } else {
        m->n++;
    }
    m->ring[m->at] = (uint16_t)value;
    m->at = (m->at + 1) % APC_MARGIN_WINDOW;
    m->bin[value]++;
    m->above += value > m->level;

    /* The smallest level that no more than n / EXCEED values lie above. */
    while (m->above > m->n / EXCEED)
        m->above -= m->bin[++m->level];
    while (m->level > 0 && m->above + m->bin[m->level] <= m->n / EXCEED)
        m->above += m->bin[m->level--];
    set_margin(m);
}

/* SPDX-License-Identifier: BSD-3-Clause */
#include "jitter.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "bench.h"

const char *const jitter_quantiles[QUANTILES] = {"p50", "p99", "p99.9"};

/* ---- Samples ------------------------------------------------------------------------------- */

static int by_size(const void *a, const void *b)
{
    const apc_ns x = *(const apc_ns *)a, y = *(const apc_ns *)b;
    return (x > y) - (x < y);
}

void jitter_sort(apc_ns *ns, size_t n)
{
    qsort(ns, n, sizeof *ns, by_size);
}

apc_ns jitter_at(const apc_ns *ns, size_t n, enum jitter_quantile q)
{
    static const size_t per_mille[QUANTILES] = {500, 990, 999};
    return ns[(n * per_mille[q] + 999) / 1000 - 1];
}

void jitter_row_add(struct jitter_row *row, size_t round, struct jitter_run *run)
{
    jitter_sort(run->ns, run->n);
    for (enum jitter_quantile q = 0; q < QUANTILES; q++)
        row->round[round][q] = (double)jitter_at(run->ns, run->n, q);

    apc_ns *all = realloc(row->ns, (row->n + run->n) * sizeof *all);
    if (!all)
        die("out of memory");
    memcpy(all + row->n, run->ns, run->n * sizeof *all);
    row->ns = all;
    row->n += run->n;
    row->missed += run->missed;
    row->wall += run->wall;
    row->cpu += run->cpu;
    free(run->ns);
    *run = (struct jitter_run){0};
}

double jitter_cpu(const struct jitter_row *row)
{
    return row->wall > 0 ? 100 * (double)row->cpu / (double)row->wall : (double)NAN;
}

/* ---- Drift --------------------------------------------------------------------------------- */

void jitter_drift_of(struct jitter_drift *drift, struct jitter_run *run)
{
    const size_t tenth = run->n / 10;

    drift->drift = (double)NAN;
    if (tenth > 0 && jitter_ways[drift->way].relative) {
        drift->drift = 0;
        for (size_t i = 0; i < run->n; i++)
            drift->drift += (double)run->ns[i];
    } else if (tenth > 0) {
        jitter_sort(run->ns, tenth);
        jitter_sort(run->ns + run->n - tenth, tenth);
        drift->p99 = jitter_at(run->ns, tenth, P99);
        drift->drift =
            (double)(jitter_at(run->ns + run->n - tenth, tenth, P50) - jitter_at(run->ns, tenth, P50));
    }
    free(run->ns);
    *run = (struct jitter_run){0};
}

/* ---- Ratios -------------------------------------------------------------------------------- */

static int by_value(const void *a, const void *b)
{
    const double x = *(const double *)a, y = *(const double *)b;
    return (x > y) - (x < y);
}

bool jitter_has(const struct jitter_cell *cell, enum jitter_way way)
{
    return cell && !cell->row[way].failed && cell->row[way].n > 0;
}

/* The reference of a round is the mean of its two runs. */
static double of_round(const struct jitter_cell *cell, enum jitter_way way, size_t round,
                       enum jitter_quantile q)
{
    double value = cell->row[way].round[round][q];

    if (way == WAY_CYCLIC && jitter_has(cell, WAY_CYCLIC_AGAIN))
        value = 0.5 * (value + cell->row[WAY_CYCLIC_AGAIN].round[round][q]);
    return value;
}

double jitter_ratio(const struct jitter *j, const struct jitter_cell *cell, enum jitter_way way,
                    enum jitter_way to, enum jitter_quantile q)
{
    double each[JITTER_ROUNDS_MAX];

    if (!jitter_has(cell, way) || !jitter_has(cell, to))
        return (double)NAN;
    for (size_t i = 0; i < j->rounds; i++)
        each[i] = of_round(cell, way, i, q) / of_round(cell, to, i, q);
    qsort(each, j->rounds, sizeof *each, by_value);
    return 0.5 * (each[(j->rounds - 1) / 2] + each[j->rounds / 2]);
}

bool jitter_noise(const struct jitter *j, const struct jitter_cell *cell, enum jitter_quantile q,
                  double *least, double *most)
{
    *least = (double)INFINITY;
    *most = 0;
    if (!jitter_has(cell, WAY_CYCLIC) || !jitter_has(cell, WAY_CYCLIC_AGAIN))
        return false;
    for (size_t i = 0; i < j->rounds; i++) {
        double ratio = cell->row[WAY_CYCLIC_AGAIN].round[i][q] / cell->row[WAY_CYCLIC].round[i][q];
        *least = fmin(*least, ratio);
        *most = fmax(*most, ratio);
    }
    return true;
}

/* ---- "How good" ---------------------------------------------------------------------------- */

const struct jitter_cell *jitter_cell_find(const struct jitter *j, apc_ns period, bool loaded)
{
    for (size_t i = 0; i < j->n_cells; i++)
        if (j->cell[i].period == period && j->cell[i].loaded == loaded)
            return &j->cell[i];
    return NULL;
}

struct goals {
    struct jitter_goal *goal;
    size_t n;
};

static void add(struct goals *g, double value, bool at_least, double limit, const char *unit, const char *fmt,
                ...) APC_PRINTF(6, 7);
static void add(struct goals *g, double value, bool at_least, double limit, const char *unit, const char *fmt,
                ...)
{
    struct jitter_goal *goal = &g->goal[g->n++];
    va_list args;

    *goal = (struct jitter_goal){.value = value, .limit = limit, .at_least = at_least, .unit = unit};
    va_start(args, fmt);
    vsnprintf(goal->what, sizeof goal->what, fmt, args);
    va_end(args);
}

size_t jitter_goals(const struct jitter *j, struct jitter_goal goals[JITTER_GOALS])
{
    static const char *const states[] = {"idle", "under load"};
    struct goals g = {goals, 0};
    const struct jitter_cell *idle = jitter_cell_find(j, APC_NS_PER_MS, false);

    for (int loaded = 0; loaded < 2; loaded++) {
        const struct jitter_cell *cell = jitter_cell_find(j, APC_NS_PER_MS, loaded);
        for (enum jitter_quantile q = 0; q < QUANTILES; q++)
            add(&g, jitter_ratio(j, cell, WAY_DEADLINE, WAY_CYCLIC, q), false, q == P999 ? 1.3 : 1.15, "x",
                "deadline / cyclictest, 1 ms %s, %s", states[loaded], jitter_quantiles[q]);
    }
    for (apc_ns ms = 1; ms <= 10; ms *= 10)
        add(&g, jitter_ratio(j, jitter_cell_find(j, ms * APC_NS_PER_MS, false), WAY_SPIN, WAY_CYCLIC, P99),
            false, 0.1, "x", "spin / cyclictest, %d ms idle, p99", (int)ms);
    add(&g, jitter_has(idle, WAY_SPIN) ? jitter_cpu(&idle->row[WAY_SPIN]) : (double)NAN, false, 15, "%",
        "spin, 1 ms idle, share of a core");
    for (int loaded = 0; loaded < 2; loaded++)
        add(&g, jitter_ratio(j, jitter_cell_find(j, APC_NS_PER_MS, loaded), WAY_LISTING, WAY_DEADLINE, P99),
            true, loaded ? 10 : 3, "x", "Listing 2 / deadline, 1 ms %s, p99", states[loaded]);
    add(&g, j->tick_cost, false, 1000, "ns", "a tick besides its callback, median");
    add(&g, j->record_cost, false, 100, "ns", "of that the recording");
    for (size_t i = 0; i < JITTER_DRIFTS; i++)
        if (j->drift[i].way == WAY_DEADLINE)
            add(&g, fabs(j->drift[i].drift), false, (double)j->drift[i].p99, "ns",
                "deadline, drift in %d s (its lateness: p99)", (int)(j->drift_time / APC_NS_PER_S));
    return g.n;
}

bool jitter_goal_met(const struct jitter_goal *goal)
{
    return goal->at_least ? goal->value >= goal->limit : goal->value <= goal->limit;
}

/* SPDX-License-Identifier: BSD-3-Clause */
#include "jitter.h"

#include <argp.h>
#include <errno.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "bench.h"

static const char doc[] =
    "How late periodic tasks are: libapc's, the paper's, the usual loops, and cyclictest as the reference, "
    "taking turns on this machine, idle and under load.\v"
    "What the numbers mean is in docs/jitter.md. It never fails on a figure.";

/* ---- Command line -------------------------------------------------------------------------- */

struct options {
    bool quick;
    size_t rounds;
    const char *plot;
    FILE *json;
};

static const struct argp_option option_list[] = {
    {"quick", 'q', NULL, 0, "Only what the goals need, within 2 minutes", 0},
    {"json", 'j', "FILE", 0, "Write the results to FILE as well", 0},
    {"plot", 'p', "FILE", 0, "Draw FILE.svg and FILE.png of the period 1 ms", 0},
    {"rounds", 'r', "N", 0, "Rounds to take medians of; 8 to 100, default 8", 0},
    {0},
};

static error_t parse(int key, char *arg, struct argp_state *state)
{
    struct options *o = state->input;
    double rounds;

    switch (key) {
    case 'q':
        o->quick = true;
        return 0;
    case 'p':
        o->plot = arg;
        return 0;
    case 'j':
        o->json = fopen(arg, "w");
        if (!o->json)
            argp_failure(state, 1, errno, "%s", arg);
        return 0;
    case 'r':
        if (apc_number_parse(arg, &rounds) < 0 || rounds != floor(rounds) || rounds < JITTER_ROUNDS_MIN ||
            rounds > JITTER_ROUNDS_MAX)
            argp_error(state, "--rounds is \"%s\": expected %d to %d", arg, JITTER_ROUNDS_MIN,
                       JITTER_ROUNDS_MAX);
        o->rounds = (size_t)rounds;
        return 0;
    default:
        return ARGP_ERR_UNKNOWN;
    }
}

/* ---- The plan ------------------------------------------------------------------------------ */

#define SET(way) (1U << (way))

/* What takes turns in a cell: all ways, or those that the goals need. */
struct plan {
    apc_ns period;
    apc_ns time, quick_time; /* of a way in a round; 0: not at all */
    unsigned quick;          /* ways */
    bool loaded;
};

#define REFERENCE (SET(WAY_CYCLIC) | SET(WAY_CYCLIC_AGAIN))
#define IN_MS(ms) ((ms)*APC_NS_PER_MS)

static const struct plan plans[] = {
    {IN_MS(1), IN_MS(1000), IN_MS(1000), REFERENCE | SET(WAY_DEADLINE) | SET(WAY_SPIN) | SET(WAY_LISTING),
     false},
    {IN_MS(1), IN_MS(1000), IN_MS(1000), REFERENCE | SET(WAY_DEADLINE) | SET(WAY_LISTING), true},
    {IN_MS(10), IN_MS(1250), IN_MS(1010), SET(WAY_CYCLIC) | SET(WAY_SPIN), false},
    {IN_MS(10), IN_MS(1250), 0, 0, true},
    {IN_MS(100), IN_MS(600), 0, 0, false},
    {IN_MS(100), IN_MS(600), 0, 0, true},
};

/* Ours between the two runs of the reference. */
static const enum jitter_way order[WAYS] = {WAY_CYCLIC,         WAY_DEADLINE, WAY_SPIN,  WAY_CYCLIC_AGAIN,
                                            WAY_CYCLIC_NO_HOLD, WAY_NO_HOLD,  WAY_OTHER, WAY_POSIX,
                                            WAY_LISTING,        WAY_LOOP,     WAY_PYTHON};

/* One line that is overwritten, for whoever is waiting. */
static void progress(const char *fmt, ...) APC_PRINTF(1, 2);
static void progress(const char *fmt, ...)
{
    va_list args;

    if (!isatty(STDERR_FILENO))
        return;
    fputs("\r\033[K", stderr);
    va_start(args, fmt);
    vfprintf(stderr, fmt, args);
    va_end(args);
}

/* ---- Measuring ----------------------------------------------------------------------------- */

static void run_round(const struct jitter *j, struct jitter_cell *cell, size_t round, unsigned ways,
                      apc_ns time)
{
    struct jitter_run run;

    for (size_t i = 0; i < WAYS && !jitter_interrupted(); i++) {
        enum jitter_way way = order[i];
        struct jitter_row *row = &cell->row[way];
        if (!(ways & SET(way)) || row->failed)
            continue;
        progress("%lld ms%s: round %zu of %zu, %s", (long long)(cell->period / APC_NS_PER_MS),
                 cell->loaded ? " under load" : "", round + 1, j->rounds, jitter_ways[way].name);
        bool ran = false;
        for (int tries = 0; tries < 2 && !ran; tries++)
            ran = jitter_run(&j->tools, way, cell->period, time, &run);
        if (ran)
            jitter_row_add(row, round, &run);
        else
            row->failed = true;
    }
    progress("%s", "");
}

static void run_cell(struct jitter *j, const struct plan *plan)
{
    struct jitter_cell *cell = &j->cell[j->n_cells];
    const unsigned ways = j->quick ? plan->quick : (1U << WAYS) - 1;
    const apc_ns time = j->quick ? plan->quick_time : plan->time;
    struct jitter_busy before;
    pid_t load = 0;

    if (time == 0 || (plan->loaded && !j->tools.stress))
        return;
    *cell = (struct jitter_cell){.period = plan->period, .loaded = plan->loaded};
    jitter_busy_now(&before);
    if (plan->loaded)
        load = jitter_load_start(&j->tools, (int)(j->rounds * WAYS * 3));
    for (size_t round = 0; round < j->rounds; round++)
        run_round(j, cell, round, ways, time);
    jitter_load_stop(load);
    jitter_busy_since(&before, &cell->others, &cell->stolen);
    if (jitter_interrupted())
        return;
    for (enum jitter_way way = 0; way < WAYS; way++)
        jitter_sort(cell->row[way].ns, cell->row[way].n);
    j->n_cells++;
    jitter_print_cell(j, cell);
}

/* At once: where a tick lies on its grid has nothing to do with who else is late. */
static void run_drift(struct jitter *j)
{
    static const enum jitter_way ways[JITTER_DRIFTS] = {WAY_DEADLINE, WAY_POSIX, WAY_LISTING, WAY_LOOP,
                                                        WAY_PYTHON};
    struct jitter_run runs[JITTER_DRIFTS];

    j->drift_time = (j->quick ? 5 : 60) * APC_NS_PER_S;
    progress("drift");
    jitter_run_together(&j->tools, ways, JITTER_DRIFTS, 10 * APC_NS_PER_MS, j->drift_time, runs);
    progress("%s", "");
    for (size_t i = 0; i < JITTER_DRIFTS; i++) {
        j->drift[i] = (struct jitter_drift){.way = ways[i]};
        jitter_drift_of(&j->drift[i], &runs[i]);
    }
}

static void finish(struct jitter *j, struct options *o)
{
    jitter_print_end(j);
    if (o->json) {
        jitter_write_json(j, o->json);
        if (ferror(o->json) | fclose(o->json))
            die("the JSON file could not be written whole");
    }
    if (o->plot && !jitter_plot(j, o->plot))
        die("gnuplot did not draw the figure");
    for (size_t i = 0; i < j->n_cells; i++)
        for (enum jitter_way way = 0; way < WAYS; way++)
            free(j->cell[i].row[way].ns);
    free(j);
}

int main(int argc, char **argv)
{
    struct options o = {.rounds = JITTER_ROUNDS_MIN};
    const struct argp argp = {option_list, parse, NULL, doc, NULL, NULL, NULL};

    argp_parse(&argp, argc, argv, 0, NULL, &o);
    struct jitter *j = allocate(1, sizeof *j);
    j->quick = o.quick;
    j->rounds = o.rounds;
    j->tick_cost = j->record_cost = (double)NAN;
    jitter_find_tools(&j->tools);
    jitter_catch_signals();
    jitter_describe(j);
    for (size_t i = 0; i < sizeof plans / sizeof *plans && !jitter_interrupted(); i++)
        run_cell(j, &plans[i]);
    if (!jitter_interrupted())
        run_drift(j);
    if (!jitter_interrupted())
        jitter_run_cost(&j->tools, &j->tick_cost, &j->record_cost);
    if (jitter_interrupted())
        die("interrupted");
    finish(j, &o);
    return 0;
}

/* SPDX-License-Identifier: BSD-3-Clause */
/* Text and JSON. Colour only on a terminal, and never the only bearer of a meaning. */
#include "jitter.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

/* Bands of lateness in parts of a control period; docs/jitter.md says why. */
#define FINE       0.05
#define NOTICEABLE 0.25

/* ---- Colour -------------------------------------------------------------------------------- */

enum colour { PLAIN, BOLD, DIM, GREEN, YELLOW, RED };

static const char *paint(enum colour colour)
{
    static const char *const codes[] = {"\033[0m", "\033[1m", "\033[2m", "\033[32m", "\033[33m", "\033[31m"};
    const char *no_color = getenv("NO_COLOR");

    return isatty(STDOUT_FILENO) && !(no_color && *no_color) ? codes[colour] : "";
}

/* ---- A cell -------------------------------------------------------------------------------- */

static bool is_cyclic(enum jitter_way way)
{
    return way == WAY_CYCLIC || way == WAY_CYCLIC_AGAIN || way == WAY_CYCLIC_NO_HOLD;
}

/* Microseconds in eight columns, to three digits or so. */
static void put_us(double ns)
{
    double us = ns / 1e3;
    printf(" %8.*f", fabs(us) < 9.995 ? 2 : fabs(us) < 999.5 ? 1 : 0, us);
}

static void put_ratio(double ratio)
{
    if (isnan(ratio))
        printf(" %6s", "");
    else
        printf(" %6.*f", ratio < 99.5 ? 2 : 0, ratio);
}

/* Whether so many ticks have such a quantile that is not just their maximum. */
static bool enough(size_t n, enum jitter_quantile q)
{
    static const size_t least[QUANTILES] = {1, 100, 1000};
    return n >= least[q];
}

static void print_row(const struct jitter *j, const struct jitter_cell *cell, enum jitter_way way)
{
    const struct jitter_row *row = &cell->row[way];
    const size_t due = row->n + row->missed;
    apc_ns worst = row->ns[row->n - 1];

    printf("%-20s %6zu ", jitter_ways[way].name, row->n);
    if (is_cyclic(way))
        printf("%6s", "-");
    else
        printf("%s%6llu%s", row->missed ? paint(YELLOW) : "", (unsigned long long)row->missed, paint(PLAIN));
    for (enum jitter_quantile q = 0; q < QUANTILES; q++) {
        if (enough(row->n, q))
            put_us((double)jitter_at(row->ns, row->n, q));
        else
            printf(" %8s", "-");
    }
    put_us((double)worst);
    if (is_cyclic(way))
        printf(" %6s", "-");
    else
        printf(" %6.2f", jitter_cpu(row));
    for (enum jitter_quantile q = 0; q < QUANTILES; q++)
        put_ratio(enough(due / j->rounds, q) ? jitter_ratio(j, cell, way, WAY_CYCLIC, q) : (double)NAN);
    if (enough(row->n, P999))
        worst = jitter_at(row->ns, row->n, P999);
    double part = (double)worst / (double)cell->period;
    printf(" %s%7.2f%s\n",
           paint(part <= FINE         ? GREEN
                 : part <= NOTICEABLE ? YELLOW
                                      : RED),
           100 * part, paint(PLAIN));
}

static void print_noise(const struct jitter *j, const struct jitter_cell *cell)
{
    double least, most;

    printf("%scyclictest to itself in one round:", paint(DIM));
    for (enum jitter_quantile q = 0; q < QUANTILES; q++)
        if (enough(cell->row[WAY_CYCLIC].n / j->rounds, q) && jitter_noise(j, cell, q, &least, &most))
            printf("  %s %.2f to %.2f", jitter_quantiles[q], least, most);
    printf("%s\n", paint(PLAIN));
}

void jitter_print_cell(const struct jitter *j, const struct jitter_cell *cell)
{
    char title[64];

    snprintf(title, sizeof title, "%lld ms, %s", (long long)(cell->period / APC_NS_PER_MS),
             cell->loaded ? "under load" : "idle");
    printf("\n%s%-34s%s%s %36s %6s %20s %7s%s\n", paint(BOLD), title, paint(PLAIN), paint(DIM),
           "------- lateness, µs -------", "CPU", "times cyclictest's", "p99.9", paint(PLAIN));
    printf("%s%-20s %6s %6s %8s %8s %8s %8s %6s %6s %6s %6s %7s%s\n", paint(DIM), "", "ticks", "missed",
           "p50", "p99", "p99.9", "max", "%", "p50", "p99", "p99.9", "% of T", paint(PLAIN));
    for (enum jitter_way way = 0; way < WAYS; way++)
        if (jitter_has(cell, way))
            print_row(j, cell, way);
        else if (cell->row[way].failed)
            printf("%-20s left out: it did not run\n", jitter_ways[way].name);
    printf("%sbesides: other processes %.0f %% of a core, stolen by the hypervisor %.0f %%%s\n",
           paint(!cell->loaded && cell->others > 10 ? YELLOW : DIM), cell->others, cell->stolen,
           paint(PLAIN));
    if (jitter_has(cell, WAY_CYCLIC_AGAIN))
        print_noise(j, cell);
    fflush(stdout);
}

/* ---- The end ------------------------------------------------------------------------------- */

static void print_drift(const struct jitter *j)
{
    printf("\n%sDrift in %lld s at 10 ms%s\n", paint(BOLD), (long long)(j->drift_time / APC_NS_PER_S),
           paint(PLAIN));
    for (size_t i = 0; i < JITTER_DRIFTS; i++) {
        const struct jitter_drift *d = &j->drift[i];
        if (isnan(d->drift))
            continue;
        printf("%-20s %14.3f ms", jitter_ways[d->way].name, d->drift / 1e6);
        if (d->p99)
            printf("   (p99 of its lateness: %.3f ms)", (double)d->p99 / 1e6);
        printf("\n");
    }
}

static void print_goals(const struct jitter *j)
{
    struct jitter_goal goals[JITTER_GOALS];
    size_t n = jitter_goals(j, goals), met = 0, known = 0;

    printf("\n%s%-52s %12s %14s%s\n", paint(BOLD), "How good", "measured", "goal", paint(PLAIN));
    for (size_t i = 0; i < n; i++) {
        const struct jitter_goal *g = &goals[i];
        bool is_known = !isnan(g->value), is_met = is_known && jitter_goal_met(g);
        known += is_known;
        met += is_met;
        printf("%-52s ", g->what);
        if (!is_known) {
            printf("%12s\n", "not measured");
            continue;
        }
        printf("%9.*f %-2s %4s %6g %-2s  %s%s%s\n", strcmp(g->unit, "ns") == 0 ? 0 : 2, g->value, g->unit,
               g->at_least ? ">=" : "<=", g->limit, g->unit, paint(is_met ? GREEN : RED),
               is_met        ? "PASS"
               : g->at_least ? "below"
                             : "above",
               paint(PLAIN));
    }
    printf("%zu of %zu met. Ratios are medians over %zu rounds.\n", met, known, j->rounds);
}

void jitter_describe(const struct jitter *j)
{
    struct jitter_place p;

    jitter_find_place(&p);
    printf("%sjitter%s %.19sZ on %s, %s %s %s\n", paint(BOLD), paint(PLAIN), p.time, p.system.nodename,
           p.system.sysname, p.system.release, p.system.version);
    printf("%s, %ld cores%s, governor: %s, idle driver: %s, load %.2f\n", p.cpu, p.cores,
           p.guest ? " of a virtual machine" : "", p.governor, p.idle, p.load);
    printf("SCHED_FIFO: %s\nlatency hold (/dev/cpu_dma_latency): %s\n",
           j->tools.fifo ? "permitted, priority 80"
                         : "NOT permitted: every row runs under SCHED_OTHER, and cyclictest not at all",
           access("/dev/cpu_dma_latency", W_OK) == 0 ? "permitted" : "NOT permitted: no row has it");
    const struct {
        const char *tool, *name, *package, *without;
    } tools[] = {{j->tools.cyclictest, "cyclictest", "rt-tests", "no reference"},
                 {j->tools.stress, "stress-ng", "stress-ng", "nothing under load"},
                 {j->tools.python, "python3", "python3", "no Python row"}};
    for (size_t i = 0; i < sizeof tools / sizeof *tools; i++)
        if (!tools[i].tool && (i > 0 || j->tools.fifo))
            printf("%s is missing (package %s): %s\n", tools[i].name, tools[i].package, tools[i].without);
    fflush(stdout);
}

void jitter_print_end(const struct jitter *j)
{
    print_drift(j);
    print_goals(j);
    fflush(stdout);
}

/* ---- JSON ---------------------------------------------------------------------------------- */

static void put_text(FILE *f, const char *key, const char *text)
{
    fprintf(f, "\"%s\": \"", key);
    for (; *text; text++) {
        if (*text == '"' || *text == '\\')
            fputc('\\', f);
        if ((unsigned char)*text >= ' ')
            fputc(*text, f);
    }
    fputc('"', f);
}

static void put_number(FILE *f, const char *key, double value)
{
    if (isfinite(value))
        fprintf(f, "\"%s\": %.6g", key, value);
    else
        fprintf(f, "\"%s\": null", key);
}

static void write_head(const struct jitter *j, FILE *f)
{
    struct jitter_place p;

    jitter_find_place(&p);
    fputs("{", f);
    put_text(f, "bench", "jitter");
    fputs(", ", f);
    put_text(f, "time", p.time);
    fputs(",\n ", f);
    put_text(f, "host", p.system.nodename);
    fputs(", ", f);
    put_text(f, "kernel", p.system.release);
    fputs(", ", f);
    put_text(f, "version", p.system.version);
    fputs(",\n ", f);
    put_text(f, "cpu", p.cpu);
    fputs(", ", f);
    put_text(f, "governor", p.governor);
    fputs(", ", f);
    put_text(f, "idle_driver", p.idle);
    fprintf(f, ",\n \"virtual\": %s, \"cores\": %ld, \"fifo\": %s, \"rounds\": %zu, \"quick\": %s",
            p.guest ? "true" : "false", p.cores, j->tools.fifo ? "true" : "false", j->rounds,
            j->quick ? "true" : "false");
}

/* Ratios and rounds: of few ticks, a high quantile is their maximum. */
static void write_row(const struct jitter *j, const struct jitter_cell *cell, enum jitter_way way, FILE *f)
{
    const struct jitter_row *row = &cell->row[way];

    fputs("{", f);
    put_text(f, "name", jitter_ways[way].name);
    fprintf(f, ", \"of\": \"%s\", \"ticks\": %zu", jitter_ways[way].relative ? "interval" : "lateness",
            row->n);
    if (!is_cyclic(way)) {
        fprintf(f, ", \"missed\": %llu, ", (unsigned long long)row->missed);
        put_number(f, "cpu_percent", jitter_cpu(row));
    }
    for (enum jitter_quantile q = 0; q < QUANTILES; q++)
        fprintf(f, ", \"%s_ns\": %lld", jitter_quantiles[q], (long long)jitter_at(row->ns, row->n, q));
    fprintf(f, ", \"max_ns\": %lld,\n     \"to_cyclictest\": {", (long long)row->ns[row->n - 1]);
    for (enum jitter_quantile q = 0; q < QUANTILES; q++) {
        fputs(q > 0 ? ", " : "", f);
        put_number(f, jitter_quantiles[q], jitter_ratio(j, cell, way, WAY_CYCLIC, q));
    }
    fputs("},\n     \"rounds_ns\": [", f);
    for (size_t i = 0; i < j->rounds; i++)
        fprintf(f, "%s[%.0f, %.0f, %.0f]", i > 0 ? ", " : "", row->round[i][P50], row->round[i][P99],
                row->round[i][P999]);
    fputs("]}", f);
}

void jitter_write_json(const struct jitter *j, FILE *f)
{
    struct jitter_goal goals[JITTER_GOALS];
    size_t n = jitter_goals(j, goals);

    write_head(j, f);
    fputs(",\n \"cells\": [", f);
    for (size_t i = 0; i < j->n_cells; i++) {
        const char *comma = "";
        fprintf(f, "%s\n  {\"period_ns\": %lld, \"loaded\": %s, ", i > 0 ? "," : "",
                (long long)j->cell[i].period, j->cell[i].loaded ? "true" : "false");
        put_number(f, "others_percent", j->cell[i].others);
        fputs(", ", f);
        put_number(f, "stolen_percent", j->cell[i].stolen);
        fputs(", \"rows\": [", f);
        for (enum jitter_way way = 0; way < WAYS; way++) {
            if (!jitter_has(&j->cell[i], way))
                continue;
            fprintf(f, "%s\n    ", comma);
            write_row(j, &j->cell[i], way, f);
            comma = ",";
        }
        fputs("]}", f);
    }
    fprintf(f, "],\n \"drift_s\": %lld, \"drift\": [", (long long)(j->drift_time / APC_NS_PER_S));
    for (size_t i = 0; i < JITTER_DRIFTS; i++) {
        fputs(i > 0 ? ",\n   {" : "\n   {", f);
        put_text(f, "name", jitter_ways[j->drift[i].way].name);
        fputs(", ", f);
        put_number(f, "ns", j->drift[i].drift);
        fputs("}", f);
    }
    fputs("],\n \"goals\": [", f);
    for (size_t i = 0; i < n; i++) {
        fputs(i > 0 ? ",\n   {" : "\n   {", f);
        put_text(f, "what", goals[i].what);
        fputs(", ", f);
        put_number(f, "value", goals[i].value);
        fprintf(f, ", \"%s\": %g, \"unit\": \"%s\", \"met\": %s}", goals[i].at_least ? "at_least" : "at_most",
                goals[i].limit, goals[i].unit,
                isnan(goals[i].value)        ? "null"
                : jitter_goal_met(&goals[i]) ? "true"
                                             : "false");
    }
    fputs("]}\n", f);
}

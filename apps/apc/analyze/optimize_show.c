/* SPDX-License-Identifier: BSD-3-Clause */
/* What was found: for people, for programs, as a figure, as a file. */
#include "optimize.h"

#include <apcmath.h>
#include <errno.h>

#include <math.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "apc/common/print.h"
#include "apc/folder/folder.h"
#include "apc/report/gnuplot.h"
#include "files/files.h"

static const struct attempt *best_of(const struct optimization *z)
{
    return optimization_attempt(z, z->best);
}

static const struct attempt *present_of(const struct optimization *z)
{
    return optimization_attempt(z, 0);
}

/* ---- For people ----------------------------------------------------------------------------- */

static int show_numbers(const struct optimization *z)
{
    static const struct print_column columns[] = {{"number", PRINT_LEFT}, {"from", PRINT_POINT},
                                                  {"to", PRINT_POINT},    {"now", PRINT_POINT},
                                                  {"found", PRINT_POINT}, {"", PRINT_LEFT}};
    struct print_table t;
    print_table_open(&t, columns, sizeof columns / sizeof *columns);
    for (size_t i = 0; i < z->own.n; i++) {
        const struct number *n = &z->own.number[i];
        const double found = best_of(z)->value[i];
        print_cell(&t, PRINT_PLAIN, "%s", n->path);
        print_cell(&t, PRINT_PLAIN, "%.5g", n->low);
        print_cell(&t, PRINT_PLAIN, "%.5g", n->high);
        print_cell(&t, PRINT_PLAIN, "%.5g", n->now);
        print_cell(&t, PRINT_PLAIN, "%.5g", found);
        print_cell(&t, PRINT_PLAIN, "%s", found <= n->low || found >= n->high ? "at its bound" : "");
    }
    return print_table_end(&t, z->talk, false, 0);
}

static int show_loops(const struct optimization *z)
{
    static const struct print_column columns[] = {{"loop", PRINT_LEFT},   {"IAE now", PRINT_POINT},
                                                  {"found", PRINT_POINT}, {"control effort now", PRINT_POINT},
                                                  {"found", PRINT_POINT}, {"overshoot % now", PRINT_POINT},
                                                  {"found", PRINT_POINT}};
    struct print_table t;
    print_table_open(&t, columns, sizeof columns / sizeof *columns);
    for (size_t i = 0; i < z->loops; i++) {
        print_cell(&t, PRINT_PLAIN, "%s", z->loop[i].name);
        for (size_t k = 0; k < 3; k++) {
            if (present_of(z)->stable)
                print_cell(&t, PRINT_PLAIN, "%.5g", present_of(z)->loop[3 * i + k]);
            else
                print_cell(&t, PRINT_PLAIN, k == 0 ? "diverges" : "-");
            print_cell(&t, PRINT_PLAIN, "%.5g", best_of(z)->loop[3 * i + k]);
        }
    }
    return print_table_end(&t, z->talk, false, 0);
}

/* Each once: two numbers of a controller stand in one line. */
static int show_lines(const struct optimization *z, const struct experiment *e, struct apc_error *why)
{
    char *line[OPTIMIZE_NUMBERS] = {NULL};
    int rc = 0;
    fputs("to paste:\n", z->talk);
    for (size_t i = 0; i < z->own.n && rc == 0; i++) {
        rc = experiment_line(e, z->own.number[i].path, &line[i], why);
        bool said = rc < 0;
        for (size_t k = 0; k < i && !said; k++)
            said = line[k] && !strcmp(line[k], line[i]);
        if (!said)
            fprintf(z->talk, "  %s\n", line[i]);
    }
    for (size_t i = 0; i < z->own.n; i++)
        free(line[i]);
    return rc;
}

static void show_search_cost(const struct optimization *z, double took)
{
    unsigned tried = 0, unstable = 0;
    for (unsigned i = 0; i < z->tries; i++) {
        tried += optimization_attempt(z, i)->made;
        unstable += optimization_attempt(z, i)->made && !optimization_attempt(z, i)->stable;
    }
    fprintf(z->talk, "%s: %s\n%u tries, %u runs of %.10g s in %.3g s", z->e.name, z->e.title, tried,
            atomic_load(&z->pool->done), z->e.duration, took);
    if (unstable > 0)
        fprintf(z->talk, "; %u were unstable", unstable);
    if (atomic_load(&z->pool->stop))
        fputs("; ended by a signal: these are the results until then", z->talk);
    fprintf(z->talk, "\ncost %.5g -> %.5g\n", optimization_cost(present_of(z), &z->own.weights),
            optimization_cost(best_of(z), &z->own.weights));
    if (z->own.weights.peak > 0)
        fprintf(z->talk, "Ms %.4g -> %.4g, %.4g at most\n", present_of(z)->peak, best_of(z)->peak,
                z->own.weights.peak);
    if (z->best == 0)
        fputs("nothing better than the present numbers was found\n", z->talk);
}

/* ---- For programs --------------------------------------------------------------------------- */

static int put_attempts_csv(const struct optimization *z, struct apc_error *why)
{
    const char *path = z->own.csv;
    FILE *out = !strcmp(path, "-") ? stdout : fopen(path, "we");
    char text[PRINT_LEN];
    if (!out)
        return apc_fail(why, APC_ESYS, "%s: cannot be written: %s", path, strerror(errno));
    fputs("cost,iae,effort,overshoot_percent,beyond_limits", out);
    for (size_t k = 0; k < z->loops; k++)
        fprintf(out, ",iae_%zu,effort_%zu,overshoot_percent_%zu", k + 1, k + 1, k + 1);
    for (size_t i = 0; i < z->own.n; i++)
        fputc(',', out), csv_put(out, z->own.number[i].path);
    fputc('\n', out);
    for (unsigned i = 0; i < z->n_front; i++) {
        const struct attempt *a = optimization_attempt(z, z->front[i]);
        fputs(print_exact(optimization_cost(a, &z->own.weights), text), out);
        const double of[] = {a->iae, a->effort, a->overshoot, a->beyond};
        for (size_t k = 0; k < 4; k++)
            fprintf(out, ",%s", print_exact(of[k], text));
        for (size_t k = 0; k < 3 * z->loops; k++)
            fprintf(out, ",%s", print_exact(a->loop[k], text));
        for (size_t k = 0; k < z->own.n; k++)
            fprintf(out, ",%s", print_exact(a->value[k], text));
        fputc('\n', out);
    }
    bool failed = ferror(out) != 0;
    failed |= out == stdout ? fflush(out) != 0 : fclose(out) != 0;
    return failed ? apc_fail(why, APC_ESYS, "%s: cannot be written: %s", path, strerror(errno)) : 0;
}

static void json_attempt(const struct optimization *z, const struct attempt *a, struct text *t)
{
    json_add(t, "{cost:%g, iae:%g, effort:%g, numbers:{", optimization_cost(a, &z->own.weights),
             a->stable ? a->iae : HUGE_VAL, a->stable ? a->effort : HUGE_VAL);
    for (size_t i = 0; i < z->own.n; i++)
        json_add(t, "%s:%g", z->own.number[i].path, a->value[i]);
    json_add(t, "}, loops:[");
    for (size_t i = 0; i < z->loops && a->stable; i++)
        json_add(t, "{loop:%s, iae:%g, effort:%g, overshoot_percent:%g}", z->loop[i].name, a->loop[3 * i],
                 a->loop[3 * i + 1], a->loop[3 * i + 2]);
    json_add(t, "]}");
}

static void put_optimum_json(const struct optimization *z)
{
    struct text t = {.out = stdout};
    json_add(&t, "{experiment:%s, command:%s, seed:%ju, runs:%u, now:", z->e.name, z->command,
             (uintmax_t)z->own.seed, z->own.runs);
    json_attempt(z, present_of(z), &t);
    json_add(&t, ",\nfound:");
    json_attempt(z, best_of(z), &t);
    json_add(&t, ",\nfront:[");
    for (unsigned i = 0; i < z->n_front; i++) {
        json_add(&t, ",\n");
        json_attempt(z, optimization_attempt(z, z->front[i]), &t);
    }
    json_add(&t, "]}\n");
}

/* ---- The figure ----------------------------------------------------------------------------- */

/* Of one loop in its own units, of several the mean of what is relative to the present. */
static double x_of(const struct optimization *z, const struct attempt *a)
{
    return z->loops == 1 ? a->loop[1] : a->effort;
}

static double y_of(const struct optimization *z, const struct attempt *a)
{
    return z->loops == 1 ? a->loop[0] : a->iae;
}

static void put_point(FILE *script, const struct optimization *z, const char *name, const struct attempt *a)
{
    fprintf(script, "$%s << END\n", name);
    if (a->stable)
        fprintf(script, "%.7g %.7g\n", x_of(z, a), y_of(z, a));
    else
        fputs("NaN NaN\n", script);
    fputs("END\n", script);
}

static void put_attempt_blocks(FILE *script, const struct optimization *z)
{
    fputs("$tried << END\n", script);
    for (unsigned i = 0; i < z->tries; i++) {
        const struct attempt *a = optimization_attempt(z, i);
        if (a->made && a->stable)
            fprintf(script, "%.7g %.7g\n", x_of(z, a), y_of(z, a));
    }
    fputs("END\n$front << END\n", script);
    for (unsigned i = 0; i < z->n_front; i++) {
        const struct attempt *a = optimization_attempt(z, z->front[i]);
        fprintf(script, "%.7g %.7g\n", x_of(z, a), y_of(z, a));
    }
    fputs("END\n", script);
    put_point(script, z, "now", present_of(z));
    put_point(script, z, "found", best_of(z));
}

/* The front, and as much around it as shows where the present numbers lie; both axes by their logarithm. */
static void put_ranges(FILE *script, const struct optimization *z)
{
    double low[2] = {HUGE_VAL, HUGE_VAL}, high[2] = {0, 0};
    for (unsigned i = 0; i < z->n_front + 1; i++) {
        const struct attempt *a = i < z->n_front ? optimization_attempt(z, z->front[i]) : present_of(z);
        const double at[2] = {x_of(z, a), y_of(z, a)};
        for (size_t k = 0; k < 2 && a->stable; k++) {
            low[k] = at[k] > 0 ? fmin(low[k], at[k]) : low[k];
            high[k] = fmax(high[k], at[k]);
        }
    }
    const double x = fmin(high[0], 60 * x_of(z, best_of(z))), y = fmin(high[1], 30 * low[1]);
    fprintf(script, "x_low = %.7g\nx_high = %.7g\ny_low = %.7g\ny_high = %.7g\n", low[0] / 1.25, 1.4 * x,
            low[1] / 1.15, 1.25 * y);
}

static void put_attempts_figure(FILE *script, void *ctx)
{
    const struct optimization *z = ctx;
    char iae[APC_TAG_LEN + 8];
    put_attempt_blocks(script, z);
    put_ranges(script, z);
    snprintf(iae, sizeof iae, "IAE of %s", z->loop[0].name);
    gnuplot_string(script, "title", z->e.title);
    gnuplot_string(script, "x",
                   z->loops == 1 ? "effort: total variation of the outputs"
                                 : "effort, 1: with the present numbers");
    gnuplot_string(script, "y", z->loops == 1 ? iae : "IAE, 1: with the present numbers");
}

/* ---- The file ------------------------------------------------------------------------------- */

static int put_file(const struct optimization *z, const struct experiment *e, struct apc_error *why)
{
    char part[600], *text = NULL;
    struct experiment again;
    if (snprintf(part, sizeof part, "%s.part", z->own.write) >= (int)sizeof part)
        return apc_fail(why, APC_EINVAL, "%s: the path is too long", z->own.write);
    int rc = model_files_embed(e, &text, why);
    if (rc < 0)
        return rc;
    FILE *out = fopen(part, "we");
    bool failed = !out || fprintf(out, "# %s\n%s", z->command, text) < 0;
    failed |= out && fclose(out) != 0;
    free(text);
    if (failed)
        rc = apc_fail(why, APC_ESYS, "%s: cannot be written: %s", part, strerror(errno));
    else if ((rc = experiment_load(&again, part, EXPERIMENT_MODEL | EXPERIMENT_LAW, NULL, why)) == 0) {
        experiment_free(&again); /* what it names is to be found from there, too */
        rc = folder_replace(part, z->own.write, why);
    }
    if (rc < 0)
        unlink(part);
    else
        fprintf(z->talk, "written: %s\n", z->own.write);
    return rc;
}

/* ---- All of it ------------------------------------------------------------------------------ */

int optimization_show(const struct optimization *z, double took, struct apc_error *why)
{
    struct experiment e;
    int rc = optimization_load(z, best_of(z)->value, &e, why);
    if (rc < 0)
        return rc;
    show_search_cost(z, took);
    if (show_numbers(z) < 0 || show_loops(z) < 0)
        rc = apc_fail(why, APC_ENOMEM, "out of memory");
    if (rc == 0)
        rc = show_lines(z, &e, why);
    if (z->own.json)
        put_optimum_json(z);
    if (rc == 0 && z->own.csv)
        rc = put_attempts_csv(z, why);
    if (rc == 0 && z->own.write)
        rc = put_file(z, &e, why);
    if (rc == 0 && z->own.figure &&
        (rc = gnuplot_figure(z->own.figure, figure_front, put_attempts_figure, (void *)(uintptr_t)z, why)) ==
            0)
        fprintf(z->talk, "figure:  %s.svg, %s.png\n", z->own.figure, z->own.figure);
    experiment_free(&e);
    return rc;
}

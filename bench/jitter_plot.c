/* SPDX-License-Identifier: BSD-3-Clause */
/*
 * The figure: how often which lateness came, at 1 ms, idle above and under load below, in the manner of the
 * usual latency plots, but with a logarithmic axis for the lateness too: a spinning task and a Python timer
 * lie five decades apart. gnuplot draws it twice, as SVG and as PNG of the same layout.
 */
#include "jitter.h"

#include <math.h>
#include <spawn.h>
#include <string.h>
#include <sys/wait.h>
#include <unistd.h>

#include "bench.h"

#define PER_DECADE 20
#define LOWEST     5e-2 /* us; what is less stands there */
#define HIGHEST    1e5
#define BINS       (7 * PER_DECADE)

static const char prologue[] = "set encoding utf8\n"
                               "set multiplot\n"
                               "set border 3 lw 0.7 lc rgb 0x333333\n"
                               "set tics nomirror out scale 0.5, 0.25 textcolor rgb 0x222222\n"
                               "set grid xtics ytics lt 1 lw 0.5 lc rgb 0xE2E2E2\n"
                               "set logscale xy\n"
                               "set format x '%g'\n"
                               "set format y '10^{%T}'\n"
                               "set key outside right top Left reverse samplen 2 spacing 1.25\n"
                               "set ylabel 'ticks'\n"
                               "set lmargin at screen 0.075\nset rmargin at screen 0.655\n";

static const struct {
    const char *terminal, *ending;
} outputs[] = {
    {"svg size 920,720 dynamic enhanced font 'DejaVu Sans,Helvetica,sans-serif,12' background rgb 'white'",
     "svg"},
    {"pngcairo size 1840,1440 enhanced font 'DejaVu Sans,9.2' fontscale 2 linewidth 2 dashlength 2", "png"},
};

/* Colours by Okabe and Ito; what is ours in full lines, what is the reference in black. */
static const struct {
    const char *colour;
    double width;
    int dash;
} looks[WAYS] = {
    [WAY_DEADLINE] = {"0x0072B2", 2.4, 1}, [WAY_SPIN] = {"0x009E73", 2.4, 1},
    [WAY_NO_HOLD] = {"0x56B4E9", 1.4, 1},  [WAY_OTHER] = {"0x56B4E9", 1.6, 2},
    [WAY_POSIX] = {"0xCC79A7", 1.4, 1},    [WAY_LISTING] = {"0xD55E00", 2.0, 1},
    [WAY_LOOP] = {"0x999999", 1.4, 1},     [WAY_PYTHON] = {"0xE69F00", 1.6, 1},
    [WAY_CYCLIC] = {"0x000000", 1.4, 1},   [WAY_CYCLIC_NO_HOLD] = {"0x000000", 1.2, 3},
};

/* Where the bin begins that @p us falls into. */
static int bin_of(double us)
{
    int bin = (int)floor(log10(fmax(us, LOWEST) / LOWEST) * PER_DECADE);
    return bin < BINS ? bin : BINS - 1;
}

static double begin_of(int bin)
{
    return LOWEST * pow(10, (double)bin / PER_DECADE);
}

/* Steps from the first filled bin to the last, standing on the axis at both ends. */
static void put_data(FILE *script, const struct jitter_row *row, size_t panel, enum jitter_way way)
{
    uint64_t count[BINS + 1] = {0};
    int first = BINS, last = 0;

    for (size_t i = 0; i < row->n; i++) {
        int bin = bin_of((double)row->ns[i] / 1e3);
        count[bin]++;
        first = bin < first ? bin : first;
        last = bin > last ? bin : last;
    }
    fprintf(script, "$d%zu_%d << EOD\n%.6g 0.1\n", panel, (int)way, begin_of(first));
    for (int bin = first; bin <= last + 1; bin++)
        fprintf(script, "%.6g %.6g\n", begin_of(bin), count[bin] ? (double)count[bin] : 0.1);
    fputs("EOD\n", script);
}

static bool drawn(const struct jitter_cell *cell, enum jitter_way way)
{
    return jitter_has(cell, way) && way != WAY_CYCLIC_AGAIN;
}

/* Lateness as a person would say it. */
static void put_us(FILE *script, double us)
{
    if (us < 999.5)
        fprintf(script, "%.3g µs", us);
    else
        fprintf(script, "%.3g ms", us / 1e3);
}

static void put_panel(FILE *script, const struct jitter_cell *cell, size_t panel)
{
    const char *comma = "plot";
    double top = 0.95 - 0.482 * (double)panel;

    fprintf(script, "set tmargin at screen %g\nset bmargin at screen %g\n", top, top - 0.39);
    fprintf(script, "set title '{/:Bold Period 1 ms, %s}' offset 0,-0.4\n",
            cell->loaded ? "load on every core and on the disk" : "idle");
    fprintf(script, "set xlabel '%s'\n",
            panel == 1 ? "lateness, µs      (* no grid: interval less the period)" : "");
    for (enum jitter_way way = 0; way < WAYS; way++) {
        if (!drawn(cell, way))
            continue;
        const struct jitter_row *row = &cell->row[way];
        fprintf(script, "%s $d%zu_%d using 1:2 with steps lw %g dt %d lc rgb %s title \"%s: max ", comma,
                panel, (int)way, looks[way].width, looks[way].dash, looks[way].colour, jitter_ways[way].name);
        put_us(script, (double)row->ns[row->n - 1] / 1e3);
        fputc('"', script);
        comma = ", \\\n    ";
    }
    fputc('\n', script);
}

static void put_path(FILE *script, const char *path, const char *ending)
{
    const char *slash = strrchr(path, '/'), *dot = strrchr(path, '.');
    size_t stem = dot && (!slash || dot > slash + 1) && dot != path ? (size_t)(dot - path) : strlen(path);

    fputs("set output '", script);
    for (size_t i = 0; i < stem; i++) {
        if (path[i] == '\'')
            fputc('\'', script);
        fputc(path[i], script);
    }
    fprintf(script, ".%s'\n", ending);
}

/* The script becomes its standard input. */
static bool run_gnuplot(FILE *script)
{
    char name[] = "gnuplot", no_user_settings[] = "-d";
    char *const argv[] = {name, no_user_settings, NULL};
    posix_spawn_file_actions_t actions;
    pid_t pid;
    int status = -1;

    rewind(script);
    posix_spawn_file_actions_init(&actions);
    posix_spawn_file_actions_adddup2(&actions, fileno(script), STDIN_FILENO);
    int rc = posix_spawnp(&pid, name, &actions, NULL, argv, environ);
    posix_spawn_file_actions_destroy(&actions);
    if (rc == 0)
        waitpid(pid, &status, 0);
    return status == 0;
}

bool jitter_plot(const struct jitter *j, const char *path)
{
    FILE *script = tmpfile();
    double most = 1; /* us, of both panels: they have one axis */

    if (!script)
        return false;
    const struct jitter_cell *cell[2] = {jitter_cell_find(j, APC_NS_PER_MS, false),
                                         jitter_cell_find(j, APC_NS_PER_MS, true)};
    for (size_t panel = 0; panel < 2; panel++) {
        for (enum jitter_way way = 0; way < WAYS; way++) {
            if (!drawn(cell[panel], way))
                continue;
            const struct jitter_row *row = &cell[panel]->row[way];
            put_data(script, row, panel, way);
            most = fmax(most, (double)row->ns[row->n - 1] / 1e3);
        }
    }
    for (size_t i = 0; i < sizeof outputs / sizeof *outputs; i++) {
        fprintf(script, "reset\nset terminal %s\n", outputs[i].terminal);
        put_path(script, path, outputs[i].ending);
        fputs(prologue, script);
        fprintf(script, "set xrange [%g:%g]\nset yrange [0.7:*]\n", LOWEST, pow(10, ceil(log10(most))));
        for (size_t panel = 0; panel < 2; panel++)
            if (drawn(cell[panel], WAY_DEADLINE))
                put_panel(script, cell[panel], panel);
        fputs("unset multiplot\nset output\n", script);
    }
    bool done = !ferror(script) && run_gnuplot(script);
    fclose(script);
    return done;
}

/* SPDX-License-Identifier: BSD-3-Clause */
/*
 * Everything that needs judgement (ranges, bars, ticks, names) is decided here; gnuplot only draws. The
 * data stands in the script once, as named blocks, and is drawn twice, as SVG and as PNG of the same
 * layout, which is given in fractions of the page so that the time axes stand exactly above each other.
 */
#include <apcmath.h>

#include <math.h>
#include <stdlib.h>

#include "base/text.h"
#include "report_script.h"

#define TITLE_HEIGHT 40.0

/* Colours by Okabe and Ito, which the colour-blind can tell apart. Texts that change their font have two
 * blanks together somewhere: only then the SVG keeps any of their blanks. */
static const char prologue[] = "set encoding utf8\n"
                               "mark = 0xD55E00\n"
                               "quiet = 0x555555\n"
                               "increment = '{/:Italic t_{k+1} − t_k}'\n";

const char report_panel_style[] = "reset\n"
                                  "set border 3 lw 0.7 lc rgb 0x333333\n"
                                  "set tics nomirror out scale 0.5, 0.25 textcolor rgb 0x222222\n"
                                  "set grid lt 1 lw 0.5 lc rgb 0xE2E2E2\n"
                                  "set style fill solid noborder\n"
                                  "set minussign\n"
                                  "set format '%.7g'\n";

/* The same figure for each; the PNG has two pixels where the SVG has one unit. */
static const struct {
    const char *terminal, *rest;
    int scale;
} terminals[] = {
    {"svg",
     "dynamic enhanced font 'DejaVu Sans,Helvetica,sans-serif,12' background rgb 'white'\n"
     "set output 'report.svg'\ntitle_font = ',14'\n",
     1},
    {"pngcairo",
     "enhanced font 'DejaVu Sans,9.2' fontscale 2 linewidth 2 pointscale 3 dashlength 2\n"
     "set output 'report.png'\ntitle_font = ',10.7'\n",
     2},
};

double report_screen(double at, double height)
{
    return 1 - at / height;
}

/* ---- Text and numbers --------------------------------------------------------------------- */

/* Text of a user as a gnuplot string, in which only the single quote is special. */
void report_quoted(FILE *script, const char *text)
{
    char instead;

    fputc('\'', script);
    for (size_t n; *text; text += n) {
        n = text_step(text, &instead);
        if (*text == '\'')
            fputc('\'', script);
        fwrite(instead ? &instead : text, 1, instead ? 1 : n, script);
    }
    fputc('\'', script);
}

/* The smallest of 1, 2, 3, 4, 5, 6, 8 times a power of ten that is not below @p value > 0. */
double report_round_up(double value)
{
    static const double digits[] = {1, 2, 3, 4, 5, 6, 8};
    double decade = apc_pow(10.0, floor(apc_log10(value) + 1e-9));

    for (size_t i = 0; i < sizeof digits / sizeof *digits; i++)
        if (digits[i] * decade >= value * (1 - 1e-9))
            return digits[i] * decade;
    return 10.0 * decade;
}

/* A panel without data; its x axis is the caller's. */
void report_blank(FILE *script)
{
    fputs("unset ytics\nset yrange [0:1]\n"
          "set label 9 'no samples' at graph 0.5, 0.5 center textcolor rgb quiet\nplot NaN notitle\n",
          script);
}

/* ---- The figure --------------------------------------------------------------------------- */

static void put_title(FILE *script, const char *title, double height)
{
    fprintf(script, "%sset lmargin at screen 0.105\nset rmargin at screen 0.96\n", report_panel_style);
    fprintf(script, "set tmargin at screen 1\nset bmargin at screen %.4f\n",
            report_screen(TITLE_HEIGHT, height));
    fputs("unset border\nunset tics\nset xrange [0:1]\nset yrange [0:1]\nset label 1 ", script);
    report_quoted(script, title);
    fprintf(script, " at graph 0, screen %.4f noenhanced font title_font\nplot NaN notitle\n",
            report_screen(22, height));
}

int report_figure(FILE *script, const struct report_data *data, const struct experiment *e, const char *title)
{
    struct report_histograms *histograms = NULL;
    struct report_panels *panels = NULL;
    int rc = report_histograms_create(&histograms, data, e);
    if (rc == 0)
        rc = report_panels_create(&panels, data, e);
    if (rc < 0)
        goto out;
    const double top = TITLE_HEIGHT + report_histograms_height(histograms),
                 height = ceil(top + report_panels_height(panels));
    fputs(prologue, script);
    report_histograms_blocks(script, histograms);
    report_panels_blocks(script, panels);
    for (size_t i = 0; i < sizeof terminals / sizeof *terminals; i++) {
        fprintf(script, "set terminal %s size %d,%d %s", terminals[i].terminal,
                (int)REPORT_WIDTH * terminals[i].scale, (int)height * terminals[i].scale, terminals[i].rest);
        fputs("set multiplot\n", script);
        put_title(script, title, height);
        report_histograms_draw(script, histograms, TITLE_HEIGHT, height);
        report_panels_draw(script, panels, top, height);
        fputs("unset multiplot\nunset output\n", script);
    }
out:
    report_panels_destroy(panels);
    report_histograms_destroy(histograms);
    return rc;
}

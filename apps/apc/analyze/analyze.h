/* SPDX-License-Identifier: BSD-3-Clause */
/* apc analyze: what was found, and how it is shown. */
#ifndef APC_ANALYZE_H
#define APC_ANALYZE_H

#include "analyze/linear.h"
#include "apc/common/cli.h"
#include "apc/common/setting.h"

#define ANALYZE_AT 64

struct analyze_options {
    struct setting_list set;
    struct linear_at at[ANALYZE_AT];
    size_t n_at;
    const char *figure;
    const char *timing; /* a run folder; NULL: as the file says */
};

struct analysis_of_loop {
    char name[APC_TAG_LEN];
    struct apc_loop_margins margins;
    double *w, *re, *im; /* [points] of its response, by frequency; NULL: nobody asked */
    size_t points;
};

struct loop_analysis {
    struct cli cli;
    struct analyze_options own;
    struct experiment e;
    struct linear_loop l;
    size_t n;                      /* outputs */
    struct analysis_of_loop *loop; /* [n + 1], the last one of all together */
    size_t states;
    bool noisy; /* something moves the measurements: then there is a cost */
    struct linear_cost cost;
    double *pole_re, *pole_im; /* [states] in a period of all ticks */
};

/* Returns an exit code. */
int analyze_show(const struct loop_analysis *z);
/* Bode and Nyquist of all loops as NAME.svg and NAME.png. */
int analyze_draw(const struct loop_analysis *z, struct apc_error *why);

#endif

/* SPDX-License-Identifier: BSD-3-Clause */
/* A linear model as apc linearize shows it: of a plant at a point, or of a model file. */
#ifndef APC_LINEARIZE_H
#define APC_LINEARIZE_H

#include <complex.h>

#include <apcplant.h>

#include "apc/common/cli.h"
#include "apc/identify/linear.h"

/* Names of one kind of variable. */
struct linearize_names {
    char letter;                          /* x1, x2, ... where nothing names them */
    const struct apc_param *table, *more; /* the first @n of table, then those of more */
    size_t n;
    char (*tag)[APC_TAG_LEN]; /* instead of table, or NULL */
};

struct linearize_matrix {
    const char *name, *title;
    const double *value;
    size_t rows, columns;
    const struct linearize_names *row, *column;
};

struct linearize_view {
    const char *name, *at;   /* "tanks.model", "its operating point" */
    const char *kind;        /* "plant", "model" */
    double period;           /* s; 0: continuous time */
    size_t nx, nu, nd, ny;   /* nd disturbances stand behind the inputs */
    const double *x, *u, *y; /* where it is */
    struct linearize_names names_x, names_u, names_d, names_y;
    struct linearize_matrix matrix[7]; /* the first 4 come before the poles */
    size_t n_matrices;
    double complex *pole, *zero; /* [nx] */
    int n_zeros;                 /* or the error */
    bool integrates;             /* there is no steady-state gain */
};

/* As --json and --csv say; poles and zeros are sorted. */
void linearize_show(const struct cli *cli, struct linearize_view *view);

/* Is it the name of a model file? It ends with .model, or is there and ends as no plug-in does. */
bool linearize_is_file(const char *name);
/* The model file @p cli names. Returns an exit code, its reason told. */
int linearize_file(const struct cli *cli);

#endif

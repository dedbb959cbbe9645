/* SPDX-License-Identifier: BSD-3-Clause */
/* The parts of apc identify. */
#ifndef APC_IDENTIFY_H
#define APC_IDENTIFY_H

#include <stdio.h>

#include <apcidentify.h>
#include <apcstore.h>

#include "apc/common/cli.h"
#include "grid/grid.h"

#define COLUMNS_MOST     1024
#define IDENTIFY_RECORDS 32

/* Read a run folder, what a store has, or CSV with a name in each column, one of them "time" in s, as grid_read(). */
int identify_read(struct identify_data *data, const char *file, const struct identify_selection *selection,
                  struct apc_error *why);
int identify_read_files(struct reading *r); /* a run folder, or CSV */

/* The model that was found: transfer functions, or a sampled state space. */
struct identify_model {
    const char *kind; /* "transfer", "arx", "subspace", "fir" */
    struct apc_linear *linear;
    struct apc_identified *identified; /* NULL: transfer */
    struct apc_transfer *g, *error;    /* [ny * (nu + nd)] of transfer */
    double *u0, *y0;                   /* the operating point of each record; goes with identified or g */
    double *run;                       /* [n * ny] the free run over what was validated on */
    struct apc_validation validation[IDENTIFY_SIGNALS];
    double fit;           /* %, mean over the outputs */
    struct apc_error why; /* why there is none */
};

/* In the order in which they go before each other. */
enum identify_kind { TRANSFER, ARX, SUBSPACE, FIR, KINDS };

struct identify_options {
    struct identify_selection selection;
    const char *from, *to;
    char *validate;
    const char *output, *figure, *plant; /* plant: the experiment file that has it */
    char *find[IDENTIFY_SIGNALS];        /* parameters of the plant; finds 0: models are sought */
    size_t finds;
    char *prior[IDENTIFY_SIGNALS]; /* "NAME=MEAN+-DEVIATION" of some of these */
    size_t priors;
    bool profile;
    bool likelihood; /* with noises, of these states; noisy 0: of all */
    char *noisy_state[IDENTIFY_SIGNALS];
    size_t noisy;
    double share; /* of the record that is fitted to */
    int kind;     /* KINDS: all, and the best of them */
    unsigned order;
    bool force, suggest, signals;
    double tau_c; /* s, of what is suggested; 0: the dead time */
};

struct identify_window {
    const char *from, *to; /* NULL: no end */
};

/* All of a command. */
struct identification {
    struct cli cli;
    struct identify_options own;
    struct identify_window window[IDENTIFY_RECORDS]; /* of each argument */
    struct identify_data data, other;                /* all records; other: of --validate */
    struct identify_model model[KINDS];
    size_t fitted;     /* samples that were fitted to */
    double controller; /* s, its period; 0: the record does not say */
    int chosen;
    char *command;                         /* as it was typed, without passwords */
    char shown[IDENTIFY_RECORDS + 1][600]; /* stores, without passwords; the last is that of --validate */
    struct grid_warning *warning;
    size_t warnings;
};

/* Read the arguments into data, and --validate into other. Returns an exit code, its reason told. */
int identify_read_all(struct identification *z);

/* --find and --likelihood instead of models. Returns an exit code, its reason told. */
int identify_find(struct identification *z);
/* What was read, and what of it is fitted to: the first line of a report. */
void identify_show_samples(const struct identification *z);

/* A probability of independence below which it is no chance that what a model leaves out hangs on its inputs. */
#define IDENTIFY_TELLING 0.01

/* What the record does not tell of @p g with the standard errors @p e, into @p text: "", or as "the sign of the
 * gain, tau". True: something. */
bool identify_untold(const struct apc_transfer *g, const struct apc_transfer *e, char *text, size_t size);
/* Figures of the signals alone. Returns an exit code, its reason told. */
int identify_show_signals(const struct identification *z);
/* The report, as --json and --csv say. */
void identify_show(const struct identification *z);
/* The model as a file for a controller. */
void identify_write(FILE *out, const struct identify_model *model, const struct identify_data *data);
/* A figure of what was measured and what the model says of it: NAME.svg and NAME.png. */
int identify_figure(const char *name, const struct identify_model *model, const struct identify_data *data,
                    struct apc_error *why);

#endif

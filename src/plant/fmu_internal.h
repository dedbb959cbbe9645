/* SPDX-License-Identifier: BSD-3-Clause */
/*
 * An FMU as a model, shared by its files: fmu.c (its process, and what it says of the model), fmu_variables.c
 * (which of its variables are used, what they take), fmu_plant.c (a plant of it).
 */
#ifndef APC_PLANT_FMU_INTERNAL_H
#define APC_PLANT_FMU_INTERNAL_H

#include "base/subprocess.h"
#include "plant/fmu.h"

enum table { INPUT, OUTPUT, PARAMETER, STATE, TEXT, FIXED, N_TABLES };

/* Which numbers a variable takes. */
struct sort {
    enum { REAL, WHOLE, TRUTH, LABEL } kind;
    size_t first, n; /* its labels */
};

struct fmu {
    struct apc_plugin plugin;
    struct apc_model model, shown; /* the latter by its own states */
    struct apc_subprocess keeper;
    char *file, *folder;
    char **text; /* [n_text] what it said, that the tables point into */
    size_t n_text;
    struct apc_param *table[N_TABLES];
    struct sort *sort[N_TABLES];
    size_t n[N_TABLES];
    struct apc_param *label; /* [n_labels] what enumerations call their numbers: name, initial */
    size_t n_labels;
    struct sort *labelled;            /* whose labels come; NULL: nobody's */
    char **given;                     /* [n[TEXT]] what was given to its texts; NULL: nothing */
    struct apc_param *input, *output; /* as they were chosen, and their places in the tables */
    size_t *input_place, *output_place;
};

/* ---- fmu.c */

/** How long a process may take, where nobody has less patience. */
apc_ns apc_fmu_timeout(void);
/** Start a process, told @p what and @p with. Returns 0 or a negative error. [setup] */
int apc_fmu_begin(struct apc_subprocess *process, const char *what, const char *with, struct apc_error *why);
/** Nothing came of it (@p n < 0), or its end (0): bury it and say so. Returns APC_ESOLVER. */
int apc_fmu_fail_silent(struct apc_subprocess *process, ssize_t n, struct apc_error *why);

/* ---- fmu_plant.c */

/** Of each variable of table @p k whose description has no start value, ask an instance for its own.
 * Returns 0 or a negative error. [setup] */
int apc_fmu_ask_start(struct fmu *f, enum table k, struct apc_error *why);

/* ---- fmu_variables.c */

/** The FMU of a model, or of what apc_model_equations() has made of one; NULL: it is none. */
struct fmu *apc_fmu_of(const struct apc_model *model);

#endif

/* SPDX-License-Identifier: BSD-3-Clause */
/* What apc identify reads of a record before a grid is laid over it: the values of each signal by their
 * times. */
#ifndef APC_IDENTIFY_SERIES_H
#define APC_IDENTIFY_SERIES_H

#include "identify.h"

#define COLUMNS_MOST 1024

struct series {
    const char *name; /* NULL: not given */
    char own[APC_TAG_LEN], unit[APC_TAG_LEN];
    double *t, *value; /* s; NAN: Bad */
    size_t n, room;
};

struct reading {
    const char *file;
    const struct identify_selection *selection;
    struct series input[IDENTIFY_SIGNALS], output[IDENTIFY_SIGNALS];
    size_t inputs, outputs;
    double period; /* of the first output, s; 0: not said */
    struct apc_error *why;
};

/* Returns 0 or APC_ENOMEM. */
int series_add(struct reading *r, struct series *s, double t, double value);

/* A signal of a run or a store. */
struct known {
    enum apc_table table;
    int id;
    char name[APC_TAG_LEN], unit[APC_TAG_LEN];
    double period; /* s; 0: not said */
};
/* Which of them the selected signals are: of[i] goes with known[i], or is NULL. Without a selection inputs are
 * all outputs of controllers, outputs all measurements. */
int series_choose(struct reading *r, const struct known *known, size_t n, struct series **of);

/* Each file's own way; 0 or a negative error with the reason in r->why. */
int identify_read_files(struct reading *r); /* a run folder, or CSV */
int identify_read_store(struct reading *r);

#endif

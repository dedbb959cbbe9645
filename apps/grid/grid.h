/* SPDX-License-Identifier: BSD-3-Clause */
/* Records of signals, as apc identify and the page take them: the values of each by their times, and a grid that is
 * laid over them. */
#ifndef APC_GRID_H
#define APC_GRID_H

#include <apcidentify.h>
#include <apcstore.h>

#define IDENTIFY_SIGNALS 32 /* inputs or outputs, at most */

/* What is wanted of a file; n 0: of a run all outputs of its controllers, and all measurements. */
struct identify_selection {
    char *input[IDENTIFY_SIGNALS], *output[IDENTIFY_SIGNALS];
    size_t inputs, disturbances, outputs; /* disturbances are the last of the inputs */
    double period;                        /* s; 0: that of the first output */
    double from, to;                      /* s, of files; to 0: all */
    apc_ns since, until;                  /* UTC, of stores; 0: all */
    bool only;                            /* no other inputs than those that are named, which may be none */
    bool exchanged;                       /* inputs as the plant got them, not as they were written */
};

struct identify_data {
    struct apc_record record;
    char input[IDENTIFY_SIGNALS][APC_TAG_LEN], output[IDENTIFY_SIGNALS][APC_TAG_LEN];
    char input_unit[IDENTIFY_SIGNALS][APC_TAG_LEN],
        output_unit[IDENTIFY_SIGNALS][APC_TAG_LEN]; /* "": not said */
    double begin;                                   /* time of the first sample */
    struct identify_gaps {
        size_t missing, longest;
    } gaps[IDENTIFY_SIGNALS]; /* of each output */
    double *memory;
    size_t *runs; /* where each record begins that was read; NULL: there is one */
};
void identify_data_free(struct identify_data *data);

struct series {
    const char *name; /* NULL: not given */
    char own[APC_TAG_LEN], unit[APC_TAG_LEN];
    double *t, *value; /* s; NAN: Bad */
    size_t n, room;
};

struct reading {
    const char *file;
    struct apc_store *store;
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

/* Of r->store, what it has of the selected time. Returns 0 or a negative error with the reason in r->why. */
int stored_read(struct reading *r);

/* Where they are from: @read takes them in, as stored_read() does. */
struct grid_source {
    const char *file; /* named in messages */
    struct apc_store *store;
    int (*read)(struct reading *r);
};
/*
 * Inputs are held until the next one, also where they are Bad; measurements that are not Good or Uncertain, or
 * not there, are missing. Returns 0 or a negative error with the file in why; identify_data_free() in either case.
 */
int grid_read(struct identify_data *data, const struct grid_source *from,
              const struct identify_selection *selection, struct apc_error *why);

/* Records data[n] with the same signals and period, one behind the other; they remain the caller's. Returns 0 or
 * APC_ENOMEM; identify_data_free() of both. */
int grid_join(struct identify_data *to, const struct identify_data *data, size_t n);
/* Of each record the share that is @p until of all. Returns 0 or APC_ENOMEM; free(*memory). */
int grid_first(const struct apc_record *all, size_t until, struct apc_record *first, void **memory);

/* Histogram, spectrum, correlations and pairs of points of each of its signals, as members of JSON; and in short into
 * of[inputs and outputs], the outputs first, which may be NULL. Returns 0 or APC_ENOMEM. */
struct text;
struct signal_figures {
    const char *name;
    size_t n; /* samples that are there */
    double mean, deviation, low, high;
    double every; /* s, of the strongest sine in it; NAN: none is told */
};
int grid_signals(const struct identify_data *data, struct text *t, struct signal_figures *of);
/* Transform in place n complex numbers, a power of 2. */
void grid_fourier(double *re, double *im, size_t n);

/* What makes a record doubtful for models. */
struct grid_warning {
    const char *kind;      /* "limit", "drift", "loop", "coherence" */
    const char *of, *with; /* signals; with NULL: none */
    double value;          /* share of samples; drift; correlation; share that is explained */
    char text[300];
};
/* @p model, around u0 and y0 of each record, tells what the inputs leave. *to is to be freed in either case. Returns 0 or
 * APC_ENOMEM. */
int grid_warnings(const struct identify_data *d, const struct apc_linear *model, const double *u0,
                  const double *y0, struct grid_warning **to, size_t *n);
/* As a member of JSON. */
void grid_warnings_json(const struct grid_warning *warning, size_t n, struct text *t);

#endif

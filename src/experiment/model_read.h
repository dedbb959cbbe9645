/* SPDX-License-Identifier: BSD-3-Clause */
/* What a model file says, whoever's model it is. */
#ifndef APC_MODEL_READ_H
#define APC_MODEL_READ_H

#include "apclinear.h"
#include "files/settings.h"

/* Signals of one kind; place[i] is where signal i of the file's lists is among them. */
struct model_signals {
    const char *list, *kind; /* "inputs"; "output or measured disturbance", for messages */
    const char **name;       /* [n] */
    size_t n, *place;        /* [n] */
};

/* What is being read. */
struct model {
    struct settings *s;
    const config_setting_t *root;
    const char *whose; /* "controller base", for messages */
    struct model_signals input, output;
    double delay;    /* s, of all inputs */
    double *u0, *y0; /* the operating point, by place */
};

struct model_space {
    size_t nx, rows; /* rows: of A in the file; nx - rows states more have room in it */
    apc_ns period;   /* 0: in continuous time */
    double *A, *B, *C, *D, *x0, *dead_time; /* A [rows * rows], C [outputs * rows], B [nx * inputs] */
    double *K, *error;                      /* [rows * outputs], [outputs] */
    bool filter;                            /* there is a K */
    double *room;                           /* [nx * nx + outputs * nx] */
    double *memory;
};

/* calloc(), and a failure where there is none. */
void *model_array(struct settings *s, size_t n, size_t size);
/* "transfer" or "state_space", the other one NULL. */
void model_kind(const struct model *m, const config_setting_t **transfer, const config_setting_t **space);
/* After the names: delay, places, u0, y0. model_end() in either case. */
void model_begin(struct model *m);
void model_end(struct model *m);
/* g [outputs * inputs] */
void model_read_transfer(const struct model *m, const config_setting_t *list, struct apc_transfer *g);
/* With @more states more for each output where the file has a K. free(space->memory) in either case. */
void model_read_space(const struct model *m, const config_setting_t *group, bool more,
                      struct model_space *space);

#endif

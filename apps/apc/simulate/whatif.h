/* SPDX-License-Identifier: BSD-3-Clause */
/* A recorded run goes on otherwise: apc simulate FILE --from RUN@TIME, or STORE@TIME. */
#ifndef APC_WHATIF_H
#define APC_WHATIF_H

#include <stdio.h>

#include "apc/folder/store_folder.h"
#include "simulation/simulation.h"

struct whatif {
    const char *spec; /* as it was asked for */
    char dir[400];    /* of the run */
    char store[512];  /* the URI of one whose record makes the run folder; "": none */
    struct store_folder made;
    apc_ns utc;            /* of a store: when it goes on */
    double at;             /* s since its start, when it goes on */
    struct experiment was; /* what ran */
    bool played;           /* it was in real time: its record is, */
    struct playback playback;
    struct samples written;   /* else what people wrote is written again */
    struct samples unchanged; /* of one: its future as it would have been in virtual time */
};

/* RUN@TIME or STORE@TIME, where it is kept. Returns 0, or APC_EINVAL with what is wrong. */
int whatif_parse(struct whatif *w, const char *spec, struct apc_error *why);
/* The run; it has come to that time, and @p e has not ended by then. Returns 0 or a negative error;
 * whatif_free() in either case. */
int whatif_load(struct whatif *w, const struct experiment *e, struct apc_error *why);
/* Simulate until then, and let it be @p e from there. Returns 0 or a negative error; simulation_destroy() in
 * either case, before whatif_free(). */
int whatif_begin(const struct whatif *w, struct simulation *s, const struct experiment *e,
                 struct apc_error *why);
/* Of a run in real time: how late its ticks were from then on, and how it would have gone on unchanged. */
int whatif_judge(struct whatif *w, FILE *out, struct apc_error *why);
void whatif_free(struct whatif *w);

#endif

/* SPDX-License-Identifier: BSD-3-Clause */
/* What a controller would have done in a recorded run. */
#ifndef APC_REPLAY_H
#define APC_REPLAY_H

#include "samples.h"

/* How the outputs of one variable differ. */
struct replay_difference {
    uint64_t same;
    double sum, worst, at, low, high; /* of the recorded ones: low, high */
};

/* Called as the replay goes on; t in s since the start of the run. Either may be NULL. */
struct replay_watch {
    void (*output)(void *ctx, double t, int id, double recorded, double replayed);
    void (*notice)(void *ctx, double t, const char *text); /* of the replayed controller, but for its modes */
    void *ctx;
};

struct replay {
    struct experiment e;
    struct replay_difference *difference; /* [e.dim.nu] */
    uint64_t ticks, guessed;              /* of these: with an input that no output names */
    bool seqs, operated;                  /* there are seqs.csv, operation.csv */

    /* its own */
    struct samples samples, operation;
    size_t *by_seq;        /* [samples.n] indices of the samples by table, id, seq */
    struct apc_pair *pair; /* [nu] */
    struct apc_controller *core;
    struct apc_sample *in; /* of the core */
    size_t *next;          /* of each of them: the first sample not yet given */
    bool other_law;
    struct replay_watch watch;
};

/* The record of the run in folder @p dir, and its controller or one with the law that overrides name. Returns
 * 0 or a negative error; replay_free() in either case. */
int replay_load(struct replay *r, const char *dir, const struct experiment_overrides *overrides,
                struct apc_error *why);
void replay_run(struct replay *r, const struct replay_watch *watch); /* once */
void replay_free(struct replay *r);

#endif

/* SPDX-License-Identifier: BSD-3-Clause */
/* apc replay --figure: outputs on record, and as they are replayed. */
#ifndef APC_REPLAY_CURVES_H
#define APC_REPLAY_CURVES_H

#include <stdio.h>

#include "record/record.h"

/* Of a loop. What is long past without a difference is thinned. */
struct replay_curve {
    struct apc_tag loop;
    struct replay_point {
        double t, recorded, replayed;
    } * at; /* [n] of [room] */
    size_t n, room;
};

struct replay_curves {
    struct replay_curve *of; /* [n] */
    size_t n;
    double first,
        end; /* s; where the first that is known to differ is, and behind which nothing is drawn; end 0: none */
    bool whole; /* a controller at a time, not an hour of each: nothing is thinned */
    bool failed;
};

void replay_curves_keep(struct replay_curves *k, double t, const char *loop, double recorded,
                        double replayed);
/* Around the first that differs, as NAME.svg and NAME.png, which is said; all, where none does. Returns 0 or a negative
 * error. */
int replay_curves_draw(const struct replay_curves *k, const char *title, const char *name, FILE *out,
                       struct apc_error *why);
void replay_curves_free(struct replay_curves *k);

#endif

/* SPDX-License-Identifier: BSD-3-Clause */
/* apc replay --figure: outputs on record, and as they are replayed. */
#ifndef APC_REPLAY_CURVES_H
#define APC_REPLAY_CURVES_H

#include <stdio.h>

#include "record/record.h"

struct replay_curves {
    struct apc_tag *loop; /* [n] */
    size_t n;
    struct samples recorded, replayed; /* of loop i those of id i + 1 */
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

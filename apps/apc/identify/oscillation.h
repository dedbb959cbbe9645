/* SPDX-License-Identifier: BSD-3-Clause */
/* What a relay made of a loop, from what was recorded of it. */
#ifndef APC_OSCILLATION_H
#define APC_OSCILLATION_H

#include <apcidentify.h>

struct oscillation {
    double gain;  /* with which alone the loop would swing, its sign that of the plant; less where the relay
                     has a hysteresis, and so switches later than the limit is */
    double every; /* s */
    size_t whole; /* periods that this is of */
};

/*
 * Of input @p j and measurement @p i: where the input goes to and fro between two values, at least twice, and
 * its periods are alike. The gain is that of the first harmonics (Astrom and Hagglund, Automatica
 * 20, 1984, take a sine for what is measured, a triangle as well). Returns false where there is none.
 */
bool oscillation_find(const struct apc_record *record, size_t j, size_t i, struct oscillation *found);

#endif

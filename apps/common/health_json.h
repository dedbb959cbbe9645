/* SPDX-License-Identifier: BSD-3-Clause */
/* The health of a loop in words, and for programs. */
#ifndef APC_HEALTH_JSON_H
#define APC_HEALTH_JSON_H

#include "figures/figures.h"
#include "files/files.h"

/* What the verdict rests on, "it did not change for 3 s; ...", terminated; "": nothing further. */
void health_evidence(const struct health *h, struct text *t);
/* Members: what was judged, and what is wrong with it. */
void health_members(const struct kpis_loop *l, struct text *t);

#endif

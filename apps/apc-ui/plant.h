/* SPDX-License-Identifier: BSD-3-Clause */
/* What there is: the variables as they are described in the store, and the loops that they make. */
#ifndef APC_UI_PLANT_H
#define APC_UI_PLANT_H

#include <apccontrol.h>
#include <apcstore.h>

#include "json.h"

#define REF_LEN 24 /* "setpoint.2147483647" */

/* Periods of who writes, 0: not known. */
struct rhythms {
    apc_ns client, plant, controller;
};

struct plant {
    char name[APC_TAG_LEN], title[128];
    apc_ns start; /* t = 0 of the run, UTC; 0: not known */
    unsigned revision;
    struct rhythms rhythms;
    struct apc_tag *tag; /* of the variables that people see, by table, then id */
    size_t n;
    size_t ny, nz, nu, tunings; /* how many of each; ids are 1.. */
    struct apc_pair *pair;      /* [nu]: what each output controls, as the law says */
};

/* Take over new descriptions, and what table dim says of each output. NULL: what is usual. Returns true when
 * they differ from the old ones: then the revision has risen. */
bool plant_describe(struct plant *p, const struct apc_tag *tags, size_t n, const struct apc_pair *pair);
bool plant_rhythms(struct plant *p, const struct rhythms *rhythms);
void plant_free(struct plant *p);

/* How many of a table there are. */
size_t tags_count(const struct apc_tag *tags, size_t n, enum apc_table table);
/* Index into tag, or -1. */
int plant_find(const struct plant *p, enum apc_table table, int id);
/* "sensor.1" and so on; false: not understood. Whether there is such a variable is another question. */
bool ref_parse(const char *ref, enum apc_table *table, int *id);
char *ref_format(enum apc_table table, int id, char ref[REF_LEN]);

/* How often it is written; 0: when somebody wants to, or not known. */
apc_ns plant_period(const struct plant *p, enum apc_table table);
/* The id in table state by which the controller confirms what it has taken; see struct seen in writes.h. */
int plant_confirmation(const struct plant *p);
void plant_json(const struct plant *p, struct text *t);

#endif

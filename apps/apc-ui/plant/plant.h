/* SPDX-License-Identifier: BSD-3-Clause */
/* What there is: the variables as they are described in the store, and the controllers and loops that they
 * make. */
#ifndef APC_UI_PLANT_H
#define APC_UI_PLANT_H

#include <apccontrol.h>
#include <apcstore.h>

#include "files/files.h"
#include "operate/operate.h"

#define REF_LEN 24 /* "setpoint.2147483647" */

/* How often a task ticks. */
struct rhythm_of {
    char task[APC_TAG_LEN]; /* "client", "plant", or a controller */
    apc_ns period;
};

struct plant {
    char name[APC_TAG_LEN], title[128];
    apc_ns start; /* t = 0 of the run, UTC; 0: not known */
    unsigned revision;
    struct rhythm_of *rhythm;
    size_t rhythms;
    struct apc_tag *tag; /* of the variables that people see, by table, then id */
    size_t n;
    struct loops loops;
};

/* Take over new descriptions, and the loops that they make, whose memory is the plant's from here on. Returns
 * true when they differ from the old ones: then the revision has risen. */
bool plant_describe(struct plant *p, const struct apc_tag *tags, size_t n, struct loops *loops);
/* Somebody has said how often a task ticks. Returns true, and the revision has risen, when that is new. */
bool plant_rhythm(struct plant *p, const char *task, apc_ns period);
/* Nothing is described any more. */
void plant_forget(struct plant *p);
void plant_free(struct plant *p);

/* Index into tag, or -1. */
int find_plant_tag(const struct plant *p, enum apc_table table, int id);
/* Index of the controller that takes what people write there, or that writes it; -1: none. */
int plant_controller(const struct plant *p, enum apc_table table, int id);
/* "sensor.1" and so on; false: not understood. Whether there is such a variable is another question. */
bool ref_parse(const char *ref, enum apc_table *table, int *id);
char *ref_format(enum apc_table table, int id, char ref[REF_LEN]);

/* How often it ticks; 0: not known. */
apc_ns plant_tick_time(const struct plant *p, size_t controller);
/* How often it is written; 0: when somebody wants to, or not known. */
apc_ns plant_period(const struct plant *p, enum apc_table table, int id);
/* May the loop be asked for this mode? */
bool loop_may(const struct loops_loop *loop, enum apc_mode mode);
/* Has the table rows that people write and a controller takes? */
bool table_wanted(enum apc_table table);
void plant_members(const struct plant *p, struct text *t);

#endif

/* SPDX-License-Identifier: BSD-3-Clause */
/* A simulation, shared by its files: simulation.c (the modules), external_events.c (what else happens). */
#ifndef APC_SIMULATION_INTERNAL_H
#define APC_SIMULATION_INTERNAL_H

#include "simulation.h"

/* The order of coinciding events. Requests come to the plant after its own tick, replies before the
 * controllers'. Of those who stand above comes what those below take, so each depth has a rank of its own. */
enum rank {
    RANK_CLOCK,
    RANK_OPERATOR,
    RANK_INSTRUCTOR, /* behind all that people wrote */
    RANK_RAMPS,
    RANK_SCHEDULER,
    RANK_PLANT,
    RANK_LINK,
    RANK_CLIENT = RANK_LINK,
    RANK_CONTROLLERS,
    RANK_ALARMS = 1 << 20 /* behind controllers of any depth */
};

/* ---- simulation.c */

/* s since t = 0 */
double simulation_time(const struct simulation *s);
/* It ends early, and says why. */
void simulation_stop(struct simulation *s, int rc, const char *fmt, ...) APC_PRINTF(3, 4);
void simulation_stop_at_store(struct simulation *s, int rc); /* if @p rc is an error of its store */
/* An event of its records. */
void simulation_tell(struct simulation *s, const char *source, enum apc_event_severity severity,
                     const char *kind, const char *fmt, ...) APC_PRINTF(5, 6);

/* ---- external_events.c */

int simulation_schedule_clock(struct simulation *s);
/* Of what is repeated each row at its time. */
void simulation_repeat(void *simulation);
/* What others wrote is seen by those who are not told of it: the trajectory, the scheduler, who moves ramps. */
void simulation_see_writes(struct simulation *s);

/* ---- past.c */

/* What was until its experiment goes on, in the folder of which that has the name. */
struct simulation_past {
    struct experiment was;
    struct playback playback;
    double at;                     /* s since t = 0, when it goes on, */
    const struct experiment *is;   /* as this, */
    const struct samples *written; /* with what people write from then on; NULL: nothing */
    bool over;                     /* it does */
};

int simulation_take_past(struct simulation *s, struct apc_error *why);
/* It has come to the end of it: from here on it is simulated. Why it cannot be is in s->why. */
void simulation_end_past(struct simulation *s);
void simulation_free_past(struct simulation_past *past);

/* ---- instructor.c */

/* Of the experiment that it is now; what people started of those of @p was, from which it goes on, is as it is. Returns 0
 * or APC_ENOMEM; simulation_drop_faults() in either case. */
int simulation_take_faults(struct simulation *s, const struct experiment *was);
/* @p e has them as its file again. */
void simulation_drop_faults(struct simulation *s, const struct experiment *e);
/* Faults that people started or stopped. */
void simulation_see_faults(struct simulation *s);
/* Those of the plant itself, at its tick. */
void simulation_break_plant(struct simulation *s);

/* ---- pace.c */

/* The plant's tick after @t, both since t = 0. */
apc_ns simulation_next_tick(const struct simulation *s, apc_ns t);

#endif

/* SPDX-License-Identifier: BSD-3-Clause */
/*
 * The shared memory that a run has of its own, /dev/shm/apc.run-PID-TIME. Whose run lives has it locked; a
 * symbolic link beside it, NAME.folder, leads to the run folder. So what a run left that was killed can be
 * told from what a run uses, and given back to its folder.
 */
#ifndef APC_SEGMENT_H
#define APC_SEGMENT_H

#include "experiment/experiment.h"

struct segment {
    char uri[96];    /* "shm:run-PID-TIME?size=MIB" */
    char path[96];   /* "": there is none */
    char folder[96]; /* the link */
    unsigned mib;
    double held;        /* s for which it keeps all that the experiment writes; as of apc_shm_holds() */
    double timing_held; /* s, of the timing of all daemons, which has a ring of its own */
    int lock;
};

/* Give it a name, unless it has one, and the size that the experiment needs. Returns 0, or an error in @p why. */
int segment_plan(struct segment *s, const struct experiment *e, struct apc_error *why);
/* It is made: it is the run's in @p dir, until this process and those that it forked have ended. */
int segment_own(struct segment *s, const char *dir, struct apc_error *why);
/* Its name becomes NAME.@p number, and its run folder @p dir: another one may have its former name. */
int segment_rename(struct segment *s, int number, const char *dir, struct apc_error *why);
/* Nobody needs it any more; or there is none. */
void segment_remove(const struct segment *s);
/* That of the live store @p uri of a run whose process has ended, from now on this one's. Returns 1, 0 when
 * there is none, APC_EBUSY when its run goes on, or another error. */
int segment_adopt(struct segment *s, const char *uri, struct apc_error *why);
/* On stderr: what runs have left that were killed. */
void segment_name_orphans(void);

#endif

/* SPDX-License-Identifier: BSD-3-Clause */
/*
 * What becomes of operators' writes. A write is begun, then accepted (committed), failed, or unknown; from
 * then on the newest samples, as the daemon reads them, settle it:
 *
 *     unknown, stored not known   the row with the write's own seq and time is there: accepted;
 *                                 that seq is somebody else's: failed
 *     accepted                    the controller has taken as many rows as there were when ours was first
 * seen: applied (a mode: if the actual mode is the target, else failed); not within its time: unknown, stored
 *
 * The controller tells how many it has taken by one row of table state, the sum of the seqs of all setpoints,
 * the target mode, the tunings and the manual outputs. Seqs only rise and a read is of one instant, so a sum
 * that has reached the one of a read with our row in it includes our row.
 */
#ifndef APC_UI_WRITES_H
#define APC_UI_WRITES_H

#include <apcstore.h>

#include "json.h"
#include "users/users.h"

#define WRITES        256
#define WRITE_CHANGES 64 /* variables in one write */
#define KEY_LEN       65

enum write_kind { WRITE_SETPOINT = 1, WRITE_OUTPUT, WRITE_MODE, WRITE_TUNING };
enum write_state { WRITE_BEGUN = 1, WRITE_ACCEPTED, WRITE_APPLIED, WRITE_FAILED, WRITE_UNKNOWN };

struct write_change {
    char name[APC_TAG_LEN];
    struct apc_sample before, after; /* after.seq: what it was or would have been given */
};

struct write {
    char key[KEY_LEN];
    enum write_kind kind;
    char user[USER_NAME_LEN];
    enum write_state state;
    int stored; /* 1, 0; -1: not known */
    char reason[160];
    apc_ns time;  /* UTC */
    apc_ns ended; /* monotonic: when the attempt was over, and the controller's time began */
    double taken; /* what the controller's sum must reach; < 0: our row was not seen yet */
    size_t n;
    struct write_change *change; /* [n] */
};

/* The newest samples as of one instant. */
struct seen {
    const struct apc_sample *samples; /* all setpoints, opmode 0 and 1, tunings, manuals among them */
    size_t n;
    double taken;    /* the controller's sum; < 0: it has written none */
    apc_ns patience; /* how long the controller may take to confirm */
};

struct writes;
/* Told, with the writes locked, at each change of state but to WRITE_BEGUN. */
typedef void (*write_told)(void *ctx, const struct write *write);

int writes_create(struct writes **writes, write_told told, void *ctx);
void writes_destroy(struct writes *writes);

/*
 * Begin one. Returns 0; 1 when there is one with this key, which is then written to t as JSON (unless it is
 * only begun: APC_EBUSY); APC_ENOMEM. `change` is copied.
 */
int writes_begin(struct writes *w, const struct write *write, struct text *t);
/* How the attempt ended: a state, stored, a reason. The changes have the seqs that they were given. */
void writes_end(struct writes *w, const char *key, enum write_state state, int stored, const char *reason,
                const struct write_change *change, apc_ns now, struct text *t);
void writes_settle(struct writes *w, const struct seen *seen, apc_ns now);
/* All, or the one with this key. Returns how many. */
size_t writes_json(struct writes *w, const char *key, struct text *t);

void write_json(const struct write *write, struct text *t);
bool key_ok(const char *key);

#endif

/* SPDX-License-Identifier: BSD-3-Clause */
/*
 * What becomes of operators' writes. A write is begun, then accepted (committed), failed, or unknown; from
 * then on the newest samples, as the daemon reads them, settle it:
 *
 *     unknown, stored not known   the row with the write's own seq and time is there: accepted;
 *                                 that seq is somebody else's: failed
 *     accepted                    as operate/operate.h judges it: applied, superseded, or failed, when all
 *                                 of it is; unknown, stored, when its controller does not tick or takes too
 *                                 long. A setpoint that was given back to the scheduler: applied when the
 *                                 scheduler has written it
 */
#ifndef APC_UI_WRITES_H
#define APC_UI_WRITES_H

#include <apcstore.h>

#include "files/files.h"
#include "operate/operate.h"
#include "plant.h"
#include "users/users.h"

#define WRITES        256
#define WRITE_CHANGES 64                   /* variables in one write */
#define WRITES_OPEN   ((size_t)2 * WRITES) /* rows that writes_open() may want */
#define KEY_LEN       65

enum write_kind {
    WRITE_SETPOINT = 1,
    WRITE_OUTPUT,
    WRITE_MODE,
    WRITE_OWNER,
    WRITE_TUNING,
    WRITE_UNDO,
    WRITE_RETAKE,
    WRITE_APPROVE,
    WRITE_ACK,
    WRITE_SHELVE,
    WRITE_SERVICE
};
enum write_state {
    WRITE_BEGUN = 1,
    WRITE_ACCEPTED,
    WRITE_APPLIED,
    WRITE_SUPERSEDED,
    WRITE_FAILED,
    WRITE_UNKNOWN
};

struct write {
    char key[KEY_LEN];
    enum write_kind kind;
    char user[USER_NAME_LEN];
    enum write_state state;
    int stored;   /* 1, 0; -1: not known */
    bool confirm; /* it failed, as so great a step has to be confirmed */
    bool waits;   /* the same, as it takes a second person */
    char reason[240];
    apc_ns time;      /* UTC */
    apc_ns undoes;    /* time of the write that it takes back, or whose values it takes again; else 0 */
    apc_ns ended;     /* monotonic: when the attempt was over, and the controller's time began */
    apc_ns asked;     /* monotonic: when its refusal was last asked for */
    size_t n, wanted; /* changes; those that were asked for: what others were taken along is not waited for */
    struct change *change; /* [n] after.seq: what it was or would have been given */
};

/* The newest rows as of one instant. */
struct seen {
    const struct apc_sample *samples; /* [n] all that was written and what became of it among them */
    const int *by;                    /* [n] index of the controller that takes it; -1: none does */
    size_t n;
    const struct apc_vector *tick; /* of the controllers */
    const struct loops_controller *controller;
    apc_ns utc;
};

/* A write that its controller has refused: why is said by an event, which may come a little later. */
struct refusal {
    char key[KEY_LEN];
    char name[APC_TAG_LEN];
    apc_ns since;   /* UTC */
    char text[160]; /* "": not found */
};

struct writes;
/* Told, with the writes locked, at each change of state but to WRITE_BEGUN. */
typedef void (*write_told)(void *ctx, const struct write *write);

int writes_create(struct writes **writes, write_told told, void *ctx);
void writes_destroy(struct writes *writes);

/*
 * Begin one. Returns 0; 1 when it has been asked for with this key before, which is then written to t as JSON
 * (unless it is only begun: APC_EBUSY); APC_ECONFLICT: the key is another write's; APC_ENOMEM. `change` is
 * copied.
 */
int writes_begin(struct writes *w, const struct write *write, struct text *t);
/* The same of one whose changes are not known yet. 0: it has not been asked for. */
int writes_again(struct writes *w, const struct write *write, struct text *t);
/* How the attempt ended: state, stored, the changes with the seqs that they were given, one more perhaps than
 * when it began. */
void writes_end(struct writes *w, const char *key, const struct write *ended, const char *reason, apc_ns now,
                struct text *t);
/* Returns whether it wants to know why one was refused, and which: call it again with the text. */
bool writes_settle(struct writes *w, const struct seen *seen, apc_ns now, struct refusal *refusal);
/* What has to be read, beside the variables that people see, to settle what is wanted of alarms: the switches
 * and what became of them, table and id. Returns how many, at most WRITES_OPEN. */
size_t writes_open(struct writes *w, struct apc_sample *rows);
/* All, or the one with this key. Returns how many. */
size_t writes_json(struct writes *w, const char *key, struct text *t);

void write_json(const struct write *write, struct text *t);
bool key_ok(const char *key);

#endif

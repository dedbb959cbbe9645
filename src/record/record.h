/* SPDX-License-Identifier: BSD-3-Clause */
/* The alarms of a store as they stand, and what people want of them: for whoever shows or acknowledges them.
 */
#ifndef APC_RUN_ALARM_BOARD_H
#define APC_RUN_ALARM_BOARD_H

#include "operate/outcome.h"
#include "experiment/experiment.h"

/* Of one alarm: its newest row; the newest of each switch, and what became of that. */
struct alarm_now {
    struct apc_sample *row, *wish[3], *actual[3]; /* wish: ALARM_WISH() */
};
#define ALARM_WISH(which) ((which)-APC_ALARM_ACK)

struct alarm_board {
    struct experiment e;  /* as the store describes it */
    int64_t revision;     /* of the catalogue that this is of; 0: of none */
    struct alarm_now *at; /* [e.n_alarms] */
    struct apc_sample *memory;
    struct apc_vector tick;
    double numbers[APC_ALARMS_TICK];
    struct apc_rows rows;
};

/* From the catalogue of a store; of a board that is open, only where the catalogue is another than before.
 * Zeroed before the first time. Returns 0, APC_ENOTFOUND (it describes no alarms), or another error with a
 * text in @why; alarm_board_close() in either case. */
int alarm_board_open(struct alarm_board *board, struct apc_store *store, struct apc_error *why);
void alarm_board_close(struct alarm_board *board);
/* What is newest. Returns 0 or the store's error. */
int alarm_board_read(struct alarm_board *board, struct apc_store *store);

/* NULL: there is none of that name. */
const struct alarm_now *alarm_board_find(const struct alarm_board *board, const char *name);
const struct alarm *alarm_board_alarm(const struct alarm_board *board, const struct alarm_now *now);
enum apc_alarm_state alarm_board_state(const struct alarm_now *now);
/* When shelving that is in force ends, UTC; 0: it is not shelved. */
apc_ns alarm_board_shelved(const struct alarm_now *now);

/* Is somebody evaluating them, at @utc? */
bool alarm_board_lives(const struct alarm_board *board, apc_ns utc);

/* May shelving end then, @value as it is written? False, with a reason in @why: that is past, or too far. */
bool alarm_board_may_shelve(const struct alarm_board *board, const struct alarm_now *now, double value,
                            apc_ns utc, struct apc_error *why);
/*
 * What is wanted of an alarm, as a row to be written; @value of APC_ALARM_SHELF and APC_ALARM_SERVICE as they
 * are written, of APC_ALARM_ACK what was seen is taken. Returns false, with a reason in @why, where it makes
 * no sense for the alarm as it stands: nothing to acknowledge, somebody has already, too long. @store knows
 * who that somebody is; NULL: nobody does.
 */
bool alarm_board_want(const struct alarm_board *board, const struct alarm_now *now, struct apc_store *store,
                      enum apc_alarm_switch which, double value, apc_ns utc, struct apc_sample *wish,
                      struct apc_error *why);
/* The same in words, as the record has it; @reason may be NULL. */
void alarm_board_words(const char *name, const struct apc_sample *wish, const char *reason, char *text,
                       size_t size);
/* What became of it, as of the last read. */
enum outcome alarm_board_outcome(const struct alarm_board *board, const struct alarm_now *now,
                                 const struct apc_sample *wish, apc_ns utc);
/* With which words it was refused: of the events since the tick that did the first one of this alarm. False:
 * it is not there; it may come a little later. */
bool alarm_board_refusal(const struct alarm_board *board, const struct alarm_now *now,
                         const struct apc_sample *wish, struct apc_store *store, char *text, size_t size);

#endif

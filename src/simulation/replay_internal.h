/* SPDX-License-Identifier: BSD-3-Clause */
/* One tick of a recorded run again: replay_load.c, season.c read it, replay.c compares it, and why.c alters it. */
#ifndef APC_REPLAY_INTERNAL_H
#define APC_REPLAY_INTERNAL_H

#include "modules/controller.h"
#include "simulation.h"

/* The experiment of a run folder, its start, and what made it. Returns 0 or an error. */
int replay_load_folder(struct replay *r, const char *dir, const struct experiment_overrides *overrides,
                       struct apc_error *why);
/* The experiment of a store as it was described then or, where it does not say that, as it is now; @p text is the
 * caller's to free. Returns 0 or an error. */
int replay_catalogue(struct apc_store *store, apc_ns then, char **text, struct apc_error *why);
/* Room for it; the experiment is loaded. */
int replay_make(struct replay *r, struct apc_error *why);
/* Samples that ticks name: what was in force when the range begins, and all in it. Of vectors the last before it,
 * and all in it. Both return 0 or an error. */
int replay_load_samples(struct replay *r, struct apc_store *store, const struct apc_range *range);
int replay_load_vectors(struct ticks *to, struct apc_store *store, enum apc_table table, int id,
                        const struct apc_range *range);
/* The ticks of controller @p number widen what is between these two, which may be first > last: nothing. Returns 0 or
 * an error. */
int replay_look_at_ticks(struct apc_store *store, int number, apc_ns *first, apc_ns *last);
/* t = 0 of these ticks, as near as the least late of them says. */
apc_ns replay_part_start(const struct controller *of, const struct ticks *ticks);
/* From the tick before to tick @p k; by their grid where the clock was set between them. */
apc_ns replay_time_between(const struct replay_controller *rc, size_t k);
/* Is a tick of then one of those that are asked for? Others lead to them. */
bool replay_judges(const struct replay *r, apc_ns time);
/* Tick @k of the record, of a controller that lived on or, where that gives another row, was started anew. Returns 0
 * or an error with a text in r->why. */
int replay_tick(struct replay *r, struct replay_controller *rc, size_t k);
/* A controller anew, as a daemon that is started after the row of @p former; NULL: at the beginning. Returns 0
 * or an error with a text in r->why. */
int replay_start_controller(struct replay *r, struct replay_controller *rc, const struct tick_row *former,
                            apc_ns time);
/* Give it the inputs that the tick of @p row names. Returns what of these is not on record; NULL: all are. */
const struct apc_sample *replay_give_tick(struct replay *r, struct replay_controller *rc,
                                          const struct tick_row *at, const double *row);
/* Then compute that tick. */
void replay_compute_tick(struct replay_controller *rc, const double *row, struct apc_notice *notice);
/* Its outputs went out, and the next tick is computed after it. */
void replay_end_tick(struct replay_controller *rc, const struct tick_row *at, const double *row);
bool replay_same_bits(double a, double b);
/* Did all of the row come out? */
bool replay_is_made(const struct apc_controller *c, const double *row);
/* If not: what did not, and why. */
void replay_tell_difference(const struct replay *r, const struct replay_controller *rc,
                            const struct tick_row *at, const double *row, const struct apc_sample *missing,
                            char text[REPLAY_TEXT]);
/* Samples by variable and number, for qsort(). */
int replay_order_samples(const void *left, const void *right);
/* The row of @p seq of a variable; NULL: it is not on record. */
const struct apc_sample *replay_sample(const struct replay *r, enum apc_table table, int id, int64_t seq);
/* The same, which is looked for in the store too. */
const struct apc_sample *replay_named(struct replay *r, enum apc_table table, int id, int64_t seq);
/* The recorded tick of that time, with ticks before it, in the description that it was made by; where none has its mark,
 * in that in force. Returns 0, APC_ENOTFOUND or the store's error. */
int season_load_tick(struct season *s, const char *controller, apc_ns time, struct replay **r,
                     struct replay_controller **rc, size_t *k);
/* Of tick @p k, which does not come out, what is at odds with it. Returns 0 or an error with a text in r->why. */
int why_differs(struct differs *d, struct replay *r, struct replay_controller *rc, size_t k);
/* Room for one more cause; NULL: out of memory. */
struct differs_cause *differs_add(struct differs *d);
/* The terms of the law at the tick that was computed last, recorded or replayed. Returns 0 or APC_ENOMEM. */
int differs_take_terms(struct differs *d, const struct replay_controller *rc, size_t element, bool recorded);

#endif

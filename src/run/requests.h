/* SPDX-License-Identifier: BSD-3-Clause */
/*
 * What people ask of a history, brought to the live store. A request is done once: the row that it becomes
 * and the mark that it has been done are one transaction of the live store, so whoever is killed when, the
 * mark says what the history was not told any more. The mark is a row of table opmode in one of
 * REQUESTS_MARKS places, by the request's id: value is the id, time is when it was asked for, origin the seq
 * of the row. A database that comes back older asks for what has been done, under the same id and time; or
 * for something new, under an id that was given out before, at a later time.
 *
 * What is too old, by the database's clock or by ours, what lies outside its limits, and what no controller
 * would take now, is not written: it would come into force when nobody expects it any more.
 */
#ifndef APC_RUN_REQUESTS_H
#define APC_RUN_REQUESTS_H

#include <apcstore.h>

#define REQUESTS_MARKS 64
/* Id in table opmode of the mark of a request. */
#define REQUESTS_MARK(id) (5 * 65536 + (int)((id) % REQUESTS_MARKS))

struct requests;

/* Both stay the caller's and are nobody else's meanwhile. @p most is how old a request may become. Returns 0
 * or APC_ENOMEM. */
int requests_create(struct requests **requests, struct apc_store *live, struct apc_store *history,
                    apc_ns most, struct apc_error *why);
void requests_destroy(struct requests *requests);
/* Bring what is new, and say what became of what is settled. Returns how many are still to be answered, or an
 * error after which it may be called again. */
int requests_step(struct requests *requests);
const char *requests_error(const struct requests *requests);

#endif

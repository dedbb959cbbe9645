/* SPDX-License-Identifier: BSD-3-Clause */
/*
 * What people ask of a history, or at a broker, brought to the live store. A request is done once: the row
 * that it becomes and the mark that it has been done are one transaction of the live store, so whoever is
 * killed when, the mark says what the history was not told any more. The mark is a row of table opmode in one
 * of REQUESTS_MARKS places: value is the request's id, time is when it was asked for, origin the seq of the
 * row. It takes the place of the mark of the earliest time, so what was asked for later than that, and has no
 * mark, has not been done; of what is as early or earlier nobody knows. A database that comes back older asks
 * for what has been done, under the same id and time; or for something new, under an id that was given out
 * before, at a later time.
 *
 * What is too old, by the database's clock or by ours, what lies outside its limits, and what no controller
 * would take now, is not written: it would come into force when nobody expects it any more.
 */
#ifndef APC_RUN_REQUESTS_H
#define APC_RUN_REQUESTS_H

#include <apcstore.h>

#define REQUESTS_MARKS 64
/* Ids in table opmode of the marks, by who brings them. */
#define REQUESTS_OF_HISTORY (5 * 65536)
#define REQUESTS_OF_BROKER  (6 * 65536)

struct requests;

/* Where requests come from, and are answered: as apc_store_requests() and apc_store_answer(). */
struct requests_source {
    void *ctx;
    int (*give)(void *ctx, apc_request_fn fn, void *fn_ctx);
    int (*answer)(void *ctx, int64_t id, int64_t seq, const char *outcome);
    const char *(*error)(void *ctx);
    int marks;    /* the first of its REQUESTS_MARKS ids */
    apc_ns ahead; /* of our clock a request may be; 0: as much as it may be old */
};

/* Both stay the caller's and are nobody else's meanwhile. @p most is how old a request may become. Returns 0
 * or APC_ENOMEM. */
int requests_create(struct requests **requests, struct apc_store *live, struct apc_store *history,
                    apc_ns most, struct apc_error *why);
/* The same of another source. */
int requests_create_of(struct requests **requests, struct apc_store *live, const struct requests_source *from,
                       apc_ns most, struct apc_error *why);
void requests_destroy(struct requests *requests);
/* Bring what is new, and say what became of what is settled. Returns how many are still to be answered, or an
 * error after which it may be called again. */
int requests_step(struct requests *requests);
const char *requests_error(const struct requests *requests);

#endif

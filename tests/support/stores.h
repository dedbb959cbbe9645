/* SPDX-License-Identifier: BSD-3-Clause */
/* Every kind of store, for tests that each of them has to pass. */
#ifndef APC_TEST_STORES_H
#define APC_TEST_STORES_H

#include "apcstore.h"
#include "check.h"

/** That the tests are running for. */
struct store_kind {
    const char *name;
    void (*uri)(char *text, size_t size, int number); /* of a store that does not exist yet */
    void (*made)(int number);                         /* NULL: nothing to do */
    bool (*empty)(int number); /* after its test: as new for the next. NULL, false: that takes another */
    bool spooled;              /* and a spool before it, which stays empty */
};
extern const struct store_kind *store_kind;
/** Go on to the next kind, of those whose name begins as APC_TEST_STORE says, or of all. False: there is
 * none. */
bool stores_next(void);

/** Of the store of the running test, which stores_open() opens once more. */
extern char store_uri[512];
struct apc_store *stores_open(void);
/** A setup and a teardown: *@p state is a new, empty store. */
int stores_set_up(void **state);
int stores_tear_down(void **state);
#define T(test) cmocka_unit_test_setup_teardown(test, stores_set_up, stores_tear_down)

#define ok(store, call)                                                                                      \
    do {                                                                                                     \
        int ok_result = (call);                                                                              \
        if (ok_result < 0) {                                                                                 \
            fail_msg("%s: %s: %s", #call, apc_err_name(ok_result), apc_store_error(store));                  \
        }                                                                                                    \
    } while (0)

/** At 1000 seq microseconds. */
struct apc_sample sample(enum apc_table table, int id, int64_t seq, double value);
struct apc_sample newest(struct apc_store *store, enum apc_table table, int id);

#endif

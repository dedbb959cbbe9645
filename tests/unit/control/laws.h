/* SPDX-License-Identifier: BSD-3-Clause */
/* A law as a controller runs it, asked with as little as a test cares about. */
#ifndef APC_TESTS_LAWS_H
#define APC_TESTS_LAWS_H

#include "check.h"

#include "control/control_internal.h"

#define LAWS_KEPT 64
#define LAWS_WIDE 16

static struct apc_instances *laws_kept[LAWS_KEPT];
static size_t laws_n_kept;

/* Teardown of a test: end the instances that it made. */
static inline int laws_end(void **state)
{
    (void)state;
    while (laws_n_kept > 0)
        apc_instances_destroy(laws_kept[--laws_n_kept]);
    return 0;
}

/* As apc_instances_create(), which says nothing unless it fails; they end after the test has returned: the
 * law must not lie on its stack. */
static inline int laws_make(struct apc_instances **made, const struct apc_law *law,
                            const struct apc_law_setup *setup, struct apc_error *why)
{
    struct apc_error said = {""};
    int rc = apc_instances_create(made, law, setup, &said);

    if (rc >= 0 && said.text[0])
        fail_msg("law %s is made, and says \"%s\"", law->name, said.text);
    if (rc < 0 && why)
        *why = said;
    if (laws_n_kept == LAWS_KEPT)
        fail_msg("more than %d laws in a test", LAWS_KEPT);
    laws_kept[laws_n_kept] = *made;
    laws_n_kept += *made != NULL;
    return rc;
}

/* What the test left out: all measurements good, the last output not known. */
static inline struct apc_law_call laws_call(const struct apc_law_call *call, enum apc_law_output who)
{
    static const apc_status good[LAWS_WIDE];
    static enum apc_law_output out[LAWS_WIDE];
    static double last[LAWS_WIDE];
    struct apc_law_call c = *call;

    for (size_t i = 0; i < LAWS_WIDE; i++) {
        out[i] = who;
        last[i] = (double)NAN;
    }
    c.y_status = c.y_status ? c.y_status : good;
    c.out = c.out ? c.out : out;
    c.u_last = c.u_last ? c.u_last : last;
    c.n_ahead = c.n_ahead ? c.n_ahead : 1;
    return c;
}

static inline void laws_reset(struct apc_instances *s, const struct apc_law_call *call)
{
    const struct apc_law_call c = laws_call(call, APC_OUT_GIVEN);

    for (size_t k = 0; k < apc_instances_size(s).instances; k++)
        apc_instances_reset(s, k, &c);
}

static inline void laws_compute(struct apc_instances *s, const struct apc_law_call *call)
{
    const struct apc_law_call c = laws_call(call, APC_OUT_LAW);

    for (size_t i = 0; i < c.dim.nu; i++)
        c.limited[i] = 0;
    for (size_t k = 0; k < apc_instances_size(s).instances; k++)
        assert_int_equal(apc_instances_compute(s, k, &c), APC_LAW_GOOD);
}

/* Nothing holds back what takes u. */
static inline void laws_update(struct apc_instances *s, const struct apc_law_call *call)
{
    unsigned held[LAWS_WIDE] = {0};
    struct apc_law_call c = laws_call(call, APC_OUT_LAW);

    c.limited = held;
    for (size_t k = 0; k < apc_instances_size(s).instances; k++)
        apc_instances_update(s, k, &c);
}

static inline void laws_track(struct apc_instances *s, const struct apc_law_call *call)
{
    unsigned held[LAWS_WIDE] = {0};
    struct apc_law_call c = laws_call(call, APC_OUT_GIVEN);

    c.limited = held;
    for (size_t k = 0; k < apc_instances_size(s).instances; k++)
        apc_instances_track(s, k, &c);
}

/* A setting of numbers: a matrix of n rows, or one row. */
#define ROWS(name_, n, ...)                                                                                  \
    {                                                                                                        \
        .name = (name_), .rows = (n),                                                                        \
        .columns = sizeof((const double[]){__VA_ARGS__}) / sizeof(double) / (n), .value = (const double[])   \
        {                                                                                                    \
            __VA_ARGS__                                                                                      \
        }                                                                                                    \
    }
#define ROW(name_, ...) ROWS(name_, 1, __VA_ARGS__)

#endif

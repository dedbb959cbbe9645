/* SPDX-License-Identifier: BSD-3-Clause */
/* A simulation under test: run it on, and look at what is in its store. */
#ifndef APC_TEST_SIMULATED_H
#define APC_TEST_SIMULATED_H

#include "check.h"

#include <apcrun.h>
#include <apcstore.h>

static inline void run(struct apc_simulation *s, double until)
{
    if (apc_simulation_run(s, until) < 0)
        fail_msg("%s", apc_simulation_error(s));
}

static inline struct apc_sample newest(struct apc_simulation *s, enum apc_table table, int id)
{
    struct apc_sample row = {.table = table, .id = id};
    assert_int_equal(apc_store_read(apc_simulation_store(s), &row, 1), 0);
    return row;
}

static inline enum apc_mode mode_of(struct apc_simulation *s, int loop)
{
    return (enum apc_mode)newest(s, APC_ACTUAL, apc_variable_number(APC_OPMODE, loop)).value;
}

#endif

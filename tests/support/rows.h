/* SPDX-License-Identifier: BSD-3-Clause */
/* Rows that a controller reads, or wrote at its last tick. */
#ifndef APC_TEST_ROWS_H
#define APC_TEST_ROWS_H

#include "apcmodules.h"

#include <stdlib.h>

/* That of a variable; NULL: there is none. */
static inline struct apc_sample *rows_find(const struct apc_rows *rows, enum apc_table table, int id)
{
    for (size_t i = 0; i < rows->n_samples; i++) {
        if (rows->sample[i].table == table && rows->sample[i].id == id)
            return &rows->sample[i];
    }
    return NULL;
}

/* The same, of one that must be there. */
static inline struct apc_sample *rows_at(const struct apc_rows *rows, enum apc_table table, int id)
{
    struct apc_sample *s = rows_find(rows, table, id);

    if (!s)
        abort();
    return s;
}

/* The next row of a variable that is read. */
static inline void rows_feed(const struct apc_rows *rows, enum apc_table table, int id, double value,
                             apc_ns time)
{
    struct apc_sample *s = rows_at(rows, table, id);

    s->value = value;
    s->seq++;
    s->time = time;
    s->status = APC_GOOD;
}

#endif

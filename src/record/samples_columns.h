/* SPDX-License-Identifier: BSD-3-Clause */
/* The rows of samples.csv and operation.csv as columns, for who wants all of them at once; and
 * samples.columns, where those of samples.csv lie as the numbers that they are (docs/run-folder.md). Python
 * takes this header as it stands, without its directives. */
#ifndef APC_SAMPLES_COLUMNS_H
#define APC_SAMPLES_COLUMNS_H

#include <apcstore.h>

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#define SAMPLES_PARTS 8 /* threads that read a file, at most */

/* Rows name their variable and status by their place among those that came. */
struct apc_samples {
    size_t n, room;
    double *time;      /* [n] s since the run's t = 0 */
    int32_t *variable; /* [n] place in table and id */
    int8_t *status;    /* [n] place in code */
    double *value;     /* [n] */
    size_t n_variables, n_codes, slots;
    int32_t *table, *id; /* [n_variables] */
    int32_t *slot;       /* [slots] where they are found: 1 + place, 0: free */
    uint32_t code[127];  /* [n_codes] */
};
/* The rows of @p csv into @p rows, which is empty; from @p columns (NULL: none) where that is whole and was
 * made of this very file. Returns 0, or a negative enum apc_err with FILE:LINE in @p why. */
int apc_samples_read(struct apc_samples *rows, const char *csv, const char *columns, struct apc_error *why);
/* Give back what a struct apc_samples of malloc() holds, and itself. */
void apc_samples_free(struct apc_samples *rows);
/* Make @p columns of @p csv. What cannot be is left out, as nobody depends on it: there is no file then. */
void apc_samples_keep(const char *csv, const char *columns);
/* to[i] = of[variable[i]] of the first @p n rows from @p first on, in elements of @p size bytes, 1 or 4. */
void apc_samples_spread(const struct apc_samples *rows, size_t first, size_t n, const void *of, size_t size,
                        void *to);
/* The times of all rows in ns of Unix time, of a run whose t = 0 was at @p start, to the microsecond. */
void apc_samples_times(const struct apc_samples *rows, int64_t start, int64_t *to);

int samples_csv_read(struct apc_samples *rows, const char *file, struct apc_error *why);
size_t samples_parts(size_t size); /* as many as there are processors for, and each worth a thread */
void samples_forget(struct apc_samples *rows);

#endif

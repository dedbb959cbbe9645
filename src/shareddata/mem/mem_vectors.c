/* SPDX-License-Identifier: BSD-3-Clause */
/*
 * The store in memory: rows of vectors, and of both kinds together. A variable's vectors are an array of
 * heads in rising seq beside one of elements, which stand in the order in which they came.
 */
#include <limits.h>
#include <stdlib.h>
#include <string.h>

#include "shareddata/mem/mem.h"

/* ---- Read ---------------------------------------------------------------------------------- */

static void give_mem_vector(const struct variable *v, const struct mem_vector *row, struct apc_vector *out)
{
    out->seq = row->seq;
    out->time = row->time;
    out->status = row->status;
    out->n = row->n;
    const uint32_t n = row->n < out->room ? row->n : out->room;
    if (n > 0) {
        memcpy(out->value, v->value + row->at, n * sizeof *out->value);
    }
}

int apc_mem_read_rows(struct apc_store *store, struct apc_rows *rows)
{
    struct memory *m = apc_mem_of(store)->memory;
    int err = apc_mem_begin(store);
    if (err) {
        return err;
    }
    for (size_t i = 0; i < rows->n_samples; i++) {
        apc_mem_newest(m, &rows->sample[i]);
    }
    for (size_t i = 0; i < rows->n_vectors; i++) {
        struct apc_vector *out = &rows->vector[i];
        const struct variable *v = apc_mem_find(m, out->table, out->id);
        if (v && v->n > 0) {
            give_mem_vector(v, &v->vector[v->n - 1], out);
        } else {
            out->seq = out->time = 0;
            out->n = 0;
            out->status = APC_BAD_NO_DATA;
        }
    }
    apc_mem_end(store);
    return 0;
}

/* ---- Write --------------------------------------------------------------------------------- */

static int reserve_vectors(struct apc_store *store, const struct apc_vector *vectors, size_t n)
{
    const uint64_t reservation = ++apc_mem_of(store)->memory->reservations;
    struct variable *v = NULL;
    int err = 0;
    for (size_t i = 0; !err && i < n; i++) {
        err = apc_mem_find_or_add(store, vectors[i].table, vectors[i].id, &v);
        if (!err) {
            apc_mem_want(v, reservation, vectors[i].n);
            err = apc_mem_grow(store, (void **)&v->vector, &v->capacity, v->n, v->want, sizeof *v->vector);
        }
        if (!err) {
            err = apc_mem_grow(store, (void **)&v->value, &v->values_capacity, v->n_values, v->want_values,
                               sizeof *v->value);
        }
    }
    return err;
}

/* There is room. Returns whether the seq was free. */
static bool insert_vector(struct memory *m, const struct apc_vector *in)
{
    struct variable *v = apc_mem_find(m, in->table, in->id);
    const size_t at = apc_mem_lower_bound(v, in->seq);
    if (at < v->n && v->vector[at].seq == in->seq) {
        return false;
    }
    memmove(&v->vector[at + 1], &v->vector[at], (v->n - at) * sizeof *v->vector);
    v->vector[at] = (struct mem_vector){.seq = in->seq,
                                        .time = apc_time_stored(in->time),
                                        .status = in->status,
                                        .n = in->n,
                                        .at = v->n_values};
    if (in->n > 0) {
        memcpy(v->value + v->n_values, in->value, in->n * sizeof *in->value);
    }
    v->n_values += in->n;
    v->n++;
    return true;
}

int apc_mem_append_rows(struct apc_store *store, const struct apc_rows *rows)
{
    struct memory *m = apc_mem_of(store)->memory;
    int err = apc_rows_check(store, rows->sample, rows->n_samples), count = 0;
    if (!err) {
        err = apc_vectors_check(store, rows->vector, rows->n_vectors);
    }
    if (!err) {
        err = apc_mem_begin(store);
    }
    if (err) {
        return err;
    }
    err = apc_mem_reserve(store, rows->sample, rows->n_samples);
    if (!err) {
        err = apc_mem_reserve_loops(store);
    }
    if (!err) {
        err = reserve_vectors(store, rows->vector, rows->n_vectors);
    }
    for (size_t i = 0; !err && i < rows->n_samples; i++) {
        struct apc_sample *s = &rows->sample[i];
        if (apc_rows_next(s, apc_mem_newest_seq(m, s->table, s->id))) {
            count += apc_mem_insert(m, s);
            apc_mem_insert_loops(store, s);
        }
    }
    for (size_t i = 0; !err && i < rows->n_vectors; i++) {
        count += insert_vector(m, &rows->vector[i]);
    }
    apc_mem_wake(m);
    apc_mem_end(store);
    return err ? err : count;
}

/* ---- History --------------------------------------------------------------------------------- */

/* A copy of the first row from *@p next on; its values are @p out's, which grow. */
static int copy_next(struct apc_store *store, const struct variable *v, const struct apc_range *range,
                     int64_t *next, int64_t last, struct apc_vector *out, size_t *room)
{
    size_t i = apc_mem_lower_bound(v, *next);
    while (i < v->n && v->vector[i].seq <= last && !apc_mem_within(range, v->vector[i].time)) {
        i++;
    }
    if (i == v->n || v->vector[i].seq > last) {
        return 0;
    }
    const struct mem_vector *row = &v->vector[i];
    int err = apc_mem_grow(store, (void **)&out->value, room, 0, row->n, sizeof *out->value);
    if (err) {
        return err;
    }
    out->room = row->n;
    give_mem_vector(v, row, out);
    *next = row->seq + 1;
    return 1;
}

int apc_mem_vectors(struct apc_store *store, enum apc_table table, int id, const struct apc_range *range,
                    apc_vector_fn fn, void *ctx)
{
    struct memory *m = apc_mem_of(store)->memory;
    struct apc_vector row = {.table = table, .id = id};
    int64_t next = -1, last = 0;
    size_t room = 0;
    int count = 0, there = 1;
    while (there > 0) {
        there = apc_mem_begin(store);
        if (there < 0) {
            break;
        }
        const struct variable *v = apc_mem_find(m, table, id);
        if (v && next < 0) {
            next = apc_mem_first_seq(v, range);
            last = apc_mem_newest_seq(m, table, id);
        }
        there = v ? copy_next(store, v, range, &next, last, &row, &room) : 0;
        apc_mem_end(store);
        if (there > 0) {
            count += count < INT_MAX;
            store->streaming = true;
            there = fn(ctx, &row) == 0;
            store->streaming = false;
        }
    }
    free(row.value);
    return there < 0 ? there : count;
}

/* ---- Housekeeping ---------------------------------------------------------------------------- */

/* Give back the elements of rows that have gone; without memory for it they stay for now. */
static void compact_elements(struct variable *v)
{
    size_t n = 0;
    for (size_t i = 0; i < v->n; i++) {
        n += v->vector[i].n;
    }
    double *value = (double *)malloc((n > 0 ? n : 1) * sizeof *value);
    if (!value) {
        return;
    }
    v->n_values = 0;
    for (size_t i = 0; i < v->n; i++) {
        struct mem_vector *row = &v->vector[i];
        if (row->n > 0) {
            memcpy(value + v->n_values, v->value + row->at, row->n * sizeof *value);
        }
        row->at = v->n_values;
        v->n_values += row->n;
    }
    free(v->value);
    v->value = value;
    v->values_capacity = n > 0 ? n : 1;
}

int apc_mem_drop_vectors(struct variable *v, apc_ns before)
{
    size_t kept = 0;
    const size_t n = v->n;
    for (size_t i = 0; i < n; i++) {
        if (v->vector[i].time >= before || i + 1 == n) {
            v->vector[kept++] = v->vector[i];
        }
    }
    v->n = kept;
    if (kept < n) {
        compact_elements(v);
    }
    return (int)(n - kept);
}

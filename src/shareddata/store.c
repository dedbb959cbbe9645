/* SPDX-License-Identifier: BSD-3-Clause */
/* The public face of a store: arguments are checked here, once for all kinds of store. */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "base/base_internal.h"
#include "base/text.h"
#include "shareddata/migrations.h"
#include "shareddata/shareddata_internal.h"

void apc_store_close(struct apc_store *store)
{
    if (store) {
        free(store->seq);
        free(store->loop);
        store->ops->close(store);
    }
}

const char *apc_store_error(const struct apc_store *store)
{
    return store ? store->why.text : "no store";
}

bool apc_store_connected(const struct apc_store *store)
{
    return store &&
           (store->ops->connected ? store->ops->connected(store) : apc_store_connected(store->inner));
}

apc_ns apc_store_now(const struct apc_store *store)
{
    return store && store->instant != 0 ? store->instant : apc_clock_utc(NULL);
}

void apc_store_stats(const struct apc_store *store, struct apc_store_stats *stats)
{
    struct apc_store_stats all = {.size = 0};
    if (store && store->ops->stats) {
        store->ops->stats(store, &all);
    } else if (store && store->inner) {
        all.size = sizeof all;
        apc_store_stats(store->inner, &all);
    } else if (store) {
        all = store->stats;
    }
    apc_result_copy(stats, &all, sizeof all);
}

int apc_store_version(void)
{
    int version = 0;
    for (int i = 0; i < apc_migration_count; i++) {
        version = apc_migrations[i].repair ? version : apc_migrations[i].number;
    }
    return version;
}

int apc_store_tables_version(const struct apc_store *store)
{
    return store && store->inner         ? apc_store_tables_version(store->inner)
           : !apc_store_connected(store) ? 0
           : store->ops->version         ? store->ops->version(store)
                                         : apc_store_version();
}

int apc_store_passed(struct apc_store *store, int rc, apc_ns began)
{
    store->why = store->inner->why;
    return store->ops->answered ? store->ops->answered(store, rc, began) : rc;
}

/* ---- Checks ------------------------------------------------------------------------------- */

int apc_store_enter(struct apc_store *store, const void *array, size_t n)
{
    if (!store) {
        return APC_EINVAL;
    }
    store->why.text[0] = '\0';
    if (store->streaming) {
        return apc_fail(&store->why, APC_ESTATE,
                        "a store may not be used from inside its own history function");
    }
    if (n > APC_STORE_SAMPLES_MAX) {
        return apc_fail(&store->why, APC_EINVAL, "%zu at once are too many: at most %zu", n,
                        APC_STORE_SAMPLES_MAX);
    }
    if (n > 0 && !array) {
        return apc_fail(&store->why, APC_EINVAL, "%zu expected, but the array is NULL", n);
    }
    return 0;
}

int apc_store_enter_change(struct apc_store *store, const void *array, size_t n)
{
    char time[APC_TIME_LEN];
    const int err = apc_store_enter(store, array, n);
    return err || store->instant == 0
               ? err
               : apc_fail(&store->why, APC_EPERM, "this is the plant as of %s: the past cannot be changed",
                          apc_time_format(store->instant, time));
}

int apc_store_check_variable(struct apc_store *store, enum apc_table table, int id)
{
    if (!apc_table_known(table)) {
        return apc_fail(&store->why, APC_EINVAL, "%d is no table", (int)table);
    }
    if (id < 0) {
        return apc_fail(&store->why, APC_EINVAL, "%s %d: an id must not be negative", apc_table_name(table),
                        id);
    }
    return 0;
}

static int wrong_kind(struct apc_store *store, enum apc_table table, int id, bool vectors)
{
    int err = apc_store_check_variable(store, table, id);
    return err ? err
               : apc_fail(&store->why, APC_EINVAL, "%s %d: the rows of this table are %s",
                          apc_table_name(table), id, vectors ? "samples" : "vectors");
}

/* The tables whose rows are samples, or else vectors, each a bit. */
static uint32_t tables_of(bool vectors)
{
    const uint32_t of_vectors = 1u << APC_TICK | 1u << APC_PLAN | 1u << APC_PREDICTION;
    return (vectors ? of_vectors : ~of_vectors) & ((1u << APC_TABLE_END) - 2);
}

/* It is asked for every row, so it is made to be quick. */
static inline bool is_in_tables(uint32_t tables, enum apc_table table, int id)
{
    return (unsigned)table < 32 && (tables >> table & 1) && id >= 0;
}

static int check_kind(struct apc_store *store, enum apc_table table, int id, bool vectors)
{
    return is_in_tables(tables_of(vectors), table, id) ? 0 : wrong_kind(store, table, id, vectors);
}

static int check_variable_names(struct apc_store *store, const struct apc_sample *samples, size_t n)
{
    const uint32_t tables = tables_of(false);
    for (size_t i = 0; i < n; i++) {
        if (!is_in_tables(tables, samples[i].table, samples[i].id)) {
            return wrong_kind(store, samples[i].table, samples[i].id, false);
        }
    }
    return 0;
}

static int check_value(struct apc_store *store, const struct apc_sample *s)
{
    int err = check_kind(store, s->table, s->id, false);
    if (err) {
        return err;
    }
    if (!(fabs(s->value) < APC_VALUE_MAX)) {
        return apc_fail(&store->why, APC_EINVAL, "%s %d: value %g is not finite or not below 1e300",
                        apc_table_name(s->table), s->id, s->value);
    }
    return 0;
}

static int wrong_sample(struct apc_store *store, const struct apc_sample *s)
{
    int err = check_value(store, s);
    return err ? err
               : apc_fail(&store->why, APC_EINVAL, "%s %d: seq counts from 1", apc_table_name(s->table),
                          s->id);
}

static int check_samples(struct apc_store *store, const struct apc_sample *samples, size_t n)
{
    const uint32_t tables = tables_of(false);
    for (size_t i = 0; i < n; i++) {
        const struct apc_sample *s = &samples[i];
        if (!is_in_tables(tables, s->table, s->id) || !(fabs(s->value) < APC_VALUE_MAX) || s->seq <= 0 ||
            s->origin < 0) {
            return wrong_sample(store, s);
        }
    }
    return 0;
}

int apc_store_check_range(struct apc_store *store, const struct apc_range *range, bool has_fn)
{
    if (!has_fn) {
        return apc_fail(&store->why, APC_EINVAL, "no function to give the rows to");
    }
    if (range && range->last > INT64_MAX) {
        return apc_fail(&store->why, APC_EINVAL, "the newest %zu rows are too many", range->last);
    }
    if (range && range->after < 0) {
        return apc_fail(&store->why, APC_EINVAL, "rows are counted from 1");
    }
    return 0;
}

/* ---- Operations --------------------------------------------------------------------------- */

int apc_store_connect(struct apc_store *store)
{
    APC_STORE_PASS(store, connect, apc_store_connect(inner));
    int err = apc_store_enter(store, NULL, 0);
    return err ? err : store->ops->connect(store);
}

int apc_store_read(struct apc_store *store, struct apc_sample *samples, size_t n)
{
    APC_STORE_PASS(store, read, apc_store_read(inner, samples, n));
    int err = apc_store_enter(store, samples, n);
    if (!err) {
        err = check_variable_names(store, samples, n);
    }
    return err || n == 0 ? err : store->ops->read(store, samples, n);
}

int apc_store_append(struct apc_store *store, const struct apc_sample *samples, size_t n)
{
    APC_STORE_PASS(store, append, apc_store_append(inner, samples, n));
    int err = apc_store_enter_change(store, samples, n);
    if (!err) {
        err = check_samples(store, samples, n);
    }
    return err || n == 0 ? err : store->ops->append(store, samples, n);
}

/* A set that is the first ids of a table, as those who have one writer a table claim it. */
int apc_store_claim(struct apc_store *store, enum apc_table table, size_t n, int64_t *last)
{
    APC_STORE_PASS(store, claim_set, apc_store_claim(inner, table, n, last));
    int err = apc_store_enter_change(store, last, n);
    if (!err) {
        err = apc_store_check_variable(store, table, 0);
    }
    if (err) {
        return err;
    }
    struct apc_sample *variables = (struct apc_sample *)calloc(n ? n : 1, sizeof *variables);
    if (!variables) {
        return apc_fail(&store->why, APC_ENOMEM, "out of memory for a claim of %zu", n);
    }
    for (size_t i = 0; i < n; i++) {
        variables[i] = (struct apc_sample){.table = table, .id = (int)i + 1};
    }
    err = n > 0 ? store->ops->claim_set(store, variables, n) : 0;
    for (size_t i = 0; !err && i < n; i++) {
        last[i] = variables[i].seq;
    }
    free(variables);
    return err;
}

static int check_set(struct apc_store *store, const struct apc_sample *variables, size_t n)
{
    int err = apc_store_enter_change(store, variables, n);
    for (size_t i = 0; !err && i < n; i++) {
        err = apc_store_check_variable(store, variables[i].table, variables[i].id);
    }
    return err;
}

int apc_store_claim_set(struct apc_store *store, struct apc_sample *variables, size_t n)
{
    APC_STORE_PASS(store, claim_set, apc_store_claim_set(inner, variables, n));
    int err = check_set(store, variables, n);
    if (err || n == 0) {
        return err;
    }
    return store->ops->claim_set(store, variables, n);
}

int apc_store_release(struct apc_store *store, const struct apc_sample *variables, size_t n)
{
    APC_STORE_PASS(store, release, apc_store_release(inner, variables, n));
    int err = check_set(store, variables, n);
    if (err || n == 0) {
        return err;
    }
    return store->ops->release(store, variables, n);
}

static int check_numbered(struct apc_store *store)
{
    return store->ops->holder ? 0
                              : apc_fail(&store->why, APC_EINVAL,
                                         "%s numbers no claims: nobody can take over from one who lives; "
                                         "shm: and postgresql: do",
                                         store->ops->scheme);
}

int apc_store_holder(struct apc_store *store, const struct apc_sample *variable, uint64_t *holder)
{
    int err = check_set(store, variable, 1);
    if (!err && !holder) {
        err = apc_fail(&store->why, APC_EINVAL, "no place for the number");
    }
    if (!err) {
        err = check_numbered(store);
    }
    return err ? err : store->ops->holder(store, variable, holder);
}

uint64_t apc_store_claimed(const struct apc_store *store)
{
    return store->inner ? apc_store_claimed(store->inner) : store->claim;
}

int apc_store_seize(struct apc_store *store, struct apc_sample *variables, size_t n, uint64_t holder)
{
    int err = check_set(store, variables, n);
    if (!err) {
        err = check_numbered(store);
    }
    return err || n == 0 ? err : store->ops->seize(store, variables, n, holder);
}

#define PUT_MAX 4096 /* people's values are few: each is compared with each */

static int check_put(struct apc_store *store, const struct apc_sample *samples, size_t n)
{
    int err = apc_store_enter_change(store, samples, n);
    if (!err && n > PUT_MAX) {
        err = apc_fail(&store->why, APC_EINVAL, "%zu values at once are too many: at most %d", n, PUT_MAX);
    }
    for (size_t i = 0; !err && i < n; i++) {
        err = check_value(store, &samples[i]);
        for (size_t j = 0; !err && j < i; j++) {
            if (samples[i].table == samples[j].table && samples[i].id == samples[j].id) {
                err = apc_fail(&store->why, APC_EINVAL, "%s %d is given twice",
                               apc_table_name(samples[i].table), samples[i].id);
            }
        }
    }
    return err;
}

static bool is_among_samples(const struct apc_sample *samples, size_t n, int loop)
{
    for (size_t i = 0; i < n; i++) {
        if (samples[i].table == APC_OPMODE && samples[i].id == loop) {
            return true;
        }
    }
    return false;
}

/* The loops that these samples' mode of all is for: those that have tags, and are not named themselves. */
static int find_loops(struct apc_store *store, const struct apc_sample *samples, size_t n)
{
    size_t i = 0;
    store->n_loops = 0;
    while (i < n && !apc_is_of_all(&samples[i])) {
        i++;
    }
    const int most = i < n && !store->ops->spreads ? store->ops->get_tags(store, NULL, 0) : 0;
    if (most <= 0) {
        return most;
    }
    struct apc_tag *tag = (struct apc_tag *)calloc((size_t)most, sizeof *tag);
    struct apc_sample *loop = (struct apc_sample *)realloc(store->loop, (size_t)most * sizeof *loop);
    store->loop = loop ? loop : store->loop;
    int there = tag && loop ? store->ops->get_tags(store, tag, (size_t)most)
                            : apc_fail(&store->why, APC_ENOMEM, "out of memory for %d tags", most);
    for (int k = 0; k < there && k < most; k++) {
        if (tag[k].table == APC_OPMODE && tag[k].id > 0 && tag[k].id < 65536 && tag[k].controller[0] &&
            !is_among_samples(samples, n, tag[k].id)) {
            loop[store->n_loops++] = (struct apc_sample){.table = APC_OPMODE, .id = tag[k].id};
        }
    }
    free(tag);
    return there < 0 ? there : 0;
}

int apc_store_put(struct apc_store *store, struct apc_sample *samples, size_t n)
{
    APC_STORE_PASS(store, put, apc_store_put(inner, samples, n));
    int err = check_put(store, samples, n);
    if (!err) {
        err = find_loops(store, samples, n);
    }
    return err || n == 0 ? err : store->ops->put(store, samples, n);
}

int apc_store_author(struct apc_store *store, const char *name)
{
    APC_STORE_PASS(store, author, apc_store_author(inner, name));
    char clean[APC_AUTHOR_LEN];
    int err = apc_store_enter_change(store, name, 1);
    if (!err && (name[0] == '\0' || strnlen(name, sizeof clean) == sizeof clean)) {
        err = apc_fail(&store->why, APC_EINVAL, "an author's name has 1 to %d bytes", APC_AUTHOR_LEN - 1);
    }
    return err ? err : store->ops->author(store, text_clean(clean, name, sizeof clean));
}

int apc_store_author_name(struct apc_store *store, uint32_t number, char name[APC_AUTHOR_LEN])
{
    APC_STORE_PASS(store, author_name, apc_store_author_name(inner, number, name));
    int err = apc_store_enter(store, name, 1);
    if (err) {
        return err;
    }
    memset(name, 0, APC_AUTHOR_LEN);
    err = number > 0 ? store->ops->author_name(store, number, name) : APC_ENOTFOUND;
    text_clean(name, name, APC_AUTHOR_LEN);
    return err == APC_ENOTFOUND ? apc_fail(&store->why, err, "there is no author %u", (unsigned)number) : err;
}

int apc_store_swap(struct apc_store *store, struct apc_sample *samples, size_t n)
{
    APC_STORE_PASS(store, swap, apc_store_swap(inner, samples, n));
    int err = check_put(store, samples, n);
    for (size_t i = 0; !err && i < n; i++) {
        if (samples[i].seq < 0) {
            err = apc_fail(&store->why, APC_EINVAL, "%s %d: seq counts from 1",
                           apc_table_name(samples[i].table), samples[i].id);
        }
    }
    if (!err) {
        err = find_loops(store, samples, n);
    }
    return err || n == 0 ? err : store->ops->swap(store, samples, n);
}

/* ---- Rows: samples and vectors together ----------------------------------------------------- */

static int enter_rows(struct apc_store *store, const struct apc_rows *rows)
{
    if (!rows) {
        return apc_store_enter(store, NULL, 1);
    }
    int err = apc_store_enter(store, NULL, 0);
    if (!err && rows->size != sizeof *rows) {
        err = apc_fail(&store->why, APC_EINVAL, "struct apc_rows must say its size, %zu bytes", sizeof *rows);
    }
    if (!err) {
        err = apc_store_enter(store, rows->sample, rows->n_samples);
    }
    return err ? err : apc_store_enter(store, rows->vector, rows->n_vectors);
}

int apc_store_read_rows(struct apc_store *store, struct apc_rows *rows)
{
    APC_STORE_PASS(store, read_rows, apc_store_read_rows(inner, rows));
    int err = enter_rows(store, rows);
    if (!err) {
        err = check_variable_names(store, rows->sample, rows->n_samples);
    }
    for (size_t i = 0; !err && i < rows->n_vectors; i++) {
        const struct apc_vector *v = &rows->vector[i];
        err = check_kind(store, v->table, v->id, true);
        if (!err && v->room > 0 && !v->value) {
            err = apc_fail(&store->why, APC_EINVAL, "%s %d: its values are NULL", apc_table_name(v->table),
                           v->id);
        }
    }
    if (err || rows->n_samples + rows->n_vectors == 0) {
        return err;
    }
    return store->ops->read_rows(store, rows);
}

static int check_vector(struct apc_store *store, const struct apc_vector *v)
{
    const char *name = apc_table_name(v->table);
    int err = check_kind(store, v->table, v->id, true);
    if (err) {
        return err;
    }
    if (v->seq <= 0) {
        return apc_fail(&store->why, APC_EINVAL, "%s %d: seq counts from 1", name, v->id);
    }
    if (v->n > APC_ELEMENTS_MAX || (v->n > 0 && !v->value)) {
        return apc_fail(&store->why, APC_EINVAL, "%s %d: its %u values are missing or more than %d", name,
                        v->id, v->n, APC_ELEMENTS_MAX);
    }
    for (uint32_t i = 0; i < v->n; i++) {
        if (!(fabs(v->value[i]) < APC_VALUE_MAX)) {
            return apc_fail(&store->why, APC_EINVAL,
                            "%s %d: element %u, %g, is not finite or not below 1e300", name, v->id, i,
                            v->value[i]);
        }
    }
    return 0;
}

/* Where a row has one writer its seq is that of the row; else it is the newest that the writer knows. */
static int check_row(struct apc_store *store, const struct apc_sample *s)
{
    if (!apc_table_shared(s->table)) {
        return check_samples(store, s, 1);
    }
    int err = check_value(store, s);
    if (!err && (s->seq < APC_SEQ_ANY || s->origin < 0)) {
        err = apc_fail(&store->why, APC_EINVAL, "%s %d: seq counts from 1", apc_table_name(s->table), s->id);
    }
    return err;
}

/* An append that fails leaves the caller's seqs as they were. */
static int keep_seqs(struct apc_store *store, const struct apc_rows *rows)
{
    if (rows->n_samples > store->n_seq) {
        int64_t *seq = (int64_t *)realloc(store->seq, rows->n_samples * sizeof *seq);
        if (!seq) {
            return apc_fail(&store->why, APC_ENOMEM, "out of memory for %zu rows", rows->n_samples);
        }
        store->seq = seq;
        store->n_seq = rows->n_samples;
    }
    for (size_t i = 0; i < rows->n_samples; i++) {
        store->seq[i] = rows->sample[i].seq;
    }
    return 0;
}

int apc_store_append_rows(struct apc_store *store, const struct apc_rows *rows)
{
    APC_STORE_PASS(store, append_rows, apc_store_append_rows(inner, rows));
    int err = apc_store_enter_change(store, NULL, 0);
    if (!err) {
        err = enter_rows(store, rows);
    }
    for (size_t i = 0; !err && i < rows->n_samples; i++) {
        err = check_row(store, &rows->sample[i]);
    }
    for (size_t i = 0; !err && i < rows->n_vectors; i++) {
        err = check_vector(store, &rows->vector[i]);
    }
    if (err || rows->n_samples + rows->n_vectors == 0) {
        return err;
    }
    err = keep_seqs(store, rows);
    if (!err) {
        err = find_loops(store, rows->sample, rows->n_samples);
    }
    int count = err ? err : store->ops->append_rows(store, rows);
    for (size_t i = 0; !err && count < 0 && i < rows->n_samples; i++) {
        rows->sample[i].seq = store->seq[i];
    }
    return count;
}

int apc_store_vectors(struct apc_store *store, enum apc_table table, int id, const struct apc_range *range,
                      apc_vector_fn fn, void *ctx)
{
    APC_STORE_PASS(store, vectors, apc_store_vectors(inner, table, id, range, fn, ctx));
    int err = apc_store_enter(store, NULL, 0);
    if (!err) {
        err = check_kind(store, table, id, true);
    }
    if (!err) {
        err = apc_store_check_range(store, range, fn != NULL);
    }
    return err ? err : store->ops->vectors(store, table, id, range ? range : &(struct apc_range){0}, fn, ctx);
}

int apc_store_wait(struct apc_store *store, const struct apc_sample *seen, size_t n, apc_ns timeout)
{
    APC_STORE_PASS(store, wait, apc_store_wait(inner, seen, n, timeout));
    int err = apc_store_enter_change(store, seen, n);
    for (size_t i = 0; !err && i < n; i++) {
        err = apc_store_check_variable(store, seen[i].table, seen[i].id);
    }
    if (!err && timeout < 0) {
        err = apc_fail(&store->why, APC_EINVAL, "a wait must not be negative");
    }
    return err || n == 0 ? err : store->ops->wait(store, seen, n, timeout);
}

int apc_store_variables(struct apc_store *store, struct apc_sample *variables, size_t capacity)
{
    APC_STORE_PASS(store, variables, apc_store_variables(inner, variables, capacity));
    int err = apc_store_enter(store, variables, capacity);
    return err ? err : store->ops->variables(store, variables, capacity);
}

int apc_store_history(struct apc_store *store, enum apc_table table, int id, const struct apc_range *range,
                      apc_sample_fn fn, void *ctx)
{
    APC_STORE_PASS(store, history, apc_store_history(inner, table, id, range, fn, ctx));
    int err = apc_store_enter(store, NULL, 0);
    if (!err) {
        err = check_kind(store, table, id, false);
    }
    if (!err) {
        err = apc_store_check_range(store, range, fn != NULL);
    }
    return err ? err : store->ops->history(store, table, id, range ? range : &(struct apc_range){0}, fn, ctx);
}

int apc_store_history_bins(struct apc_store *store, enum apc_table table, int id, apc_ns since, apc_ns until,
                           size_t n, apc_history_bin_fn fn, void *ctx)
{
    APC_STORE_PASS(store, history_bins, apc_store_history_bins(inner, table, id, since, until, n, fn, ctx));
    int err = apc_store_enter(store, NULL, 0);
    if (!err) {
        err = check_kind(store, table, id, false);
    }
    if (!err && !fn) {
        err = apc_fail(&store->why, APC_EINVAL, "no function to give the bins to");
    }
    if (!err && (n < 1 || n > APC_HISTORY_BINS)) {
        err = apc_fail(&store->why, APC_EINVAL, "%zu bins: expected 1 to %d", n, APC_HISTORY_BINS);
    }
    if (!err && !(since < until)) {
        err = apc_fail(&store->why, APC_EINVAL, "history must begin before it ends");
    }
    return err ? err : store->ops->history_bins(store, table, id, since, until, n, fn, ctx);
}

int apc_store_init(struct apc_store *store)
{
    APC_STORE_PASS(store, init, apc_store_init(inner));
    int err = apc_store_enter_change(store, NULL, 0);
    return err ? err : store->ops->init(store);
}

int apc_store_maintain(struct apc_store *store, const struct apc_retention *keep)
{
    APC_STORE_PASS(store, maintain, apc_store_maintain(inner, keep));
    struct apc_retention k = {0};
    int err = apc_store_enter_change(store, NULL, 0);
    if (!err) {
        err = apc_options_copy(&k, sizeof k, keep, "apc_retention", &store->why);
    }
    if (!err && (k.samples < 0 || k.events < 0 || k.timing < 0 || k.ticks < 0 || k.packed < 0)) {
        err = apc_fail(&store->why, APC_EINVAL, "a time to keep must not be negative");
    }
    return err ? err : store->ops->maintain(store, &k);
}

int64_t apc_store_forget(struct apc_store *store, apc_ns before)
{
    int err = apc_store_enter(store, NULL, 0);
    if (!err && !store->ops->forget) {
        err = apc_fail(&store->why, APC_EINVAL, "only mem: forgets rows before they are old");
    }
    return err ? err : store->ops->forget(store, before);
}

int apc_store_restore(struct apc_store *store, const char *from, char *kept, size_t size)
{
    int err = apc_store_enter(store, NULL, 0);
    if (!err && (!from || !kept || size < 1)) {
        err = apc_fail(&store->why, APC_EINVAL, "restored from what file?");
    }
    if (!err) {
        kept[0] = '\0';
    }
    if (!err && !store->ops->restore) {
        err = apc_fail(&store->why, APC_EINVAL, "only a file, sqlite:FILE, is restored so");
    }
    return err ? err : store->ops->restore(store, from, kept, size);
}

int apc_store_plants(struct apc_store *store, apc_plant_fn fn, void *ctx)
{
    int err = apc_store_enter(store, NULL, 0);
    if (!err && !fn) {
        err = apc_fail(&store->why, APC_EINVAL, "no function to give the plants to");
    }
    if (!err && !store->ops->plants) {
        err = apc_fail(&store->why, APC_EINVAL, "this store is of one plant: only a database has several");
    }
    return err ? err : store->ops->plants(store, fn, ctx);
}

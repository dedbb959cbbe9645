/* SPDX-License-Identifier: BSD-3-Clause */
/* Rows of samples and vectors, read and written together: what every store must do. */
#include <pthread.h>
#include <stdlib.h>
#include <string.h>

#include "stores.h"

enum { ROOM = 8 };

static struct apc_vector vector(enum apc_table table, int id, int64_t seq, double *value, uint32_t n)
{
    return (struct apc_vector){.table = table,
                               .id = id,
                               .seq = seq,
                               .time = seq % APC_NS_PER_S * APC_NS_PER_MS,
                               .n = n,
                               .room = n,
                               .value = value};
}

static int append_vectors(struct apc_store *store, struct apc_vector *vectors, size_t n)
{
    const struct apc_rows rows = {.size = sizeof rows, .vector = vectors, .n_vectors = n};
    return apc_store_append_rows(store, &rows);
}

static int append_vector(struct apc_store *store, struct apc_vector v)
{
    return append_vectors(store, &v, 1);
}

static int append_samples(struct apc_store *store, struct apc_sample *samples, size_t n)
{
    const struct apc_rows rows = {.size = sizeof rows, .sample = samples, .n_samples = n};
    return apc_store_append_rows(store, &rows);
}

/* The newest one, into @p value. */
static struct apc_vector read_vector(struct apc_store *store, enum apc_table table, int id, double *value,
                                     uint32_t room)
{
    struct apc_vector v = {.table = table, .id = id, .seq = -1, .n = 77, .room = room, .value = value};
    struct apc_rows rows = {.size = sizeof rows, .vector = &v, .n_vectors = 1};
    ok(store, apc_store_read_rows(store, &rows));
    assert_true(v.table == table && v.id == id && v.room == room && v.value == value);
    return v;
}

/* ---- One row --------------------------------------------------------------------------------- */

static void test_a_variable_without_a_row_reads_as_no_data(void **state)
{
    double value[ROOM];
    struct apc_vector v = read_vector(*state, APC_TICK, 3, value, ROOM);
    assert_true(v.seq == 0 && v.n == 0 && v.time == 0 && v.status == APC_BAD_NO_DATA);
}

static void test_samples_and_vectors_come_back_together(void **state)
{
    double tick[6] = {0.0, -0.0, 1.0 / 3.0, 5e-324, nextafter(1e300, 0), -2.5e-308}, plan[2] = {1, 2};
    struct apc_sample s[2] = {sample(APC_ACTUATOR, 1, 7, 0.5), sample(APC_ESTIMATE, 2, 9, -1)};
    struct apc_vector v[2] = {vector(APC_TICK, 1, 4, tick, 6), vector(APC_PLAN, 1, 2, plan, 2)};
    v[0].status = APC_UNCERTAIN;
    v[0].time = INT64_C(1769860800123456000);
    struct apc_rows rows = {.size = sizeof rows, .sample = s, .n_samples = 2, .vector = v, .n_vectors = 2};
    assert_int_equal(apc_store_append_rows(*state, &rows), 4);
    double got[2][ROOM];
    struct apc_sample t[3] = {
        {.table = APC_ESTIMATE, .id = 2}, {.table = APC_SENSOR, .id = 5}, {.table = APC_ACTUATOR, .id = 1}};
    struct apc_vector w[2] = {{.table = APC_PLAN, .id = 1, .room = ROOM, .value = got[0]},
                              {.table = APC_TICK, .id = 1, .room = ROOM, .value = got[1]}};
    rows = (struct apc_rows){.size = sizeof rows, .sample = t, .n_samples = 3, .vector = w, .n_vectors = 2};
    ok(*state, apc_store_read_rows(*state, &rows));
    assert_true(t[0].seq == 9 && t[1].seq == 0 && t[1].status == APC_BAD_NO_DATA && t[2].seq == 7);
    assert_near(t[0].value, -1, 0);
    assert_near(t[2].value, 0.5, 0);
    assert_true(w[0].seq == 2 && w[0].n == 2 && w[0].status == APC_GOOD && w[0].time == v[1].time);
    assert_true(w[1].seq == 4 && w[1].n == 6 && w[1].status == APC_UNCERTAIN && w[1].time == v[0].time);
    assert_memory_equal(got[0], plan, sizeof plan);
    assert_memory_equal(got[1], tick, sizeof tick);
}

static void test_a_sample_names_its_author_and_the_row_that_it_comes_from(void **state)
{
    struct apc_sample s[3] = {sample(APC_ACTUATOR, 1, 1, 1), sample(APC_ACTUAL, 1, 1, 1),
                              sample(APC_SETPOINT, 1, 0, 1)};
    s[0].origin = APC_SEQ_MAX;
    s[1].origin = 3;
    s[2].origin = 5;
    s[2].author = UINT32_C(4000000000);
    assert_int_equal(append_samples(*state, s, 3), 3);
    struct apc_sample u = newest(*state, APC_ACTUATOR, 1), a = newest(*state, APC_ACTUAL, 1),
                      r = newest(*state, APC_SETPOINT, 1);
    assert_true(u.origin == APC_SEQ_MAX && u.author == 0);
    assert_true(a.origin == 3 && a.author == 0);
    assert_true(r.origin == 5 && r.author == UINT32_C(4000000000));
}

static void test_a_vector_longer_than_its_room_is_cut_and_says_its_length(void **state)
{
    double in[5] = {1, 2, 3, 4, 5}, out[3] = {0, 0, -7};
    assert_int_equal(append_vector(*state, vector(APC_TICK, 1, 1, in, 5)), 1);
    struct apc_vector v = read_vector(*state, APC_TICK, 1, out, 2);
    assert_true(v.n == 5 && v.seq == 1);
    assert_near(out[0], 1, 0);
    assert_near(out[1], 2, 0);
    assert_near(out[2], -7, 0);
    v = read_vector(*state, APC_TICK, 1, NULL, 0); /* only to ask */
    assert_int_equal(v.n, 5);
}

static int is_longest(void *ctx, const struct apc_vector *v)
{
    *(bool *)ctx = v->n == APC_ELEMENTS_MAX;
    return 0;
}

static int is_next(void *ctx, const struct apc_vector *v)
{
    int64_t *seq = ctx;
    assert_true(*seq == 0 || v->seq == *seq + 1); /* a ring may have lost the first ones */
    *seq = v->seq;
    return 0;
}

static void test_vectors_of_any_length_come_back(void **state)
{
    static const uint32_t lengths[] = {1, 0, 4, 5, 12, 13, 100, 3, 1000, 2, 0, 4096, 1};
    double *in = calloc(APC_ELEMENTS_MAX, sizeof *in), *out = calloc(APC_ELEMENTS_MAX, sizeof *out);
    for (size_t i = 0; i < APC_ELEMENTS_MAX; i++) {
        in[i] = (double)i / 7;
    }
    int64_t seq = 0;
    for (size_t i = 0; i < sizeof lengths / sizeof lengths[0]; i++) {
        struct apc_vector v = vector(APC_PREDICTION, 2, ++seq, in + i, lengths[i]);
        assert_int_equal(append_vector(*state, v), 1);
        v = read_vector(*state, APC_PREDICTION, 2, out, APC_ELEMENTS_MAX);
        assert_true(v.seq == seq && v.n == lengths[i]);
        assert_memory_equal(out, in + i, lengths[i] * sizeof *in);
    }
    seq = 0;
    assert_true(apc_store_vectors(*state, APC_PREDICTION, 2, NULL, is_next, &seq) > 3);
    assert_int_equal(seq, sizeof lengths / sizeof lengths[0]);
    struct apc_vector v = vector(APC_TICK, 1, 1, in, APC_ELEMENTS_MAX);
    assert_int_equal(append_vector(*state, v), 1);
    v = read_vector(*state, APC_TICK, 1, out, APC_ELEMENTS_MAX);
    assert_int_equal(v.n, APC_ELEMENTS_MAX);
    assert_memory_equal(out, in, APC_ELEMENTS_MAX * sizeof *in);
    bool longest = false;
    assert_int_equal(apc_store_vectors(*state, APC_TICK, 1, NULL, is_longest, &longest), 1);
    assert_true(longest);
    free(in);
    free(out);
}

static void test_newest_is_the_highest_seq_and_a_repeat_changes_nothing(void **state)
{
    double first[2] = {1, 1}, second[2] = {2, 2}, out[ROOM];
    struct apc_vector v[2] = {vector(APC_TICK, 1, 5, first, 2), vector(APC_TICK, 1, 6, second, 2)};
    v[1].time = v[0].time - APC_NS_PER_S; /* the clock was set back */
    assert_int_equal(append_vectors(*state, v, 2), 2);
    assert_int_equal(append_vectors(*state, v, 2), 0);
    assert_int_equal(append_vector(*state, vector(APC_TICK, 1, 3, first, 2)), 1); /* a late one */
    struct apc_vector w = read_vector(*state, APC_TICK, 1, out, ROOM);
    assert_true(w.seq == 6 && w.n == 2 && w.time == v[1].time);
    assert_near(out[1], 2, 0);
    assert_int_equal(append_vector(*state, vector(APC_TICK, 1, 6, first, 2)), 0); /* another writer's */
    read_vector(*state, APC_TICK, 1, out, ROOM);
    assert_near(out[0], 2, 0);
}

static void test_one_vector_of_many_in_one_call_is_kept_apart_from_the_others(void **state)
{
    enum { N = 60 };
    double in[N][3], out[N][3];
    struct apc_vector v[N];
    for (int i = 0; i < N; i++) {
        in[i][0] = in[i][1] = in[i][2] = i;
        v[i] = vector((enum apc_table)(APC_TICK + i % 3), i / 3, 1, in[i], 3);
    }
    assert_int_equal(append_vectors(*state, v, N), N);
    for (int i = 0; i < N; i++) {
        v[i].value = out[i];
        v[i].seq = 0;
    }
    struct apc_rows rows = {.size = sizeof rows, .vector = v, .n_vectors = N};
    ok(*state, apc_store_read_rows(*state, &rows));
    for (int i = 0; i < N; i++) {
        assert_int_equal(v[i].seq, 1);
    }
    assert_memory_equal(out, in, sizeof in);
}

/* ---- Rows without one writer ------------------------------------------------------------------- */

static void test_a_row_that_people_write_follows_the_newest_that_its_writer_knows(void **state)
{
    struct apc_sample s[2] = {sample(APC_SETPOINT, 1, 0, 1), sample(APC_SENSOR, 1, 40, 1)};
    assert_int_equal(append_samples(*state, s, 2), 2);
    assert_true(s[0].seq == 1 && s[1].seq == 40);
    s[0].value = 2;
    s[1].seq = 41;
    assert_int_equal(append_samples(*state, s, 2), 2); /* s[0].seq is the newest */
    assert_int_equal(s[0].seq, 2);
    s[0].seq = APC_SEQ_ANY;
    s[0].value = 3;
    s[1].seq = 42;
    assert_int_equal(append_samples(*state, s, 2), 2);
    assert_int_equal(s[0].seq, 3);
    assert_near(newest(*state, APC_SETPOINT, 1).value, 3, 0);
}

/* Promise(stores/rows-samples-vectors) */
static void test_a_row_whose_writer_was_too_late_is_left_out_alone(void **state)
{
    struct apc_sample first = sample(APC_SETPOINT, 1, 0, 1);
    ok(*state, apc_store_put(*state, &first, 1));
    double in[2] = {1, 2}, out[ROOM];
    struct apc_sample s[4] = {sample(APC_SETPOINT, 1, 0, 9), sample(APC_SETPOINT, 2, 0, 9),
                              sample(APC_OPMODE, 1, 4, 1), sample(APC_ACTUATOR, 1, 1, 9)};
    struct apc_vector v = vector(APC_TICK, 1, 1, in, 2);
    const struct apc_rows rows = {
        .size = sizeof rows, .sample = s, .n_samples = 4, .vector = &v, .n_vectors = 1};
    assert_int_equal(apc_store_append_rows(*state, &rows), 3);
    assert_true(s[0].seq == 0 && s[1].seq == 1 && s[2].seq == 0 && s[3].seq == 1);
    assert_near(newest(*state, APC_SETPOINT, 1).value, 1, 0);
    assert_near(newest(*state, APC_SETPOINT, 2).value, 9, 0);
    assert_int_equal(newest(*state, APC_OPMODE, 1).seq, 0);
    assert_near(newest(*state, APC_ACTUATOR, 1).value, 9, 0);
    assert_int_equal(read_vector(*state, APC_TICK, 1, out, ROOM).seq, 1);
}

static void test_of_one_variable_twice_in_a_call_the_first_goes_before_the_second(void **state)
{
    struct apc_sample s[3] = {sample(APC_TUNING, 1, 0, 1), sample(APC_TUNING, 1, 1, 2),
                              sample(APC_TUNING, 1, 1, 3)};
    assert_int_equal(append_samples(*state, s, 3), 2);
    assert_true(s[0].seq == 1 && s[1].seq == 2 && s[2].seq == 0);
    struct apc_sample t[2] = {sample(APC_MANUAL, 1, APC_SEQ_ANY, 1), sample(APC_MANUAL, 1, APC_SEQ_ANY, 2)};
    assert_int_equal(append_samples(*state, t, 2), 2);
    assert_true(t[0].seq == 1 && t[1].seq == 2);
    assert_near(newest(*state, APC_TUNING, 1).value, 2, 0);
    assert_near(newest(*state, APC_MANUAL, 1).value, 2, 0);
}

enum { SWAPPERS = 4, SWAPS = 50 };

/* One more, SWAPS times. Returns NULL, or what failed. */
static void *add_ones(void *unused)
{
    struct apc_store *store = stores_open();
    const char *failed = NULL;
    (void)unused;
    for (int done = 0; done < SWAPS && !failed;) {
        struct apc_sample s = {.table = APC_SETPOINT, .id = 1};
        if (apc_store_read(store, &s, 1) != 0) {
            failed = "read";
        } else {
            s.value = s.seq > 0 ? s.value + 1 : 1;
            s.status = APC_GOOD;
            int n = append_samples(store, &s, 1);
            failed = n < 0 ? "append" : NULL;
            done += n > 0;
        }
    }
    apc_store_close(store);
    return (void *)(uintptr_t)failed;
}

static void test_concurrent_rows_lose_and_double_nothing(void **state)
{
    pthread_t thread[SWAPPERS];
    for (int i = 0; i < SWAPPERS; i++) {
        assert_int_equal(pthread_create(&thread[i], NULL, add_ones, NULL), 0);
    }
    for (int i = 0; i < SWAPPERS; i++) {
        void *failed = NULL;
        assert_int_equal(pthread_join(thread[i], &failed), 0);
        if (failed) {
            fail_msg("%s", (const char *)failed);
        }
    }
    struct apc_sample s = newest(*state, APC_SETPOINT, 1);
    assert_int_equal(s.seq, SWAPPERS * SWAPS);
    assert_near(s.value, SWAPPERS * SWAPS, 0);
}

/* ---- All of one moment -------------------------------------------------------------------------- */

enum { MOMENTS = 400, LENGTH = 40 };

static void *write_moments(void *failed)
{
    struct apc_store *store = stores_open();
    double value[LENGTH];
    for (int64_t seq = 1; seq <= MOMENTS; seq++) {
        struct apc_sample s = sample(APC_ACTUATOR, 1, seq, (double)seq);
        for (int i = 0; i < LENGTH; i++) {
            value[i] = (double)seq;
        }
        struct apc_vector v = vector(APC_TICK, 1, seq, value, LENGTH);
        const struct apc_rows rows = {
            .size = sizeof rows, .sample = &s, .n_samples = 1, .vector = &v, .n_vectors = 1};
        if (apc_store_append_rows(store, &rows) != 2) {
            *(bool *)failed = true;
            break;
        }
    }
    apc_store_close(store);
    return NULL;
}

/*
 * Promise(stores/rows-samples-vectors): Rows of samples and vectors are written together, read together,
 *   and left out alone where somebody was faster.
 */
static void test_what_is_read_together_was_written_together(void **state)
{
    pthread_t thread;
    bool failed = false;
    double value[LENGTH];
    struct apc_sample s = {.table = APC_ACTUATOR, .id = 1};
    struct apc_vector v = {.table = APC_TICK, .id = 1, .room = LENGTH, .value = value};
    struct apc_rows rows = {.size = sizeof rows, .sample = &s, .n_samples = 1, .vector = &v, .n_vectors = 1};
    assert_int_equal(pthread_create(&thread, NULL, write_moments, &failed), 0);
    for (int64_t seq = 0; seq < MOMENTS && !failed; seq = s.seq) {
        ok(*state, apc_store_read_rows(*state, &rows));
        assert_true(s.seq >= seq && v.seq == s.seq);
        for (uint32_t i = 0; i < v.n; i++) {
            assert_near(value[i], (double)s.seq, 0);
        }
    }
    assert_int_equal(pthread_join(thread, NULL), 0);
    assert_false(failed);
}

/* ---- What is refused ----------------------------------------------------------------------------- */

static void test_what_makes_no_sense_is_refused_and_nothing_is_written(void **state)
{
    struct apc_store *store = *state;
    double in[2] = {1, 2}, bad[2] = {1, (double)NAN}, huge[2] = {1e300, 1};
    struct apc_vector wrong[] = {vector(APC_TICK, -1, 1, in, 2),
                                 vector(APC_TICK, 1, 0, in, 2),
                                 vector(APC_SENSOR, 1, 1, in, 2),
                                 vector(APC_TABLE_END, 1, 1, in, 2),
                                 vector(APC_TICK, 1, 1, bad, 2),
                                 vector(APC_TICK, 1, 1, huge, 2),
                                 vector(APC_TICK, 1, 1, NULL, 2),
                                 vector((enum apc_table)0, 1, 1, in, 2),
                                 vector(APC_TICK, 1, 1, in, APC_ELEMENTS_MAX + 1)};
    for (size_t i = 0; i < sizeof wrong / sizeof wrong[0]; i++) {
        struct apc_vector v[2] = {vector(APC_TICK, 7, 1, in, 2), wrong[i]};
        assert_int_equal(append_vectors(store, v, 2), APC_EINVAL);
        assert_true(apc_store_error(store)[0] != '\0');
    }
    struct apc_sample s[] = {sample(APC_TICK, 1, 1, 1), sample(APC_SENSOR, 1, 0, 1),
                             sample(APC_SENSOR, 1, APC_SEQ_ANY, 1), sample(APC_SETPOINT, 1, -2, 1),
                             sample(APC_SETPOINT, 1, 0, (double)INFINITY)};
    for (size_t i = 0; i < sizeof s / sizeof s[0]; i++) {
        assert_int_equal(append_samples(store, &s[i], 1), APC_EINVAL);
    }
    struct apc_vector v = vector(APC_TICK, 1, APC_SEQ_MAX, in, 2);
    assert_int_equal(append_vectors(store, &v, 1), 1);
    v.seq = APC_SEQ_MAX + 1;
    assert_int_equal(append_vectors(store, &v, 1), APC_ESTORE);
    assert_int_equal(read_vector(store, APC_TICK, 7, in, 2).seq, 0);
    struct apc_rows rows = {.size = sizeof rows, .sample = NULL, .n_samples = 1};
    assert_int_equal(apc_store_append_rows(store, &rows), APC_EINVAL);
    assert_int_equal(apc_store_read_rows(store, &rows), APC_EINVAL);
    rows = (struct apc_rows){.size = 0};
    assert_int_equal(apc_store_append_rows(store, &rows), APC_EINVAL);
    assert_int_equal(apc_store_append_rows(store, NULL), APC_EINVAL);
    rows.size = sizeof rows;
    assert_int_equal(apc_store_append_rows(store, &rows), 0);
    assert_int_equal(apc_store_read_rows(store, &rows), 0);
    struct apc_sample t = {.table = APC_TICK, .id = 1};
    assert_int_equal(apc_store_read(store, &t, 1), APC_EINVAL);
    assert_int_equal(apc_store_append(store, &(struct apc_sample){.table = APC_TICK, .id = 1, .seq = 1}, 1),
                     APC_EINVAL);
}

/* What only the store can see: no row is written then, and each seq is as it was. */
/* Promise(stores/rows-samples-vectors) */
static void test_a_row_that_the_store_refuses_keeps_all_out(void **state)
{
    double in[2] = {1, 2}, out[ROOM];
    struct apc_sample s[3] = {sample(APC_SETPOINT, 1, APC_SEQ_ANY, 1), sample(APC_ESTIMATE, 1, 1, 1),
                              sample(APC_OPMODE, 1, 0, 0.5)};
    struct apc_vector v = vector(APC_TICK, 1, 1, in, 2);
    const struct apc_rows rows = {
        .size = sizeof rows, .sample = s, .n_samples = 3, .vector = &v, .n_vectors = 1};
    assert_int_equal(apc_store_append_rows(*state, &rows), APC_ESTORE);
    assert_true(s[0].seq == APC_SEQ_ANY && s[1].seq == 1 && s[2].seq == 0 && v.seq == 1);
    assert_int_equal(newest(*state, APC_SETPOINT, 1).seq, 0);
    assert_int_equal(newest(*state, APC_ESTIMATE, 1).seq, 0);
    assert_int_equal(read_vector(*state, APC_TICK, 1, out, ROOM).seq, 0);
    s[2].value = 1;
    assert_int_equal(apc_store_append_rows(*state, &rows), 4);
}

/* ---- Wait, variables, history, housekeeping ------------------------------------------------------- */

/* ---- The mode of all --------------------------------------------------------------------------- */

static struct apc_sample newest_mode(struct apc_store *store, int id)
{
    struct apc_sample s = {.table = APC_OPMODE, .id = id};
    ok(store, apc_store_read(store, &s, 1));
    return s;
}

static void assert_mode(struct apc_store *store, int id, double value, int64_t seq, int64_t origin)
{
    const struct apc_sample s = newest_mode(store, id);
    assert_near(s.value, value, 0);
    assert_int_equal(s.seq, seq);
    assert_int_equal(s.origin, origin);
}

/*
 * Promise(database/put-mode-put): What is put to the mode of all is put to each loop in the same
 *   transaction, or to none; what is appended under its seq is that alone.
 */
static void test_what_is_put_to_the_mode_of_all_is_put_to_each_loop(void **state)
{
    const struct apc_tag tags[] = {
        {.table = APC_OPMODE, .id = 0, .name = "mode"},
        {.table = APC_OPMODE, .id = 1, .name = "u1", .controller = "b"},
        {.table = APC_OPMODE, .id = 2, .name = "upper.r1", .controller = "upper"},
        {.table = APC_OPMODE, .id = 3, .name = "nobody's"},
        {.table = APC_OPMODE, .id = 65536, .name = "a switch", .controller = "base"},
    };
    struct apc_sample s = {.table = APC_OPMODE, .value = APC_MODE_MAN}, named[2];
    assert_true(apc_store_put_tags(*state, tags, 5) == 5);

    ok(*state, apc_store_put(*state, &s, 1));
    assert_int_equal(s.seq, 1);
    assert_mode(*state, 0, APC_MODE_MAN, 1, 0);
    assert_mode(*state, 1, APC_MODE_MAN, 1, 1);
    assert_mode(*state, 2, APC_MODE_MAN, 1, 1);
    assert_int_equal(newest_mode(*state, 3).seq, 0);
    assert_int_equal(newest_mode(*state, 65536).seq, 0);

    /* a loop that is named gets what is said of it */
    named[0] = (struct apc_sample){.table = APC_OPMODE, .id = 2, .value = APC_MODE_CAS};
    named[1] = (struct apc_sample){.table = APC_OPMODE, .id = 0, .value = APC_MODE_AUTO};
    ok(*state, apc_store_put(*state, named, 2));
    assert_mode(*state, 0, APC_MODE_AUTO, 2, 0);
    assert_mode(*state, 1, APC_MODE_AUTO, 2, 2);
    assert_mode(*state, 2, APC_MODE_CAS, 2, 0);
    named[0] = (struct apc_sample){.table = APC_OPMODE, .id = 0, .value = APC_MODE_AUTO};
    named[1] = (struct apc_sample){.table = APC_OPMODE, .id = 2, .value = APC_MODE_CAS};
    ok(*state, apc_store_put(*state, named, 2)); /* in either order */
    assert_mode(*state, 1, APC_MODE_AUTO, 3, 3);
    assert_mode(*state, 2, APC_MODE_CAS, 3, 0);

    /* a swap that fails leaves the loops alone */
    s = (struct apc_sample){.table = APC_OPMODE, .seq = 2, .value = APC_MODE_OOS};
    assert_int_equal(apc_store_swap(*state, &s, 1), APC_ECONFLICT);
    assert_mode(*state, 1, APC_MODE_AUTO, 3, 3);
    s.value = APC_MODE_OOS; /* its seq is now the newest */
    ok(*state, apc_store_swap(*state, &s, 1));
    assert_mode(*state, 1, APC_MODE_OOS, 4, 4);
    assert_mode(*state, 2, APC_MODE_OOS, 4, 4);

    /* and so does a row that is left out */
    struct apc_sample rows[2] = {{.table = APC_OPMODE, .seq = 3, .value = APC_MODE_MAN},
                                 {.table = APC_MANUAL, .id = 1, .seq = APC_SEQ_ANY, .value = 4}};
    assert_int_equal(append_samples(*state, rows, 2), 1);
    assert_int_equal(rows[0].seq, 0);
    assert_mode(*state, 1, APC_MODE_OOS, 4, 4);
    rows[0].seq = 4;
    rows[1].seq = APC_SEQ_ANY;
    assert_int_equal(append_samples(*state, rows, 2), 2); /* rows of the caller's */
    assert_int_equal(rows[0].seq, 5);
    assert_mode(*state, 1, APC_MODE_MAN, 5, 5);
    assert_mode(*state, 2, APC_MODE_MAN, 5, 5);
}

static void test_a_loop_without_a_seq_left_keeps_the_mode_of_all_out(void **state)
{
    const struct apc_tag tag = {.table = APC_OPMODE, .id = 1, .name = "u", .controller = "base"};
    const struct apc_sample last = sample(APC_OPMODE, 1, APC_SEQ_MAX, APC_MODE_AUTO);
    struct apc_sample s = {.table = APC_OPMODE, .value = APC_MODE_MAN};
    assert_int_equal(apc_store_put_tags(*state, &tag, 1), 1);
    assert_int_equal(apc_store_append(*state, &last, 1), 1);
    assert_int_equal(apc_store_put(*state, &s, 1), APC_ESTORE);
    assert_non_null(strstr(apc_store_error(*state), "seq_in_range"));
    assert_int_equal(newest_mode(*state, 0).seq, 0);
    assert_mode(*state, 1, APC_MODE_AUTO, APC_SEQ_MAX, 0);
}

/* Promise(database/put-mode-put) */
static void test_what_is_appended_is_stored_as_it_is(void **state)
{
    const struct apc_tag tag = {.table = APC_OPMODE, .id = 1, .name = "u", .controller = "base"};
    struct apc_sample put = {.table = APC_OPMODE, .value = APC_MODE_MAN};
    const struct apc_sample s[2] = {sample(APC_OPMODE, 0, 3, APC_MODE_AUTO),
                                    sample(APC_OPMODE, 0, 4, APC_MODE_OOS)},
                            loop = sample(APC_OPMODE, 1, 3, APC_MODE_AUTO);
    assert_int_equal(apc_store_put_tags(*state, &tag, 1), 1);
    ok(*state, apc_store_put(*state, &put, 1));
    assert_int_equal(apc_store_append(*state, s, 1), 1);
    assert_int_equal(apc_store_append(*state, s, 2), 1); /* of which one is there already */
    assert_mode(*state, 0, APC_MODE_OOS, 4, 0);
    assert_mode(*state, 1, APC_MODE_MAN, 1, 1);
    assert_int_equal(apc_store_append(*state, &loop, 1), 1);
    assert_mode(*state, 1, APC_MODE_AUTO, 3, 0);
    put.value = APC_MODE_CAS; /* and a put goes on as before */
    ok(*state, apc_store_put(*state, &put, 1));
    assert_mode(*state, 1, APC_MODE_CAS, 4, 5);
}

static void test_a_wait_sees_rows(void **state)
{
    double in[2] = {1, 2};
    struct apc_sample seen[2] = {{.table = APC_TICK, .id = 1}, {.table = APC_SETPOINT, .id = 1}};
    assert_int_equal(apc_store_wait(*state, seen, 2, 0), 0);
    assert_int_equal(append_vector(*state, vector(APC_TICK, 1, 1, in, 2)), 1);
    assert_int_equal(apc_store_wait(*state, seen, 2, 0), 1);
    seen[0].seq = 1;
    assert_int_equal(apc_store_wait(*state, seen, 2, 0), 0);
    struct apc_sample s = sample(APC_SETPOINT, 1, 0, 1);
    assert_int_equal(append_samples(*state, &s, 1), 1);
    assert_int_equal(apc_store_wait(*state, seen, 2, 0), 1);
}

static void test_variables_of_vectors_are_named_as_well(void **state)
{
    double in[1] = {1};
    struct apc_sample s = sample(APC_ESTIMATE, 4, 1, 1), v[4];
    struct apc_vector w = vector(APC_PLAN, 2, 1, in, 1);
    const struct apc_rows rows = {
        .size = sizeof rows, .sample = &s, .n_samples = 1, .vector = &w, .n_vectors = 1};
    assert_int_equal(apc_store_append_rows(*state, &rows), 2);
    assert_int_equal(apc_store_variables(*state, v, 4), 2);
    assert_true(v[0].table == APC_ESTIMATE && v[0].id == 4 && v[1].table == APC_PLAN && v[1].id == 2);
}

struct seen {
    struct apc_store *store;
    int64_t seq[20];
    int n, stop_at;
    bool wrong;
};

/* Row seq has seq elements, each seq. */
static int see(void *ctx, const struct apc_vector *v)
{
    struct seen *seen = ctx;
    double value[1];
    seen->wrong = seen->wrong || v->n != (uint32_t)v->seq || v->table != APC_TICK || v->id != 1 ||
                  v->time != 1000 * v->seq * APC_NS_PER_US;
    for (uint32_t i = 0; i < v->n; i++) {
        seen->wrong = seen->wrong || v->value[i] < (double)v->seq || v->value[i] > (double)v->seq;
    }
    if (seen->store) {
        struct apc_vector inner = {.table = APC_TICK, .id = 1, .room = 1, .value = value};
        struct apc_rows rows = {.size = sizeof rows, .vector = &inner, .n_vectors = 1};
        seen->wrong = seen->wrong || apc_store_read_rows(seen->store, &rows) != APC_ESTATE;
    }
    seen->seq[seen->n++] = v->seq;
    return seen->n == seen->stop_at;
}

static void test_history_comes_in_rising_seq_within_its_bounds(void **state)
{
    static const int64_t order[] = {1, 2, 3, 4, 5, 7, 6, 8, 9, 10};
    double value[10];
    for (size_t i = 0; i < 10; i++) {
        for (int k = 0; k < 10; k++) {
            value[k] = (double)order[i];
        }
        assert_int_equal(append_vector(*state, vector(APC_TICK, 1, order[i], value, (uint32_t)order[i])), 1);
    }
    struct seen all = {.store = *state};
    assert_int_equal(apc_store_vectors(*state, APC_TICK, 1, NULL, see, &all), 10);
    assert_false(all.wrong);
    for (int i = 0; i < 10; i++) {
        assert_int_equal(all.seq[i], i + 1);
    }
    const struct {
        struct apc_range range;
        int stop_at, first, n;
    } some[] = {
        {{.since = 3 * APC_NS_PER_MS}, 0, 3, 8},
        {{.until = 3 * APC_NS_PER_MS}, 0, 1, 2},
        {{.last = 4}, 0, 7, 4},
        {{.since = 2 * APC_NS_PER_MS, .until = 9 * APC_NS_PER_MS, .last = 2}, 0, 7, 2},
        {{.last = 40}, 0, 1, 10},
        {{.since = 0}, 3, 1, 3},
        {{.since = 11 * APC_NS_PER_MS}, 0, 0, 0},
    };
    for (size_t i = 0; i < sizeof some / sizeof some[0]; i++) {
        struct seen seen = {.stop_at = some[i].stop_at};
        assert_int_equal(apc_store_vectors(*state, APC_TICK, 1, &some[i].range, see, &seen), some[i].n);
        assert_int_equal(seen.n, some[i].n);
        assert_false(seen.wrong);
        for (int k = 0; k < seen.n; k++) {
            assert_int_equal(seen.seq[k], some[i].first + k);
        }
    }
    struct seen none = {0};
    assert_int_equal(apc_store_vectors(*state, APC_TICK, 2, NULL, see, &none), 0);
    assert_int_equal(apc_store_vectors(*state, APC_SENSOR, 1, NULL, see, &none), APC_EINVAL);
    assert_int_equal(apc_store_vectors(*state, APC_TICK, 1, NULL, NULL, NULL), APC_EINVAL);
    assert_int_equal(none.n, 0);
}

static int count_vector(void *ctx, const struct apc_vector *v)
{
    *(double *)ctx += v->n > 0 ? v->value[0] : 0;
    return 0;
}

/*
 * Promise(stores/ticks-predictions-kept): Ticks and predictions are kept a day, or as long as one says,
 *   whatever is kept of the rest.
 */
static void test_maintenance_drops_what_is_old_and_keeps_the_newest(void **state)
{
    const apc_ns now = apc_clock_utc(NULL);
    double value[4][3] = {{1, 1, 1}, {10, 10, 10}, {100, 100, 100}, {1000, 1000, 1000}};
    struct apc_vector v[6] = {
        vector(APC_TICK, 1, 1, value[0], 3),       vector(APC_TICK, 1, 2, value[1], 3),
        vector(APC_TICK, 1, 3, value[2], 3),       vector(APC_PLAN, 1, 1, value[3], 3),
        vector(APC_PREDICTION, 1, 1, value[0], 3), vector(APC_PREDICTION, 1, 2, value[1], 3)};
    v[2].time = v[5].time = now; /* the others are of 1970 */
    assert_int_equal(append_vectors(*state, v, 6), 6);
    ok(*state, apc_store_maintain(*state, NULL));
    struct apc_retention keep = {.size = sizeof keep, .samples = 3600 * APC_NS_PER_S};
    ok(*state, apc_store_maintain(*state, &keep));
    double sum = 0;
    ok(*state,
       apc_store_vectors(*state, APC_TICK, 1, NULL, count_vector, &sum)); /* kept apart from samples */
    assert_near(sum, 111, 0);
    keep = (struct apc_retention){.size = sizeof keep, .ticks = 3600 * APC_NS_PER_S};
    ok(*state, apc_store_maintain(*state, &keep));
    sum = 0;
    ok(*state, apc_store_vectors(*state, APC_PREDICTION, 1, NULL, count_vector, &sum));
    assert_near(sum, 10, 0);
    sum = 0;
    ok(*state, apc_store_vectors(*state, APC_TICK, 1, NULL, count_vector, &sum));
    assert_near(sum, 100, 0);
    sum = 0;
    ok(*state, apc_store_vectors(*state, APC_PLAN, 1, NULL, count_vector, &sum));
    assert_near(sum, 1000, 0);
    double out[ROOM];
    assert_int_equal(read_vector(*state, APC_TICK, 1, out, ROOM).seq, 3);
    assert_near(out[2], 100, 0);
    v[0].seq = 4;
    assert_int_equal(append_vector(*state, v[0]), 1); /* and goes on */
    assert_int_equal(read_vector(*state, APC_TICK, 1, out, ROOM).seq, 4);
    assert_near(out[0], 1, 0);
}

struct newest_rows {
    int64_t first, next;
    int n;
};

static void see_newest(struct newest_rows *s, int64_t seq)
{
    s->first = s->n++ == 0 ? seq : s->first;
    assert_true(s->n == 1 || seq == s->next);
    s->next = seq + 1;
}

static int see_newest_sample(void *ctx, const struct apc_sample *s)
{
    see_newest(ctx, s->seq);
    return 0;
}

static int see_newest_vector(void *ctx, const struct apc_vector *v)
{
    see_newest(ctx, v->seq);
    return 0;
}

static void test_the_newest_so_many_are_so_many(void **state)
{
    enum { ROWS = 200 };
    static const struct apc_range bounds[] = {{0}, {.until = 150 * 1000 * 1000}, {.since = 60 * 1000 * 1000}};
    for (int64_t seq = 1; seq <= ROWS; seq++) {
        double value = (double)seq;
        struct apc_sample s = sample(APC_SENSOR, 1, seq, value);
        s.time = seq * APC_NS_PER_MS;
        assert_int_equal(append_samples(*state, &s, 1), 1);
        assert_int_equal(append_vector(*state, vector(APC_TICK, 1, seq, &value, 1)), 1);
    }
    for (size_t i = 0; i < sizeof bounds / sizeof *bounds; i++) {
        const int64_t low = bounds[i].since ? 60 : 1, high = bounds[i].until ? 149 : ROWS;
        for (int64_t last = 1; last <= ROWS + 2; last += last % 64 > 62 || last % 64 < 2 ? 1 : 5) {
            const int64_t first = high - last + 1 > low ? high - last + 1 : low;
            struct apc_range range = bounds[i];
            struct newest_rows samples = {0}, vectors = {0};
            range.last = (size_t)last;
            ok(*state, apc_store_history(*state, APC_SENSOR, 1, &range, see_newest_sample, &samples));
            ok(*state, apc_store_vectors(*state, APC_TICK, 1, &range, see_newest_vector, &vectors));
            assert_true(samples.first == first && samples.next == high + 1);
            assert_true(vectors.first == first && vectors.next == high + 1);
        }
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        T(test_a_variable_without_a_row_reads_as_no_data),
        T(test_samples_and_vectors_come_back_together),
        T(test_a_sample_names_its_author_and_the_row_that_it_comes_from),
        T(test_a_vector_longer_than_its_room_is_cut_and_says_its_length),
        T(test_vectors_of_any_length_come_back),
        T(test_newest_is_the_highest_seq_and_a_repeat_changes_nothing),
        T(test_one_vector_of_many_in_one_call_is_kept_apart_from_the_others),
        T(test_a_row_that_people_write_follows_the_newest_that_its_writer_knows),
        T(test_a_row_whose_writer_was_too_late_is_left_out_alone),
        T(test_of_one_variable_twice_in_a_call_the_first_goes_before_the_second),
        T(test_concurrent_rows_lose_and_double_nothing),
        T(test_what_is_read_together_was_written_together),
        T(test_what_makes_no_sense_is_refused_and_nothing_is_written),
        T(test_a_row_that_the_store_refuses_keeps_all_out),
        T(test_what_is_put_to_the_mode_of_all_is_put_to_each_loop),
        T(test_a_loop_without_a_seq_left_keeps_the_mode_of_all_out),
        T(test_what_is_appended_is_stored_as_it_is),
        T(test_a_wait_sees_rows),
        T(test_variables_of_vectors_are_named_as_well),
        T(test_history_comes_in_rising_seq_within_its_bounds),
        T(test_the_newest_so_many_are_so_many),
        T(test_maintenance_drops_what_is_old_and_keeps_the_newest),
    };
    int failed = 0;
    while (stores_next())
        failed += cmocka_run_group_tests_name(store_kind->name, tests, NULL, NULL);
    return failed;
}

/* SPDX-License-Identifier: BSD-3-Clause */
/*
 * The protocol of the store in shared memory, checked exhaustively: its own sources, with each load, store
 * and fence going through here (shm_model.h).
 *
 * Writers take turns, by the lock, and read nothing that a reader writes: so what they store is one sequence,
 * whoever reads meanwhile. It is recorded: for each list of operations, some of which fail half-way, and
 * again with the writer killed after every single store, and again with whoever recovers from that killed
 * after every store of his.
 *
 * A reader can then see of each word what C11's release and acquire allow: any value that was stored in it,
 * but none older than what it has seen of that word, or knows of by acquiring. All of those choices are gone
 * through. (Every interleaving on a machine that keeps the order is among them.) Of equal values only that is
 * tried which leaves the most to choose from later.
 *
 * What a reader gives must be what there was at the generation that it took: to the last bit, and never
 * something else. One that has to begin again does so with what is there in the end, and must get it: also
 * where a writer was killed and nobody has recovered.
 */
#include <errno.h>
#include <limits.h>
#include <stdio.h>
#include <stdlib.h>
#include <unistd.h>

#include "apcstore.h"
#include "check.h"
#include "shareddata/shm/shm.h"

static struct apc_store *store;
static struct apc_shm *shm;
static char *segment;

static char *base_of(void)
{
    return (char *)shm->header;
}

/* ---- What writers do ------------------------------------------------------------------------- */

enum { STORES = 4096, DEEP = 4096, GENERATIONS = 64, WORDS = 512 };

/* One store, as it was made. */
static struct store {
    uint32_t at; /* offset in the segment */
    uint32_t size;
    uint64_t former, value;
    int known; /* who acquires it knows of so many stores */
    int next;  /* into the same word; -1: none */
} stored[STORES];

static int n_stored, fenced;
static enum { PLAIN, WRITING, READING } mode = PLAIN;
static enum { FREE, HELD, DEAD } lock = FREE;

static uint64_t load_from(const volatile void *at, size_t size)
{
    return size == 8 ? __atomic_load_n((const volatile uint64_t *)at, __ATOMIC_RELAXED)
                     : __atomic_load_n((const volatile uint32_t *)at, __ATOMIC_RELAXED);
}

static void store_to(volatile void *at, size_t size, uint64_t value)
{
    if (size == 8) {
        __atomic_store_n((volatile uint64_t *)at, value, __ATOMIC_RELAXED);
    } else {
        __atomic_store_n((volatile uint32_t *)at, (uint32_t)value, __ATOMIC_RELAXED);
    }
}

int model_lock(void)
{
    const int e = lock == DEAD ? EOWNERDEAD : 0;
    assert_int_not_equal(lock, HELD);
    lock = HELD;
    return e;
}

int model_unlock(void)
{
    lock = FREE;
    return 0;
}

/* ---- What a reader can see ------------------------------------------------------------------- */

static struct choice {
    int taken, of;
} choice[DEEP];
static int depth, n_choices; /* of this execution; of which so many were made before */
static int *head;            /* of each word: its first store; -1: none */
static int seen[STORES];     /* of each store that is its word's first: the last one seen */
static int known, pending;   /* all stores below it; what an acquiring fence adds */
static bool looked, settled; /* it has read more than the generation; it began again */
static uint64_t generation;  /* that it took */
static unsigned long executions;

static uint64_t see(int s, memory_order order, int first)
{
    seen[first] = s > seen[first] ? s : seen[first];
    pending = stored[s].known > pending ? stored[s].known : pending;
    if (order != memory_order_relaxed) {
        known = stored[s].known > known ? stored[s].known : known;
    }
    return stored[s].value;
}

static int choose(int of)
{
    assert_true(depth < DEEP);
    if (depth == n_choices) {
        choice[n_choices++] = (struct choice){0, of};
    }
    assert_int_equal(choice[depth].of, of);
    return choice[depth++].taken;
}

/* The values from which it may take one; -1 is that from before all stores. */
static int candidates(int first, uint64_t before, int candidate[STORES])
{
    int n = 0, oldest = seen[first];
    for (int s = first; s >= 0 && s < known; s = stored[s].next) {
        oldest = s > oldest ? s : oldest;
    }
    if (oldest < 0) {
        candidate[n++] = -1;
    }
    for (int s = oldest < 0 ? first : oldest; s >= 0; s = stored[s].next) {
        bool needed = true;
        for (int i = 0; needed && i < n; i++) {
            const uint64_t value = candidate[i] < 0 ? before : stored[candidate[i]].value;
            const int knows = candidate[i] < 0 ? 0 : stored[candidate[i]].known;
            needed = value != stored[s].value || knows > stored[s].known;
        }
        if (needed) {
            candidate[n++] = s;
        }
    }
    return n;
}

static uint64_t read_word(uint32_t at, size_t size, memory_order order)
{
    const bool is_generation = at == offsetof(struct apc_shm_header, generation);
    const int first = head[at / 4];
    uint64_t value = load_from(base_of() + at, size);
    settled = settled || (is_generation && looked);
    looked = looked || !is_generation;
    if (!settled && first >= 0) {
        int candidate[STORES];
        const int n = candidates(first, stored[first].former, candidate);
        const int s = candidate[n > 1 ? choose(n) : 0];
        value = s < 0 ? stored[first].former : see(s, order, first);
    }
    generation = is_generation ? value : generation;
    return value;
}

uint64_t model_load(const volatile void *at, size_t size, memory_order order)
{
    return mode == READING ? read_word((uint32_t)((const volatile char *)at - base_of()), size, order)
                           : load_from(at, size);
}

void model_store(volatile void *at, size_t size, uint64_t value, memory_order order)
{
    assert_int_not_equal(mode, READING);
    if (mode == WRITING) {
        assert_true(n_stored < STORES);
        stored[n_stored] = (struct store){.at = (uint32_t)((volatile char *)at - base_of()),
                                          .size = (uint32_t)size,
                                          .former = load_from(at, size),
                                          .value = value,
                                          .known = order == memory_order_relaxed ? fenced : n_stored + 1,
                                          .next = -1};
        n_stored++;
    }
    store_to(at, size, value);
}

void model_fence(void)
{
    if (mode == READING) {
        known = pending > known ? pending : known;
    } else {
        fenced = n_stored;
    }
}

/* ---- Results ----------------------------------------------------------------------------------- */

/* What a reader gave, or has to give. */
struct result {
    int rc;
    size_t n;
    uint64_t word[WORDS];
};
typedef void reader(struct result *r);

static struct result expected[GENERATIONS];
static bool known_generation[GENERATIONS];

static void add(struct result *r, uint64_t word)
{
    assert_true(r->n < WORDS);
    r->word[r->n++] = word;
}

/* ---- Check one sequence of stores --------------------------------------------------------------- */

static const char *what;

static void compare(const struct result *got, bool may_be_shorter)
{
    const struct result *want = &expected[generation < GENERATIONS ? generation : 0];
    const size_t skip = may_be_shorter && got->n < want->n ? want->n - got->n : 0;
    if (generation >= GENERATIONS || !known_generation[generation] || got->n + skip != want->n ||
        got->rc < 0 || (want->n > 0 && got->n == 0) ||
        memcmp(got->word, want->word + skip, got->n * sizeof *got->word) != 0) {
        char text[400] = "";
        for (size_t i = 0; i < got->n && i < 12 && strlen(text) < 300; i++) {
            snprintf(text + strlen(text), 32, " %llu", (unsigned long long)got->word[i]);
        }
        fail_msg("%s: at generation %llu: rc %d (%s), not %d; %zu words, not %zu:%s", what,
                 (unsigned long long)generation, got->rc, got->rc < 0 ? store->why.text : "", want->rc,
                 got->n, want->n, text);
    }
}

static void index_stores(void)
{
    for (int s = 0; s < n_stored; s++) {
        stored[s].next = -1;
        seen[s] = -1;
        int *at = &head[stored[s].at / 4];
        while (*at >= 0) {
            at = &stored[*at].next;
        }
        *at = s;
    }
}

/* All that the reader can see of what is recorded. */
static void explore(reader *read, bool may_be_shorter)
{
    index_stores();
    n_choices = 0;
    do {
        struct result r = {0};
        depth = known = pending = 0;
        looked = settled = false;
        memset(shm->read_hint, 0, 8 * sizeof *shm->read_hint);
        mode = READING;
        read(&r);
        mode = PLAIN;
        executions++;
        compare(&r, may_be_shorter);
        for (int s = 0; s < n_stored; s++) {
            seen[s] = -1;
        }
        while (n_choices > 0 && ++choice[n_choices - 1].taken == choice[n_choices - 1].of) {
            n_choices--;
        }
    } while (n_choices > 0);
    for (int s = 0; s < n_stored; s++) {
        head[stored[s].at / 4] = -1;
    }
}

/* ---- Record: operations, and where a writer is killed ---------------------------------------------- */

typedef void operation(void);

/* What there is now, of this generation, is what readers of it have to find. */
static void expect(reader *read)
{
    struct result r = {0};
    mode = PLAIN;
    read(&r);
    generation = apc_shm_generation(shm);
    assert_true(generation < GENERATIONS);
    if (known_generation[generation]) {
        compare(&r, false);
    }
    expected[generation] = r;
    known_generation[generation] = true;
}

/* Returns how many stores it makes; with @p cut up to that, so many are made and its writer died with the
 * lock. */
static int record(operation *op, reader *read, int cut)
{
    const int from = n_stored;
    mode = WRITING;
    fenced = 0;
    op();
    mode = PLAIN;
    const int made = n_stored - from;
    if (cut <= made) {
        while (n_stored > from + cut) {
            n_stored--;
            store_to(base_of() + stored[n_stored].at, stored[n_stored].size, stored[n_stored].former);
        }
        lock = DEAD;
    }
    expect(read);
    return made;
}

struct scenario {
    const char *name;
    reader *read;
    bool may_be_shorter; /* the oldest rows may have been overwritten */
    operation *op[8];    /* the first @p before of them are done when the reader begins, at the latest */
    size_t before;
};

/* All operations, the @p first killed after @p cut stores, and the next after @p again. Returns how many
 * stores the first and the next make. */
static void run(const struct scenario *s, size_t first, int cut, int again, int *made, int *made_again)
{
    memcpy(base_of(), segment, shm->size);
    memset(known_generation, 0, sizeof known_generation);
    lock = FREE;
    n_stored = 0;
    expect(s->read);
    for (size_t i = 0; s->op[i]; i++) {
        const int n = record(s->op[i], s->read, i == first ? cut : i == first + 1 ? again : INT_MAX);
        *made = i == first ? n : *made;
        *made_again = i == first + 1 ? n : *made_again;
        n_stored = i + 1 == s->before ? 0 : n_stored;
    }
    explore(s->read, s->may_be_shorter);
}

/* With @p kills writers of one sequence killed: 0, 1 or 2. */
static void check(const struct scenario *s, int kills)
{
    int made = 0, made_again = 0;
    what = s->name;
    executions = 0;
    run(s, SIZE_MAX - 1, INT_MAX, INT_MAX, &made, &made_again);
    for (size_t first = 0; kills > 0 && s->op[first]; first++) {
        made = 1;
        for (int cut = 0; cut <= made; cut++) {
            run(s, first, cut, INT_MAX, &made, &made_again);
            for (int again = 0; kills > 1 && s->op[first + 1] && again <= made_again; again++) {
                run(s, first, cut, again, &made, &made_again);
            }
        }
    }
    print_message("%s: %lu executions\n", s->name, executions);
}

/* ---- Samples ----------------------------------------------------------------------------------- */

enum { A = 1, B, NEW, OTHER, FULL };

static struct apc_sample row(int id)
{
    const int64_t seq = (int64_t)apc_shm_generation(shm); /* another one each time */
    return (struct apc_sample){.table = APC_SETPOINT, .id = id, .time = 1, .value = (double)seq};
}

static void put(int id)
{
    struct apc_sample s = row(id);
    assert_int_equal(store->ops->put(store, &s, 1), 0);
}

static void put_a(void)
{
    put(A);
}

static void put_a_and_b(void)
{
    struct apc_sample s[] = {row(A), row(B)};
    assert_int_equal(store->ops->put(store, s, 2), 0);
}

static void put_new(void)
{
    put(NEW);
}

static void put_other(void)
{
    put(OTHER);
}

/* A variable whose numbers are used up fails after the others were written. */
static void fail_with(int id)
{
    struct apc_sample s[] = {row(id), row(FULL)};
    assert_true(store->ops->put(store, s, 2) < 0);
}

static void fail_a(void)
{
    fail_with(A);
}

static void fail_new(void)
{
    fail_with(NEW);
}

static void add_sample(struct result *r, const struct apc_sample *s)
{
    uint64_t value;
    memcpy(&value, &s->value, sizeof value);
    add(r, (uint64_t)s->id);
    add(r, (uint64_t)s->seq);
    add(r, value);
    add(r, s->status);
}

static void read_samples(struct result *r, const int *id, size_t n)
{
    struct apc_sample s[4] = {{.table = 0}};
    for (size_t i = 0; i < n; i++) {
        s[i] = (struct apc_sample){.table = APC_SETPOINT, .id = id[i]};
    }
    r->rc = store->ops->read(store, s, n);
    for (size_t i = 0; i < n; i++) {
        add_sample(r, &s[i]);
    }
}

static void read_a(struct result *r)
{
    read_samples(r, (int[]){A}, 1);
}

static void read_b_and_a(struct result *r)
{
    read_samples(r, (int[]){B, A}, 2);
}

static void read_new(struct result *r)
{
    read_samples(r, (int[]){NEW}, 1);
}

static int give_sample(void *ctx, const struct apc_sample *s)
{
    add_sample((struct result *)ctx, s);
    return 0;
}

static void history_of(struct result *r, int id)
{
    const struct apc_range all = {0};
    r->rc = store->ops->history(store, APC_SETPOINT, id, &all, give_sample, r);
}

static void history_a(struct result *r)
{
    history_of(r, A);
}

static void history_new(struct result *r)
{
    history_of(r, NEW);
}

static void read_variables(struct result *r)
{
    struct apc_sample s[8] = {{.table = 0}};
    r->rc = store->ops->variables(store, s, 8);
    for (int i = 0; i < r->rc && i < 8; i++) {
        add(r, (uint64_t)s[i].id);
    }
}

/* ---- Vectors ------------------------------------------------------------------------------------ */

static void append_vector(uint32_t n)
{
    double value[16] = {0};
    const int64_t seq = (int64_t)apc_shm_generation(shm);
    value[0] = value[n - 1] = (double)seq;
    struct apc_vector v = {
        .table = APC_TICK, .id = A, .seq = seq, .time = 1, .n = n, .room = 16, .value = value};
    struct apc_rows rows = {.size = sizeof rows, .vector = &v, .n_vectors = 1};
    assert_int_equal(store->ops->append_rows(store, &rows), 1);
}

static void append_short(void)
{
    append_vector(2);
}

static void append_long(void)
{
    append_vector(10);
}

static void read_vector(struct result *r)
{
    double value[16] = {0};
    struct apc_vector v = {.table = APC_TICK, .id = A, .room = 16, .value = value};
    struct apc_rows rows = {.size = sizeof rows, .vector = &v, .n_vectors = 1};
    r->rc = store->ops->read_rows(store, &rows);
    add(r, (uint64_t)v.seq);
    add(r, v.n);
    for (uint32_t i = 0; i < v.n; i++) {
        add(r, (uint64_t)value[i]);
    }
}

/* ---- Tags, catalogue, events --------------------------------------------------------------------- */

static void describe(void)
{
    char text[32];
    const int n = (int)(apc_shm_generation(shm) % 10);
    struct apc_tag tag = {.table = APC_SENSOR, .id = n, .name = "y", .length = n};
    snprintf(text, sizeof text, "text of %d and more %d", n, n);
    if (store->ops->describe(store, &tag, 1, text) != 1) {
        fail_msg("%s", apc_store_error(store));
    }
}

static void read_tags(struct result *r)
{
    struct apc_tag tag = {.id = 0};
    r->rc = store->ops->get_tags(store, &tag, 1);
    add(r, (uint64_t)tag.id);
    add(r, (uint64_t)tag.length);
}

static void read_catalogue(struct result *r)
{
    char text[64] = "";
    int64_t revision = 0;
    r->rc = store->ops->catalogue(store, text, sizeof text, &revision);
    add(r, (uint64_t)revision);
    for (size_t i = 0; i < sizeof text; i += 8) {
        uint64_t word;
        memcpy(&word, text + i, 8);
        add(r, word);
    }
}

/* Into two rings. */
static void append_events(void)
{
    const int n = (int)(apc_shm_generation(shm) % 10);
    struct apc_event event[] = {{.time = n + 1, .kind = "operator"}, {.time = n + 1, .kind = "link"}};
    assert_int_equal(store->ops->append_events(store, event, 2), 2);
}

static int give_event(void *ctx, const struct apc_event *event)
{
    add((struct result *)ctx, (uint64_t)event->time);
    add((struct result *)ctx, (uint64_t)event->number);
    return 0;
}

static void read_events(struct result *r)
{
    const struct apc_range all = {0};
    r->rc = store->ops->events(store, &all, give_event, r);
}

/* ---- Tests ---------------------------------------------------------------------------------------- */

static int set_up(void **state)
{
    char uri[64], path[64];
    (void)state;
    snprintf(uri, sizeof uri, "shm:model-test-%d?size=1", (int)getpid());
    snprintf(path, sizeof path, "/dev/shm/apc.model-test-%d", (int)getpid());
    unlink(path);
    const struct apc_store_options options = {.size = sizeof options, .name = "model"};
    if (apc_store_open(&store, uri, &options, NULL) != 0 || apc_store_init(store) < 0) {
        return -1;
    }
    shm = apc_shm_of(store);
    struct apc_sample full = {.table = APC_SETPOINT, .id = FULL, .seq = APC_SEQ_MAX, .time = 1};
    assert_int_equal(store->ops->append(store, &full, 1), 1);
    segment = (char *)malloc(shm->size);
    head = (int *)malloc(shm->size / 4 * sizeof *head);
    if (!segment || !head) {
        return -1;
    }
    memcpy(segment, base_of(), shm->size);
    memset(head, 0xff, shm->size / 4 * sizeof *head);
    return 0;
}

static int tear_down(void **state)
{
    char path[64];
    (void)state;
    snprintf(path, sizeof path, "/dev/shm/apc.model-test-%d", (int)getpid());
    memcpy(base_of(), segment, shm->size);
    apc_store_close(store);
    free(segment);
    free(head);
    return unlink(path);
}

/*
 * Promise(stores/reader-shared-memory): A reader of shared memory gets what there was at one commit,
 *   whatever writers do, fail at or die of: every choice that C11 leaves it is gone through.
 */
static void test_a_variable_that_has_data_never_has_none(void **state)
{
    (void)state;
    check(&(struct scenario){"failing", read_a, false, {put_a, put_a, fail_a, put_a, fail_a, put_a}, 2}, 2);
    check(&(struct scenario){"first", read_a, false, {fail_a, put_a, fail_a, put_a, put_a}, 0}, 2);
}

/* Promise(stores/reader-shared-memory) */
static void test_samples_are_of_one_generation(void **state)
{
    (void)state;
    check(&(struct scenario){"two", read_b_and_a, false, {put_a_and_b, put_a_and_b, put_a_and_b, fail_a}, 1},
          2);
}

/* Promise(stores/reader-shared-memory) */
static void test_a_slot_that_is_used_again_is_not_another_variables(void **state)
{
    (void)state;
    check(&(struct scenario){"slot", read_new, false, {fail_new, put_other, put_new, put_new}, 0}, 2);
    check(
        &(struct scenario){
            "slot's history", history_new, false, {fail_new, put_other, put_other, put_new}, 0},
        1);
    check(&(struct scenario){"variables", read_variables, false, {fail_new, put_other, put_new}, 0}, 2);
}

/* Promise(stores/reader-shared-memory) */
static void test_a_ring_that_grows_has_its_rows(void **state)
{
    (void)state;
    check(&(struct scenario){"history", history_a, true, {put_a, put_a, put_a, put_a, fail_a, put_a}, 3}, 1);
}

/* Promise(stores/reader-shared-memory) */
static void test_vectors_are_whole_while_they_grow_wider(void **state)
{
    (void)state;
    check(&(struct scenario){"vectors",
                             read_vector,
                             false,
                             {append_short, append_short, append_long, append_long, append_long},
                             2},
          1);
}

/* Promise(stores/reader-shared-memory) */
static void test_tags_and_catalogue_are_of_one_description(void **state)
{
    (void)state;
    check(&(struct scenario){"tags", read_tags, false, {describe, describe, describe, put_a, describe}, 1},
          1);
    check(&(struct scenario){"catalogue", read_catalogue, false, {describe, describe, describe, describe}, 2},
          1);
}

/* Promise(stores/reader-shared-memory) */
static void test_events_are_those_of_one_moment(void **state)
{
    (void)state;
    check(
        &(struct scenario){
            "events", read_events, false, {append_events, append_events, append_events, fail_new}, 1},
        1);
}

int main(int argc, char **argv)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_a_variable_that_has_data_never_has_none),
        cmocka_unit_test(test_samples_are_of_one_generation),
        cmocka_unit_test(test_a_slot_that_is_used_again_is_not_another_variables),
        cmocka_unit_test(test_a_ring_that_grows_has_its_rows),
        cmocka_unit_test(test_vectors_are_whole_while_they_grow_wider),
        cmocka_unit_test(test_tags_and_catalogue_are_of_one_description),
        cmocka_unit_test(test_events_are_those_of_one_moment),
    };
    cmocka_set_test_filter(argc > 1 ? argv[1] : NULL);
    return cmocka_run_group_tests_name("the model of shared memory", tests, set_up, tear_down);
}

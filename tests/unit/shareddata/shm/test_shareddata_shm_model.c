/* SPDX-License-Identifier: BSD-3-Clause */
/*
 * The protocol of the store in shared memory, checked exhaustively: its own sources, with each load, store
 * and fence going through here (shm_model.h).
 *
 * Writers take turns, by the lock, and read nothing that a reader writes, but for the note of one who sleeps:
 * so what they store is one sequence, whoever reads meanwhile. It is recorded: for each list of operations,
 * some of which fail half-way, and again with the writer killed after every single store, and again with
 * whoever recovers from that killed after every store of his. A compiler may put a relaxed store before all
 * that no release fence keeps above it: so a writer is also killed when of those only that one was made.
 *
 * A reader can then see of each word what C11's release and acquire allow: any value that was stored in it,
 * but none older than what it has seen of that word, or knows of by acquiring. All of those choices are gone
 * through. (Every interleaving on a machine that keeps the order is among them.) Of equal values only that is
 * tried which leaves the most to choose from later.
 *
 * What a reader gives must be what there was at the generation that it took: to the last bit, and never
 * something else. One that has to begin again does so with what is there in the end, and must get it: also
 * where a writer was killed and nobody has recovered.
 *
 * In the end each memory order of the sources is made one step weaker, by itself. Something must then be found
 * to be wrong: so none is stronger than it has to be, and the model sees what a weak machine can do.
 */
#include <dirent.h>
#include <errno.h>
#include <limits.h>
#include <linux/futex.h>
#include <stdio.h>
#include <stdlib.h>
#include <unistd.h>

#include "apcstore.h"
#include "check.h"
#include "shareddata/shm/shm.h"

#define SOURCES APC_SOURCE_DIR "/src/shareddata/shm"

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

/* What a commit does for those who sleep; without the note of one, of which the sequence knows nothing. */
static struct commit {
    int tick;     /* so many stores are made then */
    bool ordered; /* before it looks for a note, for all */
} commit[GENERATIONS];
static int n_commits;
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

/* ---- Orders, and one of them weakened ---------------------------------------------------------- */

enum { SITES = 64 };

/* Where an order is asked for. */
static struct site {
    const char *file;
    int line;
} site[SITES];
static int n_sites, weak = -1;
static bool fault; /* of the weak one */

static int site_at(const char *file, int line)
{
    const char *slash = strrchr(file, '/');
    const char *name = slash ? slash + 1 : file;
    int i = 0;
    while (i < n_sites && (site[i].line != line || strcmp(site[i].file, name) != 0)) {
        i++;
    }
    if (i == n_sites) {
        assert_true(n_sites < SITES);
        site[n_sites++] = (struct site){.file = name, .line = line};
    }
    return i;
}

memory_order model_order(memory_order order, const char *file, int line)
{
    if (order == memory_order_relaxed || mode == PLAIN || site_at(file, line) != weak) {
        return order;
    }
    return order == memory_order_seq_cst ? memory_order_acq_rel : memory_order_relaxed;
}

/* ---- The lock ---------------------------------------------------------------------------------- */

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
static int unseen;           /* so many commits do not see its note */
static bool missed;          /* it sleeps, and nobody wakes it for what there is */
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
    const bool is_tick = at == offsetof(struct apc_shm_header, tick);
    const int first = head[at / 4];
    uint64_t value = load_from(base_of() + at, size);
    settled = settled || (is_generation && looked);
    looked = looked || (!is_generation && !is_tick);
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
    if (mode == READING) {
        return read_word((uint32_t)((const volatile char *)at - base_of()), size, order);
    }
    if (mode == WRITING && at == &shm->header->waiting) {
        commit[n_commits - 1].ordered = commit[n_commits - 1].ordered && order == memory_order_seq_cst;
    }
    return load_from(at, size);
}

void model_store(volatile void *at, size_t size, uint64_t value, memory_order order)
{
    if (mode == READING) {
        assert_ptr_equal(at, &shm->header->waiting);
        unseen = choose(n_commits + 1);
        return;
    }
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

uint64_t model_add(volatile void *at, size_t size, uint64_t more, memory_order order)
{
    const uint64_t former = load_from(at, size);
    model_store(at, size, former + more, order);
    if (mode == WRITING) {
        assert_true(n_commits < GENERATIONS);
        commit[n_commits++] = (struct commit){.tick = n_stored, .ordered = order == memory_order_seq_cst};
    }
    return former;
}

void model_fence(memory_order order)
{
    if (mode == READING && order == memory_order_seq_cst) {
        for (int i = 0; i < unseen; i++) {
            known = commit[i].ordered && commit[i].tick > known ? commit[i].tick : known;
        }
    }
    if (mode == READING && order != memory_order_relaxed && order != memory_order_release) {
        known = pending > known ? pending : known;
    }
    if (mode == WRITING && order != memory_order_relaxed && order != memory_order_acquire) {
        fenced = n_stored;
    }
}

/* Who sleeps is woken by the next commit that sees the note. A commit that does not see it has to be seen. */
long model_futex(const volatile void *at, int operation, uint32_t expected)
{
    if (mode == READING && operation == FUTEX_WAIT && !settled) {
        const bool sleeps =
            read_word((uint32_t)((const volatile char *)at - base_of()), 4, memory_order_relaxed) == expected;
        missed = missed || (sleeps && unseen > 0);
        settled = true;
    }
    return 0;
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

typedef void operation(void);

enum {
    SHORTER = 1, /* the oldest rows may have been overwritten */
    FULL_UP = 2, /* rings do not grow, but go round */
    HINTS = 4    /* the reader may have been there before */
};

struct scenario {
    const char *name;
    reader *read;
    unsigned how;
    operation *op[8]; /* the first @p before of them are done when the reader begins, at the latest */
    size_t before;
};

/* ---- Check one sequence of stores --------------------------------------------------------------- */

static const char *what;

static void compare(const struct result *got, bool may_be_shorter)
{
    const struct result *want = &expected[generation < GENERATIONS ? generation : 0];
    const size_t skip = may_be_shorter && got->n < want->n ? want->n - got->n : 0;
    const bool wrong = missed || generation >= GENERATIONS || !known_generation[generation] ||
                       got->n + skip != want->n || got->rc < 0 || (want->n > 0 && got->n == 0) ||
                       memcmp(got->word, want->word + skip, got->n * sizeof *got->word) != 0;
    if (wrong && weak >= 0) {
        fault = true;
    } else if (wrong) {
        char text[400] = "";
        for (size_t i = 0; i < got->n && i < 12 && strlen(text) < 300; i++) {
            snprintf(text + strlen(text), 32, " %llu", (unsigned long long)got->word[i]);
        }
        fail_msg("%s: at generation %llu%s: rc %d (%s), not %d; %zu words, not %zu:%s", what,
                 (unsigned long long)generation, missed ? ", asleep, and not woken" : "", got->rc,
                 got->rc < 0 ? store->why.text : "", want->rc, got->n, want->n, text);
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
static void explore(const struct scenario *s)
{
    index_stores();
    n_choices = 0;
    do {
        struct result r = {0};
        depth = known = pending = unseen = 0;
        looked = settled = missed = false;
        const uint32_t hint = s->how & HINTS ? (uint32_t)choose(2) : 0;
        for (size_t i = 0; i < 8; i++) {
            shm->read_hint[i] = hint;
        }
        mode = READING;
        s->read(&r);
        mode = PLAIN;
        executions++;
        compare(&r, (s->how & SHORTER) != 0);
        for (int i = 0; i < n_stored; i++) {
            seen[i] = -1;
        }
        while (n_choices > 0 && ++choice[n_choices - 1].taken == choice[n_choices - 1].of) {
            n_choices--;
        }
    } while (n_choices > 0 && !fault);
    missed = false;
    for (int i = 0; i < n_stored; i++) {
        head[stored[i].at / 4] = -1;
    }
}

/* ---- Record: operations, and where a writer is killed ---------------------------------------------- */

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

static void undo_to(int n)
{
    while (n_stored > n) {
        n_stored--;
        store_to(base_of() + stored[n_stored].at, stored[n_stored].size, stored[n_stored].former);
    }
}

/* Of the last stores, down to number @p from, only the last, which was put before the others. */
static void hoist_last(int from)
{
    struct store last = stored[n_stored - 1];
    undo_to(from);
    last.former = load_from(base_of() + last.at, last.size);
    last.known = last.known < from ? last.known : from;
    store_to(base_of() + last.at, last.size, last.value);
    stored[n_stored++] = last;
}

/* Where a writer is killed: after so many stores, or after the last of these and no other that need not be
 * before it. */
struct cut {
    int stores;
    bool hoisted;
};

static const struct cut not_killed = {INT_MAX, false};

/* Returns how many stores it makes; cut within these, its writer died with the lock. *@p differs becomes
 * whether a hoisted last store makes a difference. */
static int record(operation *op, reader *read, struct cut cut, bool *differs)
{
    const int from = n_stored;
    mode = WRITING;
    fenced = 0;
    op();
    mode = PLAIN;
    const int made = n_stored - from;
    *differs = false;
    if (cut.stores <= made) {
        undo_to(from + cut.stores);
        const int after = cut.stores > 0 ? stored[n_stored - 1].known : n_stored;
        const int least = after > from ? after : from;
        *differs = least < n_stored - 1;
        if (*differs && cut.hoisted) {
            hoist_last(least);
        }
        while (n_commits > 0 && commit[n_commits - 1].tick > n_stored) {
            n_commits--;
        }
        lock = DEAD;
    }
    expect(read);
    return made;
}

/* What running a scenario makes of an operation that is killed. */
struct made {
    int stores;
    bool differs;
};

/* But for some first extents. */
static void fill_cells(void)
{
    for (int i = 0; i < 2; i++) {
        apc_word *counters = shm->header->meta.counters[i];
        store_to(&counters[offsetof(struct apc_shm_counters, cells) / 8], 8, shm->cells - 64);
    }
}

/* All operations, the @p first killed at @p cut, and the next at @p again. */
static void run(const struct scenario *s, size_t first, const struct cut cut[2], struct made made[2])
{
    memcpy(base_of(), segment, shm->size);
    memset(known_generation, 0, sizeof known_generation);
    lock = FREE;
    n_stored = n_commits = 0;
    if (s->how & FULL_UP) {
        fill_cells();
    }
    expect(s->read);
    for (size_t i = 0; s->op[i]; i++) {
        const bool killed = i == first || i == first + 1;
        struct made of = {0};
        of.stores = record(s->op[i], s->read, killed ? cut[i - first] : not_killed, &of.differs);
        if (killed) {
            made[i - first] = of;
        }
        if (i + 1 == s->before) {
            n_stored = n_commits = 0;
        }
    }
    explore(s);
}

/* The next place to kill. */
static bool next_cut(struct cut *cut, struct made made)
{
    if (made.differs && !cut->hoisted) {
        cut->hoisted = true;
        return true;
    }
    *cut = (struct cut){cut->stores + 1, false};
    return cut->stores <= made.stores;
}

/* With @p kills writers of one sequence killed: 0, 1 or 2; with 3 also the second of two with a hoisted store. */
static void check(const struct scenario *s, int kills)
{
    struct made made[2] = {{0}};
    if (fault) {
        return;
    }
    what = s->name;
    executions = 0;
    run(s, SIZE_MAX - 1, (struct cut[]){not_killed, not_killed}, made);
    for (size_t first = 0; kills > 0 && s->op[first] && !fault; first++) {
        struct cut cut[2] = {{0}};
        do {
            cut[1] = not_killed;
            run(s, first, cut, made);
            const struct made one = made[0];
            cut[1] = (struct cut){0};
            if (kills > 1 && s->op[first + 1] && !fault) {
                do {
                    run(s, first, cut, made);
                } while (!fault &&
                         next_cut(&cut[1], (struct made){made[1].stores, made[1].differs && kills > 2}));
            }
            made[0] = one;
        } while (!fault && next_cut(&cut[0], made[0]));
    }
    if (weak < 0) {
        print_message("%s: %lu executions\n", s->name, executions);
    }
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

static int give_vector(void *ctx, const struct apc_vector *v)
{
    add((struct result *)ctx, (uint64_t)v->seq);
    add((struct result *)ctx, v->n);
    add((struct result *)ctx, (uint64_t)v->value[v->n - 1]);
    return 0;
}

static void history_of_vectors(struct result *r)
{
    const struct apc_range all = {0};
    r->rc = store->ops->vectors(store, APC_TICK, A, &all, give_vector, r);
}

/* ---- Sleeping, authors ------------------------------------------------------------------------------ */

static int64_t slept_on;

static void put_what_is_slept_on(void)
{
    struct apc_sample s = row(A);
    assert_int_equal(store->ops->put(store, &s, 1), 0);
    slept_on = s.seq;
}

static void sleep_on_a(struct result *r)
{
    const struct apc_sample known_one = {.table = APC_SETPOINT, .id = A, .seq = slept_on};
    r->rc = mode == READING ? store->ops->wait(store, &known_one, 1, INT64_MAX) : 1;
    add(r, (uint64_t)r->rc);
}

static void come(void)
{
    char name[APC_AUTHOR_LEN] = "who comes";
    assert_true(store->ops->author(store, name) > 0);
}

/* There is none, or the whole name. */
static void read_author(struct result *r)
{
    char name[APC_AUTHOR_LEN] = "";
    r->rc = apc_shm_generation(shm) > 0 ? 0 : -1;
    add(r, store->ops->author_name(store, 1, name) == 0 && strcmp(name, "who comes") != 0);
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

/* A ring of eight. */
static void append_access(void)
{
    const struct apc_event event = {.time = (apc_ns)apc_shm_generation(shm), .kind = "access"};
    assert_int_equal(store->ops->append_events(store, &event, 1), 1);
}

static void append_accesses(void)
{
    for (int i = 0; i < 6; i++) {
        append_access();
    }
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
    check(&(struct scenario){"failing", read_a, 0, {put_a, put_a, fail_a, put_a, fail_a, put_a}, 2}, 2);
    check(&(struct scenario){"first", read_a, 0, {fail_a, put_a, fail_a, put_a, put_a}, 0}, 2);
}

/* Promise(stores/reader-shared-memory) */
static void test_samples_are_of_one_generation(void **state)
{
    (void)state;
    check(&(struct scenario){"recovery", read_b_and_a, 0, {put_a_and_b, put_a_and_b, put_a_and_b}, 1}, 3);
    check(&(struct scenario){"two", read_b_and_a, 0, {put_a_and_b, put_a_and_b, put_a_and_b, fail_a}, 1}, 2);
}

/* Promise(stores/reader-shared-memory) */
static void test_a_slot_that_is_used_again_is_not_another_variables(void **state)
{
    (void)state;
    check(&(struct scenario){"slot", read_new, HINTS, {fail_new, put_other, put_new, put_new}, 0}, 2);
    check(&(struct scenario){"slot's history", history_new, 0, {fail_new, put_other, put_other, put_new}, 0},
          1);
    check(&(struct scenario){"variables", read_variables, 0, {fail_new, put_other, put_new}, 0}, 2);
}

/* Promise(stores/reader-shared-memory) */
static void test_a_ring_that_grows_has_its_rows(void **state)
{
    (void)state;
    check(&(struct scenario){"history", history_a, SHORTER, {put_a, put_a, put_a, put_a, fail_a, put_a}, 3},
          1);
    check(
        &(struct scenario){
            "round", history_a, SHORTER | FULL_UP, {put_a, put_a, put_a, put_a, put_a, put_a}, 3},
        1);
}

/* Promise(stores/reader-shared-memory) */
static void test_vectors_are_whole_while_they_grow_wider(void **state)
{
    (void)state;
    check(&(struct scenario){"vectors",
                             read_vector,
                             0,
                             {append_short, append_short, append_long, append_long, append_long},
                             2},
          1);
}

/* Promise(stores/reader-shared-memory) */
static void test_tags_and_catalogue_are_of_one_description(void **state)
{
    (void)state;
    check(&(struct scenario){"tags", read_tags, 0, {describe, describe, describe, put_a, describe}, 1}, 1);
    check(&(struct scenario){"catalogue", read_catalogue, 0, {describe, describe, describe, describe}, 2}, 1);
}

/* Promise(stores/reader-shared-memory) */
static void test_events_are_those_of_one_moment(void **state)
{
    (void)state;
    check(
        &(struct scenario){
            "events", read_events, 0, {append_events, append_events, append_events, fail_new}, 1},
        1);
    check(&(struct scenario){"events round",
                             read_events,
                             SHORTER,
                             {append_accesses, append_access, append_access, append_access, append_access},
                             1},
          1);
}

/* Promise(stores/reader-shared-memory) */
static void test_vectors_of_a_ring_are_whole(void **state)
{
    (void)state;
    check(
        &(struct scenario){"vectors' history",
                           history_of_vectors,
                           SHORTER,
                           {append_short, append_short, append_short, append_short, append_long, append_long},
                           3},
        1);
    check(&(struct scenario){"vectors round",
                             history_of_vectors,
                             SHORTER | FULL_UP,
                             {append_short, append_short, append_short, append_short, append_short,
                              append_short},
                             3},
          1);
}

static void test_who_sleeps_is_woken(void **state)
{
    (void)state;
    check(&(struct scenario){"sleep", sleep_on_a, 0, {put_what_is_slept_on, put_a, put_a}, 1}, 0);
}

static void test_an_author_has_a_whole_name(void **state)
{
    (void)state;
    check(&(struct scenario){"author", read_author, 0, {put_a, come, put_a}, 1}, 1);
}

static void (*const protocol[])(void **state) = {
    test_an_author_has_a_whole_name,
    test_who_sleeps_is_woken,
    test_a_ring_that_grows_has_its_rows,
    test_vectors_of_a_ring_are_whole,
    test_events_are_those_of_one_moment,
    test_tags_and_catalogue_are_of_one_description,
    test_vectors_are_whole_while_they_grow_wider,
    test_a_slot_that_is_used_again_is_not_another_variables,
    test_a_variable_that_has_data_never_has_none,
    test_samples_are_of_one_generation,
};

/* Of a file: each order that is not relaxed has been gone through. */
static int count_orders(const char *name)
{
    char path[512], line[256];
    int number = 0, missing = 0;
    snprintf(path, sizeof path, SOURCES "/%s", name);
    FILE *f = fopen(path, "r");
    assert_non_null(f);
    while (fgets(line, sizeof line, f)) {
        number++;
        if (strstr(line, "memory_order_") && !strstr(line, "memory_order_relaxed")) {
            const int known_sites = n_sites;
            site_at(name, number);
            missing += n_sites - known_sites;
            if (n_sites > known_sites) {
                print_message("%s:%d: no scenario goes through it\n", name, number);
            }
        }
    }
    fclose(f);
    return missing;
}

/* Each one step weaker, by itself, and something is wrong. */
static void test_each_memory_order_is_needed(void **state)
{
    int needless = 0;
    (void)state;
    for (size_t i = 0; i < sizeof protocol / sizeof *protocol && n_sites == 0; i++) {
        protocol[i](NULL);
    }
    for (weak = 0; weak < n_sites; weak++) {
        fault = false;
        for (size_t i = 0; i < sizeof protocol / sizeof *protocol && !fault; i++) {
            protocol[i](NULL);
        }
        print_message("%s:%d: %s%s\n", site[weak].file, site[weak].line,
                      fault ? "needed by " : "could be weaker", fault ? what : "");
        needless += !fault;
    }
    weak = -1;
    fault = false;
    DIR *sources = opendir(SOURCES);
    assert_non_null(sources);
    for (const struct dirent *file; (file = readdir(sources)) != NULL;) {
        needless += file->d_name[0] != '.' ? count_orders(file->d_name) : 0;
    }
    closedir(sources);
    assert_int_equal(needless, 0);
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
        cmocka_unit_test(test_vectors_of_a_ring_are_whole),
        cmocka_unit_test(test_who_sleeps_is_woken),
        cmocka_unit_test(test_an_author_has_a_whole_name),
        cmocka_unit_test(test_each_memory_order_is_needed),
    };
    cmocka_set_test_filter(argc > 1 ? argv[1] : NULL);
    return cmocka_run_group_tests_name("the model of shared memory", tests, set_up, tear_down);
}

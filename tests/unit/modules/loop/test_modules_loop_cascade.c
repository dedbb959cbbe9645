/* SPDX-License-Identifier: BSD-3-Clause */
/* A cascade, whatever operators, crashes, failing sensors, failing laws and late answers do, in whatever
 * order. */
#include "check.h"

#include "cascade.h"

/* ---- Chance -------------------------------------------------------------------------------- */

#define SLOTS 8 /* of a period of the loop below, in which something may happen */

static bool chance(struct apc_random *random, unsigned in)
{
    return apc_random_next(random) % in == 0;
}

static enum apc_mode any_mode(struct apc_random *random)
{
    static const enum apc_mode modes[] = {APC_MODE_CAS,  APC_MODE_CAS, APC_MODE_CAS,
                                          APC_MODE_AUTO, APC_MODE_MAN, APC_MODE_OOS};
    return modes[apc_random_next(random) % 6];
}

struct chance {
    struct apc_random *random;
    unsigned rate;                   /* of trouble: once in so many slots */
    unsigned append[2], operator_at; /* slots until then */
    unsigned slot;
};

static void heal(struct cascade *w)
{
    for (int who = LOWER; who <= UPPER; who++) {
        w->side[who].measured = true;
        w->side[who].lost = false;
        w->side[who].answers = GOOD;
        cascade_start(w, (enum who)who);
    }
}

static void operator_wants(struct cascade *w, struct chance *c, int what, enum apc_mode mode)
{
    if (w->operator.what != NOTHING)
        return;
    w->operator.what = what;
    w->operator.value = 2 * apc_random_uniform(c->random) - 1;
    w->operator.mode = mode;
    w->manual[LOWER] = what == MODE ? (double)NAN : w->manual[LOWER];
    cascade_operator_reads(w);
    c->operator_at = (unsigned)(apc_random_next(c->random) % (2 * SLOTS));
}

/* Something happens that nobody asked for. */
static void trouble(struct cascade *w, struct chance *c)
{
    struct cascade_side *s = &w->side[chance(c->random, 2)];
    enum who who = s == &w->side[UPPER] ? UPPER : LOWER;

    switch (apc_random_next(c->random) % 12) {
    case 0:
    case 1:
        s->measured = !s->measured;
        break;
    case 2:
        s->answers = (enum result)(apc_random_next(c->random) % 4);
        break;
    case 3:
        s->answers = GOOD;
        break;
    case 4:
        cascade_kill(w, who);
        break;
    case 5:
    case 6:
        cascade_start(w, who);
        break;
    case 7:
        s->lost = !s->lost;
        break;
    case 8:
        w->w = 4 * apc_random_uniform(c->random) - 2;
        break;
    case 9:
        w->manual[who] = chance(c->random, 2) ? (double)NAN : 2 * apc_random_uniform(c->random) - 1;
        break;
    case 10:
        w->store.target[UPPER] = any_mode(c->random);
        w->manual[UPPER] = (double)NAN;
        break;
    default:
        operator_wants(w, c, chance(c->random, 2) ? PUT : MODE, any_mode(c->random));
    }
}

static void slot(struct cascade *w, struct chance *c)
{
    for (int who = LOWER; who <= UPPER; who++) {
        struct cascade_side *s = &w->side[who];
        unsigned every = who == LOWER ? SLOTS : SLOTS * (TOP / BASE);

        if (s->pending && c->append[who]-- == 0)
            cascade_appends(w, (enum who)who);
        if (c->slot % every == (who == LOWER ? 0 : 1) && s->alive && !s->pending) {
            cascade_reads(w, (enum who)who);
            c->append[who] = who == UPPER && chance(c->random, 8)
                                 ? (unsigned)(apc_random_next(c->random) % (every - 2))
                                 : (unsigned)(apc_random_next(c->random) % (SLOTS - 2));
        }
    }
    if (w->operator.pending && c->operator_at-- == 0) {
        cascade_operator_appends(w);
        c->operator_at = 0;
    }
    if (c->rate && chance(c->random, c->rate))
        trouble(w, c);
    c->slot++;
    w->now += BASE / SLOTS;
    if (c->slot % SLOTS == 0)
        cascade_process(w);
}

/* All has been in order for some time: then the setpoint is whose it is. */
static void must_be_owned(struct cascade *w)
{
    const struct cascade_side *lower = &w->side[LOWER], *upper = &w->side[UPPER];

    if (w->store.target[LOWER] == APC_MODE_OOS)
        return; /* nobody looks after it */
    if (w->store.target[LOWER] == APC_MODE_CAS && w->store.target[UPPER] != APC_MODE_OOS) {
        cascade_must(w, lower->now.loop.state == APC_LOOP_CAS, "all is well, and the loop comes into Cas");
        cascade_must(w, w->store.setpoint.author == UPPER, "in Cas the setpoint is the loop above's");
        cascade_must(w, upper->now.loop.state == APC_LOOP_AUTO || upper->now.loop.state == APC_LOOP_MAN,
                     "all is well, and the loop above acts");
    } else {
        cascade_must(w, w->store.setpoint.author != UPPER || w->store.target[LOWER] == APC_MODE_CAS,
                     "out of Cas the setpoint is not the loop above's");
        cascade_must(w, lower->now.loop.state != APC_LOOP_CAS, "Cas without anybody above");
    }
    cascade_must(w, w->store.setpoint.value >= lower->now.z && w->store.setpoint.value <= lower->now.z,
                 "the setpoint is the one in force");
}

static void quiet(struct cascade *w, struct chance *c)
{
    struct cascade_side *lower = &w->side[LOWER];

    heal(w);
    if (chance(c->random, 2))
        w->store.target[UPPER] = APC_MODE_AUTO;
    c->rate = 0;
    for (int i = 0; i < SLOTS * 12 * (int)(TOP / BASE) && !w->broken; i++)
        slot(w, c);
    while (lower->pending || lower->seen.setpoint.seq != w->store.setpoint.seq)
        slot(w, c); /* until the loop below has seen it all */
    must_be_owned(w);
}

#if defined(__SANITIZE_ADDRESS__) || defined(__SANITIZE_THREAD__)
#define SEEDS 2 /* a sanitizer makes it twenty times as long, and finds in a part what it finds in all */
#define PAIRS 5
#else
#define SEEDS 20
#define PAIRS 1 /* of requests: each so many-th */
#endif
#define EPISODES 50000 /* of each seed */

/* Promise(modes/acts-now-tracks) */
static void test_whatever_happens_in_whatever_order(void **state)
{
    uint64_t entered = 0, shed = 0, taken = 0, ticks = 0;

    (void)state;
    for (uint64_t seed = 1; seed <= SEEDS; seed++) {
        struct apc_random random;
        struct chance c = {.random = &random};
        struct cascade w;

        apc_random_init(&random, seed, "cascade");
        cascade_init(&w, seed % 2 ? 1 : -1);
        w.side[LOWER].has_backup = seed % 4 == 0;
        w.side[UPPER].has_backup = seed % 5 == 0;
        for (int episode = 0; episode < EPISODES; episode++) {
            c.rate = 8u << apc_random_next(&random) % 6;
            if (chance(&random, 4)) {
                heal(&w);
                operator_wants(&w, &c, MODE, APC_MODE_CAS);
                w.store.target[UPPER] = APC_MODE_AUTO;
            }
            for (int i = 0; i < 16 * SLOTS && !w.broken; i++)
                slot(&w, &c);
            if (chance(&random, 32))
                quiet(&w, &c);
            if (w.broken) {
                print_message("seed %d, episode %d\n", (int)seed, episode);
                cascade_check(&w);
            }
        }
        entered += w.entered;
        shed += w.shed;
        taken += w.taken;
        ticks += w.ticks;
    }
    print_message("%d situations, %llu ticks: %llu times into Cas, %llu shed, %llu takings over\n",
                  SEEDS * EPISODES, (unsigned long long)ticks, (unsigned long long)entered,
                  (unsigned long long)shed, (unsigned long long)taken);
    assert_true(entered > 1000 && shed > 1000 && taken > 1000);
}

/* ---- Every order ---------------------------------------------------------------------------- */

#define EACH 4 /* steps of an actor: it reads, appends, reads, appends */

static const struct request {
    int what;
    enum apc_mode mode;
} requests[] = {{PUT, APC_MODE_AUTO}, {MODE, APC_MODE_AUTO}, {MODE, APC_MODE_CAS}, {MODE, APC_MODE_MAN}};

static void step(struct cascade *w, enum who who, unsigned nth, const struct request *request)
{
    w->now += BASE / SLOTS;
    if (who != OPERATOR) {
        (nth % 2 == 0 ? cascade_reads : cascade_appends)(w, who);
    } else if (nth % 2 == 0) {
        w->operator.what = request->what;
        w->operator.mode = request->mode;
        w->operator.value = w->store.setpoint.value + 0.25;
        cascade_operator_reads(w);
    } else {
        while (w->operator.pending)
            cascade_operator_appends(w);
    }
}

/* The next order of the actors after this one, by the alphabet; false after the last. */
static bool permute(enum who *order, size_t n)
{
    size_t i = n - 1, j = n - 1;

    while (i > 0 && order[i - 1] >= order[i])
        i--;
    if (i == 0)
        return false;
    while (order[j] <= order[i - 1])
        j--;
    enum who swap = order[i - 1];
    order[i - 1] = order[j];
    order[j] = swap;
    for (j = n - 1; i < j; i++, j--) {
        swap = order[i];
        order[i] = order[j];
        order[j] = swap;
    }
    return true;
}

/* Two ticks of each loop and two of the operator's writes, in every order, from Cas, from the wait for it,
 * and from Auto and Man. */
/* Promise(modes/owner): In every order of writes a setpoint ends as its owner's. */
static void test_in_every_order_the_setpoint_ends_as_its_owner_s(void **state)
{
    const size_t n_requests = sizeof(requests) / sizeof(*requests);
    uint64_t orders = 0;

    (void)state;
    for (size_t first = 0; first < n_requests; first++) {
        enum who order[3 * EACH];
        struct cascade from;

        cascade_init(&from, 1);
        from.store.target[LOWER] = first == 0 ? APC_MODE_CAS : requests[first].mode;
        cascade_run(&from, first == 2 ? 1 : 24);
        for (int i = 0; i < 3 * EACH; i++)
            order[i] = (enum who)(i / EACH);
        do {
            for (size_t k = 0; k < n_requests * n_requests; k += PAIRS) {
                const struct request *request[2] = {&requests[k % n_requests], &requests[k / n_requests]};
                struct cascade w = from;
                unsigned nth[3] = {0, 0, 0};

                for (int i = 0; i < 3 * EACH; i++) {
                    step(&w, order[i], nth[order[i]], request[nth[order[i]] / 2]);
                    nth[order[i]]++;
                }
                cascade_run(&w, 22);
                must_be_owned(&w);
                cascade_must(&w,
                             request[1]->what != PUT || w.store.target[LOWER] != APC_MODE_AUTO ||
                                 (w.store.setpoint.value >=
                                  w.operator.value && w.store.setpoint.value <= w.operator.value),
                             "what the operator put last is in force");
                cascade_check(&w);
                orders++;
            }
        } while (permute(order, 3 * EACH));
    }
    print_message("%llu orders\n", (unsigned long long)orders);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_whatever_happens_in_whatever_order),
        cmocka_unit_test(test_in_every_order_the_setpoint_ends_as_its_owner_s),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}

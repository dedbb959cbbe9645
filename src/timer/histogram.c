/* SPDX-License-Identifier: BSD-3-Clause */
/*
 * A log-linear histogram of signed nanoseconds.
 *
 * Magnitudes below 256 have a bucket each; above, every octave has 128, so a bucket is never wider than
 * 1/128 of its value. Negative values mirror the positive ones. The array runs from -LIMIT to LIMIT with
 * zero in the middle.
 *
 * Buckets are zeroed when a value comes that needs them, from the middle on and on both sides: what is
 * measured lies near zero, and whoever makes histograms by the thousand, as a campaign does, writes little of
 * their 74 KB. Nobody reads a bucket beyond that reach.
 *
 * One writer, any readers, no locks
 * ---------------------------------
 * Buckets are counters of their own: relaxed atomics, stored by one thread. Count, sum, sum of squares,
 * minimum and maximum belong together and are kept twice: readers use copy[sequence & 1] while the writer
 * fills the other and then publishes it by adding 1 to sequence. A reader whose sequence is unchanged
 * after it has read saw one state and no other: the writer touches its copy only after sequence has moved
 * on, and since those stores release and the reader's loads acquire, a reader that met any of them also
 * meets the new sequence. A writer that is preempted or stopped half-way holds nobody up, whatever the
 * priorities. Retrying needs a record within each of the reader's few nanoseconds, so it ends.
 *
 * A bucket is counted before its value is published: a reader that takes the sums first, then the
 * buckets, finds at least as many values in the buckets as in the count.
 *
 * Sums are 128-bit integers, for a window is the difference of two running sums, and after a year of
 * ticks a difference of doubles has no digits left. With |value| < 2^42 they hold 2^41 values.
 */
#include "timer/timer_internal.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#define LIMIT_BITS 42
#define LIMIT      ((INT64_C(1) << LIMIT_BITS) - 1)
#define EXACT_BITS 8
#define EXACT      (1 << EXACT_BITS) /* magnitudes with a bucket of their own */
#define STEP_BITS  (EXACT_BITS - 1)
#define STEPS      (1 << STEP_BITS) /* buckets of an octave above them */
#define SIDE       (EXACT + (LIMIT_BITS - EXACT_BITS) * STEPS)
#define BUCKETS    (2 * SIDE - 1)
#define ZERO       (SIDE - 1)
#define PAGE       4096 /* no machine's are smaller */

__extension__ typedef __int128 wide;
__extension__ typedef unsigned __int128 uwide;

struct moments {
    uint64_t count;
    wide sum, squares;
    apc_ns min, max; /* INT64_MAX and INT64_MIN when there are none */
};

enum word { COUNT, SUM_LOW, SUM_HIGH, SQUARES_LOW, SQUARES_HIGH, MIN, MAX, WORDS };

struct apc_histogram {
    _Atomic uint64_t sequence;
    _Atomic uint64_t copy[2][WORDS];
    _Atomic int reach; /* so far from the middle buckets have been zeroed; it never becomes less */
    _Atomic uint64_t bucket[BUCKETS];
};

/* ---- Buckets ---- */

/* How far from the middle its bucket is. */
static int bucket_distance(apc_ns value)
{
    uint64_t magnitude = (uint64_t)(value < 0 ? -value : value);
    if (magnitude < EXACT)
        return (int)magnitude;
    int octave = 63 - __builtin_clzll(magnitude);
    return EXACT + (octave - EXACT_BITS) * STEPS + (int)(magnitude >> (octave - STEP_BITS)) - STEPS;
}

/* The values that bucket @at holds. */
static void bounds(int at, apc_ns *low, apc_ns *high)
{
    int index = at < ZERO ? ZERO - at : at - ZERO;
    apc_ns near = index, far = index; /* by magnitude */
    if (index >= EXACT) {
        int shift = (index - EXACT) / STEPS + EXACT_BITS - STEP_BITS;
        near = (apc_ns)(STEPS + (index - EXACT) % STEPS) << shift;
        far = near + (INT64_C(1) << shift) - 1;
    }
    *low = at < ZERO ? -far : near;
    *high = at < ZERO ? -near : far;
}

static uint64_t bucket_count(const struct apc_histogram *h, int at)
{
    return atomic_load_explicit(&h->bucket[at], memory_order_relaxed);
}

/* Not a read-modify-write: there is one writer. */
static void store_bucket_count(struct apc_histogram *h, int at, uint64_t count)
{
    atomic_store_explicit(&h->bucket[at], count, memory_order_relaxed);
}

/* Buckets of magnitudes that far from the middle may be used, on either side. */
static int bucket_reach(const struct apc_histogram *h)
{
    return atomic_load_explicit(&h->reach, memory_order_acquire);
}

static void extend_bucket_reach(struct apc_histogram *h, int far)
{
    const int before = bucket_reach(h);

    for (int i = before + 1; i <= far; i++) {
        store_bucket_count(h, ZERO - i, 0);
        store_bucket_count(h, ZERO + i, 0);
    }
    if (far > before)
        atomic_store_explicit(&h->reach, far, memory_order_release);
}

/* ---- Moments ---- */

static const struct moments no_moments = {.min = INT64_MAX, .max = INT64_MIN};

static wide join_words(uint64_t high, uint64_t low)
{
    return (wide)((uwide)high << 64 | low);
}

static uint64_t load_word(const _Atomic uint64_t *copy, enum word word)
{
    return atomic_load_explicit(&copy[word], memory_order_relaxed);
}

static void store_word(_Atomic uint64_t *copy, enum word word, uint64_t value)
{
    atomic_store_explicit(&copy[word], value, memory_order_release);
}

static struct moments read_moments(const struct apc_histogram *h)
{
    uint64_t word[WORDS], sequence;
    do {
        sequence = atomic_load_explicit(&h->sequence, memory_order_acquire);
        for (int i = 0; i < WORDS; i++)
            word[i] = atomic_load_explicit(&h->copy[sequence & 1][i], memory_order_acquire);
    } while (sequence != atomic_load_explicit(&h->sequence, memory_order_relaxed));
    return (struct moments){.count = word[COUNT],
                            .sum = join_words(word[SUM_HIGH], word[SUM_LOW]),
                            .squares = join_words(word[SQUARES_HIGH], word[SQUARES_LOW]),
                            .min = (apc_ns)word[MIN],
                            .max = (apc_ns)word[MAX]};
}

static void publish_moments(struct apc_histogram *h, const struct moments *m)
{
    const uint64_t word[WORDS] = {[COUNT] = m->count,
                                  [SUM_LOW] = (uint64_t)m->sum,
                                  [SUM_HIGH] = (uint64_t)((uwide)m->sum >> 64),
                                  [SQUARES_LOW] = (uint64_t)m->squares,
                                  [SQUARES_HIGH] = (uint64_t)((uwide)m->squares >> 64),
                                  [MIN] = (uint64_t)m->min,
                                  [MAX] = (uint64_t)m->max};
    uint64_t next = atomic_load_explicit(&h->sequence, memory_order_relaxed) + 1;
    for (int i = 0; i < WORDS; i++)
        atomic_store_explicit(&h->copy[next & 1][i], word[i], memory_order_release);
    atomic_store_explicit(&h->sequence, next, memory_order_release);
}

static void add_moments(struct moments *to, const struct moments *from)
{
    to->count += from->count;
    to->sum += from->sum;
    to->squares += from->squares;
    to->min = from->min < to->min ? from->min : to->min;
    to->max = from->max > to->max ? from->max : to->max;
}

/* ---- Public ---- */

int apc_histogram_create(struct apc_histogram **histogram)
{
    struct apc_histogram *h = malloc(sizeof *h);
    *histogram = h;
    if (!h)
        return APC_ENOMEM;
    for (size_t i = 0; i < sizeof *h; i += PAGE) /* no tick pays a page fault */
        ((volatile char *)h)[i] = 0;
    ((volatile char *)h)[sizeof *h - 1] = 0;
    atomic_init(&h->sequence, 0);
    atomic_init(&h->reach, 0);
    apc_histogram_clear(h);
    return 0;
}

void apc_histogram_clear(struct apc_histogram *histogram)
{
    const int far = bucket_reach(histogram);
    for (int at = ZERO - far; at <= ZERO + far; at++)
        store_bucket_count(histogram, at, 0);
    publish_moments(histogram, &no_moments);
}

void apc_histogram_destroy(struct apc_histogram *histogram)
{
    free(histogram);
}

/* Read and published word by word, without struct moments in between: recording is most of what a tick costs
 * in virtual time. The writer needs no retry, for nobody else changes its copies. */
void apc_histogram_record(struct apc_histogram *histogram, apc_ns value)
{
    const uint64_t sequence = atomic_load_explicit(&histogram->sequence, memory_order_relaxed);
    _Atomic uint64_t *from = histogram->copy[sequence & 1], *to = histogram->copy[(sequence + 1) & 1];

    value = value < -LIMIT ? -LIMIT : value > LIMIT ? LIMIT : value;
    const int far = bucket_distance(value), at = value < 0 ? ZERO - far : ZERO + far;
    if (far > atomic_load_explicit(&histogram->reach, memory_order_relaxed))
        extend_bucket_reach(histogram, far);
    store_bucket_count(histogram, at, bucket_count(histogram, at) + 1);
    wide sum = join_words(load_word(from, SUM_HIGH), load_word(from, SUM_LOW)) + value;
    wide squares =
        join_words(load_word(from, SQUARES_HIGH), load_word(from, SQUARES_LOW)) + (wide)value * value;
    apc_ns min = (apc_ns)load_word(from, MIN), max = (apc_ns)load_word(from, MAX);
    store_word(to, COUNT, load_word(from, COUNT) + 1);
    store_word(to, SUM_LOW, (uint64_t)sum);
    store_word(to, SUM_HIGH, (uint64_t)((uwide)sum >> 64));
    store_word(to, SQUARES_LOW, (uint64_t)squares);
    store_word(to, SQUARES_HIGH, (uint64_t)((uwide)squares >> 64));
    store_word(to, MIN, (uint64_t)(value < min ? value : min));
    store_word(to, MAX, (uint64_t)(value > max ? value : max));
    atomic_store_explicit(&histogram->sequence, sequence + 1, memory_order_release);
}

void apc_histogram_merge(struct apc_histogram *to, const struct apc_histogram *from)
{
    struct moments sum = read_moments(to), more = read_moments(from);

    const int far = bucket_reach(from);
    extend_bucket_reach(to, far);
    for (int at = ZERO - far; at <= ZERO + far; at++)
        store_bucket_count(to, at, bucket_count(to, at) + bucket_count(from, at));
    add_moments(&sum, &more);
    publish_moments(to, &sum);
}

void apc_histogram_window(struct apc_histogram *window, struct apc_histogram *mark,
                          const struct apc_histogram *live)
{
    struct moments now = read_moments(live), before = read_moments(mark), cut = now;
    const int far = bucket_reach(live); /* after its moments, so all that they count lies within */
    apc_ns low, high;
    bool filled = false;

    apc_histogram_clear(window);
    extend_bucket_reach(window, far);
    extend_bucket_reach(mark, far);
    for (int at = ZERO - far; at <= ZERO + far; at++) {
        uint64_t count = bucket_count(live, at), added = count - bucket_count(mark, at);
        store_bucket_count(window, at, added);
        store_bucket_count(mark, at, count);
        if (added == 0)
            continue;
        /* Extremes cannot be subtracted: take the buckets' edges, or the exact one if it is inside. */
        bounds(at, &low, &high);
        if (!filled)
            cut.min = low > now.min ? low : now.min;
        cut.max = high < now.max ? high : now.max;
        filled = true;
    }
    cut.count -= before.count;
    cut.sum -= before.sum;
    cut.squares -= before.squares;
    publish_moments(window, cut.count > 0 ? &cut : &no_moments);
    publish_moments(mark, &now);
}

/* Nearest rank: the smallest value that at least @permille of all do not exceed; the middle of its bucket. */
static apc_ns histogram_percentile(const struct apc_histogram *h, uint64_t total, unsigned permille,
                                   apc_ns min, apc_ns max)
{
    const int far = bucket_reach(h);
    uint64_t rank = (uint64_t)(((uwide)total * permille + 999) / 1000), seen = 0;
    for (int at = ZERO - far; at <= ZERO + far; at++) {
        seen += bucket_count(h, at);
        if (seen < rank || seen == 0)
            continue;
        apc_ns low, high;
        bounds(at, &low, &high);
        apc_ns middle = low + (high - low) / 2;
        return middle < min ? min : middle > max ? max : middle;
    }
    return max;
}

void apc_histogram_summary(const struct apc_histogram *histogram, struct apc_summary *summary)
{
    struct moments m = read_moments(histogram);
    uint64_t total = 0;

    *summary = (struct apc_summary){.count = m.count};
    if (m.count == 0)
        return;
    const int far = bucket_reach(histogram);
    for (int at = ZERO - far; at <= ZERO + far; at++)
        total += bucket_count(histogram, at);
    /* About the whole part of the mean the sum of squares is exact and small: nothing cancels. */
    wide whole = m.sum / (wide)m.count;
    wide rest = m.sum - whole * (wide)m.count;
    wide about = m.squares - 2 * whole * m.sum + whole * whole * (wide)m.count;
    double n = (double)m.count, fraction = (double)rest / n;
    double spread = (double)about - (double)rest * fraction;
    summary->mean = (double)whole + fraction;
    summary->sd = m.count > 1 && spread > 0 ? sqrt(spread / (n - 1)) : 0.0;
    summary->min = m.min;
    summary->max = m.max;
    summary->p50 = histogram_percentile(histogram, total, 500, m.min, m.max);
    summary->p99 = histogram_percentile(histogram, total, 990, m.min, m.max);
    summary->p999 = histogram_percentile(histogram, total, 999, m.min, m.max);
}

size_t apc_histogram_bins(const struct apc_histogram *histogram, struct apc_bin *bins, size_t capacity)
{
    const int far = bucket_reach(histogram);
    size_t filled = 0;
    for (int at = ZERO - far; at <= ZERO + far; at++) {
        uint64_t count = bucket_count(histogram, at);
        if (count == 0)
            continue;
        if (filled < capacity) {
            bounds(at, &bins[filled].low, &bins[filled].high);
            bins[filled].count = count;
        }
        filled++;
    }
    return filled;
}

/* SPDX-License-Identifier: BSD-3-Clause */
/*
 * Each column is written in each way that can hold it, and the shortest is kept: a clock's grid with jitter
 * leaves its jitter, seqs that count leave nothing, statuses that seldom change next to nothing. Noise has no
 * shorter form than its bits; but values of a converter are a grid as well: a + b k with whole k, to within a
 * few units of the last place, which are kept too. apc_pack() unpacks what it made, so a mistake here costs
 * room and never a sample.
 */
#include "shareddata/pack.h"

#include <endian.h>
#include <math.h>
#include <stdbool.h>
#include <stdlib.h>
#include <string.h>

#define XXH_INLINE_ALL
#include <xxhash.h>

#include "apcbase.h"

enum { ZEROS, LINE, PLAIN, GRID, STEPS, CONVERTER };
enum { FORMAT = 1, BLOCK = 128, FRACTION = 12, SUM = 4 };
enum { SUM_FOLLOWS = 0xff };
#define GRID_MAX ((int64_t)1 << 50) /* of start's distance and of a slope: their products stay below 2^62 */

/* ---- Writing -------------------------------------------------------------------------------- */

struct out {
    uint8_t *at;
    size_t n;
};

static void put_int8(struct out *o, int64_t value)
{
    const uint64_t big = htobe64((uint64_t)value);
    memcpy(o->at + o->n, &big, 8);
    o->n += 8;
}

static unsigned bit_width_of(uint64_t range)
{
    unsigned width = 0;
    while (width < 64 && range >> width != 0) {
        width++;
    }
    return width;
}

/* The low bits of numbers one after the other, each with its high bit first; width is not 0. */
static void put_packed_bits(struct out *o, const int64_t *x, size_t n, int64_t base, unsigned width)
{
    uint64_t rest = 0;
    unsigned held = 0; /* bits, below 64 */
    for (size_t i = 0; i < n; i++) {
        const uint64_t bits = (uint64_t)x[i] - (uint64_t)base;
        /* What is held stands at the high end of the rest. */
        rest |= width < 64 ? bits << (64 - width) >> held : bits >> held;
        if (held + width < 64) {
            held += width;
            continue;
        }
        put_int8(o, (int64_t)rest);
        const unsigned done = 64 - held;
        held = width - done;
        rest = held > 0 ? bits << (64 - held) : 0;
    }
    for (unsigned shift = 56; held > 0; shift -= 8) {
        o->at[o->n++] = (uint8_t)(rest >> shift);
        held -= held < 8 ? held : 8;
    }
}

static void put_packed_blocks(struct out *o, const int64_t *x, size_t n)
{
    for (size_t begin = 0; begin < n; begin += BLOCK) {
        const size_t m = n - begin < BLOCK ? n - begin : BLOCK;
        int64_t low = x[begin], high = x[begin];
        for (size_t i = begin + 1; i < begin + m; i++) {
            low = x[i] < low ? x[i] : low;
            high = x[i] > high ? x[i] : high;
        }
        const unsigned width = bit_width_of((uint64_t)high - (uint64_t)low);
        low = width == 64 ? 0 : low;
        put_int8(o, low);
        o->at[o->n++] = (uint8_t)width;
        if (width > 0) {
            put_packed_bits(o, x + begin, m, low, width);
        }
    }
}

static uint32_t chunk_sum(const uint8_t *bytes, size_t n)
{
    return htobe32((uint32_t)XXH3_64bits(bytes, n));
}

static bool is_line(const int64_t *x, size_t n, int64_t step)
{
    size_t i = 1;
    while (i < n && (int64_t)((uint64_t)x[i - 1] + (uint64_t)step) == x[i]) {
        i++;
    }
    return i == n;
}

/* Can x[n - 1] - x[0], and every difference, be told by 64 bits with a sign, with room for as much again? */
static bool is_narrow(const int64_t *x, size_t n)
{
    for (size_t i = 0; i < n; i++) {
        if (x[i] < -((int64_t)1 << 61) || x[i] > (int64_t)1 << 61) {
            return false;
        }
    }
    return true;
}

/* What the slope of the line through them is, by least squares. */
static int64_t slope_of(const int64_t *x, size_t n)
{
    const double middle = (double)(n - 1) / 2;
    double up = 0, across = 0;
    for (size_t i = 0; i < n; i++) {
        up += ((double)i - middle) * (double)(x[i] - x[0]);
        across += ((double)i - middle) * ((double)i - middle);
    }
    const double slope = up / across * (1 << FRACTION);
    return slope >= 0 && slope < (double)GRID_MAX ? (int64_t)slope : -1;
}

static void put_grid(struct out *o, const int64_t *x, size_t n, int64_t slope)
{
    int64_t rest[APC_PACK_MAX];
    for (size_t i = 0; i < n; i++) {
        rest[i] = x[i] - x[0] - ((int64_t)i * slope >> FRACTION);
    }
    o->at[o->n++] = GRID;
    put_int8(o, x[0]);
    put_int8(o, slope);
    put_packed_blocks(o, rest, n);
}

static void put_steps(struct out *o, const int64_t *x, size_t n)
{
    int64_t step[APC_PACK_MAX] = {0};
    for (size_t i = 1; i < n; i++) {
        step[i] = x[i] - x[i - 1];
    }
    o->at[o->n++] = STEPS;
    put_int8(o, x[0]);
    put_packed_blocks(o, step, n);
}

#define COLUMN_BYTES (17 + (APC_PACK_MAX / BLOCK) * (9 + BLOCK * 8))

/* Keeps what was written after @p mark if it is shorter than what the other has. */
static void keep_shorter(struct out *o, size_t mark, const struct out *other)
{
    if (other->n < o->n - mark) {
        memcpy(o->at + mark, other->at, other->n);
        o->n = mark + other->n;
    }
}

static void put_column(struct out *o, const int64_t *x, size_t n)
{
    const int64_t step = n > 1 ? (int64_t)((uint64_t)x[1] - (uint64_t)x[0]) : 0;
    const size_t mark = o->n;
    if (is_line(x, n, step)) {
        const bool zeros = x[0] == 0 && step == 0;
        o->at[o->n++] = zeros ? ZEROS : LINE;
        if (!zeros) {
            put_int8(o, x[0]);
            put_int8(o, step);
        }
        return;
    }
    o->at[o->n++] = PLAIN;
    put_packed_blocks(o, x, n);
    if (is_narrow(x, n)) {
        uint8_t bytes[COLUMN_BYTES];
        struct out other = {bytes, 0};
        put_steps(&other, x, n);
        keep_shorter(o, mark, &other);
        const int64_t slope = slope_of(x, n);
        if (slope >= 0) {
            other.n = 0;
            put_grid(&other, x, n, slope);
            keep_shorter(o, mark, &other);
        }
    }
}

/* ---- Values of a converter ------------------------------------------------------------------ */

static int by_rising_value(const void *a, const void *b)
{
    const double x = *(const double *)a, y = *(const double *)b;
    return (x > y) - (x < y);
}

#define CODES 16777216.0 /* a grid finer than that saves nothing */

/* The step of the grid on which all of the rising values lie, as nearly as doubles tell; 0: on none. Euclid's
 * way: what a distance leaves when it is measured by the step is the next step. */
static double grid_step_of(const double *value, size_t n)
{
    const double span = value[n - 1] - value[0];
    double step = span, steps = 0;
    for (size_t i = 1; i < n; i++) {
        step = value[i] - value[i - 1] < step ? value[i] - value[i - 1] : step;
    }
    for (size_t i = 1, tries = 0; i < n; i++) {
        const double times = (value[i] - value[i - 1]) / step, off = fabs(times - nearbyint(times));
        if (!(step > span / CODES) || tries > 16) {
            return 0;
        }
        steps += nearbyint(times);
        if (off > 0.02) {
            step *= off;
            steps = 0;
            i = 0;
            tries++;
        }
    }
    return span / steps;
}

static double rising_step(const int64_t *bits, size_t n, double *base)
{
    double value[APC_PACK_MAX] = {0};
    size_t different = 1;
    for (size_t i = 0; i < n; i++) {
        value[i] = apc_pack_value(bits[i]);
    }
    qsort(value, n, sizeof *value, by_rising_value);
    *base = value[0];
    for (size_t i = 1; i < n; i++) {
        if (value[i] != value[different - 1]) {
            value[different++] = value[i];
        }
        *base = fabs(value[i]) < fabs(*base) ? value[i] : *base;
    }
    const double span = value[different - 1] - value[0];
    return different > 1 && span < APC_VALUE_MAX ? grid_step_of(value, different) : 0;
}

/* Returns false where they are no converter's. */
static bool put_converter(struct out *o, const int64_t *bits, size_t n)
{
    int64_t code[APC_PACK_MAX], off[APC_PACK_MAX];
    double base = 0;
    const double step = rising_step(bits, n, &base);
    if (!(step > 0)) {
        return false;
    }
    for (size_t i = 0; i < n; i++) {
        code[i] = (int64_t)nearbyint((apc_pack_value(bits[i]) - base) / step);
        const double risen = step * (double)code[i];
        const int64_t near = apc_pack_bits(base + risen);
        if ((near < 0) != (bits[i] < 0)) {
            return false; /* a difference that 64 bits may not hold */
        }
        off[i] = bits[i] - near;
    }
    o->at[o->n++] = CONVERTER;
    put_int8(o, apc_pack_bits(base));
    put_int8(o, apc_pack_bits(step));
    put_column(o, code, n);
    put_column(o, off, n);
    return true;
}

static bool all_finite(const int64_t *bits, size_t n)
{
    size_t i = 0;
    while (i < n && isfinite(apc_pack_value(bits[i]))) {
        i++;
    }
    return i == n;
}

static void put_packed_values(struct out *o, const int64_t *bits, size_t n)
{
    const size_t mark = o->n;
    put_column(o, bits, n);
    uint8_t bytes[17 + 2 * COLUMN_BYTES];
    struct out other = {bytes, 0};
    if (o->n - mark > 2 * n && all_finite(bits, n) && put_converter(&other, bits, n)) {
        keep_shorter(o, mark, &other);
    }
}

size_t apc_pack(const struct apc_pack *samples, uint8_t bytes[APC_PACK_BYTES])
{
    struct out o = {bytes, 0};
    const size_t n = samples->n;
    if (n < 1 || n > APC_PACK_MAX) {
        return 0;
    }
    bytes[o.n++] = FORMAT;
    bytes[o.n++] = (uint8_t)(n >> 8);
    bytes[o.n++] = (uint8_t)n;
    for (size_t c = 0; c < APC_PACK_COLUMNS; c++) {
        if (c == APC_PACK_VALUE) {
            put_packed_values(&o, samples->at[c], n);
        } else {
            put_column(&o, samples->at[c], n);
        }
    }
    bytes[o.n++] = SUM_FOLLOWS;
    const uint32_t sum = chunk_sum(bytes, o.n);
    memcpy(bytes + o.n, &sum, SUM);
    o.n += SUM;
    struct apc_pack back;
    bool same = apc_unpack(bytes, o.n, &back) == 0 && back.n == n;
    for (size_t c = 0; c < APC_PACK_COLUMNS && same; c++) {
        same = memcmp(samples->at[c], back.at[c], n * sizeof back.at[c][0]) == 0;
    }
    return same ? o.n : 0;
}

/* ---- Reading -------------------------------------------------------------------------------- */

struct in {
    const uint8_t *at;
    size_t left;
};

static int get_int8(struct in *in, int64_t *out)
{
    if (in->left < 8) {
        return APC_EPROTO;
    }
    uint64_t big;
    memcpy(&big, in->at, 8);
    *out = (int64_t)be64toh(big);
    in->at += 8;
    in->left -= 8;
    return 0;
}

/* 64 bits from a bit on; what would lie beyond the end is 0. */
static uint64_t bits_at(const uint8_t *at, size_t length, size_t bit)
{
    const unsigned shift = bit % 8;
    const size_t left = length - bit / 8;
    uint8_t end[9] = {0};
    uint64_t big;
    at += bit / 8;
    if (left < sizeof end) {
        memcpy(end, at, left);
        at = end;
    }
    memcpy(&big, at, 8);
    return be64toh(big) << shift | (uint64_t)at[8] >> (8 - shift);
}

static int get_block(struct in *in, int64_t *x, size_t n)
{
    int64_t base = 0;
    if (get_int8(in, &base) != 0 || in->left < 1) {
        return APC_EPROTO;
    }
    const unsigned width = *in->at;
    in->at++;
    in->left--;
    const size_t length = (n * width + 7) / 8;
    if (width > 64 || length > in->left) {
        return APC_EPROTO;
    }
    for (size_t i = 0; i < n; i++) {
        const uint64_t bits = width > 0 ? bits_at(in->at, length, i * width) >> (64 - width) : 0;
        x[i] = (int64_t)((uint64_t)base + bits);
    }
    in->at += length;
    in->left -= length;
    return 0;
}

static int get_blocks(struct in *in, int64_t *x, size_t n)
{
    int err = 0;
    for (size_t begin = 0; begin < n && !err; begin += BLOCK) {
        err = get_block(in, x + begin, n - begin < BLOCK ? n - begin : BLOCK);
    }
    return err;
}

static int get_column(struct in *in, int64_t *x, size_t n)
{
    int64_t start = 0, slope = 0;
    if (in->left < 1) {
        return APC_EPROTO;
    }
    const unsigned mode = *in->at;
    in->at++;
    in->left--;
    if (mode > STEPS || ((mode == LINE || mode >= GRID) && get_int8(in, &start) != 0) ||
        ((mode == LINE || mode == GRID) && get_int8(in, &slope) != 0) ||
        (mode == GRID && (slope < 0 || slope > GRID_MAX)) || (mode >= PLAIN && get_blocks(in, x, n) != 0)) {
        return APC_EPROTO;
    }
    uint64_t *const u = (uint64_t *)x; /* as numbers that wrap */
    if (mode == GRID) {
        for (size_t i = 0; i < n; i++) {
            u[i] += (uint64_t)start + (uint64_t)((int64_t)i * slope >> FRACTION);
        }
    } else if (mode == STEPS) {
        for (size_t i = 0; i < n; i++) {
            u[i] += i > 0 ? u[i - 1] : (uint64_t)start;
        }
    } else if (mode == ZEROS) {
        memset(x, 0, n * sizeof *x);
    } else if (mode == LINE) {
        for (size_t i = 0; i < n; i++) {
            u[i] = (uint64_t)start + i * (uint64_t)slope;
        }
    }
    return 0;
}

static int get_values(struct in *in, int64_t *x, size_t n)
{
    if (in->left < 1 || *in->at != CONVERTER) {
        return get_column(in, x, n);
    }
    in->at++;
    in->left--;
    int64_t base = 0, step = 0, off[APC_PACK_MAX];
    if (get_int8(in, &base) != 0 || get_int8(in, &step) != 0 || get_column(in, x, n) != 0 ||
        get_column(in, off, n) != 0) {
        return APC_EPROTO;
    }
    for (size_t i = 0; i < n; i++) {
        const double risen = apc_pack_value(step) * (double)x[i]; /* rounded by itself: no fused operation */
        const int64_t near = apc_pack_bits(apc_pack_value(base) + risen);
        x[i] = (int64_t)((uint64_t)near + (uint64_t)off[i]);
    }
    return 0;
}

/* Is what is left the sum of what has been read? Chunks of before there were sums end here. */
static bool is_sum_right(const struct in *in, const uint8_t *bytes)
{
    if (in->left == 0) {
        return true;
    }
    const uint32_t sum = chunk_sum(bytes, (size_t)(in->at - bytes) + 1);
    return in->left == 1 + SUM && in->at[0] == SUM_FOLLOWS && memcmp(in->at + 1, &sum, SUM) == 0;
}

int apc_unpack(const uint8_t *bytes, size_t length, struct apc_pack *samples)
{
    struct in in = {bytes, length};
    if (length < 3 || bytes[0] != FORMAT) {
        return APC_EPROTO;
    }
    const size_t n = (size_t)bytes[1] << 8 | bytes[2];
    in.at += 3;
    in.left -= 3;
    if (n < 1 || n > APC_PACK_MAX) {
        return APC_EPROTO;
    }
    int err = 0;
    for (size_t c = 0; c < APC_PACK_COLUMNS && !err; c++) {
        err = c == APC_PACK_VALUE ? get_values(&in, samples->at[c], n) : get_column(&in, samples->at[c], n);
    }
    samples->n = n;
    return err || !is_sum_right(&in, bytes) ? APC_EPROTO : 0;
}

/* ---- What a row says of a chunk --------------------------------------------------------------- */

void apc_pack_summarize(const struct apc_pack *samples, struct apc_pack_summary *s)
{
    *s = (struct apc_pack_summary){.since = INT64_MAX, .until = INT64_MIN};
    for (size_t i = 0; i < samples->n; i++) {
        const int64_t time = samples->at[APC_PACK_TIME][i], status = samples->at[APC_PACK_STATUS][i];
        s->since = time < s->since ? time : s->since;
        s->until = time > s->until ? time : s->until;
        s->worst = status > s->worst ? status : s->worst;
        if (apc_status_severity((apc_status)status) == APC_SEVERITY_BAD) {
            continue;
        }
        const double value = apc_pack_value(samples->at[APC_PACK_VALUE][i]);
        s->good++;
        s->lowest = s->good == 1 || value < s->lowest ? value : s->lowest;
        s->highest = s->good == 1 || value > s->highest ? value : s->highest;
        s->mean += (value - s->mean) / (double)s->good;
        s->last = value;
        s->final = samples->first + (int64_t)i;
    }
}

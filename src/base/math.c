/* SPDX-License-Identifier: BSD-3-Clause */
/*
 * Elementary functions of IEEE basic operations alone. Each reduces its argument to a short interval around a
 * value that stands in a table as a sum of two doubles, and adds a polynomial of what is left. Where the sum
 * of rounding errors would come near one unit in the last place, a number is a sum of two: `high` is the
 * number rounded, `low` what is missing (Dekker 1971). The compiler must not contract a * b + c
 * (cmake/flags.cmake).
 */
#include <apcmath.h>

#include <math.h>
#include <stdint.h>
#include <string.h>

#include "math_tables.h"

struct sum {
    double high, low;
};

static inline uint64_t double_bits(double x)
{
    uint64_t bits;
    memcpy(&bits, &x, sizeof bits);
    return bits;
}

static inline double double_of_bits(uint64_t bits)
{
    double x;
    memcpy(&x, &bits, sizeof x);
    return x;
}

/* 2^k, of normal numbers */
static inline double two_to(int k)
{
    return double_of_bits((uint64_t)(k + 1023) << 52);
}

/* To the nearest whole number, of |x| < 2^51. */
static inline double nearest_whole(double x)
{
    const double shift = 0x1.8p52;
    return x + shift - shift;
}

/* a + b, where |a| >= |b| or a is 0 */
static inline struct sum exact_sum_of_ordered(double a, double b)
{
    const double s = a + b;
    return (struct sum){s, a - s + b};
}

/* a + b (Knuth) */
static inline struct sum exact_sum(double a, double b)
{
    const double s = a + b, part = s - a;
    return (struct sum){s, (a - (s - part)) + (b - part)};
}

/* The upper 26 bits; |x| < 2^996. */
static inline double upper_half(double x)
{
    const double c = 0x1.0000002p27 * x;
    return c - (c - x);
}

/* a b (Dekker); neither it nor its parts may overflow or become subnormal */
static inline struct sum product_of(double a, double b)
{
    const double p = a * b, a1 = upper_half(a), a2 = a - a1, b1 = upper_half(b), b2 = b - b1;
    return (struct sum){p, a1 * b1 - p + a1 * b2 + a2 * b1 + a2 * b2};
}

/* What a / b, rounded to q, leaves of a; it is a double. */
static inline double quotient_rest(double a, double q, double b)
{
    const struct sum p = product_of(q, b);
    return a - p.high - p.low;
}

/* ---- exp ------------------------------------------------------------------------------------- */

#define EXP_MOST  0x1.62e42fefa39efp+9  /* exp of more is infinite */
#define EXP_LEAST -0x1.74910d52d3052p+9 /* of less it is 0 */

/* value 2^k, 0.5 < value < 4, -1076 <= k <= 1024 */
static inline double times_two_to(double value, int k)
{
    if (k > 1000)
        return value * 0x1p1000 * two_to(k - 1000);
    if (k < -1000)
        return value * two_to(k + 1000) * 0x1p-1000;
    return value * two_to(k);
}

/* Of x = k ln 2 / 128 + r: k, and exp(r) - 1 of what is left, |r| <= ln 2 / 256. */
static inline int exp_reduce(double high, double low, double *p)
{
    const double k = nearest_whole(high * (128.0 * INV_LN2_HIGH));
    const double r = high - k * LN2_128_HIGH - k * LN2_128_LOW + low;
    *p = r + r * r * (1.0 / 2 + r * (1.0 / 6 + r * (1.0 / 24 + r * (1.0 / 120 + r * (1.0 / 720)))));
    return (int)k;
}

/* exp(high + low), within EXP_LEAST to EXP_MOST */
static inline double exp_of_sum(double high, double low)
{
    double p;
    const int k = exp_reduce(high, low, &p), j = k & 127;
    const double *t = exp_table[j];
    return times_two_to(t[0] + (t[1] + t[0] * p), (k - j) / 128);
}

double apc_exp(double x)
{
    if (x > EXP_MOST)
        return (double)INFINITY;
    if (x < EXP_LEAST)
        return 0.0;
    return x == x ? exp_of_sum(x, 0.0) : x;
}

/* (exp(x) - 1 - x) / x^2, |x| < 1 / 16 */
static double expm1_rest(double x)
{
    static const double inverse[] = {1.0 / 2,    1.0 / 6,     1.0 / 24,     1.0 / 120,    1.0 / 720,
                                     1.0 / 5040, 1.0 / 40320, 1.0 / 362880, 1.0 / 3628800};
    double sum = 1.0 / 39916800;
    for (int n = 10; n >= 2; n--)
        sum = sum * x + inverse[n - 2];
    return sum;
}

double apc_expm1(double x)
{
    if (!(fabs(x) >= 0x1p-54))
        return x; /* NaN, too */
    if (x > EXP_MOST)
        return (double)INFINITY;
    if (x < -40.0)
        return -1.0;
    if (fabs(x) < 0x1p-4)
        return x + x * x * expm1_rest(x);
    double p;
    const int k = exp_reduce(x, 0.0, &p), j = k & 127, m = (k - j) / 128;
    if (m > 60)
        return exp_of_sum(x, 0.0);
    const double *t = exp_table[j], scale = two_to(m);
    const struct sum whole = exact_sum(scale * t[0], -1.0);
    return whole.high + (whole.low + scale * (t[1] + t[0] * p));
}

/* ---- log ------------------------------------------------------------------------------------- */

/* x = 2^k z, z = c (1 + r), with 1 / c of 10 bits: log x = k ln 2 + log c + log(1 + r). */
struct log_parts {
    double high, low; /* k ln 2 + log c; high is a multiple of 2^-42 */
    struct sum r;
};

/* of 0 < x < infinity */
static inline struct log_parts log_reduce(double x)
{
    const uint64_t first = UINT64_C(0x3fe6800000000000),
                   one = UINT64_C(0x3ff0000000000000); /* of 90 / 128, 1 */
    const bool small = x < 0x1p-1022;
    const uint64_t bits = double_bits(small ? x * 0x1p54 : x),
                   above = bits + one - first; /* k + 1023 in its exponent */
    const double k = (double)((int)(above >> 52) - 1023 - (small ? 54 : 0));
    const uint64_t within = bits - (above & ~UINT64_C(0xfffffffffffff)) + one;
    const double z = double_of_bits(within), z1 = double_of_bits(within & ~UINT64_C(0x7ffffff));
    const double *t = log_table[(int)(z * 128.0 + 0.5) - 90];
    return (struct log_parts){k * LN2_HIGH + t[1], k * LN2_LOW + t[2],
                              exact_sum(z1 * t[0] - 1.0, (z - z1) * t[0])};
}

/* Is x no number above 0? Then *log is what its logarithm is. */
static bool log_special(double x, double *log)
{
    if (x > 0.0 && x <= 0x1.fffffffffffffp+1023)
        return false;
    *log = x == 0.0 ? -(double)INFINITY : x < 0.0 ? (double)NAN : x;
    return true;
}

/* (log(1 + r) - r + r^2 / 2) / r^3 */
static inline double log_rest(double r)
{
    const double z = r * r, a = 1.0 / 3 - r / 4, b = 1.0 / 5 - r * (1.0 / 6),
                 c = 1.0 / 7 - r / 8 + z * (1.0 / 9);
    return a + z * (b + z * c);
}

double apc_log(double x)
{
    double special;
    if (log_special(x, &special))
        return special;
    const struct log_parts l = log_reduce(x);
    const double r = l.r.high, left = l.r.low;
    const struct sum s = exact_sum_of_ordered(l.high, r);
    return s.high + (s.low + (l.low + (left + r * r * (r * log_rest(r) - 0.5))));
}

/* To some 70 bits, of 0 < x < infinity. */
static inline struct sum log_sum(double x)
{
    const struct log_parts l = log_reduce(x);
    const double r = l.r.high, left = l.r.low;
    const struct sum square = product_of(r, r), s = exact_sum_of_ordered(l.high, r),
                     t = exact_sum(s.high, -0.5 * square.high);
    const double low =
        s.low + t.low + (l.low + (left - r * left - 0.5 * square.low + square.high * r * log_rest(r)));
    return exact_sum_of_ordered(t.high, low);
}

/* (a.high + a.low) (high + low) */
static inline double sum_times(struct sum a, double high, double low)
{
    const struct sum p = product_of(a.high, high);
    return p.high + (p.low + (a.high * low + a.low * high));
}

double apc_log2(double x)
{
    double special;
    return log_special(x, &special) ? special : sum_times(log_sum(x), INV_LN2_HIGH, INV_LN2_LOW);
}

double apc_log10(double x)
{
    double special;
    return log_special(x, &special) ? special : sum_times(log_sum(x), INV_LN10_HIGH, INV_LN10_LOW);
}

/* ---- pow ------------------------------------------------------------------------------------- */

/* 0: y is not whole; 1: odd; 2: even */
static int whole_parity(double y)
{
    const double size = fabs(y);
    if (size >= 0x1p53)
        return 2;
    if (size < 1.0)
        return size == 0.0 ? 2 : 0;
    const int64_t whole = (int64_t)size;
    return (double)whole != size ? 0 : whole % 2 ? 1 : 2;
}

/* Where x or y is 0, infinite, NaN, or x below 0 and y not whole. */
static double pow_special(double x, double y, int whole)
{
    const double size = fabs(x), sign = x < 0.0 || (x == 0.0 && signbit(x)) ? -1.0 : 1.0;
    if (isinf(y))
        return size == 1.0 ? 1.0 : (size > 1.0) == (y > 0.0) ? (double)INFINITY : 0.0;
    if (size == 0.0 || isinf(size)) {
        const double value = (size == 0.0) == (y > 0.0) ? 0.0 : (double)INFINITY;
        return whole == 1 ? copysign(value, sign) : value;
    }
    return (double)NAN;
}

double apc_pow(double x, double y)
{
    if (y == 0.0 || x == 1.0)
        return 1.0;
    if (x != x || y != y)
        return x + y;
    if (y == 1.0 || y == 2.0)
        return y == 1.0 ? x : x * x;
    const int whole = whole_parity(y);
    if (x == 0.0 || isinf(x) || isinf(y) || (x < 0.0 && whole == 0))
        return pow_special(x, y, whole);
    const double size = fabs(x), sign = x < 0.0 && whole == 1 ? -1.0 : 1.0;
    if (size == 1.0)
        return sign;
    if (fabs(y) > 0x1p64)
        return (size > 1.0) == (y > 0.0) ? sign * (double)INFINITY : sign * 0.0;
    const struct sum l = log_sum(size);
    if (fabs(y * l.high) < 0x1p-60)
        return sign;
    struct sum p = product_of(y, l.high);
    p.low += y * l.low;
    p = exact_sum_of_ordered(p.high, p.low);
    if (p.high > EXP_MOST)
        return sign * (double)INFINITY;
    if (p.high < EXP_LEAST)
        return sign * 0.0;
    return sign * exp_of_sum(p.high, p.low);
}

/* ---- sin, cos -------------------------------------------------------------------------------- */

/* The angle without its quarter turns, by the bits of 2 / pi (Payne and Hanek): of |x| >= 2^25. */
static int quarter_turns_far(double x, struct sum *r)
{
    const uint64_t bits = double_bits(x), mantissa = (bits & UINT64_C(0xfffffffffffff)) | UINT64_C(1) << 52;
    const uint64_t exponent = bits >> 52 & 2047; /* |x| = mantissa 2^(exponent - 1075), exponent >= 1048 */
    /* x 2 / pi modulo 4: bits of 2 / pi before number exponent - 1077 make whole turns. They are read as of a
     * number with 32 zeros in front, from word `first` on. */
    const unsigned from = (unsigned)(exponent - 1045) & 1023, first = from / 32, shift = from % 32;
    uint32_t window[6];
    for (unsigned k = 0; k < 6; k++) {
        const uint64_t two =
            (uint64_t)(first + k > 0 ? two_pi_bits[first + k - 1] : 0) << 32 | two_pi_bits[first + k];
        window[k] = (uint32_t)(two >> (32 - shift));
    }
    /* product of it and the mantissa, modulo 2^192: two bits of quarter turns, and the fraction behind them
     */
    uint32_t product[6];
    uint64_t low_carry = 0, high_carry = 0;
    for (int k = 5; k >= 0; k--) {
        low_carry += window[k] * (mantissa & UINT32_MAX);
        high_carry += (low_carry & UINT32_MAX) + (k < 5 ? window[k + 1] * (mantissa >> 32) : 0);
        product[k] = (uint32_t)high_carry;
        low_carry >>= 32;
        high_carry >>= 32;
    }
    int quarter = (int)(product[0] >> 30);
    uint64_t high = (uint64_t)product[0] << 34 | (uint64_t)product[1] << 2 | product[2] >> 30,
             low = (uint64_t)product[2] << 34 | (uint64_t)product[3] << 2 | product[4] >> 30;
    const bool back = high >> 63;
    if (back) { /* the next quarter is nearer */
        quarter++;
        low = -low;
        high = ~high + (low == 0);
    }
    /* the fraction as a sum: 32 bits each are exact */
    const double a = (double)(high >> 32) * 0x1p-32, b = (double)(high & 0xffffffff) * 0x1p-64,
                 c = (double)(low >> 32) * 0x1p-96 + (double)(low & 0xffffffff) * 0x1p-128;
    const struct sum ab = exact_sum_of_ordered(a, b), rest = exact_sum(ab.low, c),
                     f = exact_sum_of_ordered(ab.high, rest.high);
    const struct sum p = product_of(f.high, PI_2_HIGH);
    const struct sum angle =
        exact_sum_of_ordered(p.high, p.low + (f.high * PI_2_LOW + (f.low + rest.low) * PI_2_HIGH));
    const double sign = (x < 0.0) == back ? 1.0 : -1.0;
    *r = (struct sum){sign * angle.high, sign * angle.low};
    return x < 0.0 ? -quarter : quarter;
}

/* x = quarter pi / 2 + r, |r| <= pi / 4 and a little; of finite x. Returns quarter, any multiple of 4 off. */
static int quarter_turns(double x, struct sum *r)
{
    static const double part[4] = PI_2_PARTS;
    if (fabs(x) <= PI_2_HIGH / 2) {
        *r = (struct sum){x, 0.0};
        return 0;
    }
    if (fabs(x) >= 0x1p25)
        return quarter_turns_far(x, r);
    const double n = nearest_whole(x * TWO_PI_INVERSE);
    const struct sum s = exact_sum(x - n * part[0], -n * part[1]), t = exact_sum(s.high, -n * part[2]),
                     u = exact_sum(t.high, s.low), v = exact_sum(u.high, t.low);
    *r = exact_sum_of_ordered(v.high, v.low + u.low - n * part[3]);
    return (int)n;
}

static double sine_near(struct sum r)
{
    const double z = r.high * r.high;
    const double rest =
        -1.0 / 6 +
        z * (1.0 / 120 +
             z * (-1.0 / 5040 +
                  z * (1.0 / 362880 + z * (-1.0 / 39916800 +
                                           z * (1.0 / 6227020800.0 + z * (-1.0 / 1307674368000.0 +
                                                                          z * (1.0 / 355687428096000.0)))))));
    return r.high + (r.high * z * rest + r.low * (1.0 - 0.5 * z));
}

static double cosine_near(struct sum r)
{
    const double z = r.high * r.high, half = 0.5 * z, most = 1.0 - half;
    const double rest =
        1.0 / 24 +
        z * (-1.0 / 720 +
             z * (1.0 / 40320 +
                  z * (-1.0 / 3628800 +
                       z * (1.0 / 479001600 + z * (-1.0 / 87178291200.0 + z * (1.0 / 20922789888000.0))))));
    return most + (1.0 - most - half + (z * z * rest - r.high * r.low));
}

static double sine_ahead(double x, int ahead)
{
    struct sum r;
    if (!(fabs(x) <= 0x1.fffffffffffffp+1023))
        return (double)NAN;
    const int quarter = quarter_turns(x, &r) + ahead;
    const double value = quarter & 1 ? cosine_near(r) : sine_near(r);
    return quarter & 2 ? -value : value;
}

double apc_sin(double x)
{
    return fabs(x) < 0x1p-27 ? x : sine_ahead(x, 0);
}

double apc_cos(double x)
{
    return sine_ahead(x, 1);
}

/* ---- atan ------------------------------------------------------------------------------------ */

/* atan(x.high + x.low) of 0 <= x <= 1 as a sum */
static struct sum atan_near(struct sum x)
{
    const int i = (int)(x.high * 64.0 + 0.5);
    const double c = i / 64.0, above = x.high - c;
    const struct sum p = product_of(x.high, c), below = exact_sum_of_ordered(1.0, p.high);
    const double inverse = 1.0 / below.high, t = above * inverse, z = t * t;
    const double left = (quotient_rest(above, t, below.high) + x.low - t * (below.low + p.low)) * inverse;
    const double rest = -1.0 / 3 + z * (1.0 / 5 + z * (-1.0 / 7 + z * (1.0 / 9)));
    const struct sum s = exact_sum_of_ordered(atan_table[i][0], t);
    return exact_sum_of_ordered(s.high, s.low + (atan_table[i][1] + left + t * z * rest));
}

/* a / b as a sum, of numbers whose products neither overflow nor vanish */
static struct sum quotient_of(double a, double b)
{
    const double q = a / b;
    return (struct sum){q, quotient_rest(a, q, b) / b};
}

/* The angle of a point, of a, b >= 0 and not both 0, neither infinite: atan(a / b). */
static struct sum angle_of_point(double a, double b)
{
    if (a * 0x1p60 < b) /* the angle itself */
        return (struct sum){a / b, 0.0};
    if (b * 0x1p60 < a)
        return (struct sum){PI_2_HIGH, PI_2_LOW};
    if (a > 0x1p500 || b > 0x1p500) { /* far out, or else far in */
        a *= 0x1p-600;
        b *= 0x1p-600;
    } else if (a < 0x1p-400 && b < 0x1p-400) {
        a *= 0x1p600;
        b *= 0x1p600;
    }
    if (a <= b)
        return atan_near(quotient_of(a, b));
    const struct sum other = atan_near(quotient_of(b, a)), s = exact_sum_of_ordered(PI_2_HIGH, -other.high);
    return exact_sum_of_ordered(s.high, s.low + (PI_2_LOW - other.low));
}

double apc_atan(double x)
{
    if (x != x || fabs(x) < 0x1p-27)
        return x;
    const double size = fabs(x);
    const struct sum a = size <= 1.0 ? atan_near((struct sum){size, 0.0})
                         : isinf(x)  ? (struct sum){PI_2_HIGH, PI_2_LOW}
                                     : angle_of_point(size, 1.0);
    return copysign(a.high + a.low, x);
}

double apc_atan2(double y, double x)
{
    if (x != x || y != y)
        return x + y;
    double a = fabs(y), b = fabs(x);
    if (isinf(a) || isinf(b)) {
        a = isinf(a) ? 1.0 : 0.0;
        b = isinf(b) ? 1.0 : 0.0;
    }
    struct sum angle = a == 0.0 && b == 0.0 ? (struct sum){0.0, 0.0} : angle_of_point(a, b);
    if (signbit(x)) {
        const struct sum s = exact_sum_of_ordered(PI_HIGH, -angle.high);
        angle = (struct sum){s.high, s.low + (PI_LOW - angle.low)};
    }
    return copysign(angle.high + angle.low, y);
}

/* ---- hypot ----------------------------------------------------------------------------------- */

double apc_hypot(double x, double y)
{
    if (isinf(x) || isinf(y))
        return (double)INFINITY;
    if (x != x || y != y)
        return x + y;
    x = fabs(x);
    y = fabs(y);
    double a = x > y ? x : y, b = x > y ? y : x, unit = 1.0;
    if (b * 0x1p60 < a || b == 0.0)
        return a;
    if (a > 0x1p500 || b < 0x1p-400) {
        unit = a > 0x1p500 ? 0x1p600 : 0x1p-600;
        a /= unit;
        b /= unit;
    }
    const struct sum aa = product_of(a, a), bb = product_of(b, b), s = exact_sum_of_ordered(aa.high, bb.high);
    const double h = sqrt(s.high);
    const struct sum hh = product_of(h, h);
    return (h + (s.high - hh.high + (s.low + aa.low + bb.low - hh.low)) / (2.0 * h)) * unit;
}

/* ---- lgamma ---------------------------------------------------------------------------------- */

/* Stirling's series, from 12 on; below by log gamma(x) = log gamma(x + 1) - log x. */
double apc_lgamma(double x)
{
    static const double half_log_2_pi = 0x1.d67f1c864beb5p-1;
    double product = 1.0;
    if (!(x > 0.0) || isinf(x))
        return x > 0.0 ? x : (double)NAN;
    while (x < 12.0) {
        product *= x;
        x += 1.0;
    }
    const double i = 1.0 / x, z = i * i;
    const double rest =
        1.0 / 12 +
        z * (-1.0 / 360 + z * (1.0 / 1260 + z * (-1.0 / 1680 + z * (1.0 / 1188 + z * (-691.0 / 360360)))));
    return (x - 0.5) * apc_log(x) - x + half_log_2_pi + i * rest - apc_log(product);
}

/* SPDX-License-Identifier: BSD-3-Clause */
#include "apcbase.h"

#include <math.h>
#include <stdatomic.h>
#include <time.h>

static apc_ns read_system_clock(clockid_t id)
{
    struct timespec t;
    clock_gettime(id, &t); /* cannot fail for these clocks and a valid pointer */
    return t.tv_sec * APC_NS_PER_S + t.tv_nsec;
}

static apc_ns system_mono(void *ctx)
{
    (void)ctx;
    return read_system_clock(CLOCK_MONOTONIC);
}

static apc_ns system_utc(void *ctx)
{
    (void)ctx;
    return read_system_clock(CLOCK_REALTIME);
}

static const struct apc_clock system_clock = {system_mono, system_utc, NULL};

const struct apc_clock *apc_clock_system(void)
{
    return &system_clock;
}

apc_ns apc_clock_mono(const struct apc_clock *clock)
{
    return clock ? clock->mono(clock->ctx) : system_mono(NULL);
}

/* One of the process: a time that some of its parts did not follow would be a second one. */
static _Atomic(const struct apc_clock *) followed;

void apc_clock_follow(const struct apc_clock *clock)
{
    atomic_store_explicit(&followed, clock, memory_order_release);
}

static const struct apc_clock *followed_clock(void)
{
    return atomic_load_explicit(&followed, memory_order_acquire);
}

apc_ns apc_clock_utc(const struct apc_clock *clock)
{
    clock = clock ? clock : followed_clock();
    return clock ? clock->utc(clock->ctx) : system_utc(NULL);
}

apc_ns apc_clock_plant(void)
{
    const struct apc_clock *clock = followed_clock();
    return clock ? clock->utc(clock->ctx) : system_mono(NULL);
}

/* Of a few readings the one that took least: the others may have been interrupted half-way. */
apc_ns apc_clock_offset(const struct apc_clock *utc, const struct apc_clock *mono)
{
    apc_ns offset = 0, least = INT64_MAX;
    for (int i = 0; i < 5; i++) {
        apc_ns before = apc_clock_mono(mono), wall = apc_clock_utc(utc), took = apc_clock_mono(mono) - before;
        if (took < least) {
            least = took;
            offset = (apc_ns)((uint64_t)wall - (uint64_t)(before + took / 2));
        }
    }
    return offset;
}

int apc_ns_from_s(double seconds, apc_ns *ns)
{
    const double limit = 9.2e9; /* 2^63 ns is 9.22e9 s */
    if (!ns || !(fabs(seconds) <= limit))
        return APC_EINVAL;
    /* whole seconds apart: a Unix time in seconds times 1e9 would lose the last 7 bits */
    double whole = trunc(seconds);
    *ns = (apc_ns)whole * APC_NS_PER_S + (apc_ns)llround((seconds - whole) * 1e9);
    return 0;
}

double apc_ns_to_s(apc_ns ns)
{
    apc_ns whole = ns / APC_NS_PER_S;
    return (double)whole + (double)(ns - whole * APC_NS_PER_S) * 1e-9;
}

int apc_period_from_s(double seconds, apc_ns *period, struct apc_error *why)
{
    apc_ns ns;
    if (!period)
        return apc_fail(why, APC_EINVAL, "no place for the period");
    if (apc_ns_from_s(seconds, &ns) < 0 || ns < 10 * APC_NS_PER_US ||
        ns > INT64_C(366) * 86400 * APC_NS_PER_S)
        return apc_fail(why, APC_EINVAL, "period %g s: must be from 1e-05 s (10 us) to 31622400 s (366 days)",
                        seconds);
    *period = ns;
    return 0;
}

/* Days since 1970-01-01 of a date in the proleptic Gregorian calendar, and back. Years are counted from
 * March, so that the leap day is the last of the year, in eras of 400 years of 146097 days each. */
static int64_t days_from_date(int64_t year, int month, int day)
{
    int64_t y = month <= 2 ? year - 1 : year;
    int64_t era = (y >= 0 ? y : y - 399) / 400;
    int64_t year_of_era = y - era * 400;
    int64_t day_of_year = (153 * (month > 2 ? month - 3 : month + 9) + 2) / 5 + day - 1;
    return era * 146097 + year_of_era * 365 + year_of_era / 4 - year_of_era / 100 + day_of_year - 719468;
}

static void date_from_days(int64_t days, uint32_t *year, uint32_t *month, uint32_t *day)
{
    int64_t z = days + 719468;
    int64_t era = (z >= 0 ? z : z - 146096) / 146097;
    uint32_t doe = (uint32_t)(z - era * 146097); /* below 2^32: half the time of 64-bit divisions */
    uint32_t yoe = (doe - doe / 1460 + doe / 36524 - doe / 146096) / 365;
    uint32_t doy = doe - (365 * yoe + yoe / 4 - yoe / 100);
    uint32_t mp = (5 * doy + 2) / 153;
    *day = doy - (153 * mp + 2) / 5 + 1;
    *month = mp < 10 ? mp + 3 : mp - 9;
    *year = (uint32_t)(yoe + era * 400 + (*month <= 2));
}

/* Two decimal digits and @end, into text; where the next piece goes. */
static char *put_two_digits(char *text, uint32_t value, char end)
{
    text[0] = (char)('0' + value / 10);
    text[1] = (char)('0' + value % 10);
    text[2] = end;
    return text + 3;
}

char *apc_time_format(apc_ns utc, char text[APC_TIME_LEN])
{
    int64_t us = utc / 1000 - (utc % 1000 < 0);
    int64_t seconds = us / 1000000 - (us % 1000000 < 0);
    int64_t days = seconds / 86400 - (seconds % 86400 < 0);
    uint32_t micro = (uint32_t)(us - seconds * 1000000), second = (uint32_t)(seconds - days * 86400);
    uint32_t year, month, day;
    char *c = text;

    date_from_days(days, &year, &month, &day);
    c = put_two_digits(c, year / 100, '0') - 1; /* the next digit stands where the end was */
    c = put_two_digits(c, year % 100, '-');
    c = put_two_digits(c, month, '-');
    c = put_two_digits(c, day, 'T');
    c = put_two_digits(c, second / 3600, ':');
    c = put_two_digits(c, second / 60 % 60, ':');
    c = put_two_digits(c, second % 60, '.');
    c = put_two_digits(c, micro / 10000, '0') - 1;
    c = put_two_digits(c, micro / 100 % 100, '0') - 1;
    c = put_two_digits(c, micro % 100, 'Z');
    *c = '\0';
    return text;
}

/* Two decimal digits, advancing *text. */
static bool take_two_digits(const char **text, int *value)
{
    const unsigned tens = (unsigned char)(*text)[0] - (unsigned)'0';
    unsigned ones;

    if (tens > 9 || (ones = (unsigned char)(*text)[1] - (unsigned)'0') > 9)
        return false;
    *value = (int)(10 * tens + ones);
    *text += 2;
    return true;
}

static bool take_char(const char **text, char c)
{
    return **text == c && (*text)++;
}

static bool take_fraction(const char **text, apc_ns *ns)
{
    static const apc_ns unit[] = {0,     100000000, 10000000, 1000000, 100000,
                                  10000, 1000,      100,      10,      1}; /* of the last decimal */
    size_t n = 0;
    *ns = 0;
    if (**text != '.')
        return true;
    for ((*text)++; **text >= '0' && **text <= '9' && n < 9; (*text)++, n++)
        *ns = *ns * 10 + (**text - '0');
    *ns *= unit[n];
    return n > 0;
}

static bool take_zone(const char **text, apc_ns *offset)
{
    int hours, minutes;
    char sign = **text;
    *offset = 0;
    if (sign == '\0')
        return true;
    (*text)++;
    if (sign == 'Z')
        return true;
    if ((sign != '+' && sign != '-') || !take_two_digits(text, &hours) || !take_char(text, ':') ||
        !take_two_digits(text, &minutes) || hours > 23 || minutes > 59)
        return false;
    *offset = (hours * INT64_C(60) + minutes) * 60 * APC_NS_PER_S * (sign == '-' ? -1 : 1);
    return true;
}

static int days_in(int year, int month)
{
    static const int days[] = {31, 28, 31, 30, 31, 30, 31, 31, 30, 31, 30, 31};
    bool leap = (year % 4 == 0 && year % 100 != 0) || year % 400 == 0;
    return days[month - 1] + (month == 2 && leap);
}

int apc_time_parse(const char *text, apc_ns *utc)
{
    int century, year, month, day, hour, minute, second;
    apc_ns fraction, offset;

    if (!text || !utc)
        return APC_EINVAL;
    if (!take_two_digits(&text, &century) || !take_two_digits(&text, &year) || !take_char(&text, '-') ||
        !take_two_digits(&text, &month) || !take_char(&text, '-') || !take_two_digits(&text, &day) ||
        (!take_char(&text, 'T') && !take_char(&text, ' ')) || !take_two_digits(&text, &hour) ||
        !take_char(&text, ':') || !take_two_digits(&text, &minute) || !take_char(&text, ':') ||
        !take_two_digits(&text, &second) || !take_fraction(&text, &fraction) || !take_zone(&text, &offset) ||
        *text)
        return APC_EINVAL;
    year += 100 * century;
    /* the range of 64-bit nanoseconds, in whole years */
    if (year < 1678 || year > 2261 || month < 1 || month > 12 || day < 1 || day > days_in(year, month) ||
        hour > 23 || minute > 59 || second > 60)
        return APC_EINVAL;
    const apc_ns whole =
        (days_from_date(year, month, day) * 86400 + hour * INT64_C(3600) + minute * INT64_C(60) + second) *
            APC_NS_PER_S -
        offset;
    if (second == 60 && whole % (86400 * APC_NS_PER_S) != 0)
        return APC_EINVAL; /* only a day of UTC ends with a leap second, which Unix time counts as the next
                              day's first */
    *utc = whole + fraction;
    return 0;
}

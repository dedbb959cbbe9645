/* SPDX-License-Identifier: BSD-3-Clause */
/*
 * Numbers as text, the same in every locale, exact both ways.
 *
 * Nearly every number on the wire is plain: no exponent, at most 19 digits. Those are converted here, in
 * integers of 128 bits, rounded correctly as libc rounds them, at a quarter of its cost; otherwise the
 * numbers would cost an exchange more than all else that a link adds to the kernel's part. The others go to
 * printf and strtod, which follow LC_NUMERIC, so that under de_DE "3.75" would read as 3: for them the
 * locale's decimal point is put right.
 */
#include "apcbase.h"

#include <float.h>
#include <locale.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#define NUMBER_MAX 400 /* longest text looked at; DBL_MAX in %f has 316 characters */

/* ---- Plain numbers ------------------------------------------------------------------------- */

#ifdef __SIZEOF_INT128__
__extension__ typedef unsigned __int128 uint128;

/* All that 64 bits hold. */
static const uint64_t power[] = {
    UINT64_C(1),
    UINT64_C(10),
    UINT64_C(100),
    UINT64_C(1000),
    UINT64_C(10000),
    UINT64_C(100000),
    UINT64_C(1000000),
    UINT64_C(10000000),
    UINT64_C(100000000),
    UINT64_C(1000000000),
    UINT64_C(10000000000),
    UINT64_C(100000000000),
    UINT64_C(1000000000000),
    UINT64_C(10000000000000),
    UINT64_C(100000000000000),
    UINT64_C(1000000000000000),
    UINT64_C(10000000000000000),
    UINT64_C(100000000000000000),
    UINT64_C(1000000000000000000),
    UINT64_C(10000000000000000000),
};
#define POWER_MAX 19

/* The decimal exponent of 0.001 <= size < 1e17. Each of the three fractions is a little above its text, and
 * no double lies between, so comparing with it is exact. */
static int decimal_exponent(double size)
{
    int exponent = 0;

    if (size < 1.0)
        return size < 0.01 ? -3 : size < 0.1 ? -2 : -1;
    while (size >= (double)power[exponent + 1])
        exponent++;
    return exponent;
}

/* The 17 digits of a number with that exponent, half to even. They are finer than doubles lie apart, so
 * rounding never makes an 18th. The product has 117 bits at most. */
static uint64_t scale_digits(double size, int exponent)
{
    int shift;
    uint128 product = (uint128)(uint64_t)(frexp(size, &shift) * 0x1p53) * power[16 - exponent];

    shift -= 53;
    if (shift >= 0)
        return (uint64_t)(product << shift);
    uint128 whole = product >> -shift, rest = product - (whole << -shift), half = (uint128)1 << (-shift - 1);
    return (uint64_t)whole + (rest > half || (rest == half && (whole & 1)));
}

/* Two at a time: half as many divisions, each of which waits for the one before. */
static void put_digits(char *text, uint32_t number, int n)
{
    for (; n > 1; n -= 2, number /= 100) {
        const uint32_t two = number % 100;
        text[n - 2] = (char)('0' + two / 10);
        text[n - 1] = (char)('0' + two % 10);
    }
    if (n > 0)
        text[0] = (char)('0' + number);
}

/* As %.17g. Returns the length; 0 when it is not for here. @p text has room for 24 characters. */
static int format_plain(double value, char *text)
{
    const double size = fabs(value);
    char *c = text;
    int n = 17;

    if (!(size >= 1e-3 && size < 1e17))
        return 0;
    const int exponent = decimal_exponent(size), whole = exponent < 0 ? 0 : exponent + 1;
    if (value < 0)
        *c++ = '-';
    memcpy(c, "0.00", 4);
    char *const digits = c + (whole > 0 ? 1 : 1 - exponent); /* behind the point, */
    const uint64_t number = scale_digits(size, exponent);
    put_digits(digits, (uint32_t)(number / 100000000u), 9);
    put_digits(digits + 9, (uint32_t)(number % 100000000u), 8);
    while (n > whole && digits[n - 1] == '0')
        n--;
    for (int i = 0; i < whole; i++) /* and those before it to where they belong */
        *c++ = digits[i];
    if (whole > 0 && n > whole)
        *c = '.';
    if (n > whole)
        c = digits + n;
    *c = '\0';
    return (int)(c - text);
}

/*
 * digits / 10^decimals, rounded once. Two numbers that doubles hold exactly divide so by themselves. For the
 * others both are shifted left until the quotient has 63 or 64 bits; its last says whether more was cut off.
 */
static double quotient(uint64_t digits, int decimals)
{
    const uint64_t divisor = power[decimals];

    if (digits <= UINT64_C(1) << DBL_MANT_DIG)
        return (double)digits / (double)divisor;
    const int up = __builtin_clzll(digits), down = __builtin_clzll(divisor);
    const uint128 dividend = (uint128)(digits << up) << 63;
    uint64_t result = (uint64_t)(dividend / (divisor << down));

    result |= (uint128)result * (divisor << down) != dividend;
    return ldexp((double)result, down - up - 63);
}

/* [-+] digits [. digits], at most 19 digits. False when it is not for here. */
static bool parse_plain(const char *text, double *value)
{
    const char *c = text, *point = NULL;
    uint64_t sum = 0;
    int digits = 0;

    if (*c == '-' || *c == '+')
        c++;
    for (;; c++) {
        if (*c >= '0' && *c <= '9' && digits < POWER_MAX) {
            sum = sum * 10 + (uint64_t)(*c - '0');
            digits++;
        } else if (*c == '.' && !point) {
            point = c;
        } else {
            break;
        }
    }
    if (*c != '\0' || digits == 0)
        return false;
    *value = quotient(sum, point ? (int)(c - point - 1) : 0);
    if (*text == '-')
        *value = -*value;
    return true;
}

#else /* 32 bits: all go to libc */
static int format_plain(double value, char *text)
{
    (void)value, (void)text;
    return 0;
}

static bool parse_plain(const char *text, double *value)
{
    (void)text, (void)value;
    return false;
}
#endif

/* ---- All numbers --------------------------------------------------------------------------- */

static const char *decimal_point(void)
{
    return localeconv()->decimal_point;
}

static int format_any(double value, char *text, size_t size)
{
    const char *point = decimal_point();
    size_t width = strlen(point);
    int length = snprintf(text, size, "%.17g", value);
    char *found = strstr(text, point);

    if (found && strcmp(point, ".") != 0) {
        *found = '.';
        memmove(found + 1, found + width, strlen(found + width) + 1);
        length -= (int)width - 1;
    }
    return length;
}

int apc_number_format(double value, char *text, size_t size)
{
    char buffer[40];
    int length = format_plain(value, buffer);

    if (length == 0)
        length = format_any(value, buffer, sizeof buffer);
    if (!text || (size_t)length >= size)
        return APC_ERANGE;
    memcpy(text, buffer, (size_t)length + 1);
    return length;
}

/* [-+] digits [. digits] [e [-+] digits], with a digit before or after the point. Only then strtod may
 * look: it would also take "nan", "inf", "0x1p3", blanks in front, and the locale's point. */
static bool is_decimal_number(const char *c)
{
    size_t digits = 0;
    if (*c == '-' || *c == '+')
        c++;
    for (; *c >= '0' && *c <= '9'; c++)
        digits++;
    if (*c == '.')
        for (c++; *c >= '0' && *c <= '9'; c++)
            digits++;
    if (digits == 0)
        return false;
    if (*c == 'e' || *c == 'E') {
        c++;
        if (*c == '-' || *c == '+')
            c++;
        if (*c < '0' || *c > '9')
            return false;
        while (*c >= '0' && *c <= '9')
            c++;
    }
    return *c == '\0';
}

int apc_number_parse(const char *text, double *value)
{
    char buffer[NUMBER_MAX + 16];
    double number;

    if (!text || !value)
        return APC_EINVAL;
    if (parse_plain(text, value))
        return 0;
    if (strnlen(text, NUMBER_MAX) == NUMBER_MAX || !is_decimal_number(text))
        return APC_EINVAL;
    const char *point = decimal_point();
    if (strcmp(point, ".") != 0 && strlen(point) < 16) {
        const char *dot = strchr(text, '.');
        if (dot) {
            snprintf(buffer, sizeof buffer, "%.*s%s%s", (int)(dot - text), text, point, dot + 1);
            text = buffer;
        }
    }
    number = strtod(text, NULL);
    if (!isfinite(number))
        return APC_EINVAL;
    *value = number;
    return 0;
}

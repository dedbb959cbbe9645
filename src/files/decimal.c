/* SPDX-License-Identifier: BSD-3-Clause */
#include "files.h"

#include <apcstore.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

enum { LINE = 256, DIGITS = 19, DECIMALS = 27 };

/* What the library takes for one, an exponent as well. */
static bool take_any(const char *from, const char **end, double *value)
{
    char text[LINE];
    size_t n = 0;

    while (n < sizeof text && from[n] != ',' && from[n] != '\n')
        n++;
    *end = from + n;
    if (n == sizeof text || memchr(from, '\0', n))
        return false;
    memcpy(text, from, n);
    text[n] = '\0';
    return apc_number_parse(text, value) == 0;
}

/* Behind the digits at @p p, which go behind @p digits: up to 8 at once. */
static const char *take_digits(const char *p, uint64_t *digits)
{
#if __BYTE_ORDER__ == __ORDER_LITTLE_ENDIAN__
    static const uint32_t power[] = {1, 10, 100, 1000, 10000, 100000, 1000000, 10000000, 100000000};
    unsigned n;

    do {
        uint64_t v;

        memcpy(&v, p, sizeof v);
        const uint64_t other = ((v + 0x4646464646464646U) | (v - 0x3030303030303030U)) & 0x8080808080808080U;

        n = other ? (unsigned)__builtin_ctzll(other) / 8 : 8;
        if (n == 0)
            break;
        v = (v - 0x3030303030303030U) << (64 - 8 * n); /* zeros before them */
        v = 10 * v + (v >> 8);
        v = ((v & 0x000000FF000000FFU) * 0x000F424000000064U +
             ((v >> 16) & 0x000000FF000000FFU) * 0x0000271000000001U) >>
            32;
        *digits = power[n] * *digits + v;
        p += n;
    } while (n == 8);
#else
    for (; *p >= '0' && *p <= '9'; p++)
        *digits = 10 * *digits + (uint64_t)(*p - '0');
#endif
    return p;
}

/* 2^b / 5^n in 128 bits, the first of them 1, rounded up. */
static const uint64_t fifths[DECIMALS + 1][2] = {
    {0x8000000000000000U, 0x0000000000000000U}, {0xCCCCCCCCCCCCCCCCU, 0xCCCCCCCCCCCCCCCDU},
    {0xA3D70A3D70A3D70AU, 0x3D70A3D70A3D70A4U}, {0x83126E978D4FDF3BU, 0x645A1CAC083126EAU},
    {0xD1B71758E219652BU, 0xD3C36113404EA4A9U}, {0xA7C5AC471B478423U, 0x0FCF80DC33721D54U},
    {0x8637BD05AF6C69B5U, 0xA63F9A49C2C1B110U}, {0xD6BF94D5E57A42BCU, 0x3D32907604691B4DU},
    {0xABCC77118461CEFCU, 0xFDC20D2B36BA7C3EU}, {0x89705F4136B4A597U, 0x31680A88F8953031U},
    {0xDBE6FECEBDEDD5BEU, 0xB573440E5A884D1CU}, {0xAFEBFF0BCB24AAFEU, 0xF78F69A51539D749U},
    {0x8CBCCC096F5088CBU, 0xF93F87B7442E45D4U}, {0xE12E13424BB40E13U, 0x2865A5F206B06FBAU},
    {0xB424DC35095CD80FU, 0x538484C19EF38C95U}, {0x901D7CF73AB0ACD9U, 0x0F9D37014BF60A11U},
    {0xE69594BEC44DE15BU, 0x4C2EBE687989A9B4U}, {0xB877AA3236A4B449U, 0x09BEFEB9FAD487C3U},
    {0x9392EE8E921D5D07U, 0x3AFF322E62439FD0U}, {0xEC1E4A7DB69561A5U, 0x2B31E9E3D06C32E6U},
    {0xBCE5086492111AEAU, 0x88F4BB1CA6BCF585U}, {0x971DA05074DA7BEEU, 0xD3F6FC16EBCA5E04U},
    {0xF1C90080BAF72CB1U, 0x5324C68B12DD6339U}, {0xC16D9A0095928A27U, 0x75B7053C0F178294U},
    {0x9ABE14CD44753B52U, 0xC4926A9672793543U}, {0xF79687AED3EEC551U, 0x3A83DDBD83F52205U},
    {0xC612062576589DDAU, 0x95364AFE032A819EU}, {0x9E74D1B791E07E48U, 0x775EA264CF55347EU}};

/* @p digits / 10^decimals, rounded once. Daniel Lemire, Number parsing at a gigabyte per second, Software:
 * Practice and Experience 51 (2021): 128 bits of the quotient decide for up to 27 decimals. */
static double scale_decimal(uint64_t digits, unsigned decimals)
{
    __extension__ typedef unsigned __int128 wide;
    static const double power[] = {1e0, 1e1, 1e2, 1e3, 1e4, 1e5, 1e6, 1e7, 1e8, 1e9, 1e10, 1e11};

    if (digits == 0)
        return 0.0;
    if (digits < UINT64_C(1) << 53 && decimals < sizeof power / sizeof power[0])
        return (double)digits / power[decimals]; /* both are exact */
    const int zeros = __builtin_clzll(digits);
    const uint64_t whole = digits << zeros;
    wide product = (wide)whole * fifths[decimals][0];

    if (((uint64_t)(product >> 64) & 0x1FF) == 0x1FF)
        product += (wide)whole * fifths[decimals][1] >> 64;
    const uint64_t high = (uint64_t)(product >> 64), low = (uint64_t)product;
    const int upper = (int)(high >> 63), shift = upper + 9;
    uint64_t mantissa = high >> shift, bits;

    if (low <= 1 && decimals <= 4 && (mantissa & 3) == 1 && mantissa << shift == high)
        mantissa &= ~UINT64_C(1); /* in the middle between two: to the even one */
    mantissa = (mantissa + (mantissa & 1)) >> 1;
    /* floor(log2(10^-decimals)), and 1 where the mantissa was rounded up to the next power of two */
    const int exponent =
        63 - (int)((217706 * decimals + 65535) >> 16) + upper - zeros + 1023 + (int)(mantissa >> 53);
    double value;

    bits = (mantissa & ((UINT64_C(1) << 52) - 1)) | (uint64_t)exponent << 52;
    memcpy(&value, &bits, sizeof value);
    return value;
}

bool decimal_take(const char *from, const char **end, double *value)
{
    const bool negative = *from == '-';
    const char *const first = from + negative, *p;
    uint64_t digits = 0;
    size_t n, decimals = 0;

    p = take_digits(first, &digits);
    n = (size_t)(p - first);
    if (*p == '.') {
        const char *const point = p + 1;

        p = take_digits(point, &digits);
        decimals = (size_t)(p - point);
        n += decimals;
    }
    if (n == 0 || decimals > DECIMALS || (*p != ',' && *p != '\n'))
        return take_any(from, end, value);
    for (const char *zero = first; n > DIGITS && (*zero == '0' || *zero == '.'); zero++)
        n -= *zero == '0';
    if (n > DIGITS)
        return take_any(from, end, value);
    *end = p;
    *value = scale_decimal(digits, (unsigned)decimals);
    *value = negative ? -*value : *value;
    return true;
}

char *decimal_shortest(double value, int digits, char text[DECIMAL_LEN])
{
    char local[DECIMAL_LEN], *to = text;
    do
        snprintf(local, sizeof local, "%.*g", digits, value);
    while (++digits <= 17 && strtod(local, NULL) != value);
    for (const char *c = local; *c; c++) {
        const bool plain = strchr("0123456789+-einfa", *c); /* all but the decimal point of the locale */
        if (plain || (to > text && to[-1] != '.'))
            *to++ = plain ? *c : '.';
    }
    *to = '\0';
    return text;
}

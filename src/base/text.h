/* SPDX-License-Identifier: BSD-3-Clause */
/*
 * Text that somebody else wrote, on its way in and on its way out. What reaches a terminal, a log, a file or
 * a page is one line of characters that each show as what they are: no escape sequence, no end of a line,
 * nothing that changes the order in which text is read.
 */
#ifndef APC_TEXT_H
#define APC_TEXT_H

#include <stdbool.h>
#include <stdint.h>
#include <string.h>

#include "base/utf8.h"

/* "1 day", "2 days": what comes behind the noun of a number. */
#define PLURAL(n) ((n) == 1 ? "" : "s")

/* The number of the character whose @p n bytes stand at @p text. */
static inline uint32_t text_code(const char *text, size_t n)
{
    uint32_t code = (unsigned char)text[0] & (n > 1 ? 0x7Fu >> n : 0x7Fu);

    for (size_t i = 1; i < n; i++)
        code = code << 6 | ((unsigned char)text[i] & 0x3Fu);
    return code;
}

/* What stands for a character that is not to be shown, the character itself being 0: a blank for what ends a
 * line and for a tab, '?' for other controls (C0, DEL, C1) and for marks of direction (Unicode 15, UAX 9). */
static inline char text_instead(uint32_t code)
{
    if ((code >= '\t' && code <= '\r') || code == 0x85 || code == 0x2028 || code == 0x2029)
        return ' ';
    return code < 0x20 || (code >= 0x7F && code < 0xA0) || code == 0x061C || code == 0x200E ||
                   code == 0x200F || (code >= 0x202A && code <= 0x202E) || (code >= 0x2066 && code <= 0x2069)
               ? '?'
               : '\0';
}

/* The bytes of the character at @p text, which is not at its end. @p instead becomes what is shown in its
 * place, 0: itself. A byte that is no UTF-8 is one '?'. [tick] */
static inline size_t text_step(const char *text, char *instead)
{
    const size_t n = utf8_length(text);

    *instead = n > 0 ? text_instead(text_code(text, n)) : '?';
    return n > 0 ? n : 1;
}

/* Up to @p size - 1 bytes of @p in, one line and as it is to be shown, into @p out, which is filled with 0 to
 * its end and may be @p in itself. Where @p lines, ends of lines and tabs stay. Returns @p out. [tick] */
static inline char *text_cleaned(char *out, const char *in, size_t size, bool lines)
{
    const size_t length = strnlen(in, size - 1);
    size_t to = 0, n;
    char instead;

    memmove(out, in, length);
    out[length] = '\0'; /* in the middle of a character: what is left of it is no UTF-8 */
    for (size_t from = 0; from < length; from += n) {
        n = text_step(out + from, &instead);
        if (lines && (out[from] == '\n' || out[from] == '\r' || out[from] == '\t'))
            instead = '\0';
        if (instead)
            out[to++] = instead;
        for (size_t i = 0; !instead && i < n; i++)
            out[to++] = out[from + i];
    }
    memset(out + to, 0, size - to);
    return out;
}

static inline char *text_clean(char *out, const char *in, size_t size)
{
    return text_cleaned(out, in, size, false);
}

/* Is all of it shown as it is? [tick] */
static inline bool text_is_clean(const char *text)
{
    char instead = '\0';

    while (*text && !instead)
        text += text_step(text, &instead);
    return !instead;
}

#endif

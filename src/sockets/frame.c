/* SPDX-License-Identifier: BSD-3-Clause */
/*
 * The frame codec: pure, linear, bounded.
 *
 *     frame  = "apc1 " kind " " id " " n ";" *sample %x0A      ; n samples; at most APC_FRAME_MAX bytes
 *     kind   = "command" / "query" / "values"                  ; a query has n = 0
 *     id     = uint                                            ; at most 2^64 - 1; APC_FRAME_CLAIMED
 *     n      = uint                                            ; at most APC_FRAME_COUNT
 *     sample = time "," status "," value ";"
 *     time   = 4DIGIT "-" 2DIGIT "-" 2DIGIT "T" 2DIGIT ":" 2DIGIT ":" 2DIGIT "." 6DIGIT "Z"
 *     status = 1*31(%x21-2B / %x2D-3A / %x3C-7E)               ; a name or code of apc_status_parse()
 *     value  = 1*32(DIGIT / "+" / "-" / "." / "e" / "E")       ; a finite number of apc_number_parse()
 *     uint   = "0" / (%x31-39 *DIGIT)                          ; one way to write each number
 *
 * The reader never looks beyond the bytes it was given, which carry no terminator: each field is
 * delimited, measured and copied before a text function sees it. A time has one spelling, so what
 * decodes encodes to the same samples.
 */
#include "apcsockets.h"

#include <math.h>
#include <string.h>

#define TIME_TEXT   27 /* 2026-01-31T12:00:00.123456Z */
#define NUMBER_TEXT 32 /* %.17g has 24 at most */

static const char *const kinds[] = {
    [APC_FRAME_COMMAND] = "command", [APC_FRAME_QUERY] = "query", [APC_FRAME_VALUES] = "values"};

static bool kind_known(enum apc_frame_kind kind)
{
    return kind >= APC_FRAME_COMMAND && kind <= APC_FRAME_VALUES;
}

/* ---- Encoding ------------------------------------------------------------------------------ */

struct writer {
    char *at;
    size_t left;
};

/* What was written at w->at. */
static void advance_writer(struct writer *w, size_t length)
{
    w->at += length;
    w->left -= length;
}

/* Words of a few letters. */
static bool put_word(struct writer *w, const char *text)
{
    char *at = w->at, *const end = at + w->left;

    while (*text && at < end)
        *at++ = *text++;
    advance_writer(w, (size_t)(at - w->at));
    return !*text;
}

/* Not by printf, which on a cold cache takes as long as all the rest of a frame's head and tail. */
static bool put_uint(struct writer *w, uint64_t value)
{
    char text[21], *first = text + sizeof text - 1;

    *first = '\0';
    do
        *--first = (char)('0' + value % 10);
    while ((value /= 10) > 0);
    return put_word(w, first);
}

/* The years that apc_time_parse() reads; a few months at either end of apc_ns lie outside. */
static bool time_fits(apc_ns time)
{
    return time >= -INT64_C(9214560000) * APC_NS_PER_S && time < INT64_C(9214646400) * APC_NS_PER_S;
}

/* Texts are written where they belong, with terminators where more follows: a frame that fits has room. @p
 * time: the text of the same time, where it was written last, or NULL. Returns where it stands now, or NULL.
 */
static const char *put_time(struct writer *w, apc_ns value, const char *time)
{
    char *at = w->at;

    if (w->left < APC_TIME_LEN)
        return NULL;
    if (time)
        memcpy(at, time, TIME_TEXT);
    else
        apc_time_format(value, at);
    advance_writer(w, TIME_TEXT);
    return at;
}

static int put_sample_rest(struct writer *w, const struct apc_sample *s)
{
    char status[APC_STATUS_NAME_LEN];
    int length;

    if (!put_word(w, ",") || !put_word(w, apc_status_format(s->status, status)) || !put_word(w, ","))
        return APC_ERANGE;
    length = apc_number_format(s->value, w->at, w->left);
    if (length < 0)
        return length;
    advance_writer(w, (size_t)length);
    return put_word(w, ";") ? 0 : APC_ERANGE;
}

int apc_frame_encode(char *text, size_t size, const struct apc_frame *frame, const struct apc_sample *samples)
{
    const char *time = NULL;
    struct writer w = {text, size < APC_FRAME_MAX ? size : APC_FRAME_MAX};

    if (!text || !frame || !kind_known(frame->kind) || (frame->n > 0 && !samples) ||
        (frame->kind == APC_FRAME_QUERY && frame->n > 0))
        return APC_EINVAL;
    if (frame->n > APC_FRAME_COUNT)
        return APC_ERANGE;
    if (!put_word(&w, "apc1 ") || !put_word(&w, kinds[frame->kind]) || !put_word(&w, " ") ||
        !put_uint(&w, frame->id) || !put_word(&w, " ") || !put_uint(&w, frame->n) || !put_word(&w, ";"))
        return APC_ERANGE;
    for (size_t i = 0; i < frame->n; i++) {
        const struct apc_sample *s = &samples[i];
        int err;

        if (!isfinite(s->value) || !time_fits(s->time))
            return APC_EINVAL;
        if (i > 0 && s->time != s[-1].time) /* else the text is there: a vector is sampled at one time */
            time = NULL;
        time = put_time(&w, s->time, time);
        err = time ? put_sample_rest(&w, s) : APC_ERANGE;
        if (err < 0)
            return err;
    }
    if (!put_word(&w, "\n"))
        return APC_ERANGE;
    return (int)(w.at - text);
}

/* ---- Decoding ------------------------------------------------------------------------------ */

struct reader {
    const char *at, *end;
    const char *time_text; /* the last time read, and its value: most often the next is the same */
    apc_ns time;
};

static bool take_literal(struct reader *r, const char *literal)
{
    size_t length = strlen(literal);
    if ((size_t)(r->end - r->at) < length || memcmp(r->at, literal, length) != 0)
        return false;
    r->at += length;
    return true;
}

static bool take_uint(struct reader *r, uint64_t max, uint64_t *value)
{
    const char *first = r->at;
    uint64_t sum = 0;

    for (; r->at < r->end && *r->at >= '0' && *r->at <= '9'; r->at++) {
        unsigned digit = (unsigned)(*r->at - '0');
        if (r->at - first >= 19 && sum > (UINT64_MAX - digit) / 10) /* 19 digits always fit */
            return false;
        sum = sum * 10 + digit;
    }
    *value = sum;
    return sum <= max && r->at > first && (*first != '0' || r->at == first + 1);
}

/* The bytes up to @until, and past it, as a string in @text, for a function that knows what may be in it. */
static bool take_field(struct reader *r, char until, char *text, size_t size)
{
    const char *c = r->at, *const end = (size_t)(r->end - c) > size ? c + size : r->end;

    while (c < end && *c != until && *c != '\0')
        *text++ = *c++;
    if (c == end || *c != until)
        return false;
    *text = '\0';
    r->at = c + 1;
    return true;
}

static bool take_frame_time(struct reader *r, apc_ns *time)
{
    const char *first = r->at;
    char text[TIME_TEXT + 1];

    if (r->end - first <= TIME_TEXT)
        return false;
    if (!r->time_text || memcmp(first, r->time_text, TIME_TEXT + 1) != 0) {
        memcpy(text, first, TIME_TEXT);
        text[TIME_TEXT] = '\0';
        /* of the spellings that apc_time_parse() knows only one has this length and these two letters */
        if (first[TIME_TEXT] != ',' || text[10] != 'T' || text[TIME_TEXT - 1] != 'Z' ||
            apc_time_parse(text, &r->time) < 0)
            return false;
        r->time_text = first;
    }
    r->at += TIME_TEXT + 1;
    *time = r->time;
    return true;
}

static bool take_frame_sample(struct reader *r, struct apc_sample *sample)
{
    char status[APC_STATUS_NAME_LEN], value[NUMBER_TEXT + 1];

    return take_frame_time(r, &sample->time) && take_field(r, ',', status, sizeof status) &&
           apc_status_parse(status, &sample->status) == 0 && take_field(r, ';', value, sizeof value) &&
           apc_number_parse(value, &sample->value) == 0;
}

static bool take_frame_head(struct reader *r, struct apc_frame *frame)
{
    uint64_t n;

    if (!take_literal(r, "apc1 "))
        return false;
    if (take_literal(r, "command "))
        frame->kind = APC_FRAME_COMMAND;
    else if (take_literal(r, "query "))
        frame->kind = APC_FRAME_QUERY;
    else if (take_literal(r, "values "))
        frame->kind = APC_FRAME_VALUES;
    else
        return false;
    if (!take_uint(r, UINT64_MAX, &frame->id) || !take_literal(r, " ") ||
        !take_uint(r, APC_FRAME_COUNT, &n) || !take_literal(r, ";"))
        return false;
    frame->n = (size_t)n;
    return frame->kind != APC_FRAME_QUERY || n == 0;
}

int apc_frame_decode(const char *text, size_t length, struct apc_frame *frame, struct apc_sample *samples,
                     size_t capacity)
{
    struct reader r = {.at = text};
    struct apc_frame head;
    struct apc_sample beyond; /* a frame must be sound before it may be too large */

    if (frame)
        *frame = (struct apc_frame){0};
    if (!text || !frame || (capacity > 0 && !samples))
        return APC_EINVAL;
    r.end = text + length;
    if (length > APC_FRAME_MAX || !take_frame_head(&r, &head))
        return APC_EPROTO;
    for (size_t i = 0; i < head.n; i++)
        if (!take_frame_sample(&r, i < capacity ? &samples[i] : &beyond))
            return APC_EPROTO;
    if (!take_literal(&r, "\n") || r.at != r.end)
        return APC_EPROTO;
    if (head.n > capacity)
        return APC_ERANGE;
    *frame = head;
    return 0;
}

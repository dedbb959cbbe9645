/* SPDX-License-Identifier: BSD-3-Clause */
/*
 * Requests to the units behind one address, each with its reply, over one link. Whatever is not the reply to
 * the very request closes the connection, so that a late one is never taken for the next one's. Only the
 * reply to an earlier request that its unit left unanswered is dropped.
 *
 * Each unit has its share of the exchange's time. One that fails costs nobody else's: after that it is asked
 * behind all others, with the time that they leave, and when it is silent then too, after growing pauses,
 * since a gateway may hold up the others for as long as it waits for it. Where no unit answers it is not a
 * unit that fails but the exchange. Nobody knows who is to blame then, and the one that was asked first makes
 * way: it may have taken the others' time, or their connection.
 */
#include "base/base_internal.h"
#include "exchange/modbus.h"

#include <stdio.h>
#include <string.h>
#include <time.h>

#define ACKNOWLEDGE  5 /* taken, but not done yet */
#define BUSY         6
#define PAUSE        (5 * APC_NS_PER_MS) /* before a device that is busy is asked again; doubled each time */
#define PAUSE_MAX    (100 * APC_NS_PER_MS)
#define SILENT       (100 * APC_NS_PER_MS) /* before a unit that was silent twice is asked again; doubled */
#define SILENT_MAX   (30 * APC_NS_PER_S)
#define TOGETHER_MAX (2 * APC_NS_PER_S) /* where no other answers either */

/* Of a link: is it the reply to a request that is waited for no more? */
static bool is_late_modbus_reply(void *ctx, const char *reply, size_t length)
{
    struct apc_modbus_line *l = ctx;
    const unsigned char *bytes = (const unsigned char *)reply;
    struct apc_modbus_station *station = &l->stations[bytes[6]];

    (void)length;
    if (apc_modbus_get(bytes) == l->transaction || station->late == 0)
        return false;
    station->late--;
    return true;
}

int apc_modbus_line_open(struct apc_modbus_line *l, const char *to, struct apc_error *error,
                         struct apc_error *why)
{
    const struct apc_link_options link = {.size = sizeof(link),
                                          .frame_max = APC_MODBUS_FRAME,
                                          .whole = apc_modbus_whole,
                                          .late = is_late_modbus_reply,
                                          .late_ctx = l};

    l->error = error;
    return apc_link_create(&l->link, to, &link, why);
}

void apc_modbus_line_close(struct apc_modbus_line *l)
{
    apc_link_destroy(l->link);
}

/* ---- One request and its reply -------------------------------------------------------------- */

int apc_modbus_no_answer(struct apc_modbus_line *l, const char *what, unsigned is, unsigned asked)
{
    apc_link_reset(l->link);
    return apc_fail(l->error, APC_EPROTO,
                    "its reply does not answer the request: its %s is %u, and should be %u", what, is, asked);
}

/* The request goes out for as long as the exchange may take; its unit has but its share to answer. */
static int send_request(struct apc_modbus_line *l, size_t length)
{
    const int rc = apc_link_send(l->link, (const char *)l->frame, length, l->deadline);

    if (l->connects != apc_link_connects(l->link)) {
        l->connects = apc_link_connects(l->link);
        for (size_t i = 0; i < APC_MODBUS_UNITS; i++)
            l->stations[i].late = 0;
    }
    l->sent = l->sent || rc == 0;
    return rc;
}

static int ask_once(struct apc_modbus_line *l, unsigned unit, size_t n, size_t expected,
                    const unsigned char **reply)
{
    const char *text = NULL;

    apc_modbus_put(l->frame, ++l->transaction);
    apc_modbus_put(l->frame + 2, 0);
    apc_modbus_put(l->frame + 4, (unsigned)n + 1);
    l->frame[6] = (unsigned char)unit;
    int length = send_request(l, APC_MODBUS_HEADER + n);
    if (length == 0) {
        const apc_ns now = apc_clock_mono(NULL);

        length = apc_link_receive(l->link, &text, now + (l->deadline - now) / l->left);
        l->stations[unit].late += length == APC_ETIMEDOUT;
    }
    if (length < 0 || !text)
        return apc_fail(l->error, length < 0 ? length : APC_EPROTO, "%s", apc_link_error(l->link));
    *reply = (const unsigned char *)text + APC_MODBUS_HEADER;
    const unsigned char *const header = (const unsigned char *)text;
    if (memcmp(header, l->frame, 2) != 0)
        return apc_modbus_no_answer(l, "transaction", apc_modbus_get(header), l->transaction);
    if (header[6] != l->frame[6])
        return apc_modbus_no_answer(l, "unit", header[6], l->frame[6]);
    if ((*reply)[0] == (l->frame[APC_MODBUS_HEADER] | 0x80) && length == APC_MODBUS_HEADER + 2 &&
        (*reply)[1] > 0)
        return (*reply)[1];
    if ((*reply)[0] != l->frame[APC_MODBUS_HEADER])
        return apc_modbus_no_answer(l, "function", (*reply)[0], l->frame[APC_MODBUS_HEADER]);
    if ((size_t)length != APC_MODBUS_HEADER + expected)
        return apc_modbus_no_answer(l, "length", (unsigned)length, (unsigned)(APC_MODBUS_HEADER + expected));
    return 0;
}

static void sleep_for(apc_ns time)
{
    (void)nanosleep(&(struct timespec){time / APC_NS_PER_S, time % APC_NS_PER_S}, NULL);
}

/*
 * A server may close the connection after each answer, which is known only when the next request is on its
 * way: that one goes out once more, over a connection of its own. A device that is busy is asked again for
 * half of its time, so that there is some for its other values. Both change nothing when they are repeated:
 * the same is read, or the same value written.
 */
int apc_modbus_request(struct apc_modbus_line *l, unsigned unit, size_t n, size_t expected,
                       const unsigned char **reply)
{
    const apc_ns now = apc_clock_mono(NULL), until = now + (l->deadline - now) / l->left / 2;
    apc_ns pause = PAUSE;
    bool again = false;

    l->sent = false;
    l->stations[unit].asked = true;
    for (;;) {
        const bool stood = apc_link_connected(l->link);
        const uint64_t connects = apc_link_connects(l->link);
        const int rc = ask_once(l, unit, n, expected, reply);

        if (rc == APC_ECONN && stood && !again && apc_link_connects(l->link) == connects) {
            again = true;
            continue;
        }
        if ((rc != BUSY && rc != ACKNOWLEDGE) || apc_clock_mono(NULL) + pause >= until)
            return rc;
        sleep_for(pause);
        pause = 2 * pause < PAUSE_MAX ? 2 * pause : PAUSE_MAX;
    }
}

/* ---- The units of an exchange ----------------------------------------------------------------- */

void apc_modbus_line_begin(struct apc_modbus_line *l, bool all)
{
    const apc_ns now = apc_clock_mono(NULL);
    struct apc_modbus_station *next = NULL;

    l->rc = 0;
    l->left = 0;
    for (size_t i = 0; i < APC_MODBUS_UNITS; i++) {
        struct apc_modbus_station *station = &l->stations[i];

        station->asked = false;
        station->failed = station->last && now < station->ask_at && !all;
        l->left += (station->writes || station->reads) && !station->failed;
        if (station->failed && (!next || station->ask_at < next->ask_at))
            next = station;
    }
    if (l->left == 0 && next) { /* somebody is asked in each exchange */
        next->failed = false;
        l->left = 1;
    }
}

void apc_modbus_line_fail(struct apc_modbus_line *l, struct apc_modbus_station *station, int rc)
{
    if (l->rc == 0) {
        l->rc = rc;
        l->first = station;
        l->reached = l->sent;
        l->why = *l->error;
    }
    station->failed = true;
    station->refuses = rc == APC_EPERM;
    apc_modbus_line_done(l);
}

void apc_modbus_line_done(struct apc_modbus_line *l)
{
    l->left -= l->left > 1;
}

bool apc_modbus_out_of_reach(const struct apc_modbus_station *station)
{
    return station->failed || station->last;
}

/* Which units failed, and why, in one text. */
static void tell_failed_units(struct apc_modbus_line *l)
{
    char names[64] = "";
    size_t n = 0, length = 0;

    for (size_t i = 0; i < APC_MODBUS_UNITS; i++) {
        if (!l->stations[i].failed)
            continue;
        n++;
        if (length + sizeof(", 255 ...") < sizeof(names))
            length += (size_t)snprintf(names + length, sizeof(names) - length, "%s%zu", n > 1 ? ", " : "", i);
        else
            (void)snprintf(names + length, sizeof(names) - length, " ...");
    }
    (void)apc_fail(l->error, APC_ECONN, "unit%s %s: %s", n > 1 ? "s" : "", names, l->why.text);
}

/* It is asked behind the others from now on; if it was so already, after a pause, longer each time. */
static void put_off(struct apc_modbus_station *station, apc_ns most)
{
    const apc_ns more = station->pause == 0 ? SILENT : 2 * station->pause;

    if (station->last && station->pause < most)
        station->pause = more < most ? more : most;
    station->last = true;
    station->ask_at = apc_clock_mono(NULL) + station->pause;
}

static bool is_alone(const struct apc_modbus_line *l)
{
    size_t n = 0;

    for (size_t i = 0; i < APC_MODBUS_UNITS; i++)
        n += l->stations[i].writes || l->stations[i].reads;
    return n == 1;
}

int apc_modbus_line_settle(struct apc_modbus_line *l, bool *partly)
{
    bool answered = false;

    for (size_t i = 0; i < APC_MODBUS_UNITS; i++)
        answered = answered || (l->stations[i].asked && !l->stations[i].failed);
    if (!answered && l->rc < 0) {
        if (l->rc == APC_ETIMEDOUT)
            apc_link_reset(l->link);
        if (l->reached && !is_alone(l))
            put_off(l->first, TOGETHER_MAX);
        *l->error = l->why;
        return l->rc;
    }
    for (size_t i = 0; i < APC_MODBUS_UNITS; i++) {
        struct apc_modbus_station *station = &l->stations[i];

        *partly = *partly || station->failed;
        if (station->asked && station->failed && !station->refuses) {
            put_off(station, SILENT_MAX);
        } else if (station->asked) {
            station->last = station->failed;
            station->pause = station->ask_at = 0;
        }
    }
    if (*partly)
        tell_failed_units(l);
    return 0;
}

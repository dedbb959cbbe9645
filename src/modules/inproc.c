/* SPDX-License-Identifier: BSD-3-Clause */
/*
 * The link inproc:. A reply belongs to the exchange whose request it answers, and to no other: neither one
 * that comes too late nor that of a request that arrived twice is taken for the next one's. What is under way
 * lies in flights, which are used again and again, so that a link that has seen its busiest moment allocates
 * no more. What the network does to both frames of an exchange, and to the reply to a copy of its request, is
 * drawn when it begins, each from streams of its own: so the n-th exchange meets the same fate whether or not
 * the others were lost, doubled or late. A flight is the context of its event; the link's own event is the
 * end of an exchange's patience. One that comes after the reply finds another deadline, or none, and does
 * nothing; it is the last thing of its instant, so that a reply that just comes in time does.
 */
#include "base/base_internal.h"
#include "modules/modules_internal.h"

#include <limits.h>
#include <stdlib.h>
#include <string.h>

#define FRAME_MAX (64u << 10)

struct flight {
    struct apc_inproc *link;
    struct flight *next, *all;     /* free ones; all there are */
    uint64_t connection, exchange; /* to which it belongs */
    struct apc_network_fate reply; /* of a request: what becomes of its reply */
    int length;                    /* of a reply: negative when the connection is closed instead */
    size_t capacity;
    char *bytes;
};

struct apc_inproc {
    struct apc_inproc_options options;
    const struct apc_clock *clock;
    struct apc_network *to, *from;
    struct apc_network *again; /* draws the fate of replies to copies; they go by `from` as well */
    struct flight *free, *all;
    uint64_t connection;
    char *reply;

    bool waiting;
    apc_ns deadline;
    apc_reply_fn fn;
    void *ctx;
    struct apc_inproc_stats stats;
};

/* ---- Flights ------------------------------------------------------------------------------- */

static struct flight *take_flight(struct apc_inproc *link, size_t capacity)
{
    struct flight *f = link->free;

    if (f) {
        link->free = f->next;
    } else {
        f = calloc(1, sizeof(*f));
        if (!f)
            return NULL;
        f->link = link;
        f->all = link->all;
        link->all = f;
    }
    if (f->capacity < capacity) {
        char *bytes = realloc(f->bytes, capacity);

        if (!bytes) {
            f->next = link->free;
            link->free = f;
            return NULL;
        }
        f->bytes = bytes;
        f->capacity = capacity;
    }
    return f;
}

static void land(struct flight *f)
{
    f->next = f->link->free;
    f->link->free = f;
}

/* Each copy that arrives is a flight of its own. @reply: what becomes of the replies to a request and to its
 * copy. */
static int send(struct apc_inproc *link, struct apc_network *network, const struct apc_network_fate *fate,
                int rank, apc_virtual_fn arrival, struct flight of, const struct apc_network_fate reply[2],
                const char *bytes, int length)
{
    const size_t size = length > 0 ? (size_t)length : 0;
    apc_ns at[2];
    int n = apc_network_carry(network, fate, apc_clock_mono(link->clock), size, at);

    for (int i = 0; i < n; i++) {
        struct flight *f = take_flight(link, size);

        if (!f)
            return APC_ENOMEM;
        f->connection = of.connection;
        f->exchange = of.exchange;
        if (reply)
            f->reply = reply[i];
        f->length = length;
        if (size)
            memcpy(f->bytes, bytes, size);
        if (apc_virtual_at(link->options.executive, at[i], rank, arrival, f) < 0) {
            land(f);
            return APC_ENOMEM;
        }
    }
    return 0;
}

/* ---- Arrivals ------------------------------------------------------------------------------ */

static void finish(struct apc_inproc *link, const char *reply, int length)
{
    link->waiting = false;
    if (length < 0)
        link->connection++;
    link->fn(link->ctx, reply, length);
}

static void on_reply(void *ctx)
{
    struct flight *f = ctx;
    struct apc_inproc *link = f->link;

    if (link->waiting && f->exchange == link->stats.exchanges)
        finish(link, f->length < 0 ? NULL : f->bytes, f->length < 0 ? APC_ECONN : f->length);
    land(f);
}

static void on_request(void *ctx)
{
    struct flight *f = ctx;
    struct apc_inproc *link = f->link;
    const struct apc_inproc_options *o = &link->options;
    int length =
        o->serve(o->serve_ctx, f->connection, f->bytes, (size_t)f->length, link->reply, o->frame_max);

    /* without memory the reply is as good as lost */
    (void)send(link, link->from, &f->reply, o->reply_rank, on_reply, *f, NULL, link->reply, length);
    land(f);
}

static void on_deadline(void *ctx)
{
    struct apc_inproc *link = ctx;

    if (!link->waiting || apc_clock_mono(link->clock) < link->deadline)
        return;
    link->stats.timeouts++;
    finish(link, NULL, APC_ETIMEDOUT);
}

/* ---- The link ------------------------------------------------------------------------------ */

static int take_options(struct apc_inproc_options *o, const struct apc_inproc_options *options,
                        struct apc_error *why)
{
    int rc = apc_options_copy(o, sizeof(*o), options, "apc_inproc_options", why);

    if (rc < 0)
        return rc;
    if (!o->executive || !o->serve)
        return apc_fail(why, APC_EINVAL, "link inproc: executive and serve are required");
    if (!apc_executive_is_virtual(o->executive))
        return apc_fail(why, APC_EINVAL, "link inproc: it runs in virtual time only");
    if (!o->frame_max)
        o->frame_max = FRAME_MAX;
    if (o->frame_max > APC_FRAME_MAX)
        return apc_fail(why, APC_EINVAL, "link inproc: frame_max is %zu: a frame has at most %u bytes",
                        o->frame_max, APC_FRAME_MAX);
    o->network.size = sizeof(o->network);
    return 0;
}

int apc_inproc_create(struct apc_inproc **link, const struct apc_inproc_options *options,
                      struct apc_error *why)
{
    struct apc_inproc_options o = {.network = {.size = sizeof(o.network)}};
    struct apc_inproc *new = NULL;
    int rc;

    if (!link)
        return apc_fail(why, APC_EINVAL, "no place for the link");
    *link = NULL;
    rc = take_options(&o, options, why);
    if (rc < 0)
        return rc;
    new = calloc(1, sizeof(*new));
    if (new)
        new->reply = malloc(o.frame_max);
    if (!new || !new->reply) {
        apc_inproc_destroy(new);
        return apc_fail(why, APC_ENOMEM, "link inproc: no memory");
    }
    new->options = o;
    new->clock = apc_executive_clock(o.executive);
    new->connection = 1;
    o.network.name = "network.to";
    rc = apc_network_create(&new->to, &o.network, why);
    o.network.name = "network.from";
    if (rc == 0)
        rc = apc_network_create(&new->from, &o.network, why);
    o.network.name = "network.again";
    if (rc == 0)
        rc = apc_network_create(&new->again, &o.network, why);
    if (rc < 0) {
        apc_inproc_destroy(new);
        return rc;
    }
    *link = new;
    return 0;
}

void apc_inproc_destroy(struct apc_inproc *link)
{
    if (!link)
        return;
    for (struct flight *f = link->all, *next; f; f = next) {
        next = f->all;
        free(f->bytes);
        free(f);
    }
    apc_network_destroy(link->to);
    apc_network_destroy(link->from);
    apc_network_destroy(link->again);
    free(link->reply);
    free(link);
}

int apc_inproc_exchange(struct apc_inproc *link, const char *request, size_t length, apc_ns timeout,
                        apc_reply_fn fn, void *ctx)
{
    const struct apc_inproc_options *o = &link->options;
    const apc_ns now = apc_clock_mono(link->clock);

    if (!request || !fn || length > o->frame_max || timeout <= 0 || timeout > INT64_MAX - now)
        return APC_EINVAL;
    if (link->waiting)
        return APC_EBUSY;
    if (apc_virtual_at(o->executive, now + timeout, INT_MAX, on_deadline, link) < 0)
        return APC_ENOMEM;
    link->waiting = true;
    link->deadline = now + timeout;
    link->fn = fn;
    link->ctx = ctx;
    link->stats.exchanges++;
    const struct flight of = {.connection = link->connection, .exchange = link->stats.exchanges};
    const struct apc_network_fate fate = apc_network_draw(link->to),
                                  reply[2] = {apc_network_draw(link->from),
                                              fate.twice ? apc_network_draw(link->again) : fate};
    int rc = send(link, link->to, &fate, o->request_rank, on_request, of, reply, request, (int)length);
    if (rc < 0)
        link->waiting = false;
    return rc;
}

void apc_inproc_reset(struct apc_inproc *link)
{
    link->connection++;
    link->waiting = false;
}

void apc_inproc_stats(const struct apc_inproc *link, struct apc_inproc_stats *stats)
{
    struct apc_network_stats from;

    *stats = link->stats;
    apc_network_stats(link->to, &stats->frames);
    apc_network_stats(link->from, &from);
    stats->frames.sent += from.sent;
    stats->frames.lost += from.lost;
    stats->frames.duplicated += from.duplicated;
    stats->frames.reordered += from.reordered;
}

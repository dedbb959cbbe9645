/* SPDX-License-Identifier: BSD-3-Clause */
/*
 * The scheme inproc: frames over a modelled network, as events of a virtual executive. As over tcp: an
 * exchange that fails closes the connection; a request that is under way still arrives, and connecting takes
 * no time.
 *
 * A reply belongs to the exchange whose request it answers, and to no other: neither one that comes too late
 * nor that of a request that arrived twice is taken for the next one's. What is under way lies in flights,
 * which are used again and again, so that what has seen its busiest moment allocates no more. What the
 * network does to both frames of an exchange, and to the reply to a copy of its request, is drawn when it
 * begins, each from streams of its own: so the n-th exchange meets the same fate whether or not the others
 * were lost, doubled or late. A flight is the context of its event; the exchange's own event is the end of
 * its patience. One that comes after the reply finds another deadline, or none, and does nothing; it is the
 * last thing of its instant, so that a reply that just comes in time does.
 */
#include "base/base_internal.h"
#include "exchange/exchange_internal.h"

#include <limits.h>
#include <stdlib.h>
#include <string.h>

struct flight {
    struct inproc *of;
    struct flight *next, *all;     /* free ones; all there are */
    uint64_t connection, exchange; /* to which it belongs */
    struct apc_network_fate reply; /* of a request: what becomes of its reply */
    int length;                    /* of a reply: negative when the connection is closed instead */
    char bytes[];                  /* room for any frame between the two */
};

struct inproc {
    struct apc_exchange x;
    struct apc_inproc_options options;
    const struct apc_clock *clock;
    struct apc_network *to, *from;
    struct apc_network *again; /* draws the fate of replies to copies; they go by `from` as well */
    struct flight *free, *all;
    struct apc_frames frames;
    uint64_t connection;
    char *reply; /* as the plant wrote it */

    bool waiting;
    apc_ns deadline;
    int result;           /* of the exchange that ended last, ... */
    struct apc_value *y;  /* [ny] ... its values, ... */
    struct apc_error why; /* ... or why there are none */
    struct apc_inproc_stats stats;
};

/* ---- Flights ------------------------------------------------------------------------------- */

static struct flight *take_flight(struct inproc *p)
{
    struct flight *f = p->free;

    if (f) {
        p->free = f->next;
        return f;
    }
    f = malloc(sizeof(*f) + p->frames.room);
    if (f) {
        f->of = p;
        f->all = p->all;
        p->all = f;
    }
    return f;
}

static void land(struct flight *f)
{
    f->next = f->of->free;
    f->of->free = f;
}

/* Each copy that arrives is a flight of its own. @reply: what becomes of the replies to a request and to its
 * copy. */
static int send(struct inproc *p, struct apc_network *network, const struct apc_network_fate *fate, int rank,
                apc_virtual_fn arrival, const struct flight *of, const struct apc_network_fate reply[2],
                const char *bytes, int length)
{
    const size_t size = length > 0 ? (size_t)length : 0;
    apc_ns at[2];
    int n = apc_network_carry(network, fate, apc_clock_mono(p->clock), size, at);

    for (int i = 0; i < n; i++) {
        struct flight *f = take_flight(p);

        if (!f)
            return APC_ENOMEM;
        f->connection = of->connection;
        f->exchange = of->exchange;
        if (reply)
            f->reply = reply[i];
        f->length = length;
        if (size)
            memcpy(f->bytes, bytes, size);
        if (apc_virtual_at(p->options.executive, at[i], rank, arrival, f) < 0) {
            land(f);
            return APC_ENOMEM;
        }
    }
    return 0;
}

/* ---- Arrivals ------------------------------------------------------------------------------ */

static void end_exchange(struct inproc *p, int result)
{
    p->waiting = false;
    p->result = result;
    if (result < 0)
        p->connection++;
    if (p->options.done)
        p->options.done(p->options.done_ctx);
}

static void end_in_vain(struct inproc *p, int result)
{
    end_exchange(p, apc_fail(&p->why, result, "%s", apc_err_text(result)));
}

static void on_reply(void *ctx)
{
    struct flight *f = ctx;
    struct inproc *p = f->of;

    if (p->waiting && f->exchange == p->stats.exchanges) {
        if (f->length < 0) {
            end_in_vain(p, APC_ECONN);
        } else {
            int rc = apc_frames_answer(&p->frames, f->bytes, (size_t)f->length, p->y, &p->why);
            p->x.refused = p->frames.refused;
            end_exchange(p, rc);
        }
    }
    land(f);
}

static void on_inproc_request(void *ctx)
{
    struct flight *f = ctx;
    struct inproc *p = f->of;
    const struct apc_inproc_options *o = &p->options;
    int length = o->serve(o->serve_ctx, f->connection, f->bytes, (size_t)f->length, p->reply, p->frames.room);

    /* without memory the reply is as good as lost */
    (void)send(p, p->from, &f->reply, o->reply_rank, on_reply, f, NULL, p->reply, length);
    land(f);
}

static void on_deadline(void *ctx)
{
    struct inproc *p = ctx;

    if (!p->waiting || apc_clock_mono(p->clock) < p->deadline)
        return;
    p->stats.timeouts++;
    end_in_vain(p, APC_ETIMEDOUT);
}

/* ---- The scheme ---------------------------------------------------------------------------- */

static void inproc_close(struct apc_exchange *x)
{
    struct inproc *p = (struct inproc *)x;

    for (struct flight *f = p->all, *next; f; f = next) {
        next = f->all;
        free(f);
    }
    apc_network_destroy(p->to);
    apc_network_destroy(p->from);
    apc_network_destroy(p->again);
    apc_frames_free(&p->frames);
    free(p->reply);
    free(p->y);
    free(p);
}

static int take_inproc_options(struct apc_inproc_options *o, const struct apc_inproc_options *options,
                               struct apc_error *why)
{
    int rc = apc_options_copy(o, sizeof(*o), options, "apc_inproc_options", why);

    if (rc < 0)
        return rc;
    if (!o->executive || !o->serve)
        return apc_fail(why, APC_EINVAL, "inproc: executive and serve are required");
    if (!apc_executive_is_virtual(o->executive))
        return apc_fail(why, APC_EINVAL, "inproc runs in virtual time only");
    o->network.size = sizeof(o->network);
    return 0;
}

static int make_networks(struct inproc *p, struct apc_error *why)
{
    struct apc_network_options o = p->options.network;
    const struct {
        const char *name;
        struct apc_network **network;
    } ways[] = {{"network.to", &p->to}, {"network.from", &p->from}, {"network.again", &p->again}};
    int rc = 0;

    for (size_t i = 0; i < sizeof(ways) / sizeof(ways[0]) && rc == 0; i++) {
        o.name = ways[i].name;
        rc = apc_network_create(ways[i].network, &o, why);
    }
    return rc;
}

static int inproc_open(struct apc_exchange **x, const char *uri, const struct apc_exchange_options *options,
                       struct apc_error *why)
{
    struct apc_inproc_options o = {.network = {.size = sizeof(o.network)}};
    struct inproc *p = NULL;
    int rc = take_inproc_options(&o, options->inproc, why);

    if (rc < 0)
        return rc;
    p = calloc(1, sizeof(*p));
    if (!p)
        return apc_fail(why, APC_ENOMEM, "plant \"%s\": no memory", uri);
    p->options = o;
    p->clock = apc_executive_clock(o.executive);
    p->connection = 1;
    rc = apc_frames_init(&p->frames, options->nu, options->ny);
    p->reply = malloc(p->frames.room);
    p->y = calloc(options->ny, sizeof(*p->y));
    if (rc < 0 || !p->reply || !p->y)
        rc = apc_fail(why, APC_ENOMEM, "plant \"%s\": no memory", uri);
    else
        rc = make_networks(p, why);
    if (rc < 0) {
        inproc_close(&p->x);
        return rc;
    }
    *x = &p->x;
    return 0;
}

static int inproc_begin(struct apc_exchange *x, const struct apc_value *u, apc_ns deadline)
{
    struct inproc *p = (struct inproc *)x;
    const struct apc_inproc_options *o = &p->options;
    int length = apc_frames_ask(&p->frames, u, &x->error);

    if (length < 0)
        return length;
    if (deadline <= apc_clock_mono(p->clock))
        return apc_fail(&x->error, APC_ETIMEDOUT, "%s", apc_err_text(APC_ETIMEDOUT));
    if (apc_virtual_at(o->executive, deadline, INT_MAX, on_deadline, p) < 0)
        return apc_fail(&x->error, APC_ENOMEM, "%s", apc_err_text(APC_ENOMEM));
    p->waiting = true;
    p->deadline = deadline;
    p->stats.exchanges++;
    const struct flight of = {.connection = p->connection, .exchange = p->stats.exchanges};
    const struct apc_network_fate fate = apc_network_draw(p->to),
                                  reply[2] = {apc_network_draw(p->from),
                                              fate.twice ? apc_network_draw(p->again) : fate};
    int rc = send(p, p->to, &fate, o->request_rank, on_inproc_request, &of, reply, p->frames.text, length);
    if (rc < 0)
        p->waiting = false;
    return rc < 0 ? apc_fail(&x->error, rc, "%s", apc_err_text(rc)) : 0;
}

static int inproc_finish(struct apc_exchange *x, struct apc_value *y)
{
    const struct inproc *p = (const struct inproc *)x;

    if (p->waiting)
        return APC_EBUSY;
    if (p->result < 0)
        return apc_fail(&x->error, p->result, "%s", p->why.text);
    memcpy(y, p->y, x->ny * sizeof(*y));
    return 0;
}

void apc_inproc_stats(const struct apc_exchange *x, struct apc_inproc_stats *stats)
{
    const struct inproc *p = (const struct inproc *)x;
    struct apc_network_stats from = {.size = sizeof(from)};
    struct apc_inproc_stats all = {.size = 0};

    if (x->ops == &apc_exchange_inproc) {
        all = p->stats;
        all.frames.size = sizeof(all.frames);
        apc_network_stats(p->to, &all.frames);
        apc_network_stats(p->from, &from);
        all.frames.sent += from.sent;
        all.frames.lost += from.lost;
        all.frames.duplicated += from.duplicated;
        all.frames.reordered += from.reordered;
    }
    apc_result_copy(stats, &all, sizeof(all));
}

const struct apc_exchange_ops apc_exchange_inproc = {.scheme = "inproc:",
                                                     .open = inproc_open,
                                                     .close = inproc_close,
                                                     .begin = inproc_begin,
                                                     .finish = inproc_finish};

/* SPDX-License-Identifier: BSD-3-Clause */
/*
 * The asking side of a link: one request, one reply, one deadline.
 *
 * Between two exchanges the link is in one of three states: connected with nothing under way; not connected
 * and free to connect; not connected and pausing until `retry_at`. A failed connect and a refusal lead to
 * the third, every other failure to the second. So there is never a connection on which an old
 * reply could still come: that is what keeps a late answer from being taken for the next one's.
 * Only where `late` tells late replies from others does the connection outlast a request without a reply;
 * what comes for that one is dropped.
 *
 * The pause doubles from backoff_min to backoff_max and is multiplied by a random
 * factor in [0.5, 1], so that a hundred clients of a plant that restarts do not come back in step. A
 * connection that the peer closed (it restarted) is noticed before the request is sent, and costs no tick.
 * Where the peer closes one after another without ever answering, it refuses us: that is as a connect that
 * failed.
 */
#include "base/base_internal.h"
#include "sockets/sockets_internal.h"

#include <stdlib.h>
#include <string.h>

#define REPLY_MAX   (64u << 10)
#define BACKOFF_MIN (100 * APC_NS_PER_MS)
#define BACKOFF_MAX (5 * APC_NS_PER_S)

static const struct apc_transport *const transports[] = {&apc_transport_tcp, &apc_transport_tls, NULL};

struct apc_link {
    const struct apc_transport *transport;
    void *self; /* the transport's own */
    char *uri, *reply;
    struct apc_link_options options; /* no zeros left */
    bool connected, asked;           /* what was sent last has no reply yet */
    size_t have;                     /* bytes of a reply that has not come whole */
    unsigned refused;                /* connections in a row that the peer closed without a reply */
    bool answered;                   /* a reply came on this connection */
    uint64_t connects;
    apc_ns pause;    /* of the next failed connect, before jitter */
    apc_ns retry_at; /* monotonic; no connect before it */
    uint64_t random;
    struct apc_error error;
};

static const struct apc_transport *find_transport(const char *uri)
{
    for (size_t i = 0; transports[i]; i++)
        if (!strncmp(uri, transports[i]->scheme, strlen(transports[i]->scheme)))
            return transports[i];
    return NULL;
}

static int take_link_options(struct apc_link_options *o, const struct apc_link_options *options,
                             struct apc_error *why)
{
    int err = apc_options_copy(o, sizeof *o, options, "apc_link_options", why);
    if (err < 0)
        return err;
    if (!o->frame_max)
        o->frame_max = REPLY_MAX;
    if (!o->backoff_min)
        o->backoff_min = BACKOFF_MIN;
    if (!o->backoff_max)
        o->backoff_max = o->backoff_min > BACKOFF_MAX ? o->backoff_min : BACKOFF_MAX;
    if (!o->seed)
        o->seed = (uint64_t)apc_clock_mono(NULL);
    if (o->frame_max > APC_FRAME_MAX)
        return apc_fail(why, APC_EINVAL, "frame_max is %zu: a frame has at most %u bytes", o->frame_max,
                        APC_FRAME_MAX);
    if (o->backoff_min < 0 || o->backoff_max < o->backoff_min)
        return apc_fail(why, APC_EINVAL, "backoff must be 0 < min <= max");
    return 0;
}

int apc_link_create(struct apc_link **link, const char *uri, const struct apc_link_options *options,
                    struct apc_error *why)
{
    struct apc_link_options o = {0};
    const struct apc_transport *transport;
    struct apc_link *l = NULL;
    int err;

    if (!link)
        return apc_fail(why, APC_EINVAL, "no place for the link");
    *link = NULL;
    transport = uri ? find_transport(uri) : NULL;
    if (!transport)
        return apc_fail(why, APC_EINVAL,
                        "link \"%s\": unknown scheme; expected tcp:HOST:PORT or tls:HOST:PORT",
                        uri ? uri : "");
    err = take_link_options(&o, options, why);
    if (err < 0)
        return err;
    err = APC_ENOMEM;
    l = calloc(1, sizeof *l);
    if (!l || !(l->uri = strdup(uri)) || !(l->reply = malloc(o.frame_max))) {
        apc_fail(why, err, "link \"%s\": no memory", uri);
        goto fail;
    }
    l->transport = transport;
    l->options = o;
    l->pause = o.backoff_min;
    l->random = o.seed;
    err = transport->create(&l->self, uri, o.identity, why);
    if (err < 0)
        goto fail;
    *link = l;
    return 0;
fail:
    apc_link_destroy(l);
    return err;
}

void apc_link_destroy(struct apc_link *l)
{
    if (!l)
        return;
    if (l->self)
        l->transport->destroy(l->self);
    free(l->reply);
    free(l->uri);
    free(l);
}

/* Uniform in [0, 1): splitmix64. */
static double next_link_random(uint64_t *state)
{
    uint64_t z = *state += UINT64_C(0x9E3779B97F4A7C15);
    z = (z ^ z >> 30) * UINT64_C(0xBF58476D1CE4E5B9);
    z = (z ^ z >> 27) * UINT64_C(0x94D049BB133111EB);
    return (double)((z ^ z >> 31) >> 11) * 0x1p-53;
}

static void begin_pause(struct apc_link *l)
{
    l->retry_at =
        apc_clock_mono(NULL) + (apc_ns)((double)l->pause * (0.5 + next_link_random(&l->random) / 2));
    l->pause = l->pause > l->options.backoff_max / 2 ? l->options.backoff_max : 2 * l->pause;
}

static int connect_link(struct apc_link *l, apc_ns deadline)
{
    struct apc_error why;
    int err;

    if (apc_clock_mono(NULL) < l->retry_at)
        return APC_ECONN; /* the text still says why the last try failed */
    err = l->transport->connect(l->self, deadline, &why);
    if (err < 0) {
        begin_pause(l);
        return apc_fail(&l->error, err, "link \"%s\": %s", l->uri, why.text);
    }
    l->connected = true;
    l->answered = false;
    l->connects++;
    if (l->refused == 0)
        l->pause = l->options.backoff_min;
    return 0;
}

static int fail_exchange(struct apc_link *l, int result, const struct apc_error *why)
{
    if (result == APC_ECONN && !l->answered && ++l->refused > 1)
        begin_pause(l);
    apc_link_reset(l);
    return apc_fail(&l->error, result, "link \"%s\": %s", l->uri, why->text);
}

/* How long the reply is that begins with what is there; of @have bytes the last @n are new. */
static int reply_length(const struct apc_link *l, size_t have, size_t n)
{
    const char *newline;

    if (l->options.whole)
        return l->options.whole(l->reply, have);
    newline = memchr(l->reply + have - n, '\n', n);
    return newline ? (int)(newline + 1 - l->reply) : 0;
}

/* One whole reply that is not late. */
static int receive_reply(struct apc_link *l, apc_ns deadline, struct apc_error *why)
{
    while (l->have < l->options.frame_max) {
        int length, n = l->transport->receive(l->self, l->reply + l->have, l->options.frame_max - l->have,
                                              deadline, why);
        if (n < 0)
            return n;
        l->have += (size_t)n;
        while ((length = reply_length(l, l->have, (size_t)n)) > 0 && (size_t)length <= l->have &&
               l->options.late && l->options.late(l->options.late_ctx, l->reply, (size_t)length)) {
            l->have -= (size_t)length;
            memmove(l->reply, l->reply + length, l->have);
            n = (int)l->have; /* the late one ended with what is new */
        }
        if (length < 0)
            return apc_fail(why, APC_EPROTO, "what the peer sent is no reply");
        if (length > 0 && (size_t)length < l->have)
            return apc_fail(why, APC_EPROTO, "the peer sent more than one reply");
        if (length > 0 && (size_t)length == l->have) {
            l->have = 0;
            return length;
        }
    }
    return apc_fail(why, APC_EPROTO, "the reply is longer than %zu bytes", l->options.frame_max);
}

/* May the next request go out on this connection? Not if a reply may still come, nor if the peer went away or
 * spoke unasked. */
static bool is_free(struct apc_link *l)
{
    struct apc_error why;

    return !l->asked &&
           (l->transport->quiet(l->self) || (l->options.late && receive_reply(l, 0, &why) == APC_ETIMEDOUT));
}

int apc_link_send(struct apc_link *l, const char *request, size_t length, apc_ns deadline)
{
    struct apc_error why;
    int result;

    if (!l || !request || length == 0)
        return APC_EINVAL;
    if (l->connected && !is_free(l))
        apc_link_reset(l);
    if (!l->connected) {
        result = connect_link(l, deadline);
        if (result < 0)
            return result;
    }
    if (apc_clock_mono(NULL) >= deadline)
        return apc_fail(&l->error, APC_ETIMEDOUT, "link \"%s\": its time was over before it was sent",
                        l->uri);
    result = l->transport->send(l->self, request, length, deadline, &why);
    if (result < 0)
        return fail_exchange(l, result, &why);
    l->asked = true;
    return 0;
}

int apc_link_receive(struct apc_link *l, const char **reply, apc_ns deadline)
{
    struct apc_error why;
    int result;

    if (!l || !reply)
        return APC_EINVAL;
    *reply = NULL;
    if (!l->asked)
        return apc_fail(&l->error, APC_EINVAL, "link \"%s\": nothing was asked", l->uri);
    result = receive_reply(l, deadline, &why);
    if (result == APC_ETIMEDOUT && l->options.late) {
        l->asked = false;
        return apc_fail(&l->error, result, "link \"%s\": %s", l->uri, why.text);
    }
    if (result < 0)
        return fail_exchange(l, result, &why);
    l->asked = false;
    l->answered = true;
    l->refused = 0;
    l->pause = l->options.backoff_min;
    l->error.text[0] = '\0';
    *reply = l->reply;
    return result;
}

int apc_link_exchange(struct apc_link *l, const char *request, size_t length, const char **reply,
                      apc_ns deadline)
{
    int result;

    if (!reply)
        return APC_EINVAL;
    *reply = NULL;
    result = apc_link_send(l, request, length, deadline);
    return result < 0 ? result : apc_link_receive(l, reply, deadline);
}

void apc_link_reset(struct apc_link *l)
{
    if (!l || !l->connected)
        return;
    l->transport->close(l->self);
    l->connected = l->asked = false;
    l->have = 0;
}

bool apc_link_connected(const struct apc_link *l)
{
    return l && l->connected;
}

uint64_t apc_link_connects(const struct apc_link *l)
{
    return l ? l->connects : 0;
}

const char *apc_link_error(const struct apc_link *l)
{
    return l ? l->error.text : "";
}

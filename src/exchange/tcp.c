/* SPDX-License-Identifier: BSD-3-Clause */
/* The schemes tcp: and tls:, frames over a link. */
#include "exchange/exchange_internal.h"

#include <stdlib.h>

struct tcp {
    struct apc_exchange x;
    struct apc_link *link;
    struct apc_frames frames;
    apc_ns deadline;
};

static void tcp_close(struct apc_exchange *x)
{
    struct tcp *t = (struct tcp *)x;

    apc_link_destroy(t->link);
    apc_frames_free(&t->frames);
    free(t);
}

static int tcp_open(struct apc_exchange **x, const char *uri, const struct apc_exchange_options *options,
                    struct apc_error *why)
{
    struct apc_link_options link = {.size = sizeof(link), .identity = options->identity};
    struct tcp *t = calloc(1, sizeof(*t));
    int rc = t ? apc_frames_init(&t->frames, options->nu, options->ny) : APC_ENOMEM;

    if (!t)
        return apc_fail(why, rc, "plant \"%s\": no memory", uri);
    if (rc < 0) {
        (void)apc_fail(why, rc, "plant \"%s\": no memory", uri);
    } else {
        link.frame_max = t->frames.room;
        rc = apc_link_create(&t->link, uri, &link, why);
    }
    if (rc < 0) {
        tcp_close(&t->x);
        return rc;
    }
    *x = &t->x;
    return 0;
}

static int tcp_begin(struct apc_exchange *x, const struct apc_value *u, apc_ns deadline)
{
    struct tcp *t = (struct tcp *)x;
    int n = apc_frames_ask(&t->frames, u, &x->error);

    if (n < 0)
        return n;
    t->deadline = deadline;
    n = apc_link_send(t->link, t->frames.text, (size_t)n, deadline);
    return n < 0 ? apc_fail(&x->error, n, "%s", apc_link_error(t->link)) : 0;
}

static int tcp_finish(struct apc_exchange *x, struct apc_value *y)
{
    struct tcp *t = (struct tcp *)x;
    const char *reply;
    int rc = apc_link_receive(t->link, &reply, t->deadline);

    if (rc < 0)
        return apc_fail(&x->error, rc, "%s", apc_link_error(t->link));
    rc = apc_frames_answer(&t->frames, reply, (size_t)rc, y, &x->error);
    x->refused = t->frames.refused;
    if (rc < 0)
        apc_link_reset(t->link);
    return rc;
}

static void tcp_claim(struct apc_exchange *x, uint64_t number)
{
    apc_frames_claim(&((struct tcp *)x)->frames, number);
}

const struct apc_exchange_ops apc_exchange_tcp = {.scheme = "tcp:",
                                                  .open = tcp_open,
                                                  .close = tcp_close,
                                                  .begin = tcp_begin,
                                                  .finish = tcp_finish,
                                                  .claim = tcp_claim};

const struct apc_exchange_ops apc_exchange_tls = {.scheme = "tls:",
                                                  .open = tcp_open,
                                                  .close = tcp_close,
                                                  .begin = tcp_begin,
                                                  .finish = tcp_finish,
                                                  .claim = tcp_claim};

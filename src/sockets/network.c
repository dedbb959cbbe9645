/* SPDX-License-Identifier: BSD-3-Clause */
/* A modelled network: what becomes of a frame, drawn from seeded streams. */
#include "apcsockets.h"
#include "base/base_internal.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#define DELAY_MAX 1e9 /* s: a draw beyond, such as of exponential(1e300), must not become none at all */

/* A stream for each thing that is drawn. */
enum stream { DELAY, JITTER, LOSS, DUPLICATION, REORDERING, COPY_DELAY, COPY_JITTER, STREAMS };

struct apc_network {
    struct apc_network_options options;
    struct apc_outage *outages; /* options.outages */
    struct apc_random random[STREAMS];
    struct apc_network_stats stats;
    apc_ns idle_at; /* when the line has sent all that it was given */
    apc_ns newest;  /* when the last frame that keeps its order arrives */
};

static int check_probability(const char *what, double p, struct apc_error *why)
{
    return p >= 0.0 && p <= 1.0
               ? 0
               : apc_fail(why, APC_EINVAL, "network: %s is %g; it is a probability, 0 to 1", what, p);
}

static int check_network_options(const struct apc_network_options *o, struct apc_error *why)
{
    int rc;

    /* of a normal one it is the mean that counts: its tail below 0 is cut */
    if (o->delay.kind && apc_distribution_low(&o->delay) < 0.0 &&
        !(o->delay.kind == APC_NORMAL && o->delay.a >= 0.0))
        return apc_fail(why, APC_EINVAL, "network: a delay must not be negative");
    if ((rc = check_probability("loss", o->loss, why)) < 0 ||
        (rc = check_probability("duplication", o->duplication, why)) < 0 ||
        (rc = check_probability("reordering", o->reordering, why)) < 0)
        return rc;
    if (!(o->bandwidth >= 0.0) || !isfinite(o->bandwidth))
        return apc_fail(why, APC_EINVAL, "network: bandwidth is %g bit/s; it must not be negative",
                        o->bandwidth);
    for (size_t i = 0; i < o->n_outages; i++)
        if (o->outages[i].until < o->outages[i].from)
            return apc_fail(why, APC_EINVAL, "network: outage %zu ends before it begins", i + 1);
    return 0;
}

int apc_network_create(struct apc_network **network, const struct apc_network_options *options,
                       struct apc_error *why)
{
    static const char *const names[STREAMS] = {"delay",      "jitter",     "loss",       "duplication",
                                               "reordering", "copy.delay", "copy.jitter"};
    struct apc_network_options o = {0};
    char name[128];
    int rc;

    if (!network)
        return apc_fail(why, APC_EINVAL, "no place for the network");
    *network = NULL;
    if ((rc = apc_options_copy(&o, sizeof o, options, "apc_network_options", why)) < 0 ||
        (rc = check_network_options(&o, why)) < 0)
        return rc;
    struct apc_network *n = calloc(1, sizeof *n);
    struct apc_outage *outages = calloc(o.n_outages + 1, sizeof *outages);
    if (!n || !outages) {
        free(n);
        free(outages);
        return apc_fail(why, APC_ENOMEM, "network: no memory");
    }
    if (o.n_outages > 0)
        memcpy(outages, o.outages, o.n_outages * sizeof *outages);
    n->options = o;
    n->options.outages = n->outages = outages;
    for (size_t i = 0; i < STREAMS; i++) {
        snprintf(name, sizeof name, "%.100s.%s", o.name ? o.name : "network", names[i]);
        apc_random_init(&n->random[i], o.seed, name);
    }
    n->idle_at = n->newest = INT64_MIN;
    *network = n;
    return 0;
}

void apc_network_destroy(struct apc_network *network)
{
    if (!network)
        return;
    free(network->outages);
    free(network);
}

/* ---- A frame ------------------------------------------------------------------------------- */

static bool happens(struct apc_network *n, enum stream stream, double probability)
{
    return probability > 0.0 && apc_random_uniform(&n->random[stream]) < probability;
}

static double drawn(const struct apc_distribution *d, struct apc_random *random)
{
    return d->kind ? apc_distribution_draw(d, random) : 0.0;
}

static apc_ns delay_of(struct apc_network *n, enum stream delay, enum stream jitter)
{
    double seconds = fmax(drawn(&n->options.delay, &n->random[delay]), 0.0);
    apc_ns ns = 0;

    seconds += drawn(&n->options.jitter, &n->random[jitter]);
    return seconds > 0.0 && apc_ns_from_s(fmin(seconds, DELAY_MAX), &ns) == 0 ? ns : 0;
}

static bool in_outage(const struct apc_network_options *o, apc_ns now)
{
    for (size_t i = 0; i < o->n_outages; i++)
        if (now >= o->outages[i].from && now < o->outages[i].until)
            return true;
    return false;
}

/* When the last bit has been sent. */
static apc_ns transmit(struct apc_network *n, apc_ns now, size_t length)
{
    apc_ns takes = 0;

    if (n->options.bandwidth <= 0.0)
        return now;
    (void)apc_ns_from_s(fmin(8.0 * (double)length / n->options.bandwidth, DELAY_MAX), &takes);
    n->idle_at = (n->idle_at > now ? n->idle_at : now) + takes;
    if (n->idle_at - now > (apc_ns)DELAY_MAX * APC_NS_PER_S)
        n->idle_at = now + (apc_ns)DELAY_MAX * APC_NS_PER_S;
    return n->idle_at;
}

/* In order, unless it overtakes. */
static apc_ns arrival_time(struct apc_network *n, apc_ns at)
{
    if (at < n->newest)
        at = n->newest;
    n->newest = at;
    return at;
}

struct apc_network_fate apc_network_draw(struct apc_network *network)
{
    const struct apc_network_options *o = &network->options;
    struct apc_network_fate fate = {.delay = delay_of(network, DELAY, JITTER)};

    fate.lost = happens(network, LOSS, o->loss);
    fate.twice = happens(network, DUPLICATION, o->duplication);
    fate.overtakes = happens(network, REORDERING, o->reordering);
    fate.copy_delay = fate.twice ? delay_of(network, COPY_DELAY, COPY_JITTER) : 0;
    return fate;
}

int apc_network_carry(struct apc_network *network, const struct apc_network_fate *fate, apc_ns now,
                      size_t length, apc_ns at[2])
{
    const apc_ns gone = transmit(network, now, length);

    network->stats.sent++;
    if (fate->lost || in_outage(&network->options, now)) {
        network->stats.lost++;
        return 0;
    }
    network->stats.duplicated += fate->twice;
    network->stats.reordered += fate->overtakes;
    at[0] = fate->overtakes ? gone : arrival_time(network, gone + fate->delay);
    at[1] = fate->twice ? arrival_time(network, gone + fate->copy_delay) : 0;
    return fate->twice ? 2 : 1;
}

int apc_network_send(struct apc_network *network, apc_ns now, size_t length, apc_ns at[2])
{
    const struct apc_network_fate fate = apc_network_draw(network);

    return apc_network_carry(network, &fate, now, length, at);
}

void apc_network_stats(const struct apc_network *network, struct apc_network_stats *stats)
{
    apc_result_copy(stats, &network->stats, sizeof(network->stats));
}

/* SPDX-License-Identifier: BSD-3-Clause */
#include "credentials.h"

#include <stdlib.h>
#include <string.h>

#define LOOK_EVERY (10 * APC_NS_PER_S)
#define DAY        (24 * 3600L * APC_NS_PER_S)

int credentials_stage(apc_ns left)
{
    static const apc_ns limit[] = {30 * DAY, 7 * DAY, DAY, 0};
    int stage = 0;

    while (stage < 4 && left <= limit[stage])
        stage++;
    return stage;
}

static void watch_expiry(struct credentials *c)
{
    const apc_ns expiry = apc_identity_expiry(c->identity), left = expiry - apc_clock_utc(NULL);
    const int stage = credentials_stage(left);
    char time[APC_TIME_LEN];

    if (stage > c->warned && stage == 4)
        daemon_event(
            c->d, APC_EVENT_ALARM, "certificate",
            "the certificate expired at %s: a connection that stands goes on, no new one can be made; make "
            "another with `apc cert`",
            apc_time_format(expiry, time));
    else if (stage > c->warned)
        daemon_event(c->d, APC_EVENT_WARNING, "certificate",
                     "the certificate expires in %.1f days, at %s; make another with `apc cert`",
                     (double)left / (double)DAY, apc_time_format(expiry, time));
    c->warned = stage;
}

static void refresh(struct credentials *c)
{
    struct apc_error why;
    const int rc = apc_identity_refresh(c->identity, &why);
    char time[APC_TIME_LEN];

    const apc_ns expiry = apc_identity_expiry(c->identity);

    if (rc > 0)
        daemon_event(c->d, APC_EVENT_INFO, "certificate", "a new certificate is in use, valid %s%s",
                     expiry < INT64_MAX ? "until " : "without an end",
                     expiry < INT64_MAX ? apc_time_format(expiry, time) : "");
    else if (rc < 0 && !c->broken)
        daemon_event(c->d, APC_EVENT_WARNING, "certificate",
                     "%.150s; the one that was read before stays in use", why.text);
    if (rc != 0)
        c->broken = rc < 0;
}

static apc_ns look_for_credentials(void *ctx)
{
    struct credentials *c = ctx;
    const apc_ns now = apc_clock_mono(NULL);

    if (now >= c->look_at) {
        c->look_at = now + LOOK_EVERY;
        refresh(c);
        watch_expiry(c);
    }
    return LOOK_EVERY;
}

void credentials_watch(struct credentials *c, struct daemon *d, struct apc_identity *identity)
{
    *c = (struct credentials){.d = d, .identity = identity};
    d->look = look_for_credentials;
    d->look_ctx = c;
}

int credentials_open(struct credentials *c, struct daemon *d, const char *address, const char *file)
{
    struct apc_error why;

    struct apc_identity *identity;

    *c = (struct credentials){.d = d};
    if (strncmp(address, "tls:", 4) != 0)
        return 0;
    if (!file || !*file)
        file = getenv("APC_IDENTITY");
    if (!file || !*file)
        return daemon_error(d, APC_EINVAL,
                            "link \"%s\": the identity of this program is missing: give --identity FILE, "
                            "APC_IDENTITY, or \"identity\" in the experiment file; `apc cert` makes one",
                            address);
    int rc = apc_identity_load(&identity, file, &why);
    if (rc < 0)
        return daemon_error(d, rc, "%s", why.text);
    credentials_watch(c, d, identity);
    return 0;
}

void credentials_close(struct credentials *c)
{
    apc_identity_free(c->identity);
}

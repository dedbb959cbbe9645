/* SPDX-License-Identifier: BSD-3-Clause */
/* In the place of tls.c where OpenSSL's libssl was not there when this was built: nobody gets an identity, so
 * nobody gets to the rest. */
#include "sockets/sockets_internal.h"

#include <errno.h>

int apc_identity_load(struct apc_identity **identity, const char *file, struct apc_error *why)
{
    if (identity)
        *identity = NULL;
    return apc_fail(why, APC_ESTATE,
                    "identity \"%s\": this libapc was built without OpenSSL, so there is no tls:; install "
                    "libssl-dev and build it again",
                    file ? file : "");
}

void apc_identity_free(struct apc_identity *identity)
{
    (void)identity;
}

int apc_identity_refresh(struct apc_identity *identity, struct apc_error *why)
{
    (void)identity;
    return apc_fail(why, APC_ESTATE, "this libapc was built without OpenSSL");
}

apc_ns apc_identity_expiry(struct apc_identity *identity)
{
    (void)identity;
    return INT64_MAX;
}

int apc_tls_ask(struct apc_tls **tls, struct apc_identity *identity, int fd, const struct apc_hostport *host)
{
    (void)identity, (void)fd, (void)host;
    *tls = NULL;
    return APC_ESTATE;
}

int apc_tls_answer(struct apc_tls **tls, struct apc_identity *identity, int fd, const char *const *clients,
                   size_t n)
{
    (void)identity, (void)fd, (void)clients, (void)n;
    *tls = NULL;
    return APC_ESTATE;
}

void apc_tls_free(struct apc_tls *tls)
{
    (void)tls;
}

int apc_tls_handshake(struct apc_tls *tls, struct apc_error *why)
{
    (void)tls;
    return apc_fail(why, APC_EPROTO, "this libapc was built without OpenSSL");
}

ssize_t apc_tls_recv(struct apc_tls *tls, char *data, size_t size)
{
    (void)tls, (void)data, (void)size;
    errno = EPROTO;
    return -1;
}

ssize_t apc_tls_send(struct apc_tls *tls, const char *data, size_t size)
{
    (void)tls, (void)data, (void)size;
    errno = EPROTO;
    return -1;
}

short apc_tls_events(const struct apc_tls *tls)
{
    (void)tls;
    return 0;
}

bool apc_tls_more(const struct apc_tls *tls)
{
    (void)tls;
    return false;
}

bool apc_tls_heard(const struct apc_tls *tls)
{
    (void)tls;
    return false;
}

const char *apc_tls_error(const struct apc_tls *tls)
{
    (void)tls;
    return "";
}

const char *apc_tls_peer(const struct apc_tls *tls)
{
    (void)tls;
    return "";
}

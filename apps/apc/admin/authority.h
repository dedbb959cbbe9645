/* SPDX-License-Identifier: BSD-3-Clause */
/*
 * A small authority in a folder, and the identities that it vouches for. authority.pem is its certificate,
 * authority.key its key; NAME.pem is an identity: a key, its certificate and the authority's, all that a
 * program needs for tls:. What holds a key is its owner's alone, and is there whole or not at all.
 */
#ifndef APC_AUTHORITY_H
#define APC_AUTHORITY_H

#include <time.h>

#include <apcbase.h>

#define AUTHORITY_NAME_LEN 65

enum authority_role { ROLE_AUTHORITY = 1, ROLE_PLANT, ROLE_CLIENT };

struct authority_request {
    const char *name; /* letters, digits, and within it . _ -: the certificate's, and the file's */
    enum authority_role role;
    const char *const *hosts; /* addresses and names under which a plant is found; a client has none */
    size_t n_hosts;
    time_t from, until; /* the certificate is good */
    bool replace;       /* an identity that is there; else it is refused */
};

/* Make the authority of a folder, which is made too. Returns 0, APC_EINVAL (a name), APC_EBUSY (one is
 * there), APC_ESYS. */
int authority_create(const char *folder, const struct authority_request *request, struct apc_error *why);
/* Make an identity. Returns 0, APC_EINVAL (a name, no or a wrong host), APC_EBUSY (it is there),
 * APC_ENOTFOUND (there is no authority), APC_ESYS. */
int authority_issue(const char *folder, const struct authority_request *request, struct apc_error *why);

/* What stands in the first certificate of a file. */
struct authority_certificate {
    char name[AUTHORITY_NAME_LEN];
    char hosts[256];
    enum authority_role role; /* 0: none of ours */
    time_t from, until;
};
/* Returns 0 or APC_ENOTFOUND (not to be read, or no certificate). */
int authority_read(const char *file, struct authority_certificate *out, struct apc_error *why);

#endif

/* SPDX-License-Identifier: BSD-3-Clause */
/* The identity of a daemon on a link tls:, and that it is said in time when its certificate expires. */
#ifndef APC_CREDENTIALS_H
#define APC_CREDENTIALS_H

#include "daemon.h"

struct credentials {
    struct daemon *d;
    struct apc_identity *identity; /* NULL: the link is none of tls: */
    apc_ns look_at;                /* mono: next */
    int warned;                    /* how near the end was when that was last said; 0: far */
    bool broken;                   /* said: the file cannot be taken up */
};

/* How near the end is: 0, more than 30 days; 1 to 3, less than 30, 7, 1 days; 4, expired. */
int credentials_stage(apc_ns left);

/* For a link to @p address: the identity in @p file, else in APC_IDENTITY. From then on the main thread looks
 * after it: it takes up a new file, and says when it expires. Returns 0, or an error already reported. */
int credentials_open(struct credentials *c, struct daemon *d, const char *address, const char *file);
/* The same for an identity that somebody else connects with; it is the caller's until credentials_close(). */
void credentials_watch(struct credentials *c, struct daemon *d, struct apc_identity *identity);
void credentials_close(struct credentials *c);

#endif

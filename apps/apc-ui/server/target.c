/* SPDX-License-Identifier: BSD-3-Clause */
/* The target of a request: a path, or an address with one (RFC 9112, 3.2). */
#include "http.h"

#include <stdio.h>
#include <string.h>
#include <strings.h>

/* Of "http://" or "https://" at its beginning; else 0. */
static size_t scheme_length(const char *target)
{
    static const char *const schemes[] = {"http://", "https://"};
    for (size_t i = 0; i < sizeof schemes / sizeof *schemes; i++)
        if (!strncasecmp(target, schemes[i], strlen(schemes[i])))
            return strlen(schemes[i]);
    return 0;
}

void target_authority(const char *target, char *host, size_t n)
{
    const size_t scheme = scheme_length(target), length = strcspn(target + scheme, "/?");
    const bool fits = length > 0 && length < n;
    if (!scheme)
        host[0] = '\0';
    else /* "/" is no host, and so none that is known */
        snprintf(host, n, "%.*s", fits ? (int)length : 1, fits ? target + scheme : "/");
}

const char *target_path(const char *target)
{
    const size_t scheme = scheme_length(target);
    const char *const path = target + scheme + (scheme ? strcspn(target + scheme, "/") : 0);
    return *path ? path : "/";
}

/* SPDX-License-Identifier: BSD-3-Clause */
/* For LD_PRELOAD: a file that cannot be opened for reading, the one that APC_TEST_UNREADABLE names at its
 * end. */
#include <dlfcn.h>
#include <errno.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

__attribute__((visibility("default"))) FILE *fopen(const char *path, const char *mode)
{
    FILE *(*const next)(const char *, const char *) =
        (FILE * (*)(const char *, const char *)) dlsym(RTLD_NEXT, "fopen");
    const char *const end = getenv("APC_TEST_UNREADABLE");
    const size_t n = strlen(path), of = end ? strlen(end) : 0;

    if (end && *mode == 'r' && n >= of && strcmp(path + n - of, end) == 0) {
        errno = EIO;
        return NULL;
    }
    return next(path, mode);
}

/* SPDX-License-Identifier: BSD-3-Clause */
/* For LD_PRELOAD: a file that cannot be opened for reading, the one that APC_TEST_UNREADABLE names at its
 * end. Or by one of several processes alone, not the first of them: that which makes the file APC_TEST_UNREADABLE_BY. */
#include <dlfcn.h>
#include <errno.h>
#include <fcntl.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

static pid_t first;

__attribute__((constructor)) static void remember(void)
{
    first = getpid();
}

static int ends_unreadable(const char *path)
{
    const char *const end = getenv("APC_TEST_UNREADABLE");
    const size_t n = strlen(path), of = end ? strlen(end) : 0;
    return end && n >= of && strcmp(path + n - of, end) == 0;
}

__attribute__((visibility("default"))) FILE *fopen(const char *path, const char *mode)
{
    FILE *(*const next)(const char *, const char *) =
        (FILE * (*)(const char *, const char *)) dlsym(RTLD_NEXT, "fopen");
    if (*mode == 'r' && ends_unreadable(path)) {
        errno = EIO;
        return NULL;
    }
    return next(path, mode);
}

__attribute__((visibility("default"))) int open64(const char *path, int flags, ...)
{
    int (*const next)(const char *, int, ...) = (int (*)(const char *, int, ...))dlsym(RTLD_NEXT, "open64");
    const char *const by = getenv("APC_TEST_UNREADABLE_BY");
    static pid_t by_this;
    mode_t mode = 0;
    va_list args;
    va_start(args, flags);
    if (flags & O_CREAT)
        mode = va_arg(args, mode_t);
    va_end(args);
    if (!by || getpid() == first || !ends_unreadable(path))
        return next(path, flags, mode);
    const int made = next(by, O_CREAT | O_EXCL | O_WRONLY | O_CLOEXEC, 0600);
    if (made >= 0) {
        close(made);
        by_this = getpid();
    }
    if (by_this == getpid()) {
        errno = EIO;
        return -1;
    }
    return next(path, flags, mode);
}

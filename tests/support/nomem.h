/* SPDX-License-Identifier: BSD-3-Clause */
/* A program in which one allocation fails, once, and which counts those that are alive. To be included by one
 * file of a program: it replaces malloc and its like. Sanitizers bring their own, and nothing fails then.
 */
#ifndef APC_TEST_NOMEM_H
#define APC_TEST_NOMEM_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>

#if defined(__SANITIZE_ADDRESS__) || defined(__SANITIZE_THREAD__)
#define NOMEM 0
#elif defined(__has_feature)
#if __has_feature(address_sanitizer) || __has_feature(thread_sanitizer) || __has_feature(memory_sanitizer)
#define NOMEM 0
#endif
#endif
#ifndef NOMEM
#define NOMEM 1
#endif

static bool counting; /* only while it is set one may fail */
static bool foreign;  /* what other objects ask for, instead of what this program does, libapc in it */
static int until_failure;
static bool failed;
static long alive;

#if NOMEM
extern const char __executable_start, _end; /* where this program lies */

static bool fails(const void *caller)
{
    const char *from = (const char *)caller;
    const bool own = from >= &__executable_start && from < &_end;
    if (!counting || own == foreign || until_failure == 0 || --until_failure > 0) {
        return false;
    }
    failed = true;
    return true;
}

#define SEEN __attribute__((visibility("default"))) /* by other objects */

/* glibc's own, for programs that replace malloc. */
extern void *__libc_malloc(size_t size);
extern void *__libc_calloc(size_t n, size_t size);
extern void *__libc_realloc(void *p, size_t size);
extern void __libc_free(void *p);

SEEN void *malloc(size_t size)
{
    void *p = fails(__builtin_return_address(0)) ? NULL : __libc_malloc(size);
    alive += p != NULL;
    return p;
}

SEEN void *calloc(size_t n, size_t size)
{
    void *p = fails(__builtin_return_address(0)) ? NULL : __libc_calloc(n, size);
    alive += p != NULL;
    return p;
}

SEEN void *realloc(void *p, size_t size)
{
    void *grown = fails(__builtin_return_address(0)) ? NULL : __libc_realloc(p, size);
    alive += !p && grown;
    return grown;
}

SEEN void *reallocarray(void *p, size_t n, size_t size)
{
    void *grown = size > 0 && n > SIZE_MAX / size      ? NULL
                  : fails(__builtin_return_address(0)) ? NULL
                                                       : __libc_realloc(p, n * size);
    alive += !p && grown;
    return grown;
}

SEEN char *strdup(const char *text)
{
    const size_t size = strlen(text) + 1;
    char *copy = fails(__builtin_return_address(0)) ? NULL : (char *)__libc_malloc(size);
    alive += copy != NULL;
    return copy ? memcpy(copy, text, size) : NULL;
}

SEEN void free(void *p)
{
    alive -= p != NULL;
    __libc_free(p);
}
#endif

#endif

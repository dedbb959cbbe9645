/* SPDX-License-Identifier: BSD-3-Clause */
/* A program in which one allocation fails, once, and which counts those that are alive. To be included by one
 * file of a program: it replaces malloc and its like. Sanitizers bring their own, and nothing fails then.
 */
#ifndef APC_TEST_NOMEM_H
#define APC_TEST_NOMEM_H

#include <apcbase.h>

#include "check.h"

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

/* What asks for memory, and gives 0 or APC_ENOMEM. */
struct nomem_step {
    const char *name;
    int (*run)(void);
    bool silent; /* it has no text to give */
};

/*
 * Each of its allocations fails once, of those after the first @p all every @p apart-th: @p why says so, and
 * nothing is left behind.
 */
static inline void nomem_each(const struct nomem_step *step, int all, int apart, struct apc_error *why)
{
    int n = 0;
    if (!NOMEM)
        skip();
    foreign = false;
    until_failure = 0;
    if (step->run() < 0) /* what is kept for good is there then */
        fail_msg("%s: %s", step->name, why->text);
    const long before = alive;
    do {
        n += n < all ? 1 : apart;
        until_failure = n;
        failed = false;
        why->text[0] = '\0';
        counting = true;
        const int rc = step->run();
        counting = false;
        if (rc != (failed ? APC_ENOMEM : 0))
            fail_msg("%s: allocation %d: %s: %s", step->name, n, apc_err_name(rc), why->text);
        if (failed && !step->silent && !strstr(why->text, "memory"))
            fail_msg("%s: allocation %d: \"%s\"", step->name, n, why->text);
        if (alive != before)
            fail_msg("%s: allocation %d: %ld are left", step->name, n, alive - before);
    } while (failed);
    assert_true(n > 1);
}

#endif

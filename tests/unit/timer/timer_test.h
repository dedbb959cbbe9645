/* SPDX-License-Identifier: BSD-3-Clause */
/* What the tests of the timer room share. */
#ifndef APC_TIMER_TEST_H
#define APC_TIMER_TEST_H

#include <errno.h>
#include <poll.h>
#include <semaphore.h>
#include <stdio.h>
#include <stdlib.h>
#include <sys/timerfd.h>
#include <time.h>
#include <unistd.h>

#include "apcbase.h"
#include "check.h"
#include "xorshift.h"

/*
 * The thread sanitizer knows the threads that pthread_create() makes, and dies in those that glibc makes by
 * itself for SIGEV_THREAD. The posix executive is shown to it in test_timer_notify.c.
 */
#if defined(__has_feature)
#if __has_feature(thread_sanitizer)
#define REAL_TIMERS 0
#endif
#endif
#if defined(__SANITIZE_THREAD__)
#define REAL_TIMERS 0
#elif !defined(REAL_TIMERS)
#define REAL_TIMERS 1
#endif

/* The sanitizers' shadow memory is too large to be locked: their mlockall() does nothing. */
#if defined(__SANITIZE_ADDRESS__) || defined(__SANITIZE_THREAD__)
#define REAL_MEMORY 0
#elif defined(__has_feature)
#if __has_feature(address_sanitizer) || __has_feature(thread_sanitizer)
#define REAL_MEMORY 0
#endif
#endif
#if !defined(REAL_MEMORY)
#define REAL_MEMORY 1
#endif

static inline void skipped(void **state)
{
    (void)state;
    skip();
}

__attribute__((unused)) static char deadline_name[] = "deadline", posix_name[] = "posix";

/* Rows of a table of tests: the name of the executive is their initial state. */
#define ROW(name, test, executive)                                                                           \
    {                                                                                                        \
        name " (" #executive ")", test, NULL, NULL, executive##_name                                         \
    }
#define POSIX(test) ROW(#test, REAL_TIMERS ? (test) : skipped, posix)
#define EACH(test)  ROW(#test, test, deadline), POSIX(test)

#define PATIENCE (30 * APC_NS_PER_S) /* for what must happen: only a failed test waits so long */

static inline struct timespec to_timespec(apc_ns t)
{
    return (struct timespec){.tv_sec = t / APC_NS_PER_S, .tv_nsec = t % APC_NS_PER_S};
}

static inline uint64_t seed(void)
{
    const char *given = getenv("APC_TEST_SEED");
    uint64_t s = given ? strtoull(given, NULL, 10) : (uint64_t)apc_clock_mono(NULL) | 1;
    printf("APC_TEST_SEED=%llu\n", (unsigned long long)s);
    return s;
}

/* True when the semaphore was posted, false when that did not happen. */
static inline bool posted(sem_t *sem)
{
    /* not sem_clockwait(): the thread sanitizer does not know it */
    const struct timespec limit = to_timespec(apc_clock_utc(NULL) + PATIENCE);
    int rc;
    do
        rc = sem_timedwait(sem, &limit);
    while (rc < 0 && errno == EINTR);
    return rc == 0;
}

/* Wait for the condition that the monotonic clock shows @until. */
static inline bool passed(apc_ns until)
{
    const struct itimerspec setting = {.it_value = to_timespec(until)};
    struct pollfd p = {.fd = timerfd_create(CLOCK_MONOTONIC, TFD_CLOEXEC), .events = POLLIN};
    bool ok = p.fd >= 0 && timerfd_settime(p.fd, TFD_TIMER_ABSTIME, &setting, NULL) == 0 &&
              poll(&p, 1, (int)(PATIENCE / APC_NS_PER_MS)) == 1;
    if (p.fd >= 0)
        close(p.fd);
    return ok && apc_clock_mono(NULL) >= until;
}

#endif

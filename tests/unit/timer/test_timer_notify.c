/* SPDX-License-Identifier: BSD-3-Clause */
/*
 * The posix executive against notifications that come late, twice, too early, all at once or after the task
 * is gone. This program has a timer_create() of its own, which keeps what it is given: the tests notify.
 */
#include "apctimer.h"
#include "check.h"
#include "timer_test.h"

#include <pthread.h>
#include <stdatomic.h>
#include <string.h>

#define MS      APC_NS_PER_MS
#define THREADS 4

/* What the kernel and glibc know of the timer made last. */
static struct {
    void (*notify)(union sigval);
    union sigval value;
    struct itimerspec setting;
    int flags;
    atomic_int timers; /* made and not deleted */
} fake;

int timer_create(clockid_t clock, struct sigevent *event, timer_t *timer)
{
    assert_int_equal(clock, CLOCK_MONOTONIC);
    assert_int_equal(event->sigev_notify, SIGEV_THREAD);
    fake.notify = event->sigev_notify_function;
    fake.value = event->sigev_value;
    atomic_fetch_add(&fake.timers, 1);
    *timer = &fake;
    return 0;
}

int timer_settime(timer_t timer, int flags, const struct itimerspec *setting, struct itimerspec *old)
{
    (void)timer;
    (void)old;
    fake.setting = *setting;
    fake.flags = flags;
    return 0;
}

int timer_delete(timer_t timer)
{
    (void)timer;
    atomic_fetch_sub(&fake.timers, 1);
    return 0;
}

static bool disarmed(void)
{
    return fake.setting.it_value.tv_sec == 0 && fake.setting.it_value.tv_nsec == 0;
}

/* notify() changes the signal mask of its thread, so it has a thread of its own, as with glibc. */
static void *notify(void *value)
{
    fake.notify((union sigval){.sival_ptr = value});
    return NULL;
}

static pthread_t begin_notifying(void *value)
{
    pthread_t thread;
    assert_int_equal(pthread_create(&thread, NULL, notify, value), 0);
    return thread;
}

static void notify_once(void *value)
{
    assert_int_equal(pthread_join(begin_notifying(value), NULL), 0);
}

/* ---- The task ---- */

struct seen {
    uint64_t index, missed; /* of the last tick; of all */
    sem_t entered, release;
    unsigned calls;
    int result;
    atomic_int inside, overlaps;
    atomic_uint late;
    atomic_bool stopped;
    bool hold;
};

static int on_tick(void *ctx, const struct apc_tick *tick)
{
    struct seen *s = ctx;
    if (atomic_load(&s->stopped))
        atomic_fetch_add(&s->late, 1);
    if (atomic_fetch_add(&s->inside, 1) > 0)
        atomic_fetch_add(&s->overlaps, 1);
    s->calls++;
    s->index = tick->index;
    s->missed += tick->missed;
    if (s->hold) {
        sem_post(&s->entered);
        posted(&s->release);
    }
    atomic_fetch_sub(&s->inside, 1);
    return s->result;
}

static struct apc_executive *executive;

static int make_executive(void **state)
{
    (void)state;
    return apc_executive_create(&executive, "posix", NULL, NULL);
}

static int destroy_executive(void **state)
{
    (void)state;
    return apc_executive_destroy(executive) || atomic_load(&fake.timers) != 0;
}

static struct apc_task *started(struct seen *s, struct apc_task_options options)
{
    struct apc_task *task;
    sem_init(&s->entered, 0, 0);
    sem_init(&s->release, 0, 0);
    options.size = sizeof options;
    options.priority = -1;
    assert_int_equal(apc_task_create(executive, &options, on_tick, s, &task, NULL), 0);
    assert_int_equal(apc_task_start(task, NULL), 0);
    return task;
}

static apc_ns epoch(void)
{
    return fake.setting.it_value.tv_sec * APC_NS_PER_S + fake.setting.it_value.tv_nsec;
}

static void the_timer_is_absolute_and_periodic(void **state)
{
    struct seen s = {.calls = 0};
    apc_ns start = apc_clock_mono(NULL) + 100 * APC_NS_PER_S;
    struct apc_task *task = started(&s, (struct apc_task_options){.period = 2500 * MS, .start = start});
    (void)state;
    assert_int_equal(fake.flags, TIMER_ABSTIME);
    assert_true(epoch() == start);
    assert_int_equal(fake.setting.it_interval.tv_sec, 2);
    assert_int_equal(fake.setting.it_interval.tv_nsec, 500 * MS);
    notify_once(fake.value.sival_ptr); /* too early: a stray one */
    assert_int_equal(s.calls, 0);
    apc_task_destroy(task);
}

static void a_doubled_notification_is_one_call(void **state)
{
    struct seen s = {.calls = 0};
    struct apc_task *task = started(&s, (struct apc_task_options){.period = 3600 * APC_NS_PER_S});
    (void)state;
    notify_once(fake.value.sival_ptr);
    notify_once(fake.value.sival_ptr);
    assert_int_equal(s.calls, 1);
    assert_int_equal(s.index, 0);
    apc_task_destroy(task);
}

static void notifications_that_never_came_are_missed_ticks(void **state)
{
    struct seen s = {.calls = 0};
    struct apc_task *task = started(&s, (struct apc_task_options){.period = 2 * MS});
    (void)state;
    assert_true(passed(epoch() + 20 * MS));
    notify_once(fake.value.sival_ptr);
    assert_true(s.calls >= 1); /* the next one is due before it is back, on a busy machine */
    assert_true(s.missed >= 10);
    assert_true(s.index + 1 == s.calls + s.missed);
    uint64_t missed = apc_task_missed(task);
    assert_true(missed >= s.missed);
    assert_true(passed(epoch() + (apc_ns)(s.index + 10) * 2 * MS));
    assert_int_equal(apc_task_stop(task), 0);
    assert_true(apc_task_missed(task) >= s.missed + 9);
    apc_task_destroy(task);
}

static void a_notification_during_the_callback_returns_and_its_tick_is_not_lost(void **state)
{
    struct seen s = {.hold = true};
    struct apc_task *task =
        started(&s, (struct apc_task_options){.period = 20 * MS, .overrun = APC_OVERRUN_BURST});
    (void)state;
    pthread_t first = begin_notifying(fake.value.sival_ptr);
    assert_true(posted(&s.entered));
    assert_true(passed(epoch() + 20 * MS));
    notify_once(fake.value.sival_ptr); /* joined although the callback is still held */
    sem_post(&s.release);
    assert_true(posted(&s.entered)); /* the first thread runs tick 1, with no further notification */
    s.hold = false;
    assert_int_equal(s.index, 1);
    sem_post(&s.release);
    assert_int_equal(pthread_join(first, NULL), 0);
    assert_int_equal(atomic_load(&s.overlaps), 0);
    apc_task_destroy(task);
}

/* What the task has ended with. */
static int result_of(struct apc_task *task, apc_ns timeout)
{
    int result = 0;
    assert_int_equal(apc_task_wait(task, timeout, &result), 0);
    return result;
}

static void a_task_that_ended_disarms_its_timer_and_is_not_called_again(void **state)
{
    struct seen s = {.result = 7};
    struct apc_task *task = started(&s, (struct apc_task_options){.period = 20 * APC_NS_PER_US});
    (void)state;
    notify_once(fake.value.sival_ptr);
    assert_true(disarmed());
    assert_int_equal(result_of(task, PATIENCE), 7);
    assert_true(passed(apc_clock_mono(NULL) + MS));
    notify_once(fake.value.sival_ptr);
    assert_int_equal(s.calls, 1);
    uint64_t missed = apc_task_missed(task);
    assert_int_equal(apc_task_stop(task), 0);
    assert_int_equal(apc_task_missed(task), missed); /* after its end nothing is missed */
    apc_task_destroy(task);
}

static void a_notification_after_destroy_touches_nothing(void **state)
{
    struct seen *s = calloc(1, sizeof *s), next = {.calls = 0};
    (void)state;
    assert_non_null(s);
    struct apc_task *task = started(s, (struct apc_task_options){.period = 20 * APC_NS_PER_US});
    void *old = fake.value.sival_ptr;
    apc_task_destroy(task);
    free(s);
    notify_once(old);

    /* The place is used again. A notification for the former task finds the new one not due, or, when it
     * is due, starts a tick that is in order. */
    task = started(&next, (struct apc_task_options){.period = 3600 * APC_NS_PER_S,
                                                    .start = apc_clock_mono(NULL) + 3600 * APC_NS_PER_S});
    notify_once(old);
    assert_int_equal(next.calls, 0);
    apc_task_destroy(task);

    assert_int_equal(apc_executive_destroy(executive), 0);
    notify_once(old);
    assert_int_equal(apc_executive_create(&executive, "posix", NULL, NULL), 0);
}

struct storm {
    void *value;
    atomic_bool over;
};

static void *rain(void *arg)
{
    struct storm *storm = arg;
    while (!atomic_load(&storm->over))
        fake.notify((union sigval){.sival_ptr = storm->value});
    return NULL;
}

static void a_storm_of_notifications_neither_overlaps_nor_outlives_stop(void **state)
{
    struct seen s[100] = {{.calls = 0}};
    (void)state;
    for (size_t i = 0; i < sizeof s / sizeof *s; i++) {
        struct apc_task *task = started(&s[i], (struct apc_task_options){.period = 20 * APC_NS_PER_US});
        struct storm storm = {.value = fake.value.sival_ptr};
        pthread_t thread[THREADS];
        for (int t = 0; t < THREADS; t++)
            assert_int_equal(pthread_create(&thread[t], NULL, rain, &storm), 0);
        assert_true(passed(epoch() + (apc_ns)(i % 5) * 100 * APC_NS_PER_US));
        assert_int_equal(apc_task_stop(task), 0);
        atomic_store(&s[i].stopped, true);
        apc_task_destroy(task); /* while the notifications go on */
        atomic_store(&storm.over, true);
        for (int t = 0; t < THREADS; t++)
            assert_int_equal(pthread_join(thread[t], NULL), 0);
        assert_int_equal(atomic_load(&s[i].overlaps), 0);
        assert_int_equal(atomic_load(&s[i].late), 0);
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(the_timer_is_absolute_and_periodic),
        cmocka_unit_test(a_doubled_notification_is_one_call),
        cmocka_unit_test(notifications_that_never_came_are_missed_ticks),
        cmocka_unit_test(a_notification_during_the_callback_returns_and_its_tick_is_not_lost),
        cmocka_unit_test(a_task_that_ended_disarms_its_timer_and_is_not_called_again),
        cmocka_unit_test(a_notification_after_destroy_touches_nothing),
        cmocka_unit_test(a_storm_of_notifications_neither_overlaps_nor_outlives_stop),
    };
    return cmocka_run_group_tests(tests, make_executive, destroy_executive);
}

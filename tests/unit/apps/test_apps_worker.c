/* SPDX-License-Identifier: BSD-3-Clause */
/* A thread beside a task: it works when it is woken, a last time at the end, and who ends it waits no longer
 * than he said. */
#include "check.h"
#include "daemon/worker.h"

#include <semaphore.h>

#define LONG (3600 * APC_NS_PER_S)

struct record {
    struct worker worker;
    sem_t stepped, go; /* each step posts the one and, if `held`, waits for the other */
    apc_ns pause;
    bool held, last;
    int steps; /* under the worker's mutex */
};

static apc_ns step(void *ctx, bool last)
{
    struct record *r = ctx;
    pthread_mutex_lock(&r->worker.mutex);
    r->steps++;
    r->last = last;
    pthread_mutex_unlock(&r->worker.mutex);
    sem_post(&r->stepped);
    if (r->held)
        sem_wait(&r->go);
    return r->pause;
}

static void begin(struct record *r)
{
    sem_init(&r->stepped, 0, 0);
    sem_init(&r->go, 0, 0);
    assert_int_equal(worker_init(&r->worker, step, r, NULL), 0);
    assert_int_equal(worker_start(&r->worker, NULL), 0);
    sem_wait(&r->stepped); /* it begins by itself */
}

static void it_works_when_it_is_woken_and_once_more_at_the_end(void **state)
{
    struct record r = {.pause = WORKER_IDLE};
    (void)state;

    begin(&r);
    worker_wake(&r.worker);
    sem_wait(&r.stepped);
    assert_false(r.last);
    assert_true(worker_join(&r.worker, apc_clock_mono(NULL) + LONG));
    assert_true(r.last);
    assert_int_equal(r.steps, 3);
    assert_true(worker_join(&r.worker, 0)); /* there is nothing to wait for */
}

static void it_works_by_itself_as_often_as_it_says(void **state)
{
    struct record r = {.pause = 1};
    (void)state;

    begin(&r);
    sem_wait(&r.stepped);
    sem_wait(&r.stepped);
    assert_true(worker_join(&r.worker, apc_clock_mono(NULL) + LONG));
}

static void what_wakes_it_while_it_works_is_not_lost(void **state)
{
    struct record r = {.pause = WORKER_IDLE, .held = true};
    (void)state;

    begin(&r);
    worker_wake(&r.worker);
    sem_post(&r.go);
    sem_wait(&r.stepped);
    sem_post(&r.go);
    sem_post(&r.go);
    assert_true(worker_join(&r.worker, apc_clock_mono(NULL) + LONG));
    assert_int_equal(r.steps, 3);
}

static void how_long_it_has_been_at_it_is_known_and_it_is_left_alone(void **state)
{
    struct record r = {.pause = WORKER_IDLE, .held = true};
    (void)state;

    begin(&r);
    while (worker_busy(&r.worker) == 0)
        ;
    assert_false(worker_join(&r.worker, apc_clock_mono(NULL)));
    sem_post(&r.go);
    sem_post(&r.go);
    assert_true(worker_join(&r.worker, apc_clock_mono(NULL) + LONG));
    assert_int_equal(worker_busy(&r.worker), 0);
}

static void several_end_by_the_same_time_when_each_is_asked_first(void **state)
{
    struct record r[2] = {{.pause = LONG}, {.pause = LONG}};
    (void)state;

    begin(&r[0]);
    begin(&r[1]);
    worker_stop(&r[0].worker);
    worker_stop(&r[1].worker);
    sem_wait(&r[0].stepped); /* the last ones, though nobody waits yet */
    sem_wait(&r[1].stepped);
    assert_true(worker_join(&r[0].worker, apc_clock_mono(NULL) + LONG));
    assert_true(worker_join(&r[1].worker, apc_clock_mono(NULL) + LONG));
}

static void one_that_never_began_has_ended(void **state)
{
    struct record r = {.pause = WORKER_IDLE};
    (void)state;

    assert_int_equal(worker_init(&r.worker, step, &r, NULL), 0);
    worker_stop(&r.worker);
    assert_true(worker_join(&r.worker, 0));
    assert_int_equal(r.steps, 0);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(it_works_when_it_is_woken_and_once_more_at_the_end),
        cmocka_unit_test(it_works_by_itself_as_often_as_it_says),
        cmocka_unit_test(what_wakes_it_while_it_works_is_not_lost),
        cmocka_unit_test(how_long_it_has_been_at_it_is_known_and_it_is_left_alone),
        cmocka_unit_test(several_end_by_the_same_time_when_each_is_asked_first),
        cmocka_unit_test(one_that_never_began_has_ended),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}

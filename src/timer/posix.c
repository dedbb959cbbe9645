/* SPDX-License-Identifier: BSD-3-Clause */
/*
 * The executive "posix": the paper's SIGEV_THREAD interval timers, made safe.
 *
 * How glibc does it: the kernel signals a helper thread at each expiry, the helper creates a detached
 * thread, and that calls on_posix_timer() with the value given to timer_create(). Three things follow.
 *
 * 1. A notification may come at any time. timer_delete() stops the helper from creating more threads, but
 *    one that exists already, and has not been given a CPU yet, calls on_posix_timer() when it gets one; nobody can
 *    tell how many there are, or wait for them. So the value must never point at anything that is freed.
 *    It points at a slot, and slots lie on pages that the executive maps and never unmaps: 4 KiB for 39
 *    tasks at a time (x86-64), kept until the process ends. A slot is used again by later tasks.
 * 2. A notification therefore carries no meaning but "look whether something is due", and is harmless when
 *    it is late, doubled, or meant for an earlier task of the slot: what runs, if anything, is the tick of
 *    the grid whose instant has come, once.
 * 3. Notifications overlap, or do not come at all when the helper cannot create a thread, which it does
 *    not tell. So the grid, not the number of notifications, says what was missed (grid.c).
 *
 * slot->lock hands the task from thread to thread. `busy` marks the one thread inside the callback; any
 * other returns at once. Its tick is not lost: the busy thread looks again, under the lock, before it
 * goes. posix_halt() takes the task out of the slot and waits until the slot is not busy: from then on no
 * notification can find the task. Only after that is the timer deleted, for a busy thread may still
 * disarm it, and its record is glibc's memory.
 */
#include "timer/timer_internal.h"

#include <errno.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>

#define PAGE 4096

struct slot {
    pthread_mutex_t lock;
    pthread_cond_t idle;
    struct apc_task *task; /* NULL: nothing to do */
    bool busy;
    bool taken; /* by a task that has not been released; under posix->lock */
};

#define SLOTS ((PAGE - sizeof(void *)) / sizeof(struct slot))

struct page {
    struct page *next;
    struct slot slots[SLOTS];
};
_Static_assert(sizeof(struct page) <= PAGE, "slots fill one page");

struct posix {
    pthread_mutex_t lock; /* of the list and of slot->taken: only setup */
    struct page *pages;
};

struct posix_task {
    struct slot *slot;
    timer_t timer;
};

/* ---- Slots ---- */

static int add_slot_page(struct posix *posix)
{
    struct page *page = mmap(NULL, PAGE, PROT_READ | PROT_WRITE, MAP_PRIVATE | MAP_ANONYMOUS, -1, 0);
    if (page == MAP_FAILED)
        return APC_ENOMEM;
    for (size_t i = 0; i < SLOTS; i++) {
        pthread_mutex_init(&page->slots[i].lock, NULL);
        pthread_cond_init(&page->slots[i].idle, NULL);
    }
    page->next = posix->pages;
    posix->pages = page;
    return 0;
}

static struct slot *free_slot(const struct posix *posix)
{
    for (struct page *page = posix->pages; page; page = page->next)
        for (size_t i = 0; i < SLOTS; i++)
            if (!page->slots[i].taken)
                return &page->slots[i];
    return NULL;
}

static struct slot *take_slot(struct posix *posix)
{
    pthread_mutex_lock(&posix->lock);
    struct slot *slot = free_slot(posix);
    if (!slot && add_slot_page(posix) == 0)
        slot = free_slot(posix);
    if (slot)
        slot->taken = true;
    pthread_mutex_unlock(&posix->lock);
    return slot;
}

static void release_slot(struct posix *posix, struct slot *slot)
{
    pthread_mutex_lock(&posix->lock);
    slot->taken = false;
    pthread_mutex_unlock(&posix->lock);
}

/* ---- Notifications ---- */

static void disarm(const struct apc_task *task)
{
    const struct posix_task *own = task->own;
    const struct itimerspec never = {.it_value = {0}};
    timer_settime(own->timer, 0, &never, NULL); /* cannot fail: the timer exists until posix_halt() returns */
}

/* glibc gives its threads the scheduling and the stack of the attributes, but not the CPUs. */
static void move_to_cpu(const struct apc_task *task)
{
    cpu_set_t cpus;
    if (task->options.cpu == 0)
        return;
    apc_task_cpus(task, &cpus);
    pthread_setaffinity_np(pthread_self(), sizeof cpus, &cpus); /* if it fails: the CPU was taken offline */
}

/* The slot is locked, and unlocked during the callback. */
static void run_due(struct slot *slot)
{
    while (slot->task && apc_task_is_due(slot->task)) {
        struct apc_task *task = slot->task;
        slot->busy = true;
        pthread_mutex_unlock(&slot->lock);
        move_to_cpu(task);
        bool more = apc_task_tick(task);
        if (!more)
            disarm(task);
        pthread_mutex_lock(&slot->lock);
        slot->busy = false;
        if (!more)
            slot->task = NULL;
    }
    pthread_cond_broadcast(&slot->idle);
}

static void on_posix_timer(union sigval value)
{
    struct slot *slot = value.sival_ptr;
    sigset_t blocked;

    apc_task_signals(&blocked);
    pthread_sigmask(SIG_BLOCK, &blocked, NULL); /* glibc unblocks all, whatever the attributes say */
    pthread_mutex_lock(&slot->lock);
    if (!slot->busy)
        run_due(slot);
    pthread_mutex_unlock(&slot->lock);
}

/* ---- The executive ---- */

static int open_posix(struct apc_executive *executive)
{
    struct posix *posix = calloc(1, sizeof *posix);
    if (!posix)
        return APC_ENOMEM;
    pthread_mutex_init(&posix->lock, NULL);
    executive->own = posix;
    return 0;
}

/* Its pages stay: see above. */
static void close_posix(struct apc_executive *executive)
{
    struct posix *posix = executive->own;
    pthread_mutex_destroy(&posix->lock);
    free(posix);
}

static int posix_prepare(struct apc_task *task)
{
    struct posix_task *own = calloc(1, sizeof *own);
    if (own)
        own->slot = take_slot(task->executive->own);
    if (!own || !own->slot) {
        free(own);
        return APC_ENOMEM;
    }
    task->own = own;
    return 0;
}

static void posix_release(struct apc_task *task)
{
    struct posix_task *own = task->own;
    release_slot(task->executive->own, own->slot);
    free(own);
}

static int make_timer(struct apc_task *task, struct apc_error *why)
{
    struct posix_task *own = task->own;
    pthread_attr_t attr;
    struct sigevent event;

    int err = apc_task_thread_attr(task, &attr, why);
    if (err < 0)
        return err;
    memset(&event, 0, sizeof event);
    event.sigev_notify = SIGEV_THREAD;
    event.sigev_notify_function = on_posix_timer;
    event.sigev_notify_attributes = &attr; /* copied by glibc */
    event.sigev_value.sival_ptr = own->slot;
    if (timer_create(CLOCK_MONOTONIC, &event, &own->timer) < 0)
        err = apc_fail(why, APC_ESYS, "task '%s': no POSIX timer: %s%s", task->name, strerror(errno),
                       errno == EAGAIN ? " (each holds one pending signal: see ulimit -i)" : "");
    pthread_attr_destroy(&attr);
    return err;
}

static int posix_start(struct apc_task *task, struct apc_error *why)
{
    struct posix_task *own = task->own;
    const apc_ns period = task->options.period;

    int err = make_timer(task, why);
    if (err < 0)
        return err;
    apc_task_begin(task);
    const apc_ns first = apc_task_due(task);
    const struct itimerspec setting = {
        .it_value = {.tv_sec = first / APC_NS_PER_S, .tv_nsec = first % APC_NS_PER_S},
        .it_interval = {.tv_sec = period / APC_NS_PER_S, .tv_nsec = period % APC_NS_PER_S}};
    pthread_mutex_lock(&own->slot->lock); /* the first notification waits until the task is there */
    if (timer_settime(own->timer, TIMER_ABSTIME, &setting, NULL) < 0)
        err = apc_fail(why, APC_ESYS, "task '%s': POSIX timer not armed: %s", task->name, strerror(errno));
    else
        own->slot->task = task;
    pthread_mutex_unlock(&own->slot->lock);
    if (err < 0)
        timer_delete(own->timer);
    return err;
}

static void posix_halt(struct apc_task *task)
{
    struct posix_task *own = task->own;

    pthread_mutex_lock(&own->slot->lock);
    own->slot->task = NULL;
    while (own->slot->busy)
        pthread_cond_wait(&own->slot->idle, &own->slot->lock);
    pthread_mutex_unlock(&own->slot->lock);
    timer_delete(own->timer);
}

const struct apc_executive_ops apc_executive_posix = {.name = "posix",
                                                      .open = open_posix,
                                                      .close = close_posix,
                                                      .prepare = posix_prepare,
                                                      .start = posix_start,
                                                      .halt = posix_halt,
                                                      .release = posix_release};

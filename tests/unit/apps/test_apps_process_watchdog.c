/* SPDX-License-Identifier: BSD-3-Clause */
/* What a daemon's watchdog hears, over a socket as systemd's: that the task ticks, as long as it does. */
#include <dlfcn.h>
#include <errno.h>
#include <poll.h>
#include <pthread.h>
#include <setjmp.h>
#include <signal.h>
#include <stdarg.h>
#include <stdatomic.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/socket.h>
#include <sys/un.h>
#include <sys/wait.h>
#include <unistd.h>

#include <cmocka.h>

#include "daemon/process_watchdog.h"

/* Sanitizers bring their own. */
#if defined(__SANITIZE_ADDRESS__) || defined(__SANITIZE_THREAD__)
#define REFUSING 0
#elif defined(__has_feature)
#if __has_feature(address_sanitizer) || __has_feature(thread_sanitizer) || __has_feature(memory_sanitizer)
#define REFUSING 0
#endif
#endif
#ifndef REFUSING
#define REFUSING 1
#endif

#define PATIENCE 20000 /* ms */

static bool refused; /* no thread can be made */

#if REFUSING
int pthread_create(pthread_t *thread, const pthread_attr_t *attr, void *(*run)(void *), void *arg)
{
    int (*real)(pthread_t *, const pthread_attr_t *, void *(*)(void *), void *);
    void *symbol = dlsym(RTLD_NEXT, "pthread_create");
    memcpy(&real, &symbol, sizeof real);
    return refused ? EAGAIN : real(thread, attr, run, arg);
}
#endif

static char dir[] = "/tmp/apc-warden.XXXXXX";

/* The supervisor's end. */
static int supervise(void)
{
    struct sockaddr_un at = {.sun_family = AF_UNIX};
    int fd = socket(AF_UNIX, SOCK_DGRAM | SOCK_CLOEXEC, 0);
    assert_true(fd >= 0);
    snprintf(at.sun_path, sizeof at.sun_path, "%s/notify", dir);
    assert_int_equal(bind(fd, (struct sockaddr *)&at, sizeof at), 0);
    assert_int_equal(setenv("NOTIFY_SOCKET", at.sun_path, 1), 0);
    return fd;
}

static void unsupervise(int fd)
{
    char path[64];
    snprintf(path, sizeof path, "%s/notify", dir);
    close(fd);
    unlink(path);
    unsetenv("NOTIFY_SOCKET");
}

/* The next word; "" when there is none for @p ms. */
static const char *word(int fd, int ms)
{
    static char text[100];
    struct pollfd in = {.fd = fd, .events = POLLIN};
    ssize_t n = poll(&in, 1, ms) == 1 ? recv(fd, text, sizeof text - 1, 0) : 0;
    text[n > 0 ? n : 0] = '\0';
    return text;
}

/* The watchdog is fed until with a tick beyond @p tick: its index. */
static unsigned long long fed(int fd, unsigned long long tick)
{
    unsigned long long index = 0;
    for (int i = 0; i < 1000 && index <= tick; i++) {
        const char *text = word(fd, PATIENCE);
        assert_int_equal(strncmp(text, "WATCHDOG=1", 10), 0);
        (void)sscanf(text, "WATCHDOG=1\nAPC_LAST_TICK=%llu",
                     &index); /* none before the first tick returned */
    }
    assert_true(index > tick);
    return index;
}

struct ticker {
    struct process_watchdog *process_watchdog;
    atomic_bool hangs;
};

static int tick(void *ctx, const struct apc_tick *t)
{
    struct ticker *k = ctx;
    while (atomic_load(&k->hangs))
        poll(NULL, 0, 1);
    process_watchdog_ticked(k->process_watchdog, t->index);
    return 0;
}

/*
 * Promise(run/ready-once-watchdog): READY once, and WATCHDOG as long as its task ticks, in the form of
 *   systemd.
 */
static void the_watchdog_hears_of_it_as_long_as_the_task_ticks(void **state)
{
    (void)state;
    int fd = supervise();
    struct ticker k = {0};
    struct apc_executive *executive;
    struct apc_task *task;
    assert_int_equal(process_watchdog_create(&k.process_watchdog), 0);
    process_watchdog_tell(k.process_watchdog, "READY=1");
    assert_string_equal(word(fd, PATIENCE), "READY=1"); /* and nothing before it: nothing ticks yet */
    assert_int_equal(apc_executive_create(&executive, "deadline", NULL, NULL), 0);
    const struct apc_task_options options = {
        .size = sizeof options, .name = "test", .period = 10 * APC_NS_PER_MS};
    assert_int_equal(apc_task_create(executive, &options, tick, &k, &task, NULL), 0);
    process_watchdog_watch(k.process_watchdog, task, options.period);
    assert_string_equal(word(fd, PATIENCE), "WATCHDOG=1"); /* of a last tick nobody knows before the first */
    assert_int_equal(apc_task_start(task, NULL), 0);
    const unsigned long long first = fed(fd, 0);
    assert_true(fed(fd, first) > first);

    atomic_store(&k.hangs, true); /* the last words are on their way; then there are none */
    int words = 0;
    while (*word(fd, 2000) && words < 100)
        words++;
    assert_true(words < 100);
    atomic_store(&k.hangs, false);
    (void)fed(fd, first);

    process_watchdog_watch(k.process_watchdog, NULL, options.period);
    apc_task_stop(task);
    apc_task_destroy(task);
    apc_executive_destroy(executive);
    process_watchdog_destroy(k.process_watchdog);
    unsupervise(fd);
}

/* A socket without a file, whose name has @p n bytes with the one before it. */
static int listen_at(size_t n, char *path)
{
    struct sockaddr_un at = {.sun_family = AF_UNIX};
    const int fd = socket(AF_UNIX, SOCK_DGRAM | SOCK_CLOEXEC, 0);
    memset(path, 'w', n);
    snprintf(path, n, "@apc-warden-%d", (int)getpid());
    path[strlen(path)] = n > strlen(path) + 1 ? '-' : '\0';
    path[n] = '\0';
    memcpy(at.sun_path, path, n);
    at.sun_path[0] = '\0';
    assert_int_equal(
        bind(fd, (struct sockaddr *)&at, (socklen_t)(offsetof(struct sockaddr_un, sun_path) + n)), 0);
    assert_int_equal(setenv("NOTIFY_SOCKET", path, 1), 0);
    return fd;
}

static void a_socket_s_name_may_have_107_letters_and_has_two_at_least(void **state)
{
    static const char *const none[] = {"", "@", "/"};
    char path[200];
    struct process_watchdog *w;
    (void)state;
    assert_int_equal(process_watchdog_create(&w), 0);
    for (size_t n = 106; n <= 108; n++) {
        const int fd = listen_at(n, path);
        process_watchdog_tell(w, "READY=1");
        assert_string_equal(word(fd, 0), n <= 107 ? "READY=1" : "");
        close(fd);
    }
    for (size_t i = 0; i < sizeof none / sizeof *none; i++) {
        assert_int_equal(setenv("NOTIFY_SOCKET", none[i], 1), 0);
        process_watchdog_tell(w, "READY=1"); /* to nobody */
    }
    unsetenv("NOTIFY_SOCKET");
    process_watchdog_tell(w, "READY=1");
    process_watchdog_destroy(w);
}

/* Promise(run/ready-once-watchdog) */
static void a_process_that_is_told_to_end_and_does_not_is_ended(void **state)
{
    (void)state;
    int ready[2], status;
    char byte;
    assert_int_equal(pipe(ready), 0);
    pid_t pid = fork();
    assert_true(pid >= 0);
    if (pid == 0) {
        struct process_watchdog *w;
        if (process_watchdog_create(&w) < 0 || write(ready[1], "", 1) != 1)
            _exit(99);
        alarm(60); /* should nobody end it: another way than the one that is looked for */
        for (;;)
            pause();
    }
    assert_int_equal(read(ready[0], &byte, 1), 1);
    assert_int_equal(kill(pid, SIGTERM), 0);
    assert_int_equal(waitpid(pid, &status, 0), pid);
    assert_true(WIFEXITED(status));
    assert_int_equal(WEXITSTATUS(status), 1);
    close(ready[0]);
    close(ready[1]);
}

/* As the run had ended: with 5, although a store that does not answer holds up its way out. */
static void a_process_that_hangs_after_its_end_is_ended_with_the_code_of_it(void **state)
{
    (void)state;
    int status;
    pid_t pid = fork();
    assert_true(pid >= 0);
    if (pid == 0) {
        struct process_watchdog *w;
        if (process_watchdog_create(&w) < 0)
            _exit(99);
        process_watchdog_ending(w, 5);
        alarm(60);
        for (;;)
            pause();
    }
    assert_int_equal(waitpid(pid, &status, 0), pid);
    assert_true(WIFEXITED(status));
    assert_int_equal(WEXITSTATUS(status), 5);
}

/* No descriptor is left open by one that is gone. */
static void one_that_is_destroyed_leaves_nothing_open(void **state)
{
    (void)state;
    int first = dup(STDIN_FILENO);
    close(first);
    for (int i = 0; i < 3; i++) {
        struct process_watchdog *w;
        assert_int_equal(process_watchdog_create(&w), 0);
        process_watchdog_destroy(w);
    }
    int last = dup(STDIN_FILENO);
    assert_int_equal(last, first);
    close(last);
    process_watchdog_destroy(NULL);
}

static void without_a_thread_there_is_none_and_nothing_is_left_open(void **state)
{
    struct process_watchdog *w = (struct process_watchdog *)&refused;
    const int first = dup(STDIN_FILENO);
    (void)state;
    if (!REFUSING)
        skip();
    close(first);
    refused = true;
    assert_int_equal(process_watchdog_create(&w), APC_ESYS);
    refused = false;
    assert_null(w);
    const int last = dup(STDIN_FILENO);
    assert_int_equal(last, first);
    close(last);
}

static void a_signal_is_told_to_who_waits_also_when_it_came_before(void **state)
{
    (void)state;
    struct process_watchdog *w;
    assert_int_equal(process_watchdog_create(&w), 0);
    assert_int_equal(process_watchdog_wait(w, 1), 0);
    assert_int_equal(kill(getpid(), SIGINT), 0);
    assert_int_equal(process_watchdog_wait(w, PATIENCE * APC_NS_PER_MS), SIGINT);
    process_watchdog_destroy(w);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(the_watchdog_hears_of_it_as_long_as_the_task_ticks),
        cmocka_unit_test(a_socket_s_name_may_have_107_letters_and_has_two_at_least),
        cmocka_unit_test(a_process_that_is_told_to_end_and_does_not_is_ended),
        cmocka_unit_test(a_process_that_hangs_after_its_end_is_ended_with_the_code_of_it),
        cmocka_unit_test(one_that_is_destroyed_leaves_nothing_open),
        cmocka_unit_test(without_a_thread_there_is_none_and_nothing_is_left_open),
        cmocka_unit_test(a_signal_is_told_to_who_waits_also_when_it_came_before),
    };
    if (!mkdtemp(dir))
        return 1;
    int failed = cmocka_run_group_tests(tests, NULL, NULL);
    rmdir(dir);
    return failed;
}

/* SPDX-License-Identifier: BSD-3-Clause */
#include "check.h"

#include <pthread.h>
#include <sched.h>
#include <sys/resource.h>
#include <sys/socket.h>
#include <unistd.h>

#include "base/subprocess.h"

static void its_last_word_is_heard_though_it_ended_with_a_message_unread(void **state)
{
    static const char asked[] = "begin", word[] = "error\twhy";
    struct apc_subprocess c = {.output = -1};
    char heard[64] = "";
    int pair[2];

    (void)state;
    assert_int_equal(socketpair(AF_UNIX, SOCK_SEQPACKET | SOCK_CLOEXEC, 0, pair), 0);
    c.socket = pair[0];
    assert_true(apc_subprocess_give(&c, asked, sizeof(asked)));
    assert_int_equal(send(pair[1], word, sizeof(word), MSG_NOSIGNAL), sizeof(word));
    close(pair[1]);
    assert_int_equal(apc_subprocess_take(&c, heard, sizeof(heard), 0), sizeof(word));
    assert_string_equal(heard, word);
    assert_int_equal(apc_subprocess_take(&c, heard, sizeof(heard), 0), 0);
    close(pair[0]);
}

static bool begin(struct apc_subprocess *c)
{
    char *const argv[] = {(char[]){"sleep"}, (char[]){"60"}, NULL};

    return apc_subprocess_begin(c, argv, NULL, NULL) == 0;
}

/* By the thread that asks it and by the one that starts it anew, as the process was started: nice -n 3 chrt
 * -b 0 */
/*
 * Promise(run): An FMU, a plant or a law in Python is as nice as who has it, also when it is started again
 *   (`nice`, `chrt`).
 */
static void it_is_scheduled_as_who_has_it(void **state)
{
    struct apc_subprocess c = {0};

    (void)state;
    assert_int_equal(setpriority(PRIO_PROCESS, 0, getpriority(PRIO_PROCESS, 0) + 3), 0);
    assert_int_equal(sched_setscheduler(0, SCHED_BATCH, &(struct sched_param){0}), 0);
    assert_int_equal(apc_subprocess_open(&c, "sleep", begin), 0);
    for (int again = 0; again < 2; again++) {
        if (again) {
            apc_subprocess_start(&c);
            apc_subprocess_settle(&c);
        } else {
            assert_true(begin(&c));
        }
        assert_true(c.socket >= 0);
        assert_int_equal(sched_getscheduler(c.pid), SCHED_BATCH);
        assert_int_equal(getpriority(PRIO_PROCESS, (id_t)c.pid), getpriority(PRIO_PROCESS, 0));
        apc_subprocess_bury(&c, true);
    }
    apc_subprocess_close(&c);
}

static ssize_t heard_first;

static bool begin_and_wait_for_a_word(struct apc_subprocess *c)
{
    char word[64];
    const bool begun = begin(c);

    heard_first = apc_subprocess_take(c, word, sizeof(word), INT64_MAX);
    apc_subprocess_bury(c, true);
    return begun;
}

/*
 * Promise(run): A daemon ends when it is told to, also while its FMU, plant or law in Python is being started
 *   again.
 */
static void what_is_being_started_is_not_waited_for_at_the_end(void **state)
{
    struct apc_subprocess c = {0};

    (void)state;
    assert_int_equal(apc_subprocess_open(&c, "sleep", begin_and_wait_for_a_word), 0);
    apc_subprocess_start(&c);
    apc_subprocess_close(&c);
    assert_int_equal(heard_first, -1); /* 0: it has ended by itself */
    assert_string_equal(c.end, "did not answer and was killed");
    assert_int_equal(c.socket, -1);
}

/* What a process printed, as one line for people. */
static void what_it_said_is_a_line_and_the_end_of_it_where_it_is_long(void **state)
{
    static const struct {
        const char *printed, *line;
        size_t size;
    } of[] = {
        {"", "", 64},
        {"\n \n", "", 64},
        {"one\ntwo \n\n", "one|two", 64},
        {"a\tb\177", "a b ", 64},
        {"0123456789", "0123456789", 34},            /* it has just room */
        {"0123456789x", "(1 B) ... 123456789x", 34}, /* and this has not */
    };
    struct apc_subprocess c = {.output = -1};
    char line[64];

    (void)state;
    for (size_t i = 0; i < sizeof of / sizeof *of; i++) {
        c.n_said = strlen(of[i].printed);
        memcpy(c.said, of[i].printed, c.n_said);
        apc_subprocess_said(&c, line, of[i].size);
        assert_string_equal(line, of[i].line);
        assert_int_equal(c.n_said, 0); /* it is said once */
    }
}

static int next_descriptor(void)
{
    const int fd = dup(STDERR_FILENO);

    close(fd);
    return fd;
}

static void what_cannot_be_started_leaves_nothing_open(void **state)
{
    char *const argv[] = {(char[]){"/no/such/program"}, NULL};
    struct apc_subprocess c = {.socket = -1, .output = -1};
    const int next = next_descriptor();
    struct apc_error why;

    (void)state;
    for (int k = 0; k < 3; k++) {
        assert_int_equal(apc_subprocess_begin(&c, argv, NULL, &why), APC_ESYS);
        assert_has(why.text, "cannot be started: No such file or directory");
        assert_int_equal(next_descriptor(), next);
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(its_last_word_is_heard_though_it_ended_with_a_message_unread),
        cmocka_unit_test(it_is_scheduled_as_who_has_it),
        cmocka_unit_test(what_is_being_started_is_not_waited_for_at_the_end),
        cmocka_unit_test(what_it_said_is_a_line_and_the_end_of_it_where_it_is_long),
        cmocka_unit_test(what_cannot_be_started_leaves_nothing_open),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}

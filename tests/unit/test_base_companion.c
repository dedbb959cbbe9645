/* SPDX-License-Identifier: BSD-3-Clause */
#include "check.h"

#include <sys/socket.h>
#include <unistd.h>

#include "base/companion.h"

static void its_last_word_is_heard_though_it_ended_with_a_message_unread(void **state)
{
    static const char asked[] = "begin", word[] = "error\twhy";
    struct apc_companion c = {.output = -1};
    char heard[64] = "";
    int pair[2];

    (void)state;
    assert_int_equal(socketpair(AF_UNIX, SOCK_SEQPACKET | SOCK_CLOEXEC, 0, pair), 0);
    c.socket = pair[0];
    assert_true(apc_companion_give(&c, asked, sizeof(asked)));
    assert_int_equal(send(pair[1], word, sizeof(word), MSG_NOSIGNAL), sizeof(word));
    close(pair[1]);
    assert_int_equal(apc_companion_take(&c, heard, sizeof(heard), 0), sizeof(word));
    assert_string_equal(heard, word);
    assert_int_equal(apc_companion_take(&c, heard, sizeof(heard), 0), 0);
    close(pair[0]);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(its_last_word_is_heard_though_it_ended_with_a_message_unread)};
    return cmocka_run_group_tests(tests, NULL, NULL);
}

/* SPDX-License-Identifier: BSD-3-Clause */
/* What is said of a reply that is none. */
#include "check.h"

#include "exchange/exchange_internal.h"

#include <string.h>

#define NOW "2026-01-31T12:00:00.000000Z"

static void a_reply_that_is_none_says_why(void **state)
{
    static const struct {
        const char *reply, *why;
    } cases[] = {
        {"apc1 values 1 2;" NOW ",Good,1;" NOW ",Bad,2;\n", NULL},
        {"apc1 values 1 1;" NOW ",Good,1;\n", "its reply has fewer than 2 values"},
        {"apc1 values 1 3;" NOW ",Good,1;" NOW ",Good,1;" NOW ",Good,1;\n",
         "its reply has more than 2 values"},
        {"apc1 values 1 2;" NOW ",Good,nan;" NOW ",Good,1;\n", "is not a finite number with a time"},
        {"apc1 values 1 2;,Good,1;" NOW ",Good,1;\n", "is not a finite number with a time"},
        {"hello\n", "its reply is no frame"},
        {"apc1 values 9 2;" NOW ",Good,1;" NOW ",Good,1;\n", "does not answer the request"},
        {"apc1 command 1 2;" NOW ",Good,1;" NOW ",Good,1;\n", "does not answer the request"},
    };
    struct apc_frames frames;
    struct apc_value y[2];
    struct apc_error why;

    (void)state;
    assert_int_equal(apc_frames_init(&frames, 1, 2), 0);
    assert_true(apc_frames_ask(&frames, NULL, &why) > 0);
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        const int rc = apc_frames_answer(&frames, cases[i].reply, strlen(cases[i].reply), y, &why);

        assert_int_equal(rc, cases[i].why ? APC_EPROTO : 0);
        if (cases[i].why && !strstr(why.text, cases[i].why))
            fail_msg("%s: %s", cases[i].reply, why.text);
    }
    apc_frames_free(&frames);
}

int main(void)
{
    const struct CMUnitTest tests[] = {cmocka_unit_test(a_reply_that_is_none_says_why)};
    return cmocka_run_group_tests(tests, NULL, NULL);
}

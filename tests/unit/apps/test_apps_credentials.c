/* SPDX-License-Identifier: BSD-3-Clause */
/* Who a daemon is on a link tls:, and what its main thread says of its certificate. What it says is kept
 * here. */
#include "check.h"

#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <time.h>
#include <unistd.h>

#include "apc/admin/authority.h"
#include "daemon/credentials.h"
#include "scratch.h"

#define DAY (24 * 3600L)

static char said[1000];
static enum apc_event_severity how_bad;
static struct daemon d;
static struct credentials c;

void daemon_event(struct daemon *of, enum apc_event_severity severity, const char *kind, const char *fmt, ...)
{
    va_list args;
    assert_ptr_equal(of, &d);
    assert_string_equal(kind, "certificate");
    assert_string_equal(said, ""); /* one thing at a time */
    how_bad = severity;
    va_start(args, fmt);
    vsnprintf(said, sizeof said, fmt, args);
    va_end(args);
}

int daemon_error(const struct daemon *of, int err, const char *fmt, ...)
{
    va_list args;
    assert_ptr_equal(of, &d);
    va_start(args, fmt);
    vsnprintf(said, sizeof said, fmt, args);
    va_end(args);
    return err;
}

/* An identity of that name, until so many s from now. */
static void issue(const char *name, long until)
{
    const time_t now = time(NULL);
    const struct authority_request request = {
        .name = name, .role = ROLE_CLIENT, .from = now - 400 * DAY, .until = now + until, .replace = true};
    struct apc_error why;
    if (authority_issue(scratch_path("authority"), &request, &why) < 0)
        fail_msg("%s", why.text);
}

static const char *file_of(const char *name)
{
    static char path[300];
    snprintf(path, sizeof path, "%s/%s.pem", scratch_path("authority"), name);
    return path;
}

static int make_authority(void **state)
{
    const time_t now = time(NULL);
    const struct authority_request request = {
        .name = "authority", .role = ROLE_AUTHORITY, .from = now - 500 * DAY, .until = now + 1000 * DAY};
    struct apc_error why;
    (void)state;
    unsetenv("APC_IDENTITY");
    return authority_create(scratch_path("authority"), &request, &why);
}

static int open_with(const char *address, const char *file)
{
    said[0] = '\0';
    d = (struct daemon){.look = NULL};
    memset(&c, 0x55, sizeof c);
    return credentials_open(&c, &d, address, file);
}

/* The main thread's next look; @p due: it is time for it. */
static void look(bool due)
{
    said[0] = '\0';
    if (due)
        c.look_at = 0;
    d.look(d.look_ctx);
}

static void assert_event(enum apc_event_severity severity, const char *text)
{
    assert_has(said, text);
    assert_int_equal(how_bad, severity);
}

static void only_a_link_of_tls_needs_an_identity(void **state)
{
    (void)state;
    assert_int_equal(open_with("tcp:127.0.0.1:1", file_of("nobody")), 0);
    assert_null(c.identity);
    assert_null(d.look);
    credentials_close(&c);
    assert_int_equal(open_with("tls:127.0.0.1:1", NULL), APC_EINVAL);
    assert_has(said,
               "link \"tls:127.0.0.1:1\": the identity of this program is missing: give --identity FILE");
    assert_int_equal(open_with("tls:127.0.0.1:1", ""), APC_EINVAL);
    assert_null(d.look);
    assert_int_equal(open_with("tls:127.0.0.1:1", file_of("nobody")), APC_ENOTFOUND);
    assert_has(said, "nobody.pem");
    assert_null(d.look);
    credentials_close(&c);
}

static void a_file_goes_before_the_environment(void **state)
{
    (void)state;
    issue("long", 200 * DAY);
    setenv("APC_IDENTITY", file_of("long"), 1);
    for (int i = 0; i < 2; i++) {
        assert_int_equal(open_with("tls:127.0.0.1:1", i ? NULL : ""), 0);
        assert_non_null(c.identity);
        assert_ptr_equal(c.d, &d);
        look(false); /* the first one is due at once */
        assert_string_equal(said, "");
        assert_true(c.look_at > apc_clock_mono(NULL));
        credentials_close(&c);
    }
    assert_int_equal(open_with("tls:127.0.0.1:1", file_of("nobody")), APC_ENOTFOUND);
    setenv("APC_IDENTITY", "", 1);
    assert_int_equal(open_with("tls:127.0.0.1:1", NULL), APC_EINVAL);
    unsetenv("APC_IDENTITY");
}

static void its_end_is_said_once_at_each_stage(void **state)
{
    static const struct {
        long left;
        enum apc_event_severity severity;
        const char *text;
    } of[] = {
        {20 * DAY + 60, APC_EVENT_WARNING, "the certificate expires in 20.0 days, at "},
        {DAY / 2 + 60, APC_EVENT_WARNING, "the certificate expires in 0.5 days, at "},
        {-60, APC_EVENT_ALARM, "the certificate expired at "},
    };
    (void)state;
    for (size_t i = 0; i < sizeof of / sizeof *of; i++) {
        issue("short", of[i].left);
        assert_int_equal(open_with("tls:127.0.0.1:1", file_of("short")), 0);
        look(false);
        assert_event(of[i].severity, of[i].text);
        assert_has(said, "make another with `apc cert`");
        look(false); /* not yet */
        assert_string_equal(said, "");
        look(true);
        assert_string_equal(said, "");
        credentials_close(&c);
    }
}

static void a_new_file_is_taken_up_and_a_bad_one_said_once(void **state)
{
    (void)state;
    issue("new", 20 * DAY + 60);
    assert_int_equal(open_with("tls:127.0.0.1:1", file_of("new")), 0);
    look(false);
    assert_event(APC_EVENT_WARNING, "expires in 20.0 days");
    issue("new", 100 * DAY);
    look(false);
    assert_string_equal(said, "");
    look(true);
    assert_event(APC_EVENT_INFO, "a new certificate is in use, valid until ");
    assert_int_equal(c.warned, 0);
    for (int i = 0; i < 2; i++) {
        FILE *out = fopen(file_of("new"), "w");
        assert_non_null(out);
        fprintf(out, "no certificate, %d\n", i);
        assert_int_equal(fclose(out), 0);
        look(true);
        if (i == 0)
            assert_event(APC_EVENT_WARNING, "; the one that was read before stays in use");
        else
            assert_string_equal(said, "");
    }
    issue("new", 200 * DAY);
    look(true);
    assert_event(APC_EVENT_INFO, "a new certificate is in use");
    assert_int_equal(unlink(file_of("new")), 0);
    look(true);
    assert_event(APC_EVENT_WARNING, "stays in use"); /* once more, as it was good in between */
    credentials_close(&c);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(only_a_link_of_tls_needs_an_identity),
        cmocka_unit_test(a_file_goes_before_the_environment),
        cmocka_unit_test(its_end_is_said_once_at_each_stage),
        cmocka_unit_test(a_new_file_is_taken_up_and_a_bad_one_said_once),
    };
    return cmocka_run_group_tests(tests, make_authority, NULL);
}

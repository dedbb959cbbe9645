/* SPDX-License-Identifier: BSD-3-Clause */
/* The link inproc: on virtual time: replies in time, late, twice, lost; connections. */
#include "check.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include <apcmodules.h>

#define MS APC_NS_PER_MS
#define S  APC_NS_PER_S

struct bench {
    struct apc_executive *e;
    struct apc_inproc *link;
    apc_ns zero;
    char trace[1000];
    int refuse;     /* serve() answers with it, when negative */
    int next, last; /* requests that are sent by themselves */
};

static void note(struct bench *b, const char *what, const char *text, int length)
{
    size_t used = strlen(b->trace);
    snprintf(b->trace + used, sizeof b->trace - used, "%s%.*s@%g ", what, length, text,
             apc_ns_to_s(apc_clock_mono(apc_executive_clock(b->e)) - b->zero));
}

static int serve(void *ctx, uint64_t connection, const char *request, size_t length, char *reply, size_t size)
{
    struct bench *b = ctx;
    char text[40];
    snprintf(text, sizeof text, "%.*s/%d", (int)length, request, (int)connection);
    note(b, "?", text, (int)strlen(text));
    if (b->refuse < 0)
        return b->refuse;
    return snprintf(reply, size, "re%.*s", (int)length, request);
}

static void on_reply(void *ctx, const char *reply, int length)
{
    if (length < 0)
        note(ctx, apc_err_name(length), "", 0);
    else
        note(ctx, "!", reply, length);
}

static struct bench *set_up(struct apc_network_options network)
{
    struct bench *b = calloc(1, sizeof *b);
    struct apc_error why = {""};
    assert_non_null(b);
    assert_int_equal(apc_executive_create(&b->e, "virtual", NULL, NULL), 0);
    b->zero = apc_clock_mono(apc_executive_clock(b->e));
    const struct apc_inproc_options options = {.size = sizeof options,
                                               .executive = b->e,
                                               .network = network,
                                               .frame_max = 100,
                                               .serve = serve,
                                               .serve_ctx = b};
    if (apc_inproc_create(&b->link, &options, &why) < 0)
        fail_msg("%s", why.text);
    return b;
}

static void tear_down(struct bench *b)
{
    apc_inproc_destroy(b->link);
    assert_int_equal(apc_executive_destroy(b->e), 0);
    free(b);
}

static int ask(struct bench *b, const char *text, apc_ns timeout)
{
    return apc_inproc_exchange(b->link, text, strlen(text), timeout, on_reply, b);
}

static void run(struct bench *b, double until)
{
    apc_ns ns;
    apc_ns_from_s(until, &ns);
    assert_true(apc_virtual_run(b->e, b->zero + ns) >= 0);
}

static struct apc_distribution constant(double value)
{
    return (struct apc_distribution){.kind = APC_CONSTANT, .a = value};
}

static void a_reply_comes_after_both_delays(void **state)
{
    struct bench *b = set_up((struct apc_network_options){.delay = constant(0.25)});
    (void)state;
    assert_int_equal(ask(b, "a", S), 0);
    assert_int_equal(ask(b, "b", S), APC_EBUSY);
    run(b, 1);
    assert_int_equal(ask(b, "c", S), 0);
    run(b, 9);
    assert_string_equal(b->trace, "?a/1@0.25 !rea@0.5 ?c/1@1.25 !rec@1.5 ");
    tear_down(b);
}

static void without_delay_it_comes_at_the_same_instant(void **state)
{
    struct bench *b = set_up((struct apc_network_options){0});
    (void)state;
    assert_int_equal(ask(b, "a", 1), 0);
    run(b, 0);
    assert_string_equal(b->trace, "?a/1@0 !rea@0 ");
    tear_down(b);
}

static void a_late_reply_is_none(void **state)
{
    struct bench *b = set_up((struct apc_network_options){.delay = constant(0.75)});
    struct apc_inproc_stats stats;
    (void)state;
    ask(b, "a", S);
    run(b, 1);
    assert_int_equal(ask(b, "b", 2 * S), 0); /* a's reply comes while b's is waited for */
    run(b, 9);
    assert_string_equal(b->trace, "?a/1@0.75 APC_ETIMEDOUT@1 ?b/2@1.75 !reb@2.5 ");
    apc_inproc_stats(b->link, &stats);
    assert_int_equal(stats.exchanges, 2);
    assert_int_equal(stats.timeouts, 1);
    assert_int_equal(stats.frames.sent, 4);
    tear_down(b);
}

static void what_is_lost_times_out(void **state)
{
    struct bench *b = set_up((struct apc_network_options){.loss = 1});
    (void)state;
    ask(b, "a", S);
    run(b, 9);
    assert_string_equal(b->trace, "APC_ETIMEDOUT@1 ");
    tear_down(b);
}

static void a_request_that_arrives_twice_has_one_reply(void **state)
{
    struct bench *b = set_up((struct apc_network_options){.duplication = 1, .delay = constant(0.5)});
    (void)state;
    ask(b, "a", 2 * S);
    run(b, 1);
    ask(b, "b", 2 * S);
    run(b, 9);
    assert_string_equal(b->trace, "?a/1@0.5 ?a/1@0.5 !rea@1 ?b/1@1.5 ?b/1@1.5 !reb@2 ");
    tear_down(b);
}

static void a_closed_connection_is_said_and_the_next_is_another(void **state)
{
    struct bench *b = set_up((struct apc_network_options){.delay = constant(0.25)});
    (void)state;
    b->refuse = APC_EPERM;
    ask(b, "a", S);
    run(b, 1);
    b->refuse = 0;
    ask(b, "b", S);
    run(b, 1.5);
    apc_inproc_reset(b->link);
    ask(b, "c", S);
    run(b, 9);
    assert_string_equal(b->trace, "?a/1@0.25 APC_ECONN@0.5 ?b/2@1.25 !reb@1.5 ?c/3@1.75 !rec@2 ");
    tear_down(b);
}

/* A frame takes its time on the line; that a connection is closed takes none. */
static void only_what_is_said_takes_time_on_the_line(void **state)
{
    struct bench *b = set_up((struct apc_network_options){.bandwidth = 8.0}); /* a byte a second */
    (void)state;
    ask(b, "abc", 30 * S);
    run(b, 20);
    b->refuse = APC_EPERM;
    ask(b, "abc", 30 * S);
    run(b, 40);
    assert_string_equal(b->trace, "?abc/1@3 !reabc@8 ?abc/1@23 APC_ECONN@23 ");
    tear_down(b);
}

static void again(void *ctx, const char *reply, int length)
{
    struct bench *b = ctx;
    char text[8];
    on_reply(ctx, reply, length);
    snprintf(text, sizeof text, "%d", b->next);
    if (b->next++ < b->last)
        assert_int_equal(apc_inproc_exchange(b->link, text, strlen(text), S, again, b), 0);
}

static void the_next_may_begin_where_one_ends(void **state)
{
    struct bench *b = set_up((struct apc_network_options){.delay = constant(0.5)});
    (void)state;
    b->last = 3;
    again(b, "", 0);
    run(b, 9);
    assert_string_equal(b->trace, "!@0 ?0/1@0.5 !re0@1 ?1/1@1.5 !re1@2 ?2/1@2.5 !re2@3 ");
    tear_down(b);
}

static void what_makes_no_sense_is_refused(void **state)
{
    struct bench *b = set_up((struct apc_network_options){0});
    struct apc_inproc_options o = {.size = sizeof o, .executive = b->e, .serve = serve};
    struct apc_executive *real;
    struct apc_inproc *link;
    struct apc_error why = {""};
    char text[102] = "";
    (void)state;
    memset(text, 'x', 101);
    assert_int_equal(ask(b, text, S), APC_EINVAL);
    assert_int_equal(ask(b, "a", 0), APC_EINVAL);
    assert_int_equal(ask(b, "a", INT64_MAX), APC_EINVAL);
    assert_int_equal(apc_inproc_exchange(b->link, "a", 1, S, NULL, NULL), APC_EINVAL);
    assert_int_equal(apc_executive_create(&real, "deadline", NULL, NULL), 0);
    o.executive = real;
    assert_int_equal(apc_inproc_create(&link, &o, &why), APC_EINVAL);
    assert_non_null(strstr(why.text, "virtual"));
    o.executive = b->e;
    o.network.loss = 2;
    assert_int_equal(apc_inproc_create(&link, &o, &why), APC_EINVAL);
    assert_non_null(strstr(why.text, "loss"));
    o.serve = NULL;
    assert_int_equal(apc_inproc_create(&link, &o, &why), APC_EINVAL);
    assert_null(link);
    o.serve = serve;
    o.network.loss = 0;
    o.frame_max = APC_FRAME_MAX + 1;
    assert_int_equal(apc_inproc_create(&link, &o, &why), APC_EINVAL);
    assert_non_null(strstr(why.text, "frame_max"));
    o.frame_max = APC_FRAME_MAX;
    assert_int_equal(apc_inproc_create(&link, &o, &why), 0);
    apc_inproc_destroy(link);
    apc_inproc_destroy(NULL);
    o.executive = NULL;
    assert_int_equal(apc_inproc_create(&link, &o, &why), APC_EINVAL);
    assert_int_equal(apc_inproc_create(NULL, &o, &why), APC_EINVAL);
    text[100] = '\0'; /* as long as may be; as late as may be */
    assert_int_equal(ask(b, text, INT64_MAX - b->zero), 0);
    apc_executive_destroy(real);
    tear_down(b);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(a_reply_comes_after_both_delays),
        cmocka_unit_test(without_delay_it_comes_at_the_same_instant),
        cmocka_unit_test(a_late_reply_is_none),
        cmocka_unit_test(what_is_lost_times_out),
        cmocka_unit_test(a_request_that_arrives_twice_has_one_reply),
        cmocka_unit_test(a_closed_connection_is_said_and_the_next_is_another),
        cmocka_unit_test(only_what_is_said_takes_time_on_the_line),
        cmocka_unit_test(the_next_may_begin_where_one_ends),
        cmocka_unit_test(what_makes_no_sense_is_refused),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}

/* SPDX-License-Identifier: BSD-3-Clause */
/* The scheme inproc: on virtual time: replies in time, late, twice, lost; connections. */
#include "check.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include <apcexchange.h>

#define MS APC_NS_PER_MS
#define S  APC_NS_PER_S

struct bench {
    struct apc_executive *e;
    struct apc_exchange *x;
    apc_ns zero;
    char trace[1000];
    int refuse;              /* serve() answers with it, when negative */
    size_t request, reply;   /* lengths of the last frames */
    int next, last;          /* exchanges that begin by themselves */
    void (*done)(void *ctx); /* what else there is to do at the end of one */
};

static apc_ns now(const struct bench *b)
{
    return apc_clock_mono(apc_executive_clock(b->e));
}

static void note(struct bench *b, const char *what)
{
    size_t used = strlen(b->trace);
    snprintf(b->trace + used, sizeof b->trace - used, "%s@%g ", what, apc_ns_to_s(now(b) - b->zero));
}

static int serve(void *ctx, uint64_t connection, const char *request, size_t length, char *reply, size_t size)
{
    struct bench *b = ctx;
    struct apc_frame frame;
    struct apc_sample value;
    char text[40];
    assert_int_equal(apc_frame_decode(request, length, &frame, &value, 1), 0);
    snprintf(text, sizeof text, "?%g/%d", value.value, (int)connection);
    note(b, text);
    if (b->refuse < 0)
        return b->refuse;
    frame.kind = APC_FRAME_VALUES;
    value.value *= 10;
    b->request = length;
    b->reply = (size_t)apc_frame_encode(reply, size, &frame, &value);
    return (int)b->reply;
}

static void on_done(void *ctx)
{
    struct bench *b = ctx;
    struct apc_value y;
    char text[40];
    int rc = apc_exchange_finish(b->x, &y);
    if (rc < 0)
        note(b, apc_err_name(rc));
    else if (snprintf(text, sizeof text, "!%g", y.value) > 0)
        note(b, text);
    if (b->done)
        b->done(b);
}

static struct bench *set_up(struct apc_network_options network)
{
    struct bench *b = calloc(1, sizeof *b);
    struct apc_error why = {""};
    assert_non_null(b);
    assert_int_equal(apc_executive_create(&b->e, "virtual", NULL, NULL), 0);
    b->zero = now(b);
    const struct apc_inproc_options inproc = {.size = sizeof inproc,
                                              .executive = b->e,
                                              .network = network,
                                              .serve = serve,
                                              .serve_ctx = b,
                                              .done = on_done,
                                              .done_ctx = b};
    const struct apc_exchange_options options = {.size = sizeof options, .nu = 1, .ny = 1, .inproc = &inproc};
    if (apc_exchange_open(&b->x, "inproc:", &options, &why) < 0)
        fail_msg("%s", why.text);
    return b;
}

static void tear_down(struct bench *b)
{
    apc_exchange_close(b->x);
    assert_int_equal(apc_executive_destroy(b->e), 0);
    free(b);
}

static int ask(struct bench *b, double u, apc_ns patience)
{
    return apc_exchange_begin(b->x, &(struct apc_value){.value = u}, now(b) + patience);
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
    assert_int_equal(ask(b, 1, S), 0);
    assert_int_equal(ask(b, 2, S), APC_EBUSY);
    run(b, 1);
    assert_int_equal(ask(b, 3, S), 0);
    run(b, 9);
    assert_string_equal(b->trace, "?1/1@0.25 !10@0.5 ?3/1@1.25 !30@1.5 ");
    tear_down(b);
}

static void without_delay_it_comes_at_the_same_instant(void **state)
{
    struct bench *b = set_up((struct apc_network_options){0});
    (void)state;
    assert_int_equal(ask(b, 1, 1), 0);
    run(b, 0);
    assert_string_equal(b->trace, "?1/1@0 !10@0 ");
    tear_down(b);
}

static void a_late_reply_is_none(void **state)
{
    struct bench *b = set_up((struct apc_network_options){.delay = constant(0.75)});
    struct apc_inproc_stats stats = {.size = sizeof stats};
    (void)state;
    ask(b, 1, S);
    run(b, 1);
    assert_int_equal(ask(b, 2, 2 * S), 0); /* the reply to 1 comes while that to 2 is waited for */
    run(b, 9);
    assert_string_equal(b->trace, "?1/1@0.75 APC_ETIMEDOUT@1 ?2/2@1.75 !20@2.5 ");
    apc_inproc_stats(b->x, &stats);
    assert_int_equal(stats.exchanges, 2);
    assert_int_equal(stats.timeouts, 1);
    assert_int_equal(stats.frames.sent, 4);
    tear_down(b);
}

static void what_is_lost_times_out(void **state)
{
    struct bench *b = set_up((struct apc_network_options){.loss = 1});
    (void)state;
    ask(b, 1, S);
    run(b, 9);
    assert_string_equal(b->trace, "APC_ETIMEDOUT@1 ");
    tear_down(b);
}

static void a_loss_on_either_way_is_counted(void **state)
{
    enum { N = 40 };
    struct bench *b = set_up((struct apc_network_options){.loss = 0.5, .seed = 1});
    struct apc_inproc_stats stats = {.size = sizeof stats};
    int arrived = 0;
    (void)state;
    for (int i = 0; i < N; i++) {
        assert_int_equal(ask(b, 1, S), 0);
        run(b, i + 1);
        arrived += b->trace[0] == '?';
        b->trace[0] = '\0';
    }
    apc_inproc_stats(b->x, &stats);
    assert_true(arrived > 0 && arrived < N);
    assert_true(stats.timeouts > (uint64_t)(N - arrived)); /* replies were lost, too */
    assert_int_equal(stats.frames.lost, stats.timeouts);
    tear_down(b);
}

static void a_request_that_arrives_twice_has_one_reply(void **state)
{
    struct bench *b = set_up((struct apc_network_options){.duplication = 1, .delay = constant(0.5)});
    (void)state;
    ask(b, 1, 2 * S);
    run(b, 1);
    ask(b, 2, 2 * S);
    run(b, 9);
    assert_string_equal(b->trace, "?1/1@0.5 ?1/1@0.5 !10@1 ?2/1@1.5 ?2/1@1.5 !20@2 ");
    tear_down(b);
}

static void a_closed_connection_is_said_and_the_next_is_another(void **state)
{
    struct bench *b = set_up((struct apc_network_options){.delay = constant(0.25)});
    (void)state;
    b->refuse = APC_EPERM;
    ask(b, 1, S);
    run(b, 1);
    b->refuse = 0;
    ask(b, 2, S);
    run(b, 9);
    assert_string_equal(b->trace, "?1/1@0.25 APC_ECONN@0.5 ?2/2@1.25 !20@1.5 ");
    tear_down(b);
}

/* A frame takes its time on the line; that a connection is closed takes none. */
static void only_what_is_said_takes_time_on_the_line(void **state)
{
    struct bench *b = set_up((struct apc_network_options){.bandwidth = 8.0}); /* a byte a second */
    char expected[100];
    (void)state;
    ask(b, 1, 300 * S);
    run(b, 300);
    b->refuse = APC_EPERM;
    ask(b, 1, 300 * S);
    run(b, 600);
    snprintf(expected, sizeof expected, "?1/1@%zu !10@%zu ?1/1@%zu APC_ECONN@%zu ", b->request,
             b->request + b->reply, 300 + b->request, 300 + b->request);
    assert_string_equal(b->trace, expected);
    tear_down(b);
}

static void again(void *ctx)
{
    struct bench *b = ctx;
    if (b->next < b->last)
        assert_int_equal(ask(b, b->next++, S), 0);
}

static void the_next_may_begin_where_one_ends(void **state)
{
    struct bench *b = set_up((struct apc_network_options){.delay = constant(0.5)});
    (void)state;
    b->last = 4;
    b->next = 1;
    b->done = again;
    again(b);
    run(b, 9);
    assert_string_equal(b->trace, "?1/1@0.5 !10@1 ?2/1@1.5 !20@2 ?3/1@2.5 !30@3 ");
    tear_down(b);
}

static void what_makes_no_sense_is_refused(void **state)
{
    struct bench *b = set_up((struct apc_network_options){0});
    struct apc_inproc_options o = {.size = sizeof o, .executive = b->e, .serve = serve};
    const struct apc_exchange_options options = {.size = sizeof options, .nu = 1, .ny = 1, .inproc = &o};
    struct apc_executive *real;
    struct apc_exchange *x;
    struct apc_error why = {""};
    (void)state;
    assert_int_equal(ask(b, 1, 0), APC_ETIMEDOUT);
    assert_int_equal(apc_executive_create(&real, "deadline", NULL, NULL), 0);
    o.executive = real;
    assert_int_equal(apc_exchange_open(&x, "inproc:", &options, &why), APC_EINVAL);
    assert_non_null(strstr(why.text, "virtual"));
    o.executive = b->e;
    o.network.loss = 2;
    assert_int_equal(apc_exchange_open(&x, "inproc:", &options, &why), APC_EINVAL);
    assert_non_null(strstr(why.text, "loss"));
    o.serve = NULL;
    assert_int_equal(apc_exchange_open(&x, "inproc:", &options, &why), APC_EINVAL);
    assert_null(x);
    o.serve = serve;
    o.executive = NULL;
    assert_int_equal(apc_exchange_open(&x, "inproc:", &options, &why), APC_EINVAL);
    assert_int_equal(apc_exchange_begin(b->x, NULL, INT64_MAX), 0); /* as late as may be */
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
        cmocka_unit_test(a_loss_on_either_way_is_counted),
        cmocka_unit_test(a_request_that_arrives_twice_has_one_reply),
        cmocka_unit_test(a_closed_connection_is_said_and_the_next_is_another),
        cmocka_unit_test(only_what_is_said_takes_time_on_the_line),
        cmocka_unit_test(the_next_may_begin_where_one_ends),
        cmocka_unit_test(what_makes_no_sense_is_refused),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}

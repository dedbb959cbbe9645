/* SPDX-License-Identifier: BSD-3-Clause */
/* Who keeps his connection when there are too many, and who has to send his request by when. Time is the
 * test's. */
#include <netinet/in.h>
#include <stdio.h>
#include <stdlib.h>
#include <sys/resource.h>
#include <sys/socket.h>
#include <sys/wait.h>
#include <unistd.h>

#include "apc-ui/server/connection_limits.h"
#include "check.h"

#define S APC_NS_PER_S

struct visitor {
    struct connection *c;
    int far; /* the client's end */
};

static struct connection_limits connection_limits;
static struct visitor visitors[MEMBERS + STRANGERS + 16];
static size_t n;

static int set_up(void **state)
{
    (void)state;
    n = 0;
    return connection_limits_init(&connection_limits);
}

static int tear_down(void **state)
{
    (void)state;
    for (size_t i = 0; i < n; i++) {
        int fd = visitors[i].c->fd;
        connection_limits_leave(&connection_limits, visitors[i].c);
        close(fd);
        close(visitors[i].far);
    }
    connection_limits_free(&connection_limits);
    return 0;
}

static struct visitor *come(const char *address, apc_ns now)
{
    int fds[2];
    struct visitor *v = &visitors[n];
    assert_int_equal(socketpair(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC, 0, fds), 0);
    v->c = connection_limits_enter(&connection_limits, fds[0], address, now);
    v->far = fds[1];
    assert_non_null(v->c);
    n++;
    return v;
}

/* The client's end says: is the connection there? */
static bool is_open(const struct visitor *v)
{
    char byte;
    return recv(v->far, &byte, 1, MSG_DONTWAIT) < 0;
}

static void visit(int many, const char *address, apc_ns now)
{
    for (int i = 0; i < many; i++)
        come(address, now);
}

/*
 * Promise(server/rooms-shares-stranger): Rooms and shares: no stranger or session keeps others out; slow
 *   ones end.
 */
static void many_of_one_address_cost_only_each_other(void **state)
{
    (void)state;
    struct visitor *other = come("10.0.0.2", S);
    visit(STRANGERS_ADDRESS, "10.0.0.1", 2 * S);
    assert_true(is_open(&visitors[1]));
    come("10.0.0.1", 3 * S);
    assert_false(is_open(&visitors[1])); /* the oldest of its own */
    assert_true(is_open(&visitors[2]));
    visit(500, "10.0.0.1", 4 * S);
    assert_true(is_open(other));
    assert_true(is_open(&visitors[n - 1])); /* who came last can ask */
}

/* Promise(server/rooms-shares-stranger) */
static void strangers_of_many_addresses_cost_the_oldest_stranger_only(void **state)
{
    char address[32];
    (void)state;
    struct visitor *member = come("10.1.0.0", S), *oldest = come("10.2.0.0", 2 * S);
    connection_limits_member(&connection_limits, member->c, "token");
    for (int i = 1; i < STRANGERS; i++) {
        snprintf(address, sizeof address, "10.2.0.%d", i);
        come(address, 3 * S);
    }
    assert_true(is_open(oldest));
    come("10.3.0.1", 4 * S);
    assert_false(is_open(oldest));
    assert_true(is_open(member));
    assert_true(is_open(&visitors[2]));
}

static void who_is_being_answered_is_not_sent_away(void **state)
{
    (void)state;
    struct visitor *asking = come("10.0.0.1", S);
    connection_limits_asked(&connection_limits, asking->c);
    connection_limits_busy(&connection_limits, asking->c);
    visit(STRANGERS_ADDRESS, "10.0.0.1", 2 * S);
    assert_true(is_open(asking));
    assert_false(is_open(&visitors[1]));
    connection_limits_answered(&connection_limits, asking->c, S);
    come("10.0.0.1", 3 * S);
    assert_false(is_open(asking));
}

static void where_all_are_being_answered_the_newcomer_goes(void **state)
{
    (void)state;
    for (int i = 0; i < STRANGERS_ADDRESS; i++)
        connection_limits_busy(&connection_limits, come("10.0.0.1", S)->c);
    struct visitor *one_more = come("10.0.0.1", 2 * S);
    assert_false(is_open(one_more));
    for (int i = 0; i < STRANGERS_ADDRESS; i++)
        assert_true(is_open(&visitors[i]));
}

/* Promise(server/rooms-shares-stranger) */
static void a_session_has_a_share_of_the_room(void **state)
{
    (void)state;
    struct visitor *other = come("10.0.0.1", S);
    connection_limits_member(&connection_limits, other->c, "otto");
    for (int i = 0; i < MEMBERS_SESSION; i++)
        connection_limits_member(&connection_limits, come("10.0.0.1", 2 * S + i)->c, "anna");
    assert_true(is_open(&visitors[1]));
    connection_limits_member(&connection_limits, come("10.0.0.1", 3 * S)->c, "anna");
    assert_false(is_open(&visitors[1]));
    assert_true(is_open(other));
    for (int i = 0; i < 2 * MEMBERS_SESSION; i++) /* the local one is all that this user runs */
        connection_limits_member(&connection_limits, come("127.0.0.1", 4 * S)->c, "");
    for (int i = 0; i < 2 * MEMBERS_SESSION; i++)
        assert_true(is_open(&visitors[n - 1 - (size_t)i]));
}

static void there_are_no_more_members_than_places(void **state)
{
    char token[32];
    (void)state;
    for (int i = 0; i <= MEMBERS; i++) {
        snprintf(token, sizeof token, "token%d", i);
        connection_limits_member(&connection_limits, come("10.0.0.1", S + i)->c, token);
        assert_true(is_open(&visitors[0]) == (i < MEMBERS));
    }
    assert_true(is_open(&visitors[1]));
}

/* Promise(server/rooms-shares-stranger) */
static void strangers_have_to_ask_soon(void **state)
{
    (void)state;
    struct visitor *silent = come("10.0.0.1", 100 * S), *begun = come("10.0.0.2", 100 * S),
                   *member = come("10.0.0.3", 100 * S), *waiting = come("10.0.0.4", 100 * S);
    connection_limits_asked(&connection_limits, begun->c);
    connection_limits_member(&connection_limits, member->c, "token");
    connection_limits_asked(&connection_limits, waiting->c);
    connection_limits_busy(&connection_limits, waiting->c);
    connection_limits_look(&connection_limits, 100 * S + HEADER_DEADLINE);
    assert_true(is_open(silent));
    connection_limits_look(&connection_limits, 100 * S + HEADER_DEADLINE + 1);
    assert_false(is_open(silent));
    connection_limits_look(&connection_limits, 100 * S + REQUEST_DEADLINE);
    assert_true(is_open(begun));
    assert_true(is_open(member));
    connection_limits_look(&connection_limits, 100 * S + REQUEST_DEADLINE + 1);
    assert_false(is_open(begun));
    assert_false(is_open(member));
    assert_true(is_open(waiting)); /* for its answer no deadline is the client's to keep */
    connection_limits_answered(&connection_limits, waiting->c, 200 * S);
    connection_limits_look(&connection_limits, 200 * S + HEADER_DEADLINE);
    assert_true(is_open(waiting));
    connection_limits_look(&connection_limits,
                           200 * S + HEADER_DEADLINE + 1); /* and again it is a stranger that has not asked */
    assert_false(is_open(waiting));
}

static void who_leaves_is_forgotten_wherever_he_stood(void **state)
{
    static const int orders[][3] = {{0, 1, 2}, {0, 2, 1}, {1, 0, 2}, {1, 2, 0}, {2, 0, 1}, {2, 1, 0}};
    (void)state;
    for (size_t i = 0; i < sizeof orders / sizeof *orders; i++) {
        struct connection *c[3];
        for (int k = 0; k < 3; k++)
            c[k] = connection_limits_enter(&connection_limits, -1, "10.0.0.1", S);
        connection_limits_leave(&connection_limits, c[orders[i][0]]);
        connection_limits_leave(&connection_limits, c[orders[i][1]]);
        assert_ptr_equal(connection_limits.newest, c[orders[i][2]]);
        assert_null(connection_limits.newest->next);
        connection_limits_leave(&connection_limits, c[orders[i][2]]);
        assert_null(connection_limits.newest);
    }
}

/* ---- Whose process is it ------------------------------------------------------------------ */

/* A connection to a listener of our own, made by a process of this user; the accepted end. */
static int accept_from(uid_t uid, pid_t *child)
{
    int listener = socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0), ready[2];
    struct sockaddr_in address = {.sin_family = AF_INET, .sin_addr.s_addr = htonl(INADDR_LOOPBACK)};
    socklen_t size = sizeof address;
    assert_int_equal(bind(listener, (struct sockaddr *)&address, size), 0);
    assert_int_equal(listen(listener, 1), 0);
    assert_int_equal(getsockname(listener, (struct sockaddr *)&address, &size), 0);
    assert_int_equal(pipe(ready), 0);
    *child = fork();
    if (*child == 0) {
        char byte;
        int fd = setuid(uid) == 0 ? socket(AF_INET, SOCK_STREAM, 0) : -1;
        if (fd < 0 || connect(fd, (struct sockaddr *)&address, size) < 0)
            _exit(1);
        close(ready[1]);
        _exit(read(ready[0], &byte, 1) == 0 ? 0 : 2); /* until the test has looked */
    }
    assert_true(*child > 0);
    int fd = accept(listener, NULL, NULL);
    assert_true(fd >= 0);
    close(listener);
    close(ready[0]);
    visitors[0].far = ready[1];
    return fd;
}

static bool own_when_made_by(uid_t uid)
{
    pid_t child;
    int fd = accept_from(uid, &child);
    bool own = peer_is_own(fd);
    close(visitors[0].far);
    assert_int_equal(waitpid(child, NULL, 0), child);
    bool orphan = peer_is_own(fd); /* its socket is nobody's now, and so not ours */
    assert_false(orphan);
    close(fd);
    return own;
}

/* Promise(server/users) */
static void a_process_of_this_user_is_known_and_another_is_not(void **state)
{
    (void)state;
    assert_true(own_when_made_by(geteuid()));
    if (geteuid() == 0)
        assert_false(own_when_made_by(65534));
}

/* A shell grants 1024 files, which are enough for the server's ends alone. */
static int both_ends_may_be_here(void **state)
{
    (void)state;
    struct rlimit files;
    if (getrlimit(RLIMIT_NOFILE, &files) < 0)
        return -1;
    files.rlim_cur = files.rlim_max;
    return setrlimit(RLIMIT_NOFILE, &files);
}

int main(void)
{
#define T(name) cmocka_unit_test_setup_teardown(name, set_up, tear_down)
    const struct CMUnitTest tests[] = {
        T(many_of_one_address_cost_only_each_other),
        T(strangers_of_many_addresses_cost_the_oldest_stranger_only),
        T(who_is_being_answered_is_not_sent_away),
        T(where_all_are_being_answered_the_newcomer_goes),
        T(a_session_has_a_share_of_the_room),
        T(there_are_no_more_members_than_places),
        T(strangers_have_to_ask_soon),
        T(who_leaves_is_forgotten_wherever_he_stood),
        cmocka_unit_test(a_process_of_this_user_is_known_and_another_is_not),
    };
    return cmocka_run_group_tests(tests, both_ends_may_be_here, NULL);
}

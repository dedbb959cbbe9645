/* SPDX-License-Identifier: BSD-3-Clause */
/* The gate, asked without a connection: each reason to refuse by itself. And where the server may listen. */
#include <arpa/inet.h>
#include <errno.h>
#include <fcntl.h>
#include <netinet/in.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <strings.h>
#include <sys/stat.h>
#include <sys/wait.h>
#include <unistd.h>

#include "apc-ui/api/api.h"
#include "check.h"

static struct ui *ui;
static struct request request;
static struct connection from;
static const char *headers[20]; /* name, value, ... */
static char folder[64], secret[SECRET_LEN], operator_secret[SECRET_LEN], engineer_secret[SECRET_LEN];

/* In place of those that ask a connection. */
const char *request_query(const struct request *r, const char *name)
{
    (void)r;
    (void)name;
    return NULL;
}

const char *request_header(const struct request *r, const char *name)
{
    (void)r;
    for (size_t i = 0; i + 1 < sizeof headers / sizeof *headers && headers[i]; i += 2)
        if (!strcasecmp(headers[i], name))
            return headers[i + 1];
    return NULL;
}

/* In place of asking the kernel, which may or may not say whose a connection is. */
static bool peers_known = true;

bool peer_is_own(int fd)
{
    return fd >= 0 && peers_known;
}

static int set_up(void **state)
{
    char path[128];
    struct apc_error why;
    (void)state;
    snprintf(folder, sizeof folder, "/tmp/apc-gate.XXXXXX");
    ui = calloc(1, sizeof *ui);
    if (!ui || !mkdtemp(folder) ||
        sessions_init(&ui->sessions, APC_NS_PER_S * 100, APC_NS_PER_S * 1000) < 0 ||
        pthread_mutex_init(&ui->users_mutex, NULL))
        return -1;
    snprintf(path, sizeof path, "%s/users.tokens", folder);
    if (tokens_add(path, "reader", ROLE_OBSERVER, 0, secret, &why) < 0 ||
        tokens_add(path, "writer", ROLE_OPERATOR, 0, operator_secret, &why) < 0 ||
        tokens_add(path, "tuner", ROLE_ENGINEER, 0, engineer_secret, &why) < 0 ||
        users_load(&ui->tokens, path, &why) < 0)
        return -1;
    ui->port = 8080;
    ui->open = true;
    ui->options.names[0] = "plant.example";
    from = (struct connection){.peer = 1, .fd = -1};
    memset(headers, 0, sizeof headers);
    return 0;
}

static int tear_down(void **state)
{
    char command[100];
    (void)state;
    users_free(&ui->tokens);
    sessions_free(&ui->sessions);
    free(ui);
    snprintf(command, sizeof command, "rm -r '%s'", folder);
    return system(command);
}

static const struct route *route(const char *method, const char *path)
{
    for (size_t i = 0; i < n_routes; i++)
        if (!strcmp(routes[i].method, method) && !strcmp(routes[i].path, path))
            return &routes[i];
    fail_msg("there is no route %s %s", method, path);
    return NULL;
}

/* The status of the refusal; 0: it passed. What the gate returns and what it says agree. */
static int gate(const struct route *of, const char *method)
{
    request = (struct request){.route = of, .methods = of ? of->method : NULL, .from = &from};
    bool passed = authorize_request(ui, &request, method);
    assert_int_equal(passed, request.fault.http == 0);
    assert_true(passed || request.fault.message[0]);
    return request.fault.http;
}

static int refused(const char *method, const char *path)
{
    return gate(route(method, path), method);
}

static void say(const char *name, const char *value)
{
    for (size_t i = 0; i + 1 < sizeof headers / sizeof *headers; i += 2)
        if (!headers[i] || !strcasecmp(headers[i], name)) {
            headers[i] = name;
            headers[i + 1] = value;
            return;
        }
}

/* A good write of the one who started the server. */
static void say_all(void)
{
    memset(headers, 0, sizeof headers);
    say("Host", "localhost:8080");
    say("Content-Type", "application/json");
    say("X-CSRF-Token", ui->sessions.local.csrf);
    say("Origin", "http://localhost:8080");
    say("Sec-Fetch-Site", "same-origin");
    say("Content-Length", "10");
}

/* Promise(server/headers) */
static void a_request_with_all_it_takes_passes(void **state)
{
    (void)state;
    say_all();
    assert_int_equal(refused("POST", "/api/setpoint"), 0);
    assert_string_equal(request.session.user, "local");
    assert_int_equal(request.session.role, ROLE_ENGINEER);
    assert_int_equal(refused("GET", "/api/state"), 0);
    assert_int_equal(gate(route("GET", "/api/state"), "HEAD"), 0);
    say("Sec-Fetch-Site", "none");
    assert_int_equal(refused("POST", "/api/setpoint"), 0);
    say("Sec-Fetch-Site", "same-origin");
    say("Host", "plant.example");
    say("Origin", "https://plant.example"); /* TLS ends in front of it */
    assert_int_equal(refused("POST", "/api/setpoint"), 0);
    say("Content-Type", "application/json; charset=utf-8");
    say("Content-Length", "65536");
    assert_int_equal(refused("POST", "/api/setpoint"), 0);
}

/* Promise(server/status-codes) */
static void each_thing_amiss_is_a_refusal_by_itself(void **state)
{
    static const struct {
        const char *name, *value;
        int status;
        const char *code;
    } cases[] = {{"Host", "evil.example", 403, "host"},
                 {"Host", NULL, 403, "host"},
                 {"Origin", "http://evil.example", 403, "origin"},
                 {"Origin", "http://localhost:8081", 403, "origin"},
                 {"Sec-Fetch-Site", "same-site", 403, "origin"},
                 {"X-CSRF-Token", NULL, 403, "csrf"},
                 {"X-CSRF-Token", "", 403, "csrf"},
                 {"X-CSRF-Token", "00", 403, "csrf"},
                 {"Content-Type", NULL, 415, "type"},
                 {"Content-Type", "application/jsonx", 415, "type"},
                 {"Content-Type", "application/x-www-form-urlencoded", 415, "type"},
                 {"Content-Length", "65537", 413, "size"},
                 {"Content-Length", "1000000000", 413, "size"},
                 {"Authorization", "Bearer nobody~00", 401, "token"}};
    (void)state;
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        say_all();
        say(cases[i].name, cases[i].value);
        int status = refused("POST", "/api/setpoint");
        if (status != cases[i].status || strcmp(request.fault.code, cases[i].code) != 0)
            fail_msg("%s: %s gives %d %s", cases[i].name, cases[i].value ? cases[i].value : "(none)", status,
                     request.fault.code);
    }
    say_all();
    say("Origin", "http://evil.example"); /* reading is not writing: the answer is not for that page to see */
    assert_int_equal(refused("GET", "/api/state"), 0);
    assert_int_equal(gate(NULL, "GET"), 404);
    assert_int_equal(gate(route("POST", "/api/setpoint"), "GET"), 405);
    assert_int_equal(gate(route("POST", "/api/setpoint"), "HEAD"), 405);
    assert_int_equal(gate(route("GET", "/api/state"), "DELETE"), 405);
    ui->tls = true;
    assert_int_equal(refused("POST", "/api/setpoint"), 403);
    say("Origin", "http://localhost:8080"); /* without TLS, on a server with it */
    assert_int_equal(refused("POST", "/api/setpoint"), 403);
    say("Origin", "https://localhost:8080");
    assert_int_equal(refused("POST", "/api/setpoint"), 0);
}

static void another_users_process_is_a_stranger_here(void **state)
{
    (void)state;
    say_all();
    from.peer = -1;
    for (size_t i = 0; i < n_routes; i++) {
        int status = gate(&routes[i], routes[i].method);
        assert_int_equal(status, routes[i].role == ROLE_NONE ? 0 : 401);
        assert_string_equal(request.session.user, "");
    }
    assert_int_equal(gate(NULL, "GET"), 401); /* nor is he told what there is */
    from.peer = 0;                            /* not looked at yet, and there is no such connection */
    assert_int_equal(refused("GET", "/api/state"), 401);
    assert_int_equal(from.peer, -1);
}

static void a_protected_server_asks_for_a_session(void **state)
{
    (void)state;
    say_all();
    ui->open = false;
    assert_int_equal(refused("GET", "/api/state"), 401);
    assert_string_equal(request.fault.code, "login");
    assert_int_equal(refused("GET", "/livez"), 0);
    assert_int_equal(refused("POST", "/api/login"), 0);
    say("Content-Type", "application/x-www-form-urlencoded");
    assert_int_equal(refused("POST", "/api/login"), 0); /* the login page's form */
    say("Content-Type", "text/plain");
    assert_int_equal(refused("POST", "/api/login"), 415);
}

static void a_token_is_as_good_as_its_role(void **state)
{
    char bearer[200];
    (void)state;
    for (int open = 0; open < 2; open++) {
        ui->open = open;
        say_all();
        say("X-CSRF-Token", NULL);
        snprintf(bearer, sizeof bearer, "Bearer reader~%s", secret);
        say("Authorization", bearer);
        assert_int_equal(refused("GET", "/metrics"), 0);
        assert_string_equal(request.session.user, "reader");
        assert_int_equal(refused("POST", "/api/setpoint"), 403);
        assert_string_equal(request.fault.code, "role");
        snprintf(bearer, sizeof bearer, "bearer   writer~%s", operator_secret);
        assert_int_equal(refused("POST", "/api/setpoint"), 0); /* no browser sends it by itself: no CSRF */
        assert_true(request.session.machine);
        snprintf(bearer, sizeof bearer, "Bearer writer~%s", secret);
        assert_int_equal(refused("GET", "/metrics"), 401);
        snprintf(bearer, sizeof bearer, "Bearer writer%s", operator_secret);
        assert_int_equal(refused("GET", "/metrics"), 401);
        assert_int_equal(refused("GET", "/livez"), 0); /* anyone may */
    }
}

/*
 * Promise(server/token-ended-opens): A token that has ended opens nothing, and what it holds open ends with
 *   it.
 */
static void a_token_that_has_ended_opens_nothing(void **state)
{
    char bearer[200];
    struct user *reader = ui->tokens.user; /* the first that was added */
    (void)state;
    say_all();
    snprintf(bearer, sizeof bearer, "Bearer %s~%s", reader->name, secret);
    say("Authorization", bearer);
    reader->until = apc_clock_utc(NULL) + 3600 * APC_NS_PER_S;
    assert_int_equal(refused("GET", "/metrics"), 0);
    reader->until = apc_clock_utc(NULL) - 1;
    assert_int_equal(refused("GET", "/metrics"), 401);
    assert_string_equal(request.fault.code, "token");
    assert_non_null(strstr(request.fault.message, "has ended"));
    snprintf(bearer, sizeof bearer, "Bearer reader~%s",
             operator_secret); /* who does not know it is not told */
    say("Authorization", bearer);
    assert_int_equal(refused("GET", "/metrics"), 401);
    assert_non_null(strstr(request.fault.message, "no such token"));
}

/* Whether the table, whose rows have their role first, says that this role may. */
static bool documented(const char *table, const struct route *r, enum role role)
{
    char name[120], every[40], least[20] = "";
    snprintf(name, sizeof name, "`%s %s`", r->method, r->path);
    snprintf(every, sizeof every, "every other `%s`", r->method);
    const char *at = strstr(table, name);
    if (!at)
        at = strstr(table, every);
    while (at && at > table && at[-1] != '\n')
        at--;
    if (!at || sscanf(at, "| %19[a-z] |", least) != 1)
        fail_msg("the table of routes has no %s %s", r->method, r->path);
    for (enum role k = ROLE_NONE; k <= ROLE_ENGINEER; k++)
        if (!strcmp(least, k == ROLE_NONE ? "anyone" : role_name(k)))
            return role >= k;
    fail_msg("%s %s: %s is no role", r->method, r->path, least);
    return false;
}

/*
 * Promise(server/every-route-opens): Every route opens to the roles that its row of the table says, and to
 *   no other.
 */
static void the_table_of_roles_is_what_the_gate_does(void **state)
{
    static const char *const names[] = {"nobody", "reader", "writer", "tuner"};
    const char *const secrets[] = {"", secret, operator_secret, engineer_secret};
    const char heading[] = "\n| from | routes |\n|---|---|\n";
    char document[65536], bearer[200], method[8], path[80];
    (void)state;
    FILE *in = fopen(APC_SOURCE_DIR "/docs/http-api.md", "re");
    assert_non_null(in);
    const size_t n = fread(document, 1, sizeof document - 1, in);
    fclose(in);
    document[n] = '\0';
    char *table = strstr(document, heading);
    assert_non_null(table);
    table += strlen(heading);
    char *end = strstr(table, "\n\n");
    assert_non_null(end);
    *end = '\0';
    ui->open = false;
    for (size_t i = 0; i < n_routes; i++)
        for (enum role role = ROLE_NONE; role <= ROLE_ENGINEER; role++) {
            say_all();
            say("X-CSRF-Token", NULL);
            snprintf(bearer, sizeof bearer, "Bearer %s~%s", names[role], secrets[role]);
            say("Authorization", bearer);
            const int status = gate(&routes[i], routes[i].method);
            if ((status == 0) != documented(table, &routes[i], role))
                fail_msg("%s %s: %s gets %d", routes[i].method, routes[i].path,
                         role ? role_name(role) : "a stranger", status);
            assert_true(status == 0 || status == (role == ROLE_NONE ? 401 : 403));
        }
    for (const char *at = strchr(table, '`'); at; at = strchr(strchr(at + 1, '`') + 1, '`'))
        if (sscanf(at, "`%7[A-Z] %79[^`]`", method, path) == 2) {
            bool there = false;
            for (size_t i = 0; i < n_routes; i++)
                there = there || (!strcmp(routes[i].method, method) && !strcmp(routes[i].path, path));
            if (!there)
                fail_msg("the table has %s %s, which is no route", method, path);
        }
}

/* Promise(server/headers) */
static void cookies_are_named_by_port_and_bound_to_the_host_under_tls(void **state)
{
    char name[COOKIE_NAME];
    (void)state;
    cookie_name(ui, "session", name);
    assert_string_equal(name, "apc-session-8080");
    ui->tls = true;
    cookie_name(ui, "device", name);
    assert_string_equal(name, "__Host-apc-device-8080");
}

/* ---- Listening ---------------------------------------------------------------------------- */

/* The error; 0: it listens. */
static int listening(const char *where, struct apc_error *why)
{
    ui->options.listen = where;
    ui->port = 0;
    int fd = listen_on_addresses(ui, why);
    if (fd < 0)
        return fd;
    close(fd);
    assert_true(ui->port > 0);
    return 0;
}

static void it_listens_where_it_may(void **state)
{
    static const char *const bad[] = {
        "8080",        "127.0.0.1:65536", "127.0.0.1:-1", "127.0.0.1:", "::1:8080",         "",
        "localhost:0", "127.0.0.1:8 ",    "[]:0",         "[::1:0",     "127.0.0.1:000000", ":0"};
    struct apc_error why;
    (void)state;
    for (size_t i = 0; i < sizeof bad / sizeof *bad; i++)
        if (listening(bad[i], &why) != APC_EINVAL)
            fail_msg("it listens on \"%s\"", bad[i]);
    assert_int_equal(listening("127.0.0.1:0", &why), 0);
    assert_int_equal(listening("127.1.2.3:00000", &why), 0);
    int six = socket(AF_INET6, SOCK_STREAM | SOCK_CLOEXEC, 0);
    const struct sockaddr_in6 loopback = {.sin6_family = AF_INET6, .sin6_addr = IN6ADDR_LOOPBACK_INIT};
    if (six >= 0 &&
        bind(six, (const struct sockaddr *)&loopback, sizeof loopback) == 0) /* this host has it */
        assert_int_equal(listening("[::1]:0", &why), 0);
    close(six);
    assert_int_equal(listening("[::]:0", &why), APC_EPERM);
    assert_int_equal(listening("0.0.0.0:0", &why), APC_EPERM);
    assert_non_null(strstr(why.text, "apc user add"));
    ui->open = false;
    assert_int_equal(listening("0.0.0.0:0", &why), APC_EPERM);
    assert_non_null(strstr(why.text, "--tls-cert"));
    ui->options.allow_plaintext = true;
    assert_int_equal(listening("0.0.0.0:0", &why), 0);
    ui->options.allow_plaintext = false;
    ui->tls = true;
    assert_int_equal(listening("0.0.0.0:0", &why), 0);
    ui->open = true; /* TLS is no login */
    assert_int_equal(listening("0.0.0.0:0", &why), APC_EPERM);
}

static void a_port_that_is_taken_is_said(void **state)
{
    char where[32];
    struct apc_error why;
    (void)state;
    ui->options.listen = "127.0.0.1:0";
    int fd = listen_on_addresses(ui, &why);
    assert_true(fd >= 0);
    snprintf(where, sizeof where, "127.0.0.1:%d", ui->port);
    assert_int_equal(listening(where, &why), APC_ESYS);
    assert_non_null(strstr(why.text, "stop the program that has this port"));
    close(fd);
}

static void what_it_listens_on_is_its_own_and_never_waits(void **state)
{
    struct apc_error why;
    int on = 0;
    socklen_t size = sizeof on;
    (void)state;
    ui->options.listen = "127.0.0.1:0";
    int fd = listen_on_addresses(ui, &why);
    assert_true(fd >= 0);
    assert_true(fcntl(fd, F_GETFL) & O_NONBLOCK);
    assert_true(fcntl(fd, F_GETFD) & FD_CLOEXEC);
    assert_int_equal(getsockopt(fd, SOL_SOCKET, SO_ACCEPTCONN, &on, &size), 0);
    assert_int_equal(on, 1);
    assert_int_equal(getsockopt(fd, SOL_SOCKET, SO_REUSEADDR, &on, &size), 0);
    assert_int_equal(on, 1); /* started again at once */
    struct sockaddr_in bound;
    size = sizeof bound;
    assert_int_equal(getsockname(fd, (struct sockaddr *)&bound, &size), 0);
    assert_int_equal(ntohs(bound.sin_port), ui->port);
    assert_int_equal(ntohl(bound.sin_addr.s_addr), INADDR_LOOPBACK);
    errno = 0; /* who asked whether connections can be told apart has taken his own away */
    assert_int_equal(accept(fd, NULL, NULL), -1);
    assert_int_equal(errno, EAGAIN);
    close(fd);
    assert_int_equal(listening("127.0.0.1:65536", &why), APC_EINVAL);
    assert_int_equal(listening("0123456789012345678901234567890123456789012345678901234567890123:80", &why),
                     APC_EINVAL);
    assert_non_null(strstr(why.text, "ADDRESS:PORT"));
}

static void where_connections_cannot_be_told_apart_is_said_at_once(void **state)
{
    struct apc_error why;
    char said[600];
    int log[2];
    (void)state;
    assert_int_equal(pipe(log), 0);
    for (int unknown = 0; unknown < 2; unknown++)
        for (int is_open = 0; is_open < 2; is_open++) {
            peers_known = !unknown;
            ui->open = is_open;
            assert_int_equal(apc_log_create(&ui->log, log[1], "test", APC_LOG_WARN), 0);
            assert_int_equal(listening("127.0.0.1:0", &why), 0);
            apc_log_destroy(ui->log); /* all is written */
            ui->log = NULL;
            assert_int_equal(write(log[1], "\n", 1), 1);
            ssize_t n = read(log[0], said, sizeof said - 1);
            assert_true(n > 0);
            said[n] = '\0';
            assert_int_equal(strstr(said, "does not tell whose connections are") != NULL, unknown && is_open);
        }
    peers_known = true;
    close(log[0]);
    close(log[1]);
}

/* In a process of its own: a socket bound there, handed over as systemd does. Returns what became of it. */
static int handed_over(const char *address, bool is_open)
{
    int status = -1;
    pid_t child = fork();
    if (child == 0) {
        struct sockaddr_in in = {.sin_family = AF_INET};
        struct apc_error why;
        char own[16];
        int fd = socket(AF_INET, SOCK_STREAM, 0);
        inet_pton(AF_INET, address, &in.sin_addr);
        if (bind(fd, (const struct sockaddr *)&in, sizeof in) < 0 || listen(fd, 5) < 0 || dup2(fd, 3) < 0)
            _exit(100);
        snprintf(own, sizeof own, "%d", (int)getpid());
        setenv("LISTEN_PID", own, 1);
        setenv("LISTEN_FDS", "1", 1);
        socklen_t size = sizeof in;
        getsockname(3, (struct sockaddr *)&in, &size);
        ui->open = is_open;
        ui->options.listen = "127.0.0.1:1"; /* which is not looked at, but for what it would say */
        int rc = listen_on_addresses(ui, &why);
        _exit(rc == 3 && ui->port == ntohs(in.sin_port) && (fcntl(3, F_GETFL) & O_NONBLOCK) ? 0
              : rc == APC_EPERM && fcntl(3, F_GETFD) < 0                                    ? 1
                                                                                            : 2);
    }
    assert_true(child > 0);
    assert_int_equal(waitpid(child, &status, 0), child);
    assert_true(WIFEXITED(status));
    return WEXITSTATUS(status);
}

static void a_socket_that_is_handed_over_has_to_be_where_it_may(void **state)
{
    (void)state;
    assert_int_equal(handed_over("127.0.0.1", true), 0);
    assert_int_equal(handed_over("0.0.0.0", true), 1);
    assert_int_equal(handed_over("0.0.0.0", false), 1); /* passwords in the clear */
    ui->options.allow_plaintext = true;
    assert_int_equal(handed_over("0.0.0.0", false), 0);
}

int main(void)
{
#define T(name) cmocka_unit_test_setup_teardown(name, set_up, tear_down)
    const struct CMUnitTest tests[] = {
        T(a_request_with_all_it_takes_passes),
        T(each_thing_amiss_is_a_refusal_by_itself),
        T(another_users_process_is_a_stranger_here),
        T(a_protected_server_asks_for_a_session),
        T(a_token_is_as_good_as_its_role),
        T(a_token_that_has_ended_opens_nothing),
        T(the_table_of_roles_is_what_the_gate_does),
        T(cookies_are_named_by_port_and_bound_to_the_host_under_tls),
        T(it_listens_where_it_may),
        T(a_port_that_is_taken_is_said),
        T(what_it_listens_on_is_its_own_and_never_waits),
        T(where_connections_cannot_be_told_apart_is_said_at_once),
        T(a_socket_that_is_handed_over_has_to_be_where_it_may),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}

/* SPDX-License-Identifier: BSD-3-Clause */
/* What goes over the wire: the server itself, on a port of its own and a store in memory, asked as a browser
 * asks. */
#include <dirent.h>
#include <signal.h>
#include <strings.h>
#include <sys/stat.h>
#include <unistd.h>

#include <zlib.h>

#include "apc-ui/api/api.h"

#include "ui/api.h"

#define S    APC_NS_PER_S
#define JSON "Content-Type: application/json\r\n"
#define HTML "Accept: text/html,*/*\r\n"

static struct ui *ui;
static struct apc_store *store;
static struct client anna, nobody;
static char folder[64], script[3000], users_folder[] = "/tmp/apc-http-users.XXXXXX", users_file[64];

static void no_telling(void *ctx, const struct write *write)
{
    (void)ctx;
    (void)write;
}

static void write_file(const char *name, const char *text)
{
    char path[128];
    snprintf(path, sizeof path, "%s/%s", folder, name);
    FILE *file = fopen(path, "w");
    assert_non_null(file);
    fputs(text, file);
    fclose(file);
}

static int make_parts(void)
{
    static const struct apc_tag tags[] = {
        {.table = APC_SENSOR, .id = 1, .name = "y", .low = 0, .high = 1},
        {.table = APC_SETPOINT, .id = 1, .name = "r", .low = 0, .high = 100, .controller = "base"},
        {.table = APC_OPMODE, .id = 1, .name = "u", .low = 0, .high = 3, .controller = "base"},
        {.table = APC_TICK, .id = 1, .name = "base", .controller = "base", .period = 3600}};
    ui->options.store = "mem:serving";
    ui->options.listen = "127.0.0.1:0";
    if (apc_log_create(&ui->log, STDERR_FILENO, "test", APC_LOG_ERROR) < 0 || model_init(&ui->model) < 0 ||
        stream_create(&ui->stream) < 0 || writes_create(&ui->writes, no_telling, NULL) < 0 ||
        sessions_init(&ui->sessions, 100 * S, 1000 * S) < 0 || backoff_init(&ui->backoff) < 0 ||
        audit_init(&ui->audit) < 0 || pthread_mutex_init(&ui->users_mutex, NULL) ||
        duration_stats_init(&ui->reads) < 0 || duration_stats_init(&ui->stores) < 0 ||
        duration_stats_init(&ui->lag) < 0 || apc_store_open(&store, ui->options.store, NULL, NULL) < 0 ||
        apc_store_init(store) < 0 || apc_store_put_tags(store, tags, sizeof tags / sizeof *tags) < 0 ||
        model_load(&ui->model, store) < 0)
        return -1;
    ui->began = apc_clock_mono(NULL);
    ui->round[0] = ui->round[1] = ui->began;
    ui->model.connected = true;
    ui->model.tick[0].seq = 1;
    ui->model.ticked[0] = ui->began;
    return 0;
}

/* Passwords are slow to hash: once for all tests. */
static int make_users(void **state)
{
    struct apc_error why;
    (void)state;
    if (!mkdtemp(users_folder))
        return -1;
    snprintf(users_file, sizeof users_file, "%s/users", users_folder);
    return users_add(users_file, "anna", ROLE_OPERATOR, "operator123", &why) == 0 &&
                   users_add(users_file, "otto", ROLE_OBSERVER, "observer123", &why) == 0
               ? 0
               : -1;
}

static int remove_users(void **state)
{
    (void)state;
    if (unlink(users_file) < 0)
        return -1;
    return rmdir(users_folder);
}

/* Somebody who has logged in. */
static struct client member(const char *name)
{
    struct client c = {.port = ui->port};
    struct session session;
    char cookie[COOKIE_NAME];
    assert_int_equal(
        session_open(&ui->sessions, users_find(&ui->users, name), apc_clock_mono(NULL), &session), 0);
    cookie_name(ui, "session", cookie);
    snprintf(c.cookie, sizeof c.cookie, "%s=%s", cookie, session.token);
    snprintf(c.csrf, sizeof c.csrf, "%s", session.csrf);
    return c;
}

static int set_up(void **state)
{
    struct apc_error why;
    (void)state;
    signal(SIGPIPE, SIG_IGN);
    ui = calloc(1, sizeof *ui);
    snprintf(folder, sizeof folder, "/tmp/apc-http.XXXXXX");
    if (!ui || !mkdtemp(folder) || make_parts() < 0 || users_load(&ui->users, users_file, &why) < 0)
        return -1;
    memset(script, 'a', sizeof script - 1);
    write_file("index.html", "<p>the page");
    write_file("app-1A2B3C4D.js", script);
    if (files_load(&ui->files, folder, &why) < 0 || server_start(ui, &ui_site, &why) < 0)
        return -1;
    nobody = (struct client){.port = ui->port};
    anna = member("anna");
    return 0;
}

static int tear_down(void **state)
{
    char command[100];
    (void)state;
    ui->stopping = true;
    server_stop(ui);
    apc_store_close(store);
    duration_stats_free(&ui->reads);
    duration_stats_free(&ui->stores);
    duration_stats_free(&ui->lag);
    audit_free(&ui->audit);
    sessions_free(&ui->sessions);
    users_free(&ui->users);
    writes_destroy(ui->writes);
    stream_destroy(ui->stream);
    files_free(ui->files);
    model_free(&ui->model);
    apc_log_destroy(ui->log);
    free(ui);
    snprintf(command, sizeof command, "rm -r '%s'", folder);
    return system(command);
}

static void ask(struct http_reply *reply, const struct client *c, const char *method, const char *path,
                const char *more, const char *body)
{
    char lines[1024];
    snprintf(lines, sizeof lines, "Cookie: %s\r\nX-CSRF-Token: %s\r\n%s", c->cookie, c->csrf,
             more ? more : "");
    http_request(reply, c->port, method, path, lines, body);
}

static const char *head(const struct http_reply *reply, const char *name)
{
    static char text[600];
    return http_header(reply, name, text, sizeof text);
}

static void has(const char *text, const char *part)
{
    if (!strstr(text, part))
        fail_msg("\"%s\" is not in: %s", part, text);
}

/* ---- The page ----------------------------------------------------------------------------- */

static void a_file_is_sent_as_it_is_or_zipped(void **state)
{
    struct http_reply reply;
    char plain[sizeof script];
    (void)state;
    ask(&reply, &anna, "GET", "/app-1A2B3C4D.js", NULL, NULL);
    assert_int_equal(reply.status, 200);
    assert_string_equal(reply.body, script);
    assert_string_equal(head(&reply, "Content-Encoding"), "");
    assert_string_equal(head(&reply, "Vary"), "Accept-Encoding");
    assert_string_equal(head(&reply, "Content-Type"), "text/javascript; charset=utf-8");
    assert_string_equal(head(&reply, "Cache-Control"), "private, max-age=31536000, immutable");
    http_free(&reply);
    ask(&reply, &anna, "GET", "/app-1A2B3C4D.js", "Accept-Encoding: br, gzip\r\n", NULL);
    assert_string_equal(head(&reply, "Content-Encoding"), "gzip");
    assert_true(reply.n < sizeof script);
    z_stream z = {.next_in = (Bytef *)reply.body,
                  .avail_in = (uInt)reply.n,
                  .next_out = (Bytef *)plain,
                  .avail_out = sizeof plain};
    assert_int_equal(inflateInit2(&z, 15 + 16), Z_OK);
    assert_int_equal(inflate(&z, Z_FINISH), Z_STREAM_END);
    assert_int_equal(z.total_out, sizeof script - 1);
    assert_memory_equal(plain, script, sizeof script - 1);
    inflateEnd(&z);
    http_free(&reply);
    ask(&reply, &anna, "GET", "/", "Accept-Encoding: gzip\r\n", NULL); /* too small to be worth it */
    assert_string_equal(reply.body, "<p>the page");
    assert_string_equal(head(&reply, "Content-Encoding"), "");
    assert_string_equal(head(&reply, "Cache-Control"), "private, no-cache");
    http_free(&reply);
    ask(&reply, &anna, "HEAD", "/", NULL, NULL);
    assert_int_equal(reply.status, 200);
    assert_int_equal(reply.n, 0);
    http_free(&reply);
}

/* Reported of citizen and of jQuery's host: a coding that was refused by q=0 was sent, GZIP was not
 * understood. */
static void what_is_not_to_be_zipped_is_not(void **state)
{
    static const struct {
        const char *accept;
        bool zipped;
    } cases[] = {{"gzip;q=0", false},
                 {"gzip; q=0.0, identity", false},
                 {"*;q=0, gzip", true},
                 {"br, gzip;q=0, *", false},
                 {"GZIP", true},
                 {"*", true},
                 {"*;q=0", false},
                 {"notgzip", false},
                 {"br;q=1.0, gzip;q=0.001", true},
                 {"gzip;", true},
                 {",", false},
                 {"identity, br", false}};
    char more[80];
    (void)state;
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        struct http_reply reply;
        snprintf(more, sizeof more, "Accept-Encoding: %s\r\n", cases[i].accept);
        ask(&reply, &anna, "GET", "/app-1A2B3C4D.js", more, NULL);
        if (strcmp(head(&reply, "Content-Encoding"), cases[i].zipped ? "gzip" : "") != 0)
            fail_msg("%s", cases[i].accept);
        http_free(&reply);
    }
}

static void a_file_that_is_known_is_not_sent_again(void **state)
{
    struct http_reply reply;
    char more[200];
    (void)state;
    ask(&reply, &anna, "GET", "/app-1A2B3C4D.js", NULL, NULL);
    snprintf(more, sizeof more, "Accept-Encoding: gzip\r\nIf-None-Match: %s\r\n", head(&reply, "ETag"));
    http_free(&reply);
    ask(&reply, &anna, "GET", "/app-1A2B3C4D.js", more, NULL);
    assert_int_equal(reply.status, 304);
    assert_int_equal(reply.n, 0);
    assert_string_equal(head(&reply, "Content-Encoding"), "");
    http_free(&reply);
    ask(&reply, &anna, "GET", "/", more, NULL);
    assert_int_equal(reply.status, 200);
    http_free(&reply);
}

static void what_is_not_there_is_said(void **state)
{
    struct files *page = ui->files, *none = NULL;
    struct apc_error why;
    struct http_reply reply;
    (void)state;
    ask(&reply, &anna, "GET", "/nothing", NULL, NULL);
    assert_int_equal(reply.status, 404);
    has(reply.body, "there is no such address here: docs/http-api.md lists them");
    http_free(&reply);
    assert_int_equal(files_load(&none, "/no/such/folder", &why), APC_ENOTFOUND);
    ui->files = none;
    ask(&reply, &anna, "GET", "/", NULL, NULL);
    assert_int_equal(reply.status, 404);
    has(reply.body, "the page was not built");
    http_free(&reply);
    ui->files = page;
    files_free(none);
}

/* Promise(page/logs-form-comes) */
static void every_answer_carries_what_protects_it(void **state)
{
    static const char *const heads[][2] = {{"X-Content-Type-Options", "nosniff"},
                                           {"X-Frame-Options", "DENY"},
                                           {"Referrer-Policy", "same-origin"},
                                           {"Cross-Origin-Opener-Policy", "same-origin"},
                                           {"Cross-Origin-Resource-Policy", "same-origin"},
                                           {"Strict-Transport-Security", ""}};
    static const char *const paths[] = {"/", "/api/state", "/livez", "/api/nothing"};
    (void)state;
    for (size_t i = 0; i < sizeof paths / sizeof *paths; i++) {
        struct http_reply reply;
        ask(&reply, &anna, "GET", paths[i], NULL, NULL);
        for (size_t k = 0; k < sizeof heads / sizeof *heads; k++)
            assert_string_equal(head(&reply, heads[k][0]), heads[k][1]);
        has(head(&reply, "Content-Security-Policy"),
            "default-src 'self'; object-src 'none'; base-uri 'none'");
        assert_null(strstr(head(&reply, "Content-Security-Policy"), "nonce"));
        if (i > 0)
            assert_string_equal(head(&reply, "Cache-Control"), "no-store");
        assert_string_equal(head(&reply, "Content-Type"), i == 0   ? "text/html; charset=utf-8"
                                                          : i == 2 ? "text/plain; charset=utf-8"
                                                                   : "application/json");
        http_free(&reply);
    }
}

/* ---- Strangers ---------------------------------------------------------------------------- */

/* Promise(page/logs-form-comes) */
static void a_person_who_asks_for_the_page_gets_the_form_and_a_program_does_not(void **state)
{
    struct http_reply reply;
    char nonce[80], element[120], policy[240], *end;
    (void)state;
    http_request(&reply, ui->port, "GET", "/", HTML, NULL);
    assert_int_equal(reply.status, 401);
    assert_string_equal(head(&reply, "Content-Type"), "text/html; charset=utf-8");
    has(head(&reply, "WWW-Authenticate"), "Bearer");
    const char *style = strstr(reply.body, "<style nonce=\"");
    assert_non_null(style);
    snprintf(nonce, sizeof nonce, "'nonce-%s", style + 14);
    end = strchr(nonce, '"');
    assert_true(end && end - nonce > 20);
    *end = '\0';
    snprintf(element, sizeof element, "<script nonce=\"%s\">", nonce + 7);
    has(reply.body, element);
    snprintf(policy, sizeof policy, "; style-src %s'; script-src %s'", nonce, nonce);
    has(head(&reply, "Content-Security-Policy"), policy);
    http_free(&reply);
    static const char *const others[][2] = {
        {"/", NULL}, {"/", "Accept: */*\r\n"}, {"/api/state", HTML}, {"/events", HTML}};
    for (size_t i = 0; i < sizeof others / sizeof *others; i++) {
        http_request(&reply, ui->port, "GET", others[i][0], others[i][1], NULL);
        assert_int_equal(reply.status, 401);
        assert_string_equal(head(&reply, "Content-Type"), "application/json");
        has(reply.body, "\"code\":\"login\"");
        http_free(&reply);
    }
}

static void who_logs_in_gets_a_session_and_a_device_and_may_leave(void **state)
{
    struct http_reply reply;
    (void)state;
    http_request(&reply, ui->port, "POST", "/api/login",
                 "Content-Type: application/x-www-form-urlencoded\r\n", "user=anna&password=operator%3123");
    assert_int_equal(reply.status, 303);
    assert_string_equal(head(&reply, "Location"), "/");
    has(reply.header, "Set-Cookie: apc-session-");
    has(reply.header, "Set-Cookie: apc-device-");
    http_free(&reply);
    anna = client_make(ui->port, "anna", "operator123");
    ask(&reply, &anna, "GET", "/api/session", NULL, NULL);
    has(reply.body, "\"user\":\"anna\"");
    assert_string_equal(head(&reply, "Set-Cookie"), "");
    assert_string_equal(head(&reply, "Location"), "");
    assert_string_equal(head(&reply, "Retry-After"), "");
    assert_string_equal(head(&reply, "Allow"), "");
    assert_string_equal(head(&reply, "WWW-Authenticate"), "");
    http_free(&reply);
    ask(&reply, &anna, "POST", "/api/logout", JSON, "{}");
    assert_int_equal(reply.status, 200);
    has(head(&reply, "Set-Cookie"), "Max-Age=0");
    http_free(&reply);
    expect_error(&anna, "GET", "/api/state", NULL, NULL, 401, "login");
}

static void a_form_is_read_as_browsers_send_it(void **state)
{
    static const struct {
        const char *body;
        int status;
    } cases[] = {{"password=operator123&user=anna", 303},
                 {"xuser=otto&user=anna&passwordx=1&password=operator123", 303},
                 {"user=%61nn%61&password=%6Fperator123", 303},
                 {"user=anna&password=operator123&", 303},
                 {"user=anna&password=operator+123", 401},
                 {"user=anna&password=operator12%3", 401},
                 {"user=anna&password=operator123%", 401},
                 {"user=anna&password=operator%zz123", 401},
                 {"user=anna&password=", 401},
                 {"user=anna", 400},
                 {"password=operator123", 400},
                 {"user", 400},
                 {"user=a%C3%A4&password=operator123", 401}};
    (void)state;
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        struct http_reply reply;
        backoff_succeeded(&ui->backoff, "pair anna 127.0.0.1");
        http_request(&reply, ui->port, "POST", "/api/login",
                     "Content-Type: application/x-www-form-urlencoded\r\n", cases[i].body);
        if (reply.status != cases[i].status)
            fail_msg("%s: %d", cases[i].body, reply.status);
        if (reply.status != 303) { /* the form again, with what was wrong */
            has(reply.body, "<p role=\"alert\">");
            has(reply.body, "<label for=\"password\">");
            assert_string_equal(head(&reply, "Set-Cookie"), "");
        }
        http_free(&reply);
    }
}

static void who_guesses_is_told_how_long_to_wait(void **state)
{
    struct http_reply reply;
    (void)state;
    for (int i = 0; i < 4; i++)
        expect_error(&nobody, "POST", "/api/login", NULL, "{\"user\":\"otto\",\"password\":\"wrong one\"}",
                     401, "credentials");
    backoff_failed(&ui->backoff, "name otto ", 0, apc_clock_mono(NULL) + 1000 * S);
    http_request(&reply, ui->port, "POST", "/api/login", JSON,
                 "{\"user\":\"otto\",\"password\":\"observer123\"}");
    assert_int_equal(reply.status, 429);
    char *end;
    const long wait = strtol(head(&reply, "Retry-After"), &end, 10);
    assert_string_equal(end, "");
    assert_in_range(wait, 500, 1016); /* the fifth failure for this name, and the longest pause */
    http_free(&reply);
}

/* ---- Requests ----------------------------------------------------------------------------- */

static void a_wrong_method_is_told_the_right_one(void **state)
{
    static const char *const cases[][3] = {{"POST", "/api/state", "GET"},
                                           {"GET", "/api/setpoint", "POST"},
                                           {"OPTIONS", "/api/retake", "GET, POST"},
                                           {"PUT", "/", "GET"},
                                           {"DELETE", "/app-1A2B3C4D.js", "GET"}};
    struct http_reply reply;
    (void)state;
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        ask(&reply, &anna, cases[i][0], cases[i][1], JSON, NULL);
        assert_int_equal(reply.status, 405);
        assert_string_equal(head(&reply, "Allow"), cases[i][2]);
        has(reply.body, "\"code\":\"method\"");
        http_free(&reply);
    }
    static const char *const nowhere[][2] = {
        {"PUT", "/nothing"}, {"GET", "/api/nothing"}, {"POST", "/api/nothing"}, {"GET", "/api/"}};
    for (size_t i = 0; i < sizeof nowhere / sizeof *nowhere; i++)
        expect_error(&anna, nowhere[i][0], nowhere[i][1], NULL, NULL, 404, "path");
}

/* Whose proxy passes targets on as it got them, or whose client has the whole address in them: RFC 9112,
 * 3.2.2. Reported of Python's http.server, of XRootD and of others. The host is the target's then. */
static void a_target_may_be_written_in_each_form(void **state)
{
    static const struct {
        const char *method, *target, *more;
        int status;
    } cases[] = {{"GET", "http://127.0.0.1/api/state", NULL, 200},
                 {"GET", "HTTP://127.0.0.1/api/state", NULL, 200},
                 {"GET", "https://127.0.0.1/api/events?last=1", NULL, 200},
                 {"GET", "http://127.0.0.1", NULL, 200},
                 {"GET", "http://127.0.0.1?", NULL, 200},
                 {"HEAD", "http://[::1]/api/state", NULL, 200},
                 {"GET", "http://127.0.0.1/api/nothing", NULL, 404},
                 {"GET", "http://127.0.0.1/api/events?nonsense=1", NULL, 400},
                 {"GET", "http://evil.example/api/state", NULL, 403},
                 {"GET", "http://evil.example%2F/api/state", NULL, 403},
                 {"GET", "http://evil.example?/api/state", NULL, 403},
                 {"GET", "http:///api/state", NULL, 403},
                 {"POST", "http://127.0.0.1/api/setpoint", "Origin: http://evil.example\r\n" JSON, 403},
                 {"GET", "/api/%73t%61te", NULL, 200},
                 {"GET", "/%61pp-1A2B3C4D.js", NULL, 200},
                 {"GET", "/api/state?", NULL, 200},
                 {"GET", "/?", NULL, 200},
                 {"OPTIONS", "*", NULL, 404}};
    static const char *const read[] = {"/api/state", "/api/events", "/events", "/api/session",
                                       "/metrics",   "/livez",      "/readyz"};
    struct http_reply reply;
    (void)state;
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        ask(&reply, &anna, cases[i].method, cases[i].target, cases[i].more, NULL);
        if (reply.status != cases[i].status)
            fail_msg("%s %s: %d", cases[i].method, cases[i].target, reply.status);
        http_free(&reply);
    }
    for (size_t i = 0; i < sizeof read / sizeof *read; i++) { /* HEAD is taken where GET is */
        ask(&reply, &anna, "HEAD", read[i], NULL, NULL);
        if (reply.status != 200 || reply.n != 0)
            fail_msg("HEAD %s: %d, %zu bytes", read[i], reply.status, reply.n);
        http_free(&reply);
    }
}

static void a_parameter_is_known_and_given_once_with_a_value(void **state)
{
    static const char *const bad[][2] = {{"/api/events?nonsense=1", "\\\"nonsense\\\" is not known here"},
                                         {"/api/events?sinc=1", "not known"},
                                         {"/api/events?ince=1", "not known"},
                                         {"/api/events?since%20until=1", "not known"},
                                         {"/api/events?=1", "not known"},
                                         {"/api/state?last=1", "not known"},
                                         {"/api/events?last=1&last=1", "is given twice"},
                                         {"/api/events?last=1&last=2", "is given twice"},
                                         {"/api/events?last=1&kind=a&kind=a", "is given twice"},
                                         {"/api/events?last", "has no value"},
                                         {"/api/events?last=", "whole number from 1 to 5000"},
                                         {"/api/events?last=0", "whole number from 1 to 5000"},
                                         {"/api/events?last=5001", "whole number"},
                                         {"/api/events?last=1x", "whole number"},
                                         {"/api/events?last=99999999999999999999", "whole number"},
                                         {"/api/events?since=x", "Unix seconds"},
                                         {"/api/events?kind=a%00b", "zero byte"},
                                         {"/%00", "zero byte"}};
    static const char *const good[] = {
        "/api/events?last=1&since=-60&until=0&kind=x&text=y&source=z&severity=1",
        "/api/events?last=5000",
        "/api/events?last=1",
        "/api/events?kind=last",
        "/api/events",
        "/?anything=1&anything=2"};
    struct http_reply reply;
    (void)state;
    for (size_t i = 0; i < sizeof bad / sizeof *bad; i++) {
        ask(&reply, &anna, "GET", bad[i][0], NULL, NULL);
        if (reply.status != 400)
            fail_msg("%s: %d", bad[i][0], reply.status);
        has(reply.body, "\"code\":\"parameter\"");
        has(reply.body, bad[i][1]);
        http_free(&reply);
    }
    for (size_t i = 0; i < sizeof good / sizeof *good; i++) {
        ask(&reply, &anna, "GET", good[i], NULL, NULL);
        if (strstr(good[i], "until=0") ? reply.status != 422 : reply.status != 200) /* since must be before */
            fail_msg("%s: %d %s", good[i], reply.status, reply.body);
        http_free(&reply);
    }
}

static const char *chunked(const char *path, const char *body, size_t piece)
{
    static char bytes[1 << 20];
    size_t n = strlen(body);
    char *const end = bytes + sizeof bytes;
    char *at =
        bytes + snprintf(bytes, sizeof bytes,
                         "POST %s HTTP/1.1\r\nHost: localhost\r\nCookie: %s\r\nX-CSRF-Token: %s\r\n" JSON
                         "Transfer-Encoding: chunked\r\nConnection: close\r\n\r\n",
                         path, anna.cookie, anna.csrf);
    for (size_t i = 0; i < n; i += piece) {
        size_t part = n - i < piece ? n - i : piece;
        at += snprintf(at, (size_t)(end - at), "%zx\r\n%.*s\r\n", part, (int)part, body + i);
        assert_true(at < end);
    }
    snprintf(at, (size_t)(end - at), "0\r\n\r\n");
    return bytes;
}

static void a_body_is_put_together_up_to_its_limit(void **state)
{
    static char long_body[BODY_MAX + 2];
    struct http_reply reply;
    (void)state;
    const char *bytes = chunked("/api/setpoint", "{\"id\":1,\"value\":12.5,\"seq\":0}", 3);
    http_raw(&reply, ui->port, bytes, strlen(bytes));
    assert_int_equal(reply.status, 200);
    has(reply.body, "\"to\":12.5");
    http_free(&reply);
    memset(long_body, ' ', BODY_MAX);
    memcpy(long_body, "{\"id\":1,\"value\":13.5,\"seq\":1}", 29);
    bytes = chunked("/api/setpoint", long_body, 4096); /* as long as may be */
    http_raw(&reply, ui->port, bytes, strlen(bytes));
    assert_int_equal(reply.status, 200);
    http_free(&reply);
    long_body[BODY_MAX] = ' ';
    bytes = chunked("/api/setpoint", long_body, 4096);
    http_raw(&reply, ui->port, bytes, strlen(bytes));
    assert_int_equal(reply.status, 413);
    has(reply.body, "larger than 65536 bytes");
    http_free(&reply);
}

/* The number of answers to these bytes, and the status of the first. */
static int answers(const char *bytes, int *status)
{
    struct http_reply reply;
    int count = 0;
    http_raw(&reply, ui->port, bytes, strlen(bytes));
    *status = reply.status;
    for (const char *at = reply.body; at && (at = strstr(at, "HTTP/1.1 ")) != NULL; at++)
        count++;
    count += reply.status != 0;
    http_free(&reply);
    return count;
}

static void two_hosts_or_two_ends_are_the_last_of_their_connection(void **state)
{
#define AFTER "GET /livez HTTP/1.1\r\nHost: localhost\r\nConnection: close\r\n\r\n"
    static const char *const twice[] = {
        ("POST /api/login HTTP/1.1\r\nHost: localhost\r\n" JSON
         "Content-Length: 4\r\nTransfer-Encoding: chunked\r\n\r\n0\r\n\r\n" AFTER),
        ("POST /api/login HTTP/1.1\r\nHost: localhost\r\n" JSON
         "Content-Length: 2\r\nContent-Length: 2\r\n\r\n{}" AFTER),
        ("GET /livez HTTP/1.1\r\nHost: localhost\r\nHost: localhost\r\n\r\n" AFTER)};
    int status;
    (void)state;
    assert_int_equal(answers("GET /livez HTTP/1.1\r\nHost: localhost\r\n\r\n" AFTER, &status), 2);
    assert_int_equal(status, 200);
    for (size_t i = 0; i < sizeof twice / sizeof *twice; i++) {
        assert_int_equal(answers(twice[i], &status), 1);
        assert_int_equal(status, 400);
    }
}

/* The library itself refuses it (0.9.75 with the head of its answer twice). Nothing behind it is a request. */
static void a_length_that_is_none_is_the_last_of_its_connection(void **state)
{
    static const char *const lengths[] = {"abc", "-1", "+2", "2x", "0x2", "2, 2", "2 2", ""};
    (void)state;
    for (size_t i = 0; i < sizeof lengths / sizeof *lengths; i++) {
        struct http_reply reply;
        char bytes[400];
        snprintf(bytes, sizeof bytes,
                 "POST /api/login HTTP/1.1\r\nHost: localhost\r\n" JSON "Content-Length: %s\r\n\r\n{}" AFTER,
                 lengths[i]);
        http_raw(&reply, ui->port, bytes, strlen(bytes));
        assert_int_equal(reply.status, 400);
        assert_null(strstr(reply.body, " 200 "));
        http_free(&reply);
    }
}

static void a_stale_write_finds_what_is_newer_in_the_error(void **state)
{
    json_t *json;
    (void)state;
    assert_int_equal(client_post(&anna, "/api/setpoint", "{\"id\":1,\"value\":5,\"seq\":0}", NULL), 200);
    assert_int_equal(client_post(&anna, "/api/setpoint", "{\"id\":1,\"value\":6,\"seq\":0}", &json), 409);
    const json_t *error = json_object_get(json, "error"),
                 *newer = json_object_get(json_object_get(error, "current"), "setpoint.1");
    assert_string_equal(text_of(error, "code"), "stale");
    assert_int_equal(json_integer_value(json_array_get(newer, 0)), 1);
    assert_null(json_object_get(json, "current"));
    json_decref(json);
    assert_int_equal(client_post(&anna, "/api/setpoint", "{\"id\":1,\"value\":500,\"seq\":1}", &json), 422);
    assert_string_equal(text_of(json_object_get(json, "error"), "field"), "value");
    json_decref(json);
    assert_int_equal(client_get(&anna, "/api/nothing", &json), 404);
    assert_null(json_object_get(json_object_get(json, "error"), "field"));
    json_decref(json);
}

/* Promise(run): What nobody would apply the page does not write: it says who does not tick. */
static void what_nobody_would_apply_is_not_written(void **state)
{
    struct apc_sample now = {.table = APC_SETPOINT, .id = 1};
    json_t *json;
    (void)state;
    assert_true(apc_store_read(store, &now, 1) >= 0);
    const int64_t before = now.seq;
    ui->model.tick[0].seq = 0;
    assert_int_equal(client_post(&anna, "/api/setpoint", "{\"id\":1,\"value\":5,\"seq\":0}", &json), 409);
    const json_t *error = json_object_get(json, "error");
    assert_string_equal(text_of(error, "code"), "nobody");
    assert_string_equal(text_of(error, "message"),
                        "no controller applies it: controller base has never ticked. Nothing was written");
    json_decref(json);
    ui->model.tick[0].seq = 1;
    assert_true(apc_store_read(store, &now, 1) >= 0);
    assert_int_equal(now.seq, before);
}

static int count_refusals(void *ctx, const struct apc_event *event)
{
    int *n = ctx;
    *n += !strncmp(event->text, "refused: ", 9);
    return 0;
}

static int refusals(void)
{
    int n = 0;
    assert_int_equal(audit_flush(ui, store), 0);
    assert_true(apc_store_events(store, &(struct apc_range){.last = 1000}, count_refusals, &n) >= 0);
    return n;
}

static void refused_writes_are_recorded_and_refused_questions_are_not(void **state)
{
    const int before = refusals();
    (void)state;
    struct client otto = member("otto");
    expect_error(&otto, "POST", "/api/setpoint", NULL, "{\"id\":1,\"value\":5,\"seq\":0}", 403, "role");
    assert_int_equal(refusals(), before + 1);
    expect_error(&otto, "GET", "/api/events?x=1", NULL, NULL, 400, "parameter");
    expect_error(&nobody, "GET", "/api/state", NULL, NULL, 401, "login");
    expect_error(&nobody, "POST", "/api/login", NULL, "{}", 400, "json");
    expect_error(&otto, "POST", "/api/nothing", NULL, "{}", 404, "path");
    assert_int_equal(refusals(), before + 1);
    expect_error(&nobody, "POST", "/api/setpoint", NULL, "{}", 401, "login");
    assert_int_equal(refusals(), before + 2);
}

static void answers_are_counted_by_their_hundreds(void **state)
{
    const uint64_t two = ui->requests[2], three = ui->requests[3], four = ui->requests[4],
                   five = ui->requests[5];
    (void)state;
    assert_int_equal(client_get(&anna, "/api/state", NULL), 200);
    assert_int_equal(client_get(&anna, "/api/nothing", NULL), 404);
    assert_int_equal(client_get(&anna, "/api/history", NULL), 422);
    ui->model.connected = false;
    assert_int_equal(client_get(&anna, "/readyz", NULL), 503);
    assert_int_equal(ui->requests[2], two + 1);
    assert_int_equal(ui->requests[3], three);
    assert_int_equal(ui->requests[4], four + 2);
    assert_int_equal(ui->requests[5], five + 1);
}

static void one_connection_takes_many_requests(void **state)
{
    char bytes[4000];
    size_t n = 0;
    int status;
    (void)state;
    for (int i = 0; i < 5; i++) /* of each kind of thread, one after the other */
        n += (size_t)snprintf(
            bytes + n, sizeof bytes - n, "GET %s HTTP/1.1\r\nHost: localhost\r\nCookie: %s\r\n%s\r\n",
            i % 2 ? "/api/events" : "/api/state", anna.cookie, i == 4 ? "Connection: close\r\n" : "");
    assert_int_equal(answers(bytes, &status), 5);
    assert_int_equal(status, 200);
}

/* ---- The stream --------------------------------------------------------------------------- */

static void a_stream_greets_goes_on_and_is_resumed(void **state)
{
    struct http_message message;
    char id[64];
    (void)state;
    struct http_stream *stream = client_stream(&anna, NULL);
    json_t *hello = next_event(stream, "hello", NULL);
    assert_true(json_is_false(json_object_get(hello, "resumed")));
    assert_near(number_of(hello, "t"), (double)apc_clock_utc(NULL) / 1e9, 60);
    json_decref(hello);
    json_t *first = next_event(stream, "state", NULL);
    assert_non_null(json_object_get(first, "values"));
    json_decref(first);
    stream_publish(ui->stream, "values", "{\"n\":1}", 7, true);
    json_decref(next_event(stream, "values", &message));
    snprintf(id, sizeof id, "%s", message.id);
    http_stream_close(stream);
    stream_publish(ui->stream, "values", "{\"n\":2}", 7, true);
    for (int how = 0; how < 2; how++) { /* as a browser says it, and as a page that was loaded anew does */
        char path[128];
        snprintf(path, sizeof path, "/events?last=%s", id);
        char header[400];
        snprintf(header, sizeof header, "Cookie: %s\r\n", anna.cookie);
        stream = how ? http_stream_open(ui->port, path, header) : client_stream(&anna, id);
        assert_true(http_stream_next(stream, &message));
        assert_string_equal(message.event, "hello");
        has(message.data, "\"resumed\":true");
        assert_true(http_stream_next(stream, &message)); /* without a state */
        assert_string_equal(message.data, "{\"n\":2}");
        http_stream_close(stream);
    }
}

static void a_session_that_ends_takes_its_streams_along(void **state)
{
    struct client otto = member("otto");
    (void)state;
    struct http_stream *his = client_stream(&otto, NULL), *hers = client_stream(&anna, NULL);
    json_decref(next_event(his, "state", NULL));
    json_decref(next_event(hers, "state", NULL));
    server_look(ui);
    assert_int_equal(client_post(&otto, "/api/logout", "{}", NULL), 200);
    server_look(ui);
    json_t *bye = next_event(his, "bye", NULL);
    assert_string_equal(text_of(bye, "reason"), "session");
    json_decref(bye);
    stream_publish(ui->stream, "values", "{\"n\":1}", 7, true);
    json_decref(next_event(hers, "values", NULL));
    http_stream_close(his);
    http_stream_close(hers);
}

static void a_session_has_its_share_of_streams(void **state)
{
    struct http_stream *streams[STREAM_SHARE];
    struct http_reply reply;
    (void)state;
    for (int i = 0; i < STREAM_SHARE; i++) {
        streams[i] = client_stream(&anna, NULL);
        json_decref(next_event(streams[i], "state", NULL));
    }
    ask(&reply, &anna, "GET", "/events", NULL, NULL);
    assert_int_equal(reply.status, 503);
    assert_string_equal(head(&reply, "Retry-After"), "10");
    has(reply.body, "too many pages are watching in this session");
    http_free(&reply);
    for (int i = 0; i < STREAM_SHARE; i++)
        http_stream_close(streams[i]);
}

static void an_open_servers_streams_end_when_users_are_made(void **state)
{
    (void)state;
    ui->open = true;
    struct client local = client_make(ui->port, NULL, NULL);
    struct http_stream *stream = client_stream(&local, NULL);
    json_decref(next_event(stream, "state", NULL));
    server_look(ui);
    stream_publish(ui->stream, "values", "{\"n\":1}", 7, true);
    json_decref(next_event(stream, "values", NULL));
    ui->open = false;
    server_look(ui);
    json_t *bye = next_event(stream, "bye", NULL);
    assert_string_equal(text_of(bye, "reason"), "session");
    json_decref(bye);
    http_stream_close(stream);
}

static void a_server_that_stops_says_so(void **state)
{
    struct http_stream *streams[STREAM_SHARE];
    (void)state;
    for (int i = 0; i < STREAM_SHARE; i++) {
        streams[i] = client_stream(&anna, NULL);
        json_decref(next_event(streams[i], "state", NULL));
    }
    server_stop(ui);
    for (int i = 0; i < STREAM_SHARE; i++) {
        json_t *bye = next_event(streams[i], "bye", NULL);
        assert_string_equal(text_of(bye, "reason"), "shutdown");
        json_decref(bye);
        http_stream_close(streams[i]);
    }
    assert_null(ui->server);
    server_stop(ui); /* twice is once */
}

/* ---- Starting ----------------------------------------------------------------------------- */

/* Why another server with these files does not start. */
static const char *not_started(const char *cert, const char *key)
{
    static struct apc_error why;
    server_stop(ui);
    ui->options.tls_cert = cert;
    ui->options.tls_key = key;
    assert_true(server_start(ui, &ui_site, &why) < 0);
    server_stop(ui);
    ui->options.tls_cert = ui->options.tls_key = NULL;
    return why.text;
}

static size_t descriptors(void)
{
    size_t n = 0;
    DIR *dir = opendir("/proc/self/fd");
    assert_non_null(dir);
    while (readdir(dir))
        n++;
    closedir(dir);
    return n;
}

static void what_is_wrong_with_a_certificate_is_said(void **state)
{
    char empty[100], garbage[100];
    (void)state;
    write_file("empty", "");
    write_file("garbage", "no certificate");
    snprintf(empty, sizeof empty, "%s/empty", folder);
    snprintf(garbage, sizeof garbage, "%s/garbage", folder);
    has(not_started("/no/such/file", garbage), "/no/such/file: cannot be read: No such file");
    has(not_started(garbage, "/no/such/key"), "/no/such/key: cannot be read: No such file");
    has(not_started(empty, garbage), "it is empty");
    has(not_started(garbage, garbage), "certificate and key must be PEM and belong together");
    const size_t n = descriptors(); /* nothing is left of it */
    has(not_started(garbage, garbage), "certificate and key must be PEM and belong together");
    assert_int_equal(descriptors(), n);
}

/* A double beside a microsecond of Unix time is up to 0.2 us off: what is meant is the row of that time. */
static void a_row_is_asked_for_by_the_time_that_it_was_told_with(void **state)
{
    (void)state;
    for (int64_t us = 1795914937400150; us < 1795914937400250; us++) {
        char text[32];
        apc_ns at;
        snprintf(text, sizeof text, "%.6f", (double)us / 1e6);
        assert_true(time_parse(text, 0, &at));
        assert_int_equal(at, us * APC_NS_PER_US);
    }
}

int main(void)
{
#define T(name) cmocka_unit_test_setup_teardown(name, set_up, tear_down)
    const struct CMUnitTest tests[] = {
        T(a_file_is_sent_as_it_is_or_zipped),
        cmocka_unit_test(a_row_is_asked_for_by_the_time_that_it_was_told_with),
        T(what_is_not_to_be_zipped_is_not),
        T(a_file_that_is_known_is_not_sent_again),
        T(what_is_not_there_is_said),
        T(every_answer_carries_what_protects_it),
        T(a_person_who_asks_for_the_page_gets_the_form_and_a_program_does_not),
        T(who_logs_in_gets_a_session_and_a_device_and_may_leave),
        T(a_form_is_read_as_browsers_send_it),
        T(who_guesses_is_told_how_long_to_wait),
        T(a_wrong_method_is_told_the_right_one),
        T(a_target_may_be_written_in_each_form),
        T(a_parameter_is_known_and_given_once_with_a_value),
        T(a_body_is_put_together_up_to_its_limit),
        T(two_hosts_or_two_ends_are_the_last_of_their_connection),
        T(a_length_that_is_none_is_the_last_of_its_connection),
        T(a_stale_write_finds_what_is_newer_in_the_error),
        T(what_nobody_would_apply_is_not_written),
        T(refused_writes_are_recorded_and_refused_questions_are_not),
        T(answers_are_counted_by_their_hundreds),
        T(one_connection_takes_many_requests),
        T(a_stream_greets_goes_on_and_is_resumed),
        T(a_session_that_ends_takes_its_streams_along),
        T(a_session_has_its_share_of_streams),
        T(an_open_servers_streams_end_when_users_are_made),
        T(a_server_that_stops_says_so),
        T(what_is_wrong_with_a_certificate_is_said),
    };
    return cmocka_run_group_tests(tests, make_users, remove_users);
}
